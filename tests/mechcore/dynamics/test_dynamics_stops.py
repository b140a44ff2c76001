"""End stops at pairs whose coordinates depend on several others, prescribed drives among them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dynamic_mechanisms import double_pendulum, swinging_five_bar
from mechanisms import case

from mechcore.dynamics.contact.impacts import impact, jacobian_at, rates_at
from mechcore.dynamics.energy_account import kinetic_energy_of
from mechcore.dynamics.equations.chart import Chart
from mechcore.dynamics.equations.reduced import constrained, motion_at
from mechcore.dynamics.events import Stop
from mechcore.dynamics.simulate import simulate
from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.solve import compile_mechanism
from mechcore.spec.mechanism import Drive, Mechanism


def half_driven(speed: float = 0.8) -> Mechanism:
    """A five-bar whose left arm turns at a prescribed speed; the right one swings freely on its spring."""
    body = swinging_five_bar(stiffness=1.0)
    return replace(body, drives=(Drive(pair="A", law=ConstantSpeed(2.2, speed, 4.0)), body.drives[1]))


def coordinate(compiled, pair: str, q, t) -> np.ndarray:
    q = np.asarray(q, float)
    return motion_at(compiled, q, np.zeros_like(q), np.asarray(t, float)).coordinate(pair)[:, 0]


@pytest.mark.parametrize("pair", ["B", "C", "E"])
def test_rates_of_a_stop_are_those_of_finite_differences(pair: str):
    """Along the motion itself, and in the free coordinate alone, the drive standing still."""
    compiled = compile_mechanism(half_driven())
    q, v, t, h = np.array([0.9]), np.array([3.0]), 0.1, 1e-4
    system = Chart(compiled)
    a = system(q[None], v[None], np.array([t]))[0]
    x = coordinate(compiled, pair, [q - h * v + 0.5 * h * h * a, q, q + h * v + 0.5 * h * h * a], [t - h, t, t + h])
    rate, second = rates_at(compiled, system, pair, q, v, t)
    assert rate == pytest.approx((x[2] - x[0]) / (2 * h), rel=1e-6)
    assert second == pytest.approx((x[2] - 2 * x[1] + x[0]) / h**2, rel=1e-5)
    x = coordinate(compiled, pair, [q - h, q + h], [t, t])
    assert jacobian_at(compiled, [pair], q, v, t)[0, 0] == pytest.approx((x[1] - x[0]) / (2 * h), rel=1e-6)


@pytest.mark.parametrize(("pair", "restitution"), [("B", 0.5), ("C", 0.0), ("C", 0.7)])
def test_a_stop_at_a_pair_that_a_prescribed_drive_moves_as_well(pair: str, restitution: float):
    """The stop turns its own coordinate back and holds that, while the drive goes on; works close."""
    compiled = compile_mechanism(half_driven())
    loose = simulate(compiled, 1.0, tolerance=1e-10)
    at = loose.motion(np.linspace(0.0, 1.0, 400)).coordinate(pair)[:, 0]
    limit = float(at[0] + 0.4 * (at.max() - at[0]))
    found = simulate(compiled, 1.0, tolerance=1e-10, stops=[Stop(name="s", pair=pair, at=limit, restitution=restitution)])
    kinds = [h.kind for h in found.events]
    assert "impact" in kinds and ("contact" in kinds) == (restitution == 0.0)
    assert found.motion(np.linspace(0.0, 1.0, 400)).coordinate(pair)[:, 0].max() < limit + 1e-9
    first = next(h.time for h in found.events if h.kind == "impact")
    before, after = (found.motion([first + s * 1e-9]).coordinate(pair)[0, 1] for s in (-1, 1))
    assert after == pytest.approx(-restitution * before, rel=1e-5, abs=1e-6)
    if restitution == 0.0:
        end = next((h.time for h in found.events if h.kind == "release"), 1.0)
        rest = found.motion(np.linspace(first + 1e-6, end - 1e-6, 50))
        assert np.ptp(rest.coordinate(pair)[:, 0]) < 1e-9
        assert np.ptp(rest.coordinate("E")[:, 0]) > 1e-3  # what is free goes on moving
        forces = found.forces(rest)
        assert np.abs(forces.effort("E")).max() < 1e-9 * np.abs(forces.loads["stop s"].values).max()
    assert np.abs(found.drift(np.linspace(0.0, 1.0, 100))).max() < 1e-8


def test_a_stop_holds_a_combination_of_two_free_coordinates():
    """The closing joint of a five-bar whose arms are both free."""
    compiled = compile_mechanism(swinging_five_bar(stiffness=1.0, speeds=(6.0, 2.0)))
    at = simulate(compiled, 0.5, tolerance=1e-9).motion(np.linspace(0.0, 0.5, 400)).coordinate("C")[:, 0]
    limit = float(at[0] + 0.5 * (at.max() - at[0]))
    found = simulate(compiled, 0.5, tolerance=1e-10, stops=[Stop(name="s", pair="C", at=limit)])
    first = next(h.time for h in found.events if h.kind == "contact")
    end = next((h.time for h in found.events if h.kind == "release"), 0.5)
    rest = found.motion(np.linspace(first + 1e-6, end - 1e-6, 50))
    assert np.ptp(rest.coordinate("C")[:, 0]) < 1e-9
    assert min(np.ptp(rest.coordinate(pair)[:, 0]) for pair in ("A", "E")) > 1e-4
    forces = found.forces(rest)
    assert max(np.abs(forces.effort(pair)).max() for pair in ("A", "E")) < 1e-9 * np.abs(forces.loads["stop s"].values).max()
    assert np.abs(found.drift(np.linspace(0.0, 0.5, 100))).max() < 1e-8


def test_what_rests_on_one_stop_stays_when_another_is_hit():
    """A bar that is all that moves loses 1 - e^2 of its energy; without the other stop the upper bar would be thrown back."""
    i = case("dynamics", "double-pendulum-rods")["inputs"]
    compiled = compile_mechanism(double_pendulum(i))
    q, v = np.array([0.3, -0.4]), np.array([0.0, 2.0])
    after, lost = impact(compiled, "J", ["O"], 0.4, 2.0, q, v, 0.0)
    assert after == pytest.approx([0.0, -0.8], abs=1e-14)
    kinetic = [float(kinetic_energy_of(motion_at(compiled, q[None], x[None], np.zeros(1)))[0]) for x in (v, after)]
    assert lost == pytest.approx(kinetic[0] - kinetic[1], rel=1e-12) and lost == pytest.approx(
        kinetic[0] * (1.0 - 0.4**2), rel=1e-12
    )
    free = impact(compiled, "J", [], 0.4, 2.0, q, v, 0.0)[0]
    assert free[1] == pytest.approx(-0.8) and abs(free[0]) > 0.1


def test_accelerations_and_what_holds_them_satisfy_the_bordered_equations():
    """M a = Q + G' p and G a + b = 0, the sign of p included; where one frame is singular, only that one is not a number."""
    rng = np.random.default_rng(3)
    root, g = rng.standard_normal((5, 4, 4)), rng.standard_normal((5, 2, 4))
    inertia, force, second = root @ root.swapaxes(1, 2) + np.eye(4), rng.standard_normal((5, 4)), rng.standard_normal((5, 2))
    a, p = constrained(inertia, force, g, second)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", inertia, a), force + np.einsum("nci,nc->ni", g, p), atol=1e-10)
    np.testing.assert_allclose(np.einsum("nci,ni->nc", g, a), -second, atol=1e-10)
    g[2] = 0.0
    again, _ = constrained(inertia, force, g, second)
    assert np.isnan(again[2]).all()
    np.testing.assert_allclose(np.delete(again, 2, axis=0), np.delete(a, 2, axis=0), rtol=1e-10)
