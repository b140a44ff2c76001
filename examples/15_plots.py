"""Plots of any quantity by matplotlib; a figure comes back, to be changed at will."""

import sys
import tempfile
from pathlib import Path

import mechviz as mv

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())

run = mv.run("slider-crank-compressor", frames=360)
figure = run.plot("drive.A.torque", "joint.B.reaction", path=folder / "forces.svg")

figure.axes[0].axhline(0.0, color="black", linewidth=0.8)
figure.savefig(folder / "forces.png", dpi=150)
print(*sorted(path.name for path in folder.glob("forces.*")))
