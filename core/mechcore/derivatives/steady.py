"""Derivatives by parameters of motions that begin in a steady run, whose speed at the start depends on the parameters, too.

The steady run is periodic. Over a period a parameter changes position and speed by x and v, the speed at the start by X and V; a is
the acceleration there. The change s of that speed follows from the condition that the speed is the same where the position has
completed its turns, s = v + V s - (x + X s - x0) a / v0; the period changes by (x0 - x - X s) / v0. Frames of the same number are
compared: where the motion lasts for a period, their times scale with it, that is, the frames shift along the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from mechcore.arrays import Index, Real
from mechcore.derivatives.exact import Derivatives
from mechcore.derivatives.forced import PartUnderForces, derivatives_under_forces, start_derivatives
from mechcore.derivatives.model_numbers import Parameter
from mechcore.derivatives.phases import Changes
from mechcore.dynamics.rest.steady import SteadyRun
from mechcore.dynamics.simulate import simulate
from mechcore.dynamics.simulation import Simulation
from mechcore.laws.timed import Free
from mechcore.spec.mechanism import Mechanism

ANY_SPEED = 1e-9  # distance of the multiplier from 1 below which a disturbance does not decay: every speed is steady
WIDTH = 1e-3  # half width, relative to it, of the interval of speeds about that at the start


class SteadyPart(PartUnderForces):
    """Derivatives by parameters of a part of a motion that begins in a steady run.

    The parameters are followed by two more, the speed at the start and the time along the motion. ``speeds`` (P,): derivatives of
    the former by the parameters; ``later`` (P,): derivatives of the time of a frame, over that time.
    """

    def __init__(
        self,
        speeds: Real,
        later: Real,
        simulation: Simulation,
        changes: Changes,
        before: Sequence[tuple[Changes, Real]],
        times: Real,
    ):
        super().__init__(simulation, changes, before, times)
        self._speeds, self._later = speeds, later

    def of(self, *results: object) -> list[Real]:
        out = []
        for known in super().of(*results):
            own, speed, time = known[:-2], known[-2], known[-1]
            along = time * self.nominal.time.reshape(-1, *[1] * (time.ndim - 1))
            out.append(own + np.multiply.outer(self._speeds, speed) + np.multiply.outer(self._later, along))
        return out

    def adjoint(self, result: object, weights: Real) -> Real:
        known = super().adjoint(result, weights)
        times = self.nominal.time.reshape(-1, *[1] * (weights.ndim - 2))
        along = super().adjoint(result, weights * times)[:, -1]
        return np.asarray(known[:, :-2] + np.multiply.outer(known[:, -2], self._speeds) + np.multiply.outer(along, self._later))


def derivatives_from_steady_run(
    simulation: Simulation, steady: SteadyRun, parameters: Sequence[Parameter], times: Real, *, whole: bool
) -> list[tuple[Index, Derivatives]]:
    """Derivatives as of `derivatives_under_forces` of a motion that begins in a steady run; ``whole``: it lasts for a period, which
    depends on the parameters. Raises `MechanismError`."""
    place, speed, acceleration = (float(x[0, 0]) for x in simulation(np.zeros(1)))
    nominal = simulation.compiled.mechanism

    def started(mechanism: Mechanism, of_place: float | None = None, of_speed: float = speed) -> Mechanism:
        (drive,) = mechanism.drives
        law = drive.law
        assert isinstance(law, Free)
        return replace(mechanism, drives=(replace(drive, law=Free(law.start if of_place is None else of_place, of_speed)),))

    own = [replace(p, mechanism=partial(_composed, started, p)) for p in parameters]
    width = WIDTH * abs(speed)
    own += [
        Parameter("speed at the start", speed, width, lambda x: started(nominal, of_speed=x)),
        Parameter("time", 0.0, WIDTH / abs(speed), lambda x: started(nominal, place + speed * x, speed + acceleration * x)),
    ]
    cycle = simulation
    if simulation.duration < steady.period * (1.0 - 1e-12):
        cycle = simulate(simulation.compiled, steady.period, tolerance=simulation.tolerance)
    ((_, end),) = derivatives_under_forces(cycle, own, np.array([min(steady.period, cycle.duration)]))
    assert isinstance(end, PartUnderForces)
    (x, v), begin = end.moved[0], start_derivatives(simulation.compiled, own)[0]
    closing = (1.0 - v[-2]) + x[-2] * acceleration / speed
    speeds: Real = np.zeros(len(parameters))
    if abs(steady.multiplier - 1.0) > ANY_SPEED:
        speeds = (v[:-2] - (x[:-2] - begin[:-2]) * acceleration / speed) / closing
    later = (begin[:-2] - x[:-2] - x[-2] * speeds) / speed / steady.period
    return derivatives_under_forces(simulation, own, times, partial(SteadyPart, speeds, later if whole else np.zeros_like(later)))


def _composed(started: Any, parameter: Parameter, x: float) -> Mechanism:
    """The mechanism of a parameter, with the nominal speed at the start."""
    made: Mechanism = started(parameter.mechanism(x))
    return made
