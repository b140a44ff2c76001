"""Which vectors and moments are drawn: a function of the numbers, the same of a run and of its recording."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from mechcore.arrays import Flags, Index, Real
from mechcore.records import dataclass
from mechviz.picture.nodes import Arrow, MomentArc, Node
from mechviz.picture.proportions import ARC_RADIUS, ARROW_HEAD_RADIUS
from mechviz.quantities.items import ItemTable, Source, values_of
from mechviz.quantities.numbers import Numbers
from mechviz.quantities.vectors import VECTOR_FAMILIES, Moment, Scales, Vector, calm_frames, centre_name, find_scales

if TYPE_CHECKING:
    from mechviz.runs import Run


T = TypeVar("T", Vector, Moment)

LONGEST_ARROW = 1.4  # in sizes of the mechanism: only near a jam, where forces grow beyond all bounds, and there left out
SHORTEST_ARROW = 0.015  # in sizes of the mechanism; what is shorter is left out
# In sizes of the mechanism: distance of arrows that would lie on one line, head beside head
ARROW_SPACING = 2.1 * ARROW_HEAD_RADIUS
ARC_SPACING = 0.3  # of the radius of an arc: distance of arcs about one place
SAME_LINE_SINE = 0.1  # sine of the angle up to which arrows from one place lie on one line
# Arrows from two places lie on each other: ends this near the other's line and this much of them side by side, in sizes of the
# mechanism, at this part of those of some frames at which both are seen
OVERLAP_DISTANCE, OVERLAP_LENGTH, OVERLAP_SHARE = 0.008, 0.02, 0.1
OVERLAP_FRAMES = 36  # frames at which that is tried
ALL_COLUMNS, FORCE_COLUMNS, MOMENT_COLUMN, PLACE_COLUMNS = slice(None), slice(0, 2), 2, slice(3, None)  # columns of tables
ROUND_OFF = 1e-9  # of the largest moment: what is smaller throughout is not drawn


@dataclass(frozen=True, eq=False)
class Arrows:
    """Vectors and moments by family, with their scales; ``asides`` [m] of the vectors and ``radii`` [m] of the moments."""

    vectors: tuple[Vector, ...]
    moments: tuple[Moment, ...]
    scales: Scales
    asides: tuple[float, ...]
    radii: tuple[float, ...]

    def nodes(self, heights: Mapping[str, float], otherwise: float, beside: Mapping[str, float] | None = None) -> Iterator[Node]:
        """The nodes of a picture, at heights [m] by key; ``beside``: asides and radii [m] by key, where they are known."""
        known = beside or {}
        for vector, aside in zip(self.vectors, self.asides, strict=True):
            key = arrow_key(vector)
            place = known.get(key, aside)
            yield Arrow(key, owner_of(vector), vector.family, vector.entity, heights.get(key, otherwise), vector, place)
        for moment, radius in zip(self.moments, self.radii, strict=True):
            key = arrow_key(moment)
            place = known.get(key, radius)
            yield MomentArc(key, owner_of(moment), moment.family, moment.entity, heights.get(key, otherwise), moment, place)


def arrow_key(item: Vector | Moment) -> str:
    """Its key in a picture."""
    return f"{item.family}.{item.item}" + ("" if isinstance(item, Vector) else ".moment")


def owner_of(item: Vector | Moment) -> tuple[str, str]:
    """Owner of an arrow: a joint, a load, a link or a point."""
    kinds = {"applied": "load", "gravity": "link", "inertia": "link", "velocity": "point", "acceleration": "point"}
    return kinds.get(item.family, "joint"), item.item


def friction_circles(run: Run) -> frozenset[str]:
    """Pins whose friction is drawn as a circle, which the line of action touches."""
    friction = None if run.forces is None else run.forces.friction
    return frozenset() if friction is None else frozenset(e.joint for e in friction.elements if e.kind == "pin")


def arrows_of(run: Run, size: float) -> Arrows:
    """All vectors and moments of a run with their scales; ``size`` [m] is the mechanism's."""
    numbers, calm = run.numbers, calm_frames(run)
    vectors = _in_order(_vectors(numbers))
    first = find_scales(_by_family(vectors), {}, size, calm)
    moments = _moments(numbers, vectors, first, size, friction_circles(run))
    turning = find_scales({}, _by_family(moments), size, calm).newton_metres_per_metre
    return _drawn(vectors, moments, replace(first, newton_metres_per_metre=turning), size)


