"""The flat pieces of links, before layers are known: plates, blocks, rails and necks between layers.

Pieces of one group lie on one layer. A small block that slides in a slot lies on the layer of the slotted link and
belongs to its group; the rails of the frame belong to the group of the block between them. All outlines are in the
frame of their link, in units of the mechanism's size.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from shapely.geometry import Point, Polygon
from shapely.ops import unary_union

from mechcore.arrays import Real, Vec2
from mechviz.meshes import outline
from mechviz.meshes.draft import Neck, PlacedPart, SolidsDraft, share_a_pin
from mechviz.meshes.extrude import Profile
from mechviz.meshes.kinds.cam_profiles import draw_inverse_cams
from mechviz.meshes.kinds.cams import draw_cams, group_cams
from mechviz.meshes.kinds.fittings import (
    draw_slots,
    draw_telescopes,
    group_slots,
    group_telescopes,
    join_welds,
    lug,
    slot_of,
)
from mechviz.meshes.kinds.wheels_drawn import draw_wheels, group_wheels, rail_ends
from mechviz.meshes.model import Guide, ScaledMechanism

_NUT_BORE = 1.06  # radius of a nut's bore, in radii of its spindle
_LEAST_LEAD, _THREAD_ROOT = 0.3, 0.82  # of a thread, in radii of its spindle: least lead that is drawn, root radius


def draft_pieces(model: ScaledMechanism) -> SolidsDraft:
    """The pieces of all links, with a form chosen for every guide."""
    model = replace(model, guides=tuple(_on_material(model, guide) for guide in model.guides))
    draft = SolidsDraft(groups={name: name for name in model.links if name != model.frame})
    plain = group_cams(model, draft, group_wheels(model, draft))
    group_telescopes(model, draft)
    group_slots(model, draft)
    forms = {guide.joint: _form(model, guide) for guide in model.guides}
    homes = _homes(model, draft, forms)
    turned = {_spindle_of(guide) for guide in model.leads if forms.get(guide) == "rails"}
    plates = {
        name: _plate(model, name, forms)
        for name in model.links
        if name != model.frame and name not in homes and name not in plain and name not in turned
    }
    join_welds(model, draft, plates)
    for guide in model.guides:
        _draw_guide(model, draft, guide, forms[guide.joint], at_home=homes.get(guide.block) == guide.joint)
    draw_wheels(model, draft)
    draw_cams(model, draft)
    draw_inverse_cams(model, draft)
    draw_telescopes(model, draft)
    draw_slots(model, draft)
    for name, shape in plates.items():
        draft.pieces.append(PlacedPart(name, shape, draft.groups[name], "plate"))
    for name in sorted(
        model.figures.keys() - plates.keys()
    ):  # of a stem of a follower, which has its plate from there, a wheel, a block
        _draw_figure(draft, name, model.figures[name])
    return draft


def _draw_figure(draft: SolidsDraft, link: str, figure: Polygon) -> None:
    """Add a figure to the plate of a link, or as a plate of its own if it has none."""
    for k, piece in enumerate(draft.pieces):
        if piece.link == link and piece.kind == "plate":
            draft.pieces[k] = replace(piece, outline=outline.largest(unary_union([piece.outline, figure])))
            return
    draft.pieces.append(PlacedPart(link, figure, draft.groups[link], "plate"))


def _form(model: ScaledMechanism, guide: Guide) -> str:
    """The form of a guide: "rails" beside a block, a "slot" in the rail's plate, or a "saddle" around a bar or a rod."""
    if guide.rail == model.frame:
        return "saddle" if model.spindle and guide.joint not in model.leads else "rails"
    if guide.block == model.frame and _straight(model, guide.rail, guide.origin, guide.along):
        return "saddle"
    slot = _slot(model, guide)
    for axle in model.axles:
        margin = axle.boss + 0.15 * model.proportions.half_width
        if guide.rail in axle.centres and slot.distance(Point(axle.centres[guide.rail])) < margin:
            return "saddle"  # the block passes a pin of its rail
    return "slot"


def _on_material(model: ScaledMechanism, guide: Guide) -> Guide:
    """The guide with its block moved along the guide line, away from the slots of its own link.

    A block may be at any position along its line. The middle of a yoke's slot is convenient for equations, but there is no material
    to which a block could be attached: the block is moved to the nearest pin or mark on the line, otherwise to a point just beside
    the slot.
    """
    r = model.proportions.half_width
    slots = [_slot(model, g) for g in model.guides if g.rail == guide.block and _form(model, g) == "slot"]
    slots += [slot_of(model, slot) for slot in model.slots if slot.link == guide.block]

    def free(s: float) -> bool:
        place = Point(_along(guide.block_point, guide.block_along, s))
        return all(slot.distance(place) > 1.1 * r for slot in slots)

    if guide.block == model.frame or free(0.0):
        return guide
    points = [*model.pins(guide.block), *model.marks[guide.block]]
    along, across = _coordinates(points, guide.block_point, guide.block_along)
    on_line = [float(s) for s, lateral in zip(along, across, strict=True) if abs(lateral) < r]
    steps = [sign * k * r for k in range(1, 60) for sign in (1.0, -1.0)]
    for s in [*sorted(on_line, key=abs), *steps]:
        if free(s):
            low, high = guide.travel
            point = _along(guide.block_point, guide.block_along, s)
            return replace(guide, block_point=point, travel=(low + s, high + s))
    return guide


