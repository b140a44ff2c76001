"""Barrel, end and globoidal cams with their true flanks, on shafts in the plane of motion; their rollers, ribs and bearings.

A cam is a sequence of rings around its axis: circles on turned surfaces, edges and floors of the groove on milled ones. The surface
between two rings is ruled, as is nearly the flank of a cylindrical roller. Lengths are in units of the mechanism's size.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from shapely.geometry import LineString, Polygon
from shapely.ops import unary_union

from mechcore.arrays import Real, Vec2
from mechcore.joints.base import Builder, point_of
from mechcore.records import dataclass
from mechcore.spec.mechanism import CamJoint, Mechanism
from mechviz.meshes.extrude import Part, Prism, Shell, bored, plate_mesh, revolve
from mechviz.meshes.outline import disc, key_outline, keyed_bore, keyway_reach
from mechviz.meshes.shading import PIN_COLOR, SolidColor

if TYPE_CHECKING:
    from mechcore.cams.placement.spatial import PlacedSpatial
    from mechviz.meshes.layers import Levels
    from mechviz.meshes.model import ScaledMechanism

_BORE_SIDES = 48  # sides of bore and shaft
_SHAFT_FIT = 0.995  # radius of the shaft in its bore
_ROLLER_CLEARANCE = 0.04  # between the roller's end and the floor of the groove, of the groove's depth


@dataclass(frozen=True, eq=False)
class SpatialCamDrawing:
    """Data for drawing a spatial cam. ``tip``: the named roller in the follower's frame; ``placed``: its geometry [m]."""

    joint: str
    cam: str
    follower: str
    placed: PlacedSpatial
    size: float
    bore: Vec2
    tip: Vec2
    hinge: Vec2 | None  # of an oscillating arm, in the follower's frame
    up: complex  # of a translating follower: direction of the cam's axis in its own frame

    @property
    def flat(self) -> bool:
        """Whether the roller's axis lies in the plane of motion (globoid); otherwise it is perpendicular, with the roller in front
        of the cam."""
        return self.placed.blank.kind == "globoid"


@dataclass(frozen=True)
class Spin:
    """Axis of a solid that rotates about an axis in the plane of motion: point [m] and direction, in the link's frame."""

    origin: tuple[float, float, float]
    along: Vec2
    carrier: str


def spin_transforms(spin: Spin, turn: Real) -> tuple[Real, Real]:
    """Translations (F, 3) and quaternions x, y, z, w (F, 4) of the solid in its link, for relative angles of the link (F,)
    [rad]."""
    half = 0.5 * np.asarray(turn, float)
    c, s = np.cos(half), np.sin(half)
    ux, uy = spin.along
    # rotation back about z, times rotation about the axis: q = (0, 0, -s; c) (ux s, uy s, 0; c)
    q = np.stack([c * ux * s + s * uy * s, c * uy * s - s * ux * s, -s * c, c * c], axis=-1)
    o = np.array(spin.origin)
    v, w = q[:, :3], q[:, 3:]
    turned = o + 2.0 * np.cross(v, np.cross(v, o) + w * o)
    return o - turned, q


def find_spatial_cams(mechanism: Mechanism, parts: Builder, size: float) -> tuple[SpatialCamDrawing, ...]:
    """All spatial cams of a mechanism."""
    by_name = {r.name: r.geometry for r in parts.relations}
    drawings = []
    for joint in mechanism.joints:
        if not isinstance(joint, CamJoint) or joint.spatial is None:
            continue
        placed = by_name[joint.name]
        tip = point_of(parts.links[joint.links[1]], joint.point)
        hinge, up = None, 0j
        if placed.pivot is not None:
            own = parts.axis_between(joint, joint.links[1], placed.carrier)[1]
            hinge = (own.real / size, own.imag / size)
        else:
            loop_joint = next(j for j in parts.joints if j.name == joint.guide)
            first = loop_joint.links[0] == placed.carrier
            up = complex(1j * placed.axes * np.exp(1j * (-loop_joint.angle if first else loop_joint.angle)))
        at = placed.mount_origin / size
        drawings.append(
            SpatialCamDrawing(
                joint.name, joint.links[0], joint.links[1], placed, size, (at.real, at.imag),
                (tip.real / size, tip.imag / size), hinge, up,
            )
        )  # fmt: skip
    return tuple(drawings)


