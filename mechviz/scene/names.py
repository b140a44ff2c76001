"""References by name to other parts of a scene: the types of such texts, and the faults of names that do not exist."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, get_args

from pydantic import Field

from mechcore.errors import Fault
from mechcore.records import dataclass
from mechviz.scene.annotations import Leaf, hints_of, leaves, stated_keys, stated_value
from mechviz.scene.faults import did_you_mean, listing, path_text
from mechviz.scene.fields import DocumentTable, Text, UnknownName

if TYPE_CHECKING:
    from mechviz.scene.kinds.joints.document import JointDocument
    from mechviz.scene.reading.recovery import Reading

T = TypeVar("T")


@dataclass(frozen=True)
class Reference:
    """Marks a text as the name of a link, of a point ("link.point"), or of a joint that moves. The joint is of one of the
    ``kinds``, or one that ``fits``; ``what`` is the term for such joints in messages."""

    to: Literal["link", "point", "joint"]
    kinds: tuple[str, ...] = ()
    what: str = "joint"
    fits: Callable[[JointDocument], bool] | None = None


@dataclass(frozen=True)
class FromFolder:
    """Marks a text as the path of a file, from the folder of the scene."""


FileName = Annotated[Text, FromFolder()]
LinkName = Annotated[Text, Reference("link")]
PointName = Annotated[Text, Reference("point")]
TwoLinks = Annotated[list[LinkName], Field(min_length=2, max_length=2)]
TwoPoints = Annotated[list[PointName], Field(min_length=2, max_length=2)]


def references(document: DocumentTable) -> Iterator[tuple[Leaf, Reference]]:
    """The values in a document that refer to other parts of it, each with its mark."""
    return _marked(document, Reference)


def files_named(document: DocumentTable) -> list[str]:
    """The paths of files in a document, each once."""
    return list(dict.fromkeys(str(leaf.value) for leaf, _ in _marked(document, FromFolder)))


def _marked(document: DocumentTable, mark_type: type[T]) -> Iterator[tuple[Leaf, T]]:
    """The values in a document that have a mark of a type, and that mark."""
    kind: Any = mark_type
    for leaf in leaves(document, keys=lambda table: stated_keys(table, _marking(type(table), kind))):
        mark = leaf.mark(mark_type)
        if mark is not None:
            yield leaf, mark


@cache
def _marking(cls: type[DocumentTable], mark_type: Any) -> tuple[str, ...]:
    """The keys of a table that hold texts with a mark of a type, or tables; tables are searched only where they are present."""
    return tuple(key for key, hint in hints_of(cls).items() if _marks(hint, mark_type))


def _marks(annotation: object, mark_type: type) -> bool:
    if isinstance(annotation, type) and issubclass(annotation, DocumentTable):
        return True
    return isinstance(annotation, mark_type) or any(_marks(inner, mark_type) for inner in get_args(annotation))


def check_names(reading: Reading) -> Iterator[Fault]:
    """The faults of all names that refer to a link, a point or a joint that does not exist."""
    for leaf, reference in references(reading.document):
        *inside, last = leaf.path
        written = stated_value(reading.raw, inside) if isinstance(leaf.value, UnknownName) and last == 0 else None
        entries = enumerate(written) if isinstance(written, list) else [(last, leaf.value)]  # all that are written
        for k, name in entries:
            if isinstance(name, str):
                yield from _known(reading, path_text((*inside, k)), name, reference)


def _known(reading: Reading, path: str, name: str, reference: Reference) -> Iterator[Fault]:
    if reference.to == "link":
        return known_link(reading, path, name)
    if reference.to == "point":
        return known_place(reading, path, name)
    return known_joint(reading, path, name, reference.kinds, reference.what, reference.fits)


def link_names(reading: Reading) -> Collection[str]:
    """Names of all links, also of those that are faulty."""
    return reading.link_names


def point_names(reading: Reading, link: str) -> list[str] | None:
    """Names of the points of a link, None where they could not be read (or there is no such link)."""
    document = reading.document.links.get(link)
    return list(document.points) if document is not None and document.has_valid("points") else None


def points_of_joint(name: str, joint: JointDocument) -> tuple[str, str]:
    """The joined points of the first and of the second link."""
    if joint.at is None:
        return name, name
    return (joint.at, joint.at) if isinstance(joint.at, str) else (joint.at[0], joint.at[1])


def known_link(reading: Reading, path: str, link: str) -> Iterator[Fault]:
    """A fault where there is no such link."""
    if link in reading.document.links:
        return
    links = link_names(reading)
    if "*" not in reading.unreadable["links"] and link not in links and not isinstance(link, UnknownName):
        yield Fault(path, f"there is no link '{link}'.", did_you_mean(link, links, what="Links"))


def known_point(reading: Reading, path: str, link: str, point: str, remedy: str = "") -> Iterator[Fault]:
    """A fault where the link has no such point."""
    points = point_names(reading, link)
    if points is not None and point not in points and not isinstance(point, UnknownName):
        hint = did_you_mean(point, points, what=f"Points of '{link}'")
        yield Fault(path, f"link '{link}' has no point '{point}'.", f"{hint} {remedy}".strip())


def split_point(reading: Reading, text: str) -> tuple[str, str] | None:
    """``"link.point"`` -> link and point; None where the scene has no such point."""
    return reading.places.get(text)


def known_place(reading: Reading, path: str, text: str, *, links: bool = False) -> Iterator[Fault]:
    """A fault where there is no such point, "link.point"; ``links``: the message offers links, too."""
    names = link_names(reading)
    if isinstance(text, UnknownName) or split_point(reading, text) is not None or "*" in reading.unreadable["links"]:
        return
    link = max((k for k in names if text.startswith(f"{k}.")), key=len, default="")
    if link:
        yield from known_point(reading, path, link, text[len(link) + 1 :])
        return
    if any(point_names(reading, k) is None for k in names):
        return
    known = [f"{k}.{p}" for k in names for p in point_names(reading, k) or ()] + (list(names) if links else [])
    if text in names:
        points = [f"'{text}.{p}'" for p in point_names(reading, text) or ()]
        yield Fault(path, f"'{text}' is a link; a point of it is wanted.", f"Write {' or '.join(points[:6])}.")
        return
    what = "link or point" if links else "point"
    yield Fault(
        path, f"there is no {what} '{text}'.", f"{did_you_mean(text, known, what='Points')} Points are written 'link.point'."
    )


def known_joint(
    reading: Reading,
    path: str,
    joint: str | None,
    kinds: Collection[str] = (),
    what: str = "joint",
    fits: Callable[[JointDocument], bool] | None = None,
) -> Iterator[Fault]:
    """A fault where there is no such joint that moves, or it is not one of the ``kinds`` or one that ``fits``; ``what`` is the term
    for the joints that are."""
    if joint is None or isinstance(joint, UnknownName) or joint in reading.kindless_joints or "*" in reading.unreadable["joints"]:
        return
    joints = reading.document.joints
    fits = fits or (lambda p: not kinds or p.kind in kinds)
    fitting = [name for name, p in joints.items() if fits(p)]
    if joint not in joints:
        yield Fault(path, f"there is no joint '{joint}'.", did_you_mean(joint, fitting, what="Joints"))
    elif joint not in fitting:
        remedy = f"Name a {what}: {listing(fitting)}." if fitting else f"The scene has no {what}."
        yield Fault(path, f"'{joint}' is {joints[joint].traits.words}, no {what}.", remedy)
    elif joints[joint].kind == "weld":
        yield Fault(path, f"'{joint}' is a weld, which does not move.", "Name another joint.")


def known_drive(reading: Reading, path: str, drive: str | None) -> Iterator[Fault]:
    """A fault where no joint of this name has a drive or is free."""
    joints = reading.document.joints
    driven = [name for name, joint in joints.items() if joint.driven]
    if (
        drive is None
        or isinstance(drive, UnknownName)
        or drive in {*driven, *reading.kindless_joints}
        or "*" in reading.unreadable["joints"]
    ):
        return
    what = f"joint '{drive}' has no drive." if drive in joints else f"there is no joint '{drive}'."
    yield Fault(path, what, did_you_mean(drive, driven, what="Driven joints"))
