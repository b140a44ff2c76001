"""Reactions and drive efforts by a compiled program: the same code on symbols, written out in C."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from mechcore.arrays import Plane, Real, Values
from mechcore.branches.unwrapped import AngleRange, GivenLinkAngles, LinkAngles, StartPose
from mechcore.compiled.kernels import KERNEL_HELPERS, Kernel, Results
from mechcore.compiled.motion import MOST_LINES
from mechcore.compiled.steps import check_forces_traceable
from mechcore.compiled.symbols import Symbol, Untraceable, on_symbols
from mechcore.compiled.toolchain import library
from mechcore.effects.registry import totals
from mechcore.forces.equilibrium import joint_forces
from mechcore.forces.friction.elements import elements_of, two_sided
from mechcore.forces.friction.normal_loads import NormalLoads
from mechcore.forces.friction.solve import FrictionResult, check_friction
from mechcore.kinematics.model import Model
from mechcore.kinematics.state import State
from mechcore.motion.motion import Motion
from mechcore.spec.mechanism import joints_with_friction

TransmittedSymbols = list[tuple[Plane, Values]]
Contacts = dict[str, tuple[Plane, Plane]]


def with_friction(
    motion: Motion, force: list[Any], moment: list[Any], signs: Iterable[Any] | None, tolerance: object
) -> tuple[TransmittedSymbols, Contacts, list[Any]]:
    """As `solve_friction` on symbols, for the ``signs`` of the elements' rates if they are given; and the normal loads, the
    residual of their equations, the number of steps, and whether these converge with the flanks that carry without friction.

    Raises `Untraceable` where a cam may press on either side."""
    if two_sided(motion):
        raise Untraceable("dry friction acts on a cam that may press on either side")
    elements, count = elements_of(motion, signs=signs), len(force)
    forces, contacts, flanks = joint_forces(motion, list(force), list(moment))
    own: list[Any] = [part for e in elements for part in e.normal(motion, forces, contacts, e.sign)]
    coupling: list[list[tuple[Any, Any]]] = [[(0.0, 0.0)] * len(elements) for _ in elements]
    for j, source in enumerate(elements):
        unit: tuple[list[Any], list[Any]] = [0j] * count, [0.0] * count
        source.load(motion, *unit, -source.sign * source.factor)
        response, touching, _ = joint_forces(motion, *unit, flanks)
        for i, e in enumerate(elements):
            if e.kind != "brake":
                coupling[i][j] = e.normal(motion, response, touching, e.sign)
    own += [pair[axis] for row in coupling for axis in (0, 1) for pair in row]
    code = next(x for x in (tolerance, *own) if isinstance(x, Symbol)).code
    lengths = [int(e.euclidean) for e in elements]
    *loads, residual, steps, converged = code.filled("rubbing", len(lengths) + 3, [len(lengths), *lengths], [tolerance, *own])
    for e, load in zip(elements, loads, strict=True):
        e.load(motion, force, moment, -e.sign * e.factor * load)
    transmitted, contacts, after = joint_forces(motion, force, moment, flanks)
    for r, before in flanks.items():
        converged = converged * (1.0 - abs((after[r] < 0.0) - (before < 0.0)))
    return transmitted, contacts, [*loads, residual, steps, converged]


class WrittenFriction(FrictionResult):
    """Friction on symbols: the part that a sweep needs."""

    def __init__(self, motion: Motion, loads: Sequence[Any]):
        self.motion, self.elements, self._loads = motion, tuple(elements_of(motion)), tuple(loads)

    def value(self, i: int) -> Any:
        element = self.elements[i]
        return -element.sign * element.factor * self._loads[i]


def rubbing_forces(motion: Motion, force: list[Any], moment: list[Any]) -> tuple[TransmittedSymbols, Contacts, FrictionResult]:
    """As `with_friction`, and the friction, for a motion of symbols whose speeds have known peaks; NaN where the loads do not
    converge."""
    transmitted, contacts, (*loads, _, _, converged) = with_friction(motion, force, moment, None, motion.accuracy.friction)
    valid = converged / converged
    return [(f * valid, c * valid) for f, c in transmitted], contacts, WrittenFriction(motion, loads)


class ForcesProgram:
    """Reactions in the joints of a model, from positions and the drives' rates. Raises `Untraceable` where C does not have it."""

    def __init__(self, model: Model, exact: bool):
        check_forces_traceable(model)
        self._solution: list[
            Any
        ] = []  # normal loads, residual of their equations, steps, whether they converge; with friction only
        self._loaded, self._kernel = False, (kernel := Kernel("forces", of_time=Kernel.real))
        self._results = results = Results(kernel)
        rot: list[Any] = [kernel.plane(f"rot {s}") if s else 1 + 0j for s in range(len(model.angles.class_group))]
        slide: Any = {j: kernel.real(f"slide {j}") for j, joint in enumerate(model.joints) if joint.slide is not None}
        drives: Any = [tuple(kernel.real(f"drive {d} {k}") for k in range(3)) for d in range(len(model.mechanism.drives))]
        time: Any = kernel.real("time")
        self._angles = _GivenAngles(model, kernel, exact)
        self._curves = [(r, k) for r, c in enumerate(model.constraints) if c.curve is not None for k in range(3)]
        curve_values: Any = {r: [kernel.real(f"curve {r} {k}") for k in range(3)] for r, _ in self._curves}
        motion = Motion(
            model, time, drives, State([q for q, _, _ in drives], [], rot, slide, curve_values=curve_values), self._angles
        )
        vars(motion).update(drives=drives, shape=())
        with on_symbols("a load"):
            force, moment, _ = totals(motion)
            if "friction" in model.mechanism.effects and joints_with_friction(model.mechanism.joints):
                signs = (kernel.real(f"sign {i}") for i in itertools.count())
                transmitted, contacts, self._solution = with_friction(motion, force, moment, signs, kernel.real("tolerance"))
            else:
                transmitted, contacts, _ = joint_forces(motion, force, moment)
        self._transmitted, self._contacts = len(transmitted), list(contacts)
        for f, couple in transmitted:
            results.put(f, plane=True)
            results.put(couple)
        for place, f in contacts.values():
            results.put(place, plane=True)
            results.put(f, plane=True)
        for x in self._solution:
            results.put(x)
        self.lines = kernel.lines
        self.source = KERNEL_HELPERS + kernel.source()

    @property
    def rubs(self) -> bool:
        """Whether the program contains dry friction."""
        return bool(self._solution)

    def __call__(self, motion: Motion) -> tuple[TransmittedSymbols, Contacts, FrictionResult | None] | None:
        """As `joint_forces` under the loads and effects of a motion, and the friction; None where numpy has to solve for it.

        Raises `MechanismError` where it cannot be compiled."""
        if not self._loaded:
            self._kernel.load(library(self.source))
            self._loaded = True
        given: dict[str, Any] = {f"rot {s}": x for s, x in enumerate(motion.state.rot)} | {"time": motion.time}
        given |= {f"slide {j}": x for j, x in motion.state.slide.items()}
        given |= {f"drive {d} {k}": x for d, known in enumerate(motion.drives) for k, x in enumerate(known)}
        given |= {f"curve {r} {k}": motion.state.curve_values[r][k] for r, k in self._curves}
        given |= {key: of(motion.angles) for key, of in self._angles.asked.items()}
        given |= {f"function {k}": function(motion.time) for k, function in enumerate(self._kernel.code.of_time)}
        elements = []
        if self._solution:
            check_friction(motion)
            elements = elements_of(motion)
            given |= {f"sign {i}": e.sign for i, e in enumerate(elements)} | {"tolerance": motion.accuracy.friction}
        n = motion.frames
        values = iter(self._results(n, given)(0, len(self._results)))
        transmitted = [(next(values), next(values)) for _ in range(self._transmitted)]
        contacts = {name: (next(values), next(values)) for name in self._contacts}
        if not self._solution:
            return transmitted, contacts, None
        *of_elements, residual, steps, converged = (np.broadcast_to(x, n) for x in values)
        loads = np.stack(of_elements, axis=-1)
        if not converged.all():
            return None
        solution = NormalLoads(loads, np.zeros(n, bool), np.ones(n), np.zeros(loads.shape), residual, int(steps.max(initial=0)))
        return transmitted, contacts, FrictionResult(motion, elements, solution)


