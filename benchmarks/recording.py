"""Recording throughput: frames of the ten-link gallery scenes, as kinematics and with forces and all, against the SDK's own limit.

python benchmarks/recording.py [--short]

The limit: the very same columns, kept ready from a recording, are sent once more to a file and nothing else is done. A recording of
ours is on the disk when it is there (fsync); the SDK leaves that to the system. Both are compared: with the SDK, and with the SDK
and as long as the disk takes for its file.
"""

from __future__ import annotations

from timing import machine  # first: it sets one thread

import argparse  # isort: skip
import os
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import rerun as rr

import mechviz
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import Run, run_scene


def calls_of(run: Run, path: Path) -> list[tuple[tuple[Any, ...], dict[str, Any]]]:
    """Every block of columns that a recording sends to the SDK."""
    kept: list[tuple[tuple[Any, ...], dict[str, Any]]] = []
    send = rr.RecordingStream.send_columns

    def keeping(stream: rr.RecordingStream, *args: Any, **more: Any) -> Any:
        kept.append((args, more))
        return send(stream, *args, **more)

    rr.RecordingStream.send_columns = keeping  # type: ignore[method-assign]  # to look at what goes through
    try:
        write_recording(run, path)
    finally:
        rr.RecordingStream.send_columns = send  # type: ignore[method-assign]  # as it was
    return kept


def send_again(calls: list[tuple[tuple[Any, ...], dict[str, Any]]], path: Path) -> None:
    """The SDK alone: columns that are ready, to a file."""
    stream = rr.RecordingStream("mechviz", recording_id="limit")
    stream.save(path)
    for args, more in calls:
        stream.send_columns(*args, **more)
    stream.flush()
    stream.disconnect()


def throughput(name: str, frames: int, turns: int) -> None:
    """A row of the table."""
    scene = mechviz.load(name)
    run = run_scene(scene, frames=frames - 1)
    links = len(scene.mechanism.links)
    with tempfile.TemporaryDirectory() as folder:
        path, other = Path(folder) / "run.rrd", Path(folder) / "limit.rrd"
        calls = calls_of(run, path)
        times: tuple[list[float], list[float], list[float]] = ([], [], [])
        stages: dict[str, list[float]] = {}
        for _ in range(turns):
            start = time.perf_counter()
            summary = write_recording(run, path)
            times[0].append(time.perf_counter() - start)
            for s in summary.stages:
                stages.setdefault(s.name, []).append(s.seconds)
            start = time.perf_counter()
            send_again(calls, other)
            times[1].append(time.perf_counter() - start)
            with open(other, "rb") as file:
                os.fsync(file.fileno())
            times[2].append(time.perf_counter() - start)
        size = path.stat().st_size
    whole, limit, kept, writing = (statistics.median(t) for t in (*times, stages["writing"]))
    print(
        f"| {name} | {frames} | {links} | {frames / whole:,.0f} | {frames / writing:,.0f} | {frames / limit:,.0f} "
        f"| {writing / limit:.2f} | {writing / kept:.2f} | {size / frames:,.0f} |"
    )


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="three turns, not nine")
    turns = 3 if parser.parse_args().short else 9
    print(machine("numpy", "rerun-sdk"))
    names = (
        "scene",
        "frames",
        "links",
        "frames/s in all",
        "frames/s, writing",
        "frames/s, SDK alone",
        "over the SDK",
        "over the SDK and the disk",
        "bytes a frame",
    )
    print(f"\n| {' | '.join(names)} |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in ("ten-link", "ten-link-forces"):
        throughput(name, 10_000, turns)


if __name__ == "__main__":
    main()
