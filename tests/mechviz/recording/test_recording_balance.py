"""Balance of links without mass in recordings: about their reference points the moments of heavy loads are a sum of large terms."""

from __future__ import annotations

import numpy as np
import pytest

import mechviz
from mechviz.outputs.inspection import format_inspection, inspect
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.quantities.tables import without_noise
from mechviz.quantities.vectors import centre_name
from mechviz.runs import run_scene
from recordings import place

SCISSOR = mechviz.load("scissor-lift").text

EXCAVATOR = """
units = { length = "m", angle = "deg" }

[links]
frame  = { points = { O = [0, 0], P = [0.55, -0.35] } }
boom   = { points = { O = [0, 0], Q = [2.3, 0.95], U = [2.6, 1.45], S = [5.2, 0] } }
stick  = { points = { S = [0, 0], V = [-0.75, 0.2], T = [2.7, 0] } }

[joints]
O  = { revolute = ["frame", "boom"] }
S  = { revolute = ["boom", "stick"] }

[joints.C1]
cylinder = ["frame", "boom"]
at = ["P", "Q"]
side = "left"
drive = { oscillation = { centre = 2.35, amplitude = 0.3, period = "8 s" } }

[joints.C2]
cylinder = ["boom", "stick"]
at = ["U", "V"]
side = "left"
drive = { oscillation = { centre = 2.85, amplitude = 0.4, period = "8 s", phase = 90 } }

[loads]
F = { force = ["3 kN", "-20 kN"], on = "stick", at = "T" }
"""

CLAMP = """
units = { length = "mm", angle = "deg" }

[links]
frame = { points = { O = [0, 0], P = [-180, 20], G = [120, 0] } }
lever = { points = { O = [0, 0], B = [0, 60] } }
strut = { points = { B = [0, 0], C = [85, 0] } }
jaw   = { points = { C = [0, 0] } }

[joints]
O = { revolute = ["frame", "lever"] }
B = { revolute = ["lever", "strut"] }
C = { revolute = ["strut", "jaw"] }
S = { prismatic = ["frame", "jaw"], at = ["G", "C"], along = [1, 0], branch = "ahead" }

[joints.Z]
cylinder = ["frame", "lever"]
at = ["P", "B"]
side = "left"
drive = { oscillation = { centre = 190, amplitude = 12, period = "3 s" } }

[loads]
Q = { force = ["-12 kN", 0], on = "jaw" }
"""

PRESS = """
units = { length = "mm", angle = "deg" }
effects = ["inertia", "gravity"]

[links]
frame = { points = { A = [0, 0], F = [300, -40] } }
crank = { points = { A = [0, 0], B = [60, 0] } }
rod   = { points = { B = [0, 0], C = [260, 0] } }
upper = { points = { F = [0, 0], C = [200, 0] } }
lower = { points = { C = [0, 0], D = [200, 0] } }
ram   = { points = { D = [0, 0] }, mass = "80 kg" }

[joints]
A = { revolute = ["frame", "crank"], drive = { speed = "60 rpm" } }
B = { revolute = ["crank", "rod"] }
C = { revolute = ["rod", "upper"], side = "right" }
F = { revolute = ["frame", "upper"] }
C2 = { revolute = ["rod", "lower"], at = "C" }
D = { revolute = ["lower", "ram"] }
S = { prismatic = ["frame", "ram"], at = ["F", "D"], along = [0, -1], branch = "ahead" }

[loads]
Q = { force = [0, "120 kN"], on = "ram" }
"""

PISTON = """
units = { length = "mm", angle = "deg" }
effects = ["inertia", "gravity"]

[links]
frame = { points = { O = [0, 0], G = [0, 37] } }
crank = { points = { O = [13, 7], B = [63, 7] } }
rod = { points = { B = [5, 5], C = [185, 5] } }
piston = { points = { C = [11, 3] }, mass = "2 kg" }

[joints]
O = { revolute = ["frame", "crank"], drive = { speed = "60 rpm" } }
B = { revolute = ["crank", "rod"] }
C = { revolute = ["rod", "piston"] }
S = { prismatic = ["frame", "piston"], at = ["G", "C"], along = [1, 0.3], branch = "ahead" }

[loads]
Q = { force = ["-80 kN", "10 kN"], on = "piston" }
"""

