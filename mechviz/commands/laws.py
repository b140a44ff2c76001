"""``mechviz laws``: motion laws with their peak factors or on a scene's own cam, and their curves over each other as a chart."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from mechcore.errors import Fault, MechanismError
from mechcore.laws.catalogue import RISES, rise
from mechcore.laws.curve import MotionCurve
from mechcore.laws.factors import peak_factors
from mechviz.commands.common import fail, interruptible
from mechviz.commands.loading import SetOpt, clear_errors, load_scene
from mechviz.commands.solving import FramesOpt
from mechviz.figures import COLOURS, chart, check_ending, save_chart
from mechviz.files import check_target
from mechviz.studies.law_comparison import USUAL, compare_laws, comparison_figure, comparison_lines

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
            loaded = load_scene(scene, values)
            rows = compare_laws(loaded, cam, given, frames)
            print("\n".join([loaded.title, "", *comparison_lines(rows, loaded.units)]))
            figure = partial(comparison_figure, rows)
        if plot is not None:
            with interruptible("matplotlib.figure"):
                save_chart(figure(), plot)
            print(plot)


def _parse(text: str) -> tuple[str, dict[str, float]]:
    """A law and its parameters: ``name`` or ``name:key=value,key=value``."""
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
    """Lines: law, Cv, Ca, Cj, largest |s' s''| (drive torque of inertia), derivatives that step at the ends and inside."""
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
    """Four panels, one over the other: displacement, velocity, acceleration, jerk over the range; a step is a gap in the line."""
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
                style = ("-", "--", ":")[k // len(COLOURS) % 3]  # no two of twenty-four laws look alike
                panel.plot(np.concatenate(x), np.concatenate(y), style, color=COLOURS[k % len(COLOURS)], label=name)
        panels[-1].set(xlabel="angle / range", xlim=(0.0, 1.0))
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=3)
        figure.align_ylabels()
    return figure
