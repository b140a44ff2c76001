"""The pages on scenes: their scenes load, fragments fit into a scene, their Python runs, their error report is the real one."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

import mechviz
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.mechanism import EFFECTS
from mechviz.scene.document import LinkDocument, SceneDocument
from mechviz.scene.kinds.drives import DriveDocument
from mechviz.scene.kinds.friction import ClearanceDocument, FrictionDefaults, FrictionDocument
from mechviz.scene.kinds.joints.document import JOINT_KINDS as JOINTS
from mechviz.scene.kinds.joints.document import JointDocument
from mechviz.scene.kinds.loads.document import LOAD_KINDS as LOADS
from mechviz.scene.kinds.loads.document import LoadDocument
from mechviz.scene.kinds.signals import ChirpDocument, RampDocument, SineDocument, StepDocument
from mechviz.scene.reading.formulas import resolve

ROOT = Path(__file__).resolve().parents[3]
TEXT = "\n".join(
    (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8") for page in ("scenes", "joints", "drives", "loads", "analyses")
)
BLOCKS = re.findall(r"```(\w*)\n(.*?)```", TEXT, flags=re.DOTALL)
TOML = [text for language, text in BLOCKS if language == "toml"]
WHOLE = [text for text in TOML if "title =" in text]


@pytest.mark.parametrize("text", WHOLE)
def test_whole_scenes_of_the_pages_run(text):
    mechanism = mechviz.loads(text).mechanism
    motion = solve_motion(compile_mechanism(mechanism), default_times(mechanism))
    assert motion.closure.max() < 1e-15


@pytest.mark.parametrize("text", [text for text in TOML if text not in WHOLE])
def test_fragments_of_the_pages_are_valid(text):
    """Several drives under each other are alternatives: each is a fragment of its own."""
    parts = re.split(r"(?m)^(?=drive = )", text) if text.startswith("drive") else [text]
    for part in filter(str.strip, parts):
        data = tomllib.loads(part)
        if "drive" in data:
            DriveDocument.model_validate(data["drive"])
            continue
        for joint in data.get("joints", {}).values():
            if list(joint) == ["drive"]:
                joint["revolute"] = ["frame", "crank"]
        SceneDocument.model_validate(resolve(data).data)


def test_the_python_of_the_pages_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (code,) = [text for language, text in BLOCKS if language == "python"]
    names: dict = {}
    exec(code, names)
    assert mechviz.load("four-bar.toml") == names["scene"]
    assert names["same"].mechanism.links[1].points["P"] == (0.06, 0.0)


def test_the_report_of_the_pages_is_the_real_one():
    (report,) = [text for language, text in BLOCKS if language == "" and "problems" in text]
    text = WHOLE[0].replace("C = [150, 0] }", "C = [150, 0] }, mas = 1").replace("60 rpm", "60 Hz").replace('"left"', '"lefft"')
    with pytest.raises(mechviz.SceneError) as error:
        mechviz.loads(text, "crank_rocker.toml")
    assert str(error.value) == report.strip()


def test_the_rows_of_effects_name_every_effect():
    (row,) = re.findall(r"(?m)^\| `effects` \|.*$", TEXT)
    for effect in EFFECTS:
        assert f'`"{effect}"`' in row
        assert f'\n| `"{effect}"` | ' in TEXT


def test_every_package_of_the_wheel_tells_that_it_has_types():
    """PEP 561: type checkers read a package's annotations only where it holds py.typed."""
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert [package for package in wheel["packages"] if not (ROOT / package / "py.typed").is_file()] == []


@pytest.mark.parametrize(("table", "kinds"), [(JointDocument, JOINTS), (LoadDocument, LOADS)])
def test_every_kind_has_an_example_that_is_valid_and_its_keys_exist(table, kinds):
    for keyword, kind in kinds.items():
        entry = table.model_validate(tomllib.loads(f"entry = {kind.example}")["entry"])
        assert entry.kinds == [keyword]
        assert set(kind.needs) <= set(kind.keys) <= set(table.model_fields)


def test_every_key_of_the_format_is_on_the_pages():
    for table in (
        SceneDocument,
        LinkDocument,
        JointDocument,
        DriveDocument,
        LoadDocument,
        FrictionDocument,
        FrictionDefaults,
        ClearanceDocument,
        SineDocument,
        StepDocument,
        RampDocument,
        ChirpDocument,
    ):
        for key in table.model_fields:
            assert re.search(rf"(`{key}`|\b{key} = )", TEXT), f"{table.__name__}.{key}"
