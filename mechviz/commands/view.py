"""``mechviz view``: the viewer in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mechviz.commands.recording import open_recording
from mechviz.commands.shared.loading import ReachableOpt, SetOpt, clear_errors, load_scene
from mechviz.commands.shared.messages import fail
from mechviz.commands.shared.solving import (
    AccuracyOpt,
    CyclesOpt,
    ExecutorOpt,
    FramesOpt,
    print_accuracy_warnings,
    solve,
    warn_of_accuracy,
)
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.viewer.app import serve, serve_while
from mechviz.outputs.viewer.server import ViewerError
from mechviz.runs import Run, run_scene, with_frames_and_cycles
from mechviz.studies.designs.figures import read_study


def view(
    scene: Annotated[
        str,
        typer.Argument(
            metavar="SCENE|RECORDING.rrd|STUDY.parquet",
            help="gallery name, scene file (.toml), recording (.rrd) or study (.parquet)",
        ),
    ],
    others: Annotated[
        list[str] | None, typer.Argument(metavar="[OTHER]...", help="designs to compare it with: pale behind it, with their curves")
    ] = None,
    port: Annotated[int, typer.Option("--port", "-p", min=0, max=65535, help="port on 127.0.0.1; 0 takes a free one")] = 8080,
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    accuracy: AccuracyOpt = None,
    values: SetOpt = None,
    executor: ExecutorOpt = "auto",
    reachable: ReachableOpt = False,
    live: Annotated[bool, typer.Option("--live", help="motion under forces: show it while it is found")] = False,
) -> None:
    """Show a scene in the browser at http://127.0.0.1:PORT until Ctrl-C, to look at and to edit; or play a recording.

    Of a study that mechviz sweep has written a chart is shown, too: the design that is clicked opens as a scene.

    More scenes or recordings are drawn pale behind the first, their curves dashed beside its own: mechviz view better.toml
    parametric-press. --set is for the first.
    """
    with clear_errors(scene):
        if scene.endswith(".rrd"):
            if (frames, cycles, accuracy) != (None, None, None) or values:
                fail("--frames, --cycles, --accuracy and --set are for scenes: a recording is played as it is.")
            if live:
                fail("--live is for scenes: a recording is there at once.")
            recorded = open_recording(scene)
            compared = _compared_designs(others, None, cycles)
            try:
                serve(recorded, port=port, compared=compared)
            except ViewerError as e:
                fail(str(e), 1)
            return
        study = read_study(Path(scene)) if scene.endswith(".parquet") else None
        loaded = load_scene(scene, values, reachable=reachable) if study is None else study.scene(Path(scene).parent)
        folder = Path(scene).parent.resolve() if Path(scene).is_file() else None
        try:
            if live:
                if others:
                    fail("--live shows one scene: leave the others out.")
                if loaded.simulation is None:
                    fail(f"{loaded.name}: nothing is free, so that the whole motion is there at once. Leave out --live.")

                grown = with_frames_and_cycles(loaded, frames, cycles)
                serve_while(
                    lambda observe: run_scene(grown, accuracy=accuracy, observe=observe, executor=executor), grown, port, folder
                )
            else:
                run = solve(loaded, frames, cycles, accuracy, executor)
                print_accuracy_warnings(run)
                warn_of_accuracy(run)
                serve(run, port=port, folder=folder, compared=_compared_designs(others, run.scene.frames, cycles), study=study)
        except ViewerError as e:
            fail(str(e), 1)


def _compared_designs(others: list[str] | None, frames: int | None, cycles: int | None) -> dict[str, Run | Recording]:
    """Recordings and runs of other designs by name; scenes are solved with ``frames`` and ``cycles``."""
    compared: dict[str, Run | Recording] = {}
    for other in others or ():
        with clear_errors(other):
            solved = open_recording(other) if other.endswith(".rrd") else solve(load_scene(other), frames, cycles)
        name, k = Path(other).stem, 1
        while name in compared:
            k += 1
            name = f"{Path(other).stem} {k}"
        compared[name] = solved
    return compared
