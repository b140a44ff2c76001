"""Cams and their followers: profiles on hubs, rollers in forks, knife edges, flat faces, mushrooms and yokes, stems in guides.

A cam, the head of its follower and, if the guide stands on the ground, the stem with its rails lie on one layer. Heads of other
followers lie on the cam's layer and are attached to the plate of their link. Lengths are in units of the mechanism's size.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from shapely.geometry import Point, Polygon, box
from shapely.ops import unary_union

from mechcore.arrays import Complex
from mechcore.cams.closures import breadth
from mechcore.cams.followers import Arc, Flat, Oscillating, Roller
from mechcore.records import dataclass
from mechviz.meshes import outline
from mechviz.meshes.draft import Neck, PlacedPart, SolidsDraft, share_a_pin
from mechviz.meshes.kinds.cam_profiles import CamDrawing
from mechviz.meshes.model import ScaledMechanism

_PROFILE_POINTS = 1080  # points of a profile
_ROLLER_SIDES = 256  # sides of a roller, which must be as accurate as the profile
_ROLLER_CLEARANCE = 0.06  # between a roller and the floor of its groove, in thicknesses of a plate
_CHEEK_HEIGHT = 0.2  # height of the cheeks of a fork, in thicknesses of a plate


# -- layers ---------------------------------------------------------------------------------------------------------------


def group_cams(model: ScaledMechanism, draft: SolidsDraft, taken: set[str]) -> set[str]:
    """Merge the groups of cams and their followers; return the links that need no plate of their own, including those ``taken``."""
    plain = set(taken)
    for drawing in model.spatial_cams:  # its shaft lies in the plane of motion: it has no layer of its own
        plain.add(drawing.cam)
        draft.merge(draft.groups[drawing.cam], draft.groups[drawing.follower])
    for cam in model.cams:
        group = f"cam {cam.joint}" if cam.mate_of is None else f"second cam {cam.joint}"
        home = cam.cam not in plain and cam.cam != model.frame and _holds(model, cam)
        if home:
            plain.add(cam.cam)
            group = draft.groups[cam.cam]
        draft.cams.append(group)
        if cam.grounded and cam.follower not in plain:
            plain.add(cam.follower)
            own = draft.groups[cam.follower]
            if not _before(cam) and own != group and not share_a_pin(model, draft, own, group):
                draft.merge(own, draft.cams[-1])
        for number, axle in enumerate(model.axles):
            at = axle.centres.get(cam.cam)
            if at is not None and math.dist(at, cam.bore) < 1e-9:
                draft.through.setdefault(number, set()).add(draft.cams[-1])
    return plain


def _before(cam: CamDrawing) -> bool:
    """Whether the follower's stem lies in front of the cam, with only its roller on the cam's layer."""
    return cam.placed.groove or cam.placed.mate is not None


def _holds(model: ScaledMechanism, cam: CamDrawing) -> bool:
    """Whether all pins of the cam's link are inside the profile."""
    r = model.proportions.half_width
    own = [at for at in (*model.pins(cam.cam), *model.marks[cam.cam]) if math.dist(at, cam.bore) > 1e-9]
    guided = any(cam.cam in (g.rail, g.block) for g in model.guides)
    return not guided and all(cam.profile.contains(Point(at).buffer(0.7 * r)) for at in own)


# -- drawing --------------------------------------------------------------------------------------------------------------


def draw_cams(model: ScaledMechanism, draft: SolidsDraft) -> None:
    """Add the pieces of all cams and followers."""
    for k, cam in enumerate(model.cams):
        group = draft.cams[k]
        home = draft.groups.get(cam.cam) == group and not any(
            p.link == cam.cam and p.kind == "plate" and p.group == group for p in draft.pieces
        )
        _draw_cam(model, draft, cam, group, home=home)
        if cam.grounded:
            _draw_stem(model, draft, cam, group)
        else:
            _draw_head(model, draft, cam, group)
        if cam.bed:
            _draw_bed(model, draft, cam, group)


