"""Access to files: only regular files up to a stated size are read, and files are replaced as a whole or not at all. Errors state
the cause and a remedy."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

NOT_REGULAR = "it is not a regular file"
_UNSAFE = re.compile(r"[^\w .+-]")

LARGE_VARIABLE = "MECHVIZ_LARGE"
"""Environment variable that lifts limits of sizes (`mechviz.scene.limits`), as the option ``--large`` of the commands does."""


class OutputError(Exception):
    """A file could not be written or read: what happened (``message``) and what to do about it (``remedy``).

    ``code`` is the exit code of commands: 2 where the user has to change the request, 1 where the machine cannot fulfil it as it is
    now.
    """

    code = 2

    def __init__(self, message: str, remedy: str = "", code: int | None = None):
        self.message = message
        self.remedy = remedy
        if code is not None:
            self.code = code
        super().__init__(f"{message} {remedy}".strip())


def output_error(error: OSError, path: Path) -> OutputError:
    """The `OutputError` for an operating system error at a path."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return OutputError(f"'{path}' cannot be written: the disk is full.", "Free some space or write elsewhere.", 1)
    if error.errno == errno.EFBIG:
        return OutputError(
            f"'{path}' cannot be written: it would be larger than the limit for files.", "Raise the limit or use fewer frames.", 1
        )
    words = (error.strerror or str(error)).lower()
    return OutputError(f"'{path}' cannot be written: {words}.", "Choose another place.")


def plain_name(text: str, otherwise: str = "scene") -> str:
    """The name of a file from any text: no folders, not hidden, at most 100 characters; ``otherwise`` where nothing remains."""
    return _UNSAFE.sub("_", str(text).strip()).strip(" .")[:100] or otherwise


def open_regular(path: Path | str) -> BinaryIO:
    """A regular file, open for reading. Raises OSError, also for a folder, a device or a pipe, for which it never waits."""
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(errno.EINVAL, NOT_REGULAR, str(path))
    return os.fdopen(handle, "rb")


def read_regular(path: Path | str, most: int) -> bytes:
    """The content of a regular file of at most ``most`` bytes. Raises OSError, also for a larger file."""
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size > most:
            raise OSError(errno.EFBIG, f"it has {size / 1e6:.3g} MB, and at most {most / 1e6:.3g} MB are read", str(path))
        return file.read(most)


def check_target(path: Path) -> Path:
    """The real path of a file to be written. Raises `OutputError` where no file can be put there.

    Devices, pipes and folders are refused: a file that is renamed onto ``/dev/null`` would replace the device. A file that receives
    standard output or standard error is refused, too, since its lines would be lost.
    """
    real = Path(os.path.realpath(path))
    if real.is_dir():
        raise OutputError(f"'{path}' is a folder.", "Name a file in it.")
    if path.exists() and not path.is_file():  # not ``real``: a pipe, as /dev/stdout may be, has no real path
        why = f"'{path}' is not a regular file: what is written is made beside it, and takes its place when it is complete."
        raise OutputError(why, "Name a file that may be replaced, and pass that on.")
    if path.exists() and any(_is_open_as(number, path) for number in (1, 2)):
        raise OutputError(f"'{path}' takes what is printed, which would be lost.", "Name another file.")
    if not real.parent.exists() and path.is_symlink():
        raise OutputError(f"'{path}' is a link to '{real}', whose folder does not exist.", "Remove it, or write to another file.")
    if not real.parent.exists():
        raise OutputError(f"The folder '{path.parent}' does not exist.", "Create it, or write to another folder.")
    if not real.parent.is_dir():
        raise OutputError(f"'{path.parent}' is not a folder.", "Write to another folder.")
    if not os.access(real.parent, os.W_OK | os.X_OK):
        raise OutputError(f"The folder '{path.parent}' is not writable.", "Change its permissions, or write elsewhere.")
    return real


def _is_open_as(number: int, path: Path) -> bool:
    """Whether the file descriptor ``number`` is open on the file at a path."""
    try:
        return os.path.samestat(os.fstat(number), os.stat(path))
    except OSError:
        return False


def try_lock(handle: int, path: Path) -> bool:
    """Whether an exclusive lock on an open file or folder is obtained (until it is closed), and its path still leads to it."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        own, there = os.fstat(handle), os.lstat(path)
    except OSError:
        return False
    return os.path.samestat(own, there)


def put_in_place(temporary: Path, target: Path) -> None:
    """Rename a complete file onto its target, after its data are on the disk."""
    with open(temporary, "rb") as file:
        os.fsync(file.fileno())
    os.replace(temporary, target)
    with suppress(OSError):  # some file systems cannot sync folders
        folder = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary file next to ``path`` that takes its place if the block succeeds and vanishes if it does not."""
    target = check_target(path)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{target.stem}-", suffix=target.suffix, dir=target.parent)
        os.close(handle)
    except OSError as error:
        raise output_error(error, path) from None
    temporary = Path(name)
    try:
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)  # mkstemp allows access to the owner only
        yield temporary
        put_in_place(temporary, target)
    except OSError as error:
        raise output_error(error, path) from None
    finally:
        temporary.unlink(missing_ok=True)


def check_inputs(paths: Iterable[Path | None], inputs: Collection[Path]) -> None:
    """Raise `OutputError` where a file to be written is one of the ``inputs``, real paths of files that what is written is made
    from."""
    for path in paths:
        if path is not None and Path(os.path.realpath(path)) in inputs:
            raise OutputError(f"'{path}' is a file that the scene reads.", "Give another name.")


@contextmanager
def replacing_in(folder: Path, inputs: Collection[Path] = ()) -> Iterator[Path]:
    """A temporary folder whose files move to ``folder`` if the block succeeds; otherwise nothing there has changed. ``folder`` is
    created if need be. Raises `OutputError`, also where one of the ``inputs`` would be replaced (see `check_inputs`)."""
    try:
        missing = [place for place in (folder, *folder.parents) if not place.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=".files-", dir=folder))
    except OSError as error:
        words = (error.strerror or str(error)).lower()
        raise OutputError(f"The folder '{folder}' cannot be made or written: {words}.", "Choose another place.") from None
    try:
        yield temporary
        targets = {made: check_target(folder / made.name) for made in sorted(temporary.iterdir())}
        check_inputs(targets.values(), inputs)
        for made, target in targets.items():
            put_in_place(made, target)
    except OSError as error:
        raise output_error(error, folder) from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        with suppress(OSError):  # remove folders that were created in vain; those with files stay
            for place in missing:
                place.rmdir()
