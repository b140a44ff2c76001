"""The gallery: scenes are the mechanisms that their references describe; that all run and close, see test_recording."""

from __future__ import annotations

import numpy as np
import pytest

import mechviz
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.motion.structure import groups, gruebler, rank_mobility, redundant_joints
from recordings import gallery_scene, ran

NAMES = [entry.name for entry in mechviz.gallery()]


def motion_of(name: str, *, at: float | None = None) -> Motion:
    """A gallery scene over its own run, or at one position of its first drive [rad] with the speed of the start."""
    scene = gallery_scene(name)
    if scene.simulation is not None:
        return ran(name).motion
    compiled = compile_mechanism(scene.mechanism)
    if at is None:
        return solve_motion(compiled, default_times(scene.mechanism, scene.frames, scene.cycles))
    drive = scene.mechanism.drives[0]
    _, speed, acceleration = drive.law(0.0)
    return solve_motion(compiled, [0.0], drives={drive.joint: ([at], speed, acceleration)})


def size_of(motion: Motion) -> float:
    """A length of the mechanism [m]: its widest link."""
    return max(np.ptp([*link.points.values()], axis=0).max() for link in motion.mechanism.links)


def test_the_gallery_has_what_it_promises():
    promised = {
        "crank-rocker", "slider-crank-compressor", "slider-crank-engine", "contour-lever", "kinetostatic-four-bar",
        "watt-six-bar", "jansen-leg", "triad", "shaper-quick-return", "peaucellier", "elliptic-trammel", "scotch-yoke",
        "ten-link", "five-bar", "planetary-gear", "gear-train", "geared-slider-cranks", "rack-and-pinion", "belt-drive",
        "rolling-wheel", "slotted-lever", "excavator-arm", "parallelogram", "antiparallelogram", "kite", "piston-driven-crank",
        "double-parallelogram", "two-guides", "near-flat-four-bar", "eight-bar", "stephenson-six-bar", "micro-gripper",
        "plans-four-bar", "coriolis-lever",
        "polodes-four-bar", "instant-centres", "inflection-circle", "connecting-rod-inertia", "cam-by-inversion",
        "cardan-circles", "four-forces", "parallel-forces", "substitute-masses", "reduced-inertia",
        "shaking-four-bar", "shaking-engine", "percussion-centre", "inertia-translation", "inertia-uniform-translation",
        "inertia-rotation-about-centre", "inertia-uniform-rotation-about-centre", "inertia-uniform-rotation",
        "counterweighted-four-bar", "lumped-rod", "connecting-rod-bending",
        "coupled-antiparallelograms", "parallelogram-six-bar", "four-bar-chain",
        "engine-mounts", "servo-arm", "stribeck-block", "lifted-boom", "thrown-wrench",
    }  # fmt: skip
    assert promised <= set(NAMES)
    assert sorted(NAMES) == NAMES


def test_every_gallery_scene_has_a_title_and_teaches_one_sentence():
    for entry in mechviz.gallery():
        assert 5 < len(entry.title) < 80, entry.name
        assert entry.learning_goal.endswith(".") and 30 < len(entry.learning_goal) < 200, entry.name


def forces_of(name: str, *, at: float | None = None) -> Forces:
    scene = mechviz.load(name)
    return solve_forces(motion_of(name, at=at)) if scene.simulation is None else ran(name).forces


def test_crank_rocker_is_the_one_of_the_examples():
    motion = motion_of("crank-rocker")
    along = motion.point("coupler", "C") - motion.point("frame", "D")
    np.testing.assert_allclose(np.hypot(*along.T), 0.150, rtol=1e-12)
    b_to_d = motion.point("frame", "D") - motion.point("coupler", "B")
    b_to_c = motion.point("coupler", "C") - motion.point("coupler", "B")
    assert (b_to_d[:, 0] * b_to_c[:, 1] - b_to_d[:, 1] * b_to_c[:, 0]).min() > 0.0, "C lies left of B -> D"


def test_kinetostatic_four_bar_is_the_reference_case():
    """Reference case kinetostatics-fourbar at crank angle 0."""
    forces = forces_of("kinetostatic-four-bar", at=0.0)
    assert forces.effort("A")[0] == pytest.approx(6.263621286093999, rel=1e-10)
    np.testing.assert_allclose(forces.reaction("D")[0, :2], [89.16285328808743, 89.67820599095988], rtol=1e-10)
    np.testing.assert_allclose(forces.reaction("E")[0, :2], [27.04535250334838, -46.55586818097289], rtol=1e-10)


