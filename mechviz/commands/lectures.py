"""Commands for lectures. ``mechviz laws``: motion laws with their peak factors (also on a cam of a scene) and their superposed
curves; ``mechviz solve``: inverse tasks without a scene."""

from __future__ import annotations

import cmath
import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import typer

from mechcore.errors import Fault, MechanismError
from mechcore.laws.catalogue import RISES, rise
from mechcore.laws.curve import MotionCurve
from mechcore.laws.factors import peak_factors
from mechviz.commands.shared.loading import SetOpt, clear_errors, load_scene, quantity
from mechviz.commands.shared.messages import fail, interruptible
from mechviz.commands.shared.solving import FramesOpt
from mechviz.figures import COLOURS, chart, check_ending, save_chart
from mechviz.files import check_target
from mechviz.scene.units import Units
from mechviz.studies.law_comparison import USUAL, compare_laws, comparison_figure, comparison_lines
from mechviz.studies.tasks import LinkTask, SwingTask, link_lines, swing_lines

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PANELS = ("displacement s", "velocity s'", "acceleration s''", "jerk s'''")


def laws(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[LAW]...", help="laws, such as cycloidal or parabolic:skew=0.4 [default: all]")
    ] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="write the curves over each other (.svg, .png or .pdf)")] = None,
    scene: Annotated[
        str | None,
        typer.Option("--scene", metavar="SCENE", help="on a cam of this scene: limits, torque, least spring"),
    ] = None,
    cam: Annotated[str | None, typer.Option("--cam", metavar="JOINT", help="which cam of the scene [default: the first]")] = None,
    values: SetOpt = None,
    frames: FramesOpt = None,
) -> None:
    """Print motion laws with their peak factors Cv, Ca, Cj and the steps of their derivatives; plot them over each other.

    With --scene the laws stand in all rises and returns of the scene's own cam: lift to jerk, pressure angle, radius of
    curvature, drive torque, contact force and least spring side by side.
    """
    with clear_errors("laws" if scene is None else scene):
        if scene is None and (cam is not None or frames is not None or values):
            fail("--cam, --set and --frames are for --scene.")
        given = {name: _parse(name) for name in (names or list(RISES if scene is None else USUAL))}
        chosen = {name: rise(law, **parameters) for name, (law, parameters) in given.items()}
        if plot is not None:
            check_ending(plot)
            check_target(plot)
        if scene is None:
            print("\n".join(laws_table(chosen)))
            figure = partial(laws_figure, chosen)
        else:
            loaded = load_scene(scene, values, targets=(plot,))
            rows = compare_laws(loaded, cam, given, frames)
            print("\n".join([loaded.title, "", *comparison_lines(rows, loaded.units)]))
            figure = partial(comparison_figure, rows, loaded.units)
        if plot is not None:
            with interruptible("matplotlib.figure"):
                save_chart(figure(), plot)
            print(plot)


def _parse(text: str) -> tuple[str, dict[str, float]]:
    """Name and parameters of a law from ``name`` or ``name:key=value,key=value``. Raises `MechanismError`."""
    name, _, rest = text.partition(":")
    parameters = {}
    for part in filter(None, rest.split(",")):
        key, equals, value = part.partition("=")
        try:
            parameters[key.strip()] = number = float(value)
            if not math.isfinite(number):
                raise ValueError
        except ValueError:
            raise MechanismError(Fault(f"{name}.{key}", f"'{value}' is not a finite number." if equals else "it has no value.",
                                       "Write it like parabolic:skew=0.4.")) from None  # fmt: skip
    return name, parameters


