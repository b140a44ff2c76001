"""Do the parts of a scene fit together? Checks of the names that refer to other parts, over what could be read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from mechcore.errors import Fault
from mechviz.scene.document import Pose
from mechviz.scene.faults import did_you_mean, listing
from mechviz.scene.fields import Unknown
from mechviz.scene.kinds.joints import KINDS, PairDocument
from mechviz.scene.kinds.loads import MACHINES, LoadDocument
from mechviz.scene.kinds.studies import check_studies
from mechviz.scene.recovery import Meant, Reading


def point_names(reading: Reading, link: str) -> list[str] | None:
    """Names of the points of a link, None where they could not be read (or there is no such link)."""
    found = reading.document.links.get(link)
    return list(found.points) if found is not None and found.sound("points") else None


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
    """Every fault of reference beside those of ``check_link_names``, in what could be read."""
    document = reading.document
    yield from _pairs(reading)
    yield from _sketch(reading)
    for key, names in (("effects", document.effects), ("answers", document.answers)):
        for k, name in enumerate(names):
            if name in names[:k] and not isinstance(name, Meant):
                yield Fault(f"{key}[{k}]", f"'{name}' is listed twice.", "Leave it out once.")
    listed = "*" not in reading.broken["links"]
    yield from check_studies(document, {name: point_names(reading, name) for name in link_names(reading)}, listed)
    effects = [name for name in document.effects if not isinstance(name, Unknown) and name != "friction"]  # those that masses make
    weightless = all(link.mass is None and not link.lumps and "*" not in link.unread for link in document.links.values())
    if effects and listed and weightless:
        remedy = "Give the moving links a mass, or leave out the effects."
        yield Fault("effects", f"{' and '.join(dict.fromkeys(effects))}: no link has a mass that could act.", remedy)


def check_link_names(reading: Reading) -> Iterator[Fault]:
    """Every name of a link that does not exist."""
    document = reading.document
    if "*" not in reading.broken["links"] and not link_names(reading):
        yield Fault("links", "the scene has no links.", "Add a table [links] with the frame and at least one moving link.")
    elif "*" not in reading.broken["links"] and not isinstance(document.frame, Unknown) and document.frame not in document.links:
        remedy = did_you_mean(document.frame, link_names(reading), what='Name the fixed link with frame = "..."; links')
        yield Fault("frame", f"there is no link '{document.frame}' to be the fixed one.", remedy)
    for name, pair in document.joints.items():
        for kind in pair.kinds:
            for k, link in enumerate(_as_written(reading, name, kind, getattr(pair, kind))):
                yield from known_link(reading, f"joints.{name}.{kind}[{k}]", link)
        unclear = any(isinstance(link, Unknown) or link not in document.links for link in pair.links)
        if pair.guide is not None and not isinstance(pair.guide, Unknown) and pair.guide not in pair.links and not unclear:
            remedy = did_you_mean(pair.guide, pair.links, what="Links")
            yield Fault(f"joints.{name}.guide", f"'{pair.guide}' is not one of the two links.", remedy)
        if pair.carrier is not None:
            yield from known_link(reading, f"joints.{name}.carrier", pair.carrier)
    for name, entry in document.sketch.items():
        if isinstance(entry, Pose):
            yield from known_link(reading, f"sketch.{name}", name)


def _as_written(reading: Reading, name: str, kind: str, links: list[str]) -> list[str]:
    """The names of a pair's links, also where there are too many or too few of them to be a pair."""
    if not any(isinstance(link, Unknown) for link in links):
        return links
    pairs = reading.raw.get("joints")
    item = pairs.get(name) if isinstance(pairs, dict) else None
    written = item.get(kind) if isinstance(item, dict) else None
    return [link if isinstance(link, str) else Unknown() for link in written] if isinstance(written, list) else []


