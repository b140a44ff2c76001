"""Gears, belts and racks tie motions of wheels together that pins hold: do these pins exist, and do the sizes fit?"""

from __future__ import annotations

import math
from collections.abc import Iterator

from mechcore.errors import Fault
from mechcore.texts import as_length
from mechviz.scene.cams.cams import SOLIDS
from mechviz.scene.convert import Converter
from mechviz.scene.document import SceneDocument
from mechviz.scene.faults import did_you_mean, listing
from mechviz.scene.fields import Unknown
from mechviz.scene.kinds.joints import PairDocument
from mechviz.scene.placement import Placement
from mechviz.scene.recovery import Reading
from mechviz.scene.references import known_point, points_of_pair

_FIT = 1e-3  # radii are stated with few digits: how far they may miss the distance of the axes, relative to it


def _pinned_to(document: SceneDocument, link: str) -> dict[str, str]:
    """Links that a revolute pair joins to a link -> that pair, the first one of each."""
    found: dict[str, str] = {}
    for name, pair in document.joints.items():
        if pair.kind == "revolute" and link in pair.links:
            found.setdefault(pair.links[0] if pair.links[1] == link else pair.links[1], name)
    return found


def _on_one_axis(document: SceneDocument, link: str) -> list[str]:
    """All links that turn about the same axes as a link: those that a pin joins to it, and those pinned at the same places of them.

    Welds are followed too; whether the axis is then the same is seen when the scene is compiled.
    """
    found, ends = [link], [(link, "")]
    for here, place in ends:  # grows while it is walked through
        for name, pair in document.joints.items():
            if pair.kind not in ("revolute", "weld") or here not in pair.links:
                continue
            at = list(pair.at) if isinstance(pair.at, list) else [pair.at or name] * 2
            side = pair.links.index(here)
            if pair.kind == "weld":
                end = (pair.links[1 - side], "")
            elif place in ("", at[side]) or _places(document, here, place) == _places(document, here, at[side]):
                end = (pair.links[1 - side], at[1 - side])
            else:
                continue
            if end not in ends:
                ends.append(end)
                found.append(end[0])
    return list(dict.fromkeys(found))[1:]


def _places(document: SceneDocument, link: str, name: str) -> object:
    """What a scene says about where a point is."""
    known = document.links.get(link)
    return known.points.get(name, name) if known is not None and isinstance(known.points, dict) else name


def carrier_of(document: SceneDocument, pair: PairDocument) -> str | None:
    """The link that carries both wheels: stated, or the fixed link, or the only one that both are pinned to."""
    if pair.carrier is not None:
        return pair.carrier
    both: list[str] = []
    for neighbours in (_pinned_to, _on_one_axis):  # directly, or by way of others on the same axis
        first, second = (neighbours(document, link) for link in pair.links)
        both = both or [link for link in first if link in second and link not in pair.links]
    if document.frame in both:
        return document.frame
    return both[0] if len(both) == 1 else None


def check_couplings(reading: Reading) -> Iterator[Fault]:
    """Faults of the links and pairs that gears, belts and racks name."""
    for name, pair in reading.document.joints.items():
        if len(pair.kinds) > 1:
            continue
        if pair.kind in ("gear", "belt", "chain"):
            yield from _carried(reading, f"joints.{name}", pair)
        elif pair.kind == "rack":
            yield from _rack(reading, f"joints.{name}", pair)
        elif pair.kind == "cam":
            yield from check_cam(reading, f"joints.{name}", pair)
        elif pair.kind in ("cylinder", "planar"):
            yield from _own_names(reading, name)


def _links(reading: Reading) -> list[str]:
    raw = reading.raw.get("links")
    return [str(name) for name in raw] if isinstance(raw, dict) else []


def _unclear(reading: Reading) -> bool:
    """Whether it is not known of some pair which links it joins, so that it may be the one that is missed."""
    pairs = reading.document.joints.values()
    doubtful = any(len(pair.kinds) > 1 or any(isinstance(link, Unknown) for link in pair.links) for pair in pairs)
    return bool(reading.shapeless) or doubtful or "*" in reading.broken["joints"]


def _carried(reading: Reading, path: str, pair: PairDocument) -> Iterator[Fault]:
    document, links = reading.document, _links(reading)
    if isinstance(pair.carrier, Unknown):
        return
    if pair.carrier in pair.links:
        yield Fault(
            f"{path}.carrier",
            f"'{pair.carrier}' is one of the wheels.",
            "Name the link to which both wheels are pinned.",
        )
        return
    if _unclear(reading) or not set(pair.links) <= set(links):
        return  # the pin that is missing may be the one that could not be read
    carrier = carrier_of(document, pair)
    if carrier is not None:
        where = path if pair.carrier is None else f"{path}.carrier"
        for link in pair.links:
            if carrier not in _on_one_axis(document, link):
                yield _not_pinned(where, link, carrier, list(_pinned_to(document, link)))
        return
    first, second = (list(_pinned_to(document, link)) for link in pair.links)
    both = [link for link in first if link in second]
    if both:
        pinned = f"'{pair.links[0]}' and '{pair.links[1]}' are both pinned to {listing(both)}."
        yield Fault(path, pinned, "Say which one carries them: carrier = ...")
        return
    words = "; ".join(f"'{link}' to {listing(own) or 'nothing'}" for link, own in zip(pair.links, (first, second), strict=True))
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
        f'Add a pair {{ revolute = ["{carrier}", "{link}"], at = ... }}, or name another carrier.',
    )


