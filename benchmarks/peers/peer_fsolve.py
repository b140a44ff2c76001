"""A loop over positions with scipy.optimize.fsolve, each started from the last; positions only."""

from __future__ import annotations

from math import cos, sin

import numpy as np
from problem import FOUR_BAR

PACKAGES = ("scipy==1.17.1",)


def four_bar():
    from scipy.optimize import fsolve

    p = FOUR_BAR

    def loop(x, bx, by):
        return (
            bx + p.coupler * cos(x[0]) - p.ground - p.rocker * cos(x[1]),
            by + p.coupler * sin(x[0]) - p.rocker * sin(x[1]),
        )

    def solve(angles):
        bx, by = p.crank * np.cos(angles), p.crank * np.sin(angles)
        found = np.empty((len(angles), 2))
        x = np.array([0.8, 1.8])
        for k in range(len(angles)):
            found[k] = x = fsolve(loop, x, args=(bx[k], by[k]))
        c, s = np.cos(found), np.sin(found)
        b = np.stack([bx, by], -1)
        end = np.stack([p.ground + p.rocker * c[:, 1], p.rocker * s[:, 1]], -1)
        point = b + np.stack([p.p[0] * c[:, 0] - p.p[1] * s[:, 0], p.p[0] * s[:, 0] + p.p[1] * c[:, 0]], -1)
        return {("B", 0): b, ("C", 0): end, ("P", 0): point}

    return solve


ROWS = {"four-bar": {"scipy fsolve": four_bar}}
