"""Forward dynamics against reference values, conservation laws and a second method."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from cases import examples
from dynamic_mechanisms import chain, double_pendulum, free_four_bar, pendulum, slider_crank, squeezer
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanisms import case
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipkinc

from mechcore.dynamics.equations import energy
from mechcore.dynamics.equations.charts import Chart
from mechcore.dynamics.equations.reduced import reduce
from mechcore.dynamics.events import EndStop, EventTrigger
from mechcore.dynamics.integration.collocation import gauss, radau
from mechcore.dynamics.integration.windows import Integrator
from mechcore.dynamics.simulate import simulate
from mechcore.errors import MechanismError
from mechcore.laws.timed import Free
from mechcore.motion.solve import compile_mechanism
from mechcore.numerics.chebyshev import fit_panels
from mechcore.spec.loads import Factor, Torque, TorsionSpring, Viscous
from mechcore.spec.mechanism import Drive
from mechviz.hard_cases.mechanisms import bars


def test_squeezer_to_all_published_digits():
    reference = case("andrews", "andrews-squeezer")
    simulation = simulate(squeezer(reference["inputs"]), 0.03)
    assert simulation.method == "energy"
    for row in reference["expected"]["rows"]:
        q, v, a = (x[0, 0] for x in simulation([row["t"]]))
        assert q == pytest.approx(row["q"]["beta"], abs=2e-11)
        assert v == pytest.approx(row["qd"]["beta"], rel=1e-10)
        assert a == pytest.approx(row["qdd"]["beta"], rel=1e-8)
        motion = simulation.motion([row["t"]])
        for link, angle in (("K3", "gamma"), ("K5", "delta"), ("K7", "epsilon")):
            miss = np.angle(np.exp(1j * (motion.pose(link)[0, 2] - row["q"][angle])))
            assert abs(miss) < 1e-11
            assert motion.velocity(link)[0, 2] == pytest.approx(row["qd"][angle], rel=1e-9, abs=1e-8)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-9])
def test_squeezer_by_collocation(tolerance: float):
    reference = case("andrews", "andrews-squeezer")
    row = reference["expected"]["rows"][-1]
    simulation = simulate(squeezer(reference["inputs"]), 0.03, method="gauss", tolerance=tolerance)
    assert simulation.method == "gauss"
    assert simulation([0.03])[0][0, 0] == pytest.approx(row["q"]["beta"], abs=0.1 * tolerance + 1e-12)
    assert np.abs(simulation.drift(np.linspace(0.0, 0.03, 50))).max() < 10 * tolerance


FINAL = {1: 31.914741297738026, 2: 31.750597186986102, 5: 31.653957055797653, 10: 31.621729822781873}


@pytest.mark.parametrize("n", FINAL)
@pytest.mark.parametrize("method", ["energy", "gauss"])
def test_chain_of_four_bars_through_its_singular_position(n: int, method: str):
    simulation = simulate(chain(n), 10.0, method=method, tolerance=1e-9)
    assert np.pi / 2 - simulation([10.0])[0][0, 0] == pytest.approx(FINAL[n], abs=1e-9 * FINAL[n])
    t = np.linspace(0.0, 10.0, 501)
    motion = simulation.motion(t)
    assert motion.closure.max() < 1e-12
    for k in range(n + 1):  # all uprights stay parallel: no branch was swapped
        assert np.abs(np.exp(1j * motion.pose(f"upright{k}")[:, 2]) - np.exp(1j * motion.pose("upright0")[:, 2])).max() < 1e-9
    assert np.abs(simulation.drift(t)).max() < 1e-9


def test_pendulum_against_elliptic_functions():
    reference = case("dynamics", "compound-pendulum-period")
    i = reference["inputs"]
    for e in reference["expected"]:
        if e["amplitude_deg"] > 179.5:
            continue
        body = pendulum(inertia=i["J_O"], mass=i["m"], distance=i["d"], angle=e["amplitude"], g=i["g"])
        period = e["period"]
        by_energy, stepped = simulate(body, 20 * period), simulate(body, 2 * period, method="gauss", tolerance=1e-12)
        for s in e["states"]:
            for simulation, later, bound in ((by_energy, 0.0, 1e-10), (by_energy, 19.0, 1e-8), (stepped, 0.0, 1e-11)):
                computed = simulation([s["t_over_T"] * period + later * period])[0][0, 0] + np.pi / 2
                assert computed == pytest.approx(s["theta"], abs=bound)


def test_pendulum_next_to_its_unstable_equilibrium():
    reference = case("dynamics", "compound-pendulum-period")
    i = reference["inputs"]
    for e in reference["expected"]:
        if e["amplitude_deg"] > 179.5:
            body = pendulum(inertia=i["J_O"], mass=i["m"], distance=i["d"], angle=e["amplitude"], g=i["g"])
            simulation = simulate(body, 1.01 * e["period"], tolerance=1e-12)
            for s in e["states"]:  # an error at the top grows with exp(w t): by 1e4 and more until it comes down
                assert simulation([s["t_over_T"] * e["period"]])[0][0, 0] + np.pi / 2 == pytest.approx(s["theta"], abs=1e-9)


@pytest.mark.parametrize("name", ["double-pendulum-rods", "double-pendulum-physical"])
def test_double_pendulum(name: str):
    reference = case("dynamics", name)
    rows = reference["expected"]["rows"]
    simulation = simulate(double_pendulum(reference["inputs"]), rows[-1]["t"], tolerance=1e-10)
    for row in rows:
        q, v, _ = (x[0] for x in simulation([row["t"]]))
        growth = np.exp(2.0 * row["t"])  # it is chaotic: neighbouring motions part
        assert q[0] + np.pi / 2 == pytest.approx(row["theta_1"], abs=1e-11 * growth)
        assert q.sum() + np.pi / 2 == pytest.approx(row["theta_2"], abs=1e-11 * growth)
        assert v[0] == pytest.approx(row["omega_1"], abs=1e-10 * growth)
        if "R_O_on_1" in row:
            forces = simulation.forces(simulation.motion([row["t"]]))
            assert forces.reaction("O")[0, :2] == pytest.approx(row["R_O_on_1"], abs=1e-8)
            assert forces.reaction("J")[0, :2] == pytest.approx(row["R_joint_on_2"], abs=1e-8)
    assert np.abs(simulation.drift(np.linspace(0.0, rows[-1]["t"], 100))).max() < 1e-10


@pytest.mark.parametrize("name", ["forward-slider-crank", "forward-slider-crank-spring-damper"])
def test_slider_crank_under_a_torque(name: str):
    reference = case("dynamics", name)
    rows = reference["expected"]
    simulation = simulate(slider_crank(reference["inputs"]), rows[-1]["t"], tolerance=1e-11)
    for row in rows:
        q, v, a = (x[0, 0] for x in simulation([row["t"]]))
        assert q == pytest.approx(row["theta_1"], rel=1e-10)
        assert v == pytest.approx(row["omega_1"], rel=1e-10)
        assert a == pytest.approx(row["eps_1"], rel=1e-9, abs=1e-7)
        slider = simulation.motion([row["t"]])
        assert slider.point("slider", "C")[0, 0] == pytest.approx(row["x_C"], rel=1e-10)
        assert slider.point("slider", "C", 2)[0, 0] == pytest.approx(row["a_C"], rel=1e-9, abs=1e-7)


def test_four_bar_under_gravity():
    reference = case("dynamics", "forward-fourbar-gravity")
    rows = reference["expected"]["rows"]
    for method in ("energy", "gauss"):
        simulation = simulate(free_four_bar(reference["inputs"]), rows[-1]["t"], tolerance=1e-11, method=method)
        for row in rows:
            q, v, a = (x[0, 0] for x in simulation([row["t"]]))
            assert q == pytest.approx(row["theta_1"], rel=1e-10)
            assert v == pytest.approx(row["omega_1"], rel=1e-9)
            assert a == pytest.approx(row["eps_1"], rel=1e-8)


def test_nothing_is_left_for_the_free_coordinate_to_do():
    reference = case("dynamics", "forward-slider-crank-spring-damper")
    simulation = simulate(slider_crank(reference["inputs"]), 0.2, tolerance=1e-8)
    motion = simulation.motion(np.linspace(0.0, 0.2, 101))
    forces = simulation.forces(motion)
    assert np.abs(forces.effort("O")).max() < 1e-9 * np.abs(forces.reaction("B")).max() * reference["inputs"]["r"]
    assert np.abs(forces.power_balance).max() < 1e-9


@pytest.mark.parametrize(("rule", "nodes"), [(gauss, 2), (gauss, 3), (gauss, 4), (radau, 2), (radau, 3)])
def test_order_of_the_collocation(rule, nodes: int):
    """A wanted motion, the torque that it needs as a function of time, and its integration back (manufactured solution)."""
    body = pendulum(inertia=0.4, mass=1.5, distance=0.35, angle=0.7)

    def wanted(t):
        return 0.7 + 0.4 * np.sin(3.0 * t), 1.2 * np.cos(3.0 * t), -3.6 * np.sin(3.0 * t)

    def torque(t):
        q, _, a = wanted(np.asarray(t, float))
        return 0.4 * a + 1.5 * 9.81 * 0.35 * np.sin(q)

    driven = dataclasses.replace(
        body,
        drives=(Drive(joint="O", law=Free(0.7 - np.pi / 2, 1.2)),),
        loads=(Torque(name="wanted", link="body", moment=1.0, factor=Factor(function=torque, of="time")),),
    )
    system = Chart(compile_mechanism(driven))
    errors = []
    counts = np.array([8, 16])
    for windows in counts:
        from mechcore.compiled.collocation import WindowTrial
        from mechcore.dynamics.integration.collocation import Window, solve_window

        r, q, v, h = rule(nodes), np.array([0.7 - np.pi / 2]), np.array([1.2]), 1.0 / windows
        for k in range(windows):
            guess = np.zeros((nodes, 1))
            solved = solve_window(r, system, WindowTrial(k * h, h, q, v, guess, 1e-15))
            assert solved is not None
            window = Window(k * h, h, q, v, r.legendre @ solved[0])
            ends = window(np.array([(k + 1) * h]))
            q, v = ends[0][0], ends[1][0]
        errors.append(abs(q[0] + np.pi / 2 - wanted(1.0)[0]))
    order = np.log2(errors[0] / errors[1])
    assert order == pytest.approx(r.order, abs=0.35)


def test_tolerance_is_proportional_to_the_error():
    reference = case("dynamics", "double-pendulum-physical")
    row = reference["expected"]["rows"][-1]
    errors = []
    for tolerance in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7):
        q = simulate(double_pendulum(reference["inputs"]), row["t"], tolerance=tolerance)([row["t"]])[0][0]
        errors.append(abs(q[0] + np.pi / 2 - row["theta_1"]) + 1e-15)
    assert all(error < 10 * tolerance for error, tolerance in zip(errors, (1e-3, 1e-4, 1e-5, 1e-6, 1e-7), strict=True))
    assert errors[-1] < 1e-3 * errors[0]


def test_same_motion_as_scipy_with_the_same_right_hand_side():
    i = case("dynamics", "double-pendulum-rods")["inputs"]
    compiled = compile_mechanism(double_pendulum(i))
    chart = Chart(compiled)

    def rhs(t, y):
        q, v = y[None, :2], y[None, 2:]
        return np.concatenate([y[2:], chart(q, v, np.array([t]))[0]])

    start = [float(x) for k in (0, 1) for x in (d.law(0.0)[k] for d in compiled.mechanism.drives)]
    other = solve_ivp(rhs, (0.0, 0.5), start, method="DOP853", rtol=1e-11, atol=1e-11)
    q = simulate(compiled, 0.5, tolerance=1e-11)([0.5])[0][0]
    assert q == pytest.approx(other.y[:2, -1], abs=1e-9)


def test_time_reversal_returns_to_the_start():
    i = case("dynamics", "double-pendulum-physical")["inputs"]
    there = simulate(double_pendulum(i), 1.0, tolerance=1e-11)
    q, v, _ = (x[0] for x in there([1.0]))
    mechanism = dataclasses.replace(
        double_pendulum(i), drives=tuple(Drive(joint=p, law=Free(q[k], -v[k])) for k, p in enumerate(("O", "J")))
    )
    back, speed, _ = (x[0] for x in simulate(mechanism, 1.0, tolerance=1e-11)([1.0]))
    assert back == pytest.approx([d.law.start for d in double_pendulum(i).drives], abs=1e-9)
    assert -speed == pytest.approx([d.law.speed for d in double_pendulum(i).drives], abs=1e-8)


def test_stiff_damping_wants_radau():
    body = pendulum(inertia=0.4, mass=1.5, distance=0.35, angle=1.0, loads=(Viscous(name="oil", joint="O", coefficient=4e4),))
    stiff = simulate(body, 200.0, method="radau", tolerance=1e-6)
    plain = simulate(body, 200.0, method="gauss", tolerance=1e-6)
    assert stiff([200.0])[0][0, 0] == pytest.approx(plain([200.0])[0][0, 0], abs=1e-5)
    assert stiff.evaluations < 0.1 * plain.evaluations
    # creeping: c q' = -m g d sin q, so tan(q/2) decays with exp(-m g d t / c)
    creeping = 2 * np.arctan(np.tan(0.5) * np.exp(-1.5 * 9.81 * 0.35 * 200.0 / 4e4))
    assert stiff([200.0])[0][0, 0] + np.pi / 2 == pytest.approx(creeping, abs=1e-4)


def test_at_rest_in_an_equilibrium_it_stays_there():
    for angle in (0.0, np.pi):
        simulation = simulate(pendulum(inertia=0.4, mass=1.5, distance=0.35, angle=angle), 1.0, tolerance=1e-10)
        assert simulation([1.0])[0][0, 0] + np.pi / 2 == pytest.approx(angle, abs=1e-9)


def test_a_stop_reflects_and_takes_energy():
    stop = EndStop(name="wall", joint="O", at=-np.pi / 2, side="lower", restitution=0.6)
    simulation = simulate(pendulum(inertia=0.4, mass=1.5, distance=0.35, angle=1.0), 20.0, stops=[stop], tolerance=1e-10)
    hits = [h for h in simulation.events if h.kind == "impact"]
    speed = np.sqrt(2 * 1.5 * 9.81 * 0.35 * (1 - np.cos(1.0)) / 0.4)
    for k, hit in enumerate(hits[:5]):
        before = simulation([hit.time])[1][0, 0]
        assert before == pytest.approx(-speed * 0.6**k, rel=1e-8)
    t = np.linspace(0.0, 20.0, 300)
    assert simulation(t)[0].min() >= -np.pi / 2 - 1e-9
    assert np.abs(simulation.drift(t)).max() < 1e-8


def test_bouncing_ends_in_contact():
    stop = EndStop(name="wall", joint="O", at=-np.pi / 2 + 0.5, side="lower", restitution=0.5)
    simulation = simulate(pendulum(inertia=0.4, mass=1.5, distance=0.35, angle=1.0), 20.0, stops=[stop], tolerance=1e-9)
    assert simulation.events[-1].kind == "contact"
    assert simulation.events[-1].time < 10.0
    assert simulation([20.0])[0][0, 0] == pytest.approx(-np.pi / 2 + 0.5, abs=1e-7)
    # the time of all bounces, near enough a ball on a slope: 2 v e / (a (1 - e)) after the first hit
    hits = [h.time for h in simulation.events if h.kind == "impact"]
    first = -simulation([hits[0]])[1][0, 0]
    fall = 1.5 * 9.81 * 0.35 * np.sin(0.5) / 0.4
    assert simulation.events[-1].time - hits[0] == pytest.approx(2 * first * 0.5 / fall / (1 - 0.5), rel=0.12)


def test_resting_contact_is_released_when_the_load_turns():
    pull = Torque(name="pull", link="body", moment=6.0, factor=Factor(function=lambda t: np.sin(np.asarray(t)), of="time"))
    body = pendulum(inertia=0.4, mass=1.5, distance=0.35, angle=0.0, loads=(pull,))
    stop = EndStop(name="wall", joint="O", at=-np.pi / 2, side="upper", restitution=0.0)
    simulation = simulate(body, 5.0, stops=[stop], tolerance=1e-9)
    assert [h.kind for h in simulation.events[:2]] == ["contact", "release"]
    assert simulation.events[1].time == pytest.approx(np.pi, abs=1e-7)
    assert np.abs(simulation(np.linspace(0.0, 3.14, 20))[0] + np.pi / 2).max() < 1e-12


def test_an_impact_spreads_over_the_mechanism():
    """Momentum about O and energy of a double pendulum whose lower joint hits a stop without loss."""
    i = case("dynamics", "double-pendulum-rods")["inputs"]
    stop = EndStop(name="knee", joint="J", at=-1.0, side="lower", restitution=1.0)
    m = double_pendulum({**i, "theta_1": 1.0, "theta_2": 1.0, "omega_1": 0.0, "omega_2": -3.0})
    m = dataclasses.replace(m, effects=("inertia",))
    simulation = simulate(m, 2.0, stops=[stop], tolerance=1e-10)
    hit = next(h for h in simulation.events if h.kind == "impact")
    q, v, _ = (x[0] for x in simulation([hit.time]))
    _, after, _ = (x[0] for x in simulation([hit.time + 1e-9]))
    from mechcore.dynamics.equations.reduced import reduce

    inertia = reduce(simulation.compiled, q[None], v[None], np.zeros(1)).inertia[0]
    assert after[1] == pytest.approx(-v[1], rel=1e-6)
    assert (inertia @ after)[0] == pytest.approx((inertia @ v)[0], rel=1e-6)  # no impulse on the upper joint's coordinate
    assert np.abs(simulation.drift(np.linspace(0.0, 2.0, 100))).max() < 1e-8


def test_watch_finds_and_ends():
    body = pendulum(inertia=0.4, mass=1.5, distance=0.35, angle=1.0)
    bottom = EventTrigger(name="bottom", joint="O", at=-np.pi / 2)
    end = EventTrigger(name="second top", of="velocity", joint="O", at=0.0, rising=True, ends=True)
    simulation = simulate(body, 100.0, triggers=[bottom, end], tolerance=1e-11)
    from scipy.special import ellipk

    period = 4.0 * np.sqrt(0.4 / (1.5 * 9.81 * 0.35)) * ellipk(np.sin(0.5) ** 2)
    assert [h.item for h in simulation.events] == ["bottom", "second top"]
    assert simulation.events[0].time == pytest.approx(period / 4, rel=1e-9)
    assert simulation.duration == pytest.approx(period / 2, rel=1e-9)


@given(st.floats(0.3, 2.8), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(0.2, 3.0), st.floats(0.2, 3.0))
@settings(max_examples=examples(15))
def test_energy_is_conserved(angle: float, w1: float, w2: float, mass: float, length: float):
    i = {"m1": mass, "J1": 0.1, "a1": 0.4 * length, "L1": length, "m2": 1.0, "J2": 0.05, "a2": 0.3, "theta_1": angle}
    simulation = simulate(double_pendulum({**i, "theta_2": -angle, "omega_1": w1, "omega_2": w2}), 1.0, tolerance=1e-10)
    assert np.abs(simulation.drift(np.linspace(0.0, 1.0, 21))).max() < 1e-8


def test_without_gravity_and_pivot_forces_momentum_stays():
    """No gravity: the moment of momentum about the only fixed pivot is the generalised momentum of its coordinate."""
    i = case("dynamics", "double-pendulum-physical")["inputs"]
    mechanism = dataclasses.replace(double_pendulum(i), effects=("inertia",))
    simulation = simulate(mechanism, 3.0, tolerance=1e-11)
    from mechcore.dynamics.equations.reduced import reduce

    t = np.linspace(0.0, 3.0, 40)
    q, v, _ = simulation(t)
    momentum = np.einsum("nij,nj->ni", reduce(simulation.compiled, q, v, t).inertia, v)[:, 0]
    assert np.ptp(momentum) < 1e-9 * np.abs(momentum).max()


def test_torsion_spring_winds_up_over_turns():
    """A torsion spring does not repeat after a turn: it must not be tabulated over one."""
    mechanism = dataclasses.replace(
        pendulum(inertia=0.4, mass=1.5, distance=0.35, angle=0.0, speed=30.0),
        effects=("inertia",),
        loads=(TorsionSpring(name="spring", links=("frame", "body"), stiffness=2.0, free_angle=-np.pi / 2),),
    )
    w = np.sqrt(2.0 / 0.4)
    simulation = simulate(mechanism, 2.0, tolerance=1e-10)
    t = np.linspace(0.0, 2.0, 30)
    assert simulation(t)[0][:, 0] + np.pi / 2 == pytest.approx(30.0 / w * np.sin(w * t), abs=1e-7)


def test_a_load_in_time_is_not_tabulated_over_positions():
    """A wheel under a torque sin(t): its speed is (1 - cos t) / J."""
    wheel = dataclasses.replace(
        pendulum(inertia=0.4, mass=1.5, distance=0.0, angle=0.0),
        effects=("inertia",),
        loads=(Torque(name="pull", link="body", moment=2.0, factor=Factor(function=np.sin, of="time")),),
    )
    simulation = simulate(wheel, 7.0, tolerance=1e-10)
    t = np.linspace(0.0, 7.0, 30)
    assert simulation(t)[1][:, 0] == pytest.approx(2.0 / 0.4 * (1.0 - np.cos(t)), abs=1e-8)


@pytest.mark.parametrize("lengths", [(1.0, 0.7, 0.6, 0.8), (1.0, 0.9, 0.3, 0.85)])
def test_dead_points_of_the_stated_coordinate_are_ordinary_points(lengths: tuple[float, ...]):
    """A triple rocker, all of whose coordinates turn back, and a double rocker, swinging through their dead points."""
    frame, crank, coupler, rocker = lengths
    mechanism = bars(frame=frame, crank=crank, coupler=coupler, rocker=rocker, angle=1.2, speed=5.0)
    simulation = simulate(mechanism, 3.0, tolerance=1e-10)
    assert len({segment.compiled.mechanism.drives[0].joint for segment in simulation.segments}) > 1
    t = np.linspace(0.0, 3.0, 601)
    motion = simulation.motion(t)
    assert motion.closure.max() < 1e-12
    assert np.abs(simulation.drift(t)).max() < 1e-8
    forces = simulation.forces(motion)
    assert np.abs(forces.power_balance).max() < 1e-9
    middle = np.linspace(0.05, 2.95, 40)
    h = 1e-5
    around = [simulation.motion(np.sort(np.concatenate([middle - h, middle, middle + h])))]
    for link in ("crank", "coupler", "rocker"):
        angle, rate = around[0].pose(link)[:, 2].reshape(-1, 3), around[0].velocity(link)[:, 2].reshape(-1, 3)
        assert (angle[:, 2] - angle[:, 0]) / (2 * h) == pytest.approx(rate[:, 1], abs=1e-4 * np.abs(rate).max())
    # the same motion, stated at another joint
    start = simulation.motion([0.0])
    q, w, _ = start.coordinate("E")[0]
    other = dataclasses.replace(mechanism, drives=(Drive(joint="E", law=Free(float(q), float(w))),), modes={})
    other = dataclasses.replace(other, sketch={k: tuple(start.pose(k)[0]) for k in ("crank", "coupler", "rocker")})
    again = simulate(other, 3.0, tolerance=1e-10).motion(t)
    for link in ("crank", "coupler", "rocker"):
        apart = np.abs(np.exp(1j * again.pose(link)[:, 2]) - np.exp(1j * motion.pose(link)[:, 2]))
        assert apart[t < 1.5].max() < 1e-6  # swinging is sensitive to the start: differences grow


def test_start_in_a_dead_point_is_refused_in_words():
    """The crank is in line with the coupler: its coordinate stands still while the rest may move."""
    reach = np.arccos((1.0 + 0.7**2 - 1.4**2) / (2.0 * 1.0 * 0.7))
    with pytest.raises(MechanismError, match=r"dead point|cannot be assembled"):
        simulate(bars(frame=1.0, crank=0.7, coupler=0.6, rocker=0.8, angle=float(reach), speed=0.0), 1.0)


def test_bad_input_is_refused_in_words():
    body = pendulum(inertia=0.4, mass=1.5, distance=0.35, angle=1.0)
    for change, words in (
        ({"effects": ("gravity",)}, "inertia is not named"),
        ({"links": (body.links[0], dataclasses.replace(body.links[1], mass=0.0, inertia=0.0))}, "moves no mass"),
    ):
        with pytest.raises(MechanismError, match=words):
            simulate(dataclasses.replace(body, **change), 1.0)
    with pytest.raises(MechanismError, match="no duration"):
        simulate(body, -1.0)
    with pytest.raises(MechanismError, match=r"joints.O.stops.*starts 57.2958° above the upper stop 's' at -90°"):
        simulate(body, 1.0, stops=[EndStop(name="s", joint="O", at=-np.pi / 2)])


def test_panels_follow_a_function_to_rounding():
    panels = fit_panels(lambda x: np.exp(np.sin(x))[:, None], 0.0, 2 * np.pi, periodic=True, tolerance=1e-14)
    x = np.linspace(-20.0, 20.0, 400)
    assert panels(x)[:, 0] == pytest.approx(np.exp(np.sin(x)), abs=1e-13)
    assert panels.derivative()(x)[:, 0] == pytest.approx(np.cos(x) * np.exp(np.sin(x)), abs=1e-10)
    integral = panels.integral()
    assert integral.derivative()(np.linspace(0, 6, 50)) == pytest.approx(panels(np.linspace(0, 6, 50)), abs=1e-11)


def test_integrate_ends_where_it_is_told():
    system = Chart(compile_mechanism(pendulum(inertia=0.4, mass=1.5, distance=0.35, angle=1.0)))
    solution = Integrator(system, tolerance=1e-8).run(np.array([0.0]), np.array([0.0]), 0.0, 1.0)
    assert solution.end == pytest.approx(1.0, abs=1e-14)


@pytest.mark.parametrize("off", [1e-12, 1e-7])
def test_swings_too_small_for_the_energy_are_linear_ones(off: float, monkeypatch: pytest.MonkeyPatch):
    """Next to a stable equilibrium their energy is lost in the last digits of the loads' work: no table of it is tried in vain."""
    monkeypatch.setattr(energy, "_clock", lambda *_: pytest.fail("a leg is tabulated"))
    mechanism = pendulum(inertia=0.4, mass=1.5, distance=0.35, angle=off)
    w = np.sqrt(1.5 * 9.81 * 0.35 / 0.4)
    t = np.linspace(0.0, 3.0, 31)
    got = simulate(mechanism, 3.0, tolerance=1e-12)(t)[0][:, 0] + np.pi / 2
    assert np.abs(got - off * np.cos(w * t)).max() < 1e-14 + 3e-8 * off


