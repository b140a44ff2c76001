"""Damaged recordings, as a stranger's file may be: whoever reads one names what is wrong with it, and nothing falls over."""

from __future__ import annotations

import contextlib
import os
import shutil
import struct
import warnings
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from damage import batches, damaged, entity_of, read_all, write

import mechviz
from mechcore.errors import MechanismError
from mechviz.commands.recording import open_recording
from mechviz.files import OutputError
from mechviz.outputs.inspection import format_inspection, inspect
from mechviz.outputs.rerun import rerun_adapter, writer
from mechviz.outputs.rerun.entities import RecordingError
from mechviz.outputs.rerun.reader import Recording
from mechviz.runs import run_scene
from mechviz.scene.scene import loads
from recordings import gallery_scene, made, ran

SAMPLE = 12


@pytest.fixture(scope="module")
def whole() -> Path:
    return made("kinetostatic-four-bar", 12).path


def test_damage_is_an_error_of_ours_or_nothing(whole, tmp_path):
    """A sample of ``tests/torture``, with warnings as errors."""
    for seed in range(SAMPLE):
        words = damaged(whole, tmp_path / "damaged.rrd", seed)
        for read in read_all(tmp_path / "damaged.rrd"):
            try:
                read()
            except (OutputError, MechanismError):
                pass
            except Exception as error:
                pytest.fail(f"seed {seed}, {words}: {type(error).__name__} {error}")


def changed(whole: Path, target: Path, path: str, name: str, change, kind: pa.DataType | None = None) -> Path:
    """A recording in which a column of an entity has other rows, of another ``kind`` where one is given."""
    rows = batches(whole)
    for k, batch in enumerate(rows):
        if entity_of(batch) == path and name in batch.schema.names:
            c = batch.schema.names.index(name)
            field = batch.schema.field(c) if kind is None else batch.schema.field(c).with_type(kind)
            rows[k] = batch.set_column(c, field, pa.array([change(row) for row in batch.column(c).to_pylist()], kind or field.type))
    return write(target, rows)


