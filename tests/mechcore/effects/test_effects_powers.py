"""Who supplies and who absorbs: classes, works, shares of drives, flywheels."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
from cases import examples
from hypothesis import given, settings
from loaded import loaded, run
from mechanisms import four_bar, load, slider_crank
from random_linkages import ACCELERATION, ANGLES, SPEED, crank_rockers
from scipy.integrate import cumulative_simpson
from typer.testing import CliRunner

import mechviz
from mechcore.errors import MechanismError
from mechcore.forces.powers import drive_shares, flywheel, flywheel_of_torque, power_table, thinning_change, works
from mechcore.laws.signals import Step
from mechcore.numerics.interpolation import integral_so_far
from mechcore.spec.loads import Damper, Factor, Force, Spring, Torque
from mechviz.commands.main import app
from mechviz.quantities.power_table import force_lines
from mechviz.runs import run_scene


@settings(max_examples=examples(40))
@given(loaded(crank_rockers()))
def test_powers_close_under_random_effects(mechanism):
    forces = load(mechanism, ANGLES, SPEED, ACCELERATION)
    table = power_table(forces)
    assert table.closure <= 1e-9
    net = sum(i.power for i in table.items)
    assert np.abs(net).max() <= 1e-9 * max(np.abs(i.power).max() for i in table.items)
    for i in table.items:
        assert i.supplied >= 0.0 and i.absorbed >= 0.0
        assert i.supplied - i.absorbed == pytest.approx(np.trapezoid(i.power, table.time), abs=1e-9 * max(table.supplied, 1e-9))
        if i.role == "driving":
            assert i.absorbed <= 1e-9 * table.supplied
        if i.role == "resisting":
            assert i.supplied <= 1e-9 * max(table.absorbed, 1e-300)
        if i.cause in ("viscous", "medium"):
            assert i.role in ("resisting", "idle") and i.use == "harmful"


def test_works_of_a_line_through_zero():
    assert works(np.array([3.0, -1.0]), np.array([0.0, 4.0])) == pytest.approx((4.5, 0.5))
    t = np.linspace(0.0, 2.0 * np.pi, 20_001)
    assert works(np.sin(t), t) == pytest.approx((2.0, 2.0), rel=1e-7)
    assert works(np.array([2.0, 4.0, 4.0]), np.array([0.0, 1.0, 1.5])) == pytest.approx((5.0, 0.0))


def test_classes_as_the_lecture_has_them():
    """A compressor: the drive drives, the gas resists on the whole and is useful; friction is harmful; inertia alternates."""
    table = power_table(run_scene(mechviz.load("compressor-cycle"), frames=720).forces)
    computed = {i.label: (i.cause, i.place, i.role, i.use) for i in table.items}
    assert computed["air"] == ("process", "internal", "alternating", "useful")
    assert computed["oil"] == ("viscous", "internal", "resisting", "harmful")
    assert computed["inertia/piston"] == ("inertia", "external", "alternating", "")
    assert computed["inertia/crank"][2] == "idle"  # constant speed, centre of mass on the crank
    assert computed["drive A"][:2] == ("drive", "external")
    engine = power_table(run_scene(mechviz.load("four-stroke-cycle"), frames=720).forces)
    roles = {i.label: i for i in engine.items}
    assert roles["gas"].use == "" and roles["gas"].mean > 0.0  # it drives
    assert roles["work"].use == "useful" and roles["work"].role == "resisting"
    assert roles["gravity/rod"].cause == "gravity" and roles["gravity/rod"].place == "external"
    weights = [i for i in engine.items if i.cause == "gravity"]
    supplied, absorbed = sum(i.supplied for i in weights), sum(i.absorbed for i in weights)
    assert supplied == pytest.approx(absorbed, rel=1e-9)


def test_the_stated_use_of_a_load_counts():
    table = power_table(run_scene(mechviz.load("plunger-in-drag"), frames=240).forces)
    assert {i.name: i.use for i in table.items if i.cause in ("medium", "viscous")} == {
        "liquid": "useful",
        "gland": "harmful",
        "bearing": "harmful",
    }


def test_springs_between_links_are_internal_and_give_back_what_they_take():
    m = four_bar(E=(4.0, 0.0), AB=1.0, BD=3.5, DE=3.0, speed=5.0)
    ends = {"links": ("coupler", "frame"), "points": ("D", "A")}
    loads = (Spring(name="s", **ends, stiffness=30.0, free_length=1.0), Damper(name="d", **ends, linear=4.0))
    table = power_table(run(replace(m, loads=loads), 720))
    spring, damper = table.items[1:]
    assert (spring.cause, spring.place, spring.role) == ("elastic", "internal", "alternating")
    assert spring.supplied == pytest.approx(spring.absorbed, rel=1e-9)
    assert table.items[0].supplied - table.items[0].absorbed == pytest.approx(damper.absorbed, rel=1e-9)


def test_flywheel_of_a_harmonic_torque():
    """T = T0 + T1 sin phi: the excess is 2 T1, between 180 degrees (fastest is where the torque falls below its mean)."""
    for omega, sense in ((20.0, 1.0), (-20.0, -1.0)):
        phi = sense * np.linspace(0.0, 2.0 * np.pi, 73)
        wheel = flywheel_of_torque(phi, sense * (7.0 + 3.0 * np.sin(np.abs(phi))), omega, 0.04)
        assert wheel.excess == pytest.approx(6.0, rel=1e-6)
        assert wheel.inertia == pytest.approx(6.0 / (0.04 * 400.0), rel=1e-6)
        assert wheel.mean == pytest.approx(sense * 7.0, rel=1e-12)
        assert abs(wheel.slowest) == pytest.approx(np.pi, abs=1e-6)
        assert abs(wheel.fastest) % (2.0 * np.pi) == pytest.approx(0.0, abs=1e-6)
    fine, coarse = (
        flywheel_of_torque(np.linspace(0, 2 * np.pi, n), np.sin(np.linspace(0, 2 * np.pi, n)), 1.0, 1.0) for n in (145, 73)
    )
    assert abs(coarse.excess - 2.0) > 12.0 * abs(fine.excess - 2.0) or abs(fine.excess - 2.0) < 1e-12  # of order 4


def test_flywheel_finds_its_extremes_between_the_frames():
    """Twelve frames, none where the torque is its mean: the spline is solved for its crossings."""
    phi = 0.2 + np.linspace(0.0, 2.0 * np.pi, 13)
    wheel = flywheel_of_torque(phi, 3.0 * np.sin(phi), 1.0, 1.0)
    assert wheel.excess == pytest.approx(6.0, rel=2e-3) and wheel.slowest == pytest.approx(np.pi, abs=2e-3)


def test_flywheel_of_a_punch():
    """A press: torque 90 N m over 40 degrees, none over the other 320: excess = T theta (1 - theta / 2 pi), exactly."""
    theta = np.radians(40.0)
    phi = np.array([0.0, 1e-9, theta, theta + 1e-9, 2.0 * np.pi])
    wheel = flywheel_of_torque(phi, np.array([0.0, 90.0, 90.0, 0.0, 0.0]), 10.0, 0.1, smooth=False)
    assert wheel.excess == pytest.approx(90.0 * theta * (1.0 - theta / (2.0 * np.pi)), rel=1e-7)
    assert wheel.mean == pytest.approx(90.0 * theta / (2.0 * np.pi), rel=1e-7)
    assert wheel.fastest in (pytest.approx(0.0, abs=1e-8), pytest.approx(2.0 * np.pi)) and wheel.slowest == pytest.approx(theta)


@pytest.mark.parametrize("smooth", [True, False])
def test_flywheel_of_a_blow(smooth):
    """A blow takes 7 J at once, nothing else: the flywheel has to give all of it."""
    phi = np.array([0.0, 1.0, 2.0, 2.0 + 1e-12, 4.0, 2.0 * np.pi])
    wheel = flywheel_of_torque(phi, np.zeros(6), 10.0, 0.1, smooth=smooth, before=[2], sudden=[7.0])
    assert (wheel.excess, wheel.mean) == pytest.approx((7.0, 3.5 / np.pi), rel=1e-9)
    assert (wheel.fastest, wheel.slowest) == pytest.approx((2.0, 2.0), abs=1e-9)


def test_flywheel_of_a_mechanism_evens_out_its_speed():
    """Energy check: with that inertia the speed that conserves energy varies by the stated fluctuation, to first order."""
    forces = run(
        slider_crank(r=0.05, l=0.2, speed=30.0, loads=(Force(name="F", link="piston", point="C", vector=(-900.0, 0.0),
        factor=Factor(function=lambda x: (1.0 - np.cos(x)) * (np.sin(x) < 0.0))),)), 7200,
    )  # fmt: skip
    wheel = flywheel(forces, 0.02, smooth=False)
    given = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(forces.motion.time) * (forces.power("O")[1:] + forces.power("O")[:-1]))])
    speed = np.sqrt(30.0**2 + 2.0 * (wheel.mean * 30.0 * forces.motion.time - given) / wheel.inertia)
    assert np.ptp(speed**2) / (2.0 * 30.0**2) == pytest.approx(0.02, rel=1e-5)  # the excess work, seen at the frames
    assert np.ptp(speed) / speed.mean() == pytest.approx(0.02, rel=0.02)  # the coefficient of fluctuation, for small ones


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fluctuation": 0.0}, "fluctuation of 0"),
        ({"fluctuation": 0.02, "drive": "X"}, "joint 'X' has no drive.*Driven joints: O"),
    ],
)
def test_flywheels_that_make_no_sense_are_refused(options, message):
    with pytest.raises(MechanismError, match=message):
        flywheel(run(slider_crank(r=1.0, l=3.0), 36), **options)
    with pytest.raises(MechanismError, match="constant speed"):
        flywheel(run_scene(mechviz.load("door-closer"), frames=36).forces, 0.02)


def test_two_drives_share_the_work():
    forces = run_scene(mechviz.load("two-motors"), frames=480).forces
    shares = {s.joint: s for s in drive_shares(power_table(forces))}
    assert set(shares) == {"A", "E"}
    table = power_table(forces)
    lost = sum(i.absorbed for i in table.items if i.cause in ("viscous", "medium"))
    assert sum(s.supplied - s.absorbed for s in shares.values()) == pytest.approx(lost, rel=1e-6)
    for s in shares.values():
        inside = np.zeros(len(s.power), bool)
        for a, b in s.delivers:
            inside |= (forces.motion.time > a) & (forces.motion.time < b)
        np.testing.assert_array_equal(inside[1:-1], (s.power > 1e-9 * np.abs(s.power).max())[1:-1])
        assert len(s.delivers) == 2 and s.absorbed > 0.0  # each brakes once a turn
    braking = [forces.motion.time[s.power < 0.0] for s in shares.values()]
    assert all(len(t) for t in braking)


def test_the_command_prints_and_exports_the_table(tmp_path):
    path = tmp_path / "powers.csv"
    result = CliRunner().invoke(app, ["forces", "compressor-cycle", "--csv", str(path), "--flywheel", "0.02"])
    assert result.exit_code == 0, result.output
    assert "flywheel: " in result.output and "drive A delivers power" in result.output and "harmful" in result.output
    rows = list(csv.DictReader(path.open()))
    assert [r["force"] for r in rows] == ["A", "inertia/crank", "inertia/rod", "inertia/piston", "bearing", "oil", "air"]
    total = sum(float(r["supplied [J]"]) - float(r["absorbed [J]"]) for r in rows)
    assert abs(total) < 1e-9 * sum(float(r["supplied [J]"]) for r in rows)
    refused = CliRunner().invoke(app, ["forces", "crank-rocker"])
    assert refused.exit_code == 2 and "names no effects and no loads" in refused.output
    assert CliRunner().invoke(app, ["forces", "door-closer", "--flywheel", "0.02"]).exit_code == 2
    result = CliRunner().invoke(app, ["forces", "compressor-cycle", "--flywheel", "2"])  # two per cent are 0.02
    assert result.exit_code == 2 and "between 0 and 1, such as 0.02 for 2 %" in result.stderr
    costs = CliRunner().invoke(app, ["plan", "door-closer", "--cost"])
    assert costs.exit_code == 0 and "us/frame" in costs.output and "load damper" in costs.output


def test_torque_on_two_links_is_internal():
    m = four_bar(E=(4.0, 0.0), AB=1.0, BD=3.5, DE=3.0)
    table = power_table(run(replace(m, loads=(Torque(name="M", link="coupler", moment=2.0, against="crank"),)), 36))
    assert table.items[1].place == "internal" and table.closure < 1e-12


def test_friction_absorbs_and_a_steady_load_drives_or_resists_even_where_it_rests():
    """A slider to and fro against a weight (no work at its turns) and dry friction; a load that goes along is driving."""
    table = power_table(run_scene(mechviz.load("slider-crank-friction"), frames=90).forces)
    rubbed = [i for i in table.items if i.cause == "dry friction"]
    assert rubbed and all(i.role == "resisting" and i.use == "harmful" and i.supplied <= 1e-12 * i.absorbed for i in rubbed)
    assert sum(i.absorbed for i in rubbed) > 0.0 and table.closure < 1e-9
    m = slider_crank(r=1.0, l=3.0, loads=(Torque(name="along", link="crank", moment=2.0),))
    along = next(i for i in power_table(load(m, np.linspace(0.0, 6.0, 40), np.linspace(0.0, 3.0, 40))).items if i.label == "along")
    assert (along.role, along.absorbed) == ("driving", 0.0) and along.power[0] == 0.0


def test_too_few_frames_for_works_are_said():
    """Works of a compressor at few frames, against those at 2880; a steady torque needs but a few; rounding is no work."""

    def printed(name: str, frames: int) -> str:
        return "\n".join(force_lines(run_scene(mechviz.load(name), frames=frames).forces))

    exact = power_table(run_scene(mechviz.load("slider-crank-compressor"), frames=2880).forces)
    for frames in (2, 3, 4, 8, 12, 16, 48, 96):
        table = power_table(run_scene(mechviz.load("slider-crank-compressor"), frames=frames).forces)
        off = max(abs(a.supplied - b.supplied) for a, b in zip(table.items, exact.items, strict=True)) / exact.supplied
        assert ("too few for works" in printed("slider-crank-compressor", frames)) == (off > 0.01), (frames, off)
    assert "3 frames are too few" in printed("slider-crank-compressor", 3)
    assert "too few" not in printed("inertia-uniform-rotation", 12)
    steady = load(
        slider_crank(r=1.0, l=3.0, loads=(Torque(name="along", link="crank", moment=2.0),)),
        np.linspace(0.0, 6.0, 6),
        np.linspace(0.0, 3.0, 6),
    )
    assert thinning_change(power_table(steady)) < 1e-12


def test_powers_of_a_run_that_jams_throughout_are_unknown():
    text = mechviz.load("belt-slip").to_toml().replace("coefficient = 0.08", "coefficient = 80")
    forces = run_scene(mechviz.loads(text), frames=8).forces
    unknown = [i for i in power_table(forces).items if i.role == "unknown"]
    assert {i.label for i in unknown} == {"drive A", "friction A", "friction B"}
    assert np.isnan([i.mean for i in unknown]).all() and np.isnan([i.peak for i in unknown]).all()
    words = "\n".join(force_lines(forces))
    assert "need not close" in words and "drive A: its power is unknown throughout" in words


def test_a_drive_delivers_power_as_far_as_it_is_known():
    """Up to the last frame before the sleeve jams."""
    forces = run_scene(mechviz.load("jamming-sleeve"), frames=60).forces
    known = forces.motion.time[np.isfinite(forces.power("V"))]
    (share,) = (s for s in drive_shares(power_table(forces)) if s.joint == "V")
    assert len(known) < 61 and share.delivers == ((0.0, pytest.approx(known[-1])),)


def test_a_flywheel_takes_torques_that_jump_as_straight_lines():
    """The gas of an engine bends sharply: said or not, lines from frame to frame; a spline would swing beyond them."""
    forces = run_scene(mechviz.load("four-stroke-cycle"), frames=180).forces
    assert (
        flywheel(forces, 0.02).inertia
        == flywheel(forces, 0.02, smooth=False).inertia
        != flywheel(forces, 0.02, smooth=True).inertia
    )


UNITS = 'units = { length = "mm", angle = "deg" }'
DROP = f"""
{UNITS}
effects = ["inertia", "gravity"]
run = {{ frames = 90, duration = "1 s" }}
[links]
frame = {{ points = {{ G = [0, 0] }} }}
block = {{ points = {{ T = [0, 0] }}, mass = "2 kg", shape = "point" }}
[joints.S]
prismatic = ["frame", "block"]
at = ["G", "T"]
along = [0, 1]
free = {{ position = 500 }}
stops = [{{ at = 0, side = "lower" }}]
"""


def net(table, label: str) -> float:
    return next(i.supplied - i.absorbed for i in table.items if i.label == label)


def test_what_an_impact_takes_is_a_force_of_its_own():
    """2 kg fall 0.5 m and stay where they land: weight does m g h, the impact takes it, inertia gives back what it has taken."""
    forces = run_scene(mechviz.loads(DROP)).forces
    table = power_table(forces)
    assert (net(table, "gravity/block"), net(table, "impacts")) == pytest.approx((9.81, -9.81), rel=1e-9)
    block, lost = table.items[0], table.items[-1]
    assert (block.supplied, block.absorbed, block.role) == (
        pytest.approx(9.81, rel=1e-9),
        pytest.approx(9.81, rel=1e-9),
        "alternating",
    )
    assert (lost.cause, lost.place, lost.role, lost.use) == ("impact", "internal", "resisting", "harmful") and np.isnan(lost.peak)
    assert table.closure < 1e-9
    assert "impacts        impact" in "\n".join(force_lines(forces))


@pytest.mark.parametrize("drives", [1, 2])
def test_drives_work_in_impacts(drives):
    """A block slides on a carriage of 3 m/s with 1.5 m/s against a stop and comes back with half of that: the drive that keeps the
    carriage's speed takes the impulse m (1 + e) u, at its speed, and m u^2 (1 - e^2) / 2 are lost."""
    other = 'U = { revolute = ["frame", "wheel"], at = ["G", "W"], drive = { speed = "60 rpm" } }' if drives == 2 else ""
    forces = run_scene(mechviz.loads(f"""
{UNITS}
effects = ["inertia"]
run = {{ frames = 50, duration = "0.3 s" }}
[links]
frame = {{ points = {{ G = [0, 0] }} }}
carriage = {{ points = {{ C = [0, 0] }} }}
block = {{ points = {{ T = [0, 0] }}, mass = "2 kg", shape = "point" }}
{"wheel = { points = { W = [0, 0] } }" if drives == 2 else ""}
[joints]
S = {{ prismatic = ["frame", "carriage"], at = ["G", "C"], along = [1, 0], drive = {{ speed = "3 m/s", travel = "1 m" }} }}
{other}
[joints.P]
prismatic = ["carriage", "block"]
at = ["C", "T"]
along = [1, 0]
free = {{ position = 0, speed = "1.5 m/s" }}
stops = [{{ at = 200, side = "upper", restitution = 0.5 }}]
""")).forces  # fmt: skip
    table = power_table(forces)
    assert net(table, "impacts") == pytest.approx(-0.5 * 2.0 * 1.5**2 * 0.75, rel=1e-9)
    assert net(table, "drive S" if drives == 1 else "drives in impacts") == pytest.approx(-2.0 * 1.5 * 1.5 * 3.0, rel=1e-9)
    assert net(table, "inertia/block") == pytest.approx(0.5 * 2.0 * (4.5**2 - 2.25**2), rel=1e-9)
    assert table.closure < 1e-9
    assert sum(s.absorbed for s in drive_shares(table)) == pytest.approx(13.5 if drives == 1 else 0.0, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("frames", [20, 45])
def test_work_so_far_is_the_kinetic_energy_of_a_parabolic_law(frames):
    """A disc is turned to and fro by parabolic laws: its acceleration jumps between frames and at frames, the power with it. A load
    that comes while it turns takes its moment times the angle since then, which the drive gives back."""
    run = run_scene(mechviz.loads(f"""
{UNITS}
effects = ["inertia"]
run = {{ frames = {frames} }}
[links]
frame = {{ points = {{ O = [0, 0] }} }}
disc = {{ points = {{ O = [0, 0] }}, mass = "2 kg", inertia = "0.02 kg m^2" }}
[joints.O]
revolute = ["frame", "disc"]
drive.segments = [{{ duration = "1 s", to = 200, law = "parabolic" }}, {{ duration = "1 s", to = 0, law = "parabolic" }}]
[loads.brake]
torque = "3 N m"
on = "disc"
step = {{ at = "0.3 s" }}
[loads.damper]
torsion_damper = ["frame", "disc"]
linear = "0.5 N m s/rad"
"""))  # fmt: skip
    kinetic, potential, work, lost = run.numbers.values("data", "energy").T
    assert np.ptp(work - kinetic - lost) < 1e-9 * np.abs(work).max() and not potential.any()
    stroke, time = np.radians(200.0), run.motion.time
    into = np.where(time % 1.0 <= 0.5, time % 1.0, 1.0 - time % 1.0)  # speed 4 stroke t up to the middle
    half = (4.0 * stroke) ** 2 * 0.5 * into**3 / 3.0
    each = (4.0 * stroke) ** 2 * 0.5 / 24.0 * 2.0
    assert lost == pytest.approx(each * np.floor(time) + np.where(time % 1.0 <= 0.5, half, each - half), rel=1e-7)
    assert run.motion.velocity("disc")[:, 2] == pytest.approx(np.where(time < 1.0, 1.0, -1.0) * 4.0 * stroke * into, abs=1e-9)


def test_works_of_a_run_with_impacts_are_those_of_its_energies():
    """A valve that floats, landing on its cam, whose drive takes part in it: against changes of energy, known without powers."""
    forces = run_scene(mechviz.load("valve-float"), frames=7200).forces
    table, energy = power_table(forces), np.diff(forces.energy[[0, -1]], axis=0)[0]
    works = [
        net(table, "inertia/cam") + net(table, "inertia/valve"),
        net(table, "valve_spring"),
        net(table, "drive O"),
        net(table, "impacts"),
    ]
    assert works * np.array([-1.0, -1.0, 1.0, -1.0]) == pytest.approx(energy, rel=3e-3)


@pytest.mark.parametrize("frames", [72, 90, 100, 360])
def test_works_and_flywheels_of_accelerations_that_jump(frames):
    """A parabolic law speeds 2 kg up to twice its mean velocity and stops them, whatever the frames: m v^2 / 2, twice a turn."""
    forces = run_scene(mechviz.loads(UNITS + """
effects = ["inertia"]
[links]
frame = { points = { O = [0, 0], G = [0, 95] } }
cam = { points = { O = [0, 0] } }
follower = { points = { T = [0, 0] }, mass = "2 kg" }
[joints.O]
revolute = ["frame", "cam"]
drive = { speed = "600 rpm" }
[joints.S]
prismatic = ["frame", "follower"]
at = ["G", "T"]
along = [0, 1]
[joints.K]
cam = ["cam", "follower"]
follower = { roller = 10, guide = "S", point = "T" }
closure = "form"
[joints.K.profile]
base = 60
phase = 45
lift = [{ over = 60, to = 20, law = "parabolic" }, { over = 40 }, { over = 60, to = 0, law = "parabolic" }, { over = 200 }]
"""), frames=frames).forces  # fmt: skip
    work = 0.5 * 2.0 * (2.0 * 0.02 / (0.1 / 6.0)) ** 2
    drive = power_table(forces).items[0]
    assert (drive.supplied, drive.absorbed) == pytest.approx((2.0 * work, 2.0 * work), rel=1e-6)
    wheel = flywheel(forces, 0.02)
    assert (wheel.excess, wheel.mean) == (pytest.approx(work, rel=1e-6), pytest.approx(0.0, abs=1e-6))
    assert wheel.inertia == pytest.approx(work / (0.02 * (20.0 * np.pi) ** 2), rel=1e-6)


def test_works_of_a_drive_that_speeds_up_evenly():
    """0.3 kg m^2 to 2 rad/s and back to rest: I w^2 / 2 each way, whether or not a frame is where the acceleration jumps."""
    scene = f"""
{UNITS}
effects = ["inertia"]
[links]
frame = {{ points = {{ O = [0, 0] }} }}
wheel = {{ points = {{ O = [0, 0] }}, mass = "1 kg", inertia = "0.3 kg m^2" }}
[joints.O]
revolute = ["frame", "wheel"]
drive = {{ speed = "2 rad/s", zones = {{ run_up = "12 deg", steady = "65 deg", braking = "17 deg" }} }}
"""
    for frames in (20, 23):
        drive = power_table(run_scene(mechviz.loads(scene), frames=frames).forces).items[0]
        assert (drive.supplied, drive.absorbed) == pytest.approx((0.6, 0.6), rel=1e-6)


def test_works_of_a_load_that_steps():
    """2 N m against a shaft of 5 rad/s from 0.37 s on: the work is exact, and the excess T theta (1 - theta / 2 pi)."""
    factor = Factor(of="time", function=Step(before=0.0, after=1.0, at=0.37))
    m = four_bar(E=(4.0, 0.0), AB=1.0, BD=3.5, DE=3.0, speed=5.0)
    forces = run(replace(m, effects=(), loads=(Torque(name="M", link="crank", moment=-2.0, factor=factor),)), 40)
    theta = 2.0 * np.pi - 5.0 * 0.37
    assert net(power_table(forces), "M") == pytest.approx(-2.0 * theta, rel=1e-6)
    wheel = flywheel(forces, 0.1)
    assert (wheel.excess, wheel.mean) == pytest.approx((2.0 * theta * (1.0 - theta / (2.0 * np.pi)), theta / np.pi), rel=1e-6)


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 7, 60])
def test_the_integral_so_far_is_that_of_scipy_and_exact_for_parabolas(frames):
    rng = np.random.default_rng(frames)
    t, y = np.cumsum(rng.uniform(0.1, 1.0, frames)), rng.normal(size=frames)
    assert integral_so_far(y, t) == pytest.approx(cumulative_simpson(y, x=t, initial=0.0), rel=1e-13, abs=1e-13)
    if frames > 2:
        a, b, c = np.polynomial.polynomial.polyfit(t[:3], y[:3], 2)
        whole = [a * x + b * x**2 / 2.0 + c * x**3 / 3.0 for x in t]
        assert integral_so_far(a + b * t + c * t**2, t) == pytest.approx(np.array(whole) - whole[0], rel=1e-9, abs=1e-9)


PUSHED = """
units = { length = "m", angle = "deg" }
effects = ["inertia"]
run = { duration = "1 s", frames = 7 }
[links]
frame = { points = { O = [0, 0] } }
block = { points = { T = [0, 0] }, mass = "2 kg" }
[joints]
S = { prismatic = ["frame", "block"], at = ["O", "T"], along = [1, 0], free = { speed = 3 } }
[loads]
push = { force = ["10 N", 0], on = "block", step = { at = "0.3 s" } }
"""


def test_a_force_that_begins_to_push_a_free_block_between_frames_does_its_work_from_then_on():
    """10 N over 3 t + 2.5 t^2 with t = 0.7 s; the power is straight from the step on, so that few frames are enough."""
    table = power_table(run_scene(mechviz.loads(PUSHED)).forces)
    push, inertia = (next(i for i in table.items if what in i.label) for what in ("push", "inertia"))
    assert (push.supplied, push.absorbed) == pytest.approx((33.25, 0.0), abs=1e-9)
    assert inertia.absorbed == pytest.approx(0.5 * 2.0 * (6.5**2 - 3.0**2), rel=1e-9)
