"""Many designs of a mechanism by a compiled program: what a sweep collects from motions, generated as C code."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from typing import Any

import numpy as np

from mechcore.arrays import Complex, Flags, Real
from mechcore.branches.unwrapped import LARGEST_TURN, GivenLinkAngles, times_of_designs
from mechcore.compiled.kernels import KERNEL_HELPERS, Kernel
from mechcore.compiled.motion import MOST_LINES
from mechcore.compiled.steps import check_traceable, placed_state
from mechcore.compiled.symbols import Symbol, SymbolRows, Untraceable, on_symbols, rotation
from mechcore.compiled.toolchain import cached, library
from mechcore.constants import TURN
from mechcore.errors import MechanismError
from mechcore.kinematics.model import Model
from mechcore.kinematics.state import State, initial_state, wrapped_angle
from mechcore.laws.timed import ConstantSpeed, Law
from mechcore.motion.compiled import Compiled, DriveValues, drive_values
from mechcore.motion.motion import Motion
from mechcore.records import NumberPlace
from mechcore.spec.mechanism import Mechanism, joints_with_friction

FRAMES_TO_LOAD = 200_000  # frames of all designs from which generating a program and loading it from the cache pays
FRAMES_TO_COMPILE = 3_000_000  # from which compiling it pays: 0.3 s and half a millisecond per line, for 0.6 ns per line and frame
FRAMES_TO_COMPILE_FRICTION = 20_000  # from which both pay if numpy solves designs one by one: with dry friction, 10 ms each
Collect = Callable[[Motion], Mapping[str, Real]]
Weights = tuple[Real, Complex, Real]  # masses (D, 1), centres of mass, moments of inertia
VariedModel = Callable[[Compiled, Mapping[Any, Any], Mapping[str, Any], Mapping[NumberPlace, Any]], Model]


@dataclass(frozen=True, eq=False)
class DrivenDesigns:
    """The drives of several designs computed together.

    ``speed_factor`` (D, 1): factor on the speed at which each design runs through the laws of the mechanism; None: 1 for all.
    ``constant_speeds``: drives (by number) that have a start position and a constant speed (D, 1) for each design.
    """

    mechanism: Mechanism
    speed_factor: Real | None
    constant_speeds: Mapping[int, tuple[Real, Real]]

    def some(self, which: Flags) -> DrivenDesigns:
        """The drives of the designs ``which`` (D,)."""
        own = {d: (q[which], v[which]) for d, (q, v) in self.constant_speeds.items()}
        return replace(self, speed_factor=None if self.speed_factor is None else self.speed_factor[which], constant_speeds=own)

    @property
    def laws(self) -> tuple[Law, ...]:
        """A law for each drive, as fast as in the fastest design, over the times of the compiled design."""
        laws: list[Law] = [drive.law for drive in self.mechanism.drives]
        for d, (_, v) in self.constant_speeds.items():
            laws[d] = ConstantSpeed(
                0.0, float(np.max(np.abs(v if self.speed_factor is None else v / self.speed_factor), initial=0.0))
            )
        return tuple(laws)

    def values(self, time: Real) -> DriveValues:
        """Positions, speeds and accelerations, (n,) or (D, n), of all drives at times (n,) of the compiled design."""
        values = drive_values(self.mechanism, time)
        if self.speed_factor is not None:
            values = [(q, v * self.speed_factor, a * self.speed_factor**2) for q, v, a in values]
        for d, (start, speed) in self.constant_speeds.items():
            values[d] = start + (speed if self.speed_factor is None else speed / self.speed_factor) * time, speed, 0.0
        return values


class DesignProgram:
    """A program for values collected from the motions of designs in which some numbers vary. Raises `Untraceable` if these values
    cannot be computed in C.

    ``varied`` makes the model from the numbers that vary, those of ``points``, ``masses`` and ``loads``. The drives
    ``constant_speeds`` (by number) have a start and a speed for each design. ``paced``: designs differ in the speed at which they
    run through their laws.
    """

    def __init__(
        self,
        compiled: Compiled,
        varied: VariedModel,
        points: Sequence[tuple[str, str]],
        masses: Sequence[str],
        loads: Sequence[NumberPlace],
        constant_speeds: Sequence[int],
        paced: bool,
        time: Real,
        collect: Collect,
    ):
        check_traceable(compiled.model)
        if compiled.accuracy.differentiation != "exact":
            raise Untraceable("rates are differences")
        self._peaks: list[Symbol] = []
        self._compiled, self._kernel = compiled, (kernel := Kernel("designs"))
        self._constant_speeds, self._speed_factor = frozenset(constant_speeds), kernel.real("speed factor") if paced else None
        place = {key: kernel.plane(f"point {key}") for key in points}
        weights = {k: (kernel.real(f"mass {k}"), kernel.plane(f"centre {k}"), kernel.real(f"inertia {k}")) for k in masses}
        model = varied(compiled, place, weights, {key: kernel.real(f"load {key}") for key in loads})
        motion = self._motion(model, drive_values(model.mechanism, time))
        with on_symbols("a result or a load"):
            collected = {name: _operands(value) for name, value in collect(motion).items()}
        self._columns: dict[str, tuple[int, int | None]] = {}
        for name, (symbols, width) in collected.items():
            self._columns[name] = kernel.rows, width
            for symbol in symbols:
                kernel.put(symbol)
        assert isinstance(motion.angles, _Followed)
        steps = motion.angles.steps
        self._follows = bool(steps)
        kernel.put(reduce(np.maximum, steps) if steps else 0.0)
        solved = [part for x in (*motion.state.rot, *motion.state.slide.values()) for part in (np.real(x), np.imag(x))]
        kernel.put(sum((x for x in solved if isinstance(x, Symbol)), 0.0))
        first = kernel.beside("peaks")
        for x in self._peaks:
            first.put(first.carried(partial(_larger, x)))
        self._first = first if self._peaks else None  # runs over the frames first, for the peaks that the program needs
        self.lines = kernel.lines + (first.lines if self._peaks else 0)
        if self.lines > MOST_LINES:
            raise Untraceable(f"the program would have {self.lines:,} lines")
        self.source = KERNEL_HELPERS + kernel.source() + (first.source() if self._peaks else "")

    def _motion(self, model: Model, values: DriveValues) -> Motion:
        kernel, speed_factor = self._kernel, self._speed_factor
        time: Any = kernel.real_of_frame("time")
        drives: list[Any] = []
        for d, known in enumerate(values):
            if d in self._constant_speeds:
                speed: Any = kernel.real(f"speed {d}")
                drives.append(
                    (kernel.real(f"start {d}") + (speed if speed_factor is None else speed / speed_factor) * time, speed, 0.0)
                )
                continue
            still = [isinstance(x, float) and x == 0.0 for x in known]
            q, v, a = (0.0 if s else kernel.real_of_frame(f"drive {d} {k}") for k, s in enumerate(still))
            drives.append((q, v, a) if speed_factor is None else (q, v * speed_factor, a * speed_factor**2))
        delta: list[Any] = [1 + 0j] * len(model.angles.class_drives)
        for s, terms in enumerate(model.angles.class_drives):
            if any(d in self._constant_speeds for d, _ in terms):
                delta[s] = rotation(sum((sign * drives[d][0] for d, sign in terms), 0.0))
            elif terms:
                delta[s] = kernel.plane_of_frame(f"delta {s}")
        modes: list[Any] = [Symbol(kernel.code, float(mode), 0.0) for mode in self._compiled.assembly.modes]
        state = placed_state(model, drives, delta, constants=self._compiled.assembly.constants, modes=modes)
        angles = _Followed(self._compiled, model, kernel, state, self._constant_speeds)
        motion = Motion(model, time, drives, state, angles, accuracy=self._compiled.accuracy)
        vars(motion).update(drives=drives, shape=(), peak=self._peak)
        return motion

    def _peak(self, x: Any) -> Any:
        """The largest absolute value of a number over the frames of each design, an input of the program."""
        if not isinstance(x, Symbol):
            return abs(x)
        self._peaks.append(x)
        return self._kernel.real(f"peak {len(self._peaks) - 1}")

    @property
    def rows(self) -> int:
        """Number of values of a design at a frame."""
        return self._kernel.rows

    def load(self) -> DesignProgram:
        """Compile and load the program; returns it. Raises `MechanismError` if it cannot be compiled."""
        loaded = library(self.source)
        for kernel in (self._kernel, self._first) if self._first else (self._kernel,):
            kernel.load(loaded)
        return self

    def __call__(
        self,
        points: Mapping[tuple[str, str], Real],
        masses: Mapping[str, Weights],
        loads: Mapping[NumberPlace, Real],
        time: Real,
        driven: DrivenDesigns,
    ) -> tuple[dict[str, Real], Flags, Flags]:
        """Values of designs at times (F,), each (D, F, ...); which designs (D,) can be assembled at all frames; and for which (D,)
        angles may be wrong because links turn too far from one time to the next."""
        model, own = self._compiled.model, np.arange(len(time))
        if self._follows:
            time, own = times_of_designs(model, time, driven.laws)
        values = drive_values(model.mechanism, time)
        state = initial_state(model, [q for q, _, _ in values], self._compiled.assembly.constants)
        given: dict[str, Any] = {f"drive {d} {k}": x for d, known in enumerate(values) for k, x in enumerate(known)}
        given |= {f"start {d}": q[0] for d, (q, _, _) in enumerate(values)}
        given |= {
            f"{what} {d}": x[:, 0]
            for d, both in driven.constant_speeds.items()
            for what, x in zip(("start", "speed"), both, strict=True)
        }
        given |= {} if driven.speed_factor is None else {"speed factor": driven.speed_factor[:, 0]}
        given |= {f"delta {s}": x for s, x in enumerate(state.delta)}
        given |= {"time": time, "first": np.arange(len(time)) == 0}
        given |= {f"function {k}": function(time) for k, function in enumerate(self._kernel.code.of_time)}
        given |= {f"point {key}": xy[:, 0] + 1j * xy[:, 1] for key, xy in points.items()}
        for link, weights in masses.items():
            given |= {f"{what} {link}": x[:, 0] for what, x in zip(("mass", "centre", "inertia"), weights, strict=True)}
        given |= {f"load {key}": x[:, 0] for key, x in loads.items()}
        count = len(next(iter(points.values())))
        if self._first is not None:
            given |= {f"peak {k}": np.zeros(1) for k in range(len(self._peaks))}
            given |= {f"peak {k}": x for k, x in enumerate(self._first(count, given, len(time))[1][-1])}
        _, rows = self._kernel(count, given, len(time))
        far = np.asarray((rows[:, -2] > LARGEST_TURN).any(axis=0))
        if len(own) < len(time):
            rows = rows[own]
        results = {}
        for name, (first, width) in self._columns.items():
            of = rows[:, first] if width is None else rows[:, first : first + width]
            results[name] = of.T if width is None else of.transpose(2, 0, 1)
        return results, np.asarray(np.isfinite(rows[:, -1]).all(axis=0)), far


def design_program(
    compiled: Compiled,
    varied: VariedModel,
    keys: tuple[Sequence[tuple[str, str]], Sequence[str], Sequence[NumberPlace], Sequence[int], bool],
    time: Real,
    collect: Collect,
    count: int,
) -> DesignProgram | str:
    """The program for ``count`` designs at times (F,) if the executor of ``compiled`` uses one; else the reason why numpy is used.

    Raises `MechanismError` if the executor is C and the program cannot be compiled.
    """
    if compiled.executor == "numpy":
        return "as asked for"
    frames, auto = count * len(time), compiled.executor == "auto"
    rubs = "friction" in compiled.mechanism.effects and bool(joints_with_friction(compiled.mechanism.joints))
    some, many = (FRAMES_TO_COMPILE_FRICTION, FRAMES_TO_COMPILE_FRICTION) if rubs else (FRAMES_TO_LOAD, FRAMES_TO_COMPILE)
    few = f"{frames:,} frames of all designs were planned; compiling pays from about {many:,} on"
    if auto and frames < some:
        return few
    known = compiled.cached(_known)
    key = collect, *(tuple(k) if isinstance(k, Sequence) else k for k in keys)
    if key not in known:
        try:
            program = DesignProgram(compiled, varied, *keys, time, collect)
            if auto and frames < many and not cached(program.source):
                return few
            known[key] = program.load()
        except Untraceable as reason:
            known[key] = str(reason)
        except MechanismError as error:
            if compiled.executor == "c":
                raise
            known[key] = error.faults[0].message
    return known[key]


def _larger(x: Symbol, before: Symbol) -> Any:
    """The larger of a number's absolute value, if finite, and the largest one before."""
    return np.where(np.isfinite(x), np.maximum(before, abs(x)), before)


