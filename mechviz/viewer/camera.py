"""The camera: straight on, y up, the whole motion in the part of the picture that no panel covers."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

__all__ = ["View", "fit_view", "keep_fitted", "set_first_view"]

FIELD_OF_VIEW = np.radians(18.0)  # little perspective: lengths can be compared, and yet plates have thickness
TIMELINE = 0.25  # part of the picture's height that the timeline covers
MARGIN = 0.06  # around the mechanism, of its extent
SETTLING = 0.25  # [s] without a change before the view is fitted anew
MOST_KNOWN = 50  # views that a browser has been given and may still report
USUAL_ASPECT = 0.9  # of the picture between the docked panels, until the browser has told its own


@dataclass(frozen=True)
class View:
    """Where the camera is and what it looks at [m]."""

    position: NDArray[np.float64]
    look_at: NDArray[np.float64]

    @property
    def distance(self) -> float:
        return float(np.linalg.norm(self.position - self.look_at))


def fit_view(bounds: NDArray[np.float64], aspect: float) -> View:
    """The view from the front on a box ``bounds`` (2, 3) [m] for a picture of width over height ``aspect``."""
    (x0, y0, _), (x1, y1, z1) = bounds
    width, height = (x1 - x0) * (1 + 2 * MARGIN), (y1 - y0) * (1 + 2 * MARGIN)
    visible = max(height / (1.0 - TIMELINE), width / max(aspect, 0.1), 1e-6)  # height of the picture at the front of the box
    distance = visible / (2.0 * np.tan(FIELD_OF_VIEW / 2.0))
    centre = np.array([(x0 + x1) / 2.0, (y0 + y1) / 2.0 - visible * TIMELINE / 2.0, z1])
    return View(centre + np.array([0.0, 0.0, distance]), centre)


def set_first_view(server: viser.ViserServer, bounds: NDArray[np.float64]) -> None:
    """The view of new browsers and of viser's own "Reset View"."""
    view = fit_view(bounds, USUAL_ASPECT)
    camera = server.initial_camera
    camera.fov = float(FIELD_OF_VIEW)
    camera.near = view.distance / 100.0
    camera.far = view.distance * 100.0
    camera.up = (0.0, 1.0, 0.0)
    camera.position = view.position
    camera.look_at = view.look_at


def keep_fitted(server: viser.ViserServer, client: viser.ClientHandle, bounds: NDArray[np.float64]) -> None:
    """Fit the view of a browser to its window, also when that changes, until its user moves the camera.

    While a page builds up, its window changes several times, and viser itself sets the camera more than once. So the view is
    looked at only when nothing has changed for a while, and every view that was ever set counts as not moved by the user.
    """
    known = [View(np.array([3.0, 3.0, 3.0]), np.zeros(3)), fit_view(bounds, USUAL_ASPECT)]  # viser's default, and our first
    changes = [0]

    async def update(camera: Any) -> None:
        changes[0] += 1
        latest = changes[0]
        await asyncio.sleep(SETTLING)
        gone = client.client_id not in server.get_clients()
        if gone or latest != changes[0] or camera.image_height <= 0 or camera.image_width <= 0:
            return
        view = fit_view(bounds, camera.image_width / camera.image_height)
        near = 0.01 * view.distance
        moved = not (
            any(np.linalg.norm(v.position - camera.position) < near for v in known)
            and any(np.linalg.norm(v.look_at - camera.look_at) < near for v in known)
        )
        if not moved and np.linalg.norm(view.position - camera.position) + np.linalg.norm(view.look_at - camera.look_at) > near:
            known[2:] = [*known[2:][-MOST_KNOWN:], view]
            move_to(client, view)

    client.camera.on_update(update)


def move_to(client: viser.ClientHandle, view: View) -> None:
    """Put a browser's camera to a view."""
    with client.atomic():
        client.camera.position = view.position
        client.camera.look_at = view.look_at
    client.flush()
