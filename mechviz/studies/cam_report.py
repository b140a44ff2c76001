"""Report of ``mechviz cams``: limits, forces, stress, least spring and drawn lift of each cam; with --size the least base circle,
the best offset and the least roller of a disc cam for stated limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Real
from mechcore.cams.closures import roller_range
from mechcore.cams.followers import Flat, Knife, Roller, Translating
from mechcore.cams.limits import CamLimits, Requirement, find_limits
from mechcore.cams.placement.plane import PlacedCam
from mechcore.cams.placement.spatial import PlacedSpatial
from mechcore.cams.sizing import best_offset, least_base, outer_flank
from mechcore.cams.synthesis import simplified_offset_error
from mechcore.constants import TURN
from mechcore.errors import MechanismError
from mechcore.forces.cam_events import lost_ranges
from mechcore.forces.cam_rating import AnyCam, contact_force, contact_stress, drawn_lift, joint_of, least_springs, placed_cams
from mechcore.records import dataclass
from mechcore.spec.mechanism import CamDrawn, CamJoint
from mechcore.texts import Text, UnitSystem, as_angle, as_coordinate, as_force, as_length, as_pressure, as_quantity
from mechviz.scene.units import Units

if TYPE_CHECKING:
    from mechcore.forces.kinetostatics import Forces
    from mechcore.motion.motion import Motion

NOISE = 1e-9  # relative: a pull below this fraction of the largest contact force, or an excess over a limit by it, is rounding

LAW_POINTS = 7201  # of a turn at which the second derivative of a law is compared


@dataclass(frozen=True)
class CamFact:
    """A line of the report on a cam: ``what`` it is about (such as "undercut") and its text."""

    cam: str
    what: str
    text: Text
    passed: bool | None = None  # whether the limit is kept; None: there is no limit
    stated: bool = False  # whether the scene states the limit

    @property
    def failed(self) -> bool:
        """Whether a limit is violated."""
        return self.passed is False


ReportRow = tuple[str, str, bool | None, bool]  # what, words, passed, stated


def cam_facts(motion: Motion, forces: Forces | None, *, margin: float | None = None) -> list[CamFact]:
    """Facts on all cams over a run. ``margin``: contact force [N] that the least spring has to keep; None: the scene's."""
    facts = size_facts(motion)
    for cam in placed_cams(motion):
        rows = _facts(motion, forces, cam, joint_of(motion, cam), margin)
        facts += [CamFact(cam.name, what, Text(words), passed, stated) for what, words, passed, stated in rows]
    return facts


def size_facts(motion: Motion) -> list[CamFact]:
    """Facts on the sizes that the scene leaves to be found (least base circle, best offset, least roller)."""
    return [
        CamFact(cam.name, what, Text(words)) for cam in placed_cams(motion) for what, words in _least(joint_of(motion, cam), cam)
    ]


def _least(joint: CamJoint, cam: AnyCam) -> Iterator[tuple[str, str]]:
    if isinstance(cam, PlacedCam) and cam.decides is not None:
        yield "base circle", f"{as_length(cam.base, 6)}, the least for its limits; decided by: {cam.decides}"
    for what, value in joint.sized:
        if what == "offset":
            yield what, f"{as_length(value, 6)}, with which the base circle is least"
        elif isinstance(joint.face, Roller) and joint.rating is not None and joint.rating.limit is not None:
            limit = f"a Hertz pressure of {_pressure(joint.rating.limit)}"
            yield what, f"{as_length(joint.face.radius, 6)}, the least for {limit}; decided at {_place(cam, value)}"


def law_facts(motion: Motion) -> list[CamFact]:
    """Facts on all cams that follow from their laws alone and do not depend on the run."""
    rows = [(cam.name, row) for cam in placed_cams(motion) for row in _limits(cam)]
    return size_facts(motion) + [CamFact(name, what, Text(words), passed, stated) for name, (what, words, passed, stated) in rows]


