"""Large scenes and many faults: costs grow no faster than the scene, and nobody has to read a thousand lines."""

from __future__ import annotations

import time

import pytest

from mechcore.errors import MechanismError
from mechcore.motion.structure import rank_mobility
from mechviz.runs import run_scene
from mechviz.scene.scene import loads

TRIAD = 'units = { length = "mm", angle = "deg" }\n'


def chain(links: int) -> str:
    """An open chain of driven links."""
    lines = [TRIAD, "[links]", "frame = { points = { A0 = [0, 0] } }"]
    lines += [f"l{k} = {{ points = {{ A{k - 1} = [0, 0], A{k} = [10, 0] }} }}" for k in range(1, links + 1)]
    names = ["frame", *(f"l{k}" for k in range(1, links + 1))]
    lines += ["[joints]"]
    lines += [
        f'A{k} = {{ revolute = ["{names[k]}", "{names[k + 1]}"], drive = {{ speed = "1 rpm", start = 10 }} }}' for k in range(links)
    ]
    return "\n".join([*lines, "[run]", "frames = 12"])


def test_a_long_chain_of_drives_costs_little():
    """Its freedoms are counted without a matrix of all its constraints, which for these takes half a minute."""
    scene = loads(chain(600))
    start = time.process_time()
    motion = run_scene(scene, outputs=("positions",)).motion
    assert rank_mobility(motion) == 600
    assert time.process_time() - start < 10.0


def test_of_thousands_of_unknown_keys_some_are_told_and_all_are_counted():
    text = "\n".join(f"key{k} = {k}" for k in range(20_000)) + "\n" + chain(2)
    start = time.process_time()
    with pytest.raises(MechanismError) as error:
        loads(text)
    lines = str(error.value).splitlines()
    assert time.process_time() - start < 15.0
    assert len(error.value.faults) == 20_000 and "20000 problems" in lines[0]
    assert len(lines) < 250 and "19950 more" in lines[-1]
