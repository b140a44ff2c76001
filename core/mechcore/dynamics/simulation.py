"""Forward dynamics: the motion of a mechanism under its forces, with what happens on the way.

One freedom that can turn fully is tabulated on its configuration curve; if all its forces depend on the position alone, its energy
gives the motion without a single step in time. All else is collocation in windows, in a chart of the configurations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..effects import potential
from ..errors import Fault, MechanismError
from ..kinetostatics import Forces, solve_forces
from ..motion import Motion
from ..solve import Compiled, compile_mechanism
from ..spec import Mechanism, braked
from .accounts import Ledger, kinetic_energy_of, ledger, powers_of
from .bends import bend_finder
from .chart import Chart
from .charts import Lead, best_chart, curve_around
from .collocation import Window
from .curve import TURN, Curve
from .dry import DrySystem, Phases, braking_elements
from .energy import by_energy
from .free import Free
from .happenings import Gauge, Happening, Stop, Watch, first_zero, gauge_of
from .integrate import Solution, integrate
from .joined import JoinedForces, JoinedMotion
from .reactions import piece_forces
from .reduced import free_of, motion_at, reduce

__all__ = ["Method", "Simulation", "simulate"]

Array = NDArray[np.float64]
Method = Literal["auto", "energy", "gauss", "radau"]
MOST_HAPPENINGS = 100_000
_STEPS = np.linspace(0.0, 1.0, 16)
TOUCH = 1e-11  # nearer than this, relative to the scale of the coordinate, a stop is touched
LEAST_BOUNCE = 1e-6  # of the duration: a bounce that is over sooner ends in contact


def _in_order(t: Array, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array, Array]:
    """The arguments of `motion_at`."""
    return q, v, t, a


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of the motion on which the same system holds: ``way(t)`` gives q, v, a (n, f) in the chart of ``compiled``."""

    start: float
    end: float
    compiled: Compiled
    way: Any
    system: Any
    resting: tuple[tuple[int, Stop], ...] = ()  # coordinates that stand still, with the stops that they rest on

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """Positions, speeds (n, f) by the dense output, accelerations by the equations of motion."""
        q, v, _ = self.way(t)
        return q, v, self.system(q, v, t)

    def motion(self, t: Array) -> Motion:
        """The mechanism's motion at times (n,) within the piece; accelerations not from a table, so that links are in balance to
        the last digits."""
        q, v, _ = self.way(t)
        system = Chart(self.compiled) if isinstance(self.system, Curve) else self.system
        return motion_at(self.compiled, q, v, t, system(q, v, t))

    def forces(self, t: Array, motion: Motion) -> Forces:
        """All reactions of the piece's motion at times (n,)."""
        q, v, _ = self.way(t)
        return piece_forces(motion, self.system, q, v, self.resting)


