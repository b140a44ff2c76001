"""Synthesis on the command line: solutions are scenes that do what was asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from design_cases import time_ratio
from typer.testing import CliRunner

import mechviz
from mechcore.design.burmester import BodyPositions, burmester_curve
from mechcore.design.chains import kinematic_chains
from mechcore.design.dwells import dwell_linkages
from mechcore.design.strokes import whitworth
from mechcore.errors import MechanismError
from mechviz.commands.main import app
from mechviz.runs import run_scene
from mechviz.studies.synthesis import figures
from mechviz.studies.synthesis.chains import chain_layout, chain_solutions, outline
from mechviz.studies.synthesis.four_bars import (
    dyads,
    motion_designs,
    motion_solutions,
    slider_guide_solutions,
    slider_guides,
    thinned_curves,
)
from mechviz.studies.synthesis.paths import cognate_solutions, traced_four_bar
from mechviz.studies.synthesis.strokes import dwell_solutions, whitworth_solution


def asked(*words):
    return CliRunner().invoke(app, ["synthesise", *map(str, words)])


def given(*words):
    """Lines of a table."""
    done = asked(*words)
    assert done.exit_code == 0, done.stderr
    return done.stdout.splitlines()


def values(run, key):
    return run.catalogue[key].values()[:, 0]


def track(run, point):
    """A point's path (F,) [mm], complex: "coupler.E"."""
    x, y = (run.catalogue[f"point.{point}.position"].values()[:, k] for k in (0, 1))
    return x + 1j * y


def test_a_four_bar_that_cannot_be_assembled_at_the_start_is_shown_as_such():
    lines = given(
        "function", "1/x", "--from", 1, "--to", 2, "--crank", 90, "--rocker", -90, "--crank-start", 30, "--rocker-start", 240
    )
    assert lines[1].endswith("does not run through")
    assert [word for word in lines[1].split() if word == "-"] == ["-", "-"]  # no error over the range, no transmission angle


def test_a_function_generator_is_a_scene_that_follows_its_function(tmp_path):
    words = ("function", "1/x", "--from", 1, "--to", 2, "--crank", 90, "--rocker", -90, "--points", 4, "--crank-start", 30)
    header, best, other = given(*words, "-o", tmp_path, "--plot", tmp_path / "error.svg")
    assert "-0.09743" in best and "5.757" in other and "defects" in header
    run = run_scene(mechviz.load(tmp_path / "function-1.toml"), frames=400)
    psi = np.unwrap(values(run, "link.rocker.angle"), period=360)
    x = 1.0 + np.linspace(0, 1, 401)
    error = psi - -90.0 * (1 / x - 1.0) / (0.5 - 1.0)
    points = 1.5 - 0.5 * np.cos((2 * np.arange(4) + 1) * np.pi / 8)  # Chebyshev's: there the error is that of the zero mark
    assert np.ptp(np.interp(points, x, error)) < 1e-3
    assert error[0] - np.interp(points[0], x, error) == pytest.approx(-0.09743, abs=1e-3)
    assert "structural error" in (tmp_path / "error.svg").read_text()


def test_angles_and_least_squares():
    (_, row) = given("function", "tan(x)", "--from", 0, "--to", "45 deg", "--crank", 60, "--rocker", 60, "--points", 31,
                     "--crank-start", 60, "--rocker-start", 90)  # fmt: skip
    assert row.endswith("none")
    assert asked("function", "tan(x)", "--from", 0, "--to", 1, "--crank", 60, "--rocker", 60).exit_code == 2


