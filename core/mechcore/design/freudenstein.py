"""Function generation: four-bars and slider-cranks whose output follows a function of the input (Freudenstein 1955).

With the frame along x and of length d, crank a at phi, coupler b, rocker c at psi:
``K1 cos psi - K2 cos phi + K3 = cos(phi - psi)``, K1 = d/a, K2 = d/c, K3 = (a^2 - b^2 + c^2 + d^2)/(2 a c).
A negative a or c is a positive length whose zero mark is turned by half a turn.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares, minimize_scalar

from mechcore.arrays import Real
from mechcore.design.four_bars import TURN, Defects, FourBar, judge_four_bars
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass

RESULTANT_SAMPLES = 64  # samples of the resultant over a turn: it is a trigonometric polynomial of degree 16 at most
ERROR_GRID = 361  # points between which extremes of the structural error are searched for
LEAST_LENGTH = 0.1  # least crank and rocker over the frame with both start angles free: else the fit tends to a gear pair
POLE_GROWTH = 1e3  # ratio of a function's peak between points of that grid to that on them, beyond which it is a pole
EXTREME_ACCURACY = 1e-8  # error of an extreme's place, as a part of the interval; the error of its value is the square
NOT_FINITE = Fault("function", "it has no finite value at some places of the range.", "Give another range.")


def chebyshev_points(start: float, end: float, count: int) -> Real:
    """Precision points (count,) in Chebyshev spacing within a range, from its start on."""
    j = np.arange(1, count + 1)
    return 0.5 * (start + end) - 0.5 * (end - start) * np.cos((2 * j - 1) * np.pi / (2 * count))


@dataclass(frozen=True)
class FunctionTask:
    """A function y(x) over a range of x, and the ranges [rad], signed, over which input and output turn meanwhile."""

    function: Callable[[Real], Real]
    start: float
    end: float
    input_range: float
    output_range: float

    @cached_property
    def _values_at_ends(self) -> tuple[float, float]:
        """The function at both ends of its range. Raises MechanismError where they are equal, or where it is not finite between."""
        x = np.linspace(self.start, self.end, ERROR_GRID)
        y = self._values(x)
        sizes = np.abs(y)
        k = min(max(int(sizes.argmax()), 1), ERROR_GRID - 2)
        _, peak = _largest(lambda at: float(self._values(np.array([at]))[0]), x[k - 1], x[k + 1])
        if abs(peak) > POLE_GROWTH * sizes.max():
            raise MechanismError(NOT_FINITE)
        first, last = float(y[0]), float(y[-1])
        if abs(first - last) <= 1e-12 * float(sizes.max()):
            raise MechanismError(
                Fault(
                    "function",
                    f"it has the value {first:g} at both ends of the range.",
                    "Give a range over which it gains something.",
                )
            )
        return first, last

    def _values(self, x: Real) -> Real:
        y = np.asarray(self.function(x), float)
        if not np.isfinite(y).all():
            raise MechanismError(NOT_FINITE)
        return y

    def turned(self, x: Real) -> tuple[Real, Real]:
        """Rotations of the input and of the required output at x (K,) since the start of the range [rad]."""
        x = np.asarray(x, float)
        first, last = self._values_at_ends
        turned = self.output_range * (self._values(x) - first) / (last - first)
        return self.input_range * (x - self.start) / (self.end - self.start), turned


def _largest(function: Callable[[float], float], start: float, end: float) -> tuple[float, float]:
    """The argument between two others, in either order, at which a function is largest in size, and its value there."""
    found = minimize_scalar(
        lambda at: -abs(function(at)), bounds=sorted((start, end)), method="bounded",
        options={"xatol": EXTREME_ACCURACY * abs(end - start)},
    )  # fmt: skip
    return float(found.x), function(found.x)


@dataclass(frozen=True, eq=False)
class FunctionGenerator:
    """A four-bar of frame length one. ``crank`` and ``rocker`` are signed; ``branch`` is the sign of the root that gives psi;
    ``points`` (K,) are the precision or fitted points, ``phi`` (K,) the crank angles there [rad]."""

    k: Real
    input_start: float
    output_start: float
    crank: float
    coupler: float
    rocker: float
    branch: int
    points: Real
    phi: Real
    defects: Defects

    def rocker_angles(self, phi: Real) -> Real:
        """psi (K,) [rad] at crank angles phi (K,) [rad] on its branch, NaN where it cannot be assembled."""
        k1, k2, k3 = self.k
        x, y, z = k1 - np.cos(phi), -np.sin(phi), k2 * np.cos(phi) - k3
        square = x * x + y * y - z * z
        root = np.sqrt(np.where(square >= 0.0, square, np.nan))
        return np.asarray(np.arctan2(y, x) + self.branch * np.arctan2(root, z))

    def four_bar(self) -> FourBar:
        """The four-bar with positive lengths. Its crank angle is phi, plus half a turn if ``crank`` is negative; likewise the
        rocker's."""
        psi = self.rocker_angles(self.phi)
        pins = self.crank * np.exp(1j * self.phi), 1.0 + self.rocker * np.exp(1j * psi)
        sides = np.sign(np.imag(np.conj(1.0 - pins[0]) * (pins[1] - pins[0])))
        side = int(next((s for s in sides if np.isfinite(s) and s), 1))
        return FourBar(0j, 1.0 + 0j, abs(self.crank), self.coupler, abs(self.rocker), side)

    def _near(self, phi: Real, wanted: Real) -> Real:
        """The rocker angles at phi, moved by whole turns to be nearest to ``wanted`` [rad]."""
        psi = self.rocker_angles(phi)
        return psi + TURN * np.round((wanted - psi) / TURN)

    def structural_error(self, task: FunctionTask, x: Real) -> Real:
        """Generated minus required output at x (K,) [rad], on the generator's branch."""
        phi, psi = task.turned(x)
        wanted = self.output_start + psi
        return self._near(self.input_start + phi, wanted) - wanted

    def largest_error(self, task: FunctionTask) -> tuple[float, float]:
        """The structural error of largest magnitude over the range [rad], signed, and its x; NaN and the first such x where the
        four-bar cannot be assembled."""
        x = np.linspace(task.start, task.end, ERROR_GRID)
        errors = self.structural_error(task, x)
        if np.isnan(errors).any():
            return float("nan"), float(x[np.isnan(errors)][0])
        k = int(np.abs(errors).argmax())
        if k in (0, ERROR_GRID - 1):
            return float(errors[k]), float(x[k])
        place, error = _largest(lambda at: float(self.structural_error(task, np.array([at]))[0]), x[k - 1], x[k + 1])
        return error, place

    def least_transmission(self, task: FunctionTask) -> float:
        """Least acute angle between coupler and rocker over the range [rad]."""
        x = np.linspace(task.start, task.end, ERROR_GRID)
        phi, _ = task.turned(x)
        angle = self.input_start + phi + (np.pi if self.crank < 0.0 else 0.0)
        return float(self.four_bar().transmission(angle).min())


