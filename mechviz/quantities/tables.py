"""The numerical results of a run as named tables in SI units, which recordings hold (float64) and CSV and Parquet files export."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.arrays import Real
from mechcore.forces.cam_rating import (
    AnyCam,
    carrying,
    contact_force,
    contact_stress,
    drawn_lift,
    drawn_rows,
    joint_of,
    placed_cams,
)
from mechcore.forces.instants import energies
from mechcore.forces.kinetostatics import Forces, LoadResult
from mechcore.forces.powers import power_labels, powers_by_label
from mechcore.forces.section_forces import bearing_ends, bearings
from mechcore.motion import metrics
from mechcore.motion.motion import Motion
from mechcore.spec.clearance import journals_of
from mechcore.spec.loads import Servo
from mechviz.quantities.items import (
    ERROR_COLUMNS,
    ColumnUnits,
    ItemTable,
    JointInfo,
    joint_unit,
    joints_of,
    links_of,
    links_with_mass,
)
from mechviz.quantities.study_tables import study_tables
from mechviz.quantities.vectors import centre_name, point_name

if TYPE_CHECKING:
    from mechcore.spec.mechanism import CamRating
    from mechviz.runs import Run

_POSE: ColumnUnits = (("x", "m"), ("y", "m"), ("angle", "rad"))
_VELOCITY: ColumnUnits = (("vx", "m/s"), ("vy", "m/s"), ("omega", "rad/s"))
_ACCELERATION: ColumnUnits = (("ax", "m/s^2"), ("ay", "m/s^2"), ("alpha", "rad/s^2"))
_WRENCH: ColumnUnits = (("Fx", "N"), ("Fy", "N"), ("moment", "N m"))


ROUND_OFF = 1e-12  # relative to the largest reaction


def rounding_of_efforts(run: Run, unit: str) -> float:
    """Bound below which driving forces [N] (``unit`` "m") or torques [N m] are rounding, relative to the reactions of the run."""
    if run.forces is None:
        return 0.0
    largest = max(
        (float(np.nanmax(np.abs(run.forces.reaction(j.name)[:, :2]), initial=0.0)) for j in joints_of(run.motion)), default=0.0
    )
    return ROUND_OFF * largest * (1.0 if unit == "m" else run.motion.model.length_scale)


MOST_KEPT = 2**23
"""Number of values of a run (64 MiB) above which tables that follow directly from motion and forces are not kept in memory."""


def tables(run: Run) -> list[ItemTable]:
    """All tables of a run. Results that the scene does not need have no table."""
    quick = [*_links(run), *_points(run), *_joints(run), *_loads(run)]
    if run.motion.frames * sum(len(t.columns) for t in quick) > MOST_KEPT and len(run.motion.parts) == 1:
        quick = [replace(t, cached=False) for t in quick]
    return [*quick, *_cams(run), *_drives(run), *_servos(run), *_powers(run), *_metrics(run), *_health(run), *study_tables(run)]


def _links(run: Run) -> Iterator[ItemTable]:
    motion = run.motion
    inertia = run.forces is not None and "inertia" in motion.mechanism.effects
    heavy = links_with_mass(run)
    for name in links_of(motion):
        path = ("data", "links", name)
        yield ItemTable((*path, "pose"), name, _POSE, partial(motion.pose, name))
        yield ItemTable((*path, "velocity"), name, _VELOCITY, partial(motion.velocity, name))
        yield ItemTable((*path, "acceleration"), name, _ACCELERATION, partial(motion.acceleration, name))
        if inertia and name in heavy and run.forces is not None:
            yield ItemTable((*path, "inertia"), f"{name}.inertia", _WRENCH, partial(run.forces.inertia, name))


def _points(run: Run) -> Iterator[ItemTable]:
    motion = run.motion
    places: list[tuple[str, Callable[[int], Real]]] = [
        (point_name(*traced), partial(motion.point, *traced)) for traced in motion.mechanism.traced
    ]
    places += [(centre_name(link), partial(motion.centre_of_mass, link)) for link in links_with_mass(run)]
    kinds = (("position", _POSE), ("velocity", _VELOCITY), ("acceleration", _ACCELERATION))
    for name, place in places:
        for order, (kind, columns) in enumerate(kinds):
            yield ItemTable(("data", "points", name, kind), name, columns[:2], partial(place, order))


def _joints(run: Run) -> Iterator[ItemTable]:
    motion, forces = run.motion, run.forces
    onto = onto_centres(run, links_with_mass(run))
    guides = {joint.name: joint for joint in bearings(motion.mechanism)}
    for joint in joints_of(motion):
        path, name, unit = ("data", "joints", joint.name), joint.name, joint.unit
        what = "slide" if unit == "m" else "angle"
        rates: ColumnUnits = ((what, unit), (f"{what}_rate", f"{unit}/s"), (f"{what}_acceleration", f"{unit}/s^2"))
        yield ItemTable((*path, "motion"), f"{name}.motion", rates, partial(motion.coordinate, name))
        place = motion.joint_position if forces is None else forces.position
        yield ItemTable((*path, "position"), f"{name}.position", _POSE[:2], partial(_placed, onto, joint, place))
        if forces is not None:
            columns: ColumnUnits = (*_WRENCH[:2], ("couple", "N m"))
            reaction = partial(_reaction, forces, name)
            yield ItemTable((*path, "reaction"), f"{name}.reaction", columns, reaction)
            if name in guides:
                both: ColumnUnits = (("bearing force behind", "N"), ("bearing force ahead", "N"))
                yield ItemTable((*path, "bearing"), f"{name}.bearing", both, partial(bearing_ends, forces, guides[name]))
            if name in journals_of(motion.model.mechanism):
                yield _journal(run, name)
            if forces.friction is not None and name in forces.friction.joints:
                yield ItemTable((*path, "friction"), f"{name}.friction", columns, partial(forces.friction.wrench, name))
                loss = partial(_column, forces.friction.losses, name)
                yield ItemTable((*path, "friction_loss"), f"{name}.friction", (("loss", "W"),), loss)


def _placed(onto: Any, joint: JointInfo, place: Callable[[str], Real]) -> Real:
    placed: Real = onto(joint.links, place(joint.name))
    return placed


def _reaction(forces: Forces, joint: str) -> Real:
    return without_noise(forces.reaction(joint), forces.motion.model.length_scale)


def _column(values: Callable[[str], Real], name: str) -> Real:
    """Values (F,) of an item as a column (F, 1)."""
    return values(name)[:, None]


def _as_column(values: Callable[[], Real]) -> Real:
    return np.reshape(values(), (-1, 1))


def _journal(run: Run, joint: str) -> ItemTable:
    """Table of the journal's position in its bearing, in the axes of the bearing's link, and of the gap between both (negative:
    penetration)."""
    load = journals_of(run.motion.model.mechanism)[joint]
    x, y = (run.motion.coordinate(name)[:, 0] for name in load.slides)
    columns: ColumnUnits = (("x", "m"), ("y", "m"), ("gap", "m"))
    values = np.column_stack([x, y, load.radial - np.hypot(x, y)])
    return ItemTable(("data", "joints", joint, "journal"), f"{joint}.journal", columns, values)


def _cams(run: Run) -> Iterator[ItemTable]:
    motion = run.motion
    if not any(r.geometry is not None for r in motion.model.relations):
        return
    for cam in placed_cams(motion):
        columns: ColumnUnits = (
            ("x", "m"), ("y", "m"), ("force", "N"), ("pressure_angle", "rad"), ("curvature_radius", "m"), ("eccentricity", "m")
        )  # fmt: skip
        rows = cache(partial(_contact, run, cam))
        contact = partial(_some_columns, rows, slice(0, 6))
        yield ItemTable(("data", "cams", cam.name, "contact"), f"{cam.name}.contact", columns, contact)
        if run.forces is not None:
            normal: ColumnUnits = (("contact_normal_force", "N"),)
            pressing = partial(_as_column, partial(contact_force, run.forces, cam))
            yield ItemTable(("data", "cams", cam.name, "normal"), f"{cam.name}.normal", normal, pressing)
        unit = "m" if cam.arm == 0.0 else "rad"
        per = "m" if cam.bed else "rad"
        lifts: ColumnUnits = (("lift", unit), ("lift_rate", f"{unit}/{per}"), ("lift_acceleration", f"{unit}/{per}^2"))
        if run.simulation is not None and any(each.joint == cam.name for each in run.simulation.separable_cams):
            joined: Any = motion  # of a motion under forces
            gap = run.simulation.gap(cam.name, joined)
            yield ItemTable(("data", "cams", cam.name, "gap"), cam.name, (("gap", unit),), gap[:, None])
        yield ItemTable(("data", "cams", cam.name, "lift"), cam.name, lifts, partial(_some_columns, rows, slice(6, 9)))
        yield from _rated(run, cam, lifts)


def _some_columns(rows: Callable[[], Real], columns: slice) -> Real:
    return rows()[:, columns]


def _contact(run: Run, cam: AnyCam) -> Real:
    """Contact of a cam (F, 9): place x, y [m], force [N], pressure angle [rad], radius of curvature [m], eccentricity [m], lift and
    its two derivatives with respect to the cam's argument."""
    force = np.full(run.motion.frames, np.nan) if run.forces is None else contact_force(run.forces, cam)
    rows = cam.rows(run.motion, carrying(force))
    law = cam.law(rows.angle)
    values = (rows.place.real, rows.place.imag, np.abs(force), rows.pressure_angle, rows.radius, rows.eccentricity)
    return np.column_stack([*values, rows.lift, law[1], law[2]])


