"""Factors of loads: what they depend on, taken from a configuration, and the function applied to it with care."""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Index, Real, Values
from mechcore.effects.base import Configuration
from mechcore.errors import Fault, MechanismError
from mechcore.laws.timed import Table
from mechcore.spec.loads import Factor


def needs_of(factor: Factor | None) -> frozenset[str]:
    """What must be known to evaluate a factor."""
    if factor is not None and factor.of in ("velocity", "vx", "vy", "speed"):
        return frozenset({"positions", "velocities"})
    if factor is not None and factor.of == "time":
        return frozenset({"positions", "time"})
    return frozenset({"positions"})


def coordinate(at: Configuration, joint: str) -> Real:
    """Relative coordinate of a joint [rad or m], driven or not; nothing else is computed."""
    model = at.model
    j = model.joint_index.get(joint)
    if j is not None and model.joints[j].coordinate == "slide":
        return at.drives[model.driven[j]][0] if j in model.driven else at.state.slide[j]
    if j is not None and j in model.driven and at.angles.exact:
        return at.drives[model.driven[j]][0]
    return at.angles.joint(joint)


def rate(at: Configuration, joint: str) -> Values:
    """Rate of a joint's relative coordinate [rad/s or m/s]."""
    model = at.model
    if joint in model.joint_index:
        j = model.joint_index[joint]
        if j in model.driven:
            return at.drives[model.driven[j]][1]
        if model.joints[j].coordinate == "slide":
            return at.speeds.slide[j]
        first, second = model.joints[j].links
    else:
        first, second = next(r.links for r in model.relations if r.name == joint)
    rotation_class = model.angles.rotation_class
    return at.speeds.angular[rotation_class[model.index[second]]] - at.speeds.angular[rotation_class[model.index[first]]]


def factor_of(at: Configuration, factor: Factor | None, load: str) -> Real | float:
    """The factor of a load over the frames. Raises `MechanismError` where its function gives no finite numbers."""
    if factor is None:
        return 1.0
    argument = np.asarray(_argument(at, factor), float)
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


def bends(factor: Factor | None) -> bool:
    """Whether some derivative of a factor jumps: at the points of a table, or where it ends."""
    f = None if factor is None else factor.function
    return isinstance(f, Table) and bool(f.knots)


def bends_in_time(factor: Factor | None) -> tuple[float, ...]:
    """Times [s] at which some derivative of a factor jumps, all of them, where it depends on time and does not repeat."""
    f = None if factor is None or factor.of != "time" else factor.function
    return tuple(f.knots) if isinstance(f, Table) and f.period is None else ()


def counts_turns(factor: Factor | None) -> bool:
    """Whether a factor may be another after a whole turn of what it depends on."""
    return factor is not None and factor.of == "position" and getattr(factor.function, "period", None) is None


def phase_of(at: Configuration, factor: Factor | None) -> Index:
    """Between which bends of its table a factor is: a whole number (F,)."""
    if factor is None or not bends(factor):
        return np.zeros(np.shape(at.time), int)
    argument = np.asarray(_argument(at, factor), float)
    table = factor.function
    return np.asarray(table.part(argument))  # type: ignore[attr-defined] # a table, as `bends` has seen


def breaks_of(factor: Factor | None) -> tuple[float, ...]:
    """Times [s] at which a factor of time changes its form, as its function tells them."""
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
    return np.abs(z) if factor.of == "speed" else np.real(z) if factor.of in ("x", "vx") else np.imag(z)
