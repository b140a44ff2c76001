"""Sweeps by a compiled program are those of numpy: positions, rates and forces of designs, and those that do not go together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from random_mechanisms import draw

from mechcore.arrays import Real
from mechcore.compiled import kernels
from mechcore.compiled.toolchain import compiler, library
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion import design_program
from mechcore.motion.compiled import Compiled
from mechcore.motion.design_program import DesignProgram
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.motion.sweep import Sweep, sweep
from mechcore.records import numbers_in
from mechcore.spec.mechanism import Mechanism
from mechviz.scene.scene import load

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")

SCENES = ("crank-rocker", "parametric-press", "shaper-quick-return")
RANDOM = (("slider-crank", 3), ("pin in slot", 2))


def collect(motion: Motion) -> Mapping[str, Real]:
    """The pose of a link with its rates, a coordinate, the reactions of two joints, the efforts."""
    forces, link, joints = solve_forces(motion), motion.model.links[-1], [c.name for c in motion.model.connections]
    result = {of: getattr(motion, of)(link) for of in ("pose", "velocity", "acceleration")}
    result |= {"coordinate": motion.coordinate(joints[-1])} | {f"reaction {k}": forces.reaction(k) for k in (joints[0], joints[-1])}
    return result | {f"effort {d.joint}": forces.effort(d.joint) for d in motion.mechanism.drives}


def swept(compiled: Compiled, time: Real, count: int = 70) -> list[Sweep]:
    """Sweeps by both executors of a joint's place, a link's mass and a number of a load."""
    mechanism, rng = compiled.mechanism, np.random.default_rng(1)
    joint = next(j for j in mechanism.joints if getattr(j, "points", None) is not None and j.links[1] != mechanism.frame)
    link = next(k for k in mechanism.links if k.name == joint.links[1])
    place = link.points[joint.points[1]] + 0.01 * compiled.model.length_scale * rng.standard_normal((count, 2))
    weights = link.mass * rng.uniform(1.0, 2.0, count), np.full((count, 2), link.centre), np.full(count, link.inertia)
    numbers = dict(list(numbers_in(mechanism.loads))[:1])
    loads = {key: x * rng.uniform(0.5, 1.5, count) for key, x in numbers.items()}
    points = {(link.name, joint.points[1]): place}
    with np.errstate(all="ignore"):
        return [sweep(replace(compiled, executor=e), points, time, collect, {link.name: weights}, loads) for e in ("numpy", "c")]


def check_alike(by_numpy: Sweep, by_c: Sweep, within: float) -> None:
    assert isinstance(by_c.program, DesignProgram), by_c.program
    np.testing.assert_array_equal(by_numpy.assembled, by_c.assembled)
    assert by_c.assembled.any()
    for name, wanted in by_numpy.results.items():
        computed, wanted = by_c.results[name][by_c.assembled], wanted[by_c.assembled]
        size = np.abs(wanted).max() + 1e-9
        assert np.broadcast_shapes(computed.shape, wanted.shape) == wanted.shape
        assert np.abs(computed - wanted).max() <= within * size, name


def with_forces(mechanism: Mechanism) -> Mechanism:
    return replace(mechanism, effects=("inertia", "gravity"))


@pytest.mark.parametrize("name", SCENES)
def test_designs_of_scenes_are_alike(name: str) -> None:
    compiled = compile_mechanism(with_forces(load(name).mechanism))
    check_alike(*swept(compiled, default_times(compiled.mechanism, 12)), 1e-11)


@pytest.mark.parametrize(("kind", "seed"), RANDOM)
def test_designs_of_random_mechanisms_are_alike(kind: str, seed: int) -> None:
    case = draw(kind, seed, travel=0.3)
    check_alike(*swept(compile_mechanism(case.mechanism), case.time[::8]), 1e-10)


def test_designs_that_do_not_go_together_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = compile_mechanism(load("crank-rocker").mechanism)
    time, lengths = default_times(compiled.mechanism, 24), np.linspace(0.03, 0.4, 1000)
    points = {("crank", "B"): np.column_stack([lengths, np.zeros(1000)])}
    monkeypatch.setattr(kernels, "LEAST_A_THREAD", 64)  # two threads, whose shares meet within the designs
    monkeypatch.setattr(kernels, "cores", lambda: 2)

    def collected(motion: Motion) -> Mapping[str, Real]:
        return {"point": motion.point("rocker", "C")}

    a, b = (sweep(replace(compiled, executor=e), points, time, collected) for e in ("numpy", "c"))
    assert isinstance(b.program, DesignProgram)
    assert 0 < a.assembled.sum() < 1000
    np.testing.assert_array_equal(a.assembled, b.assembled)
    np.testing.assert_array_equal(np.isnan(a.results["point"]), np.isnan(b.results["point"]))
    np.testing.assert_allclose(a.results["point"], b.results["point"], rtol=1e-9, atol=1e-12)  # next to dead points


def test_designs_whose_links_turn_far_between_times_are_left_to_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = compile_mechanism(load("crank-rocker").mechanism)
    points = {("crank", "B"): np.array([[0.06, 0.0], [0.03, 0.0]])}
    time = default_times(compiled.mechanism, 24)
    computed: list[int] = []

    def poses(motion: Motion) -> Mapping[str, Real]:
        computed.extend(motion.model.designs)
        return {"pose": motion.pose("rocker")}

    monkeypatch.setattr(design_program, "LARGEST_TURN", 0.04)  # [rad]: the longer crank moves the rocker by more
    a, b = (sweep(replace(compiled, executor=e), points, time, poses) for e in ("numpy", "c"))
    assert isinstance(b.program, DesignProgram)
    assert computed == [2, 1]
    np.testing.assert_allclose(b.results["pose"], a.results["pose"], atol=1e-12)


def test_designs_with_friction_are_those_of_runs_by_themselves() -> None:
    """Where a joint rests is judged by its peak of speed in each design; numpy has none with friction side by side."""
    mechanism = load("slider-crank-friction").mechanism
    compiled, cranks = compile_mechanism(mechanism, executor="c"), (0.05, 0.042)
    points, time = {("crank", "B"): np.array([[r, 0.0] for r in cranks])}, default_times(mechanism, 12)
    table = sweep(compiled, points, time, collect)
    assert isinstance(table.program, DesignProgram)
    for k, r in enumerate(cranks):
        links = [replace(x, points=x.points | {"B": (r, 0.0)}) if x.name == "crank" else x for x in mechanism.links]
        alone = collect(solve_motion(compile_mechanism(replace(mechanism, links=tuple(links))), time))
        for name, wanted in alone.items():
            np.testing.assert_allclose(table.results[name][k], wanted, atol=1e-12 * np.abs(wanted).max())
    with pytest.raises(MechanismError, match="numpy solves dry friction of one design at a time"):
        sweep(replace(compiled, executor="numpy"), points, time, collect)


def test_what_c_does_not_have_of_designs_is_named() -> None:
    compiled = compile_mechanism(load("crank-rocker").mechanism)
    points = {("coupler", "C"): np.array([[0.18, 0.0], [0.181, 0.0]])}
    time = default_times(compiled.mechanism, 8)
    compiled = replace(compiled, executor="c")
    table = sweep(compiled, points, time, lambda motion: {"x": np.cumsum(motion.condition)})
    assert table.program == "C does not have numpy's cumsum"
    table = sweep(compiled, points, time, lambda motion: {"x": motion.condition[..., 0:1] * np.ones((1, 8))})
    assert table.program == "a result or a load is computed in a way that C does not have", "no words of Python"


def test_auto_compiles_for_many_designs_and_takes_what_is_kept_for_some(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    library.cache_clear()
    points, time = {("coupler", "C"): np.array([[0.18, 0.0]])}, np.linspace(0.0, 1.0, 100)

    def by_auto(of: int) -> DesignProgram | str:
        compiled = compile_mechanism(load("crank-rocker").mechanism, executor="auto")
        return sweep(compiled, points, time, lambda motion: {"x": motion.point("coupler", "C")}, total=of).program

    assert "compiling pays from about 3,000,000 on" in str(by_auto(10_000))
    assert isinstance(by_auto(30_000), DesignProgram)
    assert isinstance(by_auto(10_000), DesignProgram)  # it is there now
    assert "199,900 frames of all designs were planned" in str(by_auto(1_999))
    library.cache_clear()
