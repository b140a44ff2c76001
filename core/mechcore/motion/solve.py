"""From a mechanism to its motion: compiling, solving, and messages where it cannot be assembled or cannot continue."""

from __future__ import annotations

import cmath
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from mechcore.accuracy import DEFAULT, Accuracy
from mechcore.arrays import Flags, Real, numbers
from mechcore.branches.assembly import Assembly, assemble, fitting_statements
from mechcore.branches.dead_points import CLOSURE_LIMIT
from mechcore.branches.modes import at_sketch, other_modes, sketched_drives
from mechcore.branches.paths import BranchPath, Waypoint, travel_of
from mechcore.branches.singular_points import SingularPoints, find_singular_points
from mechcore.branches.unwrapped import UnwrappedAngles, raw_angles, start_pose
from mechcore.compiled.motion import Executor
from mechcore.compiled.toolchain import required_compiler
from mechcore.constants import MOST_TURNS, SINGULAR, TURN
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.build import build_model
from mechcore.kinematics.model import Model
from mechcore.kinematics.program import Block
from mechcore.kinematics.state import relation_sum
from mechcore.laws.timed import ConstantSpeed, moves
from mechcore.motion.compiled import Compiled, drive_values, motion_or_nan, place
from mechcore.motion.events import at_drive
from mechcore.motion.motion import Motion
from mechcore.motion.reach import SlotOverrun, greatest_closure_error, nearest_range, reachable_ranges, slot_overruns
from mechcore.motion.structure import gruebler, rank_mobility
from mechcore.numerics.frames import keep_freed_memory, runs
from mechcore.spec.mechanism import Mechanism, PinSlot, Prismatic
from mechcore.texts import Text, as_coordinate, as_length
from mechcore.topology.checks import missing_joint

MOST_CYCLES = 1e9  # of a drive in a run: beyond, times of 16 digits resolve a cycle to no better than a millionth


def compile_mechanism(mechanism: Mechanism, accuracy: Accuracy = DEFAULT, executor: Executor = "numpy") -> Compiled:
    """Compile and assemble a mechanism.

    ``accuracy``: settings for all computations with it; ``executor``: what runs the steps of its program. Raises `MechanismError`
    with every fault found, and if the executor is C and there is no compiler.
    """
    if executor == "c":
        required_compiler()
    keep_freed_memory()
    model = build_model(mechanism)
    if model.free:
        n, left = len(model.free), max(len(model.order.free), 1)
        where = ", ".join(model.free[:8]) + (" ..." if n > 8 else "")
        freedoms, drives = ("a degree", "a drive") if left == 1 else (f"{left} degrees", f"{left} drives")
        to = "one" if left == 1 else str(left)
        joint = missing_joint(mechanism)
        joint += "; or " if joint else ""
        raise MechanismError(
            Fault(
                "drives",
                f"the mechanism has {freedoms} of freedom without a drive: nothing determines the motion at {where}.",
                f"Add {joint}{drives}, such as drive = {{ speed = 0 }}, at {to} of these joints, or fix a link.",
            )
        )
    start = tuple(float(d.law(0.0)[0]) for d in mechanism.drives)
    assembly = _assembled(model, start, accuracy)
    singular_points = find_singular_points(model, assembly.modes, assembly.starts)
    class_angles = raw_angles(model, start, assembly.state, ())
    angles = UnwrappedAngles(
        model, start_pose(model, class_angles), Waypoint(-np.inf, np.array(start), class_angles, assembly.starts)
    )
    return Compiled(model, assembly, start, angles, singular_points, accuracy=accuracy, executor=executor)


