"""A drawing machine for a motion of a pen: two levers on a shaft of cams lead the pen by rods or slides, a third lever lifts it.

Lengths follow from the size of the drawing; those of the linkage that leads the pen are in `pen_linkages`. The arms of the levers
on the cams are shorter than the levers, by one of `RATIOS`. The shaft lies below the pivots, at the distance that the cams require:
they are as small as the limit of the pressure angle, and rollers without undercut, allow.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence

import numpy as np
import shapely

from mechcore.arrays import Complex, Real
from mechcore.cams import Cam, Follower, Oscillating, Roller
from mechcore.errors import Fault, MechanismError
from mechcore.laws.boundary_conditions import measured_table
from mechcore.laws.catalogue import rise as rise_of
from mechcore.laws.curve import MotionCurve
from mechcore.laws.program import Segment, program
from mechcore.laws.segment_laws import Dwell, NormalisedLaw
from mechcore.records import dataclass
from mechcore.texts import as_angle, as_length
from mechviz.automata.pen_linkages import PIVOTS, PenLinkage, Rods
from mechviz.automata.pen_motion import PEN_DOWN, PenMotion, csv_table, place_words, plan_motion, quoted
from mechviz.runs import run_scene
from mechviz.scene.folder import SceneFolder
from mechviz.scene.scene import Scene, loads

RATIOS = (4.0, 6.0, 9.0, 13.0)  # of lever to arm; the least one is used with which the cams are no larger than the drawing
_ROLLER = 0.02  # radius of the rollers, over the size of the drawing
_SPARE = 1.2  # least radius of curvature of the pitch curve, over the roller's
_LIFT = 0.02  # travel of the third roller, over the size of the drawing
_LIFTER = 0.35  # length of the third lever, over the size of the drawing
_LIFTS = math.radians(4.0)  # angle of the shaft for a lift of the pen [rad]
_FRONT = 0.3  # of the plane of the hand crank, over the size of the drawing
_MOST_LIFTING = 0.3  # largest part of the turn for lifting and lowering
_GROWTH = 1.04  # ratio of successive trial sizes of cams
_LARGEST = 40.0  # cams, over the size of the drawing
_TRIES = 4  # trial machines, each with a smaller share of the error than the one before
_TEACHES = "Two cams on one shaft move two levers, %s; a third lifts it between strokes."
_CHECKED = 4  # frames for each row of the tables where the line is compared with its strokes


@dataclass(frozen=True, eq=False)
class DrawingMachine:
    """A drawing machine and what is known of it.

    ``scene`` with its tables, None of a motion without levers; ``motion`` of the pen; ``error`` [m]: largest distance between the
    line that the machine draws and the strokes, in both directions; ``ratio`` of the levers: travel of the pen over that of the
    rollers, by which errors of the cams are enlarged, too. Of the three cams: ``pressure_angles`` [rad], largest ``radii`` of the
    pitch curves [m], ``least_radii`` [m]: least convex radii of curvature of the profiles.
    """

    scene: Scene | None
    motion: PenMotion
    error: float
    ratio: float = 1.0
    pressure_angles: tuple[float, ...] = ()
    radii: tuple[float, ...] = ()
    least_radii: tuple[float, ...] = ()


def design_drawing_machine(
    strokes: Sequence[Complex],
    error: float,
    *,
    title: str,
    name: str = "writer",
    speed: float = math.pi / 30.0,
    pressure_limit: float = math.radians(40.0),
    linkage: type[PenLinkage] = Rods,
    levers: bool = True,
    progress: Callable[[str], object] = lambda _: None,
) -> DrawingMachine:
    """The machine that draws strokes (n,) [m] about the origin, and misses them by at most ``error`` [m] when it is run.

    ``speed`` of the shaft [rad/s]; ``linkage`` leads the pen; without ``levers`` only the motion of the pen is planned.
    ``progress`` gets the name of each stage. Raises `MechanismError` where the error cannot be reached.
    """
    every = np.concatenate(list(strokes))
    size = max(float(np.ptp(every.real)), float(np.ptp(every.imag)))
    rise = min(_LIFTS, _MOST_LIFTING * 2.0 * math.pi / (2.0 * len(strokes)))
    ratio, roller = 1.0 / RATIOS[0], _ROLLER * size

    def cam_size(speed: float, acceleration: float) -> float:
        return max(ratio * speed / math.tan(pressure_limit), math.sqrt(_SPARE * roller * ratio * acceleration))

    share = 0.95
    for _ in range(_TRIES):
        progress("planning the pen's motion")
        motion = plan_motion(strokes, share * error, rise, cam_size, stated=error)
        if not levers:
            return DrawingMachine(None, motion, motion.error)
        progress("sizing the cams")
        for lever_ratio in RATIOS:
            machine = _Machine.sized(motion, linkage(size), lever_ratio, pressure_limit)
            if max(machine.radii) <= size:
                break
        scene = machine.scene(title, name, speed, pressure_limit)
        progress("running the machine")
        reached = drawn_error(scene, motion, [stroke + machine.linkage.sheet for stroke in strokes], linkage.pen)
        if reached <= error:
            return DrawingMachine(
                scene, motion, reached, machine.ratio, machine.pressure_angles, machine.radii, machine.least_radii
            )
        share *= 0.9 * error / reached
    why = f"the machine misses the drawing by {as_length(reached, 3)}, not by at most {as_length(error, 3)}."
    raise MechanismError(Fault("error", why, "Allow a larger error."))


def drawn_error(scene: Scene, motion: PenMotion, strokes: Sequence[Complex], link: str) -> float:
    """The largest distance [m] between strokes (n,) on the sheet and the line that the pen ``P`` of a scene's link draws for each,
    in both directions."""
    frames = _CHECKED * len(motion.places)
    moved = run_scene(scene.changed({("run", "frames"): frames})).motion
    at = moved.point(link, "P") @ np.array([1.0, 1.0j])
    angles = 2.0 * np.pi * np.arange(len(at)) / frames
    worst = 0.0
    for stroke, (begin, end) in zip(strokes, motion.strokes, strict=True):
        line = at[(angles >= begin) & (angles <= end)]
        for points, other in ((line, stroke), (stroke, line)):
            path = shapely.LineString(np.column_stack([other.real, other.imag]))
            worst = max(worst, float(shapely.distance(shapely.points(points.real, points.imag), path).max()))
    return worst


@dataclass(frozen=True, eq=False)
class _LeverLaw:
    """The law of a lever's lift over the shaft's angle [rad], the length of its arm [m], and the side of the line to the axis on
    which the arm is."""

    lift: MotionCurve
    arm: float
    side: str


@dataclass(frozen=True, eq=False)
class _Lever:
    """A lever with a roller on its cam: its pivot [m], direction [rad] of its arm at zero lift, radius of the base circle [m]."""

    pivot: complex
    law: _LeverLaw
    heading: float
    base: float
    cam: Cam

    @property
    def extremes(self) -> tuple[float, float, float]:
        """Largest pressure angle [rad], least convex radius of the profile [m], largest radius of the pitch curve [m]."""
        pressure, least_radius, radius = _cam_extremes(self.cam)
        return pressure, least_radius - self.cam.follower.radius, radius


def _cam_extremes(cam: Cam) -> tuple[float, float, float]:
    """Largest pressure angle [rad], least convex radius of the pitch curve [m], its largest distance from the axis [m]."""
    synthesis = cam.at(np.linspace(0.0, 2.0 * np.pi, _CHECKED * max(len(cam.law.pieces), 720)))
    rho = synthesis.pitch_radius
    convex = rho[rho > 0.0]
    return float(np.abs(synthesis.pressure_angle).max()), float(convex.min(initial=np.inf)), float(np.abs(synthesis.pitch).max())


def _cam(wanted: _LeverLaw, middle: float, roller: float) -> tuple[Cam, float] | None:
    """The cam whose roller is ``middle`` [m] from the axis at half the lift, with the arm perpendicular to that radius, and the
    distance [m] of its pivot from the axis; None where the arm does not reach."""
    lift, arm = wanted.lift, wanted.arm
    apart = math.hypot(middle, arm)
    top = float(lift(np.linspace(0.0, 2.0 * np.pi, 721), 0)[0].max())
    start = math.acos(arm / apart) - 0.5 * top
    if not (start > 0.05 and start + top < math.pi - 0.05):
        return None
    guide = Oscillating(complex(apart), arm, 1 if wanted.side == "right" else -1)
    return Cam(lift.raised(start), Follower(guide, Roller(roller))), apart


def _least_distance(wanted: Sequence[_LeverLaw], roller: float, limit: float, low: float, high: float) -> float:
    """The least distance [m] of the rollers from the axis, at half their lifts, at which all cams keep to the limit of the pressure
    angle without undercut. Raises `MechanismError` where there is none up to ``high``."""
    middle = low
    while middle < high:
        made = [_cam(lever, middle, roller) for lever in wanted]
        if all(size is not None and _fits(size[0], roller, limit) for size in made):
            return middle
        middle *= _GROWTH
    why = f"no cam up to a radius of {as_length(high, 3)} keeps to a pressure angle of {as_angle(limit, 3)} without undercut."
    raise MechanismError(Fault("pressure angle", why, "Allow a larger angle or a larger error, or draw less in one turn."))


def _fits(cam: Cam, roller: float, limit: float) -> bool:
    pressure, least_radius, _ = _cam_extremes(cam)
    return pressure <= limit and least_radius >= _SPARE * roller


@dataclass(frozen=True, eq=False)
class _Machine:
    """The layout of the machine: the linkage that leads the pen, the shaft, and the left, right and lifting levers."""

    linkage: PenLinkage
    ratio: float  # of the longer lever to its arm
    axis: complex
    levers: tuple[_Lever, _Lever, _Lever]
    starts: tuple[float, float]  # directions of the two output arms at zero lift
    lift: float  # of the third lever [rad]
    lift_segments: list[tuple[float, float | None]]
    tables: tuple[Real, Real]  # lifts of the two levers [deg] at even steps of the shaft

    @classmethod
    def sized(cls, motion: PenMotion, linkage: PenLinkage, ratio: float, limit: float) -> _Machine:
        size, pivots, turned = linkage.size, linkage.pivots, linkage.angles(motion.places)
        tables = (np.degrees(turned[0].max() - turned[0]), np.degrees(turned[1] - turned[1].min()))
        rounded = (np.round(tables[0], 7), np.round(tables[1], 7))
        angles = np.linspace(0.0, 2.0 * np.pi, len(motion.places) + 1)
        lifts = [measured_table(angles, np.radians(np.append(t, t[0])), 0.0, True)[0] for t in rounded]
        arm, roller = min(linkage.levers) / ratio, _ROLLER * size
        low, high, lifter = 0.3 * size, _LARGEST * size, _LIFTER * size
        lift = _LIFT * size / lifter
        segments = [(over, to if to is None else lift * to) for over, to in motion.lifts]
        wanted = [_LeverLaw(law, arm, side) for law, side in zip(lifts, ("right", "left"), strict=True)]
        third = _LeverLaw(_lift_law(segments), lifter, "left")
        middle, own = _least_distance(wanted, roller, limit, low, high), _least_distance([third], roller, limit, low, high)
        cams = [_cam(wanted[0], middle, roller), _cam(wanted[1], middle, roller), _cam(third, own, roller)]
        (left, apart), (right, _), (up, below) = (f for f in cams if f is not None)
        axis = -1j * math.sqrt(apart**2 - (PIVOTS * size) ** 2)
        levers = []
        for cam, pivot, lever_of in zip((left, right, up), (*pivots, axis - 1j * below), (*wanted, third), strict=True):
            start = float(cam.law.pieces[0].at(0.0, 0)[0] - lever_of.lift.pieces[0].at(0.0, 0)[0])
            heading = cmath.phase(axis - pivot) + (start if lever_of.side == "left" else -start)
            base = abs(abs(axis - pivot) - lever_of.arm * cmath.exp(1j * start)) - roller
            levers.append(_Lever(pivot, lever_of, heading, base, cam))
        starts = (float(turned[0].max()), float(turned[1].min()))
        return cls(
            linkage,
            ratio * max(linkage.levers) / min(linkage.levers),
            axis,
            (levers[0], levers[1], levers[2]),
            starts,
            lift,
            segments,
            rounded,
        )

    @property
    def pressure_angles(self) -> tuple[float, ...]:
        return tuple(lever.extremes[0] for lever in self.levers)

    @property
    def least_radii(self) -> tuple[float, ...]:
        return tuple(lever.extremes[1] for lever in self.levers)

    @property
    def radii(self) -> tuple[float, ...]:
        return tuple(lever.extremes[2] for lever in self.levers)

    def scene(self, title: str, name: str, speed: float, limit: float) -> Scene:
        """The scene, with the tables of its cams in its folder."""
        size, (left, right, up) = self.linkage.size, self.levers
        out = [place_words(complex(length)) for length in self.linkage.levers]
        sides = zip(("left", "right"), self.tables, strict=True)
        files = {f"{name}-{side}.csv": csv_table("angle [deg],lift [deg]", 360.0, table) for side, table in sides}
        wire = up.pivot + 2.0 * up.law.arm * cmath.exp(1j * (up.heading + 0.5 * math.pi))
        grip = 0.5 * abs(self.axis - left.pivot)  # clear of the levers' pins
        starts = (*self.starts, 0.0)
        heads = [cmath.rect(lever.law.arm, lever.heading - start) for lever, start in zip(self.levers, starts, strict=True)]
        frames = 2 * len(self.tables[0])  # accelerations between the rows of the tables are seen
        speed_text = quoted(f"{30.0 / math.pi * speed:.12g} rpm")
        pivots = ", ".join(f"{pin} = {place_words(lever.pivot)}" for pin, lever in zip("ABC", self.levers, strict=True))
        lines = [
            f"title = {quoted(title)}",
            f"learning_goal = {quoted(_TEACHES % self.linkage.words)}",
            'units = { length = "mm", angle = "deg" }',
            "marks = false",
            "",
            "[run]",
            f"frames = {frames}",
            "",
            "[links]",
            f"frame = {{ points = {{ O = {place_words(self.axis)}, {pivots}{self.linkage.frame_points()} }} }}",
            "cams = { points = { O = [0, 0] } }",
            f"crank = {{ points = {{ O = [0, 0], H = {place_words(complex(grip))} }}, plane = {1e3 * _FRONT * size:.6g} }}",
            f'"left lever" = {{ points = {{ A = [0, 0], D = {out[0]}, R = {place_words(heads[0])} }} }}',
            f'"right lever" = {{ points = {{ B = [0, 0], E = {out[1]}, R = {place_words(heads[1])} }} }}',
            *self.linkage.links(),
            f"lifter = {{ points = {{ C = [0, 0], R = {place_words(heads[2])}, W = {place_words(wire - up.pivot)} }} }}",
            "",
            "[joints]",
            f'O = {{ revolute = ["frame", "cams"], drive = {{ speed = {speed_text} }} }}',
            'H = { weld = ["cams", "crank"], at = "O" }',
            'A = { revolute = ["frame", "left lever"] }',
            'B = { revolute = ["frame", "right lever"] }',
            'C = { revolute = ["frame", "lifter"] }',
            *self.linkage.joints,
            "",
            "[pens.P]",
            f'point = "{self.linkage.pen}.P"',
            'joint = "C"',
            f"at_most = {math.degrees(PEN_DOWN * self.lift):.6g}",
        ]
        for cam, link, lever, guide in (("X", "left lever", left, "A"), ("Y", "right lever", right, "B"), ("Z", "lifter", up, "C")):
            lines += [
                "",
                f"[joints.{cam}]",
                f'cam = ["cams", {quoted(link)}]',
                f'follower = {{ roller = {1e3 * _ROLLER * size:.6g}, guide = "{guide}", point = "R", side = "{lever.law.side}" }}',
                "",
                f"[joints.{cam}.profile]",
                f"base = {1e3 * lever.base:.9g}",
                f"pressure_limit = {math.degrees(limit):.6g}",
            ]
            if lever is up:
                steps = (
                    f"    {{ over = {math.degrees(over):.12g} }}," if to is None
                    else f"    {{ over = {math.degrees(over):.12g}, to = {math.degrees(to):.6g} }},"
                    for over, to in self.lift_segments
                )  # fmt: skip
                lines += ["lift = [", *steps, "]"]
            else:
                file = f"{name}-{link.partition(' ')[0]}.csv"
                lines += [f'lift = [{{ over = 360, law = {{ position = {{ file = "{file}", periodic = true }} }} }}]']
        return loads("\n".join(lines) + "\n", name, SceneFolder(contents=files))


def _lift_law(segments: Sequence[tuple[float, float | None]]) -> MotionCurve:
    law = NormalisedLaw(rise_of("cycloidal"))
    parts = [Segment(over, None, Dwell()) if to is None else Segment(over, (to,), law) for over, to in segments]
    return program(parts, (0.0,), repeats=True)
