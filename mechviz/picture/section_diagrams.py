"""Diagrams of section forces, drawn on the links that carry them: normal force, shear force and bending moment."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mechcore.arrays import Complex, Real, Single
from mechcore.forces.section_forces import SectionForces
from mechcore.forces.section_lines import Cuts
from mechviz.picture.nodes import Color, Lines, Points
from mechviz.picture.proportions import looks

if TYPE_CHECKING:
    from mechviz.meshes.solids import Solids
    from mechviz.runs import Run


class Diagram(NamedTuple):
    """A kind of diagram: its title, letter, unit and colour, and what is drawn to the left of the axis (F, n)."""

    title: str
    letter: str
    unit: str
    color: Color
    ordinates: Callable[[SectionForces], Real]


DIAGRAMS = {
    "bending_moment": Diagram("Bending moments", "M", "N m", (255, 186, 66), lambda s: -s.moment),  # on the stretched side
    "shear_force": Diagram("Shear forces", "V", "N", (126, 226, 140), lambda s: s.shear),
    "normal_force": Diagram("Normal forces", "N", "N", (120, 184, 255), lambda s: s.normal),
}
"""By the group of the picture."""
HIDDEN = ("shear_force", "normal_force")
"""Those that are not shown at first: three diagrams over each other are hard to read."""
TALLEST = 0.16  # the largest ordinate of a kind over the run, in sizes of the mechanism
ORDINATES = 17  # evenly spaced
LINE = 0.0026  # radius of lines, in sizes of the mechanism


def section_nodes(run: Run, solids: Solids) -> Iterator[Lines | Points]:
    """For each diagram of each link its outline and ordinates, and a dot at its largest with what that comes to over the run.

    All diagrams of a kind have one scale.
    """
    sections = run.studies.sections
    for group, diagram in DIAGRAMS.items():
        peaks = {link: float(np.nanmax(np.abs(diagram.ordinates(s)), initial=0.0)) for link, s in sections.items()}
        largest = max(peaks.values(), default=0.0)
        scale = TALLEST * solids.size / largest if largest > 0.0 else 0.0
        for link, found in sections.items():
            strips = [_in_world(run, link, strip) for strip in _strips(found, scale * np.nan_to_num(diagram.ordinates(found)))]
            height = _height(run, solids, link, strips[0])
            outline, ordinates, tip = (_in_space(strip, height) for strip in strips)
            common: dict[str, Any] = {"owner": ("link", link), "group": group, "height": height, "colors": (diagram.color,)}
            key, path, radius = f"section.{link}.{group}", ("sections", group, link), LINE * solids.size
            yield Lines(key=key, entity=path, strips=(outline, ordinates), radii=(radius, 0.5 * radius), **common)
            look: dict[str, Any] = {"radii": (3.0 * radius,), "labels": (f"|{diagram.letter}| ≤ {peaks[link]:.3g} {diagram.unit}",)}
            yield Points(key=f"{key}.largest", entity=(*path, "largest"), parent="", places=tip, **look, **common)


def _strips(found: SectionForces, ordinates: Real) -> tuple[Complex, Complex, Complex]:
    """Outline, ordinates and tip of the largest (F, n), complex in the link's axes, of lengths (F, n) [m] to the axis' left."""
    tips = found.places + 1j * found.directions * ordinates
    outline = np.concatenate([found.places[:, :1], tips, found.places[:, -1:]], axis=1)
    even = np.linspace(0.0, found.axis.length, ORDINATES)
    cuts = Cuts(even, np.ones(ORDINATES))
    feet = np.broadcast_to(found.axis.place(cuts), (len(tips), ORDINATES))
    lengths = np.stack([np.interp(even, s, v) for s, v in zip(found.stations, ordinates, strict=True)])
    heads = feet + 1j * found.axis.directions[found.axis.segment(cuts)] * lengths
    comb = np.stack([feet, heads, feet], axis=2).reshape(len(tips), -1)
    k = np.argmax(np.abs(ordinates), axis=1)[:, None]
    return outline, comb, np.take_along_axis(tips, k, axis=1)


def _in_world(run: Run, link: str, strip: Complex) -> Complex:
    x, y, angle = run.motion.pose(link).T
    return (x + 1j * y)[:, None] + np.exp(1j * angle)[:, None] * strip


def _height(run: Run, solids: Solids, link: str, outline: Complex) -> float:
    """On the front of the link, or as far before it as is needed for the outline to be seen."""
    frames, known = looks(run, solids.heights)
    z = outline[frames]
    spec = {k.name: k for k in run.motion.mechanism.links}[link]
    lines = np.stack([z.real, z.imag], axis=-1)
    return solids.heights.cleared(max(solids.heights.of_point(link, xy) for xy in spec.points.values()), lines, known)


def _in_space(strip: Complex, height: float) -> Single:
    return np.stack([strip.real, strip.imag, np.full(strip.shape, height)], axis=-1).astype(np.float32)
