"""Motion and forces over several charts, joined frame by frame, with results by name as from a single chart."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from functools import cached_property, partial
from typing import Any, TypeVar, cast

import numpy as np

from mechcore.arrays import Index, Real
from mechcore.dynamics.events import EndStop
from mechcore.dynamics.segments import STOP_CAUSE, stop_load
from mechcore.effects.base import Wrench, power_of
from mechcore.effects.resistance import IN_PAIRS, RUBBING, rubbing_name
from mechcore.forces.friction.solve import FrictionResult
from mechcore.forces.kinetostatics import Forces, LoadResult, undriven
from mechcore.kinematics.model import Model
from mechcore.motion.motion import Motion
from mechcore.spec.mechanism import Mechanism

T = TypeVar("T")


class JoinedMotion(Motion):
    """A `Motion` whose results by name are joined: its frames come from several motions of the same mechanism.

    ``mechanism``: the one to present, if it is not the one that was solved; ``at_times``: the same motion at other times (n,);
    ``coordinates``: joints whose coordinate and its rates (F, 3) are known, whole turns included. ``model``: one with all joints,
    where some parts lack a cam that its follower has left; by default the first part's.
    """

    def __init__(
        self,
        time: Real,
        parts: Sequence[tuple[Index, Motion]],
        *,
        mechanism: Mechanism | None = None,
        at_times: Callable[[Real], JoinedMotion] | None = None,
        coordinates: Mapping[str, Real] | None = None,
        model: Model | None = None,
    ):
        self.time = time
        self._parts = tuple(parts)
        self.model = parts[0][1].model if model is None else model
        self.accuracy = parts[0][1].accuracy
        self.singular_points = tuple(c for _, m in parts for c in m.singular_points)
        self.at_times = at_times
        self._mechanism = mechanism
        self._coordinates = coordinates or {}

    @property
    def mechanism(self) -> Mechanism:
        return self._mechanism or self.model.mechanism

    @property
    def drives(self) -> list[tuple[Real, Real, Real]]:
        """Position, speed and acceleration (F,) of each drive of the mechanism [rad or m, s]."""
        rows = [self.coordinate(d.joint) for d in self.mechanism.drives]
        return [(r[:, 0], r[:, 1], r[:, 2]) for r in rows]

    @property
    def frames(self) -> int:
        return len(self.time)

    @property
    def shape(self) -> tuple[int, ...]:
        return (self.frames,)

    @property
    def parts(self) -> Sequence[tuple[Index, Motion]]:
        return self._parts

    def over_parts(self, compute: Callable[..., T], *values: Any) -> T:
        return join_parts(self.frames, [(rows, compute(m, *(v[rows] for v in values))) for rows, m in self._parts])

    def _relation(self, joint: str) -> Any:
        """The relation of this name; None where it is a joint."""
        return None if joint in self.model.joint_index else self.model.relation_of[joint]

    def pose(self, link: str) -> Real:
        """x, y [m] and angle [rad], continuous from the start pose (F, 3)."""
        return self.over_parts(lambda m: m.pose(link))

    def velocity(self, link: str) -> Real:
        return self.over_parts(lambda m: m.velocity(link))

    def acceleration(self, link: str) -> Real:
        return self.over_parts(lambda m: m.acceleration(link))

    def point(self, link: str, point: str, derivative: int = 0) -> Real:
        return self.over_parts(lambda m: m.point(link, point, derivative))

    def centre_of_mass(self, link: str, derivative: int = 0) -> Real:
        return self.over_parts(lambda m: m.centre_of_mass(link, derivative))

    def coordinate(self, joint: str) -> Real:
        """Relative coordinate of a joint and its first two derivatives (F, 3)."""
        if joint in self._coordinates:
            return self._coordinates[joint]
        relation = self._relation(joint)
        if relation is None:
            return self.over_parts(lambda m: m.coordinate(joint))
        first, second = relation.links
        return self.over_parts(lambda m: m.relative_angle(first, second, joint))

    def joint_position(self, joint: str) -> Real:
        relation = self._relation(joint)
        if relation is None:
            return self.over_parts(lambda m: m.joint_position(joint))
        return self.over_parts(lambda m: m._rows(relation.contact(m, 1.0)[0]))

    @cached_property
    def closure(self) -> Real:
        return self.over_parts(lambda m: m.closure)

    @cached_property
    def velocity_closure(self) -> Real:
        return self.over_parts(lambda m: m.velocity_closure)

    @cached_property
    def acceleration_closure(self) -> Real:
        return self.over_parts(lambda m: m.acceleration_closure)

    @cached_property
    def condition(self) -> Real:
        return self.over_parts(lambda m: m.condition)


def join_parts(frames: int, parts_have: Sequence[tuple[Index, T]]) -> T:
    """Values of parts joined at their frames: arrays (F, ...), or dictionaries, tuples or dataclasses of such."""
    first: Any = parts_have[0][1]
    many: Any = parts_have
    out: Any
    if isinstance(first, dict):
        out = {name: join_parts(frames, [(rows, f[name]) for rows, f in many]) for name in first}
    elif isinstance(first, tuple):
        out = tuple(join_parts(frames, [(rows, f[k]) for rows, f in many]) for k in range(len(first)))
    elif isinstance(first, np.ndarray):
        out = np.empty((frames, *first.shape[1:]), first.dtype)
        for rows, values in many:
            out[rows] = values
    else:
        out = replace(
            first, **{x.name: join_parts(frames, [(rows, getattr(f, x.name)) for rows, f in many]) for x in fields(first)}
        )
    return cast("T", out)


class JoinedForces(Forces):
    """`Forces` whose results by name are joined: their frames come from several motions of the same mechanism.

    ``stops``: end stops on which joints may rest; ``energies``: time (n,) -> kinetic and potential energy, work done and
    energy dissipated so far (n, 4) [J]; ``at_times``: the forces at other times; ``jumps``, ``impacts``: see `Forces`.
    """

    def __init__(
        self,
        motion: JoinedMotion,
        parts: Sequence[tuple[Index, Forces]],
        *,
        stops: Sequence[EndStop] = (),
        energies: Callable[[Real], Real] | None = None,
        at_times: Callable[[Real], Forces] | None = None,
        jumps: Callable[[float], Real] | None = None,
        impacts: tuple[tuple[float, float, float], ...] = (),
    ):
        self.motion: JoinedMotion = motion
        self._parts = tuple(parts)
        self._stops = {stop_load(s): s for s in stops}
        self._energies, self._at_times = energies, at_times
        self.jumps, self.impacts = jumps, impacts
        self.friction = None if all(f.friction is None for _, f in parts) else JoinedFriction(self)

    def _join(self, value: Callable[[Forces], Real]) -> Real:
        return join_parts(self.motion.frames, [(rows, value(f)) for rows, f in self._parts])

    def at_times(self, t: Real) -> Forces:
        assert self._at_times is not None
        return self._at_times(t)

    @property
    def parts(self) -> Sequence[tuple[Index, Forces]]:
        return self._parts

    def reaction(self, joint: str) -> Real:
        """Total force and couple that the joint transmits (F, 3) [N, N m]; in parts whose chart has its coordinate, the drive's
        effort is zero. Zero while a follower has left its cam."""
        return self._join(lambda f: _transmitted(f, joint) if _has(f, joint) else np.zeros((f.motion.frames, 3)))

    def normal_reaction(self, joint: str) -> Real:
        """Force [N] and couple [N m] that the joint transmits, without the share of friction (F, 3)."""
        return self._join(lambda f: f.normal_reaction(joint) if _has(f, joint) else np.zeros((f.motion.frames, 3)))

    def position(self, joint: str) -> Real:
        relation = self.motion._relation(joint)
        return self._join(lambda f: f.position(joint) if _has(f, joint) else f.motion._rows(relation.contact(f.motion, 1.0)[0]))

    def effort(self, joint: str) -> Real:
        """Torque or force of a joint's drive (F,) [N m or N], zero in parts where it has none."""
        self._check_driven(joint)
        return self._join(lambda f: f.effort(joint) if _drives(f, joint) else np.zeros(f.motion.frames))

    def wrench(self, joint: str) -> Real:
        return self._join(lambda f: f.wrench(joint) if _drives(f, joint) else np.zeros((f.motion.frames, 3)))

    def power(self, joint: str) -> Real:
        self._check_driven(joint)
        return self._join(lambda f: f.power(joint) if _drives(f, joint) else np.zeros(f.motion.frames))

    def _check_driven(self, joint: str) -> None:
        if not any(_drives(f, joint) for f in (self, *(f for _, f in self.parts))):
            raise undriven(self.motion.mechanism, joint)

    def power_by_cause(self, causes: Sequence[str]) -> Real:
        return self._join(lambda f: f.power_by_cause(causes))

    def inertia(self, link: str) -> Real:
        return self._join(lambda f: f.inertia(link))

    def powers(self) -> list[tuple[Wrench, Real]]:
        """All loads and inertia forces, each with its power (F,) [W]; those of end stops do no work and are left out."""
        return [(w, self._join(partial(_power_of, k))) for k, w in enumerate(self.applied)]

    @property
    def applied(self) -> tuple[Wrench, ...]:
        """All wrenches on the links but those of dry friction and of end stops."""
        return tuple(w for w in self._parts[0][1].applied if w.name not in self._stops)

    @cached_property
    def loads(self) -> dict[str, LoadResult]:
        """All loads but inertia by name, those of end stops among them, zero while nothing rests on them."""
        out: dict[str, LoadResult] = {}
        for name, stop in self._stops.items():
            links = next(p.links for p in self.motion.mechanism.joints if p.name == stop.joint)

            def held(f: Forces, name: str = name, joint: str = stop.joint) -> Real:
                if name in f.loads:
                    return f.loads[name].values
                return np.column_stack([np.zeros((f.motion.frames, 3)), f.motion.joint_position(joint)])

            out[name] = LoadResult(name, STOP_CAUSE, STOP_CAUSE, (links[1], links[0]), partial(np.asarray, self._join(held)))
        for name, load in self._parts[0][1].loads.items():
            if name not in out and load.kind not in IN_PAIRS:
                values = self._join(partial(_values_of, name))
                out[name] = replace(load, rows=partial(np.asarray, values))
        return out

    @cached_property
    def kinetic_energy(self) -> Real:
        return self._join(lambda f: f.kinetic_energy)

    @cached_property
    def potential_energy(self) -> Real:
        return self._join(lambda f: f.potential_energy)

    @cached_property
    def energy(self) -> Real:
        """Kinetic, potential, work done so far, dissipated so far (F, 4) [J]."""
        assert self._energies is not None
        return self._energies(self.motion.time)

    @cached_property
    def power_balance(self) -> Real:
        """Sum of all powers, relative to the largest single power of the run (F,)."""
        largest = max(f.power_residual[1] for _, f in self._parts)
        total = self._join(lambda f: f.power_residual[0])
        return total / largest if largest > 0 else total


