"""The vectors and moments that are drawn. They depend on the numerical results alone, so that a run and its recording show the
same."""

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

LONGEST_ARROW = 1.4  # in sizes of the mechanism; longer arrows are left out: they occur near a jam, where forces are unbounded
SHORTEST_ARROW = 0.015  # in sizes of the mechanism; shorter arrows are left out
# In sizes of the mechanism: spacing of arrows that would lie on one line, with their heads side by side
ARROW_SPACING = 2.1 * ARROW_HEAD_RADIUS
ARC_SPACING = 0.3  # spacing of arcs about one place, relative to the radius of an arc
SAME_LINE_SINE = 0.1  # sine of the largest angle between arrows from one place that count as on one line
# Arrows from two places overlap: distance of the ends from the other's line and length of the overlap, in sizes of the mechanism,
# and the fraction of the frames with both arrows at which that has to hold
OVERLAP_DISTANCE, OVERLAP_LENGTH, OVERLAP_SHARE = 0.008, 0.02, 0.1
OVERLAP_FRAMES = 36  # frames at which overlap is checked
ALL_COLUMNS, FORCE_COLUMNS, MOMENT_COLUMN, PLACE_COLUMNS = slice(None), slice(0, 2), 2, slice(3, None)  # columns of tables
ROUND_OFF = 1e-9  # relative to the largest moment: moments that are smaller at all frames are not drawn


@dataclass(frozen=True, eq=False)
class Arrows:
    """Vectors and moments, sorted by family, with their scales; ``offsets``: lateral offsets of the vectors [m]; ``radii``: of the
    arcs of the moments [m]."""

    vectors: tuple[Vector, ...]
    moments: tuple[Moment, ...]
    scales: Scales
    offsets: tuple[float, ...]
    radii: tuple[float, ...]

    def nodes(self, heights: Mapping[str, float], otherwise: float, beside: Mapping[str, float] | None = None) -> Iterator[Node]:
        """The nodes of a picture. ``heights`` [m] by key, ``otherwise`` for the others; ``beside``: offsets and radii [m] by key
        that replace those found here."""
        known = beside or {}
        for vector, offset in zip(self.vectors, self.offsets, strict=True):
            key = arrow_key(vector)
            place = known.get(key, offset)
            yield Arrow(key, owner_of(vector), vector.family, vector.entity, heights.get(key, otherwise), vector, place)
        for moment, radius in zip(self.moments, self.radii, strict=True):
            key = arrow_key(moment)
            place = known.get(key, radius)
            yield MomentArc(key, owner_of(moment), moment.family, moment.entity, heights.get(key, otherwise), moment, place)


def arrow_key(item: Vector | Moment) -> str:
    """Key of a vector or moment in a picture."""
    return f"{item.family}.{item.item}" + ("" if isinstance(item, Vector) else ".moment")


def owner_of(item: Vector | Moment) -> tuple[str, str]:
    """Kind ("joint", "load", "link" or "point") and name of the owner of a vector or moment."""
    kinds = {"applied": "load", "gravity": "link", "inertia": "link", "velocity": "point", "acceleration": "point"}
    return kinds.get(item.family, "joint"), item.item


def friction_circles(run: Run) -> frozenset[str]:
    """Names of the pins whose friction is drawn as a friction circle."""
    friction = None if run.forces is None else run.forces.friction
    return frozenset() if friction is None else frozenset(e.joint for e in friction.elements if e.kind == "pin")


def arrows_of(run: Run, size: float) -> Arrows:
    """All vectors and moments of a run with their scales; ``size``: of the mechanism [m]."""
    numbers, calm = run.numbers, calm_frames(run)
    vectors = _in_order(_vectors(numbers))
    first = find_scales(_by_family(vectors), {}, size, calm)
    moments = _moments(numbers, vectors, first, size, friction_circles(run))
    turning = find_scales({}, _by_family(moments), size, calm).newton_metres_per_metre
    return _drawn(vectors, moments, replace(first, newton_metres_per_metre=turning), size)


