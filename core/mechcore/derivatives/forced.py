"""Derivatives of motions under forces by parameters: the variational equations along a known motion, phase by phase, and the jumps
of its changes between the phases. Results of the motion then follow as those of a prescribed one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from mechcore.arrays import Index, Real
from mechcore.derivatives.exact import Derivatives
from mechcore.derivatives.instants import Source, stated_instants
from mechcore.derivatives.jumps import Jumps
from mechcore.derivatives.model_numbers import ModelNumbers, Parameter, refusal, slopes
from mechcore.derivatives.phases import (
    SWEEP_INSTEAD,
    Changes,
    PhaseDerivatives,
    SmoothPhase,
    changes_in,
    parameters_in_chart,
    with_state_rows,
)
from mechcore.derivatives.zeros import with_integrals
from mechcore.dynamics.equations.reduced import free_of, integrating
from mechcore.dynamics.integration.windows import Solution
from mechcore.dynamics.segments import Breakpoints, MotionSegment
from mechcore.dynamics.simulation import Simulation
from mechcore.errors import MechanismError
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled
from mechcore.motion.solve import compile_mechanism
from mechcore.spec.mechanism import Mechanism

START_SAMPLES = 65  # samples of a motion for its largest speed
EVEN = 1e-3  # least size of accelerations, relative to that speed over the duration; smaller ones jump by rounding


class PartUnderForces(PhaseDerivatives):
    """Derivatives of the part of a motion under forces that lies in one phase, at times (n,). ``before``: the changes in earlier
    phases, each with those (P, 2) of the energies supplied and dissipated at the instant after it. ``moved`` (n, 2 f, P): changes
    of positions and speeds of the free coordinates."""

    def __init__(self, simulation: Simulation, changes: Changes, before: Sequence[tuple[Changes, Real]], times: Real):
        super().__init__(changes.phase, times)
        self._simulation, self._changes, self._before = simulation, changes, tuple(before)
        self.moved = changes(times)
        self.set_states(self.moved)

    @cached_property
    def energy(self) -> Any:
        """Kinetic and potential energy, work and dissipation so far (F, 4) [J], on the tape; works by the windows' quadrature."""
        times, forces = self.nominal.time, self.forces
        columns: list[Any] = [forces.kinetic_energy, forces.potential_energy]
        changes = self._changes.works(times)
        for earlier, at_once in self._before:
            changes = changes + earlier.works(earlier.edges[-1:]) + at_once
        for k, column in enumerate(self._simulation.energies(times)[:, 2:].T):
            columns.append(self._leaf(column, list(changes[:, :, k].T)))
        return np.column_stack(columns)


def derivatives_under_forces(
    simulation: Simulation,
    parameters: Sequence[Parameter],
    times: Real,
    made: Callable[[Simulation, Changes, Sequence[tuple[Changes, Real]], Real], PartUnderForces] = PartUnderForces,
) -> list[tuple[Index, Derivatives]]:
    """Derivatives of a motion under forces, and of its forces, at times (F,) [s], by parameters: for each phase that contains some
    of the times, the indices of these and the derivatives. Raises `MechanismError` with the reason where there are none."""
    parameters = [replace(p, mechanism=cache(p.mechanism)) for p in parameters]  # every phase needs the same ones
    simulation, parameters = with_integrals(simulation, parameters)
    compiled = simulation.compiled
    stated, moving = stated_instants(compiled, simulation.duration), []
    last = max((float(times[-1]) for times in stated.values()), default=0.0)
    horizon = 0.5 * (last + Breakpoints(compiled).stated(max(last, 0.999999 * simulation.duration)))
    for p in parameters:
        other = compile_mechanism(p.beside(), compiled.accuracy)
        moving.append(_moving(p, compiled, stated, horizon, stated_instants(other, horizon)))
    every = [w.a[0, : len(s.independent)] for s in simulation.segments for w in _windows(s)]  # states of effects come after those
    largest = max((float(np.abs(a).max(initial=0.0)) for a in every), default=0.0)
    speeds = simulation(np.linspace(simulation.start, simulation.duration, START_SAMPLES))[1][:, : len(free_of(compiled))]
    largest = max(largest, EVEN * float(np.abs(speeds).max(initial=0.0)) / simulation.duration)
    instants = {source: (times, np.array([own[source] for own in moving]).T) for source, times in stated.items()}
    jumps = Jumps(simulation, parameters, instants, largest)
    phases = [p for s in simulation.segments for p in _phases(s, simulation, tuple(parameters), jumps)]
    places = np.searchsorted(np.array([p.end for p in phases[:-1]]), times, side="left")
    parts: list[tuple[Index, Derivatives]] = []
    before: list[tuple[Changes, Real]] = []
    states = jumps.begin(phases[0], start_derivatives(compiled, parameters))
    states = with_state_rows(states, np.zeros((len(integrating(compiled)), len(parameters))))
    needed = int(places.max(initial=0))
    for k, phase in enumerate(phases[: needed + 1]):
        changes = changes_in(phase, states)
        rows = np.flatnonzero(places == k)
        if len(rows):
            parts.append((rows, made(simulation, changes, before, times[rows])))
        if k < needed:
            states, at_once = jumps(phase, phases[k + 1], changes(changes.edges[-1:])[0])
            before.append((changes, at_once))
    return parts


