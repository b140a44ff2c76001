"""The motion of a planar linkage of one freedom by its energy, t = integral of sqrt(m / 2 (E - V)) ds, apart from mechcore.

Unknowns are the absolute angles x (n,) of the moving links, constraints the loops of vectors, and s is the length of the way of x
along the configuration curve: neither change points nearby nor dead points are anything special on it.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853
from scipy.optimize import brentq

__all__ = ["Body", "Linkage", "change_point_way", "linkage_way"]

Array = NDArray[np.float64]
G = 9.81
Vector = tuple[int, complex]  # link, place in its own frame [m]


@dataclass(frozen=True)
class Body:
    """``place``: vectors from the frame to the link's origin; ``centre`` in the link's frame [m]."""

    mass: float
    inertia: float
    centre: complex
    place: tuple[Vector, ...]


@dataclass(frozen=True)
class Linkage:
    """``loops``: vectors, with a constant, that add up to zero; ``bodies``: one a moving link, in the order of x."""

    bodies: tuple[Body, ...]
    loops: tuple[tuple[tuple[Vector, ...], complex], ...]
    gravity: float = G

    def closure(self, x: Array) -> Array:
        sums = [sum((z * np.exp(1j * x[k]) for k, z in loop), constant) for loop, constant in self.loops]
        return np.array([f(s) for s in sums for f in (np.real, np.imag)])

    def jacobian(self, x: Array) -> Array:
        """(n - 1, n)"""
        out = np.zeros((2 * len(self.loops), len(x)))
        for i, (loop, _) in enumerate(self.loops):
            for k, z in loop:
                d = 1j * z * np.exp(1j * x[k])
                out[2 * i, k] += d.real
                out[2 * i + 1, k] += d.imag
        return out

    def energies(self, x: Array, w: Array) -> tuple[float, float]:
        """Kinetic [J] at angular speeds w, and potential [J]."""
        kinetic = potential = 0.0
        for k, body in enumerate(self.bodies):
            way = (*body.place, (k, body.centre))
            speed = sum(1j * z * np.exp(1j * x[j]) * w[j] for j, z in way)
            kinetic += 0.5 * body.mass * abs(speed) ** 2 + 0.5 * body.inertia * w[k] ** 2
            potential += body.mass * self.gravity * sum((z * np.exp(1j * x[j])).imag for j, z in way)
        return float(kinetic), float(potential)

    def closed(self, x: Array) -> Array:
        """The nearest closed configuration."""
        for _ in range(4):
            x = x - np.linalg.pinv(self.jacobian(x)) @ self.closure(x)
        return x


def linkage_way(linkage: Linkage, x: Array, leader: int, speed: float, times: Sequence[float], floor: float) -> Array:
    """Angles (times, n) of the motion that starts in x with a speed [rad/s] of link number ``leader``, at ascending times > 0.

    ``floor``: shortest step; steps are shorter than the distance from the nearest singular position unless that is below it, and
    so no step leads across to another branch.
    """
    x = linkage.closed(np.asarray(x, float))
    if np.linalg.svd(linkage.jacobian(x))[1][-1] < 1e-6:
        raise ValueError("starts in a singular position")
    before = np.linalg.svd(linkage.jacobian(x))[2][-1]
    before = before * np.sign(speed * before[leader])
    kinetic, potential = linkage.energies(x, before * (speed / before[leader]))
    whole = kinetic + potential

    def slope(_: float, y: Array) -> Array:
        tangent = np.linalg.svd(linkage.jacobian(y[:-1]))[2][-1]
        tangent = tangent * np.sign(tangent @ before)
        kinetic, potential = linkage.energies(y[:-1], tangent)
        return np.append(tangent, np.sqrt(kinetic / (whole - potential)) if whole > potential else np.nan)

    y = np.append(x, 0.0)
    solver: Any = DOP853(slope, 0.0, y, 1e6, rtol=3e-14, atol=1e-15, first_step=1e-4)
    result, left = [], list(times)
    while left:
        singular = float(np.linalg.svd(linkage.jacobian(solver.y[:-1]))[1][-1])
        solver.max_step = max(0.2 * singular, floor)
        solver.h_abs = min(solver.h_abs, solver.max_step)
        solver.step()
        if solver.status == "failed" or not np.isfinite(solver.y).all():
            raise ValueError("the motion turns back or stops")
        dense = solver.dense_output()
        while left and left[0] <= solver.y[-1]:
            s = brentq(lambda s, way=dense: way(s)[-1] - left[0], solver.t_old, solver.t, xtol=1e-15)
            result.append(linkage.closed(dense(s)[:-1]))
            left.pop(0)
        solver.y[:-1] = linkage.closed(solver.y[:-1])
        solver.f = slope(solver.t, solver.y)
        before = solver.f[:-1]
    return np.array(result)


def change_point_way(
    sizes: tuple[float, float, float, float], linkage: Linkage, side: float, start: float, speed: float, turns: float, count: int
) -> tuple[Array, Array]:
    """Times (count,) and angles (count, 3) of a change-point four-bar (crank a, coupler b, rocker c, frame d) whose crank turns
    fully, at equal steps of the crank over ``turns``.

    b exp(i theta_2) = R / r^2 ((r^2 + b^2 - c^2) / 2 + i H) with R = d - a exp(i q), r = |R| and H^2 = ((b + c)^2 - r^2)
    (r^2 - (b - c)^2) / 4. Where a + d = b + c the first factor is 4 a d cos^2(q / 2), where |a - d| = |b - c| the second is
    4 a d sin^2(q / 2): the root is drawn by hand, and H, which is smooth through the change points, has its sign at the start.
    """
    a, b, c, d = sizes
    full, folded = abs(a + d - b - c) < 1e-12, abs(abs(a - d) - abs(b - c)) < 1e-12
    if not (full or folded) or abs(a - d) < 1e-3:
        raise ValueError("no change point, or a kite")

    def factors(q: Array) -> tuple[Array, Array]:
        """H and its slope by q."""
        r2, by_q = a * a + d * d - 2 * a * d * np.cos(q), 2 * a * d * np.sin(q)
        value, slope = np.full_like(q, 0.5), np.zeros_like(q)
        for exact, root, whole, sign in (
            (full, (np.cos(q / 2), -0.5 * np.sin(q / 2)), (b + c) ** 2 - r2, -1.0),
            (folded, (np.sin(q / 2), 0.5 * np.cos(q / 2)), r2 - (b - c) ** 2, 1.0),
        ):
            size = 2 * np.sqrt(a * d)
            f, g = (size * root[0], size * root[1]) if exact else (np.sqrt(whole), 0.5 * sign * by_q / np.sqrt(whole))
            value, slope = value * f, slope * f + value * g
        return value, slope

    sign = side * np.sign(factors(np.array([start]))[0][0])

    def angles(q: Array) -> tuple[Array, Array]:
        """Directions exp(i x) (n, 3) and their slopes x' (n, 3)."""
        crank = a * np.exp(1j * q)
        arm, r2, by_q = d - crank, a * a + d * d - 2 * a * d * np.cos(q), 2 * a * d * np.sin(q)
        h, slope = (sign * f for f in factors(q))
        inner, inner_q = (r2 + b * b - c * c) / 2 + 1j * h, by_q / 2 + 1j * slope
        coupler = arm / r2 * inner
        coupler_q = (-1j * crank / r2 - arm * by_q / r2**2) * inner + arm / r2 * inner_q
        rocker, rocker_q = crank + coupler - d, 1j * crank + coupler_q
        vectors, slopes = np.stack([crank, coupler, rocker], axis=1), np.stack([1j * crank, coupler_q, rocker_q], axis=1)
        return np.angle(vectors), (slopes / vectors).imag

    def rate(q: Array) -> Array:
        computed = [linkage.energies(x, w) for x, w in zip(*angles(q), strict=True)]
        return np.array([np.sqrt(k / (whole - v)) for k, v in computed])

    x, w = angles(np.array([start]))
    kinetic, potential = linkage.energies(x[0], w[0] * speed)
    whole = kinetic + potential
    nodes, weights = np.polynomial.legendre.leggauss(16)
    panels = 8
    edges = start + np.sign(speed) * 2 * np.pi * turns * np.arange(count + 1) / count
    times = [0.0]
    for low, high in itertools.pairwise(edges):
        fine = np.linspace(low, high, panels + 1)
        half = 0.5 * np.diff(fine)
        q = (fine[:-1, None] + half[:, None] * (1.0 + nodes)).ravel()
        times.append(times[-1] + float((rate(q) * (np.abs(half)[:, None] * weights).ravel()).sum()))
    computed = np.concatenate([angles(edges[k : k + 1])[0] for k in range(1, count + 1)])
    return np.array(times[1:]), computed
