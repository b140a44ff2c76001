"""A link as a line: the axis along which its section forces are stated, and its mass along that axis.

The axis is a chain of straight segments through points of the link. Mass, centre of mass and moment of inertia are met exactly. A
scene states these three numbers of a link's mass. Along a straight axis they determine a linear or quadratic density, which is
constant for a uniform rod. Where such a density would be negative somewhere, its variation is reduced until it stays positive, and
the rest of the mass is put into point masses: one (more mass near the centre of mass than any such density has), or one at each end
(more mass far away). A moment of inertia that no mass on the axis can have (a disc on its shaft) is that of masses that turn with
the axis: a couple distributed like the mass. A centre of mass beside the axis shifts the line of masses across; rigid arms bear it.
Along an axis with corners the density is uniform, shifted to the centre of mass; a smaller moment of inertia puts a share of the
mass at the centre of mass, a larger one is distributed as a couple. All of this is continuous in mass, centre and moment of
inertia.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial

from mechcore.arrays import Complex, Flags, Index, Real
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechcore.spec.mechanism import CamJoint, Link, Mechanism

STRAIGHT_LINE = 1e-9
"""Distance from a line, relative to its length, up to which points lie on it."""
NO_MASS = 1e-12
"""Share of a link's mass below which it is rounding."""


class Cuts(NamedTuple):
    """Cuts through a link at ``stations`` (...) of its axis [m]: just behind them where ``sides`` is +1, just before where it is
    -1."""

    stations: Real
    sides: Real

    def before(self, station: float | Real) -> Flags:
        """Whether a load at a station lies beyond the cuts."""
        return np.asarray((station > self.stations) | ((station == self.stations) & (self.sides < 0.0)))

    def taken(self, order: Index) -> Cuts:
        """The cuts (F, n) of these numbers in each frame (F, m)."""
        return Cuts(*(np.take_along_axis(np.broadcast_to(v, self.stations.shape), order, axis=1) for v in self))


@dataclass(frozen=True, eq=False)
class SectionAxis:
    """The chain of segments between ``vertices`` (V,), complex positions in the link's frame [m], the first at station 0."""

    vertices: Complex

    @cached_property
    def stations(self) -> Real:
        """Stations (V,) of the vertices: lengths along the axis from its start [m]."""
        return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(self.vertices)))])

    @property
    def length(self) -> float:
        return float(self.stations[-1])

    @cached_property
    def directions(self) -> Complex:
        """Unit vectors (V - 1,) of the segments."""
        chords = np.diff(self.vertices)
        return chords / np.abs(chords)

    @cached_property
    def straight(self) -> bool:
        return bool(np.abs(np.imag(self.directions[1:] * np.conj(self.directions[0]))).max(initial=0.0) <= STRAIGHT_LINE)

    def segment(self, cuts: Cuts) -> Index:
        """Number of the segment that each cut goes through."""
        behind, before = (np.searchsorted(self.stations, cuts.stations, side=side) - 1 for side in ("right", "left"))
        return np.clip(np.where(cuts.sides > 0.0, behind, before), 0, len(self.directions) - 1)

    def place(self, cuts: Cuts) -> Complex:
        """Positions of cuts in the link's frame [m]."""
        k = self.segment(cuts)
        return self.vertices[k] + (cuts.stations - self.stations[k]) * self.directions[k]

    def nearest(self, place: complex | Complex) -> Real:
        """The station of the axis nearest to each position in the link's frame [m]."""
        z = np.asarray(place)[..., None] - self.vertices[:-1]
        lengths = np.diff(self.stations)
        along = np.clip(np.real(z * np.conj(self.directions)), 0.0, lengths)
        apart = np.abs(z - along * self.directions)
        chosen = np.argmin(np.where(np.isfinite(apart), apart, np.inf), axis=-1)[..., None]
        return np.asarray(np.take_along_axis(self.stations[:-1] + along, chosen, axis=-1)[..., 0])


def axis_of(mechanism: Mechanism, link: str, points: Sequence[str] = ()) -> SectionAxis:
    """The axis of a link through the named points, or through those of `axis_points`. Raises `MechanismError`."""
    body = next(k for k in mechanism.links if k.name == link)
    names = points or axis_points(mechanism, body)
    vertices = np.array([complex(*body.points[name]) for name in names])
    steps = np.abs(np.diff(vertices))
    if len(steps) == 0 or steps.min() <= STRAIGHT_LINE * steps.sum():
        k = int(np.argmin(steps)) if len(steps) else 0
        why = f"'{names[k]}' and '{names[k + 1]}' are at one place." if len(steps) else f"the axis has one point, '{names[0]}'."
        raise MechanismError(Fault(f"sections.{link}.along", why, "Name at least two points of the link, one after the other."))
    return SectionAxis(vertices)


