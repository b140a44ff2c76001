"""``mechviz synthesise stroke``, ``swing``, ``line``, ``dwell``, ``lid`` and ``chains``."""

from __future__ import annotations

from typing import Annotated

import typer

from mechcore.design.chains import kinematic_chains
from mechcore.design.dwells import dwell_linkages
from mechcore.design.springs import LidTask, lid_springs
from mechcore.design.strokes import best_crank_rocker, best_slider_crank, slider_crank, slotted_lever
from mechcore.design.strokes import whitworth as quick_return
from mechviz.commands.shared.loading import clear_errors
from mechviz.commands.shared.messages import fail, interruptible, say
from mechviz.commands.synthesis.tasks import (
    MostOpt,
    OutputOpt,
    PlotOpt,
    angle_option,
    check_scene_targets,
    length_of,
    output_solutions,
    quantity_in,
    report_written,
)
from mechviz.figures import save_chart
from mechviz.studies.synthesis import figures
from mechviz.studies.synthesis.chains import chain_solutions
from mechviz.studies.synthesis.linkages import write
from mechviz.studies.synthesis.strokes import (
    crank_rocker_solution,
    dwell_solutions,
    lid_solutions,
    slider_crank_solution,
    slotted_lever_solution,
    straight_line_solutions,
    whitworth_solution,
)


def stroke(
    length: Annotated[str, typer.Argument(metavar="STROKE", help="travel of the slider or of the lever's end")],
    ratio: Annotated[float, typer.Option(help="time out over time back at constant speed of the crank, above one")],
    offset: Annotated[str | None, typer.Option(help="of the slide from the crank's pivot [default: least pressure angle]")] = None,
    frame: Annotated[str | None, typer.Option(help="a slotted lever instead, with pivots so far apart")] = None,
    whitworth: Annotated[
        str | None,
        typer.Option(metavar="CRANK", help="Whitworth's quick return instead, its lever turns fully, with such a crank"),
    ] = None,
    output: OutputOpt = None,
) -> None:
    """Find the slider-crank, the slotted lever, or Whitworth's quick return of a stroke and a time ratio.

    Try: mechviz synthesise stroke 200 --ratio 1.2 -o press.toml
    """
    with clear_errors("stroke"):
        check_scene_targets(output, None)
        travel = length_of(length, "STROKE")
        if sum(given is not None for given in (offset, frame, whitworth)) > 1:
            fail("--offset is for slider-cranks, --frame for slotted levers, --whitworth for its quick return. Give one of them.")
        if whitworth is not None:
            made = quick_return(travel, ratio, length_of(whitworth, "whitworth"))
            solution = whitworth_solution(made, travel, ratio)
        elif frame is not None:
            solution = slotted_lever_solution(slotted_lever(travel, ratio, length_of(frame, "frame")), travel, ratio)
        elif offset is not None:
            solution = slider_crank_solution(slider_crank(travel, ratio, length_of(offset, "offset")), travel, ratio)
        else:
            solution = slider_crank_solution(best_slider_crank(travel, ratio), travel, ratio)
        output_solutions([solution], output, None, None)


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
        check_scene_targets(output, None)
        wanted = angle_option(angle, "SWING")
        output_solutions(
            [crank_rocker_solution(best_crank_rocker(wanted, ratio, length_of(rocker, "rocker")), wanted, ratio)],
            output,
            None,
            None,
        )


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
        check_scene_targets(output, None)
        wanted = None if straight is None else angle_option(straight, "range")
        output_solutions(straight_line_solutions(list(names or ()), length_of(travel, "travel"), wanted), output, None, None)


def dwell(
    rest: Annotated[str, typer.Argument(metavar="DWELL", help="crank range in which the lever is to rest")],
    swing: Annotated[str, typer.Option(help="swing of the lever")] = "30 deg",
    crank: Annotated[str, typer.Option(help="length of the crank")] = "20 mm",
    seed: Annotated[int, typer.Option(min=0, help="of the linkages that are tried")] = 0,
    most: MostOpt = 5,
    output: OutputOpt = None,
    plot: PlotOpt = None,
) -> None:
    """Find six-bars whose lever swings and rests over a range of the crank: a coupler point runs nearly on a circle meanwhile.

    The drift is how far the lever still turns in its rest.

    Try: mechviz synthesise dwell 90 --swing 30 --plot dwell.svg -o dwell.toml
    """
    with clear_errors("dwell"):
        check_scene_targets(output, plot)
        with interruptible():
            linkages = dwell_linkages(angle_option(rest, "DWELL"), angle_option(swing, "swing"), seed, most)
        solutions = dwell_solutions(linkages, length_of(crank, "crank"), angle_option(rest, "DWELL"))
        output_solutions(solutions, output, plot, lambda: figures.dwell_figure(linkages))


def lid(
    mass: Annotated[str, typer.Argument(metavar="MASS", help="of the lid, such as 12kg")],
    arm: Annotated[str, typer.Option(help="distance of its centre of mass from the hinge")],
    hand: Annotated[str, typer.Option(help="distance of the hand from the hinge")],
    box: Annotated[str, typer.Option(help="how far from the hinge the spring may be fixed")],
    start: Annotated[str, typer.Option("--from", help="angle of the closed lid from the horizontal")] = "0 deg",
    end: Annotated[str, typer.Option("--to", help="angle of the open lid")] = "80 deg",
    effort: Annotated[str, typer.Option(help="wanted force of the hand, lifting positive")] = "0 N",
    pushes: Annotated[bool, typer.Option("--pushes", help="a compression spring instead of an extension spring")] = False,
    seed: Annotated[int, typer.Option(min=0, help="of the places that are tried")] = 0,
    most: MostOpt = 5,
    output: OutputOpt = None,
    plot: PlotOpt = None,
) -> None:
    """Find coil springs, their places, stiffness and free length, that balance a lid on a hinge: the hand's force as wanted.

    Extension springs stretch by at most 80 %, compression springs shorten by at most half.

    Try: mechviz synthesise lid 12kg --arm 300 --hand 550 --box 250 --plot lid.svg -o lid.toml
    """
    with clear_errors("lid"):
        check_scene_targets(output, plot)
        task = LidTask(
            quantity_in(mass, "MASS", "mass"), length_of(arm, "arm"), length_of(hand, "hand"), angle_option(start, "from"),
            angle_option(end, "to"), length_of(box, "box"), quantity_in(effort, "effort", "force"), pushes,
        )  # fmt: skip
        with interruptible():
            springs = lid_springs(task, seed)[:most]
        output_solutions(lid_solutions(task, springs), output, plot, lambda: figures.lid_figure(task, springs))


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
        check_scene_targets(output, plot)
        if output is not None and freedom != 1:
            fail("--output is for chains of one degree of freedom: others need a drive for each. Leave it out, and take --plot.")
        drawn = kinematic_chains(links, freedom)
        for k, chain in enumerate(drawn, 1):
            joints = " ".join(f"{a + 1}-{b + 1}" for a, b in chain.joints)
            parts = ", falls apart without one of its links" if chain.fractionated else ""
            print(f"{k:>3}  {len(chain.frames)} inversion{'s' if len(chain.frames) != 1 else ' '}  {joints}{parts}")
        print(f"{len(drawn)} chains, {sum(len(chain.frames) for chain in drawn)} inversions.")
        with interruptible(*(() if plot is None else ("matplotlib.figure",))):
            if output is not None:
                report_written(write(chain_solutions(drawn), output))
            if plot is not None:
                save_chart(figures.chains_figure(drawn), plot)
                say(f"{plot} written.")
