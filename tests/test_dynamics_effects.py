"""Every effect in forward dynamics: works against potentials, losses, balances, tables read at their arguments."""

from __future__ import annotations

import numpy as np
import pytest

import mechviz
from mechcore.dynamics import simulate

FOUR_BAR = """
units = { length = "mm", angle = "deg" }
effects = ["inertia", "gravity"]
run = { duration = "0.3 s", tolerance = 1e-8 }
[links]
frame = { points = { A = [0, 0], D = [200, 0], H = [40, 160] } }
crank = { points = { A = [0, 0], B = [60, 0] }, mass = "1.4 kg", centre = [20, 5], inertia = "0.004 kg m^2" }
coupler = { points = { B = [0, 0], C = [180, 0], E = [90, 70] }, mass = "0.8 kg", centre = [90, 20], inertia = "0.003 kg m^2" }
rocker = { points = { D = [0, 0], C = [150, 0] }, mass = "0.9 kg", centre = [60, 0], inertia = "0.002 kg m^2" }
[pairs]
A = { revolute = ["frame", "crank"], free = { position = 40, speed = "90 rpm" } }
B = { revolute = ["crank", "coupler"] }
C = { revolute = ["coupler", "rocker"], side = "left" }
D = { revolute = ["rocker", "frame"] }
[loads]
"""


@pytest.mark.parametrize("moment", [1.5, -1.5])
def test_a_motion_that_turns_back_once_goes_on_the_other_way(moment: float):
    """By its energy: a torque brings it to rest and then drives it through turn after turn, as in steps of time."""
    text = FOUR_BAR + f'push = {{ torque = "{moment} N m", on = "coupler", against = "crank" }}\n'
    mechanism = mechviz.loads(text).mechanism
    found, steps = simulate(mechanism, 0.3), simulate(mechanism, 0.3, method="gauss", tolerance=1e-11)
    assert found.method == "energy"
    t = np.linspace(0.0, 0.3, 61)
    assert np.abs(found(t)[0]).max() > 2 * np.pi
    for ours, theirs in zip(found(t)[:2], steps(t)[:2], strict=True):
        assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-9)
