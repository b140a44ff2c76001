"""Solids that are fixed to links: seats of springs, brackets, stops, and flywheels and fans where a scene names them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely import affinity
from shapely.geometry import Point, Polygon, box
from shapely.ops import unary_union

from mechcore.arrays import Real, Vec2
from mechcore.dynamics.events import EndStop
from mechcore.joints.registry import build_joints
from mechcore.spec.loads import Spring
from mechcore.spec.mechanism import Mechanism
from mechviz.meshes.extrude import plate_mesh
from mechviz.meshes.outline import disc, hatched_bar, largest, pedestal, polygons
from mechviz.meshes.shading import FRAME_COLOR, PIN_COLOR, SolidColor, crisp, face_normals
from mechviz.meshes.solids import Solids, shaped
from mechviz.picture.base import PlacedOutline, blocked, find_base
from mechviz.picture.nodes import Mesh
from mechviz.picture.proportions import occlusion_frames
from mechviz.picture.springs import Coil, find_struts

if TYPE_CHECKING:
    from mechviz.runs import Run

STEADY_ANGLE = 0.02  # [rad] largest rotation of a spring relative to a moving link on which it has a seat
ASKEW_ANGLE = 0.35  # [rad] the same for the ground, where the seat is perpendicular to the mean direction of the spring
SEAT_HALF_WIDTH = 1.5  # half width of a seat on the ground, in radii of the coil
STEM_GAPS = (0.62, 0.95)  # half widths of the gap for a stem through the seat that are tried, in radii of the coil
# Half the width of a bracket of the ground for dampers, gas springs and actuators, in sizes of the mechanism
HINGE_HALF_WIDTH = 0.02
ANVIL_HALF_WIDTH = 0.045  # half the width of the block of a stop, in sizes of the mechanism
ANVIL_ARM = 0.82  # place on a link where it meets the stop, relative to the length of its arm
WASHER_COLOR: SolidColor = (150, 156, 164, 255)
ANVIL_GAP = 1e-3  # gap between a stop and the link that rests on it, in sizes of the mechanism


def find_fixtures(run: Run, solids: Solids, coils: Sequence[Coil]) -> Mapping[str, list[Mesh]]:
    """Meshes of all fixtures and of the base, in the frames of links, by the link that they are fixed to."""
    frame = run.motion.mechanism.frame
    meshes: dict[str, list[Mesh]] = {}
    with shaped(run.motion.mechanism):
        placed = list(_fixtures(run, solids, coils))
        base = find_base(run, solids, coils, [part for link, part in placed if link == frame])
        placed += [(frame, part) for part in base]
        placed += _named_wheels(run, solids, min([float(solids.bounds[0, 2]), *(low for _, (low, _), _ in base)]))
        for link, part in placed:
            meshes.setdefault(link, []).append(_mesh(*part))
    return meshes


def _fixtures(run: Run, solids: Solids, coils: Sequence[Coil]) -> Iterator[tuple[str, PlacedOutline]]:
    """Solids that are fixed to links, each with its link."""
    loads = {load.name: load for load in run.motion.mechanism.loads if isinstance(load, Spring)}
    for coil in coils:
        for end in (0, 1):
            yield from _seat(run, solids, loads[coil.name], coil, end)
    for at in _hinges(run):
        room = solids.z_top - 2.0 * HINGE_HALF_WIDTH * solids.size, solids.z_top
        yield from _bracket(run, solids, at, HINGE_HALF_WIDTH * solids.size, room)
    for stop in () if run.simulation is None else run.simulation.stops:
        yield from _anvil(run, solids, stop)


def joined_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """Several meshes as one."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + np.uint32(start) for mesh, start in zip(meshes, starts, strict=False)]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.colors for mesh in meshes]),
    )


def bounds_with(run: Run, solids: Solids, fixtures: Mapping[str, Sequence[Mesh]]) -> Real:
    """Box (2, 3) [m] around the solids and their fixtures, over the run."""
    low, high = np.array(solids.bounds, float)
    frames = occlusion_frames(run, solids.heights)[0]
    for link, meshes in fixtures.items():
        points = np.concatenate([mesh.vertices for mesh in meshes]).astype(float)
        pose = run.motion.pose(link)[frames]
        pose = pose[np.isfinite(pose).all(axis=1)]
        local = points[:, 0] + 1j * points[:, 1]
        world = (pose[:, 0] + 1j * pose[:, 1])[:, None] + local * np.exp(1j * pose[:, 2])[:, None]
        low = np.minimum(low, [world.real.min(initial=np.inf), world.imag.min(initial=np.inf), points[:, 2].min()])
        high = np.maximum(high, [world.real.max(initial=-np.inf), world.imag.max(initial=-np.inf), points[:, 2].max()])
    return np.array([low, high])


