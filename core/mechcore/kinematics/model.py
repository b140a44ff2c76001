"""A mechanism compiled: links and pairs as indices, contours, blocks in solving order. Nothing here depends on time.

Plane vectors are complex numbers. Every set of links that turns together (a *spin*, see `graph.Angles`) has one rotation
``E = exp(i angle)``; a contour is then ``sum over spins of (A + sum of s d) E = 0`` with constant ``A`` and unit vectors ``d``.
The unknowns are the angles of the groups and the displacements of the sliding pairs without a drive: nothing else.
"""

from __future__ import annotations

import cmath
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from mechcore.errors import Fault, MechanismError
from mechcore.joints.base import Joint, Relation
from mechcore.joints.parts import build_pairs
from mechcore.kinematics.terms import Split, Terms, Turning, driven_spins, point_terms, split, turning
from mechcore.spec.mechanism import Link, Mechanism
from mechcore.topology.checks import check_items, check_lengths, check_spare_angles
from mechcore.topology.graph import Angles, Contour, Tree, angles, contours, spanning_tree, structure
from mechcore.topology.order import Order, block_order

Array = Any
T = TypeVar("T")


@dataclass(frozen=True)
class SpinContour:
    """A contour summed up by spins. ``arms``: (spin, A); ``slides``: (joint, spin, d), both turned into the spin's axes."""

    closing: int
    arms: tuple[tuple[int, complex], ...]
    slides: tuple[tuple[int, int, complex], ...]


@dataclass(frozen=True)
class NonlinearTerm:
    """The nonlinear term of a relation, its argument summed up as in `LinearConstraint`, ``shift`` included."""

    function: Callable[[Any], Any]
    groups: tuple[tuple[int, float], ...]
    drives: tuple[tuple[int, float], ...]
    slides: tuple[tuple[int, float], ...]
    shift: float

    def slope(self, unknown: tuple[str, int]) -> float:
        """Derivative of the argument by an unknown."""
        return dict(self.groups if unknown[0] == "angle" else self.slides).get(unknown[1], 0.0)


@dataclass(frozen=True)
class LinearConstraint:
    """A relation between coordinates, summed up: ``sum of groups, drives, slides times coefficients + curve = constant``."""

    name: str
    groups: tuple[tuple[int, float], ...]  # unknown groups [m per rad]
    drives: tuple[tuple[int, float], ...]  # turning drives inside groups
    slides: tuple[tuple[int, float], ...]  # sliding joints
    curve: NonlinearTerm | None = None
    constant: float | None = None  # None: taken from the start


@dataclass(frozen=True)
class Block:
    """A smallest set of contours and unknowns that are solved together: an Assur group, or one contour's check.

    ``kind`` says how: ``theta_theta`` (RRR), ``theta_slide`` (RRP), ``arm_slide`` (RPR), ``slide_slide`` (RPP, PRP) are closed
    forms; ``angle`` and ``slide`` are redundant contours with one unknown, ``check`` one with none, which only have to close;
    ``relation`` is one relation with one unknown; ``general`` is Newton.
    """

    kind: str
    contours: tuple[int, ...]
    angles: tuple[int, ...]  # unknown groups
    slides: tuple[int, ...]  # unknown sliding joints
    name: str  # the pair by which users know the group
    redundant: int = 0  # equations that are left over
    relations: tuple[int, ...] = ()

    @cached_property
    def unknowns(self) -> tuple[tuple[str, int], ...]:
        """("angle", group) and ("slide", joint) of the block's unknowns."""
        return (*(("angle", g) for g in self.angles), *(("slide", j) for j in self.slides))

    @cached_property
    def dyad(self) -> bool:
        """Whether it is one contour with two unknowns."""
        return len(self.contours) == 1 and len(self.angles) + len(self.slides) == 2 and not self.relations


@dataclass(frozen=True)
class Connection:
    """A pair as results know it: ``links`` are its first and second."""

    name: str
    kind: str
    links: tuple[str, str]


