"""At which height in z the marks of a run lie: paths, arrows and arcs, the same in recordings and in the viewer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .vectors import Moment, Vector, centre_name, point_name

if TYPE_CHECKING:
    from .meshes import Heights
    from .run import Run

__all__ = ["arc_height", "arrow_height", "looks", "path_height"]

Real = NDArray[np.float64]

LOOKS = 24  # frames at which is looked what lies before an arrow


def path_height(run: Run, heights: Heights, link: str, point: str) -> float:
    """Height [m] of a traced point's path: on its link's front, or further before it so that no part passes over the point."""
    places = run.motion.point(link, point)
    spot = {spec.name: spec for spec in run.motion.mechanism.links}[link].points[point]
    frames, known = looks(run, heights)
    dots = np.stack([places[frames], places[frames] + 1e-6 * heights.size], axis=1)
    return heights.cleared(heights.of_point(link, spot), dots, known)


def arrow_height(run: Run, heights: Heights, vector: Vector, per_metre: float) -> float:
    """Height [m] of an arrow: on the front of the pin or link where it starts, or as far before it as is needed to be seen."""
    frames, known = looks(run, heights)
    start = vector.origin[frames]
    lines = np.stack([start, start + vector.value[frames] / per_metre], axis=1)
    return heights.cleared(_own_height(run, heights, vector), lines, known)


def arc_height(run: Run, heights: Heights, moment: Moment, radius: float) -> float:
    """Height [m] of an arc of a radius [m] about a pin or link, as far before it as is needed to be seen."""
    frames, known = looks(run, heights)
    angles = np.linspace(0.0, 2.0 * np.pi, 17)
    circle = radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return heights.cleared(_own_height(run, heights, moment), moment.origin[frames][:, None] + circle, known)


def looks(run: Run, heights: Heights) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Some frames of the run, and their numbers among the frames whose poses are known to the solids."""
    count = max((len(pose) for pose in heights.poses.values()), default=1)
    known = np.unique(np.linspace(0, count - 1, min(count, LOOKS)).round().astype(int))
    # the solids were looked at at frames that are spread evenly over the run
    frames = np.round(known * (run.motion.frames - 1) / max(count - 1, 1)).astype(int)
    return frames, known


def _own_height(run: Run, heights: Heights, item: Vector | Moment) -> float:
    """The front of what an arrow or arc belongs to: a joint, a traced point, a centre of mass, a link."""
    if item.item in heights.joints:
        return heights.joints[item.item]
    mechanism = run.motion.mechanism
    traced = {point_name(*key): key for key in mechanism.traced}
    links = {spec.name: spec for spec in mechanism.links}
    if item.item in traced:
        link, point = traced[item.item]
        return heights.of_point(link, links[link].points[point])
    for name, spec in links.items():
        if item.item in (name, centre_name(name)):
            return heights.of_point(name, spec.centre)
    return 0.0  # a load: from the back on, whatever is in the way of it is cleared
