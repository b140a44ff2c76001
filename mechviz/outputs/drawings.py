"""Drawings beside the mechanism: graphical constructions, and diagrams of one quantity over another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.arrays import Complex, Real, Single
from mechcore.effects.machines import CylinderGas
from mechcore.records import dataclass
from mechcore.spec.clearance import auxiliary_names
from mechcore.spec.loads import GasPressure
from mechviz.outputs.rerun.entities import Static, Stream, archetype_columns, entity, line_strips, packed_colors
from mechviz.outputs.rerun.plots import CURVE_PALETTE
from mechviz.picture.centres import CENTRE_GROUPS
from mechviz.picture.constructions import Drawing
from mechviz.quantities.items import joint_unit, joints_of

if TYPE_CHECKING:
    from mechviz.runs import Run

# -- graphical constructions ------------------------------------------------------------------------------------------
OVERLAY_GROUPS = tuple(f"polygons/{group}" for group in ("funicular", "polodes", "substitutes", "equivalent", *CENTRE_GROUPS))
"""Entities that are drawn in the picture of the mechanism."""


def polygon_streams(drawings: dict[str, Drawing], every: int) -> Iterator[Stream]:
    """Streams of the constructions, which move; labels and colours are static."""
    import rerun as rr

    for name, drawing in drawings.items():
        path = entity("polygons", *name.split("/"))
        arrows = [i for i in drawing.arrows if not i.headless]
        if arrows:
            yield Stream(path, _arrows([(i.start, i.vector) for i in arrows]), every)
        lines = [i for i in drawing.arrows if i.headless]
        if lines:
            yield Stream(f"{path}/rays", _strips([np.stack([i.start, i.start + i.vector], axis=1) for i in lines]), every)
        if drawing.points:
            places = np.stack([m.position for m in drawing.points], axis=1)

            def points(frames: slice, places: Complex = places) -> Any:
                z = places[frames]
                return archetype_columns(rr.Points3D.from_fields(positions=_space(z.reshape(-1))), z.shape[1])

            yield Stream(f"{path}/points", points, every)


def polygon_shapes(drawings: dict[str, Drawing], size: float) -> Iterator[Static]:
    """Static archetypes of the constructions: their scales, colours, labels, and curves at rest."""
    import rerun as rr

    for name, drawing in drawings.items():
        path = entity("polygons", *name.split("/"))
        arrows, lines = [i for i in drawing.arrows if not i.headless], [i for i in drawing.arrows if i.headless]
        known = {"title": drawing.title, "unit": drawing.unit, "per_metre": float(drawing.per_metre)}
        yield Static(path, rr.AnyValues(**known, least=float(drawing.least), whole=drawing.whole))
        labels = [i.label for i in arrows]
        style = {
            "colors": [i.color for i in arrows],
            "labels": labels,
            "show_labels": True,
            "radii": [(0.003 if i.thin else 0.0055) * size for i in arrows],
        }
        if arrows:
            yield Static(path, rr.Arrows3D.from_fields(**style))
        if lines:
            style = {"colors": [i.color for i in lines], "labels": [i.label for i in lines], "show_labels": True}
            yield Static(f"{path}/rays", rr.LineStrips3D.from_fields(radii=[0.002 * size] * len(lines), **style))
        if drawing.points:
            marks = rr.Points3D.from_fields(
                colors=[(240, 240, 240)], radii=[0.009 * size], labels=[m.label for m in drawing.points], show_labels=True
            )
            yield Static(f"{path}/points", marks)
        if drawing.curves:
            curves = [_space(z) for _, z in drawing.curves]
            faded = [tuple(int(0.6 * c) for c in color) for color, _ in drawing.curves]
            yield Static(f"{path}/polar", rr.LineStrips3D(curves, colors=faded, radii=[0.0035 * size]))


def polygon_views(drawings: dict[str, Drawing], enlarged: float, background: tuple[int, ...]) -> list[Any]:
    """One view for every drawing, named by its title, which contains the scale."""
    import rerun.blueprint as rrb

    views = []
    aspect = 0.93 if len(drawings) == 1 else 1.9 if len(drawings) == 2 else 1.2  # approximate aspect ratio of a view
    for name, drawing in drawings.items():
        low, high = enlarged * drawing.bounds
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        away = 1.16 * max(half[1], half[0] / aspect, 1e-6) / np.tan(0.5 * np.radians(55.0))
        eye = rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=(float(middle[0]), float(middle[1]), float(away)),
            look_target=(float(middle[0]), float(middle[1]), 0.0),
            eye_up=(0.0, 1.0, 0.0),
        )
        views.append(
            rrb.Spatial3DView(
                origin="/",
                contents=[f"+ {entity('polygons', *name.split('/'))}/**"],
                name=drawing.title,
                background=list(background),
                line_grid=rrb.LineGrid3D(visible=False),
                eye_controls=eye,
            )
        )
    return views


def _space(z: Complex) -> Single:
    """Complex points x + iy (...) as (..., 3) with z = 0; coordinates that are not finite become 0."""
    out = np.zeros((*z.shape, 3), np.float32)
    for k, part in enumerate((z.real, z.imag)):
        out[..., k] = np.where(np.isfinite(part), part, 0.0)
    return out


def _arrows(items: list[tuple[Complex, Complex]]) -> Any:
    """A function that makes the columns of arrows (start, vector) for a slice of frames, the same number in every row."""
    import rerun as rr

    starts = np.stack([a for a, _ in items], axis=1)
    vectors = np.stack([v for _, v in items], axis=1)

    def columns(frames: slice) -> Any:
        a, v = starts[frames].reshape(-1), vectors[frames].reshape(-1)
        return archetype_columns(rr.Arrows3D.from_fields(origins=_space(a), vectors=_space(v)), starts.shape[1])

    return columns


def _strips(items: list[Complex]) -> Any:
    """A function that makes the columns of plane strips (F, points) for a slice of frames, the same number in every row."""
    import rerun as rr

    def columns(frames: slice) -> Any:
        rows = line_strips([_space(strip[frames]) for strip in items])
        return archetype_columns(rr.LineStrips3D.from_fields(strips=rows), len(items))

    return columns


# -- diagrams ---------------------------------------------------------------------------------------------------------
DRAWING_WIDTH, DRAWING_HEIGHT = 1.7, 1.0  # of the axes; views have about this aspect ratio
CURVE_MARGIN = 0.08  # around the curves, of their span
MOST_CURVES = 3  # curves in one diagram
MOST_CURVE_POINTS = 1500  # points of a curve
TICK_COUNT = 5
FRAME_COLOR, GRID_COLOR, ZERO_COLOR, TEXT_COLOR = (96, 104, 118), (48, 54, 66), (128, 136, 150), (206, 212, 222)


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve over the frames: ``x`` and ``y`` (F,)."""

    name: str
    x: Real
    y: Real


