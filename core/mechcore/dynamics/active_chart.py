"""The coordinate chart in which a motion under forces is currently integrated, and the change to the next chart."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from mechcore.arrays import Real
from mechcore.branches.paths import Waypoint
from mechcore.dynamics.equations.charts import (
    STRAINED_RATE,
    Chart,
    CurveChart,
    best_chart,
    curve_around,
    strain,
    take_over,
    waypoints,
)
from mechcore.dynamics.equations.curve import CurveEquations
from mechcore.dynamics.equations.reduced import integrating
from mechcore.dynamics.events import EventFunction
from mechcore.dynamics.integration.collocation import Window
from mechcore.dynamics.integration.windows import Solution
from mechcore.dynamics.segments import MotionSegment, breakpoint_finder
from mechcore.errors import Fault, MechanismError
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled

LOST_DIGITS_RATE = 20.0  # as `STRAINED_RATE`; above it a change of chart loses digits, so it is made before
WINDOW_HALVINGS = 10  # bisections of a window that locate this rate
DEAD_POINT_RATE = 50.0  # joint rate per unit rate of the coordinates, above which these are at a dead point
CALM_RATE = 0.4  # part of `STRAINED_RATE`: below it, the strain is not checked for some windows
CALM_WINDOWS = 2  # number of these windows
WAYPOINTS = np.linspace(0.25, 1.0, 4)  # parts of a window


def table_tolerance(tolerance: float) -> float:
    """Relative tolerance of the tables of a motion: tighter than its own, as table errors add up over turns and digits cost
    little."""
    return min(max(1e-4 * tolerance, 1e-13), 1e-9)


class ActiveChart:
    """The mechanism ``compiled`` in its present chart, with the ``system`` of its equations of motion and the range of its
    coordinate in which they hold.

    ``coordinates``: the number of each free joint's coordinate; ``scale`` (f,) of all that is integrated, rad or m; ``boundaries``:
    event functions that become positive where the chart ends. ``tables``: charts of one coordinate that have been tabulated.
    ``may_change``: the motion may change to other coordinates.
    """

    def __init__(
        self,
        compiled: Compiled,
        system: tuple[Chart | CurveEquations, tuple[float, float] | None],
        duration: float,
        tolerance: float,
        *,
        may_change: bool,
    ):
        self.duration, self.tolerance = duration, tolerance
        self.use(compiled, *system)
        self.tables = [CurveChart(compiled, *system)] if isinstance(system[0], CurveEquations) else []
        several = may_change and self.coordinates and not self.tables and compiled.model.loops
        self._taken = [compiled] if several else []  # charts used so far, if the chart may change
        self._calm = 0  # windows left in which the strain need not be checked

    def use(self, compiled: Compiled, system: Chart | CurveEquations, valid_range: tuple[float, float] | None = None) -> None:
        """Continue in the chart of ``compiled``, while its coordinate stays within ``valid_range``."""
        self.compiled, self.system, self.breakpoints = compiled, system, breakpoint_finder(compiled)
        free = [d for d in compiled.mechanism.drives if isinstance(d.law, Free)]
        model = compiled.model
        self.coordinates = {d.joint: i for i, d in enumerate(free)}
        angle = [model.joints[model.joint_index[d.joint]].coordinate == "angle" for d in free]
        self.scale = np.array([*(1.0 if a else model.length_scale for a in angle), *(1.0 for _ in integrating(compiled))])
        self.boundaries: list[EventFunction] = []
        if valid_range is not None:
            low, high = valid_range
            self.boundaries = [lambda q, v, t: q[:, 0] - high, lambda q, v, t: low - q[:, 0]]

    def ends_at(self, q: Real, v: Real) -> bool:
        """Whether the chart ends at q, v (f,)."""
        return any(float(boundary(q[None], v[None], np.zeros(1))[0]) >= 0.0 for boundary in self.boundaries)

    # -- the next chart -----------------------------------------------------------------------------------------------
    def take_over(self, q: Real, v: Real, before: tuple[float, float]) -> tuple[Real, Real]:
        """Change to the coordinate of the joint that moves most; returns coordinates and rates (f,) in its chart. ``before``:
        position and speed at the beginning of the segment. The rate follows from equal kinetic energies in both tables, because
        rates next to a dead point lose digits."""
        chart, place, rate = best_chart(self.compiled, float(q[0]), float(v[0]), self.tables, table_tolerance(self.tolerance))
        tables = [known.curve.table for known in self.tables if isinstance(known.curve, CurveEquations)]
        if isinstance(chart.curve, CurveEquations) and all(chart.curve.table is not table for table in tables):
            self.tables.append(chart)
        if isinstance(chart.curve, CurveEquations) and isinstance(self.system, CurveEquations):
            energy = self.system.kinetic_energy(float(q[0]), float(v[0]), before)
            rate = float(np.copysign(np.sqrt(2.0 * energy / chart.curve.inertia(place)), rate))
        self.use(chart.compiled, chart.curve, chart.valid_range)
        return np.array([place]), np.array([rate])

    def leads_through(self, windows: Sequence[Window]) -> bool:
        """Whether ``windows`` are known to be free of strain: the coordinates remain well conditioned in all of them."""
        return not self._taken or all(w.strain is not None and w.strain <= STRAINED_RATE for w in windows)

    def time_to_leave(self, window: Window) -> float | None:
        """The time to change to other coordinates [s]; None while these remain well conditioned. It is the end of the window, or an
        earlier time at which the coordinates come too close to a dead point."""
        if not self._taken:
            return None
        t = window.start + window.length
        self._calm -= 1
        if self._calm >= 0 or t >= self.duration * (1.0 - 1e-9):
            return None

        program = self.system.program() if isinstance(self.system, Chart) else None

        def strained(t: float, q: Real, v: Real) -> float:
            known = program is not None and not program.partial
            return program.strain(q[None], v[None], np.array([t])) if program and known else strain(self.compiled, q, v, t)

        def at(t: float) -> float:
            q, v, _ = window(np.array([t]))
            return strained(t, q[0], v[0])

        largest = strained(t, *window.end()) if window.strain is None else window.strain
        self._calm = CALM_WINDOWS if largest < CALM_RATE * STRAINED_RATE else 0
        if largest <= LOST_DIGITS_RATE or strained(window.start, window.q, window.v) > STRAINED_RATE:
            return t if largest > STRAINED_RATE else None
        low, high = window.start, t
        for _ in range(WINDOW_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if at(middle) <= LOST_DIGITS_RATE else (low, middle)
        return low if low > window.start else t

    def change(self, t: float, q: Real, v: Real) -> tuple[Real, Real] | None:
        """Change to a better conditioned chart; returns coordinates and rates (f,) in it, None if there is none. Raises
        `MechanismError` at a dead point of all charts."""
        taken = take_over(self.compiled, q, v, t, self._taken)
        if taken is None:
            if strain(self.compiled, q, v, t) > DEAD_POINT_RATE:
                where = ", ".join(self.coordinates)
                why = f"at t = {t:.6g} s {where} come to a dead point: they do not decide where the mechanism goes on."
                raise MechanismError(Fault("dynamics", why, "Give the free start at other joints."))
            return None
        f, (compiled, *fresh) = len(self.coordinates), taken
        q, v = (np.append(x, old[f:]) for x, old in zip(fresh, (q, v), strict=True))
        if all(compiled.model is not c.model for c in self._taken):
            self._taken.append(compiled)
        self.use(compiled, Chart(compiled))
        self._calm = 0
        return q, v

    def tabulate(self, q: Real, v: Real) -> tuple[Real, Real]:
        """Tabulate the configuration curve around q (f,) and continue on the table; returns coordinates and rates (f,)."""
        system, valid_range = curve_around(self.compiled, float(q[0]), table_tolerance(self.tolerance))
        self.use(self.compiled, system, valid_range)
        self.tables = [CurveChart(self.compiled, system, valid_range)] if isinstance(system, CurveEquations) else []
        self._taken = []
        return self.take_over(q, v, (float(q[0]), float(v[0]))) if self.ends_at(q, v) else (q, v)

    # -- waypoints of the motion, from which the angles of the links are unwrapped -------------------------------------
    def leave_waypoint(self, q: Real, t: float) -> None:
        """Record that the motion is at q (f,) at time t [s]."""
        if len(self.compiled.mechanism.drives) > 1:
            self.compiled.angles.path.leave(waypoints(self.compiled, q[None], np.array([t])))

    def leave_waypoints_within(self, windows: Sequence[Window]) -> None:
        """Record that the motion passes through ``windows``; their waypoints are evaluated on demand."""
        if len(self.compiled.mechanism.drives) > 1:
            self.compiled.angles.path.leave_later(windows, partial(_within_windows, self.compiled))

    def leave_waypoints_of(self, segments: Sequence[MotionSegment]) -> None:
        """Record that the motion passes through ``segments``; their waypoints are evaluated on demand."""
        if len(self.compiled.mechanism.drives) > 1:
            self.compiled.angles.path.leave_later(segments, partial(_within_segments, self.compiled))


def _within_windows(compiled: Compiled, windows: Sequence[Window]) -> list[Waypoint]:
    """Waypoints within windows, in order."""
    t = np.concatenate([w.start + w.length * WAYPOINTS for w in windows])
    return waypoints(compiled, Solution(list(windows))(t)[0], t)


def _within_segments(compiled: Compiled, segments: Sequence[MotionSegment]) -> list[Waypoint]:
    """Waypoints within segments, in order, those of their windows."""
    out: list[Waypoint] = []
    for segment in segments:
        assert isinstance(segment.solution, Solution)
        t = np.concatenate([w.start + min(w.length, segment.end - w.start) * WAYPOINTS for w in segment.solution.windows])
        out += waypoints(compiled, segment.solution(t)[0], t)
    return out
