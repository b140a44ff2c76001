"""Plots of a recording: additional series for plots, names and colours of series, lines at events, lanes of states."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.arrays import Real
from mechcore.forces.friction.events import friction_lanes
from mechcore.motion.events import Event
from mechcore.records import dataclass
from mechcore.spec.clearance import auxiliary_names, journals_of
from mechcore.spec.mechanism import CamJoint
from mechviz.outputs.rerun.entities import Static, Stream, Timelines, entity, packed_colors, scalar_rows
from mechviz.quantities.events import LaneState, lanes_of
from mechviz.quantities.items import ItemTable, JointInfo, joint_unit, joints_of
from mechviz.quantities.tables import rounding_of_efforts
from mechviz.quantities.vectors import point_name

if TYPE_CHECKING:
    import rerun as rr

    from mechviz.runs import Run

CURVE_PALETTE = (
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
"""Colours of curves on a dark background; neighbours differ in hue and lightness."""

HEALTH_UNITS = {"closure": "m", "velocity_closure": "m/s", "acceleration_closure": "m/s^2"}
"""Closure errors of the loops, of positions and derivatives, and their units."""

MOST_OUTPUTS = 3  # outputs in one plot
MOST_REACTIONS = 6  # joints in one plot


@dataclass(frozen=True, eq=False)
class PlotView:
    """A plot: name of its view, its entities with flags of the series shown of each (empty: all), and the curves ``values`` (F,
    n)."""

    name: str
    entities: tuple[tuple[str, tuple[bool, ...]], ...]
    values: Real | None = None
    single: bool = False  # one curve, named by the view
    least: float = 0.0  # if all curves are below this, they are round-off


@dataclass(frozen=True, eq=False)
class SeriesGroup:
    """Series that share a plot, in display units. They form an entity of their own, so that its legend names nothing else; or, if
    the display units are SI units, ``data`` are the entities, as in `PlotView`, that contain the same series."""

    path: tuple[str, ...]
    view: str  # name of the view
    names: tuple[str, ...]  # of the series
    values: Real  # (F, n)
    data: tuple[tuple[str, tuple[bool, ...]], ...] = ()
    single: bool = False  # as in `PlotView`
    least: float = 0.0  # as in `PlotView`

    @property
    def plot(self) -> PlotView:
        shown = self.data or ((entity(*self.path), ()),)
        return PlotView(self.view, shown, self.values, self.single and bool(self.data), self.least)


def main_plots(run: Run) -> list[PlotView]:
    """Plots of position, velocity and acceleration of the output: sliders at the frame, otherwise traced points, otherwise rotating
    joints at the frame."""
    names, points = _moved(run)
    if names:
        return [series.plot for series in _of_joints(run, names)]
    return [series.plot for series in _of_points(run, points)]


def _of_points(run: Run, points: list[tuple[str, str]]) -> list[SeriesGroup]:
    """Positions, velocities and accelerations of points."""
    gathered = []
    for k, (kind, letter, si) in enumerate((("position", "", "m"), ("velocity", "v", "m/s"), ("acceleration", "a", "m/s^2"))):
        if points:
            unit, factor = run.scene.units.display_unit(si)
            names = tuple(f"{point_name(*p)}.{letter}{axis} [{unit}]" for p in points for axis in "xy")
            values = factor * np.column_stack([run.motion.point(*p, k) for p in points])
            data = tuple((entity("data", "points", point_name(*p), kind), (True, True)) for p in points)
            gathered.append(
                SeriesGroup(("plots", kind), f"Point {kind} [{unit}]", names, values, data if k and factor == 1.0 else ())
            )
    return gathered


def study_plots(run: Run) -> list[PlotView]:
    """Plots of studies of a scene: reduced masses and moments of inertia, shaking moments."""
    return [series.plot for series in (*_reduced(run), *_shaking(run))]


def _reduced(run: Run) -> list[SeriesGroup]:
    """Reduced masses and moments of inertia."""
    gathered = []
    for name, r in run.studies.reduced.items():
        what, si = ("Reduced moment of inertia", "kg m^2") if r.point is None else ("Reduced mass", "kg")
        unit, factor = run.scene.units.display_unit(si)
        data = ((entity("data", "reduced", name), (True, False, False, False)),) if factor == 1.0 else ()
        view, values = f"{what} [{unit}], {name}", factor * r.mass[:, None]
        gathered.append(SeriesGroup(("plots", "reduced", name), view, (f"{name} [{unit}]",), values, data))
    return gathered


def _shaking(run: Run) -> list[SeriesGroup]:
    """The shaking moment, without and with counterweights."""
    before, after = run.studies.shaking, run.studies.balanced
    if before is None:
        return []
    both = [before] if after is None else [before, after]
    unit, factor = run.scene.units.display_unit("N m")
    data = ((entity("data", "shaking"), (False, False, True)),) if after is None and factor == 1.0 else ()
    names = (f"shaking moment [{unit}]", f"with counterweights [{unit}]")[: len(both)]
    values = factor * np.column_stack([s.moment for s in both])
    return [SeriesGroup(("plots", "shaking moment"), f"Shaking moment [{unit}]", names, values, data)]


def cam_plots(run: Run) -> list[PlotView]:
    """Plots of lift, pressure angle, contact force and Hertz pressure of the cams, and of graphical accelerations."""
    return [series.plot for series in (*_of_cams(run), *_drawn_laws(run))]


def _drawn_laws(run: Run) -> list[SeriesGroup]:
    """Accelerations of the lift from the graphical construction, together with the exact ones."""
    gathered = []
    rated = {p.name: p for p in run.motion.mechanism.joints if isinstance(p, CamJoint) and p.name in _cams(run)}
    for name in (n for n, p in rated.items() if p.drawn is not None):
        drawn, exact = (run.numbers.tables["data", "cams", name, table] for table in ("graphical", "lift"))
        unit, factor = run.scene.units.display_unit(exact.columns[2][1])
        both = (entity("data", "cams", name, "graphical"), (False, False, True, False, False, False))
        data = (both, (entity("data", "cams", name, "lift"), (False, False, True))) if factor == 1.0 else ()
        values = factor * np.column_stack([drawn.values[:, 2], exact.values[:, 2]])
        view = f"Acceleration of the lift, drawn and exact, {name}"
        gathered.append(SeriesGroup(("plots", "drawn", name), view, (f"drawn [{unit}]", f"exact [{unit}]"), values, data))
    return gathered


def _cams(run: Run) -> list[str]:
    """The names of the cams that are plotted, at most `MOST_OUTPUTS`."""
    return [r.name for r in run.motion.model.relations if r.kind == "cam"][:MOST_OUTPUTS]


def _of_cams(run: Run) -> list[SeriesGroup]:
    """Lift, pressure angle, contact force and Hertz pressure of the cams."""
    gathered, force = [], () if run.forces is None else (("contact", 2, "Contact force"),)
    for table, column, title in (("lift", 0, "Lift"), ("contact", 3, "Pressure angle"), *force, ("stress", 0, "Hertz pressure")):
        tables = {name: run.numbers.tables.get(("data", "cams", name, table)) for name in _cams(run)}
        display_unit = run.scene.units.display_unit
        curves = {name: (t.values[:, column], display_unit(t.columns[column][1])) for name, t in tables.items() if t is not None}
        if curves:
            units = {unit for _, (unit, _) in curves.values()}
            series = tuple(f"{name} [{unit}]" for name, (_, (unit, _)) in curves.items())
            values = np.column_stack([factor * value for value, (_, factor) in curves.values()])
            view = f"{title} [{units.pop()}]" if len(units) == 1 else title
            as_they_are = title == "Contact force" and all(factor == 1.0 for _, (_, factor) in curves.values())
            data = tuple((entity("data", "cams", n, table), tuple(i == column for i in range(6))) for n in curves)
            single = as_they_are and len(curves) == 1
            gathered.append(SeriesGroup(("plots", title.lower()), view, series, values, data if as_they_are else (), single))
    return gathered


def _moved(run: Run) -> tuple[list[JointInfo], list[tuple[str, str]]]:
    """The joints whose motion is plotted, or if there are none the points (link, point)."""
    mechanism = run.motion.mechanism
    driven = {d.joint for d in mechanism.drives}
    at_frame = [j for j in joints_of(run.motion) if mechanism.frame in j.links and j.name not in driven]
    sliders = [j for j in at_frame if j.unit == "m"][:MOST_OUTPUTS]
    points = list(mechanism.traced)[:MOST_OUTPUTS]
    if sliders or not points:
        return sliders or [j for j in at_frame if j.unit == "rad"][:MOST_OUTPUTS], []
    return [], points


def _of_joints(run: Run, joints: list[JointInfo]) -> list[SeriesGroup]:
    sliding = joints[0].unit == "m"
    motions = [run.motion.coordinate(j.name) for j in joints]
    angles = [values[np.isfinite(values[:, 0]), 0] for values in motions]
    turning = any(len(a) and np.ptp(a) > 2.0 * np.pi for a in angles)  # more than a rocker
    unit, noun, first = ("m", "Slider", "displacement") if sliding else ("rad", "Output" if turning else "Rocker", "angle")
    gathered = []
    for k, (kind, si) in enumerate(((first, unit), ("velocity", f"{unit}/s"), ("acceleration", f"{unit}/s²"))):
        u, factor = run.scene.units.display_unit(si)
        own = len(joints) == 1 and factor == 1.0  # the data themselves are plotted
        data = ((entity("data", "joints", joints[0].name, "motion"), tuple(i == k for i in range(3))),) if own else ()
        values = factor * np.column_stack([motion[:, k] for motion in motions])
        gathered.append(
            SeriesGroup(("plots", kind), f"{noun} {kind} [{u}]", tuple(f"{j.name} [{u}]" for j in joints), values, data)
        )
    return gathered


def effort_plots(run: Run) -> list[PlotView]:
    """Driving torques and driving forces, in separate plots."""
    return [series.plot for series in _efforts(run)]


def _efforts(run: Run) -> list[SeriesGroup]:
    forces = run.forces
    if forces is None:
        return []
    efforts = []
    for unit, path, name, si in (("rad", "torque", "Driving torque", "N m"), ("m", "force", "Driving force", "N")):
        joints = [d.joint for d in run.motion.mechanism.drives if joint_unit(run.motion, d.joint) == unit]
        if joints:
            u, factor = run.scene.units.display_unit(si)
            values = factor * np.column_stack([forces.effort(p) for p in joints])
            own = len(joints) == 1 and factor == 1.0
            data = ((entity("data", "drive", joints[0]), (False, False, False, True, False)),) if own else ()
            series = tuple(f"{p} [{u}]" for p in joints)
            least = factor * rounding_of_efforts(run, unit)
            efforts.append(SeriesGroup(("plots", path), f"{name} [{u}]", series, values, data, least=least))
    return efforts


def free_plots(run: Run) -> list[PlotView]:
    """Plots of a motion under forces: speeds of the free coordinates, angular and linear separately, gaps of joints with clearance,
    and the energy."""
    if run.simulation is None or run.forces is None:
        return []
    speeds = [series.plot for series in _speeds(run)]
    gaps = [series.plot for series in _gaps(run)]
    return [*speeds, *gaps, PlotView("Energy [J]", ((entity("data", "energy"), ()),), run.forces.energy)]


def _speeds(run: Run) -> list[SeriesGroup]:
    if run.simulation is None:
        return []
    speeds = []
    prescribed = {d.joint for d in run.motion.mechanism.drives} | auxiliary_names(run.scene.mechanism)
    joints = [d.joint for d in run.scene.mechanism.drives if d.joint not in prescribed]
    for unit, path in (("rad", "angular speed"), ("m", "speed")):
        some = [p for p in joints if joint_unit(run.motion, p) == unit]
        if some:
            u, factor = run.scene.units.display_unit(f"{unit}/s")
            rates = factor * np.column_stack([run.motion.coordinate(p)[:, 1] for p in some])
            own = len(some) == 1 and factor == 1.0
            data = ((entity("data", "joints", some[0], "motion"), (False, True, False)),) if own else ()
            speeds.append(SeriesGroup(("plots", path), f"Speed [{u}]", tuple(f"{p} [{u}]" for p in some), rates, data))
    return speeds


def _gaps(run: Run) -> list[SeriesGroup]:
    """Gaps between journal and bearing of joints with clearance."""
    journals = journals_of(run.scene.mechanism)
    if not journals:
        return []
    apart = [j.radial - np.hypot(*(run.motion.coordinate(s)[:, 0] for s in j.slides)) for j in journals.values()]
    unit, factor = run.scene.units.display_unit("m")
    names = tuple(f"{p} [{unit}]" for p in journals)
    return [SeriesGroup(("plots", "gap"), f"Gap in the bearing [{unit}]", names, factor * np.column_stack(apart))]


def reaction_plots(run: Run) -> list[PlotView]:
    """Plots of the magnitudes of the joint reactions, at most `MOST_REACTIONS` in a plot."""
    names = [j.name for j in joints_of(run.motion)]
    if run.forces is None or not names:
        return []
    sizes, (unit, _) = _reactions(run), run.scene.units.display_unit("N")
    parts = [range(k, min(k + MOST_REACTIONS, len(names))) for k in range(0, len(names), MOST_REACTIONS)]
    return [
        PlotView(
            f"Joint reactions, magnitude [{unit}]"
            if len(parts) == 1
            else f"Reactions {names[part[0]]} … {names[part[-1]]} [{unit}]",
            ((entity("plots", "reactions", str(number)), ()),),
            sizes[:, list(part)],
        )
        for number, part in enumerate(parts)
    ]


def _reactions(run: Run) -> Real:
    assert run.forces is not None
    _, factor = run.scene.units.display_unit("N")
    return factor * np.column_stack([np.hypot(*run.forces.reaction(j.name)[:, :2].T) for j in joints_of(run.motion)])


def health_plots(run: Run) -> list[PlotView]:
    """Plots of closure errors and the other quantities that show whether a run can be trusted."""
    outputs = [_closures(run).plot, PlotView("Health: condition [1]", ((entity("health", "condition"), ()),))]
    if run.forces is not None:
        outputs.append(PlotView("Health: power balance [1]", ((entity("health", "power_balance"), ()),)))
    if run.simulation is not None:
        outputs.append(PlotView("Health: energy drift [1]", ((entity("health", "energy_drift"), ()),)))
    return outputs


def _closures(run: Run) -> SeriesGroup:
    reads = {name: run.scene.units.display_unit(si, small=True) for name, si in HEALTH_UNITS.items()}
    units, factors = zip(*reads.values(), strict=True)
    values = np.column_stack([run.numbers.tables["health", name].values for name in HEALTH_UNITS]) * factors
    data = tuple((entity("health", name), ()) for name in HEALTH_UNITS) if set(factors) == {1.0} else ()
    names = tuple(f"{name.replace('_', ' ')} [{unit}]" for name, unit in zip(HEALTH_UNITS, units, strict=True))
    return SeriesGroup(("plots", "closure"), f"Health: closure [{', '.join(units)}]", names, values, data)


def plot_streams(run: Run, every: int) -> Iterator[Stream]:
    """Streams of additional series for plots, at every ``every``-th frame; for reactions the maximum until the next row."""

    def stream(path: str, values: Real) -> Stream:
        def columns(frames: slice) -> Any:
            return scalar_rows(values, slice(frames.start // every, -(-frames.stop // every), frames.step // every))

        return Stream(path, columns, every)

    for series in _gathered(run):
        yield stream(entity(*series.path), np.ascontiguousarray(series.values[::every]))
    for output in reaction_plots(run):
        assert output.values is not None
        peaks = np.maximum.reduceat(output.values, np.arange(0, len(output.values), every), axis=0)
        yield stream(output.entities[0][0], peaks)


def _gathered(run: Run) -> list[SeriesGroup]:
    joints, points = _moved(run)
    moved = _of_joints(run, joints) if joints else _of_points(run, points)
    cams = (*_of_cams(run), *_drawn_laws(run))
    every = [*moved, *cams, *_efforts(run), *_speeds(run), *_gaps(run), *_reduced(run), *_shaking(run), _closures(run)]
    return [g for g in every if not g.data]


def plot_styles(run: Run, all_tables: list[ItemTable]) -> Iterator[Static]:
    """Names, units and colours of all series, so that any of them can be dragged into a plot; aggregation keeps spikes visible."""
    import rerun as rr

    def style(names: list[str], first: int) -> Any:
        colors = palette[(first + np.arange(len(names))) % len(palette)]
        widths = np.full(len(names), 1.6, np.float32)
        return rr.SeriesLines.from_fields(names=names, colors=colors, widths=widths, aggregation_policy="MinMax")

    palette = packed_colors(CURVE_PALETTE)

    known: dict[tuple[str, ...], int] = {}  # number of earlier series of a kind, which may share a plot
    for table in all_tables:
        kind = (*table.path[:2], table.path[-1]) if table.path[0] == "data" else table.path[:1]
        first = known.get(kind, -1 if kind[1:2] == ("drive",) else 0)  # so that efforts are green like their arrows
        known[kind] = first + len(table.columns)
        yield Static(entity(*table.path), style([h.replace("^2", "²") for h in table.headers()], first))
    for series in _gathered(run):
        effort = series.path[-1] in ("torque", "force")  # green first, like the arrows
        yield Static(entity(*series.path), style(list(series.names), 2 if effort else 0))
    names = [f"{j.name} [{run.scene.units.display_unit('N')[0]}]" for j in joints_of(run.motion)]
    for output in reaction_plots(run):
        assert output.values is not None
        count = output.values.shape[1]
        yield Static(output.entities[0][0], style(names[:count], 0))
        names = names[count:]


# -- lines at events --------------------------------------------------------------------------------------------------
MOST_MARKS = 16  # more lines would hide the curves
EVENT_COLOR = (118, 126, 140)


def mark_times(events: Sequence[Event]) -> Real:
    """Times [s] of the lines at events in plots; none if there are more than `MOST_MARKS`."""
    times = np.unique([e.time for e in events])
    return times if len(times) <= MOST_MARKS else times[:0]


def mark_path(view: str) -> str:
    """The entity of the lines at events in a plot."""
    return entity("plots", "events", view)


def send_marks(stream: rr.RecordingStream, timelines: Timelines, times: Real, spans: Mapping[str, tuple[float, float]]) -> None:
    """Send lines at times [s] for each plot, by name, over the range of its vertical axis."""
    import rerun as rr

    if not len(times):
        return
    columns = timelines.columns_at(np.repeat(times, 3))
    look = rr.SeriesLines.from_fields(names=["events"], colors=[EVENT_COLOR], widths=[1.0], aggregation_policy="Off")
    for view, (low, high) in spans.items():
        stream.log(mark_path(view), look, static=True)
        rows = np.tile([low, high, np.nan], len(times))  # NaN separates the lines
        stream.send_columns(mark_path(view), columns, rr.Scalars.columns(scalars=rows))


# -- lanes of states --------------------------------------------------------------------------------------------------
STATE_LOOKS: Mapping[str, tuple[str, tuple[int, int, int]]] = {
    "slips +": ("slips +", (84, 168, 255)),
    "slips -": ("slips −", (60, 110, 180)),
    "at rest": ("at rest", (120, 126, 136)),
    "moves": ("moves", (72, 160, 110)),
    "self-locking": ("self-locking", (240, 190, 60)),
    "jammed": ("jammed", (230, 60, 60)),
}
"""States of the lanes of friction, with their labels and colours."""

LANE_LOOKS: Mapping[str, tuple[str, tuple[int, int, int]]] = {
    LaneState.STICKS: ("sticks", (230, 140, 60)),
    LaneState.SLIPS_FORWARD: ("slips +", (84, 168, 255)),
    LaneState.SLIPS_BACK: ("slips −", (60, 110, 180)),
    LaneState.FREE: ("free", (72, 160, 110)),
    LaneState.CONTACT: ("rests on the stop", (230, 60, 60)),
    LaneState.TOUCHES: ("follower in contact", (72, 160, 110)),
    LaneState.FLIES: ("contact lost", (230, 60, 60)),
}
"""States of the lanes of a simulation, with their labels and colours."""


def find_lanes(run: Run) -> tuple[Mapping[str, Sequence[tuple[float, str]]], Mapping[str, tuple[str, tuple[int, int, int]]]]:
    """Changes of state (time [s], state) by lane, and labels and colours of the states. Lanes of a driven motion: joints with
    friction and the mechanism (slips, at rest, jammed); of a motion under forces: joints, stops and cams."""
    if run.simulation is not None:
        return lanes_of(run.simulation), LANE_LOOKS
    return ({} if run.forces is None else friction_lanes(run.forces)), STATE_LOOKS


def lane_styles(run: Run) -> Iterator[Static]:
    """Labels and colours of the lanes."""
    import rerun as rr

    lanes, looks = find_lanes(run)
    labels, colors = (list(part) for part in zip(*looks.values(), strict=True))
    values = [str(state) for state in looks]
    for name in lanes:
        yield Static(entity("state", name), rr.StateConfiguration(values=values, labels=labels, colors=colors))


def send_lanes(stream: rr.RecordingStream, timelines: Timelines, run: Run) -> None:
    """Send the lanes, one row for every change of state."""
    import rerun as rr

    for name, changes in find_lanes(run)[0].items():
        times = np.array([t for t, _ in changes])
        stream.send_columns(
            entity("state", name), timelines.columns_at(times), rr.StateChange.columns(state=[str(s) for _, s in changes])
        )
