"""From a compiled mechanism to its motion: frames, tracks of general groups, and clear words where it cannot go on."""

from __future__ import annotations

import cmath
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechcore.accuracy import DEFAULT, Accuracy
from mechcore.branches.assembly import Assembly, assemble, fitting_statements, other_modes
from mechcore.branches.singular_points import TWO_MODES, Changes, find_changes, needs_span, passages
from mechcore.branches.sketch import at_sketch, sketched_drives
from mechcore.branches.tracking import Course, course_of, way_of
from mechcore.branches.unwrapped import Frames, LinkAngles, UnwrappedAngles, Waypoint, raw_angles, start_pose
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.model import Block, Model, build_model
from mechcore.kinematics.patching import make_patches
from mechcore.kinematics.positions import place_all
from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.closure_errors import greatest_miss
from mechcore.motion.events import SINGULAR, at_drive
from mechcore.motion.motion import Motion
from mechcore.motion.slots import Escape, escapes, has_ends
from mechcore.motion.structure import gruebler, rank_mobility
from mechcore.numerics.frames import keep_freed_memory
from mechcore.spec.mechanism import Mechanism, PinSlot, Prismatic
from mechcore.texts import Text, as_coordinate, as_length

Array = Any
TURN = 2.0 * np.pi
MOST_TURNS = 50_000  # of a drive in one run; of one that slides, that many circumferences of a circle as large as the mechanism


@dataclass(frozen=True, eq=False)
class Compiled:
    """A mechanism ready to run: its model and how it is put together at the start of its drives."""

    model: Model
    assembly: Assembly
    start: tuple[float, ...]  # drive positions for which the assembly was made
    angles: UnwrappedAngles  # of its links, as far as they have been asked for
    changes: Changes | None = None  # where assembly modes meet in the course of the drives' laws
    courses: list[Course] = field(default_factory=list)  # walks that have been made, for further frames on the same way
    accuracy: Accuracy = DEFAULT

    @cached_property
    def near(self) -> float:
        """Positions of the drives below this [rad or m] are within reach of a run, whatever they start from."""
        return TURN * MOST_TURNS * min(1.0, self.model.size) - max((abs(q) for q in self.start), default=0.0)

    @cached_property
    def followed(self) -> bool:
        """Whether groups have to be followed along their course; with gears a turn of the drive need not bring all back."""
        return bool(self.assembly.starts) or (bool(self.model.relations) and any(b.kind in TWO_MODES for b in self.model.blocks))

    @property
    def mechanism(self) -> Mechanism:
        return self.model.mechanism


def compile_mechanism(mechanism: Mechanism, accuracy: Accuracy = DEFAULT) -> Compiled:
    """Compile and assemble a mechanism; ``accuracy``: the dials of all that is solved with it.

    Raises `MechanismError` with every fault that can be seen.
    """
    keep_freed_memory()
    model = build_model(mechanism)
    if model.free:
        n, left = len(model.free), max(len(model.order.free), 1)
        where = ", ".join(model.free[:8]) + (" ..." if n > 8 else "")
        freedoms, drives = ("a freedom", "a drive") if left == 1 else (f"{left} freedoms", f"{left} drives")
        to = "one" if left == 1 else str(left)
        raise MechanismError(
            Fault(
                "drives",
                f"the mechanism has {freedoms} that no drive takes: nothing decides the motion at {where}.",
                f"Add {drives}, such as drive = {{ speed = 0 }}, at {to} of these pairs, or fix a link.",
            )
        )
    start = tuple(float(d.law(0.0)[0]) for d in mechanism.drives)
    assembly = _assembled(model, start, accuracy)
    changes = find_changes(model, assembly.modes, assembly.starts)
    spins = raw_angles(model, start, assembly.state, ())
    angles = UnwrappedAngles(model, start_pose(model, spins), Waypoint(-np.inf, np.array(start), spins, assembly.starts))
    return Compiled(model=model, assembly=assembly, start=start, angles=angles, changes=changes, accuracy=accuracy)


