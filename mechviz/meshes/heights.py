"""Heights of marks: on the front of the part to which they belong, or as high above it as necessary to be visible."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np
import shapely

from mechcore.arrays import Integers, Real, Vec2
from mechcore.joints.registry import build_joints
from mechcore.records import dataclass
from mechcore.spec.mechanism import Mechanism
from mechviz.meshes.extrude import Part
from mechviz.meshes.model import ScaledMechanism

_NEAR_POINT = 0.25  # of half a plate's width: parts this near to a point belong to it
_FLAT_KINDS = ("plate", "wheel", "block")  # kinds of parts on which a spring may act in their own plane
_MARK_LIFT = 0.002  # of the mechanism's size: distance of marks above the part below them


@dataclass(frozen=True, eq=False)
class Heights:
    """Heights [m] of marks over a mechanism's solids. If all marks were above all parts, they would appear displaced from their
    points in oblique and perspective views."""

    size: float  # [m]
    top: float  # above all parts [m]
    joints: Mapping[str, float]  # just above each joint's pin or block [m]
    poses: Mapping[str, Real]  # link -> (F, 3) [m, m, rad]: poses at the frames for which the solids were built
    _parts: tuple[Part, ...]
    _near: float  # in sizes

    def of_joint(self, joint: str) -> float:
        """Height of the front of a joint's pin, or of the parts in contact; above all parts if nothing is drawn of it. It is
        without `_MARK_LIFT`, because the ball drawn there needs no gap, which would be visible from the side."""
        return self.joints.get(joint, self.top) - _MARK_LIFT * self.size

    def of_point(self, link: str, xy: Vec2) -> float:
        """Height just above a link at a point of its frame [m]; above the whole link if the point lies outside its parts."""
        return _front(self._parts, {link: (xy[0] / self.size, xy[1] / self.size)}, self._near, self.size, self.top)

    def mid_height(self, link: str, xy: Vec2) -> float | None:
        """Mid-height [m] of a moving link's part at a point of its frame [m]; None if it has none there."""
        point = shapely.Point(xy[0] / self.size, xy[1] / self.size)
        for part in self._parts:
            if part.link == link and part.kind in _FLAT_KINDS:
                for prism in part.space:
                    if prism.outline.distance(point) < self._near:
                        return 0.5 * (prism.low + prism.high) * self.size
        return None

    def flat_outlines(self, link: str) -> Iterator[tuple[shapely.Polygon, float, float]]:
        """Outlines [m] of a link's flat parts in its frame, each with its lower and upper height [m]."""
        for part in self.parts(link, _FLAT_KINDS):
            yield from part

    def parts(self, link: str, kinds: Collection[str]) -> Iterator[list[tuple[shapely.Polygon, float, float]]]:
        """For each part of a link of some kinds, its outlines [m] in the link's frame, with their lower and upper heights [m]."""
        for part in self._parts:
            if part.link == link and part.kind in kinds:
                outlines = [shapely.transform(prism.outline, lambda xy: xy * self.size) for prism in part.space]
                yield [(o, p.low * self.size, p.high * self.size) for o, p in zip(outlines, part.space, strict=True)]

    def is_crossed(self, between: tuple[float, float], lines: Real, frames: Integers, but: str = "") -> bool:
        """Whether lines (K, n, 2) [m], see `clear_height`, intersect a part between two heights [m]; ``but``: a link to ignore."""
        lines = np.asarray(lines, float) / self.size
        known = np.isfinite(lines).all(axis=(1, 2))
        lines, frames = lines[known], np.asarray(frames)[known]
        low, high = between[0] / self.size, between[1] / self.size
        local: dict[str, shapely.Geometry] = {}
        for part in (part for part in self._parts if len(lines) and part.link != but):
            for prism in part.space:
                if prism.low < high and prism.high > low:
                    if part.link not in local:
                        local[part.link] = _in_link(lines, self.poses.get(part.link), frames, self.size)
                    if prism.outline.intersects(local[part.link]):
                        return True
        return False

    def clear_height(self, height: float, lines: Real, frames: Integers) -> float:
        """The lowest height [m], at least ``height``, at which no part covers lines in the plane.

        ``lines``: (K, n, 2) [m], a line of n points at each of the ``frames`` (K,), which are indices into `poses`.
        """
        lines = np.asarray(lines, float) / self.size
        known = np.isfinite(lines).all(axis=(1, 2))
        lines, frames = lines[known], np.asarray(frames)[known]
        if not len(lines):
            return height
        local: dict[str, shapely.Geometry] = {}
        for front, part in self._fronts:  # from the highest down: the first part that is hit decides
            if front <= height:
                break
            if part.link not in local:
                local[part.link] = _in_link(lines, self.poses.get(part.link), frames, self.size)
            if any(prism.outline.intersects(local[part.link]) for prism in part.space):
                return min(front, self.top)
        return min(height, self.top)

    @cached_property
    def _fronts(self) -> list[tuple[float, Part]]:
        """Heights just above each part [m], the highest first."""
        return sorted(((_height(part) * self.size + _MARK_LIFT * self.size, part) for part in self._parts), key=lambda f: -f[0])


