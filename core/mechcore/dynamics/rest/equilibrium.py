"""Equilibria: where a mechanism with free coordinates stays at rest, found from a start by Newton's method on the reduced force.

At rest (q' = 0) the reduced force Q(q) of all loads is what moves the mechanism; an equilibrium is a position with Q = 0, and
K = -dQ/dq is its stiffness. Descent needs no potential: a step is downhill if the work of Q along it, by Simpson's rule, is
positive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Real
from mechcore.constants import MOST_TURNS, TURN
from mechcore.dynamics.equations.charts import best_chart
from mechcore.dynamics.equations.reduced import coordinate_scales, free_of, motion_at, reduced_equations, tangents
from mechcore.dynamics.events import EndStop, with_slot_ends
from mechcore.effects.base import power_of
from mechcore.effects.registry import applied_effects, effects_of
from mechcore.errors import Fault, MechanismError
from mechcore.laws.timed import Free, Law
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism
from mechcore.records import dataclass
from mechcore.spec.clearance import journals_of
from mechcore.spec.loads import Bushing, Servo, Spring, TorsionSpring
from mechcore.spec.mechanism import Mechanism
from mechcore.texts import Text, as_coordinate, as_quantity

Seek = Literal["stable", "nearest"]
DIFFERENCE_STEP = 4e-3  # of a difference, relative to the scale: the error is of its sixth power
LONGEST_STEP = 0.3  # of Newton's method, relative to the scale
MOST_STEPS = 300  # of Newton's method
NODES = np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0])
DIFFERENCE_WEIGHTS = np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / 60.0  # central difference of sixth order


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A position in which the mechanism stays at rest.

    ``position`` (f,) of the free coordinates of ``compiled`` [rad or m]; ``stiffness`` K = -dQ/dq (f, f); ``residual``: the reduced
    force there, relative to the forces in balance; ``steps``: number of Newton steps.
    """

    compiled: Compiled
    position: Real
    stiffness: Real
    residual: float
    steps: int

    @property
    def joints(self) -> tuple[str, ...]:
        """The free coordinates' joints, in the order of ``position``."""
        return tuple(d.joint for d in self.compiled.mechanism.drives if isinstance(d.law, Free))

    @property
    def motion(self) -> Motion:
        """The mechanism at rest in the equilibrium (one frame)."""
        return self.motion_with(np.zeros_like(self.position))

    def motion_with(self, rates: Real) -> Motion:
        """The mechanism passing through the equilibrium with ``rates`` (f,) of its free coordinates (one frame)."""
        return motion_at(_still(self.compiled), self.position[None], rates[None], np.zeros(1))


@dataclass(frozen=True)
class _Held:
    """A prescribed drive, or the target of a servo, that stands still at its start."""

    start: float
    duration: float = 1.0
    breaks: tuple[float, ...] = ()

    def __call__(self, t: ArrayLike) -> tuple[Real, Real, Real]:
        none = np.zeros_like(np.asarray(t, float))
        return none + self.start, none, none


def _still(compiled: Compiled) -> Compiled:
    """The same mechanism with its prescribed drives, and the targets of its servos, held at their start; ``compiled`` itself where
    there are none."""
    mechanism = compiled.mechanism
    if all(isinstance(d.law, Free) for d in mechanism.drives) and not any(isinstance(x, Servo) for x in mechanism.loads):
        return compiled
    drives = tuple(d if isinstance(d.law, Free) else replace(d, law=_Held(_start(d.law))) for d in mechanism.drives)
    loads = tuple(replace(x, target=_Held(_start(x.target))) if isinstance(x, Servo) else x for x in mechanism.loads)
    return replace(compiled, model=replace(compiled.model, mechanism=replace(mechanism, drives=drives, loads=loads)))


def _start(law: Law) -> float:
    return float(law(np.zeros(1))[0][0])


