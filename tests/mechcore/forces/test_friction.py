"""Dry friction in joints: the reference cases, closed forms, and what holds whatever the coefficients are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from comparison_columns import close, column
from frictional import follower, law_of_friction, reference_four_bar, reference_slider_crank, rub
from mechanisms import case, load, slider_crank
from random_linkages import balance_of_links

from mechcore.errors import MechanismError
from mechcore.forces.friction.losses import losses_of_run
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.signals import Step
from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.loads import Factor, Force, Torque, Viscous
from mechcore.spec.mechanism import Drive, Friction, Link, Mechanism, PinSlot, Prismatic, Revolute, Rolling
from mechviz.hard_cases.mechanisms import gears, incline, sleeve

TURN = np.linspace(0.0, 2.0 * np.pi, 181)


def run(m: Mechanism, frames: int = 180):
    return solve_forces(solve_motion(compile_mechanism(m), default_times(m, frames)))


# -- reference cases --------------------------------------------------------------------------------------------------
def test_reference_slider_crank():
    m, c = reference_slider_crank()
    rows = c["expected"]
    forces = load(m, column(rows, "theta_1"), c["inputs"]["omega_1"], c["inputs"]["eps_1"])
    wanted = [r["with_friction"] for r in rows]
    for joint, key in (("O", "R_O_on_1"), ("B", "R_B_on_2"), ("C", "R_C_on_3")):
        close(forces.reaction(joint)[:, :2], column(wanted, key), 1e-14)
    close(forces.reaction("S")[:, 1], column(wanted, "N_guide_on_3"), 1e-14)
    close(forces.reaction("S")[:, 2], column(wanted, "M_guide_on_3"), 1e-13)  # a small difference of large moments
    close(forces.effort("O"), column(wanted, "drive_torque"), 1e-14)
    close(-forces.friction.power, column(wanted, "friction_power_loss"), 1e-14)
    without = load(replace(m, effects=("inertia", "gravity")), column(rows, "theta_1"), c["inputs"]["omega_1"])
    close(without.effort("O"), column([r["frictionless"] for r in rows], "drive_torque"), 1e-12)
    extra = forces.power("O") - without.power("O")
    close(extra, -forces.friction.power, 1e-12)  # what the drive does more is what friction takes
    assert np.abs(forces.power_balance).max() < 1e-14
    assert forces.friction.residual.max() < 1e-14


def test_reference_four_bar():
    m, c = reference_four_bar()
    speed = c["inputs"]["omega_1"]
    rows = [r for r in c["expected"] if r["theta_1_deg"] != 180]
    forces = load(m, column(rows, "theta_1"), speed)
    wanted = [r["with_friction"] for r in rows]
    for joint, key in (("A", "R_A_on_1"), ("B", "R_B_on_2"), ("D", "R_D_on_3"), ("E", "R_E_on_3")):
        close(forces.reaction(joint)[:, :2], column(wanted, key), 1e-12)
    close(forces.effort("A"), column(wanted, "drive_torque"), 1e-12)
    close(-forces.friction.power, column(wanted, "friction_power_loss"), 1e-12)
    assert np.abs(forces.power_balance).max() < 1e-14


def test_reference_four_bar_where_a_pin_is_at_rest():
    """With the crank along the frame, coupler and rocker turn together: at D friction has two limits, zero is between them.

    At 0 the reference, too, has a friction of zero there; at 180 degrees its angle is a rounded pi, and it has one of the limits.
    """
    m, c = reference_four_bar()
    row = next(r for r in c["expected"] if r["theta_1_deg"] == 180)["with_friction"]
    assert load(m, [0.0, np.pi], 12.0).friction.state("D") == ["at rest", "at rest"]
    h = 1e-5
    before, at, after = (load(m, np.pi + np.array(d), 12.0) for d in ([-h, -2 * h, -3 * h], [0.0], [h, 2 * h, 3 * h]))

    def limit(values):
        return 3 * values[0] - 3 * values[1] + values[2]

    computed = [limit(side.effort("A")) for side in (before, after)]
    assert min(abs(np.array(computed) / row["drive_torque"] - 1.0)) < 1e-11
    assert computed[0] != pytest.approx(computed[1], rel=1e-3)
    assert at.effort("A")[0] == pytest.approx(np.mean(computed), rel=1e-4)
    side = (before, after)[int(np.argmin(abs(np.array(computed) - row["drive_torque"])))]
    for joint, key in (("A", "R_A_on_1"), ("B", "R_B_on_2"), ("D", "R_D_on_3"), ("E", "R_E_on_3")):
        np.testing.assert_allclose(limit(side.reaction(joint)[:, :2]), row[key], rtol=1e-11)


@pytest.mark.parametrize("row", case("friction", "friction-incline")["expected"])
def test_reference_incline(row):
    weight = 2.0 * 9.81
    up = load(incline(row["alpha"], row["mu"]), [0.2], 0.1)
    assert up.effort("H")[0] / weight == pytest.approx(row["horizontal_force_per_weight_to_push_up"], rel=1e-12)
    down = load(incline(row["alpha"], row["mu"]), [0.2], -0.1)
    assert down.effort("H")[0] / weight == pytest.approx(
        row["horizontal_force_per_weight_to_hold_or_push_down"], rel=1e-6, abs=1e-15
    )
    locked = not row["slides_from_rest"]
    for forces in (up, down):  # both ask the same question: can the weight move the pusher?
        assert forces.friction.self_locking[0] == locked
    # let go of while it moves up, the block slows down as the reference says: then its drive has nothing to do
    mass_only = replace(incline(row["alpha"], row["mu"]), effects=("gravity", "inertia", "friction"))
    along = replace(mass_only, drives=(Drive(joint="P", law=ConstantSpeed(0.2, 0.1)),))
    assert load(along, [0.2], 0.1, -row["deceleration_if_moving_up"]).effort("P")[0] == pytest.approx(0.0, abs=1e-12 * weight)


@pytest.mark.parametrize("row", case("friction", "friction-jamming")["expected"]["sleeve"])
def test_reference_sleeve_jams_where_it_should(row):
    mu, b, x = row["mu"], row["bearing_length"], row["critical_eccentricity"]
    for part in (0.1, 0.5, 0.9, 1.0 - 1e-9):
        forces = load(sleeve(part * x, b, mu), [0.0], 0.1)
        assert forces.effort("H")[0] == pytest.approx(30.0 / (1.0 - part), rel=1e-6 if part > 0.99 else 1e-12)
        assert forces.reaction("S")[0, 2] == pytest.approx(forces.effort("H")[0] * part * x, rel=1e-9) or part < 1.0
    for part in (1.0 + 1e-9, 1.5, 40.0):
        forces = load(sleeve(part * x, b, mu), [0.0], 0.1)
        assert forces.friction.jammed.all() and np.isnan(forces.effort("H")).all()
        assert forces.friction.jammed_by(0) == ("S",)
        assert forces.friction.movable_share[0] == pytest.approx(1.0 / part, rel=1e-9)
        assert np.isnan(forces.reaction("T")).any() and np.isnan(forces.power_balance).all()


@pytest.mark.parametrize("row", case("friction", "friction-jamming")["expected"]["follower_guide"])
def test_reference_follower_in_its_guide(row):
    m = follower(row["pressure_angle"], row["overhang"], row["guide_length"], row["mu"], row["axial_load"])
    forces = load(m, [0.0], 0.1)
    assert forces.friction.jammed[0] == row["jams"]
    if row["jams"]:
        return
    assert np.hypot(*forces.reaction("K")[0, :2]) == pytest.approx(row["contact_force"], rel=1e-12)
    both = row["lower_bearing_force"] + row["upper_bearing_force"]
    assert forces.friction.normal_load("S")[0] == pytest.approx(both, rel=1e-12)
    assert forces.reaction("S")[0, 1] == pytest.approx(-row["mu"] * both, rel=1e-12)


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("arm", [1.0 - 1e-9, 1.0 + 1e-9, 0.2, 5.0])
def test_a_force_whose_line_cuts_the_friction_circle_cannot_turn_the_pin(arm, exact):
    """The friction circle has the radius mu r, exactly r sin(atan mu); the line of the force passes the pin at ``arm`` of that."""
    mu, r = 0.4, 0.02
    circle = r * (np.sin(np.arctan(mu)) if exact else mu)
    lever = Link(name="lever", points={"O": (0.0, 0.0), "P": (arm * circle, 0.3)})
    pin = Revolute(name="O", links=("frame", "lever"), points=("O", "O"), friction=Friction(coefficient=mu, radius=r, exact=exact))
    m = Mechanism(
        name="lever",
        frame="frame",
        links=(Link(name="frame", points={"O": (0.0, 0.0)}), lever),
        joints=(pin,),
        drives=(Drive(joint="O", law=ConstantSpeed(0.0, 1.0)),),
        loads=(Force(name="F", link="lever", point="P", vector=(0.0, -80.0), axes="link"),),
        effects=("friction",),
    )
    for speed in (2.0, -2.0):  # against the load, and with it
        forces = load(m, [0.0, 0.7], speed)
        assert (forces.friction.self_locking == (arm <= 1.0)).all()
        np.testing.assert_allclose(forces.effort("O"), 80.0 * circle * (arm + np.sign(speed)), rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize("mu,b,a", [(0.1, 0.05, 0.03), (0.2, 0.05, 0.06)])
def test_critical_pressure_angle(mu, b, a):
    critical = np.arctan(b / (mu * (2 * a + b)))
    assert not load(follower(critical - 1e-9, a, b, mu, 200.0), [0.0], 0.1).friction.jammed[0]
    assert load(follower(critical + 1e-9, a, b, mu, 200.0), [0.0], 0.1).friction.jammed[0]


# -- closed forms -----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("exact", [False, True])
def test_pin_by_hand(exact):
    """A crank with a weight straight below its pin: the torque is mu r W, with the friction circle r sin(atan mu) W."""
    mu, r, weight = 0.4, 0.03, 50.0
    m = Mechanism(
        name="wheel",
        frame="frame",
        links=(Link(name="frame", points={"A": (0.0, 0.0)}), Link(name="wheel", points={"A": (0.0, 0.0), "Q": (0.2, 0.0)})),
        joints=(
            Revolute(
                name="A",
                links=("frame", "wheel"),
                points=("A", "A"),
                friction=Friction(coefficient=mu, radius=r, exact=exact),
            ),
        ),
        drives=(Drive(joint="A", law=ConstantSpeed(0.0, 1.0)),),
        loads=(Force(name="W", link="wheel", point="A", vector=(0.0, -weight)),),
        effects=("friction",),
    )
    forces = load(m, TURN, 3.0)
    arm = r * np.sin(np.arctan(mu)) if exact else mu * r
    np.testing.assert_allclose(forces.effort("A"), arm * weight, rtol=1e-14)
    np.testing.assert_allclose(forces.reaction("A")[:, 2], -arm * weight, rtol=1e-14)
    np.testing.assert_allclose(load(m, TURN, -3.0).effort("A"), -arm * weight, rtol=1e-14)


def test_ends_of_a_bearing_press_on_the_same_side_or_on_opposite_sides():
    """A slider loaded across at a distance e from the middle: mu F while e < b / 2, then 2 mu F e / b."""
    b, mu, f = 0.08, 0.15, 100.0
    for e in (0.0, 0.02, 0.0399, 0.0401, 0.1):
        for guide in (0, 1):
            links = ("frame", "block") if guide == 0 else ("block", "frame")
            points = ("O", "S") if guide == 0 else ("S", "O")
            m = Mechanism(
                name="bearing",
                frame="frame",
                links=(Link(name="frame", points={"O": (0.0, 0.0)}), Link(name="block", points={"S": (0.0, 0.0), "E": (e, 0.0)})),
                joints=(Prismatic(name="S", links=links, points=points, guide=guide, friction=Friction(coefficient=mu, length=b)),),
                drives=(Drive(joint="S", law=ConstantSpeed(0.0, 1.0)),),
                loads=(Force(name="F", link="block", point="E", vector=(0.0, -f)),),
                effects=("friction",),
            )
            forces = load(m, [0.0, 0.3], 2.0)
            np.testing.assert_allclose(forces.effort("S"), mu * f * max(1.0, 2.0 * e / b), rtol=1e-13)
            assert balance_of_links(forces) < 1e-13
            # a bearing that stays with the frame: the arm of the load about its middle changes with the stroke
            standing = rub(m, S=Friction(coefficient=mu, length=b, bearing="guide", offset=0.1))
            arms = np.abs(np.array([0.0, 0.3]) + e - 0.1)
            np.testing.assert_allclose(
                load(standing, [0.0, 0.3], 2.0).effort("S"), mu * f * np.maximum(1.0, 2 * arms / b), rtol=1e-12
            )


@pytest.mark.parametrize("speed", [1.0, -1.0])
def test_height_of_the_guide_by_hand(speed):
    """Friction on the faces of a guide of height d makes a couple about its middle line: C = (N2 - N1) b / 2 - s mu N d / 2."""
    b, d, mu, f, e = 0.08, 0.05, 0.3, 100.0, 0.06
    m = Mechanism(
        name="bearing",
        frame="frame",
        links=(Link(name="frame", points={"O": (0.0, 0.0)}), Link(name="block", points={"S": (0.0, 0.0), "E": (e, 0.0)})),
        joints=(
            Prismatic(name="S", links=("frame", "block"), points=("O", "S"), friction=Friction(coefficient=mu, length=b, height=d)),
        ),
        drives=(Drive(joint="S", law=ConstantSpeed(0.0, 1.0)),),
        loads=(Force(name="F", link="block", point="E", vector=(0.0, -f)),),
        effects=("friction",),
    )
    # unknown ends n1, n2 (up positive) and the drive on the axis: each end's friction acts on the face that it presses on
    best = None
    for s1, s2 in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        s = np.sign(speed)
        # friction at an end: -s mu |n| at the height -sign(n) d/2, moment about the middle: -(-sign d/2)(-s mu |n|) = -s mu n d/2
        n1, n2 = np.linalg.solve([[1, 1], [-b / 2 - s * mu * d / 2, b / 2 - s * mu * d / 2]], [f, f * e])
        if n1 * s1 >= 0 and n2 * s2 >= 0:
            best = (n1, n2)
    assert best is not None
    forces = load(m, [0.0], speed)
    assert forces.effort("S")[0] == pytest.approx(np.sign(speed) * mu * (abs(best[0]) + abs(best[1])), rel=1e-13)
    assert forces.friction.wrench("S")[0, 2] == pytest.approx(-np.sign(speed) * mu * f * d / 2, rel=1e-13)
    assert balance_of_links(forces) < 1e-13
    assert abs(forces.power_balance[0]) < 1e-14


def test_rolling_resistance_needs_the_torque_of_the_lever():
    """A wheel with weight G on level ground, pulled at its axle: the pull is G f / R."""
    radius, lever, mass = 0.3, 0.004, 40.0
    m = Mechanism(
        name="wheel",
        frame="frame",
        links=(Link(name="frame", points={"O": (0.0, radius)}), Link(name="wheel", points={"W": (0.0, 0.0)}, mass=mass)),
        joints=(Rolling(name="R", links=("frame", "wheel"), points=("O", "W"), radius=radius, friction=Friction(lever=lever)),),
        drives=(Drive(joint="R", law=ConstantSpeed(0.0, 1.0)),),
        effects=("gravity", "friction"),
    )
    for speed in (2.0, -2.0):
        forces = load(m, [0.0, 0.5], speed)
        np.testing.assert_allclose(forces.effort("R"), np.sign(speed) * mass * 9.81 * lever / radius, rtol=1e-13)
        assert np.abs(forces.power_balance).max() < 1e-14
        assert balance_of_links(forces) < 1e-12


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_gears_by_hand(sign):
    """Two gears, loads M: with F the tooth force, pins carry F, all moments of friction are proportional to F."""
    lever, r1, r2, pressure = 0.002, 0.1, 0.2, np.radians(20.0)
    forces = load(gears(lever, sign), [0.0, 1.0], 5.0)
    # gear 2: M = F cos(p) r2 -+ friction; turning speeds 5 and -2.5, relative -7.5
    brake2, drag = 0.1 * 0.01, lever
    resists = sign > 0  # the load turns gear 2 against its motion
    way = 1.0 if resists else -1.0
    f = 40.0 / (r2 * np.cos(pressure) - way * (brake2 + drag))
    effort = way * f * r1 * np.cos(pressure) + f * (brake2 + drag)
    np.testing.assert_allclose(np.hypot(*forces.reaction("G")[:, :2].T), f, rtol=1e-12)
    np.testing.assert_allclose(forces.effort("A"), effort, rtol=1e-12)
    assert np.abs(forces.power_balance).max() < 1e-14
    assert balance_of_links(forces) < 1e-12


def test_friction_may_ask_for_the_other_flank():
    """A load that would drive gear 2, whose pressed bearing holds it back by more: the motor drives it, on the other flank."""
    p, r1, r2, mu, r = np.radians(20.0), 0.1, 0.2, 0.1, 0.01
    pressed = Force(name="P", link="two", point="B", vector=(0.0, -5000.0))
    m = gears(0.0, -1.0)
    m = replace(m, loads=(replace(m.loads[0], moment=-1.0), pressed))
    forces = load(m, [0.0, 1.0], 5.0)  # gear 2 turns clockwise, and its load with it
    f = 0.0
    for _ in range(60):  # tooth force: it pushes the rim of gear 2 up and, as flanks do, away from gear 1
        bearing = np.hypot(f * np.sin(p), -5000.0 + f * np.cos(p))
        f = (mu * r * bearing - 1.0) / (r2 * np.cos(p))
    assert f > 10.0
    np.testing.assert_allclose(forces.reaction("G")[:, :2], [[f * np.sin(p), f * np.cos(p)]] * 2, rtol=1e-9)
    np.testing.assert_allclose(forces.effort("A"), f * np.cos(p) * r1 + mu * r * f, rtol=1e-9)
    assert np.abs(forces.power_balance).max() < 1e-13
    assert balance_of_links(forces) < 1e-12


def test_gears_whose_teeth_rub_too_much_jam_and_have_no_force():
    forces = load(gears(0.5), [0.0, 1.0], 5.0)
    assert forces.friction.jammed.all() and forces.friction.jammed_by(0) == ("G",)
    for joint in "ABG":
        assert np.isnan(forces.reaction(joint)[:, :2]).all()
    assert np.isnan(forces.effort("A")).all()


def test_pin_in_a_slot():
    """Scotch yoke with a pin in the slot: the yoke's load F presses on the pin, the slot's friction pulls along the slot."""
    mu, f, r = 0.2, 300.0, 0.05
    m = Mechanism(
        name="yoke",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0)}),
            Link(name="crank", points={"O": (0.0, 0.0), "A": (r, 0.0)}),
            Link(name="yoke", points={"S": (0.0, 0.0)}),
        ),
        joints=(
            Revolute(name="O", links=("frame", "crank"), points=("O", "O")),
            Prismatic(name="H", links=("frame", "yoke"), points=("O", "S")),
            PinSlot(
                name="A",
                links=("yoke", "crank"),
                points=("S", "A"),
                along=(0.0, 1.0),
                friction=Friction(coefficient=mu, radius=0.01),
            ),
        ),
        drives=(Drive(joint="O", law=ConstantSpeed(0.0, 4.0)),),
        loads=(Force(name="F", link="yoke", point="S", vector=(f, 0.0)),),
        effects=("friction",),
    )
    theta = np.array([0.3, 1.2, 2.0, 4.0, 5.5])
    forces = load(m, theta, 4.0)
    # the pin pushes the yoke with -F, the yoke the pin with F; the pin slides by r sin(theta) and turns against the yoke
    up = np.sign(np.cos(theta))
    wanted = r * (f * np.sin(theta) + mu * f * up * np.cos(theta)) + mu * 0.01 * f
    np.testing.assert_allclose(forces.effort("O"), wanted, rtol=1e-12)
    assert balance_of_links(forces) < 1e-12
    assert np.abs(forces.power_balance).max() < 1e-14


def test_offset_of_a_bearing_that_slides_along():
    """The middle of the bearing lies 30 mm ahead of the slider's point: the arm of a load at 50 mm is 20 mm."""
    b, mu, f = 0.02, 0.1, 100.0
    m = Mechanism(
        name="bearing",
        frame="frame",
        links=(Link(name="frame", points={"O": (0.0, 0.0)}), Link(name="block", points={"S": (0.0, 0.0), "E": (0.05, 0.0)})),
        joints=(
            Prismatic(
                name="S", links=("frame", "block"), points=("O", "S"), friction=Friction(coefficient=mu, length=b, offset=0.03)
            ),
        ),
        drives=(Drive(joint="S", law=ConstantSpeed(0.0, 1.0)),),
        loads=(Force(name="F", link="block", point="E", vector=(0.0, -f)),),
        effects=("friction",),
    )
    np.testing.assert_allclose(load(m, [0.0, 0.4], 1.0).effort("S"), mu * f * 2 * 0.02 / b, rtol=1e-13)


