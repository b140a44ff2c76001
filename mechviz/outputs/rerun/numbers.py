"""The numbers of a recording: its tables by path, and the connectivity that it states."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from mechviz.outputs.rerun.paths import parts_of
from mechviz.quantities.items import JointInfo, Table
from mechviz.quantities.numbers import TOLERANCE, LoadInfo, Numbers

if TYPE_CHECKING:
    from mechviz.outputs.rerun.reader import Recording


ROOTS = ("data", "health", "polygons")


def numbers_in(recording: Recording) -> Numbers:
    """The numbers of a recording, complete or interrupted."""
    said = recording.said
    model = said.model
    ticks, _ = recording.scalars("data", "links", model.frame, "pose")
    time = np.asarray(1e-9 * ticks.astype(float), float)
    tables = {t.path: t for path in recording.entities if (t := _table(recording, path)) is not None}
    joints = {}
    for name, joint in model.joints.items():
        unit = tables["data", "joints", name, "motion"].columns[0][1]
        joints[name] = JointInfo(name, joint.type, joint.links, unit)
    paths = [parts_of(path) for path in recording.entities]
    traced = [p[2] for p in paths if p[:2] == ("mechanism", "paths")] if model.traced is None else model.traced
    return Numbers(
        time=time,
        frame=model.frame,
        links=model.links,
        joints=joints,
        drives=model.drives,
        loads={name: LoadInfo(load.kind, load.links) for name, load in model.loads.items()},
        traced=tuple(traced),
        tables=tables,
        cycle=said.cycle or float(np.ptp(time)) or 1.0,
        length_scale=said.length_scale or said.tolerance / TOLERANCE,
        tolerance=said.tolerance,
    )


def _table(recording: Recording, path: str) -> Table | None:
    """A table, whose values are read when they are asked for; None of what is none."""
    parts = parts_of(path)
    names = recording.static(path, component="SeriesLines:names")
    if parts[0] not in ROOTS or names is None or not recording.has(path):
        return None
    columns = tuple(_column(str(name), parts) for name in names)
    return Table(parts, "", columns, lambda: recording.scalars(path)[1])


def _column(header: str, parts: tuple[str, ...]) -> tuple[str, str]:
    """Name and unit of a column from what a plot calls it, such as ``crank.x [m]``."""
    match = re.fullmatch(r"(.*) \[([^\]]*)\]", header)
    name, unit = (match[1], match[2]) if match else (header, "1")
    named = parts[0] == "data" and parts[1:] == ("power",)
    return name.removeprefix("power.") if named else name.rsplit(".", 1)[-1], unit.replace("²", "^2")
