"""Progress of long work: a bar on a terminal, a line that changes in a notebook, elsewhere a line now and then."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from typing import Any

PAUSE = 0.2  # [s] between changes of the line in a notebook
LINE_PAUSE = 30.0  # [s] between lines where there is neither terminal nor notebook, and before the first

Update = Callable[..., object]
"""``update(description=, completed=, total=)``, each if it changes; ``total`` None while it is not known."""


@dataclass(frozen=True)
class Bar:
    """How far long work is: to be called with what is done and of how much; ``stage`` gets what is done now."""

    label: str = ""
    update: Update = lambda **_: None

    def __call__(self, done: int, total: int) -> None:
        self.update(completed=done, total=total)

    def stage(self, name: str) -> None:
        """Something else is done from now on; how long it takes nobody knows until the bar is called."""
        self.update(description=f"{self.label}: {name}", completed=0, total=None)


@contextmanager
def progress_bar(label: str, after: float = 0.0) -> Iterator[Bar]:
    """A bar on stderr for long work, in a notebook a line, which appears with the first news ``after`` so many seconds, and goes in
    the end; where stderr is neither, lines that stay."""
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
            with suppress(OSError):  # nobody listens
                print(f"{words}{share}{f', about {duration(left)} left' if left else ''}", file=sys.stderr, flush=True)

    yield update


def duration(seconds: float) -> str:
    """A duration in words: two digits, in seconds, minutes or hours."""
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.2g} {unit}" if seconds < 99.5 * size else f"{seconds / size:.0f} {unit}"
    return f"{max(seconds, 1.0):.2g} s"


def _in_notebook() -> Callable[[str], AbstractContextManager[Update]] | None:
    """Shows a line in the notebook in which this runs; None where it does not run in one."""
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
