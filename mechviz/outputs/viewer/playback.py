"""Playing in the browser itself: the whole motion is sent once, and nothing is sent while it plays.

It relies on hooks that viser 1.1.1 exposes to scripts of the page (``__viserMutable``, ``__viserTestpoints``), for which the script
checks. The server pushes every frame instead if the motion is too large or if drawings change that only the server can draw.
"""

from __future__ import annotations

import base64
import json
import threading
import time
from collections.abc import Callable
from dataclasses import field
from pathlib import Path
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from mechcore.arrays import Flags, Index, Integers, Real, Single
from mechcore.records import dataclass
from mechviz.outputs.viewer.viser_adapter import run_script

LARGEST_MOTION = 16_000_000  # bytes: larger motions are played by the server
PLAYBACK_SCRIPT = Path(__file__).with_name("playback.js").read_text(encoding="utf-8")


@dataclass(frozen=True, eq=False)
class SentPoses:
    """Poses of a node: positions (F, 3) [m] and orientations (F, 4) as quaternions w, x, y, z, None if it does not rotate."""

    name: str
    places: NDArray[Any]
    quaternions: NDArray[Any] | None


@dataclass(frozen=True, eq=False)
class PointTrack:
    """A property of a node, such as ``points`` or ``vertices``: in frame k the first ``counts[k]`` numbers of ``values[k]``;
    ``values`` is (F, m).

    Where the count is 0 the node is hidden. ``steady`` (F,): whether the values belong to the same items as those of the next
    frame, so that the page may interpolate between them; None: they do wherever the counts are equal.
    """

    name: str
    prop: str
    values: Single
    counts: Integers
    steady: Flags | None = None


@dataclass(frozen=True, eq=False)
class NumberTrack:
    """A number in the page, in all elements with ``data-mv`` = ``key``: ``digits`` decimals, or five significant digits if None,
    followed by ``suffix``."""

    key: str
    values: NDArray[Any]
    digits: int | None = None
    suffix: str = ""


@dataclass(frozen=True, eq=False)
class PlotTrack:
    """A plot whose last series is the cursor: the points of its curves ``shown_x`` (n,) and ``shown_y`` (n, k), all values ``x``
    (F,) and ``y`` (F, k), and the ``ends`` of the cursor line."""

    uuid: str
    shown_x: NDArray[Any]
    shown_y: NDArray[Any]
    x: NDArray[Any]
    y: NDArray[Any]
    ends: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Tracks:
    """Everything that moves while a run is played; ``slider``: the control that shows the frame; ``seen``: the hidden checkbox
    through which a page reports that a diagram, which only the server can draw, is visible."""

    time: Real
    slider: str
    poses: tuple[SentPoses, ...] = ()
    points: tuple[PointTrack, ...] = ()
    numbers: tuple[NumberTrack, ...] = ()
    plots: tuple[PlotTrack, ...] = ()
    seen: str = ""

    @property
    def bytes(self) -> int:
        """Approximate size of the data that are sent."""
        n = sum(t.places.size + (t.quaternions.size if t.quaternions is not None else 0) for t in self.poses)
        n += sum(t.values.size for t in self.points) + sum(t.values.size for t in self.numbers)
        return 4 * (n + sum(t.y.size + t.x.size for t in self.plots))

    def text(self) -> str:
        """The tracks for the script, as JSON."""
        return json.dumps(
            {
                "time": base64_of(self.time, np.float64),
                "slider": self.slider,
                "seen": self.seen,
                "poses": [
                    [t.name, base64_of(t.places), None if t.quaternions is None else base64_of(t.quaternions)] for t in self.poses
                ],
                "points": [
                    [
                        t.name,
                        t.prop,
                        base64_of(t.values),
                        base64_of(t.counts),
                        None if t.steady is None else base64_of(t.steady, np.uint8),
                    ]
                    for t in self.points
                ],
                "numbers": [[t.key, base64_of(t.values), t.digits, t.suffix] for t in self.numbers],
                "plots": [
                    [t.uuid, *(base64_of(v) for v in (t.shown_x, t.shown_y.T, t.x, t.y.T)), list(t.ends)] for t in self.plots
                ],
            }
        )