@pytest.mark.parametrize(
    ("path", "name", "change", "words"),
    [
        ("/data/links/crank/pose", "Scalars:scalars", lambda row: [np.nan, *row[1:]], "crank/pose: its .* is not finite"),
        ("/data/links/crank/pose", "Scalars:scalars", lambda row: row[:2], "2 numbers in a row instead of 3"),
        ("/data/joints/A/motion", "Scalars:scalars", lambda row: [np.inf, *row[1:]], "A/motion: its .* is not finite"),
        ("/data/links/crank/velocity", "Scalars:scalars", lambda row: [1e200, *row[1:]], r"holds numbers beyond 1e\+150"),
        ("/diagrams/bearing\\ forces", "title", lambda row: None, "its title has rows without values"),
        ("/mechanism/links/crank", "Transform3D:translation", lambda row: [[np.inf, 0.0, 0.0]], "is not finite"),
        ("/mechanism/links/crank/mesh", "Mesh3D:triangle_indices", lambda row: [[0, 1, 10**6]], "its faces name vertices"),
        ("/__properties/mechviz", "model", lambda row: [row[0][:40]], "property model: invalid json"),
        ("/__properties/mechviz", "model", lambda row: [row[0].replace('"frame": "frame"', '"frame": "x"')], "names the link 'x'"),
        ("/__properties/mechviz", "tolerance", lambda row: [float("nan")], "property tolerance"),
        ("/__properties/mechviz", "picture", lambda row: ['[{"key": 1}]'], "property picture.0"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(whole, tmp_path, path, name, change, words):
    target = changed(whole, tmp_path / "a.rrd", path, name, change)
    with pytest.raises(RecordingError, match=words) as error:
        Recording(target)
    assert error.value.remedy and len(str(error.value)) < 2000


@pytest.mark.parametrize("number", [pa.float16(), pa.float32()])
def test_numbers_of_fewer_digits_are_read_or_refused(whole, tmp_path, number):
    """The bound of what a table may hold is beyond what such a number reaches."""
    target = changed(whole, tmp_path / "a.rrd", "/data/joints/B/reaction", "Scalars:scalars", list, pa.list_(number))
    warnings.simplefilter("error")
    for read in read_all(target):
        with contextlib.suppress(OutputError):
            read()


def test_a_value_that_is_none_signals_nothing(whole, tmp_path):
    """One turned bit makes it a NaN at which numpy warns."""
    signal = struct.unpack("<d", struct.pack("<Q", 0x7FF0000000000001))[0]
    reaction = "data", "joints", "D", "reaction"
    target = changed(whole, tmp_path / "a.rrd", "/" + "/".join(reaction), "Scalars:scalars", lambda row: [signal, *row[1:]])
    with np.errstate(invalid="raise"):
        values = Recording(target).scalars(*reaction)[1] ** 2
    assert np.isnan(values[:, 0]).any() and np.isfinite(values[:, 1]).any()


@pytest.mark.parametrize(("link", "keys", "value"), [("rocker", ("mass",), "1e29 kg"), ("coupler", ("points", "T"), ["1e12 m", 0])])
def test_our_own_recordings_of_far_values_are_whole(tmp_path, link, keys, value):
    """Forces of a heavy link passed the limit of places, and the outline about a far point did: both were called damaged."""
    scene = gallery_scene("kinetostatic-four-bar").changed({("links", link, *keys): value})
    writer.write_recording(run_scene(scene, frames=8), tmp_path / "a.rrd")
    assert Recording(tmp_path / "a.rrd").parsed_properties.complete


def test_a_friction_circle_of_many_light_years_is_refused(tmp_path):
    scene = gallery_scene("four-bar-friction-circles").changed({("friction", "radius"): 1e29})
    with pytest.raises(MechanismError, match=r"joints\.A: what is drawn of it reaches .*e\+2\d m; up to 1e\+13 m are drawn"):
        writer.write_recording(run_scene(scene, frames=8), tmp_path / "a.rrd")


def test_frames_within_a_nanosecond_are_refused(tmp_path):
    scene = gallery_scene("crank-rocker").changed({("joints", "A", "drive", "speed"): "1e14 rpm"})
    with pytest.raises(RecordingError, match="The 9 frames lie within 6e-13 s; a recording counts nanoseconds"):
        writer.write_recording(run_scene(scene, frames=8), tmp_path / "a.rrd")


def test_what_is_missing_is_named(whole, tmp_path):
    write(tmp_path / "a.rrd", [b for b in batches(whole) if entity_of(b) != "/data/links/crank/pose"])
    with pytest.raises(RecordingError, match="/data/links/crank/pose is missing"):
        Recording(tmp_path / "a.rrd")


@pytest.mark.parametrize("lost", ["text", "level"])
def test_a_log_without_its_lines_or_their_levels_is_named(whole, tmp_path, lost):
    column = f"TextLog:{lost}"
    result = [b.drop_columns([column]) if column in b.schema.names else b for b in batches(whole)]
    write(tmp_path / "a.rrd", result)
    with pytest.raises(RecordingError, match=f"/events: it has TextLog:.*, but no {column}"):
        Recording(tmp_path / "a.rrd")


@pytest.mark.thorough
def test_a_part_that_is_cut_anywhere_is_read_up_to_its_last_whole_block(tmp_path, monkeypatch):
    monkeypatch.setattr(writer, "BLOCK_FRAMES", 40)

    def stop(done: int, total: int) -> None:
        if done >= 80:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        writer.write_recording(ran("crank-rocker", 100), tmp_path / "a.rrd", progress=stop)
    data, cut = (tmp_path / "a.part.rrd").read_bytes(), tmp_path / "cut.rrd"
    frames = []
    for share in np.linspace(0.0, 1.0, 17)[1:]:
        cut.write_bytes(data[: int(share * len(data))])
        try:
            frames.append(inspect(cut).frames)
        except RecordingError as error:
            assert "holds no frames" in str(error)
            frames.append(0)
            continue
        for most in (None, 20):
            recording = Recording(cut, most=most)
            assert not recording.parsed_properties.complete
            assert len({len(recording.times(path)) for path in recording.entities if path.startswith("/data/links")} - {0}) == 1
    assert frames == sorted(frames) and set(frames) == {0, 40, 80} and frames[-1] == 80


def hurt(whole: Path, target: Path, *entities: str) -> Path:
    """A recording in which the last chunk of each of some entities is damaged."""
    data = bytearray(whole.read_bytes())
    places = {entity: at for at, entity in sorted(rerun_adapter.index_of(whole).items())}
    for entity in entities:
        data[places[entity] + rerun_adapter.MESSAGE_HEADER.size] ^= 255
    target.write_bytes(data)
    return target


def test_a_damaged_chunk_costs_its_entity_only(whole, tmp_path, capsys):
    """Everything stands in one block: its other entities are as they were, in every way of reading it."""
    lost = ("/data/links/rocker/acceleration", "/data/loads/P", "/vectors/reaction/B", "/mechanism/links/crank/mesh", "/scene")
    target = hurt(whole, tmp_path / "hurt.rrd", *lost)
    sound, result = Recording(whole), Recording(target)
    assert set(sound.entities) - set(result.entities) == set(lost)
    assert "damaged at byte" in result.note and all(entity in result.note for entity in lost)
    for path in result.entities:
        if path.startswith(("/data/", "/health/")) and result.has(path):
            assert np.array_equal(result.scalars(path)[1], sound.scalars(path)[1], equal_nan=True)
    assert result.note in format_inspection(inspect(target)).replace("\n", " ")
    assert open_recording(str(target)).note == result.note and "damaged at byte" in capsys.readouterr().err
    with pytest.raises(RecordingError, match="does not hold its scene"):
        result.scene()
    for read in read_all(target)[:-1]:
        read()


def test_where_a_needed_table_is_damaged_the_frames_before_are_read(tmp_path, monkeypatch):
    """Of three blocks the last one: what cannot be shown without it ends there, what is spare does not."""
    monkeypatch.setattr(writer, "BLOCK_FRAMES", 40)
    whole = tmp_path / "whole.rrd"
    writer.write_recording(ran("crank-rocker", 100), whole)
    pose = "/data/links/crank/pose"
    target = hurt(whole, tmp_path / "hurt.rrd", pose, "/health/closure")
    for most in (None, 20):
        recording = Recording(target, most=most)
        assert "Missing: /health/closure." in recording.note
    recording = Recording(target)
    assert "Only the first 80 of 101 frames are here" in recording.note
    _, poses = recording.scalars("data", "links", "rocker", "pose")
    assert np.array_equal(poses, Recording(whole).scalars("data", "links", "rocker", "pose")[1][:80])
    assert inspect(target).frames == 80


def test_where_nothing_can_be_shown_the_damage_is_named(whole, tmp_path):
    with pytest.raises(RecordingError, match=r"damaged at byte .*/data/links/crank/pose") as error:
        Recording(hurt(whole, tmp_path / "hurt.rrd", "/data/links/crank/pose"))
    assert error.value.remedy


def test_a_message_that_lies_about_its_length_or_kind_is_stepped_over(whole, tmp_path):
    index, data = rerun_adapter.index_of(whole), whole.read_bytes()
    at = next(at for at, entity in index.items() if entity == "/vectors/reaction/B")
    kept = set(Recording(whole).entities)
    for place, bit in ((at, 1), (at, 2), (at + 1, 1), (at + 8, 4), (at + 10, 1), (at + 15, 1)):
        turned = bytearray(data)
        turned[place] ^= bit
        (tmp_path / "a.rrd").write_bytes(turned)
        recording = Recording(tmp_path / "a.rrd")
        assert kept - set(recording.entities) <= {"/vectors/reaction/B"}
        assert recording.note or kept == set(recording.entities)


def test_a_message_that_says_it_is_longer_takes_nothing_from_the_next_one(whole, tmp_path):
    index, data = rerun_adapter.index_of(whole), whole.read_bytes()
    kept, tried = set(Recording(whole).entities), [at for at, entity in sorted(index.items()) if entity.startswith("/vectors/")]
    for at in tried[:8]:
        longer = bytearray(data)
        longer[at + 8 : at + 16] = (int.from_bytes(data[at + 8 : at + 16], "little") + 4).to_bytes(8, "little")
        (tmp_path / "a.rrd").write_bytes(longer)
        recording = Recording(tmp_path / "a.rrd")
        assert kept - set(recording.entities) <= {index[at]} and recording.note


def test_without_its_index_a_damaged_recording_is_read_up_to_there(tmp_path, monkeypatch):
    monkeypatch.setattr(writer, "BLOCK_FRAMES", 40)
    whole = tmp_path / "whole.rrd"
    writer.write_recording(ran("crank-rocker", 100), whole)
    target = hurt(whole, tmp_path / "hurt.rrd", "/health/closure")
    target.write_bytes(target.read_bytes()[:-1])
    recording = Recording(target)
    assert len(recording.times("data", "links", "crank", "pose")) == 80 and "Only the first 80 of 101 frames" in recording.note


@pytest.mark.thorough
def test_turned_bits_in_the_frame_of_a_chunk_do_not_end_the_process(whole, tmp_path):
    """Rerun's own reader ends the process at some of them: every bit of the first kilobyte of a chunk is tried, in steps."""
    data = whole.read_bytes()
    target = tmp_path / "turned.rrd"
    for at in range(60_000, 61_000, 23):
        turned = bytearray(data)
        turned[at] ^= 1 << at % 8
        target.write_bytes(turned)
        try:
            Recording(target)
        except RecordingError as error:
            assert error.remedy


def test_a_chunk_whose_name_is_no_text_is_stepped_over(whole, tmp_path):
    """Chunks are compressed, but short names that come once stand there as they are."""
    target, name = tmp_path / "a.rrd", b"/data/links/crank/pose"
    target.write_bytes(whole.read_bytes().replace(name, name.replace(b"crank", b"cr\xe9nk")))
    with pytest.raises(OutputError, match="crank/pose"):
        Recording(target)


def test_what_is_no_regular_file_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe.rrd")
    (tmp_path / "zero.rrd").symlink_to("/dev/zero")
    for name in ("pipe.rrd", "zero.rrd"):
        with pytest.raises(RecordingError, match="not a regular file"):
            Recording(tmp_path / name)


def test_the_scene_of_a_recording_cannot_leave_its_folder(whole, tmp_path):
    """Neither by its name nor by the files that it names, unless the recording brought them along."""
    gallery = Path(mechviz.__file__).parent / "gallery"
    secret = tmp_path / "secret.csv"
    shutil.copy(gallery / "cam-measured.csv", secret)
    (tmp_path / "in").mkdir()
    evil = changed(whole, tmp_path / "in" / "a.rrd", "/__properties/mechviz", "scene", lambda row: ["../../evil"])
    assert "/" not in Recording(evil).scene().name
    cam = (gallery / "cam-measured.toml").read_text()

    def naming(name: str) -> Recording:
        text = cam.replace('"cam-measured.csv"', f'"{name}"')
        return Recording(changed(whole, tmp_path / "in" / "b.rrd", "/scene", "TextDocument:text", lambda row: [text]))

    for name in (str(secret), "../secret.csv"):
        with pytest.raises(MechanismError, match="outside of that folder"):
            naming(name).scene()
    shutil.copy(secret, tmp_path / "in" / "near.csv")
    assert set(naming("near.csv").scene().files) == {"near.csv"}


def test_what_is_written_is_read_or_not_written(tmp_path):
    """A cam lifts by a million kilometres: its diagrams hold velocities and forces beyond all places. A block moves so far that it
    cannot be drawn."""
    path = tmp_path / "far.rrd"
    lift = {("joints", "K", "profile", "lift", 0, "to"): 1e12}
    writer.write_recording(run_scene(mechviz.load("cam-roller").changed(lift), frames=8), path)
    assert Recording(path).scene().name == "cam-roller"
    run = run_scene(loads(FAR, "far"))
    with pytest.raises(MechanismError, match=r"links.block: it goes as far as 1e\+13 m away; up to 1e\+12 m are drawn"):
        writer.write_recording(run, tmp_path / "farther.rrd")
    assert [p.name for p in tmp_path.iterdir()] == ["far.rrd"]


FAR = """
run = { frames = 8 }
[links]
frame = { points = { G = [0, 0], H = ["1e9 m", 0] } }
block = { points = { G = [0, 0], E = ["1e9 m", 0] } }
[joints.G]
prismatic = ["frame", "block"]
along = [1, 0]
drive = { speed = "1 m/s", travel = "1e13 m" }
"""
