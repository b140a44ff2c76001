"""Libraries of generated C: the compiler of the machine, a cache of its output, and loading.

A library is identified by its source, the compiler and its options.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path

from mechcore.cache import cached_file, digest, is_cached
from mechcore.errors import Fault, MechanismError

COMPILER_OPTIONS = (
    "-O2",
    "-fno-math-errno",
    "-ffp-contract=off",
    "-fPIC",
    "-shared",
)  # none makes results depend on the machine
LONGEST_COMPILATION = 300.0  # [s] that the compiler may take
LIBRARY_SUFFIX = ".so"
MOST_LIBRARIES = 256  # libraries that stay loaded under their source


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


@lru_cache(MOST_LIBRARIES)
def library(source: str) -> ctypes.CDLL:
    """A library compiled from C, from the cache where it is there. Raises `MechanismError` where that fails."""
    command = required_compiler()
    try:
        with cached_file(_identity(command, source), LIBRARY_SUFFIX, lambda path: _compile(command, source, path)) as path:
            return ctypes.CDLL(str(path))
    except OSError as error:
        why = f"the compiled program cannot be made or loaded: {error}."
        raise MechanismError(Fault("executor", why, "Choose the executor numpy.")) from error


def cached(source: str) -> bool:
    """Whether a library is in the cache, so that nothing has to be compiled."""
    command = compiler()
    return command is not None and is_cached(_identity(command, source), LIBRARY_SUFFIX)


def _identity(command: tuple[str, ...], source: str) -> str:
    """A digest of all that a library depends on; of the compiler its file (for ziglang that of the package), size and modification
    time."""
    package = find_spec(command[2]) if len(command) > 2 else None
    real = os.path.realpath(command[0] if package is None or package.origin is None else package.origin)
    state = os.stat(real)
    parts = (*command[1:], real, state.st_size, state.st_mtime_ns, *COMPILER_OPTIONS, sys.platform, source)
    return digest("\0".join(map(str, parts)).encode())


def _compile(command: tuple[str, ...], source: str, path: Path) -> None:
    """Compile into a file. Raises `MechanismError` where that fails."""
    try:
        ran = subprocess.run(
            [*command, *COMPILER_OPTIONS, "-x", "c", "-", "-o", str(path), "-lm"],
            input=source, capture_output=True, text=True, timeout=LONGEST_COMPILATION, check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as error:
        why = f"the C compiler cannot be used: {error}."
        raise MechanismError(Fault("executor", why, "Choose the executor numpy.")) from error
    if ran.returncode:
        first = next((line for line in ran.stderr.splitlines() if "error" in line), ran.stderr[:200])
        raise MechanismError(Fault("executor", f"the C compiler fails: {first.strip()}.", "Choose the executor numpy."))
