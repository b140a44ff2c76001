"""Comparison of motion laws on a cam of a scene: lift and derivatives up to the jerk, pressure angle, curvature, torque, contact
force, least spring."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.arrays import Real
from mechcore.cams.placement.plane import PlacedCam
from mechcore.errors import Fault, MechanismError
from mechcore.forces.cam_rating import AnyCam, carrying, contact_force, joint_of, least_springs, placed_cams
from mechcore.laws.curve import MotionCurve
from mechcore.laws.factors import jumps, peak
from mechcore.records import dataclass
from mechcore.texts import Text, as_angle, as_coordinate, as_force, as_length, as_quantity, as_torque
from mechviz.figures import COLOURS, chart
from mechviz.runs import run_scene
from mechviz.scene.units import Units

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mechviz.scene.scene import Scene


AS_IT_IS = "as it is"
USUAL = ("harmonic", "cycloidal", "modified-trapezoid", "modified-sine", "3-4-5", "4-5-6-7")


@dataclass(frozen=True, eq=False)
class LawOnCam:
    """A cam with one law in all its rises and returns: its lift, and results over the frames.

    ``rotary``: the cam turns; ``swings``: the follower oscillates. Arrays (F,): ``argument`` of the cam [rad or m], pressure angle
    [rad], radius of curvature of the profile [m], effort of the drive [N m or N] and contact force [N], the last two None without
    forces. ``spring``: the least spring for the margin, in words. ``fault``: why there is no such cam; the other fields then keep
    their defaults.
    """

    name: str
    rotary: bool = True
    swings: bool = False
    lift: MotionCurve | None = None
    argument: Real | None = None
    pressure_angle: Real | None = None
    radius: Real | None = None
    effort: Real | None = None
    force: Real | None = None
    spring: str = ""
    fault: str = ""


def compare_laws(
    scene: Scene, cam: str | None, laws: Mapping[str, tuple[str, Mapping[str, float]]], frames: int | None
) -> list[LawOnCam]:
    """A cam of the scene as it is and with each of the laws (shown name -> law, parameters). ``cam``: None for the first cam that
    has a lift. Raises `MechanismError` where there is no such cam."""
    able = [name for name, joint in scene.document.joints.items() if joint.profile is not None and joint.profile.lift is not None]
    if not able or cam not in (None, *able):
        missing = f"'{cam}' is no cam with a lift." if cam is not None else "the scene has no cam with a lift."
        raise MechanismError(Fault("joints", missing, f"Name one of {', '.join(able)}." if able else "Choose one that has."))
    name = able[0] if cam is None else cam
    cams = [_solved(AS_IT_IS, scene, name, frames)]
    for shown, (law, parameters) in laws.items():
        try:
            cams.append(_solved(shown, with_law(scene, name, law, parameters), name, frames))
        except MechanismError as error:
            cams.append(LawOnCam(shown, fault=str(Text.of(error.faults[0].message).in_units(scene.units))))
    return cams


def with_law(scene: Scene, cam: str, law: str, parameters: Mapping[str, float]) -> Scene:
    """The scene with ``law`` and its parameters in all rises and returns of a cam."""
    changes: dict[tuple[str | int, ...], Any] = {}
    profile = scene.document.joints[cam].profile
    for k, segment in enumerate((profile.lift if profile is not None else None) or ()):
        if segment.to is None:
            continue
        path = ("joints", cam, "profile", "lift", k)
        changes |= {
            (*path, "to"): segment.to[0] if isinstance(segment.to, list) else segment.to,
            (*path, "law"): law,
            (*path, "parameters"): dict(parameters) or None,
            (*path, "mirrored"): None,
        }
    return scene.changed(changes)


def _solved(shown: str, scene: Scene, name: str, frames: int | None) -> LawOnCam:
    run = run_scene(scene, frames=frames)
    cam: AnyCam = next(c for c in placed_cams(run.motion) if c.name == name)
    joint = joint_of(run.motion, cam)
    force = None if run.forces is None else contact_force(run.forces, cam)
    rows = cam.rows(run.motion, 1.0 if force is None else carrying(force))
    drive = run.motion.mechanism.drives[0].joint
    effort = None if run.forces is None else np.asarray(run.forces.effort(drive))
    springs = []
    if run.forces is not None and not cam.form_closed:
        margin = 0.0 if joint.rating is None or joint.rating.margin is None else joint.rating.margin
        try:
            least = least_springs(run.forces, cam, margin)
            springs = ["none" if s.stiffness is None else as_quantity(s.stiffness, "stiffness", 4) for s in least]
        except MechanismError as error:
            springs = [Text.of(error.faults[0].message).source]
    return LawOnCam(
        shown, cam.bed is None, cam.arm != 0.0, joint.lift, cam.argument(run.motion), rows.pressure_angle, _radius(cam,
        rows.radius),
        effort, force, ", ".join(springs),
    )  # fmt: skip


def _radius(cam: AnyCam, radius: Real) -> Real:
    return radius if isinstance(cam, PlacedCam) else np.full(len(radius), np.nan)


def comparison_lines(rows: list[LawOnCam], units: Units) -> list[str]:
    """A table as lines of text: stroke, peaks of the lift's derivatives with respect to the angle or displacement of the cam,
    largest pressure angle, least convex radius, peak and rms effort, least contact force, least spring."""
    first = next(row for row in rows if not row.fault)
    per = f"/{units.display_unit('rad' if first.rotary else 'm', small=True)[0]}"
    heads = [
        "law",
        "lift",
        "s'",
        "s''",
        "s'''",
        "pressure angle",
        "least radius",
        "torque",
        "torque rms",
        "contact force",
        "spring",
    ]
    table = [heads, ["", "", per, f"{per}²", f"{per}³", "largest", "convex", "largest", "", "least", "least rate"]]
    for row in rows:
        if row.fault:
            table.append([row.name, row.fault])
            continue
        assert row.lift is not None and row.pressure_angle is not None and row.radius is not None
        steps = {j.order for j in jumps(row.lift, (0, 1, 2))}
        stroke = float(np.ptp(row.lift(np.linspace(row.lift.start, row.lift.end, 721), 0)[0]))
        cells = [as_coordinate(stroke, rotary=row.swings, digits=4)]
        for order in (1, 2, 3):
            infinite = any(step < order for step in steps)
            cells.append("∞" if infinite else as_coordinate(abs(peak(row.lift, order).value), rotary=row.swings, digits=4))
        convex = row.radius[row.radius > 0.0]
        cells += [as_angle(float(np.nanmax(np.abs(row.pressure_angle))), 4) if np.isfinite(row.pressure_angle).any() else "-"]
        cells += [as_length(float(convex.min()), 4) if convex.size else "-"]
        if row.effort is None or row.force is None:
            cells += ["-"] * 4
        else:
            shown = as_torque if first.rotary else as_force
            cells += [shown(float(np.nanmax(np.abs(row.effort))), 4), shown(float(np.sqrt(np.nanmean(row.effort**2))), 4)]
            cells += [as_force(float(np.nanmin(row.force)), 4), row.spring or "-"]
        table.append([row.name, *(str(Text(cell).in_units(units)) for cell in cells)])
    widths = [max(len(line[k]) for line in table if len(line) == len(heads)) for k in range(len(heads))]
    widths[0] = max(len(line[0]) for line in table)
    return ["  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=False)).rstrip() for line in table]


def comparison_figure(rows: list[LawOnCam], units: Units) -> Figure:
    """Figure of eight panels over the angle or displacement of the cam: lift and its derivatives up to the jerk, pressure angle,
    radius of curvature, effort, contact force."""
    first = next(row for row in rows if not row.fault)
    (length, lengths), (angle, angles) = units.display_unit("m"), units.display_unit("rad")
    unit, size = (angle, angles) if first.swings else (length, lengths)
    along, across = (angle, angles) if first.rotary else (length, lengths)
    per, pers = units.display_unit("rad" if first.rotary else "m", small=True)
    (effort, efforts), (force, forces) = units.display_unit("N m" if first.rotary else "N"), units.display_unit("N")
    labels = [f"lift [{unit}]", f"s' [{unit}/{per}]", f"s'' [{unit}/{per}²]", f"s''' [{unit}/{per}³]"]
    labels += [
        f"pressure angle [{angle}]",
        f"radius of curvature [{length}]",
        f"{'torque' if first.rotary else 'force'} [{effort}]",
        f"contact force [{force}]",
    ]
    with chart(11.0, 9.6) as figure:
        panels = figure.subplots(4, 2, sharex=True)
        left, right = panels[:, 0], panels[:, 1]
        for panel, label in zip([*left, *right], labels, strict=True):
            panel.set_ylabel(label)
        for k, row in enumerate(r for r in rows if not r.fault):
            style = {"color": COLOURS[k % len(COLOURS)], "linestyle": ("-", "--", ":")[k // len(COLOURS) % 3], "label": row.name}
            assert row.lift is not None and row.argument is not None and row.radius is not None and row.pressure_angle is not None
            for order, panel in enumerate(left):
                x, y = [], []
                for piece, x0 in zip(row.lift.pieces, row.lift.knots, strict=False):
                    u = np.linspace(0.0, piece.length, max(int(180 * piece.length / row.lift.length), 8))
                    f = np.empty((1, u.size))
                    piece.fill(u, f, order)
                    x += [across * (x0 + u), [np.nan]]
                    y += [size / pers**order * f[0], [np.nan]]
                panel.plot(np.concatenate(x), np.concatenate(y), **style)
            turn = row.lift.length
            place = np.mod(row.argument - row.lift.start, turn) + row.lift.start
            rank = np.argsort(place, kind="stable")
            curves = (row.pressure_angle, row.radius, row.effort, row.force)
            for panel, values, factor in zip(right, curves, (angles, lengths, efforts, forces), strict=True):
                if values is not None:
                    panel.plot(across * place[rank], factor * values[rank], **style)
        radii = np.concatenate([lengths * r.radius for r in rows if r.radius is not None])
        radii = radii[np.isfinite(radii)]
        top = 5.0 * float(np.median(np.abs(radii))) if radii.size else 1.0
        right[1].set_ylim(-top if (radii < 0.0).any() else 0.0, top)
        for panel in panels[-1]:
            panel.set_xlabel(f"cam [{along}]")
        figure.legend(*left[0].get_legend_handles_labels(), loc="outside upper left", ncols=4)
        figure.align_ylabels()
    return figure
