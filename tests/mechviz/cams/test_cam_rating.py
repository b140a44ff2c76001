"""Rating of cams in scenes: Hertz pressure, least springs, the graphical method; tables, events, the command, faults."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from cam_scenes import text_of
from typer.testing import CliRunner

import mechviz
from mechcore.cams.followers import Roller
from mechcore.cams.real_profiles import graphical
from mechcore.errors import MechanismError
from mechcore.forces import cam_events as events_module
from mechcore.forces import cam_rating as rating_module
from mechcore.forces.cam_events import cam_events
from mechcore.forces.cam_rating import contact_force, contact_stress, drawn_lift, drawn_rows, least_springs, placed_cams
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.mechanism import CamDrawn, CamRating
from mechviz.commands.main import app
from mechviz.quantities.tables import tables
from mechviz.runs import run_scene
from mechviz.scene.kinds.joints.cam_documents import whole_step
from mechviz.scene.units import Units
from mechviz.studies.cam_report import cam_facts, cam_lines

STEEL = CamRating(width=0.008)


def solved(scene, frames: int = 360):
    motion = solve_motion(compile_mechanism(scene.mechanism), default_times(scene.mechanism, frames, 1))
    (cam,) = placed_cams(motion)
    return motion, solve_forces(motion), cam


def lines_of(run, name):
    return {t.path[-1]: t for t in tables(run) if t.path[:2] == ("data", "cams") and t.path[2] == name}


# -- Hertz ----------------------------------------------------------------------------------------------------------------


def test_the_pressure_is_that_of_hertz_and_carries_the_force():
    """Half an ellipse of the largest pressure over the strip is the contact force; width and peak by the formulas of a handbook."""
    _, forces, cam = solved(mechviz.load("cam-roller"))
    stress = contact_stress(forces, cam, STEEL)
    force = contact_force(forces, cam)
    np.testing.assert_allclose(0.5 * np.pi * stress.pressure * stress.half_width * STEEL.width, force, rtol=1e-12)
    rho = cam.rows(forces.motion).radius
    reduced = 1.0 / (1.0 / rho + 1.0 / 0.010)
    # sigma_H = 0.418 sqrt(F E / (b r)) of steel on steel, nu = 0.3
    np.testing.assert_allclose(stress.pressure, 0.418 * np.sqrt(force * 2.1e11 / (0.008 * reduced)), rtol=1e-3)


def test_the_flank_that_carries_has_its_own_curvature():
    """A groove: its far flank is hollow and parallel; the roller fits it closer than the other one under the same force."""
    _, forces, cam = solved(mechviz.load("cam-groove"))
    force = contact_force(forces, cam)
    assert (force < -1.0).any() and (force > 1.0).any()
    rho, r = cam.rows(forces.motion).radius, cam.face.radius
    stress = contact_stress(forces, cam, STEEL)
    hollow = force < 0.0
    near = np.where(hollow, 1.0 / r - 1.0 / (rho + 2.0 * r), 1.0 / r + 1.0 / rho)
    modulus = 2.1e11 / (2.0 * (1.0 - 0.09))
    np.testing.assert_allclose(stress.pressure, np.sqrt(np.abs(force) / 0.008 * modulus * near / np.pi), rtol=1e-9)
    assert (near[hollow] < 1.0 / r).all()


@pytest.mark.parametrize("name", ["cam-conjugate", "cam-conjugate-oscillating", "cam-groove", "cam-yoke", "cam-inverse"])
def test_pressure_angle_and_radius_are_recorded_of_the_flank_on_which_the_force_acts(name):
    """The recorded place of contact draws the profile on the link that bears it: its radius and its tangent by differences. The
    force is perpendicular to that tangent, and the pressure angle is between it and how the follower moves where the roller is."""
    run = run_scene(mechviz.load(name), frames=14400)
    (cam,), motion = placed_cams(run.motion), run.motion
    rows = lines_of(run, "K")["contact"].values
    place, pressure_angle, radius = rows[:, 0] + 1j * rows[:, 1], rows[:, 3], rows[:, 4]
    bearer, driven = cam.links[name == "cam-inverse"], cam.links[1]
    x, y, turned = motion.pose(bearer).T
    steps = np.diff((place - x - 1j * y) * np.exp(-1j * turned))
    before, after = steps[:-1], steps[1:]
    turning, length = np.angle(after / before), 0.5 * (np.abs(before) + np.abs(after))
    middle = np.arange(1, len(place) - 1)
    forward = np.exp(1j * turned[middle]) * (before + after)
    reaction = run.forces.normal_reaction("K")[middle, :2] @ [1.0, 1j]
    vx, vy, rate = motion.velocity(driven)[middle].T
    out = getattr(cam.face, "radius", 0.0) * reaction / np.maximum(np.abs(reaction), 1e-9)
    centre = place[middle] + (out if name != "cam-inverse" else -out)
    moved = vx + 1j * vy + 1j * rate * (centre - motion.pose(driven)[middle, :2] @ [1.0, 1j])
    # steady: no step to the other flank or of the law nearby, and fast enough to see the tangent
    near = np.abs(np.diff(np.angle(forward * np.conj(reaction)), prepend=0.0, append=0.0))
    clear = (np.abs(reaction) > 0.02 * np.abs(reaction).max()) & (length > 0.1 * np.median(length)) & (np.abs(moved) > 1e-3)
    clear &= (np.maximum(near[:-1], near[1:]) < 1e-3) & (np.abs(turning) < 0.02)
    assert clear.sum() > 2000 and {-1.0, 1.0} == set(np.sign(contact_force(run.forces, cam)[middle][clear]))
    along, normal = forward[clear], reaction[clear]
    np.testing.assert_allclose(np.angle(along / normal) % np.pi, 0.5 * np.pi, atol=1e-4)
    np.testing.assert_allclose(np.abs(np.abs(turning / length)[clear]), np.abs(1.0 / radius[middle][clear]), rtol=2e-3, atol=0.02)
    off = np.arccos(np.abs(np.real(normal * np.conj(moved[clear]))) / np.abs(normal * moved[clear]))
    np.testing.assert_allclose(np.abs(pressure_angle[middle][clear]), off, atol=1e-4)


@pytest.mark.parametrize("name", ["cam-conjugate", "cam-inverse", "cam-barrel", "cam-mushroom", "cam-knife"])
def test_every_kind_of_contact_has_a_pressure(name):
    _, forces, cam = solved(mechviz.load(name), 90)
    stress = contact_stress(forces, cam, STEEL)
    pressed = np.abs(contact_force(forces, cam)) > 1e-6
    if name == "cam-knife":
        assert np.isinf(stress.pressure[pressed]).all()
        return
    assert (stress.pressure[pressed] > 1e6).all() and np.isfinite(stress.pressure).all()
    force = np.abs(contact_force(forces, cam))
    np.testing.assert_allclose(0.5 * np.pi * stress.pressure * stress.half_width * STEEL.width, force, rtol=1e-9, atol=1e-9)


# -- springs --------------------------------------------------------------------------------------------------------------


def test_the_least_spring_is_that_of_the_theory():
    """Along the follower, no margin: the closed form over the law's exact extremes, which 3,600 frames meet to 1e-6."""
    _, forces, cam = solved(mechviz.load("valve-train"), 3600)
    (computed,) = least_springs(forces, cam, 0.0)
    spring = forces.motion.mechanism.loads[0]
    mass, speed = 0.11, 2.0 * np.pi * 60.0
    length = np.hypot(*(forces.motion.point("frame", "H") - forces.motion.point("valve", "R")).T)
    preload = spring.free_length - length.max()
    s, _, acceleration = cam.cam.law(np.linspace(0.0, 2.0 * np.pi, 360_001), 2)  # the ends of the ranges among them
    wanted = np.max(-mass * speed**2 * acceleration / (preload + s - cam.zero))
    assert computed.stiffness == pytest.approx(wanted, rel=1e-5)