def test_numbers_that_are_no_friction_are_refused():
    m, _ = reference_slider_crank()
    for wrong in (Friction(coefficient=-0.1, radius=0.01), Friction(coefficient=np.nan, radius=0.01), Friction(coefficient=0.1)):
        with pytest.raises(MechanismError, match=r"joints\.B\.friction"):
            load(rub(m, B=wrong), TURN, 1.0)


# -- what always holds ------------------------------------------------------------------------------------------------
def test_losses_are_linear_in_small_coefficients():
    """mu -> 0 gives the frictionless answer; halving a small coefficient halves the loss, the rest is of second order."""
    without = run(replace(reference_slider_crank()[0], effects=("inertia", "gravity")))
    losses = []
    for scale in (1e-3, 5e-4, 1e-6):
        forces = run(reference_slider_crank(scale)[0])
        losses.append(-forces.friction.power / scale)
        difference = np.abs(forces.effort("O") - without.effort("O")).max()
        assert difference < 1.01 * scale * 12.0
    assert np.abs(losses[0] - losses[2]).max() < 1e-3 * np.abs(losses[2]).max()
    ratio = np.abs(losses[0] - losses[2]).max() / np.abs(losses[1] - losses[2]).max()
    assert ratio == pytest.approx(2.0, rel=1e-2)


