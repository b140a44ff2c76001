"""sympy: equations derived symbolically and turned into numpy functions once, then Newton and linear solves by hand.

Three ways each: Newton frame by frame with numpy's solver, as one writes it down for any mechanism; the same with two equations in
two unknowns solved by hand; and with hand work that suits this one mechanism, on all frames at once.
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


def solve2(j, r):
    """Two linear equations; far faster than numpy.linalg.solve where they come one by one."""
    (a, b), (c, d) = j
    det = a * d - b * c
    return (r[0] * d - r[1] * b) / det, (r[1] * a - r[0] * c) / det


def newton(closure, solver, angle, z, stop=1e-13):
    """Newton's method on two closure equations until a step is smaller than ``stop``: solution and Jacobian there."""
    for _ in range(20):
        gap, jacobian = closure(angle, *z)
        dx, dy = solver(jacobian, gap)
        z = z[0] - dx, z[1] - dy
        if max(abs(dx), abs(dy)) < stop:
            break
    return z, closure(angle, *z)[1]


def four_bar(*, solver=None):
    import sympy as sp

    p = FOUR_BAR
    q, x, y = sp.symbols("q x y")
    b = sp.Matrix([p.crank * sp.cos(q), p.crank * sp.sin(q)])
    c = b + p.coupler * sp.Matrix([sp.cos(x), sp.sin(x)])
    point = b + sp.Matrix([p.p[0] * sp.cos(x) - p.p[1] * sp.sin(x), p.p[0] * sp.sin(x) + p.p[1] * sp.cos(x)])
    loop = c - sp.Matrix([p.ground, 0]) - p.rocker * sp.Matrix([sp.cos(y), sp.sin(y)])
    points = [*b, *c, *point]
    speed, second, first, twice = rates([*loop, *points], (x, y), q, p.speed)
    zero = dict.fromkeys(speed, 0)
    rest = dict.fromkeys(second, 0)
    module = "math" if solver else "numpy"
    closure = sp.lambdify((q, x, y), [list(loop), loop.jacobian([x, y]).tolist()], module, cse=True)
    right_v = sp.lambdify((q, x, y), [-f.subs(zero) for f in first[:2]], module, cse=True)
    right_a = sp.lambdify((q, x, y, *speed), [-f.subs(rest) for f in twice[:2]], module, cse=True)
    results = sp.lambdify((q, x, y, *speed, *second), [*points, *first[2:], *twice[2:]], module, cse=True)
    start = (0.8, 1.8)

    def one_by_one(angles, stop=1e-13):
        computed = np.empty((len(angles), 18))
        z = start
        for k, angle in enumerate(angles.tolist()):
            z, jacobian = newton(closure, solver, angle, z, stop)
            v = solver(jacobian, right_v(angle, *z))
            computed[k] = results(angle, *z, *v, *solver(jacobian, right_a(angle, *z, *v)))
        return {(n, d): computed[:, 6 * d + 2 * i : 6 * d + 2 * i + 2] for i, n in enumerate("BCP") for d in range(3)}

    def at_once(angles, stop=1e-13):
        z = np.tile(np.array(start)[:, None], len(angles))  # one start for the whole turn: it happens to be good enough here
        for _ in range(20):
            gap, jacobian = closure(angles, *z)
            dz = np.stack(solve2(jacobian, gap))
            z = z - dz
            if np.abs(dz).max() < stop:
                break
        jacobian = closure(angles, *z)[1]
        v = solve2(jacobian, right_v(angles, *z))
        a = solve2(jacobian, right_a(angles, *z, *v))
        computed = np.stack(results(angles, *z, *v, *a), -1)
        return {(n, d): computed[:, 6 * d + 2 * i : 6 * d + 2 * i + 2] for i, n in enumerate("BCP") for d in range(3)}

    return one_by_one if solver else at_once


