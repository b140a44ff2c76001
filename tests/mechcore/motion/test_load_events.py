"""What check tells of loads and outputs: tables that miss the travel, springs below their solid length, strokes, time ratios."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

import mechviz
from mechcore.errors import MechanismError
from mechcore.forces.load_events import load_events
from mechcore.motion.events import strokes
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechviz.commands.main import app
from mechviz.quantities.events import events_of
from mechviz.runs import run_scene
from mechviz.scene.scene import Scene
from mechviz.studies.report import check_lines

FOUR_BAR = """
units = { length = "mm", angle = "deg" }

[links]
frame = { points = { A = [0, 0], D = [150, 0] } }
crank = { points = { A = [0, 0], B = [40, 0] } }
rod = { points = { B = [0, 0], C = [120, 0] } }
rocker = { points = { D = [0, 0], C = [90, 0] } }

[joints]
A = { revolute = ["frame", "crank"], drive = { speed = "60 rpm", start = 17 } }
B = { revolute = ["crank", "rod"] }
C = { revolute = ["rod", "rocker"], side = "left" }
D = { revolute = ["frame", "rocker"] }

[loads]
"""
SLIDER_CRANK = """
units = { length = "mm", angle = "deg" }

[links]
frame = { points = { A = [0, 0], G = [0, -25] } }
crank = { points = { A = [0, 0], B = [40, 0] } }
rod = { points = { B = [0, 0], C = [120, 0] } }
slide = { points = { C = [0, 0] } }

