"""End stops at joints whose coordinates depend on several others, prescribed drives among them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dynamic_mechanisms import double_pendulum, pendulum, swinging_five_bar
from mechanisms import case

import mechviz
from mechcore.dynamics.contact.end_stops import impact
from mechcore.dynamics.equations.charts import Chart, jacobian_of
from mechcore.dynamics.equations.reduced import constrained, motion_at, moving, reduce
from mechcore.dynamics.events import EndStop, EventTrigger
from mechcore.dynamics.simulate import simulate
from mechcore.laws.signals import Step
from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.solve import compile_mechanism
from mechcore.spec.loads import Factor, Torque
from mechcore.spec.mechanism import Drive, Mechanism


def half_driven(speed: float = 0.8) -> Mechanism:
    """A five-bar whose left arm turns at a prescribed speed; the right one swings freely on its spring."""
    body = swinging_five_bar(stiffness=1.0)
    return replace(body, drives=(Drive(joint="A", law=ConstantSpeed(2.2, speed, 4.0)), body.drives[1]))


def ball(height: float) -> Mechanism:
    """A mass that falls along an upright guide."""
    text = f"""
effects = ["inertia", "gravity"]
run = {{ duration = 1 }}
[links]
frame = {{ points = {{ S = [0, 0] }} }}
ball = {{ points = {{ S = [0, 0] }}, mass = 1, shape = "point" }}
[joints]
S = {{ prismatic = ["frame", "ball"], along = [0, 1], free = {{ position = {height} }} }}
"""
    return mechviz.loads(text).mechanism


def coordinate(compiled, joint: str, q, t) -> np.ndarray:
    q = np.asarray(q, float)
    return motion_at(compiled, q, np.zeros_like(q), np.asarray(t, float)).coordinate(joint)[:, 0]


@pytest.mark.parametrize("joint", ["B", "C", "E"])
def test_rates_of_a_stop_are_those_of_finite_differences(joint: str):
    """Along the motion itself, and in the free coordinate alone, the drive standing still."""
    compiled = compile_mechanism(half_driven())
    q, v, t, h = np.array([0.9]), np.array([3.0]), 0.1, 1e-4
    system = Chart(compiled)
    a = system(q[None], v[None], np.array([t]))[0]
    x = coordinate(compiled, joint, [q - h * v + 0.5 * h * h * a, q, q + h * v + 0.5 * h * h * a], [t - h, t, t + h])
    row = q[None], v[None], np.array([t])
    rate, second = motion_at(compiled, *row, a[None]).coordinate(joint)[0, 1:]
    assert rate == pytest.approx((x[2] - x[0]) / (2 * h), rel=1e-6)
    assert second == pytest.approx((x[2] - 2 * x[1] + x[0]) / h**2, rel=1e-5)
    x = coordinate(compiled, joint, [q - h, q + h], [t, t])
    assert jacobian_of(*moving(compiled, *row), [joint])[0][0, 0, 0] == pytest.approx((x[1] - x[0]) / (2 * h), rel=1e-6)


@pytest.mark.parametrize(("joint", "restitution"), [("B", 0.5), ("C", 0.0), ("C", 0.7)])
def test_a_stop_at_a_joint_that_a_prescribed_drive_moves_as_well(joint: str, restitution: float):
    """The stop turns its own coordinate back and holds that, while the drive goes on; works close."""
    compiled = compile_mechanism(half_driven())
    loose = simulate(compiled, 1.0, tolerance=1e-10)
    at = loose.motion(np.linspace(0.0, 1.0, 400)).coordinate(joint)[:, 0]
    limit = float(at[0] + 0.4 * (at.max() - at[0]))
    simulation = simulate(compiled, 1.0, tolerance=1e-10, stops=[EndStop(name="s", joint=joint, at=limit, restitution=restitution)])
    kinds = [h.kind for h in simulation.events]
    assert "impact" in kinds and ("contact" in kinds) == (restitution == 0.0)
    assert simulation.motion(np.linspace(0.0, 1.0, 400)).coordinate(joint)[:, 0].max() < limit + 1e-9
    first = next(h.time for h in simulation.events if h.kind == "impact")
    before, after = (simulation.motion([first + s * 1e-9]).coordinate(joint)[0, 1] for s in (-1, 1))
    assert after == pytest.approx(-restitution * before, rel=1e-5, abs=1e-6)
    if restitution == 0.0:
        end = next((h.time for h in simulation.events if h.kind == "release"), 1.0)
        rest = simulation.motion(np.linspace(first + 1e-6, end - 1e-6, 50))
        assert np.ptp(rest.coordinate(joint)[:, 0]) < 1e-9
        assert np.ptp(rest.coordinate("E")[:, 0]) > 1e-3  # what is free goes on moving
        forces = simulation.forces(rest)
        assert np.abs(forces.effort("E")).max() < 1e-9 * np.abs(forces.loads["stop s"].values).max()
    assert np.abs(simulation.drift(np.linspace(0.0, 1.0, 100))).max() < 1e-8


def test_a_stop_holds_a_combination_of_two_free_coordinates():
    """The closing joint of a five-bar whose arms are both free."""
    compiled = compile_mechanism(swinging_five_bar(stiffness=1.0, speeds=(6.0, 2.0)))
    at = simulate(compiled, 0.5, tolerance=1e-9).motion(np.linspace(0.0, 0.5, 400)).coordinate("C")[:, 0]
    limit = float(at[0] + 0.5 * (at.max() - at[0]))
    simulation = simulate(compiled, 0.5, tolerance=1e-10, stops=[EndStop(name="s", joint="C", at=limit)])
    first = next(h.time for h in simulation.events if h.kind == "contact")
    end = next((h.time for h in simulation.events if h.kind == "release"), 0.5)
    rest = simulation.motion(np.linspace(first + 1e-6, end - 1e-6, 50))
    assert np.ptp(rest.coordinate("C")[:, 0]) < 1e-9
    assert min(np.ptp(rest.coordinate(joint)[:, 0]) for joint in ("A", "E")) > 1e-4
    forces = simulation.forces(rest)
    assert max(np.abs(forces.effort(joint)).max() for joint in ("A", "E")) < 1e-9 * np.abs(forces.loads["stop s"].values).max()
    assert np.abs(simulation.drift(np.linspace(0.0, 0.5, 100))).max() < 1e-8


def rods(**start: float) -> Mechanism:
    """Two equal rods of 1 kg and 1 m, without gravity."""
    return replace(double_pendulum(case("dynamics", "double-pendulum-rods")["inputs"] | start), effects=("inertia",))


@pytest.mark.parametrize(("side", "stays"), [("lower", False), ("upper", True)])
def test_an_impact_throws_what_rests_on_another_stop_off_it_or_presses_it_on(side: str, stays: bool):
    """A stop only pushes. Where the upper rod stays on its stop, the lower one is all that moves and loses 1 - e^2 of its energy;
    else the impulse of a free double pendulum throws it off."""
    m = rods(theta_1=0.3, theta_2=-0.4, omega_1=0.0, omega_2=2.0)
    push = Torque(name="push", link="upper", moment=30.0 if side == "upper" else -30.0)
    at = [float(d.law(0.0)[0]) for d in m.drives]
    stops = [EndStop(name="hit", joint="J", at=at[1], restitution=0.4), EndStop(name="rest", joint="O", at=at[0], side=side)]
    run = simulate(replace(m, loads=(push,)), 1e-3, stops=stops)
    after = [float(run.motion([1e-15]).coordinate(joint)[0, 1]) for joint in ("O", "J")]
    assert after[1] == pytest.approx(-0.8, rel=1e-9)
    assert (after[0] == 0.0) if stays else (after[0] > 0.1)
    inertia = reduce(compile_mechanism(m), np.array([at]), np.zeros((1, 2)), np.zeros(1)).inertia[0]
    mass = inertia[1, 1] if stays else 1.0 / np.linalg.inv(inertia)[1, 1]
    assert run.impact_losses[0][1] == pytest.approx(0.5 * mass * 2.0**2 * (1.0 - 0.4**2), rel=1e-9)
    assert [h.kind for h in run.events] == (["impact", "contact"] if stays else ["impact"])


def contacts(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Mobility of one to five contacts of a mechanism of one to four freedoms, and the rates of their gaps."""
    f, c = rng.integers(1, 5), rng.integers(1, 6)
    jacobian, root = rng.standard_normal((c, f)), rng.standard_normal((f, f))
    inertia = root @ root.T + 0.1 * np.eye(f)
    return jacobian @ np.linalg.solve(inertia, jacobian.T), jacobian @ rng.standard_normal(f)