def cam_lines(motion: Motion, facts: list[CamFact], units: UnitSystem) -> list[str]:
    """A heading for each cam and its facts below it, as lines of text in the units of a scene."""
    lines: list[str] = []
    for cam in placed_cams(motion):
        lines += ["", Text(f"cam {cam.name}: {_kind(joint_of(motion, cam), cam)}", units)]
        lines += [f"  {fact.what:<18} {fact.text.in_units(units)}" for fact in facts if fact.cam == cam.name]
    return lines[1:]


def _kind(joint: CamJoint, cam: AnyCam) -> str:
    kind = joint.spatial.kind if joint.spatial is not None else "inverse" if joint.inverse else "wedge" if joint.bed else "disc"
    face = type(joint.face).__name__.lower()
    size = getattr(joint.face, "radius", None)
    face = {"arc": "mushroom", "flat": "flat face"}.get(face, face) + (f" of {as_length(size)}" if size else "")
    moves = "translating" if cam.arm == 0.0 else "oscillating"
    return f"{kind}, {moves} follower with a {face}, closure by {joint.closure}"


def _facts(motion: Motion, forces: Forces | None, cam: AnyCam, joint: CamJoint, margin: float | None) -> Iterator[ReportRow]:
    force = None if forces is None else contact_force(forces, cam)
    rows = cam.rows(motion)  # one face is enough: each face of a yoke meets the whole profile in a turn
    x = cam.argument(motion)
    travel = float(np.nanmax(rows.lift) - np.nanmin(rows.lift))
    steep = np.abs(rows.pressure_angle)
    by_law = list(_limits(cam))
    exact = any(what == "pressure angle" for what, *_ in by_law)
    at = np.nanmin(x) + np.linspace(0.0, min(np.ptp(x), TURN), LAW_POINTS) if exact and cam.bed is None else x
    steepest = _second_derivative(cam, float(np.nanmax(np.abs(cam.law(at)[2]))))
    yield "lift", f"{as_coordinate(travel, rotary=cam.arm != 0.0)}, largest s'' {steepest}", None, False
    yield from by_law
    if np.isfinite(steep).any() and not exact:  # a given profile has no law: the largest angle at the frames
        k = int(np.nanargmax(steep))
        words = f"up to {as_angle(steep[k], 5)} at {_place(cam, x[k])}"
        yield _judged("pressure angle", words, float(steep[k]), cam.pressure_limit, _degrees)
    if isinstance(cam, PlacedCam) and cam.given is not None:
        corner = np.abs(rows.radius) <= NOISE * cam.given.size
        sharp = np.where(corner, 0.0, np.where(rows.radius > 0.0, rows.radius, np.inf))
        if np.isfinite(sharp).any():
            k = int(np.argmin(sharp))
            yield _curvature(cam, float(sharp[k]), f" at {_place(cam, x[k])}")
        if np.isfinite(rows.eccentricity).any():
            yield from _face(cam, float(np.nanmin(rows.eccentricity)), float(np.nanmax(rows.eccentricity)))
    if force is not None and forces is not None and np.isfinite(force).any():
        yield from _loaded(forces, cam, joint, force, margin)
    if joint.drawn is not None:
        yield "graphical method", _drawn_words(cam, joint.drawn, drawn_lift(cam, joint.drawn).largest), None, False


