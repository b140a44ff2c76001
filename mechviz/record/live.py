"""A simulation that can be watched while it runs: its motion, block by block, in an unfinished recording and to viewers.

What the forces say needs the whole run (scales of arrows, works and energies); so here go solids, poses and all that is kinematics.
The finished recording takes its place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mechcore.clearance import made_pairs
from mechcore.plan import make_plan

from ..run import Run
from ..solids import solids_of
from ..tables import tables
from .arrows import shapes
from .stream_file import Part, live_file
from .streams import Timelines, mechanism_streams, static_shapes, table_streams
from .writer import describe_run

if TYPE_CHECKING:
    from mechcore import Compiled
    from mechcore.dynamics.pieces import Piece

    from ..meshes import Solids
    from ..scene import Scene

__all__ = ["Live", "live"]

Real = NDArray[np.float64]
BLOCKS = 40  # of a run that goes on to its end


class Live:
    """Called with every stretch of a motion, in order, it sends the frames in it. ``duration``: of the whole run [s]."""

    def __init__(self, scene: Scene, part: Part, told: Callable[[int], None] = lambda _: None):
        self.scene = scene
        self.part = part
        self.sent = 0
        self.told = told
        self._pieces: list[Piece] = []
        self._times: Real | None = None
        self._solids: Solids | None = None

    def __call__(self, piece: Piece, compiled: Compiled, duration: float) -> None:
        """Take a stretch; send what is complete when there is enough of it."""
        if self._times is None:
            self._times = np.linspace(0.0, duration, self.scene.frames + 1)
        self._pieces.append(piece)
        known = int(np.searchsorted(self._times, piece.end, side="right"))
        if known - self.sent >= max(len(self._times) // BLOCKS, 2) or (known == len(self._times) and known > self.sent):
            self._send(compiled, self._times[self.sent : known])
            self._pieces = self._pieces[-1:]

    def _send(self, compiled: Compiled, times: Real) -> None:
        from mechcore.dynamics import Simulation

        assert self.scene.simulation is not None
        liftoffs = self.scene.simulation.liftoffs
        known = Simulation(compiled, tuple(self._pieces), (), "gauss", 0.0, 0, liftoffs=liftoffs)
        plan = make_plan(self.scene.mechanism, {"accelerations"})
        run = Run(scene=self.scene, compiled=compiled, motion=_any(known.view(times)), forces=None, plan=plan, stages=())
        if self._solids is None:
            self._solids = solids_of(run)
            describe_run(self.part.stream, run, self._solids, shapes(run, self._solids.size)[2], [], 1, complete=False)
            for static in static_shapes(run, self._solids, [], []):
                if not static.path.startswith("mechanism/paths"):  # where points will have been
                    self.part.stream.log(static.path, static.archetype, static=True)
        frames = np.arange(len(times))
        columns = Timelines.of(run).columns(frames)
        for stream in (*mechanism_streams(run, self._solids), *table_streams(tables(run))):
            self.part.stream.send_columns(stream.path, columns, stream.columns(frames))
        self.sent += len(times)
        self.part.flush(self.sent)
        self.told(self.sent)


def _any(value: Any) -> Any:
    """A view stands for a motion."""
    return value


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
