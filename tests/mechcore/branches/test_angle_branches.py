"""Where relative angles start, and that they are one function of the motion, however it is described and asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from comparison import Result, differences
from metamorphosis import Change
from random_mechanisms import FRAME, Case
from wound_springs import AT_REST, FIVE_BAR, FOUR_BAR, GEARED, SLIDER_CRANK, SPRING, STOPPED, TABLE, four_bar

import mechviz
from mechcore.branches.unwrapped import StartPose
from mechcore.dynamics.equations.reduced import motion_at
from mechcore.dynamics.events import EventTrigger
from mechcore.dynamics.simulate import simulate
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.timed import ConstantSpeed, Free
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.motion.sweep import sweep
from mechviz.runs import run_scene

TURN = 2.0 * np.pi
TURNS = [-40.0, -90.0, 180.0, 179.999, 31.7]


def case(text: str, times: int = 31) -> Case:
    """A scene as a case of the metamorphic tests, its fixed link named as theirs."""
    scene = mechviz.loads(text)
    m = scene.mechanism

    def named(link: str | None) -> str | None:
        return FRAME if link == m.frame else link

    loads = []
    for load in m.loads:
        changes = {key: named(getattr(load, key)) for key in ("link", "against") if getattr(load, key, None) is not None}
        if hasattr(load, "links"):
            changes["links"] = tuple(map(named, load.links))
        loads.append(replace(load, **changes))
    joints = []
    for joint in m.joints:
        carrier = {"carrier": named(joint.carrier)} if hasattr(joint, "carrier") else {}
        joints.append(replace(joint, links=tuple(map(named, joint.links)), **carrier))
    links = tuple(replace(k, name=named(k.name)) for k in m.links)
    m = replace(m, frame=FRAME, links=links, joints=tuple(joints), loads=tuple(loads))
    first = solve_motion(compile_mechanism(m), [0.0])
    end = scene.simulation.duration if scene.simulation else m.drives[0].law.duration
    result = Case("focused", 3, m, np.linspace(0.0, end, times))
    return replace(
        result,
        start={p.name: float(first.coordinate(p.name)[0, 0]) for p in m.joints},
        poses={k: tuple(map(float, first.pose(k)[0])) for k in first.model.links},
        stops=scene.simulation.stops if scene.simulation else (),
        triggers=scene.simulation.triggers if scene.simulation else (),
    )


PRESCRIBED = FOUR_BAR.format(ex=-200.0, ey=60.0, start=170.0) + SPRING + TABLE
BOUNCING = FIVE_BAR.replace(
    'B = { revolute = ["c1", "k1"] }',
    'B = { revolute = ["c1", "k1"], stops = [{ at = 130, side = "upper", restitution = 0.7 }] }',
).replace(
    "[sketch]",
    """[watch]
