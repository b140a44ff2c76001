"""Faults of a scene, each with its remedy: every fault at once, in the order of the file.

Messages of the core are translated to the scene: its units, and paths of keys that its document has.
"""

from __future__ import annotations

import difflib
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import wraps
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

from mechcore.errors import Fault, MechanismError

if TYPE_CHECKING:
    from mechviz.scene.document import SceneDocument
    from mechviz.scene.scene import Scene

P = ParamSpec("P")
R = TypeVar("R")

_SECTIONS = {"dynamics": "run", "drives": "joints"}
"""Parts of a mechanism -> sections of a scene that have other names."""

_WIDTH = 118
MOST_REPORTED = 50  # faults of a scene that are listed; the others are counted
MOST_SOUGHT = 200  # faults of one sort; beyond this number the search stops
_MANY = 500  # names, above which a comparison with each of them takes too long


class SceneError(MechanismError):
    """A scene cannot be read as stated. It holds every fault found; ``source`` is the file or gallery name."""

    def __init__(self, source: str, faults: Sequence[Fault] | Fault):
        super().__init__(faults)
        self.source = source

    def __str__(self) -> str:
        n = len(self.faults)
        lines = [f"{self.source}: {n} problem{'s' if n > 1 else ''}"]
        shown = self.faults[:MOST_REPORTED]
        column = min(max(len(fault.path) for fault in shown), 32)
        for fault in shown:
            lines.extend(_lines(fault, column))
        if n > MOST_REPORTED:
            lines.append(f"  and {n - MOST_REPORTED} more: put these right first")
        return "\n".join(lines)


def _lines(fault: Fault, column: int) -> Iterator[str]:
    """The lines of a fault: the path, with message and remedy beside it; the remedy begins a new line where both do not fit on
    one."""
    room = _WIDTH - column - 4
    both = f"{fault.message} {fault.remedy}".rstrip()
    text = (
        [both]
        if len(both) <= room
        else [line for part in (fault.message, fault.remedy) if part for line in textwrap.wrap(part, room, break_on_hyphens=False)]
    )
    head = f"  {fault.path:<{column}}  "
    if len(fault.path) > column:  # a path of unusual length gets its own line instead of pushing everything to the right
        yield f"  {fault.path}"
        head = " " * (column + 4)
    for line in text:
        yield head + line
        head = " " * (column + 4)


def path_text(loc: Iterable[int | str]) -> str:
    """A place as it is written in faults: ``links.crank.points.B[0]``."""
    text = ""
    for part in loc:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def closest(word: str, known: Iterable[str]) -> str:
    """The known name that ``word`` was most likely meant to be, or an empty text."""
    return next(iter(nearest(word, known, 1)), "")


def nearest(word: str, known: Iterable[str], most: int) -> list[str]:
    """Up to ``most`` known names that resemble a word, the most similar first. Of very many names only those of similar length with
    the same beginning or end are compared."""
    folded = {name.casefold(): name for name in reversed(list(known))}
    text = word.casefold()
    if len(folded) > _MANY:
        folded = {key: name for key, name in folded.items() if abs(len(key) - len(text)) < 3 and _alike(key, text)}
    return [folded[key] for key in difflib.get_close_matches(text, folded, n=most, cutoff=0.6)]


def _alike(first: str, second: str) -> bool:
    return first[:3] == second[:3] or first[-3:] == second[-3:]


def listing(names: Iterable[str], *, most: int = 12) -> str:
    """Names as a readable list; of more than ``most`` the others are only counted."""
    shown = [f"'{name}'" for name in names]
    more = [f"and {len(shown) - most} more"] if len(shown) > most else []
    return ", ".join(shown[:most] + more)


def did_you_mean(word: str, known: Iterable[str], *, what: str = "Known") -> str:
    """A remedy for an unknown name: the nearest known one, or all of them."""
    names = list(known)
    near = closest(word, names)
    if near:
        return f"Did you mean '{near}'?"
    return f"{what}: {listing(names)}." if names else ""


def first_ones(faults: Iterable[Fault]) -> Iterator[Fault]:
    """The first `MOST_SOUGHT` faults of one sort. The search for each takes time in proportion to the size of the scene, so it
    stops there."""
    for k, fault in enumerate(faults):
        if k == MOST_SOUGHT:
            yield Fault("scene", f"there are more than {MOST_SOUGHT} faults of one sort.", "Put the others right first.")
            return
        yield fault


