"""What is drawn and kept for a wanted error: digits, facets, profiles, pictures follow from it; numbers are read between frames."""

from __future__ import annotations

import csv
import dataclasses

import numpy as np
import pytest
from shapely import LineString, distance, points
from typer.testing import CliRunner

from mechcore.accuracy import Accuracy, accuracy_for
from mechcore.errors import MechanismError
from mechviz.accuracy import fit as fit_module
from mechviz.accuracy.fit import FINEST_CHORD, profile_deviation, quantity_function, target_lines
from mechviz.commands.main import app
from mechviz.meshes.kinds import cam_profiles as profiles
from mechviz.outputs.exports.tables import even_times, wide_table
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.picture.build import solids_of
from mechviz.quantities.items import derivative_paths, interpolate_table
from mechviz.runs import run_scene
from mechviz.scene.builder import SceneBuilder
from mechviz.scene.scene import Scene, load


def random_times(run, seed):
    time = run.motion.time
    return np.sort(np.random.default_rng(seed).uniform(time[0], time[-1], 400))


# -- numbers -------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("target", "digits"), [(1e-2, "float32"), (1e-4, "float32"), (1e-7, "float64")])
def test_recorded_numbers_are_within_the_target_between_the_frames(target, digits, tmp_path):
    """Read back from the file at random times, against the motion itself: at most the target, and not far below."""
    run = run_scene(load("crank-rocker"), accuracy=target)
    assert run.resolved_accuracy.numbers == digits
    write_recording(run, tmp_path / "a.rrd")
    recording = Recording(tmp_path / "a.rrd")
    t = random_times(run, 5)
    truth = {q.name: q for q in quantity_function(run.scene, run.accuracy)(t)}
    worst = 0.0
    for link in ("crank", "coupler", "rocker"):
        for what, kind in (("pose", "{}"), ("velocity", "velocity of {} ({})"), ("acceleration", "acceleration of {} ({})")):
            cam_at = recording.at(t, "data", "links", link, what)
            for part, columns in (("place", slice(0, 2)), ("angle", slice(2, 3))):
                q = truth.get(kind.format(link, part) if what != "pose" else f"{part} of {link}")
                if q is not None and np.abs(q.values).max() > 1e-9 * q.scale:
                    worst = max(worst, float(np.abs(cam_at[:, columns] - q.values).max()) / q.scale)
    assert 0.03 * target <= worst <= target


def test_digits_that_balances_need_are_kept_and_long_turns_are_not_rounded():
    forces = run_scene(load("slider-crank-compressor"), accuracy=1e-2)
    assert forces.forces is not None and forces.resolved_accuracy.numbers == "float64"
    assert run_scene(load("crank-rocker"), accuracy=1e-5).resolved_accuracy.numbers == "float32"
    assert run_scene(load("crank-rocker"), cycles=100, frames=1000, accuracy=1e-5).resolved_accuracy.numbers == "float64", (
        "angles of 600 rad"
    )
    stated = run_scene(load("crank-rocker"), frames=50, accuracy=accuracy_for(1e-2, numbers="float64"))
    assert stated.resolved_accuracy.numbers == "float64"
    assert run_scene(load("crank-rocker"), frames=50).resolved_accuracy == dataclasses.replace(
        Accuracy(), profile=1080, numbers="float64"
    )


# -- meshes --------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("target", [1e-2, 1e-4])
def test_pins_are_within_the_target_of_circles(target):
    """The middles of the sides of the pins in the meshes themselves, against the circles through their corners."""
    run = run_scene(load("crank-rocker"), accuracy=target)
    size, worst, largest = run.motion.model.length_scale, 0.0, 0.0
    for solid in solids_of(run).links.values():
        for part, kind in zip(solid.parts, solid.kinds, strict=True):
            if kind != "pin":
                continue
            xy = np.asarray(part.vertices)[:, :2]
            centre = 0.5 * (xy.min(axis=0) + xy.max(axis=0))
            radius = np.hypot(*(xy - centre).T)
            z = np.asarray(part.vertices)[:, 2]
            walls = part.faces[(np.ptp(radius[part.faces], axis=1) < 1e-9 * size) & (np.ptp(z[part.faces], axis=1) > 0.0)]
            sides = np.vstack([walls[:, [0, 1]], walls[:, [1, 2]], walls[:, [2, 0]]])
            a, b = sides[z[sides[:, 0]] == z[sides[:, 1]]].T
            middle = np.hypot(*(0.5 * (xy[a] + xy[b]) - centre).T)
            worst = max(worst, float(np.max(radius[a] - middle)))
            largest = max(largest, float(radius.max()))
    assert 0.0 < worst <= target * size
    assert run.resolved_accuracy.chord == pytest.approx(target * size)
    count = np.pi / np.arccos(1.0 - worst / largest)
    assert count <= 24.5 or worst > 0.02 * target * size, "no finer than the largest circle of the mechanism needs"


