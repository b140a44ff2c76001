"""The mechanism for the part builder: in units of its own size, with axles, guides, wheels and proportions of parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace

import numpy as np
from shapely.geometry import Point, Polygon

from mechcore.arrays import Real, Vec2
from mechcore.joints.base import Builder, LoopJoint
from mechcore.joints.registry import build_joints
from mechcore.records import dataclass
from mechcore.spec.loads import Force
from mechcore.spec.mechanism import CamJoint, Link, Mechanism, PinSlot, Prismatic, Rolling, Screw
from mechviz.meshes.kinds.cam_profiles import CamDrawing, InverseCamDrawing, cam_extents, find_cams, find_inverse_cams
from mechviz.meshes.kinds.fittings import Telescope, find_telescopes
from mechviz.meshes.kinds.spatial_cams import SpatialCamDrawing, find_spatial_cams
from mechviz.meshes.kinds.wheels import Wheels, find_wheels
from mechviz.meshes.outline import polygons, rounded

_SAME_AXLE = 1e-6  # points closer than this share one axle
_LEAST_HALF_WIDTH = 0.015  # half the width of the thinnest plates, in sizes of the mechanism
_CAMSHAFT_RADIUS, _CAM_HUB_RADIUS = 0.58, 1.15  # radii of a camshaft and of the hub on it, in half widths of a plate
_DEFAULT_TRAVEL = 0.15  # half the travel of a guide whose motion is not known


@dataclass(frozen=True)
class Proportions:
    """Dimensions that all parts share."""

    half_width: float  # of a plate
    thickness: float  # of a plate
    bevel: float
    boss: float  # height of a boss above the plate if it faces another link
    clearance: float  # between bosses that face each other, and between a pin and its hole

    def thinner(self, factor: float) -> Proportions:
        """The same plates and gaps, thinner by a factor."""
        return replace(
            self,
            thickness=factor * self.thickness,
            bevel=factor * self.bevel,
            boss=factor * self.boss,
            clearance=factor * self.clearance,
        )

    @property
    def pitch(self) -> float:
        """Distance of neighbouring layers."""
        return self.thickness + 2.0 * self.boss + self.clearance

    @property
    def slot(self) -> float:
        """Half the width of a slot."""
        return 0.9 * self.half_width

    @property
    def slotted(self) -> float:
        """Half the width of a plate around a slot."""
        return self.slot + 0.5 * self.half_width

    @property
    def block(self) -> float:
        """Half the length of a sliding block along its guide, beyond its outermost pins."""
        return 1.45 * self.half_width


@dataclass(frozen=True)
class Axle:
    """Revolute joints that share one axis: a pin through all their links. Radii are in units of the size.

    The pin in a slot is an axle as well; ``centres`` then does not contain the link with the slot.
    """

    centres: Mapping[str, Vec2]  # link -> the axis in the link's frame
    owner: str  # the link to which the pin belongs
    pin: float
    boss: float
    play: Mapping[str, float] = field(default_factory=dict)  # largest distance of the pin from the axis, in links with clearance
    key: Vec2 | None = None  # a camshaft: the pin turns with its owner, keyed to it in this direction of the owner's frame

    @property
    def hole(self) -> float:
        return 1.04 * self.pin

    def hole_in(self, link: str) -> float:
        """Radius of the hole in a link: larger by the play of a joint with clearance, so that the pin stays inside."""
        return self.hole + self.play.get(link, 0.0)

    @property
    def sleeve(self) -> float:
        """Radius of spacers, heads and columns: no other part may come closer to the axis between two joined layers."""
        return self.pin + 0.55 * (self.boss - self.pin)


@dataclass(frozen=True)
class Guide:
    """A prismatic joint: a block that slides along a rail."""

    joint: str
    rail: str
    block: str
    origin: Vec2  # a point of the guide line, in the rail's frame
    along: Vec2  # unit direction, in the rail's frame
    block_point: Vec2  # in the block's frame
    block_along: Vec2  # unit direction, in the block's frame
    travel: tuple[float, float]  # range of the block's point along the line, from ``origin``


@dataclass(frozen=True)
class Slot:
    """A pin in a slot."""

    joint: str
    link: str  # the link with the slot
    pin: str  # the link with the pin
    origin: Vec2  # a point of the slot's middle line, in its link's frame
    along: Vec2  # unit direction, in that frame
    point: Vec2  # the pin, in the pin's frame
    travel: tuple[float, float]  # range of the pin along the slot, from ``origin``


@dataclass(frozen=True)
class Weldment:
    """Two links joined rigidly."""

    links: tuple[str, str]
    points: tuple[Vec2, Vec2]
    angle: float  # of the second link's frame relative to the first's [rad]


@dataclass(frozen=True)
class ScaledMechanism:
    """A mechanism in units of its size."""

    frame: str
    links: tuple[str, ...]  # all, in the order of the scene; parts of cylinders last
    size: float  # [m]
    poses: Mapping[str, Real]  # link -> (F, 3) x, y, angle; empty if not known
    frames: int
    axles: tuple[Axle, ...]
    guides: tuple[Guide, ...]
    slots: tuple[Slot, ...]
    welds: tuple[Weldment, ...]
    telescopes: tuple[Telescope, ...]
    wheels: Wheels
    marks: Mapping[str, tuple[Vec2, ...]]  # link -> points of its outline that carry no pin
    proportions: Proportions
    segments: int  # sides of a full circle
    cams: tuple[CamDrawing, ...] = ()
    inverse_cams: tuple[InverseCamDrawing, ...] = ()
    spatial_cams: tuple[SpatialCamDrawing, ...] = ()  # barrel, end and globoidal cams
    guide_points: Mapping[str, Vec2] = field(default_factory=dict)  # prismatic joint on the ground -> its point on it
    figures: Mapping[str, Polygon] = field(default_factory=dict)  # link -> figure added to its plate
    planes: Mapping[str, float] = field(default_factory=dict)  # link -> least height in front of the first plane
    spindle: bool = False  # guides of the ground are rods through the blocks, not rails beside them
    leads: Mapping[str, float] = field(default_factory=dict)  # guide of a screw, with a spindle through the nut -> lead

    def spindles(self, link: str) -> set[str]:
        """Guides of the ground whose screws pass through a link."""
        own = {guide.joint for guide in self.guides if (guide.rail, guide.block) == (self.frame, link)}
        return own & set(self.leads)

    def pins(self, link: str) -> list[Vec2]:
        """Pin centres of a link, in its frame."""
        return [axle.centres[link] for axle in self.axles if link in axle.centres]


def scale_mechanism(
    mechanism: Mechanism, poses: Mapping[str, Real] | None, segments: int, profile: int = 1080, *, spindle: bool = False
) -> ScaledMechanism:
    """Scale a mechanism and its poses (F, 3) [m, m, rad] to size 1 and find its axles, guides and wheels.

    ``segments``: sides of a full circle; ``profile``: points of a cam's profile; ``spindle``: the ground's guides are rods.
    """
    parts = build_joints(mechanism)
    links = tuple(parts.links.values())
    moving = _usable_poses(mechanism.frame, links, poses)
    size = _size(mechanism, parts, moving)
    scaled = {name: pose / (size, size, 1.0) for name, pose in moving.items()}
    frames = len(next(iter(scaled.values()))) if scaled else 0
    points = {link.name: {p: (x / size, y / size) for p, (x, y) in link.points.items()} for link in links}
    joints = [_scaled(joint, size) for joint in parts.joints]
    wheels = find_wheels(mechanism, parts, size, scaled)
    racks = {bar.slider for bar in wheels.racks}
    cams = find_cams(mechanism, parts, size, profile)
    spatial = find_spatial_cams(mechanism, parts, size)
    spun = {drawing.cam for drawing in spatial}
    drawn = {name for cam in cams for name in cam.own_guides}
    clusters = [c for c in _clusters(mechanism, joints) if spun.isdisjoint(c[0])]  # shafts in the plane of motion
    marks = _marks(mechanism, points, clusters)
    proportions = _proportions(mechanism, links, clusters, wheels)
    others = [j for j in joints if j.kind == "prismatic" and j.name not in racks | drawn]
    telescopes = find_telescopes(
        mechanism, joints, others, marks, {j.name: _travel(j, scaled) for j in others}, proportions.half_width
    )
    marks = {link: () if any(link in (t.barrel, t.rod) for t in telescopes) else own for link, own in marks.items()}
    welds = tuple(Weldment(j.links, (_xy(j.a), _xy(j.b)), j.angle) for j in joints if j.kind == "weld")
    axles = tuple(
        _keyed(_axle(c, clusters, marks, proportions), cams, welds, mechanism.frame, proportions.half_width) for c in clusters
    )
    axles = tuple(replace(axle, play=_play(axle, scaled)) for axle in axles)
    guides = [j for j in others if j.name not in {t.joint for t in telescopes}]
    slots = [joint for joint in mechanism.joints if isinstance(joint, PinSlot)]
    ends = {joint.name: (joint.ends[0] / size, joint.ends[1] / size) for joint in slots if joint.ends is not None}
    return ScaledMechanism(
        frame=mechanism.frame,
        links=tuple(link.name for link in links),
        size=size,
        poses=scaled,
        frames=frames,
        axles=axles,
        guides=tuple(_guide(mechanism, joint, scaled, clusters, marks, proportions) for joint in guides),
        slots=tuple(_slot(joint, scaled, ends.get(joint.name)) for joint in joints if joint.kind == "pin_slot"),
        welds=welds,
        telescopes=telescopes,
        wheels=wheels,
        marks=marks,
        proportions=proportions,
        segments=segments,
        cams=cams,
        spatial_cams=spatial,
        inverse_cams=find_inverse_cams(mechanism, parts, size),
        guide_points=_ground_points(mechanism.frame, joints),
        spindle=spindle,
        leads={f"{j.name}.slide": abs(j.lead) / size for j in mechanism.joints if isinstance(j, Screw)},
        planes={link.name: link.plane / size for link in links if link.plane},
        figures={link.name: _figure(np.array(link.outline) / size, proportions.bevel) for link in links if link.outline},
    )


def _figure(corners: Real, bevel: float) -> Polygon:
    """A figure with convex corners rounded such that its edges can be bevelled; unchanged if it is too fine for that."""
    whole = Polygon(corners)
    blunt = polygons(rounded(whole, 1.1 * bevel))
    return blunt[0] if len(blunt) == 1 and not blunt[0].interiors else whole


def largest_circle(model: ScaledMechanism) -> float:
    """Radius of the largest round shape, in sizes of the mechanism: wheels, the rims of grooved cams, rounded ends of links."""
    radii = [model.proportions.half_width, *(w.radius for w in model.wheels.wheels)]
    for cam in model.cams:
        rim = np.hypot(*(np.asarray(cam.profile.exterior.coords)[:, :2] - cam.bore).T)
        radii.append(float(rim.max()) + 1.4 * model.proportions.half_width)
    return max(radii)


def _ground_points(frame: str, joints: Sequence[LoopJoint]) -> dict[str, Vec2]:
    """Points on the ground of the prismatic joints with the ground, by joint."""
    return {j.name: _xy(j.a if j.links[0] == frame else j.b) for j in joints if j.kind == "prismatic" and frame in j.links}


def _scaled(joint: LoopJoint, size: float) -> LoopJoint:
    """A joint with its points in units of the size."""
    return replace(joint, a=joint.a / size, b=joint.b / size)


def _xy(z: complex) -> Vec2:
    return (z.real, z.imag)


def _usable_poses(frame: str, links: Sequence[Link], poses: Mapping[str, Real] | None) -> dict[str, Real]:
    """Poses (F, 3) of every link at the frames where the poses of all links are finite; empty if there are none."""
    names = [link.name for link in links if link.name != frame]
    if poses is None or any(name not in poses for name in names):
        return {}
    arrays = {name: np.asarray(poses[name], float).reshape(-1, 3) for name in names}
    frames = min((len(a) for a in arrays.values()), default=1)
    good = np.ones(frames, bool)
    for a in arrays.values():
        good &= np.isfinite(a[:frames]).all(axis=1)
    if not good.any():
        return {}
    return {frame: np.zeros((int(good.sum()), 3))} | {name: a[:frames][good] for name, a in arrays.items()}


def _size(mechanism: Mechanism, parts: Builder, poses: Mapping[str, Real]) -> float:
    """The larger side of the box around the mechanism's points and wheels over the run [m]; 10 mm if it has no extent."""
    clouds, extents = [], [0.0]
    used = {
        (link, p)
        for joint in mechanism.joints
        if hasattr(joint, "points")
        for link, p in zip(joint.links, joint.points, strict=True)
    }
    rims: dict[str, list[Vec2]] = {}
    for wheel in find_wheels(mechanism, parts, 1.0, {}).wheels:
        x, y, r = *wheel.centre, wheel.radius
        rims.setdefault(wheel.link, []).extend([(x - r, y), (x + r, y), (x, y - r), (x, y + r)])
    for name, corners in cam_extents(find_cams(mechanism, parts, 1.0)).items():
        rims.setdefault(name, []).extend(corners)
    for link in parts.links.values():
        kept = [xy for p, xy in link.points.items() if link.name != mechanism.frame or (link.name, p) in used]
        kept += rims.get(link.name, [])
        if not kept:
            continue
        xy = np.array(kept, float)
        extents.append(float(np.ptp(xy, axis=0).max()))
        if poses:
            clouds.append(world_points(xy, poses[link.name]).reshape(-1, 2))
    size = float(np.ptp(np.vstack(clouds), axis=0).max()) if clouds else 1.5 * max(extents)
    return size if np.isfinite(size) and size > 0.0 else 0.01


