"""A recording as the text that a page plays: solids, poses, arrows, plots, events, states and notes on one timeline."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mechviz.outputs.page.frames import MOST_FRAMES, Frames, Progress, find_frames, quiet
from mechviz.outputs.page.markdown import html_of
from mechviz.outputs.page.pack import Pack
from mechviz.outputs.page.plots import find_plots, first_plots, pack_plot
from mechviz.outputs.page.shapes import bounds_of, find_bodies, find_drawables, find_links
from mechviz.outputs.rerun.nodes import COLORS
from mechviz.outputs.rerun.numbers import numbers_in
from mechviz.outputs.rerun.paths import parts_of
from mechviz.quantities.catalogue import Catalogue
from mechviz.quantities.vectors import FAMILIES, FORCE_FAMILIES, round_value

if TYPE_CHECKING:
    from mechviz.outputs.rerun.reader import Recording


SCHEMA = 1
SECONDS_A_CYCLE = 5.0  # a cycle on the screen
SHORTEST_SHOW, LONGEST_SHOW = 4.0, 20.0  # seconds on the screen of a motion under forces
LEGEND = 0.15  # of the mechanism's size: about how long an arrow the legend tells the value for
ROOM = 0.3  # of the mechanism's size: most room for arrows that reach beyond the solids

GROUPS = {
    "paths": "Paths",
    "springs": "Springs",
    "masses": "Masses",
    "polode": "Moving polodes",
    "polodes": "Fixed polodes",
    "funicular": "Funicular",
    "substitutes": "Substitute masses",
    "equivalent": "Equivalent linkages",
}
"""What can be shown and hidden beside the families of arrows."""


def show_text(
    recording: Recording, *, most: int = MOST_FRAMES, keep: float | None = None, plots: bool = True, progress: Progress = quiet
) -> tuple[str, Frames]:
    """The packed text of a page, and the frames in it, at most ``most`` and one at the time ``keep`` [s].

    Pictures need no ``plots``.
    """
    pack = Pack()
    frames = find_frames(recording, most, keep)
    properties = recording.properties
    catalogue = Catalogue(numbers_in(recording))
    curves = find_plots(recording, catalogue, frames) if plots else []
    drawables = find_drawables(recording, frames, pack, progress)
    bounds = bounds_of(recording, frames)
    bodies = find_bodies(recording, frames, pack)
    header = {
        "schema": SCHEMA,
        "title": str(properties.get("title", "")) or "Mechanism",
        "teaches": _teaches(recording.notes),
        "version": str(properties.get("version", "")),
        "frames": len(frames.chosen),
        "total": frames.total,
        "time": pack.floats(frames.time),
        "axes": _axes(frames, pack),
        "pace": _pace(recording, frames),
        "opening": int(np.argmin(np.abs(frames.time - catalogue.numbers.time[catalogue.opening]))),
        "bounds": bounds.tolist(),
        "drawn": _drawn(bounds, drawables, bodies).tolist(),
        "links": find_links(recording, frames, pack),
        "bodies": bodies,
        "drawables": drawables,
        "groups": _groups(recording, drawables, bodies, bounds),
        "plots": [pack_plot(p, pack) for p in curves],
        "first": first_plots(recording, catalogue, curves),
        "lanes": _lanes(recording),
        "events": [{"time": e.time, "level": e.level, "text": f"{e.item}: {e.text}"} for e in recording.events],
        "notes": html_of(recording.notes),
    }
    return pack.text(header), frames


def _teaches(notes: str) -> str:
    """The sentence under the title of the notes."""
    lines = [line.strip() for line in notes.splitlines() if line.strip()]
    return lines[1] if len(lines) > 1 and lines[0].startswith("# ") and not lines[1].startswith(("#", "*")) else ""


def _axes(frames: Frames, pack: Pack) -> list[dict[str, Any]]:
    """What plots can run against beside time: positions of drives that go one way only."""
    found = []
    for name, ticks in frames.drives.items():
        steps = np.diff(ticks)
        if len(ticks) > 1 and np.any(steps) and (np.all(steps >= 0) or np.all(steps <= 0)):
            unit, factor = ("°", 1e-3) if name == "drive_mdeg" else ("mm", 1e-3)
            what = "drive angle" if unit == "°" else "drive displacement"
            values = ticks * factor
            found.append({"title": what, "unit": unit, "values": pack.floats(values)})
            if unit == "°" and np.ptp(values) > 361.0:
                found.append({"title": "drive angle, cycles overlaid", "unit": unit, "values": pack.floats(values), "turn": 360.0})
    return found


def pace_of(recording: Recording) -> float:
    """Seconds of the run for a second on the screen."""
    return _pace(recording, find_frames(recording, MOST_FRAMES))


def _pace(recording: Recording, frames: Frames) -> float:
    span = float(frames.time[-1] - frames.time[0])
    if span <= 0.0:
        return 1.0
    if "duration" in recording.properties:  # motion under forces: in its own time, unless that is too long or over too soon
        return float(np.clip(1.0, span / LONGEST_SHOW, span / SHORTEST_SHOW))
    return span / (SECONDS_A_CYCLE * max(1.0, _turns(frames)))


def _turns(frames: Frames) -> float:
    ticks = frames.drives.get("drive_mdeg")
    return 1.0 if ticks is None or len(ticks) < 2 else float(np.ptp(ticks)) / 360e3


def _drawn(bounds: Any, drawables: list[dict[str, Any]], bodies: list[dict[str, Any]]) -> Any:
    """The box (2, 3) [m] around all solids, and what is drawn on them; of this counts up to `ROOM` only what reaches far beyond."""
    own = [box for body in bodies if (box := body.pop("box")) is not None]
    flat = [bounds[:, :2], *own]
    bounds = np.array([[*np.min(flat, axis=(0, 1)), bounds[0, 2]], [*np.max(flat, axis=(0, 1)), bounds[1, 2]]])
    size = float(np.ptp(bounds, axis=0)[:2].max())
    boxes = [d.pop("box") for d in drawables]
    near = [b for b, d in zip(boxes, drawables, strict=True) if b is not None and "view" not in d and d["group"] != "acceleration"]
    low, high = bounds[0].copy(), bounds[1].copy()
    for box in near:
        low[:2] = np.minimum(low[:2], np.maximum(box[0], bounds[0][:2] - ROOM * size))
        high[:2] = np.maximum(high[:2], np.minimum(box[1], bounds[1][:2] + ROOM * size))
    return np.array([low, high])


def _groups(
    recording: Recording, drawables: list[dict[str, Any]], bodies: list[dict[str, Any]], bounds: Any
) -> list[dict[str, Any]]:
    """What can be shown and hidden: names, colours on light and dark grounds, whether shown at first, the arrows' scale."""
    present = {d["group"] for d in [*drawables, *bodies]}
    forces = bool(present & set(FORCE_FAMILIES))
    scales = _scales(recording.properties)
    size = float(np.ptp(bounds, axis=0)[:2].max())
    found: list[dict[str, Any]] = []
    for name, family in FAMILIES.items():
        if name not in present:
            continue
        entry = {"name": name, "label": family.label, "meaning": family.meaning, "shown": name in FORCE_FAMILIES or not forces}
        entry["shown"] = entry["shown"] and name != "acceleration"
        entry |= {"light": _hex(family.color), "dark": _hex(COLORS[name])}
        per_metre = scales[name]
        arrows = any(d["group"] == name and d["kind"] == "arrows" for d in drawables)
        if arrows and per_metre > 0.0 and per_metre != 1.0:
            value = round_value(LEGEND * size * per_metre)
            entry |= {"length": value / per_metre, "value": f"{value:g} {family.unit}"}
        found.append(entry)
    found += [{"name": k, "label": v, "shown": True} for k, v in GROUPS.items() if k in present]
    return found


