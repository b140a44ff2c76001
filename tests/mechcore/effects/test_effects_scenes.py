"""Loads in scene files: values in SI, faults with remedies, reading what was written."""

from __future__ import annotations

import math
import tomllib

import numpy as np
import pytest

import mechviz
from mechcore.laws.indicator import Compressor, FourStroke, FourStrokeDiagram, IndicatorDiagram
from mechcore.spec.loads import Damper, Drag, Force, GasPressure, GasSpring, Spring, Torque, TorsionDamper, TorsionSpring, Viscous
from mechviz.outputs.exports.tables import wide_table
from mechviz.runs import run_scene

BASE = """
units = { length = "mm", angle = "deg" }
[links]
frame  = { points = { A = [0, 0], H = [0, 200], "P.x" = [-50, 0] } }
crank  = { points = { A = [0, 0], B = [40, 0] } }
rod    = { points = { B = [0, 0], C = [150, 0] } }
piston = { points = { C = [0, 0], T = [20, 0] }, mass = 1, centre = "C", gravity = [0, "-1.62 m/s^2"] }
[joints]
A = { revolute = ["frame", "crank"], drive = { speed = "60 rpm" } }
B = { revolute = ["crank", "rod"] }
C = { revolute = ["rod", "piston"] }
S = { prismatic = ["frame", "piston"], at = ["A", "C"], along = [1, 0], branch = "ahead" }
[loads]
"""

CYLINDER = 'gas = "S", bore = 80, top = 190, stroke = 80'
ALL = """
force = { force = [10, 0], on = "piston", at = "T", against = "frame", table = $BY_SPEED }
torque = { torque = 2, on = "crank", polynomial = { of = "time", coefficients = [1, 2], per = "2 s" } }
wind = { force = [1, 0], on = "rod", at = "C", polynomial = { of = "speed", point = "rod.C", coefficients = [0, 0, 1] } }
spring = { spring = ["frame.P.x", "piston.T"], stiffness = "2 N/mm", free_length = 80, preload = 5 }
bare = { spring = ["frame.H", "crank.B"], stiffness = 2, free_length = 0, use = "useful" }
damper = { damper = ["frame.H", "rod.C"], linear = "20 N s/m", quadratic = "3 N s^2/m^2" }
strut = { gas_spring = ["frame.H", "rod.C"], thrust = "400 N", extended = 600, gas_length = 700, exponent = 1.2 }
hinge = { torsion_spring = ["frame", "crank"], stiffness = "3 N m/rad", free_angle = 90 }
brake = { torsion_damper = ["frame", "crank"], linear = "0.1 N m s/rad" }
water = { drag = "piston.T", linear = "3 N s/m" }
fan = { drag = "crank", quadratic = "0.002 N m s^2/rad^2" }
oil = { viscous = "A", linear = "0.02 N m s/rad" }
guide = { viscous = "S", linear = "5 N s/m" }
air = { $GAS, head = "ahead", back = "1 bar", compressor = { suction = "1 bar", delivery = "700 kPa" } }
motor = { $GAS, four_stroke = { ratio = 9, rise = 3 }, fires = 360, drive = "A" }
card = { $GAS, diagram = { displacement = [0, 80], outward = ["6 bar", 1e5], inward = [2e5, 1e5] } }
""".replace("$GAS", CYLINDER).replace("$BY_SPEED", '{ velocity = [-300, 300], factor = [1, -1], joint = "S" }')
FOUR = """
card = { $GAS, diagram = { displacement = [0, 80], power = [9e5, 2e5], exhaust = [1e5, 1e5], \
intake = [1e5, 1e5], compression = [8e5, 1e5] } }
""".replace("$GAS", CYLINDER)


