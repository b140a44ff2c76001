"""Vectors and moments of a solved scene over all frames, by family and item, and the scales at which they are drawn.

Pure functions of a `Run`: whoever draws arrows takes what is drawn from here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechcore.laws import Piecewise
from mechcore.spec import Mechanism

if TYPE_CHECKING:
    from .run import Run

__all__ = [
    "FAMILIES",
    "FORCE_FAMILIES",
    "Family",
    "Moment",
    "Scales",
    "Vector",
    "calm_frames",
    "centre_name",
    "find_moments",
    "find_scales",
    "find_vectors",
    "plotted_against",
    "point_name",
    "round_value",
]

Real = NDArray[np.float64]

LARGEST_ARROW = 1.0 / 3.0  # of the mechanism's size
CALM = 0.2  # stability of friction above which forces count for the scale of arrows
LARGEST_ARC = 0.45  # of the mechanism's size, along the arc


@dataclass(frozen=True)
class Family:
    """A kind of vector: its name, what it means, its unit and its colour (red, green, blue)."""

    name: str
    label: str
    meaning: str
    unit: str
    color: tuple[int, int, int]


FAMILIES: Mapping[str, Family] = {
    f.name: f
    for f in (
        Family("reaction", "Reactions", "force of a joint on the second link of its pair", "N", (206, 32, 58)),
        Family("applied", "Applied loads", "forces and torques that the scene applies", "N", (240, 120, 0)),
        Family("gravity", "Gravity", "weight at the centre of mass", "N", (112, 78, 38)),
        Family("inertia", "Inertia", "resultant -m a on its line of action", "N", (146, 44, 178)),
        Family("friction", "Friction", "dry friction on the second link of its pair", "N", (190, 150, 0)),
        Family("drive", "Drive", "torque or force that the drive must supply", "N", (0, 140, 70)),
        Family("velocity", "Velocity", "of traced points and centres of mass", "m/s", (22, 110, 220)),
        Family("acceleration", "Acceleration", "of traced points and centres of mass", "m/s²", (0, 158, 170)),
    )
}
FORCE_FAMILIES = ("reaction", "applied", "gravity", "inertia", "friction", "drive")


@dataclass(frozen=True, eq=False)
class Vector:
    """One vector over all frames: ``origin`` (F, 2) [m] and ``value`` (F, 2) in the family's unit."""

    family: str
    item: str
    origin: Real
    value: Real

    @property
    def magnitude(self) -> Real:
        return np.hypot(self.value[:, 0], self.value[:, 1])


@dataclass(frozen=True, eq=False)
class Moment:
    """One moment over all frames: ``origin`` (F, 2) [m] and ``value`` (F,) [N m], counter-clockwise positive."""

    family: str
    item: str
    origin: Real
    value: Real


@dataclass(frozen=True)
class Scales:
    """How large a value is drawn as one metre. Forces of all families share a scale, so that arrows can be compared."""

    newtons_per_metre: float
    newton_metres_per_metre: float  # along the arc
    mps_per_metre: float
    mps2_per_metre: float

    def per_metre(self, family: str) -> float:
        """The scale of a family's arrows."""
        return {"velocity": self.mps_per_metre, "acceleration": self.mps2_per_metre}.get(family, self.newtons_per_metre)


def round_value(value: float) -> float:
    """The largest 1, 2 or 5 times a power of ten that is not above a positive value."""
    decade = 10.0 ** np.floor(np.log10(value))
    return float(decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= value * (1.0 + 1e-9)))


def point_name(link: str, point: str) -> str:
    """Name of a link's point among all points."""
    return f"{link}.{point}"


def centre_name(link: str) -> str:
    """Name of a link's centre of mass among all points."""
    return f"{link} centre of mass"


def plotted_against(run: Run) -> str | None:
    """The drive whose coordinate a run is plotted against instead of time: the first one, if it has zones (starts and stops, each
    over a stated range) and runs one way only."""
    for drive in run.motion.mechanism.drives[:1]:
        if not isinstance(drive.law, Piecewise) or any(len(c) > 3 for c in drive.law.coefficients):
            continue
        position, rate, _ = drive.law(np.array([drive.law.knots[0], drive.law.knots[-1]]))
        steps = np.diff(run.motion.coordinate(drive.pair)[:, 0])
        rests = np.abs(rate).max() <= 1e-9 * abs(position[1] - position[0]) / drive.law.duration
        if rests and np.any(steps) and (np.all(steps >= 0.0) or np.all(steps <= 0.0)):
            return drive.pair
    return None


def find_vectors(run: Run) -> dict[str, dict[str, Vector]]:
    """All vectors of a run by family and item. Families without any item are left out."""
    found = [*_motion_vectors(run), *_force_vectors(run)]
    return {f: items for f in FAMILIES if (items := {v.item: v for v in found if v.family == f})}