def known_link(reading: Reading, path: str, link: str) -> Iterator[Fault]:
    """A fault where there is no such link."""
    if link in reading.document.links:
        return
    links = link_names(reading)
    if "*" not in reading.broken["links"] and link not in links and not isinstance(link, Unknown):
        yield Fault(path, f"there is no link '{link}'.", did_you_mean(link, links, what="Links"))


def known_point(reading: Reading, path: str, link: str, point: str, remedy: str = "") -> Iterator[Fault]:
    """A fault where the link has no such point."""
    points = point_names(reading, link)
    if points is not None and point not in points and not isinstance(point, Unknown):
        hint = did_you_mean(point, points, what=f"Points of '{link}'")
        yield Fault(path, f"link '{link}' has no point '{point}'.", f"{hint} {remedy}".strip())


def _pairs(reading: Reading) -> Iterator[Fault]:
    document = reading.document
    if not document.joints and not reading.shapeless and "*" not in reading.broken["joints"]:
        yield Fault("joints", "the scene has no joints.", "Add a table [joints] that joins the links.")
    for name, pair in document.joints.items():
        path = f"joints.{name}"
        if len(pair.kinds) > 1:
            continue
        points = zip(pair.links, points_of_pair(name, pair), strict=True) if pair.joins else ()
        for k, (link, point) in enumerate(points):
            where = path if pair.at is None else f"{path}.at" if isinstance(pair.at, str) else f"{path}.at[{k}]"
            remedy = "" if pair.at is not None else 'Add the point to the link, or name the joined points with at = ["...", "..."].'
            yield from known_point(reading, where, link, point, remedy)
        if pair.kind == "planar" and isinstance(pair.at, str):
            yield from known_point(reading, f"{path}.at", pair.links[1], pair.at)
        elif pair.kind == "planar" and pair.at is not None:
            yield Fault(f"{path}.at", "names two points.", f"Name one point of '{pair.links[1]}'.")
        if pair.along is not None and isinstance(pair.along[0], str):
            guide = pair.guide if pair.guide in pair.links else pair.links[0]
            for k, point in enumerate(pair.along):
                yield from known_point(reading, f"{path}.along[{k}]", guide, str(point))


def check_joining(reading: Reading, touched: Mapping[str, Iterable[str]]) -> Iterator[Fault]:
    """Is it one mechanism? ``touched`` says which links each pair joins, or may join."""
    document = reading.document
    if "*" in reading.broken["joints"] or not touched:
        return
    if "*" in reading.broken["links"] or document.frame not in document.links:
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
                f"no chain of pairs joins it to '{document.frame}'.",
                "Add the pair that is missing, or remove the link.",
            )


def check_trace(reading: Reading, *, certain: bool) -> Iterator[Fault]:
    """Points that are traced; ``certain`` says whether it is known which points the pairs join."""
    trace = reading.document.trace
    whole = "*" not in reading.broken["links"] and all(point_names(reading, link) is not None for link in link_names(reading))
    for k, text in enumerate(trace):
        if isinstance(text, Unknown):
            continue
        if text in trace[:k]:
            yield Fault(f"trace[{k}]", f"'{text}' is traced twice.", "Leave it out once.")
            continue
        found = resolve_trace(reading, text)
        if isinstance(found, Fault) and (certain if "no pin joins" in found.message else whole or "has no point" in found.message):
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
        own = point_names(reading, link)
        if text != link and own is not None:
            return Fault(
                "",
                f"link '{link}' has no point '{text[len(link) + 1 :]}'.",
                did_you_mean(text[len(link) + 1 :], own, what=f"Points of '{link}'"),
            )
        return Fault("", f"no link has a point '{text}'.", did_you_mean(text, dict.fromkeys(points), what="Points"))
    together, grew = {owners[0]}, True
    while grew:
        grew = False
        for name, pair in reading.document.joints.items():
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
            if name == document.frame:
                yield Fault(f"sketch.{name}", "the fixed link has its place already: its frame is the world's.", "Leave it out.")
        elif name not in points and not any(point_names(reading, link) is None for link in links):
            hint = (
                "To place a link, write { at = [x, y], angle = ... }."
                if name in links
                else did_you_mean(name, points, what="Points")
            )
            yield Fault(f"sketch.{name}", f"no link has a point '{name}'.", hint)


