"""What can be plotted: quantities of drives, pairs, links and points over the frames, with labels and units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from mechcore import Forces, Motion
from mechcore.cams.happenings import AnyCam
from mechcore.spec import Pair

from ..run import Run
from ..vectors import centre_name, point_name

__all__ = ["Axis", "Quantity", "find_axes", "find_quantities", "first_choice", "inverse", "output_pair", "slides"]

Real = NDArray[np.float64]


@dataclass(frozen=True)
class Quantity:
    """Something to plot: ``values()`` gives (F, n), one column for each name in ``curves``, in ``unit``."""

    label: str
    unit: str
    curves: tuple[str, ...]
    values: Callable[[], Real]

    @property
    def title(self) -> str:
        return f"{self.label} [{self.unit}]"


@dataclass(frozen=True)
class Axis:
    """What a plot runs against: ``values`` (F,) never decrease or never increase."""

    label: str
    unit: str
    values: Real

    @property
    def title(self) -> str:
        return f"{self.label} [{self.unit}]"


def find_axes(run: Run) -> list[Axis]:
    """Drive positions that run one way only, then time. A plot needs ordered values, so an oscillating drive gives none."""
    axes = []
    for drive, (position, _, _) in zip(run.motion.mechanism.drives, run.motion.drives, strict=True):
        unit, factor = _coordinate_units(slides(run.motion, drive.pair))[0]
        steps = np.diff(position)
        if len(position) > 1 and np.any(steps) and (np.all(steps >= 0.0) or np.all(steps <= 0.0)):
            what = "angle" if unit == "°" else "displacement"
            axes.append(Axis(f"{what} of drive {drive.pair}", unit, position * factor))
    return [*axes, Axis("time", "s", np.asarray(run.motion.time, float))]


def find_quantities(run: Run) -> list[Quantity]:
    """All quantities of a run, in the order in which they are offered."""
    return [
        *_of_drives(run),
        *(q for pair in run.motion.mechanism.pairs for q in _of_pair(run, pair)),
        *(q for link in run.motion.mechanism.links if link.name != run.motion.mechanism.frame for q in _of_link(run, link.name)),
        *_of_points(run),
        *_of_cams(run),
        *_of_run(run),
    ]


def slides(motion: Motion, pair: str) -> bool:
    """Whether a pair's coordinate is a displacement; else it is an angle."""
    index = motion.model.joint_index.get(pair)  # a gear, belt or rack pair relates two angles and is no joint of its own
    return index is not None and motion.model.joints[index].coordinate == "slide"


def output_pair(motion: Motion) -> Pair | None:
    """The pair whose motion a mechanism is for: the slide on the frame, or else the pin on the frame, that no drive moves.

    None if there are several or none.
    """
    mechanism = motion.mechanism
    driven = {d.pair for d in mechanism.drives}
    grounded = [p for p in mechanism.pairs if p.name not in driven and mechanism.frame in p.links]
    candidates = [p for p in grounded if slides(motion, p.name)] or grounded
    return candidates[0] if len(candidates) == 1 else None


def first_choice(run: Run, count: int) -> list[Quantity]:
    """What is plotted at the start: driving efforts if forces are known, then the motion of the output or of a traced point."""
    mechanism = run.motion.mechanism
    quantities = {q.label: q for q in find_quantities(run)}
    wanted = [f"drive {drive.pair}: {effort}" for drive in mechanism.drives for effort in ("torque", "force")]
    pair = output_pair(run.motion)
    if pair is not None:
        sliding = slides(run.motion, pair.name)
        link = next((name for name in pair.links if name != mechanism.frame), "")
        # of a link on a pin its own angle, which counts from the world's x axis whichever way round the pair is written
        wanted += [f"{f'pair {pair.name}' if sliding else f'link {link}'}: {what}" for what in _motion_names(sliding)]
    for key in mechanism.traced:
        wanted += [f"point {point_name(*key)}: {what}" for what in ("position", "velocity", "acceleration")]
    free = [p for p in mechanism.pairs if p.name not in {d.pair for d in mechanism.drives}]
    wanted += [f"pair {p.name}: {what}" for p in free[-1:] for what in _motion_names(slides(run.motion, p.name))]
    found = [label for label in dict.fromkeys([*wanted, *quantities]) if label in quantities]
    return [quantities[label] for label in found[:count]]


