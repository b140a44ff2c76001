"""The numbers of a run or of a recording: the same tables, with what connects the links. All that is drawn or plotted follows
from them, whichever they are of."""

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
"""Loop residual that the solver promises, in sizes of the mechanism."""


@dataclass(frozen=True)
class LoadInfo:
    """A load: what it is, and the links that it acts on; the stated values act on the first. ``points`` of a load between two
    points: where they are on the links, in the links' frames [m]."""

    kind: str
    links: tuple[str, ...]
    points: tuple[Vec2, ...] = ()


@dataclass(frozen=True, eq=False)
class Numbers:
    """Tables by the parts of their paths, over the frames at ``time`` (F,) [s], and the connectivity: the ``frame`` is the fixed
    link, ``drives`` are names of joints, ``traced`` names of points.

    ``cycle``: how long a cycle of the first drive takes [s]; ``length_scale`` of the equations [m]; ``tolerance``: closure that
    the solver promises [m]; ``units`` in which people read all that.
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
    def kept(self) -> bool:
        """Whether all values that were computed once are kept."""
        return all(table.kept for table in self.tables.values())

    def held(self, compute: Callable[[], Real]) -> Source:
        """Values that follow from the tables, kept as they are."""
        return compute() if self.kept else compute

    def values(self, *path: str) -> Real | None:
        """Values (F, n) of a table; None where it is not there."""
        table = self.tables.get(path)
        return None if table is None else table.values

    @property
    def has_forces(self) -> bool:
        """Whether reactions were computed."""
        return ("data", "energy") in self.tables

    def rubs(self, joint: str) -> bool:
        """Whether there is friction in a joint."""
        return ("data", "joints", joint, "friction") in self.tables

    def is_pin(self, joint: str) -> bool:
        """Whether a joint is a pin, whose couple is friction alone."""
        return self.joints[joint].kind.startswith("revolute")

    def slides(self, joint: str) -> bool:
        """Whether a joint's coordinate is a displacement; else it is an angle."""
        return self.joints[joint].unit == "m"

    @cached_property
    def points(self) -> tuple[str, ...]:
        """Names of the traced points and of the centres of mass that count."""
        centres = [centre_name(link) for link in self.links]
        return (*self.traced, *(c for c in centres if ("data", "points", c, "position") in self.tables))

    def place(self, link: str, xy: Vec2) -> Real:
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
    """The numbers of a run; each table is computed when it is asked for."""
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
    """Where a load between two points acts on its links, in their frames [m]."""
    load = next((load for load in mechanism.loads if load.name == name), None)
    if not isinstance(load, Spring | Damper | GasSpring | Actuator) or not load.points:
        return ()
    places = {link.name: link.points for link in mechanism.links}
    return tuple((float(x), float(y)) for x, y in (places[link][p] for link, p in zip(load.links, load.points, strict=True)))


def closure_tolerance(run: Run) -> float:
    """Closure [m] up to which all is well."""
    return max(TOLERANCE, run.accuracy.position) * run.motion.model.length_scale


def cycle_of(run: Run) -> float:
    """How long a cycle takes [s]; the whole run where that is unknown, 1 of one instant."""
    cycle = run.motion.mechanism.cycle
    return cycle if np.isfinite(cycle) and cycle > 0.0 else float(np.ptp(run.motion.time)) or 1.0
