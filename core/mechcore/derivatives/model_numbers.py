"""The numbers of a compiled mechanism, and their derivatives by a parameter.

Vectors, masses, coefficients, positions of drives ... are explicit functions of a parameter: `slopes` interpolates them by
polynomials through enough values to be exact to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from mechcore.arrays import Real
from mechcore.derivatives.time_pieces import law_on_pieces_of, on_pieces_of
from mechcore.effects.machines import CylinderGas
from mechcore.effects.prescribed import factor_of
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.model import Model
from mechcore.kinematics.state import State, curve_argument
from mechcore.laws.timed import Free, Rest, Table
from mechcore.motion.compiled import drive_values
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism
from mechcore.records import NumberPlace, dataclass, kept_numbers, numbers_in
from mechcore.spec.loads import Factor, GasPressure, Prescribed, Servo
from mechcore.spec.mechanism import CamJoint, Mechanism

ModelNumbers = dict[NumberPlace, Any]  # numbers of a compiled mechanism, by their places
MAP_ROUNDING = 2e-14  # relative rounding error of a map of a few operations
MAP_NODES = 9  # points by which a map that is not affine is interpolated
MAP_TAIL = 1e-12  # its last coefficients over the largest: the interval is too wide where they exceed this
NARROWING = 4.0  # factor by which intervals that are too wide are narrowed
MOST_TRIES = 5  # widths that are tried


@dataclass(frozen=True)
class Parameter:
    """A number on which a mechanism depends: its name, its ``value``, the ``mechanism`` for another value, and a half ``width`` of
    the interval about its value in which there is one. For motions under forces also the numbers of ``contacts``
    (`impacts.contact_numbers`) for another value."""

    name: str
    value: float
    width: float
    mechanism: Callable[[float], Mechanism]
    contacts: Callable[[float], ModelNumbers] | None = None

    def beside(self) -> Mechanism:
        """A mechanism beside the value, above it or, where there is none, below. Raises `MechanismError`."""
        try:
            return self.mechanism(self.value + 0.5 * self.width)
        except MechanismError:
            return self.mechanism(self.value - 0.5 * self.width)


def refusal(message: str, remedy: str) -> MechanismError:
    """The error that states why no derivatives are known."""
    return MechanismError(Fault("derivatives", message, remedy))


def check_motion(motion: Motion, under_forces: bool) -> None:
    """Raise for motions of which no derivatives are known."""
    if len(motion.parts) > 1 or (not under_forces and any(isinstance(d.law, Free) for d in motion.mechanism.drives)):
        raise refusal("forces decide the motion: it depends on parameters by way of all that went before.", "Sweep it instead.")
    if motion.model.designs:
        raise refusal("several designs are computed side by side.", "Take one.")
    if motion.accuracy.differentiation != "exact":
        raise refusal("rates are taken from positions here.", "Leave the accuracy's differentiation exact.")


def check_structure(nominal: Model, other: Model, name: str) -> None:
    """Raise for a mechanism with other links, loops or blocks."""
    same = (
        nominal.links == other.links
        and nominal.ends == other.ends
        and nominal.tree == other.tree
        and [(b.kind, b.loops, b.unknowns) for b in nominal.blocks] == [(b.kind, b.loops, b.unknowns) for b in other.blocks]
        and nominal.angles.rotation_class == other.angles.rotation_class
    )
    if not same:
        raise refusal(f"the mechanism is another one beside the stated value of {name}.", "Move it away from there.")


def turning_vectors(model: Model) -> set[tuple[int, int]]:
    """The vectors that turn in the loops, as (loop, rotation class)."""
    return {(c, s) for c, total in enumerate(model.loop_sums) for s, _ in total.arms}


def numbers_of_model(model: Model, at: Motion, time: Real) -> ModelNumbers:
    """The numbers of a compiled mechanism on which results depend; those of curves and functions at the nominal motion ``at``."""
    numbers: ModelNumbers = {("time",): time}
    for j, joint in enumerate(model.joints):
        numbers["joint", j, "a"], numbers["joint", j, "b"] = joint.a, joint.b
        if joint.slide is not None:
            numbers["joint", j, "slide"] = joint.slide
    for k, (turn, offset) in enumerate(zip(model.turn, model.angles.offset, strict=True)):
        numbers["turn", k], numbers["offset", k] = turn, offset
    for link, points, (mass, centre, inertia) in zip(model.links, model.points, model.masses, strict=True):
        numbers |= {("point", link, name): z for name, z in points.items()}
        numbers["mass", link], numbers["centre", link], numbers["inertia", link] = mass, centre, inertia
    for link, body in model.bodies.items():
        numbers |= {("body", link, *place): x for place, x in numbers_in(body.gravity, ("gravity",))}
    for r, constraint in enumerate(model.constraints):
        for kind in ("groups", "drives", "slides"):
            numbers |= {(kind, r, i): c for i, c in getattr(constraint, kind)}
        if constraint.curve is not None:
            curve_value = constraint.curve.function(argument_of(at.model, r, at.state))
            numbers |= {("curve_value", r, k): np.asarray(curve_value[k]) for k in range(3)}
            numbers["shift", r] = constraint.curve.shift
    if model.constraints:
        constants = [c.constant for c in model.constraints]
        if any(c is None for c in constants):
            constants = list(compile_mechanism(model.mechanism).assembly.constants)
        numbers |= {("constant", r): c for r, c in enumerate(constants)}
    for d, values in enumerate(drive_values(model.mechanism, time)):
        if not isinstance(model.mechanism.drives[d].law, Free):
            numbers |= {("drive", d, k): np.broadcast_to(np.asarray(x, float), time.shape) for k, x in enumerate(values)}
    m = model.mechanism
    numbers |= {("mechanism", *place): x for place, x in numbers_in(m.gravity, ("gravity",))}
    for i, load in enumerate(m.loads):
        known = load
        if isinstance(load, Prescribed) and load.factor is not None:  # only the values of its function matter
            factors = np.asarray(factor_of(at, _on_nominal_pieces(load.factor, at.model.mechanism, i), load.name))
            numbers["mechanism", "loads", i, "factor", "values"] = np.broadcast_to(factors, at.shape)
            known = replace(load, factor=None)
        elif isinstance(load, Servo):
            target = law_on_pieces_of(getattr(_load(at.model.mechanism, i), "target", None), load.target)(at.time)
            numbers |= {("target", i, k): np.broadcast_to(target[k], at.shape) for k in range(2)}
            known = replace(load, target=Rest(0.0))
        elif isinstance(load, GasPressure):
            tables, there = _tables(load), _load(at.model.mechanism, i) or load
            for name, table in tables.items():
                own = on_pieces_of(getattr(there.cycle, name), table)
                numbers["table", i, name] = np.broadcast_to(own(CylinderGas(there).displacement(at)), at.shape)
            known = replace(load, cycle=replace(load.cycle, **dict.fromkeys(tables)))  # type: ignore[type-var]  # of a diagram
        numbers |= {("mechanism", *place): x for place, x in numbers_in(known, ("loads", i))}
        numbers |= {("kept", *place): x for place, x in kept_numbers(known, ("loads", i))}
    for i, stated in enumerate(m.joints):
        rubbing = numbers_in(getattr(stated, "friction", None), ("joints", i, "friction"))
        numbers |= {("mechanism", *place): x for place, x in rubbing}
        if rubbing and isinstance(stated, CamJoint):  # the pin of a roller brakes by its radius over that of the roller
            rollers = {"face": stated.face, "second": stated.second}
            numbers |= {
                ("mechanism", *at): x for name, roller in rollers.items() for at, x in numbers_in(roller, ("joints", i, name))
            }
    return numbers


def _tables(load: GasPressure) -> dict[str, Table]:
    """The tables of a measured indicator diagram, by the names of its strokes."""
    return {name: table for name, table in vars(load.cycle).items() if isinstance(table, Table)}


def _load(mechanism: Mechanism, i: int) -> Any:
    return mechanism.loads[i] if i < len(mechanism.loads) else None


def _on_nominal_pieces(factor: Factor, nominal: Mechanism, i: int) -> Factor:
    """A factor, evaluated on the pieces of that of load ``i`` of the nominal mechanism."""
    there = getattr(_load(nominal, i), "factor", None)
    return factor if there is None else replace(factor, function=on_pieces_of(there.function, factor.function))


def argument_of(model: Model, r: int, state: State) -> Any:
    """The argument of the curve of a relation."""
    curve = model.constraints[r].curve
    assert curve is not None
    return curve_argument(model, curve, state)


def slopes(numbers: Callable[[float], ModelNumbers], nominal: ModelNumbers, parameter: Parameter) -> ModelNumbers:
    """Derivatives by a parameter, exact to rounding, of the numbers that depend on it.

    A number whose values at four points lie on a straight line has the slope of the outer ones. Others are interpolated at 9
    Chebyshev points, in intervals that are narrowed until the last coefficients vanish to rounding. At an end of the parameter's
    range, as for a coefficient of zero, the interval lies on one side only. Raises `MechanismError` where a number is not smooth,
    or where there is no mechanism beside the parameter's value.
    """
    width, one_sided = parameter.width, None
    for _ in range(MOST_TRIES):
        ends: dict[float, ModelNumbers] = {}
        for side in (-1.0, 1.0):
            try:
                ends[side] = numbers(parameter.value + side * width)
            except MechanismError as error:
                reason = error
        if len(ends) == 2:
            return _slopes(numbers, nominal, _Interval(parameter.name, parameter.value, width, 0.0), ends[-1.0], ends[1.0])
        if ends and one_sided is None:
            one_sided = width, ends
        width /= NARROWING
    if one_sided is not None:
        width, ends = one_sided
        low, high = ends.get(-1.0, nominal), ends.get(1.0, nominal)
        return _slopes(numbers, nominal, _Interval(parameter.name, parameter.value, 0.5 * width, -next(iter(ends))), low, high)
    fault = reason.faults[0]
    raise refusal(
        f"there is no such mechanism just beside the stated value of {parameter.name}: {fault.path}: {fault.message}",
        "Let the values that belong together follow from one parameter, or vary something else.",
    ) from None


@dataclass(frozen=True)
class _Interval:
    """An interval of a parameter, of half ``width``, with places from -1 to 1; its ``value`` is at ``place``, in the middle or at
    an end."""

    name: str
    value: float
    width: float
    place: float

    def at(self, x: float) -> float:
        """The value at a place from -1 to 1."""
        return self.value + (x - self.place) * self.width


def _slopes(
    numbers: Callable[[float], ModelNumbers], nominal: ModelNumbers, interval: _Interval, below: ModelNumbers, above: ModelNumbers
) -> ModelNumbers:
    between = numbers(interval.at(0.375))
    slopes: ModelNumbers = {}
    bent = []
    for place, own in nominal.items():
        low, high, inner = (np.asarray(x[place]) for x in (below, above, between))
        if np.array_equal(low, own) and np.array_equal(high, own) and np.array_equal(inner, own):
            continue
        size = max(float(np.max(np.abs(x), initial=0.0)) for x in (low, own, high))
        if max(float(np.max(np.abs(x - own))) for x in (low, high, inner)) <= MAP_ROUNDING * size:
            continue  # rounding, as in the position of a drive of another speed at a frame
        line = 0.5 * (low + high), 0.5 * (high - low)
        known = ((own, interval.place), (inner, 0.375))
        off = max(float(np.max(np.abs(line[0] + x * line[1] - value))) for value, x in known)
        if off <= MAP_ROUNDING * size:
            slopes[place] = line[1] / interval.width
        else:
            bent.append(place)
    return slopes | _by_polynomials(numbers, bent, interval) if bent else slopes


def _by_polynomials(numbers: Callable[[float], ModelNumbers], places: Sequence[NumberPlace], interval: _Interval) -> ModelNumbers:
    nodes = np.cos(np.pi * np.arange(MAP_NODES) / (MAP_NODES - 1))
    fit = np.linalg.inv(chebyshev.chebvander(nodes, MAP_NODES - 1))
    there = [float(chebyshev.chebval(interval.place, chebyshev.chebder(row))) for row in np.eye(MAP_NODES)]
    for _ in range(MOST_TRIES):
        sampled = [numbers(interval.at(float(x))) for x in nodes]
        slopes: ModelNumbers = {}
        for place in places:
            values = np.stack([np.asarray(x[place]) for x in sampled])
            coefficients = np.tensordot(fit, values, 1)
            size = float(np.max(np.abs(coefficients)))
            if not float(np.max(np.abs(coefficients[-2:]))) <= MAP_TAIL * size:
                break
            slopes[place] = np.tensordot(there, coefficients, 1) / interval.width
        else:
            return slopes
        interval = replace(interval, width=interval.width / NARROWING)
    where = ".".join(map(str, places[len(slopes)]))
    raise refusal(f"{where} does not change smoothly with {interval.name}.", "Vary something else, or sweep it.")