def _scales(properties: Mapping[str, Any]) -> dict[str, float]:
    """Units per metre of the arrows of each family."""
    known = {"velocity": "mps_per_metre", "acceleration": "mps2_per_metre"}
    return {name: float(properties.get(known.get(name, "newtons_per_metre"), 1.0)) for name in FAMILIES}


def _lanes(recording: Recording) -> list[dict[str, Any]]:
    """States over time: of each lane the times of its changes and its states."""
    found = []
    for path in recording.entities:
        parts = parts_of(path)
        if parts[0] != "state" or not recording.has(path):
            continue
        rows = recording.rows(path, component="StateChange:state")
        values, labels, colors = (
            recording.static(path, component=f"StateConfiguration:{name}") for name in ("values", "labels", "colors")
        )
        looks: dict[str, tuple[str, str]] = {}
        if values is not None and labels is not None and colors is not None:
            looks = {str(v): (str(w), f"#{int(c) >> 8:06x}") for v, w, c in zip(values, labels, colors, strict=True)}
        states = [looks.get(str(v), (str(v), "#888888")) for v in rows.values]
        changes = [[1e-9 * float(t), word, color] for t, (word, color) in zip(rows.time, states, strict=True)]
        found.append({"name": parts[-1], "changes": changes})
    return found


def _hex(color: tuple[int, int, int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*color)
