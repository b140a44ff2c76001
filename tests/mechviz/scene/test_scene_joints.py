"""All kinds of joints in scenes: what they become, what goes with which, and every fault of them with its remedy."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from schemas import SCHEMA, conforms

from mechcore.errors import Fault, MechanismError
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.mechanism import Belt, Cylinder, Friction, Gear, PinSlot, Rack, Rolling, Screw, Weld
from mechviz.scene.builder import SceneBuilder
from mechviz.scene.faults import SceneError
from mechviz.scene.scene import Scene, loads

TURNING = {"speed": "60 rpm"}
SWAYING = {"oscillation": {"centre": 700, "amplitude": 100, "frequency": 1}}

BASE: dict[str, Any] = {
    "units": {"length": "mm", "angle": "deg"},
    "links": {
        "frame": {"points": {"A": [0, 0], "B": [100, 0], "G": [0, -40], "P": [0, 0], "E": [30, 40]}},
        "a": {"points": {"A": [0, 0], "T": [30, 0]}},
        "b": {"points": {"B": [0, 0], "T": [60, 10]}},
        "arm": {"points": {"A": [0, 0], "C": [50, 0]}},
        "c": {"points": {"C": [0, 0]}},
        "bar": {"points": {"G": [0, 0]}},
    },
    "joints": {
        "A": {"revolute": ["frame", "a"], "drive": TURNING},
        "B": {"revolute": ["frame", "b"]},
        "D": {"revolute": ["frame", "arm"], "at": "A"},
        "C": {"revolute": ["arm", "c"]},
        "S": {"revolute": ["arm", "a"], "at": "A"},
        "G": {"prismatic": ["frame", "bar"]},
    },
}


def changed(**joints: Any) -> dict[str, Any]:
    data = json.loads(json.dumps(BASE))
    data["joints"] |= joints
    return data


def made(joint: dict[str, Any], name: str = "X") -> Any:
    """The core's joint that an entry becomes."""
    return Scene.build(**changed(**{name: joint})).mechanism.joints[-1]


def faults_of(data: dict[str, Any]) -> tuple[Fault, ...]:
    with pytest.raises(SceneError) as error:
        Scene.build(name="x", **data)
    return error.value.faults


# --- what they become ---------------------------------------------------------------------------------------------------

KINDS = [
    (
        {"weld": ["a", "b"], "at": "T", "angle": "30 deg"},
        Weld(name="X", links=("a", "b"), points=("T", "T"), angle=math.radians(30)),
    ),
    ({"weld": ["a", "b"], "at": ["A", "B"]}, Weld(name="X", links=("a", "b"), points=("A", "B"))),
    (
        {"pin_slot": ["a", "b"], "at": ["A", "T"], "along": [0, -2], "guide": "b"},
        PinSlot(name="X", links=("a", "b"), points=("A", "T"), along=(0.0, -2.0), guide=1),
    ),
    (
        {"pin_slot": ["frame", "b"], "at": ["A", "B"], "along": ["A", "E"]},
        PinSlot(name="X", links=("frame", "b"), points=("A", "B"), along=(0.03, 0.04)),
    ),
    (
        {"rolling": ["frame", "b"], "at": ["P", "B"], "radius": 20, "side": "right", "along": [0, 1]},
        Rolling(name="X", links=("frame", "b"), points=("P", "B"), radius=0.02, along=(0.0, 1.0), side="right"),
    ),
    (
        {"rolling": ["frame", "b"], "at": ["P", "B"], "radius": "1 in"},
        Rolling(name="X", links=("frame", "b"), points=("P", "B"), radius=0.0254),
    ),
    ({"gear": ["a", "b"], "teeth": [20, 30]}, Gear(name="X", links=("a", "b"), carrier="frame", sizes=(20.0, 30.0))),
    (
        {"gear": ["a", "b"], "radii": [25, "7.5 cm"], "pressure_angle": 25},
        Gear(name="X", links=("a", "b"), carrier="frame", sizes=(0.025, 0.075), pressure_angle=math.radians(25)),
    ),
    (
        {"gear": ["a", "b"], "radii": [25, 125], "internal": True},
        Gear(name="X", links=("a", "b"), carrier="frame", sizes=(0.025, 0.125), internal=True),
    ),
    (
        {"gear": ["a", "c"], "carrier": "arm", "teeth": [24, 18]},
        Gear(name="X", links=("a", "c"), carrier="arm", sizes=(24.0, 18.0)),
    ),
    (
        {"belt": ["a", "b"], "radii": [20, 40], "crossed": True},
        Belt(name="X", links=("a", "b"), carrier="frame", radii=(0.02, 0.04), crossed=True),
    ),
    ({"chain": ["a", "b"], "radii": [20, 40]}, Belt(name="X", links=("a", "b"), carrier="frame", radii=(0.02, 0.04))),
    (
        {"rack": ["a", "bar"], "slider": "G", "radius": 40, "side": "right"},
        Rack(name="X", links=("a", "bar"), slider="G", radius=0.04, side="right"),
    ),
    ({"cylinder": ["frame", "b"], "at": ["P", "T"]}, Cylinder(name="X", links=("frame", "b"), points=("P", "T"))),
]


