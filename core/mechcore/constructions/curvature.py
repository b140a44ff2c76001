"""Curvature of paths: centre of curvature and evolute of a point's path, inflection circle of a link, Euler-Savary, Bobillier.

Everything is about geometry and uses the motion per unit of the first drive, which may stand still. With the pole P (instant centre
against the frame), the angular velocity w and the acceleration a_P of the link's point at P, the points that pass through an
inflection of their paths lie on the circle with the diameter from P to the inflection pole J = P + a_P / w^2. On a ray through P it
decides all centres of curvature K (Euler-Savary): XP^2 = XK XJ', directed, where J' is on the circle. Bobillier: the angle from the
pole tangent to the ray of one point is that from the ray of another to the collineation axis, which leads from P to where the line
of the two points meets that of their centres of curvature.
"""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.constructions.polygons import frames_of
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.dyads import cross
from mechcore.motion.metrics import curvature, per_unit
from mechcore.motion.motion import Motion
from mechcore.records import dataclass

CUSP = 1e-9
"""A point slower than this part of its own largest rate is at a cusp, or turns back."""
STILL = 1e-12
"""Rates below this part of the largest in the mechanism are rounding."""


@dataclass(frozen=True, eq=False)
class PathCurvature:
    """Of the path of a point, with its ``place`` (F,) [m], the unit ``tangent`` (F,), the signed ``curvature`` (F,) [1/m],
    positive to the left, and the ``centre`` of curvature (F,) [m]: over the frames the evolute. NaN at a cusp, the centre also
    where it is straight."""

    link: str
    point: str
    place: Complex
    tangent: Complex
    curvature: Real
    centre: Complex


def path_curvature(motion: Motion, link: str, point: str) -> PathCurvature:
    """Curvature of the path of a named point of a link."""
    place, rate = (per_unit(motion).point(link, point, k) @ np.array([1.0, 1.0j]) for k in (0, 1))
    bend = curvature(motion, link, point)
    size = motion.model.length_scale
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = np.abs(rate)
        tangent = rate / np.where(speed > CUSP * float(np.nanmax(speed, initial=0.0)), speed, np.nan)
        centre = place + 1j * tangent / np.where(np.abs(bend) * size > STILL, bend, np.nan)
    return PathCurvature(link, point, place, tangent, np.where(np.isfinite(tangent), bend, np.nan), centre)


@dataclass(frozen=True, eq=False)
class Bobillier:
    """Bobillier's construction of the pole tangent from two ``points`` of a link, with their ``places`` and ``centres`` of
    curvature (2, F) [m]: ``meeting`` (F,) of the lines of the points and of the centres, and the ``tangent`` (F,) that follows, a
    unit vector."""

    points: tuple[str, str]
    places: Complex
    centres: Complex
    meeting: Complex
    tangent: Complex


@dataclass(frozen=True, eq=False)
class InflectionCircle:
    """Of a link against the frame: ``pole`` and inflection ``end`` (F,) [m], which are ends of a diameter of the inflection
    circle; NaN where the link does not turn. ``bobillier``: where the link has two pins on paths with centres of curvature."""

    link: str
    pole: Complex
    end: Complex
    bobillier: Bobillier | None

    def centre_of_curvature(self, place: Complex) -> Complex:
        """Centre of curvature (F,) [m] of the path of the link's point at ``place`` (F,), by Euler-Savary."""
        ray = place - self.pole
        with np.errstate(invalid="ignore", divide="ignore"):
            x = np.abs(ray)
            e = ray / x
            j = np.real(np.conj(e) * (self.end - self.pole))  # of the circle on the ray, from the pole
            return np.asarray(self.pole - e * x * j / (x - j))


def inflection_circle(motion: Motion, link: str) -> InflectionCircle:
    """The inflection circle of a moving link against the frame."""
    model, n = motion.model, motion.frames
    if link not in model.index or link == model.mechanism.frame:
        raise MechanismError(Fault("inflection", f"'{link}' is no moving link.", "Name a moving link."))
    unit, k = per_unit(motion), model.index[link]
    w, e = (np.real(frames_of(r.angular[model.angles.rotation_class[k]], n)) for r in (unit.speeds, unit.accelerations))
    at, v, a = (frames_of(unit.origin(k, order), n) for order in range(3))
    size = model.length_scale
    with np.errstate(invalid="ignore", divide="ignore"):
        arm = 1j * v / np.where(np.abs(w) * size > STILL * np.abs(v), w, np.nan)
        end = at + arm + (a + (1j * e - w * w) * arm) / (w * w)
    circle = InflectionCircle(link, at + arm, end, None)
    return InflectionCircle(link, circle.pole, end, _bobillier(motion, circle))


def _bobillier(motion: Motion, circle: InflectionCircle) -> Bobillier | None:
    """By the first two pins of the link whose centres of curvature are finite, on different rays, in most frames."""
    model, n = motion.model, motion.frames
    k, size = model.index[circle.link], model.length_scale
    pairs: list[tuple[str, complex, Complex, Complex]] = []
    for joint, ends in zip(model.joints, model.ends, strict=True):
        if joint.slide is not None or k not in ends or not joint.turns:
            continue
        local = complex(joint.a if ends[0] == k else joint.b)
        place = frames_of(motion.of_point(k, local), n)
        centre = circle.centre_of_curvature(place)
        with np.errstate(invalid="ignore"):
            good = np.abs(centre - place) < size / STILL**0.5
            apart = all(np.median(np.abs(cross(p - circle.pole, place - circle.pole))) > 1e-9 * size**2 for _, _, p, _ in pairs)
        if good.mean() > 0.5 and apart:
            pairs.append((joint.name, local, place, centre))
    if len(pairs) < 2:
        return None
    (first, _, a, ka), (second, _, b, kb) = pairs[:2]
    with np.errstate(invalid="ignore", divide="ignore"):
        meeting = a + cross(ka - a, kb - ka) / cross(b - a, kb - ka) * (b - a)
        axis = meeting - circle.pole
        turned = (a - circle.pole) * (b - circle.pole) / axis
        tangent = turned / np.abs(turned)
    return Bobillier((first, second), np.array([a, b]), np.array([ka, kb]), meeting, tangent)
