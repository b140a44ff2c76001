"""Equations of motion as a compiled program, with its inputs: laws of prescribed drives, angles that it follows.

The code of positions, rates, effects and reduction runs on symbols, which writes the reduced equations out in C. Where C lacks
something (loads that are functions of Python) the reason is given in words, and numpy evaluates them. Dry friction and joints that
rest on stops are in `contacts`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np

from mechcore.arrays import Real, Values
from mechcore.branches.unwrapped import GivenLinkAngles, LinkAngles, StartPose
from mechcore.compiled.collocation import (
    BatchLimits,
    CollocationRule,
    CompiledEquations,
    ContactCounts,
    WindowBatch,
    WindowTrial,
    WrittenEquations,
)
from mechcore.compiled.motion import MOST_LINES
from mechcore.compiled.steps import check_traceable, followed_angle, place_all_symbols
from mechcore.compiled.symbols import Code, Symbol, Untraceable, on_symbols, rotation
from mechcore.constants import TURN
from mechcore.dynamics.equations.reduced import (
    coordinate_scales,
    forms_of,
    free_of,
    integrating,
    motion_at,
    rates_of_joints,
    reduced_terms,
)
from mechcore.dynamics.integration.windows import TAIL_MARGIN
from mechcore.errors import MechanismError
from mechcore.kinematics.columns import all_columns, all_vectors
from mechcore.kinematics.model import Model
from mechcore.kinematics.program import Unknown
from mechcore.kinematics.rates import accelerations, velocities
from mechcore.kinematics.singular_interpolation import NEAR_STEPS
from mechcore.kinematics.state import State
from mechcore.laws.time_curves import numbers_of_time
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.spec.mechanism import joints_with_friction

T = TypeVar("T")
TURNED = "turned"  # kind of followed unknown: the angle of a group from the start pose on, which may differ from Newton's unknown
GONE = "gone"  # kind of followed unknown: whole turns of a rotation class, which are constant, see `_gone`


def _gone(motion: Motion, rotation_class: int) -> Real:
    """Whole turns (n,) [rad] by which the angle of a rotation class exceeds the sum of its group's and its drives' angles: where a
    chart took over, links may have turned farther than those coordinates show."""
    turning = motion.model.angles
    group = turning.class_group[rotation_class]
    driven = sum(sign * motion.drives[d][0] for d, sign in turning.class_drives[rotation_class])
    more = motion.angles.class_angles[rotation_class] - driven - (motion.group_angle(group) if group else 0.0)
    return np.asarray(TURN * np.round(more / TURN))


class EquationsProgram:
    """The equations of motion of a compiled mechanism, ready to run. ``more``: count of the numbers that it is given beside the
    modes."""

    def __init__(self, compiled: Compiled, written: WrittenEquations, followed: tuple[Unknown, ...], more: int = 0):
        self.compiled, self.followed = compiled, followed
        self._laws = [d.law for d in compiled.mechanism.drives if not isinstance(d.law, Free)]
        scales = [*compiled.cached(coordinate_scales).tolist(), *(1.0 for _ in integrating(compiled))]
        self._of_time = written.of_time
        curves = [numbers_of_time(function) for function in (*self._laws, *self._of_time)]
        known = [numbers for numbers in curves if numbers is not None]
        self.timed = len(known) == len(curves)  # C has all functions of time
        modes = [*compiled.assembly.modes, *[0.0] * more]
        self._equations = CompiledEquations(written, modes, scales, known if self.timed else None)
        points = compiled.singular_points
        self._singular = points if points is not None and points.by_drive and points.points else None
        self.partial = self._singular is not None  # next to singular points numpy is needed
        self.everywhere = not (self.partial or followed)  # any states at once
        self.alone = self.timed and not self.partial  # no values of drives or other functions of time need be given

    @property
    def has_forms(self) -> bool:
        """Whether it evaluates the forms of all laws that have several."""
        return bool(self._equations.kinds) and self.everywhere

    def __call__(self, q: Real, v: Real, t: Real) -> Real:
        """Accelerations (n, f); where angles are followed, the states must be in order of time and near each other."""
        return self._equations.accelerations(q, v, t, self._drives(t), self.near(q[:1], v[:1], t[:1]))

    def reduced(self, q: Real, v: Real, t: Real) -> tuple[Real, Real]:
        """M (n, f, f) and Q - h (n, f) at free coordinates and rates (n, f), near each other; states of effects are zero."""
        states = self._equations.freedoms - q.shape[1]
        if states:
            q, v = (np.column_stack([x, np.zeros((len(x), states))]) for x in (q, v))
        return self._equations.reduced(q, v, t, self._drives(t), self.near(q[:1], v[:1], t[:1]))

    def forms(self, q: Real, v: Real, t: Real) -> Real | None:
        """Forms of all laws that have several (k, n), at states (n, f) each; None where C does not have them."""
        return self._equations.forms(q, v, t, self._drives(t)).T if self.has_forms else None

    def _outputs(self, q: Real, v: Real, t: Real) -> tuple[Real, Real]:
        """Accelerations (n, f) and the additional outputs (n, k) of any states, see `contacts`."""
        return self._equations.outputs(q, v, t, self._drives(t), self.near(q[:1], v[:1], t[:1]))

    def _set(self, numbers: Real) -> None:
        """Set the numbers that it is given beside the modes."""
        self._equations.modes[len(self.compiled.assembly.modes) :] = numbers

    def strain(self, q: Real, v: Real, t: Real) -> float:
        """Largest rate of a joint per unit rate of a free coordinate at one state, see `charts.strain`."""
        return float(self._equations.strain(q, v, t, self._drives(t), self.near(q, v, t))[0])

    def at_rest(self, q: Real) -> Real | None:
        """M, Q - h and the largest rate of a joint per unit rate (n, 3) at positions (n,) of the only drive, where the program
        follows nothing and has no laws; None where a position is near a singular point."""
        away = q - self.compiled.start[0]
        modes = np.repeat(self._equations.modes[None], len(q), axis=0)
        if self._singular is not None:
            if self._singular.near(away, NEAR_STEPS):
                return None
            for i, sign in self._singular.all_signs(away):
                modes[:, i] *= sign
        return self._equations.at_rest(q, modes)

    def _drives(self, t: Real) -> Real:
        out = np.empty((len(t), self._equations.given))
        if self._equations.given:
            for k, x in enumerate([x for law in self._laws for x in law(t)] + [function(t) for function in self._of_time]):
                out[:, k] = x
        return out

    def near(self, q: Real, v: Real, t: Real) -> Real:
        """The unknowns (a,) that the program follows, at one state."""
        if not self.followed:
            return np.zeros(0)
        motion = motion_at(self.compiled, q, v, t)
        of: dict[str, Callable[[int], Values]] = {
            TURNED: motion.group_angle,
            GONE: partial(_gone, motion),
            "angle": motion.state.angle.__getitem__,
            "slide": motion.state.slide.__getitem__,
        }
        return np.array([float(np.ravel(of[what](i))[0]) for what, i in self.followed])

    def window(self, rule: CollocationRule, trial: WindowTrial) -> tuple[Real, int] | None:
        """Accelerations at the nodes of a window as `solve_window` of numpy gives them; None also where it comes near a singular
        point."""
        t0, h, q, v = trial[:4]
        if self._away(q) is None:
            return None
        near = self.near(q[None], v[None], np.array([t0]))
        solved = self._equations.window(rule, trial, self._drives(t0 + h * rule.nodes), near)
        if solved is None or self._singular is None:
            return solved
        places = q + h * rule.nodes[:, None] * v + h * h * (rule.double_integral @ solved[0])
        return solved if self._clear(np.append(q[0], places[:, 0])) else None

    def _away(self, q: Real) -> tuple[float, float] | None:
        """Coordinates of the only drive between which no singular point is near, around a position (f,); None where it is near one
        itself. The modes at this position hold from now on."""
        if self._singular is None:
            return -np.inf, np.inf
        if not self._clear(q):
            return None
        away, period = float(q[0] - self.compiled.start[0]), self._singular.period
        modes = [m * float(self._singular.signs(i, np.asarray(away))) for i, m in enumerate(self.compiled.assembly.modes)]
        self._equations.modes[: len(modes)] = modes
        near = NEAR_STEPS * max(point.step for point in self._singular.points)
        ahead = min((point.time - away) % period for point in self._singular.points)
        behind = min((away - point.time) % period for point in self._singular.points)
        return float(q[0]) - behind + near, float(q[0]) + ahead - near

    def _clear(self, q: Real) -> bool:
        """Whether no singular point is near the path over positions (n,) of the only drive."""
        assert self._singular is not None
        reach = NEAR_STEPS * max(point.step for point in self._singular.points)
        away = q - self.compiled.start[0]
        return not self._singular.within(float(away.min()) - reach, float(away.max()) + reach)

    def windows(self, rule: CollocationRule, at: Real, limits: BatchLimits) -> WindowBatch:
        """Consecutive windows, see `CompiledEquations.windows`; only where it is ``alone``, and searched for breakpoints only where
        it ``has_forms``."""
        return self._equations.windows(rule, at, limits)


def compiled_program(compiled: Compiled) -> EquationsProgram | None:
    """The program of a mechanism's equations of motion; None where C does not have them or there is no compiler that works.

    Call it through `Compiled.cached`. Raises `MechanismError` where the executor is "c" and C cannot be compiled.
    """
    equations = written_equations(compiled, traced_equations)
    return None if isinstance(equations, str) else program_or_none(compiled, lambda: EquationsProgram(compiled, *equations))


def program_or_none(compiled: Compiled, made: Callable[[], T]) -> T | None:
    """The program that ``made`` returns; None where that fails. Raises the `MechanismError` where the executor is "c"."""
    try:
        return made()
    except MechanismError:
        if compiled.executor == "c":
            raise
        return None


Written: TypeAlias = tuple[WrittenEquations, tuple[Unknown, ...]]
"""A program and the unknowns that it follows."""


def written_equations(compiled: Compiled, traced: Callable[[Compiled], TracedEquations], kind: object = None) -> Written | str:
    """The program of equations that are ``traced``, of some ``kind``, or why C does not have them, in words."""
    known = compiled.model.cached(_known)
    start = compiled.angles.start
    turned = tuple(float(x) for x in start.angles.values()), tuple(start.ranges.items()), compiled.angles.exact
    took_over = compiled.angles.at.time > -np.inf
    key = (*turned, took_over, tuple(compiled.assembly.modes), tuple(compiled.assembly.constants), kind)
    if key not in known:
        try:
            equations = traced(compiled)
            program = WrittenEquations(*equations[:5], TAIL_MARGIN)
            long = program.lines > MOST_LINES
            known[key] = f"the program would have {program.lines:,} lines" if long else (program, equations.followed)
        except Untraceable as reason:
            known[key] = str(reason)
    return known[key]


def _known(_: Model) -> dict[Any, Written | str]:
    return {}


class Programmed:
    """Equations of motion that numpy or, where one is wanted, a compiled program evaluates."""

    compiled: Compiled

    def program(self, *, long: bool = False) -> EquationsProgram | None:
        """The compiled program where the executor is "c" or, where it is "auto", for a ``long`` motion or once it exists; else
        None."""
        return (
            self.compiled.cached(compiled_program)
            if wants_program(self.compiled, compiled_program in self.compiled.cache or long)
            else None
        )


def wants_program(compiled: Compiled, worth: bool) -> bool:
    """Whether a compiled program is wanted: where the executor is "c", or "auto" and the program is ``worth`` it."""
    return compiled.executor == "c" or (compiled.executor == "auto" and worth)


class TracedEquations(NamedTuple):
    """Traced code and its interface, see `WrittenEquations`: ``outputs``, ``freedoms``, number of values of drives that are
    ``given``, ``contacts``; the unknowns that are ``followed``."""

    code: Code
    outputs: tuple[list[Any], ...]
    freedoms: tuple[int, int]
    given: int
    contacts: ContactCounts | None
    followed: tuple[Unknown, ...]


def traced_equations(compiled: Compiled) -> TracedEquations:
    """The reduced equations of a mechanism on symbols. Raises `Untraceable` with the reason where they cannot be traced."""
    check_traceable(compiled.model)
    if "friction" in compiled.mechanism.effects and joints_with_friction(compiled.mechanism.joints):
        raise Untraceable("dry friction depends on the reactions")
    return EquationsWriter(compiled).equations()


class EquationsWriter:
    """The mechanism on symbols of one program."""

    def __init__(self, compiled: Compiled):
        self.compiled, self.model, self.code = compiled, compiled.model, Code()
        self.took_over = compiled.angles.at.time > -np.inf  # from another chart
        self.contacts: ContactCounts | None = None
        self.followed: list[Unknown] = []  # in the order of the program's inputs
        self.turned: dict[int, Any] = {}  # angles of groups from the start pose on, as far as they are needed
        self.gone: dict[int, Any] = {}  # whole turns of rotation classes that drives turn, as far as they are needed

    def equations(self) -> TracedEquations:
        model, free, code = self.model, free_of(self.compiled), self.code
        drives: list[tuple[Any, Any, Any]] = []
        for d in range(len(model.mechanism.drives)):
            if d in free:
                k = free.index(d)
                drives.append((code.input(f"q[{k}]"), code.input(f"v[{k}]"), 0.0))
            else:
                k = 3 * (d - sum(x < d for x in free))
                q, v, a = (code.input(f"d[{k + i}]") for i in range(3))
                drives.append((q, v, a))
        state = self._state([q for q, _, _ in drives])
        angles = self._angles(state)
        moving = self._motion(state, angles, drives, second=True)
        units = [self._motion(state, angles, [(q, 1.0 * (d == i), 0.0) for d, (q, _, _) in enumerate(drives)]) for i in free]
        states = integrating(self.compiled)
        own_states: dict[str, Any] = {e.name: code.input(f"v[{len(free) + i}]") for i, e in enumerate(states)}
        moving.states.update(own_states)
        with on_symbols("a load"):
            outputs, additional = self._reduced(moving, units)
            integrated = [self._operand(e.state_rate(moving)) for e in states]
            _, rates = rates_of_joints(self.compiled, units)
        outputs = [self._operand(x) for x in outputs] + integrated
        ratios, forms = [self._operand(x) for row in rates for x in row], self._forms(moving)
        own: dict[str, Any] = {TURNED: self.turned, GONE: self.gone, "angle": state.angle, "slide": state.slide}
        near = [self._operand(own[what][i]) for what, i in self.followed]  # after all code that may need an angle
        given = 3 * (len(drives) - len(free))
        kept = outputs, near, ratios, forms, [self._operand(x) for x in additional]
        return TracedEquations(code, kept, (len(free), len(states)), given, self.contacts, tuple(self.followed))

    def _reduced(self, moving: Motion, units: list[Motion]) -> tuple[list[Any], list[Any]]:
        """The lower triangle of M, row by row, then Q - h; and additional outputs. From the motion with q'' = 0 and its
        tangents."""
        inertia, bias, force = reduced_terms(moving, units)
        return [x for row in inertia for x in row] + [q - h for q, h in zip(force, bias, strict=True)], []

    def _forms(self, motion: Motion) -> list[Any]:
        """Forms of the laws of effects and cams; none where C does not have them all."""
        try:
            return [self._operand(x) for x in forms_of(motion)]
        except (TypeError, AttributeError, ValueError, IndexError):  # errors of array code on symbols
            return []

    def _operand(self, value: Any) -> Any:
        return value.re if isinstance(value, Symbol) else float(value)

    def _state(self, drives: list[Any]) -> Any:
        model, code = self.model, self.code
        delta: list[Any] = []
        for terms in model.angles.class_drives:
            turn: Any = 1 + 0j
            for d, sign in terms:
                turn = turn * rotation(sign * drives[d])
            delta.append(turn)
        state: Any = State(
            drives=drives,
            delta=delta,
            rot=[delta[s] if g == 0 else None for s, g in enumerate(model.angles.class_group)],
            slide={j: drives[d] for j, d in model.program.driven_slides},
            constants=self.compiled.assembly.constants,
        )
        for g in model.multi_turn:
            state.near[f"angle {g}"] = self._near(TURNED, g)
        for block in model.blocks:
            if block.kind == "general":
                state.near[block.name] = [self._near(*unknown) for unknown in block.unknowns]
        place_all_symbols(model, state, [code.input(f"m[{k}]") for k in range(len(model.blocks))], tied=True)
        self.turned |= {g: state.angle[g] for g in model.multi_turn}
        return state

    def _near(self, what: str, number: int) -> Symbol:
        self.followed.append((what, number))
        return self.code.input(f"near[{len(self.followed) - 1}]")

    def _angles(self, state: Any) -> LinkAngles:
        """Angles of the links; those of groups are followed only where they are needed."""
        model = self.model

        def of_class(rotation_class: int) -> Any:
            group = model.angles.class_group[rotation_class]
            if group and group not in self.turned:
                state.near[f"angle {group}"] = self._near(TURNED, group)
                self.turned[group] = followed_angle(model, state, group)
            angle, drives = self.turned[group] if group else 0.0, model.angles.class_drives[rotation_class]
            if drives and self.took_over and rotation_class not in self.gone:
                self.gone[rotation_class] = self._near(GONE, rotation_class)
            return angle + sum((sign * state.drives[d] for d, sign in drives), 0.0) + self.gone.get(rotation_class, 0.0)

        return _SymbolAngles(model, self.compiled.angles.start, of_class, exact=self.compiled.angles.exact)

    def _motion(self, state: Any, angles: LinkAngles, drives: Any, *, second: bool = False) -> Motion:
        model = self.model
        time: Any = self.code.input("t")
        motion = Motion(model, time, drives, state, angles)
        vectors = all_vectors(model, state)
        columns = all_columns(model, vectors)
        speeds = velocities(model, vectors, columns, [v for _, v, _ in drives], curve_values=state.curve_values)
        given: dict[str, Any] = {"shape": (), "drives": drives, "loop_vectors": vectors, "columns": columns, "speeds": speeds}
        if second:
            given["accelerations"] = accelerations(model, vectors, columns, speeds, [a for _, _, a in drives])
        vars(motion).update(given)
        return motion


class _SymbolAngles(GivenLinkAngles):
    """Angles of the links on symbols."""

    def __init__(self, model: Model, start: StartPose, of_class: Callable[[int], Any], *, exact: bool):
        super().__init__(model, start, exact)
        self._of_class = of_class

    def link(self, k: int) -> Any:
        turning = self.model.angles
        return self._of_class(turning.rotation_class[k]) + turning.offset[k]
