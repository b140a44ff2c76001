"""A mechanism compiled: links and pairs as indices, contours, blocks in solving order. Nothing here depends on time.

Plane vectors are complex numbers. Every set of links that turns together (a *spin*, see `graph.Angles`) has one rotation
``E = exp(i angle)``; a contour is then ``sum over spins of (A + sum of s d) E = 0`` with constant ``A`` and unit vectors ``d``.
The unknowns are the angles of the groups and the displacements of the sliding pairs without a drive: nothing else.
"""

from __future__ import annotations

import cmath
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from .errors import Fault, MechanismError
from .graph import Angles, Contour, Tree, angles, contours, spanning_tree, structure
from .order import Order, block_order
from .pairs import Joint, joint_of, point_of
from .spec import Mechanism

__all__ = ["Block", "Model", "SpinContour", "build_model"]


@dataclass(frozen=True)
class SpinContour:
    """A contour summed up by spins. ``arms``: (spin, A); ``slides``: (joint, spin, d), both turned into the spin's axes."""

    closing: int
    arms: tuple[tuple[int, complex], ...]
    slides: tuple[tuple[int, int, complex], ...]


@dataclass(frozen=True)
class Block:
    """A smallest set of contours and unknowns that are solved together: an Assur group, or one contour's check.

    ``kind`` says how: ``theta_theta`` (RRR), ``theta_slide`` (RRP), ``arm_slide`` (RPR), ``slide_slide`` (RPP, PRP) are closed
    forms; ``angle`` and ``slide`` are redundant contours with one unknown, ``check`` one with none, which only have to close;
    ``general`` is Newton.
    """

    kind: str
    contours: tuple[int, ...]
    angles: tuple[int, ...]  # unknown groups
    slides: tuple[int, ...]  # unknown sliding joints
    name: str  # the pair by which users know the group
    redundant: int = 0  # equations that are left over


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
    blocks: tuple[Block, ...]
    free: tuple[str, ...]  # pairs around freedoms that no drive takes
    turn: tuple[complex, ...]  # of each link: rotation from its spin's axes to its own
    size: float  # characteristic length [m]
    index: Mapping[str, int] = field(default_factory=dict)  # of links
    joint_index: Mapping[str, int] = field(default_factory=dict)

    @cached_property
    def points(self) -> tuple[dict[str, complex], ...]:
        by_name = {link.name: link for link in self.mechanism.links}
        return tuple({p: point_of(by_name[k], p) for p in by_name[k].points} for k in self.links)

    @cached_property
    def masses(self) -> tuple[tuple[float, complex, float], ...]:
        """(mass [kg], centre of mass in link axes [m], J_S [kg m^2]) of every link."""
        by_name = {link.name: link for link in self.mechanism.links}
        return tuple((by_name[k].mass, complex(*by_name[k].centre), by_name[k].inertia) for k in self.links)

    def reach(self, contour: int) -> tuple[int, ...]:
        """Unknown groups that turn the vectors of a contour."""
        groups = {self.angles.spin_group[g] for g, _ in self.spin_contours[contour].arms}
        groups |= {self.angles.spin_group[g] for _, g, _ in self.spin_contours[contour].slides}
        return tuple(sorted(groups - {0}))


def build_model(mechanism: Mechanism) -> Model:
    """Compile a mechanism: graph, contours, blocks. Raises `MechanismError` where the description contradicts itself."""
    _check(mechanism)
    by_name = {link.name: link for link in mechanism.links}
    names = (mechanism.frame, *(link.name for link in mechanism.links if link.name != mechanism.frame))
    index = {k: i for i, k in enumerate(names)}
    joints = tuple(joint_of(p, by_name[p.links[0]], by_name[p.links[1]]) for p in mechanism.pairs)
    joint_index = {j.name: i for i, j in enumerate(joints)}
    ends = tuple((index[j.links[0]], index[j.links[1]]) for j in joints)
    driven = {joint_index[d.pair]: i for i, d in enumerate(mechanism.drives)}
    n = len(names)

    turning = angles(n, ends, joints, driven)
    order, equations = structure(n, ends, joints, driven)
    tree = spanning_tree(n, ends, order, equations)
    if len(tree.order) < n - 1:
        lost = [k for i, k in enumerate(names) if i and tree.parent[i] < 0]
        raise MechanismError([Fault(f"links.{k}", "no chain of pairs joins it to the frame.", "Add a pair.") for k in lost])
    closed = contours(ends, joints, tree)
    turn = tuple(cmath.exp(1j * o) for o in turning.offset)
    sums = tuple(_by_spin(c, turning, turn) for c in closed)
    size = _size(mechanism)
    blocks, loose = _blocks(sums, turning, joints, ends, driven, size)
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
        spin_contours=sums,
        blocks=blocks,
        free=_free_pairs(loose, turning, joints, ends),
        turn=turn,
        size=size,
        index=index,
        joint_index=joint_index,
    )