def _coordinate_units(sliding: bool) -> tuple[tuple[str, float], tuple[str, float], tuple[str, float]]:
    """Units of a pair's coordinate and its two derivatives, with the factors from SI."""
    if sliding:
        return ("mm", 1e3), ("m/s", 1.0), ("m/s²", 1.0)
    return ("°", 180.0 / np.pi), ("rad/s", 1.0), ("rad/s²", 1.0)


def _motion_names(sliding: bool) -> tuple[str, str, str]:
    if sliding:
        return "displacement", "velocity", "acceleration"
    return "angle", "angular velocity", "angular acceleration"


def _of_drives(run: Run) -> list[Quantity]:
    if run.forces is None:
        return []
    return [q for drive in run.motion.mechanism.drives for q in _of_drive(run.forces, drive.pair)]


def _of_drive(forces: Forces, name: str) -> list[Quantity]:
    effort, unit = ("force", "N") if slides(forces.motion, name) else ("torque", "N m")
    return [
        Quantity(f"drive {name}: {effort}", unit, (effort,), lambda: _column(forces.effort(name))),
        Quantity(f"drive {name}: power", "W", ("power",), lambda: _column(forces.power(name))),
    ]


def _of_pair(run: Run, pair: Pair) -> list[Quantity]:
    motion, forces, name = run.motion, run.forces, pair.name
    sliding = slides(motion, name)

    def coordinate(k: int, what: str, unit: str, factor: float) -> Quantity:
        return Quantity(f"pair {name}: {what}", unit, (what,), lambda: _column(motion.coordinate(name)[:, k] * factor))

    found = [
        coordinate(k, what, unit, factor)
        for k, (what, (unit, factor)) in enumerate(zip(_motion_names(sliding), _coordinate_units(sliding), strict=True))
    ]
    if forces is not None:
        found.append(
            Quantity(f"pair {name}: reaction", "N", ("Fx", "Fy", "|F|"), lambda: _with_length(forces.reaction(name)[:, :2]))
        )
        rubs = forces.friction
        if rubs is not None and name in rubs.pairs:
            found.append(Quantity(f"pair {name}: friction loss", "W", ("loss",), lambda: _column(rubs.losses(name))))
            if sliding:
                found.append(
                    Quantity(f"pair {name}: friction", "N", ("Fx", "Fy", "|F|"), lambda: _with_length(rubs.wrench(name)[:, :2]))
                )
            else:
                found.append(Quantity(f"pair {name}: friction", "N m", ("moment",), lambda: _column(rubs.wrench(name)[:, 2])))
        if sliding:
            found.append(Quantity(f"pair {name}: couple", "N m", ("couple",), lambda: _column(forces.reaction(name)[:, 2])))
    return found


def _of_link(run: Run, link: str) -> list[Quantity]:
    motion = run.motion
    return [
        Quantity(f"link {link}: angle", "°", ("angle",), lambda: _column(np.degrees(motion.pose(link)[:, 2]))),
        Quantity(f"link {link}: angular velocity", "rad/s", ("velocity",), lambda: _column(motion.velocity(link)[:, 2])),
        Quantity(
            f"link {link}: angular acceleration", "rad/s²", ("acceleration",), lambda: _column(motion.acceleration(link)[:, 2])
        ),
    ]


