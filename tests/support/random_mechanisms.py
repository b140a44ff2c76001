"""Random mechanisms of every kind, drawn in the world at their start, with random loads: `draw(kind, seed)` repeats itself.

A mechanism is drawn first and described afterwards: every link gets a frame of a random place and angle, and its points in
it, so that no angle of a frame is near zero by habit. The sketch holds the drawn poses, from which the assembly follows.
"""

from __future__ import annotations

import cmath
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mechcore.cams.followers import Arc, Flat, Knife, Roller
from mechcore.dynamics.events import EndStop, EventTrigger
from mechcore.laws.indicator import Compressor, IndicatorDiagram
from mechcore.laws.program import Segment, program
from mechcore.laws.timed import ConstantSpeed, Free, Oscillation, Table, zones
from mechcore.spec.loads import (
    Damper,
    DcMotor,
    Drag,
    Factor,
    Force,
    GasPressure,
    GasSpring,
    Load,
    Polynomial,
    Spring,
    Torque,
    TorsionDamper,
    TorsionSpring,
    Viscous,
)
from mechcore.spec.mechanism import (
    Belt,
    CamJoint,
    Cylinder,
    Drive,
    Friction,
    Gear,
    Joint,
    Link,
    Mechanism,
    PinSlot,
    Prismatic,
    Rack,
    Revolute,
    Rolling,
    Weld,
)

TURN = 2.0 * np.pi
FRAME = "frame"


def wrapped(angle: float) -> float:
    """The angle in (-pi, pi]."""
    return float(-np.remainder(np.pi - angle, TURN) + np.pi)


def stated(joints: Any, starts: Any, first: str, second: str) -> float | None:
    """The angle of two links where rigid joints and driven joints, which start at ``starts``, say it; whole turns included."""
    result = {first: 0.0}
    while True:
        size = len(result)
        for p in joints:
            angle = starts.get(p.name) if isinstance(p, Revolute) else getattr(p, "angle", None)
            if angle is not None:
                a, b = p.links
                if a in result:
                    result.setdefault(b, result[a] + angle)
                elif b in result:
                    result[a] = result[b] - angle
        if len(result) == size:
            return result.get(second)


def unit(angle: float) -> complex:
    return cmath.exp(1j * angle)


def joint_of(z: complex) -> tuple[float, float]:
    return (z.real, z.imag)


@dataclass(frozen=True)
class Case:
    """A mechanism with what is asked of it: motion at ``time`` (F,) [s], from which the duration under forces follows too."""

    kind: str
    seed: int
    mechanism: Mechanism
    time: np.ndarray
    start: dict[str, float] = field(default_factory=dict)  # joint -> coordinate at the start, angles in (-pi, pi]
    poses: dict[str, tuple[float, float, float]] = field(default_factory=dict)  # link -> x, y, angle at the start
    stops: tuple[EndStop, ...] = ()
    triggers: tuple[EventTrigger, ...] = ()

    @property
    def name(self) -> str:
        return f"{self.kind}-{self.seed}"

    def turned(self, first: str, second: str) -> float:
        """Angle of the second link's frame minus that of the first's at the start, in (-pi, pi]."""
        return wrapped(self.poses[second][2] - self.poses[first][2])

    @property
    def free(self) -> bool:
        return any(isinstance(d.law, Free) for d in self.mechanism.drives)


@dataclass(frozen=True)
class Wave:
    """``mean + amplitude sin(rate x + phase)``."""

    mean: float
    amplitude: float
    rate: float
    phase: float

    def __call__(self, x: Any) -> Any:
        return self.mean + self.amplitude * np.sin(self.rate * x + self.phase)


