"""A hard case: its difficulty, what is expected of it, and the comparison of the computed result with that."""

from __future__ import annotations

import io
import re
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import field, replace
from typing import Any, Literal

import numpy as np

from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import Forces
from mechcore.motion.motion import Motion
from mechcore.records import dataclass

CaseFamily = Literal["linkages", "cams", "friction", "dynamics", "input"]
CASE_FAMILIES: tuple[CaseFamily, ...] = ("linkages", "cams", "friction", "dynamics", "input")


@dataclass(frozen=True)
class Check:
    """One comparison: ``error`` is the deviation of the result from the expected one, ``bound`` the largest that is allowed."""

    name: str
    error: float
    bound: float

    @property
    def passed(self) -> bool:
        return bool(self.error <= self.bound)  # NaN is not


@dataclass(frozen=True)
class Outcome:
    """Outcome of a case. ``residual``: largest loop residual over the mechanism's size; ``condition``: largest condition number of
    a block; ``events``: what the program reports there, in words."""

    summary: str
    checks: tuple[Check, ...]
    residual: float | None = None
    condition: float | None = None
    events: tuple[str, ...] = ()
    seconds: float = 0.0

    @property
    def passed(self) -> bool:
        return bool(self.checks) and all(c.passed for c in self.checks)

    @property
    def worst(self) -> Check:
        """The check that comes nearest to its bound, or misses it by most."""
        return max(self.checks, key=lambda c: np.inf if np.isnan(c.error) else c.error / c.bound)


@dataclass(frozen=True)
class Case:
    """A hard case. ``difficulty``: what is hard there; ``expected``: the expectation and its source; ``peers``: other programs that
    fail there."""

    name: str
    family: CaseFamily
    difficulty: str
    expected: str
    compute: Callable[[], Outcome] = field(repr=False)
    peers: str = ""

    def run(self) -> Outcome:
        """The outcome with its time; an exception is an outcome, too, which has failed."""
        start = time.perf_counter()
        try:
            outcome = self.compute()
        except Exception as e:  # a case that breaks must not hide the others
            outcome = Outcome(f"{type(e).__name__}: {e}".split("\n")[0], (Check("no exception", 1.0, 0.0),))
        return replace(outcome, seconds=time.perf_counter() - start)


def compare(name: str, computed: object, expected: object, bound: float, *, scale: float | None = None) -> Check:
    """The check of the largest difference, relative to ``scale`` (default: the largest expected value)."""
    computed, expected = np.asarray(computed, float), np.asarray(expected, float)
    size = float(np.max(np.abs(expected))) if scale is None else scale
    return Check(name, float(np.max(np.abs(computed - expected))) / (size or 1.0), bound)


def check_that(name: str, holds: Any) -> Check:
    """The check of a statement that holds or does not."""
    return Check(name, 0.0 if bool(np.all(holds)) else 1.0, 0.5)


def motion_outcome(
    motion: Motion, summary: str, checks: Iterable[Check], forces: Forces | None = None, events: Iterable[str] = ()
) -> Outcome:
    """The outcome of a motion: beside the given checks its loops have to close to rounding and, with ``forces``, its power has to
    balance."""
    size = motion.model.length_scale
    residual = float(np.max(motion.closure)) / size
    every = [*checks, Check("loops close", residual, 1e-12)]
    if forces is not None:
        every.append(Check("power balance", float(np.max(np.abs(forces.power_balance))), 1e-9))
    count = len(motion.singular_points)
    said = ([f"{count} change or dead point{'s' if count > 1 else ''}"] if count else []) + list(events)
    condition = float(np.max(motion.condition))
    return Outcome(summary, tuple(every), residual, condition, tuple(said))


def refusal_outcome(
    attempt: Callable[[], object], *patterns: str, checks: Callable[[str], Sequence[Check]] = lambda _: ()
) -> Outcome:
    """The outcome of an attempt that has to raise `MechanismError` with a message that matches every pattern; ``checks`` examine
    the message."""
    try:
        attempt()
    except MechanismError as e:
        text = re.sub(r"\s+", " ", str(e))
        every = [
            check_that("an error of ours", True),
            *(check_that(f"says {p}", re.search(p, text)) for p in patterns),
            *checks(text),
        ]
        return Outcome("refused: " + text, tuple(every), events=("error",))
    return Outcome("accepted without a word", (check_that("refused", False),))


LONGEST = 110  # characters of what was found that the table shows


def _number(value: float | None) -> str:
    return "" if value is None else "0" if value == 0.0 else f"{value:.1e}"


def case_table(results: Sequence[tuple[Case, Outcome]], width: int = 160) -> str:
    """Table with one row for each case: difficulty, expectation, result, the check nearest to its bound, residual, condition,
    events, pass or fail."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    out = io.StringIO()
    console = Console(file=out, width=max(width, 150), color_system=None, highlight=False)
    for family in CASE_FAMILIES:
        rows = [(c, o) for c, o in results if c.family == family]
        if not rows:
            continue
        grid = Table(box=box.SIMPLE_HEAD, title=family, title_justify="left", show_edge=False, pad_edge=False, padding=(0, 1))
        for name, share in (("case", 20), ("what happens there", 26), ("expected", 24), ("found", 28)):
            grid.add_column(name, ratio=share, overflow="fold")
        for name in ("error", "allowed", "residual", "condition"):
            grid.add_column(name, justify="right", no_wrap=True)
        grid.add_column("events", ratio=16, overflow="fold")
        grid.add_column("", no_wrap=True)
        for c, o in rows:
            worst = o.worst
            happens = f"{c.difficulty} (peers: {c.peers})" if c.peers else c.difficulty
            answer = o.summary if len(o.summary) <= LONGEST else o.summary[: LONGEST - 4] + " ..."
            if not o.passed:
                answer = f"{worst.name}: {answer}"
            events = "; ".join(e if len(e) < 60 else e[:56] + " ..." for e in o.events)
            cells = [c.name, happens, c.expected, answer, _number(worst.error), _number(worst.bound), _number(o.residual)]
            grid.add_row(*map(Text, [*cells, _number(o.condition), events, "pass" if o.passed else "FAIL"]))
        console.print(grid)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines())


def summary(results: Sequence[tuple[Case, Outcome]]) -> str:
    """The number of cases that pass, the time, and the names of those that fail."""
    failed = [c.name for c, o in results if not o.passed]
    seconds = sum(o.seconds for _, o in results)
    tail = f"; failed: {', '.join(failed)}" if failed else ""
    return f"{len(results) - len(failed)} of {len(results)} hard cases pass ({seconds:.1f} s){tail}"


def as_data(results: Sequence[tuple[Case, Outcome]]) -> list[dict[str, Any]]:
    """The results as plain values; numbers that are not finite are texts, as JSON has none."""
    return [
        {
            "family": c.family,
            "case": c.name,
            "happens": c.difficulty,
            "expected": c.expected,
            "peers": c.peers,
            "found": o.summary,
            "checks": [{"name": k.name, "error": _plain(k.error), "bound": k.bound, "passed": k.passed} for k in o.checks],
            "residual": _plain(o.residual),
            "condition": _plain(o.condition),
            "events": list(o.events),
            "seconds": round(o.seconds, 4),
            "passed": o.passed,
        }
        for c, o in results
    ]


def _plain(value: float | None) -> float | str | None:
    return value if value is None or abs(value) < float("inf") else str(value)
