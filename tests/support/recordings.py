"""Recordings that tests read back: made once a session, looked at through the file alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from covering import covering
from numpy.typing import NDArray

import mechviz
from mechcore.motion.solve import default_times, solve_motion
from mechcore.spec.clearance import with_ideal_joints
from mechcore.spec.mechanism import Mechanism
from mechviz.meshes.solids import Solids
from mechviz.outputs.presentation import Presentation, presentation_in
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import RecordingSummary, write_recording
from mechviz.picture.arrows import arrows_of
from mechviz.picture.build import solids_of
from mechviz.quantities.vectors import Moment, Scales, Vector
from mechviz.runs import Run, run_scene
from mechviz.scene.scene import Scene

NAMES = [entry.name for entry in mechviz.gallery()]
COVERING = covering(NAMES)
FOLDER = TemporaryDirectory(prefix="mechviz-")  # goes when Python ends
FRAMES = 120  # a run


@dataclass(frozen=True, eq=False)
class Made:
    """A run, and the file that was written from it."""

    run: Run
    summary: RecordingSummary
    recording: Recording
    solids: Solids

    @property
    def path(self) -> Path:
        return self.summary.path

    @cached_property
    def mechanism(self) -> Mechanism:
        """The mechanism as the scene in the file describes it; joints with clearance are drawn as ideal ones."""
        return with_ideal_joints(self.recording.scene().mechanism)

    @cached_property
    def shown(self) -> Presentation:
        """What outputs are made from, read from the file."""
        return presentation_in(self.recording)

    def data(self, *parts: str) -> NDArray[np.float64]:
        """Values (F, n) under /data."""
        return self.recording.scalars("data", *parts)[1]

    @property
    def time(self) -> NDArray[np.float64]:
        """Times of the frames [s]: evenly spaced, which the file holds rounded to nanoseconds."""
        ns = self.recording.scalars("health", "closure")[0]
        even = np.linspace(ns[0], ns[-1], len(ns))
        assert abs(even - ns).max() <= 1.0
        return 1e-9 * even


@cache
def gallery_scene(name: str) -> Scene:
    """A gallery scene."""
    return mechviz.load(name)


def ran(name: str, frames: int = FRAMES) -> Run:
    """A gallery scene, run."""
    return _ran(name, frames)


@cache  # which would take a number of frames that is left out for another one than the same number stated
def _ran(name: str, frames: int) -> Run:
    return run_scene(gallery_scene(name), frames=frames)


def motion_of(name: str, frames: int) -> Any:
    """The motion of a gallery scene at other frames; where forces decide it, it is found once."""
    run = ran(name)
    if run.simulation is not None:
        return run.simulation.view(np.linspace(0.0, run.simulation.duration, frames + 1))
    return solve_motion(run.compiled, default_times(run.scene.mechanism, frames, run.scene.cycles))


@cache
def solids(name: str) -> Solids:
    """The solids of a gallery scene as it is recorded."""
    return solids_of(ran(name))


def made(name: str, frames: int = FRAMES) -> Made:
    """A gallery scene, recorded."""
    return _made(name, frames)


@cache
def _made(name: str, frames: int) -> Made:
    run = ran(name, frames)
    path = Path(FOLDER.name) / f"{name}-{frames}.rrd"
    shapes = solids(name) if frames == FRAMES else solids_of(run)
    summary = write_recording(run, path, solids=shapes)
    return Made(run, summary, Recording(path), shapes)


def vectors_of(run: Run, size: float = 1.0) -> tuple[dict[str, dict[str, Vector]], dict[str, dict[str, Moment]], Scales]:
    """Vectors and moments that are drawn of a run, by family and item, and their scales in a mechanism of a size [m]."""
    arrows = arrows_of(run, size)
    vectors: dict[str, dict[str, Vector]] = {}
    moments: dict[str, dict[str, Moment]] = {}
    for vector in arrows.vectors:
        vectors.setdefault(vector.family, {})[vector.item] = vector
    for moment in arrows.moments:
        moments.setdefault(moment.family, {})[moment.item] = moment
    return vectors, moments, arrows.scales


def place(pose: NDArray[np.float64], point: tuple[float, float]) -> NDArray[np.float64]:
    """World positions (F, 2) of a point given in link axes, from poses (F, 3)."""
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    return pose[:, :2] + np.column_stack([c * point[0] - s * point[1], s * point[0] + c * point[1]])


def size_of(mechanism: Mechanism) -> float:
    """The widest link [m]."""
    return float(max(np.ptp([*link.points.values()], axis=0).max() for link in mechanism.links))


def points_of(mechanism: Mechanism) -> Mapping[str, Mapping[str, tuple[float, float]]]:
    return {link.name: link.points for link in mechanism.links}
