"""Sweeps: studies of many designs whose results are stored as they are computed, so that an interrupted study can be resumed."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import suppress
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Flags, Index, Real
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechviz.files import OutputError, put_in_place, replacing, try_lock
from mechviz.runs import package_version
from mechviz.studies.designs.evaluate import DesignResults, Study, evaluate
from mechviz.studies.designs.sampling import Sample

if TYPE_CHECKING:
    import pyarrow as pa

LARGEST_CHUNK = 8192, 512, 8  # designs per portion: in C; in batches by numpy; run singly
FLUSH_SECONDS = 2.0  # [s] between writes of parts
REASON = "reason"
"""Name of the column with the reasons why a design has no values."""


@dataclass(frozen=True, eq=False)
class DesignTable:
    """A study with its designs (D, n) and their results: numbers (D,) or curves (D, F) of each measure."""

    study: Study
    designs: Real
    results: DesignResults

    @property
    def feasible(self) -> Flags:
        """Whether there are values (D,)."""
        return np.array([not reason for reason in self.results.reasons], bool)


def parts_of(path: Path) -> Path:
    """The folder with the parts of an unfinished study that will be written to ``path``."""
    return path.with_name(path.name + ".parts")


@dataclass
class Store:
    """Storage of the results of a study: parts in a folder next to the file into which they will be joined.

    A part is written completely or not at all, so that a study may be killed at any time. From `open` to `close` this store holds
    an exclusive lock on the folder. ``about``: header of the files; ``done``: numbers of the designs that are stored; ``written``:
    number of the next part.
    """

    path: Path
    about: dict[str, str]
    done: set[int] = field(default_factory=set)
    written: int = 0
    held: int | None = None  # descriptor of the folder

    @property
    def folder(self) -> Path:
        return parts_of(self.path)

    def open(self, *, fresh: bool = False) -> None:
        """Lock the folder, and find the designs that earlier runs of the same study have stored; ``fresh``: delete these instead.
        Raises `MechanismError` where the files belong to another study, `OutputError` where another process holds the lock."""
        import pyarrow.parquet as pq

        self.folder.mkdir(exist_ok=True)
        self.held = os.open(self.folder, os.O_RDONLY | os.O_CLOEXEC)
        if not try_lock(self.held, self.folder):
            os.close(self.held)
            self.held = None
            raise OutputError(f"'{self.path}' is being written by another sweep.", "Wait for it, or write to another file.", 1)
        if fresh:
            for part in self.folder.iterdir():
                part.unlink()
            self.path.unlink(missing_ok=True)
        if self.path.exists():
            self._check(dict(pq.read_schema(self.path).metadata or {}))
            self.done.update(pq.read_table(self.path, columns=["design"])["design"].to_pylist())
        for part in sorted(self.folder.glob("[0-9]*.parquet")):
            read = pq.ParquetFile(part)
            self._check(dict(read.schema_arrow.metadata or {}))
            self.done.update(read.read(columns=["design"])["design"].to_pylist())
            self.written = max(self.written, int(part.stem) + 1)

    def close(self) -> None:
        """Release the lock. Removes the folder if it is empty."""
        if self.held is not None:
            if try_lock(self.held, self.folder):
                with suppress(OSError):
                    self.folder.rmdir()
            os.close(self.held)
            self.held = None

    def _check(self, metadata: dict[bytes, bytes]) -> None:
        for key, value in self.about.items():
            if metadata.get(key.encode()) != value.encode():
                what = {"mechviz.study": "another study", "mechviz.scene_toml": "a study of another scene"}.get(
                    key, "another version"
                )
                remedy = "Give another name, or --fresh to begin anew."
                raise MechanismError(Fault("--output", f"'{self.path}' holds what {what} has found.", remedy))

    def write(self, table: pa.Table) -> None:
        """Write the rows of some designs as a part."""
        import pyarrow.parquet as pq

        self.folder.mkdir(exist_ok=True)
        temporary = self.folder / f".{self.written:06d}"
        pq.write_table(table.replace_schema_metadata(self.about), temporary)
        put_in_place(temporary, self.folder / f"{self.written:06d}.parquet")
        self.written += 1

    def finish(self) -> pa.Table:
        """Join the parts into the file of the study, in the order of the designs; returns its table."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        parts = [pq.read_table(part) for part in sorted(self.folder.glob("[0-9]*.parquet"))]
        if parts:
            whole = pa.concat_tables(parts).sort_by("design").replace_schema_metadata(self.about)
            with replacing(self.path) as temporary:
                pq.write_table(whole, temporary)
            shutil.rmtree(self.folder)
        return pq.read_table(self.path)


def about_study(study: Study, sample: Sample | None) -> dict[str, str]:
    """Header of a study's file: scene, variations and measures, sample with its seed, version of the program."""
    question = {
        "vary": [[v.name, v.unit, list(v.values), v.low, v.high, v.count] for v in study.variations],
        "of": [measure.text for measure in study.measures],
        "frames": study.frames,
        "cycles": study.cycles,
        "sample": None if sample is None else [sample.method, sample.count, sample.seed],
    }
    return {
        "mechviz.version": package_version(),
        "mechviz.scene": study.name,
        "mechviz.scene_toml": study.text,
        "mechviz.study": json.dumps(question, allow_nan=True),
    }


