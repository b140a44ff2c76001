"""How far groups with a closed form are from where their two assembly modes meet, and by how much their links miss each other."""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Values
from mechcore.kinematics import dyads
from mechcore.kinematics.model import Model
from mechcore.kinematics.positions import loop_terms
from mechcore.kinematics.program import Block
from mechcore.kinematics.state import State


def dead_point_margin(model: Model, block: Block, state: State) -> list[Values]:
    """How far a group with two modes is from where they meet: smooth functions (squares of lengths, relative) that touch 0."""
    target, arms, guides = loop_terms(model, block, state)
    if block.kind == "theta_theta":
        ra, rb, d = np.abs(arms[0]), np.abs(arms[1]), np.abs(target)
        total, difference = ra + rb, abs(ra - rb)
        return [(total - d) * (total + d) / total**2, (d - difference) * (d + difference) / total**2]
    if block.kind == "theta_slide":
        r, y = np.abs(arms[0]), (target * np.conj(guides[0])).imag
        return [(r - y) * (r + y) / r**2]
    r2, y = target.real**2 + target.imag**2, (arms[0] * np.conj(guides[0])).imag
    return [(r2 - y * y) / model.length_scale**2]


def gap(model: Model, block: Block, state: State) -> Values:
    """By how much the links of a block with a closed form miss each other [m] (...), 0 where they meet; needs the earlier blocks in
    ``state``."""
    target, arms, guides = loop_terms(model, block, state)
    if block.kind == "theta_theta":
        return dyads.gap_theta_theta(arms[0], arms[1], target)
    if block.kind == "theta_slide":
        return dyads.gap_theta_slide(arms[0], guides[0], target)
    if block.kind == "arm_slide":
        return dyads.gap_arm_slide(arms[0], guides[0], target)
    return np.zeros(np.shape(target))


def span(model: Model, block: Block, state: State) -> float:
    """Distance of a group's outer pins [m], which its two links have to bridge."""
    return float(np.max(np.abs(loop_terms(model, block, state)[0])))
