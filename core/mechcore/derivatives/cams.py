"""Plane cams that turn on with a parameter: how what follows from their law changes with its argument.

In the axes of the carrier a cam's contact is a function of the law's argument alone. Along its law it changes smoothly within a
piece: each piece is taken beyond its ends, so that a place on a knot keeps to its side of it.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import fields, replace
from typing import Any

import numpy as np

from mechcore.arrays import Real, Values
from mechcore.cams.placement.plane import PlacedCam, on_knots
from mechcore.derivatives.model_numbers import ModelNumbers, Parameter, slopes
from mechcore.kinematics.model import Model
from mechcore.motion.motion import Motion
from mechcore.records import NumberPlace
from mechcore.spec.mechanism import Mechanism

WIDTH = 1e-3  # of the length of a law, by which a cam is turned on


def follows_argument(cam: object) -> bool:
    """Whether a cam's derivatives by the argument of its law are known: those of plane cams that are made for one."""
    return isinstance(cam, PlacedCam) and cam.given is None and cam.mate is None


def held_where_it_is(cam: PlacedCam, nominal: Motion) -> PlacedCam:
    """The cam at its places in the ``nominal`` motion, whatever motion it is asked about."""
    place, held = cam.argument(nominal), copy(cam)
    vars(held)["argument"] = lambda _: place
    return held


def by_argument(values: Callable[[PlacedCam], Any], cam: PlacedCam) -> Any:
    """Derivatives by the argument of a cam's law of values that follow from the cam. Raises `MechanismError`."""
    law = cam.cam.law

    def moved(later: float) -> ModelNumbers:
        pieces = tuple(piece.beginning(later, piece.length) for piece in law.pieces)
        other = replace(cam, cam=replace(cam.cam, law=replace(law, pieces=pieces, extended=True)))
        vars(other)["zero"] = cam.zero
        return {(): np.asarray(values(other))}

    def none(_: float) -> Mechanism:
        raise TypeError("no mechanism belongs to the place of a cam")

    nominal = np.asarray(values(cam))
    place = Parameter(f"the place of the cam {cam.name}", 0.0, WIDTH * law.length, none)
    found = slopes(moved, {(): nominal}, place).get(())
    return np.zeros_like(nominal) if found is None else cam.ahead * found


def third_derivative(cam: PlacedCam, argument: Real) -> Real:
    """Third derivative (F,) of the follower's coordinate in metres by the argument of the law."""
    x = on_knots(cam.cam.law, np.multiply(argument, cam.ahead))
    return np.asarray(cam.scale * cam.ahead * cam.cam.law(x, 3)[3])


Beside = Callable[[Callable[[Model], Any], object, NumberPlace], Any]  # `Derivatives.beside`


def rubbing(beside: Beside, at: Motion, r: int, motion: Motion, flank: Values) -> tuple[Any, ...]:
    """How the cam of relation ``r``, about an axis in the plane, rubs in a ``motion`` on a tape; ``at``: the nominal one."""
    key = np.packbits(np.atleast_1d(np.real(np.asarray(flank))) >= 0.0).tobytes()

    def nominal(model: Model) -> Any:
        geometry: Any = model.relations[r].geometry
        return geometry.rubbing(at, flank)

    def of(which: int, field: str) -> Callable[[Model], Any]:
        return lambda model: getattr(nominal(model)[which], field)

    geometry: Any = at.model.relations[r].geometry
    *slidings, seen = geometry.rubbing(motion, flank)
    for which, sliding in enumerate(slidings):
        names = [f.name for f in fields(sliding)]
        values = {x: beside(of(which, x), getattr(sliding, x), ("rubbing", r, key, which, x)) for x in names}
        slidings[which] = replace(sliding, **values)
    return *slidings, beside(lambda model: nominal(model)[2], seen, ("seen", r, key))
