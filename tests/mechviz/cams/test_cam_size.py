"""Least base circles in scenes, and the sizes that ``mechviz cams --size`` tells, against the scene solved again with them."""

from __future__ import annotations

import re

import numpy as np
import pytest
from cam_scenes import text_of
from design_cases import design_case
from typer.testing import CliRunner

import mechviz
from mechcore.cams.closures import hertz, roller_range
from mechcore.cams.limits import Requirement, find_limits
from mechcore.errors import MechanismError
from mechcore.forces.cam_events import cam_events
from mechcore.forces.cam_rating import contact_stress, joint_of, placed_cams
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechviz.commands.main import app
from mechviz.runs import run_scene
from mechviz.studies.cam_report import cam_facts, size_lines

LEAST = {
    "cam-roller-offset": 'base = "least"\ncurvature_limit = 60\npressure_limit = 30',
    "cam-flat": 'base = "least"\ncurvature_limit = 9',
    "cam-oscillating-roller": 'base = "least"\npressure_limit = 33\nhub = 5',
}


def with_profile(name: str, lines: str) -> mechviz.Scene:
    text = re.sub(r"(?m)^pressure_limit.*\n", "", text_of(name))
    return mechviz.loads(re.sub(r"(?m)^base = .*$", lines, text))


def placed(scene: mechviz.Scene):
    motion = solve_motion(compile_mechanism(scene.mechanism), default_times(scene.mechanism, 36, 1))
    return placed_cams(motion)[0]


@pytest.mark.parametrize("name", LEAST)
def test_the_least_base_circle_of_a_scene_keeps_its_limits_and_less_does_not(name):
    cam = placed(with_profile(name, LEAST[name]))
    limits, scale = find_limits(cam.cam), 1.0 + 1e-6
    angle, radius = cam.pressure_limit, cam.curvature_limit
    worst = max(limits.rise.value, limits.fall.value)
    slack = [] if angle is None else [angle * scale - worst]
    slack += [] if radius is None else [limits.convex.value * scale - radius]
    assert min(slack) >= 0.0
    assert cam.decides in ("pressure angle on the rise", "pressure angle on the return", "least radius of curvature")
    keys = LEAST[name].replace('"least"', f'"{cam.base * 1e3 * 0.999} mm"').replace("\nhub = 5", "")
    smaller = find_limits(placed(with_profile(name, keys)).cam)
    worst = max(smaller.rise.value, smaller.fall.value)
    assert (angle is not None and worst > angle) or (radius is not None and smaller.convex.value < radius)


def traced(scene: mechviz.Scene, *points: str, frames: int = 7200) -> list[tuple[float, float, float]]:
    """Of the paths of points of the follower over the turning cam, by differences: largest pressure angle, least radii of curvature
    where they bend around the cam's axis and away from it."""
    motion = solve_motion(compile_mechanism(scene.mechanism), default_times(scene.mechanism, frames, 1))
    cam, follower = next(p for p in scene.mechanism.joints if p.name == "K").links
    turned, out = np.exp(1j * motion.pose(cam)[:, 2]), []
    for point in points:
        world = motion.point(follower, point) @ [1.0, 1j]
        steps = np.diff(world / turned)
        before, after = steps[:-1], steps[1:]
        bent = np.angle(after / before) / (0.5 * np.abs(before + after))
        centre = motion.point(follower, "P") @ [1.0, 1j] if "P" in scene.mechanism.links[2].points else world - 1.0
        off = np.angle(1j * (before + after) * turned[1:-1] / (1j * (world - centre)[1:-1]))
        radii = (1.0 / np.abs(part).max(initial=1e-9) for part in (bent[bent < 0.0], bent[bent > 0.0]))
        out.append((np.abs(0.5 * np.pi - np.abs(np.abs(off) - 0.5 * np.pi)).max(), *radii))
    return out


def pair(second: str, base: str = "52", limits: str = "pressure_limit = 30") -> mechviz.Scene:
    """Conjugate cams with a rocker whose second roller stands elsewhere."""
    text = text_of("cam-conjugate-oscillating").replace("R = [-58, -68]", f"R = {second}")
    return mechviz.loads(text.replace("base = 52", f"base = {base}\n{limits}"))


