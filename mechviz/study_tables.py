"""The numbers of a run's studies as tables: force systems, reduction, shaking, substitute masses, closing errors of polygons."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from .tables import Columns, Table

if TYPE_CHECKING:
    from .run import Run

__all__ = ["study_tables"]

_FORCE: Columns = (("Fx", "N"), ("Fy", "N"), ("moment", "N m"))


def study_tables(run: Run) -> Iterator[Table]:
    """All tables of what the scene asks for; nothing where it asks for nothing."""
    studies = run.studies
    for name, plans in studies.plans.items():
        closing = np.max([plan.closing for plan in plans], axis=0)
        yield Table(("polygons", name, "closing"), f"{name} plan", (("closing", "1"),), closing[:, None])
    for name, system in studies.systems.items():
        line = np.column_stack([system.force, system.moment, system.resultant.point])
        columns: Columns = (*_FORCE, ("line x", "m"), ("line y", "m"))
        yield Table(("data", "systems", name, "resultant"), f"{name}.resultant", columns, line)
    if studies.systems:
        closing = np.max([s.drawing.closing for s in studies.systems.values()], axis=0)
        yield Table(("polygons", "funicular", "closing"), "funicular polygon", (("closing", "1"),), closing[:, None])
    for name, polode in studies.polodes.items():
        for kind, way in (("fixed", polode.fixed), ("moving", polode.moving)):
            yield Table(("data", "polodes", name, kind), f"{name}.{kind} polode", (("x", "m"), ("y", "m")), way)
    for name, found in studies.equivalents.items():
        for pin, place in found.pins.items():
            columns = (("x", "m"), ("y", "m"))
            values = np.column_stack([place.real, place.imag])
            yield Table(("data", "equivalent", name, pin or "block"), f"{name}.{pin or 'block'}", columns, values)
    for name, r in studies.reduced.items():
        turning = r.point is None
        columns = (
            ("reduced inertia", "kg m^2") if turning else ("reduced mass", "kg"),
            ("slope", "kg m^2/rad") if turning else ("slope", "kg/m"),
            ("reduced moment", "N m") if turning else ("reduced force", "N"),
            ("kinetic energy", "J"),
        )
        values = np.column_stack([r.mass, r.slope, r.force, r.energy])
        yield Table(("data", "reduced", name), f"{name}.reduced", columns, values)
    for name, s in (("", studies.shaking), ("balanced", studies.balanced)):
        if s is not None:
            path = ("data", "shaking", name) if name else ("data", "shaking")
            yield Table(path, f"shaking {name}".strip(), _FORCE, np.column_stack([s.force, s.moment]))
    for name, body in studies.substitutes.items():
        path = ("data", "substitutes", name)
        yield Table((*path, "inertia"), f"{name}.substitutes", _FORCE, np.column_stack([body.force, body.moment]))
        if body.correction is not None:
            columns = (("couple", "N m"),)
            yield Table((*path, "correction"), f"{name}.correction", columns, body.correction[:, None])
        for k in range(len(body.masses)):
            columns = (("x", "m"), ("y", "m"), ("Fx", "N"), ("Fy", "N"), ("mass", "kg"))
            mass = np.full(len(body.places), body.masses[k])
            values = np.column_stack([body.places[:, k], body.forces[:, k], mass])
            yield Table((*path, str(k + 1)), f"{name}.mass {k + 1}", columns, values)
