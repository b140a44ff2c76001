"""mechviz: the general code. The mechanism is compiled once; times in, arrays by name out."""

from __future__ import annotations

from functools import partial

import numpy as np
from problem import FOUR_BAR, GRAVITY, SLIDER_CRANK, TRIAD, angles
from spread import DIFFERENCES, FEW

PACKAGES = ("numpy==2.4.6", "scipy==1.17.1", "mpmath==1.3.0")  # what mechcore and the reference values need


def four_bar(accuracy=None, rates=(0, 1, 2), executor="numpy"):
    from mechcore.accuracy import DEFAULT
    from mechcore.laws.timed import ConstantSpeed
    from mechcore.motion.solve import compile_mechanism, solve_motion
    from mechcore.spec.mechanism import Drive, Link, Mechanism, Revolute

    p = FOUR_BAR
    points = {
        "frame": {"A": (0.0, 0.0), "D": (p.ground, 0.0)},
        "crank": {"A": (0.0, 0.0), "B": (p.crank, 0.0)},
        "coupler": {"B": (0.0, 0.0), "C": (p.coupler, 0.0), "P": p.p},
        "rocker": {"D": (0.0, 0.0), "C": (p.rocker, 0.0)},
    }
    ends = {"A": ("frame", "crank"), "B": ("crank", "coupler"), "C": ("coupler", "rocker"), "D": ("frame", "rocker")}
    mechanism = Mechanism(
        name="four-bar",
        frame="frame",
        links=tuple(Link(name=k, points=v) for k, v in points.items()),
        joints=tuple(Revolute(name=k, links=v, points=(k, k)) for k, v in ends.items()),
        drives=(Drive(joint="A", law=ConstantSpeed(0.0, p.speed)),),
        modes={"C": "left"},
    )
    compiled = compile_mechanism(mechanism, accuracy or DEFAULT, executor)
    wanted = {"B": "crank", "C": "rocker", "P": "coupler"}

    def solve(angles):
        motion = solve_motion(compiled, angles / p.speed)
        return {(k, d): motion.point(link, k, d) for k, link in wanted.items() for d in rates}

    return solve


def slider_crank(accuracy=None, executor="numpy"):
    from mechcore.accuracy import DEFAULT
    from mechcore.forces.kinetostatics import solve_forces
    from mechcore.laws.timed import ConstantSpeed
    from mechcore.motion.solve import compile_mechanism, solve_motion
    from mechcore.spec.loads import Force
    from mechcore.spec.mechanism import Drive, Link, Mechanism, Prismatic, Revolute

    p = SLIDER_CRANK
    o = (0.0, 0.0)
    mechanism = Mechanism(
        name="slider-crank",
        frame="frame",
        links=(
            Link(name="frame", points={"O": o, "G": (0.0, p.e)}),
            Link(name="crank", points={"O": o, "B": (p.r, 0.0)}, mass=p.m[0], centre=(p.s1, 0.0), inertia=p.j[0]),
            Link(name="rod", points={"B": o, "C": (p.l, 0.0)}, mass=p.m[1], centre=(p.s2, 0.0), inertia=p.j[1]),
            Link(name="slider", points={"C": o}, mass=p.m[2]),
        ),
        joints=(
            Revolute(name="O", links=("frame", "crank"), points=("O", "O")),
            Revolute(name="B", links=("crank", "rod"), points=("B", "B")),
            Revolute(name="C", links=("rod", "slider"), points=("C", "C")),
            Prismatic(name="S", links=("frame", "slider"), points=("G", "C")),
        ),
        drives=(Drive(joint="O", law=ConstantSpeed(0.0, p.speed)),),
        effects=("inertia", "gravity"),
        gravity=(0.0, -GRAVITY),
        loads=(Force(name="F", link="slider", point="C", vector=(p.force, 0.0)),),
        modes={"S": "ahead"},
    )
    compiled = compile_mechanism(mechanism, accuracy or DEFAULT, executor)

    def solve(angles):
        forces = solve_forces(solve_motion(compiled, angles / p.speed))
        result = {k: forces.reaction(k)[:, :2] for k in "OBC"}
        return {**result, "guide": forces.reaction("S")[:, 1], "torque": forces.effort("O")}

    return solve


ROWS = {
    "four-bar": {"mechviz": four_bar, "mechviz, compiled": partial(four_bar, executor="c")},
    "slider-crank": {"mechviz": slider_crank, "mechviz, compiled": partial(slider_crank, executor="c")},
}


