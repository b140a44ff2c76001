"""Simulations that are watched while they run: blocks in the unfinished recording, viewers' port, interruptions."""

from __future__ import annotations

import shutil
import socket
import threading
from pathlib import Path

import numpy as np
import pytest
from live_scenes import BOUNCING
from patience import PATIENCE
from typer.testing import CliRunner

import mechviz
from mechcore.errors import Fault, MechanismError
from mechviz.commands.main import app
from mechviz.outputs.rerun.entities import RecordingError
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.stream_file import free_port, part_path
from mechviz.outputs.rerun.writer import live, write_recording
from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.growth import Computing, Stopped
from mechviz.picture.nodes import Arrow
from mechviz.runs import Running, run_scene, with_frames_and_cycles


@pytest.fixture(scope="module")
def scene():
    return with_frames_and_cycles(mechviz.load("swinging-double-pendulum"), 200, None)


def test_what_is_known_can_be_read_and_watched_while_it_runs(scene, tmp_path: Path):
    path = tmp_path / "x.rrd"
    seen: list[int] = []

    def told(frames: int) -> None:
        seen.append(frames)
        if len(seen) == 3:  # somebody looks at it
            shutil.copy(part_path(path), tmp_path / "early.rrd")
            assert address is not None
            with socket.create_connection(("127.0.0.1", int(address.split(":")[2].split("/")[0])), timeout=PATIENCE):
                pass

    with live(scene, path, 0, told) as (observer, address):
        run = run_scene(scene, observe=observer)
    assert not part_path(path).exists() and not path.exists()
    assert seen == sorted(seen) and len(seen) >= 5 and seen[-1] == run.motion.frames
    early = Recording(tmp_path / "early.rrd")
    link = run.motion.model.links[1]
    times, pose = early.scalars("data", "links", link, "pose")
    assert len(times) == seen[2] < run.motion.frames
    assert pose == pytest.approx(run.motion.pose(link)[: len(pose)], abs=1e-9)
    _, motion = early.scalars("data", "joints", run.scene.mechanism.drives[0].joint, "motion")
    assert motion == pytest.approx(run.motion.coordinate(run.scene.mechanism.drives[0].joint)[: len(pose)], abs=1e-6)
    write_recording(run, path)
    whole = Recording(path)
    for item in (("energy",), ("joints", run.scene.mechanism.joints[0].name, "reaction"), ("power",)):
        known, final = early.scalars("data", *item)[1], whole.scalars("data", *item)[1]
        assert known.shape == final[: len(pose)].shape and known == pytest.approx(
            final[: len(pose)], abs=1e-9 * np.abs(final).max()
        )
    assert len(Recording(path).scalars("data", "links", link, "pose")[0]) == run.motion.frames


def test_an_interruption_leaves_what_was_known(scene, tmp_path: Path):
    path = tmp_path / "x.rrd"

    def told(frames: int) -> None:
        if frames > 0.3 * scene.frames:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stop, live(scene, path, None, told) as (observer, address):
        assert address is None
        run_scene(scene, observe=observer)
    assert "frames written so far are in" in stop.value.__notes__[0]
    left = Recording(part_path(path))
    t = left.scalars("data", "links", "upper", "pose")[0]
    assert 0.3 * scene.frames < len(t) < scene.frames and np.all(np.diff(t) > 0)


def test_followers_that_fly_are_shown_too(tmp_path: Path):
    scene = mechviz.loads(
        mechviz.load("valve-float").text.replace('frames = 960\nduration = "180 ms"', 'frames = 300\nduration = "95 ms"')
    )
    sent: list[int] = []
    with live(scene, tmp_path / "x.rrd", None, sent.append) as (observer, _):
        run_scene(scene, observe=observer, outputs=["positions"])
    assert sent[-1] == scene.frames + 1


STICKING = mechviz.load("stick-slip-feed").text.replace('frames = 1200\nduration = "6 s"', 'frames = 90\nduration = "1.8 s"')
SWINGING = BOUNCING[: BOUNCING.index("stops")]


@pytest.mark.parametrize("text", [BOUNCING, STICKING, SWINGING], ids=["bouncing", "sticking", "swinging"])
def test_stretches_make_the_whole_with_its_works_and_losses(text: str):
    """Impacts, stops, sticking, motion by energy: blocks say what the whole motion says in the end."""
    scene = mechviz.loads(text)
    running, blocks = Running(scene), []

    def observe(stretch, duration: float) -> None:
        computed = running.take(stretch, duration)
        if computed is not None:
            blocks.append(computed)

    run = run_scene(scene, observe=observe)
    so_far = running.so_far()
    assert so_far.motion.frames == run.motion.frames == sum(b.motion.frames for b in blocks)
    assert so_far.simulation is not None and run.simulation is not None
    energy = run.forces.energy
    size = np.abs(energy).max()
    assert so_far.forces.energy == pytest.approx(energy, abs=1e-12 * size)
    assert np.concatenate([b.forces.energy for b in blocks]) == pytest.approx(energy, abs=1e-12 * size)
    for joint in (p.name for p in scene.mechanism.joints):
        assert so_far.motion.coordinate(joint) == pytest.approx(run.motion.coordinate(joint), rel=1e-9, abs=1e-12)
        assert so_far.forces.reaction(joint) == pytest.approx(run.forces.reaction(joint), rel=1e-7, abs=1e-9)
    # what happens at the very end begins no stretch
    assert so_far.simulation.events == run.simulation.events[: len(so_far.simulation.events)]
    assert len(so_far.simulation.events) >= len(run.simulation.events) - 2
    assert len(so_far.simulation.segments) <= len(run.simulation.segments)
    assert sum(e for _, e in so_far.simulation.impact_losses) == pytest.approx(
        sum(e for _, e in run.simulation.impact_losses), abs=1e-12 * size
    )


