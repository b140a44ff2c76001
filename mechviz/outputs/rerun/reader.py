"""Reads a recording back from its file alone, and checks it against the contract."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Integers, Real
from mechcore.motion.events import Event
from mechcore.records import dataclass
from mechviz.files import open_regular, plain_name
from mechviz.outputs.rerun.contract import Properties, faults_of, missing_tables, needed_tables, read_properties
from mechviz.outputs.rerun.entities import APPLICATION_ID, RecordingError, entity
from mechviz.outputs.rerun.rerun_adapter import FILE_MAGIC, DamageError, application_of, check_readable, chunks_in, entity_of
from mechviz.quantities.items import interpolate_table
from mechviz.scene.folder import SceneFolder
from mechviz.scene.scene import Scene, loads


def even_indices(total: int, most: int) -> Integers:
    """Indices of at most ``most`` of ``total`` frames, evenly spaced, including the first and the last."""
    return np.unique(np.round(np.linspace(0, total - 1, min(total, most))).astype(np.int64))


def is_recording(source: str) -> bool:
    """Whether a source names a recording, by its ending or by its content."""
    path = Path(source)
    if path.suffix.lower() == ".rrd":
        return True
    try:
        with open_regular(path) as file:
            return file.read(len(FILE_MAGIC)) == FILE_MAGIC
    except (OSError, ValueError):
        return False


def rows_at_or_before(batch: Any, times: Integers) -> Any:
    """The rows of an arrow batch that are valid at some times [ns], and the first row: a row is valid until the next one."""
    import pyarrow as pa

    own = ticks(batch["time"])
    if not len(own):
        return batch
    order = np.argsort(own, kind="stable")  # rerun may sort rows by a drive that runs backwards
    places = np.clip(np.searchsorted(own[order], times, side="right") - 1, 0, None)
    rows = np.unique(order[np.append(places, 0)])
    return batch if len(rows) == len(own) else batch.take(pa.array(rows))


def ticks(column: Any) -> Integers:
    """A time column as integers."""
    import pyarrow as pa

    counts: Integers = column.cast(pa.int64()).to_numpy(zero_copy_only=False)
    return counts


PROPERTIES_PATH = "/__properties/mechviz"
IN_FULL = ("/events", "/state/")  # paths of entities whose rows are not at frames
TABLE_PATHS = ("/data/", "/health/")  # paths of entities with a row at every frame
MOST_REPORTED = 8  # faults in a message
RECORD_AGAIN = "Record the scene again."
DRIVE_TIMELINES = ("drive_mdeg", "drive_um")


@dataclass(frozen=True, eq=False)
class ComponentRows:
    """Rows of one component of an entity, sorted by time. ``lengths`` (F,): number of instances in each row."""

    time: Integers  # [ns]
    drives: dict[str, Integers]  # drive_mdeg, drive_um
    values: NDArray[Any]  # the instances of all rows in sequence
    lengths: Integers


class Recording:
    """A mechviz recording in memory. Raises `RecordingError` if the file is missing, broken or not a recording of mechviz; the
    message lists the faults of its content, see `contract`. Of an interrupted, truncated or damaged recording, the complete frames
    before the end or the damage are read, and ``note`` says so.

    Entities are addressed by unescaped parts (``("data", "links", "crank", "pose")``) or by their path as rerun writes it.

    With ``most``, a longer recording is read at about so many frames only, evenly spaced over the run (and some more where blocks
    of the file begin), so that the whole recording need not fit into memory. Events and states are complete; ``frame_times`` (F,)
    [ns] are then the times of all frames, otherwise None.
    """

    parsed_properties: Properties  # checked, with JSON texts parsed

    def __init__(self, path: Path | str, *, most: int | None = None):
        self.path = Path(path)
        self.frame_times: Integers | None = None
        self._damage: DamageError | None = None
        self._missing = ""  # entities that are damaged, in a sentence
        self._moving: dict[str, list[Any]] = {}  # arrow batches of each entity, in the order of the file
        self._static: dict[str, list[Any]] = {}
        self._load(most)
        if PROPERTIES_PATH not in self._static:
            if self._damage is not None:
                raise self._damage
            application = application_of(self.path)
            if application == APPLICATION_ID:
                raise RecordingError(f"'{path}' holds no frames: it was interrupted before the first were whole.", RECORD_AGAIN)
            what = f"of the application '{application}'" if application else "of another program"
            raise RecordingError(f"'{path}' is a rerun recording {what}, not of mechviz.", "Give a file that mechviz recorded.")
        properties, faults = read_properties(self.properties)
        if properties is not None:
            self.parsed_properties = properties
            if self._damage is not None:
                self._leave_out_damaged()
            if self._damage is not None or not properties.complete:
                self._cut(_last_whole_time({path: self.times(path) for path in self._moving}))
                if missing := missing_tables(self):
                    if self._damage is not None:
                        raise self._nothing_left(missing)
                    raise RecordingError(f"'{path}' holds no frames: it was interrupted before the first were whole.", RECORD_AGAIN)
            faults = list(faults_of(self))
        if faults:
            more = f"; and {len(faults) - MOST_REPORTED} faults more" if len(faults) > MOST_REPORTED else ""
            raise RecordingError(f"'{path}' is damaged: {'; '.join(faults[:MOST_REPORTED])}{more}.", RECORD_AGAIN)

    def __repr__(self) -> str:
        return f"Recording {self.path.name}: {len(self.entities)} entities"

    def _load(self, most: int | None) -> None:
        import pyarrow as pa

        check_readable(self.path)
        if most is not None:
            self.frame_times = _times_of_frames(self._chunks(), most, lambda: self._damage)
        times = None if self.frame_times is None else self.frame_times[even_indices(len(self.frame_times), most or 1)]
        for batch in self._chunks():
            moving, name = "time" in batch.schema.names, entity_of(batch)
            known = (self._moving if moving else self._static).setdefault(name, [])
            if moving and times is not None and not name.startswith(IN_FULL):
                batch = rows_at_or_before(batch, times)
                if known and known[-1].schema.equals(batch.schema):  # small batches take more memory than their content
                    batch = pa.concat_batches([known.pop(), batch])
            known.append(batch)

    def _chunks(self) -> Iterator[Any]:
        """The undamaged chunks."""
        try:
            yield from chunks_in(self.path)
        except DamageError as error:
            self._damage = error

    @property
    def note(self) -> str:
        """A sentence on the missing part of the recording; empty if it is complete."""
        if self._damage is not None:
            frames = len(self.times("data", "links", self.parsed_properties.model.frame, "pose"))
            total = self.parsed_properties.frames
            here = "" if frames == total else f" Only the first {frames} of {total} frames are here."
            return f"{self._damage.message}{here}{self._missing}"
        return "" if self.parsed_properties.complete else "It was interrupted: the frames up to then are here."

    def _nothing_left(self, missing: list[str]) -> RecordingError:
        assert self._damage is not None
        why = (
            f"{self._damage.message} Of {', '.join(missing[:MOST_REPORTED])} no frame is left, without which nothing can be shown."
        )
        return RecordingError(why, self._damage.remedy)

    def _leave_out_damaged(self) -> None:
        lost = _spare(self.parsed_properties, self.has("data", "energy"), self._damage)
        for path in lost:
            self._moving.pop(path, None)
            self._static.pop(path, None)
        properties = self.parsed_properties
        picture = properties.picture and tuple(node for node in properties.picture if node.entity not in lost)
        quantities = tuple(entry for entry in properties.quantities if entry.entity not in lost)
        self.parsed_properties = properties.model_copy(update={"picture": picture, "quantities": quantities})
        if lost:
            more = f" and {len(lost) - MOST_REPORTED} others" if len(lost) > MOST_REPORTED else ""
            self._missing = f" Missing: {', '.join(sorted(lost)[:MOST_REPORTED])}{more}."

    def _cut(self, last: int) -> None:
        """Drop the rows after a time [ns], except for events and states."""
        import pyarrow as pa

        for path, batches in self._moving.items():
            if not path.startswith(IN_FULL):
                batches[:] = [batch.filter(pa.array(ticks(batch["time"]) <= last)) for batch in batches]

    # -- what is there ------------------------------------------------------------------------------------------------
    @property
    def entities(self) -> tuple[str, ...]:
        """Paths of all entities, as rerun writes them, sorted."""
        return tuple(sorted({*self._moving, *self._static}))

    def has(self, *parts: str) -> bool:
        """Whether an entity has rows over time."""
        return any(len(batch) for batch in self._moving.get(_path(parts), ()))

    def times(self, *parts: str) -> Integers:
        """The times [ns] of all rows of an entity, sorted."""
        pieces = [ticks(batch["time"]) for batch in self._moving.get(_path(parts), ())]
        return np.sort(np.concatenate(pieces)) if pieces else np.zeros(0, np.int64)

    def batches(self, path: str) -> Iterator[tuple[Any, bool]]:
        """The arrow batches of an entity, each with a flag: True for rows over time, False for static ones."""
        yield from ((batch, True) for batch in self._moving.get(path, ()))
        yield from ((batch, False) for batch in self._static.get(path, ()))

    @cached_property
    def properties(self) -> dict[str, Any]:
        """The recording's properties as plain values and lists of strings."""
        return _plain_properties(self._static[PROPERTIES_PATH])

    @cached_property
    def model(self) -> dict[str, Any]:
        """Links, joints, drives and loads: the connectivity."""
        model: dict[str, Any] = json.loads(self.properties["model"])
        return model

    @property
    def scene_text(self) -> str:
        """The scene file that made the recording (TOML)."""
        return str(self._document("scene"))

    def scene(self) -> Scene:
        """The scene that made the recording, with the files to which it refers. Raises `SceneError`, `RecordingError`."""
        if not self.scene_text:
            raise RecordingError(f"'{self.path}' does not hold its scene.{' ' * bool(self.note)}{self.note}", RECORD_AGAIN)
        folder = SceneFolder(self.path.resolve().parent, dict(self.parsed_properties.files), foreign=True)
        return loads(self.scene_text, plain_name(self.parsed_properties.scene or self.path.stem), folder)

    @property
    def notes(self) -> str:
        """The notes of the run as markdown: stages computed and left out, and more."""
        return str(self._document("notes"))

    def _document(self, name: str) -> Any:
        value = self.static(name, component="TextDocument:text")
        return "" if value is None or not len(value) else value[0]

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """The event log, sorted by time."""
        if not self.has("events"):
            return ()
        level, line = (self.rows("events", component=f"TextLog:{name}") for name in ("level", "text"))
        try:
            parts = [self.rows("events", component=name).values for name in ("item", "message")]
        except KeyError:  # recording of an older version, with lines only
            words = [str(x).partition(": ") for x in line.values]
            parts = [np.array([w[0] for w in words]), np.array([w[2].rpartition(" (t = ")[0] for w in words])]
        return tuple(
            Event(1e-9 * int(t), "WARN" if lv == "WARN" else "INFO", str(item), str(text))
            for t, lv, item, text in zip(line.time, level.values, *parts, strict=True)
        )

    # -- values -------------------------------------------------------------------------------------------------------
    def scalars(self, *parts: str) -> tuple[Integers, Real]:
        """Times (F,) [ns] and float64 values (F, n) of an entity of scalars."""
        rows = self.rows(*parts, component="Scalars:scalars")
        return rows.time, np.asarray(rows.values, float).reshape(len(rows.time), -1)

    def at(self, times: Any, *parts: str) -> Real:
        """Values (n, m) of an entity of scalars at any times (n,) [s], interpolated between the frames by the method that the
        recording states, with the recorded derivatives as slopes. Raises KeyError if there are none."""

        def values(path: tuple[str, ...]) -> Real | None:
            return self.scalars(*path)[1] if self.has(*path) else None

        time = np.asarray(1e-9 * self.rows(*parts, component="Scalars:scalars").time, float)
        return interpolate_table(parts, time, values, np.atleast_1d(times), self.parsed_properties.interpolation)

    def rows(self, *parts: str, component: str) -> ComponentRows:
        """All rows of a component such as ``Transform3D:translation``; raises KeyError if there are none."""
        import pyarrow as pa

        path = _path(parts)
        batches = [b for b in self._moving.get(path, ()) if component in b.schema.names]
        if not batches:
            raise KeyError(f"{path} has no {component}")
        time = np.concatenate([ticks(b["time"]) for b in batches])
        columns = pa.chunked_array([b[component] for b in batches])
        order: Any = slice(None)
        if (time[1:] < time[:-1]).any():  # rare: chunks are written in the order of time
            order = np.argsort(time, kind="stable")
            columns = columns.take(pa.array(order))
        flat = columns.combine_chunks()
        lengths = np.diff(np.asarray(flat.offsets)) if len(flat) else np.zeros(0, np.int64)
        drives = {
            name: np.concatenate([ticks(b[name]) for b in batches])[order]
            for name in DRIVE_TIMELINES
            if all(name in b.schema.names for b in batches)
        }
        return ComponentRows(time=time[order], drives=drives, values=_numpy(flat.flatten()), lengths=lengths)

    def static(self, *parts: str, component: str = "Scalars:scalars") -> NDArray[Any] | None:
        """The last static value of a component, or None."""
        batches = [b for b in self._static.get(_path(parts), ()) if component in b.schema.names]
        return _numpy(batches[-1][component].flatten()) if batches else None


