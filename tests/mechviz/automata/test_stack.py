"""Copies of parts on a shaft, planes along it, and mechanisms that walk."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

import mechviz
from mechcore.errors import MechanismError
from mechcore.motion.events import find_events
from mechviz.automata.walking import walk_of, walking_scene
from mechviz.commands.main import app
from mechviz.outputs.rerun.blueprint import make_blueprint
from mechviz.picture.build import picture_of, solids_of
from mechviz.picture.nodes import Body
from mechviz.runs import run_scene

UNITS = {"length": "mm", "angle": "deg"}


def stack(count, **copy):
    return mechviz.Scene.build(
        units=UNITS,
        parameters={"late": "40 deg"},
        run={"frames": 72},
        links={
            "frame": {"points": {"O": [0, 0], "G": [0, 60], "C": [90, 0]}},
            "shaft": {"points": {"O": [0, 0], "B": [12, 0]}},
            "lifter": {"points": {"T": [0, 0]}},
            "rod": {"points": {"B": [0, 0], "C": [70, 0]}},
            "slide": {"points": {"C": [0, 0]}},
        },
        joints={
            "O": {"revolute": ["frame", "shaft"], "drive": {"speed": "10 rpm"}},
            "S": {"prismatic": ["frame", "lifter"], "at": ["G", "T"], "along": [0, 1]},
            "K": {
                "cam": ["shaft", "lifter"],
                "follower": {"roller": 5, "guide": "S", "point": "T"},
                "profile": {"base": 20, "phase": 15, "lift": [{"over": 180, "to": 12}, {"over": 180, "to": 0}]},
            },
            "B": {"revolute": ["shaft", "rod"]},
            "C": {"revolute": ["rod", "slide"]},
            "X": {"prismatic": ["frame", "slide"], "at": ["O", "C"], "branch": "ahead"},
        },
        copies=[{"count": count, **copy}] if count else [],
    )


def test_copied_followers_do_the_same_a_phase_earlier():
    """RoundFeature by its phase a cam lifts as the first one does a phase later: three lifts are one curve, shifted by frames."""
    motion = run_scene(stack(2, of=["lifter"], phase=40)).motion
    lift = [motion.point(name, "T")[:-1, 1] for name in ("lifter", "lifter 2", "lifter 3")]
    for k, late in enumerate(lift):
        assert np.allclose(late, np.roll(lift[0], -8 * k), atol=1e-12)
    assert np.ptp(lift[0]) == pytest.approx(12e-3)


def test_copied_cranks_are_fixed_to_the_first_at_their_phase():
    """A slider-crank a quarter of a turn ahead, from the closed form of its stroke."""
    motion = run_scene(stack(1, of=["shaft", "lifter", "rod", "slide"], phase=90)).motion
    angle = 2.0 * np.pi * np.arange(73) / 72
    for name, phase in (("slide", 0.0), ("slide 2", 0.5 * np.pi)):
        turn = angle + phase
        assert np.allclose(motion.point(name, "C")[:, 0], 12e-3 * np.cos(turn) + np.sqrt(70e-3**2 - (12e-3 * np.sin(turn)) ** 2))
    lift = [motion.point(name, "T")[:-1, 1] for name in ("lifter", "lifter 2")]
    assert np.allclose(lift[0], lift[1], atol=1e-12) is False
    assert {joint.name for joint in motion.mechanism.joints} >= {"K 2", "S 2", "B 2", "X 2", "O 2"}


def test_copies_lie_one_behind_the_other_along_the_shaft():
    apart = 0.05
    run = run_scene(stack(3, of=["lifter"], phase=-30, offset=1e3 * apart))
    z = {name: solid.vertices[:, 2] for name, solid in solids_of(run).links.items() if name.startswith("lifter")}
    middles = [0.5 * (v.min() + v.max()) for v in (z[name] for name in ("lifter", "lifter 2", "lifter 3", "lifter 4"))]
    beyond = np.array(middles) - middles[0] - apart * np.arange(4)
    assert np.all(beyond > -1e-6) and np.all(beyond < 6e-3)  # whole layers of 4.9 mm


def test_copies_read_back_as_they_were_and_faults_are_told():
    scene = stack(2, of=["lifter"], phase="late / 2")
    assert mechviz.loads(scene.to_toml()) == scene
    with pytest.raises(mechviz.SceneError, match=r"copies\[0\]\.of\[0\].*there is no link 'liftr'"):
        stack(1, of=["liftr"])
    with pytest.raises(mechviz.SceneError, match=r"copies\[0\].count"):
        stack(0.5, of=["lifter"])


@pytest.fixture(scope="module")
def toy():
    return mechviz.load("walking-toy")


def test_the_standing_foot_stands_still_in_the_scene_of_the_walk(toy):
    walk = walk_of(toy, [("foot", "H"), ("foot 2", "H")], 1e-3)
    motion = run_scene(walking_scene(toy, walk, "walk").changed({("run", "frames"): 999})).motion
    heights = np.stack([motion.point(foot, "H")[:, 1] for foot in ("foot", "foot 2")])
    speeds = np.stack([motion.point(foot, "H", 1)[:, 0] for foot in ("foot", "foot 2")])
    stands = heights.argmin(axis=0)
    assert np.abs(heights.min(axis=0)).max() < 2e-6
    assert np.abs(speeds[stands, np.arange(1000)]).max() < 1e-3 * np.abs(speeds).max()
    gone = motion.point("body", "A")[-1] - motion.point("body", "A")[0]
    assert gone == pytest.approx([walk.advance, 0.0], abs=1e-6)


def test_what_leads_a_walk_is_recorded_and_not_drawn():
    """Neither in pictures nor in rerun's view of the mechanism."""
    points = {"A": [0, 0], "F": [30, 0], "G": [-30, 0]}
    toy = mechviz.Scene.build(
        units=UNITS,
        run={"frames": 12},
        links={"frame": {"points": {"A": [0, 0]}}, "wheel": {"points": points}},
        joints={"A": {"revolute": ["frame", "wheel"], "drive": {"speed": "-10 rpm"}}},
    )
    run = run_scene(walking_scene(toy, walk_of(toy, [("wheel", "F"), ("wheel", "G")], 1e-9), "walk"), frames=12)
    picture = picture_of(run, solids_of(run))
    drawn, kept = ({node.parent for node in picture.nodes_of(Body, group)} for group in ("solids", "undrawn"))
    assert drawn == {"wheel", "frame", "lawn"} and kept == {"ground", "cart"}
    view = make_blueprint(run, {"motion": np.asarray(picture.bounds)}, []).root_container.contents[0].contents[0]
    assert {f"- /mechanism/links/{link}/mesh" for link in kept} <= set(view.contents)


