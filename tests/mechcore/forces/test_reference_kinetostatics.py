"""Joint reactions and driving torques against the high-precision reference cases."""

from __future__ import annotations

import numpy as np
import pytest
from comparison_columns import close, column
from mechanisms import case, four_bar, lever, load, slider_crank

from mechcore.laws.timed import ConstantSpeed
from mechcore.spec.loads import Force


@pytest.mark.parametrize("name", ["kinetostatics-fourbar", "kinetostatics-fourbar-gravity"])
def test_four_bar(name):
    c = case("kinetostatics", name)
    i, rows = c["inputs"], c["expected"]
    loaded = {2: "coupler", 3: "rocker"}[i["P_body"]]
    m = four_bar(
        E=i["E"],
        AB=i["AB"],
        BD=i["BD"],
        DE=i["DE"],
        start=rows[0]["theta_1"],
        bodies={n: (i[f"m{k}"], i[f"C{k}"], i[f"J{k}"]) for k, n in enumerate(("crank", "coupler", "rocker"), 1)},
        extra={loaded: {"P": tuple(i["P_point"])}},
        loads=(Force(name="P", link=loaded, point="P", vector=tuple(i["P"])),),
        effects=("inertia", "gravity") if "g" in i else ("inertia",),
    )
    forces = load(m, column(rows, "theta_1"), i["omega_1"], i["eps_1"])
    for joint, key, sign in (("A", "R_A_on_1", 1), ("B", "R_B_on_2", 1), ("D", "R_D_on_3", 1), ("E", "R_E_on_3", 1)):
        close(sign * forces.reaction(joint)[:, :2], column(rows, key))
        np.testing.assert_array_equal(forces.reaction(joint)[:, 2], 0.0)
    close(forces.effort("A"), column(rows, "drive_torque"))
    for k, link in enumerate(("crank", "coupler", "rocker"), 1):
        close(forces.inertia(link)[:, :2], column(rows, f"inertia_force_{k}"))
        close(forces.inertia(link)[:, 2], column(rows, f"inertia_moment_{k}"))
        close(forces.motion.centre_of_mass(link), column(rows, f"C{k}"))
        close(forces.motion.centre_of_mass(link, 1), column(rows, f"v_C{k}"))
        close(forces.motion.centre_of_mass(link, 2), column(rows, f"a_C{k}"))
    assert np.abs(forces.power_balance).max() < 1e-13


@pytest.mark.parametrize("name", ["kinetostatics-slider-crank", "kinetostatics-slider-crank-offset-deadcentres"])
def test_slider_crank_and_its_dead_centres(name):
    c = case("kinetostatics", name)
    i, rows = c["inputs"], c["expected"]
    m = slider_crank(
        r=i["r"],
        l=i["l"],
        e=i["e"],
        bodies={"crank": (i["m1"], i["C1"], i["J1"]), "rod": (i["m2"], i["C2"], i["J2"]), "piston": (i["m3"], (0.0, 0.0), 0.0)},
        loads=(Force(name="F", link="piston", point="C", vector=(i["F_piston"], 0.0)),),
        effects=("inertia", "gravity") if "g" in i else ("inertia",),
    )
    forces = load(m, column(rows, "theta_1"), i["omega_1"], i["eps_1"])
    close(forces.reaction("O")[:, :2], column(rows, "R_O_on_1"))
    close(forces.reaction("B")[:, :2], column(rows, "R_B_on_2"))
    close(forces.reaction("C")[:, :2], column(rows, "R_C_on_3"))
    guide = forces.reaction("S")
    close(guide[:, 1], column(rows, "N_guide_on_3"))
    assert np.abs(guide[:, 0]).max() < 1e-9, "a frictionless guide exerts nothing along itself"
    assert np.abs(guide[:, 2]).max() < 1e-9, "all forces on the piston pass through C"
    scale = 4000.0 * i["r"]
    assert np.abs(forces.effort("O") - column(rows, "drive_torque")).max() < 1e-11 * scale


def test_dead_centre_torque_is_zero_with_the_stated_slopes():
    c = case("linkages", "slider-crank-dead-centre-torque")
    i, e = c["inputs"], c["expected"]
    m = slider_crank(r=i["r"], l=i["l"], loads=(Force(name="F", link="piston", point="C", vector=(i["F"], 0.0)),))
    theta = column(e["rows"], "theta")
    torque = load(m, theta).effort("O")
    scale = abs(i["F"]) * i["r"]
    np.testing.assert_allclose(torque, column(e["rows"], "T"), rtol=1e-9, atol=1e-14 * scale)
    h = 1e-5
    for at, slope in ((0.0, e["slope_at_0"]), (np.pi, e["slope_at_pi"])):
        t = load(m, [at - h, at + h]).effort("O")
        assert (t[1] - t[0]) / (2 * h) == pytest.approx(slope, rel=1e-8)


def test_lever_mechanism_with_masses():
    c = case("kinetostatics", "kinetostatics-lever")
    i, rows = c["inputs"], c["expected"]
    m = lever(i["geometry"], law=ConstantSpeed(rows[0]["alpha"], 1.0), masses=i["masses"])
    for row in rows:
        f = load(m, [row["alpha"]], row["omega_1"], row["eps_1"])
        scale = np.abs(row["R_B_on_3"]).max()
        for joint, key in (("O", "R_O_on_1"), ("A", "R_A_on_2"), ("B", "R_B_on_3"), ("C", "R_C_on_4"), ("D", "R_D_on_5")):
            np.testing.assert_allclose(f.reaction(joint)[0, :2], row[key], rtol=0, atol=1e-10 * scale, err_msg=joint)
        on_block = f.reaction("L")[0]  # the lever is the joint's first link, the block its second
        u = np.exp(1j * f.motion.pose("lever")[0, 2])
        normal = (np.conj(1j * u) * -(on_block[0] + 1j * on_block[1])).real
        assert normal == pytest.approx(row["N_block_on_lever"], rel=1e-10)
        assert -on_block[2] == pytest.approx(row["M_block_on_lever"], rel=1e-9)
        assert f.reaction("S")[0, 1] == pytest.approx(row["N_guide_on_5"], rel=1e-10)
        assert f.effort("O")[0] == pytest.approx(row["drive_torque"], rel=1e-10)
        assert abs(f.power_balance[0]) < 1e-13
