"""Functions of numpy on traced arrays: their values, and their derivatives as steps of the tape."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mechcore.arrays import Real
from mechcore.numerics.interpolation import integral_so_far
from mechcore.numerics.tape import Functions, NumberArray, Tape, Traced, Untraced, gathered, spread, value_of


def new_tape() -> Tape:
    """An empty tape whose arrays are operands of all functions here."""
    return Tape(UFUNCS, FUNCTIONS)


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
    """A length with one-sided derivatives where it is zero: its growth with each parameter, from the derivatives of its ``parts``.

    In reverse mode, where one weight serves all parameters, there is no such derivative (NaN).
    """
    tip = size.value == 0.0
    traced = [x for x in parts if isinstance(x, Traced)]
    if not tip.any():
        return size

    def forward(given: list[Any]) -> Any:
        slope, *moved = given
        known = [np.abs(spread(d, np.ndim(x.value), size.value.ndim)) for d, x in zip(moved, traced, strict=True) if d is not None]
        grown = np.sqrt(sum(d * d for d in known))
        return np.where(tip, grown, 0.0 if slope is None else slope)

    def back(w: NumberArray) -> list[NumberArray]:
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
    """A function of one number on traced arrays; ``slope``: its derivative as a function of the number and of its value."""

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
        stacked, [x for _, x in traced], forward, lambda w: [gathered(np.take(w, k, place), x.value) for k, x in traced]
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
    """`np.swapaxes` with both axes counted from the last one (negative)."""
    return x.tape.step(
        np.swapaxes(x.value, first, second),
        [x],
        lambda given: np.swapaxes(given[0], first, second),
        lambda w: [np.swapaxes(w, first, second)],
    )


def _solve(a: Any, b: Any) -> Any:
    """The solution (..., n, k) of linear equations (..., n, n) with right-hand sides (..., n, k), all real."""
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

    def back(w: NumberArray) -> list[NumberArray]:
        rhs = np.swapaxes(inverse, -1, -2) @ w
        return [gathered(rhs if x is b else -(rhs @ np.swapaxes(solution, -1, -2)), x.value) for x in traced]

    return _tape(a, b).step(solution, traced, forward, back)


def piecewise(x: Traced, borders: Real, coefficients: Real) -> Any:
    """Piecewise cubics between borders (n + 1,), in powers of x minus the lower border; coefficients (n, 4), highest first."""
    k = np.clip(np.searchsorted(borders, x.value, side="right") - 1, 0, len(coefficients) - 1)
    z = x.value - borders[k]
    a, b, c, d = np.moveaxis(coefficients[k], -1, 0)
    return x.tape.elementwise(((a * z + b) * z + c) * z + d, [(x, (3.0 * a * z + 2.0 * b) * z + c, None)])


def integral(values: Any, time: Any) -> Any:
    """The cumulative integral (F,) of values over times (F,), see `integral_so_far`. Times may change only by a common factor from
    the first one on; otherwise the derivative is NaN. There is no reverse mode (`Untraced`)."""
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

    def back(_: NumberArray) -> list[NumberArray]:
        raise Untraced("a work over the run goes back to all values before it")

    return _tape(values, time).step(total, traced, forward, back)


def without_slope(x: Traced) -> Traced:
    """The same value with unknown derivatives (NaN)."""
    return x.tape.step(x.value, [x], lambda given: np.full_like(given[0], np.nan), lambda w: [np.where(w != 0.0, np.nan, 0.0)])


def _no_slope(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda x: function(value_of(x))


UFUNCS: Functions = {
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

FUNCTIONS: Functions = {
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
