"""Solutions of a synthesis with their numbers and defects, as a table and as scene files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mechviz.files import OutputError, check_target
from mechviz.scene.scene import Scene, dump


@dataclass(frozen=True, eq=False)
class Solution:
    """A linkage as a scene, the numbers that tell it from others by their titles, and its defects in words, "" for none."""

    scene: Scene
    numbers: Mapping[str, str]
    defects: str = ""


def table(solutions: Sequence[Solution]) -> Iterator[str]:
    """Lines: number, numbers of the solution, defects."""
    rows = [["", *solutions[0].numbers, "defects"]] if solutions else []
    rows += [[str(k + 1), *one.numbers.values(), one.defects or "none"] for k, one in enumerate(solutions)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))] if rows else []
    for row in rows:
        cells = [word.rjust(width) for word, width in zip(row[:-1], widths[:-1], strict=True)]
        yield "  ".join([*cells, row[-1]])


def check_folder(target: Path) -> None:
    """Refuse, before anything is computed, a target that scenes cannot be written to. Raises `OutputError`."""
    if target.suffix == ".toml":
        check_target(target)
    elif target.exists() and not target.is_dir():
        raise OutputError(
            f"'{target}' is a file.", "Give a folder for all solutions, or a name that ends in .toml for the first one."
        )


def write(solutions: Sequence[Solution], target: Path) -> list[Path]:
    """Write the first solution to a file that ends in ``.toml``, or all of them to a folder; gives the files."""
    if target.suffix == ".toml":
        dump(solutions[0].scene, target)
        return [target]
    target.mkdir(parents=True, exist_ok=True)
    paths = [target / f"{one.scene.name}.toml" for one in solutions]
    for one, path in zip(solutions, paths, strict=True):
        dump(one.scene, path)
    return paths
