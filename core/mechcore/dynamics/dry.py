"""Dry friction in forward dynamics: accelerations, normal loads and friction that depend on each other, solved together.

While the signs of the relative speeds stay, friction at element i is lambda_i = -sign_i factor_i g_i with the normal load
g_i = |a_i + K_i g|, as in kinetostatics (`mechcore.friction`); only that the free coordinates answer to friction by acceleration:
a unit of friction comes with the inertia forces of the acceleration that it causes, and so needs no drive. An element that sticks
has no relative acceleration; the friction that this takes is linear in the others and is eliminated. It sticks as long as that is
within its limit: the law is set-valued, nothing is smoothed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..closed_forms import cross
from ..effects import Wrench, sum_up, wrenches
from ..errors import Fault, MechanismError
from ..friction.elements import Element, elements_of, relative_rate
from ..friction.fixedpoint import solve_normal_loads
from ..friction.response import Response, pick, system
from ..friction.result import FrictionResult
from ..kinetostatics import Forces, transmit
from ..motion import Motion
from ..solve import Compiled
from .chart import differences, rows_of
from .reduced import free_of, moving, reduced_equations, solved, with_rates

__all__ = ["WORDS", "Dry", "DrySystem", "Key", "Phases", "braking_elements", "forces_with", "keys_of", "rubbing", "senses"]

Array = NDArray[np.float64]
Key = tuple[str, str, str]
WORDS = {0.0: "stick", 1.0: "slip +", -1.0: "slip -"}
LED = 1e-12  # part of what a force on an element would move, if it did, that is rounding
BEGUN = 1e-12  # rate of what just begins to move
REST = 1e-9  # relative speeds below this part of the largest (or of 1) are rest


@dataclass(frozen=True, eq=False)
class Dry:
    """What friction does: accelerations (n, f); friction ``value``, the ``limit`` up to which it sticks, relative ``rate`` and
    ``second`` rate of every element (n, e)."""

    acceleration: Array
    value: Array
    limit: Array
    rate: Array
    second: Array


class GivenFriction(FrictionResult):
    """Friction of a motion that forward dynamics has found, sticking included: ``values`` (F, e) along the elements' unit
    wrenches."""

    def __init__(self, motion: Motion, applied: Sequence[Wrench], elements: Sequence[Element], found: Dry, passed: Any):
        self.motion = motion
        self.stability = np.ones(motion.frames)
        self.elements = tuple(elements)
        self.jammed = np.zeros(motion.frames, bool)
        self.reached = np.ones(motion.frames)
        self._applied = tuple(applied)
        self._found = found
        self._passed = passed  # what joints and relations transmit

    @property
    def _transmitted(self) -> Any:
        return self._passed

    def value(self, i: int) -> Array:
        return self._found.value[:, i]

    def normal_load(self, pair: str) -> Array:
        i = self._elements_of(pair)[0]
        e = self.elements[i]
        return np.asarray(self._found.limit[:, i] / (e.factor * _sticking(e)) if e.factor else np.full(self.motion.frames, np.nan))

    def losses(self, pair: str) -> Array:
        return -sum((self.value(i) * self._found.rate[:, i] for i in self._elements_of(pair)), np.zeros(self.motion.frames))


def forces_with(motion: Motion, system: DrySystem, q: Array, v: Array, held: Sequence[Wrench] = ()) -> Forces:
    """Reactions of a piece of motion, with the friction that the piece has, sticking included; ``held``: what end stops hold."""
    found = system.solve(q, v, motion.time)
    applied = (*wrenches(motion), *held)
    force, moment = sum_up(list(applied), len(motion.model.links))
    elements = [replace(e, sign=np.full(motion.frames, s)) for e, s in zip(elements_of(motion), system.signs, strict=True)]
    for i, e in enumerate(elements):
        e.load(motion, force, moment, found.value[:, i])
    passed = transmit(motion, force, moment)
    return Forces(motion, applied, *passed[:2], GivenFriction(motion, applied, elements, found, passed))


class Phases:
    """Which elements slide which way and which stick, and what ends that; ``signs`` (e,) as in `DrySystem`.

    ``rests``: pairs that rest on end stops. ``soon`` [s]: elements that no free coordinate moves, because prescribed drives or
        stops lead them, slide as they do so much later. ``before``: signs that go on, of the mechanism with other contacts.
    """

    def __init__(self, compiled: Compiled, elements: Sequence[Element], soon: float, before: Mapping[Key, float] | None = None):
        self.compiled = compiled
        self.soon = soon
        self.keys = keys_of(elements)
        self.signs = np.array([(before or {}).get(key, 0.0) for key in self.keys])
        self.rests: tuple[str, ...] = ()
        self.led = np.zeros(len(elements), bool)
        self.alone = len(free_of(compiled)) == len(compiled.mechanism.drives) == 1

    def system(self) -> DrySystem:
        return DrySystem(self.compiled, self.signs.copy(), rests=self.rests)

    def decide(
        self, t: float, q: Array, v: Array, loose: tuple[int, float] | None = None, rests: tuple[str, ...] = ()
    ) -> list[tuple[str, str]]:
        """Choose the signs for what follows; pair and word ("stick", "slip +", "slip -") of each that has changed.

        ``loose``: an element that has just come loose and, with one freedom, the way in which it moves (else 0). ``rests``: pairs
        that rest on end stops.
        """
        before = self.signs.copy()
        self.rests = rests
        row = q[None], v[None], np.array([t])
        motion, units = moving(self.compiled, *row)
        elements = elements_of(motion)
        rate = np.array([e.rate[0] for e in elements])
        alone = self.alone and not rests
        self.led = np.zeros(len(before), bool) if alone else self._led(motion, units, elements)
        still = np.abs(rate) <= REST * max(1.0, float(np.abs(rate).max()), float(np.abs(v).max()))
        self.signs = np.where(still, 0.0, np.sign(rate))
        if self.led.any():
            self.signs[self.led] = self._senses(q[None], v[None], np.array([t + self.soon]))[0, self.led]
            still &= ~self.led
        if alone and still.all() and abs(float(v[0])) <= REST * max(1.0, float(np.abs(rate).max())):
            self.signs = self._either_way(row) if loose is None else self.directions(row, loose[1])
        elif alone and still.any():  # the mechanism moves: a pair that turns back there does not stick
            self.signs = np.where(still, np.where(before == 0.0, 1.0, before), np.sign(rate))
            second = np.sign(self.system().solve(*row).second[0])
            self.signs = np.where(still & (second != 0.0), second, self.signs)
        elif still.any():
            if loose is not None and still[loose[0]]:
                found = DrySystem(self.compiled, np.where(still, 0.0, self.signs), rests=rests).solve(*row)
                self.signs[loose[0]] = -np.sign(found.value[0, loose[0]])
            for _ in range(2 * len(before) + 2):
                found = self.system().solve(*row)
                over = still & (self.signs == 0.0) & (np.abs(found.value[0]) > found.limit[0] * (1.0 + 1e-12))
                if not over.any():
                    break
                worst = int(np.argmax(np.where(over, np.abs(found.value[0]) / np.maximum(found.limit[0], 1e-300), 0.0)))
                self.signs[worst] = -np.sign(found.value[0, worst])
        then, now = self._states(before), self._states(self.signs)
        return [(pair, WORDS[now[pair, what]]) for pair, what in now if now[pair, what] != then[pair, what]]

    def _states(self, signs: Array) -> dict[tuple[str, str], float]:
        """Sign by pair and relative motion: it sticks if friction of one kind holds it, whatever else rubs there."""
        found: dict[tuple[str, str], float] = {}
        for (pair, what, _), s in zip(self.keys, signs, strict=True):
            found[pair, what] = float(s) if found.get((pair, what), s) == s else 0.0
        return found

    def at_rest(self, t: float, q: Array, v: Array) -> Array:
        """Speeds (f,) without what rounding has left of the relative speeds of the elements that stick."""
        stuck = np.flatnonzero((self.signs == 0.0) & ~self.led)
        if not len(stuck):
            return v
        if self.alone:
            return np.zeros(1)
        motion, units = moving(self.compiled, q[None], v[None], np.array([t]))
        elements = elements_of(motion)
        tau = np.stack([_rates_of(units, elements[i])[0] for i in stuck])
        inertia = reduced_equations(motion, units).inertia
        answer = answers_to(inertia[:, None], tau[None], rows_of(motion, units, self.rests)[0])[0].T
        return np.asarray(v - answer @ np.linalg.pinv(tau @ answer, rcond=1e-10) @ np.array([elements[i].rate[0] for i in stuck]))

    def _led(self, motion: Motion, units: Sequence[Motion], elements: Sequence[Element]) -> NDArray[np.bool_]:
        """Elements (e,) that no force moves: the drives lead them, or stops hold them."""
        tau = np.stack([_rates_of(units, e) for e in elements], axis=1)
        inertia, (rows, _) = reduced_equations(motion, units).inertia, rows_of(motion, units, self.rests)
        freely, really = (np.einsum("nef,nef->ne", tau, answers_to(inertia[:, None], tau, g))[0] for g in (rows[:, :0], rows))
        return np.asarray(~(really > LED * freely))

    def _either_way(self, row: tuple[Array, Array, Array]) -> Array:
        """One freedom at rest: it moves the way in which it then really accelerates, or sticks."""
        for way in (1.0, -1.0):
            signs = self.directions(row, way)
            if float(self._free(way, *row)[0]) > 0.0:
                return signs
        return np.zeros(len(self.signs))

    def directions(self, row: tuple[Array, Array, Array], way: float) -> Array:
        """Signs of the elements' speeds where the only coordinate moves one way (e,)."""
        q, v, t = row
        motion = moving(self.compiled, q[:1], way * np.ones_like(v[:1]), t[:1])[0]
        return np.array([float(np.sign(e.rate[0])) for e in elements_of(motion)])

    def gauges(self) -> list[tuple[Any, bool, tuple[int, float] | None]]:
        """What ends the phase: gauge, the way in which it has to pass zero, and what then comes loose, as `decide` wants it."""
        system = self.system()
        out: list[tuple[Any, bool, tuple[int, float] | None]] = []
        for i, s in enumerate(self.signs):
            if s != 0.0 and not self.led[i]:
                out.append((lambda q, v, t, i=i: self._rate(i, q, v, t), bool(s < 0), None))
        stuck_ones = np.flatnonzero((self.signs == 0.0) & ~self.led)
        if not len(stuck_ones):
            return out
        if not np.any(self.signs) and self.alone and not self.rests:
            for way in (1.0, -1.0):
                out.append((lambda q, v, t, way=way: self._free(way, q, v, t), True, (0, way)))
            return out
        for stuck in stuck_ones:

            def margin(q: Array, v: Array, t: Array, i: int = int(stuck)) -> Array:
                found = system.solve(q, v, t)
                return np.asarray(found.limit[:, i] - np.abs(found.value[:, i]))

            out.append((margin, False, (int(stuck), 0.0)))
        return out

    def led_gauges(self) -> list[Any]:
        """Gauges that are 1 where an element that is led does not slide as it does now, else 0."""
        return [
            lambda q, v, t, i=int(i), s=self.signs[i]: np.asarray(self._senses(q, v, t)[:, i] != s, float)
            for i in np.flatnonzero(self.led)
        ]

    def _senses(self, q: Array, v: Array, t: Array) -> Array:
        return senses(moving(self.compiled, q, v, t)[0])

    def _rate(self, i: int, q: Array, v: Array, t: Array) -> Array:
        motion = moving(self.compiled, q, v, t)[0]
        e = elements_of(motion)[i]
        return np.asarray(e.rate)

    def _free(self, way: float, q: Array, v: Array, t: Array) -> Array:
        """Acceleration (n,) in the sense ``way`` of what rests, if it began to move that way: forces that depend on the sense of
        the motion (gas in a cylinder) are those of that sense."""
        signs = self.directions((q, v, t), way)
        begun = np.full_like(v, way * BEGUN)
        return np.asarray(way * DrySystem(self.compiled, signs, breaking=True)(q, begun, t)[:, 0])


