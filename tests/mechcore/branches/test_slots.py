"""Slots, guides and cylinders with ends: prescribed motion beyond them is refused, free motion strikes them."""

from __future__ import annotations

import numpy as np
import pytest

import mechviz
from mechcore.dynamics.rest.steady import steady_run
from mechcore.dynamics.simulate import simulate
from mechcore.errors import MechanismError
from mechcore.motion.reach import reachable_ranges
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechviz.runs import run_scene
from mechviz.scene.faults import SceneError
from mechviz.studies.report import check_lines

# A Geneva drive while it is engaged: crank 50 mm, wheel's pivot 50 sqrt(2) mm away, four slots; the pin enters at 45 degrees.
GENEVA = """
units = { length = "mm", angle = "deg" }
[links]
frame = { points = { O = [0, 0], W = [70.71067811865476, 0] } }
crank = { points = { O = [0, 0], P = [50, 0] } }
wheel = { points = { W = [0, 0] } }
[joints]
O = { revolute = ["frame", "crank"], drive = { DRIVE } }
W = { revolute = ["frame", "wheel"] }
P = { pin_slot = ["wheel", "crank"], at = ["W", "P"], along = [-1, 0], length = LENGTH, branch = "ahead" }
"""
SWING = 'oscillation = { centre = 0, amplitude = AMPLITUDE, period = "1 s" }'


def geneva(drive: str, length: str) -> str:
    return GENEVA.replace("DRIVE", drive).replace("LENGTH", length)


def swung(amplitude: float, length: str, frames: int = 100):
    mechanism = mechviz.loads(geneva(SWING.replace("AMPLITUDE", str(amplitude)), length)).mechanism
    compiled = compile_mechanism(mechanism)
    return compiled, solve_motion(compiled, default_times(mechanism, frames))


@pytest.mark.parametrize("frames", [360, 7])
def test_a_geneva_drive_that_turns_on_is_refused_where_its_pin_leaves_the_slot(frames):
    """Engaged from -45 to 45 degrees, where the pin is 50 mm from the wheel's pivot; at 0 it is deepest, at 20.7 mm, and at 180,
    between two of seven frames, farthest out."""
    with pytest.raises(MechanismError) as refused:
        run_scene(mechviz.loads(geneva('speed = "60 rpm"', "50")), frames=frames)
    (fault,) = refused.value.faults
    assert fault.path == "joints.P" and "the pin leaves its slot for positions of drive O from" in fault.message
    assert "beyond the end at 50 mm" in fault.message and "70.7107 mm beyond" in fault.message
    assert "keep the drive within [-45°, 45°]" in fault.remedy


def test_ends_are_met_exactly():
    compiled, motion = swung(44.9, "[20.7, 50]")
    assert motion.coordinate("P")[:, 0].max() < 0.05
    (low, high), *_ = reachable_ranges(compiled)
    assert np.degrees([low, high]) == pytest.approx([-45.0, 45.0], abs=1e-7)
    with pytest.raises(MechanismError, match="beyond the end at 50 mm"):
        swung(45.1, "[20.7, 50]")
    with pytest.raises(MechanismError, match=r"beyond the end at 21 mm"):
        swung(44.9, "[21, 50]")


def test_a_pin_that_leaves_its_slot_between_two_frames_is_refused():
    """With 4 n + 2 frames none is at the ends of the swing: there the pin is beyond its end for less than a frame."""
    end = 1e3 * swung(44.0, "100", 10)[1].coordinate("P")[:, 0].max()
    with pytest.raises(MechanismError) as refused:
        swung(44.0, repr(float(end) + 1e-3), 10)
    assert "(drive O at" in refused.value.faults[0].message
    swung(44.0, "49.41", 10)


def test_drives_of_mechanisms_that_are_followed_end_with_the_slot_too():
    """With gears the way is followed from the start; the reachable range ends where the pin reaches an end of its slot."""
    text = geneva('speed = "60 rpm"', "[20, 60]").replace("O = [0, 0], W", "O = [0, 0], Z = [-40, 0], W")
    text = text.replace("[joints]", "pinion = { points = { Z = [0, 0] } }\n[joints]")
    text += 'Z = { revolute = ["frame", "pinion"] }\nG = { gear = ["crank", "pinion"], teeth = [20, 20] }\n'
    compiled = compile_mechanism(mechviz.loads(text).mechanism)
    assert compiled.needs_path
    (low, high), *_ = reachable_ranges(compiled)
    limit = np.degrees(np.arccos((50.0**2 + 5000.0 - 3600.0) / (2.0 * 50.0 * 70.71067811865476)))
    assert np.degrees([low, high]) == pytest.approx([-limit, limit], abs=1e-6)


