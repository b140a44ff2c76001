"""Solids of a whole mechanism: the result of the package."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.affinity import scale
from shapely.errors import GEOSException
from shapely.geometry import Polygon

from mechcore.arrays import Real, Single
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechcore.spec.mechanism import Mechanism
from mechviz.meshes.extrude import Part, Shell, joined_shells
from mechviz.meshes.heights import Heights, find_heights
from mechviz.meshes.kinds.fittings import with_welds_on_pins
from mechviz.meshes.kinds.rims import BeltLoop
from mechviz.meshes.kinds.spatial_cams import Spin, spatial_parts
from mechviz.meshes.kinds.wheels_drawn import find_loop
from mechviz.meshes.layers import Levels, Sweeps, poses_of, stack_pieces
from mechviz.meshes.model import ScaledMechanism, largest_circle, scale_mechanism
from mechviz.meshes.outline import ShapeError
from mechviz.meshes.parts import make_parts
from mechviz.meshes.shading import SolidColor, crisp, face_normals, link_colors
from mechviz.meshes.shapes import draft_pieces

if TYPE_CHECKING:
    import trimesh


CIRCLE_SIDES = 512  # sides of a full circle: 0.003 % of its area is missing
FLAT_KINDS = ("plate", "wheel", "block", "rail")
# Largest depth of all layers, of the mechanism's size: deeper stacks are drawn thinner, because perspective would displace layers
GREATEST_DEPTH = 0.12


@dataclass(frozen=True, eq=False)
class Solid:
    """The solid of one link, in the link's own frame [m]. z contains the height of its layer: poses move it only in the plane."""

    name: str
    shells: tuple[Shell, ...]  # its watertight parts, vertices shared
    kinds: tuple[str, ...]  # of the parts, see `parts.Part`
    vertices: Single  # (V, 3) [m], repeated along sharp edges
    faces: NDArray[np.uint32]  # (N, 3)
    normals: Single  # (V, 3), unit, outward
    colors: NDArray[np.uint8]  # (V, 4): the link's colour, pins in steel
    color: SolidColor  # of the link
    layer: int | tuple[int, ...]  # from the back; the frame has several, its pedestals lie on -1 (or in front of all)
    spin: Spin | None = None  # of a spatial cam: axis of rotation in the plane of motion

    @cached_property
    def parts(self) -> tuple[trimesh.Trimesh, ...]:
        """The watertight parts of `mesh`."""
        return tuple(_mesh(shell) for shell in self.shells)

    @cached_property
    def mesh(self) -> trimesh.Trimesh:
        """All parts together, watertight, vertices shared."""
        return _mesh(joined_shells(self.shells))


FARTHEST_POINT = 1e12  # [m] largest distance of points: beyond it, round-off destroys outlines


@dataclass(frozen=True, eq=False)
class Solids:
    """All solids of a mechanism."""

    links: Mapping[str, Solid]  # every link, the frame included
    size: float  # the larger side of the box around the mechanism's points over the run [m]
    z_top: float  # just above all parts: force arrows are drawn here [m]
    bounds: Real  # (2, 3) lowest and highest corner over the run [m]
    clashes: tuple[tuple[str, str], ...]  # links that collide in some frame, in the best order found
    heights: Heights  # heights z of marks
    chord: float  # largest distance of a facet from the circle that it approximates [m]
    loops: tuple[BeltLoop, ...] = ()  # centre lines of belts


