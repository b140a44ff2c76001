"""Variables of studies: parameters of a scene, or any number in it by its path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechviz.scene.annotations import Leaf, Place, leaves
from mechviz.scene.expressions import Powers, is_plain
from mechviz.scene.faults import did_you_mean, path_text
from mechviz.scene.fields import QuantityMark
from mechviz.scene.reading.formulas import ParameterValue, parameters_behind
from mechviz.scene.scene import Scene
from mechviz.scene.units import QuantityError, split, unit_of

SLOPE_WIDTH = 0.02  # half width of the range over which slopes are found, relative to the value


@dataclass(frozen=True)
class Variable:
    """A number of a scene. ``name``: of a parameter, or a path such as ``links.crank.points.B[0]``; ``value``, range ``low`` to
    ``high`` and ``tolerance`` (0: none) are in ``unit`` ("": plain number); ``factor``: value of the unit in SI units."""

    name: str
    place: Place
    value: float
    unit: str
    factor: float = 1.0
    tolerance: float = 0.0
    low: float = -np.inf
    high: float = np.inf
    bare: bool = False  # written without a unit, in the scene's own

    @property
    def title(self) -> str:
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @property
    def width(self) -> float:
        """Half width of the range of values over which its slope is found."""
        return SLOPE_WIDTH * (abs(self.value) or (1.0 if not self.unit else 0.05 / self.factor))

    def stated(self, value: float) -> float | str:
        """A value as a scene states it."""
        return f"{value!r} {self.unit}" if self.unit and not self.bare else value

    def at(self, value: float) -> Variable:
        """The same variable with another value."""
        return replace(self, value=value)

    def changed(self, scene: Scene, value: float) -> Scene:
        """The scene with another value of the variable. Raises `MechanismError`."""
        return scene.changed({self.place: self.stated(value)})


def parameters_of(scene: Scene) -> tuple[Variable, ...]:
    """The independent parameters of a scene, which do not follow from others."""
    return tuple(_of_parameter(scene, known) for known in scene.parameters.values() if known.is_independent)


def variables_of(scene: Scene, names: Sequence[str] = ()) -> tuple[Variable, ...]:
    """Variables by name. Without names: the independent parameters, or, where the scene has none, the nonzero numbers of its links
    and loads. Raises `MechanismError`."""
    own = {v.name: v for v in parameters_of(scene)}
    if not names and own:
        return tuple(own.values())
    numbers = {path_text(leaf.path): leaf for leaf in leaves(scene.document) if _varies(scene, leaf)}
    if not names:
        every = [_of_number(scene, leaf) for leaf in numbers.values() if leaf.path[0] in ("links", "loads")]
        return tuple(v for v in every if v.value != 0.0)
    variables = []
    for name in names:
        if name in own:
            variables.append(own[name])
        elif name in numbers:
            variables.append(_of_number(scene, numbers[name]))
        else:
            raise MechanismError(_no_variable(scene, name, [*own, *numbers]))
    return tuple(variables)


def _no_variable(scene: Scene, name: str, known: Sequence[str]) -> Fault:
    """Fault that states why a name is not that of a variable."""
    places = {path_text(place): place for place in scene.document.formulas}
    if name in places:
        behind = parameters_behind(scene.document, places[name])
        own = [v.name for v in parameters_of(scene) if v.name in behind]
        why = f"follows from the expression '{scene.document.formulas[places[name]]}'."
        return Fault(f"--by {name}", why, f"Vary {' or '.join(own)}." if own else "")
    if name in scene.parameters:
        own = [v.name for v in parameters_of(scene)]
        return Fault(f"--by {name}", "follows from other parameters.", f"Vary one of {', '.join(own)}.")
    return Fault(f"--by {name}", "is neither a parameter nor a number of the scene.", did_you_mean(name, known, what="There are"))


def without_ranges(scene: Scene) -> Scene:
    """The scene without the ranges of its parameters."""
    ranges = [name for name, p in scene.parameters.items() if np.isfinite(p.low) or np.isfinite(p.high)]
    return scene.changed({("parameters", name, "range"): None for name in ranges}) if ranges else scene


def _of_parameter(scene: Scene, known: ParameterValue) -> Variable:
    entry = scene.document.to_data()["parameters"][known.name]
    table = isinstance(entry, dict)
    stated = entry["value"] if table else entry
    unit = _unit(scene, str(stated), known.amount.powers) if any(known.amount.powers) else ""
    factor = float(unit_of(unit).factor) if unit else 1.0
    place: Place = ("parameters", known.name, "value") if table else ("parameters", known.name)
    in_unit = [float(f"{x / factor:.15g}") for x in (known.amount.number, known.tolerance, known.low, known.high)]
    value, tolerance, low, high = in_unit
    return Variable(known.name, place, value, unit, factor, tolerance, low, high)


def _unit(scene: Scene, stated: str, powers: Powers) -> str:
    """The unit that a parameter states; for an expression of numbers the scene's unit of the same dimension."""
    if is_plain(stated) and unit_of(own := split(stated)[1]).powers == powers:
        return own
    return scene.units.of(powers)


def _varies(scene: Scene, leaf: Leaf) -> bool:
    """Whether a value of the document is a number that can vary: neither an expression, nor whole by nature, nor a direction."""
    if leaf.path in scene.document.formulas or leaf.path[0] not in ("links", "joints", "loads"):
        return False
    if "along" in leaf.path or isinstance(leaf.value, bool):
        return False
    if isinstance(leaf.value, str):
        return leaf.mark(QuantityMark) is not None and is_plain(leaf.value)
    return isinstance(leaf.value, float | int) and leaf.kind is not int


def _of_number(scene: Scene, leaf: Leaf) -> Variable:
    name, kind = path_text(leaf.path), scene.kinds.get(path_text(leaf.path))
    if isinstance(leaf.value, str):
        try:
            number, unit = split(leaf.value)
            return Variable(name, leaf.path, float(number), unit, float(unit_of(unit).factor))
        except QuantityError as error:
            raise MechanismError(Fault(f"--by {name}", str(error), error.remedy)) from None
    plain = Variable(name, leaf.path, float(leaf.value), "", bare=True)
    if kind is None:
        return plain
    return replace(plain, unit=scene.units.symbol(kind), factor=float(scene.units.factor(kind)))
