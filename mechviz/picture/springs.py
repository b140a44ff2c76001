"""Springs, dampers, gas springs, actuators, bushings and torsion springs: solids and lines that deform with the motion."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Integers, Real, Single
from mechcore.records import dataclass
from mechcore.spec.loads import Actuator, Bushing, Damper, GasSpring, Spring, TorsionSpring
from mechcore.spec.mechanism import Mechanism
from mechviz.meshes.extrude import Shell
from mechviz.picture.proportions import POT_HALF_WIDTH, SPIRAL_TURNS, occlusion_frames, pot_length, spiral_radius

if TYPE_CHECKING:
    from mechviz.meshes.solids import Solids
    from mechviz.runs import Run

SPRING_COLOR = (172, 188, 206)
COIL_RADIUS = 0.034  # mean radius of a coil, in sizes of the mechanism; a stem fits through it
STOUTEST_COIL = 0.4  # largest mean radius, in mean lengths of the spring
WIRE_DIAMETER = 0.3  # diameter of the wire, in radii of the coil
COIL_PITCH = 1.9  # pitch of the active turns, in diameters of the wire, where their number allows it
WIDEST_COIL = 0.55  # largest radius of a coil around a guide, in mean lengths of the spring
GUIDED_COIL_WIDTHS = (1.5, 2.0, 2.4)  # widths of coils around a guide that are tried, relative to the usual width
FEWEST_TURNS, MOST_TURNS = 4, 12  # active turns
LEAST_LENGTH = 1e-4  # least drawn length, in mean lengths of the spring


@dataclass(frozen=True, eq=False)
class Coil:
    """A spring: its mesh about the x axis from 0 to the mean length, and its pose and scale at every frame."""

    name: str
    pose: Real  # (F, 3): start [m] and direction [rad] in the plane; the direction is continuous
    stretch: Real  # (F,): length over the mean length
    height: float  # of its axis [m]
    width: float  # of the coil, relative to that of a spring around a stem only
    vertices: Single  # (V, 3) [m]
    faces: NDArray[np.uint32]  # (N, 3)
    normals: Single  # (V, 3), unit
    straight: bool  # tension spring with straight ends on its axis; else compression spring with flat ends

    def scales(self) -> Real:
        """Factors along x, y and z (F, 3)."""
        return np.column_stack([self.stretch, np.ones((len(self.stretch), 2))])

    @property
    def front(self) -> float:
        """Height [m] of its front."""
        return self.height + float(self.vertices[:, 2].max())

    def bounds(self) -> Real:
        """Box (2, 2) [m] around the spring in the plane, over the run."""
        long, wide = self.stretch * float(self.vertices[:, 0].max()), float(self.vertices[:, 1].max())
        end = self.pose[:, :2] + long[:, None] * np.column_stack([np.cos(self.pose[:, 2]), np.sin(self.pose[:, 2])])
        points = np.concatenate([self.pose[:, :2], end])
        return np.array([np.nanmin(points, axis=0) - wide, np.nanmax(points, axis=0) + wide])

    def places(self) -> Real:
        """Start of the spring (F, 3) [m]."""
        return np.column_stack([self.pose[:, :2], np.full(len(self.pose), self.height)])


def find_coils(run: Run, solids: Solids, known: Mapping[str, tuple[float, float]] | None = None) -> list[Coil]:
    """The springs of a run; none where no forces are computed. ``known``: height [m] and width of springs found before, by name."""
    if run.forces is None:
        return []
    coils = []
    for load in run.motion.mechanism.loads:
        if isinstance(load, Spring):
            coil = _coil(run, solids, load, (known or {}).get(load.name))
            coils += [] if coil is None else [coil]
    return coils


def _coil(run: Run, solids: Solids, load: Spring, known: tuple[float, float] | None) -> Coil | None:
    a, b = (run.motion.point(*end) for end in zip(load.links, load.points, strict=True))
    d = b - a
    length = np.hypot(d[:, 0], d[:, 1])
    seen = length[np.isfinite(length)]
    mean = 0.5 * float(seen.min() + seen.max()) if len(seen) else 0.0
    if mean <= LEAST_LENGTH * solids.size:  # its ends coincide: nothing to draw
        return None
    radius = min(COIL_RADIUS * solids.size, STOUTEST_COIL * mean)
    wire = WIRE_DIAMETER * radius
    straight = mean > load.free_length
    turns = float(np.clip(np.floor(0.5 + (mean - 2.0 * wire) / (COIL_PITCH * wire)), FEWEST_TURNS, MOST_TURNS))
    most = max(1.0, WIDEST_COIL * mean / radius)
    height, width = known or _place(
        run, solids, load, (a, b), (radius, wire), [w for w in GUIDED_COIL_WIDTHS if w <= most and not straight]
    )
    shell, normals = coil_shell(mean, min(width, most) * radius, wire, turns, straight=straight)
    angle = np.unwrap(np.arctan2(d[:, 1], d[:, 0])) if len(seen) == len(length) else np.arctan2(d[:, 1], d[:, 0])
    return Coil(
        load.name,
        np.column_stack([a, angle]),
        np.maximum(length / mean, LEAST_LENGTH),
        height,
        width,
        shell.vertices.astype(np.float32),
        shell.faces.astype(np.uint32),
        normals.astype(np.float32),
        straight,
    )


def _place(
    run: Run, solids: Solids, load: Spring, ends: tuple[Real, Real], coil: tuple[float, float], widths: list[float]
) -> tuple[float, float]:
    """Height [m] of a spring's axis, and its width. The axis is in the middle of one of its links if the coil, or a wider one
    around a guide, does not collide there; otherwise in front of all parts that it would hit."""
    heights, (radius, wire) = solids.heights, coil
    frames, known = occlusion_frames(run, heights)
    a, b = (end[frames] for end in ends)
    d = b - a
    across = np.column_stack([-d[:, 1], d[:, 0]]) / np.maximum(np.hypot(d[:, 0], d[:, 1]), 1e-300)[:, None]

    def sides(r: float) -> list[Real]:
        return [np.stack([a + x * across, b + x * across], axis=1) for x in (r, -r)]

    points = {link.name: link.points for link in run.motion.mechanism.links}
    for link, point in zip(load.links, load.points, strict=True):
        middle = heights.mid_height(link, points[link][point])
        for width in (1.0, *widths) if middle is not None else ():
            r = width * radius + 0.5 * wire
            both = [*sides(r), *sides(r - wire)]
            if middle is not None and not any(heights.is_crossed((middle - r, middle + r), side, known) for side in both):
                return middle, width
    start = 0.0
    for line in (np.stack([a, b], axis=1), *sides(radius + 0.5 * wire)):
        start = heights.clear_height(start, line, known)
    return start + radius + 0.5 * wire, 1.0


SPIRAL_POINTS = 72
RING_POINTS = 37
BUSHING_RADIUS = 0.03  # radius of a bushing's ring, in sizes of the mechanism


@dataclass(frozen=True)
class Strut:
    """A load that is drawn as a cylinder with a rod between two points, each (link, point)."""

    name: str
    kind: str  # "damper", "gas spring", "actuator"
    ends: tuple[tuple[str, str], tuple[str, str]]


def find_struts(mechanism: Mechanism) -> Iterator[Strut]:
    """Dampers, gas springs and actuators between two points."""
    for load in mechanism.loads:
        if isinstance(load, Damper | GasSpring | Actuator) and load.points:
            kind = "damper" if isinstance(load, Damper) else "gas spring" if isinstance(load, GasSpring) else "actuator"
            first, second = zip(load.links, load.points, strict=True)
            yield Strut(load.name, kind, (first, second))


@dataclass(frozen=True, eq=False)
class StrutGlyph:
    """A load that is drawn as lines: ``strips(frames)`` gives its polylines at n frames, one array (n, points, 2) [m] for each
    line."""

    name: str
    kind: str  # "damper", "gas spring", "actuator", "bushing", "torsion spring"
    strips: Callable[[Integers], tuple[Real, ...]]


def find_strut_glyphs(run: Run, size: float) -> Iterator[StrutGlyph]:
    """The loads of a run that are drawn as lines; none where no forces are computed. ``size``: of the mechanism [m]."""
    if run.forces is None:
        return
    motion = run.motion
    for strut in find_struts(motion.mechanism):
        a, b = (motion.point(*end) for end in strut.ends)
        yield StrutGlyph(strut.name, strut.kind, _between(a, b, strut.kind, size))
    yield from _bushings(run, size)
    for load in motion.mechanism.loads:
        if isinstance(load, TorsionSpring):
            pin = next((p for p in motion.mechanism.joints if set(p.links) == set(load.links) and hasattr(p, "points")), None)
            if pin is not None:
                centre = motion.joint_position(pin.name)
                angles = [motion.pose(link)[:, 2] for link in load.links]
                yield StrutGlyph(load.name, "torsion spring", _around(centre, angles[0], angles[1], size))


def _bushings(run: Run, size: float) -> Iterator[StrutGlyph]:
    """For each bushing a ring about its first point, and a cross on its second link at its second point."""
    for load in run.motion.mechanism.loads:
        if isinstance(load, Bushing):
            (first, a), (second, b) = zip(load.links, load.points, strict=True)
            centre, place, angle = run.motion.point(first, a), run.motion.point(second, b), run.motion.pose(second)[:, 2]
            yield StrutGlyph(load.name, "bushing", partial(bushing_strips, centre, place, angle, BUSHING_RADIUS * size))


def bushing_strips(centre: Real, place: Real, angle: Real, radius: float, frames: Integers) -> tuple[Real, Real, Real]:
    """Strips of a bushing at some frames: a ring of a ``radius`` [m] about ``centre`` (F, 2) [m], and the two bars of a cross at
    ``place`` (F, 2) [m], rotated by ``angle`` (F,) [rad]."""
    around = radius * np.exp(1j * np.linspace(0.0, 2.0 * np.pi, RING_POINTS))
    arms = radius * np.exp(1j * angle[frames])[:, None] * np.array([-1.0, 1.0])
    middle = place[frames] @ [1.0, 1.0j]
    lines = ((centre[frames] @ [1.0, 1.0j])[:, None] + around, middle[:, None] + arms, middle[:, None] + 1j * arms)
    ring, bar, other = (np.stack([z.real, z.imag], axis=-1) for z in lines)
    return ring, bar, other


def strut_ends(run: Run) -> list[Real]:
    """End points (F, 2) [m] of springs, dampers, gas springs and actuators between two points."""
    if run.forces is None:
        return []
    mechanism = run.motion.mechanism
    ends = [end for load in mechanism.loads if isinstance(load, Spring) for end in zip(load.links, load.points, strict=True)]
    ends += [end for strut in find_struts(mechanism) for end in strut.ends]
    return [run.motion.point(*end) for end in ends]


def _between(a: Real, b: Real, kind: str, size: float) -> Callable[[Integers], tuple[Real, ...]]:
    length = np.hypot(*(b - a).T)
    least, most = float(np.nanmin(length)), float(np.nanmax(length))
    return lambda frames: strut_strips(a[frames], b[frames], least, most, POT_HALF_WIDTH * size, closed=kind != "damper")


def _around(centre: Real, first: Real, second: Real, size: float) -> Callable[[Integers], tuple[Real, ...]]:
    return lambda frames: (spiral_strips(centre[frames], first[frames], second[frames], size),)


def _axes(a: Real, b: Real) -> tuple[Real, Real, Real]:
    """Distances (n,) from a to b, and unit vectors (n, 2) along and across; where the points coincide, along is the x direction."""
    d = b - a
    length = np.hypot(d[:, 0], d[:, 1])
    along = np.where((length > 0.0)[:, None], d / np.where(length > 0.0, length, 1.0)[:, None], [1.0, 0.0])
    return length, along, np.column_stack([-along[:, 1], along[:, 0]])


def _placed(a: Real, along: Real, across: Real, u: Real, v: Real) -> Real:
    """Points (n, p, 2) at the distances u along and v across [m], each (n, p), from the points a (n, 2)."""
    return a[:, None] + u[..., None] * along[:, None] + v[..., None] * across[:, None]


def strut_strips(a: Real, b: Real, least: float, most: float, width: float, *, closed: bool) -> tuple[Real, Real]:
    """Strips (cylinder, rod) of a damper (open cylinder with a piston) or a gas spring (``closed`` cylinder) between points (n, 2).

    Cylinder and rod keep their lengths while the distance of the points varies between ``least`` and ``most``.
    """
    length, along, across = _axes(a, b)
    pot = pot_length(least, most)
    plate = np.clip(length - (most - 0.92 * pot), 0.05 * pot, 0.95 * pot)  # position of the piston in the cylinder
    ones = np.ones_like(length)
    start = 0.0 if closed else 0.12 * pot  # a damper's cylinder is attached by a short rod
    outline = [(0.0, 0.0), (start, 0.0), (start, width), (pot, width), (pot, -width), (start, -width), (start, 0.0)]
    if not closed:  # open at the end where the rod enters
        outline = [(pot, width), (start, width), (start, 0.0), (0.0, 0.0), (start, 0.0), (start, -width), (pot, -width)]
    u, v = (np.outer(ones, column) for column in zip(*outline, strict=True))
    body = _placed(a, along, across, u, v)
    zero, w = np.zeros_like(length), 0.8 * width * ones
    u = np.column_stack([length, plate, plate, plate])
    v = np.column_stack([zero, zero, w, -w])
    return body, _placed(a, along, across, u, v)


def ends_of_strut(body: Real, rod: Real, *, closed: bool) -> tuple[Real, Real]:
    """The end points (n, 2) from which `strut_strips` made a ``body`` and its ``rod``."""
    return body[:, 0 if closed else 3], rod[:, 0]


def spiral_strips(centre: Real, first: Real, second: Real, size: float) -> Real:
    """A spiral spring (n, points, 2) [m] about centres (n, 2) [m], from the angle ``second`` (n,) [rad] of one link inside to the
    angle ``first`` (n,) of the other outside; ``size``: of the mechanism [m]."""
    part = np.linspace(0.0, 1.0, SPIRAL_POINTS)
    angle = second[:, None] + (first - second + 2.0 * np.pi * SPIRAL_TURNS)[:, None] * part
    r = spiral_radius(part, size)
    return np.asarray(centre[:, None] + r[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1))


def axis_of_spiral(spiral: Real, size: float) -> tuple[Real, Real, Real]:
    """Centres (n, 2) [m] of spirals (n, points, 2) made by `spiral_strips` with a ``size`` [m], the angles (n,) [rad] at which they
    begin inside, and the angles (n,) [rad] through which they are wound.

    ``|z - c|^2 = r^2`` at the known radii r is linear in the centre c and in |c|^2, and is solved by least squares.
    """
    r = spiral_radius(np.linspace(0.0, 1.0, spiral.shape[1]), size)
    middle = spiral.mean(axis=1)
    z = (spiral - middle[:, None]) / size
    equations = np.concatenate([2.0 * z, np.ones((*z.shape[:2], 1))], axis=2)
    centre = np.linalg.pinv(equations) @ ((z**2).sum(axis=2) - (r / size) ** 2)[..., None]
    from_centre = (z - centre[:, None, :2, 0]) @ np.array([1.0, 1.0j])
    steps = np.angle(from_centre[:, 1:] / from_centre[:, :-1])
    return middle + size * centre[:, :2, 0], np.unwrap(np.angle(from_centre[:, 0])), steps.sum(axis=1)


WIRE_SIDES = 8  # sides of the wire's cross-section
STEPS_IN_TURN = 18  # cross-sections of the wire per turn
CLOSED_TURNS = 1.0  # closed turns at each end of a compression spring
GROUND_END = 0.15  # thickness of the wire at a ground end, in diameters of the wire
STEM_LENGTH = 0.12  # straight fraction of the length at each end of a tension spring


def coil_shell(length: float, radius: float, wire: float, turns: float, *, straight: bool) -> tuple[Shell, Real]:
    """Shell of a spring from x = 0 to ``length`` [m] around the x axis, and outward unit normals at its vertices (V, 3).

    ``radius``: mean radius of the coil [m]; ``wire``: diameter of the wire [m]; ``turns``: number of active turns. Closed turns at
    both ends are ground flat; with ``straight`` the wire leads into the axis instead.
    """
    line, phase = _pulled(length, radius, turns) if straight else _pushed(length, radius, wire, turns)
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    out = np.column_stack([np.zeros(len(line)), np.cos(phase), np.sin(phase)])
    out -= (out * along).sum(axis=1, keepdims=True) * along
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    side = np.cross(along, out)
    angle = 2.0 * np.pi * np.arange(WIRE_SIDES) / WIRE_SIDES
    normals = np.cos(angle)[:, None] * out[:, None] + np.sin(angle)[:, None] * side[:, None]
    vertices = (line[:, None] + 0.5 * wire * normals).reshape(-1, 3)
    normals = normals.reshape(-1, 3)
    if not straight:
        for end, sign in ((0.0, -1.0), (length, 1.0)):
            beyond = sign * (vertices[:, 0] - end) > 0.0
            vertices[beyond, 0] = end
            normals[beyond] = (sign, 0.0, 0.0)
    count = len(line)
    ring, place = np.arange(WIRE_SIDES), np.arange(count - 1)[:, None] * WIRE_SIDES
    after = np.roll(ring, -1)
    walls = [np.stack([place + ring, place + after, place + WIRE_SIDES + after], axis=-1).reshape(-1, 3),
             np.stack([place + ring, place + WIRE_SIDES + after, place + WIRE_SIDES + ring], axis=-1).reshape(-1, 3)]  # fmt: skip
    ends = len(vertices) + np.arange(2)
    last = (count - 1) * WIRE_SIDES
    caps = [
        np.column_stack([after, ring, np.full(WIRE_SIDES, ends[0])]),
        np.column_stack([last + ring, last + after, np.full(WIRE_SIDES, ends[1])]),
    ]
    vertices = np.vstack([vertices, vertices[:WIRE_SIDES].mean(axis=0), vertices[last:].mean(axis=0)])
    normals = np.vstack([normals, -along[0], along[-1]])
    return Shell(vertices, np.vstack([*walls, *caps])), normals


def _pushed(length: float, radius: float, wire: float, turns: float) -> tuple[Real, Real]:
    """Centre line (n, 3) of the wire of a compression spring, and its angle (n,) about the axis [rad]. It rises by the wire's
    diameter per closed turn, and evenly in the active turns."""
    whole = turns + 2.0 * CLOSED_TURNS
    t = np.linspace(0.0, whole, round(whole * STEPS_IN_TURN) + 1)
    low = (GROUND_END - 0.5) * wire
    step = min(wire, 0.25 * length / CLOSED_TURNS)
    knots = [0.0, CLOSED_TURNS, whole - CLOSED_TURNS, whole]
    x = np.interp(t, knots, [low, low + CLOSED_TURNS * step, length - low - CLOSED_TURNS * step, length - low])
    phase = 2.0 * np.pi * t
    return np.column_stack([x, radius * np.cos(phase), radius * np.sin(phase)]), phase


def _pulled(length: float, radius: float, turns: float) -> tuple[Real, Real]:
    """Centre line (n, 3) of the wire of a tension spring, and its angle (n,) about the axis [rad]: along the axis, out to the coil
    over half a turn, and back at the other end."""
    t = np.linspace(0.0, turns, round(turns * STEPS_IN_TURN) + 1)
    blend = np.clip(np.minimum(t, turns - t) / 0.5, 0.0, 1.0)
    r = radius * blend**2 * (3.0 - 2.0 * blend)
    x = length * (STEM_LENGTH + (1.0 - 2.0 * STEM_LENGTH) * t / turns)
    phase = 2.0 * np.pi * t
    line = np.column_stack([x, r * np.cos(phase), r * np.sin(phase)])
    return np.vstack([[0.0, 0.0, 0.0], line, [length, 0.0, 0.0]]), np.concatenate([phase[:1], phase, phase[-1:]])
