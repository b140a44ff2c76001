"""The compiled program of a mechanism gives what numpy gives: positions and rates, over scenes and random mechanisms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import four_bar
from random_mechanisms import draw

from mechcore.compiled import motion as compiled_motion
from mechcore.compiled import toolchain
from mechcore.compiled.motion import MotionProgram, motion_program, written_motion
from mechcore.compiled.toolchain import compiler, library
from mechcore.dynamics.simulate import simulate
from mechcore.forces.kinetostatics import solve_forces
from mechcore.forces.program import ForcesProgram, forces_program
from mechcore.motion.compiled import Compiled
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.mechanism import Mechanism
from mechviz.scene.scene import load

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")

OPTIMISED = toolchain.COMPILER_OPTIONS  # as users have it
SCENES = (
    "jansen-leg",
    "shaper-quick-return",
    "planetary-gear",
    "geared-slider-cranks",
    "two-guides",
    "cam-indexing-barrel",
    "cam-measured",
)
RANDOM = (("pin in slot", 2), ("several drives", 0), ("six-bar", 4), ("cam", 2), ("triad", 3))


def rounding(compiled: Compiled, time: np.ndarray) -> float:
    """Largest difference between both executors of poses and their rates, relative to the largest of each."""
    a = solve_motion(replace(compiled, executor="numpy"), time)
    b = solve_motion(replace(compiled, executor="c"), time)
    worst = 0.0
    for of in ("pose", "velocity", "acceleration"):
        first, second = (np.array([getattr(m, of)(link)[:, :] for link in m.model.links]) for m in (a, b))
        size = np.abs(first).max(axis=(0, 1)) + 1e-12
        worst = max(worst, float((np.abs(first - second).max(axis=(0, 1)) / size).max()))
    return worst


def crank_rocker(coupler: float = 0.3) -> Mechanism:
    return four_bar(E=(0.35, 0.0), AB=0.1, BD=coupler, DE=0.25)


@pytest.mark.parametrize("name", SCENES)
def test_scenes_move_alike(name: str) -> None:
    compiled = compile_mechanism(load(name).mechanism)
    assert isinstance(compiled.model.cached(written_motion), MotionProgram)
    assert rounding(compiled, default_times(compiled.mechanism, 90)) < 1e-12


@pytest.mark.parametrize(("kind", "seed"), RANDOM)
def test_random_mechanisms_move_alike(kind: str, seed: int) -> None:
    case = draw(kind, seed, travel=0.3, forces=False)
    compiled = compile_mechanism(case.mechanism)
    assert isinstance(compiled.model.cached(written_motion), MotionProgram)
    assert rounding(compiled, case.time) < 1e-10


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    "name", ["slider-crank-compressor", "ten-link-forces", "rack-and-pinion", "cam-inverse", "cam-conjugate-oscillating", "triad"]
)
def test_forces_are_alike(name: str) -> None:
    compiled = compile_mechanism(load(name).mechanism if name != "triad" else draw("triad", 3, travel=0.3, forces=False).mechanism)
    time = default_times(compiled.mechanism, 36)
    a, b = (solve_forces(solve_motion(replace(compiled, executor=e), time)) for e in ("numpy", "c"))
    assert isinstance(forces_program(compiled.model, exact=True), ForcesProgram)
    asked = [("reaction", c.name) for c in compiled.model.connections] + [("effort", d.joint) for d in compiled.mechanism.drives]
    for of, k in asked:
        wanted, computed = (getattr(f, of)(k) for f in (a, b))
        assert np.abs(computed - wanted).max() <= 1e-12 * max(np.abs(wanted).max(), 1.0), k
    assert np.abs(b.power_balance).max() < 1e-12


@pytest.mark.parametrize("name", ["slider-crank-friction", "cam-friction", "rough-cylinder"])
def test_friction_is_alike(name: str) -> None:
    """Pins, guides with bearings, contacts and brakes: loads, reactions, and what follows from them later."""
    compiled = compile_mechanism(load(name).mechanism)
    time = default_times(compiled.mechanism, 36)
    a, b = (solve_forces(solve_motion(replace(compiled, executor=e), time)) for e in ("numpy", "c"))
    assert a.friction is not None and b.friction is not None and "_response" not in vars(b.friction)
    np.testing.assert_allclose(b.friction.loads, a.friction.loads, rtol=1e-12, atol=1e-12 * np.nanmax(a.friction.loads))
    for joint in (c.name for c in compiled.model.connections):
        wanted = a.reaction(joint)
        np.testing.assert_allclose(b.reaction(joint), wanted, atol=1e-12 * max(np.abs(wanted).max(), 1.0))
    np.testing.assert_allclose(b.friction.stability, a.friction.stability, rtol=1e-12)
    assert np.abs(b.power_balance).max() < 1e-12


def test_a_jam_is_left_to_numpy() -> None:
    compiled = compile_mechanism(load("jamming-sleeve").mechanism, executor="c")
    friction = solve_forces(solve_motion(compiled, default_times(compiled.mechanism, 24))).friction
    assert isinstance(forces_program(compiled.model, exact=True), ForcesProgram)
    assert friction is not None and friction.jammed.any() and not friction.jammed.all()


def test_what_cannot_be_assembled_is_missing_at_the_same_frames() -> None:
    compiled = compile_mechanism(four_bar(E=(0.3, 0.0), AB=0.2, BD=0.15, DE=0.2, start=0.5))  # the crank cannot turn fully
    time = np.linspace(0.0, 7.0, 400)
    a, b = (solve_motion(replace(compiled, executor=e), time, strict=False).pose("rocker") for e in ("numpy", "c"))
    assert np.isnan(a[:, 2]).any()
    np.testing.assert_array_equal(np.isnan(a), np.isnan(b))


def test_mechanisms_of_one_structure_share_a_program() -> None:
    first, second = (compile_mechanism(crank_rocker(b)).model.cached(written_motion) for b in (0.3, 0.31))
    assert isinstance(first, MotionProgram) and isinstance(second, MotionProgram)
    assert first.source == second.source


def test_auto_compiles_long_motions_only(monkeypatch: pytest.MonkeyPatch) -> None:
    model = compile_mechanism(crank_rocker()).model
    assert motion_program(model, "auto", 361) is None
    monkeypatch.setattr(compiled_motion, "LEAST_FRAMES_TO_COMPILE", 361)
    assert motion_program(model, "auto", 361) is not None
    assert motion_program(model, "numpy", 10**9) is None


def test_what_c_does_not_have_is_named() -> None:
    barrel = compile_mechanism(load("cam-barrel-arm").mechanism).model
    assert forces_program(barrel, exact=True) == "the cam of K touches its roller in space"


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["slider-crank-compressor", "cam-friction", "swinging-double-pendulum"])
def test_no_bit_depends_on_optimising(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The compiler keeps to the order of operations: what tests show of their programs holds of those of users."""
    assert "-O2" in OPTIMISED
    found = []
    for options in (("-O0", *OPTIMISED[1:]), OPTIMISED):
        monkeypatch.setattr(toolchain, "COMPILER_OPTIONS", options)
        library.cache_clear()
        compiled = compile_mechanism(load(name).mechanism, executor="c")
        if name.startswith("swinging"):
            found.append(np.hstack(simulate(compiled, 0.2)(np.linspace(0.0, 0.2, 9))))
            continue
        forces = solve_forces(solve_motion(compiled, default_times(compiled.mechanism, 36)))
        assert isinstance(forces_program(compiled.model, exact=True), ForcesProgram)
        found.append(np.hstack([forces.reaction(c.name).reshape(37, -1) for c in compiled.model.connections]))
    library.cache_clear()
    np.testing.assert_array_equal(*found)