def world_points(xy: Real, pose: Real) -> Real:
    """World coordinates (F, n, 2) of points (n, 2) of a link at its poses (F, 3)."""
    c, s = np.cos(pose[:, 2, None]), np.sin(pose[:, 2, None])
    x = pose[:, 0, None] + c * xy[:, 0] - s * xy[:, 1]
    y = pose[:, 1, None] + s * xy[:, 0] + c * xy[:, 1]
    return np.stack([x, y], axis=-1)


PointsByLink = Mapping[str, Mapping[str, Vec2]]  # link -> name of a point -> point, in the link's frame
Marks = Mapping[str, tuple[Vec2, ...]]  # link -> points of its outline that carry no pin
Cluster = tuple[dict[str, Vec2], str]  # link -> centre, and the owner of the pin


def _clusters(mechanism: Mechanism, joints: Sequence[LoopJoint]) -> list[Cluster]:
    """Revolute joints grouped by their axis: joints at the same point of a common link share one pin."""
    groups: list[Cluster] = []
    for joint in joints:
        if joint.kind == "revolute":
            new = {link: _xy(at) for link, at in zip(joint.links, (joint.a, joint.b), strict=True)}
            owner = mechanism.frame if mechanism.frame in new else joint.links[1]
        elif joint.kind == "pin_slot":
            owner = joint.links[1 - joint.guide]
            new = {owner: _xy(joint.a if joint.guide else joint.b)}
        else:
            continue
        rest: list[Cluster] = []
        for centres, old_owner in groups:
            if any(link in centres and _distance(centres[link], xy) < _SAME_AXLE for link, xy in new.items()):
                new = {**centres, **new}
                owner = mechanism.frame if mechanism.frame in new else old_owner
            else:
                rest.append((centres, old_owner))
        groups = [*rest, (new, owner)]
    return groups


