"""A page that plays a mechanism: one HTML file that needs neither a server nor a network."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from html import escape
from importlib.resources import files
from typing import Any

import numpy as np

from mechcore.arrays import Real
from mechcore.records import dataclass
from mechviz.outputs.page.pack import MOST_FRAMES, ChosenFrames, Pack, PackProgress, find_frames, no_progress
from mechviz.outputs.page.shapes import hex_of, pack_bodies, pack_drawables, pack_drawing, pack_links, spring_boxes
from mechviz.outputs.presentation import Presentation
from mechviz.outputs.rerun.blueprint import LONGEST_SHOW, SECONDS_A_CYCLE, SHORTEST_SHOW
from mechviz.outputs.rerun.content import html_of
from mechviz.picture.centres import CENTRE_GROUPS
from mechviz.picture.nodes import Picture
from mechviz.picture.overlays import HIDDEN_DIAGRAMS, INVERSION_GROUP, INVERSION_TITLE, SECTION_DIAGRAMS
from mechviz.quantities.catalogue import Catalogue, time_decimals
from mechviz.quantities.numbers import Numbers, usual_size
from mechviz.quantities.vectors import FORCE_FAMILIES, VECTOR_FAMILIES, round_value
from mechviz.scene.units import Units
from mechviz.studies.designs.sensitivity import Bands

ROUND_OFF = 1e-9  # of the largest usual value of the same unit: smaller values are shown as zero
MOST_FIRST = 4  # plots with which a page opens
MOST_REACTIONS = 6  # joints in one plot


@dataclass(frozen=True, eq=False)
class Plot:
    """Curves ``values`` (frames, n) of one unit. ``x`` (frames,): the abscissa if it is neither time nor the drive coordinate, as
    in a phase diagram; ``equal``: equal scales on both axes, as in a polar plot; ``half`` (frames, n): half the widths of their
    tolerance bands."""

    title: str
    unit: str
    names: tuple[str, ...]
    values: Real
    key: str  # of the quantity
    x: Real | None = None
    x_title: str = ""
    equal: bool = False
    half: Real | None = None

    @property
    def varies(self) -> bool:
        """Whether any curve is not constant."""
        return bool(np.any(np.fmax.reduce(self.values, axis=0) > np.fmin.reduce(self.values, axis=0)))


def find_plots(catalogue: Catalogue, frames: ChosenFrames, halves: Mapping[str, Real]) -> list[Plot]:
    """All plots: those of several items, then those of the catalogue; sorted with cams first and health last. ``halves``: half
    widths (F, n) of tolerance bands by key of the quantity."""
    plots = [*_gathered(catalogue, halves)]
    for q in catalogue.quantities:
        plots.append(Plot(q.label[:1].upper() + q.label[1:], q.unit, q.curves, q.values(), q.key, half=halves.get(q.key)))
    plots = [
        replace(plot, values=plot.values[frames.rows], half=None if plot.half is None else plot.half[frames.rows]) for plot in plots
    ]
    plots = _without_noise([plot for plot in plots if np.isfinite(plot.values).any()])
    plots += [p for p in (_polar(plot) for plot in plots) if p is not None]
    plots += _phases(plots)
    return sorted(plots, key=lambda p: (p.key.startswith("health."), p.x is not None, not p.key.startswith("cam.")))


def _gathered(catalogue: Catalogue, halves: Mapping[str, Real]) -> Iterator[Plot]:
    """Plots of one quantity of several items: efforts, reactions, motions of joints at the frame, shaking moments."""
    n, known = catalogue.numbers, catalogue.by_key

    def together(title: str, key: str, items: dict[str, str], column: int = 0) -> Iterator[Plot]:
        there = {name: known[k] for name, k in items.items() if k in known}
        if len(there) > 1:
            values = np.column_stack([q.values()[:, column] for q in there.values()])
            half = None
            if any(q.key in halves for q in there.values()):
                unknown = np.full((len(values), column + 1), np.nan)
                half = np.column_stack([halves.get(q.key, unknown)[:, column] for q in there.values()])
            yield Plot(title, next(iter(there.values())).unit, tuple(there), values, key, half=half)

    for effort in ("torque", "force"):
        yield from together(f"Driving {effort}", f"plots.{effort}", {name: f"drive.{name}.{effort}" for name in n.drives})
    joints = [name for name in n.joints if f"joint.{name}.reaction" in known]
    for part in (joints[k : k + MOST_REACTIONS] for k in range(0, len(joints), MOST_REACTIONS)):
        which = "" if len(part) == len(joints) else f", {part[0]} … {part[-1]}"
        title = f"Joint reactions, magnitude{which}"
        yield from together(title, "plots.reactions", {name: f"joint.{name}.reaction" for name in part}, 2)
    at_frame = _moved_at_frame(n)
    for kind, rates in (("displacement", ("velocity", "acceleration")), ("angle", ("angular_velocity", "angular_acceleration"))):
        moved = [name for name in at_frame if n.is_sliding(name) == (kind == "displacement")]
        for what in (kind, *rates):
            title = f"Joints at the frame, {what.replace('_', ' ')}"
            yield from together(title, f"plots.{what}", {name: f"joint.{name}.{what}" for name in moved})
    balance = {"shaking moment": "shaking.moment", "with counterweights": "shaking.balanced.moment"}
    yield from together("Shaking moment", "plots.shaking moment", balance)


def _moved_at_frame(n: Numbers) -> list[str]:
    """Names of the joints at the frame that are neither driven nor welds."""
    return [j.name for j in n.joints.values() if n.frame in j.links and j.name not in n.drives and j.kind != "weld"]


def first_plots(catalogue: Catalogue, plots: list[Plot], *, simulated: bool) -> list[int]:
    """Numbers of the plots with which a page opens, at most `MOST_FIRST`: cams, efforts, reactions, then output motions."""
    n = catalogue.numbers

    def having(*starts: str) -> list[int]:
        return [k for start in starts for k, p in enumerate(plots) if p.key.startswith(start) and p.x is None]

    at_frame = _moved_at_frame(n)
    cams = [k for k in having("cam.") if plots[k].names[0] in ("pressure angle", "lift") and plots[k].varies]
    single = [f"drive.{name}.{effort}" for name in n.drives for effort in ("torque", "force")]
    efforts = having("plots.torque", "plots.force") or having(*single)
    energy = having("energy") if simulated else []
    phases = [k for k, p in enumerate(plots) if p.x is not None and not p.equal]
    moved = having("plots.displacement", "plots.angle", "plots.velocity") if not n.traced else []
    points = having(*(f"point.{name}.{what}" for name in n.traced for what in ("velocity", "position", "acceleration")))
    motion = having(*(f"joint.{j}.{what}" for j in at_frame if n.is_sliding(j) for what in ("displacement", "velocity")))[:2]
    rest = having(*(f"joint.{j}.{what}" for j in at_frame for what in ("angle", "angular_velocity")))[:2]
    wanted = [*cams[:2], *having("plots.shaking moment", "shaking.moment", "reduced.")[:1], *efforts[:1]]
    wanted += having("plots.reactions")[:1]
    joints = [k for k in having(*(f"joint.{j}." for j in n.joints if j not in n.drives)) if plots[k].varies]
    wanted += [*energy, *(motion or moved[:2] or points[:2] or rest or having("point.")[:2] or joints[:2]), *phases[:1]]
    return list(dict.fromkeys(wanted))[:MOST_FIRST] or list(range(min(2, len(plots))))


def _without_noise(plots: list[Plot]) -> list[Plot]:
    """The plots with zero for values that are round-off relative to the largest usual value of the same unit. Health plots are
    not changed, because they show round-off."""
    largest: dict[str, float] = {}
    for p in plots:
        if not p.key.startswith("health."):
            largest[p.unit] = max(largest.get(p.unit, 0.0), usual_size(p.values))
    kept = []
    for p in plots:
        values = p.values
        if not p.key.startswith("health."):
            values = np.where(np.abs(values) <= ROUND_OFF * largest[p.unit], 0.0, values)
        kept.append(replace(p, values=values))
    return kept


def _polar(plot: Plot) -> Plot | None:
    """The polar plot of a joint's reaction, the curve of the tip of the force; None for other plots."""
    if not plot.key.startswith("joint.") or not plot.key.endswith(".reaction"):
        return None
    title = f"{plot.title.rpartition(': ')[0]}: polar plot of the reaction"
    across = f"Fx [{plot.unit}]"
    return Plot(title, plot.unit, ("Fy",), plot.values[:, 1:2], f"{plot.key}.polar", plot.values[:, 0], across, equal=True)


