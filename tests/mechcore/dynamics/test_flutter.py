"""Small vibrations under forces without a potential: Ziegler's column, gyroscopic forces, the command.

Ziegler's column: two bars of 1 m, 2 kg and 1 kg at their ends, torsion springs of 4 N m/rad, a follower load P at its tip and a
damper d in its middle joint. By hand: s^4 + 3 d s^3 + (14 - P) s^2 + 2 d s + 8 = 0; without the damper it flutters from
P = 14 - 2 sqrt 8 = 8.34 N on.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import mechviz
from mechcore.dynamics.rest.vibrations import small_vibrations
from mechcore.laws.timed import Free
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.loads import Factor, Force, Torque, TorsionSpring
from mechcore.spec.mechanism import Drive, Link, Mechanism, Prismatic, Revolute
from mechviz.commands.main import app
from mechviz.studies.vibrations import mode_scene, vibration_lines, vibrations_of

TURN = 2.0 * np.pi


def ziegler(push: float, damper: float = 0.0) -> str:
    return f"""
        effects = ["inertia"]
        [run]
        duration = "1 s"
        frames = 100
        [links]
        frame = {{ points = {{ O = [0, 0] }} }}
        a = {{ points = {{ O = [0, 0], J = [1, 0] }}, mass = "2 kg", centre = [1, 0], inertia = "0 kg m^2" }}
        b = {{ points = {{ J = [0, 0], E = [1, 0] }}, mass = "1 kg", centre = [1, 0], inertia = "0 kg m^2" }}
        [joints]
        O = {{ revolute = ["frame", "a"], free = {{ position = 0.0 }} }}
        J = {{ revolute = ["a", "b"], free = {{ position = 0.0 }} }}
        [loads]
        k1 = {{ torsion_spring = ["frame", "a"], stiffness = "4 N m/rad" }}
        k2 = {{ torsion_spring = ["a", "b"], stiffness = "4 N m/rad" }}
        P = {{ force = ["{-push} N", 0], on = "b", at = "E", axes = "link" }}
        d = {{ torsion_damper = ["a", "b"], linear = "{damper} N m s/rad" }}
    """


def exponents(push: float, damper: float = 0.0) -> list[complex]:
    return sorted(np.roots([1.0, 3.0 * damper, 14.0 - push, 2.0 * damper, 8.0]), key=lambda s: (s.real, s.imag))


@pytest.mark.parametrize("push", [5.0, 8.2])
def test_below_its_limit_the_column_is_stable_and_its_frequencies_are_those_of_the_whole(push: float) -> None:
    vibrations = small_vibrations(mechviz.loads(ziegler(push)).mechanism)
    squares = np.sort(np.roots([1.0, push - 14.0, 8.0]).real)
    assert vibrations.stability == "stable" and [m.kind for m in vibrations.modes] == ["vibration"] * 2
    assert [m.square for m in vibrations.modes] == pytest.approx(squares, rel=1e-8)
    assert [m.frequency for m in vibrations.modes] == pytest.approx(np.sqrt(squares) / TURN, rel=1e-8)
    assert [m.damped_frequency for m in vibrations.modes] == [m.frequency for m in vibrations.modes]
    assert [m.damping_ratio for m in vibrations.modes] == [0.0, 0.0]
    for m in vibrations.modes:
        np.testing.assert_allclose(vibrations.stiffness @ m.shape, m.square * (vibrations.inertia @ m.shape), atol=1e-10)
        assert m.shape @ vibrations.inertia @ m.shape == pytest.approx(1.0)


@pytest.mark.parametrize(("push", "damper"), [(8.4, 0.0), (9.0, 0.0), (9.0, 0.3), (5.0, 0.3), (5.0, 0.001)])
def test_beyond_its_limit_it_flutters_and_a_damper_lowers_that_limit(push: float, damper: float) -> None:
    """With a damper however small from P = 4/3 N on, by Routh and Hurwitz."""
    vibrations = small_vibrations(mechviz.loads(ziegler(push, damper)).mechanism)
    wanted = exponents(push, damper)
    got = sorted((s for m in vibrations.modes for s in m.eigenvalues), key=lambda s: (s.real, s.imag))
    np.testing.assert_allclose(got, wanted, atol=1e-7)
    assert vibrations.stability == "unstable" and sorted(m.kind for m in vibrations.modes) == ["flutter", "vibration"]
    (growing,) = (m for m in vibrations.modes if m.kind == "flutter")
    assert growing.growth == pytest.approx(wanted[-1].real, rel=1e-5)
    assert growing.damped_frequency == pytest.approx(abs(wanted[-1].imag) / TURN, rel=1e-7)
    for m in vibrations.modes:
        np.testing.assert_allclose(vibrations.stiffness @ m.shape, m.square * (vibrations.inertia @ m.shape), atol=1e-10)
        assert (m.shape.conj() @ vibrations.inertia @ m.shape).real == pytest.approx(1.0)


def test_below_the_lower_limit_the_damped_column_is_stable() -> None:
    vibrations = small_vibrations(mechviz.loads(ziegler(1.3, 0.3)).mechanism)
    assert vibrations.stability == "stable"
    assert max(m.growth for m in vibrations.modes) == pytest.approx(exponents(1.3, 0.3)[-1].real, rel=1e-5)


def test_a_push_past_all_flutter_makes_it_diverge() -> None:
    """Both squares are negative from P = 14 + 2 sqrt 8 = 19.66 N on."""
    vibrations = small_vibrations(mechviz.loads(ziegler(23.0)).mechanism)
    assert [m.square for m in vibrations.modes] == pytest.approx([-8.0, -1.0], rel=1e-8)
    assert [m.kind for m in vibrations.modes] == ["divergence"] * 2


def test_wheels_that_push_one_another_without_a_potential_stay_free_to_turn() -> None:
    """The relative angle r of two equal wheels: J r'' = -(2 c - g) r; together nothing holds them."""
    c, g = 50.0, 31.7
    factor = Factor(function=lambda r: r, of="position", joint="J")
    mechanism = Mechanism(
        name="wheels",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0)}),
            *(Link(name=n, points={"O": (0.0, 0.0)}, mass=1.0, inertia=0.3) for n in ("a", "b")),
        ),
        joints=tuple(Revolute(name=n, links=links, points=("O", "O")) for n, links in (("O", ("frame", "a")), ("J", ("a", "b")))),
        drives=(Drive(joint="O", law=Free(0.3)), Drive(joint="J", law=Free(0.0))),
        effects=("inertia",),
        loads=(
            TorsionSpring(name="shaft", links=("a", "b"), stiffness=c),
            Torque(name="push", link="b", moment=g, factor=factor),
        ),
    )
    vibrations = small_vibrations(mechanism)
    assert any("no potential" in note for note in vibrations.notes)
    assert [m.kind for m in vibrations.modes] == ["neutral", "vibration"] and vibrations.stability == "neutral"
    assert [m.square for m in vibrations.modes] == pytest.approx([0.0, (2 * c - g) / 0.3], rel=1e-8)


@pytest.mark.parametrize(("gyroscopic", "kind"), [(9.0, "vibration"), (7.0, "flutter"), (0.0, "divergence")])
def test_gyroscopic_forces_may_hold_up_what_falls(gyroscopic: float, kind: str) -> None:
    """1 kg on two slides with the stiffness -16 N/m both ways: s^4 + (g^2 - 32) s^2 + 256 = 0, stable from g = 8 N s/m on."""
    turned = [("y", "vx", (0.0, gyroscopic)), ("x", "vy", (-gyroscopic, 0.0))]
    pushes = [("px", "x", (16.0, 0.0)), ("py", "y", (0.0, 16.0))]
    mechanism = Mechanism(
        name="saddle",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0)}),
            Link(name="slide", points={"P": (0.0, 0.0)}),
            Link(name="mass", points={"P": (0.0, 0.0)}, mass=1.0),
        ),
        joints=(
            Prismatic(name="X", links=("frame", "slide"), points=("O", "P")),
            Prismatic(name="Y", links=("slide", "mass"), points=("P", "P"), along=(0.0, 1.0)),
        ),
        drives=(Drive(joint="X", law=Free(0.0)), Drive(joint="Y", law=Free(0.0))),
        effects=("inertia",),
        loads=tuple(
            Force(name=name, link="mass", point="P", vector=vector, factor=Factor(function=lambda x: x, of=of, point=("mass", "P")))
            for name, of, vector in turned + pushes
            if any(vector)
        ),
    )
    vibrations = small_vibrations(mechanism)
    assert {m.kind for m in vibrations.modes} >= {kind}
    assert vibrations.stability == ("stable" if kind == "vibration" else "unstable")
    wanted = np.roots([1.0, 0.0, gyroscopic**2 - 32.0, 0.0, 256.0])
    assert max(m.growth for m in vibrations.modes) == pytest.approx(wanted.real.max(), abs=1e-6)
    assert max(m.damped_frequency for m in vibrations.modes) * TURN == pytest.approx(np.abs(wanted.imag).max(), abs=1e-6)


# --- scenes and the command -------------------------------------------------------------------------------------------


def test_the_command_tells_flutter_with_its_frequency(tmp_path: Path) -> None:
    scene, table = tmp_path / "ziegler.toml", tmp_path / "modes.csv"
    for push, damper, said, missing in (
        (8.2, 0.0, ("stable: ", "0.239246", "0.299461"), "unstable"),
        (9.0, 0.3, ("unstable: the least disturbance grows; mode 1 flutters at 0.2208 Hz", "0.220784"), "negative"),
    ):
        scene.write_text(ziegler(push, damper))
        run = CliRunner().invoke(app, ["vibrations", str(scene), "--csv", str(table)])
        assert run.exit_code == 0 and all(x in run.output for x in said) and missing not in run.output, run.output
    row = next(csv.DictReader(table.open()))
    assert row["kind"] == "flutter"
    assert complex(float(row["exponent_1_re"]), float(row["exponent_1_im"])) == pytest.approx(0.317641 + 1.387226j, rel=1e-6)
    scene.write_text(ziegler(23.0))
    run = CliRunner().invoke(app, ["vibrations", str(scene)])
    assert "mode 1 diverges, mode 2 diverges" in run.output


def test_loads_do_work_on_the_mode_that_grows_and_take_it_from_the_other() -> None:
    scene = mechviz.loads(ziegler(9.0))
    vibrations = vibrations_of(scene)
    k = np.array([[4.0, 9.0], [0.0, 4.0]])  # in the relative angles, by hand
    np.testing.assert_allclose(vibrations.stiffness, k, atol=1e-9)
    assert "°" in "\n".join(vibration_lines(scene, vibrations))
    for number, sign in ((1, 1.0), (2, -1.0)):
        made = mode_scene(scene, vibrations, number)
        period = 1.0 / vibrations.modes[0].frequency
        motion = solve_motion(compile_mechanism(made.mechanism), np.linspace(0.0, period, 65)[:-1])
        places, rates = (np.column_stack([motion.coordinate(j)[:, n] for j in ("O", "J")]) for n in (0, 1))
        work = -np.einsum("ni,ij,nj", rates, k, places) * period / 64
        assert sign * work > 1e-3 * np.abs(places).max() ** 2