def falling(length: str, stops: str = "", start: float = 0.0) -> str:
    """A crank with a heavy pin that falls from the level; its pin comes to the mouth of the slot 45 degrees below."""
    text = geneva("", length).replace("drive = {  }", f"free = {{ position = {start} }}")
    text = text.replace('branch = "ahead" }', f'branch = "ahead"{stops} }}')
    text = text.replace(
        "[links]", 'effects = ["inertia", "gravity"]\nrun = { frames = 200, duration = "0.5 s", tolerance = 1e-10 }\n[links]'
    )
    text = text.replace("P = [50, 0] } }", 'P = [50, 0] }, mass = 1, centre = "P", inertia = 0 }')
    return text.replace("W = [0, 0] } }", 'W = [0, 0] }, mass = 1, centre = "W", inertia = "1e-4 kg m^2" }')


def energy(motion) -> np.ndarray:
    """Kinetic and potential energy of the crank's pin and of the wheel [J]."""
    place, rate = motion.point("crank", "P"), motion.point("crank", "P", 1)
    return 0.5 * (rate**2).sum(axis=-1) + 0.5e-4 * motion.velocity("wheel")[:, 2] ** 2 + 9.81 * place[:, 1]


def test_a_free_pin_strikes_the_end_of_its_slot_and_stays_there():
    run = run_scene(mechviz.loads(falling("50")))
    place, angle = run.motion.coordinate("P")[:, 0], np.degrees(run.motion.coordinate("O")[:, 0])
    struck = angle <= -45.0 + 1e-6
    assert struck.any() and not struck[0] and place.max() <= 0.05 + 1e-12
    np.testing.assert_allclose(angle[struck], -45.0, atol=1e-6)
    np.testing.assert_allclose(energy(run.motion)[~struck], 0.0, atol=1e-9)
    ends = [(s.name, round(s.at, 12), s.side) for s in run.simulation.stops]
    assert ends == [("P lower end", 0.0, "lower"), ("P upper end", 0.05, "upper")]
    assert any(h.item == "P upper end" for h in run.simulation.events)


def test_a_stated_stop_comes_before_the_end_behind_it():
    scene = mechviz.loads(falling("[5, 50]", ', stops = [{ at = 45, side = "upper", restitution = 1 }]'))
    assert [(s.name, s.restitution) for s in scene.simulation.stops] == [("P upper", 1.0), ("P lower end", 0.0)]
    motion = run_scene(scene).motion
    assert motion.coordinate("P")[:, 0].max() <= 0.045 + 1e-9
    np.testing.assert_allclose(energy(motion), 0.0, atol=1e-8)


def test_the_core_meets_the_ends_of_slots_by_itself():
    simulation = simulate(mechviz.loads(falling("50")).mechanism, 0.5, tolerance=1e-9)
    assert simulation.motion(np.linspace(0.0, 0.5, 51)).coordinate("P")[:, 0].max() <= 0.05 + 1e-9


def test_a_free_motion_that_starts_beyond_an_end_is_refused():
    with pytest.raises(MechanismError, match="'P upper end'"):
        run_scene(mechviz.loads(falling("50", start=-60.0)))


def test_a_steady_run_does_not_pass_the_ends_of_slots():
    text = geneva('speed = "60 rpm"', "50").replace('drive = { speed = "60 rpm" }', 'free = { speed = "60 rpm" }')
    text = text.replace("[links]", 'effects = ["inertia"]\nrun = { duration = "1 s" }\n[links]')
    text = text.replace("P = [50, 0] } }", 'P = [50, 0] }, mass = 1, centre = "O", inertia = "0.01 kg m^2" }')
    with pytest.raises(MechanismError, match="the pin leaves its slot"):
        steady_run(mechviz.loads(text).mechanism)


def test_check_tells_how_far_a_pin_goes_in_a_slot_without_ends():
    """A Geneva drive that goes on as a crank: the pin is 20.7 mm to 120.7 mm from the wheel's pivot, 70.7 mm more than it may."""
    text = geneva('speed = "60 rpm"', "LENGTH").replace(", length = LENGTH", "")
    (line,) = (line for line in check_lines(mechviz.loads(text)) if line.startswith("slot"))
    assert "P: its pin goes from 20.7107 mm to 120.711 mm; the slot has no length" in line
    assert not any(line.startswith("slot") for line in check_lines(mechviz.loads(geneva(SWING.replace("AMPLITUDE", "40"), "50"))))