def _rated(run: Run, cam: Any, lifts: ColumnUnits) -> Iterator[ItemTable]:
    """Tables of a cam that the scene rates or draws: Hertz pressure, and the drawn lift with its error."""
    joint = joint_of(run.motion, cam)
    if joint.rating is not None and joint.rating.width is not None and run.forces is not None:
        columns: ColumnUnits = (("hertz_pressure", "Pa"), ("half_width", "m"))

        def stress(forces: Forces = run.forces, rating: CamRating = joint.rating) -> Real:
            hertz = contact_stress(forces, cam, rating)
            return np.column_stack([hertz.pressure, hertz.half_width])

        yield ItemTable(("data", "cams", cam.name, "stress"), f"{cam.name}.stress", columns, stress)
    if joint.drawn is not None:
        names = (*((f"drawn_{name}", unit) for name, unit in lifts), *((f"{name}_error", unit) for name, unit in lifts))

        def drawn(lift: Any = joint.drawn) -> Real:
            return drawn_rows(run.motion, cam, drawn_lift(cam, lift))

        yield ItemTable(("data", "cams", cam.name, "graphical"), f"{cam.name}.graphical", names, drawn)


def _drives(run: Run) -> Iterator[ItemTable]:
    motion, forces = run.motion, run.forces
    units = {joint.name: joint.unit for joint in joints_of(motion)}
    for drive in motion.mechanism.drives:
        unit = units[drive.joint]
        effort = ("force", "N") if unit == "m" else ("torque", "N m")
        columns: ColumnUnits = (
            ("coordinate", unit),
            ("speed", f"{unit}/s"),
            ("acceleration", f"{unit}/s^2"),
            effort,
            ("power", "W"),
        )
        yield ItemTable(("data", "drive", drive.joint), f"{drive.joint}.drive", columns, partial(_driven, run, drive.joint))
        if forces is not None:
            wrench = partial(forces.wrench, drive.joint)
            yield ItemTable(("data", "drive", drive.joint, "wrench"), f"{drive.joint}.drive_wrench", _WRENCH, wrench)


