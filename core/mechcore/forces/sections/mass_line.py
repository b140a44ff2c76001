"""The mass of a link along its axis, so that mass, centre of mass and moment of inertia are met exactly.

A scene knows three numbers of a link's mass. Along a straight axis they decide a density that is linear or quadratic: of a
uniform rod it is constant. Where such a density would be negative somewhere, it is bent only as far as it stays positive, and the
share of the mass that it cannot have is put into point masses: one (more mass near the centre of mass than any density has), or one
at each end (more mass far away). A moment of inertia that no mass on the axis can have (a disc on its shaft) is that of masses that
turn with the axis: a couple distributed like the mass. A centre of mass beside the axis shifts the line of masses across; rigid
arms bear it. Along an axis with corners the density is uniform, shifted to the centre of mass; a smaller moment of inertia puts a
share of the mass at the centre of mass, a larger one is distributed as a couple.
All of this is continuous in mass, centre and moment of inertia.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial

from mechcore.arrays import Complex, Real
from mechcore.forces.sections.axis import Axis, Cuts

NOTHING = 1e-12
"""Share of a link's mass below which it is rounding."""


@dataclass(frozen=True)
class Mass:
    """A part of a link's mass: ``mass`` [kg], ``centre`` in the link's frame [m], ``inertia`` about it [kg m^2]."""

    mass: float
    centre: complex
    inertia: float


@dataclass(frozen=True, eq=False)
class Spread:
    """Mass between two stations [m] at places that start at ``place`` in the link's frame and go on in ``direction``.

    ``density``: coefficients of a polynomial in the length from the first station [kg/m, kg/m^2 ...].
    """

    start: float
    end: float
    place: complex
    direction: complex
    density: Real


@dataclass(frozen=True, eq=False)
class MassLine:
    """The distribution of a link's mass: ``spread`` along its axis, point masses at stations; ``extra`` [m^2] is the moment of
    inertia per mass that couples have, distributed like the mass. Moments are about ``centre``, the link's centre of mass."""

    centre: complex
    spread: tuple[Spread, ...]
    points: tuple[tuple[float, Mass], ...]
    extra: float

    def beyond(self, cuts: Cuts) -> tuple[Real, Complex, Real]:
        """Mass beyond cuts (...), its first moment (complex) and moment of inertia about the centre of mass."""
        mass, inertia = np.zeros(cuts.stations.shape), np.zeros(cuts.stations.shape)
        first = np.zeros(cuts.stations.shape, complex)
        for part in self.spread:
            q, d = part.place - self.centre, part.direction
            factors = ([1.0], [q, d], [abs(q) ** 2, 2.0 * (np.conj(q) * d).real, abs(d) ** 2])
            x, end = np.clip(cuts.stations, part.start, part.end) - part.start, part.end - part.start
            sums = []
            for factor in factors:
                integral = polynomial.polyint(polynomial.polymul(part.density, factor))
                sums.append(polynomial.polyval(end, integral) - polynomial.polyval(x, integral))
            mass, first, inertia = mass + sums[0], first + sums[1], inertia + sums[2] + self.extra * sums[0]
        for station, point in self.points:
            there, q = cuts.before(station), point.centre - self.centre
            mass, first = mass + there * point.mass, first + there * (point.mass * q)
            inertia = inertia + there * (point.inertia + (abs(q) ** 2 + self.extra) * point.mass)
        return mass, first, inertia

    @property
    def jumps(self) -> list[float]:
        """Stations of point masses."""
        return [station for station, _ in self.points]


def mass_line(axis: Axis, whole: Mass, known: Sequence[Mass] = ()) -> MassLine:
    """How the mass of a link is distributed along its axis. ``known``: parts of it, where they are; the rest is spread."""
    placed = [(float(axis.nearest(part.centre)), part) for part in known]
    mass = whole.mass - sum(part.mass for part in known)
    if mass <= NOTHING * whole.mass:
        left = whole.inertia - sum(part.inertia + part.mass * abs(part.centre - whole.centre) ** 2 for part in known)
        if left > NOTHING * whole.inertia:  # a moment of inertia without a mass
            placed.append((float(axis.nearest(whole.centre)), Mass(0.0, whole.centre, left)))
        return MassLine(whole.centre, (), tuple(placed), 0.0)
    centre = (whole.mass * whole.centre - sum(part.mass * part.centre for part in known)) / mass
    inertia = whole.inertia - mass * abs(centre - whole.centre) ** 2
    inertia -= sum(part.inertia + part.mass * abs(part.centre - whole.centre) ** 2 for part in known)
    rest = Mass(mass, centre, max(inertia, 0.0))
    spread, points, extra = _straight(axis, rest) if axis.straight else _with_corners(axis, rest)
    # a couple per mass is that of the rest alone: the known parts have what they are
    placed = [(s, Mass(p.mass, p.centre, p.inertia - extra * p.mass)) for s, p in placed]
    return MassLine(whole.centre, tuple(spread), (*placed, *points), extra)