def slider_crank(*, solver=None):
    """The 8 x 8 system of Newton-Euler, lambdified and solved for all frames at once.

    Positions by Newton frame by frame; or, by hand, in closed form, put into the symbolic expressions.
    """
    import sympy as sp

    p, closed = SLIDER_CRANK, solver is None
    q, x, y = sp.symbols("q x y")  # angles of crank and rod, place of the slider
    rod = sp.asin((p.e - p.r * sp.sin(q)) / p.l) if closed else x
    o = sp.Matrix([0, 0])
    along1, along2 = sp.Matrix([sp.cos(q), sp.sin(q)]), sp.Matrix([sp.cos(rod), sp.sin(rod)])
    b = p.r * along1
    c = b + p.l * along2
    centres = [p.s1 * along1, b + p.s2 * along2, c]
    moving = [*sp.Matrix.vstack(*centres), rod]
    if closed:
        known, (_, _, _, twice) = (q,), rates(moving, (), q, p.speed)
    else:
        loop = c - sp.Matrix([y, p.e])
        speed, second, first, twice = rates([*loop, *moving], (x, y), q, p.speed)
        closure = sp.lambdify((q, x, y), [list(loop), loop.jacobian([x, y]).tolist()], "math", cse=True)
        right_v = sp.lambdify((q, x, y), [-f.subs(dict.fromkeys(speed, 0)) for f in first[:2]], "math", cse=True)
        right_a = sp.lambdify((q, x, y, *speed), [-f.subs(dict.fromkeys(second, 0)) for f in twice[:2]], "math", cse=True)
        known, twice = (q, x, y, *speed, *second), twice[2:]
    acceleration = [sp.Matrix(twice[i : i + 2]) for i in (0, 2, 4)]
    force = [sp.Matrix([0, -p.m[0] * GRAVITY]), sp.Matrix([0, -p.m[1] * GRAVITY]), sp.Matrix([p.force, -p.m[2] * GRAVITY])]
    unknown = sp.symbols("ox oy bx by cx cy guide torque")
    on, bn, cn = (sp.Matrix(unknown[i : i + 2]) for i in (0, 2, 4))

    def cross(u, v):
        return u[0] * v[1] - u[1] * v[0]

    equations = [
        *(on - bn + force[0] - p.m[0] * acceleration[0]),
        cross(o - centres[0], on) - cross(b - centres[0], bn) + unknown[7],
        *(bn - cn + force[1] - p.m[1] * acceleration[1]),
        cross(b - centres[1], bn) - cross(c - centres[1], cn) - p.j[1] * twice[6],
        *(cn + sp.Matrix([0, unknown[6]]) + force[2] - p.m[2] * acceleration[2]),
    ]
    matrix, right = sp.linear_eq_to_matrix(equations, unknown)
    entries = [(i, j) for i in range(8) for j in range(8) if matrix[i, j] != 0]
    evaluate = sp.lambdify(known, [matrix[i, j] for i, j in entries] + list(right), "numpy", cse=True)

    def motion(angles, stop):
        result, z = np.empty((len(angles), 6)), (0.0, p.r + p.l)
        for k, angle in enumerate(angles.tolist()):
            z, jacobian = newton(closure, solver, angle, z, stop)
            v = solver(jacobian, right_v(angle, *z))
            result[k] = *z, *v, *solver(jacobian, right_a(angle, *z, *v))
        return result.T

    def solve(angles, stop=1e-13):
        values = evaluate(angles, *(() if closed else motion(angles, stop)))
        a, r = np.zeros((len(angles), 8, 8)), np.zeros((len(angles), 8, 1))
        for (i, j), value in zip(entries, values, strict=False):
            a[:, i, j] = value
        for i, value in enumerate(values[len(entries) :]):
            r[:, i, 0] = value
        y = np.linalg.solve(a, r)[..., 0]
        return {"O": y[:, 0:2], "B": y[:, 2:4], "C": y[:, 4:6], "guide": y[:, 6], "torque": y[:, 7]}

    return solve


ROWS = {
    "four-bar": {
        "sympy lambdify + Newton": partial(four_bar, solver=np.linalg.solve),
        "by hand: sympy lambdify + Newton, 2 x 2 in closed form": partial(four_bar, solver=solve2),
        "by hand: sympy lambdify + Newton on all positions at once": four_bar,
    },
    "slider-crank": {
        "sympy lambdify + Newton + batched solve": partial(slider_crank, solver=np.linalg.solve),
        "by hand: sympy lambdify + Newton, 2 x 2 in closed form + batched solve": partial(slider_crank, solver=solve2),
        "by hand: closed-form positions, sympy lambdify + batched solve": slider_crank,
    },
}
STOPS = (1e-1, 1e-2, 1e-4, 1e-8, 1e-13)


def tolerances(build, solver=None):
    """The step [rad, m] below which Newton's method stops."""
    solve = build(solver=solver)
    return {f"Newton to {stop:.0e}": partial(solve, stop=stop) for stop in STOPS}


SETTINGS = {
    ("four-bar", "rates"): {
        "sympy": partial(tolerances, four_bar, np.linalg.solve),
        "by hand: sympy, all positions at once": partial(tolerances, four_bar),
    },
    ("slider-crank", "forces"): {
        "sympy": partial(tolerances, slider_crank, np.linalg.solve),
        "by hand: sympy, closed-form positions": lambda: {"as it is": slider_crank()},
    },
}