def test_impulses_push_only_where_contacts_leave_with_the_least_speed_whatever_their_order():
    """The conditions of Moreau, and no energy comes from nowhere; without restitution there is always a solution."""
    rng = np.random.default_rng(5)
    shared = 0
    for _ in range(300):
        mobility, rates = contacts(rng)
        c = len(rates)
        e = rng.choice([0.0, 1.0]) * np.ones(c) if rng.uniform() < 0.5 else rng.uniform(0.0, 1.0, c)
        jump = impact(mobility, rates, e, np.zeros(c, bool))
        assert jump is not None
        push, lost = jump
        after = rates + mobility @ push
        assert push.min() >= 0.0 and after.min() > -1e-9 * np.abs(rates).max()
        assert lost >= -1e-9 * float(push @ np.abs(rates))
        if not e.any():
            np.testing.assert_allclose(push * after, 0.0, atol=1e-9 * push.max(initial=1.0))
        elif np.linalg.matrix_rank(mobility) == c == (rates < 0.0).sum() and np.ptp(e) == 0.0:
            np.testing.assert_allclose(push * (after + e * rates), 0.0, atol=1e-9 * push.max(initial=1.0))
        elif np.linalg.matrix_rank(mobility) == c and (rates < 0.0).any():  # own, smallest or none
            closing, smallest = np.maximum(-rates, 0.0), e[rates < 0.0].min()
            kept = [np.abs(push * (after - k * closing)).max() <= 1e-9 * push.max() * closing.max() for k in (e, smallest, 0.0)]
            assert any(kept)
            shared += kept[1] and not kept[0]
        mixed = rng.permutation(c)
        again = impact(mobility[np.ix_(mixed, mixed)], rates[mixed], e[mixed], np.zeros(c, bool))
        assert again is not None
        np.testing.assert_allclose(rates[mixed] + mobility[np.ix_(mixed, mixed)] @ again[0], after[mixed], atol=1e-9)
    assert shared  # a case in which the smallest has to hold for all


