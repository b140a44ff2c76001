"""Dry friction in forward dynamics: accelerations, normal loads and friction that depend on each other, solved together.

While the signs of the relative speeds stay, friction at element i is lambda_i = -sign_i factor_i g_i with the normal load
g_i = |a_i + K_i g|, as in kinetostatics (`solve`). Here, however, friction accelerates the free coordinates: a unit of friction
comes with the inertia forces of the acceleration that it causes, and so needs no drive. An element that sticks has no relative
acceleration; the friction that this takes is linear in the friction of the others and is eliminated. It sticks as long as this
friction is within its limit: the law is set-valued, nothing is smoothed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mechcore.arrays import Flags, Index, Plane, Real, Values
from mechcore.dynamics.equations.charts import differences, jacobian_of
from mechcore.dynamics.equations.contacts import ContactProgram, FrictionValues, add_inertia, contact_program
from mechcore.dynamics.equations.reduced import (
    constrained,
    free_of,
    moving,
    reduced_equations,
    steps_of_differences,
    with_rates,
    with_states,
)
from mechcore.effects.base import Wrench, sum_up
from mechcore.effects.registry import wrenches
from mechcore.errors import Fault, MechanismError
from mechcore.forces.equilibrium import transmit
from mechcore.forces.friction.elements import Element, elements_of, relative_rate, scales_of
from mechcore.forces.friction.normal_loads import solve_normal_loads
from mechcore.forces.friction.solve import FLANK_ROUNDS, FrictionResult, Response, TransmittedForces, picked, system
from mechcore.forces.kinetostatics import Forces
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.records import dataclass


@dataclass(frozen=True, eq=False)
class Dry:
    """Friction of a state: accelerations (n, f + s), see `with_states`; friction ``value``, the ``limit`` up to which it sticks,
    relative ``rate`` and ``second`` rate of every element (n, e)."""

    acceleration: Real
    value: Real
    limit: Real
    rate: Real
    second: Real


class GivenFriction(FrictionResult):
    """Friction of a motion found by forward dynamics, sticking included: ``values`` (F, e) along the elements' unit wrenches."""

    def __init__(
        self, motion: Motion, applied: Sequence[Wrench], elements: Sequence[Element], solution: Dry, passed: TransmittedForces
    ):
        self.motion = motion
        self.stability = np.ones(motion.frames)
        self.elements = tuple(elements)
        self.jammed = np.zeros(motion.frames, bool)
        self.movable_share = np.ones(motion.frames)
        self._applied = tuple(applied)
        self._dry = solution
        self._passed = passed  # what joints and relations transmit

    @property
    def _transmitted(self) -> TransmittedForces:
        return self._passed

    def value(self, i: int) -> Real:
        return self._dry.value[:, i]

    def normal_load(self, joint: str) -> Real:
        i = self._elements_of(joint)[0]
        e = self.elements[i]
        return np.asarray(self._dry.limit[:, i] / e.limit if e.limit else np.full(self.motion.frames, np.nan))

    def losses(self, joint: str) -> Real:
        return -sum((self.value(i) * self._dry.rate[:, i] for i in self._elements_of(joint)), np.zeros(self.motion.frames))


def forces_with(motion: Motion, system: DrySystem, q: Real, v: Real, held: Sequence[Wrench] = ()) -> Forces:
    """Reactions of a segment of motion with its friction, sticking included; ``held``: loads of end stops."""
    friction = system.solve(q, v, motion.time)
    applied = (*wrenches(motion), *held)
    force, moment = sum_up(list(applied), len(motion.model.links))
    elements = [replace(e, sign=np.full(motion.frames, s)) for e, s in zip(elements_of(motion), system.signs, strict=True)]
    for i, e in enumerate(elements):
        e.load(motion, force, moment, friction.value[:, i])
    passed = transmit(motion, force, moment)
    return Forces(motion, applied, *passed[:2], GivenFriction(motion, applied, elements, friction, passed))


