"""What a page can plot: the float64 numbers of a recording by quantity, in units for people, and which are shown at first."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mechviz.outputs.page.frames import Frames
from mechviz.outputs.rerun.paths import parts_of
from mechviz.quantities.catalogue import Catalogue
from mechviz.quantities.entries import UNITS

if TYPE_CHECKING:
    from mechviz.outputs.rerun.reader import Recording


Real = NDArray[np.float64]

ROUND_OFF = 1e-9  # of the largest value of the same unit
MOST_FIRST = 4


@dataclass(frozen=True, eq=False)
class Plot:
    """Curves ``values`` (frames, n) of one unit. ``x`` (frames,): what they run against where that is neither time nor the drive,
    as in a phase diagram; ``equal``: both axes in one scale, as in a polar plot."""

    title: str
    unit: str
    names: tuple[str, ...]
    values: Real
    key: str  # of its quantity
    x: Real | None = None
    x_title: str = ""
    equal: bool = False

    @property
    def varies(self) -> bool:
        """Whether there is anything to see but level lines."""
        return bool(np.any(np.nanmax(self.values, axis=0) > np.nanmin(self.values, axis=0)))


def find_plots(recording: Recording, catalogue: Catalogue, frames: Frames) -> list[Plot]:
    """All plots of a recording, those of several items first: what the recorder gathers, and the catalogue."""
    row = np.clip(np.searchsorted(np.round(1e9 * catalogue.numbers.time), frames.ns, side="right") - 1, 0, None)
    found = [*_gathered(recording, frames)]
    for q in catalogue.quantities:
        found.append(Plot(q.label[:1].upper() + q.label[1:], q.unit, q.curves, q.values()[row], q.key))
    found = _without_noise([plot for plot in found if np.isfinite(plot.values).any()])
    found += [p for p in (_polar(plot) for plot in found) if p is not None]
    found += _phases(found)
    return sorted(found, key=lambda p: (p.key.startswith("health."), p.x is not None, not p.key.startswith("cam.")))


def _gathered(recording: Recording, frames: Frames) -> Iterator[Plot]:
    """Series of several items that share a plot."""
    for path in recording.entities:
        kind, *words = parts_of(path)
        names = recording.static(path, component="SeriesLines:names")
        if kind != "plots" or words[0] == "events" or names is None or not recording.has(path):
            continue
        ns, values = recording.scalars(path)
        matches = [re.fullmatch(r"(.*?) ?\[([^\]]*)\]", str(name)) for name in names]
        curves = tuple(match[1] if match else str(name) for match, name in zip(matches, names, strict=True))
        shown, factor = UNITS.get(unit := matches[0][2] if matches[0] else "1", (unit, 1.0))
        title = " ".join(words).replace("torque", "driving torque").replace("force", "driving force").capitalize()
        if words[0] == "reactions":
            title = "Joint reactions, magnitude" + (f", {curves[0]} … {curves[-1]}" if len(curves) > 1 else "")
        row = np.clip(np.searchsorted(ns, frames.ns, side="right") - 1, 0, None)
        yield Plot(title, shown, curves, factor * values[row], f"plots.{words[0]}")


def first_plots(recording: Recording, catalogue: Catalogue, plots: list[Plot]) -> list[int]:
    """Numbers of the plots that a page opens with: cams, efforts, reactions, then what the mechanism moves."""
    n = catalogue.numbers

    def having(*starts: str) -> list[int]:
        return [k for start in starts for k, p in enumerate(plots) if p.key.startswith(start) and p.x is None]

    at_frame = [j.name for j in n.joints.values() if n.frame in j.links and j.name not in n.drives]
    cams = [k for k in having("cam.") if plots[k].names[0] in ("pressure angle", "lift") and plots[k].varies]
    single = [f"drive.{name}.{effort}" for name in n.drives for effort in ("torque", "force")]
    efforts = having("plots.torque", "plots.force") or having(*single)
    energy = having("energy") if "duration" in recording.properties else []
    phases = [k for k, p in enumerate(plots) if p.x is not None and not p.equal]
    moved = having("plots.displacement", "plots.angle", "plots.velocity")
    points = having(*(f"point.{name}.{what}" for name in n.traced for what in ("velocity", "position", "acceleration")))
    motion = having(*(f"joint.{j}.{what}" for j in at_frame if n.slides(j) for what in ("displacement", "velocity")))[:2]
    rest = having(*(f"joint.{j}.{what}" for j in at_frame for what in ("angle", "angular_velocity")))[:2]
    wanted = [*cams[:2], *having("plots.shaking moment", "reduced.")[:1], *efforts[:1], *having("plots.reactions")[:1]]
    wanted += [*energy, *(motion or moved[:2] or points[:2] or rest or having("point.")[:2]), *phases[:1]]
    return list(dict.fromkeys(wanted))[:MOST_FIRST] or list(range(min(2, len(plots))))


def _without_noise(plots: list[Plot]) -> list[Plot]:
    """The plots with zero for what is rounding beside the largest of its unit, but for health, which is rounding."""
    largest: dict[str, float] = {}
    for p in plots:
        if not p.key.startswith("health."):
            size = float(np.max(np.abs(p.values), initial=0.0, where=np.isfinite(p.values)))
            largest[p.unit] = max(largest.get(p.unit, 0.0), size)
    found = []
    for p in plots:
        values = p.values
        if not p.key.startswith("health."):
            values = np.where(np.abs(values) <= ROUND_OFF * largest[p.unit], 0.0, values)
        found.append(Plot(p.title, p.unit, p.names, values, p.key))
    return found


def _polar(plot: Plot) -> Plot | None:
    """The polar plot of a joint's reaction: the tip of the force over the run."""
    if not plot.key.startswith("joint.") or not plot.key.endswith(".reaction"):
        return None
    title = f"{plot.title.partition(':')[0]}: polar plot of the reaction"
    return Plot(title, "N", ("Fy",), plot.values[:, 1:2], f"{plot.key}.polar", plot.values[:, 0], "Fx [N]", equal=True)


def _phases(plots: list[Plot]) -> list[Plot]:
    """Phase diagrams: rate against coordinate of every joint that does not merely turn on and on."""
    found = []
    by_key = {p.key: p for p in plots}
    for key, p in by_key.items():
        joint, _, what = key.rpartition(".")
        rate = by_key.get(f"{joint}.{'velocity' if what == 'displacement' else 'angular_velocity'}")
        if not joint.startswith("joint.") or what not in ("displacement", "angle") or rate is None:
            continue
        steps = np.diff(p.values[:, 0])
        if not (np.all(steps >= 0.0) or np.all(steps <= 0.0)):
            title = f"{p.title.partition(':')[0]}: phase diagram, velocity against {what}"
            found.append(Plot(title, rate.unit, ("velocity",), rate.values, f"{joint}.phase", p.values[:, 0], f"{what} [{p.unit}]"))
    return found


def pack_plot(plot: Plot, pack: Any) -> dict[str, Any]:
    """A plot for the page's header."""
    more = {} if plot.x is None else {"x": pack.floats(plot.x), "x_title": plot.x_title, "equal": plot.equal}
    return {"title": plot.title, "unit": plot.unit, "names": list(plot.names), "values": pack.floats(plot.values), **more}
