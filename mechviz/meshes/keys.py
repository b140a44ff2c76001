"""Feather keys: the bore with its keyway that a cam has, and the key between it and its shaft."""

from __future__ import annotations

import numpy as np
from shapely import affinity
from shapely.geometry import Polygon, box

from mechcore.spec import Vec2

from .outline import disc, polygons

__all__ = ["key_outline", "keyed_bore", "keyway_corner", "keyway_reach"]

# A key by DIN 6885 (d = 22 to 30 mm: 8 x 7 mm, 3.3 mm of it in the hub), a little higher so that it is seen, in radii of its shaft.
_HALF = 0.27  # half its width
_HIGH = 0.34  # how far its keyway in the hub reaches beyond the shaft
_FIT = 0.97  # the key is so much narrower than its keyway
_RIM = 1.12  # of the keyway's reach: the least radius of a hub around it


def keyway_reach(shaft: float) -> float:
    """The least radius of a hub around the keyway on a shaft of this radius."""
    return _RIM * (1.0 + _HIGH) * shaft


def keyway_corner(shaft: float) -> float:
    """The radius on which the outer corners of the keyway on a shaft of this radius lie."""
    return float(np.hypot(1.0 + _HIGH, _HALF)) * shaft


def keyed_bore(centre: Vec2, shaft: float, hole: float, towards: Vec2, segments: int) -> Polygon:
    """A round hole with a keyway in the unit direction ``towards``, for a shaft of the radius ``shaft``."""
    slot = box(0.0, -_HALF * shaft, (1.0 + _HIGH) * shaft, _HALF * shaft)
    return polygons(disc(centre, hole, segments).union(_turned(slot, centre, towards)))[0]


def key_outline(centre: Vec2, shaft: float, towards: Vec2, segments: int) -> Polygon:
    """What of the key stands out of its shaft, a hair apart from it: no two parts share a corner."""
    half = _FIT * _HALF * shaft
    whole = _turned(box(0.0, -half, (1.0 + _FIT * _HIGH) * shaft, half), centre, towards)
    return polygons(whole.difference(disc(centre, 1.004 * shaft, segments)))[0]


def _turned(shape: Polygon, centre: Vec2, towards: Vec2) -> Polygon:
    c, s = np.asarray(towards) / np.hypot(*towards)
    return affinity.affine_transform(shape, [c, -s, s, c, *centre])
