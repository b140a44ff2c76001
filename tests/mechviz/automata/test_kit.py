"""Kits of flat parts: plates, pins and spacers fit together with the stated clearance, and lie apart on their sheet."""

from __future__ import annotations

import resource
import zipfile
from dataclasses import replace
from io import StringIO
from xml.etree import ElementTree

import numpy as np
import pytest
from shapely import affinity

from mechcore.errors import MechanismError
from mechviz.files import OutputError
from mechviz.meshes.kit import kit_of, laid_out
from mechviz.outputs.exports.solids import export_kit, export_stl, parts_dxf
from mechviz.picture.build import collision_poses
from mechviz.runs import run_scene
from mechviz.scene.scene import load

THICK, PLAY, WASHER = 4.0, 0.3, 1.5
MODEL = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"


@pytest.fixture(scope="module")
def bird():
    return run_scene(load("pecking-bird"))


@pytest.fixture(scope="module")
def parts(bird):
    return kit_of(bird.motion.mechanism, collision_poses(bird), THICK, PLAY, WASHER)


def test_holes_are_pins_with_the_clearance(parts):
    """Every pin is fast in one of the links that it joins, and turns in the others; what is welded is glued."""
    (pin,) = {round(0.5 * np.ptp(part.outline.bounds[::2]), 6) for part in parts if part.kind == "pin"}
    plates = {part.name: part for part in parts if part.kind == "plate"}
    assert {"base", "crank", "rod", "body", "neck", "stay", "eye", "beak", "meadow", "stump"} == set(plates)
    radii = sorted(r for part in plates.values() for *_, r in part.circles)
    assert np.allclose(radii, [pin] * 7 + [pin + 0.5 * PLAY] * 7, atol=1e-3)  # seven joints of two links each
    assert all(r == pytest.approx(pin + 0.5 * PLAY, abs=1e-3) for part in parts if part.kind == "spacer" for *_, r in part.circles)


def test_holes_lie_where_the_joints_are(bird, parts):
    links = {link.name: link for link in bird.motion.mechanism.links}
    for part in (p for p in parts if p.kind == "plate" and p.name != "base"):
        own = np.array(list(links[part.name].points.values()))
        for x, y, _ in part.circles:
            assert np.hypot(*(1e3 * own - (x, y)).T).min() < 1e-6


def test_pins_are_as_long_as_what_they_join(parts):
    """A pin through plates d layers apart is d (thickness + washer) + thickness long; its spacers fill what is between them."""
    pins = [part for part in parts if part.kind == "pin" for _ in range(part.count)]
    spacers = [part for part in parts if part.kind == "spacer" for _ in range(part.count)]
    layers = [(part.thickness - THICK) / (THICK + WASHER) for part in pins]
    assert np.allclose(layers, np.round(layers)) and min(layers) >= 1.0 and len(pins) == 7
    assert sum(p.thickness - 2.0 * THICK for p in pins) == pytest.approx(sum(s.thickness for s in spacers))


def test_the_sheet_says_how_thick_each_plate_is(tmp_path):
    """The cheeks of a fork are thinner than the plates beside them."""
    import ezdxf

    paths = {
        path.name: path for path in export_kit(run_scene(load("cam-drawing"), frames=12), tmp_path / "kit", THICK, PLAY, WASHER)
    }
    sheet = ezdxf.read(StringIO(paths["plates.dxf"].read_text())).modelspace()
    names = [text.dxf.text for text in sheet.query("TEXT")]
    listed = [line.rsplit(",", 5) for line in paths["parts.csv"].read_text().splitlines()[1:]]
    plates = [f"{name[1:-1]}, {thick} mm" for name, kind, _, thick, *_ in listed if kind == "plate"]
    assert sorted(names) == sorted(plates) and sum(name.endswith(f", {0.22 * THICK:.6g} mm") for name in names) == 2
    assert all(f">{name}</text>" in paths["plates.svg"].read_text() for name in names)


def test_names_on_the_sheet_are_read_as_they_are(parts, tmp_path):
    """A DXF of this release is read by a code page, not as UTF-8."""
    from ezdxf import recover

    plate = next(part for part in parts if part.kind == "plate")
    sheet = parts_dxf([(replace(plate, name="Kürbel 曲柄"), 0.0, 0.0)])
    (tmp_path / "plates.dxf").write_text(sheet, encoding="utf-8", newline="")
    (text,) = recover.readfile(tmp_path / "plates.dxf")[0].modelspace().query("TEXT")
    assert text.dxf.text == f"Kürbel 曲柄, {plate.thickness:.6g} mm"


def test_parts_lie_apart(parts):
    placed = laid_out(parts, 150.0)
    shapes = [affinity.translate(part.outline, x, y) for part, x, y in placed]
    assert len(placed) == sum(part.count for part in parts)
    assert all(not a.intersects(b) for k, a in enumerate(shapes) for b in shapes[:k])
    assert min(s.bounds[0] for s in shapes) > -1e-9 and min(s.bounds[1] for s in shapes) > -1e-9


