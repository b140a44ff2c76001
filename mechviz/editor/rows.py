"""Numbers of a scene that are too many for sliders, and are edited as texts: long lists, tables of several lists, and long
series of marked points."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from mechcore.records import dataclass
from mechviz.editor.parameters import HIDDEN, LONGEST_LIST, group_of, is_number, label_of, marked_series, place_key
from mechviz.scene.annotations import Place, leaf_at
from mechviz.scene.document import SceneDocument, value_at
from mechviz.scene.fields import DocumentTable, QuantityMark
from mechviz.scene.kinds.cam_files import separator_of
from mechviz.scene.scene import Scene
from mechviz.scene.units import split, symbol_of

LONGEST_ROW = 3000  # numbers in a text: more would not fit into a message of the page


@dataclass(frozen=True)
class NumberRow:
    """Numbers of a scene that are edited as one text: those of a long list, a table, or a series of points.

    ``places``, ``values``: of each number, grouped by points or rows where these have several; ``suffixes``: for each column of a
    row, the unit in the file where all its numbers have the same one, else "". Of a table, whose text may have another number of
    rows: ``lists``, the places of its columns, and the ``symbols`` of their units.
    """

    key: str
    group: str
    title: str
    places: tuple[tuple[Place, ...], ...]
    values: tuple[tuple[float | str, ...], ...]
    suffixes: tuple[str, ...]
    lists: tuple[Place, ...] = ()
    symbols: tuple[str, ...] = ()

    @property
    def kind(self) -> tuple[object, ...]:
        """What is equal in two rows that the same control can show."""
        return (self.title, self.lists or self.places)

    @property
    def hint(self) -> str:
        """The format of its text, in words."""
        return "a row a line, as copied from a spreadsheet or a CSV file, of any number" if self.lists else "with commas between"

    @property
    def text(self) -> str:
        between = "\n" if self.lists else ", " if len(self.places[0]) == 1 else "; "
        return between.join(", ".join(map(self._shown, row, self.suffixes)) for row in self.values)

    def changes(self, text: str) -> dict[Place, Any]:
        """The changes of a scene for another text; values whose text is unchanged stay. Raises `ValueError` where the number of
        values, or of values in a row, is wrong."""
        suffixes = self.suffixes
        if self.lists:
            rows, suffixes = self._rows_of(text)
            if len(rows) != len(self.values):
                return {home: [self._written(row[k], suffixes[k]) for row in rows] for k, home in enumerate(self.lists)}
        else:
            tokens, wide = [token.strip() for token in re.split(r"[,;\n]", text)], len(self.suffixes)
            if len(tokens) != wide * len(self.values) or "" in tokens:
                raise ValueError(f"{self.title}: {wide * len(self.values)} numbers are wanted, with commas between them.")
            rows = [tokens[k : k + wide] for k in range(0, len(tokens), wide)]
        return {
            place: self._written(token, suffix)
            for places, values, row in zip(self.places, self.values, rows, strict=True)
            for place, value, token, suffix, own in zip(places, values, row, suffixes, self.suffixes, strict=True)
            if suffix != own or token != self._shown(value, own)
        }

    def _rows_of(self, text: str) -> tuple[list[list[str]], tuple[str, ...]]:
        """The cells of a table in text form, and the units of its columns, which a header may state in brackets."""
        lines = [line.strip() for line in text.splitlines() if line.strip()]
        between = separator_of(lines)
        rows = [[cell.strip() for cell in line.split(between)] for line in lines]
        if between != ",":  # then commas are decimal ones
            rows = [[cell.replace(",", ".") for cell in row] for row in rows]
        suffixes = self.suffixes
        if rows and not any(cell[:1].isdigit() or cell[:1] in ("-", "+", ".") for cell in rows[0]):
            units = [found[1].strip() if (found := re.search(r"\[([^\]]*)\]", cell)) else "" for cell in rows.pop(0)]
            suffixes = tuple(
                unit if unit and symbol_of(unit) != symbol else own
                for unit, own, symbol in zip([*units, *[""] * len(suffixes)], suffixes, self.symbols, strict=False)
            )
        wide = len(self.lists)
        for number, row in enumerate(rows, 1):
            if len(row) != wide or "" in row:
                raise ValueError(f"{self.title}: row {number} is '{between.join(row)[:40]}'; {wide} numbers are wanted.")
        if not rows or wide * len(rows) > LONGEST_ROW:
            raise ValueError(f"{self.title}: {len(rows)} rows; from 1 to {LONGEST_ROW // wide} can be edited here.")
        return rows, suffixes

    @staticmethod
    def _shown(value: float | str, suffix: str) -> str:
        number = float(split(value)[0]) if isinstance(value, str) and suffix else value
        return number if isinstance(number, str) else f"{number:.6g}"

    @staticmethod
    def _written(token: str, suffix: str) -> float | str:
        try:
            number = float(token)
        except ValueError:  # it has a unit of its own
            return token
        return f"{number!r} {suffix}" if suffix else number


def find_rows(scene: Scene) -> tuple[NumberRow, ...]:
    """The numbers that are edited as texts: of long lists and tables, and of long series of marked points."""
    document, rows, columns = scene.document, [], set()
    for parent, lists in _tables(document):
        places = [tuple((*home, k) for home in lists) for k in range(len(value_at(document, lists[0])))]
        row = _row(scene, (parent, label_of(parent)), lists, places)
        if row is not None:
            columns |= set(lists)
            rows.append(row)
    for first, key, label, homes in [*_long_lists(document), *marked_series(document)]:
        if first in columns:
            continue
        places = [
            tuple((*home, k) for k in range(len(v))) if isinstance(v := value_at(document, home), list | tuple) else (home,)
            for home in homes
        ]
        row = _row(scene, (first, label), (), places, key, homes)
        if row is not None:
            rows.append(row)
    return tuple(rows)


def _row(
    scene: Scene,
    named: tuple[Place, str],
    lists: tuple[Place, ...],
    places: list[tuple[Place, ...]],
    key: str = "",
    homes: list[Place] | None = None,
) -> NumberRow | None:
    """The row of the numbers at places; None where they are no numbers, too many, or computed from parameters."""
    document, (first, label) = scene.document, named
    wide = len(places[0])
    if wide * len(places) > LONGEST_ROW or any(len(row) != wide for row in places):
        return None
    values = tuple(tuple(value_at(document, place) for place in row) for row in places)
    leaves = [leaf_at(document, place) for place in places[0]]  # all rows are of one type
    if not all(is_number(leaf.value) or leaf.mark(QuantityMark) for leaf in leaves) or not all(
        is_number(v) or isinstance(v, str) for row in values for v in row
    ):
        return None
    if document.formulas and not document.formulas.keys().isdisjoint([*(homes or ()), *lists, *(p for row in places for p in row)]):
        return None
    suffixes, symbols = [], []
    for k in range(wide):
        units = {split(row[k])[1] if isinstance(row[k], str) else "" for row in values}
        suffixes.append(units.pop() if len(units) == 1 else "")
        kind = scene.kinds.get(place_key(places[0][k]), "")
        symbols.append(symbol_of(suffixes[k]) if suffixes[k] else scene.units.symbol(kind) if kind else "")
    if lists:
        heads = (f"{home[-1]} [{symbol}]" if symbol else str(home[-1]) for home, symbol in zip(lists, symbols, strict=True))
        title = f"{label}: {', '.join(heads).replace('_', ' ')}"
        return NumberRow(place_key(first), group_of(first), title, tuple(places), values, tuple(suffixes), lists, tuple(symbols))
    suffixes = suffixes if len(set(suffixes)) == 1 else [""] * wide
    title = f"{label} [{symbols[0]}]" if symbols[0] else label
    return NumberRow(key, group_of(first), title, tuple(places), values, tuple(suffixes))


def _tables(document: SceneDocument) -> Iterator[tuple[Place, tuple[Place, ...]]]:
    """Tables of a scene: the place of each table in which several lists have the same number of entries, more than `LONGEST_LIST`,
    and the places of these lists."""
    siblings: dict[Place, dict[int, list[Place]]] = {}
    for path, _, _, homes in _long_lists(document):
        if isinstance(path[-1], str) and not isinstance(value_at(document, path)[0], list | tuple):
            siblings.setdefault(path[:-1], {}).setdefault(len(homes), []).append(path)
    for parent, by_length in siblings.items():
        yield from ((parent, tuple(lists)) for lists in by_length.values() if len(lists) > 1)


def _long_lists(value: Any, path: Place = ()) -> Iterator[tuple[Place, str, str, list[Place]]]:
    """Each list with more than `LONGEST_LIST` entries: its place, its key, its label, and the places of its entries."""
    if isinstance(value, list | tuple) and value and not isinstance(value[0], DocumentTable):
        if len(value) > LONGEST_LIST:
            yield path, place_key(path), label_of(path), [(*path, k) for k in range(len(value))]
        return
    hidden = {*HIDDEN, "outline"} if path[:1] == ("links",) else HIDDEN  # drawn outlines, which are not edited by numbers
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
