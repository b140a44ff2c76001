"""Names that refer to other parts of a scene: what the types say of them is what the reader checks."""

from __future__ import annotations

import pytest

from mechviz.scene.builder import SceneBuilder
from mechviz.scene.faults import SceneError, path_text
from mechviz.scene.folder import gallery
from mechviz.scene.kinds.joints.document import JOINT_KINDS as JOINTS
from mechviz.scene.kinds.loads.document import LOAD_KINDS as LOADS
from mechviz.scene.names import references
from mechviz.scene.scene import Scene, load


@pytest.fixture(scope="module")
def places():
    """One reference of every key and sort in the gallery: key, what it refers to -> name of the scene and place."""
    result = {}
    for entry in gallery():
        for leaf, reference in references(load(entry.name).document):
            key = next(part for part in reversed(leaf.path) if isinstance(part, str))
            result.setdefault((key, reference.to), (entry.name, leaf.path))
    return result


def test_keywords_of_joints_refer_to_links(places):
    assert {(keyword, "link") for keyword in JOINTS if keyword != "chain"} <= places.keys()
    assert {("on", "link"), ("viscous", "joint"), ("servo", "joint"), ("gas", "joint"), ("spring", "point")} <= places.keys()


def test_a_name_that_nothing_is_called_by_is_a_fault_at_its_place(places):
    words = {"link": "link", "point": "point", "joint": "joint"}
    for (_, sort), (name, place) in places.items():
        with pytest.raises(SceneError) as error:
            load(name).changed({place: "nothing"})
        (fault,) = [fault for fault in error.value.faults if fault.path == path_text(place)]
        assert f"there is no {words[sort]} 'nothing'" in fault.message


@pytest.mark.parametrize(("section", "kinds"), [("joints", JOINTS), ("loads", LOADS)])
def test_an_unknown_key_is_answered_by_the_keys_of_its_kind(section, kinds):
    for keyword, kind in kinds.items():
        links = {"frame": {"points": {"A": [0, 0]}}}
        with pytest.raises(SceneError) as error:
            Scene.build(links=links, **{section: {"X": {keyword: ["frame", "frame"], "qqq": 1}}})
        remedy = next(fault.remedy for fault in error.value.faults if "'qqq'" in fault.message)
        assert remedy.startswith(f"Known: '{keyword}'")
        assert all(f"'{key}'" in remedy for key in kind.keys)


def test_a_misspelt_keyword_of_the_builder_is_a_fault_with_a_remedy():
    b = SceneBuilder("s").link("frame", A=(0, 0), B=(1, 0)).link("a", A=(0, 0)).link("b", B=(0, 0))
    b.revolute("A", "frame", "a", drive={"speed": 1}).revolute("B", "frame", "b").gear("G", "a", "b", teth=[20, 40])
    with pytest.raises(SceneError, match="Did you mean 'teeth'"):
        b.scene()