def _known(_: Compiled) -> dict[Any, DesignProgram | str]:
    return {}


def _operands(value: object) -> tuple[list[Any], int | None]:
    """The numbers of a result, and its width; None for a single number."""
    if isinstance(value, SymbolRows):
        return list(value.columns), len(value.columns)
    if isinstance(value, Symbol):
        return [value], None
    plain = np.asarray(value, float)
    return list(plain.reshape(-1)), None if plain.ndim == 0 else plain.shape[-1]


class _Followed(GivenLinkAngles):
    """Unwrapped angles of links as symbols: each design carries them from one time to the next."""

    def __init__(self, compiled: Compiled, model: Model, kernel: Kernel, state: State, constant_speeds: Collection[int]):
        self._kernel, self._state, self._constant_speeds = kernel, state, constant_speeds
        self.steps: list[Any] = []  # by which angles changed from the time before
        self._groups: dict[int, tuple[Any, Any]] = {}
        start = replace(compiled.angles.start, angles=_Starts(self))
        super().__init__(model, start)

    def link(self, k: int) -> Any:
        return self.both(k)[0]

    def both(self, k: int) -> tuple[Any, Any]:
        """Angle of a link, and its angle at the start."""
        turning = self.model.angles
        rotation_class, offset = turning.rotation_class[k], turning.offset[k]
        now, start = self._of_group(turning.class_group[rotation_class])
        for d, sign in turning.class_drives[rotation_class]:
            now = now + sign * self._state.drives[d]
            of = self._kernel.real if d in self._constant_speeds else self._kernel.real_of_frame
            start = start + sign * of(f"start {d}")
        return now + offset, start + offset

    def _of_group(self, group: int) -> tuple[Any, Any]:
        if not group:
            return 0.0, 0.0
        if group not in self._groups:
            raw: Any = wrapped_angle(self.model, self._state, group)
            first = self._kernel.real_of_frame("first")
            start = self._kernel.carried(lambda before: np.where(first, raw, before))
            last: list[Any] = []

            def known(before: Symbol) -> Any:
                near: Any = np.where(first, raw, before)
                angle = raw + TURN * np.rint((near - raw) / TURN)
                last.append(angle)
                self.steps.append(abs(angle - near))
                return np.where(angle * angle >= 0.0, angle, near)  # ``angle`` is NaN where it cannot be assembled

            self._kernel.carried(known)
            self._groups[group] = last[0], start
        return self._groups[group]


class _Starts(dict[str, Any]):
    """Angles of links at the start of each design, by name."""

    def __init__(self, angles: _Followed):
        super().__init__()
        self._angles = angles

    def __missing__(self, link: str) -> Any:
        return self._angles.both(self._angles.model.index[link])[1]
