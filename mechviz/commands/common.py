"""What the commands share: talk, faults, interruptions, progress, reading and solving scenes. Heavy libraries load only in use."""

from __future__ import annotations

import math
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import typer

from mechviz.files import OutputError, check_target

if TYPE_CHECKING:
    from mechviz.runs import Run
    from mechviz.scene.scene import Scene


def say(text: str) -> None:
    """Talk, to stderr."""
    with suppress(OSError):  # nobody listens
        print(text, file=sys.stderr, flush=True)


def fail(text: str, code: int = 2) -> NoReturn:
    """Say what is wrong and leave."""
    say(text)
    raise typer.Exit(code)


@contextmanager
def clear_errors(source: str) -> Iterator[None]:
    """Every expected fault as a message of ours; never a traceback."""
    try:
        yield
        sys.stdout.flush()
    except (KeyboardInterrupt, SystemExit) as e:  # SIGTERM arrives as SystemExit; the writer leaves a note on both
        note = "\n".join(getattr(e, "__notes__", ())) or "Interrupted: nothing was written."
        fail(note, 130 if isinstance(e, KeyboardInterrupt) else 143)
    except OutputError as e:
        fail(str(e), e.code)
    except OSError as e:
        raise typer.Exit(no_output(e) if e.filename is None else refuse(e)) from None
    except ValueError as e:
        from mechcore.errors import MechanismError  # here: listing the gallery must not load numpy and scipy

        if not isinstance(e, MechanismError):
            raise
        from mechviz.scene.faults import SceneError

        fail(str(e if isinstance(e, SceneError) else SceneError(Path(source).name, e.faults)))


def check_targets(source: str, *paths: Path | None) -> None:
    """Refuse files that cannot be written where they are wanted, before anything is computed for them: neither over the scene or
    recording that they are made from nor over each other. Raises `OutputError`."""
    taken = {os.path.realpath(source): "is what this is made from"} if os.path.isfile(source) else {}
    for path in paths:
        if path is not None:
            real = str(check_target(path))
            if real in taken:
                raise OutputError(f"'{path}' {taken[real]}.", "Give another name.")
            taken[real] = "is wanted for two things"


def refuse(error: OSError) -> int:
    """Says which file cannot be used; gives the exit code."""
    say(f"{error.filename}: {error.strerror or error}.")
    return 2


def no_output(error: OSError) -> int:
    """Gives up on stdout, silently where its reader has left (as `head` does); gives the exit code."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if isinstance(error, BrokenPipeError):
        return 0
    say(f"the output cannot be written: {(error.strerror or str(error)).lower()}.")
    return 1


@contextmanager
def interruptible(*libraries: str) -> Iterator[None]:
    """From here on Ctrl-C and SIGTERM are exceptions, so that what was begun can be left in order.

    ``libraries`` are loaded before: some catch everything while they load, and the exception would be lost.
    """
    for name in libraries:
        import_module(name)
    before = {
        signal.SIGINT: signal.signal(signal.SIGINT, signal.default_int_handler),
        signal.SIGTERM: signal.signal(signal.SIGTERM, lambda *_: sys.exit(143)),
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def load_scene(source: str, *, reachable: bool = False) -> Scene:
    """A scene of the gallery or of a file; ``reachable``: its drive runs as far as it can and back."""
    from mechviz.scene.scene import load

    scene = load(source)
    if not reachable:
        return scene
    from mechviz.scene.kinds.reachable import swinging

    changes = swinging(scene.document)
    if not changes:
        fail("--reachable is for scenes with one drive, which says a speed and no travel or range.")
    return scene.changed(changes)


def solve(scene: Scene, frames: int | None, cycles: int | None, accuracy: float | None = None) -> Run:
    """A solved scene, with a bar of its stages; of a motion under forces how far it is known."""
    from mechviz.runs import run_scene

    with progress_bar("solving") as bar:
        return run_scene(
            scene,
            frames=frames,
            cycles=cycles,
            accuracy=accuracy,
            progress=bar.stage,
            advance=lambda t, end: bar(round(1e3 * t / end), 1000),
            warn=lambda words: say(f"note: {words}"),
        )


def warn_of_accuracy(run: Run) -> None:
    """Say where a wanted accuracy is not reached."""
    if run.accuracy.target is not None:
        from mechviz.accuracy.words import target_words

        for line in target_words(run):
            if line.startswith("warning"):
                say(line)


@dataclass(frozen=True)
class Bar:
    """How far long work is: to be called with what is done and of how much; ``stage`` is told what is done now."""

    label: str = ""
    update: Callable[..., object] = lambda **_: None

    def __call__(self, done: int, total: int) -> None:
        self.update(completed=done, total=total)

    def stage(self, name: str) -> None:
        """Something else is done from now on; how long it takes nobody knows until the bar is called."""
        self.update(description=f"{self.label}: {name}", completed=0, total=None)


@contextmanager
def progress_bar(label: str) -> Iterator[Bar]:
    """A bar on stderr for long work; silent where stderr is no terminal."""
    if not sys.stderr.isatty():
        yield Bar()
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task(label, total=None)
        yield Bar(label, lambda **what: shown.update(task, **what))


def quantity_of(scene: Scene, text: str | None, option: str, kind: str) -> float | None:
    """A quantity of a kind, in SI units, from an option: a text with a unit, or a number in the scene's units."""
    from mechviz.scene.units import QuantityError, Units

    if text is None:
        return None
    try:
        value: float | str = float(text)
    except ValueError:
        value = text
    if isinstance(value, float) and not math.isfinite(value):
        fail(f"--{option}: {text} is not a finite number. Give a finite one.")
    try:
        return Units(**scene.document.units.model_dump()).si(value, kind)
    except QuantityError as e:
        fail(f"--{option}: {e} {e.remedy}")
