"""A motion that forward dynamics has found: positions and rates at any time, reactions, works and energies.

Works are quadratures of the powers of all forces between the boundaries of the motion's windows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike

from mechcore.arrays import Index, Real, numbers
from mechcore.constants import TURN
from mechcore.dynamics.contact.dry_friction import DrySystem
from mechcore.dynamics.contact.separation import FollowerSeparation
from mechcore.dynamics.equations.energy import EnergyMotion
from mechcore.dynamics.equations.reduced import free_of, integrating, motion_at
from mechcore.dynamics.events import EndStop, SeparableCam, SimulationEvent
from mechcore.dynamics.integration.collocation import integrals
from mechcore.dynamics.integration.windows import Solution
from mechcore.dynamics.joined import JoinedForces, JoinedMotion
from mechcore.dynamics.segments import MotionSegment
from mechcore.effects.base import LOSSES, power_of
from mechcore.effects.masses import kinetic_energy
from mechcore.effects.registry import potential
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.kinematics.model import Model
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.records import dataclass
from mechcore.spec.clearance import with_ideal_joints
from mechcore.spec.mechanism import joints_with_friction

NO_MOTION = 1e-9  # part of the energies available at the start: the least reference of the energy drift


@dataclass(frozen=True, eq=False)
class Simulation:
    """A motion found by forward dynamics. Call it with times (n,) [s] for positions, speeds, accelerations (n, f) of the free
    coordinates.

    ``method`` of integration; ``evaluations``: calls of the equations of motion, each for many nodes; ``skipped_vibration``:
    amplitude, relative to one radian or the mechanism's size, and frequency [Hz] of a vibration that was stepped over.
    """

    compiled: Compiled
    segments: tuple[MotionSegment, ...]
    events: tuple[SimulationEvent, ...]
    method: str
    tolerance: float
    evaluations: int
    impact_losses: tuple[tuple[float, float], ...] = ()  # time and energy [J] of every impact
    stops: tuple[EndStop, ...] = ()
    impact_works: tuple[tuple[float, float], ...] = ()  # time and work [J] that prescribed drives do in impacts
    separable_cams: tuple[SeparableCam, ...] = ()
    skipped_vibration: tuple[float, float] = (0.0, 0.0)
    joined_works: WorkIntegrals | None = None  # of joined segments, if the works of all were known

    @property
    def joints_with_friction(self) -> tuple[str, ...]:
        """Joints with dry friction, in the order of the mechanism's joints."""
        return joints_with_friction(self.compiled.mechanism.joints) if "friction" in self.compiled.mechanism.effects else ()

    @property
    def start(self) -> float:
        """Time at which it begins [s]: 0, or later for a segment of a motion."""
        return self.segments[0].start

    @property
    def duration(self) -> float:
        return self.segments[-1].end

    def followed_by(self, others: Sequence[Simulation]) -> Simulation:
        """This motion joined with the ``others`` that follow it in time. Work integrals are reused if all of them have been
        computed."""
        parts = (self, *others)
        runs: list[list[MotionSegment]] = []
        for segment in (segment for s in parts for segment in s.segments):
            if runs and runs[-1][-1].is_continued_by(segment):
                runs[-1].append(segment)
            else:
                runs.append([segment])
        known = [w for s in parts if (w := vars(s).get("_work_integrals", s.joined_works)) is not None]
        return replace(
            self,
            segments=tuple(same[0].with_windows(same[1:]) for same in runs),
            events=tuple(h for s in parts for h in s.events),
            impact_losses=tuple(e for s in parts for e in s.impact_losses),
            impact_works=tuple(e for s in parts for e in s.impact_works),
            joined_works=known[0].followed_by(known[1:]) if len(known) == len(parts) else None,
        )

    def __call__(self, t: ArrayLike) -> tuple[Real, Real, Real]:
        t = numbers(t)
        out = np.empty((3, len(t), len(free_of(self.compiled))))
        for segment, rows in self._rows(t):
            if segment.compiled is self.compiled or segment.separated:
                for values, x in zip(out, segment(t[rows]), strict=True):
                    values[rows] = x[:, : out.shape[2]]
            else:
                out[:, rows] = self._original(segment, t[rows])
        return out[0], out[1], out[2]

    def _state(self, t: Real) -> tuple[Real, Real, Real, Real]:
        """The arguments of `motion_at`."""
        q, v, a = self(t)
        return q, v, t, a

    def _rows(self, t: Real) -> list[tuple[MotionSegment, Index]]:
        """The segments that contain some of the times, each with the indices of these times."""
        if len(self.segments) == 1:
            return [(self.segments[0], np.arange(len(t)))] if len(t) else []
        which = np.searchsorted(np.array([p.end for p in self.segments[:-1]]), t, side="left")
        return [(self.segments[k], np.flatnonzero(which == k)) for k in np.unique(which)]

    def _original(self, segment: MotionSegment, t: Real) -> Real:
        """The mechanism's stated free coordinates with their first two derivatives (3, n, f), in a segment with other
        coordinates."""
        motion = segment.motion(t)
        return np.stack([motion.coordinate(joint).T for joint in self._stated], axis=-1)

    @cached_property
    def _stated(self) -> list[str]:
        """Joints of the free coordinates."""
        return [self.compiled.mechanism.drives[i].joint for i in free_of(self.compiled)]

    def motion(self, t: ArrayLike) -> Motion:
        """The mechanism's motion at times (F,) [s], in several parts where charts or phases change."""
        t = numbers(t)
        parts = self._rows(t)
        plain = not integrating(self.compiled)
        if all(plain and p.compiled is self.compiled and not (p.resting or isinstance(p.system, DrySystem)) for p, _ in parts):
            return motion_at(self.compiled, *self._state(t))
        return JoinedMotion(t, [(rows, segment.motion(t[rows])) for segment, rows in parts], model=self._model)

    @property
    def _model(self) -> Model | None:
        """The model that has all joints, where some segments lack a cam."""
        return self.compiled.model if self.separable_cams else None

    def view(self, t: ArrayLike) -> JoinedMotion:
        """The motion at times (F,) [s] for recorders and viewers: only prescribed drives count as drives, free coordinates are
        joint motion. Its ``at_times`` gives it at other times."""
        t = numbers(t)
        parts = [(rows, segment.motion(t[rows])) for segment, rows in self._rows(t)]
        mechanism = self.compiled.mechanism
        shown = replace(mechanism, drives=tuple(d for d in mechanism.drives if not isinstance(d.law, Free)))
        shown = with_ideal_joints(shown)
        return JoinedMotion(t, parts, mechanism=shown, at_times=self.view, coordinates=self.coordinates(t), model=self._model)

    def coordinates(self, t: Real) -> dict[str, Real]:
        """The free coordinates with their rates (n, 3) [rad or m, and per s], by joint, whole turns included."""
        rows = np.stack(self(t), axis=-1)
        free = [d.joint for d in self.compiled.mechanism.drives if isinstance(d.law, Free)]
        return {joint: rows[:, i] for i, joint in enumerate(free)}

    def forces(self, motion: Motion) -> Forces:
        """All joint reactions of a motion of this simulation, by the kinetostatic core.

        The free coordinates' efforts are zero to rounding; an end stop on which a joint rests acts as a load.
        """
        if not isinstance(motion, JoinedMotion):
            return solve_forces(motion)
        parts = []
        for (segment, rows), (_, part) in zip(self._rows(motion.time), motion.parts, strict=True):
            parts.append((rows, segment.forces(motion.time[rows], part)))
        return JoinedForces(
            motion,
            parts,
            stops=self.stops,
            energies=self.energies,
            at_times=lambda t: self.forces(self.view(t)),
            jumps=self.jumps,
            impacts=self.impacts,
        )

    @property
    def impacts(self) -> tuple[tuple[float, float, float], ...]:
        """Time [s], energy lost [J] and work of prescribed drives [J] of every impact; loss and work are separate entries."""
        return tuple(
            sorted([*((t, lost, 0.0) for t, lost in self.impact_losses), *((t, 0.0, work) for t, work in self.impact_works)])
        )

    def gap(self, cam: str, motion: Motion) -> Real:
        """Gap (F,) between a cam and its follower in a `view` of this simulation, in the guide's coordinate [m or rad]."""
        separation = FollowerSeparation(self.compiled, self.separable_cams)
        guide = separation.contacts[cam].guide
        wanted = motion.over_parts(lambda m: separation.touching_coordinate(cam, m))
        away = separation.contacts[cam].away * (motion.coordinate(guide)[:, 0] - wanted)
        return np.asarray(np.mod(away + np.pi, TURN) - np.pi if separation.contacts[cam].rotary else away)

    @cached_property
    def _work_integrals(self) -> WorkIntegrals:
        if self.joined_works is not None:
            return self.joined_works
        end, period = self.duration, None
        solution = self.segments[0].solution
        if isinstance(solution, EnergyMotion) and solution.repeats is not None and solution.repeats < end:
            end, period = solution.repeats, solution.period  # forces depend on the position alone: their powers repeat
        edges = np.unique(np.concatenate([self.boundaries(end), [self.start, end]]))
        tiny = 1e-15 * self.duration
        return replace(work_integrals(self._powers, np.append(edges[:-1][np.diff(edges) > tiny], end)), period=period)

    def _powers(self, t: Real) -> Real:
        """Powers (n, 3) [W]: of forces with a potential, of drives and process, of losses."""
        out = np.empty((len(t), 3))
        for segment, rows in self._rows(t):
            motion = segment.motion(t[rows])
            out[rows] = powers_of(motion, segment.forces(t[rows], motion))
        return out

    def work(self, t: ArrayLike) -> Real:
        """Work of all forces but inertia since the start (n,) [J], by Gauss quadrature over the windows; impacts count by the work
        of prescribed drives in them less the energy lost."""
        t = numbers(t)
        return np.asarray(self._work_integrals(t).sum(axis=1) - _until(self.impact_losses, t) + _until(self.impact_works, t))

    def energies(self, t: ArrayLike) -> Real:
        """Kinetic and potential energy, work done by drives and process forces so far, energy dissipated so far, impacts
        included (n, 4) [J]."""
        t = numbers(t)
        works = self._work_integrals(t)
        stored = np.empty(len(t))
        for segment, rows in self._rows(t):
            stored[rows] = potential(segment.motion(t[rows]))
        return np.column_stack(
            [
                self.kinetic_energy(t),
                stored,
                works[:, 1] + _until(self.impact_works, t),
                _until(self.impact_losses, t) - works[:, 2],
            ]
        )

    def kinetic_energy(self, t: ArrayLike) -> Real:
        """Kinetic energy (n,) [J]."""
        t = numbers(t)
        out = np.empty(len(t))
        for segment, rows in self._rows(t):
            out[rows] = kinetic_energy(segment.motion(t[rows]))
        return out

    def drift(self, t: ArrayLike) -> Real:
        """Energy drift (n,): kinetic energy less its value at the start and less the work done, relative to the largest kinetic
        energy or work. This reference is at least a billionth of the energies available at the start, or these themselves where a
        vibration was stepped over."""
        t = numbers(t)
        kinetic, work = self.kinetic_energy(np.append(t, self.start)), self.work(t)
        standing = self._standing * (1.0 if self.skipped_vibration[0] else NO_MOTION)
        size = max(float(np.abs(kinetic).max()), float(np.abs(work).max(initial=0.0)), standing, 1e-300)
        return np.asarray((kinetic[:-1] - kinetic[-1] - work) / size)

    @cached_property
    def _standing(self) -> float:
        """Energies available at the start [J]: the potential energy, and the weights times the mechanism's size."""
        mechanism, model = self.compiled.mechanism, self.compiled.model
        t = np.array([self.start])
        held = sum(abs(float(np.ravel(potential(segment.motion(t)))[0])) for segment, _ in self._rows(t))
        weight = float(np.hypot(*mechanism.gravity)) * sum(mass for mass, *_ in model.masses[1:])
        return held + (weight * model.length_scale if "gravity" in mechanism.effects else 0.0)

    def boundaries(self, end: float = np.inf) -> Real:
        """Times (n,) until ``end`` [s] between which the motion is one smooth function."""
        out = [p.start for p in self.segments]
        for p in self.segments:
            if isinstance(p.solution, Solution):
                out += [w.start for w in p.solution.windows if p.start <= w.start < p.end]
            else:
                out += list(p.solution.boundaries(min(p.end, end)))
        return np.array(out)

    def jumps(self, end: float) -> Real:
        """Times (n, 2) [s] until ``end``, just before and just after each event or other jump of rates or accelerations."""
        before = np.unique(self.boundaries(end))
        before = before[(before > 0.0) & (before < end)]
        after = np.minimum(before + BESIDE * np.spacing(before), 0.5 * (before + np.append(before[1:], end)))
        pairs = np.column_stack([before, np.maximum(after, np.nextafter(before, np.inf))])
        leaps = np.isin(before, [p.start for p in self.segments])
        for x in self(pairs.ravel())[1:]:
            sides = x.reshape(len(pairs), 2, -1)
            leaps |= (np.abs(sides[:, 1] - sides[:, 0]) > LEAST_JUMP * np.abs(x).max(axis=0, initial=0.0)).any(axis=1)
        return pairs[leaps]


