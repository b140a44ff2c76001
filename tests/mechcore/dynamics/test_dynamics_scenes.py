"""Motion under forces from scenes: keywords, faults, round trips, recordings read back."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from simulated_scenes import PENDULUM, STOPPED
from typer.testing import CliRunner

import mechviz
from mechcore.errors import MechanismError
from mechcore.laws.timed import Free
from mechviz.commands.main import app
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import run_scene


def fault_of(text: str, *changes: tuple[str, str]) -> str:
    """The report on a scene with some texts replaced, every one of which has to be there."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    with pytest.raises(mechviz.SceneError) as error:
        mechviz.loads(text)
    return re.sub(r"\s+", " ", str(error.value))


# --- reading and writing ----------------------------------------------------------------------------------------------


def test_a_free_joint_is_read_in_the_units_of_the_scene_and_written_back():
    scene = mechviz.loads(STOPPED + '[watch]\nlow = { point = "bar.E", of = "y", at = -390, rising = false, ends = true }\n')
    (drive,) = scene.mechanism.drives
    assert isinstance(drive.law, Free)
    assert (drive.law.start, drive.law.speed) == pytest.approx((-np.pi / 6, np.pi / 3), rel=1e-15)
    spec = scene.simulation
    assert spec is not None and (spec.duration, spec.tolerance, spec.method) == (2.0, 1e-9, "auto")
    lower, upper = spec.stops
    assert (lower.name, lower.joint, lower.side, lower.restitution) == ("O lower", "O", "lower", 0.5)
    assert lower.at == pytest.approx(np.radians(-100.0)) and upper.name == "roof" and upper.restitution == 0.0
    (watch,) = spec.triggers
    assert (watch.point, watch.of, watch.rising, watch.ends) == (("bar", "E"), "y", False, True)
    assert watch.at == pytest.approx(-0.39)
    again = mechviz.loads(scene.to_toml())
    assert again == scene and again.simulation.stops == spec.stops and again.simulation.triggers == spec.triggers
    assert again.to_toml() == scene.to_toml()


def test_prescribed_drives_stand_beside_free_coordinates():
    """A double pendulum whose upper joint turns evenly: the lower bar swings; the drive's work closes the balance."""
    text = PENDULUM.replace("[joints]", 'low = { points = { E = [0, 0], F = [300, 0] }, mass = 1, shape = "bar" }\n[joints]')
    text = text.replace('free = { position = -30, speed = "10 rpm" }', 'drive = { speed = "60 rpm" }')
    text += 'E = { revolute = ["bar", "low"], free = { position = 20 } }\n'
    run = run_scene(mechviz.loads(text))
    assert [d.joint for d in run.motion.mechanism.drives] == ["O"]
    assert run.motion.coordinate("O")[:, 1] == pytest.approx(2 * np.pi)
    assert np.abs(run.forces.effort("O")).max() > 1.0
    assert np.abs(run.simulation.drift(run.motion.time)).max() < 1e-7
    energy = run.forces.energy
    assert np.ptp(energy[:, 0] + energy[:, 1] - energy[:, 2] + energy[:, 3]) < 1e-7 * np.abs(energy).max()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ((('duration = "2 s"', ""),), "'duration' is missing: how long does O move? Add duration"),
        (
            (('"inertia", ', ""),),
            'O is free, motion under forces needs masses, and inertia is not named. Add "inertia" to effects.',
        ),
        ((("free =", 'drive = { speed = "1 rpm" }, free ='),), "free and drive at once"),
        ((('"2 s"', '"2 m"'),), "run.duration"),
        ((('"10 rpm"', '"10 mm/s"'),), "joints.O.free.speed"),
        ((("free = {", 'side = "left", free = {'),), "side on a free joint, whose position its start decides."),
        ((("frames = 100", "frames = 100\ncycles = 2"),), "2 cycles of a motion that forces decide."),
        ((("frames = 100", 'frames = 100\nmethod = "gaus"'),), "Did you mean 'gauss'?"),
        ((("frames = 100", "frames = 100\ntolerance = 2"),), "2 is no tolerance."),
        ((('"2 s"', '"1e-12 s"'),), "run.duration 1e-12 s for 100 frames: the clock of a recording counts nanoseconds"),
        ((("free =", "fre ="),), "unknown key 'fre'. Did you mean 'free'?"),
        ((('rpm" } }', 'rpm" }, stops = [{ at = -40, side = "upper" }] }'),), "the motion starts above this upper stop."),
        ((('rpm" } }', 'rpm" }, stops = [{ at = 40 }] }'),), "'side' is missing"),
        (
            (('rpm" } }', 'rpm" }, stops = [{ at = 40, side = "upper", restitution = 1.5 }] }'),),
            "1.5 is no coefficient of restitution.",
        ),
        (
            (('rpm" } }', 'rpm" }, stops = [{ at = 40, side = "upper" }, { at = 50, side = "upper" }] }'),),
            "two stops are called 'O upper'",
        ),
        ((("[run]", 'polygons = ["velocity"]\n[run]'),), "'polygons' is for prescribed motions only"),
        ((("[run]", 'metrics = ["velocity_ratio"]\n[run]'),), "velocity_ratio is defined per unit speed of a drive"),
        ((("[joints]", '[watch]\nw = { joint = "P" }\n[joints]'),), "there is no joint 'P'"),
        ((("[joints]", '[watch]\nw = { joint = "O", of = "x" }\n[joints]'),), "'x' of a joint."),
        ((("[joints]", '[watch]\nw = { joint = "O", point = "bar.E" }\n[joints]'),), "a joint and a point at once to watch."),
        ((("[joints]", '[watch]\nw = { point = "bar.F" }\n[joints]'),), "link 'bar' has no point 'F'"),
    ],
)
def test_faults_name_the_item_and_the_remedy(changes, words):
    assert words in fault_of(PENDULUM, *changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ((), "run.duration nothing is free: the drive decides the motion."),
        ((('duration = "2 s"', "tolerance = 1e-6"),), "run.tolerance nothing is free"),
        (
            (('duration = "2 s"', ""), ('rpm" } }', 'rpm" }, stops = [{ at = 40, side = "upper" }] }')),
            "joints.O.stops nothing is free",
        ),
        ((('duration = "2 s"', ""), ("[joints]", '[watch]\nw = { joint = "O" }\n[joints]')), "watch.w nothing is free"),
    ],
)
def test_what_only_a_motion_under_forces_has_is_refused_elsewhere(changes, words):
    driven = PENDULUM.replace('free = { position = -30, speed = "10 rpm" }', 'drive = { speed = "60 rpm" }')
    assert words in fault_of(driven, *changes)