@pytest.mark.sample(2)
@pytest.mark.parametrize("count", [2, 3, 4])
def test_bodies_pass_their_positions(count, tmp_path):
    rows = [(0, 0, 0), (30, 15, 20), (60, 20, 45), (75, 10, 70)][:count]
    poses = BodyPositions(np.array([complex(x, y) for x, y, _ in rows]) / 1e3, np.radians([angle for *_, angle in rows]))
    lines = given(
        "motion", *(f"{x},{y},{angle}" for x, y, angle in rows), "--most", 3, "-o", tmp_path, "--plot", tmp_path / "a.svg"
    )
    assert len(lines) == 4 and all(line.endswith("none") for line in lines[1:])
    run = run_scene(mechviz.load(tmp_path / "motion-1.toml"), frames=2000)
    path = track(run, "coupler.E") / 1e3
    angle = np.radians(values(run, "link.coupler.angle"))
    nearest = [int(abs(path - place).argmin()) for place in poses.places]
    assert np.abs(path[nearest] - poses.places).max() < 5e-4
    turned = np.exp(1j * (angle[nearest] - angle[nearest[0]]))
    assert np.abs(turned - poses.turns / poses.turns[0]).max() < 0.02


def test_pivots_of_ones_own_are_judged():
    lines = given("motion", "0,0,0", "30,15,20", "60,20,45", "--moving", "-10,5", "--fixed", "80,-40")
    assert len(lines) == 3  # driven at either one
    poses = BodyPositions(np.array([0, 0.03 + 0.015j, 0.06 + 0.02j]), np.radians([0, 20, 45]))
    w, c = dyads(poses, [-0.01 + 0.005j], [0.08 - 0.04j], 1.0)
    assert w[0] == -0.01 + 0.005j and c[1] == pytest.approx(0.08 - 0.04j)
    for made in motion_designs(poses, w, c, 9, all_of_them=True):
        bar, pins = made.four_bar, made.pins
        assert abs(pins[0] - bar.crank_pivot) == pytest.approx(bar.crank, rel=1e-9)
        assert abs(pins[1] - bar.rocker_pivot) == pytest.approx(bar.rocker, rel=1e-9)


def test_five_positions_show_every_solution_with_its_defects(tmp_path):
    rows = ["872,1480,41.3103", "811,1894,29.3927", "409,2090,21.4859", "-119,1941,18.3346", "-499,1580,19.1368"]
    lines = given("motion", *rows, "--most", 12)
    assert len(lines) == 13
    assert sum(line.endswith("none") for line in lines) == 4
    file = tmp_path / "poses.csv"
    file.write_text("x,y,angle\n" + "\n".join(rows))
    assert given("motion", file, "--most", 12) == lines


def test_paths_are_drawn(tmp_path):
    points = ["3000,3000", "2759,3363", "2372,3663", "1890,3862", "1355,3943"]
    lines = given("path", *points, "--step", 15, "--start", 30, "--pivot", "0,0", "--frame-angle", 0, "--screened", 3000,
                  "-o", tmp_path / "best.toml", "--plot", tmp_path / "path.svg")  # fmt: skip
    rms = float(lines[1].split()[5])
    assert rms**2 * 5 == pytest.approx(7.415751e-7 * 1e6, rel=1e-3)
    run = run_scene(mechviz.load(tmp_path / "best.toml"), frames=720)
    path = track(run, "coupler.E")
    for point in points:
        assert abs(path - complex(*map(float, point.split(",")))).min() < 15.0


def test_strokes_and_swings_are_had_at_their_time_ratio(tmp_path):
    given("stroke", 200, "--ratio", 1.2, "-o", tmp_path / "press.toml")
    given("stroke", 200, "--ratio", 2, "--frame", 150, "-o", tmp_path / "lever.toml")
    given("swing", 40, "--ratio", 1.1176, "-o", tmp_path / "swing.toml")
    runs = {name: run_scene(mechviz.load(tmp_path / f"{name}.toml"), frames=3600) for name in ("press", "lever", "swing")}
    x = values(runs["press"], "joint.S.displacement")[:-1]
    assert (np.ptp(x), time_ratio(x)) == pytest.approx((200.0, 1.2), rel=1e-4)
    lever = track(runs["lever"], "lever.C")[:-1]
    assert (np.ptp(lever.real), time_ratio(lever.real)) == pytest.approx((200.0, 2.0), rel=1e-3)
    rocker = values(runs["swing"], "link.rocker.angle")[:-1]
    assert (np.ptp(rocker), time_ratio(rocker)) == pytest.approx((40.0, 1.1176), rel=1e-3)


