"""Barrel, end and globoidal cams in scenes: the forces of the plane mechanism against those in space, solids that touch, faults."""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np
import pytest
from cam_scenes import changed, refused, text_of

import mechviz
from mechcore.errors import MechanismError
from mechcore.forces.cam_events import cam_events
from mechcore.forces.cam_rating import contact_force, contact_stress, placed_cams
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.mechanism import CamRating
from mechviz.meshes.kinds.spatial_cams import Spin, spin_transforms
from mechviz.meshes.solids import build_solids
from mechviz.quantities.tables import tables
from mechviz.runs import run_scene
from mechviz.studies.cam_report import cam_facts

SCENES = ["cam-barrel", "cam-barrel-rib", "cam-end", "cam-barrel-arm", "cam-globoid"]


def solved(name: str, frames: int | None = None):
    scene = mechviz.load(name)
    mechanism = replace(scene.mechanism, effects=tuple(e for e in scene.mechanism.effects if e != "friction"))
    motion = solve_motion(compile_mechanism(mechanism), default_times(mechanism, frames or scene.frames, 1))
    return motion, solve_forces(motion)


@pytest.mark.parametrize("name", SCENES)
def test_the_follower_keeps_to_its_law_and_power_to_its_balance(name):
    motion, forces = solved(name)
    (cam,) = placed_cams(motion)
    rows = cam.rows(motion)
    along = motion.coordinate(cam.guide)[:, 0]
    sign = 1.0 if cam.pivot is None else -1.0  # an arm turns clockwise as its coordinate grows
    np.testing.assert_allclose(along - along[0], sign * rows.lift, atol=1e-13)
    point = motion.point(cam.links[1], "T")
    np.testing.assert_allclose(rows.place, point[:, 0] + 1j * point[:, 1], atol=1e-13)
    assert np.abs(forces.power_balance).max() < 1e-12
    speed = motion.coordinate("O")[:, 1]
    torque = forces.effort("O")
    load = -forces.inertia(cam.links[1]) if cam.pivot is None else None
    if load is not None and name != "cam-end":  # the shaft's torque is what the carriage's inertia asks for, times s'
        np.testing.assert_allclose(torque * speed, load[:, 1] * motion.coordinate(cam.guide)[:, 1], atol=1e-12)


@pytest.mark.parametrize("name", SCENES)
def test_the_contact_force_in_space_turns_the_shaft(name):
    """The normal force's moment about the cam's axis is the torque that the plane mechanism has, at every angle.

    Moment and motion from the flank in space alone: normal N and place S of the contact, torque = -k (S x N) F.
    """
    motion, forces = solved(name)
    (cam,) = placed_cams(motion)
    force = contact_force(forces, cam)
    flank = cam.cam.flank(cam.argument(motion), [cam.middle])
    n, p = flank.normal[:, 0], flank.point[:, 0]
    on_cam = -force[:, None] * n  # the roller pushes back on the flank that lifts
    moment = cam.sense * (p[:, 0] * on_cam[:, 1] - p[:, 1] * on_cam[:, 0])
    torque = forces.effort("O")
    np.testing.assert_allclose(-moment, torque, atol=2e-9 * np.abs(torque).max() + 1e-12)


def bent(cam, angle: float, side: int) -> tuple[np.ndarray, float]:
    """Principal curvatures of a flank, positive where it is convex, and its curvature across the roller's axis' image on it, from
    differences of its points alone."""
    h = np.array([1e-3, 1e-2 * cam.cam.radius])
    around = cam.cam.flank(angle + h[0] * np.arange(-1, 2), cam.middle + h[1] * np.arange(-1, 2), side).point
    steps = np.stack([around[2, 1] - around[0, 1], around[1, 2] - around[1, 0]]) / (2.0 * h[:, None])
    seconds = np.empty((2, 2, 3))
    seconds[0, 0] = (around[2, 1] - 2.0 * around[1, 1] + around[0, 1]) / h[0] ** 2
    seconds[1, 1] = (around[1, 2] - 2.0 * around[1, 1] + around[1, 0]) / h[1] ** 2
    seconds[0, 1] = seconds[1, 0] = (around[2, 2] - around[2, 0] - around[0, 2] + around[0, 0]) / (4.0 * h[0] * h[1])
    normal = np.cross(*steps) / np.linalg.norm(np.cross(*steps))
    normal *= np.sign(normal @ cam.cam.flank([angle], [cam.middle], side).normal[0, 0])
    first, second = steps @ steps.T, -seconds @ normal
    across = np.array([first[1, 1], -first[0, 1]])  # perpendicular to the step along the roller
    return np.linalg.eigvals(np.linalg.solve(first, second)).real, across @ second @ across / (across @ first @ across)