def test_loads_in_si():
    scene = mechviz.loads(BASE + ALL)
    computed = {load.name: load for load in scene.mechanism.loads}
    assert list(computed) == list(tomllib.loads(ALL))
    force, torque = computed["force"], computed["torque"]
    assert isinstance(force, Force) and force.against == "frame" and force.factor.of == "velocity" and force.factor.joint == "S"
    assert force.factor([-0.3, 0.0, 0.3]) == pytest.approx([1.0, 0.0, -1.0])
    assert isinstance(torque, Torque) and torque.factor([2.0]) == pytest.approx([3.0])
    assert computed["wind"].factor.point == ("rod", "C") and computed["wind"].factor([0.002]) == pytest.approx([4.0])  # of mm/s
    spring = computed["spring"]
    assert spring == Spring(
        name="spring", links=("frame", "piston"), points=("P.x", "T"), stiffness=2000.0, free_length=0.08, preload=5.0
    )
    assert computed["bare"].stiffness == 2000.0 and computed["bare"].use == "useful"  # bare numbers: N/mm
    assert computed["damper"] == Damper(name="damper", links=("frame", "rod"), points=("H", "C"), linear=20.0, quadratic=3.0)
    assert computed["strut"] == GasSpring(
        name="strut", links=("frame", "rod"), points=("H", "C"), force=400.0, extended=0.6, gas_length=0.7, exponent=1.2
    )
    assert computed["hinge"] == TorsionSpring(name="hinge", links=("frame", "crank"), stiffness=3.0, free_angle=math.pi / 2)
    assert computed["brake"] == TorsionDamper(name="brake", links=("frame", "crank"), coefficient=0.1)
    assert computed["water"] == Drag(name="water", link="piston", point="T", linear=3.0)
    assert computed["fan"] == Drag(name="fan", link="crank", quadratic=0.002)
    assert computed["oil"] == Viscous(name="oil", joint="A", coefficient=0.02)
    assert computed["guide"] == Viscous(name="guide", joint="S", coefficient=5.0)
    air, motor, card = computed["air"], computed["motor"], computed["card"]
    assert isinstance(air, GasPressure) and air.area == pytest.approx(math.pi * 0.04**2) and air.top == 0.19 and air.back == 1e5
    assert air.cycle == Compressor(stroke=0.08, suction=1e5, delivery=7e5, exponent=1.3, clearance=0.05)
    assert motor.cycle == FourStroke(stroke=0.08, ratio=9.0, rise=3.0) and motor.fires == 2.0 * math.pi and motor.drive == "A"
    assert isinstance(card.cycle, IndicatorDiagram) and card.cycle.outward(0.04) == pytest.approx(3.5e5)
    (four,) = mechviz.loads(BASE + FOUR).mechanism.loads
    assert isinstance(four.cycle, FourStrokeDiagram) and four.cycle.compression(0.0) == pytest.approx(8e5)
    piston = next(link for link in scene.mechanism.links if link.name == "piston")
    assert piston.gravity == (0.0, -1.62)


def test_what_is_written_reads_back_the_same():
    scene = mechviz.loads(BASE + ALL + FOUR.replace("card", "card2"))
    again = mechviz.loads(scene.to_toml())
    assert again == scene and again.to_toml() == scene.to_toml()
    joints = zip(again.mechanism.loads, scene.mechanism.loads, strict=True)
    assert all(a == b for a, b in joints if not getattr(a, "factor", None) and not isinstance(a, GasPressure))


