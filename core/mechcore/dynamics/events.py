"""Events in the course of a motion: stops that are hit, values that are passed, ends that are reached."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from mechcore.arrays import Real
from mechcore.motion.motion import Motion
from mechcore.records import dataclass
from mechcore.spec.mechanism import Mechanism
from mechcore.texts import Text, as_coordinate, as_quantity

if TYPE_CHECKING:
    from mechcore.dynamics.integration.collocation import Window

WINDOW_SAMPLES = 25  # of a window, in which an event function is a polynomial to rounding or nearly so
_X = np.cos(np.pi * (np.arange(WINDOW_SAMPLES) + 0.5) / WINDOW_SAMPLES)[::-1]
_PLACES = np.concatenate([_X, [-1.0, 1.0]])
_FIT = np.linalg.inv(chebyshev.chebvander(_X, WINDOW_SAMPLES - 1))
MOST_EVALUATIONS = 12  # evaluations at a zero, at most: next to a kink the polynomial is a poor guess of it

EventFunction = Callable[[Real, Real, Real], Real]
"""A quantity as a function of positions (n, f), speeds (n, f), times (n,) -> (n,)."""
Reaction = Callable[[float, Real, Real], tuple[Real, Real]]
"""From the time [s] of an event, coordinates and rates (f,) there to those after it."""


class PossibleEvent(NamedTuple):
    """A possible event of a segment: ``find`` gives the first time in a window, or None; ``react`` what follows from it."""

    find: Callable[[Window], float | None]
    react: Reaction


@dataclass(frozen=True, kw_only=True)
class EndStop:
    """An end stop of a joint: its coordinate cannot pass ``at`` [rad or m]. ``side`` "upper": it stays below, "lower": above.

    ``restitution`` (0 to 1) is Newton's coefficient: relative speed after the impact over that before.
    """

    name: str
    joint: str
    at: float
    side: Literal["upper", "lower"] = "upper"
    restitution: float = 0.0


def with_slot_ends(mechanism: Mechanism, stops: Sequence[EndStop]) -> tuple[EndStop, ...]:
    """``stops`` and the ends of a mechanism's slots, guides and cylinders, except ends that a stated stop precedes."""
    all_stops = list(stops)
    for name, (low, high) in mechanism.ends.items():
        own = [s for s in stops if s.joint == name]
        if not any(s.side == "lower" and s.at >= low for s in own):
            all_stops.append(EndStop(name=f"{name} lower end", joint=name, at=low, side="lower"))
        if not any(s.side == "upper" and s.at <= high for s in own):
            all_stops.append(EndStop(name=f"{name} upper end", joint=name, at=high))
    return tuple(all_stops)


@dataclass(frozen=True, kw_only=True)
class SeparableCam:
    """A cam ``joint`` whose follower may leave it; ``restitution`` (0 to 1) of the impact when it returns (Newton)."""

    joint: str
    restitution: float = 0.0


@dataclass(frozen=True, kw_only=True)
class EventTrigger:
    """A value whose passage is an event: ``of`` "position" or "velocity" of a ``joint``, or "x", "y" of a ``point`` (link, point),
    passes ``at``.

    ``rising`` True or False: only in that direction. ``ends``: the motion ends there.
    """

    name: str
    of: Literal["position", "velocity", "x", "y"] = "position"
    joint: str | None = None
    point: tuple[str, str] | None = None
    at: float = 0.0
    rising: bool | None = None
    ends: bool = False

    def passed(self, *, rotary: bool) -> str:
        """The passage in words; ``rotary``: the joint turns."""
        what = self.joint if self.joint is not None else ".".join(self.point or ())
        if self.of == "velocity":
            return f"velocity of {what} passes {as_quantity(self.at, 'angular speed' if rotary else 'linear speed')}"
        return f"{self.of} of {what} passes {as_coordinate(self.at, rotary=rotary)}"


