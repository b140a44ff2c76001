"""Prismatic pair: a point of one link on a straight guide of the other, the relative angle fixed."""

from __future__ import annotations

from mechcore.joints.base import Builder, Joint, point_of
from mechcore.spec.mechanism import Prismatic


def build(pair: Prismatic, builder: Builder) -> None:
    first, second = builder.ends(pair)
    along = complex(*pair.along)
    builder.joints.append(
        Joint(
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
    )
