"""Automatic differentiation of array computations: every step is recorded with its derivatives, for forward and reverse mode.

A `Traced` takes the place of an array as an operand of the same numpy functions. Its `Tape` records for each step the derivative of
the result by its operands: real-linear maps, ``dz = h dx + g conj(dx)`` for each element of plane vectors and numbers, and
solutions of linear equations. `Tape.forward` propagates derivatives by some variables to results; `Tape.adjoint` propagates weights
of results back to all variables. There are no finite differences. Decisions by a value (`np.where`, comparisons) are kept as taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

from mechcore.arrays import Real

NumberArray: TypeAlias = NDArray[Any]  # real or complex
Functions: TypeAlias = Mapping[str, Callable[..., Any]]
BY_VALUE = ("less", "less_equal", "greater", "greater_equal", "isfinite", "isnan", "isinf")


class Untraced(TypeError):
    """Raised where the derivative of a computation is not available: a conversion to a plain number, or an unknown function."""


class TapeStep(NamedTuple):
    """A recorded step: the numbers of the result and its operands. ``forward``: derivatives (P, ...) of the operands, None for zero
    -> that of the result; ``back``: weights (M, ...) of the result -> those of the operands."""

    result: int
    operands: tuple[int, ...]
    forward: Callable[[list[Any]], NumberArray]
    back: Callable[[NumberArray], list[NumberArray]]


class Tape:
    """The steps of a computation in the order in which they were taken."""

    def __init__(self, ufuncs: Functions, functions: Functions) -> None:
        self.ufuncs, self.functions = ufuncs, functions  # of traced arrays, by numpy's names
        self.steps: list[TapeStep] = []
        self.values: list[NumberArray] = []  # of every traced result

    def variable(self, value: Any) -> Traced:
        """An independent traced array, by which derivatives are taken or for which they are given."""
        return self.result(np.asarray(value))

    def result(self, value: NumberArray) -> Traced:
        """A new traced array, without recording a step."""
        self.values.append(value)
        return Traced(self, len(self.values) - 1, value)

    def step(
        self, value: Any, operands: Sequence[Traced], forward: Callable[[list[Any]], Any], back: Callable[[Any], list[Any]]
    ) -> Traced:
        """Record a step; returns its result."""
        made = self.result(np.asarray(value))
        self.steps.append(TapeStep(made.number, tuple(x.number for x in operands), forward, back))
        return made

    def elementwise(self, value: Any, slopes: Sequence[tuple[Any, Any, Any]]) -> Any:
        """Record an elementwise step; returns its result. ``slopes``: (operand, h, g of its derivative, g None for zero)."""
        traced = [(x, h, g) for x, h, g in slopes if isinstance(x, Traced)]
        value = np.asarray(value)
        real = not np.iscomplexobj(value)

        def forward(given: list[Any]) -> Any:
            total: Any = None
            for d, (x, h, g) in zip(given, traced, strict=True):
                if d is None:
                    continue
                d = spread(d, np.ndim(x.value), value.ndim)
                term = d * h if g is None else d * h + np.conj(d) * g
                total = term if total is None else total + term
            return total.real if real else total

        def back(w: NumberArray) -> list[NumberArray]:
            tangents = []
            for x, h, g in traced:
                own = np.conj(h) * w if g is None else np.conj(h) * w + g * np.conj(w)
                tangents.append(gathered(own, x.value))
            return tangents

        return self.step(value, [x for x, _, _ in traced], forward, back)

    def implicit(self, residuals: Sequence[Any], matrix: Real, inverse: Real) -> list[Traced]:
        """Record the implicit function theorem: the changes of n unknowns, of value 0, that keep m real ``residuals`` at zero.

        ``matrix`` (..., m, n): derivatives of the residuals by the unknowns; ``inverse`` (..., n, m): its inverse, or
        pseudo-inverse where m > n. Derivatives are NaN where redundant residuals do not stay zero.
        """
        traced = [(i, r) for i, r in enumerate(residuals) if isinstance(r, Traced)]
        shape = np.broadcast_shapes(matrix.shape[:-2], *(np.shape(r.value) for _, r in traced))
        overdetermined = matrix.shape[-2] > matrix.shape[-1]

        def forward(given: list[Any]) -> Any:
            known = next(d for d in given if d is not None)
            moved = np.zeros((len(known), *shape, matrix.shape[-2]))
            for d, (i, r) in zip(given, traced, strict=True):
                if d is not None:
                    moved[..., i] = spread(d, np.ndim(r.value), len(shape))
            solution = -(inverse @ moved[..., None])[..., 0]
            if overdetermined:  # redundant equations must be satisfied, too
                left = np.abs(moved + (matrix @ solution[..., None])[..., 0]).max(axis=-1, keepdims=True)
                size = np.abs(moved).max(axis=-1, keepdims=True)
                solution = np.where(left <= 1e-9 * size, solution, np.nan)
            return solution

        def back(w: NumberArray) -> list[NumberArray]:
            rows = -(np.swapaxes(inverse, -1, -2) @ w[..., None])[..., 0]
            return [gathered(rows[..., i], r.value) for i, r in traced]

        both = self.step(np.zeros((*shape, matrix.shape[-1])), [r for _, r in traced], forward, back)
        return [both[..., k] for k in range(matrix.shape[-1])]

    def forward(self, given: Mapping[int, NumberArray], wanted: Sequence[Traced]) -> list[NumberArray]:
        """Derivatives (P, ...) of the results ``wanted`` from those of variables, ``given`` by number (P, ...), else zero."""
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

    def adjoint(self, wanted: Traced, weights: NumberArray) -> dict[int, NumberArray]:
        """Derivatives of M weighted sums of a real result, with ``weights`` (M, ...), by everything on the tape: number ->
        (M, ...)."""
        known: dict[int, NumberArray] = {wanted.number: weights}
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            for step in reversed(self.steps):
                w = known.get(step.result)
                if w is None:
                    continue
                for number, own in zip(step.operands, step.back(w), strict=True):
                    known[number] = known[number] + own if number in known else own
        return known


def spread(d: Any, own: int, wanted: int) -> Any:
    """Derivatives (P, ...) of an array with ``own`` axes, with leading axes of length one inserted up to ``wanted`` axes."""
    return d if own == wanted else d.reshape(d.shape[0], *(1,) * (wanted - own), *d.shape[1:])


def gathered(w: Any, value: NumberArray) -> Any:
    """Weights (M, ...) summed over the axes along which an operand was broadcast; real if the operand is."""
    w = np.asarray(w)
    extra = w.ndim - 1 - value.ndim
    if extra:
        w = w.sum(axis=tuple(range(1, 1 + extra)))
    repeated = tuple(k + 1 for k, n in enumerate(value.shape) if n == 1 and w.shape[k + 1] != 1)
    if repeated:
        w = w.sum(axis=repeated, keepdims=True)
    return w if np.iscomplexobj(value) else w.real


class Traced(NDArrayOperatorsMixin):
    """An array whose derivatives are on a tape. It can be an operand wherever a numpy array can; it is never a plain zero."""

    __slots__ = ("number", "tape", "value")
    __hash__ = object.__hash__

    def __init__(self, tape: Tape, number: int, value: NumberArray):
        self.tape, self.number, self.value = tape, number, value

    def __repr__(self) -> str:
        return f"Traced({self.value!r})"

    # -- the interface of an array ------------------------------------------------------------------------------------
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
        """Clipped between two numbers, like `np.clip`."""
        return np.clip(self, low, high)

    def astype(self, _: Any) -> Traced:
        return self

    def __getitem__(self, key: Any) -> Any:
        keys = (slice(None), *(key if isinstance(key, tuple) else (key,)))

        def back(w: NumberArray) -> list[NumberArray]:
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
        raise Untraced("a part of this mechanism is computed in a way whose derivatives are not known")

    __float__ = __complex__ = __int__ = __array__

    def __bool__(self) -> bool:
        if self.value.ndim:
            raise ValueError("the truth value of an array")
        return True  # a number that may vary is not a plain zero

    def __array_ufunc__(self, function: Any, method: str, *operands: Any, **options: Any) -> Any:
        own = self.tape.ufuncs.get(function.__name__)
        if method != "__call__" or options:
            raise Untraced(f"numpy.{function.__name__} has no derivative here")
        if own is not None:
            return own(*operands)
        if function.__name__ in BY_VALUE:
            return function(*map(value_of, operands))
        raise Untraced(f"numpy.{function.__name__} has no derivative here")

    def __array_function__(self, function: Any, types: Any, operands: Any, options: Any) -> Any:
        own = self.tape.functions.get(function.__name__)
        if own is None:
            raise Untraced(f"numpy.{function.__name__} has no derivative here")
        return own(*operands, **options)

    def __eq__(self, other: object) -> bool:
        return self is other

    def __ne__(self, other: object) -> bool:
        return self is not other


def value_of(x: Any) -> Any:
    """The value of an operand that may be traced."""
    return x.value if isinstance(x, Traced) else x


def regular_inverses(matrix: Real) -> Real:
    """Inverses (..., n, n) for `Tape.implicit`; NaN where a matrix is singular."""
    singular = ~(np.abs(np.linalg.det(np.nan_to_num(matrix))) > 0.0) | ~np.isfinite(matrix).all(axis=(-1, -2))
    safe = np.where(singular[..., None, None], np.eye(matrix.shape[-1]), matrix)
    return np.where(singular[..., None, None], np.nan, np.linalg.inv(safe))
