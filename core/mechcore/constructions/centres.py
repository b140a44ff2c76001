"""Centres of links in motion: instant centres, centres of curvature, centres of percussion.

Instant centres of all pairs of links follow by Kennedy's theorem: the centres of three links lie on one straight line.

A pin is the centre of its two links; that of a sliding joint lies at infinity, across its guide; that of a higher pair lies on the
common normal. Every other centre is the intersection of two lines, each through two centres known before. Centres are homogeneous
(x, y, w), so that one at infinity (w = 0) is no exception. The intersection is compared with the centre that the solved velocities
give; a pair that no two lines determine (in groups of class III and higher) has only the latter.

Curvature of paths: centre of curvature and evolute of a point's path, inflection circle of a link, Euler-Savary, Bobillier.

All of this is geometry: where a single drive moves, it is taken per unit of the drive's coordinate, and the drive may stand still.
With the pole P (instant centre against the frame), the angular velocity w and the acceleration a_P of the link's point at P, the
points that pass through an inflection of their paths lie on the circle with the diameter from P to the inflection pole
J = P + a_P / w^2. On a ray through P it determines all centres of curvature K (Euler-Savary): XP^2 = XK XJ', directed, where J' is
on the circle. Bobillier: the angle from the pole tangent to the ray of one point equals that from the ray of another point to the
collineation axis, which leads from P to the intersection of the line of the two points with that of their centres of curvature.

Centre of percussion of a link and the line of its inertia resultant, with the construction of that line in lectures.

With a pivot B the inertia forces have two parts: -m a_B through the centre of mass S, as of a translation with B, and -m a_SB
through the centre of percussion W on the line BS, as of a rotation about B, inertia moment included. The resultant passes through
the intersection T of the two lines; about a fixed pivot, T is W.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Literal

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.constants import ZERO_SUM
from mechcore.constructions.polygons import frames_of
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.dyads import cross
from mechcore.kinematics.model import Model
from mechcore.motion.metrics import along_motion, curvature, relative_turns
from mechcore.motion.motion import Motion
from mechcore.records import dataclass
from mechcore.reduction.bodies import percussion_centre

LEAST_SINE = 1e-6
"""Median over the frames of the sine of the angle between two lines, or of the distance of two centres, below which they are
useless."""
AT_INFINITY = 1e-9
"""A centre farther than the mechanism's size over this is at infinity."""
ROUNDING_RATE = 1e-11
"""Rates below this part of the largest in the mechanism are rounding."""
MOST_LINES = 6
"""Lines among which the two with the largest angle are chosen."""

Pair = tuple[int, int]


@dataclass(frozen=True, eq=False)
class CentreLine:
    """A straight line on which a centre lies: through ``base`` (F,) [m] along the unit vectors ``along`` (F,), NaN in frames
    without one. ``through``: names of the two centres that it joins, or of the joint whose common normal it is."""

    through: tuple[str, ...]
    base: Complex
    along: Complex


@dataclass(frozen=True, eq=False)
class InstantCentre:
    """The instant centre of two links: ``place`` (F,) [m], NaN where it lies at infinity, then in the direction ``away`` (F,).

    ``lines``: the two by which it is constructed; none for joints. ``closure_error`` (F,) [m]: distance of their intersection from
    the centre by velocities, NaN where they do not intersect.
    """

    links: tuple[str, str]
    determined_by: Literal["joint", "lines", "velocities"]
    place: Complex
    away: Complex
    lines: tuple[CentreLine, ...]
    closure_error: Real


@dataclass(frozen=True, eq=False)
class _Locus:
    """A line (F, 3) on which a centre lies: through two others, or the common normal of a joint."""

    line: Real
    pairs: tuple[Pair, ...] = ()
    joint: str = ""