def find_moments(run: Run) -> dict[str, dict[str, Moment]]:
    """All moments of a run by family and item: drive torques, applied torques, and couples in pairs."""
    forces, motion = run.forces, run.motion
    if forces is None:
        return {}
    found = []
    for drive in motion.mechanism.drives:
        found.append(Moment("drive", drive.pair, motion.pair_position(drive.pair), forces.wrench(drive.pair)[:, 2]))
    for name, load in forces.loads.items():
        if load.free:
            found.append(Moment("applied", name, _middle_of_pins(run, load.link), load.values[:, 2]))
        elif load.values[:, 2].any():
            found.append(Moment("applied", name, load.values[:, 3:], load.values[:, 2]))
    for pair in motion.mechanism.pairs:
        couple, rubs = forces.reaction(pair.name)[:, 2], np.zeros(0)
        if forces.friction is not None and pair.name in forces.friction.pairs:
            rubs = forces.friction.wrench(pair.name)[:, 2]
            found.append(Moment("friction", pair.name, forces.position(pair.name), rubs))
        if not np.array_equal(couple, rubs, equal_nan=True):  # the couple of a pin is all friction
            found.append(Moment("reaction", pair.name, forces.position(pair.name), couple))
    largest = max((_largest(m.value) for m in found), default=0.0)
    pull = max((_largest(forces.reaction(pair.name)[:, :2]) for pair in motion.mechanism.pairs), default=0.0)
    largest = max(largest, pull * motion.model.size)  # where forces balance, all moments may be nothing
    found = [m for m in found if _largest(m.value) > 1e-9 * largest]  # the rest is round-off
    return {f: items for f in FAMILIES if (items := {m.item: m for m in found if m.family == f})}


def calm_frames(run: Run) -> NDArray[np.bool_] | None:
    """Frames (F,) by which forces are scaled: near a jam they grow beyond all bounds. None where that is all of them."""
    if run.forces is None or run.forces.friction is None or not run.forces.friction.jammed.any():
        return None
    calm = np.nan_to_num(run.forces.friction.stability) > CALM
    return calm if calm.any() else None


def find_scales(
    vectors: Mapping[str, Mapping[str, Vector]],
    moments: Mapping[str, Mapping[str, Moment]],
    size: float,
    calm: NDArray[np.bool_] | None = None,
) -> Scales:
    """Scales by which the largest force, velocity and acceleration is drawn as a third of ``size`` [m].

    Where nothing is to be drawn a scale is 1. ``calm``: the frames that count, all of them where it is None.
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


def _motion_vectors(run: Run) -> list[Vector]:
    motion, mechanism = run.motion, run.motion.mechanism
    points = [(point_name(*key), [motion.point(*key, d) for d in range(3)]) for key in mechanism.traced]
    points += [(centre_name(link), [motion.centre_of_mass(link, d) for d in range(3)]) for link in _links_with_mass(mechanism)]
    return [
        Vector(family, name, derivatives[0], derivatives[order])
        for name, derivatives in points
        for order, family in ((1, "velocity"), (2, "acceleration"))
    ]


def _force_vectors(run: Run) -> list[Vector]:
    forces, motion = run.forces, run.motion
    if forces is None:
        return []
    mechanism = motion.mechanism
    found = []
    for pair in mechanism.pairs:
        found.append(Vector("reaction", pair.name, forces.position(pair.name), forces.reaction(pair.name)[:, :2]))
    for name, load in forces.loads.items():
        if not load.free:
            family, item = ("gravity", load.link) if load.kind == "gravity" else ("applied", name)
            found.append(Vector(family, item, load.values[:, 3:], load.values[:, :2]))
    if forces.friction is not None:
        for name in forces.friction.pairs:
            force = forces.friction.wrench(name)[:, :2]
            if np.any(np.nan_to_num(force)):
                found.append(Vector("friction", name, forces.position(name), force))
    if "inertia" in mechanism.effects:
        found += [_inertia_resultant(run, link) for link in _links_with_mass(mechanism)]
    for drive in mechanism.drives:
        force = forces.wrench(drive.pair)[:, :2]
        if np.any(force):
            found.append(Vector("drive", drive.pair, motion.pair_position(drive.pair), force))
    return found


def _inertia_resultant(run: Run, link: str) -> Vector:
    """The inertia force of a link on its line of action: moved from the centre of mass by moment over force."""
    assert run.forces is not None
    values = run.forces.inertia(link)
    force, moment = values[:, :2], values[:, 2]
    square = (force**2).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        # the arm at right angles to the force for which arm x force = moment
        arm = np.column_stack([force[:, 1], -force[:, 0]]) * (moment / square)[:, None]
    arm[square == 0.0] = 0.0
    return Vector("inertia", link, run.motion.centre_of_mass(link) + arm, force)


def _links_with_mass(mechanism: Mechanism) -> list[str]:
    return [link.name for link in mechanism.links if link.mass > 0.0 and link.name != mechanism.frame]


def _middle_of_pins(run: Run, link: str) -> Real:
    """Where a free moment on a link is drawn: at its pin on the frame if it has one, else in the middle of its pairs, or at its
    centre of mass where it has none."""
    mechanism = run.motion.mechanism
    pairs = [p for p in mechanism.pairs if link in p.links]
    if not pairs:
        return run.motion.centre_of_mass(link)
    grounded = [p for p in pairs if mechanism.frame in p.links]
    positions = [run.motion.pair_position(p.name) for p in grounded[:1] or pairs]
    return np.mean(positions, axis=0)