def _draw_cam(model: ScaledMechanism, draft: SolidsDraft, cam: CamDrawing, group: str, *, home: bool) -> None:
    r = model.proportions.half_width
    mates = frozenset([cam.joint])
    kind = "plate" if home else "wheel"
    draft.pieces.append(PlacedPart(cam.cam, cam.profile, group, kind, mates))
    if cam.placed.groove and not cam.bed:
        outer = _outer_flank(cam)
        rim = outer.buffer(1.4 * r, quad_segs=32)
        rim = outline.disc(cam.bore, max(math.dist(cam.bore, xy) for xy in rim.exterior.coords), _ROLLER_SIDES)
        draft.pieces.append(PlacedPart(cam.cam, rim.difference(outer), group, "wheel", mates))
        heads = [  # other pins through the cam need space for their heads
            outline.disc(a.centres[cam.cam], 1.06 * a.sleeve, model.segments)
            for a in model.axles
            if cam.cam in a.centres and math.dist(a.centres[cam.cam], cam.bore) > 1e-9
        ]
        floor = rim.buffer(-0.06 * r, quad_segs=32)  # so that its edges do not coincide with those of the rim
        floor = outline.largest(floor.difference(unary_union(heads))) if heads else floor
        draft.pieces.append(PlacedPart(cam.cam, floor, group, "disc", mates, height=(-_CHEEK_HEIGHT, 0.0)))
    if not home and cam.cam in draft.groups:
        draft.necks.append(Neck(cam.cam, outline.disc(cam.bore, 0.8 * r, model.segments), (draft.groups[cam.cam], group)))


def _outer_flank(cam: CamDrawing) -> Polygon:
    law = cam.placed.cam.law
    theta = law.start + law.length * np.arange(_PROFILE_POINTS) / _PROFILE_POINTS
    z = replace(cam.placed.cam, outer=True).at(theta).working
    w = (cam.placed.mount_origin + cam.placed.mount * z) / cam.size
    return Polygon(np.column_stack([w.real, w.imag])).buffer(0.0)


def _draw_bed(model: ScaledMechanism, draft: SolidsDraft, cam: CamDrawing, group: str) -> None:
    """Add the ground below a wedge, over its travel."""
    r, placed = model.proportions.half_width, cam.placed
    back = [(complex(x, y) - placed.mount_origin / cam.size) / placed.mount for x, y in cam.profile.exterior.coords]
    low, high, deep = min(z.real for z in back), max(z.real for z in back), min(z.imag for z in back)
    if model.frames:
        pose = model.poses[cam.cam]
        travel = ((pose[:, 0] + 1j * pose[:, 1]) * np.conj(placed.axes)).real
        at = np.array([[complex(x, y)] for x, y in cam.profile.exterior.coords])
        world = ((pose[:, 0] + 1j * pose[:, 1] + at * np.exp(1j * pose[:, 2])) - placed.centre / cam.size) * np.conj(placed.axes)
        low, high, deep = world.real.min(), world.real.max(), world.imag.min()
        low, high = low - 0.2 * r * bool(np.ptp(travel) > 0), high + 0.2 * r
    ends = [placed.centre / cam.size + placed.axes * complex(x, deep - 0.05 * r) for x in (high, low)]
    a, b = ((z.real, z.imag) for z in ends)
    bar = outline.hatched_bar(b, a, r, thickness=0.42 * r)
    draft.pieces.append(PlacedPart(model.frame, bar, group, "rail", frozenset([cam.joint])))


@dataclass(frozen=True, eq=False)
class _Head:
    """Head of a follower, relative to its point in the ground axes of the theory; ``top``: its height."""

    touching: Polygon
    top: float


def _cycle(cam: CamDrawing) -> Any:
    law = cam.placed.cam.law
    start, length = law.start, law.length
    if cam.placed.bed is not None:
        start, length = law.start + length / 3.0, length / 3.0
    return cam.placed.cam.at(start + length * np.arange(721) / 720)