def test_time_reversal_changes_the_sign_of_friction():
    """Backwards at the same accelerations friction points the other way; efforts mirror about the frictionless ones."""
    m, _ = reference_slider_crank(1e-7)
    ahead = load(m, TURN[:-1] + 0.01, 40.0)
    back = load(m, TURN[:-1] + 0.01, -40.0)
    middle = load(replace(m, effects=("inertia", "gravity")), TURN[:-1] + 0.01, 40.0)
    for joint in ("O", "B", "C"):
        plus, minus = ahead.friction.wrench(joint), back.friction.wrench(joint)
        np.testing.assert_allclose(plus[:, 2], -minus[:, 2], rtol=0, atol=1e-5 * np.abs(plus[:, 2]).max())
    gain = ahead.effort("O") - middle.effort("O")
    np.testing.assert_allclose(gain, middle.effort("O") - back.effort("O"), rtol=0, atol=1e-5 * np.abs(gain).max() + 1e-12)
    # and the way back that `back_driving_power` looks at is exactly this motion
    full = load(reference_slider_crank()[0], TURN[:-1] + 0.01, 40.0)
    turned = load(reference_slider_crank()[0], TURN[:-1] + 0.01, -40.0)
    power = np.where(full.friction.frictionless_power < 0, full.power_supplied, turned.power_supplied)
    np.testing.assert_allclose(full.friction.back_driving_power, power, rtol=1e-11, atol=1e-9)