def with_scales(numbers: Numbers, size: float, scales: Scales, circles: Collection[str]) -> Arrows:
    """All vectors and moments of a recording with given scales; ``circles``: names of the pins with friction circles."""
    vectors = _in_order(_vectors(numbers))
    return _drawn(vectors, _moments(numbers, vectors, scales, size, circles), scales, size)


def _drawn(vectors: tuple[Vector, ...], moments: tuple[Moment, ...], scales: Scales, size: float) -> Arrows:
    radii = (ARC_RADIUS * size * (1.0 + ARC_SPACING * lane) for lane in _lanes(moments, size, lambda _a, _b: True))
    return Arrows(vectors, moments, scales, lateral_offsets(vectors, scales, size), tuple(radii))


def lateral_offsets(vectors: tuple[Vector, ...], scales: Scales, size: float) -> tuple[float, ...]:
    """Lateral offset [m] of each vector from its line. Vectors that at some frame point in the same direction from one place, or
    that often overlap, are drawn side by side. Resultants of inertia stay on their lines of action."""
    order = sorted(range(len(vectors)), key=lambda k: vectors[k].family != "inertia")
    ordered = [vectors[k] for k in order]
    covering = _covering(ordered, scales, size)
    lanes = _lanes(ordered, size, lambda a, b: _on_one_line(a, b, scales, size), covering != 0)
    offsets, senses = [0.0] * len(vectors), [1] * len(vectors)
    for n, (k, lane) in enumerate(zip(order, lanes, strict=True)):
        for i in np.flatnonzero(covering[n, :n])[:1].tolist():
            senses[n] = senses[i] * int(covering[n, i])
        if vectors[k].family != "inertia":
            offsets[k] = (lane + 1) // 2 * (1 if lane % 2 else -1) * senses[n] * ARROW_SPACING * size  # 0, 1, -1, 2, -2 ...
    return tuple(offsets)


def _lanes(items: Sequence[T], size: float, meet: Callable[[T, T], bool], covering: Flags | None = None) -> list[int]:
    """Lane number of each vector or moment: the least one that no conflicting earlier item has. Items conflict where they are drawn
    at the same place and ``meet`` is true, or where ``covering`` (n, n) is true."""
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
    """Whether two vectors from one place are both visible and point in the same direction at any frame."""
    (ax, ay), (bx, by) = a.value.T, b.value.T
    with np.errstate(invalid="ignore"):
        same = np.abs(ax * by - ay * bx) < SAME_LINE_SINE * (ax * bx + ay * by)
    seen = [visible(v.value, scales.per_metre(v.family), size) for v in (a, b)]
    return bool((same & seen[0] & seen[1]).any())


def _covering(vectors: Sequence[Vector], scales: Scales, size: float) -> Index:
    """Matrix (n, n) of the vectors that often overlap, from two places and of two families: 1 where they mostly point in the same
    direction then, -1 where they mostly oppose, 0 elsewhere. Vectors of one family are not moved: two reactions, such as those at a
    cam's contact and at its bearing, stay where they act."""
    if not vectors or not len(vectors[0].origin):
        return np.zeros((len(vectors), len(vectors)), int)
    frames = np.unique(np.linspace(0, len(vectors[0].origin) - 1, OVERLAP_FRAMES).astype(int))
    values = [v.value[frames] for v in vectors]
    seen = np.array([visible(value, scales.per_metre(v.family), size) for v, value in zip(vectors, values, strict=True)])  # (n, k)
    covering, together, agreeing = np.zeros((3, len(vectors), len(vectors)), int)
    with np.errstate(invalid="ignore"):  # values that are not finite, and not visible
        starts = np.array([v.origin[frames] for v in vectors]) @ [1.0, 1.0j] / size
        drawn = np.array([value / scales.per_metre(v.family) for v, value in zip(vectors, values, strict=True)])
        arrows = np.where(seen, drawn @ [1.0, 1.0j] / size, 0.0)
        for start, arrow, here in zip(starts.T, arrows.T, seen.T, strict=True):
            length = np.abs(arrow)
            along = arrow.conj() / np.where(length > 0.0, length, 1.0)
            places = (start - start[:, None]) * along[:, None]  # starts of the other arrows, along and across each arrow
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
    """Whether vectors (F, 2) are finite and their arrows neither too short nor too long to be drawn (F,)."""
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
            if load.points and load.links[0] == n.frame:  # the table has the force on the ground: draw that on the link
                place, force = n.world_positions(load.links[1], load.points[1]), -table.values[:, :2]
            yield Vector(*(("gravity", load.links[0]) if gravity else ("applied", name)), place, force)
    for name in n.links:
        table, at = _inertia(n, name)
        if table is not None and at is not None:
            yield Vector(
                "inertia", name, n.derived_source(partial(_line_of_inertia, at, table, n.length_scale)), table.part(FORCE_COLUMNS)
            )
    for name in n.drives:
        table = n.tables.get(("data", "drive", name, "wrench"))
        if table is not None and name in places and np.any(table.values[:, :2]):
            yield Vector("drive", name, places[name], table.part(FORCE_COLUMNS))


