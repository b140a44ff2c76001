"""Properties that hold for every mechanism: random ones, valid by construction."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from mechanisms import load, slider_crank
from random_linkages import (
    ACCELERATION,
    ANGLES,
    SPEED,
    balance_of_links,
    crank_rockers,
    six_bars,
    slider_cranks,
)

from mechcore.forces.kinetostatics import solve_forces
from mechcore.spec.loads import Force
from mechcore.spec.mechanism import Mechanism


def check(mechanism: Mechanism) -> None:
    forces = load(mechanism, ANGLES, SPEED, ACCELERATION)
    m = forces.motion
    assert m.closure.max() <= 1e-12 * m.model.length_scale
    assert np.abs(forces.power_balance).max() <= 1e-9
    assert balance_of_links(forces) <= 1e-9


@given(crank_rockers())
def test_crank_rockers_close_balance_and_conserve_power(mechanism):
    check(mechanism)


@given(slider_cranks())
def test_slider_cranks_close_balance_and_conserve_power(mechanism):
    check(mechanism)


@given(six_bars())
def test_six_bars_close_balance_and_conserve_power(mechanism):
    check(mechanism)


@given(crank_rockers())
def test_velocities_and_accelerations_are_derivatives_of_poses(mechanism):
    """Central differences of order 4 with falling steps: the error falls at that order, so the derivative is the exact one."""
    errors = []
    for h in (1e-2, 2.5e-3, 6.25e-4):
        theta = 1.0 + h * np.arange(-2, 3)
        m = load(mechanism, theta, 1.0, 0.0).motion
        weights = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / (12.0 * h)
        error = 0.0
        for link in ("coupler", "rocker"):
            for lower, higher in ((m.pose(link), m.velocity(link)), (m.velocity(link), m.acceleration(link))):
                scale = np.abs(higher).max() + np.abs(lower).max()
                error = max(error, np.abs(weights @ lower - higher[2]).max() / scale)
        errors.append(error)
    assert errors[2] < 1e-9 or errors[2] < errors[0] / 1000.0, errors  # 65,536 times smaller, in the limit


def test_forces_are_linear_in_the_loads():
    from dataclasses import replace

    m = slider_crank(r=1.0, l=3.0, loads=(Force(name="F", link="piston", point="C", vector=(3.0, 1.0)),))
    twice = replace(m, loads=(replace(m.loads[0], vector=(6.0, 2.0)),))
    one, two = load(m, ANGLES), load(twice, ANGLES)
    for joint in ("O", "B", "C", "S"):
        np.testing.assert_allclose(two.reaction(joint), 2.0 * one.reaction(joint), rtol=1e-13, atol=1e-13)


def test_naming_no_effect_computes_no_forces_from_masses():
    m = slider_crank(r=1.0, l=3.0, bodies={"rod": (5.0, (1.0, 0.0), 1.0)})
    forces = solve_forces(load(m, ANGLES).motion)
    assert forces.applied == ()
    assert np.abs(forces.effort("O")).max() == 0.0
