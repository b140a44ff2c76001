"""Files that are made once and kept in the user's cache: compiled programs, the atlas of coupler curves.

The cache is a folder that only the user can access. The name of a file contains its checksum, and a file is first written under a
temporary name: a file that a second process or a power failure has damaged is never used.
"""

from __future__ import annotations

import hashlib
import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

DIGEST_LENGTH = 32  # hexadecimal digits of a digest


def cache_folder() -> Path:
    """The folder of the cache: ``mechviz`` in the user's cache folder."""
    stated = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(stated) if os.path.isabs(stated) else Path.home() / ".cache") / "mechviz"


def digest(data: bytes) -> str:
    """A digest of the data from which a file is made, or of the file itself."""
    return hashlib.sha256(data).hexdigest()[:DIGEST_LENGTH]


def is_cached(identity: str, ending: str) -> bool:
    """Whether an intact file is in the cache."""
    folder = cache_folder()
    return _owned(folder) and _intact_file(folder, identity, ending) is not None


@contextmanager
def cached_file(identity: str, ending: str, make: Callable[[Path], None]) -> Iterator[Path]:
    """The file of an identity (a `digest` of all that it depends on) and an ending such as ".so"; ``make`` writes it where the
    cache has none. It is in a temporary folder where the cache cannot be made or others could access it. Raises `OSError`."""
    with _folder() as folder:
        yield _intact_file(folder, identity, ending) or _made(folder, identity, ending, make)


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
    """Whether a folder is the user's own, can be written, and is closed to other users."""
    try:
        state = folder.lstat()
    except OSError:
        return False
    if not stat.S_ISDIR(state.st_mode) or not os.access(folder, os.W_OK | os.X_OK):
        return False
    return not hasattr(os, "getuid") or (state.st_uid == os.getuid() and not state.st_mode & 0o077)


def _intact_file(folder: Path, identity: str, ending: str) -> Path | None:
    """The file of an identity whose name has its checksum, None where there is none; damaged files of the identity are deleted."""
    for path in folder.glob(f"{identity}-*{ending}"):
        with suppress(OSError):
            if path.stem == f"{identity}-{digest(path.read_bytes())}":
                return path
            path.unlink()
    return None


def _made(folder: Path, identity: str, ending: str, make: Callable[[Path], None]) -> Path:
    """The file, made under a temporary name and then renamed to its identity and checksum."""
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
