"""``mechviz plan``: what will be computed for a scene. Apart from `scene`, whose commands run nothing and load less."""

from __future__ import annotations

from typing import Annotated

import typer

from mechcore.effects.plan import make_plan
from mechviz.commands.loading import SceneArg, SetOpt, clear_errors, load_scene
from mechviz.studies.cost import cost_lines, measure
from mechviz.studies.report import plan_lines


def plan(
    scene: SceneArg,
    values: SetOpt = None,
    cost: Annotated[bool, typer.Option("--cost", help="also measure what each stage and effect costs")] = False,
) -> None:
    """Print what will be computed for a scene, what not, and why; with --cost what each stage and effect costs."""
    with clear_errors(scene):
        loaded = load_scene(scene, values)
        print(loaded.title)
        print("\n".join(plan_lines(make_plan(loaded.mechanism))))
        if cost:
            print("\n".join(cost_lines(measure(loaded), loaded.frames + 1)))