def test_limits_hold_for_both_cams_of_a_conjugate_pair():
    scene = pair("[-30, -62]", limits="pressure_limit = 30\ncurvature_limit = 30")
    (first, *_), (second, radius, _) = traced(scene, "T", "R")
    assert np.degrees(first) < 26.0 and np.degrees(second) == pytest.approx(55.47, abs=0.01)
    run = run_scene(scene)
    facts = {fact.what: fact for fact in cam_facts(run.motion, run.forces)}
    assert facts["pressure angle"].failed and "second cam up to 55.468" in str(facts["pressure angle"].text)
    assert facts["curvature"].failed and f"{1e3 * radius - 10.0:.4g} mm (second cam)" in str(facts["curvature"].text)
    assert any("pressure angle of the second cam up to 55.47" in e.text for e in cam_events(run.motion, None))


def test_the_least_base_circle_of_a_conjugate_pair_keeps_the_second_cam_to_the_limits():
    scene = pair("[-70, -50]", '"least"')
    cam = placed(scene)
    assert cam.decides == "pressure angle on the rise of the other profile"
    reached = [traced(pair("[-70, -50]", f"{1e3 * cam.base * scale}"), "T", "R") for scale in (1.0, 0.99)]
    assert np.degrees(reached[0][0][0]) < 29.0 and np.degrees(reached[0][1][0]) == pytest.approx(30.0, abs=1e-3)
    assert np.degrees(reached[1][1][0]) > 30.1
    run = run_scene(pair("[-58, -68]", '"least"'), frames=36)
    lines = size_lines(run.motion, None, run.scene.units, Requirement())
    assert any(f"{1e3 * placed_cams(run.motion)[0].base:.6g} mm now, least" in line for line in lines)


def test_a_pair_without_a_base_circle_for_both_cams_is_refused():
    """The larger the first cam, the smaller the second: at the least base circle of the first the second is too steep already."""
    with pytest.raises(MechanismError, match=r"no base circle keeps both profiles .* the other reaches 31.29") as error:
        compile_mechanism(pair("[-30, -62]", '"least"', "pressure_limit = 30\ncurvature_limit = 30").mechanism)
    assert error.value.faults[0].path == "joints.K.base"
    (_, (steep, *_)) = traced(pair("[-30, -62]", "30"), "T", "R")
    assert np.degrees(steep) == pytest.approx(31.29, abs=0.005)


def test_the_least_base_circle_of_a_groove_keeps_its_outer_flank_to_the_limits():
    """Where the roller's path bends away from the axis the outer flank is convex, with the path's radius less the roller's."""
    text = text_of("cam-groove").replace("over = 120", "over = 70").replace("over = 60", "over = 110")
    scene = mechviz.loads(text.replace("base = 35", 'base = "least"\ncurvature_limit = 8'))
    cam = placed(scene)
    assert cam.decides == "least radius of curvature of the other profile"
    ((_, inner, outer),) = traced(scene, "T")
    assert 1e3 * outer - 8.0 == pytest.approx(8.0, rel=1e-4) and 1e3 * inner - 8.0 > 9.0


def sized(base: str, roller: str, offset: str = "", place: float = 14.0) -> str:
    """The offset roller follower with sizes of its cam; `place`: of the guide across the cam's axis."""
    text = text_of("cam-roller-offset").replace("base = 38", f"base = {base}").replace("[14, 95]", f"[{place}, 95]")
    rating = 'rating = { width = 8, limit = "300 MPa" }'
    return text.replace("roller = 10,", f"roller = {roller}, {offset}").replace("[joints.K.pro", f"{rating}\n[joints.K.pro")


def worst_stress(text: str) -> float:
    run = run_scene(mechviz.loads(text), frames=3600)
    cam = placed_cams(run.motion)[0]
    return float(np.nanmax(contact_stress(run.forces, cam, joint_of(run.motion, cam).rating).pressure))


def test_the_least_roller_of_a_scene_just_keeps_to_the_hertz_pressure():
    roller = placed(mechviz.loads(sized("38", '"least"'))).face.radius * 1e3
    assert worst_stress(sized("38", f"{roller}")) == pytest.approx(300e6, rel=2e-6)
    assert worst_stress(sized("38", f"{0.99 * roller}")) > 300.5e6