@pytest.mark.parametrize(("entry", "spec"), KINDS, ids=[f"{type(spec).__name__}-{k}" for k, (_, spec) in enumerate(KINDS)])
def test_every_kind_of_joint_in_si(entry, spec):
    computed = made(entry)
    angles = {key: getattr(computed, key) for key in ("angle", "pressure_angle") if hasattr(spec, key)}
    assert computed == replace(spec, **angles)
    for key, value in angles.items():
        assert value == pytest.approx(getattr(spec, key), rel=3e-16)


@pytest.mark.parametrize(("entry", "spec"), KINDS)
def test_every_kind_of_joint_survives_writing_and_reading_and_fits_the_schema(entry, spec):
    data = changed(X=entry)
    scene = Scene.build(**data)
    again = loads(scene.to_toml())
    assert again == scene
    assert again.mechanism.joints[-1] == scene.mechanism.joints[-1]
    assert conforms(data, SCHEMA, SCHEMA)


def test_the_carrier_is_the_frame_where_both_wheels_are_pinned_to_it_else_the_only_common_link():
    links = {"frame": {"points": {"O": [0, 0]}}, "arm": {"points": {"O": [0, 0], "P": [5, 0]}}, "sun": {"points": {"O": [0, 0]}},
             "planet": {"points": {"P": [0, 0]}}}  # fmt: skip
    joints = {"O": {"revolute": ["frame", "arm"], "drive": TURNING}, "S": {"revolute": ["arm", "sun"], "at": "O"},
             "P": {"revolute": ["arm", "planet"]}, "G": {"gear": ["sun", "planet"], "teeth": [2, 3]}}  # fmt: skip
    assert Scene.build(links=links, joints=joints).mechanism.joints[-1].carrier == "arm"
    assert made({"gear": ["a", "b"], "teeth": [2, 3]}).carrier == "frame"


def test_modes_go_to_the_joint_that_decides_them():
    def modes(**joint: Any) -> dict[str, str]:
        return dict(Scene.build(**changed(X=joint)).mechanism.modes)

    assert modes(rolling=["frame", "b"], at=["P", "B"], radius=9, side="right", branch="behind") == {"X": "behind"}
    assert modes(rolling=["frame", "b"], at=["P", "B"], radius=9, side="right") == {}, "the side of a wheel is no mode"
    assert modes(rack=["a", "bar"], slider="G", radius=9, side="right") == {}
    assert modes(pin_slot=["a", "b"], at=["A", "T"], branch="ahead") == {"X": "ahead"}
    cylinder = {"cylinder": ["frame", "b"], "at": ["P", "T"]}
    assert modes(**cylinder) == {"X": "ahead"}, "a cylinder that follows has a positive length"
    assert modes(**cylinder, side="left", drive=SWAYING) == {"X.eye": "left"}


def test_the_sides_of_a_cylinder_are_its_two_assembly_modes():
    """A boom on a cylinder: the eye lies left of the line from the boom's other pin to the cylinder's base, or right."""
    for side, sign in (("left", 1.0), ("right", -1.0)):
        b = SceneBuilder("boom", length="m").link("frame", O=(0, 0), P=(0.5, -0.3)).link("boom", O=(0, 0), Q=(0.9, 0.1))
        b.revolute("O", "frame", "boom")
        drive = {"oscillation": {"centre": 0.8, "amplitude": 0.2, "frequency": 1}}
        b.cylinder("C", "frame", "boom", at=["P", "Q"], side=side, drive=drive)
        motion = solve_motion(compile_mechanism(b.scene().mechanism), np.linspace(0.0, 1.0, 21))
        x, y = motion.point("boom", "Q").T
        assert (sign * (0.5 * y + 0.3 * x) > 0.0).all()
        np.testing.assert_allclose(np.hypot(x - 0.5, y + 0.3), motion.drives[0][0], rtol=1e-12)


