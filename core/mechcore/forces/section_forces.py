"""Section forces: normal force N, shear force V and bending moment M along a link's axis, from all loads on it.

A cut at station s divides the link. All loads beyond the cut (reactions, drives, loads, weight, inertia forces of the masses there)
are transmitted through it: force R and moment M about the cut. With the axis' direction t and n = i t to its left N = R . t
(tension is positive), V = -R . n, M counter-clockwise, positive where the link is stretched on the right of its axis; then
dM/ds = V between point loads. Loads beside the axis act on its nearest point by a rigid arm. Source: any textbook of statics, such
as Gross, Hauger, Schröder, Wall, Technische Mechanik 1, chapter 7.

The bearing of a sliding joint presses at its two ends, or linearly along it; its length and place are those of the joint's friction
(`mechcore.spec.mechanism.Friction`), whether it has friction or not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Complex, Plane, Real, Values
from mechcore.forces.kinetostatics import Forces, loads_on
from mechcore.forces.section_lines import Cuts, MassLine, MassPart, SectionAxis, axis_of, mass_line
from mechcore.kinematics.dyads import cross
from mechcore.motion.motion import Motion
from mechcore.numerics.frames import QUIET
from mechcore.records import dataclass
from mechcore.spec.mechanism import Mechanism, Prismatic
from mechcore.spec.studies import CrossSection, SectionStudy

SECTION_GRID = 64
"""Intervals between evenly spaced stations, in addition to the stations of loads."""
ZOOM_ROUNDS, ZOOM_POINTS = 4, 17
"""Rounds of refinement for the station of the largest moment, and stations in each: to 1e-5 of the axis."""
SAME_STATION = 1e-9
"""Distance of two stations up to which they coincide, relative to the axis' length."""
PARALLEL_SINE = 1e-6
"""Sine of the angle up to which a guide lies along a segment of the axis."""


class _ConcentratedLoad(NamedTuple):
    """A force [N] and a couple [N m] that act at a point of the link, all in its axes and over frames (F,)."""

    station: Real
    place: Complex
    force: Complex
    couple: Real


class _DistributedLoad(NamedTuple):
    """Load of a guide's bearing along a segment, in the link's axes: a pressure linear in the distance from its ``middle``,
    with resultant and couple, a force along it and a couple, both uniform. ``station`` of the middle on the segment, not clipped.
    """

    segment: int
    station: Real
    middle: Complex
    direction: complex  # along the segment
    length: float
    normal: Real
    couple: Real
    along: Real
    rubbing: Real


@dataclass(frozen=True, eq=False)
class SectionExtreme:
    """Largest magnitude of a quantity at every frame: ``values`` (F,) with their signs, ``stations`` (F,) [m]."""

    values: Real
    stations: Real


@dataclass(frozen=True, eq=False)
class SectionForces:
    """Section forces of a link: ``normal``, ``shear`` [N], ``moment`` [N m] (F, n) at ``stations`` (F, n) [m] along its ``axis``.

    Stations rise; where something acts at a point there are two, before and behind it. ``places`` [m] of the axis and its
    ``directions`` there (F, n) are complex, in the link's frame. ``bending``: the moment of largest magnitude. ``unbalanced`` (F,)
    [N]: residual of the forces on the whole link, moments over the axis' length included. ``stress``: the largest normal stress of
    each frame, |N| / A + |M| / W (F,) [Pa]; None without a cross-section.
    """

    link: str
    axis: SectionAxis
    section: CrossSection | None
    stations: Real
    places: Complex
    directions: Complex
    normal: Real
    shear: Real
    moment: Real
    bending: SectionExtreme
    unbalanced: Real
    stress: Real | None = None

    def extreme(self, values: Real) -> SectionExtreme:
        """Largest magnitude of a quantity (F, n) among the stations."""
        k = np.argmax(np.nan_to_num(np.abs(values), nan=-1.0), axis=1)[:, None]
        return SectionExtreme(np.take_along_axis(values, k, axis=1)[:, 0], np.take_along_axis(self.stations, k, axis=1)[:, 0])

    @cached_property
    def bending_stress(self) -> Real | None:
        """Largest bending stress of each frame |M| / W (F,) [Pa]; None without a cross-section."""
        return None if self.section is None else np.abs(self.bending.values) / self.section.modulus


