"""The numbers of a run as named tables in SI units: what a recording holds as float64 and what CSV and Parquet export."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mechcore import Motion, answers
from mechcore.clearance import journals_of, made_pairs
from mechcore.powers import power_table

from .exactness import onto_centres, without_noise
from .vectors import centre_name, point_name

if TYPE_CHECKING:
    from .run import Run

__all__ = ["Columns", "JointInfo", "Table", "joints_of", "links_of", "links_with_mass", "pair_unit", "tables"]

Real = NDArray[np.float64]
Columns = tuple[tuple[str, str], ...]

_POSE: Columns = (("x", "m"), ("y", "m"), ("angle", "rad"))
_VELOCITY: Columns = (("vx", "m/s"), ("vy", "m/s"), ("omega", "rad/s"))
_ACCELERATION: Columns = (("ax", "m/s^2"), ("ay", "m/s^2"), ("alpha", "rad/s^2"))
_WRENCH: Columns = (("Fx", "N"), ("Fy", "N"), ("moment", "N m"))


ROUND_OFF = 1e-12  # of the largest reaction


@dataclass(frozen=True, eq=False)
class Table:
    """Values (F, n) of one item. ``path``: parts of its entity in a recording; ``columns``: name and unit of each component."""

    path: tuple[str, ...]
    item: str
    columns: Columns
    values: Real

    def headers(self) -> list[str]:
        """Column names with units, such as ``crank.x [m]``."""
        return [f"{self.item}.{name} [{unit}]" for name, unit in self.columns]


def links_with_mass(run: Run) -> list[str]:
    """Moving links whose mass counts: those with a mass or a moment of inertia, where inertia or gravity is computed."""
    mechanism = run.motion.mechanism
    if run.forces is None or not {"inertia", "gravity"} & set(mechanism.effects):
        return []
    return [link.name for link in mechanism.links if link.name != mechanism.frame and (link.mass or link.inertia)]


@dataclass(frozen=True)
class JointInfo:
    """A joint that transmits forces: a pair of the mechanism, or one that a pair brings along (the pins of a cylinder)."""

    name: str
    kind: str
    links: tuple[str, str]
    unit: str  # of its coordinate: ``m`` where it slides, else ``rad``


def joints_of(motion: Motion) -> list[JointInfo]:
    """All joints of a mechanism, in the order of its pairs as far as they are pairs; gears, belts and racks come last."""
    model = motion.model
    journals = journals_of(model.mechanism)
    bearing = {name: load.links[::2] for name, load in journals.items()}
    made = made_pairs(model.mechanism)
    found = [
        JointInfo(
            j.name,
            "revolute with clearance" if j.name in bearing else j.kind,
            bearing.get(j.name, j.links),
            "m" if j.coordinate == "slide" else "rad",
        )
        for j in model.joints
        if j.name not in made
    ]
    known = {j.name for j in found}
    return found + [JointInfo(r.name, r.kind, r.links, "rad") for r in model.relations if r.name not in known]


def links_of(motion: Motion) -> list[str]:
    """All links, the frame first, those that a pair brings along among them; without those of clearance and planar pairs."""
    made = made_pairs(motion.model.mechanism)
    return [name for name in motion.model.links if name not in made]


def pair_unit(motion: Motion, pair: str) -> str:
    """Unit of a joint's coordinate."""
    return next(j.unit for j in joints_of(motion) if j.name == pair)


def rounding_of_efforts(run: Run, unit: str) -> float:
    """Driving forces [N] (``unit`` "m") or torques [N m] below this are rounding beside the reactions of the run."""
    if run.forces is None:
        return 0.0
    largest = max(
        (float(np.nanmax(np.abs(run.forces.reaction(j.name)[:, :2]), initial=0.0)) for j in joints_of(run.motion)), default=0.0
    )
    return ROUND_OFF * largest * (1.0 if unit == "m" else run.motion.model.size)


def tables(run: Run) -> list[Table]:
    """All tables of a run; what the scene does not call for is not there."""
    from .study_tables import study_tables

    return [
        *_links(run),
        *_points(run),
        *_joints(run),
        *_cams(run),
        *_drives(run),
        *_loads(run),
        *_answers(run),
        *_health(run),
        *study_tables(run),
    ]


def _links(run: Run) -> Iterator[Table]:
    motion = run.motion
    inertia = run.forces is not None and "inertia" in motion.mechanism.effects
    heavy = links_with_mass(run)
    for name in links_of(motion):
        path = ("data", "links", name)
        yield Table((*path, "pose"), name, _POSE, motion.pose(name))
        yield Table((*path, "velocity"), name, _VELOCITY, motion.velocity(name))
        yield Table((*path, "acceleration"), name, _ACCELERATION, motion.acceleration(name))
        if inertia and name in heavy and run.forces is not None:
            yield Table((*path, "inertia"), f"{name}.inertia", _WRENCH, run.forces.inertia(name))