def test_balance_energy_and_efficiency():
    forces = run(reference_slider_crank()[0], 720)
    assert balance_of_links(forces) < 1e-12
    assert law_of_friction(forces) < 1e-12
    assert np.abs(forces.power_balance).max() < 1e-13
    friction = forces.friction
    assert friction.power.max() <= 0.0
    for joint in friction.joints:
        assert friction.losses(joint).min() >= 0.0
    assert forces.dissipated[0] == 0.0 and (np.diff(forces.dissipated) > 0).all()
    kinetic, potential, work, lost = forces.energy.T
    left = kinetic + potential - (kinetic + potential)[0] - work + lost
    assert np.abs(left).max() < 1e-4 * np.abs(work).max()
    # over a cycle the constant force on the piston does no work: all that the drive supplies is lost
    losses = losses_of_run(forces)
    assert losses.efficiency == pytest.approx(0.0, abs=1e-3)
    assert sum(losses.mean.values()) == pytest.approx(-friction.power.mean(), rel=1e-2)


def test_what_harmful_loads_take_is_no_use():
    """A rotor with three equal absorbers: a useful torque, oil, and dry friction."""
    rotor = Mechanism(
        name="rotor",
        frame="frame",
        links=(Link(name="frame", points={"O": (0, 0)}), Link(name="rotor", points={"O": (0, 0)})),
        joints=(Revolute(name="O", links=("frame", "rotor"), points=("O", "O"), friction=Friction(coefficient=0.1, radius=0.01)),),
        drives=(Drive(joint="O", law=ConstantSpeed(0.0, 2.0)),),
        loads=(
            Force(name="P", link="rotor", point="O", vector=(0.0, -1000.0)),
            Torque(name="work", link="rotor", moment=-1.0),
            Viscous(name="oil", joint="O", coefficient=0.5),
        ),
        effects=("friction",),
    )
    forces = solve_forces(solve_motion(compile_mechanism(rotor), np.linspace(0.0, np.pi, 19)))
    assert losses_of_run(forces).efficiency == pytest.approx(1.0 / 3.0, rel=1e-9)


