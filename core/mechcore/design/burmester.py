"""Motion generation: dyads and four-bars that guide a body through 2 to 5 positions (Burmester theory, kinematic mapping).

A pose is a place T of the body's origin and an angle alpha; a point w of the body is at ``T + w e^(i alpha)``. A dyad is a
point w of the body (moving pivot) that keeps its distance from a point C of the frame (fixed pivot) in all poses.
"""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.design.four_bars import Defects, judge_four_bars
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechcore.texts import as_length

LEAST_REACH = 1e-12  # [m] of the poses: below, they have one place
INFINITE_PIVOT = 1e6  # distance, relative to the reach of the poses, from which on pivots count as at infinity
ON_LINE = 1e-7  # distance from a line, relative to the reach, up to which a point is on it
NEWTON_STEPS = 8  # steps that refine the dyads of five positions
REAL_ROOT = 1e-7  # imaginary part over modulus below which a root counts as real before it is refined


@dataclass(frozen=True, eq=False)
class BodyPositions:
    """Places (N,) [m], complex, and angles (N,) [rad] of a body in N positions, in order."""

    places: Complex
    angles: Real

    def __post_init__(self) -> None:
        if len(self.places) < 2:
            raise MechanismError(Fault("poses", f"{len(self.places)} position.", "Give two or more."))
        for i in range(len(self.places)):
            for j in range(i):
                if self.places[i] == self.places[j] and self.turns[i] == self.turns[j]:
                    raise MechanismError(Fault("poses", f"positions {j + 1} and {i + 1} are the same.", "Give each position once."))
        self._refuse_hinge()

    def _refuse_hinge(self) -> None:
        """Refuse rotations about one point: of two positions only where that is the body's origin, else all are such."""
        centre = self.pole(0, 1)
        arms = centre - self.places
        scale = max(float(np.abs(arms).max()), self.reach)
        away = np.abs(arms - arms[0] * self.turns / self.turns[0]).max()  # NaN where there is no centre
        if away <= 1e-9 * scale and (len(self.places) > 2 or self.reach == LEAST_REACH):
            x, y = (0.0 if abs(c) < 1e-9 * scale else c for c in (centre.real, centre.imag))
            why = f"the body only turns about one point, x = {as_length(x)}, y = {as_length(y)}."
            raise MechanismError(Fault("poses", why, "A revolute joint there leads it; or give positions off that rotation."))

    @property
    def turns(self) -> Complex:
        """Unit vectors of the body's x axis (N,)."""
        return np.asarray(np.exp(1j * self.angles))

    def of_points(self, w: Complex) -> Complex:
        """Places of points of the body (...,) in all poses: (..., N)."""
        return self.places + np.asarray(w)[..., None] * self.turns

    def of_frame(self, c: Complex) -> Complex:
        """Places of points of the frame (...,) in the body's coordinates in all poses: (..., N)."""
        return (np.asarray(c)[..., None] - self.places) / self.turns

    @property
    def inverse(self) -> BodyPositions:
        """The poses of the frame in the body's coordinates: their circle points are the centre points of these poses."""
        return BodyPositions(-self.places / self.turns, -self.angles)

    @property
    def reach(self) -> float:
        """Largest distance of two places [m], at least `LEAST_REACH`: the scale of distances."""
        return float(max(np.abs(self.places[:, None] - self.places).max(), LEAST_REACH))

    def pole(self, i: int, j: int) -> complex:
        """Pole of the displacement from pose i to pose j: the point of the frame about which the body rotates; NaN for a
        translation."""
        turn = self.turns[j] - self.turns[i]
        if abs(turn) < 1e-14:
            return complex(np.nan, np.nan)
        w = -(self.places[j] - self.places[i]) / turn
        return complex(self.places[i] + w * self.turns[i])


