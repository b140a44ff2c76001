"""Positions and rates over frames by a compiled program: one call instead of some hundred calls of numpy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import accumulate, islice, pairwise
from typing import Any, Literal

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
from mechcore.numerics.frames import lazy

Executor = Literal["auto", "numpy", "c"]
"""The executor of a mechanism's program: numpy over all frames, or a program in C that is compiled when first needed."""
LEAST_FRAMES_TO_COMPILE = 1_000_000  # frames above which compiling a program costs less than it saves: both grow with its length
MOST_LINES = 40_000  # of a program: compiling that takes some 20 s


Rows = Callable[[int, int], list[Any]]
"""Function that gives the values of a program for any range of their order."""


class CompiledRates:
    """First or second rates, derivatives of all rotations, and rates of the origins of all moving links, read from a program's
    values on demand."""

    def __init__(self, program: MotionProgram, values: Rows, state: State, drives: Sequence[Values], before: CompiledRates | None):
        self._program, self._values, self._state, self._drives, self._before = program, values, state, drives, before
        self._first = 0 if before is None else program.of_rates

    @lazy
    def rates(self) -> Rates:
        """Rates of all rotation classes, sliding joints and groups."""
        program, driven = self._program, self._program.model.program.driven_slides
        angular, slides, groups, _, _ = program.parts_of_rates
        slide = {j: self._drives[d] for j, d in driven} | dict(zip(program.slides, self._part(slides), strict=True))
        group = dict(zip(program.groups, self._part(groups), strict=True))
        before = None if self._before is None else self._before.rates
        return SolvedRates(self._drives, self._state.curve_values, before, self._part(angular), slide, group)

    @lazy
    def turned(self) -> list[Plane]:
        return self._part(self._program.parts_of_rates[3])

    @lazy
    def origins(self) -> list[Plane]:
        return self._part(self._program.parts_of_rates[4])

    def _part(self, part: tuple[int, int]) -> list[Any]:
        return self._values(self._first + part[0], self._first + part[1])


class MotionProgram:
    """The forward program of a model in C. Raises `Untraceable` where a step cannot be written in C."""

    def __init__(self, model: Model):
        check_traceable(model)
        self.model = model
        turning, program = model.angles, model.program
        self._classes = [s for g in range(1, turning.groups) for s in program.classes_of[g]]
        self.slides = [j for b in model.blocks for j in b.slides]
        self.groups = [g for b in model.blocks for g in b.angles]
        self._general = [b for b in model.blocks if b.kind == "general"]
        self._sliding = [*self.slides, *(j for j, _ in program.driven_slides)]
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
        for j in self.slides:
            results.put(state.slide[j])
        self._angles = list(state.angle)
        for g in self._angles:
            results.put(state.angle[g])
        self._curves = list(state.curve_values)
        for r in self._curves:
            for k in range(3):
                results.put(state.curve_values[r][k])
        self._of_state = len(results)
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
        counts = len(known), len(self.slides), len(self.groups), len(known), len(model.links) - 1
        self.of_rates = sum(counts)  # number of values of the first rates, and of the second
        self.parts_of_rates = tuple(pairwise(accumulate(counts, initial=0)))
        for rates, turned, slid in ((speeds, once, along), (bent, twice, faster)):
            for s in range(len(turned)):
                results.put(rates.angular[s])
            for j in self.slides:
                results.put(rates.slide[j])
            for g in self.groups:
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
    ) -> tuple[State, Callable[[], list[Plane]]]:
        """Positions of all blocks at n frames, as `mechcore.kinematics.positions.place_all`; and a function that gives the origins
        of moving links."""
        state = initial_state(self.model, drives, constants, starts, tolerance)
        near: list[Any] = []
        if starts:
            near += [state.near[f"angle {g}"] for g in self.model.multi_turn]
            for block in self._general:
                near.extend(np.moveaxis(np.asarray(state.near[block.name]), -1, 0))
        known = *drives, *map(state.delta.__getitem__, self._driven), *near, *constants, *modes, tolerance
        values = self._positions(n, known)
        own = iter(values(0, self._of_state))
        for s in self._classes:
            state.rot[s] = next(own)
        for j in self.slides:
            state.slide[j] = next(own)
        for g in self._angles:
            state.angle[g] = next(own)
        for r in self._curves:
            state.curve_values[r] = np.stack(np.broadcast_arrays(*islice(own, 3)))
        return state, partial(values, self._of_state, len(self._positions))

    def rates(self, state: State, first: Sequence[Values], second: Sequence[Values], n: int) -> tuple[CompiledRates, CompiledRates]:
        """First and second rates at n frames, as `mechcore.kinematics.rates`, for rates of the drives."""
        curves = [x for r in self._curves for x in state.curve_values[r][1:]]
        values = self._rates(n, (*state.rot[1:], *(state.slide[j] for j in self._sliding), *first, *second, *curves))
        speeds = CompiledRates(self, values, state, first, None)
        return speeds, CompiledRates(self, values, state, second, speeds)


def written_motion(model: Model) -> MotionProgram | str:
    """The program of a model, or the reason why C has none; call it through `Model.cached`."""
    try:
        program = MotionProgram(model)
    except Untraceable as reason:
        return str(reason)
    return program if program.lines <= MOST_LINES else f"the program would have {program.lines:,} lines"


def loaded(model: Model) -> MotionProgram | MechanismError | None:
    """The program of a model ready to run, or the error of its compilation; None where C has none. Call it through
    `Model.cached`."""
    program = model.cached(written_motion)
    if isinstance(program, str):
        return None
    try:
        return program.load()
    except MechanismError as error:
        return error


def motion_program(model: Model, executor: Executor, frames: int) -> MotionProgram | None:
    """The executor of a model's steps at a number of frames: a compiled program; None for numpy.

    Raises `MechanismError` where the executor is "c" and the program cannot be compiled.
    """
    if executor == "numpy" or (executor == "auto" and frames < LEAST_FRAMES_TO_COMPILE):
        return None
    program = model.cached(loaded)
    if isinstance(program, MechanismError):
        if executor == "c":
            raise program
        return None
    return program
