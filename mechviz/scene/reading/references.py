"""Checks of whether the parts of a scene fit together: of names that refer to other parts, in what could be read.

For these checks a misspelt name of a link is replaced by the nearest known one: otherwise they would stop at the first slip or
report its consequences. A name that resembles no other becomes ``UnknownName``, which the checks pass over.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from difflib import SequenceMatcher
from typing import Any

from mechcore.errors import Fault
from mechviz.scene.annotations import Place, replaced
from mechviz.scene.document import Pose, value_at
from mechviz.scene.faults import did_you_mean, listing, nearest
from mechviz.scene.fields import UnknownName
from mechviz.scene.kinds.joints.document import JointDocument
from mechviz.scene.kinds.studies import check_studies
from mechviz.scene.names import (
    known_link,
    known_point,
    link_names,
    point_names,
    points_of_joint,
    references,
    split_point,
)
from mechviz.scene.reading.recovery import Reading, SpellingRepairs


def check_references(reading: Reading) -> Iterator[Fault]:
    """Faults of references in what could be read, beside those of names of links, points and joints."""
    document = reading.document
    yield from _joints(reading)
    yield from _sketch(reading)
    yield from _looks(reading)
    for key, names in (("effects", document.effects), ("metrics", document.metrics)):
        for k, name in enumerate(names):
            if name in names[:k] and not isinstance(name, SpellingRepairs):
                yield Fault(f"{key}[{k}]", f"'{name}' is listed twice.", "Leave it out once.")
    listed = "*" not in reading.unreadable["links"]
    yield from check_studies(document, {name: point_names(reading, name) for name in link_names(reading)}, listed)
    # effects that need masses
    effects = [name for name in document.effects if not isinstance(name, UnknownName) and name != "friction"]
    weightless = all(
        link.mass is None and not link.point_masses and "*" not in link.invalid_keys for link in document.links.values()
    )
    if effects and listed and weightless:
        remedy = "Give the moving links a mass, or leave out the effects."
        yield Fault("effects", f"{' and '.join(dict.fromkeys(effects))}: no link has a mass that could act.", remedy)


def check_link_names(reading: Reading) -> Iterator[Fault]:
    """Faults of names of links that do not exist, at places that their type does not mark as references."""
    document = reading.document
    if "*" not in reading.unreadable["links"] and not link_names(reading):
        yield Fault("links", "the scene has no links.", "Add a table [links] with the frame and at least one moving link.")
    elif (
        "*" not in reading.unreadable["links"]
        and not isinstance(document.frame, UnknownName)
        and document.frame not in document.links
    ):
        remedy = did_you_mean(document.frame, link_names(reading), what='Name the fixed link with frame = "..."; links')
        yield Fault("frame", f"there is no link '{document.frame}' to be the fixed one.", remedy)
    for name, joint in document.joints.items():
        unclear = any(isinstance(link, UnknownName) or link not in document.links for link in joint.links)
        if joint.guide is not None and not isinstance(joint.guide, UnknownName) and joint.guide not in joint.links and not unclear:
            remedy = did_you_mean(joint.guide, joint.links, what="Links")
            yield Fault(f"joints.{name}.guide", f"'{joint.guide}' is not one of the two links.", remedy)
    for name, entry in document.sketch.items():
        if isinstance(entry, Pose):
            yield from known_link(reading, f"sketch.{name}", name)
    owners: dict[str, tuple[str, str]] = {}
    for name, link in document.links.items():
        for point in link.points:
            owner, other = owners.setdefault(f"{name}.{point}", (name, point))
            if owner != name:
                why = f"point '{point}' of '{name}' and point '{other}' of '{owner}' are both called '{name}.{point}'."
                yield Fault(f"links.{name}", why, "Rename one of the links, best without dots.")


def _joints(reading: Reading) -> Iterator[Fault]:
    document = reading.document
    if not document.joints and not reading.kindless_joints and "*" not in reading.unreadable["joints"]:
        yield Fault("joints", "the scene has no joints.", "Add a table [joints] that joins the links.")
    for name, joint in document.joints.items():
        path = f"joints.{name}"
        if len(joint.kinds) > 1:
            continue
        points = zip(joint.links, points_of_joint(name, joint), strict=True) if joint.traits.joins_points else ()
        for k, (link, point) in enumerate(points):
            where = path if joint.at is None else f"{path}.at" if isinstance(joint.at, str) else f"{path}.at[{k}]"
            remedy = (
                "" if joint.at is not None else 'Add the point to the link, or name the joined points with at = ["...", "..."].'
            )
            yield from known_point(reading, where, link, point, remedy)
        if joint.traits.is_planar and isinstance(joint.at, str):
            yield from known_point(reading, f"{path}.at", joint.links[1], joint.at)
        elif joint.traits.is_planar and joint.at is not None:
            yield Fault(f"{path}.at", "names two points.", f"Name one point of '{joint.links[1]}'.")
        if joint.along is not None and isinstance(joint.along[0], str):
            guide = joint.guide if joint.guide in joint.links else joint.links[0]
            for k, point in enumerate(joint.along):
                yield from known_point(reading, f"{path}.along[{k}]", guide, str(point))


def _looks(reading: Reading) -> Iterator[Fault]:
    """Faults of looks: a flywheel or fan needs a shaft, a spindle belongs to the ground; "nothing" is allowed for any link."""
    document = reading.document
    pinned = {link for j in document.joints.values() if "revolute" in j.kinds and document.frame in j.links for link in j.links}
    for name, link in document.links.items():
        for kind in [link.looks] if isinstance(link.looks, str) else link.looks or ():
            if isinstance(kind, UnknownName) or kind == "nothing" or "*" in reading.unreadable["joints"]:
                continue
            if (kind == "spindle") is not (name == document.frame):
                whose = "of the fixed link, whose guides become rods" if kind == "spindle" else "on the shaft of a moving link"
                yield Fault(f"links.{name}.looks", f"a {kind} is {whose}; this is another link.", "Leave it out, or move it there.")
            elif kind != "spindle" and name not in pinned:
                remedy = "Leave it out, or give it to a link that a revolute joint joins to the fixed link."
                yield Fault(f"links.{name}.looks", f"a {kind} turns on a shaft in the ground; this link has none.", remedy)


def check_joining(reading: Reading, touched: Mapping[str, Iterable[str]]) -> Iterator[Fault]:
    """Faults of links that no chain of joints connects with the fixed link. ``touched``: the links that each joint joins, or may
    join."""
    document = reading.document
    if "*" in reading.unreadable["joints"] or not touched:
        return
    if "*" in reading.unreadable["links"] or document.frame not in document.links:
        return
    neighbours: dict[str, list[Iterable[str]]] = {}
    for links in touched.values():
        for link in links:
            neighbours.setdefault(link, []).append(links)
    reached, fresh = {document.frame}, [document.frame]
    while fresh:
        for links in neighbours.pop(fresh.pop(), ()):
            new = set(links) - reached
            reached |= new
            fresh += new
    for link in link_names(reading):
        if link not in reached:
            yield Fault(
                f"links.{link}",
                f"no chain of joints joins it to '{document.frame}'.",
                "Add the joint that is missing, or remove the link.",
            )


def check_trace(reading: Reading, *, certain: bool) -> Iterator[Fault]:
    """Faults of traced points; ``certain``: it is known which points the joints join."""
    trace = reading.document.trace
    whole = "*" not in reading.unreadable["links"] and all(point_names(reading, link) is not None for link in link_names(reading))
    first = {text: k for k, text in reversed(list(enumerate(trace)))}
    for k, text in enumerate(trace):
        if isinstance(text, UnknownName):
            continue
        if first[text] != k:
            yield Fault(f"trace[{k}]", f"'{text}' is traced twice.", "Leave it out once.")
            continue
        traced = resolve_trace(reading, text)
        if isinstance(traced, Fault) and (
            certain if "no pin joins" in traced.message else whole or "has no point" in traced.message
        ):
            yield Fault(f"trace[{k}]", traced.message, traced.remedy)


def resolve_trace(reading: Reading, text: str) -> tuple[str, str] | Fault:
    """``"E"`` or ``"coupler.E"`` -> link and point. A bare name on several links must be their common pin."""
    if (place := split_point(reading, text)) is not None:
        return place
    owners = reading.links_with_point.get(text, [])
    if not owners:
        link = text.partition(".")[0]
        own = point_names(reading, link)
        if text != link and own is not None:
            return Fault(
                "",
                f"link '{link}' has no point '{text[len(link) + 1 :]}'.",
                did_you_mean(text[len(link) + 1 :], own, what=f"Points of '{link}'"),
            )
        return Fault("", f"no link has a point '{text}'.", did_you_mean(text, reading.links_with_point, what="Points"))
    together, grew = {owners[0]}, True
    while grew:
        grew = False
        for a, b in reading.pinned.get(text, ()):
            if (a in together) != (b in together):
                together |= {a, b}
                grew = True
    if len(owners) > 1 and not together.issuperset(owners):
        choices = [f"{link}.{text}" for link in owners]
        return Fault("", f"'{text}' is on several links that no pin joins there.", f"Say which: {listing(choices)}.")
    return owners[0], text


def _sketch(reading: Reading) -> Iterator[Fault]:
    document = reading.document
    links = link_names(reading)
    points, whole = reading.links_with_point, all(point_names(reading, link) is not None for link in links)
    for name, entry in document.sketch.items():
        if isinstance(entry, Pose):
            if name == document.frame:
                yield Fault(f"sketch.{name}", "the fixed link has its place already: its frame is the world's.", "Leave it out.")
        elif name not in points and whole:
            hint = (
                "To place a link, write { at = [x, y], angle = ... }."
                if name in links
                else did_you_mean(name, points, what="Points")
            )
            yield Fault(f"sketch.{name}", f"no link has a point '{name}'.", hint)


def _nearest(word: str, known: Collection[str]) -> str:
    """The name itself if it is known, else the one that it resembles most; ``UnknownName`` where there is none, or more than
    one."""
    if word in known:
        return word
    near = nearest(word, known, 2)
    likeness = [SequenceMatcher(None, name.casefold(), word.casefold()).ratio() for name in near]
    return near[0] if near and likeness.count(likeness[0]) == 1 else UnknownName(word)


def links_repaired(reading: Reading) -> Reading:
    """The reading with every name of a link replaced by that of a link that exists, as far as one resembles it."""
    document, links = reading.document, dict.fromkeys(link_names(reading))
    frame = _nearest(document.frame, links)
    if isinstance(frame, UnknownName) and "frame" in links:
        frame = "frame"
    changes: dict[Place, Any] = {("frame",): frame}
    for leaf, reference in references(document):
        if reference.to == "link" and leaf.value not in links:
            siblings = value_at(document, leaf.path[:-1]) if isinstance(leaf.path[-1], int) else ()
            near = _nearest(leaf.value, links)
            changes[leaf.path] = UnknownName(leaf.value) if near in siblings else near
    sketch = {(_nearest(name, links) if isinstance(entry, Pose) else name): entry for name, entry in document.sketch.items()}
    document = replaced(document, {**changes, ("sketch",): sketch})
    guides = {name: joint for name, joint in document.joints.items() if joint.guide is not None and joint.guide not in joint.links}
    near_guides = {name: _nearest(joint.guide or "", joint.links) for name, joint in guides.items()}
    changes = {("joints", name, "guide"): None if isinstance(near, UnknownName) else near for name, near in near_guides.items()}
    return replace(reading, document=replaced(document, changes))


def sketch_repaired(reading: Reading) -> Reading:
    """The reading with every name of a point in the sketch replaced by that of a point that exists, as far as one resembles it."""
    points = dict.fromkeys(point for link in link_names(reading) for point in point_names(reading, link) or ())
    entries = reading.document.sketch.items()
    sketch = {name if isinstance(entry, Pose) else _nearest(name, points): entry for name, entry in entries}
    return replace(reading, document=replaced(reading.document, {("sketch",): sketch}))


def _owners(reading: Reading, point: str) -> list[str]:
    """Links that have a point of this name, or of which it is not known."""
    return [*reading.links_with_point.get(point, ()), *reading.links_without_points]


def touched_links(reading: Reading, name: str, joint: JointDocument) -> tuple[set[str], bool]:
    """The links that a joint joins, and whether that is certain. In place of an unknown name, every link with the point is
    taken."""
    sure, links = bool(joint.kinds), set()
    points = points_of_joint(name, joint)
    for k, link in enumerate(joint.links if sure else (UnknownName(), UnknownName())):
        if isinstance(link, UnknownName) or link not in reading.document.links:
            sure = False
            links |= set(_owners(reading, points[k]) if not isinstance(points[k], UnknownName) else link_names(reading))
        else:
            links.add(link)
    return links, sure
