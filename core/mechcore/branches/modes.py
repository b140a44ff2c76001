"""Assembly modes as a mechanism states them: in words, and by a sketch.

For words: which group the word at a joint applies to, and which mode it means. For the sketch (approximate poses of links): the
angles, displacements and drive positions that follow from it, and the laws that lead from the sketched position to the start.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mechcore.constants import TURN
from mechcore.errors import Fault
from mechcore.kinematics.model import Model
from mechcore.kinematics.positions import place_block
from mechcore.kinematics.program import Block
from mechcore.kinematics.state import State
from mechcore.laws.timed import Piecewise
from mechcore.spec.mechanism import Cylinder, Drive, Mechanism, coordinates_of

TWO_MODES = ("theta_theta", "theta_slide", "arm_slide")
WORDS = {"theta_theta": ("left", "right"), "theta_slide": ("ahead", "behind"), "arm_slide": ("ahead", "behind")}
OTHER = {"left": "right", "right": "left", "ahead": "behind", "behind": "ahead", "open": "crossed", "crossed": "open"}
KEYS = {
    "left": "side", "right": "side", "ahead": "branch", "behind": "branch", "open": "assembly", "crossed": "assembly",
}  # fmt: skip
"""The key that states each assembly mode."""


def stated_modes(model: Model) -> dict[str, list[str]]:
    """Block with two modes -> the joints at which the mechanism states its mode: any of those that the block places.

    A joint belongs to the last block in solving order that its coordinate and links depend on: an outer pin of a dyad belongs to
    the dyad, not to the group that carries it.
    """
    last = {unknown: k for k, block in enumerate(model.blocks) if block.loops for unknown in block.unknowns}
    stated: dict[str, list[str]] = {}
    for joint in model.mechanism.modes:
        j = model.joint_index.get(joint)
        if j is None:
            continue
        unknowns = [("slide", j), *(("angle", model.angles.group[k]) for k in model.ends[j])]
        k = max(last.get(x, -1) for x in unknowns)
        if k >= 0 and model.blocks[k].kind in TWO_MODES:
            stated.setdefault(model.blocks[k].name, []).append(joint)
    return stated


def stated_sign(model: Model, block: Block, state: State, joints: Sequence[str]) -> tuple[float, list[Fault]]:
    """The sign of a block with two modes, stated at ``joints``, and the faults of words that do not apply or contradict others."""
    modes = model.mechanism.modes
    signs, faults = [], []
    for joint in joints:
        sign, fault = _sign(model, block, state, joint, modes[joint])
        signs.append(sign)
        faults += fault
        if not faults and sign != signs[0]:
            why = f"'{modes[joint]}' contradicts '{modes[joints[0]]}' at {joints[0]}: both say how the same group is put together."
            faults.append(Fault(f"joints.{joint}.{KEYS[modes[joint]]}", why, "Keep one of them."))
    return signs[0], faults


def _sign(model: Model, block: Block, state: State, joint: str, word: str) -> tuple[float, list[Fault]]:
    """The sign of a block with two modes by the ``word`` at one joint, and the faults of that word."""
    words = WORDS[block.kind]
    if word in words:
        return (1.0 if word == words[0] else -1.0) * orientation(model, block, joint), []
    if word in ("open", "crossed") and block.kind == "theta_theta":
        open_sign = _open_mode(model, block, state)
        if open_sign is not None:
            return (open_sign if word == "open" else -open_sign), []
        message = f"'{word}' needs a four-bar loop, which this group does not close."
        if _closed_four_bar(model, block) is not None:
            message = f"'{word}' does not decide: at the start, no links cross in either assembly mode."
    else:
        message = f"'{word}' is not an assembly mode of this group."
    remedy = f'Write {KEYS[words[0]]} = "{words[0]}" or "{words[1]}" instead.'
    return 1.0, [Fault(f"joints.{joint}.{KEYS[word]}", message, remedy)]


def other_modes(mechanism: Mechanism, beside: str = "") -> Iterator[tuple[Mechanism, str]]:
    """The mechanism with one of its stated assembly modes replaced by the other, and a remedy that says so, for each such mode but
    that of the joint ``beside``."""
    for joint, word in mechanism.modes.items():
        if joint != beside and word in OTHER:
            other = OTHER[word]
            remedy = f', or take the other mode at {joint}, {KEYS[word]} = "{other}"'
            yield replace(mechanism, modes={**mechanism.modes, joint: other}), remedy


def orientation(model: Model, block: Block, joint: str) -> float:
    """+1 if the words stated at ``joint`` mean the closed form's +1 mode, -1 if its -1 mode.

    'left': looking from the first link's other pin to the second link's other pin, the joint between the two links lies on the
    left. First and second link are those of the joint where the word is stated if it joins the two links, else those of the block's
    inner joint; the closed form takes its first unknown group as the first. 'ahead': the larger of the two displacements along the
    guide.
    """
    if block.kind == "theta_theta":
        groups = [model.angles.group[k] for k in model.ends[model.joint_index[joint]]]
        if set(groups) != set(block.angles):
            return orientation(model, block, block.name)
        return 1.0 if groups[0] == block.angles[0] else -1.0
    # arm_slide: mode +1 has the larger displacement; theta_slide: the link's part is subtracted, so mode +1 has the smaller one
    return 1.0 if block.kind == "arm_slide" else -1.0


def _closed_four_bar(model: Model, block: Block) -> tuple[int, int, int, int, int] | None:
    """The pins of the four-bar that a block closes: its two outer pins, each with its known link, and the pin of the known links,
    (joint, link, joint, link, joint); None if it closes no four-bar."""
    u, v = block.angles
    pins = []
    for g, other in ((u, v), (v, u)):
        for j, (p, q) in enumerate(model.ends):
            groups = (model.angles.group[p], model.angles.group[q])
            if g in groups and other not in groups and model.joints[j].slide is None:
                known = q if groups[0] == g else p
                pins.append((j, known))
                break
    if len(pins) != 2:
        return None
    (jb, kb), (jd, kd) = pins
    hinge = next((j for j, e in enumerate(model.ends) if set(e) == {kb, kd} and model.joints[j].slide is None), None)
    return None if hinge is None else (jb, kb, jd, kd, hinge)


def _open_mode(model: Model, block: Block, state: State) -> float | None:
    """The mode in which a four-bar's links do not cross at the start; None if the block closes no four-bar, or if the links cross
    in both modes or in neither."""
    four_bar = _closed_four_bar(model, block)
    if four_bar is None:
        return None
    jb, kb, jd, kd, hinge = four_bar
    inner = model.joint_index[block.name]

    def crossing(mode: float) -> bool:
        trial = state.copy()
        with np.errstate(invalid="ignore", divide="ignore"):
            place_block(model, block, trial, mode)

        def at(j: int, link: int) -> complex:  # from the hinge, along links whose rotation is known
            joint = model.joints[j]
            base = model.joints[hinge]
            p = joint.a if model.ends[j][0] == link else joint.b
            h = base.a if model.ends[hinge][0] == link else base.b
            return complex((p - h) * model.turn[link] * trial.rot[model.angles.rotation_class[link]])

        a, b, d = 0j, at(jb, kb), at(jd, kd)
        coupler = next(k for k in model.ends[jb] if k != kb)
        jc, jbt = model.joints[inner], model.joints[jb]
        pc = jc.a if model.ends[inner][0] == coupler else jc.b
        pb = jbt.a if model.ends[jb][0] == coupler else jbt.b
        c = b + complex((pc - pb) * model.turn[coupler] * trial.rot[model.angles.rotation_class[coupler]])
        return _segments_cross(a, b, c, d) or _segments_cross(b, c, d, a)

    plus, minus = crossing(1.0), crossing(-1.0)
    if plus == minus:
        return None
    return -1.0 if plus else 1.0


def _segments_cross(a: complex, b: complex, c: complex, d: complex) -> bool:
    def turn(p: complex, q: complex, r: complex) -> float:
        return ((q - p).conjugate() * (r - p)).imag

    return turn(a, b, c) * turn(a, b, d) < 0 and turn(c, d, a) * turn(c, d, b) < 0


AT_START = 0.02  # a drive sketched within this [rad, or fraction of the mechanism's size] of its start counts as at its start


def sketched_angle(model: Model, group: int, state: State) -> float | None:
    """A group's sketched angle [rad], from the first of its links in the sketch; None if there is none."""
    turning = model.angles
    for k in turning.links_of[group]:
        name = model.links[k]
        if name in model.mechanism.sketch:
            extra = cmath.phase(complex(state.delta[turning.rotation_class[k]]))
            return model.mechanism.sketch[name][2] - turning.offset[k] - extra
    return None


