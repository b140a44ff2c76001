"""Sensitivities of scenes: closed forms in the scene's own units, numbers of curves, what is refused."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import mechviz as mv
from mechcore.derivatives.exact import Derivatives
from mechcore.errors import MechanismError
from mechviz.__main__ import main
from mechviz.editor.parameters import place_key
from mechviz.runs import Run, run_scene
from mechviz.scene.document import value_at, with_values
from mechviz.scene.scene import Scene, load, loads
from mechviz.scene.units import split
from mechviz.studies.designs.measures import parse_measure
from mechviz.studies.designs.sensitivity import sensitivities, sensitivity
from mechviz.studies.designs.variables import variables_of


@pytest.fixture(scope="module")
def press():
    return run_scene(load("parametric-press"), frames=90)


def test_a_stroke_moves_a_ram_as_its_closed_form_says(press):
    slopes = sensitivity(press, "link.ram.position[x]", ["stroke", "ratio"])
    q = press.catalogue.coordinate("A")
    throw, rod = 40.0, 160.0  # mm
    root = np.sqrt(rod**2 - (throw * np.sin(q)) ** 2)
    by_throw = np.cos(q) + (4.0 * rod - throw * np.sin(q) ** 2) / root  # the rod is four throws long
    np.testing.assert_allclose(slopes.slopes[0], 0.5 * by_throw, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(slopes.slopes[1], throw * rod / root, rtol=1e-12)
    assert slopes.quantity.unit == "mm"


def test_numbers_are_derived_backwards_and_curves_forwards(press, monkeypatch):
    """One way back whatever the parameters are, to rounding the same as one way forwards with all of them."""
    every = variables_of(load("ten-link-forces"), [])
    run = run_scene(load("ten-link-forces"), frames=60)
    measure = parse_measure(run.scene, "joint.B.reaction:mean")
    (one,) = sensitivities(run, [measure], every)
    weights = measure.weights(one.curve, run.catalogue.numbers.time, run.catalogue.coordinate(run.motion.mechanism.drives[0].joint))
    np.testing.assert_allclose(one.derivatives, one.slopes @ weights, rtol=1e-10, atol=1e-12 * np.abs(one.derivatives).max())
    monkeypatch.setattr(Derivatives, "of", None)
    assert len(every) > 10 and np.isfinite(sensitivities(run, [measure], every)[0].derivatives).all()


@pytest.mark.sample(4)
@pytest.mark.parametrize(
    "of", [*(f"drive.A.torque:{r}" for r in ("max", "min", "peak", "mean", "rms", "range", "at 75 deg")), "energy[work]:max"]
)
def test_the_derivative_of_a_number_is_the_limit_of_its_differences(press, of):
    """Of a work, which adds up all before it, too: there is no way back through it. The load's kinks are at frames."""
    slopes = sensitivity(run_scene(press.scene, frames=120), of, ["stroke"])
    h = 1e-3
    near = [
        sensitivity(run_scene(press.scene.with_parameters({"stroke": f"{80.0 + s * h!r} mm"}), frames=120), of, ["speed"]).number
        for s in (1.0, -1.0)
    ]
    assert slopes.derivatives[0] == pytest.approx((near[0] - near[1]) / (2.0 * h), rel=2e-6, abs=1e-9)


def test_numbers_of_a_scene_without_parameters_vary_by_their_places():
    run = run_scene(load("crank-rocker"), frames=24)
    slopes = sensitivity(run, "link.rocker.angle:at 60 deg", ["links.rocker.points.C[0]", "links.coupler.points.C[0]"])
    # half a degree of drive and lengths in mm: -1/q and cos(psi - phi)/q of the four-bar, in degrees per mm
    a, b, c, d, q = 60.0, 180.0, 150.0, 200.0, np.radians(60.0)
    line = d - a * np.exp(1j * q)
    psi = np.radians(slopes.number)
    phi = np.angle(line + c * np.exp(1j * psi))
    assert abs(line + c * np.exp(1j * psi)) == pytest.approx(b, rel=1e-5)  # the number is interpolated between frames
    side = c * np.sin(psi - phi)
    np.testing.assert_allclose(slopes.derivatives, np.degrees([c * np.cos(psi - phi) / side / c, -1.0 / side]), rtol=2e-3)
    assert {v.name for v in variables_of(run.scene)} >= {"links.crank.mass", "links.frame.points.D[0]"}


