"""Scenes of the gallery, spoilt at random: a reader that meets them gives a scene or a report, never anything else."""

from __future__ import annotations

import copy
import random
import tomllib
from typing import Any

import pytest

from mechviz.scene.faults import SceneError
from mechviz.scene.folder import GALLERY_FOLDER, gallery
from mechviz.scene.scene import Scene

VALUES: list[Any] = [
    5, -1, 0, True, False, "text", "", [], {}, [[]], [{}], {"a": 1}, [1, 2], ["a", "b"], 1e300, -1e300, float("nan"),
    float("inf"), 10**400, "60 rpm", "5 mm", "1e999 kg", "ü/ö", "\ud800", "a" * 200, [1, 2, 3], ["A", 5], {"points": {}},
    "nan", "inf m", 1e-320, "1e-300 mm", [0, 0], ["A", "A"], "frame", "left",
]  # fmt: skip
KEYS = ["x", "mass", "side", "drive", "at", "along", "table", "revolute", "prismatic", "gear", "force", "torque", "start", "zones"]
SCENES = [tomllib.loads(entry.path.read_text(encoding="utf-8")) for entry in gallery()]


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(place for key, item in inner for place in places(item, (*path, key)))]


def inside(value: Any, path: tuple[Any, ...]) -> Any:
    for part in path:
        value = value[part]
    return value


def spoilt(rng: random.Random, raw: dict[str, Any]) -> dict[str, Any]:
    """A copy with up to eight places removed, replaced, misspelt, copied from elsewhere, or added."""
    raw = copy.deepcopy(raw)
    for _ in range(rng.choice([1, 1, 2, 3, 8])):
        result = [place for place in places(raw) if place]
        if not result:
            break
        *parents, key = rng.choice(result)
        table, way = inside(raw, tuple(parents)), rng.randrange(6)
        if way == 0:
            del table[key]
        elif way in (1, 2):
            table[key] = copy.deepcopy(rng.choice(VALUES))
        elif way == 3 and isinstance(key, str):
            table[key[:1] + key[2:] + rng.choice(["", "x"])] = table.pop(key)
        elif way == 4:
            table[key] = copy.deepcopy(inside(raw, rng.choice(result)))
        elif isinstance(table, dict):
            table[rng.choice(KEYS)] = copy.deepcopy(rng.choice(VALUES))
    return raw


@pytest.mark.sample(3)
@pytest.mark.parametrize("part", range(8))
def test_a_spoilt_scene_gives_a_scene_or_a_report(part):
    reports = 0
    for seed in range(60 * part, 60 * part + 60):
        rng = random.Random(seed)
        raw = spoilt(rng, rng.choice(SCENES))
        try:
            Scene.build(name="x", folder=GALLERY_FOLDER, **raw)
        except SceneError as error:
            reports += 1
            text = str(error)
            assert error.faults and all(fault.path and fault.message[-1] in ".?" for fault in error.faults), (seed, text)
            assert "something else" not in text and "nan m" not in text, (seed, text)
    assert reports > 30


def test_a_long_chain_with_a_fault_in_every_link_is_reported_in_bearable_time():
    """What takes the square of the number of links would take minutes here."""
    n = 1500
    links: dict[str, Any] = {f"l{k}": {"points": {f"P{k}": [0, 0], f"P{k + 1}": [1, 0]}, "mas": 1} for k in range(n)}
    links["frame"] = {"points": {"A": [0, 0]}}
    joints: dict[str, Any] = {f"P{k}": {"revolute": [f"l{k - 1}", f"l{k}"]} for k in range(1, n)}
    joints["A"] = {"revolute": ["frame", "l0"], "at": ["A", "P0"], "drive": {"speed": "60 rpm"}}
    for k in range(1, n, 10):
        joints[f"P{k}"]["revolute"][0] = f"zz{k}"  # as like the wrong link as the right one
    with pytest.raises(SceneError) as error:
        Scene.build(name="x", links=links, joints=joints)
    paths = [fault.path for fault in error.value.faults]
    assert len(paths) == n + len(range(1, n, 10))
    assert all(path.startswith("links.l") or path.endswith("revolute[0]") for path in paths)


def test_the_range_of_a_drive_at_rest_is_a_report():
    data = copy.deepcopy(next(raw for raw in SCENES if raw["title"].startswith("Crank")))
    name = next(key for key, joint in data["joints"].items() if "drive" in joint)
    data["joints"][name]["drive"] = {"speed": 0, "range": [0, 5]}
    with pytest.raises(SceneError, match="stands still"):
        Scene.build(**data)
