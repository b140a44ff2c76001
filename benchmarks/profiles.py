"""Where the time of the three slowest paths goes, and what it was at another commit.

    python benchmarks/profiles.py [--against COMMIT] [--sampled]

Scene to solids, run to recording, and the errors of motions under forces, over a sample of the gallery: processor time, the least
of three runs, and by a profile how much of it is ours, how much that of the libraries underneath. ``--against`` measures the same
with the sources of another commit afterwards.

A profile of calls counts what is written with operators (`a * b`, `a[i]` of arrays) to the function that they stand in.
``--sampled`` looks with py-spy (to be installed beside) into the compiled code too: there such arithmetic is numpy's, and ours is
what the interpreter does in our files.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import os
import pstats
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MOVED = (
    "crank-rocker", "ten-link-forces", "gear-train", "cam-roller", "triad", "slider-crank-engine", "parallel-forces",
    "sewing-machine",
)  # fmt: skip
PATHS = ("solids of a scene", "run to recording", "errors of motions under forces")
FREE = ("swinging-double-pendulum", "andrews-squeezer", "toggle-press-stop", "falling-four-bars")
LIBRARIES = ("numpy", "scipy", "rerun", "shapely", "trimesh", "pyarrow")
COMPILED = {
    "numpy": "numpy", "scipy": "scipy", "geos": "shapely", "shapely": "shapely", "earcut": "earcut", "rerun_bindings": "rerun",
    "arrow": "pyarrow",
}  # fmt: skip
"""Words in the file names of compiled code, and whose it is."""

REPEATS = 3


def works(folder: str) -> dict[str, Callable[[], object]]:
    """The three paths, what they start from ready."""
    from mechviz.accuracy.estimate import integration_error
    from mechviz.outputs.rerun.writer import write_recording
    from mechviz.picture.build import solids_of
    from mechviz.runs import run_scene
    from mechviz.scene.scene import load

    runs = [run_scene(load(name)) for name in MOVED]
    solids = [solids_of(run) for run in runs]
    free = [run_scene(load(name)) for name in FREE]

    def errors() -> list[object]:
        from mechviz.accuracy import estimate

        estimate._companions.clear()
        return [integration_error(r.simulation, r.motion.time, r.resimulate) for r in free if r.simulation and r.resimulate]

    return {
        "solids of a scene": lambda: [solids_of(run) for run in runs],
        "run to recording": lambda: [
            write_recording(run, f"{folder}/a.rrd", solids=result) for run, result in zip(runs, solids, strict=True)
        ],
        "errors of motions under forces": errors,
    }


def shares(work: Callable[[], object]) -> dict[str, float]:
    """Parts of the time of a work by package: ``ours`` is the Python of mechviz and mechcore, without what it calls."""
    profile = cProfile.Profile(time.process_time)
    profile.runcall(work)
    result: dict[str, float] = defaultdict(float)
    rows = pstats.Stats(profile).stats  # type: ignore[attr-defined]  # not in its stubs
    for (file, _, name), (_, _, own, _, callers) in rows.items():
        if file == "~":  # built in: to whom it belongs is who calls it, but for the methods of arrays
            for (caller, _, _), (_, _, part, _) in callers.items():
                result["numpy" if "numpy" in name else _owner(caller)] += part
        else:
            result[_owner(file)] += own
    total = sum(result.values())
    return {owner: part / total for owner, part in result.items()}


def _owner(file: str) -> str:
    parts = Path(file).parts
    return next((name for name in LIBRARIES if name in parts), "ours" if {"mechviz", "mechcore"} & set(parts) else "Python")


def measure() -> dict[str, tuple[float, dict[str, float]]]:
    """Least processor time [s] and shares of each path."""
    with tempfile.TemporaryDirectory() as folder:
        result = {}
        for name, work in works(folder).items():
            work()
            times = []
            for _ in range(REPEATS):
                start = time.process_time()
                work()
                times.append(time.process_time() - start)
            result[name] = (min(times), shares(work))
        return result


def repeat(name: str, seconds: float) -> None:
    """One path over and over, for a sampler; only what lies below this function counts."""
    with tempfile.TemporaryDirectory() as folder:
        work = works(folder)[name]
        work()
        _watched(work, seconds)


def _watched(work: Callable[[], object], seconds: float) -> None:
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        work()


def sampled(name: str, seconds: float = 8.0, rate: int = 100) -> tuple[int, dict[str, float]]:
    """Number of samples of a path, and their shares by who is at work: compiled libraries, or Python files by their owner."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "samples"
        path = os.pathsep.join([str(ROOT / "core"), str(ROOT)])
        env = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        spy = ["py-spy", "record", "--native", "--full-filenames", "-r", str(rate), "-f", "raw", "-o", str(out), "--"]
        command = [*spy, sys.executable, __file__, "--repeat", name, "--seconds", str(seconds)]
        subprocess.run(command, env=env, check=True, capture_output=True, timeout=30.0 * seconds)
        result: dict[str, float] = defaultdict(float)
        for line in out.read_text().splitlines():
            stack, count = line.rsplit(" ", 1)
            frames = stack.split(";")
            begin = next((k for k, frame in enumerate(frames) if frame.startswith("_watched ")), None)
            if begin is not None:
                result[_at_work(frames[begin:])] += int(count)
    total = sum(result.values())
    return int(total), {owner: part / total for owner, part in result.items()}