class _GivenAngles(GivenLinkAngles):
    """Angles that are inputs of the program, as far as they are needed."""

    def __init__(self, model: Model, kernel: Kernel, exact: bool):
        super().__init__(model, StartPose({}, {}), exact)
        self._kernel = kernel
        self.asked: dict[str, Callable[[LinkAngles], Real]] = {}

    def link(self, k: int) -> Any:
        return self._given(f"angle {k}", lambda angles: angles.link(k))

    def joint(self, name: str) -> Any:
        return self._given(f"angle {name}", lambda angles: angles.joint(name))

    def relative(self, p: int, q: int, about: AngleRange | None = None) -> Any:
        return self._given(f"angle {p} {q} {about}", lambda angles: angles.relative(p, q, about))

    def _given(self, key: str, of: Callable[[LinkAngles], Real]) -> Any:
        self.asked[key] = of
        return self._kernel.real(key)


def forces_program(model: Model, *, exact: bool) -> ForcesProgram | str:
    """The program of a model, or the reason why C has none; ``exact`` as of `LinkAngles`."""
    known = model.cached(_known)
    if exact not in known:
        try:
            program = ForcesProgram(model, exact)
            known[exact] = program if program.lines <= MOST_LINES else f"the program would have {program.lines:,} lines"
        except Untraceable as reason:
            known[exact] = str(reason)
    return known[exact]


def _known(_: Model) -> dict[bool, ForcesProgram | str]:
    return {}