def test_a_cylinder_without_a_drive_follows():
    b = SceneBuilder("boom", length="m").link("frame", O=(0, 0), P=(0.5, -0.3)).link("boom", O=(0, 0), Q=(0.9, 0.1))
    b.revolute("O", "frame", "boom", drive={"speed": 1}).cylinder("C", "frame", "boom", at=["P", "Q"])
    mechanism = b.scene().mechanism
    motion = solve_motion(compile_mechanism(mechanism), default_times(mechanism))
    away = motion.point("boom", "Q") - (0.5, -0.3)
    np.testing.assert_allclose(motion.coordinate("C")[:, 0], np.hypot(*away.T), rtol=1e-12)


def test_drives_of_joints_that_slide_are_lengths():
    for joint in (
        {"pin_slot": ["a", "b"], "at": ["A", "T"]},
        {"rolling": ["frame", "b"], "at": ["P", "B"], "radius": 9},
        {"cylinder": ["frame", "b"], "at": ["P", "T"]},
    ):
        law = Scene.build(**changed(X={**joint, "drive": SWAYING})).mechanism.drives[-1].law
        assert law(0.0)[0] == 0.7
        (fault,) = faults_of(changed(X={**joint, "drive": {"speed": "9 rpm", "start": 700, "travel": 5}}))
        assert fault.message == "'9 rpm' is an angular speed, a linear speed is wanted."


def test_the_sketch_sets_the_phase_of_a_gear():
    data = changed(X={"gear": ["a", "b"], "teeth": [20, 40]})
    data["sketch"] = {"b": {"at": [100, 0], "angle": "35 deg"}}
    del data["joints"]["S"]
    data["joints"]["C"] |= {"drive": TURNING}
    data["joints"]["D"] |= {"drive": TURNING}
    data["joints"]["G"] |= {"drive": SWAYING}
    motion = solve_motion(compile_mechanism(Scene.build(**data).mechanism), [0.0, 0.25])
    np.testing.assert_allclose(np.degrees(motion.pose("b")[:, 2]), [35.0, 35.0 - 45.0], rtol=1e-12)


def test_a_weld_between_drawn_links_keeps_the_drawn_angle():
    s = Scene.build(
        links={"frame": {"points": ["O"]}, "a": {"points": ["O", "P"]}, "b": {"points": ["P", "Q"]}},
        joints={"O": {"revolute": ["frame", "a"], "drive": TURNING}, "P": {"weld": ["a", "b"]}},
        sketch={"O": [0, 0], "P": [2, 0], "Q": [2, 3]},
    )
    assert s.mechanism.joints[-1].angle == pytest.approx(math.pi / 2)


def test_a_weld_hands_on_its_angle_to_a_sketched_link_and_holds_what_it_carries_parallel():
    links = {"frame": {"points": {"O": [0, 0]}}, "block": {"points": {"O": [0, 0], "W": [1, 0]}, "mass": 1, "centre": "W"},
             "top": {"points": {"W": [0, 0], "T": [0, 5]}, "mass": 2, "centre": "T"}}  # fmt: skip
    joints = {"O": {"prismatic": ["frame", "block"], "drive": SWAYING}, "W": {"weld": ["block", "top"], "angle": 0.5}}
    s = Scene.build(links=links, joints=joints, effects=["inertia"], sketch={"O": [0, 0], "W": [1, 0]})
    assert s.mechanism.sketch["top"] == pytest.approx((1.0, 0.0, 0.5))
    assert s.mechanism.links[2].inertia == 0.0, "it cannot turn: no moment of inertia is asked for"


def test_a_weld_puts_both_its_points_at_one_place_of_the_sketch():
    data = changed(X={"weld": ["a", "c"], "at": ["T", "C"]})
    data["links"]["c"]["points"]["Q"] = [0, 10]
    data["sketch"] = {"T": [20, 20], "Q": [10, 20]}
    assert Scene.build(**data).mechanism.sketch["c"] == pytest.approx((0.02, 0.02, math.pi / 2)), "C is where T is"


def test_a_trace_may_name_the_place_of_a_weld():
    s = Scene.build(**changed(X={"weld": ["a", "b"], "at": "T"}), trace=["T"])
    assert s.mechanism.traced == (("a", "T"),)


