"""Three axes in step: positions at common knots, velocities and accelerations of least jerk; a law of least contact force."""

import numpy as np

from mechcore.laws import Segment, jumps, least_peak, peak, program

FREE = None  # follows from continuity
knots = np.array([0.0, 0.5, 1.2, 2.0])  # s
axes = {"x": (0.0, 0.10, 0.05, 0.20), "y": (0.0, -0.10, 0.10, 0.0), "pen": (0.0, 0.005, 0.005, 0.0)}  # m

for name, (start, *inner, end) in axes.items():
    ends = [*([value, FREE, FREE] for value in inner), end]  # at rest at both ends
    rows = [Segment(over, to, "polynomial") for over, to in zip(np.diff(knots), ends, strict=True)]
    motion = program(rows, start, repeats=False)
    assert not jumps(motion, (1, 2, 3, 4), ends=False)  # the quintics join up to the fourth derivative
    print(f"{name:<4} largest acceleration {abs(peak(motion, 2).value):.4f} m/s2, jerk {abs(peak(motion, 3).value):.3f} m/s3")

# a rise of 10 mm over 60 deg at 80 rad/s: 0.3 kg on a spring of 4 N/mm, preload 60 N, at least 20 N left between cam and follower
best = least_peak(
    "force", end=(0.010, 0.0, 0.0), over=np.radians(60), mass=0.3 * 80.0**2, stiffness=4000.0, load=60.0, least_force=20.0
)
print(f"least contact force of a rise: {best.peak:.1f} N at most, largest acceleration {best.acceleration * 80.0**2:.1f} m/s2")
