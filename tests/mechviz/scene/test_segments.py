"""Laws in scenes: the same ones on cams, over time and over a master; several axes with common knots; their faults."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import numpy as np
import pytest

import mechviz
from mechcore.laws.factors import jumps, peak
from mechcore.laws.program import CurveOverMaster
from mechcore.laws.timed import Piecewise, Rest
from mechviz.editor.parameters import find_choices, find_parameters
from mechviz.scene.faults import SceneError
from mechviz.scene.kinds.segments import former_laws
from mechviz.scene.scene import Scene
from mechviz.scene.units import Units
from mechviz.studies.report import continuity_words

DESIGN = {c["id"]: c for c in json.loads((Path(__file__).parents[2] / "reference" / "design.json").read_text())["cases"]}
TURN = 2 * np.pi

AXES = {
    "units": {"length": "mm", "angle": "deg"},
    "links": {
        "frame": {"points": {"O": [0, 0], "G": [0, 0]}},
        "shaft": {"points": {"O": [0, 0], "P": [10, 0]}},
        "slide": {"points": {"C": [0, 0], "N": [0, 10]}},
        "needle": {"points": {"N": [0, 0]}},
    },
    "joints": {
        "O": {"revolute": ["frame", "shaft"], "drive": {"speed": "60 rpm"}},
        "X": {"prismatic": ["frame", "slide"], "at": ["G", "C"], "along": [1, 0], "drive": {"start": 0}},
        "Z": {"prismatic": ["slide", "needle"], "at": ["N", "N"], "along": [0, 1], "drive": {"speed": 0}},
    },
}
CAM = {
    "units": {"length": "mm", "angle": "deg"},
    "links": {
        "frame": {"points": {"O": [0, 0], "G": [0, 110], "H": [0, 185]}},
        "cam": {"points": {"O": [0, 0]}},
        "follower": {"points": {"T": [0, 0]}},
    },
    "joints": {
        "O": {"revolute": ["frame", "cam"], "drive": {"speed": "90 rpm"}},
        "S": {"prismatic": ["frame", "follower"], "at": ["G", "T"], "along": [0, 1]},
        "K": {
            "cam": ["cam", "follower"],
            "follower": {"roller": 8, "guide": "S", "point": "T"},
            "profile": {"base": 60, "lift": []},
        },
    },
}
POINTS = [{"at": 60, "to": [14, 0.15]}]
TABLE = {"at": [0, 20, 40, 60, 80, 100, 120], "values": [0, 1.5, 6, 10, 14, 18.5, 20]}
FAST = {**TABLE, "values": [0, 5, 10, 14, 17, 19, 20]}  # at speed where it begins and ends
LAWS = {  # over 120 units of the master, to 20
    "named": {"to": 20, "law": "modified-trapezoid-constant-velocity", "parameters": {"coast": 0.3}, "mirrored": True},
    "polynomial": {"to": [20, 0, 0, 0], "law": "polynomial"},
    "through": {"to": 20, "law": {"polynomial": POINTS}},
    "spline": {"to": 20, "law": {"spline": POINTS, "degree": 4}},
    "least": {"to": 20, "law": {"least": "acceleration", "limits": {"jerk": 60}, "smooth": "jerk", "steps": 32}},
    "acceleration": {"to": 20, "law": {"acceleration": {"at": [0, 60, 60, 120], "values": [1, 1, -1, -1]}, "scaled": True}},
    "balanced": {"to": 20, "law": {"acceleration": {"at": [0, 40, 90, 120], "values": [0, 3, -1, 0]}, "balanced": True}},
    "velocity": {"to": 20, "law": {"velocity": {"at": [0, 30, 90, 120], "values": [0, 1, 1, 0]}}},
    "table": {"law": {"position": TABLE}},
    "rest": {"law": {"position": {**TABLE, "rest": True}}},
}


def axes(**drives):
    data = copy.deepcopy(AXES)
    for name, drive in drives.items():
        data["joints"][name]["drive"] = drive
    return Scene.build(**data)


def law(scene, joint="X"):
    return next(d.law for d in scene.mechanism.drives if d.joint == joint)


def cam(*lift, **profile):
    data = copy.deepcopy(CAM)
    data["joints"]["K"]["profile"] |= {"lift": list(lift), **profile}
    return Scene.build(**data)


def lift_of(scene):
    return next(p.lift for p in scene.mechanism.joints if p.name == "K")


def faults(build):
    with pytest.raises(SceneError) as error:
        build()
    return {f.path: str(f.message) for f in error.value.faults}


@pytest.mark.parametrize("kind", LAWS)
def test_any_law_stands_on_a_cam_over_a_master_and_over_time(kind):
    """The same curve, stretched: 120 deg of a cam or of a master at 60 rpm, or 120 s."""
    segment = LAWS[kind]
    on_cam = lift_of(cam({"over": 120, **segment}, {"over": 120, "to": 0}, {"over": 120}, undercut="cut"))
    program = {"start": 0, "program": {"master": "O", "segments": [{"over": 120, **segment}, {"over": 240, "to": 0}]}}
    by_master = law(axes(X=program))
    over_time = law(axes(X={"start": 0, "segments": [{"duration": 120, **segment}, {"duration": 240, "to": 0}]}))
    x = np.concatenate([[0.0], np.linspace(0.003, 0.997, 24), [1.0]])
    s = on_cam(x * TURN / 3, 2)
    assert s[0, 0] == pytest.approx(0.0, abs=1e-12)
    assert s[0, -1] == pytest.approx(0.02)
    assert isinstance(by_master, CurveOverMaster)
    unit = np.array([1.0, TURN, TURN**2])[:, None]
    inner = slice(1, -1)
    np.testing.assert_allclose(np.stack(by_master(x / 3))[:, inner], (unit * s)[:, inner], rtol=1e-9, atol=1e-9)
    unit = np.array([1.0, TURN / 360, (TURN / 360) ** 2])[:, None]
    np.testing.assert_allclose(np.stack(over_time(x * 120))[:, inner], (unit * s)[:, inner], rtol=1e-8, atol=1e-13)


def test_several_axes_with_common_knots_are_the_reference_s_program():
    """Ranges are stated once, by X; Z takes them. Velocities and accelerations at the inner knots are free."""
    case = DESIGN["multi-axis-quintic-spline"]
    knots, given, want = case["inputs"]["knots"], case["inputs"]["axes"], case["expected"]

    def ends(values):
        return [{"to": [f"{v} m", "free", "free"]} for v in values[1:-1]] + [{"to": f"{values[-1]} m", "law": "polynomial"}]

    rows = [{"duration": float(b - a), **s} for a, b, s in zip(knots, knots[1:], ends(given["x"]), strict=False)]
    scene = axes(X={"start": 0, "segments": rows}, Z={"start": 0, "program": {"knots": "X", "segments": ends(given["y"])}})
    for joint, axis in (("X", "x"), ("Z", "y")):
        computed = law(scene, joint)
        assert isinstance(computed, Piecewise)
        np.testing.assert_allclose(computed.coefficients, want[axis]["coefficients"], rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(computed.knots, knots)


def test_knots_of_a_program_on_a_master_are_taken_with_its_phase():
    first = {"master": "O", "phase": 30, "segments": [{"over": 100, "to": 5}, {"over": 260, "to": 0}]}
    scene = axes(
        X={"start": 0, "program": first},
        Z={"start": 0, "program": {"knots": "X", "segments": [{"to": 10, "law": "3-4-5"}, {"to": 0, "law": "3-4-5"}]}},
    )
    values = law(scene, "Z")
    assert isinstance(values, CurveOverMaster)
    assert values.phase == pytest.approx(np.radians(30))
    np.testing.assert_allclose(values.curve.knots, np.radians([0, 100, 360]))


def test_derivatives_by_the_cam_s_angle_in_any_unit():
    per_degree = lift_of(cam({"over": 120, "to": [10, 0.2]}, {"over": 240, "to": 0}))
    per_radian = lift_of(cam({"over": 120, "to": [10, f"{0.2 * 180 / np.pi} mm/rad"]}, {"over": 240, "to": 0, "law": "polynomial"}))
    assert per_degree(TURN / 3, 1, "left")[1] == pytest.approx(0.2e-3 * 180 / np.pi)
    np.testing.assert_allclose(per_radian(1.0, 2), per_degree(1.0, 2))


def test_a_given_acceleration_is_the_lecture_s_cam():
    """a = a0 sin(angle) over the turn: h = R - a0 sin(angle), theory 5.5."""
    wave = {"harmonics": [{"sine": "10 mm/rad^2"}]}
    lift = lift_of(cam({"over": 360, "law": {"acceleration": wave}}, base=60))
    x = np.linspace(0, TURN, 13)
    np.testing.assert_allclose(lift(x, 0)[0], -0.01 * np.sin(x), atol=1e-15)
    assert jumps(lift) == []


@pytest.mark.parametrize(("point", "between"), [(".", ";"), (",", ";"), (".", ",")])
def test_a_table_of_lift_from_a_file(tmp_path, point, between):
    """Also with decimal commas, as spreadsheets of many languages write, beside semicolons; one in a header decides nothing."""
    x = np.linspace(0, 360, 73)
    rows = [between.join((f"{a:.6f}", f"{10 * (1 - np.cos(np.radians(a))):.9f}")) for a in x]
    head = "angle [deg];lift [mm]" if between == ";" else "angle [deg],lift [mm],measured; by hand"
    (tmp_path / "lift.csv").write_text("\n".join([head, *(row.replace(".", point) for row in rows)]))
    data = copy.deepcopy(CAM)
    table = {"file": "lift.csv", "periodic": True}
    data["joints"]["K"]["profile"]["lift"] = [{"over": 360, "law": {"position": table}}]
    lift = lift_of(Scene.build(**data, folder=tmp_path))
    y = np.linspace(0.1, 6.0, 11)
    np.testing.assert_allclose(lift(y, 2), [0.01 * (1 - np.cos(y)), 0.01 * np.sin(y), 0.01 * np.cos(y)], atol=2e-7)


def test_a_law_of_least_peak_reaches_its_goal():
    lift = lift_of(cam({"over": 120, "to": 20, "law": {"least": "acceleration"}}, {"over": 120, "to": 0}, {"over": 120}))
    rise = type(lift)(lift.pieces[:64])
    assert abs(peak(rise, 2).value) == pytest.approx(4.0 * 0.02 / (TURN / 3) ** 2, rel=1e-9)


def test_programs_that_stand_still_are_rests():
    for drive in (
        {"start": 3, "segments": [{"duration": 2}, {"duration": 1, "to": 3}]},
        {"start": 3, "program": {"speed": "60 rpm", "segments": [{"over": 90, "to": 3}, {"over": 10}]}},
    ):
        assert isinstance(law(axes(X=drive)), Rest)


def _lift(**segment):
    return lambda: cam({"over": 120, **segment}, {"over": 240, "to": 0})


@pytest.mark.parametrize(
    ("build", "path", "message"),
    [
        (_lift(to=[20, 5], law="cycloidal"), "joints.K.profile.lift[0].to", "cannot meet a velocity"),
        (_lift(to=20, law="cycloid"), "joints.K.profile.lift[0].law", "is no law of motion"),
        (_lift(to=20, law={"least": "acceleration", "spline": POINTS}), "joints.K.profile.lift[0].law", "at once"),
        (_lift(to=20, spline=POINTS), "joints.K.profile.lift[0]", "'spline' does not belong here"),
        (_lift(to=20, law={"spline": POINTS}, degree=4), "joints.K.profile.lift[0]", "'degree' does not belong here"),
        (_lift(to=20, law="position"), "joints.K.profile.lift[0].law", "alone does not say which law"),
        (
            _lift(law={"position": FAST}),
            "joints.K.profile.lift[0].law.position",
            "at its last row the velocity falls from 1.656 mm",
        ),
        (_lift(to=20, law={"least": "push"}), "joints.K.profile.lift[0].law.least", "push"),
        (_lift(law={"least": "jerk"}), "joints.K.profile.lift[0].law", "does not say where the segment ends"),
        (_lift(to=20, law={"least": "jerk", "degree": 3}), "joints.K.profile.lift[0].law.degree", "goes with spline"),
        (_lift(to=20, law={"least": "acceleration", "limits": {"velocity": 1}}), "joints.K.profile.lift[0].law", "no law keeps"),
        (_lift(to=20, law={"polynomial": [{"at": 130, "to": 3}]}), "joints.K.profile.lift[0].law.polynomial[0].at", "not inside"),
        (_lift(to=20, law={"polynomial": POINTS, "powers": [0, 1]}), "joints.K.profile.lift[0].law", "8 conditions"),
        (
            _lift(to=20, law={"velocity": {"at": [0, 60], "values": [1, 1]}}),
            "joints.K.profile.lift[0].law.velocity.at",
            "do not go from 0",
        ),
        (_lift(law={"position": {**TABLE, "values": [1, 2]}}), "joints.K.profile.lift[0].law.position.values", "has 2 entries"),
        (_lift(law={"position": {"file": "no.csv"}}), "joints.K.profile.lift[0].law.position.file", "there is no file"),
        (_lift(to=[20, "3 N"], law="polynomial"), "joints.K.profile.lift[0].to[1]", "a length per angle is wanted"),
        (_lift(to=20, law="polynomial", mirrored=True), "joints.K.profile.lift[0].mirrored", "does not go with"),
        (
            lambda: axes(X={"start": 0, "program": {"knots": "O", "segments": [{"to": 3}]}}),
            "joints.X.drive.program.knots",
            "no driven joint with segments",
        ),
        (
            lambda: axes(
                X={"start": 0, "segments": [{"duration": 1, "to": 3}]}, Z={"program": {"knots": "X", "segments": [{}, {"to": 3}]}}
            ),
            "joints.Z.drive.program.segments",
            "2 segments, but 1",
        ),
        (
            lambda: axes(X={"start": 0, "program": {"speed": "60 rpm", "segments": [{"to": 3}]}}),
            "joints.X.drive.program.segments[0]",
            "'over' is missing",
        ),
    ],
)
def test_faults_name_the_place(build, path, message):
    result = faults(build)
    assert path in result, result
    assert message in result[path]


def test_the_editor_shows_laws_with_their_units():
    scene = cam({"over": 120, "to": [20, 0.1, "free"]}, {"over": 120, **LAWS["through"], "to": 0}, {"over": 120})
    result = {p.key: p for p in find_parameters(scene)}
    first = "joints.K.profile.lift[0]"
    assert (result[f"{first}.to[0]"].unit, result[f"{first}.to[1]"].unit, result[f"{first}.over"].unit) == ("mm", "mm/°", "°")
    assert f"{first}.to[2]" not in result
    second = "joints.K.profile.lift[1].law.polynomial[0]"
    assert (result[f"{second}.at"].unit, result[f"{second}.to[1]"].unit) == ("°", "mm/°")
    laws = {c.key: c for c in find_choices(scene)}
    assert laws[f"{first}.law"].value == "polynomial"
    assert "sine-squared" in laws[f"{first}.law"].options
    timed = axes(X={"start": [0, 1], "segments": [{"duration": 2, "to": [5, 1, 0, 3]}]})
    units = {p.key.rpartition("drive.")[2]: p.unit for p in find_parameters(timed) if ".X." in p.key}
    assert units["segments[0].to[3]"] == "mm/s³"
    assert units["start[1]"] == "mm/s"


def test_the_remedies_of_a_table_that_ends_at_speed_make_a_cam():
    rows = [{"at": at, "to": to} for at, to in zip(FAST["at"], FAST["values"], strict=True)][1:-1]
    lift = lift_of(_lift(to=20, law={"spline": rows})())
    np.testing.assert_allclose(lift(np.radians(FAST["at"]), 0)[0], np.array(FAST["values"]) / 1e3, atol=1e-12)
    assert [j.angle for j in jumps(lift) if j.order < 2] == []
    data = copy.deepcopy(CAM)
    data["joints"]["K"]["follower"] = {"knife": True, "guide": "S", "point": "T"}
    data["joints"]["K"]["profile"]["lift"] = [{"over": 120, "law": {"position": FAST}}, {"over": 240, "to": 0}]
    assert {j.order for j in jumps(lift_of(Scene.build(**data)))} >= {1}


def test_check_tells_how_smooth_every_law_is():
    rows = [{"duration": 1, "to": 5, "law": "parabolic"}, {"duration": 1, "to": [5, "free", "free"]}]
    words = list(continuity_words(axes(X={"start": 0, "segments": rows}).mechanism, Units(length="mm", angle="deg")))
    assert words == ["X: 3 pieces, continuous up to the velocity; the acceleration jumps at 0.5 s, 1 s, infinite jerk"]
    smooth = cam({"over": 180, "to": 20, "law": "4-5-6-7"}, {"over": 180, "to": 0, "law": "4-5-6-7"})
    assert list(continuity_words(smooth.mechanism, Units())) == ["K: 2 pieces, continuous up to the jerk"]


def test_a_former_name_of_a_law_is_told():
    scene = cam({"over": 180, "to": 20, "law": "triple-harmonic"}, {"over": 180, "to": 0})
    assert list(former_laws(scene.document)) == [("joints.K.profile.lift[0].law", "triple-harmonic", "cosine-1-3")]
    lift_of(scene)


def test_the_gantry_of_the_gallery_keeps_its_axes_in_step():
    """The three axes rest together, and pass the times that the carriage states without a stop."""
    laws = {d.joint: d.law for d in mechviz.load("gantry-in-step").mechanism.drives}
    assert [law.duration for law in laws.values()] == pytest.approx([2.4] * 3, rel=1e-14)
    for t in (0.3, 1.3, 1.6, 2.4):
        np.testing.assert_allclose([np.ravel(laws[axis](t)[1]) for axis in "XZJ"], 0.0, atol=1e-9)
    q, v, _ = laws["X"](np.array([0.55, 1.05]))
    np.testing.assert_allclose(q, [0.06, 0.34])
    assert np.all(v > 0.3)


@pytest.mark.parametrize(
    ("segment", "path"),
    [
        ({"law": {"velocity": {"at": {}, "values": [1, 1]}}}, "law.velocity.at"),
        ({"law": {"acceleration": {"at": [0, 60, 120], "values": [1, -1]}}}, "law.acceleration"),
        ({"to": [1, 2, 3, 4, 5]}, "to"),
        ({"to": 20, "law": {"least": "jerk", "limits": {"velocity": "x"}}}, "law.limits.velocity"),
        ({"to": 20, "law": {"least": "jerk", "limits": {"velocity": -2}}}, "law.limits"),
        ({"to": 20, "law": {"spline": []}}, "law.spline"),
        ({"to": 20, "law": {"least": "jerk", "limits": {"push": 1}}}, "law.limits.push"),
        ({"to": [20, "free"], "law": {"polynomial": [{"at": 60, "to": ["free", 1, 1]}], "powers": [*range(3, 11)]}}, "law"),
        ({"to": 20, "law": {}}, "law"),
        ({"law": {"position": {**TABLE, "at": [0, 20, 40, 60, 80, 100, 110]}}}, "law.position.at"),
    ],
)
def test_tables_of_laws_that_cannot_be_read_are_told_once(segment, path):
    """Mutants that once stopped with an error of the program."""
    result = faults(_lift(**segment))
    assert list(result) == [f"joints.K.profile.lift[0].{path}"]