@dataclass(frozen=True, eq=False)
class Model:
    """The compiled mechanism. ``points`` holds named points and ``centres`` the centres of mass in link axes."""

    mechanism: Mechanism
    links: tuple[str, ...]  # the frame first
    joints: tuple[Joint, ...]
    ends: tuple[tuple[int, int], ...]  # of each joint
    driven: Mapping[int, int]  # joint -> drive
    angles: Angles
    tree: Tree
    order: Order  # in absolute coordinates
    contours: tuple[Contour, ...]
    spin_contours: tuple[SpinContour, ...]
    relations: tuple[Relation, ...]
    constraints: tuple[LinearConstraint, ...]  # of the relations
    multi_turn: tuple[int, ...]  # groups with a closed form whose angle a relation needs beyond one turn
    blocks: tuple[Block, ...]
    free: tuple[str, ...]  # pairs around freedoms that no drive takes
    turn: tuple[complex, ...]  # of each link: rotation from its spin's axes to its own
    size: float  # characteristic length [m]
    index: Mapping[str, int] = field(default_factory=dict)  # of links
    joint_index: Mapping[str, int] = field(default_factory=dict)

    varied: Mapping[tuple[str, str], Any] = field(default_factory=dict)  # (link, point) -> places in a sweep (designs, 1)
    bodies: Mapping[str, Link] = field(default_factory=dict)  # all links, those that pairs bring along included

    all_together: bool = False  # whether reactions are solved for all joints together even where blocks would do

    @property
    def redundant(self) -> bool:
        """Whether constraints are left over, so that statics alone does not determine all reactions."""
        return bool(self.angles.spare) or any(b.redundant for b in self.blocks)

    @cached_property
    def needs_global_solve(self) -> bool:
        """Whether the reactions are solved for all joints together, instead of block by block."""
        return self.all_together or self.redundant or any(b.relations and b.kind == "general" for b in self.blocks)

    @cached_property
    def connections(self) -> tuple[Connection, ...]:
        """Everything that transmits forces between two links: joints, and the relations that are no joint themselves."""
        joints = [Connection(j.name, j.kind, j.links) for j in self.joints]
        return (*joints, *(Connection(r.name, r.kind, r.links) for r in self.relations if r.name not in self.joint_index))

    def rotary(self, pair: str) -> bool:
        """Whether a pair's coordinate is an angle [rad], not a displacement [m]; a relation of wheels counts as one that turns."""
        return pair not in self.joint_index or self.joints[self.joint_index[pair]].coordinate == "angle"

    def coordinate_scale(self, pair: str) -> float:
        """Typical size of a pair's coordinate: 1 rad, or the length scale of the mechanism [m]."""
        return 1.0 if self.rotary(pair) else self.size

    @cached_property
    def points(self) -> tuple[dict[str, complex], ...]:
        """Named points of every link in its own axes [m]; in a sweep those that vary are arrays (designs, 1)."""
        own = [{p: complex(*xy) for p, xy in self.bodies[k].points.items()} for k in self.links]
        for (link, point), values in self.varied.items():
            own[self.index[link]][point] = values
        return tuple(own)

    @cached_property
    def masses(self) -> tuple[tuple[float, complex, float], ...]:
        """(mass [kg], centre of mass in link axes [m], J_S [kg m^2]) of every link."""
        own = [self.bodies[k] for k in self.links]
        return tuple((link.mass, complex(*link.centre), link.inertia) for link in own)

    @cached_property
    def splits(self) -> Mapping[int, Split]:
        """Every contour as its block sees it."""
        return {c: split(self, b, c) for b in self.blocks for c in b.contours}

    @cached_property
    def turning(self) -> tuple[Turning, ...]:
        """Every contour by what turns in it."""
        return tuple(turning(self, c) for c in range(len(self.spin_contours)))

    @cached_property
    def driven_spins(self) -> tuple[tuple[int, tuple[tuple[int, int], ...]], ...]:
        """The spins that drives turn against their group, with (drive, sign)."""
        return driven_spins(self)

    @cached_property
    def driven_slides(self) -> tuple[tuple[int, int], ...]:
        """(joint, drive) of the driven slides."""
        return tuple((j, d) for j, d in self.driven.items() if self.joints[j].coordinate == "slide")

    @cached_property
    def guides(self) -> Mapping[int, tuple[int, complex]]:
        """Of every sliding joint the spin that its guide turns with, and the guide's direction in that spin's axes."""
        own = {j: (self.ends[j][joint.guide], joint.slide) for j, joint in enumerate(self.joints) if joint.slide is not None}
        return {j: (self.angles.spin[k], d * self.turn[k]) for j, (k, d) in own.items()}

    @cached_property
    def designs(self) -> tuple[int, ...]:
        """(D,) where D designs are computed side by side, else ()."""
        own = [np.shape(a)[:-1] for c in self.spin_contours for _, a in c.arms if np.ndim(a) > 1]
        return own[0] if own else ()

    @cached_property
    def named_terms(self) -> dict[tuple[str, str], Terms]:
        """The places of all named points as sums, where these are short."""
        found = {(link, name): self.terms(k, local) for k, link in enumerate(self.links) for name, local in self.points[k].items()}
        return {key: terms for key, terms in found.items() if terms is not None}

    @cached_property
    def _once(self) -> dict[Callable[[Model], Any], Any]:
        return {}

    def once(self, work: Callable[[Model], T]) -> T:
        """``work(self)``, done once for this model: for what later stages look up in it again and again."""
        if work not in self._once:
            self._once[work] = work(self)
        return self._once[work]

    @cached_property
    def _terms(self) -> dict[tuple[int, Array], Terms | None]:
        return {}

    def terms(self, k: int, local: Array) -> Terms | None:
        """The place of a point of link ``k``, given in link axes, as a sum (see `terms`); None where that is too long."""
        if not isinstance(local, complex):  # one place per design of a sweep
            return point_terms(self, k, local)
        key = k, local
        if key not in self._terms:
            self._terms[key] = point_terms(self, k, local)
        return self._terms[key]

    def reach(self, contour: int) -> tuple[int, ...]:
        """Unknown groups that turn the vectors of a contour."""
        groups = {self.angles.spin_group[g] for g, _ in self.spin_contours[contour].arms}
        groups |= {self.angles.spin_group[g] for _, g, _ in self.spin_contours[contour].slides}
        return tuple(sorted(groups - {0}))


