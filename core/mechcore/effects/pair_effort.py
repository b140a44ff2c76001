"""An effort in a pair: a torque in a revolute one, a force along the guide in a sliding one, between its two links."""

from __future__ import annotations

from typing import Any

from .base import Configuration
from .wrench import Wrench

__all__ = ["pair_wrench"]

Array = Any


def pair_wrench(at: Configuration, pair: str, effort: Array, *, name: str, kind: str, cause: str) -> Wrench:
    """``effort`` [N m or N] in the direction of a pair's coordinate: on its second link, the opposite on its first."""
    model = at.model
    j = model.joint_index[pair]
    joint, (first, second) = model.joints[j], model.ends[j]
    place = at.joint_point(j)
    arm, other_arm = place - at.origins[second], place - at.origins[first]
    if joint.coordinate == "angle":
        return Wrench(name, kind, second, 0j, effort, arm, cause, first, other_arm)
    along = at.guide(j) * (1.0 if joint.guide == 0 else -1.0)  # the coordinate grows where the link without the guide goes
    return Wrench(name, kind, second, effort * along, 0.0, arm, cause, first, other_arm)