def test_watt_six_bar_is_the_reference_case():
    """Reference case sixbar-watt at crank angle 50 degrees."""
    motion = motion_of("watt-six-bar", at=np.radians(50.0))
    np.testing.assert_allclose(motion.point("rocker2", "K")[0], [0.613664028602389, 0.22989961347248436], rtol=1e-10)
    np.testing.assert_allclose(motion.point("coupler2", "K", 2)[0], [-3.53361916334756, -0.13881823656637324], rtol=1e-10)


def test_jansen_leg_is_the_published_one():
    """Foot positions published with pyslvs, crank angles 0 and 45 degrees, 6 decimals [mm]."""
    for angle, foot in ((0.0, [-43.170055, -91.753226]), (45.0, [-24.406394, -91.789596])):
        motion = motion_of("jansen-leg", at=np.radians(angle))
        np.testing.assert_allclose(1e3 * motion.point("foot", "H")[0], foot, atol=1e-6)


def test_jansen_leg_starts_as_it_is_drawn():
    np.testing.assert_allclose(1e3 * motion_of("jansen-leg").point("foot", "H")[0], [-22.22, -91.74], atol=1e-9)


def test_loop_lever_is_the_article_s():
    """Reference case lever-canonical-zones at the start, 38 degrees, where the run-up begins."""
    motion = motion_of("contour-lever")
    assert motion.drives[0][0][[0, -1]] == pytest.approx(np.radians([38.0, 128.0]))
    assert motion.point("slider", "D")[0] == pytest.approx([0.27204706564218073, 0.0], abs=1e-15)
    assert motion.point("slider", "D", 2)[0, 0] == pytest.approx(11.724440159525985, rel=1e-10)


def test_triad_is_the_reference_case():
    """Reference case assur-class-III at crank angle 0."""
    pose = motion_of("triad").pose("plate")[0]
    np.testing.assert_allclose(pose, [0.20043043377831354, -0.056232338718055726, 0.780948973535583], rtol=1e-10)


def test_shaper_is_the_reference_case():
    """Reference case lever-quick-return-shaper at crank angles 0 and 90 degrees."""
    for angle, x in ((0.0, -0.02299935442045899), (90.0, -0.11989578808281799)):
        assert motion_of("shaper-quick-return", at=np.radians(angle)).point("ram", "D")[0, 0] == pytest.approx(x, rel=1e-10)


def test_peaucellier_draws_a_straight_line():
    """Reference case peaucellier: x = (a^2 - b^2) / (2 r)."""
    x, y = motion_of("peaucellier").point("side_AQ", "Q").T
    np.testing.assert_allclose(x, 0.3655, rtol=1e-12)
    assert np.ptp(y) > 0.4


def test_elliptic_trammel_draws_an_ellipse():
    """Reference case elliptic-trammel: P at c = 0.1 m of 0.4 m from A has the half-axes 0.3 m and 0.1 m."""
    x, y = motion_of("elliptic-trammel").point("bar", "P").T
    np.testing.assert_allclose((x / 0.3) ** 2 + (y / 0.1) ** 2, 1.0, rtol=1e-12)


def test_scotch_yoke_moves_harmonically():
    motion = motion_of("scotch-yoke")
    np.testing.assert_allclose(motion.point("yoke", "S")[:, 0], 0.05 * np.cos(4.0 * np.pi * motion.time), atol=1e-15)


def test_five_bar_stops_at_pick_and_at_place():
    motion = motion_of("five-bar")
    tool, speed = motion.point("left_rod", "C"), motion.point("left_rod", "C", 1)
    pick = (motion.time >= 0.4) & (motion.time <= 0.6)
    assert np.hypot(*speed[pick].T).max() < 1e-12
    assert np.ptp(tool[pick], axis=0).max() < 1e-12
    assert np.hypot(*(tool[pick][0] - tool[0])) > 0.05
    np.testing.assert_allclose(tool[-1], tool[0], atol=1e-12)


def test_compressor_is_driven_and_engine_drives():
    """The compressor takes power [W]; the engine's torque load is about what its gas gives: little is left [N m]."""
    compressor, engine = forces_of("slider-crank-compressor"), forces_of("slider-crank-engine")
    assert compressor.power("A")[:-1].mean() > 500.0
    torque = engine.effort("A")[:-1]
    assert np.abs(torque).max() > 200.0
    assert abs(torque.mean()) < 0.005 * np.abs(torque).max()