@pytest.mark.parametrize("name", ["cam-roller", "valve-train", "cam-oscillating-roller"])
def test_with_the_least_spring_the_margin_is_just_kept(name):
    """The mechanism solved anew with the spring that was found, its rate or its free length: the least force is the margin."""
    scene = mechviz.load(name)
    _, forces, cam = solved(scene, 240)
    margin = 35.0
    springs = least_springs(forces, cam, margin)
    assert springs and all(s.stiffness is not None for s in springs)
    for computed in springs:
        for change in ({"stiffness": computed.stiffness}, {"free_length": computed.free_length}):
            if None in change.values():
                continue
            loads = tuple(replace(x, **change) if x.name == computed.spring else x for x in scene.mechanism.loads)
            motion = solve_motion(compile_mechanism(replace(scene.mechanism, loads=loads)), forces.motion.time)
            force = contact_force(solve_forces(motion), cam)
            if min(change.values()) > 0.0:  # else it is kept without the spring
                assert force.min() == pytest.approx(margin, rel=1e-9)
        assert computed.force == pytest.approx(contact_force(forces, cam).min())


def test_the_least_spring_that_pulls_a_follower_onto_its_cam_is_the_longest_one():
    """Its pull is k (L - L0), and L is least on the base circle: 50 mm from the axis; there it carries the weight, too."""
    line = 'spring = ["follower.E", "frame.H"], stiffness = "3 N/mm", free_length = 80'
    text = text_of("cam-roller").replace(line, 'spring = ["follower.T", "frame.O"], stiffness = "3 N/mm", free_length = 20')
    _, forces, cam = solved(mechviz.loads(text.replace("240 rpm", "1 rpm")), 36)
    (found,) = least_springs(forces, cam, 30.0)
    assert found.free_length == pytest.approx(0.05 - (30.0 - 0.35 * 9.81) / 3000.0, rel=1e-6)
    (tighter,) = least_springs(forces, cam, 400.0)
    assert tighter.free_length is None and tighter.stiffness == pytest.approx((400.0 - 0.35 * 9.81) / 0.03, rel=1e-6)


