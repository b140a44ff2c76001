"""Pin in slot: the pin slides along the slot and turns in it."""

from __future__ import annotations

from mechcore.joints.base import Builder, Joint, point_of
from mechcore.spec.mechanism import PinSlot


def build(pair: PinSlot, builder: Builder) -> None:
    first, second = builder.ends(pair)
    along = complex(*pair.along)
    builder.joints.append(
        Joint(
            name=pair.name,
            kind="pin_slot",
            links=pair.links,
            a=point_of(first, pair.points[0]),
            b=point_of(second, pair.points[1]),
            turns=True,
            slide=along / abs(along),
            guide=pair.guide,
        )
    )
