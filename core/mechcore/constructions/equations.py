"""A mechanism written out: its contour graph (links are vertices, joints edges, independent loops the independent cycles), and the
equilibrium equations of every link (d'Alembert) with numbers, group by group in the order of the hand method: last group first.

Every link has three equations: forces along x, forces along y, moments about one of its joints. Unknown are the reactions on the
second links of the joints and the efforts of the drives; a reaction that a group has given is known in those that follow. All
equations together are one linear system, solved at once as a check of what the groups gave one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from mechcore.arrays import Real
from mechcore.constructions.polygons import frames_of
from mechcore.forces.kinetostatics import Acting, Forces, acting_on
from mechcore.joints.base import Relation
from mechcore.kinematics.dyads import cross
from mechcore.kinematics.model import Model
from mechcore.motion.at_once import INDEPENDENT, equilibrium_matrix
from mechcore.motion.structure import Group, groups, loop_steps
from mechcore.records import dataclass

PLANE = np.array([1.0, 1.0j])


@dataclass(frozen=True)
class Unknown:
    """A force or couple in a joint on its second link, or a drive's effort: ``letter`` with the joint and ``axis`` below, in N or
    N m.

    R with x, y: components of the reaction; N: normal force of a guide, along its left normal; M: couple; T: driving torque; F:
    driving force along the guide; R without an axis: force along a line of contact.
    """

    letter: str
    joint: str
    axis: str
    unit: str

    @property
    def name(self) -> str:
        return f"{self.letter}_{self.joint}{self.axis}"


@dataclass(frozen=True)
class Equation:
    """Sum of coefficient * unknown + load = 0. ``sum``: Fx, Fy, or M with the joint about which moments are taken ("" the
    origin)."""

    sum: str
    about: str
    terms: tuple[tuple[float, Unknown], ...]
    load: float
    unit: str


@dataclass(frozen=True)
class LinkEquations:
    """The equations of a link and the loads on it: (label, Fx, Fy [N], moment about the equations' point [N m])."""

    link: str
    loads: tuple[tuple[str, float, float, float], ...]
    equations: tuple[Equation, ...]


@dataclass(frozen=True)
class GroupEquations:
    """The equations of a group, with the values that they give and those that groups before it gave."""

    group: Group
    links: tuple[LinkEquations, ...]
    solved: tuple[tuple[Unknown, float], ...]
    known: tuple[tuple[Unknown, float], ...]


class Equilibrium:
    """The equilibrium of all moving links of a motion as one linear system ``matrix`` x + ``loads`` = 0.

    ``matrix`` (F, 3 links, unknowns): forces along x and y, and moments [N m] about the origin of each link's frame. ``values``
    (F, unknowns): those of `solve_forces`. Dry friction counts among the loads.
    """

    def __init__(self, forces: Forces):
        self.forces = forces
        motion = forces.motion
        model, size = motion.model, motion.model.length_scale
        flanks = {i: _flank(forces, relation) for i, relation in enumerate(model.relations)}
        matrix, labels = equilibrium_matrix(motion, flanks)
        scale = np.tile([1.0, 1.0, size], len(model.links) - 1)[:, None]
        couples = np.array([size if what == "couple" else 1.0 for what, _, _ in labels])
        self.matrix: Real = matrix * scale / couples
        self.unknowns, values = [], []
        for what, i, direction in labels:
            name = model.relations[i].name if what == "tie" else model.joints[i].name
            force = forces.pressed(name)[:, :2] @ PLANE
            if what == "tie":
                along = frames_of(model.relations[i].contact(motion, flanks.get(i, 1.0))[1], motion.frames)
                self.unknowns.append(Unknown("R", name, "", "N"))
                values.append(np.real(np.conj(along) * force) / np.abs(along) ** 2)
                continue
            joint, driven = model.joints[i], i in model.driven
            if what == "couple":
                turning = driven and joint.coordinate == "angle"
                self.unknowns.append(Unknown("T" if turning else "M", name, "", "N m"))
                values.append(forces.effort(name) if turning else forces.pressed(name)[:, 2])
            elif joint.slide is None:
                self.unknowns.append(Unknown("R", name, "x" if direction == 1 else "y", "N"))
                values.append(force.real if direction == 1 else force.imag)
            else:
                drives = np.allclose(frames_of(direction, motion.frames), frames_of(motion.guide(i), motion.frames))
                if driven:
                    force = force + forces.wrench(name)[:, :2] @ PLANE
                self.unknowns.append(Unknown("F" if drives else "N", name, "", "N"))
                values.append(np.real(np.conj(frames_of(direction, motion.frames)) * force))
        self.values: Real = np.column_stack(values) if values else np.zeros((motion.frames, 0))
        loads = [part for k in range(1, len(model.links)) for part in self._loads(k)]
        self.loads: Real = np.stack(loads, axis=1)

    @cached_property
    def residual(self) -> Real:
        """Residual of each equation (F,) at the values of `solve_forces`, as a part of the largest term of that frame."""
        terms = np.abs(self.matrix * self.values[:, None, :]).max(axis=(1, 2), initial=0.0)
        left = np.abs((self.matrix @ self.values[..., None])[..., 0] + self.loads).max(axis=1, initial=0.0)
        largest = np.maximum(terms, np.abs(self.loads).max(axis=1, initial=0.0))
        return np.asarray(left / np.where(largest > 0.0, largest, 1.0))

    @cached_property
    def determinate(self) -> bool:
        """Whether there are as many unknowns as equations, which decide all of them at some frame."""
        rows, columns = self.matrix.shape[1:]
        if rows != columns:
            return False
        s = np.linalg.svd(self.matrix / np.abs(self.matrix).max(axis=2, keepdims=True), compute_uv=False)
        return bool((s[:, -1] > INDEPENDENT * s[:, 0]).any())

    def at_once(self) -> Real:
        """The unknowns (F, unknowns) by all equations together, without splitting into groups; the shortest of all solutions where
        statics does not decide."""
        scale = np.abs(self.matrix).max(axis=2, keepdims=True, initial=0.0)
        scale = np.where(scale > 0.0, scale, 1.0)
        given = -self.loads[..., None] / scale
        if self.determinate and len(self.matrix) == 1:
            return np.asarray(np.linalg.solve(self.matrix / scale, given)[..., 0])
        return np.asarray((np.linalg.pinv(self.matrix / scale, rcond=INDEPENDENT) @ given)[..., 0])

    def groups(self, frame: int) -> tuple[GroupEquations, ...]:
        """The equations of every group at a frame, the last group first."""
        model = self.forces.motion.model
        given: list[int] = []
        out = []
        for group in reversed(groups(model)):
            links = [model.index[name] for name in group.links]
            rows = [row for k in links for row in range(3 * k - 3, 3 * k)]
            used = np.flatnonzero(self.matrix[:, rows].any(axis=(0, 1))).tolist()
            pairs = [(self.unknowns[c], float(self.values[frame, c])) for c in used]
            known = [pair for c, pair in zip(used, pairs, strict=True) if c in given]
            unknown = [pair for c, pair in zip(used, pairs, strict=True) if c not in given]
            equations = tuple(self._of_link(k, links, frame) for k in links)
            out.append(GroupEquations(group, equations, tuple(unknown), tuple(known)))
            given += [c for c in used if c not in given]
        return tuple(out)

    def _of_link(self, k: int, group: list[int], frame: int) -> LinkEquations:
        motion = self.forces.motion
        model = motion.model
        own = [(j, ends) for j, ends in enumerate(model.ends) if k in ends]
        inner = [j for j, ends in own if set(ends) <= set(group)]
        about = next(iter([*inner, *(j for j, _ in own)]), None)
        place = 0j
        if about is not None:
            place = complex(
                (frames_of(motion.joint_point(about), motion.frames) - frames_of(motion.origins[k], motion.frames))[frame]
            )
        name = "" if about is None else model.joints[about].name
        rows = self.matrix[frame, 3 * k - 3 : 3 * k].copy()
        rows[2] -= place.real * rows[1] - place.imag * rows[0]
        loads = self.loads[frame, 3 * k - 3 : 3 * k].copy()
        loads[2] -= place.real * loads[1] - place.imag * loads[0]
        largest = np.abs(rows).max(axis=1, initial=0.0, keepdims=True)
        equations = []
        for row, load, least, (what, unit) in zip(rows, loads, 1e-12 * largest[:, 0], _SUMS, strict=True):
            terms = tuple((float(row[c]), self.unknowns[c]) for c in np.flatnonzero(np.abs(row) > least))
            equations.append(Equation(what, name if what == "M" else "", terms, float(load), unit))
        at = motion.origins[k] + place
        listed = []
        for load in self._acting(k):
            f, p = (complex(frames_of(z, motion.frames)[frame]) for z in (load.force, load.place - at))
            turn = float(np.real(frames_of(load.moment, motion.frames)[frame])) + cross(p, f)
            listed.append((load.label, f.real, f.imag, float(turn)))
        return LinkEquations(model.links[k], tuple(listed), tuple(equations))

    def _acting(self, k: int) -> list[Acting]:
        """Loads on a link, friction too."""
        acting, friction = acting_on(self.forces, k), self.forces.friction
        model = self.forces.motion.model
        for connection in model.connections if friction is not None else ():
            if model.links[k] not in connection.links or friction is None:
                continue
            rows = friction.applied(connection.name) * (-1.0 if connection.links[0] == model.links[k] else 1.0)
            if rows.any():
                label, place = f"friction {connection.name}", self.forces.position(connection.name) @ PLANE
                acting.append(Acting(label, label, "friction", rows[:, :2] @ PLANE, rows[:, 2], place))
        return acting

    def _loads(self, k: int) -> tuple[Real, Real, Real]:
        """Resultant of the loads on a link, about the origin of its frame."""
        motion = self.forces.motion
        n = motion.frames
        total, turn = np.zeros(n, complex), np.zeros(n)
        for load in self._acting(k):
            f, arm = frames_of(load.force, n), frames_of(load.place - motion.origins[k], n)
            total += f
            turn += np.real(frames_of(load.moment, n)) + cross(arm, f)
        return total.real.copy(), total.imag.copy(), turn


def _flank(forces: Forces, relation: Relation) -> Real:
    """The multiplier's sign (F,) of the flank or span that carries: of both lines of contact that along which the reaction
    points."""
    motion, force = forces.motion, forces.pressed(relation.name)[:, :2] @ PLANE
    ones = np.ones(motion.frames)
    if relation.name in motion.model.joint_index:
        return ones
    beside = []
    for flank in (ones, -ones):
        along = frames_of(relation.contact(motion, flank)[1], motion.frames)
        away = np.real(np.conj(along) * force) * flank < 0.0
        beside.append(np.abs(cross(along, force)) / np.abs(along) + np.where(away, np.abs(force), 0.0))
    return np.where(beside[1] < beside[0], -ones, ones)


_SUMS = (("Fx", "N"), ("Fy", "N"), ("M", "N m"))


@dataclass(frozen=True)
class GraphEdge:
    """A joint between two vertices. ``higher``: it leaves two relative freedoms (class IV); ``driven``: a drive moves it."""

    joint: str
    ends: tuple[int, int]
    higher: bool
    driven: bool


@dataclass(frozen=True)
class ContourGraph:
    """``links`` by number, the frame first; ``edges``; ``loops``: vertices round each independent loop, from the one nearest to the
    frame, and the edges by number, the first from the first vertex to the second. There are as many as edges and one more than
    vertices leave over."""

    links: tuple[str, ...]
    edges: tuple[GraphEdge, ...]
    loops: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]


