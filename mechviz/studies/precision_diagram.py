"""Work-precision diagrams: error over time on logarithmic axes, a panel for each setting."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from mechcore.accuracy import SETTINGS
from mechviz.figures import COLOURS, chart
from mechviz.scene.annotations import Place
from mechviz.scene.document import SceneDocument, stated
from mechviz.scene.fields import DocumentTable
from mechviz.scene.kinds.settings import ORDERS
from mechviz.studies.precision import PrecisionPoint, cheapest, pareto

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mechviz.runs import Run

PANEL = (4.4, 3.6)  # width and height of a panel [in]
FRONT, NOW, BEST = "#c9ced6", "#111111", "#d6336c"


def setting_words(point: PrecisionPoint, front: bool) -> str:
    """A point in one line of text, with an asterisk where it is on the Pareto ``front``."""
    words = f"{point.setting}: {point.method}, {point.value}: {point.error:.0e} in {point.time_text}"
    return f"{words} *" if front else words


def settings_of(points: Sequence[PrecisionPoint]) -> list[str]:
    """Names of the settings, in the order of their points."""
    return list(dict.fromkeys(p.setting for p in points))


def precision_axes(axes: Axes, seconds: Sequence[float]) -> None:
    """Set up logarithmic axes of error over time, with round ticks around the times ``seconds`` [s]."""
    from matplotlib.ticker import EngFormatter, LogLocator, NullLocator

    axes.set(xscale="log", yscale="log", xlabel="time, median", ylabel="relative error")
    low, high = min(seconds), max(seconds)
    axes.set_xlim(low / 1.8, high * 1.8)  # wide enough to contain a round time
    subs = next(marks for most, marks in ((8.0, (1.0, 2.0, 5.0)), (30.0, (1.0, 3.0)), (math.inf, (1.0,))) if high <= most * low)
    axes.xaxis.set_major_locator(LogLocator(subs=subs, numticks=6))
    axes.xaxis.set_major_formatter(EngFormatter(unit="s"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_minor_locator(NullLocator())


def draw_panel(
    axes: Axes, setting: str, points: Sequence[PrecisionPoint], target: float | None, columns: int = 2
) -> dict[str, str]:
    """Draw the points of a setting, whose errors must be finite, with a legend of its methods above. Returns the text of each point
    by the gid of its dot.

    The points of each method are joined by a line in the order of the study; points that are fitted to a target are not joined.
    """
    precision_axes(axes, [p.seconds for p in points])
    front = pareto(points)
    axes.plot([p.seconds for p in front], [p.error for p in front], "o-", color=FRONT, linewidth=6.0, markersize=8.0)
    words: dict[str, str] = {}
    for k, method in enumerate(dict.fromkeys(p.method for p in points)):
        own, color = [p for p in points if p.method == method], COLOURS[k % len(COLOURS)]
        joined = [p for p in own if not p.note.startswith("fitted") and p.value != "as it is"]
        axes.plot([p.seconds for p in joined], [p.error for p in joined], color=color, linewidth=1.1)
        axes.plot([], [], "o-", color=color, markersize=4.0, linewidth=1.1, label=method)
        for p in own:  # an invisible wide edge enlarges the area that the pointer has to hit
            gid = f"setting-{setting.replace(' ', '-')}-{k}-{len(words)}"
            words[gid] = setting_words(p, any(p is q for q in front))
            axes.plot(p.seconds, p.error, "o", color=color, markersize=4.0, gid=gid, mec=(1.0, 1.0, 1.0, 0.0), mew=6.0)
    for p in points:
        if p.current:
            axes.plot(p.seconds, p.error, "o", color="none", mec=NOW, markersize=9.0, mew=1.4)
    best = None if target is None else cheapest(points, target)
    if best is not None:
        axes.plot(best.seconds, best.error, "o", color="none", mec=BEST, markersize=13.0, mew=1.4)
    low, high = axes.get_ylim()
    if target is not None and low < target < high:
        axes.axhline(target, color="#222222", linestyle="--", linewidth=1.0)
    axes.legend(
        title=setting, alignment="left", title_fontsize="medium", ncols=columns, loc="lower left", bbox_to_anchor=(0.0, 1.0)
    )
    return words


def diagram(
    points: Sequence[PrecisionPoint],
    title: str,
    foot: str,
    target: float | None = None,
    columns: int = 2,
    size: tuple[float, float] = PANEL,
) -> tuple[Figure, dict[str, str]]:
    """Figure with a panel of the given size [in] for each setting, and the text of each point by the gid of its dot.

    The Pareto front is a band, the current value a ring, the quickest point that reaches the target a larger ring.
    """
    settings = settings_of(points)
    columns = min(columns, len(settings))
    rows = math.ceil(len(settings) / columns)
    words: dict[str, str] = {}
    with chart(columns * size[0], rows * size[1] + 0.9) as figure:
        from matplotlib.lines import Line2D

        figure.suptitle(title)
        for k, setting in enumerate(settings):
            axes = figure.add_subplot(rows, columns, k + 1)
            own = [p for p in points if p.setting == setting and math.isfinite(p.error)]
            if own:
                words |= draw_panel(axes, setting, own, target, 2 if size[0] > 4.0 else 1)
            else:
                axes.set_title(f"{setting}: no setting gives numbers")
                axes.set_axis_off()
        key = [Line2D([], [], color=FRONT, linewidth=6.0, label="Pareto front: nothing is quicker and more exact")]
        rings = [(NOW, 9.0, "the setting in use")] + ([(BEST, 13.0, f"the cheapest that reaches {target:g}")] if target else [])
        key += [Line2D([], [], marker="o", color="none", mec=mec, markersize=wide, label=text) for mec, wide, text in rings]
        if target is not None:
            key.append(Line2D([], [], color="#222222", linestyle="--", linewidth=1.0, label=f"wanted {target:g}"))
        legend = figure.legend(handles=key, loc="outside lower left", ncols=columns, title=foot, alignment="left")
        legend.get_title().set(fontsize="small", color="#666666")
    return figure, words


UNSET: dict[str, dict[str, Any]] = {"integrator": {"nodes": None}, "tessellation": {"chord": None}}
"""Values of options of a setting that a point leaves out."""

NAMES = {order: name for name, order in ORDERS.items()}


def setting_changes(document: SceneDocument, options: Mapping[str, Any]) -> dict[Place, Any]:
    """The changes of a scene that apply the options of a `PrecisionPoint`: frames, method and tolerance under [run], the others
    under accuracy."""
    given = document.accuracy
    accuracy: dict[str, Any] = stated(given) if isinstance(given, DocumentTable) else {} if given is None else {"target": given}
    changes: dict[Place, Any] = {}
    for key, value in options.items():
        if key == "frames":
            changes["run", "frames"] = int(value)
        elif key == "method":
            changes["run", "method"] = value
        elif key == "integrator":
            changes["run", "tolerance"] = value
        elif key == "interpolation":
            accuracy[key] = NAMES[value]
        elif key == "chord":
            accuracy[key] = f"{float(value)!r} m"
        else:
            accuracy[key] = value
    return changes | {("accuracy",): accuracy or None}


def target_changes(target: float | None) -> dict[Place, Any]:
    """The changes of a scene that set a target error and remove the stated frames and tolerance, so that all settings follow from
    the target. None removes all accuracy settings."""
    changes: dict[Place, Any] = {("accuracy",): target}
    return changes if target is None else changes | {("run", "frames"): None, ("run", "tolerance"): None}


def in_use(run: Run, setting: str, options: Mapping[str, Any]) -> bool:
    """Whether a run was computed with the options of a `PrecisionPoint` of this setting."""
    options = {**UNSET.get(setting, {}), **options}
    settings, simulation = run.accuracy, run.simulation
    present: dict[str, Any] = {name: getattr(settings, name) for name in SETTINGS if name in options}
    present |= {"frames": run.scene.frames}
    if "profile" in options or "numbers" in options:  # read only where needed: to find them may take a measurement
        present |= {"profile": run.resolved_accuracy.profile, "numbers": run.resolved_accuracy.numbers}
    if simulation is not None:
        present |= {"method": simulation.method, "integrator": simulation.tolerance}
    return all(present.get(name) == value for name, value in options.items())
