"""Derivatives of what is computed with arrays: every step is written down with its slopes, and gone through in either direction.

A `Traced` stands where an array stands otherwise, an operand of the same functions of numpy. Its `Tape` keeps, for each step, how
the result moves with its operands: real-linear maps, ``dz = h dx + g conj(dx)`` for each element of plane vectors and numbers, and
solutions of linear equations. `Tape.forward` carries derivatives by some variables to results, `Tape.adjoint` carries weights of
results back to all variables. Nothing is differenced; decisions by a value (`np.where`, comparisons) hold as they were taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

from mechcore.arrays import Real
from mechcore.numerics.interpolation import integral_so_far

Numbers: TypeAlias = NDArray[Any]  # real or complex


class Untraced(TypeError):
    """Raised where a computation has no slope here: a conversion to a plain number, or a function that is not known."""


class Step(NamedTuple):
    """How a result follows from its operands: ``forward`` gives its derivatives (P, ...) from theirs, None standing for zero;
    ``back`` the weights (M, ...) of the operands from its own."""

    result: int
    operands: tuple[int, ...]
    forward: Callable[[list[Any]], Numbers]
    back: Callable[[Numbers], list[Numbers]]


class Tape:
    """The steps of a computation in the order in which they were taken."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self.values: list[Numbers] = []  # of every traced result

    def variable(self, value: Any) -> Traced:
        """A traced array that follows from nothing before it: derivatives are taken by it, or stated."""
        return self.result(np.asarray(value))

    def result(self, value: Numbers) -> Traced:
        """A traced array without a step."""
        self.values.append(value)
        return Traced(self, len(self.values) - 1, value)

    def step(
        self, value: Any, operands: Sequence[Traced], forward: Callable[[list[Any]], Any], back: Callable[[Any], list[Any]]
    ) -> Traced:
        """The result of a step."""
        made = self.result(np.asarray(value))
        self.steps.append(Step(made.number, tuple(x.number for x in operands), forward, back))
        return made

    def elementwise(self, value: Any, slopes: Sequence[tuple[Any, Any, Any]]) -> Any:
        """The result of a step element by element: ``slopes`` has its operands, each with h and g of the derivative."""
        traced = [(x, h, g) for x, h, g in slopes if isinstance(x, Traced)]
        value = np.asarray(value)
        real = not np.iscomplexobj(value)

        def forward(given: list[Any]) -> Any:
            total: Any = None
            for d, (x, h, g) in zip(given, traced, strict=True):
                if d is None:
                    continue
                d = _spread(d, np.ndim(x.value), value.ndim)
                term = d * h if g is None else d * h + np.conj(d) * g
                total = term if total is None else total + term
            return total.real if real else total

        def back(w: Numbers) -> list[Numbers]:
            tangents = []
            for x, h, g in traced:
                own = np.conj(h) * w if g is None else np.conj(h) * w + g * np.conj(w)
                tangents.append(_gathered(own, x.value))
            return tangents

        return self.step(value, [x for x, _, _ in traced], forward, back)

    def implicit(self, residuals: Sequence[Any], matrix: Real, inverse: Real) -> list[Traced]:
        """Changes (n unknowns, zero as they stand) of unknowns that keep ``residuals`` (m, real) at zero: ``matrix`` (..., m, n)
        has their derivatives by the unknowns, ``inverse`` (..., n, m) its inverse, or what stands for it where m > n."""
        traced = [(i, r) for i, r in enumerate(residuals) if isinstance(r, Traced)]
        shape = np.broadcast_shapes(matrix.shape[:-2], *(np.shape(r.value) for _, r in traced))
        overdetermined = matrix.shape[-2] > matrix.shape[-1]

        def forward(given: list[Any]) -> Any:
            known = next(d for d in given if d is not None)
            moved = np.zeros((len(known), *shape, matrix.shape[-2]))
            for d, (i, r) in zip(given, traced, strict=True):
                if d is not None:
                    moved[..., i] = _spread(d, np.ndim(r.value), len(shape))
            solution = -(inverse @ moved[..., None])[..., 0]
            if overdetermined:  # equations that are left over have to move along
                left = np.abs(moved + (matrix @ solution[..., None])[..., 0]).max(axis=-1, keepdims=True)
                size = np.abs(moved).max(axis=-1, keepdims=True)
                solution = np.where(left <= 1e-9 * size, solution, np.nan)
            return solution

        def back(w: Numbers) -> list[Numbers]:
            rows = -(np.swapaxes(inverse, -1, -2) @ w[..., None])[..., 0]
            return [_gathered(rows[..., i], r.value) for i, r in traced]

        both = self.step(np.zeros((*shape, matrix.shape[-1])), [r for _, r in traced], forward, back)
        return [both[..., k] for k in range(matrix.shape[-1])]

    def forward(self, given: Mapping[int, Numbers], wanted: Sequence[Traced]) -> list[Numbers]:
        """Derivatives (P, ...) of results from those of variables (P, ...), by their numbers; zero of those that are not given."""
        count = len(next(iter(given.values())))
        known: list[Any] = [None] * len(self.values)
        for number, d in given.items():
            known[number] = d
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            for step in self.steps:
                operands = [known[k] for k in step.operands]
                if any(d is not None for d in operands):
                    d = np.asarray(step.forward(operands))
                    known[step.result] = np.broadcast_to(d, (count, *self.values[step.result].shape))
        tangents = []
        for x in wanted:
            d = known[x.number]
            tangents.append(
                np.zeros((count, *x.value.shape), x.value.dtype) if d is None else np.broadcast_to(d, (count, *x.value.shape))
            )
        return tangents

    def adjoint(self, wanted: Traced, weights: Numbers) -> dict[int, Numbers]:
        """Derivatives of sums of a real result, each with ``weights`` (M, ...), by everything on the tape, by number: (M, ...)."""
        known: dict[int, Numbers] = {wanted.number: weights}
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            for step in reversed(self.steps):
                w = known.get(step.result)
                if w is None:
                    continue
                for number, own in zip(step.operands, step.back(w), strict=True):
                    known[number] = known[number] + own if number in known else own
        return known


