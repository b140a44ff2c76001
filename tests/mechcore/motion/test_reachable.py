"""Drives that run as far as the mechanism can go and back: ``range = "reachable"``."""

from __future__ import annotations

import math

import numpy as np
import pytest
from typer.testing import CliRunner

import mechviz
from mechcore.errors import MechanismError
from mechcore.laws.timed import ConstantSpeed, Law, Oscillation
from mechcore.motion.reach import reachable_ranges
from mechcore.motion.solve import compile_mechanism
from mechviz.commands.main import app
from mechviz.outputs.viewer.session import EditSession, Status
from mechviz.runs import run_scene
from mechviz.scene.assembly.simulation import RANGE_MARGIN, oscillation_changes
from mechviz.scene.faults import SceneError
from mechviz.scene.scene import Scene
from mechviz.studies.report import check_lines

ROCKER = """
title = "Triple rocker"
units = { length = "mm", angle = "deg" }
[links]
frame   = { points = { A = [0, 0], D = [200, 0] } }
crank   = { points = { A = [0, 0], B = [120, 0] } }
coupler = { points = { B = [0, 0], C = [100, 0] } }
rocker  = { points = { D = [0, 0], C = [110, 0] } }
[joints]
A = { revolute = ["frame", "crank"], drive = { DRIVE } }
B = { revolute = ["crank", "coupler"] }
C = { revolute = ["coupler", "rocker"], side = "left" }
D = { revolute = ["frame", "rocker"] }
"""
REACHABLE = 'speed = "60 rpm", start = 20, range = "reachable"'


def rocker(drive: str = REACHABLE, text: str = ROCKER) -> Scene:
    return mechviz.loads(text.replace("DRIVE", drive))


def limit(crank: float, frame: float, rest: float) -> float:
    """Angle between crank and frame at which coupler and rocker, ``rest`` long together, are in line."""
    return math.acos((crank**2 + frame**2 - rest**2) / (2.0 * crank * frame))


def law_of(scene: Scene) -> Law:
    return next(d.law for d in scene.mechanism.drives if d.joint in ("A", "S", "H"))


def ends(law: Law) -> tuple[float, float]:
    assert isinstance(law, Oscillation)
    return law.centre - law.amplitude, law.centre + law.amplitude


def test_a_crank_that_cannot_turn_runs_to_its_limits_and_back():
    scene = rocker()
    law, reach = law_of(scene), limit(120.0, 200.0, 210.0)
    assert ends(law) == pytest.approx((-reach * (1.0 - 2.0 * RANGE_MARGIN), reach * (1.0 - 2.0 * RANGE_MARGIN)), rel=1e-9)
    run = run_scene(scene)
    q, v, _ = run.motion.drives[0]
    assert q[0] == pytest.approx(math.radians(20.0), abs=1e-15) and v[0] > 0.0
    assert q[-1] == pytest.approx(q[0], abs=1e-12) and v[-1] == pytest.approx(v[0], abs=1e-10)
    assert np.abs(v).max() == pytest.approx(2.0 * np.pi, rel=1e-3)  # the stated speed, in the middle
    assert run.motion.closure.max() < 1e-15 and run.motion.condition.max() < 10.0
    other = law_of(rocker(REACHABLE.replace("60 rpm", "-60 rpm")))
    time = np.linspace(0.0, 2.0, 7)
    assert ends(other) == pytest.approx(ends(law)) and other(0.0)[1] == pytest.approx(-law(0.0)[1])
    assert law.duration == other.duration and other(time + other.duration)[0] == pytest.approx(other(time)[0])


def test_it_turns_where_it_can():
    text = ROCKER.replace("[120, 0]", "[20, 0]")  # Grashof: 20 + 200 < 100 + 125
    turning = law_of(rocker(text=text.replace("C = [110, 0]", "C = [125, 0]")))
    assert turning == ConstantSpeed(math.radians(20.0), 2.0 * np.pi)
    change_point = law_of(rocker(text=text.replace("C = [110, 0]", "C = [120, 0]")))
    assert isinstance(change_point, ConstantSpeed)  # 20 + 200 = 100 + 120: the change point can be passed


