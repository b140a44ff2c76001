"""Masses, centres of mass and moments of inertia of links: stated, or following from a shape; never guessed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mechcore.errors import MechanismError
from mechcore.laws.timed import Free
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.reduction.bodies import Body, area_of, combine
from mechcore.spec.clearance import as_drawn
from mechcore.spec.mechanism import Mechanism
from mechviz.scene.convert import Converter
from mechviz.scene.document import LinkDocument, SceneDocument
from mechviz.scene.faults import did_you_mean
from mechviz.scene.fields import Unknown
from mechviz.scene.kinds.bodies import MassDocument, body_of, lumps_of

if TYPE_CHECKING:
    from shapely.geometry import Polygon

Vec2 = tuple[float, float]


def links_that_cannot_turn(document: SceneDocument, touched: Mapping[str, tuple[set[str], bool]]) -> set[str]:
    """Links that a chain of sliding joints and welds holds parallel to the fixed one.

    ``touched`` has the links of every joint, and whether they are known; a joint of which little is known may be a guide.
    """
    rigid = []
    for name, (links, sure) in touched.items():
        joint = document.joints.get(name)
        if joint is None or len(joint.kinds) > 1 or joint.traits.parallel or not sure:
            rigid.append(links)
    held, grew = {document.frame}, True
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
    drawn: Body | None = None,
) -> tuple[float, Vec2, float]:
    """Mass [kg], centre of mass in the link's frame [m], moment of inertia about it [kg m^2].

    What one of the effects needs and the scene does not say is a fault; what nothing needs stays zero.
    """
    path = f"links.{name}"
    if not link.sound("points") and (isinstance(link.mass, MassDocument) or link.lumps):
        return math.nan, (math.nan, math.nan), math.nan  # they may name points
    if isinstance(link.mass, MassDocument):
        stated = _stated_centre(name, link, points, convert)
        body = body_of(link.mass, points, stated, convert, f"{path}.mass", drawn)
        return _with_lumps(body, link, points, convert, path)
    if link.lumps and link.mass is None:
        return _with_lumps(Body(0.0), link, points, convert, path)
    if link.lumps:
        bare = link.model_copy(update={"lumps": []})
        return _with_lumps(
            Body(*mass_properties(name, bare, points, effects, convert, can_turn=can_turn)), link, points, convert, path
        )
    mass = 0.0 if link.mass is None else convert.si(link.mass, "mass", f"{path}.mass")
    inertia = 0.0 if link.inertia is None else convert.si(link.inertia, "inertia", f"{path}.inertia")
    places = list(points.values())
    if isinstance(link.shape, Unknown):
        return mass, (0.0, 0.0), inertia
    if link.shape == "bar" and len(places) > 1:
        (ax, ay), (bx, by) = places[:2]
        return mass, (0.5 * (ax + bx), 0.5 * (ay + by)), mass * math.dist((ax, ay), (bx, by)) ** 2 / 12.0
    if link.shape is not None:
        return mass, places[0] if places else (0.0, 0.0), 0.0
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


def _who_need(effects: Sequence[str]) -> str:
    """'gravity' needs; 'inertia' and 'gravity' need."""
    return " and ".join(f"'{effect}'" for effect in effects) + (" needs" if len(effects) == 1 else " need")


def _stated_centre(name: str, link: LinkDocument, points: Mapping[str, Vec2], convert: Converter) -> Vec2 | None:
    """The centre that a scene states, by coordinates or by the name of a point."""
    path = f"links.{name}.centre"
    if isinstance(link.centre, str):
        if link.centre not in points and link.sound("points", "centre"):
            convert.note(path, f"link '{name}' has no point '{link.centre}'.", did_you_mean(link.centre, points, what="Points"))
        return points.get(link.centre, (0.0, 0.0))
    return None if link.centre is None else convert.vector(link.centre, "length", path)


def _with_lumps(
    body: Body, link: LinkDocument, points: Mapping[str, Vec2], convert: Converter, path: str
) -> tuple[float, Vec2, float]:
    """A body with the link's point masses."""
    whole = combine([body, *lumps_of(link.lumps, points, convert, f"{path}.lumps")]) if link.lumps else body
    return whole.mass, whole.centre, whole.inertia


def drawn_links(document: SceneDocument) -> list[str]:
    """Links whose mass follows from their drawn outline."""
    return [key for key, link in document.links.items() if isinstance(link.mass, MassDocument) and link.mass.drawn]


def drawn_bodies(mechanism: Mechanism, document: SceneDocument) -> dict[str, Body]:
    """Plates of unit density and thickness [m^2, m, m^4] with the drawn outlines of these links.

    The outlines are those of the scene's own run: slots are as long as it needs. A mechanism that cannot be moved, which is
    found out and said when it is run, is drawn as it is without a motion.
    """
    links = drawn_links(document)
    try:
        free = any(isinstance(d.law, Free) for d in mechanism.drives)  # where it goes needs its masses: drawn at the start
        times = [0.0] if free else default_times(mechanism, document.run.frames, document.run.cycles)
        motion = solve_motion(compile_mechanism(mechanism), times)
        poses = {link.name: motion.pose(link.name) for link in mechanism.links}
    except MechanismError:
        poses = None
    from mechviz.meshes.solids import drawn_outlines  # few scenes need meshes

    found = drawn_outlines(as_drawn(mechanism), poses, links)
    return {name: combine(_body(p) for p in outlines) for name, outlines in found.items()}


def _body(outline: Polygon) -> Body:
    """Integrals over a polygon with holes."""
    outer = area_of(np.asarray(outline.exterior.coords)[:-1])
    holes = [area_of(np.asarray(ring.coords)[:-1]) for ring in outline.interiors]
    return combine([outer.body(1.0), *(hole.body(-1.0) for hole in holes)])