SCENES = {"scissor": SCISSOR, "excavator": EXCAVATOR, "clamp": CLAMP, "press": PRESS, "piston": PISTON}
WITHOUT_MASS = {
    "scissor": ["arm", "cross", "platform", "Z.barrel", "Z.rod"],
    "excavator": ["boom", "stick", "C1.barrel", "C1.rod", "C2.barrel", "C2.rod"],
    "clamp": ["lever", "strut", "jaw", "Z.barrel", "Z.rod"],
    "press": ["crank", "rod", "upper", "lower"],
    "piston": ["crank", "rod"],
}


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("heavy")
    result = {}
    for name, text in SCENES.items():
        run = run_scene(mechviz.loads(text), frames=24)
        result[name] = Recording(write_recording(run, folder / f"{name}.rrd").path)
    return result


@pytest.mark.parametrize("name", SCENES)
def test_links_without_mass_balance_about_a_point_beside_their_joints(recordings, name):
    recording = recordings[name]
    model = recording.model
    assert set(WITHOUT_MASS[name]) <= set(model["links"])

    def data(*parts):
        return recording.scalars("data", *parts)[1]

    for link in WITHOUT_MASS[name]:
        mass, x, y, inertia = recording.static("data", "links", link, "properties")
        assert mass == 0.0 and inertia == 0.0
        centre = place(data("links", link, "pose"), (x, y))
        terms = []
        for joint, about in model["joints"].items():
            for side, sign in zip(about["links"], (-1.0, 1.0), strict=True):
                if side == link:
                    wrenches = [data("joints", joint, "reaction")]
                    wrenches += [data("drive", joint, "wrench")] if joint in model["drives"] else []
                    terms += [(sign * w, data("joints", joint, "position")) for w in wrenches]
        for load, about in model["loads"].items():
            if link in about["links"]:
                parts = load.split("/")
                values = data("loads", *parts)
                terms.append((values[:, :3], values[:, 3:]))
        moments = []
        for wrench, at in terms:
            arm = at - centre
            moments.append(wrench[:, 2] + arm[:, 0] * wrench[:, 1] - arm[:, 1] * wrench[:, 0])
        largest = abs(np.array(moments)).max()
        force = max(abs(w[:, :2]).max() for w, _ in terms)
        arms = max(np.hypot(*(at - centre).T).max() for _, at in terms)
        assert largest > 0.1 * force * arms, "moments are of the size of forces times lengths, not rounding"
        assert abs(sum(moments)).max() <= 1e-12 * largest


@pytest.mark.parametrize("name", SCENES)
def test_no_centre_of_mass_is_shown_where_there_is_no_mass(recordings, name):
    recording = recordings[name]
    for link in WITHOUT_MASS[name]:
        assert not recording.has("data", "links", link, "inertia")
        for family in ("position", "velocity", "acceleration"):
            assert not recording.has("data", "points", centre_name(link), family)
        assert not recording.has("vectors", "velocity", centre_name(link)) and not recording.has("vectors", "inertia", link)
    assert not recording.has("data", "links", recording.model["frame"], "properties")


