"""Recordings as files: written through a pipe into an unfinished file beside the target, which it replaces when complete."""

from __future__ import annotations

import errno
import fcntl
import os
import select
import socket
import stat
import struct
import termios
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from mechviz.files import OutputError, check_target, output_error, put_in_place, try_lock
from mechviz.outputs.rerun.entities import APPLICATION_ID, RecordingError
from mechviz.outputs.rerun.rerun_adapter import send_blueprint

if TYPE_CHECKING:
    import rerun as rr

READ_SIZE = 1 << 20


class Pump:
    """Copies to an open file what is written to ``entrance``, a path that can be opened for writing once."""

    def __init__(self, file: int):
        self._file = os.dup(file)
        self._outlet, self._inlet = os.pipe()
        with suppress(AttributeError, OSError):  # only on Linux, within the user's limit
            fcntl.fcntl(self._inlet, fcntl.F_SETPIPE_SZ, READ_SIZE)
        self._move = getattr(os, "splice", _copy)  # on Linux: from pipe to file within the kernel
        self._error: OSError | None = None
        self._lock = threading.Lock()  # held while bytes are moved from the pipe to the file
        self._thread = threading.Thread(target=self._run, name="recording to file", daemon=True)
        self._thread.start()

    @property
    def entrance(self) -> str:
        """Path of the end of the pipe for the writer."""
        return f"/dev/fd/{self._inlet}"

    def opened(self) -> None:
        """Close our own end of the entrance, after the writer has opened it: the file then ends when the writer closes its end."""
        os.close(self._inlet)
        self._inlet = -1

    def drain(self) -> None:
        """Wait until everything written to the pipe is in the file. Raises OSError if that failed."""
        while True:
            with self._lock:
                if self._error is not None:
                    raise self._error
                if not self._waiting():
                    return

    def finish(self) -> None:
        """Wait for the end of the pipe, after the writer has closed it, and close the file. Raises OSError if writing failed."""
        if self._inlet >= 0:
            self.opened()
        self._thread.join()
        os.close(self._outlet)
        os.close(self._file)
        if self._error is not None:
            raise self._error

    def _waiting(self) -> int:
        """Number of bytes in the pipe."""
        return int(struct.unpack("i", fcntl.ioctl(self._outlet, termios.FIONREAD, b"\0" * 4))[0])

    def _run(self) -> None:
        while True:
            select.select([self._outlet], [], [])  # outside the lock: the pipe may be idle for long
            with self._lock:
                if self._error is not None:  # read on, so that the writer is not blocked
                    if not os.read(self._outlet, READ_SIZE):
                        return
                    continue
                try:
                    if not self._move(self._outlet, self._file, READ_SIZE):
                        return
                except OSError as error:
                    if error.errno == errno.EINVAL and self._move is not _copy:  # not supported by the file system
                        self._move = _copy
                    else:
                        self._error = error


def _copy(source: int, target: int, most: int) -> int:
    """Read and write up to ``most`` bytes; return their number, 0 at the end."""
    data = os.read(source, most)
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(target, rest) :]
    return len(data)


def part_path(path: Path) -> Path:
    """The name of an unfinished recording: ``out.rrd`` -> ``out.part.rrd``."""
    stem = path.stem if path.suffix == ".rrd" else path.name
    return path.with_name(f"{stem}.part.rrd")


class PartialFile:
    """An open recording stream; ``frames``: number of frames that are safely in the file."""

    def __init__(self, stream: rr.RecordingStream, pump: Pump):
        self.stream = stream
        self.frames = 0
        self._pump = pump

    def flush(self, frames: int) -> None:
        """Write everything sent so far, which contains ``frames`` frames, to the file. Raises OSError if that fails."""
        self.stream.flush()
        self._pump.drain()
        self.frames = frames

    def close(self) -> None:
        """Complete the file. Raises OSError if that fails."""
        if self.stream is not None:
            self.stream.disconnect()
            self._pump.finish()

    def release(self) -> None:
        """Release the stream and its threads."""
        self.stream = None
        forget_streams()


def forget_streams() -> None:
    """Let rerun release streams without references: it keeps each with its threads until then."""
    import rerun as rr

    rr.init(APPLICATION_ID, init_logging=False)  # starts nothing, but releases them


@contextmanager
def recording_file(path: Path, blueprint: object, recording_id: str | None, title: str) -> Iterator[PartialFile]:
    """A context with a recording stream whose file replaces ``path`` if the block succeeds.

    After an interruption (Ctrl-C, or SIGTERM turned into `SystemExit`) the frames so far stay under `part_path`, and a note on the
    exception says so; after an error no file is left. In both cases an existing recording is unchanged. Raises `RecordingError`.
    """
    import rerun as rr

    target, temporary, claim, pump = _begin(path)
    strict = rr.strict_mode()
    rr.set_strict_mode(True)  # otherwise wrong lengths only warn, and the data are dropped
    stream = rr.RecordingStream(APPLICATION_ID, recording_id=recording_id)
    part = PartialFile(stream, pump)
    try:
        stream.save(pump.entrance)
        pump.opened()
        send_blueprint(stream, blueprint)
        stream.set_log_time_enabled(False)
        stream.send_recording_name(title)
        yield part
        part.flush(part.frames)
        part.close()
        put_in_place(temporary, target)
    except (KeyboardInterrupt, SystemExit) as stop:
        with suppress(OSError):
            part.close()
        stop.add_note(_left_behind(path, temporary, part.frames))
        raise
    except OSError as error:
        with suppress(OSError):
            part.close()
        temporary.unlink(missing_ok=True)
        raise _cannot_write(path, error) from None
    except BaseException:
        with suppress(OSError):
            part.close()
        temporary.unlink(missing_ok=True)
        raise
    finally:
        del stream
        part.release()
        rr.set_strict_mode(strict)
        os.close(claim)