class Draft:
    """A drawing that grows link by link."""

    def __init__(self, rng: np.random.Generator):
        self.rng = rng
        self.poses: dict[str, tuple[complex, float]] = {FRAME: (0j, 0.0)}
        self.points: dict[str, dict[str, complex]] = {FRAME: {}}  # in the world
        self.joints: list[Joint] = []
        self.driven: list[str] = []
        self.slides: list[str] = []  # joints whose coordinate is a length
        self.coordinate: dict[str, float] = {}
        self.massless: set[str] = set()
        self.fixed: set[str] = set()  # links that cannot turn against the frame
        self.cams: list[str] = []
        self.modes: dict[str, str] = {}
        self.said = True  # whether the modes say all that the sketch would

    # -- parts --------------------------------------------------------------------------------------------------------
    def uniform(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def either(self) -> bool:
        return bool(self.rng.integers(2))

    def among(self, items: Any) -> Any:
        items = list(items)
        return items[int(self.rng.integers(len(items)))]

    def body(self, at: complex = 0j) -> str:
        """A new link with a frame somewhere near ``at``."""
        name = f"L{len(self.poses)}"
        near = at + self.uniform(0.0, 0.5) * unit(self.uniform(-np.pi, np.pi))
        self.poses[name] = near, self.uniform(-np.pi, np.pi)
        self.points[name] = {}
        return name

    def put(self, link: str, z: complex, name: str | None = None) -> str:
        """A point of a link at ``z`` in the world."""
        name = name if name is not None else f"{link}p{len(self.points[link])}"
        self.points[link][name] = z
        return name

    def local(self, link: str, z: complex) -> complex:
        origin, angle = self.poses[link]
        return (z - origin) * unit(-angle)

    def along(self, link: str, direction: complex) -> tuple[float, float]:
        return joint_of(direction * unit(-self.poses[link][1]) * self.uniform(0.5, 2.0))

    def turned(self, first: str, second: str) -> float:
        """Angle of the second link's frame minus that of the first's, in (-pi, pi]."""
        return wrapped(self.poses[second][1] - self.poses[first][1])

    def _order(self, first: str, second: str) -> tuple[tuple[str, str], bool]:
        swapped = self.either()
        return ((second, first), True) if swapped else ((first, second), False)

    def new(self, letter: str) -> str:
        return f"{letter}{len(self.joints)}"

    def pin(self, first: str, second: str, z: complex) -> str:
        (a, b), _ = self._order(first, second)
        name = self.new("R")
        self.joints.append(Revolute(name=name, links=(a, b), points=(self.put(a, z), self.put(b, z))))
        self.coordinate[name] = self.turned(a, b)
        return name

    def slider(self, guide: str, other: str, z: complex, direction: complex, kind: Any = Prismatic) -> str:
        """``other`` slides at ``z`` along ``direction`` of the link ``guide``; the guide's own point lies somewhere on the line."""
        (a, b), swapped = self._order(guide, other)
        s = self.uniform(-0.6, 0.6)
        foot = z - s * direction
        on = {guide: self.put(guide, foot), other: self.put(other, z)}
        name = self.new("S" if kind is Prismatic else "P")
        more = {"angle": self.poses[b][1] - self.poses[a][1]} if kind is Prismatic else {}
        made = {"name": name, "links": (a, b), "points": (on[a], on[b]), "along": self.along(guide, direction)}
        self.joints.append(kind(**made, guide=1 if swapped else 0, **more))
        self.coordinate[name] = s
        self.slides.append(name)
        if kind is Prismatic and guide in self.fixed | {FRAME}:
            self.fixed.add(other)
        return name

    def weld(self, first: str, second: str, z: complex) -> str:
        name = self.new("W")
        points = (self.put(first, z), self.put(second, z))
        angle = self.poses[second][1] - self.poses[first][1]
        self.joints.append(Weld(name=name, links=(first, second), points=points, angle=angle))
        return name

    def near(self, link: str) -> complex:
        """A new place on a link, near what it has."""
        known = list(self.points[link].values()) or [0j]
        middle = sum(known) / len(known)
        return middle + self.uniform(0.05, 0.5) * unit(self.uniform(-np.pi, np.pi))

    def moving(self) -> list[str]:
        return [k for k in self.poses if k != FRAME]

    # -- groups -------------------------------------------------------------------------------------------------------
    def crank(self, on: str = FRAME) -> tuple[str, complex]:
        """A driven crank on a link; the crank and its free pin's place."""
        z = self.uniform(-0.5, 0.5) + 1j * self.uniform(-0.5, 0.5) if on == FRAME else self.near(on)
        link = self.body(z)
        self.driven.append(self.pin(on, link, z))
        return link, z + self.uniform(0.15, 0.4) * unit(self.uniform(-np.pi, np.pi))

    def carriage(self) -> tuple[str, complex]:
        """A driven slider on the frame."""
        z = self.uniform(-0.5, 0.5) + 1j * self.uniform(-0.5, 0.5)
        link = self.body(z)
        self.driven.append(self.slider(FRAME, link, z, unit(self.uniform(-np.pi, np.pi))))
        return link, z + self.uniform(0.0, 0.4) * unit(self.uniform(-np.pi, np.pi))

    def rrr(self, first: str, b: complex, second: str = FRAME) -> str:
        """Two bars from ``b`` of a first link to a place of a second; the bar on the second."""
        for _ in range(1000):
            e = self.near(second) if second != FRAME else b + self.uniform(0.5, 1.6) * unit(self.uniform(-np.pi, np.pi))
            d = b + self.uniform(0.5, 1.5) * unit(self.uniform(-np.pi, np.pi))
            bend = abs(cmath.phase((b - d) / (e - d))) if abs(e - d) > 0.4 else 0.0
            if 0.7 < bend < 2.4 and abs(e - d) < 1.6:
                break
        bar, rocker = self.body(b), self.body(e)
        self.pin(first, bar, b)
        self.pin(second, rocker, e)
        joint = self.pin(bar, rocker, d)
        left = ((e - b) * (d - b).conjugate()).imag < 0.0  # of the line from the bar's other pin to the rocker's
        self.modes[joint] = "left" if left == (self.joints[-1].links[0] == bar) else "right"
        return self.among([bar, rocker])

    def rrp(self, first: str, b: complex, second: str = FRAME) -> str:
        """A rod from ``b`` to a block on a straight guide of a second link."""
        turn = self.uniform(-np.pi, np.pi)
        rod, block = self.body(b), self.body(b)
        c = b + self.uniform(0.6, 1.4) * unit(turn)
        self.pin(first, rod, b)
        self.pin(rod, block, c)
        direction = unit(turn + self.uniform(-0.7, 0.7) + np.pi * self.either())
        guide = self.slider(second, block, c, direction)
        self.modes[guide] = "ahead" if ((c - b) / direction).real > 0.0 else "behind"
        return self.among([rod, block])

    def rpr(self, first: str, b: complex, second: str = FRAME) -> str:
        """A block pinned at ``b`` that slides on a lever (or whose bore the lever slides through) pinned to a second link."""
        e = b + self.uniform(0.6, 1.3) * unit(self.uniform(-np.pi, np.pi)) if second == FRAME else self.near(second)
        if abs(e - b) < 0.4:
            e = b + 0.7 * unit(self.uniform(-np.pi, np.pi))
        lever, block = self.body(e), self.body(b)
        direction = (b - e) / abs(b - e) * unit(self.uniform(-0.6, 0.6))
        self.pin(second, lever, e)
        self.pin(first, block, b)
        if self.either():
            guide = self.slider(lever, block, b, direction)
        else:
            guide = self.slider(block, lever, e, direction)
            direction = -direction
        self.modes[guide] = "ahead" if ((b - e) / direction).real > 0.0 else "behind"
        return lever

    def slot(self, first: str, b: complex, second: str = FRAME) -> str:
        """A lever on a second link, with a slot for a pin of the first, or with a pin for its slot."""
        e = b + self.uniform(0.6, 1.3) * unit(self.uniform(-np.pi, np.pi)) if second == FRAME else self.near(second)
        if abs(e - b) < 0.4:
            e = b + 0.7 * unit(self.uniform(-np.pi, np.pi))
        lever = self.body(e)
        self.pin(second, lever, e)
        direction = (b - e) / abs(b - e) * unit(self.uniform(-0.6, 0.6))
        guide = self.slider(lever, first, b, direction, PinSlot)
        self.modes[guide] = "ahead"
        return lever

    def yoke(self, first: str, b: complex, second: str = FRAME) -> str:
        """A Scotch yoke: a slider with a slot for a pin."""
        turn = self.uniform(-np.pi, np.pi)
        block = self.body(b)
        c = b + self.uniform(0.2, 0.8) * unit(turn)
        self.slider(second, block, c, unit(turn))
        self.slider(block, first, b, unit(turn + np.pi / 2 + self.uniform(-0.6, 0.6)), PinSlot)
        return block

    def triad(self, first: str, b: complex, second: str = FRAME) -> str:
        """A ternary link on three bars, to a first link and to two places of the second."""
        plate = self.body(b)
        turn = self.uniform(-np.pi, np.pi)
        middle = b + 1.2 * unit(turn)
        for k, owner in enumerate((first, second, second)):
            corner = middle + 0.4 * unit(turn + np.pi + k * TURN / 3 + self.uniform(-0.3, 0.3))
            reach = (corner - middle) / abs(corner - middle) * unit(self.uniform(0.5, 1.0))
            foot = b if k == 0 else corner + self.uniform(0.6, 0.9) * reach
            bar = self.body(corner)
            self.pin(owner, bar, foot)
            self.pin(bar, plate, corner)
        return plate

    def wheel(self, first: str, on: str, z: complex) -> tuple[str, complex]:
        """A wheel pinned at ``z`` to ``on``; the wheel and a place on it."""
        link = self.body(z)
        self.pin(on, link, z)
        return link, z + self.uniform(0.1, 0.25) * unit(self.uniform(-np.pi, np.pi))

    def gear(self, first: str, b: complex, second: str = FRAME) -> str:
        """A wheel that meshes with a link pinned to the frame; its pin drives a dyad."""
        c1 = self._pivot(first)
        internal = self.either()
        n1, n2 = self.uniform(10, 25), self.uniform(26, 60)
        if not internal and self.either():
            n1, n2 = n2, n1
        wheel, pin = self.wheel(first, FRAME, c1 + self.uniform(0.3, 0.8) * unit(self.uniform(-np.pi, np.pi)))
        links, sizes = (first, wheel), (n1, n2)
        name = self.new("G")
        more = {"pressure_angle": self.uniform(0.0, 0.5)}
        self.joints.append(Gear(name=name, links=links, carrier=FRAME, sizes=sizes, internal=internal, **more))
        self.coordinate[name] = self.turned(*links)
        return self.among([self.rrr, self.rrp])(wheel, pin)

    def planetary(self, first: str, b: complex, second: str = FRAME) -> str:
        """A planet on a link that turns about a pivot of the frame, rolling on a gear of the frame or on a sun."""
        c1 = self._pivot(first)
        b = c1 + (b - c1) / abs(b - c1) * 0.3
        planet, pin = self.wheel(first, first, b)
        name = self.new("G")
        internal = self.either()
        # teeth of the frame about the pivot of the arm: the frame is the other wheel, pinned to the arm
        links = (planet, FRAME) if internal else self.among([(planet, FRAME), (FRAME, planet)])
        sizes = (self.uniform(10, 20), self.uniform(30, 60)) if internal else (self.uniform(10, 40), self.uniform(10, 40))
        more = {"pressure_angle": self.uniform(0.0, 0.5)}
        self.joints.append(Gear(name=name, links=links, carrier=first, sizes=sizes, internal=internal, **more))
        self.coordinate[name] = self.turned(*links)
        return self.among([self.rrr, self.rrp])(planet, pin)

    def belt(self, first: str, b: complex, second: str = FRAME) -> str:
        """A pulley beside a link pinned to the frame, with a belt between them; its pin drives a dyad."""
        c1 = self._pivot(first)
        c2 = c1 + self.uniform(0.5, 1.0) * unit(self.uniform(-np.pi, np.pi))
        pulley, pin = self.wheel(first, FRAME, c2)
        links, _ = self._order(first, pulley)
        name = self.new("V")
        radii = (self.uniform(0.05, 0.24), self.uniform(0.05, 0.24))
        self.joints.append(Belt(name=name, links=links, carrier=FRAME, radii=radii, crossed=self.either()))
        self.coordinate[name] = self.turned(*links)
        return self.among([self.rrr, self.rrp])(pulley, pin)

    def rack(self, first: str, b: complex, second: str = FRAME) -> str:
        """A rack on the frame, moved by a link pinned to the frame; it carries a dyad."""
        c1 = self._pivot(first)
        direction = unit(self.uniform(-np.pi, np.pi))
        rack = self.body(c1)
        radius, left = self.uniform(0.05, 0.15), self.either()
        beside = complex(self.uniform(-0.3, 0.3), self.uniform(-0.2, 0.2))
        guide = self.slider(FRAME, rack, c1 + direction * beside, direction)
        name = self.new("Z")
        more = {"slider": guide, "radius": radius, "side": "left" if left else "right", "pressure_angle": self.uniform(0.0, 0.5)}
        self.joints.append(Rack(name=name, links=(first, rack), **more))
        self.coordinate[name] = self.turned(first, rack)
        return self.among([self.rrr, self.rrp])(rack, self.near(rack))

    def rolling(self, first: str, b: complex, second: str = FRAME) -> str:
        """A wheel that rolls on an edge of the second link, drawn along by a rod from the first."""
        turn = self.uniform(-np.pi, np.pi)
        centre = b + self.uniform(0.6, 1.2) * unit(turn)
        wheel, rod = self.body(centre), self.body(b)
        direction = unit(turn + self.uniform(-0.6, 0.6) + np.pi * self.either())
        s = self.uniform(-0.5, 0.5)
        name = self.new("O")
        points = (self.put(second, centre - s * direction), self.put(wheel, centre))
        more = {"radius": self.uniform(0.1, 0.3), "side": self.among(["left", "right"])}
        self.joints.append(Rolling(name=name, links=(second, wheel), points=points, along=self.along(second, direction), **more))
        self.coordinate[name] = s
        self.slides.append(name)
        self.pin(first, rod, b)
        self.pin(rod, wheel, centre if self.either() else centre + 0.05 * unit(self.uniform(-np.pi, np.pi)))
        return self.among([rod, wheel])

    def cam(self, first: str, b: complex, second: str = FRAME) -> str:
        """A disc cam on a link pinned to the frame; the follower carries a dyad."""
        centre = self._pivot(first)
        sense = self.among([1, -1])
        dwell = self.uniform(0.2, 0.8)
        swings = self.either()
        stroke = self.uniform(0.1, 0.25) if swings else self.uniform(0.03, 0.1)
        law = self.among(["cycloidal", "3-4-5"])
        up = self.uniform(1.8, 2.4)
        lift = program([Segment(up, stroke, law), Segment(dwell), Segment(TURN - up - dwell, 0.0, law)])
        phase = self.uniform(0.0, TURN)
        base = self.uniform(0.25, 0.35)
        argument = sense * self.turned(FRAME, first) + phase  # the cam stands as drawn
        turn = self.uniform(-np.pi, np.pi)
        follower = self.body(centre + 0.5 * unit(turn))
        more: dict[str, Any] = {"base": base, "sense": sense, "phase": phase, "lift": lift}
        h = float(lift(np.array([np.mod(argument, TURN)]))[0][0])
        if swings:
            face: Any = self.among([Knife(), Roller(self.uniform(0.03, 0.08)), Arc(self.uniform(0.03, 0.08))])
            d, arm = self.uniform(0.7, 0.8), self.uniform(0.55, 0.65)
            pivot = centre + d * unit(turn)
            reach = base + face.radius
            psi = np.arccos((d * d + arm * arm - reach * reach) / (2.0 * d * arm)) + h
            left = self.either()
            tip = pivot + arm * (centre - pivot) / d * unit(psi if left else -psi)
            guide = self.pin(FRAME, follower, pivot)
            more["side"] = "left" if left else "right"
        else:
            face = self.among([Knife(), Roller(self.uniform(0.03, 0.08)), Arc(self.uniform(0.03, 0.08)), Flat()])
            offset = self.uniform(-0.05, 0.05)
            direction = unit(turn)
            flat = isinstance(face, Flat)
            height = (base if flat else np.sqrt((base + face.radius) ** 2 - offset**2)) + h
            tip = centre + (height - 1j * offset) * direction
            guide = self.slider(FRAME, follower, tip, direction)
        name = self.new("K")
        point = self.put(follower, tip)
        made = {"name": name, "links": (first, follower), "guide": guide, "point": point, "face": face}
        self.joints.append(CamJoint(**made, **more))
        self.cams.append(name)
        return self.among([self.rrr, self.rrp])(follower, self.near(follower))

    def cylinder(self, first: str, b: complex, second: str = FRAME) -> str:
        """A boom on the frame, moved by a cylinder in place of a crank."""
        pivot = self.uniform(-0.5, 0.5) + 1j * self.uniform(-0.5, 0.5)
        boom = self.body(pivot)
        self.pin(FRAME, boom, pivot)
        turn = self.uniform(-np.pi, np.pi)
        base, eye = pivot + 0.6 * unit(turn), pivot + 0.7 * unit(turn + self.among([-1, 1]) * self.uniform(0.9, 1.8))
        name = self.new("C")
        self.joints.append(Cylinder(name=name, links=(FRAME, boom), points=(self.put(FRAME, base), self.put(boom, eye))))
        self.coordinate[name] = abs(eye - base)
        self.slides.append(name)
        self.driven = [name]
        return self.among([self.rrr, self.rrp])(boom, pivot + 0.5 * unit(self.uniform(-np.pi, np.pi)))

    def _pivot(self, link: str) -> complex:
        """Where a link is pinned to the frame."""
        for p in self.joints:
            if isinstance(p, Revolute) and set(p.links) == {FRAME, link}:
                return self.points[FRAME][p.points[p.links.index(FRAME)]]
        raise AssertionError(link)

    # -- loads --------------------------------------------------------------------------------------------------------
    def any_point(self, link: str | None = None) -> tuple[str, str]:
        link = link if link is not None else self.among(self.poses)
        return link, self.put(link, self.near(link))

    def two_points(self) -> tuple[tuple[str, str], tuple[str, str], float]:
        """Two points of two links that do not meet: far from each other."""
        a = self.among(self.moving())
        b = self.among([k for k in self.poses if k != a])
        za = self.near(a)
        zb = za + 3.0 * unit(self.uniform(-np.pi, np.pi))
        return (a, self.put(a, za)), (b, self.put(b, zb)), abs(zb - za)

    def factor(self) -> Factor | None:
        """A factor of something that the mechanism does, or none."""
        pick = int(self.rng.integers(9))
        if pick < 2:
            return None
        if pick == 2:
            return Factor(function=Wave(1.0, 0.5, self.uniform(2.0, 9.0), 1.0), of="time")
        joints = [p.name for p in self.joints if isinstance(p, Revolute | Prismatic | PinSlot | Rolling | Cylinder)]
        joint = self.among(joints)
        q = self.coordinate[joint]
        if pick in (3, 4):  # straight lines about the start
            wide = 1.0 if joint in self.slides else 3.0
            x = np.sort(self.rng.uniform(-wide, wide, 6)) + np.linspace(-0.1, 0.1, 6) + q
            return Factor(function=Table(tuple(x), tuple(self.rng.uniform(-1.0, 1.0, 6)), smooth=False), joint=joint)
        if pick == 5:
            rate = self.uniform(1.0, 3.0) if joint in self.slides else float(self.rng.integers(1, 3))
            return Factor(function=Wave(0.5, 1.0, rate, self.uniform(0.0, 6.0)), joint=joint)
        if pick == 6:
            return Factor(function=Polynomial((0.5, 0.1, -0.02), per=self.uniform(1.0, 2.0)), of="velocity", joint=joint)
        if pick == 7:
            return Factor(function=Wave(1.0, 0.5, 0.4, np.pi / 2), of="speed", point=self.any_point(self.among(self.moving())))
        of = self.among(["x", "y", "vx", "vy"])
        return Factor(function=Wave(1.0, 0.5, 0.8, 0.3), of=of, point=self.any_point(self.among(self.moving())))

    def load(self, name: str) -> Load:
        link = self.among(self.moving())
        against = self.among([None, None, *(k for k in self.poses if k != link)])
        kind = int(self.rng.integers(13))
        sliding = [p.name for p in self.joints if isinstance(p, Prismatic)]
        if kind <= 1:
            vector = (self.uniform(-30, 30), self.uniform(-30, 30))
            axes = self.among(["world", "link"])
            point = self.any_point(link)[1]
            return Force(name=name, link=link, point=point, vector=vector, axes=axes, factor=self.factor(), against=against)
        if kind == 2:
            return Torque(name=name, link=link, moment=self.uniform(-10, 10), factor=self.factor(), against=against)
        if kind == 3:
            (a, p), (b, q), length = self.two_points()
            free = length * self.uniform(0.6, 1.2) * self.either()
            more = {"stiffness": self.uniform(5, 40), "free_length": free, "preload": self.uniform(-5, 5) if free else 0.0}
            return Spring(name=name, links=(a, b), points=(p, q), **more)
        if kind in (4, 5):
            other = self.among([k for k in self.poses if k != link])
            if link in self.fixed and other in self.fixed | {FRAME}:
                return Torque(name=name, link=link, moment=1.0)
            known = stated(self.joints, {p: self.coordinate[p] for p in self.driven if p not in self.slides}, link, other)
            free = (self.turned(link, other) if known is None else known) + self.uniform(-2.0, 2.0)
            return TorsionSpring(name=name, links=(link, other), stiffness=self.uniform(1, 8), free_angle=free)
        if kind == 6:
            (a, p), (b, q), _ = self.two_points()
            return Damper(name=name, links=(a, b), points=(p, q), linear=self.uniform(0, 3), quadratic=self.uniform(0, 1))
        if kind == 7:
            other = self.among([k for k in self.poses if k != link])
            return TorsionDamper(name=name, links=(link, other), coefficient=self.uniform(0, 0.5))
        if kind == 8:
            point = None if self.either() else self.any_point(link)[1]
            return Drag(name=name, link=link, point=point, linear=self.uniform(0, 0.5), quadratic=self.uniform(0, 0.2))
        if kind == 9:
            joint = self.among([p.name for p in self.joints if isinstance(p, Revolute | Prismatic | PinSlot | Rolling | Cylinder)])
            return Viscous(name=name, joint=joint, coefficient=self.uniform(0, 0.5))
        if kind == 10 and sliding:
            joint = self.among(sliding)
            stroke, head = 6.0, self.among(["ahead", "behind"])
            top = self.coordinate[joint] + (3.0 if head == "ahead" else -3.0)
            cycle: Any = Compressor(stroke=stroke, suction=1e2, delivery=3e2)
            if self.either():
                cycle = IndicatorDiagram(stroke=stroke, outward=lambda x: 3e2 - 20.0 * x, inward=lambda x: 1e2 + 10.0 * x)
            return GasPressure(name=name, joint=joint, area=0.02, cycle=cycle, top=top, head=head, back=1.5e2)
        if kind == 11:
            (a, p), (b, q), length = self.two_points()
            more = {"force": self.uniform(5, 30), "extended": 2.0 * length, "gas_length": 2.2 * length}
            return GasSpring(name=name, links=(a, b), points=(p, q), exponent=self.among([1.0, 1.4]), **more)
        pins = [p.name for p in self.joints if isinstance(p, Revolute)]
        if not pins:
            return Torque(name=name, link=link, moment=1.0)
        joint = self.among(pins)
        return DcMotor(name=name, joint=joint, stall_torque=self.uniform(1, 5), no_load_speed=self.uniform(5, 20))

    # -- the whole ----------------------------------------------------------------------------------------------------
    def links(self) -> tuple[Link, ...]:
        made = []
        for name, points in self.points.items():
            own = {p: joint_of(self.local(name, z)) for p, z in points.items()}
            if name == FRAME:
                made.append(Link(name=name, points=own))
                continue
            centre = joint_of(self.local(name, self.near(name)))
            mass, inertia = self.uniform(0.2, 2.0), self.uniform(0.01, 0.2)
            made.append(Link(name=name, points=own, mass=mass, centre=centre, inertia=inertia))
        return tuple(made)

    def frictions(self) -> None:
        """Mild dry friction in some joints."""
        for k, p in enumerate(self.joints):
            if self.uniform(0, 1) < 0.5:
                continue
            if isinstance(p, Revolute):
                self.joints[k] = replace(p, friction=Friction(coefficient=self.uniform(0.02, 0.2), radius=self.uniform(0.01, 0.05)))
            elif isinstance(p, Prismatic):
                length = self.among([0.0, 0.3, 0.8])
                self.joints[k] = replace(p, friction=Friction(coefficient=self.uniform(0.02, 0.12), length=length))
            elif isinstance(p, PinSlot):
                self.joints[k] = replace(p, friction=Friction(coefficient=self.uniform(0.02, 0.12)))


GROUPS: dict[str, str] = {
    "four-bar": "rrr",
    "slider-crank": "rrp",
    "inverted slider-crank": "rpr",
    "scotch yoke": "yoke",
    "pin in slot": "slot",
    "gear": "gear",
    "planetary gear": "planetary",
    "rack": "rack",
    "belt": "belt",
    "rolling": "rolling",
    "cam": "cam",
    "triad": "triad",
    "cylinder": "cylinder",
}
KINDS = (*GROUPS, "six-bar", "several drives")
STATED = ("four-bar", "slider-crank", "inverted slider-crank", "scotch yoke", "pin in slot")  # modes can say how they stand
SIMPLE = ("rrr", "rrp", "rpr", "slot", "yoke")
ROTARY = ("gear", "planetary gear", "rack", "belt", "cam")  # need a link that is pinned to the frame


def draw(kind: str, seed: int, *, travel: float = TURN, forces: bool | None = None, friction: bool | None = None) -> Case:
    """A case of a kind. ``travel`` [rad]: range of rotary drives, at full turns at constant speed; what slides goes in proportion.

    ``forces``: the motion is free (None: by lot); ``friction`` likewise, of prescribed motions.
    """
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    d = Draft(rng)
    lot = rng.uniform(size=4)
    several = kind == "several drives"
    if kind not in ROTARY and not several and lot[0] < 0.15:
        first, b = d.carriage()
    else:
        first, b = d.crank()
    made = [first]
    if several:
        if lot[0] < 0.5:  # a five-bar or the like
            second, c = d.crank()
            group = d.among(["rrr", "rrr", "rpr"])
            made.append(getattr(d, group)(first, b, second))
            made.append(second)
        else:  # an open chain that carries a dyad
            second = d.body(b)
            d.driven.append(d.pin(first, second, b))
            made += [second, getattr(d, d.among(SIMPLE))(second, d.near(second))]
        if lot[1] < 0.3:
            third, c = d.crank()
            made += [third, getattr(d, d.among(SIMPLE))(third, c)]
    elif kind == "six-bar":
        made.append(getattr(d, d.among(["rrr", "rrp"]))(first, b))
        on = d.among(d.moving())
        made.append(getattr(d, d.among(SIMPLE))(on, d.near(on)))
    else:
        made.append(getattr(d, GROUPS[kind])(first, b))
        d.said = kind in STATED
        if kind == "cylinder":  # the crank that was drawn first is not part of it
            return _finished(_without(d, first), kind, seed, rng, lot, travel, forces, friction)
    if lot[2] < 0.35:  # a further group anywhere
        on, to = d.among(d.moving()), d.among([FRAME, FRAME, *d.moving()])
        if on != to:
            getattr(d, d.among(SIMPLE))(on, d.near(on), to)
    if lot[3] < 0.15:  # something welded on
        on = d.among(d.moving())
        link, z = d.body(d.near(on)), d.near(on)
        d.weld(on, link, z)
    return _finished(d, kind, seed, rng, lot, travel, forces, friction)


def _without(d: Draft, link: str) -> Draft:
    d.joints = [p for p in d.joints if link not in p.links]
    for table in (d.poses, d.points):
        table.pop(link)
    return d


def _finished(
    d: Draft, kind: str, seed: int, rng: np.random.Generator, lot: Any, travel: float, forces: bool | None, friction: bool | None
) -> Case:
    often = 0.1 if kind == "triad" else 0.35  # tables of triads take seconds
    free = bool(rng.uniform() < often) if forces is None else forces
    rubs = bool(rng.uniform() < 0.2) if friction is None else friction
    loads = tuple(d.load(f"load{k}") for k in range(int(rng.integers(1, 5))))
    if rubs and not free:
        d.frictions()
    effects: tuple[str, ...] = ("inertia", "gravity") if free or rng.uniform() < 0.7 else ()
    if rubs and not free:
        effects += ("friction",)
    drives = []
    for name in d.driven:
        sign = d.among([-1.0, 1.0])
        q, size = d.coordinate[name], 1.0
        if name in d.slides:
            size = 0.15
        speed = d.uniform(2.0, 6.0) * sign * size
        law: Any
        pick = d.uniform(0, 1)
        if free:
            law = Free(q, speed)
        elif travel >= TURN and size == 1.0 and pick < 0.6:
            law = ConstantSpeed(q, speed)
        elif pick < 0.8:
            phase = d.uniform(-np.pi, np.pi)
            amplitude = size * min(0.25 * travel, 1.2)
            law = Oscillation(q - amplitude * np.sin(phase), amplitude, d.uniform(0.5, 1.0), phase)
        else:
            part = size * min(travel, 3.0) * np.array([0.3, 0.4, 0.3])
            law = zones(start=q, speed=speed, run_up=part[0], steady=part[1], braking=part[2])
        drives.append(Drive(joint=name, law=law))
    told = d.said and bool(rng.uniform() < 0.5)
    mechanism = Mechanism(
        name=f"{kind} {seed}",
        frame=FRAME,
        links=d.links(),
        joints=tuple(d.joints),
        drives=tuple(drives),
        modes=d.modes if told else {},
        loads=loads,
        effects=effects,
        gravity=(d.uniform(-10, 10), d.uniform(-10, 10)),
        sketch={} if told else {k: (z.real, z.imag, a) for k, (z, a) in d.poses.items() if k != FRAME},
    )
    duration = min(float(x.law.duration) for x in drives) if not free else d.uniform(0.2, 0.6)
    time = np.linspace(0.0, duration * (1.0 - 1e-12), 25)
    stops, triggers = _looked_for(d, free)
    poses = {k: (z.real, z.imag, a) for k, (z, a) in d.poses.items()}
    return Case(kind, seed, mechanism, time, dict(d.coordinate), poses, stops, triggers)


def _looked_for(d: Draft, free: bool) -> tuple[tuple[EndStop, ...], tuple[EventTrigger, ...]]:
    """A stop and a watch near the start of a motion under forces, or none."""
    if not free:
        return (), ()
    joints = [p.name for p in d.joints if isinstance(p, Revolute | Prismatic | PinSlot | Rolling)]
    stops, triggers = [], []
    if d.uniform(0, 1) < 0.5:
        joint = d.among(joints)
        side = d.among(["upper", "lower"])
        far = d.uniform(0.05, 0.4) * (0.5 if joint in d.slides else 1.0)
        at = d.coordinate[joint] + (far if side == "upper" else -far)
        stops.append(EndStop(name="stop", joint=joint, at=at, side=side, restitution=d.among([0.0, d.uniform(0.3, 1.0)])))
    if d.uniform(0, 1) < 0.5:
        joint = d.among(joints)
        far = d.uniform(-0.4, 0.4) * (0.5 if joint in d.slides else 1.0)
        triggers.append(EventTrigger(name="watch", joint=joint, at=d.coordinate[joint] + far))
    return tuple(stops), tuple(triggers)