def _assembled(model: Model, start: tuple[float, ...], accuracy: Accuracy) -> Assembly:
    """How a mechanism is put together at the start. Where its sketch is drawn at other positions of the drives, it is put together
    there and followed to the start; a rough sketch of the start need not be one that can be assembled."""
    drawn = sketched_drives(model, start)
    if drawn is None:
        return assemble(model, start)
    mechanism = model.mechanism
    faults: Sequence[Fault] = ()
    for other in (start, *_round_the_other_way(model, drawn, start)):
        try:
            led = compile_mechanism(at_sketch(mechanism, drawn, other), accuracy)
            motion = solve_motion(led, np.array([0.0, 1.0]))
        except MechanismError as error:
            faults = faults or error.faults
            continue
        x, y, angle = range(3)
        poses = {link.name: motion.pose(link.name)[1] for link in mechanism.links if link.name != mechanism.frame}
        sketch = {name: (float(p[x]), float(p[y]), float(p[angle])) for name, p in poses.items()}
        return assemble(replace(model, mechanism=replace(mechanism, sketch=sketch)), start)
    led_by = zip(mechanism.drives, drawn, strict=True)
    places = ", ".join(f"{d.pair} = {as_coordinate(q, rotary=model.rotary(d.pair), digits=4)}" for d, q in led_by)
    why = f"the sketch is drawn at {places}, and the mechanism cannot be led from there to the start: it"
    remedy = f"Sketch the mechanism where its drives start{fitting_statements(model, start)}"
    said = [(f.path, Text.of(f.message).source, Text.of(f.remedy).source) for f in faults]
    raise MechanismError([Fault(path, f"{why} {message}", f"{remedy}, or: {other}") for path, message, other in said])


def _round_the_other_way(model: Model, drawn: Sequence[float], start: Sequence[float]) -> list[tuple[float, ...]]:
    """The start a turn on, so that the only drive comes to it from the other side, where that drive turns."""
    if len(start) != 1 or not model.rotary(model.mechanism.drives[0].pair):
        return []
    return [(start[0] - float(np.copysign(TURN, start[0] - drawn[0])),)]