@dataclass(frozen=True, eq=False)
class Simulation:
    """A motion that was found. Call it with times (n,) [s] for positions, speeds, accelerations (n, f) of the free coordinates.

    ``method``: what found it; ``evaluations``: calls of the equations of motion, many nodes in each.
    """

    compiled: Compiled
    pieces: tuple[Piece, ...]
    happenings: tuple[Happening, ...]
    method: str
    tolerance: float
    evaluations: int
    lost: tuple[tuple[float, float], ...] = field(default=())  # time and energy [J] of every impact
    stops: tuple[Stop, ...] = ()

    @property
    def rubbing(self) -> tuple[str, ...]:
        """Pairs whose dry friction counts, in the order of the mechanism's pairs."""
        return braked(self.compiled.mechanism.pairs) if "friction" in self.compiled.mechanism.effects else ()

    @property
    def duration(self) -> float:
        return self.pieces[-1].end

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        t = np.atleast_1d(np.asarray(t, float))
        out = np.empty((3, len(t), len(free_of(self.compiled))))
        for piece, rows in self._rows(t):
            if piece.compiled is self.compiled:
                out[:, rows] = piece(t[rows])
            else:
                out[:, rows, 0] = self._original(piece, t[rows])
        return out[0], out[1], out[2]

    def _rows(self, t: Array) -> list[tuple[Piece, Any]]:
        """The pieces that hold some of the times, with the places of those."""
        which = np.searchsorted(np.array([p.end for p in self.pieces[:-1]]), t, side="left")
        return [(self.pieces[k], np.flatnonzero(which == k)) for k in np.unique(which)]

    def _original(self, piece: Piece, t: Array) -> Array:
        """The free coordinate that was stated, and its rates (3, n), where another pair leads."""
        pair = self.compiled.mechanism.drives[0].pair
        found = piece.motion(t).coordinate(pair).T.copy()
        model = self.compiled.model
        if model.joints[model.joint_index[pair]].coordinate == "angle":  # known up to whole turns
            times, angles = self._followed[id(piece)]
            near = angles[np.clip(np.searchsorted(times, t), 0, len(times) - 1)]
            found[0] += TURN * np.round((near - found[0]) / TURN)
        return found

    @cached_property
    def _followed(self) -> dict[int, tuple[Array, Array]]:
        """The stated coordinate's angle in steps small enough to follow it, in pieces where another pair leads."""
        pair = self.compiled.mechanism.drives[0].pair
        out = {}
        last = float(self.compiled.start[0])
        for piece in self.pieces:
            t = np.unique(np.concatenate([[piece.start, piece.end], *(w.start + w.length * _STEPS for w in piece.way.windows)]))
            t = t[(t >= piece.start) & (t <= piece.end)]
            if piece.compiled is self.compiled:
                last = float(piece(t[-1:])[0][0, 0])
                continue
            angle = np.unwrap(piece.motion(t).coordinate(pair)[:, 0])
            angle += TURN * np.round((last - angle[0]) / TURN)
            out[id(piece)] = t, angle
            last = float(angle[-1])
        return out

    def motion(self, t: ArrayLike) -> Any:
        """The mechanism's motion at times (F,) [s]: a `Motion`, or what stands for one where charts or phases change."""
        t = np.atleast_1d(np.asarray(t, float))
        parts = self._rows(t)
        if all(p.compiled is self.compiled and not (p.resting or isinstance(p.system, DrySystem)) for p, _ in parts):
            return motion_at(self.compiled, *_in_order(t, *self(t)))
        return JoinedMotion(t, [(rows, piece.motion(t[rows])) for piece, rows in parts])

    def view(self, t: ArrayLike) -> JoinedMotion:
        """The motion at times (F,) [s] for recorders and viewers: only prescribed drives count as drives, free coordinates are
        joint motion; it can be asked again at other times."""
        t = np.atleast_1d(np.asarray(t, float))
        parts = [(rows, piece.motion(t[rows])) for piece, rows in self._rows(t)]
        mechanism = self.compiled.mechanism
        shown = replace(mechanism, drives=tuple(d for d in mechanism.drives if not isinstance(d.law, Free)))
        return JoinedMotion(t, parts, mechanism=shown, again=self.view, coordinates=self._coordinates(t))

    def _coordinates(self, t: Array) -> dict[str, Array]:
        """The free coordinates with their rates (n, 3), by pair: whole turns are known here."""
        found = np.stack(self(t), axis=-1)
        free = [d.pair for d in self.compiled.mechanism.drives if isinstance(d.law, Free)]
        return {pair: found[:, i] for i, pair in enumerate(free)}

    def forces(self, motion: Any) -> Any:
        """All joint reactions of a motion of this simulation, by the kinetostatic core: a `Forces`, or what stands for one.

        The free coordinates' efforts are zero to rounding; what rests on a stop is held by a load.
        """
        if not isinstance(motion, JoinedMotion):
            return solve_forces(motion)
        parts = []
        for (piece, rows), (_, part) in zip(self._rows(motion.time), motion.parts, strict=True):
            parts.append((rows, piece.forces(motion.time[rows], part)))
        return JoinedForces(motion, parts, stops=self.stops, energies=self.energies)

    @cached_property
    def _ledger(self) -> Ledger:
        edges = np.unique(np.concatenate([self._borders(), [0.0, self.duration]]))
        tiny = 1e-15 * self.duration
        return ledger(self._powers, np.append(edges[:-1][np.diff(edges) > tiny], edges[-1]))

    def _powers(self, t: Array) -> Array:
        """Powers (n, 3) [W]: of forces with a potential, of drives and process, of losses."""
        out = np.empty((len(t), 3))
        for piece, rows in self._rows(t):
            motion = piece.motion(t[rows])
            out[rows] = powers_of(motion, piece.forces(t[rows], motion))
        return out

    def work(self, t: ArrayLike) -> Array:
        """Work of all forces but inertia since the start (n,) [J], less what impacts took, by the windows' own quadrature."""
        t = np.atleast_1d(np.asarray(t, float))
        return np.asarray(self._ledger(t).sum(axis=1) - self._impacts(t))

    def _impacts(self, t: Array) -> Array:
        """Energy that impacts have taken until times (n,) [J]."""
        return np.asarray(sum((np.where(t > time, energy, 0.0) for time, energy in self.lost), np.zeros(len(t))))

    def energies(self, t: ArrayLike) -> Array:
        """Kinetic and potential energy, work done by drives and process forces so far, energy dissipated so far, impacts
        included (n, 4) [J]."""
        t = np.atleast_1d(np.asarray(t, float))
        works = self._ledger(t)
        stored = np.empty(len(t))
        for piece, rows in self._rows(t):
            stored[rows] = potential(piece.motion(t[rows]))
        return np.column_stack([self.kinetic_energy(t), stored, works[:, 1], self._impacts(t) - works[:, 2]])

    def kinetic_energy(self, t: ArrayLike) -> Array:
        """Kinetic energy (n,) [J]."""
        t = np.atleast_1d(np.asarray(t, float))
        out = np.empty(len(t))
        for piece, rows in self._rows(t):
            out[rows] = kinetic_energy_of(piece.motion(t[rows]))
        return out

    def drift(self, t: ArrayLike) -> Array:
        """Kinetic energy less its value at the start and less the work done, relative to the largest energy or work (n,)."""
        t = np.atleast_1d(np.asarray(t, float))
        kinetic, work = self.kinetic_energy(np.append(t, 0.0)), self.work(t)
        size = max(float(np.abs(kinetic).max()), float(np.abs(work).max(initial=0.0)), 1e-300)
        return (kinetic[:-1] - kinetic[-1] - work) / size

    def _borders(self) -> Array:
        out = [p.start for p in self.pieces]
        for p in self.pieces:
            if isinstance(p.way, Solution):
                out += [w.start for w in p.way.windows if p.start <= w.start < p.end]
            else:
                out += list(p.way.borders(p.end))
        return np.array(out)


