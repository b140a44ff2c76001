"""Everything that is used of rerun 0.41 beyond its public interface, and the reason for each.

* Messages of a file are read here (`chunks_in`), not by rerun. Its reader rejects a file that is truncated within a message, and
  terminates the process at some flipped bits. A file (RRF2) consists of a header and messages: kind and length, then a protobuf;
  each chunk in it is an Arrow stream compressed by LZ4.
* A blueprint is sent (`send_blueprint`) without the stream in memory that rerun's own function leaves behind, which refers to
itself:
  two threads and 2 MB per call.

The project pins rerun.
"""

from __future__ import annotations

import os
import struct
from bisect import bisect
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

from mechviz.files import open_regular
from mechviz.outputs.rerun.entities import APPLICATION_ID, RecordingError

FILE_MAGIC, VERSION_MAGIC = b"RRF", b"RRF2"
FILE_HEADER, MESSAGE_HEADER = 12, struct.Struct("<QQ")  # of a message: kind, length of its content [bytes]
FILE_TAIL = struct.Struct("<QQI8sI")  # after the last message: position and length of the index, checksum, magic, number of indices
TAIL_MAGIC, MAGIC_IN_TAIL = b"RRF2FOOT", slice(20, 28)
END_MESSAGE, STORE_MESSAGE, CHUNK_MESSAGE, LAYOUT_MESSAGE = range(4)  # kinds of messages
RECORDING_STORE, LZ4_COMPRESSION, ARROW_ENCODING = 1, 2, 1  # kind of a store, compression and encoding of a chunk
PAYLOAD_FIELD = 5  # the field of a chunk with its rows
LARGEST_COMPRESSION_RATIO = 255  # largest compression ratio of LZ4
INDEX_COLUMNS = ("time", "drive_mdeg", "drive_um")
REPAIR_REMEDY = "Record the scene again; what rerun can save of it is saved with: rerun rrd optimize FILE.rrd -o repaired.rrd"

Message = dict[int, Any]
"""A protobuf message: the last value of each field, a number or bytes."""


class DamageError(RecordingError):
    """A recording whose file is damaged at byte ``at``. The undamaged part has been read: everything except some chunks of the
    entities ``lost``; if that is None, because the file has no index, the part before the damage."""

    at: int = 0
    lost: set[str] | None = None


def chunks_in(path: Path) -> Iterator[Any]:
    """The chunks of the first recording in a file as arrow batches, in the order of the file. Raises `DamageError` for a damaged
    file, after all undamaged chunks."""
    damage: DamageError | None = None
    index: dict[int, str] = {}
    places: list[int] = []
    begun: list[int] = []  # positions of the messages that were read
    first: bytes | None = None
    at: int | None = FILE_HEADER
    while at is not None:
        try:
            for place, kind, data in _messages(path, at):
                begun.append(place)
                batch = None
                if _is_chunk(kind, data):
                    try:
                        message = fields(data)
                        store = fields(message[1])
                        if store[1] == RECORDING_STORE and store[2] == (first or store[2]):
                            batch = _batch(message)
                            first = store[2]
                    except (ValueError, LookupError, TypeError, OSError, NotImplementedError) as error:
                        raise _damage(path, place, (str(error).splitlines() or [type(error).__name__])[0][:200]) from None
                if batch is not None:
                    yield batch
            at = None
        except DamageError as error:
            if damage is None:
                damage, index = error, index_of(path)
                places = sorted(index)
                damage.lost = set() if index else None
            if damage.lost is not None and error.at in index:
                damage.lost.add(index[error.at])
            # After a message with a wrong length, the next header is read at a wrong position: reading resumes at the next chunk
            # of the index, which may be undamaged
            reached = error.at if error.at in index else max((place for place in begun if place in index), default=-1)
            next_one = bisect(places, reached)
            at = places[next_one] if next_one < len(places) else None
    if damage is not None:
        raise damage


