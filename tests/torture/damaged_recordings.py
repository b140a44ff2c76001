"""Damaged recordings, read in all ways: every one must be an error of ours or be read, quickly and without a warning.

    python tests/torture/damaged_recordings.py --count 5000 --scene kinetostatic-four-bar

prints what went wrong with the seed that makes it, once for every kind.
"""

from __future__ import annotations

import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path

from budget import Tally, options
from damage import damaged, read_all

import mechviz
from mechcore.errors import MechanismError
from mechviz.files import OutputError
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import run_scene

FRAMES = 12
SLOW = 5.0  # [s] of processor time for one way of reading a small recording


def fault_of(read: Callable[[], object]) -> tuple[str, bool]:
    """What is wrong with one way of reading, and whether it was refused."""
    start, fault, refused = time.process_time(), "", False
    try:
        read()
    except (OutputError, MechanismError) as error:
        refused = True
        if not (getattr(error, "remedy", "") or all(f.remedy for f in getattr(error, "faults", ()))):
            fault = f"no remedy: {error}"
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        fault = f"{type(error).__name__} in {Path(place.filename).name}:{place.lineno}: {error}"
    if time.process_time() - start > SLOW:
        fault = f"took {time.process_time() - start:.0f} s"
    return fault, refused


def main() -> int:
    """Reads damaged recordings; gives 1 where there were faults."""
    parser = options(__doc__, 5000)
    parser.add_argument("--scene", default="kinetostatic-four-bar", help="of the gallery, whose recording is damaged")
    given = parser.parse_args()
    warnings.simplefilter("error", RuntimeWarning)
    refused, tally = 0, Tally(given.count, given.seconds)
    with tempfile.TemporaryDirectory() as folder:
        whole, target = Path(folder) / "whole.rrd", Path(folder) / "damaged.rrd"
        write_recording(run_scene(mechviz.load(given.scene), frames=FRAMES), whole)
        for seed in tally.cases(given.first):
            words = damaged(whole, target, seed)
            for read in read_all(target):
                fault, no = fault_of(read)
                refused += no
                if fault:
                    tally.fault(f"seed {seed}: {words[:100]}: {fault[:200]}", fault[:60])
    return tally.end(f"{refused} of {5 * tally.tried} readings were refused")


if __name__ == "__main__":
    sys.exit(main())