PUSHED = """
units = { length = "m", angle = "deg" }
run = { frames = 50 }
[links]
frame = { points = { A = [0, 0] } }
crank = { points = { A = [0, 0], B = [0.1, 0] } }
rod = { points = { B = [0, 0], C = [0.3, 0] } }
ram = { points = { C = [0, 0] } }
[joints]
A = { revolute = ["frame", "crank"], drive = { speed = "60 rpm" } }
B = { revolute = ["crank", "rod"] }
C = { revolute = ["rod", "ram"] }
S = { prismatic = ["frame", "ram"], at = ["A", "C"], along = [1, 0], branch = "ahead" }
[loads]
push = { force = [-100, 0], on = "ram", at = "C" FACTOR }
"""
TABLE = ', table = { joint = "S", position = [0.19, 0.31, 0.41], factor = [0, MIDDLE, 0.5], smooth = false }'


@pytest.mark.parametrize(
    "factor, place, slope",
    [
        # of straight lines by the number and the place of their middle point; of a wave of time by its frequency
        (TABLE, "loads.push.table.factor[1]", lambda x, t: np.interp(x, [0.19, 0.31, 0.41], [0, 1, 0])),
        (
            TABLE,
            "loads.push.table.position[1]",
            lambda x, t: np.where(x < 0.31, -0.8 * (x - 0.19) / 0.12**2, 0.3 * (0.41 - x) / 0.1**2),
        ),
        (', sine = { frequency = "2 Hz" }', "loads.push.sine.frequency", lambda x, t: 2 * np.pi * t * np.cos(4 * np.pi * t)),
    ],
)
def test_numbers_of_the_factor_of_a_load_move_the_torque(factor, place, slope):
    run = run_scene(loads(PUSHED.replace("FACTOR", factor.replace("MIDDLE", "0.8"))))
    steady = run_scene(loads(PUSHED.replace("FACTOR", ""))).catalogue["drive.A.torque"].values()[:, 0]
    x = run.catalogue["joint.S.displacement"].values()[:, 0]
    found = sensitivity(run, "drive.A.torque", [place]).slopes[0]
    np.testing.assert_allclose(found, steady * slope(x, run.motion.time), atol=1e-11 * np.abs(steady).max())
    assert np.abs(found).max() > 0.1


def test_friction_that_is_zero_takes_the_power_of_what_presses_without_it():
    """Beside a brake, without which there were no friction at all."""
    text = PUSHED.replace(" FACTOR", "").replace("run =", 'effects = ["friction"]\nrun =')
    text = text.replace('"crank"],', '"crank"], friction = { brake = 0.1 },').replace(
        '"rod"] }', '"rod"], friction = { coefficient = 0, radius = 0.02 } }', 1
    )
    run = run_scene(loads(text))
    found = sensitivity(run, "drive.A.torque", ["joints.B.friction.coefficient"])
    pressed = np.hypot(*run.forces.reaction("B")[:, :2].T)
    wanted = 0.02 * pressed * np.abs(run.motion.coordinate("B")[:, 1]) / (2.0 * np.pi)
    np.testing.assert_allclose(found.slopes[0], wanted, atol=1e-12 * wanted.max())


def test_friction_and_its_losses_are_in_proportion_to_the_only_load():
    text = PUSHED.replace(" FACTOR", "").replace("run =", 'effects = ["friction"]\nrun =')
    run = run_scene(loads(text.replace('"rod"] }', '"rod"], friction = { coefficient = 0.2, radius = 0.02 } }', 1)))
    keys = ("joint.B.friction_moment", "joint.B.friction_loss", "power[friction B]", "load.push.force[Fx]")
    for key in keys:
        found = sensitivity(run, key, ["loads.push.force[0]"])
        assert np.abs(found.curve).max() > 0.1
        np.testing.assert_allclose(found.slopes[0], found.curve / -100.0, atol=1e-12 * np.abs(found.curve).max())


