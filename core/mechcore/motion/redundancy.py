"""Reactions of mechanisms with redundant constraints: equilibrium has many solutions, the shortest one stands for them.

All joint forces and couples at once, link by link (Newton-Euler), by the pseudo-inverse; couples count in units of force by the
mechanism's size. Which joints are indeterminate follows from the null space: they can be stressed against each other with no load.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mechcore.arrays import Plane, Real, Values
from mechcore.motion.motion import Motion
from mechcore.numerics.frames import added, crossed, stacked
from mechcore.numerics.tape import Untraced

RANK = 1e-10  # singular values below this part of the largest are zero
NOTHING = 1e-12  # unknowns that stay below this part of the largest in all frames are zero


def least_norm(
    motion: Motion, force: Sequence[Plane], moment: Sequence[Values], flanks: Mapping[int, Values] | None = None
) -> tuple[list[tuple[Plane, Values]], dict[str, tuple[Plane, Plane]], dict[int, Values]]:
    """Transmitted force and couple on the second link of every joint, place and force of every relation, its multiplier.

    ``force`` and ``moment`` (about each link's origin) are what loads put on the links, (F,) or with axes before the frames'.
    ``flanks``: multipliers whose signs say which flank or span of each relation carries; else it is the one that the load asks for.
    """
    model = motion.model
    if flanks is None and model.relations:  # the multiplier does the same work on either flank: its sign comes first
        first = least_norm(motion, force, moment, dict.fromkeys(range(len(model.relations)), 1.0))
        if all(np.all(m >= 0.0) for m in first[2].values()):
            return first
        flanks = first[2]
    flanks = flanks or {}
    matrix, labels = equilibrium_matrix(motion, flanks)
    n = len(model.links) - 1
    shape = np.broadcast_shapes((motion.frames,), *(np.shape(v) for v in (*force, *moment)))
    loads = [part for k in range(1, n + 1) for part in (-force[k].real, -force[k].imag, -moment[k] / model.length_scale)]
    rhs = stacked(loads, shape)
    x = _balanced(matrix, rhs) if isinstance(matrix, np.ndarray) and isinstance(rhs, np.ndarray) else _traced(matrix, rhs)
    transmitted: list[tuple[Plane, Values]] = [(0j, 0.0)] * len(model.joints)
    contacts: dict[str, tuple[Plane, Plane]] = {}
    multipliers: dict[int, Values] = {}
    for column, (what, i, direction) in enumerate(labels):
        value = x[..., column]
        if what == "force":
            transmitted[i] = (transmitted[i][0] + value * direction, transmitted[i][1])
        elif what == "couple":
            transmitted[i] = (transmitted[i][0], transmitted[i][1] + value * model.length_scale)
        else:
            place, along = model.relations[i].contact(motion, flanks[i])
            contacts[model.relations[i].name] = (place, value * along)
            multipliers[i] = value
    return transmitted, contacts, multipliers


def _balanced(matrix: Real, rhs: Real) -> Real:
    """The shortest unknowns (..., n) that balance loads (..., m), NaN where none do."""
    x = (np.linalg.pinv(matrix, rcond=RANK) @ rhs[..., None])[..., 0]
    left = np.abs((matrix @ x[..., None])[..., 0] - rhs).max(axis=-1)
    size = np.abs(rhs).max(initial=0.0) or 1.0
    x = np.where((left < 1e-7 * size)[..., None], x, np.nan)  # at a singular position the loads may have no equilibrium at all
    largest = np.fmax.reduce(np.abs(x), axis=-2, initial=0.0)  # of each unknown over the run
    idle = largest <= NOTHING * np.fmax.reduce(largest, axis=-1, initial=0.0)[..., None]
    return np.where(idle[..., None, :] & np.isfinite(x), 0.0, x)  # or links that carry nothing would balance to rounding of others


def _traced(matrix: Any, rhs: Any) -> Any:
    """The same with its slopes, where there is one solution only."""
    if matrix.shape[-1] != matrix.shape[-2]:
        raise Untraced("statics does not determine all reactions")
    return np.linalg.solve(matrix, rhs[..., None])[..., 0]


def indeterminate(motion: Motion) -> tuple[str, ...]:
    """Joints whose reactions statics does not determine, at the run's best conditioned frame."""
    model = motion.model
    matrix, labels = equilibrium_matrix(motion, {})
    frame = int(np.argmin(np.where(np.isfinite(motion.condition), motion.condition, np.inf)))
    _, s, vt = np.linalg.svd(matrix[frame])
    rank = int((s > RANK * s[0]).sum())
    loose = np.abs(vt[rank:]).max(axis=0, initial=0.0) > 1e-9
    names = [model.relations[i].name if what == "tie" else model.joints[i].name for what, i, _ in labels]
    return tuple(dict.fromkeys(name for name, free in zip(names, loose, strict=True) if free))


def equilibrium_matrix(motion: Motion, flanks: Mapping[int, Values]) -> tuple[Real, list[tuple[str, int, Plane]]]:
    """Matrix (F, 3 links, unknowns) of the equilibrium of all links, moments over the size, and its unknowns."""
    model = motion.model
    labels: list[tuple[str, int, Plane]] = []
    for j, joint in enumerate(model.joints):
        along = motion.guide(j) if joint.slide is not None else None
        driven = j in model.driven
        if along is None:
            labels += [("force", j, 1 + 0j), ("force", j, 1j)]
        else:
            labels.append(("force", j, 1j * along))
            if driven:
                labels.append(("force", j, along))
        if not joint.turns or (driven and joint.coordinate == "angle"):
            labels.append(("couple", j, 0j))
    labels += [("tie", i, 0j) for i in range(len(model.relations))]
    entries: dict[tuple[int, int], Values] = {}

    def add(row: int, column: int, x: Values) -> None:
        entries[row, column] = added(entries.get((row, column), 0.0), x)

    def put(column: int, k: int, f: Plane, arm: Plane, sign: float) -> None:
        if k == 0:
            return
        add(3 * k - 3, column, sign * f.real)
        add(3 * k - 2, column, sign * f.imag)
        add(3 * k - 1, column, sign * crossed(arm, f) / model.length_scale)

    for column, (what, i, direction) in enumerate(labels):
        if what == "force":
            (p, q) = model.ends[i]
            put(column, q, direction, motion.arm(q, i, 1), 1.0)
            put(column, p, direction, motion.arm(p, i, 0), -1.0)
        elif what == "couple":
            p, q = model.ends[i]
            for k, sign in ((q, 1.0), (p, -1.0)):
                if k:
                    add(3 * k - 1, column, sign)
        else:
            relation = model.relations[i]
            place, along = relation.contact(motion, flanks.get(i, 1.0))
            for link, sign in zip(relation.links, (-1.0, 1.0), strict=True):
                k = model.index[link]
                put(column, k, along, place - motion.origins[k], sign)
            if relation.bearing is not None:
                couple = relation.bearing.couple(motion, place, along)
                for link, sign in ((relation.links[0], 1.0), (relation.bearing.carrier, -1.0)):
                    if (k := model.index[link]) != 0:
                        add(3 * k - 1, column, sign * couple / model.length_scale)
    rows = 3 * (len(model.links) - 1)
    cells = [entries.get((row, column), 0.0) for row in range(rows) for column in range(len(labels))]
    matrix = stacked(cells, (motion.frames,)).reshape(motion.frames, rows, len(labels))
    return matrix, labels
