"""Commands of mechviz in processes that are forked from this one, which has loaded all modules: a hundred of them cost what ten
cost that are started anew. They can be killed at a time, and given less room on the disk."""

from __future__ import annotations

import os
import resource
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from mechviz.commands.main import COMMANDS, main

LIBRARIES = ("trimesh", "shapely", "scipy.optimize", "mechviz.meshes", "mechviz.outputs.page.page")


@dataclass(frozen=True)
class Ended:
    """How a process ended: its exit code, or minus the signal that ended it; what it said; processor time that it took [s]."""

    code: int
    text: str
    seconds: float


def load_all() -> None:
    """Load what the commands use, but for rerun and pyarrow, which start threads: no thread lives on in a fork."""
    for name in (*(f"mechviz.commands.{module}" for module in COMMANDS if module != "main"), *LIBRARIES):
        import_module(name)
    running = len(os.listdir("/proc/self/task"))
    if running != 1:
        raise RuntimeError(f"{running} threads run: their locks would be held in a fork; set OPENBLAS_NUM_THREADS=1")


def forked(work: Callable[[], object], said: Path, kill_after: float | None = None) -> Ended:
    """Do something in a fork of this process, which says what it says into a file; ``kill_after`` [s] it is killed (-9)."""
    child = os.fork()
    if child == 0:
        out = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(out, 1)
        os.dup2(out, 2)
        code = 70
        try:
            work()
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
        except BaseException as error:
            print(f"Traceback: {type(error).__name__}: {error}", flush=True)
        os._exit(code)
    if kill_after is not None:
        time.sleep(kill_after)
        os.kill(child, signal.SIGKILL)
    _, status, used = os.wait4(child, 0)
    return Ended(os.waitstatus_to_exitcode(status), said.read_text(errors="replace"), used.ru_utime + used.ru_stime)


def command(*words: str, largest_file: int | None = None) -> Callable[[], None]:
    """A command of mechviz; ``largest_file`` [bytes] that it can write, as on a disk that fills up."""

    def work() -> None:
        if largest_file is not None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file))
        sys.argv = ["mechviz", *words]
        main()

    return work


def faults(ended: Ended, allowed: tuple[int, ...]) -> str:
    """What is wrong with how a command ended, in words; nothing where it ended as it may."""
    if "Traceback" in ended.text or "RuntimeWarning" in ended.text:
        return f"says {ended.text[-300:]!r}"
    if ended.code not in allowed:
        return f"ends with {ended.code}: {ended.text[-300:]!r}"
    if ended.code in (1, 2) and not ended.text.strip():
        return f"ends with {ended.code} without a word"
    return ""
