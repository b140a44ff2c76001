"""Loads that a mechanism can carry: frozen descriptions in SI units and radians; `mechcore.effects.registry` computes them.

A load between two links names both: the stated force or moment acts on the first, its opposite on the second, along the same line.
Either link may be the frame.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Real, Vec2
from mechcore.laws.indicator import Cycle
from mechcore.laws.timed import Law
from mechcore.records import dataclass

Use = Literal["useful", "harmful"]


@dataclass(frozen=True)
class Polynomial:
    """``sum of coefficients[k] (x / per)^k``."""

    coefficients: tuple[float, ...]
    per: float = 1.0

    def __call__(self, x: ArrayLike) -> Real:
        return np.asarray(np.polynomial.polynomial.polyval(np.asarray(x, float) / self.per, self.coefficients))


@dataclass(frozen=True, kw_only=True)
class Factor:
    """A factor as a function of time or of a kinematic quantity of the mechanism.

    ``function`` takes an array of arguments and returns as many factors: a `Table`, a `Polynomial`, a signal of time
    (`mechcore.laws.signals`) or any Python callable. ``of`` names the argument: the ``time`` [s]; ``position`` or ``velocity``,
    coordinate or rate of a ``joint`` [rad or m, per s], driven or not, by default of the first drive; ``x``, ``y``, ``vx``, ``vy``
    or ``speed`` of a ``point`` (link, point) [m, m/s].
    """

    function: Callable[[Any], Any]
    of: Literal["time", "position", "velocity", "x", "y", "vx", "vy", "speed"] = "position"
    joint: str | None = None
    point: tuple[str, str] | None = None
    values: Any = None  # over the frames, if the function itself varies (`mechcore.derivatives`)

    def __call__(self, argument: ArrayLike) -> Real:
        return np.asarray(self.function(np.asarray(argument, float)), float)


@dataclass(frozen=True, kw_only=True)
class _Load:
    name: str
    use: Use | None = None  # class of a resisting load in the energy balance; None: by its cause


@dataclass(frozen=True, kw_only=True)
class Force(_Load):
    """A force at a named point of a link: ``vector`` [N] times ``factor``.

    ``axes`` says whether the vector is fixed in the world or turns with the link. ``against``: a second link on which the
    opposite force acts at the same point.
    """

    link: str
    point: str
    vector: Vec2
    axes: Literal["world", "link"] = "world"
    factor: Factor | None = None  # None: constant 1
    against: str | None = None


@dataclass(frozen=True, kw_only=True)
class Torque(_Load):
    """A free moment [N m] on a link, counter-clockwise positive, times ``factor``; the opposite on ``against``, if named."""

    link: str
    moment: float
    factor: Factor | None = None
    against: str | None = None


@dataclass(frozen=True, kw_only=True)
class Spring(_Load):
    """A spring between two points: pull ``preload + stiffness (L - free_length)`` along their line [N], L their distance.

    ``solid_length``: the distance at which its coils touch; closer points are an event.
    """

    links: tuple[str, str]
    points: tuple[str, str]
    stiffness: float  # [N/m]
    free_length: float  # [m]
    preload: float = 0.0  # pull at the free length [N]
    solid_length: float | None = None  # [m]


@dataclass(frozen=True, kw_only=True)
class Damper(_Load):
    """A damper between two points: pull ``linear L' + quadratic L' |L'|`` along their line [N]."""

    links: tuple[str, str]
    points: tuple[str, str]
    linear: float = 0.0  # [N s/m]
    quadratic: float = 0.0  # [N s^2/m^2]


