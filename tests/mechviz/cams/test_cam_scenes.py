"""Cams in scenes: keywords and faults, tables and events, solids that touch, gallery."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from cam_scenes import changed, refused, text_of
from sections import section

import mechviz
from mechcore.errors import MechanismError
from mechcore.forces.cam_events import cam_events
from mechcore.forces.cam_rating import contact_force, placed_cams
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.events import find_events
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechviz.meshes.solids import build_solids
from mechviz.quantities.tables import tables
from mechviz.runs import run_scene
from mechviz.studies.designs.sensitivity import sensitivity
from mechviz.studies.report import check_lines

SCENES = [
    "cam-roller", "cam-roller-offset", "cam-knife", "cam-flat", "cam-mushroom", "cam-oscillating-roller", "cam-oscillating-flat",
    "cam-wedge", "cam-sine-acceleration", "cam-yoke", "cam-groove", "cam-linkage", "valve-train",
    "cam-constant-acceleration", "cam-constant-acceleration-smooth", "cam-constant-acceleration-general",
    "cam-sine-acceleration-base",
    "cam-oscillating-knife", "cam-oscillating-mushroom", "cam-flat-offset", "cam-mushroom-offset", "cam-wedge-oscillating",
    "cam-eccentric", "cam-tangent", "cam-polynomial", "cam-measured", "cam-drawing", "cam-undercut",
    "cam-conjugate", "cam-conjugate-oscillating", "cam-inverse", "cam-inverse-slide",
]  # fmt: skip


def solved(name: str, frames: int | None = None):
    scene = mechviz.load(name)
    motion = solve_motion(compile_mechanism(scene.mechanism), default_times(scene.mechanism, frames or scene.frames, 1))
    return motion, solve_forces(motion)


def written(name: str) -> str:
    """A scene of the gallery in the standard layout."""
    return mechviz.load(name).to_toml()


@pytest.mark.parametrize("name", SCENES)
def test_scenes_read_as_they_were_written(name):
    scene = mechviz.load(name)
    again = mechviz.loads(scene.to_toml(), scene.name, scene.folder)
    assert again == scene and again.to_toml() == scene.to_toml()
    assert repr(again.mechanism.joints[-1].face) == repr(scene.mechanism.joints[-1].face)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("base = 40", 'base = "40 N"', ["joints.K.profile.base", "40 N"]),
        ("base = 40, ", "", ["joints.K.profile", "'base' is missing"]),
        ("roller = 10", "rollr = 10", ["Did you mean 'roller'?"]),
        ("roller = 10", "roller = 10, knife = true", ["roller"]),
        ("roller = 10", "flat = true, tilt = 95", ["joints.K.follower.tilt", "95"]),
        ("roller = 10", "roller = 10, tilt = 5", ["tilt goes with a flat face"]),
        ('guide = "S"', 'guide = "Q"', ["joints.K.follower.guide", "no joint 'Q'"]),
        ('guide = "S"', 'guide = "O"', ["joints.K.follower.guide", "'O' is no prismatic or revolute joint of 'follower'"]),
        ('cam = ["cam", "follower"]', 'cam = ["follower", "cam"]', ["are on 'follower'", 'cam = ["cam", "follower"]']),
        ('point = "T"', 'point = "X"', ["joints.K.follower.point", "no point 'X'"]),
        ("over = 60 }, {", "over = 50 }, {", ["joints.K", "350°", "Add a dwell of 10°"]),
        ("to = 20", 'to = "20 deg"', ["joints.K.profile.lift[0].to"]),
        ('law = "cycloidal"', 'law = "cycloid"', ["joints.K.profile.lift[0]", "cycloid"]),
        ('cam = ["cam", "follower"]', 'cam = ["cam", "follower"]\nradius = 5', ["radius does not go with a cam"]),
        ('cam = ["cam", "follower"]', 'cam = ["cam", "follower"]\nclosure = "spring"', ["joints.K.closure"]),
    ],
)  # fmt: skip
def test_faults_of_scenes(old, new, words):
    refused(changed(written("cam-roller"), old, new), words)


def test_tables_of_the_contact():
    """Names, units and values that the recording promises, against the textbook's formulas."""
    run = run_scene(mechviz.load("cam-roller-offset"))
    computed = {t.path: t for t in tables(run)}
    contact = computed["data", "cams", "K", "contact"]
    assert [unit for _, unit in contact.columns] == ["m", "m", "N", "rad", "m", "m"]
    x, y, force, alpha, radius, eccentricity = contact.values.T
    lift, rate, second = computed["data", "cams", "K", "lift"].values.T
    e, r = 0.014, 0.010
    h = np.sqrt((0.038 + r) ** 2 - e**2) + lift
    np.testing.assert_allclose(np.tan(alpha), (rate - e) / h, atol=1e-12)
    np.testing.assert_allclose(force, np.hypot(*run.forces.reaction("K")[:, :2].T), rtol=1e-12)
    np.testing.assert_allclose((x - e) ** 2 + (y - h) ** 2, r**2, rtol=1e-9)
    assert np.isnan(eccentricity).all()
    q, p = rate - e, h  # the pitch curve's derivatives in turned axes
    rho = (p**2 + q**2) ** 1.5 / (p**2 + q**2 + q * rate - p * second)
    np.testing.assert_allclose(radius, rho - r, rtol=1e-9)
    flat = next(t for t in tables(run_scene(mechviz.load("cam-flat"))) if t.path == ("data", "cams", "K", "contact"))
    assert np.isfinite(flat.values[:, 5]).all() and not flat.values[:, 3].any()