def _until(entries: tuple[tuple[float, float], ...], t: Real) -> Real:
    """Sum of the entries before times (n,)."""
    if not entries:
        return np.zeros(len(t))
    times, values = np.array(entries).T
    return np.asarray(np.concatenate([[0.0], np.cumsum(values)])[np.searchsorted(times, t, side="left")])


WINDOW_NODES = 16
BESIDE = 8.0  # units in the last place between the two sides of a jump
LEAST_JUMP = 1e-6  # part of the largest rate or acceleration of a coordinate: smaller jumps are integration errors
INSTANTS_AT_ONCE = 20_000  # instants that are evaluated at once
UNRESOLVED = 1e-9  # part of the energy exchanged in a run by which the last terms of a panel's polynomials count as too large
MOST_HALVINGS = 12  # of a panel; next to a kink of a power the error falls with each
_X = legendre.leggauss(WINDOW_NODES)[0]
_FIT = np.linalg.inv(legendre.legvander(_X, WINDOW_NODES - 1))


@dataclass(frozen=True, eq=False)
class WorkIntegrals:
    """Works (c,) since the start [J]: on panels between ``edges`` (p + 1,) [s] the powers are polynomials, ``coefficients`` (p,
    WINDOW_NODES, c) in Legendre polynomials; ``before`` (p, c): works up to each panel. Where a ``period`` [s] is given, the powers
    of the last period repeat beyond the last edge."""

    edges: Real
    coefficients: Real
    before: Real
    period: float | None = None

    def __call__(self, t: Real) -> Real:
        """Works (n, c) until times (n,) [s]."""
        end = self.edges[-1]
        if self.period is None or not (t > end).any():
            return self._within(t)
        turns = np.maximum(np.ceil((t - end) / self.period), 0.0)
        gained = np.diff(self._within(np.array([end - self.period, end])), axis=0)
        return np.asarray(self._within(t - turns * self.period) + turns[:, None] * gained)

    def _within(self, t: Real) -> Real:
        k = np.clip(np.searchsorted(self.edges, t, side="left") - 1, 0, len(self.before) - 1)
        width = self.edges[k + 1] - self.edges[k]
        first, _ = integrals(WINDOW_NODES, np.clip((t - self.edges[k]) / width, 0.0, 1.0))
        return np.asarray(self.before[k] + width[:, None] * np.einsum("ns,nsc->nc", first, self.coefficients[k]))

    def followed_by(self, others: Sequence[WorkIntegrals]) -> WorkIntegrals:
        """These works joined with ``others``, each of which begins where the one before ends."""
        if not others:
            return self
        parts = (self, *others)
        before, total = [], np.zeros(self.before.shape[1])
        for part in parts:
            before.append(total + part.before)
            total = total + part(part.edges[-1:])[0]
        edges = [self.edges, *(part.edges[1:] for part in others)]
        return WorkIntegrals(np.concatenate(edges), np.concatenate([p.coefficients for p in parts]), np.concatenate(before))