passed = { joint = "D", at = 200 }
[sketch]""",
)
CASES = {
    "prescribed": PRESCRIBED,
    "spring": SLIDER_CRANK + AT_REST,
    "stop": SLIDER_CRANK + STOPPED,
    "five-bar": FIVE_BAR,
    "bouncing five-bar": BOUNCING,
    "geared": GEARED,
}


@pytest.fixture(scope="module")
def results() -> dict[str, tuple[Case, Result]]:
    return {}


def base_of(name: str, results: dict[str, tuple[Case, Result]]) -> tuple[Case, Result]:
    if name not in results:
        made = case(CASES[name])
        results[name] = made, Result(made)
    return results[name]


CHANGES = {f"turned {x}": {"turn": np.radians(x)} for x in TURNS} | {"mirrored": {"mirrored": True}, "reordered": {"mixed": 5}}


@pytest.mark.sample(9)
@pytest.mark.parametrize(  # each of the mechanisms by half of the changes
    ("name", "how"), [(name, how) for k, name in enumerate(CASES) for j, how in enumerate(CHANGES) if (j + k) % 2]
)
def test_nothing_depends_on_how_the_mechanism_is_described(name, how, results):
    made, base = base_of(name, results)
    change = Change(made, **CHANGES[how])
    wrong = {k: x for k, x in differences(change, base, Result(change.made())).items() if x > 1e-8}
    assert not wrong


def drag_link(turns: float = 1.0, frames: int = 61):
    """A double crank: coupler and rocker turn fully with the crank; times of the frames over some turns."""
    text = FOUR_BAR.format(ex=30.0, ey=0.0, start=170.0).replace("[60, 0]", "[120, 0]").replace("[180, 0]", "[100, 0]")
    compiled = compile_mechanism(mechviz.loads(text).mechanism)
    return compiled, np.linspace(0.0, turns, frames)


def test_an_angle_is_one_function_of_time_however_it_is_asked_for():
    compiled, dense = drag_link(3.0, 1081)
    want = {p: solve_motion(compiled, dense).coordinate(p)[:, 0] for p in "ABDE"}
    assert np.abs(want["E"][-1] - want["E"][0]) == pytest.approx(3.0 * TURN, abs=1e-9)
    rng = np.random.default_rng(1)
    mixed = rng.permutation(len(dense))
    motion = solve_motion(compiled, dense)
    for joint, q in want.items():
        for at in (mixed, np.array([1080]), np.array([700, 3]), np.arange(0, 1081, 216)):
            assert solve_motion(compiled, dense[at]).coordinate(joint)[:, 0] == pytest.approx(q[at], abs=1e-9)
            assert motion.at_times(dense[at]).coordinate(joint)[:, 0] == pytest.approx(q[at], abs=1e-9)
    given = {"A": (want["A"][mixed], np.ones(1081), np.zeros(1081))}
    apart = solve_motion(compiled, np.zeros(1081), drives=given)
    assert apart.coordinate("E")[:, 0] == pytest.approx(want["E"][mixed], abs=1e-9)


@pytest.mark.parametrize("turns", [1000, -1000, 40_000])
def test_turns_are_counted_over_long_runs(turns):
    compiled, _ = drag_link()
    first = solve_motion(compiled, [0.0])
    sign = float(np.sign(turns))
    speed = replace(compiled.mechanism.drives[0], law=ConstantSpeed(np.radians(170.0), sign * TURN))
    compiled = compile_mechanism(replace(compiled.mechanism, drives=(speed,)))
    last = solve_motion(compiled, [abs(turns) + 0.25])
    quarter = solve_motion(compiled, np.linspace(0.0, 0.25, 9))
    for joint in "ABDE":
        whole = TURN * turns * (joint in "AE")
        gone = last.coordinate(joint)[0, 0] - quarter.coordinate(joint)[-1, 0]
        assert gone == pytest.approx(whole, abs=1e-6 * max(1.0, abs(whole)))
        assert quarter.coordinate(joint)[0, 0] == pytest.approx(first.coordinate(joint)[0, 0], abs=1e-12)


def test_several_drives_are_followed_in_time():
    compiled = compile_mechanism(mechviz.load("five-bar").mechanism)
    end = 3.0 * max(d.law.duration for d in compiled.mechanism.drives)
    dense = np.linspace(0.0, end, 2161)
    want, some = solve_motion(compiled, dense), np.arange(0, 2161, 540)
    for joint in compiled.model.joint_index:
        q = want.coordinate(joint)[:, 0]
        assert (np.abs(np.diff(q)).max() < 1.0 and -np.pi < q[0] <= np.pi) or joint in {d.joint for d in compiled.mechanism.drives}
        assert solve_motion(compiled, dense[some]).coordinate(joint)[:, 0] == pytest.approx(q[some], abs=1e-9)
        assert solve_motion(compiled, dense[[2000]]).coordinate(joint)[0, 0] == pytest.approx(q[2000], abs=1e-9)


def test_designs_of_a_sweep_start_and_turn_as_each_alone():
    compiled, _ = drag_link()
    lengths = np.array([0.115, 0.12, 0.126])
    points = {("rocker", "D"): np.column_stack([lengths, 0.0 * lengths])}
    time = np.linspace(1.3, 2.9, 7)
    table = sweep(compiled, points, time, lambda m: {p: m.coordinate(p)[..., 0] for p in "BDE"})
    for k, length in enumerate(lengths):
        links = tuple(
            replace(link, points={**link.points, "D": (float(length), 0.0)}) if link.name == "rocker" else link
            for link in compiled.mechanism.links
        )
        alone = solve_motion(compile_mechanism(replace(compiled.mechanism, links=links)), time)
        for joint in "BDE":
            assert table.results[joint][k] == pytest.approx(alone.coordinate(joint)[:, 0], abs=1e-9)


@pytest.mark.parametrize("name", ["five-bar", "stop"])
def test_a_motion_under_forces_has_the_same_angles_at_single_times(name):
    made = case(CASES[name])
    run = simulate(made.mechanism, float(made.time[-1]), stops=made.stops)
    dense = run.view(made.time)
    rng = np.random.default_rng(2)
    mixed = rng.permutation(len(made.time))
    for joint in made.mechanism.joints:
        q = dense.coordinate(joint.name)[:, 0]
        for at in (mixed, np.array([29]), np.array([17, 2])):
            order = np.argsort(at)
            assert run.view(made.time[at[order]]).coordinate(joint.name)[:, 0] == pytest.approx(q[at[order]], abs=1e-9)


# -- where they start -------------------------------------------------------------------------------------------------
def pose(
    angle: float, stops: tuple[tuple[str, str, float], ...] = (), tables: dict[str, tuple[float, float]] | None = None
) -> StartPose:
    ranges = {k: (np.radians(low), np.radians(high)) for k, (low, high) in (tables or {}).items()}
    return StartPose({"a": 0.0, "b": np.radians(angle)}, {"a": 0, "b": 1}, ranges).with_stops(stops)


def stop(at: float, side: str) -> tuple[str, str, float]:
    return "B", side, float(np.radians(at))


@pytest.mark.parametrize(
    ("angle", "stops", "starts"),
    [
        (175.0, (), 175.0),
        (185.0, (), -175.0),
        (-180.0, (), 180.0),
        (180.0 + 1e-12, (), 180.0),
        (-180.0 - 1e-12, (), 180.0),
        (900.0, (), 180.0),
        (-175.0, (("upper", 190.0),), 185.0),
        (175.0, (("upper", 190.0),), 175.0),
        (-120.0, (("upper", 90.0),), -120.0),
        (170.0, (("upper", -10.0),), -190.0),
        (190.0, (("upper", 190.0),), 190.0),
        (175.0, (("lower", -190.0),), -185.0),
        (190.0, (("lower", 190.0),), 190.0),
        (-175.0, (("lower", 100.0), ("upper", 260.0)), 185.0),
        (-175.0, (("lower", -200.0), ("upper", -160.0)), -175.0),
        (30.0, (("lower", -400.0), ("upper", 400.0)), 30.0),
    ],
)
def test_a_joint_starts_on_the_side_of_its_stops(angle, stops, starts):
    poses = pose(angle, tuple(stop(at, side) for side, at in stops))
    turns = poses.turns("a", "b", poses.ranges.get("B"))
    assert angle + 360.0 * turns == pytest.approx(starts, abs=1e-9)


@pytest.mark.parametrize(
    ("angle", "table", "starts"),
    [(-170.0, (100.0, 260.0), 190.0), (170.0, (-260.0, -100.0), -190.0), (30.0, (0.0, 720.0), 30.0), (250.0, (0.0, 90.0), -110.0)],
)
def test_a_joint_starts_in_the_range_of_tables_over_it(angle, table, starts):
    poses = pose(angle, tables={"B": table})
    assert angle + 360.0 * poses.turns("a", "b", poses.ranges["B"]) == pytest.approx(starts, abs=1e-9)
    held = pose(angle, (stop(0.0, "upper"),), {"B": table})  # stops come first
    assert -360.0 < angle + 360.0 * held.turns("a", "b", held.ranges["B"]) <= 0.0


def test_a_table_beyond_half_a_turn_is_read_where_the_joint_is():
    """With a table from 100 to 280 deg the rocker's joint starts there, with one from -260 to -80 deg a turn lower."""
    table = 'table = {{ position = [{}, {}], factor = [0, 1], joint = "E", smooth = false }}'
    load = 'push = {{ torque = "3 N m", on = "rocker", ' + table + " }}"
    one, other = (run_scene(four_bar(load.format(low, low + 180))) for low in (100, -260))
    first = np.degrees(one.motion.coordinate("E")[:, 0])
    assert first - 360.0 == pytest.approx(np.degrees(other.motion.coordinate("E")[:, 0]), abs=1e-9)
    assert one.forces.effort("A") == pytest.approx(other.forces.effort("A"), abs=1e-12)
    assert np.abs(one.forces.effort("A")).max() > 0.1


