"""The core's parts: block order, angles and loops, closed forms, limits, long runs, and what is not computed."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from cam_scenes import changed, solved, text_of
from comparison_columns import class_three
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import case, drawn, four_bar, lever, load, move, pin, slider_crank, watt_six_bar
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.kinematics import dyads as cf
from mechcore.laws.timed import ConstantSpeed, Oscillation
from mechcore.motion.reach import reachable_ranges
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.motion.structure import groups, gruebler, loop_joints, rank_mobility, redundant_joints
from mechcore.spec.loads import Force
from mechcore.spec.mechanism import Drive, Link, Mechanism, PinSlot, Prismatic, Revolute
from mechcore.topology.order import block_order, maximum_matching

ROCKER = {"E": (0.3, 0.05), "AB": 0.22, "BD": 0.16, "DE": 0.21}


def test_core_needs_numpy_and_scipy_only():
    """In a fresh interpreter in which nothing else can be imported, every module of the core loads and a linkage is solved."""
    code = """
import importlib, pkgutil, sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        top = name.split(".")[0]
        if top.lstrip("_").startswith("sysconfig"): return
        if top not in sys.stdlib_module_names and top not in {"numpy", "scipy", "mechcore"}:
            raise ImportError(f"the core must not need {name}")
sys.meta_path.insert(0, Refuse())
import mechcore
for module in pkgutil.walk_packages(mechcore.__path__, "mechcore."):
    importlib.import_module(module.name)
from mechcore.spec.mechanism import Drive, Link, Mechanism, Revolute
from mechcore.laws import ConstantSpeed
links = Link(name="f", points={"A": (0.0, 0.0)}), Link(name="c", points={"A": (0.0, 0.0)})
m = Mechanism(name="crank", frame="f", links=links,
              joints=(Revolute(name="A", links=("f", "c"), points=("A", "A")),),
              drives=(Drive(joint="A", law=ConstantSpeed(0.0, 2.0)),))
