"""Arrows of forces, moments, dampers, gas springs and torsion springs in a GLB file, as animated nodes.

glTF animates nodes only by translation, rotation and scale, and meshes by weights of morph targets. So an arrow is a shaft that is
stretched and a head that moves with its end; a moment is an arc that grows, mirrored if it is clockwise; a torsion spring is a
ribbon interpolated between a few shapes with different angles of winding.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Complex, Real
from mechcore.records import dataclass
from mechviz.outputs.presentation import Presentation
from mechviz.picture.nodes import Arrow, Color, Lines, MomentArc
from mechviz.picture.proportions import (
    ARC_WIDTH,
    ARROW_HEAD_LENGTH,
    ARROW_HEAD_RADIUS,
    ARROW_SHAFT_RADIUS,
    LEAST_ARROW,
    POT_HALF_WIDTH,
    STRUT_COLOR,
    arc_corners,
    arc_faces,
    pot_length,
    ribbon_faces,
    spiral_radius,
)
from mechviz.picture.springs import BUSHING_RADIUS, RING_POINTS, axis_of_spiral, ends_of_strut
from mechviz.picture.surface_marks import forward_filled
from mechviz.quantities.vectors import VECTOR_FAMILIES

ARROW_FAMILIES = ("reaction", "applied", "inertia", "friction", "drive")
"""Families of arrows that are written by default."""

RIBBON_WIDTH = 0.008  # width of the ribbon of a torsion spring, in sizes of the mechanism
ROUND_SIDES = 16  # sides of solids of revolution
ARC_TURN = 1.5 * np.pi  # of a moment's arc [rad]
ARC_STEPS = 48
LEAST_SCALE = 1e-4  # scale of hidden nodes: glTF cannot hide nodes over time
MOST_TARGETS = 8  # number of morph targets, which any viewer supports


@dataclass(frozen=True, eq=False)
class MarkShape:
    """A mesh: ``vertices`` and unit ``normals`` (V, 3), ``faces`` (N, 3); ``targets`` (T, V, 3): displacements of morph targets."""

    vertices: Real
    normals: Real
    faces: NDArray[np.uint32]
    color: Color
    targets: Real | None = None


@dataclass(frozen=True, eq=False)
class MarkNode:
    """A node: positions ``places`` (F, 3) [m], rotations ``angles`` (F,) about z [rad], ``scales`` (F, 3), its ``shape``, the
    ``weights`` (F, T) of its morph targets, and its ``children``. None: without."""

    name: str
    places: Real | None = None
    angles: Real | None = None
    scales: Real | None = None
    shape: MarkShape | None = None
    weights: Real | None = None
    children: tuple[MarkNode, ...] = ()


def find_marks(shown: Presentation, families: Iterable[str] = ARROW_FAMILIES) -> list[MarkNode]:
    """The arrows and moments of some families, and the struts, bushings and torsion springs of a presentation."""
    wanted, picture = set(families), shown.picture
    marks = []
    for arrow in (a for a in picture.nodes_of(Arrow) if a.group in wanted):
        vector, family = arrow.vector, VECTOR_FAMILIES[arrow.group]
        lengths = vector.value / picture.scales.per_metre(family.name)
        marks.append(_arrow(f"{family.label}: {vector.item}", arrow.origin, lengths, arrow.height, picture.size, family.color))
    largest = max((_largest(arc.moment.value) for arc in picture.nodes_of(MomentArc)), default=0.0)
    for arc in (a for a in picture.nodes_of(MomentArc) if a.group in wanted):
        moment, family = arc.moment, VECTOR_FAMILIES[arc.group]
        name = f"{family.label}: moment {moment.item}"
        marks.append(_moment(name, arc, moment.value / largest, picture.size, family.color))
    return [*marks, *_strut_glyphs(shown)]


def _largest(values: Real) -> float:
    return float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))


# -- arrows and moments -----------------------------------------------------------------------------------------------
def _arrow(name: str, origin: Real, vector: Real, height: float, size: float, color: Color) -> MarkNode:
    """An arrow along ``vector`` (F, 2) [m]; one shorter than `LEAST_ARROW` is scaled down as a whole."""
    known = np.asarray(np.isfinite(np.column_stack([origin, vector])).all(axis=1), bool)
    length = np.where(known, np.hypot(vector[:, 0], vector[:, 1]), 0.0)
    whole = LEAST_ARROW * size
    shaft = np.maximum(length, whole) - ARROW_HEAD_LENGTH * size
    factor = np.clip(length / whole, LEAST_SCALE, 1.0)
    pointed = length > 1e-9 * size
    turn = np.unwrap(forward_filled(np.arctan2(vector[:, 1], vector[:, 0]), pointed))
    places = np.column_stack(
        [forward_filled(origin[:, 0], known), forward_filled(origin[:, 1], known), np.full(len(origin), height)]
    )
    one, none = np.ones(len(length)), np.zeros(len(length))
    rod = _turned([(ARROW_SHAFT_RADIUS * size, 0.0), (ARROW_SHAFT_RADIUS * size, 1.0)], color)
    tip = _turned([(ARROW_HEAD_RADIUS * size, 0.0), (0.0, ARROW_HEAD_LENGTH * size)], color)
    return MarkNode(
        name,
        places,
        turn,
        np.column_stack([factor] * 3),
        children=(
            MarkNode(f"{name} shaft", scales=np.column_stack([shaft, one, one]), shape=rod),
            MarkNode(f"{name} head", places=np.column_stack([shaft, none, none]), shape=tip),
        ),
    )


def _moment(name: str, arc: MomentArc, part: Real, size: float, color: Color) -> MarkNode:
    """An arc scaled by ``part`` (F,), the ratio to the largest moment, mirrored where it is negative."""
    origin = arc.moment.origin
    known = np.logical_and(np.isfinite(origin).all(axis=1), np.isfinite(part))
    size_of = np.where(known, part, 0.0)
    size_of = np.where(np.abs(size_of) < LEAST_SCALE, LEAST_SCALE, size_of)
    places = np.column_stack(
        [forward_filled(origin[:, 0], known), forward_filled(origin[:, 1], known), np.full(len(origin), arc.height)]
    )
    shape = _flat(arc_corners(ARC_TURN, arc.radius, ARC_WIDTH * size, ARC_STEPS), arc_faces(ARC_STEPS), color)
    return MarkNode(name, places, None, np.column_stack([np.abs(size_of), size_of, np.abs(size_of)]), shape)


# -- springs and dampers ----------------------------------------------------------------------------------------------
def _strut_glyphs(shown: Presentation) -> list[MarkNode]:
    """The loads that the picture draws as lines between links, as solids: struts, bushings and torsion springs."""
    picture, loads = shown.picture, shown.catalogue.numbers.loads
    size, top = picture.size, picture.top
    marks: list[MarkNode] = []
    for node in picture.nodes_of(Lines, "springs"):
        load = node.owner[1]
        kind = loads[load].kind
        strips = [forward_filled(s[..., :2].astype(float), np.asarray(np.isfinite(s).all(axis=(1, 2)))) for s in node.strips]
        if kind in ("damper", "gas spring", "actuator"):
            a, b = ends_of_strut(*strips, closed=kind != "damper")
            marks += _strut(f"{kind} {load}", a, b, size, top + POT_HALF_WIDTH * size)
        elif kind == "bushing":
            ring, bar, _ = strips
            along = (bar[:, 1] - bar[:, 0]) @ np.array([1.0, 1.0j])
            marks += _bushing(
                f"bushing {load}", ring[:, :-1].mean(axis=1), bar.mean(axis=1), np.angle(along), size, top + 0.01 * size
            )
        elif kind == "torsion spring":
            marks.append(_spiral(f"spring {load}", *axis_of_spiral(strips[0], size), size, top))
    return marks


def _bushing(name: str, centre: Real, place: Real, angle: Real, size: float, height: float) -> list[MarkNode]:
    """A ring about ``centre`` (F, 2) and a cross at ``place`` (F, 2) [m], rotated by ``angle`` (F,) [rad]."""
    half, around = 0.5 * RIBBON_WIDTH * size, np.exp(1j * np.linspace(0.0, 2.0 * np.pi, RING_POINTS))
    radius = BUSHING_RADIUS * size
    ring = np.stack([(radius + half) * around, (radius - half) * around], axis=1).ravel()
    bar = np.array([-radius - 1j * half, -radius + 1j * half, radius - 1j * half, radius + 1j * half])
    z = np.full(len(centre), height)
    return [
        MarkNode(f"{name} ring", np.column_stack([centre, z]), shape=_flat(ring, ribbon_faces(RING_POINTS), STRUT_COLOR)),
        MarkNode(
            f"{name} cross",
            np.column_stack([place, z]),
            np.unwrap(angle),
            shape=_flat(np.concatenate([bar, 1j * bar]), np.vstack([ribbon_faces(2), 4 + ribbon_faces(2)]), STRUT_COLOR),
        ),
    ]


def _strut(name: str, a: Real, b: Real, size: float, height: float) -> list[MarkNode]:
    """A cylinder at ``a`` (F, 2) and a rod at ``b`` (F, 2) [m], of constant lengths: the rod moves into the cylinder."""
    d = b - a
    length = np.hypot(*d.T)
    least, most = float(np.nanmin(length)), float(np.nanmax(length))
    pot = pot_length(least, most)
    stub = 0.12 * pot
    turn = np.unwrap(np.arctan2(d[:, 1], d[:, 0]))
    w = POT_HALF_WIDTH * size
    outer = _turned([(0.0, 0.0), (0.3 * w, 0.0), (0.3 * w, stub), (w, stub), (w, pot), (0.0, pot)], STRUT_COLOR)
    inner = _turned([(0.0, -(most - 0.92 * pot)), (0.35 * w, -(most - 0.92 * pot)), (0.35 * w, 0.0), (0.0, 0.0)], (150, 158, 170))
    z = np.full(len(a), height)
    return [
        MarkNode(f"{name} cylinder", np.column_stack([a, z]), turn, shape=outer),
        MarkNode(f"{name} rod", np.column_stack([b, z]), turn, shape=inner),
    ]


def _spiral(name: str, centre: Real, start: Real, angle: Real, size: float, top: float) -> MarkNode:
    """A spiral ribbon whose inner end is at the angle ``start`` (F,) and that subtends ``angle`` (F,) [rad], interpolated between
    morph targets."""
    low, high = float(angle.min()), float(angle.max())
    grid = np.linspace(low, high, 1 + MOST_TARGETS) if high - low > 1e-6 else np.array([low])
    part = np.linspace(0.0, 1.0, ARC_STEPS * 3)
    radius = spiral_radius(part, size)
    half = 0.5 * RIBBON_WIDTH * size
    edges = [np.stack([(radius + side * half) * np.exp(1j * g * part) for side in (1.0, -1.0)], axis=1).ravel() for g in grid]
    shape = _flat(edges[0], ribbon_faces(len(part)), STRUT_COLOR)
    places = np.column_stack([centre, np.full(len(centre), top + 0.01 * size)])
    if len(grid) == 1:
        return MarkNode(name, places, start, shape=shape)
    targets = np.stack([np.column_stack([(w - edges[0]).real, (w - edges[0]).imag, np.zeros(len(w))]) for w in edges[1:]])
    at = (angle - low) / (high - low) * MOST_TARGETS  # position among the targets; weights are hat functions
    weights = np.clip(1.0 - np.abs(at[:, None] - np.arange(1, MOST_TARGETS + 1)), 0.0, 1.0)
    shape = MarkShape(shape.vertices, shape.normals, shape.faces, shape.color, targets)
    return MarkNode(name, places, start, shape=shape, weights=weights)


# -- meshes -----------------------------------------------------------------------------------------------------------
def _turned(profile: list[tuple[float, float]], color: Color) -> MarkShape:
    """A surface of revolution about the x axis with a profile (radius, x), with a sharp edge at every corner; open at its ends."""
    vertices: list[Real] = []
    normals: list[Real] = []
    faces: list[Any] = []
    angle = 2.0 * np.pi * np.arange(ROUND_SIDES) / ROUND_SIDES
    ring = np.column_stack([np.zeros(ROUND_SIDES), np.cos(angle), np.sin(angle)])
    k, after = np.arange(ROUND_SIDES), np.roll(np.arange(ROUND_SIDES), -1)
    for (r0, x0), (r1, x1) in pairwise(profile):
        start = sum(len(v) for v in vertices)
        lean = np.array([r0 - r1, x1 - x0]) / np.hypot(r0 - r1, x1 - x0)  # the normal: its axial and radial component
        for r, x in ((r0, x0), (r1, x1)):
            vertices.append(r * ring + [x, 0.0, 0.0])
            normals.append(lean[1] * ring + [lean[0], 0.0, 0.0])
        faces.append(start + np.column_stack([k, after, ROUND_SIDES + after]))
        faces.append(start + np.column_stack([k, ROUND_SIDES + after, ROUND_SIDES + k]))
    return MarkShape(np.vstack(vertices), np.vstack(normals), np.vstack(faces).astype(np.uint32), color)


def _flat(z: Complex, faces: object, color: Color) -> MarkShape:
    """A flat shape of points (V,) x + iy, facing z."""
    vertices = np.column_stack([z.real, z.imag, np.zeros(len(z))])
    return MarkShape(vertices, np.tile([0.0, 0.0, 1.0], (len(z), 1)), np.asarray(faces, np.uint32), color)