def laws_table(chosen: dict[str, MotionCurve]) -> list[str]:
    """Table of laws as lines of text: Cv, Ca, Cj, largest |s' s''| (inertia torque on the drive), derivatives that are
    discontinuous at the ends and inside."""
    words = {1: "velocity", 2: "acceleration", 3: "jerk"}
    width = max(len("law"), *map(len, chosen))
    lines = [f"{'law':<{width}}  {'Cv':>8} {'Ca':>9} {'Cj':>10} {'|v a|':>8}  steps at the ends / inside; what it is"]
    for name, curve in chosen.items():
        f = peak_factors(curve)
        steps = " / ".join(", ".join(words[k] for k in group) or "none" for group in (f.end_steps, f.inner_steps))
        about = RISES[name.partition(":")[0]].about
        lines.append(f"{name:<{width}}  {f.velocity:8.5f} {f.acceleration:9.5f} {f.jerk:10.4f} {f.power:8.5f}  {steps}; {about}")
    lines.append("Peaks for stroke H over the range b at cam speed w: Cv H w/b, Ca H (w/b)^2, Cj H (w/b)^3.")
    return lines


def laws_figure(chosen: dict[str, MotionCurve]) -> Figure:
    """Figure of four panels, one above the other: displacement, velocity, acceleration and jerk over the range; a discontinuity is
    a gap in the line."""
    with chart(7.6, 9.0 + 0.2 * (len(chosen) // 3)) as figure:
        panels = figure.subplots(len(_PANELS), sharex=True)
        for order, (panel, label) in enumerate(zip(panels, _PANELS, strict=True)):
            panel.set_ylabel(label)
            for k, (name, curve) in enumerate(chosen.items()):
                x, y = [], []
                for piece, x0 in zip(curve.pieces, curve.knots, strict=False):
                    u = np.linspace(0.0, piece.length, max(int(240 * piece.length / curve.length), 8))
                    f = np.empty((1, u.size))
                    piece.fill(u, f, order)
                    x += [x0 + u, [np.nan]]
                    y += [f[0], [np.nan]]
                style = ("-", "--", ":")[k // len(COLOURS) % 3]  # up to twenty-four laws are distinguishable
                panel.plot(np.concatenate(x), np.concatenate(y), style, color=COLOURS[k % len(COLOURS)], label=name)
        panels[-1].set(xlabel="angle / range", xlim=(0.0, 1.0))
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=3)
        figure.align_ylabels()
    return figure


UNITS = Units(length="m", angle="deg")
"""Units of numbers that are given without a unit."""


def solve(
    task: Annotated[Literal["link", "swing"], typer.Argument(help="link: from two accelerations; swing: inertia from periods")],
    point: Annotated[
        list[str] | None,
        typer.Option("--point", metavar="NAME=X,Y", help="link: a point; accelerations are known of the first two"),
    ] = None,
    acceleration: Annotated[
        list[str] | None,
        typer.Option("--acceleration", metavar="NAME=SIZE@ANGLE|X,Y", help="link: of the first two points"),
    ] = None,
    mass: Annotated[str | None, typer.Option("--mass", help="its mass [kg]")] = None,
    inertia: Annotated[str | None, typer.Option("--inertia", help="link: its moment of inertia about S [kg m^2]")] = None,
    centre: Annotated[str, typer.Option("--centre", metavar="X,Y", help="link: its centre of mass S")] = "0,0",
    mass_at: Annotated[
        list[str] | None,
        typer.Option(
            "--mass-at", metavar="NAME|X,Y", help="link: a point mass that is to replace it; ? for a coordinate to be found"
        ),
    ] = None,
    period: Annotated[list[str] | None, typer.Option("--period", help="swing: to and fro [s]; twice for two axes")] = None,
    distance: Annotated[str | None, typer.Option("--distance", help="swing: of the centre of mass from the axis [m]")] = None,
    apart: Annotated[
        str | None, typer.Option("--apart", help="swing: distance of two axes [m], S on the line between them")
    ] = None,
    amplitude: Annotated[str, typer.Option("--amplitude", help="swing: from the lowest position [deg]")] = "0",
    gravity: Annotated[str, typer.Option("--gravity", help="swing: acceleration of gravity")] = "9.81 m/s^2",
) -> None:
    """Solve an inverse task of a lecture, without a scene. Bare numbers are in m, s, kg, m/s², degrees.

    link: angular velocity and acceleration of a link from the accelerations of two of its points, those of all others, its inertia
    force and moment as one force, and point masses that replace it. The worked task, S being the origin:

    mechviz solve link --point A=-0.5,0 --point B=0.366,-0.5 --acceleration A=20@50 --acceleration B=30@140
    --mass 10 --inertia 2 --mass-at A --mass-at B --mass-at ?,0.2

    swing: moment of inertia from the period about one axis, or about two, which give the centre of mass too:

    mechviz solve swing --mass "1.5 kg" --distance "350 mm" --period 1.7544 --amplitude 10
    """
    with clear_errors(task):
        if task == "link":
            print("\n".join(link_lines(_link(point or [], acceleration or [], mass, inertia, centre, mass_at or []))))
            return
        if mass is None or not period:
            fail("a swing needs --mass and --period.")
        if (len(period) == 2) != (apart is not None) or (len(period) == 1) != (distance is not None) or len(period) > 2:
            fail("a swing needs one --period and --distance, or two --period and --apart.")
        swing = SwingTask(
            mass=_value(mass, "mass", "mass"),
            periods=tuple(_value(text, "period", "time") for text in period),
            distance=None if distance is None else _value(distance, "distance", "length"),
            apart=None if apart is None else _value(apart, "apart", "length"),
            amplitude=_value(amplitude, "amplitude", "angle"),
            gravity=_value(gravity, "gravity", "gravity"),
        )
        print("\n".join(swing_lines(swing)))


def _link(
    stated: list[str], accelerations: list[str], mass: str | None, inertia: str | None, centre: str, mass_at: list[str]
) -> LinkTask:
    points = dict(_named(text, "point", "length") for text in stated)
    known = dict(_named(text, "acceleration", "linear acceleration") for text in accelerations)
    first = list(points)[:2]
    if len(first) < 2 or set(known) != set(first):
        fail("a link needs two points and the accelerations of these: --point A=X,Y --point B=X,Y --acceleration A=... "
             "--acceleration B=...")  # fmt: skip
    if (mass is None) != (inertia is None) or (mass_at and mass is None):
        fail("inertia forces need --mass and --inertia; point masses need both.")
    masses: list[tuple[str, float | None, float | None]] = []
    for text in mass_at:
        if text in points:
            masses.append((text, points[text].real, points[text].imag))
        else:
            x, y = (None if part.strip() == "?" else _value(part, "mass-at", "length") for part in _two(text, "mass-at"))
            masses.append(("", x, y))
    return LinkTask(
        points=points,
        accelerations=(known[first[0]], known[first[1]]),
        centre=complex(*(_value(part, "centre", "length") for part in _two(centre, "centre"))),
        mass=None if mass is None else _value(mass, "mass", "mass"),
        inertia=None if inertia is None else _value(inertia, "inertia", "inertia"),
        masses=masses,
    )


def _named(text: str, option: str, kind: str) -> tuple[str, complex]:
    """Name and plane vector from ``A=1,2`` (x, y) or ``A=20@50`` (size, angle)."""
    name, equals, value = (part.strip() for part in text.partition("="))
    if not name or not equals:
        fail(f"--{option} {text}: a name is missing. Write it like A=1,2.")
    size, polar, angle = value.partition("@")
    if polar:
        return name, cmath.rect(_value(size, option, kind), _value(angle, option, "angle"))
    return name, complex(*(_value(part, option, kind) for part in _two(value, option)))


def _two(text: str, option: str) -> list[str]:
    parts = text.split(",")
    if len(parts) != 2:
        fail(f"--{option} {text}: two coordinates are wanted, such as 0.3,-0.1, or one of the points that are stated.")
    return parts


def _value(text: str, option: str, kind: str) -> float:
    return quantity(UNITS, text.strip(), option, kind)
