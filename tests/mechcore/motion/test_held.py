"""What stands still: held drives alone and beside others, structures without freedoms. Statics at one instant or over time."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from typer.testing import CliRunner

import mechviz
from mechcore.errors import MechanismError
from mechcore.laws.timed import ConstantSpeed, Rest, moves
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.loads import Factor, Force
from mechcore.spec.mechanism import Drive, Link, Mechanism, Revolute
from mechviz.commands.main import app
from mechviz.outputs.rerun.reader import Recording
from mechviz.runs import run_scene
from mechviz.scene.faults import SceneError
from mechviz.scene.scene import Scene
from mechviz.studies.report import check_lines

TRUSS = """
title = "Two bars"
units = { length = "mm" }
[links]
frame = { points = { A = [0, 0], B = [700, 0] } }
a = { points = { A = [0, 0], C = [500, 0] } }
b = { points = { B = [0, 0], C = [400, 0] } }
[joints]
A = { revolute = ["frame", "a"] }
B = { revolute = ["frame", "b"] }
C = { revolute = ["a", "b"], side = "left" }
[loads]
W = { force = ["20 N", "-100 N"], on = "b", at = "C" }
"""

FOUR_BAR = """
title = "Four-bar, held"
units = { length = "mm", angle = "deg" }
RUN
[links]
frame   = { points = { A = [0, 0], D = [200, 0] } }
crank   = { points = { A = [0, 0], B = [60, 0] } }
coupler = { points = { B = [0, 0], C = [180, 0] } }
rocker  = { points = { D = [0, 0], C = [150, 0] } }
[joints]
A = { revolute = ["frame", "crank"], drive = { DRIVE } }
B = { revolute = ["crank", "coupler"] }
C = { revolute = ["coupler", "rocker"], side = "left" }
D = { revolute = ["frame", "rocker"] }
[loads]
M = { torque = "5 N m", on = "rocker" FACTOR }
"""


HELD = "speed = 0, start = 40"
FREE = FOUR_BAR.replace(", drive = { DRIVE }", "").replace("RUN", "").replace("FACTOR", "")
LOOSE = TRUSS.replace('"a", "b"], side = "left"', '"a", "c"]').replace("[joints]", "c = { points = { C = [0, 0] } }\n[joints]")


def four_bar_text(drive: str = HELD, run: str = "", factor: str = "") -> str:
    return FOUR_BAR.replace("DRIVE", drive).replace("RUN", run).replace("FACTOR", factor)


def four_bar(drive: str = HELD, run: str = "", factor: str = "") -> Scene:
    return mechviz.loads(four_bar_text(drive, run, factor))


def rocker_angle(crank: float) -> float:
    """Angle of the rocker [rad], from the triangle of B, C and D."""
    b, d = 60.0 * cmath.exp(1j * crank), 200.0
    far = abs(d - b)
    at_b = math.acos((180.0**2 + far**2 - 150.0**2) / (2.0 * 180.0 * far))
    return cmath.phase(b + 180.0 * cmath.exp(1j * (cmath.phase(d - b) + at_b)) - d)


def holding_torque(crank: float) -> float:
    """Virtual work: the drive's torque against 5 N m on the rocker."""
    h = 1e-5
    return -5.0 * (rocker_angle(crank + h) - rocker_angle(crank - h)) / (2.0 * h)


def test_a_structure_is_statics_at_one_frame():
    run = run_scene(mechviz.loads(TRUSS))
    assert run.motion.frames == 1 and run.motion.time[0] == 0.0
    x = (500.0**2 - 400.0**2 + 700.0**2) / 1400.0
    c = complex(x, math.sqrt(500.0**2 - x**2))
    along = np.array([[c.real / 500.0, (c.real - 700.0) / 400.0], [c.imag / 500.0, c.imag / 400.0]])
    bars = np.linalg.solve(along, [20.0, -100.0])  # method of joints: forces with which the pin pulls the bars
    assert run.forces is not None
    assert run.forces.reaction("A")[0, :2] == pytest.approx(-bars[0] * along[:, 0], abs=1e-11)
    assert run.forces.reaction("B")[0, :2] == pytest.approx(-bars[1] * along[:, 1], abs=1e-11)
    assert run.catalogue is not None and run.errors is not None
    assert any(line.startswith("statics") for line in check_lines(run.scene))


