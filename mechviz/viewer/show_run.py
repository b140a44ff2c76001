"""A solved run as the viewer shows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechcore.accuracy import Accuracy
from mechcore.events import Event, find_events
from mechcore.friction.events import friction_events
from mechcore.spec import Force, Mechanism

from ..coils import find_coils
from ..drawings import drawings_of
from ..heights import arc_height, arrow_height, path_height
from ..linkers import find_linkers
from ..meshes import Solid, Solids
from ..record.diagrams import find_diagrams
from ..record.events import peak_events
from ..record.simulations import simulation_events
from ..riders import find_riders
from ..run import Run
from ..solids import solids_of
from ..tables import joints_of
from ..vectors import Scales, calm_frames, find_moments, find_scales, find_vectors
from . import words
from .alike import alike
from .quantities import find_axes, find_quantities, first_choice, slides
from .show import ArcTrack, Arrows, Body, DriveWay, Happening, Health, Piece, Rolling, Show
from .warp import warped_body
from .warp_cams import cam_profiles, stretched_cams

__all__ = ["Built", "build", "happenings", "health_of", "pieces_of", "show_of_run", "telling_frame"]

Real = NDArray[np.float64]

PLOTS = 3
KEPT_SCALE = (0.4, 2.5)  # while a scene is edited, arrows keep their scale as long as the best one is within this of it


@dataclass(frozen=True, eq=False)
class Built:
    """Solids, the mechanism and the accuracy that they were built for, and their pieces of one colour."""

    mechanism: Mechanism
    accuracy: Accuracy  # how finely they are drawn follows from it
    solids: Solids
    bodies: Mapping[str, Body]
    poses: Mapping[str, Real]  # over the run for which they were built
    cams: Mapping[str, tuple[str, Any]]  # by pair, see `cam_profiles`

    def fits(self, run: Run) -> bool:
        """Whether a run looks the same: masses, loads and the speed of the drives do not change any solid."""
        if self.accuracy != run.accuracy or not alike(_drawn(self.mechanism), _drawn(run.motion.mechanism)):
            return False
        return all(np.array_equal(pose, run.motion.pose(name)) for name, pose in self.poses.items())


def _drawn(mechanism: Mechanism) -> tuple[Any, ...]:
    """What solids depend on, apart from how the links move: what acts at a point is carried by the link's shape."""
    points = [(link.name, link.points) for link in mechanism.links]
    loaded = [(load.link, load.point) for load in mechanism.loads if isinstance(load, Force)]
    return points, mechanism.pairs, mechanism.traced, loaded, [drive.pair for drive in mechanism.drives]


def build(run: Run) -> Built:
    """The solids of a run."""
    motion, solids = run.motion, solids_of(run)
    poses = {link.name: motion.pose(link.name) for link in motion.mechanism.links}
    bodies = {name: Body(pieces_of(s), s.spin) for name, s in solids.links.items()}
    return Built(motion.mechanism, run.accuracy, solids, bodies, poses, cam_profiles(motion))


def pieces_of(solid: Solid) -> tuple[Piece, ...]:
    """A solid in pieces of one colour each: viser's meshes have a single one.

    The vertices are split along sharp edges, so that the normals which the browser makes are those of the solid.
    """
    return split_by_color(solid.vertices, solid.faces, solid.colors[:, :3])


def split_by_color(vertices: NDArray[np.float32], faces: NDArray[np.uint32], colors: NDArray[np.uint8]) -> tuple[Piece, ...]:
    """Pieces of a mesh whose vertices (V, 3) have colours (V, 3); every face has the colour of its first corner."""
    shades, piece = np.unique(colors, axis=0, return_inverse=True)
    piece = piece.reshape(-1)
    found = []
    for k, color in enumerate(shades):
        chosen = np.flatnonzero(piece == k)
        place = np.zeros(len(piece), np.uint32)
        place[chosen] = np.arange(len(chosen), dtype=np.uint32)
        own = faces[piece[faces[:, 0]] == k]
        found.append(Piece(vertices[chosen], place[own], (int(color[0]), int(color[1]), int(color[2]))))
    return tuple(found)