def test_efficiency_of_the_incline_is_the_textbook_one():
    alpha, mu = 0.4, 0.1
    rho = np.arctan(mu)
    up, down = load(incline(alpha, mu), [0.2, 0.25], 0.1), load(incline(alpha, mu), [0.25, 0.2], -0.1)
    assert losses_of_run(up).efficiency == pytest.approx(np.tan(alpha) / np.tan(alpha + rho), rel=1e-12)
    assert losses_of_run(down).efficiency == pytest.approx(np.tan(alpha - rho) / np.tan(alpha), rel=1e-12)


def test_friction_at_rest_is_zero_and_the_sign_changes_around_it():
    m, _ = reference_slider_crank()
    dead = solve_forces(solve_motion(compile_mechanism(m), default_times(m, 8)))
    e = rub(
        slider_crank(r=0.05, l=0.18, loads=(Force(name="F", link="piston", point="C", vector=(-9.0, -2.0)),)),
        S=Friction(coefficient=0.2),
    )
    forces = load(e, [-1e-3, 0.0, 1e-3], 1.0)  # the crank's and the rod's dead centre
    assert forces.friction.state("S") == ["slips +", "at rest", "slips -"]
    x = forces.friction.wrench("S")[:, 0]
    assert x[1] == 0.0 and x[0] == pytest.approx(-x[2], rel=1e-2) and x[0] < 0.0
    assert set(dead.friction.state("O")) == {"slips +"}


