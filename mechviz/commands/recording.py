"""``mechviz record`` and ``inspect``: write recordings, and print their contents."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from shlex import quote
from typing import Annotated

import typer

from mechcore.compiled.motion import Executor
from mechviz.commands.shared.loading import ReachableOpt, SceneArg, SetOpt, clear_errors, load_scene
from mechviz.commands.shared.messages import check_suffix, check_targets, fail, interruptible, load_module, say
from mechviz.commands.shared.solving import AccuracyOpt, CyclesOpt, ExecutorOpt, FramesOpt, KeepOpt, check_trust, solve
from mechviz.outputs.inspection import format_inspection
from mechviz.outputs.inspection import inspect as inspect_recording
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import live, write_recording
from mechviz.progress import progress_bar
from mechviz.runs import Run, Stage, run_scene, stopwatch, with_frames_and_cycles
from mechviz.scene.scene import Scene


def record(
    scene: SceneArg,
    values: SetOpt = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="recording to write [default: recordings/<scene>.rrd]")
    ] = None,
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    accuracy: AccuracyOpt = None,
    executor: ExecutorOpt = "auto",
    reachable: ReachableOpt = False,
    cost: Annotated[bool, typer.Option("--cost", help="also what was computed, and what each stage cost")] = False,
    keep: KeepOpt = False,
    live: Annotated[
        int | None,
        typer.Option(
            "--live",
            metavar="PORT",
            min=0,
            max=65535,
            help="motion under forces: watch it on this port while it runs; 0: a free one",
        ),
    ] = None,
) -> None:
    """Solve a scene and write a rerun recording (.rrd). Open it with: mechviz view FILE, or rerun FILE."""
    check_suffix(output, ".rrd")
    with clear_errors(scene):
        loaded = load_scene(scene, values, reachable=reachable, targets=(output,))
        path = output
        if path is None:
            Path("recordings").mkdir(exist_ok=True)
            path = Path("recordings") / f"{loaded.name}.rrd"
        check_targets(scene, path)
        if live is not None and loaded.simulation is None:
            fail(f"{loaded.name}: nothing is free, so that the whole motion is there at once. Leave out --live.")
        run = None if live is not None else solve(loaded, frames, cycles, accuracy, executor)
        loading: list[Stage] = []
        with stopwatch(loading, "loading rerun"):
            load_module("rerun")
        with interruptible("mechviz.meshes"):
            if run is None:
                run = _solve_live(loaded, frames, cycles, accuracy, path, live or 0, executor)
            check = partial(check_trust, run, keep, errors=True)
            with progress_bar("recording") as bar:
                summary = write_recording(run, path, progress=bar, begin=bar.stage, check=check, before=loading)
        say(str(summary))
        if cost:
            say(summary.costs())
        if loaded.learning_goal:
            say(f"look at: {loaded.learning_goal}")
        say(f"open it: mechviz view {quote(str(path))}, or rerun {quote(str(path))}; numbers: mechviz inspect {quote(str(path))}")
        print(path)


def _solve_live(
    scene: Scene, frames: int | None, cycles: int | None, accuracy: float | None, path: Path, port: int, executor: Executor
) -> Run:
    """Solve a motion under forces; the part that is solved is written to the unfinished recording and can be watched meanwhile."""
    scene = with_frames_and_cycles(scene, frames, cycles)
    with live(scene, path, port) as (observer, address), progress_bar("simulating") as bar:
        say(f"watch it with: rerun {address}")
        return run_scene(
            scene,
            accuracy=accuracy,
            advance=lambda t, end: bar(round(1e3 * t / end), 1000),
            observe=observer,
            executor=executor,
        )


def open_recording(path: str, most: int | None = None) -> Recording:
    """Open a recording, and print a note where parts of it are missing; ``most`` as in `Recording`."""
    recording = Recording(path, most=most)
    if recording.note:
        say(f"note: {recording.note}")
    return recording


def inspect(recording: Annotated[Path, typer.Argument(metavar="FILE.rrd", help="a mechviz recording")]) -> None:
    """Print what a recording holds, without a viewer: links, joints, peaks of forces and torque, health, events."""
    with clear_errors(str(recording)):
        print(format_inspection(inspect_recording(recording)))