def with_scales(numbers: Numbers, size: float, scales: Scales, circles: Collection[str]) -> Arrows:
    """The same of a recording, whose scales and friction ``circles`` are known."""
    vectors = _in_order(_vectors(numbers))
    return _drawn(vectors, _moments(numbers, vectors, scales, size, circles), scales, size)


def _drawn(vectors: tuple[Vector, ...], moments: tuple[Moment, ...], scales: Scales, size: float) -> Arrows:
    radii = (ARC_RADIUS * size * (1.0 + ARC_SPACING * lane) for lane in _lanes(moments, size, lambda _a, _b: True))
    return Arrows(vectors, moments, scales, set_apart(vectors, scales, size), tuple(radii))


def set_apart(vectors: tuple[Vector, ...], scales: Scales, size: float) -> tuple[float, ...]:
    """How far aside [m] of its line each vector is drawn: those that ever point from one place the same way, or often lie on
    each other, stand side by side. Resultants of inertia stay on their lines of action."""
    order = sorted(range(len(vectors)), key=lambda k: vectors[k].family != "inertia")
    ordered = [vectors[k] for k in order]
    covering = _covering(ordered, scales, size)
    lanes = _lanes(ordered, size, lambda a, b: _on_one_line(a, b, scales, size), covering != 0)
    asides, senses = [0.0] * len(vectors), [1] * len(vectors)
    for n, (k, lane) in enumerate(zip(order, lanes, strict=True)):
        for i in np.flatnonzero(covering[n, :n])[:1].tolist():
            senses[n] = senses[i] * int(covering[n, i])
        if vectors[k].family != "inertia":
            asides[k] = (lane + 1) // 2 * (1 if lane % 2 else -1) * senses[n] * ARROW_SPACING * size  # 0, 1, -1, 2, -2 ...
    return tuple(asides)


