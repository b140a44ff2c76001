"""Handles in the picture itself: pivots of the fixed link can be dragged, and points traced by a click."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import viser

from mechcore.errors import Fault
from mechcore.records import dataclass
from mechviz.editor.history import Draft
from mechviz.editor.parameters import Parameter, find_parameters
from mechviz.outputs.viewer.server import Callback
from mechviz.outputs.viewer.session import EditSession
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.scene.annotations import Place
from mechviz.scene.faults import SceneError


@dataclass(frozen=True)
class Pivot:
    """A point of the fixed link whose coordinates are values of the scene."""

    name: str
    x: Parameter
    y: Parameter
    metres: tuple[float, float]  # length of the unit of x and of y [m]

    @property
    def place(self) -> tuple[float, float]:
        """Position [m]."""
        return self.x.value * self.metres[0], self.y.value * self.metres[1]


def pivots_of(session: EditSession) -> dict[str, Pivot]:
    """The points of the fixed link that joints use, by name; their coordinates are in its table of points, or in the sketch."""
    scene = session.run.scene
    document = scene.document
    units = document.unit_system
    places: dict[tuple[str, ...], dict[int, Parameter]] = {}
    for p in find_parameters(scene):
        fixed = (p.path[:1] == ("sketch",) and len(p.path) == 3) or p.path[:3] == ("links", document.frame, "points")
        if fixed and isinstance(p.path[-1], int):
            places.setdefault(tuple(map(str, p.path[:-1])), {})[p.path[-1]] = p
    frame = {link.name: link for link in scene.mechanism.links}[scene.mechanism.frame]
    ends = [zip(joint.links, joint.points, strict=True) for joint in scene.mechanism.joints if hasattr(joint, "points")]
    used = {point for joint in ends for link, point in joint if link == frame.name}
    pivots = {}
    for path, xy in places.items():
        name = path[-1]
        if name in frame.points and name in used and len(xy) == 2:
            metres = [units.si(1.0 if not p.suffix else f"1 {p.suffix}", "length") for p in (xy[0], xy[1])]
            pivots[name] = Pivot(name, xy[0], xy[1], (metres[0], metres[1]))
    return pivots


class Pivots:
    """Handles, made when they are first switched on; ``update`` moves them to the pivots."""

    def __init__(self, server: viser.ViserServer, session: EditSession, callback: Callback):
        self._server, self._session, self._callback = server, session, callback
        self._nodes: dict[str, Any] = {}
        self._pivots: Mapping[str, Pivot] = {}
        self._held = ""
        self._asked: dict[str, float] = {}  # values that the present drag has requested, whether shown yet or not
        self.on = False

    def switch(self, on: bool) -> None:
        """Show or hide the handles."""
        self.on = on
        self.update(self._session.view_model)
        for node in self._nodes.values():
            node.visible = on

    def update(self, view_model: ViewModel) -> None:
        """Move the handles to the pivots, except for the one being dragged."""
        if not self.on:
            return
        self._pivots = pivots_of(self._session)
        for name, pivot in self._pivots.items():
            x, y = pivot.place
            if name not in self._nodes:
                node = self._server.scene.add_transform_controls(
                    f"/pivots/{name.replace('/', '_')}",
                    scale=0.16 * view_model.size,
                    active_axes=(True, True, False),
                    disable_rotations=True,
                    depth_test=False,
                    position=(x, y, view_model.z_top),
                )
                node.on_update(self._callback(f"Dragging {name}", partial(self._dragged, name)))
                self._nodes[name] = node
            elif name != self._held:
                self._nodes[name].position = (x, y, view_model.z_top)

    def _dragged(self, name: str, event: viser.TransformControlsEvent) -> None:
        phase = getattr(event, "phase", "update")
        self._held = name if phase in ("start", "update") else ""
        if phase == "start":
            self._asked = {}
        place = np.asarray(event.target.position, float)
        pivot = self._pivots.get(name)
        if pivot is None or not np.isfinite(place).all():
            return
        for k, p in enumerate((pivot.x, pivot.y)):
            value = float(np.clip(place[k] / pivot.metres[k], p.hard_low, p.hard_high))
            if abs(value - self._asked.get(p.key, p.value)) > 1e-9 * self._session.view_model.size / pivot.metres[k]:
                self._asked[p.key] = value
                self._session.set_value(p, round(value / p.step) * p.step)


CLICK_DISTANCE = 0.02  # of the mechanism's size: a click this near to a named point means that point


def traced_at(
    view_model: ViewModel, link: str, frame: int, origin: Sequence[float], direction: Sequence[float]
) -> tuple[float, float, float]:
    """The point where the ray of a click meets the front plane of a link: x, y [m] in its frame, and the distance [m] within which
    a named point is taken instead. Raises ValueError for a ray parallel to the plane, or one that is not finite."""
    vertices = np.concatenate([piece.vertices for piece in view_model.bodies[link].pieces])
    height = float(vertices[:, 2].max())
    start, along = np.asarray(origin, float), np.asarray(direction, float)
    if not (np.isfinite(start).all() and np.isfinite(along).all()) or abs(along[2]) < 1e-6:
        raise ValueError("the click met no point of the link: look at it from the front")
    x, y, _ = start + along * (height - start[2]) / along[2]
    px, py, angle = view_model.poses[link][frame]
    z = complex(x - px, y - py) * np.exp(-1j * angle)
    return float(z.real), float(z.imag), CLICK_DISTANCE * view_model.size


def with_traced(draft: Draft, link: str, click: tuple[float, float, float]) -> Draft:
    """A draft in which the clicked point of a link is traced, or no longer traced: a named point if one is near, otherwise a new
    one. Raises `SceneError` if a new point is needed and the sketch places the link's points."""
    scene = draft.scene()
    spec = {s.name: s for s in scene.mechanism.links}[link]
    x, y, near = click
    name = next((n for n, (px, py) in spec.points.items() if np.hypot(px - x, py - y) < near), "")
    changes: dict[Place, Any] = {}
    if not name:
        if not isinstance(scene.document.links[link].points, dict):
            raise SceneError(
                scene.name,
                Fault(f"links.{link}.points", "the sketch places the points of this link.", "Click on one of its named points."),
            )
        taken = {n for s in scene.mechanism.links for n in s.points}
        name = next(f"T{k}" for k in range(1, 10_000) if f"T{k}" not in taken)
        per = float(scene.units.factor("length"))
        changes["links", link, "points", name] = [float(f"{x / per:.4g}"), float(f"{y / per:.4g}")]
    traced = f"{link}.{name}"
    known = scene.document.trace
    mine = [t for t in known if t in (traced, name)]
    changes["trace",] = [t for t in known if t not in mine] if mine else [*known, traced]
    return draft.changed(changes)
