"""Phases of a motion under forces, and the changes of the motion with parameters (sensitivities) within a phase.

In a phase the same equations hold: the efforts at the free coordinates are zero, joints that rest on stops or stick have no
relative acceleration, and normal loads satisfy the equations of friction. The tape gives the derivatives of these residuals by
positions, speeds, accelerations, the efforts of stops and friction, and the parameters. The changes of the motion therefore obey
linear differential equations with known coefficients, the variational equations. They are solved by collocation at Gauss nodes in
the windows of the motion itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from mechcore.arrays import Index, Real
from mechcore.derivatives.exact import Derivatives
from mechcore.derivatives.friction import TracedFriction
from mechcore.derivatives.model_numbers import Parameter, refusal
from mechcore.dynamics.contact.dry_friction import Dry, DrySystem
from mechcore.dynamics.equations.charts import Chart, with_named_drive
from mechcore.dynamics.equations.curve import CurveEquations
from mechcore.dynamics.equations.reduced import coordinate_scales, free_of, integrating, motion_at
from mechcore.dynamics.integration.collocation import gauss, integrals
from mechcore.dynamics.integration.windows import Solution
from mechcore.dynamics.segments import STOP_CAUSE, MotionSegment, stop_load
from mechcore.effects.base import LOSSES, joint_wrench, sum_up
from mechcore.effects.registry import applied_effects, totals
from mechcore.forces.equilibrium import joint_forces
from mechcore.forces.friction.elements import Element, elements_of, relative_rate
from mechcore.forces.kinetostatics import Forces
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled
from mechcore.records import dataclass
from mechcore.spec.mechanism import Drive, Mechanism

WINDOW_NODES = 16  # collocation nodes of a window
AT_ONCE = 4096  # nodes on one tape
MOST_HALVINGS = 4  # halvings of windows in which the changes are not smooth
CHANGE_TAIL = 1e-10  # size of the last coefficients of a change, relative to the change, up to which it is smooth
UNRESOLVED_TAIL = 1e-6  # relative size of these coefficients from which on derivatives are refused
NO_CHANGE = 1e-9  # negligible change over the width of a parameter, relative to the scales of a coordinate and its speed
DEPENDENT_EFFORTS = 1e-11  # singular value, relative to the largest, below which efforts of sticking joints are dependent
SWEEP_INSTEAD = "Sweep the parameter instead."


@dataclass(frozen=True, eq=False)
class SmoothPhase:
    """A part of a motion under forces, from ``start`` to ``end`` [s], in which one smooth system of equations holds. ``edges``
    (W + 1,): of its windows; ``parameters``: those of its own mechanism."""

    segment: MotionSegment
    edges: Real
    parameters: tuple[Parameter, ...]

    @property
    def start(self) -> float:
        return float(self.edges[0])

    @property
    def end(self) -> float:
        return float(self.edges[-1])

    @property
    def compiled(self) -> Compiled:
        return self.segment.compiled

    @property
    def free(self) -> list[str]:
        """Joints of its free coordinates."""
        return self.segment.independent

    @property
    def scales(self) -> Real:
        """Scales (f + s,) of the free coordinates; 1 for states of effects that integrate, whose scales are unknown."""
        return np.append(coordinate_scales(self.compiled), np.ones(len(integrating(self.compiled))))

    def state(self, t: Real) -> tuple[Real, Real, Real]:
        """Positions, speeds, accelerations (n, f + s) of the free coordinates at times (n,), states as in `with_states`."""
        q, v, _ = self.segment.solution(t)
        system = self.segment.system
        return q, v, (Chart(self.compiled) if isinstance(system, CurveEquations) else system)(q, v, t)

    def nodes(self, *, last: bool) -> Real:
        """Gauss nodes (NODES,) of its last window, or of its first."""
        start, end = self.edges[-2:] if last else self.edges[:2]
        return np.asarray(start + (end - start) * gauss(WINDOW_NODES).nodes)

    def at_edge(self, values: Real, *, last: bool) -> Real:
        """A number at the end of the phase, or just after its start, extrapolated from its values (NODES, ...) at `nodes`, as laws
        jump at the edges."""
        coefficients = np.tensordot(gauss(WINDOW_NODES).legendre, values, 1)
        signs = np.ones(WINDOW_NODES) if last else (-1.0) ** np.arange(WINDOW_NODES)
        return np.asarray(np.tensordot(signs, coefficients, 1))

    def edge(self, *, last: bool) -> tuple[Real, Real, Real]:
        """Positions, speeds, accelerations (f,) at the end, before what happens there; or at the start, after it."""
        solution = self.segment.solution
        q, v, _ = solution(self.edges[-1:] if last else self.edges[:1])
        if not last and isinstance(solution, Solution):
            own = next(w for w in reversed(solution.windows) if w.start <= self.start)
            q, v = (own.q[None], own.v[None]) if own.start == self.start else (q, v)
        return q[0], v[0], self.at_edge(self.state(self.nodes(last=last))[2], last=last)


def with_state_rows(states: Real, rows: Real) -> Real:
    """Changes (2 (f + s), P) from those (2 f, P) of the free coordinates and those (s, P) of the states of effects that integrate.
    These states are among the speeds; the rows of their integrals, on which nothing depends, are zero."""
    f = len(states) // 2
    return np.concatenate([states[:f], np.zeros_like(rows), states[f:], rows])


def parameters_in_chart(compiled: Compiled, original: Compiled, parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """Parameters of the ``original`` mechanism, for the same mechanism in another coordinate chart or with followers that have left
    their cams."""
    if compiled is original:
        return tuple(parameters)
    own = compiled.mechanism
    same = [d.joint for d in own.drives] == [d.joint for d in original.mechanism.drives]
    if not same and any(c.constant is None for c in compiled.model.constraints):
        where = next(
            r.name for r, c in zip(compiled.model.relations, compiled.model.constraints, strict=False) if c.constant is None
        )
        raise refusal(f"other coordinates lead the motion at times, and {where} is set by the pose at the start.", SWEEP_INSTEAD)
    names = {j.name for j in own.joints}

    def at(parameter: Parameter) -> Callable[[float], Mechanism]:
        def mechanism(x: float) -> Mechanism:
            varied = parameter.mechanism(x)
            laws = {d.joint: d.law for d in varied.drives}
            drives = tuple(d if isinstance(d.law, Free) else Drive(joint=d.joint, law=laws[d.joint]) for d in own.drives)
            joints = tuple(j for j in varied.joints if j.name in names)
            return replace(with_named_drive(varied), joints=joints, drives=drives, modes={}, sketch=own.sketch)

        return mechanism

    return tuple(replace(p, mechanism=at(p)) for p in parameters)


class PhaseDerivatives(Derivatives):
    """Derivatives within a phase at times (n,). Its free coordinates depend on the parameters as set by `set_states`; after them
    come the states of effects that integrate."""

    def __init__(self, phase: SmoothPhase, times: Real):
        self.phase = phase
        q, v, a = phase.state(times)
        super().__init__(motion_at(phase.compiled, q, v, times, a), phase.parameters, under_forces=True)
        system, nothing = phase.segment.system, [None] * len(self.parameters)
        f = len(phase.free)
        self._integrals = [self._leaf(x, nothing) for x in q[:, f:].T]  # of states over time, in place of positions
        self._state_rates = [self._leaf(x, nothing) for x in a[:, f:].T]
        self._dry: Dry | None = system.solve(q, v, times) if isinstance(system, DrySystem) else None
        self.efforts: list[Any] = []
        if phase.segment.resting:
            assert isinstance(system, Chart | DrySystem)  # other systems have no stops
            self.efforts = [self._leaf(effort, nothing) for effort in system.holding(q, v, times).T]
        self.friction_values: list[Any] = []  # friction of what sticks, normal loads of what slides
        if self._dry is not None:
            for i, element in enumerate(self._elements):
                value = self._dry.value[:, i]
                with np.errstate(all="ignore"):
                    load = np.nan_to_num(-value / (element.sign * np.asarray(_plain(element.factor))))
                self.friction_values.append(self._leaf(value if self._sticks[i] else load, nothing))

    @property
    def _sticks(self) -> list[bool]:
        system = self.phase.segment.system
        return [s == 0.0 for s in system.signs] if isinstance(system, DrySystem) else []

    @cached_property
    def _elements(self) -> list[Element]:
        """The elements of friction on the tape, with their senses of sliding in this phase."""
        system = self.phase.segment.system
        assert isinstance(system, DrySystem)
        n = self.nominal.frames
        return [replace(e, sign=np.full(n, s)) for e, s in zip(elements_of(self.motion), system.signs, strict=True)]

    def _forces(self) -> Forces:
        motion = self.motion
        force, moment, formed = totals(motion)
        stops = zip(self.phase.segment.resting, self.efforts, strict=True)
        held = [joint_wrench(motion, s.joint, x, name=stop_load(s), kind=STOP_CAUSE, cause=STOP_CAUSE) for s, x in stops]
        more = sum_up(held, len(motion.model.links))
        force, moment = [a + b for a, b in zip(force, more[0], strict=True)], [a + b for a, b in zip(moment, more[1], strict=True)]
        applied = [*formed(), *held]
        if self._dry is None:
            return Forces(motion, applied, *joint_forces(motion, force, moment)[:2])
        values = [
            x if sticks else -e.sign * e.factor * x
            for e, x, sticks in zip(self._elements, self.friction_values, self._sticks, strict=True)
        ]
        for element, value in zip(self._elements, values, strict=True):
            element.load(motion, force, moment, value)
        self._passed = joint_forces(motion, force, moment)[:2]
        friction = _PhaseFriction(motion, applied, self._elements, values, np.zeros(motion.frames, bool))
        return Forces(motion, applied, *self._passed, friction)

    def _residuals(self) -> list[Any]:
        """Residuals (n,) that vanish in the phase, one for each unknown: accelerations, efforts of stops, friction."""
        motion, forces = self.motion, self.forces
        left: list[Any] = [forces.effort(joint) for joint in self.phase.free]
        states = [e for e in motion.model.cached(applied_effects) if e.integrates]
        left += [rate - e.state_rate(motion) for e, rate in zip(states, self._state_rates, strict=True)]
        left += [motion.coordinate(stop.joint)[:, 2] for stop in self.phase.segment.resting]
        for i, load in enumerate(self.friction_values):
            e = self._elements[i]
            left.append(
                relative_rate(motion, motion.accelerations, e.what, e.index, e.links)
                if self._sticks[i]
                else load - self.pressure(i)
            )
        return left

    def pressure(self, i: int) -> Any:
        """Normal load (n,) of an element of friction, from what its joint transmits."""
        e = self._elements[i]
        p, q = e.normal(self.motion, *self._passed, e.sign)  # components of the forces
        return np.hypot(p, q) if e.euclidean else np.maximum(np.abs(p), np.abs(q))

    def limit(self, i: int) -> Any:
        """Largest friction (n,) with which an element sticks."""
        return self.pressure(i) * self._elements[i].limit

    @property
    def states(self) -> list[Any]:
        """Positions, then speeds of the free coordinates on the tape, each followed by the rows of the states (see
        `with_state_rows`)."""
        positions, speeds = ([self.leaves["drive", d, k] for d in free_of(self.nominal)] for k in (0, 1))
        return [*positions, *self._integrals, *speeds, *(self.leaves["state", name] for name in self.nominal.states)]

    @property
    def unknowns(self) -> list[Any]:
        """Accelerations of the free coordinates, rates of states, efforts of stops and friction on the tape."""
        accelerations = [self.leaves["drive", d, 2] for d in free_of(self.nominal)]
        return [*accelerations, *self._state_rates, *self.efforts, *self.friction_values]

    undetermined = False  # whether the efforts of joints that stick are statically indeterminate: they have no derivatives then

    def equations(self) -> tuple[Real, Real]:
        """Derivatives of the unknowns u at each frame by positions and speeds (F, u, 2 f), and by the parameters at fixed positions
        and speeds (F, u, P)."""
        left = self._refused(self._residuals)
        leaves = [*self.states, *self.unknowns]
        states, count = len(self.states), len(left)
        given = {x.number: np.zeros((len(leaves), *x.shape)) for x in leaves}
        for row, x in enumerate(leaves):
            given[x.number][row] = 1.0  # the frames do not depend on each other
        n = self.nominal.frames
        if not count:
            return np.zeros((n, 0, 0)), np.zeros((n, 0, len(self.parameters)))
        by_leaf = np.stack(self._forward(given, left), axis=-1)  # (leaves, F, u)
        by_parameter = np.stack(super().of(*left), axis=-1)  # (P, F, u)
        matrix = np.moveaxis(by_leaf[states:], 0, -1)  # (F, u, u)
        rest = np.concatenate([np.moveaxis(by_leaf[:states], 0, -1), np.moveaxis(by_parameter, 0, -1)], axis=-1)
        finite = np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(rest).all(axis=(1, 2))
        safe = np.where(finite[:, None, None], matrix, np.eye(count))
        solved = -self._solved(safe, np.where(finite[:, None, None], rest, 0.0))
        solved[~finite] = np.nan
        return solved[:, :, :states], solved[:, :, states:]

    def _solved(self, matrix: Real, rest: Real) -> Real:
        if not any(self._sticks):
            return np.asarray(np.linalg.solve(matrix, rest))
        rows = np.maximum(np.abs(matrix).max(axis=2), 1e-300)
        columns = np.maximum(np.abs(matrix / rows[:, :, None]).max(axis=1), 1e-300)
        scaled = matrix / rows[:, :, None] / columns[:, None, :]
        sizes = np.linalg.svd(scaled, compute_uv=False)
        self.undetermined = bool((sizes[:, -1] <= DEPENDENT_EFFORTS * sizes[:, 0]).any())
        return np.asarray(np.linalg.pinv(scaled, rcond=DEPENDENT_EFFORTS) @ (rest / rows[:, :, None]) / columns[:, :, None])

    def _forward(self, given: dict[int, Real], results: Sequence[Any]) -> list[Real]:
        count = len(next(iter(given.values())))
        traced = [x for x in results if hasattr(x, "number")]
        values = iter(self.tape.forward(given, traced))
        return [np.asarray(next(values)) if hasattr(x, "number") else np.zeros((count, *np.shape(x))) for x in results]

    def set_states(self, states: Real) -> None:
        """Set the derivatives of the free coordinates by the parameters, ``states`` (F, 2 f, P), and with them those of all
        unknowns."""
        by_state, by_parameter = self.equations()
        for k, x in enumerate(self.states):
            self.state_slopes(x, list(states[:, k].T))
        changes = np.einsum("nab,nbp->nap", by_state, states) + by_parameter
        determined = len(self.phase.free) + len(self._state_rates)
        for k, x in enumerate(self.unknowns):
            share = np.nan if self.undetermined and k >= determined else 1.0
            self.state_slopes(x, list(share * changes[:, k].T))


class _PhaseFriction(TracedFriction):
    """Friction of a phase: what sticks has no power, whether or not statics determines its friction."""

    def losses(self, joint: str) -> Any:
        slides = [i for i, e in enumerate(self.elements) if e.joint == joint and np.any(e.sign)]
        return -sum((self.value(i) * self.elements[i].rate for i in slides), np.zeros(self.motion.frames))


def _plain(x: object) -> Any:
    return getattr(x, "value", x)


def changes_in(phase: SmoothPhase, started: Real) -> Changes:
    """The changes of the free coordinates with parameters in a phase, from ``started`` (2 f, P) at its start, in windows in which
    they are smooth. Raises `MechanismError` where they cannot be resolved."""
    edges = phase.edges
    for halved in range(MOST_HALVINGS + 1):
        changes = Changes(replace(phase, edges=edges), started)
        rough = ~(changes.tail <= CHANGE_TAIL)
        if not rough.any() or halved == MOST_HALVINGS:
            break
        edges = np.sort(np.concatenate([edges, 0.5 * (edges[:-1] + edges[1:])[rough]]))
    if not changes.tail.max(initial=0.0) <= UNRESOLVED_TAIL:
        t = float(edges[int(np.argmax(~(changes.tail <= UNRESOLVED_TAIL)))])
        raise refusal(f"the motion follows its parameters too abruptly at t = {t:.6g} s.", SWEEP_INSTEAD)
    return changes


class Changes:
    """Derivatives of the free coordinates by parameters over the windows of a phase, from ``started`` (2 f, P) at its start.
    ``tail`` (W,): the size of the last coefficients of the changes, relative to the largest change."""

    def __init__(self, phase: SmoothPhase, started: Real):
        rule, edges = gauss(WINDOW_NODES), phase.edges
        self.phase, self.edges, self.widths = phase, edges, np.diff(edges)
        nodes = (edges[:-1, None] + self.widths[:, None] * rule.nodes).ravel()
        self.on_nodes = [PhaseDerivatives(phase, nodes[k : k + AT_ONCE]) for k in range(0, len(nodes), AT_ONCE)]
        by_state, by_parameter = (np.concatenate(part) for part in zip(*(e.equations() for e in self.on_nodes), strict=True))
        lost = ~(np.isfinite(by_state).all(axis=(1, 2)) & np.isfinite(by_parameter).all(axis=(1, 2)))
        if lost.any():
            t = float(nodes[np.argmax(lost)])
            raise refusal(f"none are known at t = {t:.6g} s, at a singular position or where a force has a kink.", SWEEP_INSTEAD)
        count, (f, varied) = len(self.widths), (len(started) // 2, started.shape[1])
        h = self.widths[:, None, None, None]
        a = by_state[:, :f].reshape(count, WINDOW_NODES, f, 2 * f)
        by_q, by_v = a[..., :f], a[..., f:]
        matrix = -np.einsum("w,wiab,ij->wiajb", self.widths**2, by_q, rule.double_integral)
        matrix -= np.einsum("w,wiab,ij->wiajb", self.widths, by_v, rule.integral)
        matrix = matrix.reshape(count, WINDOW_NODES * f, WINDOW_NODES * f) + np.eye(WINDOW_NODES * f)
        right = np.concatenate(
            [by_q, h * rule.nodes[:, None, None] * by_q + by_v, by_parameter[:, :f].reshape(count, WINDOW_NODES, f, varied)],
            axis=-1,
        )
        solved = np.linalg.solve(matrix, right.reshape(count, WINDOW_NODES * f, 2 * f + varied)).reshape(right.shape)
        series = np.einsum("kj,wjac->wkac", rule.legendre, solved)  # Legendre coefficients of the changes of the accelerations
        first, second = (x[0] for x in integrals(WINDOW_NODES, np.array([1.0])))
        self.states = np.empty((count + 1, 2 * f, started.shape[1]))
        self.series = np.empty((count, WINDOW_NODES, f, started.shape[1]))
        self.states[0] = started
        for w, width in enumerate(self.widths):
            known = self.states[w]
            own = self.series[w] = np.einsum("kac,cp->kap", series[w][..., : 2 * f], known) + series[w][..., 2 * f :]
            once, twice = np.tensordot(first, own, 1), np.tensordot(second, own, 1)
            self.states[w + 1] = np.concatenate([known[:f] + width * known[f:] + width**2 * twice, known[f:] + width * once])
        _, v, _ = phase.segment.solution(nodes)
        scales = phase.scales
        pace = np.concatenate([scales, np.maximum(np.abs(v).max(axis=0), scales / phase.end)])
        nothing = NO_CHANGE * pace[:, None] / np.array([p.width for p in phase.parameters])
        size = np.maximum(np.abs(self.states).max(axis=0), np.maximum(nothing, 1e-300))
        h, moved = self.widths[:, None, None], np.abs(self.series[:, -2:]).max(axis=1)
        last = np.maximum(h**2 * moved / (4.0 * WINDOW_NODES**2) / size[:f], h * moved / (2.0 * WINDOW_NODES) / size[f:])
        self.tail = last.max(axis=(1, 2), initial=0.0)

    def __call__(self, times: Real) -> Real:
        """Changes (n, 2 f, P) of positions and speeds at times (n,)."""
        w, x = self._places(times)
        h = self.widths[w]
        first, second = integrals(WINDOW_NODES, x)
        f = self.series.shape[2]
        known, own = self.states[w], self.series[w]
        q, v = known[:, :f], known[:, f:]
        dq = q + (h * x)[:, None, None] * v + (h**2)[:, None, None] * np.einsum("nk,nkap->nap", second, own)
        return np.concatenate([dq, v + h[:, None, None] * np.einsum("nk,nkap->nap", first, own)], axis=1)

    @cached_property
    def _works(self) -> Real:
        """Legendre coefficients (W, NODES, P, 2) of the changes of the powers of `works`, times the windows' widths."""
        rates = []
        for exact in self.on_nodes:
            exact.set_states(self(exact.nominal.time))
            supplied, lost = powers_on(exact)
            rates.append(np.stack(exact.of(supplied, lost), axis=-1))  # (P, n, 2)
        at_nodes = np.concatenate(rates, axis=1).swapaxes(0, 1).reshape(len(self.widths), WINDOW_NODES, -1, 2)
        return np.asarray(np.einsum("kj,wjpc->wkpc", gauss(WINDOW_NODES).legendre, at_nodes) * self.widths[:, None, None, None])

    def works(self, times: Real) -> Real:
        """Changes (n, P, 2) of the work of drives and process forces since the start of the phase, and of the energy dissipated
        since then, at times (n,)."""
        series = self._works
        before = np.concatenate([np.zeros_like(series[:1, 0]), np.cumsum(series[:, 0], axis=0)])
        w, x = self._places(times)
        return np.asarray(before[w] + np.einsum("nk,nkpc->npc", integrals(WINDOW_NODES, x)[0], series[w]))

    def _places(self, times: Real) -> tuple[Index, Real]:
        """The window of each time (n,), and the place of the time in it, from 0 to 1."""
        w = np.clip(np.searchsorted(self.edges, times, side="right") - 1, 0, len(self.widths) - 1)
        return w, (times - self.edges[w]) / self.widths[w]


def powers_on(exact: PhaseDerivatives) -> tuple[Any, Any]:
    """Power of drives and process forces, and dissipated power (n,) [W], on the tape."""
    forces = exact.forces
    supplied, lost = forces.power_by_cause(["process"]), -forces.power_by_cause(LOSSES)
    for drive in exact.nominal.mechanism.drives:
        if not isinstance(drive.law, Free):
            supplied = supplied + forces.power(drive.joint)
    return supplied, lost