motion = mechcore.solve_motion(mechcore.compile_mechanism(m), [0.0, 0.5])
print(motion.pose("c")[1, 2])
loaded = {m.split(".")[0] for m in sys.modules}
assert not loaded & {"trimesh", "rerun", "viser", "pydantic", "pint", "mechviz"}, loaded
"""
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert out.returncode == 0 and float(out.stdout) == 1.0, out.stderr


@pytest.mark.parametrize("order", [1, -1])
def test_along_a_chain_of_drives_each_link_adds_its_own(order):
    """However the links and drives are numbered; in order each rotation is the one before and one factor more."""
    n, times = 12, np.linspace(0.0, 1.3, 5)
    names = ["frame", *(f"L{k}" for k in range(n))]
    ends = [(k, k + 1) if k % 3 else (k + 1, k) for k in range(n)]  # some joints name the later link first
    links = [Link(name=name, points={"A": (0.0, 0.0), "B": (1.0, 0.0)}) for name in names]
    joints = tuple(
        Revolute(name=f"J{k}", links=(names[p], names[q]), points=("B", "A") if p < q else ("A", "B"))
        for k, (p, q) in enumerate(ends)
    )
    drives = tuple(Drive(joint=f"J{k}", law=ConstantSpeed(0.1 * k, 1.0 + k)) for k in range(n))[::order]
    mechanism = Mechanism(name="chain", frame="frame", links=(links[0], *links[1:][::order]), joints=joints, drives=drives)
    compiled = compile_mechanism(mechanism)
    motion = solve_motion(compiled, times)
    angle, at = np.zeros(len(times)), np.ones(len(times), complex)
    for k in range(n):
        angle = angle + (1 if ends[k][0] < ends[k][1] else -1) * (0.1 * k + (1.0 + k) * times)
        x, y, turned = motion.pose(f"L{k}").T
        assert np.allclose(turned, angle, atol=1e-12) and np.allclose(x + 1j * y, at, atol=1e-12)
        at = at + np.exp(1j * angle)
    program = compiled.model.program
    factors = [1 if program.shorter[s] >= 0 else len(terms) for s, terms in program.driven_rotations]
    assert sum(factors) == (n if order == 1 else n * (n + 1) // 2)


# -- block order ----------------------------------------------------------------------------------------------------
def test_blocks_come_in_an_order_in_which_each_needs_only_earlier_ones():
    order = block_order([[0], [0, 1, 2], [0, 1, 2], [2, 3], [3, 4], [3, 4]], 5)
    assert [u for _, u in order.blocks] == [(0,), (1, 2), (3,), (4,)] or len(order.redundant) == 1
    known: set[int] = set()
    pattern = [[0], [0, 1, 2], [0, 1, 2], [2, 3], [3, 4], [3, 4]]
    for equations, unknowns in order.blocks:
        for e in equations:
            assert set(pattern[e]) <= known | set(unknowns)
        known |= set(unknowns)
    assert len(order.redundant) == 1 and order.free == ()


@given(st.lists(st.sets(st.integers(0, 7), min_size=1, max_size=4), min_size=1, max_size=10))
def test_block_order_is_sound_for_any_pattern(pattern):
    rows = [sorted(p) for p in pattern]
    order = block_order(rows, 8)
    matched = [u for _, us in order.blocks for u in us]
    assert len(matched) == len(set(matched))
    assert len(matched) + len(order.free) == 8
    assert sum(len(e) for e, _ in order.blocks) + len(order.redundant) == len(rows)
    known = set(order.unmatched)
    for equations, unknowns in order.blocks:
        for e in equations:
            assert set(rows[e]) <= known | set(unknowns)
        known |= set(unknowns)


@given(st.lists(st.sets(st.integers(0, 6), max_size=4), max_size=9))
def test_as_many_equations_as_possible_get_an_unknown_of_their_own(pattern):
    rows = [sorted(p) for p in pattern]
    match = maximum_matching(rows, 7)
    owned = [u for u in match if u >= 0]
    assert len(owned) == len(set(owned)) and all(u < 0 or u in p for u, p in zip(match, rows, strict=True))
    graph = np.zeros((len(rows), 7), bool)
    for e, p in enumerate(rows):
        graph[e, p] = True
    best = maximum_bipartite_matching(csr_array(graph), perm_type="column") if len(rows) else np.zeros(0)
    assert len(owned) == np.count_nonzero(best >= 0)


# -- closed forms -----------------------------------------------------------------------------------------------------
angle = st.floats(-3.1, 3.1)
length = st.floats(0.1, 10.0)


@given(length, length, angle, angle, st.sampled_from([1.0, -1.0]))
def test_theta_theta_closes_with_unit_rotations(a, b, u, v, mode):
    c = np.array([a * np.exp(1j * u) + b * np.exp(1j * v)])
    if abs(c[0]) < 1e-3:
        return
    e1, e2 = cf.theta_theta(a + 0j, b + 0j, c, mode)
    assert abs(a * e1 + b * e2 - c)[0] < 1e-14 * (a + b)
    assert abs(abs(e1) - 1)[0] < 1e-13 * (a + b) / abs(c[0])
    assert mode * cf.cross(c, a * e1)[0] >= -1e-12


@given(length, angle, angle, st.floats(-3.0, 3.0), st.sampled_from([1.0, -1.0]))
def test_theta_slide_and_arm_slide_close(a, u, v, s, mode):
    d = np.exp(1j * np.array([v]))
    c = a * np.exp(1j * u) + s * d
    e, computed = cf.theta_slide(a + 0j, d, c, mode)
    assert abs(a * e + computed * d - c)[0] < 1e-13 * (a + abs(s))
    arm, unit = 0.3 * a * 1j + 0.1, 1 + 0j
    target = (arm + s * unit) * np.exp(1j * np.array([u]))
    e, computed = cf.arm_slide(arm, unit, target, mode)
    if abs(target[0]) > 1e-3:
        assert abs((arm + computed * unit) * e - target)[0] < 1e-12 * (a + abs(s) + 1)


def test_needle_triangles_keep_their_digits():
    """A relative 1e-12 short of the dead point, against 50-digit arithmetic done with integers."""
    from fractions import Fraction
    from math import isqrt

    a, b, d = 3.0, 1.0, 4.0 * (1 - 1e-12)
    s = [Fraction(x) for x in (a, b, d)]
    product = (s[0] + s[1] + s[2]) * (s[0] + s[1] - s[2]) * (s[2] - s[0] + s[1]) * (s[2] + s[0] - s[1])
    exact = isqrt(int(product * 10**60)) / 10**30
    assert cf.four_areas(a, b, np.array([d]))[0] == pytest.approx(exact, rel=1e-15)


# -- structure ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("row", case("linkages", "mobility-table")["expected"], ids=lambda r: r["mechanism"])
def test_mobility_formula(row):
    assert 3 * row["n"] - 2 * row["p5"] - row["p4"] == row["W_formula"]
    assert row["p5"] + row["p4"] - row["n"] == row["independent_contours"]


def test_mobility_groups_and_loops_of_known_mechanisms():
    geometry = case("lever_contour", "lever-canonical-zones")["inputs"]["geometry"]
    six = compile_mechanism(watt_six_bar(case("linkages", "sixbar-watt")["inputs"], speed=1.0))
    for mechanism, kinds in (
        (four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25), ["I ", "II RRR"]),
        (slider_crank(r=1.0, l=3.0), ["I ", "II RRP"]),
        (lever(geometry, law=ConstantSpeed(0.0, 1.0)), ["I ", "II RPR", "II RRP"]),
        (six.mechanism, ["I ", "II RRR", "II RRR"]),
        (class_three(), ["I ", "III "]),
    ):
        compiled = compile_mechanism(mechanism)
        n, p5, p4, w = gruebler(compiled.model)
        motion = solve_motion(compiled, [0.1])
        assert w == rank_mobility(motion) == 1
        assert len(compiled.model.loops) == p5 + p4 - n
        assert [f"{g.assur_class} {g.kind}" for g in groups(compiled.model)] == kinds
    assert {frozenset(c) for c in loop_joints(six.model)} == {frozenset("ABDE"), frozenset("EHKN")}


def test_order_of_links_and_joints_does_not_matter():
    m = watt_six_bar(case("linkages", "sixbar-watt")["inputs"], speed=1.0)
    theta = np.linspace(0, 6, 7)
    a = move(m, theta)
    b = move(replace(m, links=m.links[::-1], joints=m.joints[::-1]), theta)
    assert sorted(x.kind for x in a.model.blocks) == sorted(x.kind for x in b.model.blocks)
    np.testing.assert_allclose(b.point("output", "K"), a.point("output", "K"), rtol=1e-13)


def test_third_parallel_crank_is_redundant_and_moves_exactly():
    points = {"A": (0, 0), "E": (3, 0), "G": (1.5, 0), "B": (0.6, 0.8), "D": (3.6, 0.8), "H": (2.1, 0.8)}
    m = drawn(points, {"c1": "AB", "bar": "BDH", "c2": "ED", "c3": "GH"}, "AEG", drive="A", law=ConstantSpeed(0.0, 1.0))
    motion = move(m, np.linspace(-0.5, 1.5, 21))
    assert gruebler(motion.model)[3] == 0 and rank_mobility(motion) == 1
    assert redundant_joints(motion.model)
    assert motion.closure.max() < 1e-12 * motion.model.length_scale
    np.testing.assert_allclose(motion.velocity("bar")[:, 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(motion.velocity("c3")[:, 2], 1.0, atol=1e-12)
    wrong = drawn(
        {**points, "H": (2.1, 0.81)},
        {"c1": "AB", "bar": "BDH", "c2": "ED", "c3": "GH"},
        "AEG",
        drive="A",
        law=ConstantSpeed(0.0, 1.0),
    )
    with pytest.raises(MechanismError, match="redundant constraint does not close"):
        move(wrong, np.linspace(-0.5, 1.5, 21))


# -- drives ---------------------------------------------------------------------------------------------------------------
def test_drive_on_a_floating_joint_is_the_same_motion():
    """A four-bar driven at its coupler-rocker pin through the angles that the crank-driven one has there."""
    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25)
    theta = np.linspace(0.4, 2.4, 11)
    a = move(m, theta, 2.0, 1.0)
    d = a.coordinate("D")
    other = replace(
        m,
        drives=(Drive(joint="D", law=ConstantSpeed(float(d[0, 0]), 1.0)),),
        modes={},
        sketch={k: tuple(a.pose(k)[0]) for k in ("crank", "coupler", "rocker")},
    )
    b = solve_motion(compile_mechanism(other), np.arange(11), drives={"D": (d[:, 0], d[:, 1], d[:, 2])})
    for link in ("crank", "coupler", "rocker"):
        np.testing.assert_allclose(b.pose(link), a.pose(link), atol=1e-12)
        np.testing.assert_allclose(b.velocity(link), a.velocity(link), atol=1e-10)
        np.testing.assert_allclose(b.acceleration(link), a.acceleration(link), atol=1e-9)


def test_slider_crank_driven_by_its_piston():
    m = slider_crank(r=1.0, l=3.0, bodies={"rod": (2.0, (1.0, 0.0), 0.5)}, effects=("inertia", "gravity"))
    theta = np.linspace(0.3, 2.8, 11)
    a = load(m, theta, 2.0, 1.0)
    s = a.motion.coordinate("S")
    driven = replace(m, drives=(Drive(joint="S", law=ConstantSpeed(float(s[0, 0]), 1.0)),), modes={"B": "left"})
    b = solve_forces(solve_motion(compile_mechanism(driven), np.arange(11), drives={"S": tuple(s.T)}))
    np.testing.assert_allclose(b.motion.velocity("crank")[:, 2], 2.0, rtol=1e-11)
    np.testing.assert_allclose(b.motion.acceleration("crank")[:, 2], 1.0, rtol=1e-9)
    np.testing.assert_allclose(b.effort("S") * s[:, 1], a.effort("O") * 2.0, rtol=1e-10, atol=1e-10)
    assert np.abs(b.power_balance).max() < 1e-12


def test_two_drives_of_a_five_bar():
    points = {"A": (0, 0), "B": (-0.2, 0.5), "C": (0.5, 1.1), "D": (1.2, 0.5), "E": (1, 0)}
    m = drawn(points, {"left": "AB", "l2": "BC", "r2": "DC", "right": "ED"}, "AE", drive="A", law=ConstantSpeed(0.0, 1.0))
    two = replace(m, drives=(*m.drives, Drive(joint="E", law=ConstantSpeed(0.0, -0.5))))
    motion = solve_motion(compile_mechanism(two), np.linspace(0, 0.6, 7))
    assert [b.kind for b in motion.model.blocks] == ["theta_theta"]
    np.testing.assert_allclose(motion.velocity("left")[:, 2], 1.0)
    np.testing.assert_allclose(motion.velocity("right")[:, 2], -0.5)
    assert motion.closure.max() < 1e-15
    with pytest.raises(MechanismError, match="a degree of freedom without a drive"):
        compile_mechanism(m)


# -- limits ----------------------------------------------------------------------------------------------------------------
def faults_of(mechanism: Mechanism, times=None) -> str:
    with pytest.raises(MechanismError) as e:
        solve_motion(compile_mechanism(mechanism), default_times(mechanism) if times is None else times)
    return str(e.value)


def test_a_drive_range_that_cannot_be_assembled_is_named_with_its_gap():
    m = four_bar(**ROCKER, start=0.5)
    text = faults_of(m)
    assert "joints.D" in text and "drive A" in text and "mm" in text and "keep the drive within" in text
    limit = next(c for c in case("linkages", "fourbar-limits")["expected"] if c["AB"] == 0.22)["crank_angle_limit_stretched"]
    flat = four_bar(E=(0.3, 0.0), AB=0.22, BD=0.16, DE=0.21, start=0.5)
    (low, high), *_ = reachable_ranges(compile_mechanism(flat))
    assert high == pytest.approx(limit, abs=1e-9) and low == pytest.approx(-limit, abs=1e-9)
    said = re.search(r"drive A from ([\d.]+)° to ([\d.]+)°.*within \[(-[\d.]+)°, ([\d.]+)°\]", " ".join(text.split()))
    first, last, low, high = map(float, said.groups())
    assert (first, last) == pytest.approx((high, 360.0 + low), rel=1e-5), "up to the ends of its reach, not the next frames"
    gap = float(text.split("up to ")[1].split(" mm")[0]) * 1e-3
    farthest = 0.22 + np.hypot(0.3, 0.05)  # B opposite to E
    assert gap == pytest.approx(farthest - 0.37, rel=1e-3)


def test_the_limit_position_itself_is_reached():
    limit = next(c for c in case("linkages", "fourbar-limits")["expected"] if c["AB"] == 0.22)["crank_angle_limit_stretched"]
    flat = four_bar(E=(0.3, 0.0), AB=0.22, BD=0.16, DE=0.21, start=0.5)
    motion = move(flat, [0.5, limit])
    assert motion.closure.max() < 1e-12 * motion.model.length_scale
    assert motion.condition[1] > 1e6


def test_mode_faults_say_what_to_write():
    m = four_bar(**ROCKER, start=0.5)
    text = faults_of(replace(m, modes={}))
    assert 'side = "left"' in text and 'side = "right"' in text and "251.7 mm" in text
    text = " ".join(faults_of(replace(m, modes={"D": "ahead"})).split())
    assert "joints.D.branch: 'ahead' is not an assembly mode" in text and 'Write side = "left" or "right" instead.' in text
    inside = " ".join(faults_of(four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, mode="open")).split())  # A, B, E in line
    assert "joints.D.assembly: 'open' does not decide: at the start, no links cross" in inside
    assert "this joint decides nothing" in faults_of(replace(m, modes={"D": "left", "A": "right"}))
    both = replace(m, drives=(*m.drives, replace(m.drives[0], joint="E")), modes={"D": "left"})
    text = " ".join(faults_of(both).split())
    assert "the 2 drives leave no choice. Take 1 of the 2 drives away" in text and "decides nothing" not in text
    text = faults_of(replace(class_three(), sketch={}))
    assert "2 at the start" in text and "[sketch]" in text


def test_modes_are_refused_where_a_group_has_no_two():
    """A pin in a slot and a guide fit together in one way; a triad in several, which a word does not choose from."""
    links = (
        Link(name="frame", points={"O": (0.0, 0.0), "G": (0.1, 0.0)}),
        Link(name="lever", points={"O": (0.0, 0.0), "T": (0.1, 0.0)}),
        Link(name="valve", points={"T": (0.0, 0.0)}),
    )
    slot = PinSlot(name="T", links=("valve", "lever"), points=("T", "T"), along=(1.0, 0.0))
    guide = Prismatic(name="S", links=("frame", "valve"), points=("G", "T"), along=(0.0, 1.0))
    drives = (Drive(joint="O", law=ConstantSpeed(0.1, 1.0)),)
    joints = (pin("O", "frame", "lever"), slot, guide)
    one_way = Mechanism(name="valve", frame="frame", links=links, joints=joints, drives=drives)
    compile_mechanism(one_way)
    text = faults_of(replace(one_way, modes={"T": "ahead"}))
    assert "joints.T.branch: an assembly mode ('ahead') is stated here" in text and "Leave it out: there is one way only." in text
    triad = class_three()
    (name,) = (block.name for block in compile_mechanism(triad).model.blocks if block.kind == "general")
    text = faults_of(replace(triad, modes={name: "left"}))
    assert f"joints.{name}.side" in text and "[sketch]" in text


@pytest.mark.parametrize(
    ("build", "word", "joints"),
    [(four_bar, "left", "BDE"), (four_bar, "right", "BDE"), (four_bar, "crossed", "BDE")]
    + [(slider_crank, word, "BCS") for word in ("ahead", "behind")],
)
def test_modes_mean_the_same_at_every_joint_that_their_group_places(build, word, joints):
    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, start=1.0) if build is four_bar else slider_crank(r=0.05, l=0.18, e=0.012)
    time = np.linspace(0.0, 1.0, 5)
    want = move(replace(m, modes={joints[-2]: word}), time)
    for joint in joints:
        got = move(replace(m, modes={joint: word}), time)
        for link in want.model.links:
            np.testing.assert_array_equal(got.pose(link), want.pose(link))
    same = dict.fromkeys(joints, word)
    move(replace(m, modes=same), time)
    other = {"left": "right", "right": "left", "crossed": "open", "ahead": "behind", "behind": "ahead"}[word]
    key = {"left": "side", "right": "side", "crossed": "assembly"}.get(word, "branch")
    text = faults_of(replace(m, modes={**same, joints[-1]: other}))
    assert f"joints.{joints[-1]}.{key}: '{other}' contradicts '{word}' at {joints[0]}" in text


def test_stated_modes_mean_what_they_say():
    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, start=1.0)
    for word, left in (("left", True), ("right", False), ("open", True), ("crossed", False)):
        p = {x: move(replace(m, modes={"D": word}), [1.0]).point("coupler", x)[0] for x in "BD"}
        b, d, e = p["B"], p["D"], np.array([0.28, 0.0])
        assert (np.cross(np.append(e - b, 0), np.append(d - b, 0))[2] > 0) == left, word
    reverse = replace(m, joints=tuple(pin("D", "rocker", "coupler") if x.name == "D" else x for x in m.joints))
    p = move(replace(reverse, modes={"D": "left"}), [1.0]).point("coupler", "D")[0]
    assert p[1] < 0, "left as seen from the first link's other pin (E) to the second's (B)"
    s = {w: move(slider_crank(r=1.0, l=3.0, branch=w), [1.0]).coordinate("S")[0, 0] for w in ("ahead", "behind")}
    assert s["ahead"] > 0 > s["behind"]


def test_sketch_chooses_the_mode():
    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, start=1.0)
    for word in ("left", "right"):
        a = move(replace(m, modes={"D": word}), [1.0])
        rough = tuple(a.pose("rocker")[0] + [0.02, -0.02, 0.3])
        b = move(replace(m, modes={}, sketch={"rocker": rough}), [1.0])
        np.testing.assert_array_equal(b.pose("coupler"), a.pose("coupler"))


def test_zero_length_and_contradictions_are_refused():
    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25)
    with pytest.raises(MechanismError, match="no chain of joints"):
        compile_mechanism(replace(m, links=(*m.links, Link(name="lost", points={"A": (0.0, 0.0)}))))
    with pytest.raises(MechanismError) as e:
        compile_mechanism(replace(m, joints=(*m.joints, pin("X", "crank", "nowhere"), pin("Y", "crank", "crank"))))
    assert len(e.value.faults) >= 2, "all faults at once"


# -- general blocks -----------------------------------------------------------------------------------------------------------
def test_a_triad_follows_one_branch_and_comes_back():
    compiled = compile_mechanism(class_three())
    duration = compiled.mechanism.drives[0].law.duration
    dense = solve_motion(compiled, np.linspace(0, duration, 721))
    coarse = solve_motion(compiled, np.linspace(0, duration, 5))
    np.testing.assert_allclose(coarse.pose("ternary"), dense.pose("ternary")[::180], atol=1e-12)
    np.testing.assert_allclose(dense.pose("ternary")[-1], dense.pose("ternary")[0], atol=1e-12)
    steps = np.abs(np.diff(dense.pose("ternary"), axis=0)).max()
    assert steps < 0.02, "no jump to another assembly mode"


def test_a_path_does_not_change_branch_even_with_wild_steps(monkeypatch):
    """With steps of a third of a turn and no limit on Newton's corrections the sign of the determinant alone must guard it."""
    from mechcore.branches import continuation
    from mechcore.branches.paths import branch_by_drive

    compiled = compile_mechanism(class_three())
    monkeypatch.setattr(continuation, "LARGEST_CORRECTION", np.inf)

    row, same, other = (continuation.PathPoint(0.0, {}, {}, {"P": d}, {}) for d in (0.3, 0.2, -0.2))
    assert row.same_branch(same) and not row.same_branch(other)
    branch = branch_by_drive(compiled.model, compiled.assembly)
    fine = continuation.continuation_path(branch, 0.0, 0.0, 6.0, 0.05)
    for step in (0.5, 1.0, 2.0, 3.0):
        wild = continuation.continuation_path(branch, 0.0, 0.0, 6.0, step)
        (name,) = wild.splines
        a, b = fine.splines[name](6.0), wild.splines[name](6.0)
        assert wild.ends[1] == 6.0 and np.abs(np.exp(1j * a) - np.exp(1j * b)).max() < 1e-6, step


