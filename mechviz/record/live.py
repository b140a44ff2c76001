"""A simulation that can be watched while it runs: block by block, in an unfinished recording and to viewers.

Solids, poses and all numbers go here, reactions and energies among them where the scene has forces. Arrows need the scale of the
whole run, plots of events its end: they are in the finished recording, which takes the place of this one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.clearance import made_pairs

from ..running import Running
from ..solids import solids_of
from ..tables import tables
from .arrows import shapes
from .stream_file import Part, live_file
from .streams import Timelines, mechanism_streams, static_shapes, table_streams
from .writer import describe_run

if TYPE_CHECKING:
    from mechcore.dynamics import Simulation

    from ..meshes import Solids
    from ..run import Run
    from ..scene import Scene

__all__ = ["Live", "live"]


class Live:
    """Called with every stretch of a motion, in order, it sends the frames in it: solids, poses, all numbers. ``told`` the frames
    that are sent, after every block."""

    def __init__(self, scene: Scene, part: Part, told: Callable[[int], None] = lambda _: None):
        self.part = part
        self.told = told
        self._running = Running(scene)
        self._solids: Solids | None = None

    @property
    def sent(self) -> int:
        """Frames that are in the file."""
        return self._running.sent

    def __call__(self, stretch: Simulation, duration: float) -> None:
        """Take a stretch; send what is complete when there is enough of it. ``duration``: of the whole run [s]."""
        run = self._running.take(stretch, duration)
        if run is not None:
            self._send(run)

    def _send(self, run: Run) -> None:
        if self._solids is None:
            self._solids = solids_of(run)
            scales = shapes(run, self._solids.size)[2]
            describe_run(self.part.stream, run, self._solids, scales, [], 1, complete=False)
            for static in static_shapes(run, self._solids, [], []):
                if not static.path.startswith("mechanism/paths"):  # where points will have been
                    self.part.stream.log(static.path, static.archetype, static=True)
        frames = np.arange(run.motion.frames)
        columns = Timelines.of(run).columns(frames)
        for stream in (*mechanism_streams(run, self._solids), *table_streams(tables(run))):
            self.part.stream.send_columns(stream.path, columns, stream.columns(frames))
        self.part.flush(self.sent)
        self.told(self.sent)


@contextmanager
def live(
    scene: Scene, path: Path, port: int | None, told: Callable[[int], None] = lambda _: None
) -> Iterator[tuple[Live, str | None]]:
    """Rows of a simulation into the unfinished recording beside ``path``, and to viewers that connect to ``port`` (0: a free one;
    None: to none). Gives what has to be called, and the address for viewers. Raises `RecordingError`."""
    with live_file(path, port, scene.title or scene.name, _blueprint(scene)) as (part, address):
        yield Live(scene, part, told), address


def _blueprint(scene: Scene) -> Any:
    """The mechanism, and the free coordinates over the time, which the view follows."""
    import rerun.blueprint as rrb

    made = made_pairs(scene.mechanism)
    free = [d.pair for d in scene.mechanism.drives if d.pair not in made]
    plots = [rrb.TimeSeriesView(name=pair, origin="/", contents=[f"+ /data/joints/{pair}/motion"]) for pair in free[:3]]
    picture = rrb.Spatial3DView(name="Mechanism", origin="/", contents=["+ /mechanism/**"])
    return rrb.Blueprint(
        rrb.Horizontal(picture, rrb.Vertical(*plots), column_shares=[3, 2]),
        rrb.TimePanel(timeline="time", play_state="following"),
    )
