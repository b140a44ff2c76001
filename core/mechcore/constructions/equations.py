"""Equations of a mechanism: its contour graph (links are vertices, joints edges, independent loops the independent cycles), and the
equilibrium equations of every link (d'Alembert) with numbers, group by group in the order of the hand method: last group first.

Every link has three equations: forces along x, forces along y, moments about one of its joints. The unknowns are the reactions on
the second links of the joints and the efforts of the drives; a reaction found in one group is known in those that follow. All
equations together are one linear system, solved at once as a check of the results of the consecutive groups.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.constructions.polygons import frames_of
from mechcore.forces.kinetostatics import Forces, LinkLoad, loads_on
from mechcore.joints.base import Relation
from mechcore.kinematics.dyads import cross
from mechcore.kinematics.model import Model
from mechcore.motion.at_once import DENSE_UNKNOWNS, INDEPENDENT_RATIO, equilibrium_cells, undetermined
from mechcore.motion.structure import Group, groups, loop_steps
from mechcore.numerics.frames import stacked
from mechcore.records import dataclass

PLANE = np.array([1.0, 1.0j])


@dataclass(frozen=True)
class ForceUnknown:
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
    terms: tuple[tuple[float, ForceUnknown], ...]
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
    """The equations of a group, with the values ``solved`` in it, those ``known`` from groups before it, and those of its own that
    statics does not determine: the balancing values of least norm."""

    group: Group
    links: tuple[LinkEquations, ...]
    solved: tuple[tuple[ForceUnknown, float], ...]
    known: tuple[tuple[ForceUnknown, float], ...]
    undetermined: tuple[tuple[ForceUnknown, float], ...] = ()


class EquilibriumSystem:
    """The equilibrium of all moving links of a motion as one linear system ``matrix`` x + ``loads`` = 0.

    Equations (F, 3 links): forces along x and y, and moments [N m] about the origin of each link's frame. ``values`` (F, unknowns):
    those of `solve_forces`. Dry friction counts among the loads. The nonzero cells of the matrix are kept: their rows ``row`` and
    columns ``column`` (n,), in the order of the rows, and ``cells`` (F, n).
    """

    def __init__(self, forces: Forces):
        self.forces = forces
        motion = forces.motion
        model, size = motion.model, motion.model.length_scale
        flanks = {i: _flank(forces, relation) for i, relation in enumerate(model.relations)}
        entries, labels = equilibrium_cells(motion, flanks)
        ordered = sorted(entries)
        self.row, self.column = np.array(ordered, int).reshape(-1, 2).T
        moments = np.where(self.row % 3 == 2, size, 1.0)
        couples = np.array([size if labels[c][0] == "couple" else 1.0 for c in self.column])
        self.cells: Real = stacked([entries[cell] for cell in ordered], (motion.frames,)) * (moments / couples)
        self.unknowns, values = [], []
        for what, i, direction in labels:
            name = model.relations[i].name if what == "tie" else model.joints[i].name
            force = forces.normal_reaction(name)[:, :2] @ PLANE
            if what == "tie":
                along = frames_of(model.relations[i].contact(motion, flanks.get(i, 1.0))[1], motion.frames)
                self.unknowns.append(ForceUnknown("R", name, "", "N"))
                values.append(np.real(np.conj(along) * force) / np.abs(along) ** 2)
                continue
            joint, driven = model.joints[i], i in model.driven
            if what == "couple":
                turning = driven and joint.coordinate == "angle"
                self.unknowns.append(ForceUnknown("T" if turning else "M", name, "", "N m"))
                values.append(forces.effort(name) if turning else forces.normal_reaction(name)[:, 2])
            elif joint.slide is None:
                self.unknowns.append(ForceUnknown("R", name, "x" if direction == 1 else "y", "N"))
                values.append(force.real if direction == 1 else force.imag)
            else:
                drives = np.allclose(frames_of(direction, motion.frames), frames_of(motion.guide(i), motion.frames))
                if driven:
                    force = force + forces.wrench(name)[:, :2] @ PLANE
                self.unknowns.append(ForceUnknown("F" if drives else "N", name, "", "N"))
                values.append(np.real(np.conj(frames_of(direction, motion.frames)) * force))
        self.values: Real = np.column_stack(values) if values else np.zeros((motion.frames, 0))
        links = len(model.links)
        self._link_loads = [self._loads_on(k) for k in range(links)]
        self.loads: Real = np.stack([part for k in range(1, links) for part in self._loads(k)], axis=1)

    @property
    def equations(self) -> int:
        return int(self.loads.shape[1])

    @cached_property
    def matrix(self) -> Real:
        """The whole matrix (F, equations, unknowns)."""
        matrix = np.zeros((*self.loads.shape, len(self.unknowns)))
        matrix[:, self.row, self.column] = self.cells
        return matrix

    @cached_property
    def residual(self) -> Real:
        """Largest residual of the equations (F,) at the values of `solve_forces`, relative to the largest term of that frame."""
        terms, left = self.cells * self.values[:, self.column], self.loads.T.copy()
        np.add.at(left, self.row, terms.T)
        largest = np.maximum(np.abs(terms).max(axis=1, initial=0.0), np.abs(self.loads).max(axis=1, initial=0.0))
        return np.asarray(np.abs(left).max(axis=0, initial=0.0) / np.where(largest > 0.0, largest, 1.0))

    @property
    def _scale(self) -> Real:
        """The largest coefficient of each equation (F, equations)."""
        scale = np.zeros(self.loads.T.shape)
        np.maximum.at(scale, self.row, np.abs(self.cells.T))
        return np.where(scale > 0.0, scale, 1.0).T

    @cached_property
    def determinate(self) -> bool:
        """Whether there are as many unknowns as equations, and the equations determine all of them at some frame."""
        if self.equations != len(self.unknowns):
            return False
        if self.equations > DENSE_UNKNOWNS:
            return any(solve is not None for solve in self._factors)
        s = np.linalg.svd(self.matrix / self._scale[..., None], compute_uv=False)
        return bool((s[:, -1] > INDEPENDENT_RATIO * s[:, 0]).any())

    def undetermined(self, frame: int) -> frozenset[str]:
        """Names of the unknowns that statics does not determine at a frame; none where it determines all at some frame."""
        if self.determinate:
            return frozenset()
        free = undetermined((self.matrix[frame] / self._scale[frame][:, None])[None])
        return frozenset(u.name for u, own in zip(self.unknowns, free, strict=True) if own)

    @cached_property
    def _factors(self) -> list[Callable[[Real], Real] | None]:
        """Solvers of the sparse matrix, its equations scaled, of every frame; None where it is singular."""
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        factors: list[Callable[[Real], Real] | None] = []
        for cells in self.cells / self._scale[:, self.row]:
            try:
                factor = splu(csc_array((cells, (self.row, self.column)), shape=(self.equations, self.equations)))
            except RuntimeError:  # exactly singular
                factors.append(None)
                continue
            pivots = np.abs(factor.U.diagonal())
            factors.append(factor.solve if pivots.min() > INDEPENDENT_RATIO * pivots.max() else None)
        return factors

    def at_once(self) -> Real:
        """The unknowns (F, unknowns) by all equations together, without splitting into groups; the solution of least norm where
        statics does not determine them."""
        given = -self.loads / self._scale
        if self.equations > DENSE_UNKNOWNS and self.determinate:
            nothing = np.full(len(self.unknowns), np.nan)
            return np.array([nothing if f is None else f(side) for f, side in zip(self._factors, given, strict=True)])
        return np.asarray(
            (np.linalg.pinv(self.matrix / self._scale[..., None], rcond=INDEPENDENT_RATIO) @ given[..., None])[..., 0]
        )

    def _row(self, row: int) -> slice:
        """The cells of an equation."""
        return slice(*np.searchsorted(self.row, (row, row + 1)))

    def groups(self, frame: int) -> tuple[GroupEquations, ...]:
        """The equations of every group at a frame, the last group first."""
        model = self.forces.motion.model
        joints: dict[int, list[int]] = {}
        for j, ends in enumerate(model.ends):
            for k in ends:
                joints.setdefault(k, []).append(j)
        there: Flags = np.asarray(self.cells.any(axis=0))
        loose = self.undetermined(frame)
        given: set[int] = set()
        out = []
        for group in reversed(groups(model)):
            links = [model.index[name] for name in group.links]
            cells = [self._row(row) for k in links for row in range(3 * k - 3, 3 * k)]
            used = sorted({int(c) for cell in cells for c in self.column[cell][there[cell]]})
            known = [(self.unknowns[c], float(self.values[frame, c])) for c in used if c in given]
            new = [(self.unknowns[c], float(self.values[frame, c])) for c in used if c not in given]
            solved, free = (tuple(pair for pair in new if (pair[0].name in loose) == own) for own in (False, True))
            equations = tuple(self._of_link(k, joints.get(k, []), links, frame) for k in links)
            out.append(GroupEquations(group, equations, solved, tuple(known), free))
            given.update(used)
        return tuple(out)

    def _of_link(self, k: int, joints: list[int], group: list[int], frame: int) -> LinkEquations:
        motion = self.forces.motion
        model = motion.model
        about = next((j for j in joints if set(model.ends[j]) <= set(group)), joints[0] if joints else None)
        place = 0j
        if about is not None:
            place = complex(
                (frames_of(motion.joint_point(about), motion.frames) - frames_of(motion.origins[k], motion.frames))[frame]
            )
        name = "" if about is None else model.joints[about].name
        own = [self._row(row) for row in range(3 * k - 3, 3 * k)]
        columns = np.unique(np.concatenate([self.column[cell] for cell in own]))
        rows = np.zeros((3, len(columns)))
        for row, cell in zip(rows, own, strict=True):
            row[np.searchsorted(columns, self.column[cell])] = self.cells[frame, cell]
        rows[2] -= place.real * rows[1] - place.imag * rows[0]
        loads = self.loads[frame, 3 * k - 3 : 3 * k].copy()
        loads[2] -= place.real * loads[1] - place.imag * loads[0]
        largest = np.abs(rows).max(axis=1, initial=0.0)
        equations = []
        for row, load, least, (what, unit) in zip(rows, loads, 1e-12 * largest, _SUMS, strict=True):
            terms = tuple((float(c), self.unknowns[at]) for c, at in zip(row, columns, strict=True) if abs(c) > least)
            equations.append(Equation(what, name if what == "M" else "", terms, float(load), unit))
        at = motion.origins[k] + place
        listed = []
        for load in self._link_loads[k]:
            f, p = (complex(frames_of(z, motion.frames)[frame]) for z in (load.force, load.place - at))
            turn = float(np.real(frames_of(load.moment, motion.frames)[frame])) + cross(p, f)
            listed.append((load.label, f.real, f.imag, float(turn)))
        return LinkEquations(model.links[k], tuple(listed), tuple(equations))

    def _loads_on(self, k: int) -> list[LinkLoad]:
        """Loads on a link, including friction."""
        loads, friction = loads_on(self.forces, k), self.forces.friction
        model = self.forces.motion.model
        for connection in model.connections if friction is not None else ():
            if model.links[k] not in connection.links or friction is None:
                continue
            rows = friction.applied(connection.name) * (-1.0 if connection.links[0] == model.links[k] else 1.0)
            if rows.any():
                label, place = f"friction {connection.name}", self.forces.position(connection.name) @ PLANE
                loads.append(LinkLoad(label, label, "friction", rows[:, :2] @ PLANE, rows[:, 2], place))
        return loads

    def _loads(self, k: int) -> tuple[Real, Real, Real]:
        """Resultant of the loads on a link, about the origin of its frame."""
        motion = self.forces.motion
        n = motion.frames
        total, turn = np.zeros(n, complex), np.zeros(n)
        for load in self._link_loads[k]:
            f, arm = frames_of(load.force, n), frames_of(load.place - motion.origins[k], n)
            total += f
            turn += np.real(frames_of(load.moment, n)) + cross(arm, f)
        return total.real.copy(), total.imag.copy(), turn


def _flank(forces: Forces, relation: Relation) -> Real:
    """The multiplier's sign (F,) for the flank or span that carries: that one of both lines of contact along which the reaction
    points."""
    motion, force = forces.motion, forces.normal_reaction(relation.name)[:, :2] @ PLANE
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
    frame, and the edges by number, the first from the first vertex to the second. Their number is edges - vertices + 1."""

    links: tuple[str, ...]
    edges: tuple[GraphEdge, ...]
    loops: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]


def contour_graph(model: Model) -> ContourGraph:
    """The contour graph of a mechanism: its vector loops in the order of their equations, then those closed by gears, cams and
    belts."""
    bound = {r.name for r in model.relations}
    edges = [GraphEdge(j.name, ends, j.freedoms == 2 and j.name not in bound, k in model.driven)
             for k, (j, ends) in enumerate(zip(model.joints, model.ends, strict=True))]  # fmt: skip
    loops = []
    for loop in model.loops:
        steps = loop_steps(model, loop.closing)
        loops.append((tuple(p for _, p, _ in steps), tuple(j for j, _, _ in steps)))
    for relation in model.relations:
        if relation.name in model.joint_index:
            continue  # rolling on a slot that is an edge already
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
    for vertex in fresh:  # grows during the loop
        for k, edge in enumerate(edges):
            if vertex in edge.ends:
                other = edge.ends[0] if edge.ends[1] == vertex else edge.ends[1]
                if other not in paths:
                    vertices, used = paths[vertex]
                    paths[other] = [*vertices, other], [*used, k]
                    fresh.append(other)
    return paths.get(end)
