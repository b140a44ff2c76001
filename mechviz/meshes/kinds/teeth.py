"""Outlines of toothed wheels and racks, generated as a workshop generates them: by rolling a cutter through the blank.

An external wheel is cut by a rack, a ring by its pinion. The flanks are then conjugate for any number of teeth, with undercut
and fillets where real teeth have them. Lengths are in units of the module, the axis (or pitch line) is the origin.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import shapely
from shapely import affinity
from shapely.geometry import Point, Polygon
from shapely.ops import unary_union

from mechviz.meshes.outline import polygons, rounded

ADDENDUM = 1.0
DEDENDUM = 1.25
BACKLASH = 0.05  # by which each tooth is thinner than half the pitch, in modules: half of what a mesh has altogether

_STEPS = 61  # positions of the cutter
_ROLL = 5.0  # how far it rolls to either side of the tooth, along the pitch line, in modules
_FINE = 0.006  # the outline may miss the generated one by this much: an eighth of the backlash


def _cutter(angle: float, tip: float) -> Polygon:
    """A tooth of the cutting rack, pointing to -x from the pitch line x = 0; wider than half the pitch by the backlash."""
    half, slope, back = 0.25 * np.pi + 0.5 * BACKLASH, np.tan(angle), 2.0 * ADDENDUM
    corners = [(-tip, half - tip * slope), (-tip, tip * slope - half), (back, -half - back * slope), (back, half + back * slope)]
    return rounded(Polygon(corners), 0.2)


@cache
def _gap(teeth: int, angle: float) -> Polygon:
    """The gap between two teeth, about the +x axis of the wheel."""
    radius, tool = 0.5 * teeth, _cutter(angle, DEDENDUM)
    cuts = [
        affinity.rotate(affinity.translate(tool, radius, radius * turn), -turn, origin=(0.0, 0.0), use_radians=True)
        for turn in np.linspace(-_ROLL, _ROLL, _STEPS) / radius
    ]
    return polygons(unary_union(cuts).simplify(_FINE))[0]


def _around(shape: Polygon, count: int) -> list[Polygon]:
    """Copies of a shape all around the origin."""
    return [affinity.rotate(shape, 360.0 * k / count, origin=(0.0, 0.0)) for k in range(count)]


@cache
def external_wheel(teeth: int, angle: float, addendum: float = ADDENDUM) -> Polygon:
    """A wheel with teeth outside, one of them about the +x axis; ``angle`` is the pressure angle [rad]."""
    blank = Point(0.0, 0.0).buffer(0.5 * teeth + addendum, quad_segs=max(16, teeth))
    gap = affinity.rotate(_gap(teeth, angle), 180.0 / teeth, origin=(0.0, 0.0))
    return polygons(blank.difference(unary_union(_around(gap, teeth))))[0]


@cache
def ring_teeth(teeth: int, pinion: int, angle: float, rim: float) -> Polygon:
    """A ring with teeth inside, one of them about the +x axis, that fits a pinion; ``rim`` is its outer radius."""
    radius, small = 0.5 * teeth, 0.5 * pinion
    half = np.pi / pinion
    wedge = Polygon([(0.0, 0.0), *(2.0 * (small + 3.0) * np.array([np.cos(a), np.sin(a)]) for a in (-half, half))])
    tool = polygons(external_wheel(pinion, angle, DEDENDUM).intersection(wedge).buffer(BACKLASH, join_style="mitre"))[0]
    reach = min(2.0 * _ROLL, 0.9 * radius)
    cuts = []
    for turn in np.linspace(-reach, reach, 2 * _STEPS - 1) / radius:
        placed = affinity.rotate(tool, -turn * teeth / pinion, origin=(0.0, 0.0), use_radians=True)
        cuts.append(affinity.rotate(affinity.translate(placed, radius - small, 0.0), turn, origin=(0.0, 0.0), use_radians=True))
    outside = Point(0.0, 0.0).buffer(radius - ADDENDUM, quad_segs=max(16, teeth))
    space = polygons(unary_union(cuts).simplify(_FINE).difference(outside.buffer(-0.5)))[0]
    space = affinity.rotate(space, 180.0 / teeth, origin=(0.0, 0.0))
    blank = Point(0.0, 0.0).buffer(rim, quad_segs=max(16, teeth))
    return polygons(blank.difference(unary_union([outside, *_around(space, teeth)])))[0]


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
