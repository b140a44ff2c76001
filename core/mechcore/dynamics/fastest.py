"""The fastest vibration that springs give a mechanism with free coordinates, looked up before its motion is found.

Linearised about the start, M d'' + K d = 0 with K = -dQ/dq of the reduced force at rest (see `vibrations`): the largest natural
frequency says how many periods a run has to follow, the forces and speeds at the start how large that vibration is. What is far
smaller than the tolerance need not be followed: an L-stable rule steps over it to the equilibrium that the slow motion has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ..effects import effects_of, power_of
from ..errors import Fault, MechanismError
from ..loads import Bushing, Spring, TorsionSpring
from ..solve import MOST_TURNS, Compiled
from ..texts import Text, as_coordinate, as_quantity
from .equilibrium import NODES, STEP, WEIGHTS, scale_of
from .reduced import free_of, motion_at, reduced_equations, tangents

__all__ = ["Fastest", "check_periods", "fastest_vibration"]

Array = NDArray[np.float64]
TURN = 2.0 * np.pi
TOLD = 1_000  # periods in a run, from which on it is said before the work begins
DECAYED = 35.0  # exponent of decay, after which nothing is left of a vibration
SLOW = 1e-3  # of the vibration's own speed at an amplitude of one: the rate at which damping is looked up


@dataclass(frozen=True)
class Fastest:
    """The fastest small vibration about the start.

    ``frequency`` [Hz]; ``amplitude`` at which forces and speeds at the start set it going, relative to one radian or the
    mechanism's size, and as a ``swing`` of the coordinate that moves most, in words; ``damping`` ratio; ``load``: the spring that
    has the largest share in it, by name, and its ``stiffness`` in words.
    """

    frequency: float
    amplitude: float
    swing: str
    damping: float
    load: str
    stiffness: str

    def periods(self, duration: float) -> float:
        """How many periods a run has to follow until its end or until they have died away."""
        return self.frequency * min(duration, DECAYED / max(TURN * self.frequency * self.damping, 1e-300))

    def steps_over(self, duration: float, tolerance: float) -> bool:
        """Whether a run does well not to follow it, because nothing of it is seen, or because it has soon died away."""
        turns = self.frequency * duration
        return turns >= TOLD and (self.amplitude <= tolerance or self.periods(duration) < 0.1 * turns)

    @property
    def stepped_over(self) -> str:
        """What is said of a run that does without it."""
        return (
            f"a vibration of {self.frequency:.4g} Hz with an amplitude of {self.swing}, of spring '{self.load}' with "
            f"{self.stiffness}, is not followed: accelerations and forces are those without it"
        )

    def words(self, duration: float) -> str:
        """What a run has before it."""
        return (
            f"{self.frequency:.4g} Hz is the fastest vibration, of spring '{self.load}' with {self.stiffness}: "
            f"{self.periods(duration):,.0f} periods in {duration:.6g} s"
        )


def fastest_vibration(compiled: Compiled, q: Array, v: Array) -> Fastest | None:
    """The fastest vibration of a mechanism at q, v (f,), drives and time at their start; None where no spring makes it vibrate."""
    springs = [load for load in compiled.mechanism.loads if isinstance(load, Spring | TorsionSpring | Bushing)]
    if not springs or not len(q):
        return None
    scale, f = scale_of(compiled), len(q)
    shifts = (np.eye(f)[:, None, :] * NODES[None, :, None]).reshape(-1, f)
    places = np.vstack([q[None], q + STEP * scale * shifts])
    motion = motion_at(compiled, places, np.zeros_like(places), np.zeros(len(places)))
    units = tangents(motion, free_of(compiled))
    at_rest = reduced_equations(motion, units)
    effects = {e.name: e for e in effects_of(compiled.mechanism)}
    parts = []
    for spring in springs:
        wrenches = effects[spring.name].wrenches(motion)
        parts.append(np.stack([sum(power_of(unit, w) for w in wrenches) * np.ones(len(places)) for unit in units], axis=1))
    forces = np.stack([*parts, at_rest.force - at_rest.bias])
    by_q = np.einsum("cknj,n->cjk", forces[:, 1:].reshape(-1, f, len(NODES), f), WEIGHTS) / (STEP * scale)
    stiffness = -0.5 * (by_q + by_q.swapaxes(1, 2))
    inertia, both = at_rest.inertia[0], scale[:, None] * scale
    if not (np.isfinite(stiffness).all() and np.linalg.eigvalsh(inertia * both)[0] > 0.0):
        return None
    squares, shapes = scipy.linalg.eigh(stiffness[-1] * both, inertia * both)
    if not squares[-1] > 0.0:
        return None
    omega, shape = float(np.sqrt(squares[-1])), scale * shapes[:, -1]
    shares = np.einsum("j,cjk,k->c", shape, stiffness[:-1], shape)
    spring = springs[int(np.argmax(shares))]
    if not shares.max() > 0.5 * squares[-1]:
        return None  # weights, or springs that hold each other
    rates = SLOW * omega * np.array([shape, -shape])
    passing = motion_at(compiled, np.repeat(q[None], 2, axis=0), rates, np.zeros(2))
    braking = reduced_equations(passing, tangents(passing, free_of(compiled)))
    brake = -float(shape @ (braking.force[0] - braking.force[1])) / (2.0 * SLOW * omega)
    modal = np.hypot(float(shape @ forces[-1, 0]) / omega**2, float(shape @ inertia @ v) / omega)
    most = int(np.argmax(np.abs(shapes[:, -1])))
    amplitude = float(modal * np.abs(shapes[most, -1]))
    rotary = compiled.model.rotary(compiled.mechanism.drives[free_of(compiled)[most]].pair)
    swing = as_coordinate(amplitude * scale[most], rotary=rotary, digits=2)
    return Fastest(omega / TURN, amplitude, swing, max(0.5 * brake / omega, 0.0), spring.name, _stiffness(spring))


def _stiffness(spring: Spring | TorsionSpring | Bushing) -> str:
    """A stiffness as a part of a text; of a bushing all three."""
    if isinstance(spring, Bushing):
        x, y, angle = spring.stiffness
        return f"{as_quantity(x, 'stiffness')}, {as_quantity(y, 'stiffness')} and {as_quantity(angle, 'torsional stiffness')}"
    return as_quantity(spring.stiffness, "torsional stiffness" if isinstance(spring, TorsionSpring) else "stiffness")


def check_periods(fastest: Fastest, duration: float, tolerance: float) -> Text | None:
    """What to tell before a run that has to follow its fastest vibration; None where that is quickly done. Raises `MechanismError`
    where nobody would wait for it."""
    periods = fastest.periods(duration)
    if periods < TOLD:
        return None
    words = fastest.words(duration)
    if periods <= MOST_TURNS:
        return Text(f"{words}; following them takes a while.")
    remedy = f"Take a softer spring or a rigid link instead, or run at most {MOST_TURNS / fastest.frequency:.3g} s"
    if 1e-15 < fastest.amplitude < 0.02:
        larger = float(f"{2.0 * max(fastest.amplitude, tolerance):.1e}")
        remedy += f'; with tolerance = {larger:g} and method = "radau" it is stepped over: its amplitude is {fastest.swing}'
    raise MechanismError(
        Fault(f"loads.{fastest.load}.stiffness", f"{words}; motions are followed over {MOST_TURNS:,} at most.", f"{remedy}.")
    )
