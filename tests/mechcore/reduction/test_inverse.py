"""Inverse tasks: the lecture's force task as it is posed, rates from two accelerations, inertia from the times of a swing."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from mechanisms import case
from scipy.special import ellipk
from typer.testing import CliRunner

import mechviz
from mechcore.errors import MechanismError
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.reduction.inverse import inertia_from_swing, inertia_from_two_swings, rates_from_accelerations
from mechviz.commands.main import app

PLANE = np.array([1.0, 1.0j])
FILE = "forces_reduction"


def swing_time(inertia, mass, distance, amplitude=0.0):
    """Period of a body about its axis, by the complete elliptic integral."""
    return 4.0 * math.sqrt(inertia / (mass * 9.81 * distance)) * ellipk(math.sin(0.5 * amplitude) ** 2)


def said(*arguments):
    return CliRunner().invoke(app, ["solve", *arguments])


@pytest.mark.parametrize("name", ["inertia-lecture-aB30", "inertia-lecture-aB25"])
def test_the_worked_task_of_the_lecture(name):
    """Accelerations are inputs: omega^2, alpha, a_S, the resultant, its moment, and the point masses' accelerations."""
    reference = case(FILE, name)
    i, expected = reference["inputs"], reference["expected"]
    a, b = complex(*i["A"]), complex(*i["B"])
    of_a, of_b = (cmath.rect(i[f"a_{k}"], math.radians(i[f"a_{k}_angle_deg"])) for k in "AB")
    rates = rates_from_accelerations(a, b, of_a, of_b)
    assert rates.omega_squared == pytest.approx(expected["omega_squared"], rel=1e-12)
    assert rates.alpha == pytest.approx(expected["eps"], rel=1e-12)
    assert rates.at(0j) == pytest.approx(complex(*expected["a_S"]), rel=1e-12)
    for branch in expected["branches"]:
        place = complex(branch["masses"]["x_C"], i["y_C"])
        assert rates.at(place) == pytest.approx(complex(*branch["a_C"]), rel=1e-10)
    assert rates.at(rates.pole) == pytest.approx(0.0, abs=1e-12)
    points = [f"{k}={z.real!r},{z.imag!r}" for k, z in (("A", a), ("B", b))]
    text = said(
        "link", "--point", points[0], "--point", points[1], "--mass", "10", "--inertia", "2",
        "--acceleration", f"A={i['a_A']}@{i['a_A_angle_deg']}", "--acceleration", f"B={i['a_B']}@{i['a_B_angle_deg']}",
        "--mass-at", "A", "--mass-at", "B", "--mass-at", "?,0.2",
    ).stdout  # fmt: skip
    x, y = expected["resultant"]
    assert f"inertia force ({x:.6g}, {y:.6g}) N" in text
    x, y = expected["line_of_action_point_nearest_S"]
    assert f"on the line through ({x:.6g}, {y:.6g}) m, {expected['arm_h']:.6g} m from S" in text
    for branch in expected["branches"]:
        assert all(f"{branch['masses'][k]:.6g} kg" in text for k in ("m_A", "m_B", "m_C"))
        assert all(f"{branch[k]:.6g} N" in text for k in ("P_A_abs", "P_B_abs", "P_C_abs"))


def test_two_points_of_a_coupler_tell_how_it_turns():
    scene = mechviz.load("crank-rocker")
    motion = solve_motion(compile_mechanism(scene.mechanism), default_times(scene.mechanism, 8, scene.cycles))
    b, c, e = ([motion.point("coupler", name, k) @ PLANE for k in (0, 2)] for name in ("B", "C", "E"))
    for k in range(8):
        rates = rates_from_accelerations(complex(b[0][k]), complex(c[0][k]), complex(b[1][k]), complex(c[1][k]))
        assert rates.omega_squared == pytest.approx(motion.velocity("coupler")[k, 2] ** 2, rel=1e-9, abs=1e-9)
        assert rates.alpha == pytest.approx(motion.acceleration("coupler")[k, 2], rel=1e-9)
        assert rates.at(complex(e[0][k])) == pytest.approx(complex(e[1][k]), rel=1e-9)


def test_accelerations_that_no_rigid_body_has_are_refused():
    with pytest.raises(MechanismError, match="no rigid body"):
        rates_from_accelerations(0j, 1 + 0j, 0j, 5 + 0j)
    assert rates_from_accelerations(0j, 1 + 0j, 3j, 3j).pole is None  # a translation
    with pytest.raises(MechanismError, match="one place"):
        rates_from_accelerations(1j, 1j, 0j, 1j)


def test_inertia_from_the_periods_of_the_reference():
    """Reference case compound-pendulum-period: J_O = 0.4 kg m^2 at every amplitude."""
    reference = case("dynamics", "compound-pendulum-period")
    i = reference["inputs"]
    for row in reference["expected"]:
        about, centre = inertia_from_swing(i["m"], i["d"], row["period"], row["amplitude"], i["g"])
        assert about == pytest.approx(i["J_O"], rel=1e-12)
        assert centre == pytest.approx(i["J_O"] - i["m"] * i["d"] ** 2, rel=1e-12)


def test_two_swings_give_the_centre_of_mass_too():
    mass, inertia, first, second = 2.0, 0.05, 0.2, 0.35
    periods = tuple(swing_time(inertia + mass * d * d, mass, d, 0.5) for d in (first, second))
    assert inertia_from_two_swings(mass, first + second, periods, 0.5) == pytest.approx((first, inertia), rel=1e-12)
    text = said("swing", "--mass", "2", "--apart", "550 mm", "--amplitude", "0.5 rad",
                "--period", str(periods[0]), "--period", str(periods[1])).stdout  # fmt: skip
    assert "200 mm from the first axis" in text and "0.05 kg m²" in text
    kater = inertia / (mass * first)  # the conjugate axis: both swing alike, whatever lies between
    alike = tuple(swing_time(inertia + mass * d * d, mass, d) for d in (first, kater))
    with pytest.raises(MechanismError, match="any place"):
        inertia_from_two_swings(mass, first + kater, alike)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("swing", "--mass", "1", "--period", "0.1", "--distance", "1"), "shorter than that of a point mass"),
        (("swing", "--mass", "1", "--period", "1"), "--distance"),
        (("swing", "--mass", "-1", "--period", "1", "--distance", "1"), "not above zero"),
        (("swing", "--mass", "3 mm", "--period", "1", "--distance", "1"), "mass"),
        (("link", "--point", "A=0,0"), "two points"),
        (("link", "--point", "A=0", "--point", "B=1,0"), "two coordinates"),
    ],
)
def test_tasks_that_cannot_be_are_refused_with_a_reason(arguments, words):
    result = said(*arguments)
    assert result.exit_code == 2 and words in " ".join(result.stderr.split())
