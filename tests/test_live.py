"""Simulations that are watched while they run: blocks in the unfinished recording, viewers' port, interruptions."""

from __future__ import annotations

import shutil
import socket
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import mechviz
from mechviz.cli import app
from mechviz.record import Recording, RecordingError, write_recording
from mechviz.record.live import live
from mechviz.record.stream_file import free_port, part_path
from mechviz.run import run_scene, with_run


@pytest.fixture(scope="module")
def scene():
    return with_run(mechviz.load("swinging-double-pendulum"), 200, None)


def test_what_is_known_can_be_read_and_watched_while_it_runs(scene, tmp_path: Path):
    path = tmp_path / "x.rrd"
    seen: list[int] = []

    def told(frames: int) -> None:
        seen.append(frames)
        if len(seen) == 3:  # somebody looks at it
            shutil.copy(part_path(path), tmp_path / "early.rrd")
            assert address is not None
            with socket.create_connection(("127.0.0.1", int(address.split(":")[2].split("/")[0])), timeout=5):
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
    _, motion = early.scalars("data", "joints", run.scene.mechanism.drives[0].pair, "motion")
    assert motion == pytest.approx(run.motion.coordinate(run.scene.mechanism.drives[0].pair)[: len(pose)], abs=1e-6)
    write_recording(run, path)
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


def test_faults_are_told(scene, tmp_path: Path):
    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))
        busy.listen()
        with pytest.raises(RecordingError, match="cannot be opened"), live(scene, tmp_path / "x.rrd", busy.getsockname()[1]):
            pass
    assert not list(tmp_path.iterdir()) and free_port() > 0
    result = CliRunner().invoke(app, ["record", "crank-rocker", "-o", str(tmp_path / "x.rrd"), "--live", "0"])
    assert result.exit_code == 2 and "nothing is free" in result.output


def test_the_command_writes_the_whole_recording_in_the_end(tmp_path: Path):
    path = tmp_path / "x.rrd"
    result = CliRunner().invoke(app, ["record", "pendulum-near-the-top", "-o", str(path), "--live", "0", "--frames", "50"])
    assert result.exit_code == 0, result.output
    assert "watch it with: rerun rerun+http://127.0.0.1:" in result.output
    assert len(Recording(path).scalars("data", "energy")[0]) == 51
