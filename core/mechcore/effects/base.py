"""What every effect is: it says which quantities it needs and which wrenches it adds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Protocol

import numpy as np

from ..kinematics import Rates
from ..laws import Law
from ..model import Model
from ..statics import Acting
from ..unwrapped import LinkAngles
from .wrench import Wrench

__all__ = ["CAUSES", "NEEDS", "Configuration", "Effect"]

Array = Any

NEEDS = ("positions", "time", "velocities", "accelerations", "reactions")
"""Quantities that an effect can need; one that needs positions alone depends on nothing else, not even on the time."""

CAUSES = {
    "gravity": "weight",
    "elastic": "springs and gas springs: the force depends on the position",
    "viscous": "dampers and viscous friction: against the velocity",
    "medium": "resistance of a medium, linear or quadratic in the velocity",
    "dry friction": "about constant size, against the relative velocity",
    "inertia": "-m a and -J alpha (d'Alembert)",
    "process": "what the machine is there for, or what drives it: gas, cutting, lifting, prescribed forces",
    "drive": "torque or force of a driven pair",
    "stop": "what an end stop holds while a pair rests on it",
}
"""Causes of forces, as the lecture classes them (by origin), each with its meaning."""


class Configuration(Protocol):
    """Where a mechanism is and how fast it moves: all that an effect may look at, unless it needs accelerations or reactions.

    `Motion` is one. Frames are the last axis of all arrays; plane vectors are complex numbers, links and joints are indices.
    """

    @property
    def model(self) -> Model: ...
    @property
    def time(self) -> Any: ...
    @property
    def drives(self) -> Any: ...
    @property
    def state(self) -> Any: ...
    @property
    def states(self) -> Mapping[str, Array]: ...
    @property
    def angles(self) -> LinkAngles: ...
    @property
    def speeds(self) -> Rates: ...
    @property
    def origins(self) -> list[Array]: ...
    @property
    def origin_velocities(self) -> list[Array]: ...
    def rotation(self, k: int) -> Array: ...
    def offset(self, k: int, local: complex) -> Array: ...
    def of_point(self, k: int, local: complex, derivative: int = 0) -> Array: ...
    def guide(self, j: int) -> Array: ...
    def joint_point(self, j: int, derivative: int = 0) -> Array: ...


class Effect:
    """A force that a scene can ask for. Subclasses say what it ``needs`` and the ``wrenches`` that it adds.

    ``needs`` is a promise that tests hold an effect to: one that needs positions alone never makes velocities be solved, and
    one that does not need accelerations can serve forward dynamics as it is.
    """

    cause: ClassVar[str] = "process"
    needs: frozenset[str] = frozenset({"positions"})

    def __init__(self, name: str):
        self.name = name

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r})"

    def wrenches(self, at: Any) -> list[Wrench]:
        """The wrenches on the links at a `Configuration` (a `Motion` where it needs accelerations)."""
        raise TypeError(f"{type(self).__name__} does not say which wrenches it adds")

    def acting(self, model: Model) -> Sequence[Acting] | None:
        """The same as the wrenches, where that can be told beforehand, once per model; else None."""
        return None

    @property
    def piecewise(self) -> bool:
        """Whether its law changes its form somewhere else than at its `breaks`, with a bend or a jump; then `phase` says which form
        holds."""
        return False

    def phase(self, at: Configuration) -> Array:
        """A whole number for the form of the law that holds (F,), of effects that are `piecewise`."""
        return np.zeros(np.shape(at.time), int)

    limited: ClassVar[bool] = False  # whether its law ends somewhere; then `check` says where

    def check(self, at: Configuration) -> None:
        """Raise `MechanismError` where a motion leaves the range of its law. `wrenches` go on beyond: who looks for a motion tries
        positions that it does not take."""

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times [s] at which its law changes its form, whatever the mechanism does."""
        return ()

    @property
    def laws(self) -> tuple[Law, ...]:
        """Laws of time that it follows: it changes its form where they do."""
        return ()

    @property
    def integrates(self) -> bool:
        """Whether it has a state of its own in motions under forces, an integral over time that is zero at the start: a
        configuration knows it in ``states`` by the name of the effect."""
        return False

    def state_rate(self, at: Configuration) -> Array:
        """Rate (F,) of that state."""
        raise TypeError(f"{type(self).__name__} has no state of its own")

    @property
    def counts_turns(self) -> bool:
        """Whether it is another where an angle has gone on by a whole turn."""
        return False

    def potential(self, at: Configuration) -> Array:
        """Potential energy [J] where the effect has one, else zero: with it, the work is not counted a second time."""
        return 0.0

    @property
    def dissipates(self) -> bool:
        """Whether the effect only ever takes energy away."""
        return self.cause in ("viscous", "medium", "dry friction")

    @property
    def stores(self) -> bool:
        """Whether its work is a change of its potential energy."""
        return self.cause in ("gravity", "elastic")
