"""Plots of a recording are in the units in which people read them, beside the data in SI units."""

from __future__ import annotations

import numpy as np
import pytest

from mechviz.outputs.rerun.blueprint import spans_of_plots
from recordings import made

FRAMES = 24
CASES = [
    ("cam-roller", "lift", ("data", "cams", "K", "lift"), 0, 1e3, "mm"),
    ("cam-roller", "pressure angle", ("data", "cams", "K", "contact"), 3, 180.0 / np.pi, "°"),
    ("slider-crank-compressor", "displacement", ("data", "joints", "S", "motion"), 0, 1e3, "mm"),
    ("kinetostatic-four-bar", "angle", ("data", "joints", "E", "motion"), 0, 180.0 / np.pi, "°"),
]


@pytest.mark.parametrize(("name", "plot", "table", "column", "factor", "unit"), CASES)
def test_a_plot_is_in_millimetres_or_degrees(name, plot, table, column, factor, unit):
    m = made(name, FRAMES)
    rows = m.recording.rows("plots", plot, component="Scalars:scalars")
    (label,) = m.recording.static("plots", plot, component="SeriesLines:names")
    assert label.endswith(f"[{unit}]")
    ticks, data = m.recording.scalars(*table)
    at = np.searchsorted(ticks, rows.time)
    np.testing.assert_allclose(rows.values.reshape(-1), factor * data[at, column], rtol=1e-12, atol=1e-12)
    title = next(title for title in spans_of_plots(m.run) if plot in title.lower())
    assert title.endswith(f"[{unit}]")


def test_no_plot_of_the_blueprint_is_in_metres_radians_or_pascals():
    for name in ("cam-roller", "slider-crank-compressor", "jansen-leg", "kinetostatic-four-bar"):
        titles = spans_of_plots(made(name, FRAMES).run)
        assert titles and not any(title.endswith(("[m]", "[rad]", "[Pa]")) for title in titles)