def _marks(mechanism: Mechanism, points: PointsByLink, clusters: list[Cluster]) -> Marks:
    """Points of a link's outline without a pin: all named points, except those that only define a guide line."""
    lines = [joint for joint in mechanism.joints if isinstance(joint, Prismatic | PinSlot | Rolling)]
    guides = {(link, p) for joint in lines for link, p in zip(joint.links, joint.points, strict=True)}
    guides |= {(joint.links[1], joint.point) for joint in mechanism.joints if isinstance(joint, CamJoint) and joint.spatial is not
    None
               and joint.spatial.kind == "globoid"}  # fmt: skip
    wanted = set(mechanism.traced) | {(load.link, load.point) for load in mechanism.loads if isinstance(load, Force)}
    marks = {}
    for link, named in points.items():
        pins = [centres[link] for centres, _ in clusters if link in centres]
        kept: list[Vec2] = []
        for name, xy in named.items():
            if (link, name) in guides and (link, name) not in wanted:
                continue
            if all(_distance(xy, other) >= _SAME_AXLE for other in [*pins, *kept]):
                kept.append(xy)
        marks[link] = tuple(kept) if link != mechanism.frame else ()
    return marks


def _proportions(mechanism: Mechanism, links: Sequence[Link], clusters: list[Cluster], wheels: Wheels) -> Proportions:
    """Dimensions of plates from the mechanism's size (1), narrower if short links require it, but not below a least width.

    The least width is reduced if all links are much shorter than the mechanism, as in a long train.
    """
    shortest = min([1.0, *(1.3 * wheel.radius for wheel in wheels.wheels)])
    lengths = []
    for link in links:
        if link.name == mechanism.frame:
            continue
        pins = [centres[link.name] for centres, _ in clusters if link.name in centres]
        apart = [_distance(a, b) for i, a in enumerate(pins) for b in pins[:i]]
        shortest = min([shortest, *apart])
        lengths += [max(apart)] if apart else []
    wire = min(_LEAST_HALF_WIDTH, _LEAST_HALF_WIDTH * 8.0 * float(np.median(lengths))) if lengths else _LEAST_HALF_WIDTH
    r = float(np.clip(0.36 * shortest, wire, 0.033))
    t = 0.75 * r
    return Proportions(half_width=r, thickness=t, bevel=0.12 * t, boss=0.22 * t, clearance=0.12 * t)


