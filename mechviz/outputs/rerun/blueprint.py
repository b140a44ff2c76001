"""The default blueprint: the mechanism from the front, plots that follow from the scene, events, health and notes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache, partial
from itertools import product
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.arrays import Real
from mechcore.motion.events import Event
from mechviz.outputs.drawings import OVERLAY_GROUPS
from mechviz.outputs.rerun.entities import entity
from mechviz.outputs.rerun.plots import (
    PlotView,
    cam_plots,
    effort_plots,
    free_plots,
    health_plots,
    main_plots,
    mark_path,
    reaction_plots,
    study_plots,
)
from mechviz.picture.fixtures import looks_of
from mechviz.picture.overlays import HIDDEN_DIAGRAMS, SECTION_DIAGRAMS
from mechviz.picture.proportions import ANGLED, is_deep
from mechviz.quantities.items import joint_unit, links_with_mass
from mechviz.quantities.vectors import FORCE_FAMILIES, plotted_against

if TYPE_CHECKING:
    from mechviz.runs import Run


BACKGROUND_COLOR = (24, 28, 36, 255)
SECONDS_A_CYCLE = 5.0  # time of a cycle on the screen [s]
SHORTEST_SHOW, LONGEST_SHOW = 4.0, 20.0  # limits of the time on the screen of a motion under forces [s]
FIELD_OF_VIEW = np.radians(55.0)  # vertical field of view of rerun's camera
EYE_TILT = 0.06  # slope of the view from above the normal of the plane: layers are visible, vertical lines stay vertical
LEGEND_ROW = 0.085  # height of a line of a legend, of the plot's height
CONSTANT_RANGE = 1e-9  # curves that vary by less than this, relative to their size, are constant
LEGEND_WIDTH = 0.3  # width of a legend, of the plot's width
PICTURE_ASPECT = 1.5  # approximate width of the 3D view over its height


def make_blueprint(
    run: Run,
    bounds: Mapping[str, Real],
    events: Sequence[Event],
    polygons: Sequence[Any] = (),
    diagrams: Sequence[Any] = (),
    spans: Mapping[str, tuple[float, float]] = MappingProxyType({}),
) -> Any:
    """The blueprint of a run (`rerun.blueprint.Blueprint`).

    ``polygons``: views of graphical constructions; ``diagrams``: views of one quantity over another; ``spans``: ranges of the
    vertical axes of the plots with lines at events, see `spans_of_plots`. ``bounds``: boxes (2, 3) [m] around the mechanism and its
    arrows, of "forces" and of "motion".
    """
    import rerun.blueprint as rrb

    pictures = _pictures(run, bounds)
    mechanism = rrb.Tabs(*pictures, active_tab=0) if len(pictures) > 1 else pictures[0]
    plots = _plots(run, spans)
    below = _below(run, events)
    if diagrams and not polygons:  # beside the events, which do not need the whole width
        below = rrb.Horizontal(below, _stacked(list(diagrams)), column_shares=[1, 1])
    left = rrb.Vertical(mechanism, below, row_shares=[5, 3] if diagrams else [3, 1])
    if not (polygons or run.scene.document.marks):  # without marks the mechanism gets most of the space
        flat = [inner for p in plots for inner in (p.contents if isinstance(p, rrb.Tabs) else [p])]
        beside = [_stacked(flat)] if flat else []
        rest = rrb.Tabs(*_below(run, events).contents, *diagrams, active_tab=0)
        body = rrb.Horizontal(mechanism, rrb.Vertical(*beside, rest), column_shares=[3, 1])
    elif polygons:  # the drawings beside the mechanism, two in a column; plots and the other views in tabs
        flat = [inner for p in plots for inner in (p.contents if isinstance(p, rrb.Tabs) else [p])]
        views = [*_below(run, events).contents, *diagrams]
        pages = [*polygons, rrb.Tabs(*flat, active_tab=0)] if len(polygons) % 2 and len(polygons) > 1 and flat else [*polygons]
        low = rrb.Tabs(*(views if pages[-1] not in polygons else [*flat, *views]), active_tab=0)
        columns: list[Any] = [rrb.Vertical(mechanism, low, row_shares=[9, 4])]
        columns += [rrb.Vertical(*pages[i : i + 2]) for i in range(0, len(pages), 2)]
        body = rrb.Horizontal(*columns, column_shares=[10, *(9 if len(columns) == 2 else 8 for _ in columns[1:])])
    else:
        body = rrb.Horizontal(left, rrb.Vertical(*plots), column_shares=[3, 2]) if plots else left
    return rrb.Blueprint(
        body,
        rrb.TimePanel(
            state="collapsed",
            timeline=opening_timeline(run),
            play_state="playing",  # with "paused" the viewer does not loop
            **_pace(run),
            loop_mode="all",
        ),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.TopPanel(state="hidden"),
        collapse_panels=False,
    )


def opening_timeline(run: Run) -> str:
    """Name of the opening timeline: the coordinate of a drive that starts and stops, whose law is stated over it; otherwise
    time."""
    axis = plotted_against(run)
    return "time" if axis is None else {"rad": "drive_mdeg", "m": "drive_um"}[joint_unit(run.motion, axis)]


def _pace(run: Run) -> dict[str, float]:
    """Speed of the opening timeline: ``fps`` in ticks per second, or ``playback_speed`` in seconds of the run per second."""
    axis = plotted_against(run)
    if axis is None:
        return {"playback_speed": _playback_speed(run)}
    ticks = float(np.ptp(run.motion.coordinate(axis)[:, 0]))
    ticks = 1e3 * np.degrees(ticks) if joint_unit(run.motion, axis) == "rad" else 1e6 * ticks
    return {"fps": float(ticks) / SECONDS_A_CYCLE}


def _playback_speed(run: Run) -> float:
    """Seconds of the run per second on the screen."""
    if run.simulation is not None:  # in real time, unless that is too long or too short
        span = run.simulation.duration
        return float(np.clip(1.0, span / LONGEST_SHOW, span / SHORTEST_SHOW))
    cycle = run.motion.mechanism.cycle
    return cycle / SECONDS_A_CYCLE if cycle > 0 else 1.0


def _pictures(run: Run, bounds: Mapping[str, Real]) -> list[Any]:
    """3D views: with forces, with section diagrams, with velocities and accelerations, as far as they exist; else without
    arrows."""
    motion = ["vectors/velocity", "vectors/acceleration"]
    forces = [f"vectors/{family}" for family in FORCE_FAMILIES]
    undrawn = [entity("mechanism", "links", link, "mesh") for link, looks in looks_of(run).items() if "nothing" in looks]
    seen = partial(picture, undrawn=undrawn)
    views = []
    if run.forces is not None:
        views.append(seen("Mechanism with forces", [*forces, "legend/forces", "sections/bending_moment"], bounds["forces"]))
        if run.studies.sections:
            views += [seen(SECTION_DIAGRAMS[group].title, [f"sections/{group}"], bounds["forces"]) for group in HIDDEN_DIAGRAMS]
    if _has_points(run) and run.scene.document.marks:
        views.append(seen("Mechanism with velocities and accelerations", [*motion, "legend/motion"], bounds["motion"]))
    return views or [seen("Mechanism", [], bounds["motion"])]


def _has_points(run: Run) -> bool:
    return bool(run.motion.mechanism.traced or links_with_mass(run))


def picture(name: str, vectors: list[str], bounds: Real, undrawn: Sequence[str] = ()) -> Any:
    """A view of the mechanism with the entities ``vectors`` and without those ``undrawn``, on a box (2, 3) [m]."""
    import rerun.blueprint as rrb

    position, target = eye_on(bounds)
    return rrb.Spatial3DView(
        origin="/",
        contents=[
            "+ mechanism/**",
            *(f"+ {path}/**" for path in (*vectors, *OVERLAY_GROUPS)),
            "- polygons/funicular/forces/**",
            *(f"- {path}" for path in undrawn),
        ],
        name=name,
        background=list(BACKGROUND_COLOR),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=tuple(position), look_target=tuple(target), eye_up=(0.0, 1.0, 0.0)
        ),
    )


def eye_on(bounds: Real) -> tuple[Real, Real]:
    """Position and target of the camera [m] for a box (2, 3) [m]: from the front, or at an angle if the box is deep."""
    low, high = bounds
    middle = 0.5 * (low + high)
    half = 0.5 * (high - low)
    margin, slope = 1.1, np.tan(0.5 * FIELD_OF_VIEW)
    if is_deep(bounds):
        direction = np.array(ANGLED) / np.linalg.norm(ANGLED)
        right = np.cross([0.0, 1.0, 0.0], direction)
        right /= np.linalg.norm(right)
        corners = half * np.array(list(product((-1.0, 1.0), repeat=3)))
        across, up, near = np.abs(corners @ right), np.abs(corners @ np.cross(direction, right)), corners @ direction
        away = float(np.max(near + margin * np.maximum(up, across / PICTURE_ASPECT) / slope))
    else:
        direction = np.array([0.0, EYE_TILT, 1.0])
        away = margin * max(half[1], half[0] / PICTURE_ASPECT) / slope + half[2]
    return middle + away * direction / np.linalg.norm(direction), middle


def _stacks(run: Run) -> list[list[PlotView]]:
    """The plots beside the mechanism; plots of one stack become tabs."""
    stacks = [[output] for output in (*study_plots(run), *effort_plots(run), *free_plots(run))]
    stacks += [cam_plots(run)]
    stacks.append(reaction_plots(run))
    motion = main_plots(run)
    stacks += [[output] for output in motion] if run.forces is None else [motion]
    return [stack for stack in stacks if stack]


def _plots(run: Run, spans: Mapping[str, tuple[float, float]]) -> list[Any]:
    times = _axis_values(run)
    return [_stacked([_plot(output, times, spans.get(output.name)) for output in stack]) for stack in _stacks(run)]


def spans_of_plots(run: Run) -> dict[str, tuple[float, float]]:
    """Range of the vertical axis of every plot whose curves are known, by name of the plot."""
    times = _axis_values(run)
    spans = {}
    for output in (output for stack in _stacks(run) for output in stack):
        if output.values is not None:
            curves = output.values.shape[1]
            # the lines take a row in the legend of several curves
            calm = calm_range(output.values, output.least)
            spans[output.name] = calm or (
                _span(output.values) if curves == 1 else legend_place(times, output.values, curves + 1)[1]
            )
    return spans


def _span(values: Real) -> tuple[float, float]:
    """The range of an axis around a curve (F, 1)."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (-1.0, 1.0)
    room = 0.05 * (high - low) or 0.05 * abs(low) or 1.0
    return low - room, high + room