class JoinedFriction(FrictionResult):
    """Dry friction of the joints over several motions; results have a leading frame axis and are found by the joints' names."""

    def __init__(self, forces: JoinedForces):
        self._forces = forces
        known = max((f.friction for _, f in forces.parts if f.friction is not None), key=lambda f: len(f.elements))
        self.elements = known.elements  # a cam that its follower has left has no friction
        self.jammed = np.zeros(forces.motion.frames, bool)
        self.stability = np.ones(forces.motion.frames)

    def _join(self, value: Callable[[FrictionResult], Real], columns: int, joint: str | None = None) -> Real:
        none = (columns,) if columns else ()

        def known(f: Forces) -> Real:
            if f.friction is None or (joint is not None and joint not in f.friction.joints):
                return np.zeros((f.motion.frames, *none))
            return value(f.friction)

        return self._forces._join(known)

    def applied(self, joint: str) -> Real:
        """Share of friction in the force [N] and couple [N m] on the second link (F, 3)."""
        return self._join(lambda f: f.applied(joint), 3, joint)

    def wrench(self, joint: str) -> Real:
        """Friction on the joint's second link: Fx, Fy [N] and couple [N m], stated at the joint's position (F, 3)."""
        return self._join(lambda f: f.wrench(joint), 3, joint)

    def normal_load(self, joint: str) -> Real:
        return self._join(lambda f: f.normal_load(joint), 0, joint)

    def losses(self, joint: str) -> Real:
        """Power that friction in a joint turns into heat (F,) [W]."""
        return self._join(lambda f: f.losses(joint), 0, joint)

    @cached_property
    def power(self) -> Real:
        """Power of all friction (F,) [W]."""
        return self._join(lambda f: f.power, 0)

    def mean_losses(self) -> dict[str, float]:
        """Mean power that friction takes in each joint over the run [W]."""
        time = self._forces.motion.time
        span = float(np.ptp(time)) or 1.0
        return {p: float(np.trapezoid(self.losses(p), time)) / span for p in self.joints}


def _has(forces: Forces, joint: str) -> bool:
    model = forces.motion.model
    return joint in model.joint_index or any(r.name == joint for r in model.relations)


def _transmitted(forces: Forces, joint: str) -> Real:
    """Force [N] and couple [N m] of a joint (F, 3); where it has clearance, the moment of friction in the bearing as well."""
    total = forces.reaction(joint)
    for w in forces.applied:
        if w.kind == RUBBING and w.name == rubbing_name(joint):
            total = total + np.column_stack([np.zeros((forces.motion.frames, 2)), w.moment])
    return total


def _drives(forces: Forces, joint: str) -> bool:
    return any(d.joint == joint for d in forces.motion.mechanism.drives)


def _values_of(name: str, forces: Forces) -> Real:
    return forces.loads[name].values


def _power_of(k: int, forces: Forces) -> Real:
    power = np.asarray(power_of(forces.motion, forces.applied[k]), float)
    return np.array(np.broadcast_to(power, (forces.motion.frames,)))
