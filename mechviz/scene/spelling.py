"""A faulty scene as it was probably meant: misspelt names of links, points and pairs replaced by the nearest known ones.

What is wrong is noted elsewhere; this is for the checks that come after, which would otherwise stop at the first slip or
report its consequences. A name that resembles nothing becomes ``Unknown``, which the checks pass over.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from difflib import SequenceMatcher
from typing import Any

from mechviz.scene.annotations import Place, replaced
from mechviz.scene.document import Pose, value_at
from mechviz.scene.faults import nearest
from mechviz.scene.fields import Unknown
from mechviz.scene.kinds.joints.document import PairDocument
from mechviz.scene.names import link_names, point_names, points_of_pair, references
from mechviz.scene.recovery import Reading


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
    changes: dict[Place, Any] = {("frame",): frame}
    for leaf, reference in references(document):
        if reference.to == "link" and leaf.value not in links:
            siblings = value_at(document, leaf.path[:-1]) if isinstance(leaf.path[-1], int) else ()
            near = _nearest(leaf.value, links)
            changes[leaf.path] = Unknown(leaf.value) if near in siblings else near
    sketch = {(_nearest(name, links) if isinstance(entry, Pose) else name): entry for name, entry in document.sketch.items()}
    document = replaced(document, {**changes, ("sketch",): sketch})
    guides = {name: pair for name, pair in document.joints.items() if pair.guide is not None and pair.guide not in pair.links}
    near_guides = {name: _nearest(pair.guide or "", pair.links) for name, pair in guides.items()}
    changes = {("joints", name, "guide"): None if isinstance(near, Unknown) else near for name, near in near_guides.items()}
    return replace(reading, document=replaced(document, changes))


def _owners(reading: Reading, point: str) -> list[str]:
    """Links that have a point of this name, or of which it is not known."""
    return [*reading.owners.get(point, ()), *reading.pointless]


def points_as_meant(reading: Reading) -> Reading:
    """The reading with every name of a point replaced by that of a point that exists, and names of driven pairs likewise."""
    document = reading.document
    every = dict.fromkeys(point for link in link_names(reading) for point in point_names(reading, link) or ())
    changes: dict[Place, Any] = {
        ("sketch",): {name if isinstance(entry, Pose) else _nearest(name, every): entry for name, entry in document.sketch.items()},
        ("effects",): [name for name in document.effects if not isinstance(name, Unknown)],
    }
    for name, pair in document.joints.items():
        if pair.traits.joins and len(pair.kinds) == 1:
            given = points_of_pair(name, pair)
            meant = [_nearest_point(reading, link, point) for link, point in zip(pair.links, given, strict=True)]
            if tuple(meant) != given:
                changes["joints", name, "at"] = meant
            if pair.along is not None and isinstance(pair.along[0], str):
                guide = pair.guide or pair.links[0]
                changes["joints", name, "along"] = [_nearest_point(reading, guide, str(point)) for point in pair.along]
    driven = [name for name, pair in document.joints.items() if pair.led]
    for name, load in document.loads.items():
        if load.at is not None and load.on is not None:
            changes["loads", name, "at"] = _nearest_point(reading, load.on, load.at)
        if load.table is not None and load.table.drive is not None:
            near = _nearest(load.table.drive, driven)
            changes["loads", name, "table", "drive"] = None if isinstance(near, Unknown) else near
    return replace(reading, document=replaced(document, changes))


def _nearest_point(reading: Reading, link: str, point: str) -> str:
    points = point_names(reading, link)
    return Unknown(point) if points is None else _nearest(point, points)


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
