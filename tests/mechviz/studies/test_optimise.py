"""Optimisation: optima known beforehand, slopes of objectives, fronts, interruptions, what cannot be had."""

from __future__ import annotations

import re

import numpy as np
import pytest
from typer.testing import CliRunner

from mechcore.errors import MechanismError
from mechviz.commands.main import app
from mechviz.runs import run_scene
from mechviz.scene.scene import Scene, dump, load
from mechviz.studies.designs.optimise import Optimum, Search, optimise, rounded
from mechviz.studies.designs.problem import problem_of

FRAMES = 24
HIDDEN = {"a": 60.0, "b": 175.0, "c": 140.0, "x": 80.0, "y": 55.0}


def four_bar(values, goal):
    """A four-bar with a traced point whose dimensions vary."""
    return Scene.build(
        units={"length": "mm", "angle": "deg"},
        parameters={
            k: {"value": f"{v} mm", "range": [f"{0.7 * HIDDEN[k]} mm", f"{1.4 * HIDDEN[k]} mm"]} for k, v in values.items()
        },
        links={
            "frame": {"points": {"A": [0, 0], "D": [200, 0]}},
            "crank": {"points": {"A": [0, 0], "B": ["a", 0]}},
            "coupler": {"points": {"B": [0, 0], "C": ["b", 0], "E": ["x", "y"]}},
            "rocker": {"points": {"D": [0, 0], "C": ["c", 0]}},
        },
        joints={
            "A": {"revolute": ["frame", "crank"], "drive": {"speed": 10.0}},
            "B": {"revolute": ["crank", "coupler"]},
            "C": {"revolute": ["coupler", "rocker"], "side": "left"},
            "D": {"revolute": ["frame", "rocker"]},
        },
        trace=["coupler.E"],
        goal=goal,
    )


@pytest.fixture(scope="module")
def wanted():
    """Angles of the rocker, and places of the point, of the hidden design."""
    run = run_scene(four_bar(HIDDEN, None), frames=FRAMES)
    return run.catalogue["link.rocker.angle"].values()[:-1:4, 0], run.catalogue["point.coupler.E.position"].values()[:-1:3]


def goals(wanted):
    angles, places = wanted
    return {
        "follow": {"follow": {"quantity": "link.rocker.angle", "drive": list(np.arange(0.0, 360.0, 60.0)), "values": list(angles)}},
        "timed path": {"path": {"point": "coupler.E", "through": places.tolist(), "drive": list(np.arange(0.0, 360.0, 45.0))}},
        "path": {"path": {"point": "coupler.E", "through": places.tolist()}},
        "both": {"minimise": "link.rocker.angle:range", "maximise": ["point.coupler.E.position[x]:rms"]},
    }


AWAY = {k: v * f for (k, v), f in zip(HIDDEN.items(), (1.1, 0.93, 1.12, 0.9, 1.15), strict=True)}