def default_times(mechanism: Mechanism, frames: int = 360, cycles: float = 1.0) -> Array:
    """Frame times (frames + 1,) [s], uniform over whole cycles, see `Mechanism.cycle`; both ends included. One frame where a cycle
    takes no time: statics."""
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

    ``drives`` replaces the laws by given positions, speeds and accelerations (F,) of driven pairs. Where the mechanism cannot be
    assembled, ``strict`` raises `MechanismError` naming the pair, the range and the gap; else those frames are NaN.
    """
    model = compiled.model
    time = np.asarray(time, float)
    if time.ndim == 0:
        time = time[None]
    values: list[tuple[Array, Array, Array]] = []
    for d in model.mechanism.drives:
        if drives is None and isinstance(d.law, ConstantSpeed):  # rates that do not change cost nothing as single numbers
            turned = d.law.speed * time
            values.append((turned + d.law.start if d.law.start else turned, float(d.law.speed), 0.0))
            continue
        given = drives[d.pair] if drives is not None and d.pair in drives else d.law(time)
        q, v, a = (np.asarray(x, float) for x in given)
        if not q.shape == v.shape == a.shape == time.shape:
            q, v, a = (np.broadcast_to(x, time.shape) for x in (q, v, a))
        values.append((q, v, a))
    positions = [v[0] for v in values]
    if strict and drives is None and len(time):
        _check_way(compiled, positions)
    constants = compiled.assembly.constants
    solved, parameter, course = model, None, None
    starts: Mapping[str, Array] | None = None
    modes: Sequence[Array] = compiled.assembly.modes
    patches, passed = None, []
    changes = compiled.changes
    still = drives is None and not model.mechanism.led
    if still:
        starts = {name: np.broadcast_to(x, (len(time), *np.shape(x))) for name, x in compiled.assembly.starts.items()}
    elif compiled.followed and drives is not None and len(positions) > 1 and len(time):
        starts = compiled.angles.way.starts(model, compiled.assembly, time, np.stack(positions, axis=-1))
    elif compiled.followed and len(time):
        course = _course(compiled, time, positions, given=drives is not None)
        solved, changes = course.model, course.changes
        parameter = time if course.by_time else positions[0]
        starts = course.starts(parameter)
    elif changes is None and drives is None and len(time) and needs_span(model):
        changes = find_changes(model, modes, compiled.assembly.starts, span=float(np.max(time)))
    if changes is not None and changes.found:
        law_time, scale = _law_time(compiled, changes, time, values, given=drives is not None)
        if law_time is not None:
            modes = [m * changes.signs(i, law_time) for i, m in enumerate(modes)]
            own = None if course is None else partial(_own_starts, course)
            patches = make_patches(solved, changes, compiled.assembly.modes, law_time, scale, constants, own)
            if drives is None and changes.by_drive:
                passed = passages(changes, model.mechanism.drives[0].law, time, positions[0])
            elif drives is None:
                passed = changes.within(float(np.min(law_time)), float(np.max(law_time)))
    state = place_all(solved, positions, modes, starts, patches, constants, compiled.accuracy.position)
    led = compiled if compiled.accuracy.differentiation == "exact" else replace(compiled, accuracy=DEFAULT)  # at any times
    again = None if drives is not None else lambda t: solve_motion(led, t, strict=False)
    in_time = course.by_time if course is not None else len(positions) > 1 or not (changes is None or changes.by_drive)
    frames = positions, state, (*model.designs, len(time))
    angles = led.angles.still(frames) if still else _angles(led, frames, time, in_time=drives is None and in_time)
    motion = Motion(model, time, values, state, angles, patches, passed, again, compiled.accuracy)
    if strict and (patches or not _all_placed(model, motion)):
        faults = _faults(compiled, motion, course, parameter, time)
        if faults:
            raise MechanismError(faults)
    if strict and course is not None and course.gaps and drives is None and len(time):
        _check_gaps_on(compiled, course, time, parameter)
    if strict and drives is None and changes is not None and changes.gaps:
        _check_gaps(compiled, changes, time)
    if strict and len(time) and has_ends(model.mechanism):
        out = [_out_of_slot(compiled, motion, escape) for escape in escapes(motion)]
        if out:
            raise MechanismError(out)
    if strict and still and len(time) and (model.mechanism.loads or model.mechanism.effects):
        _check_statics(motion)
    return motion


def _angles(compiled: Compiled, frames: Frames, time: Array, *, in_time: bool) -> LinkAngles:
    """Angles of the links at frames; ``in_time``: the laws lead there, and only the time tells where they are."""
    drives, unwrapped = compiled.mechanism.drives, compiled.angles

    def placed(time: Array, given: Array | None = None) -> Frames:
        rest = np.zeros(len(time))
        led = None if given is None else {d.pair: (q, rest, rest) for d, q in zip(drives, given.T, strict=True)}
        motion = solve_motion(compiled, time, drives=led, strict=False)
        return [d[0] for d in motion.drives], motion.state, motion.shape

    if in_time:
        return unwrapped.along(frames, time, lambda x: placed(x[:, 0]), tuple(d.law for d in drives))
    if len(drives) > 1:
        return unwrapped.through(frames, time, lambda x: placed(x[:, 0], x[:, 1:]))
    return unwrapped.along(frames, frames[0][0], lambda x: placed(np.zeros(len(x)), x))


def _check_statics(motion: Motion) -> None:
    """What stands still under forces has to be held by its joints and drives."""
    worst = float(motion.condition[0])
    if rank_mobility(motion) if not motion.mechanism.drives else not worst <= SINGULAR:
        why = f"nothing moves, but its joints do not hold it here against every load (condition number {worst:.2g})."
        raise MechanismError(Fault("drives", why, "Add a pair or a drive that holds it, or let it stand in another position."))


def _check_way(compiled: Compiled, positions: Sequence[Array]) -> None:
    """Drives that go on for so many turns that nobody would wait for all the change points and angles on their way."""
    near = compiled.near
    for q in positions:
        if not (-near < q.item(0) < near and -near < q.item(-1) < near):
            break
    else:
        return
    model = compiled.model
    for drive, start, q in zip(model.mechanism.drives, compiled.start, positions, strict=True):
        way = max(abs(float(q[0]) - start), abs(float(q[-1]) - start))
        rotary = model.rotary(drive.pair)
        turns = way / (TURN if rotary else TURN * model.size)
        if turns > MOST_TURNS * (1.0 + 1e-9):
            far = f"{turns:.6g} turns" if rotary else f"{as_length(way)}, {way / model.size:.6g} times the size of the mechanism"
            most = f"{MOST_TURNS:,} turns" if rotary else as_length(TURN * MOST_TURNS * model.size)
            why = f"it goes {far} from its start; motions are followed over {most} at most."
            raise MechanismError(Fault(f"pairs.{drive.pair}.drive", why, "Run fewer cycles, or give it a shorter travel."))


def _check_gaps(compiled: Compiled, changes: Changes, time: Array) -> None:
    """No stretch between the frames, however short, may be one that cannot be assembled."""
    for gap in changes.gaps_within(float(np.min(time)), float(np.max(time))):
        motion = solve_motion(compiled, np.linspace(gap.start, gap.end, 101), strict=False)
        faults = _faults(compiled, motion, None, None, time)
        if faults:
            raise MechanismError(faults)


def _course(compiled: Compiled, time: Array, positions: Sequence[Array], *, given: bool) -> Course:
    """The walk that the frames need: one that has been made already, if it covers them."""
    for course in compiled.courses:
        if not (course.by_time and given):
            wanted = time if course.by_time else positions[0]
            one = len(positions) == 1 and not course.by_time
            if one and given and course.tells(wanted):
                return course
            if (course.by_time or (one and not course.track.singular)) and bool(np.all(course.reached(wanted))):
                return course
    course = course_of(compiled.model, compiled.assembly, compiled.start, time, positions, given=given)
    compiled.courses[:] = [course, *compiled.courses[:3]]
    return course


def reached(compiled: Compiled, q: Array) -> Array:
    """Whether a motion goes as far as positions (n,) of the only drive, which have been solved: beyond the limits of groups that
    are followed Newton's method may have found other branches. True everywhere where none are followed."""
    for course in compiled.courses:
        if not course.by_time and course.tells(q):
            return course.reached(q)
    return np.ones(np.shape(q), bool)