def _spread(d: Any, own: int, wanted: int) -> Any:
    """Derivatives (P, ...) of an array of ``own`` axes, with axes of length one before them as far as ``wanted``."""
    return d if own == wanted else d.reshape(d.shape[0], *(1,) * (wanted - own), *d.shape[1:])


def _gathered(w: Any, value: Numbers) -> Any:
    """Weights (M, ...) summed over the axes along which an operand was repeated, real where it is."""
    w = np.asarray(w)
    extra = w.ndim - 1 - value.ndim
    if extra:
        w = w.sum(axis=tuple(range(1, 1 + extra)))
    repeated = tuple(k + 1 for k, n in enumerate(value.shape) if n == 1 and w.shape[k + 1] != 1)
    if repeated:
        w = w.sum(axis=repeated, keepdims=True)
    return w if np.iscomplexobj(value) else w.real


class Traced(NDArrayOperatorsMixin):
    """An array whose slopes are on a tape; an operand of whatever numpy's arrays are, but never a plain zero."""

    __slots__ = ("number", "tape", "value")
    __hash__ = object.__hash__

    def __init__(self, tape: Tape, number: int, value: Numbers):
        self.tape, self.number, self.value = tape, number, value

    def __repr__(self) -> str:
        return f"Traced({self.value!r})"

    # -- what an array has --------------------------------------------------------------------------------------------
    @property
    def shape(self) -> tuple[int, ...]:
        return self.value.shape

    @property
    def ndim(self) -> int:
        return self.value.ndim

    @property
    def real(self) -> Any:
        return self.tape.elementwise(self.value.real, [(self, 0.5, 0.5)]) if np.iscomplexobj(self.value) else self

    @property
    def imag(self) -> Any:
        return self.tape.elementwise(self.value.imag, [(self, -0.5j, 0.5j)]) if np.iscomplexobj(self.value) else 0.0

    def conjugate(self) -> Any:
        return self.tape.elementwise(self.value.conj(), [(self, 0.0, 1.0)]) if np.iscomplexobj(self.value) else self

    def clip(self, low: Any = None, high: Any = None) -> Any:
        """Kept between two numbers, as numpy has it."""
        return _clip(self, low, high)

    def astype(self, _: Any) -> Traced:
        return self

    def __getitem__(self, key: Any) -> Any:
        keys = (slice(None), *(key if isinstance(key, tuple) else (key,)))

        def back(w: Numbers) -> list[Numbers]:
            whole = np.zeros((len(w), *self.value.shape), w.dtype)
            np.add.at(whole, keys, w)
            return [whole]

        return self.tape.step(self.value[key], [self], lambda given: given[0][keys], back)

    def reshape(self, *shape: int) -> Any:
        return self.tape.step(
            self.value.reshape(shape),
            [self],
            lambda given: given[0].reshape(len(given[0]), *shape),
            lambda w: [w.reshape(len(w), *self.value.shape)],
        )

    def __len__(self) -> int:
        return len(self.value)

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise Untraced("a part of this mechanism, such as a cam in space, is computed in a way whose derivatives are not known")

    __float__ = __complex__ = __int__ = __array__

    def __bool__(self) -> bool:
        if self.value.ndim:
            raise ValueError("the truth value of an array")
        return True  # a number that may vary is not a plain zero

    def __array_ufunc__(self, function: Any, method: str, *operands: Any, **options: Any) -> Any:
        own = UFUNCS.get(function.__name__)
        if method != "__call__" or options:
            raise Untraced(f"numpy.{function.__name__} has no derivative here")
        if own is not None:
            return own(*operands)
        if function.__name__ in BY_VALUE:
            return function(*map(value_of, operands))
        raise Untraced(f"numpy.{function.__name__} has no derivative here")

    def __array_function__(self, function: Any, types: Any, operands: Any, options: Any) -> Any:
        own = FUNCTIONS.get(function.__name__)
        if own is None:
            raise Untraced(f"numpy.{function.__name__} has no derivative here")
        return own(*operands, **options)

    def __eq__(self, other: object) -> bool:
        return self is other

    def __ne__(self, other: object) -> bool:
        return self is not other


