"""The flywheel for a coefficient of fluctuation of 0.02, from the torque over the cycle."""

import numpy as np

import mechviz as mv
from mechcore.forces.powers import flywheel

run = mv.run("slider-crank-compressor", frames=720)
forces = run.forces
assert forces is not None

wheel = flywheel(forces, fluctuation=0.02)
print(f"Mean torque {wheel.mean:.2f} N m, excess work {wheel.excess:.1f} J")
fastest, slowest = np.degrees([wheel.fastest, wheel.slowest])
print(f"Flywheel {wheel.inertia:.4f} kg m²; the crank is fastest at {fastest:.1f}°, slowest at {slowest:.1f}°")
