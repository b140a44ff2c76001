"""Data of plots: thinned curves, and a cursor line that moves through them with time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .playback import PlotTrack

__all__ = ["Curves", "padded_range", "thinned"]

Real = NDArray[np.float64]

# From four points a pixel on uPlot draws by columns of pixels, in which a gap beside the cursor line swallows it; plots are about
# 270 pixels wide
MOST_POINTS = 900
FILLED = 0.5  # of the range that curves fill at least, for it to stay


def thinned(values: Real, most: int = MOST_POINTS) -> NDArray[np.intp]:
    """Frames (n,) that are enough to draw curves (F, k): all, or the extremes of each curve in equal stretches."""
    frames, curves = values.shape
    if frames <= most:
        return np.arange(frames)
    stretches = np.array_split(np.arange(frames), max(1, most // (2 * curves)))
    filled = np.where(np.isfinite(values), values, 0.0)
    chosen = [np.array([0, frames - 1])]
    for stretch in stretches:
        part = filled[stretch]
        chosen.append(stretch[0] + np.concatenate([part.argmin(axis=0), part.argmax(axis=0)]))
    return np.unique(np.concatenate(chosen))


def padded_range(values: Real) -> tuple[float, float]:
    """A range of the vertical axis with some room around all finite values."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    room = 0.06 * (high - low)
    if room <= 1e-12 * max(abs(low), abs(high)):
        room = max(0.1 * abs(low), 1e-12 if low else 1.0)  # a constant lies in the middle
    return low - room, high + room


class Curves:
    """Curves ``y`` (F, k) over ``x`` (F,) as arrays for a plot, with a vertical line at one frame as the last of them.

    The line needs two points at the same x. They are put in between the points of the curves, which pass through them.
    """

    def __init__(self, x: Real, y: Real):
        order = np.arange(len(x)) if len(x) == 0 or x[-1] >= x[0] else np.arange(len(x))[::-1]  # plots want rising x
        kept = order[np.isin(order, thinned(y))]
        self._x, self._y = np.asarray(x, float), np.where(np.isfinite(y), y, np.nan)
        self._shown_x, self._shown_y = self._x[kept], self._y[kept]
        self.range = padded_range(self._y)

    def keep_range(self, old: tuple[float, float]) -> None:
        """Take an older range of the vertical axis where the curves still fill it well: while something is dragged, axes that
        change all the time tell nothing."""
        low, high = self.range
        if old[0] <= low and high <= old[1] and high - low >= FILLED * (old[1] - old[0]):
            self.range = old

    def track(self, uuid: str) -> PlotTrack:
        """How the line moves through the plot ``uuid`` over the frames."""
        return PlotTrack(uuid, self._shown_x, self._shown_y, self._x, self._y, self.range)

    def at(self, frame: int) -> tuple[Real, ...]:
        """x, the curves and the cursor line, each (n + 2,), the cursor at ``frame``."""
        now = self._x[frame]
        k = int(np.searchsorted(self._shown_x, now))
        x = np.insert(self._shown_x, [k, k], now)
        y = np.insert(self._shown_y, [k, k], self._y[frame], axis=0)
        cursor = np.full(len(x), np.nan)
        cursor[k : k + 2] = self.range
        return x, *np.ascontiguousarray(y.T), cursor
