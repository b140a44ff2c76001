"""Marks on the rollers of cams that show how they roll: three sectors on the face of each, turning without slip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .meshes import Solids
    from .run import Run

__all__ = ["RollerMark", "find_rollers"]

Real = NDArray[np.float64]

COLOR = (60, 66, 74)
INNER, OUTER = 0.55, 0.93  # of the marked ring, in radii of the roller
SECTORS, SIDES = 3, 16
THICK = 0.012  # of a mark, in radii


@dataclass(frozen=True, eq=False)
class RollerMark:
    """``centre`` (x, y, z) [m] in the follower's axes, on the roller's face; ``angle`` (F) [rad] against it; the mesh about it."""

    name: str
    link: str
    centre: tuple[float, float, float]
    angle: Real
    vertices: NDArray[np.float32]  # (V, 3) [m]
    faces: NDArray[np.uint32]  # (N, 3)
    normals: NDArray[np.float32]  # (V, 3)


def find_rollers(run: Run, solids: Solids) -> list[RollerMark]:
    """The rollers of all plane cams of a run; none where forces decide the motion."""
    if run.simulation is not None or not any(r.geometry is not None for r in run.motion.model.relations):
        return []
    from mechcore.cams import Roller
    from mechcore.cams.happenings import contact_force, placed_cams
    from mechcore.cams.placed import PlacedCam
    from mechcore.cams.rolling import roller_angle

    pairs = {pair.name: pair for pair in run.motion.mechanism.pairs}
    links = {link.name: link for link in run.motion.mechanism.links}
    found = []
    for cam in placed_cams(run.motion):
        if not isinstance(cam, PlacedCam) or not isinstance(cam.face, Roller):
            continue
        force = 1.0 if run.forces is None else np.nan_to_num(contact_force(run.forces, cam), nan=1.0)
        point = getattr(pairs[cam.name], "point", "")
        x, y = links[cam.links[1]].points[point]
        top = _face(solids, cam.links[1], (x, y), cam.face.radius)
        if top is not None:
            shape = _sectors(cam.face.radius)
            found.append(RollerMark(cam.name, cam.links[1], (x, y, top), roller_angle(run.motion, cam, force), *shape))
    return found


def _face(solids: Solids, link: str, at: tuple[float, float], radius: float) -> float | None:
    """Height of the front of the part of a link that is a roller about a point [m]."""
    for part in solids.links[link].parts:
        low, high = part.bounds
        round_it = np.allclose(0.5 * (low + high)[:2], at, atol=0.02 * radius)
        if round_it and np.allclose((high - low)[:2], 2.0 * radius, rtol=0.02):
            return float(high[2])
    return None


def _sectors(radius: float) -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.float32]]:
    """Flat ring sectors just before the roller's face, seen from the front."""
    vertices: list[Real] = []
    faces: list[NDArray[np.int64]] = []
    for k in range(SECTORS):
        turn = 2.0 * np.pi * (k + np.linspace(0.0, 0.5, SIDES + 1)) / SECTORS
        start = len(vertices) * 2 * (SIDES + 1)
        ring = np.exp(1j * turn)
        points = radius * np.concatenate([INNER * ring, OUTER * ring])
        vertices.append(np.column_stack([points.real, points.imag, np.full(len(points), THICK * radius)]))
        a = start + np.arange(SIDES)
        b = a + SIDES + 1
        faces += [np.column_stack([a, b, b + 1]), np.column_stack([a, b + 1, a + 1])]
    flat = np.vstack(vertices).astype(np.float32)
    return flat, np.vstack(faces).astype(np.uint32), np.tile(np.array([0.0, 0.0, 1.0], np.float32), (len(flat), 1))
