"""Only what is called for: counted calls, never times."""

from __future__ import annotations

import importlib.util
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import mechviz
from mechcore.effects import registry as effects
from mechcore.effects.plan import StageKind, make_plan
from mechcore.forces.kinetostatics import solve_forces
from mechcore.kinematics.model import Model
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechviz.runs import run_scene
from mechviz.studies.cost import cost_lines, measure


@pytest.fixture
def calls(monkeypatch) -> Counter:
    """Counts what is solved and which effects are evaluated."""
    counted: Counter = Counter()

    def count(target, name: str, label: str) -> None:
        original = getattr(target, name)

        def counting(*args, **kwargs):
            counted[label] += 1
            return original(*args, **kwargs)

        monkeypatch.setattr(target, name, counting)

    from mechcore.forces import equilibrium
    from mechcore.motion import motion
    from mechviz import runs

    for stage in ("velocities", "accelerations"):
        count(motion, stage, stage)
    count(equilibrium, "joint_forces", "reactions")
    count(runs, "solve_forces", "forces")
    for cls in {*effects.EFFECTS.values(), *effects.LOADS.values()}:
        count(cls, "wrenches", cls.__name__)
        if "point_loads" in vars(cls):  # told beforehand, without the wrenches
            count(cls, "point_loads", cls.__name__)
        count(cls, "potential", f"{cls.__name__} potential")
    masses = Model.masses.func
    monkeypatch.setattr(Model, "masses", property(lambda self: (counted.update(["masses"]), masses(self))[1]))
    return counted


def test_only_positions_never_solve_velocities(calls):
    for name in ("four-stroke-cycle", "crank-rocker"):
        run = run_scene(mechviz.load(name), frames=60, outputs=("positions",))
        assert run.forces is None
        assert [s.name for s in run.stages] == ["compile", "positions"]
        run.motion.pose("crank")
    assert not calls, calls


def test_a_scene_without_masses_never_forms_inertia(calls):
    run = run_scene(mechviz.load("door-closer"), frames=60)
    assert run.forces is not None
    assert calls["LineDamper"] > 0 and calls["reactions"] > 0
    assert not {"Inertia", "Gravity", "masses"} & set(calls), calls


def test_a_scene_without_loads_never_evaluates_a_load(calls):
    run_scene(mechviz.load("ten-link-forces"), frames=60)
    loads = {cls.__name__ for cls in effects.LOADS.values()}
    assert calls["Inertia"] > 0
    assert not [name for name in calls if name.split()[0] in loads], calls


def test_pure_kinematics_evaluates_no_effect_and_no_force(calls):
    run_scene(mechviz.load("crank-rocker"), frames=60)
    assert set(calls) == {"velocities", "accelerations"}


def test_forces_of_position_alone_need_no_accelerations(calls):
    """A balanced lamp asked for its forces: gravity and a spring, so nothing is differentiated."""
    scene = mechviz.loads(mechviz.load("lamp-arm").text.replace('bearing = { viscous = "A", linear = "0.02 N m s/rad" }', ""))
    run = run_scene(scene, frames=60, outputs=("positions", "forces"))
    assert run.forces is not None and abs(run.forces.effort("A")).max() < 1e-14 * 5.1  # N m, of the moments that balance
    assert calls["velocities"] == 0 and calls["accelerations"] == 0
    skipped = {s.name: s.why for s in make_plan(scene.mechanism, ("positions", "forces")).skipped}
    assert "no force depends on a velocity" in skipped["velocities"]
    assert "accelerations" in skipped


def test_each_effect_is_evaluated_once_for_the_reactions(calls):
    mechanism = mechviz.load("plunger-in-drag").mechanism
    forces = solve_forces(solve_motion(compile_mechanism(mechanism), default_times(mechanism, 60)))
    forces.reaction(mechanism.joints[0].name)
    assert calls["MediumDrag"] == calls["Inertia"] == calls["Gravity"] == calls["reactions"] == 1
    assert calls["ViscousFriction"] == 2  # two loads of that kind


def test_the_plan_names_what_needs_what():
    plan = make_plan(mechviz.load("tailgate").mechanism, ("positions", "forces"))
    steps = {s.name: s.why for s in (*plan.computed, *plan.skipped)}
    assert steps["velocities"] == "damper needs them"
    assert steps["load strut"] == "elastic, from positions"
    assert steps["load damper"] == "viscous, from positions and velocities"
    assert not plan.has(StageKind.ACCELERATIONS) and not plan.has(StageKind.EFFECT, "inertia")


def test_measured_costs_name_every_stage_of_the_plan():
    scene = mechviz.load("compressor-cycle")
    costs = measure(scene, repeats=2)
    assert [c.name for c in costs] == [
        "compile", "positions", "velocities", "accelerations", "effect inertia", "load bearing", "load oil", "load air",
        "reactions and drive efforts", "energy and power balance", "closure and condition",
    ]  # fmt: skip
    assert all(c.seconds > 0.0 for c in costs)
    assert len(cost_lines(costs, 721)) == len(costs) + 3
    plain = measure(mechviz.load("crank-rocker"), repeats=1)
    assert "reactions and drive efforts" not in [c.name for c in plain]


def test_the_benchmark_of_prices_has_every_effect_of_the_registry(monkeypatch):
    folder = Path(__file__).resolve().parents[3] / "benchmarks"
    monkeypatch.syspath_prepend(str(folder))
    spec = importlib.util.spec_from_file_location("effects_benchmark", folder / "effects.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for result in module.cases().values():
        compiled = compile_mechanism(result["bare"])
        assert module.by_plan(compiled, default_times(result["bare"], 24, 2))().frames > 24  # no forces: a motion
        for name, mechanism in list(result.items())[1:]:
            assert np.isfinite(
                module.by_plan(compile_mechanism(mechanism), default_times(mechanism, 24, 2))().power_supplied
            ).all(), name
    monkeypatch.delitem(module.ON_BELT, "belt tension")
    with pytest.raises(ValueError, match="no case for BeltTension"):
        module.cases()
