"""Labels of drawings: subscripts, and positions where labels hide neither each other nor the points of the drawing, found by a
greedy search with the nearest position first."""

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

LETTER_HALF_WIDTH, LABEL_HALF_HEIGHT = 3.6, 8.0  # half width of a letter and half height of a label [px], with a small margin
LABEL_STEPS = (0.0, 1.0, 2.0, 3.2)  # distances beyond the least one that are tried, in heights of a label
CORNER_ROUNDS, JUDGED_FRAMES = 3, 12  # rounds of choosing corners, and number of frames at which they are evaluated
LABEL_DIRECTIONS = 12  # directions that are tried around a point
# Subscripts are mapped to Unicode's private use area: its start, and the last code point of a letter that is mapped
SUBSCRIPT_START, LAST_SUBSCRIPT = 0xE000, 0x7FF
SUBSCRIPT_SIZE = 0.74  # size of a subscript over that of a letter
LETTERS_SCRIPT = Path(__file__).with_name("letters.js").read_text(encoding="utf-8")


def split_label(label: str) -> tuple[str, str, str]:
    """The parts of a label: ``a_CBⁿ`` -> letter, subscript, superscript."""
    parts = re.fullmatch(r"((?:-m )?[A-Za-z])_(.+?)([ⁿᵗᶜʳ]?)", label)
    return (label, "", "") if parts is None else (parts[1].replace("-", "−"), parts[2], parts[3])


def typeset(label: str) -> str:
    """A label for the scene with its subscript in the private use area, which the page draws as a subscript after `prepare`."""
    letter, below, above = split_label(label)
    return letter + "".join(chr(SUBSCRIPT_START + ord(c)) if ord(c) <= LAST_SUBSCRIPT else c for c in below) + above


def prepare(server: viser.ViserServer) -> None:
    """Send the script with which pages draw subscripts, and dark plates of labels on a dark page."""
    run_script(server, LETTERS_SCRIPT, "letters")


def half_sizes(texts: list[str], per_pixel: float) -> Real:
    """Half widths and half heights (n, 2) [m] of labels; ``per_pixel``: metres of the drawing per pixel of the screen."""
    parts = [split_label(text) for text in texts]
    letters = [max(len(letter) + SUBSCRIPT_SIZE * len(below + above), 1.0) for letter, below, above in parts]
    return per_pixel * np.array([[LETTER_HALF_WIDTH * count + 2.0, LABEL_HALF_HEIGHT] for count in letters], float).reshape(-1, 2)


LABEL_ANCHORS = {(1, 1): "bottom-left", (-1, 1): "bottom-right", (1, -1): "top-left", (-1, -1): "top-right"}
"""Anchor of a label by the side (x, y) of its point on which it stands."""


def corners(points: Complex, halves: Real, gap: float) -> list[tuple[int, int]]:
    """The side of its point on which each label stands during the whole motion, so that it overlaps other labels and points little.

    points: (n, F) [m]; halves: half widths and half heights (n, 2) [m]; gap: from a point to its label [m]. Each label in turn
    takes the best corner for the present positions of the others, `CORNER_ROUNDS` times.
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
class LabelPlacer:
    """Positions labels of half sizes ``sides`` (n, 2) at the sides and ``points`` (m, 2) at the points of a drawing, at a distance
    ``gap`` [m]; ``occupied``: boxes, as centres and half sizes.

    A label keeps its candidate position as long as that is free, so that it does not jump as the drawing moves.
    """

    sides: Real
    points: Real
    gap: float
    occupied: Sequence[tuple[complex, Real]] = ()
    _last: dict[tuple[str, int], int] = field(default_factory=dict)

    def __call__(self, starts: Complex, vectors: Complex, marks: Complex) -> tuple[Complex, Complex]:
        """Centres of the labels of the sides (n,) and of the points (m,); NaN where the side or point is not finite."""
        ends = np.concatenate([starts, starts + vectors, marks])
        ends = ends[np.isfinite(ends)]
        centre = complex(ends.mean()) if len(ends) else 0j
        dots = marks[np.isfinite(marks)]
        taken: list[tuple[complex, Real]] = list(self.occupied)
        at_points = np.full(len(marks), np.nan + 0j)
        for k in _outermost_first(marks, centre):
            at_points[k] = self._free(("point", k), self._around(marks[k], self.points[k], centre), self.points[k], taken, dots)
        at_sides = np.full(len(starts), np.nan + 0j)
        middles = starts + 0.5 * vectors
        for k in np.argsort(-np.abs(np.nan_to_num(vectors))):  # long sides choose first
            if np.isfinite(middles[k]):
                places = self._beside(starts[k], vectors[k], self.sides[k])
                foreign = 0.4 * np.prod(self.sides[k]) * _foreign(places, starts, vectors, int(k))
                inward = np.abs(places - centre) < abs(middles[k] - centre)
                at_sides[k] = self._free(("side", int(k)), places, self.sides[k], taken, dots, foreign, inward)
        return at_sides, at_points

    # -- inside -------------------------------------------------------------------------------------------------------
    def _beside(self, start: complex, vector: complex, half: Real) -> Complex:
        """Candidate positions on both sides of a line, its middle first."""
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
        """Candidate positions around a point, the direction away from the drawing's centre first."""
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
        """The last candidate chosen, if nothing is hidden there; otherwise the first of the candidates that hide least.
        ``worse`` (n,): additional penalty of the candidates, as an area; ``inward`` (n,): candidates ranked after the others."""
        covered = np.zeros(len(places)) + worse
        for z, other in taken:
            covered += 3.0 * _overlap(places - z, half + other)  # overlapping labels are worst
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
    """Whether positions (n,) are nearer to another side than to their own: a reader would take the label for that of the other."""
    with np.errstate(invalid="ignore", divide="ignore"):
        along = np.real(np.conj(vectors) * (places[:, None] - starts)) / np.abs(vectors) ** 2
        away = np.abs(places[:, None] - starts - np.clip(along, 0.0, 1.0) * vectors)
    away = np.where(np.isfinite(away), away, np.inf)
    return np.asarray((np.delete(away, own, axis=1) < 0.98 * away[:, [own]]).any(axis=1))


def _overlap(away: Complex, reach: Real) -> Real:
    """Area of overlap of boxes whose centres are ``away`` (...) apart and whose half sizes add up to ``reach`` (2, ...)."""
    x, y = reach[0] - np.abs(away.real), reach[1] - np.abs(away.imag)
    return np.where((x > 0.0) & (y > 0.0), x * y, 0.0)


def _outermost_first(marks: Complex, centre: complex) -> list[int]:
    """Indices of the finite points, the farthest from the centre first: these have most room."""
    known = np.flatnonzero(np.isfinite(marks))
    return [int(k) for k in known[np.argsort(-np.abs(marks[known] - centre), kind="stable")]]
