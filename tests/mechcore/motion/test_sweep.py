"""Sweeps: every design agrees with the same design computed by itself; those that do not assemble are marked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from comparison_columns import class_three
from mechanisms import four_bar, slider_crank

from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.motion.sweep import sweep

TIME = np.linspace(0.0, 2.0 * np.pi, 37)


def collect(motion):
    return {
        "point": motion.point("coupler", "P"),
        "velocity": motion.point("coupler", "P", 1),
        "acceleration": motion.point("coupler", "P", 2),
        "pose": motion.pose("rocker"),
        "closure": motion.closure,
        "pin": motion.point("coupler", "D", 2),
        "joint": motion.joint_position("D"),
    }


def test_a_sweep_is_the_same_as_design_by_design():
    rng = np.random.default_rng(3)
    count = 300  # more than one chunk
    crank, coupler = rng.uniform(0.5, 1.0, count), rng.uniform(3.2, 4.0, count)
    frame = np.column_stack([rng.uniform(3.8, 4.2, count), rng.uniform(-0.2, 0.2, count)])
    base = four_bar(E=(4.0, 0.0), AB=1.0, BD=3.5, DE=3.0, coupler_point=(1.5, 1.0))
    zero = np.zeros(count)
    table = sweep(
        compile_mechanism(base),
        {("crank", "B"): np.column_stack([crank, zero]), ("coupler", "D"): np.column_stack([coupler, zero]), ("frame", "E"): frame},
        TIME,
        collect,
    )
    assert table.assembled.all() and table.results["point"].shape == (count, len(TIME), 2)
    assert table.results["closure"].max() < 1e-14
    for i in (0, 100, 299):
        alone = four_bar(E=frame[i], AB=crank[i], BD=coupler[i], DE=3.0, coupler_point=(1.5, 1.0))
        motion = solve_motion(compile_mechanism(alone), TIME)
        for name, value in collect(motion).items():
            np.testing.assert_allclose(table.results[name][i], value, rtol=1e-13, atol=1e-13)


def test_designs_that_do_not_assemble_are_marked_not_fatal():
    base = four_bar(E=(4.0, 0.0), AB=1.0, BD=3.5, DE=3.0, coupler_point=(1.5, 1.0))
    lengths = np.column_stack([[1.0, 3.0, 1.2, 20.0], np.zeros(4)])
    table = sweep(compile_mechanism(base), {("crank", "B"): lengths}, TIME, collect)
    assert table.assembled.tolist() == [True, False, True, False]
    bad = np.isnan(table.results["point"]).any(axis=2)
    assert bad[1].any() and not bad[1].all(), "only the frames out of reach are missing"
    assert bad[3].all() and not bad[[0, 2]].any()


def test_slides_sweep_too():
    base = slider_crank(r=1.0, l=3.0)
    table = sweep(
        compile_mechanism(base),
        {("rod", "C"): [[3.0, 0.0], [4.0, 0.0]]},
        TIME,
        lambda m: {"s": m.coordinate("S")},
    )
    for k, rod in enumerate((3.0, 4.0)):
        s = np.cos(TIME) + np.sqrt(rod**2 - np.sin(TIME) ** 2)
        np.testing.assert_allclose(table.results["s"][k, :, 0], s, rtol=1e-14)


def test_what_a_sweep_cannot_do_is_refused():
    with pytest.raises(MechanismError, match="followed along their course"):
        sweep(compile_mechanism(class_three()), {("crank", "B"): [[0.04, 0.0]]}, TIME, lambda m: {})
    compiled = compile_mechanism(four_bar(E=(4.0, 0.0), AB=1.0, BD=3.5, DE=3.0))
    with pytest.raises(MechanismError, match="no point 'X'"):
        sweep(compiled, {("crank", "X"): [[1.0, 0.0]]}, TIME, lambda m: {})
    with pytest.raises(MechanismError, match="different numbers of designs"):
        sweep(compiled, {("crank", "B"): [[1.0, 0.0]], ("coupler", "D"): [[3.0, 0.0], [3.1, 0.0]]}, TIME, lambda m: {})


def test_masses_and_forces_sweep_as_design_by_design():
    rng = np.random.default_rng(5)
    count = 20
    base = slider_crank(r=1.0, l=3.0)
    links = [replace(link, mass=2.0, centre=(0.5, 0.1), inertia=0.3) if link.name != "frame" else link for link in base.links]
    base = replace(base, links=tuple(links), effects=("inertia", "gravity"))
    rod = np.column_stack([rng.uniform(2.5, 3.5, count), np.zeros(count)])
    mass, centre, inertia = rng.uniform(1.0, 3.0, count), rng.uniform(-0.5, 0.5, (count, 2)), rng.uniform(0.1, 0.5, count)

    def forces_of(motion):
        forces = solve_forces(motion)
        return {
            "B": forces.reaction("B"),
            "torque": forces.effort(base.drives[0].joint),
            "power": forces.power(base.drives[0].joint),
        }

    table = sweep(compile_mechanism(base), {("rod", "C"): rod}, TIME, forces_of, masses={"rod": (mass, centre, inertia)})
    for k in (0, 7, 19):
        body = replace(links[2], points={**links[2].points, "C": tuple(rod[k])}, mass=mass[k], centre=tuple(centre[k]))
        body = replace(body, inertia=inertia[k])
        alone = replace(base, links=tuple(body if link.name == "rod" else link for link in base.links))
        for name, value in forces_of(solve_motion(compile_mechanism(alone), TIME)).items():
            np.testing.assert_allclose(table.results[name][k], value, rtol=1e-12, atol=1e-12 * np.abs(value).max())
