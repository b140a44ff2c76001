"""Start of the `mechviz` command: light, so that Ctrl-C ends it with a message even while the libraries load."""

from __future__ import annotations

import gc
import os
import signal


def _leave(number: int, frame: object) -> None:
    """Ends the program at once. For as long as no file has been begun: a library that is loading may swallow an exception."""
    os.write(2, b"\nInterrupted: nothing was written.\n")
    os._exit(128 + number)


def main() -> None:
    """Entry point of the `mechviz` command."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:  # as under nohup
            signal.signal(number, _leave)
    gc.disable()  # until the command has loaded (`load_module`)
    gc.set_threshold(100_000, 20, 20)
    from mechviz.commands.main import main as command

    command()


if __name__ == "__main__":
    main()
