"""mechviz: the general code. The mechanism is compiled once; times in, arrays by name out."""

from __future__ import annotations

from problem import FOUR_BAR, GRAVITY, SLIDER_CRANK

PACKAGES = ("numpy==2.4.6", "scipy==1.17.1", "mpmath==1.3.0")  # what mechcore and the reference values need


def four_bar():
    from mechcore import compile_mechanism, solve_motion
    from mechcore.laws import ConstantSpeed
    from mechcore.spec import Drive, Link, Mechanism, Revolute

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
        pairs=tuple(Revolute(name=k, links=v, points=(k, k)) for k, v in ends.items()),
        drives=(Drive(pair="A", law=ConstantSpeed(0.0, p.speed)),),
        modes={"C": "left"},
    )
    compiled = compile_mechanism(mechanism)
    wanted = {"B": "crank", "C": "rocker", "P": "coupler"}

    def solve(angles):
        motion = solve_motion(compiled, angles / p.speed)
        return {(k, d): motion.point(link, k, d) for k, link in wanted.items() for d in range(3)}

    return solve


def slider_crank():
    from mechcore import compile_mechanism, solve_forces, solve_motion
    from mechcore.laws import ConstantSpeed
    from mechcore.spec import Drive, Force, Link, Mechanism, Prismatic, Revolute

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
        pairs=(
            Revolute(name="O", links=("frame", "crank"), points=("O", "O")),
            Revolute(name="B", links=("crank", "rod"), points=("B", "B")),
            Revolute(name="C", links=("rod", "slider"), points=("C", "C")),
            Prismatic(name="S", links=("frame", "slider"), points=("G", "C")),
        ),
        drives=(Drive(pair="O", law=ConstantSpeed(0.0, p.speed)),),
        effects=("inertia", "gravity"),
        gravity=(0.0, -GRAVITY),
        loads=(Force(name="F", link="slider", point="C", vector=(p.force, 0.0)),),
        modes={"S": "ahead"},
    )
    compiled = compile_mechanism(mechanism)

    def solve(angles):
        forces = solve_forces(solve_motion(compiled, angles / p.speed))
        found = {k: forces.reaction(k)[:, :2] for k in "OBC"}
        return {**found, "guide": forces.reaction("S")[:, 1], "torque": forces.effort("O")}

    return solve


ROWS = {"four-bar": {"mechviz": four_bar}, "slider-crank": {"mechviz": slider_crank}}
