"""Scenes that once gave wrong numbers, against the second formulation (absolute coordinates and multipliers)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from random_mechanisms import Case
from test_second_formulation import UNDER_FORCES, WELL, compare, worst

from mechviz.runs import run_scene
from mechviz.scene.scene import load

SCENES = sorted((Path(__file__).parents[2] / "reference" / "scenes").glob("*.toml"))


@pytest.mark.sample(2)
@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_a_scene_once_wrong_agrees_with_the_second_formulation(path: Path) -> None:
    scene = load(path)
    motion, mechanism, simulation = run_scene(scene).motion, scene.mechanism, scene.simulation
    poses = {link.name: tuple(map(float, motion.pose(link.name)[0])) for link in mechanism.links}
    start = {joint.name: float(motion.coordinate(joint.name)[0, 0]) for joint in mechanism.joints}
    time = np.linspace(0.0, motion.time[-1], 41)
    case = Case("reported", 0, mechanism, time, start, poses, simulation.stops if simulation else ())
    deviations, condition = compare(case)
    name, deviation = worst(deviations)
    assert deviation <= UNDER_FORCES * max(1.0, condition / WELL) ** 2, name
