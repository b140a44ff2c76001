"""A page that plays a mechanism: one HTML file that needs nothing else, neither a server nor a network."""

from __future__ import annotations

from html import escape
from importlib.resources import files
from typing import Any

import numpy as np

from mechviz.outputs.page.markdown import html_of
from mechviz.outputs.page.pack import MOST_FRAMES, Frames, Pack, Progress, find_frames, quiet
from mechviz.outputs.page.plots import find_plots, first_plots, pack_plot
from mechviz.outputs.page.shapes import hex_of, pack_bodies, pack_drawables, pack_drawing, pack_links, spring_boxes
from mechviz.outputs.presentation import Presentation
from mechviz.outputs.rerun.blueprint import LONGEST_SHOW, SECONDS_A_CYCLE, SHORTEST_SHOW
from mechviz.picture.centres import CENTRES
from mechviz.picture.nodes import Picture
from mechviz.picture.overlays import DIAGRAMS, HIDDEN, INVERSION, WORDS
from mechviz.quantities.catalogue import Catalogue
from mechviz.quantities.vectors import FAMILIES, FORCE_FAMILIES, round_value

SCRIPTS = ("decode.js", "camera.js", "stage.js", "export.js", "plots.js", "drawings.js", "player.js")


def make_page(
    shown: Presentation, *, most: int = MOST_FRAMES, keep: float | None = None, plots: bool = True, progress: Progress = quiet
) -> tuple[str, Frames]:
    """The HTML of a page with at most ``most`` frames of a run, that at the time ``keep`` [s] among them; and the frames."""
    text, frames = show_text(shown, most=most, keep=keep, plots=plots, progress=progress)
    pieces = {
        "title": escape(shown.title),
        "style": _read("style.css"),
        "script": "\n".join(_read(name) for name in SCRIPTS),
        "data": text,
    }
    page = ""
    rest = _read("page.html")
    while "{{" in rest:  # in order, so that braces in what is put in are left alone
        before, _, after = rest.partition("{{")
        name, _, rest = after.partition("}}")
        page += before + pieces[name]
    return page + rest, frames


def _read(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


SCHEMA = 2
LEGEND = 0.15  # of the mechanism's size: about how long an arrow the legend tells the value for
ROOM = 0.3  # of the mechanism's size: most room for arrows that reach beyond the solids

GROUPS = {
    "paths": "Paths",
    "ink": "Ink",
    "sheet": "Sheets",
    "springs": "Springs",
    "masses": "Masses",
    "polode": "Moving polodes",
    "polodes": "Fixed polodes",
    "funicular": "Funicular",
    "substitutes": "Substitute masses",
    "equivalent": "Equivalent linkages",
    INVERSION: WORDS,
    **{group: words for group, (words, _) in CENTRES.items()},
    **{group: diagram.title for group, diagram in DIAGRAMS.items()},
}
"""Groups that can be shown and hidden beside the families of arrows."""


def show_text(
    shown: Presentation, *, most: int = MOST_FRAMES, keep: float | None = None, plots: bool = True, progress: Progress = quiet
) -> tuple[str, Frames]:
    """The packed text of a page, and the frames in it, at most ``most`` and one at the time ``keep`` [s].

    Pictures need no ``plots``.
    """
    pack = Pack()
    frames = find_frames(shown, most, keep)
    picture, catalogue = shown.picture, shown.catalogue
    curves = find_plots(catalogue, frames, shown.bands().halves) if plots else []
    drawn = pack_drawables(picture, frames, pack, progress)
    drawables = [drawable for drawable, _ in drawn]
    bodies = pack_bodies(picture, frames, pack)
    header = {
        "schema": SCHEMA,
        "title": shown.title,
        "teaches": shown.teaches,
        "version": shown.version,
        "frames": len(frames.chosen),
        "total": frames.total,
        "time": pack.floats(frames.time),
        "axes": _axes(catalogue, frames, pack),
        "pace": pace_of(shown),
        "opening": int(np.argmin(np.abs(frames.time - catalogue.numbers.time[catalogue.opening]))),
        "bounds": picture.bounds.tolist(),
        "core": _core(picture).tolist(),
        "drawn": _extent(picture, [(d["group"], box) for d, box in drawn]).tolist(),
        "links": pack_links(picture, frames, pack),
        "bodies": bodies,
        "drawables": drawables,
        "constructions": [pack_drawing(d, picture.size, frames, pack) for d in shown.drawings().values()] if plots else [],
        "groups": _groups(picture, [*drawables, *bodies]),
        "plots": [pack_plot(p, pack) for p in curves],
        "first": first_plots(catalogue, curves, simulated=shown.simulated),
        "lanes": [
            {"name": lane.name, "changes": [[t, word, hex_of(color)] for t, word, color in lane.changes]} for lane in shown.lanes
        ],
        "events": [{"time": e.time, "level": e.level, "text": f"{e.item}: {e.text}"} for e in shown.events],
        "notes": html_of(shown.notes),
    }
    return pack.text(header), frames


def _axes(catalogue: Catalogue, frames: Frames, pack: Pack) -> list[dict[str, Any]]:
    """Abscissas of plots beside time: positions of drives that go one way only."""
    axes = []
    for axis in catalogue.axes[:-1]:
        values = axis.values[frames.rows]
        axes.append({"title": axis.label, "unit": axis.unit, "values": pack.floats(values)})
        if axis.unit == "°" and np.ptp(values) > 361.0:
            title = f"{axis.label}, cycles overlaid"
            axes.append({"title": title, "unit": axis.unit, "values": pack.floats(values), "turn": 360.0})
    return axes


def pace_of(shown: Presentation) -> float:
    """Seconds of the run for a second on the screen."""
    time = shown.picture.time
    span = float(time[-1] - time[0])
    if span <= 0.0:
        return 1.0
    if shown.simulated:  # motion under forces: in its own time, unless that is too long or over too soon
        return float(np.clip(1.0, span / LONGEST_SHOW, span / SHORTEST_SHOW))
    return span / (SECONDS_A_CYCLE * max(1.0, span / shown.catalogue.numbers.cycle))


def _extent(picture: Picture, drawn: list[tuple[str, Any]]) -> Any:
    """The box (2, 3) [m] around all solids, and what is drawn on them; of this counts up to `ROOM` only what reaches far beyond."""
    bounds = _core(picture)
    room = ROOM * float(np.ptp(bounds, axis=0)[:2].max())
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


def _groups(picture: Picture, drawn: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Groups that can be shown and hidden: names, colours on light and dark grounds, whether shown at first, the arrows' scale."""
    present = {d["group"] for d in drawn}
    forces = bool(present & set(FORCE_FAMILIES))
    groups: list[dict[str, Any]] = []
    for name, family in FAMILIES.items():
        if name not in present:
            continue
        entry = {"name": name, "label": family.label, "meaning": family.meaning, "shown": name in FORCE_FAMILIES or not forces}
        entry["shown"] = entry["shown"] and name != "acceleration"
        entry |= {"light": hex_of(family.color), "dark": hex_of(family.on_dark)}
        per_metre = picture.scales.per_metre(name)
        arrows = any(d["group"] == name and d["kind"] == "arrows" for d in drawn if "kind" in d)
        if arrows and per_metre > 0.0 and per_metre != 1.0:
            value = round_value(LEGEND * float(np.ptp(picture.bounds, axis=0)[:2].max()) * per_metre)
            entry |= {"length": value / per_metre, "value": f"{value:g} {family.unit}"}
        groups.append(entry)
    groups += [{"name": k, "label": v, "shown": k not in HIDDEN} for k, v in GROUPS.items() if k in present]
    return groups
