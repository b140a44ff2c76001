"""Force polygons: of the structural groups, and with its rays the funicular (string) polygon of any plane force system.

Groups: the closed polygon of forces of every group, in the order of the hand method (last group first). At an outer pin of a group
the reaction is resolved along and across its link. The part across (t) follows from the moments about the link's inner pin, as by
hand, and not from the solved reactions; the part along (n) is that of the solved reaction. So the polygon closes only if moments
and reactions agree. In a dyad the reaction of the inner joint is the diagonal that closes the polygon of each link.

Funicular polygon: the forces are laid end to end; rays lead from a pole O to the corners of this force polygon; string i is
parallel to ray i, and two consecutive strings meet on the line of the force between their rays. First and last string meet on the
line of the resultant. A closed force polygon with parallel outer strings is a couple, with the same outer string equilibrium.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechcore.arrays import Complex, Real, Values
from mechcore.constants import ZERO_SUM
from mechcore.constructions.polygons import Edge, Polygon, frames_of
from mechcore.forces.kinetostatics import LABELS, Forces, loads_on
from mechcore.kinematics.dyads import cross
from mechcore.kinematics.model import Model
from mechcore.motion.structure import groups
from mechcore.records import dataclass
from mechcore.reduction.reduced import REDUCED_KINDS, reduce_to


def force_polygons(forces: Forces) -> tuple[Polygon, ...]:
    """One polygon [N] for every group, the last group first, the driven links at the end."""
    model = forces.motion.model
    return tuple(_group(forces, [model.index[k] for k in g.links], " + ".join(g.links)) for g in reversed(groups(model)))


def _group(forces: Forces, own: list[int], name: str) -> Polygon:
    motion = forces.motion
    model, n = motion.model, motion.frames
    ends = {c.name: tuple(model.index[k] for k in c.links) for c in model.connections}
    inner = [c for c, e in ends.items() if set(e) <= set(own)]
    outer = [c for c, e in ends.items() if len(set(e) & set(own)) == 1]
    outer.sort(key=lambda c: (own.index(_own(ends[c], own)), 0 in ends[c]))
    first = [c for c in outer if _own(ends[c], own) == own[0]][:1] if len(outer) > 1 else []
    sides: list[tuple[str, str, Complex]] = []
    for c in first:
        sides += _reaction(forces, c, ends, own)
    mark = 0
    for k in own:
        for load in loads_on(forces, k):
            value = frames_of(load.force, n)
            if np.any(np.abs(value) > 0.0):
                sides.append((load.kind if load.kind in LABELS else "load", load.label, value))
        if k == own[0]:
            mark = len(sides)
    for c in outer:
        if c not in first:
            sides += reversed(_reaction(forces, c, ends, own))
    edges: list[Edge] = []
    at = np.zeros(n, complex)
    images = {"start": at}
    for i, (kind, label, vector) in enumerate(sides):
        edges.append(Edge(label, kind, at, frames_of(vector, n)))
        at = edges[-1].end
        if i + 1 == mark and len(own) == 2 and len(inner) == 1 and len(first) == 1 and len(outer) == 2:
            pull = _on(forces, inner[0], ends, own[0])
            edges.append(Edge(f"R_{inner[0]}", "inner", at, frames_of(pull, n)))
    return Polygon(name, "N", tuple(edges), images, np.abs(at))


def _own(ends: tuple[int, ...], own: list[int]) -> int:
    return next(k for k in ends if k in own)


def _wrench(forces: Forces, joint: str) -> tuple[Complex, Real]:
    """Force and couple on a joint's second link, drive included, at the joint's position."""
    total = forces.reaction(joint)
    j = forces.motion.model.joint_index.get(joint)
    if j is not None and j in forces.motion.model.driven:
        total = total + forces.wrench(joint)
    return total[:, 0] + 1j * total[:, 1], total[:, 2]


def _on(forces: Forces, joint: str, ends: dict[str, tuple[int, ...]], link: int) -> Complex:
    return _wrench(forces, joint)[0] * (1.0 if ends[joint][1] == link else -1.0)


def _reaction(forces: Forces, joint: str, ends: dict[str, tuple[int, ...]], own: list[int]) -> list[tuple[str, str, Complex]]:
    """An outer reaction on the group: normal, then tangential part where its link has two pins, else as a whole."""
    model: Model = forces.motion.model
    link = _own(ends[joint], own)
    force = _on(forces, joint, ends, link)
    here = [c for c, e in ends.items() if link in e]
    inner = [c for c in here if set(ends[c]) <= set(own)]
    kinds = {c.name: c.kind for c in model.connections}
    driven = {model.joints[j].name for j in model.driven}
    whole = [("reaction", f"R_{joint}", force)]
    if len(here) != 2 or len(inner) != 1 or kinds[joint] != "revolute" or kinds[inner[0]] != "revolute" or set(here) & driven:
        return whole
    place = {c: forces.position(c) @ np.array([1.0, 1.0j]) for c in here}
    arm = place[joint] - place[inner[0]]
    length = np.abs(arm)
    if np.any(length <= 1e-12 * model.length_scale):
        return whole
    unit = arm / length
    moment: Values = np.zeros(forces.motion.frames)
    for load in loads_on(forces, link):
        moment = moment + load.moment + cross(load.place - place[inner[0]], load.force)
    for c in here:  # couples that pins transmit, by friction for instance
        moment = moment + _wrench(forces, c)[1] * (1.0 if ends[c][1] == link else -1.0)
    across = -moment / length * 1j * unit
    along = np.real(force * np.conj(unit)) * unit
    return [("reaction normal", f"R_{joint}^n", along), ("reaction tangential", f"R_{joint}^t", across)]


@dataclass(frozen=True, eq=False)
class Funicular:
    """The construction over all frames, plane vectors complex.

    ``points``, ``forces`` (F, n): the system, couples as two forces. ``corners`` (F, n + 1): of the force polygon, from zero;
    ``pole`` (F,). ``knots`` (F, n): intersections of strings on the lines of the forces. ``meeting`` (F,): intersection of the
    outer strings, NaN if they are parallel. ``kind`` (F,): the result of the drawing, see `REDUCED_KINDS`. ``moment`` (F,): of the
    outer strings about the world's origin [N m]. ``closure_error`` (F,): its difference from the computed moment [N m]; ``scale``
    (F,) [N m]: the largest force times the system's size; ``extent`` [m]: this size.
    """

    names: tuple[str, ...]
    points: Complex
    forces: Complex
    corners: Complex
    pole: Complex
    knots: Complex
    meeting: Complex
    kind: NDArray[np.str_]
    moment: Real
    closure_error: Real
    scale: Real
    extent: float

    @property
    def rays(self) -> Complex:
        """From the pole to the corners (F, n + 1); also the forces in the strings."""
        return self.corners - self.pole[:, None]

    @property
    def resultant(self) -> Complex:
        return self.corners[:, -1]

    @property
    def closing(self) -> Real:
        """Closure error relative to the largest force of the run times the system's size (F,)."""
        most = float(self.scale.max(initial=0.0))
        return self.closure_error / most if most > 0.0 else np.zeros_like(self.closure_error)

    def polygon(self) -> Polygon:
        """The force polygon with its rays [N]."""
        edges = [Edge(name, "load", self.corners[:, i], self.forces[:, i]) for i, name in enumerate(self.names)]
        edges.append(Edge("R", "resultant", np.zeros(len(self.pole), complex), self.resultant))
        edges += [Edge(str(i), "ray", self.pole, self.rays[:, i]) for i in range(self.corners.shape[1])]
        error = np.abs(self.forces.sum(axis=1) - self.resultant)
        return Polygon("funicular", "N", tuple(edges), {"O": self.pole}, error)


