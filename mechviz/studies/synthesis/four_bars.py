"""Function and motion generation by four-bars, tasks in SI units; motion generation by a slide and a crank, where one point of the
body lies on a line in all positions and the crank guides another point."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.design.burmester import (
    BodyPositions,
    BurmesterCurve,
    bisector,
    burmester_curve,
    burmester_points,
    first_pole,
    fixed_pivots,
    guidance,
    moving_pivots,
    slider_points,
)
from mechcore.design.four_bars import FourBar, acute, from_pins, judge_four_bars, used_range
from mechcore.design.freudenstein import FunctionGenerator, FunctionTask
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechviz.scene.scene import Scene
from mechviz.studies.synthesis.linkages import MM, LinkageSolution, four_bar_scene, once, slider_guide_scene, through

MOST_CHOICES = 12  # largest number of four-bars offered where positions are placed by hand
SWING = np.radians(60.0)  # default rotation of cranks between two positions
MARK_DISTANCE = 0.2  # distance of the mark of a body's direction from its position, relative to the reach of the poses
PIVOT_GRID = 13  # moving pivots along a side of the grid that is tried by default
GRID_REACH = 1.5  # half the side of that grid, relative to the reach of the poses
FARTHEST_PIVOT = 6.0  # largest distance of pivots, relative to the reach
GREATEST_RATIO = 10.0  # largest ratio of longest to shortest link that is offered
CURVE_POINTS = 120  # points of Burmester curves that are paired
MOST_EXAMINED = 400  # pairs without defects that are examined over their range: those with the best transmission at the poses
DIFFERENT_PIVOTS = 0.25  # distance of pivots, relative to the reach, above which two proposals count as different
RANGE_ANGLES = 181  # crank angles between first and last pose at which the transmission angle is examined


def function_solutions(task: FunctionTask, designs: Sequence[FunctionGenerator], frame: float, words: str) -> list[LinkageSolution]:
    """Solutions: function generators, scaled to a ``frame`` length [m]; ``words`` describe the function."""
    out = []
    for k, made in enumerate(designs):
        error, place = made.largest_error(task)
        least = np.nan if np.isnan(error) else made.least_transmission(task)
        bar = made.four_bar().scaled(frame)
        begin = made.input_start + (np.pi if made.crank < 0.0 else 0.0)
        end = begin + task.input_range
        runs = bool(np.isfinite(error))
        drive = once(begin, end) if runs else through(bar, np.array([begin, end]), usable=False)
        scene = four_bar_scene(
            bar, drive, name=f"function-{k + 1}", title=f"Function generator of {words}", traced=False,
            learning_goal=f"The rocker's angle follows {words} of the crank's: exactly at "
            f"{len(made.points)} points or by least squares, "
            "nearly between them. The remainder is the structural error.",
        )  # fmt: skip
        numbers = four_bar_lengths(bar) | {
            "crank at start [deg]": _angle(begin),
            "largest error [deg]": f"{np.degrees(error):.4g}" if runs else "-",
            "at x": f"{place:.4g}",
            "transmission [deg]": f"{np.degrees(least):.1f}" if runs else "-",
            "type": bar.grashof.value,
        }
        defects = made.defects.words(0) or ("" if runs else "does not run through")
        out.append(LinkageSolution(scene, numbers, defects))
    return out


# -- motion generation ------------------------------------------------------------------------------------------------
def dyads(poses: BodyPositions, moving: Sequence[complex], fixed: Sequence[complex], swing: float) -> tuple[Complex, Complex]:
    """Dyads that guide a body through poses: moving pivots (R,) in the body, and fixed pivots (R,).

    ``moving`` and ``fixed``: given pivots, which are completed to dyads, for two or three poses; ``swing``: rotation [rad] of
    cranks between two poses. Without given pivots: dyads of a grid of moving pivots for two or three poses, of points of the
    Burmester curves for four, all dyads for five or more. Raises `MechanismError` where there is none.
    """
    count = len(poses.places)
    if count > 3 and (moving or fixed):
        raise MechanismError(
            Fault(
                "poses", f"with {count} positions pivots cannot be chosen.", "Leave out the pivots, or give two or three positions."
            )
        )
    if count >= 5:
        w, c = burmester_points(poses)
        if len(w) < 2:
            raise MechanismError(
                Fault("poses", "no two cranks lead the body through these positions.", "Move one of them a little.")
            )
        return w, c
    if count == 4:
        return thinned_curves(burmester_curve(poses), poses)
    if count == 3:
        first_pole(poses)
    if count == 2 and not 0.0 < abs(swing) < np.pi:
        raise MechanismError(
            Fault("swing", f"a swing of {np.degrees(swing):g} deg.", "Give more than 0 and less than 180 degrees.")
        )
    if count == 2 and fixed:
        raise MechanismError(Fault("fixed", "with two positions the moving pivots are given.", "Give those, or a third position."))
    if not moving and not fixed:
        side = np.linspace(-GRID_REACH, GRID_REACH, PIVOT_GRID) * poses.reach
        middle = (poses.places.mean() - poses.places[0]) / poses.turns[0]
        moving = list((middle + side + 1j * side[:, None]).ravel())
    w = np.array(list(moving), complex)
    if count == 2:
        lines = [bisector(poses, complex(one)) for one in w]
        both = [
            (one, at + sign * along / (2.0 * np.tan(swing / 2.0)))
            for one, (at, along) in zip(w, lines, strict=True)
            for sign in (1, -1)
        ]
        return np.array([one for one, _ in both]), np.array([at for _, at in both])
    given = np.array(list(fixed), complex)
    return np.concatenate([w, moving_pivots(poses, given)]), np.concatenate([fixed_pivots(poses, w), given])


def thinned_curves(curve: BurmesterCurve, poses: BodyPositions) -> tuple[Complex, Complex]:
    """Up to `CURVE_POINTS` points (moving and fixed pivots) of the Burmester curves at about equal steps, without far ones. Raises
    `MechanismError` where all points are far away."""
    middle = poses.places.mean()
    near = (
        np.isfinite(curve.w)
        & (np.abs(curve.c - middle) < FARTHEST_PIVOT * poses.reach)
        & (np.abs(curve.w) < FARTHEST_PIVOT * poses.reach)
    )
    w, c = curve.w[near], curve.c[near]
    if not len(w):
        raise MechanismError(Fault("poses", "all pivots are far away from these positions.", "Move one of them."))
    step = np.abs(np.diff(w, prepend=w[:1])) + np.abs(np.diff(c, prepend=c[:1]))
    along = np.cumsum(np.minimum(step, 0.2 * poses.reach))
    wanted = np.linspace(0.0, along[-1], CURVE_POINTS)
    chosen = np.unique(np.searchsorted(along, wanted).clip(0, len(w) - 1))
    return w[chosen], c[chosen]


@dataclass(frozen=True, eq=False)
class MotionDesign:
    """A four-bar that guides a body through N poses: crank angles (N,) [rad] and moving pins (2, N) [m] at the poses, the least
    transmission angle between first and last pose [rad] (NaN with defects), defects in words, and ``pivots`` (4,): both moving
    pivots in the body, both fixed pivots [m]."""

    four_bar: FourBar
    theta: Real
    pins: Complex
    transmission: float
    defects: str
    pivots: Complex


def motion_designs(poses: BodyPositions, w: Complex, c: Complex, most: int, *, all_of_them: bool) -> list[MotionDesign]:
    """Four-bars of pairs of dyads (``w``, ``c``: moving and fixed pivots).

    ``all_of_them``: the first ``most`` pairs with their defects, those without defects first. Otherwise up to ``most`` four-bars
    without defects that differ from each other, the best transmission angle first. Raises `MechanismError` where there is none of
    these."""
    guides = guidance(poses, w, c)
    pins = poses.of_points(guides.w)
    crank, rocker = np.abs(pins[:, 0] - guides.c[:, :1])[:, 0], np.abs(pins[:, 1] - guides.c[:, 1:])[:, 0]
    lengths = np.stack([crank, np.abs(guides.w[:, 0] - guides.w[:, 1]), rocker, np.abs(guides.c[:, 0] - guides.c[:, 1])])
    at_poses = acute(pins[:, 0] - pins[:, 1], guides.c[:, 1:] - pins[:, 1]).min(1)
    if all_of_them:
        order = np.lexsort((-at_poses, ~guides.defects.none))[:most]
    else:
        order = np.flatnonzero(guides.defects.none & (lengths.max(0) < GREATEST_RATIO * lengths.min(0)))
        order = order[np.argsort(-at_poses[order])][:MOST_EXAMINED]
    made = []
    for k in order:
        first, second, a, b, place = (complex(z) for z in (*guides.c[k], *pins[k, :, 0], poses.places[0]))
        bar = from_pins(first, second, a, b, place)
        theta = np.angle(pins[k, 0] - guides.c[k, 0])
        defects = guides.defects.words(k)
        least = np.nan
        if not defects:
            theta = crank_angles(bar, theta)
            least = float(bar.transmission(np.linspace(*used_range(theta, bar.crank_turns), RANGE_ANGLES)).min())
        made.append(MotionDesign(bar, theta, pins[k], least, defects, np.concatenate([guides.w[k], guides.c[k]])))
    if all_of_them:
        return made
    kept: list[MotionDesign] = []
    for one in sorted((one for one in made if np.isfinite(one.transmission)), key=lambda one: -one.transmission):
        if len(kept) < most and all(np.abs(one.pivots - other.pivots).max() > DIFFERENT_PIVOTS * poses.reach for other in kept):
            kept.append(one)
    if not kept:
        raise MechanismError(
            Fault("poses", "every four-bar that reaches the positions has a defect of branch, circuit or order.",
                  "Turn the body less between positions, or give pivots of your own to see the defects.")
        )  # fmt: skip
    return kept


def motion_choices(poses: BodyPositions, most: int = MOST_CHOICES) -> list[MotionDesign]:
    """Up to ``most`` four-bars for poses with default settings, those without defects first."""
    designs = motion_designs(poses, *dyads(poses, (), (), SWING), most, all_of_them=len(poses.places) >= 5)
    return sorted(designs, key=lambda made: bool(made.defects))


def pose_marks(poses: BodyPositions) -> dict[str, complex]:
    """Points of the frame [m] that mark poses: P1, P2, ... at the body's positions, Q1, Q2, ... on its x axis."""
    arms = zip(poses.places, poses.places + MARK_DISTANCE * poses.reach * poses.turns, strict=True)
    return {f"{letter}{k}": complex(z) for k, pair in enumerate(arms, 1) for letter, z in zip("PQ", pair, strict=True)}


