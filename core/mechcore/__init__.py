"""The kinematic and kinetostatic core of mechviz: numpy and scipy only, no I/O, no pictures.

compiled = compile_mechanism(mechanism)
motion = solve_motion(compiled, default_times(mechanism))
forces = solve_forces(motion)
"""

from mechcore.errors import Fault, MechanismError
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion

__all__ = [
    "Compiled",
    "Fault",
    "Forces",
    "MechanismError",
    "Motion",
    "compile_mechanism",
    "default_times",
    "solve_forces",
    "solve_motion",
]
