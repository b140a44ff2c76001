"""Error estimates see a discontinuity of a coordinate, whoever made it: in the frames, and in a force that jumps."""

from __future__ import annotations

import numpy as np
import pytest

import mechviz
from mechcore.branches.unwrapped import LinkAngles
from mechcore.effects.springs import AngleSpring
from mechviz.accuracy.estimate import estimate_errors, lost_turns
from mechviz.runs import run_scene

SWINGING = """
effects = ["inertia"]
[links]
frame  = { points = { O = [0, 0], G = [0, 0] } }
crank  = { points = { O = [0, 0], B = [0.15, 0] }, mass = 1.0, centre = [0.075, 0], inertia = 0.002 }
rod    = { points = { B = [0, 0], C = [0.1, 0] }, mass = 0.5, centre = [0.05, 0], inertia = 0.001 }
piston = { points = { C = [0, 0] }, mass = 0.3 }
[joints]
O = { revolute = ["frame", "crank"], free = { position = 0.35, speed = -9.0 } }
B = { revolute = ["crank", "rod"] }
C = { revolute = ["rod", "piston"] }
S = { prismatic = ["frame", "piston"], at = ["G", "C"], along = [1, 0], branch = "behind" }
[loads]
spring = { torsion_spring = ["frame", "rod"], stiffness = 2.0, free_angle = -2.4 }
[run]
frames = 60
duration = 0.4
"""


class Jumping(LinkAngles):
    """Angles of which one loses a turn half way."""

    def __init__(self, angles: LinkAngles, k: int):
        super().__init__(angles.model, angles.start, angles._raw, angles._near)
        self.jumping = k

    def link(self, k: int) -> np.ndarray:
        result = super().link(k)
        jump = np.arange(len(result)) > len(result) // 2
        return result - 2.0 * np.pi * jump if k == self.jumping else result


def test_a_lost_turn_in_the_frames_is_seen_from_there_on():
    run = run_scene(mechviz.load("crank-rocker"))
    assert not lost_turns(run.motion).any()
    assert estimate_errors(run).worst()["position"] < 1e-12
    run.motion.angles = Jumping(run.motion.angles, run.motion.model.index["coupler"])
    half = run.motion.frames // 2
    position = estimate_errors(run).position
    assert position[: half + 1].max() < 1e-12 and position[half + 1 :].min() > 6.2


@pytest.mark.parametrize("method", ["auto", "gauss"])
def test_a_force_that_jumps_with_its_angle_is_seen(method, monkeypatch):
    """A torsion spring that reads its angle within half a turn of the world's axis, in the table of the motion as well."""
    scene = mechviz.loads(SWINGING + f'method = "{method}"\n')
    assert estimate_errors(run_scene(scene)).worst()["position"] < 1e-6

    def wrapped(self: AngleSpring, at) -> np.ndarray:
        turned = np.angle(at.rotation(at.model.index["rod"]))
        return turned - self.load.free_angle

    monkeypatch.setattr(AngleSpring, "_turned", wrapped)
    assert estimate_errors(run_scene(scene)).worst()["position"] > 1e-2


def test_runs_of_few_frames_and_fast_links_are_not_suspected():
    for frames in (2, 5, 12):
        run = run_scene(mechviz.load("crank-rocker"), frames=frames)
        assert not lost_turns(run.motion).any()