def section_forces(forces: Forces, study: SectionStudy) -> SectionForces:
    """Section forces along a link. Raises `MechanismError` where the link's axis is not clear."""
    axis = axis_of(forces.motion.mechanism, study.link, study.points)
    with np.errstate(**QUIET):
        parts = [(rows, _of_part(part, study, axis)) for rows, part in forces.parts]
    if len(parts) == 1:
        return parts[0][1]
    width = max(part.stations.shape[1] for _, part in parts)

    def joined(value: Callable[[SectionForces], NDArray[Any]]) -> NDArray[Any]:
        first = value(parts[0][1])
        out = np.empty((forces.motion.frames, *((width,) if first.ndim == 2 else ())), first.dtype)
        for rows, part in parts:
            v = value(part)
            out[rows] = v if v.ndim == 1 else np.concatenate([v, np.repeat(v[:, -1:], width - v.shape[1], axis=1)], axis=1)
        return out

    arrays: dict[str, Any] = {name: joined(attrgetter(name)) for name in _ARRAYS}
    bending = SectionExtreme(*(joined(attrgetter(f"bending.{name}")) for name in ("values", "stations")))
    stress = None if parts[0][1].section is None else joined(attrgetter("stress"))
    return replace(parts[0][1], bending=bending, stress=stress, **arrays)


def _of_part(forces: Forces, study: SectionStudy, axis: SectionAxis) -> SectionForces:
    """Section forces of a motion with one model."""
    section_loads = _SectionLoads(forces, study, axis)
    cuts = section_loads.cuts()
    normal, shear, moment = section_loads.inside(cuts)
    whole, turning = section_loads.beyond(Cuts(np.zeros((forces.motion.frames, 1)), np.array(-1.0)))
    section, stress = study.section, None
    if section is not None:
        area, modulus = section.area, section.modulus
        stress = section_loads.largest(cuts, lambda n, m: np.abs(n) / area + np.abs(m) / modulus).values
    return SectionForces(
        link=study.link,
        axis=axis,
        section=section,
        stations=cuts.stations,
        places=axis.place(cuts),
        directions=axis.directions[axis.segment(cuts)],
        normal=normal,
        shear=shear,
        moment=moment,
        bending=section_loads.largest(cuts, lambda _, moment: moment),
        unbalanced=np.abs(whole[:, 0]) + np.abs(turning[:, 0]) / axis.length,
        stress=stress,
    )


_ARRAYS = ("stations", "places", "directions", "normal", "shear", "moment", "unbalanced")