def funicular(
    points: ArrayLike,
    forces: ArrayLike,
    couples: ArrayLike | None = None,
    *,
    pole: ArrayLike | None = None,
    names: tuple[str, ...] = (),
) -> Funicular:
    """Funicular polygon of forces (F, n, 2) [N] at points (F, n, 2) [m] with couples (F, n) [N m]; a single system may leave out F.

    ``pole``: (2,) or (F, 2) [N] from the start of the force polygon; None: one with no string nearly parallel to its force. Forces
    that vanish are passed over. The first string is drawn through the first force's point.
    """
    f = _complex(forces)
    p = np.array(np.broadcast_to(_complex(points), f.shape))
    labels = list(names) or [f"F{i + 1}" for i in range(f.shape[1])]
    extent = _extent(p)
    if couples is not None and np.any(np.asarray(couples)):
        p, f, labels = _with_couples(p, f, np.atleast_2d(np.asarray(couples, float)), labels, extent)
        extent = _extent(p)
    corners = np.concatenate([np.zeros((len(f), 1), complex), np.cumsum(f, axis=1)], axis=1)
    sizes = np.abs(f).sum(axis=1)
    o = _best_pole(corners, f) if pole is None else np.array(np.broadcast_to(_complex(pole)[:, 0], len(f)))
    rays = corners - o[:, None]
    knots = np.empty_like(p)
    least = ZERO_SUM * max(float(sizes.max(initial=0.0)), 1e-300)
    knots[:, 0] = p[:, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        for i in range(1, f.shape[1]):
            before, ray, away = knots[:, i - 1], rays[:, i], p[:, i] - knots[:, i - 1]
            along = cross(away, f[:, i]) / cross(ray, f[:, i])
            passing = np.real(away * np.conj(ray)) / np.abs(ray) ** 2  # the string has no corner at a force that vanishes
            knots[:, i] = before + np.where(np.abs(f[:, i]) <= least, passing, along) * ray
        first, last = rays[:, 0], rays[:, -1]
        reach = cross(knots[:, -1] - knots[:, 0], last) / cross(first, last)
        meeting = knots[:, 0] + reach * first
    r = corners[:, -1]
    middle = p.mean(axis=1)
    drawn = cross(knots[:, -1] - middle, last) - cross(knots[:, 0] - middle, first)
    _, algebra = reduce_to(_pairs(p), _pairs(f), about=_pairs(middle))
    scale = np.abs(f).max(axis=1) * extent
    pushes = np.abs(r) > ZERO_SUM * sizes
    turns = np.abs(drawn) > 1e3 * ZERO_SUM * sizes * extent
    kind = np.where(pushes, REDUCED_KINDS[2], np.where(turns, REDUCED_KINDS[1], REDUCED_KINDS[0]))
    meeting = np.where(pushes, meeting, np.nan + 1j * np.nan)
    return Funicular(
        names=tuple(labels),
        points=p,
        forces=f,
        corners=corners,
        pole=o,
        knots=knots,
        meeting=meeting,
        kind=np.asarray(kind, dtype=np.str_),
        moment=drawn + cross(middle, r),
        closure_error=np.abs(drawn - algebra),
        scale=scale,
        extent=extent,
    )


def _complex(values: ArrayLike) -> Complex:
    """Rows (..., n, 2) or (..., 2) -> complex with a leading frame axis."""
    v = np.asarray(values, float)
    z = v[..., 0] + 1j * v[..., 1]
    return np.atleast_2d(z) if z.ndim < 2 and v.ndim == 2 else np.atleast_1d(z)[:, None] if z.ndim == 0 else z


def _pairs(z: Complex) -> Real:
    """Complex -> rows (..., 2)."""
    return np.stack([z.real, z.imag], axis=-1)


def _extent(p: Complex) -> float:
    """Size of the system: the largest distance of its points from their middle, over all frames; 1 m where all are at one place, up
    to rounding."""
    size = float(np.abs(p - p.mean(axis=1)[:, None]).max(initial=0.0))
    return size if size > ZERO_SUM * float(np.abs(p).max(initial=0.0)) else 1.0


def _with_couples(p: Complex, f: Complex, couples: Real, names: list[str], extent: float) -> tuple[Complex, Complex, list[str]]:
    """Couples as pairs of opposite vertical forces, at half the system's size on either side of their point."""
    points, forces, labels = [*p.T], [*f.T], list(names)
    couples = np.broadcast_to(couples, f.shape)
    for i in range(f.shape[1]):
        if np.any(couples[:, i]):
            arm = 0.5 * extent
            for sign in (-1.0, 1.0):
                points.append(p[:, i] + sign * arm)
                forces.append(sign * 1j * couples[:, i] / (2.0 * arm))
                labels.append(f"{names[i]} {'-' if sign < 0 else '+'}")
    kept = [i for i in range(len(forces)) if i >= f.shape[1] or np.any(np.abs(forces[i]) > 0.0) or not np.any(couples[:, i])]
    return np.array([points[i] for i in kept]).T, np.array([forces[i] for i in kept]).T, [labels[i] for i in kept]


def _best_pole(corners: Complex, forces: Complex) -> Complex:
    """A pole beside the force polygon, at the same place relative to it in all frames, such that no ray is nearly parallel to a
    force, and the outer rays not to each other; where one place does not suit a frame, the frame has its own best one."""
    middle = corners.mean(axis=1)
    size = float(np.abs(corners - middle[:, None]).max(initial=0.0)) or 1.0
    offsets = [size * rho * np.exp(1j * t) for rho in (0.9, 1.3) for t in np.linspace(0.0, 2.0 * np.pi, 36, endpoint=False)]
    quality = np.array([_quality(corners, forces, middle + z, size) for z in offsets])  # (poles, F)
    best = int(np.argmax(quality.min(axis=1)))
    own = np.argmax(quality, axis=0)
    chosen = np.where(quality[best] > 0.05, best, own)
    return np.asarray(middle + np.array(offsets)[chosen])


def _quality(corners: Complex, forces: Complex, pole: Complex, size: float) -> Real:
    """Sine of the smallest angle between a string and its force, and between the outer strings where the resultant is not small."""
    rays = corners - pole[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        sines = np.abs(cross(rays[:, :-1], forces)) / (np.abs(rays[:, :-1]) * np.abs(forces))
        after = np.abs(cross(rays[:, 1:], forces)) / (np.abs(rays[:, 1:]) * np.abs(forces))
    worst = np.nanmin(np.where(np.abs(forces) <= 1e-9 * size, np.nan, np.fmin(sines, after)), axis=1, initial=1.0)
    r = corners[:, -1]
    with np.errstate(invalid="ignore", divide="ignore"):
        outer = np.abs(cross(rays[:, 0], rays[:, -1])) / (np.abs(rays[:, 0]) * np.abs(rays[:, -1]))
    return np.asarray(np.where(np.abs(r) > 0.05 * size, np.fmin(worst, outer), worst))