class EventKind(StrEnum):
    """Kinds of events of a simulation; the values are their names in exports and recordings."""

    IMPACT = "impact"
    CONTACT = "contact"  # of a joint with an end stop, on which it rests from then on
    RELEASE = "release"  # of a joint from an end stop
    SEPARATION = "lost"  # of a follower from its cam
    LANDING = "regained"  # of a follower on its cam, without a bounce
    STICK = "stick"
    SLIP = "slip"
    TRIGGER = "watch"
    END = "end"  # by a trigger that ends the motion
    EQUILIBRIUM = "equilibrium"
    STIFF = "stiff"


@dataclass(frozen=True)
class SimulationEvent:
    """An event: when [s], what kind, of which item, in words; ``direction`` of a slip: 1 or -1, the sign of the relative speed."""

    time: float
    kind: EventKind
    item: str
    text: str
    direction: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "text", Text.of(self.text))


def event_function_of(
    trigger: EventTrigger | EndStop, coordinates: dict[str, int], motion_at: Callable[[Real, Real, Real], Motion]
) -> EventFunction:
    """Event function of an end stop or a trigger: its quantity minus its limit; free coordinates are read directly, other
    quantities are computed from the motion."""
    of = trigger.of if isinstance(trigger, EventTrigger) else "position"
    if trigger.joint in coordinates and of in ("position", "velocity"):
        i = coordinates[trigger.joint]
        return lambda q, v, t: (q if of == "position" else v)[:, i] - trigger.at

    def measured(q: Real, v: Real, t: Real) -> Real:
        motion = motion_at(q, v, t)
        value: Real
        if of in ("position", "velocity"):
            assert trigger.joint is not None
            value = motion.coordinate(trigger.joint)[:, 0 if of == "position" else 1]
        else:
            assert isinstance(trigger, EventTrigger) and trigger.point is not None
            value = motion.point(*trigger.point)[:, 0 if of == "x" else 1]
        return np.asarray(value) - trigger.at

    return measured


def first_zero(event_function: EventFunction, window: Window, after: float, rising: bool | None) -> float | None:
    """The first time in a window, later than ``after`` [s], at which an event function passes zero; None where it does not."""
    low, high = max(window.start, after), window.start + window.length
    if high - low <= 0:
        return None

    def at(x: Real) -> Real:
        t = low + 0.5 * (high - low) * (x + 1.0)
        q, v, _ = window(t)
        return event_function(q, v, t)

    y, ends = np.split(at(_PLACES), [WINDOW_SAMPLES])
    size = float(np.abs(y).max())
    if size == 0.0 or (np.abs(np.diff(y)).sum() < abs(y[0]) and np.all(np.sign(np.append(y, ends)) == np.sign(y[0]))):
        return None  # stays away from zero: its variation in the window is less than its distance from zero
    coefficients = _FIT @ y
    roots = chebyshev.chebroots(chebyshev.chebtrim(coefficients, 1e-15 * size))
    real = np.sort(roots[(np.abs(roots.imag) < 1e-7) & (np.abs(roots.real) <= 1.0 + 1e-9)].real)
    slope = chebyshev.chebder(coefficients)
    for x in real:
        x = _polished(at, float(x), float(chebyshev.chebval(x, slope)), 4.0 * np.spacing(max(abs(low), abs(high))) / (high - low))
        if not -1.0 - 1e-12 <= x <= 1.0 + 1e-12:
            continue
        going = float(chebyshev.chebval(x, slope))
        if rising is None or (going > 0) == rising:
            time = low + 0.5 * (high - low) * (float(x) + 1.0)
            if time > after:
                return time
    return None


