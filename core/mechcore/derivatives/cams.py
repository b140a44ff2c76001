"""Derivatives of a cam's contact by the argument of its law, for parameters that move the cam.

In the axes of the carrier the contact is a function of the law's argument alone, smooth within a piece of the law. Pieces are
continued beyond their ends, so that a place on a knot stays on its side of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from mechcore.arrays import Real, Values
from mechcore.cams.placement.inverse import PlacedInverse
from mechcore.cams.placement.plane import PlacedCam
from mechcore.cams.placement.spatial import FlankSliding, PlacedSpatial
from mechcore.derivatives.model_numbers import ModelNumbers, Parameter, slopes
from mechcore.joints.base import Relation
from mechcore.motion.motion import Motion
from mechcore.spec.mechanism import Mechanism

WIDTH = 1e-3  # half width of the interval in which a law's argument is varied, over the law's length
Placed = PlacedCam | PlacedInverse | PlacedSpatial


def moved_on(cam: Any, nominal: Motion, later: float = 0.0) -> Any:
    """The cam with the arguments of the ``nominal`` motion, in any motion, increased by ``later`` [rad or m]; each argument stays
    on its piece of the law."""
    place = cam.argument(nominal) + later
    if later:
        law, beyond = cam.cam.law, cam.law_scale * later
        pieces = tuple(piece.beginning(beyond, piece.length) for piece in law.pieces)
        other = replace(law, pieces=pieces, start=law.start + beyond, extended=True)
        moved = replace(cam, cam=replace(cam.cam, law=other))
        vars(moved)["zero"] = cam.zero
    else:
        moved = copy(cam)
    vars(moved)["argument"] = lambda _: place
    if cam.mate is not None:
        vars(moved)["mate"] = moved_on(cam.mate, nominal, later)
    return moved


def in_phase(shape: Any, nominal: Placed | None) -> Any:
    """A cam with the phase of the ``nominal`` one: its own changes the argument of the law. Other shapes are unchanged."""
    if nominal is None or shape.phase == nominal.phase:
        return shape
    mate = None if shape.mate is None else in_phase(shape.mate, nominal.mate)
    return replace(shape, phase=nominal.phase, mate=mate) if mate is not None else replace(shape, phase=nominal.phase)


def by_argument(values: Callable[[Any], Sequence[Any]], cam: Placed, nominal: Motion) -> list[Any]:
    """Derivatives of ``values`` of a cam by the argument of its law. Raises `MechanismError`."""

    def moved(later: float) -> ModelNumbers:
        return {(k,): np.asarray(x) for k, x in enumerate(values(moved_on(cam, nominal, later)))}

    def none(_: float) -> Mechanism:
        raise TypeError("no mechanism belongs to the place of a cam")

    there = moved(0.0)
    place = Parameter(f"the place of the cam {cam.name}", 0.0, WIDTH * cam.cam.law.length, none)
    found = slopes(moved, there, place)
    return [found.get(k, np.zeros_like(x)) for k, x in there.items()]


def third_derivative(cam: Placed, argument: Real) -> Real:
    """Third derivative (F,) of the follower's coordinate in metres by the argument of the law."""
    x, _ = cam.known_arguments(argument)
    return np.asarray(cam.scale * cam.law_scale * cam.cam.law(x, 3)[3])


PARTS = ("place", "along", "twist", "rate")


def sliding_parts(cam: PlacedSpatial, motion: Motion, flank: Values) -> list[Any]:
    """The numbers (F,) of `PlacedSpatial.sliding`, one after the other."""
    across, along, seen = cam.sliding(motion, flank)
    return [*(getattr(sliding, part) for sliding in (across, along) for part in PARTS), seen]


def sliding_of(parts: Sequence[Any]) -> tuple[FlankSliding, FlankSliding, Any]:
    """`PlacedSpatial.sliding` from its numbers."""
    across, along = (FlankSliding(**dict(zip(PARTS, parts[k : k + 4], strict=True))) for k in (0, 4))
    return across, along, parts[8]


def shape_of(relation: Relation) -> Any:
    """The object that computes the contact of a relation: the geometry of a cam, else the relation itself."""
    return relation if relation.geometry is None else relation.geometry


def key_of_signs(x: Real) -> bytes:
    """A key of the signs of numbers."""
    return np.packbits(np.atleast_1d(x) >= 0.0).tobytes()
