"""Natural frequencies: two carts on springs, whose two modes have nearly the same frequency."""

import numpy as np

import mechviz as mv
from mechviz.studies.vibrations import vibration_lines, vibrations_of

scene = mv.load("coupled-carts")
vibrations = vibrations_of(scene)
print("\n".join(vibration_lines(scene, vibrations)))

# by hand: in step only the outer springs act; against each other the coupling counts twice
k, coupling, mass = 500.0, 60.0, 2.0
by_hand = np.sqrt([k / mass, (k + 2.0 * coupling) / mass]) / (2.0 * np.pi)
assert np.allclose([mode.frequency for mode in vibrations.modes], by_hand)