class _SectionLoads:
    """All loads on a link in its own axes, moments about the start of its axis."""

    def __init__(self, forces: Forces, study: SectionStudy, axis: SectionAxis):
        self.forces, self.axis = forces, axis
        motion, model = forces.motion, forces.motion.model
        self.k = k = model.index[study.link]
        self.origin = _vectors(motion, motion.origins[k])
        self.back = np.conj(_vectors(motion, motion.rotation(k)))
        mass, centre, inertia = model.masses[k]
        whole = MassPart(mass, complex(centre), inertia)
        self.masses: MassLine = mass_line(axis, whole, [MassPart(m, complex(x, y), j) for m, x, y, j in study.masses])
        self.field = np.zeros(motion.frames, complex)  # force per mass at the centre of mass
        self.turn = np.zeros(motion.frames, complex)  # force per mass and distance from there
        self.points: list[_ConcentratedLoad] = []
        self.lines: list[_DistributedLoad] = []
        for load in loads_on(forces, k):
            if load.kind == "inertia":
                self.turn = self.turn - motion.accelerations.factor[model.angles.rotation_class[k]]
            if load.kind in ("inertia", "gravity"):
                self.field = self.field + (load.force / mass if mass else 0.0) * self.back
            else:
                self._act(load.place, load.force, load.moment)
        self._reactions()

    def _act(self, place: Plane, force: Plane, couple: Values) -> None:
        """Add a load at a point of the world."""
        motion = self.forces.motion
        at = (_vectors(motion, place) - self.origin) * self.back
        station = self._snapped(self.axis.nearest(at))
        self.points.append(_ConcentratedLoad(station, at, _vectors(motion, force) * self.back, _numbers(motion, couple)))

    def _snapped(self, station: Real) -> Real:
        """Stations (F,), those near a vertex of the axis, up to rounding, moved onto it."""
        for vertex in self.axis.stations:
            station = np.where(np.abs(station - vertex) <= SAME_STATION * self.axis.length, vertex, station)
        return station

    def _reactions(self) -> None:
        """Add the forces of joints on the link, drives included."""
        forces = self.forces
        model = forces.motion.model
        own = model.links[self.k]
        guides = {joint.name: joint for joint in bearings(model.mechanism)}
        for connection in model.connections:
            if own not in connection.links:
                continue
            name, sign = connection.name, 1.0 if connection.links[1] == own else -1.0
            place = _plane(forces.position(name))
            j = model.joint_index.get(name)
            if j is not None and j in model.driven:
                drive = forces.wrench(name)
                self._act(place, sign * _plane(drive), sign * drive[:, 2])
            if name in guides and self._guided(guides[name], sign):
                continue
            reaction = forces.reaction(name)
            self._act(place, sign * _plane(reaction), sign * reaction[:, 2])
        for relation in model.relations:
            if relation.bearing is not None and own in (relation.links[0], relation.bearing.carrier):
                place, reaction = _plane(forces.position(relation.name)), forces.reaction(relation.name)
                couple = relation.bearing.couple(forces.motion, place, _plane(reaction))
                self._act(place, 0j, couple if own == relation.links[0] else -couple)

    def _guided(self, joint: Prismatic, sign: float) -> bool:
        """Add the pressure of a guide along the segment that it lies on; returns whether there is such a segment."""
        load = guide_load(self.forces, joint)
        middle, direction = (load.middle - self.origin) * self.back, load.direction * self.back
        fixed = direction[int(np.argmax(np.isfinite(direction)))]  # it does not turn on either link
        parallel = np.flatnonzero(np.abs(np.imag(fixed * np.conj(self.axis.directions))) <= PARALLEL_SINE)
        if not len(parallel):
            return False
        away = middle[:, None] - self.axis.vertices[parallel]
        segment = int(parallel[int(np.argmin(np.nanmax(np.abs(np.imag(away * np.conj(self.axis.directions[parallel]))), axis=0)))])
        t = complex(self.axis.directions[segment])
        sense = sign if np.real(fixed * np.conj(t)) > 0.0 else -sign  # the force across changes its sign with the direction
        station = self.axis.stations[segment] + np.real((middle - self.axis.vertices[segment]) * np.conj(t))
        values = (sense * load.normal, sign * load.couple, sense * load.along, sign * load.rubbing)
        self.lines.append(_DistributedLoad(segment, station, middle, t, load.length, *values))
        return True

    # -- cuts ---------------------------------------------------------------------------------------------------------
    def cuts(self) -> Cuts:
        """Cuts (F, n) at evenly spaced stations, and on both sides of the stations of loads."""
        frames, length = self.forces.motion.frames, self.axis.length
        even = np.linspace(0.0, length, SECTION_GRID + 1)[1:-1]
        double = [np.tile([*self.axis.stations, *self.masses.jumps], (frames, 1)), *(p.station[:, None] for p in self.points)]
        for line in self.lines:
            half = 0.5 * line.length
            double.append(np.clip(np.stack([line.station - half, line.station + half], axis=1), 0.0, length))
        there = np.concatenate(double, axis=1)
        stations = np.concatenate([np.tile(even, (frames, 1)), there, there], axis=1)
        sides = np.concatenate([np.ones(len(even) + there.shape[1]), -np.ones(there.shape[1])])
        all_cuts = Cuts(stations, sides)
        return all_cuts.taken(np.lexsort((np.broadcast_to(sides, stations.shape), stations)))

    def inside(self, cuts: Cuts) -> tuple[Real, Real, Real]:
        """N, V and M (F, n) in cuts (F, n)."""
        force, moment = self.beyond(cuts)
        here = force * np.conj(self.axis.directions[self.axis.segment(cuts)])
        moment = moment - cross(self.axis.place(cuts) - self.axis.vertices[0], force)
        return here.real, -here.imag, moment

    def beyond(self, cuts: Cuts) -> tuple[Complex, Real]:
        """Force (F, n), complex in the link's axes, and moment about the start of the axis, of the loads beyond cuts (F, n)."""
        start = self.axis.vertices[0]
        mass, first, inertia = self.masses.beyond(cuts)
        field, turn = self.field[:, None], self.turn[:, None]
        force = field * mass + turn * first
        moment = cross(first, field) + turn.imag * inertia + cross(self.masses.centre - start, force)
        for p in self.points:
            there = cuts.before(p.station[:, None])
            force = force + np.where(there, p.force[:, None], 0.0)
            moment = moment + np.where(there, (cross(p.place - start, p.force) + p.couple)[:, None], 0.0)
        for line in self.lines:
            f, m = _of_guide(line, cuts, self.axis)
            force, moment = force + f, moment + m
        return force, moment

    def largest(self, cuts: Cuts, quantity: Callable[[Real, Real], Real]) -> SectionExtreme:
        """Largest magnitude of a quantity of N and M at every frame, refined between the neighbours of the largest one in cuts (F,
        n)."""

        def inside(cuts: Cuts) -> Real:
            normal, _, moment = self.inside(cuts)
            return quantity(normal, moment)

        values = inside(cuts)
        for _ in range(ZOOM_ROUNDS):
            k = np.argmax(np.nan_to_num(np.abs(values), nan=-1.0), axis=1)[:, None]
            low, best, high = (cuts.taken(np.clip(k + d, 0, cuts.stations.shape[1] - 1)) for d in (-1, 0, 1))
            parts = np.linspace(0.0, 1.0, ZOOM_POINTS)
            near = [a.stations + (b.stations - a.stations) * part for a, b, part in ((low, best, parts), (best, high, parts[1:]))]
            sides = [np.ones(near[0].shape), np.ones(near[1].shape)]
            sides[0][:, -1:] = best.sides
            cuts = Cuts(np.concatenate(near, axis=1), np.concatenate(sides, axis=1))
            values = inside(cuts)
        k = np.argmax(np.nan_to_num(np.abs(values), nan=-1.0), axis=1)[:, None]
        return SectionExtreme(np.take_along_axis(values, k, axis=1)[:, 0], cuts.taken(k).stations[:, 0])


