"""A faulty scene as it was probably meant: misspelt names of links, points and pairs replaced by the nearest known ones.

What is wrong is noted elsewhere; this is for the checks that come after, which would otherwise stop at the first slip or
report its consequences. A name that resembles nothing becomes ``Unknown``, which the checks pass over.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from difflib import SequenceMatcher
from typing import Any, TypeVar

from mechviz.scene.document import Pose
from mechviz.scene.faults import nearest
from mechviz.scene.fields import Table, Unknown
from mechviz.scene.kinds.joints.document import KINDS, PairDocument
from mechviz.scene.kinds.loads.document import LoadDocument
from mechviz.scene.names import (
    link_names,
    point_names,
    points_of_pair,
)
from mechviz.scene.recovery import Reading

T = TypeVar("T", bound=Table)


def _with(table: T, changes: Mapping[str, Any]) -> T:
    copy = table.model_copy(update=dict(changes))
    copy.mark_unread(table.unread)
    return copy


def _nearest(word: str, known: Collection[str]) -> str:
    """The name itself if it is known, else the only one that it resembles most."""
    if word in known:
        return word
    near = nearest(word, known, 2)
    likeness = [SequenceMatcher(None, name.casefold(), word.casefold()).ratio() for name in near]
    return near[0] if near and likeness.count(likeness[0]) == 1 else Unknown(word)


def links_as_meant(reading: Reading) -> Reading:
    """The reading with every name of a link replaced by that of a link that exists, as far as one resembles it."""
    document, links = reading.document, dict.fromkeys(link_names(reading))
    frame = _nearest(document.frame, links)
    if isinstance(frame, Unknown) and "frame" in links:
        frame = "frame"
    changes = {
        "frame": frame,
        "joints": {name: _pair_links(reading, name, pair, links) for name, pair in document.joints.items()},
        "loads": {name: _load_links(load, links) for name, load in document.loads.items()},
        "sketch": {(_nearest(name, links) if isinstance(entry, Pose) else name): entry for name, entry in document.sketch.items()},
    }
    return replace(reading, document=_with(document, changes))


def _pair_links(reading: Reading, name: str, pair: PairDocument, links: Collection[str]) -> PairDocument:
    changes: dict[str, Any] = {}
    points = points_of_pair(name, pair)
    for kind in pair.kinds:
        written = getattr(pair, kind)
        named = list(written)
        for k, link in enumerate(written):
            if link not in links:  # the only other link with this point, else one of a similar name
                owners = [other for other in _owners(reading, points[k]) if other not in written] if KINDS[kind].joins else []
                near = _nearest(link, links)
                named[k] = owners[0] if len(owners) == 1 else Unknown(link) if near in named else near
        changes[kind] = named
    if pair.carrier is not None:
        changes["carrier"] = _nearest(pair.carrier, links)
    if pair.guide is not None and pair.guide not in pair.links:
        near = _nearest(pair.guide, changes[pair.kind])
        changes["guide"] = None if isinstance(near, Unknown) else near
    return _with(pair, changes)


def _load_links(load: LoadDocument, links: Collection[str]) -> LoadDocument:
    return _with(load, {key: _nearest(name, links) for key in ("on", "against") if (name := getattr(load, key)) is not None})


def _owners(reading: Reading, point: str) -> list[str]:
    """Links that have a point of this name, or of which it is not known."""
    return [*reading.owners.get(point, ()), *reading.pointless]


def points_as_meant(reading: Reading) -> Reading:
    """The reading with every name of a point replaced by that of a point that exists, and names of driven pairs likewise."""
    document = reading.document
    every = dict.fromkeys(point for link in link_names(reading) for point in point_names(reading, link) or ())
    changes = {
        "joints": {name: _pair_points(reading, name, pair) for name, pair in document.joints.items()},
        "loads": {name: _load_names(reading, load) for name, load in document.loads.items()},
        "sketch": {(name if isinstance(entry, Pose) else _nearest(name, every)): entry for name, entry in document.sketch.items()},
        "effects": [name for name in document.effects if not isinstance(name, Unknown)],
    }
    return replace(reading, document=_with(document, changes))


def _nearest_point(reading: Reading, link: str, point: str) -> str:
    points = point_names(reading, link)
    return Unknown(point) if points is None else _nearest(point, points)


def _pair_points(reading: Reading, name: str, pair: PairDocument) -> PairDocument:
    if not pair.traits.joins or len(pair.kinds) > 1:
        return pair
    given = points_of_pair(name, pair)
    meant = [_nearest_point(reading, link, point) for link, point in zip(pair.links, given, strict=True)]
    changes: dict[str, Any] = {} if tuple(meant) == given else {"at": meant}
    if pair.along is not None and isinstance(pair.along[0], str):
        guide = pair.guide or pair.links[0]
        changes["along"] = [_nearest_point(reading, guide, str(point)) for point in pair.along]
    return _with(pair, changes)


def _load_names(reading: Reading, load: LoadDocument) -> LoadDocument:
    changes: dict[str, Any] = {}
    if load.at is not None and load.on is not None:
        changes["at"] = _nearest_point(reading, load.on, load.at)
    if load.table is not None and load.table.drive is not None:
        driven = [name for name, pair in reading.document.joints.items() if pair.led]
        near = _nearest(load.table.drive, driven)
        changes["table"] = _with(load.table, {"drive": None if isinstance(near, Unknown) else near})
    return _with(load, changes)


def touched_links(reading: Reading, name: str, pair: PairDocument) -> tuple[set[str], bool]:
    """The links that a pair joins, and whether that is certain: for a name that is not known, every link with the point."""
    sure, links = bool(pair.kinds), set()
    points = points_of_pair(name, pair)
    for k, link in enumerate(pair.links if sure else (Unknown(), Unknown())):
        if isinstance(link, Unknown) or link not in reading.document.links:
            sure = False
            links |= set(_owners(reading, points[k]) if not isinstance(points[k], Unknown) else link_names(reading))
        else:
            links.add(link)
    return links, sure
