"""The motion of a mechanism: positions, and on request velocities, accelerations, poses, points, joint coordinates, residuals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, reduce
from operator import add, mul
from typing import Any, TypeVar

import numpy as np
from numpy import ndarray

from mechcore.accuracy import DEFAULT, Accuracy
from mechcore.arrays import Index, Plane, Real, Values
from mechcore.branches.singular_points import SingularPoint
from mechcore.branches.unwrapped import LinkAngles
from mechcore.compiled.motion import CompiledRates, MotionProgram
from mechcore.kinematics.columns import Columns, LoopVectors, all_columns, all_vectors, condition
from mechcore.kinematics.model import Model
from mechcore.kinematics.program import VectorSum
from mechcore.kinematics.rates import Rates, accelerations, velocities
from mechcore.kinematics.state import Interpolant, State, value
from mechcore.numerics.frames import PLAIN, added, is_zero, lazy, plane_rows, stacked, subtracted
from mechcore.numerics.interpolation import differentiate
from mechcore.spec.mechanism import Mechanism
from mechcore.topology.graph import FRAME

T = TypeVar("T")
COMPLEX = np.dtype(complex)


class Motion:
    """The motion of a mechanism at a set of frames; results are computed on demand.

    ``time`` (F,) [s]; ``drives`` holds position, speed and acceleration (F,) of each drive; a constant rate may be given as one
    number. Results have a leading frame axis. Links, joints and points are identified by name.
    """

    peak: Callable[[Any], Any] | None = None
    """Function for the largest absolute value over all frames, set where a program, which sees one frame at a time, is given it."""

    def __init__(
        self,
        model: Model,
        time: Real,
        drives: Sequence[tuple[Real, Real | float, Real | float]],
        state: State,
        angles: LinkAngles,
        interpolants: Mapping[int, Sequence[Interpolant]] | None = None,
        singular_points: Sequence[SingularPoint] = (),
        at_times: Callable[[Real], Motion] | None = None,
        accuracy: Accuracy = DEFAULT,
        by_c: tuple[MotionProgram, Callable[[], list[Plane]]] | None = None,
    ):
        self.model = model
        self.time = time
        self._drives = drives  # constant rates may be single numbers
        self.state = state
        self.angles = angles  # of the links, continuous from the start pose
        self.states: dict[str, Real] = {}  # of effects with states, integrated over time in a motion under forces
        self.interpolants = interpolants
        self.at_times = at_times  # times -> the same motion there, if it follows laws
        self.accuracy = accuracy
        self._program = None if by_c is None else by_c[0]  # compiled, in place of numpy
        self._placed_origins = None if by_c is None else by_c[1]
        self.singular_points = tuple(singular_points)  # change points and dead points that the run passes
        # computed at the first access
        self._arms: dict[tuple[int, int, int], Plane] = {}
        self._slid: dict[tuple[int, int], Plane] = {}
        self._offsets: dict[tuple[int, complex], Plane] = {}
        self._origins: dict[tuple[int, int], Plane] = {(0, 0): 0j, (0, 1): 0j, (0, 2): 0j}

    def __repr__(self) -> str:
        return f"Motion of {self.mechanism.name}: {self.frames} frames, {len(self.model.links)} links"

    @property
    def parts(self) -> Sequence[tuple[Index, Motion]]:
        """The frames and the motion of every part: one part, except where charts or phases change in a motion under forces."""
        return ((np.arange(self.frames), self),)

    def over_parts(self, compute: Callable[..., T], *values: object) -> T:
        """``compute(part, *values)`` for every part, with the values (F, ...) at its frames; results joined frame by frame.

        The result is an array (F, ...), or a dictionary or a dataclass of such.
        """
        return compute(self, *values)

    def forget(self) -> None:
        """Release the memory of intermediate results; they are computed again when needed."""
        for _, part in self.parts:
            for name in ("columns", "loop_vectors", "_turned_once", "_turned_twice"):
                part.__dict__.pop(name, None)
            part._arms.clear()
            part._offsets.clear()
            part._slid.clear()

    @property
    def compiled(self) -> bool:
        """Whether a program in C computes its rates."""
        return self._program is not None and self.accuracy.differentiation == "exact"

    @property
    def mechanism(self) -> Mechanism:
        return self.model.mechanism

    @property
    def frames(self) -> int:
        return len(self.time)

    @lazy
    def drives(self) -> list[tuple[Real, Real, Real]]:
        """Position, speed and acceleration (F,) of each drive [rad or m, s]; (D, F) where its speed varies with designs."""
        return [(x[0], x[1], x[2]) for x in (np.broadcast_arrays(*own) for own in self._drives)]

    @lazy
    def shape(self) -> tuple[int, ...]:
        """(F,), or (D, F) where D designs are computed together (see `sweep`)."""
        return (*self.model.designs, len(self.time))

    # -- results by name ----------------------------------------------------------------------------------------------
    def pose(self, link: str) -> Real:
        """x, y [m] and angle [rad] of the link's frame in the world, the angle continuous (F, 3)."""
        k = self.model.index[link]
        return self._rows(self.origin(k), self.angle(k))

    def velocity(self, link: str) -> Real:
        """First derivative of the pose (F, 3) [m/s, rad/s]."""
        k = self.model.index[link]
        return self._rows(self.origin(k, 1), self.speeds.angular[self.model.angles.rotation_class[k]])

    def acceleration(self, link: str) -> Real:
        """Second derivative of the pose (F, 3) [m/s^2, rad/s^2]."""
        k = self.model.index[link]
        return self._rows(self.origin(k, 2), self.accelerations.angular[self.model.angles.rotation_class[k]])

    def point(self, link: str, point: str, derivative: int = 0) -> Real:
        """Position (F, 2) [m] of a named point of a link, or its first or second derivative."""
        total = self.model.named_points.get((link, point))
        if total is not None:
            z = self.summed(total, derivative)
            if type(z) is ndarray and z.dtype is COMPLEX and z.shape == self.shape:
                return ndarray((*z.shape, 2), float, z)  # the same numbers as a view, in a quarter of its time
            return self._rows(z)
        k = self.model.index[link]
        self.turned(derivative)  # raises for an invalid order
        return self._rows(self.of_point(k, self.model.points[k][point], derivative))

    def centre_of_mass(self, link: str, derivative: int = 0) -> Real:
        """Position (F, 2) [m] of a link's centre of mass, or its first or second derivative."""
        k = self.model.index[link]
        self.turned(derivative)
        return self._rows(self.of_point(k, self.model.masses[k][1], derivative))

    def coordinate(self, joint: str) -> Real:
        """Relative coordinate of a joint and its first two derivatives (F, 3): angle [rad], or displacement [m] if it slides.

        For a gear, belt or rack joint: angle of its second link minus that of its first.
        """
        model = self.model
        j = model.joint_index.get(joint)
        if j is not None and j in model.driven and (self.angles.exact or model.joints[j].coordinate == "slide"):
            values: Sequence[Values] = self.drives[model.driven[j]]
        elif j is not None and model.joints[j].coordinate == "slide":
            values = (self.state.slide[j], self.speeds.slide[j], self.accelerations.slide[j])
        else:
            first, second = model.links_of[joint]
            return self.relative_angle(first, second, joint)
        return np.stack([np.broadcast_to(x, self.shape) for x in values], axis=-1)

    def relative_angle(self, first: str, second: str, joint: str) -> Real:
        """Angle of the second link minus that of the first [rad], as the coordinate of ``joint``, and its first two derivatives
        (F, 3)."""
        p, q = self.model.index[first], self.model.index[second]
        a, b = self.model.angles.rotation_class[p], self.model.angles.rotation_class[q]
        rates = (r.angular[b] - r.angular[a] for r in (self.speeds, self.accelerations))
        values = (self.angles.relative(p, q, self.angles.start.ranges.get(joint)), *rates)
        return np.stack([np.broadcast_to(x, self.shape) for x in values], axis=-1)

    def joint_position(self, joint: str) -> Real:
        """Position of a joint (F, 2) [m]: its pin, the sliding link's point, or the contact point of a gear, rack or belt."""
        if joint not in self.model.joint_index:
            relation = self.model.relation_of[joint]
            return self._rows(relation.contact(self, 1.0)[0])
        return self._rows(self.joint_point(self.model.joint_index[joint]))

    # -- solved stages ------------------------------------------------------------------------------------------------
    @lazy
    def loop_vectors(self) -> list[LoopVectors]:
        """The vectors of every loop in the world."""
        return all_vectors(self.model, self.state)

    @lazy
    def columns(self) -> list[Columns]:
        """Derivatives of each block's loops by its unknowns."""
        return all_columns(self.model, self.loop_vectors)

    @lazy
    def speeds(self) -> Rates:
        """First rates of all rotation classes and slides."""
        if self.accuracy.differentiation != "exact":
            return _numerical_rates(self, 1)
        if self.compiled:
            return self._rates[0].rates
        rates = [d[1] for d in self._drives]
        return velocities(self.model, self.loop_vectors, self.columns, rates, self.interpolants, self.state.curve_values)

    @lazy
    def _rates(self) -> tuple[CompiledRates, CompiledRates]:
        """First and second rates by the compiled program."""
        assert self._program is not None
        first, second = ([d[k] for d in self._drives] for k in (1, 2))
        return self._program.rates(self.state, first, second, self.frames)

    @lazy
    def accelerations(self) -> Rates:
        """Second rates of all rotation classes and slides."""
        if self.accuracy.differentiation != "exact":
            return _numerical_rates(self, 2)
        if self.compiled:
            return self._rates[1].rates
        rates = [d[2] for d in self._drives]
        return accelerations(self.model, self.loop_vectors, self.columns, self.speeds, rates, self.interpolants)

    # -- plane vectors as complex numbers, links and joints as indices ------------------------------------------------
    def rotation(self, k: int) -> Plane:
        """Rotation exp(i angle) of a link's frame."""
        turn = self.model.turn[k]
        rot: Plane = self.state.rot[self.model.angles.rotation_class[k]]
        return rot if turn == 1 else turn * rot

    def turned(self, derivative: int) -> Sequence[Plane]:
        """Rotations E of all rotation classes, or their first or second derivatives, i omega E or (i alpha - omega^2) E."""
        if derivative == 0:
            return self.state.rot
        if derivative == 1:
            return self._turned_once
        if derivative == 2:
            return self._turned_twice
        raise ValueError(f"derivative {derivative!r}: there are 0 (position), 1 (velocity) and 2 (acceleration)")

    @lazy
    def _turned_once(self) -> list[Plane]:
        return self._rates[0].turned if self.compiled else list(map(mul, self.speeds.factor, self.state.rot))

    @lazy
    def _turned_twice(self) -> list[Plane]:
        return self._rates[1].turned if self.compiled else list(map(mul, self.accelerations.factor, self.state.rot))

    def slid(self, j: int, derivative: int = 0) -> Plane:
        """s E of a sliding joint, its displacement turned with its guide's rotation class, or its first or second derivative."""
        key = j, derivative
        if key not in self._slid:
            rotation_class, _ = self.model.guides[j]
            s: Any = (self.state if derivative == 0 else self.speeds if derivative == 1 else self.accelerations).slide[j]
            if rotation_class != FRAME:
                once = self.speeds.factor[rotation_class] if derivative else 0j
                if derivative == 1:
                    s = added(s, once * self.state.slide[j])
                elif derivative == 2:
                    s = added(s, 2.0 * once * self.speeds.slide[j])
                    s = added(s, self.accelerations.factor[rotation_class] * self.state.slide[j])
                s = s * self.state.rot[rotation_class]
            self._slid[key] = s
        return self._slid[key]

    def offset(self, k: int, local: Plane, derivative: int = 0) -> Plane:
        """A vector ``local`` fixed in link ``k``, in world axes, or its first or second derivative."""
        if derivative == 0 and isinstance(local, complex):
            vector = self._offsets.get((k, local))
            if vector is None:
                rotation = self.state.rot[self.model.angles.rotation_class[k]]
                vector = self._offsets[k, local] = (local * self.model.turn[k]) * rotation if local else 0j
            return vector
        if is_zero(local):
            return 0j
        return (local * self.model.turn[k]) * self.turned(derivative)[self.model.angles.rotation_class[k]]

    def angle(self, k: int) -> Real:
        """Angle of a link's frame (F,) [rad], continuous from the start pose."""
        return self.angles.link(k)

    def group_angle(self, group: int) -> Real:
        """Angle of a group of links that turn together (F,) [rad], without rotations by drives inside it, continuous from the start
        pose."""
        turning = self.model.angles
        rotation_class = turning.classes_of[group][0]
        driven = sum(sign * self.drives[d][0] for d, sign in turning.class_drives[rotation_class])
        return np.asarray(self.angles.class_angles[rotation_class] - driven)

    def guide(self, j: int) -> Plane:
        """Direction of a sliding joint's guide in the world."""
        rotation_class, direction = self.model.guides[j]
        rot: Plane = self.state.rot[rotation_class]
        return direction * rot

    def arm(self, k: int, j: int, side: int, derivative: int = 0) -> Plane:
        """Vector from the origin of link ``k`` to its point of joint ``j`` (slide included), or its derivative."""
        key = j, side, derivative
        vector = self._arms.get(key)
        if vector is None:
            joint = self.model.joints[j]
            vector = self.offset(k, joint.b if side else joint.a, derivative)
            if joint.slide is not None and joint.guide == side:
                vector = added(vector, self.model.guides[j][1] * self.slid(j, derivative))
            self._arms[key] = vector
        return vector

    def origin(self, k: int, derivative: int = 0) -> Plane:
        """Position of the origin of a link [m], or its first or second derivative, along the tree from the frame."""
        tree, ends, known = self.model.tree, self.model.ends, self._origins
        if (k, derivative) not in known and self._placed_origins is not None and (self.compiled or not derivative):
            places = self._rates[derivative - 1].origins if derivative else self._placed_origins()
            known |= {(link, derivative): place for link, place in enumerate(places, 1)}
        chain = []
        while (k, derivative) not in known:
            chain.append(k)
            k = tree.parent[k]
        place = known[k, derivative]
        for link in reversed(chain):
            p, j = tree.parent[link], tree.joint[link]
            side = 1 if ends[j][1] == link else 0
            place = subtracted(added(place, self.arm(p, j, 1 - side, derivative)), self.arm(link, j, side, derivative))
            known[link, derivative] = place
        return place

    @lazy
    def origins(self) -> list[Plane]:
        """Positions of the origins of all links [m]."""
        return [self.origin(k) for k in range(len(self.model.links))]

    @lazy
    def origin_velocities(self) -> list[Plane]:
        return [self.origin(k, 1) for k in range(len(self.model.links))]

    @lazy
    def origin_accelerations(self) -> list[Plane]:
        return [self.origin(k, 2) for k in range(len(self.model.links))]

    def of_point(self, k: int, local: Plane, derivative: int = 0) -> Plane:
        """World position of a point given in link axes, or its first or second derivative."""
        total = self.model.point_sum(k, local)
        if total is None:
            return added(self.origin(k, derivative), self.offset(k, local, derivative))
        return self.summed(total, derivative)

    def summed(self, total: VectorSum, derivative: int) -> Plane:
        """The value of a sum of vectors in world axes, or its first or second derivative; if an array, a new one."""
        constant, arms, slides = total
        turned = self.turned(derivative)
        if len(arms) == 1 and not slides:
            ((s, a),) = arms
            return a * turned[s] if derivative else added(a * turned[s], constant)
        terms = [a * turned[s] for s, a in arms]
        if slides:
            terms += [d * self.slid(j, derivative) for j, _, d in slides]
        moving = reduce(add, terms) if terms else 0j
        return moving if derivative else added(moving, constant)

    def joint_point(self, j: int, derivative: int = 0) -> Plane:
        """Position of a joint, or its derivative: of its point on the link that does not carry the guide."""
        joint, ends = self.model.joints[j], self.model.ends[j]
        side = 1 if joint.slide is not None and joint.guide == 0 else 0
        return self.of_point(ends[side], joint.b if side else joint.a, derivative)

    def _rows(self, z: Plane, angle: Values | None = None) -> Real:
        """Plane vectors, and an angle if given, as new rows of real numbers (F, 2 or 3)."""
        if angle is not None:
            return plane_rows(self.shape, z, angle)
        if not isinstance(z, PLAIN):
            return stacked([z.real, z.imag], self.shape)
        own = np.broadcast_to(np.asarray(z, complex), self.shape).copy()
        return ndarray((*self.shape, 2), float, own)

    # -- residuals and conditioning -----------------------------------------------------------------------------------
    @cached_property
    def closure(self) -> Real:
        """Largest loop residual of each frame (F,) [m]."""
        return self._largest([self.closure_error(c) for c in range(len(self.model.loop_sums))])

    def closure_error(self, loop: int) -> Plane:
        """Sum of a loop's vectors [m], zero where it closes."""
        return value(self.model.loop_sums[loop], self.state.rot, self.state.slide)

    @cached_property
    def velocity_closure(self) -> Real:
        """Largest residual of the differentiated loops (F,) [m/s]."""
        return self._largest([self._loop_rate(v, 1) for v in self.loop_vectors])

    @cached_property
    def acceleration_closure(self) -> Real:
        """Largest residual of the twice differentiated loops (F,) [m/s^2]."""
        return self._largest([self._loop_rate(v, 2) for v in self.loop_vectors])

    @cached_property
    def condition(self) -> Real:
        """Largest block condition number of each frame (F,), dimensionless; inf where a block is singular."""
        worst = np.ones(self.shape)
        for block, cols in zip(self.model.blocks, self.columns, strict=True):
            worst = np.maximum(worst, condition(self.model, block, cols))
        return worst

    def _loop_rate(self, v: LoopVectors, derivative: int) -> Plane:
        total: Plane = 0j
        for rotation_class, z in v.arms:
            w = self.speeds.angular[rotation_class]
            total = total + (1j * w * z if derivative == 1 else (1j * self.accelerations.angular[rotation_class] - w * w) * z)
        for j, rotation_class, d in v.slides:
            if derivative == 1:
                total = total + self.speeds.slide[j] * d
            else:
                total = total + (self.accelerations.slide[j] + 2j * self.speeds.angular[rotation_class] * self.speeds.slide[j]) * d
        return total

    def _largest(self, residuals: list[Plane]) -> Real:
        worst = np.zeros(self.shape)
        for r in residuals:
            worst = np.maximum(worst, np.abs(r))
        return worst