def _own_starts(course: Course, law_time: Array) -> dict[str, Array]:
    """Newton starts at times of the laws that lead along a walk."""
    return course.starts(law_time if course.by_time else law_time + course.start)


def _check_gaps_on(compiled: Compiled, course: Course, time: Array, parameter: Array) -> None:
    """No stretch of a walk between the frames, however short, may be one that cannot be assembled."""
    low, high = float(np.min(parameter)), float(np.max(parameter))
    if not course.by_time:
        low, high, _ = way_of(compiled.mechanism.drives[0].law, float(np.min(time)), float(np.max(time)))
    for start, end, _ in course.gaps:
        period = course.period
        shift = 0.0 if period is None else period * np.ceil((low - end) / period)
        if start + shift >= high or end + shift <= low:
            continue
        inside = np.linspace(start + shift, end + shift, 101)
        if course.by_time:
            motion = solve_motion(compiled, inside, strict=False)
        else:
            pair = compiled.mechanism.drives[0].pair
            given = {pair: (inside, np.ones_like(inside), np.zeros_like(inside))}
            motion = solve_motion(compiled, np.zeros(len(inside)), drives=given, strict=False)
        faults = _faults(compiled, motion, course, inside, time)
        if faults:
            raise MechanismError(faults)


def _law_time(
    compiled: Compiled, changes: Changes, time: Array, values: Sequence[tuple[Array, Array, Array]], *, given: bool
) -> tuple[Array | None, tuple[Array, Array]]:
    """Where the frames are on the way along which changes are known, and its first two derivatives by time.

    None where the frames' drive positions are given and that way is the laws' time.
    """
    if changes.by_drive:
        q, v, a = values[0]
        return q - compiled.start[0], (v, a)
    return (None, (1.0, 0.0)) if given else (time, (1.0, 0.0))