def generators(
    task: FunctionTask, x: Real, input_start: float | None = None, output_start: float | None = None
) -> list[FunctionGenerator]:
    """The four-bars whose structural error vanishes at 3, 4 or 5 points x (K,): every real solution.

    3 points: both start angles [rad] are given. 4 points: that of the input, psi at the start follows from a quadratic.
    5 points: neither; the resultant of two such quadratics is a trigonometric polynomial, whose roots are all found. Solutions with
    an infinite length are left out.
    """
    phi, psi = task.turned(x)
    starts: list[tuple[float, float]]
    if len(x) == 3 and input_start is not None and output_start is not None:
        starts = [(input_start, output_start)]
    elif len(x) == 4 and input_start is not None and output_start is None:
        starts = [(input_start, output) for output in _output_starts(phi + input_start, psi)]
    elif len(x) == 5 and input_start is None and output_start is None:
        starts = _both_starts(phi, psi)
    else:
        given = " and ".join(name for name, value in (("input", input_start), ("output", output_start)) if value is not None)
        raise MechanismError(
            Fault("points", f"{len(x)} points with the start angle of {given or 'neither input nor output'} given do not fit.",
                  "Give both start angles with 3 points, that of the input with 4, none with 5.")
        )  # fmt: skip
    made = (_generator(phi, psi, *start, x) for start in starts)
    return [one for one in made if one is not None]