def test_the_builder_has_every_kind():
    b = SceneBuilder("all", length="mm", angle="deg")
    for name, link in BASE["links"].items():
        b.link(name, link["points"])
    b.revolute("A", "frame", "a", drive=TURNING).revolute("B", "frame", "b").revolute("D", "frame", "arm", at="A")
    b.revolute("C", "arm", "c").revolute("S", "arm", "a", at="A").prismatic("G", "frame", "bar")
    b.weld("X1", "a", "b", at="T", angle=3).pin_slot("X2", "a", "b", at=["A", "T"], along=[0, 1], guide="b", branch="behind")
    b.rolling("X3", "frame", "b", at=["P", "B"], radius=20, along=[0, 1], side="right", branch="ahead")
    b.gear("X4", "a", "b", teeth=[20, 30], carrier="frame", pressure_angle=25).gear("X5", "a", "b", radii=[25, 125], internal=True)
    b.belt("X6", "a", "b", radii=[20, 40], crossed=True).chain("X7", "a", "b", radii=[20, 40], carrier="frame")
    b.rack("X8", "a", "bar", slider="G", radius=40, side="right", pressure_angle=15)
    b.cylinder("X9", "frame", "b", at=["P", "T"], side="left", drive=SWAYING)
    data = changed(
        X1={"weld": ["a", "b"], "at": "T", "angle": 3},
        X2={"pin_slot": ["a", "b"], "at": ["A", "T"], "along": [0, 1], "guide": "b", "branch": "behind"},
        X3={"rolling": ["frame", "b"], "at": ["P", "B"], "radius": 20, "along": [0, 1], "side": "right", "branch": "ahead"},
        X4={"gear": ["a", "b"], "teeth": [20, 30], "carrier": "frame", "pressure_angle": 25},
        X5={"gear": ["a", "b"], "radii": [25, 125], "internal": True},
        X6={"belt": ["a", "b"], "radii": [20, 40], "crossed": True},
        X7={"chain": ["a", "b"], "radii": [20, 40], "carrier": "frame"},
        X8={"rack": ["a", "bar"], "slider": "G", "radius": 40, "side": "right", "pressure_angle": 15},
        X9={"cylinder": ["frame", "b"], "at": ["P", "T"], "side": "left", "drive": SWAYING},
    )
    assert b.scene() == Scene.build(**data)


# --- faults -------------------------------------------------------------------------------------------------------------

