"""What people read is in the units of the scene, in every output; data are in SI units, whatever they are."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from page_content import content
from retold import INCHES, METRES, retold
from typer.testing import CliRunner

from mechviz.commands.main import app
from mechviz.outputs.drawings import find_diagrams
from mechviz.outputs.exports.tables import plot_file
from mechviz.outputs.inspection import format_inspection, inspect
from mechviz.outputs.page.page import make_page
from mechviz.outputs.presentation import Presentation, presentation_in, presentation_of
from mechviz.outputs.rerun.blueprint import spans_of_plots
from mechviz.outputs.rerun.contract import read_properties
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.build import build, view_model_of_recording, view_model_of_run
from mechviz.outputs.viewer.panels.diagrams import diagram_svg, diagrams_of
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.outputs.viewer.world.marks import hover_names
from mechviz.picture.nodes import Points
from mechviz.quantities.catalogue import time_decimals
from mechviz.runs import Run, run_scene
from mechviz.scene.folder import gallery
from mechviz.scene.scene import dump, load
from mechviz.scene.units import MILLIMETRES, Units, unit_of

FOLDER = TemporaryDirectory(prefix="mechviz-")
FRAMES = 48
SYSTEMS = {
    "metres": (METRES, r"\bmm\b|°|\bdeg\b|\binch"),
    # the letter N is a normal force, and stages of the solver are counted in ms
    "inches": (INCHES, r"\bmm\b|\d m\b|\bm of|per metre|\[m\b|\bm/(s|rad)|1/m\b|\d N\b|\[N\b|\bkN\b|\bN m\b|MPa|\bkg\b"),
}
SCENES = (
    "cam-roller", "cam-drawing", "cam-friction", "connecting-rod-bending", "plans-four-bar", "shaking-engine", "reduced-inertia",
    "slider-crank-compressor", "shaper-quick-return", "inflection-circle", "polodes-four-bar", "substitute-masses",
    "parallel-forces", "percussion-centre", "lumped-rod", "valve-spring", "pendulum-near-the-top", "scissor-lift",
)  # fmt: skip
SOURCES = ("run", "recording")
CASES = [(name, *case) for k, name in enumerate(SCENES) for case in zip(SYSTEMS, SOURCES[:: (-1) ** k], strict=True)]


@cache
def solved(name: str, system: str) -> Run:
    return run_scene(retold(name, **SYSTEMS[system][0]), frames=FRAMES)


@cache
def recorded(name: str, system: str) -> Path:
    path = Path(FOLDER.name, f"{name}-{system}.rrd")
    write_recording(solved(name, system), path)
    return path


def strings(value: Any) -> Iterator[str]:
    """All texts in what was read from JSON."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        yield from (text for each in value.values() for text in strings(each))
    elif isinstance(value, list | tuple):
        yield from (text for each in value for text in strings(each))


def of_catalogue(shown: Presentation) -> Iterator[str]:
    yield from (q.title for q in shown.catalogue.quantities)
    yield from (axis.title for axis in shown.catalogue.axes)
    yield from (f"[{h.unit}] {h.warning()}" for h in shown.catalogue.health)
    yield from (plot_file("CSV", "", q, shown.catalogue.axes[0]).decode().splitlines()[0] for q in shown.catalogue.quantities[:3])


def of_presentation(shown: Presentation) -> Iterator[str]:
    yield shown.notes
    yield from (f"{event.item}: {event.text}" for event in shown.events)
    yield from (drawing.title for drawing in shown.drawings().values())
    yield from (label for node in shown.picture.nodes_of(Points) for label in node.labels)
    header = content(make_page(shown)[0])[0]
    yield from (f"[{text}]" if re.fullmatch(r"\S{1,3}|N m", text) else text for text in strings(header))


def of_viewer(view_model: ViewModel) -> Iterator[str]:
    yield words.legend(view_model.families, view_model.paths, view_model.scales, 1.0, view_model.size, view_model.units)
    yield words.legend_line(
        sorted(view_model.families), view_model.paths, view_model.scales, lambda _: 1.0, view_model.size, view_model.units
    )
    yield words.place_in_run(view_model, 5)
    yield from (re.sub(r"<[^>]*>", " ", diagram_svg(d, 5)) for d in diagrams_of(view_model).values())
    yield from strings(list(hover_names(view_model).values()))


def of_plots(run: Run) -> Iterator[str]:
    yield from spans_of_plots(run)
    yield from (title for d in find_diagrams(run) for title in (d.title, d.x_title, d.y_title))


def of_series(recording: Recording) -> Iterator[str]:
    for path in recording.entities:
        for component in ("SeriesLines:names", "Points3D:labels", "Points2D:labels", "title", "x_title", "y_title"):
            if not path.startswith(("/data", "/health")):  # whose series are data
                stated = recording.static(path, component=component)
                yield from () if stated is None else map(str, stated)


@pytest.mark.sample(12)
@pytest.mark.parametrize(("name", "system", "source"), CASES)
def test_no_output_of_a_scene_has_other_units_than_its_own(name, system, source):
    """Each scene from its run in some units, from its recording in others."""
    run = solved(name, system)
    if source == "run":
        shown, view_model, texts = presentation_of(run), view_model_of_run(run, build(run)), [*of_plots(run)]
    else:
        recording = Recording(recorded(name, system))
        shown, view_model = presentation_in(recording), view_model_of_recording(recording)
        texts = [*of_series(recording), *format_inspection(inspect(recording.path)).splitlines()]
    texts += [*of_catalogue(shown), *of_presentation(shown), *of_viewer(view_model)]
    told = [text.replace(run.scene.learning_goal, "") for text in texts]  # which is in its author's units
    wrong = [text[:200] for text in told if re.search(SYSTEMS[system][1], text)]
    assert len(texts) > 30 and not wrong