def build_solids(
    mechanism: Mechanism,
    poses: Mapping[str, Real] | None = None,
    *,
    tolerance: float = 0.005,
    chord: float | None = None,
    profile: int = 1080,
    spindle: bool = False,
) -> Solids:
    """The solids of all links of a mechanism.

    ``poses``: x, y, angle (F, 3) [m, m, rad] of every link over the run; layers are chosen such that parts do not collide in these
    frames, if possible. Without poses, layers follow from the joints alone. ``tolerance``: largest distance between a circle and
    its chords, in radii of the circle. ``chord`` [m]: the same as an absolute limit for all circles, used instead; the largest
    circle determines the number of sides, at most 2048. ``profile``: points of a cam's profile. ``spindle``: the ground's guides
    are rods through their blocks. Raises `MechanismError` if links differ too much in size, or if points are too far away.
    """
    with shaped(mechanism), np.errstate(divide="raise", over="raise", invalid="raise"):  # values that give no solids
        for link in mechanism.links:
            far = float(np.abs([*link.points.values(), *link.outline, link.centre]).max())
            if far > FARTHEST_POINT:
                words = f"the solids cannot be made: points lie farther than {FARTHEST_POINT:g} m away, one {far:.3g} m."
                raise MechanismError(Fault(f"links.{link.name}", words, "Check its points, its centre of mass and their units."))
        return _build(mechanism, poses, tolerance, chord, profile, spindle)


@contextmanager
def shaped(mechanism: Mechanism) -> Iterator[None]:
    """A context that turns errors of shapes and numbers into a `MechanismError` about the sizes of links."""
    try:
        yield
    except (ShapeError, GEOSException, FloatingPointError) as error:
        spans = {link.name: float(np.max(np.ptp([(0.0, 0.0), *link.points.values()], axis=0))) for link in mechanism.links}
        long, short = max(spans, key=lambda k: spans[k]), min((k for k in spans if spans[k]), key=lambda k: spans[k], default="")
        beside = f", and link '{short}' {spans[short]:.3g} m" if short and short != long else ""
        words = f"the solids cannot be made: {error}; this link is {spans[long]:.3g} m long{beside}."
        raise MechanismError(Fault(f"links.{long}", words, "Check their points and units.")) from None


def _build(
    mechanism: Mechanism, poses: Mapping[str, Real] | None, tolerance: float, chord: float | None, profile: int, spindle: bool
) -> Solids:
    """The solids of `build_solids`."""
    model = scale_mechanism(mechanism, poses, _sides(tolerance, 128), profile, spindle=spindle)
    for cam in model.cams:
        reach = float(np.max(np.abs(cam.profile.bounds))) * cam.size
        if reach > FARTHEST_POINT:
            words = f"the solids cannot be made: its profile reaches {reach:.3g} m, farther than {FARTHEST_POINT:g} m."
            raise MechanismError(Fault(f"joints.{cam.joint}", words, "Check its lift, base circle and roller, and their units."))
    if chord is not None:
        model = replace(model, segments=_sides(chord / (model.size * largest_circle(model)), 512))
    draft = draft_pieces(model)
    levels = stack_pieces(model, draft)
    if levels.clashes and (other := with_welds_on_pins(model)).axles != model.axles:
        apart = draft_pieces(other)
        stacked = stack_pieces(other, apart)
        if stacked.clashes < levels.clashes:
            model, draft, levels = other, apart, stacked
    free = not model.telescopes and not model.planes  # thin barrels would look like wires; stated planes are kept
    if free and (levels.top + 1) * model.proportions.pitch > GREATEST_DEPTH:
        model = replace(model, proportions=model.proportions.thinner(GREATEST_DEPTH / ((levels.top + 1) * model.proportions.pitch)))
        draft, levels = draft_pieces(model), replace(levels, proportions=model.proportions)
    parts = make_parts(model, draft, levels)
    spins: dict[str, Spin] = {}
    if model.spatial_cams:
        more, spins = spatial_parts(model, levels)
        parts += more
    stated = {link.name: link.colour for link in mechanism.links if link.colour is not None}
    colors = link_colors(model.links, model.frame, stated)
    layers = _layers_of_links(model, levels, parts)
    links = _solids(model, parts, colors, layers, spins)
    bounds = _bounds(model, links)
    top = float(bounds[1, 2]) + 0.01 * model.size
    heights = find_heights(mechanism, model, parts, poses, top)
    return Solids(links, model.size, top, bounds, find_clashes(model, parts), heights, _sagitta(model), _loops(model, parts))


