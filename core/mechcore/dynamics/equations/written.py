"""Reduced equations of motion written out in C: the code of positions, rates, effects and reduction, run on symbols.

What C does not have (groups that Newton's method solves, cams, laws that are functions of Python) is told in words; numpy does all
then.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mechcore.branches.unwrapped import LinkAngles, StartPose
from mechcore.compiled.collocation import WrittenEquations
from mechcore.compiled.steps import check_traceable, followed_angle, place_all
from mechcore.compiled.symbols import Code, Symbol, Untraceable, rotation
from mechcore.dynamics.equations.reduced import free_of, integrating, rates_of_joints, reduced_terms
from mechcore.dynamics.integration.windows import MARGIN
from mechcore.effects.registry import effects_of
from mechcore.kinematics.columns import all_columns, all_vectors
from mechcore.kinematics.model import Model
from mechcore.kinematics.rates import accelerations, velocities
from mechcore.kinematics.state import State
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.spec.mechanism import braked


def written_equations(compiled: Compiled) -> tuple[WrittenEquations, tuple[int, ...]]:
    """The reduced equations of a mechanism with free coordinates, and the groups whose angles they follow.

    Raises `Untraceable` with the reason where C does not have them.
    """
    model = compiled.model
    check_traceable(model)
    if "friction" in compiled.mechanism.effects and braked(compiled.mechanism.joints):
        raise Untraceable("dry friction depends on the reactions")
    writer = _Writer(compiled)
    return writer.equations(), tuple(writer.followed)


class _Writer:
    """The mechanism on symbols of one program."""

    def __init__(self, compiled: Compiled):
        self.compiled, self.model, self.code = compiled, compiled.model, Code()
        self.followed: list[int] = []  # groups whose angles are, in the order of the program's

    def equations(self) -> WrittenEquations:
        model, free, code = self.model, free_of(self.compiled), self.code
        drives: list[tuple[Any, Any, Any]] = []
        for d in range(len(model.mechanism.drives)):
            if d in free:
                k = free.index(d)
                drives.append((code.input(f"q[{k}]"), code.input(f"v[{k}]"), 0.0))
            else:
                k = 3 * (d - sum(x < d for x in free))
                drives.append(tuple(code.input(f"d[{k + i}]") for i in range(3)))  # type: ignore[arg-type]
        state = self._state([q for q, _, _ in drives])
        angles = self._angles(state)
        moving = self._motion(state, angles, drives, second=True)
        units = [self._motion(state, angles, [(q, 1.0 * (d == i), 0.0) for d, (q, _, _) in enumerate(drives)]) for i in free]
        states = integrating(self.compiled)
        moving.states.update({e.name: code.input(f"v[{len(free) + i}]") for i, e in enumerate(states)})  # type: ignore[misc]
        try:
            inertia, bias, force = reduced_terms(moving, units)
            integrated = [self._operand(e.state_rate(moving)) for e in states]
            _, rates = rates_of_joints(self.compiled, units)
        except Untraceable:
            raise
        except (TypeError, AttributeError, ValueError, IndexError, KeyError) as error:  # what code for arrays says of symbols
            raise Untraceable(f"a load is computed in a way that C does not have ({error})") from error
        outputs = [self._operand(inertia[i][j]) for i in range(len(free)) for j in range(i + 1)]
        outputs += [self._operand(q - h) for q, h in zip(force, bias, strict=True)]
        outputs += integrated
        ratios, forms = [self._operand(x) for row in rates for x in row], self._forms(moving)
        near = [self._operand(state.angle[g]) for g in self.followed]  # after all that may ask for an angle
        given = 3 * (len(drives) - len(free))
        return WrittenEquations(code, (outputs, near, ratios, forms), (len(free), len(states)), given, MARGIN)

    def _forms(self, motion: Motion) -> list[Any]:
        """Whole numbers for the forms of the laws that effects follow, see `Effect.phase`; none where C does not have them all."""
        effects: list[Any] = [e for e in effects_of(self.compiled.mechanism) if e.piecewise]
        try:
            return [self._operand(e.phase(motion)) for e in effects]
        except (TypeError, AttributeError, ValueError, IndexError):  # what code for arrays says of symbols
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
            state.near[f"angle {g}"] = self._near(g)
        place_all(model, state, [code.input(f"m[{k}]") for k in range(len(model.blocks))])
        return state

    def _near(self, group: int) -> Symbol:
        self.followed.append(group)
        return self.code.input(f"near[{len(self.followed) - 1}]")

    def _angles(self, state: Any) -> LinkAngles:
        """Angles of the links, those of groups followed only where something asks for them."""
        model = self.model

        def of_class(rotation_class: int) -> Any:
            group = model.angles.class_group[rotation_class]
            if group and group not in state.angle:
                state.near[f"angle {group}"] = self._near(group)
                state.angle[group] = followed_angle(model, state, group)
            angle = state.angle[group] if group else 0.0
            return angle + sum((sign * state.drives[d] for d, sign in model.angles.class_drives[rotation_class]), 0.0)

        return _SymbolAngles(model, self.compiled.angles.start, of_class, exact=self.compiled.angles.exact)

    def _motion(self, state: Any, angles: LinkAngles, drives: Any, *, second: bool = False) -> Motion:
        model = self.model
        time: Any = self.code.input("t")
        motion = Motion(model, time, drives, state, angles)
        vectors = all_vectors(model, state)
        columns = all_columns(model, vectors)
        speeds = velocities(model, vectors, columns, [v for _, v, _ in drives])
        given: dict[str, Any] = {"drives": drives, "loop_vectors": vectors, "columns": columns, "speeds": speeds}
        if second:
            given["accelerations"] = accelerations(model, vectors, columns, speeds, [a for _, _, a in drives])
        vars(motion).update(given)
        return motion


class _SymbolAngles(LinkAngles):
    """Angles of the links on symbols."""

    def __init__(self, model: Model, start: StartPose, of_class: Callable[[int], Any], *, exact: bool):
        super().__init__(model, start, lambda: None, lambda raw: raw, exact)  # type: ignore[arg-type, return-value]
        self._of_class = of_class

    def link(self, k: int) -> Any:
        turning = self.model.angles
        return self._of_class(turning.rotation_class[k]) + turning.offset[k]
