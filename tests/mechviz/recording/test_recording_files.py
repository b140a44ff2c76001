"""Recordings as files: replaced whole or not at all, interrupted runs readable, clear words for every failure."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import textwrap
import threading
from pathlib import Path

import numpy as np
import pytest
from patience import PATIENCE

from mechviz.outputs.inspection import format_inspection, inspect
from mechviz.outputs.rerun.entities import RecordingError
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.quantities.tables import tables
from mechviz.runs import Run, run_scene
from mechviz.scene.scene import load
from recordings import FRAMES, made, ran

ROOT = Path(__file__).resolve().parents[3]


def crank_rocker() -> Run:
    return ran("crank-rocker")


def test_the_example_that_is_kept_holds_what_is_recorded_today():
    """It lies beside the recordings that commands write, so that none of them replaces it."""
    kept = sorted((ROOT / "recordings" / "examples").glob("*.rrd"))
    assert [path.stem for path in kept] == ["crank-rocker"]
    example, run = Recording(kept[0]), run_scene(load("crank-rocker"))
    for table in tables(run):
        np.testing.assert_allclose(example.scalars(*table.path)[1], table.values, rtol=1e-9, atol=1e-11, err_msg=str(table.path))


def test_a_recording_takes_the_place_of_the_old_one(tmp_path):
    path = tmp_path / "a.rrd"
    path.write_bytes(b"old")
    seen = []
    summary = write_recording(crank_rocker(), path, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (FRAMES + 1, FRAMES + 1)
    assert summary.bytes == path.stat().st_size and summary.frames == FRAMES + 1
    assert [p.name for p in tmp_path.iterdir()] == ["a.rrd"]
    assert "left out: effect inertia" in summary.costs() and "kB a frame" in summary.costs()


@pytest.mark.thorough
def test_many_recordings_in_one_process_keep_no_threads_files_or_memory(tmp_path):
    def held() -> tuple[int, int]:
        return len(os.listdir("/proc/self/task")), len(os.listdir("/proc/self/fd"))

    def resident() -> float:
        return 4096e-6 * int(Path("/proc/self/statm").read_text().split()[1])

    run = ran("crank-rocker", 12)
    for _ in range(4):
        write_recording(run, tmp_path / "a.rrd")
    before, size = held(), resident()
    for _ in range(8):
        write_recording(run, tmp_path / "a.rrd")
    assert held() == before and resident() < size + 15.0  # 3 MB each, when threads stayed


def test_a_run_of_a_thousand_centuries_is_refused(tmp_path):
    scene = load("double-parallelogram")
    run = run_scene(scene.changed({("joints", "A", "drive", "oscillation", "period"): 1e12}), frames=8)
    with pytest.raises(RecordingError, match="292 years") as error:
        write_recording(run, tmp_path / "a.rrd")
    assert error.value.remedy and not list(tmp_path.iterdir())


def test_a_path_is_free_again_where_no_thread_can_be_made(tmp_path, monkeypatch):
    def none_left(self) -> None:
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as patched:
        patched.setattr(threading.Thread, "start", none_left)
        with pytest.raises(RecordingError, match="thread") as error:
            write_recording(crank_rocker(), tmp_path / "a.rrd")
    assert error.value.code == 1 and not list(tmp_path.iterdir())
    assert write_recording(crank_rocker(), tmp_path / "a.rrd").frames == FRAMES + 1


def test_recording_ids_differ_unless_given(tmp_path):
    from rerun.chunk import RrdReader

    ids = []
    for k, given in enumerate((None, None, "mine", "mine")):
        path = tmp_path / f"{k}.rrd"
        write_recording(crank_rocker(), path, recording_id=given)
        ids += [e.recording_id for e in RrdReader(path).recordings()]
        assert len(Recording(path).scalars("data", "links", "crank", "pose")[0]) == FRAMES + 1
    assert len(set(ids)) == 3 and ids[2:] == ["mine", "mine"]


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("missing/a.rrd", "does not exist"),
        ("file/a.rrd", "is not a folder"),
        (".", "is a folder"),
        ("/dev/null", "not a regular file"),
        ("/dev/full", "not a regular file"),
    ],
)
def test_places_that_cannot_be_written(tmp_path, path, words):
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match=words) as error:
        write_recording(crank_rocker(), tmp_path / path)
    assert error.value.remedy
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file"]


def test_a_full_disk_from_the_first_byte_on(tmp_path, monkeypatch):
    def full(*_: int) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "splice", full)
    (tmp_path / "a.rrd").write_bytes(b"old")
    with pytest.raises(RecordingError, match="disk is full"):
        write_recording(crank_rocker(), tmp_path / "a.rrd")
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"a.rrd": b"old"}


@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_what_a_stranger_puts_in_the_place_of_the_unfinished_file_is_not_touched(tmp_path, kind):
    victim, part = tmp_path / "victim", tmp_path / "a.part.rrd"
    victim.write_bytes(b"dear")
    part.symlink_to(victim) if kind == "link" else os.mkfifo(part)
    with pytest.raises(RecordingError, match="not a regular file") as error:
        write_recording(crank_rocker(), tmp_path / "a.rrd")
    assert error.value.remedy and victim.read_bytes() == b"dear" and part.is_symlink() == (kind == "link")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.part.rrd", "victim"]


def test_a_hard_link_in_the_place_of_the_unfinished_file_keeps_its_content(tmp_path):
    victim = tmp_path / "victim"
    victim.write_bytes(b"dear")
    os.link(victim, tmp_path / "a.part.rrd")
    write_recording(crank_rocker(), tmp_path / "a.rrd")
    assert victim.read_bytes() == b"dear" and Recording(tmp_path / "a.rrd").parsed_properties.complete


def test_two_runs_do_not_write_the_same_unfinished_file(tmp_path):
    def again(done: int, total: int) -> None:
        with pytest.raises(RecordingError, match="being written by another run"):
            write_recording(crank_rocker(), tmp_path / "a.rrd")

    assert write_recording(crank_rocker(), tmp_path / "a.rrd", progress=again).frames == FRAMES + 1
    assert [p.name for p in tmp_path.iterdir()] == ["a.rrd"]


def test_an_interrupted_run_keeps_what_it_had(tmp_path, monkeypatch):
    from mechviz.outputs.rerun import writer

    monkeypatch.setattr(writer, "BLOCK_FRAMES", 2000)

    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    path = tmp_path / "a.rrd"
    path.write_bytes(b"old")
    run = ran("crank-rocker", 4000)
    with pytest.raises(KeyboardInterrupt) as stopped:
        write_recording(run, path, progress=stop)
    assert path.read_bytes() == b"old"
    part = tmp_path / "a.part.rrd"
    assert f"2000 frames written so far are in '{part}'" in stopped.value.__notes__[0]
    inspection = inspect(part)
    assert inspection.frames == 2000 and not inspection.complete and "interrupted" in format_inspection(inspection)
    assert {len(Recording(part).scalars("health", "closure")[0]), inspection.frames} == {2000}


def test_interrupted_before_the_first_frame_nothing_is_left(tmp_path, monkeypatch):
    from mechviz.outputs.rerun import writer

    def stop(*_args, **_kwargs):
        raise SystemExit(143)

    monkeypatch.setattr(writer, "_send_streams", stop)
    with pytest.raises(SystemExit) as stopped:
        write_recording(crank_rocker(), tmp_path / "a.rrd")
    assert "was not made" in stopped.value.__notes__[0] and not list(tmp_path.iterdir())


def test_a_fault_of_ours_leaves_nothing_and_is_not_hidden(tmp_path, monkeypatch):
    from mechviz.outputs.rerun import writer

    def broken(*_args, **_kwargs):
        raise ZeroDivisionError

    monkeypatch.setattr(writer, "_send_streams", broken)
    with pytest.raises(ZeroDivisionError):
        write_recording(crank_rocker(), tmp_path / "a.rrd")
    assert not list(tmp_path.iterdir())


CHILD = """
import resource, signal, sys, time
import mechviz
from mechviz.outputs.rerun.entities import RecordingError
from mechviz.outputs.rerun import writer
from mechviz.runs import run_scene

