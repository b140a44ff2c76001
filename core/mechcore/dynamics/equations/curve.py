"""One freedom: the mechanism on its configuration curve, with masses and forces reduced to one coordinate once and for all.

J(q), and the reduced force Q(q) of all loads that depend on the position alone, are tabulated over the whole range (one turn where
the mechanism is periodic); J' and the work of Q follow from the same polynomials, so that the energy balance of the tabulated
system is exact. The table also has C(q), the reduced force per unit rate of all loads proportional to speeds (dampers, oil). Other
loads that depend on speed or time are evaluated where they are needed. Then J q'' + J' q'^2 / 2 = Q + C q'.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np

from mechcore.arrays import Index, Real, Values
from mechcore.branches.paths import repeats
from mechcore.branches.singular_points import SingularPoints
from mechcore.constants import TURN
from mechcore.dynamics.equations.program import Programmed, compiled_program, wants_program
from mechcore.dynamics.equations.reduced import motion_at, steps_of_differences, with_rates
from mechcore.effects.base import Effect, power_of
from mechcore.effects.masses import kinetic_energy
from mechcore.effects.registry import effects_of
from mechcore.errors import MechanismError
from mechcore.motion.compiled import Compiled, reached
from mechcore.motion.motion import Motion
from mechcore.numerics.chebyshev import TAIL_NOISE, Panels, fit_panels, fit_where_needed, nodes_of
from mechcore.records import dataclass

FIRST_PANELS = 8  # panels of the first try
EQUAL_PANELS = 64  # panels of a table, beside the shorter ones next to singular positions
SHORT_PANEL = 0.1  # part of the width of an equal panel: narrower features need shorter panels
# Halvings next to a singular position; inverse conditions below the second are examined
MOST_HALVINGS, CLOSE_CONDITION = 24, 0.3
MOST_TIMES = 16  # as many positions, at most: they gather at singular positions, and are everywhere only where rounding decides
SINGULAR_ROUNDING = 1e-4  # relative rounding next to a singular position, at most
MOST_BENDS, SEARCH_ROUNDS = 64, 16  # of cams at which a table's panels end; 32^16 exceeds the count of numbers in an interval
SAME_ENERGY = 1e-3  # part of an energy: two ways to compute it differ by less
REPEATED_VALUE = 1e-9  # part of the largest value: values that differ by less a turn later are the same
LITTLE_ENERGY = 1e-3  # part of the work from one end of a table: smaller kinetic energies are not taken as differences of work


@dataclass(frozen=True, eq=False)
class CurveEquations(Programmed):
    """``table``: J, the tabulated part of Q and, where loads are proportional to speeds, C; ``table_with_derivatives``: these,
    their derivatives, and J''; ``untabulated_effects``: effects that are not in the table; ``beside_singular``: whether it comes
    close to singular positions."""

    compiled: Compiled
    table: Panels
    table_with_derivatives: Panels
    untabulated_effects: tuple[Effect, ...] = ()
    beside_singular: bool = False

    def __call__(self, q: Real, v: Real, t: Real) -> Real:
        program = None if self.conservative else self.program()
        if program is not None and program.everywhere:
            return program(q, v, t)
        f, n = self.table_with_derivatives(q[:, 0]), self.functions
        w = v[:, 0]
        force = f[:, 1] + self.variable_force(q, v, t) if self.untabulated_effects else f[:, 1]
        if n > 2:
            force = force + f[:, 2] * w
        return ((force - 0.5 * f[:, n] * w * w) / f[:, 0])[:, None]

    @property
    def functions(self) -> int:
        """How many functions are in the table: two, or three with C."""
        return int(self.table.coefficients.shape[2])

    @property
    def conservative(self) -> bool:
        """Whether all forces depend on the position alone."""
        return not self.untabulated_effects and self.functions == 2

    def inertia(self, q: float) -> float:
        """J at a position."""
        return float(self.table(np.array([q]))[0, 0])

    @cached_property
    def _work(self) -> Panels:
        return self.table.integral()

    @cached_property
    def _most_work(self) -> float:
        return float(np.abs(self._work.coefficients[:, :, 1]).sum(axis=1).max())

    def kinetic_energy(self, q: float, v: float, before: tuple[float, float]) -> float:
        """Kinetic energy at q, v. Where forces depend on the position alone, it follows from their work since the position and
        speed ``before``: this keeps the digits that speeds next to a dead point lose. An energy that is small beside that work
        follows from v, as the difference would lose digits."""
        plain = 0.5 * self.inertia(q) * v * v
        if not self.conservative or plain < LITTLE_ENERGY * self._most_work:
            return plain
        places = np.array([before[0], q])
        low, high = self.table.low, self.table.high
        turns = np.floor((places - low) / (high - low)) if self.table.periodic else np.zeros(2)
        done = self._work(places - turns * (high - low))[:, 1] + turns * self._work(np.array([high]))[0, 1]
        exact = 0.5 * self.inertia(before[0]) * before[1] ** 2 + float(done[1] - done[0])
        return exact if abs(exact - plain) < SAME_ENERGY * plain else plain

    def speed_by_energy(self, before: tuple[float, float], q: Real, v: Real) -> Real:
        """The speed (1,) at q (1,) that corresponds to `kinetic_energy`, with the sign of v."""
        energy = self.kinetic_energy(float(q[0]), float(v[0]), before)
        return np.asarray(np.copysign(np.sqrt(2.0 * energy / self.inertia(float(q[0]))), v))

    def variable_force(self, q: Real, v: Real, t: Real) -> Real:
        """The part of Q (n,) that depends on speed or time."""
        unit = motion_at(self.compiled, q, np.ones_like(v), t)
        moving = with_rates(unit, [v[:, 0]])
        total: Values = np.zeros(len(t))
        for effect in self.untabulated_effects:
            for w in effect.wrenches(moving):
                total = total + power_of(unit, w)
        return np.asarray(total)

    def slopes(self, q: Real, v: Real, t: Real, a: Real) -> tuple[Real, Real]:
        f, n = self.table_with_derivatives(q[:, 0]), self.functions
        w = v[:, 0]
        by_q = f[:, n + 1] - 0.5 * f[:, 2 * n] * w * w - a[:, 0] * f[:, n]
        by_v = -f[:, n] * w
        if n > 2:
            by_q, by_v = by_q + f[:, n + 2] * w, by_v + f[:, 2]
        if self.untabulated_effects:
            n = len(t)
            steps = [float(x[0]) for x in steps_of_differences(self.compiled, q, v, a)]
            forces = self.variable_force(
                np.concatenate([q, q + steps[0], q]), np.concatenate([v, v, v + steps[1]]), np.concatenate([t, t, t])
            ).reshape(3, n)
            by_q, by_v = by_q + (forces[1] - forces[0]) / steps[0], by_v + (forces[2] - forces[0]) / steps[1]
        return (by_q / f[:, 0])[:, None, None], (by_v / f[:, 0])[:, None, None]


def beside_singular(compiled: Compiled, x: Real, at_x: Motion | None = None) -> Real:
    """Positions (n,) in ascending order, with more of them (m,) in between where a group comes close to a singular position: there,
    the distance of neighbours is about their distance from it. ``at_x``: a motion at a unit rate whose last frames are there.

    The group's condition gives that distance: its inverse is proportional to it, and hardly falls faster than its slope nearby.
    """

    def distances(q: Real, unit: Motion) -> Real:
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / unit.condition[-len(q) :]
        return np.where(reached(compiled, q), inverse, np.nan)

    near, most = distances(x, _unit(compiled, x) if at_x is None else at_x), MOST_TIMES * len(x)
    if not (near < CLOSE_CONDITION).any():
        return x
    for _ in range(MOST_HALVINGS):
        widths, least = np.diff(x), np.minimum(near[:-1], near[1:])
        slopes = np.nan_to_num(np.abs(np.diff(near)) / widths)
        slopes = np.maximum.reduce([slopes, np.append(0.0, slopes[:-1]), np.append(slopes[1:], 0.0)])
        at = np.flatnonzero((least < slopes * widths) & (least < CLOSE_CONDITION))
        if not len(at) or len(x) + len(at) > most:
            break
        middle = 0.5 * (x[at] + x[at + 1])
        x, near = np.insert(x, at + 1, middle), np.insert(near, at + 1, distances(middle, _unit(compiled, middle)))
    return x


def tabulate(compiled: Compiled, low: float, high: float, *, tolerance: float = 1e-13) -> CurveEquations:
    """Reduce the mechanism to its free coordinate between ``low`` and ``high``."""
    fixed, rest = _parted(compiled, lambda: _unit(compiled, nodes_of(low, high, FIRST_PANELS)))
    return _curve(compiled, *_fitted(compiled, _values(compiled, fixed), low, high, periodic=False, tolerance=tolerance), rest)


def _fitted(
    compiled: Compiled,
    values: Callable[[Real], Real],
    low: float,
    high: float,
    *,
    periodic: bool,
    tolerance: float,
    known: Real | None = None,
    unit: Motion | None = None,
) -> tuple[Panels, bool]:
    """A table of values: equal panels, or panels that end where cams change their form, and shorter ones where a group comes close
    to a singular position; and whether one does. ``unit``: a motion at a unit rate whose last frames are those ends of panels."""
    plain = True
    if compiled.singular_points is None or not compiled.singular_points.points:
        boundaries = beside_singular(compiled, np.linspace(low, high, EQUAL_PANELS + 1), unit)
        plain = bool(np.diff(boundaries).min() > SHORT_PANEL * (high - low) / EQUAL_PANELS)
    bends = _bends(compiled, low, high)
    if plain and not len(bends):
        return fit_panels(values, low, high, periodic=periodic, tolerance=tolerance, first=FIRST_PANELS, known=known), False
    if len(bends):
        boundaries = np.linspace(low, high, FIRST_PANELS + 1) if plain else boundaries
        apart = np.abs(boundaries[:, None] - bends).min(axis=1) > SHORT_PANEL * (high - low) / EQUAL_PANELS
        apart[[0, -1]] = True
        boundaries = np.unique(np.concatenate([boundaries[apart] if plain else boundaries, bends]))
    noise = TAIL_NOISE if plain else SINGULAR_ROUNDING
    return fit_where_needed(values, boundaries, tolerance=tolerance, periodic=periodic, noise=noise)[0].joined(), not plain


def _bends(compiled: Compiled, low: float, high: float) -> Real:
    """Positions (n,) between two others, in order, at which a cam changes the form of its law: a derivative of J or Q jumps there.
    Empty where they are very many, as of a measured profile, which is practically smooth."""
    if not any(r.kind == "cam" for r in compiled.model.relations):
        return np.zeros(0)

    def changes(x: Real) -> Index:
        motion = _unit(compiled, x.ravel())
        forms = np.stack([r.geometry.segment(motion) for r in motion.model.relations if r.kind == "cam"]).reshape(-1, *x.shape)
        return np.stack(np.nonzero((forms[:, :, 1:] != forms[:, :, :-1]).any(axis=0)))

    edges = np.linspace(low, high, MOST_BENDS * 4 + 1)[None]
    for _ in range(SEARCH_ROUNDS):
        row, k = changes(edges)
        if not 0 < len(k) <= MOST_BENDS:
            return np.zeros(0)
        before, after = edges[row, k], edges[row, k + 1]
        if (after - before <= 4.0 * np.spacing(np.abs(after))).all():
            break
        edges = before[:, None] + (after - before)[:, None] * np.linspace(0.0, 1.0, 33)
    close = 1e-9 * (high - low)
    return np.asarray(after[(after > low + close) & (after < high - close) & (np.diff(after, prepend=low) > close)])


def whole_turn(
    compiled: Compiled,
    q: float,
    *,
    tolerance: float = 1e-13,
    usable: Callable[[Motion], bool] = lambda _: True,
    most_strain: float = np.inf,
) -> CurveEquations | None:
    """Reduce the mechanism to its free coordinate over one turn, after which everything repeats; None where it does not repeat, or
    where the coordinate does not lead over the whole turn: ``usable`` tests the motion at a unit rate, and no joint's rate may
    exceed ``most_strain``.

    All of this needs a single set of positions: the nodes of the table, some of them a turn later, and the ends of panels.
    """
    singular_points = compiled.singular_points
    if singular_points is not None and singular_points.unreachable:
        return None
    low = q if singular_points is None or not singular_points.by_drive else _clear_of(singular_points, compiled.start[0], q)
    x = nodes_of(low, low + TURN, FIRST_PANELS)
    again = np.arange(5, len(x), 13)
    once, twice = again, len(x) + np.arange(len(again))
    by_program = _by_program(compiled, usable, most_strain)
    if by_program is not None:
        known = by_program(np.append(x, x[again] + TURN))
        if (np.abs(known[twice] - known[once]).max(axis=0) <= REPEATED_VALUE * np.abs(known).max(axis=0)).all():
            fitted = _fitted(compiled, by_program, low, low + TURN, periodic=True, tolerance=tolerance, known=known[: len(x)])
            return _curve(compiled, *fitted, ()) if np.isfinite(fitted[0].coefficients).all() else None
    through = singular_points is not None and bool(singular_points.points)
    ends = x[:0] if through else np.linspace(low, low + TURN, EQUAL_PANELS + 1)  # next to singular points positions cost more
    unit = _unit(compiled, np.concatenate([x, x[again] + TURN, ends]))
    if not usable(unit) or not repeats(unit.model, unit.state, once, twice):
        return None
    fixed, rest = _parted(compiled, lambda: unit)
    forces = {e: np.broadcast_to(_force(e, unit), unit.shape) for e in fixed}
    repeating = [e for e, f in forces.items() if np.abs(f[twice] - f[once]).max() <= REPEATED_VALUE * np.abs(f).max()]
    rest += [e for e in fixed if e not in repeating]  # torsion springs, and tables over an unwrapped angle
    known = _columns(unit, {e: forces[e] for e in repeating})[: len(x)]
    values = _values(compiled, repeating, usable)
    table, singular = _fitted(compiled, values, low, low + TURN, periodic=True, tolerance=tolerance, known=known, unit=unit)
    return _curve(compiled, table, singular, rest) if np.isfinite(table.coefficients).all() else None


def _by_program(compiled: Compiled, usable: Callable[[Motion], bool], most_strain: float) -> Callable[[Real], Real] | None:
    """As `_values`, by the equations in C. None unless C is wanted, positions follow from the drive's position and the modes alone,
    and forces depend on positions only."""
    effects = [e for e in effects_of(compiled.mechanism) if "accelerations" not in e.needs]
    alone = len(compiled.mechanism.drives) == 1 and not (compiled.model.relations or compiled.needs_path)
    alone = alone and all(e.needs <= {"positions"} for e in effects)
    if not alone or any(e.piecewise or e.limited for e in effects) or not wants_program(compiled, worth=False):
        return None
    program, by_numpy = compiled.cached(compiled_program), _values(compiled, effects, usable)
    if program is None or program.followed:
        return None

    def values(q: Real) -> Real:
        at_rest = program.at_rest(q)
        if at_rest is None:
            return by_numpy(q)
        return at_rest[:, :2] if (at_rest[:, 2] <= most_strain).all() else np.full((len(q), 2), np.nan)

    return values


def _parted(compiled: Compiled, everywhere: Callable[[], Motion]) -> tuple[list[Effect], list[Effect]]:
    """Effects that can be tabulated, and the others. The former depend on the position alone or are proportional to speeds, and are
    smooth; limits of their laws hold in the motion ``everywhere``."""
    effects = [e for e in effects_of(compiled.mechanism) if "accelerations" not in e.needs]
    fixed = [e for e in effects if (e.needs <= {"positions"} or e.proportional) and not e.piecewise]
    if any(e.limited for e in fixed):
        motion = everywhere()
        fixed = [e for e in fixed if _holds(e, motion)]
    return fixed, [e for e in effects if e not in fixed]


def _holds(effect: Effect, motion: Motion) -> bool:
    """Whether the law of an effect holds at all positions of a motion."""
    try:
        effect.check(motion)
    except MechanismError:
        return False
    return True


def _unit(compiled: Compiled, q: Real) -> Motion:
    """The mechanism at positions (n,) of its coordinate, which runs at a unit rate; the time of a position is its distance from the
    first, by which angles are followed."""
    return motion_at(compiled, q[:, None], np.ones((len(q), 1)), q - q[0])


def _force(effect: Effect, unit: Motion) -> Values:
    """Reduced force of an effect (n,)."""
    return sum((power_of(unit, w) for w in effect.wrenches(unit)), 0.0)


def _values(
    compiled: Compiled, effects: Sequence[Effect], usable: Callable[[Motion], bool] = lambda _: True
) -> Callable[[Real], Real]:
    """Position (n,) -> J, Q and perhaps C, see `_columns`; NaN where the coordinate does not lead."""

    def values(q: Real) -> Real:
        unit = _unit(compiled, q)
        return _columns(unit, {e: _force(e, unit) for e in effects}) * (1.0 if usable(unit) else np.nan)

    return values


def _columns(unit: Motion, forces: Mapping[Effect, Values]) -> Real:
    """J and Q (n, 2), and C (n, 3) where a force is proportional to speeds, from the forces at a unit rate."""
    none = np.zeros(unit.frames)
    columns = [2.0 * kinetic_energy(unit), sum((f for e, f in forces.items() if not e.proportional), none)]
    if any(e.proportional for e in forces):
        columns.append(sum((f for e, f in forces.items() if e.proportional), none))
    return np.column_stack(columns)


def _curve(compiled: Compiled, table: Panels, singular: bool, rest: Sequence[Effect]) -> CurveEquations:
    first = table.derivative()
    second = first.derivative()
    both = table.stacked(first).stacked(second.only(0))
    return CurveEquations(compiled, table, both, tuple(rest), singular)


def _clear_of(singular_points: SingularPoints, start: float, q: float) -> float:
    """Start of the first panels, next to ``q``, such that no node comes close to a singular point, where positions are
    interpolated."""
    if not singular_points.points:
        return q
    places = np.array([start + c.time for c in singular_points.points])
    away = _SHIFTED + (q - places) * (FIRST_PANELS / TURN)
    away = np.abs(away - np.round(away))
    return q + TURN / FIRST_PANELS * float(_SHIFTS[np.argmax(away.min(axis=(1, 2)))])


_SHIFTS = np.arange(32) / 32  # of a panel's width
_SHIFTED = _SHIFTS[:, None, None] + nodes_of(0.0, 1.0, 1)[:, None]  # nodes of the first panel, which the others repeat
