"""Kinetostatics: all joint reactions and the drives' torques or forces that a given motion needs.

Dry friction, where a scene names it, is one more load that depends on the result (`mechcore.forces.friction.solve`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import cast

import numpy as np

from mechcore.arrays import Index, Plane, Real, Values
from mechcore.effects.base import LOSSES, Wrench, power_of, sum_up, wrench_point
from mechcore.effects.masses import kinetic_energy
from mechcore.effects.registry import applied_effects, potential, totals, wrenches
from mechcore.errors import Fault, MechanismError
from mechcore.forces import equilibrium
from mechcore.forces.friction.solve import FrictionResult, solve_friction
from mechcore.forces.program import forces_program, rubbing_forces
from mechcore.kinematics.dyads import cross
from mechcore.motion.motion import Motion
from mechcore.numerics.frames import PLAIN, added, lazy, plane_rows, stacked, subtracted
from mechcore.numerics.interpolation import integral_so_far
from mechcore.numerics.tape import Traced
from mechcore.numerics.tape_functions import integral
from mechcore.records import dataclass
from mechcore.spec.mechanism import Mechanism, joints_with_friction


@dataclass(frozen=True, eq=False)
class LoadResult:
    """An external load: ``values`` (F, 5) are Fx, Fy [N], free moment [N m], point of action x, y [m] (world).

    They act on the first of ``links``; on the second, where there is one, the opposite acts at the same point. ``rows`` computes
    them at every access.
    """

    name: str
    kind: str
    cause: str
    links: tuple[str, ...]
    rows: Callable[[], Real]

    @property
    def values(self) -> Real:
        return self.rows()

    @property
    def link(self) -> str:
        """The link that the stated load acts on."""
        return self.links[0]


class Forces:
    """Reactions, drive efforts, loads and energies of a motion; results have a leading frame axis and are found by name."""

    def __init__(
        self,
        motion: Motion,
        applied: Sequence[Wrench] | Callable[[], Sequence[Wrench]],
        transmitted: list[tuple[Plane, Values]],
        contacts: dict[str, tuple[Plane, Plane]],
        friction: FrictionResult | None = None,
    ):
        self.motion = motion
        self.friction = friction  # None where the scene does not name it
        self._applied = applied
        self._transmitted = transmitted  # of each joint: force and couple on its second link, drive included
        self._contacts = contacts  # of each relation: point of action, and force on its second link
        self._shape = motion.shape

    # of a motion under forces: times (n, 2) [s] up to a given one, just before and after every jump; of every impact its time
    # [s], the energy lost, and the work of prescribed drives in it [J]
    jumps: Callable[[float], Real] | None = None
    impacts: tuple[tuple[float, float, float], ...] = ()

    def at_times(self, t: Real) -> Forces:
        """The forces at other times (n,) [s], of a motion that has `at_times`."""
        assert self.motion.at_times is not None
        return solve_forces(self.motion.at_times(t))

    @property
    def parts(self) -> Sequence[tuple[Index, Forces]]:
        """The frames and the forces of every part of the motion, see `Motion.parts`."""
        return ((np.arange(self.motion.frames), self),)

    @lazy
    def applied(self) -> tuple[Wrench, ...]:
        """All wrenches on the links but those of dry friction."""
        return tuple(self._applied() if callable(self._applied) else self._applied)

    # -- results by name ----------------------------------------------------------------------------------------------
    def reaction(self, joint: str) -> Real:
        """Fx, Fy [N] on the joint's second link at `position`, and couple [N m], friction included, without the drive (F, 3)."""
        rows = self.normal_reaction(joint)
        return rows if self.friction is None else rows + self.friction.applied(joint)

    def normal_reaction(self, joint: str) -> Real:
        """The reaction of a joint without the share of friction: Fx, Fy [N], couple [N m] (F, 3)."""
        if joint in self._contacts:
            force: Plane = self._contacts[joint][1]
            if (
                joint in self.motion.model.joint_index
            ):  # rolling: the normal force passes through the wheel's centre and the contact
                force = force + self._transmitted[self._joint(joint)][0] - self._drive(self._joint(joint))[0]
            return plane_rows(self._shape, force, 0.0)
        model = self.motion.model
        j = model.joint_index[joint]
        force, couple = self._transmitted[j]
        if j not in model.driven:
            return plane_rows(self._shape, force, added(couple, self._carried(joint)) if model.relations else couple)
        if model.joints[j].coordinate == "angle":  # the drive is the whole couple
            return plane_rows(self._shape, force, self._carried(joint) if model.relations else 0.0)
        drive_force, drive_moment = self._drive(j)
        return plane_rows(self._shape, subtracted(force, drive_force), subtracted(couple, drive_moment))

    def position(self, joint: str) -> Real:
        """Point at which the reaction of a joint is stated (F, 2) [m]: the pin, the sliding point, the pitch point, the contact."""
        if joint in self._contacts:
            return plane_rows(self._shape, self._contacts[joint][0], 0.0)[:, :2]
        return self.motion.joint_position(joint)

    def wrench(self, joint: str) -> Real:
        """Wrench of a drive on the joint's second link: Fx, Fy [N], moment [N m] at the joint's position (F, 3)."""
        j = self._joint(joint)
        force, moment = self._drive(j)
        if joint in self._contacts:  # a driven wheel: the force acts at its centre, the joint's position is the contact
            moment = moment + cross(self.motion.joint_point(j) - self._contacts[joint][0], force)
        return plane_rows(self._shape, force, moment)

    def effort(self, joint: str) -> Real:
        """Driving torque [N m] or force [N] along the guide in the direction of the drive's coordinate (F,)."""
        j = self.motion.model.joint_index.get(joint)
        if j is None or j not in self.motion.model.driven:
            raise undriven(self.motion.mechanism, joint)
        return self._over_frames(self._effort(j))

    def power(self, joint: str) -> Real:
        """Power that a drive puts into the mechanism (F,) [W]."""
        return self.effort(joint) * self.motion.drives[self.motion.model.driven[self._joint(joint)]][1]

    def inertia(self, link: str) -> Real:
        """Inertia force Fx, Fy [N] and moment about the centre of mass [N m] (F, 3); zero where inertia is not among the
        effects."""
        k = self.motion.model.index[link]
        for w in self.applied:
            if w.kind == "inertia" and w.link == k:
                return plane_rows(self._shape, w.force, w.moment)
        return np.zeros((self.motion.frames, 3))

    @cached_property
    def loads(self) -> dict[str, LoadResult]:
        """All loads but inertia, by name (gravity of a link: ``gravity/<link>``)."""
        return {
            w.name: LoadResult(
                name=w.name,
                kind=w.kind,
                cause=w.cause,
                links=tuple(self.motion.model.links[k] for k in w.links),
                rows=partial(self._load, w),
            )
            for w in self.applied
            if w.kind != "inertia"
        }

    def _load(self, w: Wrench) -> Real:
        place = wrench_point(self.motion, w)
        return stacked([w.force.real, w.force.imag, w.moment, place.real, place.imag], self._shape)

    # -- energy -------------------------------------------------------------------------------------------------------
    @cached_property
    def power_supplied(self) -> Real:
        """Power of all drives (F,) [W]."""
        names = [d.joint for d in self.motion.mechanism.drives]
        return sum((self.power(p) for p in names), np.zeros(self.motion.frames))

    def powers(self) -> list[tuple[Wrench, Real]]:
        """All loads and inertia forces, each with its power (F,) [W]."""
        return [(w, self._over_frames(power_of(self.motion, w))) for w in self.applied]

    def power_by_cause(self, causes: Sequence[str]) -> Real:
        """Power of the loads and effects of some causes (F,) [W]."""
        powers = [power_of(self.motion, w) for w in self.applied if w.cause in causes]
        power = self._over_frames(sum(powers, 0.0)) if powers else np.zeros(self.motion.frames)
        return power if self.friction is None or "dry friction" not in causes else power + self.friction.power

    @cached_property
    def power_balance(self) -> Real:
        """Power supplied plus power of all loads and inertia, relative to the largest single power of the run (F,)."""
        total, largest = self.power_residual
        return total / largest if largest > 0 else total

    @cached_property
    def power_residual(self) -> tuple[Real, float]:
        """Power supplied plus power of all loads and inertia (F,) [W], and the largest single power of the run."""
        m = self.motion
        parts = [self.power(d.joint) for d in m.mechanism.drives]
        parts += [self._over_frames(power_of(m, w)) for w in self.applied]
        if self.friction is not None:
            parts.append(self.friction.power)
        largest = max((float(np.nanmax(np.abs(p), initial=0.0)) for p in parts), default=0.0)
        total = sum(parts, np.zeros(m.frames))
        if float(np.nanmax(np.abs(total), initial=0.0)) > 1e-9 * largest:
            # forces always at right angles to the motion, or on links that stand still: the powers are rounding of |F| |v|
            # in all the joints that the forces pass through
            pace = max((float(np.nanmax(np.abs(v), initial=0.0)) for v in m.origin_velocities), default=0.0)
            pace = max([pace, *(m.model.length_scale * float(np.nanmax(np.abs(w), initial=0.0)) for w in m.speeds.angular)])
            pushes = (float(np.nanmax(np.abs(w.force), initial=0.0)) for w in self.applied)
            twists = (float(np.nanmax(np.abs(w.moment), initial=0.0)) / m.model.length_scale for w in self.applied)
            largest = max(largest, 1e-6 * pace * max([*pushes, *twists], default=0.0))
        return total, largest

    @cached_property
    def kinetic_energy(self) -> Real:
        """Kinetic energy of all links (F,) [J]; zero where inertia is not among the effects."""
        return kinetic_energy(self.motion) if "inertia" in self.motion.mechanism.effects else np.zeros(self.motion.frames)

    @cached_property
    def potential_energy(self) -> Real:
        """Potential energy of gravity (zero at the world's origin), springs and gas springs, where there are any (F,) [J]."""
        return self._over_frames(potential(self.motion))

    @cached_property
    def work(self) -> Real:
        """Work done on the mechanism so far by drives and process loads (F,) [J], by Simpson's rule over the frames."""
        return self._integral(self.power_supplied + self.power_by_cause(["process"]))

    @cached_property
    def dissipated(self) -> Real:
        """Energy dissipated so far by dampers, media and friction (F,) [J], by Simpson's rule; NaN from where it jams."""
        if self.friction is None and not any(w.cause in LOSSES for w in self.applied):
            return np.zeros(self.motion.frames)
        return self._integral(-self.power_by_cause(LOSSES))

    def _integral(self, p: Real) -> Real:
        """Integral over time so far (F,), by Simpson's rule; NaN from the first frame where ``p`` is not finite."""
        if isinstance(p, Traced) or isinstance(self.motion.time, Traced):
            return cast("Real", integral(p, self.motion.time))
        known = len(p) if np.isfinite(p).all() else int(np.argmax(~np.isfinite(p)))
        out = np.full(len(p), np.nan)
        out[:known] = integral_so_far(p[:known], self.motion.time[:known])
        return out

    @cached_property
    def energy(self) -> Real:
        """Kinetic, potential, work done so far, dissipated so far (F, 4) [J]."""
        return np.column_stack([self.kinetic_energy, self.potential_energy, self.work, self.dissipated])

    # -- inside -------------------------------------------------------------------------------------------------------
    def _carried(self, joint: str) -> Values:
        """Couple on the second link that the bearings of a shaft in the plane carry."""
        total: Values = 0.0
        for relation in self.motion.model.relations:
            if relation.bearing is not None:
                for name, sign in relation.bearing.joints:
                    if name == joint:
                        total = total + sign * relation.bearing.couple(self.motion, *self._contacts[relation.name])
        return total

    def _joint(self, joint: str) -> int:
        return self.motion.model.joint_index[joint]

    def _effort(self, j: int) -> Values:
        force, couple = self._transmitted[j]
        joint = self.motion.model.joints[j]
        if joint.coordinate == "angle":
            return couple
        # the coordinate grows as the link without the guide moves along it: the second if the first has the guide
        along: Values = (np.conj(self.motion.guide(j)) * force).real
        return along if joint.guide == 0 else -along

    def _drive(self, j: int) -> tuple[Plane, Values]:
        if j not in self.motion.model.driven:
            return 0j, 0.0
        joint = self.motion.model.joints[j]
        effort = self._effort(j)
        if joint.coordinate == "angle":
            return 0j, effort
        return effort * self.motion.guide(j) * (1.0 if joint.guide == 0 else -1.0), 0.0

    def _over_frames(self, value: Values) -> Real:
        if not isinstance(value, PLAIN):
            same: Real = np.broadcast_to(value, self._shape)
            return same
        out = np.empty(self._shape)
        out[...] = value
        return out


