"""The camera: straight on, y up, the whole motion in the part of the picture that no panel covers."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray
from viser import _messages

__all__ = ["FittedCameras", "View", "fit_view", "move_to", "set_first_view"]

FIELD_OF_VIEW = np.radians(18.0)  # little perspective: lengths can be compared, and yet plates have thickness
TIMELINE = 0.25  # part of the picture's height that the timeline covers
MARGIN = 0.06  # around the mechanism, of its extent
SETTLING = 0.25  # [s] without a change before the view is fitted anew
UNMOVED = 1e-2  # of the distance: a camera this near to a view that was set has not been moved by the user
FITS = 2e-3  # of the distance: a view this near to the best one is left alone (the pixels of a picture are rounded)
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


class FittedCameras:
    """Keeps the view of every browser fitted to its window, also when that changes, until its user moves the camera.

    While a page builds up, its window changes several times, and viser itself sets the camera more than once. So the view is
    looked at only when nothing has changed for a while, and every view that was ever set counts as not moved by the user.
    """

    def __init__(self, server: viser.ViserServer, bounds: NDArray[np.float64]):
        self._server, self._bounds = server, bounds
        self._known: dict[int, list[View]] = {}  # by browser: the views that it has been given

    def follow(self, client: viser.ClientHandle) -> None:
        """From now on, fit the view of a browser that has just come."""
        # viser's default, and our first
        self._known[client.client_id] = [View(np.array([3.0, 3.0, 3.0]), np.zeros(3)), fit_view(self._bounds, USUAL_ASPECT)]
        changes = [0]

        async def update(camera: Any) -> None:
            changes[0] += 1
            latest = changes[0]
            await asyncio.sleep(SETTLING)
            if latest == changes[0] and client.client_id in self._server.get_clients():
                self._fit(client, camera)

        client.camera.on_update(update)

    def forget(self, client: viser.ClientHandle) -> None:
        """The browser has gone."""
        self._known.pop(client.client_id, None)

    def look_from_front(self, client: viser.ClientHandle) -> None:
        """Bring a browser's camera back to the front, and follow its window again."""
        camera = client.camera
        aspect = camera.image_width / camera.image_height if min(camera.image_height, camera.image_width) > 0 else USUAL_ASPECT
        self._set(client, fit_view(self._bounds, aspect))

    def _fit(self, client: viser.ClientHandle, camera: Any) -> None:
        """Fit the view, unless the user has moved the camera or the view fits already."""
        if camera.image_height <= 0 or camera.image_width <= 0:
            return
        view = fit_view(self._bounds, camera.image_width / camera.image_height)
        known = self._known.get(client.client_id, [])
        near = UNMOVED * view.distance  # of one known position, and of one known target: viser may have set only one of the two
        moved = not (
            any(np.linalg.norm(v.position - camera.position) < near for v in known)
            and any(np.linalg.norm(v.look_at - camera.look_at) < near for v in known)
        )
        apart = float(np.linalg.norm(view.position - camera.position) + np.linalg.norm(view.look_at - camera.look_at))
        if not moved and apart > FITS * view.distance:
            self._set(client, view)

    def _set(self, client: viser.ClientHandle, view: View) -> None:
        known = self._known.setdefault(client.client_id, [])
        known.append(view)
        del known[2 : len(known) - MOST_KNOWN]
        move_to(client, view)


def move_to(client: viser.ClientHandle, view: View) -> None:
    """Put a browser's camera to a view, wherever the browser last said that its camera was.

    The setters of viser's camera send nothing if the camera is there already, by what the browser has told. A browser that is busy
    drawing tells later, so that a click right after a turn of the mouse wheel would be lost: hence the messages themselves.
    """
    position, look_at = (tuple(float(x) for x in vector) for vector in (view.position, view.look_at))
    with client.atomic():
        client._websock_connection.queue_message(_messages.SetCameraPositionMessage(position))
        client._websock_connection.queue_message(_messages.SetCameraLookAtMessage(look_at))
    client.flush()
