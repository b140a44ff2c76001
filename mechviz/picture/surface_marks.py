"""Marks that show motion: surface marks, which move relative to their link (on rolling rollers and running belts), and the ink of
pens, lines on a sheet that grow with the frames."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Flags, Index, Integers, Real, Single, Values
from mechcore.cams.followers import Roller
from mechcore.cams.placement.inverse import PlacedInverse
from mechcore.cams.placement.plane import PlacedCam
from mechcore.cams.placement.spatial import PlacedSpatial, roller_angle
from mechcore.forces.cam_rating import contact_force, placed_cams
from mechcore.records import dataclass
from mechcore.spec.mechanism import CamJoint
from mechviz.picture.nodes import Body, Color, Lines, Mesh
from mechviz.picture.proportions import about_z, in_space

if TYPE_CHECKING:
    from mechcore.spec.studies import PenStudy
    from mechviz.meshes.kinds.rims import BeltLoop
    from mechviz.meshes.solids import Solids
    from mechviz.runs import Run

MarkKind = Literal["roller", "belt"]
MARK_KINDS: tuple[MarkKind, ...] = get_args(MarkKind)
MARK_COLORS: dict[MarkKind, tuple[int, int, int]] = {"roller": (60, 66, 74), "belt": (236, 196, 64)}


@dataclass(frozen=True, eq=False)
class SurfaceMark:
    """A mark in the axes of a link: its mesh about ``centre`` (x, y, z) [m], or about the places ``path`` (F, 3) [m] over the
    frames, rotated by ``angle`` (F,) [rad] relative to the link, about z or about the direction ``axis`` in the plane."""

    kind: MarkKind
    name: str
    link: str
    centre: tuple[float, float, float]
    angle: Real
    vertices: Single  # (V, 3) [m]
    faces: NDArray[np.uint32]  # (N, 3)
    normals: Single  # (V, 3)
    axis: tuple[float, float] | None = None
    path: Real | None = None

    @property
    def title(self) -> str:
        """Kind and name, which name the mark's entity below that of its link."""
        return f"{self.kind} {self.name}"

    @property
    def color(self) -> tuple[int, int, int]:
        return MARK_COLORS[self.kind]

    def quaternions(self) -> Real:
        """Quaternions x, y, z, w (F, 4)."""
        if self.axis is None:
            return about_z(self.angle)
        c, s = np.cos(0.5 * self.angle), np.sin(0.5 * self.angle)
        return np.column_stack([self.axis[0] * s, self.axis[1] * s, np.zeros_like(s), c])

    def places(self) -> Real:
        """Places (F, 3) [m] in the link's axes."""
        return np.tile(np.array(self.centre, float), (len(self.angle), 1)) if self.path is None else self.path


def find_surface_marks(run: Run, solids: Solids) -> list[SurfaceMark]:
    """All surface marks of a run."""

    return [*find_rollers(run, solids), *find_belt_marks(run, solids)]


RING_INNER, RING_OUTER = 0.55, 0.93  # radii of the marked ring, in radii of the roller
RING_SECTORS, RING_SIDES = 3, 16
MARK_THICKNESS = 0.012  # of a mark, in radii of the roller


def find_rollers(run: Run, solids: Solids) -> list[SurfaceMark]:
    """Marks of the rollers of all cams of a run, of both rollers of conjugate cams and of ribs; none for motions under forces.

    Rollers of turrets have no marks, because they engage one after the other.
    """
    if run.simulation is not None or not any(r.geometry is not None for r in run.motion.model.relations):
        return []
    joints = {joint.name: joint for joint in run.motion.mechanism.joints if isinstance(joint, CamJoint)}
    links = {link.name: link for link in run.motion.mechanism.links}
    marks: list[SurfaceMark] = []
    for cam in placed_cams(run.motion):
        if not isinstance(cam.face, Roller):
            continue
        force = 1.0 if run.forces is None else np.nan_to_num(contact_force(run.forces, cam), nan=1.0)
        joint = joints[cam.name]
        link = cam.links[0] if isinstance(cam, PlacedInverse) else cam.links[1]
        at = links[link].points.get(joint.point, (0.0, 0.0))
        if isinstance(cam, PlacedSpatial):
            if not cam.blank.rollers:
                marks += (_along if cam.blank.kind == "globoid" else _beside)(run, solids, cam, link, at, force)
            continue
        wanted = [(cam.name, cam, at, force)]
        if isinstance(cam, PlacedCam) and cam.mate is not None and joint.second is not None:
            wanted.append((f"{cam.name} second", cam.mate, links[link].points[joint.second[0]], 1.0))
        for name, rolling, (x, y), pressed in wanted:
            assert isinstance(rolling.face, Roller)
            radius = rolling.face.radius
            top = _face(solids, link, (x, y), radius)
            if top is not None:
                turned = roller_angle(run.motion, rolling, pressed)
                marks.append(SurfaceMark("roller", name, link, (x, y, top), turned, *_sectors(radius)))
    return marks


