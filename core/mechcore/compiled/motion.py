"""Positions and rates over frames by a compiled program: one call in place of some hundred calls of numpy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice
from typing import Any, Literal, NamedTuple

import numpy as np

from mechcore.accuracy import DEFAULT
from mechcore.arrays import Plane, Real, Values
from mechcore.compiled.kernels import KERNEL_HELPERS, Kernel, Results
from mechcore.compiled.steps import check_traceable, origins, placed_state
from mechcore.compiled.symbols import Untraceable
from mechcore.compiled.toolchain import library
from mechcore.errors import MechanismError
from mechcore.kinematics.columns import all_columns, all_vectors
from mechcore.kinematics.model import Model
from mechcore.kinematics.rates import Rates, SolvedRates, accelerations, velocities
from mechcore.kinematics.state import State, initial_state

Executor = Literal["auto", "numpy", "c"]
"""The executor of a mechanism's program: numpy over all frames, or a program in C that is compiled when first needed."""
LEAST_FRAMES_TO_COMPILE = 1_000_000  # frames from which on compiling a program costs less than it spares: both grow with its length
MOST_LINES = 40_000  # of a program: compiling that takes some 20 s


class CompiledRates(NamedTuple):
    """First or second rates, derivatives of all rotations, and rates of the origins of all moving links."""

    rates: Rates
    turned: list[Plane]
    origins: list[Plane]