def test_springs_are_not_sized_where_the_force_is_not_linear():
    _, forces, cam = solved(mechviz.load("cam-friction"), 90)
    with pytest.raises(MechanismError, match="friction"):
        least_springs(forces, cam, 1.0)


# -- the graphical method -------------------------------------------------------------------------------------------------


def test_the_drawn_lift_meets_the_exact_one_on_its_points_and_its_error_shrinks():
    motion, _, cam = solved(mechviz.load("cam-roller"))
    errors = []
    for step in (15.0, 7.5, 3.75):
        lift = drawn_lift(cam, CamDrawn(step=np.radians(step)))
        np.testing.assert_allclose(lift.drawn[0], cam.law(lift.angle)[0] - cam.zero, atol=1e-12)
        np.testing.assert_allclose(lift.exact, cam.law(lift.angle) - [[cam.zero], [0], [0]], atol=1e-9)
        rows = drawn_rows(motion, cam, lift)
        np.testing.assert_allclose(rows[:, :3] - rows[:, 3:], cam.law(cam.argument(motion)).T - [cam.zero, 0, 0], atol=1e-12)
        errors.append(lift.largest)
    assert (np.diff(np.array(errors)[:, 1]) < 0.0).all()
    rough = drawn_lift(cam, CamDrawn(step=np.radians(15.0), resolution=5e-4))
    assert 0.0 < np.abs(rough.error[0]).max() <= 2.5e-4 + 1e-12
    plain = graphical(cam.contour, cam.cam.follower, 24, "tangent", turn=cam.cam.turn)
    np.testing.assert_array_equal(drawn_lift(cam, CamDrawn(step=np.radians(15.0), lines="tangent")).drawn[1:], plain.drawn[1:])


# -- scenes ---------------------------------------------------------------------------------------------------------------

BASE = text_of("cam-roller").replace(
    'rating = { width = 8, materials = ["cast iron", "steel"], limit = "300 MPa", margin = 40 }', "RATING"
)


