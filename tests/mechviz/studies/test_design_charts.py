"""Studies in charts, and on clusters: what is drawn is what was found; a cluster finds the same bit for bit."""

from __future__ import annotations

import os
import signal
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from mechcore.errors import MechanismError
from mechviz.commands.main import app
from mechviz.figures import over_decades
from mechviz.scene.scene import load
from mechviz.studies.designs.evaluate import evaluate, study_of
from mechviz.studies.designs.figures import StoredStudy, read_study, study_chart
from mechviz.studies.designs.measures import parse_measure
from mechviz.studies.designs.sampling import parse_variation
from mechviz.studies.designs.sweep import run_study

CRANK = """
units = { length = "mm", angle = "deg" }
parameters = { a = { value = "60 mm", range = ["20 mm", "200 mm"] }, b = "180 mm" }
[links]
frame = { points = { A = [0, 0], D = [200, 0] } }
crank = { points = { A = [0, 0], B = ["a", 0] } }
coupler = { points = { B = [0, 0], C = ["b", 0] } }
rocker = { points = { D = [0, 0], C = [150, 0] } }
[joints]
A = { revolute = ["frame", "crank"], drive = { speed = "60 rpm" } }
B = { revolute = ["crank", "coupler"] }
C = { revolute = ["coupler", "rocker"], side = "left" }
D = { revolute = ["frame", "rocker"] }
"""


@pytest.fixture(scope="module")
def studies(tmp_path_factory):
    """A grid over two parameters, some of whose linkages do not go round, and a sweep of one as whole curves."""
    folder = tmp_path_factory.mktemp("studies")
    scene = folder / "crank.toml"
    scene.write_text(CRANK)
    grid, curves = folder / "grid.parquet", folder / "curves.parquet"
    of = ["--of", "link.rocker.angle:range", "-n", "24"]
    CliRunner().invoke(app, ["sweep", str(scene), "--vary", "a=40..160mm:7", "--vary", "b=150..210mm:5", *of, "-o", str(grid)])
    CliRunner().invoke(
        app, ["sweep", str(scene), "--vary", "a=30..60mm:4", "--of", "link.rocker.angle", "-n", "24", "-o", str(curves)]
    )
    return grid, curves


def test_a_contour_shows_what_cannot_be_had(studies):
    study = read_study(studies[0])
    ok = study.feasible
    assert 0 < ok.sum() < len(ok) == 35
    a, b = study.variables["a [mm]"], study.variables["b [mm]"]
    turns = a + np.maximum.reduce([200.0 + 0 * a, b, 150.0 + 0 * a]) <= 200.0 + b + 150.0 - np.maximum.reduce([200.0 + 0 * a, b])
    assert not np.any(ok & ~turns), "by Grashof's rule no other crank goes round"
    figure = study_chart(study)
    marks = [line for line in figure.axes[0].lines if line.get_label() == "no values"]
    assert len(marks) == 1 and len(marks[0].get_xdata()) == (~ok).sum()
    for kind in ("parallel", "scatter", "response"):
        assert study_chart(study, kind).axes


def test_curves_are_drawn_over_each_other(studies):
    study = read_study(studies[1])
    _, values = study.result("link.rocker.angle")
    axes = study_chart(study).axes[0]
    assert values.shape == (4, 25) and len(axes.lines) == 4
    np.testing.assert_array_equal(axes.lines[2].get_ydata(), values[2])
    with pytest.raises(MechanismError, match="is a curve"):
        study_chart(study, "parallel")
    with pytest.raises(MechanismError, match="not two"):
        study_chart(study, "contour")
    with pytest.raises(MechanismError, match="is no result"):
        study.result("nothing")


def test_values_far_beyond_most_are_drawn_by_decades():
    assert over_decades(np.array([1.0, 2.0, 3.0, 1e4])) and not over_decades(np.array([1.0, 2.0, 150.0]))
    assert not over_decades(np.array([-1.0, 2.0, 1e4]))
    x = np.linspace(60.0, 100.0, 9)
    study = StoredStudy("s", "", (("stroke", "mm"),), {"stroke [mm]": x}, {"peak": np.exp(x - 60.0)}, ("",) * 9)
    assert study_chart(study).axes[0].get_yscale() == "log"


def test_the_command_draws_and_refuses_what_is_no_study(studies, tmp_path):
    chart = tmp_path / "chart.svg"
    said = CliRunner().invoke(app, ["study", str(studies[0]), "-o", str(chart)])
    assert said.exit_code == 0 and "no values" in chart.read_text()
    bad = tmp_path / "bad.parquet"
    bad.write_bytes(b"PAR1 nothing")
    assert CliRunner().invoke(app, ["study", str(bad), "-o", str(chart)]).exit_code == 2
    for command in (["study", str(tmp_path / "bat.parquet"), "-o", str(chart)], ["view", str(tmp_path / "bat.parquet")]):
        said = CliRunner().invoke(app, command)
        assert said.exit_code == 2 and "there is no such file." in said.output and "/bad.parquet'?" in said.output
    (tmp_path / "begun.parquet.parts").mkdir()
    said = CliRunner().invoke(app, ["study", str(tmp_path / "begun.parquet"), "-o", str(chart)])
    assert said.exit_code == 2 and "not finished" in said.output
    said = CliRunner().invoke(app, ["study", str(tmp_path), "-o", str(chart)])
    assert said.exit_code == 2 and "not a regular file" in said.output


@pytest.mark.thorough
def test_a_cluster_finds_the_same_bit_for_bit_and_loses_nothing_with_a_worker():
    distributed = pytest.importorskip("distributed")
    scene = load("parametric-press")
    ask = [parse_variation(scene, "stroke=60..100mm:8"), parse_variation(scene, "speed=100..200rpm:3")]  # one by one
    study = study_of(scene, ask, [parse_measure(scene, "drive.A.torque")], frames=12)
    designs = np.stack(np.meshgrid(np.linspace(60, 100, 16), np.linspace(100, 200, 3)), axis=-1).reshape(-1, 2)
    here = evaluate(study, designs)
    paths = os.pathsep.join(p for p in sys.path if p)
    env = {"PYTHONPATH": paths, "OMP_NUM_THREADS": "1"}
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, env=env) as cluster,
        distributed.Client(cluster) as client,
    ):
        victim = next(iter(client.run(os.getpid).values()))
        done = []

        def progress(finished, _):
            done.append(finished)
            if len(done) == 2:
                os.kill(victim, signal.SIGKILL)

        there = run_study(study, designs, executor=client.get_executor(pure=False), most=4, progress=progress)
    np.testing.assert_array_equal(there.results.values[0], here.values[0])
    assert np.isfinite(here.values[0]).all() and done[-1] == len(designs)
