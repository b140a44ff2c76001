"""Four-bars as plain lengths and pivots: positions, Grashof's rule, cognates, transmission angle, defects.

A plane vector is a complex number. Frame pivots O2 and O4, crank O2-A, coupler A-B, rocker O4-B. ``side`` is +1 where B lies left
of A -> O4. A point of the coupler is ``A + tracer (B - A)/coupler``: ``tracer`` is its place in the frame of the coupler.
"""

from __future__ import annotations

from enum import Enum
from typing import Any

import numpy as np

from mechcore.arrays import Complex, Flags, Index, Plane, Real
from mechcore.kinematics.dyads import cross
from mechcore.records import dataclass

TURN = 2.0 * np.pi


class Grashof(Enum):
    """Type of motion of the crank (the driven link) and the rocker of a four-bar, as its lengths allow."""

    CRANK_ROCKER = "crank-rocker"
    ROCKER_CRANK = "rocker-crank"
    DOUBLE_CRANK = "double crank"
    DOUBLE_ROCKER = "double rocker"
    TRIPLE_ROCKER = "triple rocker"
    CHANGE_POINT = "change point"


@dataclass(frozen=True)
class FourBar:
    """Lengths [m] and pivots [m] of one four-bar; see the module for names and signs."""

    crank_pivot: complex
    rocker_pivot: complex
    crank: float
    coupler: float
    rocker: float
    side: int = 1
    tracer: complex = 0j

    @property
    def frame(self) -> float:
        """Distance of the frame pivots [m]."""
        return abs(self.rocker_pivot - self.crank_pivot)

    @property
    def frame_angle(self) -> float:
        """Direction of O2 -> O4 [rad]."""
        return float(np.angle(self.rocker_pivot - self.crank_pivot))

    @property
    def grashof(self) -> Grashof:
        """Type by Grashof's rule: shortest plus longest against the sum of the other two; equal within 1e-9: change point."""
        lengths = (self.crank, self.coupler, self.rocker, self.frame)
        margin = sum(lengths) - 2.0 * (min(lengths) + max(lengths))
        if abs(margin) <= 1e-9 * sum(lengths):
            return Grashof.CHANGE_POINT
        if margin < 0.0:
            return Grashof.TRIPLE_ROCKER
        kinds = (Grashof.CRANK_ROCKER, Grashof.DOUBLE_ROCKER, Grashof.ROCKER_CRANK, Grashof.DOUBLE_CRANK)
        return kinds[lengths.index(min(lengths))]

    @property
    def crank_turns(self) -> bool:
        """Whether the crank makes full turns."""
        return self.grashof in (Grashof.CRANK_ROCKER, Grashof.DOUBLE_CRANK)

    def positions(self, theta: Real) -> tuple[Complex, Complex, Complex]:
        """Pins A and B and the traced point at crank angles (K,) [rad, from x]; NaN where it cannot be assembled."""
        a = np.asarray(self.crank_pivot + self.crank * np.exp(1j * np.asarray(theta, float)), np.complex128)
        h = self.rocker_pivot - a
        square = np.abs(h) ** 2
        with np.errstate(invalid="ignore", divide="ignore"):  # crank and frame of one length: A may coincide with O4
            along = (square + self.coupler**2 - self.rocker**2) / (2.0 * square)
            height = self.coupler**2 / square - along**2
            across = np.sqrt(np.where(height >= 0.0, height, np.nan))
        b: Complex = a + h * (along + 1j * self.side * across)
        return a, b, a + self.tracer * (b - a) / self.coupler

    def cognates(self, theta: float) -> tuple[FourBar, FourBar]:
        """The two other four-bars that draw the same curve (Roberts and Chebyshev), in the assembly modes of a crank angle [rad].
        The first keeps the crank pivot and has O3 as rocker pivot; the second has the pivots O3 and O4."""
        third = self.crank_pivot + self.tracer / self.coupler * (self.rocker_pivot - self.crank_pivot)
        p = complex(self.positions(np.array([theta]))[2][0])
        first, second = self.cognate_pins(theta)
        return from_pins(self.crank_pivot, third, *first, p), from_pins(third, self.rocker_pivot, *second, p)

    def cognate_pins(self, theta: float) -> tuple[tuple[complex, complex], tuple[complex, complex]]:
        """Crank pin and rocker pin of the two `cognates` at a crank angle [rad]."""
        a, b, p = (complex(z[0]) for z in self.positions(np.array([theta])))
        ratio = self.tracer / self.coupler
        third = self.crank_pivot + ratio * (self.rocker_pivot - self.crank_pivot)
        first = self.crank_pivot + p - a, third + ratio * (b - self.rocker_pivot)
        return first, (third + (1.0 - ratio) * (a - self.crank_pivot), self.rocker_pivot + p - b)

    def transmission(self, theta: Real) -> Real:
        """Transmission angle between coupler and rocker, acute [rad], at crank angles (K,) [rad]."""
        a, b, _ = self.positions(theta)
        angles: Real = acute(a - b, self.rocker_pivot - b)
        return angles

    def least_transmission(self) -> float:
        """Least transmission angle [rad] of a four-bar whose crank turns fully: where crank and frame are in line."""
        return float(self.transmission(self.frame_angle + np.array([0.0, np.pi])).min())

    def scaled(self, factor: float) -> FourBar:
        """All lengths and places times a factor."""
        return FourBar(
            self.crank_pivot * factor, self.rocker_pivot * factor, self.crank * factor, self.coupler * factor,
            self.rocker * factor, self.side, self.tracer * factor,
        )  # fmt: skip