def four_bar_marks(scene: Scene) -> dict[str, complex]:
    """Points [m] of the fixed link by name, if a scene is a four-bar of this module with a coupler point E; else empty."""
    links = {link.name: link for link in scene.mechanism.links}
    frame = scene.mechanism.frame
    if set(links) != {frame, "crank", "coupler", "rocker"} or "E" not in links["coupler"].points:
        return {}
    return {name: complex(*place) for name, place in links[frame].points.items()}


def poses_in(scene: Scene) -> BodyPositions | None:
    """The poses of a scene from `motion_solutions`; None for any other scene."""
    points = four_bar_marks(scene)
    count = sum(f"P{k}" in points and f"Q{k}" in points for k in range(1, len(points) + 1))
    if count < 2:
        return None
    p, q = (np.array([points.get(f"{letter}{k}", complex(np.nan)) for k in range(1, count + 1)]) for letter in "PQ")
    return BodyPositions(p, np.angle(q - p)) if np.isfinite(p).all() and np.isfinite(q).all() else None


def motion_solutions(poses: BodyPositions, designs: Sequence[MotionDesign]) -> list[LinkageSolution]:
    """Solutions: four-bars that guide a body through poses."""
    count = len(poses.places)
    out = []
    for k, made in enumerate(designs):
        bar = made.four_bar
        scene = four_bar_scene(
            bar, through(bar, made.theta, usable=not made.defects), name=f"motion-{k + 1}", marks=pose_marks(poses),
            title="Four-bar that leads a body through positions",
            learning_goal="The coupler is led through positions: its point E passes P1, P2 "
            "... of the frame, and the x axis of the body "
            "points to Q1, Q2 ...",
        )  # fmt: skip
        pivots = (("A", bar.crank_pivot), ("D", bar.rocker_pivot))
        numbers = {f"{name} [mm]": f"({z.real * MM:.4g}, {z.imag * MM:.4g})" for name, z in pivots} | four_bar_lengths(bar)
        numbers |= {
            "transmission [deg]": "-" if made.defects else f"{np.degrees(made.transmission):.1f}",
            "type": bar.grashof.value,
        }
        if count > 5:  # the positions are not met exactly
            deviation = float(np.abs(bar.positions(made.theta)[2] - poses.places).max())
            numbers |= {"farthest [mm]": f"{deviation * MM:.3g}"}
        out.append(LinkageSolution(scene, numbers, made.defects))
    return out