def _phases(plots: list[Plot]) -> list[Plot]:
    """Phase diagrams: velocity over coordinate for every joint whose coordinate is not monotonic."""
    phases = []
    by_key = {p.key: p for p in plots}
    for key, p in by_key.items():
        joint, _, what = key.rpartition(".")
        rate = by_key.get(f"{joint}.{'velocity' if what == 'displacement' else 'angular_velocity'}")
        if not joint.startswith("joint.") or what not in ("displacement", "angle") or rate is None:
            continue
        steps = np.diff(p.values[:, 0])
        if not (np.all(steps >= 0.0) or np.all(steps <= 0.0)):
            title = f"{p.title.rpartition(': ')[0]}: phase diagram, velocity against {what}"
            phases.append(
                Plot(title, rate.unit, ("velocity",), rate.values, f"{joint}.phase", p.values[:, 0], f"{what} [{p.unit}]")
            )
    return phases


def pack_plot(plot: Plot, pack: Pack) -> dict[str, Any]:
    """A plot for the page's header."""
    more = {} if plot.x is None else {"x": pack.floats(plot.x), "x_title": plot.x_title, "equal": plot.equal}
    more |= {} if plot.half is None else {"half": pack.floats(plot.half)}
    return {"title": plot.title, "unit": plot.unit, "names": list(plot.names), "values": pack.floats(plot.values), **more}