GAS = 's = { gas = "S", bore = 1, top = 1, stroke = 8, '
FORCE = 's = { force = [1, 0], on = "rod", at = "C", '
FAULTS = [
    (
        's = { sprng = ["frame.H", "crank.B"], stiffness = 2, free_length = 1 }',
        "loads.s",
        "unknown key 'sprng'",
        "Did you mean 'spring'?",
    ),
    ('s = { spring = ["frame.H", "crank.B"], free_length = 1 }', "loads.s", "'stiffness' is missing", 'stiffness = "2 N/mm"'),
    ('s = { spring = ["frame.H", "crank.B"], stiffness = "2 N", free_length = 1 }', "loads.s.stiffness", "a stiffness", "2 N/mm"),
    ('s = { spring = ["frame.H", "crank.B"], stiffness = -2, free_length = 1 }', "loads.s.stiffness", "negative", "positive"),
    ('s = { spring = ["frame.H", "crank.Q"], stiffness = 2, free_length = 1 }', "loads.s.spring[1]", "no point 'Q'", "'A', 'B'"),
    ('s = { spring = ["frame.H", "crnk.B"], stiffness = 2, free_length = 1 }', "loads.s.spring[1]", "'crnk.B'", "'crank.B'"),
    ('s = { spring = ["frame.H", "crank"], stiffness = 2, free_length = 1 }', "loads.s.spring[1]", "is a link", "'crank.A'"),
    ('s = { spring = ["frame.H", "frame.A"], stiffness = 2, free_length = 1 }', "loads.s.spring", "both points", "two links"),
    ('s = { spring = ["frame.H", "frame.H"], stiffness = 2, free_length = 1 }', "loads.s.spring", "and itself", "two different"),
    ('s = { spring = ["frame.H", "crank.B"], stiffness = 2, free_length = 1, linear = 2 }', "loads.s.linear", "not go", "damper"),
    ('s = { spring = ["frame.H"], stiffness = 2, free_length = 1 }', "loads.s.spring", "has 1 entry", "at least 2"),
    ('s = { damper = ["frame.H", "crank.B"] }', "loads.s", "neither linear nor quadratic", "linear ="),
    ('s = { damper = ["frame.H", "crank.B"], linear = 0 }', "loads.s", "does nothing", "Give one"),
    ('s = { damper = ["frame.H", "crank.B"], linear = "2 N m s/rad" }', "loads.s.linear", "a damping coefficient", "20 N s/m"),
    ('s = { torsion_spring = ["frame", "krank"], stiffness = 1 }', "loads.s.torsion_spring[1]", "no link 'krank'", "'crank'"),
    ('s = { torsion_spring = ["frame", "crank"], stiffness = "1 N/m" }', "loads.s.stiffness", "torsional stiffness", "N m/rad"),
    ('s = { drag = "frame", linear = "1 N m s/rad" }', "loads.s.drag", "fixed link", "moving"),
    ('s = { drag = "crank.Z", linear = 1 }', "loads.s.drag", "no point 'Z'", "'A', 'B'"),
    ('s = { viscous = "Z", linear = 1 }', "loads.s.viscous", "no joint 'Z'", "'A', 'B', 'C', 'S'"),
    (
        's = { gas = "A", bore = 1, top = 1, stroke = 1, compressor = { suction = 1, delivery = 2 } }',
        "loads.s.gas",
        "no sliding",
        "'S'",
    ),
    (GAS.rstrip(", ") + " }", "loads.s", "none of compressor", "one of them"),
    (GAS + "compressor = { suction = 2, delivery = 1 } }", "loads.s.compressor.delivery", "no more", "abs"),
    (
        GAS + "compressor = { suction = 1, delivery = 40, clearance = 0.3 } }",
        "loads.s.compressor.clearance",
        "nothing is sucked in",
        "less clearance",
    ),
    (GAS + 'compressor = { suction = "1 N", delivery = 2 } }', "loads.s.compressor.suction", "pressure", "6 bar"),
    (GAS + "four_stroke = { ratio = 1 } }", "loads.s.four_stroke.ratio", "no greater", "9"),
    (GAS + "four_stroke = { ratio = 9, exponent = 1900 } }", "loads.s.four_stroke.exponent", "more than 1e12 times", "1 and 2"),
    (GAS + "four_stroke = { ratio = 9, expansion = 1e300 } }", "loads.s.four_stroke.expansion", "more than 1e12 times", "1 and 2"),
    (GAS + "four_stroke = { ratio = 9, rise = 0.5 } }", "loads.s.four_stroke.rise", "less than 1", "at least 1"),
    (
        GAS + "diagram = { displacement = [0, 7], outward = [1, 1], inward = [1, 1] } }",
        "loads.s.diagram.displacement",
        "stroke is 8 mm",
        "0",
    ),
    (GAS + "diagram = { displacement = [0, 8], outward = [1, 1] } }", "loads.s.diagram", "has outward", "inward"),
    (GAS + "diagram = { displacement = [0, 8], outward = [1], inward = [1, 1] } }", "loads.s.diagram.outward", "1 entry", "2"),
    (FORCE + 'against = "rod" }', "loads.s.against", "against itself", "another"),
    (FORCE + "table = { speed = [0, 1], factor = [0, 1] } }", "loads.s.table", "which point", "point ="),
    (FORCE + "table = { time = [0, 1], position = [0, 1], factor = [0, 1] } }", "loads.s.table", "at once", "Keep one"),
    (FORCE + 'table = { time = [0, 1], factor = [0, 1], joint = "S" } }', "loads.s.table.joint", "not go with time", "out"),
    (
        FORCE + 'polynomial = { of = "spd", point = "rod.C", coefficients = [1] } }',
        "loads.s.polynomial.of",
        "'spd' is not one",
        "speed",
    ),
    (
        FORCE + 'polynomial = { of = "position", joint = "Q", coefficients = [1] } }',
        "loads.s.polynomial.joint",
        "no joint 'Q'",
        "Joints",
    ),
    (FORCE + "stiffness = 3 }", "loads.s.stiffness", "does not go with a force", "Leave out"),
    (FORCE + 'use = "bad" }', "loads.s.use", "'bad' is not one of", "one of these"),
]


