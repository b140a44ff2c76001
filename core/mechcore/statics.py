"""What forces need of a model, looked up once: weights, bodies with mass, and which links decide the forces in the cuts."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import TYPE_CHECKING, NamedTuple

from .terms import Terms, scaled

if TYPE_CHECKING:
    from .model import Model

__all__ = ["Body", "Hanging", "bodies_with_mass", "hanging", "hung", "weights"]


Arm = tuple[int, int, int]  # link, joint, side
Hanging = tuple[tuple[int, int, Arm | None, Arm | None], ...]
"""Links inwards, each with the link that it hangs on, and the arms at which its force acts on it and on that link; None where the
moment is not asked for, or the force acts at the link's origin."""


class Body(NamedTuple):
    """A moving link with inertia. ``opposed``: -mass times the place of its centre as a sum, None where that is too long."""

    link: int
    mass: float  # [kg]
    centre: complex  # of mass, in link axes [m]
    inertia: float  # about the centre [kg m^2]
    spin: int
    opposed: Terms | None


def weights(model: Model) -> tuple[tuple[int, complex, complex], ...]:
    """(link, weight [N], centre of mass in link axes [m]) of every moving link that has a weight."""
    found = []
    for k, (mass, centre, _) in enumerate(model.masses):
        own = model.bodies[model.links[k]].gravity
        if k and mass:
            found.append((k, mass * complex(*(model.mechanism.gravity if own is None else own)), centre))
    return tuple(found)


def bodies_with_mass(model: Model) -> tuple[Body, ...]:
    """The moving links that have a mass or a moment of inertia."""
    return tuple(
        Body(k, mass, centre, inertia, model.angles.spin[k], scaled(model.terms(k, centre), -mass))
        for k, (mass, centre, inertia) in enumerate(model.masses)
        if k and (mass or inertia)
    )


def hanging(model: Model, wanted: Container[int], order: Sequence[int]) -> Hanging:
    """Which forces hang where: over the links of ``order``, the moments on the links ``wanted``."""

    def arm(k: int, j: int, side: int) -> Arm | None:
        joint = model.joints[j]
        at = joint.b if side else joint.a
        still = isinstance(at, complex) and at == 0 and (joint.slide is None or joint.guide != side)
        return None if still or k not in wanted else (k, j, side)

    steps = ((k, *model.steps[k]) for k in order)
    return tuple((k, p, arm(k, j, side), arm(p, j, 1 - side) if p else None) for k, j, side, p in steps)


def hung(model: Model) -> tuple[int, ...]:
    """Links, inwards, whose hanging force decides the forces in the cuts; that of the others only passes to the frame."""
    parent = model.tree.parent
    needed = {model.child[j] for b in model.blocks for j in b.slides if j in model.child}
    needed |= {k for k in model.tree.order if k in model.grouped or parent[k] in model.grouped}
    for k in model.tree.order:  # parents first: all that hangs on a link that is needed is needed too
        if parent[k] in needed:
            needed.add(k)
    return tuple(k for k in model.inwards if k in needed)
