"""Motion and forces over several charts, put together frame by frame: results by name, as from one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..kinetostatics import Forces, LoadResult
from ..motion import Motion

__all__ = ["JoinedForces", "JoinedMotion"]

Array = NDArray[np.float64]
TURN = 2.0 * np.pi


class JoinedMotion:
    """Results of a `Motion` by name, whose frames come from several motions of the same mechanism."""

    def __init__(self, time: Array, parts: Sequence[tuple[Any, Motion]]):
        self.time = time
        self.parts = tuple(parts)
        self.model = parts[0][1].model
        self.changes = tuple(c for _, m in parts for c in m.changes)

    @property
    def mechanism(self) -> Any:
        return self.model.mechanism

    @property
    def frames(self) -> int:
        return len(self.time)

    @property
    def shape(self) -> tuple[int, ...]:
        return (self.frames,)

    def _join(self, value: Callable[[Motion], Array]) -> Array:
        first = [(rows, value(m)) for rows, m in self.parts]
        out = np.empty((self.frames, *first[0][1].shape[1:]))
        for rows, values in first:
            out[rows] = values
        return out

    def pose(self, link: str) -> Array:
        """x, y [m] and angle [rad], continuous over the frames (F, 3)."""
        out = self._join(lambda m: m.pose(link))
        out[:, 2] = self._continuous(out[:, 2], self.velocity(link)[:, 2])
        return out

    def _continuous(self, angle: Array, rate: Array) -> Array:
        """Whole turns between the parts put right, by the speeds on both sides."""
        went = 0.5 * (rate[1:] + rate[:-1]) * np.diff(self.time)
        jump = np.round((np.diff(angle) - went) / TURN)
        return np.asarray(angle - TURN * np.concatenate([[0.0], np.cumsum(jump)]))

    def velocity(self, link: str) -> Array:
        return self._join(lambda m: m.velocity(link))

    def acceleration(self, link: str) -> Array:
        return self._join(lambda m: m.acceleration(link))

    def point(self, link: str, point: str, derivative: int = 0) -> Array:
        return self._join(lambda m: m.point(link, point, derivative))

    def centre_of_mass(self, link: str, derivative: int = 0) -> Array:
        return self._join(lambda m: m.centre_of_mass(link, derivative))

    def coordinate(self, pair: str) -> Array:
        """Relative coordinate of a pair and its first two derivatives (F, 3)."""
        out = self._join(lambda m: m.coordinate(pair))
        joint = self.model.joints[self.model.joint_index[pair]] if pair in self.model.joint_index else None
        if joint is None or joint.coordinate == "angle":
            out[:, 0] = self._continuous(out[:, 0], out[:, 1])
        return out

    def pair_position(self, pair: str) -> Array:
        return self._join(lambda m: m.pair_position(pair))

    @cached_property
    def closure(self) -> Array:
        return self._join(lambda m: m.closure)

    @cached_property
    def velocity_closure(self) -> Array:
        return self._join(lambda m: m.velocity_closure)

    @cached_property
    def acceleration_closure(self) -> Array:
        return self._join(lambda m: m.acceleration_closure)

    @cached_property
    def condition(self) -> Array:
        return self._join(lambda m: m.condition)


class JoinedForces:
    """Results of `Forces` by name, whose frames come from several motions of the same mechanism."""

    def __init__(self, motion: JoinedMotion, parts: Sequence[tuple[Any, Forces]]):
        self.motion = motion
        self.parts = tuple(parts)

    def _join(self, value: Callable[[Forces], Array]) -> Array:
        first = [(rows, value(f)) for rows, f in self.parts]
        out = np.empty((self.motion.frames, *first[0][1].shape[1:]))
        for rows, values in first:
            out[rows] = values
        return out

    def reaction(self, pair: str) -> Array:
        """Everything that the pair transmits; where its coordinate leads a part, the drive has nothing to do."""
        return self._join(lambda f: f.reaction(pair))

    def position(self, pair: str) -> Array:
        return self._join(lambda f: f.position(pair))

    def effort(self, pair: str) -> Array:
        """What the drive or the hold of a pair exerts, zero where the pair is not led (F,)."""
        return self._join(lambda f: f.effort(pair) if _leads(f, pair) else np.zeros(f.motion.frames))

    def wrench(self, pair: str) -> Array:
        return self._join(lambda f: f.wrench(pair) if _leads(f, pair) else np.zeros((f.motion.frames, 3)))

    def power(self, pair: str) -> Array:
        return self._join(lambda f: f.power(pair) if _leads(f, pair) else np.zeros(f.motion.frames))

    def friction(self, pair: str) -> Array:
        """Friction on the pair's second link: Fx, Fy [N], couple [N m] (F, 3); zero where the scene names none."""
        return self._join(lambda f: np.zeros((f.motion.frames, 3)) if f.friction is None else f.friction.applied(pair))

    def power_by_cause(self, causes: Sequence[str]) -> Array:
        return self._join(lambda f: f.power_by_cause(causes))

    def inertia(self, link: str) -> Array:
        return self._join(lambda f: f.inertia(link))

    @cached_property
    def loads(self) -> dict[str, LoadResult]:
        names = self.parts[0][1].loads
        return {
            n: LoadResult(
                name=load.name,
                kind=load.kind,
                cause=load.cause,
                links=load.links,
                values=self._join(lambda f, n=n: f.loads[n].values),  # type: ignore[misc]
            )
            for n, load in names.items()
        }

    @cached_property
    def kinetic_energy(self) -> Array:
        return self._join(lambda f: f.kinetic_energy)

    @cached_property
    def potential_energy(self) -> Array:
        return self._join(lambda f: f.potential_energy)

    @cached_property
    def power_balance(self) -> Array:
        return self._join(lambda f: f.power_balance)


def _leads(forces: Forces, pair: str) -> bool:
    return any(d.pair == pair for d in forces.motion.mechanism.drives)
