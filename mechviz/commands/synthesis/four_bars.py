"""``mechviz synthesise function``, ``slider``, ``motion``, ``path`` and ``cognates``."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
import typer

from mechcore.arrays import Real
from mechcore.design.burmester import BodyPositions
from mechcore.design.freudenstein import FunctionTask, chebyshev_points, fitted_generator, generators, slider_generator
from mechcore.design.paths import PathTask, path_designs
from mechviz.commands.shared.loading import SceneArg, SetOpt, clear_errors, load_scene
from mechviz.commands.shared.messages import fail, interruptible
from mechviz.commands.synthesis.tasks import (
    MostOpt,
    OutputOpt,
    PlotOpt,
    angle_option,
    check_scene_targets,
    function_of,
    length_of,
    option_rows,
    output_solutions,
    pairs_of,
    quantity_in,
)
from mechviz.runs import run_scene
from mechviz.studies.synthesis import figures
from mechviz.studies.synthesis.four_bars import (
    dyads,
    function_solutions,
    motion_designs,
    motion_solutions,
    slider_guide_solutions,
    slider_guides,
)
from mechviz.studies.synthesis.paths import cognate_solutions, path_solutions, ranked_paths, traced_four_bar
from mechviz.studies.synthesis.strokes import slider_function_solution


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
        check_scene_targets(output, plot)
        task = FunctionTask(
            *function_of(expression, start, end), angle_option(input_range, "crank"), angle_option(output_range, "rocker")
        )
        starts = tuple(
            None if text is None else angle_option(text, name)
            for text, name in ((input_start, "crank-start"), (output_start, "rocker-start"))
        )
        if spacing == "chebyshev" and points <= 5:
            x = chebyshev_points(task.start, task.end, points)
        else:
            x = np.linspace(task.start, task.end, points)
        if points > 5:
            if starts[0] is None or starts[1] is None:
                fail("--crank-start, --rocker-start: a fit of many points begins from both. Give them.")
            generated = [fitted_generator(task, x, starts[0], starts[1], refine=True, starts_too=free)]
        else:
            generated = generators(task, x, *starts)
        if not generated:
            fail("No four-bar meets these points. Give other start angles, or other ranges of input and output.")
        solutions = function_solutions(task, generated, length_of(frame, "frame"), expression)
        output_solutions(solutions, output, plot, lambda: figures.error_figure(task, generated, expression))


def slider(
    expression: Annotated[str, typer.Argument(metavar="FUNCTION", help='what the slider follows, such as "x^2"')],
    start: Annotated[str, typer.Option("--from", help="where x begins")],
    end: Annotated[str, typer.Option("--to", help="where x ends")],
    input_range: Annotated[str, typer.Option("--crank", help="angle by which the crank turns meanwhile, negative: clockwise")],
    travel: Annotated[str, typer.Option(help="what the slider travels meanwhile along x, negative: backwards")],
    input_start: Annotated[str, typer.Option("--crank-start", help="crank angle at the start")],
    output_start: Annotated[str, typer.Option("--slider-start", help="x of the slider's pin at the start, from the crank's pivot")],
    points: Annotated[int, typer.Option(min=3, max=1000, help="precision points; more than 3: least squares")] = 3,
    output: OutputOpt = None,
) -> None:
    """Find the slider-crank whose slider follows a function of the crank angle at three points, or in least squares.

    Try: mechviz synthesise slider "x^2" --from 0 --to 1 --crank 60 --travel -40 --crank-start 20 --slider-start 150
    """
    with clear_errors("slider"):
        check_scene_targets(output, None)
        task = FunctionTask(
            *function_of(expression, start, end), angle_option(input_range, "crank"), quantity_in(travel, "travel", "length")
        )
        if task.output_range == 0.0:
            fail(f"--travel: {travel} is no travel. Give one that differs from zero.")
        begin = angle_option(input_start, "crank-start"), quantity_in(output_start, "slider-start", "length")
        made = slider_generator(*task.turned(chebyshev_points(task.start, task.end, points)), *begin)
        if made is None:
            fail("No slider-crank meets these points. Give another --crank-start, --slider-start or --travel.")
        output_solutions([slider_function_solution(task, made, expression)], output, None, None)


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
    slider: Annotated[bool, typer.Option("--slider", help="2 to 4 positions: a slide in place of one crank")] = False,
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
        check_scene_targets(output, plot)
        rows = option_rows(positions, 3, "position")
        poses = BodyPositions(rows[:, 0] + 1j * rows[:, 1], rows[:, 2])
        pivots = [pairs_of(given) for given in (moving, fixed)]
        in_body = [(z - complex(poses.places[0])) / complex(poses.turns[0]) for z in pivots[0]]
        w, c = dyads(poses, in_body, pivots[1], angle_option(swing, "swing"))
        named = len(pivots[0]) + len(pivots[1])
        if named == 1 and not slider:
            fail("--moving, --fixed: one pivot makes one crank. Give a second one, or none to have both found.")
        if slider:
            if plot is not None:
                fail("--slider, --plot: there is no chart of guides with a slide. Leave out one of them.")
            output_solutions(slider_guide_solutions(poses, slider_guides(poses, w, c, most)), output, None, None)
            return
        if named and (len(set(pivots[0])) < len(pivots[0]) or len(set(pivots[1])) < len(pivots[1])):
            fail("--moving, --fixed: a pivot is given twice. Give two that differ.")
        designs = motion_designs(poses, w, c, most, all_of_them=bool(named) or len(rows) >= 5)
        output_solutions(motion_solutions(poses, designs), output, plot, lambda: figures.motion_figure(poses, designs))


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

    The first point again at the end closes the path. Designs of like curves (without timing) and random ones are screened, the best
    refined by least squares in all lengths and angles; the same seed gives the same solutions.

    Try: mechviz synthesise path 20,20 20,25 20,30 20,35 20,40 20,45 --shortest 5 --longest 60 --plot path.svg
    """
    with clear_errors("points"):
        check_scene_targets(output, plot)
        rows = option_rows(points, 2, "point")
        if step is not None and angles is not None:
            fail("--step and --angles both say when the points are passed. Give one of them.")
        steps: Real | None = None
        if step is not None:
            steps = angle_option(step, "step") * np.arange(float(len(rows)))
        elif angles is not None:
            steps = np.array([angle_option(word, "angles") for word in angles.split(",")])
        elif start is not None:
            fail("--start needs --step or --angles.")
        task = PathTask(
            rows[:, 0] + 1j * rows[:, 1],
            steps,
            None if start is None else angle_option(start, "start"),
            None if pivot is None else pairs_of([pivot])[0],
            None if frame_angle is None else angle_option(frame_angle, "frame-angle"),
            (quantity_in(shortest, "shortest", "length"), np.inf if longest is None else length_of(longest, "longest")),
            np.inf if farthest is None else length_of(farthest, "farthest"),
            (1, -1) if start is None else (1,),
        )
        with interruptible():
            designs = ranked_paths(path_designs(task, seed, screened), task.points)[:most]
        if not designs:
            fail("No crank-rocker passes the points in their order. Try another --seed, more --screened, or wider bounds.")
        output_solutions(path_solutions(designs, task.points), output, plot, lambda: figures.path_figure(task.points, designs))


def cognates(
    scene: SceneArg,
    values: SetOpt = None,
    output: OutputOpt = None,
) -> None:
    """Find the two other four-bars that draw the curve of a scene's traced coupler point (Roberts and Chebyshev).

    Try: mechviz synthesise cognates crank-rocker -o found
    """
    with clear_errors(scene):
        check_scene_targets(output, None)
        run = run_scene(load_scene(scene, values), outputs=("positions",))
        output_solutions(cognate_solutions(*traced_four_bar(run)), output, None, None)
