"""Cylinders, pins in slots and welds: the joints that are drawn as such, the layers of their parts, and their shapes."""

from __future__ import annotations

import cmath
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from shapely import affinity
from shapely.geometry import Point, Polygon

from mechcore.arrays import Vec2
from mechcore.joints.base import LoopJoint
from mechcore.records import dataclass
from mechcore.spec.mechanism import Cylinder, Mechanism, Prismatic, Revolute
from mechviz.meshes import outline
from mechviz.meshes.draft import Neck, PlacedPart, SolidsDraft, share_a_pin

if TYPE_CHECKING:
    from mechviz.meshes.model import ScaledMechanism, Slot, Weldment

_SEAM_WIDTH = 0.05  # width of the seam between welded plates, in half widths of a plate


# --- pins in slots ------------------------------------------------------------------------------------------------------


def _pin_axle(model: ScaledMechanism, slot: Slot) -> int:
    """The axle whose pin slides in a slot."""
    return next(
        k
        for k, axle in enumerate(model.axles)
        if slot.pin in axle.centres and np.hypot(*np.subtract(axle.centres[slot.pin], slot.point)) < 1e-6
    )


def group_slots(model: ScaledMechanism, draft: SolidsDraft) -> None:
    """Let the pin of every slot pass through the layer of the slot."""
    for slot in model.slots:
        group = f"rails of {slot.joint}" if slot.link == model.frame else draft.groups[slot.link]
        draft.through.setdefault(_pin_axle(model, slot), set()).add(group)


def slot_of(model: ScaledMechanism, slot: Slot) -> Polygon:
    """The opening in a slotted plate: the path of the pin with a small clearance."""
    axle = model.axles[_pin_axle(model, slot)]
    low, high = slot.travel
    margin = 0.12 * model.proportions.half_width
    ends = [_along(slot.origin, slot.along, s) for s in (low - margin, high + margin)]
    return outline.hull([(end, 1.06 * axle.pin) for end in ends], model.segments)


def draw_slots(model: ScaledMechanism, draft: SolidsDraft) -> None:
    """Add the slots of the ground: two rails, and between them a roller on the pin."""
    r = model.proportions.half_width
    for slot in model.slots:
        if slot.link != model.frame:
            continue
        group = f"rails of {slot.joint}"
        low, high = slot.travel
        strips = outline.guide_rails(slot.origin, slot.along, low - 1.6 * r, high + 1.6 * r, 1.15 * r, r)
        draft.pieces += [PlacedPart(model.frame, strip, group, "rail") for strip in strips]
        draft.pieces.append(PlacedPart(slot.pin, outline.disc(slot.point, 1.12 * r, model.segments), group, "block"))


# --- welds --------------------------------------------------------------------------------------------------------------


def with_welds_on_pins(model: ScaledMechanism) -> ScaledMechanism:
    """The mechanism with links that are welded at the axis of a pin added to that pin, like two cranks at the ends of a shaft."""
    axles = list(model.axles)
    for weld in model.welds:
        for k, axle in enumerate(axles):
            for link, at, other, there in zip(weld.links, weld.points, weld.links[::-1], weld.points[::-1], strict=True):
                shaft = link in axle.centres and np.hypot(*np.subtract(axle.centres[link], at)) < _SAME_PLACE
                if shaft and other not in axle.centres and model.frame not in weld.links:
                    axles[k] = replace(axle, centres={**axle.centres, other: there})
                    break
    return replace(model, axles=tuple(axles))


def join_welds(model: ScaledMechanism, draft: SolidsDraft, plates: dict[str, Polygon]) -> None:
    """Join welded plates: on one layer, with the second cut along the edge of the first, if possible; otherwise on two layers with
    a stud between them, unless a common pin joins them."""
    r = model.proportions.half_width
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
        cut = _cut(model, weld, plates) if {first, second} <= set(plates) and not share_a_pin(model, draft, a, b) else None
        if cut is not None:
            plates[second] = cut
            draft.merge(b, a)
        elif a != b and not _by_shaft(model, weld):
            draft.necks.append(Neck(first, outline.disc(weld.points[0], 0.75 * r, model.segments), (a, b)))


def _by_shaft(model: ScaledMechanism, weld: Weldment) -> bool:
    """Whether a pin joins two welded links."""
    ends = list(zip(weld.links, weld.points, strict=True))
    return any(
        all(link in axle.centres and np.hypot(*np.subtract(axle.centres[link], at)) < _SAME_PLACE for link, at in ends)
        for axle in model.axles
    )