def test_redundant_structures_are_in_balance():
    x = (500.0**2 - 400.0**2 + 700.0**2) / 1400.0
    b = cmath.phase(complex(x - 700.0, math.sqrt(500.0**2 - x**2)))
    text = TRUSS.replace('B = { revolute = ["frame", "b"]', f'B = {{ weld = ["frame", "b"], angle = {b!r}')
    text = text.replace(', side = "left"', "")
    forces = run_scene(mechviz.loads(text)).forces
    assert forces is not None
    on_ground = forces.reaction("A")[0, :2] + forces.reaction("B")[0, :2]
    assert on_ground == pytest.approx([-20.0, 100.0], abs=1e-10)


@pytest.mark.parametrize(
    ("drive", "lasts"),
    [
        ("speed = 0, start = 40", 0.0),
        ('speed = "0 rpm", start = 40', 0.0),
        ('speed = "15 rpm", start = 40, travel = 0', 0.0),
        ("speed = 0, start = 40, zones = { steady = 20 }", 0.0),
        ('oscillation = { centre = 40, amplitude = 0, period = "3 s" }', 3.0),
        ("start = 40, segments = [{ duration = 1, to = 40 }, { duration = 1.5, to = 40 }]", 2.5),
        ("table = { time = [1, 2, 5], position = [40, 40, 40] }", 4.0),
        ('start = 40, program = { speed = "30 rpm", segments = [{ over = 90 }, { over = 270 }] }', 2.0),
        ('start = 40, program = { speed = "30 rpm", segments = [{ over = 90, to = 40 }, { over = 270 }] }', 2.0),
        ("start = 40, program = { speed = 0, segments = [{ over = 90, to = 70 }, { over = 270, to = 40 }] }", 0.0),
    ],
)
def test_every_law_can_stand_still(drive, lasts):
    scene = four_bar(drive)
    (law,) = (d.law for d in scene.mechanism.drives)
    assert isinstance(law, Rest) and not moves(law)
    assert law.position == pytest.approx(math.radians(40.0), abs=1e-15)
    time = default_times(scene.mechanism, scene.frames, scene.cycles)
    assert (len(time), time[-1]) == ((361, pytest.approx(lasts)) if lasts else (1, 0.0))
    run = run_scene(scene)
    assert run.forces is not None
    assert run.forces.effort("A") == pytest.approx(holding_torque(math.radians(40.0)), rel=1e-9)
    assert not run.forces.power("A").any()
    assert not run.motion.velocity("coupler").any() and not run.motion.acceleration("coupler").any()


def test_a_program_follows_a_held_master():
    ram = 'S = { prismatic = ["frame", "ram"], at = ["A", "T"], drive = { start = 0, PROGRAM } }'
    text = four_bar_text("speed = 0, start = 45").replace("[joints]\n", f"[joints]\n{ram}\n")
    text = text.replace("[links]\n", "[links]\nram = { points = { T = [0, 0] } }\n")
    program = 'program = { master = "A", segments = [{ over = 90, to = 8, law = "constant-velocity" }, { over = 270, to = 0 }] }'
    law = next(d.law for d in mechviz.loads(text.replace("PROGRAM", program)).mechanism.drives if d.joint == "S")
    assert isinstance(law, Rest) and law.position == pytest.approx(0.004)


def test_loads_vary_over_the_time_that_is_stated():
    two_seconds, sine = 'run = { duration = "2 s", frames = 40 }', ', sine = { frequency = "0.75 Hz", phase = 20 }'
    run, torque = run_scene(four_bar(run=two_seconds, factor=sine)), holding_torque(math.radians(40.0))
    assert np.allclose(run.motion.time, np.linspace(0.0, 2.0, 41))
    wave = np.sin(2.0 * np.pi * 0.75 * run.motion.time + math.radians(20.0))
    assert run.forces is not None
    assert run.forces.effort("A") == pytest.approx(torque * wave, rel=1e-9, abs=1e-12)
    rising = ", table = { time = [0, 4], factor = [0, 2] }"
    table = run_scene(four_bar("table = { time = [0, 4], position = [40, 40] }", factor=rising))
    assert table.forces is not None and table.motion.time[-1] == 4.0
    assert table.forces.effort("A")[[0, 180, 360]] == pytest.approx(torque * np.array([0, 1, 2]), rel=1e-9)
    text = TRUSS.replace("[links]", 'run = { duration = "1 s" }\n[links]')
    structure = run_scene(mechviz.loads(text.replace('"C" }\n', '"C", ramp = { end = 1 } }\n')))
    assert structure.forces is not None
    reactions = structure.forces.reaction("A")
    assert reactions[180] == pytest.approx(0.5 * reactions[360], abs=1e-12) and np.hypot(*reactions[360, :2]) > 10.0


