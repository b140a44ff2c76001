"""Programs that go over frames: rows of numbers in, rows of numbers out."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.compiled.symbols import Code, Operand, Symbol

FUNCTION = """
{clones}
int {name}(long n, const double *p, const double *const *in, const long *step, double *out) {{
    double (*restrict x)[{block}] = calloc({given} + 1, sizeof *x), (*restrict y)[{block}] = calloc({rows} + 1, sizeof *y);
    for (long first = 0; x && y && first < n; first += {block}) {{
        const long count = n - first < {block} ? n - first : {block};
        {fetched}
        for (long k = 0; k < {block}; k++) {{
            {lines}
        }}
        {stored}
    }}
    free(x), free(y);
    return x && y;
}}
"""
"""Blocks of frames, each computed whole, number by number in rows of its own: so the compiler makes vectors of them."""
CLONES = """\
#include <stdlib.h>
#if defined(__x86_64__) && defined(__gnu_linux__) && defined(__GNUC__) && !defined(__clang__)
__attribute__((target_clones("avx512f", "avx2", "default")))
#endif"""
"""The same operations on as many frames at once as the processor can; without contraction their results are the same."""
BLOCK = 64  # frames


class Kernel:
    """A program that goes over frames: rows of numbers in, rows of numbers out. It is written line by line, then compiled."""

    def __init__(self, name: str):
        self.name, self.code = name, Code()
        self._given: list[str] = []
        self._fetched: dict[tuple[int, int], int] = {}  # (input, part of a plane vector): row of x
        self._outputs: list[tuple[str, Operand]] = []
        self._stored: list[str] = []
        self.parameters: list[float] = []
        self.rows = 0  # of real numbers

    @property
    def lines(self) -> int:
        """How many numbers it computes."""
        return len(self.code.written(self._outputs, []))

    def real(self, key: str) -> Symbol:
        """A number that is given, by a key."""
        return self.code.input(self._row(key, 0))

    def plane(self, key: str) -> Symbol:
        """A plane vector that is given."""
        return self.code.plane_input(self._row(key, 0), self._row(key, 1))

    def _row(self, key: str, part: int) -> str:
        if key not in self._given:
            self._given.append(key)
        row = self._fetched.setdefault((self._given.index(key), part), len(self._fetched))
        return f"x[{row}][k]"

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
        return FUNCTION.format(
            clones=CLONES,
            name=self.name,
            given=len(self._fetched),
            rows=self.rows,
            block=BLOCK,
            fetched="\n        ".join(fetched),
            lines="\n            ".join(self.code.written(self._outputs, self.parameters)),
            stored="\n        ".join(self._stored),
        )

    def load(self, loaded: ctypes.CDLL) -> None:
        """Take the compiled program."""
        self._function = getattr(loaded, self.name)
        self._function.restype = ctypes.c_int
        self._own = np.array(self.parameters or [0.0])

    def __call__(self, n: int, given: Mapping[str, Any]) -> Rows:
        """Rows of n numbers for given ones, (n,) or one for all."""
        kept, pointers, steps = [], [], []
        for key in self._given:
            x = given[key]
            if not (isinstance(x, np.ndarray) and x.ndim == 1 and x.dtype in (float, complex)):
                x = np.atleast_1d(np.asarray(x, complex if np.iscomplexobj(x) else float))
            kept.append(x)
            pointers.append(x.__array_interface__["data"][0])
            steps.append(x.strides[0] // 8 if len(x) > 1 else 0)
        out = np.empty((self.rows, n))
        count = len(kept)
        done = self._function(
            ctypes.c_long(n),
            ctypes.c_void_p(self._own.__array_interface__["data"][0]),
            (ctypes.c_void_p * count)(*pointers),
            (ctypes.c_long * count)(*steps),
            ctypes.c_void_p(out.__array_interface__["data"][0]),
        )
        if not done:
            raise MemoryError
        return Rows(out)


class Rows:
    """Rows of numbers (rows, n), taken one after the other in the order in which they were put."""

    def __init__(self, rows: Real):
        self._rows, self._next = rows, 0

    def real(self) -> Real:
        """The next row of real numbers (n,)."""
        self._next += 1
        row: Real = self._rows[self._next - 1]
        return row

    def plane(self) -> Complex:
        """The next row of plane vectors (n,)."""
        self._next += 2
        return self._rows[self._next - 2 : self._next].reshape(-1).view(complex)
