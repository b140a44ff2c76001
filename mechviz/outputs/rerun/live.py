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

from mechcore.arrays import Real
from mechcore.effects.plan import OUTPUTS, make_plan
from mechcore.spec.clearance import made_joints
from mechviz.outputs.rerun.blueprint import picture as mechanism_view
from mechviz.outputs.rerun.nodes import picture_statics, picture_streams
from mechviz.outputs.rerun.plots import plot_styles
from mechviz.outputs.rerun.stream_file import Part, live_file, send_blueprint
from mechviz.outputs.rerun.streams import Timelines, link_streams, magnification, table_streams, view_statics
from mechviz.outputs.rerun.writer import describe_run
from mechviz.picture.build import bare_picture, solids_of
from mechviz.running import Running

if TYPE_CHECKING:
    from mechcore.dynamics.simulation import Simulation
    from mechviz.meshes.solids import Solids
    from mechviz.runs import Run
    from mechviz.scene.scene import Scene


ROOM = 0.25  # around a closed linkage, in its sizes


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
        numbers = [*run.numbers.tables.values()]
        if self._solids is None:
            self._solids = solids_of(run)
            blueprint = _blueprint(self._running.scene, _room(run, self._solids))
            send_blueprint(self.part.stream, blueprint)
            picture = bare_picture(run, self._solids)
            describe_run(self.part.stream, run, self._solids, picture, [], 1, complete=False)
            for static in (*view_statics(picture.size), *picture_statics(picture), *plot_styles(run, numbers)):
                self.part.stream.log(static.path, static.archetype, static=True)
            self.part.flush(0)
        frames = np.arange(run.motion.frames)
        columns = Timelines.of(run).columns(frames)
        drawn = picture_streams(bare_picture(run, self._solids), 1)
        for stream in (*link_streams(run), *drawn, *table_streams(numbers)):
            self.part.stream.send_columns(stream.path, columns, stream.columns(frames))
        self.part.flush(self.sent)
        self.told(self.sent)


@contextmanager
def live(
    scene: Scene, path: Path, port: int | None, told: Callable[[int], None] = lambda _: None
) -> Iterator[tuple[Live, str | None]]:
    """Rows of a simulation into the unfinished recording beside ``path``, and to viewers that connect to ``port`` (0: a free one;
    None: to none). Gives what has to be called, and the address for viewers. Raises `RecordingError`."""
    with live_file(path, port, scene.title or scene.name, _blueprint(scene, np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]]))) as (
        part,
        address,
    ):
        yield Live(scene, part, told), address


def _room(run: Run, solids: Solids) -> Real:
    """The box (2, 3) [m] that is looked at: where the mechanism is at first, and where it may go. What hangs in no loop swings as
    far as it reaches from the frame's joints, to all sides."""
    box, motion = np.array(solids.bounds, float), run.motion
    frame = motion.mechanism.frame
    more = ROOM * solids.size
    for joint in (p for p in motion.mechanism.joints if frame in p.links and not motion.model.loops):
        at = motion.joint_position(joint.name)[0]
        more = float(np.hypot(*np.maximum(box[1, :2] - at, at - box[0, :2])))
        box[:, :2] = np.minimum(box[0, :2], at - more), np.maximum(box[1, :2], at + more)
        more = 0.0
    box[:, :2] += np.array([[-more], [more]])
    return np.asarray(magnification(solids.size) * box)


def _blueprint(scene: Scene, room: Real) -> Any:
    """The mechanism, and the free coordinates and energies over the time, which the view follows."""
    import rerun.blueprint as rrb

    made = made_joints(scene.mechanism)
    free = [d.joint for d in scene.mechanism.drives if d.joint not in made]
    plots = [rrb.TimeSeriesView(name=joint, origin="/", contents=[f"+ /data/joints/{joint}/motion"]) for joint in free[:3]]
    if make_plan(scene.mechanism, set(OUTPUTS)).has("reactions and drive efforts"):
        plots.append(rrb.TimeSeriesView(name="Energy [J]", origin="/", contents=["+ /data/energy"]))
    return rrb.Blueprint(
        rrb.Horizontal(mechanism_view("Mechanism", [], room), rrb.Vertical(*plots), column_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="following"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        collapse_panels=False,
    )