def _homes(model: ScaledMechanism, draft: SolidsDraft, forms: Mapping[str, str]) -> dict[str, str]:
    """The joint of the rail on whose layer a block lies, by block, for blocks without a plate; merges their groups with the
    rail's."""
    homes: dict[str, str] = {}
    for guide in model.guides:
        block, rail = guide.block, guide.rail
        if block == model.frame or block in homes or forms[guide.joint] == "saddle" or not _compact(model, guide):
            continue
        if rail == model.frame:
            homes[block] = guide.joint
            continue
        old, new = draft.groups[block], draft.groups[rail]
        if old != new and not share_a_pin(model, draft, old, new):
            homes[block] = guide.joint
            draft.merge(old, new)
    return homes


def _draw_guide(model: ScaledMechanism, draft: SolidsDraft, guide: Guide, form: str, *, at_home: bool) -> None:
    """Add the block (or jaws) of a guide and, on the frame, its rails."""
    r = model.proportions.half_width
    if form == "rails":
        group = draft.groups[guide.block] if at_home else f"rails of {guide.joint}"
        block = _block(model, guide, half_width=1.25 * r, whole=at_home)
        screw = guide.joint in model.leads
        line, bore = (guide.block_point, guide.block_along), _NUT_BORE * _spindle_radius(model) if screw else 0.0
        draft.pieces.append(
            PlacedPart(guide.block, block, group, "block", frozenset(model.spindles(guide.block)), line=line, bore=bore)
        )
        low, high = _span(model, guide, whole=at_home)
        if screw:
            _draw_spindle(model, draft, guide, group, (low, high))
        strips = outline.guide_rails(guide.origin, guide.along, low, high, 1.25 * r, r)
        draft.pieces += [PlacedPart(model.frame, strip, group, "rail") for strip in strips]
    elif guide.block == model.frame:
        group = draft.groups[guide.rail]
        if form == "saddle":
            strips = outline.guide_rails(guide.block_point, guide.block_along, -1.6 * r, 1.6 * r, r, r)
            draft.pieces += [PlacedPart(model.frame, strip, group, "rail") for strip in strips]
        else:
            draft.pieces.append(PlacedPart(model.frame, _block(model, guide, _die(model), whole=False), group, "block"))
            draft.fixed_blocks.append((guide.block_point, group))
        return
    elif form == "slot":
        group = draft.groups[guide.rail]
        draft.pieces.append(PlacedPart(guide.block, _block(model, guide, _die(model), whole=at_home), group, "block"))
    else:
        group = f"rails of {guide.joint}" if guide.rail == model.frame else draft.groups[guide.rail]
        if guide.rail == model.frame:
            _draw_rod(model, draft, guide, group)
        elif not _straight(model, guide.rail, guide.origin, guide.along):
            return  # jaws would collide with the plate: the block only lies on it
        for side in (1.0, -1.0):
            jaw = _beside(guide.block_point, guide.block_along, side * 1.35 * r, 2.0 * model.proportions.block, 0.5 * r)
            draft.pieces.append(PlacedPart(guide.block, jaw, group, "block"))
            # narrower than the jaw: no two parts may share a vertex, even if the jaw is too fine for a bevel
            neck = _beside(guide.block_point, guide.block_along, side * 1.35 * r, 1.96 * model.proportions.block, 0.46 * r)
            draft.necks.append(Neck(guide.block, neck, (draft.groups[guide.block], group)))
        return
    if not at_home:
        neck = outline.rectangle(guide.block_point, guide.block_along, 1.3 * r, 1.1 * r, 0.2 * r)
        draft.necks.append(Neck(guide.block, neck, (draft.groups[guide.block], group)))


