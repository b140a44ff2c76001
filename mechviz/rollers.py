"""Marks on the rollers of cams that show how they roll: sectors on the face of each, stripes on the mantle where that is seen."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .riders import Rider

if TYPE_CHECKING:
    from mechcore.cams.placed_spatial import PlacedSpatial

    from .meshes import Solids
    from .run import Run

__all__ = ["find_rollers"]

Real = NDArray[np.float64]

INNER, OUTER = 0.55, 0.93  # of the marked ring, in radii of the roller
SECTORS, SIDES = 3, 16
THICK = 0.012  # of a mark, in radii


def find_rollers(run: Run, solids: Solids) -> list[Rider]:
    """The rollers of all cams of a run, both of conjugate ones and of ribs; none where forces decide the motion.

    Those of turrets have none: they take turns.
    """
    if run.simulation is not None or not any(r.geometry is not None for r in run.motion.model.relations):
        return []
    from mechcore.cams import Roller
    from mechcore.cams.happenings import contact_force, placed_cams
    from mechcore.cams.placed import PlacedCam
    from mechcore.cams.placed_inverse import PlacedInverse
    from mechcore.cams.placed_spatial import PlacedSpatial
    from mechcore.cams.rolling import roller_angle
    from mechcore.spec import CamPair

    pairs = {pair.name: pair for pair in run.motion.mechanism.pairs if isinstance(pair, CamPair)}
    links = {link.name: link for link in run.motion.mechanism.links}
    found: list[Rider] = []
    for cam in placed_cams(run.motion):
        if not isinstance(cam.face, Roller):
            continue
        force = 1.0 if run.forces is None else np.nan_to_num(contact_force(run.forces, cam), nan=1.0)
        pair = pairs[cam.name]
        link = cam.links[0] if isinstance(cam, PlacedInverse) else cam.links[1]
        at = links[link].points.get(pair.point, (0.0, 0.0))
        if isinstance(cam, PlacedSpatial):
            if not cam.blank.rollers:
                found += (_along if cam.blank.kind == "globoid" else _beside)(run, solids, cam, link, at, force)
            continue
        wanted = [(cam.name, cam, at, force)]
        if isinstance(cam, PlacedCam) and cam.mate is not None and pair.second is not None:
            wanted.append((f"{cam.name} second", cam.mate, links[link].points[pair.second[0]], 1.0))
        for name, rolling, (x, y), pressed in wanted:
            assert isinstance(rolling.face, Roller)
            radius = rolling.face.radius
            top = _face(solids, link, (x, y), radius)
            if top is not None:
                turned = roller_angle(run.motion, rolling, pressed)
                found.append(Rider("roller", name, link, (x, y, top), turned, *_sectors(radius)))
    return found


def _beside(run: Run, solids: Solids, cam: PlacedSpatial, link: str, at: tuple[float, float], force: Any) -> Iterator[Rider]:
    """Stripes on the mantles of rollers that stand before a cam whose axis lies in the plane."""
    from mechcore.cams.rolling import roller_angle

    solid, radius = solids.links[link], cam.face.radius
    for kind, part in zip(solid.kinds, solid.shells, strict=True):
        x, y = part.bounds[:, :2].mean(axis=0)
        if kind != "roller":
            continue
        above = 0
        if cam.blank.kind == "rib":
            along = run.motion.pose(link)[0, 2] - run.motion.pose(cam.carrier)[0, 2]
            above = 1 if ((x - at[0] + 1j * (y - at[1])) * np.exp(1j * along) * np.conj(1j * cam.axes)).real > 0.0 else -1
        wide = np.hypot(part.vertices[:, 0] - x, part.vertices[:, 1] - y) > 0.99 * radius
        low, high = (float(f(part.vertices[wide, 2])) for f in (np.min, np.max))
        name = {0: cam.name, 1: f"{cam.name} upper", -1: f"{cam.name} lower"}[above]
        turned = roller_angle(run.motion, cam, force, above)
        yield Rider("roller", name, link, (float(x), float(y), low), turned, *_stripes(radius, high - low))


def _along(run: Run, solids: Solids, cam: PlacedSpatial, link: str, at: tuple[float, float], force: Any) -> Iterator[Rider]:
    """Stripes on the mantle of a roller whose axis lies in the plane, along its arm."""
    from mechcore.cams.rolling import roller_angle

    assert cam.pivot is not None
    solid, radius = solids.links[link], cam.face.radius
    part = next(p for k, p in zip(solid.kinds, solid.shells, strict=True) if k == "roller")
    base, arm = run.motion.pose(cam.carrier)[0], run.motion.pose(link)[0]
    place = complex(base[0], base[1]) + cam.pivot * np.exp(1j * base[2]) - complex(arm[0], arm[1])
    hinge = place * np.exp(-1j * arm[2])
    way = (complex(*at) - hinge) / abs(complex(*at) - hinge)
    axis = np.array([way.real, way.imag, 0.0])
    start = np.array([hinge.real, hinge.imag, 0.5 * (part.vertices[:, 2].min() + part.vertices[:, 2].max())])
    own = (part.vertices - start) @ axis
    wide = np.linalg.norm(part.vertices - start - own[:, None] * axis, axis=1) > 0.99 * radius
    low, high = float(own[wide].min()), float(own[wide].max())
    vertices, faces, normals = _stripes(radius, high - low)
    frame = np.array([[-way.imag, way.real, 0.0], [0.0, 0.0, 1.0], axis])  # across, towards the viewer, along: a rotation
    x, y, z = (start + low * axis).tolist()
    shape = (vertices @ frame).astype(np.float32), faces, (normals @ frame).astype(np.float32)
    yield Rider("roller", cam.name, link, (x, y, z), roller_angle(run.motion, cam, force), *shape, axis=(way.real, way.imag))


def _face(solids: Solids, link: str, at: tuple[float, float], radius: float) -> float | None:
    """Height of the front of the part of a link that is a roller about a point [m]."""
    for part in solids.links[link].shells:
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


def _stripes(radius: float, height: float) -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.float32]]:
    """Stripes on a mantle that stands on the plane, from end to end, and sectors on the face at its upper end."""
    vertices: list[Real] = []
    normals: list[Real] = []
    faces: list[NDArray[np.int64]] = []
    for k in range(SECTORS):
        turn = 2.0 * np.pi * (k + np.linspace(0.0, 0.5, SIDES + 1)) / SECTORS
        ring = np.column_stack([np.cos(turn), np.sin(turn)])
        start = len(vertices) * 2 * (SIDES + 1)
        rows = [np.column_stack([(1.0 + THICK) * radius * ring, np.full(len(ring), z)]) for z in (0.04 * height, 0.96 * height)]
        vertices.append(np.concatenate(rows))
        normals.append(np.tile(np.column_stack([ring, np.zeros(len(ring))]), (2, 1)))
        a = start + np.arange(SIDES)
        b = a + SIDES + 1
        faces += [np.column_stack([a, a + 1, b + 1]), np.column_stack([a, b + 1, b])]
    flat, own, up = _sectors(radius)
    count = sum(map(len, vertices))
    return (
        np.vstack([*vertices, flat + np.array([0.0, 0.0, height])]).astype(np.float32),
        np.vstack([*faces, own + count]).astype(np.uint32),
        np.vstack([*normals, up]).astype(np.float32),
    )
