"""Exports of cams and solids from the command line: drawings, tables, 3MF; what a cutter leaves is told."""

from __future__ import annotations

import xml.etree.ElementTree as ET
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

import mechviz
from mechcore.forces.cam_rating import placed_cams
from mechviz.commands.main import app
from mechviz.outputs.exports.cam_profiles import cam_outlines
from mechviz.picture.build import solids_of
from mechviz.runs import run_scene
from mechviz.scene.kinds.cam_files import read_dxf

CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"


def run(*arguments: str):
    return CliRunner().invoke(app, ["export", *arguments])


def test_profiles_from_the_command_line(tmp_path):
    """The drawing is one closed outline in millimetres; the SVG has its size; the table has the columns that it names."""
    files = {key: tmp_path / f"cam.{key}" for key in ("dxf", "svg", "csv")}
    done = run(
        "cam-roller", "--dxf", str(files["dxf"]), "--svg", str(files["svg"]), "--profile", str(files["csv"]), "--frames", "12"
    )
    assert done.exit_code == 0, done.output
    assert done.stdout.split() == [str(files[key]) for key in ("dxf", "svg", "csv")] and not done.stderr
    z, bulges, unit = read_dxf(files["dxf"].read_bytes())
    assert unit == 1e-3 and np.abs(bulges).max() > 0.0
    assert np.abs(z).min() == pytest.approx(40.0, abs=1e-6), "the base circle"
    root = ET.fromstring(files["svg"].read_text())
    assert root.get("width").endswith("mm") and float(root.get("width")[:-2]) == pytest.approx(np.ptp(z.real) + 10.0, abs=0.1)
    head, *rows = files["csv"].read_text().splitlines()
    assert head.startswith("curve,cam [rad or m],x [mm],y [mm],nx,ny") and len(rows) > 360


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("cam-barrel", ["roller path", "lower flank", "upper flank"]),
        ("cam-barrel-rib", ["lower flank", "upper flank"]),
        ("cam-barrel-arm", ["roller path", "lower flank", "upper flank"]),
        ("cam-end", ["outer edge", "inner edge"]),
    ],
)
def test_developments_rolled_up_again_touch_the_roller(name, lines):
    """Each point, put back on its cylinder: as far from the roller's axis as its radius at its own angle, nowhere nearer."""
    motion = run_scene(mechviz.load(name), frames=12).motion
    (cam,) = placed_cams(motion)
    outlines = cam_outlines(SimpleNamespace(motion=motion))
    assert [o.name for o in outlines] == [f"K {line}" for line in lines]
    own, radius = cam.cam, cam.cam.radius
    all_angles = own.law.start + own.law.length * np.linspace(0.0, 1.0, 721)
    for o in outlines:
        points, tangents, theta = (np.concatenate([run[k] for run in o.runs]) for k in (0, 1, 3))
        if "path" in o.name:
            at = own.flank(theta, [0.0], 1).axis_point[:, 0]
            np.testing.assert_allclose(points.imag, 1e3 * at[:, 2], atol=1e-9)
            assert o.centre_line
            continue
        assert np.ptp(points.real) == pytest.approx(2.0 * np.pi * o.cylinder, abs=1e-6)
        azimuth = points.real / o.cylinder
        p = 1e-3 * np.column_stack([o.cylinder * np.cos(azimuth), o.cylinder * np.sin(azimuth), points.imag])
        shift = {"lower": -1.0, "upper": 1.0}.get(o.name.split()[1], 0.0) if "rib" in name else 0.0
        shift *= 0.5 * cam.blank.thickness + radius

        def to_axis(angle, p=p, shift=shift):
            a, b = own.flank(angle, [0.0, 1.0], 1).axis_point.transpose(1, 0, 2)
            away = p[:, None] - a - [0.0, 0.0, shift]
            along = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
            beyond = (away * along).sum(axis=2) < 0.0  # behind the cam's axis
            return np.where(beyond, np.inf, np.linalg.norm(np.cross(away, along), axis=2))

        np.testing.assert_allclose(np.diag(to_axis(theta)), radius, rtol=1e-9)
        assert to_axis(all_angles).min() > radius * (1.0 - 1e-9)
        for z, t, rho, _ in o.runs:  # curvature by circles through three neighbours, in the middle of each smooth part
            k = len(z) // 3
            a, b, c = z[k - 1 : k + 2]
            circle = 2.0 * np.imag(np.conj(b - a) * (c - a)) / (abs(a - b) * abs(b - c) * abs(c - a))
            assert 1.0 / rho[k] == pytest.approx(circle, rel=0.02, abs=1e-9)
            assert abs(np.angle((c - a) / t[k])) < 1e-3
        assert np.abs(tangents) == pytest.approx(np.ones(len(tangents)))
        below = "lower" in o.name or "edge" in o.name
        if "rib" in name:
            below = not below  # the rib's material lies between its flanks
        assert (points[-1].real < points[0].real) == below, "material to the left"


