"""Scenes of the gallery with one or two values that nobody means, solved and recorded: each gives a result or an error of ours.

    python tests/torture/mutated_scenes.py --count 50000 --workers 2

prints what went wrong with the seed that makes it, once for every kind: an exception that is not ours, a warning, half a minute of
processor time without it being said that this will take long, a result that is no number without a word, memory that grows, a
process that ends. A scene is interrupted after half a minute.
"""

from __future__ import annotations

import gc
import os
import random
import signal
import sys
import tempfile
import time
import tomllib
import traceback
import warnings
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pyarrow
from budget import OFTEN, Tally, options
from many_recordings import memory

from mechcore.errors import MechanismError
from mechcore.numerics.frames import give_back_memory
from mechviz.files import OutputError
from mechviz.outputs.rerun.entities import RecordingError
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import run_scene
from mechviz.scene.folder import GALLERY_FOLDER, gallery
from mechviz.scene.scene import Scene

FRAMES = 8
SLOW = 30.0  # [s] of processor time
BLOCK = 20  # scenes that a process is given at once
WARM = 1000  # scenes of a process, after which its memory is looked at
MOST_GROWN = 200e6  # [bytes] that a process may grow by after that
ODD: tuple[Any, ...] = (0, -1, 1e-12, 1e-6, 1e6, 1e12, 1e29, float("nan"), float("inf"), "", "x", [], {}, True, "1e400 mm", "-3 kg")


def mutated(seed: int) -> tuple[str, dict[str, Any], str]:
    """The name of a scene, its document with odd values, and what they are."""
    rng = random.Random(seed)
    entry = rng.choice(gallery())
    document = tomllib.loads(entry.path.read_text(encoding="utf-8"))
    words = []
    for _ in range(rng.choice((1, 1, 2))):
        holder, key, path = rng.choice([*_leaves(document, "")])
        value = holder[key]
        number = isinstance(value, int | float) and not isinstance(value, bool)
        factor = rng.choice((-1.0, 0.5, 2.0, 1e3, 1e-3, 1.0 + 1e-9))
        holder[key] = value * factor if number and rng.random() < 0.6 else rng.choice(ODD)
        words.append(f"{path} = {holder[key]!r}")
    document.setdefault("run", {})
    if isinstance(document["run"], dict):
        document["run"]["frames"] = FRAMES
    return entry.name, document, ", ".join(words)


def _leaves(value: Any, path: str) -> Iterator[tuple[Any, Any, str]]:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        place = f"{path}[{key}]" if isinstance(value, list) else f"{path}.{key}".lstrip(".")
        if isinstance(inner, dict | list) and inner:
            yield from _leaves(inner, place)
        elif place not in ("title", "learning_goal"):
            yield value, key, place


class EnoughError(BaseException):
    """A scene has taken half a minute: what stops it comes at any place, as Ctrl-C does."""


@contextmanager
def interrupted(seconds: float) -> Iterator[None]:
    """Interrupt what takes longer [s of processor time]."""

    def stop(*_: object) -> None:
        raise EnoughError

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


@dataclass
class Tried:
    """Outcome of a block of scenes: faults with their kinds, refused and interrupted scenes, the process and its memory [bytes]."""

    count: int
    faults: list[tuple[str, str]]
    refused: int
    told: int
    process: int
    memory: float


def attempt(seeds: range) -> Tried:
    """Solve and record mutated scenes."""
    warnings.simplefilter("error", RuntimeWarning)
    out = Tried(len(seeds), [], 0, 0, os.getpid(), 0.0)
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            _attempt_one(seed, Path(folder) / "a.rrd", out)
    gc.collect()
    pyarrow.default_memory_pool().release_unused()  # arrow's own pool keeps what a large recording took
    give_back_memory()  # what is freed, or waits to be collected, is not held: 300 MB after a large scene
    out.memory = memory()
    return out


def _attempt_one(seed: int, target: Path, out: Tried) -> None:
    name, document, words = mutated(seed)
    start, fault = time.process_time(), ""
    said: list[str] = []
    try:
        with interrupted(SLOW):
            run = run_scene(Scene.build(name=name, folder=GALLERY_FOLDER, **document), warn=said.append)
            write_recording(run, target)
            Recording(target)
    except (MechanismError, OutputError) as error:
        out.refused += 1
        lacking = [str(f) for f in getattr(error, "faults", ()) if not f.remedy or f.remedy.startswith("Or")]
        fault = f"no remedy: {lacking[0]}" if lacking else ""
        if isinstance(error, RecordingError) and "is damaged" in str(error):
            fault = f"its own recording: {error}"
    except EnoughError:
        out.told += bool(said)
        fault = "" if said else f"slow: {time.process_time() - start:.0f} s without a word"
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)
        own = [p for p in place if "mech" in p.filename and "torture" not in p.filename] or place
        fault = f"{type(error).__name__} in {Path(own[-1].filename).name}:{own[-1].lineno}: {error}"
    if time.process_time() - start > SLOW + 5.0:
        fault = f"slow: {time.process_time() - start:.0f} s, not to be interrupted"
    if fault:
        kind = fault.partition(":")[0] + fault.partition(":")[2].partition(":")[0]
        out.faults.append((f"seed {seed}, {name}: {words[:150]}: {fault[:220]}", kind))


def main() -> int:
    """Tries mutated scenes; gives 1 where there were faults."""
    parser = options(__doc__, 50_000, seconds=36_000.0)
    parser.add_argument("--workers", type=int, default=1, help="processes (1)")
    given = parser.parse_args()
    tally, refused, told = Tally(given.count, given.seconds), 0, 0
    last = given.first + given.count
    blocks = iter([range(k, min(k + BLOCK, last)) for k in range(given.first, last, BLOCK)])
    done: dict[int, int] = {}  # scenes of each process
    warm: dict[int, float] = {}  # its memory after the first ones [bytes]
    waiting: dict[Future[Tried], range] = {}
    with ProcessPoolExecutor(given.workers, mp_context=get_context("spawn")) as pool:
        while True:
            while len(waiting) < given.workers and not tally.over() and (block := next(blocks, None)) is not None:
                waiting[pool.submit(attempt, block)] = block
            if not waiting:
                break
            for future in wait(waiting, timeout=OFTEN, return_when=FIRST_COMPLETED).done:
                block = waiting.pop(future)
                try:
                    tried = future.result()
                except BrokenProcessPool:
                    tally.fault(f"seeds {block.start} to {block.stop - 1}: a process has ended without a word")
                    return tally.end()
                tally.tried += tried.count
                refused, told = refused + tried.refused, told + tried.told
                for words, kind in tried.faults:
                    tally.fault(words, kind)
                process = tried.process
                done[process] = done.get(process, 0) + tried.count
                if done[process] <= WARM:
                    warm[process] = tried.memory
                elif tried.memory - warm[process] > MOST_GROWN:
                    sizes = f"from {warm[process] / 1e6:.0f} to {tried.memory / 1e6:.0f} MB"
                    tally.fault(f"seeds to {block.stop - 1}: memory has grown {sizes}", f"memory of {process}")
            tally.tell(f", {refused} refused")
    return tally.end(f"{refused} were refused, {told} interrupted after it was said that they take long")


if __name__ == "__main__":
    sys.exit(main())