def _assembled(model: Model, start: tuple[float, ...], accuracy: Accuracy) -> Assembly:
    """Assemble a mechanism at the start.

    If its sketch shows other positions of the drives, the mechanism is assembled there and followed to the start. A sketch of the
    start position may be approximate; it need not close the loops.
    """
    drawn = sketched_drives(model, start)
    if drawn is None:
        return assemble(model, start)
    mechanism = model.mechanism
    faults: Sequence[Fault] = ()
    for other in (start, *_in_other_sense(model, drawn, start)):
        try:
            driven = compile_mechanism(at_sketch(mechanism, drawn, other), accuracy)
            motion = solve_motion(driven, np.array([0.0, 1.0]))
        except MechanismError as error:
            faults = faults or error.faults
            continue
        x, y, angle = range(3)
        poses = {link.name: motion.pose(link.name)[1] for link in mechanism.links if link.name != mechanism.frame}
        sketch = {name: (float(p[x]), float(p[y]), float(p[angle])) for name, p in poses.items()}
        return assemble(replace(model, mechanism=replace(mechanism, sketch=sketch)), start)
    led_by = zip(mechanism.drives, drawn, strict=True)
    places = ", ".join(f"{d.joint} = {as_coordinate(q, rotary=model.rotary(d.joint), digits=4)}" for d, q in led_by)
    why = f"the sketch is drawn at {places}, and the mechanism cannot be led from there to the start. On the way:"
    remedy = f"Sketch the mechanism where its drives start{fitting_statements(model, start)}"
    said = [(f.path, Text.of(f.message).source, Text.of(f.remedy).source) for f in faults]
    raise MechanismError([Fault(path, f"{why} {message}", f"{remedy}, or: {other}") for path, message, other in said])


def _in_other_sense(model: Model, drawn: Sequence[float], start: Sequence[float]) -> list[tuple[float, ...]]:
    """The start position one turn away, so that a single rotary drive reaches it in the other sense; empty for other drives."""
    if len(start) != 1 or not model.rotary(model.mechanism.drives[0].joint):
        return []
    return [(start[0] - float(np.copysign(TURN, start[0] - drawn[0])),)]


def default_times(mechanism: Mechanism, frames: int = 360, cycles: float = 1.0) -> Real:
    """Frame times (frames + 1,) [s], uniform over ``cycles`` cycles (see `Mechanism.cycle`), both ends included; one frame if the
    cycle is 0 (statics)."""
    if mechanism.cycle == 0.0:
        return np.zeros(1)
    return np.linspace(0.0, cycles * mechanism.cycle, frames + 1)


def solve_motion(
    compiled: Compiled,
    time: ArrayLike,
    *,
    drives: Mapping[str, tuple[ArrayLike, ArrayLike, ArrayLike]] | None = None,
    strict: bool = True,
) -> Motion:
    """Motion at times (F,) [s].

    ``drives`` replaces the laws by given positions, speeds and accelerations (F,) of driven joints. If the mechanism cannot be
    assembled at some frames, ``strict`` raises `MechanismError` that names the joint, the range and the closure error; else those
    frames are NaN.
    """
    if not strict:
        return motion_or_nan(compiled, time, drives)
    model, given = compiled.model, drives is not None
    time = numbers(time)
    if not given and len(time):
        _check_places_in_cycles(model.mechanism, float(time[-1]))
    values = drive_values(model.mechanism, time, drives)
    if not given and len(time):
        _check_direction(compiled, [v[0] for v in values])
    motion, path, parameter, singular_points = place(compiled, time, values, given=given)
    if motion.interpolants or not _all_placed(model, motion):
        faults = _faults(compiled, motion, path, parameter, time)
        if faults:
            raise MechanismError(faults)
    if path is not None and parameter is not None and path.unreachable and not given and len(time):
        _check_reachable_on(compiled, path, time, parameter)
    if not given and singular_points is not None and singular_points.unreachable:
        _check_reachable(compiled, singular_points, time)
    if len(time) and model.mechanism.ends:
        out = [_out_of_slot(compiled, motion, overrun) for overrun in slot_overruns(motion)]
        if out:
            raise MechanismError(out)
    if not given and not model.mechanism.moving and len(time) and (model.mechanism.loads or model.mechanism.effects):
        _check_statics(motion)
    return motion


def _check_places_in_cycles(mechanism: Mechanism, last: float) -> None:
    """Raise `MechanismError` if times up to ``last`` [s] have too few digits to resolve the cycle of a drive."""
    for drive in mechanism.drives:
        cycle = drive.law.duration
        if last > MOST_CYCLES * cycle and moves(drive.law):
            raise MechanismError(
                Fault(
                    "run.cycles",
                    f"a run of {last:.6g} s goes through {last / cycle:.3g} cycles of the drive of {drive.joint}, of {cycle:.6g} s"
                    " each: numbers of 16 digits do not say where in them.",
                    "Give fewer cycles, or drives whose cycles are alike.",
                )
            )


