"""The common interface of effects: each states which quantities it needs and which wrenches it adds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from mechcore.arrays import Index, Plane, Real, Values
from mechcore.branches.unwrapped import LinkAngles
from mechcore.kinematics.model import Model
from mechcore.kinematics.program import VectorSum
from mechcore.kinematics.rates import Rates
from mechcore.kinematics.state import State
from mechcore.laws.timed import Law
from mechcore.motion.motion import Motion
from mechcore.numerics.frames import added, crossed, is_zero, subtracted
from mechcore.records import dataclass
from mechcore.spec.loads import Load

Named = TypeVar("Named", bound=Load)


@dataclass(eq=False, slots=True)
class Wrench:
    """``force`` (complex, (F,) or one value) [N] and a free ``moment`` [N m] on a link.

    The force acts at ``arm`` from the link's origin (world axes) [m]. On the link ``other``, where there is one, the opposite
    force and moment act ``other_arm`` from that link's origin: at the same point, or at its own on the same line.
    """

    name: str
    kind: str  # "inertia", "gravity", "force", "torque", "spring" ...
    link: int
    force: Plane
    moment: Values
    arm: Plane
    cause: str = "process"
    other: int | None = None
    other_arm: Plane = 0j

    @property
    def links(self) -> tuple[int, ...]:
        """The link on which the wrench acts, then the one on which its opposite acts."""
        return (self.link,) if self.other is None else (self.link, self.other)


class PointLoad(NamedTuple):
    """A load on a link at a point fixed in it: a constant force, the inertia force -m a of a mass there, -J alpha."""

    name: str
    kind: str
    link: int
    point: Plane  # in link axes [m]; in a sweep it may vary, (designs, 1)
    force: Plane = 0j  # in the world [N]; in a sweep this and the following may vary, too
    mass: Values = 0.0  # [kg]
    inertia: Values = 0.0  # J [kg m^2]

    def together(self, other: PointLoad) -> PointLoad:
        """The sum of two loads that act at one point."""
        force, mass, inertia = self.force + other.force, self.mass + other.mass, self.inertia + other.inertia
        return self._replace(force=force, mass=mass, inertia=inertia)


class KnownLoad(NamedTuple):
    """A `PointLoad` as a step of a program: the link, its rotation class, the point in that class's axes (None at the link's
    origin), -mass times the point's position as a sum (None where that is too long or there is no mass), and whether it has an
    inertia."""

    load: PointLoad
    link: int
    rotation_class: int
    arm: Plane | None
    opposed: VectorSum | None
    rotary: bool

    def acting(self, at: Motion) -> tuple[Plane, Values]:
        """Force [N] and free moment [N m] in a motion; a `Configuration` suffices where the load has no mass and no inertia."""
        load, _, rotation_class, _, opposed, rotary = self
        force = load.force
        if opposed is not None:
            force = added(at.summed(opposed, 2), force)
        elif not is_zero(load.mass):
            force = added(-load.mass * at.of_point(load.link, load.point, 2), force)
        return force, -load.inertia * at.accelerations.angular[rotation_class] if rotary else 0.0


def known_load(model: Model, load: PointLoad) -> KnownLoad:
    """A load at a point as a `KnownLoad`."""
    place = model.point_sum(load.link, load.point) if not is_zero(load.mass) else None
    opposed = None if place is None else place.scaled(-load.mass)
    arm = None if is_zero(load.point) else load.point * model.turn[load.link]
    return KnownLoad(load, load.link, model.angles.rotation_class[load.link], arm, opposed, not is_zero(load.inertia))


def wrench_point(at: Configuration, wrench: Wrench) -> Plane:
    """Point at which a wrench acts, in the world."""
    origin = at.origins[wrench.link]
    return origin if is_zero(wrench.arm) else origin + wrench.arm


def power_of(at: Configuration, wrench: Wrench) -> Values:
    """Power [W] that a wrench supplies to its link, and its opposite to the other link: force times velocity plus moment times
    angular velocity."""
    total: Values = 0.0
    for k, arm, sign in ((wrench.link, wrench.arm, 1.0), (wrench.other, wrench.other_arm, -1.0)):
        if not k:  # no link, or the frame
            continue
        omega = at.speeds.angular[at.model.angles.rotation_class[k]]
        if not is_zero(wrench.force):
            velocity = at.origin_velocities[k]
            if not is_zero(arm):
                velocity = velocity + 1j * omega * arm
            total = total + sign * np.real(np.conj(wrench.force) * velocity)
        total = total + sign * wrench.moment * omega
    return total


def sum_up(wrenches: Iterable[Wrench], links: int) -> tuple[list[Plane], list[Values]]:
    """Force on every link and moment about every link's origin.

    Forces at the same arm are summed first, one moment for all, and constants before arrays.
    """
    force: list[Plane] = [0j] * links
    moment: list[Values] = [0.0] * links
    by_arm: dict[tuple[int, int], list[Any]] = {}  # (link, arm by identity): link, arm, constant force, force
    for w in wrenches:
        for k, arm, add in ((w.link, w.arm, added), (w.other, w.other_arm, subtracted)):
            if k is None:
                continue
            moment[k] = add(moment[k], w.moment)
            at = by_arm.setdefault((k, 0 if is_zero(arm) else id(arm)), [k, arm, 0j, 0j])
            which = 3 if isinstance(w.force, np.ndarray) else 2
            at[which] = add(at[which], w.force)
    for k, arm, constant, f in by_arm.values():
        f = added(f, constant)
        if not is_zero(f):
            force[k] = added(force[k], f)
            if not is_zero(arm):
                moment[k] = added(moment[k], crossed(arm, f))
    return force, moment


NEEDS = ("positions", "time", "velocities", "accelerations", "reactions")
"""Quantities that an effect can need; one that needs positions alone does not depend on anything else, not even on time."""

LOSSES = ("viscous", "medium", "dry friction")  # causes that only dissipate energy
CAUSES = {
    "gravity": "weight",
    "elastic": "springs and gas springs: the force depends on the position",
    "viscous": "dampers and viscous friction: against the velocity",
    "medium": "resistance of a medium, linear or quadratic in the velocity",
    "dry friction": "about constant size, against the relative velocity",
    "inertia": "-m a and -J alpha (d'Alembert)",
    "process": "what the machine is there for, or what drives it: gas, cutting, lifting, prescribed forces",
    "drive": "torque or force of a driven joint",
    "stop": "what an end stop holds while a joint rests on it",
}
"""Causes of forces, classed by origin as in lectures on the theory of machines, each with its meaning."""


class Configuration(Protocol):
    """Position and velocity state of a mechanism: the only input of an effect, unless it needs accelerations or reactions.

    `Motion` is one. Frames are the last axis of all arrays; plane vectors are complex numbers, links and joints are indices.
    """

    @property
    def model(self) -> Model: ...
    @property
    def time(self) -> Real: ...
    @property
    def drives(self) -> Sequence[tuple[Real, Real, Real]]: ...
    @property
    def state(self) -> State: ...
    @property
    def states(self) -> Mapping[str, Real]: ...
    @property
    def angles(self) -> LinkAngles: ...
    @property
    def speeds(self) -> Rates: ...
    @property
    def origins(self) -> list[Plane]: ...
    @property
    def origin_velocities(self) -> list[Plane]: ...
    def rotation(self, k: int) -> Plane: ...
    def offset(self, k: int, local: Plane) -> Plane: ...
    def of_point(self, k: int, local: Plane, derivative: int = 0) -> Plane: ...
    def guide(self, j: int) -> Plane: ...
    def joint_point(self, j: int, derivative: int = 0) -> Plane: ...


class Effect:
    """A force that a scene can include. Subclasses define what it ``needs`` and the ``wrenches`` that it adds.

    ``needs`` is a contract that tests check: an effect that needs positions alone never causes velocities to be solved, and one
    that does not need accelerations can be used in forward dynamics as it is.
    """

    cause: ClassVar[str] = "process"
    needs: frozenset[str] = frozenset({"positions"})

    def __init__(self, name: str):
        self.name = name

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r})"

    def wrenches(self, at: Any) -> list[Wrench]:
        """The wrenches on the links at a `Configuration` (a `Motion` where it needs accelerations)."""
        loads = self.point_loads(at.model)
        if loads is None:
            raise TypeError(f"{type(self).__name__} does not say which wrenches it adds")
        known = [known_load(at.model, a).acting(at) for a in loads]
        return [
            Wrench(a.name, a.kind, a.link, force, moment, at.offset(a.link, a.point), self.cause)
            for a, (force, moment) in zip(loads, known, strict=True)
        ]

    def point_loads(self, model: Model) -> Sequence[PointLoad] | None:
        """The wrenches as loads at points, where they are known beforehand, once per model; else None."""
        return None

    @property
    def piecewise(self) -> bool:
        """Whether its law changes its form elsewhere than at its `breaks`, with a kink or a jump; `phase` then gives the form that
        holds."""
        return False

    def phase(self, at: Configuration) -> Index:
        """A whole number for the form of the law that holds (F,), of effects that are `piecewise`."""
        return np.zeros(np.shape(at.time), int)

    def switch(self, at: Configuration) -> Values | None:
        """Level (F,) of the quantity at which the law changes its form so that a force jumps; None where there is no such single
        quantity."""
        return None

    @property
    def proportional(self) -> bool:
        """Whether its wrenches are proportional to the velocities at every position, independent of time."""
        return False

    limited: ClassVar[bool] = False  # whether its law has a limited range, which `check` tests

    def check(self, at: Configuration) -> None:
        """Raise `MechanismError` where a motion leaves the range of its law. `wrenches` continues beyond, because a search for a
        motion also tries positions that the motion does not reach."""

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times [s] at which its law changes its form, independent of the motion."""
        return ()

    @property
    def laws(self) -> tuple[Law, ...]:
        """Laws of time that it follows: it changes its form at their breakpoints."""
        return ()

    @property
    def integrates(self) -> bool:
        """Whether it has a state of its own in motions under forces, an integral over time that is zero at the start; a
        configuration has it in ``states`` by the name of the effect."""
        return False

    def state_rate(self, at: Configuration) -> Real:
        """Rate (F,) of that state."""
        raise TypeError(f"{type(self).__name__} has no state of its own")

    @property
    def counts_turns(self) -> bool:
        """Whether its force may differ after a whole turn of an angle."""
        return False

    def potential(self, at: Configuration) -> Values:
        """Potential energy [J] where the effect has one, else zero; its work is then not counted a second time."""
        return 0.0

    @property
    def stores(self) -> bool:
        """Whether its work is a change of its potential energy."""
        return self.cause in ("gravity", "elastic")