def _at_work(frames: list[str]) -> str:
    """Whose compiled code a stack ends in, below its last Python function; else whose function that is."""
    last = max(k for k, frame in enumerate(frames) if ".py:" in frame)
    for frame in reversed(frames[last + 1 :]):  # the deepest: functions of shapely are called by way of numpy
        for word, owner in COMPILED.items():
            if word in frame:
                return owner
    return _owner(frames[last].split("(")[-1].split(":")[0])


def measured_with(sources: Path) -> dict[str, tuple[float, dict[str, float]]]:
    """The same in a process of its own, with the sources in a folder."""
    path = os.pathsep.join([str(sources / "core"), str(sources)])
    env = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, __file__, "--json"], env=env, cwd=sources, capture_output=True, text=True, check=True)
    return {name: (seconds, parts) for name, (seconds, parts) in json.loads(done.stdout).items()}


def _print_sampled(word: str) -> None:
    owners = ["ours", "Python", *LIBRARIES, "earcut"]
    print(f"| path | samples | {' | '.join(owners)} |")
    print("|" + "---|" * (len(owners) + 2))
    for name in PATHS:
        if word in name:
            count, parts = sampled(name)
            print(f"| {name} | {count} | {' | '.join(f'{100.0 * parts.get(owner, 0.0):.0f} %' for owner in owners)} |", flush=True)


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", metavar="COMMIT", help="compare with the sources of this commit")
    parser.add_argument("--json", action="store_true", help="only what was measured, for programs")
    parser.add_argument("--sampled", action="store_true", help="shares by samples of compiled code too, by py-spy; no times")
    parser.add_argument("--only", metavar="WORD", default="", help="with --sampled: paths whose names contain this")
    parser.add_argument("--repeat", metavar="PATH", help=argparse.SUPPRESS)
    parser.add_argument("--seconds", type=float, default=8.0, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.repeat:
        return repeat(given.repeat, given.seconds)
    if given.sampled:
        return _print_sampled(given.only)
    if given.json:
        print(json.dumps(measure()))
        return
    now, before = measured_with(ROOT), None
    if given.against:
        with tempfile.TemporaryDirectory() as folder:
            tree = Path(folder) / "tree"
            subprocess.run(
                ["git", "-C", str(ROOT), "worktree", "add", "--detach", str(tree), given.against], check=True, capture_output=True
            )
            try:
                before = measured_with(tree)
            finally:
                subprocess.run(["git", "-C", str(ROOT), "worktree", "remove", "--force", str(tree)], check=True)
    owners = ["ours", "Python", *LIBRARIES]
    print(f"| path | {'before | now | ' if before else ''}ratio | {' | '.join(owners)} |")
    print("|" + "---|" * (len(owners) + (4 if before else 2)))
    for name, (seconds, parts) in now.items():
        cells = [f"{100.0 * parts.get(owner, 0.0):.0f} %" for owner in owners]
        timed = [f"{1e3 * before[name][0]:.0f} ms", f"{1e3 * seconds:.0f} ms", f"{before[name][0] / seconds:.2f}"] if before else [
            f"{1e3 * seconds:.0f} ms"
        ]  # fmt: skip
        print(f"| {' | '.join([name, *timed, *cells])} |")


if __name__ == "__main__":
    main()