def _draw_rod(model: ScaledMechanism, draft: SolidsDraft, guide: Guide, group: str) -> None:
    """Add a rod of the ground between the jaws of its block, which includes the guide's own point."""
    size = model.proportions
    low, high = _span(model, guide, whole=False)
    low, high = min(low, 1.3 * size.half_width), max(high, 1.3 * size.half_width)
    radius = min(0.5 * size.thickness, 0.55 * size.half_width)
    bar = outline.rectangle(_along(guide.origin, guide.along, 0.5 * (low + high)), guide.along, high - low, 2.0 * radius, 0.0)
    profile = ((0.0, low), (radius, low), (radius, high), (0.0, high))
    draft.pieces.append(PlacedPart(model.frame, bar, group, "rod", profile=profile, line=(guide.origin, guide.along)))


def _draw_spindle(model: ScaledMechanism, draft: SolidsDraft, guide: Guide, group: str, span: tuple[float, float]) -> None:
    """Add the threaded spindle of a screw through its nut, which includes the guide's own point, and its bearing."""
    size = model.proportions
    low, high = min(span[0], -1.5 * size.half_width), max(span[1], 1.5 * size.half_width)
    radius = _spindle_radius(model)
    bar = outline.rectangle(_along(guide.origin, guide.along, 0.5 * (low + high)), guide.along, high - low, 2.0 * radius, 0.0)
    turns = _threads(low, high, model.leads[guide.joint], radius)
    profile = ((0.0, low), *turns, (0.0, high))
    line = (guide.origin, guide.along)
    mates = frozenset([guide.joint])
    draft.pieces.append(PlacedPart(model.frame, bar, group, "rod", mates, profile=profile, line=line))
    shaft = outline.disc((0.0, 0.0), 0.3 * radius, model.segments)  # within the rod: the turning link itself
    draft.groups[_spindle_of(guide.joint)] = group
    draft.pieces.append(PlacedPart(_spindle_of(guide.joint), shaft, group, "block", mates))
    if span[0] > 0.8 * size.half_width:  # if there is space beside the nut
        bearing = outline.rectangle(guide.origin, guide.along, 0.7 * size.half_width, 1.9 * size.half_width, 0.15 * size.half_width)
        draft.pieces.append(PlacedPart(model.frame, bearing, group, "block", mates))


def _spindle_radius(model: ScaledMechanism) -> float:
    """Radius of a screw's spindle, such that its nut fits on the layer."""
    return min(0.41 * model.proportions.thickness, 0.5 * model.proportions.half_width)


def _spindle_of(guide: str) -> str:
    """Name of the link that rotates in the guide of a screw."""
    return f"{guide.removesuffix('.slide')}.spindle"


def _threads(low: float, high: float, lead: float, radius: float) -> Profile:
    """Profile of a thread with its lead, but at least `_LEAST_LEAD`."""
    count = max(int((high - low) / max(lead, _LEAST_LEAD * radius)), 1)
    x = np.linspace(low, high, 2 * count + 1)
    return tuple((radius * (1.0 if k % 2 == 0 else _THREAD_ROOT), float(at)) for k, at in enumerate(x))


def _plate(model: ScaledMechanism, link: str, forms: Mapping[str, str]) -> Polygon:
    """The plate of a link: around its pins, marks and guides, with slots, and with cut-outs where it is wide."""
    size = model.proportions
    discs: list[outline.Disc] = [(xy, size.half_width) for xy in model.pins(link)]
    discs += [(xy, 0.6 * size.half_width) for xy in model.marks[link]]
    extra: list[Polygon] = []
    slots: list[Polygon] = []
    for guide in model.guides:
        form = forms[guide.joint]
        if guide.rail == link:
            low, high = _span(model, guide, whole=form == "slot")
            radius = size.slotted if form == "slot" else size.half_width
            discs += [(_along(guide.origin, guide.along, s), radius) for s in (low, high)]
            if form == "slot":
                slots.append(_slot(model, guide))
        elif guide.block == link:
            discs.append((guide.block_point, size.half_width))
            if form == "saddle":
                length, width = 2.0 * size.block, 3.2 * size.half_width
                extra.append(outline.rectangle(guide.block_point, guide.block_along, length, width, 0.3 * size.half_width))
    for slot in model.slots:
        if slot.link == link:
            low, high = slot.travel
            discs += [(_along(slot.origin, slot.along, s), size.half_width) for s in (low, high)]
            slots.append(slot_of(model, slot))
    discs += [(weld.points[weld.links.index(link)], size.half_width) for weld in model.welds if link in weld.links]
    discs += rail_ends(model, link) + lug(model, link)
    discs += [(end, 0.7 * size.half_width) for drawing in model.inverse_cams if drawing.driven == link for end in drawing.ends]
    if not discs:
        discs = [((0.0, 0.0), size.half_width)]
    figure = [model.figures[link]] if link in model.figures else []
    whole = unary_union([outline.hull(discs, model.segments), *extra, *figure])
    axles = [axle for axle in model.axles if link in axle.centres]
    keep = [outline.disc(axle.centres[link], axle.boss + 0.4 * size.half_width, model.segments) for axle in axles]
    keep += [outline.disc(xy, 0.6 * size.half_width, model.segments) for xy in model.marks[link]]
    keep += [slot.buffer(0.6 * size.half_width) for slot in slots] + [shape.buffer(0.3 * size.half_width) for shape in extra]
    keep += [outline.disc(g.block_point, size.half_width, model.segments) for g in model.guides if g.block == link]
    holes = [] if figure else outline.cutouts(whole, keep, 1.35 * size.half_width, 0.45 * size.half_width, 7.0 * size.half_width**2)
    cut = whole.difference(unary_union([*slots, *holes])) if slots or holes else whole
    return outline.largest(cut)


