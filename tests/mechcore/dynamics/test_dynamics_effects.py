"""Every effect in forward dynamics: works against potentials, losses, balances, tables read at their arguments."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mechviz
from mechcore.dynamics.equations.charts import curve_around
from mechcore.dynamics.equations.curve import CurveEquations
from mechcore.dynamics.equations.reduced import reduce
from mechcore.dynamics.events import EndStop
from mechcore.dynamics.simulate import simulate
from mechcore.dynamics.simulation import work_integrals
from mechcore.effects.base import power_of
from mechcore.effects.registry import LOADS, effects_of
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import LOSSES
from mechcore.laws.timed import Free
from mechcore.motion.events import find_events
from mechcore.motion.solve import compile_mechanism
from mechcore.spec import loads
from mechcore.spec.loads import GasSpring
from mechcore.spec.mechanism import Drive, Link, Mechanism
from mechviz.hard_cases.mechanisms import pin
from mechviz.runs import run_scene
from mechviz.studies.report import check_lines

FOUR_BAR = """
units = { length = "mm", angle = "deg" }
effects = ["inertia", "gravity"]
run = { duration = "0.12 s", tolerance = 1e-8 }
[links]
frame = { points = { A = [0, 0], D = [200, 0], H = [40, 160] } }
crank = { points = { A = [0, 0], B = [60, 0] }, mass = "1.4 kg", centre = [20, 5], inertia = "0.004 kg m^2" }
coupler = { points = { B = [0, 0], C = [180, 0], E = [90, 70] }, mass = "0.8 kg", centre = [90, 20], inertia = "0.003 kg m^2" }
rocker = { points = { D = [0, 0], C = [150, 0] }, mass = "0.9 kg", centre = [60, 0], inertia = "0.002 kg m^2" }
[joints]
A = { revolute = ["frame", "crank"], free = { position = 40, speed = "90 rpm" } }
B = { revolute = ["crank", "coupler"] }
C = { revolute = ["coupler", "rocker"], side = "left" }
D = { revolute = ["rocker", "frame"] }
[loads]
"""


@pytest.mark.parametrize("moment", [1.5, -1.5])
def test_a_motion_that_turns_back_once_goes_on_the_other_way(moment: float):
    """By its energy: a torque brings it to rest and then drives it through turn after turn, as in steps of time."""
    text = FOUR_BAR + f'push = {{ torque = "{moment} N m", on = "coupler", against = "crank" }}\n'
    mechanism = mechviz.loads(text).mechanism
    computed, steps = simulate(mechanism, 0.3), simulate(mechanism, 0.3, method="gauss", tolerance=1e-11)
    assert computed.method == "energy"
    t = np.linspace(0.0, 0.3, 61)
    assert np.abs(computed(t)[0]).max() > 2 * np.pi
    for ours, theirs in zip(computed(t)[:2], steps(t)[:2], strict=True):
        assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-9)


SLIDER = """
units = { length = "mm", angle = "deg" }
effects = ["inertia", "gravity"]
run = { duration = "0.2 s", tolerance = 1e-8 }
[links]
frame = { points = { A = [0, 0], H = [60, 140], W = [-200, 0] } }
crank = { points = { A = [0, 0], B = [40, 0] }, mass = "3 kg", centre = [10, 0], inertia = "0.05 kg m^2" }
coupler = { points = { B = [0, 0], C = [150, 0], E = [70, 30] }, mass = "0.6 kg", centre = [60, 0], inertia = "0.003 kg m^2" }
piston = { points = { C = [0, 0] }, mass = "0.9 kg" }
fan = { points = { W = [0, 0] }, mass = "1 kg", inertia = "0.01 kg m^2" }
[joints]
A = { revolute = ["frame", "crank"], free = { position = 40, speed = "200 rpm" } }
B = { revolute = ["crank", "coupler"] }
C = { revolute = ["coupler", "piston"] }
S = { prismatic = ["frame", "piston"], at = ["A", "C"], branch = "ahead" }
W = { revolute = ["frame", "fan"] }
V = { belt = ["crank", "fan"], radii = ["60 mm", "30 mm"] }
[loads]
belt = { belt_tension = "V", slack = "90 N", coefficient = 0.3 }
windage = { viscous = "V", linear = "0.8 N s/m" }
fan = { drag = "fan", quadratic = "0.0004 N m s^2/rad^2" }
oil = { viscous = "S", linear = "15 N s/m" }
"""

CHAIN = """
units = { length = "mm", angle = "deg" }
effects = ["inertia", "gravity"]
run = { duration = "0.1 s", tolerance = 1e-8 }
[links]
frame = { points = { A = [0, 0], H = [300, 250] } }
crank = { points = { A = [0, 0], B = [260, 0] }, mass = "1.4 kg", centre = [120, 5], inertia = "0.04 kg m^2" }
coupler = { points = { B = [0, 0], C = [180, 0], E = [90, 70] }, mass = "0.8 kg", centre = [90, 20], inertia = "0.013 kg m^2" }
[joints]
A = { revolute = ["frame", "crank"], LEAD }
B = { revolute = ["crank", "coupler"], free = { position = 50, speed = "-20 rpm" }STOPS }
[loads]
"""
STOPS = ', stops = [{ at = 42, side = "lower", restitution = 0.5 }, { at = 70, side = "upper" }]'
FREE, DRIVEN = (
    'free = { position = 20, speed = "30 rpm" }',
    'drive = { oscillation = { centre = 20, amplitude = 25, period = "0.3 s" } }',
)

GASES = (
    'compressor = { suction = "1 bar", delivery = "3 bar" }',
    "four_stroke = { ratio = 8, rise = 2.5 }",
    'diagram = { displacement = [0, 30, 80], outward = ["3 bar", "1.5 bar", "1 bar"], inward = ["4 bar", "2 bar", "1 bar"] }',
)
TABLES = {  # argument of a factor -> where its table has points
    "position": ("deg", 120.0, ""),
    "velocity": ("rpm", 300.0, ""),
    "time": ("s", 0.5, ""),
    "x": ("mm", 400.0, ', point = "coupler.E"'),
    "y": ("mm", 400.0, ', point = "coupler.E"'),
    "vx": ("m/s", 2.0, ', point = "coupler.E"'),
    "vy": ("m/s", 2.0, ', point = "coupler.E"'),
    "speed": ("m/s", 2.0, ', point = "coupler.E"'),
}


def random_loads(rng: np.random.Generator) -> dict[str, str]:
    """A load of every kind that goes with any mechanism of crank and coupler, with random parameters."""

    def some(low: float, high: float) -> str:
        return f"{rng.uniform(low, high):.6g}"

    result = {
        "force": f"force = [{some(-9, 9)}, {some(-9, 9)}], on = 'coupler', at = 'E', axes = 'link'",
        "between": f"force = [{some(-9, 9)}, 3], on = 'coupler', at = 'B', against = 'crank'",
        "torque": f"torque = '{some(-1, 1)} N m', on = 'coupler', against = 'crank'",
        "spring": f"spring = ['frame.H', 'coupler.E'], stiffness = '{some(0.1, 0.6)} N/mm', free_length = {some(50, 200)}",
        "damper": f"damper = ['frame.H', 'coupler.E'], linear = '{some(1, 8)} N s/m', quadratic = '2 N s^2/m^2'",
        "gas": f"gas_spring = ['frame.H', 'coupler.E'], thrust = '{some(5, 20)} N', extended = 900, gas_length = 1100",
        "twist": f"torsion_spring = ['crank', 'coupler'], stiffness = '{some(0.2, 1)} N m/rad', free_angle = {some(-40, 40)}",
        "film": f"torsion_damper = ['crank', 'coupler'], linear = '{some(0.01, 0.05)} N m s/rad'",
        "air": f"drag = 'coupler.E', linear = '{some(0.5, 3)} N s/m', quadratic = '{some(0.5, 3)} N s^2/m^2'",
        "water": f"drag = 'coupler', linear = '{some(0.005, 0.02)} N m s/rad', quadratic = '{some(0, 0.003)} N m s^2/rad^2'",
        "grease": f"viscous = 'B', linear = '{some(0.01, 0.04)} N m s/rad'",
        "dc": f"dc_motor = 'A', stall_torque = '{some(1, 4)} N m', no_load_speed = '300 rpm'",
        "mains": "induction_motor = 'A', breakdown_torque = '2 N m', breakdown_slip = 0.3, synchronous_speed = "
        f"'{some(60, 250)} rpm'",
        "power": f"constant_power = 'A', power = '{some(5, 20)} W', torque_limit = '2 N m'",
        "governor": f"governor = 'coupler', set_speed = '100 rpm', gain = '{some(0.02, 0.1)} N m s/rad', limits = [-1, 2]",
    }
    for of, (unit, wide, more) in TABLES.items():
        at = [f"'{x:.6g} {unit}'" for x in np.linspace(-wide, wide, 7) + rng.uniform(-0.1, 0.1, 7) * wide]
        factors = [float(some(-1, 1)) for _ in range(7)]
        load = (
            "torque = '0.6 N m', on = 'coupler'" if of in ("position", "velocity") else "force = [3, 2], on = 'coupler', at = 'C'"
        )
        joint = ", joint = 'B'" if of in ("position", "velocity") and rng.random() < 0.5 else ""
        result[f"table {of}"] = f"{load}, table = {{ {of} = [{', '.join(at)}], factor = {factors}, smooth = false{more}{joint} }}"
        per = f"'{wide:g} {unit}'"
        result[f"polynomial {of}"] = (
            f"{load}, polynomial = {{ of = '{of}', coefficients = [{some(-1, 1)}, {some(-1, 0)}], per = {per}{more}{joint} }}"
        )
    return result | {
        "jack": f"actuator = ['frame.H', 'coupler.E'], thrust = '{some(-9, 9)} N', sine = {{ frequency = '{some(2, 9)} Hz' }}",
        "step": f"torque = '{some(-1, 1)} N m', on = 'coupler', step = {{ at = '{some(0.02, 0.1)} s' }}",
        "chirp": f"force = [{some(-9, 9)}, 2], on = 'coupler', at = 'C', chirp = {{ frequencies = [1, 40], duration = 0.1 }}",
        "servo": f"servo = 'B', target = {{ oscillation = {{ amplitude = {some(5, 30)}, frequency = '3 Hz' }} }}, "
        f"proportional = '{some(0.1, 0.4)} N m/rad', derivative = '0.01 N m s/rad', integral = '{some(0.2, 2)} N m/(rad s)'",
        "rubber": f"bushing = ['crank.A', 'coupler.E'], stiffness = ['{some(2, 5)} N/m', '3 N/m', '0.05 N m/rad'], "
        f"free_angle = {some(-40, 40)}, linear = ['{some(0.1, 1)} N s/m', '1 N s/m', '0.01 N m s/rad']",
    }


def written(some: dict[str, str]) -> str:
    return "".join(f"'{name}' = {{ {text} }}\n" for name, text in some.items())


KINDS = tuple(random_loads(np.random.default_rng(0)))
CASES = {
    "one freedom": FOUR_BAR,
    "two freedoms": CHAIN.replace("LEAD", FREE).replace("STOPS", ""),
    "stops": CHAIN.replace("LEAD", FREE).replace("STOPS", STOPS),
    "driven": CHAIN.replace("LEAD", DRIVEN).replace("STOPS", STOPS),
}


def checked(text: str) -> Any:
    """The motion under the forces of a scene, with the work of each: it lowers that force's potential or is lost; all together
    they are the change of kinetic energy, less what impacts take."""
    scene = mechviz.loads(text)
    assert mechviz.loads(scene.to_toml()) == scene and scene.simulation is not None
    mechanism, end = scene.mechanism, scene.simulation.duration
    simulation = simulate(mechanism, end, tolerance=1e-8, stops=scene.simulation.stops)
    wanted = [e for e in effects_of(mechanism) if "accelerations" not in e.needs]

    def powers(t: np.ndarray) -> np.ndarray:
        view = simulation.view(t)
        parts = [
            (rows, [sum((power_of(m, w) for w in e.wrenches(m)), np.zeros(len(rows))) for e in wanted]) for rows, m in view.parts
        ]
        out = np.zeros((len(t), len(wanted) + 1))
        for rows, values in parts:
            out[rows, :-1] = np.stack(values, axis=1)
        drives = [d.joint for d in view.mechanism.drives]
        if drives:
            out[:, -1] = simulation.forces(view).power(drives[0])
        return out

    edges = np.unique(np.concatenate([simulation.boundaries(), [0.0, end]]))
    t = np.linspace(0.0, end, 41)
    works = work_integrals(powers, edges)(t)
    kinetic = simulation.kinetic_energy(t)
    lost = np.array(
        [sum(e for at, e in simulation.impact_losses if at < x) - sum(e for at, e in simulation.impact_works if at < x) for x in t]
    )
    size = max(np.abs(works).max(), np.ptp(kinetic))
    assert kinetic - kinetic[0] == pytest.approx(works.sum(axis=1) - lost, abs=1e-6 * size)
    for e, work in zip(wanted, works.T, strict=False):
        if e.stores:
            view = simulation.view(t)
            stored = np.empty(len(t))
            for rows, m in view.parts:
                stored[rows] = e.potential(m)
            assert work == pytest.approx(stored[0] - stored, abs=1e-8 * size), e.name
        elif e.cause in LOSSES:
            assert np.all(np.diff(work) <= 1e-12 * size) and work[-1] < 0.0, e.name
    view = simulation.view(t)
    assert np.abs(simulation.forces(view).power_balance).max() < 1e-9
    return simulation


@pytest.mark.sample(4)
@pytest.mark.parametrize("half", [0, 1])
@pytest.mark.parametrize("case", list(CASES))
def test_the_work_of_every_load_is_accounted_for(case: str, half: int):
    drawn = random_loads(np.random.default_rng([half, len(case)]))
    result = checked(CASES[case] + written({kind: drawn[kind] for kind in KINDS[half::2]}))
    assert any(h.kind == "impact" for h in result.events) == (case in ("stops", "driven"))


@pytest.mark.parametrize("gas", GASES)
def test_gas_belts_and_their_losses_are_accounted_for(gas: str):
    checked(SLIDER + f'gas = {{ gas = "S", bore = 40, top = 190, stroke = 80, {gas} }}\n')


def test_no_kind_of_load_is_left_out():
    """Journals are in the tests of clearance."""
    texts = [
        FOUR_BAR + written(random_loads(np.random.default_rng(1))),
        SLIDER + f'g = {{ gas = "S", bore = 40, top = 190, stroke = 80, {GASES[0]} }}',
    ]
    seen = {type(load) for text in texts for load in mechviz.loads(text).mechanism.loads}
    assert seen | {loads.JournalContact, loads.JournalLoss} == set(LOADS)


@pytest.mark.parametrize("of", list(TABLES))
def test_a_load_by_table_is_read_where_the_mechanism_is(of: str):
    """Along the motion that it makes, the recorded load is the table at the recorded argument."""
    text = random_loads(np.random.default_rng(7))[f"table {of}"]
    scene = mechviz.loads(CHAIN.replace("LEAD", FREE).replace("STOPS", "") + f"'by table' = {{ {text} }}")
    simulation = simulate(scene.mechanism, 0.4, tolerance=1e-8)
    view = simulation.view(np.linspace(0.0, 0.4, 60))
    (load,) = scene.mechanism.loads
    joint = load.factor.joint or "A"
    e, v = view.point("coupler", "E"), view.point("coupler", "E", 1)
    q = view.coordinate(joint)
    argument = {
        "position": q[:, 0], "velocity": q[:, 1], "time": view.time, "x": e[:, 0], "y": e[:, 1], "vx": v[:, 0], "vy": v[:, 1],
        "speed": np.hypot(*v.T),
    }[of]  # fmt: skip
    table = load.factor.function
    factor = np.interp(argument, table.x, table.y)
    values = simulation.forces(view).loads["by table"].values
    whole = 0.6 * factor if of in ("position", "velocity") else 3.0 * factor
    assert values[:, 2 if of in ("position", "velocity") else 0] == pytest.approx(whole, rel=1e-9, abs=1e-12)
    assert np.ptp(factor) > 1e-3


def hatch(stops=(), speed=0.0, end=1.2):
    """A hatch on a gas strut, which ends at 0.476 rad; a whole turn of the hatch would pull the strut out of its range."""
    strut = GasSpring(name="strut", links=("frame", "hatch"), points=("P", "Q"), force=60.0, extended=0.6, gas_length=0.7)
    mechanism = Mechanism(
        name="hatch",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0), "P": (0.0, -0.3)}),
            Link(name="hatch", points={"O": (0.0, 0.0), "Q": (0.4, 0.0)}, mass=4.0, centre=(0.5, 0.0), inertia=0.3),
        ),
        joints=(pin("O", "frame", "hatch"),),
        drives=(Drive(joint="O", law=Free(0.3, speed)),),
        effects=("inertia", "gravity"),
        loads=(strut,),
    )
    return simulate(mechanism, end, tolerance=1e-10, stops=stops)


@pytest.mark.parametrize("stops", [(), (EndStop(name="end", joint="O", at=0.45, restitution=0.4),)])
def test_a_gas_spring_is_asked_only_where_the_motion_goes(stops):
    """Its table over a turn, and windows that reach beyond a stop, try lengths that it does not have; energy is kept between."""
    lines = hatch(stops, speed=1.5 if stops else 0.0)
    t = np.linspace(0.0, 1.2, 49)
    motion = lines.motion(t)
    length = np.hypot(*(motion.point("hatch", "Q") - [0.0, -0.3]).T)
    assert length.max() < 0.6
    angle, rate, _ = motion.coordinate("O").T
    stored = -60.0 * 0.7 * np.log(1.0 - (0.6 - length) / 0.7)
    energy = 0.5 * (0.3 + 4.0 * 0.25) * rate**2 + 4.0 * 9.81 * 0.5 * np.sin(angle) + stored
    lost = sum(e for _, e in lines.impact_losses)
    assert bool(lost) == bool(stops)
    struck = np.array([sum(e for at, e in lines.impact_losses if at < x) for x in t])
    np.testing.assert_allclose(energy + struck, energy[0], rtol=0, atol=1e-8 * np.abs(energy).max())


def test_a_gas_spring_that_the_motion_pulls_out_of_its_range_is_refused():
    with pytest.raises(MechanismError, match=r"loads\.strut: it is pulled to 60\d\.\d* mm, beyond its extended length of 600 mm"):
        hatch(speed=6.0)


STRUCK = """
effects = ["inertia", "gravity"]
run = { frames = 60, duration = "2.1 s", tolerance = 1e-10 }
[links]
frame = { points = { O = [0, 0] } }
rod = { points = { O = [0, 0], G = [1, 0] }, mass = 1, centre = "G", inertia = 0.1 }
[joints]
O = { revolute = ["frame", "rod"], free = { position = 0 } }
[loads.F]
force = [0, 5]
on = "rod"
at = "G"
table = { time = [0, 1.8, 1.82, 1.84, 1.86, 1.9, 2.1], factor = [0, 0, -0.2, -0.5, -0.6, 0, 0], smooth = true }
"""


def test_a_load_that_is_zero_moves_nothing_however_its_rows_lie():
    """Until the first row that is not zero the rod swings as without the load; a spline through the rows moved it by a metre."""
    struck = run_scene(mechviz.loads(STRUCK))
    alone = run_scene(mechviz.loads(STRUCK).changed({("loads", "F"): None}))
    before = struck.motion.time <= 1.8
    swings, swing = (r.motion.coordinate("O") for r in (struck, alone))
    np.testing.assert_allclose(swings[before], swing[before], atol=1e-9)
    assert abs(swings[-1, 0] - swing[-1, 0]) > 1e-3
    spline = mechviz.loads(STRUCK).changed({("loads", "F", "table", "smooth"): "spline"})
    assert any("F: the spline leaves its rows" in line and "row 1 and the next" in line for line in check_lines(spline))
    assert not any("spline" in line for line in check_lines(mechviz.loads(STRUCK)))
    (event,) = [e for e in find_events(run_scene(spline).motion) if "spline" in e.text]
    assert event.level == "WARN" and event.item == "F" and event.value > 1.0


DAMPED = (
    FOUR_BAR
    + """