def test_faults_of_the_simulation_reach_the_command_line(tmp_path: Path):
    path = tmp_path / "light.toml"
    path.write_text(PENDULUM.replace('mass = "1 kg", shape = "bar"', "mass = 0"))
    result = CliRunner().invoke(app, ["record", str(path), "-o", str(tmp_path / "x.rrd")])
    assert result.exit_code == 2 and "moves no mass" in result.output
    assert not list(tmp_path.glob("*.rrd"))


# --- motions ----------------------------------------------------------------------------------------------------------


def test_a_stop_holds_what_rests_on_it_and_every_link_is_in_balance():
    """The bar falls on a stop and stays: there the stop's moment is the weight's, and the pin carries the weight."""
    text = PENDULUM.replace("position = -30", "position = 0").replace('speed = "10 rpm"', "speed = 0")
    text = text.replace("speed = 0 } }", 'speed = 0 }, stops = [{ at = -20, side = "lower" }] }\n')
    run = run_scene(mechviz.loads(text))
    kinds = [h.kind for h in run.simulation.events]
    assert kinds[:2] == ["impact", "contact"]
    held = run.motion.time > run.simulation.events[1].time
    load = run.forces.loads["stop O lower"]
    assert load.values[held, 2] == pytest.approx(9.81 * 0.2 * np.cos(np.radians(20.0)), rel=1e-9)
    assert load.values[~held].any(axis=0)[:3].sum() == 0
    assert run.forces.reaction("O")[held, 1] == pytest.approx(9.81, rel=1e-9)
    assert np.abs(run.forces.power_balance).max() < 1e-10
    energy = run.forces.energy
    fallen = 9.81 * 0.2 * np.sin(np.radians(20.0))
    assert energy[-1] == pytest.approx([0.0, -fallen, 0.0, fallen], abs=1e-9)


def test_a_watch_ends_the_motion_there_and_the_frames_fill_what_is_left():
    text = PENDULUM.replace("position = -30", "position = 0").replace('speed = "10 rpm"', "speed = 0")
    run = run_scene(mechviz.loads(text + '[watch]\nbottom = { joint = "O", at = -90, ends = true }\n'))
    assert run.motion.frames == 101 and run.motion.time[-1] == run.simulation.duration < 2.0
    assert run.motion.coordinate("O")[-1, 0] == pytest.approx(-np.pi / 2, abs=1e-9)
    # a bar about its end: omega^2 = 3 g / l
    assert run.motion.coordinate("O")[-1, 1] == pytest.approx(-np.sqrt(3 * 9.81 / 0.4), rel=1e-8)


def test_the_squeezer_of_the_gallery_is_the_published_one():
    from mechanisms import case

    expected = case("andrews", "andrews-squeezer")["expected"]
    row = expected["rows"][-1] if "rows" in expected else expected["samples"][-1]
    run = run_scene(mechviz.load("andrews-squeezer"))
    assert run.motion.time[-1] == pytest.approx(row["t"])
    assert run.motion.coordinate("O")[-1, 0] == pytest.approx(row["q"]["beta"] if "q" in row else row["beta"], rel=1e-10)


