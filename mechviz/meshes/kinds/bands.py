"""Belts and chains around two pulleys as closed lines: where they run, for their solids and for marks that run with them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mechcore.arrays import Complex, Real


@dataclass(frozen=True)
class Loop:
    """A belt's middle line in the axes of its carrier [m]: over the far side of the first pulley counter-clockwise, along a span to
    the second, over that (clockwise where the spans cross) and back."""

    joint: str
    carrier: str
    pulley: str  # the link of the first pulley
    centres: tuple[complex, complex]
    radii: tuple[float, float]
    crossed: bool
    thick: float  # in the plane
    low: float = 0.0  # of the belt in z
    high: float = 0.0

    def placed(self, size: float, low: float, high: float) -> Loop:
        """The loop so many times as large, between two heights in its present unit."""
        (c1, c2), (r1, r2) = self.centres, self.radii
        return replace(
            self,
            centres=(c1 * size, c2 * size),
            radii=(r1 * size, r2 * size),
            thick=self.thick * size,
            low=low * size,
            high=high * size,
        )

    @property
    def leave(self) -> float:
        """Angle from the line of centres to where the left span touches the first pulley [rad]."""
        r1, r2 = self.radii
        return float(np.arccos((r1 + r2 if self.crossed else r1 - r2) / abs(self.centres[1] - self.centres[0])))

    @property
    def pieces(self) -> tuple[float, float, float]:
        """Lengths [m]: over the first pulley, of a span, over the second pulley."""
        (r1, r2), leave = self.radii, self.leave
        span = abs(self.centres[1] - self.centres[0]) * float(np.sin(leave))
        return r1 * 2.0 * (np.pi - leave), span, r2 * 2.0 * (np.pi - leave if self.crossed else leave)

    @property
    def length(self) -> float:
        first, span, second = self.pieces
        return first + 2.0 * span + second

    def at(self, way: Real) -> tuple[Complex, Real]:
        """Places in the plane [m] after any way along the belt [m], and the directions in which it runs there [rad], continuous."""
        (c1, c2), (r1, r2), leave = self.centres, self.radii, self.leave
        first, span, _ = self.pieces
        base = float(np.angle(c2 - c1))
        rounds = np.floor(np.asarray(way, float) / self.length)
        u = np.asarray(way, float) - rounds * self.length
        v, w = u - first - span, u - self.length + span  # along the second pulley, along the span back
        away = 2.0 * np.pi - leave  # where the first pulley is left, and the direction of the span from there
        turn = leave + np.minimum(u, first) / r1
        on_second = np.pi - leave - v / r2 if self.crossed else -leave + v / r2
        back = leave - np.pi if self.crossed else leave  # where the second pulley is left
        homeward = leave if self.crossed else leave + 2.0 * np.pi  # direction of the span back, less a right angle
        line = np.exp(1j * base)
        place = np.select(
            [u < first, v < 0.0, w < 0.0],
            [
                c1 + r1 * line * np.exp(1j * turn),
                c1 + line * np.exp(1j * away) * (r1 + 1j * (u - first)),
                c2 + r2 * line * np.exp(1j * on_second),
            ],
            c2 + line * (r2 * np.exp(1j * back) + 1j * w * np.exp(1j * homeward)),
        )
        around = on_second + (np.pi if self.crossed else 2.0 * np.pi)
        direction = np.select([u < first, v < 0.0, w < 0.0], [turn, away, around], homeward)
        per_round = 0.0 if self.crossed else 2.0 * np.pi
        return place, direction + base + 0.5 * np.pi + rounds * per_round
