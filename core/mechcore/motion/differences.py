"""Rates by numerical differentiation of the positions at the frames: what is done where no equations of the rates are solved.

It is there to be compared with: the exact rates cost less than what these miss. "differences" takes the derivatives of the
polynomials through the nearest frames (order 2, 4 or 6 inside, the same polynomials at the ends); "graphical" is the drawn method
of the lecture: positions read off with the resolution of the drawing, the slopes of chords averaged, their change as acceleration.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Real, Values
from mechcore.kinematics.rates import Rates

if TYPE_CHECKING:
    from mechcore.motion.motion import Motion


def differentiate(time: Real, values: Real, order: int, derivative: int = 1) -> Real:
    """First or second derivative by time (F,) of values (..., F), from polynomials through ``order`` + 1 neighbouring frames."""
    count = min(order + 1, len(time))
    if count < 2 or (derivative == 2 and count < 3):
        return np.zeros_like(values)
    first = np.clip(np.arange(len(time)) - count // 2, 0, len(time) - count)
    places = first[:, None] + np.arange(count)
    x = time[places]
    h = (x[:, -1] - x[:, 0]) / (count - 1)
    even = np.abs(np.diff(x, axis=1) - h[:, None]).max() < 1e-9 * h.min()
    if even:
        table = _even_weights(count, derivative)
        weights = table[np.arange(len(time)) - first] / h[:, None] ** derivative
    else:
        weights = np.array([_weights(row - t, derivative) for row, t in zip(x, time, strict=True)])
    return np.asarray(np.einsum("fm,...fm->...f", weights, values[..., places]))


@lru_cache
def _even_weights(count: int, derivative: int) -> Real:
    """Weights (count, count) at each node of ``count`` evenly spaced ones, a unit apart."""
    nodes = np.arange(count, dtype=float)
    return np.array([_weights(nodes - node, derivative) for node in nodes])


def _weights(x: Real, derivative: int) -> Real:
    """Weights of values at offsets ``x`` for a derivative at zero: exact for all polynomials through the nodes."""
    scale = float(np.abs(x).max())
    rows = np.vander(x / scale, increasing=True).T
    rhs = np.zeros(len(x))
    rhs[derivative] = float(derivative) / scale**derivative  # 1! = 1, 2! = 2
    return np.asarray(np.linalg.solve(rows, rhs), float)


def numerical_rates(motion: Motion, derivative: int) -> Rates:
    """First or second rates of all groups and slides of a motion from its positions at the frames; drives keep their own."""
    model, accuracy = motion.model, motion.accuracy
    drives = [d[derivative] for d in motion.drives]
    rates = Rates(model, drives, motion.state.bends if derivative == 1 else None, None if derivative == 1 else motion.speeds)
    drawn = accuracy.differentiation == "graphical"
    order = 2 if drawn else accuracy.differences

    def slope(given: Values, unit: float) -> Values:
        values = np.broadcast_to(given, motion.shape)
        if drawn and accuracy.resolution > 0.0:
            values = accuracy.resolution * unit * np.round(values / (accuracy.resolution * unit))
        return differentiate(motion.time, values, order, derivative)

    for block in model.blocks:
        solved = [slope(motion.group_angle(g), 1.0) for g in block.angles]
        solved += [slope(motion.state.slide[j], model.length_scale) for j in block.slides]
        rates.settle(model, block, solved)
    return rates
