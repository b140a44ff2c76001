"""Derivatives of motions under forces by parameters: the variational equations along a motion that was found.

What holds the free coordinates, the effort of their drives, is zero at every instant. It follows from their positions, speeds and
accelerations there and from the parameters; the tape of `Derivatives` says how, to rounding, so that the change of the motion by a
parameter obeys a linear differential equation with known coefficients. It is solved by collocation at Gauss nodes in the windows
of the motion itself, in which all forces are smooth. What is asked of the motion then follows from it as from a prescribed one.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from mechcore.arrays import Index, Real
from mechcore.design.derivatives import Derivatives
from mechcore.design.model_numbers import Parameter, refusal, slopes
from mechcore.dynamics.equations.charts import Chart
from mechcore.dynamics.equations.reduced import coordinate_scales, free_of, integrating, motion_at
from mechcore.dynamics.integration.collocation import gauss, integrals
from mechcore.dynamics.integration.windows import Solution
from mechcore.dynamics.segments import Breakpoints
from mechcore.dynamics.simulation import Simulation
from mechcore.forces.kinetostatics import LOSSES
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism
from mechcore.spec.mechanism import Mechanism

NODES = 16  # of a window
AT_ONCE = 4096  # nodes on one tape
HALVED = 4  # times that windows are, until the changes are smooth in them
TAIL = 1e-10  # part of the largest coefficients of a change that its last ones may be
UNRESOLVED = 1e-6  # part from which on derivatives are refused
NOTHING = 1e-9  # of the scales of a coordinate and its speed: what a parameter does over its width, if it is as good as nothing
JUMP = 1e-5  # part of the largest acceleration by which it may change from one window to the next


class DerivativesUnderForces(Derivatives):
    """Derivatives of a motion under forces, and of its forces, at times (F,) [s], by parameters. Raises `MechanismError` where
    there are none, with the reason."""

    def __init__(self, simulation: Simulation, parameters: Sequence[Parameter], times: Real):
        _check(simulation, parameters)
        self._simulation = simulation
        self._changes = _resolved(simulation, parameters)
        super().__init__(_motion(simulation, times), parameters, under_forces=True)
        _lead(self, self._changes)

    @cached_property
    def energy(self) -> Any:
        """Kinetic and potential energy, work and dissipation so far (F, 4) [J], on the tape; works by the windows' quadrature."""
        times, forces = self.nominal.time, self.forces
        columns: list[Any] = [forces.kinetic_energy, forces.potential_energy]
        changes = self._changes.works(times)
        for k, column in enumerate(self._simulation.energies(times)[:, 2:].T):
            columns.append(self._leaf(column, list(changes[:, :, k].T)))
        return np.column_stack(columns)


def _resolved(simulation: Simulation, parameters: Sequence[Parameter]) -> _Changes:
    """The changes of the free coordinates with parameters, in windows in which they are smooth."""
    started = _starts(simulation.compiled, parameters)
    end = simulation.duration
    edges = np.unique(np.concatenate([simulation.boundaries(), [simulation.start, end]]))
    edges = np.append(edges[:-1][np.diff(edges) > 1e-14 * end], end)
    for halved in range(HALVED + 1):
        changes = _Changes(simulation, parameters, edges, started)
        rough = ~(changes.tail <= TAIL)
        if not rough.any() or halved == HALVED:
            break
        edges = np.sort(np.concatenate([edges, 0.5 * (edges[:-1] + edges[1:])[rough]]))
    if not changes.tail.max() <= UNRESOLVED:
        t = float(edges[int(np.argmax(~(changes.tail <= UNRESOLVED)))])
        raise refusal(f"the motion follows its parameters too abruptly at t = {t:.6g} s.", "Sweep the parameter instead.")
    return changes


def _check(simulation: Simulation, parameters: Sequence[Parameter]) -> None:
    """Refuse motions whose course changes at instants that follow from the parameters."""
    compiled = simulation.compiled
    remedy = "Sweep the parameter instead."
    if simulation.rubbing or simulation.separable_cams or any(s.resting or s.separated for s in simulation.segments):
        what = "friction between slip and stick" if simulation.rubbing else "contact at end stops or cams"
        raise refusal(f"the motion changes its form where {what} does: at instants that move with the parameters.", remedy)
    if simulation.lost:
        raise refusal(f"at t = {simulation.lost[0][0]:.6g} s is an impact, whose instant moves with the parameters.", remedy)
    if integrating(compiled):
        raise refusal("a load keeps a state of its own over the time.", remedy)
    if any(s.compiled is not compiled for s in simulation.segments):
        raise refusal("other coordinates lead the motion after a dead point.", "Give the free start at other joints, or sweep it.")
    stated = _stated(compiled, simulation.duration)
    for p in parameters:
        beside = _stated(compile_mechanism(p.mechanism(p.value + 0.5 * p.width), compiled.accuracy), simulation.duration)
        if len(beside) != len(stated) or not np.allclose(beside, stated, rtol=1e-12, atol=0.0):
            raise refusal(f"instants at which forces change depend on {p.name}.", "Vary something else, or sweep it.")
    largest = 0.0
    jumps = []
    for s in simulation.segments:
        if isinstance(s.solution, Solution):
            ends = [
                (w.start, w.a.sum(axis=0), (w.a * (-1.0) ** np.arange(len(w.a))[:, None]).sum(axis=0)) for w in s.solution.windows
            ]
            largest = max([largest, *(float(np.abs(w.a[0]).max()) for w in s.solution.windows)])
            jumps += [(t, np.abs(begun - before)) for (_, before, _), (t, _, begun) in pairwise(ends)]
    for t, jump in jumps:
        known = len(stated) and np.abs(stated - t).min() <= 1e-9 * simulation.duration
        if float(jump.max()) > JUMP * largest and not known:
            why = f"a force jumps at t = {t:.6g} s, an instant that moves with the parameters."
            raise refusal(why, "Make the force continuous, or sweep the parameter.")


