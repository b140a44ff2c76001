"""sympy: equations derived symbolically and turned into numpy functions once, then Newton and linear solves by hand.

For the four-bar two ways: frame by frame, as one writes it down, and Newton on all frames at once.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from problem import FOUR_BAR, GRAVITY, SLIDER_CRANK

PACKAGES = ("sympy==1.14.0",)


def rates(values, unknown, drive, w):
    """Symbolic first and second derivatives by time of expressions in the unknowns and the drive's angle, whose speed is w."""
    import sympy as sp

    speed = sp.symbols(f"speed:{len(unknown)}")
    second = sp.symbols(f"second:{len(unknown)}")
    first = [sum((sp.diff(f, u) * v for u, v in zip(unknown, speed, strict=True)), sp.diff(f, drive) * w) for f in values]
    twice = [
        sum((sp.diff(f, u) * v + sp.diff(f, v) * a for u, v, a in zip(unknown, speed, second, strict=True)), sp.diff(f, drive) * w)
        for f in first
    ]
    return speed, second, first, twice


def four_bar(*, batched: bool):
    import sympy as sp

    p = FOUR_BAR
    q, x, y = sp.symbols("q x y")
    b = sp.Matrix([p.crank * sp.cos(q), p.crank * sp.sin(q)])
    c = b + p.coupler * sp.Matrix([sp.cos(x), sp.sin(x)])
    point = b + sp.Matrix([p.p[0] * sp.cos(x) - p.p[1] * sp.sin(x), p.p[0] * sp.sin(x) + p.p[1] * sp.cos(x)])
    loop = c - sp.Matrix([p.ground, 0]) - p.rocker * sp.Matrix([sp.cos(y), sp.sin(y)])
    points = [*b, *c, *point]
    speed, second, first, twice = rates([*loop, *points], (x, y), q, p.speed)
    zero = {s: 0 for s in speed}
    rest = {s: 0 for s in second}
    module = "numpy" if batched else "math"
    closure = sp.lambdify((q, x, y), [list(loop), loop.jacobian([x, y]).tolist()], module, cse=True)
    right_v = sp.lambdify((q, x, y), [-f.subs(zero) for f in first[:2]], module, cse=True)
    right_a = sp.lambdify((q, x, y, *speed), [-f.subs(rest) for f in twice[:2]], module, cse=True)
    results = sp.lambdify((q, x, y, *speed, *second), [*points, *first[2:], *twice[2:]], module, cse=True)
    start = (0.8, 1.8)

    def one_by_one(angles):
        found = np.empty((len(angles), 18))
        z = np.array(start)
        for k, angle in enumerate(angles.tolist()):
            for _ in range(20):
                gap, jacobian = closure(angle, *z.tolist())
                dz = np.linalg.solve(jacobian, gap)
                z = z - dz
                if abs(dz).max() < 1e-13:
                    break
            zs = z.tolist()
            jacobian = np.array(closure(angle, *zs)[1])
            v = np.linalg.solve(jacobian, right_v(angle, *zs)).tolist()
            a = np.linalg.solve(jacobian, right_a(angle, *zs, *v)).tolist()
            found[k] = results(angle, *zs, *v, *a)
        return {(n, d): found[:, 6 * d + 2 * i : 6 * d + 2 * i + 2] for i, n in enumerate("BCP") for d in range(3)}

    def at_once(angles):
        def solve2(j, r):
            det = j[0][0] * j[1][1] - j[0][1] * j[1][0]
            return np.stack([(r[0] * j[1][1] - r[1] * j[0][1]) / det, (r[1] * j[0][0] - r[0] * j[1][0]) / det])

        z = np.tile(np.array(start)[:, None], len(angles))  # one start for the whole turn: it happens to be good enough here
        for _ in range(20):
            gap, jacobian = closure(angles, *z)
            dz = solve2(jacobian, gap)
            z = z - dz
            if np.abs(dz).max() < 1e-13:
                break
        jacobian = closure(angles, *z)[1]
        v = solve2(jacobian, right_v(angles, *z))
        a = solve2(jacobian, right_a(angles, *z, *v))
        found = np.stack(results(angles, *z, *v, *a), -1)
        return {(n, d): found[:, 6 * d + 2 * i : 6 * d + 2 * i + 2] for i, n in enumerate("BCP") for d in range(3)}

    return at_once if batched else one_by_one


def slider_crank():
    """Closed-form position, symbolic derivatives, and the 8 x 8 system of Newton-Euler solved for all frames at once."""
    import sympy as sp

    p = SLIDER_CRANK
    q, w = sp.symbols("q w")
    rod = sp.asin((p.e - p.r * sp.sin(q)) / p.l)
    o = sp.Matrix([0, 0])
    along1, along2 = sp.Matrix([sp.cos(q), sp.sin(q)]), sp.Matrix([sp.cos(rod), sp.sin(rod)])
    b = p.r * along1
    c = b + p.l * along2
    centres = [p.s1 * along1, b + p.s2 * along2, c]
    acceleration = [s.diff(q, 2) * w**2 for s in centres]
    spin = [0, sp.diff(rod, q, 2) * w**2]
    force = [sp.Matrix([0, -p.m[0] * GRAVITY]), sp.Matrix([0, -p.m[1] * GRAVITY]), sp.Matrix([p.force, -p.m[2] * GRAVITY])]
    unknown = sp.symbols("ox oy bx by cx cy guide torque")
    on, bn, cn = (sp.Matrix(unknown[i : i + 2]) for i in (0, 2, 4))

    def cross(u, v):
        return u[0] * v[1] - u[1] * v[0]

    equations = [
        *(on - bn + force[0] - p.m[0] * acceleration[0]),
        cross(o - centres[0], on) - cross(b - centres[0], bn) + unknown[7] - p.j[0] * spin[0],
        *(bn - cn + force[1] - p.m[1] * acceleration[1]),
        cross(b - centres[1], bn) - cross(c - centres[1], cn) - p.j[1] * spin[1],
        *(cn + sp.Matrix([0, unknown[6]]) + force[2] - p.m[2] * acceleration[2]),
    ]
    matrix, right = sp.linear_eq_to_matrix(equations, unknown)
    entries = [(i, j) for i in range(8) for j in range(8) if matrix[i, j] != 0]
    evaluate = sp.lambdify((q, w), [matrix[i, j] for i, j in entries] + list(right), "numpy", cse=True)

    def solve(angles):
        values = evaluate(angles, p.speed)
        a, r = np.zeros((len(angles), 8, 8)), np.zeros((len(angles), 8, 1))
        for (i, j), value in zip(entries, values, strict=False):
            a[:, i, j] = value
        for i, value in enumerate(values[len(entries) :]):
            r[:, i, 0] = value
        x = np.linalg.solve(a, r)[..., 0]
        return {"O": x[:, 0:2], "B": x[:, 2:4], "C": x[:, 4:6], "guide": x[:, 6], "torque": x[:, 7]}

    return solve


ROWS = {
    "four-bar": {
        "sympy lambdify + Newton": partial(four_bar, batched=False),
        "sympy lambdify + Newton by hand on all frames at once": partial(four_bar, batched=True),
    },
    "slider-crank": {"sympy lambdify + batched solve": slider_crank},
}
