"""Pinion and rack: the rack's guide and the pinion's pin are joints of their own; this ties the two together."""

from __future__ import annotations

from typing import Any

import numpy as np

from mechcore.errors import Fault, MechanismError
from mechcore.joints.base import Builder, Relation
from mechcore.spec.mechanism import Prismatic, Rack


def build(joint: Rack, builder: Builder) -> None:
    pinion, rack = joint.links
    slider = next((p for p in builder.mechanism.joints if p.name == joint.slider and isinstance(p, Prismatic)), None)
    if slider is None or rack not in slider.links:
        raise MechanismError(
            Fault(
                f"joints.{joint.name}",
                f"'{joint.slider}' is not a prismatic joint that guides '{rack}'.",
                "Name the prismatic joint between the rack and the link that carries the pinion.",
            )
        )
    carrier = slider.links[0] if slider.links[1] == rack else slider.links[1]
    centre, _ = builder.axis_between(joint, pinion, carrier)
    along = complex(*slider.along) / abs(complex(*slider.along))
    owner = slider.links[slider.guide]
    # the slider's coordinate grows as the link without the guide moves along it; `along` in the carrier's axes
    moves = 1.0 if owner == carrier else -1.0
    if owner == rack:
        along = along * np.exp(1j * (slider.angle if slider.links[1] == rack else -slider.angle))
    side = 1.0 if joint.side == "left" else -1.0
    towards = -1j * along * side  # from the pinion's axis to the rack

    def contact(motion: Any, multiplier: Any) -> tuple[Any, Any]:
        k = motion.model.index[carrier]
        push = np.where(np.real(multiplier) >= 0, 1.0, -1.0)
        lean = along + np.tan(joint.pressure_angle) * push * towards
        return motion.of_point(k, centre + joint.radius * towards), lean * motion.rotation(k)

    builder.relations.append(
        Relation(
            name=joint.name,
            kind="rack",
            links=joint.links,
            angles=((pinion, side * joint.radius), (carrier, -side * joint.radius)),
            slides=((joint.slider, -moves),),
            contact=contact,
        )
    )
