"""The names of a scene's links, points and joints, and the faults of texts that name none of them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from typing import TYPE_CHECKING

from mechcore.errors import Fault
from mechviz.scene.faults import did_you_mean, listing
from mechviz.scene.fields import Unknown

if TYPE_CHECKING:
    from mechviz.scene.kinds.joints.document import PairDocument
    from mechviz.scene.recovery import Reading


def link_names(reading: Reading) -> list[str]:
    """Names of all links, also of those that are faulty."""
    raw = reading.raw.get("links")
    return [str(name) for name in raw] if isinstance(raw, dict) else []


def point_names(reading: Reading, link: str) -> list[str] | None:
    """Names of the points of a link, None where they could not be read (or there is no such link)."""
    found = reading.document.links.get(link)
    return list(found.points) if found is not None and found.sound("points") else None


def points_of_pair(name: str, pair: PairDocument) -> tuple[str, str]:
    """The joined points of the first and of the second link."""
    if pair.at is None:
        return name, name
    return (pair.at, pair.at) if isinstance(pair.at, str) else (pair.at[0], pair.at[1])


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


def split_point(reading: Reading, text: str) -> tuple[str, str] | None:
    """``"link.point"`` -> link and point, None where the scene has none such."""
    for link in link_names(reading):
        for point in point_names(reading, link) or ():
            if text == f"{link}.{point}":
                return link, point
    return None


def known_place(reading: Reading, path: str, text: str, *, links: bool = False) -> Iterator[Fault]:
    """A fault where there is no such point, "link.point"; ``links``: nor a link of this name."""
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


def known_pair(
    reading: Reading,
    path: str,
    pair: str | None,
    kinds: Collection[str] = (),
    what: str = "pair",
    fits: Callable[[PairDocument], bool] | None = None,
) -> Iterator[Fault]:
    """A fault where there is no such pair that moves, of one of some kinds, or that ``fits``; such pairs are called ``what``."""
    if pair is None or isinstance(pair, Unknown) or pair in reading.shapeless or "*" in reading.broken["joints"]:
        return
    pairs = reading.document.joints
    fits = fits or (lambda p: not kinds or p.kind in kinds)
    fitting = [name for name, p in pairs.items() if fits(p)]
    if pair not in pairs:
        yield Fault(path, f"there is no pair '{pair}'.", did_you_mean(pair, fitting, what="Pairs"))
    elif pair not in fitting:
        remedy = f"Name a {what}: {listing(fitting)}." if fitting else f"The scene has no {what}."
        yield Fault(path, f"'{pair}' is {pairs[pair].traits.words}, no {what}.", remedy)
    elif pairs[pair].kind == "weld":
        yield Fault(path, f"'{pair}' is a weld, which does not move.", "Name another pair.")


def known_drive(reading: Reading, path: str, drive: str | None) -> Iterator[Fault]:
    """A fault where there is no such pair with a drive, or a free one."""
    pairs = reading.document.joints
    driven = [name for name, pair in pairs.items() if pair.led]
    if drive is None or isinstance(drive, Unknown) or drive in {*driven, *reading.shapeless} or "*" in reading.broken["joints"]:
        return
    what = f"pair '{drive}' has no drive." if drive in pairs else f"there is no pair '{drive}'."
    yield Fault(path, what, did_you_mean(drive, driven, what="Driven pairs"))
