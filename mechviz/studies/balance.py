"""Shaking force of a scene: computes counterweights, compares the force before and after, writes the weights into the scene as
point masses, and draws polar plots over a cycle."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Real
from mechcore.errors import Fault
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.records import dataclass
from mechcore.reduction.balancing import Counterweight, FourBarLinks, Shaking, counterweights, find_linkage, shaking
from mechviz.figures import COLOURS, chart, save_chart
from mechviz.files import OutputError
from mechviz.scene.faults import SceneError, in_scene_words
from mechviz.scene.units import Units

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes

    from mechviz.runs import Run
    from mechviz.scene.annotations import Place
    from mechviz.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class BalancedScene:
    """A balanced scene with its counterweights, and the shaking force before and after."""

    scene: Scene
    weights: tuple[Counterweight, ...]
    motion: Motion
    before: Shaking
    after: Shaking

    def lines(self) -> list[str]:
        """The counterweights, and a table of the shaking force and moment before and after, as lines of text."""
        units = self.scene.units
        (length, per), (force, forces), (moment, moments) = (
            units.display_unit("m"),
            units.display_unit("N"),
            units.display_unit("N m"),
        )
        out = []
        for w in self.weights:
            place = f"({per * w.at[0]:.6g}, {per * w.at[1]:.6g}) {length}"
            out.append(f"{w.link}: {units.text(w.mass, 'kg', 6)} at {place} of its frame")
        out = out or ["no counterweight is needed"]
        out.append(f"{'':<16}{'before':>14}{'after':>14}")
        rows = (
            (f"peak force [{force}]", forces, self.before.peak, self.after.peak),
            (f"rms force [{force}]", forces, self.before.rms, self.after.rms),
            (f"peak moment [{moment}]", moments, self.before.peak_moment, self.after.peak_moment),
            (f"rms moment [{moment}]", moments, self.before.rms_moment, self.after.rms_moment),
        )
        return out + [f"{name:<18}{factor * a:>12.5g}{factor * b:>14.5g}" for name, factor, a, b in rows]


@in_scene_words
def balance_scene(
    scene: Scene, *, radius: float | None = None, rocker_radius: float | None = None, fraction: float | None = None
) -> BalancedScene:
    """The scene with the counterweights of its four-bar or slider-crank, and the shaking force before and after.

    Radii [m] and fraction default to those of the scene's ``shaking.counterweights``. Raises `SceneError` where neither gives a
    radius, `MechanismError` where the mechanism is neither a four-bar nor a slider-crank."""
    asked = scene.mechanism.studies.shaking
    known = None if asked is None else asked.radii
    if radius is None and known is None:
        remedy = 'Add --radius, or shaking = { counterweights = { radius = "60 mm" } } to the scene.'
        raise SceneError(scene.name, Fault("shaking.counterweights", "how far from the pivots may the counterweights be?", remedy))
    first = radius if radius is not None else known[0] if known else 0.0
    second = rocker_radius if rocker_radius is not None else radius if radius is not None else known[1] if known else first
    share = fraction if fraction is not None else asked.fraction if asked is not None else 1.0
    if not 0.0 <= share <= 1.0:
        raise SceneError(scene.name, Fault("fraction", f"{share:g} is not between 0 and 1.", "Give 0.5 for half."))
    linkage = find_linkage(scene.mechanism)
    if rocker_radius is not None and not isinstance(linkage, FourBarLinks):
        raise SceneError(scene.name, Fault("rocker-radius", "a slider-crank has no rocker.", "Leave it out."))
    weights = counterweights(linkage, (first, second), fraction=share)
    changes: dict[Place, Any] = {}
    for w in weights:
        place = ("links", w.link, "point_masses")
        entry = {"mass": _stated(scene.units, w.mass, "mass"), "at": [_stated(scene.units, x, "length") for x in w.at]}
        changes[place] = [*changes.get(place, scene.document.links[w.link].point_masses), entry]
    if scene.document.shaking is not None:
        changes["shaking", "counterweights"] = None
    better = scene.changed(changes)
    about = (0.0, 0.0) if asked is None else asked.about
    motion = _moved(scene)
    return BalancedScene(better, weights, motion, shaking(motion, about), shaking(_moved(better), about))


def _stated(units: Units, value: float, kind: str) -> float:
    """An SI value in the scene's own unit for its kind, as a plain number."""
    return float(f"{value / units.si(1.0, kind):.15g}")


def _moved(scene: Scene) -> Motion:
    mechanism = scene.mechanism
    return solve_motion(compile_mechanism(mechanism), default_times(mechanism, scene.frames, scene.cycles))


STEP = 30.0  # [degrees] of the drive between two dots on the curve of the force