def _hinges(run: Run) -> set[Vec2]:
    """End points [m] of dampers, gas springs and actuators on the ground."""
    mechanism = run.motion.mechanism
    points = next(link for link in mechanism.links if link.name == mechanism.frame).points
    struts = find_struts(mechanism) if run.forces is not None else ()
    return {points[point] for strut in struts for link, point in strut.ends if link == mechanism.frame}


def _mesh(outline: Polygon, z: tuple[float, float], color: SolidColor) -> Mesh:
    shell = plate_mesh(outline, z, 0.0)
    vertices, faces, normals, _ = crisp(shell.vertices, shell.faces, *face_normals(shell.vertices, shell.faces))
    colors = np.tile(np.array(color[:3], np.uint8), (len(vertices), 1))
    return Mesh(vertices.astype(np.float32), faces.astype(np.uint32), normals.astype(np.float32), colors)


# -- springs --------------------------------------------------------------------------------------------------------------
def _seat(run: Run, solids: Solids, load: Spring, coil: Coil, end: int) -> Iterator[tuple[str, PlacedOutline]]:
    """The seat at one end (0 or 1) of a spring: a plate or a bracket on the ground, or a washer on a moving link relative to which
    the spring does not rotate."""
    link, frame = load.links[end], run.motion.mechanism.frame
    at = next(spec for spec in run.motion.mechanism.links if spec.name == link).points[load.points[end]]
    turned = np.unwrap(coil.pose[:, 2] + np.pi * end - run.motion.pose(link)[:, 2])  # direction into the spring, in the link's axes
    turned = turned[np.isfinite(turned)]
    radius = float(np.abs(coil.vertices[:, 1]).max())
    heights = coil.height - radius, coil.height + radius
    if len(turned) and np.ptp(turned) > ASKEW_ANGLE and link == frame:
        yield from _bracket(run, solids, at, 0.5 * radius, (coil.height - 0.5 * radius, coil.height + 0.5 * radius))
    if not len(turned) or np.ptp(turned) > (ASKEW_ANGLE if link == frame else STEADY_ANGLE):
        return
    direction = 0.5 * float(turned.min() + turned.max())

    def placed(shape: Polygon) -> Polygon:
        return affinity.translate(affinity.rotate(shape, direction, origin=(0.0, 0.0), use_radians=True), *at)

    if link != frame:
        if not coil.straight:
            yield link, (placed(box(-0.18 * radius, -radius, 0.0, radius)), heights, WASHER_COLOR)
        return
    whole = hatched_bar((0.0, SEAT_HALF_WIDTH * radius), (0.0, -SEAT_HALF_WIDTH * radius), 0.8 * radius, thickness=0.4 * radius)
    gaps = (box(-9.0 * radius, -part * radius, radius, part * radius) for part in STEM_GAPS)
    for shape in (whole, *map(whole.difference, gaps)):
        pieces = [placed(piece) for piece in polygons(shape) if piece.area > 0.02 * radius**2]
        if not any(blocked(run, solids, piece, heights) for piece in pieces):
            for piece in pieces:
                yield link, (piece, heights, FRAME_COLOR)
            return


def _bracket(run: Run, solids: Solids, at: Vec2, half: float, heights: tuple[float, float]) -> Iterator[tuple[str, PlacedOutline]]:
    """A pedestal on the ground about a point, between two heights [m]; ``half``: its half width [m]. Nothing where a link
    passes."""
    shape = pedestal(at, half, 64)
    if not blocked(run, solids, shape, heights):
        yield run.motion.mechanism.frame, (shape, heights, FRAME_COLOR)


