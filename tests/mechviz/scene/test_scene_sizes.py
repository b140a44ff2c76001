"""Large scenes and many faults: costs grow no faster than the scene, and nobody has to read a thousand lines."""

from __future__ import annotations

import time

import numpy as np
import pytest

from mechcore.errors import MechanismError
from mechcore.motion import events, structure
from mechcore.motion.events import strokes
from mechcore.motion.structure import rank_mobility
from mechviz.runs import run_scene
from mechviz.scene.scene import load, loads

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


def four_bars(count: int) -> str:
    """Four-bars side by side, each with its own drive; the rocker of each swings."""
    places = ", ".join(f"A{k} = [{200 * k}, 0], D{k} = [{200 * k + 100}, 0]" for k in range(count))
    links, joints = [f"frame = {{ points = {{ {places} }} }}"], []
    for k in range(count):
        for link, start, end, length in (("a", "A", "B", 30), ("b", "B", "C", 90), ("c", "D", "C", 70)):
            links.append(f"{link}{k} = {{ points = {{ {start}{k} = [0, 0], {end}{k} = [{length}, 0] }} }}")
        joints.append(f'A{k} = {{ revolute = ["frame", "a{k}"], drive = {{ speed = "1 rpm", start = {10 * k} }} }}')
        joints.append(f'B{k} = {{ revolute = ["a{k}", "b{k}"] }}')
        joints.append(f'C{k} = {{ revolute = ["b{k}", "c{k}"], side = "left" }}')
        joints.append(f'D{k} = {{ revolute = ["frame", "c{k}"] }}')
    return "\n".join([TRIAD, "[links]", *links, "[joints]", *joints, "[run]", "frames = 180"])


def test_the_rank_of_mechanisms_side_by_side_is_the_sum_of_theirs():
    assert rank_mobility(run_scene(loads(four_bars(12)), outputs=("positions",)).motion) == 12


@pytest.mark.parametrize("name", ["crank-rocker", "four-bar-chain", "ten-link", "scotch-yoke", "kinetostatic-four-bar"])
def test_large_parts_are_judged_by_their_groups_as_by_their_constraints(name, monkeypatch):
    motion = run_scene(load(name), frames=8, outputs=("positions",)).motion
    by_constraints = rank_mobility(motion)
    monkeypatch.setattr(structure, "MOST_TOGETHER", 0)
    monkeypatch.setattr(structure.np.linalg, "svd", None)  # is not asked
    assert rank_mobility(motion) == by_constraints


def test_limit_positions_between_the_frames_are_those_that_are_solved_for(monkeypatch):
    """The lengths of a four-bar, by the law of cosines: the rocker turns where crank and coupler lie in one line."""
    motion = run_scene(loads(four_bars(3)), outputs=("positions", "velocities", "accelerations")).motion
    solved = strokes(motion)
    monkeypatch.setattr(events, "MOST_SOLVED", 0)
    for one, other in zip(solved, strokes(motion), strict=True):
        assert one.joint == other.joint
        low, high = (np.arccos((100.0**2 + 70.0**2 - reach**2) / (2.0 * 100.0 * 70.0)) for reach in (90.0 - 30.0, 90.0 + 30.0))
        assert one.length == pytest.approx(high - low, rel=1e-12)
        assert other.length == pytest.approx(high - low, rel=1e-10)


def test_of_thousands_of_unknown_keys_some_are_told_and_all_are_counted():
    text = "\n".join(f"key{k} = {k}" for k in range(20_000)) + "\n" + chain(2)
    start = time.process_time()
    with pytest.raises(MechanismError) as error:
        loads(text)
    lines = str(error.value).splitlines()
    assert time.process_time() - start < 15.0
    assert len(error.value.faults) == 20_000 and "20000 problems" in lines[0]
    assert len(lines) < 250 and "19950 more" in lines[-1]
