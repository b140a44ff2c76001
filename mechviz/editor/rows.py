"""Numbers of a scene that are too many for sliders, and are edited as texts: long lists, and long series of marked points."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from mechcore.records import dataclass
from mechviz.editor.parameters import HIDDEN, LONGEST_LIST, group_of, is_number, label_of, marked_series, place_key
from mechviz.scene.annotations import Place, leaf_at
from mechviz.scene.document import value_at
from mechviz.scene.fields import DocumentTable, QuantityMark
from mechviz.scene.scene import Scene
from mechviz.scene.units import split, symbol_of

LONGEST_ROW = 100  # numbers in a text


@dataclass(frozen=True)
class NumberRow:
    """Numbers of a scene that are edited as one text: those of a long list, or a series of points.

    ``places``, ``values``: of each number, by points where these have several; ``suffix``: the unit where all have the same one in
    the file, else "".
    """

    key: str
    group: str
    title: str
    places: tuple[tuple[Place, ...], ...]
    values: tuple[tuple[float | str, ...], ...]
    suffix: str = ""

    @property
    def text(self) -> str:
        return (", " if len(self.places[0]) == 1 else "; ").join(", ".join(map(self._shown, row)) for row in self.values)

    def changes(self, text: str) -> dict[Place, float | str]:
        """The changes of a scene for another text; values that are written as before stay. Raises `ValueError` where it has not
        as many numbers."""
        tokens = [token.strip() for token in re.split(r"[,;\n]", text)]
        flat = [(place, value) for row in zip(self.places, self.values, strict=True) for place, value in zip(*row, strict=True)]
        if len(tokens) != len(flat) or "" in tokens:
            raise ValueError(f"{self.title}: {len(flat)} numbers are wanted, with commas between them.")
        return {p: self._written(token) for (p, v), token in zip(flat, tokens, strict=True) if token != self._shown(v)}

    def _shown(self, value: float | str) -> str:
        number = float(split(value)[0]) if isinstance(value, str) and self.suffix else value
        return number if isinstance(number, str) else f"{number:.6g}"

    def _written(self, token: str) -> float | str:
        try:
            number = float(token)
        except ValueError:  # it has a unit of its own
            return token
        return f"{number!r} {self.suffix}" if self.suffix else number


def find_rows(scene: Scene) -> tuple[NumberRow, ...]:
    """The numbers that are edited as texts: of long lists, and of long series of marked points."""
    document, rows = scene.document, []
    for first, key, label, homes in [*_long_lists(document), *marked_series(document)]:
        places = [
            [(*home, k) for k in range(len(v))] if isinstance(v := value_at(document, home), list | tuple) else [home]
            for home in homes
        ]
        flat = [place for row in places for place in row]
        numbers = all(is_number(leaf.value) or leaf.mark(QuantityMark) for leaf in (leaf_at(document, place) for place in flat))
        if len(flat) <= LONGEST_ROW and numbers and document.formulas.keys().isdisjoint([*homes, *flat]):
            kind = scene.kinds.get(place_key(flat[0]), "")
            title = f"{label} [{scene.units.symbol(kind)}]" if kind else label
            values = tuple(tuple(value_at(document, place) for place in row) for row in places)
            units = {split(v)[1] if isinstance(v, str) else "" for row in values for v in row}
            suffix = units.pop() if len(units) == 1 else ""
            title = f"{label} [{symbol_of(suffix)}]" if suffix else title
            rows.append(NumberRow(key, group_of(first), title, tuple(map(tuple, places)), values, suffix))
    return tuple(rows)


def _long_lists(value: Any, path: Place = ()) -> Iterator[tuple[Place, str, str, list[Place]]]:
    """Where a list with more than `LONGEST_LIST` entries stands, its key, its label, and the places of its entries."""
    if isinstance(value, list | tuple) and value and not isinstance(value[0], DocumentTable):
        if len(value) > LONGEST_LIST:
            yield path, place_key(path), label_of(path), [(*path, k) for k in range(len(value))]
        return
    hidden = {*HIDDEN, "outline"} if path[:1] == ("links",) else HIDDEN  # pictures, which are not drawn by numbers
    keys = (
        (k for k in type(value).model_fields if k in value.model_fields_set - hidden) if isinstance(value, DocumentTable) else value
    )
    items = (
        ((k, getattr(value, k)) for k in keys)
        if isinstance(value, DocumentTable)
        else value.items()
        if isinstance(value, Mapping)
        else ()
    )
    for key, inner in enumerate(value) if isinstance(value, list | tuple) else items:
        yield from _long_lists(inner, (*path, key))