def triad(stop):
    """The residual at which Newton's method stops is a setting: the group has no closed form."""
    from mechcore.accuracy import Accuracy
    from mechcore.laws.timed import ConstantSpeed
    from mechcore.motion.solve import compile_mechanism, solve_motion
    from mechcore.spec.mechanism import Drive, Link, Mechanism, Revolute

    p = TRIAD
    o = (0.0, 0.0)
    points = {
        "frame": {"O": o, "M": p.feet[0], "N": p.feet[1]},
        "crank": {"O": o, "B": (p.crank, 0.0)},
        "leg": {"B": o, "P": (p.legs[0], 0.0)},
        "plate": dict(zip("PQR", p.plate, strict=True)),
        "leg M": {"M": o, "Q": (p.legs[1], 0.0)},
        "leg N": {"N": o, "R": (p.legs[2], 0.0)},
    }
    ends = {"O": ("frame", "crank"), "B": ("crank", "leg"), "P": ("leg", "plate"), "Q": ("plate", "leg M")}
    ends |= {"R": ("plate", "leg N"), "M": ("frame", "leg M"), "N": ("frame", "leg N")}
    x, y, turn = p.start
    c, s = np.cos(turn), np.sin(turn)
    at = {n: (x + c * u - s * v, y + s * u + c * v) for n, (u, v) in zip("PQR", p.plate, strict=True)}
    rough = {"leg": ((p.crank, 0.0), at["P"]), "leg M": (p.feet[0], at["Q"]), "leg N": (p.feet[1], at["R"])}
    sketch = {k: (*a, float(np.arctan2(b[1] - a[1], b[0] - a[0]))) for k, (a, b) in rough.items()}
    mechanism = Mechanism(
        name="triad",
        frame="frame",
        links=tuple(Link(name=k, points=v) for k, v in points.items()),
        joints=tuple(Revolute(name=k, links=v, points=(k, k)) for k, v in ends.items()),
        drives=(Drive(joint="O", law=ConstantSpeed(0.0, p.speed)),),
        sketch={**sketch, "plate": p.start},
    )
    compiled = compile_mechanism(mechanism, Accuracy(position=stop))

    def solve(angles):
        motion = solve_motion(compiled, angles / p.speed)
        return {(k, 0): motion.point("plate", k) for k in "PQR"}

    return solve


def by_differences(build):
    """Rates by differences of the frames, of which only every so many is wanted."""
    from mechcore.accuracy import Accuracy

    def thinned(solve, each, turn):
        return {k: v[::each] for k, v in solve(angles(each * len(turn))).items()}

    ways = {k: build(Accuracy(differentiation="differences", differences=k)) for k in DIFFERENCES}
    jobs = {f"order {k}": solve for k, solve in ways.items()}
    return jobs | {f"order 6, {n} times as many frames": partial(thinned, ways[6], n) for n in (4, 16)}


def between_frames(order):
    """Frames of a turn joined by cubics or quintics, with the rates as slopes."""
    from mechcore.numerics.interpolation import between

    solve = four_bar()

    def joined(n, wanted):
        turn = np.linspace(0.0, 2.0 * np.pi, n + 1)
        result, time = solve(turn), turn / FOUR_BAR.speed
        rates = [np.concatenate([result[k, d] for k in "BCP"], axis=1) for d in range(3)]
        values = [between(time, rates[d], wanted / FOUR_BAR.speed, order, *rates[d + 1 :]) for d in range(3)]
        return {(k, d): values[d][:, 2 * i : 2 * i + 2] for i, k in enumerate("BCP") for d in range(3)}

    return {f"{n} frames": partial(joined, n) for n in FEW}


SETTINGS = {
    ("four-bar", "positions"): {"mechviz": lambda: {"as it is": four_bar(rates=(0,))}},
    ("four-bar", "rates"): {
        "mechviz": lambda: {"exact": four_bar()},
        "mechviz, rates by differences": partial(by_differences, four_bar),
    },
    ("four-bar", "any angle"): {
        "mechviz": lambda: {"computed there": four_bar()},
        "mechviz, cubics between frames": partial(between_frames, 3),
        "mechviz, quintics between frames": partial(between_frames, 5),
    },
    ("triad", "positions"): {
        "mechviz": lambda: {f"residual {stop:.0e}": triad(stop) for stop in (1e-2, 1e-4, 1e-6, 1e-9, 1e-12, 2e-15)}
    },
    ("slider-crank", "forces"): {
        "mechviz": lambda: {"exact": slider_crank()},
        "mechviz, rates by differences": partial(by_differences, slider_crank),
    },
    ("slider-crank", "any angle"): {"mechviz": lambda: {"computed there": slider_crank()}},
}
