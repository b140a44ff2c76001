"""What a page can plot: the float64 numbers of a recording by quantity, in units for people, and which are shown at first."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..record.paths import parts_of
from .frames import Frames, Progress, quiet

if TYPE_CHECKING:
    from ..record import Recording

__all__ = ["Plot", "find_plots", "first_plots"]

Real = NDArray[np.float64]

UNITS = {"m": ("mm", 1e3), "rad": ("°", 180.0 / np.pi)}
PURE = {"": "1"}
ROUND_OFF = 1e-9  # of the largest value of the same unit
MOST_FIRST = 4
ORDER = {"velocity": 0, "position": 1, "acceleration": 2}

WORDS = {
    ("pose", "mm"): "position",
    ("pose", "°"): "angle",
    ("velocity", "rad/s"): "angular velocity",
    ("acceleration", "rad/s²"): "angular acceleration",
    ("inertia", "N"): "inertia force",
    ("inertia", "N m"): "inertia moment",
    ("reaction", "N m"): "couple",
    ("friction", "N m"): "friction couple",
}
MOTION = {
    "slide": "displacement",
    "slide rate": "velocity",
    "slide acceleration": "acceleration",
    "angle rate": "angular velocity",
    "angle acceleration": "angular acceleration",
}
LENGTHS: dict[tuple[str, ...], str] = {("Fx", "Fy"): "|F|", ("vx", "vy"): "|v|", ("ax", "ay"): "|a|"}
SKIPPED = {("joints", "position"), ("links", "properties"), ("drive", "wrench")}


@dataclass(frozen=True, eq=False)
class Plot:
    """Curves ``values`` (frames, n) of one unit. ``x`` (frames,): what they run against where that is neither time nor the drive,
    as in a phase diagram; ``equal``: both axes in one scale, as in a polar plot."""

    title: str
    unit: str
    names: tuple[str, ...]
    values: Real
    key: tuple[str, ...]  # where it is from: parts of the entity, and the name of the column where there is one
    x: Real | None = None
    x_title: str = ""
    equal: bool = False

    @property
    def varies(self) -> bool:
        """Whether there is anything to see but level lines."""
        return bool(np.any(np.nanmax(self.values, axis=0) > np.nanmin(self.values, axis=0)))


def find_plots(recording: Recording, frames: Frames, progress: Progress = quiet) -> list[Plot]:
    """All plots of a recording, those of the whole mechanism first."""
    frame = recording.model["frame"]
    found: list[Plot] = []
    for done, path in enumerate(recording.entities):
        progress(done, len(recording.entities))
        parts = parts_of(path)
        if (
            parts[0] not in ("plots", "data", "health")
            or (parts[1], parts[-1]) in SKIPPED
            or parts[1:3] == ("links", frame)
            or parts[:2] == ("plots", "events")
        ):
            continue
        if not recording.has(path):
            continue
        ns, values = recording.scalars(path)
        row = np.clip(np.searchsorted(ns, frames.ns, side="right") - 1, 0, None)
        found += _of_entity(recording, path, parts, values[row])
    found = _without_noise(found)
    found += [p for p in (_polar(plot) for plot in found) if p is not None]
    found += _phases(found)
    order = {"plots": 0, "cams": 1, "drive": 2, "energy": 3, "power": 4, "joints": 5, "points": 6, "links": 7, "loads": 8}
    return sorted(found, key=lambda p: (p.key[0] == "health", p.x is not None, order.get(_kind(p), 9)))


def first_plots(recording: Recording, plots: list[Plot]) -> list[int]:
    """Numbers of the plots that a page opens with: cams, efforts, reactions, then what the mechanism moves."""
    model = recording.model

    def having(*starts: tuple[str, ...]) -> list[int]:
        return [k for start in starts for k, p in enumerate(plots) if p.key[: len(start)] == start and p.x is None]

    drives = set(model["drives"])
    at_frame = [j for j, about in model["joints"].items() if model["frame"] in about["links"] and j not in drives]
    sliders = [j for j in at_frame if plots_of_slide(plots, j)]
    cams = [k for k in having(("data", "cams")) if plots[k].names[0] in ("pressure angle", "lift") and plots[k].varies]
    efforts = having(("plots", "torque"), ("plots", "force")) or [
        k for d in model["drives"] for name in ("torque", "force") for k in having(("data", "drive", d, name))
    ]
    studies = having(("plots", "shaking moment"), ("data", "reduced"))
    energy = having(("data", "energy")) if "duration" in recording.properties else []
    phases = [k for k, p in enumerate(plots) if p.x is not None and not p.equal]
    moved = having(("plots", "displacement"), ("plots", "angle"), ("plots", "velocity"))
    points = sorted(having(("data", "points")), key=lambda k: (plots[k].key[2], ORDER.get(plots[k].key[-1], 3)))
    motion = [k for j in sliders for k in having(("data", "joints", j, "motion"))][:2]
    rest = [k for j in at_frame for k in having(("data", "joints", j, "motion"))][:2]
    wanted = [*cams[:2], *studies[:1], *efforts[:1], *having(("plots", "reactions"))[:1]]
    wanted += [
        *energy,
        *(motion or moved[:2] or [k for k in points if "centre of mass" not in plots[k].title][:2] or rest or points[:2]),
    ]
    wanted += [*phases[:1]]
    return list(dict.fromkeys(wanted))[:MOST_FIRST] or list(range(min(2, len(plots))))


def plots_of_slide(plots: list[Plot], joint: str) -> bool:
    """Whether a joint's coordinate is a displacement."""
    return any(p.key[:4] == ("data", "joints", joint, "motion") and p.unit == "mm" for p in plots)


def _kind(plot: Plot) -> str:
    return plot.key[0] if plot.key[0] == "plots" else plot.key[1]


