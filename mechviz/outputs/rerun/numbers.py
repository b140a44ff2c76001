"""The numbers of a recording: its tables by path, and the connectivity that it states."""

from __future__ import annotations

import re
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechviz.outputs.rerun.paths import parts_of
from mechviz.quantities.items import JointInfo, Table
from mechviz.quantities.numbers import TOLERANCE, LoadInfo, Numbers

if TYPE_CHECKING:
    from mechviz.outputs.rerun.reader import Recording


Real = NDArray[np.float64]

ROOTS = ("data", "health", "polygons")


def numbers_in(recording: Recording) -> Numbers:
    """The numbers of a recording, complete or interrupted. KeyError and ValueError where it does not keep to the contract."""
    model, said = recording.model, recording.properties
    ticks, _ = recording.scalars("data", "links", model["frame"], "pose")
    time = np.asarray(1e-9 * ticks.astype(float), float)
    tables = {t.path: t for path in recording.entities if (t := _table(recording, path, len(time))) is not None}
    for link in model["links"]:
        if ("data", "links", link, "pose") not in tables:
            raise ValueError(f"the pose of link {link} is not there")
    joints = {}
    for name, joint in model["joints"].items():
        motion = tables.get(("data", "joints", name, "motion"))
        unit = motion.columns[0][1] if motion is not None else "rad"
        joints[name] = JointInfo(name, str(joint["type"]), (str(joint["links"][0]), str(joint["links"][1])), unit)
    scale = float(said.get("length_scale", float(said["tolerance"]) / TOLERANCE))
    paths = [parts_of(path) for path in recording.entities]
    return Numbers(
        time=time,
        frame=str(model["frame"]),
        links=tuple(model["links"]),
        joints=joints,
        drives=tuple(model["drives"]),
        loads={name: LoadInfo(str(load["kind"]), tuple(load["links"])) for name, load in model["loads"].items()},
        traced=tuple(model.get("traced", [p[2] for p in paths if p[:2] == ("mechanism", "paths")])),
        tables=tables,
        cycle=float(said.get("cycle", float(np.ptp(time)) or 1.0)),
        length_scale=scale,
        tolerance=float(said["tolerance"]),
    )


def _table(recording: Recording, path: str, frames: int) -> Table | None:
    """A table, whose values are read when they are asked for; None of what is none."""
    parts = parts_of(path)
    names = recording.static(path, component="SeriesLines:names")
    if parts[0] not in ROOTS or names is None or not recording.has(path):
        return None
    columns = tuple(_column(str(name), parts) for name in names)
    return Table(parts, "", columns, partial(_read, recording, path, frames))


def _read(recording: Recording, path: str, frames: int) -> Real:
    _, values = recording.scalars(path)
    if len(values) != frames:
        raise ValueError(f"{path} has {len(values)} rows, the poses have {frames}")
    return values


def _column(header: str, parts: tuple[str, ...]) -> tuple[str, str]:
    """Name and unit of a column from what a plot calls it, such as ``crank.x [m]``."""
    match = re.fullmatch(r"(.*) \[([^\]]*)\]", header)
    name, unit = (match[1], match[2]) if match else (header, "1")
    named = parts[0] == "data" and parts[1:] == ("power",)
    return name.removeprefix("power.") if named else name.rsplit(".", 1)[-1], unit.replace("²", "^2")