def kennedy(motion: Motion, links: Sequence[str] = ()) -> dict[str, InstantCentre]:
    """The instant centres of every two of some links (none named: of all), and the centres through which their lines run.

    They are given by name: P01 is that of the frame, number 0, and of the first link in the model's order. A single drive may stand
    still. Links without relative motion count as one.
    """
    model, n = motion.model, motion.frames
    scene = _Scene(motion)
    true, bodies = scene.centres()
    normals = scene.normals(bodies, true)
    loci: dict[Pair, tuple[_Locus, ...]] = {pair: () for pair in _pins(model, bodies) if pair in true}
    while fresh := {p: _best(p, sorted(set(bodies)), loci, true, normals) for p in true if p not in loci}:
        loci |= {p: two for p, two in fresh.items() if two}  # in rounds: each centre by the shortest chain
        if not any(fresh.values()):
            break
    asked = {bodies[model.index[link]] for link in links} if links else set(bodies)
    wanted = [pair for pair in true if set(pair) <= asked]
    for pair in wanted:  # grows during the loop
        wanted += [other for locus in loci.get(pair, ()) for other in locus.pairs if other not in wanted]
    name = instant_centre_names(len(model.links))
    out = {}
    for pair in sorted(set(wanted)):
        place, away = scene.point(true[pair])
        two = loci.get(pair, ())
        lines = tuple(
            CentreLine(tuple(name[p] for p in locus.pairs) or (locus.joint,), *scene.straight(locus.line)) for locus in two
        )
        meeting = _unit(np.cross(two[0].line, two[1].line), LEAST_SINE) if two else np.full((n, 3), np.nan)
        error = np.abs(scene.point(meeting)[0] - place)
        how: Literal["joint", "lines", "velocities"] = "velocities" if pair not in loci else "lines" if two else "joint"
        out[name[pair]] = InstantCentre((model.links[pair[0]], model.links[pair[1]]), how, place, away, lines, error)
    return out


def instant_centre_names(links: int) -> dict[Pair, str]:
    """P01, P02 ...: the names of the centres of a number of ``links``, numbered from the frame, which is 0."""
    comma = "," if links > 10 else ""
    return {(a, b): f"P{a}{comma}{b}" for a, b in combinations(range(links), 2)}


class _Scene:
    """Homogeneous coordinates about the middle of a mechanism's joints, in units of its size."""

    def __init__(self, motion: Motion):
        self.motion, self.size = motion, motion.model.length_scale
        places = [frames_of(motion.joint_point(j), motion.frames) for j in range(len(motion.model.joints))]
        self.middle = complex(np.nanmean(places)) if places else 0j

    def centres(self) -> tuple[dict[Pair, Real], list[int]]:
        """Unit vectors (F, 3) of the centres by velocities, NaN where two links have no relative motion; and for each link the
        lowest number of the links against which it never moves: only links with their own number have centres."""
        crosses: dict[Pair, Real] = {}
        index = self.motion.model.index
        for (first, second), (turn, shift) in relative_turns(self.motion).items():
            at = (-1j * shift - turn * self.middle) / self.size
            crosses[index[first], index[second]] = np.stack([at.real, at.imag, turn], axis=-1)
        sizes = {pair: np.linalg.norm(c, axis=-1) for pair, c in crosses.items()}
        least = ROUNDING_RATE * np.fmax.reduce([*sizes.values(), np.zeros(self.motion.frames)])
        bodies = list(range(len(index)))
        for (a, b), size in sizes.items():
            if not (size > least).any():
                bodies = [bodies[a] if k == bodies[b] else k for k in bodies]
        return {(a, b): _unit(c, least[:, None]) for (a, b), c in crosses.items() if bodies[a] == a and bodies[b] == b}, bodies

    def normals(self, bodies: Sequence[int], true: Mapping[Pair, Real]) -> dict[Pair, list[_Locus]]:
        """Common normals of higher pairs by links, except joints out of the plane, whose centre does not lie on the normal."""
        motion, model = self.motion, self.motion.model
        lines = [(j.name, e, motion.joint_point(k), 1j * motion.guide(k))
                 for k, (j, e) in enumerate(zip(model.joints, model.ends, strict=True)) if j.freedoms == 2]  # fmt: skip
        lines += [(r.name, (model.index[r.links[0]], model.index[r.links[1]]), *r.contact(motion, 1.0)) for r in model.relations]
        loci_of: dict[Pair, list[_Locus]] = {}
        for name, ends, at, along in lines:
            pair = _pair(bodies, ends)
            z, d = ((frames_of(v, motion.frames) - m) / s for v, m, s in ((at, self.middle, self.size), (along, 0j, 1.0)))
            line = _unit(np.stack([-d.imag, d.real, z.real * d.imag - z.imag * d.real], axis=-1))
            if pair in true and _typical(np.abs((line * true[pair]).sum(axis=-1))) < LEAST_SINE:
                loci_of.setdefault(pair, []).append(_Locus(line, joint=name))
        return loci_of

    def point(self, c: Real) -> tuple[Complex, Complex]:
        """The position (F,) of a homogeneous point (F, 3), NaN at infinity, and the direction (F,) in which it then lies."""
        with np.errstate(invalid="ignore", divide="ignore"):
            far = np.abs(c[:, 2]) <= AT_INFINITY * np.hypot(c[:, 0], c[:, 1])
            z = c[:, 0] + 1j * c[:, 1]
            place = self.middle + self.size * z / np.where(far, np.nan, c[:, 2])
            return np.asarray(place, complex), np.asarray(np.where(far, z / np.abs(z), np.nan), complex)

    def straight(self, line: Real) -> tuple[Complex, Complex]:
        """The point of a line (F, 3) nearest to the middle, and its direction (F,); NaN of the line at infinity."""
        across = line[:, 0] + 1j * line[:, 1]
        with np.errstate(invalid="ignore", divide="ignore"):
            across = np.where(np.abs(across) > AT_INFINITY, across, np.nan)
            base = np.asarray(self.middle - self.size * line[:, 2] * across / np.abs(across) ** 2, complex)
            return base, np.asarray(1j * across / np.abs(across), complex)