def test_the_offset_of_a_scene_s_least_base_circle_and_its_roller_hold_when_they_are_typed():
    computed = placed(mechviz.loads(sized('"least"', '"least"', 'offset = "least",')))
    roller, offset = 1e3 * computed.face.radius, 1e3 * computed.offset
    bases = [placed(mechviz.loads(sized('"least"', f"{roller}", place=offset + shift))).base for shift in (-0.5, 0.0, 0.5)]
    assert bases[1] == pytest.approx(computed.base, rel=1e-9)
    assert min(bases[0], bases[2]) > computed.base * 1.001
    assert worst_stress(sized(f"{1e3 * computed.base}", f"{roller}", place=offset)) == pytest.approx(300e6, rel=2e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("roller = 10,", 'roller = "least",'), "for which Hertz pressure"),
        (("roller = 10,", 'roller = 10, offset = "least",'), "of which base circle"),
        (("roller = 10,", 'roller = "least", offset = "most",'), "joints.K.follower.offset"),
    ],
)
def test_faults_of_followers_that_are_to_be_the_least(change, words):
    with pytest.raises(MechanismError, match=words):
        mechviz.loads(text_of("cam-roller-offset").replace(*change))


def test_no_roller_is_the_least_where_nothing_presses_it_or_none_does():
    text = sized("38", '"least"')
    with pytest.raises(
        MechanismError, match=r"joints.K.follower.roller +no roller on this cam keeps to a Hertz pressure of 20 MPa"
    ):
        mechviz.loads(text.replace("300 MPa", "20 MPa"))
    with pytest.raises(MechanismError, match="no force presses this follower"):
        mechviz.loads(re.sub(r"(?s)\[loads\].*", "", text).replace('effects = ["inertia", "gravity"]', "effects = []"))


@pytest.mark.thorough
def test_a_roller_is_the_least_for_the_forces_of_a_shaft_that_runs_freely():
    """Inertia and the spring let the shaft's speed swing, in its own way with each roller; at a prescribed speed it is another."""
    text = sized("38", '"least"').replace('drive = { speed = "200 rpm" }', 'free = { speed = "200 rpm" }')
    text = text.replace("[joints.K]", "[joints.K]\nliftoff = { restitution = 0.2 }") + '\n[run]\nduration = "0.15 s"\n'
    joint = next(j for j in mechviz.loads(text).mechanism.joints if j.name == "K")
    roller = 1e3 * joint.face.radius
    run = run_scene(mechviz.loads(text.replace('"least"', repr(roller))), frames=1500)
    assert np.ptp(run.motion.coordinate("O")[:, 1]) > 2.0
    ((_, forces),) = run.forces.parts
    worst = np.nanmax(contact_stress(forces, placed_cams(forces.motion)[0], joint.rating).pressure)
    assert worst == pytest.approx(300e6, rel=1e-4)
    assert placed(mechviz.loads(sized("38", '"least"'))).face.radius * 1e3 != pytest.approx(roller, rel=1e-3)


def test_no_roller_is_the_least_where_it_lands_on_its_cam():
    text = text_of("valve-float").replace("flat = true", 'roller = "least"').replace(", face = [20, 20] }", " }")
    with pytest.raises(MechanismError, match=r"(?s)follower.roller.*lands on its cam with an impact.*--size"):
        mechviz.loads(text.replace("liftoff =", 'rating = { width = 8, limit = "1500 MPa" }\nliftoff ='))


def test_check_says_which_sizes_it_found(tmp_path):
    path = tmp_path / "cam.toml"
    path.write_text(sized('"least"', '"least"', 'offset = "least",'))
    out = CliRunner().invoke(app, ["check", str(path)]).output
    assert "K: offset 2.45916 mm, with which the base circle is least" in out
    assert "the least for a Hertz pressure of 300 MPa; decided at" in out


def test_sizes_are_told_and_hold_when_the_scene_has_them():
    """The told base circle, typed into the scene, just reaches the limit; so does the told roller on the same pitch curve."""
    text = text_of("cam-roller")
    scene = mechviz.loads(text)
    run = run_scene(scene, frames=360)
    lines = " ".join(size_lines(run.motion, run.forces, scene.units, Requirement(pressure_rise=0.3, pressure_fall=0.3)))
    base = float(re.search(r"base circle\s+\S+ mm now, least (\S+) mm", lines)[1])
    limits = find_limits(placed(mechviz.loads(re.sub(r"base = \d+", f"base = {base}", text, count=1))).cam)
    assert max(limits.rise.value, limits.fall.value) == pytest.approx(0.3, rel=1e-5)
    roller = float(re.search(r"least (\S+) mm for a Hertz pressure of 300 MPa", lines)[1])
    now = placed_cams(run.motion)[0]
    sized = re.sub(r"roller = \S+,", f"roller = {roller},", re.sub(
        r"base = \d+", f"base = {1e3 * (now.base + now.face.radius) - roller}", text, count=1), count=1)  # fmt: skip
    again = run_scene(mechviz.loads(sized), frames=360)
    cam = placed_cams(again.motion)[0]
    pressure = contact_stress(again.forces, cam, joint_of(again.motion, cam).rating).pressure
    assert np.nanmax(pressure) == pytest.approx(300e6, rel=1e-5)