def _cut(model: ScaledMechanism, weld: Weldment, plates: dict[str, Polygon]) -> Polygon | None:
    """The second plate without the part covered by the first; None if less than 30 % of it or not enough around a pin is left."""
    first, second = weld.links
    (ax, ay), (bx, by) = weld.points
    moved = affinity.translate(plates[first], -ax, -ay)
    moved = affinity.translate(affinity.rotate(moved, -weld.angle, origin=(0.0, 0.0), use_radians=True), bx, by)
    left = outline.polygons(plates[second].difference(moved.buffer(_SEAM_WIDTH * model.proportions.half_width)))
    if not left or left[0].area < 0.3 * plates[second].area:
        return None
    whole = left[0]
    if all(
        whole.contains(Point(axle.centres[second]).buffer(axle.hole_in(second))) for axle in model.axles if second in axle.centres
    ):
        return whole
    return None


# --- cylinders ----------------------------------------------------------------------------------------------------------


def group_telescopes(model: ScaledMechanism, draft: SolidsDraft) -> None:
    """Put barrel and rod on one layer."""
    for telescope in model.telescopes:
        draft.merge(draft.groups[telescope.rod], draft.groups[telescope.barrel])


def lug(model: ScaledMechanism, link: str) -> list[outline.Disc]:
    """The lug by which the plate of a barrel or rod is attached to the round part beside its pin; empty for other links."""
    r = model.proportions.half_width
    for telescope in model.telescopes:
        if link in (telescope.barrel, telescope.rod):
            pin, direction = telescope.line(link)
            return [(_along(pin, direction, 1.05 * r if link == telescope.barrel else -1.05 * r), 0.45 * r)]
    return []


def draw_telescopes(model: ScaledMechanism, draft: SolidsDraft) -> None:
    for telescope in model.telescopes:
        group = draft.groups[telescope.barrel]
        mates = frozenset([telescope.joint])
        ends = ((telescope.barrel, "barrel"), (telescope.rod, "rod"))
        for (link, kind), profile in zip(ends, _profiles(model, telescope), strict=True):
            xs, radii = [x for _, x in profile], [radius for radius, _ in profile]
            low, high, radius = min(xs), max(xs), max(radii)
            line = telescope.line(link)
            shape = outline.rectangle(_along(*line, 0.5 * (low + high)), line[1], high - low, 2.0 * radius, 0.0)
            draft.pieces.append(PlacedPart(link, shape, group, kind, mates, profile=profile, line=line))


def _profiles(model: ScaledMechanism, telescope: Telescope) -> tuple[tuple[Vec2, ...], tuple[Vec2, ...]]:
    """Profiles (radius, x) of the barrel, which is a cup, and of the rod with its piston; x along their line from their pins.

    Barrel and rod are as long as the shortest length of the cylinder allows. If its stroke is longer than they can cover, the rod
    is longer and emerges at the other end.
    """
    size = model.proportions
    r = size.half_width
    outer = 0.5 * size.thickness + 0.85 * size.boss
    bore, rod, piston = 0.76 * outer, 0.45 * outer, 0.7 * outer
    low, high = telescope.travel
    start = 0.85 * r  # of the barrel, from its pin: within the lug
    floor = start + 0.9 * r  # beyond the lug
    end = max(low - 1.7 * r, floor + 1.2 * r)
    length = max(low - floor - 0.15 * r, high - end + 0.9 * r, 1.5 * r)  # of the rod, from its pin
    barrel = ((0.0, start), (outer, start), (outer, end), (bore, end), (bore, floor), (0.0, floor))
    head = 0.5 * r
    bar = ((0.0, -length), (piston, -length), (piston, head - length), (rod, head - length), (rod, -0.85 * r), (0.0, -0.85 * r))
    return barrel, bar


def _along(origin: Vec2, along: Vec2, s: float) -> Vec2:
    return (origin[0] + s * along[0], origin[1] + s * along[1])


_SAME_PLACE = 1e-6  # of the mechanism's size