def test_the_lectures_sinusoidal_acceleration():
    """Closing the profile leaves h = R - a0/w^2 sin(w t), lift 2 a0/w^2, where R is the mean height (theory of the lecture)."""
    motion, _ = solved("cam-sine-acceleration")
    angle = motion.coordinate("O")[:, 0]
    height = motion.coordinate("S") + np.array([0.1, 0.0, 0.0])
    np.testing.assert_allclose(height[:, 0], 0.04 - 0.01 * np.sin(angle), atol=1e-15)
    w = 240.0 * np.pi / 30.0
    np.testing.assert_allclose(height[:, 2], 0.01 * w**2 * np.sin(angle), atol=1e-11)


@pytest.mark.parametrize(
    ("name", "c1", "a0"),  # C1 pi/w and a0 (pi/w)^2/2 [m]
    [
        ("cam-constant-acceleration", 0.0, 0.020),
        ("cam-constant-acceleration-general", 0.008, 0.012),
        ("cam-constant-acceleration-smooth", -0.020, 0.020),
    ],
)
def test_the_lectures_constant_acceleration(name, c1, a0):
    """h = R + C1 t + a0 t^2/2, then R + a0 (pi/w) t - a0 t^2/2 + C1 (2 pi/w - t); velocity jumps by -(a0 pi/w + 2 C1) and back."""
    motion, forces = solved(name)
    x = motion.coordinate("O")[:, 0] / np.pi
    height = motion.coordinate("S")[:, 0] + 0.110
    r = 0.040
    wanted = np.where(x <= 1.0, r + c1 * x + a0 * x**2, r + 2.0 * a0 * x - a0 * x**2 + c1 * (2.0 - x))
    np.testing.assert_allclose(height, wanted, atol=1e-13 if "smooth" not in name else 1e-12)
    knocks = [e for e in cam_events(motion, forces) if "velocity jumps" in e.text]
    assert len(knocks) == (0 if abs(a0 + c1) < 1e-12 else 2)
    cam = placed_cams(motion)[0].cam
    at = np.pi + (0.0 if knocks else 0.5 * np.pi)
    left, right = (np.pi * cam.law(at, 1, side)[1] for side in ("left", "right"))
    np.testing.assert_allclose(right - left, -2.0 * (a0 + c1), atol=1e-12)


def test_the_normal_force_of_a_contact_is_negative_where_the_cam_would_have_to_pull():
    """A goal that wants a follower to be pressed on asks for its least value; that of the size is never below zero."""
    run = run_scene(mechviz.load("valve-train"))
    signed, size = (
        run.catalogue[f"cam.{placed_cams(run.motion)[0].name}.{key}"] for key in ("contact_normal_force", "contact_force")
    )
    np.testing.assert_allclose(np.abs(signed.values()), size.values(), rtol=1e-14)
    assert signed.unit == size.unit and signed.values().min() < -1.0
    least = sensitivity(run, f"{signed.key}:min", ["loads.valve_spring.stiffness"])
    assert least.number == pytest.approx(signed.values().min(), rel=1e-2) and least.derivatives[0] > 0.0


def test_check_says_where_a_follower_leaves_its_cam():
    motion, forces = solved("valve-train")
    lost = [f"contact lost at {e.time:.6g} s, " for e in cam_events(motion, forces) if e.text.startswith("contact lost")]
    lines = check_lines(mechviz.load("valve-train"))
    assert len(lost) == 2 and all(any(words in line for line in lines) for words in lost)
    assert "contact    no follower leaves its cam over the run" in check_lines(mechviz.load("cam-roller"))
    assert not any(line.startswith("contact") for line in check_lines(mechviz.load("cam-groove")))  # held by its form


