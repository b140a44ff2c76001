"""Jumps of a motion's changes with parameters (sensitivities) at instants at which its equations change: an impact, a contact that
ends, slip that becomes stick, a force that jumps at a place.

The instant T itself depends on the parameters. For an event condition g(q, v, t, p) = 0 it is dT = -dg / g', with dg from the
change of the state and from the parameters, and g' along the motion. With the rates f of the state z before and after the instant
and the map R between the two states, dz+ = dR(dz- + f- dT) - f+ dT (saltation; I. A. Hiskens and M. A. Pai, Trajectory sensitivity
analysis of hybrid systems, 2000). Where neither the state nor its rates jump, dT has no effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from mechcore.arrays import Real
from mechcore.derivatives.impacts import SAME_SPEED, Conditions, ImpactCrossing, Instant, side_of
from mechcore.derivatives.instants import Source, with_changes
from mechcore.derivatives.model_numbers import Parameter, refusal
from mechcore.derivatives.phases import SWEEP_INSTEAD, PhaseDerivatives, SmoothPhase
from mechcore.dynamics.contact.dry_friction import DrySystem
from mechcore.dynamics.equations.reduced import forms_of, free_of, motion_at
from mechcore.dynamics.simulation import Simulation
from mechcore.effects.registry import effects_of
from mechcore.forces.friction.elements import elements_of, relative_rate

LEAST_JUMP = 1e-5  # least jump of an acceleration, relative to the largest acceleration of the motion
END_NODES = 16  # nodes by which a number is differentiated in time at the end of a phase


class Jumps(Conditions):
    """Jumps of the changes of a motion at the instants between its phases. ``stated``: breakpoints (n,) [s] of laws and their
    derivatives (n, P), by source; ``largest``: the size of the motion's accelerations."""

    def __init__(
        self, simulation: Simulation, parameters: Sequence[Parameter], stated: dict[Source, tuple[Real, Real]], largest: float
    ):
        super().__init__(simulation, parameters)
        self._stated, self._largest = stated, largest

    def __call__(self, before: SmoothPhase, after: SmoothPhase, states: Real) -> tuple[Real, Real]:
        """Changes (2 f', P) after the instant between two phases, from those before it (2 f, P); and the changes (P, 2), at the
        instant, of the work of drives and process forces and of the energy dissipated. Raises `MechanismError`."""
        sides = side_of(before, last=True), side_of(after, last=False)
        return _Crossing(self, *sides, states, self.struck(before.end)).result()

    def begin(self, phase: SmoothPhase, states: Real) -> Real:
        """Changes (2 f', P) at the start of the first phase, from those (2 f, P) of the scene's free coordinates."""
        compiled = self.simulation.compiled
        if phase.compiled is compiled or not len(phase.free):
            return states
        free = [compiled.mechanism.drives[i] for i in free_of(compiled)]
        q, v = (np.array([float(d.law(0.0)[k]) for d in free]) for k in (0, 1))
        at = Instant(compiled, self.parameters, 0.0, q, v[None], np.zeros((1, len(q))))
        asked = [x for joint in phase.free for x in at.coordinate(joint)]
        start_rates = np.array(at.along(asked, states, np.zeros(2 * len(q)), (0,)))[:, : len(self.parameters)]
        return np.concatenate([start_rates[0::2], start_rates[1::2]])

    def stated_shifts(self, t: float) -> dict[Source, Real]:
        """Derivatives (P,) of an instant by the parameters, by source, for the laws that have a breakpoint there."""
        near = 1e-9 * self.simulation.duration
        places = {source: int(np.argmin(np.abs(times - t))) for source, (times, _) in self._stated.items()}
        return {source: self._stated[source][1][k] for source, k in places.items() if abs(self._stated[source][0][k] - t) <= near}

    def jumps(self, before: Real, after: Real) -> bool:
        return float(np.abs(after - before).max(initial=0.0)) > LEAST_JUMP * self._largest


