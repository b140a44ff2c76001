"""Shared by commands that read scenes: the scene argument, faults of scenes as messages, quantities from options."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from mechcore.errors import MechanismError
from mechviz.commands.shared.messages import errors_as_messages, fail, say
from mechviz.files import check_inputs
from mechviz.scene.assembly.simulation import oscillation_changes
from mechviz.scene.faults import SceneError
from mechviz.scene.kinds.segments import former_laws
from mechviz.scene.scene import Scene, load
from mechviz.scene.units import QuantityError, Units

SceneArg = Annotated[str, typer.Argument(metavar="SCENE", help="gallery name or path of a scene file (.toml)")]
SetOpt = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help='another value of a parameter of the scene, such as r=42mm or "l=2*r"; again'),
]
SourceArg = Annotated[str, typer.Argument(metavar="SCENE|RECORDING", help="gallery name, scene file (.toml) or recording (.rrd)")]
ReachableOpt = Annotated[bool, typer.Option("--reachable", help="run the drive as far as it can go and back, not a full turn")]


@contextmanager
def clear_errors(source: str) -> Iterator[None]:
    """Context manager: `errors_as_messages`, which also turns the faults of a scene into a message that names the scene."""
    with errors_as_messages():
        try:
            yield
        except MechanismError as e:
            fail(str(e if isinstance(e, SceneError) else SceneError(Path(source).name, e.faults)))


def load_scene(
    source: str, values: list[str] | None = None, *, reachable: bool = False, targets: Iterable[Path | None] = ()
) -> Scene:
    """A scene of the gallery or of a file. ``values``: of parameters, as ``NAME=VALUE``; ``reachable``: the drive runs over its
    reachable range and back; ``targets``: files to be written, none of which the scene may name (`OutputError`)."""
    scene = load(source).with_parameters(dict(map(_setting, values or ())))
    check_inputs(targets, scene.file_paths)
    for place, former, present in former_laws(scene.document):
        say(f"note: {place}: the law '{former}' is called '{present}' now, and read as that.")
    if not reachable:
        return scene
    changes = oscillation_changes(scene.document)
    if not changes:
        fail("--reachable is for scenes with one drive that moves, which says a speed and no travel or range.")
    return scene.changed(changes)


def _setting(text: str) -> tuple[str, float | str]:
    """Name and value from ``NAME=VALUE``."""
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (name and equals and value):
        fail(f"--set {text}: a parameter is set like r=42mm.")
    try:
        return name, int(value) if value.isdecimal() else float(value)
    except ValueError:
        return name, value


def quantity_option(scene: Scene, text: str | None, option: str, kind: str) -> float | None:
    """A quantity of a kind, in SI units, from an option: a text with a unit, or a number in the scene's units; None for None."""
    return None if text is None else quantity(scene.units, text, option, kind)


def quantity(units: Units, text: str, option: str, kind: str) -> float:
    """A quantity of a kind, in SI units, from an option: a text with a unit, or a number in ``units``. Ends the command where it is
    neither."""
    try:
        value: float | str = float(text)
    except ValueError:
        value = text
    if isinstance(value, float) and not math.isfinite(value):
        fail(f"--{option}: {text} is not a finite number. Give a finite one.")
    try:
        return units.si(value, kind)
    except QuantityError as e:
        fail(f"--{option}: {e} {e.remedy}")
