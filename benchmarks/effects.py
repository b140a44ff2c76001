"""The price of effects: kinematics alone, a scene that names none, and each effect by itself, as ratios to kinematics.

    python benchmarks/effects.py [frames]

Nothing is compiled or planned in the jobs: each solves the motion with accelerations, and the forces where the plan calls for them.
Least processor times of 25 turns. The price of the reactions, which any effect brings along, is that of a mere constant force.
"""

from __future__ import annotations

from timing import interleaved, machine  # first: it sets one thread

import sys  # isort: skip
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import mechviz
from mechcore import Compiled, compile_mechanism, default_times, solve_forces, solve_motion
from mechcore.plan import make_plan
from mechcore.spec import (
    Damper,
    Drag,
    Factor,
    Force,
    GasSpring,
    Load,
    Polynomial,
    Spring,
    Torque,
    TorsionDamper,
    TorsionSpring,
    Viscous,
)

FRAMES = int(sys.argv[1]) if len(sys.argv) > 1 else 360
ENGINE = mechviz.load("four-stroke-cycle").mechanism
BARE = replace(ENGINE, loads=(), effects=())
CONSTANT = Force(name="constant", link="piston", point="C", vector=(0.0, -100.0))
BETWEEN = {"links": ("rod", "frame"), "points": ("C", "A")}
LOADS: dict[str, Load] = {
    "force": CONSTANT,
    "force by a polynomial of time": replace(CONSTANT, factor=Factor(function=Polynomial((1.0, 2.0)), of="time")),
    "torque": Torque(name="torque", link="crank", moment=1.0),
    "spring": Spring(name="spring", **BETWEEN, stiffness=1e3, free_length=0.1),
    "damper": Damper(name="damper", **BETWEEN, linear=10.0),
    "gas spring": GasSpring(name="gas spring", **BETWEEN, force=100.0, extended=0.3, gas_length=0.4, exponent=1.2),
    "torsion spring": TorsionSpring(name="torsion spring", links=("frame", "crank"), stiffness=1.0),
    "torsion damper": TorsionDamper(name="torsion damper", links=("frame", "crank"), coefficient=1.0),
    "drag of a point": Drag(name="drag", link="rod", point="C", linear=1.0, quadratic=1.0),
    "drag of a link": Drag(name="drag", link="crank", linear=1.0, quadratic=1.0),
    "viscous friction, revolute": Viscous(name="viscous", pair="A", coefficient=1.0),
    "viscous friction, sliding": Viscous(name="viscous", pair="S", coefficient=1.0),
    "gas pressure, four strokes": next(load for load in ENGINE.loads if load.name == "gas"),
}


def kinematics(compiled: Compiled, times: object) -> object:
    motion = solve_motion(compiled, times)
    return motion, motion.origins, motion.origin_velocities, motion.origin_accelerations


def by_plan(compiled: Compiled, times: object) -> Callable[[], object]:
    """What a run does: the plan, made once as the mechanism is compiled once, decides."""
    plan = make_plan(compiled.mechanism, ("positions", "velocities", "accelerations", "forces"))

    def run() -> object:
        motion, *_ = kinematics(compiled, times)
        return solve_forces(motion) if plan.has("reactions and drive efforts") else motion

    return run


def main() -> None:
    times = default_times(BARE, FRAMES, 2)
    jobs: dict[str, Callable[[], object]] = {
        "kinematics alone": partial(kinematics, compile_mechanism(BARE), times),
        "a scene without effects, by its plan": by_plan(compile_mechanism(BARE), times),
    }
    for name, load in LOADS.items():
        jobs[name] = by_plan(compile_mechanism(replace(BARE, loads=(load,))), times)
    for name in ("gravity", "inertia"):
        jobs[name] = by_plan(compile_mechanism(replace(BARE, effects=(name,))), times)
    jobs["the whole engine"] = by_plan(compile_mechanism(ENGINE), times)
    found = interleaved(jobs, runs=25, seconds=0.02, pick=min, clock=time.process_time)
    base, force = found["kinematics alone"], found["force"]
    print(machine("numpy"))
    print(f"slider-crank, {len(times)} frames: kinematics alone takes {1e3 * base:.3f} ms")
    print(f"{'':38}  {'time / kinematics':>17}  {'beyond a constant force / kinematics':>36}")
    for name, seconds in found.items():
        extra = "" if name in ("kinematics alone", "a scene without effects, by its plan") else f"{(seconds - force) / base:>36.2f}"
        print(f"{name:38}  {seconds / base:>17.2f}  {extra}")


if __name__ == "__main__":
    main()
