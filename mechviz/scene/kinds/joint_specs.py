"""Pairs of a scene document -> pairs of the core, in SI units and radians."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping
from typing import Literal

from mechcore.spec.mechanism import (
    Belt,
    Cylinder,
    Friction,
    Gear,
    Pair,
    PinSlot,
    Planar,
    Prismatic,
    Rack,
    Revolute,
    Rolling,
    Vec2,
    Weld,
)
from mechcore.texts import as_angle
from mechviz.scene.cams.cams import cam_pair
from mechviz.scene.convert import Converter
from mechviz.scene.document import SceneDocument
from mechviz.scene.kinds.couplings import carrier_of, check_gear
from mechviz.scene.kinds.friction import friction_spec
from mechviz.scene.kinds.joints import PairDocument
from mechviz.scene.placement import Placement
from mechviz.scene.references import points_of_pair

_STEEPEST = math.radians(45.0)  # pressure angles of real teeth lie between 14.5 and 30 degrees


class _Maker:
    """What every kind needs to become a pair of the core."""

    def __init__(self, name: str, pair: PairDocument, document: SceneDocument, placement: Placement, convert: Converter):
        self.name, self.pair, self.document, self.placement, self.convert = name, pair, document, placement, convert
        self.path = f"joints.{name}"

    @property
    def points(self) -> tuple[str, str]:
        return points_of_pair(self.name, self.pair)

    @property
    def guide(self) -> Literal[0, 1]:
        return 1 if self.pair.guide == self.pair.links[1] else 0

    @property
    def along(self) -> Vec2:
        """Direction of the guide in the frame of its link."""
        if self.pair.along is None:
            return (1.0, 0.0)
        a, b = self.pair.along
        if not (isinstance(a, str) and isinstance(b, str)):
            return (float(a), float(b))
        places = self.placement.points.get(self.pair.links[self.guide], {})
        pa, pb = places.get(a, (0.0, 0.0)), places.get(b, (1.0, 0.0))
        if a not in places or b not in places:
            return (1.0, 0.0)
        if pa == pb:
            self.convert.note(
                f"{self.path}.along",
                f"'{a}' and '{b}' are at the same place.",
                "Name two different points, or write a direction such as [1, 0].",
            )
        return (pb[0] - pa[0], pb[1] - pa[1])

    @property
    def angle(self) -> float:
        """Constant angle from the first link's frame to the second's: stated, as drawn, or zero [rad]."""
        if self.pair.angle is not None:
            return self.convert.si(self.pair.angle, "angle", f"{self.path}.angle")
        return drawn_angle(self.pair, self.placement)

    @property
    def ends(self) -> Vec2 | None:
        """Least and greatest coordinate [m]; None where none are stated."""
        given, path = self.pair.length, f"{self.path}.length"
        if given is None:
            return None
        if not isinstance(given, list):
            return 0.0, self.convert.si(given, "length", path)
        low, high = self.convert.row(given, "length", path)
        if low >= high and self.convert.certain("length"):
            self.convert.note(path, "it ends where it begins, or before.", "Write [from, to], the greater coordinate last.")
        return low, high

    @property
    def radius(self) -> float:
        if self.pair.radius is None:  # noted where the pair was read
            return math.nan
        return self.convert.si(self.pair.radius, "length", f"{self.path}.radius")

    @property
    def radii(self) -> tuple[float, float]:
        if self.pair.radii is None:
            return math.nan, math.nan
        first, second = self.convert.row(self.pair.radii, "length", f"{self.path}.radii")
        return first, second

    @property
    def pressure_angle(self) -> float:
        if self.pair.pressure_angle is None:
            return Gear.pressure_angle
        value = self.convert.si(self.pair.pressure_angle, "angle", f"{self.path}.pressure_angle")
        if not 0.0 <= value < _STEEPEST and not math.isnan(value) and self.convert.certain("angle"):
            self.convert.note(
                f"{self.path}.pressure_angle",
                f"{as_angle(value)} is no pressure angle of teeth: they lie below {as_angle(_STEEPEST)}.",
                'Usual is "20 deg".',
            )
        return value

    @property
    def friction(self) -> Friction | None:
        return friction_spec(self.path, self.pair.kind, self.pair.friction, self.document.friction, self.convert)

    @property
    def side(self) -> Literal["left", "right"]:
        return self.pair.side or "left"

    @property
    def carrier(self) -> str:
        return carrier_of(self.document, self.pair) or ""


def _revolute(m: _Maker) -> Pair:
    return Revolute(name=m.name, links=m.pair.links, points=m.points, friction=m.friction)


def _prismatic(m: _Maker) -> Pair:
    return Prismatic(
        name=m.name,
        links=m.pair.links,
        points=m.points,
        along=m.along,
        guide=m.guide,
        angle=m.angle,
        ends=m.ends,
        friction=m.friction,
    )


def _weld(m: _Maker) -> Pair:
    return Weld(name=m.name, links=m.pair.links, points=m.points, angle=m.angle)


def _pin_slot(m: _Maker) -> Pair:
    return PinSlot(name=m.name, links=m.pair.links, points=m.points, along=m.along, guide=m.guide, ends=m.ends, friction=m.friction)


def _rolling(m: _Maker) -> Pair:
    return Rolling(
        name=m.name,
        links=m.pair.links,
        points=m.points,
        radius=m.radius,
        along=m.along,
        side=m.side,
        friction=m.friction,
    )


def _gear(m: _Maker) -> Pair:
    if m.pair.teeth is not None:
        first, second = m.pair.teeth
        sizes = (float(first), float(second))
    else:
        sizes = m.radii
    check_gear(m.path, m.pair, sizes, m.document, m.placement, m.convert)
    return Gear(
        name=m.name,
        links=m.pair.links,
        carrier=m.carrier,
        sizes=sizes,
        internal=m.pair.internal,
        pressure_angle=m.pressure_angle,
        friction=m.friction,
    )


def _belt(m: _Maker) -> Pair:
    return Belt(name=m.name, links=m.pair.links, carrier=m.carrier, radii=m.radii, crossed=m.pair.crossed)


def _rack(m: _Maker) -> Pair:
    return Rack(
        name=m.name,
        links=m.pair.links,
        slider=m.pair.slider or "",
        radius=m.radius,
        side=m.side,
        pressure_angle=m.pressure_angle,
        friction=m.friction,
    )


def _cylinder(m: _Maker) -> Pair:
    return Cylinder(name=m.name, links=m.pair.links, points=m.points, ends=m.ends, friction=m.friction)


def _planar(m: _Maker) -> Pair:
    return Planar(name=m.name, links=m.pair.links, point=m.pair.at if isinstance(m.pair.at, str) else None)


def _cam(m: _Maker) -> Pair | None:
    guide = None if m.pair.follower is None else m.document.joints.get(m.pair.follower.guide)
    return cam_pair(m.name, m.pair, guide is not None and guide.kind == "revolute", m.friction, m.convert)


_MAKE: Mapping[str, Callable[[_Maker], Pair | None]] = {
    "revolute": _revolute,
    "prismatic": _prismatic,
    "weld": _weld,
    "pin_slot": _pin_slot,
    "rolling": _rolling,
    "gear": _gear,
    "belt": _belt,
    "chain": _belt,
    "rack": _rack,
    "cylinder": _cylinder,
    "planar": _planar,
    "cam": _cam,
}


def pair_spec(name: str, pair: PairDocument, document: SceneDocument, placement: Placement, convert: Converter) -> Pair | None:
    """The core's pair; faults of its values are noted. None where too little of it is left."""
    return _MAKE[pair.kind](_Maker(name, pair, document, placement, convert))


