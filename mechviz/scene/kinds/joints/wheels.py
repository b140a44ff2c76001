"""Joints of wheels: rolling on an edge, and gears, belts, chains and racks, which couple the motions of wheels held by pins; checks
that these pins exist and that the sizes fit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from mechcore.errors import Fault
from mechcore.spec.mechanism import Belt, Gear, Joint, Rack, Rolling
from mechcore.texts import as_angle, as_length
from mechviz.scene.convert import Converter
from mechviz.scene.faults import did_you_mean, listing
from mechviz.scene.fields import Angle, DocumentTable, Flag, Size, Text, UnknownName
from mechviz.scene.kinds.friction import LEVER
from mechviz.scene.kinds.kind import JointKind, JointMaker
from mechviz.scene.names import LinkName, TwoLinks, link_names, points_of_joint

if TYPE_CHECKING:
    from mechviz.scene.assembly.links import Placement
    from mechviz.scene.document import SceneDocument
    from mechviz.scene.kinds.joints.document import JointDocument
    from mechviz.scene.reading.recovery import Reading


Teeth = Annotated[int, Field(strict=True, ge=1, le=100_000)]

_FIT = 1e-3  # radii are stated with few digits: their allowed error, relative to the distance of the axes
_STEEPEST = math.radians(45.0)  # pressure angles of real teeth lie between 14.5 and 30 degrees


class WheelKeys(DocumentTable):
    """The keywords of these joints, and the keys that only they have."""

    rolling: TwoLinks | None = None
    """[link with a straight edge, wheel that rolls on it without slipping]."""
    gear: TwoLinks | None = None
    """The two gear wheels that mesh; with internal = true: [pinion, ring]."""
    belt: TwoLinks | None = None
    """The two pulleys that a belt connects."""
    chain: TwoLinks | None = None
    """The two sprockets that a chain connects."""
    rack: TwoLinks | None = None
    """[pinion, rack]."""
    carrier: LinkName | None = None
    """Gear, belt, chain: the link to which both wheels are pinned. Default: the fixed link, or the only one possible."""
    teeth: Annotated[list[Teeth], Field(min_length=2, max_length=2)] | None = None
    """Gear: numbers of teeth [first, second]."""
    radii: Annotated[list[Size], Field(min_length=2, max_length=2)] | None = None
    """Gear, belt, chain: pitch radii [first, second]."""
    radius: Size | None = None
    """Rolling: radius of the wheel. Rack: pitch radius of the pinion."""
    internal: Flag = False
    """Gear: the second wheel is a ring with its teeth inside."""
    pressure_angle: Angle | None = None
    """Gear, rack: angle between the force and the tangent of the pitch circles. Default 20 deg."""
    crossed: Flag = False
    """Belt: it crosses between the pulleys, which then turn in opposite directions."""
    slider: Text | None = None
    """Rack: the prismatic joint that guides the rack on the link to which the pinion is pinned."""


# -- joints of the core -----------------------------------------------------------------------------------------------
def _rolling(m: JointMaker) -> Joint:
    return Rolling(
        name=m.name,
        links=m.joint.links,
        points=m.points,
        radius=m.radius,
        along=m.along,
        side=m.side,
        friction=m.friction,
    )


def _gear(m: JointMaker) -> Joint:
    sizes = _radii(m) if m.joint.teeth is None else (float(m.joint.teeth[0]), float(m.joint.teeth[1]))
    _check_sizes(m.path, m.joint, sizes, m.document, m.placement, m.convert)
    return Gear(
        name=m.name,
        links=m.joint.links,
        carrier=carrier_of(m.document, m.joint) or "",
        sizes=sizes,
        internal=m.joint.internal,
        pressure_angle=_pressure_angle(m),
        friction=m.friction,
    )


def _belt(m: JointMaker) -> Joint:
    carrier = carrier_of(m.document, m.joint) or ""
    return Belt(name=m.name, links=m.joint.links, carrier=carrier, radii=_radii(m), crossed=m.joint.crossed)


def _rack(m: JointMaker) -> Joint:
    return Rack(
        name=m.name,
        links=m.joint.links,
        slider=m.joint.slider or "",
        radius=m.radius,
        side=m.side,
        pressure_angle=_pressure_angle(m),
        friction=m.friction,
    )


def _radii(m: JointMaker) -> tuple[float, float]:
    if m.joint.radii is None:
        return math.nan, math.nan
    first, second = m.convert.row(m.joint.radii, "length", f"{m.path}.radii")
    return first, second


def _pressure_angle(m: JointMaker) -> float:
    if m.joint.pressure_angle is None:
        return Gear.pressure_angle
    value = m.convert.si(m.joint.pressure_angle, "angle", f"{m.path}.pressure_angle")
    if not 0.0 <= value < _STEEPEST and not math.isnan(value) and m.convert.has_known_unit("angle"):
        m.convert.note(
            f"{m.path}.pressure_angle",
            f"{as_angle(value)} is no pressure angle of teeth: they lie below {as_angle(_STEEPEST)}.",
            'Usual is "20 deg".',
        )
    return value


# -- names that they refer to -----------------------------------------------------------------------------------------
def _pinned_to(document: SceneDocument, link: str) -> dict[str, str]:
    """Links that a revolute joint joins to a link -> that joint, the first one of each."""
    links: dict[str, str] = {}
    for name, joint in document.joints.items():
        if joint.kind == "revolute" and link in joint.links:
            links.setdefault(joint.links[0] if joint.links[1] == link else joint.links[1], name)
    return links


def _on_one_axis(document: SceneDocument, link: str) -> list[str]:
    """All links that turn about the same axes as a link: those that a pin joins to it, and those pinned at the same places of them.

    Welds are followed, too; whether the axis is then the same is checked when the scene is compiled.
    """
    axle, ends = [link], [(link, "")]
    for here, place in ends:  # grows during the loop
        for name, joint in document.joints.items():
            if joint.kind not in ("revolute", "weld") or here not in joint.links:
                continue
            at = list(joint.at) if isinstance(joint.at, list) else [joint.at or name] * 2
            side = joint.links.index(here)
            if joint.kind == "weld":
                end = (joint.links[1 - side], "")
            elif place in ("", at[side]) or _places(document, here, place) == _places(document, here, at[side]):
                end = (joint.links[1 - side], at[1 - side])
            else:
                continue
            if end not in ends:
                ends.append(end)
                axle.append(end[0])
    return list(dict.fromkeys(axle))[1:]


def _places(document: SceneDocument, link: str, name: str) -> object:
    """The coordinates of a point as the scene states them, else its name."""
    known = document.links.get(link)
    return known.points.get(name, name) if known is not None and isinstance(known.points, dict) else name


def carrier_of(document: SceneDocument, joint: JointDocument) -> str | None:
    """The link that carries both wheels: stated, or the fixed link, or the only one that both are pinned to."""
    if joint.carrier is not None:
        return joint.carrier
    both: list[str] = []
    for neighbours in (_pinned_to, _on_one_axis):  # directly, or through others on the same axis
        first, second = (neighbours(document, link) for link in joint.links)
        both = both or [link for link in first if link in second and link not in joint.links]
    if document.frame in both:
        return document.frame
    return both[0] if len(both) == 1 else None


def _unclear(reading: Reading) -> bool:
    """Whether the links of some joint are unknown, so that it may be the one that seems to be missing."""
    joints = reading.document.joints.values()
    doubtful = any(len(joint.kinds) > 1 or any(isinstance(link, UnknownName) for link in joint.links) for joint in joints)
    return bool(reading.kindless_joints) or doubtful or "*" in reading.unreadable["joints"]


def _check_carrier(reading: Reading, path: str, joint: JointDocument) -> Iterator[Fault]:
    document, links = reading.document, link_names(reading)
    if isinstance(joint.carrier, UnknownName):
        return
    if joint.carrier in joint.links:
        yield Fault(
            f"{path}.carrier",
            f"'{joint.carrier}' is one of the wheels.",
            "Name the link to which both wheels are pinned.",
        )
        return
    if _unclear(reading) or not set(joint.links) <= set(links):
        return  # the pin that is missing may be the one that could not be read
    carrier = carrier_of(document, joint)
    if carrier is not None:
        where = path if joint.carrier is None else f"{path}.carrier"
        for link in joint.links:
            if carrier not in _on_one_axis(document, link):
                yield _not_pinned(where, link, carrier, list(_pinned_to(document, link)))
        return
    first, second = (list(_pinned_to(document, link)) for link in joint.links)
    both = [link for link in first if link in second]
    if both:
        pinned = f"'{joint.links[0]}' and '{joint.links[1]}' are both pinned to {listing(both)}."
        yield Fault(path, pinned, "Say which one carries them: carrier = ...")
        return
    words = "; ".join(f"'{link}' to {listing(own) or 'nothing'}" for link, own in zip(joint.links, (first, second), strict=True))
    yield Fault(
        path,
        f"no link carries both wheels: a pin joins {words}.",
        "Pin both to the same link, or to others on the same axis.",
    )


def _not_pinned(path: str, link: str, carrier: str, others: list[str]) -> Fault:
    known = f" It is pinned to {listing(others)}." if others else ""
    return Fault(
        path,
        f"'{link}' is not pinned to '{carrier}', which is to carry it.{known}",
        f'Add a joint {{ revolute = ["{carrier}", "{link}"], at = ... }}, or name another carrier.',
    )


def _check_rack(reading: Reading, path: str, joint: JointDocument) -> Iterator[Fault]:
    document = reading.document
    pinion, rack = joint.links
    if _unclear(reading) or joint.slider is None or not {pinion, rack} <= set(link_names(reading)):
        return
    guides = [name for name, other in document.joints.items() if other.kind == "prismatic" and rack in other.links]
    if joint.slider not in guides:
        known = document.joints.get(joint.slider)
        message = (
            f"there is no joint '{joint.slider}'."
            if known is None
            else f"'{joint.slider}' is no prismatic joint of '{rack}', which it is to guide."
        )
        near = did_you_mean(joint.slider, guides, what=f"Prismatic joints of '{rack}'")
        remedy = near or f"Add a prismatic joint between '{rack}' and the link that carries '{pinion}'."
        yield Fault(f"{path}.slider", message, remedy)
        return
    guide = document.joints[joint.slider].links
    carrier = guide[0] if guide[1] == rack else guide[1]
    if carrier not in _on_one_axis(document, pinion):
        yield _not_pinned(path, pinion, carrier, list(_pinned_to(document, pinion)))


def _check_sizes(
    path: str, joint: JointDocument, sizes: tuple[float, float], document: SceneDocument, placement: Placement, convert: Converter
) -> None:
    """Note sizes that cannot mesh: a ring that is not larger than its pinion, radii that do not fit the axes' distance [m]."""
    if any(map(math.isnan, sizes)):
        return
    key = "teeth" if joint.teeth is not None else "radii"
    if joint.internal and sizes[1] <= sizes[0]:
        convert.note(
            f"{path}.{key}",
            "the ring is not larger than the pinion.",
            "An internal gear pair lists the pinion first and the ring second.",
        )
        return
    distance = _axes_apart(joint, document, placement)
    if key == "teeth" or distance is None:
        return
    sum_of = sizes[1] - sizes[0] if joint.internal else sizes[0] + sizes[1]
    if abs(sum_of - distance) > _FIT * distance and convert.has_known_unit("length"):
        word = "difference" if joint.internal else "sum"
        convert.note(
            f"{path}.radii",
            f"their {word} is {as_length(sum_of)}, but the axes are {as_length(distance)} apart.",
            "Change the radii, or give teeth: then the pitch radii follow from the distance.",
        )