def _straight(axis: Axis, whole: Mass) -> tuple[list[Spread], list[tuple[float, Mass]], float]:
    """Along a straight axis, in units of half its length h from its middle: mean and second moment of the density are wanted."""
    h, t = 0.5 * axis.length, axis.directions[0]
    middle = axis.vertices[0] + h * t
    from_middle = (whole.centre - middle) * np.conj(t)
    aside = whole.centre - from_middle.real * t  # of the line of masses: the place that lies across from the middle
    mean, variance = from_middle.real / h, whole.inertia / (whole.mass * h * h)
    free = max(0.0, min(variance, 1.0 - mean * mean))
    extra = (variance - free) * h * h

    def point(x: float, share: float) -> tuple[float, Mass]:
        return h * float(np.clip(1.0 + x, 0.0, 2.0)), Mass(share * whole.mass, aside + x * h * t, 0.0)

    if abs(mean) >= 1.0:  # beyond the axis
        return [], [point(mean, 1.0)], extra
    second = free + mean * mean
    a, b = 3.0 * mean, 7.5 * (second - 1.0 / 3.0)  # density 1 + a x + b (3 x^2 - 1) / 2
    least = b - abs(a)
    if b > 0.0 and abs(a) < 3.0 * b:
        least = min(least, -a * a / (6.0 * b) - 0.5 * b)
    bend = 1.0 if least >= -1.0 else -1.0 / least
    share, points = 1.0, []
    if bend < 1.0:
        bent, bent_second = bend * mean, 1.0 / 3.0 + bend * (second - 1.0 / 3.0)
        # the largest share whose rest can be point masses between the ends: variance >= 0, second moment <= 1
        p, q, r = bent_second - bent**2, second + bent_second - 2.0 * mean * bent, second - mean**2
        single = 2.0 * r / (q + np.sqrt(max(q * q - 4.0 * p * r, 0.0))) if q > 0.0 else 0.0
        double = (1.0 - second) / (1.0 - bent_second)
        share = float(np.clip(min(single, double), 0.0, 1.0))
        if 1.0 - share > NOTHING:
            at = (mean - share * bent) / (1.0 - share)
            if single <= double:
                points = [point(at, 1.0 - share)]
            else:
                points = [point(side, 0.5 * (1.0 - share) * (1.0 + side * at)) for side in (-1.0, 1.0)]
    a, b = bend * a, bend * b
    start = np.array([1.0 - a + b, (a - 3.0 * b) / h, 1.5 * b / (h * h)])  # in the length from the start: x = s / h - 1
    density = share * whole.mass / axis.length * start
    return ([Spread(0.0, axis.length, aside - h * t, t, density)] if share > NOTHING else []), points, extra


def _with_corners(axis: Axis, whole: Mass) -> tuple[list[Spread], list[tuple[float, Mass]], float]:
    """Along an axis with corners."""
    lengths = np.diff(axis.stations)
    middles = 0.5 * (axis.vertices[1:] + axis.vertices[:-1])
    centre = (lengths * middles).sum() / axis.length
    own = float((lengths * (np.abs(middles - centre) ** 2 + lengths**2 / 12.0)).sum() / axis.length)
    wanted = whole.inertia / whole.mass
    share, extra = min(1.0, wanted / own), max(0.0, wanted - own)
    density = np.array([share * whole.mass / axis.length])
    spread = [
        Spread(float(s0), float(s1), complex(z + whole.centre - centre), complex(t), density)
        for s0, s1, z, t in zip(axis.stations[:-1], axis.stations[1:], axis.vertices[:-1], axis.directions, strict=True)
    ]
    rest = (1.0 - share) * whole.mass
    points = [(float(axis.nearest(whole.centre)), Mass(rest, whole.centre, 0.0))] if 1.0 - share > NOTHING else []
    return spread, points, extra
