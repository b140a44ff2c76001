"""Charts of syntheses: structural errors, Burmester curves with the positions, coupler curves with their points, sketches of
chains."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.design.burmester import BodyPositions, burmester_curve
from mechcore.design.chains import Chain
from mechcore.design.dwells import DwellLinkage
from mechcore.design.freudenstein import FunctionGenerator, FunctionTask
from mechcore.design.paths import PathDesign
from mechcore.design.springs import LidSpring, LidTask
from mechviz.figures import COLOURS, chart
from mechviz.studies.synthesis.chains import chain_layout, outline
from mechviz.studies.synthesis.four_bars import MotionDesign
from mechviz.studies.synthesis.linkages import MM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_SHOWN = 6
LINES = 7200  # lines through a point of the cubic that sample it: so many that there is no visible gap where they are tangent to it
GREY = "#6c757d"


def error_figure(task: FunctionTask, generators: Sequence[FunctionGenerator], symbol: str) -> Figure:
    """Figure of the structural errors over the range, a curve for each solution, zero at its precision points."""
    with chart(7.0, 4.0) as figure:
        axes = figure.subplots()
        x = np.linspace(task.start, task.end, 401)
        for k, made in enumerate(generators[:MOST_SHOWN]):
            axes.plot(x, np.degrees(made.structural_error(task, x)), color=COLOURS[k], label=f"{k + 1}")
            if len(made.points) <= 5:
                axes.plot(made.points, np.zeros(len(made.points)), "o", color=COLOURS[k], markersize=4)
        axes.set(xlabel="x", ylabel="structural error [deg]", title=symbol)
        axes.legend(title="solution")
    return figure


def motion_figure(poses: BodyPositions, designs: Sequence[MotionDesign]) -> Figure:
    """Figure of the positions of the body and of the first linkage in all of them; for four positions also the circle-point and
    centre-point curves."""
    with chart(7.6, 6.4) as figure:
        axes = figure.subplots()
        shown = list(poses.places)
        if len(poses.places) == 4:
            w = burmester_curve(poses, LINES, joined=True).w
            _curve(axes, (w * poses.turns[0] + poses.places[0]) * MM, COLOURS[2], "circle points, in position 1")
            _curve(axes, burmester_curve(poses.inverse, LINES, joined=True).w * MM, COLOURS[1], "centre points")
        for made in designs[:1]:
            bar = made.four_bar
            for k, (a, b) in enumerate(made.pins.T):
                shown += [bar.crank_pivot, a, b, bar.rocker_pivot]
                _curve(
                    axes,
                    np.array([bar.crank_pivot, a, b, bar.rocker_pivot]) * MM,
                    COLOURS[0],
                    "",
                    alpha=0.3 if k else 1.0,
                    marker="o",
                )
                _curve(axes, np.array([a, poses.places[k], b]) * MM, GREY, "", alpha=0.3 if k else 1.0)
        for k, (place, turn) in enumerate(zip(poses.places, poses.turns, strict=True)):
            for direction, colour in ((1.0, "#222222"), (1j, GREY)):
                _curve(axes, MM * np.array([place, place + 0.18 * poses.reach * turn * direction], complex), colour, "")
            axes.annotate(f"{k + 1}", (place.real * MM, place.imag * MM), textcoords="offset points", xytext=(-9, -9))
        middle = 0.5 * (complex(max(np.real(shown)), max(np.imag(shown))) + complex(min(np.real(shown)), min(np.imag(shown)))) * MM
        size = max(0.6 * max(np.ptp(np.real(shown)), np.ptp(np.imag(shown))), 0.8 * poses.reach) * MM
        axes.set(
            xlim=(middle.real - size, middle.real + size), ylim=(middle.imag - size, middle.imag + size), aspect="equal",
            xlabel="x [mm]", ylabel="y [mm]",
        )  # fmt: skip
        if len(poses.places) == 4:
            axes.legend(loc="upper right")
    return figure


def path_figure(points: Complex, designs: Sequence[PathDesign]) -> Figure:
    """Figure of the task points and the coupler curves of the best linkages."""
    with chart(7.0, 6.0) as figure:
        axes = figure.subplots()
        turn = np.linspace(0.0, 2.0 * np.pi, 721)
        for k, made in enumerate(designs[:MOST_SHOWN]):
            curve = made.four_bar.positions(turn)[2] * MM
            axes.plot(curve.real, curve.imag, color=COLOURS[k], linewidth=2.0 if k == 0 else 1.0, label=f"{k + 1}")
        best = designs[0]
        a, b, p = (z[0] * MM for z in best.four_bar.positions(best.theta[:1]))
        for line in ([best.four_bar.crank_pivot * MM, a, b, best.four_bar.rocker_pivot * MM], [a, p, b]):
            _curve(axes, np.array(line), GREY, "", marker="o")
        axes.plot(points.real * MM, points.imag * MM, "o", color="#222222", markersize=4)
        closed = points[-1] == points[0]  # then the last point gets no number
        for k, z in enumerate(points[: len(points) - closed][:60]):
            axes.annotate(f"{k + 1}", (z.real * MM, z.imag * MM), textcoords="offset points", xytext=(4, 4), fontsize="small")
        axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
        axes.legend(title="solution")
    return figure


def dwell_figure(linkages: Sequence[DwellLinkage]) -> Figure:
    """Figure of the lever angles over a turn of the crank, from the start of the dwell."""
    with chart(7.0, 4.0) as figure:
        axes = figure.subplots()
        turn = np.linspace(0.0, 2.0 * np.pi, 721)
        for k, made in enumerate(linkages[:MOST_SHOWN]):
            angle = np.degrees(made.lever_angles(made.start + turn))
            axes.plot(np.degrees(turn), angle - angle[0], color=COLOURS[k], label=f"{k + 1}")
        axes.set(xlabel="crank angle since the rest began [deg]", ylabel="lever angle [deg]", xlim=(0.0, 360.0))
        axes.legend(title="solution")
    return figure


def lid_figure(task: LidTask, springs: Sequence[LidSpring]) -> Figure:
    """Figure of the force of the hand over the angle of the lid, without a spring and with each spring."""
    with chart(7.0, 4.0) as figure:
        axes = figure.subplots()
        theta = np.linspace(task.start, task.end, 181)
        axes.plot(np.degrees(theta), task.mass * task.gravity * task.arm / task.hand * np.cos(theta), color=GREY, label="no spring")
        for k, made in enumerate(springs[:MOST_SHOWN]):
            axes.plot(np.degrees(theta), made.effort(task, theta), color=COLOURS[k], label=f"{k + 1}")
        axes.set(xlabel="lid angle [deg]", ylabel="force of the hand [N]")
        axes.legend(title="solution")
    return figure


def chains_figure(chains: Sequence[Chain]) -> Figure:
    """Figure of sketches of chains: binary links as bars, others as polygons. Links of the same colour give the same inversion when
    they are fixed."""
    columns = min(4, len(chains))
    rows = -(-len(chains) // columns)
    with chart(2.4 * columns, 2.5 * rows) as figure:
        for axes in figure.subplots(rows, columns, squeeze=False).ravel():
            axes.set_axis_off()
        for k, chain in enumerate(chains):
            axes = figure.axes[k]
            places = chain_layout(chain)
            for kind, group in enumerate(chain.frames):
                colour = COLOURS[kind % len(COLOURS)]
                for link in group:
                    corners = outline(chain, link, places)
                    if len(corners) > 2:
                        axes.fill(corners.real, corners.imag, color=colour, alpha=0.25, linewidth=0)
                    ring = np.append(corners, corners[0])
                    axes.plot(ring.real, ring.imag, color=colour, linewidth=2.4)
            axes.plot(places.real, places.imag, "o", color="#222222", markerfacecolor="white", markersize=5)
            axes.set_aspect("equal")
            axes.set_title(f"{k + 1}: {len(chain.frames)} inversion{'s' if len(chain.frames) != 1 else ''}", fontsize="small")
    return figure


def _curve(axes: Axes, points: Complex | Real, colour: str, label: str, alpha: float = 1.0, marker: str = "") -> None:
    places = np.asarray(points, complex)
    axes.plot(places.real, places.imag, color=colour, linewidth=1.3, label=label, alpha=alpha, marker=marker, markersize=4)
