"""Flywheels and fans on shafts, where a scene names them: behind the mechanism, so that they hide nothing and meet nothing."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from shapely import affinity
from shapely.geometry import Point, Polygon, box
from shapely.ops import unary_union

from mechcore.joints.registry import build_joints
from mechcore.spec.mechanism import Mechanism, Vec2
from mechviz.meshes.outline import disc, polygons
from mechviz.meshes.shading import PIN, Color

if TYPE_CHECKING:
    from mechviz.meshes.solids import Solids
    from mechviz.runs import Run

SPOKES, BLADES = 5, 6
SIDES = 192  # of a rim
LARGEST, LEAST, USUAL = 0.55, 0.22, 0.38  # radius of a flywheel, in sizes of the mechanism: at most, at least, of no known inertia
FAN = 0.8  # radius of a fan, in those of a flywheel
THICK, ROOM = 0.05, 0.02  # of a wheel along its shaft, and before it, in sizes of the mechanism
SHAFT = 0.022  # radius, in sizes of the mechanism

Placed = tuple[Polygon, tuple[float, float], Color]
"""An outline [m] in the frame of a link, the heights [m] between which it lies, and its colour."""


def looks_of(run: Run) -> dict[str, tuple[str, ...]]:
    """What the links of a scene are to look like, by their names."""
    links = run.scene.document.links
    return {name: (link.looks,) if isinstance(link.looks, str) else tuple(link.looks) for name, link in links.items() if link.looks}


def has_spindle(run: Run) -> bool:
    """Whether the ground is to guide its blocks by rods through them."""
    return "spindle" in looks_of(run).get(run.motion.mechanism.frame, ())


def named_wheels(run: Run, solids: Solids) -> Iterator[tuple[str, Placed]]:
    """The parts of flywheels and fans, each with its link, about the link's pin on the ground."""
    mechanism, size = run.motion.mechanism, solids.size
    back = float(solids.bounds[0, 2])
    for link, looks in looks_of(run).items():
        centre = _pin_on_ground(mechanism, link)
        if centre is None:
            continue
        color, top = solids.links[link].color, back
        for kind in looks:
            radius = _radius(mechanism, link, size)
            shape = _flywheel(centre, radius) if kind == "flywheel" else _fan(centre, FAN * radius) if kind == "fan" else None
            if shape is not None:
                high = top - ROOM * size
                yield link, (shape, (high - THICK * size, high), color if kind == "flywheel" else PIN)
                top = high - THICK * size
        if top < back:
            yield link, (disc(centre, SHAFT * size, 48), (top - ROOM * size, back), PIN)


def _pin_on_ground(mechanism: Mechanism, link: str) -> Vec2 | None:
    """Where a link is pinned to the frame, in its own axes [m]."""
    for joint in build_joints(mechanism).joints:
        if joint.kind == "revolute" and set(joint.links) == {mechanism.frame, link}:
            at = joint.a if joint.links[0] == link else joint.b
            return (at.real, at.imag)
    return None


def _radius(mechanism: Mechanism, link: str, size: float) -> float:
    """Radius [m] of a rim that has the link's mass and moment of inertia, within what can be drawn."""
    spec = next(spec for spec in mechanism.links if spec.name == link)
    gyration = np.sqrt(spec.inertia / spec.mass) if spec.mass > 0.0 and spec.inertia > 0.0 else USUAL * size
    return float(np.clip(1.1 * gyration, LEAST * size, LARGEST * size))


def _flywheel(centre: Vec2, radius: float) -> Polygon:
    """A rim on spokes."""
    rim = (
        Point(0.0, 0.0).buffer(radius, quad_segs=SIDES // 4).difference(Point(0.0, 0.0).buffer(0.82 * radius, quad_segs=SIDES // 4))
    )
    spoke = box(0.0, -0.045 * radius, 0.9 * radius, 0.045 * radius)
    spokes = [affinity.rotate(spoke, 360.0 / SPOKES * k + 18.0, origin=(0.0, 0.0)) for k in range(SPOKES)]
    return _at(unary_union([rim, *spokes, Point(0.0, 0.0).buffer(0.17 * radius, quad_segs=24)]), centre)


def _fan(centre: Vec2, radius: float) -> Polygon:
    """Blades on a hub."""
    along = np.linspace(0.0, 1.0, 25)
    width = 0.2 * radius * np.sin(np.pi * np.sqrt(along)) * (0.4 + 0.6 * along)
    bend = 0.16 * radius * along**2
    edge = np.concatenate([np.column_stack([radius * along, bend + width]), np.column_stack([radius * along, bend - width])[::-1]])
    blade = Polygon(edge).buffer(0.01 * radius)
    blades = [affinity.rotate(blade, 360.0 / BLADES * k, origin=(0.0, 0.0)) for k in range(BLADES)]
    return _at(unary_union([*blades, Point(0.0, 0.0).buffer(0.22 * radius, quad_segs=24)]), centre)


def _at(shape: Polygon, centre: Vec2) -> Polygon:
    return polygons(affinity.translate(shape, *centre))[0]
