"""Effects against closed forms, against each other (virtual work and Newton-Euler), and against what they promise to need."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import examples
from hypothesis import given, settings
from loaded import loaded, run, with_points
from mechanisms import four_bar, load, move, pin, slider_crank
from random_linkages import ACCELERATION, ANGLES, SPEED, balance_of_links, crank_rockers, six_bars, slider_cranks
from rubbing_joints import drum
from scipy.integrate import quad

from mechcore.dynamics.equations.reduced import with_rates
from mechcore.effects.base import CAUSES, NEEDS, power_of
from mechcore.effects.registry import LOADS, effects_of, potential
from mechcore.effects.resistance import ViscousFriction
from mechcore.effects.springs import AngleDamper, BushingDampers, LineDamper
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import LOSSES
from mechcore.laws.indicator import Compressor, FourStroke, IndicatorDiagram
from mechcore.laws.timed import ConstantSpeed, Oscillation
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.clearance import Clearance, with_clearances
from mechcore.spec.loads import (
    Actuator,
    Bushing,
    BushingDamper,
    ConstantPower,
    Damper,
    DcMotor,
    Drag,
    Factor,
    Force,
    GasPressure,
    GasSpring,
    Governor,
    InductionMotor,
    Polynomial,
    Servo,
    Spring,
    Torque,
    TorsionDamper,
    TorsionSpring,
    Viscous,
)
from mechcore.spec.mechanism import Drive, Link, Mechanism, Prismatic, Revolute


def check(mechanism: Mechanism) -> None:
    forces = load(mechanism, ANGLES, SPEED, ACCELERATION)
    assert np.abs(forces.power_balance).max() <= 1e-9  # virtual work
    assert balance_of_links(forces) <= 1e-9  # Newton-Euler, link by link
    for effect in effects_of(mechanism):
        if effect.cause in LOSSES:
            assert all(np.max(power_of(forces.motion, w)) <= 0.0 for w in effect.wrenches(forces.motion)), effect


@given(loaded(crank_rockers()))
def test_crank_rockers_under_random_effects(mechanism):
    check(mechanism)


@given(loaded(slider_cranks()))
def test_slider_cranks_under_random_effects(mechanism):
    check(mechanism)


@settings(max_examples=examples(30))
@given(loaded(six_bars()))
def test_six_bars_under_random_effects(mechanism):
    check(mechanism)


@settings(max_examples=examples(40))
@given(loaded(crank_rockers()))
def test_potential_energy_is_what_springs_and_gravity_take(mechanism):
    """dU/dt = -power of all that stores energy, by central differences of order 4 with falling steps.

    Near a dead point the order shows with small steps only: an error of a larger step may be small by chance.
    """
    stores = [e for e in effects_of(mechanism) if e.stores]
    errors = []
    for h in (1e-2, 2.5e-3, 6.25e-4):
        m = move(mechanism, 1.0 + h * np.arange(-2, 3))
        energy = np.broadcast_to(potential(m), m.shape)
        power = sum((power_of(m, w) for e in stores for w in e.wrenches(m)), np.zeros(5))
        slope = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) @ energy / (12.0 * h)
        across = 1e-3 * sum(np.abs(w.force).max() for e in stores for w in e.wrenches(m))  # forces that do no work, up to rounding
        errors.append(abs(slope + power[2]) / max(np.abs(energy).max(), np.abs(power).max(), across, 1e-12))
    assert errors[2] < 1e-9 or errors[2] < errors[0] / 1000.0, errors  # 65,536 times smaller, in the limit


def every_load() -> Mechanism:
    m = with_points(four_bar(E=(4.0, 0.0), AB=1.0, BD=3.5, DE=3.0, bodies={"coupler": (2.0, (1.0, 0.0), 1.0)}))
    between = {"links": ("coupler", "frame"), "points": ("B", "Q")}
    loads = (
        Force(name="force", link="coupler", point="B", vector=(1.0, 2.0)),
        Force(name="by time", link="coupler", point="B", vector=(1.0, 2.0), factor=Factor(function=np.cos, of="time")),
        Force(
            name="by place",
            link="coupler",
            point="B",
            vector=(1.0, 2.0),
            factor=Factor(function=np.cos, of="x", point=("rocker", "Z")),
        ),
        Torque(name="by speed", link="rocker", moment=2.0, factor=Factor(function=np.cos, of="velocity", joint="D")),
        Actuator(name="actuator", **between, force=3.0),
        Spring(name="spring", **between, stiffness=3.0, free_length=1.0),
        Damper(name="damper", **between, linear=3.0),
        GasSpring(name="gas spring", **between, force=3.0, extended=60.0, gas_length=70.0),
        TorsionSpring(name="torsion spring", links=("frame", "rocker"), stiffness=3.0),
        TorsionDamper(name="torsion damper", links=("frame", "rocker"), coefficient=3.0),
        Bushing(name="bushing", **between, stiffness=(3.0, 2.0, 1.0)),
        BushingDamper(name="rubber", **between, damping=(3.0, 2.0, 1.0)),
        Drag(name="drag", link="coupler", point="B", quadratic=1.0),
        Viscous(name="viscous", joint="D", coefficient=1.0),
        DcMotor(name="dc", link="rocker", stall_torque=2.0, no_load_speed=30.0),
        InductionMotor(name="induction", joint="D", breakdown_torque=2.0, breakdown_slip=0.2, synchronous_speed=30.0),
        ConstantPower(name="constant power", link="rocker", power=3.0, torque_limit=5.0),
        Servo(name="servo", joint="D", target=Oscillation(0.0, 1.0, 1.0), proportional=3.0, derivative=1.0),
        Servo(name="spring servo", joint="D", target=Oscillation(0.0, 1.0, 1.0), proportional=3.0),
        Governor(name="governor", link="rocker", set_speed=2.0, gain=1.0, least=-3.0, most=3.0),
    )
    return replace(m, loads=loads, effects=("inertia", "gravity"))


def test_effects_need_what_they_declare(monkeypatch):
    """An effect that does not declare velocities never makes them be solved, and so with accelerations."""
    calls: list[str] = []
    for quantity in ("velocities", "accelerations"):
        original = getattr(__import__("mechcore.motion.motion", fromlist=["x"]), quantity)
        monkeypatch.setattr(f"mechcore.motion.motion.{quantity}", lambda *a, q=quantity, f=original: (calls.append(q), f(*a))[1])
    seen = set()
    for mechanism in mechanisms_with_all_loads():
        compiled = compile_mechanism(mechanism)
        for effect in effects_of(mechanism):
            motion = solve_motion(compiled, default_times(mechanism, 24))
            calls.clear()
            effect.wrenches(motion)
            effect.potential(motion)
            assert set(calls) == set(effect.needs) & {"velocities", "accelerations"}, effect
            assert effect.needs <= set(NEEDS) and effect.cause in CAUSES
            seen.add(type(effect))
    assert seen >= set(LOADS.values())


def test_effects_are_in_proportion_to_speeds_where_they_say_so():
    """Twice as fast at the same places and another time: twice the force and moment."""
    said = set()
    for mechanism in mechanisms_with_all_loads():
        compiled = compile_mechanism(mechanism)
        once = solve_motion(compiled, default_times(mechanism, 24))
        twice = with_rates(once, [2.0 * np.ones(once.frames) * d[1] for d in once.drives])
        twice.time = once.time + 0.3
        for effect in (e for e in effects_of(mechanism) if e.proportional):
            said.add(type(effect))
            assert "velocities" in effect.needs
            for a, b in zip(effect.wrenches(once), effect.wrenches(twice), strict=True):
                np.testing.assert_allclose(b.force, 2.0 * np.asarray(a.force), rtol=1e-12, atol=1e-12)
                np.testing.assert_allclose(b.moment, 2.0 * np.asarray(a.moment), rtol=1e-12, atol=1e-12)
    assert said == {LineDamper, AngleDamper, BushingDampers, ViscousFriction}  # the drag of every_load is quadratic


def mechanisms_with_all_loads() -> tuple[Mechanism, ...]:
    slider = slider_crank(r=1.0, l=3.0)
    pressure = GasPressure(name="gas", joint="S", area=0.1, cycle=Compressor(stroke=2.0, suction=1e5, delivery=5e5), top=4.0)
    joint = next(p.name for p in slider.joints if isinstance(p, Revolute))
    pressed = Clearance(radial=1e-3, stiffness=1e5, loss=1.0, friction=0.1, radius=0.05, start=(1.1e-3, 0.0))
    loose = with_clearances(slider, {joint: pressed})
    return every_load(), replace(slider, loads=(pressure,)), drum(1.0), loose


def slide(law, loads) -> Mechanism:
    """A slider on a straight guide, driven."""
    return Mechanism(
        name="slide",
        frame="frame",
        links=(Link(name="frame", points={"O": (0.0, 0.0), "W": (-0.5, 0.0)}), Link(name="slider", points={"P": (0.0, 0.0)})),
        joints=(Prismatic(name="S", links=("frame", "slider"), points=("O", "P")),),
        drives=(Drive(joint="S", law=law),),
        loads=loads,
    )


def test_damper_over_a_harmonic_stroke():
    """pi c omega A^2 for a linear damper, 8/3 c omega^2 A^3 for a quadratic one."""
    amplitude, frequency = 0.2, 1.5
    w = 2.0 * np.pi * frequency
    law = Oscillation(0.0, amplitude, frequency)
    for linear, quadratic in ((40.0, 0.0), (0.0, 70.0), (40.0, 70.0)):
        damper = Damper(name="d", links=("frame", "slider"), points=("W", "P"), linear=linear, quadratic=quadratic)
        forces = run(slide(law, (damper,)), 2000)
        lost = np.pi * linear * w * amplitude**2 + 8.0 / 3.0 * quadratic * w**2 * amplitude**3
        assert forces.energy[-1, 3] == pytest.approx(lost, rel=1e-9)
        assert forces.energy[-1, 2] == pytest.approx(lost, rel=1e-9)  # the drive has put it in
        dashpot = run(slide(law, (Viscous(name="v", joint="S", coefficient=40.0),)), 2000)
        assert dashpot.energy[-1, 3] == pytest.approx(np.pi * 40.0 * w * amplitude**2, rel=1e-9)


def test_viscous_friction_and_gas_do_not_depend_on_which_link_is_named_first():
    law = Oscillation(0.1, 0.05, 2.0)
    cycle = IndicatorDiagram(stroke=0.1, outward=lambda x: 3e5 + 0.0 * x, inward=lambda x: 2e5 + 0.0 * x)
    loads = (
        Viscous(name="v", joint="S", coefficient=40.0),
        GasPressure(name="g", joint="S", area=0.01, cycle=cycle, top=0.15, back=1e5),
    )
    one = slide(law, loads)
    turned = replace(one.joints[0], links=("slider", "frame"), points=("P", "O"), guide=1)
    a, b = run(one, 200), run(replace(one, joints=(turned,)), 200)
    np.testing.assert_allclose(b.effort("S"), a.effort("S"), rtol=1e-12, atol=1e-9)
    for forces in (a, b):
        lost = forces.power_by_cause(["viscous"])
        np.testing.assert_allclose(lost, -40.0 * forces.motion.coordinate("S")[:, 1] ** 2, atol=1e-12)
        assert np.abs(forces.power_balance).max() < 1e-12 and balance_of_links(forces) < 1e-12
        assert forces.loads["g"].links == ("slider", "frame")


@pytest.mark.parametrize("exponent", [1.0, 1.25, 1.4])
def test_gas_spring_work_and_thrust(exponent):
    law = Oscillation(0.0, 0.2, 1.0, phase=np.pi / 2)
    load = GasSpring(
        name="g", links=("frame", "slider"), points=("W", "P"), force=400.0, extended=0.7, gas_length=0.6, exponent=exponent
    )
    forces = run(slide(law, (load,)), 360)
    length = 0.5 + forces.motion.coordinate("S")[:, 0]
    volume = 1.0 - (0.7 - length) / 0.6
    np.testing.assert_allclose(forces.effort("S"), -400.0 * volume**-exponent, rtol=1e-12)  # the drive holds against the thrust
    pressed, _ = quad(lambda x: 400.0 * (1.0 - x / 0.6) ** -exponent, 0.0, 0.4)
    assert forces.potential_energy[180] == pytest.approx(pressed, rel=1e-10)
    assert abs(forces.potential_energy[0]) < 1e-12
    assert forces.energy[180, 2] == pytest.approx(pressed, rel=1e-6)


def test_gas_spring_beyond_its_ends_is_refused():
    law = Oscillation(0.0, 0.2, 1.0)
    ends = {"links": ("frame", "slider"), "points": ("W", "P")}
    with pytest.raises(MechanismError, match=r"loads\.g: it is pulled to 700 mm.*at least 700 mm"):
        run(slide(law, (GasSpring(name="g", **ends, force=1.0, extended=0.6, gas_length=1.0),)), 4)
    with pytest.raises(MechanismError, match=r"loads\.g: it is compressed by 400 mm.*no gas is left"):
        run(slide(law, (GasSpring(name="g", **ends, force=1.0, extended=0.7, gas_length=0.35),)), 4)
    with pytest.raises(MechanismError, match=r"loads\.s: its two points meet at 0\.75 s"):
        run(slide(Oscillation(0.0, 0.5, 1.0), (Spring(name="s", **ends, stiffness=1.0, free_length=1.0),)), 4)


@pytest.mark.parametrize("beyond", [0.0, 1e-15, 1e-9, 1e-3])
def test_the_energy_of_a_gas_spring_is_continuous_in_its_exponent(beyond):
    """-F L log(left) of the isothermal law, and F L (left^(1 - n) - 1) / (n - 1) to its second order next to it."""
    load = GasSpring(
        name="g", links=("frame", "rocker"), points=("A", "D"), force=2.0, extended=9.0, gas_length=10.0, exponent=1.0 + beyond
    )
    m = move(replace(four_bar(E=(4.0, 0.0), AB=1.0, BD=3.5, DE=3.0), loads=(load,)), 0.4)
    left = 1.0 - (9.0 - float(np.hypot(*m.point("rocker", "D")[0]))) / 10.0
    n, log = beyond, np.log(left)
    series = -log + 0.5 * n * log**2 - n**2 * log**3 / 6.0 + n**3 * log**4 / 24.0
    assert float(potential(m)[0]) == pytest.approx(2.0 * 10.0 * series, rel=1e-11)


def compressor(cycle, area=0.005, offset=0.0, head="ahead"):
    r, rod = 0.5 * cycle.stroke, 3.0
    branch = "ahead" if head == "ahead" else "behind"
    m = slider_crank(r=r, l=rod * r, e=offset, speed=100.0, branch=branch)
    top = (r + rod * r) * (1.0 if head == "ahead" else -1.0)
    return replace(m, loads=(GasPressure(name="gas", joint="S", area=area, cycle=cycle, top=top, head=head, back=1e5),))


@pytest.mark.parametrize("head", ["ahead", "behind"])
def test_compressor_work_is_the_closed_integral_of_p_dv(head):
    cycle = Compressor(stroke=0.08, suction=1e5, delivery=7e5, exponent=1.3, clearance=0.06)
    out, _ = quad(lambda x: cycle.pressure(x, True, True), 0.0, 0.08, points=[0.06 * 0.08 * (7 ** (1 / 1.3) - 1)], epsabs=1e-6)
    back, _ = quad(
        lambda x: cycle.pressure(x, False, True), 0.0, 0.08, points=[0.08 * (1.06 * 7 ** (-1 / 1.3) - 0.06)], epsabs=1e-6
    )
    assert out - back == pytest.approx(cycle.work, rel=1e-9)
    forces = run(compressor(cycle, head=head), 7200)
    assert forces.energy[-1, 2] == pytest.approx(0.0, abs=1e-9 * abs(cycle.work))  # what the drive puts in, the gas takes out
    supplied = np.trapezoid(forces.power("O"), forces.motion.time)
    assert supplied == pytest.approx(-cycle.work * 0.005, rel=1e-6)
    assert cycle.work < 0.0


@pytest.mark.filterwarnings("error")
def test_compressor_without_clearance_delivers_up_to_its_dead_centre():
    """Nothing is left to expand: delivery up to the dead centre, which rounding may pass, suction straight from there."""
    cycle = Compressor(stroke=0.08, suction=1e5, delivery=7e5, exponent=1.3, clearance=0.0)
    x = np.array([1e-6, 0.0, -1e-17])
    assert (cycle.pressure(x, np.zeros(3, bool), np.zeros(3, bool)) == 7e5).all()
    assert (cycle.pressure(x, np.ones(3, bool), np.zeros(3, bool)) == 1e5).all()


def test_compressor_without_clearance_and_isothermal():
    """p1 V1 ln(p2/p1) for isothermal compression without clearance."""
    cycle = Compressor(stroke=0.08, suction=1e5, delivery=7e5, exponent=1.0, clearance=0.0)
    assert cycle.work == pytest.approx(-1e5 * 0.08 * np.log(7.0), rel=1e-14)
    supplied = run(compressor(replace(cycle, clearance=1e-9)), 7200)
    assert np.trapezoid(supplied.power("O"), supplied.motion.time) == pytest.approx(-0.005 * cycle.work, rel=1e-5)


@pytest.mark.parametrize("parameters", [{"rise": 3.5}, {"rise": 1.0, "cutoff": 1.8, "ratio": 18.0}, {"rise": 1.6, "cutoff": 1.4}])
def test_four_stroke_work_is_the_closed_integral_of_p_dv(parameters):
    cycle = FourStroke(**{"stroke": 0.08, "intake": 0.9e5, "exhaust": 1.1e5, "ratio": 9.0, "expansion": 1.28, **parameters})
    total = 0.0
    for firing, outward in ((True, True), (False, False), (False, True), (True, False)):
        kink = 0.08 * (cycle.cutoff - 1.0) / (cycle.ratio - 1.0)
        area, _ = quad(lambda x, o=outward, f=firing: cycle.pressure(x, o, f), 0.0, 0.08, points=[kink], epsabs=1e-4, limit=200)
        total += area if outward else -area
    assert total == pytest.approx(cycle.work, rel=1e-9)
    forces = run(compressor(cycle), 14_400, cycles=2)
    given = -np.trapezoid(forces.power("O"), forces.motion.time)
    assert given == pytest.approx(0.005 * cycle.work, rel=2e-5)  # the pressure jumps when the exhaust opens
    assert cycle.work > 0.0


def test_four_stroke_otto_efficiency():
    """1 - r^(1-k): the work of the closed part over the heat, both per area, for an ideal gas with exponent k."""
    cycle = FourStroke(stroke=0.1, ratio=8.0, exponent=1.4, rise=3.0)
    clearance = 0.1 / 7.0
    compressed = cycle.intake * 8.0**1.4
    heat = clearance * compressed * (3.0 - 1.0) / (1.4 - 1.0)
    assert cycle.work / heat == pytest.approx(1.0 - 8.0**-0.4, rel=1e-12)


def test_four_stroke_pressures_follow_the_strokes():
    cycle = FourStroke(stroke=0.08, intake=0.9e5, exhaust=1.1e5, ratio=9.0, exponent=1.3, rise=3.0)
    (effect,) = effects_of(compressor(cycle))
    m = compressor(cycle)
    motion = solve_motion(compile_mechanism(m), np.radians([1e-9, 90.0, 270.0, 450.0, 630.0, 719.999999]) / 100.0)
    p = effect.pressure(motion)
    x = effect.displacement(motion)
    v = 1.0 + 8.0 * x / 0.08
    top = 0.9e5 * 9.0**1.3
    expected = [3.0 * top, 3.0 * top * v[1] ** -1.3, 1.1e5, 0.9e5, 0.9e5 * (9.0 / v[4]) ** 1.3, top]
    np.testing.assert_allclose(p, expected, rtol=1e-9)


def test_piston_that_leaves_its_stroke_is_refused():
    cycle = Compressor(stroke=0.08, suction=1e5, delivery=7e5)
    m = compressor(cycle)
    wrong = replace(m, loads=(replace(m.loads[0], top=0.15),))
    with pytest.raises(MechanismError, match=r"loads\.gas: the piston leaves its stroke.*runs from 160 mm to 80 mm.*top = 150 mm"):
        run(wrong, 360)


def test_zero_free_length_spring_balances_an_arm_exactly():
    """k a b = m g l holds the arm at every angle: the anchor a above the pivot, the spring at b along the arm, no free length."""
    mass, length, anchor, along = 1.2, 0.4, 0.1, 0.15
    stiffness = mass * 9.81 * length / (anchor * along)
    arm = Mechanism(
        name="lamp",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0), "H": (0.0, anchor)}),
            Link(name="arm", points={"O": (0.0, 0.0), "B": (along, 0.0)}, mass=mass, centre=(length, 0.0)),
        ),
        joints=(pin("O", "frame", "arm"),),
        drives=(Drive(joint="O", law=ConstantSpeed(0.1, 1.0)),),
        loads=(Spring(name="s", links=("frame", "arm"), points=("H", "B"), stiffness=stiffness, free_length=0.0),),
        effects=("gravity",),
    )
    forces = run(arm)
    assert np.abs(forces.effort("O")).max() < 1e-14 * mass * 9.81 * length * 10
    assert np.ptp(forces.potential_energy) < 1e-13 * mass * 9.81 * length * 10
    real = replace(arm, loads=(replace(arm.loads[0], free_length=0.05),))
    assert np.abs(run(real).effort("O")).max() > 1.0  # a usual spring does not


def test_drag_and_torsion_on_a_turning_crank():
    m = four_bar(E=(4.0, 0.0), AB=0.5, BD=3.5, DE=3.0, speed=6.0)
    drag = run(replace(m, loads=(Drag(name="d", link="crank", point="B", linear=2.0, quadratic=3.0),)), 60)
    np.testing.assert_allclose(drag.effort("A"), (2.0 + 3.0 * 3.0) * 3.0 * 0.5, rtol=1e-12)  # at v = 3 m/s on an arm of 0.5 m
    paddle = run(replace(m, loads=(Drag(name="d", link="crank", linear=2.0, quadratic=0.5),)), 60)
    np.testing.assert_allclose(paddle.effort("A"), (2.0 + 0.5 * 6.0) * 6.0, rtol=1e-12)
    damper = run(replace(m, loads=(TorsionDamper(name="d", links=("frame", "crank"), coefficient=0.7),)), 60)
    viscous = run(replace(m, loads=(Viscous(name="d", joint="A", coefficient=0.7),)), 60)
    np.testing.assert_allclose(damper.effort("A"), 0.7 * 6.0, rtol=1e-12)
    np.testing.assert_allclose(viscous.effort("A"), 0.7 * 6.0, rtol=1e-12)
    spring = run(
        replace(m, loads=(TorsionSpring(name="s", links=("frame", "crank"), stiffness=2.0, free_angle=1.0),)), 60, cycles=2
    )
    np.testing.assert_allclose(spring.effort("A"), 2.0 * (spring.motion.coordinate("A")[:, 0] - 1.0), atol=1e-12)  # over two turns
    assert spring.potential_energy[-1] == pytest.approx((4.0 * np.pi - 1.0) ** 2, rel=1e-12)


def test_energy_balance_over_a_run_with_everything():
    """Kinetic + potential - work + dissipated stays the same."""
    forces = run(every_load(), 4000)
    kinetic, stored, work, lost = forces.energy.T
    total = kinetic + stored - work + lost
    assert np.ptp(total) < 1e-8 * np.abs(forces.energy).max()
    assert np.all(np.diff(lost) > 0.0)


def test_gravity_of_its_own_for_a_link():
    bodies = dict.fromkeys(("crank", "coupler"), (2.0, (1.0, 0.0), 1.0))
    m = four_bar(E=(4.0, 0.0), AB=1.0, BD=3.5, DE=3.0, bodies=bodies, effects=("gravity",))
    links = tuple(replace(k, gravity=(3.0, 0.0)) if k.name == "coupler" else k for k in m.links)
    forces = load(replace(m, links=links), ANGLES)
    np.testing.assert_allclose(forces.loads["gravity/coupler"].values[:, :2], [[6.0, 0.0]] * len(ANGLES))
    np.testing.assert_allclose(forces.loads["gravity/crank"].values[:, :2], [[0.0, -19.62]] * len(ANGLES))
    assert balance_of_links(forces) < 1e-12


def test_factors_of_everything():
    """A force of 1 N times a factor that is its own argument shows the argument."""
    m = with_points(four_bar(E=(4.0, 0.0), AB=1.0, BD=3.5, DE=3.0, speed=2.0))
    at = ("coupler", "D")
    motion = solve_motion(compile_mechanism(m), default_times(m, 24))
    expected = {
        "time": motion.time,
        "position": motion.coordinate("D")[:, 0],
        "velocity": motion.coordinate("D")[:, 1],
        "x": motion.point(*at)[:, 0],
        "y": motion.point(*at)[:, 1],
        "vx": motion.point(*at, 1)[:, 0],
        "vy": motion.point(*at, 1)[:, 1],
        "speed": np.hypot(*motion.point(*at, 1).T),
    }
    for of, values in expected.items():
        joint, point = ("D" if of in ("position", "velocity") else None), (at if of[-1] in "xyd" and of != "time" else None)
        factor = Factor(function=lambda x: x, of=of, joint=joint, point=point)
        forces = run(replace(m, loads=(Force(name="F", link="rocker", point="D", vector=(1.0, 0.0), factor=factor),)), 24)
        np.testing.assert_allclose(forces.loads["F"].values[:, 0], values, atol=1e-12, err_msg=of)
    polynomial = Polynomial((1.0, 0.0, 3.0), per=2.0)
    np.testing.assert_allclose(polynomial([0.0, 2.0, 4.0]), [1.0, 4.0, 13.0])


ON = {"link": "crank", "point": "B", "vector": (1.0, 0.0)}
BETWEEN = {"links": ("crank", "frame"), "points": ("B", "E")}
FAULTY = [
    (Force(name="F", **ON, factor=Factor(function=lambda x: 1 / 0)), "loads.F: .*fails: division"),
    (Force(name="F", **ON, factor=Factor(function=lambda x: x * np.nan)), "no finite number at 0"),
    (Force(name="F", **ON, factor=Factor(function=lambda x: np.ones(3))), "loads.F: .*fails|gives"),
    (Force(name="F", **ON, factor=Factor(function=np.cos, of="speed")), "of which point"),
    (Force(name="F", **ON, factor=Factor(function=np.cos, joint="X")), "no joint 'X'"),
    (Force(name="F", **{**ON, "link": "crnk"}), "no link 'crnk'"),
    (Force(name="F", **{**ON, "point": "Q"}), "has no point 'Q'"),
    (Spring(name="F", links=("crank", "crank"), points=("A", "B"), stiffness=1, free_length=0), "'crank' and itself"),
    (Spring(name="F", **BETWEEN, stiffness=-1, free_length=0), "stiffness of -1 is negative"),
    (Actuator(name="F", force=1.0), "between two points or along a joint"),
    (Actuator(name="F", **BETWEEN, joint="A", force=1.0), "between two points or along a joint"),
    (Actuator(name="F", joint="A", force=1.0), "'A' is no sliding joint"),
    (Servo(name="F", joint="X", target=Oscillation(0.0, 1.0, 1.0), proportional=1.0), "'X' is no revolute or sliding joint"),
    (Servo(name="F", joint="A", target=Oscillation(0.0, 1.0, 1.0), proportional=-1.0), "proportional of -1 is negative"),
    (Bushing(name="F", **BETWEEN, stiffness=(1.0, -2.0, 1.0)), "stiffness of -2 is negative"),
    (BushingDamper(name="F", **BETWEEN, damping=(1.0, np.nan, 1.0)), "damping is nan"),
    (Damper(name="F", **BETWEEN), "neither a linear nor a quadratic"),
    (GasSpring(name="F", **BETWEEN, force=1, extended=9, gas_length=0), "gas_length of 0 is zero"),
    (Viscous(name="F", joint="X", coefficient=1), "no joint 'X'"),
    (GasPressure(name="F", joint="A", area=1, cycle=Compressor(stroke=1, suction=1, delivery=2), top=0), "'A' is no sliding"),
    (Torque(name="F", link="crank", moment=float("nan")), "moment is nan"),
]


@pytest.mark.parametrize(("load", "message"), FAULTY)
def test_faulty_loads_are_named(load, message):
    m = four_bar(E=(4.0, 0.0), AB=1.0, BD=3.5, DE=3.0)
    with pytest.raises(MechanismError, match=message):
        run(replace(m, loads=(load,)), 24)
