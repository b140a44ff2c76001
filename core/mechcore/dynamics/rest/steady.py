"""Steady running of a machine of one freedom, found directly as the periodic solution for its speed over a cycle.

With w = v^2 / 2 the equation of motion is dw/dx = q''(x, v) with the displacement x of the free coordinate, and a steady run is a
solution with the period of one cycle. It is collocated on panels over the cycle (Gauss nodes); Newton's method condenses every
panel to an affine map of w, whose product over the cycle is the multiplier by which a disturbance of w shrinks from cycle to cycle
(Floquet).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike

from mechcore.arrays import Real, numbers
from mechcore.constants import TURN
from mechcore.dynamics.contact.dry_friction import DrySystem
from mechcore.dynamics.contact.friction_state import braking_elements
from mechcore.dynamics.equations.charts import Chart
from mechcore.dynamics.equations.reduced import motion_at, moving, reduce
from mechcore.dynamics.integration.collocation import gauss, integrals
from mechcore.effects.registry import effects_of
from mechcore.errors import Fault, MechanismError
from mechcore.forces.friction.elements import elements_of
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.forces.recurrence import MOST_CYCLES, check_back
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.records import dataclass
from mechcore.spec.mechanism import Link, Mechanism
from mechcore.texts import as_angle, as_quantity, as_torque

PANEL_NODES = 12
FIRST_PANELS = 16  # panels per turn
MOST_PANELS = 4096
RULE = gauss(PANEL_NODES)
WEIGHTS = RULE.legendre[0]
DIFFERENCE_STEP = 1e-6
SAMPLES_A_TURN = 192  # samples per turn by which breakpoints of forces are found
SPEEDS = np.geomspace(1e-2, 1e4, 49)  # [rad/s] at which the mean torque is evaluated


@dataclass(frozen=True, eq=False)
class SteadyRun:
    """A steady run over ``turns`` turns of the free joint from ``start`` [rad] in the ``sense`` 1 or -1.

    ``period`` [s]; ``mean`` speed over time, ``least`` and ``greatest`` [rad/s], all positive; ``multiplier``: the part of a small
    disturbance of the energy that is left after a cycle, 1 where nothing depends on the speed. Call it with displacements (n,)
    [rad] from the start for the speeds there [rad/s].
    """

    compiled: Compiled
    joint: str
    start: float
    sense: float
    turns: int
    edges: Real
    w: Real  # at the panels' starts
    slopes: Real  # (p, PANEL_NODES): Legendre coefficients of dw/dx
    period: float
    multiplier: float
    least: float
    greatest: float

    @property
    def mean(self) -> float:
        return self.turns * TURN / self.period

    @property
    def fluctuation(self) -> float:
        """Coefficient of fluctuation (greatest - least) / mean."""
        return (self.greatest - self.least) / self.mean

    @property
    def speed(self) -> float:
        """Speed at the start, with its sign [rad/s]."""
        return self.sense * float(np.sqrt(2.0 * self.w[0]))

    def __call__(self, x: ArrayLike) -> Real:
        at: Real = np.mod(numbers(x), self.edges[-1])
        k = np.clip(np.searchsorted(self.edges, at, side="right") - 1, 0, len(self.w) - 1)
        h = np.diff(self.edges)[k]
        first, _ = integrals(PANEL_NODES, (at - self.edges[k]) / h)
        return np.asarray(np.sqrt(2.0 * (self.w[k] + h * np.einsum("ns,ns->n", first, self.slopes[k]))))


def steady_run(mechanism: Mechanism | Compiled, *, turns: int = 1, tolerance: float = 1e-10) -> SteadyRun:
    """The steady run of a machine whose only free coordinate turns; the cycle is ``turns`` turns of it.

    The sense and the first guess of the speed are the free joint's ``speed``, where it has one. Where nothing depends on the speed
    every speed is steady, and the stated one is taken. Raises `MechanismError` where there is none.
    """
    compiled = mechanism if isinstance(mechanism, Compiled) else compile_mechanism(mechanism)
    joint, start, speed = _validated(compiled, turns)
    sense = -1.0 if speed < 0.0 else 1.0
    span = turns * TURN
    if compiled.mechanism.ends:  # a turn beyond the ends of slots or guides is refused
        x = np.linspace(0.0, span, 720 * turns + 1)
        solve_motion(compiled, x, drives={joint: (start + sense * x, np.full_like(x, sense), np.zeros_like(x))})
    _check_back(compiled, start, speed, turns)
    machine = _Machine(compiled, start, sense)
    level = _balance(machine, span, abs(speed))
    edges = _cut(np.linspace(0.0, span, FIRST_PANELS * turns + 1), machine, lambda x: np.full(len(x), level))
    w: Real = np.full((len(edges) - 1, PANEL_NODES), 0.5 * level**2)
    for again in range(12):
        begins, w, slopes, multiplier = _solve(machine, edges, w, level)
        coefficients = slopes @ RULE.legendre.T
        h = np.diff(edges)
        poor = h * np.abs(coefficients[:, -2:]).max(axis=1) > tolerance * begins.max()
        run = _run(compiled, joint, start, sense, turns, edges, begins, coefficients, w, multiplier)
        more = edges if again else _cut(edges, machine, run)
        if (again and not poor.any()) or len(edges) > MOST_PANELS:
            return run
        edges = np.unique(np.concatenate([more, 0.5 * (edges[:-1] + edges[1:])[poor]]))
        x = edges[:-1, None] + np.diff(edges)[:, None] * RULE.nodes
        w = np.reshape(0.5 * run(x.ravel()) ** 2, x.shape)
    return run


def _validated(compiled: Compiled, turns: int) -> tuple[str, float, float]:
    mechanism, model = compiled.mechanism, compiled.model
    faults = []
    drives = mechanism.drives
    rotary = len(drives) == 1 and isinstance(drives[0].law, Free)
    rotary = rotary and model.joints[model.joint_index[drives[0].joint]].coordinate == "angle"
    if not rotary:
        faults.append(Fault("joints", "a steady run needs one free joint that turns, and no drive.", "Let the crank be free."))
    if turns < 1:
        faults.append(Fault("run.steady", f"a cycle of {turns} turns.", "Give 1, or 2 for a four-stroke engine."))
    if "inertia" not in mechanism.effects:
        faults.append(Fault("effects", "a steady run needs masses, and inertia is not named.", 'Add "inertia" to effects.'))
    for e in effects_of(mechanism):
        if "time" in e.needs:
            faults.append(
                Fault(f"loads.{e.name}", "it depends on time, a steady run on the position and the speed.", "Leave it out.")
            )
    if faults:
        raise MechanismError(faults)
    law = drives[0].law
    assert isinstance(law, Free)
    return drives[0].joint, law.start, law.speed


def _check_back(compiled: Compiled, start: float, speed: float, turns: int) -> None:
    """Refuse a number of turns that is no cycle of the machine, at the stated speed, or at 10 rad/s where none is stated."""
    rate = speed or 10.0

    def forces(x: Real) -> Forces:
        q = (start + np.sign(rate) * x)[:, None]
        return solve_forces(motion_at(compiled, q, np.full_like(q, rate), np.zeros_like(x)))

    def fault(words: str, cycle: int | None) -> Fault:
        why = f"after {turns} turn{'s' * (turns > 1)} {words} is not as it was at the start: that is no cycle of the machine."
        if cycle is None:
            return Fault("run.steady", why, f"No number of turns up to {MOST_CYCLES} is one: change the ratios of its gears.")
        return Fault("run.steady", why, f"Give {cycle} turns: steady = {cycle} in [run], or mechviz forces --steady {cycle}.")

    check_back(forces, turns * TURN, TURN, fault)


class _Machine:
    """dw/dx and its derivative by w at displacements and speeds, and the forms that the laws of the forces have there."""

    def __init__(self, compiled: Compiled, start: float, sense: float):
        self.compiled, self.start, self.sense = compiled, start, sense
        self.piecewise = [e for e in effects_of(compiled.mechanism) if e.piecewise]
        self.rubs = bool(braking_elements(compiled, np.array([start]), np.array([sense])))

    def rows(self, x: Real, v: Real) -> tuple[Real, Real, Real]:
        return (self.start + self.sense * x)[:, None], (self.sense * v)[:, None], np.zeros(len(x))

    def signs(self, x: Real) -> Real:
        """Signs of the relative speeds of the friction elements (n, e)."""
        motion = moving(self.compiled, *self.rows(x, np.ones(len(x))))[0]
        return np.stack([np.broadcast_to(np.sign(e.rate), x.shape) for e in elements_of(motion)], axis=1)

    def slope(self, x: Real, v: Real) -> Real:
        """dw/dx = q'' (n,), in the sense of the motion."""
        q, rate, t = self.rows(x, v)
        if not self.rubs:
            return np.asarray(self.sense * Chart(self.compiled)(q, rate, t)[:, 0])
        out = np.empty(len(x))
        patterns, which = np.unique(self.signs(x), axis=0, return_inverse=True)
        for k, signs in enumerate(patterns):
            some = np.flatnonzero(which.ravel() == k)
            out[some] = DrySystem(self.compiled, signs)(q[some], rate[some], t[some])[:, 0]
        return self.sense * out

    def linear(self, x: Real, w: Real) -> tuple[Real, Real]:
        """dw/dx (n,) and its derivative by w."""
        v = np.sqrt(2.0 * w)
        step = DIFFERENCE_STEP * float(v.max())
        slopes = self.slope(np.concatenate([x, x, x]), np.concatenate([v, v + step, v - step])).reshape(3, -1)
        return slopes[0], (slopes[1] - slopes[2]) / (2.0 * step * v)

    def forms(self, x: Real, v: Real) -> Real:
        """Numbers of the forms that the laws of the forces have (m, n)."""
        forms: list[Any] = []
        if self.piecewise:
            motion = motion_at(self.compiled, *self.rows(x, v))
            forms += [np.broadcast_to(e.phase(motion), x.shape) for e in self.piecewise]
        if self.rubs:
            forms += list(self.signs(x).T)
        return np.array(forms).reshape(len(forms), len(x))


def _balance(machine: _Machine, span: float, wanted: float) -> float:
    """Speed [rad/s] at which the mean torque over the cycle vanishes and above which it brakes: the one nearest to ``wanted``, or
    the highest where that is 0."""
    count = int(48 * span / TURN)
    x = span * (np.arange(count) + 0.37) / count
    inertia = reduce(machine.compiled, *machine.rows(x, np.ones(count))).inertia[:, 0, 0]

    def mean(speeds: Real) -> tuple[Real, Real]:
        """Means over the cycle of the torque and of its absolute value, for each speed."""
        slope = machine.slope(np.tile(x, len(speeds)), np.repeat(speeds, count)).reshape(len(speeds), -1)
        return (inertia * slope).mean(axis=1), np.abs(inertia * slope).mean(axis=1)

    speeds = np.unique(np.append(SPEEDS, wanted)) if wanted else SPEEDS
    torque, size = mean(speeds)
    falls = np.flatnonzero((torque[:-1] > 0.0) & (torque[1:] <= 0.0))
    slow = speeds <= 10.0 * max(wanted, 1.0)  # at higher speeds inertia alone counts, whose mean is rounding
    if np.abs(torque[slow]).max() <= 1e-9 * size[slow].max() and wanted:
        return wanted
    if not len(falls):
        k = int(np.argmax(torque))
        why = "the forces drive more than they brake at every speed" if torque[-1] > 0.0 else "the forces brake at every speed"
        raise MechanismError(
            Fault(
                "run.steady",
                f"{why} (mean torque {as_torque(torque[k], 4)} at {as_quantity(speeds[k], 'angular speed', 4)}): there is no "
                "steady run.",
                "Check the motor and the loads; the free joint's speed says in which sense it runs.",
            )
        )
    level = speeds[falls]
    k = int(falls[np.argmin(np.abs(np.log(level / wanted)))] if wanted else falls[-1])
    low, high = float(speeds[k]), float(speeds[k + 1])
    for _ in range(4):
        inner = np.linspace(low, high, 9)
        torque, _ = mean(inner)
        k = max(int(np.argmax(torque <= 0.0)), 1)
        low, high = float(inner[k - 1]), float(inner[k])
    return 0.5 * (low + high)


def _cut(edges: Real, machine: _Machine, speed: Callable[[Real], Real]) -> Real:
    """Edges of the panels, with those positions added at which the law of some force changes its form."""
    if not machine.piecewise and not machine.rubs:
        return edges
    span = float(edges[-1])
    x = span * (np.arange(int(SAMPLES_A_TURN * span / TURN) + 1)) / int(SAMPLES_A_TURN * span / TURN)
    forms = machine.forms(x, speed(x))
    k = np.flatnonzero((forms[:, 1:] != forms[:, :-1]).any(axis=0))
    low, high = x[k], x[k + 1]
    before = forms[:, k]
    for _ in range(48):
        if not len(k):
            break
        middle = 0.5 * (low + high)
        same = (machine.forms(middle, speed(middle)) == before).all(axis=0)
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    borders = np.concatenate([edges, high])
    borders.sort()
    keep = np.append(np.diff(borders) > 1e-9 * span, True)
    keep[0] = True
    out = borders[keep]
    out[0], out[-1] = 0.0, span
    return np.asarray(out)


def _solve(machine: _Machine, edges: Real, w: Real, level: float) -> tuple[Real, Real, Real, float]:
    """w at the panels' starts (p,), at the nodes (p, s), dw/dx at the nodes, and the multiplier."""
    h = np.diff(edges)
    x = edges[:-1, None] + h[:, None] * RULE.nodes
    identity = np.eye(PANEL_NODES)
    for _ in range(40):
        f, by_w = (y.reshape(x.shape) for y in machine.linear(x.ravel(), w.ravel()))
        matrix = identity - h[:, None, None] * by_w[:, :, None] * RULE.integral
        right = np.stack([f - by_w * w, by_w], axis=-1)
        alpha, beta = np.moveaxis(np.linalg.solve(matrix, right), -1, 0)
        grow, add = 1.0 + h * (beta @ WEIGHTS), h * (alpha @ WEIGHTS)
        product, total = 1.0, 0.0
        for g, c in zip(grow, add, strict=True):
            product, total = g * product, g * total + c
        free = abs(1.0 - product) <= 1e-9
        if free and abs(total) > 1e-7 * float(np.abs(add).sum() + w.max()):
            raise MechanismError(
                Fault("run.steady", "no force depends on the speed, and a cycle gains or loses energy.", "Add a motor or a brake.")
            )
        begins = np.empty(len(h))
        begins[0] = 0.5 * level**2 if free else total / (1.0 - product)
        for k in range(len(h) - 1):
            begins[k + 1] = grow[k] * begins[k] + add[k]
        slopes = alpha + beta * begins[:, None]
        new = begins[:, None] + h[:, None] * (slopes @ RULE.integral.T)
        worst = float(new.min())
        if worst <= 0.0:  # a step reduces w to a tenth at most
            share = 0.9 * float(np.min(np.where(new < 0.1 * w, w / np.maximum(w - new, 1e-300), 1.0)))
            if share < 1e-6:
                break
            w = w + share * (new - w)
            continue
        change = float(np.abs(new - w).max())
        w = new
        if change <= 1e-12 * float(w.max()):
            return begins, w, slopes, product
    place = machine.start + machine.sense * float(x.ravel()[np.argmin(w)])
    raise MechanismError(
        Fault(
            "run.steady",
            f"the machine does not get through the cycle: it stands still near {as_angle(place % TURN, 4)}.",
            "Give it a larger flywheel or a stronger motor.",
        )
    )