def from_pins(crank_pivot: complex, rocker_pivot: complex, a: complex, b: complex, traced: complex | None = None) -> FourBar:
    """The four-bar with its pins at A and B, and with a coupler point at ``traced``."""
    coupler = abs(b - a)
    tracer = 0j if traced is None else complex((traced - a) / (b - a) * coupler)
    side = 1 if cross(rocker_pivot - a, b - a) >= 0.0 else -1
    return FourBar(crank_pivot, rocker_pivot, abs(a - crank_pivot), coupler, abs(b - rocker_pivot), side, tracer)


@dataclass(frozen=True, eq=False)
class Defects:
    """Defects by which D linkages do not pass their K positions in one sense of the driver; flags (D,), true is a defect.

    ``branch``: a dead point of the driver lies between positions. ``circuit``: the linkage has to be disassembled between them.
    ``order``: the driver passes the positions in another order.
    """

    branch: Flags
    circuit: Flags
    order: Flags

    @property
    def none(self) -> Flags:
        """Linkages without a defect (D,)."""
        return ~(self.branch | self.circuit | self.order)

    def words(self, k: int) -> str:
        """The defects of linkage k: "branch, order" or ""."""
        return ", ".join(name for name in ("branch", "circuit", "order") if getattr(self, name)[k])


def judge_four_bars(crank_pivot: Complex, rocker_pivot: Complex, a: Complex, b: Complex) -> Defects:
    """Defects of D four-bars with pins at A and B (D, K) in K positions in order, pivots (D,), driven at the crank.

    The circuits of a Grashof linkage differ in the orientation of the two joints that its shortest link does not touch; any other
    linkage has one circuit. On a circuit the driver's dead points separate the two orientations of the joint of coupler and rocker.
    Positions are in order if the crank passes them in one sense, within one turn where it turns fully.
    """
    o2, o4 = crank_pivot[:, None], rocker_pivot[:, None]
    lengths = np.stack([abs(a - o2)[:, 0], abs(b - a)[:, 0], abs(b - o4)[:, 0], abs(o4 - o2)[:, 0]])
    grashof = 2.0 * (lengths.min(0) + lengths.max(0)) <= lengths.sum(0)
    shortest: Index = lengths.argmin(0)
    # joints O2, A, B, O4 lie between links (frame, crank), (crank, coupler), (coupler, rocker), (rocker, frame)
    at_o2, at_a, at_b = cross(a - o2, o4 - o2), cross(o2 - a, b - a), cross(a - b, o4 - b)
    free = np.select([shortest[:, None] == 0, shortest[:, None] == 1, shortest[:, None] == 2], [at_b, at_o2, at_a], at_b)
    circuit = grashof & ~_one_sign(free)
    branch = ~_one_sign(at_b)
    turns = grashof & ((shortest == 0) | (shortest == 3))
    theta = np.angle((a - o2) / (o4 - o2))
    folded = abs(lengths[3] - lengths[0]) < abs(lengths[1] - lengths[2])  # the crank cannot lie along the frame
    stretched = lengths[3] + lengths[0] > lengths[1] + lengths[2]
    theta = np.where((folded & ~stretched)[:, None], theta % TURN, theta)
    return Defects(branch, circuit, ~follow_in_order(theta, turns))


def follow_in_order(theta: Real, turns: Flags) -> Flags:
    """Whether angles (D, K) [rad] follow in one sense (D,): within one turn where ``turns`` (D,) is set, else by their values."""
    steps = np.diff(theta)
    forwards = np.mod(steps, TURN).sum(1) < TURN
    backwards = np.mod(-steps, TURN).sum(1) < TURN
    cyclic: Flags = forwards | backwards
    return (turns & cyclic) | (~turns & _one_sign(steps))


def used_range(theta: Real, turns: bool) -> tuple[float, float]:
    """Ends [rad] of the range in which a driver passes angles (K,) that are in order; the end may lie beyond a turn."""
    steps = np.diff(theta)
    if turns:
        steps = np.mod(steps, TURN) if np.mod(steps, TURN).sum() < TURN else -np.mod(-steps, TURN)
    return float(theta[0]), float(theta[0] + steps.sum())


def coupler_direction(
    frame: Real, crank: Real | float, coupler: Real, rocker: Real, turned: Complex, side: Index | int
) -> tuple[Complex, Complex]:
    """Unit vectors (D, K) of coupler and rocker in the frame's axes at unit vectors of the crank (D, K), by lengths (D, 1);
    NaN where they cannot be assembled."""
    a = crank * turned
    h = frame - a
    square = np.abs(h) ** 2
    along = (square + coupler**2 - rocker**2) / (2.0 * square)
    height = coupler**2 / square - along**2
    across = side * np.sqrt(np.where(height > 0.0, height, np.nan))
    arm = h * (along + 1j * across)
    return arm / coupler, (arm - h) / rocker


def grashof_cranks(rng: np.random.Generator, count: int, most: float) -> Real:
    """Random ratios (D, 3) of frame, coupler and rocker to a crank that is the shortest link and turns fully, up to ``most``."""
    ratios = np.empty((0, 3))
    while len(ratios) < count:
        tried = np.exp(rng.uniform(0.0, np.log(most), (4 * count, 3)))
        longest = tried.max(1)
        ratios = np.concatenate([ratios, tried[1.0 + longest < tried.sum(1) - longest]])
    return ratios[:count]


def acute(first: Plane, second: Plane) -> Any:
    """Acute angles between the lines of plane vectors [rad]."""
    product = np.conj(first) * second
    return np.arctan2(np.abs(product.imag), np.abs(product.real))


def _one_sign(values: Real) -> Flags:
    """Whether the values of a row (D, K) all have one sign (D,)."""
    return np.asarray((values > 0.0).all(1) | (values < 0.0).all(1))
