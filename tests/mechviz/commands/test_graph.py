"""The contour graph: as many loops as edges leave over, the article's contours, and a drawing in which no edges cross."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
import pytest
from typer.testing import CliRunner

from mechcore.constructions.equations import contour_graph
from mechcore.motion.solve import compile_mechanism
from mechviz.commands.main import app
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.outputs.viewer.build import view_model_of_recording
from mechviz.picture.constructions import drawings_of, graph_layout
from mechviz.runs import run_scene
from recordings import gallery_scene

NAMES = ("contour-lever", "watt-six-bar", "jansen-leg", "planetary-gear", "double-parallelogram", "eight-bar", "rack-and-pinion")


def graph_of(name):
    return contour_graph(compile_mechanism(gallery_scene(name).mechanism).model)


def rank2(rows):
    """Rank of rows of 0 and 1 over the field of two elements."""
    basis: list[int] = []
    for row in rows:
        for b in basis:
            row = min(row, row ^ b)
        if row:
            basis.append(row)
    return len(basis)


@pytest.mark.parametrize("name", NAMES)
def test_the_loops_are_as_many_independent_cycles_as_there_are(name):
    graph = graph_of(name)
    assert len(graph.loops) == len(graph.edges) - len(graph.links) + 1
    for vertices, edges in graph.loops:
        around = [*vertices, vertices[0]]
        for edge, pair in zip(edges, pairwise(around), strict=True):
            assert set(graph.edges[edge].ends) == set(pair)
        assert len(set(vertices)) == len(vertices)
    assert rank2([sum(1 << e for e in edges) for _, edges in graph.loops]) == len(graph.loops)


@pytest.mark.parametrize("name", ["cam-roller", "planetary-gear", "scissor-lift"])
def test_check_counts_the_same_loops(name):
    said = CliRunner().invoke(app, ["check", name]).stdout
    assert f"loops      {len(graph_of(name).loops)} independent" in said


def test_the_contours_of_the_article():
    """I = 0-1-2-3-0 and II = 0-3-4-5-0 of the six-link lever mechanism."""
    contours = [{graph_of("contour-lever").links[v] for v in vertices} for vertices, _ in graph_of("contour-lever").loops]
    assert contours == [{"frame", "crank", "block", "lever"}, {"frame", "lever", "coupler", "slider"}]


def crossing(a, b, c, d):
    def side(p, q, r):
        return ((q - p).conjugate() * (r - p)).imag

    return side(a, b, c) * side(a, b, d) < 0.0 and side(c, d, a) * side(c, d, b) < 0.0


@pytest.mark.parametrize("name", NAMES)
def test_vertices_stand_apart_and_edges_hardly_cross(name):
    graph = graph_of(name)
    positions = graph_layout(graph)
    z = positions.vertices
    assert min(abs(a - b) for a, b in combinations(z, 2)) > 0.3
    assert np.angle(z[0] - z.mean()) == pytest.approx(-0.5 * np.pi)  # the frame at the bottom
    for edge, curve in zip(graph.edges, positions.edges, strict=True):
        assert curve[[0, -1]] == pytest.approx(z[list(edge.ends)])
    pairs = {tuple(sorted(e.ends)) for e in graph.edges}
    crossings = [(e, f) for e, f in combinations(pairs, 2) if not set(e) & set(f) and crossing(*z[list(e)], *z[list(f)])]
    assert len(crossings) == (1 if name == "planetary-gear" else 0)
    numbers = positions.numbers
    assert all(abs(a - b) > 0.4 for a, b in combinations(numbers, 2))


def test_the_command_tells_and_draws_it(tmp_path):
    first, second = tmp_path / "a.svg", tmp_path / "b.svg"
    for path in (first, second):
        said = CliRunner().invoke(app, ["graph", "contour-lever", "-o", str(path)])
        assert said.exit_code == 0, said.output
    assert "0 frame, 1 crank, 2 block" in said.stdout and "2 independent: 7 joints - 6 links + 1" in said.stdout
    text = first.read_text()
    assert text == second.read_text() and len(text) < 50_000
    assert all(f">{word}<" in text for word in ("lever", "slider", "II", "T"))
    assert CliRunner().invoke(app, ["graph", "contour-lever", "-o", str(tmp_path / "a.txt")]).exit_code == 2


def test_a_scene_that_asks_for_it_shows_it_everywhere(tmp_path):
    scene = gallery_scene("contour-lever").changed({("polygons",): ["graph"]})
    run = run_scene(scene, frames=6)
    drawing = drawings_of(run, 0.3)["graph"]
    assert [m.label for m in drawing.points] == [
        "0 frame", "1 crank", "2 block", "3 lever", "4 coupler", "5 slider", "I", "II",
    ]  # fmt: skip
    assert {i.label for i in drawing.arrows} == {j.name for j in run.motion.mechanism.joints}
    assert 0.2 < np.ptp(drawing.bounds, axis=0).max() < 0.31
    write_recording(run, tmp_path / "a.rrd")
    recorded = view_model_of_recording(Recording(tmp_path / "a.rrd")).drawings()["graph"]
    assert [m.label for m in recorded.points] == [m.label for m in drawing.points]