def _stated(compiled: Compiled, until: float) -> Real:
    """Instants [s] at which laws say that they change their form."""
    breaks, times = Breakpoints(compiled), [0.0]
    while (t := breaks.stated(times[-1])) < until:
        times.append(np.nextafter(t, np.inf) + 4.0 * float(np.spacing(t)))
    return np.array(times[1:])


def _starts(compiled: Compiled, parameters: Sequence[Parameter]) -> Real:
    """Derivatives (2 f, P) of the start, positions and then speeds, of the free coordinates."""

    def at(mechanism: Mechanism) -> dict[tuple[object, ...], float]:
        free = [d.law for d in mechanism.drives if isinstance(d.law, Free)]
        return {(k, i): x for i, law in enumerate(free) for k, x in enumerate((law.start, law.speed))}

    nominal = at(compiled.mechanism)
    out = np.zeros((len(nominal), len(parameters)))
    for p, parameter in enumerate(parameters):

        def beside(x: float, own: Parameter = parameter) -> dict[tuple[object, ...], float]:
            return at(own.mechanism(x))

        for (k, i), slope in slopes(beside, nominal, parameter).items():
            out[k * (len(nominal) // 2) + i, p] = slope
    return out


def _motion(simulation: Simulation, times: Real) -> Motion:
    """The motion at times (F,), with the accelerations of its equations of motion."""
    q, v, _ = simulation(times)
    return motion_at(simulation.compiled, q, v, times, Chart(simulation.compiled)(q, v, times))


def _equations(exact: Derivatives) -> tuple[Real, Real]:
    """Derivatives of the accelerations of the free coordinates at each frame, by their positions and speeds (F, f, 2 f), and by the
    parameters (F, f, P), of derivatives in which those do not move."""
    free = free_of(exact.nominal)
    efforts: list[Any] = [exact.forces.effort(exact.nominal.mechanism.drives[d].joint) for d in free]
    leaves = [exact.leaves["drive", d, k] for k in range(3) for d in free]
    given = {x.number: np.zeros((len(leaves), *x.shape)) for x in leaves}
    for row, x in enumerate(leaves):
        given[x.number][row] = 1.0  # the frames do not depend on each other
    by_state = np.stack(exact.tape.forward(given, efforts), axis=-1)  # (3 f, F, f)
    by_parameter = np.stack(exact.of(*efforts), axis=-1)  # (P, F, f)
    f = len(free)
    inertia = np.moveaxis(by_state[2 * f :], 0, -1)  # (F, f, f)
    rest = np.concatenate([np.moveaxis(by_state[: 2 * f], 0, -1), np.moveaxis(by_parameter, 0, -1)], axis=-1)
    finite = np.isfinite(inertia).all(axis=(1, 2))
    safe = np.where(finite[:, None, None], inertia, np.eye(f))
    solved = np.where(finite[:, None, None], -np.linalg.solve(safe, rest), np.nan)
    return solved[:, :, : 2 * f], solved[:, :, 2 * f :]


def _lead(exact: Derivatives, changes: _Changes) -> None:
    """Let the free coordinates of derivatives under forces move with the parameters."""
    dq, dv = changes(exact.nominal.time)
    by_state, by_parameter = _equations(exact)
    da = np.einsum("nab,nbp->nap", by_state, np.concatenate([dq, dv], axis=1)) + by_parameter
    for i, d in enumerate(free_of(exact.nominal)):
        for k, x in enumerate((dq, dv, da)):
            exact.state_slopes(exact.leaves["drive", d, k], list(x[:, i].T))


class _Changes:
    """How the free coordinates change with parameters over windows between ``edges`` (W + 1,) [s], from the derivatives (2 f, P) at
    the start. ``tail`` (W,): the last coefficients of the changes over the largest."""

    def __init__(self, simulation: Simulation, parameters: Sequence[Parameter], edges: Real, started: Real):
        rule = gauss(NODES)
        self.edges, self.widths = edges, np.diff(edges)
        nodes = (edges[:-1, None] + self.widths[:, None] * rule.nodes).ravel()
        chunks = [nodes[k : k + AT_ONCE] for k in range(0, len(nodes), AT_ONCE)]
        self.on_nodes = [Derivatives(_motion(simulation, t), parameters, under_forces=True) for t in chunks]
        by_state, by_parameter = (np.concatenate(part) for part in zip(*map(_equations, self.on_nodes), strict=True))
        lost = ~(np.isfinite(by_state).all(axis=(1, 2)) & np.isfinite(by_parameter).all(axis=(1, 2)))
        if lost.any():
            t = float(nodes[np.argmax(lost)])
            why = f"none are known at t = {t:.6g} s, at a singular position or where a force has a kink."
            raise refusal(why, "Sweep the parameter instead.")
        count, f = len(self.widths), by_state.shape[1]
        h = self.widths[:, None, None, None]
        a = by_state.reshape(count, NODES, f, 2 * f)
        by_q, by_v = a[..., :f], a[..., f:]
        matrix = -np.einsum("w,wiab,ij->wiajb", self.widths**2, by_q, rule.twice)
        matrix -= np.einsum("w,wiab,ij->wiajb", self.widths, by_v, rule.once)
        matrix = matrix.reshape(count, NODES * f, NODES * f) + np.eye(NODES * f)
        right = np.concatenate(
            [by_q, h * rule.nodes[:, None, None] * by_q + by_v, by_parameter.reshape(count, NODES, f, -1)], axis=-1
        )
        solved = np.linalg.solve(matrix, right.reshape(count, NODES * f, -1)).reshape(count, NODES, f, -1)
        series = np.einsum("kj,wjac->wkac", rule.legendre, solved)  # Legendre coefficients of the changes of the accelerations
        first, second = (x[0] for x in integrals(NODES, np.array([1.0])))
        self.states = np.empty((count + 1, 2 * f, started.shape[1]))
        self.series = np.empty((count, NODES, f, started.shape[1]))
        self.states[0] = started
        for w, width in enumerate(self.widths):
            known = self.states[w]
            own = self.series[w] = np.einsum("kac,cp->kap", series[w][..., : 2 * f], known) + series[w][..., 2 * f :]
            once, twice = np.tensordot(first, own, 1), np.tensordot(second, own, 1)
            self.states[w + 1] = np.concatenate([known[:f] + width * known[f:] + width**2 * twice, known[f:] + width * once])
        _, v, _ = simulation(nodes)
        pace = np.concatenate([coordinate_scales(simulation.compiled), np.abs(v).max(axis=0)])
        nothing = NOTHING * pace[:, None] / np.array([p.width for p in parameters])
        size = np.maximum(np.abs(self.states).max(axis=0), np.maximum(nothing, 1e-300))
        h, moved = self.widths[:, None, None], np.abs(self.series[:, -2:]).max(axis=1)
        last = np.maximum(h**2 * moved / (4.0 * NODES**2) / size[:f], h * moved / (2.0 * NODES) / size[f:])
        self.tail = last.max(axis=(1, 2))

    def __call__(self, times: Real) -> tuple[Real, Real]:
        """Changes of positions and speeds (n, f, P) at times (n,)."""
        w, x = self._places(times)
        h = self.widths[w]
        first, second = integrals(NODES, x)
        f = self.series.shape[2]
        known, own = self.states[w], self.series[w]
        q, v = known[:, :f], known[:, f:]
        after = (h * x)[:, None, None]
        dq = q + after * v + (h**2)[:, None, None] * np.einsum("nk,nkap->nap", second, own)
        return dq, v + h[:, None, None] * np.einsum("nk,nkap->nap", first, own)

    def works(self, times: Real) -> Real:
        """Changes (n, P, 2) of the work of drives and process forces so far, and of the energy dissipated so far, at times (n,)."""
        rates = []
        for exact in self.on_nodes:
            _lead(exact, self)
            supplied = exact.forces.power_by_cause(["process"])
            for drive in exact.nominal.mechanism.drives:
                if not isinstance(drive.law, Free):
                    supplied = supplied + exact.forces.power(drive.joint)
            rates.append(np.stack(exact.of(supplied, -exact.forces.power_by_cause(LOSSES)), axis=-1))  # (P, n, 2)
        at_nodes = np.concatenate(rates, axis=1).swapaxes(0, 1).reshape(len(self.widths), NODES, -1, 2)
        series = np.einsum("kj,wjpc->wkpc", gauss(NODES).legendre, at_nodes) * self.widths[:, None, None, None]
        before = np.concatenate([np.zeros_like(series[:1, 0]), np.cumsum(series[:, 0], axis=0)])
        w, x = self._places(times)
        return np.asarray(before[w] + np.einsum("nk,nkpc->npc", integrals(NODES, x)[0], series[w]))

    def _places(self, times: Real) -> tuple[Index, Real]:
        """The window of each time (n,), and where in it that is, from 0 to 1."""
        w = np.clip(np.searchsorted(self.edges, times, side="right") - 1, 0, len(self.widths) - 1)
        return w, (times - self.edges[w]) / self.widths[w]