PAGE_SCRIPTS = ("decode.js", "camera.js", "stage.js", "export.js", "plots.js", "drawings.js", "player.js")


def make_page(
    shown: Presentation,
    *,
    most: int = MOST_FRAMES,
    keep: float | None = None,
    plots: bool = True,
    progress: PackProgress = no_progress,
) -> tuple[str, ChosenFrames]:
    """The HTML of a page with at most ``most`` frames of a run, in addition those around the time ``keep`` [s]; and the frames."""
    text, frames = page_data(shown, most=most, keep=keep, plots=plots, progress=progress)
    pieces = {
        "title": escape(shown.title),
        "style": _read("style.css"),
        "script": "\n".join(_read(name) for name in PAGE_SCRIPTS),
        "data": text,
    }
    page = ""
    rest = _read("page.html")
    while "{{" in rest:  # in order, so that braces in inserted texts are not replaced
        before, _, after = rest.partition("{{")
        name, _, rest = after.partition("}}")
        page += before + pieces[name]
    return page + rest, frames


def _read(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


PAGE_SCHEMA = 2
LEGEND_ARROW = 0.15  # of the mechanism's size: approximate length of the arrow whose value the legend states
MOST_ARROW_ROOM = 0.3  # of the mechanism's size: most room for arrows that reach beyond the solids

GROUP_LABELS = {
    "paths": "Paths",
    "ink": "Ink",
    "sheet": "Sheets",
    "springs": "Springs",
    "masses": "Masses",
    "polode": "Moving centrodes",
    "polodes": "Fixed centrodes",
    "funicular": "Funicular",
    "substitutes": "Substitute masses",
    "equivalent": "Equivalent linkages",
    INVERSION_GROUP: INVERSION_TITLE,
    **{group: words for group, (words, _) in CENTRE_GROUPS.items()},
    **{group: diagram.title for group, diagram in SECTION_DIAGRAMS.items()},
}
"""Groups that can be shown and hidden, in addition to the families of arrows."""


def page_data(
    shown: Presentation,
    *,
    most: int = MOST_FRAMES,
    keep: float | None = None,
    plots: bool = True,
    progress: PackProgress = no_progress,
) -> tuple[str, ChosenFrames]:
    """The packed data of a page, and its frames: at most ``most``, in addition those around the time ``keep`` [s].

    ``plots`` is False for pictures, which need none.
    """
    pack = Pack()
    frames = find_frames(shown, most, keep)
    picture, catalogue = shown.picture, shown.catalogue
    bands = shown.bands() if plots else Bands()
    curves = find_plots(catalogue, frames, bands.halves) if plots else []
    first = first_plots(catalogue, curves, simulated=shown.simulated)
    drawn = pack_drawables(picture, frames, pack, progress)
    drawables = [drawable for drawable, _ in drawn]
    bodies = pack_bodies(picture, frames, pack)
    header = {
        "schema": PAGE_SCHEMA,
        "title": shown.title,
        "learning_goal": shown.learning_goal,
        "version": shown.version,
        "frames": len(frames.chosen),
        "total": frames.total,
        "time": pack.floats(frames.time),
        "time_decimals": time_decimals(frames.time),
        "axes": _axes(catalogue, frames, pack),
        "pace": playback_speed(shown),
        "opening": catalogue.opening_frame_among(frames.rows),
        "bounds": picture.bounds.tolist(),
        "core": _core(picture).tolist(),
        "drawn": _extent(picture, [(d["group"], box) for d, box in drawn]).tolist(),
        "links": pack_links(picture, frames, pack),
        "bodies": bodies,
        "drawables": drawables,
        "constructions": [pack_drawing(d, picture.size, frames, pack) for d in shown.drawings().values()] if plots else [],
        "groups": _groups(picture, [*drawables, *bodies], catalogue.numbers.units),
        "length": dict(zip(("unit", "per_metre"), catalogue.numbers.units.display_unit("m"), strict=True)),
        "plots": [pack_plot(p, pack) for p in curves],
        "first": first,
        "lanes": [
            {"name": lane.name, "changes": [[t, word, hex_of(color)] for t, word, color in lane.changes]} for lane in shown.lanes
        ],
        "events": [{"time": e.time, "level": e.level, "text": f"{e.item}: {e.text}"} for e in shown.events],
        "notes": html_of(shown.notes + _on_tolerances(bands, [curves[k] for k in first])),
    }
    return pack.text(header), frames


def _on_tolerances(bands: Bands, plots: Sequence[Plot]) -> str:
    """Markdown on tolerance bands: parameters and their tolerances, widths in some plots, and why other bands are missing."""
    if not bands.variables:
        return ""
    amounts = ((v.name, *(f"{x} {v.unit}".rstrip() for x in (f"{v.value:.6g}", f"{v.tolerance:.4g}"))) for v in bands.variables)
    lines = [f"- {name}: {value} ± {tolerance}" for name, value, tolerance in amounts]
    for plot in plots:
        if plot.half is None:
            continue
        for name, half in zip(plot.names, plot.half.T, strict=True):
            if np.isfinite(half).any():
                label = plot.title if len(plot.names) == 1 or name == plot.title else f"{plot.title}, {name}"
                lines.append(f"- {label}: at most ± {np.nanmax(half):.3g} {plot.unit}, all tolerances added up")
    if bands.missing_reason:
        lines.append(f"- Some curves have no band: {bands.missing_reason}")
    return "\n".join(["", "", "## Tolerances", "", *lines, ""])


def _axes(catalogue: Catalogue, frames: ChosenFrames, pack: Pack) -> list[dict[str, Any]]:
    """Abscissas of plots other than time: coordinates of drives that are monotonic, also with cycles overlaid."""
    axes = []
    for axis in catalogue.axes[:-1]:
        values = axis.values[frames.rows]
        decimals = catalogue.numbers.units.decimals("m" if axis.turn is None else "rad")
        axes.append({"title": axis.label, "unit": axis.unit, "decimals": decimals, "values": pack.floats(values)})
        if axis.turn is not None and np.ptp(values) > (1.0 + 1.0 / 360.0) * axis.turn:
            axes.append(axes[-1] | {"title": f"{axis.label}, cycles overlaid", "values": pack.floats(values), "turn": axis.turn})
    return axes


def playback_speed(shown: Presentation) -> float:
    """Playback speed: seconds of the run per second on the screen."""
    time = shown.picture.time
    span = float(time[-1] - time[0])
    if span <= 0.0:
        return 1.0
    if shown.simulated:  # motion under forces: in real time, unless that is too long or too short
        return float(np.clip(1.0, span / LONGEST_SHOW, span / SHORTEST_SHOW))
    return span / (SECONDS_A_CYCLE * max(1.0, span / shown.catalogue.numbers.cycle))


def _extent(picture: Picture, drawn: list[tuple[str, Any]]) -> Any:
    """The box (2, 3) [m] around all solids and drawables, which extend it beyond the solids by at most `MOST_ARROW_ROOM`; without
    accelerations."""
    bounds = _core(picture)
    room = MOST_ARROW_ROOM * float(np.ptp(bounds, axis=0)[:2].max())
    low, high = bounds[0].copy(), bounds[1].copy()
    for box in (box for group, box in drawn if box is not None and group != "acceleration"):
        low[:2] = np.minimum(low[:2], np.maximum(box[0], bounds[0][:2] - room))
        high[:2] = np.maximum(high[:2], np.minimum(box[1], bounds[1][:2] + room))
    return np.array([low, high])


def _core(picture: Picture) -> Any:
    """The box (2, 3) [m] around solids and springs."""
    bounds = picture.bounds.copy()
    for box in spring_boxes(picture):
        bounds[:, :2] = np.minimum(bounds[0, :2], box[0]), np.maximum(bounds[1, :2], box[1])
    return bounds


def _groups(picture: Picture, drawn: list[dict[str, Any]], units: Units) -> list[dict[str, Any]]:
    """Groups that can be shown and hidden: names, colours on light and dark backgrounds, initial state, scales of arrows."""
    present = {d["group"] for d in drawn}
    forces = bool(present & set(FORCE_FAMILIES))
    groups: list[dict[str, Any]] = []
    for name, family in VECTOR_FAMILIES.items():
        if name not in present:
            continue
        entry = {"name": name, "label": family.label, "meaning": family.meaning, "shown": name in FORCE_FAMILIES or not forces}
        entry["shown"] = entry["shown"] and name != "acceleration" and picture.marks
        entry |= {"light": hex_of(family.color), "dark": hex_of(family.on_dark)}
        unit, factor = units.display_unit(family.unit)
        per_metre = picture.scales.per_metre(name)
        arrows = any(d["group"] == name and d["kind"] == "arrows" for d in drawn if "kind" in d)
        if arrows and per_metre > 0.0 and per_metre != 1.0:
            value = round_value(LEGEND_ARROW * float(np.ptp(picture.bounds, axis=0)[:2].max()) * per_metre * factor)
            entry |= {"length": value / (per_metre * factor), "value": f"{value:g} {unit}"}
        groups.append(entry)
    groups += [{"name": k, "label": v, "shown": k not in HIDDEN_DIAGRAMS} for k, v in GROUP_LABELS.items() if k in present]
    return [*groups, {"name": "names", "label": "Names", "shown": picture.marks}]