def _driven(run: Run, joint: str) -> Real:
    """Coordinate, speed, acceleration, effort and power of a drive (F, 5). Effort and power are NaN where no forces were
    computed."""
    nothing = np.full(run.motion.frames, np.nan)
    efforts = (nothing, nothing) if run.forces is None else (run.forces.effort(joint), run.forces.power(joint))
    return np.column_stack([run.motion.coordinate(joint), *efforts])


def _metrics(run: Run) -> Iterator[ItemTable]:
    """Tables of the metrics that the scene names, under ``/data/answers``."""
    motion = run.motion
    computed: dict[str, tuple[ColumnUnits, Callable[[], Any]]] = {
        "transmission_angle": ((("angle", "rad"), ("acute", "rad")), cache(partial(metrics.transmission_rows, motion))),
        "velocity_ratio": ((("ratio", "1"),), cache(partial(metrics.velocity_ratios, motion))),
        "mechanical_advantage": ((("advantage", "1"),), cache(partial(metrics.mechanical_advantage, motion))),
        "instant_centre": (_POSE[:2], cache(partial(metrics.instant_centres, motion))),
        "curvature": ((("curvature", "1/m"),), lambda: {key: metrics.curvature(motion, *key) for key in motion.mechanism.traced}),
    }
    for name, (columns, compute) in computed.items():
        for key in metrics.metric_items(name, motion.model) if name in motion.mechanism.metrics else ():
            item = key if isinstance(key, str) else point_name(*key) if name == "curvature" else " ".join(key)
            label = "instant centre" if name == "instant_centre" else name
            if name in ("velocity_ratio", "mechanical_advantage"):
                unit = metrics.ratio_units(motion.model, key)[name == "mechanical_advantage"]
                columns = ((columns[0][0], unit),)
            yield ItemTable(("data", "answers", name, item), f"{label} {item}", columns, partial(_metric, compute, key))


def _metric(compute: Callable[[], Any], key: Any) -> Real:
    values = np.asarray(compute()[key])
    return values if values.ndim > 1 else values[:, None]


def _servo_track(motion: Motion, servo: Servo, chosen: slice) -> Real:
    """The chosen columns (F, n) of target, reached coordinate and their difference [rad or m]."""
    target = np.broadcast_to(servo.target(motion.time)[0], motion.time.shape)
    reached = motion.coordinate(servo.joint)[:, 0]
    return np.column_stack([target, reached, target - reached])[:, chosen]


