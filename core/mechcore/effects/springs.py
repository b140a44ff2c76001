"""Springs, dampers and gas springs between two points; torsion springs and dampers, and bushings, between two links."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from mechcore.arrays import Complex, Plane, Real, Values, unit_vectors
from mechcore.effects.base import Configuration, LoadEffect, Wrench, couple_between, relative_speed
from mechcore.errors import Fault, MechanismError
from mechcore.spec.loads import Actuator, Bushing, BushingDamper, Damper, GasSpring, Spring, TorsionDamper, TorsionSpring
from mechcore.texts import as_length

Joining = TypeVar("Joining", Spring, Damper, GasSpring, Actuator, Bushing, BushingDamper)


class _BetweenPoints(LoadEffect[Joining]):
    """Between ``load.points`` of ``load.links``."""

    kind = ""

    def end(self, at: Configuration, number: int) -> tuple[int, complex]:
        """The first (0) or second (1) link and its point in link axes [m]."""
        k = at.model.index[self.load.links[number]]
        return k, at.model.points[k][self.load.points[number]]

    def place(self, at: Configuration, number: int, derivative: int = 0) -> Plane:
        """World position of the first or second point, or its velocity."""
        return at.of_point(*self.end(at, number), derivative)


class Line(_BetweenPoints[Joining]):
    """The pull acts on the first link towards the second's point."""

    def vector(self, at: Configuration) -> Plane:
        """From the first point to the second [m]."""
        return self.place(at, 1) - self.place(at, 0)

    def direction(self, at: Configuration, vector: Plane) -> Complex:
        """Unit vector from the first point to the second; refused where they meet."""
        length = np.abs(vector)
        if np.any(length == 0.0):
            meeting = np.flatnonzero(length == 0.0)
            when = float(at.time[meeting[0]]) if np.ndim(length) else 0.0
            raise MechanismError(
                Fault(
                    f"loads.{self.name}", f"its two points meet at {when:.6g} s: no direction is left.", "Move one of the points."
                )
            )
        return unit_vectors(vector)

    def between(self, at: Configuration, force: Plane) -> list[Wrench]:
        """``force`` on the first link at its point, the opposite on the second link at its own, on the same line."""
        (first, own), (second, other) = self.end(at, 0), self.end(at, 1)
        arm, other_arm = own * at.rotation(first), other * at.rotation(second)
        return [Wrench(self.name, self.kind, first, force, 0.0, arm, self.cause, second, other_arm)]


class LineSpring(Line[Spring]):
    """Pull ``preload + stiffness (L - free_length)``; its energy is zero at the free length."""

    cause, kind = "elastic", "spring"

    def wrenches(self, at: Configuration) -> list[Wrench]:
        load, vector = self.load, self.vector(at)
        rest = load.preload - load.stiffness * load.free_length
        force = load.stiffness * vector
        if rest:  # without this part, the pull is proportional to the length and needs no direction
            force = force + rest * self.direction(at, vector)
        return self.between(at, force)

    def potential(self, at: Configuration) -> Real:
        load = self.load
        deflection = np.abs(self.vector(at)) - load.free_length
        return (0.5 * load.stiffness * deflection + load.preload) * deflection


class LineDamper(Line[Damper]):
    """Pull ``linear L' + quadratic L' |L'|``: it always dissipates energy."""

    cause, kind = "viscous", "damper"
    needs = frozenset({"positions", "velocities"})

    @property
    def proportional(self) -> bool:
        return self.load.quadratic == 0.0

    def wrenches(self, at: Configuration) -> list[Wrench]:
        along = self.direction(at, self.vector(at))
        speed = np.real(np.conj(along) * (self.place(at, 1, 1) - self.place(at, 0, 1)))
        return self.between(at, (self.load.linear + self.load.quadratic * np.abs(speed)) * speed * along)


class LineGasSpring(Line[GasSpring]):
    """Thrust ``force (gas_length / (gas_length - x))^exponent``; its energy is zero when extended."""

    cause, kind = "elastic", "gas spring"

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
        """Volume of the gas over its volume when extended; NaN where it is not positive."""
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


