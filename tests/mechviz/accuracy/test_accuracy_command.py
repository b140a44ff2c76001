"""`mechviz accuracy` and `mechviz effects`: what is measured, chosen, drawn and kept. No test looks at how long anything took."""

from __future__ import annotations

import gc
import os
import re
import xml.etree.ElementTree as ET
from html import unescape

import numpy as np
import pytest
from typer.testing import CliRunner

from mechviz.accuracy.fit import PROFILE_POINTS
from mechviz.commands.main import app
from mechviz.figures import DOTS_AN_INCH, chart_svg
from mechviz.outputs.rerun.precision import write_rrd
from mechviz.scene.scene import load, loads
from mechviz.studies import cost, precision
from mechviz.studies.cost import WallTime, time_alternately, time_repeatedly
from mechviz.studies.influences import influence_lines, influences
from mechviz.studies.precision import PrecisionPoint, cheapest, ladder, pareto
from mechviz.studies.precision_diagram import PANEL, diagram, setting_changes


def point(seconds: float, error: float, method: str = "a", **more: bool) -> PrecisionPoint:
    return PrecisionPoint("frames", method, "x", {}, error, seconds, 0.0, 3, **more)


POINTS = [point(1.0, 1e-2), point(2.0, 1e-4, current=True), point(3.0, 1e-3, method="b"), point(4.0, 1e-6, method="b")]


def test_pareto_front_and_the_cheapest():
    assert [p.seconds for p in pareto(POINTS)] == [1.0, 2.0, 4.0]
    assert cheapest(POINTS, 1e-3) is POINTS[1]
    assert cheapest(POINTS, 1e-5) is POINTS[3]
    assert cheapest(POINTS, 1e-9) is None


def test_timing_warms_up_and_repeats():
    calls: list[str] = []
    timing = time_repeatedly(lambda: calls.append("x"), budget=0.0, least=5)
    assert len(calls) == 6 and timing.repeats == 5 and timing.seconds > 0.0 <= timing.spread
    calls.clear()
    time_alternately(lambda: calls.append("a"), lambda: calls.append("b"), budget=0.0, least=3)
    assert "".join(calls) == "ab" * 4, "in turns"


def test_times_of_a_processor_that_others_used_are_called_rough(monkeypatch):
    walls, own = iter([0.0, 10.0]), iter([0.0, 4.0])
    monkeypatch.setattr(cost.time, "perf_counter", lambda: next(walls))
    monkeypatch.setattr(cost.time, "process_time", lambda: next(own))
    with cost.processor_share() as share:
        pass
    monkeypatch.undo()
    assert share() == 0.4
    measured = precision.MeasuredStudy("s", "a machine", "2026-01-01", (), share=share())
    assert (
        measured.foot
        == "measured 2026-01-01 on a machine; one thread, medians; rough: others had 60 % of the time on this processor"
    )
    assert "rough" not in precision.MeasuredStudy("s", "a machine", "2026-01-01", (), share=0.97).foot