# -- the cam in its own axes ----------------------------------------------------------------------------------------------


def _rings(placed: PlacedSpatial) -> list[Real]:
    """Rings (n, 3) [m] of a cam in its own frame at angle zero of its law, from the edge of one flat end to that of the other."""
    blank, r = placed.blank, placed.cam.radius
    if blank.rollers:
        return core_rings(placed)
    if blank.kind == "globoid":
        return _globoid(placed)
    wall = 0.9 * r
    if blank.kind == "rib":
        reach = 0.5 * blank.thickness + r
        core = blank.radius - blank.depth
        low, high = [edge(placed, -1, x, -reach) for x in (core, blank.radius)]
        up_high, up_low = [edge(placed, 1, x, reach) for x in (blank.radius, core)]
        a = np.arctan2(low[:, 1], low[:, 0])
        z0, z1 = low[:, 2].min() - 2.0 * r - wall, up_low[:, 2].max() + 2.0 * r + wall
        return [circle(a, core, z0), low, high, up_high, up_low, circle(a, core, z1)]
    near = edge(placed, 1, blank.radius)
    a = np.arctan2(near[:, 1], near[:, 0])
    z0 = near[:, 2].min() - wall
    if blank.kind == "end":
        hollow = blank.radius - blank.depth
        inner = edge(placed, 1, hollow)
        z0 -= wall
        return [circle(a, blank.radius, z0), near, inner, circle(a, hollow, z0 + wall)]
    floor = blank.radius - blank.depth
    lower, upper, far = edge(placed, 1, floor), edge(placed, -1, floor), edge(placed, -1, blank.radius)
    z1 = far[:, 2].max() + wall
    return [circle(a, blank.radius, z0), near, lower, upper, far, circle(a, blank.radius, z1)]


def _globoid(placed: PlacedSpatial) -> list[Real]:
    assert placed.pivot is not None
    distance = abs(placed.pivot - placed.centre)
    cam = placed.cam
    near, low, up, far = (edge(placed, *which) for which in ((1, cam.inner), (1, cam.outer), (-1, cam.outer), (-1, cam.inner)))
    psi = [np.arctan2(p[:, 2], distance - np.hypot(p[:, 0], p[:, 1])) for p in (near, far)]
    wall = 0.9 * cam.radius / cam.inner
    ends = (float(psi[0].min()) - wall, float(psi[1].max()) + wall)
    rings = []
    for line, angle, end in ((near, psi[0], ends[0]), (far, psi[1], ends[1])):
        a = np.arctan2(line[:, 1], line[:, 0])
        steps = [end + (angle - end) * t for t in np.linspace(0.0, 1.0, 7)[:-1]]
        rings.append([circle(a, distance - cam.inner * np.cos(x), cam.inner * np.sin(x)) for x in steps])
    return [*rings[0], near, low, up, far, *rings[1][::-1]]


# -- parts ----------------------------------------------------------------------------------------------------------------


def _solid(rings: list[Real], bore: Polygon) -> Shell:
    """The solid around an axis through rings of equal numbers of points, with a bore."""
    x, y = rings[0][:, 0], rings[0][:, 1]
    clockwise = float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) < 0.0
    turned = [ring[::-1] if clockwise else ring for ring in rings]
    return bored([(ring[:, :2], ring[:, 2]) for ring in turned], bore)


def _space(drawing: SpatialCamDrawing, p: Real, height: float) -> Real:
    """Points (n, 3) [m] of the cam's frame in the frame of its link, with the axis of its shaft at a height."""
    placed = drawing.placed
    angle = placed.sense * placed.phase
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = c * p[:, 0] - s * p[:, 1], s * p[:, 0] + c * p[:, 1], p[:, 2]
    if drawing.flat:
        w, out = placed.mount_origin + placed.axes * (x + 1j * z), -y
    else:
        w, out = placed.mount_origin + placed.axes * (y + 1j * z), x
    return np.column_stack([w.real / drawing.size, w.imag / drawing.size, out / drawing.size + height])