def work_integrals(powers: Callable[[Real], Real], edges: Real) -> WorkIntegrals:
    """Works of powers, ``powers(t)`` (n, c) [W] at times (n,); smooth between ``edges`` (p + 1,) [s].

    Panels on which the polynomials do not follow the powers are halved: those of prescribed drives may change much more quickly
    than what moves freely, for which the edges were made."""
    start, width = edges[:-1], np.diff(edges)
    known: list[tuple[Real, Real, Real]] = []  # starts (p,), widths (p,) and coefficients (p, WINDOW_NODES, c) of panels
    exchanged = 0.0  # [J], by the power of the largest magnitude
    for halvings in range(MOST_HALVINGS + 1):
        x = (start[:, None] + 0.5 * width[:, None] * (_X + 1.0)).ravel()
        values = np.concatenate([powers(x[k : k + INSTANTS_AT_ONCE]) for k in range(0, len(x), INSTANTS_AT_ONCE)])
        coefficients = np.einsum("ij,pjc->pic", _FIT, values.reshape(len(width), WINDOW_NODES, -1))
        exchanged = exchanged or float(width @ np.abs(values).reshape(len(width), -1).max(axis=1))
        coarse = width * np.abs(coefficients[:, -2:]).max(axis=(1, 2)) > UNRESOLVED * exchanged
        if halvings == MOST_HALVINGS or not coarse.any():
            known.append((start, width, coefficients))
            break
        known.append((start[~coarse], width[~coarse], coefficients[~coarse]))
        start, width = start[coarse], 0.5 * width[coarse]
        start, width = np.concatenate([start, start + width]), np.tile(width, 2)
    start, width, coefficients = (np.concatenate(parts) for parts in zip(*known, strict=True))
    order = np.argsort(start, kind="stable")
    gained = width[order, None] * coefficients[order, 0]
    before = np.concatenate([np.zeros((1, gained.shape[1])), np.cumsum(gained, axis=0)[:-1]])
    return WorkIntegrals(np.append(start[order], edges[-1]), coefficients[order], before)


def powers_of(motion: Motion, forces: Forces) -> Real:
    """Power of all forces but inertia (n, 3) [W]: of those with a potential, of drives and process, of losses."""
    out = np.zeros((motion.frames, 3))
    for w in forces.applied:
        if w.kind != "inertia":
            column = 2 if w.cause in LOSSES else 0 if w.cause in ("gravity", "elastic") else 1
            out[:, column] += power_of(motion, w)
    for d in motion.mechanism.drives:
        if not isinstance(d.law, Free):
            out[:, 1] += forces.power(d.joint)
    if forces.friction is not None:
        out[:, 2] += forces.friction.power
    return out