def drawn_angle(pair: PairDocument, placement: Placement) -> float:
    """The angle from the first link's frame to the second's as they are drawn [rad]; 0 where they are not."""
    if not placement.drawn.issuperset(pair.links):
        return 0.0
    first, second = (placement.poses[link][2] for link in pair.links)
    return math.remainder(second - first, 2.0 * math.pi)


def drawn_place(pair: PairDocument, placement: Placement) -> tuple[float, float, float]:
    """The coordinates x, y [m] and angle [rad] of a planar pair as its links are drawn; 0 where they are not."""
    first, second = pair.links
    if not placement.drawn.issuperset(pair.links):
        return 0.0, 0.0, 0.0
    (x1, y1, a1), (x2, y2, _) = placement.poses[first], placement.poses[second]
    turned = drawn_angle(pair, placement)
    point = pair.at if isinstance(pair.at, str) else ""
    own = complex(*placement.points.get(second, {}).get(point, (0.0, 0.0)))
    z = complex(x2 - x1, y2 - y1) * cmath.exp(-1j * a1) + own * cmath.exp(1j * turned)
    return z.real, z.imag, turned


def modes_of(document: SceneDocument) -> dict[str, str]:
    """Assembly modes by the name that the core knows the pair by.

    The side of a cylinder is that of its eye. A cylinder that nothing drives has a positive length, never the other branch.
    """
    modes = {}
    for name, pair in document.joints.items():
        if pair.kind == "cylinder" and not pair.led:
            modes[name] = "ahead"
        if pair.mode is not None:
            modes[f"{name}.eye" if pair.kind == "cylinder" else name] = pair.mode
    return modes
