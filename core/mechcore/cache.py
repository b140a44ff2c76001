"""Files that are made once and kept in the user's cache: compiled programs, the atlas of coupler curves.

The cache is a folder of the user's alone. A file in it has its own checksum in its name, and is written under another one first,
so that neither a second process nor a power failure leaves a damaged one that is used.
"""

from __future__ import annotations

import hashlib
import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

DIGEST_LENGTH = 32  # of digests


def cache_folder() -> Path:
    """Where files are kept: ``mechviz`` in the user's cache folder."""
    stated = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(stated) if os.path.isabs(stated) else Path.home() / ".cache") / "mechviz"


def digest(data: bytes) -> str:
    """A digest of what a file is made of, or of the file."""
    return hashlib.sha256(data).hexdigest()[:DIGEST_LENGTH]


def is_cached(identity: str, ending: str) -> bool:
    """Whether an intact file is in the cache."""
    folder = cache_folder()
    return _owned(folder) and _is_intact(folder, identity, ending) is not None


@contextmanager
def cached_file(identity: str, ending: str, make: Callable[[Path], None]) -> Iterator[Path]:
    """The file of an identity (a `digest` of all that it depends on) and an ending such as ".so", which ``make`` writes where it is
    not there; in a temporary folder where the cache cannot be made or others could use it. Raises `OSError`."""
    with _folder() as folder:
        yield _is_intact(folder, identity, ending) or _made(folder, identity, ending, make)


@contextmanager
def _folder() -> Iterator[Path]:
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


def _is_intact(folder: Path, identity: str, ending: str) -> Path | None:
    """The file in a folder whose name is its own checksum; those of the same identity that are damaged go."""
    for path in folder.glob(f"{identity}-*{ending}"):
        with suppress(OSError):
            if path.stem == f"{identity}-{digest(path.read_bytes())}":
                return path
            path.unlink()
    return None


def _made(folder: Path, identity: str, ending: str, make: Callable[[Path], None]) -> Path:
    """Make the file, which then gets the name by which it is known."""
    handle, name = tempfile.mkstemp(prefix="making-", suffix=ending, dir=folder)
    os.close(handle)
    try:
        make(Path(name))
        path = folder / f"{identity}-{digest(Path(name).read_bytes())}{ending}"
        os.replace(name, path)
        return path
    finally:
        with suppress(OSError):
            os.remove(name)
