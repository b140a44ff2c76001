"""Full balance of a four-bar's shaking force by counterweights on its crank and rocker."""

import sys
import tempfile
from pathlib import Path

import mechviz as mv
from mechviz.studies.balance import balance_scene

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())

balanced = balance_scene(mv.load("shaking-four-bar"), radius=0.08, rocker_radius=0.12)
print("\n".join(balanced.lines()))
assert balanced.after.peak < 1e-9 * balanced.before.peak

mv.dump(balanced.scene, folder / "balanced.toml")  # the scene with its counterweights, to be run like any other
print(mv.run(folder / "balanced.toml", frames=36))
