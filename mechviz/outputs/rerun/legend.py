"""The legend of the arrows in the 3D views: an arrow of each family in its colour, of a round value, named and with its value."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from mechcore.arrays import Real
from mechviz.outputs.rerun.nodes import COLORS, LEGEND_ROOM, extent, seen
from mechviz.outputs.rerun.paths import entity, packed
from mechviz.outputs.rerun.streams import Static
from mechviz.picture.nodes import Arc, Arrow, Picture
from mechviz.quantities.vectors import FAMILIES, round_value

MOTION = ("velocity", "acceleration")
LENGTH = 0.14  # longest arrow of the legend, in sizes of the mechanism
COLUMN = 0.26  # distance of the arrows, in sizes of the mechanism
LABEL = (0.19, 0.22)  # room of a label at least and at most, in widths of the picture
ROW = 0.9  # of all labels together, where the least allows it
ASPECT = 1.5  # width of the picture over its height, about


def legend_shapes(picture: Picture, around: Real) -> Iterator[Static]:
    """``/legend/forces/<family>`` and ``/legend/motion/<family>``: static arrows and their labels.

    A family of which nothing is long enough to be drawn at any frame is left out; one of moments alone has no value.
    ``around``: the box (2, 3) [m] around what else is drawn on the mechanism; the legend stands below that, too.
    """
    scales, size = picture.scales, picture.size
    vectors, moments = [a.vector for a in picture.of(Arrow)], [a.moment for a in picture.of(Arc)]
    pointing = {v.family for v in vectors if seen(v, scales, size)}
    shown = pointing | {m.family for m in moments if seen(m, scales, size)}
    for view in ("forces", "motion"):
        drawn = [v for v in vectors if (v.family in MOTION) == (view == "motion")]
        low, high = extent(drawn, scales, picture.bounds, size)[:, :2]
        bottom = min(low[1], around[0, 1] - LEGEND_ROOM * size) + 0.25 * LEGEND_ROOM * size
        families = [f for f in FAMILIES if f in shown and (f in MOTION) == (view == "motion")]
        room = float(np.clip(ROW / max(len(families), 1), *LABEL))
        column = max(COLUMN * size, room * max(high[0] - low[0], ASPECT * (high[1] - low[1])))
        for k, family in enumerate(families):
            per_metre = scales.per_metre(family)
            words, length = FAMILIES[family].label, LENGTH * size
            if family in pointing:
                value = round_value(length * per_metre)
                length = value / per_metre
                words += f": {value:g} {FAMILIES[family].unit}"
            start = _place((k - 0.5 * (len(families) - 1)) * column, bottom, picture)
            yield from _entry(("legend", view, family), start, length, words, COLORS[family], size)


def _place(across: float, y: float, picture: Picture) -> Real:
    """Where an arrow of the legend starts: in a row, so far from the mechanism's middle [m]."""
    middle = 0.5 * (picture.bounds[0, 0] + picture.bounds[1, 0])
    return np.array([middle + across - 0.5 * LENGTH * picture.size, y, picture.top])


def _entry(
    path: tuple[str, ...], start: Real, length: float, words: str, color: tuple[int, int, int], size: float
) -> Iterator[Static]:
    import rerun as rr

    arrow: Any = rr.Arrows3D(origins=[start], vectors=[[length, 0.0, 0.0]], colors=packed([color]), radii=[0.0055 * size])
    yield Static(entity(*path), arrow)
    under = start + np.array([0.5 * length, -0.01 * size, 0.0])
    yield Static(
        entity(*path, "label"), rr.Points3D([under], radii=[1e-4 * size], colors=packed([color]), labels=[words], show_labels=True)
    )