FAULTS = [
    # the joint, path of the fault behind the joint's, what it says, how to mend it
    ({"gear": ["a", "b"]}, "", "the gear pair has none of teeth or radii.", "Give one"),
    ({"gear": ["a", "b"], "teeth": [20, 30], "radii": [40, 60]}, "", "teeth and radii at once.", "Keep one"),
    ({"gear": ["a", "b"], "teeth": [20]}, ".teeth", "has 1 entry.", "at least 2"),
    ({"gear": ["a", "b"], "teeth": [20, 30, 40]}, ".teeth", "has 3 entries.", "at most 2"),
    ({"gear": ["a", "b"], "teeth": [20, 0]}, ".teeth[1]", "0 is too small.", "at least 1"),
    ({"gear": ["a", "b"], "teeth": [20, 30.5]}, ".teeth[1]", "30.5 where a whole number is wanted.", "360"),
    ({"gear": ["a", "b"], "teeth": "20:30"}, ".teeth", "'20:30' where a list is wanted.", "brackets"),
    ({"gear": ["a", "b"], "radii": [40, -60]}, ".radii[1]", "-60 is negative.", "positive"),
    ({"gear": ["a", "b"], "radii": [40, "6 kg"]}, ".radii[1]", "'6 kg' is a mass, a length is wanted.", "'80 mm'"),
    ({"gear": ["a", "b"], "radii": [40, 50]}, ".radii", "their sum is 90 mm, but the axes are 100 mm apart.", "give teeth"),
    ({"gear": ["a", "b"], "radii": [40, 150], "internal": True}, ".radii", "their difference is 110 mm", "Change the radii"),
    ({"gear": ["a", "b"], "teeth": [60, 20], "internal": True}, ".teeth", "the ring is not larger", "pinion first"),
    ({"gear": ["a", "b"], "teeth": [2, 3], "carrier": "armm"}, ".carrier", "there is no link 'armm'.", "Did you mean 'arm'?"),
    ({"gear": ["a", "b"], "teeth": [2, 3], "carrier": "a"}, ".carrier", "'a' is one of the wheels.", "both wheels are pinned"),
    (
        {"gear": ["a", "b"], "teeth": [2, 3], "carrier": "arm"},
        ".carrier",
        "'b' is not pinned to 'arm', which is to carry it. It is pinned to 'frame'.",
        '["arm", "b"]',
    ),
    (
        {"gear": ["b", "c"], "teeth": [2, 3]},
        "",
        "no link carries both wheels: a pin joins 'b' to 'frame'; 'c' to 'arm'.",
        "Pin both",
    ),
    ({"gear": ["a", "d"], "teeth": [2, 3]}, ".gear[1]", "there is no link 'd'.", "Links"),
    ({"gear": ["a", "a"], "teeth": [2, 3]}, ".gear", "joins 'a' to itself.", "two different"),
    ({"gear": ["a"], "teeth": [2, 3]}, ".gear", "names 1 link, a joint joins two.", '["frame", "crank"]'),
    ({"gear": ["a", "b", "c"], "teeth": [2, 3]}, ".gear", "names 3 links, a joint joins two.", '["frame", "crank"]'),
    ({"gear": ["a", "b"], "teeth": [2, 3], "pressure_angle": 60}, ".pressure_angle", "60° is no pressure angle", "20 deg"),
    ({"gear": ["a", "b"], "teeth": [2, 3], "pressure_angle": -5}, ".pressure_angle", "-5° is no pressure angle", "20 deg"),
    ({"gear": ["a", "b"], "teeth": [2, 3], "at": "A"}, ".at", "at does not go with a gear pair.", "pins that hold"),
    ({"gear": ["a", "b"], "teeth": [2, 3], "side": "left"}, ".side", "side does not go with a gear pair.", "Leave it out."),
    ({"gear": ["a", "b"], "teeth": [2, 3], "branch": "ahead"}, ".branch", "branch does not go with a gear", "Leave it out."),
    ({"gear": ["a", "b"], "teeth": [2, 3], "drive": TURNING}, ".drive", "drive does not go with a gear", "one of its wheels"),
    ({"gear": ["a", "b"], "radius": 40, "teeth": [2, 3]}, ".radius", "radius does not go with a gear", "radii = [first, second]"),
    ({"gear": ["a", "b"], "tooth": [2, 3]}, "", "unknown key 'tooth'.", "Did you mean 'teeth'?"),
    ({"gaer": ["a", "b"], "teeth": [2, 3]}, "", "unknown key 'gaer'.", "Did you mean 'gear'?"),
    ({"gear": ["a", "b"], "teeth": [2, 3], "internal": 1}, ".internal", "1 where true or false is wanted.", ""),
    ({"belt": ["a", "b"]}, "", "'radii' is missing.", "Add radii"),
    ({"belt": ["a", "b"], "teeth": [20, 30], "radii": [5, 5]}, ".teeth", "teeth does not go with a belt.", "radii"),
    ({"belt": ["a", "b"], "radii": [0, 5]}, ".radii[0]", "0 is zero.", "positive"),
    ({"belt": ["b", "c"], "radii": [5, 5]}, "", "no link carries both wheels", "Pin both"),
    ({"belt": ["a", "b"], "radii": [5, 5], "drive": TURNING}, ".drive", "drive does not go with a belt.", "one of its wheels"),
    ({"chain": ["a", "b"], "radii": [5, 5], "crossed": True}, ".crossed", "crossed does not go with a chain.", "do not cross"),
    ({"chain": ["a", "b"], "teeth": [9, 9]}, ".teeth", "teeth does not go with a chain.", "sprockets"),
    ({"rack": ["a", "bar"], "radius": 40}, "", "'slider' is missing.", "prismatic joint"),
    ({"rack": ["a", "bar"], "slider": "G"}, "", "'radius' is missing.", "Add radius"),
    ({"rack": ["a", "bar"], "slider": "H", "radius": 40}, ".slider", "there is no joint 'H'.", "'G'"),
    ({"rack": ["a", "bar"], "slider": "B", "radius": 40}, ".slider", "'B' is no prismatic joint of 'bar'", "'G'"),
    ({"rack": ["c", "bar"], "slider": "G", "radius": 40}, "", "'c' is not pinned to 'frame'", "Add a joint"),
    ({"rack": ["a", "bar"], "slider": "G", "radius": -4}, ".radius", "-4 is negative.", "positive"),
    ({"rack": ["a", "bar"], "slider": "G", "radii": [4, 5], "radius": 4}, ".radii", "radii does not go with a rack.", "pinion"),
    ({"rack": ["a", "bar"], "slider": "G", "radius": 4, "drive": TURNING}, ".drive", "drive does not go with a rack.", "pinion's"),
    ({"rack": ["a", "bar"], "slider": "G", "radius": 4, "side": "lef"}, ".side", "'lef' is not one of", "Did you mean 'left'?"),
    ({"rolling": ["frame", "b"], "at": ["P", "B"]}, "", "'radius' is missing.", "Add radius"),
    ({"rolling": ["frame", "b"], "at": ["P", "Q"], "radius": 5}, ".at[1]", "link 'b' has no point 'Q'.", "'B', 'T'"),
    ({"rolling": ["frame", "b"], "at": ["P", "B"], "radius": 5, "guide": "b"}, ".guide", "guide does not go", "named first"),
    ({"rolling": ["frame", "b"], "at": ["P", "B"], "radius": 5, "along": ["A", "Z"]}, ".along[1]", "no point 'Z'", "'A', 'B'"),
    ({"rolling": ["frame", "b"], "at": ["P", "B"], "radius": 5, "assembly": "open"}, ".assembly", "does not go", "branch"),
    (
        {"rolling": ["frame", "b"], "at": ["P", "B"], "radius": 5, "branch": "ahead", "drive": SWAYING},
        ".branch",
        "branch on a driven joint",
        "Leave out branch.",
    ),
    ({"pin_slot": ["a", "b"], "at": ["A", "T"], "side": "left"}, ".side", "does not go with a pin in a slot.", "branch = 'ahead'"),
    ({"pin_slot": ["a", "b"], "at": ["A", "T"], "angle": 5}, ".angle", "angle does not go with a pin in a slot.", "Leave it out."),
    ({"pin_slot": ["a", "b"], "at": ["A", "T"], "guide": "c"}, ".guide", "'c' is not one of the two links.", "'a', 'b'"),
    ({"weld": ["a", "b"]}, "", "link 'a' has no point 'X'.", "Add the point"),
    ({"weld": ["a", "b"], "at": "T", "drive": TURNING}, ".drive", "drive does not go with a weld.", "does not move"),
    ({"weld": ["a", "b"], "at": "T", "along": [1, 0]}, ".along", "along does not go with a weld.", "Leave it out."),
    ({"weld": ["a", "b"], "at": "T", "angle": "5 mm"}, ".angle", "'5 mm' is a length, an angle is wanted.", "'30 deg'"),
    ({"cylinder": ["frame", "b"], "at": ["P", "T"], "branch": "ahead"}, ".branch", "branch does not go", "side = 'left'"),
    (
        {"cylinder": ["frame", "b"], "at": ["P", "T"], "drive": {"oscillation": {"amplitude": 5, "frequency": 1}}},
        ".drive",
        "the cylinder's length starts at 0 mm.",
        "distance of its two points",
    ),
]


