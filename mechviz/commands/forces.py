"""``mechviz plan``, ``forces`` and ``cams``: the stages that are computed, and results of forces and cams as text."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import typer

from mechcore.cams.limits import Requirement
from mechcore.dynamics.rest.steady import size_flywheel, steady_run
from mechcore.effects.plan import make_plan
from mechcore.forces.powers import flywheel
from mechcore.spec.mechanism import CamDrawn
from mechcore.texts import Text
from mechviz.commands.shared.loading import ReachableOpt, SceneArg, SetOpt, clear_errors, load_scene, quantity, quantity_option
from mechviz.commands.shared.messages import check_targets, fail, interruptible
from mechviz.commands.shared.solving import (
    AccuracyOpt,
    CyclesOpt,
    ExecutorOpt,
    FramesOpt,
    KeepOpt,
    check_trust,
    solve,
    warn_of_accuracy,
)
from mechviz.quantities.catalogue import time_at
from mechviz.quantities.power_table import flywheel_lines, force_lines, power_csv, sized_lines, steady_lines
from mechviz.runs import Run
from mechviz.scene.convert import LARGEST_VALUE
from mechviz.scene.kinds.joints.cam_documents import step_fault, whole_step
from mechviz.studies.balance import shaking_of, write_polar
from mechviz.studies.cam_report import cam_facts, cam_lines, drawn_lines, size_lines
from mechviz.studies.cost import cost_lines, executor_lines, measure
from mechviz.studies.equations import equation_lines, equilibrium_at, latex_lines
from mechviz.studies.report import plan_lines, statics_lines


def forces(
    scene: SceneArg,
    values: SetOpt = None,
    csv: Annotated[Path | None, typer.Option("--csv", help="also write the table (CSV)")] = None,
    fluctuation: Annotated[
        float | None,
        typer.Option("--flywheel", metavar="DELTA", help="flywheel for a coefficient of fluctuation such as 0.02"),
    ] = None,
    equations: Annotated[
        bool, typer.Option("--equations", help="instead: the equilibrium equations of each group with numbers, at a moment")
    ] = False,
    latex: Annotated[bool, typer.Option("--latex", help="equations: as LaTeX")] = False,
    at: Annotated[
        str | None,
        typer.Option("--at", metavar="ANGLE|TIME", help='equations: an angle of the drive, "60 deg", or a time, "20 ms"'),
    ] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="write polar plots of the shaking force (.svg, .png or .pdf)")] = None,
    steady: Annotated[
        int | None,
        typer.Option(
            "--steady", metavar="TURNS", min=1, help="free crank: steady run whose cycle is this many turns; sizes its flywheel"
        ),
    ] = None,
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    accuracy: AccuracyOpt = None,
    executor: ExecutorOpt = "auto",
    reachable: ReachableOpt = False,
    keep: KeepOpt = False,
) -> None:
    """Print who supplies power and who absorbs it: every force with its classes and its work over the run. Where nothing moves:
    the reactions.

    Place: external forces come from outside, internal ones act between two links. Power: driving forces supply at every instant,
    resisting ones absorb, alternating ones do both. Use: useful resistance is what the machine is there for, harmful is loss.
    Supplied and absorbed works are equal: inertia and gravity only lend energy over a cycle.

    With --equations: what the method by hand writes down (d'Alembert), the last group first, and the check of all equations at
    once: mechviz forces kinetostatic-four-bar --equations --at "60 deg"
    """
    if not equations and (latex or at is not None):
        fail("--latex and --at are for --equations.")
    if equations and (csv is not None or plot is not None or fluctuation is not None or steady is not None):
        fail("--csv, --plot, --flywheel and --steady are not for --equations. Ask for them without it.")
    if steady is not None:
        _print_steady(scene, values, steady, fluctuation)
        return
    with clear_errors(scene):
        check_targets(scene, csv, plot)
        run = solve(load_scene(scene, values, reachable=reachable, targets=(csv, plot)), frames, cycles, accuracy, executor)
        check_trust(run, keep)
        warn_of_accuracy(run)
        if run.forces is None:
            fail(f'{run.scene.name}: the scene names no effects and no loads, so there are no forces. Add effects = ["inertia"].')
        if equations:
            equilibrium, frame = equilibrium_at(run, _moment_of(run, at))
            lines = (latex_lines if latex else equation_lines)(equilibrium, frame, run.scene.units)
            print("\n".join(lines if latex else [run.scene.title, *lines]))
            return
        print(run.scene.title)
        print("\n".join(statics_lines(run.forces, run.scene.units) if run.scene.at_rest else force_lines(run.forces)))
        if fluctuation is not None:
            print("\n".join(flywheel_lines(flywheel(run.forces, fluctuation), run.scene.units)))
        with interruptible(*(["matplotlib.figure"] if plot is not None else [])):
            if csv is not None:
                print(power_csv(run.forces, csv))
            if plot is not None:
                write_polar(plot, run.scene.title, run.motion, {"shaking force": shaking_of(run)}, run.scene.units)
                print(plot)


def _moment_of(run: Run, text: str | None) -> float:
    """The time [s] that an option names, as a time with a unit or as an angle of the drive (with or without a unit); without the
    option the start of the run."""
    if text is None:
        return float(run.motion.time[0])
    seconds = quantity(run.scene.units, text, "at", "time") if text.rstrip().endswith(("s", "min")) else None
    angle = None if seconds is not None else quantity_option(run.scene, text, "at", "angle")
    moment = time_at(run.catalogue, at=seconds, angle=angle)
    assert moment is not None
    return moment


def _print_steady(source: str, values: list[str] | None, turns: int, fluctuation: float | None) -> None:
    """Print the steady-state run of a scene, and the flywheel that reaches a coefficient of fluctuation, if one is given."""
    with clear_errors(source):
        loaded = load_scene(source, values)
        print(loaded.title)
        print("\n".join(steady_lines(steady_run(loaded.mechanism, turns=turns))))
        if fluctuation is not None:
            print("\n".join(sized_lines(size_flywheel(loaded.mechanism, fluctuation, turns=turns), loaded.units)))


def cams(
    scene: SceneArg,
    values: SetOpt = None,
    method: Annotated[
        Literal["exact", "graphical"],
        typer.Option("--method", help="graphical: also the drawn lift and its error, point by point"),
    ] = "exact",
    step: Annotated[str | None, typer.Option("--step", metavar="ANGLE", help="graphical: from point to point")] = None,
    lines: Annotated[
        Literal["chord", "tangent"] | None, typer.Option("--lines", help="graphical: by what the curves are differentiated")
    ] = None,
    margin: Annotated[
        str | None, typer.Option("--margin", metavar="FORCE", help="contact force that has to remain: gives the least spring")
    ] = None,
    size: Annotated[
        bool, typer.Option("--size", help="also the least base circle, the best offset and the least roller for the scene's limits")
    ] = False,
    pressure_angle: Annotated[
        str | None, typer.Option("--pressure-angle", metavar="ANGLE", help="size: largest pressure angle [default: the scene's]")
    ] = None,
    curvature: Annotated[
        str | None, typer.Option("--curvature", metavar="LENGTH", help="size: least radius of the profile [default: the scene's]")
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
        loaded = load_scene(scene, values)
        least = quantity_option(loaded, margin, "margin", "force")
        if least is not None and not 0.0 <= least <= LARGEST_VALUE:
            fail(f"--margin {margin}: a contact force is wanted, from zero to {LARGEST_VALUE:g} N.")
        if not size and (pressure_angle is not None or curvature is not None):
            fail("--pressure-angle and --curvature are for --size.")
        steepest = quantity_option(loaded, pressure_angle, "pressure-angle", "angle")
        if steepest is not None and not 0.0 < steepest < 0.5 * math.pi:
            fail(f"--pressure-angle {pressure_angle}: an angle above zero and below a right one is wanted.")
        sharpest = quantity_option(loaded, curvature, "curvature", "length")
        if sharpest is not None and not 0.0 < sharpest <= LARGEST_VALUE:
            fail(f"--curvature {curvature}: a positive length is wanted.")
        angle = quantity_option(loaded, step, "step", "angle")
        whole = None if angle is None else whole_step(angle)
        if angle is not None and whole is None:
            fail(f"--step {step}: {Text(' '.join(step_fault(angle)), loaded.units)}")
        run = solve(loaded, frames, None)
        warn_of_accuracy(run)
        facts = cam_facts(run.motion, run.forces, margin=least)
        texts = cam_lines(run.motion, facts, loaded.units)
        if not texts:
            fail(f"{run.scene.name}: the scene has no cam. Choose one of those that mechviz scenes lists.")
        print("\n".join([run.scene.title, "", *texts]))
        if method == "graphical":
            plain = CamDrawn(step=math.radians(10.0))
            asked = None if whole is None and lines is None else CamDrawn(step=whole or plain.step, lines=lines or plain.lines)
            print("\n".join(["", *(drawn_lines(run.motion, loaded.units, asked) or drawn_lines(run.motion, loaded.units, plain))]))
        if size:
            want = Requirement(radius=sharpest, pressure_rise=steepest, pressure_fall=steepest)
            sizes = size_lines(run.motion, run.forces, loaded.units, want)
            print("\n".join(["", *(sizes or ["no disc cam with a lift: nothing to size"])]))
        violated = dict.fromkeys(f"{fact.what} of {fact.cam}" for fact in facts if fact.failed and (fact.stated or strict))
        if violated:
            fail(f"{run.scene.name}: limits are violated: {', '.join(violated)}.", 1)


def plan(
    scene: SceneArg,
    cost: Annotated[bool, typer.Option("--cost", help="also measure what each stage and effect costs")] = False,
    executor: ExecutorOpt = "auto",
    values: SetOpt = None,
) -> None:
    """Print what will be computed for a scene, what not, and why; with --cost what each stage and effect costs."""
    with clear_errors(scene):
        loaded = load_scene(scene, values)
        print(loaded.title)
        print("\n".join(plan_lines(make_plan(loaded.mechanism))))
        print("\n".join(executor_lines(loaded, executor)))
        if cost:
            print("\n".join(cost_lines(measure(loaded, executor=executor), loaded.frames + 1)))
