"""``mechviz sweep``: what becomes of quantities where parameters vary."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from mechviz.commands.common import check_targets, fail, interruptible, progress_bar, say
from mechviz.commands.loading import SceneArg, SetOpt, clear_errors, load_scene
from mechviz.commands.solving import CyclesOpt, DaskOpt, FramesOpt, JobsOpt, workers
from mechviz.figures import check_ending, save_chart
from mechviz.files import check_target
from mechviz.studies.designs.evaluate import study_of
from mechviz.studies.designs.figures import Kind, read_study, study_chart
from mechviz.studies.designs.measures import parse_measure
from mechviz.studies.designs.sampling import grid, parse_sample, parse_variation, sampled
from mechviz.studies.designs.sweep import Store, Table, about_study, columns_of, csv_lines, run_study

KEPT = "Interrupted: what was found is kept; the same command goes on with the rest."


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
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    values: SetOpt = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="begin anew where the study was begun")] = False,
) -> None:
    """Compute quantities of many designs: a grid, lists or samples of a scene's parameters, one row for each design.

    A design that cannot be assembled is a row with its reason. What is interrupted goes on where it was, if the command is given
    again. The quantities are those of the viewer and of exports; a key without a reducer gives the whole curve.

    Try: mechviz sweep parametric-press --vary "stroke=60..100mm:5" --of drive.A.torque:max --of joint.B.reaction:peak
    """
    if output is not None and output.suffix != ".parquet":
        fail(f"--output: '{output}' does not end in .parquet.")
    with clear_errors(scene):
        if output is not None:
            check_targets(scene, output)
            check_target(output)
        loaded = load_scene(scene, values)
        variations = [parse_variation(loaded, text) for text in vary]
        chosen = None if sample is None else parse_sample(sample, seed)
        designs = grid(variations) if chosen is None else sampled(variations, chosen)
        study = study_of(loaded, variations, [parse_measure(loaded, text) for text in of], frames=frames, cycles=cycles)
        with interruptible("pyarrow.parquet"):
            store = None if output is None else Store(output, about_study(study, chosen))
            if store is not None:
                store.open(fresh=fresh)
            try:
                with progress_bar("sweeping") as bar, workers(jobs, dask) as (executor, most):
                    table = run_study(study, designs, store, executor=executor, most=most, progress=bar)
            except BrokenProcessPool:
                fail("A process of the study has died, perhaps for lack of memory. The same command goes on; take fewer --jobs.", 1)
            except (KeyboardInterrupt, SystemExit) as end:
                if store is not None:
                    end.add_note(KEPT)
                raise
        if output is None:
            print("\n".join(csv_lines(table)))
        else:
            print(output)
        say("\n".join(_summary(table)))


def _summary(table: Table) -> Iterator[str]:
    """How many designs there are, and between which values each number lies."""
    ok = table.feasible
    yield f"{int(ok.sum())} of {len(ok)} designs have values." + ("" if ok.all() else " The others say why in the column 'reason'.")
    for title, values in zip(columns_of(table.study), table.found.values, strict=True):
        if values.ndim == 1 and ok.any():
            for word, k in (("least", int(np.nanargmin(values))), ("greatest", int(np.nanargmax(values)))):
                where = ", ".join(f"{v.title} = {x:.6g}" for v, x in zip(table.study.variations, table.designs[k], strict=True))
                yield f"{title}: {word} {values[k]:.6g} at {where}"


def study(
    file: Annotated[Path, typer.Argument(metavar="FILE.parquet", help="study that mechviz sweep has written")],
    output: Annotated[Path, typer.Option("--output", "-o", help="chart to write (.svg, .png or .pdf)")],
    of: Annotated[str | None, typer.Option("--of", metavar="QUANTITY", help="the result to draw [default: the first]")] = None,
    kind: Annotated[
        Kind,
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
        check_target(output)
        check_ending(output)
        with interruptible("pyarrow.parquet", "matplotlib.figure"):
            save_chart(study_chart(read_study(file), kind, of), output)
        print(output)