def once(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is to be timed is done once."""
    monkeypatch.setattr(precision, "time_repeatedly", lambda work, *_, **__: (work(), WallTime(1e-3, 0.0, 1))[1])


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("triad", {"frames", "differentiation", "position tolerance", "tessellation", "recording"}),
        ("slider-crank-friction", {"frames", "differentiation", "friction tolerance", "tessellation", "recording"}),
    ],
)
def test_a_scene_has_the_ladders_that_it_has_a_use_for(name, settings, monkeypatch):
    once(monkeypatch)
    monkeypatch.setattr(precision, "FRAMES", (16, 64, 256))
    monkeypatch.setattr(precision, "DIVISIONS", (24, load(name).frames))
    monkeypatch.setattr(precision, "_tessellation", lambda *_: [point(1.0, 1.0)])
    monkeypatch.setattr(precision, "_recording", lambda *_: [point(1.0, 1.0)])
    points = [p for p in ladder(load(name), 1e-4, budget=0.0) if p.value != "x"]
    assert {p.setting for p in points} == settings - {"tessellation", "recording"}
    for setting in {p.setting for p in points}:
        assert sum(p.current for p in points if p.setting == setting) == 1, "the current setting is among them, once"
    cubics = [p for p in points if p.method == "cubics" and not p.note]
    if name == "triad":
        assert [p.error for p in cubics] == sorted((p.error for p in cubics), reverse=True)
        exact = next(p for p in points if p.setting == "differentiation" and p.method == "exact")
        others = [p for p in points if p.setting == "differentiation" and p.method != "exact"]
        assert exact.error < min(p.error for p in others)
        fitted = [p for p in points if "fitted" in p.note]
        assert len(fitted) == 3 and all(p.error <= 1e-4 for p in fitted)
    iterated = [p.error for p in points if p.setting.endswith("tolerance")]
    assert iterated[-1] == precision.LEAST_ERROR and max(iterated) < 1e-1
    assert iterated[0] > iterated[-1]


@pytest.mark.parametrize(("name", "plane"), [("cam-roller", True), ("cam-globoid", False), ("cam-inverse-slide", False)])
def test_only_cams_in_the_plane_have_a_ladder_of_profiles(name, plane, monkeypatch):
    """Their polygons halve their sagitta twice where their points are doubled; solid and inverse cams have no such profile."""
    once(monkeypatch)
    for other in ("_frames", "_differentiation", "_tessellation", "_recording"):
        monkeypatch.setattr(precision, other, lambda *_: [])
    points = [p for p in ladder(load(name), budget=0.0) if p.setting == "cam profile"]
    assert bool(points) is plane
    if plane:
        errors = {p.options["profile"]: p.error for p in points}
        assert errors[2160] == pytest.approx(errors[4320] * 4.0, rel=0.05)
        assert [p.options["profile"] for p in points if p.current] == [PROFILE_POINTS]


def test_integrators_are_compared_with_the_motion_at_its_tightest(monkeypatch):
    from mechviz.runs import run_scene

    worked = []
    monkeypatch.setattr(precision, "time_repeatedly", lambda work, *_, **__: worked.append(work) or WallTime(1e-3, 0.0, 1))
    monkeypatch.setattr(precision, "TOLERANCES", (1e-4, 1e-9))
    points = list(precision._integrator(run_scene(load("andrews-squeezer")), 0.0))
    assert len(worked) == len(points) and {work.func for work in worked} == {precision._simulated}, "all do the same work"
    gauss = {p.value: p.error for p in points if p.method == "Gauss"}
    assert gauss["1e-09"] < 1e-3 * gauss["1e-04"] and gauss["1e-09"] < 1e-8
    assert {"energy", "Gauss", "Gauss, 4 nodes", "Radau"} == {p.method for p in points}
    assert sum(p.current for p in points) == 1


def test_the_command_prints_draws_and_keeps(tmp_path, monkeypatch):
    monkeypatch.setenv("MECHVIZ_CACHE", str(tmp_path / "cache"))
    calls = []
    monkeypatch.setattr("mechviz.commands.accuracy.ladder", lambda *a, **k: calls.append(1) or list(POINTS))
    svg, png, rrd = (tmp_path / f"d.{kind}" for kind in ("svg", "png", "rrd"))
    first = CliRunner().invoke(app, ["accuracy", "crank-rocker", "--all", "--target", "1e-3", "-o", str(svg), "--rrd", str(rrd)])
    assert first.exit_code == 0, first.output
    assert "* <- now cheapest for the target" in first.stdout and "cheapest settings that reach 0.001" in first.stdout
    assert "measured 20" in first.stdout and "cores" in first.stdout
    root = ET.fromstring(svg.read_text(encoding="utf-8"))
    assert len(root.findall(".//{*}g/{*}title")) == len(POINTS) and rrd.stat().st_size > 1000
    again = CliRunner().invoke(app, ["accuracy", "crank-rocker", "--all", "--target", "1e-3", "-o", str(png)])
    assert again.exit_code == 0 and len(calls) == 1, "kept"
    from PIL import Image

    assert len(np.unique(np.asarray(Image.open(png).convert("RGB")).reshape(-1, 3), axis=0)) > 10
    assert "kept from then; --again measures anew" in again.stdout and "kept from" not in first.stdout
    CliRunner().invoke(app, ["accuracy", "crank-rocker", "--target", "1e-3", "--again"])
    CliRunner().invoke(app, ["accuracy", "crank-rocker"])
    CliRunner().invoke(app, ["accuracy", "triad", "--target", "1e-3", "--quick"])
    assert len(calls) == 4, "measured anew for another scene, another target, or where that is asked"
    assert "of few repeats" in CliRunner().invoke(app, ["accuracy", "triad", "--target", "1e-3", "--quick"]).stdout
    assert len(calls) == 4, "a rough ladder will do where a rough one is asked for"
    assert "of few repeats" not in CliRunner().invoke(app, ["accuracy", "triad", "--target", "1e-3"]).stdout
    assert len(calls) == 5, "and not where it is not"


def test_a_recording_of_the_diagrams_has_axes_and_a_point_for_each_setting(tmp_path, recwarn):
    """To the right means slower and up more wrong, as in the picture below the points, in which they lie."""
    from rerun.chunk import RrdReader

    write_rrd(POINTS, tmp_path / "d.rrd", "title", "table", 1e-3)
    assert not [w for w in recwarn if "rerun" in w.category.__name__.lower()]
    result = {}
    for chunk in RrdReader(tmp_path / "d.rrd").stream():
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            result[str(chunk.entity_path), name] = batch[name].to_pylist()[-1]
    image = result["/accuracy/frames/axes", "EncodedImage:blob"][0]
    assert bytes(image)[:4] == b"\x89PNG"
    for method in ("a", "b"):
        own = [p for p in POINTS if p.method == method]
        places = np.array(result[f"/accuracy/frames/{method}", "Points2D:positions"])
        assert (np.diff(places[:, 0]) > 0).all() and (np.diff(places[:, 1]) > 0).all()
        assert places.min() > 0 and (places < DOTS_AN_INCH * np.array(PANEL)).all()
        labels = result[f"/accuracy/frames/{method}", "Points2D:labels"]
        assert [label.split(": ")[1] for label in labels] == [f"{p.error:.1e} in {p.time_text}" for p in own]
        assert result[f"/accuracy/frames/{method}/error", "Scalars:scalars"] == [p.error for p in own]


def test_a_recording_of_the_diagrams_leaves_no_threads(tmp_path):
    write_rrd(POINTS, tmp_path / "a.rrd", "title", "table")
    gc.collect()
    before = len(os.listdir("/proc/self/task"))
    write_rrd(POINTS, tmp_path / "a.rrd", "title", "table")
    gc.collect()
    assert len(os.listdir("/proc/self/task")) <= before


@pytest.mark.parametrize("times", [[1e-4], [9.7e-5, 3.3e-4], [2e-3, 1.1e-2], [2e-3, 1.1e-1], [1e-6, 40.0]])
def test_marks_of_the_time_are_few_and_round(times):
    figure, _ = diagram([point(t, 1e-3) for t in times], "title", "foot")
    figure.canvas.draw()
    (axes,) = figure.axes
    low, high = axes.get_xlim()
    marks = [label.get_text() for t, label in zip(axes.get_xticks(), axes.get_xticklabels(), strict=True) if low <= t <= high]
    assert low < min(times) and max(times) < high
    assert 1 <= len(marks) <= 8 and all(re.fullmatch(r"[1235]0{0,2} (n|µ|m|)s", mark) for mark in marks)


def test_what_was_kept_on_another_machine_does_not_count(tmp_path, monkeypatch):
    monkeypatch.setenv("MECHVIZ_CACHE", str(tmp_path))
    scene = load("crank-rocker")
    infinite = [*POINTS, point(5.0, float("inf"))]
    precision.store_study(scene, None, infinite)
    stored = precision.load_study(scene, None)
    assert stored is not None and list(stored.points) == infinite and stored.scene == "crank-rocker"
    monkeypatch.setattr(precision, "machine", lambda: "another one")
    assert precision.load_study(scene, None) is None
    monkeypatch.undo()
    monkeypatch.setenv("MECHVIZ_CACHE", str(tmp_path / "file"))
    (tmp_path / "file").write_text("no folder")
    precision.store_study(scene, None, POINTS)
    assert precision.load_study(scene, None) is None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--target", "7"], "is no accuracy"),
        (["-o", "x.gif"], "SVG, PNG or PDF"),
        (["--setting", "colour"], "'colour' is no setting"),
    ],
)
def test_bad_options_are_refused(arguments, words, tmp_path, monkeypatch):
    monkeypatch.setenv("MECHVIZ_CACHE", str(tmp_path))
    monkeypatch.setattr("mechviz.commands.accuracy.ladder", lambda *a, **k: list(POINTS))
    result = CliRunner().invoke(app, ["accuracy", "crank-rocker", *arguments])
    assert result.exit_code == 2 and words in result.stderr
    assert CliRunner().invoke(app, ["effects", "crank-rocker", "--accuracy", "2"]).exit_code == 2


def test_settings_lie_where_their_time_and_error_are_and_marks_around_them():
    figure, words = diagram([*POINTS, point(1.0, 1.0, method="<c>")], "<title> & more", "foot", 1e-3)
    (axes,) = figure.axes
    assert axes.get_xscale() == axes.get_yscale() == "log" and axes.get_ylabel() == "relative error"
    dots = {line.get_gid(): (line.get_xdata()[0], line.get_ydata()[0]) for line in axes.lines if line.get_gid() in words}
    assert list(dots.values()) == [*((p.seconds, p.error) for p in POINTS), (1.0, 1.0)]
    rings = {line.get_markeredgecolor(): tuple(line.get_xydata()[0]) for line in axes.lines if line.get_color() == "none"}
    assert rings == {"#111111": (2.0, 1e-4), "#d6336c": (2.0, 1e-4)}, "in use, and the cheapest"
    text = chart_svg(figure, words)
    assert "&lt;title&gt; &amp; more" in text and "<title>frames: &lt;c&gt;, x: 1e+00 in 1 s</title>" in text
    assert chart_svg(diagram([*POINTS, point(1.0, 1.0, method="<c>")], "<title> & more", "foot", 1e-3)[0], words) == text


# -- picking a point -------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("options", "changed"),
    [
        ({"frames": 128, "interpolation": 5}, {"run": {"frames": 128}, "accuracy": {"interpolation": "quintic"}}),
        (
            {"method": "gauss", "integrator": 1e-6, "nodes": 4},
            {"run": {"method": "gauss", "tolerance": 1e-6}, "accuracy": {"nodes": 4}},
        ),
        ({"chord": 2.5e-4}, {"accuracy": {"chord": "0.00025 m"}}),
        ({"friction": 1e-6}, {"accuracy": {"friction": 1e-6}}),
    ],
)
def test_a_setting_becomes_part_of_the_scene(options, changed):
    before = load("andrews-squeezer" if "method" in options else "crank-rocker")
    scene = before.changed(setting_changes(before.document, options))
    document, result = (s.document.model_dump(exclude_defaults=True) for s in (before, scene))
    for table, values in changed.items():
        assert {**document.get(table, {}), **values} == result[table]
    for key in set(options) - {"frames", "method", "integrator"}:
        assert getattr(scene.accuracy, key) == options[key]
    wanted = before.changed({("accuracy",): 1e-3})
    stated = wanted.changed(setting_changes(wanted.document, {"friction": 1e-6})).document.accuracy
    assert stated.model_dump(exclude_unset=True) == {"target": 1e-3, "friction": 1e-6}


def test_picking_a_point_in_the_viewer_applies_it(monkeypatch):
    from mechviz.outputs.viewer.app import Viewer
    from mechviz.outputs.viewer.panels import accuracy as accuracy_tab
    from mechviz.runs import run_scene

    once(monkeypatch)
    monkeypatch.setattr(precision, "FRAMES", (32, 128))
    monkeypatch.setattr(accuracy_tab, "SHOWN_SETTINGS", ("frames",))
    with Viewer(run_scene(load("crank-rocker"), accuracy=1e-3), port=0) as viewer:
        tab = viewer.inspector.accuracy
        assert tab is not None and "estimated errors" in tab.errors.content
        assert tab.wanted.value == "1e-3"
        viewer.player.seek(20)
        tab.measure()
        tab.wait()
        assert "<br>" not in unescape(tab.errors.content), "lines stand below each other"
        assert tab.diagram.content.count("<svg") == 1 and len(tab.choice.options) > 8
        titles = [unescape(t) for t in re.findall("<title>(.*?)</title>", tab.diagram.content)]
        assert set(tab.choice.options[1:]) == set(titles), "a click on a point tells the entry of the list"
        assert {p.options["frames"] for p in tab._points if p.current} == {160}, "as it is, and fitted"
        tab.choice.value = next(o for o in tab.choice.options if "quintics, 128 frames" in o)
        tab._pick(None)
        assert viewer.session.wait()
        assert viewer.run.scene.frames == 128 and viewer.run.accuracy.interpolation == 5
        timeline = viewer.inspector.timeline
        assert viewer.player.frame == 16 and ">16</span> of 128" in timeline._place.content, "the same part of the run"
        assert timeline.slider.value == 16 and timeline.slider.max == 128
        viewer.inspector.settle()
        assert [(p.options["frames"], p.method) for p in tab._points if p.current] == [(128, "quintics")], "the ring has moved"
        assert f"between frames {np.nanmax(viewer.run.errors.interpolation):.1e}" in tab.errors.content, (
            "it says so of the present run"
        )
        viewer.session.undo()
        assert viewer.session.wait()
        assert viewer.run.accuracy.interpolation == 1 and viewer.run.accuracy.target == 1e-3, "as opened"
        tab.wanted.value = "1e-6"
        tab._set_target("1e-6")
        assert viewer.session.wait()
        assert (
            viewer.run.scene.accuracy.target == 1e-6
            and viewer.run.scene.frames == 265
            and viewer.run.errors.interpolation.max() < 1e-6
        )
        viewer.session.reset()
        assert viewer.session.wait() and viewer.run.accuracy.target == 1e-3, "with the target of the command"


# -- effects -----------------------------------------------------------------------------------------------------------------------
def test_what_effects_do_is_what_two_runs_differ_by():
    """The influence of friction and of gravity by hand: two scenes, one with and one without."""
    from mechviz.runs import run_scene
    from mechviz.scene.scene import Scene

    scene = load("slider-crank-friction")
    _, computed = influences(scene, budget=0.0)
    by_name = {i.name: i for i in computed}
    assert set(by_name) == {"inertia", "gravity", "friction", "process"}
    document = scene.document.model_dump(exclude_defaults=True)
    whole = np.abs(run_scene(scene).forces.effort("O")).max()
    for effect in ("friction", "gravity"):
        rest = [e for e in scene.effects if e != effect]
        less = np.abs(run_scene(Scene.build(**{**document, "effects": rest})).forces.effort("O")).max()
        assert by_name[effect].effort == pytest.approx(abs(whole - less) / whole, rel=1e-9)
        assert np.isfinite(by_name[effect].cost) and by_name[effect].named
    assert by_name["friction"].exceeds(0.05) and not by_name["gravity"].exceeds(0.05)
    words = "\n".join(influence_lines(_, computed, 0.05))
    assert "keep: friction changes the peak effort by 9.54 %" in words and "could be left out: gravity" in words


TWO_AXES = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"]
[run]
frames = 90
[links]
frame = { points = { G = [0, 0] } }
slide = { points = { T = [0, 0], A = [0, 0] }, mass = "50 kg", centre = "T", inertia = "0.1 kg m^2" }
arm = { points = { A = [0, 0] }, mass = "0.4 kg", centre = "A", inertia = "0.01 kg m^2" }
[joints]
A = { revolute = ["slide", "arm"], drive = { oscillation = { amplitude = 60, period = "1 s" } } }
[joints.S]
prismatic = ["frame", "slide"]
at = ["G", "T"]
along = [1, 0]
drive = { oscillation = { amplitude = 100, period = "1 s" } }
[loads]
cut = { force = [-2000, 0], on = "slide", at = "T" }
tool = { torque = "-1.5 N m", on = "arm" }
"""


def test_newtons_and_newton_metres_are_not_compared():
    """A torque of which a drive is moved by three quarters is not little beside the force of another drive."""
    _, computed = influences(loads(TWO_AXES), budget=0.0)
    tool = next(i for i in computed if i.name == "tool")
    whole = 0.01 * np.radians(60.0) * (2.0 * np.pi) ** 2 + 1.5
    assert tool.effort == pytest.approx(1.5 / whole, rel=1e-3)  # of the frames
    assert tool.curve == pytest.approx(tool.effort, rel=1e-9)


def test_effects_that_a_scene_has_not_are_tried_and_not_applied():
    scene = load("slider-crank-compressor")
    before = scene.to_toml()
    base, result = influences(scene, budget=0.0)
    gravity = next(i for i in result if i.name == "gravity")
    assert not gravity.named and 0.0 < gravity.curve < 0.2
    friction = next(i for i in result if i.name == "friction")
    assert friction.problem, "no joint has a coefficient"
    assert scene.to_toml() == before
    assert any("friction" in line and friction.problem in line for line in influence_lines(base, result, 0.01))


def test_fluctuation_of_a_motion_under_forces():
    base, result = influences(load("andrews-squeezer"), budget=0.0)
    assert base.fluctuation > 0.0 and next(i for i in result if i.name == "spring").fluctuation > 0.0
    assert next(i for i in result if i.name == "inertia").problem
