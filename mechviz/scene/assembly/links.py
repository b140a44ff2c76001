"""Links of a scene: their approximate poses at the start, as far as the sketch determines them, and their masses, stated or
computed from a shape.

A link whose points are a list of names takes its shape from the sketch: its frame has the origin at the first of them and x towards
the second (axes parallel to the world's if there is no second; for the fixed link, the world frame).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.arrays import Vec2
from mechcore.cams.contour import bulged, self_crossing
from mechcore.errors import Fault, MechanismError
from mechcore.joints.spatial_cam import MASS_REMEDY, ON_PIN, off_shaft
from mechcore.laws.timed import Free
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.records import dataclass
from mechcore.reduction.bodies import RigidBody, area_of, combine
from mechcore.spec.clearance import with_ideal_joints
from mechcore.spec.mechanism import CamJoint, Mechanism
from mechcore.texts import as_length
from mechviz.scene.convert import Converter
from mechviz.scene.document import LinkDocument, Pose, SceneDocument
from mechviz.scene.faults import did_you_mean
from mechviz.scene.fields import UnknownName
from mechviz.scene.kinds.bodies import MassDocument, body_of, point_masses_of
from mechviz.scene.names import (
    points_of_joint,
)

if TYPE_CHECKING:
    from shapely.geometry import Polygon

Pose2 = tuple[float, float, float]


@dataclass
class Placement:
    """Shapes and approximate poses of links. ``points``: link -> point -> place in the link's frame [m].

    ``poses``: link -> approximate x, y [m], angle [rad] at the start. ``drawn`` holds the links whose poses follow exactly from the
    sketch, the fixed link among them.
    """

    points: dict[str, Mapping[str, Vec2]] = field(default_factory=dict)
    poses: dict[str, Pose2] = field(default_factory=dict)
    drawn: set[str] = field(default_factory=set)


def place_links(document: SceneDocument, convert: Converter) -> Placement:
    """Shapes and approximate poses of all links, as far as they are known; faults of drawn links are noted."""
    placement = Placement()
    for name, link in document.links.items():
        if isinstance(link.points, dict):
            path = f"links.{name}.points"
            placement.points[name] = {
                point: convert.vector(place, "length", f"{path}.{point}") for point, place in link.points.items()
            }
    world = {
        name: convert.vector(entry, "length", f"sketch.{name}")
        for name, entry in document.sketch.items()
        if not isinstance(entry, Pose)
    }
    _add_frame_points(document, placement, world, convert)
    _share_pins(document, world)
    placement.poses[document.frame] = (0.0, 0.0, 0.0)
    placement.drawn.add(document.frame)
    for name, link in document.links.items():
        if isinstance(link.points, list) and link.points:
            _draw(document, placement, world, name, link.points, convert)
    for name, entry in document.sketch.items():
        if isinstance(entry, Pose) and name in document.links:
            x, y = convert.vector(entry.at, "length", f"sketch.{name}.at")
            placement.poses[name] = (x, y, convert.si(entry.angle, "angle", f"sketch.{name}.angle"))
            placement.drawn.discard(name)
    if document.sketch:
        _fit(document, placement, world)
    return placement


def _add_frame_points(document: SceneDocument, placement: Placement, world: dict[str, Vec2], convert: Converter) -> None:
    """Add the points of the fixed link that have coordinates to the places in the ``world``: they need no sketch. A sketch that
    contradicts them is noted."""
    for point, place in placement.points.get(document.frame, {}).items():
        sketched = world.setdefault(point, place)
        if math.dist(sketched, place) > 1e-9 * math.hypot(*place) and convert.has_known_unit("length"):
            convert.note(
                f"sketch.{point}",
                f"is not where links.{document.frame} has this point.",
                f"Leave it out: the place is known from links.{document.frame}.",
            )


def _share_pins(document: SceneDocument, world: dict[str, Vec2]) -> None:
    """Give points of different names that a pin or weld joins the same place."""
    for name, joint in document.joints.items():
        if joint.traits.coincide:
            a, b = points_of_joint(name, joint)
            for known, other in ((a, b), (b, a)):
                if known in world:
                    world.setdefault(other, world[known])


def _draw(
    document: SceneDocument,
    placement: Placement,
    world: Mapping[str, Vec2],
    name: str,
    points: list[str],
    convert: Converter,
) -> None:
    """The shape of a link from the places of its points in the sketch."""
    missing = [point for point in points if point not in world]
    for point in missing:
        convert.note(
            f"links.{name}.points",
            f"the sketch does not say where point '{point}' is.",
            f"Add {point} = [x, y] to [sketch], or give the link's points coordinates.",
        )
    if missing:
        return
    if name == document.frame:
        placement.points[name] = {point: world[point] for point in points}
        return
    origin = complex(*world[points[0]])
    towards = complex(*world[points[1]]) - origin if len(points) > 1 else 1.0 + 0.0j
    if towards == 0.0:
        convert.note(
            f"links.{name}.points",
            f"'{points[0]}' and '{points[1]}' are drawn at the same place.",
            "Move one of them in [sketch].",
        )
        return
    local = {point: (complex(*world[point]) - origin) * towards.conjugate() / abs(towards) for point in points}
    placement.points[name] = {point: (z.real, z.imag) for point, z in local.items()}
    if len(points) > 1:
        placement.points[name] = {
            **placement.points[name],
            points[1]: (abs(towards), 0.0),
        }  # no rounding across the line
        placement.poses[name] = (origin.real, origin.imag, math.atan2(towards.imag, towards.real))
        placement.drawn.add(name)


def _fit(document: SceneDocument, placement: Placement, world: Mapping[str, Vec2]) -> None:
    """Add approximate poses from two sketched points, or from one and the angle of a link parallel to it by a sliding joint or
    weld."""
    for name, local in placement.points.items():
        known = [point for point in local if point in world]
        if name not in placement.poses and len(known) > 1:
            a, b = known[:2]
            arm = complex(*local[b]) - complex(*local[a])
            seen = complex(*world[b]) - complex(*world[a])
            if arm != 0.0 and seen != 0.0:
                placement.poses[name] = _at(local[a], world[a], math.atan2((seen / arm).imag, (seen / arm).real))
    grew = True
    while grew:
        grew = False
        for joint in document.joints.values():
            if not joint.traits.parallel:
                continue
            first, second = joint.links
            turn = stated_angle(document, joint.angle)
            for known_link, other, sign in ((first, second, 1.0), (second, first, -1.0)):
                local = placement.points.get(other, {})
                sketched = [point for point in local if point in world]
                if known_link in placement.poses and other not in placement.poses and sketched:
                    placement.poses[other] = _at(
                        local[sketched[0]], world[sketched[0]], placement.poses[known_link][2] + sign * turn
                    )
                    grew = True


def stated_angle(document: SceneDocument, angle: float | str | None) -> float:
    """The stated angle of a sliding joint or weld [rad], 0 where none is stated."""
    return 0.0 if angle is None else document.unit_system.si(angle, "angle")


def _at(local: Vec2, place: Vec2, angle: float) -> Pose2:
    """The pose of a frame turned by ``angle`` whose point ``local`` is at ``place``."""
    turned = complex(*local) * complex(math.cos(angle), math.sin(angle))
    return place[0] - turned.real, place[1] - turned.imag, angle


def links_that_cannot_turn(document: SceneDocument, touched: Mapping[str, tuple[set[str], bool]]) -> set[str]:
    """Links that a chain of sliding joints and welds holds parallel to the fixed one.

    ``touched``: the links of every joint, and whether that is certain. A joint of which little is known may be a guide; where the
    fixed link is not known, each such joint may hold its links to it.
    """
    rigid = []
    for name, (links, sure) in touched.items():
        joint = document.joints.get(name)
        if joint is None or len(joint.kinds) > 1 or joint.traits.parallel or not sure:
            rigid.append(links)
    held, grew = {document.frame}, True
    if document.frame not in document.links:
        held.update(*rigid)
    if not document.joints:  # which is a fault of its own
        held.update(document.links)
    while grew:
        grew = False
        for links in rigid:
            if not held.isdisjoint(links) and not held.issuperset(links):
                held |= links
                grew = True
    return held


def mass_properties(
    name: str,
    link: LinkDocument,
    points: Mapping[str, Vec2],
    effects: Sequence[str],
    convert: Converter,
    *,
    can_turn: bool,
    drawn: RigidBody | None = None,
) -> tuple[float, Vec2, float]:
    """Mass [kg], centre of mass in the link's frame [m], moment of inertia about it [kg m^2].

    A property that an effect needs and the scene does not state is a fault; a property that no effect needs is zero.
    """
    path = f"links.{name}"
    if not link.has_valid("points") and (isinstance(link.mass, MassDocument) or link.point_masses):
        return math.nan, (math.nan, math.nan), math.nan  # they may name points
    if isinstance(link.mass, MassDocument):
        stated = _stated_centre(name, link, points, convert)
        body = body_of(link.mass, points, stated, convert, f"{path}.mass", drawn)
        return _with_point_masses(body, link, points, convert, path)
    if link.point_masses and link.mass is None:
        return _with_point_masses(RigidBody(0.0), link, points, convert, path)
    if link.point_masses:
        bare = link.model_copy(update={"point_masses": []})
        return _with_point_masses(
            RigidBody(*mass_properties(name, bare, points, effects, convert, can_turn=can_turn)), link, points, convert, path
        )
    mass = 0.0 if link.mass is None else convert.si(link.mass, "mass", f"{path}.mass")
    inertia = 0.0 if link.inertia is None else convert.si(link.inertia, "inertia", f"{path}.inertia")
    places = list(points.values())
    if isinstance(link.shape, UnknownName):
        return mass, (0.0, 0.0), inertia
    if link.shape is not None:
        where, inertia = of_shape(link.shape, mass, [complex(*place) for place in places] or [0j])
        return mass, (where.real, where.imag), inertia
    counts = (mass > 0.0 or math.isnan(mass)) and bool(effects)
    given = _stated_centre(name, link, points, convert)
    if given is not None:
        centre = given
    else:
        centre = places[0] if len(places) == 1 else (0.0, 0.0)
        if counts and len(places) > 1:
            convert.note(
                path,
                f"has a mass but no centre, which {_who_need(effects)}.",
                'Add centre = [x, y] (or the name of a point), or shape = "bar".',
            )
    if counts and can_turn and link.inertia is None and "inertia" in effects:
        convert.note(
            path,
            "has a mass but no moment of inertia, which 'inertia' needs.",
            'Add inertia = "... kg m^2", or shape = "bar" or "point".',
        )
    return mass, centre, inertia


def of_shape(shape: str, mass: Any, places: Sequence[Any]) -> tuple[Any, Any]:
    """Centre of mass (complex [m]) and moment of inertia about it [kg m^2] of a bar between the first two of a link's points, or
    of a point mass in the first: numbers, or arrays over designs."""
    if shape == "bar" and len(places) > 1:
        return 0.5 * (places[0] + places[1]), mass * abs(places[1] - places[0]) ** 2 / 12.0
    return places[0], 0.0 * mass


def _who_need(effects: Sequence[str]) -> str:
    """'gravity' needs; 'inertia' and 'gravity' need."""
    return " and ".join(f"'{effect}'" for effect in effects) + (" needs" if len(effects) == 1 else " need")


def _stated_centre(name: str, link: LinkDocument, points: Mapping[str, Vec2], convert: Converter) -> Vec2 | None:
    """The centre of mass that a scene states, by coordinates or by the name of a point."""
    path = f"links.{name}.centre"
    if isinstance(link.centre, str):
        if link.centre not in points and link.has_valid("points", "centre"):
            convert.note(path, f"link '{name}' has no point '{link.centre}'.", did_you_mean(link.centre, points, what="Points"))
        return points.get(link.centre, (0.0, 0.0))
    return None if link.centre is None else convert.vector(link.centre, "length", path)


def _with_point_masses(
    body: RigidBody, link: LinkDocument, points: Mapping[str, Vec2], convert: Converter, path: str
) -> tuple[float, Vec2, float]:
    """A body with the link's point masses."""
    whole = (
        combine([body, *point_masses_of(link.point_masses, points, convert, f"{path}.point_masses")]) if link.point_masses else body
    )
    return whole.mass, whole.centre, whole.inertia