def _head(model: ScaledMechanism, cam: CamDrawing) -> _Head:
    """The head of a follower; of an oscillating one in its position at ``theta``."""
    r, placed = model.proportions.half_width, cam.placed
    face, s = placed.cam.follower.face, _cycle(cam)
    if isinstance(face, Roller):
        return _Head(outline.disc((0.0, 0.0), face.radius / cam.size, _ROLLER_SIDES), face.radius / cam.size)
    turned = np.ones(s.angle.shape, complex)  # from the follower's position at every angle to that at theta
    here = placed.cam.at([cam.theta])
    if isinstance(placed.cam.follower.guide, Oscillating):
        pivot = placed.cam.follower.guide.pivot
        turned = (here.reference[0] - pivot) / (s.reference[0] - pivot)
    touch = (s.contact - s.reference[0]) * turned / cam.size
    normals = s.ground_normal * turned
    known = np.isfinite(normals)
    if isinstance(face, Flat):
        d = complex(placed.cam.follower.face_direction(here.motion[0])[0])
        n = 1j * d
        along = np.real(touch[known] * np.conj(d))
        low, high = float(along.min()) - 0.5 * r, float(along.max()) + 0.5 * r
        low = max(low, -face.left / cam.size) if math.isfinite(face.left) else min(low, -r)
        high = min(high, face.right / cam.size) if math.isfinite(face.right) else max(high, r)
        if placed.yoke:
            return _yoke(cam, r)
        corners = [low * d, high * d, high * d + 0.8 * r * n, low * d + 0.8 * r * n]
        return _Head(Polygon([(z.real, z.imag) for z in corners]), max(z.imag for z in corners))
    if isinstance(face, Arc):
        radius = face.radius / cam.size
        swings = isinstance(placed.cam.follower.guide, Oscillating)
        middle = complex(np.mean(normals[known])) if swings else 1j
        middle /= abs(middle)
        lean = np.angle(normals[known] * np.conj(middle))
        margin = min(0.35, 0.6 * r / radius)
        span = np.linspace(min(float(lean.min()), 0.0) - margin, max(float(lean.max()), 0.0) + margin, 121)
        arc = -radius * middle * np.exp(1j * span)
        rise = float(np.max(np.real(arc * np.conj(middle)))) + 0.7 * r
        ends = [z + (rise - (z * np.conj(middle)).real) * middle for z in (arc[-1], arc[0])]
        ring = [*arc, *ends]
        shape = Polygon([(z.real, z.imag) for z in ring]).buffer(0.0)
        if swings:  # a finger from the arc to its centre, where the arm is
            shape = unary_union([shape, outline.hull([((0.0, 0.0), 0.8 * r)], model.segments), _finger(arc, 0.8 * r)])
        return _Head(shape, max(z.imag for z in ring))
    steep = float(np.max(np.abs(s.pressure_angle[np.isfinite(s.pressure_angle)]), initial=0.0))
    half = min(math.radians(28.0), 0.6 * (0.5 * math.pi - steep))
    n = complex(normals[known].mean()) if isinstance(placed.cam.follower.guide, Oscillating) else 1j
    n /= abs(n)
    wide = 0.75 * r
    tall = wide / math.tan(half)
    ring = [0j, (tall - 1j * wide) * n, (tall + r - 1j * wide) * n, (tall + r + 1j * wide) * n, (tall + 1j * wide) * n]
    return _Head(Polygon([(z.real, z.imag) for z in ring]), tall + 0.5 * r)


def _finger(arc: Complex, half: float) -> Polygon:
    """A web that joins an arc to its centre, the origin, and does not extend beyond the arc."""
    return Polygon([(z.real, z.imag) for z in [*arc, 0j]]).union(
        Point(0.0, 0.0)
        .buffer(half)
        .union(Polygon([(z.real, z.imag) for z in arc]))
        .convex_hull.intersection(Point(0.0, 0.0).buffer(0.999 * float(np.abs(arc).min()), quad_segs=64))
    )


def _yoke(cam: CamDrawing, r: float) -> _Head:
    """A yoke around a cam of constant breadth."""
    b = breadth(cam.placed.cam.law).mean / cam.size
    e = cam.placed.offset / cam.size
    reach = max(math.dist(cam.bore, xy) for xy in cam.profile.exterior.coords) + 0.35 * r
    low, high = -reach - e, reach - e
    inner = Polygon([(low, -b), (high, -b), (high, 0.0), (low, 0.0)])
    return _Head(inner.buffer(0.8 * r, join_style="mitre").difference(inner), 0.8 * r)


def _draw_head(model: ScaledMechanism, draft: SolidsDraft, cam: CamDrawing, group: str) -> None:
    """Add the head alone, on the cam's layer, with a neck to the plate of the follower."""
    r = model.proportions.half_width
    head = _head(model, cam)
    shape = _moved(head.touching, complex(*cam.tip), cam.turn)
    draft.pieces.append(PlacedPart(cam.follower, shape, group, "wheel", frozenset([cam.joint])))
    if draft.groups.get(cam.follower) != group and cam.follower in draft.groups:
        inside = shape.buffer(-0.12 * r)
        neck = outline.disc(cam.tip, 0.6 * r, model.segments).intersection(inside if not inside.is_empty else shape)
        if neck.is_empty:
            neck = inside if not inside.is_empty else shape
        draft.necks.append(Neck(cam.follower, outline.largest(neck), (draft.groups[cam.follower], group)))