def test_a_start_next_to_the_limit_is_an_end():
    start = math.degrees(limit(120.0, 200.0, 210.0)) - 0.5
    law = law_of(rocker(REACHABLE.replace("20", f"{start!r}", 1)))
    assert ends(law)[1] == pytest.approx(math.radians(start)) and law(0.0)[0] == pytest.approx(math.radians(start))
    assert law(0.0)[1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("start", [90, -120])
def test_a_start_that_cannot_be_had_is_moved_to_the_nearest_end(start):
    law = law_of(rocker(REACHABLE.replace("20", str(start), 1)))
    assert law(0.0)[0] == pytest.approx(math.copysign(limit(120.0, 200.0, 210.0) * (1.0 - 2.0 * RANGE_MARGIN), start), rel=1e-9)
    assert ends(law) == pytest.approx(ends(law_of(rocker())))
    assert run_scene(rocker(REACHABLE.replace("20", str(start), 1))).motion.closure.max() < 1e-14


@pytest.mark.parametrize("start", [-100, 0, 100])
def test_the_reach_goes_on_behind_the_start(start):
    """Where only the far side of the turn is missing, it is one range, wherever in it the run starts."""
    text = (
        ROCKER.replace("[110, 0]", "[165, 0]").replace("[100, 0]", "[150, 0]").replace("[120, 0]", "[117, 0]")
    )  # all but some degrees about 180
    law, reach = law_of(rocker(REACHABLE.replace("20", str(start), 1), text)), limit(117.0, 200.0, 315.0)
    assert 2.8 < reach < math.pi
    assert ends(law) == pytest.approx((-reach * (1.0 - 2.0 * RANGE_MARGIN), reach * (1.0 - 2.0 * RANGE_MARGIN)), rel=1e-9)
    held = rocker(f"speed = 0, start = {start}", text)
    (whole,) = reachable_ranges(compile_mechanism(held.mechanism))
    assert whole == pytest.approx((-reach, reach), abs=1e-9)


SLIDER = """
units = { length = "mm", angle = "deg" }
[links]
frame = { points = { O = [0, 0] } }
crank = { points = { O = [0, 0], P = [40, 0] } }
rod   = { points = { P = [0, 0], C = [130, 0] } }
slide = { points = { C = [0, 0] } }
[joints]
O = { revolute = ["frame", "crank"] }
P = { revolute = ["crank", "rod"], side = "left" }
C = { revolute = ["rod", "slide"] }
S = { prismatic = ["frame", "slide"], at = ["O", "C"], drive = { speed = "50 mm/s", start = 120, range = "reachable" } }
"""


def test_drives_that_slide():
    law = law_of(mechviz.loads(SLIDER))
    assert ends(law) == pytest.approx((0.09 + 0.08 * RANGE_MARGIN, 0.17 - 0.08 * RANGE_MARGIN), rel=1e-9)
    assert np.abs(law(np.linspace(0.0, law.duration, 101))[1]).max() == pytest.approx(0.05, rel=1e-3)
    cylinder = """
units = { length = "mm", angle = "deg" }
[links]
frame = { points = { A = [0, 0], D = [300, 0] } }
arm   = { points = { D = [0, 0], E = [200, 0] } }
[joints]
H = { cylinder = ["frame", "arm"], at = ["A", "E"], side = "left", drive = { speed = 20, start = 250, range = "reachable" } }
D = { revolute = ["frame", "arm"] }
"""
    assert ends(law_of(mechviz.loads(cylinder))) == pytest.approx((0.1 + 0.4 * RANGE_MARGIN, 0.5 - 0.4 * RANGE_MARGIN), rel=1e-9)


def test_followed_groups_stop_at_their_limit():
    """A crank whose dyads hang on each other: the reach is that of the walk along the curve."""
    extra = "extra = { points = { E = [0, 0], F = [90, 0] } }\nlast = { points = { G = [0, 0], F = [150, 0] } }"
    text = ROCKER.replace("[links]", f"[links]\n{extra}")
    text = text.replace("D = [200, 0] } }", "D = [200, 0], G = [330, 40] } }").replace(
        "C = [110, 0] } }", "C = [110, 0], E = [60, 30] } }"
    )
    text += 'E = { revolute = ["rocker", "extra"] }\nF = { revolute = ["extra", "last"], side = "left" }\n'
    text += 'G = { revolute = ["frame", "last"] }\n'
    run = run_scene(rocker(text=text))
    low, high = ends(law_of(run.scene))
    reach = limit(120.0, 200.0, 210.0)
    assert -reach < low < high < reach and run.motion.closure.max() < 1e-14


SLIDE = """
[links]
frame = { points = { O = [0, 0] } }
slide = { points = { C = [0, 0] } }
[joints]
S = { prismatic = ["frame", "slide"], at = ["O", "C"], drive = { speed = 1, range = "reachable" } }
"""
TWO = """
units = { length = "mm", angle = "deg" }
[links]
frame = { points = { A = [0, 0], E = [150, 0] } }
a = { points = { A = [0, 0], B = [50, 0] } }
b = { points = { B = [0, 0], C = [60, 0] } }
c = { points = { C = [0, 0], D = [80, 0] } }
d = { points = { E = [0, 0], D = [30, 0] } }
[joints]
A = { revolute = ["frame", "a"], drive = { speed = 30, range = "reachable" } }
E = { revolute = ["frame", "d"], drive = { OTHER } }
B = { revolute = ["a", "b"] }
C = { revolute = ["b", "c"], side = "left" }
D = { revolute = ["c", "d"] }
"""
BEYOND = 'speed = "9 rpm", start = 180'  # at its start the two are in reach of each other


def test_beside_drives_that_stand_still():
    low, high = ends(law_of(mechviz.loads(TWO.replace("OTHER", "speed = 0, start = 90"))))
    d = complex(150.0, 30.0)
    far, tilt = abs(d), math.atan2(d.imag, d.real)
    reach = limit(50.0, far, 140.0)
    margin = 2.0 * RANGE_MARGIN * reach
    assert (low, high) == pytest.approx((tilt - reach + margin, tilt + reach - margin), rel=1e-9)


def test_beside_a_drive_that_moves():
    """As far as the mechanism can go wherever the other crank stands: the two rods reach the far end of its circle in line."""
    scene = mechviz.loads(TWO.replace("OTHER", 'speed = "90 rpm"'))
    low, high = ends(law_of(scene))
    reach = limit(50.0, 150.0, 140.0 - 30.0)
    assert (low, high) == pytest.approx((-(1.0 - 2.0 * RANGE_MARGIN) * reach, (1.0 - 2.0 * RANGE_MARGIN) * reach), rel=1e-4)
    motion = run_scene(scene).motion
    assert motion.closure.max() < 1e-12


@pytest.mark.parametrize(
    ("text", "path", "words"),
    [
        (TWO.replace("speed = 30", "speed = 30, start = 50").replace("OTHER", BEYOND), "joints.A.drive.range", "cannot stand"),
        (ROCKER.replace("DRIVE", REACHABLE + ", travel = 9"), "joints.A.drive.travel", "as far as it can"),
        (ROCKER.replace("DRIVE", REACHABLE.replace("reachable", "reachabel")), "joints.A.drive.range", "'reachable'"),
        (ROCKER.replace("DRIVE", 'range = "reachable", speed = 0'), "joints.A.drive.range", "stands still"),
        (SLIDE, "joints.S.drive.range", "nothing limits"),
    ],
)
def test_what_has_no_reach_is_refused(text, path, words):
    with pytest.raises(SceneError) as error:
        mechviz.loads(text)
    (fault,) = error.value.faults
    assert fault.path == path and words in fault.message + fault.remedy


def test_two_drives_cannot_both_go_as_far_as_they_can():
    with pytest.raises(SceneError) as error:
        mechviz.loads(TWO.replace("OTHER", 'speed = "9 rpm", range = "reachable"'))
    assert [f.path for f in error.value.faults] == ["joints.A.drive.range", "joints.E.drive.range"]
    assert all("leave each other's reach open" in f.message for f in error.value.faults)


def test_check_and_the_refusal_of_a_full_turn_name_the_key(tmp_path):
    with pytest.raises(MechanismError) as error:
        run_scene(rocker('speed = "60 rpm"'))
    assert 'range = "reachable"' in error.value.faults[0].remedy
    (line,) = (line for line in check_lines(rocker('speed = "60 rpm", travel = 40')) if line.startswith("reach"))
    assert "-77.60892° to 77.60892°" in line and 'range = "reachable"' in line
    (line,) = (line for line in check_lines(rocker()) if line.startswith("reach"))
    assert "-77.60892° to 77.60892°" in line and "reachable" not in line
    path = tmp_path / "rocker.toml"
    path.write_text(ROCKER.replace("DRIVE", 'speed = "60 rpm"'))
    table = tmp_path / "table.csv"
    assert CliRunner().invoke(app, ["export", str(path), "--csv", str(table)]).exit_code == 2
    assert CliRunner().invoke(app, ["check", str(path), "--reachable"]).exit_code == 0
    assert CliRunner().invoke(app, ["export", str(path), "--csv", str(table), "--reachable"]).exit_code == 0
    assert len(table.read_text().splitlines()) == 362
    path.write_text(ROCKER.replace("DRIVE", 'speed = "60 rpm", travel = 40'))
    assert CliRunner().invoke(app, ["check", str(path), "--reachable"]).exit_code != 0


def test_crossing_grashof_with_a_slider_swings():
    told: list[Status] = []
    grashof = ROCKER.replace("[120, 0]", "[20, 0]").replace("C = [110, 0]", "C = [125, 0]")
    session = EditSession(
        run_scene(rocker('speed = "60 rpm"', grashof)), lambda _: None, told.append, lambda _: None, lambda: None, lambda _: None
    )
    try:
        frame = next(p for p in session.parameters if p.label == "crank A–B")
        session.set_value(frame, 60.0)
        assert session.wait() and told[-1].fault == "" and told[-1].oscillating_drives == ("A",)
        assert isinstance(session.run.scene.mechanism.drives[0].law, Oscillation)
        assert 'range = "reachable"' in session.run.scene.to_toml()
        session.set_value(frame, 21.0)
        assert session.wait() and told[-1].oscillating_drives == ()
        assert isinstance(session.run.scene.mechanism.drives[0].law, ConstantSpeed)
        session.set_value(frame, 600.0)  # cannot be put together at all
        assert session.wait() and "miss each other" in told[-1].fault
        session.undo()
        assert session.wait() and told[-1].fault == "" and "reachable" not in session.run.scene.to_toml()
    finally:
        session.close()


@pytest.mark.parametrize(
    "drive",
    [
        'speed = "60 rpm", travel = 40',
        "speed = 0",
        'speed = "60 rpm", sine = { period = 1 }',
        "speed = 5, range = [0, 9]",
        REACHABLE,
    ],
)
def test_only_a_drive_that_says_no_more_than_its_speed_is_made_to_swing(drive):
    assert not oscillation_changes(rocker(drive).document)
    assert not oscillation_changes(mechviz.load("swinging-double-pendulum").document)


def test_a_crank_that_comes_back_to_another_mode_after_a_turn_has_a_limit():
    """A Stephenson six-bar that is solved as a triad: backwards its crank turns fully and more, forwards it stops after 4 deg."""
    scene = mechviz.loads(
        """
        units = { length = "mm", angle = "deg" }
        [links]
        link0 = { points = ["J1", "J2"] }
        link1 = { points = ["J1", "J3"] }
        link2 = { points = ["J4", "J5"] }
        link3 = { points = ["J6", "J7"] }
        frame = { points = ["J2", "J4", "J6"] }
        link5 = { points = ["J3", "J5", "J7"] }
        [joints]
        J1 = { revolute = ["link0", "link1"] }
        J2 = { revolute = ["frame", "link0"], drive = { speed = "30 rpm", range = "reachable" } }
        J3 = { revolute = ["link1", "link5"] }
        J4 = { revolute = ["frame", "link2"] }
        J5 = { revolute = ["link2", "link5"] }
        J6 = { revolute = ["frame", "link3"] }
        J7 = { revolute = ["link3", "link5"] }
        [sketch]
        J1 = [-12.404, 95.213]
        J2 = [92.427, 25.705]
        J3 = [-90.946, 29.681]
        J4 = [60.494, -62.141]
        J5 = [-56.993, -80.926]
        J6 = [30.756, -3.928]
        J7 = [-41.107, -18.444]
        """
    )
    low, high = ends(scene.mechanism.drives[0].law)
    drawn = math.atan2(25.705 - 95.213, 92.427 + 12.404)
    assert low < drawn + 1e-9 < high + 1e-6 < drawn + math.radians(10.0)
    assert high - low > math.radians(350.0)
    assert run_scene(scene, frames=90).motion.frames == 91
    assert not any("full turn" in line for line in check_lines(scene))
