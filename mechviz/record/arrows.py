"""Arrows and arcs: forces, moments, velocities and accelerations as shapes in the plane, to scale."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechcore.spec import Force

from ..tables import centre_name, links_with_mass, point_name

if TYPE_CHECKING:
    from ..run import Run

__all__ = ["COLORS", "Arc", "Arrow", "Scales", "arc_strips", "arc_sweep", "extent", "inertia_line", "shapes", "visible"]

Real = NDArray[np.float64]

COLORS: dict[str, tuple[int, int, int]] = {
    "reaction": (255, 82, 82),
    "applied": (255, 64, 200),
    "gravity": (176, 190, 210),
    "inertia": (90, 220, 120),
    "drive": (255, 200, 50),
    "velocity": (70, 200, 255),
    "acceleration": (200, 130, 255),
}
"""One colour per family, saturated, so that arrows stand out from the calm colours of the links."""

LARGEST = 1.0 / 3.0  # the largest arrow of a family, in sizes of the mechanism
SHORTEST = 0.015  # arrows below this are left out
ARC_RADIUS = 0.085
ARC_LARGEST = np.radians(300.0)
ARC_POINTS = 24


@dataclass(frozen=True, eq=False)
class Arrow:
    """Vectors (F, 2) in SI units at points (F, 2) [m]."""

    path: tuple[str, ...]
    family: str
    origins: Real
    vectors: Real


@dataclass(frozen=True, eq=False)
class Arc:
    """Moments (F,) [N m], counter-clockwise positive, about points (F, 2) [m]. ``shown`` (F,): where they are drawn."""

    path: tuple[str, ...]
    family: str
    centres: Real
    moments: Real
    shown: NDArray[np.bool_]


@dataclass(frozen=True)
class Scales:
    """What one metre of an arrow (or of an arc's length) stands for; NaN for what the run does not have."""

    newtons_per_metre: float
    newton_metres_per_metre: float
    mps_per_metre: float
    mps2_per_metre: float

    def of(self, family: str) -> float:
        """Scale of a family of arrows."""
        return {"velocity": self.mps_per_metre, "acceleration": self.mps2_per_metre}.get(family, self.newtons_per_metre)


def visible(vectors: Real, scale: float, size: float) -> NDArray[np.bool_]:
    """Which vectors (F, 2) are finite and long enough to be seen (F,)."""
    length = np.hypot(vectors[:, 0], vectors[:, 1])
    return np.isfinite(length) & (length > SHORTEST * size * scale)


def inertia_line(centre: Real, force: Real, moment: Real) -> Real:
    """Points (F, 2) on the line of action of inertia forces (F, 2) whose moments about the centres of mass (F, 2) are (F,).

    The force moves sideways by M / F; where there is no force it stays at the centre of mass.
    """
    square = np.einsum("fi,fi->f", force, force)
    with np.errstate(divide="ignore", invalid="ignore"):
        lever = np.where(square > 0, moment / square, 0.0)
    return centre + lever[:, None] * np.column_stack([force[:, 1], -force[:, 0]])


def shapes(run: Run, size: float) -> tuple[list[Arrow], list[Arc], Scales]:
    """All arrows and arcs of a run with their scales; ``size`` [m] is the mechanism's."""
    arrows = [*_motion_arrows(run), *_force_arrows(run)]
    arcs = _arcs(run)
    forces = [a.vectors for a in arrows if a.family not in ("velocity", "acceleration")]
    scales = Scales(
        newtons_per_metre=_largest(forces) / (LARGEST * size),
        newton_metres_per_metre=_largest([a.moments[:, None] for a in arcs]) / (ARC_LARGEST * ARC_RADIUS * size),
        mps_per_metre=_largest(a.vectors for a in arrows if a.family == "velocity") / (LARGEST * size),
        mps2_per_metre=_largest(a.vectors for a in arrows if a.family == "acceleration") / (LARGEST * size),
    )
    return arrows, arcs + _inertia_moments(run, arrows, scales, size), scales


def _largest(values: Iterable[Real]) -> float:
    """The largest finite magnitude of some vectors (F, n); NaN if there is none above zero."""
    best = 0.0
    for v in values:
        length = np.sqrt(np.einsum("fi,fi->f", v, v))
        best = max(best, float(np.max(length, initial=0.0, where=np.isfinite(length))))
    return best if best > 0 else float("nan")


def _motion_arrows(run: Run) -> list[Arrow]:
    motion = run.motion
    found = [(point_name(*p), [motion.point(*p, k) for k in range(3)]) for p in motion.mechanism.traced]
    for link in links_with_mass(run):
        found.append((centre_name(motion.mechanism, link), [motion.centre_of_mass(link, k) for k in range(3)]))
    return [
        Arrow(("vectors", family, name), family, x, vector)
        for name, (x, v, a) in found
        for family, vector in (("velocity", v), ("acceleration", a))
    ]


def _force_arrows(run: Run) -> list[Arrow]:
    motion, forces = run.motion, run.forces
    if forces is None:
        return []
    mechanism = motion.mechanism
    found = [
        Arrow(("vectors", "reaction", p.name), "reaction", motion.pair_position(p.name), forces.reaction(p.name)[:, :2])
        for p in mechanism.pairs
    ]
    named_forces = {load.name for load in mechanism.loads if isinstance(load, Force)}
    for name, load in forces.loads.items():
        if load.kind == "gravity":
            found.append(Arrow(("vectors", "gravity", load.link), "gravity", load.values[:, 3:], load.values[:, :2]))
        elif name in named_forces:
            found.append(Arrow(("vectors", "applied", name), "applied", load.values[:, 3:], load.values[:, :2]))
    if "inertia" in mechanism.effects:
        for link in links_with_mass(run):
            wrench = forces.inertia(link)
            line = inertia_line(motion.centre_of_mass(link), wrench[:, :2], wrench[:, 2])
            found.append(Arrow(("vectors", "inertia", link), "inertia", line, wrench[:, :2]))
    for drive in mechanism.drives:
        wrench = forces.wrench(drive.pair)
        if np.any(wrench[:, :2]):
            found.append(Arrow(("vectors", "drive", drive.pair), "drive", motion.pair_position(drive.pair), wrench[:, :2]))
    return found


def _arcs(run: Run) -> list[Arc]:
    motion, forces = run.motion, run.forces
    if forces is None:
        return []
    always = np.ones(motion.frames, bool)
    found = []
    for drive in motion.mechanism.drives:
        wrench = forces.wrench(drive.pair)
        if not np.any(wrench[:, :2]):
            where = motion.pair_position(drive.pair)
            found.append(Arc(("vectors", "drive", drive.pair), "drive", where, wrench[:, 2], always))
    for name, load in forces.loads.items():
        if load.kind == "torque":
            centre = motion.centre_of_mass(load.link)
            found.append(Arc(("vectors", "applied", name), "applied", centre, load.values[:, 2], always))
    return found


def _inertia_moments(run: Run, arrows: list[Arrow], scales: Scales, size: float) -> list[Arc]:
    """Inertia moments of links where no inertia force is there to carry them: arcs about the centre of mass."""
    found = []
    for arrow in arrows:
        if arrow.family != "inertia" or run.forces is None:
            continue
        link = arrow.path[-1]
        moments = run.forces.inertia(link)[:, 2]
        alone = ~visible(arrow.vectors, scales.newtons_per_metre, size)
        if np.any(alone & (np.abs(moments) > 0)):
            centre = run.motion.centre_of_mass(link)
            found.append(Arc((*arrow.path, "moment"), "inertia", centre, moments, alone))
    return found


def extent(arrows: list[Arrow], scales: Scales, bounds: Real, size: float) -> Real:
    """The box (2, 3) [m] around the mechanism and its arrows; arrows that lie far outside do not count in full."""
    low, high = np.array(bounds[0]), np.array(bounds[1])
    room = LARGEST * size
    for arrow in arrows:
        seen = visible(arrow.vectors, scales.of(arrow.family), size)
        if seen.any():
            tips = arrow.origins[seen] + arrow.vectors[seen] / scales.of(arrow.family)
            low[:2] = np.minimum(low[:2], np.maximum(tips.min(axis=0), bounds[0][:2] - room))
            high[:2] = np.maximum(high[:2], np.minimum(tips.max(axis=0), bounds[1][:2] + room))
    return np.array([low, high])


def arc_sweep(moments: Real, scale: float, size: float) -> Real:
    """Signed angles (F,) [rad] that arcs span so that their length stands for moments (F,) [N m]; 0 where too short to see."""
    sweep = np.nan_to_num(moments / (scale * ARC_RADIUS * size))
    sweep = np.clip(sweep, -ARC_LARGEST, ARC_LARGEST)
    return np.where(np.abs(sweep) * ARC_RADIUS > SHORTEST, sweep, 0.0)


def arc_strips(centres: Real, sweep: Real, z: float, size: float) -> NDArray[np.float32]:
    """Arcs with arrow heads about centres (n, 2), spanning angles (n,), each drawn as one strip: (n, points, 3)."""
    radius = ARC_RADIUS * size
    # the arc opens evenly about the vertical
    angles = 0.5 * np.pi + sweep[:, None] * np.linspace(-0.5, 0.5, ARC_POINTS)
    arc = centres[:, None] + radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    end = angles[:, -1]
    along = np.sign(sweep)[:, None] * np.column_stack([-np.sin(end), np.cos(end)])
    across = np.column_stack([np.cos(end), np.sin(end)])
    head = 0.3 * radius
    tip = arc[:, -1] + 0.5 * head * along
    barbs = [tip - head * along + side * 0.6 * head * across for side in (1, -1)]
    strip = np.concatenate([arc, np.stack([tip, barbs[0], tip, barbs[1]], axis=1)], axis=1)
    return np.concatenate([strip, np.full((*strip.shape[:2], 1), z)], axis=-1).astype(np.float32)
