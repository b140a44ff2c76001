"""Do the parts of a scene fit together? Checks of the names that refer to other parts, over what could be read."""

from __future__ import annotations

from collections.abc import Iterator

from mechcore.errors import Fault

from .document import Pose
from .faults import did_you_mean, listing
from .pairs import PairDocument
from .studies import check_studies
from .validate import Reading

__all__ = ["check_references", "known_link", "known_point", "link_names", "point_names", "points_of_pair", "resolve_trace"]


def point_names(reading: Reading, link: str) -> list[str] | None:
    """Names of the points of a link, None where the link could not be read so far."""
    if link in reading.document.links:
        return list(reading.document.links[link].points)
    raw = reading.raw.get("links", {}) if isinstance(reading.raw.get("links"), dict) else {}
    points = raw.get(link, {}).get("points") if isinstance(raw.get(link), dict) else None
    names = [name for name in points if isinstance(name, str)] if isinstance(points, dict | list) else []
    return names or None


def points_of_pair(name: str, pair: PairDocument) -> tuple[str, str]:
    """The joined points of the first and of the second link."""
    if pair.at is None:
        return name, name
    return (pair.at, pair.at) if isinstance(pair.at, str) else (pair.at[0], pair.at[1])


def link_names(reading: Reading) -> list[str]:
    """Names of all links, also of those that are faulty."""
    raw = reading.raw.get("links")
    return [str(name) for name in raw] if isinstance(raw, dict) else []


def check_references(reading: Reading) -> Iterator[Fault]:
    """Every fault of reference in what could be read."""
    document = reading.document
    if "*" not in reading.broken["links"] and not link_names(reading):
        yield Fault("links", "the scene has no links.", "Add a table [links] with the frame and at least one moving link.")
    elif "*" not in reading.broken["links"] and document.frame not in link_names(reading):
        remedy = did_you_mean(document.frame, link_names(reading), what='Name the fixed link with frame = "..."; links')
        yield Fault("frame", f"there is no link '{document.frame}' to be the fixed one.", remedy)
    yield from _pairs(reading)
    yield from _whole(reading)
    yield from _trace(reading)
    yield from _sketch(reading)
    for key, names in (("effects", document.effects), ("answers", document.answers)):
        for k, name in enumerate(names):
            if name in names[:k]:
                yield Fault(f"{key}[{k}]", f"'{name}' is listed twice.", "Leave it out once.")
    whole = not reading.broken["links"]
    yield from check_studies(document, {name: point_names(reading, name) for name in link_names(reading)}, whole)
    if document.effects and whole and all(link.mass is None and not link.lumps for link in document.links.values()):
        remedy = "Give the moving links a mass, or leave out the effects."
        yield Fault("effects", f"{' and '.join(dict.fromkeys(document.effects))}: no link has a mass that could act.", remedy)


def known_link(reading: Reading, path: str, link: str) -> Iterator[Fault]:
    """A fault where there is no such link."""
    links = link_names(reading)
    if "*" not in reading.broken["links"] and link not in links:
        yield Fault(path, f"there is no link '{link}'.", did_you_mean(link, links, what="Links"))


def known_point(reading: Reading, path: str, link: str, point: str, remedy: str = "") -> Iterator[Fault]:
    """A fault where the link has no such point."""
    points = point_names(reading, link)
    if points is not None and point not in points:
        hint = did_you_mean(point, points, what=f"Points of '{link}'")
        yield Fault(path, f"link '{link}' has no point '{point}'.", f"{hint} {remedy}".strip())