def show_of_run(run: Run, built: Built, before: Show | None = None) -> Show:
    """What is shown of a run with solids that were built for it, or for the same mechanism with other lengths.

    ``before``: what was shown so far of the same scene. Scales and heights are then kept as far as they still fit, so that
    dragging is quick and arrows can be compared; events are those of before until there are solids for the new run.
    """
    motion, mechanism, solids = run.motion, run.motion.mechanism, built.solids
    exact = built.mechanism is mechanism
    points = {link.name: link.points for link in built.mechanism.links}
    bodies = {
        link.name: body if exact else warped_body(body, points[link.name], link.points)
        for link in mechanism.links
        if (body := built.bodies.get(link.name)) is not None
    }
    if not exact and built.cams:
        bodies |= stretched_cams(bodies, built.cams, cam_profiles(motion))
    poses = {link.name: motion.pose(link.name) for link in mechanism.links}
    for name, pose in poses.items():
        if not np.isfinite(pose).all():  # viser would pass it on to the browsers
            raise ValueError(f"the pose of link {name} is not finite in all frames")
    vectors, moments = find_vectors(run), find_moments(run)
    scales = find_scales(vectors, moments, solids.size, calm_frames(run))
    if before is not None:
        scales = _kept(before.scales, scales)
    known = {} if before is None or exact else before.heights
    heights: dict[tuple[str, str], float] = {}
    arrows: dict[str, Arrows] = {}
    for family, items in vectors.items():
        for item, vector in items.items():
            key = (family, item)
            heights[key] = known[key] if key in known else arrow_height(run, solids.heights, vector, scales.per_metre(family))
        arrows[family] = Arrows(
            tuple(items),
            np.stack([v.origin for v in items.values()], axis=1),
            np.stack([v.value for v in items.values()], axis=1),
            np.array([heights[family, item] for item in items]),
        )
    arcs = []
    for family, found in moments.items():
        for item, moment in found.items():
            key = (f"{family} moment", item)
            heights[key] = known[key] if key in known else arc_height(run, solids.heights, moment, 0.085 * solids.size)
            arcs.append(ArcTrack(family, item, moment.origin, moment.value, heights[key]))
    paths = {}
    for link, point in mechanism.traced:
        key = ("path", f"{link}.{point}")
        heights[key] = known[key] if key in known else path_height(run, solids.heights, link, point)
        paths[f"{link}.{point}"] = np.column_stack([motion.point(link, point), np.full(motion.frames, heights[key])])
    coils = find_coils(run, solids, {name: (z, known["coil width", name]) for (kind, name), z in known.items() if kind == "coil"})
    for coil in coils:
        heights |= {("coil", coil.name): coil.height, ("coil width", coil.name): coil.width}
    quantities = tuple(find_quantities(run))
    return Show(
        title=run.scene.title,
        teaches=run.scene.teaches,
        time=np.asarray(motion.time, float),
        cycle=_cycle(run),
        drives=tuple(DriveWay(d.pair, slides(motion, d.pair), q[0]) for d, q in zip(mechanism.drives, motion.drives, strict=True)),
        frame=mechanism.frame,
        poses=poses,
        bodies=bodies,
        size=solids.size,
        bounds=np.asarray(solids.bounds, float),
        z_top=solids.z_top,
        arrows=arrows,
        arcs=tuple(arcs),
        scales=scales,
        paths=paths,
        joints={pair.name: motion.pair_position(pair.name) for pair in mechanism.pairs},
        quantities=quantities,
        axes=tuple(find_axes(run)),
        first=tuple(first_choice(run, PLOTS)),
        health=health_of(run),
        events=happenings(run) if exact or before is None else before.events,
        linkers=tuple(find_linkers(run, solids.size)),
        coils=tuple(coils),
        riders=tuple(find_riders(run, solids)),
        opening=telling_frame(run),
        notes=words.plan_list(run),
        run=run,
        kinds={j.name: (j.kind, j.links) for j in joints_of(motion)},
        heights=heights,
        drawings=lambda: drawings_of(run, solids.size),
        charts=lambda: find_diagrams(run),
        polodes=lambda: polodes_of(run),
    )