def test_centres_of_mass_are_the_reference_points_where_there_is_mass(recordings):
    assert recordings["press"].has("data", "points", centre_name("ram"), "position")
    assert list(recordings["press"].static("data", "links", "ram", "properties")) == [80.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize(("name", "link"), [("press", "ram"), ("piston", "piston")])
def test_what_acts_at_the_centre_of_mass_has_no_moment_about_it(recordings, name, link):
    """Exactly none, as readers work out the centre from pose and properties: they cannot tell rounding from lack of balance."""
    recording = recordings[name]
    model = recording.model
    _, x, y, _ = recording.static("data", "links", link, "properties")
    centre = place(recording.scalars("data", "links", link, "pose")[1], (x, y))
    joints = [joint for joint, about in model["joints"].items() if link in about["links"]]
    assert len(joints) == 2
    for joint in joints:
        assert np.array_equal(recording.scalars("data", "joints", joint, "position")[1], centre)
        assert not recording.scalars("data", "joints", joint, "reaction")[1][:, 2].any()
    for load in ("Q", f"gravity/{link}"):
        values = recording.scalars("data", "loads", *load.split("/"))[1]
        assert np.array_equal(values[:, 3:], centre) and not values[:, 2].any()


def test_only_rounding_is_left_out():
    rows = np.array([[3.0, 4.0, 1e-12], [0.0, 1.0, -1e-13]])
    assert not without_noise(rows, 10.0)[:, 2].any() and np.array_equal(without_noise(rows, 1e-3), rows)
    assert np.isnan(without_noise(np.array([[1.0, 0.0, np.nan], [1.0, 0.0, 1e-15]]), 1.0)[0, 2])


def test_powers_of_forces_on_links_that_stand_still_are_rounding():
    """With the upper and the lower link equally long and folded over each other the ram never moves."""
    run = run_scene(mechviz.loads(PRESS.replace('side = "right"', 'side = "left"')), frames=60)
    assert abs(run.motion.velocity("ram")).max() < 1e-15 and abs(run.forces.reaction("D")).max() > 1e5
    assert abs(run.forces.power_balance).max() < 1e-9


def test_the_drive_of_a_rolling_wheel_is_a_force(tmp_path):
    scene = mechviz.loads("""
units = { length = "mm" }

[links]
frame = { points = { O = [0, 60] } }
wheel = { points = { C = [0, 0] } }

[joints.W]
rolling = ["frame", "wheel"]
at = ["O", "C"]
radius = 60
drive = { speed = 200, travel = 800 }

[loads]
Q = { force = ["-60 N", 0], on = "wheel" }
""")
    inspection = inspect(write_recording(run_scene(scene, frames=8), tmp_path / "wheel.rrd").path)
    assert (inspection.peaks[0].item, inspection.peaks[0].unit) == ("driving force W", "N")
    assert inspection.peaks[0].value == pytest.approx(60.0)


def test_inspection_tells_the_couple_of_a_weld(tmp_path):
    """A cantilever with a force across its end."""
    b = mechviz.SceneBuilder("cantilever", length="in", force="lbf", torque="lbf in")
    b.link("frame", O=(0, 0)).link("arm", O=(0, 0), P=(20, 0)).joint("O", "weld", "frame", "arm")
    b.force("F", (0, -3), on="arm", at="P")
    inspection = inspect(write_recording(run_scene(b.scene()), tmp_path / "arm.rrd").path)
    assert "couple O              60 lbf in" in format_inspection(inspection)


def test_an_infinite_reduced_mass_does_not_hide_the_other_peaks(tmp_path):
    """Infinity counted as the largest value of its unit, next to which all others were shown as zero."""
    scene = mechviz.loads("""
units = { length = "mm" }
effects = ["inertia"]
reduced = ["rod.C"]
shaking = {}
run = { frames = 12 }

[links]
frame = { points = { O = [0, 0] } }
crank = { points = { O = [0, 0], B = [40, 0] }, mass = 1, shape = "bar" }
rod = { points = { B = [0, 0], C = [150, 0] }, mass = 1, shape = "bar" }
piston = { points = { C = [0, 0] }, mass = 0.7 }

[joints]
O = { revolute = ["frame", "crank"], drive = { speed = "600 rpm" } }
B = { revolute = ["crank", "rod"] }
C = { revolute = ["rod", "piston"] }
S = { prismatic = ["frame", "piston"], at = ["O", "C"], branch = "ahead" }

[loads]
M = { torque = "-3 N m", on = "crank" }
""")
    path = write_recording(run_scene(scene), tmp_path / "engine.rrd").path
    inspection = inspect(path)
    largest = {peak.item: peak.value for peak in inspection.studies}
    assert largest["reduced mass rod.C.reduced"] == largest["reduced force rod.C.reduced"] * -1.0 == np.inf
    said = format_inspection(inspection)
    force = np.hypot(*Recording(path).scalars("data", "shaking")[1][:, :2].T).max()
    assert force > 100.0 and largest["force shaking"] == pytest.approx(force)
    assert f"{force:.5g} N" in next(line for line in said.splitlines() if "force shaking" in line)