@pytest.mark.parametrize("target", [1e-3, 1e-5])
def test_profiles_are_within_the_target_of_the_cam(target, monkeypatch):
    """The polygon that is meshed, against the exact profile at many more places."""
    run = run_scene(load("cam-roller"), frames=36, accuracy=target)
    (placed,) = [r.geometry for r in run.compiled.model.relations if r.geometry is not None]
    drawn = []
    draw = profiles.profile_points
    monkeypatch.setattr(profiles, "profile_points", lambda placed, count: drawn.append(draw(placed, count)) or drawn[-1])
    solids_of(run)
    line = LineString([(z.real, z.imag) for z in np.append(drawn[-1], drawn[-1][0])])
    exact = placed.contour(np.linspace(0.0, placed.contour.count, 7001))[0]
    away = float(distance(line, points(exact.real, exact.imag)).max())
    size = run.motion.model.length_scale
    assert 0.0 < away <= target * size
    assert away >= 0.3 * target * size or len(drawn[-1]) <= 180
    assert profile_deviation(placed.contour, len(drawn[-1])) == pytest.approx(away, rel=0.1)


def test_meshes_get_no_finer_than_can_be_seen_and_say_so():
    run = run_scene(load("crank-rocker"), accuracy=1e-8)
    assert run.resolved_accuracy.chord == pytest.approx(FINEST_CHORD * run.motion.model.length_scale)
    assert "no finer than 1e-05 of the size" in target_lines(run)[-1]
    stated = run_scene(load("crank-rocker"), accuracy=accuracy_for(1e-8, chord=1e-4))
    assert stated.resolved_accuracy.chord == 1e-4


# -- pictures ------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("target", [1e-3, 1e-2])
def test_arrows_between_drawn_frames_are_within_the_target(target, tmp_path, monkeypatch):
    """Arrows of a recording with far more frames than needed, joined by straight lines, against its numbers at all frames."""
    monkeypatch.setattr(fit_module, "PICTURES_A_CYCLE", 45)
    run = run_scene(load("ten-link-forces"), frames=1440, accuracy=target)
    stride = run.resolved_accuracy.pictures
    assert stride > 1 and 1440 % stride == 0
    write_recording(run, tmp_path / "a.rrd")
    recording = Recording(tmp_path / "a.rrd")
    worst = 0.0
    joints = [j for j in recording.model["joints"] if recording.has("vectors", "reaction", j)]
    assert len(joints) > 3
    for joint in joints:
        time, numbers = recording.scalars("data", "joints", joint, "reaction")
        arrows = recording.rows("vectors", "reaction", joint, component="Arrows3D:vectors")
        assert np.array_equal(arrows.time, time[::stride])
        if (arrows.lengths != 1).any():
            continue  # too short to be drawn at some frames
        scale = recording.properties["newtons_per_metre"]
        drawn = np.column_stack([np.interp(time, arrows.time, column) for column in arrows.values[:, :2].astype(float).T]) * scale
        worst = max(worst, float(np.abs(drawn - numbers[:, :2]).max() / np.abs(numbers[:, :2]).max()))
    assert 0.02 * target < worst <= target + 2e-7, "arrows are float32"
    monkeypatch.undo()
    assert dataclasses.replace(run, accuracy=accuracy_for(1e-1)).resolved_accuracy.pictures == 2, (
        "as many as without a target, at least"
    )
    finer = dataclasses.replace(run, accuracy=accuracy_for(1e-9))
    assert finer.resolved_accuracy.pictures == 1
    assert dataclasses.replace(run, accuracy=accuracy_for(target, pictures=5)).resolved_accuracy.pictures == 5


# -- frames --------------------------------------------------------------------------------------------------------------------
def test_a_target_that_needs_too_many_frames_is_named(monkeypatch, capsys):
    assert fit_module.MOST_FRAMES_FITTED >= 200_000
    monkeypatch.setattr(fit_module, "MOST_FRAMES_FITTED", 300)
    run = run_scene(load("crank-rocker"), accuracy=accuracy_for(1e-8, interpolation=1))
    assert run.fit.frames == 300 and run.fit.error > 1e-8
    (words, _) = target_lines(run)
    assert words.startswith("warning: accuracy 1e-08") and "not reached" in words and "quintic" in words
    # the error of straight lines falls with the square of the frames
    assert run.fit.needed_frames == pytest.approx(300 * (run.fit.error / 0.9e-8) ** 0.5, rel=0.1)
    monkeypatch.undo()
    enough = run_scene(load("crank-rocker"), accuracy=accuracy_for(1e-8, interpolation=1))
    assert enough.fit.error <= 1e-8 and enough.fit.frames < 1.2 * run.fit.needed_frames and enough.fit.needed_frames is None


