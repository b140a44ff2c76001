"""Entities of a recording: names, streams of rows over the frames, static archetypes; conversion of numbers to rerun's format."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Integers, Real, Single
from mechcore.records import dataclass
from mechviz.accuracy.fit import default_stride
from mechviz.files import OutputError
from mechviz.picture.proportions import about_z, in_space
from mechviz.quantities.items import ItemTable, joint_unit

if TYPE_CHECKING:
    from mechviz.runs import Run


APPLICATION_ID = "mechviz"


class RecordingError(OutputError):
    """A recording could not be written or read: ``message`` states what happened, ``remedy`` what to do."""

    @classmethod
    def of(cls, error: OutputError) -> RecordingError:
        return cls(error.message, error.remedy, error.code)


# -- names ------------------------------------------------------------------------------------------------------------
@lru_cache(maxsize=8192)
def entity(*parts: str) -> str:
    """An entity path from its unescaped parts."""
    import rerun as rr

    return str(rr.new_entity_path(list(parts)))


def parts_of(path: str) -> tuple[str, ...]:
    """The unescaped parts of an entity path."""
    parts, part, escaped = [], "", False
    for letter in path.removeprefix("/"):
        if escaped:
            part, escaped = part + letter, False
        elif letter == "\\":
            escaped = True
        elif letter == "/":
            parts.append(part)
            part = ""
        else:
            part += letter
    return (*parts, part)


def packed_colors(colors: Sequence[Sequence[int]]) -> NDArray[np.uint32]:
    """Colours of three or four channels, 0 to 255, each as one number 0xRRGGBBAA, which rerun converts faster than lists."""
    return np.array([int.from_bytes(bytes((*c, 255)[:4]), "big") for c in colors], np.uint32)


def unpacked(color: int) -> tuple[int, int, int]:
    """The channels of a colour, 0 to 255, from 0xRRGGBBAA."""
    return (int(color) >> 24) & 255, (int(color) >> 16) & 255, (int(color) >> 8) & 255


def line_strips(parts: Sequence[Single]) -> Any:
    """An arrow array of the strips (n, points, 3) of several items at n frames, ordered by frame."""
    import pyarrow as pa
    import rerun as rr

    frames = len(parts[0]) if parts else 0
    points = np.concatenate(parts, axis=1).reshape(-1, 3) if frames else np.zeros((0, 3), np.float32)
    offsets = np.concatenate([[0], np.cumsum(np.tile([p.shape[1] for p in parts], frames))]).astype(np.int32)
    kind = rr.components.LineStrip3DBatch([]).as_arrow_array().type
    flat = rr.components.Position3DBatch(np.ascontiguousarray(points)).as_arrow_array()
    return pa.ListArray.from_arrays(pa.array(offsets), flat, type=kind)


def archetype_columns(archetype: Any, counts: Integers | int = 1) -> list[Any]:
    """Columns of an archetype that contains the instances of all rows in sequence; ``counts``: instances per row, one number or
    (rows,).

    rerun's own ``columns`` makes them twice, first with one instance per row.
    """
    import rerun as rr

    columns = []
    for batch in archetype.as_component_batches():
        if isinstance(counts, int):
            offsets = _offsets(len(batch.as_arrow_array()), counts)
        else:
            offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        columns.append(rr.ComponentColumn(batch.component_descriptor(), batch, offsets=offsets))
    return columns


@lru_cache(maxsize=64)
def _offsets(instances: int, count: int) -> Any:
    """Offsets of rows of ``count`` instances each among all ``instances``, including the end, as an arrow array."""
    import pyarrow as pa

    return pa.array(np.arange(0, instances + 1, count, dtype=np.int32))


MOST_TICKS = 2.0**63  # limit of a timeline: ns, millidegrees or micrometres

SMALLEST_DRAWN = 0.05  # [m] size of a mechanism below which it is drawn enlarged


@dataclass(frozen=True)
class Stream:
    """An entity with one row per frame, or per ``every``-th frame. ``columns(frames)`` makes the rows of a slice of frames, which
    starts at a frame with a row and has a step of ``every`` or a multiple."""

    path: str
    columns: Callable[[slice], Any]
    every: int = 1


@dataclass(frozen=True)
class Static:
    """A static archetype of an entity."""

    path: str
    archetype: Any


@dataclass(frozen=True, eq=False)
class Timelines:
    """Integer times of the frames: nanoseconds, and milli-degrees or micrometres of the first rotary and sliding drive."""

    time: Integers  # [ns]
    drives: tuple[tuple[str, Integers], ...]

    @classmethod
    def of(cls, run: Run) -> Timelines:
        """The timelines of a run. Raises `RecordingError` for equal times [ns] of frames, and values beyond the range of a
        timeline."""
        motion = run.motion
        time = _integers(motion.time * 1e9)
        if np.any(np.diff(time) <= 0):
            words = f"The {len(time)} frames lie within {motion.time[-1] - motion.time[0]:.3g} s; a recording counts nanoseconds."
            raise RecordingError(words, "Check the speeds of the drives and the duration, or record fewer frames.")
        angles: dict[str, Integers] = {}
        for drive in motion.mechanism.drives:
            position = motion.coordinate(drive.joint)[:, 0]
            if joint_unit(motion, drive.joint) == "rad":
                angles.setdefault("drive_mdeg", _integers(np.degrees(position) * 1e3))
            else:
                angles.setdefault("drive_um", _integers(position * 1e6))
        return cls(time=time, drives=tuple(angles.items()))

    def columns(self, frames: slice) -> list[Any]:
        """Time columns of a slice of frames."""
        return self._columns(self.time[frames], [(name, ticks[frames]) for name, ticks in self.drives])

    def columns_at(self, times: Real) -> list[Any]:
        """Time columns of times [s] that need not be frames; the drives' positions are interpolated."""
        ns = _integers(times * 1e9)
        return self._columns(ns, [(name, _integers(np.interp(ns, self.time, ticks))) for name, ticks in self.drives])

    def _columns(self, ns: Integers, drives: list[tuple[str, Integers]]) -> list[Any]:
        import rerun as rr

        return [
            rr.TimeColumn("time", duration=ns.astype("timedelta64[ns]")),
            *(rr.TimeColumn(name, sequence=ticks) for name, ticks in drives),
        ]