writer.BLOCK_FRAMES = 2000

def leave(*_):
    sys.exit(143)

signal.signal(signal.SIGTERM, leave)
run = run_scene(mechviz.load("crank-rocker"), frames=12000)
def slowly(done, total):
    print(done, flush=True)
    time.sleep({pause})
if {limit}:
    resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
try:
    writer.write_recording(run, sys.argv[1], progress=slowly)
except RecordingError as error:
    print("ERROR", error, flush=True)
    sys.exit(1)
except (KeyboardInterrupt, SystemExit) as stop:
    print("NOTE", *stop.__notes__, flush=True)
    raise
"""


def child(path: Path, *, pause: float, limit: int = 0) -> subprocess.Popen[str]:
    """A process that records to ``path``, waits after each block, and may not write files beyond a limit [bytes]."""
    code = textwrap.dedent(CHILD).format(pause=pause, limit=limit)
    return subprocess.Popen(
        [sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ}
    )


@pytest.mark.sample(1)
@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, -signal.SIGINT), (signal.SIGKILL, -9)])
def test_signals_leave_a_readable_part(tmp_path, number, code):
    path = tmp_path / "a.rrd"
    path.write_bytes(b"old")
    process = child(path, pause=0.3)
    assert process.stdout is not None
    for line in process.stdout:
        if line.strip() == "4000":
            break
    process.send_signal(number)
    out, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == code
    assert path.read_bytes() == b"old"
    assert inspect(tmp_path / "a.part.rrd").frames in (4000, 6000)  # the next block may have been under way
    if number != signal.SIGKILL:
        assert "NOTE Interrupted" in out and "a.part.rrd" in out


def test_a_disk_that_fills_up_on_the_way(tmp_path):
    """A limit on the size of files stands for the end of the disk."""
    path = tmp_path / "a.rrd"
    path.write_bytes(b"old")
    process = child(path, pause=0.0, limit=6_000_000)
    out, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1 and "ERROR" in out and "larger than the limit" in out
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"a.rrd": b"old"}


def test_reading_says_what_is_wrong(tmp_path):
    import rerun as rr

    whole = made("crank-rocker").path.read_bytes()
    (tmp_path / "cut.rrd").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.rrd").write_text("hello")
    (tmp_path / "empty.rrd").write_text("")
    with rr.RecordingStream("other") as rec:
        rec.save(tmp_path / "other.rrd")
        rec.log("a", rr.Scalars(1.0))
    for name, words in {
        "cut.rrd": "holds no frames",
        "text.rrd": "not a rerun recording",
        "empty.rrd": "not a rerun recording",
        "other.rrd": "of the application 'other', not of mechviz",
        "missing.rrd": "There is no file",
        ".": "is a folder",
    }.items():
        with pytest.raises(RecordingError, match=words) as error:
            inspect(tmp_path / name)
        assert error.value.remedy


def test_inspection_reads_the_peaks_from_the_file():
    m = made("kinetostatic-four-bar")
    inspection = inspect(m.path)
    assert (inspection.scene, inspection.frames, inspection.frame) == ("kinetostatic-four-bar", FRAMES + 1, "frame")
    peaks = {p.item: p for p in inspection.peaks}
    torque = m.data("drive", "A")[:, 3]
    k = int(abs(torque).argmax())
    assert peaks["driving torque A"].value == torque[k] and peaks["driving torque A"].unit == "N m"
    assert peaks["driving torque A"].time == pytest.approx(m.time[k])
    assert peaks["driving torque A"].drive == f"{360 * k / FRAMES:.3f}°"
    assert {f"reaction {j}" for j in m.recording.model["joints"]} <= set(peaks)
    assert {h.item for h in inspection.health} >= {"closure", "condition", "power balance"}
    text = format_inspection(inspection)
    for words in ("Kinetostatics of a four-bar", "crank", "revolute: frame - crank", "effect gravity", "limit position", "N m"):
        assert words in text
