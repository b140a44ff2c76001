"""Tables and their columns, the links and joints of a run that have tables, and interpolation of a table between its frames.

Interpolation uses recorded derivatives where there are any: velocity and acceleration for a pose, acceleration for a velocity, and
for coordinates of joints and drives the rates in the same table. Other quantities are interpolated by polynomials through the
nearest frames."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Real
from mechcore.motion.motion import Motion
from mechcore.numerics.interpolation import between
from mechcore.records import dataclass
from mechcore.spec.clearance import auxiliary_names, journals_of

if TYPE_CHECKING:
    from mechviz.runs import Run

ColumnUnits = tuple[tuple[str, str], ...]
Source = Real | Callable[[], Real]
"""Values, or a function that computes them at each call."""

ERROR_COLUMNS = ("position", "velocity", "acceleration", "reaction", "between_frames")
"""Columns of the table ``/health/error_estimate``."""


@dataclass(frozen=True, eq=False)
class ItemTable:
    """Values (F, n) of one item. ``path``: parts of its entity path in a recording; ``columns``: name and unit of each component.

    ``source``: the values, or a function that computes them. If ``cached``, they are computed once at first use and kept; otherwise
    they are computed at each use, which saves memory in long runs of many bodies.
    """

    path: tuple[str, ...]
    item: str
    columns: ColumnUnits
    source: Source
    cached: bool = True

    @property
    def values(self) -> Real:
        return self._computed if self.cached else values_of(self.source)

    @cached_property
    def _computed(self) -> Real:
        return values_of(self.source)

    def part(self, columns: slice | int) -> Source:
        """Source of the values of some columns (F, n) or of one (F,): the values where the table is kept, else a function."""
        return self.values[:, columns] if self.cached else partial(_part, self, columns)

    def headers(self) -> list[str]:
        """Column names with units, such as ``crank.x [m]``."""
        return [f"{self.item}.{name} [{unit}]" for name, unit in self.columns]


def _part(table: ItemTable, columns: slice | int) -> Real:
    return table.values[:, columns]


def values_of(source: Source) -> Real:
    """The values of a source, computed if it is a function."""
    return source() if callable(source) else source


@dataclass(frozen=True)
class JointInfo:
    """A joint that transmits forces: one of the mechanism, or one that belongs to a composite joint (such as the pins of a
    cylinder)."""

    name: str
    kind: str
    links: tuple[str, str]
    unit: str  # of its coordinate: "m" for a displacement, "rad" for an angle


def joints_of(motion: Motion) -> list[JointInfo]:
    """All joints of a mechanism in its order, then the cams, gears, racks and belts that have no coordinate of their own. A joint
    with clearance is one joint."""
    model = motion.model
    journals = journals_of(model.mechanism)
    bearing = {name: load.links[::2] for name, load in journals.items()}
    made = auxiliary_names(model.mechanism)
    joints = [
        JointInfo(
            j.name,
            "revolute with clearance" if j.name in bearing else j.kind,
            bearing.get(j.name, j.links),
            "m" if j.coordinate == "slide" else "rad",
        )
        for j in model.joints
        if j.name not in made
    ]
    known = {j.name for j in joints}
    return joints + [JointInfo(r.name, r.kind, r.links, "rad") for r in model.relations if r.name not in known]


def links_of(motion: Motion) -> list[str]:
    """Names of all links, the frame first. Links of composite joints are included, except those of clearance and planar joints."""
    made = auxiliary_names(motion.model.mechanism)
    return [name for name in motion.model.links if name not in made]


def joint_unit(motion: Motion, joint: str) -> str:
    """Unit of a joint's coordinate: "m" or "rad"."""
    return next(j.unit for j in joints_of(motion) if j.name == joint)


def links_with_mass(run: Run) -> list[str]:
    """Names of moving links with a mass or a moment of inertia; none where neither inertia nor gravity is computed."""
    mechanism = run.motion.mechanism
    if run.forces is None or not {"inertia", "gravity"} & set(mechanism.effects):
        return []
    return [link.name for link in mechanism.links if link.name != mechanism.frame and (link.mass or link.inertia)]


Path = tuple[str, ...]

_RATES = {"pose": ("velocity", "acceleration"), "position": ("velocity", "acceleration"), "velocity": ("acceleration", None)}


def derivative_paths(path: Path) -> tuple[Path | None, Path | None]:
    """Paths of the tables with the first and the second time derivative of a table; None where there is none."""
    if path[:1] != ("data",) or path[1] not in ("links", "points") or path[-1] not in _RATES:
        return None, None
    first, second = _RATES[path[-1]]
    return (*path[:-1], first), (*path[:-1], second) if second else None


def interpolate_table(path: Path, time: Real, values: Callable[[Path], Real | None], t: Real, order: int) -> Real:
    """Values (n, m) of a table at times ``t`` (n,) [s], interpolated with ``order`` from its values (F, m) at the ``time`` (F,) of
    the frames.

    ``values`` gives the values of a path, or None. Outside the run the values are those of its ends. Raises `KeyError` where there
    is no such table.
    """
    own = values(path)
    if own is None:
        raise KeyError("/" + "/".join(path))
    t = np.clip(np.asarray(t, float), time[0], time[-1])
    if len(time) < 2:
        return np.repeat(own[:1], len(t), axis=0)
    first, second = (None if p is None else values(p) for p in derivative_paths(path))
    drive = path[:2] == ("data", "drive") and len(path) == 3
    joint = path[:2] == ("data", "joints") and path[-1] == "motion"
    if not (drive or joint):
        return between(time, own, t, order, first, second)
    coordinate = between(time, own[:, :1], t, order, own[:, 1:2], own[:, 2:3])
    speed = between(time, own[:, 1:2], t, order, own[:, 2:3])
    return np.hstack([coordinate, speed, between(time, own[:, 2:], t, order)])
