"""A wheel rolling on a straight edge: its centre keeps its distance (a slot through the centre), and it does not slip."""

from __future__ import annotations

from typing import Any

from mechcore.joints.base import Builder, Joint, Relation, point_of
from mechcore.spec.mechanism import Rolling


def build(pair: Rolling, builder: Builder) -> None:
    edge, wheel = builder.ends(pair)
    along = complex(*pair.along) / abs(complex(*pair.along))
    side = 1.0 if pair.side == "left" else -1.0
    towards = -1j * along * side
    builder.joints.append(
        Joint(
            name=pair.name,
            kind="rolling",
            links=pair.links,
            a=point_of(edge, pair.points[0]),
            b=point_of(wheel, pair.points[1]),
            turns=True,
            slide=along,
            guide=0,
        )
    )

    def contact(motion: Any, multiplier: Any) -> tuple[Any, Any]:
        k = motion.model.index[pair.links[0]]
        turn = motion.rotation(k)
        centre = motion.joint_point(motion.model.joint_index[pair.name])
        # the relation's first link is the edge, whose point moves backwards as the wheel's coordinate grows
        return centre + pair.radius * towards * turn, -along * turn

    builder.relations.append(
        Relation(
            name=pair.name,
            kind="rolling",
            links=pair.links,
            angles=((pair.links[1], side * pair.radius), (pair.links[0], -side * pair.radius)),
            slides=((pair.name, 1.0),),
            contact=contact,
        )
    )
