"""Charts of stored studies: responses, contours with infeasible designs, parallel coordinates, scatter matrices."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechviz.figures import chart, over_decades
from mechviz.files import open_regular
from mechviz.scene.faults import closest
from mechviz.scene.scene import Scene, loads
from mechviz.studies.designs.sweep import REASON, parts_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FigureKind = Literal["auto", "response", "contour", "parallel", "scatter"]
LEVELS = 14
MOST_LINES = 3000  # largest number of lines in parallel coordinates, and of curves in one chart
COLOURS = "viridis"
MISSING = "#c8553d"
WANTED = "Give a study that `mechviz sweep -o FILE.parquet` has written."


@dataclass(frozen=True, eq=False)
class StoredStudy:
    """A study read from its file. ``variables`` (D,) and ``results`` (D,), or (D, F) for curves, by their titles; ``reasons``: why
    a design has no values, "" for the others; ``text``: of the scene; ``names``: of the parameters, with their units."""

    title: str
    text: str
    names: tuple[tuple[str, str], ...]
    variables: dict[str, Real]
    results: dict[str, Real]
    reasons: tuple[str, ...]

    @property
    def feasible(self) -> Flags:
        """Whether there are values (D,)."""
        return np.array([not reason for reason in self.reasons], bool)

    def scene(self, folder: Path) -> Scene:
        """The scene of the study; ``folder``: location of the files that the scene names. Raises `MechanismError`."""
        return loads(self.text, self.title, folder)

    def stated(self, k: int) -> dict[str, float | str]:
        """The parameter values of design ``k``, as a scene states them."""
        values = [float(column[k]) for column in self.variables.values()]
        return {name: f"{x!r} {unit}" if unit else x for (name, unit), x in zip(self.names, values, strict=True)}

    def result(self, wanted: str | None) -> tuple[str, Real]:
        """Title and values of a result, by its title with or without the unit; None: the first. Raises `MechanismError`."""
        for title, values in self.results.items():
            if wanted is None or wanted in (title, title.rpartition(" [")[0]):
                return title, values
        remedy = f"There are: {', '.join(self.results)}."
        raise MechanismError(Fault(f"--of {wanted}", "is no result of the study.", remedy))


def read_study(path: Path) -> StoredStudy:
    """The study in a file that ``mechviz sweep`` wrote. Raises `MechanismError`."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with open_regular(path) as file:
            table = pq.read_table(file)
    except FileNotFoundError:
        near = closest(path.name, [entry.name for entry in path.parent.glob("*.parquet")])
        fault = Fault("file", "there is no such file.", f"Did you mean '{path.parent / near}'?" if near else WANTED)
        if parts_of(path).is_dir():
            fault = Fault("file", "this study is not finished.", "The command of mechviz sweep that began it goes on with it.")
        raise MechanismError(fault) from None
    except (OSError, pa.ArrowInvalid) as error:
        why = (getattr(error, "strerror", None) or str(error)).rstrip(".")
        raise MechanismError(Fault("file", f"this cannot be read: {why}.", WANTED)) from None
    said = {key.decode(): value.decode() for key, value in (table.schema.metadata or {}).items()}
    if "mechviz.study" not in said:
        raise MechanismError(Fault("file", "this is no study of mechviz.", WANTED))
    question = json.loads(said["mechviz.study"])
    varied = tuple((str(name), str(unit)) for name, unit, *_ in question["vary"])
    names = [f"{name} [{unit}]" if unit else name for name, unit in varied]
    others = [name for name in table.column_names if name not in (*names, "design", REASON)]
    results = {}
    for name in others:
        column = table[name].combine_chunks()
        curve = pa.types.is_fixed_size_list(column.type)
        flat = np.asarray((column.flatten() if curve else column).to_numpy(zero_copy_only=False), float)
        results[name] = flat.reshape(table.num_rows, -1) if curve else flat
    variables = {name: table[name].to_numpy() for name in names}
    reasons = tuple(r or "" for r in table[REASON].to_pylist())
    return StoredStudy(
        said.get("mechviz.scene", path.stem), said.get("mechviz.scene_toml", ""), varied, variables, results, reasons
    )


def study_chart(study: StoredStudy, kind: FigureKind = "auto", of: str | None = None) -> Figure:
    """Chart of one result of a study. "auto" chooses a response for one variable or curves, contours for two variables, parallel
    coordinates for more. Raises `MechanismError` where the kind does not fit the study."""
    title, values = study.result(of)
    if not study.feasible.any():
        raise MechanismError(Fault("study", f"no design has values: {study.reasons[0]}.", "Vary parameters over other ranges."))
    count = len(study.variables)
    if kind == "auto":
        kind = "response" if count == 1 or values.ndim > 1 else "contour" if count == 2 else "parallel"
    if kind == "contour" and count != 2:
        raise MechanismError(Fault("--kind contour", f"the study varies {count} parameters, not two.", "Take parallel or scatter."))
    if values.ndim > 1 and kind != "response":
        raise MechanismError(Fault(f"--kind {kind}", f"'{title}' is a curve.", "Take response, or sweep a number of it."))
    size = (2.2 * (count + 1), 2.2 * (count + 1)) if kind == "scatter" else (max(6.5, 1.8 * (count + 1)), 4.5)
    with chart(*size) as figure:
        {"response": _response, "contour": _contour, "parallel": _parallel, "scatter": _scatter}[kind](figure, study, title, values)
        figure.suptitle(f"{study.title}: {title}")
    return figure


