"""Weld: two points coincide and the angle is fixed."""

from __future__ import annotations

from mechcore.joints.base import Builder, Joint, point_of
from mechcore.spec.mechanism import Weld


def build(pair: Weld, builder: Builder) -> None:
    first, second = builder.ends(pair)
    builder.joints.append(
        Joint(
            name=pair.name,
            kind="weld",
            links=pair.links,
            a=point_of(first, pair.points[0]),
            b=point_of(second, pair.points[1]),
            turns=False,
            angle=pair.angle,
        )
    )