def axis_points(mechanism: Mechanism, link: Link) -> tuple[str, ...]:
    """The ends of the axis of a link that states none.

    They are the outermost of the points at which joints and loads act, where these lie on one line; otherwise of those at which
    joints act; otherwise of all points of the link. Raises `MechanismError` where they do not lie on a line.
    """
    jointed, loaded = _joint_points(mechanism, link.name), _load_points(mechanism, link.name)
    choices = [[*jointed, *loaded], jointed, list(link.points)]
    for names in choices:
        ends = _ends(link, names)
        if ends:
            return ends
    named = ", ".join(dict.fromkeys(choices[0] or choices[2]))
    why = f"the axis of '{link.name}' is not clear: its points {named} do not lie on one line."
    if len(link.points) == 1:
        why = f"'{link.name}' has one point, '{named}', and no axis."
        raise MechanismError(Fault(f"sections.{link.name}", why, "Give the link another point at the other end of its axis."))
    raise MechanismError(Fault(f"sections.{link.name}", why, 'Say where it runs: along = ["A", "B"], points of the link.'))


def _ends(link: Link, names: Sequence[str]) -> tuple[str, ...]:
    """The outermost two of some points, in the order of the scene; none where they do not lie on one line."""
    known = [name for name in link.points if name in names]
    z = np.array([complex(*link.points[name]) for name in known])
    if len(z) < 2 or not (reach := np.abs(z - z[0])).any():
        return ()
    along = (z - z[0]) * np.conj(z[np.argmax(reach)] - z[0]) / reach.max()
    if np.abs(along.imag).max() > STRAIGHT_LINE * np.ptp(along.real):
        return ()
    ends = sorted((int(np.argmin(along.real)), int(np.argmax(along.real))))
    return known[ends[0]], known[ends[1]]


def _joint_points(mechanism: Mechanism, link: str) -> list[str]:
    points = []
    for joint in mechanism.joints:
        ends = [*zip(getattr(joint, "links", ()), getattr(joint, "points", ()), strict=False)]
        if isinstance(joint, CamJoint):
            ends.append((joint.links[0 if joint.inverse else 1], joint.point))
        points += [point for k, point in ends if k == link and point is not None]
    return points


def _load_points(mechanism: Mechanism, link: str) -> list[str]:
    points = []
    for load in mechanism.loads:
        ends = [*zip(getattr(load, "links", ()), getattr(load, "points", ()), strict=False)]
        ends.append((getattr(load, "link", None), getattr(load, "point", None)))
        points += [point for k, point in ends if k == link and isinstance(point, str)]
    return points


@dataclass(frozen=True)
class MassPart:
    """A part of a link's mass: ``mass`` [kg], ``centre`` in the link's frame [m], ``inertia`` about it [kg m^2]."""

    mass: float
    centre: complex
    inertia: float


@dataclass(frozen=True, eq=False)
class DistributedMass:
    """Mass between two stations [m], on a line from ``place`` in the link's frame in the ``direction``.

    ``density``: coefficients of a polynomial in the length from the first station [kg/m, kg/m^2 ...].
    """

    start: float
    end: float
    place: complex
    direction: complex
    density: Real


@dataclass(frozen=True, eq=False)
class MassLine:
    """The distribution of a link's mass: ``distributed`` along its axis, point masses at stations; ``extra`` [m^2] is the moment of
    inertia per mass that couples have, distributed like the mass. Moments are about ``centre``, the link's centre of mass."""

    centre: complex
    distributed: tuple[DistributedMass, ...]
    points: tuple[tuple[float, MassPart], ...]
    extra: float

    def beyond(self, cuts: Cuts) -> tuple[Real, Complex, Real]:
        """Mass beyond cuts (...), its first moment (complex) and moment of inertia about the centre of mass."""
        mass, inertia = np.zeros(cuts.stations.shape), np.zeros(cuts.stations.shape)
        first = np.zeros(cuts.stations.shape, complex)
        for part in self.distributed:
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


