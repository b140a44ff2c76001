"""Mass, reference point and moment of inertia of every moving link: what a reader needs to check its balance."""

from __future__ import annotations

import cmath
from typing import TYPE_CHECKING

from ..tables import links_of, links_with_mass

if TYPE_CHECKING:
    from mechcore.model import Model

    from ..run import Run

__all__ = ["link_properties", "reference_point"]

OBLIQUE = cmath.exp(1j)
"""Direction of the reference point, seen from the line of the joints: at right angles neither to it nor to what crosses it."""


def link_properties(run: Run) -> dict[str, tuple[float, float, float, float]]:
    """Mass [kg], reference point x, y in the link frame [m] and moment of inertia about it [kg m^2] of every moving link.

    The reference point is the centre of mass. A link whose mass does not count (0, or neither inertia nor gravity is named) has
    none, and a balance of moments may be taken about any point. About one on the line of its joints it would be nothing but
    rounding where the link only passes a force on along that line, as a rod or a cylinder does: the point lies beside it, so
    that the balance is a small sum of large terms.
    """
    model = run.motion.model
    heavy = set(links_with_mass(run))
    found = {}
    for name in links_of(run.motion)[1:]:
        k = model.index[name]
        mass, centre, inertia = model.masses[k]
        if name not in heavy:
            mass, centre, inertia = 0.0, reference_point(model, k), 0.0
        found[name] = (mass, centre.real, centre.imag, inertia)
    return found


def reference_point(model: Model, k: int) -> complex:
    """A point in the axes of link ``k`` beside the line of its joints, about as far from them as the link is long [m].

    Where all joints are at one place: beside its guide, as far as the mechanism is large.
    """
    own = [(j, 0 if p == k else 1) for j, (p, q) in enumerate(model.ends) if k in (p, q)]
    at = [model.joints[j].b if side else model.joints[j].a for j, side in own]
    way = max((b - a for a in at for b in at), key=abs)
    if abs(way) <= 1e-9 * model.size:
        guides = [model.joints[j].slide for j, side in own if model.joints[j].guide == side]
        direction = next((d for d in guides if d is not None), 1 + 0j)
        way = model.size * direction / abs(direction)
    return sum(at) / len(at) + way * OBLIQUE