def _is_chunk(kind: int, data: bytes) -> bool:
    """Whether a message contains a chunk, by its kind or, since that may be damaged, by its fields."""
    with suppress(ValueError):
        return kind == CHUNK_MESSAGE or PAYLOAD_FIELD in fields(data)
    return False


def _damage(path: Path, at: int, why: str) -> DamageError:
    error = DamageError(f"'{path}' is damaged at byte {at}: {why}.", REPAIR_REMEDY)
    error.at = at
    return error


def application_of(path: Path) -> str:
    """The application that wrote the first recording in a file; empty if not stated. Raises `RecordingError`."""
    for _, kind, data in _messages(path):
        try:
            store = fields(fields(fields(data)[2])[2]) if kind == STORE_MESSAGE else {}
            if store.get(1) == RECORDING_STORE:
                return str(bytes(fields(store[3])[1]), "utf-8", "replace")
        except (ValueError, LookupError, TypeError):
            return ""
    return ""


def check_readable(path: Path) -> None:
    """Raise `RecordingError` with the reason if a path is not a recording file."""
    if path.is_dir():
        raise RecordingError(f"'{path}' is a folder.", "Give the .rrd file in it.")
    try:
        with open_regular(path) as file:
            start = file.read(len(VERSION_MAGIC))
    except FileNotFoundError:
        raise RecordingError(f"There is no file '{path}'.", "Make one with: mechviz record SCENE -o FILE.rrd") from None
    except (OSError, ValueError) as error:
        why = f"'{path}' cannot be read: {(getattr(error, 'strerror', '') or str(error)).lower()}."
        raise RecordingError(why, "Give an .rrd file that mechviz recorded.") from None
    if not start.startswith(FILE_MAGIC):
        raise RecordingError(f"'{path}' is not a rerun recording.", "Give an .rrd file that mechviz recorded.")
    if start != VERSION_MAGIC:
        raise RecordingError(f"'{path}' has the format of an older rerun.", "Convert it with: rerun rrd migrate FILE.rrd")


def _messages(path: Path, at: int = FILE_HEADER) -> Iterator[tuple[int, int, bytes]]:
    """Position, kind and content of each complete message from position ``at``, up to the end of the recording or of the file.
    Raises `DamageError`."""
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        while (header := _header(file, at)) is not None:
            kind, length = header
            after = at + MESSAGE_HEADER.size + length
            if kind > LAYOUT_MESSAGE or (kind == END_MESSAGE and length and not _ends(file, after, size)):
                raise _damage(path, at, "it holds no message of a recording")
            if after > size and index_of(path):
                raise _damage(path, at, "a message is longer than the file")
            if kind == END_MESSAGE or after > size:
                return
            file.seek(at + MESSAGE_HEADER.size)
            yield at, kind, file.read(length)
            at = after


def _ends(file: BinaryIO, at: int, size: int) -> bool:
    """Whether a file of ``size`` bytes ends at a position, or has the tail of a recording there."""
    file.seek(at)
    return at + FILE_TAIL.size > size or file.read(FILE_TAIL.size)[MAGIC_IN_TAIL] == TAIL_MAGIC


def _header(file: BinaryIO, at: int) -> tuple[int, int] | None:
    file.seek(at)
    data = file.read(MESSAGE_HEADER.size)
    if len(data) < MESSAGE_HEADER.size:
        return None
    kind, length = MESSAGE_HEADER.unpack(data)
    return int(kind), int(length)


