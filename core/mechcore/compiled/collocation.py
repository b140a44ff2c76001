"""Equations of motion as a compiled program, with the windows of collocation around them: `collocation.c` from Python."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache, cached_property, lru_cache
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from mechcore.arrays import Index, Real
from mechcore.compiled.kernels import address
from mechcore.compiled.operands import Operand
from mechcore.compiled.symbols import HELPERS, Code
from mechcore.compiled.toolchain import MOST_LIBRARIES, library

AROUND, PHASES = (Path(__file__).with_name(name) for name in ("collocation.c", "phases.c"))
HEAD = 10  # numbers before the coordinates in the array that describes the start of windows, see `collocation.c`
REDUCED = """
#define F {freedoms}
#define STATES {states}
#define ANGLES {angles}
#define DRIVES {drives}
#define GIVEN {given}
#define MARGIN {margin!r}
#define RATIOS {count}
#define FORMS {kinds}
#define ADDITIONAL {additional}

static void reduced(const double *p, const double *m, const double *q, const double *v, double t, const double *d, double *near,
                    double *out) {{
    const double *w = d + {drives}; /* values of functions of the time */
    (void)p, (void)m, (void)q, (void)v, (void)t, (void)d, (void)w, (void)near;
    {lines}
}}

static void ratios(const double *p, const double *m, const double *q, const double *v, double t, const double *d,
                   const double *near, double *out) {{
    const double *w = d + {drives};
    (void)p, (void)m, (void)q, (void)v, (void)t, (void)d, (void)w, (void)near;
    {rates}
}}

