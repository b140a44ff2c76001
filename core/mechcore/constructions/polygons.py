"""Polygons of vectors laid end to end for graphical constructions: those of velocities and accelerations; and centrodes.

Velocity and acceleration polygons are images of a mechanism's points, joined by the vectors of which they are composed. From the
pole, every link pivoted on the frame leads to the images of its points, by omega x r in the velocity polygon, by the centripetal
part -omega^2 r and the tangential part alpha x r in the acceleration polygon; couplers lead from image to image. Where a point
slides along a turning guide, the sliding velocity, or the Coriolis part 2 omega x v_r and the sliding acceleration, leads from the
image of the guide's point beneath it. Each image follows from the solved motion along a single chain of links, so that the other
chains show whether the polygon closes. Corners of the polygons are the places of the mechanism that are fixed points of one or more
links.

The moving centrode of a link rolls on the fixed one without slipping: that is the motion of the link.

Values are in the quantity's own unit (m/s, m/s^2, N); the drawing chooses a scale. Plane vectors are complex, (F,) each.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Complex, Plane, Real
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.model import Model
from mechcore.motion.metrics import along_motion
from mechcore.motion.motion import Motion
from mechcore.motion.structure import groups
from mechcore.records import dataclass

POLE = "pole"  # of a polygon of velocities or accelerations: the corner of the points at rest


@dataclass(frozen=True, eq=False)
class Edge:
    """A vector (F,) drawn from ``start`` (F,), with its label ``name``.

    ``kind``: "absolute", "relative", "normal", "tangential", "coriolis", "sliding" of motions; "reaction", "reaction normal",
    "reaction tangential", "inner", "load", "inertia", "gravity", "resultant", "ray" of forces.
    """

    name: str
    kind: str
    start: Complex
    vector: Complex

    @property
    def end(self) -> Complex:
        return self.start + self.vector


@dataclass(frozen=True, eq=False)
class Polygon:
    """A polygon of vectors over all frames.

    ``images``: named corners (F,). ``closure_error`` (F,): the largest distance between the end of a chain of sides and its target,
    in the polygon's ``unit``.
    """

    name: str
    unit: str
    edges: tuple[Edge, ...]
    images: dict[str, Complex]
    closure_error: Real

    @property
    def largest(self) -> Real:
        """The longest side of each frame (F,)."""
        return largest_side(self.edges, len(self.closure_error))

    @property
    def closing(self) -> Real:
        """Closure error relative to the longest side of the run (F,); 0 where there is no side."""
        most = float(np.nanmax(self.largest, initial=0.0))
        return self.closure_error / most if most > 0.0 else np.zeros_like(self.closure_error)


def largest_side(edges: tuple[Edge, ...], frames: int) -> Real:
    longest = np.zeros(frames)
    for e in edges:
        longest = np.fmax(longest, np.abs(e.vector))
    return longest


def frames_of(value: ArrayLike, frames: int) -> Complex:
    """A value over all frames, complex."""
    return np.array(np.broadcast_to(np.asarray(value, complex), (frames,)))


def velocity_polygon(motion: Motion) -> Polygon:
    """Velocity polygon of a motion [m/s]."""
    return _polygon(motion, 1)


def acceleration_polygon(motion: Motion) -> Polygon:
    """Acceleration polygon of a motion [m/s^2], with centripetal, tangential, Coriolis and sliding parts."""
    return _polygon(motion, 2)


def _polygon(motion: Motion, order: int) -> Polygon:
    model, n = motion.model, motion.frames
    letter = "v" if order == 1 else "a"
    corners, spans, slides = polygon_layout(model)
    zero = np.zeros(n, complex)
    at = [zero if c.fixed else frames_of(c.of(motion, order), n) for c in corners]
    images = {POLE: zero}
    for c, place in zip(corners, at, strict=True):
        if not c.fixed:
            images[_free(c.label.lower() if len(c.label) == 1 else c.label, images)] = place
    edges: list[Edge] = []
    error = np.zeros(n)
    reached: set[int] = set()  # corners to which a chain leads directly from the pole
    for s in spans:
        a, b = corners[s.start], corners[s.end]
        if b.fixed:
            continue
        r = b.of(motion, 0) - a.of(motion, 0)
        w = motion.speeds.angular[model.angles.rotation_class[s.link]]
        tail = b.label if a.fixed else _joint(b.label, a.label)
        if order == 1:
            parts = [("relative" if not a.fixed else "absolute", f"v_{tail}", 1j * w * r)]
        else:
            e = motion.accelerations.angular[model.angles.rotation_class[s.link]]
            parts = [("normal", f"a_{tail}^n", -w * w * r), ("tangential", f"a_{tail}^t", 1j * e * r)]
        error = np.fmax(error, _chain(edges, at[s.start], parts, at[s.end]))
        if a.fixed:
            reached.add(s.end)
    for slide in slides:
        error = np.fmax(error, _sliding(motion, model, slide, corners, order, edges, images, at[slide.corner]))
        if slide.guide == 0:
            reached.add(slide.corner)
    for i, c in enumerate(corners):
        if not c.fixed and (i not in reached or order == 2):
            edges.append(Edge(f"{letter}_{c.label}", "absolute", zero, at[i]))
    return Polygon("velocity" if order == 1 else "acceleration", "m/s" if order == 1 else "m/s^2", tuple(edges), images, error)


def _sliding(
    motion: Motion,
    model: Model,
    slide: Slide,
    corners: list[Corner],
    order: int,
    edges: list[Edge],
    images: dict[str, Complex],
    target: Complex,
) -> Real:
    """Add the chain from the guide's point beneath a sliding corner to the corner; returns its closure error (F,)."""
    n = motion.frames
    c = corners[slide.corner]
    d = motion.guide(slide.joint)
    under = c.of(motion, 0) - motion.origins[slide.guide]
    w = motion.speeds.angular[model.angles.rotation_class[slide.guide]]
    rate = motion.speeds.slide[slide.joint]
    if order == 1:
        start = frames_of(motion.origin_velocities[slide.guide] + 1j * w * under, n)
        parts = [("sliding" if slide.guide else "absolute", _slid("v", c.label, model.links[slide.guide], slide.guide), rate * d)]
    else:
        e = motion.accelerations.angular[model.angles.rotation_class[slide.guide]]
        start = frames_of(motion.origin_accelerations[slide.guide] + (1j * e - w * w) * under, n)
        second = motion.accelerations.slide[slide.joint]
        parts = [("sliding", f"a_{c.label}^r", second * d)]
        if slide.guide:
            parts.insert(0, ("coriolis", f"a_{c.label}^c", 2j * w * rate * d))
    if slide.guide:
        images[_free(f"{c.label.lower() if len(c.label) == 1 else c.label} on {model.links[slide.guide]}", images)] = start
        zero = np.zeros(n, complex)
        pivot = next((p for p in corners if p.fixed and any(k == slide.guide for k, _ in p.keys)), None)
        label = f"{c.label} on {model.links[slide.guide]}"
        if order == 2 and pivot is not None:
            r = c.of(motion, 0) - pivot.of(motion, 0)
            own = [("normal", f"a_{label}^n", -w * w * r), ("tangential", f"a_{label}^t", 1j * e * r)]
            error = _chain(edges, zero, own, start)
        else:
            edges.append(Edge(f"{'v' if order == 1 else 'a'}_{label}", "absolute", zero, start))
            error = np.zeros(n)
        return np.fmax(error, _chain(edges, start, parts, target))
    return _chain(edges, start, parts, target)