def test_scenes_ask_for_stress_and_drawing_in_tables_and_events():
    rated = (
        'rating = { width = "6 mm", modulus = ["110 GPa", "210 GPa"], poisson = [0.26, 0.3], limit = "250 MPa", margin = "120 N" }'
    )
    scene = mechviz.loads(BASE.replace("RATING", f"{rated}\ngraphical = {{ step = 15, resolution = 0.1 }}"))
    joint = next(p for p in scene.mechanism.joints if p.name == "K")
    assert joint.rating == CamRating(width=0.006, modulus=(1.1e11, 2.1e11), poisson=(0.26, 0.3), limit=2.5e8, margin=120.0)
    assert joint.drawn == CamDrawn(step=2.0 * np.pi / 24, resolution=1e-4) and isinstance(joint.face, Roller)
    again = next(p for p in mechviz.loads(scene.to_toml()).mechanism.joints if p.name == "K")
    assert (again.rating, again.drawn) == (joint.rating, joint.drawn)
    run = run_scene(scene)
    computed = lines_of(run, "K")
    stress = contact_stress(run.forces, placed_cams(run.motion)[0], joint.rating)
    np.testing.assert_array_equal(computed["stress"].values, np.column_stack([stress.pressure, stress.half_width]))
    assert [c[0] for c in computed["graphical"].columns][::3] == ["drawn_lift", "lift_error"]
    texts = [e.text for e in cam_events(run.motion, run.forces)]
    (pressure,) = [t for t in texts if t.startswith("Hertz pressure")]
    assert f"up to {1e-6 * stress.pressure.max():.4g} MPa (limit 250 MPa)" in pressure
    width = 6.0 * (stress.pressure.max() / 2.5e8) ** 2
    assert f"It needs a width of {width:.4g} mm" in pressure
    assert any(t.startswith("contact force down to 93.") and "(margin 120 N)" in t for t in texts)
    assert any(t.startswith("drawn every 15° and differentiated by chords") for t in texts)


def test_what_is_not_asked_for_is_not_computed(monkeypatch):
    calls = []
    for name in ("contact_stress", "drawn_lift", "least_springs"):
        monkeypatch.setattr(rating_module, name, lambda *a, name=name: calls.append(name))
    run = run_scene(mechviz.loads(BASE.replace("RATING\n", "")), frames=24)
    assert not {"stress", "graphical"} & set(lines_of(run, "K"))
    cam_events(run.motion, run.forces)
    assert calls == []


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("rating = { wide = 8 }", "unknown key 'wide'. Did you mean 'width'?"),
        ("rating = { width = 0 }", "0 is zero."),
        ('rating = { width = 8, materials = ["steal", "steel"] }', "'steal' is no material. Did you mean 'steel'?"),
        ('rating = { materials = ["steel", "steel"] }', "materials without a width of the contact."),
        ('rating = { width = 8, modulus = ["1 GPa", "2 GPa"], poisson = [0.3, 0.7] }', "0.7 is no Poisson's ratio."),
        ("rating = { width = 8, poisson = [0.3, 0.3] }", "poisson goes with modulus."),
        ("rating = { margin = -3 }", "-3 is negative."),
        ('closure = "form"\nrating = { margin = 3 }', "a groove or yoke holds the follower whatever the force."),
        ("rating = { width = 1e-300 }", "is below 1e-06 mm"),
        ("graphical = { step = 100 }", "less than 4. Give at most 90°."),
        ("graphical = { step = 7 }", "7° do not make a turn."),
        ("graphical = { step = 10, lines = 'arc' }", "lines"),
    ],
)
def test_faults_of_ratings(keys, words):
    with pytest.raises(MechanismError) as error:
        mechviz.loads(BASE.replace("RATING", keys))
    assert words in str(error.value)


def test_a_material_too_few_is_one_fault():
    with pytest.raises(mechviz.SceneError) as error:
        mechviz.loads(BASE.replace("RATING", 'rating = { width = 8, materials = ["cast iron"] }'))
    assert [(f.path, f.message) for f in error.value.faults] == [("joints.K.rating.materials", "has 1 entry.")]


