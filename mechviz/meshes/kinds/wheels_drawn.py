"""Gear wheels, ring gears, racks, pulleys with their belts, and rolling wheels: their layers and their shapes.

Wheels that mesh share a layer. A wheel that is wide enough to hold all pins of its link is the link's plate; other wheels of
the link lie on layers of their own, and a hub joins them to its plate.
"""

from __future__ import annotations

import numpy as np
from shapely import affinity
from shapely.geometry import LineString, Point, Polygon
from shapely.ops import unary_union

from mechcore.arrays import Vec2
from mechcore.errors import Fault, MechanismError
from mechviz.meshes import outline
from mechviz.meshes.draft import Neck, PlacedPart, SolidsDraft
from mechviz.meshes.kinds.rims import ADDENDUM, DEDENDUM, BeltLoop, external_wheel, rack_teeth, ring_teeth
from mechviz.meshes.kinds.wheels import BeltDrive, RackBar, Track, Wheel
from mechviz.meshes.model import ScaledMechanism, world_points

_WHEEL_GAP = 0.02  # between a wheel and its track, a belt and its pulley; in half widths of a plate
_FLANGE_HEIGHT = 1.6  # height of a pulley's flanges above the floor of its groove, in thicknesses of its belt
MOST_TEETH = 1_000  # of a rack: each tooth is part of every operation on its outline
_RIM_WIDTH = 2.2  # width of a ring's rim, in half widths of a plate


def group_wheels(model: ScaledMechanism, draft: SolidsDraft) -> set[str]:
    """Merge the groups of meshing wheels; return the links that need no plate in addition to their wheels."""
    wheels = model.wheels
    plain: set[str] = set()
    for link in dict.fromkeys(wheel.link for wheel in wheels.wheels):
        home = _plate_wheel(model, link)
        for k in wheels.wheels_on(link):
            draft.wheels += [""] * (k + 1 - len(draft.wheels))
            draft.wheels[k] = link if k == home else f"wheel {k} of {link}"
        if home is not None or _has_web(model, link):
            plain.add(link)
    for i, j in (*wheels.meshes, *(belt.wheels for belt in wheels.belts)):
        draft.merge(draft.wheels[j], draft.wheels[i])
    for bar in wheels.racks:
        if _is_plain(model, bar):
            plain.add(bar.link)
            draft.merge(draft.groups[bar.link], draft.wheels[bar.wheel])
    for k, wheel in enumerate(wheels.wheels):
        for number, axle in enumerate(model.axles):
            at = axle.centres.get(wheel.link)
            if at is not None and np.hypot(at[0] - wheel.centre[0], at[1] - wheel.centre[1]) < 1e-9 and wheel.kind != "ring":
                draft.through.setdefault(number, set()).add(draft.wheels[k])
    return plain


def draw_wheels(model: ScaledMechanism, draft: SolidsDraft) -> None:
    """Add the pieces of all wheels, racks, tracks and belts."""
    for k, wheel in enumerate(model.wheels.wheels):
        group = draft.wheels[k]
        mates = frozenset(wheel.joints) if wheel.kind in ("gear", "ring") else frozenset()
        kind = "plate" if wheel.kind != "ring" and draft.groups.get(wheel.link) == group else "wheel"
        groove = _FLANGE_HEIGHT * _belt(model) if wheel.kind == "pulley" else 0.0
        draft.pieces.append(PlacedPart(wheel.link, _body(model, wheel), group, kind, mates, groove=groove))
        _fix_wheel(model, draft, k)
    for bar in model.wheels.racks:
        _draw_rack(model, draft, bar)
    for track in model.wheels.tracks:
        _draw_track(model, draft, track)
    for belt in model.wheels.belts:
        _draw_belt(model, draft, belt)


def webs(model: ScaledMechanism, draft: SolidsDraft) -> list[str]:
    """Groups of the spoked discs that carry rotating ring gears."""
    rings = [(wheel, group) for wheel, group in zip(model.wheels.wheels, draft.wheels, strict=True) if wheel.kind == "ring"]
    own = [(draft.groups[wheel.link], group) for wheel, group in rings if wheel.link != model.frame]
    return [plate for plate, group in own if plate != group]