def test_roller_range_against_a_search():
    rng = np.random.default_rng(3)
    force, rho = rng.uniform(10, 200, 40), rng.choice([1, -1], 40) * rng.uniform(0.03, 0.2, 40)
    low, high = roller_range(force, rho, 0.008, 8e8)
    radii = np.linspace(1e-4, 0.05, 5000)
    fits = [np.all((rho < 0) | (rho > r)) and np.max(hertz(force, rho - r, r, 0.008).pressure) <= 8e8 for r in radii]
    assert radii[np.argmax(fits)] == pytest.approx(low, abs=2e-5)
    assert radii[len(fits) - 1 - np.argmax(fits[::-1])] == pytest.approx(high, abs=2e-5)
    assert roller_range(force, rho / 100, 0.008, 8e8)[0] == np.inf


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ('base = "least"', "for which limit"),
        ("base = 30\nhub = 8", "hub goes with"),
        ('base = "most"', "joints.K.profile.base"),
        ('base = "least"\ncurvature_limit = "3 deg"', "joints.K.profile.curvature_limit"),
        ('base = "least"\npressure_limit = 20\nbed = "S"', "is for discs"),
    ],
)
def test_faults_of_sizes(lines, words):
    with pytest.raises(MechanismError) as error:
        with_profile("cam-roller-offset", lines)
    assert words in str(error.value)


def test_the_command_tells_sizes():
    out = (
        CliRunner().invoke(app, ["cams", "cam-oscillating-roller", "--size", "--pressure-angle", "36 deg", "--frames", "60"]).output
    )
    assert "pressure angles up to 36°" in out
    assert "base circle  38 mm now, least" in out


def test_the_graphical_method_tells_what_the_lecture_s_offset_profile_costs():
    """0.970432 mm for R = 40, lift 20, m = 10 mm, by the reference's bisection; the knife at 0 deg stands on the near side."""
    out = CliRunner().invoke(app, ["cams", "cam-constant-acceleration", "--method", "graphical", "--frames", "36"]).output
    assert "misses its lift by up to 0.9704 mm" in out
    assert re.search(r"(?m)^ +0\.00 +-?0\.0000 ", out)


ARM = """units = { length = "m" }
[links]
frame = { points = { A = [0, 0], X = [0, 0] } }
upper = { points = { A = [0, 0], B = [0.25, 0] } }
fore = { points = { B = [0, 0], P = [0.22, 0] } }
carriage = { points = { X = [0, 0] } }
pen = { points = { P = [0, 0] } }
[joints]
A = { revolute = ["frame", "upper"] }
B = { revolute = ["upper", "fore"], side = "right" }
P = { revolute = ["fore", "pen"] }
[joints.X]
prismatic = ["frame", "carriage"]
along = [1, 0]
drive = { start = 0.05, segments = [{ duration = "1 s", to = 0.2, law = "3-4-5" }] }
[joints.Y]
prismatic = ["carriage", "pen"]
at = ["X", "P"]
along = [0, 1]
drive = { start = 0.25, segments = [{ duration = "1 s", to = 0.2, law = "3-4-5" }] }
[run]
frames = 120
"""


ARM_CAM = """units = {{ length = "m" }}
[links]
frame = {{ points = {{ O = [0, 0], G = [0.1, 0] }} }}
cam = {{ points = {{ O = [0, 0] }} }}
follower = {{ points = {{ T = [0, 0] }} }}
[joints]
O = {{ revolute = ["frame", "cam"], drive = {{ speed = "-60 rpm" }} }}
S = {{ prismatic = ["frame", "follower"], at = ["G", "T"], along = [1, 0] }}
[joints.K]
cam = ["cam", "follower"]
follower = {{ roller = 0.005, guide = "S", point = "T" }}
[joints.K.profile]
base = {base}
pressure_limit = "30 deg"
lift = [
    {{ over = "120 deg", law = {{ position = {{ at = {at}, values = {values} }} }} }},
    {{ over = "240 deg", to = 0, law = "cycloidal" }},
]
"""


