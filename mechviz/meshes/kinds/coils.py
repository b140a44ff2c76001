"""Helical springs as solids: a wire wound around the x axis, with closed, flat ends or straight ends to pull at."""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Real
from mechviz.meshes.extrude import Shell

SIDES = 8  # of the wire
STEPS = 18  # places of the wire in a turn
CLOSED = 1.0  # turns at each end of a compression spring that lie against their neighbours
FLAT = 0.15  # of the wire's diameter that is left of it where it is ground off
STEM = 0.12  # part of the length at each end of a tension spring that is straight, on the axis


def coil_shell(length: float, radius: float, wire: float, turns: float, *, straight: bool) -> tuple[Shell, Real]:
    """A spring from x = 0 to ``length`` around the x axis, and outward unit normals at its vertices (V, 3).

    radius: of the wire's middle line around the axis; wire: its diameter; turns: those that give way. Closed turns at both ends are
    ground flat; with ``straight`` the wire goes over into the axis there instead.
    """
    line, phase = _pulled(length, radius, turns) if straight else _pushed(length, radius, wire, turns)
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    out = np.column_stack([np.zeros(len(line)), np.cos(phase), np.sin(phase)])
    out -= (out * along).sum(axis=1, keepdims=True) * along
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    side = np.cross(along, out)
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    normals = np.cos(angle)[:, None] * out[:, None] + np.sin(angle)[:, None] * side[:, None]
    vertices = (line[:, None] + 0.5 * wire * normals).reshape(-1, 3)
    normals = normals.reshape(-1, 3)
    if not straight:
        for end, sign in ((0.0, -1.0), (length, 1.0)):
            beyond = sign * (vertices[:, 0] - end) > 0.0
            vertices[beyond, 0] = end
            normals[beyond] = (sign, 0.0, 0.0)
    count = len(line)
    ring, place = np.arange(SIDES), np.arange(count - 1)[:, None] * SIDES
    after = np.roll(ring, -1)
    walls = [np.stack([place + ring, place + after, place + SIDES + after], axis=-1).reshape(-1, 3),
             np.stack([place + ring, place + SIDES + after, place + SIDES + ring], axis=-1).reshape(-1, 3)]  # fmt: skip
    ends = len(vertices) + np.arange(2)
    last = (count - 1) * SIDES
    caps = [
        np.column_stack([after, ring, np.full(SIDES, ends[0])]),
        np.column_stack([last + ring, last + after, np.full(SIDES, ends[1])]),
    ]
    vertices = np.vstack([vertices, vertices[:SIDES].mean(axis=0), vertices[last:].mean(axis=0)])
    normals = np.vstack([normals, -along[0], along[-1]])
    return Shell(vertices, np.vstack([*walls, *caps])), normals


def _pushed(length: float, radius: float, wire: float, turns: float) -> tuple[Real, Real]:
    """The middle line of a compression spring, and its angle about the axis [rad]: it rises by the wire's diameter in closed turns,
    evenly in between."""
    whole = turns + 2.0 * CLOSED
    t = np.linspace(0.0, whole, round(whole * STEPS) + 1)
    low = (FLAT - 0.5) * wire
    step = min(wire, 0.25 * length / CLOSED)
    knots = [0.0, CLOSED, whole - CLOSED, whole]
    x = np.interp(t, knots, [low, low + CLOSED * step, length - low - CLOSED * step, length - low])
    phase = 2.0 * np.pi * t
    return np.column_stack([x, radius * np.cos(phase), radius * np.sin(phase)]), phase


def _pulled(length: float, radius: float, turns: float) -> tuple[Real, Real]:
    """The same of a tension spring: along the axis, out to the coil over half a turn, and back at the other end."""
    t = np.linspace(0.0, turns, round(turns * STEPS) + 1)
    blend = np.clip(np.minimum(t, turns - t) / 0.5, 0.0, 1.0)
    r = radius * blend**2 * (3.0 - 2.0 * blend)
    x = length * (STEM + (1.0 - 2.0 * STEM) * t / turns)
    phase = 2.0 * np.pi * t
    line = np.column_stack([x, r * np.cos(phase), r * np.sin(phase)])
    return np.vstack([[0.0, 0.0, 0.0], line, [length, 0.0, 0.0]]), np.concatenate([phase[:1], phase, phase[-1:]])
