"""How large mechanisms are in the viewer: all solids projected through the camera that a browser is given."""

from __future__ import annotations

import numpy as np
import pytest
from filled import SCENES, arrows_box, solid_points

from mechviz.outputs.viewer.world.camera import PRESETS, fit_view
from recordings import solids

FREE = {"1600x1000": 930 / 920, "1280x720": 610 / 616, "390x844": 390 / 388, "844x390": 764 / 294}
"""Width over height of what panels and the timeline leave of a window."""


@pytest.mark.parametrize("name", SCENES)
def test_a_mechanism_fills_two_thirds_of_the_height_or_width_and_no_part_is_cut_off(name):
    points, arrows, core = solid_points(name), arrows_box(name), np.asarray(solids(name).bounds, float)
    for window, aspect in FREE.items():
        for preset in (PRESETS["front"], PRESETS["isometric"]):
            view = fit_view(arrows, aspect, preset, core)
            away = (view.position - view.look_at) / view.distance
            right = np.cross([0.0, 1.0, 0.0], away)
            right /= np.linalg.norm(right)
            local = points - view.look_at
            depth = (view.distance - local @ away) * np.tan(0.5 * preset.fov)
            x, y = local @ right / depth / aspect, local @ np.cross(away, right) / depth  # -1 to 1 over the picture
            assert max(np.abs(x).max(), np.abs(y).max()) < 1.0, (window, preset.label)
            least = 2.0 / 3.0 if preset.label == "Front" else 0.5  # a box that is seen at an angle is not filled to its corners
            assert max(np.ptp(x), np.ptp(y)) > 2.0 * least, (window, preset.label)