def test_straight_lines_are_straight(tmp_path):
    assert len(given("line", "--travel", 80, "-o", tmp_path)) == 6
    path = track(run_scene(mechviz.load(tmp_path / "watt.toml"), frames=400), "coupler.E")
    assert np.ptp(path.imag) == pytest.approx(80.0, rel=1e-3)
    assert np.ptp(path.real) == pytest.approx(80.0 * 0.0217, rel=1e-2)


def test_levers_rest_while_the_crank_turns_on():
    dwell, swing = np.radians([80, 25])
    designs = dwell_linkages(dwell, swing, seed=1, most=3, screened=800)
    best = designs[0]
    assert all(best.drift <= one.drift for one in designs) and best.drift < 1e-3 * swing
    theta = best.start + np.linspace(0, 2 * np.pi, 721)
    angle = best.lever_angles(theta)
    f = best.pivot + best.lever * np.exp(1j * angle)
    assert abs(f - best.four_bar.positions(theta)[2]) == pytest.approx(np.full(721, best.link), rel=1e-12)
    run = run_scene(dwell_solutions(designs, 0.02, dwell)[0].scene, frames=720)
    lever = np.unwrap(values(run, "link.lever.angle"), period=360)
    assert lever - lever[0] == pytest.approx(np.degrees(angle - angle[0]), abs=1e-9)
    assert np.ptp(lever) == pytest.approx(25.0, rel=1e-2)
    assert np.ptp(lever[:161]) == pytest.approx(np.degrees(best.drift), rel=0.05)  # the run begins with the rest
    assert figures.dwell_figure(designs).axes


def test_lids_stay(tmp_path):
    given("lid", "12kg", "--arm", 300, "--hand", 550, "--box", 250, "-o", tmp_path / "lid.toml", "--plot", tmp_path / "lid.svg")
    run = run_scene(mechviz.load(tmp_path / "lid.toml"), frames=120)
    hand = values(run, "drive.O.torque") / 0.55
    assert abs(hand).max() < 3.0 < 12 * 9.80665 * 0.3 / 0.55


def test_sliders_follow_functions(tmp_path):
    words = ("--from", 0, "--to", 1, "--crank", 60, "--travel", -40, "--crank-start", 20, "--slider-start", 150)
    row = given("slider", "x^2", *words, "-o", tmp_path / "slider.toml")[1]
    run = run_scene(mechviz.load(tmp_path / "slider.toml"), frames=400)
    x = values(run, "link.slider.position")
    error = x - (150.0 - 40.0 * np.linspace(0, 1, 401) ** 2)
    assert abs(error).max() == pytest.approx(float(row.split()[-2]), abs=2e-3)


def test_every_inversion_of_six_links_runs():
    solutions = chain_solutions(kinematic_chains(6))
    assert len(solutions) == 5
    for one in solutions:
        run = run_scene(one.scene, frames=20)
        assert np.isfinite(run.motion.closure).all()


def test_sketches_of_eight_links_do_not_cross():
    """Two links may touch at a joint only: segments of different links have no inner point in common."""
    for chain in kinematic_chains(8):
        places = chain_layout(chain)
        rings = [outline(chain, link, places) for link in range(chain.links)]
        edges = [(a, b) for ring in rings for a, b in zip(ring, np.roll(ring, 1), strict=True)]
        for n, (a, b) in enumerate(edges):
            for c, d in edges[:n]:
                if len({a, b, c, d}) == 4:
                    matrix = [[(b - a).real, (c - d).real], [(b - a).imag, (c - d).imag]]
                    along = np.linalg.solve(matrix, [(c - a).real, (c - a).imag])
                    assert not ((along > 0) & (along < 1)).all(), chain


