"""The façade: a run and its recording read, plot and show the same; what is misspelt or missing is told."""

from __future__ import annotations

from urllib.request import urlopen
from xml.etree import ElementTree

import numpy as np
import pytest

import mechviz as mv
from mechcore.errors import MechanismError
from mechviz.figures import chart, chart_svg
from mechviz.files import OutputError
from mechviz.outputs.page.pack import find_frames
from mechviz.outputs.page.page import find_plots


@pytest.fixture(scope="module")
def run():
    return mv.run("slider-crank-compressor", frames=48)


@pytest.fixture(scope="module")
def played(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("facade") / "a.rrd"
    assert run.record(path).frames == 49
    return mv.open(path)


def test_a_run_and_its_recording_hold_the_same(run, played):
    assert played.keys() == run.keys() and len(run) == len(run.keys()) and "drive.A.torque" in run
    np.testing.assert_allclose(played.time, run.time, atol=1e-9)
    for key in run:
        np.testing.assert_array_equal(played[key], run[key], err_msg=key)
    assert [e.text for e in played.events] == [e.text for e in run.events]
    np.testing.assert_allclose([e.time for e in played.events], [e.time for e in run.events], rtol=0.0, atol=0.6e-9)
    assert played.scene == run.scene and played.title == run.title


def test_values_are_those_of_the_core_in_the_units_that_people_read(run):
    reaction = run["joint.B.reaction"]
    assert run.quantity("joint.B.reaction").curves == ("Fx", "Fy", "|F|")
    np.testing.assert_array_equal(reaction[:, :2], run.forces.reaction("B")[:, :2])
    np.testing.assert_allclose(reaction[:, 2], np.hypot(*reaction[:, :2].T), rtol=1e-15)
    angle = run["link.rod.angle"]
    assert run.quantity("link.rod.angle").unit == "°"
    np.testing.assert_allclose(angle[:, 0], np.degrees(run.motion.pose("rod")[:, 2]), rtol=1e-15)


def test_scenes_come_by_name_path_or_value_and_frames_follow(tmp_path):
    scene = mv.load("crank-rocker")
    mv.dump(scene, tmp_path / "mine.toml")
    result = [mv.run(s, frames=8)["link.rocker.angle"] for s in ("crank-rocker", tmp_path / "mine.toml", scene)]
    assert len(result[0]) == 9 and all((f == result[0]).all() for f in result)


def test_an_unknown_quantity_is_told_with_the_one_that_was_meant(run):
    with pytest.raises(KeyError, match=r"^There is no quantity 'joint.B.reactoin'. Did you mean 'joint.B.reaction'\?$"):
        run["joint.B.reactoin"]
    with pytest.raises(KeyError, match=r"There are: 'drive\.A\.torque'.* more"):
        run["zzz"]
    with pytest.raises(KeyError, match=r"cannot run against 'B'.*'A', 'time'"):
        run.plot(against="B")


def test_pages_drawings_and_plots_are_written_and_equal_from_both(run, played, tmp_path):
    for name, result in (("run", run), ("recording", played)):
        assert result.share(tmp_path / f"{name}.html").stat().st_size > 50_000
        assert result.shot(tmp_path / f"{name}.svg", angle=60).read_text().startswith("<svg")
    assert (tmp_path / "run.svg").read_bytes() == (tmp_path / "recording.svg").read_bytes()
    figure = played.plot("joint.B.reaction", "drive.A.torque", path=tmp_path / "plot.svg", against="time")
    assert (tmp_path / "plot.svg").stat().st_size > 5_000
    reaction, torque = figure.axes
    assert torque.get_xlabel() == "time [s]" and reaction.get_ylabel() == "[N]"
    assert [line.get_label() for line in reaction.lines] == ["Fx", "Fy", "|F|"]
    np.testing.assert_array_equal(torque.lines[0].get_ydata(), run["drive.A.torque"][:, 0])
    assert len(run.plot().axes) == 3


def test_drives_whose_names_have_spaces_are_axes_of_plots():
    b = mv.SceneBuilder("two arms", length="mm", angle="deg")
    b.link("frame", {"shaft: 1": (0, 0)})
    b.link("arm", {"shaft: 1": (0, 0), "shaft 2": (60, 0)}).link("hand", {"shaft 2": (0, 0), "E": (50, 0)})
    b.revolute("shaft: 1", "frame", "arm", drive={"speed": "60 rpm"}).revolute("shaft 2", "arm", "hand", drive={"speed": "-30 rpm"})
    run = mv.run(b.trace("E").scene(), frames=8)
    for against in ("shaft: 1", "shaft 2"):
        (panel,) = run.plot("point.hand.E.position", against=against).axes
        np.testing.assert_array_equal(panel.lines[0].get_xdata(), run[f"joint.{against}.angle"][:, 0])


def test_names_of_a_scene_are_kept_in_titles_and_curves(tmp_path):
    """Underscores in the table of powers, colons before what is plotted."""
    b = mv.SceneBuilder("arm", length="mm", angle="deg")
    b.link("frame", {"pin: a": (0, 0)}).link("arm_1", {"pin: a": (0, 0), "P": (60, 0)}, mass=1, centre=(30, 0), inertia=1)
    b.revolute("pin: a", "frame", "arm_1", drive={"speed": "30 rpm", "sine": {"period": "1 s"}})
    run = mv.run(b.force("pull_2", (0, -5), on="arm_1", at="P").effect("gravity").scene(), frames=16)
    assert run.quantity("power").curves == ("drive pin: a", "gravity/arm_1", "pull_2")
    titles = [plot.title for plot in find_plots(run.catalogue, find_frames(run.presentation, 100), {})]
    assert {"Joint pin: a: polar plot of the reaction", "Joint pin: a: phase diagram, velocity against angle"} <= set(titles)


def test_charts_show_names_and_titles_as_they_are(tmp_path):
    """Dollar signs begin no formula, a legend names every curve, and numbers at logarithmic axes are powers of ten."""
    title, load = r"$\foo$ for 5$", "_$P_1$"
    force = {load: {"force": [0, "-5 N"], "on": "rocker", "at": "C"}}
    run = mv.run(mv.load("crank-rocker").changed({("title",): title, ("loads",): force}), frames=8)
    figure = run.plot("power", path=tmp_path / "power.svg")
    assert [text.get_text() for text in figure.axes[0].get_legend().texts] == list(run.quantity("power").curves)
    shown = [element.text for element in ElementTree.parse(tmp_path / "power.svg").iter() if element.tag.endswith("}text")]
    assert {title, load} <= set(shown)
    with chart(3.0, 2.0) as figure:
        axes = figure.subplots()
        axes.set(xscale="log", xlim=(1.0, 1e4))
        axes.set_yticks([0.0, 1.0], ["$a$", "$b"])
    words = [element.text or "" for element in ElementTree.fromstring(chart_svg(figure)).iter()]
    assert {"$a$", "$b"} <= set(words) and not any("math" in word for word in words)


def test_a_drive_that_stands_still_is_found_at_its_angle(tmp_path):
    scene = mv.load("kinetostatic-four-bar").changed({("joints", "A", "drive"): {"speed": 0, "start": 30}, ("run",): None})
    run = mv.run(scene)
    assert len(run.time) == 1 and run.shot(tmp_path / "a.svg", angle=30).is_file()
    with pytest.raises(OutputError, match="outside what the drive does, 30° to 30°"):
        run.shot(tmp_path / "a.svg", angle=31)


def test_what_cannot_be_done_is_refused_with_a_remedy(run, played, tmp_path):
    for ask, words in (
        (lambda: played.motion, r"is a recording.*mechviz\.run\(result\.scene\)"),
        (lambda: played.record(tmp_path / "b.rrd"), "is a recording"),
        (lambda: mv.open(tmp_path / "none.rrd"), "There is no file"),
        (lambda: run.share(tmp_path / "no" / "a.html"), "does not exist"),
        (lambda: run.shot(tmp_path / "a.svg", at=9.0), "^The time 9 s is outside the run"),
        (lambda: run.shot(tmp_path / "a.svg", angle=400), "^The angle 400° is outside what the drive does, 0° to 360°"),
        (lambda: run.shot(tmp_path / "a.gif"), "neither in .png nor in .svg"),
        (lambda: run.shot(tmp_path / "a.svg", view="iso"), "cannot be taken from the view 'iso'"),
        (lambda: run.plot(path=tmp_path / "a.gif"), "SVG, PNG or PDF"),
        (lambda: run.record(tmp_path / "a.txt"), "does not end in .rrd"),
        (lambda: run.share(tmp_path / "a.txt"), "does not end in .html"),
    ):
        with pytest.raises(OutputError, match=words):
            ask()
    assert not {p.name for p in tmp_path.iterdir()}


def test_a_recording_shows_itself_in_a_notebook(played):
    assert set(played._repr_mimebundle_()) == {"text/html", "image/svg+xml", "text/plain"}
    assert repr(played) == f"Result of a.rrd: 49 frames, {len(played)} quantities"


def test_a_result_is_viewed_until_it_is_stopped(played, monkeypatch):
    from mechviz.outputs.viewer import app

    seen = []
    monkeypatch.setattr(app, "serve", lambda *given: seen.append(given))
    played.view(port=0)
    assert seen == [(played._source, 0, False)]


def test_a_session_goes_on_beside_the_viewer_that_it_opened(played, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    with played.view(port=0, open_browser=True, block=False) as viewer:
        assert opened == [viewer.url] and viewer.frame == viewer.inspector.view_model.opening
        assert b"<html" in urlopen(viewer.url, timeout=30).read().lower()
    with pytest.raises(OSError):
        urlopen(opened[0], timeout=5)


def test_run_stays_a_function_whatever_is_imported():
    import mechviz.commands.main  # noqa: F401

    assert callable(mv.run) and {"run", "open", "Result"} <= set(dir(mv))


def test_the_core_offers_motion_under_forces_when_it_is_asked_for():
    import mechcore
    from mechcore.dynamics.simulate import simulate
    from mechcore.dynamics.simulation import Simulation

    assert mechcore.simulate is simulate and mechcore.Simulation is Simulation
    with pytest.raises(AttributeError, match="nonsense"):
        mechcore.nonsense  # noqa: B018


def test_names_and_orders_that_are_not_there_are_told(run):
    for ask, words in (
        (lambda: run.motion.point("rode", "B"), r"link 'rode'.*There are: frame, crank, rod, piston\."),
        (lambda: run.motion.point("rod", "Z"), "point of rod 'Z'.*There are: B, C"),
        (lambda: run.motion.coordinate("ZZ"), "joint 'ZZ'.*There are: A, B, C, S"),
        (lambda: run.motion.joint_position("ZZ"), "joint 'ZZ'"),
        (lambda: run.forces.reaction("ZZ"), "joint 'ZZ'"),
        (lambda: run.forces.effort("B"), r"joints\.B: it has no drive\. Drives: A\."),
        (lambda: run.forces.power("B"), "has no drive"),
        (lambda: mv.run("crank-rocker", executor="fortran"), "executor: 'fortran'.*auto, numpy, c"),
        (lambda: mv.run("crank-rocker", frames=0), "0 is too small"),
    ):
        with pytest.raises(MechanismError, match=words):
            ask()
    for order in (3, 4, -1):
        for ask in (lambda n: run.motion.point("rod", "B", n), lambda n: run.motion.centre_of_mass("rod", n)):
            with pytest.raises(ValueError, match="velocity"):
                ask(order)
    with pytest.raises(KeyError, match="There is no quantity '0'"):
        run[0]


def test_a_place_that_a_scene_does_not_have_is_told():
    scene = mv.load("crank-rocker")
    for place, words in (
        (("run", "framez"), "unknown key 'framez'. Did you mean 'frames'"),
        (("links", "crank", "points", "B", 5), r"links\.crank\.points\.B\[5\] .*no such place"),
        (("links", "rod", "points", "B", 0), "no such place"),
        (("run", "frames", "x"), "no such place"),
        ("title", "is no place"),
        ((), "is no place"),
    ):
        with pytest.raises(mv.SceneError, match=words):
            scene.changed({place: 3})


def test_quantities_and_sensitivities_are_printed_in_a_line(run):
    assert repr(run.quantity("link.rod.angle")) == "Quantity link.rod.angle: link rod: angle [°]"
    said = repr(run.sensitivity("link.rod.angle:max", ["links.crank.points.B[0]"]))
    assert said == "Sensitivity of link.rod.angle:max to links.crank.points.B[0]"