def fitted_generator(
    task: FunctionTask, x: Real, input_start: float, output_start: float, *, refine: bool = False, starts_too: bool = False
) -> FunctionGenerator:
    """The four-bar of least squares over many points x (K,).

    The residual of Freudenstein's equation is linear in K. With ``refine`` the structural error itself is minimised, with its exact
    derivatives; with ``starts_too`` over both start angles as well. Raises MechanismError where no real four-bar results.
    """
    phi, psi = task.turned(x)
    rows, right = _rows(phi + input_start, psi + output_start)
    k = np.asarray(np.linalg.lstsq(rows, right, rcond=None)[0], float)
    if refine:
        free = 5 if starts_too else 3
        begin = np.array([*k, input_start, output_start])
        most = np.array([1.0 / LEAST_LENGTH if starts_too else np.inf] * 2 + [np.inf] * (free - 2))

        def unknowns(given: Real) -> Real:
            return np.asarray(np.concatenate([given, begin[free:]]), float)

        def errors(given: Real) -> Real:
            made = _generator(phi, psi, float(unknowns(given)[3]), float(unknowns(given)[4]), x, unknowns(given)[:3])
            error = np.full(len(x), np.nan) if made is None else made.structural_error(task, x)
            return np.where(np.isfinite(error), error, np.pi)

        def slopes(given: Real) -> Real:
            k1, k2, *_ = unknowns(given)
            p = phi + unknowns(given)[3]
            s = psi + unknowns(given)[4] + errors(given)
            by_psi = -k1 * np.sin(s) - np.sin(p - s)
            by_phi = k2 * np.sin(p) + np.sin(p - s)
            # the error is psi(K, phi) - psi_wanted - output_start
            columns = [-np.cos(s) / by_psi, np.cos(p) / by_psi, -1.0 / by_psi, -by_phi / by_psi, -np.ones_like(s)]
            return np.stack(columns[:free], axis=1)

        solved = unknowns(
            least_squares(
                errors, np.clip(begin[:free], -most, most), slopes, bounds=(-most, most), xtol=1e-14, ftol=1e-14, gtol=1e-14
            ).x
        )
        k, input_start, output_start = solved[:3], float(solved[3]), float(solved[4])
    generator = _generator(phi, psi, input_start, output_start, x, k)
    if generator is None:
        raise MechanismError(
            Fault(
                "function",
                "the four-bar of least squares is not real.",
                "Give other start angles, or smaller ranges of input and output.",
            )
        )
    return generator


def _rows(phi: Real, psi: Real) -> tuple[Real, Real]:
    """Freudenstein's equations at points: matrix (K, 3) on K1, K2, K3 and right side (K,)."""
    return np.stack([np.cos(psi), -np.cos(phi), np.ones_like(phi)], axis=1), np.cos(phi - psi)


def _generator(
    phi: Real, psi: Real, input_start: float, output_start: float, x: Real, k: Real | None = None
) -> FunctionGenerator | None:
    """The generator of start angles, with its defects at the points; None where it is not real."""
    p, s = phi + input_start, psi + output_start
    if k is None:
        rows, right = _rows(p[:3], s[:3])
        if np.linalg.cond(rows) > 1e12:
            return None
        k = np.asarray(np.linalg.solve(rows, right), float)
    if min(abs(k[0]), abs(k[1])) < 1e-9:
        return None
    a, c = 1.0 / k[0], 1.0 / k[1]
    square = a * a + c * c + 1.0 - 2.0 * a * c * k[2]
    if square <= 0.0:
        return None
    # psi = centre + branch * arc: the sign at the points, by the derivative of the equation with respect to psi
    sense = np.sign((k[0] - np.cos(p)) * np.sin(s) + np.sin(p) * np.cos(s))
    pins = a * np.exp(1j * p), 1.0 + c * np.exp(1j * s)
    defects = judge_four_bars(np.zeros(1, complex), np.ones(1, complex), pins[0][None], pins[1][None])
    branch = 1 if sense.sum() >= 0 else -1
    return FunctionGenerator(k, input_start, output_start, float(a), float(np.sqrt(square)), float(c), branch, x, p, defects)


# -- four and five points ---------------------------------------------------------------------------------------------
def _form(phi: Real, psi: Real) -> Real:
    """A, B, C of ``A cos^2 s + B cos s sin s + C sin^2 s = 0``: the condition on s under which K exists for four points (4,) with
    the output angles psi + s."""
    one, cos_phi = np.ones(4), np.cos(phi)

    def det(first: Real, last: Real) -> float:
        return float(np.linalg.det(np.stack([first, cos_phi, one, last], axis=1)))

    c, s, cd, sd = np.cos(psi), np.sin(psi), np.cos(phi - psi), np.sin(phi - psi)
    return np.array([det(c, cd), det(c, sd) - det(s, cd), -det(s, sd)])


def _output_starts(phi: Real, psi: Real) -> list[float]:
    """The start angles of psi in [-pi/2, pi/2) for which four points can be met."""
    a, b, c = _form(phi, psi)
    size = np.hypot(a - c, b)
    if abs(a + c) > size or size == 0.0:
        return []
    middle, half = np.arctan2(b, a - c), np.arccos(-(a + c) / size)
    return sorted({float((angle / 2.0 + np.pi / 2.0) % np.pi - np.pi / 2.0) for angle in (middle - half, middle + half)})