def sketched_slide(model: Model, j: int) -> float | None:
    """A sliding joint's sketched displacement [m]; None unless both links are in the sketch (the frame always is)."""
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
    offset = (at[1] - at[0]) if joint.guide == 0 else (at[0] - at[1])
    return (offset * d.conjugate()).real


def sketched_drives(model: Model, start: Sequence[float]) -> tuple[float, ...] | None:
    """Positions of the drives in the sketch [rad or m], angles within half a turn of the start.

    Drives that are not sketched are at their start. None if the sketch shows the start position, or if nothing is taken from it.
    """
    if not model.mechanism.sketch or not _decides(model):
        return None
    drawn, away = list(start), False
    for k, (drive, q) in enumerate(zip(model.mechanism.drives, start, strict=True)):
        place = _sketched_drive(model, drive.joint)
        if place is None:
            continue
        rotary = model.rotary(drive.joint)
        travel = math.remainder(place - q, TURN) if rotary else place - q
        if abs(travel) > AT_START * model.coordinate_scale(drive.joint):
            drawn[k], away = q + travel, True
    return tuple(drawn) if away else None


def _decides(model: Model) -> bool:
    """Whether the assembly may depend on the sketch."""
    two = {block.name for block in model.blocks if block.kind in TWO_MODES}
    return bool(model.relations) or not two <= stated_modes(model).keys() or any(block.kind == "general" for block in model.blocks)


def _sketched_drive(model: Model, name: str) -> float | None:
    """The sketched coordinate of a driven joint [rad or m]; None if its links are not in the sketch."""
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
    """The mechanism with drives that move at constant speed from the sketched position to the start in one second."""
    laws = [Piecewise(knots=(0.0, 1.0), coefficients=((a, b - a),), advance=b - a) for a, b in zip(drawn, start, strict=True)]
    return replace(mechanism, drives=tuple(Drive(joint=d.joint, law=law) for d, law in zip(mechanism.drives, laws, strict=True)))
