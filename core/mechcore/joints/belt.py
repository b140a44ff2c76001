"""Belt or chain: two pulleys on one carrier; the tight span is a two-force member between them."""

from __future__ import annotations

from typing import Any

import numpy as np

from mechcore.errors import Fault, MechanismError
from mechcore.joints.base import Builder, Relation
from mechcore.spec.mechanism import Belt
from mechcore.texts import as_length


def build(joint: Belt, builder: Builder) -> None:
    c1, c2 = (builder.axis_between(joint, link, joint.carrier)[0] for link in joint.links)
    distance = abs(c2 - c1)
    r1, r2 = joint.radii
    sense = 1.0 if joint.crossed else -1.0
    if min(r1, r2) <= 0.0 or distance <= (r1 + r2 if joint.crossed else abs(r1 - r2)):
        raise MechanismError(
            Fault(
                f"joints.{joint.name}",
                f"pulleys of radius {as_length(r1)} and {as_length(r2)} do not fit on axes {as_length(distance)} apart.",
                "Move the axes apart or make the pulleys smaller.",
            )
        )
    axis = (c2 - c1) / distance
    lean = (r1 + sense * r2) / distance

    def contact(motion: Any, multiplier: Any) -> tuple[Any, Any]:
        """A belt only pulls: a positive multiplier is carried by one span, a negative by the other.

        The multiplier counts along the direction in which the first pulley's rim moves when it turns counter-clockwise.
        """
        k = motion.model.index[joint.carrier]
        turn = motion.rotation(k)
        side = np.where(np.real(multiplier) >= 0, 1.0, -1.0)
        out = (lean + side * 1j * np.sqrt(1.0 - lean**2)) * axis  # at its tangent point the rim moves away from the second pulley
        return motion.origins[k] + (c1 + r1 * out) * turn, 1j * out * turn

    builder.relations.append(
        Relation(
            name=joint.name,
            kind="belt",
            links=joint.links,
            angles=((joint.links[0], r1), (joint.links[1], sense * r2), (joint.carrier, -r1 - sense * r2)),
            slides=(),
            contact=contact,
        )
    )
