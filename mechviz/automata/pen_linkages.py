"""Linkages by which two levers lead a pen: two rods that meet, or two crossed slides. Lengths are relative to the size of the
drawing.

The levers have their pivots ``PIVOTS`` to either side of the middle and are about as long as the drawing is large. The sheet is
``SHEET`` above the pivots. In the linkage of slides the levers' pins run in slots across the directions of the slides, so that each
lever leads one coordinate only.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from mechcore.arrays import Complex, Real
from mechviz.automata.pen_motion import place_words

PIVOTS, SHEET = 0.35, 1.65


class PenLinkage(ABC):
    """Linkage that leads the pen ``P`` of the link ``pen`` from the two levers, for drawings of ``size`` [m] about the origin."""

    pen: ClassVar[str]
    joints: ClassVar[tuple[str, ...]]
    words: ClassVar[str]
    lengths: ClassVar[tuple[float, float]]  # of the levers

    def __init__(self, size: float):
        self.size = size
        self.pivots = (complex(-PIVOTS * size), complex(PIVOTS * size))
        self.levers = (self.lengths[0] * size, self.lengths[1] * size)
        self.sheet = 1j * SHEET * size

    @abstractmethod
    def angles(self, places: Complex) -> tuple[Real, Real]:
        """Directions (N,) [rad] of the levers with the pen at these places (N,) [m] of the drawing."""

    @abstractmethod
    def links(self) -> list[str]:
        """The links beside the levers, as lines of a scene."""

    def frame_points(self) -> str:
        """Points of the frame beside the pivots."""
        return ""


class Rods(PenLinkage):
    """Two rods joined by a pin; the pen is on the left one, half a rod's length beyond the pin."""

    pen = "left rod"
    joints = (
        'D = { revolute = ["left lever", "left rod"] }',
        'E = { revolute = ["right lever", "right rod"] }',
        'F = { revolute = ["left rod", "right rod"], side = "left" }',
    )
    words = "whose rods lead the pen along the line"
    lengths = (1.0, 1.0)
    rod, beyond = 1.0, 0.5

    def angles(self, places: Complex) -> tuple[Real, Real]:
        pen, rod, far = places + self.sheet, self.rod * self.size, (self.rod + self.beyond) * self.size
        first = _lever_angles(pen, self.pivots[0], self.levers[0], far, 1.0)
        elbow = self.pivots[0] + self.levers[0] * np.exp(1j * first)
        pin = elbow + (pen - elbow) * (rod / far)
        return first, _lever_angles(pin, self.pivots[1], self.levers[1], rod, -1.0)

    def links(self) -> list[str]:
        rod, far = complex(self.rod * self.size), complex((self.rod + self.beyond) * self.size)
        return [
            f'"left rod" = {{ points = {{ D = [0, 0], F = {place_words(rod)}, P = {place_words(far)} }} }}',
            f'"right rod" = {{ points = {{ E = [0, 0], F = {place_words(rod)} }} }}',
        ]


class CrossSlides(PenLinkage):
    """A cross slide along x on the frame, and on it a slide along y with the pen."""

    pen = "pen slide"
    joints = (
        'S = { prismatic = ["frame", "cross slide"], at = ["S", "S"], along = [1, 0] }',
        'T = { prismatic = ["cross slide", "pen slide"], at = ["T", "T"], along = [0, 1] }',
        'D = { pin_slot = ["pen slide", "left lever"], along = [1, 0] }',
        'E = { pin_slot = ["cross slide", "right lever"], along = [0, 1] }',
    )
    words = "whose pins lead two crossed slides with the pen along the line"
    lengths = (1.3, 1.0)  # the first reaches so far that its slot passes beside the roller: their layers then keep them apart
    rail, stem = -1.2 + 0.9j, 0.85  # guide of the cross slide, beside all moving parts; the pen above the guide of its slide

    def angles(self, places: Complex) -> tuple[Real, Real]:
        return np.arcsin(places.imag / self.levers[0]), np.arccos(places.real / self.levers[1])

    def links(self) -> list[str]:
        """The links beside the levers, as lines of a scene. The pen comes from below on the right, where nothing is written yet."""
        rail = self.rail * self.size
        low, high = (
            self.pivots[0] + self.levers[0],
            self.pivots[1] + 1j * self.levers[1],
        )  # the levers' pins in the middle of the drawing
        held = low.real + self.sheet - 1j * self.stem * self.size
        return [
            f'"cross slide" = {{ points = {{ S = [0, 0], T = {place_words(held - rail)}, E = {place_words(high - rail)} }} }}',
            f'"pen slide" = {{ points = {{ T = [0, 0], P = {place_words(self.sheet - held)}, D = {place_words(low - held)} }} }}',
        ]

    def frame_points(self) -> str:
        return f", S = {place_words(self.rail * self.size)}"


def _lever_angles(pen: Complex, pivot: complex, lever: float, rod: float, side: float) -> Real:
    """Directions (N,) [rad] of a lever whose rod reaches the pen; its end is on the left (``side`` 1) or right (-1) of the line
    from the pivot to the pen."""
    away = pen - pivot
    far = np.abs(away)
    cosine = (lever**2 + far**2 - rod**2) / (2.0 * lever * far)
    return np.unwrap(np.angle(away)) + side * np.arccos(cosine)