def _check_statics(motion: Motion) -> None:
    """Raise `MechanismError` for a structure under forces that its joints and drives do not hold."""
    worst = float(motion.condition[0])
    if rank_mobility(motion) if not motion.mechanism.drives else not worst <= SINGULAR:
        why = f"nothing moves, but its joints do not hold it here against every load (condition number {worst:.2g})."
        raise MechanismError(Fault("drives", why, "Add a joint or a drive that holds it, or let it stand in another position."))


def _check_direction(compiled: Compiled, positions: Sequence[Real]) -> None:
    """Raise `MechanismError` if a drive travels so far that following all change points and angles would take too long."""
    near = compiled.travel_bound
    for q in positions:
        if not (-near < q.item(0) < near and -near < q.item(-1) < near):
            break
    else:
        return
    model = compiled.model
    for drive, start, q in zip(model.mechanism.drives, compiled.start, positions, strict=True):
        travel = max(abs(float(q[0]) - start), abs(float(q[-1]) - start))
        rotary = model.rotary(drive.joint)
        turns = travel / (TURN if rotary else TURN * model.length_scale)
        if turns > MOST_TURNS * (1.0 + 1e-9):
            far = (
                f"{turns:.6g} turns"
                if rotary
                else f"{as_length(travel)}, {travel / model.length_scale:.6g} times the size of the mechanism"
            )
            most = f"{MOST_TURNS:,} turns" if rotary else as_length(TURN * MOST_TURNS * model.length_scale)
            why = f"it goes {far} from its start; motions are followed over {most} at most."
            raise MechanismError(Fault(f"joints.{drive.joint}.drive", why, "Run fewer cycles, or give it a shorter travel."))


def _check_reachable(compiled: Compiled, singular_points: SingularPoints, time: Real) -> None:
    """Raise `MechanismError` if the mechanism cannot be assembled in an interval between the frames, however short."""
    for unreachable in singular_points.unreachable_within(float(np.min(time)), float(np.max(time))):
        motion = motion_or_nan(compiled, np.linspace(unreachable.start, unreachable.end, 101))
        faults = _faults(compiled, motion, None, None, time)
        if faults:
            raise MechanismError(faults)


def _check_reachable_on(compiled: Compiled, path: BranchPath, time: Real, parameter: Real) -> None:
    """Raise `MechanismError` if the mechanism cannot be assembled in an interval of its path between the frames, however short."""
    low, high = float(np.min(parameter)), float(np.max(parameter))
    if not path.by_time:
        low, high, _ = travel_of(compiled.mechanism.drives[0].law, float(np.min(time)), float(np.max(time)))
    for start, end, _ in path.unreachable:
        period = path.period
        shift = 0.0 if period is None else period * np.ceil((low - end) / period)
        if start + shift >= high or end + shift <= low:
            continue
        inside = np.linspace(start + shift, end + shift, 101)
        if path.by_time:
            motion = motion_or_nan(compiled, inside)
        else:
            joint = compiled.mechanism.drives[0].joint
            given = {joint: (inside, np.ones_like(inside), np.zeros_like(inside))}
            motion = motion_or_nan(compiled, np.zeros(len(inside)), given)
        faults = _faults(compiled, motion, path, inside, time)
        if faults:
            raise MechanismError(faults)


def _faults(compiled: Compiled, motion: Motion, path: BranchPath | None, parameter: Real | None, time: Real) -> list[Fault]:
    """Faults for frames of a run over ``time`` that cannot be assembled: for each frame the first group in solving order that
    fails."""
    model = compiled.model
    faults: list[Fault] = []
    failed = np.zeros(motion.frames, bool)
    followed = set() if path is None else {b.name for b in path.model.blocks if b.kind == "general"}
    for block in model.blocks:
        if block.redundant or motion.interpolants:  # loops must close where a branch was interpolated, too
            error = np.zeros(motion.frames)
            for c in block.loops:
                error = np.maximum(error, np.abs(motion.closure_error(c)))
            for r in block.relations:
                error = np.maximum(error, np.abs(relation_sum(model, r, motion.state)[0]))
            bad = ~(error <= max(1e-9, 10.0 * compiled.accuracy.position) * model.length_scale) & ~failed
            worst = float(np.fmax.reduce(np.where(bad, error, 0.0), initial=0.0))
        else:
            bad = ~_placed(model, block, motion) & ~failed
            if block.name in followed and path is not None and parameter is not None:
                bad |= ~path.reached(parameter) & ~failed
            worst = greatest_closure_error(compiled.assembly, block, motion, bad) if bad.any() else 0.0
        if bad.any():
            underdetermined = path is not None and block.name in path.continuation.underdetermined
            faults.append(_out_of_reach(compiled, block, motion, bad, worst, time, underdetermined=underdetermined))
            failed |= bad
    return faults