_SLIDES = ("prismatic", "cylinder")
_PUSHED = ("prismatic", "pin_slot", "cylinder")
_MOVES = ("revolute", "prismatic", "pin_slot", "cylinder", "rolling", "gear", "rack", "belt", "chain", "cam")


def split_point(reading: Reading, text: str) -> tuple[str, str] | None:
    """``"link.point"`` -> link and point, None where the scene has none such."""
    for link in link_names(reading):
        for point in point_names(reading, link) or ():
            if text == f"{link}.{point}":
                return link, point
    return None


def check_loads(reading: Reading) -> Iterator[Fault]:
    """Every fault of reference in the loads that could be read."""
    for name, load in reading.document.loads.items():
        path = f"loads.{name}"
        yield from _prescribed(reading, load, path)
        if isinstance(load.actuator, str):
            yield from _pair(reading, f"{path}.actuator", load.actuator, _PUSHED, "sliding pair")
        for key in ("spring", "damper", "gas_spring", "actuator", "bushing"):
            ends = getattr(load, key) if isinstance(getattr(load, key), list) else None
            for k, text in enumerate(ends or ()):
                yield from _point(reading, f"{path}.{key}[{k}]", text)
            found = [split_point(reading, text) for text in ends or ()]
            if ends and ends[0] != ends[1] and found[0] and found[1] and found[0][0] == found[1][0]:
                yield Fault(f"{path}.{key}", f"both points are on '{found[0][0]}'.", "Name points of two links.")
        for key in ("torsion_spring", "torsion_damper"):
            for k, link in enumerate(getattr(load, key) or ()):
                yield from known_link(reading, f"{path}.{key}[{k}]", link)
        if load.drag is not None and load.drag not in link_names(reading):
            yield from _point(reading, f"{path}.drag", load.drag, links=True)
        if load.drag == reading.document.frame:
            yield Fault(f"{path}.drag", f"'{load.drag}' is the fixed link: it does not move.", "Name a moving link.")
        yield from _pair(reading, f"{path}.viscous", load.viscous, _MOVES, "pair that moves")
        yield from _pair(reading, f"{path}.servo", load.servo, ("revolute", *_PUSHED), "revolute or sliding pair")
        servo = reading.document.joints.get(load.servo or "")
        if servo is not None and servo.drive is not None:
            why = f"the drive of '{load.servo}' decides its motion, whatever a servo does."
            yield Fault(f"{path}.servo", why, "Let the pair be free, and make its drive the target of the servo.")
        yield from _pair(reading, f"{path}.belt_tension", load.belt_tension, ("belt", "chain"), "belt or chain")
        yield from _pair(reading, f"{path}.gas", load.gas, _SLIDES, "sliding pair")
        for key in MACHINES:
            name = getattr(load, key)
            if name == reading.document.frame and name not in reading.document.joints:
                yield Fault(
                    f"{path}.{key}", f"'{name}' is the fixed link: it does not turn.", "Name a revolute joint or a moving link."
                )
            elif name is not None and name not in link_names(reading):
                yield from _pair(reading, f"{path}.{key}", name, ("revolute",), "revolute pair")
        yield from _driven(reading, f"{path}.drive", load.drive)
        for key in ("table", "polynomial"):
            factor = getattr(load, key)
            if factor is not None:
                yield from _driven(reading, f"{path}.{key}.drive", factor.drive)
                yield from _pair(reading, f"{path}.{key}.pair", factor.pair, (), "pair")
                if factor.point is not None:
                    yield from _point(reading, f"{path}.{key}.point", factor.point)


