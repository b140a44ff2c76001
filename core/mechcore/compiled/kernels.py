"""Programs over frames, or over designs and frames: rows of numbers in, rows of numbers out, in one call of C."""

from __future__ import annotations

import ctypes
import os
from array import array
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import cache, reduce
from itertools import pairwise
from operator import or_
from pathlib import Path
from struct import Struct
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy import ndarray

from mechcore.arrays import Complex, Real
from mechcore.compiled.operands import ExpressionNode, Operand, OperandNames
from mechcore.compiled.symbols import HELPERS, Code, Symbol

if TYPE_CHECKING:
    from concurrent.futures import ThreadPoolExecutor

LANE, FRAME = 1, 2  # what a number of a program depends on
BOTH = LANE | FRAME
CARRIED_NAME = "c["  # prefix of names of numbers that are carried from frame to frame
SLOW_FUNCTIONS = ("atan2", "atan", "cos", "sin", "tan", "tanh", "exp", "expm1", "log", "log1p", "pow", "modulo")
TABLE_FUNCTIONS = ("piecewise", "searched", "curve")
"""Functions that compilers do not vectorise over lanes, and functions that look values up in tables."""


class Stages(NamedTuple):
    """Lines of C by stages: constant, dependent on the frames, on the lanes, on both (in consecutive loops). ``kept``: count of the
    numbers that are kept from loop to loop, in rows ``z``."""

    of_none: list[str]
    of_frames: list[str]
    of_lanes: list[str]
    of_both: list[list[str]]
    kept: int


def staged(code: Code, outputs: Sequence[tuple[str, Operand]], parameters: list[float], depends: Mapping[int, int]) -> Stages:
    """The program of some outputs: ``depends`` gives for inputs, by their numbers, whether they depend on the lanes or the frames;
    where none depends on the frames, there is a single stage.

    Functions that a compiler cannot vectorise get loops of their own, so that it vectorises the others.
    """
    names, order = OperandNames(parameters), code.needed(outputs)
    stage = dict.fromkeys(order, BOTH)
    if any(depends.get(number, LANE) & FRAME for number in order):
        for number in order:
            stage[number] = reduce(or_, map(stage.__getitem__, code.operands(number)), depends.get(number, 0))
    loop = dict.fromkeys(order, 0)  # of numbers that depend on both: odd for slow functions
    for number in order:
        if stage[number] == BOTH:
            slow = number in code.arrays or code.form(number).startswith(
                tuple(f"{name}(" for name in (*SLOW_FUNCTIONS, *TABLE_FUNCTIONS))
            )
            loop[number] = int(slow)
            for x in code.operands(number):
                loop[number] = max(loop[number], loop[x] + (loop[x] % 2 != slow) if stage[x] == BOTH else 0)
    last = max(loop.values(), default=0)
    given = {number for number in order if not code.operands(number) and not code.form(number).startswith(CARRIED_NAME)}
    assigned: list[list[str]] = [[] for _ in range(last + 1)]
    wanted: list[set[int]] = [set() for _ in assigned]
    for target, value in outputs:
        own = last if target.startswith(CARRIED_NAME) else loop[value.number] if isinstance(value, ExpressionNode) else 0
        assigned[own].append(f"{target} = {names(value)};")
        wanted[own] |= {value.number} if isinstance(value, ExpressionNode) else set()
    for number in order:
        if stage[number] == BOTH:
            wanted[loop[number]].update(code.operands(number))
    handed = [[x for x in sorted(w) if stage[x] == LANE or (stage[x] == BOTH and loop[x] != k)] for k, w in enumerate(wanted)]
    rows = {x: k for k, x in enumerate(sorted({x for taken in handed for x in taken if x not in given}))}

    def stored(number: int) -> list[str]:
        return [f"z[{rows[number]}][k] = t{number};"] if number in rows else []

    loops = []
    for k, taken in enumerate(handed):
        lines = [code.line(x, names) if x in given else f"const double t{x} = z[{rows[x]}][k];" for x in taken]
        for number in order:
            if stage[number] == BOTH and loop[number] == k and not (number in given and number in taken):
                lines += [code.line(number, names), *stored(number)]
        loops.append(lines + assigned[k])
    return Stages(
        of_none=[code.line(number, names) for number in order if stage[number] == 0],
        of_frames=[code.line(number, names) for number in order if stage[number] == FRAME],
        of_lanes=[line for number in order if stage[number] == LANE for line in (code.line(number, names), *stored(number))],
        of_both=[lines for lines in loops if lines],
        kept=len(rows),
    )


