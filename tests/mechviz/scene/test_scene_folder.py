"""A scene takes its files from its own folder, whatever is made of it: other frames, a recording, an edit, a copy elsewhere."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

import mechviz
from mechviz.commands.main import app
from mechviz.editor.history import Draft
from mechviz.editor.parameters import find_parameters
from mechviz.editor.saving import saved_scene
from mechviz.files import OutputError
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import run_scene, with_frames_and_cycles
from mechviz.scene.faults import SceneError
from mechviz.scene.folder import SceneFolder
from mechviz.scene.scene import Scene, dump, loads
from mechviz.studies.precision import WallTime, _file

GALLERY = Path(mechviz.__file__).parent / "gallery"
OFFSET = 5.0  # of the user's cam, a circle [mm]: its follower has a stroke of twice that; the gallery's one has another
STROKE = 2e-3 * OFFSET

BAR = """
units = { length = "mm", angle = "deg" }
effects = ["inertia", "gravity"]
[links]
frame   = { points = { A = [0, 0], D = [200, 0] } }
crank   = { points = { A = [0, 0], B = [60, 0] }, mass = { mesh = "parts/bar.stl", density = "7850 kg/m^3" } }
coupler = { points = { B = [0, 0], C = [180, 0] }, mass = 0.2, shape = "bar" }
rocker  = { points = { D = [0, 0], C = [150, 0] }, mass = 0.2, shape = "bar" }
[joints]
A = { revolute = ["frame", "crank"], drive = { speed = "60 rpm" } }
B = { revolute = ["crank", "coupler"] }
C = { revolute = ["coupler", "rocker"], side = "left" }
D = { revolute = ["frame", "rocker"] }
"""
MASS = 7850.0 * 0.06 * 0.02 * 0.01


def command(*arguments: str) -> str:
    done = CliRunner().invoke(app, list(arguments))
    assert done.exit_code == 0, done.output + done.stderr
    return done.stdout


@pytest.fixture
def cam(tmp_path, monkeypatch) -> Path:
    """The gallery's scene of a measured cam in a user's folder, with the user's own points under the same name."""
    folder = tmp_path / "mine"
    folder.mkdir(exist_ok=True)
    turns = np.linspace(0.0, 2.0 * np.pi, 73)[:-1]
    points = OFFSET + 50.0 * np.exp(1j * turns)
    (folder / "cam-measured.csv").write_text("x [mm],y [mm]\n" + "".join(f"{z.real:.6f},{z.imag:.6f}\n" for z in points))
    path = folder / "cam.toml"
    path.write_text((GALLERY / "cam-measured.toml").read_text().replace('tolerance = "0.004 mm"', 'tolerance = "0.001 mm"'))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir(exist_ok=True)
    monkeypatch.chdir(elsewhere)
    return path


@pytest.fixture
def bar(tmp_path, monkeypatch) -> Path:
    """A four-bar whose crank has the mass of a mesh file in a folder beside the scene."""
    folder = tmp_path / "mine"
    (folder / "parts").mkdir(parents=True)
    box = trimesh.creation.box((60, 20, 10), transform=trimesh.transformations.translation_matrix((30, 0, 0)))
    box.export(folder / "parts" / "bar.stl")
    path = folder / "bar.toml"
    path.write_text(BAR)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir(exist_ok=True)
    monkeypatch.chdir(elsewhere)
    return path


def stroke(motion) -> float:
    return float(np.ptp(motion.coordinate("S")[:, 0]))


def test_other_frames_and_cycles_keep_the_folder(cam):
    loaded = mechviz.load(cam)
    for scene in (
        loaded,
        with_frames_and_cycles(loaded, 48, None),
        with_frames_and_cycles(loaded, 48, 2),
        loaded.changed({("effects",): []}),
    ):
        assert stroke(run_scene(scene).motion) == pytest.approx(STROKE, rel=1e-3)
    assert stroke(run_scene(loaded, frames=72).motion) == pytest.approx(STROKE, rel=1e-3)
    assert stroke(run_scene(loaded, accuracy=1e-4).motion) == pytest.approx(STROKE, rel=1e-3)
    assert stroke(run_scene(mechviz.load("cam-measured"), frames=72).motion) > 1.3 * STROKE, "the gallery's own one is another"