@pytest.mark.parametrize(("joint", "path", "message", "remedy"), FAULTS)
def test_a_fault_of_a_joint_has_path_message_and_remedy(joint, path, message, remedy):
    result = [fault for fault in faults_of(changed(X=joint)) if fault.path == f"joints.X{path}" and message in fault.message]
    assert len(result) == 1, faults_of(changed(X=joint))
    assert remedy in result[0].remedy
    assert result[0].message[-1] in ".?"


@pytest.mark.parametrize(
    ("joint", "names"),
    [
        ({"gear": ["a", "b"], "teeth": [20, -3]}, 1),
        ({"gear": ["a", "b"], "radii": [40, -60]}, 1),
        ({"gear": ["a", "b"], "teeth": [2, 3], "carrier": "arn"}, 1),
        ({"belt": ["a", "bb"], "radii": [5, 5]}, 1),
        ({"rack": ["a", "bar"], "slider": "G", "radius": "40 kg"}, 1),
        ({"rolling": ["frame", "b"], "at": ["P", "B"], "radius": 0}, 1),
        ({"gear": ["a", "bb"], "teeth": [20, -3]}, 2),  # two slips
        ({"rack": ["aa", "bar"], "slider": "G", "radius": -1}, 2),
    ],
)
def test_one_slip_is_one_fault(joint, names):
    assert len(faults_of(changed(X=joint))) == names


