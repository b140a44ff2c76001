"""Light and ground behind the mechanism."""

from __future__ import annotations

import numpy as np
import viser
from numpy.typing import NDArray

CELLS = {False: ((228, 231, 235), (208, 213, 219)), True: ((44, 48, 55), (62, 68, 78))}  # light, dark: of cells, of sections


def grid_cell(size: float) -> float:
    """A round length (1, 2 or 5 times a power of ten) [m] near a tenth of the mechanism's size."""
    wanted = size / 10.0
    decade = 10.0 ** np.floor(np.log10(wanted))
    return float(decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= wanted * (1.0 + 1e-9)))


class Stage:
    """Lights, and a grid in the plane behind everything, light or dark as the page is.

    The lights are our own: viser's default environment reflects a city in the arrows, so that they lose the colours of the legend,
    and shadows double what a picture costs.
    """

    def __init__(self, server: viser.ViserServer, bounds: NDArray[np.float64], size: float):
        scene = server.scene
        scene.set_up_direction("+y")
        scene.configure_default_lights(False)
        scene.configure_environment_map(None)
        scene.add_light_hemisphere("/lights/sky", sky_color=(255, 255, 255), ground_color=(196, 202, 214), intensity=1.5)
        for name, position, intensity in (("key", (-0.6, 1.0, 1.6), 1.3), ("fill", (1.0, 0.1, 1.2), 0.35)):
            scene.add_light_directional(f"/lights/{name}", intensity=intensity, position=position)
        scene.world_axes.visible = False
        self.cell = cell = grid_cell(size)
        # Whole sections, so that the lines stand at round coordinates
        extent = np.ceil(3.0 * size / (5.0 * cell)) * 5.0 * cell
        centre = np.round(bounds.mean(axis=0)[:2] / (5.0 * cell)) * 5.0 * cell
        self._grid = scene.add_grid(
            "/grid",
            width=2.0 * extent,
            height=2.0 * extent,
            plane="xy",
            position=(centre[0], centre[1], bounds[0, 2] - 0.02 * size),
            cell_size=cell,
            section_size=5.0 * cell,
            cell_color=CELLS[False][0],
            section_color=CELLS[False][1],
            cell_thickness=0.6,
            section_thickness=0.9,
            fade_distance=1e4 * size,
            fade_strength=0.0,
            shadow_opacity=0.0,
        )

    def switch(self, on: bool) -> None:
        """Draw the grid, or not."""
        self._grid.visible = on

    def darken(self, dark: bool) -> None:
        """Take the colours for a dark page or for a light one."""
        self._grid.cell_color, self._grid.section_color = CELLS[dark]