def braking_elements(compiled: Compiled, q: Array, v: Array, t: float = 0.0) -> list[Element]:
    """The elements of a mechanism, in the order in which signs are given; [] where it has no friction."""
    if "friction" not in compiled.mechanism.effects:
        return []
    return elements_of(moving(compiled, q[None], v[None], np.array([t]))[0])


def senses(motion: Motion) -> Array:
    """Which way all elements slide (n, e): 1, -1, or 0 where their speeds are nothing beside those of the mechanism."""
    elements = elements_of(motion)
    rates = np.stack([e.rate for e in elements], axis=1)
    turning = np.max([np.abs(w) * np.ones(motion.frames) for w in motion.speeds.spin], axis=0, initial=0.0)
    sliding = np.max([np.abs(x) * np.ones(motion.frames) for x in motion.speeds.slide.values()], axis=0, initial=0.0)
    size = np.maximum(turning, sliding / motion.model.size)[:, None]
    least = np.array([1.0 if e.what == "turn" else motion.model.size for e in elements])
    return np.where(np.abs(rates) <= REST * size * least, 0.0, np.sign(rates))


def keys_of(elements: Sequence[Element]) -> list[Key]:
    """What an element is called, whatever other contacts the mechanism has."""
    return [(e.pair, e.what, e.kind) for e in elements]