def _of_points(run: Run) -> list[Quantity]:
    motion, mechanism = run.motion, run.motion.mechanism
    found = []
    for link, point in mechanism.traced:
        found += _of_point(point_name(link, point), partial(motion.point, link, point))
    for link_spec in mechanism.links:
        if link_spec.mass > 0.0 and link_spec.name != mechanism.frame:
            found += _of_point(centre_name(link_spec.name), partial(motion.centre_of_mass, link_spec.name))
    return found


def _of_point(name: str, at: Callable[[int], Real]) -> list[Quantity]:
    """``at(d)``: the point's position or its d-th derivative (F, 2)."""
    return [
        Quantity(f"point {name}: position", "mm", ("x", "y"), lambda: at(0) * 1e3),
        Quantity(f"point {name}: velocity", "m/s", ("vx", "vy", "|v|"), lambda: _with_length(at(1))),
        Quantity(f"point {name}: acceleration", "m/s²", ("ax", "ay", "|a|"), lambda: _with_length(at(2))),
    ]


def _of_cams(run: Run) -> list[Quantity]:
    """Pressure angle, curvature of the profile and contact force of every cam; computed when they are looked at."""
    if not any(r.geometry is not None for r in run.motion.model.relations):
        return []
    from mechcore.cams.happenings import placed_cams

    return [q for cam in placed_cams(run.motion) for q in _of_cam(run, cam)]


def _of_cam(run: Run, cam: AnyCam) -> list[Quantity]:
    from mechcore.cams.happenings import contact_force, pair_of
    from mechcore.cams.placed import PlacedCam
    from mechcore.cams.rating import contact_stress, drawn_lift, drawn_rows

    motion, forces, name = run.motion, run.forces, cam.name
    found = [
        Quantity(f"cam {name}: pressure angle", "°", ("angle",), lambda: _column(np.degrees(cam.rows(motion).pressure_angle))),
        Quantity(f"cam {name}: curvature", "1/m", ("curvature",), lambda: _column(inverse(cam.rows(motion).radius))),
    ]
    if forces is not None:
        found.append(Quantity(f"cam {name}: contact force", "N", ("force",), lambda: _column(contact_force(forces, cam))))
    pair = pair_of(motion, cam)
    rating, drawn = pair.rating, pair.drawn
    if forces is not None and rating is not None and rating.width is not None:
        found.append(
            Quantity(
                f"cam {name}: Hertz pressure", "MPa", ("pressure",),
                lambda: _column(1e-6 * contact_stress(forces, cam, rating).pressure),
            )
        )  # fmt: skip
    if drawn is not None and isinstance(cam, PlacedCam):
        rows = cache(lambda: drawn_rows(motion, cam, drawn_lift(cam, drawn)))
        unit = "m/rad²" if cam.arm == 0.0 else "1/rad"
        found.append(
            Quantity(
                f"cam {name}: drawn acceleration", unit, ("drawn", "exact"),
                lambda: np.column_stack([rows()[:, 2], rows()[:, 2] - rows()[:, 5]]),
            )
        )  # fmt: skip
    return found


def inverse(radius: Real) -> Real:
    """Curvature of radii: nothing of what is straight."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(np.isinf(radius), 0.0, 1.0 / radius))


def _of_run(run: Run) -> list[Quantity]:
    motion, forces = run.motion, run.forces
    found = []
    if forces is not None:
        found.append(Quantity("energy", "J", ("kinetic", "potential", "work", "dissipated"), lambda: forces.energy))
        found.append(Quantity("health: power balance", "1", ("residual",), lambda: _column(forces.power_balance)))
    found.append(Quantity("health: closure", "m", ("residual",), lambda: _column(motion.closure)))
    found.append(Quantity("health: condition", "1", ("condition",), lambda: _column(motion.condition)))
    return found


def _column(values: Real) -> Real:
    return np.asarray(values, float)[:, None]


def _with_length(vectors: Real) -> Real:
    return np.column_stack([vectors, np.hypot(vectors[:, 0], vectors[:, 1])])