def _response(figure: Figure, study: StoredStudy, title: str, values: Real) -> None:
    axes = figure.subplots()
    name, x = next(iter(study.variables.items()))
    ok = study.feasible
    if values.ndim > 1:
        shown = np.flatnonzero(ok)[:: max(1, int(ok.sum()) // MOST_LINES)]
        along = np.linspace(0.0, 100.0, values.shape[1])
        colour = _coloured(figure, axes, x[shown], name)
        for k, shade in zip(shown, colour, strict=True):
            axes.plot(along, values[k], color=shade, linewidth=0.8)
        axes.set_xlabel("part of the run [%]")
    else:
        order = np.argsort(x, kind="stable")
        one = len(study.variables) == 1
        axes.plot(x[order], np.where(ok, values, np.nan)[order], "-" if one else ".", color="#1b6ca8")
        if not ok.all():
            low = float(np.nanmin(values[ok]))
            axes.plot(x[~ok], np.full(int((~ok).sum()), low), "|", color=MISSING, label="no values")
            axes.legend()
        axes.set_xlabel(name)
        axes.set_yscale("log" if over_decades(values[ok]) else "linear")
    axes.set_ylabel(title)


def _contour(figure: Figure, study: StoredStudy, title: str, values: Real) -> None:
    axes = figure.subplots()
    (first, x), (second, y) = study.variables.items()
    ok = study.feasible
    columns, rows = np.unique(x), np.unique(y)
    if len(columns) * len(rows) == len(x):  # a grid
        place = np.searchsorted(columns, x), np.searchsorted(rows, y)
        grid = np.full((len(rows), len(columns)), np.nan)
        grid[place[1], place[0]] = np.where(ok, values, np.nan)
        filled = axes.contourf(columns, rows, grid, **_levels(values[ok]))
    else:
        filled = axes.tricontourf(x[ok], y[ok], values[ok], **_levels(values[ok]))
    figure.colorbar(filled, ax=axes, label=title, format="%.3g" if over_decades(values[ok]) else None)
    if not ok.all():
        axes.set_facecolor("#f1e4e1")
        axes.plot(x[~ok], y[~ok], "x", color=MISSING, markersize=3.0, label="no values")
        axes.legend(frameon=True)
    axes.set_xlabel(first)
    axes.set_ylabel(second)


def _levels(values: Real) -> dict[str, Any]:
    """Levels and colours of contours, as arguments of matplotlib: logarithmic where the values span decades."""
    if not over_decades(values):
        return {"levels": LEVELS, "cmap": COLOURS}
    from matplotlib.colors import LogNorm

    low, high = float(values.min()), float(values.max())
    return {"levels": np.geomspace(low, high, LEVELS + 1), "norm": LogNorm(low, high), "cmap": COLOURS}


def _parallel(figure: Figure, study: StoredStudy, title: str, values: Real) -> None:
    axes = figure.subplots()
    ok = np.flatnonzero(study.feasible)
    shown = ok[np.argsort(values[ok])][:: max(1, len(ok) // MOST_LINES)]  # in this order the greatest are drawn on top
    columns = {**study.variables, title: values}
    heights = []
    for column in columns.values():
        low, high = float(np.min(column[ok])), float(np.max(column[ok]))
        heights.append((column[shown] - low) / ((high - low) or 1.0))
    colour = _coloured(figure, axes, values[shown], title)
    for line, shade in zip(np.array(heights).T, colour, strict=True):
        axes.plot(np.arange(len(columns)), line, color=shade, linewidth=0.6, alpha=0.7)
    axes.set_xticks(np.arange(len(columns)), [_with_range(name, column[ok]) for name, column in columns.items()])
    axes.set_yticks([])
    axes.grid(visible=True, axis="x", color="#222222")


def _scatter(figure: Figure, study: StoredStudy, title: str, values: Real) -> None:
    ok = study.feasible
    columns = {**study.variables, title: values}
    names = list(columns)
    panels = figure.subplots(len(names), len(names), squeeze=False)
    for i, below in enumerate(names):
        for j, beside in enumerate(names):
            axes = panels[i][j]
            if i == j:
                axes.hist(columns[below][ok], bins=24, color="#a9c6df")
                axes.set_yticks([])
            else:
                axes.scatter(columns[beside][ok], columns[below][ok], c=values[ok], s=3.0, cmap=COLOURS)
                axes.plot(columns[beside][~ok], columns[below][~ok], "x", color=MISSING, markersize=2.0)
            if i == len(names) - 1:
                axes.set_xlabel(beside, fontsize=7)
            if j == 0:
                axes.set_ylabel(below, fontsize=7)
            axes.tick_params(labelsize=6)


def _coloured(figure: Figure, axes: Axes, values: Real, label: str) -> list[tuple[float, ...]]:
    """Colours of values; adds the colour bar to the axes."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    scale = Normalize(float(np.min(values)), float(np.max(values)))
    figure.colorbar(ScalarMappable(scale, COLOURS), ax=axes, label=label)
    return [tuple(shade) for shade in colormaps[COLOURS](scale(values))]


def _with_range(name: str, values: Real) -> str:
    return f"{name}\n{float(np.min(values)):.4g} to {float(np.max(values)):.4g}"