def test_a_joint_that_never_moves_rubs_nowhere():
    """The coupler of a parallelogram does not turn; a pin between it and a link at rest to it has no friction."""
    m = replace(
        incline(0.3, 0.2),
        links=(*incline(0.3, 0.2).links, Link(name="lid", points={"P": (0.0, 0.0), "Z": (0.1, 0.0)}, mass=1.0)),
    )
    m = replace(
        m,
        joints=(
            *m.joints,
            Revolute(name="Z", links=("block", "lid"), points=("P", "P"), friction=Friction(coefficient=0.3, radius=0.01)),
        ),
        drives=(*m.drives, Drive(joint="Z", law=ConstantSpeed(0.0, 0.0))),
    )
    forces = load_two(m)
    assert set(forces.friction.state("Z")) == {"at rest"}
    assert np.all(forces.friction.wrench("Z") == 0.0)


def load_two(m: Mechanism):
    q = np.array([0.2, 0.21])
    values = {"H": (q, 0.1 + 0 * q, 0 * q), "Z": (0 * q, 0 * q, 0 * q)}
    return solve_forces(solve_motion(compile_mechanism(m), np.arange(2), drives=values))


def test_a_scene_without_friction_never_iterates(monkeypatch):
    """Calls are counted, not time: coefficients alone do nothing while the effect is not named."""
    from mechcore.forces import equilibrium
    from mechcore.forces.friction import normal_loads as fixedpoint

    calls = {"newton": 0, "transmit": 0}
    newton, transmit = fixedpoint._newton, equilibrium.joint_forces

    def count(name, function):
        def counted(*args, **more):
            calls[name] += 1
            return function(*args, **more)

        return counted

    monkeypatch.setattr(fixedpoint, "_newton", count("newton", newton))
    monkeypatch.setattr(equilibrium, "joint_forces", count("transmit", transmit))
    m, _ = reference_slider_crank()
    plain = load(replace(m, effects=("inertia", "gravity")), TURN, 40.0)
    assert calls == {"newton": 0, "transmit": 1}
    assert plain.friction is None and np.all(plain.dissipated == 0.0)
    load(m, TURN, 40.0)
    assert calls["newton"] == 1 and calls["transmit"] == 4  # the loads, all units of friction at once, and both together


