"""The file behind a recording: a temporary neighbour that becomes the recording when it is complete."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..files import OutputError, check_target, put_in_place, reason
from .errors import RecordingError

__all__ = ["Part", "part_path", "recording_file"]

APPLICATION = "mechviz"


def part_path(path: Path) -> Path:
    """The name of an unfinished recording: ``out.rrd`` -> ``out.part.rrd``."""
    stem = path.stem if path.suffix == ".rrd" else path.name
    return path.with_name(f"{stem}.part.rrd")


class Part:
    """An open recording stream; ``frames`` counts those that are safe in the file."""

    def __init__(self, stream: Any):
        self.stream = stream
        self.frames = 0

    def flush(self, frames: int) -> None:
        """Everything sent so far goes to the file; raises if the disk does not take it."""
        self.stream.flush()
        self.frames = frames


@contextmanager
def recording_file(path: Path, blueprint: Any, recording_id: str | None, title: str) -> Iterator[Part]:
    """A recording stream whose file takes the place of ``path`` if the block succeeds.

    Interrupted (Ctrl-C, or SIGTERM turned into `SystemExit`) it leaves what was flushed under `part_path`, and a note on the
    exception says so; after an error nothing is left. A recording that was there before stays as it was in both cases.
    """
    import rerun as rr

    try:
        target = check_target(path)
    except OutputError as error:
        raise RecordingError(error.message, error.remedy) from None
    temporary = part_path(target)
    stream = rr.RecordingStream(APPLICATION, recording_id=recording_id)
    part = Part(stream)
    strict = rr.strict_mode()
    rr.set_strict_mode(True)  # else wrong lengths only warn, and the data are dropped
    try:
        _try_to_open(temporary)
        stream.save(temporary)
        # active, not only default: the viewer keeps one layout per application, and that of another scene would not fit
        stream.send_blueprint(blueprint, make_active=True, make_default=True)
        stream.set_log_time_enabled(False)
        stream.send_recording_name(title)
        yield part
        part.flush(part.frames)
        stream.disconnect()
        put_in_place(temporary, target)
    except (KeyboardInterrupt, SystemExit) as stop:
        _close(stream)
        stop.add_note(_left_behind(path, temporary, part.frames))
        raise
    except OSError as error:
        _close(stream)
        temporary.unlink(missing_ok=True)
        words = reason(error, path)
        raise RecordingError(words.message, words.remedy) from None
    except RuntimeError as error:
        _close(stream)
        failure = _write_failure(path, temporary, error)
        temporary.unlink(missing_ok=True)
        raise failure from None
    except BaseException:
        _close(stream)
        temporary.unlink(missing_ok=True)
        raise
    finally:
        rr.set_strict_mode(strict)


def _try_to_open(temporary: Path) -> None:
    """Open and empty the file ourselves first: the operating system's words are better than the SDK's."""
    with open(temporary, "wb"):
        pass


def _close(stream: Any) -> None:
    with suppress(RuntimeError):
        stream.flush()
    with suppress(RuntimeError):
        stream.disconnect()


def _left_behind(path: Path, temporary: Path, frames: int) -> str:
    if frames == 0:
        temporary.unlink(missing_ok=True)
        return f"Interrupted before any frame was written: '{path}' was not made."
    return f"Interrupted: the {frames} frames written so far are in '{path.with_name(temporary.name)}'."


def _write_failure(path: Path, temporary: Path, error: RuntimeError) -> RecordingError:
    """Why the SDK's writer gave up: it does not say, so a small write to the same file finds out."""
    try:
        with open(temporary, "ab") as file:
            file.write(bytes(1 << 16))
            file.flush()
            os.fsync(file.fileno())
    except OSError as cause:
        words = reason(cause, path)
        return RecordingError(words.message, words.remedy)
    return RecordingError(f"'{path}' cannot be written: {error}.", "Check the disk and try again.")
