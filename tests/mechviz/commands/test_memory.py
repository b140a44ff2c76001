"""Runs over many frames use memory that the process has already."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

WORK = """
import resource, sys
import numpy as np
from mechanisms import four_bar
from mechcore import compile_mechanism, solve_motion

compiled = compile_mechanism(four_bar(E=(4.0, 0.0), AB=1.0, BD=3.5, DE=3.0))
time = np.linspace(0.0, 1.0, int(sys.argv[1]))

def run():
    motion = solve_motion(compiled, time)
    return [part for link in motion.model.links for part in (motion.pose(link), motion.velocity(link), motion.acceleration(link))]

run(), run()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(4):
    run()
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.thorough
@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc gives freed memory back at once")
@pytest.mark.parametrize("frames", [20_000, 200_000])
def test_runs_take_no_new_memory(frames):
    """An array over 20,000 frames has 80 pages (160 if complex); without `keep_freed_memory` four runs ask for thousands."""
    env = {k: v for k, v in os.environ.items() if not k.startswith("MALLOC_") and k != "GLIBC_TUNABLES"}
    env["PYTHONPATH"] = os.pathsep.join([str(Path(__file__).resolve().parents[3] / "tests" / "support"), env.get("PYTHONPATH", "")])
    out = subprocess.run([sys.executable, "-c", WORK, str(frames)], capture_output=True, text=True, env=env, check=True)
    assert int(out.stdout) < 200
