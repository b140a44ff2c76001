"""Points that are traced because somebody clicked on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mechcore.errors import Fault
from mechviz.editor.history import Draft
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.scene.annotations import Place
from mechviz.scene.faults import SceneError
from mechviz.scene.units import Units

NEAR = 0.02  # of the mechanism's size: a click this near to a named point means that point


def traced_at(
    show: ViewModel, link: str, frame: int, origin: Sequence[float], direction: Sequence[float]
) -> tuple[float, float, float]:
    """Where the ray of a click meets a link, x, y [m] in its own frame, and how near a named point would mean that one."""
    vertices = np.concatenate([piece.vertices for piece in show.bodies[link].pieces])
    height = float(vertices[:, 2].max())
    start, along = np.asarray(origin, float), np.asarray(direction, float)
    if not (np.isfinite(start).all() and np.isfinite(along).all()) or abs(along[2]) < 1e-6:
        raise ValueError("the click met no point of the link: look at it from the front")
    x, y, _ = start + along * (height - start[2]) / along[2]
    px, py, angle = show.poses[link][frame]
    z = complex(x - px, y - py) * np.exp(-1j * angle)
    return float(z.real), float(z.imag), NEAR * show.size


def with_traced(draft: Draft, link: str, spot: tuple[float, float, float]) -> Draft:
    """A draft that traces a place of a link: one of its points if one is near, else a new one. Raises `SceneError` where the
    link's points are placed by the sketch."""
    scene = draft.scene()
    spec = {s.name: s for s in scene.mechanism.links}[link]
    x, y, near = spot
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
        per = float(Units(**scene.document.units.model_dump()).factor("length"))
        changes["links", link, "points", name] = [float(f"{x / per:.4g}"), float(f"{y / per:.4g}")]
    traced = f"{link}.{name}"
    known = scene.document.trace
    mine = [t for t in known if t in (traced, name)]
    changes["trace",] = [t for t in known if t not in mine] if mine else [*known, traced]
    return draft.changed(changes)
