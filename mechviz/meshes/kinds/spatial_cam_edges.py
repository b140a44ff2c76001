"""Where the flanks of a barrel, end or globoidal cam meet its outer surface and the floor of its groove, in the cam's own axes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Real
from mechviz.meshes.extrude import Shell

if TYPE_CHECKING:
    from mechcore.cams.placed_spatial import PlacedSpatial


_ROUND = 360  # points of a ring
_ACROSS = 9  # places along the roller between which the flank is interpolated


def _depth(placed: PlacedSpatial, p: Real) -> Real:
    """How deep points (..., 3) of the cam lie, as the roller's axis counts: from the axis, of a globoid from the pivot's circle."""
    rho = np.hypot(p[..., 0], p[..., 1])
    if placed.blank.kind != "globoid":
        return rho
    distance = abs(placed.pivot - placed.centre) if placed.pivot is not None else 0.0
    return np.hypot(distance - rho, p[..., 2])


def edge(placed: PlacedSpatial, side: int, at: float, shift: float = 0.0, theta: Real | None = None) -> Real:
    """The line of a flank (n, 3) at a depth, over angles ``theta`` (n) or all around; ``shift``: of the follower's coordinate."""
    cam = placed.cam if shift == 0.0 else replace(placed.cam, law=placed.cam.law.raised(shift))
    law = cam.law
    theta = law.start + law.length * np.arange(_ROUND) / _ROUND if theta is None else theta
    low, high = cam.inner, cam.outer
    along = np.linspace(low - 0.3 * (high - low), high + 0.3 * (high - low), _ACROSS)
    p = cam.flank(theta, along, side).point
    depth = _depth(placed, p)
    k = np.clip((depth < at).sum(axis=1), 1, _ACROSS - 1)
    rows = np.arange(len(theta))
    a, b = p[rows, k - 1], p[rows, k]
    da, db = depth[rows, k - 1], depth[rows, k]
    return a + ((at - da) / (db - da))[:, None] * (b - a)


def circle(azimuth: Real, radius: float | Real, z: float | Real) -> Real:
    return np.stack(np.broadcast_arrays(radius * np.cos(azimuth), radius * np.sin(azimuth), np.asarray(z, float)), axis=-1)


_STEPS = 360  # sections of the rib in a turn of the cam
_SUNK = 0.03  # of the groove's depth: the rib's foot below the floor
_RINGS = 33  # of a hollow core
_TURRET_ACROSS = 7  # lines on the top of a rib between its edges


def _floor_and_top(placed: PlacedSpatial, sunk: float = 0.0) -> tuple[float, float]:
    """Depths, as `edge` counts them, of the floor between the ribs and of the ribs' tops."""
    if placed.blank.kind == "globoid":
        return placed.cam.outer + sunk * placed.blank.depth, placed.cam.inner
    return placed.cam.inner - sunk * placed.blank.depth, placed.blank.radius


def _span(placed: PlacedSpatial) -> Real:
    """Angles of the cam at which a rib stands between the ends of the cam: as far as a roller next to the middle needs it."""
    law, step = placed.cam.law, 2.0 * np.pi / placed.blank.rollers
    theta = law.start + law.length * np.arange(-2 * _STEPS, 2 * _STEPS + 1) / _STEPS
    inside = np.flatnonzero(np.abs(law(theta, 0)[0] + 0.5 * step) < step * (1.0 - 1e-6))
    return np.asarray(theta[max(inside[0] - 1, 0) : inside[-1] + 2])


def rib(placed: PlacedSpatial) -> Shell:
    """The rib in the cam's own axes [m]: a tube with flat ends, its top part of the surface that the cam is turned to."""
    step, theta = 2.0 * np.pi / placed.blank.rollers, _span(placed)
    floor, top = _floor_and_top(placed, _SUNK)
    low = [edge(placed, -1, at, 0.0, theta) for at in (floor, top)]
    high = [edge(placed, 1, at, step, theta) for at in (top, floor)]
    points = np.stack([*low, *_between(placed, low[1], high[0], top), *high], axis=1)  # (n, m, 3)
    n, m = points.shape[:2]
    k = m * np.arange(n - 1)[:, None] + np.arange(m)
    ahead = m * np.arange(n - 1)[:, None] + (np.arange(m) + 1) % m
    a, b, c, d = (v.reshape(-1) for v in (k, ahead, ahead + m, k + m))
    fan = np.arange(1, m - 1)
    first = np.stack([0 * fan, fan + 1, fan], axis=1)
    last = m * (n - 1) + np.stack([0 * fan, fan, fan + 1], axis=1)
    return Shell(points.reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1), first, last]))


def _between(placed: PlacedSpatial, low: Real, high: Real, top: float) -> list[Real]:
    """Lines (n, 3) on the rib's top between its two edges."""
    (a, b), (z, y) = (np.arctan2(p[:, 1], p[:, 0]) for p in (low, high)), (low[:, 2], high[:, 2])
    turn = np.mod(b - a + np.pi, 2.0 * np.pi) - np.pi
    shares = np.linspace(0.0, 1.0, _TURRET_ACROSS + 2)[1:-1]
    if placed.blank.kind != "globoid":
        return [circle(a + s * turn, top, z + s * (y - z)) for s in shares]
    assert placed.pivot is not None
    distance, psi = abs(placed.pivot - placed.centre), [np.arcsin(np.clip(v / top, -1.0, 1.0)) for v in (z, y)]
    angles = [psi[0] + s * (psi[1] - psi[0]) for s in shares]
    return [circle(a + s * turn, distance - top * np.cos(x), top * np.sin(x)) for s, x in zip(shares, angles, strict=True)]


def core_rings(placed: PlacedSpatial) -> list[Real]:
    """Rings (n, 3) [m] of the core that the ribs stand on: a cylinder, or the hollow that the rollers' ends sweep."""
    points = rib(placed).vertices
    azimuth = 2.0 * np.pi * np.arange(_STEPS) / _STEPS
    wall = 0.5 * placed.cam.radius
    if placed.blank.kind != "globoid":
        floor = _floor_and_top(placed)[0]
        return [circle(azimuth, floor, z) for z in (points[:, 2].min() - wall, points[:, 2].max() + wall)]
    assert placed.pivot is not None
    distance, outer = abs(placed.pivot - placed.centre), placed.cam.outer
    psi = np.arctan2(points[:, 2], distance - np.hypot(points[:, 0], points[:, 1]))
    ends = float(psi.min()) - wall / outer, float(psi.max()) + wall / outer
    return [circle(azimuth, distance - outer * np.cos(x), outer * np.sin(x)) for x in np.linspace(*ends, _RINGS)]


def around(placed: PlacedSpatial, tip: complex, hinge: complex) -> list[complex]:
    """Places of all rollers of a turret, the named one first; of an arm its own."""
    count = placed.blank.rollers or 1
    return [hinge + (tip - hinge) * complex(np.exp(2j * np.pi * k / count)) for k in range(count)]