def test_contact_is_lost_where_the_force_changes_its_sign():
    motion, forces = solved("valve-train")
    (cam,) = placed_cams(motion)
    events = [e for e in cam_events(motion, forces) if "contact" in e.text]
    assert [e.text.split(" at ")[0] for e in events] == ["contact lost", "contact regained"] * 2  # rise, return
    assert "° of the cam" in events[0].text and events[0].level == "WARN"
    again = motion.at_times
    for event in events:  # the acceleration may jump there: force on both sides
        n = contact_force(solve_forces(again(np.array([event.time - 2e-6, event.time + 2e-6]))), cam)
        assert n[0] * n[1] < 0.0
    slow = mechviz.loads(written("valve-train").replace("3600 rpm", "1500 rpm")).mechanism
    calm = solve_motion(compile_mechanism(slow), default_times(slow))
    assert not [e for e in cam_events(calm, solve_forces(calm)) if "lost" in e.text]


JERKS = (0.0, 50.0, 100.0, 150.0, 215.0, 280.0)  # places of cam-knife's law


def jerk_times(drive: dict[str, object], frames: int, cycles: int = 1) -> list[float]:
    scene = mechviz.load("cam-knife").changed({("joints", "O", "drive"): drive})
    motion = solve_motion(compile_mechanism(scene.mechanism), default_times(scene.mechanism, frames, cycles))
    return [e.time for e in cam_events(motion, None) if "infinite jerk" in e.text]


@pytest.mark.parametrize("cycles", [1, 3])
@pytest.mark.parametrize(("speed", "start"), [(37.0, 50.0), (100.0, 280.0), (-73.0, 100.0), (60.0, 0.0), (-60.0, 215.0)])
def test_jumps_of_a_law_are_told_once_a_passage_also_where_the_run_begins_and_ends_there(speed, start, cycles):
    turns = np.mod(np.sign(speed) * (np.array(JERKS) - start), 360.0)
    turns = np.where(turns == 0.0, 360.0, turns) + 360.0 * np.arange(cycles)[:, None]
    told = jerk_times({"speed": f"{speed} rpm", "start": f"{start} deg"}, 180, cycles)
    np.testing.assert_allclose(told, np.sort(turns, axis=None) / (6.0 * abs(speed)), rtol=1e-12)


def test_jumps_of_a_law_are_told_at_their_times_between_frames():
    """The cam swings over 100 deg + 60 deg sin, which straight lines between 77 frames miss."""
    swing = {"centre": "100 deg", "amplitude": "60 deg", "period": "1 s", "phase": "90 deg"}
    first = np.arccos((np.array([150.0, 100.0, 50.0]) - 100.0) / 60.0) / (2.0 * np.pi)
    told = jerk_times({"oscillation": swing}, 77)
    np.testing.assert_allclose(told, [*first, *(1.0 - first[::-1])], atol=1e-10)


@pytest.mark.parametrize("frames", [100, 241])
def test_a_limit_at_a_knock_is_where_the_follower_turns_back(frames):
    motion, _ = solved("cam-constant-acceleration-general", frames)
    limits = [e for e in find_events(motion) if e.item == "S"]
    np.testing.assert_allclose([e.time for e in limits], motion.time[-1] * np.array([0.5, 1.0]), rtol=1e-8)
    np.testing.assert_allclose([e.value for e in limits], [-0.05, -0.07], atol=1e-9)


def test_infinite_jerk_and_pressure_angles_are_events():
    motion, forces = solved("cam-knife")
    jerk = [e for e in cam_events(motion, forces) if "infinite jerk" in e.text]
    np.testing.assert_allclose([e.value for e in jerk], np.nan)
    angles = np.degrees(motion.coordinate("O")[:, 0])
    at = np.interp([e.time for e in jerk], motion.time, angles)
    assert set(np.round(at).astype(int) % 360) == {0, 50, 100, 150, 215, 280}
    steep = [e for e in cam_events(*solved("cam-oscillating-roller")) if "pressure angle" in e.text]
    assert not steep
    text = written("cam-roller").replace("base = 40", "base = 40, pressure_limit = 15")
    m = mechviz.loads(text).mechanism
    motion = solve_motion(compile_mechanism(m), default_times(m))
    steep = [e for e in cam_events(motion, None) if "pressure angle" in e.text]
    assert len(steep) == 2  # rise and return
    (cam,) = placed_cams(motion)
    limits = cam.limits(cam.profiles[0])
    np.testing.assert_allclose([e.value for e in steep], [limits.rise.value, limits.fall.value], rtol=1e-9)


