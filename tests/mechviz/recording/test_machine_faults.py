"""Samples of ``tests/torture``: recordings that are killed, disks that are full, many recordings in one process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

TORTURE = Path(__file__).resolve().parents[2] / "torture"


@pytest.mark.parametrize(("name", "count"), [("kills.py", 2), ("full_disk.py", 2), ("many_recordings.py", 4)])
def test_a_sample_of_what_a_machine_does_to_recordings(name, count):
    out = subprocess.run(
        [sys.executable, str(TORTURE / name), str(count)],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert out.returncode == 0, out.stdout + out.stderr