SHARP_END = """
units = { length = "mm", angle = "deg" }
[links]
frame = { points = { O = [0, 0], G = [0, 105], H = [0, 235] } }
cam = { points = { O = [0, 0] } }
carriage = { points = { T = [0, 0], C = [0, 105], E = [0, 130] } }
[joints]
O = { revolute = ["frame", "cam"], drive = { speed = "30 rpm", start = 0 } }
S = { prismatic = ["frame", "carriage"], at = ["G", "C"], along = [0, 1] }
[joints.K]
cam = ["cam", "carriage"]
follower = { roller = 8, guide = "S", point = "T" }
closure = "force"
rating = { width = 4 }
profile = { base = 30, end = { radius = 45, depth = 4 }, lift = [
    { over = 60, to = 25, law = "3-4-5" }, { over = 120 }, { over = 60, to = 0, law = "3-4-5" }, { over = 120 } ] }
[loads]
P = { force = [0, "-1 kN"], on = "carriage", at = "E" }
"""


def test_a_hollow_flank_is_recorded_as_hollow():
    """An end cam where it begins to rise: on the unrolled cylinder the roller's path bends with a radius of 16.92 mm + 8 mm."""
    run = run_scene(mechviz.loads(SHARP_END), frames=360)
    columns = {t.path[-1]: t.values for t in tables(run) if t.path[:2] == ("data", "cams")}
    (large, small), across = bent(placed_cams(run.motion)[0], np.radians(10.0), 1)
    assert sorted([1e3 / large, 1e3 / small]) == pytest.approx([-24.70, 1297.4], rel=2e-3)
    assert columns["contact"][10, 4] == pytest.approx(1.0 / across, rel=1e-4)
    assert -25.5e-3 < columns["contact"][10, 4] < -24.0e-3
    assert columns["stress"][10, 0] == pytest.approx(907e6, rel=1e-3)  # 905 MPa on the unrolled cylinder


@pytest.mark.parametrize("name", ["cam-barrel", "cam-end", "cam-barrel-arm", "cam-globoid"])
def test_hertz_s_pressure_takes_both_curvatures_of_a_flank(name):
    """Along the line of contact flank and roller bend alike: across it their curvatures differ by the sum of all four."""
    motion, forces = solved(name, 23)
    (cam,) = placed_cams(motion)
    force, r = contact_force(forces, cam), cam.cam.radius
    stress = contact_stress(forces, cam, CamRating(width=0.008)).pressure
    rows = cam.rows(motion, force)
    for k in range(1, 23):  # none on a knot of the law
        if abs(force[k]) < 1e-3 * np.abs(force).max():
            continue
        side = -1 if cam.form_closed and force[k] < 0.0 else 1
        curvatures, across = bent(cam, float(rows.angle[k]), side)
        wanted = np.sqrt(abs(force[k]) / 0.008 * 2.1e11 / (2.0 * 0.91) * (1.0 / r + curvatures.sum()) / np.pi)
        assert stress[k] == pytest.approx(wanted, rel=1e-4), k
        assert 1.0 / rows.radius[k] == pytest.approx(across, rel=1e-3, abs=1e-3), k


@pytest.mark.parametrize(("name", "limit", "reached"), [("cam-barrel", 41, None), ("cam-barrel-arm", 40, 42.614)])
def test_the_event_judges_the_pressure_angle_that_the_limit_judges(name, limit, reached):
    """Over the roller's length, at its inner end: tan alpha = s' / r there, of the middle of the roller less than the limit."""
    text = changed(text_of(name), "[joints.K.profile]", f"[joints.K.profile]\npressure_limit = {limit}")
    run = run_scene(mechviz.loads(text), frames=720)
    (cam,) = placed_cams(run.motion)
    if reached is None:
        speed = np.abs(run.motion.coordinate("S")[:, 1] / run.motion.coordinate("O")[:, 1]).max()
        reached = np.degrees(np.arctan(speed / cam.cam.inner))
    (fact,) = (fact for fact in cam_facts(run.motion, run.forces) if fact.what == "pressure angle")
    assert fact.failed and f"up to {reached:.5g}° over the roller's length" in str(fact.text)
    assert np.degrees(np.abs(cam.rows(run.motion).pressure_angle).max()) < limit
    steep = [e.value for e in cam_events(run.motion, run.forces) if "pressure angle over the roller's length" in e.text]
    assert np.degrees(max(steep)) == pytest.approx(reached, abs=2e-3)


