"""Graphical constructions from the solver's own numbers: velocity, acceleration and force plans, funicular polygon, polodes,
equivalent linkages."""

from .equivalents import REPLACED, Block, Equivalent, equivalent
from .force_plan import force_plans
from .funicular import Funicular, funicular
from .motion_plans import acceleration_plan, velocity_plan
from .plans import Edge, Plan
from .polodes import Polodes, polodes

__all__ = [
    "REPLACED",
    "Block",
    "Edge",
    "Equivalent",
    "Funicular",
    "Plan",
    "Polodes",
    "acceleration_plan",
    "equivalent",
    "force_plans",
    "funicular",
    "polodes",
    "velocity_plan",
]
