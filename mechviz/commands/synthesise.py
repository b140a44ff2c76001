"""``mechviz synthesise``: scenes from tasks. One command a task; each prints its solutions and writes them as scenes."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import typer

from mechcore.arrays import Real
from mechcore.design.burmester import Poses, burmester_curve
from mechcore.design.chains import kinematic_chains
from mechcore.design.freudenstein import FunctionTask, chebyshev_points, fitted_generator, generators
from mechcore.design.paths import PathTask, path_designs
from mechcore.design.strokes import best_crank_rocker, best_slider_crank, slider_crank, slotted_lever
from mechviz.commands.common import fail, interruptible, say
from mechviz.commands.loading import clear_errors
from mechviz.figures import check_ending, save_chart
from mechviz.files import check_target, read_regular
from mechviz.scene.expressions import Amount, parse_expression
from mechviz.scene.units import QuantityError, Units
from mechviz.studies.synthesis import figures
from mechviz.studies.synthesis.chains import chain_solutions
from mechviz.studies.synthesis.four_bars import (
    dyads,
    function_solutions,
    motion_designs,
    motion_solutions,
    path_solutions,
    ranked_paths,
)
from mechviz.studies.synthesis.solutions import Solution, check_folder, table, write
from mechviz.studies.synthesis.strokes import (
    crank_rocker_solution,
    slider_crank_solution,
    slotted_lever_solution,
    straight_line_solutions,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNITS = Units(length="mm", angle="deg")
LARGEST_FILE = 1 << 20  # bytes of a file of points
NEGATIVE = {"ignore_unknown_options": True}  # -5,0 is a place

OutputOpt = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="FOLDER|FILE.toml", help="write all solutions as scenes, or the first"),
]
PlotOpt = Annotated[Path | None, typer.Option("--plot", help="write a chart (.svg, .png or .pdf)")]
MostOpt = Annotated[int, typer.Option("--most", min=1, max=1000, help="solutions that are shown")]

synthesise = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
    help="Find mechanisms for a task: a function, positions of a body, a path, a stroke, a straight line; "
    "or list kinematic chains.\n\n"
    "Every solution is a line with its numbers and defects, and with -o FOLDER a scene: mechviz view FOLDER/motion-1.toml. "
    "Bare numbers are mm and degrees.",
)


@synthesise.command()
def function(
    expression: Annotated[str, typer.Argument(metavar="FUNCTION", help='what the output follows, such as "1/x" or "tan(x)"')],
    start: Annotated[str, typer.Option("--from", help="where x begins; tan(x) wants an angle, 0 deg")],
    end: Annotated[str, typer.Option("--to", help="where x ends")],
    input_range: Annotated[str, typer.Option("--crank", help="angle by which the crank turns meanwhile, negative: clockwise")],
    output_range: Annotated[str, typer.Option("--rocker", help="angle by which the rocker turns meanwhile")],
    points: Annotated[int, typer.Option(min=3, max=1000, help="precision points; more than 5: least squares")] = 3,
    input_start: Annotated[
        str | None, typer.Option("--crank-start", help="crank angle at the start; with 5 points it follows")
    ] = None,
    output_start: Annotated[
        str | None, typer.Option("--rocker-start", help="rocker angle at the start; with 4 or 5 points it follows")
    ] = None,
    frame: Annotated[str, typer.Option(help="length of the frame")] = "100 mm",
    spacing: Annotated[Literal["chebyshev", "even"], typer.Option(help="how the points are spaced")] = "chebyshev",
    free: Annotated[bool, typer.Option("--free", help="more than 5 points: fit the start angles, too")] = False,
    output: OutputOpt = None,
    plot: PlotOpt = None,
) -> None:
    """Find four-bars whose rocker angle follows a function of the crank angle (Freudenstein's equation).

    3 points: both start angles are given. 4 points: that of the crank, two solutions. 5 points: neither, all solutions. More:
    least squares of the structural error.

    Try: mechviz synthesise function "1/x" --from 1 --to 2 --crank 90 --rocker -90 --points 4 --crank-start 30
    """
    with clear_errors("function"):
        _check(output, plot)
        task = FunctionTask(*_function(expression, start, end), _angle(input_range, "crank"), _angle(output_range, "rocker"))
        starts = tuple(
            None if text is None else _angle(text, name)
            for text, name in ((input_start, "crank-start"), (output_start, "rocker-start"))
        )
        if spacing == "chebyshev" and points <= 5:
            x = chebyshev_points(task.start, task.end, points)
        else:
            x = np.linspace(task.start, task.end, points)
        if points > 5:
            if starts[0] is None or starts[1] is None:
                fail("--crank-start, --rocker-start: a fit of many points begins from both. Give them.")
            found = [fitted_generator(task, x, starts[0], starts[1], refine=True, starts_too=free)]
        else:
            found = generators(task, x, *starts)
        if not found:
            fail("No four-bar meets these points. Give other start angles, or other ranges of input and output.")
        solutions = function_solutions(task, found, _length(frame, "frame"), expression)
        _give(solutions, output, plot, lambda: figures.error_figure(task, found, expression))


@synthesise.command(context_settings=NEGATIVE)
def motion(
    positions: Annotated[
        list[str],
        typer.Argument(metavar="X,Y,ANGLE...", help="positions of the body in order; or one CSV file with a row for each"),
    ],
    moving: Annotated[
        list[str] | None, typer.Option("--moving", metavar="X,Y", help="a pivot of the body, in position 1; again")
    ] = None,
    fixed: Annotated[
        list[str] | None, typer.Option("--fixed", metavar="X,Y", help="a pivot of the frame (3 positions); again")
    ] = None,
    swing: Annotated[str, typer.Option(help="angle by which cranks turn between 2 positions")] = "60 deg",
    most: MostOpt = 10,
    output: OutputOpt = None,
    plot: PlotOpt = None,
) -> None:
    """Find four-bars that lead a body through 2, 3, 4, 5 or more positions (Burmester).

    2 and 3 positions: with --moving or --fixed pivots, or the best of many. 4: the best pairs on Burmester's curves. 5: all
    solutions. More: least squares. Each is judged for defects of branch, circuit and order.

    Try: mechviz synthesise motion 0,0,0 30,15,20 60,20,45 75,10,70 --plot curves.svg -o found
    """
    with clear_errors("positions"):
        _check(output, plot)
        rows = _rows(positions, 3, "position")
        poses = Poses(rows[:, 0] + 1j * rows[:, 1], rows[:, 2])
        pivots = [_pairs(given) for given in (moving, fixed)]
        in_body = [(z - complex(poses.places[0])) / complex(poses.turns[0]) for z in pivots[0]]
        w, c = dyads(poses, in_body, pivots[1], _angle(swing, "swing"))
        named = bool(moving or fixed)
        found = motion_designs(poses, w, c, most, all_of_them=named or len(rows) >= 5)
        curve = burmester_curve(poses) if len(rows) == 4 else None
        _give(motion_solutions(poses, found), output, plot, lambda: figures.motion_figure(poses, found, curve))


@synthesise.command(context_settings=NEGATIVE)
def path(
    points: Annotated[list[str], typer.Argument(metavar="X,Y...", help="points in order; or one CSV file with a row for each")],
    step: Annotated[str | None, typer.Option(help="crank angle from point to point [default: free]")] = None,
    angles: Annotated[str | None, typer.Option(metavar="A,B,...", help="crank angles since the first point, one for each")] = None,
    start: Annotated[str | None, typer.Option(help="crank angle from the frame line at the first point [default: free]")] = None,
    pivot: Annotated[str | None, typer.Option(metavar="X,Y", help="the crank's pivot [default: free]")] = None,
    frame_angle: Annotated[str | None, typer.Option(help="direction from there to the rocker's pivot [default: free]")] = None,
    shortest: Annotated[str, typer.Option(help="least length of a link")] = "0 mm",
    longest: Annotated[str | None, typer.Option(help="greatest length of a link")] = None,
    farthest: Annotated[
        str | None, typer.Option(help="greatest coordinate of the crank's pivot, and of the point in the coupler")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="of the designs that are tried")] = 0,
    screened: Annotated[
        int, typer.Option(min=100, max=10_000_000, help="designs that are tried for each branch and sense")
    ] = 20_000,
    most: MostOpt = 6,
    output: OutputOpt = None,
    plot: PlotOpt = None,
) -> None:
    """Find crank-rockers whose coupler point passes points, at stated crank angles or at any in their order.

    The first point again at the end closes the path. Random designs are screened, the best refined by least squares in all
    lengths and angles; the same seed gives the same solutions.

    Try: mechviz synthesise path 20,20 20,25 20,30 20,35 20,40 20,45 --shortest 5 --longest 60 --plot path.svg
    """
    with clear_errors("points"):
        _check(output, plot)
        rows = _rows(points, 2, "point")
        if step is not None and angles is not None:
            fail("--step and --angles both say when the points are passed. Give one of them.")
        steps: Real | None = None
        if step is not None:
            steps = _angle(step, "step") * np.arange(float(len(rows)))
        elif angles is not None:
            steps = np.array([_angle(word, "angles") for word in angles.split(",")])
        elif start is not None:
            fail("--start needs --step or --angles.")
        task = PathTask(
            rows[:, 0] + 1j * rows[:, 1],
            steps,
            None if start is None else _angle(start, "start"),
            None if pivot is None else _pairs([pivot])[0],
            None if frame_angle is None else _angle(frame_angle, "frame-angle"),
            (_length(shortest, "shortest"), np.inf if longest is None else _length(longest, "longest")),
            np.inf if farthest is None else _length(farthest, "farthest"),
            (1, -1) if start is None else (1,),
        )
        with interruptible():
            found = ranked_paths(path_designs(task, seed, screened), task.points)[:most]
        if not found:
            fail("No crank-rocker passes the points in their order. Try another --seed, more --screened, or wider bounds.")
        _give(path_solutions(found, task.points), output, plot, lambda: figures.path_figure(task.points, found))


@synthesise.command()
def stroke(
    length: Annotated[str, typer.Argument(metavar="STROKE", help="travel of the slider or of the lever's end")],
    ratio: Annotated[float, typer.Option(help="time out over time back at constant speed of the crank, above one")],
    offset: Annotated[str | None, typer.Option(help="of the slide from the crank's pivot [default: least pressure angle]")] = None,
    frame: Annotated[str | None, typer.Option(help="a slotted lever instead, with pivots so far apart")] = None,
    output: OutputOpt = None,
) -> None:
    """Find the slider-crank, or the slotted lever, of a stroke and a time ratio (quick return).

    Try: mechviz synthesise stroke 200 --ratio 1.2 -o press.toml
    """
    with clear_errors("stroke"):
        _check(output, None)
        travel = _length(length, "stroke")
        if frame is not None:
            if offset is not None:
                fail("--offset is for slider-cranks. Leave it out, or --frame.")
            solution = slotted_lever_solution(slotted_lever(travel, ratio, _length(frame, "frame")), travel, ratio)
        elif offset is not None:
            solution = slider_crank_solution(slider_crank(travel, ratio, _length(offset, "offset")), travel, ratio)
        else:
            solution = slider_crank_solution(best_slider_crank(travel, ratio), travel, ratio)
        _give([solution], output, None, None)


@synthesise.command()
def swing(
    angle: Annotated[str, typer.Argument(metavar="SWING", help="angle between the rocker's ends")],
    ratio: Annotated[float, typer.Option(help="time out over time back at constant speed of the crank, above one")],
    rocker: Annotated[str, typer.Option(help="length of the rocker")] = "100 mm",
    output: OutputOpt = None,
) -> None:
    """Find the crank-rocker of a swing and a time ratio whose least transmission angle is greatest (Alt, VDI 2130).

    Try: mechviz synthesise swing 40 --ratio 1.1176
    """
    with clear_errors("swing"):
        _check(output, None)
        wanted = _angle(angle, "swing")
        _give(
            [crank_rocker_solution(best_crank_rocker(wanted, ratio, _length(rocker, "rocker")), wanted, ratio)], output, None, None
        )


@synthesise.command()
def line(
    names: Annotated[list[str] | None, typer.Argument(metavar="[NAME]...", help="watt, chebyshev, roberts, hoecken, evans")] = None,
    travel: Annotated[str, typer.Option(help="travel of the point along its line")] = "100 mm",
    straight: Annotated[
        str | None, typer.Option("--range", help="crank range in which Hoecken's linkage is to be straightest")
    ] = None,
    output: OutputOpt = None,
) -> None:
    """Print straight-line linkages of a travel with the width of their path, the well-known ones or Hoecken's best proportions.

    Try: mechviz synthesise line hoecken --range 140 --travel 80 -o hoecken.toml
    """
    with clear_errors("line"):
        _check(output, None)
        wanted = None if straight is None else _angle(straight, "range")
        _give(straight_line_solutions(list(names or ()), _length(travel, "travel"), wanted), output, None, None)


@synthesise.command()
def chains(
    links: Annotated[int, typer.Argument(metavar="LINKS", min=4, max=9, help="how many links")],
    freedom: Annotated[int, typer.Option(min=1, max=6, help="degrees of freedom with one link held")] = 1,
    output: OutputOpt = None,
    plot: PlotOpt = None,
) -> None:
    """List the kinematic chains of so many links with revolute joints, and their inversions; sketch them.

    With -o FOLDER every inversion of one degree of freedom is a scene, driven as far as it goes.

    Try: mechviz synthesise chains 6 --plot chains.svg -o chains
    """
    with clear_errors("chains"):
        _check(output, plot)
        if output is not None and freedom != 1:
            fail("--output is for chains of one degree of freedom: others need a drive for each. Leave it out, and take --plot.")
        found = kinematic_chains(links, freedom)
        for k, chain in enumerate(found, 1):
            joints = " ".join(f"{a + 1}-{b + 1}" for a, b in chain.joints)
            parts = ", falls apart without one of its links" if chain.fractionated else ""
            print(f"{k:>3}  {len(chain.frames)} inversion{'s' if len(chain.frames) != 1 else ' '}  {joints}{parts}")
        print(f"{len(found)} chains, {sum(len(chain.frames) for chain in found)} inversions.")
        with interruptible(*(() if plot is None else ("matplotlib.figure",))):
            if output is not None:
                _written(write(chain_solutions(found), output))
            if plot is not None:
                save_chart(figures.chains_figure(found), plot)
                say(f"{plot} written.")


# -- input and output -------------------------------------------------------------------------------------------------
def _give(solutions: Sequence[Solution], output: Path | None, plot: Path | None, figure: Callable[[], Figure] | None) -> None:
    """Prints solutions, and writes their scenes and their chart."""
    print("\n".join(table(solutions)))
    with interruptible(*(() if plot is None else ("matplotlib.figure",))):
        if output is not None:
            _written(write(solutions, output))
        if plot is not None and figure is not None:
            save_chart(figure(), plot)
            say(f"{plot} written.")


def _written(paths: list[Path]) -> None:
    say(f"{paths[0]} written." if len(paths) == 1 else f"{len(paths)} scenes written to {paths[0].parent}.")


def _check(output: Path | None, plot: Path | None) -> None:
    if output is not None:
        check_folder(output)
    if plot is not None:
        check_ending(plot)
        check_target(plot)


def _angle(text: str, option: str) -> float:
    return _quantity(text, option, "angle")


def _length(text: str, option: str) -> float:
    value = _quantity(text, option, "length")
    if value < 0.0:
        fail(f"--{option}: {text} is negative. Give a length.")
    return value


def _quantity(text: str, option: str, kind: str) -> float:
    """A quantity in SI units, from a text with a unit or a number in mm or degrees."""
    try:
        value: float | str = float(text)
    except ValueError:
        value = text
    try:
        if isinstance(value, float) and not np.isfinite(value):
            raise QuantityError(f"{text} is not a finite number.", "Give a finite one.")
        return UNITS.si(value, kind)
    except QuantityError as e:
        fail(f"--{option}: {e} {e.remedy}")


def _pairs(given: Sequence[str] | None) -> list[complex]:
    return [complex(x, y) for x, y in _rows(list(given), 2, "pivot", least=1)] if given else []


def _rows(words: list[str], columns: int, what: str, least: int = 2) -> Real:
    """Rows of two lengths, and perhaps an angle, in SI units: texts with commas, or the rows of a CSV file."""
    if len(words) == 1 and "," not in words[0]:
        text = read_regular(words[0], LARGEST_FILE).decode("utf-8", "replace")
        rows = [row for row in csv.reader(text.splitlines()) if row and not row[0].lstrip().startswith("#")]
        rows = rows[1:] if rows and not _is_number(rows[0][0]) else rows  # a line of titles
    else:
        rows = [word.split(",") for word in words]
    kinds = ("length", "length", "angle")[:columns]
    out = []
    for k, row in enumerate(rows, 1):
        if len(row) != columns:
            wanted = ("30,10", "30,10,25")[columns - 2]
            fail(f"{what} {k}: '{','.join(row)}' has {len(row)} parts, and {columns} are wanted, such as {wanted}.")
        out.append([_quantity(cell.strip(), f"{what} {k}", kind) for cell, kind in zip(row, kinds, strict=True)])
    if len(out) < least:
        fail(f"{len(out)} {what}s. Give {least} or more.")
    return np.array(out)


def _is_number(text: str) -> bool:
    return text.strip()[:1] in tuple("+-.0123456789")


def _function(text: str, start: str, end: str) -> tuple[Callable[[Real], Real], float, float]:
    """A function of x and its range, from expressions with units."""
    try:
        ends = [parse_expression(word).value({}) for word in (start, end)]
        powers = next((one.powers for one in ends if one.number != 0.0), ends[0].powers)
        if any(one.powers != powers and one.number != 0.0 for one in ends):
            fail("--from, --to: they measure different things. Give both the same unit.")
        expression = parse_expression(text)
        expression.value({"x": Amount(float(ends[1].number), powers)})
    except QuantityError as e:
        fail(f"{e} {e.remedy}")

    def y(x: Real) -> Real:
        found = np.broadcast_to(np.asarray(expression.value({"x": Amount(x, powers)}).number, float), np.shape(x))
        return np.array(found)

    if float(ends[0].number) == float(ends[1].number):
        fail("--from, --to: the range of x is empty.")
    return y, float(ends[0].number), float(ends[1].number)
