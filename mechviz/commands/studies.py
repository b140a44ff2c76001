"""``mechviz balance``, ``graph`` and ``vibrations``: shaking force, contour graph and small vibrations of a scene."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mechcore.constructions.equations import contour_graph
from mechcore.motion.solve import compile_mechanism
from mechviz.commands.shared.loading import SceneArg, SetOpt, clear_errors, load_scene, quantity_option
from mechviz.commands.shared.messages import check_suffix, check_targets, fail, interruptible, say
from mechviz.commands.shared.solving import solve
from mechviz.outputs.rerun.writer import write_recording
from mechviz.scene.scene import Scene, dump
from mechviz.studies.balance import balance_scene, write_polar
from mechviz.studies.graph import graph_lines, write_graph
from mechviz.studies.vibrations import mode_scene, vibration_lines, vibrations_csv, vibrations_of

AMPLITUDE = 0.08  # amplitude of a displayed mode, in sizes of the mechanism


def balance(
    scene: SceneArg,
    values: SetOpt = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="write the scene with its counterweights to this file")
    ] = None,
    radius: Annotated[str | None, typer.Option(help='distance of the counterweights from their pivots, such as "60 mm"')] = None,
    rocker_radius: Annotated[str | None, typer.Option(help="distance of the rocker's own from its pivot")] = None,
    fraction: Annotated[
        float | None, typer.Option(help="how much is balanced, 0 to 1 (slider-crank: of what goes to and fro)")
    ] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="write polar plots, before and after (.svg, .png or .pdf)")] = None,
) -> None:
    """Balance the shaking force of a four-bar or slider-crank by counterweights; show it before and after."""
    check_suffix(output, ".toml")
    with clear_errors(scene):
        check_targets("", output, plot)  # no source: the output may replace the scene itself
        loaded = load_scene(scene, values, targets=(output, plot))
        stated = ((radius, "radius"), (rocker_radius, "rocker-radius"))
        first, second = (quantity_option(loaded, text, name, "length") for text, name in stated)
        balanced = balance_scene(loaded, radius=first, rocker_radius=second, fraction=fraction)
        print("\n".join(balanced.lines()))
        with interruptible(*(["matplotlib.figure"] if plot is not None else [])):
            if output is not None:
                _dump(balanced.scene, output)
            if plot is not None:
                shakings = {"before": balanced.before, "with counterweights": balanced.after}
                write_polar(plot, loaded.title, balanced.motion, shakings, loaded.units)
                print(plot)


def _dump(scene: Scene, path: Path) -> None:
    """Write a scene, and report it and the files that are copied with it."""
    copies = dump(scene, path)
    say(f"{path} written." + (f" Copied beside it: {', '.join(copy.name for copy in copies)}." if copies else ""))


def graph(
    scene: SceneArg,
    values: SetOpt = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="also write it as a picture (.svg, .png or .pdf)")] = None,
) -> None:
    """Print the contour graph of a scene, links as vertices, joints as edges, with its independent loops; -o draws it.

    The numbers of links and loops are those of mechviz check --equations. polygons = ["graph"] in a scene shows it in viewer,
    recording and page.

    Try: mechviz graph contour-lever -o graph.svg
    """
    with clear_errors(scene):
        check_targets(scene, output)
        loaded = load_scene(scene, values, targets=(output,))
        drawn = contour_graph(compile_mechanism(loaded.mechanism).model)
        print("\n".join([loaded.title, *graph_lines(drawn)]))
        if output is not None:
            with interruptible("matplotlib.figure"):
                write_graph(drawn, loaded.title, output)
            say(f"{output} written.")


def vibrations(
    scene: SceneArg,
    values: SetOpt = None,
    nearest: Annotated[
        bool, typer.Option("--nearest", help="the nearest equilibrium, also an unstable one, instead of going downhill")
    ] = False,
    csv: Annotated[Path | None, typer.Option("--csv", help="also write the modes as a table (CSV)")] = None,
    mode: Annotated[int | None, typer.Option("--mode", metavar="K", help="the mode to show: 1 is the slowest")] = None,
    amplitude: Annotated[
        float, typer.Option(metavar="PART", help="largest displacement in it, as a part of the mechanism's size")
    ] = AMPLITUDE,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="write the mode as a recording (.rrd) or as a scene (.toml)")
    ] = None,
) -> None:
    """Find the equilibrium of a scene with free joints, and its natural frequencies, damping ratios and modes.

    The mechanism is let down from the start of its free joints to where it stays at rest; about that place its equations of motion
    are linearised. In a mode all parts move in step at one frequency; every small free motion is a sum of modes. Forces without a
    potential, such as follower loads, may make two modes flutter: their parts move out of step, and phases are printed. Shapes are
    printed with their largest part one, and are mass-normalised in the table.

    Try: mechviz vibrations swinging-double-pendulum, then add --mode 2 -o mode2.rrd and open that with rerun.
    """
    if (mode is None) != (output is None):
        fail("a mode to show needs both: --mode K and -o FILE.rrd (or FILE.toml).")
    if mode is None and amplitude != AMPLITUDE:
        fail("--amplitude is for a mode to show: name --mode K and -o FILE, too.")
    if output is not None and output.suffix not in (".rrd", ".toml"):
        fail(f"--output: '{output}' ends neither in .rrd (a recording) nor in .toml (a scene).")
    with clear_errors(scene):
        check_targets(scene, csv, output)
        loaded = load_scene(scene, values, targets=(csv, output))
        modes = vibrations_of(loaded, seek="nearest" if nearest else "stable")
        print("\n".join(vibration_lines(loaded, modes)))
        with interruptible(*(() if output is None else ("rerun", "mechviz.meshes"))):
            if csv is not None:
                say(f"{vibrations_csv(modes, csv)} written.")
            if mode is not None and output is not None:
                shown = mode_scene(loaded, modes, mode, amplitude=amplitude)
                if output.suffix == ".toml":
                    _dump(shown, output)
                else:
                    write_recording(solve(shown, None, None), output)
                    say(f"{output} written.")