def test_turn_ten_thousand_equals_turn_one():
    for m in (class_three(), four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, speed=7.0)):
        compiled = compile_mechanism(m)
        t = np.linspace(0.0, 2 * np.pi / 7.0, 13)
        one, late = solve_motion(compiled, t), solve_motion(compiled, t + 10_000 * 2 * np.pi / 7.0)
        link = m.links[2].name
        np.testing.assert_allclose(late.pose(link)[:, :2], one.pose(link)[:, :2], atol=1e-10)


def test_triad_closes_at_every_scale_and_place():
    base = class_three()
    theta = np.linspace(0, 6, 9)
    a = move(base, theta)
    for scale, shift in ((1e-6, 0.0), (1e3, 0.0), (1.0, 1e4)):

        def scaled(link, scale=scale, shift=shift):
            off = (shift, -shift) if link.name == "frame" else (0.0, 0.0)
            return replace(link, points={k: (scale * x + off[0], scale * y + off[1]) for k, (x, y) in link.points.items()})

        sketch = {k: (scale * x + shift, scale * y - shift, w) for k, (x, y, w) in base.sketch.items()}
        b = move(replace(base, links=tuple(scaled(x) for x in base.links), sketch=sketch), theta)
        np.testing.assert_allclose(
            (b.pose("ternary")[:, :2] - [shift, -shift]) / scale, a.pose("ternary")[:, :2], atol=1e-11 if shift else 1e-13
        )
        np.testing.assert_allclose(b.velocity("ternary")[:, 2], a.velocity("ternary")[:, 2], rtol=1e-9)