def spatial_parts(model: ScaledMechanism, levels: Levels) -> tuple[list[Part], dict[str, Spin]]:
    """Parts of all spatial cams with their shafts, bearings and rollers; and the axes of rotation by link."""
    parts: list[Part] = []
    spins: dict[str, Spin] = {}
    for drawing in model.spatial_cams:
        height = _height(model, levels, drawing)
        parts += _cam_parts(model, drawing, height)
        parts += _rollers(model, levels, drawing, height)
        u = 1j * drawing.placed.axes
        origin = (drawing.placed.mount_origin.real, drawing.placed.mount_origin.imag, height * drawing.size)
        spins[drawing.cam] = Spin(origin, (u.real, u.imag), drawing.placed.carrier)
    return parts, spins


def _height(model: ScaledMechanism, levels: Levels, drawing: SpatialCamDrawing) -> float:
    low, high = levels.plate(levels.layer_of(drawing.follower))
    if drawing.flat:
        return 0.5 * (low + high)
    return low - 0.5 * model.proportions.half_width - drawing.placed.blank.radius / drawing.size


def turrets_reach(model: ScaledMechanism, levels: Levels) -> float:
    """The lowest height reached by rollers in the plane around the pivot of a turret; infinite if there are none."""
    lying = [drawing for drawing in model.spatial_cams if drawing.flat and drawing.placed.blank.rollers]
    return min((_height(model, levels, d) - d.placed.cam.radius / d.size for d in lying), default=np.inf)


def _cam_parts(model: ScaledMechanism, drawing: SpatialCamDrawing, height: float) -> list[Part]:
    placed, r = drawing.placed, model.proportions.half_width
    least = placed.blank.radius - placed.blank.depth
    if drawing.flat and placed.pivot is not None:
        least = abs(placed.pivot - placed.centre) - placed.cam.outer
    shaft = max(0.35 * least, 0.1 * drawing.size * r)
    rings, axis = _rings(placed), (0.0, 0.0)
    z0, z1 = (float(f(np.concatenate(rings)[:, 2])) for f in (np.min, np.max))
    ends = [float(ring[0, 2]) for ring in (rings[0], rings[-1])]
    radius = _SHAFT_FIT * shaft
    keyed = keyway_reach(radius) < 0.95 * least
    bore = keyed_bore(axis, radius, shaft, (1.0, 0.0), _BORE_SIDES) if keyed else disc(axis, shaft, _BORE_SIDES)
    mates = frozenset([drawing.joint])
    around_bore = disc(drawing.bore, 0.2 * r, 12)

    def part(link: str, kind: str, shell: Shell, color: SolidColor | None = None) -> Part:
        points = (
            _space(drawing, shell.vertices, height) if link == drawing.cam else _in_carrier_frame(drawing, shell.vertices, height)
        )
        low, high = float(points[:, 2].min()), float(points[:, 2].max())
        return Part(link, kind, _outwards(Shell(points, shell.faces)), color, (Prism(around_bore, low, high),), mates)

    free = 1.1 * r * drawing.size  # of the shaft between cam and bearing
    long = 1.6 * r * drawing.size  # of a bearing
    low, high = z0 - free - long, z1 + free + long
    over = 0.15 * long  # by which the shaft protrudes from its bearings
    bar = revolve(((0.0, low - over), (radius, low - over), (radius, high + over), (0.0, high + over)), segments=_BORE_SIDES)
    parts = [part(drawing.cam, "wheel", _solid(rings, bore)), part(drawing.cam, "pin", bar, PIN_COLOR)]
    if placed.blank.rollers:
        parts.append(part(drawing.cam, "wheel", rib(placed)))
    if keyed:
        key = plate_mesh(key_outline(axis, radius, (1.0, 0.0), _BORE_SIDES), (ends[0], ends[1]), 0.0)
        parts.append(part(drawing.cam, "key", key, PIN_COLOR))
    block, bed = _bearing(shaft, 1.06 * float(np.hypot(*np.concatenate(rings)[:, :2].T).max()), -1j if drawing.flat else 1.0)
    for shape, (a, b) in ((block, (low, low + long)), (block, (high - long, high)), (bed, (low - over, high + over))):
        parts.append(part(placed.carrier, "pedestal", plate_mesh(shape, (a, b), 0.05 * long)))
    return parts


