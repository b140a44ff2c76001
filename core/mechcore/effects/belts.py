"""The tension of a belt: what its slack span pulls, the tight one as well, beside the force that the belt carries."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Complex
from mechcore.effects.base import Configuration, Effect, Wrench
from mechcore.spec.loads import BeltTension

if TYPE_CHECKING:
    from mechcore.joints.base import Relation


def spans(at: Configuration, relation: Relation) -> tuple[Complex, Complex, float]:
    """Place [m], force on the second pulley per newton in both spans, and by how much the spans' normals lean towards it.

    The two pulls are mirrored at the line of centres: their resultant lies on it. The lean is (r1 - r2) / distance of an open belt,
    (r1 + r2) / distance of a crossed one.
    """
    (one, up), (other, down) = (relation.contact(at, side) for side in (1.0, -1.0))  # type: ignore[arg-type]  # a configuration is all that it looks at
    pull = up - down
    lean = np.imag(np.conj(up) * pull) / np.abs(pull)
    return 0.5 * (one + other), pull, float(np.mean(lean))


class BeltPull(Effect):
    """A tensioner holds the slack span at a constant tension: both spans pull the pulleys together by it, whatever they carry.

    It does no work: it presses on the bearings, and is what the belt has to drive by friction
    (`mechcore.forces.crossings` tells where that is not enough).
    """

    cause = "elastic"
    needs = frozenset({"positions"})

    def __init__(self, load: BeltTension):
        super().__init__(load.name)
        self.load = load

    def wrenches(self, at: Configuration) -> list[Wrench]:
        relation = next(r for r in at.model.relations if r.name == self.load.joint)
        first, second = (at.model.index[k] for k in relation.links)
        place, pull, _ = spans(at, relation)
        force = self.load.slack * pull
        arms = place - at.origins[second], place - at.origins[first]
        return [Wrench(self.name, "belt tension", second, force, 0.0, arms[0], self.cause, first, arms[1])]
