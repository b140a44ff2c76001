"""Motion generation with a slide: one point of the body lies on a line in all positions, a crank leads another one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.design.burmester import Poses, slider_points
from mechcore.design.four_bars import FourBar, acute, from_pins, judge, used_range
from mechcore.errors import Fault, MechanismError
from mechviz.studies.synthesis.four_bars import APART, FARTHEST, FINE, SHARPEST, crank_angles, pose_marks
from mechviz.studies.synthesis.linkages import MM, slider_guide_scene, through
from mechviz.studies.synthesis.solutions import Solution

FAR = 1e4  # of the reach: a rocker so long judges a slide, whose pin it leads on a line to a part of 1e-4


@dataclass(frozen=True, eq=False)
class SliderGuide:
    """A crank and a slide that lead a body through N poses: the four-bar with a very long rocker that stands for them, crank angles
    (N,) [rad], both pins at the start, the slide's unit direction, and the least transmission angle between the poses [rad], NaN
    with defects."""

    four_bar: FourBar
    theta: Real
    pins: tuple[complex, complex]
    along: complex
    transmission: float
    defects: str


def slider_guides(poses: Poses, w: Complex, c: Complex, most: int) -> list[SliderGuide]:
    """Guides by one of the cranks (R,), moving pivots in the body and fixed ones, and one of the slides of the poses: so many that
    differ, those without defects first, the best transmission first. Raises `MechanismError` where there is no slide."""
    points, along = slider_points(poses)
    near = np.abs(points) < FARTHEST * poses.reach
    points, along = (points[near], along[near]) if near.any() else (points, along)
    of, slide = (index.ravel() for index in np.meshgrid(np.arange(len(w)), np.arange(len(points)), indexing="ij"))
    slides, pins = poses.of_points(points), poses.of_points(w)
    crank, rod = np.abs(pins[of, 0] - c[of]), np.abs(pins[of, 0] - slides[slide, 0])
    fits = (np.abs(c[of] - poses.places.mean()) < FARTHEST * poses.reach) & (np.abs(w[of] - points[slide]) > 1e-9)
    fits &= np.maximum(crank, rod) < SHARPEST * np.minimum(crank, rod)
    of, slide = of[fits], slide[fits]
    if not len(of):
        raise MechanismError(Fault("poses", "no crank goes with the slide of these positions.", "Move one of them a little."))
    far = slides[:, 0] + 1j * along * FAR * poses.reach
    defects = judge(c[of], far[slide], pins[of], slides[slide])
    at_poses = acute(pins[of] - slides[slide], 1j * along[slide, None]).min(1)
    made: list[SliderGuide] = []
    for k in np.lexsort((-at_poses, ~defects.none)):
        if len(made) == most:
            break
        own, slid, line = int(of[k]), complex(slides[slide[k], 0]), complex(along[slide[k]])
        here = np.array([pins[own, 0], slid])
        if any(np.abs(here - np.array(one.pins)).max() < APART * poses.reach for one in made):
            continue
        bar = from_pins(complex(c[own]), complex(far[slide[k]]), complex(pins[own, 0]), slid, complex(poses.places[0]))
        theta, words, least = np.angle(pins[own] - c[own]), defects.words(int(k)), np.nan
        if not words:
            theta = crank_angles(bar, theta)
            least = float(bar.transmission(np.linspace(*used_range(theta, bar.crank_turns), FINE)).min())
        made.append(SliderGuide(bar, theta, (complex(pins[own, 0]), slid), line, least, words))
    return sorted(made, key=lambda one: (bool(one.defects), -np.nan_to_num(one.transmission)))


def slider_guide_solutions(poses: Poses, found: Sequence[SliderGuide]) -> list[Solution]:
    """Guides as solutions."""
    out = []
    for k, made in enumerate(found, 1):
        bar, (b, c) = made.four_bar, made.pins
        scene = slider_guide_scene(
            bar.crank_pivot, made.pins, complex(poses.places[0]), made.along,
            through(bar, made.theta, usable=not made.defects), marks=pose_marks(poses), name=f"guide-{k}",
            title="Crank and slide that lead a body through positions",
            teaches="The point C of the body lies on a line in all positions, where a slide leads it; a crank leads B. Point E "
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
        out.append(Solution(scene, numbers, made.defects))
    return out
