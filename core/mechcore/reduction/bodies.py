"""Mass, centre of mass and central moment of inertia: of composite bodies, of standard solids by formula, of plates by outline.

Integrals over plane areas are exact (Green's theorem). An outline is a closed chain of vertices; the side to the next vertex is
straight, or an arc given by its bulge, the tangent of a quarter of the angle that it spans (positive: counter-clockwise), as in
drawing exchange files.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Real, Vec2
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.dyads import cross
from mechcore.records import dataclass
from mechcore.texts import as_length


@dataclass(frozen=True)
class RigidBody:
    """``mass`` [kg], ``centre`` of mass [m], ``inertia`` J_S about it [kg m^2] (axis normal to the plane of motion)."""

    mass: float
    centre: Vec2 = (0.0, 0.0)
    inertia: float = 0.0

    def about(self, x: float, y: float) -> float:
        """Moment of inertia about another parallel axis (Steiner) [kg m^2]."""
        return self.inertia + self.mass * ((self.centre[0] - x) ** 2 + (self.centre[1] - y) ** 2)

    @property
    def gyration(self) -> float:
        """Radius of gyration i_S about the centre of mass [m]."""
        return math.sqrt(self.inertia / self.mass)


def combine(parts: Iterable[RigidBody]) -> RigidBody:
    """The composite of several bodies. Holes are bodies of negative mass and inertia. The total mass must not be zero, unless all
    masses are."""
    parts = [p for p in parts if p.mass or p.inertia]
    mass = math.fsum(p.mass for p in parts)
    if not parts:
        return RigidBody(0.0)
    if abs(mass) <= 1e-14 * math.fsum(abs(p.mass) for p in parts):
        raise MechanismError(Fault("mass", "the parts' masses cancel: there is no centre of mass.", "Check the masses."))
    x = math.fsum(p.mass * p.centre[0] for p in parts) / mass
    y = math.fsum(p.mass * p.centre[1] for p in parts) / mass
    return RigidBody(mass, (x, y), math.fsum(p.about(x, y) for p in parts))


@dataclass(frozen=True)
class StandardSolid:
    """A standard solid: ``sizes`` it needs, its volume [m^3] (None: it has none, only a mass), and i^2 = J / m [m^2]."""

    what: str
    sizes: tuple[str, ...]
    volume: Callable[..., float] | None
    square: Callable[..., float]


def _entry(what: str, volume: Callable[..., float] | None, square: Callable[..., float]) -> StandardSolid:
    sizes = dict.fromkeys([*(inspect.signature(volume).parameters if volume else ()), *inspect.signature(square).parameters])
    return StandardSolid(what, tuple(sizes), volume, square)


_PI = math.pi

SOLIDS: Mapping[str, StandardSolid] = {
    "point": _entry("point mass at a radius from the axis", None, lambda radius: radius**2),
    "rod": _entry("thin rod, axis across its centre", None, lambda length: length**2 / 12.0),
    "rod end": _entry("thin rod, axis across its end", None, lambda length: length**2 / 3.0),
    "rod inclined": _entry(
        "thin rod, axis through its end, inclined by an angle to the rod",
        None,
        lambda length, angle: (length * math.sin(angle)) ** 2 / 3.0,
    ),
    "cylinder": _entry("cylinder, its own axis", lambda radius, length: _PI * radius**2 * length, lambda radius: radius**2 / 2.0),
    "cylinder across": _entry(
        "cylinder, axis across its centre",
        lambda radius, length: _PI * radius**2 * length,
        lambda radius, length: (length**2 + 3.0 * radius**2) / 12.0,
    ),
    "hollow cylinder": _entry(
        "hollow cylinder, its own axis",
        lambda radius, bore, length: _PI * (radius**2 - bore**2) * length,
        lambda radius, bore: (radius**2 + bore**2) / 2.0,
    ),
    "ring": _entry("thin ring, its own axis", None, lambda radius: radius**2),
    "sphere": _entry("sphere, axis through its centre", lambda radius: 4.0 / 3.0 * _PI * radius**3, lambda radius: 0.4 * radius**2),
    "shell": _entry("thin spherical shell, axis through its centre", None, lambda radius: 2.0 / 3.0 * radius**2),
    "disc": _entry("disc, its own axis", lambda radius, thickness: _PI * radius**2 * thickness, lambda radius: radius**2 / 2.0),
    "ellipsoid": _entry(
        "ellipsoid with semi-axes a, b, c, axis along a",
        lambda a, b, c: 4.0 / 3.0 * _PI * a * b * c,
        lambda b, c: (b**2 + c**2) / 5.0,
    ),
    "cone": _entry("cone, its own axis", lambda radius, height: _PI * radius**2 * height / 3.0, lambda radius: 0.3 * radius**2),
    "box": _entry(
        "box, axis normal to its sides a and b", lambda a, b, thickness: a * b * thickness, lambda a, b: (a**2 + b**2) / 12.0
    ),
    "cube": _entry("cube, axis normal to a face", lambda a: a**3, lambda a: a**2 / 6.0),
    "torus": _entry(
        "torus, its own axis; radius of the ring, radius of its section",
        lambda radius, section: 2.0 * _PI**2 * radius * section**2,
        lambda radius, section: radius**2 + 0.75 * section**2,
    ),
}
"""The table of moments of inertia of lectures; every J = m i^2 about the axis that the entry names."""

NEEDED_FOR_INERTIA = {name: tuple(inspect.signature(s.square).parameters) for name, s in SOLIDS.items()}


def solid(
    kind: str, *, mass: float | None = None, density: float | None = None, centre: Vec2 = (0.0, 0.0), **sizes: float
) -> RigidBody:
    """A standard solid [m, kg or kg/m^3, rad] with its centre at ``centre``: ``solid("rod", mass=2, length=0.4)``.

    Either the density or the mass is given. The moment of inertia is about the axis that the table names, which is taken to be
    normal to the plane at ``centre``; for "rod end" and "rod inclined" that axis is not the centre of mass, and they are refused
    here: see `SOLIDS`.
    """
    if kind not in SOLIDS:
        raise MechanismError(Fault("solid", f"there is no solid '{kind}'.", f"Known: {', '.join(SOLIDS)}."))
    if kind in ("rod end", "rod inclined"):
        why = f"'{kind}' is a moment of inertia about an axis away from the centre of mass."
        raise MechanismError(Fault("solid", why, 'Use "rod", whose J_S the axis of motion shifts by itself.'))
    entry = SOLIDS[kind]
    if (mass is None) == (density is None):
        raise MechanismError(Fault("solid", f"'{kind}' needs either a mass or a density.", "Give one of them."))
    needed = NEEDED_FOR_INERTIA[kind] if density is None else entry.sizes
    if density is not None and entry.volume is None:
        raise MechanismError(Fault("solid", f"'{kind}' is thin: it has no volume for a density.", "Give its mass."))
    missing = [s for s in needed if s not in sizes]
    unknown = [s for s in sizes if s not in entry.sizes]
    if missing or unknown:
        what = f"'{kind}' needs {', '.join(missing)}." if missing else f"'{kind}' has no {', '.join(unknown)}."
        raise MechanismError(Fault("solid", what, f"Its sizes: {', '.join(entry.sizes)}."))
    wrong = [s for s, v in sizes.items() if not (math.isfinite(v) and v >= 0.0)]
    if wrong:
        raise MechanismError(Fault(f"solid.{wrong[0]}", f"{sizes[wrong[0]]} is no size.", "Give a positive length."))
    if kind == "hollow cylinder" and sizes["bore"] > sizes["radius"]:
        raise MechanismError(Fault("solid.bore", "is larger than the radius.", "Give the radius of the bore."))
    if density is not None and entry.volume is not None:
        mass = density * entry.volume(**{k: sizes[k] for k in inspect.signature(entry.volume).parameters})
    assert mass is not None
    square = entry.square(**{k: sizes[k] for k in NEEDED_FOR_INERTIA[kind]})
    return RigidBody(mass, centre, mass * square)


def single_resultant(force: ArrayLike, moment: ArrayLike, at: ArrayLike = (0.0, 0.0)) -> tuple[Real, Real]:
    """The single force that replaces a force (..., 2) at a point ``at`` and a moment (...): the point of its line of action that is
    nearest to ``at`` (..., 2), and its distance |M| / |F| (...). NaN and inf where there is a moment but no force; ``at`` and 0
    where there is neither."""
    f, m, p = np.asarray(force, float), np.asarray(moment, float), np.asarray(at, float)
    square = (f**2).sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        arm = np.stack([f[..., 1], -f[..., 0]], axis=-1) * (m / square)[..., None]
        far = np.abs(m) / np.sqrt(square)
    nothing = (square == 0.0) & (m == 0.0)
    arm = np.where(nothing[..., None], 0.0, np.where((square == 0.0)[..., None], np.nan, arm))
    return p + arm, np.where(nothing, 0.0, far)


def percussion_centre(mass: float, inertia: float, centre: ArrayLike, pivot: ArrayLike) -> Real:
    """Centre of percussion W (..., 2) [m] of a body that turns about a pivot: on the line pivot - S beyond S by e = i_S^2 / rho.

    The inertia resultant crosses that line in W for any angular velocity and acceleration.
    """
    s, b = np.asarray(centre, float), np.asarray(pivot, float)
    rho = np.hypot(*np.moveaxis(s - b, -1, 0))
    if np.any(rho == 0.0):
        why = "the pivot is the centre of mass: the inertia forces come to a couple, which has no line of action."
        raise MechanismError(Fault("percussion_centre", why, "Give another pivot."))
    return np.asarray(s + (s - b) * (inertia / mass / rho**2)[..., None])


def acceleration_field(places: ArrayLike, a_s: ArrayLike, omega: ArrayLike, alpha: ArrayLike) -> Real:
    """Accelerations (..., n, 2) of points of a rigid body at positions (n, 2) or (..., n, 2) from S, all in the same axes:
    a_S + alpha k x r - omega^2 r."""
    r = np.asarray(places, float)
    w, e = np.asarray(omega, float)[..., None, None], np.asarray(alpha, float)[..., None, None]
    turned = np.stack([-r[..., 1], r[..., 0]], axis=-1)
    return np.asarray(np.asarray(a_s, float)[..., None, :] + e * turned - w * w * r)


@dataclass(frozen=True)
class Area:
    """``area`` [m^2], ``centre`` [m], ``polar`` moment about the centre, the integral of r^2 dA [m^4]."""

    area: float
    centre: Vec2
    polar: float

    def body(self, surface_density: float) -> RigidBody:
        """A plate of this shape; ``surface_density`` [kg/m^2] is density times thickness, negative for a hole."""
        return RigidBody(surface_density * self.area, self.centre, surface_density * self.polar)


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
"""Gauss-Legendre quadrature along a side: exact on straight ones, to rounding on arcs of up to a full circle, however shallow."""


def area_of(vertices: ArrayLike, bulges: Sequence[float] | None = None) -> Area:
    """Integrals over the inside of an outline (n, 2) [m], in either sense of rotation. `MechanismError` where it has no area."""
    xy = np.asarray(vertices, float)
    middle = xy.mean(axis=0)
    z = (xy - middle) @ np.array([1.0, 1j])  # integrals about a point inside: no cancellation for outlines far from the origin
    bulge = np.zeros(len(z)) if not bulges else np.asarray(bulges, float)
    half, curved = 2.0 * np.arctan(bulge), bulge != 0.0  # half the angle that each side spans
    over_sine = np.divide(0.5 * (1.0 + bulge**2), bulge, out=np.ones(len(z)), where=curved)
    t = 0.5 * (1.0 + _NODES[:, None])  # of each side
    side = np.roll(z, -1) - z
    place = z + side * np.where(curved, np.sin(half * t) * over_sine * np.exp(1j * half * (t - 1.0)), t)
    pace = side * np.where(curved, half * over_sine, 1.0) * np.exp(1j * half * (2.0 * t - 1.0))
    swept = 0.5 * _WEIGHTS[:, None] * cross(place, pace)  # twice the area between side and origin
    area, moment = 0.5 * float(swept.sum()), complex((swept * place).sum()) / 3.0
    first, second = np.array([moment.real, moment.imag]), 0.25 * float((swept * np.abs(place) ** 2).sum())
    if abs(area) <= 1e-12 * float((np.abs(z) ** 2).sum()):
        raise MechanismError(Fault("outline", "the outline has no area.", "Check its corners and bulges."))
    if area < 0.0:
        area, first, second = -area, -first, -second
    centre = first / area
    return Area(float(area), (float(middle[0] + centre[0]), float(middle[1] + centre[1])), float(second - area * (centre**2).sum()))


def circle(centre: Vec2, radius: float) -> Area:
    """A full circle."""
    return Area(math.pi * radius**2, centre, 0.5 * math.pi * radius**4)


def plate(
    outer: Area, surface_density: float, *, holes: Iterable[Area] = (), bosses: Iterable[tuple[Area, float]] = ()
) -> RigidBody:
    """A plate with holes through it, and bosses on it, each with a surface density of its own [kg/m^2]."""
    parts = [outer.body(surface_density), *(h.body(-surface_density) for h in holes)]
    return combine([*parts, *(area.body(extra) for area, extra in bosses)])


def rounded_hull(points: Sequence[Vec2], radius: float) -> Area:
    """The smallest convex outline around circles of one radius about points: a plate with round ends, or a rounded polygon."""
    z = sorted({complex(*p) for p in points}, key=lambda c: (c.real, c.imag))
    if radius <= 0.0:
        raise MechanismError(Fault("plate", f"a radius of {as_length(radius)} at its ends.", "Give a positive width."))
    corners = _hull(z)
    if len(corners) == 1:
        return circle((corners[0].real, corners[0].imag), radius)
    vertices, bulges = [], []
    n = len(corners)
    for i, at in enumerate(corners):
        before, after = at - corners[i - 1], corners[(i + 1) % n] - at
        turn = math.atan2((before.conjugate() * after).imag, (before.conjugate() * after).real) % (2.0 * math.pi)
        for side, bulge in ((before, math.tan(0.25 * turn)), (after, 0.0)):
            place = at - 1j * side / abs(side) * radius  # to the right of the direction round the hull
            vertices.append((place.real, place.imag))
            bulges.append(bulge)
    return area_of(vertices, bulges)


def _hull(z: list[complex]) -> list[complex]:
    """Corners of the convex hull, counter-clockwise (Andrew's monotone chain)."""
    if len(z) < 3:
        return z

    def half(places: Sequence[complex]) -> list[complex]:
        out: list[complex] = []
        for p in places:
            while len(out) > 1 and ((out[-1] - out[-2]).conjugate() * (p - out[-1])).imag <= 0.0:
                out.pop()
            out.append(p)
        return out[:-1]

    return half(z) + half(z[::-1])