def _both_starts(phi: Real, psi: Real) -> list[tuple[float, float]]:
    """Start angles of phi in [0, pi) and of psi in [-pi/2, pi/2) for which five points can be met."""
    firsts, lasts = [0, 1, 2, 3], [0, 1, 2, 4]

    def resultant(start: float) -> float:
        a1, b1, c1 = _form(phi[firsts] + start, psi[firsts])
        a2, b2, c2 = _form(phi[lasts] + start, psi[lasts])
        return float((a1 * c2 - a2 * c1) ** 2 - (a1 * b2 - a2 * b1) * (b1 * c2 - b2 * c1))

    samples = np.array([resultant(at) for at in np.arange(RESULTANT_SAMPLES) * TURN / RESULTANT_SAMPLES])
    harmonics = np.fft.fft(samples) / RESULTANT_SAMPLES
    half = RESULTANT_SAMPLES // 2
    ordered = np.concatenate([harmonics[half:], harmonics[:half]])
    kept = np.flatnonzero(np.abs(ordered) > 1e-12 * np.abs(ordered).max())
    roots = np.roots(ordered[kept[0] : kept[-1] + 1][::-1])
    starts: list[tuple[float, float]] = []
    for angle in np.angle(roots[np.abs(np.abs(roots) - 1.0) < 1e-3]):
        for output in _output_starts(phi[firsts] + angle, psi[firsts]):
            polished = _polished(phi, psi, float(angle), output)
            if polished is not None and not any(np.hypot(*np.subtract(polished, other)) < 1e-7 for other in starts):
                starts.append(polished)
    return sorted(starts)


def _polished(phi: Real, psi: Real, input_start: float, output_start: float) -> tuple[float, float] | None:
    """Start angles that meet five points to rounding, by Newton's method for K and both; None where it fails or ends elsewhere."""
    rows, right = _rows(phi + input_start, psi + output_start)
    unknown = np.array([*np.linalg.lstsq(rows, right, rcond=None)[0], input_start, output_start])
    for _ in range(12):
        p, s = phi + unknown[3], psi + unknown[4]
        rows, right = _rows(p, s)
        residual = rows @ unknown[:3] - right
        by_phi = unknown[1] * np.sin(p) + np.sin(p - s)
        by_psi = -unknown[0] * np.sin(s) - np.sin(p - s)
        matrix = np.column_stack([rows, by_phi, by_psi])
        if not np.isfinite(matrix).all() or np.linalg.cond(matrix) > 1e12:
            return None
        unknown = unknown - np.linalg.solve(matrix, residual)
    if not np.abs(residual).max() < 1e-11 * (1.0 + np.abs(unknown[:3]).max()):
        return None
    if np.abs(np.angle(np.exp(2j * (unknown[3:] - (input_start, output_start))))).max() > 0.05:
        return None
    first = unknown[3] % TURN
    second = unknown[4]
    if first >= np.pi:
        first -= np.pi
    return float(first), float((second + np.pi / 2.0) % np.pi - np.pi / 2.0)


# -- slider-cranks ----------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class SliderGenerator:
    """A slider-crank: crank and rod [m], offset [m] of the slide's line y = offset from the crank's pivot. ``side``: sign of the
    rod's x component; ``branch``: whether the points are on both sides (branch defect)."""

    crank: float
    rod: float
    offset: float
    input_start: float
    output_start: float
    side: int
    branch: bool

    def displacements(self, phi: Real) -> Real:
        """x of the slider's pin [m] at crank angles (K,) [rad], on its branch; NaN where it cannot be assembled."""
        square = self.rod**2 - (self.offset - self.crank * np.sin(phi)) ** 2
        return np.asarray(self.crank * np.cos(phi) + self.side * np.sqrt(np.where(square >= 0.0, square, np.nan)))


def slider_generator(phi: Real, s: Real, input_start: float, output_start: float) -> SliderGenerator | None:
    """The slider-crank whose slider is at ``output_start + s`` (3,) [m] at crank angles ``input_start + phi`` (3,) [rad]; with
    more points the least-squares fit; None where it is not real.

    ``s^2 = k1 s cos phi + k2 sin phi + k3``, k1 = 2a, k2 = 2ae, k3 = b^2 - a^2 - e^2 (Hartenberg and Denavit).
    """
    angle, x = phi + input_start, s + output_start
    rows = np.stack([x * np.cos(angle), np.sin(angle), np.ones_like(x)], axis=1)
    k1, k2, k3 = np.linalg.lstsq(rows, x * x, rcond=None)[0]
    if k1 == 0.0:
        return None
    crank, offset = k1 / 2.0, k2 / k1
    square = k3 + crank**2 + offset**2
    if square <= 0.0:
        return None
    ahead = x - crank * np.cos(angle)
    turned = input_start + (np.pi if crank < 0.0 else 0.0)
    side = 1 if ahead.sum() >= 0.0 else -1
    one_branch = bool((ahead > 0.0).all() or (ahead < 0.0).all())
    return SliderGenerator(abs(crank), float(np.sqrt(square)), float(offset), turned, output_start, side, not one_branch)