@pytest.mark.parametrize("name", SCENES)
def test_the_roller_fits_its_groove(name):
    """In space and over a turn: no point of the cam's solid is nearer to the roller's axis than its radius, and flanks touch it."""
    motion, _ = solved(name, 49)
    solids = build_solids(motion.mechanism, {k: motion.pose(k) for k in motion.model.links})
    assert not solids.clashes
    (cam,) = placed_cams(motion)
    solid, follower = solids.links[cam.links[0]], solids.links[cam.links[1]]
    assert all(part.is_volume for part in solid.parts)
    body = solid.parts[0].vertices
    angle = motion.pose(cam.links[0])[:, 2]
    shifts, turns = spin_transforms(solid.spin, angle)
    rollers = [p for k, p in zip(follower.kinds, follower.parts, strict=True) if k == "roller"]
    assert len(rollers) == (2 if "rib" in name else 1)
    radius, tolerance = cam.cam.radius, 6e-5
    for k in range(0, motion.frames, 6):
        x, y, phi = motion.pose(cam.links[0])[k]
        v, w = turns[k, :3], turns[k, 3]
        local = body + 2.0 * np.cross(v, np.cross(v, body) + w * body) + shifts[k]
        c, s = np.cos(phi), np.sin(phi)
        world = np.column_stack([x + c * local[:, 0] - s * local[:, 1], y + s * local[:, 0] + c * local[:, 1], local[:, 2]])
        px, py, psi = motion.pose(cam.links[1])[k]
        for roller in rollers:
            u = roller.vertices
            c, s = np.cos(psi), np.sin(psi)
            placed = np.column_stack([px + c * u[:, 0] - s * u[:, 1], py + s * u[:, 0] + c * u[:, 1], u[:, 2]])
            axis = _axis(placed)
            middle = placed.mean(axis=0)
            away = world - middle
            along = away @ axis
            across = np.linalg.norm(away - along[:, None] * axis, axis=1)
            own = (placed - middle) @ axis
            wide = np.linalg.norm(placed - middle - own[:, None] * axis, axis=1) > 0.99 * radius
            beside = (along > own[wide].min() - 0.1 * radius) & (along < own[wide].max() + 0.1 * radius)
            nearest = across[beside].min()
            assert radius - tolerance < nearest < radius + 3e-4  # rings have a point every degree


def _axis(points: np.ndarray) -> np.ndarray:
    """The axis of a slender or wide solid of revolution: the direction whose spread differs from the two equal others."""
    spread, axes = np.linalg.eigh(np.cov((points - points.mean(axis=0)).T))
    k = int(np.argmax([abs(spread[i] - np.delete(spread, i).mean()) for i in range(3)]))
    return axes[:, k]


def test_a_spin_is_the_turn_back_and_the_turn_about_the_axis():
    spin, turn = Spin((0.3, -0.2, 0.1), (0.6, 0.8), "frame"), np.array([0.0, 0.7, -2.5])
    shifts, q = spin_transforms(spin, turn)
    p = np.array([0.9, 0.4, -0.3])
    for k, t in enumerate(turn):
        u, o = np.array([0.6, 0.8, 0.0]), np.array(spin.origin)
        d = p - o
        turned = d * np.cos(t) + np.cross(u, d) * np.sin(t) + u * (u @ d) * (1.0 - np.cos(t))  # Rodrigues
        back = np.array([[np.cos(t), np.sin(t), 0.0], [-np.sin(t), np.cos(t), 0.0], [0.0, 0.0, 1.0]])
        v, w = q[k, :3], q[k, 3]
        got = p + 2.0 * np.cross(v, np.cross(v, p) + w * p) + shifts[k]
        np.testing.assert_allclose(got, o + back @ turned, atol=1e-14)