def test_redundant_constraints_are_refused_where_they_hide_the_normal_load():
    """A slider in two parallel guides: how they share its load is not a matter of statics; one pin outside it is."""
    m = slider_crank(r=0.05, l=0.2, loads=(Force(name="F", link="piston", point="C", vector=(-50.0, 0.0)),))
    second = Prismatic(name="S2", links=("frame", "piston"), points=("G", "C"))
    doubled = replace(m, joints=(*m.joints, second))
    with pytest.raises(MechanismError, match="statics does not determine the contact force at S"):
        load(rub(doubled, S=Friction(coefficient=0.1)), TURN, 1.0)
    journal = Friction(coefficient=0.1, radius=0.01)
    same = load(rub(doubled, B=journal), TURN, 1.0), load(rub(m, B=journal), TURN, 1.0)
    np.testing.assert_allclose(same[0].effort("O"), same[1].effort("O"), rtol=0, atol=1e-9)


def test_a_wedge_between_three_guides_needs_the_force_of_the_textbook():
    """Couples in the guides are redundant, but friction follows from their forces alone, by the equilibrium of both bodies. It was
    refused. With the length of a bearing, the couple there counts."""
    slope, mu, p = np.radians(8.0), 0.15, 1000.0
    guides = (
        Prismatic(name="A", links=("frame", "wedge"), points=("O", "O"), along=(1.0, 0.0)),
        Prismatic(name="W", links=("wedge", "block"), points=("O", "W"), along=(np.cos(slope), -np.sin(slope))),
        Prismatic(name="B", links=("frame", "block"), points=("O", "W"), along=(0.0, 1.0)),
    )
    links = (
        Link(name="frame", points={"O": (0.0, 0.0)}),
        Link(name="wedge", points={"O": (0.0, 0.0)}),
        Link(name="block", points={"W": (0.0, 0.0)}),
    )
    weight = Force(name="P", link="block", point="W", vector=(0.0, -p))
    for sense in (1.0, -1.0):
        drives = (Drive(joint="A", law=ConstantSpeed(0.0, sense * 0.01, travel=0.02)),)
        m = Mechanism(
            name="wedge", frame="frame", links=links, joints=guides, drives=drives, loads=(weight,), effects=("friction",)
        )
        rubbing = Friction(coefficient=mu)
        mu_up = sense * mu  # the wedge is pushed under the block, which rises, or drawn out
        forces = load(rub(m, A=rubbing, W=rubbing, B=rubbing), [0.001, 0.002], sense)
        across, down = np.sin(slope) + mu_up * np.cos(slope), np.cos(slope) - mu_up * np.sin(slope)  # per normal force
        n = p / (down - mu_up * abs(across))
        np.testing.assert_allclose(forces.effort("A"), n * (across + mu_up * down), rtol=1e-9)
    with pytest.raises(MechanismError, match="statics does not determine the contact force at A"):
        load(rub(m, A=Friction(coefficient=mu, length=0.04)), [0.001], 1.0)


