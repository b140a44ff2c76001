"""Samples of ``tests/torture``: recordings that are killed, disks that are full, many recordings in one process, mutated scenes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from budget import Tally

TORTURE = Path(__file__).resolve().parents[2] / "torture"


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "count"), [("kills.py", 2), ("full_disk.py", 2), ("many_recordings.py", 4), ("mutated_scenes.py", 3)]
)
def test_a_sample_of_what_a_machine_does_to_recordings(name, count):
    out = subprocess.run(
        [sys.executable, str(TORTURE / name), "--count", str(count)],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert out.returncode == 0, out.stdout + out.stderr
    assert out.stdout.splitlines()[-1] == f"{count} tried, 0 faults"


def test_a_search_with_faults_says_every_kind_once_and_fails(capsys):
    tally = Tally(3, 3600.0)
    for seed in tally.cases(7):
        tally.fault(f"seed {seed}: it fell over", "it fell over")
    assert tally.end() == 1
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "FAULT seed 7: it fell over" and said[-1] == "3 tried, 3 faults" and len(said) == 3
