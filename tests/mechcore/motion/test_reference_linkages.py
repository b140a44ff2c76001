"""Kinematics against the high-precision reference cases (see `tests/reference`)."""

from __future__ import annotations

import numpy as np
import pytest
from comparison_columns import class_three, close, column
from mechanisms import case, drawn, four_bar, lever, move, pin, slider_crank, watt_six_bar

from mechcore.laws.timed import ConstantSpeed, zones
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.mechanism import Drive, Link, Mechanism, Prismatic


@pytest.mark.parametrize("name", ["fourbar-crank-rocker", "fourbar-double-rocker-nongrashof"])
@pytest.mark.parametrize("branch", ["+1", "-1"])
def test_four_bar_on_both_branches(name, branch):
    c = case("linkages", name)
    i, rows = c["inputs"], c["expected"][f"branch_{branch}"]
    theta = column(rows, "theta_1")
    m = four_bar(
        E=i["E"],
        AB=i["AB"],
        BD=i["BD"],
        DE=i["DE"],
        coupler_point=i["coupler_point"],
        mode="left" if branch == "+1" else "right",
        start=theta[0],
    )
    motion = move(m, theta, i["omega_1"], i["eps_1"])
    close(motion.point("coupler", "B"), column(rows, "B"))
    close(motion.point("coupler", "D"), column(rows, "D"))
    for link, k in (("coupler", 2), ("rocker", 3)):
        close(np.exp(1j * motion.pose(link)[:, 2]).imag, np.sin(column(rows, f"theta_{k}")))
        close(motion.velocity(link)[:, 2], column(rows, f"omega_{k}"))
        close(motion.acceleration(link)[:, 2], column(rows, f"eps_{k}"))
    for d, key in enumerate(("coupler_point", "coupler_point_velocity", "coupler_point_acceleration")):
        close(motion.point("coupler", "P", d), column(rows, key))
    assert (motion.closure < 1e-15).all()


def test_offset_slider_crank_with_its_dead_centres():
    c = case("linkages", "slider-crank-kinematics")
    i, rows = c["inputs"], c["expected"]["rows"]
    motion = move(slider_crank(r=i["r"], l=i["l"], e=i["e"]), column(rows, "theta_1"), i["omega_1"], i["eps_1"])
    s = motion.coordinate("S")
    close(s[:, 0], column(rows, "x_C"))
    close(s[:, 1], column(rows, "v_C"))
    close(s[:, 2], column(rows, "a_C"))
    close(motion.velocity("rod")[:, 2], column(rows, "omega_2"))
    close(motion.acceleration("rod")[:, 2], column(rows, "eps_2"))
    assert (np.abs(s[:2, 1]) < 1e-13 * np.abs(s[:, 1]).max()).all(), "the first two rows are the dead centres"


@pytest.mark.parametrize(
    "name",
    ["lever-canonical-zones", "lever-variant-C-same-side", "lever-variant-D-left", "lever-full-turn", "lever-quick-return-shaper"],
)
def test_lever_mechanism_of_the_contour_graph_article(name):
    c = case("lever_contour", name)
    i, expected = c["inputs"], c["expected"]
    rows = expected if isinstance(expected, list) else expected["table"]
    m = lever(i["geometry"], law=ConstantSpeed(rows[0]["alpha"], 1.0))
    for row in rows:
        motion = move(m, [row["alpha"]], row["omega_1"], row["eps_1"])
        close(motion.point("lever", "C")[0], row["C"])
        close(motion.coordinate("S")[0, 0], row["x_D"])
        close(motion.coordinate("L")[0, 0], row["BA"])
        for key, value in (
            ("omega_30", motion.velocity("lever")[0, 2]),
            ("eps_30", motion.acceleration("lever")[0, 2]),
            ("omega_43", motion.coordinate("C")[0, 1]),
            ("eps_43", motion.coordinate("C")[0, 2]),
            ("v_D", motion.coordinate("S")[0, 1]),
            ("a_D", motion.coordinate("S")[0, 2]),
        ):
            assert value == pytest.approx(row[key], rel=1e-10, abs=1e-10), (key, row["alpha_deg"])


def test_crank_law_of_the_article_and_the_lever_run_through_its_zones():
    c = case("lever_contour", "lever-crank-law")
    expected = c["expected"]
    deg = np.pi / 180.0
    law = zones(start=38 * deg, speed=6.283, run_up=12 * deg, steady=66 * deg, braking=12 * deg)
    assert law.duration == pytest.approx(expected["t_total"], rel=1e-13)
    for t, alpha in expected["alpha_at_time"]:
        assert law(t)[0] == pytest.approx(alpha, rel=1e-13)
    before, after = law(np.nextafter(law.breaks[0], 0)), law(np.nextafter(law.breaks[0], 1))
    assert before[2] == pytest.approx(expected["eps_run_up"], rel=1e-12)
    assert after[2] == 0.0
    assert law(law.breaks[0])[2] == pytest.approx(expected["eps_run_up"], rel=1e-12), "half-open: the boundary ends its zone"
    geometry = case("lever_contour", "lever-canonical-zones")["inputs"]["geometry"]
    compiled = compile_mechanism(lever(geometry, law=law))
    rows = [r for r in case("lever_contour", "lever-canonical-zones")["expected"] if r["zone"] == "steady"]
    t = law.breaks[0] + (column(rows, "alpha") - 50 * deg) / 6.283
    motion = solve_motion(compiled, t)
    inside = slice(1, -1)  # at the zone's ends the accelerations jump
    close(motion.coordinate("S")[inside, 1], column(rows, "v_D")[inside])
    close(motion.coordinate("S")[inside, 2], column(rows, "a_D")[inside])