def crank_angles(bar: FourBar, theta: Real) -> Real:
    """Crank angles (N,) [rad] of poses. If the crank cannot rotate fully, they are shifted by turns so that its range of motion has
    no jump."""
    if bar.crank_turns:
        return theta
    cut = bar.frame_angle + np.pi  # extended: crank in line with the frame, away from D; impassable unless the folded position is
    if abs(bar.frame - bar.crank) < abs(bar.coupler - bar.rocker) and bar.frame + bar.crank <= bar.coupler + bar.rocker:
        cut = bar.frame_angle
    turn = 2.0 * np.pi
    return np.asarray(cut + np.mod(theta - cut, turn) - turn)


def four_bar_lengths(bar: FourBar) -> dict[str, str]:
    """The lengths of a four-bar [mm] as text, by title."""
    return {
        f"{name} [mm]": f"{value * MM:.6g}"
        for name, value in (("frame", bar.frame), ("crank", bar.crank), ("coupler", bar.coupler), ("rocker", bar.rocker))
    }


def _angle(value: float) -> str:
    return f"{np.degrees(np.angle(np.exp(1j * value))):.4g}"


LONG_ROCKER = 1e4  # length of a rocker that approximates a slide, relative to the reach: its pin follows a line to about 1e-4


@dataclass(frozen=True, eq=False)
class SliderGuide:
    """A crank and a slide that guide a body through N poses: the four-bar with a very long rocker that approximates them, crank
    angles (N,) [rad], both pins at the first pose [m], the unit direction of the slide, and the least transmission angle between
    first and last pose [rad] (NaN with defects)."""

    four_bar: FourBar
    theta: Real
    pins: tuple[complex, complex]
    along: complex
    transmission: float
    defects: str