def _all_placed(model: Model, motion: Motion) -> bool:
    """Whether every group is known to be assembled in every frame.

    A quick check (a sum is NaN if a frame is) that is False if a group needs more checks; `_faults` finds the frames that fail.
    """
    for block in model.blocks:
        if block.redundant or block.kind == "general":
            return False  # these need more checks
        x = motion.state.rot[model.angles.classes_of[block.angles[0]][0]] if block.angles else motion.state.slide[block.slides[0]]
        if not cmath.isfinite(np.add.reduce(x, axis=None)):
            return False
    return True


def _placed(model: Model, block: Block, motion: Motion) -> Flags:
    ok = np.ones(motion.frames, bool)
    for g in block.angles:
        ok &= np.isfinite(motion.state.rot[model.angles.classes_of[g][0]])
    for j in block.slides:
        ok &= np.isfinite(motion.state.slide[j])
    return ok


def _out_of_reach(
    compiled: Compiled, block: Block, motion: Motion, bad: Flags, error: float, time: Real, *, underdetermined: bool
) -> Fault:
    """The fault of a group that cannot be assembled at frames ``bad`` of a run over ``time``, with its largest closure error
    ``error`` [m]; ``underdetermined``: it has more than one degree of freedom where its path stopped."""
    model = compiled.model
    remedy = "Change the length of one of its links by more than that"
    reach = [] if block.redundant else _reach(compiled)
    words = f"cannot be assembled{_ranges(motion, bad, reach)}"
    if error == np.inf:
        words += ": its links miss each other, and not at one joint alone."
        remedy = "Change the lengths of several of its links"
    elif error > CLOSURE_LIMIT * model.length_scale:
        words += f": its links miss each other by up to {as_length(error)}."
    elif underdetermined:
        words += ": the group comes to a position with more than one freedom, from which the drive alone does not lead on."
    else:
        words += ": the group reaches a limit of its motion on this branch."
        remedy = "Change the length of one of its links"
    if block.redundant:
        *_, mobility = gruebler(model)
        over = len(model.mechanism.drives) - mobility
        freedoms = "1 degree of freedom" if mobility == 1 else f"{mobility} degrees of freedom"
        if over > 0 and len(model.mechanism.drives) > 1:
            words = words.replace("cannot be assembled", "the drives contradict each other")
            remedy = f"Take {over} of the {len(model.mechanism.drives)} drives away: the mechanism has {freedoms}"
        else:
            words = words.replace("cannot be assembled", "the redundant constraint does not close")
            remedy = "Correct the lengths so that the extra constraint agrees, or leave it out"
            remedy += f": by Gruebler-Kutzbach the mechanism has {freedoms} for its drive" if over > 0 else ""
    if not block.redundant:
        remedy += _within_reach(compiled, motion, bad, time, reach) + _in_other_mode(compiled, block, time)
    return Fault(f"joints.{block.name}", words, f"{remedy}.")


def _in_other_mode(compiled: Compiled, block: Block, time: Real) -> str:
    """The end of a remedy: an assembly mode of another group in which a run over ``time`` can be assembled; "" if there is none."""
    for other, remedy in other_modes(compiled.mechanism, beside=block.name):
        try:
            driven = compile_mechanism(other, compiled.accuracy)
            motion = motion_or_nan(driven, time)
        except MechanismError:
            continue
        if all(_placed(driven.model, each, motion).all() for each in driven.model.blocks):
            return f"{remedy}, in which it runs"
    return ""