def _draw_stem(model: ScaledMechanism, draft: SolidsDraft, cam: CamDrawing, group: str) -> None:
    """Add a translating follower in a guide on the ground: head, stem and rails."""
    r, placed = model.proportions.half_width, cam.placed
    head, mates = _head(model, cam), frozenset([cam.joint])
    own = draft.groups[cam.follower]
    half = 0.75 * r
    s = _cycle(cam)
    lowest, highest = float(s.motion[0].min()) / cam.size, float(s.motion[0].max()) / cam.size
    points = [
        (complex(*at) - complex(*cam.tip)) / cam.turn
        for at in (*model.pins(cam.follower), *model.marks[cam.follower])
        if math.dist(at, cam.tip) > 1e-9
    ]
    bottom = min([head.top - 0.05 * r, *(z.imag for z in points if z.imag > head.top)])
    fork = isinstance(placed.cam.follower.face, Roller)
    if placed.mate is not None:
        bottom = min([0.0, *(z.imag for z in points)]) - 0.8 * r
    elif fork:
        bottom = head.top * 1.12
    low = highest + head.top + 0.7 * r
    if fork:
        cheek = outline.hull([((0.0, 0.0), 0.42 * head.top), ((0.0, bottom + 0.9 * r), 0.8 * half)], model.segments)
        wide = cheek.difference(box(-half, -10.0, half, 10.0))  # the part that does not fit between the rails
        if not wide.is_empty:
            low = max(low, highest + wide.bounds[3] + 0.1 * r)
    at_guide = _guide_height(model, cam)
    if at_guide - 2.0 * r > low:
        low = at_guide - 2.0 * r
    if _before(cam) and not cam.bed:  # in front of the disc
        low = max(low, highest + 2.2 * r)
    high = low + 4.0 * r
    top = max([high - lowest + 1.4 * r, *(z.imag + 0.6 * r for z in points)])
    stem: list[Any] = [Polygon([(-half, bottom), (half, bottom), (half, top), (-half, top)])]
    for z in points:
        if abs(z.real) > 0.1 * half and z.imag > bottom:
            stem.append(outline.hull([((0.0, z.imag), half), ((z.real, z.imag), 0.6 * r)], model.segments))
    if fork:
        rod = unary_union(stem)
        if placed.mate is None:
            rod = rod.difference(outline.disc((0.0, 0.0), 1.06 * head.top, _ROLLER_SIDES))
        roller = _moved(head.touching, complex(*cam.tip), cam.turn)
        height = (_ROLLER_CLEARANCE, 1.0) if placed.groove else (0.0, 1.0)  # clear of the groove's floor
        draft.pieces.append(PlacedPart(cam.follower, roller, group, "wheel", mates, height=height))
        if _before(cam):
            foot = (0.0, bottom + r) if placed.mate is None else (0.0, head.top)
            cheek = outline.hull([((0.0, 0.0), 0.6 * min(head.top, r)), (foot, half)], model.segments)
            rod = unary_union([rod, cheek])
            neck = outline.disc((0.0, 0.0), 0.45 * min(head.top, r), model.segments)
            draft.necks.append(Neck(cam.follower, _moved(neck, complex(*cam.tip), cam.turn), (own, group)))
        else:
            for height in ((-_CHEEK_HEIGHT, 0.02), (0.98, 1.0 + _CHEEK_HEIGHT)):
                draft.pieces.append(
                    PlacedPart(cam.follower, _moved(cheek, complex(*cam.tip), cam.turn), own, "wheel", mates, height=height)
                )
    else:
        rod = unary_union([head.touching, *stem])
        if own != group:
            draft.pieces.append(PlacedPart(cam.follower, _moved(head.touching, complex(*cam.tip), cam.turn), group, "wheel", mates))
            neck = head.touching.buffer(-0.1 * r)
            neck = outline.largest(neck if not neck.is_empty else head.touching)
            draft.necks.append(Neck(cam.follower, _moved(neck, complex(*cam.tip), cam.turn), (own, group)))
    whole = outline.largest(_moved(rod, complex(*cam.tip), cam.turn))
    draft.pieces.append(PlacedPart(cam.follower, whole, own, "plate", mates))
    offset = placed.offset / cam.size
    origin = placed.centre / cam.size + placed.axes * offset
    up = placed.axes * 1j
    strips = outline.guide_rails((origin.real, origin.imag), (up.real, up.imag), low, high, half, r)
    draft.pieces += [PlacedPart(model.frame, strip, own, "rail", mates) for strip in strips]


def _guide_height(model: ScaledMechanism, cam: CamDrawing) -> float:
    """Height of the guide's point on the ground above the cam's axis; -inf if it has none."""
    at = model.guide_points.get(cam.guide)
    return -math.inf if at is None else float(((complex(*at) - cam.placed.centre / cam.size) * np.conj(cam.placed.axes)).imag)


def _moved(shape: object, at: complex, turn: complex) -> Any:
    """A shape, given in the axes of the theory about the point ``at``, in the frame of a link."""
    from shapely import affinity

    c, s = turn.real, turn.imag
    return affinity.affine_transform(shape, [c, -s, s, c, at.real, at.imag])
