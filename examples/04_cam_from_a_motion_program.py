"""A cam from a motion program: rise, dwell, return, dwell; the profile that makes this lift, point by point."""

import sys
import tempfile
from pathlib import Path

import numpy as np

from mechcore.cams import Follower, Roller, Translating, cam_on_base
from mechcore.laws import Segment, jumps, program

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
turn = np.radians

lift = program([Segment(turn(120), 0.020, "cycloidal"), Segment(turn(60)), Segment(turn(120), 0.0, "3-4-5"), Segment(turn(60))])
assert not jumps(lift, (1, 2))  # neither the velocity nor the acceleration jumps

cam = cam_on_base(lift, Follower(Translating(offset=0.008), Roller(0.010)), base=0.040)
profile = cam.at(np.radians(np.arange(360.0)))
points = 1e3 * np.column_stack([profile.working.real, profile.working.imag])  # in the cam's axes, mm

np.savetxt(folder / "profile.csv", points, delimiter=",", header="x [mm],y [mm]", comments="", fmt="%.6f")
print(f"{len(points)} points of the profile, radii {np.hypot(*points.T).min():.2f} to {np.hypot(*points.T).max():.2f} mm")