def test_developments_as_files(tmp_path):
    done = run("cam-barrel", "--dxf", str(tmp_path / "d.dxf"), "--svg", str(tmp_path / "d.svg"), "--frames", "12")
    assert done.exit_code == 0, done.output
    text = (tmp_path / "d.dxf").read_text()
    assert text.count("\nLWPOLYLINE\n") == 3 and "unrolled from a cylinder of radius 45 mm" in text and "\nPOINT\n" not in text
    width = ET.fromstring((tmp_path / "d.svg").read_text()).get("width")
    assert float(width[:-2]) == pytest.approx(2.0 * np.pi * 45.0 + 10.0, abs=0.2)
    for name in ("cam-globoid", "cam-indexing-barrel"):
        done = run(name, "--dxf", str(tmp_path / "g.dxf"), "--frames", "12")
        assert done.exit_code == 2 and "globoids and indexing cams are not developed" in done.stderr


def test_what_the_cutter_leaves_is_told(tmp_path):
    done = run("cam-undercut", "--dxf", str(tmp_path / "left.dxf"), "--frames", "12")
    assert done.exit_code == 0
    assert done.stderr.count("what the cutter leaves") == 2 and "0.6398 mm" in done.stderr


def test_scenes_without_a_cam_have_no_profile(tmp_path):
    done = run("crank-rocker", "--dxf", str(tmp_path / "none.dxf"), "--frames", "12")
    assert done.exit_code == 2 and "has no cam" in done.stderr and not (tmp_path / "none.dxf").exists()
    assert run("crank-rocker").exit_code == 2


@pytest.mark.parametrize("name", ["cam-roller", "cam-barrel"])
def test_solids_as_3mf(tmp_path, name):
    """Objects, triangles and places are those of the solids, in millimetres, and the same run gives the same file. What is
    fixed to a link, bars of the ground and seats of springs, follows its own solid."""
    first, second = tmp_path / "a.3mf", tmp_path / "b.3mf"
    for path in (first, second):
        done = run(name, "--3mf", str(path), "--frames", "12")
        assert done.exit_code == 0, done.output
    assert first.read_bytes() == second.read_bytes()
    with zipfile.ZipFile(first) as archive:
        assert set(archive.namelist()) == {"[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"}
        model = ET.fromstring(archive.read("3D/3dmodel.model"))
    assert model.get("unit") == "millimeter"
    solved = mechviz.runs.run_scene(mechviz.load(name), frames=12)
    solids = solids_of(solved)
    objects = {o.get("name"): o for o in model.iter(f"{CORE}object")}
    assert set(objects) == set(solids.links)
    items = {i.get("objectid"): [float(v) for v in i.get("transform").split()] for i in model.iter(f"{CORE}item")}
    for link, entry in objects.items():
        points = np.array([[float(v.get(k)) for k in "xyz"] for v in entry.iter(f"{CORE}vertex")])
        faces = np.array([[int(t.get(f"v{k}")) for k in (1, 2, 3)] for t in entry.iter(f"{CORE}triangle")])
        mesh = trimesh.Trimesh(points, faces, process=False)
        own = solids.links[link].mesh
        np.testing.assert_allclose(points[: len(own.vertices)], 1e3 * own.vertices, atol=1e-5)
        assert mesh.is_watertight and mesh.volume > 0.999999e9 * own.volume
        assert len(points) > len(own.vertices) or mesh.volume == pytest.approx(1e9 * own.volume, rel=1e-6)
        assert link != "cam" or len(points) == len(own.vertices)
        x, y, _ = solved.motion.pose(link)[0]
        np.testing.assert_allclose(items[entry.get("id")][9:], [1e3 * x, 1e3 * y, 0.0], atol=1e-6)
