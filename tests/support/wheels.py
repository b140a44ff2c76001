"""Wheels on carriers, and what must hold of every solution of them."""

from __future__ import annotations

import numpy as np
from random_linkages import balance_of_links

from mechcore.spec.mechanism import Link

THETA = np.linspace(0.1, 6.0, 25)


def wheel(name: str, *, mass: float = 1.0, inertia: float = 0.2, centre=(0.0, 0.0), **points) -> Link:
    return Link(name=name, points={"c": (0.0, 0.0), **points}, mass=mass, inertia=inertia, centre=centre)


def sound(forces, tolerance: float = 1e-10) -> None:
    """Balance of every link, power, and closure."""
    assert forces.motion.closure.max() < 1e-12 * forces.motion.model.length_scale
    assert np.abs(forces.power_balance).max() < tolerance
    assert balance_of_links(forces) < tolerance