def _of_guide(line: _DistributedLoad, cuts: Cuts, axis: SectionAxis) -> tuple[Complex, Real]:
    """Force, and moment about the start of the axis, of the part of a guide's pressure that acts beyond cuts."""
    half, segments = 0.5 * line.length, axis.segment(cuts)
    y = np.clip(cuts.stations - line.station[:, None], -half, half)  # from the middle to the cut
    y = np.where(segments < line.segment, -half, np.where(segments > line.segment, half, y))
    # pressure beyond the axis acts at its ends
    y = np.where(cuts.before(0.0), -half, np.where(cuts.before(axis.length), y, half))
    part = (half - y) / line.length
    slope = 12.0 * line.couple[:, None] / line.length**3
    normal, along, rubbing = line.normal[:, None], line.along[:, None], line.rubbing[:, None]
    across = normal * part + 0.5 * slope * (half * half - y * y)
    force = (along * part + 1j * across) * line.direction
    about_middle = 0.5 * normal / line.length * (half * half - y * y) + slope * (half**3 - y**3) / 3.0 + rubbing * part
    return force, cross(line.middle[:, None] - axis.vertices[0], force) + about_middle


def all_sections(forces: Forces) -> Iterator[tuple[str, SectionForces]]:
    """The section forces of a mechanism's studies, by link."""
    for study in forces.motion.mechanism.studies.sections:
        yield study.link, section_forces(forces, study)