@dataclass
class _Sent:
    """Version of the tracks that a browser has."""

    version: int = -1


@dataclass
class BrowserPlayback:
    """Lets all browsers of a server play on their own.

    ``make_tracks()`` returns the tracks, None if only the server can play them; it is called when playing begins after ``change``.
    ``begin`` starts at a time of the run and returns whether the browsers can play; ``end`` stops them at a frame.
    ``shown_remotely(frame)`` is called from time to time while they play, for what only the server can draw.

    The message to play is sent to each browser, the message to stop to all of them together, and the later one may arrive first.
    Therefore both contain the number of the play: a play that has been stopped does not begin. Numbers start at the time in ms, so
    that they exceed those of an earlier server, whose pages may reconnect.
    """

    server: viser.ViserServer
    make_tracks: Callable[[], Tracks | None]
    shown_remotely: Callable[[int], None]
    _tracks: Tracks | None = None
    _stale: bool = True
    _only_server: bool = False
    _text: str = ""
    _version: int = 0
    _sent: dict[int, _Sent] = field(default_factory=dict)
    _state: tuple[float, float, bool] | None = None
    _play_number: int = field(default_factory=lambda: int(1e3 * time.time()))
    _lock: Any = field(default_factory=threading.RLock)

    def change(self) -> None:
        """Mark the tracks as outdated."""
        self._stale = True

    def play_on_server(self, on: bool) -> None:
        """Let the server play while ``on``, because the motion changes all the time."""
        self._only_server = on
        self._stale = True

    def show_remotely(self, frame: int) -> None:
        self.shown_remotely(frame)

    def _refresh(self) -> None:
        if self._stale:
            self._stale = False
            tracks = self.make_tracks()
            self._tracks = tracks if tracks is not None and tracks.bytes <= LARGEST_MOTION else None
            self._text, self._version = "", self._version + 1

    def begin(self, clock: float, rate: float, loop: bool) -> bool:
        """Play from ``clock`` [s] of the run at ``rate`` [s of the run per s]."""
        with self._lock:
            if self._only_server:
                return False
            self._refresh()
            if self._tracks is None:
                return False
            self._state = (clock, rate, loop)
            self._play_number += 1
            for client in self.server.get_clients().values():
                self._play(client)
            return True

    def end(self, frame: int) -> None:
        """Stop at a frame."""
        with self._lock:
            self._state = None
            # among the messages to all browsers, so that it arrives before the next drawing
            stop = f"if (window.mechvizPlayback) window.mechvizPlayback.stop({int(frame)});"
            run_script(self.server, f"window.mechvizStopped = {self._play_number}; {stop}", "stop")

    def send_to(self, client: viser.ClientHandle, clock: float) -> None:
        """Let a browser that has just connected join the play."""
        with self._lock:
            if self._state is not None:
                self._state = (clock, *self._state[1:])
                self._play(client)

    def forget(self, client: viser.ClientHandle) -> None:
        """Drop the state of a browser that has disconnected."""
        with self._lock:
            self._sent.pop(client.client_id, None)

    def _play(self, client: viser.ClientHandle) -> None:
        assert self._tracks is not None and self._state is not None
        sent = self._sent.get(client.client_id)
        if sent is None:
            sent = self._sent[client.client_id] = _Sent()
            run_script(client, PLAYBACK_SCRIPT, "playback")
        if sent.version != self._version:
            if not self._text:
                self._text = self._tracks.text()
            sent.version = self._version
            run_script(client, f"window.mechvizPlayback.load({self._text});", "load")
        clock, rate, loop = self._state
        play = f"window.mechvizPlayback.play({clock!r}, {rate!r}, {json.dumps(loop)});"
        run_script(client, f"if ({self._play_number} > (window.mechvizStopped || 0)) {play}", "play")
        client.flush()