def shaft_faults(mechanism: Mechanism, document: SceneDocument, convert: Converter) -> Iterator[Fault]:
    """Faults of point masses off the pin of links that turn about shafts in the plane: such a mass adds to the moment of inertia
    about the plane's normal, not about the shaft. Points of such a link off its pin are refused elsewhere."""
    points = {link.name: link.points for link in mechanism.links}
    for joint in mechanism.joints:
        if isinstance(joint, CamJoint) and joint.spatial is not None:
            link, path = joint.links[0], f"links.{joint.links[0]}.point_masses"
            pin = complex(*next(iter(points[link].values())))
            for k, mass in enumerate(point_masses_of(document.links[link].point_masses, points[link], convert, path)):
                if (off := abs(complex(*mass.centre) - pin)) > ON_PIN * abs(pin):
                    yield off_shaft(f"{path}[{k}]", link, "this mass", off, MASS_REMEDY).in_units(convert.units)


def drawn_links(document: SceneDocument) -> list[str]:
    """Links whose mass follows from their drawn outline."""
    return [key for key, link in document.links.items() if isinstance(link.mass, MassDocument) and link.mass.drawn]


def drawn_bodies(mechanism: Mechanism, document: SceneDocument) -> dict[str, RigidBody]:
    """Plates of unit density and thickness [m^2, m, m^4] with the drawn outlines of these links.

    The outlines are those of the scene's own run, whose travel determines the length of slots. A mechanism that cannot be moved is
    drawn without a motion; its fault is reported when it is run.
    """
    links = drawn_links(document)
    try:
        free = any(isinstance(d.law, Free) for d in mechanism.drives)  # its motion depends on its masses: drawn at the start
        times = [0.0] if free else default_times(mechanism, document.run.frames, document.run.cycles)
        motion = solve_motion(compile_mechanism(mechanism), times)
        poses = {link.name: motion.pose(link.name) for link in mechanism.links}
    except MechanismError:
        poses = None
    from mechviz.meshes.solids import drawn_outlines  # few scenes need meshes

    drawn = drawn_outlines(with_ideal_joints(mechanism), poses, links)
    return {name: combine(_body(p) for p in outlines) for name, outlines in drawn.items()}