def test_the_viewer_turns_them_as_the_recording_does():
    """The node's pose is that of the link followed by the spin of its solid, for any place and carrier."""
    from mechviz.outputs.viewer.world.solids import composed

    spin = Spin((0.3, -0.2, 0.1), (0.6, 0.8), "arm")
    pose, carrier = np.array([[0.5, 0.1, 1.1]]), np.array([[0.0, 0.0, 0.4]])
    shift, q = spin_transforms(spin, pose[:, 2] - carrier[:, 2])
    turn, place = composed(pose, shift, q)
    p = np.array([0.9, 0.4, -0.3])

    def turned(w, v):
        return p + 2.0 * np.cross(v, np.cross(v, p) + w * p)

    local = turned(q[0, 3], q[0, :3]) + shift[0]
    c, s = np.cos(1.1), np.sin(1.1)
    wanted = [0.5 + c * local[0] - s * local[1], 0.1 + s * local[0] + c * local[1], local[2]]
    np.testing.assert_allclose(turned(turn[0, 0], turn[0, 1:]) + place[0], wanted, atol=1e-14)


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("cam-barrel", "radius = 45, depth = 9 }", "radius = 45, depth = 50 }", ["joints.K.profile", "50 mm"]),
        ("cam-barrel", "barrel = {", "rib = { radius = 3, depth = 1 }\nbarrel = {", ["barrel and rib at once"]),
        ("cam-barrel-rib", "roller = 8", "knife = true", ["joints.K.follower", "Give roller"]),
        ("cam-barrel", "roller = 8", "roller = 60", ["joints.K", "undercuts the flank", "Give at most"]),
        ("cam-barrel", "C = [0, 105]", "C = [5, 105]", ["joints.K.follower.point", "passes the cam's axis at 5 mm"]),
        ("cam-barrel-arm", "axis = [0, 1]\n", "", ["joints.K.profile.axis", "missing"]),
        ("cam-barrel-arm", "axis = [0, 1]", "axis = [0, -1]", ["joints.K.profile.axis", "to the left"]),
        ("cam-barrel-arm", "base = -21", "base = 300", ["joints.K.profile.base", "does not reach 300 mm"]),
        ("cam-barrel-rib", ", thickness = 8", "", ["joints.K.profile.rib", "'thickness' is missing"]),
        ("cam-roller", "base = 40", "base = -40", ["joints.K.profile.base", "-40 mm is negative"]),
        ("cam-roller", "base = 40", "axis = [0, 1]\nbase = 40", ["joints.K.profile.axis", "across the plane"]),
    ],
)  # fmt: skip
def test_faults_of_spatial_cams(name, old, new, words):
    refused(changed(text_of(name), old, new), words)


@pytest.mark.parametrize("name", [*SCENES, "cam-conjugate", "cam-conjugate-oscillating"])
def test_scenes_read_as_they_were_written(name):
    scene = mechviz.load(name)
    again = mechviz.loads(scene.to_toml(), scene.name)
    assert again == scene and again.to_toml() == scene.to_toml()
    joint, other = (s.mechanism.joints[-1] for s in (scene, again))
    assert (joint.spatial, joint.second, joint.base) == (other.spatial, other.second, other.base)


@pytest.mark.parametrize("name", ["cam-conjugate", "cam-conjugate-oscillating"])
def test_either_roller_of_a_conjugate_joint_stays_on_its_cam(name):
    """The second profile against the global search of a follower that stands on it; the force never pulls."""
    from mechcore.cams.analysis import analyse
    from mechcore.cams.contour import cam_contour

    motion, forces = solved(name)
    (cam,) = placed_cams(motion)
    x = np.linspace(0.1, 6.1, 40)
    contact = analyse(cam_contour(cam.mate.cam), cam.mate.cam.follower, x, cam.mate.cam.turn, bridges=False)
    np.testing.assert_allclose(contact.motion[0], cam.mate.cam.law(x, 0)[0], atol=1e-11)
    force = contact_force(forces, cam)
    assert force.min() < 0.0 < force.max(), "either cam carries at times"
    reaction = forces.reaction("K")[:, 0] + 1j * forces.reaction("K")[:, 1]
    place = cam.rows(motion, force).place
    pulled = force < -1e-6 * np.abs(force).max()
    point = motion.point(cam.links[1], "R")
    middle = point[:, 0] + 1j * point[:, 1]
    push = np.real(reaction * np.conj(middle - place))
    assert (push[pulled] > 0.0).all(), "the second cam pushes its roller away from itself"
    np.testing.assert_allclose(np.abs(middle - place)[pulled], cam.mate.cam.follower.radius, rtol=1e-9)
    assert np.abs(forces.power_balance).max() < 1e-12