def test_ten_links():
    assert len(mechviz.load("ten-link").mechanism.links) == 10


# --- gears, belts, rolling ------------------------------------------------------------------------------------------------


def spin(motion: Motion, link: str) -> np.ndarray:
    return motion.velocity(link)[:, 2]


def test_planetary_gear_turns_its_sun_as_willis_says():
    motion = motion_of("planetary-gear")
    np.testing.assert_allclose(spin(motion, "sun"), 3.5 * spin(motion, "arm"), rtol=1e-12)
    for planet in ("planet", "planet2", "planet3"):
        np.testing.assert_allclose(spin(motion, planet), (1 - 60 / 18) * spin(motion, "arm"), rtol=1e-12)


SUN_DRIVEN = """
units = { length = "in" }
[links]
frame = { points = { O = [0, 0] } }
sun = { points = { O = [0, 0] } }
arm = { points = { O = [0, 0], P = [2.5, 0] } }
planet = { points = { P = [0, 0] } }
[joints]
O = { revolute = ["frame", "sun"], drive = { speed = "100 rpm" } }
A = { revolute = ["frame", "arm"], at = "O" }
P = { revolute = ["arm", "planet"] }
G = { gear = ["sun", "planet"], teeth = [20, 30] }
R = { gear = ["planet", "frame"], teeth = [30, 80], internal = true }
"""


def test_an_arm_driven_by_its_sun_needs_a_place_and_its_wheels_do_not():
    """The planetary train of Shigley's textbook: at 100 rpm of the sun with 20 teeth the arm turns at 20 rpm."""
    with pytest.raises(MechanismError) as error:
        compile_mechanism(mechviz.loads(SUN_DRIVEN).mechanism)
    (fault,) = error.value.faults
    assert (fault.path, fault.message) == ("joints.G", "nothing says how 'arm' stands at the start.")
    assert fault.remedy == "Sketch it: [sketch] arm = { at = [x, y], angle = ... }."
    mechanism = mechviz.loads(SUN_DRIVEN + "[sketch]\narm = { at = [0, 0], angle = 0.3 }\n").mechanism
    motion = solve_motion(compile_mechanism(mechanism), np.linspace(0.0, 0.5, 5))
    rpm = np.pi / 30.0
    np.testing.assert_allclose(spin(motion, "arm"), 20.0 * rpm, rtol=1e-12)
    np.testing.assert_allclose(spin(motion, "planet"), -100.0 / 3.0 * rpm, rtol=1e-12)
    assert motion.pose("arm")[0, 2] == pytest.approx(0.3, abs=1e-12)


def test_a_point_on_the_pitch_circle_of_a_planet_rests_where_it_touches_the_ring():
    motion = motion_of("planetary-gear", at=0.0)
    assert np.hypot(*motion.point("planet", "T")[0]) == pytest.approx(0.060, rel=1e-12)
    assert np.hypot(*motion.point("planet", "T", 1)[0]) < 1e-14


def test_gear_train_divides_the_torque_by_nine():
    forces = forces_of("gear-train")
    np.testing.assert_allclose(spin(forces.motion, "output"), spin(forces.motion, "motor") / 9.0, rtol=1e-12)
    np.testing.assert_allclose(forces.effort("A"), 1.0, rtol=1e-9)  # N m, against the winch's 9
    f = forces.reaction("G2")[:, :2]
    outward = np.array([42.0, 42.42640687119285]) / np.hypot(42.0, 42.42640687119285)
    np.testing.assert_allclose(f @ outward, np.hypot(*f.T) * np.sin(np.radians(20.0)), rtol=1e-9)


def test_geared_slider_cranks_keep_their_phase():
    motion = motion_of("geared-slider-cranks")
    crank, crank2 = (motion.pose(link)[:, 2] for link in ("crank", "crank2"))
    np.testing.assert_allclose(crank2, np.pi / 2 - crank / 2, atol=1e-12)
    x, y = 0.05 * np.cos(crank2), 0.05 * np.sin(crank2)
    np.testing.assert_allclose(motion.point("piston2", "F")[:, 0], x + np.sqrt(0.18**2 - y**2), rtol=1e-12)