@dataclass(frozen=True, eq=False)
class Diagram:
    """Curves in one pair of axes. ``equal``: both axes have the same scale, and the origin is in the picture; ``turn``: x is
    periodic with this period, where curves are interrupted."""

    name: str
    title: str
    x_title: str
    y_title: str
    curves: tuple[Curve, ...]
    equal: bool = False
    turn: float | None = None

    @cached_property
    def ranges(self) -> tuple[float, float, float, float]:
        """Ranges of the axes: least and greatest x, least and greatest y."""
        x, y = (np.concatenate([getattr(c, k) for c in self.curves]) for k in ("x", "y"))
        known = np.isfinite(x) & np.isfinite(y)
        x, y = x[known], y[known]
        if self.equal:
            x, y = np.append(x, 0.0), np.append(y, 0.0)
        (x0, x1), (y0, y1) = _padded(x), _padded(y)
        if self.turn is not None:
            x0, x1 = 0.0, self.turn
        if self.equal:
            per = max((x1 - x0) / DRAWING_WIDTH, (y1 - y0) / DRAWING_HEIGHT)
            x0, x1 = 0.5 * (x0 + x1) - 0.5 * per * DRAWING_WIDTH, 0.5 * (x0 + x1) + 0.5 * per * DRAWING_WIDTH
            y0, y1 = 0.5 * (y0 + y1) - 0.5 * per * DRAWING_HEIGHT, 0.5 * (y0 + y1) + 0.5 * per * DRAWING_HEIGHT
        return float(x0), float(x1), float(y0), float(y1)

    def place(self, x: Real, y: Real) -> Single:
        """Points (n, 2) of the drawing, with y downwards as in rerun's 2D views."""
        x0, x1, y0, y1 = self.ranges
        across, up = (np.asarray(x, float) - x0) / (x1 - x0), (np.asarray(y, float) - y0) / (y1 - y0)
        return np.column_stack([DRAWING_WIDTH * across, -DRAWING_HEIGHT * up]).astype(np.float32)

    def pieces(self, curve: Curve) -> list[Single]:
        """A curve as strips, interrupted where it is not finite, and where a period of x ends."""
        stride = max(1, -(-len(curve.x) // MOST_CURVE_POINTS))
        x, y = curve.x[::stride], curve.y[::stride]
        if len(curve.x) % stride != 1 and stride > 1:
            x, y = np.append(x, curve.x[-1]), np.append(y, curve.y[-1])
        broken = ~(np.isfinite(x) & np.isfinite(y))
        cuts = broken[1:] | broken[:-1]
        if self.turn is not None:
            cuts |= np.abs(np.diff(x)) > 0.5 * self.turn
        runs = np.split(self.place(x, y), np.flatnonzero(cuts) + 1)
        return [run for run in runs if len(run) > 1 and np.isfinite(run).all()]


def find_diagrams(run: Run) -> list[Diagram]:
    """The diagrams of a run: indicator diagram, phase diagram, polar diagram of bearing forces, torque of all revolutions overlaid,
    as far as they apply."""
    return [d for d in (_indicator(run), _phase(run), _polar(run), _overlaid(run)) if d is not None]


def _indicator(run: Run) -> Diagram | None:
    """Absolute gas pressure in cylinders over the displacement of their pistons from top dead centre; None without cylinders."""
    motion = run.motion
    loads = [load for load in motion.mechanism.loads if isinstance(load, GasPressure)][:MOST_CURVES]
    if not loads or run.forces is None or run.simulation is not None:
        return None
    gases = [CylinderGas(load) for load in loads]
    (unit, factor), (upwards, scale) = (run.scene.units.display_unit(si) for si in ("m", "Pa"))
    curves = tuple(
        Curve(gas.name, factor * np.asarray(gas.displacement(motion)), scale * np.asarray(gas.pressure(motion))) for gas in gases
    )
    title = f"Indicator diagram: pressure [{upwards}] against displacement [{unit}]"
    title += f", {loads[0].name}" if len(loads) == 1 else ""
    return Diagram("indicator", title, f"displacement [{unit}]", f"[{upwards}]", curves)


def _phase(run: Run) -> Diagram | None:
    """Velocity over coordinate of joints that oscillate: of a motion under forces the free coordinates, otherwise outputs."""
    motion = run.motion
    made = auxiliary_names(run.scene.mechanism)
    free = [] if run.simulation is None else [d.joint for d in run.scene.mechanism.drives if d.joint not in made]
    names = free or _followers(run)
    swinging = [n for n in names if _swings(motion.coordinate(n)[:, 0])]
    if not swinging:
        return None
    unit = joint_unit(motion, swinging[0])
    chosen = [n for n in swinging if joint_unit(motion, n) == unit][:MOST_CURVES]
    what = "displacement" if unit == "m" else "angle"
    (across, factor), (upwards, rate) = (run.scene.units.display_unit(si) for si in (unit, f"{unit}/s"))
    curves = tuple(Curve(n, factor * motion.coordinate(n)[:, 0], rate * motion.coordinate(n)[:, 1]) for n in chosen)
    title = f"Phase: velocity [{upwards}] against {what} [{across}]" + (f", {chosen[0]}" if len(chosen) == 1 else "")
    return Diagram("phase", title, f"{what} [{across}]", f"[{upwards}]", curves)


def _followers(run: Run) -> list[str]:
    """Outputs of the mechanism: sliding joints at the frame without a drive, then rotating ones."""
    mechanism = run.motion.mechanism
    driven = {d.joint for d in mechanism.drives}
    free = [j for j in joints_of(run.motion) if mechanism.frame in j.links and j.name not in driven]
    return [j.name for unit in ("m", "rad") for j in free if j.unit == unit]


def _swings(values: Real) -> bool:
    """Whether a coordinate both increases and decreases."""
    steps = np.diff(values[np.isfinite(values)])
    least = 1e-9 * float(np.abs(steps).max(initial=0.0))
    return bool(np.any(steps > least) and np.any(steps < -least))


def _polar(run: Run) -> Diagram | None:
    """Polar diagram (y over x) of the largest forces that the frame exerts in its bearings; None without any."""
    if run.forces is None:
        return None
    frame = run.motion.mechanism.frame
    unit, factor = run.scene.units.display_unit("N")
    bearings = []
    for joint in joints_of(run.motion):
        if joint.kind != "revolute" or frame not in joint.links:
            continue
        force = run.forces.reaction(joint.name)[:, :2]
        force = factor * (force if joint.links[0] == frame else -force)
        bearings.append((float(np.max(np.hypot(*force.T), initial=0.0, where=np.isfinite(force[:, 0]))), joint.name, force))
    largest = sorted(bearings, key=lambda b: -b[0])[:MOST_CURVES]
    if not largest or largest[0][0] <= 0.0:
        return None
    curves = tuple(Curve(name, force[:, 0], force[:, 1]) for size, name, force in largest if size > 1e-6 * largest[0][0])
    title = f"Polar: bearing force Fy against Fx [{unit}]" + (f", {curves[0].name}" if len(curves) == 1 else "")
    return Diagram("bearing forces", title, f"Fx [{unit}]", f"Fy [{unit}]", curves, equal=True)


def _overlaid(run: Run) -> Diagram | None:
    """Torque of the first drive over its angle within a revolution, all revolutions overlaid. None without forces, for a sliding
    drive or one that reverses, and for at most one revolution."""
    motion = run.motion
    if run.forces is None or not motion.mechanism.drives:
        return None
    joint = motion.mechanism.drives[0].joint
    (unit, factor), (upwards, times) = (run.scene.units.display_unit(si) for si in ("rad", "N m"))
    angle, turn = factor * motion.coordinate(joint)[:, 0], 2.0 * np.pi * factor
    steps = np.diff(angle)
    onwards = np.all(steps >= 0.0) or np.all(steps <= 0.0)
    if joint_unit(motion, joint) != "rad" or np.ptp(angle) < 365.0 / 360.0 * turn or not onwards:
        return None
    curve = Curve(joint, np.mod(angle, turn), times * run.forces.effort(joint))
    title = f"Driving torque [{upwards}] against the angle of {joint} [{unit}], turns overlaid"
    return Diagram("torque over angle", title, f"drive angle [{unit}]", f"[{upwards}]", (curve,), turn=turn)


def diagram_shapes(diagrams: Sequence[Diagram]) -> Iterator[Static]:
    """Static archetypes of diagrams: axes, ticks, curves, and the look of the moving points."""
    import rerun as rr

    for d in diagrams:
        x0, x1, y0, y1 = d.ranges
        xs, ys = _ticks(d, x0, x1), round_ticks(y0, y1, TICK_COUNT)
        titles = {"title": d.title, "x_title": d.x_title, "y_title": d.y_title}
        known = rr.AnyValues(**titles, ranges=[x0, x1, y0, y1], equal=d.equal, turn=d.turn or 0.0)
        yield Static(entity("diagrams", d.name), known)
        lines = [d.place(np.array([v, v]), np.array([y0, y1])) for v in xs] + [
            d.place(np.array([x0, x1]), np.array([v, v])) for v in ys
        ]
        colors = [ZERO_COLOR if v == 0.0 else GRID_COLOR for v in (*xs, *ys)]
        box = d.place(np.array([x0, x1, x1, x0, x0]), np.array([y0, y0, y1, y1, y0]))
        thin = rr.Radius.ui_points(np.full(len(lines) + 1, 0.6))
        axes = rr.LineStrips2D([*lines, box], colors=packed_colors([*colors, FRAME_COLOR]), radii=thin, draw_order=1.0)
        yield Static(entity("diagrams", d.name, "axes"), axes)
        below, beside = np.array([0.0, 0.012]), np.array([-0.06, -0.035])  # where rerun writes a label under its point
        marks = [*(d.place(xs, np.full(len(xs), y0)) + below), *(d.place(np.full(len(ys), x0), ys) + beside)]
        words = [*(_words(v) for v in xs), *(_words(v) for v in ys), d.x_title, d.y_title]
        marks += [np.array([0.5 * DRAWING_WIDTH, 0.11]), np.array([0.0, -DRAWING_HEIGHT - 0.12])]
        ticks = rr.Points2D(
            marks, labels=words, show_labels=True, colors=[TEXT_COLOR], radii=rr.Radius.ui_points(0.01), draw_order=2.0
        )
        yield Static(entity("diagrams", d.name, "ticks"), ticks)
        for k, curve in enumerate(d.curves):
            pieces = d.pieces(curve)
            labels = [curve.name, *[""] * (len(pieces) - 1)] if len(d.curves) > 1 else [""] * len(pieces)
            if pieces:
                look = rr.LineStrips2D(
                    pieces,
                    colors=[CURVE_PALETTE[k]],
                    radii=rr.Radius.ui_points(1.3),
                    labels=labels,
                    show_labels=len(d.curves) > 1,
                    draw_order=3.0,
                )
                yield Static(entity("diagrams", d.name, "curves", curve.name), look)
        colors = [CURVE_PALETTE[k] for k in range(len(d.curves))]
        dots = rr.Points2D.from_fields(colors=colors, radii=rr.Radius.ui_points(5.0), draw_order=5.0)
        yield Static(entity("diagrams", d.name, "now"), dots)
        if d.equal:
            rays = rr.Arrows2D.from_fields(colors=colors, radii=rr.Radius.ui_points(1.2), draw_order=4.0)
            yield Static(entity("diagrams", d.name, "rays"), rays)


def diagram_streams(diagrams: Sequence[Diagram], every: int) -> Iterator[Stream]:
    """Streams of the points that move along the curves, and in polar diagrams of rays from the origin to them."""
    import rerun as rr

    for d in diagrams:
        dot_places = np.stack([d.place(c.x, c.y) for c in d.curves], axis=1)
        known = np.isfinite(dot_places).all(axis=2)

        def dots(frames: slice, dot_places: Any = dot_places, known: Any = known) -> Any:
            shown = known[frames]
            return archetype_columns(rr.Points2D.from_fields(positions=dot_places[frames][shown]), shown.sum(axis=1))

        yield Stream(entity("diagrams", d.name, "now"), dots, every)
        if d.equal:
            origin = d.place(np.zeros(1), np.zeros(1))[0]

            def rays(frames: slice, dot_places: Any = dot_places, known: Any = known, origin: Any = origin) -> Any:
                shown = known[frames]
                tips = dot_places[frames][shown]
                arrows = rr.Arrows2D.from_fields(origins=np.broadcast_to(origin, tips.shape), vectors=tips - origin)
                return archetype_columns(arrows, shown.sum(axis=1))

            yield Stream(entity("diagrams", d.name, "rays"), rays, every)


def diagram_views(diagrams: Sequence[Diagram], background: tuple[int, ...]) -> list[Any]:
    """A view for each diagram, named by its title, which contains quantities and units."""
    import rerun.blueprint as rrb

    return [
        rrb.Spatial2DView(
            origin=entity("diagrams", d.name),
            name=d.title,
            background=list(background),
            visual_bounds=rrb.VisualBounds2D(x_range=[-0.2, DRAWING_WIDTH + 0.08], y_range=[-DRAWING_HEIGHT - 0.2, 0.3]),
        )
        for d in diagrams
    ]


def round_ticks(low: float, high: float, count: int) -> Real:
    """Round values between two bounds, at most ``count`` steps of 1, 2 or 5 times a power of ten apart."""
    wanted = (high - low) / count
    decade = 10.0 ** np.floor(np.log10(wanted))
    step = decade * next(s for s in (1.0, 2.0, 5.0, 10.0) if s * decade >= wanted * (1.0 - 1e-9))
    numbers = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1.0)
    return np.asarray(numbers * step + 0.0, float)


def _ticks(d: Diagram, low: float, high: float) -> Real:
    return np.arange(0.0, 361.0, 90.0) if d.turn == 360.0 else round_ticks(low, high, TICK_COUNT)


def _words(value: float) -> str:
    """Text of a tick, with a true minus."""
    return f"{value:.4g}".replace("-", "−")


def _padded(values: Real) -> tuple[float, float]:
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    room = CURVE_MARGIN * (high - low)
    if room <= 1e-9 * max(abs(low), abs(high)):
        room = 0.1 * max(abs(low), abs(high)) or 1.0
    return low - room, high + room
