"""What the plots show: names of the series, and entities that exist only to be plotted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.spec import Prismatic

from ..tables import tables
from ..vectors import point_name
from .paths import entity
from .streams import Index, Static, Stream

if TYPE_CHECKING:
    from ..run import Run

__all__ = ["Output", "main_outputs", "plot_streams", "plot_styles"]

MOST = 3  # outputs in one plot


@dataclass(frozen=True)
class Output:
    """One quantity of the mechanism's main outputs: a view's name and the entities in it with the series shown of each."""

    name: str
    entities: tuple[tuple[str, tuple[bool, ...]], ...]


def main_outputs(run: Run) -> list[Output]:
    """Position, velocity and acceleration of what the mechanism moves: sliders at the frame, else traced points, else rockers."""
    mechanism = run.motion.mechanism
    driven = {d.pair for d in mechanism.drives}
    at_frame = [p for p in mechanism.pairs if mechanism.frame in p.links and p.name not in driven]
    sliders = [p.name for p in at_frame if isinstance(p, Prismatic)][:MOST]
    points = [point_name(*p) for p in mechanism.traced][:MOST]
    rockers = [p.name for p in at_frame if not isinstance(p, Prismatic)][:MOST]
    if sliders or not points:
        joints, unit, noun = (sliders, "m", "Slider") if sliders else (rockers, "rad", "Rocker")
        units = (unit, f"{unit}/s", f"{unit}/s²")
        kinds = ("displacement" if sliders else "angle", "velocity", "acceleration")
        paths = [entity("data", "joints", j, "motion") for j in joints]
        return [
            Output(f"{noun} {kind} [{u}]", tuple((p, tuple(i == k for i in range(3))) for p in paths))
            for k, (kind, u) in enumerate(zip(kinds, units, strict=True))
            if paths
        ]
    return [
        Output(f"Point {kind} [{u}]", tuple((entity("data", "points", p, kind), (True, True)) for p in points))
        for kind, u in (("position", "m"), ("velocity", "m/s"), ("acceleration", "m/s²"))
    ]


def plot_streams(run: Run, every: int) -> Iterator[Stream]:
    """Magnitudes of all joint reactions, one series per joint, at every ``every``-th frame: the largest until the next one."""
    forces = run.forces
    if forces is None:
        return
    import rerun as rr

    sizes = np.column_stack([np.hypot(*forces.reaction(p.name)[:, :2].T) for p in run.motion.mechanism.pairs])
    peaks = np.maximum.reduceat(sizes, np.arange(0, len(sizes), every), axis=0)

    def columns(frames: Index) -> Any:
        chosen = peaks[frames // every]
        return rr.Scalars.columns(scalars=chosen.reshape(-1)).partition(np.full(len(chosen), chosen.shape[1]))

    yield Stream(entity("plots", "reactions"), columns, every)


def plot_styles(run: Run) -> Iterator[Static]:
    """Names and units of all series, so that any of them can be dragged into a plot; spikes survive zooming out."""
    import rerun as rr

    for table in tables(run):
        names = [header.replace("^2", "²") for header in table.headers()]
        style = rr.SeriesLines.from_fields(names=names, aggregation_policy="MinMax")
        yield Static(entity(*table.path), style)
    if run.forces is not None:
        names = [f"{p.name} [N]" for p in run.motion.mechanism.pairs]
        yield Static(entity("plots", "reactions"), rr.SeriesLines.from_fields(names=names, aggregation_policy="MinMax"))
