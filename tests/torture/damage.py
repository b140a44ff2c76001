"""Damaged recordings: a whole one with something taken away, garbled or made impossible, as a stranger's file may be."""

from __future__ import annotations

import json
import random
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
from rerun.chunk import Chunk, LazyChunkStream, RrdReader

from mechviz.outputs.images.drawing import write_svg
from mechviz.outputs.images.pictures import picture_time
from mechviz.outputs.inspection import format_inspection, inspect
from mechviz.outputs.page.page import make_page
from mechviz.outputs.presentation import presentation_in
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.viewer.build import view_model_of_recording

PROPERTIES = "/__properties/mechviz"
JUNK: tuple[Any, ...] = (None, -1, 0, 1e400, float("nan"), 10**30, "", "x", "../../evil", [], [1], {}, {"a": 1}, True)


def batches(path: Path) -> list[Any]:
    """The arrow batches of all chunks of a recording."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return [chunk.to_record_batch() for chunk in RrdReader(path).stream()]


def entity_of(batch: Any) -> str:
    """The path of the entity that a batch belongs to."""
    return str(batch.schema.metadata[b"rerun:entity_path"].decode())


def write(path: Path, items: list[Any]) -> Path:
    """Write batches as a recording."""
    chunks = [chunk for batch in items for chunk in Chunk.from_record_batch(batch)]
    LazyChunkStream.from_iter(iter(chunks)).write_rrd(path, application_id="mechviz", recording_id="damaged")
    return path


def damaged(whole: Path, target: Path, seed: int) -> str:
    """Write a damaged copy of a recording; says what was done. The same seed does the same."""
    rng = random.Random(seed)
    harm = rng.choice((_bytes, _cut, _column, _column, _column, _entity, _text, _text, _text))
    if harm in (_bytes, _cut):
        data = bytearray(whole.read_bytes())
        words = harm(rng, data)
        target.write_bytes(data)
        return str(words)
    rows = batches(whole)
    words = harm(rng, rows)
    write(target, rows)
    return str(words)


def _bytes(rng: random.Random, data: bytearray) -> str:
    places = sorted(rng.randrange(12, len(data)) for _ in range(rng.choice((1, 1, 5, 100))))
    for place in places:
        data[place] ^= 1 << rng.randrange(8)
    return f"bits turned at {places[:5]}"


def _cut(rng: random.Random, data: bytearray) -> str:
    length = rng.randrange(len(data))
    del data[length:]
    return f"cut at {length}"


def _components(batch: Any) -> list[int]:
    return [k for k, name in enumerate(batch.schema.names) if not name.startswith("rerun")]


def _column(rng: random.Random, items: list[Any]) -> str:
    """One column of one batch loses rows or values, or gets impossible ones."""
    k = rng.randrange(len(items))
    batch = items[k]
    choice = [c for c in _components(batch) if pa.types.is_list(batch.schema.field(c).type)]
    if not choice:
        return "nothing"
    c = rng.choice(choice)
    ways = (_drop_column, _drop_rows, _replace_values, _replace_values, _replace_values, _resize)
    way: Callable[[random.Random, Any, int], tuple[Any, str]] = rng.choice(ways)
    items[k], words = way(rng, batch, c)
    return f"{entity_of(batch)} {batch.schema.names[c]}: {words}"


def _drop_column(rng: random.Random, batch: Any, c: int) -> tuple[Any, str]:
    return batch.drop_columns([batch.schema.names[c]]), "dropped"


def _drop_rows(rng: random.Random, batch: Any, c: int) -> tuple[Any, str]:
    kept = sorted(rng.sample(range(len(batch)), rng.randrange(len(batch)))) if len(batch) else []
    return batch.take(pa.array(kept, pa.int64())), f"{len(batch)} rows become {len(kept)}"


def _with(batch: Any, c: int, rows: list[Any], words: str) -> tuple[Any, str]:
    field = batch.schema.field(c)
    return batch.set_column(c, field, pa.array(rows, field.type)), words


def _replace_values(rng: random.Random, batch: Any, c: int) -> tuple[Any, str]:
    rows = batch.column(c).to_pylist()
    kind = batch.schema.field(c).type
    leaf = kind
    while pa.types.is_list(leaf) or pa.types.is_fixed_size_list(leaf):
        leaf = leaf.value_type
    if pa.types.is_floating(leaf):
        value: Any = rng.choice((float("nan"), float("inf"), 0.0, -1.0, 1e30, 1e-30))
    elif pa.types.is_integer(leaf):
        value = rng.choice((0, 1, 255 if pa.types.is_uint8(leaf) else 2**31 - 1))
    elif pa.types.is_boolean(leaf):
        value = rng.choice((True, False))
    else:
        value = rng.choice(("", "x", "</script>", "\x00", "NaN"))
    chosen = set(range(len(rows))) if rng.random() < 0.5 else {rng.randrange(len(rows))} if rows else set()
    every = rng.random() < 0.5

    def changed(item: Any) -> Any:
        if isinstance(item, list):
            return [changed(x) if every or n == 0 else x for n, x in enumerate(item)]
        return value

    new = [changed(row) if n in chosen else row for n, row in enumerate(rows)]
    return _with(batch, c, new, f"{len(chosen)} of {len(rows)} rows hold {value!r}")


def _resize(rng: random.Random, batch: Any, c: int) -> tuple[Any, str]:
    rows = batch.column(c).to_pylist()
    way = rng.choice(("none", "empty", "shorter", "doubled"))
    one = rng.random() < 0.5
    at = rng.randrange(len(rows)) if rows else 0
    change: dict[str, Callable[[Any], Any]] = {
        "none": lambda row: None,
        "empty": lambda row: [],
        "shorter": lambda row: (row or [])[:-1],
        "doubled": lambda row: [*(row or []), *(row or [])],
    }
    new = [change[way](row) if not one or n == at else row for n, row in enumerate(rows)]
    return _with(batch, c, new, f"rows {way}{f' at {at}' if one else ''}")


def _entity(rng: random.Random, items: list[Any]) -> str:
    """An entity is missing, or everything below a path."""
    path = entity_of(rng.choice(items))
    parts = path.split("/")
    path = "/".join(parts[: rng.randrange(2, len(parts) + 1)])
    items[:] = [b for b in items if not (entity_of(b) + "/").startswith(path + "/")]
    return f"without {path}"


def _text(rng: random.Random, items: list[Any]) -> str:
    """A property holds something else, or its JSON is another."""
    own = [k for k, batch in enumerate(items) if entity_of(batch) == PROPERTIES]
    k = rng.choice(own)
    batch = items[k]
    c = rng.choice(_components(batch))
    name, field = batch.schema.names[c], batch.schema.field(c)
    row = batch.column(c).to_pylist()[-1]
    if isinstance(row, list) and len(row) == 1 and isinstance(row[0], str) and row[0][:1] in "{[":
        text, words = _other_json(rng, row[0])
        items[k] = batch.set_column(c, field, pa.array([[text]] * len(batch), field.type))
        return f"property {name}: {words}"
    if rng.random() < 0.3:
        items[k] = batch.drop_columns([name])
        return f"property {name} dropped"
    value = rng.choice(("x", 7, -1.5, float("nan"), 0.0, "../../evil"))
    items[k] = batch.set_column(c, name, pa.array([[value]] * len(batch)))
    return f"property {name} = {value!r}"


def _other_json(rng: random.Random, text: str) -> tuple[str, str]:
    if rng.random() < 0.15:
        n = rng.randrange(len(text))
        return text[:n], f"cut at {n}"
    value = json.loads(text)
    places = [*_places(value)]
    if not places or rng.random() < 0.1:
        value = rng.choice(JUNK)
        return json.dumps(value), f"is {value!r}"
    holder, key = rng.choice(places)
    if rng.random() < 0.4:
        del holder[key]
        return json.dumps(value), f"without {key!r}"
    holder[key] = rng.choice(JUNK)
    return json.dumps(value), f"{key!r} is {holder[key]!r}"


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    if isinstance(value, dict):
        for key in value:
            yield value, key
            yield from _places(value[key])
    elif isinstance(value, list):
        for k in range(len(value)):
            yield value, k
            yield from _places(value[k])


def read_all(path: Path) -> tuple[Callable[[], Any], ...]:
    """What the commands do with a recording: inspect, share, draw, view, solve its scene again."""

    def view() -> None:
        shown = view_model_of_recording(Recording(path))
        for part in (shown.drawings, shown.charts, shown.centrodes):
            part()
        for quantity in shown.catalogue.quantities:
            quantity.values()

    def draw() -> None:
        shown = presentation_in(Recording(path, most=1000))
        write_svg(shown, path.with_suffix(".svg"), time=picture_time(shown).time, width=640, height=400, dark=False)

    return (
        lambda: format_inspection(inspect(path)),
        lambda: make_page(presentation_in(Recording(path, most=1000)), most=1000),
        draw,
        view,
        lambda: Recording(path).scene(),
    )
