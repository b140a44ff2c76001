"""``mechviz sensitivity``: what parameters of a design do."""

from __future__ import annotations

import csv
from io import StringIO
from pathlib import Path
from typing import Annotated

import typer

from mechviz.commands.common import aligned, check_targets, interruptible
from mechviz.commands.loading import SceneArg, SetOpt, clear_errors, load_scene
from mechviz.commands.solving import CyclesOpt, FramesOpt, solve
from mechviz.figures import check_ending, save_chart
from mechviz.files import check_target, replacing
from mechviz.studies.designs.measures import parse_measure
from mechviz.studies.designs.sensitivity import sensitivities, tornado
from mechviz.studies.designs.variables import variables_of

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
        for target in filter(None, (plot, csv_file)):
            check_target(target)
        if plot is not None:
            check_ending(plot)
        loaded = load_scene(scene, values)
        measures = [parse_measure(loaded, text) for text in of]
        variables = variables_of(loaded, by or ())
        with interruptible(*(["matplotlib.figure"] if plot is not None else [])):
            run = solve(loaded, frames, cycles)
            found = sensitivities(run, measures, variables)
            for one in found:
                value = f" = {one.number:.6g} {one.quantity.unit}" if one.measure.reducer else ""
                print(f"{one.measure.text}{value}")
                print("\n".join(f"  {line}" for line in aligned(one.rows())))
            if plot is not None:
                save_chart(tornado(found[0], loaded.title), plot)
                print(plot)
            if csv_file is not None:
                stream = StringIO()
                writer = csv.writer(stream, lineterminator="\n")
                of_slopes = [
                    f"d {one.measure.key} / d {v.name} [{one.quantity.unit}/{v.unit or '1'}]" for one in found for v in variables
                ]
                writer.writerow(["time [s]", *(f"{one.measure.key} [{one.quantity.unit}]" for one in found), *of_slopes])
                columns = [run.motion.time, *(one.curve for one in found), *(d for one in found for d in one.slopes)]
                writer.writerows(zip(*(map(repr, map(float, column)) for column in columns), strict=True))
                with replacing(csv_file) as temporary:
                    temporary.write_text(stream.getvalue(), encoding="utf-8")
                print(csv_file)