class LoadEffect(Effect, Generic[Named]):
    """The effect of a load that a mechanism lists, by the load's name."""

    def __init__(self, load: Named):
        super().__init__(load.name)
        self.load = load


def relative_speed(at: Configuration, first: int, second: int) -> Values:
    """Angular velocity of the second link less that of the first [rad/s]."""
    angular, rotation_class = at.speeds.angular, at.model.angles.rotation_class
    return angular[rotation_class[second]] - angular[rotation_class[first]]


def coordinate(at: Configuration, joint: str) -> Values:
    """Relative coordinate of a joint [rad or m], driven or not, without computing anything else."""
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
    return relative_speed(at, model.index[first], model.index[second])


def joint_wrench(at: Configuration, joint: str, effort: Values, *, name: str, kind: str, cause: str) -> Wrench:
    """``effort`` [N m or N] in the direction of a joint's coordinate: on its second link, the opposite on its first."""
    model = at.model
    j = model.joint_index[joint]
    loop_joint, (first, second) = model.joints[j], model.ends[j]
    place = at.joint_point(j)
    arm, other_arm = place - at.origins[second], place - at.origins[first]
    if loop_joint.coordinate == "angle":
        return Wrench(name, kind, second, 0j, effort, arm, cause, first, other_arm)
    along = at.guide(j) * (1.0 if loop_joint.guide == 0 else -1.0)  # the coordinate grows as the link without the guide moves
    return Wrench(name, kind, second, effort * along, 0.0, arm, cause, first, other_arm)


def couple_between(at: Configuration, first: int, second: int, moment: Values, *, name: str, kind: str, cause: str) -> Wrench:
    """A moment [N m] on a link, the opposite on another: at the pin on which they turn against each other, if there is one, else at
    the origins of both."""
    turning = (j for j, ends in enumerate(at.model.ends) if {*ends} == {first, second} and at.model.joints[j].coordinate == "angle")
    place = next((at.joint_point(j) for j in turning), None)
    arm, other_arm = (0j, 0j) if place is None else (place - at.origins[first], place - at.origins[second])
    return Wrench(name, kind, first, 0j, moment, arm, cause, second, other_arm)
