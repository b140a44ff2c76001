"""Derivatives by what moves a cam on: a linkage between the drive and the cam."""

from __future__ import annotations

import numpy as np
import pytest
from cases import side_by_side
from test_forced import SIXTH, differences

from mechviz.runs import run_scene
from mechviz.scene.scene import Scene, load, loads
from mechviz.studies.designs.measures import parse_measure
from mechviz.studies.designs.sensitivity import sensitivities
from mechviz.studies.designs.variables import variables_of

FRAMES = 23  # of which none has a knot of the law
DRAG_LINK = """
units = { length = "mm", angle = "deg" }
effects = ["inertia", "gravity"]
run = { frames = 23 }
[links]
frame = { points = { A = [-20, 0], O = [0, 0], G = [0, 95], W = [60, 120] } }
crank = { points = { A = [0, 0], B = [70, 0] }, mass = "0.2 kg", centre = "A", inertia = "1e-4 kg m^2" }
coupler = { points = { B = [0, 0], C = [60, 0] }, mass = "0.1 kg", centre = [25, 3], inertia = "1e-5 kg m^2" }
cam = { points = { O = [0, 0], C = [50, 0] }, mass = "1.1 kg", centre = [2, 1], inertia = "0.0012 kg m^2" }
[joints]
A = { revolute = ["frame", "crank"], drive = { speed = "100 rpm", start = 10 } }
B = { revolute = ["crank", "coupler"] }
C = { revolute = ["coupler", "cam"], side = "left" }
O = { revolute = ["frame", "cam"] }
"""
RISING = """
[links.follower]
points = { T = [0, 0] }
mass = "0.35 kg"
centre = [0, 45]
[joints.F]
prismatic = ["frame", "follower"]
at = ["G", "T"]
along = [0, 1]
"""
SWINGING = """
[links.follower]
points = { W = [0, 0], T = [-100, 0] }
mass = "0.35 kg"
centre = [-30, 0]
inertia = "1e-3 kg m^2"
[joints.F]
revolute = ["frame", "follower"]
at = ["W", "W"]
"""
CAM = """
[joints.K]
cam = ["cam", "follower"]
follower = {{ {face}, guide = "F", point = "T" }}
{closure}
[joints.K.profile]
base = {base}
lift = [
    {{ over = 117, to = {rise}, law = "cycloidal" }},
    {{ over = 61 }},
    {{ over = 122, to = 0, law = "3-4-5" }},
    {{ over = 60 }},
]
"""
OF_CAM = ["pressure_angle", "curvature", "contact_force", "lift", "lift_rate", "lift_acceleration"]
KEYS = ["joint.O.angle", "drive.A.torque", "joint.K.reaction", *(f"cam.K.{what}" for what in OF_CAM)]
KINDS = {
    "roller": RISING + CAM.format(face="roller = 10", closure="", base=38, rise=22),
    "groove": RISING + CAM.format(face="roller = 10", closure='closure = "form"', base=38, rise=22),
    "flat": RISING + CAM.format(face="flat = true", closure="", base=60, rise=12),
    "arm": SWINGING + CAM.format(face='roller = 10, side = "left"', closure="", base=60, rise=15),
}


def agree(scene: Scene, number: str, step: float, keys: list[str]) -> None:
    run = run_scene(scene)
    results = sensitivities(run, [parse_measure(scene, key) for key in keys], variables_of(scene, [number]))
    for one, wanted in zip(results, differences(scene, number, results, step, SIXTH, FRAMES), strict=True):
        size = max(np.abs(wanted).max(), 1e-4 * np.abs(one.curve).max())  # the pressure angle of a flat face stays
        np.testing.assert_allclose(one.slopes[0], wanted, atol=1e-9 * size, err_msg=one.quantity.key)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("kind", "number"),
    side_by_side(list(KINDS), ["links.crank.points.B[0]", "links.frame.points.A[0]", "links.frame.points.O[0]"]),
)
def test_a_drag_link_turns_a_cam_in_another_way(kind, number):
    agree(loads(DRAG_LINK + KINDS[kind], kind), number, 0.02, KEYS)


@pytest.mark.thorough
def test_a_drag_link_whose_crank_forces_move():
    text = (DRAG_LINK + KINDS["roller"]).replace("frames = 23", 'frames = 23, duration = "0.5 s", tolerance = 1e-13')
    text = text.replace('drive = { speed = "100 rpm", start = 10 }', 'free = { position = 10, speed = "100 rpm" }')
    text = text.replace("[joints.K.profile]", "liftoff = { restitution = 0.3 }\n[joints.K.profile]")
    scene = loads(text, "free")
    assert not run_scene(scene).simulation.events
    agree(scene, "links.crank.points.B[0]", 0.01, ["joint.A.angle", "joint.O.angle", "joint.K.reaction"])


WEDGE_LINKS = """
crank = { points = { A = [0, 0], Q = [75, 0] } }
rod = { points = { Q = [0, 0], P = [200, 0] }, mass = "0.2 kg", centre = [90, 0] }
[joints]
A = { revolute = ["frame", "crank"], drive = { speed = "60 rpm" } }
Q = { revolute = ["crank", "rod"] }
P = { revolute = ["rod", "slide"], at = ["P", "B"], branch = "ahead" }
"""