class _Crossing(ImpactCrossing):
    jumps: Jumps

    def result(self) -> tuple[Real, Real]:
        if self.struck:
            return super().result()
        shifts = list((changing := self.jumps.stated_shifts(self.t)).values())
        if any(not np.allclose(shift, shifts[0], rtol=1e-9, atol=0.0) for shift in shifts):
            return self._apart(changing)
        v, a = self._mapped()
        largest = max(float(np.abs(self.v).max(initial=0.0)), float(np.abs(self.new[1]).max(initial=0.0)))
        if (
            float(np.abs(v - self.new[1]).max(initial=0.0)) > SAME_SPEED * largest + 1e-300
            and largest > 0.0
            and not self._settles(v)
        ):
            raise refusal(
                f"what happens at t = {self.t:.6g} s follows from the parameters in a way that is not known.", SWEEP_INSTEAD
            )
        return self.after_instant(self._moved(a), None, np.zeros((self.count, 2)))

    # -- the state on both sides ----------------------------------------------------------------------------------------
    def _mapped(self) -> tuple[Real, Real]:
        """Speeds and accelerations before the instant in the coordinates after it."""
        free = self.before.free
        known = {joint: (self.v[k], self.a[k]) for k, joint in enumerate(free)}
        new = {joint: self.at.nominal.coordinate(joint)[0, 1:] for joint in self.after.free if joint not in free}
        rows = np.array([(known | new)[joint] for joint in self.after.free]).reshape(-1, 2)
        return rows[:, 0], rows[:, 1]

    def _settles(self, v: Real) -> bool:
        """Whether the speeds that become zero were negligible before the instant: friction then holds what stops."""
        windows = getattr(self.before.segment.solution, "windows", ())
        scale = max(float(np.abs(w.v[: len(self.v)]).max(initial=0.0)) for w in windows)
        return float(np.abs(v - self.new[1]).max()) <= SAME_SPEED * scale

    def _apart(self, shifts: dict[Source, Real]) -> tuple[Real, Real]:
        """The result where a parameter separates breakpoints of several laws: the effects of their changes of form on the
        accelerations add up, in any order."""
        one, other = (p.segment for p in (self.before, self.after))
        rubs = isinstance(one.system, DrySystem) or isinstance(other.system, DrySystem)
        if rubs or one.resting or other.resting or one.independent != other.independent:
            why = f"at t = {self.t:.6g} s forces change that a parameter takes apart, where friction or stops decide what follows."
            raise refusal(why, SWEEP_INSTEAD)
        those = with_changes(self.before.compiled, self.t, *self.sides[0][1:3])
        a, power = those(shifts)
        states, lost = self.after_instant(np.zeros(self.count), None, np.zeros((self.count, 2)))
        for source, shift in shifts.items():
            changed, supplied = those([x for x in shifts if x != source])
            states[len(states) // 2 :] -= np.multiply.outer(changed - a, shift)
            lost -= np.multiply.outer(shift, (supplied - power)[1:] * [1.0, -1.0])
        return states, lost

    # -- when -----------------------------------------------------------------------------------------------------------
    def _moved(self, a: Real) -> Real:
        """Derivatives (P,) of the instant by the parameters; zero where nothing jumps there."""
        still = np.zeros(self.count)
        for stated in self.jumps.stated_shifts(self.t).values():
            return stated  # the same for all sources
        if not self.jumps.jumps(a, self.new[2]):
            return still
        shift = self._turned()
        shift = self._loose() if shift is None else shift
        shift = self._passed() if shift is None else shift
        if shift is None:
            raise refusal(f"a force jumps at t = {self.t:.6g} s, an instant that moves with the parameters.", SWEEP_INSTEAD)
        return shift

    def _turned(self) -> Real | None:
        """Derivatives (P,) of an instant at which something that slid reverses or begins to stick: its relative rate is zero. None
        where there is no such element of friction."""
        one, other = (p.segment.system for p in (self.before, self.after))
        if not isinstance(one, DrySystem):
            return None
        signs = other.signs if isinstance(other, DrySystem) and len(other.signs) == len(one.signs) else None
        motion = self.at.motion
        elements = elements_of(self.at.nominal)
        best, shift = 0.0, None
        for i, e in enumerate(elements):
            if one.signs[i] == 0.0 or (signs is not None and signs[i] == one.signs[i]):
                continue
            rate = relative_rate(motion, motion.speeds, e.what, e.index, e.links)[0]
            by_parameters, pace = self._asked([rate])
            size = abs(pace[0]) / (1.0 if e.what == "turn" else motion.model.length_scale)
            if size > best:
                best, shift = size, -by_parameters[0] / pace[0]
        return shift

    def _loose(self) -> Real | None:
        """Derivatives (P,) of an instant at which something that stuck begins to slip: its friction has reached the limit. None
        where there is no such element of friction."""
        one, other = (p.segment.system for p in (self.before, self.after))
        if not (isinstance(one, DrySystem) and isinstance(other, DrySystem) and len(other.signs) == len(one.signs)):
            return None
        came = np.flatnonzero((one.signs == 0.0) & (other.signs != 0.0))
        if not len(came):
            return None
        width = self.before.edges[-1] - self.before.edges[-2]
        x = np.cos(np.pi * (np.arange(END_NODES) + 0.5) / END_NODES)
        t = self.t + 0.5 * width * (np.append(x, 1.0) - 1.0)
        q, v, _ = self.before.state(t)
        dry = one.solve(q, v, t)
        excess = np.sign(dry.value[-1]) * dry.value - dry.limit
        i = int(came[np.argmax(excess[-1, came])])
        fit = np.linalg.solve(chebyshev.chebvander(x, END_NODES - 1), excess[:-1, i])
        pace = float(chebyshev.chebval(1.0, chebyshev.chebder(fit))) * 2.0 / width
        exact = PhaseDerivatives(self.before, np.array([self.t]))
        exact.set_states(self.whole_states[None])
        if exact.undetermined:
            raise refusal(f"at t = {self.t:.6g} s one of several joints that stick comes loose.", SWEEP_INSTEAD)
        (slope,) = exact.of(abs(exact.friction_values[i]) - exact.limit(i))
        return np.asarray(-slope[:, 0] / pace)

    def _passed(self) -> Real | None:
        """Derivatives (P,) of an instant at which the law of a force changes its form at a place; None where there is none."""
        compiled = self.before.compiled
        step = 1e-9 * max(self.before.end - self.before.start, 1e-300)
        rows = (
            np.array([self.q - step * self.v, self.q + step * self.v]),
            np.array([self.v - step * self.a, self.v + step * self.a]),
        )
        around = motion_at(compiled, *rows, np.array([self.t - step, self.t + step]))
        changed = [bool(np.ptp(np.broadcast_to(form, (2,)))) for form in forms_of(around)]
        laws = [e for e in effects_of(compiled.mechanism) if e.piecewise]
        conditions: list[Any] = []
        for effect, form in zip(laws, changed, strict=False):  # forms of cams come after those of laws
            if form:
                switch: Any = effect.switch(self.at.motion)
                if switch is None:
                    return None
                self._refuse_other_laws(effect.name)
                conditions.append(switch[0])
        if not conditions:
            return None
        by_parameters, pace = self._asked(conditions)
        k = int(np.argmax(np.abs(pace)))
        return np.asarray(-by_parameters[k] / pace[k])

    def _refuse_other_laws(self, name: str) -> None:
        """Raise where a parameter may move the places at which a law changes its form."""
        for p in self.before.parameters:
            mechanisms = self.before.compiled.mechanism, p.beside()
            laws = [[getattr(x, "factor", None) for x in m.loads if x.name == name] for m in mechanisms]
            if laws[0] != laws[1]:
                raise refusal(f"where the law of {name} changes its form may depend on {p.name}.", SWEEP_INSTEAD)
