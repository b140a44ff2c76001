"""Positions and rates over frames by a compiled program: one call in place of some hundred calls of numpy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from mechcore.arrays import Real, Values
from mechcore.compiled.kernels import Kernel
from mechcore.compiled.steps import check_traceable, place_all
from mechcore.compiled.symbols import HELPERS, Untraceable
from mechcore.compiled.toolchain import compiler, library
from mechcore.errors import MechanismError
from mechcore.kinematics.columns import all_columns, all_vectors
from mechcore.kinematics.model import Model
from mechcore.kinematics.rates import Rates, accelerations, velocities
from mechcore.kinematics.state import State, initial_state

Executor = Literal["auto", "numpy", "c"]
"""What runs the steps of a mechanism's program: numpy over all frames, or a program in C that is compiled when first needed."""
PAYS = 1_000_000_000  # frames times lines of the program from which on compiling it (half a second) is the smaller part
MOST_LINES = 1000  # of a block: with less work than that, the program need not be written to know it


class MotionProgram:
    """The forward program of a model as C. Raises `Untraceable` where a step is not one that C has."""

    def __init__(self, model: Model):
        check_traceable(model)
        self.model = model
        turning, program = model.angles, model.program
        self._classes = [s for g in range(1, turning.groups) for s in program.classes_of[g]]
        self._slides = [j for b in model.blocks for j in b.slides]
        self._groups = [g for b in model.blocks for g in b.angles]
        self._positions, self._rates = self._of_positions(), self._of_rates()
        self.lines = self._positions.lines + self._rates.lines
        self.source = HELPERS + self._positions.source() + self._rates.source()

    def _of_positions(self) -> Kernel:
        kernel, model = Kernel("positions"), self.model
        drives = [kernel.real(f"drive {d}") for d in range(len(model.mechanism.drives))]
        driven = model.angles.class_drives
        delta: list[Any] = [kernel.plane(f"delta {s}") if drives else 1 + 0j for s, drives in enumerate(driven)]
        state: Any = State(
            drives=drives,  # type: ignore[arg-type]  # symbols stand for arrays
            delta=delta,
            rot=[delta[s] if g == 0 else None for s, g in enumerate(model.angles.class_group)],
            slide={j: drives[d] for j, d in model.program.driven_slides},  # type: ignore[misc]
            constants=[kernel.real(f"constant {r}") for r in range(len(model.constraints))],  # type: ignore[misc]
            near={f"angle {g}": kernel.real(f"near {g}") for g in model.multi_turn},  # type: ignore[misc]
        )
        place_all(model, state, [kernel.real(f"mode {k}") for k in range(len(model.blocks))])
        for s in self._classes:
            kernel.put_plane(state.rot[s])
        for j in self._slides:
            kernel.put(state.slide[j])
        self._angles = list(state.angle)
        for g in self._angles:
            kernel.put(state.angle[g])
        return kernel

    def _of_rates(self) -> Kernel:
        kernel, model = Kernel("rates"), self.model
        known: list[Any] = [kernel.plane(f"rot {s}") if s else 1 + 0j for s in range(len(model.angles.class_group))]
        slide: Any = {j: kernel.real(f"slide {j}") for j in (*self._slides, *(j for j, _ in model.program.driven_slides))}
        state = State(drives=[], delta=[], rot=known, slide=slide)
        vectors = all_vectors(model, state)
        columns = all_columns(model, vectors)
        count = len(model.mechanism.drives)
        first, second = ([kernel.real(f"rate {d} {k}") for d in range(count)] for k in (1, 2))
        speeds = velocities(model, vectors, columns, first)  # type: ignore[arg-type]
        for rates in (speeds, accelerations(model, vectors, columns, speeds, second)):  # type: ignore[arg-type]
            for s in self._classes:
                kernel.put_plane(rates.factor[s])
                kernel.put(rates.angular[s])
            for j in self._slides:
                kernel.put(rates.slide[j])
            for g in self._groups:
                kernel.put(rates.group[g])
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
    ) -> State:
        """Positions of all blocks at n frames, as `mechcore.kinematics.positions.place_all`."""
        state = initial_state(self.model, drives, constants, starts)
        given: dict[str, Any] = {f"drive {d}": q for d, q in enumerate(drives)}
        given |= {f"delta {s}": x for s, x in enumerate(state.delta)}
        given |= {f"mode {k}": x for k, x in enumerate(modes)}
        given |= {f"constant {r}": x for r, x in enumerate(constants)}
        given |= {f"near {g}": state.near[f"angle {g}"] for g in self.model.multi_turn}
        found = self._positions(n, given)
        for s in self._classes:
            state.rot[s] = found.plane()
        state.slide |= {j: found.real() for j in self._slides}
        state.angle |= {g: found.real() for g in self._angles}
        return state

    def rates(self, state: State, first: Sequence[Values], second: Sequence[Values], n: int) -> tuple[Rates, Rates]:
        """First and second rates at n frames, as `mechcore.kinematics.rates`, for rates of the drives."""
        given: dict[str, Any] = {f"rot {s}": x for s, x in enumerate(state.rot)}
        given |= {f"slide {j}": x for j, x in state.slide.items()}
        for k, of_drives in enumerate((first, second), 1):
            given |= {f"rate {d} {k}": x for d, x in enumerate(of_drives)}
        found = self._rates(n, given)
        speeds = Rates(self.model, first)
        both = speeds, Rates(self.model, second, before=speeds)
        for rates in both:
            for s in self._classes:
                rates.factor[s], rates.angular[s] = found.plane(), found.real()
            rates.slide |= {j: found.real() for j in self._slides}
            rates.group |= {g: found.real() for g in self._groups}
        return both


def written(model: Model) -> MotionProgram | str:
    """The program of a model, or why C has none; ask for it by `Model.once`."""
    try:
        return MotionProgram(model)
    except Untraceable as reason:
        return str(reason)


def loaded(model: Model) -> MotionProgram | None:
    """The program of a model ready to run; None where there is none, or no compiler that works. Ask for it by `Model.once`."""
    program = model.once(written)
    if isinstance(program, str) or compiler() is None:
        return None
    try:
        return program.load()
    except MechanismError:
        return None


def motion_program(model: Model, executor: Executor, frames: int) -> MotionProgram | None:
    """What runs the steps of a model at so many frames: a compiled program; None for numpy."""
    if executor == "numpy":
        return None
    if executor == "auto":
        if frames * len(model.blocks) < PAYS / MOST_LINES:
            return None
        program = model.once(written)
        if isinstance(program, str) or frames * program.lines < PAYS:
            return None
    return model.once(loaded)
