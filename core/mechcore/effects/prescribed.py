"""Prescribed loads: forces and torques on links, actuators, and the factors that multiply them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar, cast

import numpy as np

from mechcore.arrays import Index, Real, Values
from mechcore.compiled.symbols import Symbol, Untraceable
from mechcore.effects.base import Configuration, LoadEffect, PointLoad, Wrench, coordinate, couple_between, joint_wrench, rate
from mechcore.effects.springs import Line
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.model import Model
from mechcore.laws.signals import Chirp, Ramp, Sine, Step
from mechcore.laws.timed import Table
from mechcore.numerics.frames import plane
from mechcore.numerics.tape import Traced, Untraced, value_of
from mechcore.numerics.tape_functions import piecewise
from mechcore.spec.loads import Actuator, Factor, Force, Polynomial, Prescribed, Torque

Multiplied = TypeVar("Multiplied", bound=Prescribed)


def needs_of(factor: Factor | None) -> frozenset[str]:
    """Quantities that a factor needs."""
    if factor is not None and factor.of in ("velocity", "vx", "vy", "speed"):
        return frozenset({"positions", "velocities"})
    if factor is not None and factor.of == "time":
        return frozenset({"positions", "time"})
    return frozenset({"positions"})


def factor_of(at: Configuration, factor: Factor | None, load: str) -> Real | float:
    """The factor of a load over the frames. Raises `MechanismError` where its function gives no finite numbers."""
    if factor is None:
        return 1.0
    if factor.values is not None:
        change: Real = factor.values - value_of(factor.values)
        return factor_of(at, replace(factor, values=None), load) + change
    known = _argument(at, factor)
    if isinstance(known, Symbol):
        return _of_symbol(factor, known)
    if isinstance(known, Traced):
        return _of_traced(factor, known)
    argument = np.asarray(known, float)
    try:
        value = np.asarray(factor.function(argument), float)
        value = np.broadcast_to(value, np.broadcast_shapes(argument.shape, value.shape))
    except Exception as error:  # a user's function may raise anything
        why = f"the function of its factor fails: {error}."
        raise MechanismError(Fault(f"loads.{load}", why, "It has to take an array and return as many numbers.")) from error
    if value.shape != argument.shape:
        why = f"the function of its factor gives {value.shape} numbers for {argument.shape} arguments."
        raise MechanismError(Fault(f"loads.{load}", why, "It has to return one number for each argument."))
    wrong = np.isfinite(argument) & ~np.isfinite(value)
    if wrong.any():
        where = float(argument[wrong].flat[0])
        raise MechanismError(
            Fault(f"loads.{load}", f"the function of its factor gives no finite number at {where:g}.", "Give it a value there.")
        )
    return value


def _of_symbol(factor: Factor, argument: Symbol) -> Values:
    """The factor in a traced program."""
    if factor.of == "time":
        return cast(Values, argument.code.value_of(factor.function))
    return _of_one(factor.function, argument, argument.code.piecewise, Untraceable)


def _of_traced(factor: Factor, argument: Traced) -> Values:
    """The factor with its derivative, on a tape."""
    if isinstance(factor.function, Sine | Step | Ramp | Chirp):
        t = argument.value
        return cast(Values, argument.tape.elementwise(factor.function(t), [(argument, factor.function(t, 1), None)]))
    return _of_one(factor.function, argument, piecewise, Untraced)


def _of_one(function: Any, argument: Any, pieces: Callable[..., Any], refused: type[Exception]) -> Values:
    """A function of a symbol or a traced array, which replace arrays; ``pieces`` evaluates piecewise polynomials, and ``refused``
    is raised for functions that cannot be traced."""
    value: Any
    if isinstance(function, Table):
        low, high, period = function.x[0], function.x[-1], function.period
        within: Any = argument.clip(low, high) if period is None else low + np.mod(argument - low, period)
        value = pieces(within, *function.pieces())
    elif isinstance(function, Polynomial):
        value = function.coefficients[-1]
        for c in function.coefficients[-2::-1]:
            value = value * (argument / function.per) + c
    else:
        try:
            value = function(argument)
        except Exception as error:  # a user's function may raise anything, especially for symbols
            raise refused("a factor is a function of Python") from error
    return cast(Values, value)


def is_piecewise(factor: Factor | None) -> bool:
    """Whether some derivative of a factor jumps, at the points or ends of a table."""
    f = None if factor is None else factor.function
    return isinstance(f, Table) and bool(f.knots)


def is_piecewise_in_time(factor: Factor | None) -> tuple[float, ...]:
    """All times [s] at which some derivative of a factor jumps, if it is a table over time that does not repeat; else none."""
    f = None if factor is None or factor.of != "time" else factor.function
    return tuple(f.knots) if isinstance(f, Table) and f.period is None else ()


def counts_turns(factor: Factor | None) -> bool:
    """Whether a factor may have another value after a whole turn of its argument."""
    return factor is not None and factor.of == "position" and getattr(factor.function, "period", None) is None


def phase_of(at: Configuration, factor: Factor | None) -> Index:
    """Number (F,) of the interval between the knots of its table in which a factor's argument lies."""
    if factor is None or not is_piecewise(factor):
        return np.zeros(np.shape(at.time), int)
    known, table = _argument(at, factor), factor.function
    assert isinstance(table, Table)  # as `is_piecewise` ensures
    if isinstance(known, Symbol):
        return _part_of_symbol(table, known)
    return np.asarray(table.part(np.asarray(value_of(known), float)))


