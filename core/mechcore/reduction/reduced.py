"""Plane force systems reduced to a point, and to the simplest equivalent system (a force, a couple, equilibrium); and a whole
mechanism reduced to one link or point: the mass there with the same kinetic energy, the force there with the same power.

Arrays of force systems may have leading axes, such as frames: points and forces (..., n, 2), couples (..., n). The reduction of a
mechanism is geometry: with q the drive's coordinate and ' = d/dq, J_q = sum m |S'|^2 + J_S theta'^2, and a link that turns by
theta(q) has J_red = J_q / theta'^2. Derivatives are exact, from the second derivatives of the positions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechcore.arrays import Real, Values
from mechcore.constants import ZERO_SUM
from mechcore.effects.base import Wrench, power_of
from mechcore.errors import Fault, MechanismError
from mechcore.laws.timed import moves
from mechcore.motion.metrics import per_unit_drive_speed
from mechcore.motion.motion import Motion
from mechcore.records import dataclass


@dataclass(frozen=True, eq=False)
class Reduced:
    """A mechanism reduced to a link (``point`` None: to its angle) or to a point (to the arc length of its path).

    ``mass`` (F,): reduced moment of inertia [kg m^2] or mass [kg], infinite where link or point stand still while something moves.
    ``slope`` (F,): its derivative by the angle [kg m^2/rad] or by the arc length [kg/m], NaN there. ``force`` (F,): reduced moment
    [N m] or force [N] of all loads but inertia; where link or point stand still infinite, or NaN if the loads have no power there
    either. ``energy`` (F,): kinetic energy [J]. ``rate`` (F,): angular velocity [rad/s] or speed [m/s], ``second`` (F,): its
    derivative by time.
    """

    link: str
    point: str | None
    mass: Real
    slope: Real
    force: Real
    energy: Real
    rate: Real
    second: Real


def reduce_mechanism(motion: Motion, link: str, point: str | None = None, loads: tuple[Wrench, ...] = ()) -> Reduced:
    """Reduce a mechanism that one drive moves to one of its links, or to a point of it.

    ``loads``: the wrenches that count, `Forces.applied` for instance (inertia is left out of the force: it is in the mass).
    """
    model = motion.model
    drives = model.mechanism.drives
    moving = [i for i, d in enumerate(drives) if moves(d.law)]
    if len(moving) > 1 or not (moving or len(drives) == 1):
        why = f"the mechanism has {len(moving) or len(drives)} drives: its energy does not depend on one speed alone."
        raise MechanismError(Fault("reduced", why, "Reduce mechanisms that one drive moves."))
    lead = moving[0] if moving else 0
    if link not in model.index or (point is not None and point not in model.points[model.index[link]]):
        what = f"'{link}'" if point is None else f"'{link}.{point}'"
        raise MechanismError(Fault("reduced", f"there is no link or point {what}.", "Name a link, or link and point."))
    unit = per_unit_drive_speed(motion, lead)
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
            work = work + power_of(unit, w)  # on both links, where it acts between two
    k = model.index[link]
    if point is None:
        ratio, turn = first[k], second[k]
    else:
        local = model.points[k][point]
        p1, p2 = unit.of_point(k, local, 1), unit.of_point(k, local, 2)
        ratio = np.abs(p1)
        with np.errstate(invalid="ignore", divide="ignore"):
            turn = np.real(np.conj(p1) * p2) / ratio
    _, v, a = motion.drives[lead]
    size = model.length_scale
    fastest = sum(np.abs(first[i]) + np.abs(unit.origin(i, 1)) / size for i in range(1, len(model.links)))
    still = np.abs(ratio) <= ZERO_SUM * (1.0 if point is None else size) * fastest
    if np.all(still):
        raise MechanismError(_never_moves(motion, link, point))
    with np.errstate(invalid="ignore", divide="ignore"):
        mass_q = np.where(still, np.inf, energy / ratio**2)
        slope = np.where(still, np.nan, (bend - 2.0 * energy * turn / ratio) / ratio**3)
        unbounded = np.where(np.abs(work) > ZERO_SUM * np.abs(work).max(initial=0.0), np.copysign(np.inf, work), np.nan)
        force = np.where(still, unbounded, work / ratio)
    return Reduced(
        link=link,
        point=point,
        mass=_rows(motion, np.where(energy == 0.0, 0.0, mass_q)),
        slope=_rows(motion, np.where((energy == 0.0) & (bend == 0.0), 0.0, slope)),
        force=_rows(motion, np.where(np.any(work), force, 0.0)),
        energy=_rows(motion, 0.5 * energy * v**2),
        rate=_rows(motion, ratio * v),
        second=_rows(motion, ratio * a + turn * v**2),
    )


def _never_moves(motion: Motion, link: str, point: str | None) -> Fault:
    model = motion.model
    if point is not None:
        return Fault("reduced", f"'{link}.{point}' never moves: no mass there has a kinetic energy.", "Name a point that moves.")
    names = [f"'{link}.{name}'" for name in model.points[model.index[link]]]
    why = f"'{link}' never turns: no moment of inertia of it has a kinetic energy."
    return Fault(
        "reduced", why, f"Name a link that turns, or a point that moves, such as {names[0]}." if names else "Name another."
    )


def _derivatives(unit: Motion) -> tuple[list[Values], list[Values]]:
    """Angles of all links, differentiated once and twice by the drive's coordinate."""
    classes = unit.model.angles.rotation_class
    links = range(len(unit.model.links))
    return [unit.speeds.angular[classes[k]] for k in links], [unit.accelerations.angular[classes[k]] for k in links]