@dataclass(frozen=True)
class Telescope:
    """Barrel and rod of a cylinder. A line: position of a pin, and direction from the barrel's pin to the rod's, in the link's
    frame."""

    joint: str
    barrel: str
    rod: str
    travel: tuple[float, float]  # distance of the pins over the run
    barrel_line: tuple[Vec2, Vec2] = ((0.0, 0.0), (1.0, 0.0))
    rod_line: tuple[Vec2, Vec2] = ((0.0, 0.0), (1.0, 0.0))

    def line(self, link: str) -> tuple[Vec2, Vec2]:
        return self.barrel_line if link == self.barrel else self.rod_line


def find_telescopes(
    mechanism: Mechanism,
    joints: Sequence[LoopJoint],
    sliding: Sequence[LoopJoint],
    marks: Mapping[str, Sequence[Vec2]],
    travels: Mapping[str, tuple[float, float]],
    r: float,
) -> tuple[Telescope, ...]:
    """The cylinders of a mechanism, in units of its size, including prismatic joints that are equivalent to a cylinder.

    Such a joint connects two moving links that have nothing else but one pin each, on the line of sliding, and whose pins never
    come close to each other. If the joint is not driven and only one of the links is more than its pin, it is a lever with a block,
    and drawn as such.
    """
    named = {joint.name for joint in mechanism.joints if isinstance(joint, Cylinder)}
    telescopes = []
    for joint in sliding:
        if joint.name in named:
            telescopes.append(Telescope(joint.name, joint.links[0], joint.links[1], travels[joint.name]))
            continue
        telescope = _equivalent_telescope(mechanism, joints, joint, marks, travels[joint.name])
        if telescope is not None and telescope.travel[0] > 3.0 * r:
            telescopes.append(telescope)
    return tuple(telescopes)


def _equivalent_telescope(
    mechanism: Mechanism,
    joints: Sequence[LoopJoint],
    joint: LoopJoint,
    marks: Mapping[str, Sequence[Vec2]],
    travel: tuple[float, float],
) -> Telescope | None:
    guide, other = joint.links[joint.guide], joint.links[1 - joint.guide]
    if mechanism.frame in joint.links:
        return None
    along = joint.slide or 1 + 0j
    turn = cmath.exp(1j * (-joint.angle if joint.guide == 0 else joint.angle))
    lines = {guide: (joint.b if joint.guide else joint.a, along), other: (joint.a if joint.guide else joint.b, along * turn)}
    places: dict[str, float] = {}  # positions of the pins along the line
    pins: dict[str, complex] = {}
    for link, (origin, direction) in lines.items():
        pin = _only_pin(mechanism, joints, joint.name, link)
        if pin is None:
            return None
        on_line = [(complex(*xy) - origin) / direction for xy in (*marks[link], (pin.real, pin.imag))]
        if any(abs(z.imag) > _SAME_PLACE for z in on_line):
            return None
        places[link], pins[link] = on_line[-1].real, pin
    driven = any(drive.joint == joint.name for drive in mechanism.drives)
    long = [bool(marks[link]) or abs(pins[link] - lines[link][0]) > _SAME_PLACE for link in lines]
    if not driven and long[0] != long[1]:
        return None
    apart = places[other] - places[guide]
    low, high = travel[0] + apart, travel[1] + apart
    if low * high <= 0.0:
        return None
    sign = 1.0 if low > 0.0 else -1.0
    on_frame = [link for link in lines if _pinned_to(mechanism, link, mechanism.frame)]
    barrel = on_frame[0] if len(on_frame) == 1 else guide
    rod = other if barrel == guide else guide
    if barrel != guide:
        sign = -sign
    near, far = sorted((abs(low), abs(high)))

    def line(link: str) -> tuple[Vec2, Vec2]:
        direction = sign * lines[link][1]
        return (pins[link].real, pins[link].imag), (direction.real, direction.imag)

    return Telescope(joint.name, barrel, rod, (near, far), line(barrel), line(rod))


def _only_pin(mechanism: Mechanism, joints: Sequence[LoopJoint], joint: str, link: str) -> complex | None:
    """The position of the pins of a link if, apart from ``joint``, it has only revolute joints at one point; otherwise None."""
    if any(link in p.links and p.name != joint and not isinstance(p, Revolute) for p in mechanism.joints):
        return None
    at = [j.b if j.links[1] == link else j.a for j in joints if j.kind == "revolute" and link in j.links]
    return at[0] if at and all(abs(z - at[0]) < _SAME_PLACE for z in at) else None


def _pinned_to(mechanism: Mechanism, link: str, other: str) -> bool:
    return any(not isinstance(p, Prismatic) and {link, other} <= set(p.links) for p in mechanism.joints)
