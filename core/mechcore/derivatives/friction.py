"""Dry friction on a tape: normal loads and forces of friction as functions of the variables of a traced motion.

The normal loads solve equations of their own. By the Jacobian of the nominal solution they enter the tape as an implicit function,
without the iteration that found them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.effects.base import Wrench
from mechcore.effects.registry import totals
from mechcore.forces.equilibrium import joint_forces
from mechcore.forces.friction.elements import Element, elements_of, two_sided
from mechcore.forces.friction.solve import FrictionResult
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.motion.motion import Motion
from mechcore.numerics.tape import Tape, Traced, Untraced, regular_inverses, value_of

MOST_TRIES = 5  # iterations for the sides on which gears and belts carry: each may change those of others


def forces_with_friction(
    tape: Tape, nominal: Motion, motion: Motion, applied: Sequence[Wrench], force: Sequence[Any], moment: Sequence[Any]
) -> Forces:
    """Forces with dry friction of a ``motion`` on a tape, whose values are those of the ``nominal`` one.

    ``applied``: the wrenches without friction; ``force`` (F,) [N] and ``moment`` (F,) [N m]: their sums at each link. Raises
    `Untraced` where friction decides on which side a gear or belt carries.
    """
    plain_forces = solve_forces(nominal)
    known = plain_forces.friction
    assert known is not None
    flanks = _flanks(nominal, known)
    elements = elements_of(motion, flanks) if two_sided(motion) else elements_of(motion)

    def transmitted(loads: Sequence[Any]) -> tuple[Any, Any]:
        own_force, own_moment = list(force), list(moment)
        for element, load in zip(elements, loads, strict=True):
            element.load(motion, own_force, own_moment, -element.sign * element.factor * load)
        return joint_forces(motion, own_force, own_moment, flanks)[:2]

    plain = [np.nan_to_num(known.loads[:, i]) for i in range(len(elements))]
    through = transmitted(plain)
    left = []
    for element, load in zip(elements, plain, strict=True):
        p, q = element.normal(motion, *through, element.sign)
        left.append(load - (np.hypot(p, q) if element.euclidean else np.maximum(np.abs(p), np.abs(q))))
    if any(isinstance(x, Traced) for x in left):
        slopes = known.slopes
        changes: list[Any] = list(tape.implicit(left, slopes, regular_inverses(slopes)))
    else:
        changes = [0.0] * len(elements)
    loads = [load + change for load, change in zip(plain, changes, strict=True)]
    values = [-e.sign * e.factor * load for e, load in zip(elements, loads, strict=True)]
    solved = Forces(motion, applied, *transmitted(loads), TracedFriction(motion, applied, elements, values, known.jammed))
    joints = [c.name for c in motion.model.connections]
    largest = max(float(np.nanmax(np.abs(plain_forces.reaction(joint)), initial=0.0)) for joint in joints)
    for joint in joints:
        ours, theirs = value_of(solved.reaction(joint)), plain_forces.reaction(joint)
        if not np.allclose(ours, theirs, rtol=1e-6, atol=1e-6 * largest, equal_nan=True):
            sided = ", ".join(motion.model.relations[r].name for r in flanks)
            raise Untraced(f"friction decides which flank of a gear, or which span of a belt, carries at {sided or joint}")
    return solved


class TracedFriction(FrictionResult):
    """Friction whose ``values``, along the elements' unit wrenches, may be on a tape."""

    def __init__(
        self, motion: Motion, applied: Sequence[Wrench], elements: Sequence[Element], values: Sequence[Any], jammed: Flags
    ):
        self.motion, self.elements, self._applied = motion, tuple(elements), tuple(applied)
        self.jammed = jammed
        self._values = values

    def value(self, i: int) -> Any:
        return self._values[i]

    def wrench(self, joint: str) -> Any:
        if any(e.joint == joint and e.kind == "guide" and e.friction.height for e in self.elements):
            raise Untraced(f"friction acts on the two faces of the guide {joint}")
        return self.applied(joint)


def _flanks(nominal: Motion, known: FrictionResult) -> dict[int, Real]:
    """The side on which each relation carries (F,), +1 or -1, under the known friction: by iteration from the sides without
    friction."""
    force, moment, _ = totals(nominal)
    own_force, own_moment = list(force), list(moment)
    flanks = _signs(joint_forces(nominal, list(force), list(moment))[2])
    for i, element in enumerate(known.elements):
        element.load(nominal, own_force, own_moment, -element.sign * element.factor * np.nan_to_num(known.loads[:, i]))
    for _ in range(MOST_TRIES):
        turned = _signs(joint_forces(nominal, list(own_force), list(own_moment), flanks)[2])
        if all(np.array_equal(turned[r], flanks[r]) for r in flanks):
            break
        flanks = turned
    return flanks


def _signs(multipliers: Mapping[int, Any]) -> dict[int, Real]:
    return {r: np.where(value_of(m) >= 0.0, 1.0, -1.0) for r, m in multipliers.items()}
