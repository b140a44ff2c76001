"""What is wrong with a scene, said so that it can be put right: every fault at once, in the order of the file."""

from __future__ import annotations

import difflib
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from mechcore.errors import Fault, MechanismError

_WIDTH = 118
_MANY = 500  # names, beyond which a close look at each of them takes too long


class SceneError(MechanismError):
    """A scene that cannot be read as stated, with every fault found; ``source`` is the file or gallery name."""

    def __init__(self, source: str, faults: Sequence[Fault] | Fault):
        super().__init__(faults)
        self.source = source

    def __str__(self) -> str:
        n = len(self.faults)
        lines = [f"{self.source}: {n} problem{'s' if n > 1 else ''}"]
        column = min(max(len(fault.path) for fault in self.faults), 32)
        for fault in self.faults:
            lines.extend(_lines(fault, column))
        return "\n".join(lines)


def _lines(fault: Fault, column: int) -> Iterator[str]:
    """The path, then message and remedy beside it; the remedy on a line of its own where both do not fit on one."""
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
    """The known names that a word resembles, the most similar first. Of very many names only those that begin or end like it."""
    folded = {name.casefold(): name for name in reversed(list(known))}
    text = word.casefold()
    if len(folded) > _MANY:
        folded = {key: name for key, name in folded.items() if abs(len(key) - len(text)) < 3 and _alike(key, text)}
    return [folded[key] for key in difflib.get_close_matches(text, folded, n=most, cutoff=0.6)]


def _alike(first: str, second: str) -> bool:
    return first[:3] == second[:3] or first[-3:] == second[-3:]


def listing(names: Iterable[str], *, most: int = 12) -> str:
    """Names as a readable list, cut where it would be longer than anybody reads."""
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


def in_file_order(faults: Iterable[Fault], document: Mapping[str, Any]) -> list[Fault]:
    """Faults without repetitions, sorted by where their paths stand in the document; those that stand nowhere last."""
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


def _paths(value: Any, path: str) -> Iterator[str]:
    if path:
        yield path
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _paths(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list):
        for k, inner in enumerate(value):
            yield from _paths(inner, f"{path}[{k}]")
