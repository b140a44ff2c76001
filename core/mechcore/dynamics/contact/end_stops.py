"""End stops: which are closed, and the impacts and contacts at an instant at which some are touched.

Speeds are decided first, by impulses on all stops that are touched (`impact`); then accelerations: a stop without speed stays
closed where something presses on it, and opens where it would have to pull. Both are complementarity problems over all stops.

Impacts at an instant on all contacts that are touched then follow Newton's law of restitution. Gaps that open at the rates c before
the impact open at c+ = c + W p after it, W = G M^-1 G' (G: rates of the gaps per unit rate of each coordinate). Impulses p >= 0 and
c+ >= e max(-c, 0) hold, and an impulse acts only where c+ has that least value (J. J. Moreau, Unilateral contact and dry friction
in finite freedom dynamics, 1988; F. Pfeiffer and C. Glocker, Multibody dynamics with unilateral contacts, 1996). The order of the
contacts does not matter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.dynamics.contact.dry_friction import DrySystem
from mechcore.dynamics.equations.charts import Chart, jacobian_of
from mechcore.dynamics.equations.reduced import coordinate_scales, free_of, motion_at, moving, reduced_equations, shifted
from mechcore.dynamics.events import EndStop, EventFunction, EventKind, Log, SimulationEvent, event_function_of
from mechcore.dynamics.integration.collocation import System
from mechcore.effects.masses import kinetic_energy
from mechcore.errors import Fault, MechanismError
from mechcore.motion.compiled import Compiled
from mechcore.records import dataclass
from mechcore.texts import as_coordinate, as_quantity

# Part of the scale of a coordinate: a stop nearer than this is touched; a joint that moves less in the whole duration is at rest
TOUCH_DISTANCE = 1e-11
HELD_RATE = 1e-11  # rate, in scales, per unit rate of every coordinate, below which prescribed drives or other stops lead a joint
LEAST_PULL = 1e-9  # part of the largest force above which a stop's pull, or what pushes a joint onto it, is more than rounding
LEAST_BOUNCE = 1e-6  # part of the duration: a bounce that is over sooner ends in contact
DIRECTION_RATE = 1e-200  # [rad/s or m/s] at rest on stops: too small to move anything, but its sign keeps the last sense of motion
SOON_AFTER = 1e-6  # part of the duration: a joint that begins to press within it presses now

Equations = Callable[[tuple[str, ...], Real], System]
"""Equations of motion at an instant, of joints that rest on stops and rates (f,)."""


@dataclass(frozen=True, eq=False)
class _Touched:
    """Stops ``which`` (c of them) that are touched at an instant. Their gaps open at the rates ``jacobian @ v + share``; slower
    than ``least`` (c,) they are at rest. ``responses`` (f, c): change of the rates by a unit impulse on each; ``noise`` (c,):
    second rates that are rounding; ``prescribed`` (c,): no impulse changes their rates."""

    which: tuple[int, ...]
    jacobian: Real
    share: Real
    least: Real
    responses: Real
    noise: Real
    prescribed: Flags

    @property
    def mobility(self) -> Real:
        return np.asarray(self.jacobian @ self.responses)

    def rates(self, v: Real) -> Real:
        """Rates (c,) at which the gaps open."""
        return np.asarray(self.jacobian @ v[: self.jacobian.shape[1]] + self.share)

    def part(self, chosen: Flags) -> _Touched:
        """Some of the stops (c,)."""
        which = tuple(k for k, it in zip(self.which, chosen, strict=True) if it)
        jacobian, responses, noise = self.jacobian[chosen], self.responses[:, chosen], self.noise[chosen]
        return _Touched(which, jacobian, self.share[chosen], self.least[chosen], responses, noise, self.prescribed[chosen])

    def independent(self) -> bool:
        """Whether the rates of all gaps are independent of each other."""
        scale = np.sqrt(np.diag(self.mobility))
        return not len(scale) or float(np.linalg.eigvalsh(self.mobility / np.outer(scale, scale))[0]) > HELD_RATE

    def stilled(self, v: Real) -> Real:
        """Rates (f,) without the rounding in the rates of the gaps, which have to be independent."""
        return shifted(v, -self.responses @ np.linalg.solve(self.mobility, self.rates(v))) if self.which else v


class EndStops:
    """End stops of a motion of a duration [s]; their events are recorded in a ``log``. ``closed``: the numbers of those on which
    joints rest."""

    def __init__(self, stops: Sequence[EndStop], duration: float, log: Log):
        self.stops, self._duration, self._log = tuple(stops), duration, log
        self.closed: set[int] = set()
        self._struck: set[int] = set()  # at the end of the last segment
        self._released = False  # a joint has left a stop at the end of the last segment
        self._left: dict[int, float] = {}  # time at which a stop was last left: no joint comes to rest there at that instant
        self._pulls: dict[int, float] = {}  # of stops that are touched: pulls that are rounding

    def use(self, compiled: Compiled) -> None:
        """Continue in other coordinates."""
        self.compiled = compiled
        self._free = [compiled.mechanism.drives[i].joint for i in free_of(compiled)]
        read = {joint: i for i, joint in enumerate(self._free)} if compiled.angles.exact else {}
        self._distances = [event_function_of(s, read, partial(motion_at, compiled)) for s in self.stops]
        self._signs = np.array([-1.0 if s.side == "upper" else 1.0 for s in self.stops])
        self._scales = np.array([compiled.model.coordinate_scale(s.joint) for s in self.stops])
        self._free_scales = compiled.cached(coordinate_scales)
        self._fastest = np.zeros(len(self._free))

    def _rotary(self, joint: str) -> bool:
        return self.compiled.model.rotary(joint)

    @property
    def rested(self) -> tuple[EndStop, ...]:
        """The stops on which joints rest."""
        return tuple(self.stops[k] for k in sorted(self.closed))

    @property
    def rests(self) -> tuple[str, ...]:
        """Joints that rest on stops."""
        return tuple(stop.joint for stop in self.rested)

    def gap(self, k: int, q: Real, v: Real, t: Real) -> Real:
        """Distance of a coordinate from its stop (n,) [rad or m], negative beyond it."""
        return np.asarray(self._signs[k] * self._distances[k](q, v, t))

    def check_start(self, q: Real, v: Real) -> None:
        """Raise `MechanismError` where a motion begins at q, v (f,) beyond a stop."""
        for k, stop in enumerate(self.stops):
            beyond = -float(self.gap(k, q[None], v[None], np.zeros(1))[0])
            if beyond > TOUCH_DISTANCE * self._scales[k]:
                shown = partial(as_coordinate, rotary=self._rotary(stop.joint))
                why = f"the motion starts {shown(beyond)} {'above' if stop.side == 'upper' else 'below'} the {stop.side} stop"
                why += f" '{stop.name}' at {shown(stop.at)}."
                raise MechanismError(Fault(f"joints.{stop.joint}.stops", why, "Start on the other side, or move the stop."))

    # -- in the course of a segment ------------------------------------------------------------------------------------
    def event_functions(self, q: Real, v: Real, t: float, system: System) -> list[tuple[EventFunction, float, int]]:
        """Event functions that end a segment that begins at q, v (f,), t [s]: an event function, the value that it then exceeds by
        more than rounding, and the number of the stop that is struck or left."""
        out: list[tuple[EventFunction, float, int]] = []
        for k in range(len(self.stops)):
            if k in self.closed:
                out.append((partial(self._pull, k, system), self._pulls[k], k))
            else:  # a joint that rested may have drifted beyond its stop by integration errors
                beyond = min(float(self.gap(k, q[None], v[None], np.array([t]))[0]), 0.0)
                out.append((partial(self._beyond, k, beyond), TOUCH_DISTANCE * float(self._scales[k]), k))
        return out

    def _beyond(self, k: int, least: float, q: Real, v: Real, t: Real) -> Real:
        """Distance of a coordinate beyond its stop (n,), in excess of that at the beginning, -``least``."""
        return np.asarray(least - self.gap(k, q, v, t))

    def _pull(self, k: int, system: System, q: Real, v: Real, t: Real) -> Real:
        """Force or torque with which a closed stop would have to pull (n,): negative while the joint presses on it."""
        assert isinstance(system, Chart | DrySystem)  # the others know no stops
        return np.asarray(-self._signs[k] * system.holding(q, v, t)[:, system.rests.index(self.stops[k].joint)])

    def program_rows(self, joints: Sequence[str]) -> Real | None:
        """The stops as rows (k, 5) for a program that has coordinates of ``joints``: number of the joint, position, sign, scale,
        restitution. None where the program lacks one of them, or a joint rests on a stop."""
        if self.closed or any(s.joint not in joints for s in self.stops):
            return None
        rows = zip(self.stops, self._signs, self._scales, strict=True)
        return np.array([[joints.index(s.joint), s.at, sign, scale, s.restitution] for s, sign, scale in rows]).reshape(-1, 5)

    def record_bounce(self, k: int, t: float, rate: float, lost: float) -> None:
        """Account for an impact that a program has decided: its speed, and the energy that is lost [J]."""
        self._left.clear()
        self._log.add_loss(t, lost)
        self._log_impact(t, k, rate)

    def _log_impact(self, t: float, k: int, rate: float) -> None:
        pace = as_quantity(rate, "angular speed" if self._rotary(self.stops[k].joint) else "linear speed")
        self._log_event(t, EventKind.IMPACT, k, f"hits stop {self.stops[k].name} at {pace}")

    def end(self, k: int, t: float) -> None:
        """A segment has ended at ``t`` [s] by an event function of a stop."""
        if k in self.closed:
            self._leave(k, t)
            self._released = True
        else:
            self._struck.add(k)

    # -- at an instant -------------------------------------------------------------------------------------------------
    def approached(self, q: Real, v: Real, t: float, system: System) -> list[EndStop]:
        """Touched stops, not closed, that a joint moves towards or is pushed against."""
        touched = self._touched(q, v, t)
        if touched is None:
            return []
        rates, second = touched.rates(v), self._second_rates(touched, q, v, t, system)
        against = (rates < -touched.least) | ((rates <= touched.least) & (second < -touched.noise))
        return [self.stops[k] for k, it in zip(touched.which, against, strict=True) if it and k not in self.closed]

    def resolve_impacts(self, q: Real, v: Real, t: float, equations: Equations) -> tuple[Real, bool]:
        """Resolve impacts on all stops that are touched at ``t`` [s], and which of them are closed from then on. Returns the rates
        (f,) after it, and whether anything has changed. Raises `MechanismError` where drives or other stops lead a joint through
        its stop."""
        released, self._released = self._released, False
        touched = self._touched(q, v, t)
        if touched is None:
            return v, released
        if touched.prescribed.any():
            prescribed, system = touched.part(touched.prescribed), equations(self.rests, v)
            rates = prescribed.rates(v)
            pushed = (rates <= prescribed.least) & (self._second_rates(prescribed, q, v, t, system) < -prescribed.noise)
            if (pushed | (rates < -prescribed.least)).any():
                raise self._prescribed(prescribed.which[int(np.argmax(pushed | (rates < -prescribed.least)))], t)
            touched = touched.part(~touched.prescribed)
        before = touched.rates(v)
        before[np.abs(before) <= touched.least] = 0.0
        restitution = np.array([self.stops[k].restitution for k in touched.which])
        brief = np.zeros(len(before), bool)  # a joint that would return at once stays: bounces between stops would have no end
        while True:
            after, lost = v, None
            if brief.any() or (before < 0.0).any():
                impulses = impact(touched.mobility, before, restitution, brief)
                if impulses is None:
                    raise self._prescribed(touched.which[int(np.argmin(before / touched.least))], t)
                after, lost = self._without_rounding(touched, v, shifted(v, touched.responses @ impulses[0])), impulses[1]
                self._left.clear()
            closed, second = self._pressed(touched, q, after, t, equations)
            rates = touched.rates(after)
            back = ~brief & (rates > touched.least) & (2.0 * rates < -second * LEAST_BOUNCE * self._duration)
            if not back.any():
                break
            brief |= back
        if lost is not None:
            account_for_impact(self._log, self.compiled, t, q, v, after, lost)
        for k, rate in zip(touched.which, before, strict=True):
            if rate < 0.0:
                self._log_impact(t, k, -rate)
        if lost is None and closed == self.closed:
            return v, released
        for k in touched.which:
            if k in self.closed - closed:
                self._leave(k, t)
            elif k in closed - self.closed:
                self.closed.add(k)
                self._log_event(t, EventKind.CONTACT, k, f"rests on stop {self.stops[k].name}")
        after = touched.part(np.array([k in closed for k in touched.which])).stilled(after)
        after[[self._free.index(joint) for joint in self.rests if joint in self._free]] = 0.0
        return self._without_rounding(touched, v, after), True

    def _without_rounding(self, touched: _Touched, v: Real, after: Real) -> Real:
        """Rates (f,) after contact. Where stops leave all freedoms at rest, the rates are too small to move anything but keep the
        direction of the rates ``v`` (f,) before, because an indicator diagram depends on the stroke that has led there; elsewhere
        they are unchanged."""
        slow = touched.part(np.abs(touched.rates(after)) <= touched.least)
        if not len(slow.which) == len(self._free) == len(self.compiled.mechanism.drives) or not slow.independent():
            return after
        fastest = np.abs(v[: len(self._free)]).max()
        return np.concatenate([v[: len(self._free)] * (DIRECTION_RATE / fastest if fastest else 0.0), after[len(self._free) :]])

    def _touched(self, q: Real, v: Real, t: float) -> _Touched | None:
        """The stops that are touched, in the order of their names; None where there are none."""
        row = q[None], v[None], np.array([t])
        near = [k for k in range(len(self.stops)) if k in self.closed or k in self._struck or self._touches(k, *row)]
        self._struck.clear()
        if not near:
            return None
        near.sort(key=lambda k: self.stops[k].name)
        signs, scales, joints = self._signs[near], self._scales[near], [self.stops[k].joint for k in near]
        soon = SOON_AFTER * self._duration  # a load may begin at zero
        motion, units = moving(self.compiled, np.array([q, q + soon * v]), np.array([v, v]), np.array([t, t + soon]))
        r, f = reduced_equations(motion, units), len(units)
        rows, second = jacobian_of(motion, units, joints)
        jacobian = signs[:, None] * rows[0]
        rates = [v[self._free.index(p)] if p in self._free else motion.coordinate(p)[0, 1] for p in joints]
        share = signs * rates - jacobian @ v[:f]
        self._fastest = np.maximum(self._fastest, np.abs(v[:f]))
        least = TOUCH_DISTANCE * (np.abs(jacobian) @ self._fastest + np.abs(share) + scales / self._duration)
        responses = np.linalg.solve(r.inertia[0], jacobian.T)
        noise = LEAST_PULL * ((np.abs(r.force) + np.abs(r.bias)).max(axis=0) @ np.abs(responses) + np.abs(second[0]))
        prescribed = (np.abs(jacobian) * self._free_scales / scales[:, None]).max(axis=1, initial=0.0) <= HELD_RATE
        self._pulls = dict(zip(near, noise / np.maximum(np.diag(jacobian @ responses), 1e-300), strict=True))
        return _Touched(tuple(near), jacobian, share, least, responses, noise, prescribed)

    def _touches(self, k: int, q: Real, v: Real, t: Real) -> bool:
        return abs(float(self.gap(k, q, v, t)[0])) <= TOUCH_DISTANCE * float(self._scales[k])

    def _pressed(self, touched: _Touched, q: Real, v: Real, t: float, equations: Equations) -> tuple[set[int], Real]:
        """The stops that stay closed, and second rates (c,) of all gaps then: one after the other, a stop that is pressed is
        closed, and one that would have to pull is opened, until none is left (K. G. Murty, Note on a Bard-type scheme for solving
        the complementarity problem, 1974). Whatever the order, this ends in the unique solution."""
        slow = np.abs(touched.rates(v)) <= touched.least
        closed = {k for k, it in zip(touched.which, slow, strict=True) if it and k in self.closed}
        for _ in range(2 ** len(touched.which) + 1):
            rests = tuple(self.stops[k].joint for k in sorted(closed))
            system = equations(rests, v)
            second = self._second_rates(touched, q, v, t, system)
            for j, k in enumerate(touched.which):
                if k in closed:
                    wrong = float(self._pull(k, system, q[None], v[None], np.array([t]))[0]) > self._pulls[k]
                else:
                    wrong = slow[j] and self._left.get(k) != t and self._comes(touched, j, q, v, t, system, second)
                if wrong:
                    break
            else:
                return closed, second
            closed ^= {k}
            if not touched.part(np.array([k in closed for k in touched.which])).independent():
                raise self._prescribed(k, t)
        why = f"at t = {t:.6g} s friction jams {self.stops[k].joint} on its stop '{self.stops[k].name}'."
        raise MechanismError(Fault(f"joints.{self.stops[k].joint}.stops", why, "Lower a coefficient of friction."))

    def _comes(self, touched: _Touched, j: int, q: Real, v: Real, t: float, system: System, second: Real) -> bool:
        """Whether a joint that touches a stop without speed presses on it, or will do so as soon as a load grows."""
        if abs(second[j]) > touched.noise[j]:
            return bool(second[j] < 0.0)
        soon, a = SOON_AFTER * self._duration, np.asarray(system(q[None], v[None], np.array([t])))[0]
        later = self._second_rates(touched, q + soon * v, v + soon * a, t + soon, system)
        return bool(later[j] < -touched.noise[j])

    def _second_rates(self, touched: _Touched, q: Real, v: Real, t: float, system: System) -> Real:
        """Second rates (c,) of the gaps."""
        row = q[None], v[None], np.array([t])
        a = np.asarray(system(*row))
        motion = motion_at(self.compiled, *row, a)
        joints = [self.stops[k].joint for k in touched.which]
        second = [a[0, self._free.index(p)] if p in self._free else motion.coordinate(p)[0, 2] for p in joints]
        return np.asarray(self._signs[list(touched.which)] * second)

    def _prescribed(self, k: int, t: float) -> MechanismError:
        stop = self.stops[k]
        why = (
            f"at t = {t:.6g} s {stop.joint} strikes its {stop.side} stop, but prescribed drives or other stops lead it: no impulse"
        )
        return MechanismError(
            Fault(f"joints.{stop.joint}.stops", f"{why} stops it.", "Move the stop beyond the motion, or leave it out.")
        )

    def _leave(self, k: int, t: float) -> None:
        self.closed.remove(k)
        self._left[k] = t
        self._log_event(t, EventKind.RELEASE, k, f"leaves stop {self.stops[k].name}")

    def _log_event(self, t: float, kind: EventKind, k: int, what: str) -> None:
        stop = self.stops[k]
        self._log.add(SimulationEvent(t, kind, stop.name, f"{stop.joint} {what}"))


IMPACT_ROUNDING = 1e-12  # part of the largest rate, and of the work of an impact: less is rounding
DEPENDENT_CONTACTS = 1e-11  # smallest eigenvalue of W with a unit diagonal, below which contacts depend on each other
MOST_PIVOTS = 20  # for each contact, at most


def impact(mobility: Real, rates: Real, restitution: Real, flat: Flags) -> tuple[Real, float] | None:
    """Impulses (c,) of an impact and the energy that is lost [J]; ``mobility`` W (c, c), ``rates`` (c,) at which the gaps open
    before it, a coefficient of ``restitution`` for each contact (c,).

    Contacts that are ``flat`` (c,) are closed after it, whatever impulse that takes. Where contacts are coupled, coefficients that
    differ may add energy (C. Glocker, Energetic consistency conditions for standard impacts, 2013), and more contacts than freedoms
    may not all leave with theirs: then the smallest of those that are struck holds for all, or else 0. None where no impulses turn
    all contacts back.
    """
    struck = (rates < 0.0) & ~flat
    smallest = np.minimum(restitution, restitution[struck].min(initial=1.0))
    for e in (restitution, smallest, np.zeros(len(rates))):
        impulses = _impulses(mobility, rates, e * np.maximum(-rates, 0.0), flat)
        if impulses is not None:
            lost = -0.5 * float(impulses @ (2.0 * rates + mobility @ impulses))
            if lost >= -IMPACT_ROUNDING * float(np.abs(impulses) @ np.abs(rates)) or not e.any():
                return impulses, lost
    return None


def _impulses(mobility: Real, rates: Real, least: Real, flat: Flags) -> Real | None:
    """Impulses (c,) after which gaps open at the rates ``least`` (c,) or more, and ``flat`` ones stay closed; None where there are
    none."""
    loose = ~flat
    closing = -np.linalg.pinv(mobility[np.ix_(flat, flat)], rcond=DEPENDENT_CONTACTS, hermitian=True)
    reduced = mobility[np.ix_(loose, loose)] + mobility[np.ix_(loose, flat)] @ closing @ mobility[np.ix_(flat, loose)]
    free = rates[loose] + mobility[np.ix_(loose, flat)] @ closing @ rates[flat] - least[loose]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(reduced), 1e-300))
    solution = complementary(scale[:, None] * reduced * scale, scale * free)
    if solution is None:
        return None
    out = np.zeros(len(rates))
    out[loose] = scale * solution
    out[flat] = closing @ (rates[flat] + mobility[np.ix_(flat, loose)] @ out[loose])
    return out


def complementary(matrix: Real, free: Real) -> Real | None:
    """Solution p (n,) of the linear complementarity problem p >= 0, w = matrix p + free >= 0, p'w = 0; None where there is none.

    ``matrix`` (n, n) symmetric, positive semidefinite, with a unit diagonal. An active set gains the contact that is violated most
    and loses those that would have to pull (C. L. Lawson and R. J. Hanson, Solving least squares problems, 1974, chapter 23).
    """
    p, active = np.zeros(len(free)), np.zeros(len(free), bool)
    least = IMPACT_ROUNDING * float(np.abs(free).max(initial=0.0))
    for _ in range(MOST_PIVOTS * len(free) + 1):
        missing = np.where(active, np.inf, matrix @ p + free)
        if not missing.min(initial=np.inf) < -least:
            return p
        active[np.argmin(missing)] = True
        while active.any():
            values, vectors = np.linalg.eigh(matrix[np.ix_(active, active)])
            if values[0] > DEPENDENT_CONTACTS:
                step = vectors @ ((vectors.T @ -free[active]) / values) - p[active]
                most = 1.0
            else:  # along a null vector impulses are only exchanged: until one of them is zero
                step = vectors[:, 0] * (-1.0 if float(free[active] @ vectors[:, 0]) > 0.0 else 1.0)
                most = np.inf
            falls = step < 0.0
            share = np.where(falls, p[active] / np.where(falls, -step, 1.0), np.inf)
            reach = min(most, float(share.min()))
            if not np.isfinite(reach):
                return None
            p[active] += reach * step
            if reach == 1.0 and most == 1.0 and not (share <= 1.0).any():
                break
            p[np.flatnonzero(active)[share <= reach]] = 0.0
            active[np.flatnonzero(active)[share <= reach]] = False
    return None


def account_for_impact(log: Log, compiled: Compiled, t: float, q: Real, before: Real, after: Real, lost: float) -> None:
    """Account for the energy that an impact loses [J], and for the work in it of prescribed drives, which it does not slow."""
    log.add_loss(t, lost)
    if len(free_of(compiled)) < len(compiled.mechanism.drives):
        motion = motion_at(compiled, np.array([q, q]), np.array([before, after]), np.array([t, t]))
        log.add_work(t, float(np.diff(kinetic_energy(motion))[0]) + lost)
