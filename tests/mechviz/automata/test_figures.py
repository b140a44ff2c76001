"""Figures as which links are drawn: `outline` of a link."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from sections import section

import mechviz
from mechcore.errors import MechanismError
from mechviz.outputs.page.pack import unpack
from mechviz.outputs.page.page import page_data
from mechviz.outputs.presentation import presentation_in, presentation_of
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.picture.build import solids_of
from mechviz.picture.nodes import Body
from mechviz.runs import run_scene
from mechviz.scene.scene import dump, load

STAR = [[-20, -20], [50, -30], [120, -20], [60, 10], [50, 60], [40, 10]]


def four_bar(sketched: bool, outline=STAR, link="coupler") -> mechviz.Scene:
    places = {"A": (0, 0), "B": (15, 20), "C": (120, 70), "D": (140, 0)}
    pairs = {"frame": "AD", "crank": "AB", "coupler": "BC", "rocker": "DC"}
    links: dict[str, dict[str, object]] = {}
    for name, pair in pairs.items():
        far = float(np.hypot(*np.subtract(places[pair[1]], places[pair[0]])))
        links[name] = {"points": list(pair) if sketched else {pair[0]: [0, 0], pair[1]: [far, 0]}}
    links[link]["outline"] = outline
    joints: dict[str, dict[str, object]] = {
        "A": {"revolute": ["frame", "crank"], "drive": {"speed": "60 rpm", "start": 53.13010235415598}},
        "B": {"revolute": ["crank", "coupler"]},
        "C": {"revolute": ["coupler", "rocker"]} | ({} if sketched else {"side": "right"}),
        "D": {"revolute": ["frame", "rocker"]},
    }
    if sketched:
        del joints["A"]["drive"]["start"]  # type: ignore[attr-defined]
    sketch = {"sketch": {name: list(at) for name, at in places.items()}} if sketched else {}
    return mechviz.Scene.build(units={"length": "mm", "angle": "deg"}, links=links, joints=joints, **sketch)


@pytest.mark.parametrize("sketched", [False, True])
def test_a_link_is_drawn_as_its_outline_in_its_axes_or_those_of_the_sketch(sketched):
    run = run_scene(four_bar(sketched), frames=36)
    mesh = solids_of(run).links["coupler"].mesh
    pose = run.motion.pose("coupler")[0]
    x, y = (np.array(STAR, float) * 1e-3).T
    if sketched:  # where the sketch has it: seen from the link, turned back
        z = (x + 1j * y - complex(*pose[:2])) * np.exp(-1j * pose[2])
        x, y = z.real, z.imag
    figure = shapely.Polygon(np.column_stack([x, y]))
    cut = section(mesh, float(np.median(mesh.vertices[:, 2])))
    missing = figure.buffer(-2e-4).difference(cut)
    assert missing.area < 0.02 * figure.area  # but for holes of pins nothing
    assert cut.difference(figure.buffer(2e-4)).area < 0.4 * figure.area  # what its pins need


def test_outlines_are_kept_and_faults_of_them_told(tmp_path):
    dump(four_bar(False), tmp_path / "scene.toml")
    assert mechviz.load(tmp_path / "scene.toml").mechanism == four_bar(False).mechanism
    with pytest.raises(MechanismError, match=r"links.coupler.outline +it crosses or touches itself near x = 5"):
        four_bar(False, [[0, 0], [10, 10], [10, 0], [0, 10]])
    with pytest.raises(MechanismError, match="drawn as ground"):
        four_bar(False, STAR, "frame")


def test_a_link_is_drawn_in_its_colour_and_a_show_opens_without_marks(tmp_path):
    """In a run, in a recording of it and in the page of either; a wrong colour is told."""
    scene = four_bar(False).changed({("marks",): False, ("links", "coupler", "colour"): "#D9534f", ("trace",): ["coupler.B"]})
    run = run_scene(scene, frames=12)
    write_recording(run, tmp_path / "a.rrd")
    for shown in (presentation_of(run), presentation_in(Recording(tmp_path / "a.rrd"))):
        (coupler,) = (node for node in shown.picture.nodes_of(Body, "solids") if node.owner == ("link", "coupler"))
        seen = {tuple(color) for color in coupler.mesh.colors.tolist()}
        assert (0xD9, 0x53, 0x4F) in seen and (86, 160, 140) not in seen, "its own instead of that of its place"
        assert not shown.picture.marks
        packed, _ = page_data(shown, plots=False)
        groups = {group["name"]: group["shown"] for group in unpack(packed)[0]["groups"]}
        assert not (groups["names"] or groups["velocity"]) and groups["paths"]
    for colour in ("red", "#12345", 7):
        with pytest.raises(MechanismError, match=r"links.coupler.colour"):
            scene.changed({("links", "coupler", "colour"): colour})


def test_edges_of_a_figure_are_bevelled_whatever_its_corners():
    """A needle with a tip narrower than two bevels, and a sharp notch: the plate's face is smaller all round, by the bevel."""
    needle = [[-20, -20], [120, -20], [200, -8.4], [200, -8], [120, -8], [120, 20], [62, 20], [58, -5], [54, 20], [-20, 20]]
    solids = solids_of(run_scene(four_bar(False, needle), frames=36))
    bevel, mesh = 0.12 * 0.75 * 0.033 * solids.size, solids.links["coupler"].mesh
    (whole, low, high), *_ = solids.heights.flat_outlines("coupler")
    middle, face = (section(mesh, z) for z in (0.5 * (low + high), high - 1e-3 * bevel))
    assert middle.area - face.area == pytest.approx(bevel * whole.exterior.length, rel=0.15)
    assert middle.bounds[2] > 0.170, "little of the needle is cut off"


def test_a_shaft_turns_with_what_is_welded_on_its_axis():
    """The sails of the mill stand on its shaft; a pin of the ground there would have its head in the neck between them."""
    solids = solids_of(run_scene(load("theatre"), frames=24))
    (part,) = solids.heights.parts("mill", ("pin",))
    assert all(np.hypot(*shape.centroid.coords[0]) < 1e-6 for shape, _, _ in part)
    assert not solids.clashes