def _faults(compiled: Compiled, motion: Motion, course: Course | None, parameter: Array | None, time: Array) -> list[Fault]:
    """What keeps frames of a run over ``time`` from being assembled: the first group in solving order that fails, per range of the
    drive."""
    model = compiled.model
    faults: list[Fault] = []
    failed = np.zeros(motion.frames, bool)
    followed = set() if course is None else {b.name for b in course.model.blocks if b.kind == "general"}
    for block in model.blocks:
        if block.redundant or motion.patches:  # where a branch was interpolated, too, the contours have to close
            miss = np.zeros(motion.frames)
            for c in block.contours:
                miss = np.maximum(miss, np.abs(motion.contours[c].total()))
            bad = ~(miss <= max(1e-9, 10.0 * compiled.accuracy.position) * model.size) & ~failed
            worst = float(np.fmax.reduce(np.where(bad, miss, 0.0), initial=0.0))
        else:
            bad = ~_placed(model, block, motion) & ~failed
            if block.name in followed and course is not None and parameter is not None:
                bad |= ~course.reached(parameter) & ~failed
            worst = greatest_miss(compiled.assembly, block, motion, bad) if bad.any() else 0.0
        if bad.any():
            loose = course is not None and block.name in course.track.loose
            faults.append(_out_of_reach(compiled, block, motion, bad, worst, time, loose=loose))
            failed |= bad
    return faults


def _all_placed(model: Model, motion: Motion) -> bool:
    """Whether every group is assembled in every frame; a quick look (sums are NaN if any frame is), `_faults` says where not."""
    for block in model.blocks:
        if block.redundant or block.kind == "general":
            return False  # these have more to check than that they are there
        x = motion.state.rot[model.angles.spins_of[block.angles[0]][0]] if block.angles else motion.state.slide[block.slides[0]]
        if not cmath.isfinite(np.add.reduce(x, axis=None)):
            return False
    return True


def _placed(model: Model, block: Block, motion: Motion) -> Array:
    ok = np.ones(motion.frames, bool)
    for g in block.angles:
        ok &= np.isfinite(motion.state.rot[model.angles.spins_of[g][0]])
    for j in block.slides:
        ok &= np.isfinite(motion.state.slide[j])
    return ok


def _out_of_reach(compiled: Compiled, block: Block, motion: Motion, bad: Array, miss: float, time: Array, *, loose: bool) -> Fault:
    """Words for a group that cannot be put together at some frames of a run over ``time``, its links missing each other by
    ``miss`` [m] at the most."""
    model = compiled.model
    remedy = "Change the length of one of its links by more than that"
    words = f"cannot be assembled{_ranges(motion, bad)}"
    if miss == np.inf:
        words += ": its links miss each other, and not at one joint alone."
        remedy = "Change the lengths of several of its links"
    elif miss > 0:
        words += f": its links miss each other by up to {as_length(miss)}."
    elif loose:
        words += ": the group comes to a position with more than one freedom, from which the drive alone does not lead on."
    else:
        words += ": the group reaches a limit of its motion on this branch."
        remedy = "Change the length of one of its links"
    if block.redundant:
        *_, mobility = gruebler(model)
        over = len(model.mechanism.drives) - mobility
        if over > 0 and len(model.mechanism.drives) > 1:
            words = words.replace("cannot be assembled", "the drives contradict each other")
            freedoms = "1 freedom" if mobility == 1 else f"{mobility} freedoms"
            remedy = f"Take {over} of the {len(model.mechanism.drives)} drives away: the mechanism has {freedoms}"
        else:
            words = words.replace("cannot be assembled", "the redundant constraint does not close")
            remedy = "Correct the lengths so that the extra constraint agrees, or leave it out"
    if not block.redundant:
        remedy += _within_reach(compiled, motion, bad, time) + _in_other_mode(compiled, block, time)
    return Fault(f"pairs.{block.name}", words, f"{remedy}.")