def _windows(segment: MotionSegment) -> list[Any]:
    return list(segment.solution.windows) if isinstance(segment.solution, Solution) else []


def _phases(segment: MotionSegment, simulation: Simulation, parameters: tuple[Parameter, ...], jumps: Jumps) -> list[SmoothPhase]:
    """The phases of a segment: parts of it between jumps of forces that are not at breakpoints of laws, or at breakpoints that move
    with a parameter."""
    inner = simulation.boundaries()
    edges = np.unique(np.concatenate([inner[(inner > segment.start) & (inner < segment.end)], [segment.start, segment.end]]))
    least = 1e-14 * simulation.duration
    edges = np.append(edges[:-1][np.diff(edges) > least], edges[-1])
    cuts = [0]
    windows, free = _windows(segment), len(segment.independent)
    for before, after in pairwise(windows):
        last, first = before.a.sum(axis=0), (after.a * (-1.0) ** np.arange(len(after.a))[:, None]).sum(axis=0)
        shifts = jumps.stated_shifts(after.start)
        moves = any(shift.any() for shift in shifts.values())
        stays = bool(shifts) and not moves
        jumps_there = moves or jumps.jumps(last[:free], first[:free])
        if after.start < segment.end and jumps_there and not stays:
            cuts.append(int(np.argmin(np.abs(edges - after.start))))
    own = parameters_in_chart(segment.compiled, simulation.compiled, parameters)
    return [SmoothPhase(segment, edges[a : b + 1], own) for a, b in pairwise([*dict.fromkeys(cuts), len(edges) - 1]) if b > a]


def _moving(
    parameter: Parameter, compiled: Compiled, stated: dict[Source, Real], until: float, beside: dict[Source, Real]
) -> dict[Source, Real]:
    """Derivatives (n,) of breakpoints (n,) of laws by a parameter, by source; ``beside``: breakpoints beside its value."""

    def same(known: dict[Source, Real]) -> bool:
        return {k: len(x) for k, x in known.items()} == {k: len(x) for k, x in stated.items()}

    still = {source: np.zeros(len(times)) for source, times in stated.items()}
    if same(beside) and all(np.allclose(beside[k], times, rtol=1e-12, atol=0.0) for k, times in stated.items()):
        return still

    reason = refusal(f"forces change at other instants beside the stated value of {parameter.name}.", SWEEP_INSTEAD)

    def at(x: float) -> ModelNumbers:
        found = stated_instants(compile_mechanism(parameter.mechanism(x), compiled.accuracy), until)
        if not same(found):
            raise reason
        return dict(found)

    try:
        known: dict[Source, Real] = slopes(at, dict(stated), parameter)
    except MechanismError:
        raise reason from None
    return still | known


def start_derivatives(compiled: Compiled, parameters: Sequence[Parameter]) -> Real:
    """Derivatives (2 f, P) of the positions, then the speeds, of the free coordinates at the start."""

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