def contour_graph(model: Model) -> ContourGraph:
    """The contour graph of a mechanism: its vector loops in the order of their equations, then those that gears, cams, belts
    close."""
    bound = {r.name for r in model.relations}
    edges = [GraphEdge(j.name, ends, j.freedoms == 2 and j.name not in bound, k in model.driven)
             for k, (j, ends) in enumerate(zip(model.joints, model.ends, strict=True))]  # fmt: skip
    loops = []
    for loop in model.loops:
        steps = loop_steps(model, loop.closing)
        loops.append((tuple(p for _, p, _ in steps), tuple(j for j, _, _ in steps)))
    for relation in model.relations:
        if relation.name in model.joint_index:
            continue  # it rolls along a slot, which is an edge already
        p, q = (model.index[link] for link in relation.links)
        path = _shortest(edges, p, q)
        edges.append(GraphEdge(relation.name, (p, q), True, False))
        if path is not None:
            vertices, used = path
            loops.append((tuple(vertices), (*used, len(edges) - 1)))
    return ContourGraph(model.links, tuple(edges), tuple(loops))


def _shortest(edges: Sequence[GraphEdge], start: int, end: int) -> tuple[list[int], list[int]] | None:
    """Vertices and edges of a shortest path; None where there is none."""
    paths: dict[int, tuple[list[int], list[int]]] = {start: ([start], [])}
    fresh = [start]
    for vertex in fresh:  # grows while it is walked through
        for k, edge in enumerate(edges):
            if vertex in edge.ends:
                other = edge.ends[0] if edge.ends[1] == vertex else edge.ends[1]
                if other not in paths:
                    vertices, used = paths[vertex]
                    paths[other] = [*vertices, other], [*used, k]
                    fresh.append(other)
    return paths.get(end)
