"""``mechviz forces``: forces by their classes, works, flywheel, steady run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mechcore.dynamics.rest.steady import size_flywheel, steady_run
from mechcore.forces.flywheel import flywheel
from mechviz.commands.common import check_targets, fail, interruptible
from mechviz.commands.solving import (
    AccuracyOpt,
    CyclesOpt,
    FramesOpt,
    ReachableOpt,
    SceneArg,
    clear_errors,
    load_scene,
    solve,
    warn_of_accuracy,
)
from mechviz.quantities.power_table import flywheel_lines, force_lines, power_csv, sized_lines, steady_lines
from mechviz.studies.polar import shaken, write_polar
from mechviz.studies.statics import statics_lines


def forces(
    scene: SceneArg,
    csv: Annotated[Path | None, typer.Option("--csv", help="also write the table (CSV)")] = None,
    fluctuation: Annotated[
        float | None,
        typer.Option("--flywheel", metavar="DELTA", help="flywheel for a coefficient of fluctuation such as 0.02"),
    ] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="write polar plots of the shaking force (.svg, .png or .pdf)")] = None,
    steady: Annotated[
        int | None,
        typer.Option(
            "--steady", metavar="TURNS", min=1, help="free crank: steady run whose cycle is this many turns; sizes its flywheel"
        ),
    ] = None,
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    accuracy: AccuracyOpt = None,
    reachable: ReachableOpt = False,
) -> None:
    """Print who supplies power and who absorbs it: every force with its classes and its work over the run. Where nothing moves:
    the reactions.

    Place: external forces come from outside, internal ones act between two links. Power: driving forces supply at every instant,
    resisting ones absorb, alternating ones do both. Use: useful resistance is what the machine is there for, harmful is loss.
    Supplied and absorbed works are equal: inertia and gravity only lend energy over a cycle.
    """
    if steady is not None:
        _print_steady(scene, steady, fluctuation)
        return
    with clear_errors(scene):
        check_targets(scene, csv, plot)
        run = solve(load_scene(scene, reachable=reachable), frames, cycles, accuracy)
        warn_of_accuracy(run)
        if run.forces is None:
            fail(f'{run.scene.name}: the scene names no effects and no loads, so there are no forces. Add effects = ["inertia"].')
        print(run.scene.title)
        print("\n".join(force_lines(run.forces) if run.motion.mechanism.led else statics_lines(run.forces, run.scene.units)))
        if fluctuation is not None:
            print("\n".join(flywheel_lines(flywheel(run.forces, fluctuation))))
        with interruptible(*(["matplotlib.figure"] if plot is not None else [])):
            if csv is not None:
                print(power_csv(run.forces, csv))
            if plot is not None:
                write_polar(plot, run.scene.title, run.motion, {"shaking force": shaken(run)})
                print(plot)


def _print_steady(source: str, turns: int, fluctuation: float | None) -> None:
    """The steady run of a scene's machine, and its flywheel where a coefficient of fluctuation is wanted."""
    with clear_errors(source):
        loaded = load_scene(source)
        print(loaded.title)
        print("\n".join(steady_lines(steady_run(loaded.mechanism, turns=turns))))
        if fluctuation is not None:
            print("\n".join(sized_lines(size_flywheel(loaded.mechanism, fluctuation, turns=turns))))