@pytest.mark.sample(12)
@pytest.mark.parametrize("name", SCENES)
def test_the_solids_touch_over_a_turn(name):
    """Distance of cam and follower, cut through the middle of their layer: zero within the tessellation, never overlapping."""
    motion, _ = solved(name, 61)
    solids = build_solids(motion.mechanism, {k: motion.pose(k) for k in motion.model.links})
    assert not solids.clashes
    tolerance = 2e-5
    for placed in placed_cams(motion):
        cam, follower = (solids.links[k] for k in placed.links)
        flat = [p.bounds[:, 2] for k, p in zip(cam.kinds, cam.parts, strict=True) if k in ("plate", "wheel")]
        cuts = [[section(s.mesh, z) for s in (cam, follower)] for z in {0.493 * low + 0.507 * high for low, high in flat}]
        cuts = [cut for cut in cuts if not any(shape.is_empty for shape in cut)]  # a gear may sit on the cam's shaft too
        cuts = [(a, a.buffer(-tolerance), b) for a, b in cuts]
        for k in range(0, motion.frames, 4):
            first, second = (motion.pose(link)[k] for link in placed.links)
            placings = [(_at(a, first), _at(less, first), _at(b, second)) for a, less, b in cuts]
            assert min(a.distance(b) for a, _, b in placings) < tolerance
            assert all(less.intersection(b).area < 1e-12 for _, less, b in placings)


def _at(shape, pose):
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return shapely.affinity.affine_transform(shape, [c, -s, s, c, pose[0], pose[1]])


def test_a_scene_without_cams_pays_nothing(monkeypatch):
    """Neither geometry nor events nor tables of cams are looked for."""
    import sys

    from mechcore.forces import cam_events as events

    def refuse(*args):
        raise AssertionError("called")

    monkeypatch.setattr(events, "placed_cams", refuse)
    monkeypatch.setattr(sys.modules["mechcore.cams.placement.plane"].PlacedCam, "at", refuse)
    assert not [t for t in tables(run_scene(mechviz.load("crank-rocker"))) if "cams" in t.path]


def test_the_remedy_of_an_undercut_arm_is_sought_on_one_sampling():
    """Coarse samples see no undercut at a base circle where fine ones do: it is not taken for one that fits."""
    dwell, rise = "{ over = 29.0500642065 },\n    { over = 3.375, to = ", "3.27404"
    text = changed(text_of("draughtsman"), dwell + rise, dwell + "6.54808")
    refused(text, ["joints.Z", "undercut", "Give at most 2.41606 mm, or take a smoother law or longer segments."])


def test_the_outer_flank_of_a_wedge_s_groove_is_checked_as_that_of_a_disc():
    """A double harmonic rise, mirrored, begins hollow with the radius L^2 / (pi^2 H), H = 22 mm and L = 60 mm."""
    text = changed(text_of("cam-wedge"), "[joints.K]", '[joints.K]\nclosure = "form"')
    text = changed(text, 'law = "cycloidal"', 'law = "double-harmonic", mirrored = true')
    most = 60.0**2 / (np.pi**2 * 22.0)
    solve_motion(compile_mechanism(mechviz.loads(changed(text, "roller = 9", f"roller = {0.999 * most}")).mechanism), [0.0])
    refused(changed(text, "roller = 9", f"roller = {1.001 * most}"), ["joints.K", "undercut", f"Give at most {most:.6g} mm"])
    refused(changed(text, "roller = 9", "mushroom = 9"), ["joints.K", "a groove with a face that is no roller"])


def test_the_second_roller_of_a_conjugate_pair_is_named_and_has_no_base_circle_of_its_own():
    text = changed(text_of("cam-conjugate"), "second = { roller = 9", "second = { roller = 1e29")
    refused(text, ["joints.K.second: the profile is undercut", "Give at most 40.1668 mm."])


def test_a_cam_without_a_base_circle_whose_profile_runs_into_its_pivot_is_refused_without_a_warning():
    """There its pieces end with no speed, and their direction is that just before."""
    scene = mechviz.load("cam-undercut").changed({("joints", "K", "profile", "base"): 0})
    with pytest.raises(MechanismError, match="no contact can be found"):
        run_scene(scene, frames=24)
