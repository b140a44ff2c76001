"""Springs between two points as solids: one mesh each, stretched along its axis with the spring's length. For all pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Real, Single
from mechcore.spec.loads import Spring
from mechviz.meshes.kinds.coils import coil_shell
from mechviz.picture.proportions import looks

if TYPE_CHECKING:
    from mechviz.meshes.solids import Solids
    from mechviz.runs import Run


COLOR = (172, 188, 206)
RADIUS = 0.034  # of the wire's middle line around the axis, in sizes of the mechanism: a stem goes through it
STOUT = 0.4  # that radius at most, in mean lengths of the spring
WIRE = 0.3  # diameter of the wire in radii of the coil
PITCH = 1.9  # of the turns that give way, in diameters of the wire, where their number allows it
WIDEST = 0.55  # radius of such a coil at most, in mean lengths of the spring
WIDTHS = (1.5, 2.0, 2.4)  # of coils that have to go around a guide, too
FEWEST, MOST = 4, 12  # turns that give way
LEAST = 1e-4  # of its mean length: how short a spring is drawn at least


@dataclass(frozen=True, eq=False)
class Coil:
    """A spring: its mesh about the x axis from 0 to the mean length, and how it lies and is stretched at every frame."""

    name: str
    pose: Real  # (F, 3): its start [m] and direction [rad] in the plane, continuous
    stretch: Real  # (F,): length over the mean length
    height: float  # of its axis [m]
    width: float  # of the coil, over that of a spring that goes around a stem only
    vertices: Single  # (V, 3) [m]
    faces: NDArray[np.uint32]  # (N, 3)
    normals: Single  # (V, 3), unit

    def scales(self) -> Real:
        """Factors along x, y and z (F, 3)."""
        return np.column_stack([self.stretch, np.ones((len(self.stretch), 2))])

    def reach(self) -> Real:
        """The box (2, 2) [m] around the spring in the plane, over the run."""
        long, wide = self.stretch * float(self.vertices[:, 0].max()), float(self.vertices[:, 1].max())
        end = self.pose[:, :2] + long[:, None] * np.column_stack([np.cos(self.pose[:, 2]), np.sin(self.pose[:, 2])])
        spots = np.concatenate([self.pose[:, :2], end])
        return np.array([np.nanmin(spots, axis=0) - wide, np.nanmax(spots, axis=0) + wide])

    def places(self) -> Real:
        """Where the spring starts (F, 3) [m]."""
        return np.column_stack([self.pose[:, :2], np.full(len(self.pose), self.height)])


def find_coils(run: Run, solids: Solids, known: Mapping[str, tuple[float, float]] | None = None) -> list[Coil]:
    """The springs of a run in which forces are computed. ``known``: height [m] and width of those found before, by name."""
    if run.forces is None:
        return []
    found = []
    for load in run.motion.mechanism.loads:
        if isinstance(load, Spring):
            coil = _coil(run, solids, load, (known or {}).get(load.name))
            found += [] if coil is None else [coil]
    return found


def _coil(run: Run, solids: Solids, load: Spring, known: tuple[float, float] | None) -> Coil | None:
    a, b = (run.motion.point(*end) for end in zip(load.links, load.points, strict=True))
    d = b - a
    length = np.hypot(d[:, 0], d[:, 1])
    seen = length[np.isfinite(length)]
    mean = 0.5 * float(seen.min() + seen.max()) if len(seen) else 0.0
    if mean <= LEAST * solids.size:  # its ends stay together: nothing to be seen
        return None
    radius = min(RADIUS * solids.size, STOUT * mean)
    wire = WIRE * radius
    straight = mean > load.free_length
    turns = float(np.clip(np.floor(0.5 + (mean - 2.0 * wire) / (PITCH * wire)), FEWEST, MOST))
    most = max(1.0, WIDEST * mean / radius)
    height, width = known or _place(run, solids, load, (a, b), (radius, wire), [w for w in WIDTHS if w <= most and not straight])
    shell, normals = coil_shell(mean, min(width, most) * radius, wire, turns, straight=straight)
    angle = np.unwrap(np.arctan2(d[:, 1], d[:, 0])) if len(seen) == len(length) else np.arctan2(d[:, 1], d[:, 0])
    return Coil(
        load.name,
        np.column_stack([a, angle]),
        np.maximum(length / mean, LEAST),
        height,
        width,
        shell.vertices.astype(np.float32),
        shell.faces.astype(np.uint32),
        normals.astype(np.float32),
    )


def _place(
    run: Run, solids: Solids, load: Spring, ends: tuple[Real, Real], coil: tuple[float, float], widths: list[float]
) -> tuple[float, float]:
    """Height [m] of a spring's axis and its width: in the middle of what it acts on where its coil, or a wider one around a guide,
    meets nothing there; else before all that it would hit."""
    heights, (radius, wire) = solids.heights, coil
    frames, known = looks(run, heights)
    a, b = (end[frames] for end in ends)
    d = b - a
    across = np.column_stack([-d[:, 1], d[:, 0]]) / np.maximum(np.hypot(d[:, 0], d[:, 1]), 1e-300)[:, None]

    def sides(r: float) -> list[Real]:
        return [np.stack([a + x * across, b + x * across], axis=1) for x in (r, -r)]

    points = {link.name: link.points for link in run.motion.mechanism.links}
    for link, point in zip(load.links, load.points, strict=True):
        middle = heights.middle(link, points[link][point])
        for width in (1.0, *widths) if middle is not None else ():
            r = width * radius + 0.5 * wire
            both = [*sides(r), *sides(r - wire)]
            if middle is not None and not any(heights.crossed((middle - r, middle + r), side, known) for side in both):
                return middle, width
    start = 0.0
    for line in (np.stack([a, b], axis=1), *sides(radius + 0.5 * wire)):
        start = heights.cleared(start, line, known)
    return start + radius + 0.5 * wire, 1.0
