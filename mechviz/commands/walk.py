"""``mechviz walk``: a mechanism whose frame is a body walks on the ground."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mechviz.automata.walking import walk_of, walking_scene
from mechviz.commands.common import check_targets, fail, say
from mechviz.commands.loading import SceneArg, SetOpt, clear_errors, load_scene, quantity_of
from mechviz.scene.faults import did_you_mean
from mechviz.scene.scene import Scene, dump


def walk(
    scene: SceneArg,
    foot: Annotated[list[str], typer.Option("--foot", metavar="LINK.POINT", help="a point that steps on the ground; again")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="scene of the walk to write (.toml)")] = None,
    touch: Annotated[str, typer.Option("--touch", help="a foot that is not higher than this touches the ground")] = "1 mm",
    values: SetOpt = None,
) -> None:
    """Let a mechanism walk: its fixed link becomes the body, and the foot that is lowest stands still on the ground.

    Told are how far a cycle leads, how far the body goes up and down, how long each foot stands, and how far feet slip that touch
    the ground while another one stands. The body keeps its attitude; whether it would tip over is not computed. In the scene that
    is written the body is led along the ground by two slides.

    Try: mechviz walk walking-toy --foot foot.H --foot "foot 2.H" -o walk.toml, then mechviz view walk.toml
    """
    with clear_errors(scene):
        if output is not None:
            if output.suffix != ".toml":
                fail(f"--output: '{output}' does not end in .toml.")
            check_targets(scene, output)
        loaded = load_scene(scene, values)
        feet = [_foot(loaded, text) for text in foot]
        found = walk_of(loaded, feet, quantity_of(loaded, touch, "touch", "length") or 0.0)
        duration = float(found.time[-1] - found.time[0])
        print(f"a cycle of {duration:.4g} s leads {1e3 * found.advance:.4g} mm: {1e3 * found.advance / duration:.4g} mm/s")
        print(f"the body goes up and down by {1e3 * found.bounce:.3g} mm")
        for name, share, slip in zip(found.feet, found.shares, found.slips, strict=True):
            print(f"{name} stands for {100.0 * share:.3g} % of the cycle, slips {1e3 * slip:.3g} mm in it")
        if output is not None:
            dump(walking_scene(loaded, found, output.stem), output)
            say(f"{output} written.")


def _foot(scene: Scene, text: str) -> tuple[str, str]:
    known = {f"{link.name}.{point}": (link.name, point) for link in scene.mechanism.links for point in link.points}
    if text not in known:
        fail(f"--foot: there is no point '{text}'. {did_you_mean(text, known, what='Points')}")
    return known[text]
