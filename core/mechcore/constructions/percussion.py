"""Centre of percussion of a link and the line of its inertia resultant, with the lecture's construction of that line.

With a pivot B the inertia forces fall into two: -m a_B through the centre of mass S, as of a translation with B, and -m a_SB
through the centre of percussion W on the line BS, as of a rotation about B, inertia moment included. The resultant goes through
the point T where the two lines meet; about a fixed pivot T is W.
"""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.constants import ZERO_SUM
from mechcore.constructions.polygons import frames_of
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.dyads import cross
from mechcore.motion.motion import Motion
from mechcore.records import dataclass
from mechcore.reduction.bodies import percussion_centre


@dataclass(frozen=True, eq=False)
class Percussion:
    """Places (F,) [m] of ``pivot`` B, ``mass_centre`` S and ``centre`` of percussion W; the inertia ``force`` (F,) [N] of the link
    as a single force through ``through`` (F,), the point of its line nearest to W, NaN where there is a couple or nothing.

    ``carried``: -m a_B (F,) [N] through S; ``turned``: -m a_SB (F,) [N] through W; ``meeting`` T (F,), NaN where they are parallel.
    """

    link: str
    point: str
    pivot: Complex
    mass_centre: Complex
    centre: Complex
    force: Complex
    moment: Real
    through: Complex
    carried: Complex
    turned: Complex
    meeting: Complex


def percussion(motion: Motion, link: str, point: str) -> Percussion:
    """Centre of percussion of a link that turns about a named point of its own, and its inertia resultant (moment about S [N m]).

    Raises `MechanismError` where the link has no mass, or its centre of mass is the pivot.
    """
    model, n = motion.model, motion.frames
    k = model.index[link]
    mass, centre, inertia = model.masses[k]
    pivot = model.points[k][point]
    if mass <= 0.0:
        raise MechanismError(Fault("percussion", f"link '{link}' has no mass.", f"Give links.{link} a mass."))
    if abs(centre - pivot) <= ZERO_SUM * model.length_scale:
        why = f"'{point}' is the centre of mass of '{link}': the inertia forces of a turn about it are a couple without a line."
        raise MechanismError(Fault("percussion", why, "Name another point of the link."))
    w = complex(*percussion_centre(mass, inertia, (centre.real, centre.imag), (pivot.real, pivot.imag)))
    b, s, struck = (frames_of(motion.of_point(k, z), n) for z in (pivot, centre, w))
    a_b, a_s = (frames_of(motion.of_point(k, z, 2), n) for z in (pivot, centre))
    alpha = np.real(frames_of(motion.accelerations.angular[model.angles.rotation_class[k]], n))
    force, moment = -mass * a_s, -inertia * alpha
    carried, turned = -mass * a_b, -mass * (a_s - a_b)
    sizes = np.abs(carried) + np.abs(turned)
    none = sizes <= ZERO_SUM * float(np.nanmax(sizes, initial=0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        about = moment + cross(s - struck, force)
        through = struck - 1j * force * about / np.where(np.abs(force) > ZERO_SUM * sizes, np.abs(force), np.nan) ** 2
        along = cross(struck - s, turned) / cross(carried, turned)
        still = np.abs(carried) <= 1e3 * ZERO_SUM * sizes
        meeting = np.where(still, struck, s + along * carried)
    through[none] = np.nan
    return Percussion(
        link, point, b, s, struck, force, moment, through, carried, turned, np.where(np.isfinite(meeting), meeting, np.nan)
    )