def test_a_step_makes_a_whole_turn_in_the_scene_and_in_the_command_alike():
    assert whole_step(np.pi / 2) == np.pi / 2 and whole_step(0.17453292519943) == 2.0 * np.pi / 36
    assert whole_step(2.0 * np.pi / 100_000) == 2.0 * np.pi / 100_000
    for step in (0.0, -0.5, 1.0, 2.0 * np.pi / 3, 2.0 * np.pi / 100_001, 1e-320, np.inf, np.nan):
        assert whole_step(step) is None


def test_the_command_tells_limits_springs_and_the_drawing():
    run = CliRunner().invoke(app, ["cams", "valve-train", "--method", "graphical", "--step", "30 deg", "--lines", "tangent"])
    assert run.exit_code == 1 and "limits are violated: contact force of K." in run.output
    for words in (
        "margin 20 N: FAIL",
        "least spring       valve_spring: ",
        "Hertz pressure",
        "steps of 30°, tangents",
        "pressure angle",
    ):
        assert words in run.output
    assert "undercut           pass; least radius 2.308" in run.output, "from the law, not from the frames"
    assert "face 16 mm and 16 mm: pass" in run.output
    table = [line.split() for line in run.output.splitlines() if line.strip()[:1].isdigit()]
    assert len(table) == 12 and float(table[4][0]) == 120.0
    checked = CliRunner().invoke(app, ["check", "cam-roller"])
    assert "limit 300 MPa: pass" in checked.output and "least spring       return_spring" in checked.output
    for arguments, words in (
        (["crank-rocker"], "the scene has no cam"),
        (["cam-roller", "--step", "30"], "--step and --lines are for --method graphical"),
        (["cam-roller", "--method", "graphical", "--step", "7"], "7° do not make a turn"),
        (["cam-roller", "--method", "graphical", "--step", "0.001"], "more than 100000. Give at least 0.0036°"),
        (["cam-roller", "--margin", "1e308 N"], "from zero to 1e+30 N"),
        (["cam-roller", "--margin", "3 mm"], "--margin"),
    ):
        run = CliRunner().invoke(app, ["cams", *arguments])
        assert run.exit_code == 2 and words in run.output, run.output


@pytest.mark.parametrize("start", [0, 100])
def test_what_holds_at_every_angle_is_said_of_the_whole_turn(start):
    text = text_of("cam-roller").replace('limit = "300 MPa", margin = 40', 'limit = "1 MPa", margin = "1 MN"')
    scene = mechviz.loads(text).changed({("joints", "O", "drive", "start"): start})
    motion, forces, _ = solved(scene)
    said = [e.text for e in cam_events(motion, forces)]
    for words in ("Hertz pressure up to", "contact force down to"):
        (event,) = (each for each in said if each.startswith(words))
        assert ") over the whole turn, the " in event
    part = solve_motion(compile_mechanism(scene.mechanism), motion.time[:180])
    (event,) = (e.text for e in cam_events(part, solve_forces(part)) if e.text.startswith("Hertz pressure"))
    assert f") from {start}° of the cam to {start + 179}° of the cam, the " in event


def test_a_margin_is_reported_where_the_least_force_is_zero_but_for_rounding(monkeypatch):
    """A spring that is just slack on the base circle."""
    text = text_of("cam-roller").replace("free_length = 80", "free_length = 50").replace('effects = ["inertia", "gravity"]', "")
    motion, forces, _ = solved(mechviz.loads(text))
    monkeypatch.setattr(events_module, "contact_force", lambda *of: contact_force(*of) - 1e-13)
    said = [e.text for e in cam_events(motion, forces)]
    assert sum(words.startswith("contact force down to 0 N (margin 40 N)") for words in said) == 2


# -- violated limits --------------------------------------------------------------------------------------------------------


def invoked(tmp_path, text, *arguments):
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    command, *options = arguments
    return CliRunner().invoke(app, [command, str(path), *options])


