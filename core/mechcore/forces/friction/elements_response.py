"""Joint forces under the loads and under a unit of friction at every element: the linear part of the problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.forces.equilibrium import transmit
from mechcore.forces.friction.elements import Element
from mechcore.motion.motion import Motion

Array = Any
Transmitted = tuple[list[tuple[Array, Array]], dict[str, tuple[Array, Array]], dict[int, Array]]

AT_ONCE = 400_000  # elements times frames that are solved in one call


@dataclass(frozen=True, eq=False)
class Response:
    """``base``: transmitted without friction. ``units``: of each element, the same under its unit wrench alone."""

    base: Transmitted
    units: list[Transmitted]


def respond(
    motion: Motion,
    elements: Sequence[Element],
    force: Sequence[Array],
    moment: Sequence[Array],
    flanks: Mapping[int, Array] | None = None,
) -> Response:
    """Solve the loads and a unit wrench at every element, with the same flanks in contact. ``force``, ``moment``: of each link."""
    base = transmit(motion, force, moment, flanks)
    flanks = base[2] if flanks is None else flanks
    links, n = len(motion.model.links), len(elements)
    at_once = max(1, AT_ONCE // max(motion.frames, 1))
    units: list[Transmitted] = []
    for start in range(0, n, at_once):
        some = elements[start : start + at_once]
        own_force: list[Array] = [0j] * links
        own_moment: list[Array] = [0.0] * links
        for i, element in enumerate(some):
            one = np.zeros((len(some), 1))
            one[i] = 1.0
            element.load(motion, own_force, own_moment, one)
        together = transmit(motion, own_force, own_moment, flanks)
        units += [pick(together, i, (len(some), motion.frames)) for i in range(len(some))]
    return Response(base, units)


def pick(together: Transmitted, i: int, shape: tuple[int, int]) -> Transmitted:
    """The part of one element of what several transmit side by side."""
    transmitted, contacts, multipliers = together

    def one(value: Array) -> Array:
        return np.broadcast_to(value, shape)[i]

    return (
        [(one(f), one(c)) for f, c in transmitted],
        {name: (place, one(f)) for name, (place, f) in contacts.items()},
        {r: one(m) for r, m in multipliers.items()},
    )


def system(motion: Motion, elements: Sequence[Element], response: Response, way: float = 1.0) -> tuple[Real, Real, Flags]:
    """``a`` (F, n, 2), ``K`` (F, n, 2, n) and the kinds of norm (n,) of the normal loads ``g = |a + K g|``.

    ``way`` = -1: the same loads while everything moves backwards.
    """
    frames, n = motion.frames, len(elements)
    a, k = np.empty((n, 2, frames)), np.empty((n, 2, n, frames))  # frames last in memory, where numpy is quick
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for i, element in enumerate(elements):
            sign = way * element.sign
            a[i, 0], a[i, 1] = element.normal(motion, *response.base[:2], sign)
            if element.kind == "brake":
                k[i] = 0.0
                continue
            for j, (source, unit) in enumerate(zip(elements, response.units, strict=True)):
                p, q = element.normal(motion, *unit[:2], sign)
                braking = -way * source.sign * source.factor
                k[i, 0, j], k[i, 1, j] = braking * p, braking * q
    return np.moveaxis(a, -1, 0), np.moveaxis(k, -1, 0), np.array([e.euclidean for e in elements])