def _axle(cluster: Cluster, clusters: list[Cluster], marks: Marks, size: Proportions) -> Axle:
    """An axle whose pin and bosses are small enough for the other pins and marks of its links."""
    centres, owner = cluster
    room = 10.0
    for link, xy in centres.items():
        others = [c[link] for c, _ in clusters if link in c and c is not centres]
        room = min([room, *(_distance(xy, other) for other in others)])
        room = min([room, *(1.3 * _distance(xy, mark) for mark in marks[link])])  # a mark needs less space than a pin
    room = max(room, 10.0 * _SAME_AXLE)
    return Axle(centres, owner, pin=min(0.4 * size.half_width, 0.3 * room), boss=min(0.82 * size.half_width, 0.46 * room))


def _play(axle: Axle, poses: Mapping[str, Real]) -> dict[str, float]:
    """Largest distance over the run of an axle's pin from the axis, by link, for links whose joints have clearance."""
    if axle.owner not in poses:
        return {}
    pin = world_points(np.array([axle.centres[axle.owner]]), poses[axle.owner])[:, 0]
    play = {}
    for link, centre in axle.centres.items():
        if link != axle.owner and link in poses:
            away = float(np.hypot(*(world_points(np.array([centre]), poses[link])[:, 0] - pin).T).max())
            if away > _SAME_AXLE:
                play[link] = away
    return play