def base64_of(values: NDArray[Any], kind: Any = np.float32) -> str:
    """An array as base64 text of its bytes, for a page."""
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode("ascii")


def ragged(values: NDArray[Any], seen: Flags) -> tuple[Single, Integers]:
    """Items (F, n, ...), of which those with ``seen`` (F, n) are visible -> numbers (F, m) of each frame, those of visible items
    first, and their count (F,)."""
    order = np.argsort(~seen, axis=1, kind="stable")
    sorted_values = np.take_along_axis(values, order.reshape(*order.shape, *[1] * (values.ndim - 2)), axis=1)
    width = int(np.prod(values.shape[2:]))
    flat = np.nan_to_num(sorted_values.reshape(len(values), -1)).astype(np.float32)
    return flat, seen.sum(axis=1) * width


# -- curves of plots ---------------------------------------------------------------------------------------------------
# From four points per pixel on, uPlot draws column by column of pixels, and a gap beside the cursor line then hides the line; plots
# are about 270 pixels wide
MOST_POINTS = 900
LEAST_FILLED = 0.5  # part of the old range that curves must fill for it to be kept


def thinned(values: Real, most: int = MOST_POINTS) -> Index:
    """Frames (n,) that suffice to draw curves (F, k): all, or the minimum and maximum of each curve in equal intervals."""
    frames, curves = values.shape
    if frames <= most:
        return np.arange(frames)
    intervals = np.array_split(np.arange(frames), max(1, most // (2 * curves)))
    filled = np.where(np.isfinite(values), values, 0.0)
    chosen = [np.array([0, frames - 1])]
    for interval in intervals:
        part = filled[interval]
        chosen.append(interval[0] + np.concatenate([part.argmin(axis=0), part.argmax(axis=0)]))
    return np.unique(np.concatenate(chosen))


def padded_range(values: Real) -> tuple[float, float]:
    """A range of the vertical axis with a margin around all finite values."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    room = 0.06 * (high - low)
    if room <= 1e-12 * max(abs(low), abs(high)):
        room = max(0.1 * abs(low), 1e-12 if low else 1.0)  # a constant lies in the middle
    return low - room, high + room


class Curves:
    """Curves ``y`` (F, k) over ``x`` (F,) as arrays for a plot, whose last series is a vertical cursor line at one frame.

    The line needs two points at the same x. They are inserted among the points of the curves, with the curves' values there.
    """

    def __init__(self, x: Real, y: Real):
        order = np.arange(len(x)) if len(x) == 0 or x[-1] >= x[0] else np.arange(len(x))[::-1]  # plots want rising x
        kept = order[np.isin(order, thinned(y))]
        self._x, self._y = np.asarray(x, float), np.where(np.isfinite(y), y, np.nan)
        self._shown_x, self._shown_y = self._x[kept], self._y[kept]
        self.range = padded_range(self._y)

    def keep_range(self, old: tuple[float, float]) -> None:
        """Keep an older range of the vertical axis if the curves still fill it well: axes that change all the time while something
        is dragged tell nothing."""
        low, high = self.range
        if old[0] <= low and high <= old[1] and high - low >= LEAST_FILLED * (old[1] - old[0]):
            self.range = old

    def track(self, uuid: str) -> PlotTrack:
        """The track of the cursor line of the plot ``uuid`` over the frames."""
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


def interpolated(values: Real, places: Real, wanted: Real) -> Real:
    """Curves (F, k) over monotonic ``places`` (F,), interpolated linearly at ``wanted`` (G,) -> (G, k); NaN beyond the ends."""
    order = slice(None) if places[-1] >= places[0] else slice(None, None, -1)
    columns = [np.interp(wanted, places[order], column[order], left=np.nan, right=np.nan) for column in values.T]
    return np.column_stack(columns)
