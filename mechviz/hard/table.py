"""The outcomes of hard cases as a table for people and as data for programs."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

from .case import Case, Outcome
from .families import FAMILIES

__all__ = ["as_data", "summary", "table"]

LONGEST = 110  # characters of what was found that the table shows


def _number(value: float | None) -> str:
    return "" if value is None else "0" if value == 0.0 else f"{value:.1e}"


def table(results: Sequence[tuple[Case, Outcome]], width: int = 160) -> str:
    """One row a case: what happens there, what is expected, what was found, the check nearest to its bound, residual, condition,
    events, pass or fail."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    out = io.StringIO()
    console = Console(file=out, width=max(width, 150), color_system=None, highlight=False)
    for family in FAMILIES:
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
            happens = f"{c.happens} (peers: {c.peers})" if c.peers else c.happens
            found = o.found if len(o.found) <= LONGEST else o.found[: LONGEST - 4] + " ..."
            if not o.passed:
                found = f"{worst.name}: {found}"
            events = "; ".join(e if len(e) < 60 else e[:56] + " ..." for e in o.events)
            cells = [c.name, happens, c.expected, found, _number(worst.error), _number(worst.bound), _number(o.residual)]
            grid.add_row(*map(Text, [*cells, _number(o.condition), events, "pass" if o.passed else "FAIL"]))
        console.print(grid)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines())


def summary(results: Sequence[tuple[Case, Outcome]]) -> str:
    """How many pass, and which do not."""
    failed = [c.name for c, o in results if not o.passed]
    seconds = sum(o.seconds for _, o in results)
    tail = f"; failed: {', '.join(failed)}" if failed else ""
    return f"{len(results) - len(failed)} of {len(results)} hard cases pass ({seconds:.1f} s){tail}"


def as_data(results: Sequence[tuple[Case, Outcome]]) -> list[dict[str, Any]]:
    """The same as plain values; what is not a finite number is a text, as JSON has none."""
    return [
        {
            "family": c.family,
            "case": c.name,
            "happens": c.happens,
            "expected": c.expected,
            "peers": c.peers,
            "found": o.found,
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
