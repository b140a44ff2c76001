"""The camera: presets, and views that show the whole motion, nearly without perspective in 2D. Lights and grid."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial

import numpy as np
import viser

from mechcore.arrays import Real
from mechcore.records import dataclass
from mechviz.outputs.viewer.viser_adapter import run_script
from mechviz.picture.proportions import ANGLED, is_deep
from mechviz.scene.units import Units

FIELD_OF_VIEW = np.radians(18.0)  # little perspective: lengths can be compared, and the thickness of plates can be seen
FLAT_FIELD_OF_VIEW = np.radians(1.5)  # viser has no orthographic camera; with this angle perspective is not noticeable
VIEW_MARGIN = 0.05  # around the mechanism, of its extent
WIDEST_VIEW = 1.22  # largest height of the view over that of the mechanism alone: limits the room for arrows
ROOM_STEPS = 16  # steps in which the room for arrows is reduced until the mechanism is large enough
TOP_VIEW_TILT = 1e-3  # z over y of the direction of the top view: small, but not zero, so that y is still up in the picture
SETTLING_TIME = 0.25  # [s] without a change before the view is fitted anew
UNMOVED_DISTANCE = 1e-2  # of the distance: a camera this near to a view that was set has not been moved by the user
UNSHIFTED_TARGET = 1e-3  # of the visible height: the same limit for the point at which the camera looks
FITTING_TOLERANCE = 2e-3  # of the distance: a view this near to the best one is kept (pixel sizes of a picture are rounded)
MOST_KNOWN = 500  # number of views that have been sent to browsers and may still be reported
VISER_FIRST = (3.0, 3.0, 3.0)  # [m] camera position in viser's pages, looking at the origin, until they receive another view
MOST_NEAR = 1e-3  # of the distance of a view: nearest distance by the mouse wheel (viser's own limit is 10 mm)
USUAL_ASPECT = 0.9  # of the picture between the docked panels, until the browser has sent its own

# In 2D, dragging moves the mechanism in its plane and the wheel zooms at the pointer; in other views dragging rotates. viser has no
# function for it: the script uses a hook that viser's page exposes; without the hook, dragging rotates in 2D as well.
DRAGGING_SCRIPT = """
{ const controls = (window.__viserMutable || {}).cameraControl, action = controls && controls.constructor.ACTION;
  if (action && action.TRUCK !== undefined) {
    const flat = FLAT;
    controls.mouseButtons.left = flat ? action.TRUCK : action.ROTATE;
    controls.touches.one = flat ? action.TOUCH_TRUCK : action.TOUCH_ROTATE;
    controls.dollyToCursor = flat;
  } }
"""

# viser's own button "Reset View" moves the camera to its first position, but keeps the field of view and the dragging of 2D: here
# it is made to press our button of the first preset, which resets everything.
RESET_SCRIPT = """
{ const viser = window.__viserMutable;
  if (viser && viser.resetCameraPose && viser.sendMessage) {
    if (!window.mechvizReset) {
      let reset = viser.resetCameraPose;
      const press = (pressed) => pressed ? viser.sendMessage({ type: "GuiUpdateMessage", ...window.mechvizReset }) : reset(pressed);
      Object.defineProperty(viser, "resetCameraPose", { configurable: true, enumerable: true, get: () => press,
        set: (other) => { reset = other; } });
    }
    window.mechvizReset = { uuid: UUID, updates: { value: LABEL } };
  } }