def _stacked(views: list[Any]) -> Any:
    import rerun.blueprint as rrb

    return rrb.Tabs(*views, active_tab=0) if len(views) > 1 else views[0]


def _axis_values(run: Run) -> Real:
    """Ticks of the opening timeline at the frames (F,)."""
    axis = plotted_against(run)
    return run.motion.time if axis is None else run.motion.coordinate(axis)[:, 0]


def _plot(output: PlotView, times: Real | None = None, marked: tuple[float, float] | None = None) -> Any:
    """A plot over the whole run (rerun's default is a window around the cursor). ``marked``: the range of its vertical axis, if it
    has lines at events."""
    import rerun as rr
    import rerun.blueprint as rrb

    overrides = {
        path: rr.SeriesLines.from_fields(visible_series=list(shown)).visualizer()
        for path, shown in output.entities
        if shown and not all(shown)
    }
    curves = 0 if output.values is None else output.values.shape[1]
    corner, span = rrb.Corner2D.RightTop, None
    if curves > 1 and times is not None and output.values is not None:
        name, span = legend_place(times, output.values, curves + (marked is not None))
        corner = rrb.Corner2D.auto(name)
    marks = [] if marked is None else [mark_path(output.name)]
    if output.values is not None:
        span = calm_range(output.values, output.least) or span
    span = marked or span
    return rrb.TimeSeriesView(
        origin="/",
        contents=[f"+ {path}" for path in (*(path for path, _ in output.entities), *marks)],
        name=output.name,
        overrides=overrides,
        axis_x=_whole_run(),
        axis_y=None if span is None else rrb.ScalarAxis(range=span),
        plot_legend=rrb.PlotLegend(corner=corner, visible=curves != 1 and not output.single),  # the view names a single curve
    )