# --- recordings -------------------------------------------------------------------------------------------------------


def test_lanes_of_a_stop_tell_contact_and_release(tmp_path: Path):
    from mechviz.quantities.events import lanes_of

    text = PENDULUM.replace("position = -30", "position = 0").replace('speed = "10 rpm"', "speed = 0")
    text = text.replace("speed = 0 } }", 'speed = 0 }, stops = [{ at = -20, side = "lower" }] }\n')
    run = run_scene(mechviz.loads(text))
    ((name, changes),) = lanes_of(run.simulation).items()
    assert name == "stop O lower" and [s for _, s in changes] == ["free", "contact"]
    write_recording(run, tmp_path / "x.rrd")
    assert "/state/stop O lower" in {e.replace("\\", "") for e in Recording(tmp_path / "x.rrd").entities}


def _seated(side: str, start: int) -> mechviz.Scene:
    """The valve train of the gallery for two turns, with a seat above the base circle."""
    text = next(e for e in mechviz.gallery() if e.name == "valve-float").path.read_text()
    for old, new in (
        ("angle = 180 }", f'angle = 180, stops = [{{ at = -34, side = "{side}", restitution = 0.3 }}] }}'),
        ('duration = "180 ms"\ntol', 'duration = "23 ms"\ntol'),
        ("frames = 960", "frames = 60"),
        ("start = [180,", f"start = [{start},"),
    ):
        assert old in text
        text = text.replace(old, new)
    return mechviz.loads(text)


def test_a_follower_leaves_its_cam_where_a_seat_holds_it_up(tmp_path: Path):
    run = run_scene(_seated("lower", 180))
    assert run.simulation is not None
    texts = [h.text for h in run.simulation.events]
    assert texts[0] == "contact lost at 106.1° of the cam" and texts[1].startswith("S hits stop S lower at 3.8")
    # the lift is symmetric about 70 deg: the cam comes back to the valve on its seat as far before it as it left it behind
    assert texts[texts.index("S leaves stop S lower") - 1].startswith("bounces at 33.9° of the cam")
    assert run.motion.coordinate("S")[:, 0].min() > -0.034 * (1.0 + 1e-9)
    write_recording(run, tmp_path / "x.rrd")
    kinetic, potential, work, dissipated = Recording(tmp_path / "x.rrd").scalars("data", "energy")[1].T
    assert np.ptp(kinetic + potential - work + dissipated) <= 1e-7 * np.abs(work).max()
    assert dissipated[-1] > 0.5 * 0.11 * 3.8**2 * (1.0 - 0.3**2)  # of the first impact of 0.11 kg


def test_a_stop_into_which_a_cam_drives_its_follower_is_refused():
    with pytest.raises(MechanismError, match=r"(?s)joints.S.stops.*S strikes its upper stop, but prescribed drives"):
        run_scene(_seated("upper", 0))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            (('"2 s"', '"1e9 s"'), ('"10 rpm"', '"0 rpm"')),
            r"(?s)run.duration.*1e\+09 s are .* periods; motions are followed over 50,000 at most",
        ),
        ((('"10 rpm"', '"1e7 rpm"'),), r"(?s)joints.O.free.speed.*it would go 333333 turns in 2 s"),
        (
            (("frames =", 'method = "energy"\nframes ='), (" } }\n", ' }, stops = [{ at = 80, side = "upper" }] }\n')),
            r"run\.method",
        ),
    ],
)
def test_runs_that_nobody_would_wait_for_are_refused_by_the_scene_s_keys(changes, words):
    text = PENDULUM
    for old, new in changes:
        assert old in text
        text = text.replace(old, new) if old != " } }\n" else text[: text.rindex(old)] + new
    with pytest.raises(MechanismError, match=words):
        run_scene(mechviz.loads(text))


def test_a_start_beyond_a_stop_of_a_joint_that_is_led_is_told_in_units():
    text = next(e for e in mechviz.gallery() if e.name == "valve-float").path.read_text()
    text = text.replace("angle = 180 }", 'angle = 180, stops = [{ at = -90, side = "upper" }] }')
    with pytest.raises(MechanismError, match=r"(?s)joints\.S\.stops.*starts 60.5 mm above the upper stop 'S upper' at -90 mm"):
        run_scene(mechviz.loads(text))


def test_a_duration_beside_a_cam_that_only_presses_names_liftoff():
    with pytest.raises(mechviz.SceneError, match=r"joints\.\w+\.liftoff = \{\}"):
        mechviz.load("cam-flat").changed({("run", "duration"): "0.1 s"})