def test_rack_goes_by_radius_times_angle_and_the_teeth_press_the_pinion_away():
    forces = forces_of("rack-and-pinion")
    motion = forces.motion
    np.testing.assert_allclose(motion.point("rack", "R")[:, 0], 0.040 * motion.pose("pinion")[:, 2], atol=1e-15)
    assert (forces.reaction("Z")[:, 1] < 0.0).all(), "the pinion presses the rack down"


def test_belts_keep_or_reverse_the_sense_of_rotation():
    forces = forces_of("belt-drive")
    motion = forces.motion
    np.testing.assert_allclose(spin(motion, "drum"), spin(motion, "motor") / 3.0, rtol=1e-12)
    np.testing.assert_allclose(spin(motion, "fan"), -spin(motion, "motor") / 1.5, rtol=1e-12)
    np.testing.assert_allclose(np.hypot(*forces.reaction("V")[:, :2].T), 30.0 / 0.150, rtol=1e-9)
    np.testing.assert_allclose(np.hypot(*forces.reaction("X")[:, :2].T), 6.0 / 0.090, rtol=1e-9)


def test_wheel_rolls_by_its_radius():
    motion = motion_of("rolling-wheel")
    x, turn = motion.point("wheel", "C")[:, 0], motion.pose("wheel")[:, 2]
    np.testing.assert_allclose(np.diff(turn), -np.diff(x) / 0.060, atol=1e-13)
    height = motion.point("wheel", "K")[:, 1]
    assert height.min() > -0.080 - 1e-12, "the rail is at -80 mm"
    assert height.max() > -0.020


def test_pin_presses_square_to_its_slot():
    forces = forces_of("slotted-lever")
    angle = forces.motion.pose("lever")[:, 2]
    force = forces.reaction("A")
    along = force[:, 0] * np.cos(angle) + force[:, 1] * np.sin(angle)
    assert np.abs(along).max() < 1e-12 * np.hypot(*force[:, :2].T).max()
    assert np.hypot(*force[:, :2].T).min() > 1.0


def test_excavator_cylinders_carry_what_hangs_on_them():
    """Both cylinders give exactly the power that the arm takes; the boom's is pressed together all the time."""
    forces = forces_of("excavator-arm")
    motion = forces.motion
    for joint, first, p, second, q in (("C1", "frame", "P", "boom", "Q"), ("C2", "boom", "U", "stick", "V")):
        away = motion.point(second, q) - motion.point(first, p)
        np.testing.assert_allclose(np.hypot(*away.T), motion.coordinate(joint)[:, 0], rtol=1e-12)
        assert 10.0 < np.abs(forces.effort(joint)).max() < 1e3  # N
    assert forces.effort("C1").min() > 50.0
    tip = motion.point("bucket", "T")
    assert np.ptp(tip[:, 0]) > 0.1 and np.ptp(tip[:, 1]) > 0.1


# --- hard cases -----------------------------------------------------------------------------------------------------------


def test_parallelogram_and_antiparallelogram_keep_their_branch_through_four_change_points():
    motion = motion_of("parallelogram")
    np.testing.assert_allclose(spin(motion, "rocker"), spin(motion, "crank"), rtol=1e-9)
    assert len(motion.singular_points) == 4 and not any(change.dead for change in motion.singular_points)
    motion = motion_of("antiparallelogram")
    crank = motion.pose("crank")[:, 2]
    ratio = (0.06**2 - 0.3**2) / (0.06**2 + 0.3**2 - 2 * 0.06 * 0.3 * np.cos(crank))
    np.testing.assert_allclose(spin(motion, "rocker") / spin(motion, "crank"), ratio, rtol=1e-8)
    assert ratio.min() == pytest.approx(-1.5, rel=1e-3), "half as fast again at times"
    assert len(motion.singular_points) == 4


def test_kite_needs_two_turns_of_the_crank_for_one_cycle():
    motion = motion_of("kite")
    rocker = motion.pose("rocker")[:, 2]
    assert abs(rocker[360] - rocker[0]) > 1.0
    assert np.abs(np.exp(1j * rocker[-1]) - np.exp(1j * rocker[0])) < 1e-9
    assert len(motion.singular_points) == 2


