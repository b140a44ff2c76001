"""What commands share that read and solve scenes: their arguments, faults of scenes as messages, quantities of options."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from mechcore.errors import MechanismError
from mechviz.accuracy.words import target_words
from mechviz.commands.common import UNTRUSTED, fail, orderly, progress_bar, say
from mechviz.quantities.soundness import doubts
from mechviz.runs import Run, run_scene
from mechviz.scene.assembly.reachable import swinging
from mechviz.scene.faults import SceneError
from mechviz.scene.kinds.segments import former_laws
from mechviz.scene.scene import Scene, load
from mechviz.scene.units import QuantityError, Units

SceneArg = Annotated[str, typer.Argument(metavar="SCENE", help="gallery name or path of a scene file (.toml)")]
FramesOpt = Annotated[
    int | None, typer.Option("--frames", "-n", min=2, max=10_000_000, help="frames over the whole run [default: the scene's]")
]
CyclesOpt = Annotated[
    int | None, typer.Option("--cycles", min=1, max=100_000, help="cycles of the first drive [default: the scene's]")
]
ReachableOpt = Annotated[bool, typer.Option("--reachable", help="run the drive as far as it can go and back, not a full turn")]
AccuracyOpt = Annotated[
    float | None,
    typer.Option(
        "--accuracy", "-a", metavar="ERROR", help="wanted relative error, such as 1e-6: all dials follow [default: the scene's]"
    ),
]
KeepOpt = Annotated[bool, typer.Option("--keep", help="write results that cannot be trusted, too: they do not balance or close")]
QuickOpt = Annotated[bool, typer.Option("--quick", help="fewer repeats: rougher times")]


@contextmanager
def clear_errors(source: str) -> Iterator[None]:
    """`orderly`, and the faults of a scene as a message that names the scene."""
    with orderly():
        try:
            yield
        except MechanismError as e:
            fail(str(e if isinstance(e, SceneError) else SceneError(Path(source).name, e.faults)))


def load_scene(source: str, *, reachable: bool = False) -> Scene:
    """A scene of the gallery or of a file; ``reachable``: its drive runs as far as it can and back."""
    scene = load(source)
    for place, former, present in former_laws(scene.document):
        say(f"note: {place}: the law '{former}' is called '{present}' now, and read as that.")
    if not reachable:
        return scene
    changes = swinging(scene.document)
    if not changes:
        fail("--reachable is for scenes with one drive, which says a speed and no travel or range.")
    return scene.changed(changes)


def solve(scene: Scene, frames: int | None, cycles: int | None, accuracy: float | None = None) -> Run:
    """A solved scene, with a bar of its stages; of a motion under forces how far it is known."""
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


def check_trust(run: Run, keep: bool, *, errors: bool = False) -> None:
    """Say why the results of a run cannot be trusted, and leave before anything is written, unless they are to be kept."""
    found = doubts(run, errors=errors)
    for words in found:
        say(f"not to be trusted: {words}")
    if found and not keep:
        fail(
            "Nothing is written. Check the values of the scene against each other; --keep takes the results as they are.", UNTRUSTED
        )


def warn_of_accuracy(run: Run) -> None:
    """Say where a wanted accuracy is not reached."""
    if run.accuracy.target is not None:
        for line in target_words(run):
            if line.startswith("warning"):
                say(line)


def quantity_of(scene: Scene, text: str | None, option: str, kind: str) -> float | None:
    """A quantity of a kind, in SI units, from an option: a text with a unit, or a number in the scene's units."""
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