def build_model(mechanism: Mechanism) -> Model:
    """Compile a mechanism: graph, contours, blocks. Raises `MechanismError` where the description contradicts itself."""
    check_items(mechanism)
    parts = build_pairs(mechanism)
    names = (mechanism.frame, *(k for k in parts.links if k != mechanism.frame))
    index = {k: i for i, k in enumerate(names)}
    joints = tuple(parts.joints)
    joint_index = {j.name: i for i, j in enumerate(joints)}
    ends = tuple((index[j.links[0]], index[j.links[1]]) for j in joints)
    turned = [k for d in mechanism.drives if d.pair in joint_index for k in joints[joint_index[d.pair]].links]
    decided = {k for k in turned if turned.count(k) > 1} | {k for r in parts.relations for k, _ in r.angles}
    check_lengths(joints, ends, names, decided)
    undrivable = [d.pair for d in mechanism.drives if d.pair not in joint_index or not joints[joint_index[d.pair]].freedoms]
    if undrivable:
        why = "has no coordinate that a drive could prescribe."
        raise MechanismError([Fault(f"joints.{p}.drive", why, "Drive a revolute or sliding pair instead.") for p in undrivable])
    driven = {joint_index[d.pair]: i for i, d in enumerate(mechanism.drives)}
    n = len(names)

    turning = angles(n, ends, joints, driven)
    check_spare_angles(mechanism, turning, joints, ends)
    order, equations = structure(n, ends, joints, driven)
    tree = spanning_tree(n, ends, order, equations)
    if len(tree.order) < n - 1:
        lost = [k for i, k in enumerate(names) if i and tree.parent[i] < 0]
        raise MechanismError([Fault(f"links.{k}", "no chain of pairs joins it to the frame.", "Add a pair.") for k in lost])
    closed = contours(ends, joints, tree)
    turn = tuple(cmath.exp(1j * o) for o in turning.offset)
    spin_contours = tuple(_by_spin(c, turning, turn) for c in closed)
    size = _size(mechanism)
    constraints = tuple(_linear_constraint(r, turning, index, joint_index) for r in parts.relations)
    blocks, loose = _blocks(spin_contours, constraints, turning, joints, ends, driven, size)
    _check_curves(blocks, constraints)
    free_angles = {g for b in blocks if b.kind in ("general", "relation") for g in b.angles}
    multi_turn = {g for t in constraints for g, _ in t.groups} - free_angles
    return Model(
        mechanism=mechanism,
        links=names,
        joints=joints,
        ends=ends,
        driven=driven,
        angles=turning,
        tree=tree,
        order=order,
        contours=closed,
        spin_contours=spin_contours,
        relations=tuple(parts.relations),
        constraints=constraints,
        multi_turn=tuple(sorted(multi_turn)),
        blocks=blocks,
        free=_free_pairs(loose, turning, joints, ends),
        turn=turn,
        size=size,
        index=index,
        joint_index=joint_index,
        bodies=parts.links,
    )


