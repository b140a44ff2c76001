"""Families of vectors and moments over all frames, and the scales of their arrows; see also `picture.arrows`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Real
from mechcore.laws.timed import Piecewise
from mechcore.records import dataclass
from mechviz.quantities.items import Source, values_of

if TYPE_CHECKING:
    from mechviz.runs import Run


LARGEST_ARROW = 1.0 / 3.0  # length of the longest arrow, relative to the mechanism's size
CALM_STABILITY = 0.2  # stability of friction above which forces count for the scale of arrows
LARGEST_ARC = 0.45  # length of the longest arc of a moment, relative to the mechanism's size


@dataclass(frozen=True)
class VectorFamily:
    """A kind of vector: name, label, meaning, unit and colours (red, green, blue) on light and dark backgrounds."""

    name: str
    label: str
    meaning: str
    unit: str
    color: tuple[int, int, int]
    on_dark: tuple[int, int, int]


VECTOR_FAMILIES: Mapping[str, VectorFamily] = {
    f.name: f
    for f in (
        VectorFamily(
            "reaction", "Reactions", "force of a joint on the second link of its joint", "N", (206, 32, 58), (255, 72, 84)
        ),
        VectorFamily("applied", "Applied loads", "forces and torques that the scene applies", "N", (240, 120, 0), (255, 138, 20)),
        VectorFamily("gravity", "Gravity", "weight at the centre of mass", "N", (112, 78, 38), (214, 178, 130)),
        VectorFamily("inertia", "Inertia", "resultant -m a on its line of action", "N", (146, 44, 178), (208, 112, 246)),
        VectorFamily("friction", "Friction", "dry friction on the second link of its joint", "N", (190, 150, 0), (255, 214, 92)),
        VectorFamily("drive", "Drive", "torque or force that the drive must supply", "N", (0, 140, 70), (72, 222, 128)),
        VectorFamily("velocity", "Velocity", "of traced points and centres of mass", "m/s", (22, 110, 220), (84, 168, 255)),
        VectorFamily("acceleration", "Acceleration", "of traced points and centres of mass", "m/s²", (0, 158, 170), (52, 214, 220)),
    )
}
FORCE_FAMILIES = ("reaction", "applied", "gravity", "inertia", "friction", "drive")


@dataclass(frozen=True, eq=False)
class PlacedVector:
    """A vector or moment at a place, over all frames: ``origin`` (F, 2) [m] and ``value``, both read from sources."""

    family: str
    item: str
    places: Source
    values: Source

    @property
    def origin(self) -> Real:
        return values_of(self.places)

    @property
    def value(self) -> Real:
        return values_of(self.values)


@dataclass(frozen=True, eq=False)
class Vector(PlacedVector):
    """One vector over all frames, its ``value`` (F, 2) in the family's unit."""

    @property
    def magnitude(self) -> Real:
        x, y = self.value.T
        return np.asarray(np.hypot(x, y))

    @property
    def entity(self) -> tuple[str, ...]:
        """Entity path, in parts, of its arrow in a recording."""
        return "vectors", self.family, self.item


@dataclass(frozen=True, eq=False)
class Moment(PlacedVector):
    """One moment over all frames: ``value`` (F,) [N m], counter-clockwise positive. ``shown`` (F,): the frames where it is drawn;
    None: all frames."""

    shown: NDArray[np.bool_] | None = None

    @property
    def entity(self) -> tuple[str, ...]:
        """Entity path, in parts, of its arc in a recording: below that of the force, where there may be one."""
        beside = {"drive": (), "applied": (), "inertia": ("moment",)}.get(self.family, ("couple",))
        return ("vectors", self.family, self.item, *beside)


@dataclass(frozen=True)
class Scales:
    """Values that are drawn as one metre. All families of forces share one scale, so that their arrows can be compared."""

    newtons_per_metre: float
    newton_metres_per_metre: float  # per metre of arc length
    mps_per_metre: float
    mps2_per_metre: float

    def per_metre(self, family: str) -> float:
        """The scale of a family's arrows."""
        return {"velocity": self.mps_per_metre, "acceleration": self.mps2_per_metre}.get(family, self.newtons_per_metre)


def round_value(value: float) -> float:
    """The largest number of the form 1, 2 or 5 times a power of ten that is at most a positive value."""
    decade = 10.0 ** np.floor(np.log10(value))
    return float(decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= value * (1.0 + 1e-9)))


def point_name(link: str, point: str) -> str:
    """Name of a link's point among all points."""
    return f"{link}.{point}"


def centre_name(link: str) -> str:
    """Name of a link's centre of mass among all points."""
    return f"{link} centre of mass"


def plotted_against(run: Run) -> str | None:
    """The joint of the drive whose coordinate replaces time as abscissa, or None: the first drive, if its law is piecewise of at
    most second order, begins and ends at rest, and moves in one direction only (starts and stops over stated ranges)."""
    for drive in run.motion.mechanism.drives[:1]:
        if not isinstance(drive.law, Piecewise) or any(len(c) > 3 for c in drive.law.coefficients):
            continue
        position, rate, _ = drive.law(np.array([drive.law.knots[0], drive.law.knots[-1]]))
        steps = np.diff(run.motion.coordinate(drive.joint)[:, 0])
        rests = np.abs(rate).max() <= 1e-9 * abs(position[1] - position[0]) / drive.law.duration
        if rests and np.any(steps) and (np.all(steps >= 0.0) or np.all(steps <= 0.0)):
            return drive.joint
    return None


def calm_frames(run: Run) -> NDArray[np.bool_] | None:
    """Frames (F,) that count for the scale of forces: those away from a jam, near which forces are unbounded. None: all frames."""
    if run.forces is None or run.forces.friction is None or not run.forces.friction.jammed.any():
        return None
    calm = np.nan_to_num(run.forces.friction.stability) > CALM_STABILITY
    return calm if calm.any() else None


def find_scales(
    vectors: Mapping[str, Mapping[str, Vector]],
    moments: Mapping[str, Mapping[str, Moment]],
    size: float,
    calm: NDArray[np.bool_] | None = None,
) -> Scales:
    """Scales at which the largest force, velocity and acceleration are a third of ``size`` [m] long, and the arc of the largest
    moment 0.45 of it.

    A scale is 1 where there is nothing to draw. ``calm``: the frames that count; None: all frames.
    """

    def peak(values: Real) -> float:
        return _largest(values if calm is None else values[calm])

    def largest(families: Iterable[str]) -> float:
        return max((peak(v.magnitude) for f in families for v in vectors.get(f, {}).values()), default=0.0)

    def scale(value: float, length: float) -> float:
        return value / (length * size) if value > 0.0 else 1.0

    turning = max((peak(m.value) for items in moments.values() for m in items.values()), default=0.0)
    return Scales(
        newtons_per_metre=scale(largest(FORCE_FAMILIES), LARGEST_ARROW),
        newton_metres_per_metre=scale(turning, LARGEST_ARC),
        mps_per_metre=scale(largest(["velocity"]), LARGEST_ARROW),
        mps2_per_metre=scale(largest(["acceleration"]), LARGEST_ARROW),
    )


def _largest(values: Real) -> float:
    return float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))
