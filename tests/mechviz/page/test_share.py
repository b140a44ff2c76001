"""Pages without a server: what is in them is what the recording holds, they are small, and wrong input is refused in words."""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import time
import types
from html import unescape
from pathlib import Path

import numpy as np
import pytest
import shapely
from cases import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from page_content import content
from PIL import Image
from typer.testing import CliRunner

import mechviz
from mechviz.accuracy.estimate import estimate_errors
from mechviz.commands.main import app
from mechviz.files import OutputError
from mechviz.outputs.images.drawing import svg_of, turned
from mechviz.outputs.images.pictures import Look, _write_gif, film, gif_durations, picture_time
from mechviz.outputs.page.pack import Pack, unpack
from mechviz.outputs.page.page import Plot, make_page
from mechviz.outputs.presentation import presentation_in, presentation_of
from mechviz.outputs.rerun.content import html_of
from mechviz.outputs.rerun.entities import parts_of
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.progress import Bar, progress_bar
from mechviz.quantities.numbers import usual_size
from mechviz.runs import run_scene
from mechviz.scene.scene import load
from recordings import FRAMES, Made, made


def recorded() -> Made:
    return made("ten-link-forces", 360)


NUMBERS = st.floats(-1e6, 1e6, allow_nan=False)


@pytest.fixture(scope="module")
def ten():
    page, frames = make_page(recorded().shown)
    return page, frames, *content(page)


# --- packing ----------------------------------------------------------------------------------------------------------


@settings(max_examples=examples(40))
@given(hnp.arrays(float, st.integers(0, 40), elements=NUMBERS), st.lists(st.booleans(), max_size=40))
def test_arrays_come_back_as_exactly_as_they_are_stored(values, absent):
    pack = Pack()
    holes = values.copy()
    holes[: len(absent)][np.array(absent[: len(values)], bool)] = np.nan
    whole = np.round(values).astype(int)
    pack.floats(values), pack.quantised(holes), pack.indices(whole)
    _, arrays = unpack(pack.text({}))
    assert np.array_equal(arrays[0], values.astype(np.float32))
    step = np.ptp(values) / 65534 if len(values) else 0.0
    assert np.array_equal(np.isnan(arrays[1]), np.isnan(holes))
    assert np.all(np.abs(arrays[1] - holes)[~np.isnan(holes)] <= 0.51 * step + 1e-9)
    assert np.array_equal(arrays[2], whole)