def test_nothing_of_a_users_scene_is_looked_up_in_the_gallery(cam):
    (cam.parent / "cam-measured.csv").unlink()
    with pytest.raises(SceneError) as refused:
        mechviz.load(cam)
    assert refused.value.faults[0].message == f"there is no file 'cam-measured.csv' in '{cam.parent}'."
    with pytest.raises(SceneError, match=r"no file 'cam-measured\.csv'"):
        loads(cam.read_text())
    assert loads(cam.read_text(), folder=GALLERY).folder.path == GALLERY


@pytest.mark.parametrize("more", [[], ["--frames", "24"], ["--cycles", "2"], ["--accuracy", "1e-3"]])
def test_commands_read_the_scenes_own_files(cam, more):
    """Records and tables of the command line, with every option that used to rebuild the scene elsewhere."""
    command("record", str(cam), "-o", "r.rrd", *more)
    recording = Recording("r.rrd")
    assert np.ptp(recording.scalars("data", "joints", "S", "motion")[1][:, 0]) == pytest.approx(STROKE, rel=2e-2)
    command("export", str(cam), "--csv", "t.csv", "--profile", "p.csv", *more)
    with open("t.csv", encoding="utf-8") as file:
        slides = [float(row["S.motion.slide [m]"]) for row in csv.DictReader(file)]
    assert np.ptp(slides) == pytest.approx(STROKE, rel=2e-2)
    radii = np.genfromtxt("p.csv", delimiter=",", skip_header=1, usecols=(2, 3))
    assert np.abs(np.hypot(*(radii - [OFFSET, 0.0]).T) - 50.0).max() < 0.01


def test_all_other_commands_run_away_from_the_scenes_folder(cam):
    name = str(cam)
    for arguments in (
        ["check", name],
        ["plan", name],
        ["cams", name],
        ["forces", name, "--frames", "24", "--csv", "f.csv"],
        ["effects", name],
        ["share", name, "--frames", "24", "-o", "s.html"],
        ["shot", name, "--frames", "24", "-o", "s.svg"],
        ["show", name],
    ):
        command(*arguments)


def test_a_recording_carries_the_files_of_its_scene(cam, tmp_path):
    write_recording(run_scene(mechviz.load(cam), frames=24), "r.rrd")
    (cam.parent / "cam-measured.csv").unlink()
    moved = tmp_path / "moved"
    moved.mkdir()
    Path("r.rrd").rename(moved / "r.rrd")
    scene = Recording(moved / "r.rrd").scene()
    assert scene.folder.foreign
    assert stroke(run_scene(scene).motion) == pytest.approx(STROKE, rel=1e-2)
    assert scene == with_frames_and_cycles(scene, 24, None) and scene != mechviz.load("cam-measured")


@pytest.mark.parametrize("way", ["absolute", "upwards", "link"])
def test_a_scene_inside_a_recording_reads_nothing_outside_its_folder(cam, tmp_path, way):
    """Somebody else may have made it. What it has brought is used, and what lies below the folder is read."""
    folder = tmp_path / "theirs"
    (folder / "below").mkdir(parents=True)
    secret = cam.parent / "cam-measured.csv"
    name = {"absolute": str(secret), "upwards": "../mine/cam-measured.csv", "link": "below/link.csv"}[way]
    if way == "link":
        (folder / "below" / "link.csv").symlink_to(secret)
    text = cam.read_text().replace("cam-measured.csv", name)
    assert loads(text, folder=folder).files[name] == secret.read_bytes(), "on the command line it may"
    with pytest.raises(SceneError) as refused:
        loads(text, folder=SceneFolder(folder, foreign=True))
    (fault,) = refused.value.faults
    assert fault.path.endswith(".profile.file") and "outside of that folder" in fault.message and fault.remedy
    brought = SceneFolder(folder, {name: secret.read_bytes()}, foreign=True)
    assert loads(text, folder=brought).changed({("run", "frames"): 30}).folder.foreign
    (folder / "below" / "own.csv").write_bytes(secret.read_bytes())
    loads(cam.read_text().replace("cam-measured.csv", "below/own.csv"), folder=SceneFolder(folder, foreign=True))


def test_edits_keep_the_folder(cam):
    opened = mechviz.load(cam)
    stiffness = next(p for p in find_parameters(opened) if p.key == "loads.return_spring.stiffness")
    draft = Draft.of(opened).with_value(stiffness.path, stiffness.written(3.5)).with_effect("gravity", False)
    edited = draft.with_load("return_spring", False).with_load("return_spring", True).scene()
    assert edited.mechanism.loads[0].stiffness == 3500.0
    assert stroke(run_scene(edited).motion) == pytest.approx(STROKE, rel=1e-3)
    saved, kept = saved_scene(opened, edited)
    assert kept and saved.text != opened.text and loads(saved.text, folder=cam.parent) == edited