def test_burmesters_curves_pass_the_pivots_of_every_proposal():
    poses = BodyPositions(np.array([0, 0.03 + 0.015j, 0.06 + 0.02j, 0.075 + 0.01j]), np.radians([0, 20, 45, 70]))
    curve = burmester_curve(poses, 4000)
    designs = motion_designs(poses, *dyads(poses, [], [], 1.0), 5, all_of_them=False)
    assert len(motion_solutions(poses, designs)) == 5
    for made in designs:
        for pivot in (made.four_bar.crank_pivot, made.four_bar.rocker_pivot):
            assert np.nanmin(abs(curve.c - pivot)) < 0.002


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("function", "1/x", "--from", 0, "--to", 2, "--crank", 90, "--rocker", 90), "range"),
        (("function", "1/y", "--from", 1, "--to", 2, "--crank", 90, "--rocker", 90), "'y'"),
        (("function", "1/x", "--from", 1, "--to", 2, "--crank", 90, "--rocker", 90), "points"),
        (("motion", "0,0,0", "1,2"), "position 2"),
        (("motion", "0,0,0", "0,0,0"), "same"),
        (("motion", "0,0,0", "10,0,0", "20,5,0", "30,7,0"), "translates"),
        (("path", "0,0", "1,1", "2,0", "--step", 10, "--angles", "0,1,2"), "--step"),
        (("path", "0,0", "1,1"), "points"),
        (("stroke", 200, "--ratio", 0.5), "ratio"),
        (("stroke", "long", "--ratio", 1.2), "STROKE: "),
        (("function", "sin(x)", "--from", 0, "--to", "180 deg", "--crank", 90, "--rocker", 60), "both ends"),
        (("line", "wat"), "watt"),
        (("chains", 5), "freedom"),
    ],
)
def test_what_cannot_be_done_is_said(words, said):
    done = asked(*words)
    assert done.exit_code == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_cognates_draw_the_same_curve(tmp_path):
    """The second one frame by frame, as its crank turns alike; the first at the frames where its coupler has turned as far."""
    run = run_scene(mechviz.load("crank-rocker"), frames=72)
    solutions = cognate_solutions(*traced_four_bar(run))
    curve = run.motion.point("coupler", "E")
    first, second = (run_scene(one.scene, frames=720 if k == 0 else 72) for k, one in enumerate(solutions))
    np.testing.assert_allclose(second.motion.point("coupler", "E"), curve, atol=1e-12)
    drawn = first.motion.point("coupler", "E")
    apart = np.hypot(*(curve[:, None] - drawn[None]).transpose(2, 0, 1)).min(axis=1)
    assert apart.max() < 0.6 * np.hypot(*np.diff(drawn, axis=0).T).max()
    with pytest.raises(MechanismError, match="no four-bar loop"):
        traced_four_bar(run_scene(mechviz.load("parametric-press"), frames=4))


def test_cognates_of_a_double_crank_run():
    """Its cognates are double cranks, in which no pin between crank and coupler turns fully: both are driven at the crank."""
    lengths = {("links", "frame", "points", "D"): [60, 0], ("links", "crank", "points", "B"): [150, 0]}
    lengths |= {("links", "coupler", "points", "C"): [140, 0], ("links", "rocker", "points", "C"): [160, 0]}
    run = run_scene(mechviz.load("crank-rocker").changed(lengths), frames=90)
    solutions = cognate_solutions(*traced_four_bar(run))
    assert [(one.numbers["type"], one.numbers["driven at"]) for one in solutions] == [("double crank", "A")] * 2
    curve = run.motion.point("coupler", "E")
    for one in solutions:
        drawn = run_scene(one.scene, frames=720).motion.point("coupler", "E")
        apart = np.hypot(*(curve[:, None] - drawn[None]).transpose(2, 0, 1)).min(axis=1)
        assert apart.max() < 0.6 * np.hypot(*np.diff(drawn, axis=0).T).max()