def _lanes(items: Sequence[T], size: float, meet: Callable[[T, T], bool], covering: Flags | None = None) -> list[int]:
    """For each vector or moment the least number that no earlier one has which is drawn at its place and which it ``meet``s, or
    which it is ``covering`` (n, n)."""
    if not items or not len(items[0].origin):
        return [0] * len(items)
    frames = [0, len(items[0].origin) // 2]
    places = np.array([item.origin[frames] for item in items])
    lanes: list[int] = []
    for k, item in enumerate(items):
        near = np.abs(places[:k] - places[k]).max(axis=(1, 2), initial=0.0) < ROUND_OFF * size
        taken = {lanes[i] for i in np.flatnonzero(near).tolist() if meet(items[i], item)}
        if covering is not None:
            taken |= {lanes[i] for i in np.flatnonzero(covering[k, :k]).tolist()}
        lanes.append(next(lane for lane in range(len(items)) if lane not in taken))
    return lanes


def _on_one_line(a: Vector, b: Vector, scales: Scales, size: float) -> bool:
    """Whether two vectors from one place are seen and point the same way at any frame."""
    (ax, ay), (bx, by) = a.value.T, b.value.T
    with np.errstate(invalid="ignore"):
        same = np.abs(ax * by - ay * bx) < SAME_LINE_SINE * (ax * bx + ay * by)
    seen = [visible(v.value, scales.per_metre(v.family), size) for v in (a, b)]
    return bool((same & seen[0] & seen[1]).any())


def _covering(vectors: Sequence[Vector], scales: Scales, size: float) -> Index:
    """Which vectors (n, n) of two families from two places often lie on each other, 1 where they mostly point the same way then,
    -1 where they oppose, 0 elsewhere. Two reactions stay where they act, as the force of a cam's contact and that of its
    bearing."""
    if not vectors or not len(vectors[0].origin):
        return np.zeros((len(vectors), len(vectors)), int)
    frames = np.unique(np.linspace(0, len(vectors[0].origin) - 1, OVERLAP_FRAMES).astype(int))
    values = [v.value[frames] for v in vectors]
    seen = np.array([visible(value, scales.per_metre(v.family), size) for v, value in zip(vectors, values, strict=True)])  # (n, k)
    covering, together, agreeing = np.zeros((3, len(vectors), len(vectors)), int)
    with np.errstate(invalid="ignore"):  # of what is not finite, and not seen
        starts = np.array([v.origin[frames] for v in vectors]) @ [1.0, 1.0j] / size
        drawn = np.array([value / scales.per_metre(v.family) for v, value in zip(vectors, values, strict=True)])
        arrows = np.where(seen, drawn @ [1.0, 1.0j] / size, 0.0)
        for start, arrow, here in zip(starts.T, arrows.T, seen.T, strict=True):
            length = np.abs(arrow)
            along = arrow.conj() / np.where(length > 0.0, length, 1.0)
            places = (start - start[:, None]) * along[:, None]  # of each other arrow, along and across this one
            both = here[:, None] & here
            i, j = np.nonzero(both & (np.abs(places.imag) < OVERLAP_DISTANCE))
            first, second = places[i, j], places[i, j] + arrow[j] * along[i]
            low, high = np.minimum(first.real, second.real), np.maximum(first.real, second.real)
            covered = (np.minimum(high, length[i]) - np.maximum(low, 0.0) > OVERLAP_LENGTH) & (
                np.abs(second.imag) < OVERLAP_DISTANCE
            )
            covering[i, j] += covered
            agreeing[i, j] += covered * np.sign(second.real - first.real).astype(int)
            together += both
    often = covering >= np.maximum(OVERLAP_SHARE * together, 1.0)
    families = np.array([v.family for v in vectors])
    return np.where(often & often.T & (families[:, None] != families), np.where(agreeing < 0, -1, 1), 0)


def visible(vectors: Real, scale: float, size: float) -> Flags:
    """Which vectors (F, 2) are finite, long enough to be seen and short enough to make sense (F,)."""
    length = np.hypot(vectors[:, 0], vectors[:, 1]) / (size * scale)
    return np.isfinite(length) & (length > SHORTEST_ARROW) & (length < LONGEST_ARROW)


def _vectors(n: Numbers) -> Iterator[Vector]:
    places = _joint_places(n) if n.has_forces else {}
    for name in n.points:
        at = n.tables.get(("data", "points", name, "position"))
        for family in ("velocity", "acceleration"):
            table = n.tables.get(("data", "points", name, family))
            if at is not None and table is not None:
                yield Vector(family, name, at.part(ALL_COLUMNS), table.part(ALL_COLUMNS))
    for name, place in places.items():
        for family in ("reaction", "friction"):
            table = n.tables.get(("data", "joints", name, family))
            if table is not None and (family == "reaction" or np.any(np.nan_to_num(table.values[:, :2]))):
                yield Vector(family, name, place, table.part(FORCE_COLUMNS))
    for name, load in n.loads.items():
        gravity = load.kind == "gravity"
        table = n.tables.get(("data", "loads", *(("gravity", load.links[0]) if gravity else (name,))))
        if table is not None and np.any(np.nan_to_num(table.values[:, :2])):
            place, force = table.part(PLACE_COLUMNS), table.part(FORCE_COLUMNS)
            if load.points and load.links[0] == n.frame:  # what is stated acts on the ground: what acts on the link is drawn
                place, force = n.place(load.links[1], load.points[1]), -table.values[:, :2]
            yield Vector(*(("gravity", load.links[0]) if gravity else ("applied", name)), place, force)
    for name in n.links:
        table, at = _inertia(n, name)
        if table is not None and at is not None:
            yield Vector("inertia", name, n.held(partial(_line_of_inertia, at, table, n.length_scale)), table.part(FORCE_COLUMNS))
    for name in n.drives:
        table = n.tables.get(("data", "drive", name, "wrench"))
        if table is not None and name in places and np.any(table.values[:, :2]):
            yield Vector("drive", name, places[name], table.part(FORCE_COLUMNS))


def _joint_places(n: Numbers) -> dict[str, Source]:
    """Where the joints are (F, 2) [m]."""
    return {j: n.tables["data", "joints", j, "position"].part(ALL_COLUMNS) for j in n.joints}


def _inertia(n: Numbers, link: str) -> tuple[ItemTable | None, ItemTable | None]:
    """The inertia force of a link and its centre of mass."""
    return n.tables.get(("data", "links", link, "inertia")), n.tables.get(("data", "points", centre_name(link), "position"))


FARTHEST_LINE = 1e9  # lengths of the mechanism: a force whose line of action lies farther away is what rounding left of none


def _line_of_inertia(centre: ItemTable, inertia: ItemTable, length: float) -> Real:
    """Where the inertia force of a link acts (F, 2) [m]: moved from the centre of mass onto its line of action by moment over
    force, in a mechanism of a length [m]."""
    force, moment = inertia.values[:, :2], inertia.values[:, 2]
    square = (force**2).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        # the arm at right angles to the force for which arm x force = moment
        arm = np.column_stack([force[:, 1], -force[:, 0]]) * (moment / square)[:, None]
    arm[np.abs(moment) >= FARTHEST_LINE * length * np.sqrt(square)] = 0.0
    return np.asarray(centre.values + arm)


def _moments(n: Numbers, vectors: tuple[Vector, ...], scales: Scales, size: float, circles: Collection[str]) -> tuple[Moment, ...]:
    """Drive torques, moments of loads, friction and couples in joints, as far as they are more than rounding; inertia moments
    where no force carries them."""
    if not n.has_forces:
        return ()
    moments: list[Moment] = []
    places = _joint_places(n)
    for name in n.drives:
        moments.append(Moment("drive", name, places[name], n.tables["data", "drive", name, "wrench"].part(MOMENT_COLUMN)))
    for name, load in n.loads.items():
        table = None if load.kind == "gravity" else n.tables.get(("data", "loads", name))
        if table is not None and np.any(np.nan_to_num(table.values[:, 2])):
            free = not np.any(np.nan_to_num(table.values[:, :2]))
            at = _middle_of_joints(n, load.links, places) if free else table.part(PLACE_COLUMNS)
            moments.append(Moment("applied", name, at, table.part(MOMENT_COLUMN)))
    for name, place in places.items():
        reaction, friction = n.tables["data", "joints", name, "reaction"], n.tables.get(("data", "joints", name, "friction"))
        if friction is None:
            moments.append(Moment("reaction", name, place, reaction.part(MOMENT_COLUMN)))
            continue
        if name not in circles:
            moments.append(Moment("friction", name, place, friction.part(MOMENT_COLUMN)))
        moments.append(Moment("reaction", name, place, _apart(reaction.values[:, 2], friction.values[:, 2])))
    largest = max((_largest(m.value) for m in moments), default=0.0)
    pull = max((_largest(v.value) for v in vectors if v.family == "reaction"), default=0.0)
    largest = max(largest, pull * n.length_scale)  # where forces balance, all moments may be nothing
    moments = [m for m in moments if _largest(m.value) > ROUND_OFF * largest]
    return _in_order([*moments, *_inertia_moments(n, vectors, scales, size)])


def _apart(couple: Real, friction: Real) -> Real:
    """The couple of a joint; nothing where it is all friction, as of a pin."""
    same = np.abs(np.nan_to_num(couple - friction)) <= ROUND_OFF * max(_largest(couple), _largest(friction))
    return np.zeros_like(couple) if same.all() else couple


def _inertia_moments(n: Numbers, vectors: tuple[Vector, ...], scales: Scales, size: float) -> Iterator[Moment]:
    """Inertia moments of links at frames where no inertia force is there to carry them, about the centre of mass."""
    for link in n.links:
        table, centre = _inertia(n, link)
        if table is None or centre is None:
            continue
        alone = ~visible(table.values[:, :2], scales.newtons_per_metre, size)
        moment = np.where(alone, table.values[:, 2], 0.0)
        if np.any(moment):
            yield Moment("inertia", link, centre.part(ALL_COLUMNS), moment, alone)


def _middle_of_joints(n: Numbers, links: tuple[str, ...], places: Mapping[str, Source]) -> Real:
    """Where a free moment is drawn: between two links at their joint; on a link at its joint on the frame if it has one, else in
    the middle of its joints; of a link without any, a free body, at its centre of mass or origin."""
    link = next((name for name in links if name != n.frame), n.frame)
    joints = [j for j in n.joints.values() if link in j.links]
    if not joints:
        centre = n.values("data", "points", centre_name(link), "position")
        return n.poses[link][:, :2] if centre is None else centre
    between = [j for j in joints if len(links) > 1 and set(links) <= set(j.links)]
    grounded = [j for j in joints if n.frame in j.links]
    return np.asarray(np.mean([values_of(places[j.name]) for j in between[:1] or grounded[:1] or joints], axis=0))


def _in_order(items: Collection[T] | Iterator[T]) -> tuple[T, ...]:
    families = list(VECTOR_FAMILIES)
    return tuple(sorted(items, key=lambda item: families.index(item.family)))


def _by_family(items: tuple[T, ...]) -> dict[str, dict[str, T]]:
    grouped: dict[str, dict[str, T]] = {}
    for item in items:
        grouped.setdefault(item.family, {})[item.item] = item
    return grouped


def _largest(values: Real) -> float:
    return float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))