def _joint_places(n: Numbers) -> dict[str, Source]:
    """Positions (F, 2) [m] of the joints."""
    return {j: n.tables["data", "joints", j, "position"].part(ALL_COLUMNS) for j in n.joints}


def _inertia(n: Numbers, link: str) -> tuple[ItemTable | None, ItemTable | None]:
    """The tables of a link's inertia force and of its centre of mass; None where there is none."""
    return n.tables.get(("data", "links", link, "inertia")), n.tables.get(("data", "points", centre_name(link), "position"))


FARTHEST_LINE = 1e9  # in lengths of the mechanism: a force whose line of action is farther away is rounding


def _line_of_inertia(centre: ItemTable, inertia: ItemTable, length: float) -> Real:
    """Point of action (F, 2) [m] of a link's inertia force: the centre of mass, moved by moment over force onto the line of action
    of the resultant. ``length``: of the mechanism [m]."""
    force, moment = inertia.values[:, :2], inertia.values[:, 2]
    square = (force**2).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        # the arm perpendicular to the force, with arm x force = moment
        arm = np.column_stack([force[:, 1], -force[:, 0]]) * (moment / square)[:, None]
    arm[np.abs(moment) >= FARTHEST_LINE * length * np.sqrt(square)] = 0.0
    return np.asarray(centre.values + arm)


def _moments(n: Numbers, vectors: tuple[Vector, ...], scales: Scales, size: float, circles: Collection[str]) -> tuple[Moment, ...]:
    """Drive torques, moments of loads, friction moments and couples in joints that exceed rounding; inertia moments at frames where
    no inertia force is drawn."""
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
    largest = max(largest, pull * n.length_scale)  # all moments may be rounding of the forces
    moments = [m for m in moments if _largest(m.value) > ROUND_OFF * largest]
    return _in_order([*moments, *_inertia_moments(n, vectors, scales, size)])


def _apart(couple: Real, friction: Real) -> Real:
    """The couple (F,) of a joint; zero where all of it is friction, as in a pin."""
    same = np.abs(np.nan_to_num(couple - friction)) <= ROUND_OFF * max(_largest(couple), _largest(friction))
    return np.zeros_like(couple) if same.all() else couple


def _inertia_moments(n: Numbers, vectors: tuple[Vector, ...], scales: Scales, size: float) -> Iterator[Moment]:
    """Inertia moments of links about the centre of mass, at frames where no inertia force is visible that would include them."""
    for link in n.links:
        table, centre = _inertia(n, link)
        if table is None or centre is None:
            continue
        alone = ~visible(table.values[:, :2], scales.newtons_per_metre, size)
        moment = np.where(alone, table.values[:, 2], 0.0)
        if np.any(moment):
            yield Moment("inertia", link, centre.part(ALL_COLUMNS), moment, alone)


def _middle_of_joints(n: Numbers, links: tuple[str, ...], places: Mapping[str, Source]) -> Real:
    """Place (F, 2) [m] of a free moment: between two links at their joint; on a link at its joint on the frame, or without one in
    the middle of its joints; on a free body at its centre of mass or origin."""
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