def test_piston_turns_the_crank_through_both_dead_points():
    motion = motion_of("piston-driven-crank")
    crank = motion.pose("crank")[:, 2]
    assert abs(crank[-1] - crank[0]) == pytest.approx(4.0 * np.pi, abs=1e-9)
    assert (np.diff(crank) * np.sign(crank[-1] - crank[0]) > 0.0).all()
    assert [change.dead for change in motion.singular_points] == [True] * 4


@pytest.mark.parametrize(("name", "joint", "mobility"), [("double-parallelogram", "F", 0), ("two-guides", "T", -1)])
def test_redundant_constraints_are_named_and_the_motion_is_exact(name, joint, mobility):
    forces = forces_of(name)
    model = forces.motion.model
    assert (gruebler(model)[-1], rank_mobility(forces.motion)) == (mobility, 1)
    assert joint in redundant_joints(model)
    assert np.isfinite(forces.reaction(joint)).all()


def test_near_flat_four_bar_keeps_its_mode_and_says_how_near_it_comes():
    motion = motion_of("near-flat-four-bar")
    b_to_d = motion.point("frame", "D") - motion.point("coupler", "B")
    b_to_c = motion.point("coupler", "C") - motion.point("coupler", "B")
    assert (b_to_d[:, 0] * b_to_c[:, 1] - b_to_d[:, 1] * b_to_c[:, 0]).min() > 0.0, "C stays left of B -> D"
    assert motion.singular_points == ()
    assert 500.0 < motion.condition.max() < 2000.0, "about one over the root of the margin"


@pytest.mark.parametrize(("name", "loops", "links"), [("eight-bar", 3, 6), ("stephenson-six-bar", 2, 4)])
def test_large_groups_are_one_simultaneous_block(name, loops, links):
    (block,) = motion_of(name).model.blocks
    assert (block.kind, len(block.loops), len(block.angles)) == ("general", loops, links)


def test_micro_gripper_is_symmetric_and_the_same_in_millimetres():
    motion = motion_of("micro-gripper")
    upper, lower = motion.point("jaw", "T"), motion.point("jaw2", "V")
    np.testing.assert_allclose(upper, lower * (1.0, -1.0), rtol=1e-12)
    scene = mechviz.load("micro-gripper")
    large = mechviz.loads(scene.text.replace('"um"', '"mm"')).mechanism
    big = solve_motion(compile_mechanism(large), default_times(large, scene.frames, scene.cycles))
    np.testing.assert_allclose(1e3 * upper, big.point("jaw", "T"), rtol=1e-13)


def test_coupled_antiparallelograms_run_up_to_nine_times_as_fast():
    motion = motion_of("coupled-antiparallelograms")
    ratio = spin(motion, "rocker2") / spin(motion, "crank")
    assert ratio.max() == pytest.approx(9.0, rel=1e-3) and ratio.min() == pytest.approx(1.0 / 9.0, rel=1e-3)
    assert len(motion.singular_points) == 4 and not any(change.dead for change in motion.singular_points)


def test_the_large_group_of_the_six_bar_stays_a_parallelogram_through_its_change_points():
    motion = motion_of("parallelogram-six-bar")
    assert [block.kind for block in motion.model.blocks] == ["general"]
    np.testing.assert_allclose(spin(motion, "bar"), 0.0, atol=1e-9 * np.abs(spin(motion, "r1")).max())
    np.testing.assert_allclose(spin(motion, "r2"), spin(motion, "r1"), rtol=1e-9)
    assert len(motion.singular_points) == 4


def test_every_loop_of_the_chain_stays_a_parallelogram():
    motion = motion_of("four-bar-chain")
    speeds = np.array([spin(motion, link.name) for link in motion.mechanism.links if link.name != "frame"])
    fastest = np.abs(speeds).max()
    assert np.minimum(np.abs(speeds), np.abs(np.abs(speeds) - fastest)).max() < 1e-9 * fastest
    assert len(motion.singular_points) % 8 == 0 and motion.singular_points


def test_a_group_of_one_link_is_called_redundant_only_if_it_is():
    """A valve between its guide and the rocker's pin: 3 - 2 - 1 = 0, the group is determinate."""
    model = compile_mechanism(mechviz.load("valve-spring").mechanism).model
    assert [(g.links, g.kind) for g in groups(model)] == [(("rocker",), ""), (("valve",), "with a higher pair")]
    assert not redundant_joints(model)


# --- signals, bushings, servos, actuators, free bodies ------------------------------------------------------------------


