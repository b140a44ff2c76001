"""Ink of pens: lines that grow with the frames, and the sheet that they are drawn on."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.arrays import Flags, Index, Real
from mechviz.picture.nodes import Color, Lines
from mechviz.picture.proportions import in_space

if TYPE_CHECKING:
    from mechcore.spec.studies import PenStudy
    from mechviz.meshes.solids import Solids
    from mechviz.runs import Run

INK: Color = (236, 206, 120)
SHEET: Color = (150, 156, 168)
THICK, THIN = 0.0022, 0.0012  # radii of ink and of the sheet's edge, in sizes of the mechanism
_FINE = 2e-4  # in sizes of the mechanism: ink is drawn to this
_EDGE = 0.12  # of what is drawn: the sheet is larger by this on all sides


def pen_down(run: Run, pen: PenStudy) -> Flags:
    """At which frames (F,) a pen is on the paper."""
    if pen.joint is None:
        return np.ones(run.motion.frames, bool)
    at = run.motion.coordinate(pen.joint)[:, 0]
    return np.asarray(at <= pen.level if pen.below else at >= pen.level)


def ink_nodes(run: Run, solids: Solids) -> Iterator[Lines]:
    """The lines of all pens, one strip a stroke, behind the parts: at each frame what is drawn until then."""
    size, height = solids.size, float(solids.bounds[0][2])
    for pen in run.motion.mechanism.studies.pens:
        places = run.motion.point(pen.link, pen.point)
        strokes = [s for s in drawn_strokes(pen_down(run, pen)) if len(s) > 1]
        if not strokes:
            continue
        strips = tuple(in_space(strip, height) for strip in growing(places, strokes, _FINE * size))
        common: dict[str, Any] = {"owner": ("point", f"{pen.link}.{pen.point}"), "height": height}
        yield Lines(
            f"ink.{pen.name}",
            group="ink",
            entity=("mechanism", "ink", pen.name),
            strips=strips,
            colors=(INK,),
            radii=(THICK * size,),
            **common,
        )
        inked = places[np.concatenate(strokes)]
        low, high = inked.min(axis=0), inked.max(axis=0)
        edge = _EDGE * float((high - low).max())
        (x0, y0), (x1, y1) = low - edge, high + edge
        corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])
        sheet = (in_space(corners[None], height),)
        entity = ("mechanism", "sheets", pen.name)
        yield Lines(
            f"sheet.{pen.name}", group="sheet", entity=entity, strips=sheet, colors=(SHEET,), radii=(THIN * size,), **common
        )


def drawn_strokes(down: Flags) -> list[Index]:
    """The frames of each stroke, one after the other, from flags (F,) of a pen that is down."""
    frames = np.flatnonzero(down)
    return np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1) if len(frames) else []


def growing(places: Real, strokes: list[Index], fine: float) -> Iterator[Real]:
    """Strips (F, n, 2) of strokes along places (F, 2): of each the points that it needs to be right within ``fine`` [m].

    A point that is not reached yet lies where the pen is, or where it last was on the paper.
    """
    down = np.zeros(len(places), int)
    every = np.concatenate(strokes)
    down[every] = every
    last = np.maximum(np.maximum.accumulate(down), every[0])  # the frame at which the pen was on the paper last
    for stroke in strokes:
        kept = stroke[_needed(places[stroke], fine)]
        until = np.minimum(
            kept[None, :], last[:, None]
        )  # of a stroke that is not begun all points lie at the end of the one before
        yield places[until]


def _needed(z: Real, fine: float) -> Index:
    """The points (n, 2) of a line that keep it within ``fine`` (Douglas and Peucker)."""
    keep = np.zeros(len(z), bool)
    keep[[0, -1]] = True
    parts = [(0, len(z) - 1)]
    while parts:
        a, b = parts.pop()
        if b - a < 2:
            continue
        chord, inner = z[b] - z[a], z[a + 1 : b] - z[a]
        square = float(chord @ chord)
        along = np.clip(inner @ chord / square, 0.0, 1.0) if square > 0.0 else np.zeros(len(inner))
        far = np.hypot(*(inner - along[:, None] * chord).T)
        k = int(np.argmax(far))
        if far[k] > fine:
            keep[a + 1 + k] = True
            parts += [(a, a + 1 + k), (a + 1 + k, b)]
    return np.flatnonzero(keep)