def shaking_of(run: Run) -> Shaking:
    """Shaking force and moment of a run, about the point that its scene names (default: the origin). Raises `OutputError` where
    both are zero, or where forces decide the motion."""
    if run.simulation is not None:
        why = f"{run.scene.name}: forces decide the motion, and the shaking force is known of prescribed motions."
        raise OutputError(why, "Prescribe a drive.")
    asked = run.motion.mechanism.studies.shaking
    result = shaking(run.motion, (0.0, 0.0) if asked is None else asked.about)
    if result.single == 0.0 and result.peak_moment == 0.0:
        why = f"{run.scene.name}: nothing shakes the frame: no link with a mass is accelerated."
        raise OutputError(why, "Give links a mass beside their axis.")
    return result


def write_polar(path: Path, title: str, motion: Motion, shakings: Mapping[str, Shaking], units: Units) -> None:
    """Write the polar plots to a file (.svg, .png, .pdf). Raises `OutputError` where the file cannot be written."""
    save_chart(polar_figure(title, motion, shakings, units), path)


def polar_figure(title: str, motion: Motion, shakings: Mapping[str, Shaking], units: Units) -> Figure:
    """Figure of two polar plots: the path of the force's tip, with dots every 30 degrees of the drive, and the moment over the
    angle of the drive, outside the zero circle where it is positive.

    ``shakings``: the curves by their names in the legend; ``units``: those of the labels."""
    (force, per), (moment, moment_per) = units.display_unit("N"), units.display_unit("N m")
    angle = _angle(motion)
    least = max((s.single for s in shakings.values()), default=0.0)
    with chart(9.0, 5.2) as figure:
        figure.suptitle(title)
        forces, moments = figure.subplots(1, 2, subplot_kw={"projection": "polar"})
        size = moment_per * max((s.peak_moment for s in shakings.values()), default=0.0)
        for k, (name, s) in enumerate(shakings.items()):
            colour = COLOURS[(1, 2, 0)[k % 3]]
            balanced = s.peak <= 1e-9 * least
            note = f"{name}: {units.text(0.0 if balanced else s.peak, 'N', 4)}, {units.text(s.peak_moment, 'N m', 4)}"
            tip = per * (s.force @ np.array([1.0, 1.0j]))
            forces.plot(np.angle(tip), np.abs(tip), color=colour, label=note)
            marks = [tip[0]] if balanced else list(_marks(tip, angle, forces, colour, units))
            forces.plot(np.angle(marks), np.abs(marks), "o", color=colour, markersize=4.0)
            moments.plot(angle, moment_per * s.moment, color=colour)
        if all(s.peak <= 1e-9 * least for s in shakings.values()):
            forces.set_rmax(per * least or 1.0)
        moments.set_rlim(-1.05 * (size or 1.0), 1.05 * (size or 1.0))
        moments.plot(np.linspace(0.0, 2.0 * np.pi, 361), np.zeros(361), color="#9aa3ad", linewidth=1.2, zorder=1.0)
        forces.set_title(f"shaking force [{force}]", loc="center")
        moments.set_title(f"shaking moment [{moment}] over the drive", loc="center")
        if units.display_unit("rad")[0] != "°":
            for axes in (forces, moments):
                angles = np.arange(8) * np.pi / 4.0
                axes.set_xticks(angles, [units.text(float(a), "rad", 3) for a in angles])
        for axes in (forces, moments):
            axes.set_rlabel_position(-52.0)
            axes.tick_params(axis="y", labelsize="small", labelcolor="#7a838c")
        figure.legend(*forces.get_legend_handles_labels(), loc="outside lower center", ncols=len(shakings))
    return figure


def _marks(tip: NDArray[np.complex128], angle: Real, axes: PolarAxes, colour: str, units: Units) -> Iterator[complex]:
    """Tips of the force, interpolated every 30 degrees of the drive over its first turn; labels every third one with the angle."""
    degrees = np.degrees(angle)
    sense = 1.0 if degrees[-1] >= degrees[0] else -1.0
    if not np.isfinite(tip).all() or not np.all(np.diff(sense * degrees) > 0.0):
        return
    first = math.ceil(sense * degrees[0] / STEP - 1e-9)
    for k in range(first, first + round(360.0 / STEP)):
        if k * STEP > sense * degrees[-1] + 1e-9:
            return
        p = complex(*(np.interp(k * STEP, sense * degrees, part) for part in (tip.real, tip.imag)))
        yield p
        if k % 3 == 0:
            words, place = units.text(math.radians(sense * k * STEP % 360.0), "rad", 4), (float(np.angle(p)), abs(p))
            axes.annotate(words, place, (4, 4), textcoords="offset points", color=colour, fontsize="small")


def _angle(motion: Motion) -> Real:
    """Angle of the first drive (F,) [rad]; of a sliding drive, the elapsed time, scaled so that the whole run is one turn."""
    drive = motion.mechanism.drives[0].joint
    if motion.model.joints[motion.model.joint_index[drive]].coordinate == "angle":
        return np.asarray(motion.coordinate(drive)[:, 0], float)
    span = float(np.ptp(motion.time)) or 1.0
    return np.asarray(2.0 * np.pi * (motion.time - motion.time[0]) / span, float)