BLOCK_LANES = 64  # LANES of lanes.c
LEAST_A_THREAD = 256 * BLOCK_LANES  # numbers of a row for which a thread pays
KERNEL_HELPERS = HELPERS + Path(__file__).with_name("lanes.c").read_text(encoding="utf-8")
"""C functions that these programs call."""
FUNCTION_TEMPLATE = """
CLONES int {name}(
    long from, long to, long n, long frames, const double *p, const double *const *in, const long *step, double *result
) {{
    double (*restrict x)[LANES] = calloc({given} + 1, sizeof *x), (*restrict y)[LANES] = calloc({rows} + 1, sizeof *y);
    double (*restrict z)[LANES] = calloc({kept} + 1, sizeof *z), (*restrict c)[LANES] = calloc({carries} + 1, sizeof *c);
    for (long first = from; x && y && z && c && first < to; first += LANES) {{
        const long count = to - first < LANES ? to - first : LANES;
        memset(c, 0, ({carries} + 1) * sizeof *c);
        {fetched}
        {plain}
        {once}
        for (long frame = 0; frame < frames; frame++) {{
            double *restrict out = result + frame * {rows} * n;
            {each}
            {loops}
            {stored}
        }}
    }}
    free(x), free(y), free(z), free(c);
    return x && y && z && c;
}}
"""
"""Blocks of lanes, each computed as a whole, number by number in rows of its own, so that the compiler vectorises them."""


class _KernelCode(Code):
    """The code of a kernel, whose values of functions of time are inputs."""

    def __init__(self, kernel: Kernel):
        super().__init__()
        self._kernel = kernel

    def value_of(self, function: Callable[[Any], Any]) -> Symbol:
        if function not in self.of_time:
            self.of_time.append(function)
        return self._kernel.of_time(self._kernel, f"function {self.of_time.index(function)}")