"""


@dataclass(frozen=True)
class Preset:
    """A viewing direction, ``away`` from the mechanism towards the camera, and the field of view ``fov`` [rad]; ``ground``: the
    grid lies below the mechanism, otherwise behind it."""

    label: str
    direction: tuple[float, float, float]
    fov: float = float(FIELD_OF_VIEW)
    ground: bool = False


VIEW_PRESETS: Mapping[str, Preset] = {
    "front": Preset("Front", (0.0, 0.0, 1.0)),
    "flat": Preset("2D", (0.0, 0.0, 1.0), float(FLAT_FIELD_OF_VIEW)),
    "angled": Preset("Angled", ANGLED, ground=True),
    "isometric": Preset("Isometric", (-1.0, 1.0, 1.0), float(FLAT_FIELD_OF_VIEW), ground=True),
    "top": Preset("Top", (0.0, 1.0, TOP_VIEW_TILT), float(FLAT_FIELD_OF_VIEW), ground=True),
    "side": Preset("Side", (1.0, 0.0, 0.0), float(FLAT_FIELD_OF_VIEW), ground=True),
    "behind": Preset("Behind", (0.0, 0.0, -1.0)),
}


@dataclass(frozen=True)
class View:
    """Position and target of the camera [m], and its field of view [rad]."""

    position: Real
    look_at: Real
    fov: float = float(FIELD_OF_VIEW)

    @property
    def distance(self) -> float:
        return float(np.linalg.norm(self.position - self.look_at))

    @property
    def height(self) -> float:
        """Visible height of the plane through the target [m]."""
        return float(2.0 * self.distance * np.tan(0.5 * self.fov))


def fit_view(bounds: Real, aspect: float, preset: Preset = VIEW_PRESETS["front"], core: Real | None = None) -> View:
    """The view of a box ``bounds`` (2, 3) [m] for a picture of width over height ``aspect``; y is up in all views.

    ``core``: a box that must appear large (see `WIDEST_VIEW`); the box ``bounds`` is reduced towards it as far as necessary.
    """
    if core is not None:
        most = WIDEST_VIEW * _view_on(core, aspect, preset).height
        boxes = (core + part * (bounds - core) for part in np.linspace(1.0, 0.0, ROOM_STEPS))
        views = (_view_on(box, aspect, preset) for box in boxes)
        return next(view for view in views if view.height <= most)
    return _view_on(bounds, aspect, preset)


def _view_on(bounds: Real, aspect: float, preset: Preset) -> View:
    """The view that just shows a box."""
    away = np.array(preset.direction) / np.linalg.norm(preset.direction)
    right = np.cross([0.0, 1.0, 0.0], away)
    right = right / np.linalg.norm(right)
    up = np.cross(away, right)
    corners = np.array([[bounds[i, 0], bounds[j, 1], bounds[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)], float)
    x, y, z = corners @ right, corners @ up, corners @ away
    width, height = np.ptp(x) * (1 + 2 * VIEW_MARGIN), np.ptp(y) * (1 + 2 * VIEW_MARGIN)
    visible = max(height, width / max(aspect, 0.1), 1e-6)  # height of the picture at the front of the box
    distance = visible / (2.0 * np.tan(preset.fov / 2.0))
    middle = np.array([x.min() + x.max(), y.min() + y.max()]) / 2.0
    centre = middle[0] * right + middle[1] * up + z.max() * away
    return View(centre + distance * away, centre, preset.fov)


def first_preset(core: Real) -> str:
    """Name of the preset with which browsers begin: front, or angled if the box ``core`` (2, 3) [m] of the mechanism is so deep
    that one part hides the others."""
    return "angled" if is_deep(core) else "front"


def reset_to(server: viser.ViserServer, uuid: str, label: str) -> None:
    """Make viser's "Reset View" press the button ``label`` of the group ``uuid``, in every browser."""
    run_script(server, RESET_SCRIPT.replace("UUID", json.dumps(uuid)).replace("LABEL", json.dumps(label)), "reset")