def test_faults_of_new_joints_come_with_all_others_in_the_order_of_the_file():
    data = changed(
        X={"gear": ["a", "b"], "radii": [40, 50]},
        Y={"belt": ["b", "c"], "radii": [5, 5]},
        Z={"rack": ["a", "bar"], "slider": "H", "radius": 40, "pressure_angle": 50},
    )
    data["links"]["a"]["mass"] = -1
    data["trace"] = ["nowhere"]
    assert {f.path for f in faults_of(data)} == {
        "links.a.mass", "joints.X.radii", "joints.Y", "joints.Z.slider", "joints.Z.pressure_angle", "trace[0]",
    }  # fmt: skip
    assert [f.path for f in faults_of(data)][1:5] == ["joints.X.radii", "joints.Y", "joints.Z.slider", "joints.Z.pressure_angle"]


def test_gears_do_not_hold_a_link():
    data = changed(X={"gear": ["a", "d"], "teeth": [2, 3], "carrier": "frame"})
    data["links"]["d"] = {"points": {"P": [0, 0]}}
    assert ("links.d", "no chain of joints joins it to 'frame'.") in [(f.path, f.message) for f in faults_of(data)]


def test_parts_of_a_cylinder_need_their_names():
    data = changed(X={"cylinder": ["frame", "b"], "at": ["P", "T"], "drive": SWAYING})
    data["links"]["X.rod"] = {"points": {"P": [0, 0]}}
    data["joints"]["X.eye"] = {"revolute": ["frame", "X.rod"], "at": "P"}
    assert [(f.path, f.remedy) for f in faults_of(data)] == [
        ("links.X.rod", "Rename the link or the cylinder."),
        ("joints.X.eye", "Rename the joint or the cylinder."),
    ]


def test_two_links_that_could_both_carry_a_gear_joint_are_named():
    data = changed(X={"gear": ["a", "b"], "teeth": [2, 3]}, Q={"revolute": ["arm", "b"], "at": ["C", "B"]})
    data["joints"]["A"] = {"revolute": ["c", "a"], "at": ["C", "A"], "drive": TURNING}
    data["joints"]["B"] = {"revolute": ["c", "b"], "at": ["C", "B"]}
    result = [f for f in faults_of(data) if f.path == "joints.X"]
    assert [f.message for f in result] == ["'a' and 'b' are both pinned to 'arm', 'c'."] or result[0].message.endswith(
        "'c', 'arm'."
    )
    assert "carrier" in result[0].remedy


def test_belts_that_do_not_fit_are_refused_by_the_core():
    scene = Scene.build(**changed(X={"belt": ["a", "b"], "radii": [20, 90], "crossed": True}))
    with pytest.raises(MechanismError, match=r"joints\.X: pulleys .* do not fit"):
        compile_mechanism(scene.mechanism)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("teeth", [20]),
        ("teeth", [20, 0]),
        ("teeth", [20.5, 3]),
        ("radii", [-1, 2]),
        ("carrier", 5),
        ("internal", "yes"),
        ("side", "up"),
    ],
)
def test_the_json_schema_refuses_what_the_reader_refuses(key, value):
    data = changed(X={"gear": ["a", "b"], key: value})
    assert not conforms(data, SCHEMA, SCHEMA)
    assert faults_of(data)


def test_a_wheel_on_the_shaft_of_another_link_is_carried_too():
    links = {"frame": {"points": {"O": [0, 0], "B": [100, 0]}}, "arm": {"points": {"O": [0, 0], "P": [50, 0]}},
             "sun": {"points": {"C": [0, 0]}}, "b": {"points": {"B": [0, 0]}}}  # fmt: skip
    joints = {"O": {"revolute": ["frame", "arm"], "drive": TURNING},
             "S": {"revolute": ["arm", "sun"], "at": ["O", "C"], "drive": TURNING},
             "B": {"revolute": ["frame", "b"]}, "G": {"gear": ["sun", "b"], "teeth": [20, 30]}}  # fmt: skip
    scene = Scene.build(units={"length": "mm", "angle": "deg"}, links=links, joints=joints)
    assert scene.mechanism.joints[-1].carrier == "frame"
    motion = solve_motion(compile_mechanism(scene.mechanism), [0.0, 0.1])
    np.testing.assert_allclose(motion.velocity("b")[:, 2], -2.0 / 3.0 * motion.velocity("sun")[:, 2])
    joints["S"] = {"revolute": ["arm", "sun"], "at": ["P", "C"], "drive": TURNING}  # beside the axis
    with pytest.raises(SceneError, match="no link carries both wheels"):
        Scene.build(units={"length": "mm", "angle": "deg"}, links=links, joints=joints)


