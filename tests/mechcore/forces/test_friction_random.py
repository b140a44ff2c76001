"""Random mechanisms with random friction, below and above jamming."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import examples
from frictional import law_of_friction, rub
from hypothesis import given, settings
from hypothesis import strategies as st
from loaded import loaded
from mechanisms import load
from random_linkages import ACCELERATION, ANGLES, SPEED, balance_of_links, crank_rockers, six_bars, slider_crank, slider_cranks

from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.mechanism import Belt, Friction, Mechanism, Revolute


@st.composite
def frictions(draw, mechanism: Mechanism) -> Mechanism:
    """Some or all joints with friction; radii and lengths in the size of the cranks (1 m)."""
    result = {}
    for joint in mechanism.joints:
        if isinstance(joint, Belt) or not draw(st.booleans()):
            continue
        mu = draw(st.floats(0.01, 1.5))
        if isinstance(joint, Revolute):
            result[joint.name] = Friction(coefficient=mu, radius=draw(st.floats(0.01, 0.5)))
        else:
            result[joint.name] = Friction(coefficient=mu, length=draw(st.sampled_from([0.0, 0.2, 1.0])))
    return rub(mechanism, **result) if result else mechanism


def at(mechanism: Mechanism, frames: np.ndarray) -> Forces:
    """Forces at some of the frames alone, at the times that they have."""
    rows = np.flatnonzero(frames)
    drive = ANGLES[rows], np.full(len(rows), SPEED), np.full(len(rows), ACCELERATION)
    return solve_forces(solve_motion(compile_mechanism(mechanism), rows, drives={mechanism.drives[0].joint: drive}))


def check(mechanism: Mechanism) -> None:
    forces = load(mechanism, ANGLES, SPEED, ACCELERATION)
    friction = forces.friction
    if friction is None:
        return
    jammed = friction.jammed
    assert np.isnan(forces.effort("A" if "A" in forces.motion.model.joint_index else "O")[jammed]).all()
    assert np.nanmax(friction.residual, initial=0.0) < 1e-11
    for joint in friction.joints:
        assert np.nanmin(friction.losses(joint), initial=0.0) >= 0.0
    if jammed.all():
        return
    assert all(friction.jammed_by(f) for f in np.flatnonzero(jammed))
    assert law_of_friction(forces) < 1e-9
    free = ~jammed
    sound = at(mechanism, free)  # frames do not know of each other
    assert not sound.friction.jammed.any()
    assert np.abs(sound.power_balance).max() <= 1e-9
    assert balance_of_links(sound) <= 1e-9
    # the drives pay for the friction, no more and no less
    dry = tuple(e for e in mechanism.effects if e != "friction")
    without = at(replace(mechanism, effects=dry), free)
    extra = sound.power_supplied - without.power_supplied
    scale = max(np.abs(sound.power_supplied).max(), np.abs(without.power_supplied).max())
    assert np.abs(extra + sound.friction.power).max() <= 1e-9 * scale


def test_a_jam_that_begins_where_the_guide_tilts_over_names_its_joint() -> None:
    """The larger of the two edge forces changes its edge there: below the jam the larger one does not grow with friction."""
    crank = slider_crank(r=1.0, l=1.5, bodies={"piston": (1.0, (0.0, 1.0), 0.0)}, effects=("inertia", "gravity", "friction"))
    friction = load(rub(crank, S=Friction(coefficient=1.5, length=0.2)), ANGLES, SPEED, ACCELERATION).friction
    assert friction is not None and friction.jammed.sum() == 25
    assert all(friction.jammed_by(f) == ("S",) for f in np.flatnonzero(friction.jammed))


@pytest.mark.parametrize("length", [1.0625, 2.0])
def test_a_joint_that_carries_little_is_solved_as_one_that_carries_much(length: float) -> None:
    """A rod of 1e-11 kg at a crank of 1 kg jams where it jams at a crank without mass, and its pin presses as hard."""

    def run(crank: float) -> Forces:
        bodies = {"crank": (crank, (0.0, 0.0), 0.0), "rod": (1e-11, (0.0, 0.0), 0.0)}
        mechanism = slider_crank(r=1.0, l=length, bodies=bodies, effects=("inertia", "gravity"))
        pin = Friction(coefficient=1.0, radius=0.5)
        return load(rub(mechanism, O=pin, B=pin), ANGLES, SPEED, ACCELERATION)

    heavy, light = run(1.0), run(0.0)
    np.testing.assert_array_equal(heavy.friction.jammed, light.friction.jammed)
    np.testing.assert_allclose(heavy.friction.normal_load("B"), light.friction.normal_load("B"), rtol=1e-9)
    assert law_of_friction(heavy) < 1e-9


@settings(max_examples=examples(40))
@given(st.data(), crank_rockers())
def test_crank_rockers(data, mechanism):
    check(data.draw(frictions(mechanism)))


@settings(max_examples=examples(40))
@given(st.data(), slider_cranks())
def test_slider_cranks(data, mechanism):
    check(data.draw(frictions(mechanism)))


@settings(max_examples=examples(30))
@given(st.data(), six_bars())
def test_six_bars(data, mechanism):
    check(data.draw(frictions(mechanism)))


@settings(max_examples=examples(25))
@given(st.data(), loaded(slider_cranks()))
def test_slider_cranks_with_every_effect(data, mechanism):
    """Some of every effect and load of the registry (`test_effects.loads` sees to that), with dry friction in random joints."""
    check(data.draw(frictions(mechanism)))


@settings(max_examples=examples(25))
@given(st.data(), loaded(crank_rockers()))
def test_crank_rockers_with_every_effect(data, mechanism):
    check(data.draw(frictions(mechanism)))