def _rack(reading: Reading, path: str, pair: PairDocument) -> Iterator[Fault]:
    document = reading.document
    pinion, rack = pair.links
    if _unclear(reading) or pair.slider is None or not {pinion, rack} <= set(_links(reading)):
        return
    guides = [name for name, other in document.joints.items() if other.kind == "prismatic" and rack in other.links]
    if pair.slider not in guides:
        known = document.joints.get(pair.slider)
        message = (
            f"there is no pair '{pair.slider}'."
            if known is None
            else f"'{pair.slider}' is no prismatic pair of '{rack}', which it is to guide."
        )
        near = did_you_mean(pair.slider, guides, what=f"Prismatic pairs of '{rack}'")
        remedy = near or f"Add a prismatic pair between '{rack}' and the link that carries '{pinion}'."
        yield Fault(f"{path}.slider", message, remedy)
        return
    guide = document.joints[pair.slider].links
    carrier = guide[0] if guide[1] == rack else guide[1]
    if carrier not in _on_one_axis(document, pinion):
        yield _not_pinned(path, pinion, carrier, list(_pinned_to(document, pinion)))


def _own_names(reading: Reading, name: str) -> Iterator[Fault]:
    """Cylinders and planar pairs bring links and joints along, whose names must be free."""
    kind = reading.document.joints[name].kind
    links, joints = (("barrel", "rod"), ("base", "eye")) if kind == "cylinder" else (("x", "y"), ("x", "y"))
    for section, parts, taken in (("links", links, _links(reading)), ("joints", joints, list(reading.document.joints))):
        for part in parts:
            if f"{name}.{part}" in taken:
                yield Fault(
                    f"{section}.{name}.{part}",
                    f"the {kind} '{name}' brings along a part of this name.",
                    f"Rename the {section[:-1]} or the {kind}.",
                )


def check_gear(
    path: str, pair: PairDocument, sizes: tuple[float, float], document: SceneDocument, placement: Placement, convert: Converter
) -> None:
    """Notes sizes that cannot mesh: a ring that is not larger than its pinion, radii that do not fit the axes' distance [m]."""
    if any(map(math.isnan, sizes)):
        return
    key = "teeth" if pair.teeth is not None else "radii"
    if pair.internal and sizes[1] <= sizes[0]:
        convert.note(
            f"{path}.{key}",
            "the ring is not larger than the pinion.",
            "An internal gear pair lists the pinion first and the ring second.",
        )
        return
    distance = _axes_apart(pair, document, placement)
    if key == "teeth" or distance is None:
        return
    sum_of = sizes[1] - sizes[0] if pair.internal else sizes[0] + sizes[1]
    if abs(sum_of - distance) > _FIT * distance and convert.certain("length"):
        word = "difference" if pair.internal else "sum"
        convert.note(
            f"{path}.radii",
            f"their {word} is {as_length(sum_of)}, but the axes are {as_length(distance)} apart.",
            "Change the radii, or give teeth: then the pitch radii follow from the distance.",
        )


def _axes_apart(pair: PairDocument, document: SceneDocument, placement: Placement) -> float | None:
    """Distance of the two wheels' axes on their carrier [m], None where it is not known."""
    carrier = carrier_of(document, pair)
    places = []
    for link in pair.links:
        name = _pinned_to(document, link).get(carrier or "")
        if name is None:
            return None
        pin = document.joints[name]
        point = points_of_pair(name, pin)[pin.links.index(carrier or "")]
        place = placement.points.get(carrier or "", {}).get(point)
        if place is None:
            return None
        places.append(place)
    distance = math.dist(*places)
    return None if math.isnan(distance) or distance == 0.0 else distance


def check_cam(reading: Reading, path: str, pair: PairDocument) -> Iterator[Fault]:
    """Faults of the pairs and the point that a cam names."""
    document = reading.document
    cam, follower = pair.links
    wanted: list[tuple[str, str, str, tuple[str, ...]]] = []
    if pair.follower is not None:
        wanted.append((f"{path}.follower.guide", pair.follower.guide, follower, ("prismatic", "revolute")))
    if pair.profile is not None and pair.profile.bed is not None:
        wanted.append((f"{path}.profile.bed", pair.profile.bed, cam, ("prismatic",)))
    for where, name, link, kinds in wanted:
        if isinstance(name, Unknown) or link not in document.links or reading.shapeless:
            continue
        guides = [key for key, other in document.joints.items() if other.kind in kinds and link in other.links]
        if name not in guides and "*" not in reading.broken["joints"]:
            words = " or ".join(kinds)
            known = name in document.joints
            message = f"'{name}' is no {words} pair of '{link}'." if known else f"there is no pair '{name}'."
            near = did_you_mean(name, guides, what=f"Pairs that guide '{link}'")
            yield Fault(where, message, near or f"Add a {words} pair that guides '{link}'.")
    if pair.follower is not None and not isinstance(pair.follower.point, Unknown):
        owner = follower if pair.follower.groove is None else cam
        yield from known_point(reading, f"{path}.follower.point", owner, pair.follower.point)
        if pair.follower.groove is not None and pair.closure != "form" and not pair.unread:
            yield Fault(f"{path}.follower.groove", "a groove where closure is 'force'.", "Add closure = 'form'.")
        second = pair.follower.second
        if second is not None and not isinstance(second.point, Unknown):
            yield from known_point(reading, f"{path}.follower.second.point", follower, second.point)
        if second is not None and pair.closure != "form" and not pair.unread:
            yield Fault(f"{path}.follower.second", "a second roller where closure is 'force'.", "Add closure = 'form'.")
        lone = [key for key in (*SOLIDS, "bed") if getattr(pair.profile, key, None) is not None]
        if second is not None and lone:
            yield Fault(f"{path}.follower.second", f"a second roller does not go with {lone[0]}.", "Leave it out.")