def _pair(bodies: Sequence[int], ends: tuple[int, int]) -> Pair:
    a, b = sorted(bodies[k] for k in ends)
    return a, b


def _pins(model: Model, bodies: Sequence[int]) -> set[Pair]:
    """Pairs of links joined by a lower pair with one freedom: its centre is known."""
    bound = {r.name for r in model.relations}
    joints = zip(model.joints, model.ends, strict=True)
    return {_pair(bodies, ends) for joint, ends in joints if joint.freedoms == 1 and joint.name not in bound}


def _best(
    pair: Pair, bodies: Sequence[int], known: Mapping[Pair, object], true: Mapping[Pair, Real], normals: Mapping[Pair, list[_Locus]]
) -> tuple[_Locus, ...]:
    """The two lines through a centre with the largest angle between them, as a median over the frames; none where all are
    parallel."""
    a, b = pair
    candidates = [*normals.get(pair, ())]
    for k in bodies:
        p, q = (min(a, k), max(a, k)), (min(b, k), max(b, k))
        if k in pair or p not in known or q not in known or len(candidates) == MOST_LINES:
            continue
        line = np.cross(true[p], true[q])
        if _typical(np.linalg.norm(line, axis=-1)) > LEAST_SINE:
            candidates.append(_Locus(_unit(line), (p, q)))
    best: tuple[_Locus, ...] = ()
    most = LEAST_SINE
    for first, second in combinations(candidates, 2):
        meeting = _typical(np.linalg.norm(np.cross(first.line, second.line), axis=-1))
        if meeting > most:
            best, most = (first, second), meeting
    return best


def _typical(values: Real) -> float:
    good = values[np.isfinite(values)]
    return float(np.median(good)) if len(good) else 0.0


def _unit(vectors: Real, least: Real | float = 0.0) -> Real:
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(size > least, vectors / size, np.nan))


CUSP_SPEED = 1e-9
"""A point slower than this part of its own largest rate is at a cusp or a turning point."""
ROUNDING_LINK_RATE = 1e-12
"""Rates below this part of the largest in the mechanism are rounding."""
LEAST_RAY_SINE = 1e-9
"""Sine of the angle between two rays, and part of the mechanism's size as their length, below which Bobillier's construction
determines nothing."""


@dataclass(frozen=True, eq=False)
class PathCurvature:
    """Curvature of the path of a point: its ``place`` (F,) [m], the unit ``tangent`` (F,), the signed ``curvature`` (F,) [1/m],
    positive to the left, and the ``centre`` of curvature (F,) [m]: over the frames the evolute. NaN at a cusp, the centre also
    where the path is straight."""

    link: str
    point: str
    place: Complex
    tangent: Complex
    curvature: Real
    centre: Complex


def path_curvature(motion: Motion, link: str, point: str) -> PathCurvature:
    """Curvature of the path of a named point of a link."""
    place, rate = (along_motion(motion).point(link, point, k) @ np.array([1.0, 1.0j]) for k in (0, 1))
    curvatures = curvature(motion, link, point)
    size = motion.model.length_scale
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = np.abs(rate)
        tangent = rate / np.where(speed > CUSP_SPEED * float(np.nanmax(speed, initial=0.0)), speed, np.nan)
        centre = place + 1j * tangent / np.where(np.abs(curvatures) * size > ROUNDING_LINK_RATE, curvatures, np.nan)
    return PathCurvature(link, point, place, tangent, np.where(np.isfinite(tangent), curvatures, np.nan), centre)


@dataclass(frozen=True, eq=False)
class Bobillier:
    """Bobillier's construction of the pole tangent from two ``points`` of a link, with their ``places`` and ``centres`` of
    curvature (2, F) [m]: ``meeting`` (F,): intersection of the line of the points with that of the centres; ``tangent`` (F,): the
    pole tangent that follows, a unit vector. Both are NaN where the points are on one ray or one of them is the pole."""

    points: tuple[str, str]
    places: Complex
    centres: Complex
    meeting: Complex
    tangent: Complex


