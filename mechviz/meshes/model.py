"""The mechanism as the part builder sees it: in units of its own size, with axles, guides and proportions of parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mechcore.spec import Force, Mechanism, Prismatic, Revolute, Vec2

__all__ = ["Axle", "Guide", "Model", "Proportions", "build_model"]

_SAME = 1e-6  # points closer than this share one axle
_DEFAULT_TRAVEL = 0.15  # half the travel of a guide whose motion is not known


@dataclass(frozen=True)
class Proportions:
    """Sizes that all parts share."""

    r: float  # half the width of a plate
    t: float  # thickness of a plate
    bevel: float
    boss: float  # how far a boss stands above the plate where it faces another link
    clearance: float  # between bosses that face each other, and between a pin and its hole

    @property
    def pitch(self) -> float:
        """Distance of neighbouring layers."""
        return self.t + 2.0 * self.boss + self.clearance

    @property
    def slot(self) -> float:
        """Half the width of a slot."""
        return 0.9 * self.r

    @property
    def slotted(self) -> float:
        """Half the width of a plate around a slot."""
        return self.slot + 0.5 * self.r

    @property
    def block(self) -> float:
        """Half the length of a sliding block along its guide, beyond its outermost pins."""
        return 1.45 * self.r


@dataclass(frozen=True)
class Axle:
    """Revolute pairs that share one axis: a pin through all their links. Radii are in units of the size."""

    centres: Mapping[str, Vec2]  # link -> the axis in the link's frame
    owner: str  # the link that the pin belongs to
    pin: float
    boss: float

    @property
    def hole(self) -> float:
        return 1.04 * self.pin

    @property
    def sleeve(self) -> float:
        """Radius of spacers, heads and columns: nothing else may come closer to the axis between two joined layers."""
        return self.pin + 0.55 * (self.boss - self.pin)


@dataclass(frozen=True)
class Guide:
    """A prismatic pair: a block that slides along a rail."""

    pair: str
    rail: str
    block: str
    origin: Vec2  # a point of the guide line, in the rail's frame
    along: Vec2  # unit direction, in the rail's frame
    block_point: Vec2  # in the block's frame
    block_along: Vec2  # unit direction, in the block's frame
    travel: tuple[float, float]  # of the block's point along the line, from `origin`


@dataclass(frozen=True)
class Model:
    """A mechanism in units of its size."""

    frame: str
    links: tuple[str, ...]  # all, in the order of the scene
    size: float  # [m]
    poses: Mapping[str, np.ndarray]  # link -> (F, 3) x, y, angle; empty if not known
    frames: int
    axles: tuple[Axle, ...]
    guides: tuple[Guide, ...]
    marks: Mapping[str, tuple[Vec2, ...]]  # link -> points of its outline that carry no pin
    proportions: Proportions
    segments: int  # sides of a full circle

    def pins(self, link: str) -> list[Vec2]:
        """Pin centres of a link, in its frame."""
        return [axle.centres[link] for axle in self.axles if link in axle.centres]


def build_model(mechanism: Mechanism, poses: Mapping[str, np.ndarray] | None, segments: int) -> Model:
    """Scale a mechanism and its poses (F, 3) [m, m, rad] to size 1 and find its axles and guides."""
    moving = _usable_poses(mechanism, poses)
    size = _size(mechanism, moving)
    scaled = {name: pose / (size, size, 1.0) for name, pose in moving.items()}
    frames = len(next(iter(scaled.values()))) if scaled else 0
    points = {link.name: {p: (x / size, y / size) for p, (x, y) in link.points.items()} for link in mechanism.links}
    clusters = _clusters(mechanism, points)
    marks = _marks(mechanism, points, clusters)
    proportions = _proportions(mechanism, clusters)
    axles = tuple(_axle(mechanism, c, clusters, marks, proportions) for c in clusters)
    guides = tuple(
        _guide(mechanism, pair, points, scaled, clusters, marks, proportions)
        for pair in mechanism.pairs
        if isinstance(pair, Prismatic)
    )
    names = tuple(link.name for link in mechanism.links)
    return Model(mechanism.frame, names, size, scaled, frames, axles, guides, marks, proportions, segments)


def _usable_poses(mechanism: Mechanism, poses: Mapping[str, np.ndarray] | None) -> dict[str, np.ndarray]:
    """Poses (F, 3) of every link at the frames where all links have finite ones; empty if there are none."""
    names = [link.name for link in mechanism.links if link.name != mechanism.frame]
    if poses is None or any(name not in poses for name in names):
        return {}
    arrays = {name: np.asarray(poses[name], float).reshape(-1, 3) for name in names}
    frames = min((len(a) for a in arrays.values()), default=1)
    good = np.ones(frames, bool)
    for a in arrays.values():
        good &= np.isfinite(a[:frames]).all(axis=1)
    if not good.any():
        return {}
    return {mechanism.frame: np.zeros((int(good.sum()), 3))} | {name: a[:frames][good] for name, a in arrays.items()}


def _size(mechanism: Mechanism, poses: Mapping[str, np.ndarray]) -> float:
    """The larger side of the box around the mechanism's points over the run [m]; 10 mm if it has no extent."""
    clouds, extents = [], [0.0]
    used = {(link, p) for pair in mechanism.pairs for link, p in zip(pair.links, pair.points, strict=True)}
    for link in mechanism.links:
        kept = [xy for p, xy in link.points.items() if link.name != mechanism.frame or (link.name, p) in used]
        if not kept:
            continue
        xy = np.array(kept, float)
        extents.append(float(np.ptp(xy, axis=0).max()))
        if poses:
            clouds.append(place(xy, poses[link.name]).reshape(-1, 2))
    size = float(np.ptp(np.vstack(clouds), axis=0).max()) if clouds else 1.5 * max(extents)
    return size if np.isfinite(size) and size > 0.0 else 0.01


