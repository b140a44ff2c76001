"""The viewer: a run in the browser, served on this machine."""

from __future__ import annotations

import contextlib
import signal
import threading
import webbrowser
from collections.abc import Callable, Iterator
from types import FrameType, TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..run import Run
from .browser import prepare_page
from .panels import RIGHT_WIDTH, Switches, Timeline
from .player import Player
from .plots import Plots
from .scene3d import Scene3D
from .server import HOST, report, safely, start_server, stop_server

__all__ = ["Viewer", "serve", "telling_frame"]


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
        self.set_frame(telling_frame(run))

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


def telling_frame(run: Run) -> int:
    """The frame to open at.

    With forces, where reactions and driving efforts together come nearest to their peaks: at a dead centre, where all links and
    arrows lie on one line, the effort is nothing. Else an eighth of the first drive's cycle into the run.
    """
    motion, forces = run.motion, run.forces
    if forces is not None:
        reactions = [np.hypot(*forces.reaction(pair.name)[:, :2].T) for pair in motion.mechanism.pairs]
        efforts = [forces.effort(drive.pair) for drive in motion.mechanism.drives]
        load = sum(_of_peak(values) for values in (np.max(reactions, axis=0), *efforts))
        if np.any(load):
            return int(np.argmax(load))
    cycle = motion.mechanism.drives[0].law.duration if motion.mechanism.drives else float(np.ptp(motion.time))
    return int(np.argmin(np.abs(motion.time - motion.time[0] - min(cycle, float(np.ptp(motion.time))) / 8.0)))


def _of_peak(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Magnitudes as parts of the largest one; nothing where they are not finite or all zero."""
    size = np.nan_to_num(np.abs(values), nan=0.0, posinf=0.0)
    return size / max(float(size.max(initial=0.0)), 1e-300)


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