@dataclass(frozen=True, eq=False)
class GuideLoad:
    """Load of a guide's bearing on the joint's second link, in the world, over frames (F,).

    ``middle`` of the bearing and the guide's ``direction`` are complex; ``normal`` force across the guide [N], to the left of its
    direction; ``couple`` of the pressure about the middle [N m]; of friction the force ``along`` the guide [N] and the couple
    ``rubbing`` [N m].
    """

    middle: Complex
    direction: Complex
    length: float
    normal: Real
    couple: Real
    along: Real
    rubbing: Real

    @property
    def ends(self) -> Real:
        """Forces across the guide at the bearing's two ends (F, 2) [N]: at the end behind in the guide's direction, and ahead."""
        half, turn = 0.5 * self.normal, self.couple / self.length
        return np.stack([half - turn, half + turn], axis=-1)


def bearings(mechanism: Mechanism) -> tuple[Prismatic, ...]:
    """The sliding joints whose bearings have a length."""
    return tuple(p for p in mechanism.joints if isinstance(p, Prismatic) and p.friction is not None and p.friction.length)


def guide_load(forces: Forces, joint: Prismatic) -> GuideLoad:
    """Load of a sliding joint's bearing; the force of a drive of the joint is not part of it."""
    assert joint.friction is not None
    motion, bearing = forces.motion, joint.friction
    j = motion.model.joint_index[joint.name]
    direction = _vectors(motion, motion.guide(j))
    slider = _plane(forces.position(joint.name))
    slide = _numbers(motion, motion.state.slide[j]) if bearing.bearing == "guide" else 0.0
    from_middle = slide - bearing.offset  # to the sliding point
    reaction = forces.reaction(joint.name)
    rubbing = np.zeros(motion.frames)
    if forces.friction is not None and joint.name in forces.friction.joints:
        rubbing = forces.friction.wrench(joint.name)[:, 2]
    force = _plane(reaction) * np.conj(direction)
    couple = reaction[:, 2] - rubbing + from_middle * force.imag
    middle = slider - from_middle * direction
    return GuideLoad(middle, direction, bearing.length, force.imag, couple, force.real, rubbing)


def bearing_ends(forces: Forces, joint: Prismatic) -> Real:
    """Forces across the guide at the two ends of a sliding joint's bearing (F, 2) [N], as `GuideLoad.ends`."""
    out = np.empty((forces.motion.frames, 2))
    for rows, part in forces.parts:
        out[rows] = guide_load(part, joint).ends
    return out


def _plane(rows: Real) -> Complex:
    """The first two numbers of rows (F, n) as plane vectors (F,)."""
    vectors: Complex = rows[:, 0] + 1j * rows[:, 1]
    return vectors


def _vectors(motion: Motion, value: Plane) -> Complex:
    """Plane vectors, or one for all frames, over the frames (F,)."""
    return np.broadcast_to(value + 0j, (motion.frames,))


def _numbers(motion: Motion, value: Values) -> Real:
    """Numbers, or one for all frames, over the frames (F,)."""
    return np.broadcast_to(value, (motion.frames,))
