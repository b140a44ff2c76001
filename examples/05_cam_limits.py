"""The limits of a cam: pressure angles, curvature, the largest roller; and the least base circle that keeps to them."""

import numpy as np

from mechcore.cams import Follower, Requirement, Roller, Translating, cam_on_base, check_limits, find_limits, least_base
from mechcore.laws import Segment, program

turn = np.radians
lift = program([Segment(turn(120), 0.020), Segment(turn(60)), Segment(turn(120), 0.0, "3-4-5"), Segment(turn(60))])
follower = Follower(Translating(offset=0.008), Roller(0.010))
wanted = Requirement(pressure_rise=turn(30), pressure_fall=turn(40), radius=0.015)

least = least_base(lift, follower, wanted)
print(f"Least base circle {1e3 * least.base:.2f} mm; decided by: {least.decides}")

cam = cam_on_base(lift, follower, least.base)
for verdict in check_limits(cam, wanted):
    print(f"{'pass' if verdict.passed else 'FAIL'}  {verdict.condition}, nearest at {np.degrees(verdict.angle):.1f}°")

roller = find_limits(cam).greatest_roller
assert roller is not None
print(f"A roller of up to {1e3 * roller.value:.2f} mm does not undercut it.")