class AngleSpring(LoadEffect[TorsionSpring]):
    """Moment ``stiffness (angle - free_angle)`` on the first link; its energy is zero at the free angle."""

    cause = "elastic"

    def _turned(self, at: Configuration) -> Real:
        first, second = (at.model.index[k] for k in self.load.links)
        free = self.load.free_angle
        return at.angles.relative(first, second, (free, free)) - free

    @property
    def counts_turns(self) -> bool:
        return True

    def wrenches(self, at: Configuration) -> list[Wrench]:
        first, second = (at.model.index[k] for k in self.load.links)
        moment = self.load.stiffness * self._turned(at)
        return [couple_between(at, first, second, moment, name=self.name, kind="torsion spring", cause=self.cause)]

    def potential(self, at: Configuration) -> Real:
        return 0.5 * self.load.stiffness * self._turned(at) ** 2


class AngleDamper(LoadEffect[TorsionDamper]):
    """Moment ``coefficient`` times the relative angular velocity on the first link."""

    cause = "viscous"
    needs = frozenset({"positions", "velocities"})

    @property
    def proportional(self) -> bool:
        return True

    def wrenches(self, at: Configuration) -> list[Wrench]:
        first, second = (at.model.index[k] for k in self.load.links)
        moment = self.load.coefficient * relative_speed(at, first, second)
        return [couple_between(at, first, second, moment, name=self.name, kind="torsion damper", cause=self.cause)]


class _Bushed(_BetweenPoints[Joining]):
    """The force on the first link and the opposite force on the second link both act at the second link's point."""

    def apart(self, at: Configuration, derivative: int = 0) -> Plane:
        """From the first point to the second in the first link's axes, or its rate there."""
        k, _ = self.end(at, 0)
        away = self.place(at, 1, derivative) - self.place(at, 0, derivative)
        if derivative:
            omega = at.speeds.angular[at.model.angles.rotation_class[k]]
            away = away - 1j * omega * (self.place(at, 1) - self.place(at, 0))
        return away * np.conj(at.rotation(k))

    def between(self, at: Configuration, x: Values, y: Values, moment: Values) -> list[Wrench]:
        """Force (x, y) in the first link's axes, and moment, on the first link; the opposite on the second."""
        (k, _), (m, point) = self.end(at, 0), self.end(at, 1)
        arm = at.offset(m, point)
        here = at.of_point(m, point) - at.origins[k]
        return [Wrench(self.name, self.kind, k, (x + 1j * y) * at.rotation(k), moment, here, self.cause, m, arm)]


class BushingSprings(_Bushed[Bushing]):
    """Force and moment by the offset of the points and the angle; its energy is zero in the unloaded position."""

    cause, kind = "elastic", "bushing"

    def __init__(self, load: Bushing):
        super().__init__(load)
        self.torsion = AngleSpring(
            TorsionSpring(name=load.name, links=load.links, stiffness=load.stiffness[2], free_angle=load.free_angle)
        )

    @property
    def counts_turns(self) -> bool:
        return self.torsion.counts_turns

    def wrenches(self, at: Configuration) -> list[Wrench]:
        d = self.apart(at)
        x, y, _ = self.load.stiffness
        return self.between(at, x * d.real, y * d.imag, self.torsion.wrenches(at)[0].moment)

    def potential(self, at: Configuration) -> Real:
        d = self.apart(at)
        x, y, _ = self.load.stiffness
        return 0.5 * (x * d.real**2 + y * d.imag**2) + self.torsion.potential(at)


class BushingDampers(_Bushed[BushingDamper]):
    """Force and moment by the rates of the offset and the angle, in the frame of the first link."""

    cause, kind = "viscous", "bushing damper"
    needs = frozenset({"positions", "velocities"})

    @property
    def proportional(self) -> bool:
        return True

    def __init__(self, load: BushingDamper):
        super().__init__(load)
        self.torsion = AngleDamper(TorsionDamper(name=load.name, links=load.links, coefficient=load.damping[2]))

    def wrenches(self, at: Configuration) -> list[Wrench]:
        v = self.apart(at, 1)
        x, y, _ = self.load.damping
        return self.between(at, x * v.real, y * v.imag, self.torsion.wrenches(at)[0].moment)