def circumcentres(points: Complex) -> Complex:
    """Centres (...,) of the circles through three points (..., 3); infinite where they lie on a line."""
    p, q = points[..., 1] - points[..., 0], points[..., 2] - points[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        from_first: Complex = 1j * (q * np.abs(p) ** 2 - p * np.abs(q) ** 2) / (2.0 * np.imag(np.conj(q) * p))
    return points[..., 0] + from_first


def fixed_pivots(poses: BodyPositions, w: Complex) -> Complex:
    """Fixed pivots (...,) of moving pivots w (...,) of a body in three poses (in the first three of more)."""
    return circumcentres(poses.of_points(w)[..., :3])


def moving_pivots(poses: BodyPositions, c: Complex) -> Complex:
    """Moving pivots (...,), in the body, of fixed pivots C (...,) for three poses (the first three of more)."""
    return circumcentres(poses.of_frame(c)[..., :3])


def bisector(poses: BodyPositions, w: complex) -> tuple[complex, complex]:
    """The line of fixed pivots for a moving pivot and two poses: a point of it and its direction."""
    first, second = (complex(z) for z in poses.of_points(np.array(w))[:2])
    return 0.5 * (first + second), 1j * (second - first)


# -- four poses -------------------------------------------------------------------------------------------------------
def circle_point_values(poses: BodyPositions, w: Complex) -> Real:
    """``det [|z|^2, x, y, 1]`` of a point's places z in four poses (...,): zero on the circle-point curve, a circular cubic."""
    z = poses.of_points(w)[..., :4]
    z = z - z[..., :1]
    rows = np.stack([np.abs(z[..., 1:]) ** 2, z[..., 1:].real, z[..., 1:].imag], axis=-1)
    return np.asarray(np.linalg.det(rows), float)


@dataclass(frozen=True, eq=False)
class BurmesterCurve:
    """Points w (K,) of the circle-point curve in the body and their fixed pivots C (K,), points of the centre-point curve. Points
    of one piece are in order; NaN separates the pieces."""

    w: Complex
    c: Complex


def first_pole(poses: BodyPositions) -> tuple[complex, int]:
    """A pole of two poses, and the number of the first of them. Raises `MechanismError` where the body only translates."""
    for i in range(len(poses.places)):
        for j in range(i):
            if np.isfinite(pole := poses.pole(j, i)):
                return pole, j
    remedy = "Turn it in one position at least: else every parallel crank will do."
    raise MechanismError(Fault("poses", "the body only translates.", remedy))


def burmester_curve(poses: BodyPositions, count: int = 720, *, joined: bool = False) -> BurmesterCurve:
    """Circle-point and centre-point curve of four poses; ``joined``: with lines between the two roots where these are about to
    become complex, which close the gaps of a drawing.

    A line through a point of the cubic meets it in two more points, the roots of a quadratic. All real points come from ``count``
    lines through the image of a pole in the body, which lies on the cubic.
    """
    if len(poses.places) != 4:
        raise MechanismError(Fault("poses", f"{len(poses.places)} positions.", "Burmester's curves are those of four positions."))
    pole, own = first_pole(poses)
    origin = (pole - poses.places[own]) / poses.turns[own]
    scale = poses.reach
    angles = np.pi * (np.arange(count) + 0.5) / count
    directions = np.exp(1j * angles)
    nodes = np.array([-1.0, 1.0, 2.0]) * scale
    values = circle_point_values(poses, origin + directions[:, None] * nodes) / nodes  # a quadratic of the distance
    c, b, a = np.linalg.solve(np.vander(nodes, 3, increasing=True), values.T)
    root = np.sqrt(np.where((square := b * b - 4.0 * a * c) >= 0.0, square, np.nan))
    with np.errstate(divide="ignore", invalid="ignore"):
        summed = -0.5 * (b + np.where(b >= 0.0, 1.0, -1.0) * root)
        distances = np.stack([summed / a, c / summed])
    distances = np.where(np.abs(distances) < INFINITE_PIVOT * scale, distances, np.nan)
    w = _sorted_pieces(origin + distances * directions, scale, joined)
    return BurmesterCurve(w, fixed_pivots(poses, w))


def _sorted_pieces(points: Complex, scale: float, joined: bool) -> Complex:
    """Two roots per line (2, K) as pieces: the root that continues the last one stays in its row."""
    rows = points.copy()
    for k in range(1, rows.shape[1]):
        straight, exchanged = np.abs(rows[:, k] - rows[:, k - 1]), np.abs(rows[::-1, k] - rows[:, k - 1])
        if np.nansum(exchanged) < np.nansum(straight):
            rows[:, k] = rows[::-1, k]
    pieces = []
    for row in rows:
        far = np.flatnonzero(np.abs(np.diff(row)) > 0.5 * scale + 0.2 * np.abs(row[1:]))
        pieces.append(np.insert(row, far + 1, np.nan))
        pieces.append(np.array([np.nan + 0j]))
    known = np.pad(np.isfinite(rows).all(axis=0), 1)
    none = np.pad(np.isnan(rows).all(axis=0), 1)
    for k in np.flatnonzero(known[1:-1] & (none[:-2] | none[2:])).tolist() if joined else ():
        pieces += [rows[:, k], np.array([np.nan + 0j])]
    return np.concatenate(pieces)


def slider_points(poses: BodyPositions, count: int = 72) -> tuple[Complex, Complex]:
    """Points w (S,) of the body that lie on a straight line in all poses, and the lines' unit directions (S,).

    A fixed pivot at infinity: ``Re(conj(n)(T + e^(i alpha) w)) = p``, linear in n, conj(n) w and p. For two poses every point is a
    solution, for three a circle of points; about ``count`` of them are returned. Four poses have one solution, more in general
    none. Raises MechanismError where there is none.
    """
    t, z = poses.places, poses.turns
    scale, number = poses.reach, len(poses.places)
    rows = np.stack([t.real / scale, t.imag / scale, z.real, -z.imag, -np.ones(number)], axis=1)
    _, sizes, basis = np.linalg.svd(rows)
    free = max(5 - number, 1)
    if number == 2:  # directions spread over a half sphere
        k = np.arange(count) + 0.5
        height, turn = k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
        flat = np.sqrt(1.0 - height**2)
        parts = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)
    else:
        angles = np.pi * (np.arange(count) + 0.5) / count
        parts = np.stack([np.cos(angles), np.sin(angles)], axis=1) if number == 3 else np.ones((1, 1))
    n_x, n_y, b_x, b_y, _ = (parts @ basis[5 - free :]).T
    normal = (n_x + 1j * n_y) / scale
    usable = np.abs(normal) * scale > 1e-9
    off = sizes[-1] / np.maximum(np.abs(normal), 1e-300) if number > 4 else np.zeros(len(normal))
    if not usable.any():
        raise MechanismError(
            Fault("poses", "no point of the body lies on a line in all of them.", "Give other positions, or take cranks only.")
        )
    if off[0] > ON_LINE * scale:
        why = f"of {number} positions no point of the body lies on a line in all: the best is {1e3 * off[0]:.3g} mm off."
        raise MechanismError(Fault("poses", why, "Give four positions or fewer, or take cranks only."))
    return ((b_x + 1j * b_y)[usable] / normal[usable].conj()), (1j * normal / np.abs(normal))[usable]


