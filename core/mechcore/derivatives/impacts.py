"""Jumps of a motion's changes with parameters (sensitivities) at impacts.

The instant of an impact depends on the parameters, and with it the positions and speeds at the impact. Where several contacts are
struck at once, a parameter may move their instants together: then the equations of impact hold for all of them. Or it separates
them: then the contacts are struck one after the other. Their order does not matter if the mechanism does not couple them; else
there are no derivatives, as the motion is another one on either side of the parameter's value.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np

from mechcore.arrays import Real
from mechcore.derivatives.exact import Derivatives
from mechcore.derivatives.model_numbers import ModelNumbers, Parameter, refusal, slopes
from mechcore.derivatives.phases import SWEEP_INSTEAD, SmoothPhase, parameters_in_chart, with_state_rows
from mechcore.dynamics.contact.end_stops import impact
from mechcore.dynamics.contact.separation import FollowerSeparation
from mechcore.dynamics.equations.reduced import free_of, motion_at, reduce
from mechcore.dynamics.events import EndStop, EventKind, SeparableCam
from mechcore.dynamics.segments import segment_forces
from mechcore.dynamics.simulation import Simulation, powers_of
from mechcore.effects.masses import kinetic_energy
from mechcore.effects.registry import totals
from mechcore.errors import MechanismError
from mechcore.forces.equilibrium import joint_forces
from mechcore.forces.kinetostatics import Forces
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled

SAME_SPEED = 1e-7  # tolerance of speeds after an impact against the equations of impact, relative to the largest speed
SAME_INSTANT = 1e-9  # relative difference of the derivatives of instants below which these move together
NO_SHIFT = 1e-12  # negligible shift of an instant over the width of a parameter, relative to the duration
SAME_CHANGES = 1e-7  # tolerance between the orders in which contacts are struck, relative to the largest change
NO_IMPULSE = 1e-10  # negligible impulse, relative to the largest
MOST_AT_ONCE = 4  # contacts struck at once of which all orders are tried


def contact_numbers(stops: Sequence[EndStop], cams: Sequence[SeparableCam]) -> ModelNumbers:
    """Positions of stops, and coefficients of restitution of stops and cams, by their names."""
    numbers: ModelNumbers = {("stop", s.name, what): getattr(s, what) for s in stops for what in ("at", "restitution")}
    return numbers | {("cam", c.joint): c.restitution for c in cams}


class Conditions:
    """The contacts that are struck in a motion, and how their numbers depend on parameters."""

    def __init__(self, simulation: Simulation, parameters: Sequence[Parameter]):
        self.simulation, self.parameters = simulation, tuple(parameters)
        self._soon = 1e-12 * simulation.duration
        numbers = contact_numbers(simulation.stops, simulation.separable_cams)
        self._conditions = [{} if p.contacts is None else slopes(p.contacts, numbers, p) for p in self.parameters]
        cams = simulation.separable_cams
        self.cams = FollowerSeparation(simulation.compiled, cams).contacts if cams else {}

    def condition(self, key: tuple[str, ...]) -> Real:
        """Derivatives (P,) of a number of `contact_numbers`."""
        return np.array([float(own.get(key, 0.0)) for own in self._conditions])

    def struck(self, t: float) -> list[str]:
        """Stops and cams that are struck at an instant."""
        events = (e for e in self.simulation.events if abs(e.time - t) <= self._soon)
        return list(dict.fromkeys(e.item for e in events if e.kind in (EventKind.IMPACT, EventKind.LANDING)))

    def held(self, separated: set[str], t: float) -> tuple[Compiled, tuple[Parameter, ...]]:
        """The mechanism whose followers are on their cams, except those ``separated``, and its parameters."""
        original = self.simulation.compiled
        known = [original] if not separated else [s.compiled for s in self.simulation.segments if set(s.separated) == separated]
        if not known:
            raise refusal(f"at t = {t:.6g} s one of several followers lands while others are away.", SWEEP_INSTEAD)
        return known[0], parameters_in_chart(known[0], original, self.parameters)


class Instant(Derivatives):
    """A mechanism at one instant with several sets of rates: ``q`` (f,), ``v``, ``a`` (n, f). Its results have P + 1 derivatives:
    by the parameters, with the changes of the state before the event, and by the time along the motion before it."""

    every_drive = True

    def __init__(self, compiled: Compiled, parameters: Sequence[Parameter], t: float, q: Real, v: Real, a: Real):
        n = len(v)
        motion = motion_at(compiled, np.tile(q, (n, 1)), v, np.full(n, t), a)
        super().__init__(motion, parameters, under_forces=True)

    def _forces(self) -> Forces:
        """The forces without dry friction, on which impulses have no effect in this model."""
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
        """Derivatives (P + 1, n, ...) of results, from those of the state by the parameters, ``states`` (2 f, P), and by the time,
        ``flow`` (2 f,); rates vary in the rows ``moving`` only."""
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


class Contact(NamedTuple):
    """Something that is struck or rests: ``gap`` (P + 1,) derivatives; ``rates`` (n,) of the gap in each row and derivatives
    (P + 1, n); ``restitution`` and derivatives (P,)."""

    gap: Real
    rates: Real
    slopes: Real
    restitution: float
    bounce: Real


class Side(NamedTuple):
    """One side of an instant: the phase there, positions, speeds, accelerations (f + s,), and the ``powers()`` of `powers_of`."""

    phase: SmoothPhase
    q: Real
    v: Real
    a: Real
    powers: Callable[[], Real]


def side_of(phase: SmoothPhase, *, last: bool) -> Side:
    """The end of a phase, or its start."""

    def powers() -> Real:
        t, segment = phase.nodes(last=last), phase.segment
        q, v, a = phase.state(t)
        motion = motion_at(phase.compiled, q, v, t, a)
        return phase.at_edge(powers_of(motion, segment_forces(motion, segment.system, q, v, segment.resting)), last=last)

    return Side(phase, *phase.edge(last=last), powers)


def _side_at(phase: SmoothPhase, t: float, q: Real, v: Real) -> Side:
    """The end of a phase with a state (f + s,) that is not its own."""
    segment, row = phase.segment, (q[None], v[None], np.array([t]))
    a = segment.system(*row)

    def powers() -> Real:
        motion = motion_at(phase.compiled, *row, a)
        return np.asarray(powers_of(motion, segment_forces(motion, segment.system, *row[:2], segment.resting))[0])

    return Side(phase, q, v, np.asarray(a[0], float), powers)


class _Hit(NamedTuple):
    """An impact: ``contacts``, of which the ``active`` ones have impulses; ``gone``: coefficients of restitution of these, with
    derivatives ``bounce`` (P,) each; ``full`` (f + c, f + c): matrix of the equations of impact, with the gaps' gradients ``g``
    (c, f); ``jump`` (f + c,): jump of the rates, and impulses."""

    contacts: list[Contact]
    active: list[int]
    gone: Real
    bounce: list[Real]
    full: Real
    g: Real
    jump: Real


class ImpactCrossing:
    """The instant between two sides at which contacts are ``struck``; ``states`` (2 (f + s), P): the changes before it."""

    def __init__(self, jumps: Conditions, before: Side, after: Side, states: Real, struck: Sequence[str]):
        self.jumps, self.sides, self.struck = jumps, (before, after), list(struck)
        self.before, self.after = before.phase, after.phase
        self.t = self.before.end
        f, every = len(self.before.free), before[1:4]
        self.q, self.v, self.a = (x[:f] for x in every)
        self.integrated, self.rates_of_states = (x[f:] for x in every[1:])  # states of effects that integrate
        self.flow = np.concatenate([self.v, self.a])
        self.count = states.shape[1]
        self.whole_states, self.states_of_effects = states, states[len(every[0]) + f :]
        self.states = np.concatenate([states[:f], states[len(every[0]) :][:f]])
        units = np.concatenate([np.zeros((1, f)), np.eye(f)])
        self.new = tuple(x[: len(self.after.free)] for x in after[1:4])
        self.new_rates_of_states = after.a[len(self.after.free) :]
        full = len(self.after.free) == f and self.after.free == self.before.free
        self.rebound = self.new[1] if full else self.v  # where a contact persists they are solved for
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
        """Changes (2 (f' + s), P) after the instant, and the changes (P, 2) of the energies at the instant."""
        hit = self._hit()
        moved = np.array([-c.gap[: self.count] / c.gap[self.count] for c in hit.contacts[: len(self.struck)]])
        nothing = NO_SHIFT * self.jumps.simulation.duration / np.array([p.width for p in self.before.parameters])
        apart = np.abs(moved - moved[0]).max(axis=0) > SAME_INSTANT * np.abs(moved).max(axis=0) + nothing
        if apart.any():
            return self._in_turn(self.before.parameters[int(np.argmax(apart))].name)
        speeds, lost = self._through(hit, moved[0])
        return self.after_instant(moved[0], speeds, lost)

    def after_instant(self, moved: Real, speeds: Real | None, lost: Real) -> tuple[Real, Real]:
        """The result for derivatives ``moved`` (P,) of the instant. ``speeds`` (f', P): derivatives of the speeds just after it,
        where the speeds jump; ``lost`` (P, 2): changes of the energies at the instant."""
        states, flow = self._asked([x for j in self.after.free for x in self.at.coordinate(j)])
        positions = states[0::2] + flow[0::2, None] * moved
        if speeds is None:
            speeds = states[1::2] + flow[1::2, None] * moved
        after = np.concatenate([positions - self.new[1][:, None] * moved, speeds - self.new[2][:, None] * moved])
        kept = self.states_of_effects + np.subtract(self.rates_of_states, self.new_rates_of_states)[:, None] * moved
        return with_state_rows(after, kept), lost + moved[:, None] * self._powers()

    def _asked(self, results: Sequence[Any]) -> tuple[Real, Real]:
        """Derivatives (m, P) by the parameters, and (m,) along the motion, of numbers of the first row."""
        directional = np.array(self.at.along(results, self.states, self.flow, (0, 1))).reshape(len(results), self.count + 1)
        return directional[:, : self.count], directional[:, self.count]

    # -- several contacts -----------------------------------------------------------------------------------------------
    def _in_turn(self, name: str) -> tuple[Real, Real]:
        """The result where a parameter separates the instants at which contacts are struck. Raises where their order matters."""
        reason = refusal(f"at t = {self.t:.6g} s several contacts are struck at once, which {name} takes apart.", SWEEP_INSTEAD)
        one, other = (p.segment for p in (self.before, self.after))
        if one.resting != other.resting or self.before.free != self.after.free or len(self.struck) > MOST_AT_ONCE:
            raise reason
        try:
            results = [self._one_after_the_other(order) for order in permutations(self.struck)]
        except MechanismError:
            raise reason from None
        half = len(self.whole_states) // 2
        for parts in zip(*((states[:half], states[half:], lost.T) for states, lost in results), strict=True):
            scale = np.abs(parts[0]).max(axis=0)
            if any((np.abs(x - parts[0]) > SAME_CHANGES * scale + 1e-300).any() for x in parts[1:]):
                raise reason
        return results[0]

    def _one_after_the_other(self, names: Sequence[str]) -> tuple[Real, Real]:
        side, states, lost = self.sides[0], self.whole_states, np.zeros((self.count, 2))
        for k, name in enumerate(names):
            later = self.sides[1]
            if k < len(names) - 1:
                jump = ImpactCrossing(self.jumps, side, side, states, [name])._hit().jump[: len(self.q)]
                v = side.v.copy()
                v[: len(jump)] += jump
                later = _side_at(self.before, self.t, side.q, v)
            states, more = ImpactCrossing(self.jumps, side, later, states, [name]).result()
            side, lost = later, lost + more
        return states, lost

    # -- impacts --------------------------------------------------------------------------------------------------------
    def _hit(self) -> _Hit:
        """The impact on all contacts that are struck, and on stops that something rests on."""
        f, count = len(self.q), len(self.struck)
        resting = [s for s in self.before.segment.resting if s.name not in self.struck]

        def contacts() -> list[Contact]:
            return [*(self._contact(name) for name in self.struck), *(self._stop(s) for s in resting)]

        known = contacts()
        inertia = reduce(self.before.compiled, self.q[None], self.v[None], np.array([self.t])).inertia[0]
        every = np.array([c.rates[4:] - c.rates[3] for c in known])
        before = np.array([c.rates[0] for c in known])
        before[count:] = 0.0
        stays = np.array([self._stays(k) for k in range(len(known))])
        flat = stays & (np.arange(len(known)) < count) & (count > 1)
        own = np.where(stays, 0.0, [c.restitution for c in known])
        own[count:] = 0.0
        mobility = every @ np.linalg.solve(inertia, every.T)
        impulses = impact(mobility, before, own, flat)
        if impulses is None:
            raise refusal(f"the impact at t = {self.t:.6g} s is not decided by impulses.", SWEEP_INSTEAD)
        p = impulses[0]
        active = [int(k) for k in np.flatnonzero((np.abs(p) > NO_IMPULSE * np.abs(p).max(initial=0.0)) | flat)]
        g, struck = every[active], before[active]
        after = (before + mobility @ p)[active]
        gone, bounce = own[active], [known[k].bounce for k in active]
        least = int(np.argmin(own[:count]))
        if (np.abs(after + gone * struck) > SAME_SPEED * np.abs(before).max()).any():  # the smallest holds for all, or zero
            smallest = float(own[least]) if np.abs(after + own[least] * struck).max() <= SAME_SPEED * np.abs(before).max() else 0.0
            gone, bounce = np.full(len(active), smallest), [known[least].bounce] * len(active)
        full = np.zeros((f + len(active), f + len(active)))
        full[:f, :f], full[:f, f:], full[f:, :f] = inertia, -g.T, g
        jump = np.linalg.solve(full, np.concatenate([np.zeros(f), -(1.0 + gone) * struck]))
        self.rows[2], accelerations = self.v + jump[:f], np.zeros_like(self.rows)
        accelerations[1] = jump[:f]
        self.at = self._instant(self.rows, accelerations)
        return _Hit(contacts(), active, gone, bounce, full, g, jump)

    def _through(self, hit: _Hit, moved: Real) -> tuple[Real, Real]:
        """Derivatives (f', P) of the rates after an impact whose instant has the derivatives ``moved`` (P,), and the changes (P, 2)
        of the energies."""
        f, jump, full, g = len(self.q), hit.jump, hit.full, hit.g
        inertia, rates = full[:f, :f], self.v + hit.jump[:f]
        wanted = self._kept(rates)
        size = max(float(np.abs(self.v).max()), float(np.abs(rates).max()), 1e-300)
        if float(np.abs(wanted - self.new[1]).max(initial=0.0)) > SAME_SPEED * size:
            raise refusal(f"the impact at t = {self.t:.6g} s goes together with other changes.", SWEEP_INSTEAD)
        efforts = [self.at.forces.effort(joint) for joint in self.before.free]
        slopes = self.at.along(efforts, self.states, self.flow, (0, 1))
        weighed = np.array([d[:, 1] - d[:, 0] for d in slopes])  # (f, P + 1): of M times the jump, at fixed jump

        def total(x: Real) -> Real:
            """Derivatives (..., P) at the moving instant, from (..., P + 1)."""
            return np.asarray(x[..., : self.count] + x[..., self.count :] * moved)

        chosen = [hit.contacts[k] for k in hit.active]
        turned = np.array([(c.slopes[:, 4:] - c.slopes[:, 3:4]).T for c in chosen])  # (c, f, P + 1): of the gradients
        known = np.concatenate([self.states[f:], self.flow[f:, None]], axis=1)
        above = weighed - np.einsum("cfp,c->fp", turned, jump[f:]) - inertia @ known
        below = np.array([c.slopes[:, 2] + e * c.slopes[:, 0] for c, e in zip(chosen, hit.gone, strict=True)])
        right = -total(np.concatenate([above, below]))
        for k, (c, e, bounce) in enumerate(zip(chosen, hit.gone, hit.bounce, strict=True)):
            if hit.active[k] < len(self.struck) and e != 0.0:
                right[f + k] -= bounce * c.rates[0]
        solved = np.asarray(np.linalg.solve(full, right), float)
        before, after = (np.array([c.rates[k] for c in chosen]) for k in (0, 2))
        rate_before = total(np.array([c.slopes[:, 0] for c in chosen]))
        rate_after = total(np.array([c.slopes[:, 2] for c in chosen])) + g @ solved[:f]
        lost = -0.5 * (solved[f:].T @ (before + after) + jump[f:] @ (rate_before + rate_after))
        return self._kept(solved[:f]), np.stack([self._pushed(moved, rates, solved[:f], lost), lost], axis=-1)

    def _stays(self, k: int) -> bool:
        """Whether a struck contact persists after the impact: then nothing rebounds."""
        if k >= len(self.struck):
            return True
        name = self.struck[k]
        return name in {s.name for s in self.after.segment.resting} or len(self.after.free) < len(self.before.free)

    def _kept(self, x: Real) -> Real:
        """Numbers (f', ...) of the free coordinates after the instant, from those (f, ...) before it."""
        return np.asarray(x[[self.before.free.index(j) for j in self.after.free]])

    def _contact(self, name: str) -> Contact:
        stop = next((s for s in self.jumps.simulation.stops if s.name == name), None)
        return self._cam(name) if stop is None else self._stop(stop)

    def _stop(self, stop: EndStop) -> Contact:
        sign = -1.0 if stop.side == "upper" else 1.0
        rows = self.at.motion.coordinate(stop.joint)
        slopes = self.at.along([rows[:, 0], rows[:, 1]], self.states, self.flow, (0, 1))
        gap = sign * slopes[0][:, 0]
        gap[: self.count] -= sign * self.jumps.condition(("stop", stop.name, "at"))
        values = np.asarray(self.at.nominal.coordinate(stop.joint))[:, 1]
        bounce = self.jumps.condition(("stop", stop.name, "restitution"))
        return Contact(gap, sign * values, sign * slopes[1], stop.restitution, bounce)

    def _cam(self, name: str) -> Contact:
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
        return Contact(gap, values, rates, own.restitution, self.jumps.condition(("cam", name)))

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
        one, other = self.sides
        return np.asarray((one.powers() - other.powers())[1:] * [1.0, -1.0])
