"""Equilibrium equations by groups: the solved forces fulfil them, all at once they give the same, and their numbers are the
reference's."""

from __future__ import annotations

import numpy as np
import pytest

import mechviz
from mechcore.constructions import equations
from mechcore.constructions.equations import EquilibriumSystem
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechviz.runs import run_scene
from mechviz.studies.equations import equation_lines, equilibrium_at, latex_lines

NAMES = (
    "kinetostatic-four-bar", "slider-crank-compressor", "cam-friction", "cam-conjugate-oscillating", "four-bar-friction-circles",
    "gear-train", "belt-drive", "rack-and-pinion", "slotted-lever",
)  # fmt: skip


def equilibrium_of(name, frames=9):
    scene = mechviz.load(name)
    motion = solve_motion(compile_mechanism(scene.mechanism), default_times(scene.mechanism, frames, scene.cycles))
    return EquilibriumSystem(solve_forces(motion))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("dense", [equations.DENSE_UNKNOWNS, 0], ids=["full", "sparse"])
def test_all_equations_at_once_give_what_the_groups_gave(name, dense, monkeypatch):
    """Newton and Euler for every link, without cuts, trees or virtual work; of many links by a sparse matrix."""
    monkeypatch.setattr(equations, "DENSE_UNKNOWNS", dense)
    equilibrium = equilibrium_of(name)
    assert equilibrium.determinate and equilibrium.matrix.shape[1] == equilibrium.matrix.shape[2]
    known = np.isfinite(equilibrium.values).all(axis=1)
    assert known.any() and equilibrium.residual[known].max() < 1e-11
    largest = np.abs(equilibrium.values[known]).max()
    assert equilibrium.at_once()[known] == pytest.approx(equilibrium.values[known], abs=1e-9 * largest)


@pytest.mark.parametrize("name", NAMES)
def test_every_group_decides_as_many_unknowns_as_it_has_equations(name):
    equilibrium = equilibrium_of(name)
    given = set()
    for group in equilibrium.groups(3):
        assert len(group.solved) == 3 * len(group.links)
        assert {u for u, _ in group.known} <= given
        given |= {u for u, _ in group.solved}
        values = dict(group.solved + group.known)
        scale = max(map(abs, values.values()), default=1.0)
        for link in group.links:
            for equation in link.equations:
                left = equation.load + sum(c * values[u] for c, u in equation.terms)
                assert abs(left) <= 1e-10 * scale
                column = {"Fx": 1, "Fy": 2, "M": 3}[equation.sum]
                assert equation.load == pytest.approx(sum(row[column] for row in link.loads), abs=1e-12 * scale)
    assert given == set(equilibrium.unknowns)


def test_the_numbers_are_those_of_the_reference():
    """Reference case kinetostatics-fourbar at crank angle 0: the dyad first, then the crank with its torque."""
    first, last = equilibrium_of("kinetostatic-four-bar").groups(0)
    assert [link.link for link in first.links] == ["coupler", "rocker"] and [link.link for link in last.links] == ["crank"]
    values = {u.name: v for u, v in (*first.solved, *last.solved)}
    assert values["T_A"] == pytest.approx(6.263621286093999, rel=1e-10)
    assert (values["R_Dx"], values["R_Dy"]) == pytest.approx((89.16285328808743, 89.67820599095988), rel=1e-10)
    moments = first.links[0].equations[2]
    assert moments.about == "D" and {u.joint for _, u in moments.terms} == {"B"}  # the pin in between has no arm, as by hand
    assert {u.name for u, _ in last.known} == {"R_Bx", "R_By"}


def test_a_sparse_matrix_tells_positions_at_which_it_is_singular(monkeypatch):
    """All rods and bars of the chain on one line, twice a turn: nothing decides how the bars are pressed."""
    full = equilibrium_of("four-bar-chain", 8)
    singular = np.linalg.cond(full.matrix) > 1e12
    monkeypatch.setattr(equations, "DENSE_UNKNOWNS", 0)
    sparse = equilibrium_of("four-bar-chain", 8)
    assert singular.sum() == 2
    assert np.isnan(sparse.at_once()).all(axis=1).tolist() == singular.tolist()
    assert sparse.determinate and full.determinate


def test_a_redundant_mechanism_is_told_as_such():
    equilibrium = equilibrium_of("double-parallelogram")
    assert not equilibrium.determinate and equilibrium.matrix.shape[2] == equilibrium.matrix.shape[1] + 1
    assert equilibrium.residual.max() < 1e-11


def test_arms_are_about_the_joint():
    """A crank of 0.1 m: the pin's force across it has a moment about A of 0.1 m times it, whatever the origin of its frame."""
    crank = equilibrium_of("kinetostatic-four-bar").groups(0)[-1].links[0]
    arms = {u.name: c for c, u in crank.equations[2].terms}
    assert arms == pytest.approx({"R_By": -0.1, "T_A": 1.0})


def test_what_statics_does_not_determine_is_said_of_every_group():
    """Three parallel cranks of 0.1 m, one too many: of 13 unknowns only the torque is decided, by the power of weight and load."""
    cranks = {"a": ("A", "B", 0.0), "b": ("F", "G", 0.2), "c": ("D", "C", 0.4)}
    links = "\n".join(
        f'{k} = {{ points = {{ {p} = [0, 0], {q} = [0.1, 0] }}, mass = "0.4 kg", centre = [0.05, 0] }}'
        for k, (p, q, _) in cranks.items()
    )
    joints = "\n".join(f'{q} = {{ revolute = ["{k}", "bar"] }}' for k, (_, q, _) in cranks.items())
    fixed = "\n".join(f'{p} = {{ revolute = ["frame", "{k}"] }}' for k, (p, _, _) in cranks.items() if k != "a")
    sketch = "\n".join(f"{k} = {{ at = [{x}, 0], angle = 0.6 }}" for k, (_, _, x) in cranks.items())
    scene = mechviz.loads(f"""
effects = ["gravity"]
[links]
frame = {{ points = {{ A = [0, 0], D = [0.4, 0], F = [0.2, 0] }} }}
{links}
bar = {{ points = {{ B = [0, 0], G = [0.2, 0], C = [0.4, 0] }}, mass = "2 kg", centre = [0.25, 0] }}
[joints]
A = {{ revolute = ["frame", "a"], drive = {{ speed = "60 rpm", start = 0.6, travel = 1 }} }}
{joints}
{fixed}
[sketch]
{sketch}
[loads.P]
force = ["-20 N", "-50 N"]
on = "bar"
at = "G"
""")
    run = run_scene(scene, frames=4)
    equilibrium, frame = equilibrium_at(run, 0.0)
    groups = equilibrium.groups(frame)
    solved = {u.name: value for group in groups for u, value in group.solved}
    arm_x, arm_y = 0.1 * np.cos(0.6), 0.1 * np.sin(0.6)
    torque = 9.81 * (3 * 0.4 * 0.5 + 2.0) * arm_x - 20.0 * arm_y + 50.0 * arm_x
    assert solved == {"T_A": pytest.approx(torque, rel=1e-9)}
    assert sum(len(group.undetermined) for group in groups) == 12
    assert "gives      T_A" in (text := "\n".join(equation_lines(equilibrium, frame, scene.units)))
    assert text.count("statics does not determine these") == 3 and "gives      R_" not in text
    assert "statics does not determine these" in "\n".join(latex_lines(equilibrium, frame, scene.units))