def force_at_rest(compiled: Compiled, q: Real, v: Real | None = None, *, only: str = "positions") -> Real:
    """Reduced force Q (n, f) of all loads at positions (n, f) with rates (n, f), or at rest.

    ``only`` other than "positions": of the loads that need this, such as "velocities". Time is 0, and prescribed drives are held at
    their start. NaN where the mechanism cannot be assembled. Forces of inertia are left
    out: they are of the second order in the rates. So is dry friction.
    """
    return _forces(compiled, q, v, only)[0]


def _forces(compiled: Compiled, q: Real, v: Real | None = None, only: str = "positions") -> tuple[Real, Real]:
    """`force_at_rest`, and the sum of the absolute values of its parts (n, f)."""
    still = _still(compiled)
    n = len(q)
    motion = motion_at(still, q, np.zeros_like(q) if v is None else v, np.zeros(n))
    units = tangents(motion, free_of(still))
    force, size = np.zeros_like(q), np.zeros_like(q)
    for effect in effects_of(still.mechanism):
        if (only == "positions" or only in effect.needs) and not effect.needs & {"accelerations", "reactions"}:
            for w in effect.wrenches(motion):
                for i, unit in enumerate(units):
                    power = power_of(unit, w)
                    force[:, i] += power
                    size[:, i] += np.abs(power)
    return force, size


def slopes_at_rest(compiled: Compiled, q: Real) -> tuple[Real, Real, Real]:
    """Q (f,) at rest at position q (f,), its derivative by the position (f, f), and the size of its parts around there (f,); all
    from one set of positions, by central differences of sixth order."""
    scale, f = compiled.cached(coordinate_scales), len(q)
    shifts = (np.eye(f)[:, None, :] * NODES[None, :, None]).reshape(-1, f)
    force, size = _forces(compiled, np.vstack([q[None], q + DIFFERENCE_STEP * scale * shifts]))
    by_q = np.einsum("knj,n->jk", force[1:].reshape(f, len(NODES), f), DIFFERENCE_WEIGHTS) / (DIFFERENCE_STEP * scale)
    return force[0], by_q, size.max(axis=0)


def find_equilibrium(mechanism: Mechanism | Compiled, *, seek: Seek = "stable", stops: Sequence[EndStop] = ()) -> Equilibrium:
    """The equilibrium reached from the start of the free coordinates.

    ``seek`` "stable": go downhill from the start (an unstable equilibrium is found only if the mechanism starts exactly there);
    "nearest": plain Newton's method, which may lead to any equilibrium. Raises `MechanismError` where none is found, or where it
    lies beyond one of the ``stops``.
    """
    compiled = mechanism if isinstance(mechanism, Compiled) else compile_mechanism(mechanism)
    if not free_of(compiled):
        why = "every drive is prescribed: nothing is free to come to rest."
        raise MechanismError(Fault("joints", why, "Give a joint a free start instead of its drive."))
    loose = next(iter(journals_of(compiled.mechanism)), None)
    if loose is not None:  # its force has a kink at the clearance: differences over any step would mix flight and contact
        why = "a journal in its clearance has a stiffness only where it is pressed: nothing there is linear."
        raise MechanismError(Fault(f"joints.{loose}.clearance", why, "Leave out the clearance."))
    q = np.array([float(d.law(0.0)[0]) for d in compiled.mechanism.drives if isinstance(d.law, Free)])
    changed = 0
    for count in range(1, MOST_STEPS + 1):
        scale = compiled.cached(coordinate_scales)
        force, by_q, size = slopes_at_rest(compiled, q)
        if not np.isfinite(by_q).all():
            if len(q) > 1 or changed > 8:
                raise _lost(compiled, q)
            chart, place, _ = best_chart(compiled, float(q[0]), 0.0, [], 1e-9)  # another joint's coordinate leads past a dead point
            compiled, q, changed = chart.compiled, np.array([place]), changed + 1
            continue
        largest = float((size * scale).max()) or 1.0
        left = float(np.abs(force * scale).max()) / largest
        step = _newton(force * scale, -by_q * scale[:, None] * scale, seek) * scale
        if left <= 1e-13 or (left <= 1e-10 and float(np.abs(step / scale).max()) <= 1e-12):
            equilibrium = Equilibrium(compiled, q, -by_q, left, count)
            for effect in equilibrium.motion.model.cached(applied_effects):
                effect.check(equilibrium.motion)
            _within(equilibrium, with_slot_ends(compiled.mechanism, stops))
            return equilibrium
        q = _step(compiled, q, force, step, seek, largest)
    joint, k = _worst(compiled, force * scale)
    rotary = compiled.model.rotary(joint)
    raise MechanismError(
        Fault(
            "dynamics.equilibrium",
            f"none found from the start in {MOST_STEPS} steps: at {as_coordinate(q[k], rotary=rotary)} the loads still push "
            f"{joint} with {as_quantity(force[k], 'torque' if rotary else 'force')}.",
            "A load that always pushes the same way has no equilibrium: leave it out, or add what holds against it.",
        )
    )


