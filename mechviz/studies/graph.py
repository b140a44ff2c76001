"""``mechviz graph``: the contour graph of a scene as text and as a chart."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mechcore.constructions.equations import ContourGraph
from mechviz.figures import COLOURS, chart, save_chart
from mechviz.picture.constructions import graph_layout, loop_number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNIT = 1.15  # length of an edge [in]
ROOM = 0.75  # margin around the graph, in edge lengths
FRAME, LINK, EDGE, LOOP = "#374151", COLOURS[0], "#6b7280", "#c8553d"


def graph_lines(graph: ContourGraph) -> list[str]:
    """Vertices, edges and loops as lines of text."""
    lines = ["links      " + ", ".join(f"{k} {name}" for k, name in enumerate(graph.links))]
    kinds = {e.joint: "".join(", class IV" * e.higher + ", driven" * e.driven) for e in graph.edges}
    lines.append("joints     " + "; ".join(f"{e.joint} {e.ends[0]}-{e.ends[1]}{kinds[e.joint]}" for e in graph.edges))
    lines.append(f"loops      {len(graph.loops)} independent: {len(graph.edges)} joints - {len(graph.links)} links + 1")
    for k, (vertices, edges) in enumerate(graph.loops):
        around = "-".join(str(v) for v in (*vertices, vertices[0]))
        lines.append(f"  {loop_number(k):<5} {around} through {', '.join(graph.edges[e].joint for e in edges)}")
    return lines


def write_graph(graph: ContourGraph, title: str, path: Path) -> None:
    """Write the graph as a chart (.svg, .png or .pdf). Raises `OutputError`."""
    places = graph_layout(graph)
    ends = np.concatenate([places.vertices, *places.edges])
    low = np.array([ends.real.min(), ends.imag.min()]) - ROOM
    high = np.array([ends.real.max(), ends.imag.max()]) + ROOM
    width, height = np.maximum(UNIT * (high - low), (3.2, 1.0))
    below = 0.22 * (len(graph.loops) + 1)
    with chart(float(width), float(height) + 0.35 + below) as figure:
        axes = figure.add_subplot()
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", title=title)
        axes.axis("off")
        for edge, z in zip(graph.edges, places.edges, strict=True):
            look = "--" if edge.higher else "-"
            axes.plot(z.real, z.imag, look, color=LOOP if edge.driven else EDGE, linewidth=2.6 if edge.driven else 1.6, zorder=1)
            middle = 0.5 * (z[len(z) // 2] + z[(len(z) - 1) // 2])
            box = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none"}
            axes.text(middle.real, middle.imag, edge.joint, ha="center", va="center", bbox=box, zorder=2)
        for k, (name, z) in enumerate(zip(graph.links, places.vertices, strict=True)):
            marker = "s" if k == 0 else "o"
            axes.plot(z.real, z.imag, marker, color=FRAME if k == 0 else LINK, markersize=19.0, zorder=3)
            axes.text(z.real, z.imag, str(k), ha="center", va="center", color="white", weight="bold", zorder=4)
            outwards = z / abs(z) if abs(z) > 1e-9 else -1j
            axes.text(z.real, z.imag + (0.24 if outwards.imag >= -1e-9 else -0.24), name, ha="center", va="center", zorder=4)
        for k, z in enumerate(places.numbers):
            axes.text(z.real, z.imag, loop_number(k), ha="center", va="center", color=LOOP, size=12.0, weight="bold", zorder=2)
        _legend(figure, graph)
        save_chart(figure, path)


def _legend(figure: Figure, graph: ContourGraph) -> None:
    """Write the joints of each loop, in order, and the meaning of the line styles below the graph."""
    words = [f"{loop_number(k)}: {' - '.join(graph.edges[e].joint for e in edges)}" for k, (_, edges) in enumerate(graph.loops)]
    kinds = ["red: driven"] * any(e.driven for e in graph.edges) + ["dashed: class IV"] * any(e.higher for e in graph.edges)
    figure.supxlabel("\n".join([*words, ", ".join(kinds)]).strip(), size="medium", ha="left", x=0.02)