def _by_spin(contour: Contour, turning: Angles, turn: tuple[complex, ...]) -> SpinContour:
    arms: dict[int, complex] = {}
    for k, vector in contour.links:
        arms[turning.spin[k]] = arms.get(turning.spin[k], 0j) + vector * turn[k]
    slides = tuple((j, turning.spin[k], d * turn[k]) for j, k, d in contour.slides)
    return SpinContour(closing=contour.closing, arms=tuple(a for a in arms.items() if a[1] != 0), slides=slides)


def _size(m: Mechanism) -> float:
    """Characteristic length: the largest extent of a moving link's points; where they have none, of the frame's; else 1."""
    for moving in (True, False):
        best = 0.0
        for link in m.links:
            if (link.name != m.frame) == moving and len(link.points) > 1:
                x, y = zip(*link.points.values(), strict=True)
                best = max(best, max(x) - min(x), max(y) - min(y))
        if best > 0.0:
            return float(best)
    return 1.0


def _linear_constraint(
    relation: Relation, turning: Angles, index: Mapping[str, int], joint_index: Mapping[str, int]
) -> LinearConstraint:
    groups: dict[int, float] = {}
    drives: dict[int, float] = {}
    offset = 0.0  # what the links' own angles are ahead of those of their groups
    for link, c in relation.angles:
        k = index[link]
        groups[turning.group[k]] = groups.get(turning.group[k], 0.0) + c
        for d, sign in turning.spin_drives[turning.spin[k]]:
            drives[d] = drives.get(d, 0.0) + c * sign
        offset += c * turning.offset[k]
    scale = max((abs(c) for _, c in relation.angles), default=0.0)
    return LinearConstraint(
        name=relation.name,
        groups=tuple((g, c) for g, c in groups.items() if g and abs(c) > 1e-14 * scale),
        drives=tuple((d, c) for d, c in drives.items() if c != 0.0),
        slides=tuple((joint_index[j], c) for j, c in relation.slides),
        curve=_nonlinear_term(relation, turning, index, joint_index),
        constant=None if relation.constant is None else relation.constant - offset,
    )


def _nonlinear_term(
    relation: Relation, turning: Angles, index: Mapping[str, int], joint_index: Mapping[str, int]
) -> NonlinearTerm | None:
    curve = relation.curve
    if curve is None:
        return None
    inner = replace(relation, angles=curve.angles, slides=curve.slides, curve=None, constant=curve.shift)
    argument = _linear_constraint(inner, turning, index, joint_index)
    shift = 2.0 * curve.shift - float(argument.constant or 0.0)  # the links' offsets belong to the argument
    return NonlinearTerm(curve.function, argument.groups, argument.drives, argument.slides, shift)


def _check_curves(blocks: tuple[Block, ...], constraints: tuple[LinearConstraint, ...]) -> None:
    """A curve's argument must be known where its relation is solved: a cam is driven, it is not driven by its follower."""
    faults = []
    for block in blocks:
        for r in block.relations:
            curve = constraints[r].curve
            if curve is not None and any(curve.slope(u) for u in block.unknowns):
                faults.append(
                    Fault(
                        f"joints.{constraints[r].name}",
                        "here the follower drives the cam: a dwell or a reversal then leaves the cam's place open.",
                        "Drive the cam (its revolute pair, or what turns it), and let it drive the follower.",
                    )
                )
    if faults:
        raise MechanismError(faults)


