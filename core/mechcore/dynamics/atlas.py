"""Charts of several freedoms: which pairs' coordinates lead, and when others had better take over.

Free coordinates are a chart of the configurations only as long as they decide them: where the rods of a five-bar are in line, its
two arms do not. Then other coordinates do. A chart is left while it is still good: where some pair moves several times as fast as
its own coordinates. Those lead from there on beside which no other pair moves much faster.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from ..effects import potential
from ..effects.argument import rate
from ..motion import Motion
from ..solve import Compiled, compile_mechanism
from ..spec import Drive, Mechanism, Planar, Prismatic, Revolute, coordinates_of
from .accounts import kinetic_energy_of
from .free import Free
from .handover import carried_on, enter
from .reduced import free_of, motion_at, moving

__all__ = ["STRAINED", "named", "strain", "take_over"]

Array = NDArray[np.float64]
STRAINED = 6.0  # rate of some pair per unit rate of the leading coordinates, from which on others take over
EASED = 0.5  # of that, at most, with those others
MANY = 500  # sets of pairs, all of which are looked at
SAME = 1e-9  # of positions and energies: the mechanism is where it was


def named(mechanism: Mechanism) -> Mechanism:
    """The mechanism in whose loads the leading pair is named where it was meant without its name."""
    first = mechanism.drives[0].pair
    loads = []
    for load in mechanism.loads:
        changes: dict[str, Any] = {}
        factor = getattr(load, "factor", None)
        if factor is not None and factor.of in ("position", "velocity") and factor.pair is None:
            changes["factor"] = replace(factor, pair=first)
        if getattr(load, "drive", first) is None:
            changes["drive"] = first
        loads.append(replace(load, **changes) if changes else load)
    return replace(mechanism, loads=tuple(loads))


def strain(compiled: Compiled, q: Array, v: Array, t: float) -> float:
    """Largest rate of a pair per unit rate of a free coordinate at q, v (f,); displacements over the mechanism's size."""
    return float(np.abs(_rates(compiled, q, v, t)[2]).max())


def _rates(compiled: Compiled, q: Array, v: Array, t: float) -> tuple[Motion, list[str], Array]:
    """The motion at an instant, pairs that could lead, and their rates per unit rate of each free coordinate (p, f)."""
    motion, units = moving(compiled, q[None], v[None], np.array([t]))
    mechanism, model = compiled.mechanism, compiled.model
    led = {d.pair for d in mechanism.drives if not isinstance(d.law, Free)}
    movable = [p for p in mechanism.pairs if isinstance(p, Revolute | Prismatic | Planar)]
    names = [name for p in movable for name in coordinates_of(p) if name not in led]
    names = [name for name in names if model.joints[model.joint_index[name]].freedoms]
    size = {name: model.size if model.joints[model.joint_index[name]].coordinate == "slide" else 1.0 for name in names}
    free = [mechanism.drives[i].pair for i in free_of(compiled)]
    rows = [[float(np.ravel(rate(u, name))[0]) * size[f] / size[name] for u, f in zip(units, free, strict=True)] for name in names]
    return motion, names, np.array(rows)


def take_over(compiled: Compiled, q: Array, v: Array, t: float, known: Sequence[Compiled]) -> tuple[Compiled, Array, Array] | None:
    """The same mechanism, in the same place, in a better chart; its coordinates and rates (f,) there. One that is ``known`` is
    taken again if it goes through this place. None where no other chart is better, or shows the same mechanism there."""
    motion, names, rows = _rates(compiled, q, v, t)
    if not np.isfinite(rows).all():
        return None
    sets = _sets(rows)
    chosen = rows[np.array(sets)]
    fine = np.abs(np.linalg.det(chosen)) > 1e-6
    eased = np.full(len(sets), np.inf)
    eased[fine] = np.abs(rows @ np.linalg.inv(chosen[fine])).max(axis=(1, 2))
    if not eased.min() <= EASED * np.abs(rows).max():
        return None
    pairs = [names[k] for k in sets[int(np.argmin(eased))]]
    found = np.array([motion.coordinate(pair)[0] for pair in pairs])
    place, speeds = found[:, 0], found[:, 1]
    candidates = [c for c in known if [c.mechanism.drives[i].pair for i in free_of(c)] == pairs]
    for candidate in (*candidates, None):
        if candidate is None:
            other = carried_on(_compiled(compiled, motion, pairs, found), place, t, motion)
        else:
            other = enter(candidate, place, t, motion)
        if _same(motion, other, place, speeds, t):
            return other, place, speeds
    return None


def _sets(rows: Array) -> list[tuple[int, ...]]:
    """Sets of pairs that could lead; where there are very many, only the one of a pivoted QR decomposition of their rates."""
    p, f = rows.shape
    if comb(p, f) <= MANY:
        return list(combinations(range(p), f))
    return [tuple(sorted(int(k) for k in qr(rows.T, mode="r", pivoting=True)[1][:f]))]


def _compiled(compiled: Compiled, motion: Motion, pairs: Sequence[str], found: Array) -> Compiled:
    """The mechanism with other free coordinates, put together as it stands now; from there on the laws of drives lead."""
    mechanism = named(compiled.mechanism)
    poses: dict[str, tuple[float, float, float]] = {}
    for link in motion.model.links[1:]:
        x, y, angle = motion.pose(link)[0]
        poses[link] = float(x), float(y), float(angle)
    free = [Drive(pair=pair, law=Free(float(x[0]), float(x[1]))) for pair, x in zip(pairs, found, strict=True)]
    led = [d for d in mechanism.drives if not isinstance(d.law, Free)]
    still = [Drive(pair=d.pair, law=Free(float(motion.coordinate(d.pair)[0, 0]), 0.0)) for d in led]
    placed = compile_mechanism(replace(mechanism, drives=(*free, *still), modes={}, sketch=poses), compiled.accuracy)
    known = replace(mechanism, drives=(*free, *led), modes={}, sketch=poses)
    return replace(placed, model=replace(placed.model, mechanism=known))


def _same(motion: Motion, other: Compiled, q: Array, v: Array, t: float) -> bool:
    """Whether a chart has all links, and all energy, where they are."""
    there = motion_at(other, q[None], v[None], np.array([t]))
    for link in motion.model.links[1:]:
        a, b = motion.pose(link)[0], there.pose(link)[0]
        if not np.abs(a[:2] - b[:2]).max() <= SAME * motion.model.size or not abs(np.exp(1j * (a[2] - b[2])) - 1.0) <= SAME:
            return False
    energies = [np.array([kinetic_energy_of(m)[0], np.ravel(potential(m))[0]]) for m in (motion, there)]
    return bool(np.abs(energies[0] - energies[1]).max() <= 1e3 * SAME * max(1e-300, np.abs(energies[0]).max()))
