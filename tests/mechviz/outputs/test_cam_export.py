"""Profiles of cams as files: arcs on the exact curve, units, crossings refused."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace

import ezdxf
import numpy as np
import pytest
from ezdxf import recover
from shapely.geometry import LineString, Point

import mechviz
from mechviz.files import OutputError
from mechviz.outputs.exports import cam_profiles as cam_export
from mechviz.outputs.exports.cam_profiles import _chain, biarcs, cam_outlines, dxf_text, export_profiles, profile_csv, svg_text
from mechviz.runs import run_scene

SCENES = ["cam-roller", "cam-knife", "cam-flat", "cam-groove", "cam-wedge", "cam-oscillating-flat"]


@pytest.fixture(scope="module")
def outlines():
    return {name: cam_outlines(run_scene(mechviz.load(name), frames=8)) for name in SCENES}


def test_biarcs_are_exact_on_circles_and_lines():
    t = np.linspace(0.0, 2.0, 6)
    z, bulges = biarcs(3.0 * np.exp(1j * t), 1j * np.exp(1j * t))
    np.testing.assert_allclose(np.abs(z), 3.0, rtol=1e-14)
    np.testing.assert_allclose(bulges, np.tan(0.2 / 4.0), rtol=1e-12)
    z, bulges = biarcs(np.array([0j, 2.0 + 1j]), np.full(2, (2.0 + 1j) / np.sqrt(5.0)))
    np.testing.assert_allclose(z[1], 1.0 + 0.5j)
    np.testing.assert_allclose(bulges, 0.0, atol=1e-15)


@pytest.mark.parametrize("name", SCENES)
def test_arcs_lie_on_the_profile_and_join_smoothly(name, outlines, monkeypatch):
    coarse = outlines[name]
    monkeypatch.setattr(cam_export, "POINT_SPACING", 0.05)
    fine = cam_outlines(run_scene(mechviz.load(name), frames=8))
    assert [o.name for o in coarse] == ["K", "K outer flank"][: len(coarse)]
    for rough, exact in zip(coarse, fine, strict=True):
        z, bulges = _chain(rough)
        ends = np.append(z[1:], z[0]) if rough.closed else z[1:]
        starts, bulges = (z, bulges) if rough.closed else (z[:-1], bulges[:-1])
        middles = 0.5 * (starts + ends) - 0.5j * (ends - starts) * bulges
        curve = LineString(np.column_stack([p := exact.points, p]).view(float).reshape(-1, 4)[:, :2])
        off = max(curve.distance(Point(m.real, m.imag)) for m in middles[::5])
        assert off < (2e-3 if name == "cam-wedge" else 2e-4)  # mm
        lean = 2.0 * np.arctan(bulges)
        leaving, arriving = np.angle(ends - starts) - lean, np.angle(ends - starts) + lean
        turn = np.angle(np.exp(1j * (np.roll(leaving, -1) - arriving)))
        assert np.abs(turn if rough.closed else turn[:-1]).max() < 1e-6


def test_dxf_says_its_units_and_holds_every_vertex(outlines):
    text = dxf_text(outlines["cam-groove"])
    drawing = ezdxf.read(io.StringIO(text))
    audit = drawing.audit()
    assert not audit.errors and not audit.fixes
    assert drawing.units == 4 and drawing.header["$MEASUREMENT"] == 1, "millimetres"
    sheet = drawing.modelspace()
    assert len(sheet) == 3 and [e.dxf.layer for e in sheet.query("POINT")] == ["CENTRE"]
    for line, outline in zip(sheet.query("LWPOLYLINE"), outlines["cam-groove"], strict=True):
        x, y, bulges = np.array(line.get_points("xyb")).T
        assert line.closed and line.dxf.layer == "PROFILE"
        assert np.array_equal(x + 1j * y, _chain(outline)[0]) and np.array_equal(bulges, _chain(outline)[1])
    assert dxf_text(outlines["cam-groove"]) == text


def test_cams_on_one_shaft_have_layers_of_their_own_in_a_dxf(outlines):
    pair = [replace(outlines["cam-roller"][0], cam=name) for name in ("X", "a/b")]
    sheet = ezdxf.read(io.StringIO(dxf_text(pair))).modelspace()
    assert [line.dxf.layer for line in sheet.query("LWPOLYLINE")] == ["PROFILE X", "PROFILE a_b"]
    assert len(sheet.query("POINT")) == 1


def test_svg_is_true_to_scale(outlines):
    text = svg_text(outlines["cam-roller"])
    width, unit = re.search(r'width="([\d.]+)(mm)"', text).groups()
    low, high = (f(o.points.real) for f, o in ((min, outlines["cam-roller"][0]), (max, outlines["cam-roller"][0])))
    assert unit == "mm" and float(width) == pytest.approx(high - low + 10.0)
    assert text.count(" A ") > 400


def test_csv_has_normals_and_curvature(outlines):
    lines = profile_csv(outlines["cam-roller"]).split("\r\n")
    assert lines[0] == "curve,cam [rad or m],x [mm],y [mm],nx,ny,radius of curvature [mm]"
    rows = np.array([[float(v) for v in line.split(",")[1:]] for line in lines[1:-1]])
    base = np.hypot(rows[:, 1], rows[:, 2]) < 40.0 + 1e-9
    np.testing.assert_allclose(rows[base, 1:3] / 40.0, rows[base, 3:5], atol=1e-6)
    assert base.sum() > 60
    run = run_scene(mechviz.load("cam-roller"), frames=8)
    cam = next(r.geometry for r in run.motion.model.relations if r.name == "K")
    s = cam.cam.at(rows[:, 0], side="left")
    inner = np.min(np.abs(rows[:, :1] - cam.cam.law.knots), axis=1) > 1e-9  # at the knots it may jump
    np.testing.assert_allclose(rows[inner, 5], 1e3 * s.radius[inner], rtol=1e-8)


@pytest.mark.parametrize("name", ["cam-eccentric", "cam-tangent", "cam-polynomial", "cam-drawing"])
def test_points_of_given_profiles_are_as_near_as_those_of_laws(name):
    """The way turns by a degree at the most between them, and they go on by one about the axis; so a chord keeps to the curve."""
    (outline,) = cam_outlines(run_scene(mechviz.load(name), frames=8))
    for z, tangents, _, _ in outline.runs:
        for v in (tangents, z - outline.centre):
            assert np.degrees(np.abs(np.angle(v[1:] / v[:-1]))).max() <= 1.0 + 1e-9
        sag = np.abs(np.diff(z)) * np.abs(np.angle(tangents[1:] / tangents[:-1])) / 8.0
        assert sag.max() < 4e-5 * np.abs(z).max() and len(z) < 1000


def test_crossing_profiles_are_refused(outlines, monkeypatch):
    (outline,) = outlines["cam-roller"]
    z = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 90))
    eight = replace(outline, runs=((z.real + 1j * z.imag * z.real, z, z.real, z.real),))
    monkeypatch.setattr(cam_export, "_profile", lambda cam: eight)
    with pytest.raises(OutputError, match="'K' crosses itself"):
        cam_outlines(run_scene(mechviz.load("cam-roller"), frames=8))


def test_files_and_scenes_without_cams(tmp_path):
    run = run_scene(mechviz.load("cam-roller"), frames=8)
    for kind in ("dxf", "svg", "csv"):
        assert export_profiles(run, tmp_path / f"cam.{kind}", kind).stat().st_size > 10_000
    with pytest.raises(OutputError, match="no cam"):
        export_profiles(run_scene(mechviz.load("crank-rocker"), frames=8), tmp_path / "x.dxf", "dxf")
    assert not (tmp_path / "x.dxf").exists()


@pytest.mark.parametrize("way", ["along = [1, 0]", "along = [-1, 0]"])
@pytest.mark.parametrize("name", ["cam-wedge", "cam-groove"])
def test_both_flanks_of_a_groove_face_each_other_across_its_roller(name, way):
    """Of a wedge, too, whichever way it moves; at the coordinates of the cam that the table states."""
    scene = mechviz.load(name)
    if name == "cam-wedge":
        scene = mechviz.loads(
            scene.source.replace("follower = { roller", 'closure = "form"\nfollower = { roller').replace("along = [1, 0]", way)
        )
    elif way != "along = [1, 0]":
        scene = scene.changed({("joints", "K", "profile", "sense"): "cw"})
    run = run_scene(scene, frames=8)
    radius = 1e3 * next(p for p in run.motion.mechanism.joints if p.name == "K").face.radius
    flanks: dict[str, dict[float, tuple[complex, complex]]] = {}
    for row in csv.reader(profile_csv(cam_outlines(run)).splitlines()[1:]):
        x, y, nx, ny = map(float, row[2:6])
        flanks.setdefault(row[0], {})[round(float(row[1]), 9)] = complex(x, y), complex(nx, ny)
    near, far = flanks["K"], flanks["K outer flank"]
    law = next(p for p in run.motion.mechanism.joints if p.name == "K").lift
    assert set(near) == set(far) and min(near) == 0.0 and max(near) == pytest.approx(law.length)
    for place, (point, normal) in near.items():
        other, facing = far[place]
        assert abs(normal + facing) < 1e-6 and abs(other - point - 2.0 * radius * normal) < 1e-5


def test_names_in_a_dxf_are_read_as_they_are(outlines, tmp_path):
    """Release 2004 is read by a code page, not as UTF-8; names of layers that differ in case only are one."""
    (outline,) = outlines["cam-roller"]
    text = dxf_text([replace(outline, cam=cam) for cam in ("Kurventräger 曲", "kurventräger 曲", "a,b", "a;b")])
    (tmp_path / "cams.dxf").write_text(text, encoding="utf-8", newline="")
    drawing, _ = recover.readfile(tmp_path / "cams.dxf")
    layers = [line.dxf.layer for line in drawing.modelspace().query("LWPOLYLINE")]
    assert layers == ["PROFILE Kurventräger 曲", "PROFILE kurventräger 曲 2", "PROFILE a_b", "PROFILE a_b 2"]
