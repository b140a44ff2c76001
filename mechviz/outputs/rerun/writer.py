"""Writes a solved scene as a rerun recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import numpy as np

from mechcore.motion.events import Event
from mechviz.outputs.rerun.blueprint import BACKGROUND, make_blueprint, spans_of_plots
from mechviz.outputs.rerun.describe import (
    accuracy_words,
    link_properties,
    notes,
    properties,
    recorded_frames,
    scene_text,
)
from mechviz.outputs.rerun.diagrams import diagram_views, find_diagrams
from mechviz.outputs.rerun.families import Content, find_statics, find_streams, find_views
from mechviz.outputs.rerun.marks import mark_times, send_lanes, send_marks
from mechviz.outputs.rerun.nodes import LEGEND_ROOM, extent
from mechviz.outputs.rerun.paths import entity
from mechviz.outputs.rerun.stream_file import Part, recording_file
from mechviz.outputs.rerun.streams import Stream, Timelines, magnification, picture_stride
from mechviz.picture.build import picture_of, solids_of
from mechviz.picture.constructions import drawings_of
from mechviz.picture.nodes import Arrow, Picture
from mechviz.picture.overlays import overlay_box
from mechviz.quantities.events import events_of, line_of
from mechviz.quantities.vectors import FORCE_FAMILIES
from mechviz.runs import Run, Stage, stopwatch

if TYPE_CHECKING:
    from mechviz.meshes.solids import Solids


BLOCK = 2000
"""Frames per block: large enough to be quick and small, small enough that an interrupted run keeps most of what it had."""


MOST_WARNINGS = 6  # in the summary


@dataclass(frozen=True)
class RecordingSummary:
    """What was computed, left out and written, and what each stage cost. As text: what a person should know of the result."""

    path: Path
    recording_id: str
    frames: int
    entities: int
    bytes: int
    computed: tuple[str, ...]
    skipped: tuple[str, ...]
    stages: tuple[Stage, ...]  # the solver's first
    events: tuple[Event, ...]
    errors: tuple[str, ...]  # what the run says of its own errors
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
        """What was computed, what was left out, and what each stage cost, the dearest first."""
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
) -> RecordingSummary:
    """Write a run to ``path``, replaced as a whole when complete. ``progress`` is told the frames written and their number,
    ``begin`` each stage when it begins.

    Raises `RecordingError` where the file cannot be written. An interruption leaves ``<name>.part.rrd`` and puts a note on its
    exception, see `interruption`.
    """
    path = Path(path)
    recording_id = recording_id or f"{run.scene.name}-{uuid4()}"
    stages: list[Stage] = []

    def stage(name: str) -> AbstractContextManager[None]:
        begin(name)
        return stopwatch(stages, name)

    with stage("loading rerun"):
        import rerun  # noqa: F401
    with stage("solid meshes"):
        solids = solids or solids_of(run)
    with stage("error estimates"):
        _ = run.errors  # once: the tables, the notes and the summary tell them
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
        motion = [a.vector for a in picture.of(Arrow, "velocity", "acceleration")]
        forces = [a.vector for a in picture.of(Arrow, *FORCE_FAMILIES)]
        bounds = {
            "forces": extent(forces, scales, solids.bounds, solids.size),
            "motion": extent(motion, scales, solids.bounds, solids.size),
        }
        drawn = overlay_box(run, solids)
        if motion or forces:
            drawn[0, 1] -= LEGEND_ROOM * solids.size
        bounds = {k: np.array([np.minimum(box[0], drawn[0]), np.maximum(box[1], drawn[1])]) for k, box in bounds.items()}
        enlarged = magnification(solids.size)  # the eye stands in the enlarged picture
        marks = mark_times(events)
        spans = spans_of_plots(run) if len(marks) else {}
        views, diagrams = find_views(content), diagram_views(content.diagrams, BACKGROUND)
        blueprint = make_blueprint(run, {name: enlarged * box for name, box in bounds.items()}, events, views, diagrams, spans)
        statics = find_statics(content)
    with recording_file(path, blueprint, recording_id, run.scene.title or run.scene.name) as part:
        with stage("writing"):
            describe_run(part.stream, run, solids, picture, stages, every, complete=False)
            for static in statics:
                part.stream.log(static.path, static.archetype, static=True)
            for link in _properties_of_links(run):
                part.stream.log(*link, static=True)
            _send_events(part.stream, timelines, events)
            send_marks(part.stream, timelines, marks, spans)
            send_lanes(part.stream, timelines, run)
            part.flush(0)  # what the frames cannot be read without comes before them
            _send_streams(part, streams, timelines, progress)
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


def describe_run(
    stream: Any, run: Run, solids: Solids, picture: Picture, stages: list[Stage], every: int, *, complete: bool
) -> None:
    """Scene, properties and notes: at the start, so that an interrupted recording has them, and again when it is complete."""
    import rerun as rr

    spent = [*run.stages, *stages]
    wall = float(sum(s.seconds for s in spent))
    stream.send_property("mechviz", rr.AnyValues(**properties(run, picture, wall, complete=complete)))
    if not complete:
        stream.log("scene", rr.TextDocument(scene_text(run)), static=True)
    text = notes(run, solids, picture.scales, spent, every, complete=complete)
    stream.log("notes", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)


def _properties_of_links(run: Run) -> list[tuple[str, Any]]:
    """Where there are reactions: what balances of the moving links need, see `references`."""
    import rerun as rr

    if run.forces is None:
        return []
    return [(entity("data", "links", k, "properties"), rr.Scalars(values)) for k, values in link_properties(run).items()]


def _send_events(stream: Any, timelines: Timelines, events: Sequence[Event]) -> None:
    if not events:
        return
    import rerun as rr

    lines = rr.TextLog.columns(text=[line_of(e) for e in events], level=[e.level for e in events])
    parts = rr.AnyValues.columns(item=[e.item for e in events], message=[e.text for e in events])
    stream.send_columns("events", timelines.columns_at(np.array([e.time for e in events])), [*lines, *parts])


def _send_streams(part: Part, streams: list[Stream], timelines: Timelines, progress: Callable[[int, int], None] | None) -> None:
    """All entities block by block, so that what an interrupted recording has ends at the same frame everywhere."""
    total = len(timelines.time)
    for start in range(0, total, BLOCK):
        frames = np.arange(start, min(start + BLOCK, total))
        times: dict[int, Any] = {}
        for stream in streams:
            chosen = frames[frames % stream.every == 0]
            if len(chosen) == 0:
                continue
            if stream.every not in times:
                times[stream.every] = timelines.columns(chosen)
            part.stream.send_columns(stream.path, times[stream.every], stream.columns(chosen))
        part.flush(int(frames[-1]) + 1)
        if progress is not None:
            progress(part.frames, total)