@pytest.mark.parametrize("angle", np.linspace(0.2, 1.4, 7))
@pytest.mark.parametrize("side", ["upper", "lower"])
def test_what_a_stop_without_restitution_has_caught_falls_back_from_rest(angle: float, side: str):
    """Gravity draws it away from the stop: one impact, and then the pendulum that starts at rest there."""
    sign = 1.0 if side == "upper" else -1.0
    body = {"inertia": 0.4, "mass": 1.5, "distance": 0.35}
    stop = EndStop(name="s", joint="O", at=sign * angle - np.pi / 2, side=side)
    run = simulate(pendulum(**body, angle=0.0, speed=6.0 * sign), 1.0, tolerance=1e-11, stops=[stop])
    assert [h.kind for h in run.events if h.time < 0.5] == ["impact"]
    after = np.linspace(1e-3, 0.25, 9)
    free = simulate(pendulum(**body, angle=sign * angle), 0.5, tolerance=1e-11).motion(after).coordinate("O")[:, :2]
    np.testing.assert_allclose(run.motion(run.events[0].time + after).coordinate("O")[:, :2], free, atol=1e-9)


@pytest.mark.parametrize("restitution", [(0.0, 0.0), (0.4, 0.4), (0.2, 0.4)])
def test_bounces_between_two_stops_end_in_rest_whatever_their_order_and_units(restitution: tuple[float, float]):
    """Ever shorter bounces, now on the one, now on the other; the same where all lengths are a thousand times larger."""
    i = case("dynamics", "double-pendulum-rods")["inputs"] | {"theta_1": 0.3, "theta_2": 0.5, "omega_1": -1.0, "omega_2": -1.0}
    stops = [
        EndStop(name=name, joint=joint, at=at, side="lower", restitution=e)
        for name, joint, at, e in zip("ab", "OJ", (0.2 - np.pi / 2, 0.1), restitution, strict=True)
    ]
    large = {key: i[key] * 1e3 for key in ("L1", "a1", "a2")} | {key: i[key] * 1e6 for key in ("J1", "J2")}
    runs = [simulate(double_pendulum(i), 0.3, stops=s) for s in (stops, stops[::-1])]
    runs.append(simulate(replace(double_pendulum(i | large), gravity=(0.0, -9810.0)), 0.3, stops=stops))
    told = [[(h.kind, h.item) for h in run.events] for run in runs]
    assert told[0] == told[1] == told[2]
    assert [kind for kind, _ in told[0]].count("contact") == 2 and len(told[0]) < 60
    for run in runs:
        np.testing.assert_allclose([h.time for h in run.events], [h.time for h in runs[0].events], rtol=1e-9)
        np.testing.assert_allclose(run.motion([0.3]).coordinate("J")[0], [0.1, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("at", [0.3, 0.5])
def test_a_load_that_jumps_lifts_what_rests_on_a_stop(at: float):
    """No load passes zero there: the stop would have to pull from one instant to the next."""
    lift = Torque(name="lift", link="body", moment=8.0, factor=Factor(function=Step(at=at), of="time"))
    body = {"inertia": 0.4, "mass": 1.5, "distance": 0.35, "angle": 1.0}
    stop = EndStop(name="s", joint="O", at=1.0 - np.pi / 2, side="lower")
    run = simulate(pendulum(**body, loads=(lift,)), 1.0, tolerance=1e-11, stops=[stop])
    assert [(h.kind, h.item) for h in run.events] == [("contact", "s"), ("release", "s")]
    assert run.events[1].time == pytest.approx(at, abs=1e-12)
    after = np.linspace(1e-3, 0.4, 9)
    free = simulate(pendulum(**body, loads=(replace(lift, factor=None),)), 0.4, tolerance=1e-11).motion(after).coordinate("O")
    np.testing.assert_allclose(run.motion(at + after).coordinate("O")[:, :2], free[:, :2], atol=1e-9)


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


@pytest.mark.parametrize(("rising", "hits"), [(None, [1, 1, 1]), (True, [1, 1, 1]), (False, [0, 0, 0])])
def test_a_velocity_that_passes_a_value_in_an_impact_is_told(rising: bool | None, hits: list[int]):
    """A bouncing ball goes up at once at each impact; the passage was told only where it slows down again."""
    e, g = 0.7, 9.81
    floor = [EndStop(name="floor", joint="S", at=0.0, side="lower", restitution=e)]
    up = EventTrigger(name="up", joint="S", of="velocity", at=0.5, rising=rising)
    run = simulate(ball(1.0), 1.7, stops=floor, triggers=[up])
    fall = np.sqrt(2.0 / g)
    struck = [fall, fall * (1.0 + 2.0 * e), fall * (1.0 + 2.0 * e + 2.0 * e * e)]
    told = np.array([x.time for x in run.events if x.item == "up"])
    assert [int(np.isclose(told, t, atol=1e-9).sum()) for t in struck] == hits
    assert len(told) == {None: 6, True: 3, False: 3}[rising]
    assert np.abs(run.drift(np.linspace(0.0, 1.7, 50))).max() < 1e-9


def test_a_motion_ends_with_the_impact_in_which_a_velocity_passes_a_value():
    up = EventTrigger(name="up", joint="S", of="velocity", at=0.5, rising=True, ends=True)
    run = simulate(ball(1.0), 1.7, stops=[EndStop(name="floor", joint="S", at=0.0, side="lower", restitution=0.7)], triggers=[up])
    assert run.duration == pytest.approx(np.sqrt(2.0 / 9.81), abs=1e-9)
    assert [x.kind for x in run.events] == ["impact", "end"]
