"""Libraries of generated C: the compiler of the machine, a cache of what it has made, and loading.

A library is known by what it is made of: its source, the compiler and its options. The cache is a folder of the user's alone; a
library in it has its own checksum in its name, and is written under another one first, so that neither a second process nor a power
failure leaves a damaged one that is used.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path

from mechcore.errors import Fault, MechanismError

OPTIONS = ("-O2", "-fno-math-errno", "-ffp-contract=off", "-fPIC", "-shared")  # none that lets results depend on the machine
DIGITS = 32  # of digests
LONGEST = 300.0  # [s] that the compiler may take
LOADED = 256  # libraries that stay loaded under their source


@cache
def compiler() -> tuple[str, ...] | None:
    """The command of a C compiler: the system's ``cc``, else that of the package ``ziglang``; None where there is neither."""
    command = shutil.which("cc")
    if command is not None:
        return (command,)
    return (sys.executable, "-m", "ziglang", "cc") if find_spec("ziglang") is not None else None


def required_compiler() -> tuple[str, ...]:
    """`compiler`. Raises `MechanismError` where there is none."""
    command = compiler()
    if command is None:
        why = "there is no C compiler: neither a command 'cc' nor the package ziglang is found."
        remedy = "Install one (pip install 'mechviz[fast]' brings ziglang), or choose the executor numpy."
        raise MechanismError(Fault("executor", why, remedy))
    return command


@lru_cache(LOADED)
def library(source: str) -> ctypes.CDLL:
    """A library compiled from C, from the cache where it is there. Raises `MechanismError` where that fails."""
    command = required_compiler()
    identity = _identity(command, source)
    with _folder() as folder:
        try:
            return ctypes.CDLL(str(_sound(folder, identity) or _compile(command, source, folder, identity)))
        except OSError as error:
            why = f"the compiled program cannot be loaded: {error}."
            raise MechanismError(Fault("executor", why, "Choose the executor numpy.")) from error


def cached(source: str) -> bool:
    """Whether a library is in the cache, so that nothing has to be compiled."""
    command = compiler()
    if command is None:
        return False
    folder = cache_folder()
    return _owned(folder) and _sound(folder, _identity(command, source)) is not None


def cache_folder() -> Path:
    """Where libraries are kept: ``mechviz`` in the user's cache folder."""
    stated = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(stated) if os.path.isabs(stated) else Path.home() / ".cache") / "mechviz"


def _identity(command: tuple[str, ...], source: str) -> str:
    """A digest of all that a library depends on; of the compiler its file (of ziglang the package's), size and time of change."""
    package = find_spec(command[2]) if len(command) > 2 else None
    real = os.path.realpath(command[0] if package is None or package.origin is None else package.origin)
    state = os.stat(real)
    parts = (*command[1:], real, state.st_size, state.st_mtime_ns, *OPTIONS, sys.platform, source)
    return hashlib.sha256("\0".join(map(str, parts)).encode()).hexdigest()[:DIGITS]


@contextmanager
def _folder() -> Iterator[Path]:
    """The cache, or a temporary folder where the cache cannot be made or others could write into it."""
    folder = cache_folder()
    with suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if _owned(folder):
        yield folder
        return
    with tempfile.TemporaryDirectory(prefix="mechviz-") as made:
        yield Path(made)


def _owned(folder: Path) -> bool:
    """Whether a folder is the user's own, and nobody else can write or read in it."""
    try:
        state = folder.lstat()
    except OSError:
        return False
    if not stat.S_ISDIR(state.st_mode) or not os.access(folder, os.W_OK | os.X_OK):
        return False
    return not hasattr(os, "getuid") or (state.st_uid == os.getuid() and not state.st_mode & 0o077)


def _checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:DIGITS]


def _sound(folder: Path, identity: str) -> Path | None:
    """The library in a folder whose name is its own checksum; those of the same source that are damaged go."""
    for path in folder.glob(f"{identity}-*.so"):
        with suppress(OSError):
            if path.stem == f"{identity}-{_checksum(path)}":
                return path
            path.unlink()
    return None


def _compile(command: tuple[str, ...], source: str, folder: Path, identity: str) -> Path:
    """Compile into a file that then gets the name by which it is known."""
    handle, made = tempfile.mkstemp(prefix="making-", suffix=".so", dir=folder)
    os.close(handle)
    try:
        ran = subprocess.run(
            [*command, *OPTIONS, "-x", "c", "-", "-o", made, "-lm"],
            input=source, capture_output=True, text=True, timeout=LONGEST, check=False,
        )  # fmt: skip
        if ran.returncode:
            first = next((line for line in ran.stderr.splitlines() if "error" in line), ran.stderr[:200])
            raise MechanismError(Fault("executor", f"the C compiler fails: {first.strip()}.", "Choose the executor numpy."))
        path = folder / f"{identity}-{_checksum(Path(made))}.so"
        os.replace(made, path)
        return path
    except (OSError, subprocess.TimeoutExpired) as error:
        why = f"the C compiler cannot be used: {error}."
        raise MechanismError(Fault("executor", why, "Choose the executor numpy.")) from error
    finally:
        with suppress(OSError):
            os.remove(made)
