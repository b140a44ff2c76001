"""``mechviz cams SCENE``: limits, contact forces and stresses of cams, least springs, the graphical method."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import typer

from mechcore.spec.mechanism import CamDrawn
from mechcore.texts import Text
from mechviz.commands.common import fail
from mechviz.commands.solving import FramesOpt, SceneArg, clear_errors, load_scene, quantity_of, solve, warn_of_accuracy
from mechviz.scene.cams.ratings import step_fault, whole_step
from mechviz.scene.convert import LARGEST
from mechviz.studies.cam_report import cam_facts, cam_lines, drawn_lines


def cams(
    scene: SceneArg,
    method: Annotated[
        Literal["exact", "graphical"],
        typer.Option("--method", help="graphical: also the drawn lift and its error, point by point"),
    ] = "exact",
    step: Annotated[str | None, typer.Option("--step", metavar="ANGLE", help="graphical: from point to point")] = None,
    lines: Annotated[
        Literal["chord", "tangent"] | None, typer.Option("--lines", help="graphical: by what the curves are differentiated")
    ] = None,
    margin: Annotated[
        str | None, typer.Option("--margin", metavar="FORCE", help="contact force that has to remain: tells the least spring")
    ] = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="exit code 1 also where a condition fails that the scene states no limit for")
    ] = False,
    frames: FramesOpt = None,
) -> None:
    """Print the limits, contact forces and stresses of a scene's cams, and the least springs that keep contact.

    The exit code is 1 where a limit that the scene states is violated; with --strict where anything fails, be it undercut,
    contact that is lost, or the --margin.
    """
    with clear_errors(scene):
        if method == "exact" and (step is not None or lines is not None):
            fail("--step and --lines are for --method graphical.")
        loaded = load_scene(scene)
        least = quantity_of(loaded, margin, "margin", "force")
        if least is not None and not 0.0 <= least <= LARGEST:
            fail(f"--margin {margin}: a contact force is wanted, from zero to {LARGEST:g} N.")
        angle = quantity_of(loaded, step, "step", "angle")
        whole = None if angle is None else whole_step(angle)
        if angle is not None and whole is None:
            fail(f"--step {step}: {Text(' '.join(step_fault(angle)), loaded.units)}")
        run = solve(loaded, frames, None)
        warn_of_accuracy(run)
        facts = cam_facts(run.motion, run.forces, margin=least)
        found = cam_lines(run.motion, facts, loaded.units)
        if not found:
            fail(f"{run.scene.name}: the scene has no cam. Choose one of those that mechviz scenes lists.")
        print("\n".join([run.scene.title, "", *found]))
        if method == "graphical":
            plain = CamDrawn(step=math.radians(10.0))
            asked = None if whole is None and lines is None else CamDrawn(step=whole or plain.step, lines=lines or plain.lines)
            print("\n".join(["", *(drawn_lines(run.motion, loaded.units, asked) or drawn_lines(run.motion, loaded.units, plain))]))
        violated = dict.fromkeys(f"{fact.what} of {fact.cam}" for fact in facts if fact.failed and (fact.stated or strict))
        if violated:
            fail(f"{run.scene.name}: limits are violated: {', '.join(violated)}.", 1)