def _beside(
    run: Run, solids: Solids, cam: PlacedSpatial, link: str, at: tuple[float, float], force: Values
) -> Iterator[SurfaceMark]:
    """Stripes on the cylindrical surfaces of rollers in front of a cam whose axis is in the plane."""
    solid, radius = solids.links[link], cam.face.radius
    for kind, part in zip(solid.kinds, solid.shells, strict=True):
        x, y = part.bounds[:, :2].mean(axis=0)
        if kind != "roller":
            continue
        above = 0
        if cam.blank.kind == "rib":
            along = run.motion.pose(link)[0, 2] - run.motion.pose(cam.carrier)[0, 2]
            above = 1 if ((x - at[0] + 1j * (y - at[1])) * np.exp(1j * along) * np.conj(1j * cam.axes)).real > 0.0 else -1
        wide = np.hypot(part.vertices[:, 0] - x, part.vertices[:, 1] - y) > 0.99 * radius
        low, high = (float(f(part.vertices[wide, 2])) for f in (np.min, np.max))
        name = {0: cam.name, 1: f"{cam.name} upper", -1: f"{cam.name} lower"}[above]
        turned = roller_angle(run.motion, cam, force, above)
        yield SurfaceMark("roller", name, link, (float(x), float(y), low), turned, *_stripes(radius, high - low))


def _along(
    run: Run, solids: Solids, cam: PlacedSpatial, link: str, at: tuple[float, float], force: Values
) -> Iterator[SurfaceMark]:
    """Stripes on the cylindrical surface of a roller whose axis is in the plane, along its arm."""
    assert cam.pivot is not None
    solid, radius = solids.links[link], cam.face.radius
    part = next(p for k, p in zip(solid.kinds, solid.shells, strict=True) if k == "roller")
    base, arm = run.motion.pose(cam.carrier)[0], run.motion.pose(link)[0]
    place = complex(base[0], base[1]) + cam.pivot * np.exp(1j * base[2]) - complex(arm[0], arm[1])
    hinge = place * np.exp(-1j * arm[2])
    unit = (complex(*at) - hinge) / abs(complex(*at) - hinge)
    axis = np.array([unit.real, unit.imag, 0.0])
    start = np.array([hinge.real, hinge.imag, 0.5 * (part.vertices[:, 2].min() + part.vertices[:, 2].max())])
    own = (part.vertices - start) @ axis
    wide = np.linalg.norm(part.vertices - start - own[:, None] * axis, axis=1) > 0.99 * radius
    low, high = float(own[wide].min()), float(own[wide].max())
    vertices, faces, normals = _stripes(radius, high - low)
    frame = np.array([[-unit.imag, unit.real, 0.0], [0.0, 0.0, 1.0], axis])  # across, towards the viewer, along: a rotation
    x, y, z = (start + low * axis).tolist()
    shape = (vertices @ frame).astype(np.float32), faces, (normals @ frame).astype(np.float32)
    yield SurfaceMark(
        "roller", cam.name, link, (x, y, z), roller_angle(run.motion, cam, force), *shape, axis=(unit.real, unit.imag)
    )


def _face(solids: Solids, link: str, at: tuple[float, float], radius: float) -> float | None:
    """Height [m] of the front of the roller about a point ``at`` of a link; None where the link has no such part."""
    for part in solids.links[link].shells:
        low, high = part.bounds
        round_it = np.allclose(0.5 * (low + high)[:2], at, atol=0.02 * radius)
        if round_it and np.allclose((high - low)[:2], 2.0 * radius, rtol=0.02):
            return float(high[2])
    return None


def _sectors(radius: float) -> tuple[Single, NDArray[np.uint32], Single]:
    """Vertices, faces and normals of flat ring sectors just in front of a roller's face."""
    vertices: list[Real] = []
    faces: list[Integers] = []
    for k in range(RING_SECTORS):
        turn = 2.0 * np.pi * (k + np.linspace(0.0, 0.5, RING_SIDES + 1)) / RING_SECTORS
        start = len(vertices) * 2 * (RING_SIDES + 1)
        ring = np.exp(1j * turn)
        points = radius * np.concatenate([RING_INNER * ring, RING_OUTER * ring])
        vertices.append(np.column_stack([points.real, points.imag, np.full(len(points), MARK_THICKNESS * radius)]))
        a = start + np.arange(RING_SIDES)
        b = a + RING_SIDES + 1
        faces += [np.column_stack([a, b, b + 1]), np.column_stack([a, b + 1, a + 1])]
    flat = np.vstack(vertices).astype(np.float32)
    return flat, np.vstack(faces).astype(np.uint32), np.tile(np.array([0.0, 0.0, 1.0], np.float32), (len(flat), 1))


