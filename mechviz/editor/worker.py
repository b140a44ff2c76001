"""Background work of the editor, outside the threads that serve browsers: the newest request is carried out, requests that it
overtakes are dropped. One kind of work finds how far a value can be moved until the mechanism cannot be assembled, is undercut, or
the scene is invalid."""

from __future__ import annotations

import gc
import itertools
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np

from mechcore.errors import MechanismError
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.numerics.frames import give_back_memory
from mechviz.runs import run_scene
from mechviz.scene.scene import Scene

SCAN_STEPS = 12  # from the good value to each end of the range
MOST_HALVINGS = 11
TRIAL_FRAMES = 90
OFTEN = 8
T = TypeVar("T")
_left = itertools.count(1)


class LatestRequestWorker(Generic[T]):
    """One thread that calls ``work(request)`` for the newest request; ``on_idle()`` follows when no request has come
    for ``idle_time`` [s].

    ``failed(error)`` gets an exception in either; the thread continues.
    """

    def __init__(
        self,
        work: Callable[[T], None],
        failed: Callable[[Exception], None],
        on_idle: Callable[[], None] | None = None,
        idle_time: float = 0.35,
    ):
        self._work, self._failed, self._on_idle, self._idle_time = work, failed, on_idle, idle_time
        self._changed = threading.Condition()
        self._waiting: list[T] = []  # none or one
        self._asked = self._done = 0
        self._idle_done = True
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="mechviz-worker", daemon=True)
        self._thread.start()

    def submit(self, request: T) -> None:
        """Request work; an earlier request that has not begun is dropped."""
        with self._changed:
            self._waiting[:] = [request]
            self._asked += 1
            self._changed.notify_all()

    @property
    def is_superseded(self) -> bool:
        """Whether a newer request waits, or the thread is to end; long work checks this now and then and gives up."""
        return bool(self._waiting) or self._closed

    def wait(self, timeout: float = 600.0, *, until_idle: bool = False) -> bool:
        """Wait until all requests so far are done, with ``until_idle`` also `on_idle` after them. False if that takes longer than
        ``timeout`` [s]."""
        with self._changed:
            asked = self._asked
            return self._changed.wait_for(
                lambda: (self._done >= asked and (self._idle_done or not until_idle)) or self._closed, timeout
            )

    def close(self) -> None:
        """End the thread after its present work."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=5.0)

    def _run(self) -> None:
        while True:
            with self._changed:
                pause = None if self._idle_done or self._on_idle is None else self._idle_time
                idle = not self._changed.wait_for(lambda: self._waiting or self._closed, pause)
                if self._closed:
                    return
                asked = self._asked
                requests = [self._waiting.pop()] if self._waiting else []
                if not idle:
                    self._idle_done = False
            try:
                if idle:
                    assert self._on_idle is not None
                    self._on_idle()
                for request in requests:
                    self._work(request)
            except Exception as error:
                self._failed(error)
            with self._changed:
                if not idle:
                    self._done = max(self._done, asked)
                else:
                    self._idle_done = not self._waiting
                self._changed.notify_all()


def release_garbage() -> None:
    """To be called when objects that refer to each other are no longer used, such as those of a browser or of a saved plot. Every
    `OFTEN`-th call collects garbage. Python itself waits until such objects are a quarter of all, however much memory they hold."""
    if next(_left) % OFTEN == 0:
        gc.collect()
        give_back_memory()


def assembles(scene: Scene) -> bool:
    """Whether a scene can be assembled and solved over its run, tested at up to `TRIAL_FRAMES` frames; where forces determine the
    motion, only at the start."""
    try:
        if scene.simulation is not None:
            solve_motion(compile_mechanism(scene.mechanism), np.zeros(1))
            return True
        motion = run_scene(scene, frames=min(TRIAL_FRAMES, scene.frames), outputs=("positions", "forces")).motion
        return all(bool(np.isfinite(motion.pose(link.name)).all()) for link in scene.mechanism.links)
    except MechanismError:
        return False


def feasible_range(
    good: float, low: float, high: float, holds: Callable[[float], bool], given_up: Callable[[], bool] = lambda: False
) -> tuple[float, float] | None:
    """The range around a ``good`` value, within ``low`` to ``high``, over which ``holds(value)``; None if ``given_up()``.

    Each side is scanned in steps until a value fails; the limit is then found by bisection, from the inside.
    """
    ends = []
    for end in (low, high):
        inside, outside = good, None
        for value in np.linspace(good, end, SCAN_STEPS + 1)[1:]:
            if given_up():
                return None
            if not holds(float(value)):
                outside = float(value)
                break
            inside = float(value)
        for _ in range(MOST_HALVINGS if outside is not None else 0):
            assert outside is not None
            if given_up():
                return None
            middle = 0.5 * (inside + outside)
            inside, outside = (middle, outside) if holds(middle) else (inside, middle)
        ends.append(inside)
    return ends[0], ends[1]