def value_of(x: Any) -> Any:
    """The value of what may be traced."""
    return x.value if isinstance(x, Traced) else x


def _tape(*operands: Any) -> Tape:
    return next(x.tape for x in operands if isinstance(x, Traced))


def _add(a: Any, b: Any) -> Any:
    return _tape(a, b).elementwise(value_of(a) + value_of(b), [(a, 1.0, None), (b, 1.0, None)])


def _subtract(a: Any, b: Any) -> Any:
    return _tape(a, b).elementwise(value_of(a) - value_of(b), [(a, 1.0, None), (b, -1.0, None)])


def _multiply(a: Any, b: Any) -> Any:
    x, y = value_of(a), value_of(b)
    return _tape(a, b).elementwise(x * y, [(a, y, None), (b, x, None)])


def _divide(a: Any, b: Any) -> Any:
    x, y = value_of(a), value_of(b)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / np.asarray(y)
        quotient = x * inverse if np.iscomplexobj(y) else x / y
        return _tape(a, b).elementwise(quotient, [(a, inverse, None), (b, -quotient * inverse, None)])


def _power(a: Any, b: Any) -> Any:
    x, n = value_of(a), value_of(b)
    with np.errstate(divide="ignore", invalid="ignore"):
        power = np.asarray(x, float) ** n if not np.iscomplexobj(x) else x**n
        slope = n * np.asarray(x, power.dtype) ** (n - 1.0) if isinstance(a, Traced) else 0.0
        growth = power * np.log(x) if isinstance(b, Traced) else 0.0
    return _tape(a, b).elementwise(power, [(a, slope, None), (b, growth, None)])


def _absolute(z: Traced) -> Any:
    size = np.abs(z.value)
    if not np.iscomplexobj(z.value):
        return _with_tips(z.tape.elementwise(size, [(z, np.sign(z.value), None)]), [z])
    along = 0.5 * np.divide(z.value, size, out=np.zeros(z.value.shape, complex), where=size != 0.0)
    return _with_tips(z.tape.elementwise(size, [(z, np.conj(along), along)]), [z])


def _angle(z: Any) -> Any:
    return _arctan2(z.imag, z.real)


def _arctan2(y: Any, x: Any) -> Any:
    b, a = value_of(y), value_of(x)
    with np.errstate(divide="ignore", invalid="ignore"):
        squared = np.asarray(a * a + b * b)
        return _tape(y, x).elementwise(np.arctan2(b, a), [(y, a / squared, None), (x, -b / squared, None)])


def _hypot(x: Any, y: Any) -> Any:
    a, b = value_of(x), value_of(y)
    size = np.hypot(a, b)
    by_x, by_y = (np.divide(z, size, out=np.zeros(size.shape), where=size != 0.0) for z in (a, b))
    smooth = _tape(x, y).elementwise(size, [(x, by_x, None), (y, by_y, None)])
    return _with_tips(smooth, [x, y])


def _with_tips(size: Traced, parts: Sequence[Any]) -> Any:
    """A length with its one-sided slopes where it is zero: how fast it grows as a parameter does, from the slopes of its ``parts``.
    Backwards, where one number stands for all parameters, there are none (NaN)."""
    tip = size.value == 0.0
    traced = [x for x in parts if isinstance(x, Traced)]
    if not tip.any():
        return size

    def forward(given: list[Any]) -> Any:
        slope, *moved = given
        known = [np.abs(_spread(d, np.ndim(x.value), size.value.ndim)) for d, x in zip(moved, traced, strict=True) if d is not None]
        grown = np.sqrt(sum(d * d for d in known))
        return np.where(tip, grown, 0.0 if slope is None else slope)

    def back(w: Numbers) -> list[Numbers]:
        lost = np.where(tip & (w != 0.0), np.nan, w)
        return [lost, *(np.zeros((len(w), *x.value.shape), x.value.dtype) for x in traced)]

    return size.tape.step(size.value, [size, *traced], forward, back)


