"""The catalogue: every quantity that can be plotted, exported or looked up, with its key, unit, label and values.

It is built from the tables of a run or of a recording, so that both have the same entries.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from mechcore.arrays import Flags, Index, Real
from mechcore.records import dataclass
from mechviz.files import OutputError
from mechviz.quantities.entries import Entry, EntryFacts, entries
from mechviz.quantities.items import ItemTable
from mechviz.quantities.numbers import Numbers

MOST_INITIAL = 3
MOST_OF_IT = 0.99  # quantile of the frames at which forces are clipped
ASIDE_SINE = 0.31  # least |sine| of a crank's angle at which the crank counts as away from its dead points


@dataclass(frozen=True, eq=False)
class Quantity:
    """A quantity that can be plotted: ``values()`` gives (F, n), one column for each name in ``curves``, in ``unit``.

    ``key``: such as ``joint.B.reaction``; ``item``: the item that it belongs to, such as ``joint B``, empty for the whole
    mechanism; ``path``: of the table with its values in SI units.
    """

    entry: Entry
    table: ItemTable

    def __repr__(self) -> str:
        return f"Quantity {self.key}: {self.title}"

    @property
    def key(self) -> str:
        return self.entry.key

    @property
    def item(self) -> str:
        return self.entry.item

    @property
    def name(self) -> str:
        return self.entry.name

    @property
    def unit(self) -> str:
        return self.entry.unit

    @property
    def curves(self) -> tuple[str, ...]:
        return self.entry.curves

    @property
    def path(self) -> tuple[str, ...]:
        return self.entry.path

    @property
    def label(self) -> str:
        return f"{self.item}: {self.name}" if self.item else self.name

    @property
    def title(self) -> str:
        return f"{self.label} [{self.unit}]"

    @property
    def parts(self) -> tuple[Quantity, ...]:
        return (self,)

    def values(self) -> Real:
        return self.entry.read(self.table.values)


@dataclass(frozen=True, eq=False)
class QuantityGroup:
    """Quantities of the same unit in one plot, their curves in order. With several quantities the name of each curve contains that
    of its item."""

    parts: tuple[Quantity, ...]

    @property
    def unit(self) -> str:
        return self.parts[0].unit

    @property
    def label(self) -> str:
        return ", ".join(q.label for q in self.parts)

    @property
    def title(self) -> str:
        return f"{self.label} [{self.unit}]"

    @property
    def curves(self) -> tuple[str, ...]:
        if len(self.parts) == 1:
            return self.parts[0].curves
        return tuple(q.label if len(q.curves) == 1 else f"{q.item or q.name}: {name}" for q in self.parts for name in q.curves)

    def values(self) -> Real:
        return np.column_stack([q.values() for q in self.parts])


@dataclass(frozen=True, eq=False)
class Axis:
    """The abscissa of a plot: monotonic ``values`` (F,) in ``unit``. ``turn``: a whole turn in that unit, None for lengths and
    times; ``of``: the joint of a drive, or "time"."""

    label: str
    unit: str
    values: Real
    turn: float | None = None
    of: str = "time"

    @property
    def title(self) -> str:
        return f"{self.label} [{self.unit}]"


MEANINGS = {  # of a bad value; a large condition number alone is an event, not a fault, and has no entry
    "closure": "the loops do not close",
    "power balance": "the powers supplied and absorbed do not balance",
    "energy drift": "the energy is not conserved",
}


@dataclass(frozen=True, eq=False)
class Health:
    """A residual or condition number over the frames, ``values`` (F,). It is harmless up to ``good``; from ``bad`` on the results
    cannot be trusted."""

    name: str
    unit: str
    values: Real
    good: float
    bad: float

    @property
    def severity(self) -> Real:
        """Severity (F,) on a logarithmic scale, from 0 at ``good`` to 1 at ``bad``; 1 where a value is not finite."""
        size = np.abs(self.values)
        with np.errstate(divide="ignore", invalid="ignore"):
            part = np.log(size / self.good) / np.log(self.bad / self.good)
        return np.asarray(np.where(np.isfinite(size), np.clip(np.nan_to_num(part, nan=0.0), 0.0, 1.0), 1.0))

    def warning(self, frames: Flags | None = None) -> str:
        """Why the run cannot be trusted, as a sentence; "" where it can. ``frames`` (F,): the frames that are checked, by default
        all with a finite value."""
        if self.name not in MEANINGS:
            return ""
        size = np.abs(self.values[np.isfinite(self.values) if frames is None else frames])
        worst = float(np.max(size, initial=0.0)) if np.isfinite(size).all() else np.nan
        if worst < self.bad:
            return ""
        unit = "" if self.unit == "1" else f" {self.unit}"
        said = f"it reaches {worst:.3g}{unit}" if np.isfinite(worst) else "it is no finite number"
        return f"{MEANINGS[self.name]}: {self.name}, {said}, of at most {self.bad:.3g}{unit}."


@dataclass(frozen=True, eq=False)
class Catalogue:
    """All quantities of a run or of a recording, in the order of display."""

    numbers: Numbers

    @cached_property
    def quantities(self) -> tuple[Quantity, ...]:
        n = self.numbers
        listed = entries(tuple((path, table.columns) for path, table in n.tables.items()), entry_facts(n))
        every = (Quantity(entry, n.tables[entry.path]) for entry in listed)
        return tuple(q for q in every if not q.entry.sparse or np.isfinite(q.values()).any())

    @cached_property
    def by_key(self) -> dict[str, Quantity]:
        return {q.key: q for q in self.quantities}

    def __getitem__(self, key: str) -> Quantity:
        return self.by_key[key]

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """Abscissas of plots: the coordinates of drives that move in one direction only, then time. An oscillating drive gives no
        axis, because a plot needs ordered values."""
        axes = []
        for name in self.numbers.drives:
            position = self.coordinate(name)
            steps = np.diff(position)
            if len(steps) and np.any(steps) and (np.all(steps >= 0.0) or np.all(steps <= 0.0)):
                slides = self.numbers.is_sliding(name)
                unit, factor = self.numbers.units.display_unit("m" if slides else "rad")
                label, turn = f"{'displacement' if slides else 'angle'} of drive {name}", None if slides else 2.0 * np.pi * factor
                axes.append(Axis(label, unit, position * factor, turn, name))
        return (*axes, Axis("time", "s", self.numbers.time))

    def coordinate(self, drive: str) -> Real:
        """Coordinate (F,) of a drive [rad or m]."""
        return self.numbers.tables["data", "joints", drive, "motion"].values[:, 0]

    @cached_property
    def initial_quantities(self) -> tuple[Quantity, ...]:
        """Quantities that are plotted at first: driving efforts, then the motion of the output or of a traced point; at most
        three."""
        n = self.numbers
        wanted = [f"drive.{name}.{effort}" for name in n.drives for effort in ("torque", "force")]
        wanted += self._motion_keys(self.output)
        wanted += [f"point.{name}.{what}" for name in n.traced for what in ("position", "velocity", "acceleration")]
        wanted += self._motion_keys(next(iter(self._outputs), None))  # of several outputs the first
        passive = [name for name in n.joints if name not in n.drives]
        wanted += [q.key for name in passive[-1:] for q in self.quantities if q.item == f"joint {name}"]
        keys = [key for key in dict.fromkeys([*wanted, *self.by_key]) if key in self.by_key]
        return tuple(self.by_key[key] for key in keys[:MOST_INITIAL])

    def _motion_keys(self, joint: str | None) -> list[str]:
        """Keys of the motion of a joint on the frame; none where ``joint`` is None."""
        n = self.numbers
        if joint is None:
            return []
        if n.is_sliding(joint):
            return [f"joint.{joint}.{what}" for what in ("displacement", "velocity", "acceleration")]
        link = next((name for name in n.joints[joint].links if name != n.frame), "")
        # for a pin the angle of its link: it counts from the world's x axis, whatever the order of the joint's links
        return [f"link.{link}.{what}" for what in ("angle", "angular_velocity", "angular_acceleration")]

    @property
    def output(self) -> str | None:
        """The output joint: the undriven slide on the frame, or where there is none, the undriven pin on the frame.

        None if there are several or none.
        """
        return self._outputs[0] if len(self._outputs) == 1 else None

    @cached_property
    def _outputs(self) -> list[str]:
        """The undriven joints on the frame, without welds: the slides, or where there are none, all others."""
        n = self.numbers
        grounded = [
            name for name, joint in n.joints.items() if name not in n.drives and n.frame in joint.links and joint.kind != "weld"
        ]
        return [name for name in grounded if n.is_sliding(name)] or grounded

    @cached_property
    def health(self) -> tuple[Health, ...]:
        """Health of the run: closure error, condition number, power balance and energy drift, as far as there are tables of them.

        The limits are those of the solver: it guarantees a closure error of ``tolerance``, and a condition number of 1e8 is
        singular.
        """
        tolerance = self.numbers.tolerance
        limits = {
            "closure": ("m", tolerance, 1e6 * tolerance),
            "condition": ("1", 30.0, 1e8),
            "power_balance": ("1", 1e-9, 1e-3),
            "energy_drift": ("1", 1e-7, 1e-3),
        }
        health = []
        for name, (si, good, bad) in limits.items():
            values = self.numbers.values("health", name)
            if values is not None:
                unit, factor = self.numbers.units.display_unit(si, small=True)
                health.append(Health(name.replace("_", " "), unit, factor * values[:, 0], factor * good, factor * bad))
        return tuple(health)

    @cached_property
    def opening_frame(self) -> int:
        """The frame that is shown first, see `opening_frame_among`."""
        return self.opening_frame_among(np.arange(len(self.numbers.time)))

    def opening_frame_among(self, rows: Index) -> int:
        """Which of the frames ``rows`` (R,) is shown first.

        With forces, the frame where the sum of reactions and driving efforts, relative to their peaks, is largest; of frames that
        are equal to six digits the first. Frames near the dead points of a crank are left out, because links and arrows lie on one
        line there. Without forces, the frame at an eighth of the first drive's cycle.
        """
        n = self.numbers
        if n.has_forces:
            reactions = [np.hypot(*v[rows, :2].T) for j in n.joints if (v := n.values("data", "joints", j, "reaction")) is not None]
            efforts = [v[rows, 3] for d in n.drives if (v := n.values("data", "drive", d)) is not None]
            peaks = [np.max(reactions, axis=0), *efforts] if reactions else efforts
            load = sum((_of_peak(values) for values in peaks), np.zeros(len(rows)))
            if n.drives and not n.is_sliding(n.drives[0]):
                load = np.where(np.abs(np.sin(self.coordinate(n.drives[0])[rows])) > ASIDE_SINE, load, 0.0)
            if np.any(np.nan_to_num(load)):
                return int(np.argmax(np.round(np.nan_to_num(load), 6)))
        passed = n.time - n.time[0]
        cycle = min(n.cycle, float(passed[-1])) or 1.0
        return int(np.argmin(np.round(np.abs(passed[rows] / cycle - 0.125), 6)))  # the first of two that are equally near

    def peak(self, key: str) -> float:
        """The largest absolute value of a quantity over the run; NaN where no quantity has this key."""
        if key not in self.by_key:
            return float("nan")
        values = np.abs(self.by_key[key].values())
        return float(np.max(values, initial=0.0, where=np.isfinite(values)))


def entry_facts(n: Numbers) -> EntryFacts:
    """The names and facts that the entries of the catalogue depend on in addition to the tables."""
    pins = frozenset(name for name in n.joints if n.is_pin(name))
    rubbing = frozenset(name for name in n.joints if n.has_friction(name))
    return EntryFacts(n.frame, n.drives, tuple(n.joints), n.links, n.points, tuple(n.loads), pins, rubbing, n.has_forces, n.units)


def _of_peak(values: Real) -> Real:
    """Magnitudes (F,) relative to their peak, clipped at the quantile ``MOST_OF_IT`` so that a peak next to a jam does not
    dominate; 0 where a value is not finite or all are zero."""
    size = np.nan_to_num(np.abs(values), nan=0.0, posinf=0.0)
    size = np.minimum(size, np.quantile(size, MOST_OF_IT))
    return np.asarray(size / max(float(size.max(initial=0.0)), 1e-300))


def time_decimals(time: Real) -> int:
    """Number of decimals in which the times (F,) [s] of frames are displayed: at least four, and up to nine where neighbouring
    frames need them to differ."""
    step = float(np.ptp(time)) / max(len(time) - 1, 1)
    return max(4, min(math.ceil(-math.log10(step)), 9)) if step > 0.0 else 4


NANOSECOND, ROUNDING = 1e-9, 1e-9  # [s], [rad]: tolerances at the ends of a run


def time_at(catalogue: Catalogue, *, at: float | None = None, frame: int | None = None, angle: float | None = None) -> float | None:
    """The time [s] given by a time ``at`` [s], by a frame, or by the ``angle`` [rad] that the first rotary drive reaches at it (for
    the first time); None where none of them is given.

    Raises `OutputError` where it is outside the run, or where no drive turns.
    """
    numbers = catalogue.numbers
    time = numbers.time
    if at is not None:
        if not time[0] - NANOSECOND <= at <= time[-1] + NANOSECOND:
            raise OutputError(
                f"The time {at:g} s is outside the run, which goes from {time[0]:g} s to {time[-1]:g} s.", "Name a time in it."
            )
        return at
    if frame is not None:
        if not 0 <= frame < len(time):
            raise OutputError(f"Frame {frame} is not in the run, whose frames are 0 to {len(time) - 1}.", "Name one of them.")
        return float(time[frame])
    if angle is None:
        return None
    turning = [name for name in numbers.drives if not numbers.is_sliding(name)]
    if not turning:
        raise OutputError("There is no angle to go to: no drive of this mechanism turns.", "Name a time or a frame.")
    position = catalogue.coordinate(turning[0])
    if len(position) == 1:
        position, time = np.repeat(position, 2), np.repeat(time, 2)
    low, high = np.minimum(position[:-1], position[1:]), np.maximum(position[:-1], position[1:])
    reached = np.flatnonzero((low - ROUNDING <= angle) & (angle <= high + ROUNDING))
    if not len(reached):
        wanted, least, most = (numbers.units.text(x, "rad", 6) for x in (angle, position.min(), position.max()))
        raise OutputError(f"The angle {wanted} is outside what the drive does, {least} to {most}.", "Name an angle in it.")
    k = int(reached[0])
    part = 0.0 if position[k + 1] == position[k] else (angle - position[k]) / (position[k + 1] - position[k])
    part = min(max(part, 0.0), 1.0)
    return float(time[k] + part * (time[k + 1] - time[k]))