def _bearing(shaft: float, reach: float, out: complex) -> tuple[Polygon, Polygon]:
    """Outlines, perpendicular to the axis of a shaft of radius ``shaft`` [m], of a bearing block and of its bed, at a distance
    ``reach`` [m] behind the axis; ``out``: the direction towards the viewer."""
    wide, foot, deep = 2.0 * shaft, 2.6 * shaft, 0.9 * shaft

    def turned(*corners: complex) -> Polygon:
        return Polygon([(z.real, z.imag) for z in (out * corner for corner in corners)])

    neck = turned(1j * wide, -reach + 1j * wide, -reach - 1j * wide, -1j * wide)
    block = neck.union(disc((0.0, 0.0), wide, _BORE_SIDES)).difference(disc((0.0, 0.0), 1.01 * shaft, _BORE_SIDES))
    bed = turned(-reach + 1j * foot, -reach - deep + 1j * foot, -reach - deep - 1j * foot, -reach - 1j * foot)
    return block, bed


def _in_carrier_frame(drawing: SpatialCamDrawing, p: Real, height: float) -> Real:
    """Points (n, 3) [m] of the cam's frame in the frame of the carrier."""
    placed = drawing.placed
    x, y, z = p.T
    if drawing.flat:
        w, out = placed.centre + placed.axes * (x + 1j * z), -y
    else:
        w, out = placed.centre + placed.axes * (y + 1j * z), x
    return np.column_stack([w.real / drawing.size, w.imag / drawing.size, out / drawing.size + height])


def _outwards(shell: Shell) -> Shell:
    p, q, r = (shell.vertices[shell.faces[:, k]] for k in range(3))
    volume = float(np.einsum("ij,ij->", p - shell.vertices[0], np.cross(q - shell.vertices[0], r - shell.vertices[0])))
    return shell if volume > 0.0 else Shell(shell.vertices, shell.faces[:, ::-1])


def _rollers(model: ScaledMechanism, levels: Levels, drawing: SpatialCamDrawing, height: float) -> list[Part]:
    placed, size = drawing.placed, drawing.size
    radius, pin = placed.cam.radius / size, 0.55 * placed.cam.radius / size
    depth = placed.blank.depth / size
    mates = frozenset([drawing.joint])
    inner, outer = placed.cam.inner / size, placed.cam.outer / size
    if drawing.flat:
        assert drawing.hinge is not None
        start = model.proportions.half_width
        mouth, end = inner - 0.1 * depth, outer - _ROLLER_CLEARANCE * depth
        profile = ((0.0, start), (pin, start), (pin, mouth), (radius, mouth), (radius, end), (0.0, end))
        upright = revolve(profile, segments=96).vertices
        parts, hinge = [], complex(*drawing.hinge)
        for tip in roller_positions(placed, complex(*drawing.tip), hinge):
            direction = (tip - hinge) / abs(tip - hinge)
            xy = hinge + direction * (upright[:, 2] + 1j * upright[:, 0])
            vertices = np.column_stack([xy.real, xy.imag, upright[:, 1] + height])
            shell = _outwards(Shell(vertices, revolve(profile, segments=96).faces))
            prism = Prism(disc((tip.real, tip.imag), 0.5 * radius, 24), height - radius, height + radius)
            parts.append(Part(drawing.follower, "roller", shell, PIN_COLOR, (prism,), mates))
        return [*parts, *_turret(model, levels, drawing, disc(drawing.hinge, 0.8 * inner, 180))]
    top = levels.plate(levels.layer_of(drawing.follower))[0]
    low = height + inner + _ROLLER_CLEARANCE * depth
    edge = min(height + outer + 0.1 * depth, top)
    profile = ((0.0, low), (radius, low), (radius, edge), (pin, edge), (pin, top), (0.0, top))
    places = [complex(*drawing.tip)]
    if placed.blank.kind == "rib":
        reach = drawing.up * (0.5 * placed.blank.thickness + placed.cam.radius) / size
        places = [places[0] - reach, places[0] + reach]
    elif placed.blank.rollers and drawing.hinge is not None:
        places = roller_positions(placed, places[0], complex(*drawing.hinge))
    parts = []
    for z in places:
        at = (z.real, z.imag)
        shell = revolve(profile, at, segments=96)
        parts.append(Part(drawing.follower, "roller", shell, PIN_COLOR, (Prism(disc(at, radius, 48), low, top),), mates))
    if drawing.hinge is None:
        return parts
    spokes = [LineString([drawing.hinge, (z.real, z.imag)]).buffer(0.6 * radius) for z in places]
    star = unary_union(
        [
            *spokes,
            *(disc((z.real, z.imag), 0.9 * radius, 48) for z in places),
            disc(drawing.hinge, 1.6 * model.proportions.half_width, 48),
        ]
    )
    return [*parts, *_turret(model, levels, drawing, star)]