def test_an_inverse_cam_drives_its_lever():
    """The lever turns by the law of the crank's angle, the roller's centre stays on the groove, the force is along its normal."""
    motion, forces = solved("cam-inverse")
    (cam,) = placed_cams(motion)
    crank, lever = motion.pose("crank")[:, 2], motion.pose("lever")
    np.testing.assert_allclose(lever[:, 2], cam.law(crank)[0], atol=1e-14)
    assert np.ptp(lever[:, 2]) == pytest.approx(np.radians(22.0), rel=1e-12)
    at = motion.point("crank", "A")
    local = ((at[:, 0] - lever[:, 0]) + 1j * (at[:, 1] - lever[:, 1])) * np.exp(-1j * lever[:, 2])
    np.testing.assert_allclose(local, cam.mount_origin + cam.mount * cam.cam.pitch(crank, 0)[0], atol=1e-14)
    assert np.abs(forces.power_balance).max() < 1e-12
    reaction = forces.reaction("K")[:, 0] + 1j * forces.reaction("K")[:, 1]
    rows = cam.rows(motion, contact_force(forces, cam))
    np.testing.assert_allclose(np.abs(rows.place - at[:, 0] - 1j * at[:, 1]), cam.cam.radius, rtol=1e-12)
    push = rows.place - at[:, 0] - 1j * at[:, 1]  # the flank lies where the roller pushes
    large = np.abs(reaction) > 1e-3 * np.abs(reaction).max()
    np.testing.assert_allclose((reaction / push).imag[large], 0.0, atol=1e-9 * np.abs(reaction / push).max())
    assert ((reaction / push).real[large] > 0.0).all()


@pytest.mark.parametrize("turned", [180, -180, 540])
def test_the_crank_of_an_inverse_cam_may_swing_about_any_angle(turned):
    """The whole mechanism turned by half a turn moves and presses as before, wherever the angle of its crank is counted from."""
    text = text_of("cam-inverse")
    swung = text.replace("phase = 42", "phase = -138").replace("P = [60, -110]", "P = [-60, 110]")
    swung = swung.replace("amplitude = 40", f"amplitude = 40, centre = {turned}")
    computed = []
    for each in (text, swung):
        mechanism = mechviz.loads(each).mechanism
        motion = solve_motion(compile_mechanism(mechanism), default_times(mechanism, 90, 1))
        forces, (cam,) = solve_forces(motion), placed_cams(motion)
        rows = cam.rows(motion, contact_force(forces, cam))
        np.testing.assert_allclose(rows.lift, motion.coordinate("P")[:, 0] - cam.law(cam.travel[0])[0], atol=1e-12)
        assert not cam_events(motion, forces)
        computed.append((rows.lift, contact_force(forces, cam), rows.pressure_angle, cam.segment(motion)))
    for before, after in zip(*computed, strict=True):
        np.testing.assert_allclose(after, before, atol=1e-9 * np.abs(before).max())


@pytest.mark.parametrize(("beside", "passes"), [(-110, True), (0, False), (-7, False), (7, False)])
def test_a_roller_does_not_reach_the_pivot_of_the_link_that_it_drives(beside, passes):
    """A pin 60 mm from O comes within 1 mm of a pivot 60 mm along and so far beside: its roller of 8 mm would lie on it."""
    text = text_of("cam-inverse").replace("P = [60, -110]", f"P = [60, {beside}]")
    told = pytest.raises(MechanismError, match="roller of 8 mm reaches the driven link's pivot")
    with contextlib.nullcontext() if passes else told:
        compile_mechanism(mechviz.loads(text).mechanism)


