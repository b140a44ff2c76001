"""The clock of the viewer: one thread that decides which frame is shown, at most 60 times a second, and sleeps while paused."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Protocol

import numpy as np

from mechcore.arrays import Real

LARGEST_RATE = 60.0  # pictures a second
LOOKS_A_SECOND = 10.0  # updates of the clock per second while the browsers play on their own
LEAST_REST = 0.002  # [s] pause between pictures, however slow the drawing is: viser's own thread must get its turn


class Remote(Protocol):
    """Plays in place of the player: the browsers, once they have the motion."""

    def begin(self, clock: float, rate: float, loop: bool) -> bool:
        """Play from ``clock`` [s]; False if they cannot."""
        ...

    def end(self, frame: int) -> None:
        """Stop at a frame."""
        ...

    def show_remotely(self, frame: int) -> None:
        """Called with the present frame while the remote plays."""
        ...


class Player:
    """Plays frames at times ``times`` (F,) [s] by calling ``show(frame, playing)`` from its own thread, and only from there.

    ``rate`` is run time per wall time. After a change while paused, ``show`` is called once; nothing else happens while paused.
    ``failed(error)`` receives an exception of ``show``; the player then pauses and keeps running.

    While ``remote`` plays, ``show`` is called only for requests, and the clock here runs in parallel.
    """

    def __init__(
        self,
        times: Real,
        show: Callable[[int, bool], None],
        failed: Callable[[Exception], None],
        rate: float = 1.0,
        remote: Remote | None = None,
    ):
        self._remote = remote
        self._aside = False  # the remote plays
        self._ticked = time.perf_counter()
        self._times = np.asarray(times, float)
        self._show = show
        self._failed = failed
        self._changed = threading.Condition()
        self._rate = rate
        self._loop = True
        self._playing = False
        self._closed = False
        self._frame = 0
        self._clock = float(self._times[0])  # run time now
        self._wanted = 1  # serial number of the last request, of which ...
        self._done = 0  # ... this one has been shown
        self._thread = threading.Thread(target=self._run, name="mechviz-player", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """End the thread; no effect if it has ended or was never started."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join(timeout=5.0)

    # -- state --------------------------------------------------------------------------------------------------------
    @property
    def frame(self) -> int:
        with self._changed:
            self._catch_up()
            return self._frame

    @property
    def clock(self) -> float:
        """The present time of the run [s]."""
        with self._changed:
            self._catch_up()
            return self._clock

    @property
    def is_remote(self) -> bool:
        """Whether the browsers play on their own."""
        return self._aside

    @property
    def playing(self) -> bool:
        return self._playing

    @property
    def loop(self) -> bool:
        return self._loop

    @property
    def rate(self) -> float:
        return self._rate

    # -- requests, from any thread ------------------------------------------------------------------------------------
    def play(self) -> None:
        with self._changed:
            if self._frame == len(self._times) - 1:
                self._go_to(0)  # at the end, play starts again
            self._playing = True
            self._ask()

    def pause(self) -> None:
        with self._changed:
            self._catch_up()
            self._playing = False
            self._ask()

    def toggle(self) -> None:
        with self._changed:
            if self._playing:
                self.pause()
            else:
                self.play()

    def seek(self, frame: int) -> None:
        """Show a frame and pause there; frames out of range are clipped."""
        with self._changed:
            self._playing = False
            self._go_to(frame)
            self._ask()

    def step(self, frames: int) -> None:
        """Move by a number of frames, beyond the ends if the motion loops, and pause."""
        with self._changed:
            last = len(self._times) - 1
            self._catch_up()
            target = self._frame + frames
            if self._loop and last > 0 and not 0 <= target <= last:
                target %= last  # the last frame of a cycle is the first of the next
            self.seek(target)

    def set_rate(self, rate: float) -> None:
        with self._changed:
            self._catch_up()
            self._rate = rate
            self._ask()

    def set_loop(self, loop: bool) -> None:
        with self._changed:
            self._loop = loop
            self._ask()

    def retime(self, times: Real) -> None:
        """Replace the times of the frames; the clock keeps its fraction of the run, or its time if frames are only appended. The
        caller decides what is shown."""
        with self._changed:
            if len(times) == len(self._times) and np.array_equal(times, self._times):
                return
            before, self._times = self._times, np.asarray(times, float)
            if len(before) < len(times) and np.array_equal(times[: len(before)], before):
                return  # frames are appended: clock and frame stay
            part = (self._clock - before[0]) / max(float(before[-1] - before[0]), 1e-300)
            self._clock = float(self._times[0] + part * (self._times[-1] - self._times[0]))
            if len(before) != len(times):
                self._frame = int(np.argmin(np.abs(self._times - self._clock)))

    def refresh(self) -> None:
        """Show the present frame again after a change of what is drawn."""
        with self._changed:
            self._ask()

    def wait(self, timeout: float = 600.0) -> bool:
        """Wait until all requests so far have been shown; False if that takes longer than ``timeout`` [s]."""
        with self._changed:
            wanted = self._wanted
            return self._changed.wait_for(lambda: self._done >= wanted or self._closed, timeout)

    # -- inside -------------------------------------------------------------------------------------------------------
    def _go_to(self, frame: int) -> None:
        self._frame = int(np.clip(frame, 0, len(self._times) - 1))
        self._clock = float(self._times[self._frame])

    def _ask(self) -> None:
        self._wanted += 1
        self._changed.notify_all()

    def _advance(self, seconds: float) -> None:
        """Advance the clock by ``seconds`` of wall time."""
        first, last = float(self._times[0]), float(self._times[-1])
        clock = self._clock + self._rate * seconds
        if clock >= last and not (self._loop and last > first):
            self._go_to(len(self._times) - 1)
            self._playing = False
            self._wanted += 1
            return
        self._clock = first + (clock - first) % (last - first)
        after = int(np.searchsorted(self._times, self._clock))
        before = max(after - 1, 0)
        nearer = self._clock - self._times[before] < self._times[after] - self._clock
        self._frame = before if nearer else after

    def _catch_up(self) -> None:
        """Advance the clock to the present while the remote plays: it is otherwise advanced only from time to time."""
        if self._aside and self._playing:
            now = time.perf_counter()
            self._advance(now - self._ticked)
            self._ticked = now

    def _run(self) -> None:
        shown, due = -1, 0.0
        while True:
            with self._changed:
                if not self._playing and self._done >= self._wanted:
                    self._changed.wait_for(lambda: self._playing or self._closed or self._done < self._wanted)
                    self._ticked = time.perf_counter()
                elif self._aside and self._playing:
                    self._changed.wait_for(lambda: self._closed or self._done < self._wanted, 1.0 / LOOKS_A_SECOND)
                if self._closed:
                    return
                now = time.perf_counter()
                if self._playing:
                    self._advance(now - self._ticked)
                self._ticked = now
                frame, playing, wanted, clock = self._frame, self._playing, self._wanted, self._clock
                asked = wanted > self._done
                needed = frame != shown or asked
            if needed and self._aside and not asked:
                shown = frame
                assert self._remote is not None
                self._remote.show_remotely(frame)
            elif needed:
                shown = frame
                try:
                    if self._aside and self._remote is not None and not playing:
                        self._aside = False
                        self._remote.end(frame)
                        # viser does not send values that it takes to be shown already: after a neighbouring frame all are sent
                        self._show(max(frame - 1, 0) if frame else min(1, len(self._times) - 1), playing)
                    self._show(frame, playing)
                    if playing and self._remote is not None:
                        before, self._aside = self._aside, self._remote.begin(clock, self._rate, self._loop)
                        if before and not self._aside:
                            self._remote.end(frame)
                except Exception as error:
                    with self._changed:
                        self._playing = False
                    self._failed(error)
            with self._changed:
                self._done = max(self._done, wanted)
                self._changed.notify_all()
            # counted from the due time of the last picture, not from when the thread woke up: delays do not add up
            due = max(due + 1.0 / LARGEST_RATE, now)
            time.sleep(max(LEAST_REST, due - time.perf_counter()))