@cache
def _whole_run() -> Any:
    """The horizontal axis of every plot."""
    import rerun as rr
    import rerun.blueprint as rrb

    return rrb.TimeAxis(view_range=rr.TimeRange(start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.infinite()))


def calm_range(values: Real, least: float) -> tuple[float, float] | None:
    """A range of the vertical axis for curves (F, n) that are constant, or all below ``least``, which otherwise would show
    round-off; None for other curves."""
    known = values[np.isfinite(values)]
    if not known.size:
        return None
    low, high = float(known.min()), float(known.max())
    size = max(abs(low), abs(high))
    if size <= least:
        return -1.0, 1.0
    return (low - 0.1 * size, high + 0.1 * size) if high - low <= CONSTANT_RANGE * size else None


def legend_place(times: Real, values: Real, lines: int | None = None) -> tuple[str, tuple[float, float]]:
    """The corner of a plot's legend and the range of its vertical axis: the least range in which the legend hides no curve.

    ``times`` (F,), ``values`` (F, n): the curves; ``lines``: number of lines of the legend, by default n.
    """
    known = np.isfinite(values)
    low = float(np.min(values, initial=np.inf, where=known))
    high = float(np.max(values, initial=-np.inf, where=known))
    if not low <= high:
        return "RightTop", (-1.0, 1.0)
    span = max(high - low, 1e-6 * max(abs(low), abs(high)), 1e-300)
    low, high = low - 0.05 * span, high + 0.05 * span
    part = min(0.04 + LEGEND_ROW * (lines or values.shape[1]), 0.6)  # height of the legend, of the plot's height
    along = (times - times[0]) / (float(np.ptp(times)) or 1.0)
    best: tuple[str, tuple[float, float]] | None = None
    for side, near in (("Right", np.abs(along - 1.0) <= LEGEND_WIDTH), ("Left", np.abs(along) <= LEGEND_WIDTH)):
        lowest = float(np.min(values[near], initial=high, where=known[near]))
        highest = float(np.max(values[near], initial=low, where=known[near]))
        for name, extent in (
            (f"{side}Top", (low, max(high, (highest - part * low) / (1.0 - part)))),
            (f"{side}Bottom", (min(low, (lowest - part * high) / (1.0 - part)), high)),
        ):
            if best is None or extent[1] - extent[0] < 0.999 * (best[1][1] - best[1][0]):
                best = name, extent
    assert best is not None
    return best