def measure_columns(study: Study) -> list[str]:
    """Column headings of the measures, with units."""
    columns = []
    for measure, quantity in zip(study.measures, study.quantities, strict=True):
        columns.append(f"{measure.text} [{quantity.unit}]")
    return columns


def arrow_table(study: Study, numbers: Index, designs: Real, results: DesignResults) -> pa.Table:
    """Rows of some designs: their numbers, parameters, results, and the reasons why there are none."""
    import pyarrow as pa

    columns: dict[str, pa.Array] = {"design": pa.array(numbers, pa.int64())}
    columns |= {v.title: pa.array(designs[:, k]) for k, v in enumerate(study.variations)}
    for title, values in zip(measure_columns(study), results.values, strict=True):
        flat = pa.array(np.ascontiguousarray(values).reshape(-1))
        one = values.ndim == 1
        columns[title] = flat if one else pa.FixedSizeListArray.from_arrays(flat, values.shape[1])
    columns[REASON] = pa.array([reason or None for reason in results.reasons], pa.string())
    return pa.table(columns)


def read_designs(study: Study, table: pa.Table) -> DesignTable:
    """The designs and results of a study, from the table of its file."""
    designs = np.column_stack([table[v.title].to_numpy() for v in study.variations])
    values = []
    for title in measure_columns(study):
        column = table[title].combine_chunks()
        flat = column.flatten() if hasattr(column, "flatten") and column.type.num_fields else column
        values.append(np.asarray(flat.to_numpy(zero_copy_only=False)).reshape(len(designs), -1))
    whole = tuple(v[:, 0] if v.shape[1] == 1 else v for v in values)
    return DesignTable(study, designs, DesignResults(whole, tuple(reason or "" for reason in table[REASON].to_pylist())))


def csv_lines(table: DesignTable) -> Iterator[str]:
    """A study as lines of CSV; a curve is one cell with numbers separated by blanks."""
    yield ",".join(f'"{title}"' for title in (*(v.title for v in table.study.variations), *measure_columns(table.study), REASON))
    for k, design in enumerate(table.designs):
        cells = [repr(float(x)) for x in design]
        cells += [" ".join(repr(float(x)) for x in np.atleast_1d(values[k])) for values in table.results.values]
        reason = table.results.reasons[k].replace('"', "'")
        yield ",".join([*cells, f'"{reason}"' if reason else ""])


def chunks(study: Study, count: int, done: set[int]) -> Iterator[Index]:
    """Numbers of the designs of each portion that is not entirely ``done``. The portions do not depend on ``done``, so that the
    results of a design are the same however often the study was interrupted."""
    size = LARGEST_CHUNK[0 if study.compiled else 1 if study.batch is not None else 2]
    for start in range(0, count, size):
        numbers = np.arange(start, min(start + size, count))
        if not done.issuperset(numbers.tolist()):
            yield numbers


def run_study(
    study: Study,
    designs: Real,
    store: Store | None = None,
    *,
    executor: Executor | None = None,
    most: int = 4,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> DesignTable:
    """Results of all designs (D, n), computed by an executor with up to ``most`` portions at a time, or in this process without
    one. A pool of local processes is not used where a C program computes the designs, as it has its own threads.

    With a ``store`` results survive interruptions. ``progress`` gets the number of designs that are done and their total.
    """
    count, known = len(designs), set() if store is None else set(store.done)
    rows: list[pa.Table] = []
    kept: list[pa.Table] = []
    finished, last = len(known), time.monotonic()
    progress(finished, count)

    def flush() -> None:
        nonlocal last
        if rows and store is not None:
            import pyarrow as pa

            store.write(pa.concat_tables(rows))
        elif store is None:
            kept.extend(rows)
        rows.clear()
        last = time.monotonic()

    try:
        pool = None if study.compiled and isinstance(executor, ProcessPoolExecutor) else executor
        for numbers, results in _computed(study, designs, chunks(study, count, known), pool, most):
            rows.append(arrow_table(study, numbers, designs[numbers], results))
            finished += len(numbers)
            progress(min(finished, count), count)
            if time.monotonic() - last > FLUSH_SECONDS:
                flush()
    finally:
        flush()
    import pyarrow as pa

    return read_designs(study, store.finish() if store is not None else pa.concat_tables(kept).sort_by("design"))


def _computed(
    study: Study, designs: Real, portions: Iterator[Index], executor: Executor | None, most: int
) -> Iterator[tuple[Index, DesignResults]]:
    """Numbers and results of the portions, in the order of completion."""
    if executor is None:
        for numbers in portions:
            yield numbers, evaluate(study, designs[numbers])
        return
    running: dict[Future[DesignResults], Index] = {}
    try:
        for numbers in portions:
            running[executor.submit(evaluate, study, designs[numbers])] = numbers
            if len(running) >= most:
                yield from _finished(running)
        while running:
            yield from _finished(running)
    finally:
        for future in running:
            future.cancel()


def _finished(running: dict[Future[DesignResults], Index]) -> Iterator[tuple[Index, DesignResults]]:
    done, _ = wait(running, return_when=FIRST_COMPLETED)
    for future in done:
        yield running.pop(future), future.result()
