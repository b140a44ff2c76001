"""Constraints of plane mechanisms in absolute coordinates, and motions that drives prescribe; written apart from the core.

Every moving link has x, y and the angle of its frame; every cam follower has the place of its contact on the pitch curve as well.
Positions solve the constraints (Newton's method from a predictor), rates are linear. Of `mechcore` only the specs are read.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from absolute_cams import Cam
from scipy.optimize import root

from mechcore import spec as sp
from mechcore.laws.timed import ConstantSpeed, Free, Oscillation

Array = np.ndarray
TURN = 2.0 * np.pi


class Lost(Exception):
    """The constraints cannot be followed any further."""


def law_at(law: Any, t: float) -> tuple[float, float, float]:
    """Position, speed, acceleration of a drive."""
    if isinstance(law, ConstantSpeed):
        return law.start + law.speed * t, law.speed, 0.0
    if isinstance(law, Oscillation):
        w = TURN * law.frequency
        s, c = np.sin(w * t + law.phase), np.cos(w * t + law.phase)
        return law.centre + law.amplitude * s, law.amplitude * w * c, -law.amplitude * w * w * s
    k = min(max(int(np.searchsorted(law.knots, t, side="left")) - 1, 0), len(law.coefficients) - 1)
    p = np.polynomial.Polynomial(law.coefficients[k])
    u = t - law.knots[k]
    return float(p(u)), float(p.deriv()(u)), float(p.deriv(2)(u))


class Constraints:
    """A mechanism in absolute coordinates: q = (x, y, angle) of every moving link, then the arguments of the cams."""

    def __init__(self, m: sp.Mechanism, poses: dict[str, tuple[float, float, float]], start: dict[str, float]):
        self.m = m
        self.held: dict[str, float] = {}  # coordinates of joints that rest on stops
        self.led: dict[str, float] = {}  # by gas: whether its piston came to rest moving away from the head, or towards it
        self._framed: Any = (None, None)
        self._known: Any = (None, None, None)
        self.names = [k.name for k in m.links if k.name != m.frame]
        self.body = {m.frame: 0} | {k: i + 1 for i, k in enumerate(self.names)}
        self.link = {k.name: k for k in m.links}
        self.joint: dict[str, Any] = {p.name: p for p in m.joints}
        self.start = start  # coordinates at the start
        self.base = {}  # what angles are ahead of the difference of the bodies' angles at the start
        self.cams = [Cam(p, self) for p in m.joints if isinstance(p, sp.CamJoint) and type(p.face).__name__ != "Flat"]
        self.flats = [Cam(p, self) for p in m.joints if isinstance(p, sp.CamJoint) and type(p.face).__name__ == "Flat"]
        self.n = 3 * len(self.names) + len(self.cams)
        self.poses = poses
        moving = [self.link[k] for k in self.names]
        self.mass = np.array([0.0, *(k.mass for k in moving)])
        self.inertia = np.array([0.0, *(k.inertia for k in moving)])
        self.centre = np.array([0.0, *(complex(*k.centre) for k in moving)])
        self._parts()
        q = np.zeros(self.n)
        for k, name in enumerate(self.names):
            q[3 * k : 3 * k + 3] = poses[name]
        self.q0 = q
        for i, cam in enumerate(self.cams):
            q[3 * len(self.names) + i] = cam.joint.sense * (q[3 * cam.cam - 1]) + cam.joint.phase
        self.constant = np.zeros(len(self.linear))
        self._known = (None, None, None)
        self.constant = self._evaluate(q, None)[0][len(self.revolute) * 2 + len(self.slot) :][: len(self.linear)]
        for i, (_, _, known) in enumerate(self.linear):
            if known is not None:
                self.constant[i] = known + TURN * np.round((self.constant[i] - known) / TURN)
        self.base = {name: self.turned(q, *self.ends(p)) for name, p in self.joint.items() if self.ends(p)}

    # -- what the specs say -------------------------------------------------------------------------------------------
    def at(self, link: str, point: str) -> complex:
        return complex(*self.link[link].points[point])

    def ends(self, joint: Any) -> tuple[int, int]:
        return self.body[joint.links[0]], self.body[joint.links[1]]

    @staticmethod
    def direction(joint: Any) -> complex:
        z = complex(*joint.along)
        return z / abs(z)

    def _parts(self) -> None:
        """Coincident points, slots, linear constraints of angles and slides, slides, distances."""
        self.revolute: list[str] = []
        self.slot: list[str] = []
        self.slide: dict[str, int] = {}  # joint -> number of its slide
        self.linear: list[tuple[dict[int, float], dict[int, float], float | None]] = []
        self.linear_of: dict[str, int] = {}
        ends: list[tuple[int, complex, int, complex]] = []
        slots: list[tuple[int, complex, int, complex, complex]] = []
        for p in self.m.joints:
            if isinstance(p, sp.Revolute | sp.Weld):
                (a, b), (i, j) = p.links, p.points
                self.revolute.append(p.name)
                ends.append((self.body[a], self.at(a, i), self.body[b], self.at(b, j)))
            if isinstance(p, sp.Prismatic | sp.PinSlot | sp.Rolling):
                g = getattr(p, "guide", 0)
                k, o = p.links[g], p.links[1 - g]
                self.slide[p.name] = len(self.slot)
                self.slot.append(p.name)
                slots.append((self.body[k], self.at(k, p.points[g]), self.body[o], self.at(o, p.points[1 - g]), self.direction(p)))
            if isinstance(p, sp.Prismatic | sp.Weld):
                self._tie(p.name, {self.body[p.links[1]]: 1.0, self.body[p.links[0]]: -1.0}, {}, p.angle)
            if isinstance(p, sp.Gear):
                r1, r2 = self.gear_radii(p)
                s = -1.0 if p.internal else 1.0
                self._tie(p.name, self._wheels(p, r1, s * r2), {}, None)
            if isinstance(p, sp.Belt):
                self._tie(p.name, self._wheels(p, p.radii[0], p.radii[1] * (1.0 if p.crossed else -1.0)), {}, None)
            if isinstance(p, sp.Rolling):
                r = p.radius if p.side == "left" else -p.radius
                self._tie(p.name, {self.body[p.links[1]]: r, self.body[p.links[0]]: -r}, {self.slide[p.name]: 1.0}, None)
        for p in self.m.joints:
            if isinstance(p, sp.Rack):
                slider = self.joint[p.slider]
                carrier = next(k for k in slider.links if k != p.links[1])
                r = p.radius if p.side == "left" else -p.radius
                moves = 1.0 if slider.links[slider.guide] == carrier else -1.0
                self._tie(p.name, {self.body[p.links[0]]: -r, self.body[carrier]: r}, {self.slide[p.slider]: moves}, None)
        self.cylinders = [p for p in self.m.joints if isinstance(p, sp.Cylinder)]
        pad = ends or [(0, 0j, 0, 0j)]
        self.pin_body = np.array([[a, c] for a, _, c, _ in pad]).T
        self.pin_at = np.array([[b, d] for _, b, _, d in pad]).T
        if not ends:
            self.pin_body, self.pin_at = self.pin_body[:, :0], self.pin_at[:, :0]
        self.slot_body = np.array([[a, c] for a, _, c, _, _ in slots], int).reshape(-1, 2).T
        self.slot_at = np.array([[b, d] for _, b, _, d, _ in slots], complex).reshape(-1, 2).T
        self.slot_along = np.array([u for *_, u in slots], complex)
        self.phi = np.zeros((len(self.linear), len(self.names) + 1))
        self.along = np.zeros((len(self.linear), len(slots)))
        for i, (angles, slides, _) in enumerate(self.linear):
            for b, c in angles.items():
                self.phi[i, b] += c
            for s, c in slides.items():
                self.along[i, s] += c

        self._pin_rows, self._slot_rows = (self._places(b) for b in (self.pin_body, self.slot_body))
        self._slot_spin = np.zeros((len(slots), self.n))
        for i, b in enumerate(self.slot_body[0]):
            if b:
                self._slot_spin[i, 3 * b - 1] = 1.0

    def _places(self, body: Array) -> tuple[Array, Array, Array, Array]:
        """Of differences of points (2, k): the constant part of their Jacobian, and where the turning arms stand in it."""
        fixed = np.zeros((body.shape[1], self.n), complex)
        side, which, at = [], [], []
        for s, sign in ((0, -1.0), (1, 1.0)):
            for i, b in enumerate(body[s]):
                if b:
                    fixed[i, 3 * b - 3] += sign
                    fixed[i, 3 * b - 2] += 1j * sign
                    side.append(s)
                    which.append(i)
                    at.append(i * self.n + 3 * b - 1)
        return fixed, np.array(side, int), np.array(which, int), np.array(at, int)

    def _difference(self, places: tuple[Array, Array, Array, Array], arm: Array) -> Array:
        """Jacobian (k, n) of the second points less the first, by their arms (2, k)."""
        fixed, side, which, at = places
        out = fixed.copy()
        out.reshape(-1)[at] = 1j * np.where(side, 1.0, -1.0) * arm[side, which]
        return out

    def _tie(self, name: str, angles: dict[int, float], slides: dict[int, float], known: float | None) -> None:
        self.linear_of[name] = len(self.linear)
        self.linear.append((angles, slides, known))

    def _wheels(self, p: Any, first: float, second: float) -> dict[int, float]:
        out: dict[int, float] = {}
        for link, c in zip((*p.links, p.carrier), (first, second, -first - second), strict=True):
            out[self.body[link]] = out.get(self.body[link], 0.0) + c
        return out

    def axis_on(self, wheel: str, carrier: str) -> complex:
        """The axis of a wheel that is pinned to its carrier, in the carrier's axes."""
        p = next(p for p in self.m.joints if isinstance(p, sp.Revolute) and set(p.links) == {wheel, carrier})
        return self.at(carrier, p.points[p.links.index(carrier)])

    def gear_radii(self, p: sp.Gear) -> tuple[float, float]:
        distance = abs(self.axis_on(p.links[1], p.carrier) - self.axis_on(p.links[0], p.carrier))
        n1, n2 = p.sizes
        total = n2 - n1 if p.internal else n1 + n2
        return n1 * distance / total, n2 * distance / total

    # -- geometry -----------------------------------------------------------------------------------------------------
    def frames(self, q: Array) -> tuple[Array, Array, Array]:
        """Origins, rotations, angles of all bodies, the fixed one first."""
        if self._framed[0] is not q:
            x = q[: 3 * len(self.names)].reshape(-1, 3)
            angle = np.zeros(len(x) + 1)
            angle[1:] = x[:, 2]
            origin = np.zeros(len(x) + 1, complex)
            origin[1:] = x[:, 0] + 1j * x[:, 1]
            self._framed = q, (origin, np.exp(1j * angle), angle)
        return self._framed[1]

    def turned(self, q: Array, first: int, second: int) -> float:
        angle = self.frames(q)[2]
        return float(angle[second] - angle[first])

    def point(self, q: Array, body: int, local: complex, v: Array | None = None) -> complex:
        """Place of a point of a body, or with rates its velocity."""
        if body == 0:
            return local if v is None else 0j
        k = 3 * (body - 1)
        origin, turn, _ = self.frames(q)
        arm = turn[body] * local
        return origin[body] + arm if v is None else complex(v[k], v[k + 1]) + 1j * v[k + 2] * arm

    def evaluate(self, q: Array, v: Array | None = None) -> tuple[Array, Array, Array]:
        """Residuals of all constraints but the drives', their Jacobian, and the part of their second rates that is quadratic."""
        if self._known[0] is not q or self._known[1] is not v:  # arrays are never changed in place
            self._known = q, v, self._evaluate(q, v)
        return self._known[2]

    def _evaluate(self, q: Array, v: Array | None) -> tuple[Array, Array, Array]:
        origin, turn, angle = self.frames(q)
        nb = len(self.names)
        w = np.zeros(nb + 1) if v is None else np.concatenate([[0.0], v[2 : 3 * nb : 3]])
        vel = np.zeros(nb + 1, complex)
        if v is not None:
            x = v[: 3 * nb].reshape(-1, 3)
            vel[1:] = x[:, 0] + 1j * x[:, 1]
        residuals, rows, quadratic = [], [], []
        arm = turn[self.pin_body] * self.pin_at
        if len(self.revolute):
            z = origin[self.pin_body] + arm
            d = z[1] - z[0]
            j = self._difference(self._pin_rows, arm)
            k = -(w[self.pin_body] ** 2) * arm
            k = k[1] - k[0]
            residuals += [d.real, d.imag]
            rows += [j.real, j.imag]
            quadratic += [k.real, k.imag]
        if len(self.slot):
            arm = turn[self.slot_body] * self.slot_at
            d = origin[self.slot_body] + arm
            d = d[1] - d[0]
            u = turn[self.slot_body[0]] * self.slot_along
            jd = self._difference(self._slot_rows, arm)
            d1 = vel[self.slot_body] + 1j * w[self.slot_body] * arm
            d1 = d1[1] - d1[0]
            d2 = -(w[self.slot_body] ** 2) * arm
            d2 = d2[1] - d2[0]
            wg = w[self.slot_body[0]]
            # z = conj(u) d: the slide and the distance from the line, in the axes of the guide
            z = np.conj(u) * d
            jz = np.conj(u)[:, None] * jd - 1j * z[:, None] * self._slot_spin
            kz = np.conj(u) * (d2 - 2j * wg * d1 - wg * wg * d)
            residuals.append(z.imag)
            rows.append(jz.imag)
            quadratic.append(kz.imag)
        else:
            z, jz, kz = np.zeros(0, complex), np.zeros((0, self.n), complex), np.zeros(0, complex)
        if len(self.linear):
            residuals.append(self.phi @ angle + self.along @ z.real - self.constant)
            row = np.zeros((len(self.linear), self.n))
            row[:, 2 : 3 * nb : 3] = self.phi[:, 1:]
            rows.append(row + self.along @ jz.real)
            quadratic.append(self.along @ kz.real)
        self._slides = z.real, jz.real, kz.real
        for i, cam in enumerate(self.cams):
            s = 3 * nb + i
            c, c1, c2 = cam.curve(q[s])
            body, other = cam.cam, cam.follower
            arm_c = turn[body] * (cam.own + c)
            arm_f = turn[other] * self.at(cam.joint.links[1], cam.joint.point)
            d = origin[other] + arm_f - origin[body] - arm_c
            one = self._at(np.array([other]), np.array([arm_f])) - self._at(np.array([body]), np.array([arm_c]))
            one[0, s] = -turn[body] * c1
            rate = 0.0 if v is None else v[s]
            k = -(w[other] ** 2) * arm_f + w[body] ** 2 * arm_c
            k -= turn[body] * (2j * w[body] * rate * c1 + rate * rate * c2)
            residuals.append(np.array([d.real, d.imag]))
            rows.append(np.vstack([one.real, one.imag]))
            quadratic.append(np.array([k.real, k.imag]))
        for cam in self.flats:
            # distance of the face from the cam's axis as a function of the cam's angle against the follower's
            body, other = cam.cam, cam.follower
            f = turn[other] * self.at(cam.joint.links[1], cam.joint.point)
            a = turn[body] * cam.own
            d = origin[other] + f - origin[body] - a
            angle0 = cam.up * np.exp(-1j * self._flat_angle(cam))
            u = turn[other] * angle0  # the normal turns with the follower
            x = cam.joint.sense * (angle[body] - (angle[other] - self._flat_angle(cam))) + cam.joint.phase
            h, h1, h2 = cam.lift(x)
            jd = self._at(np.array([other]), np.array([f])) - self._at(np.array([body]), np.array([a]))
            spin = np.zeros((1, self.n))
            spin[0, 3 * other - 1] = 1.0
            slope = np.zeros((1, self.n))
            slope[0, 3 * body - 1] += cam.joint.sense
            slope[0, 3 * other - 1] -= cam.joint.sense
            zf = np.conj(u) * d
            rate = cam.joint.sense * (w[body] - w[other])
            d1 = vel[other] + 1j * w[other] * f - vel[body] - 1j * w[body] * a
            d2 = -(w[other] ** 2) * f + w[body] ** 2 * a
            residuals.append(np.array([zf.real - cam.joint.base - h]))
            rows.append((np.conj(u) * jd - 1j * zf * spin).real - h1 * slope)
            quadratic.append(np.array([(np.conj(u) * (d2 - 2j * w[other] * d1 - w[other] ** 2 * d)).real - h2 * rate * rate]))
        if not residuals:
            return np.zeros(0), np.zeros((0, self.n)), np.zeros(0)
        return np.concatenate(residuals), np.vstack(rows), np.concatenate(quadratic)

    def _flat_angle(self, cam: Cam) -> float:
        """Angle of a flat follower's frame where its guide stands still."""
        return self.poses[cam.joint.links[1]][2]

    def _at(self, body: Array, arm: Array) -> Array:
        """Complex Jacobian (k, n) of points with these arms."""
        out = np.zeros((len(body), self.n), complex)
        for i, (b, z) in enumerate(zip(body, arm, strict=True)):
            if b:
                out[i, 3 * b - 3], out[i, 3 * b - 2], out[i, 3 * b - 1] = 1.0, 1j, 1j * z
        return out

    def measured(self, name: str, q: Array, v: Array | None = None) -> tuple[float, Array, float]:
        """Coordinate of a joint, its gradient (n,), and the quadratic part of its second rate."""
        p = self.joint[name]
        if name in self.slide:
            self.evaluate(q, v)
            i = self.slide[name]
            z, jz, kz = self._slides
            return float(z[i]), jz[i], float(kz[i])
        if isinstance(p, sp.Cylinder):
            (a, b), (i, j) = self.ends(p), (self.at(k, s) for k, s in zip(p.links, p.points, strict=True))
            turn = self.frames(q)[1]
            d = self.point(q, b, j) - self.point(q, a, i)
            length, u = abs(d), d / abs(d)
            jd = self._at(np.array([b]), np.array([turn[b] * j])) - self._at(np.array([a]), np.array([turn[a] * i]))
            k = 0.0
            if v is not None:
                d1 = self.point(q, b, j, v) - self.point(q, a, i, v)
                w = np.concatenate([[0.0], v[2 : 3 * len(self.names) : 3]])
                d2 = -(w[b] ** 2) * turn[b] * j + w[a] ** 2 * turn[a] * i
                k = (np.conj(u) * d2).real + (np.conj(u) * d1).imag ** 2 / length
            return length, (np.conj(u) * jd).real[0], float(k)
        a, b = self.ends(p)
        row = np.zeros(self.n)
        if b:
            row[3 * b - 1] += 1.0
        if a:
            row[3 * a - 1] -= 1.0
        return self.start[name] + self.turned(q, a, b) - self.base[name], row, 0.0

    def system(self, t: float, q: Array, v: Array | None, driven: bool | tuple[str, ...] = True, more: tuple[str, ...] = ()) -> Any:
        """Residuals, Jacobian, rates by time, quadratic parts of all constraints, the drives' last, then joints that stand
        still."""
        g, j, k = self.evaluate(q, v)
        gs, js, ks, rates = [g], [j], [k], [np.zeros(len(g))]
        for d in self.m.drives:
            if isinstance(d.law, Free):
                if driven != "all":
                    continue
                want: Any = (d.law.start, d.law.speed, 0.0)
            else:
                want = law_at(d.law, t)
            value, row, quad = self.measured(d.joint, q, v)
            gs.append(np.array([value - want[0]]))
            js.append(row[None])
            ks.append(np.array([quad - want[2]]))
            rates.append(np.array([want[1]]))
        for name in more:
            value, row, quad = self.measured(name, q, v)
            gs.append(np.array([value - self.held[name]]))
            js.append(row[None])
            ks.append(np.array([quad]))
            rates.append(np.zeros(1))
        return np.concatenate(gs), np.vstack(js), np.concatenate(rates), np.concatenate(ks)

    # -- prescribed motion --------------------------------------------------------------------------------------------
    def solve(self, t: float, guess: Array, driven: Any = True) -> Array:
        """Positions at a time by Newton's method, from far off by scipy's hybrid one."""
        q = guess
        for _ in range(3):
            g, j, *_ = self.system(t, q, None, driven)
            q = q - np.linalg.solve(j, g)
        if not np.abs(g).max() < 1e-9:
            q = root(lambda x: self.system(t, x, None, driven)[0], q, jac=lambda x: self.system(t, x, None, driven)[1], tol=1e-13).x
            g, j, *_ = self.system(t, q, None, driven)
            q = q - np.linalg.solve(j, g)
        g = self.system(t, q, None, driven)[0]
        if not np.abs(g).max() < 1e-11:
            raise Lost(f"no position at {t:.6g} s: {np.abs(g).max():.1e}")
        return q

    def rates(self, t: float, q: Array, driven: Any = True) -> tuple[Array, Array]:
        """Velocities and accelerations where all coordinates are prescribed."""
        _, j, r, _ = self.system(t, q, None, driven)
        v = np.linalg.solve(j, r)
        *_, k = self.system(t, q, v, driven)
        return v, np.linalg.solve(j, -k)

    def follow(self, time: Array) -> tuple[Array, Array, Array, float]:
        """Positions, velocities, accelerations (F, n) at times, and the largest condition number on the way."""
        q = self.solve(float(time[0]), self.q0)
        if np.abs(q - self.q0).max() > 1e-6:
            raise Lost("the drawing is not where the drives start")
        out, t, worst = [], float(time[0]), 1.0
        v, a = self.rates(t, q)
        for want in time:
            while t < want:
                h = float(want - t)
                while True:
                    guess = q + h * (v + 0.5 * h * a)
                    new = self.solve(t + h, guess)
                    if np.abs(new - guess).max() < 0.03 and h * np.abs(v[2::3]).max(initial=0.0) < 0.3:
                        break
                    h *= 0.5
                    if h < 1e-7 * (time[-1] - time[0]):
                        raise Lost(f"no step from {t:.6g} s")
                q, t = new, t + h
                if abs(t - want) < 1e-14 * (1.0 + abs(want)):
                    t = float(want)
                v, a = self.rates(t, q)
                worst = max(worst, float(np.linalg.cond(self.system(t, q, None)[1])))
            out.append((q, v, a))
        q, v, a = (np.array(x) for x in zip(*out, strict=True))
        return q, v, a, worst