def mass_line(axis: SectionAxis, whole: MassPart, known: Sequence[MassPart] = ()) -> MassLine:
    """Distribution of a link's mass along its axis. ``known``: parts of it with known positions; the rest is distributed."""
    placed = [(float(axis.nearest(part.centre)), part) for part in known]
    mass = whole.mass - sum(part.mass for part in known)
    if mass <= NO_MASS * whole.mass:
        left = whole.inertia - sum(part.inertia + part.mass * abs(part.centre - whole.centre) ** 2 for part in known)
        if left > NO_MASS * whole.inertia:  # a moment of inertia without a mass
            placed.append((float(axis.nearest(whole.centre)), MassPart(0.0, whole.centre, left)))
        return MassLine(whole.centre, (), tuple(placed), 0.0)
    centre = (whole.mass * whole.centre - sum(part.mass * part.centre for part in known)) / mass
    inertia = whole.inertia - mass * abs(centre - whole.centre) ** 2
    inertia -= sum(part.inertia + part.mass * abs(part.centre - whole.centre) ** 2 for part in known)
    rest = MassPart(mass, centre, max(inertia, 0.0))
    distributed, points, extra = _straight(axis, rest) if axis.straight else _with_corners(axis, rest)
    # the couple per mass belongs to the rest alone: the known parts keep their own inertia
    placed = [(s, MassPart(p.mass, p.centre, p.inertia - extra * p.mass)) for s, p in placed]
    return MassLine(whole.centre, tuple(distributed), (*placed, *points), extra)


def _straight(axis: SectionAxis, whole: MassPart) -> tuple[list[DistributedMass], list[tuple[float, MassPart]], float]:
    """Distributed masses, point masses and ``extra`` inertia along a straight axis, from mean and second moment of the density in
    units of half its length h from its middle."""
    h, t = 0.5 * axis.length, axis.directions[0]
    middle = axis.vertices[0] + h * t
    from_middle = (whole.centre - middle) * np.conj(t)
    aside = whole.centre - from_middle.real * t  # of the line of masses: its point opposite the middle
    mean, variance = from_middle.real / h, whole.inertia / (whole.mass * h * h)
    free = max(0.0, min(variance, 1.0 - mean * mean))
    extra = (variance - free) * h * h

    def point(x: float, share: float) -> tuple[float, MassPart]:
        return h * float(np.clip(1.0 + x, 0.0, 2.0)), MassPart(share * whole.mass, aside + x * h * t, 0.0)

    if abs(mean) >= 1.0:  # beyond the axis
        return [], [point(mean, 1.0)], extra
    second = free + mean * mean
    a, b = 3.0 * mean, 7.5 * (second - 1.0 / 3.0)  # density 1 + a x + b (3 x^2 - 1) / 2
    least = b - abs(a)
    if b > 0.0 and abs(a) < 3.0 * b:
        least = min(least, -a * a / (6.0 * b) - 0.5 * b)
    taper = 1.0 if least >= -1.0 else -1.0 / least
    share, points = 1.0, []
    if taper < 1.0:
        bent, bent_second = taper * mean, 1.0 / 3.0 + taper * (second - 1.0 / 3.0)
        # the largest share whose rest can be point masses between the ends: variance >= 0, second moment <= 1
        p, q, r = bent_second - bent**2, second + bent_second - 2.0 * mean * bent, second - mean**2
        single = 2.0 * r / (q + np.sqrt(max(q * q - 4.0 * p * r, 0.0))) if q > 0.0 else 0.0
        double = (1.0 - second) / (1.0 - bent_second)
        share = float(np.clip(min(single, double), 0.0, 1.0))
        if 1.0 - share > NO_MASS:
            at = (mean - share * bent) / (1.0 - share)
            if single <= double:
                points = [point(at, 1.0 - share)]
            else:
                points = [point(side, 0.5 * (1.0 - share) * (1.0 + side * at)) for side in (-1.0, 1.0)]
    a, b = taper * a, taper * b
    start = np.array([1.0 - a + b, (a - 3.0 * b) / h, 1.5 * b / (h * h)])  # in the length from the start: x = s / h - 1
    density = share * whole.mass / axis.length * start
    return ([DistributedMass(0.0, axis.length, aside - h * t, t, density)] if share > NO_MASS else []), points, extra


def _with_corners(axis: SectionAxis, whole: MassPart) -> tuple[list[DistributedMass], list[tuple[float, MassPart]], float]:
    """Distributed masses, point masses and ``extra`` inertia along an axis with corners."""
    lengths = np.diff(axis.stations)
    middles = 0.5 * (axis.vertices[1:] + axis.vertices[:-1])
    centre = (lengths * middles).sum() / axis.length
    own = float((lengths * (np.abs(middles - centre) ** 2 + lengths**2 / 12.0)).sum() / axis.length)
    wanted = whole.inertia / whole.mass
    share, extra = min(1.0, wanted / own), max(0.0, wanted - own)
    density = np.array([share * whole.mass / axis.length])
    distributed = [
        DistributedMass(float(s0), float(s1), complex(z + whole.centre - centre), complex(t), density)
        for s0, s1, z, t in zip(axis.stations[:-1], axis.stations[1:], axis.vertices[:-1], axis.directions, strict=True)
    ]
    rest = (1.0 - share) * whole.mass
    points = [(float(axis.nearest(whole.centre)), MassPart(rest, whole.centre, 0.0))] if 1.0 - share > NO_MASS else []
    return distributed, points, extra
