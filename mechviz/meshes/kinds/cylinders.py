"""Cylinders: which sliding joints are drawn as barrel and rod, and in which line these lie."""

from __future__ import annotations

import cmath
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mechcore.joints.base import LoopJoint
from mechcore.spec.mechanism import Cylinder, Mechanism, Prismatic, Revolute, Vec2

_SAME = 1e-6  # of the mechanism's size


@dataclass(frozen=True)
class Telescope:
    """Barrel and rod of a cylinder. A line is a pin and the direction from the barrel's pin to the rod's, in the link's frame."""

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
    """The cylinders of a mechanism, in units of its size, and the sliding joints that are one in all but name.

    Such a joint joins two moving links that have nothing else than a pin each, on the line along which they slide, and whose pins
    never come close to each other. Where nothing drives the joint and only one of the links is more than its pin, that one is a
    lever with a block on it, and drawn as one.
    """
    named = {joint.name for joint in mechanism.joints if isinstance(joint, Cylinder)}
    found = []
    for joint in sliding:
        if joint.name in named:
            found.append(Telescope(joint.name, joint.links[0], joint.links[1], travels[joint.name]))
            continue
        telescope = _in_all_but_name(mechanism, joints, joint, marks, travels[joint.name])
        if telescope is not None and telescope.travel[0] > 3.0 * r:
            found.append(telescope)
    return tuple(found)


def _in_all_but_name(
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
    places: dict[str, float] = {}  # of the pin along the line
    pins: dict[str, complex] = {}
    for link, (origin, direction) in lines.items():
        pin = _only_pin(mechanism, joints, joint.name, link)
        if pin is None:
            return None
        on_line = [(complex(*xy) - origin) / direction for xy in (*marks[link], (pin.real, pin.imag))]
        if any(abs(z.imag) > _SAME for z in on_line):
            return None
        places[link], pins[link] = on_line[-1].real, pin
    driven = any(drive.joint == joint.name for drive in mechanism.drives)
    long = [bool(marks[link]) or abs(pins[link] - lines[link][0]) > _SAME for link in lines]
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
    """Where the pins of a link are, if it has nothing else beside a joint and all of them are at one place."""
    if any(link in p.links and p.name != joint and not isinstance(p, Revolute) for p in mechanism.joints):
        return None
    at = [j.b if j.links[1] == link else j.a for j in joints if j.kind == "revolute" and link in j.links]
    return at[0] if at and all(abs(z - at[0]) < _SAME for z in at) else None


def _pinned_to(mechanism: Mechanism, link: str, other: str) -> bool:
    return any(not isinstance(p, Prismatic) and {link, other} <= set(p.links) for p in mechanism.joints)
