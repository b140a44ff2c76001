"""Kinematic pairs: what each kind allows, in one common form that the rest of the core works with.

To add a pair: a spec in ``mechcore.spec``, one file here that turns it into a `Joint`, one line in `KINDS`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..spec import Link, Pair, Prismatic, Revolute
from . import prismatic, revolute
from .joint import Joint, point_of

__all__ = ["KINDS", "Joint", "joint_of", "point_of"]

KINDS: dict[type, Callable[[Any, Link, Link], Joint]] = {
    Revolute: revolute.joint,
    Prismatic: prismatic.joint,
}


def joint_of(pair: Pair, first: Link, second: Link) -> Joint:
    """The common form of a pair between two links."""
    return KINDS[type(pair)](pair, first, second)
