"""Libraries of generated C: the compiler of the machine, a cache of what it has made, and loading.

A library is known by what it is made of: its source, the compiler and its options. The cache is a folder of the user's alone; a
library in it ends with its own checksum, and is written under another name first, so that neither a second process nor a power
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
DIGEST = hashlib.sha256().digest_size
LONGEST = 300.0  # [s] that the compiler may take
LOADED = 256  # libraries that stay loaded under their source


@cache
def compiler() -> tuple[str, ...] | None:
    """The command of a C compiler: the system's ``cc``, else that of the package ``ziglang``; None where there is neither."""
    found = shutil.which("cc")
    if found is not None:
        return (found,)
    return (sys.executable, "-m", "ziglang", "cc") if find_spec("ziglang") is not None else None


def required_compiler() -> tuple[str, ...]:
    """`compiler`. Raises `MechanismError` where there is none."""
    found = compiler()
    if found is None:
        why = "there is no C compiler: neither a command 'cc' nor the package ziglang is found."
        remedy = "Install one (pip install 'mechviz[fast]' brings ziglang), or choose the executor numpy."
        raise MechanismError(Fault("executor", why, remedy))
    return found


@lru_cache(LOADED)
def library(source: str) -> ctypes.CDLL:
    """A library compiled from C, from the cache where it is there. Raises `MechanismError` where that fails."""
    command = required_compiler()
    name = f"{_identity(command, source)}.so"
    with _folder() as folder:
        path = folder / name
        if not _sound(path):
            _compile(command, source, path)
        try:
            return ctypes.CDLL(str(path))
        except OSError as error:
            why = f"the compiled program cannot be loaded: {error}."
            raise MechanismError(Fault("executor", why, "Choose the executor numpy.")) from error


def cached(source: str) -> bool:
    """Whether a library is in the cache, so that nothing has to be compiled."""
    command = compiler()
    if command is None:
        return False
    folder = cache_folder()
    return _owned(folder) and _sound(folder / f"{_identity(command, source)}.so")


def cache_folder() -> Path:
    """Where libraries are kept: ``mechviz`` in the user's cache folder."""
    stated = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(stated) if os.path.isabs(stated) else Path.home() / ".cache") / "mechviz"


def _identity(command: tuple[str, ...], source: str) -> str:
    """A digest of all that a library depends on; of the compiler its file, size and time of change."""
    real = os.path.realpath(command[0])
    state = os.stat(real)
    parts = (*command[1:], real, state.st_size, state.st_mtime_ns, *OPTIONS, sys.platform, source)
    return hashlib.sha256("\0".join(map(str, parts)).encode()).hexdigest()


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


def _sound(path: Path) -> bool:
    """Whether a file is there and ends with the checksum of the rest."""
    try:
        data = path.read_bytes()
    except OSError:
        return False
    return len(data) > DIGEST and hashlib.sha256(data[:-DIGEST]).digest() == data[-DIGEST:]


def _compile(command: tuple[str, ...], source: str, path: Path) -> None:
    """Compile into a file of another name, which then takes the place of ``path``."""
    handle, made = tempfile.mkstemp(prefix="making-", suffix=".so", dir=path.parent)
    os.close(handle)
    try:
        ran = subprocess.run(
            [*command, *OPTIONS, "-x", "c", "-", "-o", made, "-lm"],
            input=source, capture_output=True, text=True, timeout=LONGEST, check=False,
        )  # fmt: skip
        if ran.returncode:
            first = next((line for line in ran.stderr.splitlines() if "error" in line), ran.stderr[:200])
            raise MechanismError(Fault("executor", f"the C compiler fails: {first.strip()}.", "Choose the executor numpy."))
        data = Path(made).read_bytes()
        with open(made, "ab") as file:
            file.write(hashlib.sha256(data).digest())
        os.replace(made, path)
    except (OSError, subprocess.TimeoutExpired) as error:
        why = f"the C compiler cannot be used: {error}."
        raise MechanismError(Fault("executor", why, "Choose the executor numpy.")) from error
    finally:
        with suppress(OSError):
            os.remove(made)
