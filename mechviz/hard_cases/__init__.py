"""The suite of hard cases: places where mechanisms are hard, each with what is expected there, independently of what computes it.

Modules with their ``CASES``, and one with the mechanisms that they share with the tests.
"""

from mechviz.hard_cases import cams, constraints, dynamics, friction, input, linkages
from mechviz.hard_cases.case import Case

MODULES = (linkages, constraints, cams, friction, dynamics, input)


def all_cases(only: str | None = None) -> tuple[Case, ...]:
    """The cases of all families, or of one, in order."""
    return tuple(c for m in MODULES for c in m.CASES if only in (None, c.family))