def rubbing(compiled: Compiled, q: Array, v: Array, t: float, before: Mapping[Key, float], soon: float) -> Phases | None:
    """Phases of a mechanism that moves, see `Phases`; None where it has no friction. Raises `MechanismError`."""
    elements = braking_elements(compiled, q, v, t)
    for e in elements:
        if e.what == "slide" and e.joint < 0:
            why = "friction between a cam and its follower while forces move the cam: what sticks there is not found."
            raise MechanismError(Fault(f"pairs.{e.pair}.friction", why, "Prescribe the cam's drive, or leave its friction out."))
    return Phases(compiled, elements, soon, before) if elements else None


def answers_to(inertia: Array, force: Array, rows: Array, second: Array | None = None) -> Array:
    """Accelerations a (n, ..., f) under generalised forces Q (n, ..., f): M a = Q + G' p and G a + b = 0, ``rows`` G (n, p, f)."""
    f, p = rows.shape[2], rows.shape[1]
    if p:
        g = rows.reshape(len(rows), *[1] * (force.ndim - 2), p, f)
        full = np.zeros((*np.broadcast_shapes(inertia.shape[:-2], g.shape[:-2]), f + p, f + p))
        full[..., :f, :f], full[..., :f, f:], full[..., f:, :f] = inertia, -g.swapaxes(-1, -2), g
        right = np.zeros((*force.shape[:-1], p)) if second is None else -second
        inertia, force = full, np.concatenate([force, right], axis=-1)
    try:
        return np.asarray(np.linalg.solve(inertia, force[..., None])[..., 0], float)[..., :f]
    except np.linalg.LinAlgError:  # one of many, frame by frame
        each = np.broadcast_to(inertia, (*force.shape, force.shape[-1]))
        return solved(each.reshape(-1, *each.shape[-2:]), force.reshape(-1, force.shape[-1])).reshape(force.shape)[..., :f]