def simulate(
    mechanism: Mechanism | Compiled,
    duration: float,
    *,
    tolerance: float = 1e-9,
    method: Method = "auto",
    stops: Sequence[Stop] = (),
    watches: Sequence[Watch] = (),
    progress: Callable[[float], None] | None = None,
) -> Simulation:
    """The motion for ``duration`` [s] from the start of the mechanism's free coordinates (drives with a `Free` law).

    ``tolerance``: local error of positions, relative to one radian or the mechanism's size. ``method`` "energy" needs one
    freedom and forces that depend on its position alone; "radau" is for stiff forces; "auto" chooses. Raises `MechanismError`.
    """
    compiled = mechanism if isinstance(mechanism, Compiled) else compile_mechanism(mechanism)
    _validate(compiled, duration, tolerance)
    drives = [d for d in compiled.mechanism.drives if isinstance(d.law, Free)]
    q = np.array([float(d.law(0.0)[0]) for d in drives])
    v = np.array([float(d.law(0.0)[1]) for d in drives])
    system: Any = Chart(compiled)
    leads: tuple[float, float] | None = None
    if len(compiled.mechanism.drives) == 1 and not braking_elements(compiled, q, v):
        system, leads = curve_around(compiled, q[0], _table_tolerance(tolerance))
    _weigh(compiled, q, system)
    if isinstance(system, Curve) and not system.rest and not stops and not watches and method in ("auto", "energy"):
        found = by_energy(system, q[0], v[0], duration, tolerance=_table_tolerance(tolerance))
        if found is not None:
            return Simulation(compiled, (Piece(0.0, duration, compiled, found, system),), (), "energy", tolerance, 0)
    if method == "energy":
        raise MechanismError(
            Fault(
                "dynamics.method",
                '"energy" cannot find this motion: it needs one freedom that turns fully, forces that depend on '
                "the position alone, no stops and no watches.",
                'Choose "auto", "gauss" or "radau".',
            )
        )
    return _Run(compiled, (system, leads), duration, tolerance, method, stops, watches, progress).go(q, v)


def _table_tolerance(tolerance: float) -> float:
    """How exact tables of a motion are: their errors add up over turns, and digits there cost little."""
    return float(np.clip(1e-4 * tolerance, 1e-13, 1e-9))


