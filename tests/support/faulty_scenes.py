"""A sound scene with some of its values changed, and the faults that are told of it."""

from __future__ import annotations

import json
from typing import Any

import pytest

from mechcore.errors import Fault
from mechviz.scene.faults import SceneError
from mechviz.scene.scene import Scene

REMOVED = object()


BASE: dict[str, Any] = {
    "units": {"length": "mm", "angle": "deg"},
    "trace": ["E"],
    "links": {
        "frame": {"points": {"A": [0, 0], "D": [200, 0]}},
        "crank": {"points": {"A": [0, 0], "B": [60, 0]}, "mass": 0.4},
        "coupler": {"points": {"B": [0, 0], "C": [180, 0], "E": [90, 70]}},
        "rocker": {"points": {"D": [0, 0], "C": [150, 0]}},
    },
    "joints": {
        "A": {"revolute": ["frame", "crank"], "drive": {"speed": "60 rpm"}},
        "B": {"revolute": ["crank", "coupler"]},
        "C": {"revolute": ["coupler", "rocker"], "side": "left"},
        "D": {"revolute": ["rocker", "frame"]},
    },
    "loads": {"P": {"force": [1, 2], "on": "rocker", "at": "C"}, "M": {"torque": 5, "on": "crank"}},
}


def changed(*changes: tuple[str, Any]) -> dict[str, Any]:
    """The sound scene with values changed, each at a path such as ``links/crank/mass``."""
    data = json.loads(json.dumps(BASE))
    for path, value in changes:
        *parents, key = path.split("/")
        table = data
        for part in parents:
            table = table.setdefault(part, {})
        if value is REMOVED:
            del table[key]
        else:
            table[key] = value
    return data


def faults_of(data: dict[str, Any]) -> tuple[Fault, ...]:
    with pytest.raises(SceneError) as error:
        Scene.build(name="x", **data)
    return error.value.faults