def _loaded(forces: Forces, cam: AnyCam, joint: CamJoint, force: Real, margin: float | None) -> Iterator[ReportRow]:
    """Rows on the contact force ``force`` (F,) [N], the Hertz pressure and the least spring. ``margin`` [N] as in `cam_facts`."""
    rating, x = joint.rating, cam.argument(forces.motion)
    low, high = int(np.nanargmin(force)), int(np.nanargmax(force))
    need = margin if margin is not None else None if rating is None else rating.margin
    words = f"{as_force(force[low], 5)} at {_place(cam, x[low])} to {as_force(force[high], 5)} at {_place(cam, x[high])}"
    if cam.form_closed:
        yield "contact force", words, None, False
    elif need is not None:
        passed = bool(force[low] >= need)
        stated = rating is not None and rating.margin is not None and not force[low] >= rating.margin
        yield "contact force", f"{words}; margin {as_force(need, 5)}: {_verdict(passed)}", passed, stated
    elif force[low] < -NOISE * np.nanmax(np.abs(force)):
        yield "contact force", f"{words}; contact is lost: {_verdict(False)}", False, False
    else:
        yield "contact force", words, None, False
    if rating is not None and rating.width is not None:
        stress = contact_stress(forces, cam, rating)
        k = int(np.nanargmax(stress.pressure))
        half = f"strip of {as_length(2.0 * stress.half_width[k], 4)} by {as_length(rating.width, 4)}"
        words = f"up to {_pressure(stress.pressure[k])} at {_place(cam, x[k])}, {half}"
        yield _judged("Hertz pressure", words, float(stress.pressure[k]), rating.limit, _pressure)
    if not cam.form_closed and need is not None:
        yield from (("least spring", words, None, False) for words in _springs(forces, cam, need))


def _limits(cam: AnyCam) -> Iterator[ReportRow]:
    """Rows on the limits of a cam that is made from its law: pressure angle, curvature, undercut and the face of a flat follower.
    For any plane cam also the ranges where undercut makes the follower miss its law."""
    if isinstance(cam, PlacedSpatial):
        flanks = cam.limits()
        steepest, passed = flanks[0].pressure, not any(each.undercut for each in flanks)
        words = f"up to {as_angle(steepest.value, 5)} over the roller's length, at {_place(cam, steepest.angle)}"
        yield _judged("pressure angle", words, steepest.value, cam.pressure_limit, _degrees)
        words = f"{_verdict(passed)}; rollers up to {as_length(cam.greatest_roller(flanks), 5)}"
        yield "undercut", words, passed, False
    if isinstance(cam, PlacedCam):
        for first, last, at, deviation in lost_ranges(cam):
            far = as_coordinate(abs(deviation), rotary=cam.arm != 0.0, digits=4)
            words = f"the follower misses its law, by up to {far} at {_place(cam, at)}"
            yield "undercut", f"{_verdict(False)}; from {_place(cam, first)} to {_place(cam, last)} {words}", False, False
    if not isinstance(cam, PlacedCam) or cam.given is not None:
        return
    limits, *others = (cam.limits(profile) for profile in cam.profiles)
    other = "outer flank" if cam.mate is None else "second cam"
    worst = max(limits.rise.value, limits.fall.value)
    ends = [
        f"{word} up to {as_angle(reached.value if reached.value > NOISE else 0.0, 5)} at {_place(cam, reached.angle)}"
        for word, reached in (("rise", limits.rise), ("return", limits.fall))
        if reached.value >= -NOISE  # else all angles are of the other sign
    ]
    for each in others if cam.mate is not None else ():  # the flanks of a groove have one pressure angle
        steepest = max(each.rise, each.fall, key=lambda reached: reached.value)
        ends.append(f"{other} up to {as_angle(steepest.value, 5)} at {_place(cam, steepest.angle)}")
        worst = max(worst, steepest.value)
    yield _judged("pressure angle", ", ".join(ends), worst, cam.pressure_limit, _degrees)
    if cam.curvature_limit is not None:
        least, whose = min((_least_convex(each), of) for each, of in zip((limits, *others), ("", f" ({other})"), strict=False))
        yield _curvature(cam, least, whose)
    passed = not any(each.undercut for each in (limits, *others))
    radii = [*_radius_words(cam, limits), *(f"{other}: {said}" for each in others if (said := ", ".join(_radius_words(cam, each))))]
    yield "undercut", "; ".join([_verdict(passed), *radii]), passed, False
    if limits.distance_left is not None and limits.distance_right is not None:
        yield from _face(cam, limits.distance_left.value, limits.distance_right.value)


