"""Substitute masses: a rigid body replaced by n point masses with the same inertia forces in any motion.

Four equations bind the 3n parameters (masses and coordinates): the total mass, the position of S (two), J_S. So p = 3n - 4
parameters are chosen, four follow. The equations are linear in the masses, and each of the two for S is linear in the coordinates:
whichever four are unknown, elimination leaves one polynomial in one unknown (mostly a quadratic, at most of degree four), whose
real roots give all solutions.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from mechcore.arrays import Real
from mechcore.constants import ZERO_SUM
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass

MassUnknown = tuple[int, str]  # index of a mass, "mass", "x" or "y"


@dataclass(frozen=True)
class PointMass:
    """One substitute mass, as far as it is known [kg, m from S]; None is unknown."""

    mass: float | None = None
    x: float | None = None
    y: float | None = None


@dataclass(frozen=True, eq=False)
class Substitution:
    """All real solutions, each as masses (n,) [kg] and positions (n, 2) [m] from S. ``message``: their number in words, or why
    there is none."""

    solutions: tuple[tuple[Real, Real], ...]
    message: str

    @property
    def negative(self) -> tuple[tuple[int, ...], ...]:
        """Indices of the negative masses of each solution: legitimate in calculation, not in hardware."""
        return tuple(tuple(int(i) for i in np.flatnonzero(m < 0.0)) for m, _ in self.solutions)


def substitute_masses(mass: float, inertia: float, points: Sequence[PointMass]) -> Substitution:
    """All real sets of point masses that replace a body with mass [kg] and J_S [kg m^2].

    ``points``: n of them with exactly four parameters unknown (p = 3n - 4 given). Raises `MechanismError` where the number is
    wrong, or where the choice makes the equations contradictory in form or satisfied by a whole family of positions.
    """
    n = len(points)
    unknown: list[MassUnknown] = [(i, k) for i, p in enumerate(points) for k in ("mass", "x", "y") if getattr(p, k) is None]
    if not (mass > 0.0 and inertia >= 0.0):
        raise MechanismError(
            Fault("substitute", f"a body of {mass:g} kg and {inertia:g} kg m^2.", "Give a positive mass and inertia.")
        )
    if len(unknown) != 4:
        given = 3 * n - len(unknown)
        remedy = f"Give {3 * n - 4}, so that four follow."
        raise MechanismError(Fault("substitute", f"{n} points have {3 * n} parameters and {given} of them are given.", remedy))
    places = [v for p in points for v in (p.x, p.y) if v is not None]
    length = max([float(np.sqrt(inertia / mass)), *(abs(v) for v in places)])
    task = _Task(
        inertia / (mass * length**2),
        [None if p.mass is None else p.mass / mass for p in points],
        [None if p.x is None else p.x / length for p in points],
        [None if p.y is None else p.y / length for p in points],
    )
    solved = [s for guess in task.solve(unknown) if (s := task.polished(guess, unknown)) is not None]
    solutions: list[tuple[Real, Real]] = []
    for m, xy in sorted(solved, key=lambda s: (np.sum(s[0] < 0.0), *s[0].round(9))):
        if not any(np.allclose(m, a, atol=1e-7) and np.allclose(xy, b, atol=1e-7) for a, b in solutions):
            solutions.append((m, xy))
    if solutions:
        count = {1: "one real solution", 2: "two real solutions"}.get(len(solutions), f"{len(solutions)} real solutions")
        where = [int(np.sum(m < 0.0)) for m, _ in solutions]
        signs = "" if not any(where) else f"; negative masses in {', '.join(str(k + 1) for k, w in enumerate(where) if w)}"
        message = count + signs
    else:
        message = "no real solution: no point masses of this choice have the body's moment of inertia"
    return Substitution(tuple((mass * m, length * xy) for m, xy in solutions), message)


class _Task:
    """The four equations in units of the body's mass and of a length: sum m = 1, sum m x = sum m y = 0, sum m (x^2 + y^2) = j."""

    def __init__(self, j: float, m: list[float | None], x: list[float | None], y: list[float | None]):
        self.j, self.given = j, {"mass": m, "x": x, "y": y}
        self.n = len(m)

    def value(self, i: int, what: str) -> float:
        return self.given[what][i] or 0.0

    def solve(self, unknown: Sequence[MassUnknown]) -> Iterable[Mapping[MassUnknown, float]]:
        """Real solutions as values of the unknowns, not yet polished."""
        masses = [u for u in unknown if u[1] == "mass"]
        coordinates = [u for u in unknown if u[1] != "mass"]
        if len(masses) >= 3:
            return self._by_determinant(masses, coordinates)
        if not masses:
            raise _undetermined("all masses are given, so that their sum is not left to follow.", "Leave at least one mass open.")
        return self._by_mass(masses, coordinates)

    def _columns(self, i: int, x: float, y: float) -> list[float]:
        return [1.0, x, y, x * x + y * y]

    def _by_determinant(self, masses: list[MassUnknown], coordinates: list[MassUnknown]) -> list[Mapping[MassUnknown, float]]:
        """Four masses unknown: a linear system. Three and a coordinate: it has a solution where a determinant vanishes."""
        one = [c for c, _ in coordinates]

        def system(c: float) -> tuple[Real, Real]:
            a = np.zeros((4, len(masses)))
            b = np.array([1.0, 0.0, 0.0, self.j])
            for i in range(self.n):
                x, y = (c if (i, k) in coordinates else self.value(i, k) for k in ("x", "y"))
                col = np.array(self._columns(i, x, y))
                if (i, "mass") in masses:
                    a[:, masses.index((i, "mass"))] = col
                else:
                    b = b - self.value(i, "mass") * col
            return a, b

        if not one:
            a, b = system(0.0)
            if np.linalg.cond(a) > 1e13:
                why = "the four points lie on one circle or line, which leaves the masses undetermined."
                raise _undetermined(why, "Move one of them.")
            return [dict(zip(masses, np.linalg.solve(a, b), strict=True))]
        values: list[float] = []
        for c in (-1.0, 0.0, 1.0):
            a, b = system(c)
            values.append(float(np.linalg.det(np.column_stack([a, b]))))
        quadratic = [values[1], 0.5 * (values[2] - values[0]), 0.5 * (values[2] + values[0]) - values[1]]
        out: list[Mapping[MassUnknown, float]] = []
        for c in _real_roots(quadratic, 1.0):
            a, b = system(c)
            m, *_ = np.linalg.lstsq(a, b, rcond=None)
            out.append({**dict(zip(masses, m, strict=True)), coordinates[0]: c})
        return out

    def _by_mass(self, masses: list[MassUnknown], coordinates: list[MassUnknown]) -> list[Mapping[MassUnknown, float]]:
        """One or two masses unknown: with ``t`` the first of them all masses are linear in t."""
        rest = 1.0 - sum(self.value(i, "mass") for i in range(self.n))
        t = Polynomial([0.0, 1.0]) if len(masses) == 2 else Polynomial([rest])
        of = {masses[0][0]: t}
        if len(masses) == 2:
            of[masses[1][0]] = rest - t
        m = [of.get(i, Polynomial([self.value(i, "mass")])) for i in range(self.n)]
        xs, ys = ([i for i, k in coordinates if k == what] for what in ("x", "y"))
        sums = {}
        for what, free in (("x", xs), ("y", ys)):
            sums[what] = sum((m[i] * self.value(i, what) for i in range(self.n) if i not in free), Polynomial([0.0]))
        square = sum(
            (m[i] * self.value(i, k) ** 2 for k, free in (("x", xs), ("y", ys)) for i in range(self.n) if i not in free),
            Polynomial([-self.j]),
        )
        if len(xs) == 1 and len(ys) == 1:
            return self._one_of_each(masses, m, sums, square, xs[0], ys[0])
        many, few = ("x", "y") if len(xs) > len(ys) else ("y", "x")
        far, near = (xs, ys) if many == "x" else (ys, xs)
        if len(masses) == 2:  # the sum without an unknown coordinate determines t
            line = sums[few].trim(ZERO_SUM)
            if line.degree() == 0:
                raise _form(float(line.coef[0]), few)
            start = [float(line.roots()[0].real)]
        else:
            start = [0.0]
            if not near:
                raise _form(float(sums[few](0.0)), few)
        out: list[Mapping[MassUnknown, float]] = []
        for at in start:
            known: dict[MassUnknown, float] = {u: float(of[u[0]](at)) for u in masses}
            left = float(square(at))
            if near:
                mu = float(m[near[0]](at))
                if abs(mu) <= ZERO_SUM:
                    raise _undetermined(f"mass {near[0] + 1} comes out as zero: its place has no influence.", "Choose otherwise.")
                value = -float(sums[few](at)) / mu
                known[near[0], few] = value
                left += mu * value**2
            out += [{**known, **joint} for joint in _line_and_conic(m, far, many, at, float(sums[many](at)), left)]
        return out

    def _one_of_each(
        self, masses: list[MassUnknown], m: list[Polynomial], sums: Mapping[str, Polynomial], square: Polynomial, p: int, q: int
    ) -> list[Mapping[MassUnknown, float]]:
        """One x and one y unknown: both follow from t, and the last equation is a polynomial in t."""
        sx, sy = sums["x"], sums["y"]
        parts = square * m[p] * m[q] + sx * sx * m[q] + sy * sy * m[p]
        whole = square * m[p] + sx * sx + sy * sy if p == q else parts
        out: list[Mapping[MassUnknown, float]] = []
        for t in _real_roots(list(whole.coef), 1.0):
            mu, nu = float(m[p](t)), float(m[q](t))
            if abs(mu) <= 1e-9 or abs(nu) <= 1e-9:  # a mass of zero somewhere: no solution of the equations themselves
                continue
            known = {u: float(m[u[0]](t)) for u in masses}
            out.append({**known, (p, "x"): -float(sx(t)) / mu, (q, "y"): -float(sy(t)) / nu})
        return out

    def polished(self, unknowns: Mapping[MassUnknown, float], unknown: Sequence[MassUnknown]) -> tuple[Real, Real] | None:
        """Masses and positions after Newton steps on the four equations; None where these are still not satisfied."""
        v = {k: np.array([self.value(i, k) for i in range(self.n)]) for k in ("mass", "x", "y")}
        for (i, k), value in unknowns.items():
            v[k][i] = value
        for step in range(4):
            m, x, y = v["mass"], v["x"], v["y"]
            res = np.array([m.sum() - 1.0, m @ x, m @ y, m @ (x * x + y * y) - self.j])
            scale = 1.0 + np.array([np.abs(m).sum(), np.abs(m * x).sum(), np.abs(m * y).sum(), np.abs(m) @ (x * x + y * y)])
            if step == 3:
                break
            jac = np.zeros((4, 4))
            for c, (i, k) in enumerate(unknown):
                column = {"mass": [1.0, x[i], y[i], x[i] ** 2 + y[i] ** 2], "x": [0.0, m[i], 0.0, 2.0 * m[i] * x[i]]}
                jac[:, c] = column.get(k, [0.0, 0.0, m[i], 2.0 * m[i] * y[i]])
            if np.linalg.cond(jac) > 1e9:  # a double root, which Newton would only disturb
                break
            for u, d in zip(unknown, np.linalg.solve(jac, res), strict=True):
                v[u[1]][u[0]] -= d
        if not np.all(np.abs(res) <= 1e-10 * scale):
            return None
        return v["mass"], np.column_stack([v["x"], v["y"]])


