"""Dry friction in joints: reactions and friction that depend on each other, solved together for all frames.

Friction puts a wrench on the two links of a joint, against their relative motion and in proportion to the normal load of the joint;
this load again depends on all friction. `elements` lists where friction acts, `respond` finds the effect of a unit of it,
`normal_loads` finds the loads or that there are none (the mechanism jams), `FrictionResult` holds the results, `events` finds when
they change.

At rest, where the relative speed of a joint is zero, its friction is undetermined between two limits: it is set to zero, the middle
of the two-sided limit where the motion reverses. At a jam all forces of the frame are NaN.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from mechcore.arrays import Flags, Plane, Real, Values
from mechcore.effects.base import Wrench, power_of, sum_up
from mechcore.effects.registry import wrenches
from mechcore.errors import Fault, MechanismError
from mechcore.forces.equilibrium import transmit
from mechcore.forces.friction.elements import Element, elements_of, two_sided
from mechcore.forces.friction.normal_loads import NormalLoads, has_several_solutions, jacobian, solve_normal_loads, stability
from mechcore.motion.at_once import indeterminate_parts
from mechcore.motion.motion import Motion
from mechcore.numerics.frames import lazy, plane_rows
from mechcore.records import dataclass
from mechcore.spec.mechanism import Revolute, friction_of, joints_with_friction

TransmittedForces = tuple[list[tuple[Plane, Values]], dict[str, tuple[Plane, Plane]], dict[int, Values]]
"""Force and couple on the second link of each joint, place and force of each relation, and multiplier of each relation: see
`transmit`."""

FLANK_ROUNDS = 8  # rounds in which the flanks of gears may change sides
LEAST_SHARE = 0.1  # part of the largest share in a jam: joints below it are not named
AT_ONCE = 400_000  # elements times frames that are solved in one call


def solve_friction(
    motion: Motion, force: Sequence[Plane], moment: Sequence[Values]
) -> tuple[list[tuple[Plane, Values]], dict[str, tuple[Plane, Plane]], FrictionResult]:
    """Forces that joints and relations transmit (as `mechcore.forces.equilibrium.transmit` gives them), and the friction.

    ``force`` and ``moment`` of each link are those of the loads. Raises `MechanismError` where statics leaves the normal load of a
    joint with friction undetermined.
    """
    check_friction(motion)
    flanks = transmit(motion, force, moment)[2] if two_sided(motion) else None
    elements = elements_of(motion, flanks)
    for _ in range(FLANK_ROUNDS):
        response = respond(motion, elements, force, moment, flanks)
        before = response.base[2] if flanks is None else flanks
        solution = solve_normal_loads(*system(motion, elements, response), motion.accuracy.friction)
        friction = FrictionResult(motion, elements, solution, response)
        own_force, own_moment = list(force), list(moment)
        for i, element in enumerate(elements):
            element.load(motion, own_force, own_moment, np.nan_to_num(friction.value(i)))
        transmitted, contacts, after = transmit(motion, own_force, own_moment, before)
        if all(np.all((after[r] < 0.0) == (before[r] < 0.0)) for r in after):
            break
        flanks = after
        elements = elements_of(motion, flanks) if two_sided(motion) else elements
    if friction.jammed.any():
        valid = np.where(friction.jammed, np.nan, 1.0)
        transmitted = [(f * valid, c * valid) for f, c in transmitted]
        contacts = {name: (place, f * valid) for name, (place, f) in contacts.items()}
    return transmitted, contacts, friction


def check_friction(motion: Motion) -> None:
    """Raise `MechanismError` for friction data that are invalid, as specs may be made without a scene, and where statics does not
    determine the normal load of a joint."""
    faults = []
    for joint in motion.mechanism.joints:
        f = friction_of(joint)
        if f is None:
            continue
        path = f"joints.{joint.name}.friction"
        for name in ("coefficient", "radius", "length", "height", "lever", "brake"):
            value = getattr(f, name)
            if not 0.0 <= value < np.inf:
                faults.append(Fault(path, f"{name} = {value:g} is no {name}.", "Give a finite number of zero or more."))
        if isinstance(joint, Revolute) and f.coefficient and f.radius == 0.0:
            faults.append(Fault(path, "the pin has no radius, at which friction acts.", "Give radius = ..., or no coefficient."))
    if faults:
        raise MechanismError(faults)
    _refuse_indeterminate(motion)


def _refuse_indeterminate(motion: Motion) -> None:
    """Raise `MechanismError` where redundant constraints leave the normal load of a joint with friction undetermined. The couple in
    a guide is no part of it, unless its bearing has a length."""
    if not motion.model.redundant:
        return
    joints = motion.mechanism.joints
    friction = dict(zip(joints_with_friction(joints), filter(None, map(friction_of, joints)), strict=True))
    loaded = [(p, what) for p, what in indeterminate_parts(motion) if (f := friction.get(p)) and (what != "couple" or f.length)]
    braked_joints = list(dict.fromkeys(p for p, _ in loaded))
    if braked_joints:
        names = ", ".join(braked_joints)
        why = f"constraints are redundant: statics does not determine the contact force at {names}, nor the friction there."
        remedy = "Leave out the friction of these joints, or the constraint that is left over."
        raise MechanismError([Fault(f"joints.{braked_joints[0]}.friction", why, remedy)])


@dataclass(frozen=True, eq=False)
class Response:
    """``base``: transmitted forces without friction. ``units``: for each element, those under its unit wrench alone."""

    base: TransmittedForces
    units: list[TransmittedForces]


def respond(
    motion: Motion,
    elements: Sequence[Element],
    force: Sequence[Plane],
    moment: Sequence[Values],
    flanks: Mapping[int, Values] | None = None,
) -> Response:
    """Solve the loads and a unit wrench at every element, with the same flanks in contact. ``force``, ``moment``: of each link."""
    base = transmit(motion, force, moment, flanks)
    flanks = base[2] if flanks is None else flanks
    links, n = len(motion.model.links), len(elements)
    at_once = max(1, AT_ONCE // max(motion.frames, 1))
    units: list[TransmittedForces] = []
    for start in range(0, n, at_once):
        some = elements[start : start + at_once]
        own_force: list[Plane] = [0j] * links
        own_moment: list[Values] = [0.0] * links
        for i, element in enumerate(some):
            one = np.zeros((len(some), 1))
            one[i] = 1.0
            element.load(motion, own_force, own_moment, one)
        together = transmit(motion, own_force, own_moment, flanks)
        units += picked(together, (len(some), motion.frames))
    return Response(base, units)


def picked(together: TransmittedForces, shape: tuple[int, int]) -> list[TransmittedForces]:
    """The transmitted forces of each element, from those that were computed side by side."""
    transmitted, contacts, multipliers = together

    def rows(values: Any) -> Any:
        return values if getattr(values, "shape", None) == shape else np.broadcast_to(values, shape)

    joints = [(rows(f), rows(c)) for f, c in transmitted]
    touching = {name: (place, rows(f)) for name, (place, f) in contacts.items()}
    factors = {r: rows(m) for r, m in multipliers.items()}
    return [
        (
            [(f[i], c[i]) for f, c in joints],
            {name: (place, f[i]) for name, (place, f) in touching.items()},
            {r: m[i] for r, m in factors.items()},
        )
        for i in range(shape[0])
    ]


def system(motion: Motion, elements: Sequence[Element], response: Response, sense: float = 1.0) -> tuple[Real, Real, Flags]:
    """``a`` (F, n, 2), ``K`` (F, n, 2, n) and the kinds of norm (n,) of the normal loads ``g = |a + K g|``.

    ``sense`` = -1: the same loads while everything moves backwards.
    """
    frames, n = motion.frames, len(elements)
    a, k = np.empty((n, 2, frames)), np.empty((n, 2, n, frames))  # frames last in memory, where numpy is fast
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for i, element in enumerate(elements):
            sign = sense * element.sign
            a[i, 0], a[i, 1] = element.normal(motion, *response.base[:2], sign)
            if element.kind == "brake":
                k[i] = 0.0
                continue
            for j, (source, unit) in enumerate(zip(elements, response.units, strict=True)):
                p, q = element.normal(motion, *unit[:2], sign)
                braking = -sense * source.sign * source.factor
                k[i, 0, j], k[i, 1, j] = braking * p, braking * q
    return np.moveaxis(a, -1, 0), np.moveaxis(k, -1, 0), np.array([e.euclidean for e in elements])


class FrictionResult:
    """Dry friction in the joints of a motion; results have a leading frame axis and are found by the joints' names.

    ``jammed`` (F,): no friction of this direction is in equilibrium with any drive effort; all forces of these frames are NaN.
    ``reached`` (F,): proportion of the stated coefficients up to which the mechanism can be moved, 1 where it does not jam.
    ``residual`` (F,): of the solved equations, relative. ``iterations``: most Newton steps of any frame.
    """

    def __init__(self, motion: Motion, elements: Sequence[Element], solution: NormalLoads, response: Response | None = None):
        self.motion = motion
        self.elements = tuple(elements)
        self.iterations = solution.iterations
        self.jammed = solution.jammed
        self.movable_share = solution.movable_share
        self.residual = solution.residual
        self._solution = solution
        if response is not None:
            self._response = response

    @lazy
    def _applied(self) -> tuple[Wrench, ...]:
        """All wrenches on the links but those of dry friction."""
        return tuple(wrenches(self.motion))

    @lazy
    def _response(self) -> Response:
        """The response, which a program that has solved the normal loads does not keep."""
        return respond(self.motion, self.elements, *sum_up(self._applied, len(self.motion.model.links)))

    @cached_property
    def stability(self) -> Real:
        """Distance from a jam (F,), dimensionless: det(I - D K), 1 without friction, 0 where the effort grows beyond all bounds,
        NaN at a jam."""
        return stability(*system(self.motion, self.elements, self._response), self._solution.loads)

    @cached_property
    def ambiguous(self) -> Flags:
        """Frames (F,) with further states of friction in equilibrium, beside the given one that is continuous with the frictionless
        state."""
        return has_several_solutions(*system(self.motion, self.elements, self._response), self._solution.loads)

    @property
    def loads(self) -> Real:
        """Normal loads (F, n) [N] of the elements."""
        return self._solution.loads

    @property
    def slopes(self) -> Real:
        """Derivatives (F, n, n), dimensionless, of the residuals of the equations of the normal loads by these loads."""
        return jacobian(*system(self.motion, self.elements, self._response), self._solution.loads)[1]

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that have friction."""
        return tuple(dict.fromkeys(e.joint for e in self.elements))

    # -- in the joints -------------------------------------------------------------------------------------------------
    def value(self, i: int) -> Real:
        """Force [N] or moment [N m] of element ``i`` along its unit wrench on the second link (F,); zero at rest."""
        e = self.elements[i]
        return -e.sign * e.factor * self._solution.loads[:, i]

    def normal_load(self, joint: str) -> Real:
        """Normal load of a joint (F,) [N]: |R| of a pin, |N| of a contact, |N1| + |N2| at the two ends of a bearing."""
        return np.array(self._solution.loads[:, self._elements_of(joint)[0]])

    def applied(self, joint: str) -> Real:
        """Share of friction in the force [N] and couple [N m] on the second link (F, 3), in addition to the reaction that the joint
        transmits."""
        return plane_rows(self.motion.shape, *self._applied_to(joint))

    def _applied_to(self, joint: str) -> tuple[Plane, Values]:
        force: Plane = 0j
        couple: Values = 0.0
        for i in self._elements_of(joint):
            e, value = self.elements[i], self.value(i)
            if e.what == "turn":
                couple = couple + value
            else:
                force = force + value * e.along
        for relation in self.motion.model.relations:  # couples carried by bearings of shafts in the plane
            for name, sign in relation.bearing.joints if relation.bearing is not None else ():
                if name == joint:
                    for i in self._elements_of(relation.name):
                        twist = self.elements[i].twist
                        assert twist is not None  # of a cam about an axis in the plane
                        couple = couple + sign * self.value(i) * twist
        return force, couple

    def wrench(self, joint: str) -> Real:
        """Friction on the joint's second link: Fx, Fy [N] and couple [N m], stated at the joint's position (F, 3)."""
        out = self.applied(joint)
        for i in self._elements_of(joint):
            e = self.elements[i]
            if e.kind == "guide" and e.friction.height:  # it acts on the two faces: N1 + N2 = N makes the couple
                n = e.normal(self.motion, self._transmitted[0], self._transmitted[1], e.sign)[0]
                out[:, 2] -= e.sign * e.coefficient * 0.5 * e.friction.height * n
        return out

    def state(self, joint: str) -> list[str]:
        """State of the joint at every frame: "slips +", "slips -" (the sign of its rate), "at rest" or "jammed"."""
        sign = self.elements[self._elements_of(joint)[0]].sign
        words = np.where(sign > 0, "slips +", np.where(sign < 0, "slips -", "at rest"))
        return list(np.where(self.jammed, "jammed", words))

    def jammed_by(self, frame: int) -> tuple[str, ...]:
        """The joints whose friction causes the jam at a frame, the strongest first."""
        share = self._solution.share[frame]
        order = [i for i in np.argsort(-share) if share[i] >= LEAST_SHARE]
        return tuple(dict.fromkeys(self.elements[i].joint for i in order))

    # -- power --------------------------------------------------------------------------------------------------------
    def losses(self, joint: str) -> Real:
        """Power that friction in a joint turns into heat (F,) [W], never negative."""
        return -sum((self.value(i) * self.elements[i].rate for i in self._elements_of(joint)), np.zeros(self.motion.frames))

    @cached_property
    def power(self) -> Real:
        """Power of all friction (F,) [W], never positive."""
        return -sum((self.losses(p) for p in self.joints), np.zeros(self.motion.frames))

    @cached_property
    def frictionless_power(self) -> Real:
        """Power that the drives would supply without friction (F,) [W]: that of the loads with the opposite sign."""
        return np.asarray(np.zeros(self.motion.frames) - sum(power_of(self.motion, w) for w in self._applied))

    # -- back-driving -------------------------------------------------------------------------------------------------
    @cached_property
    def back_driving_power(self) -> Real:
        """Power of all drives (F,) [W] while the loads drive: in this motion where they drive, in its reverse where they resist.

        Negative: the loads overcome the friction. Positive: even then the drives have to supply power. Infinite: it jams in that
        direction.
        """
        p0 = self.frictionless_power
        forward = p0 - self.power
        a, k, kinds = system(self.motion, self.elements, self._response, sense=-1.0)
        back = solve_normal_loads(a, k, kinds)
        lost = np.zeros(self.motion.frames)
        for i, e in enumerate(self.elements):
            lost = lost + e.factor * back.loads[:, i] * np.abs(e.rate)
        backward = np.where(back.jammed, np.inf, -p0 + lost)
        return np.where(p0 < 0.0, np.where(self.jammed, np.inf, forward), backward)

    @cached_property
    def self_locking(self) -> Flags:
        """Whether the loads cannot move the drives in either direction (F,): back-driving needs power from the drives."""
        p0 = np.abs(self.frictionless_power)
        driven = p0 > 1e-9 * np.max(p0, initial=0.0, where=np.isfinite(p0))  # elsewhere the loads push in neither direction
        with np.errstate(invalid="ignore"):
            return np.asarray(driven & (self.back_driving_excess > 0.0))

    @cached_property
    def back_driving_excess(self) -> Real:
        """Power that the drives need for the loads to move them (F,) [W], rounding added: positive where these cannot, and zero
        where they push in neither direction."""
        return np.asarray(self.back_driving_power + 1e-12 * np.abs(self.frictionless_power))

    # -- inside -------------------------------------------------------------------------------------------------------
    def _elements_of(self, joint: str) -> list[int]:
        return [i for i, e in enumerate(self.elements) if e.joint == joint]

    @cached_property
    def _transmitted(self) -> TransmittedForces:
        """Forces of the joints with friction, by superposition."""
        transmitted, contacts, multipliers = self._response.base
        values = [self.value(i) for i in range(len(self.elements))]
        with np.errstate(invalid="ignore"):
            joints = [
                (f + sum(v * u[0][j][0] for v, u in zip(values, self._response.units, strict=True)),
                 c + sum(v * u[0][j][1] for v, u in zip(values, self._response.units, strict=True)))
                for j, (f, c) in enumerate(transmitted)
            ]  # fmt: skip
        return joints, contacts, multipliers