@pytest.mark.parametrize("swing", [1e-4, 3e-3, 0.03, 0.5, 3.1])
@pytest.mark.parametrize("share", [0.0, 1e-9, 1e-3, -0.7, 1.0])
def test_swings_of_any_size_are_found_by_their_energy_with_few_panels(swing: float, share: float):
    """Against elliptic functions; started at rest, all but at rest, on the way and at the bottom (``share`` of the speed there)."""
    w, k = np.sqrt(9.81), np.sin(swing / 2)
    angle, speed = 2.0 * np.arcsin(k * np.sqrt(1.0 - share**2)), 2.0 * w * k * share
    simulation = simulate(pendulum(inertia=1.0, mass=1.0, distance=1.0, angle=angle, speed=speed), 12.0, tolerance=1e-11)
    assert simulation.method == "energy"
    assert sum(leg.clock.count for leg in simulation.segments[0].solution.legs) <= 64
    t = np.linspace(0.0, 12.0, 97)
    start = ellipkinc(np.arctan2(np.sin(angle / 2), speed / (2.0 * w)), k * k)
    sn, cn, _, _ = ellipj(start + w * t, k * k)
    q, v, _ = simulation(t)
    assert np.abs(q[:, 0] + np.pi / 2 - 2.0 * np.arcsin(k * sn)).max() < 3e-11 * swing + 1e-13
    assert np.abs(v[:, 0] - 2.0 * w * k * cn).max() < 1e-10 * swing + 1e-12
    assert np.abs(simulation.drift(t)).max() < 1e-9