def test_shaking_forces_are_in_proportion_to_a_mass():
    scene, key = load("counterweighted-four-bar"), "shaking.force[Fx]"
    run, heavier = (run_scene(x, frames=12) for x in (scene, scene.changed({("links", "crank", "mass"): 1.8})))
    found = sensitivity(run, key, ["links.crank.mass"])
    wanted = heavier.catalogue["shaking.force"].values()[:, 0] - found.curve
    np.testing.assert_allclose(found.slopes[0], wanted, atol=1e-12 * np.abs(wanted).max())


CARD = 'displacement = [0, 0.06, 0.2], outward = ["9 bar", "3 bar", "1 bar"], inward = ["9 bar", "2 bar", "1 bar"]'


@pytest.mark.parametrize("place", ["diagram.inward[1]", "diagram.displacement[1]", "top"])
def test_a_measured_diagram_moves_the_torque_as_its_straight_lines_do(place):
    """By virtual power, also where the piston goes the other way, and the other line holds."""
    gas = f'gas = {{ gas = "S", bore = 0.08, top = 0.4, stroke = 0.2, diagram = {{ {CARD} }} }}'
    run = run_scene(loads(PUSHED.replace(" FACTOR", "") + gas))
    found = sensitivity(run, "drive.A.torque", [f"loads.gas.{place}"]).slopes[0]
    s, rate = run.motion.coordinate("S")[:, :2].T
    first, towards = 0.4 - s < 0.06, rate > 0.0
    hat = np.interp(0.4 - s, [0.0, 0.06, 0.2], [0.0, 1.0, 0.0])  # bar, by the pressure of the middle point
    slope = np.where(towards, np.where(first, -7.0 / 0.06, -1.0 / 0.14), np.where(first, -6.0 / 0.06, -2.0 / 0.14))
    moved = {"diagram.inward[1]": np.where(towards, hat, 0.0), "diagram.displacement[1]": -slope * hat, "top": slope}
    wanted = 1e5 * moved[place] * np.pi * 0.04**2 * rate / (2.0 * np.pi)
    np.testing.assert_allclose(found, wanted, atol=1e-10 * np.abs(wanted).max())


def test_of_redundant_constraints_what_statics_determines_has_derivatives():
    """Two guides in one line: torque and reactions are those of one guide; how the two share their load nobody knows."""
    scene, number = load("two-guides"), "links.crank.points.B[0]"
    one = scene.changed({("joints", "T"): None})
    keys = ("drive.A.torque", "joint.B.reaction")
    slopes = [[sensitivity(run, key, [number]).slopes for key in keys] for run in (run_scene(x, frames=30) for x in (scene, one))]
    for found, wanted in zip(*slopes, strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-10 * np.abs(wanted).max())
    with pytest.raises(MechanismError, match="statics does not determine what S carries"):
        sensitivity(run_scene(scene, frames=4), "joint.S.reaction", [number])
    with pytest.raises(MechanismError, match=r"beside .*H\[1\] redundant constraints contradict each other at T"):
        sensitivity(run_scene(scene, frames=4), "drive.A.torque", ["links.frame.points.H[1]"])


@pytest.mark.parametrize(
    ("stated", "value", "unit"),
    [
        ("2*30 mm", 60.0, "mm"),
        ("(50 + 10) mm", 60.0, "mm"),
        ("2 in + 9.2 mm", 60.0, "mm"),
        ("3600 mm^2/60 mm", 60.0, "mm"),
        ("6 cm", 6.0, "cm"),
    ],
)
def test_a_parameter_may_be_an_expression_of_numbers(stated, value, unit):
    """It is told in the scene's unit, a plain quantity in its own; the crank's swing is its length."""
    text = (
        f'units = {{ length = "mm", angle = "deg" }}\ntrace = ["B"]\n[parameters]\nthrow = "{stated}"\nspeed = "2*30 rpm"\n'
        'damping = "pi*2 N s/m"\n[links]\nframe = { points = { A = [0, 0] } }\n'
        'crank = { points = { A = [0, 0], B = ["throw", 0] } }\n'
        '[joints]\nA = { revolute = ["frame", "crank"], drive = { speed = "speed" } }\n'
    )
    scene = loads(text)
    throw, speed, damping = variables_of(scene)
    assert (throw.value, throw.unit) == (pytest.approx(value, rel=1e-14), unit)
    assert speed.value * speed.factor == pytest.approx(2.0 * np.pi, rel=1e-14)
    assert damping.value * damping.factor == pytest.approx(2.0 * np.pi, rel=1e-14)
    for variable in (throw, speed, damping):
        before, after = (given.parameters[variable.name].amount for given in (scene, variable.changed(scene, variable.value)))
        assert (after.number, after.powers) == (pytest.approx(before.number, rel=1e-14), before.powers)
    row = sensitivity(run_scene(scene, frames=36), "point.crank.B.position[x]:max", ["throw"])
    assert row.derivatives[0] == pytest.approx(row.number / value, rel=1e-12)