def _curvature(cam: PlacedCam, least: float, at: str = "") -> ReportRow:
    """Row on the least radius [m] of the convex profile, compared with its limit if there is one."""
    words, limit = f"least radius of the convex profile {as_length(least, 5)}{at}", cam.curvature_limit
    if limit is None:
        return "curvature", words, None, False
    passed = least >= limit * (1.0 - NOISE)
    return "curvature", f"{words}; limit {as_length(limit, 5)}: {_verdict(passed)}", passed, True


def _face(cam: PlacedCam, least: float, most: float) -> Iterator[ReportRow]:
    """Row on the travel of the contact along a flat face, from its ``least`` to its ``most`` eccentricity [m], compared with the
    ends of the face."""
    face, left, right = cam.face, max(-least, 0.0), max(most, 0.0)
    assert isinstance(face, Flat)
    words = f"the contact goes {as_length(left, 5)} to the left and {as_length(right, 5)} to the right"
    if min(face.left, face.right) == np.inf:
        yield "face", words, None, False
        return
    passed = left <= face.left * (1.0 + NOISE) and right <= face.right * (1.0 + NOISE)
    ends = f"face {as_length(face.left, 5)} and {as_length(face.right, 5)}"
    yield "face", f"{words}; {ends}: {_verdict(passed)}", passed, True


def _least_convex(limits: CamLimits) -> float:
    """The least radius [m] of the convex part of a profile: 0 where the profile is undercut, infinite where all of it is
    concave."""
    return 0.0 if limits.undercut else np.inf if limits.convex is None else limits.convex.value


def _radius_words(cam: PlacedCam, limits: CamLimits) -> Iterator[str]:
    if limits.convex is not None:
        yield f"least radius {as_length(limits.convex.value, 5)} at {_place(cam, limits.convex.angle)}"
    if limits.greatest_roller is not None and np.isfinite(limits.greatest_roller.value):
        yield f"radii of the follower up to {as_length(limits.greatest_roller.value, 5)}"


def _verdict(passed: bool) -> str:
    return "pass" if passed else "FAIL"


def _judged(what: str, words: str, value: float, limit: float | None, shown: Callable[[float], str]) -> ReportRow:
    """Row on a value, compared with the limit that the scene states for it, if it states one."""
    if limit is None:
        return what, words, None, False
    passed = bool(value <= limit * (1.0 + NOISE))
    return what, f"{words}; limit {shown(limit)}: {_verdict(passed)}", passed, True


def _degrees(value: float) -> str:
    return as_angle(value, 4)


def _pressure(value: float) -> str:
    return as_pressure(value, 5)


def _second_derivative(cam: AnyCam, value: float) -> str:
    """A second derivative of the lift with respect to the angle [rad] or displacement [m] of the cam, with its unit, as text."""
    if cam.bed is not None:
        return as_quantity(value, "1/m" if cam.arm == 0.0 else "rad/m^2", 5)
    return f"{as_length(value, 5)}/rad²" if cam.arm == 0.0 else f"{value:.5g} 1/rad"


def _place(cam: AnyCam, x: float) -> str:
    rotary = cam.bed is None
    return as_coordinate(x % (2.0 * np.pi) if rotary else x, rotary=rotary, digits=5)


def _springs(forces: Forces, cam: AnyCam, need: float) -> Iterator[str]:
    """The least springs that keep a contact force of at least ``need`` [N], in words."""
    x = cam.argument(forces.motion)
    try:
        springs = least_springs(forces, cam, need)
    except MechanismError as error:
        yield "; ".join(Text.of(f.message).source for f in error.faults)
        return
    if not springs:
        yield "no spring between two points presses this follower, and others are not sized"
    for spring in springs:
        offers = []
        if spring.stiffness is not None:
            offers.append(f"{as_quantity(spring.stiffness, 'stiffness', 5)} with its free length")
        if spring.free_length is not None:
            offers.append(f"a free length of {as_length(spring.free_length, 5)} with its stiffness")
        words = " or ".join(offers) if offers else "none: this spring is slack, or pulls, where it is needed"
        yield f"{spring.spring}: {words}, to keep {as_force(need, 5)} (decided at {_place(cam, x[spring.frames[0]])})"


