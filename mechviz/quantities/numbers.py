"""The numerical results of a run or of a recording: tables, and the connectivity of the links. Pictures and plots are made from
these alone, so that runs and recordings are treated in the same way."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Real, Vec2
from mechcore.records import dataclass
from mechcore.spec.loads import Actuator, Damper, GasSpring, Spring
from mechcore.spec.mechanism import Mechanism
from mechviz.quantities.items import ItemTable, JointInfo, Source, joints_of, links_of
from mechviz.quantities.tables import tables
from mechviz.quantities.vectors import centre_name, point_name
from mechviz.scene.units import Units

if TYPE_CHECKING:
    from mechviz.runs import Run


TOLERANCE = 1e-12
"""Closure error that the solver guarantees, relative to the size of the mechanism."""


FRAMES_BEYOND = 0.1
"""Part of the frames that do not count for `usual_size`."""


def usual_size(values: Real) -> float:
    """The largest magnitude of values (F, n), without the tenth of the frames with the largest ones: a quantity may run off to
    infinity at a frame, as an instant centre does. 0 where no value is known."""
    known = np.isfinite(values)
    sizes = np.max(np.abs(values), axis=1, initial=0.0, where=known)[known.any(axis=1)]
    return float(np.quantile(sizes, 1.0 - FRAMES_BEYOND, method="lower")) if len(sizes) else 0.0


@dataclass(frozen=True)
class LoadInfo:
    """A load: its kind and the links that it acts on; the tabulated values act on the first. ``points``: of a load between two
    points, their coordinates in the frames of the links [m]."""

    kind: str
    links: tuple[str, ...]
    points: tuple[Vec2, ...] = ()


@dataclass(frozen=True, eq=False)
class Numbers:
    """Tables by path, over the frames at ``time`` (F,) [s], and the connectivity: ``frame`` is the fixed link, ``drives`` are names
    of joints, ``traced`` names of points.

    ``cycle``: period of the first drive [s]; ``length_scale``: characteristic length of the equations [m]; ``tolerance``: closure
    error that the solver guarantees [m]; ``units``: those of the display.
    """

    time: Real
    frame: str
    links: tuple[str, ...]
    joints: Mapping[str, JointInfo]
    drives: tuple[str, ...]
    loads: Mapping[str, LoadInfo]
    traced: tuple[str, ...]
    tables: Mapping[tuple[str, ...], ItemTable]
    units: Units
    cycle: float
    length_scale: float
    tolerance: float

    @cached_property
    def cached(self) -> bool:
        """Whether every table keeps the values that it has computed."""
        return all(table.cached for table in self.tables.values())

    def derived_source(self, compute: Callable[[], Real]) -> Source:
        """Source of values that follow from the tables: computed now where all tables are kept, else at each use."""
        return compute() if self.cached else compute

    def values(self, *path: str) -> Real | None:
        """Values (F, n) of the table at a path; None where there is no such table."""
        table = self.tables.get(path)
        return None if table is None else table.values

    @property
    def has_forces(self) -> bool:
        """Whether reactions were computed."""
        return ("data", "energy") in self.tables

    def has_friction(self, joint: str) -> bool:
        """Whether there is friction in a joint."""
        return ("data", "joints", joint, "friction") in self.tables

    def is_pin(self, joint: str) -> bool:
        """Whether a joint is a revolute joint without clearance, whose couple is due to dry friction alone."""
        return self.joints[joint].kind == "revolute"

    def is_sliding(self, joint: str) -> bool:
        """Whether a joint's coordinate is a displacement; else it is an angle."""
        return self.joints[joint].unit == "m"

    @cached_property
    def points(self) -> tuple[str, ...]:
        """Names of the traced points, and of the centres of mass that have a table."""
        centres = [centre_name(link) for link in self.links]
        return (*self.traced, *(c for c in centres if ("data", "points", c, "position") in self.tables))

    def world_positions(self, link: str, xy: Vec2) -> Real:
        """World positions (F, 2) [m] of a point given in a link's frame [m]."""
        x, y, angle = self.poses[link].T
        c, s = np.cos(angle), np.sin(angle)
        return np.column_stack([x + c * xy[0] - s * xy[1], y + s * xy[0] + c * xy[1]])

    @cached_property
    def poses(self) -> Mapping[str, Real]:
        """x, y [m] and angle [rad] (F, 3) of all links."""
        return PoseTables(self)


class PoseTables(Mapping[str, Real]):
    """Poses (F, 3) of all links, from their tables."""

    def __init__(self, numbers: Numbers):
        self._numbers = numbers

    def __getitem__(self, link: str) -> Real:
        return self._numbers.tables["data", "links", link, "pose"].values

    def __iter__(self) -> Iterator[str]:
        return iter(self._numbers.links)

    def __len__(self) -> int:
        return len(self._numbers.links)


def numbers_of(run: Run) -> Numbers:
    """The numerical results of a run; each table is computed when it is used."""
    motion, mechanism = run.motion, run.motion.mechanism
    loads = {} if run.forces is None else run.forces.loads
    return Numbers(
        time=np.asarray(motion.time, float),
        frame=mechanism.frame,
        links=tuple(links_of(motion)),
        joints={j.name: j for j in joints_of(motion)},
        drives=tuple(d.joint for d in mechanism.drives),
        loads={name: LoadInfo(load.kind, tuple(load.links), _ends(mechanism, name)) for name, load in loads.items()},
        traced=tuple(point_name(*key) for key in mechanism.traced),
        tables={table.path: table for table in tables(run)},
        units=run.scene.units,
        cycle=cycle_of(run),
        length_scale=motion.model.length_scale,
        tolerance=closure_tolerance(run),
    )


def _ends(mechanism: Mechanism, name: str) -> tuple[Vec2, ...]:
    """The points of a load between two points, in the frames of its links [m]; empty for other loads."""
    load = next((load for load in mechanism.loads if load.name == name), None)
    if not isinstance(load, Spring | Damper | GasSpring | Actuator) or not load.points:
        return ()
    places = {link.name: link.points for link in mechanism.links}
    return tuple((float(x), float(y)) for x, y in (places[link][p] for link, p in zip(load.links, load.points, strict=True)))


def closure_tolerance(run: Run) -> float:
    """Closure error [m] that the solver guarantees with the accuracy of a run."""
    return max(TOLERANCE, run.accuracy.position) * run.motion.model.length_scale


def cycle_of(run: Run) -> float:
    """Period of the first drive's cycle [s]; the duration of the run where there is none, 1 for a single instant."""
    cycle = run.motion.mechanism.cycle
    return cycle if np.isfinite(cycle) and cycle > 0.0 else float(np.ptp(run.motion.time)) or 1.0
