"""Commands that write, on a disk that fills up after any number of bytes: each ends with a message and leaves nothing behind.

    OPENBLAS_NUM_THREADS=1 python tests/torture/full_disk.py --count 300

Files are limited by the system (RLIMIT_FSIZE); as root, every third time a small file system in memory is full instead.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from budget import Tally, options
from forked import command, faults, forked, load_all

WRITERS = (
    ("record", "crank-rocker", "--frames", "60", "-o", "a.rrd"),
    ("share", "crank-rocker", "--frames", "24", "-o", "a.html"),
    ("shot", "crank-rocker", "--frames", "24", "-o", "a.svg"),
    ("export", "crank-rocker", "--frames", "60", "--csv", "a.csv"),
    ("export", "crank-rocker", "--frames", "60", "--parquet", "a.parquet"),
    ("export", "crank-rocker", "--frames", "24", "--glb", "a.glb"),
    ("export", "crank-rocker", "--frames", "24", "--stl", "solids"),
    ("export", "crank-rocker", "--frames", "24", "--3mf", "a.3mf"),
    ("export", "cam-flat", "--frames", "24", "--dxf", "a.dxf"),
)


@contextmanager
def room(folder: Path, size: int | None) -> Iterator[None]:
    """A folder on a file system of its own, of so many bytes, where that is wanted."""
    if size is None:
        yield
        return
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def can_mount() -> bool:
    """Whether small file systems can be had here."""
    with tempfile.TemporaryDirectory() as name:
        tried = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", name], capture_output=True, check=False)
        return tried.returncode == 0 and subprocess.run(["umount", name], check=False).returncode == 0


def main() -> int:
    """Fills disks; gives 1 where there were faults."""
    given = options(__doc__, 300).parse_args()
    load_all()
    mounts = os.geteuid() == 0 and can_mount()
    tally, full = Tally(given.count, given.seconds), 0
    sizes: dict[tuple[str, ...], int] = {}
    with tempfile.TemporaryDirectory() as name:
        folder, said = Path(name) / "disk", Path(name) / "said"
        folder.mkdir()
        os.chdir(folder)
        for seed in tally.cases(given.first):
            rng = random.Random(seed)
            words = WRITERS[seed % len(WRITERS)]
            if words not in sizes:  # how much it writes where there is room
                told = faults(forked(command(*words), said), (0,))
                sizes[words] = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
            else:
                limit = int(sizes[words] * rng.random())
                mounted = mounts and seed % 3 == 0
                os.chdir(name)
                with room(folder, max(limit // 4096, 1) * 4096 if mounted else None):
                    os.chdir(folder)
                    ended = forked(command(*words, largest_file=None if mounted else limit), said)
                    left = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
                    os.chdir(name)
                os.chdir(folder)
                full += ended.code != 0
                told = faults(ended, (0, 1, 2))
                if ended.code and left and not words[-1].startswith("solids"):
                    told = told or f"{left} are left at {limit} of {sizes[words]} bytes: {ended.text[-200:]!r}"
            for path in sorted(folder.rglob("*"), reverse=True):
                path.rmdir() if path.is_dir() else path.unlink()
            if told:
                tally.fault(f"seed {seed}, {' '.join(words)}: {told}")
        os.chdir("/")
    return tally.end(f"{full} commands found the disk full{', some on file systems in memory' if mounts else ''}")


if __name__ == "__main__":
    sys.exit(main())
