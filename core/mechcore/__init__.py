"""The kinematic and kinetostatic core of mechviz: numpy and scipy only, no I/O, no pictures.

compiled = compile_mechanism(mechanism)
motion = solve_motion(compiled, default_times(mechanism))
forces = solve_forces(motion)
simulation = simulate(mechanism, duration)      # where forces decide the motion
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mechcore.errors import Fault, MechanismError
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion

if TYPE_CHECKING:
    from mechcore.dynamics.simulate import simulate
    from mechcore.dynamics.simulation import Simulation


def __getattr__(name: str) -> Any:
    """``Simulation`` and ``simulate``, which are imported on first use."""
    module = {"Simulation": "simulation", "simulate": "simulate"}.get(name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"mechcore.dynamics.{module}"), name)


__all__ = [
    "Compiled",
    "Fault",
    "Forces",
    "MechanismError",
    "Motion",
    "Simulation",
    "compile_mechanism",
    "default_times",
    "simulate",
    "solve_forces",
    "solve_motion",
]
