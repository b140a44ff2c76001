"""Force plans: the closed polygon of forces of every structural group, in the order of the hand method (last group first).

At an outer pin of a group the reaction is taken apart along and across its link. The part across (t) comes from the moments about
the link's inner pin, as by hand, and not from the solved reactions; the part along (n) is that of the solved reaction. So
the polygon
closes only if moments and reactions agree. In a dyad the reaction of the inner joint is the diagonal that closes the polygon
of each of its links.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mechcore.constructions.polygons import Edge, Plan, frames_of
from mechcore.forces.acting import LABELS, acting_on
from mechcore.forces.kinetostatics import Forces
from mechcore.kinematics.dyads import cross
from mechcore.kinematics.model import Model
from mechcore.motion.structure import groups

Array = Any


def force_plans(forces: Forces) -> tuple[Plan, ...]:
    """One polygon [N] for every group, the last group first, the driven links at the end."""
    model = forces.motion.model
    return tuple(_group(forces, [model.index[k] for k in g.links], " + ".join(g.links)) for g in reversed(groups(model)))


def _group(forces: Forces, own: list[int], name: str) -> Plan:
    motion = forces.motion
    model, n = motion.model, motion.frames
    ends = {c.name: tuple(model.index[k] for k in c.links) for c in model.connections}
    inner = [c for c, e in ends.items() if set(e) <= set(own)]
    outer = [c for c, e in ends.items() if len(set(e) & set(own)) == 1]
    outer.sort(key=lambda c: (own.index(_mine(ends[c], own)), 0 in ends[c]))
    first = [c for c in outer if _mine(ends[c], own) == own[0]][:1] if len(outer) > 1 else []
    sides: list[tuple[str, str, Array]] = []
    for c in first:
        sides += _reaction(forces, c, ends, own)
    mark = 0
    for k in own:
        for load in acting_on(forces, k):
            value = frames_of(load.force, n)
            if np.any(np.abs(value) > 0.0):
                sides.append((load.kind if load.kind in LABELS else "load", load.label, value))
        if k == own[0]:
            mark = len(sides)
    for c in outer:
        if c not in first:
            sides += reversed(_reaction(forces, c, ends, own))
    edges: list[Edge] = []
    at = np.zeros(n, complex)
    images = {"start": at}
    for i, (kind, label, vector) in enumerate(sides):
        edges.append(Edge(label, kind, at, frames_of(vector, n)))
        at = edges[-1].end
        if i + 1 == mark and len(own) == 2 and len(inner) == 1 and len(first) == 1 and len(outer) == 2:
            pull = _on(forces, inner[0], ends, own[0])
            edges.append(Edge(f"R_{inner[0]}", "inner", at, frames_of(pull, n)))
    return Plan(name, "N", tuple(edges), images, np.abs(at))


def _mine(ends: tuple[int, ...], own: list[int]) -> int:
    return next(k for k in ends if k in own)


def _wrench(forces: Forces, joint: str) -> tuple[Array, Array]:
    """Force and couple on a joint's second link, drive included, at the joint's position."""
    total = forces.reaction(joint)
    j = forces.motion.model.joint_index.get(joint)
    if j is not None and j in forces.motion.model.driven:
        total = total + forces.wrench(joint)
    return total[:, 0] + 1j * total[:, 1], total[:, 2]


def _on(forces: Forces, joint: str, ends: dict[str, tuple[int, ...]], link: int) -> Array:
    return _wrench(forces, joint)[0] * (1.0 if ends[joint][1] == link else -1.0)


def _reaction(forces: Forces, joint: str, ends: dict[str, tuple[int, ...]], own: list[int]) -> list[tuple[str, str, Array]]:
    """An outer reaction on the group: normal then tangential part where its link allows it, else as a whole."""
    model: Model = forces.motion.model
    link = _mine(ends[joint], own)
    force = _on(forces, joint, ends, link)
    here = [c for c, e in ends.items() if link in e]
    inner = [c for c in here if set(ends[c]) <= set(own)]
    kinds = {c.name: c.kind for c in model.connections}
    driven = {model.joints[j].name for j in model.driven}
    whole = [("reaction", f"R_{joint}", force)]
    if len(here) != 2 or len(inner) != 1 or kinds[joint] != "revolute" or kinds[inner[0]] != "revolute" or set(here) & driven:
        return whole
    place = {c: forces.position(c) @ np.array([1.0, 1.0j]) for c in here}
    arm = place[joint] - place[inner[0]]
    length = np.abs(arm)
    if np.any(length <= 1e-12 * model.length_scale):
        return whole
    unit = arm / length
    moment: Array = np.zeros(forces.motion.frames)
    for load in acting_on(forces, link):
        moment = moment + load.moment + cross(load.place - place[inner[0]], load.force)
    for c in here:  # couples that pins transmit, by friction for instance
        moment = moment + _wrench(forces, c)[1] * (1.0 if ends[c][1] == link else -1.0)
    across = -moment / length * 1j * unit
    along = np.real(force * np.conj(unit)) * unit
    return [("reaction normal", f"R_{joint}^n", along), ("reaction tangential", f"R_{joint}^t", across)]