def _out_of_slot(compiled: Compiled, motion: Motion, overrun: SlotOverrun) -> Fault:
    """The fault of a pin or slider that would leave its slot, guide or cylinder."""
    joint = next(joint for joint in compiled.mechanism.joints if joint.name == overrun.joint)
    what = {PinSlot: "the pin leaves its slot", Prismatic: "the slider leaves its guide"}.get(type(joint), "it leaves its stroke")
    longer = {PinSlot: "the slot", Prismatic: "the guide"}.get(type(joint), "it")
    reach = _reach(compiled)
    frames = _ranges(motion, overrun.frames, reach)  # empty if the overrun is between two frames
    where = frames if overrun.frames.any() else f" ({at_drive(motion, overrun.time)})"
    far = f"up to {as_length(overrun.beyond)} beyond the end at {as_length(overrun.end)}"
    words = f"{what}{where}: it would go {far}."
    within = _within_reach(compiled, motion, overrun.frames, motion.time, reach)
    return Fault(f"joints.{overrun.joint}", words, f"Give {longer} a greater length{within}.")


def _reach(compiled: Compiled) -> list[tuple[float, float]]:
    """The reachable ranges of the only drive; empty if there are several drives, or if only single positions can be assembled."""
    return reachable_ranges(compiled) if len(compiled.mechanism.drives) == 1 else []


def _ranges(motion: Motion, bad: Flags, reach: Sequence[tuple[float, float]]) -> str:
    """Text of the ranges of the first drive's position at frames ``bad`` (F,), extended to ends of its ``reach`` next to them; ""
    for a structure without drives."""
    if not motion.mechanism.drives:
        return ""
    turns = motion.model.rotary(motion.mechanism.drives[0].joint)
    edges = np.ravel(reach)

    def edge(good: int, wrong: int) -> list[float]:
        """The end of the reach between two frames, if there is one."""
        if not (len(edges) and 0 <= good < len(q)):
            return []
        middle, half = 0.5 * (q[good] + q[wrong]), 0.5 * abs(q[good] - q[wrong])
        near = edges + TURN * np.round((middle - edges) / TURN) if turns else edges
        return [float(x) for x in near[np.abs(near - middle) <= half]][:1]

    shown = partial(as_coordinate, rotary=turns)
    q = motion.drives[0][0]
    ranges = []
    for start, end in runs(bad):
        positions = [*q[start : end + 1].tolist(), *edge(start - 1, start), *edge(end + 1, end)]  # the drive may turn back in it
        low, high = min(positions), max(positions)
        digits = 6 if high - low > 1e-5 * max(abs(low), abs(high)) or high == low else 12
        ranges.append(f"from {shown(low, digits=digits)} to {shown(high, digits=digits)}")
    more = f" and {len(ranges) - 3} more ranges" if len(ranges) > 3 else ""
    return f" for positions of drive {motion.mechanism.drives[0].joint} {', '.join(ranges[:3])}{more}"


def _within_reach(compiled: Compiled, motion: Motion, bad: Flags, time: Real, reach: Sequence[tuple[float, float]]) -> str:
    """The end of a remedy: the first of ``reach``, in which the only drive can be kept.

    With several drives it is the range of the first one in which a run over ``time`` can be assembled, or else the time at which
    the motion could end, before the first of the frames ``bad``. "" if there is none.
    """
    if not compiled.mechanism.drives:
        return ""
    drives = compiled.mechanism.drives
    shown = partial(as_coordinate, rotary=compiled.model.rotary(drives[0].joint), digits=7)
    if len(drives) == 1:
        how = ', as range = "reachable" does' if isinstance(drives[0].law, ConstantSpeed) else ""
        return f", or keep the drive within [{shown(reach[0][0])}, {shown(reach[0][1])}]{how}" if reach else ""
    within = nearest_range(compiled, time)
    if within is not None:
        return f", or keep drive {drives[0].joint} within [{shown(within[0])}, {shown(within[1])}] beside the others"
    end = float(motion.time[max(int(np.argmax(bad)) - 1, 0)])
    return f", or end the motion at {end:.6g} s ({at_drive(motion, end)})" if bad.any() and end > float(np.min(time)) else ""