# -- angles ----------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("frames", [4, 7, 25, 360])
def test_angles_are_continuous_however_few_the_frames(frames):
    """A drag-link four-bar turns all its links: after one turn of the crank each has turned once."""
    m = four_bar(E=(0.05, 0.0), AB=0.2, BD=0.25, DE=0.22, speed=2 * np.pi)
    motion = solve_motion(compile_mechanism(m), np.linspace(0.0, 1.0, frames + 1))
    angle = motion.pose("rocker")[:, 2]
    assert angle[-1] - angle[0] == pytest.approx(2 * np.pi, abs=1e-9)


# -- only what is asked for -------------------------------------------------------------------------------------------------------
def test_positions_alone_solve_no_velocities(monkeypatch):
    from mechcore.motion import motion as module

    def refuse(*_):
        raise AssertionError("velocities were solved")

    monkeypatch.setattr(module, "velocities", refuse)
    motion = solve_motion(compile_mechanism(four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25)), np.linspace(0, 6, 50))
    assert np.isfinite(motion.pose("coupler")).all() and motion.closure.max() < 1e-14
    with pytest.raises(AssertionError, match="velocities were solved"):
        motion.velocity("coupler")


def test_statics_without_inertia_solve_no_accelerations(monkeypatch):
    from mechcore.motion import motion as module

    def refuse(*_):
        raise AssertionError("accelerations were solved")

    monkeypatch.setattr(module, "accelerations", refuse)
    m = slider_crank(
        r=1.0,
        l=3.0,
        bodies={"rod": (1.0, (1.0, 0.0), 1.0)},
        effects=("gravity",),
        loads=(Force(name="F", link="piston", point="C", vector=(1.0, 0.0)),),
    )
    motion = solve_motion(compile_mechanism(m), np.linspace(0, 6, 50))
    assert np.isfinite(solve_forces(motion).effort("O")).all()