def _slid(letter: str, label: str, guide: str, on: int) -> str:
    return f"{letter}_{label}/{guide}" if on else f"{letter}_{label}"


def _chain(edges: list[Edge], start: Complex, parts: list[tuple[str, str, Plane]], target: Complex) -> Real:
    """Add vectors laid end to end from ``start``; returns the distance of their end from the target (F,)."""
    at = start
    for kind, name, vector in parts:
        edges.append(Edge(name, kind, at, frames_of(vector, len(start))))
        at = edges[-1].end
    return np.asarray(np.abs(at - target))


def _joint(a: str, b: str) -> str:
    return f"{a}{b}" if len(a) == 1 and len(b) == 1 else f"{a}/{b}"


def _free(name: str, taken: dict[str, Complex]) -> str:
    while name in taken:
        name += "'"
    return name


CornerKey = tuple[int, complex]


@dataclass(frozen=True, eq=False)
class Corner:
    """A place that is a fixed point of one or more links. ``label``: the name of the point; ``fixed``: it is on the frame."""

    label: str
    keys: tuple[CornerKey, ...]
    fixed: bool

    def of(self, motion: Motion, derivative: int) -> Plane:
        """Position, velocity or acceleration of the place."""
        k, local = self.keys[0]
        place: Plane = motion.of_point(k, local, derivative)
        return place


@dataclass(frozen=True)
class Span:
    """Two corners on one link: the second is reached from the first by turning with the link."""

    link: int
    start: int
    end: int


@dataclass(frozen=True)
class Slide:
    """A corner that slides along a guide: from the coinciding point of the guide's link (0: the frame) to the corner."""

    joint: int
    guide: int
    corner: int


