"""Tolerance bands: how far the curves of the catalogue may be off at every frame, from exact derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from mechcore.arrays import Real
from mechcore.errors import MechanismError
from mechviz.runs import Run
from mechviz.scene.scene import Scene
from mechviz.studies.designs.sensitivity import derivatives_of, traced
from mechviz.studies.designs.variables import Variable, parameters_of


@dataclass(frozen=True, eq=False)
class Bands:
    """Half widths (F, n) of the curves of quantities by their keys, in their units: the worst case, all tolerances added up; NaN
    at singular frames. ``refused``: why some or all are missing."""

    halves: Mapping[str, Real] = field(default_factory=dict)
    refused: str = ""


def with_tolerances(scene: Scene) -> tuple[Variable, ...]:
    """The parameters of a scene that have a tolerance."""
    return tuple(v for v in parameters_of(scene) if v.tolerance > 0.0)


def bands_of(run: Run) -> Bands:
    """The bands of all quantities of which derivatives are known, by the tolerances of the scene's parameters; none where nothing
    has a tolerance."""
    variables = with_tolerances(run.scene)
    if not variables:
        return Bands()
    refused = ""
    columns = {}
    try:
        exact = derivatives_of(run, variables)
    except MechanismError as error:
        return Bands(refused=error.faults[0].message)
    for quantity in run.catalogue.quantities:
        with suppress(LookupError):
            try:
                columns[quantity.key] = traced(exact, quantity)
            except MechanismError as error:
                refused = error.faults[0].message
    tolerances = np.array([v.tolerance for v in variables])
    halves = {
        key: np.asarray(np.tensordot(tolerances, np.abs(slopes), 1))
        for key, slopes in zip(columns, exact.of(*columns.values()), strict=True)
    }
    return Bands(halves, refused)
