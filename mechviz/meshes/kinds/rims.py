"""Rims of wheels: teeth, and the belts and chains around two pulleys as closed lines."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import shapely
from shapely import affinity
from shapely.geometry import Point, Polygon
from shapely.ops import unary_union

from mechcore.arrays import Complex, Real
from mechcore.records import dataclass
from mechviz.meshes.outline import largest, rounded

ADDENDUM = 1.0
DEDENDUM = 1.25
BACKLASH = 0.05  # by which each tooth is thinner than half the pitch, in modules: half of what a mesh has altogether

_CUTTER_POSITIONS = 61  # positions of the cutter
_ROLL_DISTANCE = 5.0  # how far it rolls to either side of the tooth, along the pitch line, in modules
_OUTLINE_TOLERANCE = 0.006  # the outline may miss the generated one by this much: an eighth of the backlash


def _cutter(angle: float, tip: float) -> Polygon:
    """A tooth of the cutting rack, pointing to -x from the pitch line x = 0; wider than half the pitch by the backlash."""
    half, slope, back = 0.25 * np.pi + 0.5 * BACKLASH, np.tan(angle), 2.0 * ADDENDUM
    corners = [(-tip, half - tip * slope), (-tip, tip * slope - half), (back, -half - back * slope), (back, half + back * slope)]
    return rounded(Polygon(corners), 0.2)


@lru_cache(maxsize=64)
def _tooth_space(teeth: int, angle: float) -> Polygon:
    """The gap between two teeth, about the +x axis of the wheel."""
    radius, tool = 0.5 * teeth, _cutter(angle, DEDENDUM)
    cuts = [
        affinity.rotate(affinity.translate(tool, radius, radius * turn), -turn, origin=(0.0, 0.0), use_radians=True)
        for turn in np.linspace(-_ROLL_DISTANCE, _ROLL_DISTANCE, _CUTTER_POSITIONS) / radius
    ]
    return largest(unary_union(cuts).simplify(_OUTLINE_TOLERANCE))


def _around(shape: Polygon, count: int) -> list[Polygon]:
    """Copies of a shape all around the origin."""
    return [affinity.rotate(shape, 360.0 * k / count, origin=(0.0, 0.0)) for k in range(count)]


@lru_cache(maxsize=64)
def external_wheel(teeth: int, angle: float, addendum: float = ADDENDUM) -> Polygon:
    """A wheel with teeth outside, one of them about the +x axis; ``angle`` is the pressure angle [rad]."""
    blank = Point(0.0, 0.0).buffer(0.5 * teeth + addendum, quad_segs=max(16, teeth))
    space = affinity.rotate(_tooth_space(teeth, angle), 180.0 / teeth, origin=(0.0, 0.0))
    return largest(blank.difference(unary_union(_around(space, teeth))))


@lru_cache(maxsize=64)
def ring_teeth(teeth: int, pinion: int, angle: float, rim: float) -> Polygon:
    """A ring with teeth inside, one of them about the +x axis, that fits a pinion; ``rim`` is its outer radius."""
    radius, small = 0.5 * teeth, 0.5 * pinion
    half = np.pi / pinion
    wedge = Polygon([(0.0, 0.0), *(2.0 * (small + 3.0) * np.array([np.cos(a), np.sin(a)]) for a in (-half, half))])
    tool = largest(external_wheel(pinion, angle, DEDENDUM).intersection(wedge).buffer(BACKLASH, join_style="mitre"))
    reach = min(2.0 * _ROLL_DISTANCE, 0.9 * radius)
    cuts = []
    for turn in np.linspace(-reach, reach, 2 * _CUTTER_POSITIONS - 1) / radius:
        placed = affinity.rotate(tool, -turn * teeth / pinion, origin=(0.0, 0.0), use_radians=True)
        cuts.append(affinity.rotate(affinity.translate(placed, radius - small, 0.0), turn, origin=(0.0, 0.0), use_radians=True))
    outside = Point(0.0, 0.0).buffer(radius - ADDENDUM, quad_segs=max(16, teeth))
    space = largest(unary_union(cuts).simplify(_OUTLINE_TOLERANCE).difference(outside.buffer(-0.5)))
    space = affinity.rotate(space, 180.0 / teeth, origin=(0.0, 0.0))
    blank = Point(0.0, 0.0).buffer(rim, quad_segs=max(16, teeth))
    return largest(blank.difference(unary_union([outside, *_around(space, teeth)])))


def rack_teeth(low: float, high: float, phase: float, angle: float, body: float) -> Polygon:
    """A rack along x with teeth towards +y on the pitch line y = 0, one of them about x = ``phase``, body down to y = -``body``."""
    half, slope = 0.25 * np.pi - 0.5 * BACKLASH, np.tan(angle)
    top = [(low, -DEDENDUM)]
    pitch = np.pi
    first = int(np.ceil((low - phase) / pitch + 0.5 - 1e-9))
    last = int(np.floor((high - phase) / pitch - 0.5 + 1e-9))
    for k in range(first, last + 1):
        x = phase + k * pitch
        foot, tip = half + DEDENDUM * slope, half - ADDENDUM * slope
        top += [(x - foot, -DEDENDUM), (x - tip, ADDENDUM), (x + tip, ADDENDUM), (x + foot, -DEDENDUM)]
    return shapely.make_valid(Polygon([(low, -body), (high, -body), (high, -DEDENDUM), *reversed(top)]))


@dataclass(frozen=True)
class BeltLoop:
    """A belt's middle line in the axes of its carrier [m]: over the far side of the first pulley counter-clockwise, along a span to
    the second, over that (clockwise where the spans cross) and back."""

    joint: str
    carrier: str
    pulley: str  # the link of the first pulley
    centres: tuple[complex, complex]
    radii: tuple[float, float]
    crossed: bool
    thick: float  # in the plane
    low: float = 0.0  # of the belt in z
    high: float = 0.0

    def placed(self, size: float, low: float, high: float) -> BeltLoop:
        """The loop so many times as large, between two heights in its present unit."""
        (c1, c2), (r1, r2) = self.centres, self.radii
        return replace(
            self,
            centres=(c1 * size, c2 * size),
            radii=(r1 * size, r2 * size),
            thick=self.thick * size,
            low=low * size,
            high=high * size,
        )

    @property
    def leave(self) -> float:
        """Angle from the line of centres to where the left span touches the first pulley [rad]."""
        r1, r2 = self.radii
        return float(np.arccos((r1 + r2 if self.crossed else r1 - r2) / abs(self.centres[1] - self.centres[0])))

    @property
    def pieces(self) -> tuple[float, float, float]:
        """Lengths [m]: over the first pulley, of a span, over the second pulley."""
        (r1, r2), leave = self.radii, self.leave
        span = abs(self.centres[1] - self.centres[0]) * float(np.sin(leave))
        return r1 * 2.0 * (np.pi - leave), span, r2 * 2.0 * (np.pi - leave if self.crossed else leave)

    @property
    def length(self) -> float:
        first, span, second = self.pieces
        return first + 2.0 * span + second

    def at(self, distance: Real) -> tuple[Complex, Real]:
        """Places in the plane [m] after any way along the belt [m], and the directions in which it runs there [rad], continuous."""
        (c1, c2), (r1, r2), leave = self.centres, self.radii, self.leave
        first, span, _ = self.pieces
        base = float(np.angle(c2 - c1))
        rounds = np.floor(np.asarray(distance, float) / self.length)
        u = np.asarray(distance, float) - rounds * self.length
        v, w = u - first - span, u - self.length + span  # along the second pulley, along the span back
        away = 2.0 * np.pi - leave  # where the first pulley is left, and the direction of the span from there
        turn = leave + np.minimum(u, first) / r1
        on_second = np.pi - leave - v / r2 if self.crossed else -leave + v / r2
        back = leave - np.pi if self.crossed else leave  # where the second pulley is left
        homeward = leave if self.crossed else leave + 2.0 * np.pi  # direction of the span back, less a right angle
        line = np.exp(1j * base)
        place = np.select(
            [u < first, v < 0.0, w < 0.0],
            [
                c1 + r1 * line * np.exp(1j * turn),
                c1 + line * np.exp(1j * away) * (r1 + 1j * (u - first)),
                c2 + r2 * line * np.exp(1j * on_second),
            ],
            c2 + line * (r2 * np.exp(1j * back) + 1j * w * np.exp(1j * homeward)),
        )
        around = on_second + (np.pi if self.crossed else 2.0 * np.pi)
        direction = np.select([u < first, v < 0.0, w < 0.0], [turn, away, around], homeward)
        per_round = 0.0 if self.crossed else 2.0 * np.pi
        return place, direction + base + 0.5 * np.pi + rounds * per_round