def _turret(model: ScaledMechanism, levels: Levels, drawing: SpatialCamDrawing, shape: Polygon) -> list[Part]:
    """Carrier of the rollers of a turret: a disc, or a star if they are perpendicular to it."""
    if not drawing.placed.blank.rollers or drawing.hinge is None:
        return []
    low, high = levels.plate(levels.layer_of(drawing.follower))
    low, high = low + 0.1 * (high - low), high - 0.1 * (high - low)  # thinner than the link, which stays visible
    outline = shape.difference(disc(drawing.hinge, 1.02 * model.proportions.half_width, 48))
    shell = plate_mesh(outline, (low, high), 0.0)
    return [Part(drawing.follower, "wheel", shell, None, (Prism(outline, low, high),), frozenset([drawing.joint]))]


_RING_POINTS = 360  # points of a ring
_FLANK_NODES = 9  # nodes along the roller of the interpolation of the flank


def _depth(placed: PlacedSpatial, p: Real) -> Real:
    """Depths (...) [m] of points (..., 3) along the roller: distance from the cam's axis, of a globoid from the pivot's circle."""
    rho = np.hypot(p[..., 0], p[..., 1])
    if placed.blank.kind != "globoid":
        return rho
    distance = abs(placed.pivot - placed.centre) if placed.pivot is not None else 0.0
    return np.hypot(distance - rho, p[..., 2])


def edge(placed: PlacedSpatial, side: int, at: float, shift: float = 0.0, theta: Real | None = None) -> Real:
    """The curve (n, 3) [m] of a flank at depth ``at`` [m], over cam angles ``theta`` (n,), by default a full turn; ``shift``: of
    the follower's coordinate."""
    cam = placed.cam if shift == 0.0 else replace(placed.cam, law=placed.cam.law.raised(shift))
    law = cam.law
    theta = law.start + law.length * np.arange(_RING_POINTS) / _RING_POINTS if theta is None else theta
    low, high = cam.inner, cam.outer
    along = np.linspace(low - 0.3 * (high - low), high + 0.3 * (high - low), _FLANK_NODES)
    p = cam.flank(theta, along, side).point
    depth = _depth(placed, p)
    k = np.clip((depth < at).sum(axis=1), 1, _FLANK_NODES - 1)
    rows = np.arange(len(theta))
    a, b = p[rows, k - 1], p[rows, k]
    da, db = depth[rows, k - 1], depth[rows, k]
    return np.asarray(a + ((at - da) / (db - da))[:, None] * (b - a))


def circle(azimuth: Real, radius: float | Real, z: float | Real) -> Real:
    return np.stack(np.broadcast_arrays(radius * np.cos(azimuth), radius * np.sin(azimuth), np.asarray(z, float)), axis=-1)


_RIB_SECTIONS = 360  # sections of the rib per turn of the cam
_RIB_FOOT = 0.03  # depth of the rib's foot below the floor, of the groove's depth
_CORE_RINGS = 33  # number of rings of a hollow core
_TURRET_ACROSS = 7  # number of lines on the top of a rib between its edges


def _floor_and_top(placed: PlacedSpatial, sunk: float = 0.0) -> tuple[float, float]:
    """Depths [m], as in `edge`, of the floor between the ribs and of the ribs' tops; ``sunk``: lowering of the floor, of the
    depth."""
    if placed.blank.kind == "globoid":
        return placed.cam.outer + sunk * placed.blank.depth, placed.cam.inner
    return placed.cam.inner - sunk * placed.blank.depth, placed.blank.radius