@pytest.mark.parametrize(("scene", "turning"), [("waving-figure", ("crank", "shaft")), ("theatre", ("mill", "sails"))])
def test_what_is_welded_on_a_shaft_turns_with_it(scene, turning):
    run = run_scene(load(scene))
    kit = kit_of(run.motion.mechanism, collision_poses(run), THICK, PLAY, WASHER)
    shafts = [part.outline.exterior.length for part in kit if part.name.startswith("shaft") and part.kind == "pin"]
    for name in turning:
        plate = next(part for part in kit if part.name == name)
        assert all(x or y for x, y, _ in plate.circles), "no round hole on the shaft"
        assert any(abs(ring.length - shaft) < 1e-4 for ring in plate.outline.interiors for shaft in shafts)


def test_the_files_hold_the_parts(bird, parts, tmp_path):
    import ezdxf
    import trimesh

    paths = {path.name: path for path in export_kit(bird, tmp_path / "kit", THICK, PLAY, WASHER)}
    drawing = ezdxf.read(StringIO(paths["plates.dxf"].read_text()))
    circles = sorted(e.dxf.radius for e in drawing.modelspace().query("CIRCLE"))
    assert circles == pytest.approx(sorted(r for part in parts if part.kind == "plate" for *_, r in part.circles))
    with zipfile.ZipFile(paths["kit.3mf"]) as archive:
        root = ElementTree.fromstring(archive.read("3D/3dmodel.model"))
    volumes = {}
    for body in root.iter(f"{MODEL}object"):
        points = [[float(v.get(axis)) for axis in "xyz"] for v in body.iter(f"{MODEL}vertex")]
        faces = [[int(t.get(f"v{k}")) for k in (1, 2, 3)] for t in body.iter(f"{MODEL}triangle")]
        mesh = trimesh.Trimesh(points, faces)
        assert mesh.is_watertight and mesh.bounds[0][2] == 0.0
        volumes[body.get("name")] = mesh.volume
    for part in parts:
        if part.kind == "plate":
            assert volumes[part.name] == pytest.approx(part.outline.area * THICK, rel=1e-6)
    assert len(list(root.iter(f"{MODEL}item"))) == sum(part.count for part in parts)
    assert paths["parts.csv"].read_text().count("\n") == len(parts) + 1 and 'stroke="red"' in paths["plates.svg"].read_text()


@pytest.mark.parametrize("write", [lambda run, folder: export_kit(run, folder, THICK, PLAY, WASHER), export_stl])
def test_where_not_all_files_can_be_written_none_is(write, bird, tmp_path):
    """Under a limit for files that the smallest ones keep: what was there stays as it is, a new folder goes again."""
    there = write(bird, tmp_path / "kit")
    before = {path.name: path.read_bytes() for path in there}
    sizes = sorted(map(len, before.values()))
    for path in there:
        path.write_bytes(b"mine")
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    for folder in (tmp_path / "kit", tmp_path / "new" / "kit"):
        resource.setrlimit(resource.RLIMIT_FSIZE, (sizes[-1] - 1, usual[1]))
        try:
            with pytest.raises(OutputError, match="larger than the limit for files"):
                write(bird, folder)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, usual)
    assert [path.name for path in tmp_path.iterdir()] == ["kit"]
    assert {path.name: path.read_bytes() for path in (tmp_path / "kit").iterdir()} == dict.fromkeys(before, b"mine")


def test_rollers_turn_on_pins_of_their_own():
    """In the lever the pin is fast, the roller beside it turns on it; the cheeks of a fork hold one."""
    run = run_scene(load("waving-figure"))
    kit = kit_of(run.motion.mechanism, collision_poses(run), THICK, PLAY, WASHER)
    pin = 0.5 * 0.6 * 8.0  # mm, of rollers with a radius of 8 mm
    lever = [r for p in kit if p.name.startswith("lever") for x, y, r in p.circles if (round(x), round(y)) == (90, 0)]
    fork = [r for p in kit if p.name.startswith("head") for *_, r in p.circles]
    assert sorted(lever) == pytest.approx([pin, pin + 0.5 * PLAY])
    assert sorted(fork) == pytest.approx([pin, pin, pin + 0.5 * PLAY])
    pins = [(p.thickness, 0.5 * np.ptp(p.outline.bounds[::2])) for p in kit if p.name.startswith("roller pin")]
    assert sorted(pins) == [
        (pytest.approx(THICK * 1.4), pytest.approx(pin)),
        (pytest.approx(2 * THICK + WASHER), pytest.approx(pin)),
    ]


def test_a_clearance_that_breaks_a_plate_is_refused():
    run = run_scene(load("crank-rocker"), frames=4)
    mechanism, poses = run.motion.mechanism, collision_poses(run)
    with pytest.raises(MechanismError, match=r"hole '[A-E]' of '\w+' breaks out of its plate.*Give less than [\d.]+ mm") as refused:
        kit_of(mechanism, poses, THICK, 30.0, WASHER)
    most = float(refused.value.faults[0].remedy.split()[-2])
    assert kit_of(mechanism, poses, THICK, most, WASHER)
    with pytest.raises(MechanismError, match="breaks out"):
        kit_of(mechanism, poses, THICK, most + 0.1, WASHER)
