"""The picture of a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Real, Single
from mechcore.errors import Fault, MechanismError
from mechviz.accuracy.fit import PROFILE_POINTS
from mechviz.meshes.kinds.spatial_cams import spin_transforms
from mechviz.meshes.solids import FARTHEST_POINT, Solids, build_solids
from mechviz.picture.arrows import Arrows, arrow_key, arrows_of, owner_of
from mechviz.picture.centres import centre_nodes
from mechviz.picture.fixtures import bounds_with, find_fixtures, has_spindle, joined_meshes, looks_of
from mechviz.picture.nodes import FARTHEST_VERTEX as REACH
from mechviz.picture.nodes import Body, Lines, Mesh, Picture, Points, PoseTrack, farthest
from mechviz.picture.overlays import inversion_nodes, overlay_nodes, section_nodes
from mechviz.picture.proportions import about_z, arc_height, arrow_height, in_space, path_height
from mechviz.picture.springs import SPRING_COLOR as COIL
from mechviz.picture.springs import Coil, find_coils, find_strut_glyphs
from mechviz.picture.surface_marks import find_surface_marks, stroke_nodes
from mechviz.quantities.items import links_of
from mechviz.quantities.vectors import point_name
from mechviz.scene.convert import Converter
from mechviz.scene.kinds.bodies import point_masses_of
from mechviz.scene.limits import check_drawn

if TYPE_CHECKING:
    from mechviz.runs import Run

HeightsByLink = Mapping[str, float]
UNDRAWN = "undrawn"  # group of solids that no output draws

COLLISION_FRAMES = 721
"""Frames at which solids are checked for collisions; more would cost time without finding others."""
STRUT_LINE_COLORS = {
    "torsion spring": (196, 214, 236),
    "damper": (168, 176, 188),
    "gas spring": (176, 190, 200),
    "actuator": (150, 170, 196),
    "bushing": (176, 150, 130),
}
STRUT_LINE_RADIUS = 0.0042  # radius of the lines of dampers and gas springs, in sizes of the mechanism
PATH_RADIUS = 0.0025
FRICTION_COLOR = (255, 214, 92)
CIRCLE_POINTS = 48
HALF_LINE_OF_ACTION = 0.12  # half of a drawn line of action, in sizes of the mechanism
FRICTION_LINE_RADIUS = 0.0018  # radius of friction circles and lines of action
POINT_MASS_COLOR = (228, 196, 96)
LARGEST_POINT_MASS = 0.045  # radius of the heaviest point mass, in sizes of the mechanism
DOT_RADIUS, DOT_COLOR = 0.0045, (250, 250, 250)


def picture_of(run: Run, solids: Solids, arrows: Arrows | None = None, known: Picture | None = None) -> Picture:
    """The complete picture of a run with its solids. Raises `MechanismError` where a node reaches farther than can be drawn.

    ``arrows``: those of the run, if they are known; ``known``: the picture of another run of the same scene, whose heights, widths
    of springs and fixtures are reused.
    """
    heights = {} if known is None else {node.key: node.height for node in known.nodes}
    arrows = arrows or arrows_of(run, solids.size)
    widths = {} if known is None else known.widths
    coils = find_coils(run, solids, {name: (heights[f"spring.{name}"], width) for name, width in widths.items()})
    fixtures = find_fixtures(run, solids, coils) if known is None else known.fixtures
    nodes = [
        *solid_nodes(run, solids, fixtures),
        *_springs(coils),
        *_marks(run, solids),
        *_struts(run, solids),
        *_friction(run, solids),
        *_masses(run, solids),
        *_paths(run, solids, heights),
        *stroke_nodes(run, solids),
        *joint_nodes(run, solids),
        *overlay_nodes(run, solids),
        *centre_nodes(run, solids),
        *inversion_nodes(run, solids),
        *section_nodes(run, solids),
        *arrows.nodes(_arrow_heights(run, solids, arrows, coils, heights), solids.z_top),
    ]
    for node in nodes:
        if farthest(node) > REACH:
            kind, name = node.owner
            words = f"what is drawn of it reaches {farthest(node):.3g} m; up to {REACH:g} m are drawn."
            raise MechanismError(Fault(f"{kind}s.{name}", words, "Check lengths and radii, and their units."))
    numbers = run.numbers
    return Picture(
        numbers.time,
        numbers.frame,
        numbers.poses,
        tuple(nodes),
        arrows.scales,
        solids.size,
        bounds_with(run, solids, fixtures),
        solids.z_top,
        widths={coil.name: coil.width for coil in coils},
        fixtures=fixtures,
        marks=run.scene.document.marks,
    )


def bare_picture(run: Run, solids: Solids) -> Picture:
    """A picture with only solids and joints, for a run whose other results are not known yet."""
    n, nodes = run.numbers, (*solid_nodes(run, solids), *joint_nodes(run, solids))
    scales = arrows_of(run, solids.size).scales
    bounds, marks = np.asarray(solids.bounds, float), run.scene.document.marks
    return Picture(n.time, n.frame, n.poses, nodes, scales, solids.size, bounds, solids.z_top, marks=marks)


def solid_nodes(run: Run, solids: Solids, fixtures: Mapping[str, Sequence[Mesh]] | None = None) -> Iterator[Body]:
    """The solids of the links with their fixtures. A solid that rotates about an axis of its own in the plane has poses in the axes
    of its link. Links with the look "nothing" are in the group ``UNDRAWN``."""
    looks = looks_of(run)
    for name, solid in solids.links.items():
        if not len(solid.faces):
            continue
        mesh = joined_meshes(
            [Mesh(solid.vertices, solid.faces, solid.normals, solid.colors[:, :3]), *(fixtures or {}).get(name, ())]
        )
        poses = None
        if solid.spin is not None:
            turned = run.motion.pose(name)[:, 2] - run.motion.pose(solid.spin.carrier)[:, 2]
            places, quaternions = spin_transforms(solid.spin, turned)
            poses = PoseTrack(_single(places), _single(quaternions))
        group = UNDRAWN if "nothing" in looks.get(name, ()) else "solids"
        yield Body(f"link.{name}", ("link", name), group, ("mechanism", "links", name, "mesh"), 0.0, name, mesh, poses)


def _springs(coils: list[Coil]) -> Iterator[Body]:
    """Springs between two points, scaled along their axes."""
    for coil in coils:
        mesh = Mesh(coil.vertices, coil.faces, coil.normals, _one_color(COIL, len(coil.vertices)))
        poses = PoseTrack(_single(coil.places()), _single(about_z(coil.pose[:, 2])), _single(coil.scales()))
        entity = ("mechanism", "springs", coil.name)
        yield Body(f"spring.{coil.name}", ("load", coil.name), "springs", entity, coil.height, "", mesh, poses)


def _marks(run: Run, solids: Solids) -> Iterator[Body]:
    """Surface marks of rollers and belts, in the axes of their links."""
    for mark in find_surface_marks(run, solids):
        mesh = Mesh(mark.vertices, mark.faces, mark.normals, _one_color(mark.color, len(mark.vertices)))
        poses = PoseTrack(_single(mark.places()), _single(mark.quaternions()))
        height = mark.centre[2] if mark.axis is None else 0.0
        key, entity = f"{mark.kind}.{mark.name}", ("mechanism", "links", mark.link, mark.title)
        yield Body(key, ("link", mark.link), mark.kind, entity, height, mark.link, mesh, poses)


def _struts(run: Run, solids: Solids) -> Iterator[Lines]:
    """Dampers, gas springs, actuators, bushings and torsion springs, drawn as lines."""
    height = solids.z_top + 0.004 * solids.size
    frames = np.arange(run.motion.frames)
    for strut in find_strut_glyphs(run, solids.size):
        strips = tuple(in_space(strip, height) for strip in strut.strips(frames))
        entity = ("mechanism", "springs", strut.name)
        owner = ("load", strut.name)
        yield Lines(
            f"spring.{strut.name}",
            owner,
            "springs",
            entity,
            height,
            strips,
            (STRUT_LINE_COLORS[strut.kind],),
            (STRUT_LINE_RADIUS * solids.size,),
        )


def _friction(run: Run, solids: Solids) -> Iterator[Lines]:
    """The friction circle of every pin, true to scale, and the line of action of its reaction, which is tangent to the circle.

    With Stribeck friction, which falls with the speed, it is the circle of static friction, and the line may intersect it."""
    if run.forces is None or run.forces.friction is None:
        return
    forces, friction = run.forces, run.forces.friction
    height = solids.z_top + 0.012 * solids.size
    turn = np.linspace(0.0, 2.0 * np.pi, CIRCLE_POINTS)
    around = np.column_stack([np.cos(turn), np.sin(turn)])
    for e in friction.elements:
        if e.kind != "pin":
            continue
        place, reaction = forces.position(e.joint), forces.reaction(e.joint)
        size = np.hypot(reaction[:, 0], reaction[:, 1])
        with np.errstate(invalid="ignore", divide="ignore"):
            along = reaction[:, :2] / size[:, None]
            arm = friction.wrench(e.joint)[:, 2] / size  # the moment about the pin is that of the force on its line of action
        touch = place + arm[:, None] * np.column_stack([along[:, 1], -along[:, 0]])
        half = HALF_LINE_OF_ACTION * solids.size * along
        circle = place[:, None] + (e.limit if e.friction.stribeck else e.factor) * around
        line = np.stack([touch - half, touch + half], axis=1)
        for name, strip in (("circle", circle), ("line", line)):
            there = np.asarray(np.isfinite(strip).all(axis=(1, 2)))
            yield Lines(
                f"friction.{e.joint}.{name}",
                ("joint", e.joint),
                "friction",
                ("vectors", "friction", e.joint, name),
                height,
                (np.where(there[:, None, None], in_space(strip, height), np.float32(np.nan)),),
                (FRICTION_COLOR,),
                (FRICTION_LINE_RADIUS * solids.size,),
                None if there.all() else there,
            )


def _masses(run: Run, solids: Solids) -> Iterator[Points]:
    """Point masses on links, as balls whose volumes are proportional to the masses."""
    document = run.scene.document
    points = {link.name: link.points for link in run.motion.mechanism.links}
    convert = Converter.of(document.units, run.scene.folder)
    masses = {
        name: point_masses_of(link.point_masses, points[name], convert, name)
        for name, link in document.links.items()
        if link.point_masses
    }
    heaviest = max((b.mass for bodies in masses.values() for b in bodies), default=0.0)
    for name, bodies in masses.items() if heaviest > 0.0 else ():
        yield Points(
            f"masses.{name}",
            ("link", name),
            "masses",
            ("mechanism", "links", name, "lumps"),
            solids.z_top,
            name,
            np.array([[(*b.centre, solids.z_top) for b in bodies]], np.float32),
            (POINT_MASS_COLOR,),
            tuple(LARGEST_POINT_MASS * solids.size * (b.mass / heaviest) ** (1.0 / 3.0) for b in bodies),
            tuple(run.scene.units.text(b.mass, "kg", 4) for b in bodies),
        )


def _paths(run: Run, solids: Solids, heights: HeightsByLink) -> Iterator[Lines]:
    """Paths of traced points over the run, at the height of the front of their links."""
    for link, point in run.motion.mechanism.traced:
        name = point_name(link, point)
        key = f"path.{name}"
        height = heights[key] if key in heights else path_height(run, solids.heights, link, point)
        strip = in_space(run.motion.point(link, point)[None], height)
        r, g, b = (int(0.5 * c + 127) for c in solids.links[link].color[:3])
        entity = ("mechanism", "paths", name)
        yield Lines(key, ("point", name), "paths", entity, height, (strip,), ((r, g, b),), (PATH_RADIUS * solids.size,))


def joint_nodes(run: Run, solids: Solids) -> Iterator[Points]:
    """A dot with its name at every joint. Of joints that coincide at all frames, the first one has all names."""
    places = {name: run.motion.joint_position(name) for name in run.numbers.joints}
    near = 1e-6 * run.motion.model.length_scale
    heaps: list[tuple[Real, list[str]]] = []
    for name, place in places.items():
        known = next((names for other, names in heaps if np.abs(other - place).max(initial=0.0) < near), None)
        if known is None:
            heaps.append((place, [name]))
        else:
            known.append(name)
    labels = {names[0]: ", ".join(names) for _, names in heaps}
    for name, place in places.items():
        height = solids.heights.of_joint(name)
        dots = in_space(place[:, None], height)
        entity = ("mechanism", "joints", name)
        label = (labels.get(name, ""),)
        look = (DOT_COLOR,), (DOT_RADIUS * solids.size,), label
        yield Points(f"joint.{name}", ("joint", name), "joints", entity, height, "", dots, *look)


def _arrow_heights(run: Run, solids: Solids, arrows: Arrows, coils: list[Coil], known: HeightsByLink) -> HeightsByLink:
    """Heights [m] of arrows and arcs by key; those in ``known`` are kept."""
    heights = {}
    for vector in arrows.vectors:
        key = arrow_key(vector)
        if key not in known:
            heights[key] = arrow_height(run, solids.heights, vector, arrows.scales.per_metre(vector.family))
    for moment, radius in zip(arrows.moments, arrows.radii, strict=True):
        key = arrow_key(moment)
        if key not in known:
            heights[key] = arc_height(run, solids.heights, moment, radius)
    behind: dict[tuple[str, str], float] = {("load", coil.name): coil.front for coil in coils}
    for moment in arrows.moments:
        height = heights.get(arrow_key(moment), known.get(arrow_key(moment), 0.0))
        behind[owner_of(moment)] = max(behind.get(owner_of(moment), height), height)
    for vector in arrows.vectors:  # forces are in front of the couple of their joint, and of the spring that exerts them
        key = arrow_key(vector)
        if key in heights:
            heights[key] = max(heights[key], behind.get(owner_of(vector), heights[key]))
    return {**known, **heights}


def _one_color(color: tuple[int, int, int], count: int) -> NDArray[np.uint8]:
    return np.tile(np.array(color, np.uint8), (count, 1))


def _single(values: Real) -> Single:
    return np.asarray(values, np.float32)


def solids_of(run: Run) -> Solids:
    """Meshes of all links, in layers that do not collide during the run. Raises `MechanismError` where there are too many links, or
    where one moves farther away than can be drawn."""
    settings = run.resolved_accuracy
    solids = build_solids(
        run.motion.mechanism,
        collision_poses(run),
        chord=settings.chord,
        profile=settings.profile or PROFILE_POINTS,
        spindle=has_spindle(run),
    )
    for link in links_of(run.motion):
        far = float(np.max(np.abs(run.motion.pose(link)[:, :2]), initial=0.0))
        if far > FARTHEST_POINT:
            words = f"it goes as far as {far:.3g} m away; up to {FARTHEST_POINT:g} m are drawn."
            raise MechanismError(Fault(f"links.{link}", words, "Check speeds, forces and the duration, or export its numbers."))
    return solids


def collision_poses(run: Run) -> dict[str, Real]:
    """Poses (n, 3) of all links at the frames at which solids are checked for collisions. Raises `MechanismError` where there are
    too many links."""
    motion = run.motion
    check_drawn(len(motion.mechanism.links))
    frames = np.unique(np.linspace(0, motion.frames - 1, min(motion.frames, COLLISION_FRAMES)).round().astype(int))
    return {link: motion.pose(link)[frames] for link in links_of(motion)}
