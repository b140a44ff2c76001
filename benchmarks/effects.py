"""The price of effects: kinematics alone, a scene that names none, and each effect by itself, as ratios to kinematics.

    python benchmarks/effects.py [frames]

Nothing is compiled or planned in the jobs: each solves the motion with accelerations, and the forces where the plan calls for them.
Least processor times of 25 turns. The price of the reactions, which any effect brings along, is that of a mere constant force.
Every effect and load of the registry (`mechcore.effects.registry`) is here, or it refuses to run.
"""

from __future__ import annotations

from timing import interleaved, machine  # first: it sets one thread

import argparse  # isort: skip
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import mechviz
from mechcore.effects.plan import StageKind, make_plan
from mechcore.effects.registry import EFFECTS
from mechcore.effects.registry import LOADS as REGISTRY
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.indicator import Compressor
from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.compiled import Compiled
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.clearance import Clearance, with_clearances
from mechcore.spec.loads import (
    Actuator,
    BeltTension,
    Bushing,
    BushingDamper,
    ConstantPower,
    Damper,
    DcMotor,
    Drag,
    Factor,
    Force,
    GasPressure,
    GasSpring,
    Governor,
    InductionMotor,
    JournalContact,
    JournalLoss,
    Load,
    Polynomial,
    Servo,
    Spring,
    Torque,
    TorsionDamper,
    TorsionSpring,
    Viscous,
)
from mechcore.spec.mechanism import Friction, Mechanism, Prismatic, Revolute

ENGINE = mechviz.load("four-stroke-cycle").mechanism
BARE = replace(ENGINE, loads=(), effects=())
BELT = replace(mechviz.load("belt-drive").mechanism, loads=(), effects=())
PRESSED = Clearance(radial=1e-4, stiffness=1e6, loss=1.0, friction=0.1, radius=0.01, start=(1.1e-4, 0.0))
LOOSE = with_clearances(BARE, {"B": PRESSED})  # its journal rests in its bearing while the crank turns
CONSTANT = Force(name="constant", link="piston", point="C", vector=(0.0, -100.0))
BETWEEN = {"links": ("rod", "frame"), "points": ("C", "A")}
CYCLE = Compressor(stroke=0.08, suction=1e5, delivery=6e5)
LOADS: dict[str, Load] = {
    "force": CONSTANT,
    "force by a polynomial of time": replace(CONSTANT, factor=Factor(function=Polynomial((1.0, 2.0)), of="time")),
    "torque": Torque(name="torque", link="crank", moment=1.0),
    "spring": Spring(name="spring", **BETWEEN, stiffness=1e3, free_length=0.1),
    "actuator": Actuator(name="actuator", **BETWEEN, force=10.0),
    "bushing": Bushing(name="bushing", **BETWEEN, stiffness=(1e3, 1e3, 1.0)),
    "dampers of a bushing": BushingDamper(name="bushing", **BETWEEN, damping=(10.0, 10.0, 1.0)),
    "damper": Damper(name="damper", **BETWEEN, linear=10.0),
    "gas spring": GasSpring(name="gas spring", **BETWEEN, force=100.0, extended=0.3, gas_length=0.4, exponent=1.2),
    "torsion spring": TorsionSpring(name="torsion spring", links=("frame", "crank"), stiffness=1.0),
    "torsion damper": TorsionDamper(name="torsion damper", links=("frame", "crank"), coefficient=1.0),
    "drag of a point": Drag(name="drag", link="rod", point="C", linear=1.0, quadratic=1.0),
    "drag of a link": Drag(name="drag", link="crank", linear=1.0, quadratic=1.0),
    "viscous friction, revolute": Viscous(name="viscous", joint="A", coefficient=1.0),
    "viscous friction, sliding": Viscous(name="viscous", joint="S", coefficient=1.0),
    "gas pressure, compressor": GasPressure(name="gas", joint="S", area=5e-3, cycle=CYCLE, top=0.18),
    "gas pressure, four strokes": next(load for load in ENGINE.loads if load.name == "gas"),
    "DC motor": DcMotor(name="motor", link="crank", stall_torque=50.0, no_load_speed=170.0),
    "induction motor": InductionMotor(name="motor", joint="A", breakdown_torque=50.0, breakdown_slip=0.2, synchronous_speed=160.0),
    "machine of constant power": ConstantPower(name="motor", link="crank", power=2e3, torque_limit=50.0),
    "servo": Servo(name="servo", joint="A", target=ConstantSpeed(0.0, 160.0), proportional=10.0, derivative=1.0),
    "governor": Governor(name="governor", link="crank", set_speed=160.0, gain=1.0, least=0.0, most=50.0),
}
ON_BELT: dict[str, Load] = {
    "torque": Torque(name="torque", link="drum", moment=-1.0),
    "belt tension": BeltTension(name="tension", joint="V", slack=100.0, coefficient=0.3),
    "viscous friction, belt": Viscous(name="viscous", joint="V", coefficient=1.0),
}