def _span(placed: PlacedSpatial) -> Real:
    """Cam angles (n,) over which the rib extends between the ends of the cam: as far as a roller next to the middle needs it."""
    law, step = placed.cam.law, 2.0 * np.pi / placed.blank.rollers
    theta = law.start + law.length * np.arange(-2 * _RIB_SECTIONS, 2 * _RIB_SECTIONS + 1) / _RIB_SECTIONS
    inside = np.flatnonzero(np.abs(law(theta, 0)[0] + 0.5 * step) < step * (1.0 - 1e-6))
    return np.asarray(theta[max(inside[0] - 1, 0) : inside[-1] + 2])


def rib(placed: PlacedSpatial) -> Shell:
    """The rib in the cam's own frame [m]: a tube with flat ends, whose top lies on the turned surface of the cam."""
    step, theta = 2.0 * np.pi / placed.blank.rollers, _span(placed)
    floor, top = _floor_and_top(placed, _RIB_FOOT)
    low = [edge(placed, -1, at, 0.0, theta) for at in (floor, top)]
    high = [edge(placed, 1, at, step, theta) for at in (top, floor)]
    points = np.stack([*low, *_between(placed, low[1], high[0], top), *high], axis=1)  # (n, m, 3)
    n, m = points.shape[:2]
    k = m * np.arange(n - 1)[:, None] + np.arange(m)
    ahead = m * np.arange(n - 1)[:, None] + (np.arange(m) + 1) % m
    a, b, c, d = (v.reshape(-1) for v in (k, ahead, ahead + m, k + m))
    fan = np.arange(1, m - 1)
    first = np.stack([0 * fan, fan + 1, fan], axis=1)
    last = m * (n - 1) + np.stack([0 * fan, fan, fan + 1], axis=1)
    return Shell(points.reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1), first, last]))


def _between(placed: PlacedSpatial, low: Real, high: Real, top: float) -> list[Real]:
    """Lines (n, 3) [m] on the rib's top between its two edges."""
    (a, b), (z, y) = (np.arctan2(p[:, 1], p[:, 0]) for p in (low, high)), (low[:, 2], high[:, 2])
    turn = np.mod(b - a + np.pi, 2.0 * np.pi) - np.pi
    shares = np.linspace(0.0, 1.0, _TURRET_ACROSS + 2)[1:-1]
    if placed.blank.kind != "globoid":
        return [circle(a + s * turn, top, z + s * (y - z)) for s in shares]
    assert placed.pivot is not None
    distance, psi = abs(placed.pivot - placed.centre), [np.arcsin(np.clip(v / top, -1.0, 1.0)) for v in (z, y)]
    angles = [psi[0] + s * (psi[1] - psi[0]) for s in shares]
    return [circle(a + s * turn, distance - top * np.cos(x), top * np.sin(x)) for s, x in zip(shares, angles, strict=True)]


def core_rings(placed: PlacedSpatial) -> list[Real]:
    """Rings (n, 3) [m] of the core below the ribs: a cylinder, or the hollow surface swept by the rollers' ends."""
    points = rib(placed).vertices
    azimuth = 2.0 * np.pi * np.arange(_RIB_SECTIONS) / _RIB_SECTIONS
    wall = 0.5 * placed.cam.radius
    if placed.blank.kind != "globoid":
        floor = _floor_and_top(placed)[0]
        return [circle(azimuth, floor, z) for z in (points[:, 2].min() - wall, points[:, 2].max() + wall)]
    assert placed.pivot is not None
    distance, outer = abs(placed.pivot - placed.centre), placed.cam.outer
    psi = np.arctan2(points[:, 2], distance - np.hypot(points[:, 0], points[:, 1]))
    ends = float(psi.min()) - wall / outer, float(psi.max()) + wall / outer
    return [circle(azimuth, distance - outer * np.cos(x), outer * np.sin(x)) for x in np.linspace(*ends, _CORE_RINGS)]


def roller_positions(placed: PlacedSpatial, tip: complex, hinge: complex) -> list[complex]:
    """Positions of all rollers of a turret, the named one first; of an arm only this one."""
    count = placed.blank.rollers or 1
    return [hinge + (tip - hinge) * complex(np.exp(2j * np.pi * k / count)) for k in range(count)]
