"""Results as tables (CSV, Parquet) and links as solids (STL)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mechcore.arrays import Real
from mechcore.errors import Fault, MechanismError
from mechviz.files import OutputError, replacing
from mechviz.meshes.solids import Solids, stl_bytes
from mechviz.outputs.rerun.content import model_json, scene_text
from mechviz.picture.build import solids_of
from mechviz.quantities.between_frames import read_between
from mechviz.runs import Run, package_version

ExportError = OutputError

ROWS = 2000  # written at once
MOST_ROWS = 10_000_000


def wide_table(run: Run, times: Real | None = None) -> dict[str, Real]:
    """All results of a run as columns (F,) under names with units, such as ``crank.x [m]``; ``time [s]`` comes first.

    With ``times`` (n,) [s] the columns (n,) are read between the frames, by the interpolation that the run's accuracy states. What
    was not computed is left out.
    """
    at_frames = np.asarray(run.motion.time, float)
    columns: dict[str, Real] = {"time [s]": at_frames if times is None else np.asarray(times, float)}
    found = run.numbers.tables.values()
    for table in sorted(found, key=lambda t: t.path[:2] != ("data", "drive")):  # drives first, the rest as it comes
        rows = table.values
        if times is not None:
            rows = read_between(table.path, at_frames, lambda path: run.numbers.values(*path), times, run.accuracy.interpolation)
        for name, values in zip(table.headers(), rows.T, strict=True):
            while name in columns:  # a link may be named so that its columns look like a joint's
                name += "'"
            if not np.isnan(values).all():
                columns[name] = values
    return columns


def even_times(run: Run, step: float) -> Real:
    """Times (n,) [s] in steps from the start of a run to its end; raises `MechanismError` for a step that is none."""
    start, end = float(run.motion.time[0]), float(run.motion.time[-1])
    if not (np.isfinite(step) and step > 0.0 and (end - start) / step <= MOST_ROWS):
        remedy = f"Give a time above {(end - start) / MOST_ROWS:.3g} s: the run takes {end - start:.6g} s."
        raise MechanismError(Fault("every", f"{step:g} s is no distance of rows.", remedy))
    return np.asarray(start + step * np.arange(int(np.floor((end - start) / step * (1.0 + 1e-12))) + 1), float)


def export_csv(run: Run, path: Path | str, times: Real | None = None) -> Path:
    """Write all results as one table; every number in the shortest form that reads back bit for bit; ``times`` as there."""
    columns = wide_table(run, times)
    values = np.column_stack(list(columns.values()))
    with replacing(Path(path)) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        file.write(",".join(map(_quoted, columns)) + "\r\n")
        for start in range(0, len(values), ROWS):
            file.writelines(",".join(map(repr, row)) + "\r\n" for row in values[start : start + ROWS].tolist())
    return Path(path)


def export_parquet(run: Run, path: Path | str, times: Real | None = None) -> Path:
    """Write the same table as Parquet, with the scene, the connectivity and mechviz' version in the file's metadata."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table({name: pa.array(values) for name, values in wide_table(run, times).items()})
    about = {
        "mechviz.version": package_version(),
        "mechviz.scene": run.scene.name,
        "mechviz.scene_toml": scene_text(run),
        "mechviz.model": model_json(run),
    }
    with replacing(Path(path)) as temporary:
        pq.write_table(table.replace_schema_metadata(about), temporary)
    return Path(path)


def export_stl(run: Run, folder: Path | str, *, solids: Solids | None = None) -> list[Path]:
    """Write one binary STL per link, in millimetres and in the link's own frame, into a folder that is made if need be."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        words = (error.strerror or str(error)).lower()
        raise ExportError(f"The folder '{folder}' cannot be made: {words}.", "Choose another place.") from None
    written: list[Path] = []
    for name, solid in (solids or solids_of(run)).links.items():
        if not len(solid.faces):
            continue
        path = _free_name(folder, name, written)
        with replacing(path) as temporary:
            temporary.write_bytes(stl_bytes(solid))
        written.append(path)
    return written


def _free_name(folder: Path, link: str, taken: list[Path]) -> Path:
    """A file name for a link: without characters that file systems object to, and not used for another link already."""
    stem = re.sub(r"[^\w.\-]+", "_", link).strip(".") or "link"
    path, n = folder / f"{stem}.stl", 2
    while any(path.name.lower() == t.name.lower() for t in taken):
        path, n = folder / f"{stem}-{n}.stl", n + 1
    return path


def _quoted(name: str) -> str:
    """A CSV field, quoted where it has to be."""
    return '"' + name.replace('"', '""') + '"' if re.search(r'[",\r\n]', name) else name