def _integers(values: Real) -> Integers:
    """Rounded integers for a timeline. Raises `RecordingError` for values beyond its range, or NaN."""
    if np.size(values) and not np.max(np.abs(values)) < MOST_TICKS:
        words = "The run takes more time, or its drives go farther, than a recording can count (292 years, 2.5e13 turns, 9e12 m)."
        raise RecordingError(words, "Check the speeds and periods of the drives, or record fewer cycles.")
    return np.round(values).astype(np.int64)


def picture_stride(run: Run) -> int:
    """The stride of frames with arrows: as the accuracy states, by default 1 up to 720 frames per cycle of the first drive."""
    return run.resolved_accuracy.pictures or default_stride(run.motion)


def table_streams(all_tables: list[ItemTable], numbers: str | None = None) -> Iterator[Stream]:
    """Streams of the tables, as float64; with ``numbers`` "float32" rounded to float32, which compresses better."""
    for table in all_tables:
        yield Stream(entity(*table.path), partial(_rows_of_table, table, numbers))


def _rows_of_table(table: ItemTable, numbers: str | None, frames: slice) -> Any:
    values = table.values[frames]
    return scalar_rows(values.astype(np.float32).astype(float) if numbers == "float32" else values, slice(None))


def scalar_rows(values: Real, frames: slice) -> Any:
    """Rows of values (F, n)."""
    import pyarrow as pa
    import rerun as rr

    chosen = pa.array(np.ascontiguousarray(values[frames]).reshape(-1))  # otherwise rerun copies it
    return archetype_columns(rr.Scalars.from_fields(scalars=chosen), values.shape[1])


def link_streams(run: Run) -> Iterator[Stream]:
    """Streams of the poses of the links."""
    import rerun as rr

    poses = run.numbers.poses
    for link in poses:

        def place(frames: slice, link: str = link) -> Any:
            pose = poses[link][frames]
            return archetype_columns(
                rr.Transform3D.from_fields(translation=in_space(pose[:, :2], 0.0), quaternion=about_z(pose[:, 2]))
            )

        yield Stream(entity("mechanism", "links", link), place)


def magnification(size: float) -> float:
    """The factor by which a mechanism of this size [m] is enlarged: rerun's viewer draws nothing within 1 cm of its camera."""
    return 1.0 if size >= SMALLEST_DRAWN else float(10.0 ** np.ceil(np.log10(SMALLEST_DRAWN / size)))


def view_statics(size: float) -> Iterator[Static]:
    """View coordinates, and the scale of drawn entities for a small mechanism."""
    import rerun as rr

    yield Static("mechanism", rr.ViewCoordinates.RIGHT_HAND_Y_UP)
    enlarged = magnification(size)
    if enlarged != 1.0:  # data stay in metres; only the drawing is enlarged
        for root in ("mechanism", "vectors", "legend", "polygons"):
            yield Static(root, rr.Transform3D(scale=enlarged))