def rail_ends(model: ScaledMechanism, link: str) -> list[outline.Disc]:
    """Discs that extend the plate of a moving link to the tracks and racks that it carries on another layer."""
    r = model.proportions.half_width
    if link == model.frame:
        return []
    discs = []
    for track in model.wheels.tracks:
        if track.link == link:
            low, high = _track_span(model, track)
            discs += [(_at(track.origin, track.along, s, -0.5 * r), 0.8 * r) for s in (low, high)]
    for bar in model.wheels.racks:
        if bar.link == link:
            discs.append((_bar_hold(model, bar), 0.8 * r))
    return discs


# --- wheels -------------------------------------------------------------------------------------------------------------


def _root(model: ScaledMechanism, wheel: Wheel) -> float:
    """Radius of the solid body of a wheel: below its teeth, its groove or its tread; outside a ring's teeth."""
    if wheel.kind == "ring":
        return wheel.radius + DEDENDUM * wheel.module
    if wheel.kind == "gear":
        return wheel.radius - DEDENDUM * wheel.module
    if wheel.kind == "pulley":
        return wheel.radius - (0.5 + _WHEEL_GAP) * _belt(model)
    return wheel.radius - _WHEEL_GAP * model.proportions.half_width


def _belt(model: ScaledMechanism) -> float:
    """Thickness of all belts."""
    smallest = min((wheel.radius for wheel in model.wheels.wheels if wheel.kind == "pulley"), default=1.0)
    return min(0.4 * model.proportions.half_width, 0.2 * smallest)


def _plate_wheel(model: ScaledMechanism, link: str) -> int | None:
    """The number of the wheel that is a link's plate: the widest one that holds all its pins and marks; None if none does."""
    r = model.proportions.half_width
    if link == model.frame or _guided(model, link):
        return None
    wheels = model.wheels.wheels
    for k in sorted(model.wheels.wheels_on(link), key=lambda k: -wheels[k].radius):
        wheel = wheels[k]
        if wheel.kind == "ring":
            if _is_fixed(model, link) and all(_axis_distance(at, wheel) < 0.5 * r for at in model.pins(link)):
                return k  # its rim is fixed to the ground
            continue
        room = _root(model, wheel)
        if all(
            _axis_distance(at, wheel) < room - 0.75 * r or _axis_distance(at, wheel) < 0.1 * r for at in model.pins(link)
        ) and all(
            _axis_distance(at, wheel) < 1.001 * wheel.radius + ADDENDUM * (wheel.module if wheel.teeth else 0.0)
            for at in model.marks[link]
        ):
            return k
    return None


def _guided(model: ScaledMechanism, link: str) -> bool:
    """Whether a link needs a plate for a guide or a slot."""
    return any(link in (guide.rail, guide.block) for guide in model.guides) or any(link == slot.link for slot in model.slots)


def _has_web(model: ScaledMechanism, link: str) -> bool:
    """Whether a link has a rotating ring gear, so that its plate is a spoked disc beside the teeth."""
    rings = any(model.wheels.wheels[k].kind == "ring" for k in model.wheels.wheels_on(link))
    return rings and not _is_fixed(model, link) and not _guided(model, link)


def _axis_distance(at: Vec2, wheel: Wheel) -> float:
    return float(np.hypot(at[0] - wheel.centre[0], at[1] - wheel.centre[1]))


def _is_fixed(model: ScaledMechanism, link: str) -> bool:
    """Whether a link is the ground or welded to it."""
    return link == model.frame or any(set(weld.links) == {link, model.frame} for weld in model.welds)


