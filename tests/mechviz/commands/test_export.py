"""Tables and solids on disk."""

from __future__ import annotations

import csv
import json
import subprocess
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest
import trimesh
from typer.testing import CliRunner

import mechviz
from mechviz.commands.main import app
from mechviz.files import OutputError
from mechviz.outputs.exports.solids import export_stl
from mechviz.outputs.exports.tables import export_csv, export_parquet, wide_table
from mechviz.picture.build import picture_of, solids_of
from mechviz.runs import Run, run_scene
from mechviz.scene.builder import SceneBuilder
from mechviz.scene.scene import loads
from recordings import ran


def compressor() -> Run:
    return ran("slider-crank-compressor")


def test_csv_reads_back_bit_for_bit(tmp_path):
    path = export_csv(compressor(), tmp_path / "t.csv")
    with open(path, newline="", encoding="utf-8") as file:
        header, *rows = list(csv.reader(file))
    columns = wide_table(compressor())
    assert header == list(columns) and header[0] == "time [s]"
    values = np.array([[float(x) for x in row] for row in rows])
    assert np.array_equal(values, np.column_stack(list(columns.values())))
    for name in (
        "crank.x [m]",
        "piston.vx [m/s]",
        "rod.alpha [rad/s^2]",
        "rod.inertia.moment [N m]",
        "C.reaction.Fx [N]",
        "S.motion.slide_rate [m/s]",
        "A.drive.torque [N m]",
        "gas.load.Fx [N]",
        "energy.kinetic [J]",
        "health.power_balance [1]",
    ):
        assert name in header
    assert np.array_equal(columns["S.motion.slide [m]"], compressor().motion.coordinate("S")[:, 0])


def test_kinematics_has_no_columns_of_forces():
    names = " ".join(wide_table(ran("crank-rocker")))
    assert "torque" not in names and "reaction" not in names and "coupler.E.vx [m/s]" in names


def test_parquet_holds_the_same_and_says_what_it_is(tmp_path):
    path = export_parquet(compressor(), tmp_path / "t.parquet")
    table = pq.read_table(path)
    for name, values in wide_table(compressor()).items():
        assert np.array_equal(table[name].to_numpy(), values), name
    about = {k.decode(): v.decode() for k, v in table.schema.metadata.items()}
    assert about["mechviz.scene"] == "slider-crank-compressor"
    assert json.loads(about["mechviz.model"])["frame"] == "frame"
    assert mechviz.loads(about["mechviz.scene_toml"]) == compressor().scene


def test_stl_is_one_closed_solid_a_link_in_millimetres(tmp_path):
    solids = solids_of(compressor())
    files = export_stl(compressor(), tmp_path / "new" / "folder", solids=solids)
    drawn = {node.owner[1]: node.mesh for node in picture_of(compressor(), solids).nodes if node.key.startswith("link.")}
    assert {f.stem for f in files} == set(solids.links) == set(drawn)
    for file in files:  # as in the picture: the ground with its bars and posts
        mesh = trimesh.load_mesh(file)
        assert mesh.is_watertight and mesh.volume > 0
        assert np.allclose(mesh.extents, 1e3 * np.ptp(drawn[file.stem].vertices, axis=0), rtol=1e-5)


def test_links_whose_names_look_alike_get_files_of_their_own(tmp_path):
    text = ran("crank-rocker").scene.text
    for old, new in (("crank ", '"link:1"'), ('"crank"', '"link:1"'), ("rocker ", '"link?1"'), ('"rocker"', '"link?1"')):
        text = text.replace(f"\n{old}", f"\n{new}") if old.endswith(" ") else text.replace(old, new)
    files = export_stl(run_scene(loads(text), frames=8), tmp_path)
    assert len({f.name for f in files}) == 4 and {"link_1.stl", "link_1-2.stl"} <= {f.name for f in files}


@pytest.mark.parametrize("write", [export_csv, export_parquet])
def test_files_are_replaced_whole_or_not_at_all(tmp_path, write, monkeypatch):
    path = tmp_path / "t"
    path.write_text("old")
    with pytest.raises(OutputError, match="does not exist"):
        write(compressor(), tmp_path / "missing" / "t")
    with pytest.raises(OutputError, match="is a folder"):
        write(compressor(), tmp_path)
    with pytest.raises(OutputError, match="not a regular file"):
        write(compressor(), "/dev/null")

    def full(*_args):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("mechviz.files.os.fsync", full)
        with pytest.raises(OutputError, match="disk is full"):
            write(compressor(), path)
    assert path.read_text() == "old" and [p.name for p in tmp_path.iterdir()] == ["t"]
    write(compressor(), path)
    assert path.stat().st_size > 1000 and [p.name for p in tmp_path.iterdir()] == ["t"]


def test_a_table_is_not_put_in_the_place_of_what_is_printed(tmp_path):
    """Neither a pipe, which nothing can replace, nor the file of a shell's ``>>``, which would be lost."""
    log = tmp_path / "log"
    log.write_text("kept\n")
    command = [sys.executable, "-m", "mechviz", "export", "crank-rocker", "--csv"]
    piped = subprocess.run([*command, "/dev/stdout"], capture_output=True, text=True, check=False)
    assert piped.returncode == 2 and not piped.stdout
    assert piped.stderr.startswith("'/dev/stdout' is not a regular file") and "Name a file" in piped.stderr
    for path in ("/dev/stdout", str(log)):
        with open(log, "a") as appended:
            printed = subprocess.run([*command, path], stdout=appended, stderr=subprocess.PIPE, text=True, check=False)
        assert printed.returncode == 2 and "takes what is printed" in printed.stderr
        assert log.read_text() == "kept\n"


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be made"):
        export_stl(compressor(), tmp_path / "file" / "folder")


def test_files_that_a_scene_reads_are_not_replaced(tmp_path, monkeypatch):
    """A link whose mesh gives its mass has an STL of the same name; a table of results may have the name of one of a law."""
    monkeypatch.chdir(tmp_path)
    trimesh.creation.box((0.1, 0.02, 0.01)).export("arm.stl")
    before = (tmp_path / "arm.stl").read_bytes()
    scene = SceneBuilder("arm").link("frame", O=(0, 0))
    scene.link("arm", O=(0, 0), mass={"mesh": "arm.stl", "density": "7850 kg/m^3", "mesh_unit": "1 m"})
    scene.revolute("O", "frame", "arm", drive={"speed": "60 rpm"})
    mechviz.dump(scene.scene(), tmp_path / "arm.toml")
    for arguments in (["export", "--stl", "."], ["export", "--csv", "./arm.stl"], ["forces", "--csv", "arm.stl"]):
        command, *more = arguments
        result = CliRunner().invoke(app, [command, "arm.toml", *more])
        assert result.exit_code == 2 and "is a file that the scene reads" in result.output, result.output
        assert (tmp_path / "arm.stl").read_bytes() == before and len(list(tmp_path.iterdir())) == 2
    assert CliRunner().invoke(app, ["export", "arm.toml", "--stl", "parts"]).exit_code == 0