def _newton(force: Real, stiffness: Real, seek: Seek) -> Real:
    """The Newton step: zero along directions without stiffness and force, and, unless ``seek`` is "nearest", downhill where the
    stiffness is negative."""
    if seek == "nearest" or not force.any():
        return np.asarray(np.linalg.lstsq(stiffness, force, rcond=1e-10)[0])
    values, vectors = np.linalg.eigh(0.5 * (stiffness + stiffness.T))
    if values[0] > 1e-9 * np.abs(values).max():
        return np.asarray(np.linalg.solve(stiffness, force), float)
    along = vectors.T @ force
    least = 1e-9 * np.abs(values).max() or 1.0
    sized = np.where(np.abs(along) <= 1e-10 * np.abs(along).max(), 0.0, along / np.maximum(np.abs(values), least))
    return np.asarray(vectors @ sized)


def _step(compiled: Compiled, q: Real, force: Real, step: Real, seek: Seek, largest: float) -> Real:
    """The position after a step, which is halved until the mechanism can be assembled and, in descent, until the forces do work
    along it."""
    scale = compiled.cached(coordinate_scales)
    length = float(np.abs(step / scale).max())
    step = step * min(1.0, LONGEST_STEP / length) if length else step
    for _ in range(40):
        middle, end = force_at_rest(compiled, np.array([q + 0.5 * step, q + step]))
        if np.isfinite(end).all() and np.isfinite(middle).all():
            work = float((force + 4.0 * middle + end) @ step) / 6.0
            improved = float(np.abs(end * scale).max()) <= 0.5 * float(np.abs(force * scale).max())
            if seek == "nearest" or work >= 0.0 or improved or abs(work) <= 1e-14 * largest:
                return np.asarray(q + step)
        elif len(q) == 1 and float(np.abs(step / scale).max()) < 1e-3:
            return np.asarray(q + step)  # a dead point of the coordinate: another joint takes over there
        step = 0.5 * step
    raise _lost(compiled, q)


def _worst(compiled: Compiled, pushes: Real) -> tuple[str, int]:
    k = int(np.argmax(np.abs(pushes)))
    return [d.joint for d in compiled.mechanism.drives if isinstance(d.law, Free)][k], k


def _lost(compiled: Compiled, q: Real) -> MechanismError:
    joints = [compiled.mechanism.drives[i].joint for i in free_of(compiled)]
    where = ", ".join(f"{p} at {as_coordinate(x, rotary=compiled.model.rotary(p))}" for p, x in zip(joints, q, strict=True))
    why = f"on the way downhill the mechanism cannot follow beyond {where}: a limit of its reach, or a dead point of a free joint."
    return MechanismError(Fault("dynamics.equilibrium", why, "Start nearer to the equilibrium, or make other joints free."))


