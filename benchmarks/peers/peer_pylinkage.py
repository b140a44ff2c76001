"""pylinkage: its own compiled loop over steps, with numba and with plain Python; kinematics only."""

from __future__ import annotations

import sys
from functools import partial

import numpy as np
from problem import FOUR_BAR
from spread import from_fewer

PACKAGES = ("pylinkage==1.3.0", "numba==0.68.1")


def four_bar(*, numba: bool, rates: bool = True):
    if not numba:
        sys.modules["numba"] = None  # as if it were not installed; each row runs in a process of its own
    from pylinkage.actuators import Crank
    from pylinkage.components import Ground
    from pylinkage.dyads import FixedDyad, RRRDyad
    from pylinkage.simulation import Linkage

    p = FOUR_BAR
    a, d = Ground(0.0, 0.0, name="A"), Ground(p.ground, 0.0, name="D")
    crank = Crank(anchor=a, radius=p.crank, angular_velocity=1.0, name="B")  # 1 rad a step of length 1: the step is the angle
    rocker = RRRDyad(crank.output, d, distance1=p.coupler, distance2=p.rocker, name="C")
    point = FixedDyad(crank.output, rocker, distance=float(np.hypot(*p.p)), angle=float(np.arctan2(p.p[1], p.p[0])), name="P")
    linkage = Linkage([a, d, crank, rocker, point])
    linkage.set_input_velocity(crank, omega=p.speed)
    linkage.compile()
    names = {"B": 2, "C": 3, "P": 4}
    start = {}

    def solve(angles):
        step = float(angles[1] - angles[0])
        before = float(angles[0]) - step  # it steps first and records then
        if (step, before) not in start:  # the pose one step before the first
            crank.set_coord(p.crank * np.cos(before), p.crank * np.sin(before))
            rocker.reload()
            point.reload()
            start[step, before] = linkage.get_coords()
        linkage.set_coords(start[step, before])
        if not rates:
            places = linkage.step_fast(len(angles), step)
            return {(k, 0): places[:, j] for k, j in names.items()}
        result = linkage.step_fast_with_kinematics(len(angles), step)
        return {(k, i): result[i][:, j] for k, j in names.items() for i in range(3)}

    return solve


ROWS = {
    "four-bar": {
        "pylinkage with numba": partial(four_bar, numba=True),
        "pylinkage without numba": partial(four_bar, numba=False),
    }
}


def any_angle():
    """From fewer positions, or at every angle."""
    solve = four_bar(numba=True)
    return {**from_fewer(solve, FOUR_BAR.speed), "computed there": solve}


SETTINGS = {  # a closed form, compiled: there is nothing to turn
    ("four-bar", "positions"): {"pylinkage with numba": lambda: {"as it is": four_bar(numba=True, rates=False)}},
    ("four-bar", "rates"): {"pylinkage with numba": lambda: {"as it is": four_bar(numba=True)}},
    ("four-bar", "any angle"): {"pylinkage with numba": any_angle},
}