def _stripes(radius: float, height: float) -> tuple[Single, NDArray[np.uint32], Single]:
    """Vertices, faces and normals of stripes along a cylinder from z = 0 to ``height``, and of sectors on its upper face."""
    vertices: list[Real] = []
    normals: list[Real] = []
    faces: list[Integers] = []
    for k in range(RING_SECTORS):
        turn = 2.0 * np.pi * (k + np.linspace(0.0, 0.5, RING_SIDES + 1)) / RING_SECTORS
        ring = np.column_stack([np.cos(turn), np.sin(turn)])
        start = len(vertices) * 2 * (RING_SIDES + 1)
        rows = [
            np.column_stack([(1.0 + MARK_THICKNESS) * radius * ring, np.full(len(ring), z)]) for z in (0.04 * height, 0.96 * height)
        ]
        vertices.append(np.concatenate(rows))
        normals.append(np.tile(np.column_stack([ring, np.zeros(len(ring))]), (2, 1)))
        a = start + np.arange(RING_SIDES)
        b = a + RING_SIDES + 1
        faces += [np.column_stack([a, a + 1, b + 1]), np.column_stack([a, b + 1, b])]
    flat, own, up = _sectors(radius)
    count = sum(map(len, vertices))
    return (
        np.vstack([*vertices, flat + np.array([0.0, 0.0, height])]).astype(np.float32),
        np.vstack([*faces, own + count]).astype(np.uint32),
        np.vstack([*normals, up]).astype(np.float32),
    )


def forward_filled(values: Real, known: Flags) -> Real:
    """Values (F, ...) in which unknown ones are replaced by the last known value before them, at the start by the first known one;
    all zero where none is known."""
    if known.all():
        return np.asarray(values, float)
    if not known.any():
        return np.zeros_like(values, dtype=float)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.asarray(values[np.where(last < 0, int(np.argmax(known)), last)], float)


BELT_MARKS = 8  # marks on a belt
BELT_MARK_LENGTH = 1.1  # length of a mark, in thicknesses of the belt
BELT_MARK_HEIGHT = 0.09  # height of a mark above the belt, in thicknesses of the belt


def find_belt_marks(run: Run, solids: Solids) -> Iterator[SurfaceMark]:
    """The marks of all belts of a run, in the axes of the links that carry the pulleys."""
    for loop in solids.loops:
        closed = belt_travel(run, loop)
        over = BELT_MARK_HEIGHT * loop.thick
        box = _box(BELT_MARK_LENGTH * loop.thick, loop.thick + 2.0 * over, loop.high - loop.low + 2.0 * over)
        height = 0.5 * (loop.low + loop.high)
        for k in range(BELT_MARKS):
            at, direction = loop.at(closed + k * loop.length / BELT_MARKS)
            path = np.column_stack([at.real, at.imag, np.full(len(at), height)])
            first = (float(path[0, 0]), float(path[0, 1]), height)
            yield SurfaceMark("belt", f"{loop.joint} {k + 1}", loop.carrier, first, direction, *box, path=path)


def belt_travel(run: Run, loop: BeltLoop) -> Real:
    """Travel of a belt (F,) [m]: that of the rim of its first pulley relative to the carrier. It does not change at frames that
    cannot be assembled."""
    turned = run.motion.pose(loop.pulley)[:, 2] - run.motion.pose(loop.carrier)[:, 2]
    turned = forward_filled(turned, np.isfinite(turned))
    return np.asarray(loop.radii[0] * (turned - turned[0]))


