"""The two mechanisms that are compared, and reference values for them that share no code with any of the peers.

The reference: positions in closed form, evaluated on truncated Taylor series of 30-digit numbers, so that velocities and
accelerations follow from the positions alone; forces by statics, link by link.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np

__all__ = ["FOUR_BAR", "GRAVITY", "REFERENCES", "SLIDER_CRANK", "TRIAD", "angles"]

GRAVITY = 9.81


@dataclass(frozen=True)
class FourBar:
    """A at the origin, D at (ground, 0); C on the left of the way from B to D. P in the coupler's axes, x from B to C."""

    ground: float = 4.0
    crank: float = 1.0
    coupler: float = 3.5
    rocker: float = 3.0
    p: tuple[float, float] = (1.5, 1.0)
    speed: float = 2.0  # of the crank, constant [rad/s]


@dataclass(frozen=True)
class SliderCrank:
    """Crank pivot O at the origin, pins B and C, slider on the line y = e, ahead. Centres of mass in link axes, the slider's at C.

    Gravity along -y, working force on the slider along x.
    """

    r: float = 0.05
    l: float = 0.18  # noqa: E741 - the letter of the textbooks
    e: float = 0.012
    m: tuple[float, float, float] = (1.1, 0.7, 0.9)  # crank, rod, slider
    j: tuple[float, float] = (0.002, 0.0021)  # about the centres of mass
    s1: float = 0.012
    s2: float = 0.055
    force: float = -4000.0
    speed: float = 150.0


@dataclass(frozen=True)
class Triad:
    """A plate on three legs, of which a crank at the origin drives the first: a group of class III, without a closed form.

    Legs from B to P, from M to Q, from N to R; P, Q, R in the plate's axes.
    """

    crank: float = 0.04
    legs: tuple[float, float, float] = (0.17, 0.2, 0.14)
    feet: tuple[tuple[float, float], ...] = ((0.36, -0.11), (0.23, 0.22))  # M, N
    plate: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.18, 0.02), (0.08, 0.14))  # P, Q, R
    start: tuple[float, float, float] = (0.2, -0.056, 0.76)  # P and the plate's angle, roughly, at crank angle 0
    speed: float = 7.0


FOUR_BAR = FourBar()
TRIAD = Triad()
SLIDER_CRANK = SliderCrank()


def angles(n: int) -> np.ndarray:
    """Crank angles of a turn."""
    return np.arange(n) * (2.0 * np.pi / n)


@dataclass(frozen=True)
class Series:
    """A value and its first two derivatives by time."""

    x: Any
    v: Any = 0
    a: Any = 0

    def __add__(self, o: Any) -> Series:
        o = o if isinstance(o, Series) else Series(o)
        return Series(self.x + o.x, self.v + o.v, self.a + o.a)

    def __mul__(self, o: Any) -> Series:
        o = o if isinstance(o, Series) else Series(o)
        return Series(self.x * o.x, self.v * o.x + self.x * o.v, self.a * o.x + 2 * self.v * o.v + self.x * o.a)

    def __neg__(self) -> Series:
        return Series(-self.x, -self.v, -self.a)

    def __sub__(self, o: Any) -> Series:
        return self + (-o)

    def inverse(self) -> Series:
        i = 1 / self.x
        return Series(i, -self.v * i * i, (2 * self.v * self.v * i - self.a) * i * i)

    def sqrt(self) -> Series:
        r = np.frompyfunc(mpmath.sqrt, 1, 1)(self.x)
        v = self.v / (2 * r)
        return Series(r, v, (self.a / 2 - v * v) / r)

    __radd__, __rmul__ = __add__, __mul__


def direction(angle: np.ndarray, speed: float) -> tuple[Series, Series]:
    """Unit vector that turns with a constant speed."""
    q = np.frompyfunc(mpmath.mpf, 1, 1)(angle)
    c, s = np.frompyfunc(mpmath.cos, 1, 1)(q), np.frompyfunc(mpmath.sin, 1, 1)(q)
    w = mpmath.mpf(speed)
    return Series(c, -w * s, -w * w * c), Series(s, w * c, -w * w * s)


def four_bar(angle: np.ndarray) -> dict[Any, np.ndarray]:
    """Position, velocity, acceleration (derivative 0, 1, 2) of B, C and P: (point, derivative) -> (F, 2)."""
    f, exact = FOUR_BAR, mpmath.mpf
    c, s = direction(angle, f.speed)
    bx, by = c * exact(f.crank), s * exact(f.crank)
    dx, dy = exact(f.ground) + (-bx), -by
    inverse = (dx * dx + dy * dy).inverse()
    along = (inverse * exact(f.coupler**2 - f.rocker**2) + 1) * exact(0.5)  # part of the way from B to D
    aside = (inverse * exact(f.coupler**2) - along * along).sqrt()
    ux, uy = along * dx - aside * dy, along * dy + aside * dx  # from B to C
    px, py = (exact(x) / exact(f.coupler) for x in f.p)
    points = {"B": (bx, by), "C": (bx + ux, by + uy), "P": (bx + ux * px - uy * py, by + uy * px + ux * py)}
    return {(k, d): np.stack([(z.x, z.v, z.a)[d] for z in xy], -1).astype(float) for k, xy in points.items() for d in range(3)}