@pytest.mark.parametrize("kind", ["follow", "timed path", "path", "both"])
def test_slopes_of_objectives_are_limits_of_their_differences(kind, wanted):
    problem = problem_of(four_bar(AWAY, goals(wanted)[kind]), frames=FRAMES)
    _, _, slopes, _ = problem.differentiated(problem.start)
    for k in range(len(problem.variables)):
        step = np.zeros(len(problem.variables))
        step[k] = 1e-3
        near = problem.score(np.stack([problem.start + step, problem.start - step])).objectives
        np.testing.assert_allclose(slopes[:, k], (near[0] - near[1]) / 2e-3, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("kind", ["follow", "timed path"])
def test_a_hidden_linkage_is_found_again(kind, wanted):
    goal = goals(wanted)[kind]
    names = "abc" if kind == "follow" else "axy"
    search = Search(problem_of(four_bar({k: AWAY[k] for k in names} | {k: HIDDEN[k] for k in HIDDEN if k not in names},
                                        goal | {"vary": list(names)}), frames=FRAMES), generations=8)  # fmt: skip
    best = optimise(search)
    np.testing.assert_allclose(best.design, [HIDDEN[k] for k in names], rtol=1e-4)
    assert search.best()[1] < 1e-3 and not search.refused


@pytest.mark.parametrize("kind", ["follow", "timed path"])
def test_places_of_the_drive_do_not_move_with_its_start(kind, wanted):
    """Wherever the crank of the hidden design starts, it passes the places; angles are wanted up to whole turns."""
    goal = goals(wanted)[kind] | {"vary": ["c", "start"]}
    if kind == "follow":
        goal["follow"]["values"] = [float(x) + 360.0 for x in goal["follow"]["values"]]
    start = {"value": "0 deg", "range": ["-90 deg", "90 deg"]}
    scene = four_bar(HIDDEN, goal).changed({("parameters", "start"): start, ("joints", "A", "drive", "start"): "start"})
    problem = problem_of(scene, frames=360)
    starts = np.array([[HIDDEN["c"], 0.0], [HIDDEN["c"], -70.3], [HIDDEN["c"], 40.7], [1.1 * HIDDEN["c"], 0.0]])
    objectives = problem.score(starts).objectives[:, 0]
    assert objectives[:3].max() < 1e-5 < 1e-2 < objectives[3]
    slopes = problem.differentiated(np.array([1.1 * HIDDEN["c"], 40.7]))[2]
    assert abs(slopes[0, 1]) < 1e-5 < 1e-2 < abs(slopes[0, 0])


def test_grashofs_rule_is_a_limit():
    """Crank 60, coupler 175, frame 200 mm: the rocker of a crank-rocker is 85 to 315 mm long, also where the crank only swings."""
    goal = {"vary": ["c"], "minimise": "link.rocker.angle:range", "grashof": "crank-rocker"}
    swinging = {("joints", "A", "drive"): {"oscillation": {"centre": 60, "amplitude": 10, "period": "1 s"}}}
    scene = four_bar(HIDDEN, goal).changed({**swinging, ("parameters", "c", "range"): ["40 mm", "330 mm"]})
    problem = problem_of(scene, frames=FRAMES)
    rockers = np.array([50.0, 85.0, 100.0, 315.0, 320.0])
    np.testing.assert_allclose(problem.limited(rockers[:, None], [])[:, 0], [-15.0, 0.0, 15.0, 0.0, -5.0], atol=1e-9)
    judged = problem.score(np.array([[84.0], [85.0], [86.0], [314.0], [315.0], [318.0]]))
    np.testing.assert_array_equal(judged.feasible, [False, False, True, True, False, False])  # a change point is no crank-rocker
    for rocker, slope in ((100.0, 1.0), (310.0, -1.0)):
        np.testing.assert_allclose(problem.differentiated(np.array([rocker]))[3], [[slope]], rtol=1e-9)
    best = optimise(Search(problem, generations=1))
    assert "Grashof A-B-C-D, crank-rocker" in str(list(best.lines())) and 85.0 - 1e-6 <= best.design[0] <= 315.0 + 1e-6
    with pytest.raises(MechanismError, match="no four-bar loop"):
        problem_of(press({"minimise": "drive.A.torque:peak", "grashof": "any"}), frames=12)


def test_a_box_keeps_all_points_of_moving_links_within_it():
    """The longer the rocker, the less it swings, and the higher its end reaches."""
    goal = {"vary": ["c"], "minimise": "link.rocker.angle:range", "box": [[360, -100], [-70, 150]]}
    scene = four_bar(HIDDEN, goal)
    problem = problem_of(scene, frames=FRAMES)
    assert {limit.text.split(".position")[0] for limit in problem.limits} == {"point.crank.B", "point.coupler.C", "point.coupler.E"}
    best = optimise(Search(problem, generations=1))
    assert best.scene.document.trace == scene.document.trace
    assert (run_scene(best.scene, frames=FRAMES).motion.point("rocker", "C")[:, 1] * 1e3).max() == pytest.approx(150.0, abs=1e-5)


def press(goal):
    return load("parametric-press").changed({("goal",): {"vary": ["stroke", "ratio"], **goal}})


def test_limits_decide_where_they_are_reached():
    """The ram reaches (1 + ratio) stroke/2: least at the least ratio and the least stroke that is allowed."""
    goal = {"minimise": "link.ram.position[x]:max", "limits": {"joint.S.displacement:range": {"least": "7 cm"}}}
    best = optimise(Search(problem_of(press(goal), frames=12), seed=3))
    np.testing.assert_allclose(best.design, [70.0, 3.0], rtol=1e-8)
    rows = {row[0]: row for row in best.lines()}
    assert rows["joint.S.displacement:range at least 70 mm"][3] == "reached" and rows["ratio"][3] == "at its least value"
    assert best.scene.parameters["stroke"].amount.number == pytest.approx(0.07)


def test_an_acute_transmission_angle_is_a_limit_on_both_sides_of_a_right_one():
    """Of a short coupler the angle only grows beyond a right one: its least is no limit of how flat it becomes."""
    goal = {"vary": ["b"], "minimise": "joint.D.angle:range"}
    goal["limits"] = {f"transmission_angle.C.{angle}:min": {"least": "40 deg"} for angle in ("angle", "acute")}
    scene = four_bar(HIDDEN, goal).changed(
        {("metrics",): ["transmission_angle"], ("parameters", "b", "range"): ["80 mm", "200 mm"]}
    )
    problem = problem_of(scene, frames=FRAMES)
    _, limited, _, slopes = problem.differentiated(np.array([125.0]))
    widest = np.degrees(np.arccos((125.0**2 + 140.0**2 - 260.0**2) / (2 * 125.0 * 140.0)))
    assert limited[0] > 40.0 and limited[1] == pytest.approx(180.0 - widest)
    assert slopes[1, 0] == pytest.approx(
        np.degrees((125.0 - 140.0 * np.cos(np.radians(widest))) / (125.0 * 140.0 * np.sin(np.radians(widest))))
    )
    assert not problem.score(np.array([[125.0]])).feasible[0]


def test_a_limit_that_rounding_would_miss_is_kept_by_all_digits():
    """A stroke of nine digits is 4e-9 of it too short."""
    goal = {"minimise": "link.ram.position[x]:max", "limits": {"joint.S.displacement:range": {"least": 100.0000004}}}
    problem = problem_of(press(goal), frames=12)
    designs = np.array([[100.0000004, 4.0 + 1e-12], [100.0000006, 4.0 + 1e-12]])
    np.testing.assert_array_equal(rounded(problem, designs), [designs[0], [100.000001, 4.0]])


def test_what_a_design_has_not_is_none_and_not_kept():
    """Of a crank of 79 mm and a rocker that is too short for it there is nothing."""
    goal = {"vary": ["c"], "minimise": "link.rocker.angle:range", "limits": {"link.rocker.angle:max": {"most": 170}}}
    problem = problem_of(four_bar(HIDDEN, goal).changed({("parameters", "c", "range"): ["10 mm", "200 mm"]}), frames=FRAMES)
    short = np.array([[12.0]])
    rows = list(Optimum(Search(problem), short[0], short).lines())
    assert [row[2:] for row in rows[1:3]] == [("none", ""), ("none", "missed")]


def test_what_misses_a_limit_by_far_is_better_than_what_cannot_be_assembled():
    """A limit of zero is missed by parts of the nominal value, not by degrees."""
    goal = {"vary": ["c"], "minimise": "link.rocker.angle:range", "limits": {"joint.D.angle:range": {"most": 0}}}
    scene = four_bar(HIDDEN, goal).changed({("parameters", "c", "range"): ["10 mm", "200 mm"]})
    problem = problem_of(scene, frames=FRAMES)
    judged = problem.score(np.array([[12.0], [HIDDEN["c"]], [90.0]]))
    assert judged.violations[1] == pytest.approx(1.0) and judged.order().tolist() == [1, 2, 0]
    with pytest.raises(MechanismError, match="misses them by"):
        optimise(Search(problem, population=5, generations=0))


def test_the_same_seed_finds_the_same():
    goal = {"minimise": "drive.A.torque:peak", "limits": {"joint.S.displacement:range": {"least": 70}}}
    designs = [optimise(Search(problem_of(press(goal), frames=12), seed=s, generations=3)).design for s in (5, 5)]
    np.testing.assert_array_equal(*designs)


def test_a_front_has_no_design_that_another_beats():
    """Stroke against length: on the front the ratio is least, and nothing else is."""
    goal = {"minimise": "link.ram.position[x]:max", "maximise": "joint.S.displacement:range"}
    best = optimise(Search(problem_of(press(goal), frames=12), generations=8), points=4)
    objectives = best.search.problem.score(best.front).objectives
    assert len(best.front) == 4 and np.all(np.diff(objectives[:, 0]) > 0.0) and np.all(np.diff(objectives[:, 1]) < 0.0)
    np.testing.assert_allclose(best.front[[0, -1], 0], [40.0, 120.0], rtol=1e-5)
    np.testing.assert_allclose(best.front[:, 1], 3.0, rtol=5e-3)


@pytest.mark.thorough
def test_a_front_of_three_objectives_goes_from_the_best_of_each_to_that_of_the_others(tmp_path):
    """Length and torque small, stroke great: the shortest has the least stroke and ratio, the strongest the least stroke and the
    greatest ratio, the longest stroke any ratio."""
    file = tmp_path / "three.toml"
    goal = {"minimise": ["link.ram.position[x]:max", "drive.A.torque:peak"], "maximise": "joint.S.displacement:range"}
    dump(press(goal), file)
    words = ["optimise", str(file), "-n", "8", "--generations", "1", "--points", "6"]
    said = CliRunner().invoke(app, [*words, "--front", str(tmp_path / "f.csv"), "--plot", str(tmp_path / "f.svg")])
    assert said.exit_code == 0, said.stderr
    rows = np.loadtxt(tmp_path / "f.csv", delimiter=",", skiprows=1)
    costs, strokes, ratios = rows[:, :3] * [1.0, 1.0, -1.0], rows[:, 3], rows[:, 4]
    assert len(rows) == 6 and not any(np.all(a <= b) for i, a in enumerate(costs) for j, b in enumerate(costs) if i != j)
    for k, stroke, ratio in ((0, 40.0, 3.0), (1, 40.0, 6.0), (2, 120.0, None)):
        best = costs[:, k].argmin()
        assert strokes[best] == pytest.approx(stroke, rel=1e-3) and (
            ratio is None or ratios[best] == pytest.approx(ratio, rel=1e-2)
        )


def test_the_best_design_is_written_into_the_text_of_its_scene(tmp_path):
    """Only the values that were found differ: comments, order and layout stay, also where an option has set a parameter."""
    text = load("parametric-press").text.replace("[parameters]", "# sizes of the shop\n[parameters]  # found by hand")
    file, better = tmp_path / "press.toml", tmp_path / "better.toml"
    file.write_text(text, encoding="utf-8")
    words = ["optimise", str(file), "-o", str(better), "-n", "12", "--generations", "0", "--population", "5", "--set", "ratio=5"]
    said = CliRunner().invoke(app, words)
    assert said.exit_code == 0, said.stderr
    lines = better.read_text(encoding="utf-8").splitlines()
    changed = [old for old, new in zip(text.splitlines(), lines, strict=True) if old != new]
    assert changed and all(line.startswith(("stroke =", "ratio =")) for line in changed)


def test_an_interrupted_search_keeps_its_best():
    calls = []

    def stop(*said):
        calls.append(said)
        if len(calls) == 3:
            raise KeyboardInterrupt

    search = Search(problem_of(press({"minimise": "link.ram.position[x]:max"}), frames=12), progress=stop)
    best = optimise(search)
    assert search.interrupted
    known = search.all.objectives[search.all.best(), 0]
    assert search.problem.score(best.design[None]).objectives[0, 0] == pytest.approx(known, rel=1e-8)


SWINGING_BLOCK = """
units = { length = "m", angle = "deg" }
effects = ["inertia"]
run = { duration = "0.2 s", frames = 8, tolerance = 1e-6 }
parameters = { load = { value = "1 kg", range = ["0.5 kg", "2 kg"] } }
goal = { minimise = "joint.S.velocity:range" }
[links]
frame = { points = { O = [0, 0], G = [-1, 0] } }
block = { points = { T = [0, 0] }, mass = "load" }
[joints]
S = { prismatic = ["frame", "block"], at = ["O", "T"], along = [1, 0], free = { position = 0.1 } }
[loads]
spring = { spring = ["frame.G", "block.T"], stiffness = "100 N/m", free_length = 1 }
"""


@pytest.mark.thorough
def test_designs_that_are_run_one_by_one_say_how_many_of_them_are_done(tmp_path, monkeypatch):
    """Of a motion under forces, whose designs are not computed side by side: samples, and a generation."""
    monkeypatch.setattr("mechviz.progress.LINE_PAUSE", 0.0)
    path = tmp_path / "block.toml"
    path.write_text(SWINGING_BLOCK)
    said = CliRunner().invoke(app, ["optimise", str(path), "--population", "5", "--generations", "0"])
    assert said.exit_code == 0, said.output
    assert "optimising: samples; 4 of 65 designs\n" in said.stderr
    assert re.search(r"optimising: samples: 0.* m/s; 4 of 5 designs\n", said.stderr)


@pytest.mark.thorough
def test_what_cannot_be_had_is_said():
    with pytest.raises(MechanismError, match="misses them by"):
        goal = {"minimise": "link.ram.position[x]:max", "limits": {"joint.S.displacement:range": {"least": 500}}}
        optimise(Search(problem_of(press(goal), frames=12), generations=2))
    for goal, words in (
        ({"minimise": "drive.A.torque"}, "is a curve"),
        ({"minimise": "drive.A.torque:peak", "vary": ["speed2"]}, "is no parameter"),
        ({"minimise": "drive.A.torque:peak", "vary": ["throw"]}, "follows from others"),
        ({"minimise": "drive.A.torque:peak", "limits": {"joint.B.reaction:peak": {"most": "3 mm"}}}, "no unit"),
        ({}, "without an objective"),
        ({"follow": {"quantity": "drive.A.torque", "drive": [0, 1], "values": [1, 2, 3]}}, "Give as many"),
        ({"follow": {"quantity": "drive.A.torque:max", "drive": [0, 1], "values": [1, 2]}}, "is a number"),
        ({"follow": {"quantity": "drive.A.torque", "drive": [0, "3 mm"], "values": [1, 2]}}, "goal.follow.drive"),
    ):
        with pytest.raises(MechanismError, match=words):
            problem_of(press(goal), frames=12)


def test_all_that_is_wrong_with_a_goal_is_said_at_once_under_its_own_keys(tmp_path):
    goal = {
        "vary": ["length"], "minimise": "joint.D.angle", "maximise": "joint.B.reaction:peak",
        "limits": {"joint.D.angl:max": {"most": 3}}, "path": {"point": "coupler.F", "through": [[0, 0], [1, 1]]},
    }  # fmt: skip
    scene = four_bar(HIDDEN, goal)
    without_a_run = {"goal.vary": "no parameter", "goal.minimise": "curve"}
    with pytest.raises(MechanismError) as caught:
        problem_of(scene, frames=4)
    said = {fault.path: f"{fault.message} {fault.remedy}" for fault in caught.value.faults}
    of_a_run = {"goal.maximise": "no forces", "goal.limits.joint.D.angl:max": "mean 'joint.D", "goal.path.point": "coupler.E.pos"}
    wanted = without_a_run | of_a_run
    assert said.keys() == wanted.keys() and all(words in said[path] for path, words in wanted.items())
    dump(scene, tmp_path / "goal.toml")
    checked = CliRunner().invoke(app, ["check", str(tmp_path / "goal.toml")])
    assert checked.exit_code == 2 and all(path in checked.output for path in without_a_run) and "2 problems" in checked.output


def test_units_of_all_limits_are_checked_at_once():
    limits = {"joint.S.displacement:range": {"least": "3 kg"}, "joint.B.reaction:peak": {"least": 3, "most": 2}}
    with pytest.raises(MechanismError) as caught:
        problem_of(press({"minimise": "drive.A.torque:peak", "limits": limits}), frames=4)
    assert [fault.path for fault in caught.value.faults] == [f"goal.limits.{text}" for text in limits]


def test_the_command_writes_a_better_scene(tmp_path):
    file = tmp_path / "better.toml"
    said = CliRunner().invoke(app, ["optimise", "parametric-press", "-n", "24", "--generations", "3", "-o", str(file)])
    assert said.exit_code == 0 and "reached" in said.stdout
    better = run_scene(load(file), frames=24).catalogue["drive.A.torque"].values().max()
    assert better < 0.9 * run_scene(load("parametric-press"), frames=24).catalogue["drive.A.torque"].values().max()
    assert CliRunner().invoke(app, ["optimise", "crank-rocker"]).exit_code == 2