def find_heights(
    mechanism: Mechanism, model: ScaledMechanism, parts: Sequence[Part], poses: Mapping[str, Real] | None, top: float
) -> Heights:
    """The heights of a mechanism's joints and parts; ``top`` [m] is above all parts."""
    near = _NEAR_POINT * model.proportions.half_width
    joints = {}
    for joint in build_joints(mechanism).joints:
        points = {
            link: (at.real / model.size, at.imag / model.size) for link, at in zip(joint.links, (joint.a, joint.b), strict=True)
        }
        for axle in model.axles:
            if any(link in axle.centres and np.hypot(*np.subtract(axle.centres[link], xy)) < near for link, xy in points.items()):
                points = {**axle.centres, **points}
        joints[joint.name] = _front(parts, points, near, model.size, top)
    for contact in mechanism.joints:  # contacts without a pin: cams, gears, belts
        first, second = (
            [p for p in parts if p.link == link and p.kind != "pin" and contact.name in p.mates] for link in contact.links[:2]
        )
        middles = [0.5 * (part.space[0].low + part.space[0].high) for part in first]
        level = [p for p in second if any(prism.low < z < prism.high for prism in p.space for z in middles)]
        touching = [_height(part) for part in level or second]  # not the cheeks of a fork beside its roller
        if contact.name not in joints and touching:
            joints[contact.name] = min((max(touching) + _MARK_LIFT) * model.size, top)
    kept = {link: np.asarray(pose, float) for link, pose in (poses or {}).items()}
    return Heights(model.size, top, joints, kept, tuple(parts), near)


def _front(parts: Iterable[Part], points: Mapping[str, Vec2], near: float, size: float, top: float) -> float:
    """Height [m] just above the parts of some links near a point of each, otherwise just above these links, otherwise ``top``."""
    mine = [(part, shapely.Point(points[part.link])) for part in parts if part.link in points]
    at = [prism.high for part, point in mine for prism in part.space if prism.outline.distance(point) < near]
    whole = [_height(part) for part, _ in mine if part.kind not in ("pin", "pedestal")]
    highs = at or whole
    return min((max(highs) + _MARK_LIFT) * size, top) if highs else top


def _height(part: Part) -> float:
    return max(prism.high for prism in part.space)


def _in_link(lines: Real, pose: Real | None, frames: Integers, size: float) -> shapely.Geometry:
    """World lines (K, n, 2) in the frame of a link at its poses."""
    if pose is not None and len(pose):
        at = pose[frames] / (size, size, 1.0)
        c, s = np.cos(at[:, 2, None]), np.sin(at[:, 2, None])
        x, y = lines[..., 0] - at[:, 0, None], lines[..., 1] - at[:, 1, None]
        lines = np.stack([c * x + s * y, c * y - s * x], axis=-1)
    return shapely.multilinestrings(shapely.linestrings(lines))
