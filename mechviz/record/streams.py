"""Entities of a recording as streams of rows, written block by block, and as static archetypes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..accuracy.kept import plain_stride
from ..heights import arc_height, arrow_height, path_height
from ..linkers import Linker
from ..proportions import ARC_RADIUS
from ..tables import Table, joints_of, links_of, pair_unit
from ..turns import about_z
from ..vectors import Scales, Vector, point_name
from .arrows import COLORS, Arc, Arrow, arc_strips, arc_sweep, visible
from .colors import packed
from .paths import entity

if TYPE_CHECKING:
    from ..meshes import Solids
    from ..run import Run

__all__ = [
    "Static",
    "Stream",
    "Timelines",
    "arrow_streams",
    "in_space",
    "linker_streams",
    "linker_styles",
    "magnification",
    "mechanism_streams",
    "picture_stride",
    "static_shapes",
    "table_streams",
]

Real = NDArray[np.float64]
Index = NDArray[np.int64]

SMALLEST_DRAWN = 0.05  # [m]

LINKER_COLORS = {
    "torsion spring": (196, 214, 236),
    "damper": (168, 176, 188),
    "gas spring": (176, 190, 200),
    "actuator": (150, 170, 196),
    "bushing": (176, 150, 130),
}


@dataclass(frozen=True)
class Stream:
    """An entity with one row per frame, or per ``every``-th frame. ``columns`` makes the rows of some frames."""

    path: str
    columns: Callable[[Index], Any]
    every: int = 1


@dataclass(frozen=True)
class Static:
    """A static archetype of an entity."""

    path: str
    archetype: Any


@dataclass(frozen=True, eq=False)
class Timelines:
    """Integer times of the frames: nanoseconds, and milli-degrees or micrometres of the first rotary and sliding drive."""

    time: Index  # [ns]
    drives: tuple[tuple[str, Index], ...]

    @classmethod
    def of(cls, run: Run) -> Timelines:
        """The timelines of a run."""
        motion = run.motion
        found: dict[str, Index] = {}
        for drive in motion.mechanism.drives:
            position = motion.coordinate(drive.pair)[:, 0]
            if pair_unit(motion, drive.pair) == "rad":
                found.setdefault("drive_mdeg", _integers(np.degrees(position) * 1e3))
            else:
                found.setdefault("drive_um", _integers(position * 1e6))
        return cls(time=_integers(motion.time * 1e9), drives=tuple(found.items()))

    def columns(self, frames: Index) -> list[Any]:
        """Time columns of some frames."""
        return self._columns(self.time[frames], [(name, ticks[frames]) for name, ticks in self.drives])

    def columns_at(self, times: Real) -> list[Any]:
        """Time columns of moments [s] that need not be frames; the drives' positions are interpolated."""
        ns = _integers(times * 1e9)
        return self._columns(ns, [(name, _integers(np.interp(ns, self.time, ticks))) for name, ticks in self.drives])

    def _columns(self, ns: Index, drives: list[tuple[str, Index]]) -> list[Any]:
        import rerun as rr

        return [
            rr.TimeColumn("time", duration=ns.astype("timedelta64[ns]")),
            *(rr.TimeColumn(name, sequence=ticks) for name, ticks in drives),
        ]


def _integers(values: Real) -> Index:
    return np.round(values).astype(np.int64)


def picture_stride(run: Run) -> int:
    """Every how many frames arrows are drawn: all of them up to 720 frames a cycle of the first drive, or as the accuracy says."""
    return run.kept.pictures or plain_stride(run.motion)


def table_streams(all_tables: list[Table], numbers: str | None = None) -> Iterator[Stream]:
    """The float64 numbers; with ``numbers`` "float32" they keep the digits of those only, which takes less room."""
    import rerun as rr

    for table in all_tables:
        values = np.ascontiguousarray(table.values)
        if numbers == "float32":
            values = values.astype(np.float32).astype(float)

        def columns(frames: Index, values: Real = values) -> Any:
            chosen = values[frames]
            return rr.Scalars.columns(scalars=chosen.reshape(-1)).partition(np.full(len(chosen), chosen.shape[1]))

        yield Stream(entity(*table.path), columns)