# -- end stops ------------------------------------------------------------------------------------------------------------
def _anvil(run: Run, solids: Solids, stop: EndStop) -> Iterator[tuple[str, PlacedOutline]]:
    """The block on the ground that a link strikes at a stop of its joint with the ground."""
    mechanism, motion, size = run.motion.mechanism, run.motion, solids.size
    joint = run.numbers.joints[stop.joint]
    if mechanism.frame not in joint.links or stop.joint in mechanism.ends:
        return
    link = next(name for name in joint.links if name != mechanism.frame)
    coordinate, places = motion.coordinate(stop.joint)[:, 0], motion.joint_position(stop.joint) @ [1.0, 1.0j]
    frame = int(np.nanargmin(np.abs(coordinate - stop.at)))
    pose, pivot, left = motion.pose(link)[frame], complex(places[frame]), float(stop.at - coordinate[frame])
    beyond = 1.0 if stop.side == "upper" else -1.0
    if run.numbers.is_sliding(stop.joint):
        along = complex(np.nansum(np.diff(places) * np.sign(np.diff(coordinate))))  # direction of increasing coordinate
        if not along:
            return
        along /= abs(along)
        normal, middle, turn, shift = beyond * along, 0.0, 0.0, left * along
    else:
        if joint.links[0] == link:
            beyond, left = -beyond, -left
        points = next(spec for spec in mechanism.links if spec.name == link).points.values()
        arm = max((complex(*pose[:2]) + complex(*xy) * np.exp(1j * pose[2]) - pivot for xy in points), key=abs)
        if not arm:
            return
        normal = beyond * 1j * arm / abs(arm) * np.exp(1j * left)
        middle, turn, shift = beyond * ANVIL_ARM * abs(arm), left, 0j
    reached = _reach(solids, link, pose, (pivot, turn), (normal, middle))
    if reached is None:
        return
    front, (low, high) = reached
    half, across = ANVIL_HALF_WIDTH * size, -1j * normal
    ends = (pivot + shift + across * (middle + side * half) + normal * (front + ANVIL_GAP * size) for side in (-1.0, 1.0))
    a, b = ((z.real, z.imag) for z in ends)
    bar = hatched_bar(b, a, 0.9 * half, thickness=0.6 * half)
    if not blocked(run, solids, bar, (low, high)):
        yield mechanism.frame, (bar, (low, high), FRAME_COLOR)


def _reach(
    solids: Solids,
    link: str,
    pose: Real,
    moved: tuple[complex, float],
    strip: tuple[complex, float],
) -> tuple[float, tuple[float, float]] | None:
    """Largest extent [m] of a link from a pivot along a direction, within a strip, and the heights [m] of the part of the link
    there; None where no part is in the strip.

    ``moved``: the pivot, and the rotation about it [rad] that brings the link from its ``pose`` (3,) to the stop; ``strip``: its
    direction, and its distance to the right of the pivot [m].
    """
    (x, y, angle), (pivot, turn), (normal, middle) = pose, moved, strip
    best: tuple[float, tuple[float, float]] | None = None
    for outline, low, high in solids.heights.flat_outlines(link):
        points = shapely.get_coordinates(shapely.segmentize(outline.exterior, 0.01 * solids.size)) @ [1.0, 1.0j]
        world = points * np.exp(1j * angle) + complex(x, y)
        local = (world - pivot) * np.exp(1j * turn) / normal
        inside = np.abs(-local.imag - middle) < ANVIL_HALF_WIDTH * solids.size
        if inside.any() and (best is None or float(local.real[inside].max()) > best[0]):
            best = float(local.real[inside].max()), (low, high)
    return best


WHEEL_SPOKES, FAN_BLADES = 5, 6
WHEEL_RIM_SIDES = 192  # sides of the polygon of a rim
# Radius of a flywheel, in sizes of the mechanism: largest, least, and that without a known inertia
LARGEST_FLYWHEEL, LEAST_FLYWHEEL, USUAL_FLYWHEEL = 0.55, 0.22, 0.38
FAN_RADIUS = 0.8  # radius of a fan, relative to that of a flywheel
WHEEL_THICKNESS, WHEEL_CLEARANCE = 0.05, 0.02  # thickness of a wheel and clearance in front of it, in sizes of the mechanism
WHEEL_SHAFT_RADIUS = 0.022  # radius, in sizes of the mechanism


def looks_of(run: Run) -> dict[str, tuple[str, ...]]:
    """Looks of the links of a scene (such as "flywheel"), by link."""
    links = run.scene.document.links
    return {name: (link.looks,) if isinstance(link.looks, str) else tuple(link.looks) for name, link in links.items() if link.looks}