def first_exceeding(event_function: EventFunction, window: Window, after: float, noise: float) -> float | None:
    """The time in a window, not before ``after`` [s], at which an event function passes zero for the first time to exceed
    ``noise``; just after the beginning, where it has jumped above zero there. None where it does not."""
    low, high = max(window.start, after), window.start + window.length
    if high - low <= 0:
        return None

    def at(x: Real) -> Real:
        t = low + 0.5 * (high - low) * (x + 1.0)
        q, v, _ = window(t)
        return event_function(q, v, t)

    y, ends = np.split(at(_PLACES), [WINDOW_SAMPLES])
    size = float(np.abs(y).max())
    if max(float(y.max()), *ends) <= 0.0 and np.abs(np.diff(y)).sum() < -y[0]:
        return None  # stays below zero: its variation in the window is less than its distance from zero
    coefficients = chebyshev.chebtrim(_FIT @ y, 1e-15 * size)
    slope = chebyshev.chebder(coefficients)
    zeros, peaks = _real_roots(coefficients), _real_roots(slope)
    boundaries = np.array([-1.0, *zeros, 1.0])
    for x, end in pairwise(boundaries):
        between = np.array([0.5 * (x + end), end, *peaks[(peaks > x) & (peaks < end)]])
        if float(chebyshev.chebval(between, coefficients).max()) <= noise:
            continue
        least = 4.0 * float(np.spacing(max(abs(low), abs(high))))
        if x > -1.0:
            x = float(np.clip(_polished(at, float(x), float(chebyshev.chebval(x, slope)), least / (high - low)), -1.0, end))
        return float(low + max(0.5 * (high - low) * (x + 1.0), 2.0 * least if x == -1.0 else 0.0))
    return None


def _real_roots(coefficients: NDArray[np.floating[Any]]) -> Real:
    """Roots (k,) of a Chebyshev series between -1 and 1, in order."""
    roots = chebyshev.chebroots(coefficients)
    return np.sort(roots[(np.abs(roots.imag) < 1e-7) & (np.abs(roots.real) < 1.0)].real)


def _polished(at: Callable[[Real], Real], x: float, slope: float, least: float) -> float:
    """A zero of an event function, from one of its polynomial at x and the slope there: secants until steps are below
    ``least``, or no smaller than those before."""
    last, before = np.inf, None
    for _ in range(MOST_EVALUATIONS):
        y = float(at(np.array([x]))[0])
        if before is not None and x != before[0] and y != before[1]:
            secant = (y - before[1]) / (x - before[0])
            slope = secant if secant * slope > 0.0 else slope
        if slope == 0.0 or not np.isfinite(y):
            return x
        step = y / slope
        if not abs(step) < last:
            return x
        before, last, x = (x, y), abs(step), x - step
        if last <= least:
            return x
    return x


@dataclass(frozen=True)
class LogEntries:
    """Events; by impact the time and the energy [J] that is ``lost``, and the time and the ``work`` [J] of prescribed drives."""

    events: tuple[SimulationEvent, ...]
    lost: tuple[tuple[float, float], ...]
    work: tuple[tuple[float, float], ...]


class Log:
    """Events and impacts in order of time; `new_entries` are those added since its last call."""

    def __init__(self) -> None:
        self.events: list[SimulationEvent] = []
        self._lost: list[tuple[float, float]] = []
        self._work: list[tuple[float, float]] = []
        self._read = (0, 0, 0)

    def add(self, event: SimulationEvent) -> None:
        self.events.append(event)

    def add_loss(self, t: float, energy: float) -> None:
        """Account for the energy [J] that is lost in an impact."""
        self._lost.append((t, energy))

    def add_work(self, t: float, work: float) -> None:
        """Account for the work [J] of prescribed drives in an impact."""
        self._work.append((t, work))

    def all_entries(self) -> LogEntries:
        return self._since(0, 0, 0)

    def new_entries(self) -> LogEntries:
        """Entries since the last call."""
        since, self._read = self._read, (len(self.events), len(self._lost), len(self._work))
        return self._since(*since)

    def _since(self, a: int, b: int, c: int) -> LogEntries:
        return LogEntries(tuple(self.events[a:]), tuple(self._lost[b:]), tuple(self._work[c:]))
