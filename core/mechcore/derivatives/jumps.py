"""How the changes of a motion go on after an instant at which its equations change: an impact, a contact that ends, slip that turns
to stick, a force that jumps at a place.

The instant T itself moves with the parameters: where g(q, v, t, p) = 0 says when it is, dT = -dg / g', dg by the change of the
state there and by the parameters, g' along the motion. With the rates f of the state z before and after it and the map R from the
one state to the other dz+ = dR(dz- + f- dT) - f+ dT (saltation; I. A. Hiskens and M. A. Pai, Trajectory sensitivity analysis of
hybrid systems, 2000). Where neither the state nor its rates jump, nothing is left of dT.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from mechcore.arrays import Real
from mechcore.derivatives.exact import Derivatives
from mechcore.derivatives.model_numbers import ModelNumbers, Parameter, refusal, slopes
from mechcore.derivatives.phases import SWEEP_INSTEAD, PhaseDerivatives, SmoothPhase, parameters_in_chart, with_state_rows
from mechcore.dynamics.contact.dry_friction import DrySystem
from mechcore.dynamics.contact.separation import FollowerSeparation
from mechcore.dynamics.equations.reduced import forms_of, free_of, motion_at, reduce
from mechcore.dynamics.events import EndStop, EventKind, SeparableCam
from mechcore.dynamics.segments import segment_forces
from mechcore.dynamics.simulation import Simulation, powers_of
from mechcore.effects.masses import kinetic_energy
from mechcore.effects.registry import effects_of, totals
from mechcore.forces.equilibrium import joint_forces
from mechcore.forces.friction.elements import elements_of, relative_rate
from mechcore.forces.kinetostatics import Forces
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled

SAME_SPEED = 1e-7  # of the largest speed: how far speeds after an impact may be from those that the equations of impact give
LEAST_JUMP = 1e-5  # part of the largest acceleration by which it may change without being a jump
END_NODES = 16  # by which a number is differentiated along the end of a phase


def contact_numbers(stops: Sequence[EndStop], cams: Sequence[SeparableCam]) -> ModelNumbers:
    """Where stops are, and what rebounds from them and from cams, by their names."""
    numbers: ModelNumbers = {("stop", s.name, what): getattr(s, what) for s in stops for what in ("at", "restitution")}
    return numbers | {("cam", c.joint): c.restitution for c in cams}


class Jumps:
    """Jumps of the changes of a motion at the instants between its phases. ``stated``: instants (n,) at which laws say that they
    change their form, and the derivatives (n, P) of these; ``largest``: the size of its accelerations."""

    def __init__(self, simulation: Simulation, parameters: Sequence[Parameter], stated: tuple[Real, Real], largest: float):
        self.simulation, self.parameters = simulation, tuple(parameters)
        self._stated, self._largest = stated, largest
        self._soon = 1e-12 * simulation.duration
        numbers = contact_numbers(simulation.stops, simulation.separable_cams)
        self._conditions = [{} if p.contacts is None else slopes(p.contacts, numbers, p) for p in self.parameters]
        cams = simulation.separable_cams
        self.cams = FollowerSeparation(simulation.compiled, cams).contacts if cams else {}

    def __call__(self, before: SmoothPhase, after: SmoothPhase, states: Real) -> tuple[Real, Real]:
        """Changes (2 f', P) after the instant between two phases, from those before it (2 f, P); and the changes (P, 2) that it
        makes in the work of drives and process forces and in the energy dissipated. Raises `MechanismError`."""
        return _Crossing(self, before, after, states).result()

    def begin(self, phase: SmoothPhase, states: Real) -> Real:
        """Changes (2 f', P) at the start of the first phase, from those (2 f, P) of the coordinates that the scene states."""
        compiled = self.simulation.compiled
        if phase.compiled is compiled or not len(phase.free):
            return states
        free = [compiled.mechanism.drives[i] for i in free_of(compiled)]
        q, v = (np.array([float(d.law(0.0)[k]) for d in free]) for k in (0, 1))
        at = Instant(compiled, self.parameters, 0.0, q, v[None], np.zeros((1, len(q))))
        asked = [x for joint in phase.free for x in at.coordinate(joint)]
        start_rates = np.array(at.along(asked, states, np.zeros(2 * len(q)), (0,)))[:, : len(self.parameters)]
        return np.concatenate([start_rates[0::2], start_rates[1::2]])

    def condition(self, key: tuple[str, ...]) -> Real:
        """Derivatives (P,) of a number of `contact_numbers`."""
        return np.array([float(own.get(key, 0.0)) for own in self._conditions])

    def struck(self, t: float) -> list[str]:
        """Stops and cams that are struck at an instant."""
        events = (e for e in self.simulation.events if abs(e.time - t) <= self._soon)
        return list(dict.fromkeys(e.item for e in events if e.kind in (EventKind.IMPACT, EventKind.LANDING)))

    def held(self, separated: set[str], t: float) -> tuple[Compiled, tuple[Parameter, ...]]:
        """The mechanism whose followers, but for some, are on their cams, and its parameters."""
        original = self.simulation.compiled
        known = [original] if not separated else [s.compiled for s in self.simulation.segments if set(s.separated) == separated]
        if not known:
            raise refusal(f"at t = {t:.6g} s one of several followers lands while others are away.", SWEEP_INSTEAD)
        return known[0], parameters_in_chart(known[0], original, self.parameters)

    def stated_shift(self, t: float) -> Real | None:
        """How an instant moves (P,) at which a law says by itself that it changes its form; None where none does."""
        times, slopes = self._stated
        near = np.flatnonzero(np.abs(times - t) <= 1e-9 * self.simulation.duration)
        if not len(near):
            return None
        if not np.allclose(slopes[near], slopes[near[0]], rtol=1e-9):
            raise refusal(f"instants at t = {t:.6g} s at which forces change move apart.", SWEEP_INSTEAD)
        return np.asarray(slopes[near[0]])

    def jumps(self, before: Real, after: Real) -> bool:
        return float(np.abs(after - before).max(initial=0.0)) > LEAST_JUMP * self._largest


class Instant(Derivatives):
    """A mechanism at one instant with several rates: ``q`` (f,), ``v``, ``a`` (n, f). Its results have P + 1 derivatives: by
    the parameters, with the changes of the state before the event, and by the time along the motion before it."""

    every_drive = True

    def __init__(self, compiled: Compiled, parameters: Sequence[Parameter], t: float, q: Real, v: Real, a: Real):
        n = len(v)
        motion = motion_at(compiled, np.tile(q, (n, 1)), v, np.full(n, t), a)
        super().__init__(motion, parameters, under_forces=True)

    def _forces(self) -> Forces:
        """Without dry friction, which impulses do not excite here."""
        force, moment, formed = totals(self.motion)
        return Forces(self.motion, formed, *joint_forces(self.motion, force, moment)[:2])

    def coordinate(self, joint: str) -> tuple[Any, Any]:
        """Coordinate and rate of a joint in the first row, on the tape."""
        drives = self.nominal.mechanism.drives
        for d in free_of(self.nominal):
            if drives[d].joint == joint:
                return self.leaves["drive", d, 0][0], self.leaves["drive", d, 1][0]
        rows = self.motion.coordinate(joint)
        return rows[0, 0], rows[0, 1]

    def along(self, results: Sequence[Any], states: Real, flow: Real, moving: Sequence[int]) -> list[Real]:
        """Derivatives (P + 1, n, ...) of results, where positions move as ``states`` (2 f, P) and ``flow`` (2 f,) say,
        and the rates of the rows ``moving`` with them."""
        count, f = len(self.parameters), len(states) // 2
        free = free_of(self.nominal)
        known = {number: np.stack(d) for number, d in self._slopes.items()}
        given = {number: np.concatenate([d, np.zeros_like(d[:1])]) for number, d in known.items()}
        own = np.concatenate([states, flow[:, None]], axis=1)
        for d, _ in enumerate(self.nominal.mechanism.drives):
            for k in range(2):
                leaf = self.leaves["drive", d, k].number
                if d in free:
                    row = own[k * f + free.index(d)]
                    where = np.zeros(self.nominal.frames)
                    where[list(moving) if k else slice(None)] = 1.0
                    given[leaf] = row[:, None] * where
                else:
                    given[leaf][count] = self.nominal.drives[d][k + 1]
        traced = [x for x in results if hasattr(x, "number")]
        values = iter(self.tape.forward(given, traced))
        return [np.asarray(next(values)) if hasattr(x, "number") else np.zeros((count + 1, *np.shape(x))) for x in results]


class _Contact(NamedTuple):
    """Something that is struck or rests: ``gap`` (P + 1,) derivatives; ``rates`` (n,) of the gap in each row and derivatives
    (P + 1, n); ``restitution`` and derivatives (P,)."""

    gap: Real
    rates: Real
    slopes: Real
    restitution: float
    bounce: Real


class _Crossing:
    def __init__(self, jumps: Jumps, before: SmoothPhase, after: SmoothPhase, states: Real):
        self.jumps, self.before, self.after, self.states = jumps, before, after, states
        self.t = before.end
        f, every = len(before.free), before.edge(last=True)
        self.q, self.v, self.a = (x[:f] for x in every)
        self.integrated, self.rates_of_states = (x[f:] for x in every[1:])  # states of effects that integrate
        self.flow = np.concatenate([self.v, self.a])
        self.count = states.shape[1]
        self.whole_states, self.states_of_effects = states, states[len(every[0]) + f :]
        self.states = np.concatenate([states[:f], states[len(every[0]) :][:f]])
        units = np.concatenate([np.zeros((1, f)), np.eye(f)])
        entered = after.edge(last=False)
        self.new = tuple(x[: len(after.free)] for x in entered)
        self.new_rates_of_states = entered[2][len(after.free) :]
        self.struck = jumps.struck(self.t)
        full = len(after.free) == f and after.free == before.free
        self.rebound = self.new[1] if full else self.v  # of what is struck for good the rates after it are solved for
        rows = np.concatenate([[self.v, self.v, self.rebound], units])
        accelerations = np.zeros_like(rows)
        accelerations[0] = self.a
        self.rows = rows
        self.at = self._instant(rows, accelerations)

    def _instant(self, rows: Real, accelerations: Real) -> Instant:
        """The mechanism before the instant, with rates and accelerations (n, f)."""
        states = np.tile(self.integrated, (len(rows), 1))
        return Instant(
            self.before.compiled, self.before.parameters, self.t, self.q, np.concatenate([rows, states], axis=1), accelerations
        )

    def result(self) -> tuple[Real, Real]:
        v, a = self._mapped()
        states, flow = self._asked([x for j in self.after.free for x in self.at.coordinate(j)])
        lost = np.zeros((self.count, 2))
        if self.struck:
            moved, speeds, lost = self._impact()
            positions = states[0::2] + flow[0::2, None] * moved
            rates = speeds
        else:
            largest = max(float(np.abs(self.v).max(initial=0.0)), float(np.abs(self.new[1]).max(initial=0.0)))
            if (
                float(np.abs(v - self.new[1]).max(initial=0.0)) > SAME_SPEED * largest + 1e-300
                and largest > 0.0
                and not self._settles(v)
            ):
                raise refusal(
                    f"what happens at t = {self.t:.6g} s follows from the parameters in a way that is not known.", SWEEP_INSTEAD
                )
            moved = self._moved(a)
            positions, rates = states[0::2] + flow[0::2, None] * moved, states[1::2] + flow[1::2, None] * moved
        after = np.concatenate([positions - self.new[1][:, None] * moved, rates - self.new[2][:, None] * moved])
        kept = self.states_of_effects + np.subtract(self.rates_of_states, self.new_rates_of_states)[:, None] * moved
        after = with_state_rows(after, kept)
        return after, lost + moved[:, None] * self._powers()

    # -- the state on both sides ----------------------------------------------------------------------------------------
    def _mapped(self) -> tuple[Real, Real]:
        """Speeds and accelerations before the instant in the coordinates after it."""
        free = self.before.free
        known = {joint: (self.v[k], self.a[k]) for k, joint in enumerate(free)}
        new = {joint: self.at.nominal.coordinate(joint)[0, 1:] for joint in self.after.free if joint not in free}
        rows = np.array([(known | new)[joint] for joint in self.after.free]).reshape(-1, 2)
        return rows[:, 0], rows[:, 1]

    def _asked(self, results: Sequence[Any]) -> tuple[Real, Real]:
        """Derivatives (m, P) by the parameters, and (m,) along the motion, of numbers of the first row."""
        directional = np.array(self.at.along(results, self.states, self.flow, (0, 1))).reshape(len(results), self.count + 1)
        return directional[:, : self.count], directional[:, self.count]

    def _settles(self, v: Real) -> bool:
        """Whether what stops moving had next to no speed left: friction holds it."""
        windows = getattr(self.before.segment.solution, "windows", ())
        scale = max(float(np.abs(w.v[: len(self.v)]).max(initial=0.0)) for w in windows)
        return float(np.abs(v - self.new[1]).max()) <= SAME_SPEED * scale

    # -- when -----------------------------------------------------------------------------------------------------------
    def _moved(self, a: Real) -> Real:
        """How the instant moves (P,), zero where nothing jumps there."""
        still = np.zeros(self.count)
        stated = self.jumps.stated_shift(self.t)
        if stated is not None:
            return stated
        if not self.jumps.jumps(a, self.new[2]):
            return still
        shift = self._turned()
        shift = self._loose() if shift is None else shift
        shift = self._passed() if shift is None else shift
        if shift is None:
            raise refusal(f"a force jumps at t = {self.t:.6g} s, an instant that moves with the parameters.", SWEEP_INSTEAD)
        return shift

    def _turned(self) -> Real | None:
        """Where something that slid turns back or begins to stick: its relative rate is zero."""
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
        """Where something that stuck comes loose: what holds it has reached its limit."""
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
        (slope,) = exact.of(abs(exact.rubbing[i]) - exact.limit(i))
        return np.asarray(-slope[:, 0] / pace)

    def _passed(self) -> Real | None:
        """Where the law of a force passes into another form."""
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
        for effect, form in zip(laws, changed, strict=False):  # the forms of cams follow: where one touches may not vary
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
        """Refuse parameters by which the places may vary at which a law changes its form."""
        for p in self.before.parameters:
            mechanisms = self.before.compiled.mechanism, p.mechanism(p.value + 0.5 * p.width)
            laws = [[getattr(x, "factor", None) for x in m.loads if x.name == name] for m in mechanisms]
            if laws[0] != laws[1]:
                raise refusal(f"where the law of {name} changes its form may depend on {p.name}.", SWEEP_INSTEAD)

    # -- impacts --------------------------------------------------------------------------------------------------------
    def _impact(self) -> tuple[Real, Real, Real]:
        """How the instant of an impact moves (P,), how the rates after it do (f', P), and the changes (P, 2) of the energies."""
        if len(self.struck) > 1:
            raise refusal(f"at t = {self.t:.6g} s several contacts are struck at once.", SWEEP_INSTEAD)
        name = self.struck[0]
        f = len(self.q)
        resting = [s for s in self.before.segment.resting if s.name != name]
        contacts = [self._contact(name), *(self._stop(s) for s in resting)]
        inertia = reduce(self.before.compiled, self.q[None], self.v[None], np.array([self.t])).inertia[0]
        active = list(range(len(contacts)))
        while True:
            g = np.array([contacts[k].rates[4:] - contacts[k].rates[3] for k in active])
            gone = np.array([self._bounce(k, contacts) for k in active])
            struck = np.array([contacts[k].rates[0] for k in active])
            full = np.zeros((f + len(active), f + len(active)))
            full[:f, :f], full[:f, f:], full[f:, :f] = inertia, -g.T, g
            jump = np.linalg.solve(full, np.concatenate([np.zeros(f), -(1.0 + gone) * struck]))
            if len(active) > 1 and jump[f + 1 :].min() < 0.0:
                del active[1 + int(np.argmin(jump[f + 1 :]))]
                continue
            break
        rates = self.v + jump[:f]
        wanted = self._kept(rates)
        size = max(float(np.abs(self.v).max()), float(np.abs(rates).max()), 1e-300)
        if float(np.abs(wanted - self.new[1]).max(initial=0.0)) > SAME_SPEED * size:
            raise refusal(f"the impact at t = {self.t:.6g} s goes together with other changes.", SWEEP_INSTEAD)
        self.rows[2], accelerations = rates, np.zeros_like(self.rows)
        accelerations[1] = jump[:f]
        self.at = self._instant(self.rows, accelerations)
        contacts = [self._contact(name), *(self._stop(s) for s in resting)]
        moved = -contacts[0].gap[: self.count] / contacts[0].gap[self.count]
        efforts = [self.at.forces.effort(joint) for joint in self.before.free]
        slopes = self.at.along(efforts, self.states, self.flow, (0, 1))
        weighed = np.array([d[:, 1] - d[:, 0] for d in slopes])  # (f, P + 1): of M times the jump, the jump as it is

        def total(x: Real) -> Real:
            """Derivatives (..., P) at the moving instant, from (..., P + 1)."""
            return np.asarray(x[..., : self.count] + x[..., self.count :] * moved)

        chosen = [contacts[k] for k in active]
        turned = np.array([(c.slopes[:, 4:] - c.slopes[:, 3:4]).T for c in chosen])  # (c, f, P + 1): of the gradients
        known = np.concatenate([self.states[f:], self.flow[f:, None]], axis=1)
        above = weighed - np.einsum("cfp,c->fp", turned, jump[f:]) - inertia @ known
        below = np.array([c.slopes[:, 2] + e * c.slopes[:, 0] for c, e in zip(chosen, gone, strict=True)])
        right = -total(np.concatenate([above, below]))
        right[f] -= contacts[0].bounce * contacts[0].rates[0] * (gone[0] != 0.0)
        solved = np.asarray(np.linalg.solve(full, right), float)
        before, after = (np.array([c.rates[k] for c in chosen]) for k in (0, 2))
        rate_before = total(np.array([c.slopes[:, 0] for c in chosen]))
        rate_after = total(np.array([c.slopes[:, 2] for c in chosen])) + g @ solved[:f]
        lost = -0.5 * (solved[f:].T @ (before + after) + jump[f:] @ (rate_before + rate_after))
        return moved, self._kept(solved[:f]), np.stack([self._pushed(moved, rates, solved[:f], lost), lost], axis=-1)

    def _bounce(self, k: int, contacts: Sequence[_Contact]) -> float:
        """The coefficient of restitution that holds: none where what is struck is rested on after it."""
        if k:
            return 0.0
        name = self.struck[0]
        stays = name in {s.name for s in self.after.segment.resting} or len(self.after.free) < len(self.before.free)
        return 0.0 if stays else contacts[0].restitution

    def _kept(self, x: Real) -> Real:
        """Of numbers (f, ...) of the coordinates before the instant those after it."""
        return np.asarray(x[[self.before.free.index(j) for j in self.after.free]])

    def _contact(self, name: str) -> _Contact:
        stop = next((s for s in self.jumps.simulation.stops if s.name == name), None)
        return self._cam(name) if stop is None else self._stop(stop)

    def _stop(self, stop: EndStop) -> _Contact:
        sign = -1.0 if stop.side == "upper" else 1.0
        rows = self.at.motion.coordinate(stop.joint)
        slopes = self.at.along([rows[:, 0], rows[:, 1]], self.states, self.flow, (0, 1))
        gap = sign * slopes[0][:, 0]
        gap[: self.count] -= sign * self.jumps.condition(("stop", stop.name, "at"))
        values = np.asarray(self.at.nominal.coordinate(stop.joint))[:, 1]
        bounce = self.jumps.condition(("stop", stop.name, "restitution"))
        return _Contact(gap, sign * values, sign * slopes[1], stop.restitution, bounce)

    def _cam(self, name: str) -> _Contact:
        """The gap between a follower that has left its cam and the place at which it would touch it."""
        own = self.jumps.cams[name]
        k = self.before.free.index(own.guide)
        others = set(self.before.segment.separated) - {name}
        held, parameters = self.jumps.held(others, self.t)
        rest = [i for i in range(len(self.q)) if i != k]
        f = len(self.q)
        at = Instant(held, parameters, self.t, self.q[rest], self.rows[:, rest], np.zeros_like(self.rows[:, rest]))
        rows = at.motion.coordinate(own.guide)
        chosen = [*rest, *(f + i for i in rest)]
        slopes = at.along([rows[:, 0], rows[:, 1]], self.states[chosen], self.flow[chosen], (0, 1))
        mine = np.concatenate([self.states[[k, f + k]], self.flow[[k, f + k], None]], axis=1)
        moving = np.array([1.0, 1.0, *np.zeros(len(self.rows) - 2)])
        gap = own.away * (mine[0] - slopes[0][:, 0])
        values = own.away * (self.rows[:, k] - np.asarray(at.nominal.coordinate(own.guide))[:, 1])
        rates = own.away * (mine[1][:, None] * moving - slopes[1])
        return _Contact(gap, values, rates, own.restitution, self.jumps.condition(("cam", name)))

    def _pushed(self, moved: Real, rates: Real, changes: Real, lost: Real) -> Real:
        """Changes (P,) of the work that prescribed drives do in an impact."""
        drives = self.before.compiled.mechanism.drives
        if all(isinstance(d.law, Free) for d in drives):
            return np.zeros(self.count)
        f = len(self.q)
        rows = np.array([self.v, rates])
        at = self._instant(rows, np.zeros((2, f)))
        energy = [kinetic_energy(at.motion)]
        (one,) = at.along(energy, self.states, self.flow, (0,))
        (other,) = at.along(energy, np.concatenate([self.states[:f], changes]), np.append(self.flow[:f], np.zeros(f)), (1,))
        gained = other[: self.count, 1] + other[self.count, 1] * moved - one[: self.count, 0] - one[self.count, 0] * moved
        return np.asarray(gained + lost)

    def _powers(self) -> Real:
        """By how much less power (2,) is supplied, and dissipated, after the instant than before it."""
        sides = []
        for phase, last in ((self.before, True), (self.after, False)):
            t, segment = phase.nodes(last=last), phase.segment
            q, v, a = phase.state(t)
            motion = motion_at(phase.compiled, q, v, t, a)
            powers = powers_of(motion, segment_forces(motion, segment.system, q, v, segment.resting))
            sides.append(phase.at_edge(powers, last=last))
        return np.asarray((sides[0] - sides[1])[1:] * [1.0, -1.0])