def _body(model: ScaledMechanism, wheel: Wheel) -> Polygon:
    """Outline of a wheel with its teeth and windows, in the link's frame."""
    size = model.proportions
    if wheel.kind == "ring":
        rim = (_root(model, wheel) + _RIM_WIDTH * size.half_width) / wheel.module
        return _in_link_frame(ring_teeth(wheel.teeth, wheel.pinion, wheel.angle, rim), wheel)
    if wheel.kind == "gear":
        whole = _in_link_frame(external_wheel(wheel.teeth, wheel.angle), wheel)
    else:
        flange = _FLANGE_HEIGHT * _belt(model) if wheel.kind == "pulley" else 0.0
        whole = Point(wheel.centre).buffer(_root(model, wheel) + flange, quad_segs=max(16, model.segments // 2))
    holes = _windows(model, wheel)
    return outline.largest(whole.difference(unary_union(holes))) if holes else whole


def _in_link_frame(shape: Polygon, wheel: Wheel) -> Polygon:
    """A toothed outline, given in modules about its axis, in the link's frame, with a tooth at the wheel's phase."""
    turned = affinity.rotate(shape, wheel.phase, origin=(0.0, 0.0), use_radians=True)
    m = wheel.module
    return affinity.affine_transform(turned, [m, 0.0, 0.0, m, *wheel.centre])


def _windows(model: ScaledMechanism, wheel: Wheel) -> list[Polygon]:
    """Round holes, or openings between spokes, which make the rotation visible; clear of all pins."""
    size = model.proportions
    root = _root(model, wheel)
    outer = root - max(0.13 * root, 0.4 * size.half_width)
    inner = max(0.25 * root, 1.25 * size.half_width)
    keep = [outline.disc(at, size.half_width * 1.15, 24) for at in model.pins(wheel.link) if _axis_distance(at, wheel) > 1e-9]
    keep += [outline.disc(at, 0.6 * size.half_width, 24) for at in model.marks[wheel.link]]
    if outer - inner < 0.3 * size.half_width:
        return []
    if outer - inner < 3.0 * size.half_width:
        middle, radius = 0.5 * (outer + inner), 0.4 * (outer - inner)
        count = int(np.clip(2.0 * np.pi * middle / (3.2 * radius), 3, 6))
        angles = [wheel.phase + 2.0 * np.pi * (k + 0.5) / count for k in range(count)]
        holes = [
            outline.disc((wheel.centre[0] + middle * np.cos(a), wheel.centre[1] + middle * np.sin(a)), radius, model.segments)
            for a in angles
        ]
        return [hole for hole in holes if not any(hole.intersects(region) for region in keep)]
    count = 5 if outer < 9.0 * size.half_width else 6
    spokes = []
    for k in range(count):
        a = wheel.phase + 2.0 * np.pi * k / count
        far = (wheel.centre[0] + root * np.cos(a), wheel.centre[1] + root * np.sin(a))
        spokes.append(LineString([wheel.centre, far]).buffer(max(0.055 * root, 0.35 * size.half_width), cap_style="flat"))
    ring = Point(wheel.centre).buffer(outer, quad_segs=24).difference(Point(wheel.centre).buffer(inner, quad_segs=16))
    fillet = min(0.08 * root, 0.6 * size.half_width)
    opened = ring.difference(unary_union([*spokes, *keep])).buffer(-fillet, quad_segs=6).buffer(fillet, quad_segs=6)
    return [part for part in outline.polygons(opened) if part.area > 1.5 * size.half_width**2 and not part.interiors]


def _fix_wheel(model: ScaledMechanism, draft: SolidsDraft, k: int) -> None:
    """Fix a wheel to its link's plate, by a hub or a web, or to the ground."""
    wheel, size = model.wheels.wheels[k], model.proportions
    if wheel.kind == "ring" and _is_fixed(model, wheel.link):
        pose = model.poses[wheel.link][0] if model.frames and wheel.link != model.frame else np.zeros(3)
        (x, y) = world_points(np.array([wheel.centre]), pose[None])[0, 0]
        for side in (-0.62, 0.62):  # two feet
            reach = _root(model, wheel) + 0.5 * _RIM_WIDTH * size.half_width
            foot = (float(x + reach * np.sin(side)), float(y - reach * np.cos(side)))
            draft.fixed_blocks.append((foot, draft.wheels[k]))
        return
    if wheel.link == model.frame:
        if not any(_axis_distance(axle.centres[model.frame], wheel) < 1e-9 for axle in model.axles if model.frame in axle.centres):
            draft.fixed_blocks.append((wheel.centre, draft.wheels[k]))
        return
    own = draft.groups[wheel.link]
    if own == draft.wheels[k]:
        return
    if wheel.kind == "ring" and _has_web(model, wheel.link):
        _web(model, draft, wheel, draft.wheels[k])
        return
    hub = outline.disc(wheel.centre, min(1.1 * size.half_width, 0.8 * _root(model, wheel)), model.segments)
    draft.necks.append(Neck(wheel.link, hub, (own, draft.wheels[k])))


def _web(model: ScaledMechanism, draft: SolidsDraft, wheel: Wheel, group: str) -> None:
    """Add a spoked disc beside a rotating ring gear, joined to its rim."""
    size = model.proportions
    low, high = _root(model, wheel), _root(model, wheel) + _RIM_WIDTH * size.half_width
    rim = (
        Point(wheel.centre)
        .buffer(high, quad_segs=24)
        .difference(Point(wheel.centre).buffer(low + 0.2 * size.half_width, quad_segs=24))
    )
    arms = [
        LineString([wheel.centre, _polar(wheel, high - 0.9 * size.half_width, wheel.phase + 2.0 * np.pi * j / 3)]).buffer(
            0.7 * size.half_width
        )
        for j in range(3)
    ]
    held = [*model.pins(wheel.link), *model.marks[wheel.link]]
    arms += [outline.hull([(wheel.centre, size.half_width), (at, size.half_width)], model.segments) for at in held]
    hub = Point(wheel.centre).buffer(1.3 * size.half_width, quad_segs=12)
    draft.pieces.append(PlacedPart(wheel.link, outline.largest(unary_union([rim, hub, *arms])), draft.groups[wheel.link], "plate"))
    draft.necks.append(Neck(wheel.link, rim, (draft.groups[wheel.link], group)))


def _polar(wheel: Wheel, radius: float, angle: float) -> Vec2:
    return (wheel.centre[0] + radius * float(np.cos(angle)), wheel.centre[1] + radius * float(np.sin(angle)))


# --- racks, tracks, belts -----------------------------------------------------------------------------------------------


def _at(origin: Vec2, along: Vec2, s: float, left: float = 0.0) -> Vec2:
    return (origin[0] + s * along[0] - left * along[1], origin[1] + s * along[1] + left * along[0])


def _in_bar(bar: RackBar, at: Vec2) -> tuple[float, float]:
    """Coordinates along and to the left of a rack's pitch line."""
    dx, dy = at[0] - bar.origin[0], at[1] - bar.origin[1]
    return dx * bar.along[0] + dy * bar.along[1], dy * bar.along[0] - dx * bar.along[1]


def _bar_extent(model: ScaledMechanism, bar: RackBar) -> tuple[float, float, float]:
    """Range of a rack along its pitch line (low, high), and its depth below the line."""
    r, module = model.proportions.half_width, model.wheels.wheels[bar.wheel].module
    margin = 2.0 * np.pi * module
    low, high = bar.contact[0] - margin, bar.contact[1] + margin
    depth = DEDENDUM * module + 1.4 * r
    for at in model.pins(bar.link):
        s, left = _in_bar(bar, at)
        if left < -DEDENDUM * module:
            low, high, depth = min(low, s - r), max(high, s + r), max(depth, r - left)
    for at in model.marks[bar.link]:
        s, left = _in_bar(bar, at)
        if -depth < left < ADDENDUM * module:
            low, high = min(low, s), max(high, s)
    return low, high, depth


def _is_plain(model: ScaledMechanism, bar: RackBar) -> bool:
    """Whether the body of a rack holds all pins of its link, so that it is the plate."""
    module, r = model.wheels.wheels[bar.wheel].module, model.proportions.half_width
    if _guided(model, bar.link):
        return False
    return all(_in_bar(bar, at)[1] < -DEDENDUM * module - 0.8 * r for at in model.pins(bar.link))


def _bar_hold(model: ScaledMechanism, bar: RackBar) -> Vec2:
    """A point in the middle of a rack's body."""
    low, high, depth = _bar_extent(model, bar)
    return _at(bar.origin, bar.along, 0.5 * (low + high), -depth + 0.7 * model.proportions.half_width)


def _draw_rack(model: ScaledMechanism, draft: SolidsDraft, bar: RackBar) -> None:
    """Add the rack and, if its carrier is the ground, the rail on which its back slides. Raises `MechanismError` for more than
    `MOST_TEETH` teeth."""
    wheel, r = model.wheels.wheels[bar.wheel], model.proportions.half_width
    m, group = wheel.module, draft.wheels[bar.wheel]
    low, high, depth = _bar_extent(model, bar)
    teeth = (high - low) / (np.pi * m)
    if teeth > MOST_TEETH:
        words = f"its rack would have {teeth:,.0f} teeth, more than {MOST_TEETH:,}."
        raise MechanismError(
            Fault(
                f"joints.{bar.joint}",
                words,
                "Check the radius of the pinion, the travel of the rack and the points of its link, and their units.",
            )
        )
    shape = rack_teeth(low / m, high / m, bar.phase / m, wheel.angle, depth / m)
    a, b = bar.along
    shape = affinity.affine_transform(shape, [m * a, -m * b, m * b, m * a, *bar.origin])
    plain = draft.groups[bar.link] == group
    draft.pieces.append(PlacedPart(bar.link, shape, group, "plate" if plain else "wheel", frozenset([bar.joint])))
    if not plain:
        neck = outline.disc(_bar_hold(model, bar), 0.6 * r, model.segments)
        draft.necks.append(Neck(bar.link, neck, (draft.groups[bar.link], group)))
    if bar.carrier == model.frame and model.frames:
        half = 0.3 * (high - low)
        ends = [_at(bar.origin, bar.along, s, -depth - _WHEEL_GAP * r) for s in (-half, half)]
        start, end = world_points(np.array(ends), model.poses[bar.link][:1])[0]
        rail = outline.hatched_bar(tuple(start), tuple(end), r, thickness=0.42 * r)
        draft.pieces.append(PlacedPart(model.frame, rail, group, "rail"))


def _track_span(model: ScaledMechanism, track: Track) -> tuple[float, float]:
    margin = 0.6 * model.wheels.wheels[track.wheel].radius + model.proportions.half_width
    return track.travel[0] - margin, track.travel[1] + margin


def _draw_track(model: ScaledMechanism, draft: SolidsDraft, track: Track) -> None:
    """Add the rail on which a wheel rolls."""
    r, group = model.proportions.half_width, draft.wheels[track.wheel]
    low, high = _track_span(model, track)
    start, end = (_at(track.origin, track.along, s) for s in (low, high))
    if track.link == model.frame:
        draft.pieces.append(PlacedPart(model.frame, outline.hatched_bar(start, end, r, thickness=0.5 * r), group, "rail"))
        return
    middle = _at(track.origin, track.along, 0.5 * (low + high), -0.5 * r)
    shape = outline.rectangle(middle, track.along, high - low, r)
    draft.pieces.append(PlacedPart(track.link, shape, group, "wheel"))
    draft.necks.append(Neck(track.link, shape.buffer(-0.2 * r), (draft.groups[track.link], group)))


def find_loop(model: ScaledMechanism, belt: BeltDrive) -> BeltLoop:
    """The centre line of a belt, in sizes of the mechanism."""
    first, second = (model.wheels.wheels[k] for k in belt.wheels)
    c1, c2 = (complex(*c) for c in belt.centres)
    return BeltLoop(belt.joint, belt.carrier, first.link, (c1, c2), (first.radius, second.radius), belt.crossed, _belt(model))


def _draw_belt(model: ScaledMechanism, draft: SolidsDraft, belt: BeltDrive) -> None:
    """Add a closed belt around two pulleys, fixed to their carrier."""
    loop = find_loop(model, belt)
    first, span, second = loop.pieces
    around, _ = loop.at(np.concatenate([np.linspace(0.0, first, 97), first + span + np.linspace(0.0, second, 97)]))
    path = LineString([(z.real, z.imag) for z in [*around, around[0]]])
    shape = outline.largest(path.buffer(0.5 * loop.thick, quad_segs=4).simplify(0.01 * loop.thick))
    draft.pieces.append(PlacedPart(belt.carrier, shape, draft.wheels[belt.wheels[0]], "belt", height=(0.27, 0.73)))