def _run(
    compiled: Compiled, joint: str, start: float, sense: float, turns: int,
    edges: Real, begins: Real, coefficients: Real, w: Real, multiplier: float,
) -> SteadyRun:  # fmt: skip
    h = np.diff(edges)
    period = float(np.sum(h[:, None] * WEIGHTS / np.sqrt(2.0 * w)))
    run = SteadyRun(compiled, joint, start, sense, turns, edges, begins, coefficients, period, multiplier, 0.0, 0.0)
    places = [edges[:-1], *_standstills(edges, coefficients)]
    speeds = run(np.concatenate(places))
    return replace(run, least=float(speeds.min()), greatest=float(speeds.max()))


def _standstills(edges: Real, coefficients: Real) -> list[Real]:
    """Positions inside the panels at which dw/dx vanishes: extrema of the speed."""
    z = np.linspace(-1.0, 1.0, 2 * PANEL_NODES + 1)
    values = legendre.legval(z, coefficients.T)
    out = []
    for k, j in zip(*np.nonzero(values[:, :-1] * values[:, 1:] < 0.0), strict=True):
        c, d = coefficients[k], legendre.legder(coefficients[k])
        at = z[j] - values[k, j] * (z[j + 1] - z[j]) / (values[k, j + 1] - values[k, j])
        for _ in range(3):
            slope = float(legendre.legval(at, d))
            at = float(np.clip(at - float(legendre.legval(at, c)) / slope, z[j], z[j + 1])) if slope else at
        out.append(np.array([edges[k] + 0.5 * (edges[k + 1] - edges[k]) * (at + 1.0)]))
    return out


