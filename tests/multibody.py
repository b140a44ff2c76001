"""A second formulation of motion under forces, to compare with: absolute coordinates with multipliers, integrated by scipy.

Every moving link has x, y and an angle of its own as states, so that no angle is ever taken from a rotation. Revolute and prismatic
joints hold on the level of accelerations; loads are gravity and torsion springs.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.integrate import solve_ivp

from mechcore.loads import TorsionSpring
from mechcore.spec import Mechanism, Prismatic, Revolute

ZERO = 1e-12  # of a mass or moment of inertia: massless links get as much


def turns_to(angle: float, about: float) -> float:
    """Whole turns [rad] that bring an angle nearest to another."""
    return 2.0 * np.pi * np.round((about - angle) / (2.0 * np.pi))


class Multibody:
    """A mechanism in absolute coordinates from a start: poses (x, y, angle) and velocities of its links."""

    def __init__(self, mechanism: Mechanism, poses: Mapping[str, np.ndarray], velocities: Mapping[str, np.ndarray]):
        self.mechanism = mechanism
        self.moving = [link for link in mechanism.links if link.name != mechanism.frame]
        self.place = {link.name: 3 * k for k, link in enumerate(self.moving)}
        self.points = {link.name: {p: complex(*xy) for p, xy in link.points.items()} for link in mechanism.links}
        self.start = np.concatenate([np.asarray(x[k.name], float) for x in (poses, velocities) for k in self.moving])
        self.turns = {
            s.name: turns_to(self._between(self.start, s), s.free_angle) for s in mechanism.loads if isinstance(s, TorsionSpring)
        }

    def _body(self, y: np.ndarray, link: str) -> tuple[complex, complex, complex, float]:
        """Origin, rotation, velocity of the origin, angular velocity."""
        if link not in self.place:
            return 0j, 1.0 + 0j, 0j, 0.0
        k, n = self.place[link], 3 * len(self.moving)
        return complex(y[k], y[k + 1]), np.exp(1j * y[k + 2]), complex(y[n + k], y[n + k + 1]), float(y[n + k + 2])

    def _between(self, y: np.ndarray, spring: TorsionSpring) -> float:
        first, second = (float(y[self.place[k] + 2]) if k in self.place else 0.0 for k in spring.links)
        return second - first

    def deflection(self, y: np.ndarray, spring: TorsionSpring) -> float:
        return self._between(y, spring) + self.turns[spring.name] - spring.free_angle

    def energy(self, y: np.ndarray) -> float:
        total = 0.0
        for link in self.moving:
            r, e, v, w = self._body(y, link.name)
            c = complex(*link.centre) * e
            total += 0.5 * link.mass * abs(v + 1j * w * c) ** 2 + 0.5 * link.inertia * w * w
            if "gravity" in self.mechanism.effects:
                total -= link.mass * ((r + c) * np.conj(complex(*self.mechanism.gravity))).real
        return total + sum(
            0.5 * s.stiffness * self.deflection(y, s) ** 2 for s in self.mechanism.loads if isinstance(s, TorsionSpring)
        )

    def rhs(self, _: float, y: np.ndarray) -> np.ndarray:
        n = 3 * len(self.moving)
        mass, force = np.zeros((n, n)), np.zeros(n)
        for link in self.moving:
            k = self.place[link.name]
            _, e, _, w = self._body(y, link.name)
            c = complex(*link.centre) * e
            m = link.mass + ZERO
            mass[k, k] = mass[k + 1, k + 1] = m
            mass[k, k + 2] = mass[k + 2, k] = -m * c.imag
            mass[k + 1, k + 2] = mass[k + 2, k + 1] = m * c.real
            mass[k + 2, k + 2] = link.inertia + ZERO + m * abs(c) ** 2
            pull = complex(*self.mechanism.gravity) * link.mass if "gravity" in self.mechanism.effects else 0j
            total = pull + m * w * w * c
            force[k : k + 3] = total.real, total.imag, (np.conj(c) * pull).imag
        for s in self.mechanism.loads:
            assert isinstance(s, TorsionSpring)
            for link, sign in zip(s.links, (1.0, -1.0), strict=True):
                if link in self.place:
                    force[self.place[link] + 2] += sign * s.stiffness * self.deflection(y, s)
        rows, right = [], []
        for pair in self.mechanism.pairs:
            for row, b in self._joint(y, pair):
                rows.append(row)
                right.append(b)
        g = np.array(rows)
        full = np.block([[mass, -g.T], [g, np.zeros((len(g), len(g)))]])
        found = np.linalg.lstsq(full, np.concatenate([force, right]), rcond=1e-14)[0]
        return np.concatenate([y[n:], found[:n]])

    def _joint(self, y: np.ndarray, pair: Revolute | Prismatic) -> list[tuple[np.ndarray, float]]:
        """Rows of ``G a = b`` of a joint."""
        n = 3 * len(self.moving)
        bodies = [self._body(y, link) for link in pair.links]
        arms = [self.points[link][p] * body[1] for link, p, body in zip(pair.links, pair.points, bodies, strict=True)]

        def row(of: list[tuple[complex, float]]) -> np.ndarray:
            """``Re(conj(z) (a_origin)) + c alpha`` of both links."""
            out = np.zeros(n)
            for link, (z, c) in zip(pair.links, of, strict=True):
                if link in self.place:
                    k = self.place[link]
                    out[k : k + 3] += z.real, z.imag, c
            return out

        if isinstance(pair, Revolute):
            drift = sum(sign * arm * body[3] ** 2 for sign, arm, body in zip((1.0, -1.0), arms, bodies, strict=True))
            return [
                (row([(z, (np.conj(z) * 1j * arms[0]).real), (-z, -(np.conj(z) * 1j * arms[1]).real)]), (np.conj(z) * drift).real)
                for z in (1.0 + 0j, 1j)
            ]
        guide = pair.guide
        (r1, _, v1, w1), (r2, _, v2, w2) = bodies
        _, e, _, w = bodies[guide]
        normal = 1j * complex(*pair.along) / abs(complex(*pair.along)) * e
        d = r2 + arms[1] - r1 - arms[0]
        rate = v2 + 1j * w2 * arms[1] - v1 - 1j * w1 * arms[0]
        turned = (np.conj(1j * normal) * d).real  # of the guide's angular acceleration
        b = -2.0 * w * (np.conj(1j * normal) * rate).real + w * w * (np.conj(normal) * d).real
        b -= (np.conj(normal) * (-w2 * w2 * arms[1] + w1 * w1 * arms[0])).real
        by = [-(np.conj(normal) * 1j * arms[0]).real, (np.conj(normal) * 1j * arms[1]).real]
        by[guide] += turned
        return [(row([(-normal, by[0]), (normal, by[1])]), b), (row([(0j, -1.0), (0j, 1.0)]), 0.0)]

    def run(self, times: np.ndarray, tolerance: float = 1e-12) -> np.ndarray:
        """States (n, 6 links) at times [s]: x, y, angle of each moving link, then their rates."""
        found = solve_ivp(self.rhs, (0.0, times[-1]), self.start, "DOP853", t_eval=times, rtol=tolerance, atol=1e-13)
        assert found.success
        return found.y.T
