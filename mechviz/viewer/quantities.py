"""What can be plotted: quantities of drives, pairs, links and points over the frames, with labels and units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechcore.spec import Mechanism, Pair, Prismatic

from ..run import Run
from ..vectors import centre_name, point_name

__all__ = ["Axis", "Quantity", "find_axes", "find_quantities", "first_choice", "output_pair"]

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
        unit, factor = _coordinate_units(_pair(run, drive.pair))[0]
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
        *_of_run(run),
    ]


def output_pair(mechanism: Mechanism) -> Pair | None:
    """The pair whose motion a mechanism is for: the slide on the frame, or else the pin on the frame, that no drive moves.

    None if there are several or none.
    """
    driven = {d.pair for d in mechanism.drives}
    grounded = [p for p in mechanism.pairs if p.name not in driven and mechanism.frame in p.links]
    slides = [p for p in grounded if isinstance(p, Prismatic)]
    candidates = slides or grounded
    return candidates[0] if len(candidates) == 1 else None


def first_choice(run: Run, count: int) -> list[Quantity]:
    """What is plotted at the start: driving efforts where forces are computed, then the motion of the output or of a traced point."""
    mechanism = run.motion.mechanism
    quantities = {q.label: q for q in find_quantities(run)}
    wanted = [f"drive {drive.pair}: {effort}" for drive in mechanism.drives for effort in ("torque", "force")]
    pair = output_pair(mechanism)
    if pair is not None:
        wanted += [f"pair {pair.name}: {what}" for what in _motion_names(pair)]
    for key in mechanism.traced:
        wanted += [f"point {point_name(*key)}: {what}" for what in ("position", "velocity", "acceleration")]
    free = [p for p in mechanism.pairs if p.name not in {d.pair for d in mechanism.drives}]
    wanted += [f"pair {p.name}: {what}" for p in free[-1:] for what in _motion_names(p)]
    found = [label for label in dict.fromkeys([*wanted, *quantities]) if label in quantities]
    return [quantities[label] for label in found[:count]]


def _pair(run: Run, name: str) -> Pair:
    return next(p for p in run.motion.mechanism.pairs if p.name == name)


def _coordinate_units(pair: Pair) -> tuple[tuple[str, float], tuple[str, float], tuple[str, float]]:
    """Units of a pair's coordinate and its two derivatives, with the factors from SI."""
    if isinstance(pair, Prismatic):
        return ("mm", 1e3), ("m/s", 1.0), ("m/s²", 1.0)
    return ("°", 180.0 / np.pi), ("rad/s", 1.0), ("rad/s²", 1.0)


def _motion_names(pair: Pair) -> tuple[str, str, str]:
    if isinstance(pair, Prismatic):
        return "displacement", "velocity", "acceleration"
    return "angle", "angular velocity", "angular acceleration"


def _of_drives(run: Run) -> list[Quantity]:
    forces = run.forces
    if forces is None:
        return []
    found = []
    for drive in run.motion.mechanism.drives:
        name = drive.pair
        effort, unit = ("force", "N") if isinstance(_pair(run, name), Prismatic) else ("torque", "N m")
        found.append(Quantity(f"drive {name}: {effort}", unit, (effort,), lambda n=name: _column(forces.effort(n))))
        found.append(Quantity(f"drive {name}: power", "W", ("power",), lambda n=name: _column(forces.power(n))))
    return found


def _of_pair(run: Run, pair: Pair) -> list[Quantity]:
    motion, forces = run.motion, run.forces
    found = []
    for k, (what, (unit, factor)) in enumerate(zip(_motion_names(pair), _coordinate_units(pair), strict=True)):
        found.append(
            Quantity(
                f"pair {pair.name}: {what}",
                unit,
                (what,),
                lambda k=k, factor=factor: _column(motion.coordinate(pair.name)[:, k] * factor),
            )
        )
    if forces is not None:
        found.append(
            Quantity(f"pair {pair.name}: reaction", "N", ("Fx", "Fy", "|F|"), lambda: _with_length(forces.reaction(pair.name)[:, :2]))
        )
        if isinstance(pair, Prismatic):
            found.append(
                Quantity(f"pair {pair.name}: couple", "N m", ("couple",), lambda: _column(forces.reaction(pair.name)[:, 2]))
            )
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
    points: list[tuple[str, Callable[[int], Real]]] = [
        (point_name(*key), lambda d, key=key: motion.point(*key, d)) for key in mechanism.traced
    ]
    points += [
        (centre_name(link.name), lambda d, n=link.name: motion.centre_of_mass(n, d))
        for link in mechanism.links
        if link.mass > 0.0 and link.name != mechanism.frame
    ]
    found = []
    for name, at in points:
        found += [
            Quantity(f"point {name}: position", "mm", ("x", "y"), lambda at=at: at(0) * 1e3),
            Quantity(f"point {name}: velocity", "m/s", ("vx", "vy", "|v|"), lambda at=at: _with_length(at(1))),
            Quantity(f"point {name}: acceleration", "m/s²", ("ax", "ay", "|a|"), lambda at=at: _with_length(at(2))),
        ]
    return found


def _of_run(run: Run) -> list[Quantity]:
    motion, forces = run.motion, run.forces
    found = []
    if forces is not None:
        found.append(Quantity("energy", "J", ("kinetic", "potential", "work"), lambda: forces.energy[:, :3]))
        found.append(Quantity("health: power balance", "1", ("residual",), lambda: _column(forces.power_balance)))
    found.append(Quantity("health: closure", "m", ("residual",), lambda: _column(motion.closure)))
    found.append(Quantity("health: condition", "1", ("condition",), lambda: _column(motion.condition)))
    return found


def _column(values: Real) -> Real:
    return np.asarray(values, float)[:, None]


def _with_length(vectors: Real) -> Real:
    return np.column_stack([vectors, np.hypot(vectors[:, 0], vectors[:, 1])])
