"""Loads, reactions and drive efforts of plane mechanisms in absolute coordinates: M a = Q + J' p, p the multipliers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from absolute_constraints import TURN, Array, Constraints, Lost
from scipy.optimize import root

from mechcore import spec as sp
from mechcore.laws.indicator import Compressor
from mechcore.laws.timed import Free, Table


@dataclass(frozen=True)
class Wrench:
    """A force on a body at a place in the world, and a moment; the opposite on another body."""

    body: int
    force: complex
    moment: float
    place: complex
    other: int | None = None


class Loaded(Constraints):
    """A mechanism in absolute coordinates with its masses and loads."""

    def coordinate(self, name: str, q: Array, v: Array) -> tuple[float, float]:
        value, row, _ = self.measured(name, q, v)
        return value, float(row @ v)

    def factor(self, f: sp.Factor | None, t: float, q: Array, v: Array) -> float:
        if f is None:
            return 1.0
        if f.of == "time":
            x = t
        elif f.of in ("position", "velocity"):
            x = self.coordinate(f.joint or self.m.drives[0].joint, q, v)[f.of == "velocity"]
        else:
            assert f.point is not None
            body, local = self.body[f.point[0]], self.at(*f.point)
            z = self.point(q, body, local) if f.of in "xy" else self.point(q, body, local, v)
            x = {"x": z.real, "y": z.imag, "vx": z.real, "vy": z.imag, "speed": abs(z)}[f.of]
        if isinstance(f.function, Table):
            assert not f.function.smooth and f.function.period is None
            return float(np.interp(x, f.function.x, f.function.y))
        if isinstance(f.function, sp.Polynomial):
            return float(sum(c * (x / f.function.per) ** k for k, c in enumerate(f.function.coefficients)))
        return float(f.function(x))

    def effort(self, name: str, q: Array, value: float) -> Wrench:
        """An effort in a joint: on its second link in the direction of its coordinate."""
        p = self.joint[name]
        if name not in self.slide and not isinstance(p, sp.Cylinder):
            a, b = self.ends(p)
            local = self.at(p.links[1], p.points[1])
            return Wrench(b, 0j, value, self.point(q, b, local), a)
        if isinstance(p, sp.Cylinder):
            a, b = self.ends(p)
            za, zb = (self.point(q, self.body[k], self.at(k, i)) for k, i in zip(p.links, p.points, strict=True))
            return Wrench(b, value * (zb - za) / abs(zb - za), 0.0, zb, a)
        g = getattr(p, "guide", 0)
        k, o = self.body[p.links[g]], self.body[p.links[1 - g]]
        u = self.frames(q)[1][k] * self.direction(p)
        place = self.point(q, o, self.at(p.links[1 - g], p.points[1 - g]))
        first = Wrench(o, value * u, 0.0, place, k)
        return first if g == 0 else Wrench(k, -value * u, 0.0, place, o)

    def load(self, x: Any, t: float, q: Array, v: Array) -> Wrench:
        turn = self.frames(q)[1]
        spin = np.concatenate([[0.0], v[2 : 3 * len(self.names) : 3]])
        if isinstance(x, sp.Force):
            b = self.body[x.link]
            f = complex(*x.vector) * self.factor(x.factor, t, q, v) * (turn[b] if x.axes == "link" else 1.0)
            other = None if x.against is None else self.body[x.against]
            return Wrench(b, f, 0.0, self.point(q, b, self.at(x.link, x.point)), other)
        if isinstance(x, sp.Torque):
            b = self.body[x.link]
            other = None if x.against is None else self.body[x.against]
            return Wrench(b, 0j, x.moment * self.factor(x.factor, t, q, v), self.point(q, b, 0j), other)
        if isinstance(x, sp.Spring | sp.Damper | sp.GasSpring):
            (a, b), (i, j) = (self.body[k] for k in x.links), (self.at(k, p) for k, p in zip(x.links, x.points, strict=True))
            d = self.point(q, b, j) - self.point(q, a, i)
            length = abs(d)
            rate = (np.conj(d / length) * (self.point(q, b, j, v) - self.point(q, a, i, v))).real
            if isinstance(x, sp.Spring):
                pull = x.preload + x.stiffness * (length - x.free_length)
            elif isinstance(x, sp.Damper):
                pull = x.linear * rate + x.quadratic * rate * abs(rate)
            elif not x.extended - x.gas_length < length <= x.extended:
                raise Lost(f"{x.name} leaves its range")
            else:
                pull = -x.force * (x.gas_length / (x.gas_length - x.extended + length)) ** x.exponent
            return Wrench(a, pull * d / length, 0.0, self.point(q, a, i), b)
        if isinstance(x, sp.TorsionSpring | sp.TorsionDamper):
            a, b = (self.body[k] for k in x.links)
            if isinstance(x, sp.TorsionDamper):
                return Wrench(a, 0j, x.coefficient * (spin[b] - spin[a]), self.point(q, a, 0j), b)
            return Wrench(a, 0j, x.stiffness * self.deflection(x, q), self.point(q, a, 0j), b)
        if isinstance(x, sp.Drag):
            b = self.body[x.link]
            if x.point is None:
                return Wrench(b, 0j, -(x.linear + x.quadratic * abs(spin[b])) * spin[b], self.point(q, b, 0j))
            local = self.at(x.link, x.point)
            u = self.point(q, b, local, v)
            return Wrench(b, -(x.linear + x.quadratic * abs(u)) * u, 0.0, self.point(q, b, local))
        if isinstance(x, sp.Viscous):
            p = self.joint[x.joint]
            if isinstance(p, sp.Rolling):
                a, b = self.ends(p)
                return Wrench(b, 0j, -x.coefficient * (spin[b] - spin[a]), self.point(q, b, 0j), a)
            return self.effort(x.joint, q, -x.coefficient * self.coordinate(x.joint, q, v)[1])
        if isinstance(x, sp.DcMotor):
            assert x.joint is not None
            w = self.coordinate(x.joint, q, v)[1]
            return self.effort(x.joint, q, x.stall_torque * (1.0 - w / x.no_load_speed))
        assert isinstance(x, sp.GasPressure)
        p = self.joint[x.joint]
        s, rate = self.coordinate(x.joint, q, v)
        ahead = x.head == "ahead"
        depth = x.top - s if ahead else s - x.top
        if not 0.0 <= depth <= x.cycle.stroke:
            raise Lost(f"{x.name} leaves its stroke")
        away = -rate if ahead else rate
        # at rest it stays on the stroke that led there; without one it counts as one that moves away
        outward = away >= -1e-13 if abs(away) > 1e-13 else self.led.get(x.name, 1.0) >= 0.0
        c: Any = x.cycle
        if isinstance(c, Compressor):
            room = c.clearance + depth / c.stroke
            if outward:
                pressure = max(c.suction, c.delivery * (c.clearance / room) ** c.exponent)
            else:
                pressure = min(c.delivery, c.suction * ((1.0 + c.clearance) / room) ** c.exponent)
        else:
            pressure = float(c.pressure(np.array(depth), np.array(outward), np.array(True)))
        push = (pressure - x.back) * x.area * (-1.0 if ahead else 1.0)
        on = self.effort(x.joint, q, push)
        return on if p.guide == 0 else Wrench(on.other or 0, -on.force, 0.0, on.place, on.body)  # on the piston

    def applied(self, t: float, q: Array, v: Array) -> list[Wrench]:
        """All loads in their order, then weights."""
        result = [self.load(x, t, q, v) for x in self.m.loads]
        if "gravity" in self.m.effects:
            g = complex(*self.m.gravity)
            for b in range(1, len(self.names) + 1):
                result.append(Wrench(b, self.mass[b] * g, 0.0, self.point(q, b, self.centre[b])))
        return result

    def deflection(self, spring: sp.TorsionSpring, q: Array) -> float:
        """Angle by which a torsion spring is wound; it starts nearest to where it is slack."""
        a, b = (self.body[k] for k in spring.links)
        began = self.turned(self.q0, a, b) - spring.free_angle
        return float(self.turned(q, a, b) - spring.free_angle - TURN * np.round(began / TURN))

    def energy(self, q: Array, v: Array) -> float:
        """Kinetic energy, and potential energy of gravity and torsion springs."""
        big, _ = self.masses(q, v)
        total = 0.5 * float(v @ big @ v)
        if "gravity" in self.m.effects:
            places = (self.point(q, b, self.centre[b]) for b in range(1, len(self.names) + 1))
            total -= sum(m * (np.conj(z) * complex(*self.m.gravity)).real for m, z in zip(self.mass[1:], places, strict=True))
        return total + sum(0.5 * s.stiffness * self.deflection(s, q) ** 2 for s in self.m.loads if isinstance(s, sp.TorsionSpring))

    def generalised(self, wrenches: list[Wrench], q: Array) -> Array:
        """The forces on the coordinates (n,)."""
        out = np.zeros(self.n)
        for w in wrenches:
            for body, sign in ((w.body, 1.0), (w.other, -1.0)):
                if body:
                    k = 3 * body - 3
                    arm = w.place - complex(q[k], q[k + 1])
                    out[k] += sign * w.force.real
                    out[k + 1] += sign * w.force.imag
                    out[k + 2] += sign * (w.moment + (np.conj(arm) * w.force).imag)
        return out

    def masses(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Mass matrix (n, n), and the forces of inertia that are quadratic in the rates (n,)."""
        big, force = np.zeros((self.n, self.n)), np.zeros(self.n)
        if "inertia" not in self.m.effects:
            return big, force
        turn = self.frames(q)[1]
        for b in range(1, len(self.names) + 1):
            k, arm, m = 3 * b - 3, turn[b] * self.centre[b], self.mass[b]
            big[k, k] = big[k + 1, k + 1] = m
            big[k, k + 2] = big[k + 2, k] = -m * arm.imag
            big[k + 1, k + 2] = big[k + 2, k + 1] = m * arm.real
            big[k + 2, k + 2] = self.inertia[b] + m * abs(arm) ** 2
            pull = m * v[k + 2] ** 2 * arm  # M a of the centre is M (a_O + i alpha r) - m w^2 r
            force[k] += pull.real
            force[k + 1] += pull.imag
        return big, force

    def contact(self, name: str, p: float, q: Array) -> list[Wrench]:
        """What the teeth or a belt really transmit, of the multiplier of a relation; rolling and cams say it themselves."""
        joint = self.joint[name]
        if isinstance(joint, sp.Gear):
            carrier = self.body[joint.carrier]
            c1, c2 = (self.axis_on(k, joint.carrier) for k in joint.links)
            r1, _ = self.gear_radii(joint)
            out = (c2 - c1) / abs(c2 - c1) * (-1.0 if joint.internal else 1.0)
            place, turn = self.point(q, carrier, c1 + r1 * out), self.frames(q)[1][carrier]
            lean = abs(p) * np.tan(joint.pressure_angle)
            return [Wrench(self.body[joint.links[1]], (-p * 1j * out + lean * out) * turn, 0.0, place, self.body[joint.links[0]])]
        if isinstance(joint, sp.Belt):
            carrier = self.body[joint.carrier]
            c1, c2 = (self.axis_on(k, joint.carrier) for k in joint.links)
            axis, (r1, r2) = (c2 - c1) / abs(c2 - c1), joint.radii
            k = (r1 + r2 if joint.crossed else r1 - r2) / abs(c2 - c1)
            side = -1j if p >= 0 else 1j
            n = (k + side * np.sqrt(1.0 - k * k)) * axis
            along = (1j if p >= 0 else -1j) * n
            assert (np.conj(along) * axis).real > 0.0
            turn = self.frames(q)[1][carrier]
            place = self.point(q, carrier, c1 + r1 * n)
            return [Wrench(self.body[joint.links[1]], -abs(p) * along * turn, 0.0, place, self.body[joint.links[0]])]
        assert isinstance(joint, sp.Rack)
        slider = self.joint[joint.slider]
        carrier_name = next(k for k in slider.links if k != joint.links[1])
        carrier = self.body[carrier_name]
        assert slider.links[slider.guide] == carrier_name
        u = self.direction(slider)
        towards = (-1j if joint.side == "left" else 1j) * u
        place = self.point(q, carrier, self.axis_on(joint.links[0], carrier_name) + joint.radius * towards)
        turn = self.frames(q)[1][carrier]
        lean = abs(p) * np.tan(joint.pressure_angle) * towards
        return [Wrench(self.body[joint.links[1]], (p * u + lean) * turn, 0.0, place, self.body[joint.links[0]])]

    def reactions(self, t: float, q: Array, v: Array, a: Array, more: tuple[str, ...] = ()) -> dict[str, Any]:
        """Reactions (force, couple on the second link) by joint, efforts by driven joint, forces of stops, wrenches of loads."""
        j = self.system(t, q, v, True, more)[1]
        loads = self.applied(t, q, v)
        big, quad = self.masses(q, v)
        demand = big @ a - quad - self.generalised(loads, q)
        free = {d.joint for d in self.m.drives if isinstance(d.law, Free)}
        ties = [r for r in self.linear_of if isinstance(self.joint[r], sp.Gear | sp.Belt | sp.Rack)]
        lead = 2 * len(self.revolute) + len(self.slot)

        def multipliers(demand: Array, without: list[int]) -> Array:
            keep = [i for i in range(len(j)) if i not in without]
            out = np.zeros(len(j))
            out[keep] = np.linalg.lstsq(j[keep].T, demand, rcond=None)[0]
            return out

        def solved(demand: Array) -> tuple[Array, list[Wrench]]:
            p = multipliers(demand, [])
            if not ties:
                return p, []
            rows = [lead + self.linear_of[r] for r in ties]
            teeth = [w for r, i in zip(ties, rows, strict=True) for w in self.contact(r, p[i], q)]
            again = multipliers(demand - self.generalised(teeth, q), rows)
            again[rows] = p[rows]
            return again, teeth

        p, teeth = solved(demand)
        rubs = self._friction_of(q, v) if "friction" in self.m.effects else None
        drag: dict[str, complex | float] = {}
        if rubs is not None:

            def residual(p: Array) -> Array:
                wanted, _ = solved(demand - self.generalised([w for _, w in rubs(p)], q))
                return wanted - p

            computed = root(residual, p, tol=1e-13).x
            for start in (computed, p):  # its law has corners, next to which Newton's method may stand: mild friction contracts
                p = start
                for _ in range(300):
                    left = residual(p)
                    if np.abs(left).max() <= 1e-13 * (1.0 + np.abs(p).max()):
                        break
                    p = p + left
                if np.abs(left).max() <= 1e-11 * (1.0 + np.abs(p).max()):
                    break
            else:
                raise Lost("friction")
            drag = {name: (w.force if name in self.slide else w.moment) for name, w in rubs(p)}
            p, teeth = solved(demand - self.generalised([w for _, w in rubs(p)], q))
        out: dict[str, tuple[complex, float]] = {}
        turn = self.frames(q)[1]
        n = len(self.revolute)
        for i, name in enumerate(self.revolute):
            couple = p[lead + self.linear_of[name]] if name in self.linear_of else 0.0
            out[name] = complex(p[i], p[n + i]), couple + float(np.real(drag.get(name, 0.0)))
        for i, name in enumerate(self.slot):
            joint = self.joint[name]
            guide = getattr(joint, "guide", 0)
            u = turn[self.slot_body[0, i]] * self.slot_along[i]
            force = p[2 * n + i] * 1j * u
            couple = 0.0
            if isinstance(joint, sp.Rolling):
                force += p[lead + self.linear_of[name]] * u
            elif name in self.linear_of:
                couple = p[lead + self.linear_of[name]]
            out[name] = (force if guide == 0 else -force) + drag.get(name, 0.0), couple
        for name, w in zip(ties, teeth, strict=True):
            out[name] = w.force, 0.0
        row = lead + len(self.linear)
        for cam in self.cams:
            out[cam.joint.name] = complex(p[row], p[row + 1]), 0.0
            row += 2
        for cam in self.flats:
            out[cam.joint.name] = p[row] * turn[cam.follower] * cam.up * np.exp(-1j * self._flat_angle(cam)), 0.0
            row += 1
        drives = [d.joint for d in self.m.drives if d.joint not in free]
        efforts = {name: float(p[row + i]) for i, name in enumerate(drives)}
        row += len(drives)
        held = {name: float(p[row + i]) for i, name in enumerate(more)}
        for cylinder in self.cylinders:  # its rod carries what drives it and what brakes it
            total = self.effort(cylinder.name, q, efforts.get(cylinder.name, 0.0)).force
            total += sum(w.force for x, w in zip(self.m.loads, loads, strict=False) if getattr(x, "joint", None) == cylinder.name)
            out[cylinder.name + ".eye"] = -total, 0.0
        miss = np.abs(j.T @ p - demand).max() if not ties and rubs is None else 0.0
        return {"reactions": out, "efforts": efforts, "held": held, "loads": loads, "miss": miss}

    def _friction_of(self, q: Array, v: Array) -> Any:
        """A function of all multipliers: what dry friction puts on the second link of every joint that has some."""
        n = len(self.revolute)
        lead = 2 * n + len(self.slot)
        elements = []
        for p in self.m.joints:
            f = getattr(p, "friction", None)
            if f is None:
                continue
            rate = self.coordinate(p.name, q, v)[1]
            sign = 0.0 if abs(rate) < 1e-9 else np.sign(rate)
            elements.append((p, f, sign))

        def wrenches(m: Array) -> list[tuple[str, Wrench]]:
            computed = []
            for p, f, sign in elements:
                if isinstance(p, sp.Revolute):
                    i = self.revolute.index(p.name)
                    effort = -sign * f.coefficient * f.radius * np.hypot(m[i], m[n + i])
                else:
                    i = self.slot.index(p.name)
                    force, couple = abs(m[2 * n + i]), 0.0
                    if isinstance(p, sp.Prismatic):
                        couple = abs(m[lead + self.linear_of[p.name]])
                    size = max(force, 2.0 * couple / f.length) if f.length else force
                    effort = -sign * f.coefficient * size
                computed.append((p.name, self.effort(p.name, q, float(effort))))
            return computed

        return wrenches
