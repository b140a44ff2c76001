"""Labels of drawings: letters below the line, and where labels stand so that they hide neither each other nor the drawing's points:
greedily, nearest place first."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Any

import numpy as np
import viser

from mechcore.arrays import Complex, Flags, Real
from mechcore.records import dataclass
from mechviz.outputs.viewer.viser_adapter import run_script

LETTER_HALF_WIDTH, LABEL_HALF_HEIGHT = 3.6, 8.0  # half width of a letter and half height of a label [px], with a little room around
LABEL_STEPS = (0.0, 1.0, 2.0, 3.2)  # heights of a label beyond the least distance that are tried
CORNER_ROUNDS, JUDGED_FRAMES = 3, 12  # of choosing corners, and frames at which they are judged
LABEL_DIRECTIONS = 12  # directions that are tried around a point
# Where letters below the line stand in Unicode's private area, and the last one that has a place there
SUBSCRIPT_START, LAST_SUBSCRIPT = 0xE000, 0x7FF
SUBSCRIPT_SIZE = 0.74  # size of such a letter
LETTERS_SCRIPT = Path(__file__).with_name("letters.js").read_text(encoding="utf-8")


def parted(label: str) -> tuple[str, str, str]:
    """A label as it is written by hand: ``a_CBⁿ`` -> the letter, what stands below the line, what stands above it."""
    parts = re.fullmatch(r"((?:-m )?[A-Za-z])_(.+?)([ⁿᵗᶜʳ]?)", label)
    return (label, "", "") if parts is None else (parts[1].replace("-", "−"), parts[2], parts[3])


def typeset(label: str) -> str:
    """A label for the scene, in which `prepare` lets the page draw letters below the line."""
    letter, below, above = parted(label)
    return letter + "".join(chr(SUBSCRIPT_START + ord(c)) if ord(c) <= LAST_SUBSCRIPT else c for c in below) + above


def prepare(server: viser.ViserServer) -> None:
    """Teach the pages letters below the line, and plates of labels that are dark on a dark page."""
    run_script(server, LETTERS_SCRIPT, "letters")


def half_sizes(texts: list[str], per_pixel: float) -> Real:
    """Half widths and heights (n, 2) [m] of labels; ``per_pixel``: metres of the drawing in a pixel of the screen."""
    parts = [parted(text) for text in texts]
    letters = [max(len(letter) + SUBSCRIPT_SIZE * len(below + above), 1.0) for letter, below, above in parts]
    return per_pixel * np.array([[LETTER_HALF_WIDTH * count + 2.0, LABEL_HALF_HEIGHT] for count in letters], float).reshape(-1, 2)


LABEL_ANCHORS = {(1, 1): "bottom-left", (-1, 1): "bottom-right", (1, -1): "top-left", (-1, -1): "top-right"}
"""By the side (x, y) of a point at which its label stands: the anchor of the label. The first that is free is taken."""


def corners(points: Complex, halves: Real, gap: float) -> list[tuple[int, int]]:
    """At which corner of its point each label stands for all of a motion, so that little lies over other labels and points.

    points: (n, F) [m]; halves: half widths and heights (n, 2) [m]; gap: from a point to its label [m]. Each label in turn takes
    its best corner beside all others, `CORNER_ROUNDS` times.
    """
    frames = np.linspace(0, points.shape[1] - 1, min(JUDGED_FRAMES, points.shape[1])).astype(int)
    points, sides = points[:, frames], np.array(list(LABEL_ANCHORS))
    offsets = (sides * (gap + halves[:, None])) @ np.array([1.0, 1j])  # (n, 4): from a point to the middle of its label
    chosen, count = np.zeros(len(points), int), np.arange(len(points))
    with np.errstate(invalid="ignore"):
        for _ in range(CORNER_ROUNDS):
            for k in count:
                others = count != k
                middles = points[k] + offsets[k][:, None, None]  # (4, 1, F)
                away = middles - (points + offsets[count, chosen][:, None])[others]
                covered = _overlap(away, (halves[k] + halves[others]).T[:, :, None]).sum(axis=(1, 2))
                covered += 0.3 * _overlap(middles - points[others], halves[k]).sum(axis=(1, 2))
                chosen[k] = np.argmin(covered)
    return [tuple(LABEL_ANCHORS)[c] for c in chosen]


@dataclass(eq=False)
class LabelPlaces:
    """Places labels with half sizes ``sides`` (n, 2) at sides and ``points`` (m, 2) at points, ``gap`` [m] from what they name;
    none over what is ``there``: middles and half sizes.

    A label keeps the kind of place that it has as long as that is free, so that it does not jump about as the drawing moves.
    """

    sides: Real
    points: Real
    gap: float
    there: Sequence[tuple[complex, Real]] = ()
    _last: dict[tuple[str, int], int] = field(default_factory=dict)

    def __call__(self, starts: Complex, vectors: Complex, marks: Complex) -> tuple[Complex, Complex]:
        """Middles of the labels of the sides (n,) and of the points (m,); NaN of what is not finite."""
        ends = np.concatenate([starts, starts + vectors, marks])
        ends = ends[np.isfinite(ends)]
        centre = complex(ends.mean()) if len(ends) else 0j
        dots = marks[np.isfinite(marks)]
        taken: list[tuple[complex, Real]] = list(self.there)
        at_points = np.full(len(marks), np.nan + 0j)
        for k in _outermost_first(marks, centre):
            at_points[k] = self._free(("point", k), self._around(marks[k], self.points[k], centre), self.points[k], taken, dots)
        at_sides = np.full(len(starts), np.nan + 0j)
        middles = starts + 0.5 * vectors
        for k in np.argsort(-np.abs(np.nan_to_num(vectors))):  # long sides have the choice
            if np.isfinite(middles[k]):
                places = self._beside(starts[k], vectors[k], self.sides[k])
                foreign = 0.4 * np.prod(self.sides[k]) * _foreign(places, starts, vectors, int(k))
                inward = np.abs(places - centre) < abs(middles[k] - centre)
                at_sides[k] = self._free(("side", int(k)), places, self.sides[k], taken, dots, foreign, inward)
        return at_sides, at_points

    # -- inside -------------------------------------------------------------------------------------------------------
    def _beside(self, start: complex, vector: complex, half: Real) -> Complex:
        """Places on both sides of a line, its middle first."""
        size = abs(vector)
        across = 1j * vector / size if size else 1j
        reach = self.gap + half[0] * abs(across.real) + half[1] * abs(across.imag)
        return np.array(
            [
                start + u * vector + toward * (reach + 2.0 * step * half[1]) * across
                for step in LABEL_STEPS
                for u in (0.5, 0.35, 0.65)
                for toward in (1.0, -1.0)
            ]
        )

    def _around(self, point: complex, half: Real, centre: complex) -> Complex:
        """Places around a point, the direction away from the drawing's centre first."""
        away = point - centre
        first = float(np.angle(away)) if away else 0.5 * np.pi
        turns = [
            first + sign * k * 2.0 * np.pi / LABEL_DIRECTIONS for k in range(LABEL_DIRECTIONS // 2 + 1) for sign in (1.0, -1.0)
        ]
        out = []
        for step in LABEL_STEPS:
            for turn in turns:
                toward = complex(np.cos(turn), np.sin(turn))
                out.append(
                    point + toward * (self.gap + half[0] * abs(toward.real) + half[1] * abs(toward.imag) + 2.0 * step * half[1])
                )
        return np.array(out)

    def _free(
        self,
        key: tuple[str, int],
        places: Complex,
        half: Real,
        taken: list[tuple[complex, Real]],
        dots: Complex,
        worse: Any = 0.0,
        inward: Any = False,
    ) -> complex:
        """The first place where nothing is hidden, that of the last time before all others; else where least is. ``worse`` (n,):
        what speaks against the places anyway, as an area; ``inward`` (n,): places that come after the others."""
        covered = np.zeros(len(places)) + worse
        for z, other in taken:
            covered += 3.0 * _overlap(places - z, half + other)  # to be read comes before all else
        for z in dots:
            covered += 0.3 * _overlap(places - z, half)
        last = self._last.get(key)
        if last is not None and covered[last] == 0.0:
            choice = last
        else:
            rank = np.arange(len(places)) + 3.0 * np.asarray(inward)
            choice = int(np.argmin(covered + 1e-9 * float(np.prod(half)) * rank))
        self._last[key] = choice
        taken.append((complex(places[choice]), half))
        return complex(places[choice])


def _foreign(places: Complex, starts: Complex, vectors: Complex, own: int) -> Flags:
    """Places (n,) that are nearer to another side than to their own: a reader would take the label for that one's."""
    with np.errstate(invalid="ignore", divide="ignore"):
        along = np.real(np.conj(vectors) * (places[:, None] - starts)) / np.abs(vectors) ** 2
        away = np.abs(places[:, None] - starts - np.clip(along, 0.0, 1.0) * vectors)
    away = np.where(np.isfinite(away), away, np.inf)
    return np.asarray((np.delete(away, own, axis=1) < 0.98 * away[:, [own]]).any(axis=1))


def _overlap(away: Complex, reach: Real) -> Real:
    """Area by which boxes overlap whose middles are ``away`` (...) and whose half sizes add up to ``reach`` (2, ...)."""
    x, y = reach[0] - np.abs(away.real), reach[1] - np.abs(away.imag)
    return np.where((x > 0.0) & (y > 0.0), x * y, 0.0)


def _outermost_first(marks: Complex, centre: complex) -> list[int]:
    """Points that are finite, the farthest from the centre first: they have room."""
    known = np.flatnonzero(np.isfinite(marks))
    return [int(k) for k in known[np.argsort(-np.abs(marks[known] - centre), kind="stable")]]