def _loops(model: ScaledMechanism, parts: list[Part]) -> tuple[BeltLoop, ...]:
    """Centre lines of the belts [m], at the heights of their parts, which are in the same order."""
    spaces = [part.space[0] for part in parts if part.kind == "belt"]
    belts = model.wheels.belts
    return tuple(find_loop(model, b).placed(model.size, s.low, s.high) for b, s in zip(belts, spaces, strict=True))


def _sagitta(model: ScaledMechanism) -> float:
    """Distance between the largest circle and the midpoints of its chords [m]."""
    return float(model.size * largest_circle(model) * (1.0 - np.cos(np.pi / model.segments)))


def _sides(tolerance: float, most: int) -> int:
    """Number of sides of a circle, a multiple of four up to four times ``most``, for a distance ``tolerance`` of chords in
    radii."""
    return 4 * int(
        np.clip(np.ceil(np.pi / np.arccos(1.0 - np.clip(tolerance, 1e-6, 0.5)) / 4.0), 3 if tolerance > 0.1 else 6, most)
    )


def stl_bytes(mesh: trimesh.Trimesh) -> bytes:
    """A binary STL file of a mesh [m], in millimetres."""
    scaled = mesh.copy()
    scaled.apply_scale(1000.0)
    data = scaled.export(file_type="stl")
    assert isinstance(data, bytes)
    return data


def find_clashes(model: ScaledMechanism, parts: list[Part]) -> tuple[tuple[str, str], ...]:
    """Pairs of links whose parts overlap in height and meet in some frame, by their exact outlines with holes."""
    if not model.frames:
        return ()
    owners = [(part, prism) for part in parts for prism in part.space]
    rank = {name: k for k, name in enumerate(model.links)}
    link = np.array([rank[part.link] for part, _ in owners], np.int64)
    low, high = np.array([(prism.low, prism.high) for _, prism in owners], float).T
    i, j = np.tril_indices(len(owners), -1)
    apart = (link[i] != link[j]) & (np.minimum(high[i], high[j]) > np.maximum(low[i], low[j]))
    i, j = i[apart], j[apart]
    meshing = [bool(owners[a][0].mates & owners[b][0].mates) for a, b in zip(i.tolist(), j.tolist(), strict=True)]
    i, j = (k[~np.array(meshing, bool)] for k in (i, j))
    both = np.sort(np.stack([link[i], link[j]], axis=1), axis=1)
    questions, asked = np.unique(both, axis=0, return_inverse=True)
    sweeps = Sweeps([prism.outline for _, prism in owners], [part.link for part, _ in owners], model.poses)
    met = questions[sweeps.meet(np.stack([i, j], axis=1), asked.reshape(-1))]
    return tuple(sorted((model.links[a], model.links[b]) for a, b in met.tolist()))


def _solids(
    model: ScaledMechanism,
    parts: list[Part],
    colors: Mapping[str, SolidColor],
    layers: Mapping[str, int | tuple[int, ...]],
    spins: Mapping[str, Spin],
) -> dict[str, Solid]:
    """The parts of each link joined and scaled to metres; creases are split for all links at once."""
    own = {name: [part for part in parts if part.link == name] for name in model.links}
    ordered = [part for some in own.values() for part in some]
    whole = joined_shells([part.shell for part in ordered])
    vertices, faces, normals, source = crisp(whole.vertices, whole.faces, *face_normals(whole.vertices, whole.faces))
    # where the parts begin among the original vertices, the split vertices, and the faces
    first = np.cumsum([0, *(len(part.shell.vertices) for part in ordered)])
    begin = np.searchsorted(source, first)
    face = np.cumsum([0, *(len(part.shell.faces) for part in ordered)])
    paint = np.array([part.color or colors[part.link] for part in ordered], np.uint8)
    solids, done = {}, 0
    for name, some in own.items():
        a, b = done, done + len(some)
        done = b
        solids[name] = Solid(
            name=name,
            shells=tuple(Shell(part.shell.vertices * model.size, part.shell.faces) for part in some),
            kinds=tuple(part.kind for part in some),
            vertices=(vertices[begin[a] : begin[b]] * model.size).astype(np.float32),
            faces=(faces[face[a] : face[b]] - begin[a]).astype(np.uint32),
            normals=normals[begin[a] : begin[b]].astype(np.float32),
            colors=np.repeat(paint[a:b], np.diff(begin[a : b + 1]), axis=0),
            color=colors[name],
            layer=layers[name],
            spin=spins.get(name),
        )
    return solids


