"""A growing run, shown while it is computed: the view model of its frames so far, and its progress."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from html import escape
from types import TracebackType
from typing import TYPE_CHECKING

import viser

from mechviz.outputs.viewer.build import build, view_model_of_run
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.runs import Run, Running

if TYPE_CHECKING:
    from mechcore.dynamics.simulation import Simulation
    from mechviz.scene.scene import Scene


GROWING_NOTE = "This motion is still being computed. When it is complete, the scene can be edited and saved."
REBUILD_RATIO = 4.0  # solids are rebuilt when the run has so many times the frames for which they were built


class Growth:
    """The shown part of a growing run: ``view_model`` is that of the first frames, then the last one from `take`."""

    def __init__(self, server: viser.ViserServer, run: Run):
        self._built = build(run)
        self._for = run.motion.frames
        first = view_model_of_run(run, self._built)
        self.view_model = replace(first, opens_at=first.frames - 1, notes=GROWING_NOTE)
        self.words = ""
        self._bar = server.gui.add_html("", order=-1.0)

    def take(self, run: Run, duration: float) -> ViewModel:
        """View model of a run with more frames, of total ``duration`` [s]; from time to time with new solids, since the lengths of
        slots and the number of layers depend on the frames."""
        reshaped = run.motion.frames >= REBUILD_RATIO * self._for
        if reshaped:
            self._built, self._for = build(run), run.motion.frames
        self.view_model = replace(view_model_of_run(run, self._built, self.view_model), exact=reshaped, notes=GROWING_NOTE)
        reached = float(run.motion.time[-1])
        self._say(f"Computing: {reached:.4g} s of {duration:.4g} s", reached / duration, "#225ca0")
        return self.view_model

    def fail(self, error: Exception) -> None:
        """Show why the run ends early."""
        self._say(f"It ends here: {error}", 1.0, "#d03030")

    def _say(self, text: str, part: float, color: str) -> None:
        self.words = text
        self._bar.content = (
            '<div style="padding:0.4em 0.9em 0.6em;font-size:0.85em" role="status">'
            f'<div class="mechviz-progress" style="padding-bottom:0.3em">{escape(text)}</div>'
            '<div style="height:6px;border-radius:3px;background:rgba(128,128,128,0.25)">'
            f'<div style="height:6px;border-radius:3px;background:{color};width:{100.0 * part:.1f}%"></div></div></div>'
        )


LOOK_INTERVAL = 0.2  # [s] between checks for new frames
# Time between two assemblies of new frames over the time that the last one took: most of the time is for computing
ASSEMBLY_RATIO = 8.0


class Stopped(Exception):
    """The computation was stopped before its end."""


class Computing:
    """A context that calls ``solve(observe)`` in a thread; on exit the computation is stopped. When it has ended, ``run`` is the
    complete run, or ``error`` the exception."""

    def __init__(self, solve: Callable[[Callable[[Simulation, float], None]], Run], scene: Scene):
        self._solve = solve
        self.running = Running(scene, lambda: time.perf_counter() > self._due)
        self._due = 0.0  # time of ``perf_counter`` [s] from which new frames are assembled again
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
        """Stop the computation at its next step."""
        self._left = True

    @property
    def duration(self) -> float:
        """Duration of the whole motion [s]."""
        return self.running.duration

    def wait(self) -> bool:
        """Wait until there are new frames, at most `LOOK_INTERVAL`; False when the computation has ended."""
        with self._changed:
            self._changed.wait_for(lambda: self._over or self.running.sent > self._shown, LOOK_INTERVAL)
            return not self._over

    def latest_run(self) -> Run | None:
        """The run of all frames so far; None if there are no new ones."""
        if self.running.sent == self._shown:
            return None
        run = self.running.so_far()
        self._shown = run.motion.frames
        return run

    def _observe(self, segment: Simulation, duration: float) -> None:
        if self._left:
            raise Stopped
        begun = time.perf_counter()
        if self.running.take(segment, duration) is not None:
            now = time.perf_counter()
            self._due = now + max(LOOK_INTERVAL, ASSEMBLY_RATIO * (now - begun))
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
