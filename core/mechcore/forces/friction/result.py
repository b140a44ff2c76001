"""Friction of a motion: what it does in every joint, what it costs, where the mechanism jams or locks itself."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.effects.base import Wrench, power_of
from mechcore.forces.friction.elements import Element
from mechcore.forces.friction.elements_response import Response, system
from mechcore.forces.friction.normal_loads import Solution, several, solve_normal_loads, stability
from mechcore.motion.motion import Motion

Array = Any

LEAST_SHARE = 0.1  # of the largest share in a jam: joints below it are not named


class FrictionResult:
    """Dry friction in the joints of a motion; results have a leading frame axis and go by the names of the joints.

    ``jammed`` (F,): no friction of this direction is in equilibrium with any drive effort; all forces of these frames are NaN.
    ``reached`` (F,): proportion of the stated coefficients up to which the mechanism can be moved, 1 where it does not jam.
    ``residual`` (F,): of the solved equations, relative. ``iterations``: most Newton steps of any frame.
    """

    def __init__(
        self, motion: Motion, applied: Sequence[Wrench], elements: Sequence[Element], response: Response, solution: Solution
    ):
        self.motion = motion
        self.elements = tuple(elements)
        self.iterations = solution.iterations
        self.jammed = solution.jammed
        self.reached = solution.reached
        self.residual = solution.residual
        self._applied = tuple(applied)
        self._response = response
        self._solution = solution

    @cached_property
    def stability(self) -> Real:
        """How far the friction is from a jam (F,): 1 without any, 0 where the effort grows beyond all bounds, NaN at a jam."""
        return stability(*system(self.motion, self.elements, self._response), self._solution.loads)

    @cached_property
    def ambiguous(self) -> Flags:
        """Frames (F,) with other friction in equilibrium than that which grows out of the frictionless state, which is given."""
        return several(*system(self.motion, self.elements, self._response), self._solution.loads)

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
        """Size of what presses on a joint (F,) [N]: |R| of a pin, |N| of a contact, |N1| + |N2| at the two ends of a bearing."""
        return np.array(self._solution.loads[:, self._elements_of(joint)[0]])

    def applied(self, joint: str) -> Real:
        """What friction adds to the force and couple on the second link that the joint transmits anyway (F, 3)."""
        out = np.zeros((self.motion.frames, 3))
        for i in self._elements_of(joint):
            e, value = self.elements[i], self.value(i)
            if e.what == "turn":
                out[:, 2] += value
            else:
                out[:, 0] += value * np.real(e.along)
                out[:, 1] += value * np.imag(e.along)
        for relation in self.motion.model.relations:  # what bearings of shafts in the plane carry
            for name, sign in relation.bearing.joints if relation.bearing is not None else ():
                if name == joint:
                    out[:, 2] += sign * sum(self.value(i) * self.elements[i].twist for i in self._elements_of(relation.name))
        return out

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
        """What the joint does at every frame: "slips +", "slips -" (the sign of its rate), "at rest" or "jammed"."""
        sign = self.elements[self._elements_of(joint)[0]].sign
        words = np.where(sign > 0, "slips +", np.where(sign < 0, "slips -", "at rest"))
        return list(np.where(self.jammed, "jammed", words))

    def jammed_by(self, frame: int) -> tuple[str, ...]:
        """The joints whose friction makes the jam at a frame, the strongest first."""
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
        """Power that the drives would put in without friction (F,) [W]: the loads' with the other sign."""
        return np.zeros(self.motion.frames) - sum(power_of(self.motion, w) for w in self._applied)

    @cached_property
    def efficiency(self) -> float:
        """Useful over supplied energy of the run: the loads' share where the drives drive, the drives' where the loads do.

        Zero where both only feed friction, NaN where the mechanism jams.
        """
        w0, loss = self._integral(self.frictionless_power), self._integral(-self.power)
        supplied, useful = (w0 + loss, w0) if w0 >= 0.0 else (-w0, -w0 - loss)
        useful = useful if useful > 1e-12 * supplied else 0.0  # over whole turns inertia and gravity leave nothing but rounding
        return useful / supplied if supplied > 0.0 else (1.0 if supplied == 0.0 else np.nan)

    def mean_losses(self) -> dict[str, float]:
        """Mean power that friction takes in each joint over the run [W]."""
        span = float(np.ptp(self.motion.time)) or 1.0
        return {p: self._integral(self.losses(p)) / span for p in self.joints}

    # -- the other way round ------------------------------------------------------------------------------------------
    @cached_property
    def back_driving_power(self) -> Real:
        """Power of all drives (F,) [W] while the loads drive: of this motion where they do, of its reverse where they resist.

        Negative: the loads overcome the friction. Positive: even then the drives have to help. Infinite: it jams that way.
        """
        p0 = self.frictionless_power
        forward = p0 - self.power
        a, k, kinds = system(self.motion, self.elements, self._response, way=-1.0)
        back = solve_normal_loads(a, k, kinds)
        lost = np.zeros(self.motion.frames)
        for i, e in enumerate(self.elements):
            lost = lost + e.factor * back.loads[:, i] * np.abs(e.rate)
        backward = np.where(back.jammed, np.inf, -p0 + lost)
        return np.where(p0 < 0.0, np.where(self.jammed, np.inf, forward), backward)

    @cached_property
    def self_locking(self) -> Flags:
        """Whether the loads cannot move the drives, whichever way they push (F,): back-driving needs power from the drives."""
        p0 = np.abs(self.frictionless_power)
        driven = p0 > 1e-9 * np.max(p0, initial=0.0, where=np.isfinite(p0))  # else the loads push neither way
        with np.errstate(invalid="ignore"):
            return np.asarray(driven & (self.back_driving_power >= -1e-12 * p0))

    # -- inside -------------------------------------------------------------------------------------------------------
    def _elements_of(self, joint: str) -> list[int]:
        found = [i for i, e in enumerate(self.elements) if e.joint == joint]
        return found

    def _integral(self, p: Real) -> float:
        return float(np.trapezoid(p, self.motion.time)) if len(p) > 1 else float(p[0])

    @cached_property
    def _transmitted(self) -> Any:
        """What the joints transmit with friction, by superposition."""
        transmitted, contacts, multipliers = self._response.base
        values = [self.value(i) for i in range(len(self.elements))]
        with np.errstate(invalid="ignore"):
            joints = [
                (f + sum(v * u[0][j][0] for v, u in zip(values, self._response.units, strict=True)),
                 c + sum(v * u[0][j][1] for v, u in zip(values, self._response.units, strict=True)))
                for j, (f, c) in enumerate(transmitted)
            ]  # fmt: skip
        return joints, contacts, multipliers
