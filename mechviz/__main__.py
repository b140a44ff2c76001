"""Entry point of the `mechviz` command. It imports little, so that Ctrl-C ends it with a message even while the libraries load."""

from __future__ import annotations

import gc
import os
import signal


def _leave(number: int, frame: object) -> None:
    """Signal handler that ends the program at once; used as long as no file has been started. It does not raise an exception, which
    a library that is loading might swallow."""
    os.write(2, b"\nInterrupted: nothing was written.\n")
    os._exit(128 + number)


def main() -> None:
    """Entry point of the `mechviz` command."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:  # ignored under nohup: keep it so
            signal.signal(number, _leave)
    gc.disable()  # until the command has loaded (`load_module`)
    gc.set_threshold(100_000, 20, 20)
    from mechviz.commands.main import main as command

    command()


if __name__ == "__main__":
    main()