@pytest.mark.parametrize(("line", "path", "message", "remedy"), FAULTS)
def test_faults_of_loads(line, path, message, remedy):
    with pytest.raises(mechviz.SceneError) as error:
        mechviz.loads(BASE + line)
    first = next((f for f in error.value.faults if f.path == path), None)
    assert first is not None, error.value
    assert message in first.message and remedy in first.remedy, first
    assert len(error.value.faults) == 1, error.value


OFFSET_ENGINE = """
units = { length = "mm", angle = "deg" }
run = { frames = 1440, cycles = 2 }
[links]
frame  = { points = { O = [0, 0], G = [0, OFFSET] } }
crank  = { points = { O = [0, 0], B = [40, 0] } }
rod    = { points = { B = [0, 0], C = [150, 0] } }
piston = { points = { C = [0, 0] } }
[joints]
O = { revolute = ["frame", "crank"], drive = { speed = "SPEED rpm", start = START } }
B = { revolute = ["crank", "rod"] }
C = { revolute = ["rod", "piston"] }
S = { prismatic = ["frame", "piston"], at = ["G", "C"], along = [1, 0], branch = "ahead" }
[loads]
g = { gas = "S", bore = 80, top = TOP, stroke = STROKE, four_stroke = { ratio = 9, rise = 3.2, exponent = 1.33 }, fires = FIRES }
"""


@pytest.mark.parametrize("start", [0.0, 200.0, 400.0])
@pytest.mark.parametrize("speed", [3000.0, -3000.0])
@pytest.mark.parametrize("offset", [8.0, -8.0, 60.0])
def test_strokes_change_where_the_piston_turns(offset, speed, start):
    """Off the crank's axis the dead centres are not half a turn apart: every stroke has its own pressure up to where it ends."""
    r, rod, e = 40.0, 150.0, offset
    top, bottom = math.sqrt((rod + r) ** 2 - e**2), math.sqrt((rod - r) ** 2 - e**2)
    fires = math.degrees(math.asin(e / (rod + r)))
    opens = math.degrees(math.asin(e / (rod - r))) + 180.0  # where the crank is at bottom dead centre
    values = {"OFFSET": e, "SPEED": speed, "START": start, "TOP": top, "STROKE": top - bottom, "FIRES": fires}
    text = OFFSET_ENGINE
    for key, value in values.items():
        text = text.replace(key, repr(value))
    run = run_scene(mechviz.loads(text))
    angle = np.degrees(run.motion.coordinate("O")[:, 0])
    x = top - (r * np.cos(np.radians(angle)) + np.sqrt(rod**2 - (e - r * np.sin(np.radians(angle))) ** 2))
    v = 1.0 + 8.0 * x / (top - bottom)
    turn = np.mod(angle - fires, 720.0) if speed > 0 else np.mod(fires - angle, 720.0)
    ends = opens - fires if speed > 0 else fires - opens + 360.0  # where the expansion does
    squeezed, p0 = 101325.0 * (9.0 / v) ** 1.33, 101325.0
    expected = np.where(turn < ends, 3.2 * 101325.0 * 9.0**1.33 * v**-1.33, np.where(turn < 360.0 + ends, p0, squeezed))
    edges = (0.0, ends, 360.0, 360.0 + ends)
    clear = np.min([np.abs(np.mod(turn - edge + 360.0, 720.0) - 360.0) for edge in edges], axis=0) > 1e-6
    force, area = wide_table(run)["g.load.Fx [N]"], 0.25 * math.pi * 0.08**2
    np.testing.assert_allclose(force[clear], -(expected - p0)[clear] * area, rtol=1e-9, atol=1e-6)
