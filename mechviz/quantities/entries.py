"""Rules of the catalogue: names and display units of the quantities in the columns of a table.

They depend on names alone, not on values, so that the entries of a scene do not change with its values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

from mechcore.arrays import Real
from mechcore.records import dataclass
from mechviz.quantities.items import ColumnUnits, Path
from mechviz.scene.units import Units

MOTION = {
    "slide": "displacement",
    "slide_rate": "velocity",
    "slide_acceleration": "acceleration",
    "angle_rate": "angular velocity",
    "angle_acceleration": "angular acceleration",
}
WORDS = {
    ("pose", "m"): "position",
    ("pose", "rad"): "angle",
    ("velocity", "rad/s"): "angular velocity",
    ("acceleration", "rad/s^2"): "angular acceleration",
    ("inertia", "N"): "inertia force",
    ("inertia", "N m"): "inertia moment",
    ("reaction", "N m"): "couple",
    ("friction", "N m"): "friction moment",
    ("friction_loss", "W"): "friction loss",
    ("contact", "N"): "contact force",
    ("stress", "Pa"): "Hertz pressure",
    ("stress", "m"): "half width of the contact",
}
BY_UNIT = {"N": "force", "N m": "moment", "m": "position"}
LENGTHS = {("Fx", "Fy"): "|F|", ("vx", "vy"): "|v|", ("ax", "ay"): "|a|"}
"""Components of a vector whose magnitude is an additional curve."""

APART = ("motion", "contact", "lift", "drive", "stress", "bearing", "sections")
"""Tables in which every column is a separate quantity."""

ITEM_KINDS = {"joints": "joint", "links": "link", "points": "point", "cams": "cam", "loads": "load", "servos": "servo"}
ORDER = ("drive", "joints", "links", "points", "sections", "cams", "loads", "servos", "energy", "power")
TABLES = (
    "motion",
    "pose",
    "position",
    "velocity",
    "acceleration",
    "reaction",
    "friction",
    "bearing",
    "contact",
    "normal",
    "lift",
    "stress",
)
"""Tables of an item, in the order of display."""


class EntryFacts(NamedTuple):
    """Facts that the entries depend on in addition to paths and columns. ``pins``: joints whose couple is due to friction alone;
    ``rubbing``: joints with friction; ``forces``: whether reactions were computed; ``units``: those of the display."""

    frame: str
    drives: tuple[str, ...]
    joints: tuple[str, ...]
    links: tuple[str, ...]
    points: tuple[str, ...]
    loads: tuple[str, ...]
    pins: frozenset[str]
    rubbing: frozenset[str]
    forces: bool
    units: Units


@dataclass(frozen=True)
class Entry:
    """A quantity without its values. ``read`` computes them, (F, n) in ``unit``, from the values of the table at ``path``.
    ``sparse``: possibly there is no finite value at any frame."""

    key: str
    item: str
    name: str
    unit: str
    curves: tuple[str, ...]
    path: Path
    read: Callable[[Real], Real]
    sparse: bool = False


@lru_cache(maxsize=16)
def entries(tables: tuple[tuple[Path, ColumnUnits], ...], names: EntryFacts) -> tuple[Entry, ...]:
    """All entries of some tables, in the order of display."""
    placed = sorted(tables, key=lambda table: _place(table[0], names))
    return tuple(entry for path, columns in placed for entry in _of_table(path, columns, names))


def _place(path: Path, n: EntryFacts) -> tuple[int, int, int, Path]:
    """Sort key of a table: by kind, then in the order of the scene; health comes last."""
    if path[0] == "health":
        return len(ORDER) + 1, 0, 0, path
    kind = ORDER.index(path[1]) if path[1] in ORDER else len(ORDER)
    known = {"drive": n.drives, "joints": n.joints, "links": n.links, "points": n.points, "loads": n.loads}.get(path[1], ())
    item = "/".join(path[2:]) if path[1] == "loads" else path[2] if len(path) > 2 else ""
    rank = TABLES.index(path[-1]) if path[-1] in TABLES else len(TABLES)
    return kind, known.index(item) if item in known else len(known), rank, path


def _of_table(path: Path, columns: ColumnUnits, n: EntryFacts) -> Iterator[Entry]:
    if path[0] == "health":
        curves = tuple(column.replace("_", " ") for column, _ in columns)
        unit, factor = n.units.display_unit(columns[0][1], small=True)
        read = partial(_scaled, columns=list(range(len(columns))), factor=factor)
        yield Entry(f"health.{path[1]}", "health", " ".join(path[1:]).replace("_", " "), unit, curves, path, read)
        return
    if path[0] != "data" or path[1:3] == ("links", n.frame):
        return
    made = partial(_grouped, n.units, path, columns)
    match path[1:]:
        case ("drive", name) if n.forces:
            yield from made(("drive", name), f"drive {name}", "drive", (3, 4))
        case ("joints", _, "position") | ("drive", *_) | ("links", _, "properties"):
            return
        case ("joints", name, "reaction") if name in n.pins and name not in n.rubbing:
            yield from made(("joint", name), f"joint {name}", "reaction", (0, 1))
        case ("joints", name, "friction") if name in n.pins:
            yield from made(("joint", name), f"joint {name}", "friction", (2,))
        case ("cams", name, "contact"):
            yield from made(("cam", name), f"cam {name}", "contact", (3, 2) if n.forces else (3,))
            unit, factor = n.units.display_unit("1/m")
            read = partial(_curvature, factor=factor)
            yield Entry(f"cam.{name}.curvature", f"cam {name}", "curvature", unit, ("curvature",), path, read)
            yield from made(("cam", name), f"cam {name}", "contact", (5,), sparse=True)
        case ("cams", name, "graphical"):
            yield from _drawn_laws(n.units, name, path, columns)
        case ("loads", *names):
            known = (0, 1, 3, 4) if names[0] == "gravity" and len(names) > 1 else (0, 1, 2, 3, 4)
            yield from made(("load", *names), f"load {' '.join(names)}", "load", known)
        case ("sections", name):
            yield from made(("link", name), f"link {name}", "sections")
        case (kind, name, what) if kind in ITEM_KINDS:
            yield from made((ITEM_KINDS[kind], name), f"{ITEM_KINDS[kind]} {name}", what)
        case ("answers", name, item):
            for one in ((0, 1),) if name == "instant_centre" else ((k,) for k in range(len(columns))):
                yield from made((name, item), f"{name.replace('_', ' ')} {item}", "answer", one)
        case rest:
            item = " ".join(rest).replace("_", " ")
            several = len({unit for _, unit in columns}) > 1
            yield from made(rest, item if several else "", "other" if several else item)


def _grouped(
    units: Units,
    path: Path,
    columns: ColumnUnits,
    key: Path,
    item: str,
    what: str,
    chosen: tuple[int, ...] | None = None,
    *,
    sparse: bool = False,
) -> Iterator[Entry]:
    """The entries of the ``chosen`` columns of a table (None: all): one for each unit, or for tables in ``APART`` one for each
    column."""
    groups: dict[tuple[str, str], list[int]] = {}
    for k in range(len(columns)) if chosen is None else chosen:
        groups.setdefault((columns[k][1], columns[k][0] if what in APART else ""), []).append(k)
    for (unit, _), group in groups.items():
        names = tuple(columns[k][0] if what == "power" else columns[k][0].replace("_", " ") for k in group)  # powers: of the scene
        name = _name(what, unit, names)
        shown, factor = units.display_unit(unit)
        length = LENGTHS.get(names) if len(names) == 2 else None
        curves = (name,) if len(names) == 1 else names if length is None else (*names, length)
        tail = (name.replace(" ", "_"),) if item else ()
        read = partial(_scaled, columns=group, factor=factor, length=length is not None)
        yield Entry(".".join((*key, *tail)), item, name, shown, curves, path, read, sparse)


def _name(what: str, unit: str, columns: tuple[str, ...]) -> str:
    """Name of a quantity, by the kind of its table (``what``), its unit and its columns."""
    column = columns[0]
    if what == "motion":
        return MOTION.get(column.replace(" ", "_"), column)
    if what == "load":
        return BY_UNIT[unit] if unit != "m" else "point of action"
    if what == "other":
        return BY_UNIT.get(unit, column)
    if what == "answer":
        return column if len(columns) == 1 else "position"
    if (what, unit) in WORDS:
        return WORDS[what, unit]
    alone = len(columns) == 1 and what not in ("position", "reaction", "friction")
    return column if what in APART or alone else what.replace("_", " ")


def _scaled(values: Real, *, columns: list[int], factor: float, length: bool = False) -> Real:
    some = values[:, columns] * factor
    return np.column_stack([some, np.hypot(some[:, 0], some[:, 1])]) if length else some


def _drawn_laws(units: Units, name: str, path: Path, columns: ColumnUnits) -> Iterator[Entry]:
    """Entries of the lift and its derivatives by the graphical method, each with the drawn and the exact curve."""
    for k, (column, unit) in enumerate(columns[:3]):
        shown, factor = units.display_unit(unit)
        what = column.replace("_", " ").replace("drawn lift acceleration", "drawn acceleration")
        read = partial(_drawn_and_exact, column=k, factor=factor)
        yield Entry(f"cam.{name}.{what.replace(' ', '_')}", f"cam {name}", what, shown, ("drawn", "exact"), path, read)


def _drawn_and_exact(values: Real, *, column: int, factor: float) -> Real:
    drawn, error = values[:, column], values[:, column + 3]
    return factor * np.column_stack([drawn, drawn - error])


def _curvature(values: Real, *, factor: float) -> Real:
    """Curvature (F, 1), the reciprocal of the radius in the fifth column; 0 where the profile is straight."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return factor / values[:, 4:5]