def test_a_pin_of_the_coupler_has_no_cognates():
    scene = mechviz.load("crank-rocker").changed({("links", "coupler", "points", "E"): [0, 0]})
    with pytest.raises(MechanismError, match="is at the pin B and draws a circle"):
        traced_four_bar(run_scene(scene, frames=4))


def test_whitworths_quick_return_has_its_stroke_and_time_ratio():
    scene = whitworth_solution(whitworth(0.2, 1.8, 0.1), 0.2, 1.8).scene
    place = run_scene(scene, frames=720).motion.coordinate("S")[:-1, 0]
    assert np.ptp(place) == pytest.approx(0.2, rel=1e-5)
    assert time_ratio(place) == pytest.approx(1.8, rel=1e-4)


@pytest.mark.parametrize("count", [3, 4])
def test_a_slide_and_a_crank_lead_a_body_through_positions(count):
    rows = np.array([[0, 0, 0], [30, 15, 20], [60, 20, 45], [75, 10, 70]], float)[:count]
    poses = BodyPositions((rows[:, 0] + 1j * rows[:, 1]) * 1e-3, np.radians(rows[:, 2]))
    best = slider_guides(poses, *dyads(poses, (), (), 1.0), 3)
    assert not best[0].defects and [bool(one.defects) for one in best[1:]] == [count == 4] * 2
    run = run_scene(slider_guide_solutions(poses, best)[0].scene, frames=720)
    place, angle = run.motion.point("coupler", "E"), run.motion.pose("coupler")[:, 2]
    for z, turn in zip(poses.places, poses.angles - poses.angles[0], strict=True):
        near = int(np.hypot(*(place - [z.real, z.imag]).T).argmin())
        assert np.hypot(*(place[near] - [z.real, z.imag])) < 3e-4
        assert angle[near] - angle[int(np.hypot(*place.T).argmin())] == pytest.approx(turn, abs=0.02)


def test_four_positions_whose_pivots_are_all_far_away_are_refused():
    poses = BodyPositions(np.array([0, 1, 2 + 1j, 3j]), np.array([0.0, 0.3, 0.7, 0.2]))
    curve = burmester_curve(poses, 50)
    with pytest.raises(MechanismError, match="far away from these positions"):
        thinned_curves(replace(curve, w=np.full_like(curve.w, np.inf)), poses)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("motion", "0,0,0", "30,15,20", "60,20,45", "--moving", "-10,5"), "a second one"),
        (("motion", "0,0,0", "30,15,20", "60,20,45", "--moving", "-10,5", "--moving", "-10,5"), "given twice"),
        (("motion", "0,0,0", "10,0,0", "20,0,0"), "only translates"),
        (("motion", "0,0,0", "0,0,30"), "only turns about one point, x = 0 mm, y = 0 mm"),
        (("motion", "30,20,0", "20,30,90", "10,20,180"), "only turns about one point, x = 20 mm, y = 20 mm"),
        (("motion", "0,0,0", "10,0,90", "--swing", "0"), "more than 0"),
        (("stroke", "200", "--ratio", "2", "--frame", "0"), "no length"),
        (("stroke", "1e-300", "--ratio", "1.5"), "no length"),
        (("line", "watt", "--travel", "0"), "no length"),
        (("path", "20,20", "20,20", "20,20"), "points are the same"),
        (("path", "20,20", "20,25", "20,30", "--shortest", "60", "--longest", "5"), "bounds of 60 mm and 5 mm"),
    ],
)
def test_tasks_that_say_nothing_are_refused_in_words(words, why):
    done = asked(*words)
    assert done.exit_code == 2 and why in done.stderr