def _prescribed(reading: Reading, load: LoadDocument, path: str) -> Iterator[Fault]:
    """Forces and torques: link, point and the link that they act against."""
    if load.on is None:
        return
    yield from known_link(reading, f"{path}.on", load.on)
    if load.on == reading.document.frame:
        yield Fault(f"{path}.on", f"'{load.on}' is the fixed link: a load on it moves nothing.", "Name a moving link.")
    elif load.at is not None:
        yield from known_point(reading, f"{path}.at", load.on, load.at)
    elif load.kinds == ["force"]:
        points = point_names(reading, load.on) or []
        if len(points) > 1:
            why = "'at' is missing: where on the link does the force act?"
            yield Fault(path, why, f"Points of '{load.on}': {listing(points)}.")
    if load.against is not None:
        yield from known_link(reading, f"{path}.against", load.against)
        if load.against == load.on:
            yield Fault(f"{path}.against", f"'{load.on}' acts against itself.", "Name another link.")


def _point(reading: Reading, path: str, text: str, *, links: bool = False) -> Iterator[Fault]:
    """``"link.point"`` has to be there; ``links``: or the name of a link."""
    names = link_names(reading)
    if isinstance(text, Unknown) or split_point(reading, text) is not None or "*" in reading.broken["links"]:
        return
    link = max((k for k in names if text.startswith(f"{k}.")), key=len, default="")
    if link:
        yield from known_point(reading, path, link, text[len(link) + 1 :])
        return
    if any(point_names(reading, k) is None for k in names):
        return
    known = [f"{k}.{p}" for k in names for p in point_names(reading, k) or ()] + (names if links else [])
    if text in names:
        points = [f"'{text}.{p}'" for p in point_names(reading, text) or ()]
        yield Fault(path, f"'{text}' is a link; a point of it is wanted.", f"Write {' or '.join(points[:6])}.")
        return
    what = "link or point" if links else "point"
    yield Fault(
        path, f"there is no {what} '{text}'.", f"{did_you_mean(text, known, what='Points')} Points are written 'link.point'."
    )


def _pair(reading: Reading, path: str, pair: str | None, kinds: tuple[str, ...], what: str) -> Iterator[Fault]:
    """A pair that has to be there, of one of some kinds."""
    if pair is None or isinstance(pair, Unknown) or pair in reading.shapeless or "*" in reading.broken["joints"]:
        return
    pairs = reading.document.joints
    fitting = [name for name, p in pairs.items() if not kinds or p.kind in kinds]
    if pair not in pairs:
        yield Fault(path, f"there is no pair '{pair}'.", did_you_mean(pair, fitting, what="Pairs"))
    elif kinds and pairs[pair].kind not in kinds:
        remedy = f"Name a {what}: {listing(fitting)}." if fitting else f"The scene has no {what}."
        yield Fault(path, f"'{pair}' is {_words(pairs[pair].kind)}, no {what}.", remedy)
    elif pairs[pair].kind == "weld":
        yield Fault(path, f"'{pair}' is a weld, which does not move.", "Name another pair.")


def known_pair(reading: Reading, path: str, pair: str | None) -> Iterator[Fault]:
    """A fault where there is no such pair that moves."""
    yield from _pair(reading, path, pair, (), "pair")


def known_place(reading: Reading, path: str, text: str) -> Iterator[Fault]:
    """A fault where there is no such point, "link.point"."""
    yield from _point(reading, path, text)


def _words(kind: str) -> str:
    return KINDS[kind].words


def _driven(reading: Reading, path: str, drive: str | None) -> Iterator[Fault]:
    pairs = reading.document.joints
    driven = [name for name, pair in pairs.items() if pair.led]
    if drive is None or isinstance(drive, Unknown) or drive in {*driven, *reading.shapeless} or "*" in reading.broken["joints"]:
        return
    what = f"pair '{drive}' has no drive." if drive in pairs else f"there is no pair '{drive}'."
    yield Fault(path, what, did_you_mean(drive, driven, what="Driven pairs"))
