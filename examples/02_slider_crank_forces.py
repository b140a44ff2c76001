"""The forces that a motion needs: torque of the drive and joint reactions of a compressor with gas, weight and inertia."""

import numpy as np

import mechviz as mv

run = mv.run("slider-crank-compressor", frames=360)

torque = run["drive.A.torque"][:, 0]
worst = int(np.argmax(abs(torque)))
print(f"Largest driving torque {torque[worst]:.1f} N m at t = {run.time[worst]:.4f} s.")

for key in run:
    if key.endswith(".reaction"):
        quantity = run.quantity(key)
        print(f"{quantity.label}: at most {np.nanmax(abs(quantity.values())):.0f} {quantity.unit}")

# the same in SI units from the core, and the check of every frame: power in = power out + change of energy
assert run.forces is not None
print(f"The power balance closes to {abs(run.forces.power_balance).max():.1e} of the power.")
