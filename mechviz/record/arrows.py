"""Arrows and arcs: which vectors and moments of a run are drawn where, and the shape of an arc."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..proportions import ARC_RADIUS
from ..tables import joints_of, links_with_mass
from ..vectors import (
    FAMILIES,
    LARGEST_ARC,
    LARGEST_ARROW,
    Moment,
    Scales,
    Vector,
    calm_frames,
    centre_name,
    find_moments,
    find_scales,
    find_vectors,
)

if TYPE_CHECKING:
    from ..run import Run

__all__ = ["COLORS", "Arc", "Arrow", "arc_strips", "arc_sweep", "extent", "seen", "shapes", "visible"]

Real = NDArray[np.float64]
Flags = NDArray[np.bool_]


def lighter(channel: int) -> int:
    """A colour channel on a dark ground."""
    return round(0.6 * channel + 102)


_LIGHTER: Mapping[str, tuple[int, int, int]] = {
    "reaction": (255, 72, 84),
    "applied": (255, 138, 20),
    "gravity": (214, 178, 130),
    "inertia": (208, 112, 246),
    "drive": (72, 222, 128),
    "friction": (255, 214, 92),
    "velocity": (84, 168, 255),
    "acceleration": (52, 214, 220),
}
COLORS: Mapping[str, tuple[int, int, int]] = {
    name: _LIGHTER.get(name, (lighter(family.color[0]), lighter(family.color[1]), lighter(family.color[2])))
    for name, family in FAMILIES.items()
}
"""The hues that the viewer gives to the families, lighter: the background is dark."""

LONGEST = 1.4  # in sizes of the mechanism: only near a jam, where forces grow beyond all bounds, and there left out
SHORTEST = 0.015  # in sizes of the mechanism; what is shorter is left out
ARC_POINTS = 24
LEGEND_ROOM = 0.2  # in sizes of the mechanism: below solids and arrows, for the legend of the arrows


@dataclass(frozen=True, eq=False)
class Arrow:
    """Vectors of a run and the entity that draws them."""

    path: tuple[str, ...]
    vector: Vector


@dataclass(frozen=True, eq=False)
class Arc:
    """Moments of a run and the entity that draws them, at frames where ``shown`` (F,)."""

    path: tuple[str, ...]
    moment: Moment
    shown: Flags


def shapes(run: Run, size: float) -> tuple[list[Arrow], list[Arc], Scales]:
    """All arrows and arcs of a run with their scales; ``size`` [m] is the mechanism's."""
    vectors = _with_all_reactions(run, find_vectors(run))
    counted = {centre_name(link) for link in links_with_mass(run)}
    idle = {centre_name(link.name) for link in run.motion.mechanism.links} - counted  # masses that no effect asks for
    arrows = [
        Arrow(("vectors", family, name), vector)
        for family, items in vectors.items()
        for name, vector in items.items()
        if name not in idle or family not in ("velocity", "acceleration")
    ]
    kept = {f: {a.vector.item: a.vector for a in arrows if a.vector.family == f} for f in vectors}
    friction = None if run.forces is None else run.forces.friction
    pins = set() if friction is None else {e.pair for e in friction.elements if e.kind == "pin"}
    everywhere = np.ones(run.motion.frames, bool)
    arcs = [
        Arc(_arc_path(family, name), moment, everywhere)
        for family, items in find_moments(run).items()
        for name, moment in items.items()
        if family != "friction" or name not in pins  # these have their friction circle
    ]
    arcs += _inertia_moments(run, arrows, find_scales(kept, {}, size, calm_frames(run)), size)
    scales = find_scales(kept, _by_family(arcs), size, calm_frames(run))
    return arrows, arcs, scales


def _with_all_reactions(run: Run, vectors: dict[str, dict[str, Vector]]) -> dict[str, dict[str, Vector]]:
    """The vectors with the reactions of joints that a pair brings along, such as the pins of a cylinder."""
    forces = run.forces
    if forces is None:
        return vectors
    known = vectors.get("reaction", {})
    more = {
        j.name: Vector("reaction", j.name, forces.position(j.name), forces.reaction(j.name)[:, :2])
        for j in joints_of(run.motion)
        if j.name not in known
    }
    return {**vectors, "reaction": {**known, **more}}


def visible(vectors: Real, scale: float, size: float) -> Flags:
    """Which vectors (F, 2) are finite, long enough to be seen and short enough to make sense (F,)."""
    length = np.hypot(vectors[:, 0], vectors[:, 1]) / (size * scale)
    return np.isfinite(length) & (length > SHORTEST) & (length < LONGEST)