def in_file_order(faults: Iterable[Fault], document: Mapping[str, Any]) -> list[Fault]:
    """Faults without repetitions, in the order of their paths in the document; faults at other paths come last."""
    places: dict[str, int] = {}
    for path in _paths(document, ""):
        places.setdefault(path, len(places))

    def place(fault: Fault) -> int:
        path = fault.path
        while path:
            if path in places:
                return places[path]
            cut = max(path.rfind("."), path.rfind("["))
            path = path[:cut] if cut > 0 else ""
        return len(places)

    return sorted(dict.fromkeys(faults), key=place)


def _paths(value: object, path: str) -> Iterator[str]:
    if path:
        yield path
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _paths(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list):
        for k, inner in enumerate(value):
            yield from _paths(inner, f"{path}[{k}]")


@contextmanager
def under_other_names(names: Mapping[str, str]) -> Iterator[None]:
    """Context in which the names of inputs in faults are replaced, such as ``{"--by": "--tolerance"}``. Raises `MechanismError`."""
    try:
        yield
    except MechanismError as error:
        faults = [(f.path.partition(" "), f) for f in error.faults]
        renamed = [Fault(f"{names.get(name, name)}{gap}{rest}", f.message, f.remedy) for (name, gap, rest), f in faults]
        raise MechanismError(renamed) from error


@contextmanager
def worded(scene: Scene) -> Iterator[None]:
    """Context in which faults of the core are translated to the scene, see `fault_of_scene`. Raises `MechanismError`."""
    try:
        yield
    except MechanismError as error:
        if type(error) is not MechanismError:
            raise  # a subclass, such as SceneError, which is about the scene already
        raise MechanismError([fault_of_scene(scene, fault) for fault in error.faults]) from error


def in_scene_words(function: Callable[Concatenate[Scene, P], R]) -> Callable[Concatenate[Scene, P], R]:
    """Decorator of a function of a scene: faults of the core that it raises are translated as by `worded`."""

    @wraps(function)
    def called(scene: Scene, /, *args: P.args, **options: P.kwargs) -> R:
        with worded(scene):
            return function(scene, *args, **options)

    return called


def fault_of_scene(scene: Scene, fault: Fault) -> Fault:
    """A fault of the core in the scene's units, at a path that its document has."""
    shown = fault.in_units(scene.units)
    return Fault(path_as_written(scene.former_keys, document_path(scene.document, fault.path)), shown.message, shown.remedy)


def path_as_written(former: Mapping[str, str], path: str) -> str:
    """A path of the document with the names of keys in the scene's text; ``former``: places with present names -> with former
    ones."""
    for place, written in former.items():
        if path == place or path.startswith((f"{place}.", f"{place}[")):
            return written + path[len(place) :]
    return path


def document_path(document: SceneDocument, path: str) -> str:
    """The longest leading part of a path of the core that exists in the document; the whole path where it is about something else.

    The core has parts that a joint generates (``H.base`` of the cylinder ``H``) and lists drives apart from their joints.
    """
    first, _, rest = path.partition(".")
    section = _SECTIONS.get(first, first)
    if section.partition("[")[0] not in type(document).model_fields:
        return path
    place_path, place = section, getattr(document, section, None)
    if section == "links" and rest and _split(place, rest)[0] is None:  # a link that a joint generates
        place_path, place = "joints", document.joints
    if place_path == "joints":
        rest = _in_scene(document, rest)
    while rest:
        key, after = _split(place, rest)
        if key is None:
            return place_path
        place_path, rest = f"{place_path}.{key}", after
        place = place[key] if isinstance(place, Mapping) else getattr(place, key, None)
    return place_path


def _in_scene(document: SceneDocument, path: str) -> str:
    """A path inside the joints, with the keys of the core's joint replaced by those of the scene's."""
    name, inner = _split(document.joints, path)
    joint = document.joints.get(name or "")
    if joint is None or joint.traits.core_path is None or not inner:
        return path
    return f"{name}.{joint.traits.core_path(joint, inner)}"


def _split(place: object, path: str) -> tuple[str | None, str]:
    """The key of ``place`` with which a path begins, and the rest of the path; None where there is no such key. Names may contain
    dots, so the longest key that fits is taken."""
    keys = place if isinstance(place, Mapping) else getattr(type(place), "model_fields", ())
    fitting = [key for key in keys if path == key or path.startswith((f"{key}.", f"{key}["))]
    if not fitting:
        return None, ""
    key = max(fitting, key=len)
    return key, path[len(key) :].lstrip(".")
