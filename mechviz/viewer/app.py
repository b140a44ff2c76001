"""The viewer: a run in the browser, served on this machine."""

from __future__ import annotations

import contextlib
import signal
import threading
import webbrowser
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

from ..run import Run
from .browser import prepare_page
from .inspector import Inspector, theme
from .playback import BrowserPlayback
from .player import Player
from .plots import Plots
from .scene3d import Scene3D
from .server import HOST, report, safely, start_server, stop_server
from .show import Show
from .show_run import telling_frame
from .studio import Studio
from .switches import Switches
from .timeline import Timeline

__all__ = ["Viewer", "serve", "telling_frame"]


class Viewer:
    """A run served at ``url`` until ``close``. All browsers see the same frame, each through its own camera.

    ``port`` 0 takes a free one. Scenes and recordings are saved into ``folder``, where the scene's file is (by default the
    working folder). Raises `ViewerError` if the port cannot be had.
    """

    def __init__(self, run: Run, port: int = 8080, folder: Path | None = None):
        self.server = start_server(port, "mechviz")
        try:
            self._edit(run, folder or Path.cwd(), "")
        except BaseException:
            self.close()
            raise

    def _edit(self, run: Run, folder: Path, note: str) -> None:
        """Show a run that can be edited."""
        self.studio = Studio(
            run,
            present=lambda show: self.inspector.present(show),
            told=lambda status: self.inspector.tell(status),
            contributed=lambda found: self.inspector.weighed(found),
            settled=lambda: self.inspector.settle(),
            failed=lambda error: report(self.server, "Editing", error),
            folder=folder,
        )
        self._build(self.studio.show, folder, note)
        self.studio.weigh()

    def _build(self, show: Show, folder: Path, note: str) -> None:
        server = self.server

        def callback(what: str, action: Callable[[Any], None]) -> Callable[[Any], Any]:
            return safely(server, what, action)

        theme(server, dark=False)
        prepare_page(server, f"{show.title} · mechviz")
        playback = BrowserPlayback(server, lambda: self.inspector.tracks(), lambda frame: self.inspector.glance(frame))
        self.player = Player(
            show.time,
            lambda frame, playing: self.inspector.draw(frame, playing),
            lambda error: report(server, "Drawing", error),
            remote=playback,
        )
        self.inspector = Inspector(server, show, self.player, self.studio, folder, callback, playback, note)
        server.on_client_connect(lambda client: playback.greet(client, self.player.clock))
        server.on_client_disconnect(playback.forget)
        self.player.start()
        self.set_frame(show.opening)

    @property
    def run(self) -> Run:
        """The run as it is shown now."""
        return self.studio.run

    @property
    def scene(self) -> Scene3D:
        """What is drawn in 3D."""
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
        """Stop playing and serving; harmless if done before."""
        if hasattr(self, "player"):
            self.player.close()
        if getattr(self, "studio", None) is not None:
            self.studio.close()
        stop_server(self.server)

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def serve(run: Run, port: int = 8080, open_browser: bool = False, folder: Path | None = None) -> None:
    """Serve a run until Ctrl-C or SIGTERM. Raises `ViewerError` if the port cannot be had."""
    with _until_stopped() as stopped, Viewer(run, port, folder) as viewer:
        print(f"{run.scene.title}: {viewer.url}", flush=True)
        print("Open this address in a browser on this machine. Ctrl-C stops the viewer.", flush=True)
        if open_browser:
            webbrowser.open(viewer.url)
        while not stopped.wait(1.0):
            pass
    print("The viewer has stopped.", flush=True)


@contextlib.contextmanager
def _until_stopped() -> Iterator[threading.Event]:
    """An event that Ctrl-C and SIGTERM set instead of ending the program in the middle of something."""
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