def _points(run: Run) -> Iterator[Table]:
    motion = run.motion
    found = [(point_name(*traced), [motion.point(*traced, k) for k in range(3)]) for traced in motion.mechanism.traced]
    for link in links_with_mass(run):
        found.append((centre_name(link), [motion.centre_of_mass(link, k) for k in range(3)]))
    columns = (_POSE[:2], _VELOCITY[:2], _ACCELERATION[:2])
    for name, derivatives in found:
        for kind, cols, values in zip(("position", "velocity", "acceleration"), columns, derivatives, strict=True):
            yield Table(("data", "points", name, kind), name, cols, values)


def _joints(run: Run) -> Iterator[Table]:
    motion, forces = run.motion, run.forces
    onto = onto_centres(run, links_with_mass(run))
    for joint in joints_of(motion):
        path, name, unit = ("data", "joints", joint.name), joint.name, joint.unit
        what = "slide" if unit == "m" else "angle"
        rates: Columns = ((what, unit), (f"{what}_rate", f"{unit}/s"), (f"{what}_acceleration", f"{unit}/s^2"))
        yield Table((*path, "motion"), f"{name}.motion", rates, motion.coordinate(name))
        place = motion.pair_position(name) if forces is None else forces.position(name)
        yield Table((*path, "position"), f"{name}.position", _POSE[:2], onto(joint.links, place))
        if forces is not None:
            columns: Columns = (*_WRENCH[:2], ("couple", "N m"))
            reaction = without_noise(forces.reaction(name), motion.model.size)
            yield Table((*path, "reaction"), f"{name}.reaction", columns, reaction)
            if name in journals_of(motion.model.mechanism):
                yield _journal(run, name)
            if forces.friction is not None and name in forces.friction.pairs:
                yield Table((*path, "friction"), f"{name}.friction", columns, forces.friction.wrench(name))
                loss = forces.friction.losses(name)[:, None]
                yield Table((*path, "friction_loss"), f"{name}.friction", (("loss", "W"),), loss)


def _journal(run: Run, pair: str) -> Table:
    """Where the journal is in its bearing, in the axes of the bearing's link, and how far they are apart (negative: pressed in)."""
    load = journals_of(run.motion.model.mechanism)[pair]
    x, y = (run.motion.coordinate(name)[:, 0] for name in load.slides)
    columns: Columns = (("x", "m"), ("y", "m"), ("gap", "m"))
    values = np.column_stack([x, y, load.radial - np.hypot(x, y)])
    return Table(("data", "joints", pair, "journal"), f"{pair}.journal", columns, values)


def _cams(run: Run) -> Iterator[Table]:
    motion = run.motion
    if not any(r.geometry is not None for r in motion.model.relations):
        return
    from mechcore.cams.happenings import contact_force, placed_cams

    for cam in placed_cams(motion):
        force = np.full(motion.frames, np.nan) if run.forces is None else contact_force(run.forces, cam)
        rows = cam.rows(motion, np.where(np.isnan(force), 1.0, force))
        columns: Columns = (
            ("x", "m"), ("y", "m"), ("force", "N"), ("pressure_angle", "rad"), ("curvature_radius", "m"), ("eccentricity", "m")
        )  # fmt: skip
        values = (rows.place.real, rows.place.imag, np.abs(force), rows.pressure_angle, rows.radius, rows.eccentricity)
        yield Table(("data", "cams", cam.name, "contact"), f"{cam.name}.contact", columns, np.column_stack(values))
        unit = "m" if cam.arm == 0.0 else "rad"
        s = cam.law(rows.angle)
        per = "m" if cam.bed else "rad"
        lifts: Columns = (("lift", unit), ("lift_rate", f"{unit}/{per}"), ("lift_acceleration", f"{unit}/{per}^2"))
        if run.simulation is not None and any(each.pair == cam.name for each in run.simulation.liftoffs):
            joined: Any = motion  # of a motion under forces
            gap = run.simulation.gap(cam.name, joined)
            yield Table(("data", "cams", cam.name, "gap"), cam.name, (("gap", unit),), gap[:, None])
        yield Table(("data", "cams", cam.name, "lift"), cam.name, lifts, np.column_stack([rows.lift, s[1], s[2]]))
        yield from _rated(run, cam, lifts)