@dataclass(frozen=True, eq=False)
class InflectionCircle:
    """Inflection circle of a link against the frame: ``pole`` and inflection pole ``end`` (F,) [m], the ends of a diameter; NaN
    where the link does not turn. ``bobillier``: where the link has two pins on paths with centres of curvature."""

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
            j = np.real(np.conj(e) * (self.end - self.pole))  # intersection of circle and ray, from the pole
            return np.asarray(self.pole - e * x * j / (x - j))


def inflection_circle(motion: Motion, link: str) -> InflectionCircle:
    """The inflection circle of a moving link against the frame."""
    model, n = motion.model, motion.frames
    if link not in model.index or link == model.mechanism.frame:
        raise MechanismError(Fault("inflection", f"'{link}' is no moving link.", "Name a moving link."))
    unit, k = along_motion(motion), model.index[link]
    w, e = (np.real(frames_of(r.angular[model.angles.rotation_class[k]], n)) for r in (unit.speeds, unit.accelerations))
    at, v, a = (frames_of(unit.origin(k, order), n) for order in range(3))
    size = model.length_scale
    with np.errstate(invalid="ignore", divide="ignore"):
        arm = 1j * v / np.where(np.abs(w) * size > ROUNDING_LINK_RATE * np.abs(v), w, np.nan)
        end = at + arm + (a + (1j * e - w * w) * arm) / (w * w)
    circle = InflectionCircle(link, at + arm, end, None)
    return InflectionCircle(link, circle.pole, end, _bobillier(motion, circle))


def _bobillier(motion: Motion, circle: InflectionCircle) -> Bobillier | None:
    """Bobillier's construction by the first two pins of the link on different rays whose centres of curvature are finite in most
    frames; None where there are not two."""
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
            good = np.abs(centre - place) < size / ROUNDING_LINK_RATE**0.5
            apart = all(np.median(np.abs(cross(p - circle.pole, place - circle.pole))) > 1e-9 * size**2 for _, _, p, _ in pairs)
        if good.mean() > 0.5 and apart:
            pairs.append((joint.name, local, place, centre))
    if len(pairs) < 2:
        return None
    (first, _, a, ka), (second, _, b, kb) = pairs[:2]
    ray, other = a - circle.pole, b - circle.pole
    shorter, longer = np.fmin(np.abs(ray), np.abs(other)), np.fmax(np.abs(ray), np.abs(other))
    separate = (np.abs(cross(ray, other)) > LEAST_RAY_SINE * shorter * longer) & (shorter > LEAST_RAY_SINE * size)
    with np.errstate(invalid="ignore", divide="ignore"):
        meeting = a + np.where(separate, cross(ka - a, kb - ka), np.nan) / cross(b - a, kb - ka) * (b - a)
        turned = ray * other / (meeting - circle.pole)
        tangent = turned / np.abs(turned)
    return Bobillier((first, second), np.array([a, b]), np.array([ka, kb]), meeting, tangent)


@dataclass(frozen=True, eq=False)
class Percussion:
    """Places (F,) [m] of ``pivot`` B, ``mass_centre`` S and ``centre`` of percussion W; the inertia ``force`` (F,) [N] of the link
    as a single force through ``through`` (F,), the point of its line nearest to W, NaN where there is a couple or no force.

    ``direct``: -m a_B (F,) [N] through S; ``turned``: -m a_SB (F,) [N] through W; ``meeting`` T (F,), NaN where they are parallel.
    """

    link: str
    point: str
    pivot: Complex
    mass_centre: Complex
    centre: Complex
    force: Complex
    moment: Real
    through: Complex
    direct: Complex
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
    direct, turned = -mass * a_b, -mass * (a_s - a_b)
    sizes = np.abs(direct) + np.abs(turned)
    none = sizes <= ZERO_SUM * float(np.nanmax(sizes, initial=0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        about = moment + cross(s - struck, force)
        through = struck - 1j * force * about / np.where(np.abs(force) > ZERO_SUM * sizes, np.abs(force), np.nan) ** 2
        along = cross(struck - s, turned) / cross(direct, turned)
        still = np.abs(direct) <= 1e3 * ZERO_SUM * sizes
        meeting = np.where(still, struck, s + along * direct)
    through[none] = np.nan
    return Percussion(
        link, point, b, s, struck, force, moment, through, direct, turned, np.where(np.isfinite(meeting), meeting, np.nan)
    )