def _keyed(axle: Axle, cams: Sequence[CamDrawing], welds: Sequence[Weldment], frame: str, r: float) -> Axle:
    """The axle as a shaft keyed to the first plane cam on it, thicker than a pin if nothing else is on it; or keyed to a link to
    which another one is welded there, such as a hand crank. Other axles are unchanged."""
    for cam in cams:
        at = axle.centres.get(cam.cam)
        if cam.placed.bed is not None or at is None or _distance(at, cam.bore) > _SAME_AXLE:
            continue
        keyed = replace(axle, owner=cam.cam, key=_xy(cam.placed.mount / abs(cam.placed.mount)))
        rim = min(Point(c.bore).distance(c.profile.exterior) for c in cams if c.cam == cam.cam)
        thick = set(axle.centres) == {frame, cam.cam} and rim > 1.5 * _CAM_HUB_RADIUS * r and axle.boss > 0.8 * r
        return replace(keyed, pin=_CAMSHAFT_RADIUS * r, boss=_CAM_HUB_RADIUS * r) if thick else keyed
    for weld in welds:
        for link, other, at in zip(weld.links, weld.links[::-1], weld.points, strict=True):
            on = frame != link in axle.centres and _distance(axle.centres[link], at) < _SAME_AXLE
            if on and frame in axle.centres and other not in axle.centres:
                return replace(axle, owner=link, key=(1.0, 0.0))
    return axle