@contextmanager
def live_file(path: Path, port: int | None, title: str, blueprint: object) -> Iterator[tuple[PartialFile, str | None]]:
    """A context with a recording stream into the unfinished file beside ``path``, and to viewers on ``port`` of this machine (0: a
    free one, None: no viewers), and the address for viewers. The file is kept if the block is interrupted, and a note on the
    exception says so; otherwise it is removed. Raises `RecordingError`."""
    import rerun as rr

    if port is not None:
        port = _open(port or free_port())  # before the stream: rerun warns if a stream ends without having been connected
    _, temporary, claim, pump = _begin(path)
    strict = rr.strict_mode()
    rr.set_strict_mode(True)
    stream = rr.RecordingStream(APPLICATION_ID)
    part = PartialFile(stream, pump)
    keep = False
    try:
        address = None
        if port is None:
            stream.save(pump.entrance)
        else:
            sink = rr.GrpcServerSink(bind_ip="127.0.0.1", port=port)
            stream.set_sinks(sink, rr.FileSink(pump.entrance))
            address = f"rerun+http://127.0.0.1:{port}/proxy"
        pump.opened()
        send_blueprint(stream, blueprint)
        stream.set_log_time_enabled(False)
        stream.send_recording_name(f"{title} (running)")
        yield part, address
    except (KeyboardInterrupt, SystemExit) as stop:
        keep = part.frames > 0
        stop.add_note(_left_behind(path, temporary, part.frames))
        raise
    except OSError as error:
        raise _cannot_write(path, error) from None
    finally:
        with suppress(OSError):
            part.close()
        if not keep:
            temporary.unlink(missing_ok=True)
        del stream
        part.release()
        rr.set_strict_mode(strict)
        os.close(claim)


def free_port() -> int:
    """A free port of this machine."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _open(port: int) -> int:
    """The port, if it is free. Raises `RecordingError` otherwise: rerun would wait for it in the background without a message."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            taken = error.errno == errno.EADDRINUSE
            why = "another program uses it" if taken else (error.strerror or str(error)).lower()
            remedy = "Give another one, or --live 0 for a free one."
            raise RecordingError(f"Port {port} cannot be opened: {why}.", remedy, 1) from None
    return port


def _begin(path: Path) -> tuple[Path, Path, int, Pump]:
    """The target of a recording, its unfinished file, the descriptor that locks it, and the pump that writes to it."""
    try:
        target = check_target(path)
        temporary = part_path(target)
        claim = _claim(temporary)
    except OutputError as error:
        raise RecordingError.of(error) from None
    except OSError as error:
        raise _cannot_write(path, error) from None
    try:
        return target, temporary, claim, Pump(claim)
    except (OSError, RuntimeError) as error:  # RuntimeError: no thread can be made
        temporary.unlink(missing_ok=True)
        os.close(claim)
        remedy = "End other programs, or allow more threads and open files."
        raise RecordingError(f"'{path}' cannot be written: {error}.", remedy, 1) from None


def _claim(temporary: Path) -> int:
    """Create the unfinished file, locked for this process until the returned descriptor is closed.

    The file of an interrupted run is removed. Links and other files that are not regular are not followed, opened or removed: they
    raise `RecordingError`, as does a file that another run is writing.
    """
    while True:
        try:
            claim = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
        except FileExistsError:
            _clear_away(temporary)
            continue
        if try_lock(claim, temporary):
            return claim
        os.close(claim)
        raise _busy(temporary)


def _clear_away(temporary: Path) -> None:
    """Remove the unfinished file of a run that has ended."""
    try:
        if not stat.S_ISREG(os.lstat(temporary).st_mode):
            why = f"'{temporary}', where the recording is to grow, is not a regular file."
            raise RecordingError(why, "Remove it, or write to another file.")
        old = os.open(temporary, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        return
    try:
        if not try_lock(old, temporary):
            raise _busy(temporary)
        temporary.unlink(missing_ok=True)
    finally:
        os.close(old)


def _busy(temporary: Path) -> RecordingError:
    return RecordingError(f"'{temporary}' is being written by another run.", "Wait for it, or write to another file.", 1)


def _left_behind(path: Path, temporary: Path, frames: int) -> str:
    if frames == 0:
        temporary.unlink(missing_ok=True)
        return f"Interrupted before any frame was written: '{path}' was not made."
    return f"Interrupted: the {frames} frames written so far are in '{path.with_name(temporary.name)}'."


def _cannot_write(path: Path, error: OSError) -> RecordingError:
    return RecordingError.of(output_error(error, path))
