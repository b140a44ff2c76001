"""The viewer: a run in the browser, served on this machine."""

from __future__ import annotations

import contextlib
import signal
import threading
import webbrowser
from collections.abc import Callable, Iterator
from types import FrameType, TracebackType
from typing import Any

from ..run import Run
from .browser import prepare_page
from .panels import RIGHT_WIDTH, Switches, Timeline
from .player import Player
from .plots import Plots
from .scene3d import Scene3D
from .server import HOST, report, safely, start_server, stop_server

__all__ = ["Viewer", "serve"]


class Viewer:
    """A run served at ``url`` until ``close``. All browsers see the same frame, each through its own camera.

    ``port`` 0 takes a free one. Raises `ViewerError` if the port cannot be had.
    """

    def __init__(self, run: Run, port: int = 8080):
        self.run = run
        self.server = start_server(port, "mechviz")
        try:
            self._build()
        except BaseException:
            self.close()
            raise

    def _build(self) -> None:
        server, run = self.server, self.run

        def callback(what: str, action: Callable[[Any], None]) -> Callable[[Any], Any]:
            return safely(server, what, action)

        server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(34, 92, 160))
        prepare_page(server, f"{run.scene.title} · mechviz")
        self.player = Player(run.motion.time, self._draw, lambda error: report(server, "Drawing", error))
        self.scene = Scene3D(server, run)
        self.switches = Switches(server, run, self.scene, self.player, callback)
        panel = server.gui.add_panel()
        self.plots = Plots(server, panel.add_tab("Plots"), run, callback)
        panel.dock_right()
        panel.set_width(RIGHT_WIDTH)
        self.timeline = Timeline(server, run, self.player, callback)
        self.player.start()
        self.player.wait()

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
        stop_server(self.server)

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _draw(self, frame: int, playing: bool) -> None:
        """Bring the picture, the plots and the timeline to a frame. Runs in the player's thread."""
        with self.server.atomic():
            self.scene.show(frame)
            self.timeline.show(frame, playing)
            self.plots.show(frame, playing)
        self.server.flush()


def serve(run: Run, port: int = 8080, open_browser: bool = False) -> None:
    """Serve a run until Ctrl-C or SIGTERM. Raises `ViewerError` if the port cannot be had."""
    with _until_stopped() as stopped, Viewer(run, port) as viewer:
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