def test_a_held_drive_beside_one_that_moves():
    """It is as if the held link were welded, whichever drive comes first; the one that moves tells the cycle."""
    five = """
units = { length = "mm", angle = "deg" }
metrics = ["velocity_ratio"]
[links]
frame = { points = { A = [0, 0], E = [100, 0] } }
a = { points = { A = [0, 0], B = [50, 0] } }
b = { points = { B = [0, 0], C = [90, 0] } }
c = { points = { C = [0, 0], D = [80, 0] } }
d = { points = { E = [0, 0], D = [30, 0] } }
[joints]
A = { HELD }
E = { revolute = ["frame", "d"], drive = { speed = "30 rpm", start = 10 } }
B = { revolute = ["a", "b"] }
C = { revolute = ["b", "c"], side = "left" }
D = { revolute = ["c", "d"] }
[loads]
F = { force = ["10 N", 0], on = "c", at = "C", table = { position = [0, 180], factor = [1, 3], period = 360 } }
"""
    held = run_scene(mechviz.loads(five.replace("HELD", 'revolute = ["frame", "a"], drive = { speed = 0, start = 70 }')))
    fixed = run_scene(mechviz.loads(five.replace("HELD", 'weld = ["frame", "a"], angle = 70')))
    assert [d.joint for d in held.motion.mechanism.drives] == ["E", "A"]
    assert held.motion.time[-1] == 2.0 and held.motion.frames == fixed.motion.frames
    assert held.forces is not None and fixed.forces is not None
    for link in "abcd":
        assert held.motion.pose(link) == pytest.approx(fixed.motion.pose(link), abs=1e-12)
        assert held.motion.acceleration(link) == pytest.approx(fixed.motion.acceleration(link), abs=1e-9)
    assert held.forces.effort("A") == pytest.approx(fixed.forces.reaction("A")[:, 2], abs=1e-11)
    assert held.forces.effort("E") == pytest.approx(fixed.forces.effort("E"), abs=1e-11)


def test_core_mechanisms_rest_too():
    """A constant speed of zero is rest; a factor by time acts on a structure; several groups that are followed stand still."""
    links = (
        Link(name="frame", points={"A": (0.0, 0.0)}),
        Link(name="arm", points={"A": (0.0, 0.0), "B": (0.5, 0.0)}),
    )
    joint = Revolute(name="A", links=("frame", "arm"), points=("A", "A"))
    load = Force(name="F", link="arm", point="B", vector=(0.0, 2.0), factor=Factor(function=np.cos, of="time"))
    made = Mechanism(
        name="arm",
        frame="frame",
        links=links,
        joints=(joint,),
        drives=(Drive(joint="A", law=ConstantSpeed(0.3, 0.0)),),
        loads=(load,),
    )
    motion = solve_motion(compile_mechanism(made), np.linspace(0.0, 1.0, 3))
    assert motion.pose("arm")[:, 2] == pytest.approx(0.3) and len(default_times(made)) == 1
    for name in ("triad", "jansen-leg", "geared-slider-cranks", "valve-spring"):
        scene = mechviz.load(name)
        (drive,) = scene.mechanism.drives
        q = float(drive.law(0.2)[0])
        moved = solve_motion(compile_mechanism(scene.mechanism), np.array([0.2]))
        start = scene.changed(
            {("joints", drive.joint, "drive"): {"speed": 0, "start": f"{q!r} rad"}, ("run",): {"duration": "1 s"}}
        )
        still = solve_motion(compile_mechanism(start.mechanism), default_times(start.mechanism, 5))
        if name != "geared-slider-cranks":  # wheels stand as at their own start
            assert still.pose(scene.mechanism.links[-1].name)[-1, :2] == pytest.approx(
                moved.pose(scene.mechanism.links[-1].name)[0, :2], abs=1e-9
            )
        assert np.ptp(still.closure) == 0.0 and still.closure.max() < 1e-12


