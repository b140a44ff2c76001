"""python-solvespace: a sketch of points and distances, the crank's end moved and the sketch solved again; positions only."""

from __future__ import annotations

from functools import partial

import numpy as np
from problem import FOUR_BAR, TRIAD
from spread import DIFFERENCES, with_rates

PACKAGES = ("python-solvespace==3.0.8",)


def _turned(sketch, pin, crank, watched, names):
    """Solves the sketch with the crank's pin at one angle after the other, from where it was drawn."""
    from python_solvespace import ResultFlag

    start = [sketch.params(w) for w in watched]

    def solve(angles):
        computed = np.empty((3, len(angles), 2))
        for w, values in zip(watched, start, strict=True):
            sketch.set_params(w, values)
        bx, by = (crank * np.cos(angles)).tolist(), (crank * np.sin(angles)).tolist()
        for k in range(len(angles)):
            sketch.set_params(pin.params, (bx[k], by[k]))
            if sketch.solve() != ResultFlag.OKAY:
                raise RuntimeError(f"no solution at crank angle {angles[k]}")
            for i, w in enumerate(watched):
                computed[i, k] = sketch.params(w)
        return {(name, 0): computed[i] for i, name in enumerate(names)}

    return solve


def four_bar():
    from python_solvespace import SolverSystem

    p = FOUR_BAR
    sketch = SolverSystem()
    plane = sketch.create_2d_base()
    d = sketch.add_point_2d(p.ground, 0.0, plane)
    b = sketch.add_point_2d(p.crank, 0.0, plane)
    c = sketch.add_point_2d(3.4, 2.9, plane)
    point = sketch.add_point_2d(1.5, 1.7, plane)
    sketch.dragged(d, plane)
    sketch.dragged(b, plane)
    sketch.distance(b, c, p.coupler, plane)
    sketch.distance(d, c, p.rocker, plane)
    sketch.distance(b, point, float(np.hypot(*p.p)), plane)
    sketch.distance(c, point, float(np.hypot(p.p[0] - p.coupler, p.p[1])), plane)
    watched = (b.params, c.params, point.params)
    return _turned(sketch, b, p.crank, watched, "BCP")


ROWS = {"four-bar": {"python-solvespace": four_bar}}


def triad():
    """A plate on three legs: six distances."""
    from python_solvespace import SolverSystem

    p = TRIAD
    sketch = SolverSystem()
    plane = sketch.create_2d_base()
    x, y, turn = p.start
    c, s = np.cos(turn), np.sin(turn)
    b, m, n = (sketch.add_point_2d(*at, plane) for at in ((p.crank, 0.0), *p.feet))
    plate = [sketch.add_point_2d(x + c * u - s * v, y + s * u + c * v, plane) for u, v in p.plate]
    for fixed in (b, m, n):
        sketch.dragged(fixed, plane)
    for foot, end, leg in zip((b, m, n), plate, p.legs, strict=True):
        sketch.distance(foot, end, leg, plane)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        sketch.distance(plate[i], plate[j], float(np.hypot(*np.subtract(p.plate[i], p.plate[j]))), plane)
    watched = [end.params for end in plate]
    return _turned(sketch, b, p.crank, watched, "PQR")


def differences():
    solve = four_bar()
    return {f"differences of order {k}": partial(with_rates, solve, k, FOUR_BAR.speed) for k in DIFFERENCES}


SETTINGS = {  # its tolerance cannot be set
    ("four-bar", "positions"): {"python-solvespace": lambda: {"as it is": four_bar()}},
    ("four-bar", "rates"): {"python-solvespace": differences},
    ("triad", "positions"): {"python-solvespace": lambda: {"as it is": triad()}},
}