COMMANDS = [
    (["check"], "scissor-lift"),
    (["check", "--modes"], "shaper-quick-return"),
    (["forces"], "parallel-forces"),
    (["forces", "--flywheel", "0.02"], "slider-crank-compressor"),
    (["cams"], "cam-roller"),
    (["cams", "--method", "graphical", "--size", "--margin", "3 lbf"], "cam-roller"),
    (["laws", "cycloidal", "3-4-5", "--scene"], "cam-roller"),
    (["balance"], "shaking-engine"),
    (["forces", "--equations"], "kinetostatic-four-bar"),
]


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize(("command", "name"), COMMANDS)
def test_no_command_prints_other_units_than_those_of_its_scene(command, name, system, tmp_path):
    path = tmp_path / f"{name}.toml"
    dump(retold(name, **SYSTEMS[system][0]), path)
    result = CliRunner().invoke(app, [*command, str(path)])
    assert result.exit_code in (0, 1), result.output
    assert not [line for line in result.output.splitlines() if re.search(SYSTEMS[system][1], line)]


@pytest.mark.sample(12)
@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("name", SCENES)
def test_values_are_the_same_in_all_units(name, system):
    usual, other = run_scene(load(name), frames=FRAMES).catalogue, solved(name, system).catalogue
    assert list(usual.by_key) == list(other.by_key)
    for key, q in usual.by_key.items():
        if q.item != "health":
            first, second = (each[key].values() * factor(each[key].unit) for each in (usual, other))
            size = np.max(np.abs(first), initial=1e-6, where=np.isfinite(first))
            np.testing.assert_allclose(second, first, rtol=1e-9, atol=1e-9 * size, err_msg=key)
    for first, second in zip(usual.axes, other.axes, strict=True):
        np.testing.assert_allclose(factor(second.unit) * second.values, factor(first.unit) * first.values, rtol=1e-12, atol=1e-12)


def factor(unit: str) -> float:
    return float(unit_of(unit).factor) if unit != "1" else 1.0


@pytest.mark.parametrize("system", SYSTEMS)
def test_a_recording_holds_its_units_and_data_in_si_units(system):
    read, usual = Recording(recorded("cam-roller", system)), run_scene(load("cam-roller"), frames=FRAMES)
    assert read.parsed_properties.units == solved("cam-roller", system).scene.units
    _, lifts = read.scalars("data", "cams", "K", "lift")
    np.testing.assert_allclose(lifts, usual.numbers.tables["data", "cams", "K", "lift"].values, rtol=1e-9, atol=1e-12)
    rows = read.rows("plots", "lift", component="Scalars:scalars")
    unit, times = read.parsed_properties.units.display_unit("m")
    assert read.static("plots", "lift", component="SeriesLines:names") == [f"K [{unit}]"]
    np.testing.assert_allclose(rows.values.reshape(-1), times * lifts[:, 0], rtol=1e-12, atol=1e-12)


def test_a_recording_that_does_not_state_its_units_shows_millimetres_and_degrees():
    model = {"frame": "a", "links": ["a"], "joints": {}, "drives": [], "loads": {}}
    properties: dict[str, Any] = {"frames": 1, "tolerance": 1e-12, "model": json.dumps(model)}
    properties |= dict.fromkeys(("newtons_per_metre", "newton_metres_per_metre", "mps_per_metre", "mps2_per_metre"), 1.0)
    said, faults = read_properties(properties)
    assert said is not None and said.units == MILLIMETRES and not faults
    for stated in ({"length": "parsec"}, {"length": "kg"}, "mm", 3):
        said, faults = read_properties(properties | {"units": json.dumps(stated)})
        assert said is None and [fault.split(":")[0].split(".")[0] for fault in faults] == ["property units"]


def test_the_units_that_people_read():
    read = {
        si: MILLIMETRES.display_unit(si)[0] for si in ("m", "rad", "m/s", "rad/s^2", "N", "N m", "Pa", "1/m", "kg m^2", "1", "")
    }
    assert list(read.values()) == ["mm", "°", "m/s", "rad/s²", "N", "N m", "MPa", "1/m", "kg m²", "1", ""]
    read = {si: Units(**INCHES).display_unit(si)[0] for si in read}
    assert list(read.values()) == ["in", "°", "in/s", "rad/s²", "lbf", "lbf in", "lbf/in²", "1/in", "lb in²", "1", ""]
    assert [Units(length="um", torque="N mm").display_unit(si)[0] for si in ("m", "m/s", "N m")] == ["µm", "m/s", "N mm"]
    assert Units(length="in").text(0.0254, "m") == "1 in" and MILLIMETRES.text(np.pi, "rad") == "180°"
    assert [u.decimals("m") for u in (MILLIMETRES, Units(), Units(length="in"), Units(length="um"))] == [2, 5, 3, 2]


def test_scenes_of_the_gallery_state_degrees():
    assert {load(entry.name).document.units.angle for entry in gallery()} == {"deg"}


def test_scales_of_arrows_and_times_of_small_and_quick_mechanisms_are_legible():
    assert words.scale_line(MILLIMETRES, "N", 100.0, 3e-4) == "Scale: 0.005 N = 0.05 mm"
    assert words.scale_line(MILLIMETRES, "N", 1e3, 0.3) == "Scale: 50 N = 50 mm"
    assert [time_decimals(np.linspace(0.0, end, 101)) for end in (0.0, 1.0, 0.01, 3e-6)] == [4, 4, 4, 8]