def _drawn_words(cam: AnyCam, drawn: CamDrawn, largest: Real) -> str:
    s, v, a = 100.0 * largest
    read = f", read to {as_coordinate(drawn.resolution, rotary=cam.arm != 0.0)}" if drawn.resolution else ""
    return (
        f"steps of {as_angle(drawn.step)}, {drawn.lines}s{read}: off by {s:.4g} % of the largest lift, "
        f"{v:.4g} % of the velocity, {a:.4g} % of the acceleration"
    )


def drawn_lines(motion: Motion, units: Units, drawn: CamDrawn | None = None) -> list[str]:
    """The tables of the graphical method, as lines of text: for each cam that has a drawing, the drawn lift and its derivatives
    with respect to the cam's angle [rad], each with its error, at every point of the drawing.

    ``drawn``: settings of the drawing for all cams; None: those of the scene.
    """
    lines: list[str] = []
    for cam in placed_cams(motion):
        how = drawn or joint_of(motion, cam).drawn
        if how is None:
            continue
        try:
            construction = drawn_lift(cam, how)
        except MechanismError as error:
            lines += ["", *(f"cam {cam.name}: {f.in_units(units).message}" for f in error.faults)]
            continue
        unit, factor = units.display_unit("m" if cam.arm == 0.0 else "rad")
        along, across = units.display_unit("rad")
        lines += ["", Text(f"cam {cam.name}, graphical method: {_drawn_words(cam, how, construction.largest)}", units)]
        lines += [Text(f"  {words}", units) for words in _simplified_words(cam)]
        lines.append(f"  {'cam':>7} {'s':>10} {'error':>10} {'ds':>10} {'error':>10} {'dds':>10} {'error':>10}")
        lines.append(
            f"  {along:>7} {unit:>10} {unit:>10} {unit + '/rad':>10} {unit + '/rad':>10} {unit + '/rad²':>10} {unit + '/rad²':>10}"
        )
        for k, angle in enumerate(construction.angle):
            cells = (f"{factor * v:10.4f}" for i in range(3) for v in (construction.drawn[i, k], construction.error[i, k]))
            lines.append(f"  {across * angle:7.{units.decimals('rad') + 1}f} " + " ".join(cells))
    return lines[1:]


def _simplified_words(cam: AnyCam) -> Iterator[str]:
    """Error of the simplified profile for an offset knife follower, which leaves out the phase atan(m/h), in words."""
    if not isinstance(cam, PlacedCam) or cam.given is not None or cam.offset == 0.0 or not isinstance(cam.face, Knife):
        return
    error = simplified_offset_error(cam.cam.law, cam.offset, np.radians(np.arange(0.0, 360.0, 0.25)))
    deviation = f"misses its lift by up to {as_length(error.largest, 4)} at {as_angle(error.angle, 4)}"
    yield f"laid off at the cam's angle, without the phase atan(m/h) of the offset m, the profile {deviation}"


USUAL_ANGLES = {True: math.radians(30.0), False: math.radians(45.0)}  # pressure angles [rad]; True: translating follower


def size_lines(motion: Motion, forces: Forces | None, units: UnitSystem, want: Requirement) -> list[str]:
    """Present sizes of every disc cam with a lift, and the least that keep the limits of ``want`` or else of the scene, as lines of
    text."""
    lines: list[str] = []
    for cam in placed_cams(motion):
        if isinstance(cam, PlacedCam) and not cam.cam.wedge and (cam.given is None or cam.intended is not None):
            own = _required(cam, want)
            lines += ["", Text(f"cam {cam.name}: {_limit_words(cam, own, want)}", units)]
            lines += [f"  {what:<12} {Text(words).in_units(units)}" for what, words in _sizes(cam, motion, forces, own)]
    return lines[1:]


