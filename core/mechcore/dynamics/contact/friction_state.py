"""State of dry friction in the course of a motion, across changes of contacts: which elements slide, and in which sense.

A phase is one combination of elements that slide in a sense and elements that stick; here is what ends it, and what follows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache, partial

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.constants import REST
from mechcore.dynamics.contact.dry_friction import DrySystem, least_efforts, rates_of
from mechcore.dynamics.equations.charts import jacobian_of
from mechcore.dynamics.equations.contacts import contact_program
from mechcore.dynamics.equations.reduced import (
    ReducedEquations,
    constrained,
    coordinate_scales,
    free_of,
    motion_at,
    moving,
    reduced_equations,
    shifted,
)
from mechcore.dynamics.events import EventFunction, EventKind, Log, SimulationEvent
from mechcore.dynamics.integration.collocation import Window
from mechcore.errors import Fault, MechanismError
from mechcore.forces.friction.elements import Element, elements_of, scales_of
from mechcore.kinematics.model import Model
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.spec.mechanism import joints_with_friction
from mechcore.texts import Text

TURN_BACK_WINDOWS = 10.0  # times `sense_delay`: in shorter windows prescribed drives turn back


class FrictionState:
    """The friction phases of the present mechanism, and the sense in which every element slides (0: sticks), recorded in a ``log``.

    ``counts``: whether the mechanism names friction among its effects. ``sense_delay`` [s]: as in `FrictionPhases`.
    """

    def __init__(self, counts: bool, sense_delay: float, log: Log):
        self.counts, self._sense_delay, self._log = counts, sense_delay, log
        self._phases: FrictionPhases | None = None
        self._sliding: dict[ElementKey, float] = {}

    def begin(self, compiled: Compiled, t: float, q: Real, v: Real) -> None:
        """Begin the phases of a mechanism with other contacts than before; elements that slide continue to do so. Where every drive
        is prescribed there are no phases: friction follows from statics. Raises `MechanismError`."""
        self._phases = self._phases_of(compiled, t, q, v)

    def _phases_of(self, compiled: Compiled, t: float, q: Real, v: Real) -> FrictionPhases | None:
        if not (self.counts and len(q)):
            return None
        if self._phases is not None:
            self._sliding |= dict(zip(self._phases.keys, self._phases.signs.tolist(), strict=True))
        return friction_phases(compiled, q, v, t, self._sliding, self._sense_delay)

    def system(self) -> DrySystem | None:
        """The present equations of motion; None where there are no friction phases."""
        return None if self._phases is None else self._phases.system()

    def equations_of(self, compiled: Compiled, q: Real, v: Real, t: float, *, rests: tuple[str, ...]) -> DrySystem | None:
        """The equations of motion at an instant of a mechanism with other contacts; None where it has no friction."""
        phases = self._phases_of(compiled, t, q, v)
        if phases is None:
            return None
        phases.decide(t, q, v, rests=rests)
        return phases.system()

    def slip_ends(self) -> tuple[list[tuple[EventFunction, bool]], list[EventFunction]]:
        """Event functions that end the slip of elements, and that of prescribed ones, see `FrictionPhases.slip_ends` and
        `FrictionPhases.independent_event_functions`."""
        return ([], []) if self._phases is None else (self._phases.slip_ends(), self._phases.independent_event_functions())

    def stick_ends(self, q: Real, v: Real, t: float) -> list[tuple[EventFunction, float, tuple[int, float]]]:
        """Event functions that end the sticking of elements, as in `FrictionPhases.stick_ends`."""
        return [] if self._phases is None else self._phases.stick_ends(q, v, t)

    def settle(self, t: float, q: Real, v: Real, rests: tuple[str, ...], loose: tuple[int, float] | None = None) -> Real:
        """Decide which elements slide and which stick from now on; speeds (f,) after it, without the relative speeds of elements
        that stick. ``rests``: joints that rest on stops; ``loose``: as in `FrictionPhases.decide`."""
        if self._phases is None:
            return v
        before = self._phases.signs
        settled = None if rests else self._phases.decide_by_program(t, q, v, loose)
        if settled is None:
            self._phases.decide(t, q, v, loose, rests)
        self._record(t, self._phases.changes(before))
        return self._phases.at_rest(t, q, v) if settled is None else settled

    def known_signs(self, compiled: Compiled) -> tuple[Real, Real] | None:
        """Scales and signs (e,) of the elements; None where prescribed drives move some of them."""
        if self._phases is None:
            return None if self.counts and joints_with_friction(compiled.mechanism.joints) else (np.zeros(0), np.zeros(0))
        return None if self._phases.prescribed.any() else (self._phases.scales, self._phases.signs)

    def adopt_signs(self, t: float, signs: Real) -> None:
        """Adopt the ``signs`` (e,) of sliding that a program has decided, from a time [s] on."""
        if self._phases is not None and signs.tobytes() != self._phases.signs.tobytes():
            before, self._phases.signs = self._phases.signs, signs
            self._record(t, self._phases.changes(before))

    def _record(self, t: float, changes: Sequence[tuple[str, int]]) -> None:
        for joint, sign in changes:
            self._log_event(t, joint, sign)

    def follow(self, compiled: Compiled, window: Window) -> None:
        """Record the sense in which joints slide in a window where every drive is prescribed; windows end where it changes."""
        if not self.counts:
            return
        middle = np.array([window.start + 0.5 * window.length])
        motion = motion_at(compiled, *window(middle)[:2], middle)
        turning = window.length < TURN_BACK_WINDOWS * self._sense_delay  # there it is at rest for an instant only
        for key, sign in zip(keys_of(elements_of(motion)), senses(motion)[0], strict=True):
            if sign != self._sliding.get(key, 0.0) and not (turning and sign == 0.0):
                self._log_event(window.start, key[0], int(sign))
                self._sliding[key] = float(sign)

    def _log_event(self, t: float, joint: str, sign: int) -> None:
        """A joint begins to stick (sign 0) or to slide."""
        event, known = SimulationEvent(t, *_slip_or_stick(joint, sign), sign), self._log.events
        if not (known and known[-1].time == t and event in known[-4:]):  # a joint may have friction of several kinds
            self._log.add(event)


@lru_cache(256)
def _slip_or_stick(joint: str, sign: int) -> tuple[EventKind, str, Text]:
    if not sign:
        return EventKind.STICK, joint, Text(f"{joint} sticks")
    return EventKind.SLIP, joint, Text(f"{joint} slides in the {'+' if sign > 0 else '-'} direction")


ElementKey = tuple[str, str, str]
Here = tuple[Motion, list[Motion], list[Element], ReducedEquations]
"""At one state: the motion with q'' = 0, its tangents, the elements of friction, and the equations of motion without it."""
NO_EFFECT = 1e-12  # part of an element's unconstrained response to a force: a smaller one is rounding
STICKING_ROUNDING = 1e-10  # part of the limit of sticking: a smaller excess is rounding
STARTING_RATE = 1e-12  # rate of an element that just begins to move
SOON_MOVED = 1e-16  # part of its scale: an element that moves less within `sense_delay` is at rest


class FrictionPhases:
    """Which elements slide, in which sense, and which stick, and what ends such a phase; ``signs`` (e,) as in `DrySystem`.

    ``rests``: joints that rest on end stops. ``sense_delay`` [s]: delay after which the sense of sliding is taken for elements that
    no free coordinate moves, because prescribed drives or stops lead them. ``before``: signs to keep, of the mechanism with other
    contacts.
    """

    def __init__(
        self,
        compiled: Compiled,
        keys: Sequence[ElementKey],
        scales: Real,
        sense_delay: float,
        before: Mapping[ElementKey, float] | None = None,
    ):
        self.compiled, self.keys, self.scales = compiled, keys, scales
        self.sense_delay = sense_delay
        self.signs = np.array([(before or {}).get(key, 0.0) for key in self.keys])
        self.rests: tuple[str, ...] = ()
        self.prescribed = np.zeros(len(keys), bool)
        self._known: tuple[tuple[float, bytes, bytes], Here] | None = None
        self.alone = len(free_of(compiled)) == len(compiled.mechanism.drives) == 1
        self._apart = len({key[:2] for key in keys}) == len(keys)  # one element for every relative motion

    def system(self) -> DrySystem:
        return DrySystem(self.compiled, self.signs.copy(), rests=self.rests)

    def decide_by_program(self, t: float, q: Real, v: Real, loose: tuple[int, float] | None) -> Real | None:
        """`decide` and `at_rest` where nothing rests on stops, by a compiled program; None where it does not decide."""
        program = contact_program(self.compiled, ())
        if program is None or not program.has_phases:
            return None
        settled = program.settled(t, q, v, (self.scales, self.signs), self.sense_delay, loose)
        if settled is None:
            return None
        self.rests, self.prescribed = (), np.zeros(len(self.keys), bool)
        self.signs, rates = settled
        return rates

    def decide(self, t: float, q: Real, v: Real, loose: tuple[int, float] | None = None, rests: tuple[str, ...] = ()) -> None:
        """Choose the signs from now on.

        ``loose``: an element that has just come loose and, with one freedom, the sense in which it moves (else 0). ``rests``:
        joints that rest on end stops.
        """
        before = self.signs.copy()
        self.rests = rests
        row = q[None], v[None], np.array([t])
        motion, _, elements, equations = here = self._at(t, q, v)
        rate = np.array([e.rate[0] for e in elements])
        alone = self.alone and not rests
        self.prescribed = np.zeros(len(before), bool) if alone else self._prescribed(here)
        scale, own = scales_of(motion.model, elements), coordinate_scales(self.compiled)
        f = len(own)
        driven = equations.acceleration()[0] / own if f else np.zeros(1)
        pace = max(
            float((np.abs(rate) / scale).max()),
            float((np.abs(v[:f]) / own).max(initial=0.0)),
            float(np.sqrt(np.abs(driven).max())),
        )
        least = max(REST * pace, SOON_MOVED / self.sense_delay)  # scales of coordinates per second
        still = np.abs(rate) <= least * scale
        self.signs = np.where(still, 0.0, np.sign(rate))
        if self.prescribed.any():
            self.signs[self.prescribed] = self._senses(q[None], v[None], np.array([t + self.sense_delay]))[0, self.prescribed]
            still &= ~self.prescribed
        if alone and still.all() and abs(float(v[0])) <= least * own[0]:
            self.signs = self._sense_from_rest(row) if loose is None else self.directions(row, loose[1])
        elif alone and still.any():  # the mechanism moves: a joint that turns back there does not stick
            self.signs = np.where(still, np.where(before == 0.0, 1.0, before), np.sign(rate))
            second = np.sign(self.system().solve(*row).second[0])
            self.signs = np.where(still & (second != 0.0), second, self.signs)
        elif still.any():
            if loose is not None and still[loose[0]]:
                friction = DrySystem(self.compiled, np.where(still, 0.0, self.signs), rests=rests).solve(*row)
                sense = self.signs[loose[0]] = -np.sign(friction.value[0, loose[0]])
                together = np.array([key[:2] == self.keys[loose[0]][:2] for key in self.keys])
                self.signs[together & still & (before == sense)] = sense  # elements that move with it, and were at their limits
            for _ in range(2 * len(before) + 2):
                friction = self.system().solve(*row)
                over = still & (self.signs == 0.0) & (np.abs(friction.value[0]) > friction.limit[0] * (1.0 + 1e-12))
                if not over.any():
                    break
                worst = int(np.argmax(np.where(over, np.abs(friction.value[0]) / np.maximum(friction.limit[0], 1e-300), 0.0)))
                self.signs[worst] = -np.sign(friction.value[0, worst])

    def changes(self, before: Real) -> list[tuple[str, int]]:
        """Joint and sign (1, -1, 0: it sticks) of each element whose sign differs from that ``before`` (e,)."""
        if self._apart:
            both = zip(self.keys, before.tolist(), self.signs.tolist(), strict=True)
            return [(key[0], int(now)) for key, then, now in both if now != then]
        then, now = self._states(before), self._states(self.signs)
        return [(joint, int(sign)) for (joint, what), sign in now.items() if sign != then[joint, what]]

    def _states(self, signs: Real) -> dict[tuple[str, str], float]:
        """Sign by joint and relative motion: the joint sticks if friction of one kind holds it, whatever other friction acts
        there."""
        states: dict[tuple[str, str], float] = {}
        for (joint, what, _), s in zip(self.keys, signs.tolist(), strict=True):
            states[joint, what] = s if states.get((joint, what), s) == s else 0.0
        return states

    def at_rest(self, t: float, q: Real, v: Real) -> Real:
        """Speeds (f,) without the rounding in the relative speeds of the elements that stick."""
        stuck = np.flatnonzero((self.signs == 0.0) & ~self.prescribed)
        if not len(stuck):
            return v
        if self.alone:
            return np.append(0.0, v[1:])
        motion, units, elements, equations = self._at(t, q, v)
        tau = np.stack([rates_of(units, elements[i])[0] for i in stuck])
        response = constrained(equations.inertia[:, None], tau[None], jacobian_of(motion, units, self.rests)[0])[0][0].T
        need = least_efforts(tau @ response, scales_of(motion.model, elements)[stuck])
        return shifted(v, -response @ need @ np.array([elements[i].rate[0] for i in stuck]))

    def _at(self, t: float, q: Real, v: Real) -> Here:
        """Values at a state; those of the last state are kept."""
        key = t, q.tobytes(), v.tobytes()
        if self._known is None or self._known[0] != key:
            motion, units = moving(self.compiled, q[None], v[None], np.array([t]))
            self._known = key, (motion, units, elements_of(motion), reduced_equations(motion, units))
        return self._known[1]

    def _prescribed(self, here: Here) -> Flags:
        """Elements (e,) that no force moves, because drives lead them or stops hold them."""
        motion, units, elements, equations = here
        tau = np.stack([rates_of(units, e) for e in elements], axis=1)
        inertia, (rows, _) = equations.inertia, jacobian_of(motion, units, self.rests)
        freely, really = (np.einsum("nef,nef->ne", tau, constrained(inertia[:, None], tau, g)[0])[0] for g in (rows[:, :0], rows))
        return np.asarray(~(really > NO_EFFECT * freely))

    def _sense_from_rest(self, row: tuple[Real, Real, Real]) -> Real:
        """Signs (e,) of one freedom at rest: it moves in the sense in which it would then accelerate, or sticks (0)."""
        for sense in (1.0, -1.0):
            signs = self.directions(row, sense)
            if float(self._free(sense, *row)[0]) > 0.0:
                return signs
        return np.zeros(len(self.signs))

    def directions(self, row: tuple[Real, Real, Real], sense: float) -> Real:
        """Signs of the elements' speeds (e,) where the only coordinate moves in the ``sense`` 1 or -1."""
        q, v, t = row
        return np.asarray(np.sign(self.system().rates(q[:1], sense * np.ones_like(v[:1]), t[:1])[0]))

    def slip_ends(self) -> list[tuple[EventFunction, bool]]:
        """Relative rates that end the slip of an element where they pass zero, and whether they rise there."""
        return [(partial(self._rate, i), bool(s < 0)) for i, s in enumerate(self.signs) if s != 0.0 and not self.prescribed[i]]

    def stick_ends(self, q: Real, v: Real, t: float) -> list[tuple[EventFunction, float, tuple[int, float]]]:
        """Event functions that end the sticking of an element in a phase that begins at q, v (f,), t [s]: an event function that
        then exceeds zero, by how much it may do so by rounding, and the element that comes loose (see `decide`)."""
        row = q[None], v[None], np.array([t])
        stuck = np.flatnonzero((self.signs == 0.0) & ~self.prescribed)
        if not len(stuck):
            return []
        if not np.any(self.signs) and self.alone and not self.rests:
            noise = STICKING_ROUNDING * sum(abs(float(self._free(sense, *row)[0])) for sense in (1.0, -1.0))
            return [(partial(self._free, sense), noise, (0, sense)) for sense in (1.0, -1.0)]
        system = self.system()
        friction = system.solve(*row)
        noise = STICKING_ROUNDING * (friction.limit[0] + np.abs(friction.value[0]))
        return [(partial(_excess, system, int(i)), float(noise[i]), (int(i), 0.0)) for i in stuck]

    def independent_event_functions(self) -> list[EventFunction]:
        """Event functions that are 1 where a prescribed element does not slide in its present sense, else 0."""
        return [partial(self._other_sense, int(i), self.signs[i]) for i in np.flatnonzero(self.prescribed)]

    def _other_sense(self, i: int, sign: float, q: Real, v: Real, t: Real) -> Real:
        return np.asarray(self._senses(q, v, t)[:, i] != sign, float)

    def _senses(self, q: Real, v: Real, t: Real) -> Real:
        return senses(moving(self.compiled, q, v, t)[0])

    def _rate(self, i: int, q: Real, v: Real, t: Real) -> Real:
        return self.system().rates(q, v, t)[:, i]

    def _free(self, sense: float, q: Real, v: Real, t: Real) -> Real:
        """Acceleration (n,) of the freedom at rest in the ``sense`` 1 or -1, if it began to move that way: forces that depend on
        the sense of motion (gas in a cylinder) are those of that sense."""
        signs = self.directions((q, v, t), sense)
        begun = np.column_stack([np.full(len(v), sense * STARTING_RATE), v[:, 1:]])
        return np.asarray(sense * DrySystem(self.compiled, signs, breaking=True)(q, begun, t)[:, 0])