def index_of(path: Path) -> dict[int, str]:
    """The entity of each chunk by its position in the file, from the index at the end; empty if it cannot be read."""
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        file.seek(max(size - FILE_TAIL.size, 0))
        tail = file.read(FILE_TAIL.size)
        if len(tail) < FILE_TAIL.size or tail[MAGIC_IN_TAIL] != TAIL_MAGIC:
            return {}
        start, length, *_ = FILE_TAIL.unpack(tail)
        if start + length > size:
            return {}
        file.seek(start)
        data = file.read(length)
    places: dict[int, str] = {}
    try:
        for _, store in _pairs(data):  # the blueprint has an index of its own
            packed = fields(fields(store)[4])
            batch = _arrow(packed[2], packed.get(3) == LZ4_COMPRESSION, packed.get(4, 0))
            after, paths = (batch[f"chunk_{name}"].to_pylist() for name in ("byte_offset", "entity_path"))
            places |= {int(at) - MESSAGE_HEADER.size: str(path) for at, path in zip(after, paths, strict=True)}
    except (ValueError, LookupError, TypeError, OSError, NotImplementedError, OverflowError):
        return {}
    return places


def _arrow(packed: bytes, compressed: bool, size: int) -> Any:
    """The arrow batch in some bytes, of ``size`` after decompression, fully validated. Raises ValueError and other errors of the
    decoder if it is damaged."""
    import pyarrow as pa

    data = pa.py_buffer(packed)
    if compressed:
        if size > LARGEST_COMPRESSION_RATIO * data.size:
            raise ValueError("a chunk claims to be larger than it can be")
        data = pa.Codec("lz4_raw").decompress(data, size)
    batch = next(iter(pa.ipc.open_stream(data)), None)
    if batch is None:
        raise ValueError("a chunk is empty")
    batch.validate(full=True)
    return batch


def _batch(message: Message) -> Any:
    """The arrow batch of a chunk. Raises ValueError and other errors of the decoder if it is damaged."""
    import pyarrow as pa

    if message.get(4) != ARROW_ENCODING:
        raise ValueError("a chunk is not in Arrow's format")
    batch = _arrow(message[PAYLOAD_FIELD], message.get(2) == LZ4_COMPRESSION, message.get(3, 0))
    if b"rerun:entity_path" not in (batch.schema.metadata or {}):
        raise ValueError("a chunk does not say what it belongs to")
    entity_of(batch)  # raises if it is not text
    for name in INDEX_COLUMNS:
        if name in batch.schema.names:
            column = batch[name]
            if not (pa.types.is_duration(column.type) or pa.types.is_int64(column.type)) or column.null_count:
                raise ValueError(f"a chunk has rows without {name}")
    return batch


def entity_of(batch: Any) -> str:
    """The path of the entity of a chunk."""
    return str(batch.schema.metadata[b"rerun:entity_path"], "utf-8")


def fields(data: bytes) -> Message:
    """The fields of a protobuf message, the last value of repeated fields. Raises ValueError for other data."""
    return dict(_pairs(data))


def _pairs(data: bytes) -> Iterator[tuple[int, Any]]:
    """Number and value of each field of a protobuf message. Raises ValueError for other data."""
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        number, wire = key >> 3, key & 7
        if wire == 0:
            value, at = _varint(data, at)
            yield number, value
            continue
        if wire == 2:
            length, at = _varint(data, at)
        elif wire in (1, 5):
            length = 8 if wire == 1 else 4
        else:
            raise ValueError("a message cannot be read")
        if at + length > len(data):
            raise ValueError("a message ends too early")
        yield number, data[at : at + length]
        at += length


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(data):
            break
        byte, at = data[at], at + 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
    raise ValueError("a message cannot be read")


# -- blueprints -------------------------------------------------------------------------------------------------------
def send_blueprint(stream: Any, blueprint: Any) -> None:
    """Send a blueprint as the active one, not only as the default: the viewer keeps one blueprint per application, and that of
    another scene would not fit."""
    import rerun as rr
    import rerun_bindings as bindings

    native = bindings.new_blueprint(
        application_id=APPLICATION_ID, make_default=False, make_thread_default=False, default_enabled=True
    )
    made = rr.RecordingStream._from_native(native)
    made.set_time("blueprint", sequence=0)
    blueprint._log_to_stream(made)
    bindings.send_blueprint(made.memory_recording().storage, True, True, recording=stream.to_native())
    made.disconnect()  # from its recording in memory
