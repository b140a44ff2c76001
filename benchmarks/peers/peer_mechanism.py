"""mechanism: its vectors and loop equations, solved by its own iteration over the input."""

from __future__ import annotations

import numpy as np
from problem import FOUR_BAR

PACKAGES = ("mechanism==1.1.10",)


def four_bar():
    import matplotlib

    matplotlib.use("Agg")  # the package draws as well; nothing is drawn here
    from mechanism import Joint, Mechanism, Vector

    p = FOUR_BAR
    pins = {k: Joint(k) for k in "ABCDP"}
    crank = Vector((pins["A"], pins["B"]), r=p.crank)
    coupler = Vector((pins["B"], pins["C"]), r=p.coupler)
    rocker = Vector((pins["D"], pins["C"]), r=p.rocker)
    ground = Vector((pins["A"], pins["D"]), r=p.ground, theta=0.0)
    left = Vector((pins["B"], pins["P"]), r=float(np.hypot(*p.p)))  # the coupler's triangle is a second loop
    right = Vector((pins["C"], pins["P"]), r=float(np.hypot(p.p[0] - p.coupler, p.p[1])))
    guess = (np.array([0.8, 1.8, 1.4, 3.4]), np.zeros(4), np.zeros(4))

    def loops(x, i):
        gap = np.zeros((2, 2))
        gap[0] = crank(i) + coupler(x[0]) - rocker(x[1]) - ground()
        gap[1] = left(x[2]) - right(x[3]) - coupler(x[0])
        return gap.flatten()

    def solve(angles):
        m = Mechanism(
            vectors=(crank, coupler, rocker, ground, left, right),
            origin=pins["A"],
            loops=loops,
            pos=angles,
            vel=np.full(len(angles), p.speed),
            acc=np.zeros(len(angles)),
            guess=guess,
        )
        m.iterate()
        result = {}
        for k in "BCP":
            j = pins[k]
            result[k, 0] = np.stack([j.x_positions, j.y_positions], -1)
            result[k, 1] = np.stack([j.x_velocities, j.y_velocities], -1)
            result[k, 2] = np.stack([j.x_accelerations, j.y_accelerations], -1)
        return result

    return solve


ROWS = {"four-bar": {"mechanism": four_bar}}
SETTINGS = {("four-bar", "rates"): {"mechanism": lambda: {"as it is": four_bar()}}}