def _of_entity(recording: Recording, path: str, parts: tuple[str, ...], values: Real) -> list[Plot]:
    """The plots of one entity: one for each unit, of drives and joints one for each column."""
    named = recording.static(path, component="SeriesLines:names")
    names = (
        [str(n) for n in named] if named is not None and len(named) == values.shape[1] else [str(k) for k in range(values.shape[1])]
    )
    columns: list[tuple[str, str]] = []
    for name in names:
        match = re.fullmatch(r"(.*?) ?\[([^\]]*)\]", name)
        text, unit = (match[1], match[2]) if match else (name, "")
        columns.append((_short(text, parts), unit))
    groups: dict[tuple[str, str], list[int]] = {}
    apart = parts[:2] == ("data", "drive") or parts[-1] == "motion"
    for k, (name, unit) in enumerate(columns):
        if np.isfinite(values[:, k]).any():
            groups.setdefault((unit, name if apart else ""), []).append(k)
    found = []
    for (unit, _), chosen in groups.items():
        shown, factor = (unit, 1.0) if parts[0] == "health" else UNITS.get(unit, (unit, 1.0))
        curves = [columns[k][0] for k in chosen]
        data = values[:, chosen] * factor
        length = LENGTHS.get(tuple(curves[:2]))
        if length is not None and len(curves) == 2:
            curves, data = [*curves, length], np.column_stack([data, np.hypot(data[:, 0], data[:, 1])])
        key = (*parts, curves[0]) if len(curves) == 1 else parts
        found.append(Plot(_title(parts, shown, curves), PURE.get(shown, shown), tuple(curves), data, key))
    return found


def _short(name: str, parts: tuple[str, ...]) -> str:
    """The name of a column without what its plot's title says."""
    if parts[0] != "data" or parts[1] == "power":
        return name
    return name.rsplit(".", 1)[-1].replace("_", " ")


def _title(parts: tuple[str, ...], unit: str, curves: list[str]) -> str:
    """What a plot shows, in words."""
    match parts:
        case ("plots", "reactions", *_):
            return "Joint reactions, magnitude" + (f", {curves[0]} … {curves[-1]}" if len(curves) > 1 else "")
        case ("plots", *words):
            return " ".join(words).replace("torque", "driving torque").replace("force", "driving force").capitalize()
        case ("health", *words):
            return "Health: " + " ".join(words).replace("_", " ")
        case ("data", "drive", item):
            return f"Drive {item}: {curves[0]}"
        case ("data", "joints", item, "motion"):
            return f"Joint {item}: {MOTION.get(curves[0], curves[0])}"
        case ("data", "links" | "joints" | "points" | "cams" as kind, item, what):
            word = WORDS.get((what, unit), what.replace("_", " "))
            if len(curves) == 1 and (what, unit) not in WORDS and curves[0] not in word:
                word = f"contact {curves[0]}" if curves[0] == "force" else curves[0]
            return f"{kind[:-1].capitalize()} {item}: {word}"
        case ("data", "loads", *item):
            return f"Load {' '.join(item)}: {'moment' if unit == 'N m' else 'point of action' if unit == 'mm' else 'force'}"
        case ("data", *words):
            return " ".join(words).replace("_", " ").capitalize()
    return " ".join(parts)


def _without_noise(plots: list[Plot]) -> list[Plot]:
    """The plots with zero for what is rounding beside the largest of its unit, but for health, which is rounding."""
    largest: dict[str, float] = {}
    for p in plots:
        if p.key[0] != "health":
            size = float(np.max(np.abs(p.values), initial=0.0, where=np.isfinite(p.values)))
            largest[p.unit] = max(largest.get(p.unit, 0.0), size)
    found = []
    for p in plots:
        values = p.values
        if p.key[0] != "health":
            values = np.where(np.abs(values) <= ROUND_OFF * largest[p.unit], 0.0, values)
        found.append(Plot(p.title, p.unit, p.names, values, p.key))
    return found


def _polar(plot: Plot) -> Plot | None:
    """The polar plot of a joint's reaction: the tip of the force over the run."""
    if plot.key[1:2] != ("joints",) or plot.key[-1] != "reaction" or plot.names[:2] != ("Fx", "Fy"):
        return None
    title = f"Joint {plot.key[2]}: polar plot of the reaction"
    return Plot(title, "N", ("Fy",), plot.values[:, 1:2], (*plot.key, "polar"), plot.values[:, 0], "Fx [N]", equal=True)


def _phases(plots: list[Plot]) -> list[Plot]:
    """Phase diagrams: rate against coordinate of every joint that does not merely turn on and on."""
    found = []
    by_key = {p.key: p for p in plots}
    for key, p in by_key.items():
        if key[:2] != ("data", "joints") or key[3:4] != ("motion",) or p.names[0] not in ("slide", "angle"):
            continue
        rate = by_key.get((*key[:4], f"{p.names[0]} rate"))
        steps = np.diff(p.values[:, 0])
        if rate is None or np.all(steps >= 0.0) or np.all(steps <= 0.0):
            continue
        title = f"Joint {key[2]}: phase diagram, velocity against {'angle' if p.unit == '°' else 'displacement'}"
        found.append(
            Plot(title, rate.unit, ("velocity",), rate.values, (*key[:4], "phase"), p.values[:, 0], f"{p.names[0]} [{p.unit}]")
        )
    return found


def pack_plot(plot: Plot, pack: Any) -> dict[str, Any]:
    """A plot for the page's header."""
    more = {} if plot.x is None else {"x": pack.floats(plot.x), "x_title": plot.x_title, "equal": plot.equal}
    return {"title": plot.title, "unit": plot.unit, "names": list(plot.names), "values": pack.floats(plot.values), **more}