def _within(equilibrium: Equilibrium, stops: Sequence[EndStop]) -> None:
    """Refuse an equilibrium that lies beyond a stop: the mechanism rests on the stop instead."""
    motion = equilibrium.motion
    known = dict(zip(equilibrium.joints, equilibrium.position, strict=True))
    for s in stops:
        at = known[s.joint] if s.joint in known else float(motion.coordinate(s.joint)[0, 0])
        beyond = (at - s.at) * (1.0 if s.side == "upper" else -1.0)
        if beyond > 1e-12 * equilibrium.compiled.model.coordinate_scale(s.joint):
            far = as_coordinate(beyond, rotary=equilibrium.compiled.model.rotary(s.joint))
            why = f"the equilibrium lies {far} beyond '{s.name}': the mechanism rests on this stop and does not vibrate freely."
            raise MechanismError(Fault(f"joints.{s.joint}.stops", why, "Move the stop, or leave it out."))


MANY_PERIODS = 1_000  # periods in a run above which a warning precedes it
DECAY_EXPONENT = 35.0  # exponent of decay after which a vibration is negligible
SLOW_RATE = 1e-3  # part of the vibration's speed at an amplitude of one: the rate at which damping is evaluated


@dataclass(frozen=True)
class FastestVibration:
    """The fastest small vibration about the start.

    ``frequency`` [Hz]; ``amplitude`` that forces and speeds at the start excite, relative to one radian or the mechanism's size;
    ``swing``: the same of the coordinate that moves most, in words; ``damping`` ratio; ``load``: name of the spring with the
    largest share in it, and its ``stiffness`` in words.
    """

    frequency: float
    amplitude: float
    swing: str
    damping: float
    load: str
    stiffness: str

    def periods(self, duration: float) -> float:
        """Number of periods that a run has to follow, until its end or until the vibration has decayed."""
        return self.frequency * min(duration, DECAY_EXPONENT / max(TURN * self.frequency * self.damping, 1e-300))

    def steps_over(self, duration: float, tolerance: float) -> bool:
        """Whether a run should step over it: it has many periods, and an amplitude within the tolerance or an early decay."""
        turns = self.frequency * duration
        return turns >= MANY_PERIODS and (self.amplitude <= tolerance or self.periods(duration) < 0.1 * turns)

    @property
    def stepped_over(self) -> str:
        """Note on a run that steps over it."""
        return (
            f"a vibration of {self.frequency:.4g} Hz with an amplitude of {self.swing}, of spring '{self.load}' with "
            f"{self.stiffness}, is not followed: accelerations and forces are those without it"
        )

    def words(self, duration: float) -> str:
        """What a run has to follow, in words."""
        return (
            f"{self.frequency:.4g} Hz is the fastest vibration, of spring '{self.load}' with {self.stiffness}: "
            f"{self.periods(duration):,.0f} periods in {duration:.6g} s"
        )


def difference_positions(compiled: Compiled, q: Real) -> Real:
    """Positions (n, f): q (f,) itself, then those beside it from which central differences by the free coordinates follow."""
    shifts = (np.eye(len(q))[:, None, :] * NODES[None, :, None]).reshape(-1, len(q))
    return np.vstack([q[None], q + DIFFERENCE_STEP * compiled.cached(coordinate_scales) * shifts])


def vibrations(compiled: Compiled, forces: Real, inertia: Real) -> tuple[Real, Real, Real] | None:
    """Squares of the natural frequencies (f,) [rad^2/s^2] in ascending order, shapes (f, f) in scales of the coordinates, and the
    stiffness (c, f, f) of each of the ``forces`` (c, n, f) at the `difference_positions` of a position. The last of the forces is
    the total one, which gives the frequencies. None where they cannot be found."""
    scale, f = compiled.cached(coordinate_scales), forces.shape[-1]
    by_q = np.einsum("cknj,n->cjk", forces[:, 1:].reshape(-1, f, len(NODES), f), DIFFERENCE_WEIGHTS) / (DIFFERENCE_STEP * scale)
    stiffness = -0.5 * (by_q + by_q.swapaxes(1, 2))
    both = scale[:, None] * scale
    if not (np.isfinite(stiffness).all() and np.isfinite(inertia).all()):
        return None
    if f == 1:
        mass = float(inertia[0, 0])
        return (stiffness[-1, 0] / mass, 1.0 / np.sqrt(inertia * both), stiffness) if mass > 0.0 else None
    try:
        white = np.linalg.inv(np.linalg.cholesky(inertia * both))
    except np.linalg.LinAlgError:  # something moves no mass
        return None
    squares, shapes = np.linalg.eigh(white @ (stiffness[-1] * both) @ white.T)
    return squares, white.T @ shapes, stiffness


