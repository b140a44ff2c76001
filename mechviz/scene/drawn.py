"""Masses that follow from the outlines that are drawn: these are known only when the mechanism and its motion are."""

from __future__ import annotations

import numpy as np
from shapely.geometry import Polygon

from mechcore.errors import MechanismError
from mechcore.laws.timed import Free
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.reduction.areas import area_of
from mechcore.reduction.bodies import Body, combine
from mechcore.spec.clearance import as_drawn
from mechcore.spec.mechanism import Mechanism
from mechviz.scene.bodies.shapes import MassDocument
from mechviz.scene.document import SceneDocument


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
    from mechviz.picture.meshes.drawn import drawn_outlines  # meshes are made by few scenes only

    found = drawn_outlines(as_drawn(mechanism), poses, links)
    return {name: combine(_body(p) for p in outlines) for name, outlines in found.items()}


def _body(outline: Polygon) -> Body:
    """Integrals over a polygon with holes."""
    outer = area_of(np.asarray(outline.exterior.coords)[:-1])
    holes = [area_of(np.asarray(ring.coords)[:-1]) for ring in outline.interiors]
    return combine([outer.body(1.0), *(hole.body(-1.0) for hole in holes)])
