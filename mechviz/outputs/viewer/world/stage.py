"""Light and ground of the mechanism."""

from __future__ import annotations

import numpy as np
import viser

from mechcore.arrays import Real

CELLS = {False: ((228, 231, 235), (208, 213, 219)), True: ((44, 48, 55), (62, 68, 78))}  # light, dark: of cells, of sections


def grid_cell(size: float) -> float:
    """A round length (1, 2 or 5 times a power of ten) [m] near a tenth of the mechanism's size."""
    wanted = size / 10.0
    decade = 10.0 ** np.floor(np.log10(wanted))
    return float(decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= wanted * (1.0 + 1e-9)))


class Stage:
    """Lights, and a grid below the mechanism or in the plane behind everything, light or dark as the page is.

    The lights are our own: viser's default environment reflects a city in the arrows, so that they lose the colours of the legend,
    and shadows double what a picture costs.
    """

    def __init__(self, server: viser.ViserServer, bounds: Real, size: float):
        scene = server.scene
        scene.set_up_direction("+y")
        scene.configure_default_lights(False)
        scene.configure_environment_map(None)
        scene.add_light_hemisphere("/lights/sky", sky_color=(255, 255, 255), ground_color=(196, 202, 214), intensity=1.5)
        for name, position, intensity in (("key", (-0.6, 1.0, 1.6), 1.3), ("fill", (1.0, 0.1, 1.2), 0.35)):
            scene.add_light_directional(f"/lights/{name}", intensity=intensity, position=position)
        scene.world_axes.visible = False
        self.cell = grid_cell(size)
        self._bounds, self._size = bounds, size
        self._grids: dict[int, viser.GridHandle] = {}  # by browser: each looks from where it likes
        self._on, self._dark = True, False

    def face(self, client: viser.ClientHandle, *, ground: bool) -> None:
        """Put the grid of a browser below the mechanism, as its ground, or behind it."""
        section = 5.0 * self.cell
        extent = np.ceil(3.0 * self._size / section) * section
        # Whole sections, so that the lines stand at round coordinates
        x, y, z = np.round(self._bounds.mean(axis=0) / section) * section
        place = (x, self._bounds[0, 1] - 0.002 * self._size, z) if ground else (x, y, self._bounds[0, 2] - 0.02 * self._size)
        cells, sections = CELLS[self._dark]
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
        """The browser has gone."""
        self._grids.pop(client.client_id, None)

    def switch(self, on: bool) -> None:
        """Draw the grid, or not."""
        self._on = on
        for grid in self._grids.values():
            grid.visible = on

    def darken(self, dark: bool) -> None:
        """Take the colours for a dark page or for a light one."""
        self._dark = dark
        for grid in self._grids.values():
            grid.cell_color, grid.section_color = CELLS[dark]
