"""Shared by commands that solve scenes: their options, solving with progress, and warnings about results."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor as Pool
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Annotated, Literal

import typer

from mechcore.compiled.motion import Executor
from mechcore.compiled.toolchain import required_compiler
from mechviz.accuracy.estimate import accuracy_warnings
from mechviz.accuracy.fit import target_lines
from mechviz.commands.shared.messages import UNTRUSTED, fail, say
from mechviz.progress import progress_bar
from mechviz.runs import Run, run_scene
from mechviz.scene.scene import Scene
from mechviz.studies.cost import missing_lines

FramesOpt = Annotated[
    int | None, typer.Option("--frames", "-n", min=2, max=10_000_000, help="frames over the whole run [default: the scene's]")
]
CyclesOpt = Annotated[
    int | None, typer.Option("--cycles", min=1, max=100_000, help="cycles of the first drive [default: the scene's]")
]
AccuracyOpt = Annotated[
    float | None,
    typer.Option(
        "--accuracy", "-a", metavar="ERROR", help="wanted relative error, such as 1e-6: all settings follow [default: the scene's]"
    ),
]
ExecutorOpt = Annotated[
    Literal["auto", "numpy", "c"],
    typer.Option(
        "--executor",
        help="what computes: numpy, or a program in C of this mechanism, compiled once; auto: C where that pays, see mechviz plan",
    ),
]
DesignExecutorOpt = Annotated[
    Literal["auto", "numpy", "c"],
    typer.Option(
        "--executor",
        help="what computes designs: numpy, or a program in C of their mechanism, in threads; auto: C where that pays",
    ),
]
KeepOpt = Annotated[bool, typer.Option("--keep", help="write results that cannot be trusted, too: they do not balance or close")]
QuickOpt = Annotated[bool, typer.Option("--quick", help="fewer repeats: rougher times")]


def solve(scene: Scene, frames: int | None, cycles: int | None, accuracy: float | None = None, executor: Executor = "auto") -> Run:
    """Solve a scene with a progress bar, which shows the stages and how far a motion under forces is integrated."""
    if executor == "c":
        for line in missing_lines(scene):
            say(f"note: {line}")
    with progress_bar("solving") as bar:
        return run_scene(
            scene,
            frames=frames,
            cycles=cycles,
            accuracy=accuracy,
            progress=bar.stage,
            advance=lambda t, end: bar(round(1e3 * t / end), 1000),
            warn=lambda words: say(f"note: {words}"),
            executor=executor,
        )


def compiler_checked(executor: Executor) -> Executor:
    """The given executor. Raises `MechanismError` where it is "c" and there is no compiler."""
    if executor == "c":
        required_compiler()
    return executor


def check_trust(run: Run, keep: bool, *, errors: bool = False) -> None:
    """Report why the results of a run cannot be trusted, and end the command before anything is written, unless ``keep``."""
    if print_accuracy_warnings(run, errors=errors) and not keep:
        fail(
            "Nothing is written. Check the values of the scene against each other; --keep takes the results as they are.", UNTRUSTED
        )


def print_accuracy_warnings(run: Run, *, errors: bool = False) -> bool:
    """Report why the results of a run cannot be trusted; returns whether there is a reason. ``errors`` as in
    `accuracy_warnings`."""
    reasons = accuracy_warnings(run, errors=errors)
    for words in reasons:
        say(f"not to be trusted: {words}")
    return bool(reasons)


def warn_of_accuracy(run: Run) -> None:
    """Report where the target accuracy of a run is not reached."""
    if run.accuracy.target is not None:
        for line in target_lines(run):
            if line.startswith("warning"):
                say(line)


JobsOpt = Annotated[int, typer.Option("--jobs", "-j", min=1, max=1024, help="processes")]
DaskOpt = Annotated[
    str | None,
    typer.Option("--dask", metavar="ADDRESS", help="scheduler of a Dask cluster that computes, such as tcp://host:8786"),
]


@contextmanager
def workers(jobs: int, dask: str | None = None) -> Iterator[tuple[Pool | None, int]]:
    """Context manager: a pool that computes designs, and the number of portions to submit at a time. The pool is that of a Dask
    cluster or has ``jobs`` processes; it is None for one job, which this process does."""
    if dask is not None:
        with _cluster(dask) as pool:
            yield pool
    elif jobs == 1:
        yield None, 2
    else:
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as executor:
            try:
                yield executor, 2 * jobs
            except BaseException:
                executor.shutdown(wait=False, cancel_futures=True)
                raise


@contextmanager
def _cluster(address: str) -> Iterator[tuple[Pool, int]]:
    """Context manager: the executor of a Dask client, and the number of portions to submit at a time. Dask reassigns the tasks of a
    lost worker."""
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        fail("--dask needs the package distributed: pip install 'mechviz[dask]'.")
    try:
        client = Client(address, timeout="10s", set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        fail(f"--dask: no scheduler answers at '{address}' ({error}). Start one with: dask scheduler.")
    try:
        yield client.get_executor(pure=False), 2 * max(1, sum(client.nthreads().values()))
    except KilledWorker:
        fail("Workers of the cluster died again and again, perhaps for lack of memory. The same command goes on with a study.", 1)
    finally:
        client.close()