oil = { viscous = "D", linear = "0.02 N m s/rad" }
dash = { damper = ["frame.H", "coupler.E"], linear = "12 N s/m" }
air = { drag = "coupler.E", linear = "1.5 N s/m" }
push = { torque = "3 N m", on = "crank" }
"""
)


def test_what_is_in_proportion_to_speeds_is_tabulated():
    """The equations with the table are those of bodies and forces at the same states, and nothing is left to evaluate."""
    compiled = compile_mechanism(mechviz.loads(DAMPED).mechanism)
    curve, _ = curve_around(compiled, np.deg2rad(40.0), 1e-13)
    assert isinstance(curve, CurveEquations) and not curve.untabulated_effects and not curve.conservative
    rng = np.random.default_rng(3)
    q, v, t = rng.uniform(-9.0, 9.0, (40, 1)), rng.uniform(-20.0, 20.0, (40, 1)), np.zeros(40)
    exact = reduce(compiled, q, v, t).acceleration()
    np.testing.assert_allclose(curve(q, v, t), exact, rtol=1e-10, atol=1e-10 * np.abs(exact).max())
    by_q, by_v = (x[:, 0, 0] for x in curve.slopes(q, v, t, exact))
    h = 1e-5
    for slope, step in ((by_q, (h, 0.0)), (by_v, (0.0, h))):
        ahead, behind = (curve(q + sign * step[0], v + sign * step[1], t)[:, 0] for sign in (1.0, -1.0))
        np.testing.assert_allclose(slope, (ahead - behind) / (2.0 * h), rtol=1e-6, atol=1e-6 * np.abs(slope).max())


def test_a_table_is_made_once_for_all_motions_of_a_mechanism(monkeypatch):
    compiled = compile_mechanism(mechviz.loads(DAMPED).mechanism)
    t = np.linspace(0.0, 0.2, 11)
    first = simulate(compiled, 0.2)(t)
    stopped = simulate(compiled, 0.2, stops=[EndStop(name="far", joint="D", at=90.0)])(t)
    monkeypatch.setattr("mechcore.dynamics.simulate.curve_around", None)
    for ours, same, theirs in zip(simulate(compiled, 0.2)(t), first, stopped, strict=True):
        np.testing.assert_array_equal(ours, same)
        np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-8 * np.abs(theirs).max())


@pytest.mark.parametrize(("start", "speed", "push", "side"), [(30, 0.5, 3000, "upper"), (90, -0.5, -3000, "lower")])
def test_gas_keeps_to_the_stroke_that_led_to_rest_on_a_stop(start, speed, push, side):
    """A compressor held 50 mm before top dead centre: what was compressed stays so, and sucked in what was sucked in."""
    gas = "compressor = { suction = '1 bar', delivery = '7 bar', exponent = 1.3, clearance = 0.06 }"
    text = f"""
effects = ["inertia"]
run = {{ duration = "0.1 s", tolerance = 1e-8, frames = 41 }}
[links]
frame = {{ points = {{ A = [0, 0] }} }}
piston = {{ points = {{ A = [0, 0] }}, mass = "2 kg" }}
[joints.S]
prismatic = ["frame", "piston"]
at = ["A", "A"]
free = {{ position = "{start} mm", speed = "{speed} m/s" }}
stops = [{{ at = "60 mm", side = "{side}" }}]
[loads]
air = {{ gas = "S", bore = "80 mm", top = "100 mm", stroke = "80 mm", {gas} }}
push = {{ force = ["{push} N", 0], on = "piston", at = "A" }}
"""
    run = run_scene(mechviz.loads(text))
    pressure = 1e5 * ((0.08 + 0.06 * 0.08) / (0.04 + 0.06 * 0.08)) ** 1.3 if side == "upper" else 1e5
    expected = -(pressure - 101325.0) * np.pi / 4 * 0.08**2
    assert run.forces.loads["air"].values[-1, 0] == pytest.approx(expected, rel=1e-9)
    assert run.motion.coordinate("S")[-1] == pytest.approx([0.06, 0.0, 0.0], abs=1e-12)