def polygon_layout(model: Model) -> tuple[list[Corner], list[Span], list[Slide]]:
    """Corners, spans in the order of the hand method (driven links first, then group by group) and slides of a mechanism."""
    near = 1e-9 * model.length_scale
    heaps: list[list[CornerKey]] = []

    def heap(key: CornerKey) -> list[CornerKey]:
        for h in heaps:
            if any(k == key[0] and abs(z - key[1]) <= near for k, z in h):
                return h
        heaps.append([key])
        return heaps[-1]

    sliding: list[tuple[int, int, CornerKey]] = []
    for j, (joint, (p, q)) in enumerate(zip(model.joints, model.ends, strict=True)):
        a, b = (p, complex(joint.a)), (q, complex(joint.b))
        if joint.slide is None:
            first, second = heap(a), heap(b)
            if first is not second:
                first.extend(second)
                heaps[:] = [h for h in heaps if h is not second]
        else:
            surface_mark, guide = (b, p) if joint.guide == 0 else (a, q)
            heap(surface_mark)
            sliding.append((j, guide, surface_mark))
    for link, point in model.mechanism.traced:
        k = model.index[link]
        heap((k, model.points[k][point]))
    joint_at = {key: joint.name for joint, e in zip(model.joints, model.ends, strict=True)
                for key in zip(e, (joint.a, joint.b), strict=True)}  # fmt: skip
    corners = [Corner(_label(model, h, joint_at), tuple(h), any(k == 0 for k, _ in h)) for h in heaps]

    def index(key: CornerKey) -> int:
        return next(i for i, c in enumerate(corners) if any(k == key[0] and abs(z - key[1]) <= near for k, z in c.keys))

    known = {i for i, c in enumerate(corners) if c.fixed}
    surface_marks = {index(surface_mark): guide for _, guide, surface_mark in sliding}
    spans = []
    for group in groups(model):
        members = [model.index[name] for name in group.links]
        while members:
            own = {k: [i for i, c in enumerate(corners) if any(m == k for m, _ in c.keys)] for k in members}
            ready = [k for k in members if any(i in known or surface_marks.get(i) == 0 for i in own[k])]
            k = (ready or members)[0]
            members.remove(k)
            places = sorted(own[k], key=lambda i: (not corners[i].fixed, i not in known, i not in surface_marks))
            if not places:
                continue
            spans += [Span(k, places[0], i) for i in places[1:]]
            known |= set(places)
    return corners, spans, [Slide(j, guide, index(surface_mark)) for j, guide, surface_mark in sliding]


def _label(model: Model, keys: list[CornerKey], joint_at: dict[CornerKey, str]) -> str:
    """The name of a place: that of a point there, the one that most links use; else that of a joint there."""
    names: dict[str, int] = {}
    for k, local in keys:
        for name, z in model.points[k].items():
            if abs(z - local) <= 1e-9 * model.length_scale:
                names[name] = names.get(name, 0) + 1
    if names:
        return max(names, key=lambda n: (names[n], -len(n)))
    return next((joint_at[key] for key in keys if key in joint_at), model.links[keys[0][0]])


@dataclass(frozen=True, eq=False)
class Centrodes:
    """``fixed`` (F, 2) [m] in the frame's axes, ``moving`` (F, 2) [m] in the link's; NaN where the link does not turn."""

    link: str
    fixed: Real
    moving: Real


def centrodes(motion: Motion, link: str) -> Centrodes:
    """Fixed and moving centrode of a link against the frame, in the given motion (its only drive may stand still)."""
    model = motion.model
    if link not in model.index or link == model.mechanism.frame:
        raise MechanismError(Fault("centrodes", f"'{link}' is no moving link.", "Name a moving link."))
    k, n = model.index[link], motion.frames
    unit = along_motion(motion)
    turn = np.real(frames_of(unit.speeds.angular[model.angles.rotation_class[k]], n))
    rate = frames_of(unit.origin_velocities[k], n)
    with np.errstate(invalid="ignore", divide="ignore"):
        arm = 1j * rate / turn  # from the link's origin
    size = model.length_scale
    rigid = ~np.isfinite(arm) | (np.abs(turn) * size <= 1e-12 * np.fmax(np.abs(rate), np.abs(turn) * size))
    arm[rigid] = np.nan + 1j * np.nan
    fixed = frames_of(motion.origins[k], n) + arm
    moving = arm * np.conj(frames_of(motion.rotation(k), n))
    return Centrodes(link, np.column_stack([fixed.real, fixed.imag]), np.column_stack([moving.real, moving.imag]))