def _validate(compiled: Compiled, duration: float, tolerance: float) -> None:
    faults = []
    if not (np.isfinite(duration) and duration > 0):
        faults.append(Fault("dynamics.duration", f"{duration!r} s is no duration.", "Give a time above zero."))
    if not 1e-15 <= tolerance <= 0.1:
        faults.append(Fault("dynamics.tolerance", f"{tolerance!r} is out of range.", "Give a number from 1e-15 to 0.1."))
    mechanism = compiled.mechanism
    if "inertia" not in mechanism.effects:
        faults.append(Fault("effects", "motion under forces needs masses, and inertia is not named.", 'Add "inertia" to effects.'))
    free = [d for d in mechanism.drives if isinstance(d.law, Free)]
    if not free:
        faults.append(Fault("pairs", "every drive is prescribed: no coordinate is free.", "Give a pair a free start."))
    if faults:
        raise MechanismError(faults)


def _weigh(compiled: Compiled, q: Array, system: Any) -> None:
    """Refuse a start (f,) at which a free coordinate moves no mass."""
    inertia = (
        system.table(q)[:1, :1]
        if isinstance(system, Curve)
        else reduce(compiled, q[None], np.zeros_like(q)[None], np.zeros(1)).inertia[0]
    )
    values = np.linalg.eigvalsh(inertia) if np.isfinite(inertia).all() else np.array([-1.0])
    if values[0] <= 1e-14 * values[-1]:
        raise MechanismError(
            Fault(
                "links",
                "a free coordinate moves no mass: its acceleration has no bound.",
                "Give a mass or a moment of inertia to the links that it moves.",
            )
        )


