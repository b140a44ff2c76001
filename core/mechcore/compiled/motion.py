"""Positions and rates over frames by a compiled program: one call in place of some hundred calls of numpy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from mechcore.accuracy import DEFAULT
from mechcore.arrays import Complex, Real, Values
from mechcore.compiled.kernels import Kernel, NumberRows
from mechcore.compiled.steps import check_traceable, origins, placed_state
from mechcore.compiled.symbols import HELPERS, Untraceable
from mechcore.compiled.toolchain import library
from mechcore.errors import MechanismError
from mechcore.kinematics.columns import all_columns, all_vectors
from mechcore.kinematics.model import Model
from mechcore.kinematics.rates import Rates, accelerations, velocities
from mechcore.kinematics.state import State, initial_state

Executor = Literal["auto", "numpy", "c"]
"""The executor of a mechanism's program: numpy over all frames, or a program in C that is compiled when first needed."""
LEAST_FRAMES_TO_COMPILE = 1_000_000  # frames from which on compiling a program costs less than it spares: both grow with its length
MOST_LINES = 40_000  # of a program: compiling that takes some 20 s


class CompiledRates(NamedTuple):
    """First and second rates, and those of the origins of all moving links."""

    speeds: Rates
    accelerations: Rates
    origin_velocities: list[Complex]
    origin_accelerations: list[Complex]


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
        self._positions, self._rates = self._of_positions(), self._of_rates()
        self.lines = self._positions.lines + self._rates.lines
        self.source = HELPERS + self._positions.source() + self._rates.source()

    def _of_positions(self) -> Kernel:
        kernel, model = Kernel("positions"), self.model
        drives = [kernel.real(f"drive {d}") for d in range(len(model.mechanism.drives))]
        driven = model.angles.class_drives
        delta: list[Any] = [kernel.plane(f"delta {s}") if drives else 1 + 0j for s, drives in enumerate(driven)]
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
            tolerance=kernel.real("tolerance") if self._general else DEFAULT.position,
        )
        for s in self._classes:
            kernel.put_plane(state.rot[s])
        for j in self._slides:
            kernel.put(state.slide[j])
        self._angles = list(state.angle)
        for g in self._angles:
            kernel.put(state.angle[g])
        self._curves = list(state.curve_values)
        for r in self._curves:
            for k in range(3):
                kernel.put(state.curve_values[r][k])
        for place in origins(model, state.rot, {j: s * state.rot[model.guides[j][0]] for j, s in state.slide.items()})[1:]:
            kernel.put_plane(place)
        return kernel

    def _of_rates(self) -> Kernel:
        kernel, model = Kernel("rates"), self.model
        known: list[Any] = [kernel.plane(f"rot {s}") if s else 1 + 0j for s in range(len(model.angles.class_group))]
        slide: Any = {j: kernel.real(f"slide {j}") for j in (*self._slides, *(j for j, _ in model.program.driven_slides))}
        state = State(drives=[], delta=[], rot=known, slide=slide)
        vectors = all_vectors(model, state)
        columns = all_columns(model, vectors)
        count = len(model.mechanism.drives)
        driven: list[Any] = [[kernel.real(f"rate {d} {k}") for d in range(count)] for k in (1, 2)]
        curve_values: Any = {r: (None, kernel.real(f"curve {r} 1"), kernel.real(f"curve {r} 2")) for r in self._curves}
        speeds: Any = velocities(model, vectors, columns, driven[0], curve_values=curve_values)
        bent: Any = accelerations(model, vectors, columns, speeds, driven[1])
        for rates in (speeds, bent):
            for s in self._classes:
                kernel.put_plane(rates.factor[s])
                kernel.put(rates.angular[s])
            for j in self._slides:
                kernel.put(rates.slide[j])
            for g in self._groups:
                kernel.put(rates.group[g])
        once, twice = ([f * e for f, e in zip(rates.factor, known, strict=True)] for rates in (speeds, bent))
        along, faster = {}, {}
        for j, s in slide.items():
            c = model.guides[j][0]
            along[j] = speeds.slide[j] * known[c] + s * once[c]
            faster[j] = bent.slide[j] * known[c] + 2.0 * speeds.slide[j] * once[c] + s * twice[c]
        for places in (origins(model, once, along), origins(model, twice, faster)):
            for place in places[1:]:
                kernel.put_plane(place)
        return kernel

    def load(self) -> MotionProgram:
        """The program ready to run. Raises `MechanismError` where it cannot be compiled."""
        loaded = library(self.source)
        self._positions.load(loaded)
        self._rates.load(loaded)
        return self

    def place_all(
        self,
        drives: Sequence[Values],
        modes: Sequence[Values],
        starts: Mapping[str, Real] | None,
        constants: Sequence[float],
        n: int,
        tolerance: float = DEFAULT.position,
    ) -> tuple[State, list[Complex]]:
        """Positions of all blocks at n frames, as `mechcore.kinematics.positions.place_all`, and origins of moving links."""
        state = initial_state(self.model, drives, constants, starts, tolerance)
        given: dict[str, Any] = {f"drive {d}": q for d, q in enumerate(drives)}
        given |= {f"delta {s}": x for s, x in enumerate(state.delta)}
        given |= {f"mode {k}": x for k, x in enumerate(modes)}
        given |= {f"constant {r}": x for r, x in enumerate(constants)}
        given |= {f"near {g}": state.near[f"angle {g}"] for g in self.model.multi_turn}
        for block in self._general:
            guess = np.asarray(state.near[block.name])
            given |= {f"start {block.name} {k}": guess[..., k] for k in range(len(block.unknowns))}
        given["tolerance"] = tolerance
        rows = NumberRows(self._positions(n, given)[0])
        for s in self._classes:
            state.rot[s] = rows.plane()
        state.slide |= {j: rows.real() for j in self._slides}
        state.angle |= {g: rows.real() for g in self._angles}
        state.curve_values |= {r: rows.reals(3) for r in self._curves}
        return state, [rows.plane() for _ in self.model.links[1:]]

    def rates(self, state: State, first: Sequence[Values], second: Sequence[Values], n: int) -> CompiledRates:
        """First and second rates at n frames, as `mechcore.kinematics.rates`, for rates of the drives."""
        given: dict[str, Any] = {f"rot {s}": x for s, x in enumerate(state.rot)}
        given |= {f"slide {j}": x for j, x in state.slide.items()}
        given |= {f"curve {r} {k}": state.curve_values[r][k] for r in self._curves for k in (1, 2)}
        for k, of_drives in enumerate((first, second), 1):
            given |= {f"rate {d} {k}": x for d, x in enumerate(of_drives)}
        rows = NumberRows(self._rates(n, given)[0])
        speeds = Rates(self.model, first, state.curve_values)
        both = speeds, Rates(self.model, second, state.curve_values, speeds)
        for rates in both:
            for s in self._classes:
                rates.factor[s], rates.angular[s] = rows.plane(), rows.real()
            rates.slide |= {j: rows.real() for j in self._slides}
            rates.group |= {g: rows.real() for g in self._groups}
        return CompiledRates(*both, *([rows.plane() for _ in self.model.links[1:]] for _ in both))


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
