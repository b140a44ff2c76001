"""Friction of cams that press on either side, and of cams about an axis in the plane: statics in space, screws, jamming guides."""

from __future__ import annotations

import re

import numpy as np
import pytest
from cam_scenes import refused

import mechviz
from mechcore.cams.placement.spatial import roller_speed
from mechcore.cams.spatial import Barrel, BarrelArm
from mechcore.forces.cam_rating import contact_force, placed_cams
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechviz.scene.folder import GALLERY_FOLDER

MU, PIN = 0.11, 3e-3


def text_of(name: str) -> str:
    text = (GALLERY_FOLDER / f"{name}.toml").read_text()
    text = re.sub(r"\n *friction = \{[^\n]*", "", text).replace(', "friction"]', "]")  # without what the scene has itself
    return text.replace('effects = ["inertia"', 'effects = ["friction", "inertia"', 1)


def rubbing(name: str, table: str | None = None) -> str:
    table = table or f"{{ coefficient = {MU}, radius = {1e3 * PIN} }}"
    return text_of(name).replace("[joints.K.profile]", f"friction = {table}\n\n[joints.K.profile]")


def solved(text: str, frames: int = 180):
    mechanism = mechviz.loads(text).mechanism
    motion = solve_motion(compile_mechanism(mechanism), default_times(mechanism, frames, 1))
    return motion, solve_forces(motion)


def in_space(cam, angle, h=1e-5):
    """Contact, normal, rolling direction and slip [m/rad] on either flank at the law's argument, in the cam's axes.

    The follower's body is moved by the law a little back and forth, turned into the cam's axes; its point at the contact draws
    its way over the cam: no formula of the relative velocity is used.
    """
    mount, out = cam.cam.mount, {}
    for side in (1, -1):
        flank = cam.cam.flank(angle, [cam.middle], side)
        point, normal = flank.point[:, 0], flank.normal[:, 0]
        axis = flank.axis_point[:, 0]
        beyond = cam.cam.flank(angle, [cam.middle + 1e-3], side).axis_point[:, 0]
        a = (beyond - axis) / 1e-3
        if cam.blank.kind == "rib" and side == 1:  # where the rollers really are: half a rib and a radius from the follower's point
            shift = 0.5 * cam.blank.thickness + cam.cam.radius
        else:
            shift = -0.5 * cam.blank.thickness - cam.cam.radius if cam.blank.kind == "rib" else 0.0
        point = point + np.array([0.0, 0.0, shift])

        def ground(x, theta, into):
            c, s = np.cos(theta), into * cam.cam.turn * np.sin(theta)
            return np.stack([c * x[:, 0] + s * x[:, 1], -s * x[:, 0] + c * x[:, 1], x[:, 2]], axis=-1)

        def moved(x, theta, by, mount=mount):
            """The follower's body from the coordinate at theta to that at theta + by, ground axes."""
            change = cam.law(theta + by)[0] - cam.law(theta)[0]
            if isinstance(mount, Barrel):
                return x + np.stack([0 * change, 0 * change, change], axis=-1)
            if isinstance(mount, BarrelArm):
                (p, q), i, j = mount.pivot, 1, 2
            else:
                (p, q), i, j = (mount.distance, 0.0), 0, 2
            w = ((x[:, i] - p) + 1j * (x[:, j] - q)) * np.exp(-1j * change)
            y = x.copy()
            y[:, i], y[:, j] = p + w.real, q + w.imag
            return y

        at = ground(point, angle, -1)
        ahead, back = (ground(moved(at, angle, by), angle + by, 1) for by in (h, -h))
        slip = (ahead - back) / (2 * h)
        out[side] = point, normal, a, slip
    return out


