"""`mechviz record` killed (-9) at random times, again and again into the same folder.

    OPENBLAS_NUM_THREADS=1 python tests/torture/kills.py --count 200

A fault is a file of another name that is left, a recording that was there before and is not as it was, a next run that does not
begin, a traceback, or other frames that are read of the unfinished recording than stand in it in whole blocks. Every tenth run is
not killed, and counts as tried, too.
"""

from __future__ import annotations

import random
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
from budget import Tally, options
from forked import command, faults, forked, load_all

from mechviz.outputs.inspection import format_inspection, inspect
from mechviz.outputs.rerun import writer
from mechviz.outputs.rerun.entities import RecordingError
from mechviz.outputs.rerun.reader import Recording, ticks
from mechviz.outputs.rerun.rerun_adapter import chunks_in, entity_of

SCENES = ("crank-rocker", "kinetostatic-four-bar", "valve-spring")
FRAMES, BLOCK = 160, 20


def frames_in_whole_blocks(path: Path, tables: set[str]) -> int:
    """Frames up to which all tables have rows, counted from the chunks of a file alone."""
    last: dict[str, list[int]] = {}
    for batch in chunks_in(path):
        name = entity_of(batch)
        if "time" in batch.schema.names and name.startswith(("/data/", "/health/")):
            last.setdefault(name, []).extend(ticks(batch["time"]).tolist())
    if not tables <= last.keys():  # cut within its first block
        return 0
    end = min(max(times) for times in last.values())
    return int(min(np.sum(np.asarray(times) <= end) for times in last.values()))


def tables_of(path: Path) -> set[str]:
    """Tables with rows at the frames of a whole recording."""
    names = {entity_of(batch) for batch in chunks_in(path) if "time" in batch.schema.names}
    return {name for name in names if name.startswith(("/data/", "/health/"))}


def check(target: Path, part: Path, tables: set[str]) -> None:
    """Read a recording and the unfinished one beside it, if there is one; says what is wrong."""
    if not Recording(target).parsed_properties.complete:
        print("WRONG: the recording is not complete")
    format_inspection(inspect(target))
    if part.exists():
        _check_part(part, tables)


def _check_part(path: Path, tables: set[str]) -> None:
    whole = frames_in_whole_blocks(path, tables)
    try:
        inspection = inspect(path)
        format_inspection(inspection)
    except RecordingError as error:
        if whole or not error.remedy:
            print(f"WRONG: {whole} frames stand there, and it says: {error}")
        return
    if inspection.frames != whole:
        print(f"WRONG: {inspection.frames} of {whole} frames are read")


def main() -> int:
    """Kills recordings; gives 1 where there were faults."""
    given = options(__doc__, 200).parse_args()
    writer.BLOCK_FRAMES = BLOCK
    load_all()
    tally, left, killed = Tally(given.count, given.seconds), 0, 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        target, part, said = folder / "a.rrd", folder / "a.part.rrd", folder / "said"
        tables = {}
        for scene in SCENES:
            forked(command("record", scene, "--frames", str(FRAMES), "-o", str(target)), said)
            tables[scene] = set(forked(lambda: print(*tables_of(target), sep="\n"), said).text.splitlines())
        owner, known = "", None  # of the unfinished recording: it stays where a kill comes before the next one begins
        for seed in tally.cases(given.first):
            rng = random.Random(seed)
            scene = rng.choice(SCENES)
            words = command("record", scene, "--frames", str(FRAMES), "-o", str(target))
            if seed == given.first or rng.random() < 0.1:
                start = time.monotonic()
                told = faults(forked(words, said), (0,))
                takes = time.monotonic() - start
            else:
                before = target.read_bytes()
                forked(words, said, kill_after=rng.uniform(0.0, 1.1 * takes))
                killed += 1
                result = {path.name for path in folder.iterdir()} - {"a.rrd", "a.part.rrd", "said"}
                told = f"{sorted(result)} are left" if result else ""
                if part.exists():
                    left += 1
                    if (file := (part.stat().st_ino, part.stat().st_mtime_ns)) != known:
                        owner, known = scene, file
                    told = told or ("" if target.read_bytes() == before else "the recording that was there has changed")
                checked = forked(partial(check, target, part, tables.get(owner, set())), said)
                told = told or (checked.text if "WRONG" in checked.text else faults(checked, (0,)))
            if told:
                tally.fault(f"seed {seed}, {scene}: {told}")
    return tally.end(f"{killed} were killed, {left} of them left an unfinished recording")


if __name__ == "__main__":
    sys.exit(main())