class DrySystem:
    """Accelerations (n, f) with friction: ``signs`` (e,) of the elements' relative speeds, 0 where they stick.

    ``breaking``: with the coefficients of sticking everywhere, to see whether it comes loose. ``rests``: pairs that keep their
    coordinates, because they rest on end stops; what these hold comes before friction that could do it as well.
    """

    def __init__(self, compiled: Compiled, signs: Array, *, breaking: bool = False, rests: Sequence[str] = ()):
        self.compiled = compiled
        self.signs = signs
        self.breaking = breaking
        self.rests = tuple(rests)

    def holding(self, q: Array, v: Array, t: Array) -> Array:
        """What keeps the pairs at rest (n, p): torque [N m] or force [N] in the direction of each one's coordinate."""
        motion, units = moving(self.compiled, q, v, t)
        r, found = reduced_equations(motion, units), self.solve(q, v, t)
        tau = np.stack([_rates_of(units, e) for e in elements_of(motion)], axis=1)
        missing = (r.inertia @ found.acceleration[..., None])[..., 0] + r.bias - r.force - np.einsum("nef,ne->nf", tau, found.value)
        rows, _ = rows_of(motion, units, self.rests)
        return np.asarray(np.linalg.solve(rows @ rows.swapaxes(1, 2), rows @ missing[..., None])[..., 0])

    def __call__(self, q: Array, v: Array, t: Array) -> Array:
        return self.solve(q, v, t).acceleration

    def slopes(self, q: Array, v: Array, t: Array, a: Array) -> tuple[Array, Array]:
        """Derivatives of the accelerations by position and speed (n, f, f) each."""
        return differences(self, q, v, t, a)

    def solve(self, q: Array, v: Array, t: Array) -> Dry:
        """Accelerations and friction. Raises `MechanismError` where no acceleration is in balance with the friction it causes."""
        motion, units = moving(self.compiled, q, v, t)
        n = motion.frames
        r = reduced_equations(motion, units)
        rows, rest = rows_of(motion, units, self.rests)
        first = answers_to(r.inertia, r.force - r.bias, rows, rest)
        second = [d[2] for d in motion.drives]
        for place, i in enumerate(free_of(self.compiled)):
            second[i] = first[:, place]
        loaded = with_rates(motion, [d[1] for d in motion.drives], second)
        elements = [replace(e, sign=np.full(n, s)) for e, s in zip(elements_of(loaded), self.signs, strict=True)]
        if self.breaking:
            elements = [replace(e, factor=e.factor * _sticking(e)) for e in elements]
        tau = np.stack([_rates_of(units, e) for e in elements], axis=1)  # (n, e, f): relative rate per unit rate of a coordinate
        answers = answers_to(r.inertia[:, None], tau, rows)  # (n, e, f): acceleration per unit of friction
        response = _respond(loaded, units, elements, answers)
        stuck = np.flatnonzero(self.signs == 0.0)
        # columns of unit friction where it sticks, of minus sign times factor times normal load where it slides
        plain = [
            replace(e, sign=np.full(n, -1.0), factor=1.0) if s == 0.0 else e for e, s in zip(elements, self.signs, strict=True)
        ]
        a, k, norms = system(loaded, plain, response)
        bias = np.stack([relative_rate(loaded, loaded.accelerations, e.what, e.joint, e.links) for e in elements], axis=1)
        rate = np.stack([e.rate for e in elements], axis=1)
        value = np.zeros((n, len(elements)))
        slide = np.flatnonzero(self.signs != 0.0)
        braking = np.array([-s * e.factor for s, e in zip(self.signs, elements, strict=True)])
        coupling = np.einsum("nif,njf->nij", tau, answers)  # relative acceleration at i per unit of friction at j
        if len(stuck):
            inner = coupling[:, stuck[:, None], stuck]
            need = np.linalg.pinv(inner, rcond=1e-10, hermitian=True)
            alpha = -np.einsum("nij,nj->ni", need, bias[:, stuck])
            beta = -np.einsum("nij,njk->nik", need, coupling[:, stuck[:, None], slide] * braking[slide])
            sub_a = a[:, slide] + np.einsum("nixs,ns->nix", k[:, slide][..., stuck], alpha)
            sub_k = k[:, slide][..., slide] + np.einsum("nixs,nsj->nixj", k[:, slide][..., stuck], beta)
        else:
            sub_a, sub_k = a, k
        if len(slide):
            solution = solve_normal_loads(sub_a, sub_k, norms[slide])
            if solution.jammed.any():
                self._refuse(elements, slide, solution.share[solution.jammed][0], float(t[np.argmax(solution.jammed)]))
            value[:, slide] = braking[slide] * solution.loads
        if len(stuck):
            value[:, stuck] = alpha + np.einsum("nij,nj->ni", beta, solution.loads) if len(slide) else alpha
        parts = a + np.einsum(
            "nixj,nj->nix",
            k,
            np.where(self.signs == 0.0, value, np.divide(value, braking, where=braking != 0, out=np.zeros_like(value))),
        )
        size = np.where(norms, np.hypot(parts[..., 0], parts[..., 1]), np.abs(parts).max(axis=2))
        limit = size * np.array([e.factor * (1.0 if self.breaking else _sticking(e)) for e in elements])
        acceleration = first + np.einsum("njf,nj->nf", answers, value)
        return Dry(acceleration, value, limit, rate, bias + np.einsum("nij,nj->ni", coupling, value))

    def _refuse(self, elements: Sequence[Element], slide: Any, share: Array, t: float) -> None:
        worst = elements[slide[int(np.argmax(share))]]
        raise MechanismError(
            Fault(
                f"pairs.{worst.pair}.friction",
                f"at t = {t:.6g} s no acceleration is in balance with the friction that it causes (it jams in motion, Painleve).",
                "Lower the coefficient, or lengthen the bearing.",
            )
        )


