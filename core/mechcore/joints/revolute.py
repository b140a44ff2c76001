"""Revolute pair: two points coincide, the angle is free."""

from __future__ import annotations

from mechcore.joints.base import Builder, Joint, point_of
from mechcore.spec.mechanism import Revolute


def build(pair: Revolute, builder: Builder) -> None:
    first, second = builder.ends(pair)
    builder.joints.append(
        Joint(
            name=pair.name,
            kind="revolute",
            links=pair.links,
            a=point_of(first, pair.points[0]),
            b=point_of(second, pair.points[1]),
            turns=True,
        )
    )
