"""Do the loads of a scene name what exists?"""

from __future__ import annotations

from collections.abc import Iterator

from mechcore.errors import Fault

from .document import LoadDocument
from .faults import did_you_mean, listing
from .load_documents import MACHINES
from .references import known_link, known_point, link_names, point_names
from .tables import Unknown
from .validate import Reading

__all__ = ["check_loads", "known_pair", "known_place", "split_point"]

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
        servo = reading.document.pairs.get(load.servo or "")
        if servo is not None and servo.drive is not None:
            why = f"the drive of '{load.servo}' decides its motion, whatever a servo does."
            yield Fault(f"{path}.servo", why, "Let the pair be free, and make its drive the target of the servo.")
        yield from _pair(reading, f"{path}.belt_tension", load.belt_tension, ("belt", "chain"), "belt or chain")
        yield from _pair(reading, f"{path}.gas", load.gas, _SLIDES, "sliding pair")
        for key in MACHINES:
            name = getattr(load, key)
            if name == reading.document.frame and name not in reading.document.pairs:
                yield Fault(
                    f"{path}.{key}", f"'{name}' is the fixed link: it does not turn.", "Name a revolute pair or a moving link."
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
    if pair is None or isinstance(pair, Unknown) or pair in reading.shapeless or "*" in reading.broken["pairs"]:
        return
    pairs = reading.document.pairs
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
    from .pairs import KINDS

    return KINDS[kind].words


def _driven(reading: Reading, path: str, drive: str | None) -> Iterator[Fault]:
    pairs = reading.document.pairs
    driven = [name for name, pair in pairs.items() if pair.led]
    if drive is None or isinstance(drive, Unknown) or drive in {*driven, *reading.shapeless} or "*" in reading.broken["pairs"]:
        return
    what = f"pair '{drive}' has no drive." if drive in pairs else f"there is no pair '{drive}'."
    yield Fault(path, what, did_you_mean(drive, driven, what="Driven pairs"))