@pytest.mark.parametrize("frames", [40, 401])
def test_losses_and_efficiency_count_both_sides_of_a_jump(frames: int) -> None:
    """A load that begins between two frames: by straight lines from frame to frame they were off by up to half a frame."""
    on = Factor(function=Step(at=0.531), of="time")
    rotor = Mechanism(
        name="rotor",
        frame="frame",
        links=(Link(name="frame", points={"O": (0, 0)}), Link(name="rotor", points={"O": (0, 0)})),
        joints=(Revolute(name="O", links=("frame", "rotor"), points=("O", "O"), friction=Friction(coefficient=0.2, radius=0.02)),),
        drives=(Drive(joint="O", law=ConstantSpeed(0.0, 5.0)),),
        loads=(
            Force(name="P", link="rotor", point="O", vector=(0.0, -1000.0), factor=on),
            Torque(name="work", link="rotor", moment=-30.0),
        ),
        effects=("friction",),
    )
    losses = losses_of_run(solve_forces(solve_motion(compile_mechanism(rotor), np.linspace(0.0, 1.0, frames))))
    lost = 0.2 * 0.02 * 1000.0 * 5.0 * (1.0 - 0.531)
    assert losses.mean["O"] == pytest.approx(lost, rel=1e-6)
    assert losses.efficiency == pytest.approx(150.0 / (150.0 + lost), rel=1e-6)