def test_stated_frames_that_do_not_reach_the_target_are_named():
    stated = run_scene(load("crank-rocker"), frames=60, accuracy=1e-9)
    assert target_lines(stated)[0].startswith("warning: accuracy 1e-09 with the 60 frames that are stated")
    assert "reached between the frames" in target_lines(run_scene(load("crank-rocker"), frames=720, accuracy=1e-6))[0]
    told = CliRunner().invoke(app, ["forces", "slider-crank-compressor", "--frames", "60", "--accuracy", "1e-9"])
    assert told.exit_code == 0 and "warning: accuracy 1e-09" in told.stderr


# -- between the frames -----------------------------------------------------------------------------------------------------------
def test_numbers_between_frames_use_the_recorded_rates():
    """A motion t^5 is read exactly by quintics, its rate by cubics and quintics, and its second rate through its neighbours."""
    time = np.linspace(0.0, 2.0, 9)
    t = np.linspace(0.0, 2.0, 57)
    path = ("data", "joints", "A", "motion")
    table = np.column_stack([time**5, 5 * time**4, 20 * time**3])
    frames = interpolate_table(path, time, {path: table}.get, t, 5)
    assert np.abs(frames - np.column_stack([t**5, 5 * t**4, 20 * t**3])).max() < 1e-11
    pose, velocity = ("data", "links", "a", "pose"), ("data", "links", "a", "velocity")
    tables = {pose: np.tile(time[:, None] ** 3, 3), velocity: np.tile(3 * time[:, None] ** 2, 3)}
    assert derivative_paths(pose) == (velocity, ("data", "links", "a", "acceleration"))
    assert np.abs(interpolate_table(pose, time, tables.get, t, 3) - t[:, None] ** 3).max() < 1e-13
    assert np.abs(interpolate_table(pose, time, tables.get, t, 1) - t[:, None] ** 3).max() > 1e-3
    wrench = ("data", "drive", "A", "wrench")
    assert np.abs(interpolate_table(wrench, time, {wrench: table}.get, t, 1)[:, 0] - np.interp(t, time, table[:, 0])).max() < 1e-13
    with pytest.raises(KeyError, match="/data/links/b/pose"):
        interpolate_table(("data", "links", "b", "pose"), time, tables.get, t, 3)


@pytest.mark.parametrize(("words", "order"), [("hold", 0), ("linear", 1), ("cubic", 3), ("quintic", 5)])
def test_a_recording_is_read_by_the_interpolation_of_its_scene(words, order, tmp_path):
    run = run_scene(load("crank-rocker").changed({("accuracy",): {"interpolation": words}}), frames=24)
    recording = Recording(write_recording(run, tmp_path / "a.rrd").path)
    assert recording.parsed_properties.interpolation == order
    path, t = ("data", "links", "rocker", "pose"), random_times(run, 1)
    read = interpolate_table(path, run.motion.time, lambda path: run.numbers.values(*path), t, order)
    assert np.abs(recording.at(t, *path) - read).max() < 1e-8


def test_rows_are_no_farther_apart_than_a_run_is_long():
    run = run_scene(load("crank-rocker"), frames=4)
    assert len(even_times(run, 1.0)) == 2
    for step in (3.0, 1.001, 0.0, -1.0, 1e-12):
        with pytest.raises(MechanismError, match=r"between rows is too \w+\. Give a time .* s to 1 s, the length of the run"):
            even_times(run, step)


def test_a_table_has_a_row_every_so_often(tmp_path):
    scene = load("crank-rocker")
    run = run_scene(scene, accuracy=1e-7)
    columns = wide_table(run, even_times(run, 0.01))
    exact = run_scene(scene, frames=3600)
    fine = wide_table(exact)
    for name in ("rocker.angle [rad]", "coupler.x [m]"):
        truth = np.interp(columns["time [s]"], fine["time [s]"], fine[name])
        assert np.abs(columns[name] - truth).max() < 1e-5
    path = tmp_path / "a.csv"
    done = CliRunner().invoke(app, ["export", "crank-rocker", "--csv", str(path), "--every", "20 ms", "--accuracy", "1e-5"])
    assert done.exit_code == 0, done.stderr
    times = [float(row[0]) for row in list(csv.reader(path.open(encoding="utf-8")))[1:]]
    assert np.allclose(np.diff(times), 0.02)
    wrong = CliRunner().invoke(app, ["export", "crank-rocker", "--csv", str(path), "--every", "0 s"])
    assert wrong.exit_code == 2 and "between rows is too" in wrong.stderr