def _blocks(
    spin_contours: tuple[SpinContour, ...],
    constraints: tuple[LinearConstraint, ...],
    turning: Angles,
    joints: tuple[Joint, ...],
    ends: tuple[tuple[int, int], ...],
    driven: Mapping[int, int],
    size: float,
) -> tuple[tuple[Block, ...], list[tuple[str, int]]]:
    sliding = [j for j, joint in enumerate(joints) if joint.slide is not None and j not in driven]
    columns: dict[tuple[str, int], int] = {("angle", g): g - 1 for g in range(1, turning.groups)}
    columns |= {("slide", j): turning.groups - 1 + i for i, j in enumerate(sliding)}
    unknown = list(columns)
    pattern: list[list[int]] = []
    for c in spin_contours:
        groups = {turning.spin_group[g] for g, a in c.arms if abs(a) > 1e-14 * size}
        groups |= {turning.spin_group[g] for _, g, _ in c.slides}
        row = [columns["angle", g] for g in sorted(groups - {0})]
        row += [columns["slide", j] for j, _, _ in c.slides if j not in driven]
        pattern += [row, row]
    for t in constraints:
        terms = (t,) if t.curve is None else (t, t.curve)
        row = [columns["angle", g] for x in terms for g, _ in x.groups]
        pattern.append(list(dict.fromkeys(row + [columns["slide", j] for x in terms for j, _ in x.slides if j not in driven])))
    order = block_order(pattern, len(columns))
    last = 2 * len(spin_contours)
    rows = [{e // 2 for e in equations if e < last} for equations, _ in order.blocks]
    relations = [tuple(sorted(e - last for e in equations if e >= last)) for equations, _ in order.blocks]
    placed = {c for r in rows for c in r}
    solved = {r for t in relations for r in t}
    between: dict[frozenset[int], int] = {}
    for j in sorted(range(len(ends)), key=lambda j: j in sliding):  # a joint that slides closes another group than its two links
        between.setdefault(frozenset(turning.group[k] for k in ends[j]), j)
    blocks = []
    for found, own_relations, (_, unknowns) in zip(rows, relations, order.blocks, strict=True):
        picked = [unknown[u] for u in unknowns]
        group = tuple(i for what, i in picked if what == "angle")
        slides = tuple(i for what, i in picked if what == "slide")
        own = tuple(sorted(found))
        blocks.append(
            Block(
                kind=_kind(own, own_relations, group, slides, spin_contours, turning),
                contours=own,
                angles=group,
                slides=slides,
                name=joints[_inner_pair(own, group, slides, spin_contours, between)].name
                if own
                else constraints[own_relations[0]].name,
                redundant=2 * len(own) + len(own_relations) - len(unknowns),
                relations=own_relations,
            )
        )
    for i, contour in enumerate(spin_contours):
        if i not in placed:
            blocks.append(Block("check", (i,), (), (), joints[contour.closing].name, redundant=2))
    blocks += [
        Block("check", (), (), (), t.name, redundant=1, relations=(i,)) for i, t in enumerate(constraints) if i not in solved
    ]
    return tuple(blocks), [unknown[u] for u in sorted(order.loose)]


def _kind(
    own: tuple[int, ...],
    relations: tuple[int, ...],
    group: tuple[int, ...],
    slides: tuple[int, ...],
    spin_contours: tuple[SpinContour, ...],
    turning: Angles,
) -> str:
    if relations:
        return "general" if own or len(relations) > 1 else "relation"
    if len(own) > 1:
        return "general"
    if len(group) + len(slides) == 1:
        return "angle" if group else "slide"
    if len(group) == 2:
        return "theta_theta"
    if len(slides) == 2:
        return "slide_slide"
    carrier = next(turning.spin_group[g] for j, g, _ in spin_contours[own[0]].slides if j == slides[0])
    return "arm_slide" if carrier == group[0] else "theta_slide"


def _inner_pair(
    own: tuple[int, ...],
    group: tuple[int, ...],
    slides: tuple[int, ...],
    spin_contours: tuple[SpinContour, ...],
    between: Mapping[frozenset[int], int],
) -> int:
    """The joint by which a group is known: the one between its two unknown links, else the one that slides, else the closing."""
    if len(group) == 2 and frozenset(group) in between:
        return between[frozenset(group)]
    return slides[0] if slides else spin_contours[own[0]].closing


def _free_pairs(
    loose: list[tuple[str, int]], turning: Angles, joints: tuple[Joint, ...], ends: tuple[tuple[int, int], ...]
) -> tuple[str, ...]:
    """Pairs next to unknowns that nothing determines, in words a user knows."""
    groups = {i for what, i in loose if what == "angle"}
    slides = {i for what, i in loose if what == "slide"}
    return tuple(
        joint.name
        for j, (joint, (p, q)) in enumerate(zip(joints, ends, strict=True))
        if j in slides or (joint.turns and {turning.group[p], turning.group[q]} & groups)
    )
