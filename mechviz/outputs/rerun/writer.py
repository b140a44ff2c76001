"""Writes a solved scene as a rerun recording, or a simulation block by block while it runs, so that it can be watched."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import numpy as np

from mechcore.arrays import Real
from mechcore.effects.plan import OUTPUTS, StageKind, make_plan
from mechcore.motion.events import Event
from mechcore.numerics.frames import give_back_memory
from mechcore.records import dataclass
from mechcore.spec.clearance import auxiliary_names
from mechviz.outputs.drawings import diagram_views, find_diagrams
from mechviz.outputs.rerun.blueprint import BACKGROUND_COLOR, make_blueprint, spans_of_plots
from mechviz.outputs.rerun.blueprint import picture as mechanism_view
from mechviz.outputs.rerun.content import (
    Content,
    accuracy_words,
    describe_run,
    find_statics,
    find_streams,
    find_views,
    property_statics,
    recorded_frames,
)
from mechviz.outputs.rerun.entities import (
    Stream,
    Timelines,
    link_streams,
    magnification,
    picture_stride,
    table_streams,
    view_statics,
)
from mechviz.outputs.rerun.nodes import LEGEND_ROOM, extent, picture_statics, picture_streams
from mechviz.outputs.rerun.plots import mark_times, plot_styles, send_lanes, send_marks
from mechviz.outputs.rerun.rerun_adapter import send_blueprint
from mechviz.outputs.rerun.stream_file import PartialFile, live_file, recording_file
from mechviz.picture.build import bare_picture, picture_of, solids_of
from mechviz.picture.constructions import drawings_of
from mechviz.picture.nodes import Arrow
from mechviz.picture.overlays import overlay_box
from mechviz.quantities.events import events_of, line_of
from mechviz.quantities.vectors import FORCE_FAMILIES
from mechviz.runs import Run, Running, Stage, stopwatch

if TYPE_CHECKING:
    import rerun as rr

    from mechcore.dynamics.simulation import Simulation
    from mechviz.meshes.solids import Solids
    from mechviz.scene.scene import Scene

BLOCK_FRAMES = 5000
"""Frames per block: large enough for speed and memory (rerun keeps about 6 kB for each entity and block until the end), small
enough that an interrupted run keeps most of its frames."""
WAITING_ROWS = 50_000  # rows that wait in memory, about 2 MB
MANY_ROWS = 4_000_000  # for a recording with more rows, memory is released after every block, although that takes time


MOST_WARNINGS = 6  # in the summary


@dataclass(frozen=True)
class RecordingSummary:
    """Report of a recording: stages computed and left out, and their times; ``str`` gives the summary for the user."""

    path: Path
    recording_id: str
    frames: int
    entities: int
    bytes: int
    computed: tuple[str, ...]
    skipped: tuple[str, ...]
    stages: tuple[Stage, ...]  # the solver's first
    events: tuple[Event, ...]
    errors: tuple[str, ...]  # estimates of the errors of the run, as text
    clashes: tuple[tuple[str, str], ...]  # links whose solids pass through each other

    @property
    def seconds(self) -> float:
        """Time of all stages [s]."""
        return sum(s.seconds for s in self.stages)

    def __str__(self) -> str:
        lines = [f"{self.frames} frames, {self.entities} entities, {self.bytes / 1e6:.2f} MB, {self.seconds:.2f} s", *self.errors]
        lines += [f"the solids of {a} and {b} pass through each other in every order of layers" for a, b in self.clashes]
        warnings = [e for e in self.events if e.level == "WARN"]
        lines += [f"warning: {line_of(e)}" for e in warnings[:MOST_WARNINGS]]
        if len(warnings) > MOST_WARNINGS:
            lines.append(f"and {len(warnings) - MOST_WARNINGS} warnings more: see mechviz inspect {self.path}")
        return "\n".join(lines)

    def costs(self) -> str:
        """Text of the stages computed and left out, and of their times, the longest first."""
        dearest = sorted(self.stages, key=lambda s: -s.seconds)
        width = max(len(s.name) for s in dearest)
        lines = [f"computed: {', '.join(self.computed)}", f"left out: {', '.join(self.skipped) or 'nothing'}"]
        lines += [f"{self.bytes / max(self.frames, 1) / 1e3:.2f} kB a frame"]
        return "\n".join([*lines, *(f"  {s.name:<{width}} {1e3 * s.seconds:9.1f} ms" for s in dearest)])


def write_recording(
    run: Run,
    path: Path | str,
    *,
    recording_id: str | None = None,
    solids: Solids | None = None,
    progress: Callable[[int, int], None] | None = None,
    begin: Callable[[str], None] = lambda _: None,
    check: Callable[[], None] = lambda: None,
    before: Sequence[Stage] = (),
) -> RecordingSummary:
    """Write a run to ``path``, which is replaced as a whole when the recording is complete, and return a summary.

    ``progress`` is called with the number of frames written and the total, ``begin`` with the name of each stage when it begins.
    ``check`` is called when the errors are known; if it raises, nothing is written. ``before``: stages of the caller, which the
    summary lists as well. Raises `RecordingError` if the file cannot be written. An interruption leaves ``<name>.part.rrd``, and a
    note on its exception says so.
    """
    path = Path(path)
    recording_id = recording_id or f"{run.scene.name}-{uuid4()}"
    stages = [*before]

    def stage(name: str) -> AbstractContextManager[None]:
        begin(name)
        return stopwatch(stages, name)

    with stage("error estimates"):
        _ = run.errors  # computed once, for the tables, the notes and the summary
        run.motion.forget()
    check()
    if "rerun" not in sys.modules:
        with stage("loading rerun"):
            import_module("rerun")
    with stage("solid meshes"):
        solids = solids or solids_of(run)
    with stage("tables, arrows and events"):
        picture = picture_of(run, solids)
        every = picture_stride(run)
        timelines = Timelines.of(run)
        events = events_of(run)
        content = Content(
            run,
            solids,
            [*run.numbers.tables.values()],
            picture,
            drawings_of(run, solids.size),
            every,
            find_diagrams(run),
        )
        thin = run.accuracy.decimation
        streams = [s if thin == 1 else replace(s, every=s.every * thin) for s in find_streams(content)]
    with stage("blueprint"):
        scales = picture.scales
        motion = [a.vector for a in picture.nodes_of(Arrow, "velocity", "acceleration")]
        forces = [a.vector for a in picture.nodes_of(Arrow, *FORCE_FAMILIES)]
        bounds = {
            "forces": extent(forces, scales, picture.bounds, solids.size),
            "motion": extent(motion, scales, picture.bounds, solids.size),
        }
        drawn = overlay_box(run, solids)
        if motion or forces:
            drawn[0, 1] -= LEGEND_ROOM * solids.size
        bounds = {k: np.array([np.minimum(box[0], drawn[0]), np.maximum(box[1], drawn[1])]) for k, box in bounds.items()}
        enlarged = magnification(solids.size)  # the camera is placed in the enlarged picture
        marks = mark_times(events)
        spans = spans_of_plots(run) if len(marks) else {}
        views, diagrams = find_views(content), diagram_views(content.diagrams, BACKGROUND_COLOR)
        blueprint = make_blueprint(run, {name: enlarged * box for name, box in bounds.items()}, events, views, diagrams, spans)
        statics = find_statics(content)
    with recording_file(path, blueprint, recording_id, run.scene.title or run.scene.name) as part:
        with stage("writing"):
            describe_run(part.stream, run, solids, picture, stages, every, complete=False)
            for static in (*statics, *property_statics(run)):
                part.stream.log(static.path, static.archetype, static=True)
            _send_events(part.stream, timelines, events)
            send_marks(part.stream, timelines, marks, spans)
            send_lanes(part.stream, timelines, run)
            part.flush(0)  # everything that reading the frames requires comes before them
            _send_streams(part, streams, timelines, run, progress)
        describe_run(part.stream, run, solids, picture, stages, every, complete=True)
    return RecordingSummary(
        path=path,
        recording_id=recording_id,
        frames=recorded_frames(run),
        entities=len({s.path for s in streams} | {s.path for s in statics}),
        bytes=path.stat().st_size,
        computed=tuple(s.name for s in run.plan.computed),
        skipped=tuple(s.name for s in run.plan.skipped),
        stages=(*run.stages, *stages),
        events=events,
        errors=accuracy_words(run),
        clashes=tuple(solids.clashes),
    )


def _send_events(stream: rr.RecordingStream, timelines: Timelines, events: Sequence[Event]) -> None:
    if not events:
        return
    import rerun as rr

    lines = rr.TextLog.columns(text=[line_of(e) for e in events], level=[e.level for e in events])
    parts = rr.AnyValues.columns(item=[e.item for e in events], message=[e.text for e in events])
    stream.send_columns("events", timelines.columns_at(np.array([e.time for e in events])), [*lines, *parts])


def _send_streams(
    part: PartialFile, streams: list[Stream], timelines: Timelines, run: Run, progress: Callable[[int, int], None] | None
) -> None:
    """Send all entities block by block, so that they end at the same frame in an interrupted recording."""
    total = len(timelines.time)
    waiting = 0
    _make_room(run)
    # the last block has between half and one and a half times the frames
    for start, stop in pairwise([0, *range(BLOCK_FRAMES, total - BLOCK_FRAMES // 2, BLOCK_FRAMES), total]):
        times: dict[int, Any] = {}
        for stream in streams:
            frames = slice(start + -start % stream.every, stop, stream.every)
            if frames.start >= stop:
                continue
            if stream.every not in times:
                times[stream.every] = timelines.columns(frames)
            part.stream.send_columns(stream.path, times[stream.every], stream.columns(frames))
            waiting += len(range(stop)[frames])
            if waiting > WAITING_ROWS:
                part.stream.flush()
                waiting = 0
        part.flush(stop)
        if total * len(streams) > MANY_ROWS:
            _make_room(run)
        if progress is not None:
            progress(part.frames, total)


def _make_room(run: Run) -> None:
    """Release memory for rerun: values that are easily computed again are dropped, and free memory is returned to the system."""
    run.motion.forget()
    give_back_memory()


# -- live -------------------------------------------------------------------------------------------------------------
LINKAGE_ROOM = 0.25  # margin around a closed linkage, in sizes of the mechanism


class Live:
    """A callable for every segment of a motion, in order, that sends its frames: solids, poses, and all numbers, including
    reactions and energies if the scene has forces. ``progress`` is called with the number of frames sent, after every block.

    Arrows need the scale of the whole run, and plots of events its end: only the finished recording has them, which replaces this
    one."""

    def __init__(self, scene: Scene, part: PartialFile, progress: Callable[[int], None] = lambda _: None):
        self.part = part
        self.progress = progress
        self._running = Running(scene)
        self._solids: Solids | None = None

    @property
    def sent(self) -> int:
        """Number of frames in the file."""
        return self._running.sent

    def __call__(self, segment: Simulation, duration: float) -> None:
        """Take a segment, and send the complete frames when there are enough of them. ``duration``: of the whole run [s]."""
        run = self._running.take(segment, duration)
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
        frames = slice(0, run.motion.frames)
        columns = Timelines.of(run).columns(frames)
        drawn = picture_streams(bare_picture(run, self._solids), 1)
        for stream in (*link_streams(run), *drawn, *table_streams(numbers)):
            self.part.stream.send_columns(stream.path, columns, stream.columns(frames))
        self.part.flush(self.sent)
        self.progress(self.sent)


@contextmanager
def live(
    scene: Scene, path: Path, port: int | None, progress: Callable[[int], None] = lambda _: None
) -> Iterator[tuple[Live, str | None]]:
    """A context that sends a simulation to the unfinished recording beside ``path``, and to viewers that connect to ``port`` (0: a
    free one, None: no viewers). Returns the callable for its segments, and the address for viewers. Raises `RecordingError`."""
    with live_file(path, port, scene.title or scene.name, _blueprint(scene, np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]]))) as (
        part,
        address,
    ):
        yield Live(scene, part, progress), address


def _room(run: Run, solids: Solids) -> Real:
    """The box (2, 3) [m] for the view: the mechanism at the start, and the space that it may reach. Links of an open chain may
    reach as far as their extent from the frame's joints, to all sides."""
    box, motion = np.array(solids.bounds, float), run.motion
    frame = motion.mechanism.frame
    more = LINKAGE_ROOM * solids.size
    for joint in (p for p in motion.mechanism.joints if frame in p.links and not motion.model.loops):
        at = motion.joint_position(joint.name)[0]
        more = float(np.hypot(*np.maximum(box[1, :2] - at, at - box[0, :2])))
        box[:, :2] = np.minimum(box[0, :2], at - more), np.maximum(box[1, :2], at + more)
        more = 0.0
    box[:, :2] += np.array([[-more], [more]])
    return np.asarray(magnification(solids.size) * box)


def _blueprint(scene: Scene, room: Real) -> Any:
    """A blueprint of the mechanism, and of free coordinates and energies over time, which follows the newest frame."""
    import rerun.blueprint as rrb

    made = auxiliary_names(scene.mechanism)
    free = [d.joint for d in scene.mechanism.drives if d.joint not in made]
    plots = [rrb.TimeSeriesView(name=joint, origin="/", contents=[f"+ /data/joints/{joint}/motion"]) for joint in free[:3]]
    if make_plan(scene.mechanism, set(OUTPUTS)).has(StageKind.FORCES):
        plots.append(rrb.TimeSeriesView(name="Energy [J]", origin="/", contents=["+ /data/energy"]))
    return rrb.Blueprint(
        rrb.Horizontal(mechanism_view("Mechanism", [], room), rrb.Vertical(*plots), column_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="following"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        collapse_panels=False,
    )