def _line_and_conic(
    m: list[Polynomial], joint: list[int], what: str, at: float, linear: float, left: float
) -> list[dict[MassUnknown, float]]:
    """mu u + nu v = -linear and mu u^2 + nu v^2 = -left, for the unknown coordinates u, v of two masses."""
    p, q = sorted(joint, key=lambda i: -abs(float(m[i](at))))
    mu, nu = float(m[p](at)), float(m[q](at))
    if abs(nu) <= ZERO_SUM:
        raise _undetermined(f"mass {q + 1} comes out as zero: its place has no influence.", "Choose otherwise.")
    roots = _real_roots([linear**2 + left * mu, 2.0 * linear * nu, nu**2 + mu * nu], 1.0)
    return [{(p, what): (-linear - nu * v) / mu, (q, what): v} for v in roots]


def _real_roots(coefficients: Sequence[float], scale: float) -> list[float]:
    """Real roots of a polynomial, lowest coefficient first; of a quadratic by its discriminant, a double root once."""
    c = np.array(coefficients, float)
    largest = np.abs(c).max(initial=0.0)
    if largest <= 1e-14 * scale:
        raise _undetermined("the four equations do not determine the four unknowns: a whole family solves them.", "Choose others.")
    while len(c) > 1 and abs(c[-1]) <= ZERO_SUM * largest:
        c = c[:-1]
    if len(c) == 1:
        return []
    if len(c) == 2:
        return [float(-c[0] / c[1])]
    if len(c) == 3:
        disc = c[1] ** 2 - 4.0 * c[2] * c[0]
        small = 1e-13 * (c[1] ** 2 + abs(4.0 * c[2] * c[0]))
        if disc < -small:
            return []
        if disc <= small:
            return [float(-0.5 * c[1] / c[2])]
        w = -0.5 * (c[1] + np.copysign(np.sqrt(disc), c[1]))
        return sorted([float(w / c[2]), float(c[0] / w)] if w != 0.0 else [0.0, 0.0])
    roots = np.roots(c[::-1])
    return sorted(float(r.real) for r in roots if abs(r.imag) <= 1e-7 * (1.0 + abs(r.real)))