def test_what_follows_from_others_and_what_is_not_there_is_refused(press):
    with pytest.raises(MechanismError, match="follows from other parameters"):
        sensitivity(press, "drive.A.torque:max", ["throw"])
    with pytest.raises(MechanismError, match=r"^by stoke: is neither a parameter nor a number.*stroke"):
        sensitivity(press, "drive.A.torque:max", "stoke")
    with pytest.raises(MechanismError, match=r"follows from the expression 'throw/2'. Vary stroke\.$"):
        sensitivity(press, "drive.A.torque:max", "links.crank.centre[0]")
    with pytest.raises(MechanismError, match="derivatives of health"):
        sensitivity(press, "health.condition:max", ["stroke"])


def test_the_command_ranks_and_writes_what_it_found(tmp_path, capsys, monkeypatch):
    chart, table = tmp_path / "tornado.svg", tmp_path / "slopes.csv"
    words = [
        "mechviz",
        "sensitivity",
        "parametric-press",
        "-n",
        "36",
        "--of",
        "drive.A.torque:max",
        "--plot",
        str(chart),
        "--csv",
        str(table),
    ]
    monkeypatch.setattr("sys.argv", words)
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code in (0, None)
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("drive.A.torque:max = 1") and said[2].split()[0] == "force"  # the press is there for its force
    assert "stroke" in chart.read_text() and len(table.read_text().splitlines()) == 38
    result = mv.run("parametric-press", frames=36)
    assert isinstance(result.scene, Scene) and result.sensitivity("drive.A.torque:max").variables[0].name == "stroke"


METRIC_KEYS = ("instant_centre.coupler rocker.position", "instant_centre.crank rocker.position", "curvature.coupler.E.curvature")
ENDS = ("bearing_force_behind", "bearing_force_ahead")
STRESS = ("cam.K.Hertz_pressure", "cam.K.half_width_of_the_contact", "power")
CONTENTS = [  # a scene, a number of it, and quantities
    ("crank-rocker", ("links", "coupler", "points", "C", 0), METRIC_KEYS),
    ("crank-rocker", ("links", "frame", "points", "D", 0), METRIC_KEYS),
    ("cam-friction", ("joints", "S", "friction", "length"), [f"joint.S.{end}" for end in ENDS]),
    ("slider-crank-friction", ("links", "crank", "points", "B", 0), [f"joint.S.{end}" for end in ENDS]),
    ("cam-roller", ("joints", "K", "rating", "width"), STRESS),
    ("cam-roller", ("joints", "K", "follower", "roller"), STRESS),
    ("cam-roller", ("joints", "K", "profile", "base"), STRESS),
    ("cam-roller", ("loads", "return_spring", "stiffness"), STRESS),
]


def size_of(scene, place):
    """A number of a scene as it is written, and its unit."""
    value = value_at(scene.document, place)
    return (float(split(value)[0]), split(value)[1]) if isinstance(value, str) else (float(value), "")


@cache
def catalogues_beside(scene, place, frames, h):
    """Of runs in which a number of a scene is a few times the part ``h`` of it larger or smaller."""
    size, unit = size_of(scene, place)
    values = {k: size * (1 + k * h) for k in (-3, -2, -1, 1, 2, 3)}
    return {
        k: run_scene(scene.changed({place: f"{x!r} {unit}" if unit else x}), frames=frames).catalogue for k, x in values.items()
    }


