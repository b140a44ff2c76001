"""Prismatic pair: a point of one link on a straight guide of the other, the relative angle fixed."""

from __future__ import annotations

from ..spec import Link, Prismatic
from .joint import Joint, point_of


def joint(pair: Prismatic, first: Link, second: Link) -> Joint:
    along = complex(*pair.along)
    return Joint(
        name=pair.name,
        kind="prismatic",
        links=pair.links,
        a=point_of(first, pair.points[0]),
        b=point_of(second, pair.points[1]),
        turns=False,
        angle=pair.angle,
        slide=along / abs(along),
        guide=pair.guide,
    )