def _compact(model: ScaledMechanism, guide: Guide) -> bool:
    """Whether a block needs no plate: it belongs to no other guide and has no slot, and its pins and marks are close together on
    its centre line."""
    if any(drawing.driven == guide.block for drawing in model.inverse_cams) or any(s.link == guide.block for s in model.slots):
        return False
    if any(guide.block in (other.rail, other.block) and other.joint != guide.joint for other in model.guides):
        return False
    r = model.proportions.half_width
    points = [*model.pins(guide.block), *model.marks[guide.block]]
    s, lateral = _coordinates(points, guide.block_point, guide.block_along)
    wide = 0.5 * r if guide.rail == model.frame else 0.1 * r
    long = 14.0 * r if guide.rail == model.frame else 5.0 * r
    return bool(np.all(np.abs(lateral) <= wide)) and float(np.ptp([0.0, *s])) <= long


def _straight(model: ScaledMechanism, link: str, origin: Vec2, along: Vec2) -> bool:
    """Whether a link is a plain bar along a line, so that jaws can slide along its sides."""
    _, lateral = _coordinates([*model.pins(link), *model.marks[link]], origin, along)
    rails = [g for g in model.guides if link in (g.rail, g.block)]
    return bool(np.all(np.abs(lateral) <= 0.02 * model.proportions.half_width)) and len(rails) == 1


def _coordinates(points: list[Vec2], origin: Vec2, along: Vec2) -> tuple[Real, Real]:
    """Coordinates along and across (to the left of) a line, of points in the same frame."""
    d = np.array(points, float).reshape(-1, 2) - origin
    return d @ np.array(along), d @ np.array([-along[1], along[0]])


def _extent(model: ScaledMechanism, guide: Guide, *, whole: bool) -> tuple[float, float]:
    """Range of a block along its guide, from its own point; ``whole``: it carries all pins of its link."""
    half = model.proportions.block
    points = [*model.pins(guide.block), *model.marks[guide.block]] if whole and guide.block != model.frame else []
    s, _ = _coordinates(points, guide.block_point, guide.block_along)
    if len(s) == 0:
        s = np.zeros(1)
    return float(s.min()) - half, float(s.max()) + half


def _span(model: ScaledMechanism, guide: Guide, *, whole: bool) -> tuple[float, float]:
    """Range of the guide line that the block covers over the run, with a margin, from the guide's origin."""
    low, high = _extent(model, guide, whole=whole and _compact(model, guide))
    margin = 0.45 * model.proportions.half_width
    return guide.travel[0] + low - margin, guide.travel[1] + high + margin


def _slot(model: ScaledMechanism, guide: Guide) -> Polygon:
    low, high = _span(model, guide, whole=True)
    middle = _along(guide.origin, guide.along, 0.5 * (low + high))
    return outline.rectangle(middle, guide.along, high - low, 2.0 * model.proportions.slot, 0.35 * model.proportions.half_width)


def _die(model: ScaledMechanism) -> float:
    """Half the width of a block in a slot."""
    return model.proportions.slot - 0.05 * model.proportions.half_width


def _block(model: ScaledMechanism, guide: Guide, half_width: float, *, whole: bool) -> Polygon:
    low, high = _extent(model, guide, whole=whole)
    middle = _along(guide.block_point, guide.block_along, 0.5 * (low + high))
    width = 2.0 * half_width - 0.1 * model.proportions.half_width if guide.rail == model.frame else 2.0 * half_width
    return outline.rectangle(middle, guide.block_along, high - low, width, 0.2 * model.proportions.half_width)


def _beside(point: Vec2, along: Vec2, lateral: float, length: float, width: float) -> Polygon:
    return outline.rectangle(_offset(point, along, lateral), along, length, width, 0.1 * width)


def _along(origin: Vec2, along: Vec2, s: float) -> Vec2:
    return (origin[0] + s * along[0], origin[1] + s * along[1])


def _offset(point: Vec2, along: Vec2, lateral: float) -> Vec2:
    return (point[0] - lateral * along[1], point[1] + lateral * along[0])
