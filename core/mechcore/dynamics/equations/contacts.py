"""Equations of motion with dry friction and joints that rest on stops, as a compiled program.

It is written once for a mechanism and the joints that rest. The sense in which every element slides, or that it sticks, is an
input. The program contains the expressions of `contact.dry_friction` and `charts.Chart`, which compute over arrays, term by term.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from copy import copy
from enum import IntEnum
from functools import partial
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from mechcore.arrays import Plane, Real, Values
from mechcore.compiled.collocation import HEAD, BatchLimits, CollocationRule, ContactCounts, PhaseBatch, WindowTrial, lower_triangle
from mechcore.compiled.steps import check_forces_traceable
from mechcore.compiled.symbols import Symbol, Untraceable
from mechcore.constants import REST
from mechcore.dynamics.equations.program import (
    EquationsProgram,
    EquationsWriter,
    TracedEquations,
    Written,
    program_or_none,
    traced_equations,
    wants_program,
    written_equations,
)
from mechcore.dynamics.equations.reduced import free_of, reduced_terms
from mechcore.effects.base import rate
from mechcore.effects.registry import totals
from mechcore.forces.equilibrium import joint_forces
from mechcore.forces.friction.elements import elements_of, relative_rate, scales_of
from mechcore.forces.friction.normal_loads import RESIDUAL_TOLERANCE
from mechcore.kinematics.dyads import cross
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.spec.mechanism import joints_with_friction

ONE_SIDED = ("rolling", "screw")  # kinds of relations whose contact does not depend on the sign of their force
FLANK_ROUNDS = 2  # rounds in which gears and belts may change sides; numpy tries more of them


class Ending(IntEnum):
    """Causes that end a phase of a motion with contacts, as `phases.c` has it."""

    NOTHING = 0
    SLIP = 1  # of an element
    STICKING = 2
    REST = 3  # of the only freedom
    IMPACT = 4  # of a joint towards a stop


class FrictionValues(NamedTuple):
    """States with friction: accelerations (n, f + s); of every element (n, e) friction, the limit up to which it sticks, relative
    rate and second rate; efforts (n, c) that hold the joints at rest. ``solved``: whether all of these are valid; rates always
    are."""

    acceleration: Real
    value: Real
    limit: Real
    rate: Real
    second: Real
    holding: Real
    solved: bool


class ContactProgram(EquationsProgram):
    """The equations of a mechanism with given joints at rest and with friction elements; where friction jams, numpy is needed.

    `with_signs` sets the signs of the elements; without it they are zero. ``has_phases``: `phases` may be called, with stops on the
    joints that are ``stopped``.
    """

    def __init__(self, compiled: Compiled, written: Written):
        contacts = written[0].contacts
        assert contacts is not None
        super().__init__(compiled, *written, contacts.elements + 1)
        self.stopped = joints_with_stops(compiled)
        whole = not (contacts.rests or self.followed) and self._equations.freedoms == len(free_of(compiled))
        self.has_phases = whole and self.timed
        self.alone, self.partial = False, True
        self._signs, self._rests = np.zeros(contacts.elements + 1), contacts.rests

    def with_signs(self, signs: Real, *, breaking: bool = False) -> ContactProgram:
        """The same program where elements slide by ``signs`` (e,) of their rates, 0 where they stick; ``breaking``: with the
        coefficients of sticking."""
        other = copy(self)
        other._signs = np.append(signs, float(breaking))
        return other

    def __call__(self, q: Real, v: Real, t: Real) -> Real:
        return self.friction_state(q, v, t).acceleration

    def window(self, rule: CollocationRule, trial: WindowTrial) -> tuple[Real, int] | None:
        self._set(self._signs)
        return super().window(rule, trial)

    def phases(
        self, rule: CollocationRule, at: Real, limits: BatchLimits, constants: Sequence[float], given: Sequence[Real]
    ) -> PhaseBatch | None:
        """Consecutive phases, see `CompiledEquations.phases`; None next to a singular point."""
        between = self._away(at[HEAD : HEAD + self._equations.freedoms])
        if between is None:
            return None
        return self._equations.phases(rule, at, limits, (*constants, *between), given)

    def settled(
        self, t: float, q: Real, v: Real, given: tuple[Real, Real], sense_delay: float, loose: tuple[int, float] | None
    ) -> tuple[Real, Real] | None:
        """Signs (e,) of the elements from now on and rates (f,) without rounding in those of sticking elements, see
        `CompiledEquations.settled`."""
        if self._away(q) is None:
            return None
        kind = Ending.NOTHING if loose is None else Ending.REST if loose[1] else Ending.STICKING
        event = (float(kind), *(loose or (0.0, 0.0)))
        return self._equations.settled(t, q, v, given, (0.0, sense_delay, REST), event)

    def reduced(self, q: Real, v: Real, t: Real) -> tuple[Real, Real]:
        """As `EquationsProgram.reduced`, without friction."""
        f, (i, j) = q.shape[1], lower_triangle(q.shape[1])
        rest = self._outputs(q, v, t)[1][:, 4 * (len(self._signs) - 1) + self._rests + 1 :]
        inertia = np.empty((len(t), f, f))
        inertia[:, i, j] = inertia[:, j, i] = rest[:, f : f + len(i)]
        return inertia, np.einsum("nij,nj->ni", inertia, rest[:, :f])

    def friction_state(self, q: Real, v: Real, t: Real) -> FrictionValues:
        """Friction values at states (n, f) each."""
        self._set(self._signs)
        accelerations, rest = self._outputs(q, v, t)
        e = len(self._signs) - 1
        value, limit, rates, second = (rest[:, k * e : (k + 1) * e] for k in range(4))
        holding, solved = rest[:, 4 * e : 4 * e + self._rests], rest[:, 4 * e + self._rests]
        return FrictionValues(accelerations, value, limit, rates, second, holding, bool(solved.all()))


def contact_program(compiled: Compiled, rests: Sequence[str], *, long: bool = False) -> ContactProgram | None:
    """The program where one is wanted, see `Programmed.program`, and C has it; else None. Raises `MechanismError` as
    `compiled_program`."""
    known, key = compiled.cached(_known), tuple(rests)
    if not wants_program(compiled, long or key in known):
        return None
    if key not in known:
        equations = _written(compiled, key)
        known[key] = None if isinstance(equations, str) else program_or_none(compiled, partial(ContactProgram, compiled, equations))
    return known[key]


def _known(_: Compiled) -> dict[tuple[str, ...], ContactProgram | None]:
    return {}


def _written(compiled: Compiled, rests: Sequence[str]) -> Written | str:
    return written_equations(compiled, partial(_traced, rests=tuple(rests)), ("contacts", *rests))


def _traced(compiled: Compiled, rests: tuple[str, ...]) -> TracedEquations:
    check_forces_traceable(compiled.model)
    return _ContactWriter(compiled, rests).equations()


def joints_with_stops(compiled: Compiled) -> list[str]:
    """Joints with stops whose coordinates the program has: slides, and driven joints where the angles are exact."""
    model, exact = compiled.model, compiled.angles.exact
    known = [(joint, model.joint_index.get(joint)) for joint in compiled.angles.start.ranges]
    return [
        joint for joint, j in known if j is not None and (model.joints[j].coordinate == "slide" or (exact and j in model.driven))
    ]


def has_dry_friction(compiled: Compiled) -> bool:
    """Whether a mechanism has dry friction."""
    return "friction" in compiled.mechanism.effects and bool(joints_with_friction(compiled.mechanism.joints))


def _of_motion(compiled: Compiled, rests: Sequence[str] = ()) -> Written | str:
    return _written(compiled, rests) if rests or has_dry_friction(compiled) else written_equations(compiled, traced_equations)


def missing_in_c(compiled: Compiled, rests: Sequence[str] = ()) -> str | None:
    """The reason, in words, why C does not have the equations of motion of a mechanism while joints rest on stops; None where it
    has."""
    if not free_of(compiled):
        return "no coordinate is free until a follower leaves its cam"
    equations = _of_motion(compiled, rests)
    return equations if isinstance(equations, str) else None


def written_source(compiled: Compiled) -> tuple[str, int]:
    """Source of the C program of a mechanism's equations of motion, and the number of lines that compute them; C must have them."""
    equations = _of_motion(compiled)
    assert not isinstance(equations, str), equations
    return equations[0].source, equations[0].lines


