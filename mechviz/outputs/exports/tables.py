"""Results as tables (CSV, Parquet), and plots of them as files."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from io import BytesIO, StringIO
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Real
from mechcore.constructions.studies import compute as compute_studies
from mechcore.errors import Fault, MechanismError
from mechviz.figures import COLOURS, DOTS_AN_INCH, chart, chart_svg
from mechviz.files import replacing
from mechviz.outputs.rerun.content import model_json, scene_text
from mechviz.quantities.catalogue import Axis, Quantity, QuantityGroup
from mechviz.quantities.items import interpolate_table
from mechviz.runs import Run, package_version

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROWS_AT_ONCE = 5000  # rows solved, and written, at once
MOST_ROWS = 10_000_000
ENERGY = ("data", "energy")


def wide_table(run: Run, times: Real | None = None) -> dict[str, Real]:
    """All results of a run as columns (F,) under names with units, such as ``crank.x [m]``; ``time [s]`` comes first.

    With ``times`` (n,) [s] within the run the columns (n,) are those at these times: solved for, except what is known at frames
    only, which is interpolated by the method of the run's accuracy. Quantities that were not computed are left out.
    """
    at_frames = np.asarray(run.motion.time, float)
    solved, nothing = ({}, np.zeros((0, 0))) if times is None else (_solved(run, times), np.zeros((len(times), 0)))
    columns: dict[str, Real] = {"time [s]": at_frames if times is None else np.asarray(times, float)}
    tables = run.numbers.tables.values()
    for table in sorted(tables, key=lambda t: t.path[:2] != ("data", "drive")):  # drives first, the others in their order
        rows = table.values if times is None else solved.get(table.path, nothing)
        if times is not None and (done := rows.shape[1]) < len(table.columns):
            read = interpolate_table(
                table.path, at_frames, lambda path: run.numbers.values(*path), times, run.accuracy.interpolation
            )
            rows = np.hstack([rows, read[:, done:]])
        for name, values in zip(table.headers(), rows.T, strict=True):
            while name in columns:  # a link may have a name that gives its columns the name of a joint's
                name += "'"
            if not np.isnan(values).all():
                columns[name] = values
    return columns


def _solved(run: Run, times: Real) -> dict[tuple[str, ...], Real]:
    """The first columns (n, k) of the tables of a run by path, solved at times (n,) [s].

    Left out is what is known at frames only: health and, of a prescribed motion, accumulated work, the last columns of the
    energies. All is where the motion is given at its frames only, or the accuracy holds its values between them or takes rates from
    the positions there.
    """
    motion, forces = run.motion, run.forces
    if motion.at_times is None or run.accuracy.interpolation == 0 or run.accuracy.differentiation != "exact":
        return {}
    parts: dict[tuple[str, ...], list[Real]] = {}
    for some in np.array_split(times, max(-(-len(times) // ROWS_AT_ONCE), 1)):
        there = motion.at_times(some)
        pressing = None if forces is None else forces.at_times(some)
        here = replace(run, motion=there, forces=pressing, studies=compute_studies(there, pressing))
        for path, table in here.numbers.tables.items():
            if path == ENERGY and pressing is not None and run.simulation is None:
                parts.setdefault(path, []).append(np.column_stack([pressing.kinetic_energy, pressing.potential_energy]))
            elif path[0] == "data":
                parts.setdefault(path, []).append(table.values)
    return {path: np.concatenate(values) for path, values in parts.items()}


def even_times(run: Run, step: float) -> Real:
    """Times (n,) [s] in equal steps from the start of a run to its end. Raises `MechanismError` for a step that is not positive,
    too short, or longer than the run."""
    start, end = float(run.motion.time[0]), float(run.motion.time[-1])
    takes = end - start
    if not (np.isfinite(step) and step > 0.0 and (takes == 0.0 or 1.0 - 1e-12 <= takes / step <= MOST_ROWS)):
        remedy = f"Give a time from {takes / MOST_ROWS:.3g} s to {takes:.6g} s, the length of the run."
        raise MechanismError(Fault("--every", f"{step:g} s between rows is too {'long' if step > takes else 'short'}.", remedy))
    return np.asarray(np.minimum(start + step * np.arange(int(np.floor(takes / step * (1.0 + 1e-12))) + 1), end), float)


def export_csv(run: Run, path: Path | str, times: Real | None = None) -> Path:
    """Write all results as one table, with numbers in the shortest form that reads back exactly; ``times`` as in `wide_table`."""
    columns = wide_table(run, times)
    values = np.column_stack(list(columns.values()))
    with replacing(Path(path)) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        file.write(",".join(map(_quoted, columns)) + "\r\n")
        for start in range(0, len(values), ROWS_AT_ONCE):
            file.writelines(",".join(map(repr, row)) + "\r\n" for row in values[start : start + ROWS_AT_ONCE].tolist())
    return Path(path)


def export_parquet(run: Run, path: Path | str, times: Real | None = None) -> Path:
    """Write the same table as Parquet, with the scene, the connectivity and the version of mechviz in the file's metadata."""
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