def has_spindle(run: Run) -> bool:
    """Whether the ground guides its blocks by rods through them (look "spindle")."""
    return "spindle" in looks_of(run).get(run.motion.mechanism.frame, ())


def _named_wheels(run: Run, solids: Solids, back: float) -> Iterator[tuple[str, PlacedOutline]]:
    """Solids of flywheels, fans and their shafts, each with its link, about the link's pin on the ground; ``back``: the height [m]
    behind which the wheels are."""
    mechanism, size = run.motion.mechanism, solids.size
    for link, kinds in looks_of(run).items():
        centre = _pin_on_ground(mechanism, link)
        if centre is None:
            continue
        color, top = solids.links[link].color, back
        for kind in kinds:
            radius = _radius(mechanism, link, size)
            shape = (
                _flywheel(centre, radius) if kind == "flywheel" else _fan(centre, FAN_RADIUS * radius) if kind == "fan" else None
            )
            if shape is not None:
                high = top - WHEEL_CLEARANCE * size
                yield link, (shape, (high - WHEEL_THICKNESS * size, high), color if kind == "flywheel" else PIN_COLOR)
                top = high - WHEEL_THICKNESS * size
        if top < back:
            yield (
                link,
                (
                    disc(centre, WHEEL_SHAFT_RADIUS * size, 48),
                    (top - WHEEL_CLEARANCE * size, float(solids.bounds[0, 2])),
                    PIN_COLOR,
                ),
            )


def _pin_on_ground(mechanism: Mechanism, link: str) -> Vec2 | None:
    """Position [m], in the link's axes, of the revolute joint between a link and the frame; None where there is none."""
    for joint in build_joints(mechanism).joints:
        if joint.kind == "revolute" and set(joint.links) == {mechanism.frame, link}:
            at = joint.a if joint.links[0] == link else joint.b
            return (at.real, at.imag)
    return None


def _radius(mechanism: Mechanism, link: str, size: float) -> float:
    """Radius [m] of a rim with about the link's radius of gyration, limited to radii that can be drawn."""
    spec = next(spec for spec in mechanism.links if spec.name == link)
    gyration = np.sqrt(spec.inertia / spec.mass) if spec.mass > 0.0 and spec.inertia > 0.0 else USUAL_FLYWHEEL * size
    return float(np.clip(1.1 * gyration, LEAST_FLYWHEEL * size, LARGEST_FLYWHEEL * size))


def _flywheel(centre: Vec2, radius: float) -> Polygon:
    """Outline of a flywheel: a rim on spokes."""
    rim = (
        Point(0.0, 0.0)
        .buffer(radius, quad_segs=WHEEL_RIM_SIDES // 4)
        .difference(Point(0.0, 0.0).buffer(0.82 * radius, quad_segs=WHEEL_RIM_SIDES // 4))
    )
    spoke = box(0.0, -0.045 * radius, 0.9 * radius, 0.045 * radius)
    spokes = [affinity.rotate(spoke, 360.0 / WHEEL_SPOKES * k + 18.0, origin=(0.0, 0.0)) for k in range(WHEEL_SPOKES)]
    return _at(unary_union([rim, *spokes, Point(0.0, 0.0).buffer(0.17 * radius, quad_segs=24)]), centre)


def _fan(centre: Vec2, radius: float) -> Polygon:
    """Outline of a fan: blades on a hub."""
    along = np.linspace(0.0, 1.0, 25)
    width = 0.2 * radius * np.sin(np.pi * np.sqrt(along)) * (0.4 + 0.6 * along)
    bend = 0.16 * radius * along**2
    edge = np.concatenate([np.column_stack([radius * along, bend + width]), np.column_stack([radius * along, bend - width])[::-1]])
    blade = Polygon(edge).buffer(0.01 * radius)
    blades = [affinity.rotate(blade, 360.0 / FAN_BLADES * k, origin=(0.0, 0.0)) for k in range(FAN_BLADES)]
    return _at(unary_union([*blades, Point(0.0, 0.0).buffer(0.22 * radius, quad_segs=24)]), centre)


def _at(shape: Polygon, centre: Vec2) -> Polygon:
    return largest(affinity.translate(shape, *centre))
