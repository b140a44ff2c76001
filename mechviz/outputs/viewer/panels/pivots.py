"""Handles on the points of the fixed link: while one is dragged its pivot moves, and the whole cycle is computed anew."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import viser

from mechviz.editor.parameters import Parameter, find_parameters
from mechviz.outputs.viewer.callbacks import Callback
from mechviz.outputs.viewer.session import EditSession
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.scene.units import Units


@dataclass(frozen=True)
class Pivot:
    """A point of the fixed link whose coordinates stand in the scene."""

    name: str
    x: Parameter
    y: Parameter
    metres: tuple[float, float]  # in one unit of x and of y

    @property
    def place(self) -> tuple[float, float]:
        """Where it is [m]."""
        return self.x.value * self.metres[0], self.y.value * self.metres[1]


def pivots_of(session: EditSession) -> dict[str, Pivot]:
    """The points of the fixed link that joints use, by name: from its table of points, or from the sketch."""
    scene = session.run.scene
    document = scene.document
    units = Units(**document.units.model_dump())
    found: dict[tuple[str, ...], dict[int, Parameter]] = {}
    for p in find_parameters(scene):
        fixed = (p.path[:1] == ("sketch",) and len(p.path) == 3) or p.path[:3] == ("links", document.frame, "points")
        if fixed and isinstance(p.path[-1], int):
            found.setdefault(tuple(map(str, p.path[:-1])), {})[p.path[-1]] = p
    frame = {link.name: link for link in scene.mechanism.links}[scene.mechanism.frame]
    ends = [zip(joint.links, joint.points, strict=True) for joint in scene.mechanism.joints if hasattr(joint, "points")]
    used = {point for joint in ends for link, point in joint if link == frame.name}
    pivots = {}
    for path, xy in found.items():
        name = path[-1]
        if name in frame.points and name in used and len(xy) == 2:
            metres = [units.si(1.0 if not p.suffix else f"1 {p.suffix}", "length") for p in (xy[0], xy[1])]
            pivots[name] = Pivot(name, xy[0], xy[1], (metres[0], metres[1]))
    return pivots


class Pivots:
    """Handles that are made when they are first wanted; ``update`` puts them where the pivots are."""

    def __init__(self, server: viser.ViserServer, session: EditSession, callback: Callback):
        self._server, self._session, self._callback = server, session, callback
        self._nodes: dict[str, Any] = {}
        self._pivots: Mapping[str, Pivot] = {}
        self._held = ""
        self.on = False

    def switch(self, on: bool) -> None:
        """Show the handles, or no more."""
        self.on = on
        self.update(self._session.show)
        for node in self._nodes.values():
            node.visible = on

    def update(self, show: ViewModel) -> None:
        """Put the handles where the pivots are, except for the one that is held."""
        if not self.on:
            return
        self._pivots = pivots_of(self._session)
        for name, pivot in self._pivots.items():
            x, y = pivot.place
            if name not in self._nodes:
                node = self._server.scene.add_transform_controls(
                    f"/pivots/{name.replace('/', '_')}",
                    scale=0.16 * show.size,
                    active_axes=(True, True, False),
                    disable_rotations=True,
                    depth_test=False,
                    position=(x, y, show.z_top),
                )
                node.on_update(self._callback(f"Dragging {name}", partial(self._dragged, name)))
                self._nodes[name] = node
            elif name != self._held:
                self._nodes[name].position = (x, y, show.z_top)

    def _dragged(self, name: str, event: Any) -> None:
        phase = getattr(event, "phase", "update")
        self._held = name if phase in ("start", "update") else ""
        place = np.asarray(event.target.position, float)
        pivot = self._pivots.get(name)
        if pivot is None or not np.isfinite(place).all():
            return
        for k, p in enumerate((pivot.x, pivot.y)):
            value = float(np.clip(place[k] / pivot.metres[k], p.hard_low, p.hard_high))
            if abs(value - p.value) > 1e-9 * self._session.show.size / pivot.metres[k]:
                self._session.move(p, round(value / p.step) * p.step)