static void forms(const double *p, const double *m, const double *q, const double *v, double t, const double *d,
                  const double *near, double *out) {{
    const double *w = d + {drives};
    (void)p, (void)m, (void)q, (void)v, (void)t, (void)d, (void)w, (void)near;
    {forms}
}}
"""


class CollocationRule(Protocol):
    """Nodes (s,) of a window, and matrices (s, s) that integrate values at the nodes once and twice, and give Legendre
    coefficients."""

    @property
    def nodes(self) -> Real: ...
    @property
    def integral(self) -> Real: ...
    @property
    def double_integral(self) -> Real: ...
    @property
    def legendre(self) -> Real: ...


class WindowTrial(NamedTuple):
    """A window to be solved: from ``start`` [s] over ``length`` [s], ``q``, ``v`` (f,) at its start, a ``guess`` (s, f) of the
    accelerations at its nodes. ``tolerance``: absolute, of the remaining error of the positions, in units of q."""

    start: float
    length: float
    q: Real
    v: Real
    guess: Real
    tolerance: float


class BatchLimits(NamedTuple):
    """Limits of consecutive windows: their ``end``, the ``shortest`` and the ``longest`` window [s], the ``tolerance``, and that of
    Newton's method. There are ``most`` windows or fewer; they end at the times ``breaks`` (k,) [s] and, if that is ``checked``,
    where laws change their forms."""

    end: float
    shortest: float
    longest: float
    tolerance: float
    newton_tolerance: float
    most: int
    checked: bool
    breaks: Real

    @property
    def bounds(self) -> tuple[float, ...]:
        """The five numbers in the order of `collocation.c`."""
        return self[:5]

    @property
    def breaks_to_infinity(self) -> Real:
        """Times (k + 1,) [s], as `collocation.c` reads them: the last one is never reached."""
        return np.append(self.breaks, np.inf)


class WindowBatch(NamedTuple):
    """Consecutive windows: ``starts``, ``lengths`` (w,) [s], position and speed ``q``, ``v`` (w, f) at the starts, Legendre
    coefficients ``a`` (w, s, f) of the accelerations; ``strain`` (w,) at their ends; ``cut`` (w,), whether they end at a
    breakpoint; ``stuck``: after the last one, no window is short enough."""

    starts: Real
    lengths: Real
    q: Real
    v: Real
    a: Real
    strain: Real
    cut: Real
    stuck: bool


class ContactCounts(NamedTuple):
    """Numbers of friction elements, of joints that rest on stops, and of joints with stops whose coordinates are known, see
    `phases.c`."""

    elements: int
    rests: int
    stopped: int


class PhaseBatch(NamedTuple):
    """Phases of a motion with contacts: the data of `phases.c` about each in ``marks`` (p, 8), the ``signs`` (p + 1, e) of the
    elements in each and after them, and their ``windows``."""

    marks: Real
    signs: Real
    windows: WindowBatch


class WrittenEquations:
    """Reduced equations of motion in C. ``outputs``: the lower triangle of M, row by row, then Q - h, then rates of states; angles
    that are followed; ratios of rates of joints to those of the coordinates; forms of laws that have several;
    additional outputs.

    They are computed from inputs that C calls ``q[k]``, ``v[k]``, ``t``, modes ``m[k]``, ``given`` values ``d[k]`` of prescribed
    drives, and angles ``near[k]`` from which the ``angles`` are followed; values of functions `of_time` come after those of drives.
    ``freedoms``: numbers of coordinates and of states. ``contacts``: those that the additional outputs describe.
    """

    def __init__(
        self,
        code: Code,
        outputs: tuple[Sequence[Operand], ...],
        freedoms: tuple[int, int],
        given: int,
        contacts: ContactCounts | None,
        margin: float,
    ):
        equations, angles, ratios, forms, additional = outputs
        equations = [*equations, *additional]
        self.parameters: list[float] = []
        self.coordinates = freedoms[0]
        self.freedoms, self.given, self.angles = sum(freedoms), given + len(code.of_time), len(angles)
        self.of_time = tuple(code.of_time)
        targets = [*((f"out[{k}]", x) for k, x in enumerate(equations)), *((f"near[{k}]", x) for k, x in enumerate(angles))]
        lines = code.written(targets, self.parameters)
        self.lines = len(lines)
        rates = code.written([(f"out[{k}]", x) for k, x in enumerate(ratios)], self.parameters)
        whole = code.written([(f"out[{k}]", x) for k, x in enumerate(forms)], self.parameters)
        self.forms, self.additional = len(forms), len(additional)
        own = REDUCED.format(
            freedoms=freedoms[0],
            states=freedoms[1],
            angles=len(angles),
            drives=given,
            given=self.given,
            margin=margin,
            count=len(ratios),
            kinds=len(forms),
            additional=len(additional),
            forms="\n    ".join(whole),
            lines="\n    ".join(lines),
            rates="\n    ".join(rates),
        )
        self._own, self.contacts = own, contacts

    @cached_property
    def source(self) -> str:
        """The whole program."""
        whole = HELPERS + self._own + AROUND.read_text(encoding="utf-8")
        if self.contacts is None:
            return whole
        counts = "".join(f"#define {name.upper()} {count}\n" for name, count in self.contacts._asdict().items())
        return whole + counts + PHASES.read_text(encoding="utf-8")


class _System(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_long) for name in ("f", "given", "angles")),
        *((name, ctypes.c_void_p) for name in ("p", "m", "scale", "laws")),
    ]


class _Rule(ctypes.Structure):
    _fields_ = [("s", ctypes.c_long), *((name, ctypes.c_void_p) for name in ("nodes", "once", "twice", "legendre"))]


@lru_cache(MOST_LIBRARIES)
def _functions(loaded: ctypes.CDLL) -> ctypes.CDLL:
    """A library with declared return types of its functions."""
    loaded.window.restype = loaded.windows.restype = ctypes.c_long
    if hasattr(loaded, "phases"):
        loaded.phases.restype = ctypes.c_long
    for function in ("evaluated", "formed", "reduced_at", "strained_at", "resting"):
        getattr(loaded, function).restype = None
    return loaded


def _at(x: Real) -> ctypes.c_void_p:
    return ctypes.c_void_p(address(x) if x.size else x.__array_interface__["data"][0])


@cache
def lower_triangle(k: int) -> tuple[Index, Index]:
    """Rows and columns of a lower triangle (k, k)."""
    i, j = np.tril_indices(k)
    return i, j


_RULES: dict[int, tuple[Any, ...]] = {}  # rules in C, by the id of the object that has the matrices


class CompiledEquations:
    """Equations of motion ready to run, at assembly modes (b,), for coordinates with typical sizes ``scale`` (f,).

    ``laws``: of the drives and then of functions of time, if C has them all; None where their values are inputs. Raises
    `MechanismError` where they cannot be compiled.
    """

    def __init__(
        self,
        written: WrittenEquations,
        modes: Sequence[float],
        scale: Sequence[float],
        laws: Sequence[Sequence[float]] | None = None,
    ):
        self.freedoms, self.given, self.angles = written.freedoms, written.given, written.angles
        self._loaded = _functions(library(written.source))
        self.coordinates = written.coordinates
        self.kinds, self._additional = written.forms, written.additional
        starts = accumulate(map(len, laws[:-1]), initial=len(laws)) if laws else ()
        given = written.parameters, modes, scale, [*starts, *(x for law in laws or () for x in law)]
        self._kept: list[Real] = [np.array(x or [0.0], float) for x in given]
        self.modes = self._kept[1]
        self._system = ctypes.byref(_System(self.freedoms, self.given, self.angles, *map(address, self._kept)))

    def strain(self, q: Real, v: Real, t: Real, d: Real, near: Real) -> Real:
        """Largest ratio of a joint's rate to that of a coordinate (n,), arguments as of `accelerations`."""
        given = [np.ascontiguousarray(x, float) for x in (q, v, t, d, near)]
        out = np.empty(len(t))
        self._loaded.strained_at(self._system, ctypes.c_long(len(t)), *(_at(x) for x in given), _at(out))
        return out

    def forms(self, q: Real, v: Real, t: Real, d: Real) -> Real:
        """Forms of laws (n, k) at coordinates and rates (n, f), times (n,), values of drives (n, g); no angle is followed."""
        given = [np.ascontiguousarray(x, float) for x in (q, v, t, d)]
        out = np.empty((len(t), self.kinds))
        self._loaded.formed(self._system, ctypes.c_long(len(t)), *(_at(x) for x in given), _at(out))
        return out

    def reduced(self, q: Real, v: Real, t: Real, d: Real, near: Real) -> tuple[Real, Real]:
        """M (n, k, k) and Q - h (n, k) of the k coordinates without the states, arguments as of `accelerations`."""
        k, (i, j) = self.coordinates, lower_triangle(self.coordinates)
        rest = self._rows(q, v, t, d, near)
        inertia = np.empty((len(t), k, k))
        inertia[:, i, j] = inertia[:, j, i] = rest[:, : len(i)]
        return inertia, rest[:, len(i) : len(i) + k]

    def at_rest(self, q: Real, modes: Real) -> Real:
        """M, Q - h and the `strain` at a unit rate (n, 3), at positions (n,) of the only coordinate, each with its own assembly
        modes (n, b); no angle is followed, and there are no prescribed drives."""
        out = np.empty((len(q), 3))
        modes = np.ascontiguousarray(modes, float)
        self._loaded.resting(self._system, ctypes.c_long(len(q)), _at(q), _at(modes), ctypes.c_long(modes.shape[1]), _at(out))
        return out

    def outputs(self, q: Real, v: Real, t: Real, d: Real, near: Real) -> tuple[Real, Real]:
        """Q - h and rates of states (n, f), which are accelerations where M is the identity, and additional outputs (n, k)."""
        rest, k = self._rows(q, v, t, d, near), len(lower_triangle(self.coordinates)[0])
        return rest[:, k : k + self.freedoms], rest[:, k + self.freedoms :]

    def _rows(self, *at: Real) -> Real:
        given = [np.ascontiguousarray(x, float) for x in at]
        out = np.empty((len(at[2]), len(lower_triangle(self.coordinates)[0]) + self.freedoms + self._additional))
        self._loaded.reduced_at(self._system, ctypes.c_long(len(out)), *(_at(x) for x in given), _at(out))
        return out

    def accelerations(self, q: Real, v: Real, t: Real, d: Real, near: Real) -> Real:
        """Accelerations (n, f) at coordinates and rates (n, f), times (n,), values of drives (n, g) and near the angles (a,)."""
        given = [np.ascontiguousarray(x, float) for x in (q, v, t, d, near)]
        out = np.empty((len(t), self.freedoms))
        self._loaded.evaluated(self._system, ctypes.c_long(len(t)), *(_at(x) for x in given), _at(out))
        return out

    def _rule(self, rule: CollocationRule) -> Any:
        known = _RULES.get(id(rule))
        if known is None:
            kept = [np.ascontiguousarray(x, float) for x in (rule.nodes, rule.integral, rule.double_integral, rule.legendre)]
            known = ctypes.byref(_Rule(len(rule.nodes), *(_at(x) for x in kept))), kept, rule
            _RULES[id(rule)] = known
        return known[0]

    def window(self, rule: CollocationRule, trial: WindowTrial, d: Real, near: Real) -> tuple[Real, int] | None:
        """Accelerations at the nodes (s, f) of one window, and the number of evaluations; None where Newton's method fails.

        ``d`` (s, g): values of the drives at the nodes; ``near`` (a,): the angles that are followed.
        """
        a = np.array(trial.guess, float)
        q, v, d, near = (np.ascontiguousarray(x, float) for x in (trial.q, trial.v, d, near))
        times = ctypes.c_double(trial.start), ctypes.c_double(trial.length)
        given = _at(q), _at(v), _at(d), _at(near), _at(a), ctypes.c_double(trial.tolerance)
        count = self._loaded.window(self._system, self._rule(rule), *times, *given)
        return (a, int(count)) if count else None

    def windows(self, rule: CollocationRule, at: Real, limits: BatchLimits) -> WindowBatch:
        """Windows from the state in ``at``, which then has the state at their end; see `collocation.c`."""
        s, f = len(rule.nodes), self.freedoms
        out = np.empty((limits.most, 4 + 2 * f + s * f))
        numbers = (ctypes.c_double(x) for x in limits.bounds)
        most, breaks = (ctypes.c_long(limits.most), ctypes.c_long(limits.checked)), limits.breaks_to_infinity
        made = int(self._loaded.windows(self._system, self._rule(rule), *numbers, *most, _at(breaks), _at(at), _at(out)))
        return self._batch(out[: made if made >= 0 else -made - 1], s, made < 0)

    def phases(
        self, rule: CollocationRule, at: Real, limits: BatchLimits, constants: Sequence[float], given: Sequence[Real]
    ) -> PhaseBatch:
        """Phases of a motion with contacts from the state in ``at``, within the ``limits`` of their windows; see `phases.c`.

        ``constants``: numbers that follow those of the limits in C; ``given``: scales of the elements (e,) and their signs (e,),
        the stops (k, 5). Not available where angles are followed.
        """
        scales, signs, stops = given
        s, f, e, count = len(rule.nodes), self.freedoms, len(signs), limits.most
        out, marks = np.empty((count, 4 + 2 * f + s * f)), np.empty((count, 8 + e))
        own, breaks = np.concatenate([scales, signs, stops.ravel(), [0.0]]), limits.breaks_to_infinity
        modes, numbers = len(self.modes) - e - 1, np.array([*limits.bounds, *constants])
        whole = (ctypes.c_long(x) for x in (modes, len(stops)))
        more = (ctypes.c_long(x) for x in (count, count, limits.checked))
        pointers = _at(breaks), _at(at), _at(out), _at(marks)
        done = int(self._loaded.phases(self._system, self._rule(rule), _at(numbers), *whole, _at(own), *more, *pointers))
        marks, made = marks[:done], int(marks[done - 1, 2]) if done else 0
        return PhaseBatch(marks[:, :8], np.vstack([marks[:, 8:], own[e : 2 * e]]), self._batch(out[:made], s, False))

    def settled(
        self, t: float, q: Real, v: Real, given: tuple[Real, Real], numbers: Sequence[float], loose: tuple[float, float, float]
    ) -> tuple[Real, Real] | None:
        """Signs (e,) of the elements and rates (f,) at a state, see `settled_at` of `phases.c`; None where they are not decided.

        ``given``: scales of the elements (e,) and their signs so far (e,).
        """
        own, v = np.concatenate([*given, [0.0]]), np.array(v, float)
        constants, freed, place = (np.array(x, float) for x in (numbers, loose, q))
        modes, e = len(self.modes) - len(given[0]) - 1, len(given[0])
        at = ctypes.c_long(modes), _at(own), ctypes.c_double(t), _at(place), _at(v), _at(freed)
        return (own[e : 2 * e], v) if self._loaded.settled_at(self._system, _at(constants), *at) else None

    def _batch(self, out: Real, s: int, stuck: bool) -> WindowBatch:
        f = self.freedoms
        q, v, a = out[:, 4 : 4 + f], out[:, 4 + f : 4 + 2 * f], out[:, 4 + 2 * f :].reshape(len(out), s, f)
        return WindowBatch(out[:, 0], out[:, 1], q, v, a, out[:, 2], out[:, 3], stuck)