def _part_of_symbol(table: Table, x: Any) -> Any:
    """`Table.part` in a traced program."""
    if table.period is None:
        return x.code.searched(x, table.knots)
    turns = np.floor((x - table.x[0]) / table.period)
    return turns * (len(table.knots) + 1) + x.code.searched(x - turns * table.period, table.knots)


def breaks_of(factor: Factor | None) -> tuple[float, ...]:
    """Times [s] at which a factor of time changes its form, as its function states them."""
    return () if factor is None or factor.of != "time" else tuple(getattr(factor.function, "breaks", ()))


def _argument(at: Configuration, factor: Factor) -> Values:
    if factor.of == "time":
        return at.time
    if factor.of in ("position", "velocity"):
        joint = factor.joint if factor.joint is not None else at.model.mechanism.drives[0].joint
        return coordinate(at, joint) if factor.of == "position" else rate(at, joint)
    assert factor.point is not None
    k = at.model.index[factor.point[0]]
    local = at.model.points[k][factor.point[1]]
    z = at.of_point(k, local, 0 if factor.of in ("x", "y") else 1)
    return np.abs(z) if factor.of == "speed" else z.real if factor.of in ("x", "vx") else z.imag


class FactoredLoad(LoadEffect[Multiplied]):
    """A load multiplied by a factor."""

    def __init__(self, load: Multiplied):
        super().__init__(load)
        self.needs = needs_of(load.factor)

    @property
    def piecewise(self) -> bool:
        return is_piecewise(self.load.factor) and not is_piecewise_in_time(self.load.factor)

    @property
    def breaks(self) -> tuple[float, ...]:
        return breaks_of(self.load.factor) or is_piecewise_in_time(self.load.factor)

    @property
    def counts_turns(self) -> bool:
        return counts_turns(self.load.factor)

    def phase(self, at: Configuration) -> Index:
        return phase_of(at, self.load.factor)

    def switch(self, at: Configuration) -> Values | None:
        return None if self.load.factor is None else _argument(at, self.load.factor)


class AppliedForce(FactoredLoad[Force]):
    """A force at a named point of a link."""

    def wrenches(self, at: Configuration) -> list[Wrench]:
        load, model = self.load, at.model
        k = model.index[load.link]
        local = model.points[k][load.point]
        vector = plane(*load.vector) * factor_of(at, load.factor, load.name)
        if load.axes == "link":
            vector = vector * at.rotation(k)
        arm = at.offset(k, local)
        if load.against is None:
            return [Wrench(load.name, "force", k, vector, 0.0, arm)]
        other = model.index[load.against]
        return [Wrench(load.name, "force", k, vector, 0.0, arm, other=other, other_arm=at.of_point(k, local) - at.origins[other])]

    def point_loads(self, model: Model) -> list[PointLoad] | None:
        load = self.load
        if load.factor is not None or load.axes == "link" or load.against is not None:
            return None
        k = model.index[load.link]
        return [PointLoad(load.name, "force", k, model.points[k][load.point], force=plane(*load.vector))]


class AppliedTorque(FactoredLoad[Torque]):
    """A free moment on a link."""

    def wrenches(self, at: Configuration) -> list[Wrench]:
        load = self.load
        moment = load.moment * factor_of(at, load.factor, load.name)
        k = at.model.index[load.link]
        if load.against is None:
            return [Wrench(load.name, "torque", k, 0j, moment, 0j)]
        return [couple_between(at, k, at.model.index[load.against], moment, name=load.name, kind="torque", cause=self.cause)]


class ConstantThrust(FactoredLoad[Actuator], Line[Actuator]):
    """``force`` times the factor pushes the two points apart, or the joint's links in the direction of its coordinate."""

    kind = "actuator"

    def wrenches(self, at: Configuration) -> list[Wrench]:
        thrust = self.load.force * factor_of(at, self.load.factor, self.name)
        if self.load.joint is not None:
            return [joint_wrench(at, self.load.joint, thrust, name=self.name, kind=self.kind, cause=self.cause)]
        return self.between(at, -thrust * self.direction(at, self.vector(at)))