@pytest.mark.parametrize("joint", [0, 1])
def test_the_two_cams_of_a_drawing_arm_are_the_reference_s(joint):
    """The arm led along a straight stroke gives the table of each cam. The ends of a table are fitted: that the follower rests
    there is met to 1e-7 of its largest velocity, which is no corner."""
    _, expected = design_case("drawing-arm-two-cams")
    motion = run_scene(mechviz.loads(ARM)).motion
    angle, rate = motion.coordinate("AB"[joint])[:, :2].T
    rows = np.array(expected["rows"])
    np.testing.assert_allclose(np.stack([angle, rate])[:, ::30], rows[:, [3 + joint, 5 + joint]].T, atol=1e-12)
    wanted = expected["cams"][joint]
    assert angle.min() == pytest.approx(wanted["angle_min"], abs=1e-12)
    above = 0.05 * (angle[0] - angle.min())  # of the start over the lowest place
    table = {"at": np.radians(np.linspace(0.0, 120.0, 121)).tolist(), "values": (0.05 * (angle - angle[0])).tolist()}
    least = placed(mechviz.loads(ARM_CAM.format(base='"least"', **table)))
    assert least.base + 0.005 - above == pytest.approx(wanted["least_prime_radius"], rel=1e-6)
    cam = placed(mechviz.loads(ARM_CAM.format(base=wanted["prime_radius"] + above - 0.005, **table))).cam
    _, theta, lift, slope, height, pressure, *points = np.array(wanted["rows"]).T
    at = cam.at(theta)
    assert height == pytest.approx(wanted["prime_radius"] + lift)
    for ours, theirs in ((at.motion[0], height), (at.motion[1], slope), (at.pressure_angle, pressure)):
        np.testing.assert_allclose(ours, theirs, atol=1e-7)
    for curve, (x, y) in ((at.pitch, points[:2]), (at.working, points[2:])):  # our cam is drawn with its follower along y
        np.testing.assert_allclose(curve, y + 1j * x, atol=1e-9)


def test_an_offset_of_a_groove_s_least_base_circle_is_best_for_both_flanks():
    """The numbers of `test_the_best_offset_of_a_groove_counts_its_outer_flank`."""
    lift = """[
    { over = 150, to = 20 },
    { over = 60 },
    { over = 90, to = 0 },
    { over = 60 },
]
"""
    text = re.sub(r"(?s)lift = \[.*", "pressure_limit = 45\nlift = " + lift, text_of("cam-groove"))
    text = text.replace("base = 35", 'base = "least"').replace("roller = 8,", 'roller = 12, offset = "least",')
    cam = placed(mechviz.loads(text))
    assert cam.offset == pytest.approx(-1.4535e-3, abs=1e-7)
    assert cam.base == pytest.approx(3.6386e-3, abs=1e-7)


@pytest.mark.parametrize(
    ("name", "line", "words"),
    [
        ("cam-inverse", "curvature_limit = 50", "curvature_limit  of an inverse cam the curvature is not judged"),
        ("cam-barrel", "curvature_limit = 50", "curvature_limit  of a cam with its axis in the plane the curvature is not judged"),
        ("cam-inverse", 'undercut = "cut"', "undercut  inverse cams are refused where they are undercut"),
        ("cam-wedge", 'undercut = "cut"', "undercut  wedges are refused where they are undercut"),
        ("cam-roller", "base = -1", "base  -1 mm is negative"),
    ],
)
def test_what_a_kind_of_cam_has_no_use_for_is_refused(name, line, words):
    text = re.sub(r"(?m)^base = .*$", "", text_of(name)) if "base" in line else text_of(name)
    with pytest.raises(MechanismError, match=words):
        mechviz.loads(text.replace("[joints.K.profile]", f"[joints.K.profile]\n{line}"))


def test_only_an_arm_has_sides():
    with pytest.raises(MechanismError, match=r"joints\.K\.follower\.side  a follower in a straight guide has no arm"):
        mechviz.loads(text_of("cam-roller").replace("guide =", 'side = "left", guide =', 1))


@pytest.mark.parametrize(("name", "link", "axis", "base", "moved"), [
    ("cam-inverse", "lever", 2, -30.0, np.radians(-30.0)),
    ("cam-wedge", "follower", 1, -10.0, -22e-3),
])  # fmt: skip
def test_a_base_that_is_a_place_may_be_negative(name, link, axis, base, moved):
    """Of an inverse cam it is a coordinate, of a wedge a height: the follower moves by as much, and as before."""
    runs = [
        run_scene(mechviz.loads(text), frames=24)
        for text in (text_of(name), re.sub(r"(?m)^base = \S+", f"base = {base}", text_of(name)))
    ]
    first, other = (run.motion.pose(link)[:, axis] for run in runs)
    np.testing.assert_allclose(other - first, moved, atol=1e-12)