def _mesh(shell: Shell) -> trimesh.Trimesh:
    import trimesh  # imported late: slow to load, and not needed for recordings

    # No processing: vertices are shared by construction, and merging by an absolute distance destroys tiny mechanisms.
    normals = face_normals(shell.vertices, shell.faces)[0]
    return trimesh.Trimesh(vertices=shell.vertices, faces=shell.faces, face_normals=normals, process=False)


def _layers_of_links(model: ScaledMechanism, levels: Levels, parts: list[Part]) -> dict[str, int | tuple[int, ...]]:
    layers: dict[str, int | tuple[int, ...]] = {name: levels.layer_of(name) for name in model.links if name != model.frame}
    heights = [part.space[0].low for part in parts if part.link == model.frame and part.kind != "pin"]
    layers[model.frame] = tuple(sorted({round(low / model.proportions.pitch) for low in heights}))
    return layers


def _bounds(model: ScaledMechanism, links: Mapping[str, Solid]) -> Real:
    """The box around all solids over the run (2, 3) [m]."""
    lows, highs = [], []
    for name, solid in links.items():
        pose = poses_of(model, name) * (model.size, model.size, 1.0)
        pose = pose[:1] if (pose == pose[0]).all() else pose
        if solid.spin is not None:
            pose = pose * (1.0, 1.0, 0.0)
        c, s = np.cos(pose[:, 2, None]), np.sin(pose[:, 2, None])
        x, y = _rim(solid).T
        at = pose[:, 0, None] + c * x - s * y, pose[:, 1, None] + s * x + c * y
        z = np.concatenate([shell.vertices[:, 2] for shell in solid.shells])
        lows.append([at[0].min(), at[1].min(), z.min()])
        highs.append([at[0].max(), at[1].max(), z.max()])
    return np.array([np.min(lows, axis=0), np.max(highs, axis=0)])


def _rim(solid: Solid) -> Real:
    """The vertices (n, 2) of a solid's convex hull in the plane, which determine its bounds at any angle."""
    xy = np.concatenate([shell.vertices[:, :2] for shell in solid.shells])
    return np.asarray(shapely.get_coordinates(shapely.convex_hull(shapely.linestrings(xy))))


def drawn_outlines(mechanism: Mechanism, poses: Mapping[str, Real] | None, links: Collection[str]) -> dict[str, list[Polygon]]:
    """Outlines of the flat parts of ``links`` in the links' frames [m], with pin holes and cut-outs.

    ``poses``: x, y, angle (F, 3) [m, m, rad] of every link over the run, as for `build_solids`: slots and guides depend on them.
    """
    with shaped(mechanism):
        model = scale_mechanism(mechanism, poses, CIRCLE_SIDES)
        draft = draft_pieces(model)
        parts = make_parts(model, draft, stack_pieces(model, draft))
    out: dict[str, list[Polygon]] = {name: [] for name in links}
    for part in parts:
        if part.link in out and part.kind in FLAT_KINDS:
            shape = part.space[0].outline
            whole = [shape] if isinstance(shape, Polygon) else list(shape.geoms)
            out[part.link] += [scale(p, model.size, model.size, origin=(0.0, 0.0)) for p in whole]
    return out