def test_the_viewer_shows_a_motion_from_its_first_frames_on():
    """The computing is held until the viewer has shown how far it is, so that no step depends on the clock."""
    scene = mechviz.loads(BOUNCING)
    go_on, reached = threading.Event(), threading.Event()
    count = 0

    def solve(observe):
        def held(stretch, duration: float) -> None:
            nonlocal count
            observe(stretch, duration)
            count += 1
            if stretch.duration > 0.4 * duration and not go_on.is_set():
                reached.set()
                assert go_on.wait(PATIENCE)

        return run_scene(scene, observe=held)

    with Computing(solve, scene) as computing:
        while computing.wait() and (run := computing.latest_run()) is None:
            pass
        assert run is not None and run.motion.frames < scene.frames
        with Viewer(run, port=0, growing=True) as viewer:
            viewer.grow(run, computing.duration)
            first = viewer.inspector.view_model
            assert viewer.frame == first.frames - 1 == run.motion.frames - 1
            assert all(len(a.vector.value) == first.frames for a in first.picture.nodes_of(Arrow, "reaction"))  # forces, too
            assert reached.wait(PATIENCE)
            later = computing.running.so_far()
            viewer.grow(later, computing.duration)
            assert viewer.inspector.view_model.frames == later.motion.frames >= first.frames
            assert viewer.frame == viewer.timeline.slider.max == later.motion.frames - 1  # who is at the end goes along
            viewer.set_frame(0)
            go_on.set()
            while computing.wait():
                pass
            assert computing.run is not None and computing.error is None
            viewer.grow(computing.running.so_far(), computing.duration)
            assert viewer.frame == 0 and viewer.timeline.slider.max == scene.frames  # who looks at something else stays there
            viewer.finish(computing.run)
            assert viewer.frame == 0 and viewer.run is computing.run and viewer.session.parameters


def test_a_motion_that_ends_early_is_kept_on_show(scene):
    """What is known stays, with the reason; what is left early stops computing."""
    asked = threading.Event()

    def solve(observe):
        def broken(stretch, duration: float) -> None:
            observe(stretch, duration)
            if stretch.duration > 0.3 * duration:
                assert asked.wait(PATIENCE)
                raise MechanismError(Fault("dynamics", "the rope breaks.", "Take a stronger one."))

        return run_scene(scene, observe=broken)

    with Computing(solve, scene) as computing:
        while computing.wait() and (run := computing.latest_run()) is None:
            pass
        asked.set()
        while computing.wait():
            pass
        assert isinstance(computing.error, MechanismError) and computing.run is None
        with Viewer(run, port=0, growing=True) as viewer:
            viewer.fail(computing.error)
            assert "the rope breaks" in viewer.growth.words and viewer.inspector.view_model.frames == run.motion.frames
    with Computing(lambda observe: run_scene(scene, observe=observe), scene) as computing:
        computing.stop()
        while computing.wait():
            pass
        assert isinstance(computing.error, Stopped) and computing.run is None


def test_faults_are_told(scene, tmp_path: Path, capfd):
    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))
        busy.listen()
        words = "cannot be opened: another program uses it. Give another one"
        with pytest.raises(RecordingError, match=words), live(scene, tmp_path / "x.rrd", busy.getsockname()[1]):
            pass
    assert capfd.readouterr() == ("", ""), "no warning of rerun's"
    assert not list(tmp_path.iterdir()) and free_port() > 0
    result = CliRunner().invoke(app, ["record", "crank-rocker", "-o", str(tmp_path / "x.rrd"), "--live", "0"])
    assert result.exit_code == 2 and "nothing is free" in result.output
    result = CliRunner().invoke(app, ["view", "crank-rocker", "--live"])
    assert result.exit_code == 2 and "nothing is free" in result.output
    result = CliRunner().invoke(app, ["view", "x.rrd", "--live"])
    assert result.exit_code == 2 and "--live is for scenes" in result.output


def test_the_command_writes_the_whole_recording_in_the_end(tmp_path: Path):
    path = tmp_path / "x.rrd"
    result = CliRunner().invoke(app, ["record", "pendulum-near-the-top", "-o", str(path), "--live", "0", "--frames", "50"])
    assert result.exit_code == 0, result.output
    assert "watch it with: rerun rerun+http://127.0.0.1:" in result.output
    assert len(Recording(path).scalars("data", "energy")[0]) == 51