def _remainder(a: Any, b: Any) -> Any:
    x, y = value_of(a), value_of(b)
    return _tape(a, b).elementwise(np.mod(x, y), [(a, 1.0, None), (b, -np.floor(x / y), None)])


def _clip(x: Any, low: Any = None, high: Any = None) -> Any:
    above = x if low is None else np.maximum(x, low)
    return above if high is None else np.minimum(above, high)


def _where(condition: Any, a: Any, b: Any) -> Any:
    chosen = np.asarray(value_of(condition), bool)
    if not (isinstance(a, Traced) or isinstance(b, Traced)):
        return np.where(chosen, a, b)
    return _tape(a, b).elementwise(np.where(chosen, value_of(a), value_of(b)), [(a, 1.0 * chosen, None), (b, 1.0 * ~chosen, None)])


def _of_one(function: Callable[[Any], Any], slope: Callable[[Any, Any], Any]) -> Callable[[Traced], Any]:
    """A function of one number with its slope, made of the number and of the function's value there."""

    def traced(x: Traced) -> Any:
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            value = function(x.value)
            return x.tape.elementwise(value, [(x, slope(x.value, value), None)])

    return traced


def _stack(parts: Sequence[Any], axis: int = 0) -> Any:
    values = [np.asarray(value_of(x)) for x in parts]
    stacked = np.stack(values, axis)
    traced = [(k, x) for k, x in enumerate(parts) if isinstance(x, Traced)]
    place = axis if axis < 0 else axis + 1

    def forward(given: list[Any]) -> Any:
        count = len(next(d for d in given if d is not None))
        whole = [np.zeros((count, *values[0].shape), stacked.dtype) for _ in values]
        for d, (k, _) in zip(given, traced, strict=True):
            whole[k] = whole[k] if d is None else np.broadcast_to(d, whole[k].shape)
        return np.stack(whole, place)

    return _tape(*parts).step(
        stacked, [x for _, x in traced], forward, lambda w: [_gathered(np.take(w, k, place), x.value) for k, x in traced]
    )


def _column_stack(parts: Sequence[Any]) -> Any:
    return _stack([c for x in parts for c in ([x] if np.ndim(x) == 1 else [x[:, k] for k in range(x.shape[1])])], -1)


def _broadcast_to(x: Traced, shape: tuple[int, ...]) -> Any:
    return x if x.value.shape == tuple(shape) else x.tape.elementwise(np.broadcast_to(x.value, shape), [(x, 1.0, None)])


def _sum(x: Traced, axis: Any = None) -> Any:
    axes = tuple(range(x.value.ndim)) if axis is None else tuple(np.atleast_1d(axis) % x.value.ndim)
    inner = tuple(k + 1 for k in axes)
    return x.tape.step(
        x.value.sum(axis=axes),
        [x],
        lambda given: given[0].sum(axis=inner),
        lambda w: [np.broadcast_to(np.expand_dims(w, inner), (len(w), *x.value.shape))],
    )


def _mean(x: Traced, axis: Any = None) -> Any:
    total = _sum(x, axis)
    return total * (total.value.size / x.value.size)


def _swapaxes(x: Traced, first: int, second: int) -> Any:
    """Both counted from the last axis."""
    return x.tape.step(
        np.swapaxes(x.value, first, second),
        [x],
        lambda given: np.swapaxes(given[0], first, second),
        lambda w: [np.swapaxes(w, first, second)],
    )


def _solve(a: Any, b: Any) -> Any:
    """Linear equations (..., n, n) with right-hand sides (..., n, k), all real."""
    matrix = np.asarray(value_of(a))
    inverse = np.linalg.inv(matrix)
    solution = inverse @ value_of(b)
    traced = [x for x in (a, b) if isinstance(x, Traced)]

    def forward(given: list[Any]) -> Any:
        total: Any = 0.0
        for d, x in zip(given, traced, strict=True):
            if d is not None:
                total = total + (d if x is b else -(d @ solution))
        return inverse @ total

    def back(w: Numbers) -> list[Numbers]:
        rhs = np.swapaxes(inverse, -1, -2) @ w
        return [_gathered(rhs if x is b else -(rhs @ np.swapaxes(solution, -1, -2)), x.value) for x in traced]

    return _tape(a, b).step(solution, traced, forward, back)