def steepest() -> float:
    """Largest pressure angle [degrees] of BASE: a cycloidal rise of 20 mm over 120°, a central roller whose centre starts at 50 mm.

    Any text on cams: tan(alpha) = s' / (r + s).
    """
    b = np.radians(120.0)
    x = np.linspace(0.0, 1.0, 200_001)
    s, slope = 20.0 * (x - np.sin(2.0 * np.pi * x) / (2.0 * np.pi)), 20.0 / b * (1.0 - np.cos(2.0 * np.pi * x))
    return float(np.degrees(np.arctan(slope / (50.0 + s)).max()))


def test_check_tells_limits_that_are_violated_and_the_command_fails(tmp_path):
    text = BASE.replace("RATING", "").replace("[joints.K.profile]", "[joints.K.profile]\npressure_limit = 15")
    alpha = f"{steepest():.5g}°"
    checked = invoked(tmp_path, text, "check")
    (line,) = [line for line in checked.output.splitlines() if line.startswith("limits ")]
    assert "K: pressure angle" in line and f"up to {alpha}" in line and line.endswith("limit 15°: FAIL") and checked.exit_code == 0
    told = invoked(tmp_path, text, "cams")
    assert told.exit_code == 1 and "limits are violated: pressure angle of K." in told.output
    kept = text.replace("pressure_limit = 15", "pressure_limit = 18")
    assert "limits " not in invoked(tmp_path, kept, "check").output and invoked(tmp_path, kept, "cams", "--strict").exit_code == 0


@pytest.mark.parametrize(
    ("at", "face", "told"),
    [
        (0, [5, 5], "12 mm to the left and 12 mm to the right; face 5 mm and 5 mm: FAIL"),
        (0, [12, 12], "12 mm to the left and 12 mm to the right; face 12 mm and 12 mm: pass"),
        (-20, [1, 32], "0 mm to the left and 32 mm to the right; face 1 mm and 32 mm: pass"),
    ],
)
def test_the_face_on_a_given_profile_is_judged(tmp_path, at, face, told):
    """The contact of an eccentric disc goes 12 mm, its eccentricity, to either side of the disc's axis."""
    text = text_of("cam-eccentric").replace("flat = true", f"flat = true, face = {face}").replace("G = [0,", f"G = [{at},")
    run = invoked(tmp_path, text, "cams", "--strict")
    failed = told.endswith("FAIL")
    assert told in run.output and run.exit_code == failed and ("limits are violated: face of K." in run.output) == failed
    lines = [line for line in invoked(tmp_path, text, "check").output.splitlines() if line.startswith("limits ")]
    assert len(lines) == failed and all("K: face" in line and line.endswith(told) for line in lines)


def test_a_contact_on_one_side_of_the_follower_s_point_goes_nowhere_on_the_other(tmp_path):
    """A cycloidal rise of 20 mm over 120 degrees: the contact lies h' - e from the point, h' up to 2 * 20 mm / 120 degrees."""
    text = text_of("cam-flat").replace("G = [0,", "G = [30,").replace("face = [30, 30]", "face = [50, 1]")
    run = invoked(tmp_path, text, "cams")
    assert f"{30.0 + 40.0 / np.radians(120.0):.5g} mm to the left and 0 mm to the right; face 50 mm and 1 mm: pass" in run.output


def test_the_curvature_of_what_the_cutter_leaves_is_judged(tmp_path):
    """Corners remain of the undercut profile, of radius zero; the law would keep to no positive one."""
    text = text_of("cam-undercut").replace('undercut = "cut"', 'undercut = "cut"\ncurvature_limit = 10')
    run = invoked(tmp_path, text, "cams")
    assert re.search(r"least radius of the convex profile 0 mm at \d+°; limit 10 mm: FAIL", run.output)
    assert run.exit_code == 1 and "limits are violated: curvature of K." in run.output
    assert "K: curvature least radius" in invoked(tmp_path, text, "check").output
    plain = CliRunner().invoke(app, ["cams", "cam-undercut"])
    assert "least radius of the convex profile 0 mm" in plain.output and "limit" not in plain.output