def by_differences(scene, place, key, frames, h=1e-3):
    """Derivatives (F, n) of a quantity by a number of a scene, in its unit: differences of the sixth order."""
    values = {k: catalogue[key].values() for k, catalogue in catalogues_beside(scene, place, frames, h).items()}
    size, _ = size_of(scene, place)
    with np.errstate(invalid="ignore"):  # lines that are parallel meet nowhere
        return sum(weight * (values[k] - values[-k]) for k, weight in ((1, 45), (2, -9), (3, 1))) / (60.0 * h * size)


@pytest.mark.sample(2)
@pytest.mark.parametrize(("name", "place", "keys"), CONTENTS)
def test_metrics_bearings_and_contact_stresses_have_exact_derivatives(name, place, keys):
    scene = load(name)
    run = run_scene(scene, frames=31)
    number, moved = place_key(place), 0.0
    for key in keys:
        differences, curves = by_differences(scene, place, key, 31), run.catalogue[key].curves
        for k, curve in enumerate(curves):
            found = sensitivity(run, f"{key}[{curve}]" if len(curves) > 1 else key, [number]).slopes[0]
            known = np.isfinite(differences[:, k])
            scale = np.abs(differences[known, k]).max(initial=1e-300)
            np.testing.assert_allclose(found[known], differences[known, k], rtol=1e-8, atol=3e-9 * scale, err_msg=f"{key} {curve}")
            moved = max(moved, scale)
    assert moved > 1e-9


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("name", "duration", "key", "place"),
    [
        ("toggle-press-stop", "0.2 s", "load.stop die.force", ("links", "ram", "mass")),
        ("valve-float", "91.79 ms", "cam.K.contact_force", ("loads", "valve_spring", "stiffness")),
    ],
)
def test_what_presses_now_and_then_has_derivatives_while_it_does(name, duration, key, place):
    scene = load(name).changed({("run", "duration"): duration})
    run = run_scene(scene, frames=40)
    curve, found = f"{key}[|F|]" if "stop" in key else key, ".".join(place)
    slopes = sensitivity(run, curve, [found])
    differences = by_differences(scene, place, key, 40, h=1e-5)[:, -1]
    pressed = slopes.curve > 0.0
    assert 0 < pressed.sum() < len(pressed) and not slopes.slopes[0, ~pressed].any()
    np.testing.assert_allclose(
        slopes.slopes[0, pressed], differences[pressed], rtol=1e-4, atol=1e-4 * np.abs(differences[pressed]).max()
    )
    assert np.isfinite(sensitivity(run, f"{curve}:rms", [found]).derivatives).all()


