"""A loop over positions with scipy.optimize.fsolve, each started from the last; positions only, rates by differences of them."""

from __future__ import annotations

from functools import partial
from math import cos, sin

import numpy as np
from problem import FOUR_BAR
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
        found = np.empty((len(angles), 2))
        x = np.array([0.8, 1.8])
        for k in range(len(angles)):
            found[k] = x = fsolve(loop, x, args=(bx[k], by[k]), xtol=xtol)
        c, s = np.cos(found), np.sin(found)
        b = np.stack([bx, by], -1)
        end = np.stack([p.ground + p.rocker * c[:, 1], p.rocker * s[:, 1]], -1)
        point = b + np.stack([p.p[0] * c[:, 0] - p.p[1] * s[:, 0], p.p[0] * s[:, 0] + p.p[1] * c[:, 0]], -1)
        return {("B", 0): b, ("C", 0): end, ("P", 0): point}

    return solve


ROWS = {"four-bar": {"scipy fsolve": four_bar}}


def tolerances():
    solve = four_bar()
    return {f"xtol {xtol:.1e}": partial(solve, xtol=xtol) for xtol in (1e-1, 1e-2, 1e-4, 1e-6, 1.49012e-8, 1e-12)}


def differences():
    solve = partial(four_bar(), xtol=1e-12)
    return {f"differences of order {k}": partial(with_rates, solve, k, FOUR_BAR.speed) for k in DIFFERENCES}


DIALS = {
    ("four-bar", "positions"): {"scipy fsolve": tolerances},
    ("four-bar", "rates"): {"scipy fsolve": differences},
    ("four-bar", "any angle"): {"scipy fsolve": lambda: from_fewer(partial(four_bar(), xtol=1e-12), FOUR_BAR.speed)},
}