@pytest.mark.parametrize(
    ("name", "old", "new", "told"),
    [
        ("cam-wedge", "amplitude = 75", "amplitude = 70", []),
        ("cam-wedge", "amplitude = 75", "amplitude = 80", ["as far as -10 mm", "as far as 150 mm"]),
        ("cam-wedge", "sense", "", ["as far as 145 mm", "as far as -5 mm"]),
        ("cam-inverse-slide", "amplitude = 45", "amplitude = 50", ["as far as 50 mm", "as far as -50 mm"]),
        ("cam-inverse", "amplitude = 40", "amplitude = 90", ["as far as 90°", "as far as 270°"]),
        ("cam-inverse", "amplitude = 40", "amplitude = 190", ["turns round"]),
    ],
)
def test_what_goes_beyond_its_law_is_told(name, old, new, told):
    text = text_of(name)
    if old == "sense":  # against its bed, from the other side
        text = text.replace("centre = 70", "centre = -70").replace('bed = "B"', 'bed = "B"\nsense = "cw"')
    else:
        text = text.replace(old, new)
    mechanism = mechviz.loads(text).mechanism
    motion = solve_motion(compile_mechanism(mechanism), default_times(mechanism, 360, 1))
    events = [e for e in cam_events(motion, None) if "its law" in e.text]
    assert len(events) == len(told) and all(word in e.text for e, word in zip(events, told, strict=True)), events
    assert [e.level for e in events] == ["WARN" if "turns" in word else "INFO" for word in told]


@pytest.mark.parametrize("slides", [False, True])
def test_a_slide_drives_a_link_with_a_slot(slides):
    """The roller stays on the slot at every place of the slide; the force on the slide is the driven link's inertia over the
    gearing, by the law's own slope; a slot on a link that slides across is the law itself, upside down."""
    text = text_of("cam-inverse-slide").replace(', "friction"', "")
    if slides:
        text = text.replace('P = { revolute = ["frame", "lever"] }', 'P = { prismatic = ["frame", "lever"], along = [0, 1] }')
    mechanism = mechviz.loads(text).mechanism
    motion = solve_motion(compile_mechanism(mechanism), default_times(mechanism, 90, 1))
    forces, (cam,) = solve_forces(motion), placed_cams(motion)
    x, pose, at = motion.coordinate("S"), motion.pose("lever"), motion.point("slide", "A")
    q, slope, bend = cam.law(x[:, 0])
    np.testing.assert_allclose(motion.coordinate("P")[:, 0], q, atol=1e-14)
    np.testing.assert_allclose(motion.coordinate("P")[:, 2], bend * x[:, 1] ** 2 + slope * x[:, 2], atol=1e-9)
    local = ((at[:, 0] - pose[:, 0]) + 1j * (at[:, 1] - pose[:, 1])) * np.exp(-1j * pose[:, 2])
    np.testing.assert_allclose(local, cam.mount_origin + cam.mount * cam.cam.pitch(x[:, 0], 0)[0], atol=1e-14)
    if slides:
        np.testing.assert_allclose(local.imag - local.imag[0], q[0] - q, atol=1e-14)
    assert np.abs(forces.power_balance).max() < 1e-12
    slide = 0.8 * x[:, 2]
    driven = (0.9 if slides else 0.0015 + 0.9 * (0.04**2 + 0.025**2)) * motion.coordinate("P")[:, 2] * slope
    np.testing.assert_allclose(forces.effort("S"), slide + driven, atol=1e-9 * np.abs(slide + driven).max())


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('bed = "S"', 'bed = "P"', ["joints.K.profile.bed", "'P' is no prismatic joint of 'slide'"]),
        ("P = [110, -60]", "P = [10, -60]", ["joints.K", "mm of the slide the groove lies along the motion"]),
    ],
)
def test_faults_of_slides_with_rollers(old, new, words):
    refused(changed(text_of("cam-inverse-slide"), old, new), words)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('closure = "form"', 'closure = "force"', ["joints.K.follower.groove", "Add closure = 'form'"]),
        ('point = "A"', 'point = "E"', ["joints.K.follower.point", "'E'"]),
        ("over = 60", "over = 360", ["joints.K.lift", "Let the crank swing"]),
        ("P = [60, -110]", "P = [160, 0]", ["joints.K", "the groove lies along the motion"]),
    ],
)
def test_faults_of_inverse_cams(old, new, words):
    refused(changed(text_of("cam-inverse"), old, new), words)
