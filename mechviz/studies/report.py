"""Reports of ``mechviz check``, ``mechviz plan`` and statics: structure, reachable range, plan and reactions, as lines of text."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mechcore.branches.assembly import all_modes
from mechcore.branches.modes import stated_modes
from mechcore.cams.followers import Flat
from mechcore.cams.placement.plane import PlacedCam
from mechcore.effects.plan import Plan
from mechcore.forces.cam_events import cam_events
from mechcore.forces.cam_rating import placed_cams
from mechcore.forces.equilibrium import solution_order
from mechcore.forces.friction.events import friction_events
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.forces.load_events import belt_events, belt_grip, idle_table, load_events
from mechcore.forces.section_forces import section_forces
from mechcore.laws.curve import MotionCurve
from mechcore.laws.factors import ORDER_NAMES, VELOCITY_JUMP, jumps
from mechcore.laws.program import CLOCK, CurveOverMaster
from mechcore.laws.timed import ConstantSpeed, Free, Law, Piecewise
from mechcore.motion.at_once import agreement, indeterminate
from mechcore.motion.compiled import Compiled
from mechcore.motion.events import coordinate_range, overshoots, strokes
from mechcore.motion.metrics import grashof
from mechcore.motion.motion import Motion
from mechcore.motion.reach import reachable_ranges
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.motion.structure import Group, groups, gruebler, loop_equations, loop_joints, rank_mobility, redundant_joints
from mechcore.spec.clearance import auxiliary_names, journals_of
from mechcore.spec.loads import BeltTension, Factor, GasPressure, GasSpring, Spring
from mechcore.spec.mechanism import CamJoint, Mechanism, PinSlot, Planar
from mechcore.texts import Text
from mechviz.quantities.items import joints_of
from mechviz.scene.faults import in_scene_words
from mechviz.scene.units import Units
from mechviz.studies.cam_report import cam_facts, cam_lines, law_facts, size_facts
from mechviz.studies.designs.goals import check_goal

WIDE_MASS = 10.0  # sizes of the mechanism: no radius of gyration is larger, that of a flywheel neither

if TYPE_CHECKING:
    from mechviz.scene.scene import Scene


@in_scene_words
def check_lines(scene: Scene, *, equations: bool = False, modes: bool = False) -> list[str]:
    """Report on mobility, groups, loops, reachable range and limits of a scene. Raises `MechanismError` where the scene cannot be
    assembled over its run.

    ``equations`` adds the loop equations with their numbers at the start, ``modes`` all assembly modes of every group there.
    """
    check_goal(scene)
    compiled = compile_mechanism(scene.mechanism)
    model = compiled.model
    loose = journals_of(scene.mechanism)
    free = [d.joint for d in scene.mechanism.drives if isinstance(d.law, Free)]
    times = np.zeros(1) if free else default_times(scene.mechanism, scene.frames, scene.cycles)  # free: only the start is known
    motion = solve_motion(compiled, times)
    n, p5, p4, w = gruebler(model)
    rank = rank_mobility(motion)
    drives = len(scene.mechanism.drives)
    lines = [
        scene.title,
        "",
        f"mobility   W = 3·{n} - 2·{p5} - {p4} = {w} (Gruebler-Kutzbach); {rank} by the rank of the constraints; "
        f"{_drives_in_words(drives - len(free), free)}",
    ]
    if scene.at_rest:
        span = f"over {scene.cycles * scene.mechanism.cycle:g} s" if scene.mechanism.cycle else "at one instant, time zero"
        lines.append(f"statics    nothing moves: reactions {span}")
    if scene.simulation is not None:
        separable = [f"whether the follower of {cam.joint} stays on it" for cam in scene.simulation.separable_cams]
        moving = [p for p in free if p not in auxiliary_names(scene.mechanism)]
        moved = [f"the motion of {', '.join(moving)}"] if moving else []
        moved += [f"the motion of {p.links[1]}, a free body" for p in scene.mechanism.joints if isinstance(p, Planar)]
        moved += [f"the motion of the journal of {joint} in its bearing" for joint in loose]
        duration, turns = scene.simulation.duration, scene.simulation.steady
        span = f"{duration:g} s" if duration == duration else "one cycle"
        begin = f", from the steady state whose cycle is {turns} turn{'s' * (turns > 1)}" if turns else ""
        lines.append(f"dynamics   forces decide {', '.join(moved + separable)}, for {span}{begin}")
        for s in scene.simulation.stops:
            lines.append(f"           stop {s.name} of {s.joint}, restitution {s.restitution:g}")
        for look in scene.simulation.triggers:
            lines.append(f"           watched: {look.name}{', ends the motion' if look.ends else ''}")
    redundant = redundant_joints(model)
    if redundant:
        lines.append(f"redundant  constraints are left over at {', '.join(redundant)}")
        if 0 < rank > w:
            lines.append("           it moves only because its lengths and angles agree: a little off, and it cannot be assembled")
        lines.append(f"           statics alone does not determine the reactions at {', '.join(indeterminate(motion))}")
    lines.append("groups     in the order in which they are solved")
    lines += [f"  {i}. {g}; {_solved_by(g, free)}" for i, g in enumerate(groups(model), 1)]
    vectors, closing = len(model.loops), sum(r.name not in model.joint_index for r in model.relations)
    others = f": {vectors} closed by joints, {closing} by cams, gears, racks or belts" if closing else ""
    lines.append(f"loops      {vectors + closing} independent{others}")
    lines += [f"  {i}. {' - '.join(joints)}" for i, joints in enumerate(loop_joints(model), 1)]
    lines += _section("masses", list(_wide_masses(scene, model.length_scale)))
    lines += [f"law        {words}" for words in continuity_words(scene.mechanism, scene.units)]
    lines += [f"table      {e.item}: {e.text}" for e in overshoots(scene.mechanism)]
    lines += _modes(compiled)
    ranges = reachable_ranges(compiled) if drives else []
    if drives:
        lines += _reach(compiled, ranges, scene.units)
    lines += _idle(scene, compiled, ranges) if free else _loads(motion, scene.units)
    if not free:
        lines += [*_slots(motion, scene.units), *_outputs(motion, scene)]
    lines.append(
        f"health     loops close to {scene.units.show(float(np.max(motion.closure)), 'length', 2)} {_over(motion.frames)}; "
        f"largest condition number {np.max(motion.condition):.3g}"
    )
    lines += _grashof(compiled, scene.units)
    if motion.singular_points:
        count, first = len(motion.singular_points), motion.singular_points[0].time
        lines.append(f"passes     {count} change or dead point{'s' if count != 1 else ''}, the first at {first:.6g} s")
    decided = [cam.joint for cam in scene.simulation.separable_cams] if scene.simulation is not None else []
    loaded = bool(scene.mechanism.effects or scene.mechanism.loads)
    forces = solve_forces(motion) if loaded and not free else None
    if forces is not None:
        if "friction" in scene.mechanism.effects:
            lines += _friction(forces, scene.units)
        lines += _contact(forces, scene.units, decided)
        if any(isinstance(load, BeltTension) and load.coefficient for load in scene.mechanism.loads):
            lines += _belts(forces, scene.units)
        lines += _section("inside", list(_inside_links(forces, scene.units)))
    cams = [joint for joint in scene.mechanism.joints if isinstance(joint, CamJoint)]
    if cams:
        known = law_facts(motion) if free or decided else cam_facts(motion, forces)  # under forces the rest follows from a run
        lines += _section("sizes", [f"{f.cam}: {f.what} {f.text.in_units(scene.units)}" for f in size_facts(motion)])
        lines += _section("limits", [f"{f.cam}: {f.what} {f.text.in_units(scene.units)}" for f in known if f.failed])
        if any(joint.rating is not None or joint.drawn is not None for joint in cams) and not free:
            lines += ["", *cam_lines(motion, known, scene.units)]
    if free or decided:
        lines += _section("a run", [f"tells {words}" for words in _reported_by_runs(scene.mechanism, motion)])
    if modes:
        lines += _all_modes(compiled, scene.units)
    if equations:
        lines += ["", *solution_order(motion.model), "", *loop_equations(motion), "", _at_once(motion)]
    return lines


def _at_once(motion: Motion) -> str:
    """A line that compares the rates by groups with those of all equations at once."""
    check = agreement(motion)
    words = f"all {check.equations} equations of joints and drives at once, without groups, for {check.unknowns} rates of links"
    if check.velocity is None or check.acceleration is None:
        return f"{words}: they decide them at no frame"
    return (
        f"{words}: the same velocities, to {check.velocity:.1e} of the largest, and accelerations, to {check.acceleration:.1e}, "
        f"at {check.frames} frames"
    )


def _wide_masses(scene: Scene, size: float) -> Iterator[str]:
    """Moments of inertia that no link of a mechanism of this size [m] has with its mass: their unit is probably another one."""
    for link in scene.mechanism.links:
        radius = float(np.sqrt(link.inertia / link.mass)) if link.mass > 0.0 else 0.0
        if radius > WIDE_MASS * size and "inertia" in scene.mechanism.effects and link.name != scene.mechanism.frame:
            yield (
                f"{link.name}: its radius of gyration is {scene.units.show(radius, 'length', 4)}, {radius / size:.3g} times "
                f"the size of the mechanism: is its moment of inertia in {scene.units.symbol('inertia')}?"
            )


def _solved_by(group: Group, free: Collection[str]) -> str:
    if group.solved_by != "drive":
        return group.solved_by
    return "free" if set(free) & set(group.joints) else "driven"


def _friction(forces: Forces, units: Units) -> list[str]:
    """Lines on where friction jams the mechanism or makes it self-locking, and where several states of friction are possible."""
    events = (e.in_units(units) for e in friction_events(forces))
    warned = [e for e in events if e.level == "WARN" or e.text.startswith("self-locking")]
    if not warned:
        return ["friction   no jam and no self-locking over the run"]
    lines = [
        f"{e.item}: jams from {e.time:.6g} s {e.text[5:]}" if e.text.startswith("jams") else f"{e.item}: {e.text}" for e in warned
    ]
    return _section("friction", lines)


def _contact(forces: Forces, units: Units, decided: list[str]) -> list[str]:
    """Lines on where force-closed followers would lose contact with their cams. ``decided``: cams left out, as forces decide
    whether their followers separate."""
    motion = forces.motion
    if not any(isinstance(p, CamJoint) for p in motion.mechanism.joints):
        return []
    pressed = [cam.name for cam in placed_cams(motion) if not cam.form_closed and cam.name not in decided]
    if not pressed:
        return []
    contacts = [e for e in cam_events(motion, forces) if e.item in pressed and e.text.startswith("contact ")]
    said = [e.in_units(units) for e in contacts if e.text.split()[1] in ("lost", "regained")]
    lines = [f"{e.item}: {e.text.replace(' at ', f' at {e.time:.6g} s, ', 1)}" for e in said]
    return _section("contact", lines or ["no follower leaves its cam over the run"])


def _belts(forces: Forces, units: Units) -> list[str]:
    """Lines on the largest force that each belt transmits without slip, and on where belts slip."""
    motion = forces.motion
    loads = [load for load in motion.mechanism.loads if isinstance(load, BeltTension) and load.coefficient]
    most = {load.joint: units.show(belt_grip(motion, load).most, "force", 5) for load in loads}
    lines = [f"{joint} carries up to {force} without slipping (Euler, Eytelwein)" for joint, force in most.items()]
    slips = [f"{e.item}: {e.in_units(units).text}" for e in belt_events(forces)]
    return _section("belt", [*lines, *(slips or ["no belt slips over the run"])])


def _inside_links(forces: Forces, units: Units) -> Iterator[str]:
    """A line for each link with a study of section forces: largest bending moment, its place and time, and its bending stress where
    the link has a cross-section."""
    for study in forces.motion.mechanism.studies.sections:
        section = section_forces(forces, study)
        size = np.abs(section.bending.values)
        if not np.isfinite(size).any():
            continue  # friction jams the mechanism over the whole run
        k = int(np.nanargmax(size))
        words = f"largest bending moment {units.show(section.bending.values[k], 'torque', 5)}"
        place = units.show(section.bending.stations[k], "length", 5)
        stress = "" if section.bending_stress is None else f", bending stress {units.text(section.bending_stress[k], 'Pa')}"
        yield f"{study.link}: {words} at {place} of its axis, at {forces.motion.time[k]:.6g} s{stress}"


def _section(title: str, lines: list[str]) -> list[str]:
    """Lines of a section, the first preceded by its title."""
    return [f"{'' if k else title:<10} {line}" for k, line in enumerate(lines)]


def _over(frames: int) -> str:
    return f"over {frames} frames" if frames != 1 else "at the start"


def _drives_in_words(drives: int, free: list[str]) -> str:
    """Number of drives and of free coordinates, in words."""
    words = [f"{drives} drive{'s' if drives != 1 else ''}"] if drives or not free else []
    if free:
        words.append(f"{len(free)} free coordinate{'s' if len(free) != 1 else ''}")
    return ", ".join(words)


def _grashof(compiled: Compiled, units: Units) -> list[str]:
    return [
        f"four-bar   {'-'.join(loop.joints)}: {loop.type}, Grashof margin {units.show(loop.margin, 'length')}"
        for loop in grashof(compiled.model)
    ]


def _all_modes(compiled: Compiled, units: Units) -> list[str]:
    lines = ["modes      all assembly modes of each group at the start, the groups before it as stated"]
    for name, described in all_modes(compiled.model, compiled.assembly, compiled.start):
        lines.append(f"  {name}: {len(described)}")
        lines += [f"    {text.in_units(units)}{'   <- stated' if here else ''}" for text, here in described]
    return lines


def _modes(compiled: Compiled) -> list[str]:
    said, lines = stated_modes(compiled.model), []
    for block in compiled.model.blocks:
        if block.kind in ("theta_theta", "theta_slide", "arm_slide", "general"):
            words = [
                f"{compiled.mechanism.modes[joint]} (stated{'' if joint == block.name else f' at {joint}'})"
                for joint in said.get(block.name, [])
            ]
            how = ", ".join(words) or ("from the sketch" if compiled.mechanism.sketch else "only one exists")
            lines.append(f"  {block.name}: {how}")
    return ["assembly   mode of each group", *lines] if lines else []


def _outputs(motion: Motion, scene: Scene) -> list[str]:
    """Lines on the stroke or range of motion, and the time ratio, of joints on the frame."""
    lines = []
    for stroke in strokes(motion, scene.cycles):
        kind = "angle" if stroke.rotary else "length"
        size, low, high = (scene.units.show(value, kind, 5) for value in (stroke.length, _plain(stroke.low), _plain(stroke.high)))
        ratio = "" if np.isnan(stroke.time_ratio) else f"; time ratio {stroke.time_ratio:.5g}"
        lines.append(f"{stroke.joint}: {'range' if stroke.rotary else 'stroke'} {size}, {low} to {high}{ratio}")
    return _section("output", lines)


def _loads(motion: Motion, units: Units) -> list[str]:
    """Lines on loads that never act, and springs that are compressed below their solid length."""
    return _section("load", [f"{e.item}: {e.in_units(units).text}" for e in load_events(motion)])


def _idle(scene: Scene, compiled: Compiled, ranges: list[tuple[float, float]]) -> list[str]:
    """Lines on loads whose table lies outside the reachable range of the motion under forces, as far as that is known before a
    run."""
    first = scene.mechanism.drives[0].joint
    duration = scene.simulation.duration if scene.simulation is not None else np.nan
    lines = []
    for load in scene.mechanism.loads:
        factor: Factor | None = getattr(load, "factor", None)
        words = ""
        if factor is not None and factor.of == "time" and np.isfinite(duration):
            words = idle_table(load, False, 0.0, duration)
        elif factor is not None and factor.of == "position" and factor.joint in (None, first) and len(ranges) == 1:
            words = idle_table(load, compiled.model.rotary(first), *ranges[0])
        lines += [f"{load.name}: {Text(words, scene.units)}"] if words else []
    return _section("load", lines)


def _reported_by_runs(mechanism: Mechanism, motion: Motion) -> list[str]:
    """Limits of a scene that only a run under forces can check, in words."""
    limited = []
    given = {cam.name for cam in placed_cams(motion) if isinstance(cam, PlacedCam) and cam.given is not None}
    for joint in mechanism.joints:
        if isinstance(joint, CamJoint):
            rating = joint.rating
            limits = {
                "Hertz pressure": rating is not None and rating.limit is not None,
                "contact force": rating is not None and rating.margin is not None,
            }
            if joint.name in given:  # for other cams these follow from the law
                limits |= {
                    "pressure angle": joint.pressure_limit is not None,
                    "curvature": joint.curvature_limit is not None,
                    "face": isinstance(joint.face, Flat) and min(joint.face.left, joint.face.right) < np.inf,
                }
            limited += [f"whether the {what} at {joint.name} keeps its limit" for what, stated in limits.items() if stated]
    for load in mechanism.loads:
        if isinstance(load, Spring) and load.solid_length is not None:
            limited.append(f"whether {load.name} is squeezed below its solid length")
        elif isinstance(load, GasSpring | GasPressure):
            limited.append(f"whether {load.name} stays within its stroke")
        elif isinstance(load, BeltTension) and load.coefficient:
            limited.append(f"whether the belt {load.joint} slips")
    return limited


def _reach(compiled: Compiled, ranges: list[tuple[float, float]], units: Units) -> list[str]:
    drive = compiled.mechanism.drives[0]
    rotary = compiled.model.rotary(drive.joint)
    kind = "angle" if rotary else "length"
    full = rotary and len(ranges) == 1 and abs(ranges[0][1] - ranges[0][0] - 2.0 * np.pi) < 1e-9
    spans = [f"{units.show(_plain(a), kind, 7)} to {units.show(_plain(b), kind, 7)}" for a, b in ranges]
    what = "free" if isinstance(drive.law, Free) else "drive"
    beside = ", the others at their start" if len(compiled.mechanism.drives) > 1 else ""
    reach = "a full turn" if full else spans[0] if spans else "the start only"
    how = ' (range = "reachable" runs it there and back)' if spans and not full and isinstance(drive.law, ConstantSpeed) else ""
    lines = [f"reach      {what} {drive.joint}: {reach}{beside}{how}"]
    if len(spans) > 1:  # the first range contains the start of the run
        lines.append(
            f"           no way leads from there to {', '.join(spans[1:])}, where the stated modes can be put together, too"
        )
    return lines


def _slots(motion: Motion, units: Units) -> list[str]:
    """Lines on the travel of pins in slots without stated ends: a real slot, as of a Geneva drive, may be shorter."""
    lines = []
    for joint in motion.mechanism.joints:
        if isinstance(joint, PinSlot) and joint.ends is None:
            travel = coordinate_range(motion, joint.name)
            low, high = (units.show(_plain(x), "length", 6) for x in travel)
            lines.append(
                f"slot       {joint.name}: its pin goes from {low} to {high}; the slot has no length, so it never leaves it"
            )
    return lines


def _plain(number: float) -> float:
    """A number, set to zero where its size is at most 1e-12."""
    return number if abs(number) > 1e-12 else 0.0


def plan_lines(plan: Plan) -> list[str]:
    """Computed and skipped stages of a plan with their reasons, as lines of text."""
    width = max(len(s.name) for s in (*plan.computed, *plan.skipped))
    lines = ["computed"]
    lines += [f"  {s.name:<{width}}  {s.why}" for s in plan.computed]
    lines.append("left out")
    lines += [f"  {s.name:<{width}}  {s.why}" for s in plan.skipped]
    return lines


def statics_lines(forces: Forces, units: Units) -> list[str]:
    """Table of the reaction of every joint on its second link and of the effort of every drive, as lines of text. Over several
    frames each row shows the frame where the reaction (or, where this is zero, the effort) is largest."""
    motion = forces.motion
    driven = [drive.joint for drive in motion.mechanism.drives]
    rows: list[tuple[str, ...]] = [("joint", "on", "Fx", "Fy", "force", "couple", "drive")]
    for joint in joints_of(motion):
        reaction = forces.reaction(joint.name)
        effort = forces.effort(joint.name) if joint.name in driven else None
        size = np.hypot(reaction[:, 0], reaction[:, 1])
        largest = int(np.argmax(size if size.any() or effort is None else np.abs(effort)))
        x, y, couple = reaction[largest]
        small = 1e-13 * float(size.max(initial=0.0))
        shown = [units.show(v if abs(v) > small else 0.0, "force") for v in (x, y, size[largest])]
        turn = units.show(couple, "torque")
        drive = "" if effort is None else units.show(effort[largest], "force" if joint.unit == "m" else "torque")
        rows.append((joint.name, joint.links[1], *shown, turn, drive))
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    when = "reactions" if motion.frames == 1 else "reactions, of each joint at the frame where it is largest"
    return [when, *("  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows)]


_MOST_PLACES = 8  # of jumps, listed in one line


def continuity_words(mechanism: Mechanism, units: Units) -> Iterator[str]:
    """A line for each law of several segments, of a drive or a cam: the highest continuous derivative, and where the next one
    jumps."""
    for drive in mechanism.drives:
        curve, kind = _curve(drive.law)
        if curve is not None and len(curve.pieces) > 1:
            yield f"{drive.joint}: {_words(curve, kind, units)}"
    for joint in mechanism.joints:
        if isinstance(joint, CamJoint) and joint.lift is not None:
            yield f"{joint.name}: {_words(joint.lift, 'length' if joint.bed else 'angle', units)}"


def _curve(law: Law) -> tuple[MotionCurve | None, str]:
    """The curve of a drive's law, None where it has no segments, and the kind of its argument: "time" or "angle"."""
    if isinstance(law, CurveOverMaster):
        clock = law.master is CLOCK
        return replace(law.curve, repeats=law.curve.repeats and not clock), "time" if clock else "angle"
    if isinstance(law, Piecewise):
        return MotionCurve.of(law.knots, law.coefficients), "time"
    return None, "time"


def _words(curve: MotionCurve, kind: str, units: Units) -> str:
    steps = [*jumps(curve, (0, 2, 3), ends=False), *jumps(curve, (1,), VELOCITY_JUMP, ends=False)]
    pieces = f"{len(curve.pieces)} pieces, continuous"
    if not steps:
        return f"{pieces} up to the jerk"
    order = min(j.order for j in steps)
    places = [units.show(j.angle, kind, 5) for j in steps if j.order == order]
    more = f" and {len(places) - _MOST_PLACES} more" if len(places) > _MOST_PLACES else ""
    smooth = f"{pieces} up to the {ORDER_NAMES[order - 1]}" if order else f"{len(curve.pieces)} pieces"
    shock = ", infinite jerk" if order == 2 else ", a knock" if order < 2 else ""
    return f"{smooth}; the {ORDER_NAMES[order]} jumps at {', '.join(places[:_MOST_PLACES])}{more}{shock}"