def _axes_apart(joint: JointDocument, document: SceneDocument, placement: Placement) -> float | None:
    """Distance of the two wheels' axes on their carrier [m], None where it is not known."""
    carrier = carrier_of(document, joint)
    places = []
    for link in joint.links:
        name = _pinned_to(document, link).get(carrier or "")
        if name is None:
            return None
        pin = document.joints[name]
        point = points_of_joint(name, pin)[pin.links.index(carrier or "")]
        place = placement.points.get(carrier or "", {}).get(point)
        if place is None:
            return None
        places.append(place)
    distance = math.dist(*places)
    return None if math.isnan(distance) or distance == 0.0 else distance


_WHEELS = "Drive the revolute joint of one of its wheels instead."
_RADII = {"radii": '["50 mm", "100 mm"]'}
_HELD = "Leave it out: the pins that hold the {} say where they are."
_BOTH = "Write radii = [first, second]."

WHEELS = {
    "rolling": JointKind(
        words="a rolling joint",
        example='{ rolling = ["frame", "wheel"], at = ["E", "C"], radius = "50 mm" }',
        make=_rolling,
        keys=("at", "along", "radius", "side", "branch", "friction", "drive", "free", "stops"),
        needs={"radius": '"50 mm"'},
        modes=("branch",),
        synonyms=("wheel",),
        remedies={"radii": "Write radius = ...", "guide": "Leave it out: the edge is on the link that is named first."},
        driven="length",
        viscous="torsional damping",
        friction=LEVER,
    ),
    "gear": JointKind(
        words="a gear pair",
        example='{ gear = ["pinion", "wheel"], teeth = [20, 60] }',
        make=_gear,
        keys=("carrier", "teeth", "radii", "internal", "pressure_angle", "friction"),
        synonyms=("gears", "planet"),
        remedies={"radius": "Write radii = [first, second] or teeth = [first, second].", "at": _HELD.format("wheels")},
        undriven=_WHEELS,
        viscous="torsional damping",
        friction=LEVER,
        joins_points=False,
        places_link=False,
        higher=True,
        one_of=("teeth", "radii"),
        check=_check_carrier,
    ),
    "belt": JointKind(
        words="a belt",
        example='{ belt = ["motor", "fan"], radii = ["50 mm", "100 mm"] }',
        make=_belt,
        keys=("carrier", "radii", "crossed"),
        needs=_RADII,
        synonyms=("belts", "pulleys"),
        remedies={
            "radius": _BOTH,
            "teeth": _BOTH,
            "friction": "Give its pins friction; its own drag is a load, viscous, and belt_tension shows where it slips.",
            "at": _HELD.format("pulleys"),
        },
        undriven=_WHEELS,
        viscous="damping",
        joins_points=False,
        places_link=False,
        check=_check_carrier,
    ),
    "chain": JointKind(
        words="a chain",
        example='{ chain = ["pedals", "hub"], radii = ["90 mm", "40 mm"] }',
        make=_belt,
        keys=("carrier", "radii"),
        needs=_RADII,
        synonyms=("sprockets",),
        remedies={
            "radius": _BOTH,
            "teeth": "Write radii = [first, second]: the pitch radii of the sprockets.",
            "friction": "Give its pins friction; its own drag is a load, viscous.",
            "crossed": "Chains do not cross: leave it out, or write belt = [...].",
            "at": _HELD.format("sprockets"),
        },
        undriven=_WHEELS,
        viscous="damping",
        joins_points=False,
        places_link=False,
        check=_check_carrier,
    ),
    "rack": JointKind(
        words="a rack",
        example='{ rack = ["pinion", "bar"], slider = "S", radius = "40 mm" }',
        make=_rack,
        keys=("slider", "radius", "side", "pressure_angle", "friction"),
        needs={"slider": "the name of the rack's prismatic joint", "radius": '"50 mm"'},
        synonyms=("pinion",),
        remedies={
            "radii": "Write radius = ..., the pitch radius of the pinion.",
            "teeth": "Write radius = ..., the pitch radius of the pinion.",
            "at": "Leave it out: the pinion's pin and the rack's guide say where they are.",
        },
        undriven="Drive the pinion's revolute joint, or the rack's prismatic one, instead.",
        viscous="torsional damping",
        friction=LEVER,
        joins_points=False,
        places_link=False,
        higher=True,
        check=_check_rack,
    ),
}
"""The kinds of joints of wheels."""
