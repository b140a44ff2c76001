"""What is shared: a recording as it is, or a scene, which is solved and recorded on the way."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import Run


def is_recording(source: str) -> bool:
    """Whether the user means a recording: by its ending, or because the file is one."""
    path = Path(source)
    if path.suffix.lower() == ".rrd":
        return True
    try:
        with open(path, "rb") as file:
            return file.read(3) == b"RRF"
    except OSError:
        return False


def recorded(
    run: Run,
    progress: Callable[[int, int], None] | None = None,
    begin: Callable[[str], None] = lambda _: None,
    *,
    most: int | None = None,
) -> Recording:
    """A run as a recording in memory, of a long one ``most`` frames if that is given: what pages and pictures are made from, so
    that a scene and its recording look the same."""
    with tempfile.TemporaryDirectory(prefix="mechviz-") as folder:
        path = Path(folder) / "run.rrd"
        try:
            write_recording(run, path, progress=progress, begin=begin)
        except (KeyboardInterrupt, SystemExit) as stop:
            stop.__notes__ = []  # what is left of it goes with the folder
            raise
        return Recording(path, most=most)
