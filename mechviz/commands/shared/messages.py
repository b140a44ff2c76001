"""Shared by all commands: messages, exit codes, interruptions, aligned tables. Imports neither numpy nor modules that read
scenes."""

from __future__ import annotations

import gc
import io
import os
import signal
import sys
import traceback
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

import typer

from mechviz.files import OutputError, check_target


def say(text: str) -> None:
    """Print a message to stderr."""
    with suppress(OSError):  # stderr is closed
        print(text, file=sys.stderr, flush=True)


def fail(text: str, code: int = 2) -> NoReturn:
    """Print what is wrong to stderr, and end the command with an exit code."""
    say(text)
    raise typer.Exit(code)


UNTRUSTED = 3  # exit code where results do not balance or close
UNFORESEEN = 70  # exit code of a fault of the program, as in sysexits.h
NAMED = ("path", "joint", "link", "load", "drive", "name")  # names of variables that hold the item being worked on


def report_unforeseen(error: BaseException, *, shown: bool) -> int:
    """Report an unforeseen error of the program, with the item of the scene at which it happened if that is known; returns the exit
    code.

    ``shown``: print the traceback too.
    """
    if shown:
        say("".join(traceback.format_exception(error)).rstrip())
    if isinstance(error, MemoryError):
        say("There is not enough memory for this. Give fewer frames or cycles, or a smaller scene.")
        return 1
    item = _item_of(error)
    text = (str(error).splitlines() or [""])[0][:200]
    say(f"mechviz has failed{f' at {item}' if item else ''}: {type(error).__name__}{f': {text}' if text else ''}.")
    say("This is a fault of mechviz, not of what you gave it. Please report it with the command and the scene; what follows")
    say("--traceback shows where it happened. Nothing that was there before has been changed.")
    return UNFORESEEN


def _item_of(error: BaseException) -> str:
    """Name, in quotes, of the item that the innermost function of this program with a variable in ``NAMED`` was working on, or
    ""."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    for frame in reversed(frames):
        package, _, part = str(frame.f_globals.get("__name__", "")).partition(".")
        if package in ("mechcore", "mechviz") and not part.startswith("commands"):
            for word in NAMED:
                value = frame.f_locals.get(word)
                value = value if isinstance(value, Path) else getattr(value, "name", value)
                if isinstance(value, str) and value and not value.startswith(("/", "__")):
                    return f"'{value[:80]}'"
    return ""


@contextmanager
def errors_as_messages() -> Iterator[None]:
    """Context manager that turns interruptions, unusable files and write errors into messages with exit codes, without a
    traceback."""
    try:
        yield
        sys.stdout.flush()
    except (KeyboardInterrupt, SystemExit) as e:  # SIGTERM raises SystemExit; the writer adds a note to both
        note = "\n".join(getattr(e, "__notes__", ())) or "Interrupted: nothing was written."
        fail(note, 130 if isinstance(e, KeyboardInterrupt) else 143)
    except OutputError as e:
        fail(str(e), e.code)
    except OSError as e:
        raise typer.Exit(report_stdout_failure(e) if e.filename is None else report_unusable(e)) from None


def check_targets(source: str, *paths: Path | None) -> None:
    """Raise `OutputError` where output files cannot be written, or would overwrite the scene or recording ``source`` or each other;
    called before anything is computed."""
    taken = {os.path.realpath(source): "is what this is made from"} if os.path.isfile(source) else {}
    for path in paths:
        if path is not None:
            real = str(check_target(path))
            if real in taken:
                raise OutputError(f"'{path}' {taken[real]}.", "Give another name.")
            taken[real] = "is wanted for two things"


def check_suffix(path: Path | None, suffix: str, option: str = "--output") -> None:
    """End the command where a file name does not have the suffix of its format."""
    if path is not None and path.suffix.lower() != suffix:
        fail(f"{option}: '{path}' does not end in {suffix}.")


def report_unusable(error: OSError) -> int:
    """Report the file that cannot be used; returns the exit code."""
    say(f"{error.filename}: {error.strerror or error}.")
    return 2


class Stdout(io.FileIO):
    """Standard output that ignores a closed pipe (as by ``head``), so that a command that prints before it writes its files still
    writes them."""

    def write(self, data: Any, /) -> int:
        """Write, and return the number of bytes written or, after the pipe is closed, discarded."""
        with suppress(BrokenPipeError):
            return super().write(data)
        _give_up(self.fileno())
        return len(memoryview(data))


def _give_up(output: int) -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), output)


def report_stdout_failure(error: OSError) -> int:
    """Report that stdout cannot be written, and redirect it to the null device; returns the exit code."""
    with suppress(OSError, ValueError):
        _give_up(sys.stdout.fileno())
    say(f"the output cannot be written: {(error.strerror or str(error)).lower()}.")
    return 1


def load_module(name: str) -> ModuleType:
    """Import a module. Garbage collection is off meanwhile, and the module's objects are exempt from it later: it would take a
    tenth of a command's time."""
    if name in sys.modules:
        return sys.modules[name]
    gc.disable()
    try:
        return import_module(name)
    finally:
        gc.freeze()
        gc.enable()


@contextmanager
def interruptible(*libraries: str) -> Iterator[None]:
    """Context manager within which Ctrl-C and SIGTERM raise exceptions, so that unfinished work can be cleaned up.

    ``libraries`` are imported first: some catch all exceptions during import, and an interruption would be lost.
    """
    for name in libraries:
        load_module(name)
    before = {
        signal.SIGINT: signal.signal(signal.SIGINT, signal.default_int_handler),
        signal.SIGTERM: signal.signal(signal.SIGTERM, lambda *_: sys.exit(143)),
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def aligned_rows(rows: Iterable[Sequence[str]]) -> list[str]:
    """Rows of a table as lines of text, the first column aligned left, the others right."""
    cells = [tuple(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        "  ".join(cell.rjust(w) if k else cell.ljust(w) for k, (cell, w) in enumerate(zip(row, widths, strict=True)))
        for row in cells
    ]