# -- five poses -------------------------------------------------------------------------------------------------------
def burmester_points(poses: BodyPositions) -> tuple[Complex, Complex]:
    """All real dyads of five poses: moving pivots (R,) in the body, sorted by x, and fixed pivots (R,); R = 0, 2 or 4.

    Kinematic mapping: distance equations are linear in q = [h, w, C, w conj(C), k]; their null space for five poses is intersected
    with the two quadrics of the products. With more poses the three least singular vectors take the place of the null space, and
    the dyads are least-squares fits of the distances.
    """
    if len(poses.places) < 5:
        raise MechanismError(Fault("poses", f"{len(poses.places)} positions.", "Burmester's points are those of five or more."))
    origin = poses.places.mean()
    scale = max(float(np.abs(poses.places - origin).max()), 1e-300)
    t, turn = (poses.places - origin) / scale, poses.turns
    z = np.conj(t) * turn
    one = np.ones(len(t))
    rows = np.stack([np.abs(t) ** 2, 2 * z.real, -2 * z.imag, -2 * t.real, -2 * t.imag, -2 * turn.real, 2 * turn.imag, one], axis=1)
    basis = np.linalg.svd(rows)[2][-3:]
    found_w: list[complex] = []
    found_c: list[complex] = []
    for x in _conic_points(*(basis @ form @ basis.T for form in _FORMS)):
        h, w_x, w_y, c_x, c_y, *_ = x @ basis
        if abs(h) * INFINITE_PIVOT < abs(complex(w_x, w_y)) + abs(complex(c_x, c_y)):
            continue
        w, c = _dyad(t, turn, complex(w_x, w_y) / h, complex(c_x, c_y) / h)
        if np.isfinite(w) and not any(abs(w - other) < 1e-9 * (1.0 + abs(w)) for other in found_w):
            found_w.append(w)
            found_c.append(c)
    pairs = sorted(zip(found_w, found_c, strict=True), key=lambda pair: pair[0].real)
    w_of, c_of = (np.array([pair[k] for pair in pairs], np.complex128) for k in (0, 1))
    return scale * w_of, origin + scale * c_of


