"""The sketch: rough poses of links. What it says of angles and displacements, and the way from where it is drawn to the start."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import replace

from mechcore.branches.modes import TWO_MODES, stated_modes
from mechcore.kinematics.model import Model
from mechcore.kinematics.state import State
from mechcore.laws.timed import Piecewise
from mechcore.spec.mechanism import Cylinder, Drive, Mechanism, coordinates_of

TURN = 2.0 * math.pi
AT_START = 0.02  # a drive drawn within this [rad, or part of the mechanism's size] of its start is drawn there


def sketched_angle(model: Model, group: int, state: State) -> float | None:
    """A group's sketched angle [rad], from any of its links in the sketch."""
    turning = model.angles
    for k in turning.links_of[group]:
        name = model.links[k]
        if name in model.mechanism.sketch:
            extra = cmath.phase(complex(state.delta[turning.rotation_class[k]]))
            return model.mechanism.sketch[name][2] - turning.offset[k] - extra
    return None


def sketched_slide(model: Model, j: int) -> float | None:
    """A sliding joint's sketched displacement [m], where both links are in the sketch (the frame always is)."""
    joint = model.joints[j]
    sketch = {k: v for k, v in model.mechanism.sketch.items() if k in joint.links}
    if model.links[0] in joint.links:
        sketch.setdefault(model.links[0], (0.0, 0.0, 0.0))
    if any(k not in sketch for k in joint.links):
        return None
    at = []
    for link, local in zip(joint.links, (joint.a, joint.b), strict=True):
        x, y, angle = sketch[link]
        at.append(x + 1j * y + local * cmath.exp(1j * angle))
    d = (joint.slide or 0j) * cmath.exp(1j * sketch[joint.links[joint.guide]][2])
    way = (at[1] - at[0]) if joint.guide == 0 else (at[0] - at[1])
    return (way * d.conjugate()).real


def sketched_drives(model: Model, start: Sequence[float]) -> tuple[float, ...] | None:
    """Positions of the drives at which the sketch is drawn [rad or m], angles within half a turn of the start; None where that is
    the start, as far as it is drawn, or where nothing is taken from the sketch."""
    if not model.mechanism.sketch or not _decides(model):
        return None
    drawn, away = list(start), False
    for k, (drive, q) in enumerate(zip(model.mechanism.drives, start, strict=True)):
        place = _sketched_drive(model, drive.joint)
        if place is None:
            continue
        rotary = model.rotary(drive.joint)
        way = math.remainder(place - q, TURN) if rotary else place - q
        if abs(way) > AT_START * model.coordinate_scale(drive.joint):
            drawn[k], away = q + way, True
    return tuple(drawn) if away else None


def _decides(model: Model) -> bool:
    """Whether something about the assembly may follow from the sketch."""
    two = {block.name for block in model.blocks if block.kind in TWO_MODES}
    return bool(model.relations) or not two <= stated_modes(model).keys() or any(block.kind == "general" for block in model.blocks)


def _sketched_drive(model: Model, name: str) -> float | None:
    """The coordinate of a driven loop_joint as it is drawn [rad or m]; None where it is not."""
    poses = {model.mechanism.frame: (0.0, 0.0, 0.0), **model.mechanism.sketch}
    joint = next((joint for joint in model.mechanism.joints if name in coordinates_of(joint)), None)
    if isinstance(joint, Cylinder):
        if not poses.keys() >= set(joint.links):
            return None
        links = {link.name: link for link in model.mechanism.links}
        ends = []
        for link, point in zip(joint.links, joint.points, strict=True):
            x, y, angle = poses[link]
            ends.append(complex(x, y) + complex(*links[link].points[point]) * cmath.exp(1j * angle))
        return abs(ends[1] - ends[0])
    j = model.joint_index[name]
    loop_joint = model.joints[j]
    if loop_joint.slide is not None:
        return sketched_slide(model, j)
    first, second = loop_joint.links
    return poses[second][2] - poses[first][2] if first in poses and second in poses else None


def at_sketch(mechanism: Mechanism, drawn: Sequence[float], start: Sequence[float]) -> Mechanism:
    """The mechanism with drives that lead evenly from where it is drawn to the start, in a second."""
    laws = [Piecewise(knots=(0.0, 1.0), coefficients=((a, b - a),), advance=b - a) for a, b in zip(drawn, start, strict=True)]
    return replace(mechanism, drives=tuple(Drive(joint=d.joint, law=law) for d, law in zip(mechanism.drives, laws, strict=True)))
