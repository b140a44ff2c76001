"""What all searches share: their options, how far they are, and how they end.

A search ends after so many cases or seconds. It says every half minute how far it is, and last ``N tried, M faults``; its exit code
is 1 where there were any.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator

OFTEN = 30.0  # [s] between two lines on progress


def options(words: str | None, count: int, *, seconds: float = 3600.0, first: bool = True) -> argparse.ArgumentParser:
    """A parser of the options that searches share; ``first``: whether its cases are made from seeds."""
    parser = argparse.ArgumentParser(description=words, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=count, help=f"cases ({count:,})")
    parser.add_argument("--seconds", type=float, default=seconds, help=f"after which it ends ({seconds:g})")
    if first:
        parser.add_argument("--first", type=int, default=0, help="seed of the first case (0)")
    return parser


class Tally:
    """Counts cases and faults, and prints every kind of fault once."""

    def __init__(self, count: int, seconds: float):
        self.count, self.seconds = count, seconds
        self.tried = self.faults = 0
        self._kinds: set[str] = set()
        self._begun = self._said = time.monotonic()

    def cases(self, first: int = 0) -> Iterator[int]:
        """Numbers of cases from ``first`` on, until there were enough or time is over."""
        for seed in range(first, first + self.count):
            if self.over():
                return
            yield seed
            self.tried += 1
            self.tell()

    def over(self) -> bool:
        """Whether time is over."""
        return time.monotonic() - self._begun > self.seconds

    def fault(self, words: str, kind: str | None = None) -> None:
        """Count a fault; it is printed where it is the first of its kind."""
        self.faults += 1
        if kind is None or kind not in self._kinds:
            print(f"FAULT {words}", flush=True)
        if kind is not None:
            self._kinds.add(kind)

    def tell(self, more: str = "") -> None:
        """Say how far it is, where half a minute has passed since it was said."""
        now = time.monotonic()
        if now - self._said > OFTEN:
            self._said = now
            print(f"{now - self._begun:.0f} s: {self.tried:,} of {self.count:,} tried, {self.faults} faults{more}", flush=True)

    def end(self, more: str = "") -> int:
        """Print what there was to say and the last line; gives the exit code."""
        if more:
            print(more)
        print(f"{time.monotonic() - self._begun:.0f} s")
        print(f"{self.tried} tried, {self.faults} faults", flush=True)
        return min(self.faults, 1)