def _pairs(reading: Reading) -> Iterator[Fault]:
    document = reading.document
    if not document.pairs and not reading.broken["pairs"]:
        yield Fault("pairs", "the scene has no pairs.", "Add a table [pairs] that joins the links.")
    for name, pair in document.pairs.items():
        path = f"pairs.{name}"
        for k, link in enumerate(pair.links):
            yield from known_link(reading, f"{path}.{pair.kind}[{k}]", link)
        points = zip(pair.links, points_of_pair(name, pair), strict=True) if pair.joins else ()
        for k, (link, point) in enumerate(points):
            where = path if pair.at is None else f"{path}.at" if isinstance(pair.at, str) else f"{path}.at[{k}]"
            remedy = "" if pair.at is not None else 'Add the point to the link, or name the joined points with at = ["...", "..."].'
            yield from known_point(reading, where, link, point, remedy)
        if pair.guide is not None and pair.guide not in pair.links:
            yield Fault(
                f"{path}.guide",
                f"'{pair.guide}' is not one of the two links.",
                did_you_mean(pair.guide, pair.links, what="Links"),
            )
        elif pair.along is not None and isinstance(pair.along[0], str):
            guide = pair.guide or pair.links[0]
            for k, point in enumerate(pair.along):
                yield from known_point(reading, f"{path}.along[{k}]", guide, str(point))


def _whole(reading: Reading) -> Iterator[Fault]:
    """Is it one mechanism, and does it move?"""
    document = reading.document
    if not document.pairs or reading.broken["pairs"]:
        return
    if not reading.undriven and all(pair.drive is None for pair in document.pairs.values()):
        first = next(iter(document.pairs))
        yield Fault(
            "pairs",
            "no pair has a drive: nothing moves.",
            f'Add one, such as drive = {{ speed = "60 rpm" }} in pairs.{first}.',
        )
    links = set(link_names(reading))
    if not links.issuperset([document.frame, *(link for pair in document.pairs.values() for link in pair.links)]):
        return  # a misspelt name, reported already, may be what is missing
    reached, grew = {document.frame}, True
    while grew:
        grew = False
        for pair in document.pairs.values():
            if pair.joins and (pair.links[0] in reached) != (pair.links[1] in reached):
                reached.update(pair.links)
                grew = True
    for link in link_names(reading):
        if link not in reached:
            yield Fault(
                f"links.{link}",
                f"no chain of pairs joins it to '{document.frame}'.",
                "Add the pair that is missing, or remove the link.",
            )


def _trace(reading: Reading) -> Iterator[Fault]:
    trace = reading.document.trace
    for k, text in enumerate(trace):
        if text in trace[:k]:
            yield Fault(f"trace[{k}]", f"'{text}' is traced twice.", "Leave it out once.")
            continue
        found = resolve_trace(reading, text)
        if isinstance(found, Fault) and all(point_names(reading, link) is not None for link in link_names(reading)):
            yield Fault(f"trace[{k}]", found.message, found.remedy)


def resolve_trace(reading: Reading, text: str) -> tuple[str, str] | Fault:
    """``"E"`` or ``"coupler.E"`` -> link and point. A bare name on several links must be one place, a common pin."""
    owners: list[str] = []
    points: list[str] = []
    for link in link_names(reading):
        for point in point_names(reading, link) or ():
            if text == f"{link}.{point}":
                return link, point
            points.append(point)
            if point == text:
                owners.append(link)
    if not owners:
        link = text.partition(".")[0]
        if text != link and link in link_names(reading):
            own = point_names(reading, link) or []
            return Fault(
                "",
                f"link '{link}' has no point '{text[len(link) + 1 :]}'.",
                did_you_mean(text[len(link) + 1 :], own, what=f"Points of '{link}'"),
            )
        return Fault("", f"no link has a point '{text}'.", did_you_mean(text, dict.fromkeys(points), what="Points"))
    together, grew = {owners[0]}, True
    while grew:
        grew = False
        for name, pair in reading.document.pairs.items():
            if pair.coincide and points_of_pair(name, pair) == (text, text):
                a, b = pair.links
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
    points = list(dict.fromkeys(point for link in links for point in point_names(reading, link) or ()))
    for name, entry in document.sketch.items():
        if isinstance(entry, Pose):
            yield from known_link(reading, f"sketch.{name}", name)
            if name == document.frame:
                yield Fault(f"sketch.{name}", "the fixed link has its place already: its frame is the world's.", "Leave it out.")
        elif name not in points and not any(point_names(reading, link) is None for link in links):
            hint = (
                "To place a link, write { at = [x, y], angle = ... }."
                if name in links
                else did_you_mean(name, points, what="Points")
            )
            yield Fault(f"sketch.{name}", f"no link has a point '{name}'.", hint)
