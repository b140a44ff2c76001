"""A motion under forces that a thread of its own computes, while its frames so far are looked at."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING

from ..run import Run
from ..running import Running

if TYPE_CHECKING:
    from mechcore.dynamics import Simulation

    from ..scene import Scene

__all__ = ["Computing", "Stopped"]

LOOK = 0.2  # [s] between looks whether there is something new
SHARE = 8.0  # new frames are put together after so many times as long as that took last time: most of the time is for computing


class Stopped(Exception):
    """Nobody wants to know the rest."""


class Computing:
    """Calls ``solve(observe)`` in a thread, which ends when it is left. ``run`` is the whole run in the end, ``error`` what went
    wrong."""

    def __init__(self, solve: Callable[[Callable[[Simulation, float], None]], Run], scene: Scene):
        self._solve = solve
        self.running = Running(scene, lambda: time.perf_counter() > self._due)
        self._due = 0.0  # when new frames are put together again, by the clock
        self._changed = threading.Condition()
        self._shown = 0
        self._over = self._left = False
        self.run: Run | None = None
        self.error: Exception | None = None
        self._thread = threading.Thread(target=self._work, name="mechviz-computing", daemon=True)

    def __enter__(self) -> Computing:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.stop()
        self._thread.join(timeout=5.0)

    def stop(self) -> None:
        """Nobody wants to know the rest: the computing ends at its next step."""
        self._left = True

    @property
    def duration(self) -> float:
        """Of the whole motion [s]."""
        return self.running.duration

    def wait(self) -> bool:
        """Until there is something new, or a moment; False when the computing has ended."""
        with self._changed:
            self._changed.wait_for(lambda: self._over or self.running.sent > self._shown, LOOK)
            return not self._over

    def news(self) -> Run | None:
        """All frames so far, None where there are no more than last time."""
        if self.running.sent == self._shown:
            return None
        run = self.running.so_far()
        self._shown = run.motion.frames
        return run

    def _observe(self, stretch: Simulation, duration: float) -> None:
        if self._left:
            raise Stopped
        begun = time.perf_counter()
        if self.running.take(stretch, duration) is not None:
            now = time.perf_counter()
            self._due = now + max(LOOK, SHARE * (now - begun))
            with self._changed:
                self._changed.notify_all()

    def _work(self) -> None:
        try:
            self.run = self._solve(self._observe)
        except Exception as error:
            self.error = error
        with self._changed:
            self._over = True
            self._changed.notify_all()
