"""Parameters that are zero at their stated value: a coefficient of friction, or the integral gain of a servo.

What such a number multiplies (an element of friction, the integral of an error) exists only beside the stated value. A number in
place of zero that is too small to change anything creates it, and the derivative is that at zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from typing import Any

from mechcore.derivatives.model_numbers import Parameter
from mechcore.dynamics.equations.reduced import integrating
from mechcore.dynamics.simulate import simulate
from mechcore.dynamics.simulation import Simulation
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism
from mechcore.records import NumberPlace, with_numbers
from mechcore.spec.loads import Servo
from mechcore.spec.mechanism import Mechanism

NEXT_TO_ZERO = 1e-300


def with_friction(motion: Motion, varied: Iterable[NumberPlace]) -> Motion:
    """The motion, with elements of friction also where varied numbers of it, at places ("joints", i, "friction", ...), are zero."""
    mechanism = motion.mechanism
    zero = {place: NEXT_TO_ZERO for place in varied if place[2:3] == ("friction",) and _number(mechanism, place) == 0.0}
    if not zero:
        return motion
    other = copy(motion)
    other.model = replace(motion.model, mechanism=with_numbers(mechanism, zero))
    return other


def _number(thing: Any, place: NumberPlace) -> float:
    for name in place:
        thing = thing[name] if isinstance(name, int) else getattr(thing, name)
    return float(thing)


def with_integrals(simulation: Simulation, parameters: Sequence[Parameter]) -> tuple[Simulation, list[Parameter]]:
    """The motion and the parameters. Where servos have an integral part only beside the parameters' values, the motion is simulated
    again with their integrals, and the parameters' mechanisms have them, too. Raises `MechanismError`."""
    compiled = simulation.compiled
    kept = {e.name for e in integrating(compiled)}
    beside = [compile_mechanism(p.beside(), compiled.accuracy) for p in parameters]
    new = {e.name for other in beside for e in integrating(other)} - kept
    if not new:
        return simulation, list(parameters)

    def integrated(mechanism: Mechanism) -> Mechanism:
        loads = (
            replace(x, integral=NEXT_TO_ZERO) if isinstance(x, Servo) and x.name in new and x.integral == 0.0 else x
            for x in mechanism.loads
        )
        return replace(mechanism, loads=tuple(loads))

    made = simulate(
        compile_mechanism(integrated(compiled.mechanism), compiled.accuracy),
        simulation.duration,
        tolerance=simulation.tolerance,
        stops=simulation.stops,
        separable_cams=simulation.separable_cams,
    )
    return made, [replace(p, mechanism=partial(_composed, integrated, p.mechanism)) for p in parameters]


def _composed(outer: Callable[[Mechanism], Mechanism], inner: Callable[[float], Mechanism], x: float) -> Mechanism:
    return outer(inner(x))