def polodes_of(run: Run) -> dict[str, Rolling]:
    """Pole curves that the scene asks for, by link."""
    points = {link.name: link.points for link in run.motion.mechanism.links}
    found = {}
    for name, polodes in run.studies.polodes.items():
        corners = [complex(*xy) for xy in (*points[name].values(), next(iter(points[name].values()), (0.0, 0.0)))]
        fixed, moving = (way @ np.array([1.0, 1.0j]) for way in (polodes.fixed, polodes.moving))
        found[name] = Rolling(fixed, moving, np.array(corners))
    return found


def _kept(old: Scales, new: Scales) -> Scales:
    """Scales of before where they still fit, else the new ones."""
    low, high = KEPT_SCALE
    names = ("newtons_per_metre", "newton_metres_per_metre", "mps_per_metre", "mps2_per_metre")
    kept = {n: getattr(old, n) for n in names if low <= getattr(new, n) / getattr(old, n) <= high and getattr(old, n) != 1.0}
    return replace(new, **kept)


def _cycle(run: Run) -> float:
    drives = run.motion.mechanism.drives
    cycle = float(drives[0].law.duration) if drives else float(run.motion.time[-1])
    return cycle if np.isfinite(cycle) and cycle > 0.0 else max(float(np.ptp(run.motion.time)), 1e-9)


def health_of(run: Run) -> tuple[Health, ...]:
    """The strips of a run's health. The limits are those of the solver: 1e-12 of the size is promised, 1e8 is singular."""
    motion = run.motion
    size = motion.model.size
    found = [
        Health("closure", "m", motion.closure, 1e-12 * size, 1e-6 * size),
        Health("condition", "1", motion.condition, 30.0, 1e8),
    ]
    if run.forces is not None:
        found.append(Health("power balance", "1", run.forces.power_balance, 1e-9, 1e-3))
    if run.simulation is not None:
        found.append(Health("energy drift", "1", run.simulation.drift(motion.time), 1e-7, 1e-3))
    return tuple(found)


def happenings(run: Run) -> tuple[Happening, ...]:
    """Events of the run, in the order of time."""
    found: list[Event] = list(peak_events(run))
    if run.simulation is not None:
        found += simulation_events(run)
    else:
        found += find_events(run.motion)
        found += [] if run.forces is None else friction_events(run.forces)
        if any(r.geometry is not None for r in run.motion.model.relations):
            from mechcore.cams.happenings import cam_events

            found += cam_events(run.motion, run.forces)
    told = sorted((e.in_units(run.scene.units) for e in found), key=lambda e: e.time)
    return tuple(Happening(e.time, e.level, f"{e.item}: {e.text}") for e in told)


def telling_frame(run: Run) -> int:
    """The frame to open at.

    With forces, where reactions and driving efforts together come nearest to their peaks: at a dead centre, where all links and
    arrows lie on one line, the effort is nothing. Else an eighth of the first drive's cycle into the run.
    """
    motion, forces = run.motion, run.forces
    if forces is not None:
        reactions = [np.hypot(*forces.reaction(pair.name)[:, :2].T) for pair in motion.mechanism.pairs]
        efforts = [forces.effort(drive.pair) for drive in motion.mechanism.drives]
        load = sum(_of_peak(values) for values in (*([np.max(reactions, axis=0)] if reactions else []), *efforts))
        if np.any(load):
            return int(np.argmax(load))
    cycle = motion.mechanism.drives[0].law.duration if motion.mechanism.drives else float(np.ptp(motion.time))
    return int(np.argmin(np.abs(motion.time - motion.time[0] - min(cycle, float(np.ptp(motion.time))) / 8.0)))


def _of_peak(values: Real) -> Real:
    """Magnitudes as parts of the largest one; nothing where they are not finite or all zero."""
    size = np.nan_to_num(np.abs(values), nan=0.0, posinf=0.0)
    return np.asarray(size / max(float(size.max(initial=0.0)), 1e-300))
