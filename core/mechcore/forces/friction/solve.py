"""Dry friction in joints: reactions and friction that depend on each other, solved together for all frames.

Friction puts a wrench on the two links of a joint, against their relative motion and in proportion to what presses on the joint;
that again depends on all friction. `elements` says where friction acts, `response` what a unit of it does, `fixedpoint` finds the
loads or that there are none (the mechanism jams), `result` holds what comes out, `events` says when it changes.

At rest, where the relative speed of a joint is zero, its friction is undetermined between two limits: zero stands for it, the
middle
of the two-sided limit where the motion reverses. At a jam all forces of the frame are NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mechcore.effects.base import Wrench
from mechcore.errors import Fault, MechanismError
from mechcore.forces.equilibrium import transmit
from mechcore.forces.friction.elements import elements_of, two_sided
from mechcore.forces.friction.elements_response import respond, system
from mechcore.forces.friction.normal_loads import solve_normal_loads
from mechcore.forces.friction.result import FrictionResult
from mechcore.motion.motion import Motion
from mechcore.motion.redundancy import indeterminate
from mechcore.spec.mechanism import Revolute, braked, friction_of

Array = Any
FLANKS = 8  # rounds in which the flanks of gears may change sides


def solve_friction(
    motion: Motion, applied: Sequence[Wrench], force: Sequence[Array], moment: Sequence[Array]
) -> tuple[Any, Any, FrictionResult]:
    """What joints transmit, what relations transmit (as `mechcore.forces.equilibrium.transmit` gives them), and the friction.

    ``force`` and ``moment`` are what loads put on the links. Raises `MechanismError` where statics leaves the normal load of a
    joint
    with friction undetermined.
    """
    _check(motion)
    _refuse_indeterminate(motion)
    flanks = transmit(motion, force, moment)[2] if two_sided(motion) else None
    elements = elements_of(motion, flanks)
    for _ in range(FLANKS):
        response = respond(motion, elements, force, moment, flanks)
        before = response.base[2] if flanks is None else flanks
        solution = solve_normal_loads(*system(motion, elements, response), motion.accuracy.friction)
        friction = FrictionResult(motion, applied, elements, response, solution)
        own_force, own_moment = list(force), list(moment)
        for i, element in enumerate(elements):
            element.load(motion, own_force, own_moment, np.nan_to_num(friction.value(i)))
        transmitted, contacts, after = transmit(motion, own_force, own_moment, before)
        if all(np.all((after[r] < 0.0) == (before[r] < 0.0)) for r in after):
            break
        flanks = after
        elements = elements_of(motion, flanks) if two_sided(motion) else elements
    if friction.jammed.any():
        gap = np.where(friction.jammed, np.nan, 1.0)
        transmitted = [(f * gap, c * gap) for f, c in transmitted]
        contacts = {name: (place, f * gap) for name, (place, f) in contacts.items()}
    return transmitted, contacts, friction


def _check(motion: Motion) -> None:
    """Numbers that are no friction, where specs are made without a scene."""
    faults = []
    for joint in motion.mechanism.joints:
        f = friction_of(joint)
        if f is None:
            continue
        path = f"joints.{joint.name}.friction"
        for name in ("coefficient", "radius", "length", "height", "lever", "brake"):
            value = getattr(f, name)
            if not 0.0 <= value < np.inf:
                faults.append(Fault(path, f"{name} = {value:g} is no {name}.", "Give a finite number of zero or more."))
        if isinstance(joint, Revolute) and f.coefficient and f.radius == 0.0:
            faults.append(Fault(path, "the pin has no radius, at which friction acts.", "Give radius = ..., or no coefficient."))
    if faults:
        raise MechanismError(faults)


def _refuse_indeterminate(motion: Motion) -> None:
    """Redundant constraints share the load between joints in a way that rigid links do not tell, and friction depends on it."""
    if not motion.model.redundant:
        return
    loose = [p for p in indeterminate(motion) if p in braked(motion.mechanism.joints)]
    if loose:
        names = ", ".join(loose)
        why = f"constraints are redundant: statics does not tell what presses on {names}, and so not the friction there."
        remedy = "Leave out the friction of these joints, or the constraint that is left over."
        raise MechanismError([Fault(f"joints.{loose[0]}.friction", why, remedy)])
