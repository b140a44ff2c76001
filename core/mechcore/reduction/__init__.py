"""Reduction: of force systems, of inertia forces, of bodies to point masses, of mechanisms to one link, of shaking to the frame."""

from mechcore.reduction.areas import Area, area_of, circle, plate, stadium
from mechcore.reduction.bodies import (
    SOLIDS,
    Body,
    acceleration_field,
    combine,
    inertia_of_points,
    inertia_wrench,
    percussion_centre,
    single_resultant,
    solid,
)
from mechcore.reduction.reduced import Reduced, reduce_mechanism
from mechcore.reduction.shaking import Shaking, shaking
from mechcore.reduction.substitute import (
    PointMass,
    StaticReplacement,
    Substitution,
    static_replacement,
    substitute_masses,
)
from mechcore.reduction.systems import Resultant, moment_about, reduce_to, resultant

__all__ = [
    "SOLIDS",
    "Area",
    "Body",
    "PointMass",
    "Reduced",
    "Resultant",
    "Shaking",
    "StaticReplacement",
    "Substitution",
    "acceleration_field",
    "area_of",
    "circle",
    "combine",
    "inertia_of_points",
    "inertia_wrench",
    "moment_about",
    "percussion_centre",
    "plate",
    "reduce_mechanism",
    "reduce_to",
    "resultant",
    "shaking",
    "single_resultant",
    "solid",
    "stadium",
    "static_replacement",
    "substitute_masses",
]