def test_limits_of_given_profiles_that_only_a_run_decides_are_named(tmp_path):
    text = text_of("cam-undercut").replace('undercut = "cut"', 'undercut = "cut"\ncurvature_limit = 10\npressure_limit = 30')
    text = text.replace("flat = true,", "flat = true, face = [5, 5],").replace("[joints.K.p", "liftoff = {}\n[joints.K.p")
    checked = invoked(tmp_path, f'run = {{ duration = "1 s", frames = 60 }}\n{text}', "check").output
    for what in ("pressure angle", "curvature", "face"):
        assert f"tells whether the {what} at K keeps its limit" in checked, checked


def test_what_the_scene_states_no_limit_for_fails_if_asked_to(tmp_path):
    run = CliRunner().invoke(app, ["cams", "cam-undercut"])
    assert run.exit_code == 0 and "undercut           FAIL" in run.output and "by up to 0.6398 mm" in run.output
    assert CliRunner().invoke(app, ["cams", "cam-undercut", "--strict"]).exit_code == 1
    slack = CliRunner().invoke(app, ["cams", "cam-roller", "--margin", "100 N"])
    assert slack.exit_code == 0 and "margin 100 N: FAIL" in slack.output
    assert CliRunner().invoke(app, ["cams", "cam-roller", "--margin", "100 N", "--strict"]).exit_code == 1


def test_the_report_is_in_the_units_of_the_scene():
    scene = mechviz.loads(BASE.replace("RATING", 'rating = { width = 8, limit = "300 MPa", margin = 40 }'))
    run = run_scene(scene)
    units = Units(length="in", angle="rad", force="kN")
    lines = "\n".join(cam_lines(run.motion, cam_facts(run.motion, run.forces), units))
    assert "roller of 0.393701 in" in lines and f"{np.radians(steepest()):.5g} rad" in lines and "margin 0.04 kN: pass" in lines
    assert not re.search(r"\d ?(mm|°|deg|m|N)\b", lines)


@pytest.mark.parametrize("change", ["", "along = [-1, 0]", 'bed = "B"\nsense = "cw"\nphase = 140'])
def test_the_rise_of_a_wedge_is_its_rise_whichever_way_it_moves(tmp_path, change):
    """A cycloidal rise of 22 mm over 60 mm, steepest in its middle, then a return of 16 mm by 3-4-5 over 60 mm."""
    text = text_of("cam-wedge").replace('bed = "B"' if "bed" in change else "along = [1, 0]", change or "along = [1, 0]")
    rise, fall = (np.degrees(np.arctan(slope)) for slope in (2.0 * 22.0 / 60.0, 1.875 * 16.0 / 60.0))
    output = invoked(tmp_path, text, "cams").output
    assert f"pressure angle     rise up to {rise:.5g}° at 30 mm, return up to {fall:.5g}° at 110 mm" in output
    assert re.search(r"least radius 21.004 mm at 47.50\d mm", output)


def test_pressure_angles_of_one_sign_have_no_largest_one_of_the_other(tmp_path):
    """A face at 10 degrees has this pressure angle at rise and return alike."""
    text = text_of("cam-flat").replace("flat = true", "flat = true, tilt = 10")
    assert "pressure angle     rise up to 10° at 0°\n" in invoked(tmp_path, text, "cams").output


def test_a_slot_for_a_roller_on_a_slide_is_an_inverse_cam():
    assert "cam K: inverse, oscillating follower" in CliRunner().invoke(app, ["cams", "cam-inverse-slide"]).output


@pytest.mark.parametrize("frames", [17, 360])
def test_the_largest_second_derivative_is_that_of_the_law_not_of_the_frames(frames):
    scene = mechviz.load("cam-roller").changed({("run", "frames"): frames})
    run = run_scene(scene)
    (cam,) = placed_cams(run.motion)
    exact = 1e3 * np.abs(cam.law(np.linspace(0.0, 2.0 * np.pi, 100_001))[2]).max()
    (lift,) = (fact.text for fact in cam_facts(run.motion, run.forces) if fact.what == "lift")
    assert float(lift.split("s'' ")[1].split()[0]) == pytest.approx(exact, rel=1e-5)
