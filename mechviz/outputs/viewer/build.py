"""View models: a solved run, or a recording, as the viewer shows it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from mechcore.accuracy import Accuracy
from mechcore.arrays import Real
from mechcore.joints.registry import build_joints
from mechcore.records import dataclass
from mechcore.spec.loads import Force, Spring
from mechcore.spec.mechanism import Mechanism
from mechviz.meshes.solids import Solids
from mechviz.outputs.drawings import find_diagrams
from mechviz.outputs.presentation import presentation_in
from mechviz.outputs.rerun.content import html_of
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.recorded import RecordedDrawings
from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.view_model import ColoredPart, LinkSolid, RollingCentrodes, ViewModel
from mechviz.outputs.viewer.world.warp import cam_profiles, stretched_cams, warped_body
from mechviz.picture.arrows import arrows_of
from mechviz.picture.build import picture_of, solid_nodes, solids_of
from mechviz.picture.constructions import drawings_of
from mechviz.picture.fixtures import find_fixtures, looks_of
from mechviz.picture.nodes import Body as BodyNode
from mechviz.picture.nodes import Lines, Mesh, Picture
from mechviz.picture.springs import find_coils, find_struts
from mechviz.quantities.events import events_of
from mechviz.quantities.numbers import Numbers
from mechviz.quantities.vectors import Scales
from mechviz.runs import Run

KEPT_SCALE = (0.4, 2.5)  # while a scene is edited, arrows keep their scale as long as best scale / kept scale is in this range


@dataclass(frozen=True, eq=False)
class Built:
    """Solids, the mechanism and accuracy for which they were built, and their pieces of one colour each."""

    mechanism: Mechanism
    accuracy: Accuracy  # determines the resolution of the solids
    solids: Solids
    bodies: Mapping[str, LinkSolid]
    poses: Mapping[str, Real]  # of the run for which they were built
    cams: Mapping[str, tuple[str, Any]]  # by joint, see `cam_profiles`
    solid_inputs: tuple[Any, ...]  # see `solid_inputs`

    def fits(self, run: Run) -> bool:
        """Whether the solids hold for a run too: same geometry, accuracy and poses; masses and load values may differ."""
        if self.accuracy != run.accuracy or not deep_equal(self.solid_inputs, solid_inputs(run)):
            return False
        return all(np.array_equal(pose, run.motion.pose(name)) for name, pose in self.poses.items())


def solid_inputs(run: Run) -> tuple[Any, ...]:
    """What determines the solids apart from the poses: the links with their looks and the points where forces act, to which their
    shapes extend, and the springs, struts and stops, which have seats, brackets and anvils."""
    mechanism = run.motion.mechanism
    points = [(link.name, link.points) for link in mechanism.links]
    loaded = [(load.link, load.point) for load in mechanism.loads if isinstance(load, Force)]
    links = points, mechanism.joints, mechanism.traced, loaded, [drive.joint for drive in mechanism.drives]
    springs = [(load.links, load.points, load.free_length) for load in mechanism.loads if isinstance(load, Spring)]
    sprung = (springs, list(find_struts(mechanism))) if run.forces is not None else ()
    stops = () if run.simulation is None else run.simulation.stops
    return links, looks_of(run), sprung, [(stop.joint, stop.at, stop.side) for stop in stops]


def build(run: Run) -> Built:
    """The solids of a run."""
    motion, solids = run.motion, solids_of(run)
    bodies = bodies_of(solid_nodes(run, solids, find_fixtures(run, solids, find_coils(run, solids))))
    return Built(motion.mechanism, run.accuracy, solids, bodies, run.numbers.poses, cam_profiles(motion), solid_inputs(run))


def bodies_of(nodes: Iterable[BodyNode]) -> dict[str, LinkSolid]:
    """The solids of the links, by the name of the link."""
    return {node.parent: LinkSolid(pieces_of(node.mesh), node.poses is not None) for node in nodes if node.group == "solids"}


def pieces_of(mesh: Mesh) -> tuple[ColoredPart, ...]:
    """A solid in pieces of one colour each: a mesh of viser has a single colour.

    The vertices are split along sharp edges, so that the normals computed by the browser are those of the solid.
    """
    return tuple(ColoredPart(mesh.vertices[chosen], faces, color) for color, chosen, faces in mesh.pieces())


def view_model_of_run(run: Run, built: Built, before: ViewModel | None = None) -> ViewModel:
    """View model of a run with solids that were built for it, or for the same mechanism with other dimensions.

    ``before``: the view model shown so far of the same scene. Its scales and heights are kept as far as they still fit, so that
    dragging is quick and arrows can be compared; its events are kept until there are solids for the new run.
    Raises ValueError if a pose is not finite.
    """
    motion, mechanism, solids = run.motion, run.motion.mechanism, built.solids
    exact = built.mechanism is mechanism
    bodies = dict(built.bodies)
    if not exact:
        old, new = (points_of(m) for m in (built.mechanism, mechanism))
        bodies = {link: warped_body(body, old[link], new.get(link, old[link])) for link, body in bodies.items()}
        if built.cams:
            bodies |= stretched_cams(bodies, built.cams, cam_profiles(motion))
    for name, pose in run.numbers.poses.items():
        if not np.isfinite(pose).all():  # viser would send it to the browsers
            raise ValueError(f"the pose of link {name} is not finite in all frames")
    arrows = arrows_of(run, solids.size)
    if before is not None:
        arrows = replace(arrows, scales=_kept_scales(before.scales, arrows.scales))
    return ViewModel(
        title=run.scene.title,
        learning_goal=run.scene.learning_goal,
        picture=picture_of(run, solids, arrows, None if before is None or exact else before.picture),
        bodies=bodies,
        catalogue=run.catalogue,
        exact=exact,
        events=events_of(run) if exact or before is None else before.events,
        notes=words.plan_list(run),
        run=run,
        drawings=lambda: drawings_of(run, solids.size),
        charts=lambda: find_diagrams(run),
        centrodes=lambda: centrodes_of(run),
    )


def points_of(mechanism: Mechanism) -> dict[str, Mapping[str, tuple[float, float]]]:
    """The points of all links, including the links that joints add."""
    return {link.name: link.points for link in build_joints(mechanism).links.values()}


def centrodes_of(run: Run) -> dict[str, RollingCentrodes]:
    """Centrodes that the scene requests, by link."""
    points = {link.name: link.points for link in run.motion.mechanism.links}
    rolling = {}
    for name, centrodes in run.studies.centrodes.items():
        corners = [complex(*xy) for xy in (*points[name].values(), next(iter(points[name].values()), (0.0, 0.0)))]
        fixed, moving = (path @ np.array([1.0, 1.0j]) for path in (centrodes.fixed, centrodes.moving))
        rolling[name] = RollingCentrodes(fixed, moving, np.array(corners))
    return rolling


def _kept_scales(old: Scales, new: Scales) -> Scales:
    """The old scales where they still fit (`KEPT_SCALE`), otherwise the new ones."""
    low, high = KEPT_SCALE
    names = ("newtons_per_metre", "newton_metres_per_metre", "mps_per_metre", "mps2_per_metre")
    kept = {n: getattr(old, n) for n in names if low <= getattr(new, n) / getattr(old, n) <= high and getattr(old, n) != 1.0}
    return replace(new, **kept)


def deep_equal(a: Any, b: Any) -> bool:
    """Whether a and b are of one type and equal in all their parts; objects other than arrays, dataclasses, mappings, lists and
    tuples are compared by ``==``."""
    if a is b:
        return True
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return np.array_equal(a, b)
    if is_dataclass(a):
        return all(deep_equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, Mapping):
        return a.keys() == b.keys() and all(deep_equal(value, b[key]) for key, value in a.items())
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(deep_equal, a, b))
    return bool(a == b)


def view_model_of_recording(recording: Recording) -> ViewModel:
    """View model of a recording, complete or interrupted."""
    shown = presentation_in(recording)
    numbers = shown.catalogue.numbers
    ticks, _ = recording.scalars("data", "links", numbers.frame, "pose")
    head, cut, rest = shown.notes.partition("\n## ")
    return ViewModel(
        title=shown.title,
        learning_goal=shown.learning_goal,
        picture=shown.picture,
        bodies=bodies_of(shown.picture.nodes_of(BodyNode, "solids")),
        catalogue=shown.catalogue,
        events=shown.events,
        # without title and learning goal, with headings one level lower
        notes=words.notes_html(html_of(f"### {rest}".replace("\n## ", "\n### ") if cut else head)),
        drawings=shown.drawings,
        charts=cache(RecordedDrawings(recording, ticks).charts),
        centrodes=cache(lambda: centrodes_in(shown.picture, numbers)),
    )


def centrodes_in(picture: Picture, numbers: Numbers) -> dict[str, RollingCentrodes]:
    """Centrodes of the links for which the picture shows them, computed from the recorded poses and velocities (instant centre)."""
    rolling = {}
    places = {name: xy for name in numbers.joints if (xy := numbers.values("data", "joints", name, "position")) is not None}
    for _, link in (node.owner for node in picture.nodes_of(Lines, "polodes")):
        rate = numbers.values("data", "links", link, "velocity")
        if rate is None:
            continue
        pose = numbers.poses[link]
        at, turn = pose[:, 0] + 1j * pose[:, 1], np.exp(1j * pose[:, 2])
        with np.errstate(divide="ignore", invalid="ignore"):
            fixed = at + 1j * (rate[:, 0] + 1j * rate[:, 1]) / rate[:, 2]
        fixed = np.where(np.isfinite(fixed), fixed, np.nan)
        own = [places[n] for n, j in numbers.joints.items() if link in j.links and n in places and np.isfinite(places[n]).all()]
        corners = [complex((complex(*xy[0]) - at[0]) / turn[0]) for xy in own]
        rolling[link] = RollingCentrodes(fixed, (fixed - at) / turn, np.array([*corners, *corners[:1]], complex))
    return rolling
