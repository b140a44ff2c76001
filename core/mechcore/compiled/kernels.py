"""Programs that go over frames: rows of numbers in, rows of numbers out."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.compiled.symbols import Code, Operand, Symbol

FUNCTION = """
void {name}(long n, const double *p, const double *const *in, const long *step, double *out) {{
    for (long i = 0; i < n; i++) {{
        {lines}
    }}
}}
"""


class Kernel:
    """A program that goes over frames: rows of numbers in, rows of numbers out. It is written line by line, then compiled."""

    def __init__(self, name: str):
        self.name, self.code = name, Code()
        self._given: list[str] = []
        self._outputs: list[tuple[str, Operand]] = []
        self.parameters: list[float] = []
        self.rows = 0  # of real numbers

    @property
    def lines(self) -> int:
        """How many numbers it computes."""
        return len(self.code.written(self._outputs, []))

    def real(self, key: str) -> Symbol:
        """A number that is given, by a key."""
        return self.code.input(f"in[{self._place(key)}][i * step[{self._place(key)}]]")

    def plane(self, key: str) -> Symbol:
        """A plane vector that is given."""
        place = self._place(key)
        return self.code.plane_input(f"in[{place}][i * step[{place}]]", f"in[{place}][i * step[{place}] + 1]")

    def _place(self, key: str) -> int:
        if key not in self._given:
            self._given.append(key)
        return self._given.index(key)

    def put(self, value: Any) -> None:
        """A row of real numbers."""
        self._put(value.re if isinstance(value, Symbol) else float(value), f"out[{self.rows} * n + i]")
        self.rows += 1

    def put_plane(self, value: Any) -> None:
        """A row of plane vectors, as wide as two."""
        re, im = (value.re, value.im) if isinstance(value, Symbol) else (value.real, value.imag)
        self._put(re, f"out[{self.rows} * n + 2 * i]")
        self._put(im, f"out[{self.rows} * n + 2 * i + 1]")
        self.rows += 2

    def _put(self, value: Operand, target: str) -> None:
        self._outputs.append((target, value))

    def source(self) -> str:
        """The program in C."""
        return FUNCTION.format(name=self.name, lines="\n        ".join(self.code.written(self._outputs, self.parameters)))

    def load(self, loaded: ctypes.CDLL) -> None:
        """Take the compiled program."""
        self._function = getattr(loaded, self.name)
        self._function.restype = None
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
        self._function(
            ctypes.c_long(n),
            ctypes.c_void_p(self._own.__array_interface__["data"][0]),
            (ctypes.c_void_p * count)(*pointers),
            (ctypes.c_long * count)(*steps),
            ctypes.c_void_p(out.__array_interface__["data"][0]),
        )
        return Rows(out)


class Rows:
    """Rows of numbers (rows, n), taken one after the other in the order in which they were put."""

    def __init__(self, rows: Real):
        self._rows, self._next = rows, 0

    def real(self) -> Real:
        """The next row of real numbers (n,)."""
        self._next += 1
        return self._rows[self._next - 1]

    def plane(self) -> Complex:
        """The next row of plane vectors (n,)."""
        self._next += 2
        return self._rows[self._next - 2 : self._next].reshape(-1).view(complex)
