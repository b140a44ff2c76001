"""The suite of hard cases: places where mechanisms are hard, each with what is expected there, independently of what computes it.

Modules with their ``CASES``, and two with the mechanisms that they share with the tests; nothing heavy is loaded before `all_cases`
is called.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mechviz.hard_cases.case import Case


def all_cases(only: str | None = None) -> tuple[Case, ...]:
    """The cases of all families, or of one, in order."""
    from mechviz.hard_cases import cams, constraints, dynamics, friction, friction_motion, input, linkages, published

    modules = (linkages, constraints, published, cams, friction, friction_motion, dynamics, input)
    return tuple(c for m in modules for c in m.CASES if only in (None, c.family))
