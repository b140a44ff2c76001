"""The steady run of a machine, found directly: the speed over a turn that comes back to itself."""

import numpy as np

import mechviz as mv
from mechcore.dynamics.rest.steady import steady_run

crusher = mv.load("crusher-steady")
found = steady_run(crusher.mechanism)
rpm = 30.0 / np.pi
print(f"Mean speed {found.mean * rpm:.2f} rpm, from {found.least * rpm:.2f} to {found.greatest * rpm:.2f} rpm")
print(f"Coefficient of fluctuation {found.fluctuation:.4f}; a disturbance shrinks to {found.multiplier:.3f} of itself in a turn.")

speed = found(np.linspace(0.0, 2.0 * np.pi, 13))  # over the angle from its start [rad/s]
assert np.isclose(speed[0], speed[-1], rtol=1e-9)
