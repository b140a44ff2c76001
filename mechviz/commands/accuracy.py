"""Accuracy of results and its cost. ``mechviz accuracy``: error over time for a series of values of each accuracy setting, and the
quickest that reaches a target; ``effects``: influence of each effect on the results; ``hard``: the suite of hard cases."""

from __future__ import annotations

import json as json_text
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from mechcore.accuracy import accuracy_for
from mechviz.commands.shared.loading import SceneArg, SetOpt, clear_errors, load_scene
from mechviz.commands.shared.messages import check_targets, fail, interruptible
from mechviz.commands.shared.solving import QuickOpt
from mechviz.figures import check_ending, save_chart
from mechviz.hard_cases import all_cases
from mechviz.hard_cases.case import CASE_FAMILIES, as_data, case_table, summary
from mechviz.outputs.rerun.precision import write_rrd
from mechviz.outputs.rerun.writer import write_recording
from mechviz.progress import progress_bar
from mechviz.studies.cost import machine, processor_share
from mechviz.studies.influences import influence_lines, influences
from mechviz.studies.precision import PrecisionPoint, cheapest, ladder, load_study, pareto, store_study
from mechviz.studies.precision_diagram import diagram, settings_of


def accuracy(
    scene: SceneArg,
    values: SetOpt = None,
    target: Annotated[
        float | None, typer.Option("--target", "-t", metavar="ERROR", help="wanted relative error, such as 1e-6")
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="write the diagrams (.svg, .png or .pdf)")] = None,
    rrd: Annotated[Path | None, typer.Option("--rrd", help="write the diagrams as a rerun recording")] = None,
    setting: Annotated[str | None, typer.Option("--setting", help="one setting only, such as frames")] = None,
    every: Annotated[bool, typer.Option("--all", help="every value with its error and time, not the summary")] = False,
    again: Annotated[bool, typer.Option("--again", help="measure again, whatever was kept of an earlier run")] = False,
    quick: QuickOpt = False,
) -> None:
    """Measure what accuracy costs: error against time for a series of values of each setting.

    Times are medians on one thread after a warm-up. Marked: * on the Pareto front (nothing is quicker and more exact), <- what the
    scene uses now. Results are kept by scene and machine; --again measures anew.
    """
    with clear_errors(scene):
        if output is not None:
            check_ending(output)
        if target is not None:
            accuracy_for(target)  # raises for an invalid target
        check_targets(scene, output, rrd)
        loaded = load_scene(scene, values, targets=(output, rrd))
        if not loaded.frames:
            fail(f"{loaded.name}: nothing moves and no time passes: all is exact to rounding. Add a duration to [run].")
        measured = None if again else load_study(loaded, target, rough=quick)
        before = measured is not None
        if measured is None:
            with progress_bar("measuring") as bar, processor_share() as share:
                points = ladder(loaded, target, bar, budget=0.02 if quick else 0.25, record=write_recording)
            measured = store_study(loaded, target, points, quick, share())
        shown = [p for p in measured.points if setting is None or p.setting == setting]
        if not shown:
            fail(f"--setting: '{setting}' is no setting of this scene. Choose from {', '.join(settings_of(measured.points))}.")
        title = f"{loaded.title}: what accuracy costs"
        lines = table_lines(shown, target) if every or setting is not None else summary_lines(shown)
        print("\n".join([title, *lines, "", measured.foot, *_answer(shown, target)]))
        if before:
            print("\nkept from then; --again measures anew")
        with interruptible(*(["matplotlib.figure"] if output is not None else []), *(["rerun"] if rrd is not None else [])):
            if output is not None:
                figure, words = diagram(shown, title, measured.foot, target)
                save_chart(figure, output, words)
                print(output)
            if rrd is not None:
                write_rrd(shown, rrd, title, "\n".join(f"    {line}" for line in table_lines(shown, target)), target)
                print(rrd)


def summary_lines(points: Sequence[PrecisionPoint]) -> list[str]:
    """Summary as lines of text, for each setting: the value of the scene, the least error with its time, and the quickest value."""
    lines = ["", f"  {'setting':<22} {'now':>26}   {'most exact':>36}   {'quickest':>36}"]

    def words(p: PrecisionPoint | None, named: bool) -> str:
        if p is None:
            return "-"
        return f"{f'{p.method} {p.value}: ' if named else ''}{p.error:.1e} in {p.time_text}"

    for setting in dict.fromkeys(p.setting for p in points):
        own = [p for p in points if p.setting == setting]
        now = next((p for p in own if p.current), None)
        best, quick = min(own, key=lambda p: (p.error, p.seconds)), min(own, key=lambda p: p.seconds)
        lines.append(f"  {setting:<22} {words(now, False):>26}   {words(best, True):>36}   {words(quick, True):>36}")
    return [*lines, "", "every value: --all; one setting: --setting NAME; the cheapest for an error: --target ERROR"]