def _quoted(name: str) -> str:
    """A CSV field, quoted if necessary."""
    return '"' + name.replace('"', '""') + '"' if re.search(r'[",\r\n]', name) else name


PANEL_SIZE = 7.0, 2.4  # width and height of a plot [in]
PLOT_FORMATS = ("CSV", "SVG", "PNG")
DESIGN_DASHES = ("--", ":", "-.")  # of other designs, repeated cyclically
DENSE_DASHES = (0, (5, 1))  # of curves whose colours repeat those of the first ones


ANGLE_TICK_STEPS = (1.0, 1.5, 3.0, 4.5, 6.0, 9.0, 10.0)  # steps between ticks, times a power of ten


def plot_figure(
    title: str,
    quantities: Sequence[Quantity | QuantityGroup],
    axis: Axis,
    others: Mapping[str, Real] | None = None,
    half: Real | None = None,
) -> Figure:
    """A matplotlib figure with a panel for each quantity; in the first one also ``others``, the same curves (F, k) of other designs
    by name, dashed, and pale bands of half width ``half`` (F, k)."""
    width, height = PANEL_SIZE
    beside = others or {}
    with chart(width, height * len(quantities) + 0.8) as figure:
        figure.suptitle(title)
        panels = figure.subplots(len(quantities), squeeze=False, sharex=True)[:, 0]
        for panel, quantity in zip(panels, quantities, strict=True):
            for k, (name, column) in enumerate(zip(quantity.curves, quantity.values().T, strict=True)):
                panel.plot(axis.values, column, label=name, linestyle="-" if k < len(COLOURS) else DENSE_DASHES)
            panel.set(ylabel=f"[{quantity.unit}]", title=quantity.label)
        colors = [line.get_color() for line in panels[0].lines]
        for (other, values), dash in zip(beside.items(), cycle(DESIGN_DASHES), strict=False):
            for column, name, color in zip(values.T, quantities[0].curves, colors, strict=True):
                panels[0].plot(axis.values, column, color=color, linestyle=dash, linewidth=1.0, label=f"{name} {other}")
        if half is not None:
            for wide, column, color in zip(half.T, quantities[0].values().T, colors, strict=True):
                panels[0].fill_between(axis.values, column - wide, column + wide, color=color, alpha=0.22, linewidth=0.0)
        for panel in panels:
            if len(panel.lines) > 1:
                panel.legend(
                    panel.lines, [str(line.get_label()) for line in panel.lines], loc="upper left", bbox_to_anchor=(1.0, 1.0)
                )
        panels[-1].set_xlabel(axis.title)
        if axis.unit == "°":
            panels[-1].xaxis.get_major_locator().set_params(steps=ANGLE_TICK_STEPS)
    return figure


def plot_file(
    kind: str,
    title: str,
    quantity: Quantity | QuantityGroup,
    axis: Axis,
    others: Mapping[str, Real] | None = None,
    half: Real | None = None,
) -> bytes:
    """A plot as a file of one of ``PLOT_FORMATS``. A table has the axis first, in the units of the plot, then the curves, then
    ``others``, the same curves (F, k) of other designs by name, and ``half``, half the widths (F, k) of tolerance bands."""
    if kind == "CSV":
        text = StringIO()
        rows = csv.writer(text)
        names = [*quantity.curves, *(f"{name} {other}" for other in others or {} for name in quantity.curves)]
        names += [f"{name} tolerance ±" for name in quantity.curves if half is not None]
        rows.writerow([axis.title, *(f"{name} [{quantity.unit}]" for name in names)])
        columns = [axis.values, quantity.values(), *(others or {}).values(), *([] if half is None else [half])]
        rows.writerows(np.column_stack(columns).tolist())
        return text.getvalue().encode()
    figure = plot_figure(title, [quantity], axis, others, half)
    try:
        if kind == "SVG":
            return chart_svg(figure).encode()
        stream = BytesIO()
        figure.savefig(stream, format="png", dpi=DOTS_AN_INCH)
        return stream.getvalue()
    finally:
        figure.clear()  # otherwise it stays in memory until the next garbage collection of reference cycles