def fastest_vibration(compiled: Compiled, q: Real, v: Real) -> FastestVibration | None:
    """The fastest vibration of a mechanism at q, v (f,), drives and time at their start; None where no spring makes it vibrate."""
    springs = [load for load in compiled.mechanism.loads if isinstance(load, Spring | TorsionSpring | Bushing)]
    if not springs or not len(q):
        return None
    scale, places = compiled.cached(coordinate_scales), difference_positions(compiled, q)
    motion = motion_at(compiled, places, np.zeros_like(places), np.zeros(len(places)))
    units = tangents(motion, free_of(compiled))
    at_rest = reduced_equations(motion, units)
    effects = {e.name: e for e in effects_of(compiled.mechanism)}
    parts = []
    for spring in springs:
        wrenches = effects[spring.name].wrenches(motion)
        parts.append(np.stack([sum(power_of(unit, w) for w in wrenches) * np.ones(len(places)) for unit in units], axis=1))
    forces = np.stack([*parts, at_rest.force - at_rest.bias])
    inertia = at_rest.inertia[0]
    modes = vibrations(compiled, forces, inertia)
    if modes is None or not modes[0][-1] > 0.0:
        return None
    squares, shapes, stiffness = modes
    omega, shape = float(np.sqrt(squares[-1])), scale * shapes[:, -1]
    shares = np.einsum("j,cjk,k->c", shape, stiffness[:-1], shape)
    spring = springs[int(np.argmax(shares))]
    if not shares.max() > 0.5 * squares[-1]:
        return None  # weights dominate, or springs that oppose each other
    rates = SLOW_RATE * omega * np.array([shape, -shape])
    passing = motion_at(compiled, np.repeat(q[None], 2, axis=0), rates, np.zeros(2))
    braking = reduced_equations(passing, tangents(passing, free_of(compiled)))
    brake = -float(shape @ (braking.force[0] - braking.force[1])) / (2.0 * SLOW_RATE * omega)
    modal = np.hypot(float(shape @ forces[-1, 0]) / omega**2, float(shape @ inertia @ v) / omega)
    most = int(np.argmax(np.abs(shapes[:, -1])))
    amplitude = float(modal * np.abs(shapes[most, -1]))
    rotary = compiled.model.rotary(compiled.mechanism.drives[free_of(compiled)[most]].joint)
    swing = as_coordinate(amplitude * scale[most], rotary=rotary, digits=2)
    return FastestVibration(omega / TURN, amplitude, swing, max(0.5 * brake / omega, 0.0), spring.name, _stiffness(spring))


def _stiffness(spring: Spring | TorsionSpring | Bushing) -> str:
    """A stiffness in words; of a bushing all three."""
    if isinstance(spring, Bushing):
        x, y, angle = spring.stiffness
        return f"{as_quantity(x, 'stiffness')}, {as_quantity(y, 'stiffness')} and {as_quantity(angle, 'torsional stiffness')}"
    return as_quantity(spring.stiffness, "torsional stiffness" if isinstance(spring, TorsionSpring) else "stiffness")


def check_periods(fastest: FastestVibration, duration: float, tolerance: float) -> Text | None:
    """Warning before a run over very many periods of its fastest vibration; None where there are fewer. Raises `MechanismError`
    beyond `MOST_TURNS` periods."""
    periods = fastest.periods(duration)
    if periods < MANY_PERIODS:
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
