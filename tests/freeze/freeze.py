"""What must not change while the house is rebuilt: results of the program, written by one version and compared with another's.

    python tests/freeze/freeze.py write before     # in a checkout of the old version
    python tests/freeze/freeze.py write after      # in the new one
    python tests/freeze/freeze.py compare before after

Written are, for every gallery scene: the rows of its recording, what `check` and `plan` print, and its exported tables; further the
JSON Schema, the reports of faults over the mutation tests, and the outcomes of the hard cases.
"""

from __future__ import annotations

import importlib
import pickle
import random
import re
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

TESTS = Path(__file__).resolve().parent.parent
MUTATIONS = 480  # as in test_scene_mutations
TOLERANCE = 1e-12  # of the largest value of a column
TIMES = re.compile(r"[\d.]+ ?(s|ms|us|µs)\b")  # what differs from run to run


def command(*arguments: str) -> tuple[int, str]:
    """Exit code and output of ``mechviz`` with arguments, in this process."""
    from typer.testing import CliRunner

    try:
        home = importlib.import_module("mechviz.commands.main")
    except ModuleNotFoundError:
        home = importlib.import_module("mechviz.commands.main")
    result = CliRunner().invoke(home.app, list(arguments))
    return result.exit_code, result.output


def rows(path: Path) -> Iterator[tuple[str, Any]]:
    """Columns of a recording by entity and component: arrays of numbers, or texts."""
    from rerun.chunk import RrdReader

    columns: dict[str, list[Any]] = {}
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            if name.endswith((":start_time", "wall_seconds")):
                continue
            if "row_id" not in name.lower() and "RowId" not in name and name not in ("log_time", "log_tick"):
                columns.setdefault(f"{chunk.entity_path} {name}", []).append(column)
    for name, parts in columns.items():
        values = [v for part in parts for v in _flat(part)]
        if values and all(v.dtype.kind in "fiub" for v in values):
            yield name, np.concatenate(values).astype(float)
        else:
            digits = re.compile(r"[\d.e+-]+") if name.startswith("/notes") else TIMES  # notes state durations
            yield name, digits.sub("", repr([v.tolist() for v in values]))


def _flat(column: Any) -> Iterator[Any]:
    """The leaves of an arrow column."""
    import pyarrow as pa

    while isinstance(column, pa.ListArray | pa.LargeListArray | pa.FixedSizeListArray):
        column = column.flatten()
    if isinstance(column, pa.StructArray | pa.UnionArray):
        for k in range(column.type.num_fields):
            yield from _flat(column.field(k))
    elif pa.types.is_temporal(column.type):
        yield column.cast(pa.int64()).to_numpy(zero_copy_only=False)
    else:
        yield column.to_numpy(zero_copy_only=False)


def scene(name: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    with TemporaryDirectory() as folder:
        for what in (["check", name, "--equations", "--modes"], ["check", name], ["plan", name]):
            code, out = command(*what)
            found[" ".join(what)] = f"{code} {TIMES.sub('', out)}".replace(folder, "")
        file, csv = Path(folder, "a.rrd"), Path(folder, "a.csv")
        command("record", name, "-o", str(file))
        if file.exists():
            found.update({f"{name} {k}": v for k, v in rows(file)})
        command("export", name, "--csv", str(csv))
        for part in sorted(Path(folder).glob("*.csv")):
            found[f"{name} {part.name}"] = part.read_text()
    return found


def faults(part: int) -> dict[str, str]:
    sys.path[:0] = [str(p.parent) for p in TESTS.rglob("test_scene_mutations.py")]
    import test_scene_mutations as mutations

    from mechviz.scene.faults import SceneError
    from mechviz.scene.scene import Scene

    found = {}
    for seed in range(60 * part, 60 * part + 60):
        rng = random.Random(seed)
        raw = mutations.spoilt(rng, rng.choice(mutations.SCENES))
        try:
            Scene.build(**raw) if all(isinstance(k, str) for k in raw) else None
            found[f"mutation {seed}"] = "a scene"
        except SceneError as error:
            found[f"mutation {seed}"] = str(error)
        except TypeError as error:
            found[f"mutation {seed}"] = repr(error)
    return found


def write(folder: Path) -> None:
    import mechviz

    folder.mkdir(parents=True, exist_ok=True)
    names = [entry.name for entry in mechviz.gallery()]
    with ProcessPoolExecutor(2) as pool:
        for k, found in enumerate(pool.map(scene, names)):
            (folder / f"scene-{names[k]}.pickle").write_bytes(pickle.dumps(found))
            print(f"\r{k + 1} of {len(names)} scenes", end="", file=sys.stderr)
        all_faults = {k: v for part in pool.map(faults, range(MUTATIONS // 60)) for k, v in part.items()}
    (folder / "faults.pickle").write_bytes(pickle.dumps(all_faults))
    rest = {"schema": command("schema")[1], "hard": TIMES.sub("", command("hard")[1])}
    (folder / "rest.pickle").write_bytes(pickle.dumps(rest))


def compare(a: Path, b: Path) -> int:
    """Print what differs; the number of differences."""
    count = 0
    for name in sorted({p.name for p in (*a.iterdir(), *b.iterdir())}):
        if not ((a / name).exists() and (b / name).exists()):
            print(f"{name}: only in one")
            count += 1
            continue
        left, right = (pickle.loads((x / name).read_bytes()) for x in (a, b))
        for key in sorted({*left, *right}):
            why = _difference(left.get(key), right.get(key))
            if why:
                print(f"{name} {key}: {why}")
                count += 1
    print(f"{count} differences")
    return count


def _difference(x: Any, y: Any) -> str:
    if type(x) is not type(y):
        return f"{type(x).__name__} against {type(y).__name__}"
    if isinstance(x, np.ndarray):
        if x.shape != y.shape:
            return f"{x.shape} against {y.shape}"
        with np.errstate(invalid="ignore"):
            far = np.abs(x - y) > TOLERANCE * max(float(np.nanmax(np.abs(x), initial=0.0)), 1e-300)
        return f"off by {np.nanmax(np.abs(x - y)):.3g}" if far.any() or (np.isnan(x) != np.isnan(y)).any() else ""
    if x == y:
        return ""
    lines = zip(str(x).split("\n"), str(y).split("\n"), strict=False)
    return next((f"{p[:300]!r} against {q[:300]!r}" for p, q in lines if p != q), "length")


if __name__ == "__main__":
    if sys.argv[1] == "write":
        write(Path(sys.argv[2]))
    else:
        sys.exit(min(compare(Path(sys.argv[2]), Path(sys.argv[3])), 1))