def table_lines(points: Sequence[PrecisionPoint], target: float | None) -> list[str]:
    """All points as lines of text, by setting and method: value, error, time with its spread, marks."""
    lines = []
    for setting in dict.fromkeys(p.setting for p in points):
        own = [p for p in points if p.setting == setting]
        front = {id(p) for p in pareto(own)}
        best = cheapest(own, target) if target is not None else None
        width = max(len(p.method) for p in own)
        lines += ["", setting, f"  {'':<{width}}  {'value':<14} {'error':>8}  {'time [ms]':>10} {'spread':>8}"]
        for p in own:
            marks = ["*"] if id(p) in front else []
            marks += ["<- now"] if p.current else []
            marks += ["cheapest for the target"] if p is best else []
            marks += [p.note] if p.note else []
            times = f"{1e3 * p.seconds:10.3f} {1e3 * p.spread:8.3f}"
            lines.append(f"  {p.method:<{width}}  {p.value:<14} {p.error:8.1e}  {times}  {' '.join(marks)}".rstrip())
    return lines


def _answer(points: Sequence[PrecisionPoint], target: float | None) -> list[str]:
    """The quickest value of every setting that reaches the target, as lines of text; empty without a target."""
    if target is None:
        return []
    lines = ["", f"cheapest settings that reach {target:g}"]
    for setting in dict.fromkeys(p.setting for p in points):
        best = cheapest([p for p in points if p.setting == setting], target)
        words = "none of these" if best is None else f"{best.method}, {best.value}: error {best.error:.1e} in {best.time_text}"
        lines.append(f"  {setting:<22} {words}")
    return lines


def effects(
    scene: SceneArg,
    values: SetOpt = None,
    accuracy: Annotated[float, typer.Option("--accuracy", "-a", metavar="ERROR", help="relative change that counts")] = 0.01,
    quick: QuickOpt = False,
) -> None:
    """Measure what each effect and load does to the answer, beside its price in time; suggest those worth having.

    Each is left out, or added where the scene has what it needs, and everything is computed again: change of the peak effort and of
    the largest reaction, largest change at any frame, of the speed's fluctuation where forces decide the motion.
    """
    if not 0.0 < accuracy < 1.0:
        fail(f"--accuracy: {accuracy:g} is no relative change. Give a number between 0 and 1, such as 0.01.")
    with clear_errors(scene):
        loaded = load_scene(scene, values)
        with progress_bar("measuring") as bar:
            base, every = influences(loaded, bar, 0.02 if quick else 0.2)
        print(f"{loaded.title}: what its effects do and cost")
        print("\n".join(influence_lines(base, every, accuracy)))
        print(f"\nmeasured on {machine()}; one thread, medians")


def hard(
    only: Annotated[str | None, typer.Option("--only", metavar="FAMILY", help=f"one family: {', '.join(CASE_FAMILIES)}")] = None,
    json: Annotated[bool, typer.Option("--json", help="the outcomes as JSON, every check with its error and bound")] = False,
) -> None:
    """Run the suite of hard cases: what happens there, what is expected, what is found; exit code 1 where one fails.

    Singular positions, benchmarks at which other programs fail, undercut cams, jams, stick-slip, impacts, chaos, careless input.
    Each expectation is computed apart from the program: a closed form, a balance, another method.
    """
    if only is not None and only not in CASE_FAMILIES:
        fail(f"--only: '{only}' is no family. Choose from {', '.join(CASE_FAMILIES)}.")
    cases = all_cases(only)
    results = []
    with clear_errors("hard"):
        with progress_bar("hard cases") as bar:
            for k, case in enumerate(cases):
                bar(k, len(cases))
                results.append((case, case.run()))
        if json:
            print(json_text.dumps(as_data(results), indent=2, ensure_ascii=False))
        else:
            print(case_table(results, shutil.get_terminal_size((160, 40)).columns))
            print(summary(results))
    if not all(outcome.passed for _, outcome in results):
        raise typer.Exit(1)
