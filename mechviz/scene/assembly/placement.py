"""Where links are at the start, as far as the sketch says, and the shapes of links that are drawn there.

A link whose points are a list of names takes its shape from the sketch: its frame has the origin at the first of them
and x towards the second (axes parallel to the world's if there is no second; for the fixed link, the world frame).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from mechviz.scene.convert import Converter
from mechviz.scene.document import Pose, SceneDocument
from mechviz.scene.names import (
    points_of_joint,
)
from mechviz.scene.units import Units

Vec2 = tuple[float, float]
Pose2 = tuple[float, float, float]


@dataclass
class Placement:
    """``points``: link -> point -> place in the link's frame [m].

    ``poses``: link -> x, y [m], angle [rad] at the start, roughly. ``drawn`` holds the links whose poses follow exactly
    from the sketch, the fixed link among them.
    """

    points: dict[str, Mapping[str, Vec2]] = field(default_factory=dict)
    poses: dict[str, Pose2] = field(default_factory=dict)
    drawn: set[str] = field(default_factory=set)


def place_links(document: SceneDocument, convert: Converter) -> Placement:
    """Shapes and rough poses of all links that can be known; faults of drawn links are noted."""
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
    """Points of the fixed link with coordinates of its own are places in the world that need no sketch."""
    for point, place in placement.points.get(document.frame, {}).items():
        sketched = world.setdefault(point, place)
        if math.dist(sketched, place) > 1e-9 * math.hypot(*place) and convert.certain("length"):
            convert.note(
                f"sketch.{point}",
                f"is not where links.{document.frame} has this point.",
                f"Leave it out: the place is known from links.{document.frame}.",
            )


def _share_pins(document: SceneDocument, world: dict[str, Vec2]) -> None:
    """A pin or weld that joins points of different names puts both at one place."""
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
        }  # free of rounding across the line
        placement.poses[name] = (origin.real, origin.imag, math.atan2(towards.imag, towards.real))
        placement.drawn.add(name)


def _fit(document: SceneDocument, placement: Placement, world: Mapping[str, Vec2]) -> None:
    """Rough poses from two sketched points, or from one and an angle that a sliding joint or weld hands on."""
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
            turn = angle_of(document, joint.angle)
            for known_link, other, sign in ((first, second, 1.0), (second, first, -1.0)):
                local = placement.points.get(other, {})
                sketched = [point for point in local if point in world]
                if known_link in placement.poses and other not in placement.poses and sketched:
                    placement.poses[other] = _at(
                        local[sketched[0]], world[sketched[0]], placement.poses[known_link][2] + sign * turn
                    )
                    grew = True


def angle_of(document: SceneDocument, angle: float | str | None) -> float:
    """The stated angle of a sliding joint or weld [rad], 0 where none is stated."""
    return 0.0 if angle is None else Units(**document.units.model_dump()).si(angle, "angle")


def _at(local: Vec2, place: Vec2, angle: float) -> Pose2:
    """The pose of a frame turned by ``angle`` whose point ``local`` is at ``place``."""
    turned = complex(*local) * complex(math.cos(angle), math.sin(angle))
    return place[0] - turned.real, place[1] - turned.imag, angle