def test_prismatic_guides_on_either_link_agree():
    """The same shaper with the guide carried by the first or by the second link of the joint."""
    geometry = case("lever_contour", "lever-quick-return-shaper")["inputs"]["geometry"]
    m = lever(geometry, law=Oscillation(0.5, 0.3, 1.0))
    swapped = replace(
        m,
        joints=tuple(
            Prismatic(name="L", links=("block", "lever"), points=("A", "B"), guide=1) if p.name == "L" else p for p in m.joints
        ),
    )
    bodies = {"block": 0.3, "lever": 2.0}

    def heavy(mech):
        links = tuple(replace(x, mass=bodies.get(x.name, 0.0), inertia=0.1) for x in mech.links)
        force = Force(name="F", link="slider", point="D", vector=(-50.0, 10.0))
        return replace(mech, links=links, effects=("inertia", "gravity"), loads=(force,))

    a, b = load(heavy(m), np.linspace(0.0, 6.0, 13), 4.0, 2.0), load(heavy(swapped), np.linspace(0.0, 6.0, 13), 4.0, 2.0)
    np.testing.assert_allclose(b.motion.coordinate("L"), a.motion.coordinate("L"), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(b.reaction("L"), -a.reaction("L"), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(b.effort("O"), a.effort("O"), rtol=1e-10, atol=1e-10)


# -- loop equations in words ---------------------------------------------------------------------------------------------------
def test_printed_loop_equations_hold_with_the_solved_motion():
    """Parse the printed equations, put the solved velocities and accelerations in, and see them vanish."""
    import re

    import mechviz
    from mechcore.motion.structure import loop_equations

    geometry = case("lever_contour", "lever-canonical-zones")["inputs"]["geometry"]
    for mechanism in (
        lever(geometry, law=ConstantSpeed(0.9, 1.0)),
        watt_six_bar(case("linkages", "sixbar-watt")["inputs"], speed=1.0),
        mechviz.load("geared-slider-cranks").mechanism,
        mechviz.load("rolling-wheel").mechanism,
        mechviz.load("cam-oscillating-roller").mechanism,  # at 1 rad on its rise
    ):
        motion = move(mechanism, [mechanism.drives[0].law(0.0)[0] + 1.0], 3.0, 2.0)
        omega = [float(np.broadcast_to(motion.speeds.angular[s], 1)[0]) for s in motion.model.angles.rotation_class]
        accel = [float(np.broadcast_to(motion.accelerations.angular[s], 1)[0]) for s in motion.model.angles.rotation_class]
        values = {}
        for i in range(len(omega)):
            values[f"w_{i}"], values[f"e_{i}"] = omega[i], accel[i]
            for j in range(len(omega)):
                values[f"w_{i},{j}"], values[f"e_{i},{j}"] = omega[i] - omega[j], accel[i] - accel[j]
        for joint in motion.model.joints:
            if joint.slide is not None:
                _, values[f"v_{joint.name}"], values[f"a_{joint.name}"] = motion.coordinate(joint.name)[0]
        lines = [x for x in loop_equations(motion) if x.endswith("= 0")]
        assert len(lines) == 6 * len(motion.model.loops) + 2 * len(motion.model.relations)
        for line in lines:
            terms = re.findall(r"([+-][\d.e+-]+)?\s*\+?\s*((?:[wevaA-Z]_[\w,]+(?:\^2)?\s*)+)", line.split("=")[0])
            assert terms or line.strip() == "0 = 0", line
            total, size = 0.0, 0.0
            for number, names in terms:
                product = float(number or 1.0)
                for name in names.split():
                    product *= values[name[:-2]] ** 2 if name.endswith("^2") else values[name]
                total, size = total + product, size + abs(product)
            assert abs(total) < 1e-5 * max(size, 1e-9), line  # six digits are printed


def test_an_arm_that_is_lost_in_rounding_is_none():
    """A lever whose pin lies 1e-15 m from its axis: the loop beyond it does not wait for the lever's angle."""
    motion, _ = solved(changed(text_of("word-writer"), "D = [100, 0]", "D = [1e-12, 0]"), frames=8)
    assert motion.closure.max() < 1e-14
    places = motion.point("left rod", "D") - motion.point("frame", "A")
    assert np.abs(places).max() < 1e-14


def test_a_motion_works_out_again_what_it_has_given_up():
    """Arrays over the frames are given up, and the results stay the same to the last bit."""
    compiled = compile_mechanism(slider_crank(r=0.1, l=0.4))
    motion = solve_motion(compiled, np.linspace(0.0, 1.0, 50))

    def results():
        links = [link.name for link in motion.mechanism.links]
        poses = [rate(link) for link in links for rate in (motion.pose, motion.velocity, motion.acceleration)]
        points = [motion.point(link.name, p, k) for link in motion.mechanism.links for p in link.points for k in (0, 1, 2)]
        return [*poses, *points, *(motion.joint_position(j.name) for j in motion.mechanism.joints)]

    first = results()
    known = ("_turned_once", "_turned_twice", "loop_vectors")
    assert set(known) <= vars(motion).keys() and motion._offsets
    motion.forget()
    assert not set(known) & vars(motion).keys() and not motion._offsets
    for before, after in zip(first, results(), strict=True):
        np.testing.assert_array_equal(before, after)