def _check(m: Mechanism) -> None:
    faults = []
    links = {link.name: link for link in m.links}
    if len(links) != len(m.links):
        faults.append(Fault("links", "two links have the same name."))
    if len({p.name for p in m.pairs}) != len(m.pairs):
        faults.append(Fault("pairs", "two pairs have the same name."))
    if m.frame not in links:
        faults.append(Fault("frame", f"there is no link '{m.frame}'."))
    for p in m.pairs:
        for link, point in zip(p.links, p.points, strict=True):
            if link not in links:
                faults.append(Fault(f"pairs.{p.name}", f"there is no link '{link}'."))
            elif point not in links[link].points:
                faults.append(Fault(f"pairs.{p.name}", f"link '{link}' has no point '{point}'."))
        if p.links[0] == p.links[1]:
            faults.append(Fault(f"pairs.{p.name}", "joins a link to itself."))
    pairs = {p.name for p in m.pairs}
    faults += [Fault(f"drives.{d.pair}", "drives a pair that does not exist.") for d in m.drives if d.pair not in pairs]
    if len({d.pair for d in m.drives}) != len(m.drives):
        faults.append(Fault("drives", "a pair has two drives."))
    if faults:
        raise MechanismError(faults)


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


def _blocks(
    sums: tuple[SpinContour, ...],
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
    for c in sums:
        groups = {turning.spin_group[g] for g, a in c.arms if abs(a) > 1e-14 * size}
        groups |= {turning.spin_group[g] for _, g, _ in c.slides}
        row = [columns["angle", g] for g in sorted(groups - {0})]
        row += [columns["slide", j] for j, _, _ in c.slides if j not in driven]
        pattern += [row, row]
    order = block_order(pattern, len(columns))
    rows = [{e // 2 for e in equations} for equations, _ in order.blocks]
    placed = {c for r in rows for c in r}
    between: dict[frozenset[int], int] = {}
    for j, (p, q) in enumerate(ends):
        between.setdefault(frozenset((turning.group[p], turning.group[q])), j)
    blocks = []
    for found, (_, unknowns) in zip(rows, order.blocks, strict=True):
        picked = [unknown[u] for u in unknowns]
        group = tuple(i for what, i in picked if what == "angle")
        slides = tuple(i for what, i in picked if what == "slide")
        own = tuple(sorted(found))
        blocks.append(
            Block(
                kind=_kind(own, group, slides, sums, turning),
                contours=own,
                angles=group,
                slides=slides,
                name=joints[_inner_pair(own, group, slides, sums, between)].name,
                redundant=2 * len(own) - len(unknowns),
            )
        )
    for i, contour in enumerate(sums):
        if i not in placed:
            blocks.append(Block("check", (i,), (), (), joints[contour.closing].name, redundant=2))
    return tuple(blocks), [unknown[u] for u in sorted(order.loose)]


def _kind(
    own: tuple[int, ...],
    group: tuple[int, ...],
    slides: tuple[int, ...],
    sums: tuple[SpinContour, ...],
    turning: Angles,
) -> str:
    if len(own) > 1:
        return "general"
    if len(group) + len(slides) == 1:
        return "angle" if group else "slide"
    if len(group) == 2:
        return "theta_theta"
    if len(slides) == 2:
        return "slide_slide"
    carrier = next(turning.spin_group[g] for j, g, _ in sums[own[0]].slides if j == slides[0])
    return "arm_slide" if carrier == group[0] else "theta_slide"


def _inner_pair(
    own: tuple[int, ...],
    group: tuple[int, ...],
    slides: tuple[int, ...],
    sums: tuple[SpinContour, ...],
    between: Mapping[frozenset[int], int],
) -> int:
    """The joint by which a group is known: the one between its two unknown links, else the one that slides, else the closing."""
    if len(group) == 2 and frozenset(group) in between:
        return between[frozenset(group)]
    return slides[0] if slides else sums[own[0]].closing


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
