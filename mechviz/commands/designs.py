"""``mechviz sweep``, ``sensitivity``, ``optimise`` and ``tolerances``: studies of many designs of a scene."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from mechcore.arrays import Real
from mechviz.commands.shared.loading import SceneArg, SetOpt, clear_errors, load_scene
from mechviz.commands.shared.messages import aligned_rows, check_suffix, check_targets, fail, interruptible, say
from mechviz.commands.shared.solving import (
    CyclesOpt,
    DaskOpt,
    DesignExecutorOpt,
    FramesOpt,
    JobsOpt,
    compiler_checked,
    solve,
    workers,
)
from mechviz.editor.saving import saved_scene
from mechviz.figures import check_ending, save_chart
from mechviz.files import OutputError, replacing
from mechviz.progress import duration, progress_bar
from mechviz.quantities.catalogue import Axis
from mechviz.scene.scene import dump, load
from mechviz.studies.designs.evaluate import Study, expected_seconds, study_of
from mechviz.studies.designs.figures import FigureKind, read_study, study_chart
from mechviz.studies.designs.measures import parse_measure
from mechviz.studies.designs.optimise import Search, front_chart
from mechviz.studies.designs.optimise import optimise as find_best
from mechviz.studies.designs.problem import problem_of, violation_words
from mechviz.studies.designs.sampling import grid, parse_sample, parse_variation, sampled
from mechviz.studies.designs.sensitivity import sensitivities, tornado
from mechviz.studies.designs.sweep import DesignTable, Store, about_study, csv_lines, measure_columns, run_study
from mechviz.studies.designs.tolerance import Distribution, Tolerances, parse_limits, tolerance_chart, toleranced, tolerances
from mechviz.studies.designs.variables import variables_of

LEAST_FORECAST = 32  # number of designs from which on one run to estimate their time is a small part of it
LONG_STUDY = 10.0  # [s] expected time from which on it is reported before a study starts
INTERRUPTED = "Interrupted: what was found is kept; the same command goes on with the rest."


def sweep(
    scene: SceneArg,
    vary: Annotated[
        list[str],
        typer.Option("--vary", metavar="NAME=LOW..HIGH:N", help="a parameter and its values: r=30..60mm:31, r=30mm,40mm or r:31"),
    ],
    of: Annotated[
        list[str],
        typer.Option("--of", metavar="QUANTITY", help="KEY, or KEY:max, min, peak, mean, rms, range, 'at 60 deg'"),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="study to write or to go on with (.parquet) [default: CSV to stdout]")
    ] = None,
    sample: Annotated[
        str | None, typer.Option("--sample", metavar="lhs:N|sobol:N", help="designs that fill the ranges, instead of a grid")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="of the sample")] = 0,
    jobs: JobsOpt = 1,
    dask: DaskOpt = None,
    executor: DesignExecutorOpt = "auto",
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    values: SetOpt = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="begin anew where the study was begun")] = False,
) -> None:
    """Compute quantities of many designs: a grid, lists or samples of a scene's parameters, one row for each design.

    A design that cannot be assembled is a row with its reason. An interrupted sweep continues where it stopped, if the command is
    given again. The quantities are those of the viewer and of exports; a key without a reducer gives the whole curve.

    Try: mechviz sweep parametric-press --vary "stroke=60..100mm:5" --of drive.A.torque:max --of joint.B.reaction:peak
    """
    check_suffix(output, ".parquet")
    if sample is None and seed != 0:
        fail("--seed is for --sample: a grid has nothing random.")
    with clear_errors(scene):
        check_targets(scene, output)
        loaded = load_scene(scene, values, targets=(output,))
        variations = [parse_variation(loaded, text) for text in vary]
        chosen = None if sample is None else parse_sample(sample, seed)
        designs = grid(variations) if chosen is None else sampled(variations, chosen)
        measures = [parse_measure(loaded, text) for text in of]
        how = compiler_checked(executor)
        study = study_of(loaded, variations, measures, frames=frames, cycles=cycles, executor=how, count=len(designs))
        with interruptible("pyarrow.parquet"), ExitStack() as last:
            store = None if output is None else Store(output, about_study(study, chosen))
            if store is not None:
                last.callback(store.close)
                store.open(fresh=fresh)
            try:
                with progress_bar("sweeping") as bar, workers(jobs, dask) as (pool, most):
                    _say_how_long("--jobs N takes N processes", most // 2, study, len(designs) - len(store.done if store else ()))
                    table = run_study(study, designs, store, executor=pool, most=most, progress=bar)
            except BrokenProcessPool:
                fail("A process of the study has died, perhaps for lack of memory. The same command goes on; take fewer --jobs.", 1)
            except (KeyboardInterrupt, SystemExit) as end:
                if store is not None:
                    end.add_note(INTERRUPTED)
                raise
        if output is None:
            print("\n".join(csv_lines(table)))
        else:
            print(output)
        say("\n".join(_summary(table)))
        say(f"Computed by {study.computed_by}.")


def _say_how_long(remedy: str, at_once: int, study: Study, count: int) -> None:
    """Report the number of remaining designs of a study and their expected time, where each is run singly and the time is long."""
    seconds = expected_seconds(study, count) / at_once if count >= LEAST_FORECAST else 0.0
    if seconds >= LONG_STUDY:
        say(f"{count:,} designs are run one by one, which takes about {duration(seconds)}. {remedy}.")


def _summary(table: DesignTable) -> Iterator[str]:
    """Number of designs with values, and the least and greatest value of each number, as lines of text."""
    ok = table.feasible
    yield f"{int(ok.sum())} of {len(ok)} designs have values." + ("" if ok.all() else " The others say why in the column 'reason'.")
    for title, values in zip(measure_columns(table.study), table.results.values, strict=True):
        if values.ndim == 1 and ok.any():
            for word, k in (("least", int(np.nanargmin(values))), ("greatest", int(np.nanargmax(values)))):
                where = ", ".join(f"{v.title} = {x:.6g}" for v, x in zip(table.study.variations, table.designs[k], strict=True))
                yield f"{title}: {word} {values[k]:.6g} at {where}"


def study(
    file: Annotated[Path, typer.Argument(metavar="FILE.parquet", help="study that mechviz sweep has written")],
    output: Annotated[Path, typer.Option("--output", "-o", help="chart to write (.svg, .png or .pdf)")],
    of: Annotated[str | None, typer.Option("--of", metavar="QUANTITY", help="the result to draw [default: the first]")] = None,
    kind: Annotated[
        FigureKind,
        typer.Option("--kind", help="auto: the response to one parameter, contours of two, parallel coordinates of more"),
    ] = "auto",
) -> None:
    """Draw a study: the response to a parameter, contours, parallel coordinates or a scatter matrix.

    Designs without values are marked, so that the limits of what can be built are seen.

    Try: mechviz sweep parametric-press --vary stroke:9 --vary ratio:9 --of drive.A.torque:peak -o study.parquet
         mechviz study study.parquet -o contour.svg
    """
    with clear_errors(str(file)):
        check_targets(str(file), output)
        check_ending(output)
        with interruptible("pyarrow.parquet", "matplotlib.figure"):
            save_chart(study_chart(read_study(file), kind, of), output)
        print(output)


ByOpt = Annotated[
    list[str] | None,
    typer.Option("--by", metavar="NAME", help="a parameter, or a number of the scene by its place: links.crank.points.B[0]"),
]
OfOpt = Annotated[
    list[str], typer.Option("--of", metavar="QUANTITY", help="KEY, or KEY:max, min, peak, mean, rms, range, 'at 60 deg'")
]


def sensitivity(
    scene: SceneArg,
    of: OfOpt,
    by: ByOpt = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="write a tornado chart of the first (.svg, .png or .pdf)")] = None,
    csv_file: Annotated[Path | None, typer.Option("--csv", help="write the derivatives at every frame as a table")] = None,
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    values: SetOpt = None,
) -> None:
    """Print how quantities depend on parameters, ranked by what one percent of each does: exact derivatives, no trial runs.

    Without --by all parameters of the scene that stand for themselves, or where it has none, the numbers of its links and loads.
    A key without a reducer is looked at over the whole run; the table then has the largest derivative.

    Try: mechviz sensitivity parametric-press --of drive.A.torque:max --of joint.B.reaction:peak --plot tornado.svg
    """
    with clear_errors(scene):
        check_targets(scene, plot, csv_file)
        if plot is not None:
            check_ending(plot)
        loaded = load_scene(scene, values, targets=(plot, csv_file))
        measures = [parse_measure(loaded, text) for text in of]
        variables = variables_of(loaded, by or ())
        with interruptible(*(["matplotlib.figure"] if plot is not None else [])):
            run = solve(loaded, frames, cycles)
            results = sensitivities(run, measures, variables)
            for one in results:
                value = f" = {one.number:.6g} {one.quantity.unit}" if one.measure.reducer else ""
                print(f"{one.measure.text}{value}")
                print("\n".join(f"  {line}" for line in aligned_rows(one.rows())))
            if plot is not None:
                save_chart(tornado(results[0], loaded.title), plot)
                print(plot)
            if csv_file is not None:
                slopes = [
                    f"d {one.measure.key} / d {v.name} [{one.quantity.unit}/{v.unit or '1'}]" for one in results for v in variables
                ]
                heads = ["time [s]", *(f"{one.measure.key} [{one.quantity.unit}]" for one in results), *slopes]
                columns = [run.motion.time, *(one.curve for one in results), *(d for one in results for d in one.slopes)]
                write_columns(csv_file, heads, columns)
                print(csv_file)


def tolerance(
    scene: SceneArg,
    of: OfOpt,
    stated: Annotated[
        list[str] | None,
        typer.Option("--tolerance", "-t", metavar="NAME=VALUE", help="of a parameter or number [default: those of the scene]"),
    ] = None,
    limits: Annotated[
        list[str] | None,
        typer.Option("--limits", metavar="LOW..HIGH", help="of the quantities in order, in their units; one end may be left out"),
    ] = None,
    samples: Annotated[int, typer.Option("--samples", min=16, max=2**24, help="designs of the sample, a power of two")] = 16384,
    distribution: Annotated[
        Distribution, typer.Option("--distribution", help="of parts within their tolerances; normal: three standard deviations")
    ] = "normal",
    seed: Annotated[int, typer.Option("--seed", min=0, help="of the sample")] = 0,
    plot: Annotated[
        Path | None, typer.Option("--plot", help="write a chart of the first: its band, or its distribution (.svg, .png or .pdf)")
    ] = None,
    csv_file: Annotated[Path | None, typer.Option("--csv", help="write the bands of curves over the frames as a table")] = None,
    jobs: JobsOpt = 1,
    dask: DaskOpt = None,
    executor: DesignExecutorOpt = "auto",
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    values: SetOpt = None,
) -> None:
    """Print what tolerances do to quantities: worst case, root sum of squares and samples, and what each tolerance contributes.

    A key without a reducer is followed over the whole cycle: a band about its curve, stated where it is widest. Tolerances are
    those of the scene's parameters, or given here, also of numbers by their places.

    Try: mechviz tolerance parametric-press --of drive.A.torque:peak -t ratio=0.02 -t force=0.1kN --limits ..118 --plot band.svg
    """
    with clear_errors(scene):
        check_targets(scene, plot, csv_file)
        if plot is not None:
            check_ending(plot)
        loaded = load_scene(scene, values, targets=(plot, csv_file))
        measures = [parse_measure(loaded, text) for text in of]
        variables = toleranced(loaded, stated or ())
        ends = [parse_limits(text) for text in limits or ()]
        if csv_file is not None and all(measure.reducer for measure in measures):
            raise OutputError(f"'{csv_file}': no curve is asked for.", "Leave the reducer of a quantity out.")
        with interruptible(*(["matplotlib.figure"] if plot is not None else [])):
            run = solve(loaded, frames, cycles)
            remedy = "--jobs N takes N processes, --samples N fewer designs"
            with progress_bar("sampling") as bar, workers(jobs, dask) as (pool, most):
                results = tolerances(
                    run, measures, variables, limits=ends, samples=samples, distribution=distribution, seed=seed,
                    executor=pool, most=most, begin=partial(_say_how_long, remedy, most // 2), progress=bar,
                    program=compiler_checked(executor),
                )  # fmt: skip
            say(f"Samples computed by {results[0].computed_by}.")
            axis = run.catalogue.axes[0]
            for one in results:
                where = "" if one.at is None else f", widest at: {axis.label} = {axis.values[one.at]:.5g} {axis.unit}"
                print(f"{one.measure.text}{where}")
                print("\n".join(f"  {line}" for line in [*aligned_rows(one.lines()), *aligned_rows(one.rows())]))
                if one.curve:
                    print("\n".join(f"  {line}" for line in aligned_rows(one.band(axis))))
                if not one.exact:
                    say(f"note: {one.measure.text} has no exact derivatives here: contributions are fitted to the samples.")
            if plot is not None:
                save_chart(tolerance_chart(results[0], loaded.title, axis), plot)
                print(plot)
            if csv_file is not None:
                _write_bands(csv_file, axis, results)
                print(csv_file)


def optimise(
    scene: SceneArg,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="scene to write (.toml)")] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="of the search: the same one finds the same")] = 0,
    population: Annotated[
        int | None,
        typer.Option("--population", min=5, max=100_000, help="designs in a generation [default: 12 a variable, at least 32]"),
    ] = None,
    generations: Annotated[int, typer.Option("--generations", min=0, max=100_000, help="of differential evolution, at most")] = 60,
    points: Annotated[int, typer.Option("--points", min=3, max=1000, help="of the front of several objectives")] = 9,
    front: Annotated[Path | None, typer.Option("--front", help="several objectives: write the front as a table (.csv)")] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", help="several objectives: write a chart of the front (.svg, .png or .pdf)")
    ] = None,
    jobs: JobsOpt = 1,
    dask: DaskOpt = None,
    executor: DesignExecutorOpt = "auto",
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    values: SetOpt = None,
) -> None:
    """Find the design that a scene's goal asks for, and write it as a scene.

    The goal stands in the scene: [goal] with what to minimise, maximise or follow, and limits; parameters vary within their ranges.
    The search looks all over them, then goes along exact derivatives where there are some. Ctrl-C ends it with the best so far.

    Try: mechviz optimise parametric-press -o better.toml
    """
    check_suffix(output, ".toml")
    with clear_errors(scene):
        check_targets(scene, output, front, plot)
        if plot is not None:
            check_ending(plot)
        loaded = load_scene(scene, values, targets=(output, front, plot))
        opened = load(scene) if values else loaded
        problem = problem_of(
            loaded,
            frames=frames,
            cycles=cycles,
            executor=compiler_checked(executor),
            population=population or 0,
            generations=generations,
        )
        if (front is not None or plot is not None) and len(problem.terms) < 2:
            fail("--front, --plot: the goal has one objective only, and so no front.")
        with interruptible("scipy.optimize", "scipy.stats", *(["matplotlib.figure"] if plot is not None else [])):
            with progress_bar("optimising") as bar, workers(jobs, dask) as (pool, _):
                reached = "samples"

                def report(stage: str, objective: int, value: float, violation: float) -> None:
                    nonlocal reached
                    reached = f"{stage}: {violation_words(violation) or problem.terms[objective].shown(value)}"
                    bar.stage(reached)

                def advance(done: int, total: int) -> None:
                    bar.stage(f"{reached}; {done} of {total} designs")

                search = Search(problem, seed, population or 0, generations, pool, report, advance)
                best = find_best(search, points=points)
            print("\n".join(aligned_rows(best.lines())))
            say(f"{search.evaluations} designs were looked at, computed by {problem.study.computed_by}.")
            if search.refused:
                say(f"note: no steps along derivatives were taken: {search.refused}")
            if output is not None:
                dump(saved_scene(opened, best.scene)[0], output, keep=True)
                print(output)
            if plot is not None:
                save_chart(front_chart(best, loaded.title), plot)
                print(plot)
            if front is not None:
                objectives = problem.score(best.front).objectives
                heads = [f"{t.text} [{t.unit}]" for t in problem.terms] + [v.title for v in problem.variables]
                write_columns(
                    front, heads, [*(t.sign * x for t, x in zip(problem.terms, objectives.T, strict=True)), *best.front.T]
                )
                print(front)
    if search.interrupted:
        say("Interrupted: this is the best design so far.")
        raise typer.Exit(130)


def _write_bands(path: Path, axis: Axis, results: list[Tolerances]) -> None:
    """Write the bands of curves over the frames as CSV. Raises `OutputError`."""
    heads, columns = [axis.title], [axis.values]
    for one in (one for one in results if one.curve):
        heads += [f"{one.measure.text}: {word} [{one.quantity.unit}]" for word in ("nominal", "worst ±", "rss ±", "mean", "sigma")]
        heads += [f"{one.measure.text}: {word} [{one.quantity.unit}]" for word in ("0.135 %", "99.865 %")]
        columns += [one.nominal, one.worst, one.root_sum_square, one.mean, one.sigma, *one.tails]
    write_columns(path, heads, columns)


def write_columns(path: Path, heads: list[str], columns: list[Real]) -> None:
    """Write columns of numbers as CSV. The file is replaced as a whole."""
    stream = StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows(zip(*(map(repr, map(float, column)) for column in columns), strict=True))
    with replacing(path) as temporary:
        temporary.write_text(stream.getvalue(), encoding="utf-8")