def _box(*sides: float) -> tuple[Single, NDArray[np.uint32], Single]:
    """A box about the origin: vertices (24, 3), four to a face, faces (12, 3), normals (24, 3)."""
    vertices, normals = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            normal = sign * np.eye(3)[axis]
            across = np.roll(normal, 1)
            for u, v in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
                corner = normal + u * across + v * np.cross(normal, across)
                vertices.append(0.5 * corner * sides)
                normals.append(normal)
    faces = (4 * np.arange(6)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    return np.array(vertices, np.float32), faces.astype(np.uint32), np.array(normals, np.float32)


STROKE_COLOR: Color = (44, 66, 138)
SHEET_COLOR: Color = (150, 156, 168)
PAPER_COLOR: Color = (252, 249, 240)
STROKE_RADIUS, SHEET_EDGE_RADIUS = 0.0022, 0.0012  # radii of ink and of the sheet's edge, in sizes of the mechanism
_WIDEST_STROKE = 0.005  # largest radius of ink, in sizes of the drawing, so that small drawings of large machines stay legible
_STROKE_TOLERANCE = 2e-4  # tolerance of simplified ink, in sizes of the mechanism or of the drawing, the smaller one
PAPER_THICKNESS = 0.004  # in sizes of the mechanism
_SHEET_MARGIN = 0.12  # margin of the sheet on all sides, in sizes of the drawing


def pen_down(run: Run, pen: PenStudy) -> Flags:
    """Whether a pen is on the paper at each frame (F,)."""
    if pen.joint is None:
        return np.ones(run.motion.frames, bool)
    at = run.motion.coordinate(pen.joint)[:, 0]
    return np.asarray(at <= pen.level if pen.below else at >= pen.level)


def stroke_nodes(run: Run, solids: Solids) -> Iterator[Lines | Body]:
    """The lines of all pens behind the parts, a strip for each stroke, which show at each frame what has been drawn so far; and the
    sheets of the pens."""
    size, height = solids.size, float(solids.bounds[0][2])
    for pen in run.motion.mechanism.studies.pens:
        places = run.motion.point(pen.link, pen.point)
        strokes = [s for s in drawn_strokes(pen_down(run, pen)) if len(s) > 1]
        if not strokes:
            continue
        inked = places[np.concatenate(strokes)]
        low, high = inked.min(axis=0), inked.max(axis=0)
        extent = float((high - low).max())
        radius, fine = min(STROKE_RADIUS * size, _WIDEST_STROKE * extent), _STROKE_TOLERANCE * min(size, extent)
        strips = tuple(in_space(strip, height) for strip in growing(places, strokes, fine))
        common: dict[str, Any] = {"owner": ("point", f"{pen.link}.{pen.point}"), "height": height}
        yield Lines(
            f"ink.{pen.name}",
            group="ink",
            entity=("mechanism", "ink", pen.name),
            strips=strips,
            colors=(STROKE_COLOR,),
            radii=(radius,),
            **common,
        )
        (x0, y0), (x1, y1) = low - _SHEET_MARGIN * extent, high + _SHEET_MARGIN * extent
        corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])
        sheet = (in_space(corners[None], height),)
        entity = ("mechanism", "sheets", pen.name)
        yield Lines(
            f"sheet.{pen.name}",
            group="sheet",
            entity=entity,
            strips=sheet,
            colors=(SHEET_COLOR,),
            radii=(SHEET_EDGE_RADIUS * size,),
            **common,
        )
        vertices, faces, normals = _box(x1 - x0, y1 - y0, PAPER_THICKNESS * size)
        behind = height - (0.5 * PAPER_THICKNESS + STROKE_RADIUS) * size  # ink is as thick as it is wide
        middle = np.array([0.5 * (x0 + x1), 0.5 * (y0 + y1), behind])
        colors = np.tile(np.array(PAPER_COLOR, np.uint8), (len(vertices), 1))
        paper = Mesh((vertices + middle).astype(np.float32), faces, normals, colors)
        yield Body(f"paper.{pen.name}", group="sheet", entity=(*entity, "paper"), parent="", mesh=paper, **common)


def drawn_strokes(down: Flags) -> list[Index]:
    """The frames of each stroke, in order; ``down`` (F,): whether the pen is on the paper."""
    frames = np.flatnonzero(down)
    return np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1) if len(frames) else []


def growing(places: Real, strokes: list[Index], fine: float) -> Iterator[Real]:
    """Strips (F, n, 2) of strokes along places (F, 2) [m], each with as many points as it needs to be within ``fine`` [m].

    A point that is not reached yet is at the position of the pen, or where the pen was last on the paper.
    """
    down = np.zeros(len(places), int)
    every = np.concatenate(strokes)
    down[every] = every
    last = np.maximum(np.maximum.accumulate(down), every[0])  # last frame at which the pen was on the paper
    for stroke in strokes:
        kept = stroke[_needed(places[stroke], fine)]
        until = np.minimum(
            kept[None, :], last[:, None]
        )  # all points of a stroke that has not begun are at the end of the stroke before
        yield places[until]


def _needed(z: Real, fine: float) -> Index:
    """Indices of the points of a polyline (n, 2) that approximate it within ``fine`` [m] (Douglas and Peucker)."""
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
