"""The steady run of a machine, found directly: the speed over a turn that comes back to itself."""

import numpy as np

import mechviz as mv
from mechcore.dynamics.rest.steady import steady_run

crusher = mv.load("crusher-steady")
steady = steady_run(crusher.mechanism)
rpm = 30.0 / np.pi
print(f"Mean speed {steady.mean * rpm:.2f} rpm, from {steady.least * rpm:.2f} to {steady.greatest * rpm:.2f} rpm")
print(f"Coefficient of fluctuation {steady.fluctuation:.4f}; a disturbance shrinks to {steady.multiplier:.3f} of itself in a turn.")

speed = steady(np.linspace(0.0, 2.0 * np.pi, 13))  # over the angle from its start [rad/s]
assert np.isclose(speed[0], speed[-1], rtol=1e-9)