LIFT = ("joints", "K", "profile", "lift")
KNOTS = {  # a range that another one makes up for, and what follows from it
    "cam-roller": ((*LIFT, 0, "over"), (*LIFT, 1, "over"), "deg", ("drive.O.torque", "joint.O.reaction")),
    "cam-oscillating-roller": ((*LIFT, 0, "over"), (*LIFT, 1, "over"), "deg", ("drive.O.torque", "joint.O.reaction")),
    "cam-conjugate": ((*LIFT, 0, "over"), (*LIFT, 1, "over"), "deg", ("drive.O.torque",)),
    "cam-mushroom": ((*LIFT, 0, "over"), (*LIFT, 1, "over"), "deg", ("joint.O.reaction",)),
    "five-bar": (
        ("joints", "A", "drive", "segments", 0, "duration"),
        ("joints", "A", "drive", "segments", 1, "duration"),
        "s",
        ("joint.B.angle", "joint.C.angular_acceleration"),
    ),
    "two-axis-program": (
        ("joints", "Z", "drive", "program", "segments", 0, "over"),
        ("joints", "Z", "drive", "program", "segments", 1, "over"),
        "deg",
        ("joint.Z.displacement", "joint.Z.acceleration"),
    ),
}


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", KNOTS)
def test_ranges_of_segments_have_exact_derivatives_beside_the_knots_that_they_move(name):
    """Against differences of the sixth order, at all frames but the two to whose piece the knot comes in these."""
    place, other, unit, quantities = KNOTS[name]
    plain, frames, h = load(name), 357, 2e-3
    ranges = [value_at(plain.document, at) for at in (place, other)]
    sizes = [float(split(v)[0]) if isinstance(v, str) else float(v) for v in ranges]
    raw = with_values(plain.document.to_data(), {place: "range", other: f"{sum(sizes)} {unit} - range"})
    scene = Scene.build(**raw, parameters={"range": f"{sizes[0]} {unit}"})
    run = run_scene(scene, frames=frames)
    beside = {
        k: run_scene(scene.with_parameters({"range": f"{sizes[0] * (1.0 + k * h)!r} {unit}"}), frames=frames).catalogue
        for k in (-3, -2, -1, 1, 2, 3)
    }
    for key in quantities:
        found = sensitivity(run, key, ["range"])
        column = found.measure.column(found.quantity)
        differences = sum(
            weight * (beside[k][key].values() - beside[-k][key].values())[:, column] for k, weight in ((1, 45), (2, -9), (3, 1))
        ) / (60.0 * h * sizes[0])
        off = np.sort(np.abs(found.slopes[0] - differences)) / np.abs(differences).max()
        assert off[-4] < 3e-9 and np.abs(found.slopes[0]).max() > 0.0, key


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", ["cam-roller", "cam-oscillating-roller", "cam-mushroom", "cam-flat"])
def test_what_limits_a_cam_follows_its_base_circle_and_its_lift(name):
    """Pressure angle, curvature, contact force and lift, by differences of the sixth order; and the greatest pressure angle."""
    scene, frames = load(name), 97
    run = run_scene(scene, frames=frames)
    for place in ((*LIFT[:-1], "base"), (*LIFT, 0, "to")):
        if place[-1] == "to" and value_at(scene.document, (*LIFT, 1)).to is not None:
            continue  # the second segment would start elsewhere
        size, number = size_of(scene, place)[0], place_key(place)
        for key in ("pressure_angle", "contact_normal_force", "curvature", "lift", "lift_acceleration"):
            found = sensitivity(run, f"cam.K.{key}", [number])
            differences = by_differences(scene, place, f"cam.K.{key}", frames)[:, 0]
            scale = max(np.abs(differences).max(), np.abs(found.curve).max() / size)
            np.testing.assert_allclose(found.slopes[0], differences, rtol=0.0, atol=1e-9 * scale, err_msg=f"{number} {key}")
    steepest = sensitivity(run, "cam.K.pressure_angle:max", [number])
    assert np.isfinite(steepest.derivatives).all()


def test_a_value_where_the_drive_is_at_a_place_does_not_move_with_the_start():
    """Frames move with the start of the drive, the place does not; it counts a turn further on, too."""
    scene = load("crank-rocker")
    run = run_scene(scene.changed({("joints", "A", "drive", "start"): 10.0}), frames=120)
    for of in ("link.rocker.angle:at 60.3 deg", "link.rocker.angle:at -299.7 deg"):
        moved = sensitivity(run, of, ["joints.A.drive.start", "links.crank.points.B[0]"])
        assert abs(moved.derivatives[0]) < 1e-5 < abs(moved.derivatives[1])
        assert moved.number == pytest.approx(sensitivity(run_scene(scene, frames=120), of, []).number, rel=1e-6)


def test_a_free_link_is_elsewhere_when_a_faster_drive_comes_to_the_place():
    def swing(speed: float) -> Run:
        return run_scene(
            Scene.build(
                units={"length": "mm", "angle": "deg"},
                effects=["inertia", "gravity"],
                parameters={"speed": f"{speed!r} rad/s"},
                links={
                    "frame": {"points": {"O": [0, 0]}},
                    "crank": {"points": {"O": [0, 0], "P": [100, 0]}},
                    "bob": {"points": {"P": [0, 0], "Q": [200, 0]}, "mass": "1 kg", "shape": "bar"},
                },
                joints={
                    "O": {"revolute": ["frame", "crank"], "drive": {"speed": "speed"}},
                    "P": {"revolute": ["crank", "bob"], "free": {"position": -60}},
                },
                run={"frames": 60, "duration": "0.8 s"},
            )
        )

    of, h = "joint.P.angle:at 20 deg", 1e-3
    run = swing(1.5)
    near = [sensitivity(swing(1.5 + step), of).number for step in (h, -h)]
    assert sensitivity(run, of, "speed").derivatives[0] == pytest.approx((near[0] - near[1]) / (2.0 * h), rel=1e-4)