[joints]
A = { revolute = ["frame", "crank"], drive = { speed = "60 rpm", start = 17 } }
B = { revolute = ["crank", "rod"] }
C = { revolute = ["rod", "slide"], branch = "ahead" }
S = { prismatic = ["frame", "slide"], at = ["G", "C"], along = [1, 0] }
"""


def motion_of(scene: Scene):
    times = default_times(scene.mechanism, scene.frames, scene.cycles)
    return solve_motion(compile_mechanism(scene.mechanism), times)


def told(loads: str) -> dict[str, str]:
    return {e.item: e.text for e in load_events(motion_of(mechviz.loads(FOUR_BAR + loads)))}


def force(rest: str) -> str:
    return f'F = {{ force = [100, 0], on = "rocker", at = "C"{rest} }}'


# -- loads -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("loads", "words"),
    [
        (force(", table = { position = [400, 500], factor = [0, 1] }"), "never acts: its table goes from 400° to 500°"),
        (force(', table = { joint = "D", position = [0, 10], factor = [1, 0] }'), "position of D goes from 100.673° to 153.675°"),
        (force(", table = { time = [2, 3], factor = [0, 1] }"), "from 2 s to 3 s, the time goes from 0 s to 1 s"),
        (force(', table = { x = [-90, -80], factor = [1, 0], point = "crank.B" }'), "crank.B goes"),
        (
            force(', table = { speed = [1, 2], factor = [0, 1], point = "crank.B" }'),
            "to 0.002 m/s, the speed of crank.B is 0.251327 m/s",
        ),
        (force(", table = { position = [400, 500], factor = [0.5, 1] }"), "is constant: its table"),
        (force("").replace("100", "0"), "never acts: it is zero"),
        ('T = { torque = 0, on = "rocker" }', "never acts: it is zero"),
    ],
)
def test_loads_that_never_act_are_told(loads, words):
    (text,) = told(loads).values()
    assert words in text


@pytest.mark.parametrize(
    "loads",
    [
        force(""),
        force(", table = { position = [370, 500], factor = [0, 1] }"),  # from 17° on, one turn
        force(", table = { position = [0, 90, 91, 92, 360], factor = [0, 0, 1, 0, 0] }"),
        force(", table = { position = [0, 90.1, 90.2, 90.3, 360], factor = [0, 0, 1, 0, 0] }"),  # between two frames
        force(", table = { position = [0, 60, 360], factor = [0, 1, 0], period = 360 }"),
        force(', sine = { frequency = "180 Hz" }'),  # zero at every frame
    ],
)
def test_loads_that_act_are_not(loads):
    assert told(loads) == {}


def test_the_least_length_of_a_spring_is_that_of_the_stretched_dyad():
    """From A to C it is 120 - 40 mm at least, where crank and rod lie in line."""
    spring = 's = { spring = ["frame.A", "rocker.C"], stiffness = "2 N/mm", free_length = 200, solid_length = SOLID }'
    assert "squeezed to 80 mm, below its solid length of 100 mm" in told(spring.replace("SOLID", "100"))["s"]
    assert "squeezed to 80 mm" in told(spring.replace("SOLID", "80.0001"))["s"], "between two frames"
    assert told(spring.replace("SOLID", "79.9999")) == {}
    with pytest.raises(MechanismError, match=r"loads\.s: its solid length of 201 mm is more than its free length of 200 mm"):
        check_lines(mechviz.loads(FOUR_BAR + spring.replace("SOLID", "201")))
    again = mechviz.loads(mechviz.loads(FOUR_BAR + spring.replace("SOLID", "100")).to_toml())
    assert again.mechanism.loads[0].solid_length == 0.1
    events = {e.item: e.text for e in events_of(run_scene(again)) if e.level == "WARN"}
    assert "below its solid length" in events["s"]
    (line,) = [line for line in check_lines(again) if line.startswith("load ")]
    assert "s: squeezed to 80 mm" in line


def test_check_knows_tables_of_motions_under_forces_that_are_out_of_reach():
    text = FOUR_BAR.replace('drive = { speed = "60 rpm", start = 17 }', "free = { position = 17 }").replace(
        "rocker = {", 'rocker = { mass = "1 kg", centre = [45, 0], inertia = "1e-3 kg m^2",'
    )
    text = 'effects = ["inertia"]\nrun = { duration = "1 s" }\n' + text
    late = force(", table = { time = [2, 3], factor = [0, 1] }")
    lines = check_lines(mechviz.loads(text + late))
    assert [line for line in lines if "F: never acts: its table goes from 2 s to 3 s, the time goes from 0 s to 1 s" in line]
    assert not [line for line in check_lines(mechviz.loads(text + late.replace("[2, 3]", "[0, 3]"))) if "never acts" in line]


def test_a_zero_force_is_in_newtons(tmp_path):
    path, record = tmp_path / "zero.toml", tmp_path / "zero.rrd"
    loads = force(", table = { position = [400, 500], factor = [0, 1] }") + '\nT = { torque = 0, on = "rocker" }\n'
    path.write_text(FOUR_BAR + loads + 'Q = { force = [0, 0], on = "rocker", at = "C" }', encoding="utf-8")
    assert CliRunner().invoke(app, ["record", str(path), "-o", str(record), "-n", "12"]).exit_code == 0
    shown = CliRunner().invoke(app, ["inspect", str(record)]).output.splitlines()
    rows = {line.split()[1]: line.split("  ")[-2:] for line in shown if line.startswith("  load ")}
    peaks = {line.split()[1]: " ".join(line.split()[2:5]) for line in shown if line.startswith("  load ")}
    assert set(rows) == {"F", "Q", "T"}
    assert peaks["F"].startswith("0 N thr") and peaks["Q"].startswith("0 N thr") and peaks["T"] == "0 N m"


# -- outputs -----------------------------------------------------------------------------------------------------------


def test_stroke_and_time_ratio_of_a_slider_crank():
    """Offset e: in its limits crank and rod are in line, at sqrt((l ± r)^2 - e^2), apart by asin(e/(l-r)) - asin(e/(l+r))."""
    r, length, e = 0.040, 0.120, 0.025
    low, high = np.sqrt((length - r) ** 2 - e**2), np.sqrt((length + r) ** 2 - e**2)
    delta = np.arcsin(e / (length - r)) - np.arcsin(e / (length + r))
    for cycles in (1, 3):
        scene = mechviz.loads(f"run = {{ frames = 200, cycles = {cycles} }}\n" + SLIDER_CRANK)
        (computed,) = strokes(motion_of(scene), cycles)
        assert (computed.joint, computed.rotary) == ("S", False)
        np.testing.assert_allclose([computed.low, computed.high], [low, high], rtol=1e-12)
        assert computed.time_ratio == pytest.approx((np.pi + delta) / (np.pi - delta), rel=1e-9)
    (line,) = [line for line in check_lines(scene) if line.startswith("output")]
    ratio = (np.pi + delta) / (np.pi - delta)
    words = f"stroke {1e3 * (high - low):.5g} mm, {1e3 * low:.5g} mm to {1e3 * high:.5g} mm; time ratio {ratio:.5g}"
    assert line == f"output     S: {words}"


def test_range_of_a_rocker_and_a_start_in_a_limit_position():
    """The rocker turns back where the distance of A and C is l ± r: the law of cosines."""
    angles = [np.arccos((0.150**2 + 0.090**2 - reach**2) / (2 * 0.150 * 0.090)) for reach in (0.080, 0.160)]
    scene = mechviz.loads(FOUR_BAR)
    (computed,) = strokes(motion_of(scene))
    np.testing.assert_allclose(sorted(np.pi - a for a in angles), [computed.low, computed.high], rtol=1e-9)
    at_limit = mechviz.loads(SLIDER_CRANK.replace("start = 17", "start = 0").replace("G = [0, -25]", "G = [0, 0]"))
    (computed,) = strokes(motion_of(at_limit))
    assert computed.length == pytest.approx(0.080, rel=1e-12) and computed.time_ratio == pytest.approx(1.0, rel=1e-9)
    oscillation = "oscillation = { centre = 60, amplitude = 20, period = 1 }"
    (computed,) = strokes(motion_of(mechviz.loads(FOUR_BAR.replace('speed = "60 rpm", start = 17', oscillation))))
    assert np.isnan(computed.time_ratio), "the drive turns back, not the mechanism"


def test_the_velocity_may_jump_where_an_output_turns_back():
    """A cam of constant acceleration rises and returns over half a turn each."""
    scene = mechviz.load("cam-constant-acceleration")
    (computed,) = strokes(motion_of(scene))
    assert computed.time_ratio == pytest.approx(1.0, rel=1e-9)


def test_check_names_the_limits_that_only_a_run_can_judge():
    text = FOUR_BAR.replace('drive = { speed = "60 rpm", start = 17 }', "free = { position = 17 }").replace(
        "rod = { ", 'rod = { mass = 1, shape = "bar", '
    )
    loads = (
        'S = { spring = ["frame.D", "crank.B"], stiffness = "1 N/mm", free_length = 90, solid_length = 60 }\n'
        'G = { gas_spring = ["frame.A", "rocker.C"], thrust = "50 N", extended = 400, gas_length = 380 }\n'
    )
    run = 'effects = ["inertia"]\nrun = { duration = "0.1 s" }\n'
    lines = [" ".join(line.split()) for line in check_lines(mechviz.loads(run + text + loads))]
    assert "a run tells whether S is squeezed below its solid length" in lines
    assert "tells whether G stays within its stroke" in lines
    assert not any("tells whether" in line for line in check_lines(mechviz.loads(FOUR_BAR + loads)))
