"""The suite of hard cases: situations in which mechanisms are hard to compute, each with an expectation that is independent of the
solver.

Each module of a subject has its ``CASES``; one module has the mechanisms that they share with the tests.
"""

from mechviz.hard_cases import cams, constraints, dynamics, friction, input, linkages
from mechviz.hard_cases.case import Case

MODULES = (linkages, constraints, cams, friction, dynamics, input)


def all_cases(only: str | None = None) -> tuple[Case, ...]:
    """The cases of all families, or of one, in order."""
    return tuple(c for m in MODULES for c in m.CASES if only in (None, c.family))