def _travel(joint: LoopJoint, poses: Mapping[str, Real]) -> tuple[float, float]:
    """Range over the run of the other link's point along the guide of a joint, from the guide's point."""
    if not poses:
        return (-_DEFAULT_TRAVEL, _DEFAULT_TRAVEL)
    carrier, other = joint.links[joint.guide], joint.links[1 - joint.guide]
    origin, slider = (joint.b, joint.a) if joint.guide else (joint.a, joint.b)
    base, pose = poses[carrier], poses[other]
    turn = np.exp(1j * base[:, 2])
    away = pose[:, 0] + 1j * pose[:, 1] + slider * np.exp(1j * pose[:, 2]) - base[:, 0] - 1j * base[:, 1] - origin * turn
    moved = np.real(away * np.conj((joint.slide or 1.0) * turn))
    return (float(moved.min()), float(moved.max()))


def _slot(joint: LoopJoint, poses: Mapping[str, Real], ends: Vec2 | None) -> Slot:
    """The slot of a pin-in-slot joint, with the stated ``ends``, otherwise with the travel over the run."""
    origin, point = (joint.b, joint.a) if joint.guide else (joint.a, joint.b)
    return Slot(
        joint=joint.name,
        link=joint.links[joint.guide],
        pin=joint.links[1 - joint.guide],
        origin=_xy(origin),
        along=_xy(joint.slide or 1.0 + 0j),
        point=_xy(point),
        travel=_travel(joint, poses) if ends is None else ends,
    )


def _guide(
    mechanism: Mechanism,
    joint: LoopJoint,
    poses: Mapping[str, Real],
    clusters: list[Cluster],
    marks: Marks,
    size: Proportions,
) -> Guide:
    """The guide of a prismatic joint: which link is drawn as the rail and which as the block, and the travel of the block.

    The link with the guide line is the rail, unless it is only a block at a pin while the other one is long (an oscillating
    cylinder: the guide rotates about a fixed pin and a rod slides through it).
    """
    carrier, other = joint.links[joint.guide], joint.links[1 - joint.guide]
    origin, slider = (_xy(joint.b), _xy(joint.a)) if joint.guide else (_xy(joint.a), _xy(joint.b))
    along = _xy(joint.slide or 1.0 + 0j)
    # The second link's frame is rotated by ``angle`` relative to the first's.
    slider_along = _turn(along, -joint.angle if joint.guide == 0 else joint.angle)
    travel = _travel(joint, poses)

    def compact(link: str, at: Vec2) -> bool:
        if any(isinstance(p, Prismatic) and p.name != joint.name and p.links[p.guide] == link for p in mechanism.joints):
            return False
        pins = [centres[link] for centres, _ in clusters if link in centres]
        return all(_distance(xy, at) < 2.0 * size.half_width for xy in [*pins, *marks[link]])

    other_is_long = other == mechanism.frame or not compact(other, slider)
    if carrier != mechanism.frame and compact(carrier, origin) and other_is_long:
        return Guide(joint.name, other, carrier, slider, slider_along, origin, along, (-travel[1], -travel[0]))
    return Guide(joint.name, carrier, other, origin, along, slider, slider_along, travel)


def _distance(a: Vec2, b: Vec2) -> float:
    return float(np.hypot(a[0] - b[0], a[1] - b[1]))


def _turn(v: Vec2, angle: float) -> Vec2:
    c, s = float(np.cos(angle)), float(np.sin(angle))
    return (c * v[0] - s * v[1], s * v[0] + c * v[1])