# --- flywheels --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SizedFlywheel:
    """The moment of ``inertia`` [kg m^2] to add to ``link`` for the wanted fluctuation, and the steady run with it."""

    inertia: float
    link: str
    run: SteadyRun


def with_flywheel(mechanism: Mechanism, inertia: float) -> Mechanism:
    """The mechanism with a flywheel [kg m^2] on the shaft of its free joint, balanced, about the pin."""
    name = shaft_of(mechanism)

    def heavier(link: Link) -> Link:
        return replace(link, inertia=link.inertia + inertia) if link.name == name else link

    return replace(mechanism, links=tuple(heavier(link) for link in mechanism.links))


def shaft_of(mechanism: Mechanism) -> str:
    """The link that turns in the free joint on the frame."""
    joint = next(p for p in mechanism.joints if p.name == mechanism.drives[0].joint)
    turning = [k for k in joint.links if k != mechanism.frame]
    if len(turning) != 1:
        raise MechanismError(
            Fault("flywheel", f"joint {joint.name} is not on the frame.", "A flywheel sits on a shaft in the frame.")
        )
    return turning[0]


def size_flywheel(mechanism: Mechanism, fluctuation: float, *, turns: int = 1, tolerance: float = 1e-10) -> SizedFlywheel:
    """The least flywheel on the free joint's shaft with which the coefficient of fluctuation does not exceed ``fluctuation``.

    Every trial is a steady run of its own, so that it holds for large fluctuations too, unlike the usual formula
    (`flywheel`), which it approaches as the fluctuation gets small. Secant steps on its reciprocal, nearly linear in
    the inertia.
    """
    if not 0.0 < fluctuation < 2.0:
        remedy = "Give one between 0 and 2, such as 0.02 for 2 %."
        raise MechanismError(Fault("flywheel", f"a coefficient of fluctuation of {fluctuation:g}.", remedy))
    link = shaft_of(mechanism)

    def trial(inertia: float) -> SteadyRun:
        return steady_run(with_flywheel(mechanism, inertia), turns=turns, tolerance=tolerance)

    compiled = compile_mechanism(mechanism)
    _, start, speed = _validated(compiled, turns)
    _check_back(compiled, start, speed, turns)  # no flywheel changes that
    q = np.linspace(0.0, TURN, 25)[:-1, None]
    own = float(reduce(compiled, q, np.ones_like(q), np.zeros(24)).inertia.mean())
    known: list[tuple[float, float]] = []
    inertia = 0.0
    for _ in range(40):
        try:
            run = trial(inertia)
        except MechanismError:
            if known or inertia > 1e9 * own:
                raise
            inertia = max(2.0 * inertia, own)  # it does not get through the cycle yet
            continue
        known.append((inertia, 1.0 / run.fluctuation))
        if run.fluctuation <= fluctuation and inertia == 0.0:
            return SizedFlywheel(0.0, link, run)
        if abs(run.fluctuation / fluctuation - 1.0) <= 1e-9:
            break
        if len(known) == 1:
            inertia = (own + inertia) * run.fluctuation / fluctuation - own
        else:
            (j0, y0), (j1, y1) = known[-2:]
            if y1 == y0:
                break
            inertia = j1 + (1.0 / fluctuation - y1) * (j1 - j0) / (y1 - y0)
        inertia = max(inertia, 0.0)
    return SizedFlywheel(inertia, link, run)