class Kernel:
    """A program that is written line by line, then compiled, and runs over *lanes* in parallel: the frames of a motion; or the
    designs of a sweep, for each of which it runs over the frames. Terms that depend on the lanes only, or the frames only, are
    computed once for these."""

    def __init__(self, name: str, of_time: Callable[[Kernel, str], Symbol] | None = None):
        self.of_time = of_time or Kernel.real_of_frame  # makes the input for the values of a function of time
        self.code = _KernelCode(self)
        self.keys: list[str] = []  # of the inputs
        self.inputs: dict[tuple[Operand, Operand], str] = {}  # keys of the inputs for each lane
        self._fetched: dict[int, list[str]] = {}  # of inputs that depend on the lanes: rows of x
        self._depends: dict[int, int] = {}  # inputs: LANE or FRAME
        self.carries = 0  # of real numbers
        self._begin(name)

    def _begin(self, name: str) -> None:
        self.name = name
        self._next: list[tuple[str, Operand]] = []  # numbers that are carried to the next frame
        self._planes: list[tuple[Operand, Operand]] = []
        self._reals: list[Operand] = []
        self.parameters: list[float] = []

    def beside(self, name: str) -> Kernel:
        """Another program of the same code and inputs, with rows of its own."""
        other = copy(self)
        other._begin(name)
        return other

    @property
    def rows(self) -> int:
        """Number of rows of real numbers."""
        return len(self._reals)

    @property
    def planes(self) -> int:
        """Number of rows of plane vectors."""
        return len(self._planes)

    @property
    def lines(self) -> int:
        """Number of lines of the program."""
        return len(self.code.written(self._outputs, []))

    @property
    def _outputs(self) -> list[tuple[str, Operand]]:
        rows = [part for parts in self._planes for part in parts] + self._reals
        return [*self._next, *((f"y[{row}][k]", x) for row, x in enumerate(rows))]

    def real(self, key: str) -> Symbol:
        """An input for each lane, a real number, by a key."""
        return self._given_by(key, self.code.input(*self._rows(key, 1)))

    def plane(self, key: str) -> Symbol:
        """An input for each lane, a plane vector, by a key."""
        return self._given_by(key, self.code.plane_input(*self._rows(key, 2)))

    def _given_by(self, key: str, symbol: Symbol) -> Symbol:
        self.inputs[symbol.re, symbol.im] = key
        return self._input(symbol, LANE)

    def real_of_frame(self, key: str) -> Symbol:
        """An input for each frame, a real number, the same for all designs."""
        return self._input(self.code.input(self._at_frame(key, 0)), FRAME)

    def plane_of_frame(self, key: str) -> Symbol:
        """An input for each frame, a plane vector, the same for all designs."""
        return self._input(self.code.plane_input(self._at_frame(key, 0), self._at_frame(key, 1)), FRAME)

    def carried(self, of: Callable[[Symbol], Any]) -> Any:
        """A number that each design carries from frame to frame, zero before the first one: ``of`` computes it from its previous
        value."""
        row, self.carries = self.carries, self.carries + 1
        value = of(self._input(self.code.input(f"{CARRIED_NAME}{row}][k]"), BOTH))
        self._next.append((f"{CARRIED_NAME}{row}][k]", value.re if isinstance(value, Symbol) else float(value)))
        return value

    def _input(self, symbol: Symbol, depends: int) -> Symbol:
        self._depends |= {x.number: depends for x in (symbol.re, symbol.im) if not isinstance(x, float)}
        return symbol

    def _number(self, key: str) -> int:
        if key not in self.keys:
            self.keys.append(key)
        return self.keys.index(key)

    def _rows(self, key: str, width: int) -> list[str]:
        count = self._fetched_rows
        rows = self._fetched.setdefault(self._number(key), [f"x[{count + k}]" for k in range(width)])
        return [f"{row}[k]" for row in rows]

    @property
    def _fetched_rows(self) -> int:
        return sum(map(len, self._fetched.values()))

    def _at_frame(self, key: str, part: int) -> str:
        place = self._number(key)
        return f"in[{place}][frame * step[{place}] + {part}]"

    def put(self, value: Any) -> int:
        """Add a row of real numbers; returns its number."""
        self._reals.append(value.re if isinstance(value, Symbol) else float(value))
        return len(self._reals) - 1

    def put_plane(self, value: Any) -> int:
        """Add a row of plane vectors, which come before the real numbers; returns its number."""
        self._planes.append((value.re, value.im) if isinstance(value, Symbol) else (value.real, value.imag))
        return len(self._planes) - 1

    def source(self) -> str:
        """The program in C."""
        fetched = [
            f"fetch{'_plane' * (len(rows) > 1)}({', '.join(rows)}, in[{place}] + first * step[{place}], step[{place}], count);"
            for place, rows in self._fetched.items()
        ]
        planes, reals = len(self._planes), len(self._reals)
        stored = [f"store_plane(out + 2 * ({k} * n + first), y[{2 * k}], y[{2 * k + 1}], count);" for k in range(planes)]
        stored += [f"memcpy(out + {k} * n + first, y[{k}], count * sizeof *out);" for k in range(2 * planes, 2 * planes + reals)]
        stages = staged(self.code, self._outputs, self.parameters, self._depends)

        def loop(lines: list[str]) -> str:
            return "\n                ".join(["for (long k = 0; k < LANES; k++) {", *lines]) + "\n            }"

        return FUNCTION_TEMPLATE.format(
            name=self.name,
            given=self._fetched_rows,
            rows=2 * planes + reals,
            kept=stages.kept,
            carries=self.carries,
            fetched="\n        ".join(fetched),
            once=loop(stages.of_lanes) if stages.of_lanes else "",
            plain="\n        ".join(stages.of_none),
            each="\n            ".join(stages.of_frames),
            loops="\n            ".join(map(loop, stages.of_both)),
            stored="\n            ".join(stored),
        )

    def load(self, loaded: ctypes.CDLL) -> None:
        """Bind the compiled program from a library."""
        self._function = getattr(loaded, self.name)
        self._function.restype = ctypes.c_int
        self._function.argtypes = [*[ctypes.c_long] * 4, *[ctypes.c_void_p] * 4]
        self._own = np.array(self.parameters or [0.0])
        self._at_own = address(self._own)
        self._layout = Struct(f"{len(self.keys)}P").pack, Struct(f"{len(self.keys)}l").pack
        self._zeros = bytes(16 * len(self.keys))

    def __call__(self, n: int, given: Mapping[str, Any], frames: int = 1) -> tuple[Complex, Real]:
        """Rows of plane vectors (frames, rows, n) and of real numbers (frames, rows, n) at n lanes, for the inputs ``given`` by
        key: (n,) or (frames,) as they were declared, or one number for all. Raises `MemoryError`."""
        out = self.rows_at(n, [given[key] for key in self.keys], frames)
        planes, reals, step = len(self._planes), len(self._reals), out.strides[0]
        return (
            np.ndarray((frames, planes, n), complex, out, 0, (step, 16 * n, 16)),
            np.ndarray((frames, reals, n), float, out, 16 * planes * n, (step, 8 * n, 8)),
        )

    def rows_at(self, n: int, given: Sequence[Any], frames: int = 1) -> Real:
        """All rows (frames, rows, n), those of plane vectors first, two numbers each lane; ``given``: in the order of the keys.

        Many lanes are distributed over the processor's cores. Raises `MemoryError`.
        """
        kept, pointers, steps = [], [], []
        plain = array("d", self._zeros)  # inputs that are one number for all, two places for each key
        place, _ = plain.buffer_info()
        for k, x in enumerate(given):
            if type(x) is ndarray:
                row = x if x.ndim == 1 and x.dtype in PLAIN_TYPES else _plain_row(x)
                kept.append(row)
                pointers.append(address(row))
                steps.append(row.strides[0] // 8 if len(row) > 1 else 0)
            else:
                plain[2 * k], plain[2 * k + 1] = x.real, x.imag
                pointers.append(place + 16 * k)
                steps.append(0)
        out = np.empty((frames, 2 * len(self._planes) + len(self._reals), n))
        pack_pointers, pack_steps = self._layout
        arguments = n, frames, self._at_own, pack_pointers(*pointers), pack_steps(*steps), address(out)
        done: bool
        if n * frames < 2 * LEAST_A_THREAD or (shares := min(cores(), n * frames // LEAST_A_THREAD, n // BLOCK_LANES)) < 2:
            done = self._function(0, n, *arguments)
        else:
            bounds = [BLOCK_LANES * (n * k // (shares * BLOCK_LANES)) for k in range(shares)] + [n]
            done = all(_threads().map(lambda ends: self._function(*ends, *arguments), pairwise(bounds)))
        if not done:
            raise MemoryError
        return out


PLAIN_TYPES = (np.dtype(float), np.dtype(complex))
_from_buffer = ctypes.c_char.from_buffer


def _plain_row(values: Any) -> Any:
    """Real or complex numbers (n,) from an array of another shape or type."""
    row = np.array(values, ndmin=1)
    return row if row.dtype in PLAIN_TYPES else row.astype(float)


def address(array: Any) -> int:
    """Address of an array's data in memory; numpy's own interface, which works for every array, takes four times as long."""
    try:
        return ctypes.addressof(_from_buffer(array))
    except (TypeError, ValueError, BufferError):  # read only, not contiguous, or empty
        place: int = array.__array_interface__["data"][0]
        return place


@cache
def cores() -> int:
    """Number of threads: the cores that the process may use, or fewer if ``OMP_NUM_THREADS`` states so."""
    stated = os.environ.get("OMP_NUM_THREADS", "")
    own = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(own, int(stated))) if stated.isdecimal() else own


@cache
def _threads() -> ThreadPoolExecutor:
    from concurrent.futures import ThreadPoolExecutor  # loads logging

    return ThreadPoolExecutor(cores(), "mechviz")


class Results:
    """Results of a program over frames, value by value. Only computed values have rows, each value one row; others are constants or
    inputs."""

    def __init__(self, kernel: Kernel):
        self._kernel = kernel
        self._plain: list[Any] = []
        self._sources: dict[tuple[bool, Operand, Operand], tuple[int, int]] = {}
        self._values: list[tuple[int, int]] = []  # of each: number of its table (see `__call__`), and its number there

    def put(self, value: Any, plane: bool = False) -> None:
        """Add a result: a real number, or a plane vector."""
        re, im = (value.re, value.im) if isinstance(value, Symbol) else (value.real, value.imag)
        place = plane, re, im
        if place not in self._sources:
            self._sources[place] = self._source(value, plane, re, im)
        self._values.append(self._sources[place])

    def _source(self, value: Any, plane: bool, re: Operand, im: Operand) -> tuple[int, int]:
        if not isinstance(re, ExpressionNode) and not isinstance(im, ExpressionNode):
            self._plain.append(complex(re, im) if plane else float(re))
            return 0, len(self._plain) - 1
        if plane is isinstance(im, ExpressionNode) and (re, im) in self._kernel.inputs:
            return 1, self._kernel.keys.index(self._kernel.inputs[re, im])
        return (2, self._kernel.put_plane(value)) if plane else (3, self._kernel.put(value))

    def __len__(self) -> int:
        return len(self._values)

    def __call__(self, n: int, known: Mapping[str, Any] | tuple[Any, ...]) -> Callable[[int, int], list[Any]]:
        """A function that gives the values at n frames, (n,) or one for all, for any range of the order in which they were put.
        ``known``: the inputs, by their keys or in the order of declaration."""
        kernel = self._kernel
        given = known if isinstance(known, tuple) else [known[key] for key in kernel.keys]
        rows, planes = kernel.rows_at(n, given), kernel.planes
        tables = self._plain, given, list(ndarray((planes, n), complex, rows)), list(rows[0, 2 * planes :])
        return lambda first, last: [tables[k][place] for k, place in self._values[first:last]]