@pytest.mark.parametrize(("start", "turns"), [(30.0, 0), (390.0, 1), (-690.0, -2)])
def test_what_drives_state_counts_with_its_whole_turns(start, turns):
    """A torsion spring between the links of a driven joint is wound by as many turns as its start says."""
    text = four_bar('hinge = { torsion_spring = ["frame", "crank"], stiffness = "2 N m/rad", free_angle = 30 }').text
    scene = mechviz.loads(text.replace("start = 170.0", f"start = {start}"))
    motion = solve_motion(compile_mechanism(scene.mechanism), [0.0])
    assert np.degrees(motion.coordinate("A")[0, 0]) == pytest.approx(start)
    assert -180.0 < np.degrees(motion.coordinate("B")[0, 0]) <= 180.0
    moment = solve_forces(motion).loads["hinge"].values[0, 2]
    assert moment == pytest.approx(2.0 * TURN * turns, abs=1e-9)


def test_a_watch_is_passed_at_the_turn_that_it_names():
    """A drag link under no forces but inertia: its rocker passes 100, 460 and 820 degrees, each once."""
    compiled, _ = drag_link()
    links = tuple(replace(k, mass=1.0, centre=(0.05, 0.0), inertia=0.01) for k in compiled.mechanism.links)
    free = replace(compiled.mechanism.drives[0], law=Free(np.radians(170.0), 10.0))
    mechanism = replace(compiled.mechanism, links=links, drives=(free,), effects=("inertia",))
    first = np.degrees(solve_motion(compiled, [0.0]).coordinate("E")[0, 0])
    looks = tuple(EventTrigger(name=str(at), joint="E", at=np.radians(at)) for at in (-260.0, 100.0, 460.0, 820.0))
    simulation = simulate(mechanism, 3.0, triggers=looks)
    passed = [float(h.item) for h in simulation.events]
    last = np.degrees(simulation.view([3.0]).coordinate("E")[0, 0])
    assert passed == [at for at in (-260.0, 100.0, 460.0, 820.0) if first < at < last] and len(passed) == 2
    for h in simulation.events:
        assert simulation.view([h.time]).coordinate("E")[0, 0] == pytest.approx(np.radians(float(h.item)), abs=1e-8)


@pytest.mark.parametrize("far", [1e4, 1e9, np.inf, np.nan])
@pytest.mark.parametrize("text", [SLIDER_CRANK + AT_REST, FIVE_BAR, GEARED], ids=["crank", "five-bar", "geared"])
@pytest.mark.filterwarnings("ignore:invalid value")
def test_a_trial_of_the_integrator_may_lie_anywhere(text, far):
    """Angles there are not followed over millions of steps; those beside it are as they are without it."""
    compiled = compile_mechanism(mechviz.loads(text).mechanism)
    q = np.array(compiled.start)
    both = np.array([q + 0.01, q + far])
    computed = motion_at(compiled, both, np.zeros_like(both), np.array([0.0, 1e-3])).angles.class_angles
    alone = motion_at(compiled, both[:1], np.zeros_like(both[:1]), np.zeros(1)).angles.class_angles
    assert computed.shape[1] == 2 and computed[:, 0] == pytest.approx(alone[:, 0], abs=1e-12)