def test_watt_six_bar():
    c = case("linkages", "sixbar-watt")
    i, rows = c["inputs"], c["expected"]
    motion = move(watt_six_bar(i, speed=i["omega_1"]), column(rows, "theta_1"), i["omega_1"], 0.0)
    assert [b.kind for b in motion.model.blocks] == ["theta_theta", "theta_theta"]
    for key in ("H", "K"):
        close(motion.point("link", key), column(rows, key))
        close(motion.point("link", key, 1), column(rows, f"v_{key}"))
    close(motion.point("link", "K", 2), column(rows, "a_K"))
    close(motion.velocity("output")[:, 2], column(rows, "omega_KN"))
    close(motion.acceleration("output")[:, 2], column(rows, "eps_KN"))


def test_peaucellier_draws_a_straight_line():
    c = case("linkages", "peaucellier")
    i, e = c["inputs"], c["expected"]
    rows = e["rows"]
    first = rows[0]
    points = {"O": (0.0, 0.0), "C": (i["r"], 0.0), **{k: first[k] for k in "PABQ"}}
    links = {"crank": "CP", "OA": "OA", "OB": "OB", "AP": "AP", "PB": "PB", "AQ": "AQ", "QB": "QB"}
    start = np.arctan2(first["P"][1], first["P"][0] - i["r"])
    m = drawn(points, links, ["O", "C"], drive="C", law=ConstantSpeed(0.0, 1.0))
    angle = np.array([np.arctan2(r["P"][1], r["P"][0] - i["r"]) for r in rows])
    motion = move(m, angle - start)
    for key, link in (("A", "OA"), ("B", "OB"), ("Q", "QB")):
        close(motion.point(link, key), column(rows, key), 1e-11)
    close(motion.point("QB", "Q")[:, 0], np.full(len(rows), e["x_line"]), 1e-12)


def test_elliptic_trammel_driven_by_its_angle():
    c = case("linkages", "elliptic-trammel")
    i, rows = c["inputs"], c["expected"]
    m = Mechanism(
        name="trammel",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0)}),
            Link(name="a", points={"A": (0.0, 0.0)}),
            Link(name="b", points={"B": (0.0, 0.0)}),
            Link(name="bar", points={"A": (0.0, 0.0), "B": (i["L"], 0.0), "P": (i["c"], 0.0)}),
        ),
        joints=(
            Prismatic(name="x", links=("frame", "a"), points=("O", "A")),
            Prismatic(name="y", links=("frame", "b"), points=("O", "B"), along=(0.0, 1.0)),
            pin("A", "a", "bar"),
            pin("B", "b", "bar"),
        ),
        drives=(Drive(joint="A", law=ConstantSpeed(np.pi, -1.0)),),
    )
    theta = column(rows, "theta")
    motion = move(m, np.pi - theta, -i["theta_dot"], -i["theta_ddot"])
    assert [b.kind for b in motion.model.blocks] == ["slide_slide"]
    close(motion.coordinate("x"), np.column_stack([column(rows, k) for k in ("A_x", "v_A", "a_A")]))
    close(motion.coordinate("y"), np.column_stack([column(rows, k) for k in ("B_y", "v_B", "a_B")]))
    close(motion.point("bar", "P", 1), column(rows, "v_P"))
    close(motion.point("bar", "P", 2), column(rows, "a_P"))


def test_class_three_group_that_no_chain_of_dyads_solves():
    c = case("misc", "assur-class-III")
    rows = c["expected"]["rows"]
    motion = move(class_three(), column(rows, "theta_1_deg") * np.pi / 180.0, c["inputs"]["omega_1"])
    assert [b.kind for b in motion.model.blocks] == ["general"]
    close(motion.pose("ternary"), np.column_stack([column(rows, k) for k in ("x", "y", "phi")]), 1e-9)
    close(motion.velocity("ternary"), np.column_stack([column(rows, k) for k in ("v_x", "v_y", "omega")]), 1e-9)
    close(motion.acceleration("ternary"), np.column_stack([column(rows, k) for k in ("a_x", "a_y", "eps")]), 1e-9)
    assert (motion.closure < 1e-12 * motion.model.length_scale).all()


@pytest.mark.parametrize("kind", ["contour-fourbar", "contour-slider-crank"])
def test_loop_equations_relative_motions(kind):
    c = case("misc", kind)
    i, rows = c["inputs"], c["expected"]
    theta = column(rows, "theta_1_deg") * np.pi / 180.0
    if kind == "contour-fourbar":
        motion = move(four_bar(E=i["E"], AB=i["AB"], BD=i["BD"], DE=i["DE"], start=theta[0]), theta, i["omega_1"], i["eps_1"])
        joints = {"21": ("B", 1), "32": ("D", 1), "03": ("E", -1)}
    else:
        motion = move(slider_crank(r=i["r"], l=i["l"], e=i["e"]), theta, i["omega_1"], i["eps_1"])
        joints = {"21": ("B", 1), "32": ("C", 1)}
        close(motion.coordinate("S")[:, 1], -column(rows, "v_C03"))
        close(motion.coordinate("S")[:, 2], -column(rows, "a_C03"))
    for key, (joint, sign) in joints.items():
        close(sign * motion.coordinate(joint)[:, 1], column(rows, f"omega_{key}"))
        close(sign * motion.coordinate(joint)[:, 2], column(rows, f"eps_{key}"))