def slider_guides(poses: BodyPositions, w: Complex, c: Complex, most: int) -> list[SliderGuide]:
    """Up to ``most`` guides by one of the cranks (moving pivots ``w`` (R,) in the body, fixed pivots ``c`` (R,)) and one of the
    slides of the poses. They differ from each other; those without defects come first, then the best transmission angle. Raises
    `MechanismError` where no crank fits a slide."""
    points, along = slider_points(poses)
    near = np.abs(points) < FARTHEST_PIVOT * poses.reach
    points, along = (points[near], along[near]) if near.any() else (points, along)
    of, slide = (index.ravel() for index in np.meshgrid(np.arange(len(w)), np.arange(len(points)), indexing="ij"))
    slides, pins = poses.of_points(points), poses.of_points(w)
    crank, rod = np.abs(pins[of, 0] - c[of]), np.abs(pins[of, 0] - slides[slide, 0])
    fits = (np.abs(c[of] - poses.places.mean()) < FARTHEST_PIVOT * poses.reach) & (np.abs(w[of] - points[slide]) > 1e-9)
    fits &= np.maximum(crank, rod) < GREATEST_RATIO * np.minimum(crank, rod)
    of, slide = of[fits], slide[fits]
    if not len(of):
        raise MechanismError(Fault("poses", "no crank goes with the slide of these positions.", "Move one of them a little."))
    far = slides[:, 0] + 1j * along * LONG_ROCKER * poses.reach
    defects = judge_four_bars(c[of], far[slide], pins[of], slides[slide])
    at_poses = acute(pins[of] - slides[slide], 1j * along[slide, None]).min(1)
    made: list[SliderGuide] = []
    for k in np.lexsort((-at_poses, ~defects.none)):
        if len(made) == most:
            break
        own, slid, line = int(of[k]), complex(slides[slide[k], 0]), complex(along[slide[k]])
        here = np.array([pins[own, 0], slid])
        if any(np.abs(here - np.array(one.pins)).max() < DIFFERENT_PIVOTS * poses.reach for one in made):
            continue
        bar = from_pins(complex(c[own]), complex(far[slide[k]]), complex(pins[own, 0]), slid, complex(poses.places[0]))
        theta, words, least = np.angle(pins[own] - c[own]), defects.words(int(k)), np.nan
        if not words:
            theta = crank_angles(bar, theta)
            least = float(bar.transmission(np.linspace(*used_range(theta, bar.crank_turns), RANGE_ANGLES)).min())
        made.append(SliderGuide(bar, theta, (complex(pins[own, 0]), slid), line, least, words))
    return sorted(made, key=lambda one: (bool(one.defects), -np.nan_to_num(one.transmission)))


def slider_guide_solutions(poses: BodyPositions, designs: Sequence[SliderGuide]) -> list[LinkageSolution]:
    """Solutions: guides by a crank and a slide."""
    out = []
    for k, made in enumerate(designs, 1):
        bar, (b, c) = made.four_bar, made.pins
        scene = slider_guide_scene(
            bar.crank_pivot, made.pins, complex(poses.places[0]), made.along,
            through(bar, made.theta, usable=not made.defects), marks=pose_marks(poses), name=f"guide-{k}",
            title="Crank and slide that lead a body through positions",
            learning_goal="The point C of the body lies on a line in all positions, where "
            "a slide leads it; a crank leads B. Point E "
            "passes P1, P2 ... of the frame, and the x axis of the body points to Q1, Q2 ...",
        )  # fmt: skip
        a = bar.crank_pivot
        numbers = {
            "A [mm]": f"({a.real * MM:.4g}, {a.imag * MM:.4g})",
            "crank [mm]": f"{bar.crank * MM:.6g}",
            "B-C [mm]": f"{abs(c - b) * MM:.6g}",
            "slide [deg]": f"{np.degrees(np.angle(made.along)):.4g}",
            "transmission [deg]": "-" if made.defects else f"{np.degrees(made.transmission):.1f}",
        }
        out.append(LinkageSolution(scene, numbers, made.defects))
    return out
