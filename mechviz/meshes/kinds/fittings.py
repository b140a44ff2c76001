"""Pins in slots, welds and cylinders: on which layers they lie and how they are drawn."""

from __future__ import annotations

import numpy as np
from shapely import affinity
from shapely.geometry import Point, Polygon

from mechcore.spec.mechanism import Vec2
from mechviz.meshes import outline
from mechviz.meshes.draft import Draft, Neck, Piece, joined
from mechviz.meshes.kinds.cylinders import Telescope
from mechviz.meshes.model import Model, Slot, Weldment

_SEAM = 0.05  # width of the seam between plates that are welded, in half widths of a plate


# --- pins in slots ------------------------------------------------------------------------------------------------------


def _pin_axle(model: Model, slot: Slot) -> int:
    """The axle whose pin slides in a slot."""
    return next(
        k
        for k, axle in enumerate(model.axles)
        if slot.pin in axle.centres and np.hypot(*np.subtract(axle.centres[slot.pin], slot.point)) < 1e-6
    )


def group_slots(model: Model, draft: Draft) -> None:
    """A pin reaches through the layer of the slot that it slides in."""
    for slot in model.slots:
        group = f"rails of {slot.joint}" if slot.link == model.frame else draft.groups[slot.link]
        draft.through.setdefault(_pin_axle(model, slot), set()).add(group)


def slot_of(model: Model, slot: Slot) -> Polygon:
    """The opening in a slotted plate: the path of the pin with a little play."""
    axle = model.axles[_pin_axle(model, slot)]
    low, high = slot.travel
    margin = 0.12 * model.proportions.r
    ends = [_along(slot.origin, slot.along, s) for s in (low - margin, high + margin)]
    return outline.hull([(end, 1.06 * axle.pin) for end in ends], model.segments)


def draw_slots(model: Model, draft: Draft) -> None:
    """Slots of the ground: two rails with a roller on the pin between them."""
    r = model.proportions.r
    for slot in model.slots:
        if slot.link != model.frame:
            continue
        group = f"rails of {slot.joint}"
        low, high = slot.travel
        strips = outline.guide_rails(slot.origin, slot.along, low - 1.6 * r, high + 1.6 * r, 1.15 * r, r)
        draft.pieces += [Piece(model.frame, strip, group, "rail") for strip in strips]
        draft.pieces.append(Piece(slot.pin, outline.disc(slot.point, 1.12 * r, model.segments), group, "block"))


# --- welds --------------------------------------------------------------------------------------------------------------


def join_welds(model: Model, draft: Draft, plates: dict[str, Polygon]) -> None:
    """Welded plates lie flush: on one layer, the second cut to the edge of the first; else on two, with a stud between them."""
    r = model.proportions.r
    for weld in model.welds:
        if model.frame in weld.links:
            side = weld.links.index(model.frame)
            other = weld.links[1 - side]
            held = any(wheel.kind == "ring" for wheel in model.wheels.wheels if wheel.link == other)
            if other in plates and not held:
                draft.fixed_blocks.append((weld.points[side], draft.groups[other]))
            continue
        first, second = weld.links
        a, b = draft.groups[first], draft.groups[second]
        if a == b and not {first, second} <= set(plates):
            continue
        cut = _cut(model, weld, plates) if {first, second} <= set(plates) and not joined(model, draft, a, b) else None
        if cut is not None:
            plates[second] = cut
            draft.merge(b, a)
        elif a != b:
            draft.necks.append(Neck(first, outline.disc(weld.points[0], 0.75 * r, model.segments), (a, b)))


def _cut(model: Model, weld: Weldment, plates: dict[str, Polygon]) -> Polygon | None:
    """The second plate without what the first one covers; None if that cuts away a place for one of its pins."""
    first, second = weld.links
    (ax, ay), (bx, by) = weld.points
    moved = affinity.translate(plates[first], -ax, -ay)
    moved = affinity.translate(affinity.rotate(moved, -weld.angle, origin=(0.0, 0.0), use_radians=True), bx, by)
    left = outline.polygons(plates[second].difference(moved.buffer(_SEAM * model.proportions.r)))
    if not left or left[0].area < 0.3 * plates[second].area:
        return None
    whole = left[0]
    if all(
        whole.contains(Point(axle.centres[second]).buffer(axle.hole_in(second))) for axle in model.axles if second in axle.centres
    ):
        return whole
    return None


# --- cylinders ----------------------------------------------------------------------------------------------------------


def group_telescopes(model: Model, draft: Draft) -> None:
    """Barrel and rod lie on one layer."""
    for telescope in model.telescopes:
        draft.merge(draft.groups[telescope.rod], draft.groups[telescope.barrel])


def lug(model: Model, link: str) -> list[outline.Disc]:
    """What the plate of a barrel or rod needs beside its pin to hold on to the round part."""
    r = model.proportions.r
    for telescope in model.telescopes:
        if link in (telescope.barrel, telescope.rod):
            pin, direction = telescope.line(link)
            return [(_along(pin, direction, 1.05 * r if link == telescope.barrel else -1.05 * r), 0.45 * r)]
    return []


def draw_telescopes(model: Model, draft: Draft) -> None:
    for telescope in model.telescopes:
        group = draft.groups[telescope.barrel]
        mates = frozenset([telescope.joint])
        ends = ((telescope.barrel, "barrel"), (telescope.rod, "rod"))
        for (link, kind), profile in zip(ends, _profiles(model, telescope), strict=True):
            xs, radii = [x for _, x in profile], [radius for radius, _ in profile]
            low, high, radius = min(xs), max(xs), max(radii)
            line = telescope.line(link)
            shape = outline.rectangle(_along(*line, 0.5 * (low + high)), line[1], high - low, 2.0 * radius, 0.0)
            draft.pieces.append(Piece(link, shape, group, kind, mates, profile=profile, line=line))


def _profiles(model: Model, telescope: Telescope) -> tuple[tuple[Vec2, ...], tuple[Vec2, ...]]:
    """Profiles (radius, x) of the barrel, a cup, and of the rod with its piston, x along their line from their pins.

    Barrel and rod are as long as the shortest length of the cylinder allows; where its stroke is longer than they can cover, the
    rod is longer still and comes out at the other end.
    """
    size = model.proportions
    r = size.r
    outer = 0.5 * size.t + 0.85 * size.boss
    bore, rod, piston = 0.76 * outer, 0.45 * outer, 0.7 * outer
    low, high = telescope.travel
    start = 0.85 * r  # of the barrel, from its pin: inside the lug
    floor = start + 0.9 * r  # beyond the lug
    end = max(low - 1.7 * r, floor + 1.2 * r)
    length = max(low - floor - 0.15 * r, high - end + 0.9 * r, 1.5 * r)  # of the rod, from its pin
    barrel = ((0.0, start), (outer, start), (outer, end), (bore, end), (bore, floor), (0.0, floor))
    head = 0.5 * r
    bar = ((0.0, -length), (piston, -length), (piston, head - length), (rod, head - length), (rod, -0.85 * r), (0.0, -0.85 * r))
    return barrel, bar


def _along(origin: Vec2, along: Vec2, s: float) -> Vec2:
    return (origin[0] + s * along[0], origin[1] + s * along[1])