@pytest.mark.parametrize("number", ["links.crank.points.Q[0]", "links.frame.points.A[0]"])
def test_a_slider_crank_moves_a_wedge_in_another_way(number):
    head, _, rest = load("cam-wedge").source.partition("[joints.K]")
    head = head.replace("B = [0, 0], G", "A = [-130, 0], B = [0, 0], G").replace("[joints]", WEDGE_LINKS)
    drive = ", drive = { oscillation" + head.partition(", drive = { oscillation")[2].partition("\n")[0]
    text = f"run = {{ frames = {FRAMES} }}\n" + head.replace(drive, " }") + "[joints.K]" + rest
    agree(loads(text, "wedge"), number, 0.02, ["joint.B.displacement", "drive.A.torque", "cam.K.pressure_angle", "cam.K.lift_rate"])


LIMITS = ["cam.K.pressure_angle", "cam.K.curvature", "cam.K.contact_force", "cam.K.contact_normal_force"]


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    "name, spacing",
    [
        ("cam-conjugate", 0.1),
        ("cam-conjugate-oscillating", 0.1),
        ("cam-groove", 0.1),
        ("cam-measured", 0.02),
        ("cam-barrel-arm", 0.1),
        ("cam-indexing", 0.1),  # on a globoid; it rubs
    ],
)
def test_a_cam_that_is_further_on_is_as_a_little_later(name, spacing):
    """At an even speed a start of one degree more is the same as the time of one degree later: by differences of eighth order
    between the frames of one run, wherever they reach over no knot of the law."""
    frames = round(360.0 / spacing)
    scene = load(name).changed({("run", "frames"): frames, ("joints", "O", "drive", "start"): 3.305})
    run = run_scene(scene)
    (cam,) = (r.geometry for r in run.motion.model.relations if r.geometry is not None)
    segment, middle = cam.segment(run.motion), np.arange(4, frames - 3)
    within = middle[segment[middle - 4] == segment[middle + 4]]
    assert len(within) > 0.9 * frames
    measures = [parse_measure(scene, key) for key in ("drive.O.torque", "joint.K.reaction", *LIMITS)]
    for one in sensitivities(run, measures, variables_of(scene, ["joints.O.drive.start"])):
        ahead = [
            sum(w * s * one.curve[within + s * k] for s in (1, -1)) for k, w in enumerate((4 / 5, -1 / 5, 4 / 105, -1 / 280), 1)
        ]
        wanted = sum(ahead) / spacing
        size = max(np.abs(wanted).max(), 1e-3 * np.abs(one.curve).max())
        np.testing.assert_allclose(one.slopes[0, within], wanted, atol=1e-9 * size, err_msg=one.quantity.key)


@pytest.mark.parametrize("name, joint", [("cam-inverse", "O"), ("cam-inverse-slide", "S")])  # the latter rubs
def test_inverse_cams_may_swing_farther(name, joint):
    scene = load(name).changed({("run", "frames"): FRAMES})
    effort = "torque" if joint == "O" else "force"
    keys = [f"drive.{joint}.{effort}", "joint.K.reaction", *LIMITS]
    agree(scene, f"joints.{joint}.drive.oscillation.amplitude", 0.01, keys)


TURNED = """
[links.shaft]
points = { O = [0, 0] }
[joints]
O = { revolute = ["frame", "shaft"], drive = { speed = "240 rpm" } }
W = { weld = ["shaft", "cam"], at = ["O", "O"], angle = 21.7 }
"""


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("cam-roller", "phase"),
        ("cam-indexing", "phase"),
        ("cam-wedge", "phase"),
        ("cam-conjugate", "phase"),
        ("cam-roller", "weld"),
    ],
)
def test_a_cam_s_phase_moves_its_follower(name, number):
    """Also that of a cam which is fixed on its shaft at another angle."""
    place = ("joints", "K", "profile", "phase")
    scene = load(name).changed({("run", "frames"): FRAMES} | ({place: 3.3} if number == "phase" else {}))
    if number == "weld":
        head, _, tail = scene.to_toml().partition("[joints.O]")
        scene = loads(head + TURNED + tail[tail.index("\n[") :], "welded")
    effort = "drive.B.force" if name == "cam-wedge" else "drive.O.torque"
    follower = "joint.P.angle" if name == "cam-indexing" else "joint.S.displacement"
    agree(scene, "joints.W.angle" if number == "weld" else ".".join(place), 0.02, [follower, effort, *LIMITS])


STARTS = {("joints", "K", "profile", "phase"): 0.0, ("joints", "O", "drive", "start"): 0.0}


def test_a_frame_on_a_knot_stays_on_its_side_as_the_phase_changes():
    """At an even speed a phase of one degree more is a start of one degree more, but for the weight and inertia of the cam."""
    scene = load("cam-roller").changed({("run", "frames"): 24, ("links", "cam", "centre"): "O"} | STARTS)  # every 15 degrees
    measures = [parse_measure(scene, key) for key in ("joint.S.acceleration", "drive.O.torque", *LIMITS)]
    for one in sensitivities(run_scene(scene), measures, variables_of(scene, ["joints.K.profile.phase", "joints.O.drive.start"])):
        np.testing.assert_allclose(*one.slopes, rtol=1e-9, atol=1e-9 * np.abs(one.slopes).max(), err_msg=one.quantity.key)