class DrySystem:
    """Accelerations (n, f) with friction: ``signs`` (e,) of the elements' relative speeds, 0 where they stick.

    ``breaking``: with the coefficients of sticking everywhere, to test whether an element comes loose. ``rests``: joints that keep
    their coordinates, because they rest on end stops; where a stop or friction could hold them, the stop does.
    """

    def __init__(self, compiled: Compiled, signs: Real, *, breaking: bool = False, rests: Sequence[str] = ()):
        self.compiled = compiled
        self.signs = signs
        self.breaking = breaking
        self.rests = tuple(rests)

    def program(self, *, long: bool = False) -> ContactProgram | None:
        """The compiled program where one is wanted, else None."""
        program = contact_program(self.compiled, self.rests, long=long)
        return None if program is None else program.with_signs(self.signs, breaking=self.breaking)

    def _compiled_state(self, q: Real, v: Real, t: Real) -> FrictionValues | None:
        """Values of a compiled program at states; None where there is none that covers all states."""
        program = self.program()
        return None if program is None or not program.everywhere else program.friction_state(q, v, t)

    def rates(self, q: Real, v: Real, t: Real) -> Real:
        """Relative rates of all elements (n, e)."""
        state = self._compiled_state(q, v, t)
        if state is not None:
            return state.rate
        return np.stack([e.rate for e in elements_of(moving(self.compiled, q, v, t)[0])], axis=1)

    def holding(self, q: Real, v: Real, t: Real) -> Real:
        """Efforts that keep the joints at rest (n, p): torque [N m] or force [N] in the direction of each one's coordinate."""
        state = self._compiled_state(q, v, t)
        if state is not None and state.solved:
            return state.holding
        motion, units = moving(self.compiled, q, v, t)
        r, friction = reduced_equations(motion, units), self.solve(q, v, t)
        tau = np.stack([rates_of(units, e) for e in elements_of(motion)], axis=1)
        missing = (
            (r.inertia @ friction.acceleration[:, : len(units), None])[..., 0]
            + r.bias
            - r.force
            - np.einsum("nef,ne->nf", tau, friction.value)
        )
        rows, _ = jacobian_of(motion, units, self.rests)
        return np.asarray(np.linalg.solve(rows @ rows.swapaxes(1, 2), rows @ missing[..., None])[..., 0])

    def __call__(self, q: Real, v: Real, t: Real) -> Real:
        return self.solve(q, v, t).acceleration

    def slopes(self, q: Real, v: Real, t: Real, a: Real) -> tuple[Real, Real]:
        """Derivatives of the accelerations by position and speed (n, f, f) each."""
        return differences(self, q, v, t, a, steps_of_differences(self.compiled, q, v, a))

    def solve(self, q: Real, v: Real, t: Real) -> Dry:
        """Accelerations and friction. Raises `MechanismError` where no acceleration is in balance with the friction it causes."""
        state = self._compiled_state(q, v, t)
        if state is not None and state.solved:
            return Dry(*state[:5])
        motion, units = moving(self.compiled, q, v, t)
        n = motion.frames
        r = reduced_equations(motion, units)
        rows, rest = jacobian_of(motion, units, self.rests)
        first, _ = constrained(r.inertia, r.force - r.bias, rows, rest)
        second = [d[2] for d in motion.drives]
        for place, i in enumerate(free_of(self.compiled)):
            second[i] = first[:, place]
        loaded = with_rates(motion, [d[1] for d in motion.drives], second)
        elements = [replace(e, sign=np.full(n, s)) for e, s in zip(elements_of(loaded), self.signs, strict=True)]
        if self.breaking:
            elements = [replace(e, factor=e.limit) for e in elements]
        tau = np.stack([rates_of(units, e) for e in elements], axis=1)  # (n, e, f): relative rate per unit rate of a coordinate
        responses, _ = constrained(r.inertia[:, None], tau, rows)  # (n, e, f): acceleration per unit of friction
        bias = np.stack([relative_rate(loaded, loaded.accelerations, e.what, e.index, e.links) for e in elements], axis=1)
        rate = np.stack([e.rate for e in elements], axis=1)
        braking = np.stack([-s * e.factor * np.ones(n) for s, e in zip(self.signs, elements, strict=True)], axis=1)
        coupling = np.einsum("nif,njf->nij", tau, responses)  # relative acceleration at i per unit of friction at j
        flanks: dict[int, Values] | None = None
        for _ in range(FLANK_ROUNDS):
            response = _respond(loaded, units, elements, responses, flanks)
            value, parts, norms = self._balanced(loaded, elements, response, braking, bias, coupling)
            before, flanks = response.base[2] if flanks is None else flanks, _carried(response, value)
            if all(np.all((flanks[r] < 0.0) == (before[r] < 0.0)) for r in flanks):
                break
        size = np.where(norms, np.hypot(parts[..., 0], parts[..., 1]), np.abs(parts).max(axis=2))
        limit = size * np.array([e.limit for e in elements])
        acceleration = with_states(first + np.einsum("njf,nj->nf", responses, value), motion)
        return Dry(acceleration, value, limit, rate, bias + np.einsum("nij,nj->ni", coupling, value))

    def _balanced(
        self, motion: Motion, elements: Sequence[Element], response: Response, braking: Real, bias: Real, coupling: Real
    ) -> tuple[Real, Real, Flags]:
        """Friction ``value`` (n, e) that is in balance with the accelerations that it causes, the two numbers (n, e, 2) of every
        normal load and which of these loads are Euclidean (e,)."""
        stuck, slide = np.flatnonzero(self.signs == 0.0), np.flatnonzero(self.signs != 0.0)
        n = motion.frames
        # columns of unit friction where it sticks, of minus sign times factor times normal load where it slides
        plain = [
            replace(e, sign=np.full(n, -1.0), factor=1.0) if s == 0.0 else e for e, s in zip(elements, self.signs, strict=True)
        ]
        a, k, norms = system(motion, plain, response)
        value = np.zeros((n, len(elements)))
        if len(stuck):
            inner = coupling[:, stuck[:, None], stuck]
            need = least_efforts(inner, scales_of(motion.model, elements)[stuck])
            alpha = -np.einsum("nij,nj->ni", need, bias[:, stuck])
            beta = -np.einsum("nij,njk->nik", need, coupling[:, stuck[:, None], slide] * braking[:, None, slide])
            sub_a = a[:, slide] + np.einsum("nixs,ns->nix", k[:, slide][..., stuck], alpha)
            sub_k = k[:, slide][..., slide] + np.einsum("nixs,nsj->nixj", k[:, slide][..., stuck], beta)
        else:
            sub_a, sub_k = a, k
        if len(slide):
            solution = solve_normal_loads(sub_a, sub_k, norms[slide])
            if solution.jammed.any():
                self._refuse(elements, slide, solution.share[solution.jammed][0], float(motion.time[np.argmax(solution.jammed)]))
            value[:, slide] = braking[:, slide] * solution.loads
        if len(stuck):
            value[:, stuck] = alpha + np.einsum("nij,nj->ni", beta, solution.loads) if len(slide) else alpha
        parts = a + np.einsum(
            "nixj,nj->nix",
            k,
            np.where(self.signs == 0.0, value, np.divide(value, braking, where=braking != 0, out=np.zeros_like(value))),
        )
        return value, parts, norms

    def _refuse(self, elements: Sequence[Element], slide: Index, share: Real, t: float) -> None:
        worst = elements[slide[int(np.argmax(share))]]
        raise MechanismError(
            Fault(
                f"joints.{worst.joint}.friction",
                f"at t = {t:.6g} s no acceleration is in balance with the friction that it causes (it jams in motion, Painleve).",
                "Lower the coefficient, or lengthen the bearing.",
            )
        )