@pytest.mark.parametrize(
    ("text", "path", "words", "remedy"),
    [
        (TRUSS.replace("C = [500, 0]", "C = [50, 0]"), "joints.C", "miss each other by 250 mm", "length"),
        (LOOSE, "joints", "3 degrees of freedom", "drive"),
        (FREE, "joints", "a degree of freedom without a drive", "speed = 0"),
        (TRUSS.replace("[links]", 'metrics = ["velocity_ratio"]\n[links]'), "metrics[0]", "no drive", "Leave it out"),
        (TRUSS.replace('"C" }\n', '"C", table = { position = [0, 1], factor = [0, 1] } }\n'), "loads.W.table", "no drive", "time"),
        (four_bar_text("speed = 9", 'run = { duration = "1 s" }'), "run.duration", "nothing is free", "cycles"),
        # toggle: the crank held where coupler and rocker are in line
        (four_bar_text("speed = 0").replace("[200, 0]", "[390, 0]"), "joints", "do not hold it", "position"),
    ],
)
def test_what_does_not_hold_is_refused(text, path, words, remedy):
    with pytest.raises((MechanismError, SceneError)) as error:
        run_scene(mechviz.loads(text))
    (fault,) = error.value.faults
    assert fault.path == path and words in fault.message and remedy in fault.remedy


def test_a_parallelogram_of_three_rods_is_no_structure():
    """By counting it has no freedom, but it moves: a horizontal load has no answer."""
    links = {"frame": {"points": {"A": [0, 0], "B": [1, 0], "C": [2, 0]}}}
    links["plate"] = {"points": {"P": [0, 0], "Q": [1, 0], "R": [2, 0]}}
    links |= {f"rod {k}": {"points": {k: [0, 0], e: [1, 0]}} for k, e in zip("ABC", "PQR", strict=True)}
    joints = {k: {"revolute": ["frame", f"rod {k}"]} for k in "ABC"}
    joints |= {e: {"revolute": [f"rod {k}", "plate"]} for k, e in zip("ABC", "PQR", strict=True)}
    sketch = {"plate": {"at": [0, 1]}} | {f"rod {k}": {"at": [n, 0], "angle": "90 deg"} for n, k in enumerate("ABC")}
    load = {"W": {"force": [1, 0], "on": "plate", "at": "Q"}}
    with pytest.raises(MechanismError, match="do not hold it"):
        run_scene(Scene.build(links=links, joints=joints, sketch=sketch, loads=load))
    joints["C"] = {"weld": ["frame", "rod C"], "angle": "90 deg"}  # braced: the rod bends
    run = run_scene(Scene.build(links=links, joints=joints, sketch=sketch, loads=load))
    assert run.forces is not None and run.forces.reaction("C")[0, 0] == pytest.approx(-1.0)


@pytest.mark.parametrize("text", [TRUSS, four_bar_text()])
def test_every_command_takes_what_stands_still(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(text)
    for words in (
        ["check", "scene.toml"],
        ["check", "scene.toml", "--equations", "--modes"],
        ["plan", "scene.toml"],
        ["forces", "scene.toml"],
        ["record", "scene.toml", "-o", "scene.rrd"],
        ["inspect", "scene.rrd"],
        ["export", "scene.toml", "--csv", "scene.csv", "--glb", "scene.glb"],
        ["share", "scene.toml", "-o", "scene.html"],
        ["share", "scene.rrd", "-o", "recorded.html"],
    ):
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 0, (words, result.output)
        if words[0] == "forces":
            assert "reactions" in result.output
    recorded = Recording("scene.rrd")
    run = run_scene(mechviz.loads(text))
    assert run.forces is not None
    time, reaction = recorded.scalars("data", "joints", "B", "reaction")
    assert list(time) == [0] and reaction[:, :3] == pytest.approx(run.forces.reaction("B")[:, :3])
    assert CliRunner().invoke(app, ["accuracy", "scene.toml"]).exit_code == 2