def place(xy: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Points (n, 2) of a link in the world at its poses (F, 3) -> (F, n, 2)."""
    c, s = np.cos(pose[:, 2, None]), np.sin(pose[:, 2, None])
    x = pose[:, 0, None] + c * xy[:, 0] - s * xy[:, 1]
    y = pose[:, 1, None] + s * xy[:, 0] + c * xy[:, 1]
    return np.stack([x, y], axis=-1)


Points = Mapping[str, Mapping[str, Vec2]]  # link -> name of a point -> point, in the link's frame
Marks = Mapping[str, tuple[Vec2, ...]]  # link -> points of its outline that carry no pin
Cluster = tuple[dict[str, Vec2], str]  # link -> centre, and the owner of the pin


def _clusters(mechanism: Mechanism, points: Points) -> list[Cluster]:
    """Revolute pairs gathered by their axis: pairs at the same place of a common link share one pin."""
    groups: list[tuple[dict[str, Vec2], str]] = []
    for pair in mechanism.pairs:
        if not isinstance(pair, Revolute):
            continue
        new = {link: points[link][p] for link, p in zip(pair.links, pair.points, strict=True)}
        owner = mechanism.frame if mechanism.frame in new else pair.links[1]
        rest = []
        for centres, old_owner in groups:
            if any(link in centres and _distance(centres[link], xy) < _SAME for link, xy in new.items()):
                new = {**centres, **new}
                owner = mechanism.frame if mechanism.frame in new else old_owner
            else:
                rest.append((centres, old_owner))
        groups = [*rest, (new, owner)]
    return groups


def _marks(mechanism: Mechanism, points: Points, clusters: list[Cluster]) -> Marks:
    """Points that belong to a link's outline without a pin: all named points, except those that only place a guide."""
    prismatic = [pair for pair in mechanism.pairs if isinstance(pair, Prismatic)]
    guides = {(link, p) for pair in prismatic for link, p in zip(pair.links, pair.points, strict=True)}
    wanted = set(mechanism.traced) | {(load.link, load.point) for load in mechanism.loads if isinstance(load, Force)}
    marks = {}
    for link, named in points.items():
        pins = [centres[link] for centres, _ in clusters if link in centres]
        kept: list[Vec2] = []
        for name, xy in named.items():
            if (link, name) in guides and (link, name) not in wanted:
                continue
            if all(_distance(xy, other) >= _SAME for other in [*pins, *kept]):
                kept.append(xy)
        marks[link] = tuple(kept) if link != mechanism.frame else ()
    return marks


def _proportions(mechanism: Mechanism, clusters: list[Cluster]) -> Proportions:
    """Plate sizes from the mechanism's size (1), narrower where short links need it, but never as thin as wire."""
    shortest = 1.0
    for link in mechanism.links:
        if link.name == mechanism.frame:
            continue
        pins = [centres[link.name] for centres, _ in clusters if link.name in centres]
        shortest = min([shortest, *(_distance(a, b) for i, a in enumerate(pins) for b in pins[:i])])
    r = float(np.clip(0.36 * shortest, 0.015, 0.033))
    t = 0.75 * r
    return Proportions(r=r, t=t, bevel=0.12 * t, boss=0.22 * t, clearance=0.12 * t)


def _axle(mechanism: Mechanism, cluster: Cluster, clusters: list[Cluster], marks: Marks, size: Proportions) -> Axle:
    """An axle whose pin and bosses leave room for the other pins of its links."""
    centres, owner = cluster
    room = 10.0
    for link, xy in centres.items():
        others = [c[link] for c, _ in clusters if link in c and c is not centres]
        room = min([room, *(_distance(xy, other) for other in others)])
        room = min([room, *(1.3 * _distance(xy, mark) for mark in marks[link])])  # a mark needs less room than a pin
    room = max(room, 10.0 * _SAME)
    return Axle(centres, owner, pin=min(0.4 * size.r, 0.3 * room), boss=min(0.82 * size.r, 0.46 * room))


def _guide(
    mechanism: Mechanism,
    pair: Prismatic,
    points: Points,
    poses: Mapping[str, np.ndarray],
    clusters: list[Cluster],
    marks: Marks,
    size: Proportions,
) -> Guide:
    """Which link of a prismatic pair is drawn as the rail and which as the block, and how far the block travels.

    The link that carries the guide line is the rail, unless it is only a block at a pin while the other one is long
    (an oscillating cylinder: the guide turns about a fixed pin and a rod slides through it).
    """
    carrier, other = pair.links[pair.guide], pair.links[1 - pair.guide]
    origin = points[carrier][pair.points[pair.guide]]
    slider = points[other][pair.points[1 - pair.guide]]
    norm = float(np.hypot(*pair.along)) or 1.0
    along = (pair.along[0] / norm, pair.along[1] / norm)
    # The second link's frame is turned by `angle` against the first's.
    slider_along = _turn(along, -pair.angle if pair.guide == 0 else pair.angle)
    travel = (-_DEFAULT_TRAVEL, _DEFAULT_TRAVEL)
    if poses:
        at_origin = place(np.array([origin]), poses[carrier])[:, 0]
        at_slider = place(np.array([slider]), poses[other])[:, 0]
        angle = poses[carrier][:, 2]
        c, s = np.cos(angle), np.sin(angle)
        u = np.stack([c * along[0] - s * along[1], s * along[0] + c * along[1]], axis=-1)
        moved = ((at_slider - at_origin) * u).sum(axis=1)
        travel = (float(moved.min()), float(moved.max()))

    def compact(link: str, at: Vec2) -> bool:
        if any(isinstance(p, Prismatic) and p.name != pair.name and p.links[p.guide] == link for p in mechanism.pairs):
            return False
        pins = [centres[link] for centres, _ in clusters if link in centres]
        return all(_distance(xy, at) < 2.0 * size.r for xy in [*pins, *marks[link]])

    other_is_long = other == mechanism.frame or not compact(other, slider)
    if carrier != mechanism.frame and compact(carrier, origin) and other_is_long:
        return Guide(pair.name, other, carrier, slider, slider_along, origin, along, (-travel[1], -travel[0]))
    return Guide(pair.name, carrier, other, origin, along, slider, slider_along, travel)


def _distance(a: Vec2, b: Vec2) -> float:
    return float(np.hypot(a[0] - b[0], a[1] - b[1]))


def _turn(v: Vec2, angle: float) -> Vec2:
    c, s = float(np.cos(angle)), float(np.sin(angle))
    return (c * v[0] - s * v[1], s * v[0] + c * v[1])
