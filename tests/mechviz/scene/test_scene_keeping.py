"""Saving an edited scene into the text that it came from: what was changed is changed, all else stays, comments first of all."""

from __future__ import annotations

import copy
import random
import tomllib
from typing import Any

import pytest

from mechviz import scene
from mechviz.editor.history import Draft
from mechviz.editor.parameters import find_parameters
from mechviz.editor.saving import patched, updated_text
from mechviz.scene.folder import GALLERY_FOLDER
from mechviz.scene.reading.text import toml_text
from mechviz.scene.scene import loads

TEXT = '''# a "title" = [1] in a comment
title = "a # is no comment { [ here"   # but this is one
list = [
  1, # first
  2.50,
  [3, 4],   # ] an inner list
  5 # last
]
literal = 'C:\\new'
many = """
[no.header]
x = 1 # no comment
"""
"quoted key".under = 4

[links]   # all links
crank = { points = { A = [0, 0], B = [1.0, 0] }, mass = "1 kg" }  # the crank
rod = { mass = 2 }

# about the joints
[joints.K]
cam = 1    # one
law = "3-4-5"

# its profile
[joints.K.profile]
base = 40 # mm

[[events]]
at = 1
[[events]]
at = 2   # the second
'''


COMMENTS = {
    "# but this is one",
    "# first",
    "# last",
    "# ] an inner list",
    "# all links",
    "# the crank",
    "# about the joints",
    "# one",
    "# its profile",
    "# mm",
    "# the second",
}


def _changed(*changes: tuple[tuple[Any, ...], Any]) -> dict[str, Any]:
    data: Any = copy.deepcopy(tomllib.loads(TEXT))
    for path, value in changes:
        table = data
        for key in path[:-1]:
            table = table[key]
        if value is None:
            del table[path[-1]]
        else:
            table[path[-1]] = value
    return data


@pytest.mark.parametrize(
    "changes, lines, comments",
    [
        ([(("title",), "new")], 1, set()),
        ([(("list", 1), 7.25), (("list", 2, 0), -1)], 2, set()),
        ([(("list",), [9])], 6, {"# first", "# ] an inner list", "# last"}),
        ([(("literal",), "x"), (("many",), "y"), (("quoted key", "under"), 5)], 6, set()),
        ([(("links", "crank", "points", "B", 0), 1.25), (("links", "rod", "mass"), "3 kg")], 2, set()),
        ([(("links", "crank", "points", "C"), [2, 3]), (("links", "crank", "mass"), None)], 1, set()),
        ([(("links", "crank", "points"), None)], 1, set()),
        ([(("links", "rod", "inertia"), 4.0)], 1, set()),
        ([(("links", "rod"), None)], 1, set()),
        ([(("links",), None)], 3, {"# all links", "# the crank"}),
        ([(("links", "new"), {"mass": 1})], 0, set()),
        ([(("joints", "K", "profile", "base"), 44), (("events", 1, "at"), 3)], 2, set()),
        ([(("joints", "K", "lift"), 3)], 0, set()),
        ([(("joints", "K", "profile"), None)], 2, {"# mm"}),
        ([(("joints",), None)], 6, {"# mm", "# its profile", "# one"}),
        ([(("trace",), ["rod.A"]), (("loads",), {"P": {"force": [1, 2]}})], 0, set()),
    ],
)
def test_only_what_differs_is_written(changes, lines, comments):
    """``lines``: of the old text are no more there as they were; ``comments``: those within what was taken away."""
    after = _changed(*changes)
    text = patched(TEXT, tomllib.loads(TEXT), after)
    assert text is not None and tomllib.loads(text) == after
    left = text.splitlines()
    assert sum(bool(line) and line not in left for line in TEXT.splitlines()) == lines
    assert {comment for comment in COMMENTS if comment not in text} == comments
    for comment, header in (("# about the joints", "[joints.K]"), ("# its profile", "[joints.K.profile]")):
        if comment in left and header in left:
            assert left[left.index(comment) + 1] == header, "a comment stays above what it is about"


def test_what_the_text_does_not_hold_is_not_written():
    assert patched("a = 1\n", {"a": 1, "b": 2}, {"a": 1, "b": 3}) is None
    assert patched("a = 1\n", {"a": {"b": 2}}, {"a": {"b": 3}}) == "a = { b = 3 }\n", "the value as a whole"
    assert patched("a = [1\n", {"a": 1}, {"a": 2}) is None


def test_whatever_is_written_says_what_is_meant():
    """Random tables, some values of which are changed, taken away or added, at any depth."""
    draw = random.Random(7)
    values = [1, -2.5, True, "a # b", 'say "]"', "{\n", [1, 2], [], [[3], "]"]]

    def table(depth: int) -> Any:
        if depth == 0 or draw.random() < 0.4:
            return draw.choice(values)
        return {key: table(depth - 1) for key in draw.sample(["a", "b", "c d"], draw.randint(0, 3))}

    lost = written = 0
    for _ in range(300):
        before = {key: table(3) for key in draw.sample("pqrs", draw.randint(0, 4))}
        after = {key: before.get(key) if draw.random() < 0.5 else table(3) for key in draw.sample("pqrs", draw.randint(0, 4))}
        after = {key: value for key, value in after.items() if value is not None}
        text = patched(toml_text(before), before, after)
        if text is None:
            lost += 1
        else:
            assert tomllib.loads(text) == after, (before, after)
            written += 1
    assert written > 200 > 4 * lost


def test_an_edited_scene_keeps_the_comments_of_its_file():
    opened = scene.load("cam-measured")
    assert opened.text.count("#") == 1
    draft = Draft.of(opened)
    stiff = next(p for p in find_parameters(opened) if p.key == "loads.return_spring.stiffness")
    draft = draft.with_value(stiff.path, stiff.written(3.5)).with_effect("gravity", False)
    edited = draft.scene()
    text = updated_text(opened, edited)
    assert text is not None and loads(text, folder=GALLERY_FOLDER) == edited != opened
    assert 'tolerance = "0.004 mm"    # root mean square, the scatter of the machine' in text
    assert 'stiffness = "3.5 N/mm"' in text and 'effects = ["inertia"]' in text
    old, new = opened.text.splitlines(), text.splitlines()
    assert len(old) == len(new) and sum(a != b for a, b in zip(old, new, strict=True)) == 2
    assert updated_text(edited, opened) is not None, "a scene that comes from no file has a text too"
    assert updated_text(opened, opened) == opened.text


def test_a_scene_that_says_joints_keeps_saying_so():
    text = scene.load("crank-rocker").text.replace("[joints]", "[pairs]  # as in older files")
    opened = loads(text, "crank-rocker", GALLERY_FOLDER)
    kept = updated_text(opened, opened.changed({("joints", "A", "drive", "speed"): "30 rpm"}))
    assert kept == text.replace("60 rpm", "30 rpm")
