"""A loop over positions with scipy.optimize.fsolve, each started from the last; positions only, rates by differences of them."""

from __future__ import annotations

from functools import partial
from math import cos, sin

import numpy as np
from problem import FOUR_BAR, TRIAD
from spread import DIFFERENCES, from_fewer, with_rates

PACKAGES = ("scipy==1.17.1",)


def four_bar():
    from scipy.optimize import fsolve

    p = FOUR_BAR

    def loop(x, bx, by):
        return (
            bx + p.coupler * cos(x[0]) - p.ground - p.rocker * cos(x[1]),
            by + p.coupler * sin(x[0]) - p.rocker * sin(x[1]),
        )

    def solve(angles, xtol=1.49012e-8):
        bx, by = p.crank * np.cos(angles), p.crank * np.sin(angles)
        computed = np.empty((len(angles), 2))
        x = np.array([0.8, 1.8])
        for k in range(len(angles)):
            computed[k] = x = fsolve(loop, x, args=(bx[k], by[k]), xtol=xtol)
        c, s = np.cos(computed), np.sin(computed)
        b = np.stack([bx, by], -1)
        end = np.stack([p.ground + p.rocker * c[:, 1], p.rocker * s[:, 1]], -1)
        point = b + np.stack([p.p[0] * c[:, 0] - p.p[1] * s[:, 0], p.p[0] * s[:, 0] + p.p[1] * c[:, 0]], -1)
        return {("B", 0): b, ("C", 0): end, ("P", 0): point}

    return solve


ROWS = {"four-bar": {"scipy fsolve": four_bar}}


def triad():
    """A plate on three legs: three lengths, three unknowns."""
    from scipy.optimize import fsolve

    p = TRIAD
    (ux, uy), (vx, vy), (wx, wy) = p.plate
    (mx, my), (nx, ny) = p.feet
    first, second, third = (leg * leg for leg in p.legs)

    def lengths(z, bx, by):
        c, s = cos(z[2]), sin(z[2])
        return (
            (z[0] + c * ux - s * uy - bx) ** 2 + (z[1] + s * ux + c * uy - by) ** 2 - first,
            (z[0] + c * vx - s * vy - mx) ** 2 + (z[1] + s * vx + c * vy - my) ** 2 - second,
            (z[0] + c * wx - s * wy - nx) ** 2 + (z[1] + s * wx + c * wy - ny) ** 2 - third,
        )

    def solve(angles, xtol=1.49012e-8):
        bx, by = p.crank * np.cos(angles), p.crank * np.sin(angles)
        computed = np.empty((len(angles), 3))
        z = np.array(p.start)
        for k in range(len(angles)):
            computed[k] = z = fsolve(lengths, z, args=(bx[k], by[k]), xtol=xtol)
        c, s = np.cos(computed[:, 2]), np.sin(computed[:, 2])
        return {
            (n, 0): np.stack([computed[:, 0] + c * u - s * v, computed[:, 1] + s * u + c * v], -1)
            for n, (u, v) in zip("PQR", p.plate, strict=True)
        }

    return solve


def tolerances(build):
    solve = build()
    return {f"xtol {xtol:.1e}": partial(solve, xtol=xtol) for xtol in (1e-1, 1e-2, 1e-4, 1e-6, 1.49012e-8, 1e-12)}


def differences():
    solve = partial(four_bar(), xtol=1e-12)
    return {f"differences of order {k}": partial(with_rates, solve, k, FOUR_BAR.speed) for k in DIFFERENCES}


SETTINGS = {
    ("four-bar", "positions"): {"scipy fsolve": partial(tolerances, four_bar)},
    ("triad", "positions"): {"scipy fsolve": partial(tolerances, triad)},
    ("four-bar", "rates"): {"scipy fsolve": differences},
    ("four-bar", "any angle"): {"scipy fsolve": lambda: from_fewer(partial(four_bar(), xtol=1e-12), FOUR_BAR.speed)},
}