@pytest.mark.parametrize("order", [1, 3, 5])
def test_rows_next_to_impacts_are_those_of_the_motion(order):
    """A ball that bounces: parabolas between its impacts, through which no polynomial over frames goes."""
    b = SceneBuilder("ball").link("frame", O=(0, 0)).link("ball", O=(0, 0), mass=2)
    stops = [{"at": 0, "side": "lower", "restitution": 0.5}]
    b.joint("O", "prismatic", "frame", "ball", along=(0, 1), free={"position": 1}, stops=stops).effect("gravity").effect("inertia")
    run = run_scene(b.run(duration="1.2 s", frames=40).scene(), accuracy=Accuracy(interpolation=order))
    t = np.linspace(0.0, 1.2, 501)
    first = np.sqrt(2.0 / 9.81)
    speed = 9.81 * first  # at the first impact, half of it after that
    lands = np.array([0.0, first, first + speed / 9.81, first + 1.5 * speed / 9.81])
    leaves, phase = speed * np.array([0.0, 0.5, 0.25, 0.125]), np.searchsorted(lands, t, side="right") - 1
    since, leaving = t - lands[phase], leaves[phase]
    columns = wide_table(run, t)
    step = 1.2 / 40 if order == 1 else 0.0  # chords of parabolas
    height = (phase <= 0) + (leaving - 0.5 * 9.81 * since) * since
    assert np.abs(columns["ball.vy [m/s]"] - (leaving - 9.81 * since)).max() < 1e-8
    assert np.abs(columns["ball.y [m]"] - height).max() < 1e-8 + 9.81 * step**2 / 8.0
    assert np.abs(columns["stop O lower.load.Fy [N]"]).max() < 1e-8
    assert np.abs(columns["energy.kinetic [J]"] - columns["ball.vy [m/s]"] ** 2).max() < 1e-8 + (9.81 * step / 2.0) ** 2


def test_rows_next_to_a_step_have_both_sides_of_it_and_turns_stay_counted():
    scene = load("gear-train").changed({("loads", "late"): {"torque": "1 N m", "on": "output", "step": {"at": "3.01 s"}}})
    run = run_scene(scene, frames=48)
    t = np.linspace(0.0, float(run.motion.time[-1]), 301)
    columns, fine = wide_table(run, t), wide_table(run_scene(scene, frames=300))
    np.testing.assert_allclose(columns["late.load.moment [N m]"], 1.0 * (t > 3.01), atol=1e-12)
    for link in ("motor", "output"):
        np.testing.assert_allclose(columns[f"{link}.angle [rad]"], fine[f"{link}.angle [rad]"], atol=1e-9)


def test_traced_points_go_along_arcs_even_where_links_turn_evenly():
    """A wheel on its shaft: its pose is a straight line in time, its rim is none. Sagitta of a chord: r (1 - cos(pi / n))."""
    scene = Scene.build(
        links={"frame": {"points": {"A": [0, 0]}}, "wheel": {"points": {"A": [0, 0], "B": [0.1, 0]}}},
        joints={"A": {"revolute": ["frame", "wheel"], "drive": {"speed": "60 rpm"}}},
        trace=["B"],
    )
    run = run_scene(scene, accuracy=1e-3)
    away = 0.1 / run.motion.model.length_scale * (1.0 - np.cos(np.pi / run.fit.frames))
    assert 0.1e-3 < away <= 1e-3 and away == pytest.approx(run.fit.error, rel=1e-3)


@pytest.mark.parametrize("name", ["cam-conjugate", "cam-constant-acceleration", "cam-friction", "connecting-rod-bending"])
def test_rows_between_frames_are_those_of_a_run_with_these_frames(name):
    """The flank that carries changes, a cycle ends in a jump of velocity, friction turns round, studies have kinks: no polynomial
    through frames reads these."""
    coarse, fine = (run_scene(load(name), frames=frames) for frames in (36, 108))
    known, read = wide_table(fine), wide_table(coarse, fine.motion.time)
    assert list(read) == list(known)
    for column, values in known.items():
        if not column.startswith(("health", "error_estimate", "energy.work", "energy.dissipated")):  # known at frames only
            room = 1e-9 * np.nanmax(np.abs(values), initial=1.0)
            np.testing.assert_allclose(read[column], values, atol=room, rtol=0.0, err_msg=column)


def test_held_values_stay_held_between_frames():
    scene = load("crank-rocker").changed({("accuracy",): {"interpolation": "hold"}})
    run = run_scene(scene, frames=10)
    columns = wide_table(run, even_times(run, 0.05))
    np.testing.assert_array_equal(columns["rocker.angle [rad]"][1::2], columns["rocker.angle [rad]"][:-1:2])