@dataclass(frozen=True, kw_only=True)
class GasSpring(_Load):
    """A gas spring between two points: it pushes them apart with ``force (gas_length / (gas_length - x))^exponent``.

    ``x = extended - L`` is how far it is pressed in, ``gas_length`` the volume of the gas when extended over the area of the rod
    (of the piston, where it has no rod on both sides) [m]; exponent 1 is isothermal (slow), 1.4 adiabatic (fast).
    """

    links: tuple[str, str]
    points: tuple[str, str]
    force: float  # when extended [N]
    extended: float  # distance of the points when extended [m]
    gas_length: float
    exponent: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Actuator(_Load):
    """An actuator of constant ``force`` [N] times ``factor``: it pushes two points apart along their line, or the links of a
    sliding ``joint`` in the direction of its coordinate."""

    force: float
    links: tuple[str, ...] = ()  # two, and as many points, or a joint instead
    points: tuple[str, ...] = ()
    joint: str | None = None
    factor: Factor | None = None


@dataclass(frozen=True, kw_only=True)
class TorsionSpring(_Load):
    """A torsion spring between two links: moment ``stiffness (angle - free_angle)`` on the first link [N m].

    ``angle`` is that of the second link's frame minus that of the first's. It starts within half a turn of the free angle, or at
    the value that drives state, and is continuous from there.
    """

    links: tuple[str, str]
    stiffness: float  # [N m/rad]
    free_angle: float = 0.0  # [rad]


@dataclass(frozen=True, kw_only=True)
class TorsionDamper(_Load):
    """A torsion damper between two links: moment ``coefficient`` times the rate of their angle on the first link [N m]."""

    links: tuple[str, str]
    coefficient: float  # [N m s/rad]


@dataclass(frozen=True, kw_only=True)
class _Bushed(_Load):
    """A load between points of two links, which need not coincide. It depends on x, y, the position of the second point relative to
    the first in the first link's axes, and on the angle of the second link's frame minus that of the first's."""

    links: tuple[str, str]
    points: tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class Bushing(_Bushed):
    """The springs of a bushing: ``stiffness`` times x, y and the angle minus ``free_angle``."""

    stiffness: tuple[float, float, float]  # [N/m, N/m, N m/rad]
    free_angle: float = 0.0  # [rad]


@dataclass(frozen=True, kw_only=True)
class BushingDamper(_Bushed):
    """The dampers of a bushing: ``damping`` times the rates of x, y and the angle."""

    damping: tuple[float, float, float]  # [N s/m, N s/m, N m s/rad]


@dataclass(frozen=True, kw_only=True)
class Drag(_Load):
    """Resistance of a medium against the velocity v of a point, ``-(linear + quadratic |v|) v`` [N].

    Without a point: against the link's angular velocity, a free moment [N m].
    """

    link: str
    point: str | None = None
    linear: float = 0.0  # [N s/m], or [N m s/rad] without a point
    quadratic: float = 0.0  # [N s^2/m^2], or [N m s^2/rad^2]


@dataclass(frozen=True, kw_only=True)
class Viscous(_Load):
    """Viscous friction in a movable joint: ``-coefficient`` times the speed of its relative motion, on its second link; see
    `mechcore.effects.resistance.ViscousFriction` for each kind of joint."""

    joint: str
    coefficient: float  # revolute, rolling, gear, rack: [N m s/rad]; prismatic, pin in slot, cylinder, cam, belt: [N s/m]


@dataclass(frozen=True, kw_only=True)
class BeltTension(_Load):
    """The tension of a belt or chain. A tensioner keeps that of the slack span constant; the tight span carries the transmitted
    force in addition.

    With a ``coefficient`` of friction between belt and pulleys an event reports where the belt would slip; 0: it cannot slip.
    """

    joint: str
    slack: float  # [N]
    coefficient: float = 0.0


@dataclass(frozen=True, kw_only=True)
class GasPressure(_Load):
    """The pressure of a gas on a piston that a sliding joint guides in its cylinder, by an indicator diagram.

    The piston is the joint's link without the guide. ``top`` is the joint's coordinate at top dead centre [m]; the cylinder's head
    is ``ahead`` of the piston (at greater coordinates) or ``behind`` it. ``back``: pressure on the piston's other side [Pa].
    A four-stroke cycle fires where the coordinate of ``drive`` (the first, if not named) is ``fires`` [rad], every two turns.
    """

    joint: str
    area: float  # [m^2]
    cycle: Cycle
    top: float
    head: Literal["ahead", "behind"] = "ahead"
    back: float = 101325.0
    drive: str | None = None
    fires: float = 0.0


