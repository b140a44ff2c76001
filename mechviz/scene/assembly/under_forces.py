"""Motions under forces as a scene states them: the steady state of a machine, and the simulations with which the least rollers of
cams are sized."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from mechcore.arrays import Real
from mechcore.dynamics.rest.steady import SteadyRun, steady_run
from mechcore.dynamics.simulate import simulate
from mechcore.dynamics.simulation import Simulation
from mechcore.errors import Fault, MechanismError
from mechcore.forces.cam_rating import Solved
from mechcore.forces.kinetostatics import Forces
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled
from mechcore.motion.solve import compile_mechanism
from mechcore.spec.clearance import Clearance, with_clearances
from mechcore.spec.mechanism import CamJoint, Mechanism
from mechviz.scene.assembly.simulation import SimulationSpec

LANDINGS = ("impact", "regained")
FORCE_ERROR = 100.0  # error of forces, in tolerances of the motion


def steady_state(turns: int, compiled: Compiled) -> tuple[SteadyRun, Compiled]:
    """The steady run of a machine, and the machine with its speed at the start."""
    steady = steady_run(compiled, turns=turns)
    mechanism = compiled.mechanism
    (drive,) = mechanism.drives
    started = replace(mechanism, drives=(replace(drive, law=Free(steady.start, steady.speed)),))
    return steady, compile_mechanism(started, compiled.accuracy, compiled.executor)


def solver(spec: SimulationSpec, clearances: Mapping[str, Clearance]) -> Callable[[Mechanism], Solved]:
    """A function that simulates a mechanism with ``clearances`` under its forces, and gives its forces at any times of the run."""

    def solved(mechanism: Mechanism) -> Solved:
        compiled, duration = compile_mechanism(with_clearances(mechanism, clearances)), spec.duration
        if spec.steady is not None:
            steady, compiled = steady_state(spec.steady, compiled)
            duration = steady.period if np.isnan(duration) else duration
        run = simulate(
            compiled,
            duration,
            tolerance=spec.tolerance,
            method=spec.method,
            stops=spec.stops,
            triggers=spec.triggers,
            separable_cams=spec.separable_cams,
        )
        _refuse_landings(mechanism, run)

        def forces(times: Real) -> Forces:
            return run.forces(run.view(np.clip(times, 0.0, duration)))

        return Solved(duration, forces, FORCE_ERROR * spec.tolerance)

    return solved


def _refuse_landings(mechanism: Mechanism, run: Simulation) -> None:
    """Raises `MechanismError` where a follower whose least roller is to be found lands with an impact: no roller of any size bounds
    that contact force."""
    asked = {p.name for p in mechanism.joints if isinstance(p, CamJoint) and "roller" in p.least}
    landed = next((event for event in run.events if event.item in asked and event.kind in LANDINGS), None)
    if landed is not None:
        why = f"at {landed.time:.6g} s the follower lands on its cam with an impact: no roller bounds that pressure."
        remedy = "Give a length, or a spring that holds it; mechviz cams SCENE --size says which roller the other forces ask for."
        raise MechanismError(Fault(f"joints.{landed.item}.face", why, remedy))
