"""Reactions and drive efforts by a compiled program: the same code on symbols, written out in C."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mechcore.arrays import Plane, Real, Values
from mechcore.branches.unwrapped import LinkAngles, Range, StartPose
from mechcore.compiled.kernels import Kernel, Rows
from mechcore.compiled.motion import MOST_LINES
from mechcore.compiled.steps import check_forces_traceable
from mechcore.compiled.symbols import HELPERS, Symbol, Untraceable
from mechcore.compiled.toolchain import library
from mechcore.effects.registry import totals
from mechcore.forces.equilibrium import joint_forces
from mechcore.kinematics.model import Model
from mechcore.kinematics.state import State
from mechcore.motion.motion import Motion

Transmitted = list[tuple[Plane, Values]]
Contacts = dict[str, tuple[Plane, Plane]]


class ForcesProgram:
    """What the joints of a model transmit, from positions and the drives' rates. Raises `Untraceable` where C does not have it."""

    def __init__(self, model: Model, exact: bool):
        check_forces_traceable(model)
        self._loaded, self._kernel = False, (kernel := Kernel("forces", of_time=Kernel.real))
        rot: list[Any] = [kernel.plane(f"rot {s}") if s else 1 + 0j for s in range(len(model.angles.class_group))]
        slide: Any = {j: kernel.real(f"slide {j}") for j, joint in enumerate(model.joints) if joint.slide is not None}
        drives: Any = [tuple(kernel.real(f"drive {d} {k}") for k in range(3)) for d in range(len(model.mechanism.drives))]
        time: Any = kernel.real("time")
        self._angles = _GivenAngles(model, kernel, exact)
        self._bends = [(r, k) for r, c in enumerate(model.constraints) if c.curve is not None for k in range(3)]
        bends: Any = {r: [kernel.real(f"bend {r} {k}") for k in range(3)] for r, _ in self._bends}
        motion = Motion(model, time, drives, State([q for q, _, _ in drives], [], rot, slide, bends=bends), self._angles)
        vars(motion).update(drives=drives, shape=())
        try:
            force, moment, _ = totals(motion)
            transmitted, contacts, _ = joint_forces(motion, force, moment)
        except Untraceable:
            raise
        except (TypeError, AttributeError, ValueError, IndexError, KeyError) as error:  # what code for arrays says of symbols
            raise Untraceable(f"a load is computed in a way that C does not have ({error})") from error
        self._transmitted, self._contacts = transmitted, contacts
        for f, couple in transmitted:
            self._put(f, couple)
        for place, f in contacts.values():
            self._put(place)
            self._put(f)
        self.lines = kernel.lines
        self.source = HELPERS + kernel.source()

    def _put(self, vector: Any, number: Any = 0.0) -> None:
        """Rows of what is not plain."""
        if isinstance(vector, Symbol):
            self._kernel.put_plane(vector)
        if isinstance(number, Symbol):
            self._kernel.put(number)

    def __call__(self, motion: Motion) -> tuple[Transmitted, Contacts]:
        """As `joint_forces` under the loads and effects of a motion. Raises `MechanismError` where it cannot be compiled."""
        if not self._loaded:
            self._kernel.load(library(self.source))
            self._loaded = True
        given: dict[str, Any] = {f"rot {s}": x for s, x in enumerate(motion.state.rot)} | {"time": motion.time}
        given |= {f"slide {j}": x for j, x in motion.state.slide.items()}
        given |= {f"drive {d} {k}": x for d, known in enumerate(motion.drives) for k, x in enumerate(known)}
        given |= {f"bend {r} {k}": motion.state.bends[r][k] for r, k in self._bends}
        given |= {key: of(motion.angles) for key, of in self._angles.asked.items()}
        given |= {f"function {k}": function(motion.time) for k, function in enumerate(self._kernel.code.of_time)}
        rows = Rows(self._kernel(motion.frames, given)[0])

        def plane(value: Any) -> Any:
            return rows.plane() if isinstance(value, Symbol) else value

        def real(value: Any) -> Any:
            return rows.real() if isinstance(value, Symbol) else value

        transmitted = [(plane(f), real(couple)) for f, couple in self._transmitted]
        return transmitted, {name: (plane(place), plane(f)) for name, (place, f) in self._contacts.items()}


class _GivenAngles(LinkAngles):
    """Angles that the program is given, as far as something asks for them."""

    def __init__(self, model: Model, kernel: Kernel, exact: bool):
        super().__init__(model, StartPose({}, {}), lambda: None, lambda raw: raw, exact)  # type: ignore[arg-type, return-value]
        self._kernel = kernel
        self.asked: dict[str, Callable[[LinkAngles], Real]] = {}

    def link(self, k: int) -> Any:
        return self._given(f"angle {k}", lambda angles: angles.link(k))

    def joint(self, name: str) -> Any:
        return self._given(f"angle {name}", lambda angles: angles.joint(name))

    def relative(self, p: int, q: int, about: Range | None = None) -> Any:
        return self._given(f"angle {p} {q} {about}", lambda angles: angles.relative(p, q, about))

    def _given(self, key: str, of: Callable[[LinkAngles], Real]) -> Any:
        self.asked[key] = of
        return self._kernel.real(key)


def forces_program(model: Model, *, exact: bool) -> ForcesProgram | str:
    """The program of a model, or why C has none; ``exact`` as of `LinkAngles`."""
    known = model.once(_known)
    if exact not in known:
        try:
            program = ForcesProgram(model, exact)
            known[exact] = program if program.lines <= MOST_LINES else f"the program would have {program.lines:,} lines"
        except Untraceable as reason:
            known[exact] = str(reason)
    return known[exact]


def _known(_: Model) -> dict[bool, ForcesProgram | str]:
    return {}
