"""Proportions of arrows, moments, springs and marks, heights along z, and rotations about z, shared by all outputs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Complex, Integers, Real, Single, Values
from mechviz.quantities.vectors import Moment, Vector, centre_name, point_name

if TYPE_CHECKING:
    from mechviz.meshes.heights import Heights
    from mechviz.runs import Run


OCCLUSION_FRAMES = 24  # frames at which parts in front of an arrow are looked for


def path_height(run: Run, heights: Heights, link: str, point: str) -> float:
    """Height [m] of a traced point's path: the front of its link, or as far in front of it that no part passes over the point."""
    places = run.motion.point(link, point)
    point_of_link = {spec.name: spec for spec in run.motion.mechanism.links}[link].points[point]
    frames, known = occlusion_frames(run, heights)
    dots = np.stack([places[frames], places[frames] + 1e-6 * heights.size], axis=1)
    return heights.clear_height(heights.of_point(link, point_of_link), dots, known)


def arrow_height(run: Run, heights: Heights, vector: Vector, per_metre: float) -> float:
    """Height [m] of an arrow: the front of the pin or link where it starts, or as far in front of it as the arrow needs to be
    visible."""
    frames, known = occlusion_frames(run, heights)
    start = vector.origin[frames]
    lines = np.stack([start, start + vector.value[frames] / per_metre], axis=1)
    return heights.clear_height(_own_height(run, heights, vector), lines, known)


def arc_height(run: Run, heights: Heights, moment: Moment, radius: float) -> float:
    """Height [m] of an arc of a radius [m] about a pin or link, as far in front of it as the arc needs to be visible."""
    frames, known = occlusion_frames(run, heights)
    angles = np.linspace(0.0, 2.0 * np.pi, 17)
    circle = radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return heights.clear_height(_own_height(run, heights, moment), moment.origin[frames][:, None] + circle, known)


def occlusion_frames(run: Run, heights: Heights) -> tuple[Integers, Integers]:
    """Up to `OCCLUSION_FRAMES` frames of the run, and their indices among the frames whose poses ``heights`` holds."""
    count = max((len(pose) for pose in heights.poses.values()), default=1)
    known = np.unique(np.linspace(0, count - 1, min(count, OCCLUSION_FRAMES)).round().astype(int))
    # the frames in heights are spread evenly over the run
    frames = np.round(known * (run.motion.frames - 1) / max(count - 1, 1)).astype(int)
    return frames, known


def _own_height(run: Run, heights: Heights, item: Vector | Moment) -> float:
    """Height [m] of the front of the item that an arrow or arc belongs to: a joint, a traced point, a centre of mass, a link."""
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
    return 0.0  # a load: start at the back; the height is then moved in front of the parts that hide it


# Of an arrow: radii of its shaft and its head, length of its head
ARROW_SHAFT_RADIUS, ARROW_HEAD_RADIUS, ARROW_HEAD_LENGTH = 0.0042, 0.0115, 0.03
LEAST_ARROW = 1.3 * ARROW_HEAD_LENGTH  # a shorter arrow is left out, or drawn smaller
ARC_RADIUS, ARC_WIDTH = 0.085, 0.0085  # of the arc of a moment
ARC_TIP = 0.42  # angle of its head [rad]
POT_HALF_WIDTH = 0.028  # half width of dampers and gas springs
SPIRAL_RADIUS = 0.09  # radius of torsion springs
SPIRAL_TURNS = 2.5  # of a torsion spring
STRUT_COLOR = (58, 66, 78)  # colour of dampers, gas springs and torsion springs


def pot_length(least: float, most: float) -> float:
    """Length of the cylinder of a damper whose ends are between ``least`` and ``most`` apart."""
    return min(max((most - least) / 0.8, 0.5 * most), 0.95 * least)


def spiral_radius(part: Any, size: float) -> Any:
    """Radius [m] of a torsion spring at the fraction ``part`` of its length from the inside; ``size``: of the mechanism [m]."""
    return SPIRAL_RADIUS * size * (0.25 + 0.75 * part)


def arc_corners(turn: float, radius: float, width: float, steps: int) -> Complex:
    """Corners of a flat arc with a head about the origin, for `arc_faces`: from the positive x axis through ``turn`` [rad]."""
    sign = np.sign(turn)
    along = np.linspace(0.0, sign * (abs(turn) - min(ARC_TIP, abs(turn))), steps + 1)
    body = (np.array([radius + 0.5 * width, radius - 0.5 * width]) * np.exp(1j * along)[:, None]).ravel()
    base = np.array([radius + 1.7 * width, radius - 1.7 * width]) * np.exp(1j * along[-1])
    return np.concatenate([body, base, [radius * np.exp(1j * turn)]])


def arc_faces(steps: int) -> NDArray[np.uint32]:
    """Faces of an arc from `arc_corners`; counter-clockwise where the arc is."""
    n = 2 * (steps + 1)
    return np.vstack([ribbon_faces(steps + 1), [[n, n + 2, n + 1]]]).astype(np.uint32)


def ribbon_faces(places: int) -> Integers:
    """Faces of a ribbon, counter-clockwise, whose corners are in the order outer, inner, outer, inner, ..."""
    k = 2 * np.arange(places - 1)
    return np.vstack([np.column_stack([k, k + 2, k + 1]), np.column_stack([k + 1, k + 2, k + 3])])


DEEP = 0.75  # ratio of depth to the larger of width and height above which parts hide each other in a front view
ANGLED = (-0.55, 0.45, 1.0)  # view direction for such mechanisms


def is_deep(bounds: Real) -> bool:
    """Whether a mechanism in a box (2, 3) [m] is viewed at an angle instead of from the front."""
    wide, high, deep = bounds[1] - bounds[0]
    return bool(deep > DEEP * max(wide, high))


def about_z(angle: Values) -> Real:
    """Unit quaternions (..., 4) x, y, z, w of rotations by ``angle`` (...) [rad] about z; continuous where the angle is."""
    half = 0.5 * np.asarray(angle, float)
    nothing = np.zeros_like(half)
    return np.stack([nothing, nothing, np.sin(half), np.cos(half)], axis=-1)


def in_space(xy: Real, height: float) -> Single:
    """Places or vectors (..., 2) of the plane with z = ``height``, as (..., 3) in single precision."""
    out = np.full((*xy.shape[:-1], 3), height, np.float32)
    out[..., :2] = xy
    return out
