"""``mechviz view``: the viewer in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mechviz.commands.common import fail
from mechviz.commands.loading import ReachableOpt, SetOpt, clear_errors, load_scene
from mechviz.commands.recording import open_recording
from mechviz.commands.solving import AccuracyOpt, CyclesOpt, ExecutorOpt, FramesOpt, solve, warn_of_accuracy, warn_of_doubts
from mechviz.outputs.viewer.app import serve, serve_while
from mechviz.outputs.viewer.server import ViewerError
from mechviz.runs import run_scene, with_run


def view(
    scene: Annotated[
        str, typer.Argument(metavar="SCENE|RECORDING.rrd", help="gallery name, path of a scene file (.toml), or a recording (.rrd)")
    ],
    port: Annotated[int, typer.Option("--port", "-p", min=0, max=65535, help="port on 127.0.0.1; 0 takes a free one")] = 8080,
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    accuracy: AccuracyOpt = None,
    values: SetOpt = None,
    executor: ExecutorOpt = "auto",
    reachable: ReachableOpt = False,
    live: Annotated[bool, typer.Option("--live", help="motion under forces: show it while it is found")] = False,
) -> None:
    """Show a scene in the browser at http://127.0.0.1:PORT until Ctrl-C, to look at and to edit; or play a recording."""
    with clear_errors(scene):
        if scene.endswith(".rrd"):
            if (frames, cycles, accuracy) != (None, None, None) or values:
                fail("--frames, --cycles, --accuracy and --set are for scenes: a recording is played as it is.")
            if live:
                fail("--live is for scenes: a recording is there at once.")
            try:
                serve(open_recording(scene), port=port)
            except ViewerError as e:
                fail(str(e), 1)
            return
        loaded = load_scene(scene, values, reachable=reachable)
        folder = Path(scene).parent.resolve() if Path(scene).is_file() else None
        try:
            if live:
                if loaded.simulation is None:
                    fail(f"{loaded.name}: nothing is free, so that the whole motion is there at once. Leave out --live.")

                grown = with_run(loaded, frames, cycles)
                serve_while(
                    lambda observe: run_scene(grown, accuracy=accuracy, observe=observe, executor=executor), grown, port, folder
                )
            else:
                run = solve(loaded, frames, cycles, accuracy, executor)
                warn_of_doubts(run)
                warn_of_accuracy(run)
                serve(run, port=port, folder=folder)
        except ViewerError as e:
            fail(str(e), 1)
