"""How a motion goes on in another chart: the angles of the links, and the groups that have to be followed, from where they are."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mechcore.arrays import Real
from mechcore.branches.unwrapped import TURN, Starts, UnwrappedAngles, Waypoint, raw_angles
from mechcore.dynamics.equations.reduced import motion_at
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion

Array = Any


def waypoints(compiled: Compiled, q: Real, t: Real) -> list[Waypoint]:
    """Waypoints at free coordinates (n, f) and times (n,)."""
    columns = iter(q.T)
    drives = [next(columns) if isinstance(d.law, Free) else np.asarray(d.law(t)[0], float) for d in compiled.mechanism.drives]
    return [Waypoint(float(time), row) for time, row in zip(t, np.column_stack([np.zeros((len(t), 0)), *drives]), strict=True)]


def carried_on(compiled: Compiled, q: Real, t: float, motion: Motion) -> Compiled:
    """A mechanism in a new chart, put together at its coordinates q (f,) at time t [s]. The angles of its links go on from those
    of a ``motion`` (one frame) of the same mechanism there, in another chart."""
    at = replace(_entered(compiled, q, t, motion), starts=compiled.assembly.starts)
    found = replace(compiled, angles=UnwrappedAngles(compiled.model, motion.angles.start, at, exact=False))
    model, angles = compiled.model, motion_at(found, q[None], np.zeros_like(q)[None], np.array([t])).angles
    turning = [j for j in model.driven if model.joints[j].coordinate == "angle"]
    gone = (angles.joint(model.joints[j].name)[0] - at.drives[model.driven[j]] for j in turning)
    found.angles.exact = all(abs(float(x)) < 1.0 for x in gone)
    return found


def enter(compiled: Compiled, q: Real, t: float, motion: Motion) -> Compiled:
    """A chart that has led the motion before and does so again from its free coordinates q (f,) and the time t [s] on, as
    `carried_on`."""
    if len(compiled.mechanism.drives) > 1:
        at = _entered(compiled, q, t, motion)
        compiled.angles.way.leave([replace(at, starts=_starts(compiled, at, motion))])
    return compiled


def _entered(compiled: Compiled, q: Real, t: float, motion: Motion) -> Waypoint:
    """Where a chart takes a motion over from another one, the angles of its rotation classes known."""
    model, old = compiled.model, motion.model
    placed = motion_at(compiled, q[None], np.zeros_like(q)[None], np.array([t]))
    class_angles = raw_angles(model, [d[0] for d in placed.drives], placed.state, (1,))[:, 0]
    for k, link in enumerate(model.links):
        if link in old.index:
            rotation_class = model.angles.rotation_class[k]
            there = float(motion.angle(old.index[link])[0]) - model.angles.offset[k]
            class_angles[rotation_class] += TURN * np.round((there - class_angles[rotation_class]) / TURN)
    (at,) = waypoints(compiled, q[None], np.array([t]))
    return replace(at, class_angles=class_angles)


def _starts(compiled: Compiled, at: Waypoint, motion: Motion) -> Starts:
    """Starts of the groups that have to be followed, from those at the chart's first waypoint and what has moved since."""
    model, first = compiled.model, compiled.angles.at
    turning = model.angles

    def group(waypoint: Waypoint, g: int) -> float:
        rotation_class = turning.classes_of[g][0]
        assert waypoint.class_angles is not None
        return float(waypoint.class_angles[rotation_class]) - sum(
            sign * float(waypoint.drives[d]) for d, sign in turning.class_drives[rotation_class]
        )

    known, found = first.starts or {}, {}
    for block in model.blocks:
        if block.name in known:
            turned = [known[block.name][i] + group(at, g) - group(first, g) for i, g in enumerate(block.angles)]
            old = motion.model.joint_index
            slid = [float(np.ravel(motion.state.slide[old[model.joints[j].name]])[0]) for j in block.slides]
            found[block.name] = np.array([*turned, *slid])
    for g in model.multi_turn:
        found[f"angle {g}"] = np.asarray(known[f"angle {g}"] + group(at, g) - group(first, g))
    return found