def _path(parts: tuple[str, ...]) -> str:
    if len(parts) == 1 and parts[0].startswith("/"):
        return parts[0]
    return entity(*parts)


def _times_of_frames(chunks: Iterator[Any], most: int, damage: Callable[[], DamageError | None]) -> Integers | None:
    """The times of all complete frames [ns]; None if there are at most ``most``. ``damage()``: the damage found in the chunks."""
    counted: dict[str, list[Integers]] = {}
    batches = []
    for batch in chunks:
        name = entity_of(batch)
        if name == PROPERTIES_PATH:
            batches.append(batch)
        elif "time" in batch.schema.names and name.startswith(TABLE_PATHS):
            counted.setdefault(name, []).append(ticks(batch["time"]))
    properties, _ = read_properties(_plain_properties(batches))
    if properties is None or properties.frames <= most:
        return None
    times = {name: np.sort(np.concatenate(parts)) for name, parts in counted.items()}
    frames = times.get(entity("data", "links", properties.model.frame, "pose"), np.zeros(0, np.int64))
    fault = damage()
    if fault is not None or not properties.complete:
        spare = _spare(properties, entity("data", "energy") in times, fault)
        frames = frames[frames <= _last_whole_time({name: own for name, own in times.items() if name not in spare})]
    return frames if len(frames) > most else None


