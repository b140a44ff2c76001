"""Presentation of a solved run or of a recording, the input of every output: the picture, the catalogue, events, states,
constructions, texts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache

import numpy as np

from mechcore.arrays import Integers, Real
from mechcore.errors import MechanismError
from mechcore.motion.events import Event
from mechcore.records import dataclass
from mechviz.outputs.rerun.content import notes
from mechviz.outputs.rerun.entities import RecordingError, parts_of, picture_stride, unpacked
from mechviz.outputs.rerun.plots import find_lanes
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.recorded import RecordedDrawings, picture_in, recorded_numbers
from mechviz.picture.build import picture_of, solids_of
from mechviz.picture.constructions import Drawing, drawings_of
from mechviz.picture.nodes import Color, Picture
from mechviz.quantities.catalogue import Catalogue
from mechviz.quantities.events import events_of
from mechviz.runs import Run, package_version, run_scene
from mechviz.studies.designs.sensitivity import Bands, bands_of, with_tolerances


@dataclass(frozen=True)
class Lane:
    """States over time; each change: its time [s], the new state and its colour."""

    name: str
    changes: tuple[tuple[float, str, Color], ...]


@dataclass(frozen=True, eq=False)
class Presentation:
    """The input of all outputs. ``name``: of the scene; ``notes``: markdown; ``chosen`` (F,): numbers of the frames that are
    present, of ``total`` frames of the whole run; ``simulated``: the motion is one under forces."""

    name: str
    title: str
    learning_goal: str
    notes: str
    version: str
    picture: Picture
    catalogue: Catalogue
    events: tuple[Event, ...]
    lanes: tuple[Lane, ...]
    drawings: Callable[[], Mapping[str, Drawing]]  # made on request
    chosen: Integers
    total: int
    simulated: bool
    bands: Callable[[], Bands] = Bands  # tolerance bands, computed on request; for a recording by a new run of its scene


def presentation_of(run: Run, begin: Callable[[str], None] = lambda _: None) -> Presentation:
    """Presentation of a run. ``begin`` is called with the name of each stage."""
    begin("solid meshes")
    solids = solids_of(run)
    begin("tables, arrows and events")
    picture = picture_of(run, solids)
    lanes, looks = find_lanes(run)
    frames = run.motion.frames
    return Presentation(
        name=run.scene.name,
        title=run.scene.title or run.scene.name,
        learning_goal=run.scene.learning_goal,
        notes=notes(run, solids, picture.scales, [*run.stages], picture_stride(run), complete=True),
        version=package_version(),
        picture=picture,
        catalogue=run.catalogue,
        events=events_of(run),
        lanes=tuple(Lane(name, tuple((t, *looks[state]) for t, state in changes)) for name, changes in sorted(lanes.items())),
        drawings=cache(lambda: drawings_of(run, solids.size)),
        chosen=np.arange(frames),
        total=frames,
        simulated=run.simulation is not None,
        bands=cache(lambda: bands_of(run)),
    )


def presentation_in(recording: Recording) -> Presentation:
    """Presentation of a recording, complete or interrupted."""
    numbers = recorded_numbers(recording)
    ticks, _ = recording.scalars("data", "links", numbers.frame, "pose")
    every = ticks if recording.frame_times is None else recording.frame_times
    properties = recording.parsed_properties
    head = recording.notes.partition("\n## ")[0]
    chosen = np.clip(np.searchsorted(every, ticks), 0, len(every) - 1)
    return Presentation(
        name=properties.scene or recording.path.stem,
        title=properties.title or properties.scene or recording.path.stem,
        # in the notes it stands between the title and the first section
        learning_goal=" ".join(line.strip() for line in head.splitlines() if line.strip() and not line.startswith(("#", "**"))),
        notes=recording.notes,
        version=properties.version,
        picture=picture_in(recording, numbers),
        catalogue=Catalogue(numbers),
        events=recording.events,
        lanes=tuple(_lanes_in(recording)),
        drawings=cache(RecordedDrawings(recording, ticks).drawings),
        chosen=chosen,
        total=len(every),
        simulated=properties.duration is not None,
        bands=cache(lambda: _bands_in(recording, numbers.time, chosen)),
    )


def _bands_in(recording: Recording, time: Real, chosen: Integers) -> Bands:
    """Tolerance bands at the frames of a recording, at times (F,) [s], from a new run of its scene if that has tolerances and a
    driven motion. No bands, with the reason, for a motion under forces, if the frames differ, or if the scene fails."""
    try:
        scene = recording.scene()
        if not with_tolerances(scene):
            return Bands()
        if scene.simulation is not None:
            return Bands(missing_reason="finding the motion under forces once more may take long")
        run = run_scene(scene)
    except (MechanismError, RecordingError) as error:
        return Bands(missing_reason=str(error))
    same = chosen[-1] < run.motion.frames and np.allclose(run.motion.time[chosen], time, rtol=1e-6, atol=1e-9 * run.motion.time[-1])
    if not same:
        return Bands(missing_reason="the scene's frames are not those of the recording")
    bands = bands_of(run)
    return replace(bands, halves={key: half[chosen] for key, half in bands.halves.items()})


def _lanes_in(recording: Recording) -> Iterator[Lane]:
    for path in recording.entities:
        parts = parts_of(path)
        if parts[0] != "state" or not recording.has(path):
            continue
        rows = recording.rows(path, component="StateChange:state")
        looks = {}
        known = [recording.static(path, component=f"StateConfiguration:{name}") for name in ("values", "labels", "colors")]
        for value, label, color in zip(*(part if part is not None else () for part in known), strict=True):
            looks[str(value)] = str(label), unpacked(color)
        states = [looks.get(str(v), (str(v), (136, 136, 136))) for v in rows.values]
        yield Lane(parts[-1], tuple((1e-9 * float(t), *state) for t, state in zip(rows.time, states, strict=True)))