def _excess(system: DrySystem, i: int, q: Real, v: Real, t: Real) -> Real:
    """Excess (n,) of the friction that would hold a sticking element over its limit."""
    friction = system.solve(q, v, t)
    return np.asarray(np.abs(friction.value[:, i]) - friction.limit[:, i])


def braking_elements(compiled: Compiled, q: Real, v: Real, t: float = 0.0) -> list[Element]:
    """The elements of a mechanism, in the order in which signs are given; [] where it has no friction."""
    if "friction" not in compiled.mechanism.effects:
        return []
    return elements_of(moving(compiled, q[None], v[None], np.array([t]))[0])


def senses(motion: Motion) -> Real:
    """Sense in which all elements slide (n, e): 1, -1, or 0 where their speeds are negligible beside those of the mechanism."""
    elements = elements_of(motion)
    rates = np.stack([e.rate for e in elements], axis=1)
    turning = np.max([np.abs(w) * np.ones(motion.frames) for w in motion.speeds.angular], axis=0, initial=0.0)
    sliding = np.max([np.abs(x) * np.ones(motion.frames) for x in motion.speeds.slide.values()], axis=0, initial=0.0)
    size = np.maximum(turning, sliding / motion.model.length_scale)[:, None]
    return np.where(np.abs(rates) <= REST * size * scales_of(motion.model, elements), 0.0, np.sign(rates))


def keys_of(elements: Sequence[Element]) -> list[ElementKey]:
    """Keys of elements, independent of the mechanism's other contacts."""
    return [(e.joint, e.what, e.kind) for e in elements]


def friction_phases(
    compiled: Compiled, q: Real, v: Real, t: float, before: Mapping[ElementKey, float], sense_delay: float
) -> FrictionPhases | None:
    """Friction phases of a mechanism, see `FrictionPhases`; None where it has no friction. Raises `MechanismError`."""
    known = compiled.model.cached(_elements_known)
    if not known:
        elements = braking_elements(compiled, q, v, t)
        for e in elements:
            if e.what == "slide" and e.index < 0:
                why = "friction between a cam and its follower while forces move the cam: what sticks there is not found."
                raise MechanismError(
                    Fault(f"joints.{e.joint}.friction", why, "Prescribe the cam's drive, or leave its friction out.")
                )
        known.append((keys_of(elements), scales_of(compiled.model, elements)))
    keys, scales = known[0]
    return FrictionPhases(compiled, keys, scales, sense_delay, before) if keys else None


def _elements_known(_: Model) -> list[tuple[list[ElementKey], Real]]:
    return []