def test_the_travel_of_a_pin_is_that_between_frames_too():
    """A Scotch yoke that starts at 7 degrees: no frame is at the ends of the slot."""
    text = """
units = { length = "mm", angle = "deg" }
run = { frames = 36 }
links.frame.points.O = [0, 0]
links.crank.points = { O = [0, 0], A = [50, 0] }
links.yoke.points.Q = [0, 0]
[joints]
O = { revolute = ["frame", "crank"], drive = { speed = "60 rpm", start = 7 } }
S = { prismatic = ["frame", "yoke"], at = ["O", "Q"] }
A = { pin_slot = ["yoke", "crank"], at = ["Q", "A"], along = [0, 1] }
"""
    (line,) = (line for line in check_lines(mechviz.loads(text)) if line.startswith("slot"))
    assert "its pin goes from -50 mm to 50 mm" in line


SLIDER = """
units = { length = "mm", angle = "deg" }
[links]
frame = { points = { O = [0, 0] } }
crank = { points = { O = [0, 0], P = [40, 0] } }
rod = { points = { P = [0, 0], Q = [100, 0] } }
block = { points = { Q = [0, 0] } }
[joints]
O = { revolute = ["frame", "crank"], drive = { speed = "60 rpm" } }
P = { revolute = ["crank", "rod"] }
Q = { revolute = ["rod", "block"] }
S = { prismatic = ["frame", "block"], at = ["O", "Q"], length = LENGTH, branch = "ahead" }
"""


def test_a_slider_does_not_leave_its_guide():
    """Between 60 and 140 mm from the crank's pin; a guide that ends at 130 mm lets it turn from where cosine's rule has it."""
    run_scene(mechviz.loads(SLIDER.replace("LENGTH", "140")))
    with pytest.raises(MechanismError) as refused:
        run_scene(mechviz.loads(SLIDER.replace("LENGTH", "[50, 130]")).changed({("joints", "O", "drive", "start"): 180}))
    (fault,) = refused.value.faults
    assert fault.path == "joints.S" and "the slider leaves its guide" in fault.message and "10 mm beyond" in fault.message
    limit = np.degrees(np.arccos((40.0**2 + 130.0**2 - 100.0**2) / (2.0 * 40.0 * 130.0)))
    assert f"keep the drive within [{limit:.7g}°, {360.0 - limit:.7g}°]" in fault.remedy


def test_a_cylinder_does_not_leave_its_stroke():
    """A boom lifted by a cylinder of 330 to 450 mm; under its weight alone the boom comes to rest on the shortest one."""
    text = """
    units = { length = "mm", angle = "deg" }
    effects = ["inertia", "gravity"]
    [links]
    frame = { points = { A = [0, 0], B = [300, -200] } }
    boom = { points = { A = [0, 0], C = [300, 0] }, mass = 10, centre = "C", inertia = 0.1 }
    [joints]
    A = { revolute = ["frame", "boom"] }
    L = { cylinder = ["frame", "boom"], at = ["B", "C"], length = [330, 450], side = "right", MOVES }
    """
    driven = text.replace("MOVES", "drive = { speed = 100, start = 340, travel = WAY }")
    run_scene(mechviz.loads(driven.replace("WAY", "110")))
    with pytest.raises(MechanismError, match=r"it leaves its stroke .* 10 mm beyond the end at 450 mm"):
        run_scene(mechviz.loads(driven.replace("WAY", "120")))
    free = text.replace("MOVES", "free = { position = 400 }").replace("[links]", 'run = { duration = "1.5 s" }\n[links]')
    length = run_scene(mechviz.loads(free)).motion.coordinate("L")[:, 0]
    assert length.min() >= 0.33 - 1e-9 and length[-1] == pytest.approx(0.33, abs=1e-9)


@pytest.mark.parametrize(
    ("length", "path", "words"),
    [
        ("-5", "joints.P.length", "negative"),
        ("0", "joints.P.length", "zero"),
        ("[50, 20]", "joints.P.length", "ends where it begins"),
        ("[50]", "joints.P.length", ""),
        ('"5 kg"', "joints.P.length", "mass"),
    ],
)
def test_lengths_that_are_none(length, path, words):
    with pytest.raises(SceneError) as refused:
        mechviz.loads(geneva('speed = "60 rpm"', length))
    assert refused.value.faults[0].path.startswith(path) and words in refused.value.faults[0].message