def _rated(run: Run, cam: Any, lifts: Columns) -> Iterator[Table]:
    """What a scene asks for beside: Hertz pressure, the drawn lift and its error."""
    from mechcore.cams.happenings import pair_of
    from mechcore.cams.rating import contact_stress, drawn_lift, drawn_rows

    pair = pair_of(run.motion, cam)
    if pair.rating is not None and pair.rating.width is not None and run.forces is not None:
        found = contact_stress(run.forces, cam, pair.rating)
        columns: Columns = (("hertz_pressure", "Pa"), ("half_width", "m"))
        values = np.column_stack([found.pressure, found.half_width])
        yield Table(("data", "cams", cam.name, "stress"), f"{cam.name}.stress", columns, values)
    if pair.drawn is not None:
        names = (*((f"drawn_{name}", unit) for name, unit in lifts), *((f"{name}_error", unit) for name, unit in lifts))
        values = drawn_rows(run.motion, cam, drawn_lift(cam, pair.drawn))
        yield Table(("data", "cams", cam.name, "graphical"), f"{cam.name}.graphical", names, values)


def _drives(run: Run) -> Iterator[Table]:
    motion, forces = run.motion, run.forces
    for drive in motion.mechanism.drives:
        unit = pair_unit(motion, drive.pair)
        effort = ("force", "N") if unit == "m" else ("torque", "N m")
        columns: Columns = (
            ("coordinate", unit),
            ("speed", f"{unit}/s"),
            ("acceleration", f"{unit}/s^2"),
            effort,
            ("power", "W"),
        )
        nothing = np.full(motion.frames, np.nan)  # pure kinematics: no effort was computed
        efforts = (nothing, nothing) if forces is None else (forces.effort(drive.pair), forces.power(drive.pair))
        values = np.column_stack([motion.coordinate(drive.pair), *efforts])
        yield Table(("data", "drive", drive.pair), f"{drive.pair}.drive", columns, values)
        if forces is not None:
            wrench = forces.wrench(drive.pair)
            yield Table(("data", "drive", drive.pair, "wrench"), f"{drive.pair}.drive_wrench", _WRENCH, wrench)


def _answers(run: Run) -> Iterator[Table]:
    """What the scene asks for beyond motion and forces, under ``/data/answers``."""
    motion = run.motion
    asked = motion.mechanism.answers
    singles = {
        "transmission_angle": ("angle", "rad", answers.transmission_angles),
        "velocity_ratio": ("ratio", "1", answers.velocity_ratios),
        "mechanical_advantage": ("advantage", "1", answers.mechanical_advantage),
    }
    for name, (column, unit, compute) in singles.items():
        if name in asked:
            for pair, values in compute(motion).items():
                yield Table(("data", "answers", name, pair), f"{name} {pair}", ((column, unit),), values[:, None])
    if "instant_centre" in asked:
        for (a, b), place in answers.instant_centres(motion).items():
            yield Table(("data", "answers", "instant_centre", f"{a} {b}"), f"instant centre {a} {b}", _POSE[:2], place)
    if "curvature" in asked:
        for link, point in motion.mechanism.traced:
            bend = answers.curvature(motion, link, point)[:, None]
            name = f"{link}.{point}"
            yield Table(("data", "answers", "curvature", name), f"curvature {name}", (("curvature", "1/m"),), bend)


def _loads(run: Run) -> Iterator[Table]:
    if run.forces is None:
        return
    columns: Columns = (*_WRENCH, *_POSE[:2])
    onto = onto_centres(run, links_with_mass(run))
    for name, load in run.forces.loads.items():
        parts = ("gravity", load.link) if load.kind == "gravity" else (name,)
        values = np.column_stack([load.values[:, :3], onto(load.links, load.values[:, 3:])])
        yield Table(("data", "loads", *parts), f"{name}.load", columns, values)
    powers = power_table(run.forces)
    if powers.items:
        names: Columns = tuple((i.label, "W") for i in powers.items)
        yield Table(("data", "power"), "power", names, np.column_stack([i.power for i in powers.items]))
    energies: Columns = tuple((k, "J") for k in ("kinetic", "potential", "work", "dissipated"))
    yield Table(("data", "energy"), "energy", energies, run.forces.energy)


def _health(run: Run) -> Iterator[Table]:
    motion = run.motion
    values = {
        ("closure", "m"): motion.closure,
        ("velocity_closure", "m/s"): motion.velocity_closure,
        ("acceleration_closure", "m/s^2"): motion.acceleration_closure,
        ("condition", "1"): motion.condition,
    }
    if run.forces is not None:
        values["power_balance", "1"] = run.forces.power_balance
    if run.simulation is not None:
        values["energy_drift", "1"] = run.simulation.drift(motion.time)
    from .accuracy.estimate import COLUMNS

    yield Table(("health", "error_estimate"), "error_estimate", tuple((c, "1") for c in COLUMNS), run.errors.table())
    for column, value in values.items():
        yield Table(("health", column[0]), "health", (column,), np.reshape(value, (-1, 1)))