def _numerical_rates(motion: Motion, derivative: int) -> Rates:
    """First or second rates of all groups and slides, by numerical differentiation of positions; drives keep their own rates.

    They serve for comparison only; exact rates are better and cheap. "differences" differentiates the polynomials through the
    nearest frames. "graphical" is the graphical method of the lecture: positions read off with the resolution of the drawing, the
    slopes of chords averaged, their change as acceleration.
    """
    model, accuracy = motion.model, motion.accuracy
    drives = [d[derivative] for d in motion.drives]
    rates = Rates(model, drives, motion.state.curve_values if derivative == 1 else None, None if derivative == 1 else motion.speeds)
    drawn = accuracy.differentiation == "graphical"
    order = 2 if drawn else accuracy.differences

    def slope(given: Values, unit: float) -> Values:
        values = np.broadcast_to(given, motion.shape)
        if drawn and accuracy.resolution > 0.0:
            values = accuracy.resolution * unit * np.round(values / (accuracy.resolution * unit))
        return differentiate(motion.time, values, order, derivative)

    for block in model.blocks:
        solved = [slope(motion.group_angle(g), 1.0) for g in block.angles]
        solved += [slope(motion.state.slide[j], model.length_scale) for j in block.slides]
        rates.settle(model, block, solved)
    return rates