def _sticking(e: Element) -> float:
    """Limit of sticking friction over that of sliding friction."""
    f = e.friction
    return max(1.0, f.static / f.coefficient) if f.static and f.coefficient and e.kind != "brake" else 1.0


def _rates_of(units: Sequence[Motion], e: Element) -> Array:
    return np.stack([relative_rate(u, u.speeds, e.what, e.joint, e.links) for u in units], axis=-1)


def _respond(motion: Motion, units: Sequence[Motion], elements: Sequence[Element], answers: Array) -> Response:
    """What pairs transmit under all loads and inertia, and under unit friction with the inertia forces of what it accelerates."""
    model, n, e = motion.model, motion.frames, len(elements)
    base = transmit(motion, *sum_up(wrenches(motion), len(model.links)))
    force: list[Any] = [0j] * len(model.links)
    moment: list[Any] = [0.0] * len(model.links)
    for i, element in enumerate(elements):
        one = np.zeros((e, 1))
        one[i] = 1.0
        element.load(motion, force, moment, one)
    for k in range(1, len(model.links)):
        mass, centre, inertia = model.masses[k]
        if not (mass or inertia):
            continue
        spin = model.angles.spin[k]
        a: Any = 0j
        alpha: Any = 0.0
        for f, unit in enumerate(units):
            a = a + answers[:, :, f].T * unit.of_point(k, centre, 1)
            alpha = alpha + answers[:, :, f].T * unit.speeds.spin[spin]
        force[k] = force[k] - mass * a
        moment[k] = moment[k] - inertia * alpha - cross(centre * motion.rotation(k), mass * a)
    together = transmit(motion, force, moment, base[2])
    return Response(base, [pick(together, i, (e, n)) for i in range(e)])
