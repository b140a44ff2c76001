"""The suite of hard cases: places where mechanisms are hard, each with what is expected there, independently of what computes it.

One module a family with its ``CASES``; nothing heavy is loaded before `all_cases` is called.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .families import FAMILIES

if TYPE_CHECKING:
    from .case import Case

__all__ = ["FAMILIES", "all_cases"]


def all_cases(only: str | None = None) -> tuple[Case, ...]:
    """The cases of all families, or of one, in order."""
    from . import cams, dynamics, friction, input, linkages

    every = (*linkages.CASES, *cams.CASES, *friction.CASES, *dynamics.CASES, *input.CASES)
    return tuple(c for c in every if only in (None, c.family))
