"""Levers that rest and lids that stay: the drift and the effort are those of the links, whatever found them."""

from __future__ import annotations

import numpy as np
import pytest

from mechcore.design.dwells import dwell_linkages
from mechcore.design.springs import LidTask, lid_springs
from mechcore.errors import MechanismError

LID = LidTask(12.0, 0.3, 0.55, 0.0, np.radians(80), 0.25)


@pytest.mark.parametrize("pushes", [False, True])
def test_springs_carry_the_lid(pushes):
    task = LidTask(**{**vars(LID), "pushes": pushes})
    best = lid_springs(task)[0]
    theta = np.linspace(task.start, task.end, 9)
    alone = task.mass * task.gravity * task.arm / task.hand
    assert best.error < 0.05 * alone

    # the hand's force is the slope of the potential energy over the hand's way
    def energy(angle):
        return (
            task.mass * task.gravity * task.arm * np.sin(angle)
            + 0.5 * best.stiffness * (best.lengths(angle) - best.free_length) ** 2
        )

    h = 1e-5
    assert best.effort(task, theta) == pytest.approx(
        (energy(theta + h) - energy(theta - h)) / (2 * h * task.hand), abs=1e-5 * alone
    )
    part = best.lengths(theta) / best.free_length
    assert (part <= 1.001).all() and (part >= 0.499).all() if pushes else (part >= 0.999).all() and (part <= 1.801).all()
    assert abs(best.lid_point) <= task.box * 1.0001 and abs(best.frame_point.real) <= task.box


def test_a_wanted_effort_is_kept():
    best = lid_springs(LidTask(**{**vars(LID), "effort": 15.0}))[0]
    efforts = best.effort(LID, np.linspace(LID.start, LID.end, 41))
    assert abs(efforts - 15.0).max() == pytest.approx(best.error, rel=1e-9)
    assert best.error < 5.0


@pytest.mark.parametrize(("dwell", "swing"), [(0.0, 0.5), (5.0, 0.5), (1.0, 2.0)])
def test_dwells_that_nobody_can_have_are_refused(dwell, swing):
    with pytest.raises(MechanismError):
        dwell_linkages(dwell, swing)


def test_lids_that_are_none_are_refused():
    with pytest.raises(MechanismError, match="mass"):
        LidTask(0.0, 0.3, 0.5, 0.0, 1.0, 0.2)
    with pytest.raises(MechanismError, match="turn"):
        LidTask(1.0, 0.3, 0.5, 1.0, 1.0, 0.2)