def _in_other_mode(compiled: Compiled, block: Block, time: Array) -> str:
    """The rest of a remedy: an assembly mode of another group in which a run over ``time`` can be assembled, if there is one."""
    for other, remedy in other_modes(compiled.mechanism, beside=block.name):
        try:
            led = compile_mechanism(other, compiled.accuracy)
            motion = solve_motion(led, time, strict=False)
        except MechanismError:
            continue
        if all(_placed(led.model, each, motion).all() for each in led.model.blocks):
            return f"{remedy}, in which it runs"
    return ""


def _out_of_slot(compiled: Compiled, motion: Motion, escape: Escape) -> Fault:
    """Words for a pin or slider that would leave its slot, guide or cylinder."""
    joint = next(pair for pair in compiled.mechanism.pairs if pair.name == escape.joint)
    what = {PinSlot: "the pin leaves its slot", Prismatic: "the slider leaves its guide"}.get(type(joint), "it leaves its stroke")
    longer = {PinSlot: "the slot", Prismatic: "the guide"}.get(type(joint), "it")
    frames = _ranges(motion, escape.frames)  # none where it is between two of them
    where = frames if escape.frames.any() else f" ({at_drive(motion, escape.time)})"
    far = f"up to {as_length(escape.beyond)} beyond the end at {as_length(escape.end)}"
    words = f"{what}{where}: it would go {far}."
    within = _within_reach(compiled, motion, escape.frames, motion.time)
    return Fault(f"pairs.{escape.joint}", words, f"Give {longer} a greater length{within}.")


def _ranges(motion: Motion, bad: Array) -> str:
    """Positions of the first drive at frames (F,), in words; none of a structure without drives."""
    if not motion.mechanism.drives:
        return ""
    shown = partial(as_coordinate, rotary=motion.model.rotary(motion.mechanism.drives[0].pair))
    q = motion.drives[0][0]
    ranges = []
    for start, end in _runs(bad):
        way = q[start : end + 1]  # the drive may turn back in it
        low, high = float(way.min()), float(way.max())
        digits = 6 if high - low > 1e-5 * max(abs(low), abs(high)) or high == low else 12
        ranges.append(f"from {shown(low, digits=digits)} to {shown(high, digits=digits)}")
    more = f" and {len(ranges) - 3} more ranges" if len(ranges) > 3 else ""
    return f" for positions of drive {motion.mechanism.drives[0].pair} {', '.join(ranges[:3])}{more}"


def _within_reach(compiled: Compiled, motion: Motion, bad: Array, time: Array) -> str:
    """The rest of a remedy: the range of the drive around its start in which a run over ``time`` can be assembled, where there is
    one; beside other drives perhaps the time until which it can, before the first of the frames ``bad``."""
    if not compiled.mechanism.drives:
        return ""
    from mechcore.motion.reach import range_beside, reachable_ranges  # here: only failures need it, and it needs this module

    drives = compiled.mechanism.drives
    shown = partial(as_coordinate, rotary=compiled.model.rotary(drives[0].pair), digits=7)
    if len(drives) == 1:
        reach = reachable_ranges(compiled)  # none where the mechanism fits together in single positions only
        how = ', as range = "reachable" does' if isinstance(drives[0].law, ConstantSpeed) else ""
        return f", or keep the drive within [{shown(reach[0][0])}, {shown(reach[0][1])}]{how}" if reach else ""
    within = range_beside(compiled, time)
    if within is not None:
        return f", or keep drive {drives[0].pair} within [{shown(within[0])}, {shown(within[1])}] beside the others"
    end = float(motion.time[max(int(np.argmax(bad)) - 1, 0)])
    return f", or end the motion at {end:.6g} s ({at_drive(motion, end)})" if bad.any() and end > float(np.min(time)) else ""


def _runs(flags: Array) -> list[tuple[int, int]]:
    """First and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
