"""Revolute pair: two points coincide, the angle is free."""

from __future__ import annotations

from ..spec import Link, Revolute
from .joint import Joint, point_of


def joint(pair: Revolute, first: Link, second: Link) -> Joint:
    return Joint(
        name=pair.name,
        kind="revolute",
        links=pair.links,
        a=point_of(first, pair.points[0]),
        b=point_of(second, pair.points[1]),
        turns=True,
    )
