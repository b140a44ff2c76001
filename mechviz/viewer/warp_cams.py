"""Cams that follow their values while those are dragged: the solid is stretched onto the new profile, at rest it is built anew.

Discs, grooves and wedges only; of the others, and of profiles that run back on themselves, the solid stays until the rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .show import Body, Piece

if TYPE_CHECKING:
    from mechcore import Motion

__all__ = ["cam_profiles", "stretched", "stretched_cams"]

Array = NDArray[np.complex128]
Real = NDArray[np.float64]

SAMPLES = 720  # points of a profile
HUB = 0.4  # of the least radius: what is nearer to the shaft stays as it is
ONTO = 1.01  # of a radius: up to here a place belongs to the disc


def cam_profiles(motion: Motion) -> dict[str, tuple[str, Any]]:
    """By cam pair: its link, and the placed cam whose profile can be followed."""
    if not any(r.geometry is not None for r in motion.model.relations):
        return {}
    from mechcore.cams.happenings import placed_cams
    from mechcore.cams.placed import PlacedCam

    links = {pair.name: pair.links[0] for pair in motion.mechanism.pairs}
    return {cam.name: (links[cam.name], cam) for cam in placed_cams(motion) if isinstance(cam, PlacedCam) and cam.mate is None}


def stretched_cams(
    bodies: Mapping[str, Body], before: Mapping[str, tuple[str, Any]], after: Mapping[str, tuple[str, Any]]
) -> dict[str, Body]:
    """The bodies of cams whose profiles are others now, by link; the rest is not among them."""
    from ..meshes.profiles import profile_points

    found: dict[str, Body] = {}
    for name, (link, old) in before.items():
        if name not in after or link not in bodies:
            continue
        new = after[name][1]
        way_old, way_new = (profile_points(placed, SAMPLES) for placed in (old, new))
        if old.own == new.own and old.mount == new.mount and np.array_equal(way_old, way_new):
            continue
        pieces = []
        for piece in bodies[link].pieces:
            z = (piece.vertices[:, 0].astype(float) + 1j * piece.vertices[:, 1] - old.own) / old.mount
            moved = stretched(z, way_old, way_new, wedge=old.bed is not None, groove=bool(old.groove))
            if moved is None:
                break
            w = new.own + new.mount * moved
            pieces.append(
                Piece(np.column_stack([w.real, w.imag, piece.vertices[:, 2]]).astype(np.float32), piece.faces, piece.color)
            )
        else:
            found[link] = replace(bodies[link], pieces=tuple(pieces))
    return found


def stretched(z: Array, before: Array, after: Array, *, wedge: bool = False, groove: bool = False) -> Array | None:
    """Places ``z`` (V) [m] of a cam whose profile was ``before`` (n) and is ``after`` (m), counter-clockwise about the shaft at
    the origin, or of a wedge from left to right: they go onto the new profile from the old one, the hub (of a wedge its base)
    stays, and in between they are stretched. None for profiles that run back on themselves.

    ``groove``: what lies outside goes along with the profile.
    """
    if wedge:
        if np.any(np.diff(before.real) <= 0.0) or np.any(np.diff(after.real) <= 0.0):
            return None
        base = float(z.imag.min(initial=float(before.imag.min())))
        old, new = (np.interp(z.real, way.real, way.imag) for way in (before, after))
        part = np.clip((z.imag - base) / np.fmax(old - base, 1e-12), 0.0, 1.0)
        return np.asarray(z + 1j * part * (new - old))
    angle = np.angle(z)
    radii = []
    for way in (before, after):
        phi = np.unwrap(np.angle(way))
        if np.any(np.diff(phi) <= 0.0) or not 0.99 < (phi[-1] - phi[0]) / (2.0 * np.pi) < 1.0:
            return None
        radii.append(np.interp(phi[0] + np.mod(angle - phi[0], 2.0 * np.pi), phi, np.abs(way), right=abs(way[0])))
    old, new = radii
    hub = HUB * float(min(np.abs(before).min(), np.abs(after).min()))
    r = np.abs(z)
    inside = np.clip((r - hub) / np.fmax(old - hub, 1e-12), 0.0, 1.0)
    far = r > ONTO * old
    shift = np.where(far & (not groove), 0.0, inside * (new - old))
    return np.asarray(z + shift * np.exp(1j * angle))