def test_a_scene_takes_its_files_along_when_it_is_saved_elsewhere(bar, cam):
    for path, names in ((bar, ["parts/bar.stl"]), (cam, ["cam-measured.csv"])):
        target = Path.cwd() / path.name
        assert [p.relative_to(Path.cwd()).as_posix() for p in dump(mechviz.load(path), target)] == names
        assert mechviz.load(target) == mechviz.load(path)
        assert dump(mechviz.load(path), target) == [], "the same file is there already"
    Path("cam-measured.csv").write_text("x [mm],y [mm]\n1,2\n")
    before = Path("cam.toml").read_text()
    with pytest.raises(OutputError, match=r"another file than the 'cam-measured\.csv'"):
        dump(mechviz.load(cam).changed({("title",): "another"}), "cam.toml")
    assert Path("cam.toml").read_text() == before and Path("cam-measured.csv").read_text().endswith("1,2\n")
    outside = mechviz.loads(BAR.replace("parts/bar.stl", "../mine/parts/bar.stl"), folder=bar.parent / "parts" / "..")
    Path("below/further").mkdir(parents=True)
    with pytest.raises(OutputError, match="would not find its files"):
        dump(outside, "below/further/bar.toml")
    assert not Path("below/further/bar.toml").exists()


def test_masses_from_mesh_files_survive_balance_effects_and_vibrations(bar, monkeypatch):
    monkeypatch.setattr("mechviz.studies.precision.time_repeatedly", lambda work, *_, **__: (work(), WallTime(1e-3, 0.0, 1))[1])
    assert mechviz.load(bar).mechanism.links[1].mass == pytest.approx(MASS, rel=1e-6)
    command("balance", str(bar), "--radius", "50 mm", "-o", "balanced.toml")
    balanced = mechviz.load("balanced.toml")
    assert [link.mass for link in balanced.mechanism.links][1] > MASS and Path("parts/bar.stl").is_file()
    assert "gravity" in command("effects", str(bar))
    free = bar.with_name("free.toml")
    swings = BAR.replace('drive = { speed = "60 rpm" }', "free = { position = -80 }")
    free.write_text(swings.replace("[links]", '[run]\nduration = "1 s"\n[links]'))
    command("vibrations", str(free), "--mode", "1", "-o", "mode.toml", "--csv", "modes.csv")
    shown = mechviz.load("mode.toml")
    assert shown.mechanism.links[1].mass == pytest.approx(MASS, rel=1e-6) and shown.simulation is None
    command("accuracy", str(bar), "--target", "1e-3", "--quick", "--setting", "tessellation", "-o", "ladder.svg")


def test_measured_ladders_belong_to_the_files_too(cam):
    first = _file(mechviz.load(cam), 1e-3)
    lines = (cam.parent / "cam-measured.csv").read_text().splitlines()
    (cam.parent / "cam-measured.csv").write_text("\n".join([lines[0], *lines[2:]]))
    assert _file(mechviz.load(cam), 1e-3) != first


def test_a_file_is_read_once(cam):
    scene = mechviz.load(cam)
    (cam.parent / "cam-measured.csv").unlink()
    assert stroke(run_scene(scene, frames=36).motion) == pytest.approx(STROKE, rel=1e-3)


def test_scenes_of_python_take_their_files_from_the_working_folder_or_a_stated_one(bar):
    document = mechviz.load(bar).document.model_dump(exclude_unset=True)
    with pytest.raises(SceneError, match=r"no file 'parts/bar\.stl' in"):
        Scene.build(**document)
    scene = Scene.build(folder=bar.parent, **document)
    assert scene == mechviz.load(bar) and scene.changed({("run", "frames"): 12}).frames == 12


def test_a_changed_value_is_validated_with_its_place(bar):
    scene = mechviz.load(bar)
    with pytest.raises(SceneError) as refused:
        scene.changed({("links", "coupler", "mass"): "-1 kg", ("run", "frames"): 1})
    assert [f.path for f in refused.value.faults] == ["links.coupler.mass", "run.frames"]
    assert scene.changed({("links", "coupler", "points", "C", 0): 170}).mechanism.links[2].points["C"] == (0.17, 0.0)
    assert scene.changed({("gravity", 1): -1.6}).mechanism.gravity == (0.0, -1.6)
    assert scene.changed({("title",): "x"}).text.startswith('title = "x"') and scene.text == BAR
