"""Equations of motion as straight-line numpy code: even without a compiler, the general code is traced once and not run again.

With several freedoms the windows of an integration are short, and each of numpy's calls on their few nodes costs more than its
arithmetic. The code of positions, rates, effects and reduction makes some 300 of them for a double pendulum; traced on symbols it
gives 90 lines, as equal terms and plain zeros and ones are left out. Lines of C and of Python differ in a few words only.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mechcore.arrays import Real, Values
from mechcore.compiled.symbols import Untraceable
from mechcore.dynamics.equations.program import TracedEquations, traced_equations
from mechcore.kinematics.dyads import four_areas, leg
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled
from mechcore.numerics.frames import QUIET

MOST_LINES = 4000  # beyond them the general code, which works on whole lists of links, makes no more numpy calls
CHOICE = re.compile(r"= (\S+) != 0\.0 \? (\S+) : (\S+);")
NUMPY_FUNCTIONS = (
    "cos",
    "sin",
    "tan",
    "tanh",
    "sqrt",
    "exp",
    "log",
    "log1p",
    "expm1",
    "floor",
    "rint",
    "sign",
)  # names in C and numpy
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "fabs": np.abs,
    "pow": np.power,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "modulo": np.remainder,
    "larger": np.maximum,
    "smaller": np.minimum,
    "length": np.hypot,
    "known": lambda x: np.isfinite(x) * 1.0,
    "chosen": np.where,
    "four_areas": lambda a, b, d, _: four_areas(a, b, d),
    "leg": lambda r, y, _: leg(r, y),
    **{name: getattr(np, name) for name in NUMPY_FUNCTIONS},
}
"""Functions that lines of C may call, by their names there; the others read tables in C only."""


class StraightLines:
    """The equations of motion of a mechanism as a function of arrays: ``self(q, v, t)`` gives accelerations as `Chart` does."""

    def __init__(self, compiled: Compiled, traced: TracedEquations):
        code, (outputs, *_), (self.freedoms, self.states), *_ = traced
        numbers: list[float] = []
        lines = code.written([(f"o[{k}]", x) for k, x in enumerate(outputs)], numbers)
        if len(lines) > MOST_LINES:
            raise Untraceable(f"the program would have {len(lines):,} lines")
        body = "\n    ".join(python_of(line) for line in lines)
        space: dict[str, Any] = dict(FUNCTIONS)
        exec(f"def computed(p, m, q, v, t, d, w, o):\n    pass\n    {body}", space)
        self._computed = space["computed"]
        self._numbers = [np.array(x) for x in numbers]  # numpy takes arrays faster than plain numbers
        self._modes = [np.array(float(x)) for x in compiled.assembly.modes]
        self._laws = [d.law for d in compiled.mechanism.drives if not isinstance(d.law, Free)]
        self._of_time, self._count = tuple(code.of_time), len(outputs)

    def __call__(self, q: Real, v: Real, t: Real) -> Real:
        given = [x for law in self._laws for x in law(t)]
        of_time = [function(t) for function in self._of_time]
        outputs: list[Any] = [0.0] * self._count
        f, low = self.freedoms, self.freedoms * (self.freedoms + 1) // 2
        accelerations = np.empty((len(t), f + self.states))
        with np.errstate(**QUIET):
            columns = q.T.copy(), v.T.copy()  # each coordinate in one piece
            self._computed(self._numbers, self._modes, *columns, t, given, of_time, outputs)
            for k, x in enumerate(solved_by_lines(outputs[:low], outputs[low : low + f])):
                accelerations[:, k] = x
        for k, x in enumerate(outputs[low + f :], start=f):
            accelerations[:, k] = x
        return accelerations


def python_of(line: str) -> str:
    """A line of C in Python. Raises `Untraceable` where it calls a function that numpy does not have."""
    line = CHOICE.sub(r"= chosen(\1 != 0.0, \2, \3);", line).removeprefix("const double ").replace("(double)", "1.0 * ").rstrip(";")
    for name in re.findall(r"(\w+)\(", line):
        if name not in FUNCTIONS:
            raise Untraceable(f"numpy's lines do not have {name}")
    return line


def solved_by_lines(triangle: Sequence[Values], rhs: Sequence[Values]) -> list[Values]:
    """x (f,) of M x = rhs, by the lower triangle of a positive definite M, row by row, term by term over the frames: L D L'."""
    f = len(rhs)
    scaled = [list(triangle[i * (i + 1) // 2 :][: i + 1]) for i in range(f)]  # becomes L D, and D on the diagonal
    unit: list[list[Values]] = [[0.0] * i for i in range(f)]  # L below the diagonal
    x = list(rhs)
    for i in range(f):
        for j in range(i):
            for k in range(j):
                scaled[i][j] = scaled[i][j] - scaled[i][k] * unit[j][k]
            unit[i][j] = scaled[i][j] / scaled[j][j]
            scaled[i][i] = scaled[i][i] - scaled[i][j] * unit[i][j]
            x[i] = x[i] - unit[i][j] * x[j]
    for i in reversed(range(f)):
        x[i] = x[i] / scaled[i][i]
        for j in range(i + 1, f):
            x[i] = x[i] - unit[j][i] * x[j]
    return x


def straight_lines(compiled: Compiled) -> StraightLines | None:
    """The equations of a mechanism as lines of numpy; None where they cannot be written so. Call it through `Compiled.cached`."""
    points = compiled.singular_points
    if compiled.accuracy.differentiation != "exact" or (points is not None and points.points):
        return None
    try:
        traced = traced_equations(compiled)
        return None if traced.outputs[1] else StraightLines(compiled, traced)  # followed angles depend on the states before
    except Untraceable:
        return None
