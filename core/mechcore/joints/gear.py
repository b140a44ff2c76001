"""Gear pair: two gears on one carrier roll on each other at the pitch point."""

from __future__ import annotations

from typing import Any

import numpy as np

from mechcore.errors import Fault, MechanismError
from mechcore.joints.base import Builder, Relation
from mechcore.spec.mechanism import Gear
from mechcore.texts import as_length


def build(joint: Gear, builder: Builder) -> None:
    c1, c2 = (builder.axis_between(joint, link, joint.carrier)[0] for link in joint.links)
    distance = abs(c2 - c1)
    n1, n2 = joint.sizes
    total = n2 - n1 if joint.internal else n1 + n2
    if distance == 0.0 or total <= 0.0:
        raise MechanismError(
            Fault(
                f"joints.{joint.name}",
                f"the axes are {as_length(distance)} apart and the sizes {n1:g} and {n2:g}: the gears cannot mesh.",
                "An internal gear pair lists the pinion first and the larger ring second; axes must not coincide.",
            )
        )
    r1 = n1 * distance / total
    sense = -1.0 if joint.internal else 1.0
    r2 = n2 * distance / total
    # unit vector towards the pitch point as seen from the first gear's axis, in the carrier's frame
    outward = (c2 - c1) / distance * sense
    pitch = c1 + r1 * outward

    def contact(motion: Any, multiplier: Any) -> tuple[Any, Any]:
        k = motion.model.index[joint.carrier]
        turn = motion.rotation(k)
        push = np.where(np.real(multiplier) >= 0, 1.0, -1.0)  # the flank that drives presses the gears apart
        lean = 1j + np.tan(joint.pressure_angle) * push
        return motion.of_point(k, pitch), lean * outward * turn

    builder.relations.append(
        Relation(
            name=joint.name,
            kind="gear",
            links=joint.links,
            angles=((joint.links[0], r1), (joint.links[1], sense * r2), (joint.carrier, -r1 - sense * r2)),
            slides=(),
            contact=contact,
        )
    )