@pytest.mark.parametrize(("radii", "crossed"), [([150, 40], False), ([60, 40], True)])
def test_belts_that_do_not_fit_are_refused_when_the_scene_is_checked(radii, crossed, tmp_path, capsys):
    from mechviz.commands.main import app

    path = tmp_path / "scene.toml"
    path.write_text(
        f"""units = {{ length = "mm", angle = "deg" }}
[links]
frame = {{ points = {{ A = [0, 0], B = [100, 0] }} }}
a = {{ points = {{ A = [0, 0] }} }}
b = {{ points = {{ B = [0, 0] }} }}
[joints]
A = {{ revolute = ["frame", "a"], drive = {{ speed = "10 rpm" }} }}
B = {{ revolute = ["frame", "b"] }}
V = {{ belt = ["a", "b"], radii = {radii}, crossed = {str(crossed).lower()} }}
"""
    )
    with pytest.raises(SystemExit) as stopped:
        app(["check", str(path)])
    assert stopped.value.code == 2
    said = "".join(capsys.readouterr())
    assert "joints.V" in said and f"radius {radii[0]} mm and {radii[1]} mm do not fit on axes 100 mm apart" in said


def _with_screw(**more: Any) -> dict[str, Any]:
    links = {"frame": {"points": {"O": [0, 0]}}, "table": {"points": {"T": [0, 0]}}}
    screw = {"screw": ["frame", "table"], "at": ["O", "T"], "lead": 5, "drive": {"speed": "60 rpm"}}
    joint = {key: value for key, value in {**screw, **more}.items() if value is not None}
    return {"units": BASE["units"], "links": links, "joints": {"S": joint}}


def test_a_screw_turns_its_values_into_si():
    scene = Scene.build(
        **_with_screw(along=[0, 2], guide="table", friction={"coefficient": 0.1, "radius": 9}), effects=["friction"]
    )
    (joint,) = scene.mechanism.joints
    assert joint == Screw(
        name="S", links=("frame", "table"), points=("O", "T"), lead=0.005, along=(0.0, 2.0), guide=1,
        friction=Friction(coefficient=0.1, radius=0.009),
    )  # fmt: skip
    assert scene.mechanism.drives[0].law(1.0)[1] == pytest.approx(2.0 * math.pi)


@pytest.mark.parametrize(
    ("more", "path", "said"),
    [
        ({"lead": None}, "joints.S", "'lead' is missing"),
        ({"lead": -5}, "joints.S.lead", "is negative"),
        ({"length": 50}, "joints.S.length", "Give stops"),
        ({"friction": {"coefficient": 0.1}}, "joints.S.friction", "mean radius"),
        ({"friction": {"coefficient": 0.1, "radius": 9, "brake": "2 N m"}}, "joints.S.friction", "does not go with"),
    ],
)
def test_faults_of_screws_name_the_remedy(more, path, said):
    with pytest.raises(SceneError) as error:
        Scene.build(**_with_screw(**more), effects=["friction"])
    (fault,) = [f for f in error.value.faults if f.path == path]
    assert said in f"{fault.message} {fault.remedy}"


def test_a_fixed_link_of_another_name_asks_no_slider_for_a_moment_of_inertia():
    """Whether a link can turn is open while the fixed one is not known."""
    links = {"ground": {"points": {"O": [0, 0], "G": [0, 9]}}, "crank": {"points": {"O": [0, 0], "P": [5, 0]}, "mass": 1,
             "centre": "O"}, "block": {"points": {"G": [0, 0], "P": [0, 5]}, "mass": 1, "centre": "G"}}  # fmt: skip
    joints = {"O": {"revolute": ["frame", "crank"], "drive": SWAYING}, "G": {"prismatic": ["frame", "block"]},
              "P": {"revolute": ["crank", "block"]}}  # fmt: skip
    with pytest.raises(SceneError) as error:
        Scene.build(links=links, joints=joints, effects=["inertia"])
    text = str(error.value)
    assert "there is no link 'frame' to be the fixed one" in text and "block: has a mass but" not in text, text