def seen(shape: Arrow | Arc, scales: Scales, size: float) -> bool:
    """Whether an arrow or arc is drawn at any frame."""
    if isinstance(shape, Arrow):
        return bool(visible(shape.vector.value, scales.per_metre(shape.vector.family), size).any())
    return bool(arc_sweep(shape.moment.value, scales.newton_metres_per_metre, size)[shape.shown].any())


def extent(arrows: list[Arrow], scales: Scales, bounds: Real, size: float) -> Real:
    """The box (2, 3) [m] around the mechanism and its arrows; arrows that lie far outside do not count in full."""
    low, high = np.array(bounds[0]), np.array(bounds[1])
    room = LARGEST_ARROW * size
    for arrow in arrows:
        scale = scales.per_metre(arrow.vector.family)
        shown = visible(arrow.vector.value, scale, size)
        if shown.any():
            tips = arrow.vector.origin[shown] + arrow.vector.value[shown] / scale
            low[:2] = np.minimum(low[:2], np.maximum(tips.min(axis=0), bounds[0][:2] - room))
            high[:2] = np.maximum(high[:2], np.minimum(tips.max(axis=0), bounds[1][:2] + room))
    if arrows:
        low[1] -= LEGEND_ROOM * size  # for the legend
    return np.array([low, high])


def arc_sweep(moments: Real, scale: float, size: float) -> Real:
    """Signed angles (F,) [rad] that arcs span so that their length stands for moments (F,) [N m]; 0 where too short to see."""
    sweep = np.nan_to_num(moments / (scale * ARC_RADIUS * size))
    most = LARGEST_ARC / ARC_RADIUS
    sweep = np.clip(sweep, -most, most)
    return np.where(np.abs(sweep) * ARC_RADIUS > SHORTEST, sweep, 0.0)


def arc_strips(centres: Real, sweep: Real, z: float, size: float) -> NDArray[np.float32]:
    """Arcs with arrow heads about centres (n, 2), spanning angles (n,), each drawn as one strip: (n, points, 3)."""
    radius = ARC_RADIUS * size
    # the arc opens evenly about the vertical
    angles = 0.5 * np.pi + sweep[:, None] * np.linspace(-0.5, 0.5, ARC_POINTS)
    arc = centres[:, None] + radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    end = angles[:, -1]
    along = np.sign(sweep)[:, None] * np.column_stack([-np.sin(end), np.cos(end)])
    across = np.column_stack([np.cos(end), np.sin(end)])
    head = 0.3 * radius
    tip = arc[:, -1] + 0.5 * head * along
    barbs = [tip - head * along + side * 0.6 * head * across for side in (1, -1)]
    strip = np.concatenate([arc, np.stack([tip, barbs[0], tip, barbs[1]], axis=1)], axis=1)
    return np.concatenate([strip, np.full((*strip.shape[:2], 1), z)], axis=-1).astype(np.float32)


def _arc_path(family: str, name: str) -> tuple[str, ...]:
    """A reaction's couple has an entity beside that of its force."""
    return ("vectors", family, name) if family in ("drive", "applied") else ("vectors", family, name, "couple")


def _by_family(arcs: list[Arc]) -> dict[str, dict[str, Moment]]:
    found: dict[str, dict[str, Moment]] = {}
    for arc in arcs:
        found.setdefault(arc.moment.family, {})[arc.moment.item] = arc.moment
    return found


def _inertia_moments(run: Run, arrows: list[Arrow], scales: Scales, size: float) -> list[Arc]:
    """Inertia moments of links at frames where no inertia force is there to carry them: arcs about the centre of mass."""
    forces = run.forces
    if forces is None or "inertia" not in run.motion.mechanism.effects:
        return []
    resultants = {a.vector.item: a.vector.value for a in arrows if a.vector.family == "inertia"}
    found = []
    for link in links_with_mass(run):
        values = resultants.get(link, np.zeros((run.motion.frames, 2)))
        alone = ~visible(values, scales.newtons_per_metre, size)
        moment = np.where(alone, forces.inertia(link)[:, 2], 0.0)
        if np.any(moment):
            centre = run.motion.centre_of_mass(link)
            found.append(Arc(("vectors", "inertia", link, "moment"), Moment("inertia", link, centre, moment), alone))
    return found