def _spare(properties: Properties, forces: bool, damage: DamageError | None) -> set[str]:
    """Damaged entities that can be left out: those without which nothing can be shown are not among them."""
    lost: set[str] = (damage.lost if damage is not None else None) or set()
    return lost - needed_tables(properties.model, forces) - {PROPERTIES_PATH}


def _last_whole_time(times: dict[str, Integers]) -> int:
    """The time [ns] up to which all tables are complete; ``times``: sorted times [ns] of the rows, by entity. -1 if none."""
    tables = [own for path, own in times.items() if path.startswith(TABLE_PATHS)]
    every = max(tables, key=len, default=np.zeros(0, np.int64))
    for own in tables:
        same = min(len(own), len(every))
        different = np.flatnonzero(own[:same] != every[:same])
        every = every[: different[0] if len(different) else same]
    return int(every[-1]) if len(every) else -1


def _plain_properties(batches: list[Any]) -> dict[str, Any]:
    properties: dict[str, Any] = {}
    for batch in batches:
        for name in batch.schema.names:
            if not name.startswith("rerun") and len(batch):
                properties[name.split(":")[-1].split(".")[-1]] = batch[name].to_pylist()[-1]
    lists = ("effects", "skipped", "power_items")
    return {k: list(v or []) if k in lists else v[0] if isinstance(v, list) and v else v for k, v in properties.items()}


def _numpy(values: Any) -> NDArray[Any]:
    """Arrow values as an array: vectors as rows, line strips as objects."""
    import pyarrow as pa

    if pa.types.is_fixed_size_list(values.type):
        return _numpy(values.flatten()).reshape(-1, values.type.list_size)
    if pa.types.is_list(values.type):
        points, lengths = _numpy(values.flatten()), values.value_lengths().to_numpy(zero_copy_only=False)
        strips = np.empty(len(values), object)
        for k, end in enumerate(np.cumsum(lengths)):
            strips[k] = points[end - lengths[k] : end]
        return strips
    plain = np.asarray(values.to_numpy(zero_copy_only=False))
    if plain.dtype == np.float16:  # in a damaged file: the limits of the contract exceed the range of float16
        plain = plain.astype(np.float32)
    if plain.dtype.kind == "f" and (unknown := np.isnan(plain)).any():
        return np.where(unknown, plain.dtype.type(np.nan), plain)  # signalling NaN of a damaged file: numpy would warn
    return plain