def mechanism_streams(run: Run, solids: Solids) -> Iterator[Stream]:
    """Poses of the links and places of the joints."""
    import rerun as rr

    motion = run.motion
    for link in links_of(motion):
        pose = motion.pose(link)

        def place(frames: Index, pose: Real = pose) -> Any:
            return rr.Transform3D.columns(
                translation=in_space(pose[frames, :2], 0.0),
                quaternion=about_z(pose[frames, 2]).astype(np.float32),
            )

        yield Stream(entity("mechanism", "links", link), place)
        spin = solids.links[link].spin
        if spin is not None:  # the solid below its link's frame turns about its own axis instead
            from ..meshes.spatial import spin_transforms

            moves = spin_transforms(spin, pose[:, 2] - motion.pose(spin.carrier)[:, 2])

            def turn(frames: Index, moves: tuple[Real, Real] = moves) -> Any:
                return rr.Transform3D.columns(
                    translation=moves[0][frames].astype(np.float32), quaternion=moves[1][frames].astype(np.float32)
                )

            yield Stream(entity("mechanism", "links", link, "mesh"), turn)
    for joint in joints_of(motion):
        position = motion.pair_position(joint.name)

        height = solids.heights.of_joint(joint.name)

        def point(frames: Index, position: Real = position, height: float = height) -> Any:
            return rr.Points3D.columns(positions=in_space(position[frames], height))

        yield Stream(entity("mechanism", "joints", joint.name), point)


def arrow_streams(run: Run, arrows: list[Arrow], arcs: list[Arc], scales: Scales, solids: Solids, every: int) -> Iterator[Stream]:
    """Arrows and arcs on the mechanism; what is too short to be seen has no instance in its row."""
    import rerun as rr

    size = solids.size
    for arrow in arrows:
        scale = scales.per_metre(arrow.vector.family)
        seen = visible(arrow.vector.value, scale, size)
        z = arrow_height(run, solids.heights, arrow.vector, scale)

        def draw(frames: Index, vector: Vector = arrow.vector, seen: Any = seen, scale: float = scale, z: float = z) -> Any:
            shown = frames[seen[frames]]
            return rr.Arrows3D.columns(
                origins=in_space(vector.origin[shown], z), vectors=in_space(vector.value[shown] / scale, 0.0)
            ).partition(seen[frames].astype(np.int64))

        yield Stream(entity(*arrow.path), draw, every)
    for arc in arcs:
        sweep = np.where(arc.shown, arc_sweep(arc.moment.value, scales.newton_metres_per_metre, size), 0.0)
        z = arc_height(run, solids.heights, arc.moment, ARC_RADIUS * size)

        def bend(frames: Index, origin: Real = arc.moment.origin, sweep: Real = sweep, z: float = z) -> Any:
            shown = frames[sweep[frames] != 0]
            strips = arc_strips(origin[shown], sweep[shown], z, size)
            return rr.LineStrips3D.columns(strips=strips).partition((sweep[frames] != 0).astype(np.int64))

        yield Stream(entity(*arc.path), bend, every)


def linker_streams(linkers: list[Linker], solids: Solids, every: int) -> Iterator[Stream]:
    """Dampers, gas springs and torsion springs as lines that deform with the motion."""
    import rerun as rr

    z = solids.z_top + 0.004 * solids.size
    for linker in linkers:

        def bend(frames: Index, linker: Linker = linker) -> Any:
            lines = [_strips_in_space(line, z) for line in linker.strips(frames)]
            strips = [line[k] for k in range(len(frames)) for line in lines]
            return rr.LineStrips3D.columns(strips=strips).partition(np.full(len(frames), len(lines)))

        yield Stream(entity("mechanism", "springs", linker.name), bend, every)


def linker_styles(linkers: list[Linker], size: float) -> Iterator[Static]:
    """How dampers, gas springs and torsion springs look."""
    import rerun as rr

    for linker in linkers:
        style = rr.LineStrips3D.from_fields(colors=[LINKER_COLORS[linker.kind]], radii=[0.0042 * size])
        yield Static(entity("mechanism", "springs", linker.name), style)


