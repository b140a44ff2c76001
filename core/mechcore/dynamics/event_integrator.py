"""Integration of a motion under forces, segment by segment: the same equations hold in a segment, and an event ends it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal

import numpy as np

from mechcore.arrays import Real
from mechcore.dynamics.active_chart import ActiveChart
from mechcore.dynamics.contact.end_stops import LEAST_BOUNCE, TOUCH_DISTANCE, EndStops, account_for_impact
from mechcore.dynamics.contact.friction_state import FrictionState
from mechcore.dynamics.contact.separation import (
    FollowerSeparation,
    driven_windows,
    first_beyond,
    pressing,
)
from mechcore.dynamics.equations.charts import Chart, reenter
from mechcore.dynamics.equations.contacts import Ending, contact_program
from mechcore.dynamics.equations.curve import CurveEquations
from mechcore.dynamics.equations.reduced import motion_at
from mechcore.dynamics.events import (
    EndStop,
    EventFunction,
    EventKind,
    EventTrigger,
    Log,
    LogEntries,
    PossibleEvent,
    Reaction,
    SeparableCam,
    SimulationEvent,
    first_exceeding,
    first_zero,
)
from mechcore.dynamics.integration.collocation import System, Window
from mechcore.dynamics.integration.refinement import KnownMotion, refine
from mechcore.dynamics.integration.windows import Integrator, Solution
from mechcore.dynamics.phases import run_phases
from mechcore.dynamics.segments import MotionSegment, segment_forces
from mechcore.dynamics.simulation import Simulation
from mechcore.dynamics.watched import Watch
from mechcore.effects.base import Effect
from mechcore.effects.registry import applied_effects
from mechcore.errors import Fault, MechanismError
from mechcore.motion.compiled import Compiled
from mechcore.spec.clearance import journals_of
from mechcore.texts import as_quantity

Method = Literal["auto", "energy", "gauss", "radau"]
MOST_EVENTS = 100_000
MOST_AT_ONCE = 100  # consecutive segments that end where they begin
PRESCRIBED_SAMPLES = 24  # samples of a window at which prescribed sliding is evaluated
SOON_AFTER = 1e-7  # part of the duration: delay at which the sense of prescribed sliding is evaluated
CHECKED = np.linspace(0.0, 1.0, 9)  # parts of a window at which the limits of load laws are checked
MANY = 30  # segments after which compiling a program pays: more are to be expected
SEGMENT_SHIFT = 0.01  # part of a segment: a known one serves as a start if it begins no farther away


class EventIntegrator:
    """Integrates consecutive segments of a motion. The chart, the stops and the contacts are the same throughout a segment; an
    event ends it."""

    def __init__(
        self,
        compiled: Compiled,
        system: tuple[Chart | CurveEquations, tuple[float, float] | None],
        duration: float,
        tolerance: float,
        method: Method,
        stops: Sequence[EndStop],
        triggers: Sequence[EventTrigger],
        separable_cams: Sequence[SeparableCam],
        progress: Callable[[float], None] | None,
        observe: Callable[[Simulation], None] | None = None,
        initial_guess: Simulation | None = None,
    ):
        self.duration, self.tolerance, self.method = duration, tolerance, method
        self.initial_guess = initial_guess
        self.observe = observe
        self.progress = progress
        self.original = compiled
        self.log = Log()
        self.watch = Watch(triggers, self.log)
        self.stops = EndStops(stops, duration, self.log)
        self.friction = FrictionState("friction" in compiled.mechanism.effects, SOON_AFTER * duration, self.log)
        self.separable_cams = tuple(separable_cams)
        self.separation = FollowerSeparation(compiled, separable_cams) if separable_cams else None
        self.separated: frozenset[str] = frozenset()  # cams that their followers have left
        may_change = not (separable_cams or journals_of(compiled.mechanism))
        self.chart = ActiveChart(compiled, system, duration, tolerance, may_change=may_change)
        self._chart_changed()
        self.segments: list[MotionSegment] = []
        self.evaluations = 0

    @property
    def compiled(self) -> Compiled:
        """The mechanism in its present chart and with its present contacts."""
        return self.chart.compiled

    def _use_chart(self, compiled: Compiled) -> None:
        """Continue in a chart of the mechanism with other contacts."""
        self.chart.use(compiled, Chart(compiled))
        self._chart_changed()

    def _chart_changed(self) -> None:
        """Let stops and triggers read the coordinates of the present chart."""
        compiled = self.compiled
        read = self.chart.coordinates if compiled.angles.exact else {}
        self.stops.use(compiled)
        self.watch.use(compiled, read)

    def run(self, q: Real, v: Real) -> Simulation:
        """Run from q, v (f,) to the end."""
        q, v = (np.append(x, np.zeros(len(self.chart.scale) - len(x))) for x in (q, v))
        self.stops.check_start(q, v)
        if self.chart.ends_at(q, v):
            q, v = self._take_over(q, v, (float(q[0]), float(v[0])))
        self.friction.begin(self.compiled, 0.0, q, v)
        v = self._settle(0.0, q, v)
        q, v = self._let_go(0.0, q, v)
        t, standing = 0.0, 0
        while t < self.duration * (1.0 - 1e-13):
            began = t
            t, q, v = self._integrate_segment(t, q, v)
            if self.watch.ended:
                break
            standing = standing + 1 if t <= began else 0
            if standing > MOST_AT_ONCE:
                why = f"at t = {t:.9g} s events follow each other at once, without end."
                raise MechanismError(Fault("dynamics", why, "Move a stop, or change a load that jumps there."))
            if len(self.log.events) > MOST_EVENTS:
                why = f"more than {MOST_EVENTS} impacts or passages until t = {t:.9g} s."
                raise MechanismError(Fault("dynamics", why, "Simulate a shorter time."))
        return self._simulation(self.segments, self.evaluations, self.log.all_entries())

    def _integrate_segment(self, t: float, q: Real, v: Real) -> tuple[float, Real, Real]:
        """Integrate until the first event; time, position and speed after it."""
        q, v = self._meet_stops(t, q, v)
        if self.watch.ended:
            return t, q, v
        by_program = self._phases(t, q, v)
        if by_program is not None:
            return by_program
        begun = (float(q[0]), float(v[0])) if len(q) else (0.0, 0.0)
        system = self._system()
        possible = self._possible_events(t, q, v, begun, system)
        self.chart.leave_waypoint(q, t)
        first: list[tuple[float, Reaction]] = []
        limited = [e for e in self.compiled.model.cached(applied_effects) if e.limited]
        reported = bool(limited) or self.observe is not None or self.progress is not None

        def after(window: Window) -> float | None:
            self.chart.leave_waypoints_within([window])
            if not len(q):
                self.friction.follow(self.compiled, window)
            if possible:
                first[:] = [(at, event.react) for event in possible if (at := event.find(window)) is not None]
            left = None if first else self.chart.time_to_leave(window)
            if left is not None:
                first.append((left, self._change_chart))
            first.sort(key=lambda e: e[0])
            if not reported:
                return first[0][0] if first else None
            until = first[0][0] if first else min(window.start + window.length, self.duration)
            self._check(window, until, limited)
            if self.observe is not None:
                segment = self._segment(window.start, until, Solution([window]), system)
                self.observe(self._simulation([segment], 0, self.log.new_entries()))
            if self.progress is not None:
                self.progress(until)
            return first[0][0] if first else None

        def passed(windows: Sequence[Window]) -> bool:
            if possible or reported or not (len(q) and self.chart.leads_through(windows)):
                return False
            self.chart.leave_waypoints_within(windows)
            return True

        solution = self._solve(system, t, q, v, begun, after, passed)
        self.evaluations += solution.evaluations
        end = first[0][0] if first else self.duration
        if end > t:
            self.segments.append(self._segment(t, end, solution, system))
        q, v = solution.state(end)
        for time, react in list(first):
            if time > end + 1e-14 * self.duration:
                break
            q, v = react(time, q, v)
            if self.progress is not None:  # the reaction may have searched for other coordinates
                self.progress(end)
        return end, q, v

    def _solve(
        self,
        system: System,
        t: float,
        q: Real,
        v: Real,
        begun: tuple[float, float],
        after: Callable[[Window], float | None],
        passed: Callable[[Sequence[Window]], bool],
    ) -> Solution:
        """Windows from ``t`` [s] on, until ``after`` ends them; windows that ``passed`` accepts are not given to ``after``.
        ``begun``: position and speed at the beginning of the segment."""
        if not len(q):
            assert self.separation is not None
            pace = partial(self.separation.window_length, self.compiled, q, v, duration=self.duration)
            return driven_windows(t, self.duration, pace, after, self.chart.breakpoints)
        speed_by_integral = None
        if isinstance(system, CurveEquations) and (len(self.chart.tables) > 1 or system.beside_singular):
            speed_by_integral = partial(system.speed_by_energy, begun)
        integrator = self._integrator(system, after, passed, speed_by_integral)
        known = self._known(t)
        return integrator.run(q, v, t, self.duration) if known is None else refine(integrator, q, v, t, self.duration, known)

    def _integrator(
        self,
        system: System,
        after: Callable[[Window], float | None] | None = None,
        passed: Callable[[Sequence[Window]], bool] | None = None,
        speed_by_integral: Callable[[Real, Real], Real] | None = None,
    ) -> Integrator:
        return Integrator(
            system,
            tolerance=self.tolerance,
            scale=self.chart.scale,
            stiff=self.method == "radau",
            nodes=self.original.accuracy.nodes,
            most=self.original.accuracy.window,
            on_window=after,
            on_windows=passed,
            breakpoints=self.chart.breakpoints,
            speed_by_integral=speed_by_integral,
        )

    def _phases(self, t: float, q: Real, v: Real) -> tuple[float, Real, Real] | None:
        """Integrate by a compiled program from event to event, as long as it decides what follows; time, position and speed after
        the last event. None where the segment has to be integrated window by window."""
        if (
            not len(q)
            or isinstance(self.chart.system, CurveEquations)
            or self.watch.triggers
            or self.chart.boundaries
            or self.separation
        ):
            return None
        friction = self.friction.known_signs(self.compiled)
        if friction is None or not (len(friction[1]) or self.stops.stops):
            return None
        program = contact_program(self.compiled, (), long=len(self.segments) >= MANY)
        stops = None if program is None or not program.has_phases else self.stops.program_rows(program.stopped)
        if program is None or stops is None:
            return None
        by = self._integrator(self.chart.system)
        run = run_phases(program, by, (t, q, v), self.duration, friction, stops, SOON_AFTER * self.duration)
        self.evaluations += run.evaluations
        if not run.phases:
            return None
        made: list[MotionSegment] = []
        limited = [e for e in self.compiled.model.cached(applied_effects) if e.limited]
        systems: dict[bytes, System] = {}
        for phase in run.phases:
            self.friction.adopt_signs(phase.start, phase.signs)
            key = phase.signs.tobytes()
            if key not in systems:
                systems[key] = self._system()
            segment = MotionSegment(phase.start, phase.end, self.compiled, Solution(phase.windows), systems[key])
            made.append(segment)
            if limited or self.progress is not None or self.observe is not None:
                self._tell(segment, limited)
            if phase.ending is Ending.IMPACT and phase.decided:
                self.stops.record_bounce(phase.number, phase.end, phase.rate, phase.lost)
        self.friction.adopt_signs(run.time, run.signs)
        self.segments += made
        self.chart.leave_waypoint(q, t)
        self.chart.leave_waypoints_of(made)
        t, q, v, last = run.time, run.q, run.v, run.phases[-1]
        if last.decided:
            return t, q, v
        if last.ending is Ending.IMPACT:
            return t, *self._end_stop(last.number, t, q, v)
        loose = None if last.ending is Ending.SLIP else (last.number, last.sense)
        return t, *self._slide(t, q, v, loose)

    def _tell(self, segment: MotionSegment, limited: Sequence[Effect]) -> None:
        """Check the limits of load laws in a segment from a program, and report it to ``progress`` and ``observe``."""
        assert isinstance(segment.solution, Solution)
        for window in segment.solution.windows:
            until = min(window.start + window.length, segment.end)
            self._check(window, until, limited)
            if self.progress is not None:
                self.progress(until)
        if self.observe is not None:
            self.observe(self._simulation([segment], 0, self.log.new_entries()))

    def _possible_events(self, t: float, q: Real, v: Real, begun: tuple[float, float], system: System) -> list[PossibleEvent]:
        """All events that can end the segment that begins at q, v (f,), t [s]; ``begun``: position and speed there."""
        soon = t + 1e-12 * self.duration
        out: list[PossibleEvent] = []
        for function, noise, stop in self.stops.event_functions(q, v, t, system):
            out.append(PossibleEvent(partial(first_exceeding, function, after=t, noise=noise), partial(self._end_stop, stop)))
        for function, noise, loose in self.friction.stick_ends(q, v, t):
            out.append(PossibleEvent(partial(first_exceeding, function, after=t, noise=noise), partial(self._slide, loose=loose)))
        out += self.watch.possible_events(soon)
        sliding, prescribed = self.friction.slip_ends()
        for function, rising in sliding:
            out.append(PossibleEvent(partial(first_zero, function, after=soon, rising=rising), self._slide))
        for function in prescribed:
            find = partial(first_beyond, function, after=t, limit=0.5, count=PRESCRIBED_SAMPLES, again=True)
            out.append(PossibleEvent(find, self._slide))
        for boundary in self.chart.boundaries:
            find = partial(first_zero, boundary, after=t, rising=True)
            out.append(PossibleEvent(find, lambda _, q, v: self._take_over(q, v, begun)))
        return out + self._contact_events(t)

    def _end_stop(self, stop: int, t: float, q: Real, v: Real) -> tuple[Real, Real]:
        self.stops.end(stop, t)
        return q, v

    def _slide(self, t: float, q: Real, v: Real, loose: tuple[int, float] | None = None) -> tuple[Real, Real]:
        return q, self._settle(t, q, v, loose)

    def _check(self, window: Window, until: float, limited: Sequence[Effect]) -> None:
        """Raise `MechanismError` where a load leaves the range of its law in a window, up to the time ``until`` [s]."""
        if limited:
            t = window.start + (until - window.start) * CHECKED
            q, v, _ = window(t)
            motion = motion_at(self.compiled, q, v, t)
            for effect in limited:
                effect.check(motion)

    def _known(self, t: float) -> KnownMotion | None:
        """The segment that begins at ``t`` [s] in the nearly equal motion ``initial_guess``, as a start for `refine`; None where
        its segments differ."""
        segments = () if self.initial_guess is None else self.initial_guess.segments[len(self.segments) : len(self.segments) + 1]
        for segment in segments:
            same = segment.independent == list(self.chart.coordinates) and segment.separated == tuple(sorted(self.separated))
            if same and abs(segment.start - t) <= SEGMENT_SHIFT * (segment.end - segment.start):
                return segment.as_known_motion(self.chart.scale)
        return None

    def _take_over(self, q: Real, v: Real, before: tuple[float, float]) -> tuple[Real, Real]:
        """Change to the coordinate of another joint, see `ActiveChart.take_over`."""
        q, v = self.chart.take_over(q, v, before)
        self._chart_changed()
        return q, v

    def _change_chart(self, t: float, q: Real, v: Real) -> tuple[Real, Real]:
        """Change to other coordinates if any are better; coordinates and rates in their chart. A single coordinate is tabulated
        along the configuration curve instead, which shows how far it leads and which chart follows."""
        if len(self.chart.scale) == len(self.compiled.mechanism.drives) == 1 and not self.friction.counts:
            q, v = self.chart.tabulate(q, v)
            self._chart_changed()
            return q, v
        taken = self.chart.change(t, q, v)
        if taken is None:
            return q, v
        q, v = taken
        self._chart_changed()
        self.friction.begin(self.compiled, t, q, v)
        return q, self._settle(t, q, v)

    def _segment(self, start: float, end: float, solution: Solution, system: System) -> MotionSegment:
        """A segment in which the present stops and contacts hold."""
        return MotionSegment(start, end, self.compiled, solution, system, self.stops.rested, tuple(sorted(self.separated)))

    def _simulation(self, segments: Sequence[MotionSegment], evaluations: int, entries: LogEntries) -> Simulation:
        method = "radau" if self.method == "radau" else "gauss"
        facts = entries.events, method, self.tolerance, evaluations, entries.lost
        return Simulation(self.original, tuple(segments), *facts, self.stops.stops, entries.work, self.separable_cams)

    def _meet_stops(self, t: float, q: Real, v: Real) -> tuple[Real, Real]:
        """Coordinates and rates after the impacts and contacts at the stops that are touched at an instant."""
        if self.separation is not None:
            for stop in self.stops.approached(q, v, t, self._system()):
                q, v = self._part(t, q, v, stop)
        now = self.stops.rests, v

        def equations(rests: tuple[str, ...], rates: Real) -> System:
            if rests == now[0] and rates is now[1]:
                return self._system()
            dry = self.friction.equations_of(self.compiled, q, rates, t, rests=rests)
            return Chart(self.compiled, rests) if dry is None else dry

        after, changed = self.stops.resolve_impacts(q, v, t, equations)
        self.watch.record_jumps(t, q, v, after)
        return q, self._settle(t, q, after) if changed else after

    def _system(self) -> System:
        """The equations of motion of the present segment."""
        dry = self.friction.system()
        if dry is not None:
            return dry
        return Chart(self.compiled, self.stops.rests) if self.stops.closed else self.chart.system

    def _settle(self, t: float, q: Real, v: Real, loose: tuple[int, float] | None = None) -> Real:
        """Decide which elements slide and which stick from now on; speeds after it."""
        return self.friction.settle(t, q, v, self.stops.rests, loose)

    # -- cams that followers may leave --------------------------------------------------------------------------------
    def _contact_events(self, t: float) -> list[PossibleEvent]:
        """The ends of contact or flight of every cam and follower."""
        separation = self.separation
        out: list[PossibleEvent] = []
        if separation is None:
            return out
        for name, contact in separation.contacts.items():
            away = name in self.separated
            noise = TOUCH_DISTANCE * (1.0 if contact.rotary else self.compiled.model.length_scale) if away else 0.0
            function = separation.overlap(name, self.separated) if away else self._parting(name)

            def find(window: Window, function: EventFunction = function, limit: float = noise, again: bool = away) -> float | None:
                return first_beyond(function, window, t, limit, separation.samples(self.compiled, window), again=again)

            out.append(PossibleEvent(find, partial(self._land_or_let_go, name)))
        return out

    def _parting(self, name: str) -> EventFunction:
        """Positive where a cam in contact would have to pull."""
        assert self.separation is not None
        if not self.friction.counts:
            return self.separation.parting(name, self.separated)
        system = self._system()
        resting = self.stops.rested

        def pulling(q: Real, v: Real, t: Real) -> Real:
            motion = motion_at(self.compiled, q, v, t, system(q, v, t))
            return -pressing(motion, segment_forces(motion, system, q, v, resting), name)

        return pulling

    def _land_or_let_go(self, name: str, t: float, q: Real, v: Real) -> tuple[Real, Real]:
        return self._land(t, q, v, name) if name in self.separated else self._let_go(t, q, v, name)

    def _let_go(self, t: float, q: Real, v: Real, name: str | None = None) -> tuple[Real, Real]:
        """Separate followers that their cams would have to pull, and in any case that of ``name``; coordinates and rates after
        it."""
        if self.separation is None:
            return q, v
        for cam in self.separation.contacts:
            if cam in self.separated:
                continue
            if cam != name and not float(self._parting(cam)(q[None], v[None], np.array([t]))[0]) > 0.0:
                continue
            where = self.separation.cam_position_words(cam, self.compiled, q, v, t)
            more = self.separated | {cam}
            compiled, q, v = self.separation.compiled(more, q, v, t, cam)
            self.separated = more
            self._use_chart(compiled)
            self.log.add(SimulationEvent(t, EventKind.SEPARATION, cam, f"contact lost at {where}"))
            self.friction.begin(self.compiled, t, q, v)
            v = self._settle(t, q, v)
        return q, v

    def _part(self, t: float, q: Real, v: Real, stop: EndStop) -> tuple[Real, Real]:
        """Separate a follower that a stop holds from its cam, which moves away; coordinates and rates after it."""
        sense = -1.0 if stop.side == "upper" else 1.0
        for name, contact in {} if self.separation is None else self.separation.contacts.items():
            if name not in self.separated and contact.guide == stop.joint and contact.away == sense:
                q, v = self._let_go(t, q, v, name)
        return q, v

    def _land(self, t: float, q: Real, v: Real, name: str) -> tuple[Real, Real]:
        """Impact of a follower that returns to its cam: it bounces or stays; coordinates and rates after it."""
        assert self.separation is not None
        e = self.separation.contacts[name].restitution
        k, fewer = self.separation.coordinate_number(name, self.separated), self.separated - {name}
        rebound, hit, lost = self.separation.landing(name, self.separated, t, q, v, e)
        held = np.delete(q, k)
        stay, _, all_lost = self.separation.landing(name, self.separated, t, q, v, 0.0)
        pull = self._pulled(t, name, fewer, held, np.delete(stay, k))
        stays = pull <= 0.0 and 2.0 * e * hit <= -pull * LEAST_BOUNCE * self.duration
        energy_lost = all_lost if stays else lost
        account_for_impact(self.log, self.compiled, t, q, v, stay if stays else rebound, energy_lost)
        self.watch.record_jumps(t, q, v, stay if stays else rebound)
        where = self.separation.cam_position_words(name, self.compiled, q, v, t)
        pace = as_quantity(hit, "angular speed" if self.separation.contacts[name].rotary else "linear speed", 4)
        what = "contact regained" if stays else "bounces"
        kind = EventKind.LANDING if stays else EventKind.IMPACT
        self.log.add(SimulationEvent(t, kind, name, f"{what} at {where}, hit at {pace}"))
        if not stays:
            return q, self._settle(t, q, rebound)
        self.separated = fewer
        compiled = self.separation.compiled_by_separated[fewer]
        reenter(compiled, held, t, motion_at(self.compiled, q[None], v[None], np.array([t])))
        self._use_chart(compiled)
        v = np.delete(stay, k)
        self.friction.begin(self.compiled, t, held, v)
        return held, self._settle(t, held, v)

    def _pulled(self, t: float, name: str, fewer: frozenset[str], q: Real, v: Real) -> float:
        """The gap's acceleration if a follower that has returned were released again: positive where it would separate."""
        assert self.separation is not None
        friction = partial(self.friction.equations_of, rests=self.stops.rests)
        return float(self.separation.parting(name, fewer, friction)(q[None], v[None], np.array([t]))[0])
