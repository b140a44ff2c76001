"""Damaged recordings, read in all ways: every one must be an error of ours or be read, quickly and without a warning.

    python tests/torture/damaged_recordings.py [COUNT] [SECONDS] [SCENE] [FIRST]

ends after so many recordings or seconds of processor time, prints what went wrong with the seed that makes it, and exits with 1
where anything did.
"""

from __future__ import annotations

import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path

from damage import damaged, read_all

import mechviz
from mechcore.errors import MechanismError
from mechviz.files import OutputError
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import run_scene

FRAMES = 12
SLOW = 5.0  # [s] of processor time for one way of reading a small recording


def main(count: int = 5000, seconds: float = 3600.0, scene: str = "kinetostatic-four-bar", first: int = 0) -> int:
    """Reads damaged recordings; gives the number of kinds of faults."""
    warnings.simplefilter("error", RuntimeWarning)
    known: set[str] = set()
    refused = tried = 0
    with tempfile.TemporaryDirectory() as folder:
        whole, target = Path(folder) / "whole.rrd", Path(folder) / "damaged.rrd"
        write_recording(run_scene(mechviz.load(scene), frames=FRAMES), whole)
        for seed in range(first, first + count):
            if time.process_time() > seconds:
                break
            words = damaged(whole, target, seed)
            tried += 1
            for read in read_all(target):
                start, fault = time.process_time(), ""
                try:
                    read()
                except (OutputError, MechanismError) as error:
                    refused += 1
                    if not (getattr(error, "remedy", "") or all(f.remedy for f in getattr(error, "faults", ()))):
                        fault = f"no remedy: {error}"
                except Exception as error:
                    place = traceback.extract_tb(error.__traceback__)[-1]
                    fault = f"{type(error).__name__} in {Path(place.filename).name}:{place.lineno}: {error}"
                if time.process_time() - start > SLOW:
                    fault = f"took {time.process_time() - start:.0f} s"
                kind = fault.partition(":")[0] + fault[:60]
                if fault and kind not in known:
                    known.add(kind)
                    print(f"seed {seed}: {words[:100]}: {fault[:200]}", flush=True)
    print(f"{tried} damaged recordings of {scene}, {refused} of {5 * tried} readings refused, {len(known)} kinds of faults")
    return len(known)


if __name__ == "__main__":
    given = sys.argv[1:]
    sys.exit(min(1, main(*(kind(text) for kind, text in zip((int, float, str, int), given, strict=False)))))
