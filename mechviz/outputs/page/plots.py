"""Plots of a page: the quantities of the catalogue, and which are shown at first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mechcore.arrays import Real
from mechviz.outputs.page.pack import Frames
from mechviz.quantities.catalogue import Catalogue

ROUND_OFF = 1e-9  # of the largest value of the same unit
MOST_FIRST = 4
MOST_REACTIONS = 6  # joints in one plot


@dataclass(frozen=True, eq=False)
class Plot:
    """Curves ``values`` (frames, n) of one unit. ``x`` (frames,): what they run against where that is neither time nor the drive,
    as in a phase diagram; ``equal``: both axes in one scale, as in a polar plot; ``half`` (frames, n): half the widths of their
    tolerance bands."""

    title: str
    unit: str
    names: tuple[str, ...]
    values: Real
    key: str  # of its quantity
    x: Real | None = None
    x_title: str = ""
    equal: bool = False
    half: Real | None = None

    @property
    def varies(self) -> bool:
        """Whether there is anything to see but level lines."""
        return bool(np.any(np.nanmax(self.values, axis=0) > np.nanmin(self.values, axis=0)))


def find_plots(catalogue: Catalogue, frames: Frames, halves: Mapping[str, Real]) -> list[Plot]:
    """All plots, those of several items first: what belongs side by side, and the catalogue. ``halves`` (F, n): half widths of
    tolerance bands by the keys of quantities."""
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
    """Quantities of several items that share a plot: efforts, reactions, what the mechanism moves, shaking moments."""
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
    at_frame = [j.name for j in n.joints.values() if n.frame in j.links and j.name not in n.drives]
    for kind, rates in (("displacement", ("velocity", "acceleration")), ("angle", ("angular_velocity", "angular_acceleration"))):
        moved = [name for name in at_frame if n.slides(name) == (kind == "displacement")]
        for what in (kind, *rates):
            title = f"Joints at the frame, {what.replace('_', ' ')}"
            yield from together(title, f"plots.{what}", {name: f"joint.{name}.{what}" for name in moved})
    balance = {"shaking moment": "shaking.moment", "with counterweights": "shaking.balanced.moment"}
    yield from together("Shaking moment", "plots.shaking moment", balance)


def first_plots(catalogue: Catalogue, plots: list[Plot], *, simulated: bool) -> list[int]:
    """Numbers of the plots that a page opens with: cams, efforts, reactions, then what the mechanism moves."""
    n = catalogue.numbers

    def having(*starts: str) -> list[int]:
        return [k for start in starts for k, p in enumerate(plots) if p.key.startswith(start) and p.x is None]

    at_frame = [j.name for j in n.joints.values() if n.frame in j.links and j.name not in n.drives]
    cams = [k for k in having("cam.") if plots[k].names[0] in ("pressure angle", "lift") and plots[k].varies]
    single = [f"drive.{name}.{effort}" for name in n.drives for effort in ("torque", "force")]
    efforts = having("plots.torque", "plots.force") or having(*single)
    energy = having("energy") if simulated else []
    phases = [k for k, p in enumerate(plots) if p.x is not None and not p.equal]
    moved = having("plots.displacement", "plots.angle", "plots.velocity") if not n.traced else []
    points = having(*(f"point.{name}.{what}" for name in n.traced for what in ("velocity", "position", "acceleration")))
    motion = having(*(f"joint.{j}.{what}" for j in at_frame if n.slides(j) for what in ("displacement", "velocity")))[:2]
    rest = having(*(f"joint.{j}.{what}" for j in at_frame for what in ("angle", "angular_velocity")))[:2]
    wanted = [*cams[:2], *having("plots.shaking moment", "shaking.moment", "reduced.")[:1], *efforts[:1]]
    wanted += having("plots.reactions")[:1]
    wanted += [*energy, *(motion or moved[:2] or points[:2] or rest or having("point.")[:2]), *phases[:1]]
    return list(dict.fromkeys(wanted))[:MOST_FIRST] or list(range(min(2, len(plots))))


def _without_noise(plots: list[Plot]) -> list[Plot]:
    """The plots with zero for what is rounding beside the largest of its unit, but for health, which is rounding."""
    largest: dict[str, float] = {}
    for p in plots:
        if not p.key.startswith("health."):
            size = float(np.max(np.abs(p.values), initial=0.0, where=np.isfinite(p.values)))
            largest[p.unit] = max(largest.get(p.unit, 0.0), size)
    kept = []
    for p in plots:
        values = p.values
        if not p.key.startswith("health."):
            values = np.where(np.abs(values) <= ROUND_OFF * largest[p.unit], 0.0, values)
        kept.append(replace(p, values=values))
    return kept


def _polar(plot: Plot) -> Plot | None:
    """The polar plot of a joint's reaction: the tip of the force over the run."""
    if not plot.key.startswith("joint.") or not plot.key.endswith(".reaction"):
        return None
    title = f"{plot.title.partition(':')[0]}: polar plot of the reaction"
    return Plot(title, "N", ("Fy",), plot.values[:, 1:2], f"{plot.key}.polar", plot.values[:, 0], "Fx [N]", equal=True)


def _phases(plots: list[Plot]) -> list[Plot]:
    """Phase diagrams: rate against coordinate of every joint that does not merely turn on and on."""
    phases = []
    by_key = {p.key: p for p in plots}
    for key, p in by_key.items():
        joint, _, what = key.rpartition(".")
        rate = by_key.get(f"{joint}.{'velocity' if what == 'displacement' else 'angular_velocity'}")
        if not joint.startswith("joint.") or what not in ("displacement", "angle") or rate is None:
            continue
        steps = np.diff(p.values[:, 0])
        if not (np.all(steps >= 0.0) or np.all(steps <= 0.0)):
            title = f"{p.title.partition(':')[0]}: phase diagram, velocity against {what}"
            phases.append(
                Plot(title, rate.unit, ("velocity",), rate.values, f"{joint}.phase", p.values[:, 0], f"{what} [{p.unit}]")
            )
    return phases


def pack_plot(plot: Plot, pack: Any) -> dict[str, Any]:
    """A plot for the page's header."""
    more = {} if plot.x is None else {"x": pack.floats(plot.x), "x_title": plot.x_title, "equal": plot.equal}
    more |= {} if plot.half is None else {"half": pack.floats(plot.half)}
    return {"title": plot.title, "unit": plot.unit, "names": list(plot.names), "values": pack.floats(plot.values), **more}