@pytest.mark.parametrize("name", ["cam-barrel", "cam-barrel-rib", "cam-end", "cam-barrel-arm", "cam-globoid"])
def test_friction_of_a_roller_in_space_turns_the_shaft(name):
    """Coulomb's law of the roller on its pin and on its flank, statics of the follower, moment about the shaft: all in space."""
    motion, forces = solved(rubbing(name))
    (cam,) = placed_cams(motion)
    angle, rate = cam.argument(motion), cam.sense * motion.coordinate("O")[:, 1]
    mount, share = cam.cam.mount, PIN / cam.cam.radius
    load = solved(rubbing(name).replace('"friction", ', ""))[1].effort("O") * rate  # power that the follower takes
    torque, sides = np.full(motion.frames, np.nan), in_space(cam, angle)
    q1 = cam.law(angle)[1]
    moving = np.abs(q1) > 1e-6
    for side, (point, n, a, slip) in sides.items():
        if side < 0 and not cam.form_closed:
            continue
        t = np.cross(a, n)
        rolls, slides = (np.einsum("fi,fi->f", slip, d) * rate for d in (t, a))
        big = 1e-9 * np.abs(rolls).max()
        push = -MU * (
            share * np.sign(rolls)[:, None] * t
            + np.sqrt(1.0 - share**2) * np.where(np.abs(slides) > big, np.sign(slides), 0.0)[:, None] * a
        )
        per_newton = n + push  # on the follower
        turning = cam.cam.turn * (point[:, 0] * per_newton[:, 1] - point[:, 1] * per_newton[:, 0])  # by the follower's way
        c, s = np.cos(angle), -cam.cam.turn * np.sin(angle)  # into ground axes
        fixed = np.stack([c * point[:, 0] + s * point[:, 1], -s * point[:, 0] + c * point[:, 1], point[:, 2]], axis=-1)
        onto = np.stack(
            [c * per_newton[:, 0] + s * per_newton[:, 1], -s * per_newton[:, 0] + c * per_newton[:, 1], per_newton[:, 2]], axis=-1
        )
        if isinstance(mount, Barrel):
            lifts = onto[:, 2]
        else:
            (p, q), i = (mount.pivot, 1) if isinstance(mount, BarrelArm) else ((mount.distance, 0.0), 0)
            lifts = (fixed[:, 2] - q) * onto[:, i] - (fixed[:, i] - p) * onto[:, 2]
        force = np.divide(load, rate * q1 * lifts, out=np.full_like(load, np.nan), where=moving)
        mine = (force > 0.0) & moving
        torque[mine] = (force * turning)[mine]
    known = np.isfinite(torque)
    assert known.mean() > 0.55
    if name != "cam-barrel-rib":  # how fast the roller turns on its pin, by the way of its axis over the cam
        carried = motion.velocity(cam.links[1])[:, 2] if cam.blank.kind != "globoid" else 0.0
        turns = np.abs(roller_speed(motion, cam, contact_force(forces, cam)) - carried)[known]
        np.testing.assert_allclose(np.abs(forces.friction.elements[0].rate)[known], cam.cam.radius * turns, rtol=1e-12)
    np.testing.assert_allclose(cam.sense * forces.effort("O")[known], torque[known], atol=1e-6 * np.abs(torque[known]).max())
    assert np.abs(forces.power_balance).max() < 1e-12 and forces.friction.losses("K").min() > -1e-15


