"""A mechanism compiled: links and joints as indices, loops, blocks in solving order. Nothing here depends on time.

The unknowns are the angles of the groups of links that turn together, and the displacements of the sliding joints without a
drive. `Model.program` is the order of solution.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from mechcore.errors import Named
from mechcore.joints.base import LoopJoint, Relation
from mechcore.kinematics.program import Block, DrivenSlide, LinearConstraint, Program, VectorSum, compile_program, vector_sum
from mechcore.numerics.frames import is_zero
from mechcore.records import dataclass
from mechcore.spec.mechanism import Link, Mechanism
from mechcore.topology.graph import Angles, Loop, Tree
from mechcore.topology.order import SolvingOrder

T = TypeVar("T")
MOST_VECTORS = 6  # in a point's sum; beyond this it is cheaper to go from link to link and share partial sums


@dataclass(frozen=True)
class Connection:
    """A joint as listed in results; ``links`` are its first and second link."""

    name: str
    kind: str
    links: tuple[str, str]


@dataclass(frozen=True, eq=False)
class Model:
    """The compiled mechanism. ``points`` holds named points and ``centres`` the centres of mass in link axes."""

    mechanism: Mechanism
    links: tuple[str, ...]  # the frame first
    joints: tuple[LoopJoint, ...]
    ends: tuple[tuple[int, int], ...]  # of each joint
    driven: Mapping[int, int]  # joint -> drive
    angles: Angles
    tree: Tree
    order: SolvingOrder  # in absolute coordinates
    loops: tuple[Loop, ...]  # vector loops, by links
    loop_sums: tuple[VectorSum, ...]  # of the loops: zero where they close
    relations: tuple[Relation, ...]
    constraints: tuple[LinearConstraint, ...]  # of the relations
    multi_turn: tuple[int, ...]  # groups with a closed form whose angle a relation needs beyond one turn
    blocks: tuple[Block, ...]
    free: tuple[str, ...]  # joints next to degrees of freedom without a drive
    turn: tuple[complex, ...]  # of each link: rotation from its rotation class's axes to its own
    length_scale: float  # largest extent of a moving link [m]
    index: Mapping[str, int] = field(default_factory=dict)  # of links
    joint_index: Mapping[str, int] = field(default_factory=dict)

    varied: Mapping[tuple[str, str], Any] = field(default_factory=dict)  # (link, point) -> places in a sweep (designs, 1)
    varied_masses: Mapping[str, tuple[Any, Any, Any]] = field(default_factory=dict)  # link -> `masses` in a sweep (designs, 1)
    bodies: Mapping[str, Link] = field(default_factory=dict)  # all links, including those that joints create

    solves_globally: bool = False  # whether reactions are solved for all joints together even where blocks would do

    @property
    def redundant(self) -> bool:
        """Whether there are redundant constraints, so that statics alone does not determine all reactions."""
        return bool(self.angles.redundant) or any(b.redundant for b in self.blocks)

    @cached_property
    def needs_global_solve(self) -> bool:
        """Whether the reactions are solved for all joints together, instead of block by block."""
        return self.solves_globally or self.redundant or any(b.relations and b.kind == "general" for b in self.blocks)

    @cached_property
    def connections(self) -> tuple[Connection, ...]:
        """Everything that transmits forces between two links: the joints, and the relations that are not joints too."""
        joints = [Connection(j.name, j.kind, j.links) for j in self.joints]
        return (*joints, *(Connection(r.name, r.kind, r.links) for r in self.relations if r.name not in self.joint_index))

    @cached_property
    def shafts(self) -> frozenset[int]:
        """Links that turn about an axis lying in the plane, not normal to it: those of barrel, end and globoidal cams."""
        turning = self.angles.rotation_class
        classes = {turning[self.index[r.links[0]]] for r in self.relations if r.bearing is not None}
        return frozenset(k for k in range(len(self.links)) if turning[k] in classes)

    @cached_property
    def links_of(self) -> Mapping[str, tuple[str, str]]:
        """First and second link of everything in `connections`."""
        return Named("joint", {c.name: c.links for c in self.connections})

    @cached_property
    def relation_of(self) -> Mapping[str, Relation]:
        """The relations by name."""
        return Named("joint", {r.name: r for r in self.relations}, self.joint_index)

    def rotary(self, joint: str) -> bool:
        """Whether a joint's coordinate is an angle [rad], not a displacement [m]; true for relations that are no joint (wheels)."""
        return joint not in self.joint_index or self.joints[self.joint_index[joint]].coordinate == "angle"

    def coordinate_scale(self, joint: str) -> float:
        """Typical size of a joint's coordinate: 1 rad, or the length scale of the mechanism [m]."""
        return 1.0 if self.rotary(joint) else self.length_scale

    @cached_property
    def points(self) -> tuple[dict[str, complex], ...]:
        """Named points of every link in its own axes [m]; in a sweep those that vary are arrays (designs, 1)."""
        bodies = [self.bodies[k].points for k in self.links]
        own = [Named(f"point of {k}", {p: complex(*xy) for p, xy in b.items()}) for k, b in zip(self.links, bodies, strict=True)]
        for (link, point), values in self.varied.items():
            own[self.index[link]][point] = values
        return tuple(own)

    @cached_property
    def masses(self) -> tuple[tuple[float, complex, float], ...]:
        """(mass [kg], centre of mass in link axes [m], J_S [kg m^2]) of every link; in a sweep those that vary are arrays
        (designs, 1)."""
        own = {k: self.bodies[k] for k in self.links}
        return tuple(self.varied_masses.get(k, (link.mass, complex(*link.centre), link.inertia)) for k, link in own.items())

    @cached_property
    def program(self) -> Program:
        """The order of solution: what the drives decide, then what every block solves."""
        slides = [DrivenSlide(j, d) for j, d in self.driven.items() if self.joints[j].coordinate == "slide"]
        return compile_program(self.blocks, self.loop_sums, self.constraints, self.angles, slides)

    @cached_property
    def guides(self) -> Mapping[int, tuple[int, complex]]:
        """For every sliding joint: the rotation class of its guide, and the guide's direction in the axes of that class."""
        own = {j: (self.ends[j][joint.guide], joint.slide) for j, joint in enumerate(self.joints) if joint.slide is not None}
        return {j: (self.angles.rotation_class[k], d * self.turn[k]) for j, (k, d) in own.items()}

    @cached_property
    def designs(self) -> tuple[int, ...]:
        """(D,) where D designs are computed together, else ()."""
        sums = (a for loop in self.loop_sums for a in (loop.constant, *(a for _, a in loop.arms)))
        return next((np.shape(a)[:-1] for a in (*self.varied.values(), *sums) if np.ndim(a) > 1), ())

    @cached_property
    def named_points(self) -> dict[tuple[str, str], VectorSum]:
        """The positions of all named points as sums, without those whose sums are long (see `point_sum`)."""
        sums = {
            (link, name): self.point_sum(k, local) for k, link in enumerate(self.links) for name, local in self.points[k].items()
        }
        return {key: total for key, total in sums.items() if total is not None}

    @cached_property
    def _cache(self) -> dict[Callable[[Model], Any], Any]:
        return {}

    def cached(self, work: Callable[[Model], T]) -> T:
        """``work(self)``, computed at the first call and kept, for what later stages look up repeatedly."""
        if work not in self._cache:
            self._cache[work] = work(self)
        done: T = self._cache[work]
        return done

    @cached_property
    def _point_sums(self) -> dict[tuple[int, complex], VectorSum | None]:
        return {}

    def point_sum(self, k: int, local: object) -> VectorSum | None:
        """The position of a point of link ``k``, given in link axes, as a sum; None if that takes more than ``MOST_VECTORS``."""
        if not isinstance(local, complex):  # one place per design of a sweep
            return self._sum_to(k, local)
        key = k, local
        if key not in self._point_sums:
            self._point_sums[key] = self._sum_to(k, local)
        return self._point_sums[key]

    def _sum_to(self, k: int, local: Any) -> VectorSum | None:
        arms: dict[int, Any] = {}
        slides: list[tuple[int, int, complex]] = []

        def add_term(link: int, vector: Any, sign: float) -> None:
            if not is_zero(vector):
                rotation_class = self.angles.rotation_class[link]
                arms[rotation_class] = arms.get(rotation_class, 0j) + sign * vector * self.turn[link]

        add_term(k, local, 1.0)
        while k:
            p, j = self.tree.parent[k], self.tree.joint[k]
            joint = self.joints[j]
            side = 1 if self.ends[j][1] == k else 0
            add_term(p, joint.a if side else joint.b, 1.0)
            add_term(k, joint.b if side else joint.a, -1.0)
            if joint.slide is not None:
                rotation_class, d = self.guides[j]
                slides.append((j, rotation_class, d if joint.guide != side else -d))
            if len(arms) + len(slides) > MOST_VECTORS:
                return None
            k = p
        return vector_sum(arms, slides)
