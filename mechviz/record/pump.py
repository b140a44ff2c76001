"""A pipe into a file whose writing end never fails.

rerun's own file writer gives up when the disk is full, and from then on flushing, closing, even leaving Python may wait for it
for ever (seen with 0.41). So rerun writes into a pipe; a thread of ours carries the bytes to the file, and where that fails it
keeps the error for the recorder to raise, and the pipe empty.
"""

from __future__ import annotations

import fcntl
import os
import select
import struct
import termios
import threading
from pathlib import Path

__all__ = ["Pump"]

PIECE = 1 << 20


class Pump:
    """Writes to a file what is written to ``entrance``, a path that can be opened for writing once."""

    def __init__(self, path: Path):
        self._file = open(path, "wb", buffering=0)  # noqa: SIM115  closed in `finish`
        self._outlet, self._inlet = os.pipe()
        self._error: OSError | None = None
        self._lock = threading.Lock()  # held while bytes are on their way from the pipe to the file
        self._thread = threading.Thread(target=self._run, name="recording to file", daemon=True)
        self._thread.start()

    @property
    def entrance(self) -> str:
        """Where to write."""
        return f"/dev/fd/{self._inlet}"

    def opened(self) -> None:
        """The writer has opened the entrance: our own end of it closes, so that the file ends when the writer's does."""
        os.close(self._inlet)
        self._inlet = -1

    def drain(self) -> None:
        """Wait until all that was written to the pipe is in the file; raises OSError if that failed."""
        while True:
            with self._lock:
                if self._error is not None:
                    raise self._error
                if not self._waiting():
                    return

    def finish(self) -> None:
        """Wait for the end of the pipe, after the writer has closed it, and close the file; raises OSError as `drain` does."""
        if self._inlet >= 0:
            self.opened()
        self._thread.join()
        os.close(self._outlet)
        self._file.close()
        if self._error is not None:
            raise self._error

    def _waiting(self) -> int:
        """Bytes in the pipe."""
        return int(struct.unpack("i", fcntl.ioctl(self._outlet, termios.FIONREAD, b"\0" * 4))[0])

    def _run(self) -> None:
        while True:
            select.select([self._outlet], [], [])  # outside of the lock: the pipe may be idle for long
            with self._lock:
                data = os.read(self._outlet, PIECE)
                if not data:
                    return
                if self._error is None:
                    try:
                        self._write(data)
                    except OSError as error:
                        self._error = error

    def _write(self, data: bytes) -> None:
        rest = memoryview(data)
        while rest:
            rest = rest[self._file.write(rest) :]
