"""Shared by all commands: messages, exit codes, interruptions, progress bars. Loads neither numpy nor what reads scenes."""

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
    """Talk, to stderr."""
    with suppress(OSError):  # nobody listens
        print(text, file=sys.stderr, flush=True)


def fail(text: str, code: int = 2) -> NoReturn:
    """Say what is wrong and leave."""
    say(text)
    raise typer.Exit(code)


UNTRUSTED = 3  # exit code where results do not balance or close
UNFORESEEN = 70  # exit code of a fault of the program, as in sysexits.h
NAMED = ("path", "joint", "joint", "link", "load", "drive", "name")  # what the code calls the item of the scene that it works on


def unforeseen(error: BaseException, *, shown: bool) -> int:
    """Says that the program itself has failed, how, and at which item of the scene as far as that is known; gives the exit code.

    ``shown``: with the traceback.
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
    """Item that the innermost of our functions that names one was working on."""
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
def orderly() -> Iterator[None]:
    """Interruptions, files that cannot be used and full outputs as messages with their exit codes; never a traceback."""
    try:
        yield
        sys.stdout.flush()
    except (KeyboardInterrupt, SystemExit) as e:  # SIGTERM arrives as SystemExit; the writer leaves a note on both
        note = "\n".join(getattr(e, "__notes__", ())) or "Interrupted: nothing was written."
        fail(note, 130 if isinstance(e, KeyboardInterrupt) else 143)
    except OutputError as e:
        fail(str(e), e.code)
    except OSError as e:
        raise typer.Exit(no_output(e) if e.filename is None else tell_unusable(e)) from None


def check_targets(source: str, *paths: Path | None) -> None:
    """Refuse files that cannot be written where they are wanted, before anything is computed for them: neither over the scene or
    recording that they are made from nor over each other. Raises `OutputError`."""
    taken = {os.path.realpath(source): "is what this is made from"} if os.path.isfile(source) else {}
    for path in paths:
        if path is not None:
            real = str(check_target(path))
            if real in taken:
                raise OutputError(f"'{path}' {taken[real]}.", "Give another name.")
            taken[real] = "is wanted for two things"


def check_suffix(path: Path | None, suffix: str, option: str = "--output") -> None:
    """Refuse a file whose name does not say what it will be."""
    if path is not None and path.suffix.lower() != suffix:
        fail(f"{option}: '{path}' does not end in {suffix}.")


def tell_unusable(error: OSError) -> int:
    """Says which file cannot be used; gives the exit code."""
    say(f"{error.filename}: {error.strerror or error}.")
    return 2


class Stdout(io.FileIO):
    """Standard output for which a reader that leaves (as `head` does) is no error: a command that prints before it writes its files
    still writes them."""

    def write(self, data: Any, /) -> int:
        """How many bytes are gone."""
        with suppress(BrokenPipeError):
            return super().write(data)
        _give_up(self.fileno())
        return len(memoryview(data))


def _give_up(output: int) -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), output)


def no_output(error: OSError) -> int:
    """Says that stdout cannot be written, and gives up on it; gives the exit code."""
    with suppress(OSError, ValueError):
        _give_up(sys.stdout.fileno())
    say(f"the output cannot be written: {(error.strerror or str(error)).lower()}.")
    return 1


def load_module(name: str) -> ModuleType:
    """A module. Objects that it makes while it loads stay: looking through them for garbage would take a tenth of a command's
    time."""
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
    """From here on Ctrl-C and SIGTERM are exceptions, so that what was begun can be left in order.

    ``libraries`` are loaded before: some catch everything while they load, and the exception would be lost.
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
    """Rows of a table as lines, the first column to the left, the others to the right."""
    cells = [tuple(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        "  ".join(cell.rjust(w) if k else cell.ljust(w) for k, (cell, w) in enumerate(zip(row, widths, strict=True)))
        for row in cells
    ]
