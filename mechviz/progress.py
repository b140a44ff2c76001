"""Progress of long work: a bar on a terminal, a line that is updated in a notebook, elsewhere an occasional line."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from typing import Any

PAUSE = 0.2  # [s] between updates of the line in a notebook
LINE_PAUSE = 30.0  # [s] between lines where there is neither terminal nor notebook, and before the first

Update = Callable[..., object]
"""``update(description=, completed=, total=)`` with the values that change; ``total`` is None while it is unknown."""


@dataclass(frozen=True)
class Bar:
    """Progress of long work: call it with the amount done and the total; ``stage`` names the present stage."""

    label: str = ""
    update: Update = lambda **_: None

    def __call__(self, done: int, total: int) -> None:
        self.update(completed=done, total=total)

    def stage(self, name: str) -> None:
        """Start a new stage. Its total is unknown until the bar is called."""
        self.update(description=f"{self.label}: {name}", completed=0, total=None)


@contextmanager
def progress_bar(label: str, after: float = 0.0) -> Iterator[Bar]:
    """Context with a progress bar on stderr, or a line in a notebook, which disappears at the end. It appears with the first update
    after ``after`` [s]. Where stderr is neither, lines are printed, which stay."""
    show: Callable[[str], AbstractContextManager[Update]]
    show = _on_terminal if sys.stderr.isatty() else _in_notebook() or _as_lines
    with ExitStack() as stack:
        begun, shown, words = time.monotonic(), None if after else stack.enter_context(show(label)), label

        def update(**what: Any) -> None:
            nonlocal shown, words
            words = what.get("description", words)
            if shown is None and time.monotonic() - begun >= after:
                shown = stack.enter_context(show(words))
            if shown is not None:
                shown(**what)

        yield Bar(label, update)


@contextmanager
def _on_terminal(label: str) -> Iterator[Update]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task(label, total=None)
        yield lambda **what: shown.update(task, **what)


@contextmanager
def _as_lines(label: str) -> Iterator[Update]:
    words, stage_begun, last_line = label, time.monotonic(), time.monotonic()

    def update(description: str = "", completed: int = 0, total: int | None = None) -> None:
        nonlocal words, stage_begun, last_line
        now = time.monotonic()
        if description:
            words, stage_begun = description, now
        if now - last_line >= LINE_PAUSE:
            last_line = now
            share = f", {100 * completed // total} %" if total else ""
            left = (now - stage_begun) * (total - completed) / completed if total and completed else 0.0
            with suppress(OSError):  # stderr may be closed
                print(f"{words}{share}{f', about {duration(left)} left' if left else ''}", file=sys.stderr, flush=True)

    yield update


def duration(seconds: float) -> str:
    """A duration in words: two digits, in seconds, minutes or hours."""
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.2g} {unit}" if seconds < 99.5 * size else f"{seconds / size:.0f} {unit}"
    return f"{max(seconds, 1.0):.2g} s"


def _in_notebook() -> Callable[[str], AbstractContextManager[Update]] | None:
    """Context that shows a line in the notebook in which the program runs; None where it does not run in one."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if not hasattr(shell, "kernel"):
        return None
    display = sys.modules["IPython"].display.display

    @contextmanager
    def line(label: str) -> Iterator[Update]:
        handle = display({"text/plain": label}, raw=True, display_id=True)
        words, last_update = label, time.monotonic()

        def update(description: str = "", completed: int = 0, total: int | None = None) -> None:
            nonlocal words, last_update
            words = description or words
            if description or time.monotonic() - last_update >= PAUSE:
                last_update = time.monotonic()
                share = f" {100 * completed // total} %" if total else ""
                handle.update({"text/plain": f"{words}{share}"}, raw=True)

        yield update
        handle.update({"text/plain": ""}, raw=True)

    return line