def _required(cam: PlacedCam, want: Requirement) -> Requirement:
    angle = want.pressure_rise or cam.pressure_limit
    radius = want.radius or cam.curvature_limit
    if angle is None and radius is None:
        angle = USUAL_ANGLES[cam.arm == 0.0]
    return Requirement(radius=radius, pressure_rise=angle, pressure_fall=angle)


def _limit_words(cam: PlacedCam, own: Requirement, want: Requirement) -> str:
    stated = (want.pressure_rise or cam.pressure_limit or want.radius or cam.curvature_limit) is not None
    words = [] if own.pressure_rise is None else [f"pressure angles up to {as_angle(own.pressure_rise, 4)}"]
    words += [] if own.radius is None else [f"radii of the convex profile from {as_length(own.radius, 4)} on"]
    return " and ".join(words) + ("" if stated else " (usual; the scene states no limit)")


def _sizes(cam: PlacedCam, motion: Motion, forces: Forces | None, want: Requirement) -> Iterator[tuple[str, str]]:
    made = cam.cam if cam.intended is None else cam.intended
    follower, turn = made.follower, made.turn
    lift = made.law.raised(-follower.base_coordinate(cam.base))
    hub = joint_of(motion, cam).hub
    try:
        least = least_base(lift, follower, want, turn, hub, beside=cam.other_profiles)
        yield "base circle", f"{as_length(cam.base, 6)} now, least {as_length(least.base, 6)}; decided by: {least.decides}"
    except MechanismError as error:
        yield "base circle", "; ".join(Text.of(f"{f.message} {f.remedy}").source for f in error.faults)
    guide = follower.guide
    if isinstance(guide, Translating) and not isinstance(follower.face, Flat) and cam.mate is None:
        try:
            best = best_offset(lift, follower.face, want, turn, hub, beside=outer_flank if cam.groove else None)
            words = (
                f"{as_length(guide.offset)} now, best {as_length(best.offset, 6)} with a base circle of {as_length(best.base, 6)}"
            )
            yield "offset", f"{words}; decided by: {best.decides}"
        except MechanismError as error:
            yield "offset", "; ".join(Text.of(f"{f.message} {f.remedy}").source for f in error.faults)
    if isinstance(follower.face, Roller):
        yield "roller", _roller_words(cam, motion, forces, want)


def _roller_words(cam: PlacedCam, motion: Motion, forces: Forces | None, want: Requirement) -> str:
    """Radii of rollers that fit the present pitch curve, in words. The base circle grows by as much as the roller shrinks."""
    made = cam.cam if cam.intended is None else cam.intended
    profiles = (made, *(cam.other_profiles(made) if cam.mate is None else ()))  # the second cam has a roller of its own
    radii = [reached.value for each in profiles if (reached := find_limits(each).greatest_roller) is not None]
    most = max(min(radii, default=math.inf) - (want.radius or 0.0), 0.0)
    rating = joint_of(motion, cam).rating
    words = f"{as_length(made.follower.radius)} now, on the same pitch curve"
    upper = "" if math.isinf(most) else f"up to {as_length(most, 6)}"
    if forces is None or rating is None or rating.width is None or rating.limit is None or cam.form_closed:
        why = "no least one: the scene states no width and limit of the Hertz pressure"
        return f"{words} {upper or 'of any size'}; {why if not cam.form_closed else 'no least one: two flanks'}"
    force = contact_force(forces, cam)
    known = np.isfinite(force)
    low, high = roller_range(
        force[known], cam.at(motion).pitch_radius[known], rating.width, rating.limit, rating.modulus, rating.poisson
    )
    limit = f"a Hertz pressure of {_pressure(rating.limit)}"
    if low > min(high, most):
        return f"{words} {upper}; none keeps to {limit}: enlarge the base circle"
    top = min(high, most)
    return f"{words} {'' if math.isinf(top) else f'up to {as_length(top, 6)}, '}least {as_length(low, 6)} for {limit}"
