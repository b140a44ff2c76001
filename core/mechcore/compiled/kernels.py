"""Programs that go over frames, or over designs and frames: rows of numbers in, rows of numbers out, one call in C for all."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import cache, reduce
from itertools import pairwise
from operator import or_
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.compiled.operands import ExpressionNode, Operand, OperandNames
from mechcore.compiled.symbols import Code, Symbol

if TYPE_CHECKING:
    from concurrent.futures import ThreadPoolExecutor

LANE, FRAME = 1, 2  # what a number of a program differs with
BOTH = LANE | FRAME
CARRIED_NAME = "c["  # how names of numbers begin that go on from frame to frame
SLOW_FUNCTIONS = ("atan2", "atan", "cos", "sin", "tan", "tanh", "exp", "expm1", "log", "log1p", "pow", "modulo")
TABLE_FUNCTIONS = ("piecewise", "searched", "curve")
"""Functions that compilers do not compute for several lanes at once, and those that look something up."""


class Stages(NamedTuple):
    """Lines of C: what is the same for all, what differs with the frames, with the lanes, with both (in loops one after the
    other). So many numbers are ``kept`` from loop to loop, in rows ``z``."""

    of_none: list[str]
    of_frames: list[str]
    of_lanes: list[str]
    of_both: list[list[str]]
    kept: int


def staged(code: Code, outputs: Sequence[tuple[str, Operand]], parameters: list[float], depends: Mapping[int, int]) -> Stages:
    """The program of some outputs: ``depends`` says of inputs by their numbers whether they differ with the lanes or the frames;
    where none does with the frames all is of one stage.

    Functions for which a compiler has no vectors get loops of their own, so that it makes vectors of the others.
    """
    names, order = OperandNames(parameters), code.needed(outputs)
    stage = dict.fromkeys(order, BOTH)
    if any(depends.get(number, LANE) & FRAME for number in order):
        for number in order:
            stage[number] = reduce(or_, map(stage.__getitem__, code.operands(number)), depends.get(number, 0))
    loop = dict.fromkeys(order, 0)  # of those that differ with both: odd for slow functions
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


BLOCK_LANES = 64  # lanes
LEAST_A_THREAD = 256 * BLOCK_LANES  # numbers of a row that are worth a thread of their own
FUNCTION_TEMPLATE = """
{clones}
int {name}(long from, long to, long n, long frames, const double *p, const double *const *in, const long *step, double *result) {{
    double (*restrict x)[{block}] = calloc({given} + 1, sizeof *x), (*restrict y)[{block}] = calloc({rows} + 1, sizeof *y);
    double (*restrict z)[{block}] = calloc({kept} + 1, sizeof *z), (*restrict c)[{block}] = calloc({carries} + 1, sizeof *c);
    for (long first = from; x && y && z && c && first < to; first += {block}) {{
        const long count = to - first < {block} ? to - first : {block};
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
"""Blocks of lanes, each computed whole, number by number in rows of its own: so the compiler makes vectors of them."""
CLONES_ATTRIBUTE = """\
#include <stdlib.h>
#include <string.h>
#if defined(__x86_64__) && defined(__gnu_linux__) && defined(__GNUC__) && !defined(__clang__)
__attribute__((target_clones("avx512f", "avx2", "default")))
#endif"""
"""The same operations on as many lanes at once as the processor can; without contraction their results are the same."""


class _KernelCode(Code):
    """The code of a kernel, whose values of functions of the time are given for each frame."""

    def __init__(self, kernel: Kernel):
        super().__init__()
        self._kernel = kernel

    def value_of(self, function: Callable[[Any], Any]) -> Symbol:
        if function not in self.of_time:
            self.of_time.append(function)
        return self._kernel.of_time(self._kernel, f"function {self.of_time.index(function)}")


class Kernel:
    """A program that is written line by line, then compiled, and goes over *lanes* side by side: the frames of a motion; or the
    designs of a sweep, for each of which it goes over the frames. Terms that differ with the lanes only, or the frames only, are
    computed once for these."""

    def __init__(self, name: str, of_time: Callable[[Kernel, str], Symbol] | None = None):
        self.of_time = of_time or Kernel.real_of_frame  # what a function of the time is given for
        self.code = _KernelCode(self)
        self._given: list[str] = []
        self._fetched: dict[tuple[int, int], int] = {}  # (input, part of a plane vector): row of x
        self._depends: dict[int, int] = {}  # inputs: LANE or FRAME
        self.carries = 0  # of real numbers
        self._begin(name)

    def _begin(self, name: str) -> None:
        self.name = name
        self._outputs: list[tuple[str, Operand]] = []
        self._stored: list[str] = []
        self.parameters: list[float] = []
        self.rows = 0  # of real numbers

    def beside(self, name: str) -> Kernel:
        """Another program of the same code and inputs, with rows of its own."""
        other = copy(self)
        other._begin(name)
        return other

    @property
    def lines(self) -> int:
        """How many numbers it computes."""
        return len(self.code.written(self._outputs, []))

    def real(self, key: str) -> Symbol:
        """A number that is given for each lane, by a key."""
        return self._input(self.code.input(self._row(key, 0)), LANE)

    def plane(self, key: str) -> Symbol:
        """A plane vector that is given for each lane."""
        return self._input(self.code.plane_input(self._row(key, 0), self._row(key, 1)), LANE)

    def real_of_frame(self, key: str) -> Symbol:
        """A number that is given for each frame, the same for all designs."""
        return self._input(self.code.input(self._at_frame(key, 0)), FRAME)

    def plane_of_frame(self, key: str) -> Symbol:
        """A plane vector that is given for each frame, the same for all designs."""
        return self._input(self.code.plane_input(self._at_frame(key, 0), self._at_frame(key, 1)), FRAME)

    def carried(self, of: Callable[[Symbol], Any]) -> Any:
        """A number that each design carries from frame to frame, zero before the first one: ``of`` what it was before."""
        row, self.carries = self.carries, self.carries + 1
        value = of(self._input(self.code.input(f"{CARRIED_NAME}{row}][k]"), BOTH))
        self._outputs.append((f"{CARRIED_NAME}{row}][k]", value.re if isinstance(value, Symbol) else float(value)))
        return value

    def _input(self, symbol: Symbol, depends: int) -> Symbol:
        self._depends |= {x.number: depends for x in (symbol.re, symbol.im) if not isinstance(x, float)}
        return symbol

    def _number(self, key: str) -> int:
        if key not in self._given:
            self._given.append(key)
        return self._given.index(key)

    def _row(self, key: str, part: int) -> str:
        row = self._fetched.setdefault((self._number(key), part), len(self._fetched))
        return f"x[{row}][k]"

    def _at_frame(self, key: str, part: int) -> str:
        place = self._number(key)
        return f"in[{place}][frame * step[{place}] + {part}]"

    def put(self, value: Any) -> None:
        """A row of real numbers."""
        self._outputs.append((f"y[{self.rows}][k]", value.re if isinstance(value, Symbol) else float(value)))
        self._stored.append(f"for (long k = 0; k < count; k++) out[{self.rows} * n + first + k] = y[{self.rows}][k];")
        self.rows += 1

    def put_plane(self, value: Any) -> None:
        """A row of plane vectors, as wide as two."""
        row, places = self.rows, []
        for part, x in enumerate((value.re, value.im) if isinstance(value, Symbol) else (value.real, value.imag)):
            self._outputs.append((f"y[{row + part}][k]", x))
            places.append(f"out[{row} * n + 2 * (first + k) + {part}] = y[{row + part}][k];")
        self._stored.append(f"for (long k = 0; k < count; k++) {{ {' '.join(places)} }}")
        self.rows += 2

    def source(self) -> str:
        """The program in C."""
        fetched = [
            f"for (long k = 0; k < count; k++) x[{row}][k] = in[{place}][(first + k) * step[{place}] + {part}];"
            for (place, part), row in self._fetched.items()
        ]
        stages = staged(self.code, self._outputs, self.parameters, self._depends)

        def loop(lines: list[str]) -> str:
            return "\n                ".join([f"for (long k = 0; k < {BLOCK_LANES}; k++) {{", *lines]) + "\n            }"

        return FUNCTION_TEMPLATE.format(
            clones=CLONES_ATTRIBUTE,
            name=self.name,
            given=len(self._fetched),
            rows=self.rows,
            kept=stages.kept,
            carries=self.carries,
            block=BLOCK_LANES,
            fetched="\n        ".join(fetched),
            once=loop(stages.of_lanes) if stages.of_lanes else "",
            plain="\n        ".join(stages.of_none),
            each="\n            ".join(stages.of_frames),
            loops="\n            ".join(map(loop, stages.of_both)),
            stored="\n            ".join(self._stored),
        )

    def load(self, loaded: ctypes.CDLL) -> None:
        """Take the compiled program."""
        self._function = getattr(loaded, self.name)
        self._function.restype = ctypes.c_int
        self._own = np.array(self.parameters or [0.0])

    def __call__(self, n: int, given: Mapping[str, Any], frames: int = 1) -> Real:
        """Rows (frames, rows, n) at n lanes, for given numbers, (n,) or (frames,) as they were asked for, or one for all.

        Many lanes are shared out to the processor's cores. Raises `MemoryError`.
        """
        kept, pointers, steps = [], [], []
        for key in self._given:
            x = given[key]
            if not (isinstance(x, np.ndarray) and x.ndim == 1 and x.dtype in (float, complex)):
                x = np.atleast_1d(np.asarray(x, complex if np.iscomplexobj(x) else float))
            kept.append(x)
            pointers.append(x.__array_interface__["data"][0])
            steps.append(x.strides[0] // 8 if len(x) > 1 else 0)
        out = np.empty((frames, self.rows, n))
        count = len(kept)
        arguments = (
            ctypes.c_long(n),
            ctypes.c_long(frames),
            ctypes.c_void_p(self._own.__array_interface__["data"][0]),
            (ctypes.c_void_p * count)(*pointers),
            (ctypes.c_long * count)(*steps),
            ctypes.c_void_p(out.__array_interface__["data"][0]),
        )

        def part(ends: tuple[int, int]) -> bool:
            return bool(self._function(*map(ctypes.c_long, ends), *arguments))

        shares = max(1, min(cores(), n * frames // LEAST_A_THREAD, n // BLOCK_LANES))
        bounds = [BLOCK_LANES * (n * k // (shares * BLOCK_LANES)) for k in range(shares)] + [n]
        ends = list(pairwise(bounds))
        if not all(_threads().map(part, ends) if shares > 1 else map(part, ends)):
            raise MemoryError
        return out


@cache
def cores() -> int:
    """How many threads compute: the cores that the process may use, or fewer as ``OMP_NUM_THREADS`` says."""
    stated = os.environ.get("OMP_NUM_THREADS", "")
    own = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(own, int(stated))) if stated.isdecimal() else own


@cache
def _threads() -> ThreadPoolExecutor:
    from concurrent.futures import ThreadPoolExecutor  # loads logging

    return ThreadPoolExecutor(cores(), "mechviz")


class NumberRows:
    """Rows of numbers (rows, n), taken one after the other in the order in which they were put."""

    def __init__(self, rows: Real):
        self._rows, self._next = rows, 0

    def real(self) -> Real:
        """The next row of real numbers (n,)."""
        self._next += 1
        row: Real = self._rows[self._next - 1]
        return row

    def reals(self, count: int) -> Real:
        """The next rows of real numbers (count, n)."""
        self._next += count
        return self._rows[self._next - count : self._next]

    def plane(self) -> Complex:
        """The next row of plane vectors (n,)."""
        self._next += 2
        return self._rows[self._next - 2 : self._next].reshape(-1).view(complex)
