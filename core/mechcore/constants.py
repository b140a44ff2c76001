"""Numbers that several modules share, each with its reason. A threshold of a single module is at the top of that module."""

from math import pi

TURN = 2.0 * pi
"""A whole turn [rad]."""

MOST_TURNS = 50_000
"""Most turns of a drive in one run (of a sliding drive, circumferences of a circle as large as the mechanism), or most periods.

Every change point and angle in between is examined, so that the time of a run is proportional to them; more would take too long.
"""

REST = 1e-9
"""Speeds below this part of the largest speed of their run, and travels below this part of the scale, count as rest.

Computed rates of a part at rest are rounding (1e-16) times the condition number of the equations, which stays below 1e7 away from
singular positions.
"""

SINGULAR = 1e8
"""Condition number of a block from which on half of the digits of a result are lost."""

ZERO_SUM = 1e-12
"""Sums of forces or moments below this part of their terms count as zero: it is the rounding of some thousand operations."""
