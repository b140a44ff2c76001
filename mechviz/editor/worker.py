"""Work outside the threads that talk to browsers: the newest request wins, those that it overtakes are never begun."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Latest(Generic[T]):
    """One thread that calls ``work(request)`` for the newest request; ``rest()`` follows when none has come for ``quiet`` seconds.

    ``failed(error)`` is told of an exception in either; the thread lives on.
    """

    def __init__(
        self,
        work: Callable[[T], None],
        failed: Callable[[Exception], None],
        rest: Callable[[], None] | None = None,
        quiet: float = 0.35,
    ):
        self._work, self._failed, self._rest, self._quiet = work, failed, rest, quiet
        self._changed = threading.Condition()
        self._waiting: list[T] = []  # none or one
        self._asked = self._done = 0
        self._rested = True
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="mechviz-worker", daemon=True)
        self._thread.start()

    def submit(self, request: T) -> None:
        """Ask for work; a request that has not been begun is dropped."""
        with self._changed:
            self._waiting[:] = [request]
            self._asked += 1
            self._changed.notify_all()

    @property
    def overtaken(self) -> bool:
        """Whether a newer request waits: long work that asks now and then can give up."""
        return bool(self._waiting) or self._closed

    def wait(self, timeout: float = 60.0, *, rested: bool = False) -> bool:
        """Until everything asked for so far is done (and the rest after it). False if that takes longer than ``timeout`` [s]."""
        with self._changed:
            asked = self._asked
            return self._changed.wait_for(lambda: (self._done >= asked and (self._rested or not rested)) or self._closed, timeout)

    def close(self) -> None:
        """End the thread after what it is doing."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=5.0)

    def _run(self) -> None:
        while True:
            with self._changed:
                pause = None if self._rested or self._rest is None else self._quiet
                quiet = not self._changed.wait_for(lambda: self._waiting or self._closed, pause)
                if self._closed:
                    return
                asked = self._asked
                requests = [self._waiting.pop()] if self._waiting else []
                if not quiet:
                    self._rested = False
            try:
                if quiet:
                    assert self._rest is not None
                    self._rest()
                for request in requests:
                    self._work(request)
            except Exception as error:
                self._failed(error)
            with self._changed:
                if not quiet:
                    self._done = max(self._done, asked)
                else:
                    self._rested = not self._waiting
                self._changed.notify_all()
