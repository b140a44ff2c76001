"""A recording: everything that was computed, in one file that rerun shows and that reads back bit for bit."""

import sys
import tempfile
from pathlib import Path

import numpy as np

import mechviz as mv

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())

run = mv.run("slider-crank-compressor", frames=90)
print(run.record(folder / "compressor.rrd"))  # look at it with: rerun compressor.rrd

again = mv.open(folder / "compressor.rrd")
assert again.keys() == run.keys()
assert all(np.array_equal(again[key], run[key], equal_nan=True) for key in run)
print(f"{again}. It carries its scene: {again.scene.title}.")