def test_a_barrel_cam_is_a_screw():
    """Torque = load * radius * tan(alpha + phi), tan(phi) = mu pin / roller, and what the roller's sliding along its axis adds."""
    load = '[loads]\nweight = { force = [0, "-40 N"], on = "carriage", at = "E" }\n'
    text = rubbing("cam-barrel").replace('"inertia"', "").replace(", ]", "]") + load
    motion, forces = solved(text)
    (cam,) = placed_cams(motion)
    s1 = cam.law(cam.argument(motion))[1]
    alpha, share = np.arctan(s1 / cam.middle), PIN / cam.cam.radius
    phi = np.arctan(MU * share)
    normal = 40.0 * np.cos(phi) / np.cos(alpha + phi)
    along = MU * np.sqrt(1.0 - share**2) * normal * cam.cam.radius * np.abs(np.sin(alpha))
    np.testing.assert_allclose(forces.effort("O"), 40.0 * cam.middle * np.tan(alpha + phi) + along, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(contact_force(forces, cam), normal, rtol=1e-12)
    side = forces.reaction("S")  # the guide: lateral force of the roller, and its moment about the guide's point
    lateral = 40.0 * np.tan(alpha + phi)
    np.testing.assert_allclose(side[:, 0], -lateral, rtol=1e-10, atol=1e-12)
    drawn = forces.reaction("O")  # the shaft's bearings: the same in the plane, and what the distance of the roller makes of it
    np.testing.assert_allclose(drawn[:, 0], lateral, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(drawn[:, 1], 40.0, rtol=1e-10)


@pytest.mark.parametrize("mu", [0.2, 0.4])
def test_the_carriage_of_a_barrel_cam_jams_in_its_guide(mu):
    """tan(alpha) = b / (mu (2 a + b)) on the rise, overhang a from the roller's axis to the nearer end of the guide."""
    load = '[loads]\nweight = { force = [0, "-40 N"], on = "carriage", at = "E" }\n'
    text = text_of("cam-barrel").replace('"inertia"', "").replace(", ]", "]") + load
    text = text.replace(
        "along = [0, 1]\n", f'along = [0, 1]\nfriction = {{ coefficient = {mu}, length = 40, bearing = "guide" }}\n'
    )
    motion, forces = solved(text, 720)
    (cam,) = placed_cams(motion)
    rows, rate = cam.rows(motion), cam.law(cam.argument(motion))[1]
    limit = np.arctan2(0.040, mu * (2.0 * (0.105 - 0.020 - rows.coordinate) + 0.040))  # tan a = b / (mu (2 a + b))
    rising, clear = rate > 1e-6, np.abs(rows.pressure_angle - limit) > 1e-6
    jams = (rows.pressure_angle > limit) & rising
    assert jams.any() == (mu == 0.4)
    np.testing.assert_array_equal(forces.friction.jammed[rising & clear], jams[rising & clear])


@pytest.mark.parametrize(
    "name", ["cam-yoke", "cam-groove", "cam-conjugate", "cam-conjugate-oscillating", "cam-inverse", "cam-inverse-slide"]
)
def test_the_side_that_carries_is_the_side_that_rubs(name):
    """Loss = force times sliding: of a yoke omega times the distance of the carrying face from the axis, of a groove the way of
    the roller over the cam less its radius on the inner flank, and more by it on the outer."""
    flat = name == "cam-yoke"
    motion, forces = solved(rubbing(name, "{ coefficient = 0.1 }" if flat else None))
    (cam,) = placed_cams(motion)
    drive = motion.mechanism.drives[0].joint
    force, speed = contact_force(forces, cam), motion.coordinate(drive)[:, 1]
    assert np.abs(forces.power_balance).max() < 1e-12
    assert (force > 0.0).sum() > 20 and (force < 0.0).sum() > 20
    angle = cam.argument(motion)
    if flat:
        there, across = (cam.cam.law(a, 0)[0] for a in (angle, angle + np.pi))
        expected = 0.1 * np.abs(force * speed) * np.where(force > 0.0, there, across)
    elif name == "cam-groove":
        way = np.hypot(*_pitch_rate(cam, angle))
        expected = MU * PIN / cam.face.radius * np.abs(force * speed) * (way - np.sign(force) * cam.face.radius)
    else:  # the shaft's work: what friction takes is what the shaft gives more than without it
        free = solved(rubbing(name, "{ coefficient = 0.1 }" if flat else None).replace('"friction", ', ""))[1]
        expected = (forces.effort(drive) - free.effort(drive)) * speed
    shares = forces.friction.losses("K")
    np.testing.assert_allclose(shares, expected, atol=2e-9 * shares.max())


def _pitch_rate(cam, angle, h=1e-6):
    """Way of the roller's centre over the cam per angle, by differences of where it is in the cam's axes."""
    e = cam.offset
    ends = [np.exp(-1j * cam.cam.turn * a) * (e + 1j * cam.cam.law(a, 0)[0]) for a in (angle + h, angle - h)]
    d = (ends[0] - ends[1]) / (2.0 * h)
    return d.real, d.imag


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("{ coefficient = 0.1 }", ["joints.K.friction", "'radius' is missing", "rubs on its pin"]),
        ("{ coefficient = 0.1, radius = 8 }", ["joints.K.friction.radius", "not thinner than its roller"]),
    ],
)
def test_faults_of_friction_at_barrel_cams(table, words):
    refused(rubbing("cam-barrel", table), words)