class MotionProgram:
    """The forward program of a model as C. Raises `Untraceable` where a step is not one that C has."""

    def __init__(self, model: Model):
        check_traceable(model)
        self.model = model
        turning, program = model.angles, model.program
        self._classes = [s for g in range(1, turning.groups) for s in program.classes_of[g]]
        self._slides = [j for b in model.blocks for j in b.slides]
        self._groups = [g for b in model.blocks for g in b.angles]
        self._general = [b for b in model.blocks if b.kind == "general"]
        self._sliding = [*self._slides, *(j for j, _ in program.driven_slides)]
        self._driven = [s for s, driven in enumerate(turning.class_drives) if driven]
        self._kernels = [Kernel("positions"), Kernel("rates")]
        self._positions, self._rates = self._of_positions(self._kernels[0]), self._of_rates(self._kernels[1])
        self.lines = sum(kernel.lines for kernel in self._kernels)
        self.source = KERNEL_HELPERS + "".join(kernel.source() for kernel in self._kernels)

    def _of_positions(self, kernel: Kernel) -> Results:
        model, results = self.model, Results(kernel)
        drives = [kernel.real(f"drive {d}") for d in range(len(model.mechanism.drives))]
        delta: list[Any] = [
            kernel.plane(f"delta {s}") if s in self._driven else 1 + 0j for s in range(len(model.angles.class_group))
        ]
        near: dict[str, Any] = {f"angle {g}": kernel.real(f"near {g}") for g in model.multi_turn}
        for block in self._general:
            near[block.name] = [kernel.real(f"start {block.name} {k}") for k in range(len(block.unknowns))]
        state = placed_state(
            model,
            [(q,) for q in drives],
            delta,
            constants=[kernel.real(f"constant {r}") for r in range(len(model.constraints))],
            near=near,
            modes=[kernel.real(f"mode {k}") for k in range(len(model.blocks))],
            tolerance=kernel.real("tolerance"),
        )
        for s in self._classes:
            results.put(state.rot[s], plane=True)
        for j in self._slides:
            results.put(state.slide[j])
        self._angles = list(state.angle)
        for g in self._angles:
            results.put(state.angle[g])
        self._curves = list(state.curve_values)
        for r in self._curves:
            for k in range(3):
                results.put(state.curve_values[r][k])
        for place in origins(model, state.rot, {j: s * state.rot[model.guides[j][0]] for j, s in state.slide.items()})[1:]:
            results.put(place, plane=True)
        return results

    def _of_rates(self, kernel: Kernel) -> Results:
        model, results = self.model, Results(kernel)
        known: list[Any] = [kernel.plane(f"rot {s}") if s else 1 + 0j for s in range(len(model.angles.class_group))]
        slide: Any = {j: kernel.real(f"slide {j}") for j in self._sliding}
        state = State(drives=[], delta=[], rot=known, slide=slide)
        vectors = all_vectors(model, state)
        columns = all_columns(model, vectors)
        count = len(model.mechanism.drives)
        driven: list[Any] = [[kernel.real(f"rate {d} {k}") for d in range(count)] for k in (1, 2)]
        curve_values: Any = {r: (None, kernel.real(f"curve {r} 1"), kernel.real(f"curve {r} 2")) for r in self._curves}
        speeds: Any = velocities(model, vectors, columns, driven[0], curve_values=curve_values)
        bent: Any = accelerations(model, vectors, columns, speeds, driven[1])
        once, twice = ([f * e for f, e in zip(rates.factor, known, strict=True)] for rates in (speeds, bent))
        along, faster = {}, {}
        for j, s in slide.items():
            c = model.guides[j][0]
            along[j] = speeds.slide[j] * known[c] + s * once[c]
            faster[j] = bent.slide[j] * known[c] + 2.0 * speeds.slide[j] * once[c] + s * twice[c]
        for rates, turned, slid in ((speeds, once, along), (bent, twice, faster)):
            for s in range(len(turned)):
                results.put(rates.angular[s])
            for j in self._slides:
                results.put(rates.slide[j])
            for g in self._groups:
                results.put(rates.group[g])
            for z in (*turned, *origins(model, turned, slid)[1:]):
                results.put(z, plane=True)
        return results

    def load(self) -> MotionProgram:
        """The program ready to run. Raises `MechanismError` where it cannot be compiled."""
        loaded = library(self.source)
        for kernel in self._kernels:
            kernel.load(loaded)
        return self

    def place_all(
        self,
        drives: Sequence[Values],
        modes: Sequence[Values],
        starts: Mapping[str, Real] | None,
        constants: Sequence[float],
        n: int,
        tolerance: float = DEFAULT.position,
    ) -> tuple[State, list[Plane]]:
        """Positions of all blocks at n frames, as `mechcore.kinematics.positions.place_all`, and origins of moving links."""
        state = initial_state(self.model, drives, constants, starts, tolerance)
        near = [state.near[f"angle {g}"] for g in self.model.multi_turn]
        for block in self._general:
            near.extend(np.moveaxis(np.asarray(state.near[block.name]), -1, 0))
        known = *drives, *(state.delta[s] for s in self._driven), *near, *constants, *modes, tolerance
        values = self._positions(n, known)
        for s in self._classes:
            state.rot[s] = next(values)
        state.slide |= {j: next(values) for j in self._slides}
        state.angle |= {g: next(values) for g in self._angles}
        state.curve_values |= {r: np.stack(np.broadcast_arrays(*islice(values, 3))) for r in self._curves}
        return state, list(values)

    def rates(self, state: State, first: Sequence[Values], second: Sequence[Values], n: int) -> tuple[CompiledRates, CompiledRates]:
        """First and second rates at n frames, as `mechcore.kinematics.rates`, for rates of the drives."""
        curves = [x for r in self._curves for x in state.curve_values[r][1:]]
        values = self._rates(n, (*state.rot[1:], *(state.slide[j] for j in self._sliding), *first, *second, *curves))
        links = len(self.model.links) - 1

        def taken(drives: Sequence[Values], before: Rates | None) -> CompiledRates:
            angular = list(islice(values, len(state.rot)))
            slide = {j: drives[d] for j, d in self.model.program.driven_slides} | {j: next(values) for j in self._slides}
            group = {g: next(values) for g in self._groups}
            rates = SolvedRates(drives, state.curve_values, before, angular, slide, group)
            return CompiledRates(rates, list(islice(values, len(state.rot))), list(islice(values, links)))

        speeds = taken(first, None)
        return speeds, taken(second, speeds.rates)


def written_motion(model: Model) -> MotionProgram | str:
    """The program of a model, or why C has none; ask for it by `Model.once`."""
    try:
        program = MotionProgram(model)
    except Untraceable as reason:
        return str(reason)
    return program if program.lines <= MOST_LINES else f"the program would have {program.lines:,} lines"


def loaded(model: Model) -> MotionProgram | MechanismError | None:
    """The program of a model ready to run, or why it cannot be compiled; None where there is none. Ask for it by `Model.once`."""
    program = model.once(written_motion)
    if isinstance(program, str):
        return None
    try:
        return program.load()
    except MechanismError as error:
        return error


def motion_program(model: Model, executor: Executor, frames: int) -> MotionProgram | None:
    """The executor of a model's steps at so many frames: a compiled program; None for numpy.

    Raises `MechanismError` where C is asked for and cannot be compiled.
    """
    if executor == "numpy" or (executor == "auto" and frames < LEAST_FRAMES_TO_COMPILE):
        return None
    program = model.once(loaded)
    if isinstance(program, MechanismError):
        if executor == "c":
            raise program
        return None
    return program
