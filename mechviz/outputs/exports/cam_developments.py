"""Outlines of cams in millimetres; developments of barrel, rib and end cams: what is milled, unrolled from its cylinder."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import chebyshev

from mechcore.arrays import Complex, Real

if TYPE_CHECKING:
    from mechcore.cams.placed_spatial import PlacedSpatial
    from mechcore.cams.spatial import SpatialCam


STEP = 1.0  # degrees of the cam between points
DEPTHS = 14  # places along the roller through which a flank is interpolated
NODES = 48  # angles of each piece of the law through which a line is interpolated for its derivatives
STEPS = 8  # of Newton's method


@dataclass(frozen=True, eq=False)
class Outline:
    """A curve of a cam. ``runs``: smooth parts end to end, each with points (n) [mm], unit tangents (n), radius of curvature (n)
    [mm], positive where the cam is convex, and cam angle or length (n) [rad or m], NaN where the follower rests on a corner."""

    name: str
    closed: bool
    runs: tuple[tuple[Complex, Complex, Real, Real], ...]
    centre: complex  # the cam's axis [mm]
    outside: int  # 1: the material lies to the left of the way, -1: to its right (outer flank of a groove)
    cylinder: float | None = None  # radius [mm] of the cylinder that it is unrolled from: it has no centre
    centre_line: bool = False  # the roller's path, not an edge

    @property
    def points(self) -> Complex:
        """All points, joints once."""
        parts = [run[0][:-1] for run in self.runs]
        return np.concatenate(parts if self.closed else [*parts, self.runs[-1][0][-1:]])


def developed(cam: PlacedSpatial) -> Iterator[Outline]:
    """The lines of a cam, unrolled: x is the arc [mm] on the cylinder of the stated radius from the cam's zero azimuth, which
    counts counter-clockwise about the axis, y the height along the axis from the cam's pin; seen from outside. Material lies to the
    left. Nothing of a globoid, whose hollow has no development, nor of an indexing cam, whose ribs are shared by several rollers.
    """
    blank = cam.blank
    hollow = blank.radius - blank.depth
    wanted: list[tuple[str, SpatialCam, int, float]] = []
    if blank.rollers:
        return
    if blank.kind == "barrel":
        wanted = [("roller path", cam.cam, 0, blank.radius), ("lower flank", cam.cam, 1, blank.radius)]
        wanted.append(("upper flank", cam.cam, -1, blank.radius))
    elif blank.kind == "rib":
        for name, side in (("lower flank", -1), ("upper flank", 1)):
            reach = side * (0.5 * blank.thickness + cam.cam.radius)
            wanted.append((name, replace(cam.cam, law=cam.cam.law.raised(reach)), side, blank.radius))
    elif blank.kind == "end":
        wanted = [("outer edge", cam.cam, 1, blank.radius), ("inner edge", cam.cam, 1, hollow)]
    for name, own, side, radius in wanted:
        runs = _runs(own, side, radius)
        centre_line = side == 0
        yield Outline(f"{cam.name} {name}", False, runs, 0j, 1, 1e3 * radius, centre_line)


def _runs(cam: SpatialCam, side: int, radius: float) -> tuple[tuple[Complex, Complex, Real, Real], ...]:
    """Smooth parts of a line end to end: points [mm], unit tangents, radii of curvature [mm], angles of the cam [rad]."""
    law, runs, start = cam.law, [], None
    for piece, knot in zip(law.pieces, law.knots, strict=False):
        count = max(int(np.ceil(np.degrees(piece.length) / STEP)), 8)
        t = np.linspace(-1.0, 1.0, count + 1)
        nodes = chebyshev.chebpts1(NODES)
        theta = knot + 0.5 * piece.length * (1.0 + np.concatenate([t, nodes]))
        inside = np.clip(theta, knot + 1e-12, knot + piece.length - 1e-12)  # one-sided at the knots
        w = 1e3 * _line(cam, side, radius, inside, start)
        start = float(w[count].real) / 1e3 / radius  # the next part goes on at this azimuth
        points, fit = (
            w[: count + 1],
            chebyshev.chebfit(nodes, np.column_stack([w[count + 1 :].real, w[count + 1 :].imag]), NODES - 1),
        )
        d1, d2 = (chebyshev.chebval(t, chebyshev.chebder(fit, order)) for order in (1, 2))
        first, second = d1[0] + 1j * d1[1], d2[0] + 1j * d2[1]
        with np.errstate(divide="ignore", invalid="ignore"):
            bend = np.abs(first) ** 3 / np.imag(np.conj(first) * second)
        runs.append((points, first / np.abs(first), bend, theta[: count + 1]))
    leftwards = runs[-1][0][-1].real < runs[0][0][0].real
    if leftwards == (side >= 0):  # material below a line that goes to the left lies to its left
        return tuple(runs)
    return tuple((p[::-1], -t[::-1], -bend[::-1], a[::-1]) for p, t, bend, a in reversed(runs))


def _line(cam: SpatialCam, side: int, radius: float, theta: Real, start: float | None) -> Complex:
    """Arc on a cylinder and height (n) [m] of a flank, with ``side`` 0 of the roller's axis, at angles of the cam.

    The flank crosses the cylinder at one place along the roller for each angle: Newton's method on a polynomial through places.
    """
    wide = cam.radius + float(np.abs(_across(cam, theta)).max())
    low = np.sqrt(max(radius**2 - (1.05 * wide) ** 2, (0.2 * radius) ** 2))
    middle, half = 0.5 * (low + radius * 1.001), 0.5 * (radius * 1.001 - low)
    nodes = chebyshev.chebpts1(DEPTHS)
    flank = cam.flank(theta, middle + half * nodes, side or 1)
    p = flank.axis_point if side == 0 else flank.point
    fits = [chebyshev.chebfit(nodes, p[..., k].T, DEPTHS - 1) for k in range(3)]
    u = np.full(len(theta), 0.5)
    for _ in range(STEPS):
        x, y = (chebyshev.chebval(u, fits[k], tensor=False) for k in (0, 1))
        dx, dy = (chebyshev.chebval(u, chebyshev.chebder(fits[k]), tensor=False) for k in (0, 1))
        rho = np.hypot(x, y)
        u = np.clip(u - (rho - radius) * rho / (x * dx + y * dy), -1.5, 1.5)
    x, y, z = (chebyshev.chebval(u, fit, tensor=False) for fit in fits)
    azimuth = np.arctan2(y, x)
    order = np.argsort(theta, kind="stable")
    azimuth[order] = np.unwrap(azimuth[order])
    if start is not None:
        azimuth += 2.0 * np.pi * np.round((start - azimuth[order[0]]) / (2.0 * np.pi))
    return np.asarray(radius * azimuth + 1j * z)


def _across(cam: SpatialCam, theta: Real) -> Real:
    """How far the roller's axis lies beside the cam's [m]."""
    return cam.mount.axis(cam.law(theta, 2))[0][0][:, 1]