def _loads(run: Run) -> Iterator[ItemTable]:
    if run.forces is None:
        return
    columns: ColumnUnits = (*_WRENCH, *_POSE[:2])
    onto = onto_centres(run, links_with_mass(run))
    for name, load in run.forces.loads.items():
        parts = ("gravity", load.link) if load.kind == "gravity" else (name,)
        yield ItemTable(("data", "loads", *parts), f"{name}.load", columns, partial(_load, onto, load))


def _servos(run: Run) -> Iterator[ItemTable]:
    for servo in () if run.forces is None else run.motion.mechanism.loads:
        if isinstance(servo, Servo):
            path, unit = ("data", "servos", servo.name), joint_unit(run.motion, servo.joint)
            both: ColumnUnits = (("target", unit), ("reached", unit))
            yield ItemTable((*path, "position"), servo.name, both, partial(_servo_track, run.motion, servo, slice(0, 2)))
            yield ItemTable((*path, "error"), servo.name, (("error", unit),), partial(_servo_track, run.motion, servo, slice(2, 3)))


def _powers(run: Run) -> Iterator[ItemTable]:
    if run.forces is None:
        return
    forces = run.forces
    labels = power_labels(forces)
    if labels:
        names: ColumnUnits = tuple((label, "W") for label in labels)
        yield ItemTable(("data", "power"), "power", names, lambda: np.column_stack(list(powers_by_label(forces).values())))
    names_of_energies: ColumnUnits = tuple((k, "J") for k in ("kinetic", "potential", "work", "dissipated"))
    yield ItemTable(("data", "energy"), "energy", names_of_energies, partial(energies, forces))


def _load(onto: Any, load: LoadResult) -> Real:
    values = load.values
    place = values[:, 3:]
    at = onto(load.links, place)
    return values if at is place else np.column_stack([values[:, :3], at])


def _health(run: Run) -> Iterator[ItemTable]:
    motion, forces, simulation = run.motion, run.forces, run.simulation
    values: dict[tuple[str, str], Callable[[], Real]] = {
        ("closure", "m"): lambda: motion.closure,
        ("velocity_closure", "m/s"): lambda: motion.velocity_closure,
        ("acceleration_closure", "m/s^2"): lambda: motion.acceleration_closure,
        ("condition", "1"): lambda: motion.condition,
    }
    if forces is not None:
        values["power_balance", "1"] = lambda: forces.power_balance
    if simulation is not None:
        values["energy_drift", "1"] = lambda: simulation.drift(motion.time)
    yield ItemTable(
        ("health", "error_estimate"), "error_estimate", tuple((c, "1") for c in ERROR_COLUMNS), lambda: run.errors.table()
    )
    for column, value in values.items():
        yield ItemTable(("health", column[0]), "health", (column,), partial(_as_column, value))


ROUNDING_DISTANCE = 1e-13  # relative to coordinates and size: distances that are rounding
FAR_DISTANCE = 1e-6  # relative to the size: distances far above rounding


def onto_centres(run: Run, heavy: Sequence[str]) -> Callable[[Sequence[str], Real], Real]:
    """A function that removes rounding from places. It takes links and a place (F, 2) [m] and returns the place, or the centre of
    mass of the first of the links (only those in ``heavy``) whose centre equals the place except for rounding."""
    motion = run.motion

    @lru_cache(maxsize=8)  # the links of a joint and of its neighbours
    def centre_of(link: str) -> Real:
        pose, (_, centre, _) = motion.pose(link), motion.model.masses[motion.model.index[link]]
        c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        x, y = centre.real, centre.imag
        return np.asarray(pose[:, :2] + np.stack([c * x - s * y, s * x + c * y], axis=1))

    def placed(links: Sequence[str], place: Real) -> Real:
        for link in links:
            at = centre_of(link) if link in heavy else None
            if at is not None and place.shape == at.shape:
                if (np.abs(place[:1] - at[:1]) > FAR_DISTANCE * motion.model.length_scale).any():
                    continue  # the first frame rules out most centres
                room = ROUNDING_DISTANCE * (motion.model.length_scale + np.abs(np.nan_to_num(at)).max(initial=0.0))
                if not (np.abs(np.nan_to_num(place - at)) > room).any():
                    return np.where(np.isfinite(place), at, place)
        return place

    return placed


def without_noise(wrench: Real, size: float) -> Real:
    """Rows of force and moment (F, 3), with zero moments where all of them are rounding relative to the forces times ``size``
    [m]."""
    force, moment = (np.abs(np.nan_to_num(part)).max(initial=0.0) for part in (wrench[:, :2], wrench[:, 2]))
    if 0.0 < moment <= ROUNDING_DISTANCE * size * force:
        return np.column_stack([wrench[:, :2], np.where(np.isfinite(wrench[:, 2]), 0.0, wrench[:, 2])])
    return wrench