class _ContactWriter(EquationsWriter):
    """The mechanism on symbols. Equations M a = Q are written in solved form, with the identity as mass matrix."""

    def __init__(self, compiled: Compiled, rests: tuple[str, ...]):
        super().__init__(compiled)
        self._resting = rests

    def _reduced(self, moving: Motion, units: list[Motion]) -> tuple[list[Any], list[Any]]:
        inertia, bias, force = reduced_terms(moving, units)
        f, rests = len(units), self._resting
        mass = [[inertia[max(i, j)][min(i, j)] for j in range(f)] for i in range(f)]
        held = _Held(self, mass, [[rate(u, joint) for u in units] for joint in rests])
        first, effort = held.response([q - h for q, h in zip(force, bias, strict=True)], [_second(moving, j) for j in rests])
        seconds, free = [a for *_, a in moving.drives], free_of(self.compiled)
        for k, i in enumerate(free):
            seconds[i] = first[k]
        drives = [(q, v, a) for (q, v, _), a in zip(moving.drives, seconds, strict=True)]
        loaded = self._motion(moving.state, moving.angles, drives, second=True)
        loaded.states.update(moving.states)
        values, extra, more = (
            self._friction(loaded, units, held) if has_dry_friction(self.compiled) else ([1.0], [0.0] * f, [0.0] * len(rests))
        )
        acceleration = [a + b for a, b in zip(first, extra, strict=True)]
        efforts = [p + b for p, b in zip(effort, more, strict=True)]
        resting = [self.model.mechanism.drives[i].joint in rests for i in free]
        acceleration = [0.0 if it else a for it, a in zip(resting, acceleration, strict=True)]
        one = [float(i == j) for i in range(f) for j in range(i + 1)]
        lower = [x for row in inertia for x in row]
        coordinates = [self._coordinate(moving, joint) for joint in joints_with_stops(self.compiled)]
        joints = [x for order in zip(*coordinates, strict=True) for x in order]
        self.contacts = ContactCounts(len(values) // 4, len(rests), len(coordinates))
        return one + acceleration, [*values[:-1], *efforts, values[-1], *first, *lower, *joints]

    def _coordinate(self, moving: Motion, joint: str) -> tuple[Any, Any, Any]:
        """The coordinate of a joint with stops, its rate, and its second rate at q'' = 0."""
        j = self.model.joint_index[joint]
        if j in self.model.driven:
            return moving.drives[self.model.driven[j]]
        return moving.state.slide[j], moving.speeds.slide[j], moving.accelerations.slide[j]

    def _friction(self, loaded: Motion, units: list[Motion], held: _Held) -> tuple[list[Any], list[Any], list[Any]]:
        """Values of friction; the accelerations that it adds; the efforts that it adds to those that hold joints at rest."""
        code, modes, links = self.code, len(self.model.blocks), len(self.model.links)
        numbers = (code.input(f"m[{modes + i}]") for i in itertools.count())
        elements = elements_of(loaded, signs=(s - (1.0 - abs(s)) for s in numbers))  # sticking counts as sliding back
        count, plain = len(elements), [e.sign for e in elements]
        signs = [code.input(f"m[{modes + i}]") for i in range(count)]
        breaking, still = code.input(f"m[{modes + count}]"), [1.0 - abs(s) for s in signs]
        for e in elements:
            if e.what == "slide" and e.index < 0:
                raise Untraceable(f"friction acts on the cam of {e.joint}")
        tau = [[relative_rate(u, u.speeds, e.what, e.index, e.links) for u in units] for e in elements]
        responses = [held.response(row, [0.0] * len(self._resting)) for row in tau]
        factors = [np.where(breaking, e.limit, e.factor) for e in elements]
        braking = [x - s * f for x, s, f in zip(still, signs, factors, strict=True)]
        bias = [relative_rate(loaded, loaded.accelerations, e.what, e.index, e.links) for e in elements]
        coupling = [[_product(row, a) for a, _ in responses] for row in tau]
        scales = map(float, scales_of(self.model, elements))
        given = [RESIDUAL_TOLERANCE, *signs, *braking, *scales, *bias, *chain(*coupling)]
        shape = [count, *(int(e.euclidean) for e in elements)]
        force, moment, _ = totals(loaded)
        sided = [r for r, relation in enumerate(self.model.relations) if relation.kind not in ONE_SIDED]
        flanks: dict[int, Any] = {}
        for _ in range(FLANK_ROUNDS if sided else 1):
            forces, contacts, base = joint_forces(loaded, list(force), list(moment), flanks or None)
            before = flanks or base
            own = [x for e, s in zip(elements, plain, strict=True) for x in e.normal(loaded, forces, contacts, s)]
            by: list[list[tuple[Any, Any]]] = [[(0.0, 0.0)] * count for _ in elements]
            carried: list[dict[int, Any]] = []
            for j, source in enumerate(elements):
                unit: tuple[list[Any], list[Any]] = [0j] * links, [0.0] * links
                source.load(loaded, *unit, 1.0)
                add_inertia(loaded, units, responses[j][0], *unit)
                response, touching, of_unit = joint_forces(loaded, *unit, before)
                carried.append(of_unit)
                for i, e in enumerate(elements):
                    if e.kind != "brake":
                        by[i][j] = e.normal(loaded, response, touching, plain[i])
            pairs = (pair[axis] for row in by for axis in (0, 1) for pair in row)
            *solved, factor = code.filled("dry", 2 * count + 1, shape, [*given, *own, *pairs])
            flanks = {r: x + _product(solved[:count], [of_unit[r] for of_unit in carried]) for r, x in base.items()}
        for r in sided:  # those that carry with friction are those that were assumed, else numpy has to find them
            factor = factor * (1.0 - abs((flanks[r] < 0.0) - (before[r] < 0.0)))
        value, size = [x / factor for x in solved[:count]], solved[count:]
        second = [b + _product(row, value) for b, row in zip(bias, coupling, strict=True)]
        limits = [x * e.limit for x, e in zip(size, elements, strict=True)]
        extra, more = ([_product(row, value) for row in zip(*(a[k] for a in responses), strict=True)] for k in (0, 1))
        return [*value, *limits, *(e.rate for e in elements), *second, factor], extra, more


class _Held:
    """Linear equations M a = Q + G' p, G a + b = 0 on symbols, as `reduced.constrained`."""

    def __init__(self, writer: EquationsWriter, mass: list[list[Any]], rows: list[list[Any]]):
        self._writer, self._mass, self._rows = writer, mass, rows

    def response(self, force: list[Any], second: list[Any]) -> tuple[list[Any], list[Any]]:
        """Accelerations and constraint forces."""
        f, rows = len(self._mass), self._rows
        if f == 1 and not rows:
            return [force[0] / self._mass[0][0]], []
        matrix = [[*own, *(-row[i] for row in rows)] for i, own in enumerate(self._mass)] + [
            [*row, *[0.0] * len(rows)] for row in rows
        ]
        right = [*force, *(-b for b in second)]
        x: list[Any] = list(self._writer.code.filled("linear", len(right), [len(right)], [*chain(*matrix), *right]))
        if len(rows) == f:  # everything is held where nothing moves: rounding would have a direction
            moves = [abs(b) for b in second if isinstance(b, Symbol) or b]
            x[:f] = [a * np.where(sum(moves, 0.0) > 0.0, 1.0, 0.0) if moves else 0.0 for a in x[:f]]
        return x[:f], x[f:]


def add_inertia(
    motion: Motion, units: Sequence[Motion], response: Sequence[Values], force: list[Plane], moment: list[Values]
) -> None:
    """Add to the loads on the links the inertia forces of accelerations ``response`` of the coordinates, (...) each."""
    model = motion.model
    for k in range(1, len(model.links)):
        mass, centre, inertia = model.masses[k]
        if not (mass or inertia):
            continue
        rotation_class = model.angles.rotation_class[k]
        a: Plane = 0j
        alpha: Values = 0.0
        for own, unit in zip(response, units, strict=True):
            a = a + own * unit.of_point(k, centre, 1)
            alpha = alpha + own * unit.speeds.angular[rotation_class]
        force[k] = force[k] - mass * a
        moment[k] = moment[k] - inertia * alpha - cross(centre * motion.rotation(k), mass * a)


def _second(motion: Motion, joint: str) -> Values:
    """Second rate of a joint's coordinate at q'' = 0."""
    model, rates = motion.model, motion.accelerations
    j = model.joint_index.get(joint)
    if j is not None and j in model.driven:
        return motion.drives[model.driven[j]][2]
    if j is not None and model.joints[j].coordinate == "slide":
        return rates.slide[j]
    first, second = (model.index[x] for x in next(c.links for c in model.connections if c.name == joint))
    rotation_class = model.angles.rotation_class
    return rates.angular[rotation_class[second]] - rates.angular[rotation_class[first]]


def _product(a: Sequence[Any], b: Sequence[Any]) -> Any:
    return sum((x * y for x, y in zip(a, b, strict=True)), 0.0)