def _strips_in_space(lines: Real, z: float) -> NDArray[np.float32]:
    """Polylines (n, points, 2) of the plane -> (n, points, 3) float32."""
    out = np.full((*lines.shape[:2], 3), z, np.float32)
    out[..., :2] = lines
    return out


def magnification(size: float) -> float:
    """How much a mechanism of this size [m] is enlarged for the viewer, which draws nothing nearer to its eye than a centimetre."""
    return 1.0 if size >= SMALLEST_DRAWN else float(10.0 ** np.ceil(np.log10(SMALLEST_DRAWN / size)))


def static_shapes(run: Run, solids: Solids, arrows: list[Arrow], arcs: list[Arc]) -> Iterator[Static]:
    """View coordinates, meshes, traced paths, and how joints, arrows and arcs look."""
    import rerun as rr

    motion, size = run.motion, solids.size
    yield Static("mechanism", rr.ViewCoordinates.RIGHT_HAND_Y_UP)
    enlarged = magnification(size)
    if enlarged != 1.0:  # the data stay in metres; only what the viewer draws is enlarged
        for root in ("mechanism", "vectors", "legend", "polygons"):
            yield Static(root, rr.Transform3D(scale=enlarged))
    for name, solid in solids.links.items():
        if not len(solid.faces):
            continue
        _check_mesh(name, solid)
        mesh = rr.Mesh3D(
            vertex_positions=solid.vertices,
            triangle_indices=solid.faces,
            vertex_normals=solid.normals,
            vertex_colors=solid.colors,
        )
        yield Static(entity("mechanism", "links", name, "mesh"), mesh)
    for joint, label in _labels(run).items():
        style = rr.Points3D.from_fields(
            colors=packed([(250, 250, 250)]), radii=[0.0045 * size], labels=[label], show_labels=bool(label)
        )
        yield Static(entity("mechanism", "joints", joint), style)
    for link, point in motion.mechanism.traced:
        path = in_space(motion.point(link, point), path_height(run, solids.heights, link, point))
        color = tuple(int(0.5 * c + 127) for c in solids.links[link].color[:3])
        strip = rr.LineStrips3D([path], colors=[color], radii=[0.0025 * size])
        yield Static(entity("mechanism", "paths", point_name(link, point)), strip)
    for arrow in arrows:
        family = arrow.vector.family
        radius = (0.004 if family in ("velocity", "acceleration") else 0.0055) * size
        yield Static(entity(*arrow.path), rr.Arrows3D.from_fields(colors=packed([COLORS[family]]), radii=[radius]))
    for arc in arcs:
        yield Static(
            entity(*arc.path), rr.LineStrips3D.from_fields(colors=packed([COLORS[arc.moment.family]]), radii=[0.0055 * size])
        )


def _labels(run: Run) -> dict[str, str]:
    """What is written at each joint: its name, or all names at the first of joints that lie at the same place all the time."""
    motion = run.motion
    near = 1e-6 * motion.model.size
    heaps: list[tuple[Real, list[str]]] = []
    joints = [joint.name for joint in joints_of(motion)]
    for joint in joints:
        place = motion.pair_position(joint)
        for known, names in heaps:
            if np.abs(known - place).max(initial=0.0) < near:
                names.append(joint)
                break
        else:
            heaps.append((place, [joint]))
    first = {names[0]: ", ".join(names) for _, names in heaps}
    return {joint: first.get(joint, "") for joint in joints}


def _check_mesh(name: str, solid: Any) -> None:
    """rerun takes any indices and NaN coordinates without a word, and the viewer then shows nothing."""
    if not (np.isfinite(solid.vertices).all() and np.isfinite(solid.normals).all() and solid.faces.max() < len(solid.vertices)):
        raise ValueError(f"the mesh of link '{name}' is broken")


def in_space(xy: Real, z: float) -> NDArray[np.float32]:
    """Points or vectors (n, 2) of the plane -> (n, 3) float32."""
    return np.column_stack([xy, np.full(len(xy), z)]).astype(np.float32)