def slider_crank(angle: np.ndarray) -> dict[Any, np.ndarray]:
    """Forces in O on the crank, B on the rod, C on the slider (F, 2), of the guide on the slider along y, torque on the crank."""
    p, exact = SLIDER_CRANK, mpmath.mpf
    r, l, e, s1, s2, f, g = (exact(x) for x in (p.r, p.l, p.e, p.s1, p.s2, p.force, GRAVITY))  # noqa: E741
    m1, m2, m3, j2 = *(exact(x) for x in p.m), exact(p.j[1])
    c, s = direction(angle, p.speed)
    sin = (e + (-(s * r))) * (1 / l)
    cos = (1 + (-(sin * sin))).sqrt()
    spin = (sin.a + sin.x * (sin.v / cos.x) ** 2) / cos.x  # angular acceleration: sin'' = cos alpha - sin omega^2
    x3 = c * r + cos * l
    ax, ay = (c * r + cos * s2).a, (s * r + sin * s2).a
    cx = m3 * x3.a - f  # in C on the slider
    moment = j2 * spin + m2 * s2 * (cos.x * (ay + g) - sin.x * ax)  # of what acts in C on the rod, about B: l cos (-cy) + l sin cx
    cy = (l * sin.x * cx - moment) / (l * cos.x)
    bx, by = m2 * ax + cx, m2 * (ay + g) + cy  # in B on the rod
    a1x, a1y = c.a * s1, s.a * s1
    ox, oy = m1 * a1x + bx, m1 * (a1y + g) + by
    torque = m1 * s1 * (c.x * (a1y + g) - s.x * a1x) + r * (c.x * by - s.x * bx)
    result = {"O": np.stack([ox, oy], -1), "B": np.stack([bx, by], -1), "C": np.stack([cx, cy], -1), "guide": m3 * g - cy}
    return {k: v.astype(float) for k, v in {**result, "torque": torque}.items()}


def triad(angle: np.ndarray) -> dict[Any, np.ndarray]:
    """Positions of P, Q and R: Newton's method on the three lengths in doubles from angle to angle, then twice in 30 digits."""
    p = TRIAD
    bx, by = p.crank * np.cos(angle), p.crank * np.sin(angle)

    def newton(x: Any, y: Any, c: Any, s: Any, b: tuple[Any, Any]) -> tuple[Any, Any, Any]:
        """A step of P and the plate's angle, by Cramer's rule; numbers or arrays of numbers of any precision."""
        rows = []
        for (u, v), foot, leg in zip(p.plate, (b, *p.feet), p.legs, strict=True):
            tx, ty = c * u - s * v, s * u + c * v
            dx, dy = x + tx - foot[0], y + ty - foot[1]
            rows.append((dx, dy, dy * tx - dx * ty, (dx * dx + dy * dy - leg * leg) / 2))
        (a1, b1, c1, r1), (a2, b2, c2, r2), (a3, b3, c3, r3) = rows

        def det(q1: Any, q2: Any, q3: Any, w1: Any, w2: Any, w3: Any, z1: Any, z2: Any, z3: Any) -> Any:
            return q1 * (w2 * z3 - w3 * z2) - w1 * (q2 * z3 - q3 * z2) + z1 * (q2 * w3 - q3 * w2)

        whole = det(a1, a2, a3, b1, b2, b3, c1, c2, c3)
        return (
            det(r1, r2, r3, b1, b2, b3, c1, c2, c3) / whole,
            det(a1, a2, a3, r1, r2, r3, c1, c2, c3) / whole,
            det(a1, a2, a3, b1, b2, b3, r1, r2, r3) / whole,
        )

    x, y, turn = p.start
    computed = np.empty((len(angle), 3))
    for k in range(len(angle)):
        for _ in range(30):
            dx, dy, d = newton(x, y, np.cos(turn), np.sin(turn), (bx[k], by[k]))
            x, y, turn = x - dx, y - dy, turn - d
            if abs(dx) + abs(dy) + abs(d) < 1e-15:
                break
        computed[k] = x, y, turn
    exact = np.frompyfunc(mpmath.mpf, 1, 1)
    px, py, q = (exact(column) for column in computed.T)
    cos, sin = np.frompyfunc(mpmath.cos, 1, 1), np.frompyfunc(mpmath.sin, 1, 1)
    b = exact(p.crank) * cos(exact(angle)), exact(p.crank) * sin(exact(angle))
    for _ in range(2):
        dx, dy, d = newton(px, py, cos(q), sin(q), b)
        px, py, q = px - dx, py - dy, q - d
    c, s = cos(q), sin(q)
    points = {n: (px + c * u - s * v, py + s * u + c * v) for n, (u, v) in zip("PQR", p.plate, strict=True)}
    return {(n, 0): np.stack(xy, -1).astype(float) for n, xy in points.items()}


REFERENCES = {"four-bar": four_bar, "slider-crank": slider_crank, "triad": triad}
mpmath.mp.dps = 30
