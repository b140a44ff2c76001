"""Pulls along the line between two points of two links: springs, dampers, gas springs."""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Complex, Real, unit_vectors
from mechcore.effects.base import Configuration, Effect, Wrench
from mechcore.errors import Fault, MechanismError
from mechcore.spec.loads import Actuator, Damper, GasSpring, Spring
from mechcore.texts import as_length


class Line(Effect):
    """Between ``load.points`` of ``load.links``; the pull acts on the first link towards the second's point."""

    kind = ""

    def __init__(self, load: Spring | Damper | GasSpring | Actuator):
        Effect.__init__(self, load.name)
        self.ends = tuple(zip(load.links, load.points, strict=True))

    def place(self, at: Configuration, end: int, derivative: int = 0) -> Complex:
        """World position of one of the two points, or its velocity."""
        link, point = self.ends[end]
        k = at.model.index[link]
        return at.of_point(k, at.model.points[k][point], derivative)

    def vector(self, at: Configuration) -> Complex:
        """From the first point to the second [m]."""
        return self.place(at, 1) - self.place(at, 0)

    def direction(self, at: Configuration, vector: Complex) -> Complex:
        """Unit vector from the first point to the second; refused where they meet."""
        length = np.abs(vector)
        if np.any(length == 0.0):
            when = float(np.broadcast_to(at.time, np.shape(length))[length == 0.0][0]) if np.ndim(length) else 0.0
            raise MechanismError(
                Fault(
                    f"loads.{self.name}", f"its two points meet at {when:.6g} s: no direction is left.", "Move one of the points."
                )
            )
        return unit_vectors(vector)

    def between(self, at: Configuration, force: Complex) -> list[Wrench]:
        """``force`` on the first link at its point, the opposite on the second link at the same point and line."""
        first, second = (at.model.index[link] for link, _ in self.ends)
        arm = at.model.points[first][self.ends[0][1]] * at.rotation(first)
        other_arm = at.model.points[second][self.ends[1][1]] * at.rotation(second) - self.vector(at)
        return [Wrench(self.name, self.kind, first, force, 0.0, arm, self.cause, second, other_arm)]


class LineSpring(Line):
    """Pull ``preload + stiffness (L - free_length)``; its energy is zero at the free length."""

    cause, kind = "elastic", "spring"

    def __init__(self, load: Spring):
        super().__init__(load)
        self.load = load

    def wrenches(self, at: Configuration) -> list[Wrench]:
        load, vector = self.load, self.vector(at)
        rest = load.preload - load.stiffness * load.free_length
        force = load.stiffness * vector
        if rest:  # a spring of no free length needs no direction: it pulls in proportion to its length
            force = force + rest * self.direction(at, vector)
        return self.between(at, force)

    def potential(self, at: Configuration) -> Real:
        load = self.load
        stretch = np.abs(self.vector(at)) - load.free_length
        return (0.5 * load.stiffness * stretch + load.preload) * stretch


class LineDamper(Line):
    """Pull ``linear L' + quadratic L' |L'|``: it always takes energy away."""

    cause, kind = "viscous", "damper"
    needs = frozenset({"positions", "velocities"})

    def __init__(self, load: Damper):
        super().__init__(load)
        self.load = load

    def wrenches(self, at: Configuration) -> list[Wrench]:
        along = self.direction(at, self.vector(at))
        speed = np.real(np.conj(along) * (self.place(at, 1, 1) - self.place(at, 0, 1)))
        return self.between(at, (self.load.linear + self.load.quadratic * np.abs(speed)) * speed * along)


class LineGasSpring(Line):
    """Thrust ``force (gas_length / (gas_length - x))^exponent``; its energy is zero when extended."""

    cause, kind = "elastic", "gas spring"

    def __init__(self, load: GasSpring):
        super().__init__(load)
        self.load = load

    limited = True

    def check(self, at: Configuration) -> None:
        load = self.load
        pressed = load.extended - np.abs(self.vector(at))
        low, high = np.nanmin(pressed), np.nanmax(pressed)
        if low < -1e-9 * load.extended:
            why = f"it is pulled to {as_length(load.extended - low)}, beyond its extended length of {as_length(load.extended)}."
            raise MechanismError(
                Fault(f"loads.{self.name}", why, f"Give an extended length of at least {as_length(load.extended - low)}.")
            )
        if high >= load.gas_length:
            why = f"it is compressed by {as_length(high)}, its gas length is {as_length(load.gas_length)}: no gas is left."
            remedy = "Give a greater gas length, or place its points further apart."
            raise MechanismError(Fault(f"loads.{self.name}", why, remedy))

    def _left(self, length: Real) -> Real:
        """Volume that is left of the gas over its volume when extended; NaN where there is none."""
        left = 1.0 - (self.load.extended - length) / self.load.gas_length
        return np.where(left > 0.0, left, np.nan)

    def wrenches(self, at: Configuration) -> list[Wrench]:
        vector = self.vector(at)
        thrust = self.load.force * self._left(np.abs(vector)) ** -self.load.exponent
        return self.between(at, -thrust * self.direction(at, vector))

    def potential(self, at: Configuration) -> Real:
        load = self.load
        log, beyond = np.log(self._left(np.abs(self.vector(at)))), load.exponent - 1.0
        return load.force * load.gas_length * (np.expm1(-beyond * log) / beyond if beyond else -log)