def least_efforts(coupling: Real, scale: Real) -> Real:
    """Efforts (..., e, e) at elements of scales (e,) per relative acceleration of each, the inverse of the ``coupling`` (..., e,
    e). Where they are not determined they are the least ones, a torque counted as a force at the length scale."""
    both = scale[:, None] * scale
    return np.asarray(np.linalg.pinv(coupling / both, rcond=1e-10, hermitian=True) / both)


def rates_of(units: Sequence[Motion], e: Element) -> Real:
    """Rate of an element per unit rate of every free coordinate (n, f); ``units``: the tangents."""
    return np.stack([relative_rate(u, u.speeds, e.what, e.index, e.links) for u in units], axis=-1)


def _respond(
    motion: Motion,
    units: Sequence[Motion],
    elements: Sequence[Element],
    responses: Real,
    flanks: Mapping[int, Values] | None = None,
) -> Response:
    """Transmitted forces under all loads and inertia, and under unit friction with the inertia forces of the accelerations that it
    causes. ``flanks``: multipliers whose signs select those that carry; without it they are those without friction."""
    model, n, e = motion.model, motion.frames, len(elements)
    base = transmit(motion, *sum_up(wrenches(motion), len(model.links)), flanks)
    force: list[Plane] = [0j] * len(model.links)
    moment: list[Values] = [0.0] * len(model.links)
    for i, element in enumerate(elements):
        one = np.zeros((e, 1))
        one[i] = 1.0
        element.load(motion, force, moment, one)
    add_inertia(motion, units, list(responses.T), force, moment)
    together = transmit(motion, force, moment, base[2] if flanks is None else flanks)
    return Response(base, picked(together, (e, n)))


def _carried(response: Response, value: Real) -> dict[int, Values]:
    """Multipliers of all relations (n,) with friction of ``value`` (n, e)."""
    return {
        r: multiplier + sum(x * unit[2][r] for x, unit in zip(value.T, response.units, strict=True))
        for r, multiplier in response.base[2].items()
    }
