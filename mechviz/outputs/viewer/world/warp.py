"""Solids that follow a length while it is dragged: every vertex moves with the nearby points of its link."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.cams.placement.plane import PlacedCam
from mechcore.forces.cam_rating import placed_cams
from mechviz.meshes.kinds.cam_profiles import profile_points
from mechviz.outputs.viewer.view_model import ColoredPart, LinkSolid

if TYPE_CHECKING:
    from mechcore.motion.motion import Motion


PointPlaces = Mapping[str, tuple[float, float]]
WEIGHT_POWER = 2  # weights fall with this power of the squared distance: around a point the solid moves as a whole


def warped(xy: Real, before: Real, after: Real) -> Real:
    """Points (V, 2) of a plane that deforms as its points ``before`` (P, 2) move to ``after`` (P, 2).

    One point translates the plane. Two points move it as a bar: the segment between them is stretched along its line, lengths
    across it stay. With more points, each ``xy`` moves by the mean of the displacements of the points, weighted by inverse distance
    (Shepard's interpolation, 1968).
    """
    moves = after - before
    if not len(before) or not np.any(moves):
        return xy
    if len(before) == 1:
        return np.asarray(xy + moves[0])
    turn = np.ones(1, complex)
    if len(before) == 2:  # a bar: rotated as a whole, and stretched between its ends
        a, b = (complex(*(p[1] - p[0])) for p in (before, after))
        if abs(a) > 0.0 and abs(b) > 0.0:
            turn = np.array([b / a / abs(b / a)])
            z = (xy[:, 0] - before[0, 0] + 1j * (xy[:, 1] - before[0, 1])) * np.conj(a) / abs(a)
            part = np.clip(z.real / abs(a), 0.0, 1.0)
            z = (z + part * (abs(b) - abs(a))) * a / abs(a) * turn + complex(*after[0])
            return np.column_stack([z.real, z.imag])
    square = ((xy[:, None] - before[None]) ** 2).sum(axis=-1)
    spread = float(np.ptp(before, axis=0).max()) or 1.0
    weights = 1.0 / (square / spread**2 + 1e-12) ** WEIGHT_POWER
    weights /= weights.sum(axis=1, keepdims=True)
    return np.asarray(xy + weights @ moves)


def warped_body(body: LinkSolid, before: PointPlaces, after: PointPlaces) -> LinkSolid:
    """A body deformed as the points of its link move; the body itself if they do not move."""
    names = [name for name in before if name in after]
    old, new = (np.array([p[n] for n in names], float).reshape(-1, 2) for p in (before, after))
    if np.array_equal(old, new):
        return body
    pieces = []
    for piece in body.pieces:
        vertices = piece.vertices.copy()
        vertices[:, :2] = warped(piece.vertices[:, :2].astype(float), old, new)
        pieces.append(ColoredPart(vertices, piece.faces, piece.color))
    return replace(body, pieces=tuple(pieces))


PROFILE_POINTS = 720  # points of a profile
HUB_RADIUS = 0.4  # of the least radius: points nearer to the shaft stay
DISC_EDGE = 1.01  # of the radius of the profile: points within this belong to the disc


def cam_profiles(motion: Motion) -> dict[str, tuple[str, Any]]:
    """By cam joint: the cam's link, and the placed cam, for plate cams without a mate."""
    if not any(r.geometry is not None for r in motion.model.relations):
        return {}
    links = {joint.name: joint.links[0] for joint in motion.mechanism.joints}
    return {cam.name: (links[cam.name], cam) for cam in placed_cams(motion) if isinstance(cam, PlacedCam) and cam.mate is None}


def stretched_cams(
    bodies: Mapping[str, LinkSolid], before: Mapping[str, tuple[str, Any]], after: Mapping[str, tuple[str, Any]]
) -> dict[str, LinkSolid]:
    """The deformed bodies, by link, of the cams whose profiles have changed; other bodies are not contained."""
    new_bodies: dict[str, LinkSolid] = {}
    for name, (link, old) in before.items():
        if name not in after or link not in bodies:
            continue
        new = after[name][1]
        profile_old, profile_new = (profile_points(placed, PROFILE_POINTS) for placed in (old, new))
        if old.mount_origin == new.mount_origin and old.mount == new.mount and np.array_equal(profile_old, profile_new):
            continue
        pieces = []
        for piece in bodies[link].pieces:
            z = (piece.vertices[:, 0].astype(float) + 1j * piece.vertices[:, 1] - old.mount_origin) / old.mount
            moved = stretched(z, profile_old, profile_new, wedge=old.bed is not None, groove=bool(old.groove))
            if moved is None:
                break
            w = new.mount_origin + new.mount * moved
            pieces.append(
                ColoredPart(np.column_stack([w.real, w.imag, piece.vertices[:, 2]]).astype(np.float32), piece.faces, piece.color)
            )
        else:
            new_bodies[link] = replace(bodies[link], pieces=tuple(pieces))
    return new_bodies


def stretched(z: Complex, before: Complex, after: Complex, *, wedge: bool = False, groove: bool = False) -> Complex | None:
    """Points ``z`` (V,) [m] of a cam, moved as its profile changes from ``before`` (n,) to ``after`` (m,): points on the old
    profile move onto the new one, those of the hub (of a wedge: its base) stay, those between are interpolated linearly.

    Profiles run counter-clockwise about the shaft at the origin, those of a wedge from left to right; None for profiles whose polar
    angle (of a wedge: x) is not increasing. ``groove``: points outside the profile move with it.
    """
    if wedge:
        if np.any(np.diff(before.real) <= 0.0) or np.any(np.diff(after.real) <= 0.0):
            return None
        base = float(z.imag.min(initial=float(before.imag.min())))
        old, new = (np.interp(z.real, profile.real, profile.imag) for profile in (before, after))
        part = np.clip((z.imag - base) / np.fmax(old - base, 1e-12), 0.0, 1.0)
        return np.asarray(z + 1j * part * (new - old))
    angle = np.angle(z)
    radii = []
    for profile in (before, after):
        phi = np.unwrap(np.angle(profile))
        if np.any(np.diff(phi) <= 0.0) or not 0.99 < (phi[-1] - phi[0]) / (2.0 * np.pi) < 1.0:
            return None
        radii.append(np.interp(phi[0] + np.mod(angle - phi[0], 2.0 * np.pi), phi, np.abs(profile), right=abs(profile[0])))
    old, new = radii
    hub = HUB_RADIUS * float(min(np.abs(before).min(), np.abs(after).min()))
    r = np.abs(z)
    inside = np.clip((r - hub) / np.fmax(old - hub, 1e-12), 0.0, 1.0)
    far = r > DISC_EDGE * old
    shift = np.where(far & (not groove), 0.0, inside * (new - old))
    return np.asarray(z + shift * np.exp(1j * angle))