def _below(run: Run, events: Sequence[Event]) -> Any:
    """Events, health and notes in tabs."""
    import rerun.blueprint as rrb

    views: list[Any] = []
    if events:
        no_time = rrb.encodings.TimelineColumn("time", visible=False)  # the text contains the time
        columns = rrb.TextLogColumns(timeline_columns=[no_time], text_log_columns=["LogLevel", "Body"])
        views.append(rrb.TextLogView(origin="/events", name="Events", columns=columns))
    views += [_plot(output) for output in health_plots(run)]
    if run.forces is not None and run.simulation is None:
        views.append(_plot(PlotView("Energy [J]", ((entity("data", "energy"), ()),))))
    rubbing = run.forces is not None and run.forces.friction is not None
    if rubbing or (run.simulation is not None and (run.simulation.stops or run.simulation.separable_cams)):
        name = "States" if run.simulation is not None else "Friction: states"
        views.insert(1 if events else 0, rrb.StateTimelineView(origin="/state", name=name))
    if run.forces is not None and run.forces.friction is not None:
        losses = tuple((entity("data", "joints", p, "friction_loss"), ()) for p in run.forces.friction.joints)
        views.insert(1 if events else 0, _plot(PlotView("Friction losses [W]", losses)))
    views.append(rrb.TextDocumentView(origin="/notes", name="Notes"))
    return rrb.Tabs(*views, active_tab=0 if events else len(views) - 1)  # plots of health are close to zero: the notes tell more
