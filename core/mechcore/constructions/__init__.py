"""Graphical constructions from the solver's own numbers: velocity, acceleration and force plans, funicular polygon, polodes,
equivalent linkages."""

from mechcore.constructions.centrodes import Polodes, polodes
from mechcore.constructions.equivalents import REPLACED, Block, Equivalent, equivalent
from mechcore.constructions.force_polygon import force_plans
from mechcore.constructions.funicular import Funicular, funicular
from mechcore.constructions.motion_polygons import acceleration_plan, velocity_plan
from mechcore.constructions.polygons import Edge, Plan

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