class _Run:
    """Pieces one after the other: in each the same stops hold; what happens ends it."""

    def __init__(
        self,
        compiled: Compiled,
        system: tuple[Any, tuple[float, float] | None],
        duration: float,
        tolerance: float,
        method: Method,
        stops: Sequence[Stop],
        watches: Sequence[Watch],
        progress: Callable[[float], None] | None,
    ):
        self.duration, self.tolerance, self.method = duration, tolerance, method
        self.stops, self.watches, self.progress = stops, watches, progress
        self.original = compiled
        self._lead(compiled, *system)
        self.known = [Lead(compiled, *system)] if isinstance(system[0], Curve) else []
        self.pieces: list[Piece] = []
        self.happenings: list[Happening] = []
        self.lost: list[tuple[float, float]] = []
        self.evaluations = 0
        self.phases: Phases | None = None  # of dry friction
        self.resting: dict[int, Stop] = {}  # held coordinate -> the stop that it rests on

    def _lead(self, compiled: Compiled, system: Any, leads: tuple[float, float] | None) -> None:
        """Go on in the chart of ``compiled``, as long as its coordinate stays in the range in which it ``leads`` well."""
        self.compiled, self.system = compiled, system
        drives = [d for d in compiled.mechanism.drives if isinstance(d.law, Free)]
        model = compiled.model
        self.coordinates = {d.pair: i for i, d in enumerate(drives)}
        angle = [model.joints[model.joint_index[d.pair]].coordinate == "angle" for d in drives]
        self.scale = np.array([1.0 if a else model.size for a in angle])
        at = partial(motion_at, compiled)
        self.limits = [(s, gauge_of(s, self.coordinates, at), s.side == "upper") for s in self.stops]
        self.looks = [(w, gauge_of(w, self.coordinates, at)) for w in self.watches]
        self.borders: list[Gauge] = []
        if leads is not None:
            low, high = leads
            self.borders = [lambda q, v, t: q[:, 0] - high, lambda q, v, t: low - q[:, 0]]

    def go(self, q: Array, v: Array) -> Simulation:
        """Run from q, v to the end."""
        for s, gauge, upper in self.limits:
            beyond = float(gauge(q[None], v[None], np.zeros(1))[0]) * (1.0 if upper else -1.0)
            if beyond > 1e-12:
                raise MechanismError(
                    Fault(
                        f"stops.{s.name}",
                        f"the motion starts {beyond:.6g} beyond it.",
                        "Start on the other side, or move the stop.",
                    )
                )
        elements = braking_elements(self.compiled, q, v)
        if elements:
            self.phases = Phases(self.compiled, elements)
            self._settle(0.0, q, v)
        t = 0.0
        while t < self.duration * (1.0 - 1e-13):
            t, q, v, ended = self._piece(t, q, v)
            if ended:
                break
            if len(self.happenings) > MOST_HAPPENINGS:
                raise MechanismError(
                    Fault(
                        "dynamics",
                        f"more than {MOST_HAPPENINGS} impacts or passages until t = {t:.9g} s.",
                        "Simulate a shorter time.",
                    )
                )
        return Simulation(
            self.original,
            tuple(self.pieces),
            tuple(self.happenings),
            "radau" if self.method == "radau" else "gauss",
            self.tolerance,
            self.evaluations,
            tuple(self.lost),
            tuple(self.stops),
        )

    def _piece(self, t: float, q: Array, v: Array) -> tuple[float, Array, Array, bool]:
        """Integrate until the first happening; time, position, speed after it, and whether the motion ends there."""
        v = self._touching(t, q, v)
        system = self._system()
        dry = [] if self.phases is None or self.resting else self.phases.gauges()
        first: list[tuple[float, Any]] = []

        def after(window: Window) -> float | None:
            first.clear()
            for k, (s, gauge, upper) in enumerate(self.limits):
                if s not in self.resting.values():
                    at = first_zero(gauge, window, t, upper)
                    if at is not None:
                        first.append((at, ("stop", k)))
            for k, (w, gauge) in enumerate(self.looks):
                at = first_zero(gauge, window, t + 1e-12 * self.duration, w.rising)
                if at is not None:
                    first.append((at, ("watch", k)))
            for i, s in self.resting.items():
                pull = self._pull(system, i, s)
                at = first_zero(pull, window, t + 1e-12 * self.duration, None)
                if at is not None:
                    first.append((at, ("release", i)))
            for gauge, rising, loose in dry:
                at = first_zero(gauge, window, t + 1e-12 * self.duration, rising)
                if at is not None:
                    first.append((at, ("dry", loose)))
            for border in self.borders:
                at = first_zero(border, window, t, True)
                if at is not None:
                    first.append((at, ("border", 0)))
            first.sort(key=lambda e: e[0])
            if self.progress is not None:
                self.progress(min(window.start + window.length, self.duration))
            return first[0][0] if first else None

        solution = integrate(
            system,
            q,
            v,
            t,
            self.duration,
            tolerance=self.tolerance,
            scale=self.scale,
            stiff=self.method == "radau",
            after=after,
            bends=bend_finder(self.compiled),
        )
        self.evaluations += solution.evaluations
        end = first[0][0] if first else self.duration
        self.pieces.append(Piece(t, end, self.compiled, solution, system, tuple(sorted(self.resting.items(), key=lambda e: e[0]))))
        end_q, end_v, _ = solution(np.array([end]))
        q, v = end_q[0], end_v[0]
        ended = False
        for time, (kind, k) in list(first):
            if time > end + 1e-14 * self.duration:
                break
            if kind == "stop":
                v = self._impact(time, q, v, k)
            elif kind == "border":
                lead, place, rate = best_chart(
                    self.compiled, float(q[0]), float(v[0]), self.known, _table_tolerance(self.tolerance)
                )
                if lead not in self.known:
                    self.known.append(lead)
                self._lead(lead.compiled, lead.curve, lead.well)
                q, v = np.array([place]), np.array([rate])
            elif kind == "dry":
                v = self._settle(time, q, v, k)
            elif kind == "release":
                stop = self.resting.pop(k)
                self.happenings.append(Happening(time, "release", stop.name, f"{stop.pair} leaves stop {stop.name}"))
            else:
                watch = self.looks[k][0]
                self.happenings.append(Happening(time, "end" if watch.ends else "watch", watch.name, _passed(watch)))
                ended = ended or watch.ends
        return end, q, v, ended

    def _touching(self, t: float, q: Array, v: Array) -> Array:
        """Stops that are touched at the beginning of a piece: what moves against them hits, what only presses rests."""
        for k, (stop, gauge, upper) in enumerate(self.limits):
            if stop in self.resting.values():
                continue
            sign = 1.0 if upper else -1.0
            i = self.coordinates.get(stop.pair, 0)
            if abs(float(gauge(q[None], v[None], np.array([t]))[0])) > TOUCH * self.scale[i]:
                continue
            gradient = self._gradient(stop, q, np.array([t]))
            speed = sign * float(gradient @ v)
            tiny = TOUCH * max(1.0, float(np.abs(v).max()))
            if speed > tiny:
                v = self._impact(t, q, v, k)
            elif speed > -tiny:
                push = sign * float(gradient @ self._free_acceleration(q, v, t))
                if abs(push) <= TOUCH:  # it decides in the next instant
                    push = sign * float(gradient @ self._free_acceleration(q, v, t + 1e-6 * self.duration))
                if push > 0.0:
                    v = self._rest(t, stop, v)
        return v

    def _system(self) -> Any:
        """The equations of motion of the present piece."""
        if self.resting:
            return Chart(self.compiled, frozenset(self.resting))
        return self.system if self.phases is None else self.phases.system()

    def _settle(self, t: float, q: Array, v: Array, loose: tuple[int, float] | None = None) -> Array:
        """Decide what slides and what sticks from now on; speeds after it: nothing is left of what sticks."""
        assert self.phases is not None
        for i, word in self.phases.decide(t, q, v, loose):
            pair = self.phases.names[i]
            kind = "stick" if word == "stick" else "slip"
            text = f"{pair} sticks" if kind == "stick" else f"{pair} slides in the {word[-1]} direction"
            found = Happening(t, kind, pair, text)
            if found not in self.happenings[-4:]:  # a pair may have friction of several kinds
                self.happenings.append(found)
        return self.phases.at_rest(t, q, v)

    def _free_acceleration(self, q: Array, v: Array, t: float) -> Array:
        return np.asarray(self._system()(q[None], v[None], np.array([t]))[0])

    def _rest(self, t: float, stop: Stop, v: Array) -> Array:
        i = self.coordinates.get(stop.pair, 0)
        self.resting[i] = stop
        self.happenings.append(Happening(t, "contact", stop.name, f"{stop.pair} rests on stop {stop.name}"))
        return np.where(np.arange(len(v)) == i, 0.0, v)

    def _pull(self, system: Chart, i: int, stop: Stop) -> Gauge:
        """What the stop has to hold: positive while the coordinate presses on it."""
        place = int(np.searchsorted(system.held, i))
        sign = -1.0 if stop.side == "upper" else 1.0
        return lambda q, v, t: sign * system.holding(q, v, t)[:, place]

    def _impact(self, t: float, q: Array, v: Array, k: int) -> Array:
        """Newton's impact on a stop: its impulse spreads over all coordinates by the reduced masses."""
        stop, _, upper = self.limits[k]
        row = np.array([t])
        r = reduce(self.compiled, q[None], v[None], row)
        gradient = self._gradient(stop, q, row)
        hit = float(gradient @ v)
        mobility = np.linalg.solve(r.inertia[0], gradient)
        free = [i for i in range(len(q)) if i not in self.resting]
        if len(free) < len(q):  # what rests on other stops takes no part
            mobility = np.zeros(len(q))
            mobility[free] = np.linalg.solve(r.inertia[0][np.ix_(free, free)], gradient[free])
        e = stop.restitution
        before = 0.5 * float(v @ r.inertia[0] @ v)
        a = float(gradient @ r.acceleration()[0])  # how fast it falls back onto the stop
        towards = a if upper else -a
        rebound = e * abs(hit)
        self.lost.append((t, 0.0))
        rests = rebound == 0.0 or (towards > 0 and 2.0 * rebound / towards < LEAST_BOUNCE * self.duration)
        factor = 1.0 if rests else 1.0 + e
        v = v - mobility * (factor * hit / float(gradient @ mobility))
        self.lost[-1] = (t, before - 0.5 * float(v @ r.inertia[0] @ v))
        words = f"{stop.pair} hits stop {stop.name} at {abs(hit):.6g} {'rad/s' if self._rotary(stop.pair) else 'm/s'}"
        self.happenings.append(Happening(t, "impact", stop.name, words))
        if rests and towards > 0:
            v = self._rest(t, stop, v)
        return v

    def _gradient(self, stop: Stop, q: Array, t: Array) -> Array:
        """Rate of a stop's coordinate per unit rate of each free coordinate (f,)."""
        out = np.zeros(len(q))
        if stop.pair in self.coordinates:
            out[self.coordinates[stop.pair]] = 1.0
            return out
        for i in range(len(q)):
            unit = np.zeros((1, len(q)))
            unit[0, i] = 1.0
            out[i] = motion_at(self.compiled, q[None], unit, t).coordinate(stop.pair)[0, 1]
        return out

    def _rotary(self, pair: str) -> bool:
        model = self.compiled.model
        return pair not in model.joint_index or model.joints[model.joint_index[pair]].coordinate == "angle"


def _passed(watch: Watch) -> str:
    what = watch.pair if watch.pair is not None else ".".join(watch.point or ())
    return f"{watch.of} of {what} passes {watch.at:.6g}"