def piecewise(x: Traced, borders: Real, coefficients: Real) -> Any:
    """Polynomials between borders (n + 1,), of x less the lower one, by coefficients (n, 4), highest power first."""
    k = np.clip(np.searchsorted(borders, x.value, side="right") - 1, 0, len(coefficients) - 1)
    z = x.value - borders[k]
    a, b, c, d = np.moveaxis(coefficients[k], -1, 0)
    return x.tape.elementwise(((a * z + b) * z + c) * z + d, [(x, (3.0 * a * z + 2.0 * b) * z + c, None)])


def integral(values: Any, time: Any) -> Any:
    """The integral so far (F,) of values over times (F,), see `integral_so_far`; times change by a factor about the first one, or
    there is no derivative (NaN)."""
    y, t = value_of(values), value_of(time)
    total = integral_so_far(y, t)
    traced = [x for x in (values, time) if isinstance(x, Traced)]

    def forward(given: list[Any]) -> Any:
        out = np.zeros((len(next(d for d in given if d is not None)), *total.shape))
        for d, x in zip(given, traced, strict=True):
            if d is None:
                continue
            if x is values:
                out += np.stack([integral_so_far(row, t) for row in np.broadcast_to(d, out.shape)])
                continue
            growth = (d - d[:, :1])[:, -1:] / (t[-1] - t[0])
            even = np.abs(d - d[:, :1] - growth * (t - t[0])).max(axis=1) <= 1e-12 * np.abs(d).max(axis=1)
            out += np.where(even[:, None], growth * total, np.nan)
        return out

    def back(_: Numbers) -> list[Numbers]:
        raise Untraced("a work over the run goes back to all values before it")

    return _tape(values, time).step(total, traced, forward, back)


def _no_slope(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda x: function(value_of(x))


UFUNCS: dict[str, Callable[..., Any]] = {
    "add": _add,
    "subtract": _subtract,
    "multiply": _multiply,
    "divide": _divide,
    "power": _power,
    "negative": lambda a: a.tape.elementwise(-a.value, [(a, -1.0, None)]),
    "positive": lambda a: a,
    "absolute": _absolute,
    "conjugate": lambda a: a.conjugate(),
    "arctan2": _arctan2,
    "hypot": _hypot,
    "remainder": _remainder,
    "maximum": lambda a, b: _where(np.greater_equal(value_of(a), value_of(b)), a, b),
    "minimum": lambda a, b: _where(np.less_equal(value_of(a), value_of(b)), a, b),
    "square": lambda a: a * a,
    "reciprocal": lambda a: 1.0 / a,
    "exp": _of_one(np.exp, lambda x, y: y),
    "sin": _of_one(np.sin, lambda x, y: np.cos(x)),
    "cos": _of_one(np.cos, lambda x, y: -np.sin(x)),
    "tan": _of_one(np.tan, lambda x, y: 1.0 + y * y),
    "arctan": _of_one(np.arctan, lambda x, y: 1.0 / (1.0 + x * x)),
    "arcsin": _of_one(np.arcsin, lambda x, y: 1.0 / np.sqrt(1.0 - x * x)),
    "arccos": _of_one(np.arccos, lambda x, y: -1.0 / np.sqrt(1.0 - x * x)),
    "tanh": _of_one(np.tanh, lambda x, y: 1.0 - y * y),
    "clip": _clip,
    "sqrt": _of_one(np.sqrt, lambda x, y: 0.5 / y),
    "log": _of_one(np.log, lambda x, y: 1.0 / x),
    "log1p": _of_one(np.log1p, lambda x, y: 1.0 / (1.0 + x)),
    "expm1": _of_one(np.expm1, lambda x, y: y + 1.0),
    "sign": _no_slope(np.sign),
    "floor": _no_slope(np.floor),
    "rint": _no_slope(np.rint),
}
"""Functions of traced arrays by numpy's names."""

BY_VALUE = ("less", "less_equal", "greater", "greater_equal", "isfinite", "isnan", "isinf")
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "real": lambda a: a.real,
    "imag": lambda a: a.imag,
    "angle": _angle,
    "where": _where,
    "stack": _stack,
    "column_stack": _column_stack,
    "broadcast_to": _broadcast_to,
    "sum": _sum,
    "mean": _mean,
    "solve": _solve,
    "swapaxes": _swapaxes,
    "shape": lambda a: a.value.shape,
    "ndim": lambda a: a.value.ndim,
    "clip": _clip,
    "round": _no_slope(np.round),
    "iscomplexobj": lambda a: np.iscomplexobj(a.value),
}