def test_engine_mounts_are_swept_through_their_resonances():
    """The natural frequencies of the body on its bushings, by hand, lie within the sweep; at its own each freedom moves most."""
    from mechcore.dynamics.rest.vibrations import small_vibrations

    stiffness = np.zeros((3, 3))
    for kx, ky, kt, rx, ry in ((60e3, 110e3, 400.0, -0.2, -0.13), (60e3, 90e3, 400.0, 0.22, -0.13)):
        rows = np.array([[1.0, 0.0, -ry], [0.0, 1.0, rx], [0.0, 0.0, 1.0]])
        stiffness += rows.T @ np.diag([kx, ky, kt]) @ rows
    weight = np.diag([90.0, 90.0, 3.2])
    wanted = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(weight, stiffness)).real)) / (2.0 * np.pi)
    computed = [mode.frequency for mode in small_vibrations(mechviz.load("engine-mounts").mechanism).modes]
    assert computed == pytest.approx(wanted, rel=5e-3)  # the weight presses them in
    assert all(2.0 < f < 16.0 for f in computed)
    motion = ran("engine-mounts", 240).motion
    swept = 2.0 + 14.0 * motion.time / 3.0  # [Hz]
    heave, roll = motion.point("engine", "C")[:, 1], motion.pose("engine")[:, 2]
    for moved, frequency in ((heave, computed[1]), (roll, computed[2])):
        assert swept[np.argmax(np.abs(moved - moved[0]))] == pytest.approx(frequency, abs=1.0)


def test_servo_arm_reaches_its_targets():
    """The integral leaves the shoulder no error but what the elbow's swing makes; the elbow, without one, hangs by its weight."""
    run = ran("servo-arm")
    late = run.motion.time > 1.5
    shoulder, elbow = (run.catalogue.by_key[f"servo.{name}.error"].values()[:, 0] for name in ("shoulder", "elbow"))
    assert np.abs(shoulder[late]).max() < 2.0 and np.abs(shoulder).max() > 4.0
    assert 0.0 < elbow[late].mean() < 2.0
    effort = run.forces.loads["elbow"].values[:, 2]
    error = np.radians(elbow)
    rate = np.radians(30.0) * 2.0 * np.pi * np.cos(2.0 * np.pi * run.motion.time) - run.motion.coordinate("B")[:, 1]
    np.testing.assert_allclose(effort, 60.0 * error + 3.0 * rate, atol=1e-9 * np.abs(effort).max())


def test_stribeck_block_sticks_and_slips():
    """Caught, it rides with the belt until the spring pulls by the greatest friction, 0.3 of its weight."""
    run = ran("stribeck-block")
    kinds = [h.kind for h in run.simulation.events]
    assert kinds[:4] == ["slip", "stick", "slip", "stick"]
    place = run.motion.point("block", "G")[:, 0]
    slips = [h.time for h in run.simulation.events if h.kind == "slip"]
    at = np.interp(slips, run.motion.time, place)
    assert at == pytest.approx(0.3 * 2.0 * 9.81 / 400.0, rel=2e-3)
    slides = run.motion.coordinate("G")[:, 1]
    force = run.forces.friction.wrench("G")[:, 0]
    moving = np.abs(slides) > 1e-3
    speed = slides[moving] / 0.08
    wanted = -np.sign(speed) * 2.0 * 9.81 * (0.12 + 0.18 * np.exp(-(speed**2)))
    np.testing.assert_allclose(force[moving], wanted, rtol=1e-6)


def test_lifted_boom_ends_on_its_stop():
    motion, forces = motion_of("lifted-boom"), forces_of("lifted-boom")
    assert np.degrees(motion.coordinate("O")[-1, 0]) == pytest.approx(50.0, abs=1e-6)
    push = forces.loads["lift"].values[:, :2]
    assert np.hypot(*push.T) == pytest.approx(520.0 * np.minimum(motion.time / 0.4, 1.0), abs=1e-9)


def test_thrown_wrench_flies_along_a_parabola_and_spins_evenly():
    motion = motion_of("thrown-wrench")
    t, pose = motion.time, motion.pose("wrench")
    np.testing.assert_allclose(pose[:, 0], 1.5 * t, atol=1e-12)
    np.testing.assert_allclose(pose[:, 1], 4.0 * t - 0.5 * 9.81 * t * t, atol=1e-12)
    np.testing.assert_allclose(pose[:, 2], 6.0 * np.pi * t, atol=1e-11)