ON_JOURNAL: dict[str, Load] = {
    "torque": LOADS["torque"],
    "contact of a loose pin": next(load for load in LOOSE.loads if type(load) is JournalContact),
    "losses of a loose pin": next(load for load in LOOSE.loads if type(load) is JournalLoss),
}


def rough(mechanism: Mechanism) -> Mechanism:
    """With dry friction in every joint."""
    pins = {
        p.name: replace(p, friction=Friction(coefficient=0.1, radius=0.01)) for p in mechanism.joints if isinstance(p, Revolute)
    }
    guides = {
        p.name: replace(p, friction=Friction(coefficient=0.1, length=0.05)) for p in mechanism.joints if isinstance(p, Prismatic)
    }
    return replace(mechanism, joints=tuple({**pins, **guides}.get(p.name, p) for p in mechanism.joints))


def cases() -> dict[str, dict[str, Mechanism]]:
    """Mechanisms by what is computed, by the mechanism that they are; the first two of each are without forces. Raises `ValueError`
    where an effect or load of the registry has no case."""
    engine = {name: replace(BARE, loads=(load,)) for name, load in LOADS.items()}
    engine |= {name: replace(BARE, effects=(name,)) for name in ("gravity", "inertia")}
    engine["constant force and dry friction in all joints"] = rough(replace(BARE, loads=(CONSTANT,), effects=("friction",)))
    engine["the whole engine"] = ENGINE
    belt = {name: replace(BELT, loads=(load,)) for name, load in ON_BELT.items()}
    loose = {name: replace(LOOSE, loads=(load,)) for name, load in ON_JOURNAL.items()}
    made = [*engine.values(), *belt.values(), *loose.values()]
    missing = set(REGISTRY) - {type(load) for m in made for load in m.loads}
    names = set(EFFECTS) - {name for m in made for name in m.effects}
    if missing or names:
        raise ValueError(f"no case for {', '.join(sorted({*names, *(kind.__name__ for kind in missing)}))}")
    return {
        "slider-crank": {"bare": BARE, **engine},
        "belt drive": {"bare": BELT, **belt},
        "loose pin": {"bare": replace(LOOSE, loads=()), **loose},
    }


def kinematics(compiled: Compiled, times: object) -> object:
    motion = solve_motion(compiled, times)
    return motion, motion.origins, motion.origin_velocities, motion.origin_accelerations


def by_plan(compiled: Compiled, times: object) -> Callable[[], object]:
    """What a run does: the plan, made once as the mechanism is compiled once, decides."""
    plan = make_plan(compiled.mechanism, ("positions", "velocities", "accelerations", "forces"))

    def run() -> object:
        motion, *_ = kinematics(compiled, times)
        return solve_forces(motion) if plan.has(StageKind.FORCES) else motion

    return run


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("frames", nargs="?", type=int, default=360, help="of a run [default: %(default)s]")
    wanted = parser.parse_args().frames
    jobs: dict[str, Callable[[], object]] = {}
    frames = 0
    for what, result in cases().items():
        times = default_times(result["bare"], wanted, 2)
        frames = len(times)
        jobs[f"{what}: kinematics alone"] = partial(kinematics, compile_mechanism(result["bare"]), times)
        for name, mechanism in result.items():
            words = "a scene without effects, by its plan" if name == "bare" else name
            jobs[f"{what}: {words}"] = by_plan(compile_mechanism(mechanism), times)
    seconds = interleaved(jobs, runs=25, seconds=0.02, pick=min, clock=time.process_time)
    print(machine("numpy"))
    for what in cases():
        own = {name.removeprefix(f"{what}: "): t for name, t in seconds.items() if name.startswith(f"{what}: ")}
        base, force = own["kinematics alone"], own["force" if "force" in own else "torque"]
        print(f"{what}, {frames} frames: kinematics alone takes {1e3 * base:.3f} ms")
        print(f"{'':44}  {'time / kinematics':>17}  {'beyond a constant load / kinematics':>36}")
        for k, (name, t) in enumerate(own.items()):
            extra = "" if k < 2 else f"{(t - force) / base:>36.2f}"
            print(f"{name:44}  {t / base:>17.2f}  {extra}")


if __name__ == "__main__":
    main()