class FittedCameras:
    """Keeps the view of every browser fitted to its window, also when that changes, until its user moves the camera.

    While a page loads, its window changes several times, and viser itself sets the camera more than once. So the view is checked
    only when nothing has changed for a while, and every view that was ever set counts as not moved by the user. The same holds for
    the first views, which a busy page may apply late, after it has been sent another view, and for the views of the first preset
    sent to any browser: a page that lost its connection returns as a new browser.
    """

    def __init__(self, server: viser.ViserServer, bounds: Real, core: Real, stage: Backdrop):
        self._server, self._stage = server, stage
        self._shared = [View(np.array(VISER_FIRST), np.zeros(3))]
        self._own: dict[int, list[View]] = {}  # by browser: the views that only this one has been given
        self._presets: dict[int, str] = {}  # by browser
        self._closed = False
        self._begin_with(bounds, core)

    def close(self) -> None:
        """Stop controlling the cameras: another object takes over."""
        self._closed = True

    def start_fitting(self, client: viser.ClientHandle) -> None:
        """Start fitting the view of a browser that has just connected."""
        if self._closed:
            return
        self._stage.face(client, ground=VIEW_PRESETS[self.preset(client)].ground)
        loop = self._server.get_event_loop()
        timer: asyncio.TimerHandle | None = None

        def settle() -> None:
            if client.client_id in self._server.get_clients():
                self._fit(client, client.camera)

        async def update(_: object) -> None:
            nonlocal timer
            if timer is not None:
                timer.cancel()
            timer = loop.call_later(SETTLING_TIME, settle)

        client.camera.on_update(update)

    def set_bounds(self, bounds: Real, core: Real) -> None:
        """Take a new extent of the mechanism: fit the views that no user has moved, and start new browsers with it."""
        self._begin_with(bounds, core)
        self._between_reports(self._fit_all)

    def release(self, client: viser.ClientHandle) -> None:
        """Let the present view of a browser count as not moved by its user, because its user has replaced the mechanism."""
        camera = client.camera
        self._own.setdefault(client.client_id, []).append(View(np.asarray(camera.position), np.asarray(camera.look_at)))

    def forget(self, client: viser.ClientHandle) -> None:
        """Drop the state of a browser that has disconnected."""
        self._own.pop(client.client_id, None)
        self._presets.pop(client.client_id, None)
        self._stage.forget(client)

    def preset(self, client: viser.ClientHandle) -> str:
        """The preset last chosen in a browser."""
        return self._presets.get(client.client_id) or self.first

    @property
    def first(self) -> str:
        """The preset with which browsers begin."""
        return first_preset(self._core)

    def set_preset(self, client: viser.ClientHandle, preset: str) -> None:
        """Move a browser's camera to one of the ``VIEW_PRESETS`` and fit it to its window again. In 2D, dragging does not
        rotate."""
        self._presets[client.client_id] = preset
        run_script(client, DRAGGING_SCRIPT.replace("FLAT", json.dumps(preset == "flat")), "dragging")
        self._stage.face(client, ground=VIEW_PRESETS[preset].ground)
        self._between_reports(partial(self._bring, client))

    def _between_reports(self, act: Callable[[], None]) -> None:
        """Run ``act``, which moves cameras, in viser's thread, which also stores the reports of browsers. Otherwise a report during
        `move_to` that the camera is already there would suppress the last of its messages, and the first would count."""
        with suppress(RuntimeError):  # the server has been stopped
            self._server.get_event_loop().call_soon_threadsafe(act)

    def _bring(self, client: viser.ClientHandle) -> None:
        """Move a browser's camera to its preset, wherever it is."""
        camera = client.camera
        aspect = camera.image_width / camera.image_height if min(camera.image_height, camera.image_width) > 0 else USUAL_ASPECT
        self._set(client, fit_view(self._bounds, aspect, VIEW_PRESETS[self.preset(client)], self._core))

    def _fit_all(self) -> None:
        for client in self._server.get_clients().values():
            self._fit(client, client.camera)

    def _begin_with(self, bounds: Real, core: Real) -> None:
        """Set the view of new browsers and of viser's own "Reset View"."""
        self._bounds, self._core = bounds, core
        view = fit_view(bounds, USUAL_ASPECT, VIEW_PRESETS[self.first], core)
        self._share(view)
        camera = self._server.initial_camera
        camera.fov = view.fov
        camera.near = view.distance / 100.0
        camera.far = view.distance * 100.0
        camera.up = (0.0, 1.0, 0.0)
        camera.position = view.position
        camera.look_at = view.look_at

    def _fit(self, client: viser.ClientHandle, camera: viser.CameraHandle) -> None:
        """Fit the view, unless the user has moved the camera or the view already fits."""
        if self._closed or camera.image_height <= 0 or camera.image_width <= 0:
            return
        view = fit_view(self._bounds, camera.image_width / camera.image_height, VIEW_PRESETS[self.preset(client)], self._core)
        known = [*self._shared, *self._own.get(client.client_id, [])]
        # near any known position and near any known target: viser may have set only one of the two
        near = UNMOVED_DISTANCE * view.distance
        # a 2D view is far away, yet looks at the same extent
        beside = UNSHIFTED_TARGET * 2.0 * view.distance * np.tan(view.fov / 2.0)
        distances = np.linalg.norm(np.array([v.position for v in known]) - camera.position, axis=1)
        shifts = np.linalg.norm(np.array([v.look_at for v in known]) - camera.look_at, axis=1)
        moved = distances.min() >= near or shifts.min() >= beside
        apart = float(np.linalg.norm(view.position - camera.position) + np.linalg.norm(view.look_at - camera.look_at))
        if not moved and apart > FITTING_TOLERANCE * view.distance:
            self._set(client, view)

    def _set(self, client: viser.ClientHandle, view: View) -> None:
        if self.preset(client) == self.first:
            self._share(view)
        else:
            own = self._own.setdefault(client.client_id, [])
            own.append(view)
            del own[: len(own) - MOST_KNOWN]
        move_to(client, view)

    def _share(self, view: View) -> None:
        """Remember a view of the first preset as one that browsers have been sent."""
        self._shared.append(view)
        del self._shared[1 : len(self._shared) - MOST_KNOWN]


