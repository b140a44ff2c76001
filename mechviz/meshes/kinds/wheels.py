"""Round parts that roll, mesh or carry belts: the wheels of a mechanism, their numbers of teeth and the phases of the teeth.

Lengths are in units of the mechanism's size. Points of a link are in its own frame; plane vectors inside this module are
complex numbers.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from dataclasses import field, replace
from typing import Literal

import numpy as np

from mechcore.arrays import Real, Vec2
from mechcore.joints.base import Builder, point_of
from mechcore.records import dataclass
from mechcore.spec.mechanism import Belt, Gear, Mechanism, Prismatic, Rack, Rolling

_FEWEST_TEETH, _MOST_TEETH = 6, 400  # integer sizes within these bounds are taken as numbers of teeth
_USUAL_TEETH = range(16, 49)  # candidates for the teeth of the smallest wheel if none are stated
_RACK_PINION = 20  # teeth of a pinion that meshes with racks only
_SAME_SIZE = 1e-6

PosesByLink = Mapping[str, Real]


@dataclass(frozen=True)
class Wheel:
    """A disc, gear wheel, ring or pulley on a link."""

    link: str
    centre: Vec2  # in the link's frame
    radius: float  # of the rolling or pitch circle
    kind: Literal["gear", "ring", "pulley", "roller"]
    joints: tuple[str, ...]  # in which it takes part
    teeth: int = 0
    angle: float = 0.0  # pressure angle [rad]
    phase: float = 0.0  # angle of a tooth in the link's frame [rad]
    pinion: int = 0  # of a ring: teeth of a pinion that runs in it

    @property
    def module(self) -> float:
        return 2.0 * self.radius / self.teeth


@dataclass(frozen=True)
class RackBar:
    """A rack. Its pitch line passes through ``origin`` in the direction ``along``; teeth point to the left of it."""

    link: str
    joint: str
    slider: str
    carrier: str
    origin: Vec2
    along: Vec2
    contact: tuple[float, float]  # range of the pitch point on the pitch line over the run, from ``origin``
    wheel: int  # number of its pinion
    phase: float = 0.0  # position of a tooth along the line, from ``origin``


@dataclass(frozen=True)
class Track:
    """The straight edge on which a wheel rolls: through ``origin`` along ``along``, with the wheel on its left."""

    link: str
    joint: str
    origin: Vec2
    along: Vec2
    travel: tuple[float, float]  # range of the contact, from ``origin``
    wheel: int


@dataclass(frozen=True)
class BeltDrive:
    """A belt or chain around two pulleys, in the frame of their carrier."""

    carrier: str
    joint: str
    centres: tuple[Vec2, Vec2]
    wheels: tuple[int, int]
    crossed: bool


@dataclass(frozen=True)
class Wheels:
    """All round parts of a mechanism; ``meshes``: pairs of wheels that mesh."""

    wheels: tuple[Wheel, ...] = ()
    meshes: tuple[tuple[int, int], ...] = ()
    racks: tuple[RackBar, ...] = ()
    tracks: tuple[Track, ...] = ()
    belts: tuple[BeltDrive, ...] = ()
    carriers: frozenset[str] = frozenset()  # links that carry meshing wheels

    def wheels_on(self, link: str) -> list[int]:
        """Numbers of the wheels of a link."""
        return [k for k, wheel in enumerate(self.wheels) if wheel.link == link]


@dataclass
class _Finder:
    mechanism: Mechanism
    parts: Builder
    size: float
    poses: PosesByLink  # in units of the size
    wheels: list[Wheel] = field(default_factory=list)
    meshes: list[tuple[int, int, complex, complex]] = field(default_factory=list)  # wheels, world directions to the pitch point
    racks: list[tuple[RackBar, complex, float]] = field(default_factory=list)  # bar; direction to it, angle (world)
    tracks: list[Track] = field(default_factory=list)
    belts: list[BeltDrive] = field(default_factory=list)

    def point(self, link: str, name: str) -> complex:
        return point_of(self.parts.links[link], name) / self.size

    def pose(self, link: str) -> Real:
        """Poses (F, 3) of a link; at rest at the origin if the motion is not known."""
        return self.poses.get(link, np.zeros((1, 3)))

    def turn(self, link: str) -> float:
        """Angle of a link at the start [rad]."""
        return float(self.pose(link)[0, 2])

    def axes(self, joint: Gear | Belt) -> tuple[list[complex], list[complex]]:
        """Axes of both wheels, in the frame of the carrier, and in the frames of the wheels' links."""
        axes = [self.parts.axis_between(joint, link, joint.carrier) for link in joint.links]
        return [on_carrier / self.size for on_carrier, _ in axes], [own / self.size for _, own in axes]

    def add(self, wheel: Wheel) -> int:
        """Add a wheel and return its number; equal wheels in two joints are one wheel."""
        for k, old in enumerate(self.wheels):
            same = (old.link, old.kind) == (wheel.link, wheel.kind) and abs(old.radius - wheel.radius) < _SAME_SIZE
            if (
                same
                and math.dist(old.centre, wheel.centre) < _SAME_SIZE
                and (old.teeth == wheel.teeth or 0 in (old.teeth, wheel.teeth))
            ):
                self.wheels[k] = replace(old, teeth=max(old.teeth, wheel.teeth), joints=(*old.joints, *wheel.joints))
                return k
        self.wheels.append(wheel)
        return len(self.wheels) - 1

    def add_gear(self, joint: Gear) -> None:
        (c1, c2), own = self.axes(joint)
        n1, n2 = joint.sizes
        total = n2 - n1 if joint.internal else n1 + n2
        distance = abs(c2 - c1)
        stated = all(float(n).is_integer() and _FEWEST_TEETH <= n <= _MOST_TEETH for n in joint.sizes)
        kinds: tuple[Literal["gear", "ring"], ...] = ("gear", "ring" if joint.internal else "gear")
        wheels = [
            self.add(
                Wheel(
                    link=link,
                    centre=(at.real, at.imag),
                    radius=n * distance / total,
                    kind=kind,
                    joints=(joint.name,),
                    teeth=int(n) if stated else 0,
                    angle=joint.pressure_angle,
                )
            )
            for link, at, n, kind in zip(joint.links, own, joint.sizes, kinds, strict=True)
        ]
        outward = (c2 - c1) / distance * cmath.exp(1j * self.turn(joint.carrier))
        first = -outward if joint.internal else outward
        self.meshes.append((wheels[0], wheels[1], first, first if joint.internal else -outward))

    def add_belt(self, joint: Belt) -> None:
        centres, own = self.axes(joint)
        first, second = (
            self.add(Wheel(link, (at.real, at.imag), radius / self.size, "pulley", (joint.name,)))
            for link, at, radius in zip(joint.links, own, joint.radii, strict=True)
        )
        c1, c2 = ((c.real, c.imag) for c in centres)
        self.belts.append(BeltDrive(joint.carrier, joint.name, (c1, c2), (first, second), joint.crossed))

    def add_rolling(self, joint: Rolling) -> None:
        edge, wheel = joint.links
        over, centre = (self.point(link, name) for link, name in zip(joint.links, joint.points, strict=True))
        radius = joint.radius / self.size
        number = self.add(Wheel(wheel, (centre.real, centre.imag), radius, "roller", (joint.name,)))
        sign = 1.0 if joint.side == "left" else -1.0  # the track has the wheel on its left
        along = sign * complex(*joint.along) / abs(complex(*joint.along))
        origin = over - 1j * radius * along
        seen = self.relative_path(wheel, centre, edge)
        s = np.real((seen - over) * np.conj(along)) if self.poses else np.zeros(1)
        travel = (float(s.min()), float(s.max()))
        self.tracks.append(Track(edge, joint.name, (origin.real, origin.imag), (along.real, along.imag), travel, number))

    def relative_path(self, link: str, point: complex, other: str) -> Real:
        """Positions (F,) of a point of a link in the frame of another link over the run."""
        pose, base = self.pose(link), self.pose(other)
        world = pose[:, 0] + 1j * pose[:, 1] + point * np.exp(1j * pose[:, 2])
        return np.asarray((world - base[:, 0] - 1j * base[:, 1]) * np.exp(-1j * base[:, 2]))

    def add_rack(self, joint: Rack) -> None:
        pinion, bar = joint.links
        slider = next(p for p in self.mechanism.joints if p.name == joint.slider)
        assert isinstance(slider, Prismatic)
        carrier = slider.links[0] if slider.links[1] == bar else slider.links[1]
        on_carrier, at = (z / self.size for z in self.parts.axis_between(joint, pinion, carrier))
        wheel = Wheel(pinion, (at.real, at.imag), joint.radius / self.size, "gear", (joint.name,), angle=joint.pressure_angle)
        number = self.add(wheel)
        along = complex(*slider.along) / abs(complex(*slider.along))
        # direction of the guide in the carrier's and in the rack's frame
        twist = cmath.exp(1j * (slider.angle if slider.links[1] == bar else -slider.angle))
        on_bar = along if slider.links[slider.guide] == bar else along / twist
        guide = on_bar * twist
        sign = 1.0 if joint.side == "left" else -1.0
        contact = on_carrier - 1j * sign * guide * wheel.radius
        touch = self.relative_path(carrier, contact, bar)
        along = sign * on_bar  # teeth on its left, towards the pinion
        origin = complex(touch[0])
        s = np.real((touch - origin) * np.conj(along))
        made = RackBar(
            link=bar,
            joint=joint.name,
            slider=joint.slider,
            carrier=carrier,
            origin=(origin.real, origin.imag),
            along=(along.real, along.imag),
            contact=(float(s.min()), float(s.max())),
            wheel=number,
        )
        towards = -1j * sign * guide * cmath.exp(1j * self.turn(carrier))
        self.racks.append((made, towards, cmath.phase(sign * guide * cmath.exp(1j * self.turn(carrier)))))

    def number_teeth(self) -> None:
        """Set the teeth of every wheel that meshes: as stated, from a neighbour's module, or chosen."""
        toothed = [k for k, wheel in enumerate(self.wheels) if wheel.kind in ("gear", "ring")]
        while True:
            self._spread()
            bare = [k for k in toothed if not self.wheels[k].teeth]
            if not bare:
                break
            train = self._train(bare[0])
            radii = [self.wheels[k].radius for k in train]
            least = min(radii)
            if len(train) == 1:
                teeth = _RACK_PINION
            else:
                teeth = min(_USUAL_TEETH, key=lambda z: max(abs(z * r / least - round(z * r / least)) for r in radii) + 0.002 * z)
            first = train[radii.index(least)]
            self.wheels[first] = replace(self.wheels[first], teeth=teeth)
        for i, j, _, _ in self.meshes:
            if self.wheels[j].kind == "ring":
                self.wheels[j] = replace(self.wheels[j], pinion=self.wheels[i].teeth)

    def _train(self, start: int) -> list[int]:
        """All wheels that mesh with a wheel, directly or through others."""
        train, queue = [start], [start]
        while queue:
            k = queue.pop()
            for i, j, _, _ in self.meshes:
                for here, there in ((i, j), (j, i)):
                    if here == k and there not in train:
                        train.append(there)
                        queue.append(there)
        return train

    def _spread(self) -> None:
        """Set teeth of wheels that mesh with a wheel of known teeth, such that their modules are equal."""
        grew = True
        while grew:
            grew = False
            for i, j, _, _ in self.meshes:
                for known, other in ((i, j), (j, i)):
                    a, b = self.wheels[known], self.wheels[other]
                    if a.teeth and not b.teeth:
                        teeth = max(_FEWEST_TEETH, round(a.teeth * b.radius / a.radius))
                        self.wheels[other] = replace(b, teeth=teeth)
                        grew = True

    def set_phases(self) -> None:
        """Set the phases, so that teeth of one wheel are in the tooth spaces of the other at the start.

        If wheels mesh in a closed circuit (sun, planets, ring), the last mesh fits automatically if the train can be assembled with
        these numbers of teeth at all.
        """
        settled: set[int] = set()
        for start in range(len(self.wheels)):
            if start in settled or not self.wheels[start].teeth:
                continue
            settled.add(start)
            queue = [start]
            while queue:
                known = queue.pop(0)
                for i, j, at_i, at_j in self.meshes:
                    if known not in (i, j) or {i, j} <= settled:
                        continue
                    other = j if known == i else i
                    here, there = (at_i, at_j) if known == i else (at_j, at_i)
                    # both tooth positions are measured in the direction in which the rim of the first wheel moves
                    sense = {i: 1.0, j: 1.0 if self.wheels[j].kind == "ring" else -1.0}
                    offset = sense[known] * self._offset(known, here) + 0.5 * math.pi * self.wheels[i].module
                    wheel = self.wheels[other]
                    phase = sense[other] * offset / wheel.radius + cmath.phase(there) - self.turn(wheel.link)
                    self.wheels[other] = replace(wheel, phase=math.remainder(phase, 2.0 * math.pi / wheel.teeth))
                    settled.add(other)
                    queue.append(other)

    def _offset(self, k: int, towards: complex) -> float:
        """Arc of the pitch circle from the pitch point to a tooth at the start, counter-clockwise."""
        wheel = self.wheels[k]
        turned = math.remainder(wheel.phase + self.turn(wheel.link) - cmath.phase(towards), 2.0 * math.pi / wheel.teeth)
        return wheel.radius * turned

    def phased_racks(self) -> tuple[RackBar, ...]:
        """The racks, with phases such that their teeth are in the tooth spaces of their pinions at the start."""
        out = []
        for bar, towards, direction in self.racks:
            wheel = self.wheels[bar.wheel]
            sign = (1j * towards * cmath.exp(-1j * direction)).real  # direction of the rim at the pitch point, along the bar
            offset = sign * self._offset(bar.wheel, towards) + 0.5 * math.pi * wheel.module
            out.append(replace(bar, phase=math.remainder(offset, math.pi * wheel.module)))
        return tuple(out)


def find_wheels(mechanism: Mechanism, parts: Builder, size: float, poses: PosesByLink) -> Wheels:
    """Wheels, racks, tracks and belts of a mechanism; ``poses`` (F, 3) in units of the size, empty if not known."""
    finder = _Finder(mechanism, parts, size, poses)
    for joint in mechanism.joints:
        if isinstance(joint, Gear):
            finder.add_gear(joint)
        elif isinstance(joint, Belt):
            finder.add_belt(joint)
        elif isinstance(joint, Rolling):
            finder.add_rolling(joint)
        elif isinstance(joint, Rack):
            finder.add_rack(joint)
    finder.number_teeth()
    finder.set_phases()
    meshes = tuple((i, j) for i, j, _, _ in finder.meshes)
    carriers = frozenset(joint.carrier for joint in mechanism.joints if isinstance(joint, Gear | Belt))
    return Wheels(tuple(finder.wheels), meshes, finder.phased_racks(), tuple(finder.tracks), tuple(finder.belts), carriers)