@dataclass(frozen=True, kw_only=True)
class _Machine(_Load):
    """A machine that acts on a ``link`` from outside, with w its angular velocity, or between the links of a revolute ``joint``,
    with w the rate of its coordinate."""

    link: str | None = None
    joint: str | None = None


@dataclass(frozen=True, kw_only=True)
class DcMotor(_Machine):
    """A DC motor with separate or permanent excitation: torque ``stall_torque (1 - w / no_load_speed)``.

    With both numbers positive it turns counter-clockwise, with both negative clockwise.
    """

    stall_torque: float  # [N m]
    no_load_speed: float  # [rad/s]


@dataclass(frozen=True, kw_only=True)
class InductionMotor(_Machine):
    """An induction motor by the formula of Kloss: torque ``2 breakdown_torque / (s / s_b + s_b / s)``, s the slip
    ``1 - w / synchronous_speed``, s_b the slip at the breakdown torque. The sign of the synchronous speed is its sense."""

    breakdown_torque: float  # [N m]
    breakdown_slip: float
    synchronous_speed: float  # [rad/s]


@dataclass(frozen=True, kw_only=True)
class ConstantPower(_Machine):
    """A machine of constant power: torque ``power / |w|``, limited to ``torque_limit``, whose sign is the direction."""

    power: float  # [W]
    torque_limit: float  # [N m]


@dataclass(frozen=True, kw_only=True)
class Governor(_Machine):
    """A machine with a proportional speed governor: torque ``gain (set_speed - w)``, limited to ``least`` ... ``most``."""

    set_speed: float  # [rad/s]
    gain: float  # [N m s/rad]
    least: float  # [N m]
    most: float  # [N m]


@dataclass(frozen=True, kw_only=True)
class Servo(_Load):
    """A position servo between the links of a revolute or sliding ``joint``, in a motion under forces.

    With the error e, the ``target`` minus the joint's coordinate, the torque or force is ``proportional e + derivative e' +
    integral z``, z the integral of e since the start.
    """

    joint: str
    target: Law
    proportional: float  # [N m/rad or N/m]
    derivative: float = 0.0  # [N m s/rad or N s/m]
    integral: float = 0.0  # [N m/(rad s) or N/(m s)]


@dataclass(frozen=True, kw_only=True)
class JournalContact(_Load):
    """The elastic force between bearing and journal of a revolute ``joint`` with clearance; `mechcore.spec.clearance` makes it.

    ``links``: bearing, massless journal, shaft; ``slides``: the joints whose coordinates are the journal's position in the bearing;
    ``point``: centre of the bearing, a point of its link. In contact ``stiffness d (d / radial)^(exponent - 1)`` [N], d the
    indentation [m].
    """

    joint: str
    links: tuple[str, str, str]
    slides: tuple[str, str]
    point: str
    radial: float  # [m]
    stiffness: float  # [N/m]
    exponent: float = 1.0


@dataclass(frozen=True, kw_only=True)
class JournalLoss(JournalContact):
    """The losses in such a contact: the contact force times ``loss`` times the rate of the indentation, and friction between the
    surfaces."""

    loss: float = 0.0  # [s/m]
    friction: float = 0.0
    radius: float = 0.0  # of the journal [m]
    slow: float = 0.01  # speed below which friction is smoothed [m/s]


Machine = DcMotor | InductionMotor | ConstantPower | Governor
Prescribed = Force | Torque | Actuator
Between = Spring | Damper | GasSpring | TorsionSpring | TorsionDamper | Bushing | BushingDamper
Load = Prescribed | Between | Drag | Viscous | BeltTension | GasPressure | JournalContact | Machine | Servo