def move_to(client: viser.ClientHandle, view: View) -> None:
    """Set a browser's camera to a view, whatever position the browser reported last.

    viser sends nothing if the camera is already there according to the last message of the browser. A busy browser reports late, so
    that a click right after a turn of the mouse wheel would have no effect. Therefore each value is first set to a different one,
    which is not sent, as only the last value of the block is.
    """
    camera, distance = client.camera, view.distance
    nearest = min(MOST_NEAR * distance, 0.5 * camera.max_orbit_distance)
    with client.atomic():
        camera.fov, camera.near, camera.far = 0.5 * view.fov, distance, 2.0 * distance
        camera.fov, camera.near, camera.far = view.fov, distance / 100.0, 100.0 * distance
        camera.min_orbit_distance = 0.5 * nearest
        camera.min_orbit_distance = nearest
        camera.position = 2.0 * view.position - view.look_at
        camera.look_at = 0.5 * (view.position + view.look_at)
        camera.up_direction = (1.0, 0.0, 0.0)
        camera.up_direction = (0.0, 1.0, 0.0)
        camera.position, camera.look_at = view.position, view.look_at
    client.flush()


GRID_COLORS = {False: ((228, 231, 235), (208, 213, 219)), True: ((44, 48, 55), (62, 68, 78))}  # light, dark: of cells, of sections


def grid_cell(size: float, units: Units) -> float:
    """A length [m], at most a tenth of the mechanism's size, that is round (1, 2 or 5 times a power of ten) in display units."""
    _, factor = units.display_unit("m")
    wanted = factor * size / 10.0
    decade = 10.0 ** np.floor(np.log10(wanted))
    return float(decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= wanted * (1.0 + 1e-9)) / factor)


class Backdrop:
    """Lights, and a grid below the mechanism or in the plane behind everything, in the colours of a light or dark page.

    The lights replace viser's: its default environment map reflects a city in the arrows, so that they lose the colours of the
    legend, and shadows double the time of drawing.
    """

    def __init__(self, server: viser.ViserServer, bounds: Real, size: float, units: Units):
        scene = server.scene
        scene.set_up_direction("+y")
        scene.configure_default_lights(False)
        scene.configure_environment_map(None)
        scene.add_light_hemisphere("/lights/sky", sky_color=(255, 255, 255), ground_color=(196, 202, 214), intensity=1.5)
        for name, position, intensity in (("key", (-0.6, 1.0, 1.6), 1.3), ("fill", (1.0, 0.1, 1.2), 0.35)):
            scene.add_light_directional(f"/lights/{name}", intensity=intensity, position=position)
        scene.world_axes.visible = False
        self.cell = grid_cell(size, units)
        self._bounds, self._size = bounds, size
        self._grids: dict[int, viser.GridHandle] = {}  # by browser: each has its own view
        self._on, self._dark = True, False

    def face(self, client: viser.ClientHandle, *, ground: bool) -> None:
        """Place the grid of a browser below the mechanism (``ground``) or behind it."""
        section = 5.0 * self.cell
        extent = np.ceil(5.0 * self._size / section) * section
        # Whole sections, so that the lines stand at round coordinates
        x, y, z = np.round(self._bounds.mean(axis=0) / section) * section
        place = (x, self._bounds[0, 1] - 0.002 * self._size, z) if ground else (x, y, self._bounds[0, 2] - 0.02 * self._size)
        cells, sections = GRID_COLORS[self._dark]
        self._grids[client.client_id] = client.scene.add_grid(
            "/grid",
            width=2.0 * extent,
            height=2.0 * extent,
            plane="xz" if ground else "xy",
            position=place,
            cell_size=self.cell,
            section_size=section,
            cell_color=cells,
            section_color=sections,
            cell_thickness=0.6,
            section_thickness=0.9,
            fade_distance=1e4 * self._size,
            fade_strength=0.0,
            shadow_opacity=0.0,
            visible=self._on,
        )

    def forget(self, client: viser.ClientHandle) -> None:
        """Drop the grid of a browser that has disconnected."""
        self._grids.pop(client.client_id, None)

    def switch(self, on: bool) -> None:
        """Show or hide the grid."""
        self._on = on
        for grid in self._grids.values():
            grid.visible = on

    def darken(self, dark: bool) -> None:
        """Use the colours for a dark or a light page."""
        self._dark = dark
        for grid in self._grids.values():
            grid.cell_color, grid.section_color = GRID_COLORS[dark]