@pytest.mark.parametrize("share", [1e-6, 1e-9])
def test_a_rocker_that_is_all_the_mass_there_is(share: float):
    """Where it turns back next to nothing moves: the reduced inertia falls to 1e-11 of its largest within 1e-4 rad. The time of a
    turn is that of an adaptive quadrature of dt = sqrt(J / 2 T) dq."""
    body = bars(frame=1.0, crank=0.3, coupler=0.9, rocker=0.7, angle=0.5, speed=5.0)
    light = [
        dataclasses.replace(k, mass=share * k.mass, inertia=share * k.inertia) if k.name in ("crank", "coupler") else k
        for k in body.links
    ]
    compiled = compile_mechanism(dataclasses.replace(body, links=tuple(light), effects=("inertia",)))
    simulation = simulate(compiled, 5.0, tolerance=1e-9)
    assert simulation.method == "energy" and sum(leg.clock.count for leg in simulation.segments[0].solution.legs) < 400

    def inertia(q: np.ndarray) -> np.ndarray:
        return reduce(compiled, q[:, None], np.zeros((len(q), 1)), np.zeros(len(q))).inertia[:, 0, 0]

    q = np.linspace(0.5, 0.5 + 2 * np.pi, 20001)
    (dips,) = np.nonzero((inertia(q)[1:-1] < inertia(q)[:-2]) & (inertia(q)[1:-1] < inertia(q)[2:]))
    x, w = np.polynomial.legendre.leggauss(16)
    edges = [q[0], q[-1]]
    for k in dips + 1:  # graded towards where it is least
        low, high = q[k - 1], q[k + 1]
        for _ in range(60):
            a, b = low + 0.382 * (high - low), low + 0.618 * (high - low)
            low, high = (low, b) if np.diff(inertia(np.array([a, b])))[0] > 0 else (a, high)
        edges += [0.5 * (low + high), *(0.5 * (low + high) + s * 2.0 ** -np.arange(2.0, 40.0) for s in (-1, 1))]
    edges = np.unique(np.concatenate([np.atleast_1d(e) for e in edges]))
    edges = edges[(edges >= q[0]) & (edges <= q[-1])]
    widths = np.diff(edges)
    nodes = (edges[:-1, None] + 0.5 * widths[:, None] * (x + 1.0)).ravel()
    energy = 0.5 * inertia(q[:1])[0] * 25.0
    turn = float((np.sqrt(0.5 * inertia(nodes) / energy).reshape(-1, 16) @ w) @ (0.5 * widths))
    assert turn < 5.0 and float(simulation([turn])[0][0, 0]) == pytest.approx(0.5 + 2 * np.pi, abs=1e-8)


def test_a_start_next_to_a_dead_point_of_its_own_joint():
    """There another joint leads at once: the motion of a double rocker, run back from the end of its way in, returns."""
    body = bars(frame=1.0, crank=0.7, coupler=0.6, rocker=0.8, angle=1.2, speed=0.0)
    there = simulate(body, 3.0, tolerance=1e-11)
    q, v, _ = there([3.0])
    poses = {link.name: tuple(map(float, there.motion([3.0]).pose(link.name)[0])) for link in body.links[1:]}
    drive = Drive(joint="A", law=Free(float(q[0, 0]), -float(v[0, 0])))
    back = simulate(dataclasses.replace(body, drives=(drive,), sketch=poses, modes={}), 3.0, tolerance=1e-11)
    assert back.segments[0].compiled is not back.compiled
    q, v, _ = back([3.0])
    assert q[0, 0] == pytest.approx(1.2, abs=1e-9) and abs(v[0, 0]) < 1e-8
