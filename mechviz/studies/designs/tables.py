"""Tables of the catalogue from motion and forces alone: of many designs side by side, and of traced motions."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from mechcore.arrays import Real
from mechcore.forces.kinetostatics import Forces
from mechcore.motion.metrics import mechanical_advantage, transmission_angles, velocity_ratios
from mechcore.motion.motion import Motion
from mechviz.quantities.vectors import centre_name, point_name


def needs_forces(path: tuple[str, ...]) -> bool:
    """Whether a table holds what forces decide."""
    return path[1] == "drive" or path[-1] in ("reaction", "inertia")


def rows_of(path: tuple[str, ...], motion: Motion, forces: Forces | None) -> Real:
    """The values (D, F, n) of a table of the catalogue, or (F, n) of a single design. Raises `LookupError` where it is none of
    those that can be had so."""
    match path[1:]:
        case ("links", link, "pose"):
            return motion.pose(link)
        case ("links", link, "velocity"):
            return motion.velocity(link)
        case ("links", link, "acceleration"):
            return motion.acceleration(link)
        case ("links", link, "inertia") if forces is not None:
            return forces.inertia(link)
        case ("points", name, what) if what in ("position", "velocity", "acceleration"):
            order = ("position", "velocity", "acceleration").index(what)
            for key in motion.mechanism.traced:
                if point_name(*key) == name:
                    return motion.point(*key, order)
            link = next(link for link in motion.model.links if centre_name(link) == name)
            return motion.centre_of_mass(link, order)
        case ("joints", joint, "motion"):
            return motion.coordinate(joint)
        case ("joints", joint, "reaction") if forces is not None:
            return forces.reaction(joint)
        case ("drive", joint) if forces is not None:
            coordinate = motion.coordinate(joint)
            columns = [coordinate[..., k] for k in range(3)] + [forces.effort(joint), forces.power(joint)]
            return np.stack([np.broadcast_to(x, motion.shape) for x in columns], axis=-1)
        case ("answers", name, item) if name in ANSWERS:
            return ANSWERS[name](motion)[item][..., None]
    raise LookupError("/".join(path))


ANSWERS: dict[str, Callable[[Motion], Mapping[str, Real]]] = {
    "transmission_angle": transmission_angles,
    "velocity_ratio": velocity_ratios,
    "mechanical_advantage": mechanical_advantage,
}