def _undetermined(why: str, remedy: str) -> MechanismError:
    return MechanismError(Fault("substitute", why, remedy))


def _form(left_over: float, what: str) -> MechanismError:
    if abs(left_over) <= ZERO_SUM:
        return _undetermined("the four equations do not determine the four unknowns: a whole family solves them.", "Choose others.")
    why = f"nothing that is unknown can bring the centre of mass to S along {what}."
    return _undetermined(why, f"Leave a {what} open, or another mass.")


@dataclass(frozen=True)
class StaticReplacement:
    """Two masses [kg] at A and B with the body's mass and S, but not its J_S. ``excess``: their J_S less the body's [kg m^2].

    Their inertia forces differ from the body's by a couple: add `correction` to them.
    """

    masses: tuple[float, float]
    excess: float

    def correction(self, alpha: ArrayLike) -> Real:
        """Correction couple (...) [N m] that makes the two masses' inertia forces those of the body."""
        return self.excess * np.asarray(alpha, float)


def static_replacement(mass: float, inertia: float, a: ArrayLike, b: ArrayLike) -> StaticReplacement:
    """Two masses at chosen points A and B (from S [m]) on a line with S; raises `MechanismError` where S is not on line AB."""
    p, q = np.asarray(a, float), np.asarray(b, float)
    d = q - p
    length = float(np.hypot(*d))
    if length == 0.0 or abs(float(p[0] * q[1] - p[1] * q[0])) > 1e-9 * length * max(np.hypot(*p), np.hypot(*q)):
        why = "the centre of mass does not lie on the line of the two points: two masses there cannot have it."
        raise MechanismError(Fault("static_replacement", why, "Move a point, or take three masses."))
    share = float(-(p @ d) / length**2)  # position of S from A to B
    masses = mass * (1.0 - share), mass * share
    own = masses[0] * float(p @ p) + masses[1] * float(q @ q)
    return StaticReplacement(masses=masses, excess=own - inertia)