def _quadric(products: list[tuple[int, int, float]]) -> Real:
    form = np.zeros((8, 8))
    for i, j, value in products:
        form[i, j] += value / 2.0
        form[j, i] += value / 2.0
    return form


_FORMS = (
    _quadric([(5, 0, 1.0), (1, 3, -1.0), (2, 4, -1.0)]),  # Re(w conj C) = B_x h
    _quadric([(6, 0, 1.0), (2, 3, -1.0), (1, 4, 1.0)]),  # Im(w conj C) = B_y h
)


def _conic_points(first: Real, second: Real) -> list[Real]:
    """Real common points (3,) of two conics (3, 3), homogeneous; complex ones and double ones with a large error are left out."""
    turned, _ = np.linalg.qr(np.array([[0.6, 0.3, -0.5], [-0.2, 0.9, 0.4], [0.7, -0.1, 0.8]]))  # no coordinate is special
    m, n = turned.T @ first @ turned, turned.T @ second @ turned
    # x = (s, t, 1): a s^2 + b(t) s + c(t), polynomials of t from the lowest power on
    (a1, b1, c1), (a2, b2, c2) = (
        (np.array([q[0, 0]]), 2.0 * np.array([q[0, 2], q[0, 1]]), np.array([q[2, 2], 2.0 * q[1, 2], q[1, 1]])) for q in (m, n)
    )
    poly = np.polynomial.polynomial
    ac = poly.polysub(poly.polymul(a1, c2), poly.polymul(a2, c1))
    ab: Real = poly.polysub(poly.polymul(a1, b2), poly.polymul(a2, b1))
    bc = poly.polysub(poly.polymul(b1, c2), poly.polymul(b2, c1))
    resultant = poly.polysub(poly.polymul(ac, ac), poly.polymul(ab, bc))
    roots = poly.polyroots(resultant)
    points = []
    for t in roots.real[np.abs(roots.imag) < REAL_ROOT * (1.0 + np.abs(roots))]:
        below = float(poly.polyval(t, ab))
        if below != 0.0:
            points.append(np.asarray(turned @ np.array([-float(poly.polyval(t, ac)) / below, t, 1.0]), float))
    return points


def _dyad(t: Complex, turn: Complex, w: complex, c: complex) -> tuple[complex, complex]:
    """A dyad refined by the Gauss-Newton method on the deviations of the distances from their mean; NaN where it does not
    converge."""
    for _ in range(NEWTON_STEPS):
        arm = t + turn * w - c
        length = np.abs(arm)
        unit = arm / length
        residual = length - length.mean()
        columns = np.stack([(np.conj(unit) * turn).real, -(np.conj(unit) * turn).imag, -unit.real, -unit.imag], axis=1)
        step = np.linalg.lstsq(columns - columns.mean(0), -residual, rcond=None)[0]
        w, c = w + complex(step[0], step[1]), c + complex(step[2], step[3])
        if not np.isfinite(step).all():
            return complex(np.nan), complex(np.nan)
    settled = np.abs(step).max() < 1e-7 * (1.0 + abs(w) + abs(c))
    return (w, c) if settled else (complex(np.nan), complex(np.nan))


# -- linkages ---------------------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Guidance:
    """D four-bars that guide a body through poses: moving pivots w (D, 2) in the body and fixed pivots C (D, 2), the driven
    one first, and their defects."""

    w: Complex
    c: Complex
    defects: Defects


def guidance(poses: BodyPositions, w: Complex, c: Complex) -> Guidance:
    """All four-bars of two of the dyads (R,), driven at either dyad, with their defects in the order of the poses."""
    count = len(w)
    first, second = (index.ravel() for index in np.meshgrid(np.arange(count), np.arange(count), indexing="ij"))
    apart = (first != second) & (np.abs(w[first] - w[second]) > 1e-9) & (np.abs(c[first] - c[second]) > 1e-9)
    first, second = first[apart], second[apart]
    pins = poses.of_points(w)
    defects = judge_four_bars(c[first], c[second], pins[first], pins[second])
    return Guidance(np.stack([w[first], w[second]], axis=1), np.stack([c[first], c[second]], axis=1), defects)