def test_a_walk_of_wheels_of_spokes_is_the_one_of_a_rimless_wheel():
    """Feet at the ends of evenly spaced spokes about the crank's axis: the body rolls over each spoke like a rimless wheel, whose
    step is a chord, whose bounce is r (1 - cos(pi / n)), and of which a foot never slips."""
    n, r = 5, 30.0
    feet = {f"F{k}": [r * np.cos(2.0 * np.pi * k / n), r * np.sin(2.0 * np.pi * k / n)] for k in range(n)}
    scene = mechviz.Scene.build(
        units=UNITS,
        links={"frame": {"points": {"A": [0, 0]}}, "wheel": {"points": {"A": [0, 0], **feet}}},
        joints={"A": {"revolute": ["frame", "wheel"], "drive": {"speed": "-10 rpm"}}},
    )
    walk = walk_of(scene, [("wheel", name) for name in feet], 1e-9)
    assert walk.advance == pytest.approx(n * 2e-3 * r * np.sin(np.pi / n), rel=1e-4)
    assert walk.bounce == pytest.approx(1e-3 * r * (1.0 - np.cos(np.pi / n)), rel=1e-3)
    assert walk.shares == pytest.approx([1.0 / n] * n, rel=1e-3) and max(walk.slips) < 1e-9
    # a foot at the height c sin(a) of a chord c that leans by a goes along the ground with c sin(a) da, before it stands and after
    touch, chord = 8e-3, 2e-3 * r * np.sin(np.pi / n)
    slip = 2.0 * (chord - np.sqrt(chord**2 - touch**2))
    assert walk_of(scene, [("wheel", name) for name in feet], touch).slips == pytest.approx([slip] * n, rel=0.01)


def test_a_walk_is_told_in_the_units_of_the_scene(toy, tmp_path):
    scene = tmp_path / "inches.toml"
    scene.write_text(toy.text.replace('length = "mm"', 'length = "in"'), encoding="utf-8")
    said = CliRunner().invoke(app, ["walk", str(scene), "--foot", "foot.H", "--foot", "foot 2.H", "--touch", "1 mm"])
    assert said.exit_code == 0, said.stderr
    walk = walk_of(mechviz.load(str(scene)), [("foot", "H"), ("foot 2", "H")], 1e-3)
    assert f"leads {walk.advance / 0.0254:.4g} in: " in said.stdout and " mm" not in said.stdout


def test_a_walk_needs_two_feet(toy):
    with pytest.raises(Exception, match="at least two take turns"):
        walk_of(toy, [("foot", "H")], 1e-3)


def test_limit_positions_where_two_rises_of_a_cam_meet_are_told_apart():
    """The jester's cam lifts by 14 degrees, twice, without a rest: at the joints of its laws speed and acceleration are zero."""
    events = [event for event in find_events(run_scene(mechviz.load("theatre")).motion) if event.item == "P"]
    told = [("largest" in event.text, round(event.time / 5.0 * 360.0)) for event in events]
    assert told == [(True, 60), (False, 120), (True, 180)]


def test_a_foot_that_is_named_twice_is_no_second_one(toy):
    with pytest.raises(MechanismError, match="named twice"):
        walk_of(toy, [("foot", "H"), ("foot", "H")], 1e-3)