def undriven(mechanism: Mechanism, joint: str) -> MechanismError:
    """The error of a request for the effort of a joint without a drive."""
    drives = ", ".join(d.joint for d in mechanism.drives)
    return MechanismError(Fault(f"joints.{joint}", "it has no drive.", f"Drives: {drives}." if drives else "Nothing drives it."))


def solve_forces(motion: Motion) -> Forces:
    """Joint reactions and drive efforts that the motion needs under the mechanism's effects and loads."""
    model = motion.model
    for effect in model.cached(applied_effects):
        if effect.limited:
            effect.check(motion)
    if motion.compiled:
        program = forces_program(model, exact=motion.angles.exact)
        computed = None if isinstance(program, str) else program(motion)
        if computed is not None:
            return Forces(motion, partial(wrenches, motion), *computed)
    if "friction" in model.mechanism.effects and joints_with_friction(model.mechanism.joints):
        if motion.peak is not None:
            force, moment, formed = totals(motion)
            return Forces(motion, formed, *rubbing_forces(motion, force, moment))
        applied = wrenches(motion)
        return Forces(motion, applied, *solve_friction(motion, *sum_up(applied, len(model.links))))
    force, moment, formed = totals(motion)
    divides = model.relations or model.needs_global_solve  # elsewhere no division could warn
    balance = equilibrium.transmit if divides else equilibrium.joint_forces
    return Forces(motion, formed, *balance(motion, force, moment)[:2])


LABELS = {"inertia": "F_i ", "gravity": "G_"}  # in drawings: text after _ is a subscript


@dataclass(frozen=True, eq=False)
class LinkLoad:
    """A load as it acts on one link: ``force`` (complex) [N] at ``place`` (complex, world) [m], free ``moment`` [N m]."""

    name: str
    label: str  # short, for drawings
    kind: str
    force: Plane
    moment: Values
    place: Plane


def loads_on(forces: Forces, link: int) -> list[LinkLoad]:
    """All loads on a link, inertia and gravity included; of loads between two links the part that acts on this one."""
    motion = forces.motion
    out = []
    for w in forces.applied:
        for k, arm, sign in ((w.link, w.arm, 1.0), (w.other, w.other_arm, -1.0)):
            if k == link:
                label = f"{LABELS[w.kind]}{motion.model.links[link]}" if w.kind in LABELS else w.name
                out.append(LinkLoad(w.name, label, w.kind, sign * w.force, sign * w.moment, motion.origins[k] + arm))
    return out
