"""Scenes of the gallery with one or two values that nobody means, solved and recorded: each gives a result or an error of ours.

    python tests/torture/mutated_scenes.py [COUNT] [SECONDS] [FIRST]

ends after so many scenes or seconds of processor time, prints what went wrong with the seed that makes it, and exits with 1 where
anything did: an exception that is not ours, a warning, half a minute of processor time without it being said that this will take
long, a result that is no number without a word, memory that grows. A scene is interrupted after half a minute.
"""

from __future__ import annotations

import random
import signal
import sys
import tempfile
import time
import tomllib
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from many_recordings import memory

from mechcore.errors import MechanismError
from mechviz.files import OutputError
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import run_scene
from mechviz.scene.folder import GALLERY_FOLDER, gallery
from mechviz.scene.scene import Scene

FRAMES = 8
SLOW = 30.0  # [s] of processor time
OFTEN = 500  # scenes, after which it is told how many there were
MOST_GROWN = 200e6  # [bytes] that the process may grow by after the first thousand scenes
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
        elif place not in ("title", "teaches"):
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


def main(count: int = 50_000, seconds: float = 36_000.0, first: int = 0) -> int:
    """Tries mutated scenes; gives the number of kinds of faults."""
    warnings.simplefilter("error", RuntimeWarning)
    known: set[str] = set()
    tried = refused = told = 0
    sizes: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "a.rrd"
        for seed in range(first, first + count):
            if time.process_time() > seconds:
                break
            name, document, words = mutated(seed)
            start, fault = time.process_time(), ""
            said: list[str] = []
            tried += 1
            try:
                with interrupted(SLOW):
                    run = run_scene(Scene.build(name=name, folder=GALLERY_FOLDER, **document), warn=said.append)
                    write_recording(run, target)
                    Recording(target)
            except (MechanismError, OutputError) as error:
                refused += 1
                lacking = [str(f) for f in getattr(error, "faults", ()) if not f.remedy or f.remedy.startswith("Or")]
                fault = f"no remedy: {lacking[0]}" if lacking else ""
            except EnoughError:
                told += bool(said)
                fault = "" if said else f"slow: {time.process_time() - start:.0f} s without a word"
            except Exception as error:
                place = traceback.extract_tb(error.__traceback__)
                own = [p for p in place if "mech" in p.filename and "torture" not in p.filename] or place
                fault = f"{type(error).__name__} in {Path(own[-1].filename).name}:{own[-1].lineno}: {error}"
            if time.process_time() - start > SLOW + 5.0:
                fault = f"slow: {time.process_time() - start:.0f} s, not to be interrupted"
            kind = fault.partition(":")[0] + fault.partition(":")[2].partition(":")[0]
            if fault and kind not in known:
                known.add(kind)
                print(f"seed {seed}, {name}: {words[:150]}: {fault[:220]}", flush=True)
            if tried % OFTEN == 0:
                sizes.append(memory())
                print(f"{tried} scenes, {refused} refused; {time.process_time():.0f} s, {sizes[-1] / 1e6:.0f} MB", flush=True)
    if len(sizes) > 2 and sizes[-1] - sizes[1] > MOST_GROWN:
        known.add("memory")
        print(f"memory has grown from {sizes[1] / 1e6:.0f} to {sizes[-1] / 1e6:.0f} MB")
    print(f"{tried} mutated scenes, {refused} refused, {told} interrupted after it was said that they take long, ", end="")
    print(f"{len(known)} kinds of faults; {time.process_time():.0f} s of processor time")
    return len(known)


if __name__ == "__main__":
    sys.exit(min(1, main(*(kind(text) for kind, text in zip((int, float, int), sys.argv[1:], strict=False)))))
