"""The viewer: a run in the browser, served on this machine."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from mechviz.editor.worker import release_garbage
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.viewer.browser import prepare_page
from mechviz.outputs.viewer.build import build, view_model_of_recording, view_model_of_run
from mechviz.outputs.viewer.growth import Computing, Growth, Stopped
from mechviz.outputs.viewer.inspector import Inspector, theme
from mechviz.outputs.viewer.panels.plots import Plots
from mechviz.outputs.viewer.panels.switches import Switches
from mechviz.outputs.viewer.panels.timeline import Timeline
from mechviz.outputs.viewer.playback import BrowserPlayback
from mechviz.outputs.viewer.player import Player
from mechviz.outputs.viewer.server import HOST, ControlChanges, ViewerError, report, safely, start_server, stop_server
from mechviz.outputs.viewer.session import EditSession
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.outputs.viewer.world.scene import Scene3D
from mechviz.runs import Run, run_scene
from mechviz.studies.designs.figures import StoredStudy

if TYPE_CHECKING:
    from mechcore.dynamics.simulation import Simulation
    from mechviz.scene.scene import Scene


PAUSE_RATIO = 2.0  # pause between updates of a growing motion over the time that the last update took: most time is for computing
PAUSE_LIMITS = 0.3, 2.0  # [s] shortest and longest pause
MOST_FRAMES = 1_000_000  # of a scene that is solved anew from a recording


class Viewer:
    """A run or a recording served at ``url`` until ``close``. All browsers see the same frame, each through its own camera.

    ``port`` 0 takes a free port. Scenes and recordings are saved into ``folder``, by default the folder of the recording, or the
    working folder. A recording is played without computing; if it contains its scene, the scene can be solved and edited.
    Raises `ViewerError` if the port cannot be used or the recording cannot be shown.

    ``growing``: the run is the beginning of one that is still being computed; `grow` adds frames, `finish` takes the complete run.
    ``compared``: other designs by name, drawn pale behind it, their curves beside its own. ``study``: designs to choose from.
    """

    def __init__(
        self,
        shown: Run | Recording,
        port: int = 8080,
        folder: Path | None = None,
        *,
        growing: bool = False,
        compared: Mapping[str, Run | Recording] | None = None,
        study: StoredStudy | None = None,
    ):
        self._session: EditSession | None = None
        self._study = study
        self._growth: Growth | None = None
        self.opening: threading.Thread | None = None
        self._folder = folder or (shown.path.resolve().parent if isinstance(shown, Recording) else Path.cwd())
        view_model = view_model_of_recording(shown) if isinstance(shown, Recording) else None
        self._beside = {
            name: view_model_of_recording(other) if isinstance(other, Recording) else view_model_of_run(other, build(other))
            for name, other in (compared or {}).items()
        }
        self.server, self.guard = start_server(port, "mechviz")
        self.changes = ControlChanges()
        self.guard.admitted = self.changes.remember
        self.server.on_client_disconnect(lambda _: release_garbage())
        try:
            if isinstance(shown, Recording):
                assert view_model is not None
                self._play_recording(shown, view_model)
            elif growing:
                self._growth = Growth(self.server, shown)
                self._build(self._growth.view_model, "", None)
            else:
                self._edit(shown, "")
        except BaseException:
            self.close()
            raise

    def _play_recording(self, recording: Recording, view_model: ViewModel) -> None:
        """Show a recording as it is."""
        note = f"A recording, played as it is: {recording.path.name}. {recording.note}".rstrip()
        self._build(view_model, note, (lambda: self._open_scene(recording)) if recording.scene_text else None)

    def _open_scene(self, recording: Recording) -> None:
        """Solve, in a thread, the scene that a recording contains, and show the run, which can be edited, instead of it."""

        def solve() -> None:
            try:
                run = run_scene(recording.scene(), frames=min(recording.parsed_properties.frames - 1, MOST_FRAMES))
                self._exchange(run, f"The scene of {recording.path.name}, solved anew.")
            except Exception as error:
                report(self.server, "Opening the scene", error)

        if self.opening is not None and self.opening.is_alive():
            return
        self.opening = threading.Thread(target=solve, name="mechviz-opening", daemon=True)
        self.opening.start()

    def _exchange(self, run: Run, note: str) -> None:
        """Replace what is shown by a run that can be edited, at the same frame."""
        frame = self.frame
        self.player.close()
        self.inspector.close()
        self.server.gui.reset()
        self.server.scene.reset()
        self._edit(run, note)
        self.set_frame(min(frame, run.motion.frames - 1))

    @property
    def growth(self) -> Growth:
        """The state of a growing run. Raises `ViewerError` if the run is complete."""
        if self._growth is None:
            raise ViewerError("This run is complete: it does not grow.")
        return self._growth

    def grow(self, run: Run, duration: float) -> None:
        """Take more frames of a growing run of total ``duration`` [s]. If its last frame is shown, show the new last one."""
        newest = not self.playing and self.frame == self.inspector.view_model.frames - 1
        self.inspector.present(self.growth.take(run, duration))
        if newest:
            self.set_frame(self.inspector.view_model.frames - 1)

    def fail(self, error: Exception) -> None:
        """Show that a growing run ends early, and why."""
        self.growth.fail(error)

    def finish(self, run: Run) -> None:
        """Take the complete run in place of the growing one: from now on it can be edited."""
        self._growth = None
        self._exchange(run, "")

    def _edit(self, run: Run, note: str) -> None:
        """Show a run that can be edited."""
        self._session = EditSession(
            run,
            present=lambda view_model: self.inspector.present(view_model),
            report=lambda status: self.inspector.show_status(status),
            contributed=lambda contributions: self.inspector.show_contributions(contributions),
            settled=lambda: self.inspector.settle(),
            failed=lambda error: report(self.server, "Editing", error),
        )
        self._build(self._session.view_model, note, None)
        self._session.find_contributions()

    def _build(self, view_model: ViewModel, note: str, edit: Callable[[], None] | None) -> None:
        server = self.server

        def callback(what: str, action: Callable[[Any], None]) -> Callable[[Any], Any]:
            return safely(server, self.changes, what, action)

        theme(server, dark=False)
        prepare_page(server, f"{view_model.title} · mechviz")
        playback = BrowserPlayback(server, lambda: self.inspector.tracks(), lambda frame: self.inspector.show_remotely(frame))
        self.player = Player(
            view_model.time,
            self._draw,
            self._undraw,
            remote=playback,
        )
        self.inspector = Inspector(
            server, view_model, self.player, self._session, self._folder, callback, playback, note, edit, self._beside, self._study
        )
        self.player.start()
        self.set_frame(view_model.opening)

    def _draw(self, frame: int, playing: bool) -> None:
        changes = self.changes.open()
        self.inspector.draw(frame, playing)
        self.changes.accept(changes)

    def _undraw(self, error: Exception) -> None:
        """Report a failed drawing, and undo the changes since the last complete one."""
        report(self.server, "Drawing", error)
        if self.changes.undo():
            self.player.refresh()

    @property
    def session(self) -> EditSession:
        """The session that edits the scene. Raises `ViewerError` if a recording is only played."""
        if self._session is None:
            raise ViewerError("A recording is played as it is: press 'Edit this scene' first.")
        return self._session

    @property
    def run(self) -> Run:
        """The run shown now."""
        return self.session.run

    @property
    def scene(self) -> Scene3D:
        """Node groups drawn in 3D."""
        return self.inspector.scene

    @property
    def plots(self) -> Plots:
        return self.inspector.plots

    @property
    def switches(self) -> Switches:
        return self.inspector.switches

    @property
    def timeline(self) -> Timeline:
        return self.inspector.timeline

    @property
    def port(self) -> int:
        return int(self.server.get_port())

    @property
    def url(self) -> str:
        return f"http://{HOST}:{self.port}/"

    @property
    def frame(self) -> int:
        return self.player.frame

    @property
    def playing(self) -> bool:
        return self.player.playing

    def set_frame(self, frame: int) -> None:
        """Pause at a frame; returns when it has been sent to the browsers."""
        self.player.seek(frame)
        self.player.wait()

    def play(self) -> None:
        self.player.play()

    def pause(self) -> None:
        self.player.pause()
        self.player.wait()

    def close(self) -> None:
        """Stop playing and serving; a second call has no effect."""
        if hasattr(self, "player"):
            self.player.close()
        if hasattr(self, "inspector"):
            self.inspector.close()
        if self._session is not None:
            self._session.close()
        stop_server(self.server)

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def serve(
    shown: Run | Recording,
    port: int = 8080,
    open_browser: bool = False,
    folder: Path | None = None,
    compared: Mapping[str, Run | Recording] | None = None,
    study: StoredStudy | None = None,
) -> None:
    """Serve a run or a recording until Ctrl-C or SIGTERM; the arguments are those of `Viewer`, and ``open_browser`` opens a page.

    Raises `ViewerError` if the port cannot be used or the recording cannot be shown.
    """
    with _until_stopped() as stopped, Viewer(shown, port, folder, compared=compared, study=study) as viewer:
        print(f"{viewer.inspector.view_model.title}: {viewer.url}", flush=True)
        print("Open this address in a browser on this machine. Ctrl-C stops the viewer.", flush=True)
        if open_browser:
            webbrowser.open(viewer.url)
        while not stopped.wait(1.0):
            pass
    print("The viewer has stopped.", flush=True)


def serve_while(
    solve: Callable[[Callable[[Simulation, float], None]], Run], scene: Scene, port: int = 8080, folder: Path | None = None
) -> None:
    """Serve a motion under forces while it is computed, and then like any other run, until Ctrl-C or SIGTERM.

    ``solve(observe)`` runs in a thread of its own and calls ``observe`` as `run_scene` does. Raises `ViewerError`, and what
    ``solve`` raises: at once if no frames are known yet, otherwise after the viewer has been stopped.
    """
    with _until_stopped() as stopped, contextlib.ExitStack() as stack:
        computing = stack.enter_context(Computing(solve, scene))
        viewer: Viewer | None = None
        while computing.wait() and not stopped.is_set():
            run = computing.latest_run()
            if run is None:
                continue
            begun = time.perf_counter()
            if viewer is None:
                viewer = stack.enter_context(Viewer(run, port, folder, growing=True))
                print(f"{scene.title or scene.name}: {viewer.url}", flush=True)
                print("Open this address in a browser: the motion grows while it is computed. Ctrl-C stops the viewer.", flush=True)
            viewer.grow(run, computing.duration)
            stopped.wait(float(np.clip(PAUSE_RATIO * (time.perf_counter() - begun), *PAUSE_LIMITS)))
        if stopped.is_set():
            computing.stop()
        elif computing.error is not None:
            if viewer is None:
                raise computing.error
            viewer.fail(computing.error)
            print(f"The motion ends early: {computing.error}", file=sys.stderr, flush=True)
        elif computing.run is not None:
            if viewer is None:  # the run was complete before any of it was shown
                viewer = stack.enter_context(Viewer(computing.run, port, folder))
                print(f"{scene.title or scene.name}: {viewer.url}", flush=True)
            else:
                viewer.finish(computing.run)
            print("The whole motion is there.", flush=True)
        while not stopped.wait(1.0):
            pass
    print("The viewer has stopped.", flush=True)
    if computing.error is not None and not isinstance(computing.error, Stopped):
        raise computing.error


@contextlib.contextmanager
def _until_stopped() -> Iterator[threading.Event]:
    """An event that Ctrl-C and SIGTERM set, instead of interrupting the program at any point."""
    stopped = threading.Event()
    if threading.current_thread() is not threading.main_thread():  # only the main thread gets signals
        yield stopped
        return

    def stop(_number: int, _frame: FrameType | None) -> None:
        stopped.set()

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
