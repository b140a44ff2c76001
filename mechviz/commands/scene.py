"""``mechviz show``, ``schema`` and ``check``: text, schema and structure of scenes."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from mechviz.commands.shared.loading import ReachableOpt, SceneArg, SetOpt, clear_errors, load_scene
from mechviz.commands.shared.messages import say
from mechviz.scene.scene import json_schema
from mechviz.studies.report import check_lines


def show(scene: SceneArg, values: SetOpt = None) -> None:
    """Print a scene's TOML text: a starting point for your own."""
    with clear_errors(scene):
        loaded = load_scene(scene, values)
        print(loaded.to_toml(), end="")
        if loaded.files:
            say(f"note: it reads {', '.join(loaded.files)} from its folder, '{loaded.folder.path}': copy that along with the text.")


def schema() -> None:
    """Print the JSON Schema of scene files, for editors."""
    with clear_errors("schema"):
        print(json.dumps(json_schema(), indent=2, ensure_ascii=False))


def check(
    scene: SceneArg,
    values: SetOpt = None,
    equations: Annotated[
        bool,
        typer.Option("--equations", help="also the order of solution, and the loop equations of velocities and accelerations"),
    ] = False,
    modes: Annotated[bool, typer.Option("--modes", help="also all assembly modes of every group at the start")] = False,
    reachable: ReachableOpt = False,
) -> None:
    """Validate a scene and print its mobility, groups, loops, assembly modes and reachable range."""
    with clear_errors(scene):
        print("\n".join(check_lines(load_scene(scene, values, reachable=reachable), equations=equations, modes=modes)))
