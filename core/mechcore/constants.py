"""Numbers that several modules share, each with its reason. A threshold of one module stands at the top of that module."""

from math import pi

TURN = 2.0 * pi
"""A whole turn [rad]."""

MOST_TURNS = 50_000
"""Turns of a drive in one run (circumferences of a circle as large as the mechanism, where it slides), or periods of a motion.

Every change point and angle on the way is looked at, so that a run takes time in proportion; nobody would wait for more.
"""

REST = 1e-9
"""Speeds below this part of the largest of their run, and travels below this part of the scale, are rest.

Rates of what stands still come out as rounding (1e-16) times the condition of the equations, which stays below 1e7 away from
singular positions.
"""

SINGULAR = 1e8
"""Condition number of a block from which half of the digits of a result are gone."""

ZERO_SUM = 1e-12
"""Sums of forces or moments below this part of their terms are zero: only rounding of some thousand operations is left of them."""
