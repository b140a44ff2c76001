"""What the plots show: names of the series, and entities that exist only to be plotted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..tables import Table, joints_of
from ..vectors import point_name
from .paths import entity
from .streams import Index, Static, Stream

if TYPE_CHECKING:
    from ..run import Run

__all__ = ["Output", "main_outputs", "plot_streams", "plot_styles", "study_outputs"]

PALETTE = (
    (92, 172, 255),
    (255, 170, 64),
    (96, 214, 132),
    (255, 102, 114),
    (190, 140, 255),
    (244, 222, 92),
    (76, 218, 222),
    (255, 140, 204),
    (176, 190, 208),
    (198, 154, 112),
    (164, 200, 80),
    (140, 150, 255),
)
"""Colours of curves on a dark ground; neighbours differ in hue and lightness."""

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
    at_frame = [j for j in joints_of(run.motion) if mechanism.frame in j.links and j.name not in driven]
    sliders = [j.name for j in at_frame if j.unit == "m"][:MOST]
    points = [point_name(*p) for p in mechanism.traced][:MOST]
    rockers = [j.name for j in at_frame if j.unit == "rad"][:MOST]
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


def study_outputs(run: Run) -> list[Output]:
    """Plots of what a scene asks for beside motion and forces: reduced masses with their derivatives, shaking forces."""
    found = []
    for name, r in run.studies.reduced.items():
        what = "Reduced moment of inertia [kg m²]" if r.point is None else "Reduced mass [kg]"
        path = entity("data", "reduced", name)
        found.append(Output(f"{what}, {name}", ((path, (True, False, False, False)),)))
    if run.studies.shaking is not None:
        paths = [("data", "shaking"), *([("data", "shaking", "balanced")] if run.studies.balanced is not None else [])]
        found.append(Output("Shaking moment [N m]", tuple((entity(*p), (False, False, True)) for p in paths)))
    return found


def plot_streams(run: Run, every: int) -> Iterator[Stream]:
    """Magnitudes of all joint reactions, one series per joint, at every ``every``-th frame: the largest until the next one."""
    forces = run.forces
    if forces is None:
        return
    import rerun as rr

    sizes = np.column_stack([np.hypot(*forces.reaction(j.name)[:, :2].T) for j in joints_of(run.motion)])
    peaks = np.maximum.reduceat(sizes, np.arange(0, len(sizes), every), axis=0)

    def columns(frames: Index) -> Any:
        chosen = peaks[frames // every]
        return rr.Scalars.columns(scalars=chosen.reshape(-1)).partition(np.full(len(chosen), chosen.shape[1]))

    yield Stream(entity("plots", "reactions"), columns, every)


def plot_styles(run: Run, all_tables: list[Table]) -> Iterator[Static]:
    """Names, units and colours of all series, so that any of them can be dragged into a plot; spikes survive zooming out."""
    import rerun as rr

    def style(names: list[str], first: int) -> Any:
        colors = [PALETTE[(first + i) % len(PALETTE)] for i in range(len(names))]
        return rr.SeriesLines.from_fields(names=names, colors=colors, widths=[1.6] * len(names), aggregation_policy="MinMax")

    known: dict[tuple[str, ...], int] = {}  # how many of a kind came before: they may share a plot
    for table in all_tables:
        kind = (*table.path[:2], table.path[-1]) if table.path[0] == "data" else table.path[:1]
        first = known.get(kind, -1 if kind[1:2] == ("drive",) else 0)  # so that efforts are green, as their arrows are
        known[kind] = first + table.values.shape[1]
        yield Static(entity(*table.path), style([h.replace("^2", "²") for h in table.headers()], first))
    if run.forces is not None:
        yield Static(entity("plots", "reactions"), style([f"{j.name} [N]" for j in joints_of(run.motion)], 0))