def test_what_is_no_direction_and_what_is_too_large_is_stored_as_none():
    """Normals of a damaged mesh, numbers of a damaged table; numpy warned of the casts."""
    pack = Pack()
    pack.directions(np.array([1.0, -0.5, np.nan, np.inf, -1e30]))
    pack.floats(np.array([1.0, 1e39]))
    directions, floats = unpack(pack.text({}))[1]
    np.testing.assert_allclose(directions, [1.0, -64 / 127, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(floats, [1.0, np.nan])


def test_equal_arrays_are_stored_once():
    pack = Pack()
    assert pack.floats(np.arange(5.0)) == pack.floats(np.arange(5.0)) != pack.floats(np.arange(6.0))


# --- pages ------------------------------------------------------------------------------------------------------------


def test_a_page_of_ten_links_is_small_and_names_nothing_outside_itself(ten):
    page = ten[0]
    assert len(page.encode()) < 3e6
    outside = r"""(src|href)\s*=\s*["']|@import|url\((?!#)|https?://(?!www\.w3\.org/2000/svg")"""
    assert not re.search(outside, page.split('id="data"')[0] + page.split("</script>", 1)[1])
    assert "default-src 'none'" in page


def test_poses_and_solids_are_those_of_the_recording(ten):
    _, frames, header, arrays = ten
    assert header["frames"] == header["total"] == len(frames.chosen) == recorded().run.motion.frames
    assert [link["name"] for link in header["links"]] == list(recorded().recording.model["links"])
    for link in header["links"]:
        pose = arrays[link["pose"]].reshape(-1, 3)
        assert np.array_equal(pose, recorded().data("links", link["name"], "pose")[: len(pose)].astype(np.float32))
        assert link["moves"] == (link["name"] != "frame")
        path = ("mechanism", "links", link["name"], "mesh")
        vertices = recorded().recording.static(*path, component="Mesh3D:vertex_positions")
        stored = arrays[link["mesh"]["vertices"]].reshape(-1, 3)
        assert np.abs(stored - vertices).max() < 1e-5 * np.ptp(vertices)
        assert np.array_equal(
            arrays[link["mesh"]["faces"]].reshape(-1, 3), recorded().recording.static(*path, component="Mesh3D:triangle_indices")
        )


def test_a_barrel_cam_turns_about_its_shaft():
    """Shaft along y at O: in the page's poses each corner keeps its height and turns about the shaft as the drive does."""
    barrel = made("cam-barrel")
    header, arrays = content(make_page(barrel.shown)[0])
    link = next(k for k in header["links"] if k["name"] == "cam")
    poses, spins = arrays[link["pose"]].reshape(-1, 3), arrays[link["spin"]].reshape(-1, 7)
    corner = arrays[link["mesh"]["vertices"]].reshape(-1, 3)[:50]
    where = []
    for (x, y, angle), (*shift, qx, qy, qz, qw) in zip(poses, spins, strict=True):
        at = turned(corner, (qx, qy, qz, qw)) + np.array(shift)
        c, s = np.cos(angle), np.sin(angle)
        where.append(np.column_stack([at[:, :2] @ [[c, s], [-s, c]] + [x, y], at[:, 2]]))
    where = np.array(where)
    assert np.ptp(where[:, :, 1], axis=0).max() < 1e-6  # heights along the shaft
    middle = 0.5 * (where[0] + where[len(where) // 2])[:, [0, 2]].mean(axis=0)  # opposite half a turn later
    radius, way = np.hypot(*np.moveaxis(where[:, :, [0, 2]] - middle, 2, 0)), np.diff(where[:, :, [0, 2]], axis=0)
    assert np.ptp(radius, axis=0).max() < 1e-6
    steps = np.hypot(*np.moveaxis(way, 2, 0)) / radius[1:]
    turn = np.diff(barrel.run.motion.coordinate("O")[:, 0])
    assert np.allclose(steps, 2.0 * np.sin(0.5 * turn)[:, None], rtol=1e-3)
    first, second = (svg_of(barrel.shown, time=float(barrel.time[k])) for k in (0, 60))
    assert first != second


def test_plots_are_the_numbers_of_the_recording_in_units_for_people(ten):
    _, _, header, arrays = ten
    plots = {p["title"]: p for p in header["plots"]}
    torque = plots["Drive A: torque"]
    assert torque["unit"] == "N m"
    assert np.array_equal(arrays[torque["values"]], recorded().data("drive", "A")[:, 3].astype(np.float32))
    angle = plots["Link rocker: angle"]
    assert angle["unit"] == "°"
    assert arrays[angle["values"]] == pytest.approx(np.degrees(recorded().data("links", "rocker", "pose")[:, 2]), abs=1e-4)
    force = arrays[plots["Joint B: reaction"]["values"]].reshape(-1, 3)
    assert plots["Joint B: reaction"]["names"] == ["Fx", "Fy", "|F|"]
    assert force[:, 2] == pytest.approx(np.hypot(force[:, 0], force[:, 1]), rel=1e-5)
    assert header["plots"][header["first"][0]]["title"] == "Drive A: torque"
    for p in header["plots"]:
        assert p["unit"] and arrays[p["values"]].size == header["frames"] * len(p["names"])
    polar = plots["Joint B: polar plot of the reaction"]
    assert polar["equal"] and np.array_equal(arrays[polar["x"]], force[:, 0])
    phase = plots["Joint D: phase diagram, velocity against angle"]
    rate = recorded().data("joints", "D", "motion")[:, 1].astype(np.float32)
    assert phase["unit"] == "rad/s" and np.array_equal(arrays[phase["values"]], rate)
    assert "Joint A: phase diagram, velocity against angle" not in plots  # it turns on and on


def test_a_value_that_runs_off_to_infinity_makes_no_other_zero():
    """For a moment the cranks are parallel, and the coupler's instant centre is very far away; all else keeps its numbers."""
    scene = load("crank-rocker").changed({
        ("metrics",): ["instant_centre"],
        ("links",): {
            "frame": {"points": {"A": [0, 0], "D": [200, 0]}}, "crank": {"points": {"A": [0, 0], "B": [100, 0]}},
            "coupler": {"points": {"B": [0, 0], "C": [float(np.hypot(200, 50)), 0], "E": [90, 70]}},
            "rocker": {"points": {"D": [0, 0], "C": [150, 0]}},
        },
        ("joints", "A", "drive"): {"start": 60.000000001, "travel": 60, "speed": "60 rpm"},
    })  # fmt: skip
    run = run_scene(scene, frames=360)
    far = run.catalogue["instant_centre.frame coupler.position"].values()
    assert 1e11 < np.abs(far[180]).max() < np.inf
    page, _ = make_page(presentation_of(run))
    header, arrays = content(page)
    (place,) = (arrays[p["values"]] for p in header["plots"] if p["title"] == "Point coupler.E: position")
    assert place.reshape(-1, 2) == pytest.approx(run.catalogue["point.coupler.E.position"].values(), rel=1e-6)
    assert usual_size(far) < 1e5 and usual_size(np.full((3, 1), np.nan)) == 0.0


def test_plots_have_the_bands_of_tolerances():
    """Of the ram's slide by its closed form; of quantities that share a plot, too."""
    run = run_scene(load("parametric-press"), frames=24)
    page, frames = make_page(presentation_of(run))
    header, arrays = content(page)
    plots = {p["title"]: p for p in header["plots"]}
    q = run.catalogue.coordinate("A")[frames.rows]
    by_stroke = np.abs(np.cos(q) + (16.0 - np.sin(q) ** 2) / np.sqrt(16.0 - np.sin(q) ** 2))
    np.testing.assert_allclose(arrays[plots["Joint S: displacement"]["half"]], 0.05 * by_stroke, rtol=1e-6)
    together = plots["Joint reactions, magnitude"]
    assert len(arrays[together["half"]]) == len(q) * len(together["names"]) and "half" not in plots["Health: closure"]
    by_torque = run.scene.mechanism.drives[0].law(0.0)[1] * arrays[plots["Drive A: torque"]["half"]]
    of_drive = arrays[plots["Power"]["half"]][:: len(plots["Power"]["names"])]
    np.testing.assert_allclose(of_drive, np.abs(by_torque), rtol=1e-6)
    notes = header["notes"]
    assert "<li>stroke: 80 mm ± 0.1 mm</li>" in notes and "Tolerances" not in content(make_page(recorded().shown)[0])[0]["notes"]
    first = header["plots"][header["first"][0]]
    widest = max(arrays[first["half"]]) if len(first["names"]) == 1 else 0.0
    assert f"{first['title']}: at most ± {widest:.3g} {first['unit']}, all tolerances added up" in notes


def test_a_curve_without_any_value_does_not_vary():
    """As of a damaged recording: all rows of a reaction are NaN."""
    nothing = np.full(3, np.nan)
    others = (nothing, [1.0, 1.0, np.nan], [1.0, 2.0, 1.0])
    plots = [Plot("reaction", "N", ("x", "y"), np.column_stack([nothing, y]), "r") for y in others]
    assert [plot.varies for plot in plots] == [False, False, True]


def test_a_recording_has_the_bands_of_its_scene(tmp_path):
    run = run_scene(load("parametric-press"), frames=24)
    write_recording(run, tmp_path / "press.rrd")
    there = presentation_in(Recording(tmp_path / "press.rrd")).bands()
    here = presentation_of(run).bands()
    assert there.halves.keys() == here.halves.keys()
    for key, half in here.halves.items():
        np.testing.assert_allclose(there.halves[key], half, rtol=1e-9, atol=1e-12 * np.nanmax(np.abs(half), initial=1.0))
    assert not presentation_in(recorded().recording).bands().halves  # a scene without tolerances


def test_arrows_are_drawn_where_and_as_long_as_in_the_recording(ten):
    _, frames, header, arrays = ten
    drawn = {(d["group"], d["name"]): d for d in header["drawables"] if d["kind"] == "arrows"}
    arrow = drawn["reaction", "B"]
    origins, vectors = (arrays[arrow[k]].reshape(len(frames.chosen), 2) for k in ("origins", "vectors"))
    scale = recorded().recording.properties["newtons_per_metre"]
    shown = ~np.isnan(origins[:, 0])
    assert shown.sum() > 300
    assert vectors[shown] * scale == pytest.approx(recorded().data("joints", "B", "reaction")[shown, :2], abs=1e-3 * scale)
    assert origins[shown] == pytest.approx(recorded().data("joints", "B", "position")[shown], abs=1e-4)
    groups = {g["name"]: g for g in header["groups"]}
    assert groups["reaction"]["shown"] and not groups["acceleration"]["shown"]
    assert float(groups["reaction"]["value"].split()[0]) == pytest.approx(groups["reaction"]["length"] * scale)


def test_events_and_notes_are_there(ten):
    _, _, header, _ = ten
    assert [e["text"] for e in header["events"]] == [f"{e.item}: {e.text}" for e in recorded().recording.events]
    assert "<h3>Computed</h3>" in header["notes"] and header["learning_goal"].startswith("Kinematics runs outward")


def test_a_long_run_is_thinned_to_a_stated_number_of_frames():
    told: list[tuple[int, int]] = []
    page, frames = make_page(recorded().shown, most=50, progress=lambda done, total: told.append((done, total)))
    assert len({total for _, total in told}) == 1 and told == sorted(told) and told[0][0] == 0 and told[-1][0] == told[-1][1]
    header, arrays = content(page)
    assert len(frames.chosen) == header["frames"] == 50 and header["total"] == 361 == frames.total
    assert frames.chosen[0] == 0 and frames.chosen[-1] == 360 and np.ptp(np.diff(frames.chosen)) <= 1
    crank = arrays[next(k for k in header["links"] if k["name"] == "crank")["pose"]].reshape(-1, 3)
    assert np.array_equal(crank, recorded().data("links", "crank", "pose")[frames.chosen].astype(np.float32))
    kept = make_page(recorded().shown, most=50, keep=float(recorded().time[101]))[1]
    assert 101 in kept.chosen


def test_a_page_of_a_recording_read_in_part_is_that_of_the_whole(tmp_path, monkeypatch):
    monkeypatch.setattr("mechviz.outputs.rerun.writer.BLOCK_FRAMES", 50)  # frames, so that it has many blocks
    # a drive that goes to and fro, and lanes
    path = write_recording(run_scene(mechviz.load("lamp-arm"), frames=240), tmp_path / "a.rrd").path
    whole = Recording(path)
    total = len(whole.rows("data", "links", whole.model["frame"], "pose", component="Scalars:scalars").time)
    part = Recording(path, most=30)
    page, frames = make_page(presentation_in(part), most=30)
    assert (page, frames.total, len(frames.chosen)) == (make_page(presentation_in(whole), most=30)[0], total, 30)
    assert part.events == whole.events and part.entities == whole.entities and part.notes == whole.notes
    for entity in whole.entities:
        if entity.startswith("/state/") and whole.has(entity):
            lanes = [r.rows(entity, component="StateChange:state") for r in (part, whole)]
            assert lanes[0].time.tolist() == lanes[1].time.tolist() and lanes[0].values.tolist() == lanes[1].values.tolist()
    read = part.rows("data", "links", part.model["frame"], "pose", component="Scalars:scalars")
    assert 30 <= len(read.time) <= 30 + -(-total // 50), "those of the page, and the first of each block"
    fewer = make_page(presentation_in(part), most=10)[1]
    every = whole.rows("data", "links", whole.model["frame"], "pose", component="Scalars:scalars").time
    assert len(fewer.chosen) == 10 and np.array_equal(np.round(1e9 * fewer.time), every[fewer.chosen])
    assert Recording(path, most=10_000).frame_times is None, "short enough as it is"


def test_a_page_opens_where_forces_are_large_and_away_from_dead_points(ten):
    _, frames, header, _arrays = ten
    recorded()
    largest = np.max(
        [np.hypot(*recorded().data("joints", j, "reaction")[:, :2].T) for j in recorded().recording.model["joints"]], axis=0
    )
    angle = recorded().shown.catalogue.coordinate("A")[frames.rows]
    assert largest[header["opening"]] > 0.4 * largest.max() and abs(np.sin(angle[header["opening"]])) > 0.3
    assert content(make_page(recorded().shown, plots=False)[0])[0]["opening"] == header["opening"]
    assert content(make_page(made("crank-rocker").shown)[0])[0]["opening"] == FRAMES // 8  # of a turn


def test_no_text_of_a_scene_becomes_markup(tmp_path):
    evil = "</script><script>alert(1)</script><img src=x onerror=alert(2)>"
    scene = mechviz.load("crank-rocker")
    text = scene.text.replace(scene.title, evil)
    assert evil in text
    write_recording(run_scene(mechviz.loads(text), frames=12), tmp_path / "evil.rrd")
    page, _ = make_page(presentation_in(Recording(tmp_path / "evil.rrd")))
    assert "alert(" not in page.split('<script type="module">')[0].replace("&lt;script&gt;alert(1)", "").replace("alert(2)&gt;", "")
    assert page.count("</script>") == 2
    assert "<img" not in content(page)[0]["notes"] and "<script" not in content(page)[0]["notes"]


def test_notes_as_html():
    html = html_of("# A & B\n\nsome **bold** `code`\n\n- one\n- two\n\n| a | b |\n|---|---|\n| 1 | <2> |")
    assert html.split("\n") == [
        "<h2>A &amp; B</h2>", "<p>some <b>bold</b> <code>code</code></p>", "<ul>", "<li>one</li>", "<li>two</li>", "</ul>",
        '<div class="wide"><table>', "<tr><th>a</th><th>b</th></tr>", "<tr><td>1</td><td>&lt;2&gt;</td></tr>", "</table></div>",
    ]  # fmt: skip


def test_parts_of_a_path_are_unescaped():
    from mechviz.outputs.rerun.entities import entity

    parts = ("data", "points", "link B.C centre of mass", "a/b\\c")
    assert parts_of(entity(*parts)) == parts


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    "name", ["stick-slip-feed", "plans-four-bar", "four-forces", "lumped-rod", "polodes-four-bar", "percussion-centre"]
)
def test_pages_of_all_kinds_of_scenes(name):
    header, arrays = content(make_page(made(name, 24).shown)[0])
    low, high = np.array(header["drawn"])
    assert (low < high).all() and all(b <= a for a, b in zip(header["bounds"][0], low, strict=True))
    kinds = {d["group"] for d in header["drawables"]}
    expected = {
        "stick-slip-feed": "friction", "plans-four-bar": "joints", "four-forces": "funicular",
        "lumped-rod": "substitutes", "polodes-four-bar": "polodes",
        "percussion-centre": "percussion",
    }  # fmt: skip
    assert expected[name] in kinds
    constructions = [c["title"] for c in header["constructions"]]
    assert ("Velocity polygon" in constructions) == (name == "plans-four-bar")
    assert ("Force polygon with pole and rays" in constructions) == (name == "four-forces")
    assert bool(header["lanes"]) == (name == "stick-slip-feed")
    for d in [*header["drawables"], *(part for c in header["constructions"] for part in c["parts"])]:
        points = arrays[d["origins" if d["kind"] == "arrows" else "points"]]
        assert np.isfinite(points).any()
        if d["kind"] == "still strips":
            assert sum(d["lengths"]) * 2 == points.size
    if header["lanes"]:
        states = [state for lane in header["lanes"] for _, state, _ in lane["changes"]]
        assert {"sticks", "slips +"} <= set(states)


# --- drawings and notebooks -------------------------------------------------------------------------------------------


def test_a_drawing_shows_every_link_in_its_colour_where_it_is():
    """The outline of the crank in the drawing is that of its solid, moved by its pose and scaled."""
    from xml.etree import ElementTree

    frame = 90
    svg = ElementTree.fromstring(svg_of(recorded().shown, time=float(recorded().time[frame]), width=1000, height=600))
    space = "{http://www.w3.org/2000/svg}"
    paths = [(p.get("fill"), p.get("d")) for p in svg.iter(f"{space}path")]
    header, arrays = content(make_page(recorded().shown, most=2, keep=float(recorded().time[frame]))[0])
    low, high = np.array(header["drawn"])[:, :2]
    scale = 0.94 * min(1000 / (high[0] - low[0]), 600 / (high[1] - low[1]))
    for link in header["links"]:
        vertices = arrays[link["mesh"]["vertices"]].reshape(-1, 3)[:, :2]
        x, y, angle = recorded().data("links", link["name"], "pose")[frame]
        c, s = np.cos(angle), np.sin(angle)
        world = vertices @ np.array([[c, s], [-s, c]]) + [x, y]
        screen = [500, 300] + (world - 0.5 * (low + high)) * scale * [1, -1]
        mine = [d for fill, d in paths if fill.startswith("#") and near(fill, link["mesh"]["palette"])]
        assert mine, link["name"]
        spots = np.array([[float(v) for v in xy.split()] for d in mine for xy in re.findall(r"[\d.-]+ [\d.-]+", d)])
        for corner in (screen.min(axis=0), screen.max(axis=0)):
            assert np.abs(spots - corner).min(axis=0) == pytest.approx([0.0, 0.0], abs=0.2)
    assert {t.text for t in svg.iter(f"{space}text")} >= {"A", "B", "C"}


def test_a_drawing_has_what_is_drawn_on_a_link_where_the_link_is():
    """Of a cam by inversion thirty rollers about it: after seven steps of the cam the eighth is where the roller is."""
    from xml.etree import ElementTree

    scene = load("cam-by-inversion").changed({("effects",): [], ("loads",): {}})
    run = run_scene(scene, frames=30)
    shown = presentation_of(run)
    svg = ElementTree.fromstring(svg_of(shown, time=float(run.motion.time[7]), width=1000, height=600))
    low, high = np.array(content(make_page(shown, most=2)[0])[0]["drawn"])[:, :2]
    scale = 0.94 * min(1000 / (high[0] - low[0]), 600 / (high[1] - low[1]))
    lines = [line.get("points").split() for line in svg.iter("{http://www.w3.org/2000/svg}polyline")]
    strips = [np.array([[float(v) for v in xy.split(",")] for xy in line]) for line in lines]
    boxes = [(0.5 * (s.min(axis=0) + s.max(axis=0)), np.ptp(s, axis=0)) for s in strips]
    rollers = [middle for middle, extent in boxes if extent == pytest.approx(2.0 * 10e-3 * scale, abs=0.4)]
    assert len(rollers) >= 29
    place = [500, 300] + (run.motion.point("follower", "T")[7] - 0.5 * (low + high)) * scale * [1, -1]
    assert min(np.hypot(*(middle - place)) for middle in rollers) < 0.2


def test_a_round_cam_is_drawn_without_holes():
    """All that the eye sees of a barrel cam is in the drawing: its pieces cover the cam's silhouette."""
    barrel = made("cam-barrel")
    header, arrays = content(make_page(barrel.shown, most=2, keep=float(barrel.time[9]))[0])
    low, high = np.array(header["drawn"])[:, :2]
    scale = 0.94 * min(1000 / (high[0] - low[0]), 600 / (high[1] - low[1]))
    cam = next(link for link in header["links"] if "spin" in link)
    frame = int(np.argmin(np.abs(arrays[header["time"]] - barrel.time[9])))
    *shift, qx, qy, qz, qw = arrays[cam["spin"]].reshape(-1, 7)[frame]
    x, y, angle = barrel.data("links", cam["name"], "pose")[9]
    world = turned(arrays[cam["mesh"]["vertices"]].reshape(-1, 3), [qx, qy, qz, qw]) + shift
    flat = (world[:, :2] @ [1.0, 1.0j]) * np.exp(1j * angle) + complex(x, y)
    corners = np.column_stack([flat.real, flat.imag])[arrays[cam["mesh"]["faces"]].reshape(-1, 3)]
    silhouette = shapely.union_all(shapely.polygons(corners))
    mine = []
    svg = svg_of(barrel.shown, time=float(barrel.time[9]), width=1000, height=600)
    for data, fill in re.findall(r'<path d="([^"]*)" fill="(#[^"]*)"', svg):
        if near(fill, cam["mesh"]["palette"]):
            for ring in data.strip("MZ").split("ZM"):
                spots = np.array([[float(v) for v in xy.split()] for xy in ring.split("L")])
                mine.append(shapely.polygons((spots - [500, 300]) / scale * [1, -1] + 0.5 * (low + high)))
    drawn = shapely.union_all(shapely.buffer(mine, 0.2 / scale))
    assert silhouette.difference(drawn).area < 1e-3 * silhouette.area


def near(fill: str, palette: list[str]) -> bool:
    """Whether a colour is one of a palette, lighter or darker."""
    rgb = [np.array([int(c[i : i + 2], 16) for i in (1, 3, 5)], float) for c in (fill, *palette)]
    return any(np.linalg.norm(rgb[0] / rgb[0].sum() - c / c.sum()) < 0.02 for c in rgb[1:])


def test_a_result_shows_itself_in_a_notebook():
    scene = mechviz.load("crank-rocker")
    bundle = mechviz.run(scene, frames=20)._repr_mimebundle_()
    assert set(bundle) == {"text/html", "image/svg+xml", "text/plain"}
    (page,) = re.findall(r'<iframe srcdoc="(.*?)" sandbox="allow-scripts allow-downloads"', bundle["text/html"], flags=re.DOTALL)
    assert content(unescape(page))[0]["title"] == scene.title
    assert bundle["image/svg+xml"].startswith("<svg") and scene.title in bundle["image/svg+xml"]
    assert content(unescape(page))[0]["frames"] == 21


# --- moments ----------------------------------------------------------------------------------------------------------


def test_moments_by_time_frame_and_angle():
    recording, time = recorded().shown, recorded().time
    assert picture_time(recording, frame=7).time == pytest.approx(time[7])
    assert picture_time(recording, at=float(time[9])).time == pytest.approx(time[9])
    assert picture_time(recording, angle=np.radians(90.0)).time == pytest.approx(time[90], abs=1e-6)
    assert picture_time(recording, angle=np.radians(90.5)).time == pytest.approx(0.5 * (time[90] + time[91]), abs=1e-6)
    assert picture_time(recording).time is None
    for wrong, words in (
        ({"frame": 361}, "0 to 360"),
        ({"frame": -1}, "0 to 360"),
        ({"at": 1e3}, "outside"),
        ({"angle": -1.0}, "outside"),
    ):
        with pytest.raises(OutputError, match=words):
            picture_time(recording, **wrong)
    with pytest.raises(OutputError, match="no drive of this mechanism turns"):
        picture_time(made("excavator-arm", 24).shown, angle=1.0)


# --- the commands -----------------------------------------------------------------------------------------------------


def run(*arguments: str):
    return CliRunner().invoke(app, list(arguments))


def test_share_writes_a_page_of_a_recording_without_computing_anything(tmp_path, monkeypatch):
    monkeypatch.setattr("mechviz.commands.shared.solving.run_scene", lambda *a, **k: pytest.fail("it was solved again"))
    path = tmp_path / "page.html"
    result = run("share", str(recorded().path), "-o", str(path), "--most", "100")
    assert result.exit_code == 0 and str(path) in result.output and "100 of 361 frames" in result.output
    assert content(path.read_text(encoding="utf-8"))[0]["title"].startswith("Ten-link train")


def test_share_writes_a_page_of_a_scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run("share", "crank-rocker", "--frames", "30")
    assert result.exit_code == 0 and "31 frames" in result.output
    assert content((tmp_path / "crank-rocker.html").read_text(encoding="utf-8"))[0]["frames"] == 31
    assert sorted(p.name for p in tmp_path.iterdir()) == ["crank-rocker.html"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("share", "crank-roker"), "crank-rocker"),
        (("share", "no.rrd"), "no file 'no.rrd'"),
        (("share", "{ten}", "--frames", "12"), "is a recording"),
        (("shot", "crank-rocker", "-o", "a.jpg"), ".png"),
        (("shot", "crank-rocker", "-o", "a.png", "--view", "below"), "no such view"),
        (("shot", "crank-rocker", "-o", "a.png", "--size", "wide"), "1280x800"),
        (("shot", "crank-rocker", "-o", "a.png", "--size", "20x20"), "from 64"),
        (("shot", "crank-rocker", "-o", "a.png", "--at", "1", "--frame", "2"), "one of them"),
        (("shot", "crank-rocker", "-o", "a.png", "--at", "5 kg"), "--at"),
        (("shot", "crank-rocker", "-o", "a.png", "--angle", "sharp"), "--angle"),
        (("shot", "crank-rocker", "-o", "a.svg", "--view", "iso"), "from the front"),
        (("film", "crank-rocker", "-o", "a.avi"), ".gif or .mp4"),
        (("film", "crank-rocker", "-o", "a.gif", "--rate", "60"), "at most 50 pictures a second"),
    ],
)
def test_wrong_input_is_refused_in_words(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run(*(a.format(ten=recorded().path) for a in arguments))
    assert result.exit_code == 2 and words in result.output and "Traceback" not in result.output
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("rate", [20, 24, 30, 45])
def test_a_gif_takes_its_time_at_any_rate(rate, tmp_path):
    """Its pictures last whole hundredths of a second."""

    def pictures():
        for k in range(2 * rate):
            picture, stream = Image.new("RGB", (8, 8), (k, 0, 0)), io.BytesIO()
            picture.save(stream, "PNG")
            yield stream.getvalue()

    _write_gif(pictures(), tmp_path / "a.gif", gif_durations(2 * rate, rate))
    with Image.open(tmp_path / "a.gif") as image:
        lasted = []
        for k in range(image.n_frames):
            image.seek(k)
            lasted.append(image.info["duration"])
    assert sum(lasted) == 2000 and max(lasted) - min(lasted) <= 10 < min(lasted)


def test_a_drawing_needs_no_browser(tmp_path, monkeypatch):
    monkeypatch.setenv("MECHVIZ_CHROMIUM", "no-such-browser")
    path = tmp_path / "a.svg"
    result = run("shot", str(recorded().path), "-o", str(path), "--frame", "12", "--size", "640x400", "--dark")
    assert result.exit_code == 0 and 'width="640" height="400"' in path.read_text(encoding="utf-8")


class Bars:
    """Stands in for bars: what they were told, in order."""

    def __init__(self) -> None:
        self.told: list[str] = []

    @contextlib.contextmanager
    def bar(self, label: str):
        self.told.append(label)
        yield Bar(label, self.update)

    def update(self, description: str = "", completed: int = 0, total: int | None = None) -> None:
        self.told.append(description if total is None else f"{100 * completed // total} %")


def test_long_work_says_what_it_does_from_its_start_to_its_end(tmp_path, monkeypatch):
    bars = Bars()
    for place in ("shared.solving", "export", "recording"):
        monkeypatch.setattr(f"mechviz.commands.{place}.progress_bar", bars.bar)
    monkeypatch.setattr("mechviz.runs.estimate_errors", lambda run: bars.told.append("estimating") or estimate_errors(run))
    for command, wanted in (
        (("share", "crank-rocker", "-o", str(tmp_path / "a.html")), "sharing"),
        (("shot", "crank-rocker", "-o", str(tmp_path / "a.svg")), "drawing"),
        (("export", "crank-rocker", "--glb", str(tmp_path / "a.glb")), "exporting a.glb"),
        (("record", "crank-rocker", "-o", str(tmp_path / "a.rrd")), "recording"),
    ):
        bars.told.clear()
        assert run(*command, "--frames", "24").exit_code == 0
        assert bars.told[:2] == ["solving", "solving: compile"] and "solving: positions" in bars.told
        assert wanted in bars.told
        stages = [t for t in bars.told if t.startswith(("recording: ", "building: "))]
        if wanted == "recording":
            assert stages[0] == "recording: error estimates" and stages[-1] == "recording: writing"
            assert bars.told[bars.told.index("estimating") - 1] == stages[0]  # they are billed where they are made
            assert "recording: solid meshes" in stages
        elif wanted != "exporting a.glb":
            assert stages == ["building: solid meshes", "building: tables, arrows and events"]
        if wanted != "exporting a.glb":
            numbers = [int(t.removesuffix(" %")) for t in bars.told[bars.told.index(wanted) :] if t.endswith("%")]
            assert numbers == sorted(numbers) and numbers[-1] > 90 and (wanted == "recording" or numbers[0] == 0)


def test_a_bar_is_drawn_on_a_terminal_only(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    for stream in (Terminal(), io.StringIO()):
        monkeypatch.setattr(sys, "stderr", stream)
        with progress_bar("making [a] cake") as bar:
            bar.stage("oven")
            bar(1, 4)
        if stream.isatty():
            assert "making [a] cake: oven" in stream.getvalue() and "25%" in stream.getvalue()
        else:
            assert stream.getvalue() == ""


def test_where_there_is_no_terminal_long_work_says_now_and_then_how_far_it_is(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("mechviz.progress.time.monotonic", lambda: now[0])
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with progress_bar("making cake") as bar:
        for seconds, done in ((10, 1), (40, 4), (60, 6), (80, 8)):
            now[0] = seconds
            bar(done, 100)
        bar.stage("oven")
        now[0] = 7400.0
        bar.stage("icing")
        now[0] = 14600.0
        bar(1, 100)
    lines = ["making cake, 4 %, about 16 min left", "making cake, 8 %, about 15 min left", "making cake: icing"]
    assert sys.stderr.getvalue().splitlines() == [*lines, "making cake: icing, 1 %, about 198 h left"]


class Notebook(types.ModuleType):
    """As much of IPython as shows a line that changes, with a run in it."""

    def __init__(self) -> None:
        super().__init__("IPython")
        self.shown: list[str] = []
        self.display = types.SimpleNamespace(display=self.show)

    def get_ipython(self) -> object:
        return types.SimpleNamespace(kernel=None)

    def show(self, bundle: dict[str, str], raw: bool, display_id: bool = False) -> Notebook:
        self.shown.append(bundle["text/plain"])
        return self

    def update(self, bundle: dict[str, str], raw: bool) -> None:
        self.shown.append(bundle["text/plain"])


def test_a_long_run_in_python_shows_how_far_it_is(monkeypatch, capsys):
    notebook = Notebook()
    monkeypatch.setitem(sys.modules, "IPython", notebook)
    mechviz.run("swinging-double-pendulum", frames=12)
    assert notebook.shown == []  # it is quick
    monkeypatch.setattr("mechviz.facade.LONG_RUN", 0.0)
    mechviz.run("swinging-double-pendulum", frames=12)
    assert notebook.shown[0] == "solving swinging-double-pendulum" and notebook.shown[-1] == ""
    assert "solving swinging-double-pendulum: motion under forces" in notebook.shown
    shown = len(notebook.shown)
    mechviz.run("swinging-double-pendulum", frames=12, progress=False)
    assert len(notebook.shown) == shown
    monkeypatch.delitem(sys.modules, "IPython")
    mechviz.run("swinging-double-pendulum", frames=12)
    assert len(notebook.shown) == shown and capsys.readouterr() == ("", "")


FFMPEG = """#!{python}
import os, sys
with open({pid!r}, "w") as file:
    file.write(str(os.getpid()))
if {broken!r}:
    print("Unknown encoder 'libx264'", file=sys.stderr)
    sys.exit(1)
data = sys.stdin.buffer.read()
with open(sys.argv[-1], "wb") as file:
    file.write(b"%d" % data.count(bytes([137]) + b"PNG"))
"""


@pytest.mark.parametrize("fate", ["well", "broken", "interrupted"])
def test_a_film_as_mp4_is_handed_to_ffmpeg_picture_by_picture(tmp_path, monkeypatch, fate):
    """A program in place of ffmpeg counts the pictures; what fails or is interrupted leaves no file and no process."""
    program, pid, folder = tmp_path / "ffmpeg", tmp_path / "pid", tmp_path / "films"
    program.write_text(FFMPEG.format(python=sys.executable, pid=str(pid), broken=fate == "broken"))
    program.chmod(0o755)
    folder.mkdir()
    monkeypatch.setattr("mechviz.outputs.images.pictures.find_ffmpeg", lambda: str(program))
    buffer = io.BytesIO()
    Image.new("RGB", (8, 6)).save(buffer, "PNG")

    @contextlib.contextmanager
    def stage(*_: object, **__: object):
        yield lambda time: buffer.getvalue()

    monkeypatch.setattr("mechviz.outputs.images.pictures._stage", stage)

    def progress(done: int, total: int) -> None:
        if fate == "interrupted" and done == 3:
            while not pid.exists() or not pid.read_text():  # it has begun
                time.sleep(0.01)
            raise KeyboardInterrupt

    def make() -> Path:
        return film(recorded().shown, folder / "a.mp4", Look(8, 6), seconds=1.0, rate=12, progress=progress)

    if fate == "well":
        assert make().read_text() == "12"
    elif fate == "broken":
        with pytest.raises(OutputError, match="Unknown encoder 'libx264'"):
            make()
    else:
        with pytest.raises(KeyboardInterrupt):
            make()
    assert [p.name for p in folder.iterdir()] == (["a.mp4"] if fate == "well" else [])
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid.read_text()), 0)


def test_what_is_missing_is_named_with_the_remedy(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MECHVIZ_CHROMIUM", "no-such-browser")
    result = run("shot", "crank-rocker", "-o", "a.png")
    assert result.exit_code == 1 and "apt-get install chromium" in result.output
    monkeypatch.setenv("MECHVIZ_CHROMIUM", "true")  # a program, but no browser
    result = run("shot", "crank-rocker", "-o", "a.png", "--frames", "12")
    assert result.exit_code == 1 and "could not be started" in result.output
    monkeypatch.setattr("shutil.which", lambda name: None if name == "ffmpeg" else "/bin/true")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)  # as if it were not installed
    result = run("film", "crank-rocker", "-o", "a.mp4")
    assert result.exit_code == 1 and "apt-get install ffmpeg" in result.output
    result = run("share", "crank-rocker", "-o", str(tmp_path / "nowhere" / "a.html"))
    assert result.exit_code == 2 and "does not exist" in result.output
    assert not list(tmp_path.iterdir())


def test_a_page_opens_with_plots_of_what_moves():
    """The body of the walking toy is welded to the frame: its joint has no motion to show."""
    header, _ = content(make_page(presentation_of(run_scene(load("walking-toy"), frames=12)))[0])
    titles = [header["plots"][k]["title"] for k in header["first"]]
    assert len(titles) > 1 and not any(title.startswith("Joint M") for title in titles)