def _body(outline: Polygon) -> RigidBody:
    """Integrals over a polygon with holes."""
    outer = area_of(np.asarray(outline.exterior.coords)[:-1])
    holes = [area_of(np.asarray(ring.coords)[:-1]) for ring in outline.interiors]
    return combine([outer.body(1.0), *(hole.body(-1.0) for hole in holes)])


def drawn_outline(
    key: str, corners: Sequence[Sequence[float | str]], document: SceneDocument, placement: Placement, convert: Converter
) -> tuple[Vec2, ...]:
    """The corners [m] of a link's outline in its axes; faults are noted."""
    path = f"links.{key}.outline"
    z = np.array([complex(*convert.row(corner, "length", f"{path}[{k}]")) for k, corner in enumerate(corners)])
    if key == document.frame:
        convert.note(path, "the fixed link is drawn as ground.", "Give it to a link that is welded to it.")
    if np.isnan(z).any():
        return ()
    if isinstance(document.links[key].points, list) and key in placement.poses:
        x, y, angle = placement.poses[key]
        z = (z - complex(x, y)) * np.exp(-1j * angle)
    place = self_crossing(bulged(z, None)) if len(set(z.tolist())) == len(z) else complex(z[0])
    if place is not None:
        near = f"x = {as_length(place.real, 4)}, y = {as_length(place.imag, 4)}"
        convert.note(path, f"it crosses or touches itself near {near}.", "Give the corners once round the figure, in order.")
    return tuple((float(c.real), float(c.imag)) for c in z)