def _rows(motion: Motion, values: ArrayLike) -> Real:
    return np.ascontiguousarray(np.broadcast_to(np.asarray(values, float), (motion.frames,)))


REDUCED_KINDS = ("equilibrium", "couple", "single force")
ROUNDED_EXTENT = 1e-2
"""Least extent of a force system, relative to the distance from the origin: `ZERO_SUM` of it is the rounding of its points."""


def _cross(a: Real, b: Real) -> Real:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def moment_about(points: ArrayLike, forces: ArrayLike, about: ArrayLike = (0.0, 0.0)) -> Real:
    """Moments (..., n) [N m] of forces (..., n, 2) [N] at points (..., n, 2) [m] about a point (..., 2), counter-clockwise
    positive."""
    p, f, o = (np.asarray(x, float) for x in (points, forces, about))
    return _cross(p - (o[..., None, :] if o.ndim > 1 else o), f)


def reduce_to(
    points: ArrayLike, forces: ArrayLike, couples: ArrayLike | None = None, *, about: ArrayLike = (0.0, 0.0)
) -> tuple[Real, Real]:
    """A force system reduced to a point: main vector (..., 2) [N], independent of the point, and main moment (...) [N m] about
    it."""
    force = np.asarray(forces, float).sum(axis=-2)
    moment = moment_about(points, forces, about).sum(axis=-1)
    return force, moment if couples is None else moment + np.asarray(couples, float).sum(axis=-1)


@dataclass(frozen=True, eq=False)
class Resultant:
    """The simplest system that replaces a force system.

    ``kind`` (...): one of `REDUCED_KINDS`. ``force`` (..., 2) [N]; ``moment`` (...) [N m] about the origin, of a couple about any
    point. ``point`` (..., 2) [m]: the point of the line of action nearest to the origin, NaN where there is no
    single force.
    """

    kind: NDArray[np.str_]
    force: Real
    moment: Real
    point: Real

    @property
    def magnitude(self) -> Real:
        return np.hypot(self.force[..., 0], self.force[..., 1])

    @property
    def direction(self) -> Real:
        """Unit vector (..., 2) of a single force, NaN where there is none."""
        with np.errstate(invalid="ignore", divide="ignore"):
            unit = self.force / self.magnitude[..., None]
        return np.where((self.kind == REDUCED_KINDS[2])[..., None], unit, np.nan)

    def nearest(self, to: ArrayLike) -> Real:
        """The point (..., 2) [m] of the line of action that is nearest to a given one (..., 2)."""
        away = np.asarray(to, float) - self.point
        unit = self.direction
        return self.point + np.asarray((away * unit).sum(axis=-1))[..., None] * unit


def resultant(points: ArrayLike, forces: ArrayLike, couples: ArrayLike | None = None) -> Resultant:
    """The resultant of a force system: a single force on its line of action, a couple, or equilibrium.

    The line is at the distance M / R from the point to which the system is reduced. The remainder of forces that cancel counts as
    zero below 1e-12 of their sum, a moment below 1e-12 of the sum of forces times the system's extent, or 1e-14 of that
    of forces times their distance from the origin.
    """
    p, f = np.asarray(points, float), np.asarray(forces, float)
    p = np.broadcast_to(p, np.broadcast_shapes(p.shape, f.shape))
    middle = p.mean(axis=-2)  # reduced to the middle first: the least rounding where the system lies far from the origin
    force, moment = reduce_to(p, f, couples, about=middle)
    sizes = np.hypot(f[..., 0], f[..., 1])
    extent = np.hypot(*np.moveaxis(p - middle[..., None, :], -1, 0)).max(axis=-1)
    extent = np.maximum(extent, ROUNDED_EXTENT * np.abs(p).max(axis=(-2, -1)))
    turning = (sizes * extent[..., None]).sum(axis=-1)
    if couples is not None:
        turning = turning + np.abs(np.asarray(couples, float)).sum(axis=-1)
    square = (force**2).sum(axis=-1)
    pushes = np.sqrt(square) > ZERO_SUM * sizes.sum(axis=-1)
    turns = np.abs(moment) > ZERO_SUM * turning
    kind = np.where(pushes, REDUCED_KINDS[2], np.where(turns, REDUCED_KINDS[1], REDUCED_KINDS[0]))
    force = np.where(pushes[..., None], force, 0.0)
    moment = np.where(pushes | turns, moment, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        # the arm at right angles to the force with arm x force = moment
        on_line = middle + np.stack([force[..., 1], -force[..., 0]], axis=-1) * (moment / square)[..., None]
        unit = force / np.sqrt(square)[..., None]
        point = on_line - (on_line * unit).sum(axis=-1)[..., None] * unit
    point = np.where(pushes[..., None], point, np.nan)
    about_origin = moment + _cross(middle, force)
    return Resultant(kind=np.asarray(kind, dtype=np.str_), force=force, moment=about_origin, point=point)
