"""A whole mechanism reduced to one link or point: the mass there that has its kinetic energy, the force there that has its power.

Both are geometry: with q the drive's coordinate and ' = d/dq, J_q = sum m |S'|^2 + J_S theta'^2, and a link that turns by
theta(q) has J_red = J_q / theta'^2. Their derivatives are exact, from the second derivatives of the positions.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Real, Values
from mechcore.effects.base import Wrench, power_of
from mechcore.errors import Fault, MechanismError
from mechcore.motion.metrics import per_unit
from mechcore.motion.motion import Motion
from mechcore.records import dataclass


@dataclass(frozen=True, eq=False)
class Reduced:
    """A mechanism reduced to a link (``point`` None: to its angle) or to a point (to the way along its path).

    ``mass`` (F,): reduced moment of inertia [kg m^2] or mass [kg], infinite where link or point stand still while something moves.
    ``slope`` (F,): its derivative by the angle [kg m^2/rad] or by the way [kg/m]. ``force`` (F,): reduced moment [N m] or force
    [N] of all loads but inertia. ``energy`` (F,): kinetic energy [J]. ``rate`` (F,): angular velocity [rad/s] or speed [m/s],
    ``second`` (F,): its derivative by the time.
    """

    link: str
    point: str | None
    mass: Real
    slope: Real
    force: Real
    rate: Real
    second: Real

    @cached_property
    def energy(self) -> Real:
        """Kinetic energy of the mechanism (F,) [J]."""
        with np.errstate(invalid="ignore"):
            return 0.5 * self.mass * self.rate**2

    @cached_property
    def balancing(self) -> Real:
        """Torque or force that a drive at this link or point has to supply for the motion (F,) [N m or N]: J a + J' v^2 / 2 -
        reduced force."""
        with np.errstate(invalid="ignore"):
            return self.mass * self.second + 0.5 * self.slope * self.rate**2 - self.force


def reduce_mechanism(motion: Motion, link: str, point: str | None = None, loads: tuple[Wrench, ...] = ()) -> Reduced:
    """Reduce a mechanism with one drive to one of its links, or to a point of it.

    ``loads``: the wrenches that count, `Forces.applied` for instance (inertia is left out of the force: it is in the mass).
    """
    model = motion.model
    if len(model.mechanism.drives) != 1:
        n = len(model.mechanism.drives)
        why = f"the mechanism has {n} drives: its energy does not depend on one speed alone."
        raise MechanismError(Fault("reduced", why, "Reduce mechanisms with one drive."))
    if link not in model.index or (point is not None and point not in model.points[model.index[link]]):
        what = f"'{link}'" if point is None else f"'{link}.{point}'"
        raise MechanismError(Fault("reduced", f"there is no link or point {what}.", "Name a link, or link and point."))
    unit = per_unit(motion)
    first, second = _derivatives(unit)
    energy: Values = np.zeros(motion.frames)  # sum m |S'|^2 + J theta'^2 and its derivative by q
    bend: Values = np.zeros(motion.frames)
    for k, (mass, centre, inertia) in enumerate(model.masses):
        if k and (mass or inertia):
            d1, d2 = unit.of_point(k, centre, 1), unit.of_point(k, centre, 2)
            energy = energy + mass * np.abs(d1) ** 2 + inertia * first[k] ** 2
            bend = bend + 2.0 * mass * np.real(np.conj(d1) * d2) + 2.0 * inertia * first[k] * second[k]
    work: Values = np.zeros(motion.frames)
    for w in loads:
        if w.kind != "inertia":
            work = work + power_of(unit, w)  # of both links, where it acts between two
    k = model.index[link]
    if point is None:
        ratio, turn = first[k], second[k]
    else:
        local = model.points[k][point]
        p1, p2 = unit.of_point(k, local, 1), unit.of_point(k, local, 2)
        ratio = np.abs(p1)
        with np.errstate(invalid="ignore", divide="ignore"):
            turn = np.real(np.conj(p1) * p2) / ratio
    _, v, a = motion.drives[0]
    with np.errstate(invalid="ignore", divide="ignore"):
        mass_q = energy / ratio**2
        slope = (bend - 2.0 * energy * turn / ratio) / ratio**3
        force = work / ratio
    return Reduced(
        link=link,
        point=point,
        mass=_rows(motion, np.where(energy == 0.0, 0.0, mass_q)),
        slope=_rows(motion, np.where((energy == 0.0) & (bend == 0.0), 0.0, slope)),
        force=_rows(motion, np.where(work == 0.0, 0.0, force)),
        rate=_rows(motion, ratio * v),
        second=_rows(motion, ratio * a + turn * v**2),
    )


def _derivatives(unit: Motion) -> tuple[list[Values], list[Values]]:
    """Angles of all links, differentiated once and twice by the drive's coordinate."""
    classes = unit.model.angles.rotation_class
    links = range(len(unit.model.links))
    return [unit.speeds.angular[classes[k]] for k in links], [unit.accelerations.angular[classes[k]] for k in links]


def _rows(motion: Motion, values: ArrayLike) -> Real:
    return np.ascontiguousarray(np.broadcast_to(np.asarray(values, float), (motion.frames,)))
