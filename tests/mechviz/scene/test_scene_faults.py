"""Faults of scenes: every kind has its path, names the value and the remedy; all faults of a file come at once, in its order."""

from __future__ import annotations

import contextlib
import itertools
import re
import sys
from pathlib import Path
from typing import Any

import pytest
from faulty_scenes import BASE, REMOVED, changed, faults_of

from mechcore.errors import Fault, MechanismError
from mechviz.scene.faults import SceneError
from mechviz.scene.reading import recovery as lenient
from mechviz.scene.reading.text import LARGEST_FILE
from mechviz.scene.scene import Scene, load, loads


def test_the_sound_scene_is_sound():
    assert Scene.build(**BASE).mechanism.frame == "frame"


DRIVE = "joints/A/drive"
TABLE = "loads/M/table"
CASES = [
    # where, value, path of the fault, what it says, how to mend it
    ("links/rocker/mas", 1, "links.rocker", "unknown key 'mas'.", "Did you mean 'mass'?"),
    ("links/rocker/hue", "red", "links.rocker", "unknown key 'hue'.", "'points', 'mass', 'centre'"),
    ("links/crank/mass", -0.4, "links.crank.mass", "-0.4 is negative.", "positive"),
    ("links/crank/inertia", "-1 kg m^2", "links.crank.inertia", "'-1 kg m^2' is negative.", "positive"),
    ("links/crank/mass", "60 mm", "links.crank.mass", "'60 mm' is a length, a mass is wanted.", "'0.4 kg'"),
    ("links/crank/mass", True, "links.crank.mass", "true where a mass is wanted.", "'0.4 kg'"),
    ("links/crank/mass", "heavy", "links.crank.mass", "'heavy' is not a number with a unit.", "number"),
    ("links/crank/mass", "1,5 kg", "links.crank.mass", "'1,5 kg' is not a number with a unit.", "decimal point"),
    ("links/crank/mass", "5", "links.crank.mass", "'5' has no unit.", "Write 5 without quotes"),
    ("links/crank/mass", "5 kgg", "links.crank.mass", "unknown unit 'kgg'", "Did you mean 'kg'?"),
    ("links/crank/mass", float("nan"), "links.crank.mass", "nan is not a finite number.", "finite"),
    ("links/crank/mass", 10**400, "links.crank.mass", "is not a finite number.", "finite"),
    ("links/crank/mass", "1e999 kg", "links.crank.mass", "is not a finite number.", "finite"),
    ("links/crank/points/B", [1e40, 0], "links.crank.points.B[0]", "1e+37 m is beyond 1e+30.", "its unit"),
    (f"{DRIVE}/speed", "1e-99 rpm", "joints.A.drive.speed", "is below 1e-30.", "its unit"),
    (DRIVE, {"speed": 1, "zones": {"run_up": 1e-99}}, "joints.A.drive.zones.run_up", "is too short a way.", "its unit"),
    ("links/crank/points/B", [60], "links.crank.points.B", "[60] has 1 entry, two are wanted.", "[x, y]"),
    ("links/crank/points/B", [60, 0, 0], "links.crank.points.B", "has 3 entries, two are wanted.", "[x, y]"),
    ("links/crank/points/B", 60, "links.crank.points.B", "60 where a pair of numbers is wanted.", "[x, y]"),
    ("links/crank/points/B", ["6 kg", 0], "links.crank.points.B[0]", "'6 kg' is a mass, a length is wanted.", "'80 mm'"),
    ("links/crank/points/B", [float("inf"), 0], "links.crank.points.B[0]", "inf is not a finite number.", "finite"),
    ("links/crank/points", 5, "links.crank.points", "5 where points are wanted.", "{ A = [0, 0]"),
    ("links/crank/points", {}, "links.crank.points", "is empty.", "at least 1"),
    ("links/crank/points", ["A", "A", "B"], "links.crank.points", "a point is listed twice.", "once"),
    ("links/crank/centre", "Z", "links.crank.centre", "link 'crank' has no point 'Z'.", "Points: 'A', 'B'."),
    ("links/crank/shape", "disc", "links.crank.shape", "'disc' is not one of 'bar', 'point'.", "one of these"),
    ("links/rocker/shape", "bar", "links.rocker.shape", "shape = 'bar' without a mass.", "Add mass"),
    ("links/crank", 5, "links.crank", "5 where a table is wanted.", "braces"),
    ("links/__x", {"points": {"P": [0, 0]}}, "links.__x", "two underscores", "Write 'x'."),
    ("links/a b ", {"points": {"P": [0, 0]}}, "links.a b ", "begins or ends with a space", "Write 'a b'."),
    ("links/a\\b", {"points": {"P": [0, 0]}}, "links.a\\b", "which breaks paths", "Write 'a_b'."),
    ("links/<a\\b>", {"points": {"P": [0, 0]}}, "links.<a\\b>", "which breaks paths", "Write '<a_b>'."),
    ("links/a\tb", {"points": {"P": [0, 0]}}, "links.a\tb", "which breaks paths", "Write 'a_b'."),
    ("links/a😀", {"points": {"P": [0, 0]}}, "links.a😀", "which recordings cannot keep as it is", "letters of any language"),
    ("links/e\u0301", {"points": {"P": [0, 0]}}, "links.e\u0301", "which recordings cannot keep as it is", "letters of any"),
    ("links/..", {"points": {"P": [0, 0]}}, "links...", "means a folder", "letters"),
    ("links/" + "a" * 101, {"points": {"P": [0, 0]}}, "links." + "a" * 101, "a name of 101 characters.", "100"),
    ("links/spare", {"points": {"P": [0, 0]}}, "links.spare", "no chain of joints joins it to 'frame'.", "Add the joint"),
    ("frame", "Frame", "frame", "there is no link 'Frame' to be the fixed one.", "Did you mean 'frame'?"),
    ("joints/B/revolute", ["crank", "copler"], "joints.B.revolute[1]", "there is no link 'copler'.", "mean 'coupler'?"),
    ("joints/B/revolute", ["crank"], "joints.B.revolute", "names 1 link, a joint joins two.", '["frame", "crank"]'),
    ("joints/B/revolute", ["a", "b", "c"], "joints.B.revolute", "names 3 links, a joint joins two.", '2 joints with at = "B"'),
    ("joints/B/revolute", ["crank", "crank"], "joints.B.revolute", "joins 'crank' to itself.", "two different"),
    ("joints/B/revolute", "crank", "joints.B.revolute", "'crank' where a list is wanted.", "brackets"),
    ("joints/B/revolute", ["crank", 5], "joints.B.revolute[1]", "5 where a text is wanted.", "quotes"),
    ("joints/B", {}, "joints.B", "has none of revolute, prismatic, weld", "Give one"),
    ("joints/B/prismatic", ["crank", "coupler"], "joints.B", "revolute and prismatic at once.", "Keep one"),
    ("loads/P/force", ["3 lbs", 0], "loads.P.force[0]", "'3 lbs' is a mass, a force is wanted.", "of force are lbf and kgf."),
    ("units/force", "kg", "units.force", "'kg' is the unit of a mass, a force is wanted.", "Write it like 'N'; pounds"),
    ("joints/B/friction", 0.1, "joints.B.friction", "0.1 where a table is wanted.", "such as { coefficient = ... }."),
    ("loads/P/force", ["\u22122 kN", 0], "loads.P.force[0]", "is not a number with a unit.", "as a hyphen, '-'."),
    ("joints/B/at", "Q", "joints.B.at", "link 'crank' has no point 'Q'.", "Points of 'crank': 'A', 'B'."),
    ("joints/B/at", ["B", "F"], "joints.B.at[1]", "link 'coupler' has no point 'F'.", "'B', 'C', 'E'"),
    ("joints/B/along", [1, 0], "joints.B.along", "along does not go with a revolute joint.", "Leave it out."),
    ("joints/C/side", "lefft", "joints.C.side", "'lefft' is not one of 'left', 'right'.", "Did you mean 'left'?"),
    ("joints/C/side", 5, "joints.C.side", "5 is not one of 'left', 'right'.", "one of these"),
    ("joints/C/assembly", "open", "joints.C.assembly", "side and assembly at once", "Keep one"),
    ("joints/A/side", "left", "joints.A.side", "side on a driven joint", "Leave out side."),
    (DRIVE, {}, "joints.A.drive", "the drive has no law of motion.", "speed, oscillation"),
    (f"{DRIVE}/oscillation", {"amplitude": 1, "period": 1}, "joints.A.drive", "speed and oscillation at once.", "Keep one"),
    (DRIVE, {"speed": 0, "range": [0, 1]}, "joints.A.drive.range", "a drive that stands still", "start = "),
    (f"{DRIVE}/speed", "1 Hz", "joints.A.drive.speed", "a frequency, an angular speed is wanted.", "rpm"),
    (f"{DRIVE}/speed", "20 mm/s", "joints.A.drive.speed", "is a linear speed, an angular speed is wanted.", "'60 rpm'"),
    (f"{DRIVE}/start", [1, 2], "joints.A.drive.start", "only segments and programs start with a velocity", "position alone"),
    (f"{DRIVE}/start", "5 mm", "joints.A.drive.start", "'5 mm' is a length, an angle is wanted.", "'30 deg'"),
    (f"{DRIVE}/travel", -1, "joints.A.drive.travel", "-1 is negative.", "positive"),
    (f"{DRIVE}/range", [1], "joints.A.drive.range", "has 1 entry.", "at least 2"),
    (f"{DRIVE}/range", [60, -60], "joints.A.drive.range", "the first value is not the smaller one.", "[least, greatest]"),
    (DRIVE, {"speed": 1, "range": [0, 1], "start": 0}, "joints.A.drive.range", "range says both", "Keep one"),
    (DRIVE, {"zones": {"steady": 1}}, "joints.A.drive", "zones without a speed.", "steady speed"),
    (DRIVE, {"speed": 1, "zones": {}}, "joints.A.drive.zones", "all zones have the range zero", "run_up"),
    (DRIVE, {"speed": 1, "zones": {"steady": -5}}, "joints.A.drive.zones.steady", "-5 is negative.", "positive"),
    (DRIVE, {"speed": 1, "zones": {"steady": 5}, "travel": 9}, "joints.A.drive.travel", "does not go with zones", "Leave out"),
    (DRIVE, {"oscillation": {"amplitude": 1}}, "joints.A.drive.oscillation", "none of frequency or period.", "Give one"),
    (
        DRIVE,
        {"oscillation": {"amplitude": 1, "frequency": -2}},
        "joints.A.drive.oscillation.frequency",
        "-2 is negative.",
        "positive",
    ),
    (DRIVE, {"segments": []}, "joints.A.drive.segments", "is empty.", "at least 1"),
    (DRIVE, {"segments": [{"to": 5}]}, "joints.A.drive.segments[0]", "'duration' is missing.", "Add duration"),
    (
        DRIVE,
        {"segments": [{"duration": -1, "to": 5}]},
        "joints.A.drive.segments[0].duration",
        "-1 is negative.",
        "positive",
    ),
    (
        DRIVE,
        {"segments": [{"duration": 1, "to": [5, "3 mm/s"]}]},
        "joints.A.drive.segments[0].to[1]",
        "'3 mm/s' is a linear speed, an angular speed is wanted.",
        "'60 rpm'",
    ),
    (DRIVE, {"table": {"time": [0, 1], "position": [0]}}, "joints.A.drive.table.position", "has 1 entry.", "at least 2"),
    (DRIVE, {"table": {"time": [0, 1, 2], "position": [0, 1]}}, "joints.A.drive.table", "3 times and 2 positions.", "one position"),
    (
        DRIVE,
        {"table": {"time": [0, 2, 1], "position": [0, 1, 2]}},
        "joints.A.drive.table.time[2]",
        "does not grow",
        "increasing order",
    ),
    (
        DRIVE,
        {"table": {"time": [0, 1, 2], "position": [0, 1, 0], "periodic": True}},
        "joints.A.drive.table",
        "a periodic table of 3 rows.",
        "four",
    ),
    (
        DRIVE,
        {"table": {"time": [0, 1], "position": [0, 1], "periodic": 1}},
        "joints.A.drive.table.periodic",
        "1 where true or false is wanted.",
        "",
    ),
    ("trace", ["Z"], "trace[0]", "no link has a point 'Z'.", "Points: 'A', 'D', 'B', 'C', 'E'."),
    ("trace", ["coupler.F"], "trace[0]", "link 'coupler' has no point 'F'.", "'B', 'C', 'E'"),
    ("trace", ["E", "E"], "trace[1]", "'E' is traced twice.", "once"),
    ("trace", "E", "trace", "'E' where a list is wanted.", "brackets"),
    ("effects", ["inertai"], "effects[0]", "'inertai' is not one of 'inertia', 'gravity', 'friction'.", "Did you mean 'inertia'?"),
    ("run", {"frames": 1}, "run.frames", "1 is too small.", "at least 2"),
    ("run", {"frames": True}, "run.frames", "true where a whole number is wanted.", "360"),
    ("run", {"cycles": 1.5}, "run.cycles", "1.5 where a whole number is wanted.", ""),
    ("units/length", "kg", "units.length", "'kg' is the unit of a mass, a length is wanted.", "'mm'"),
    ("units/angle", "degre", "units.angle", "unknown unit 'degre'.", "Did you mean 'deg'?"),
    ("units/length", "nan", "units.length", "unknown unit 'nan'.", ""),
    ("links/crank/mass", "5 kg nan", "links.crank.mass", "unknown unit 'nan'.", ""),
    ("joints/C/side", "\ud800", "joints.C.side", "a text that files can hold is wanted.", "surrogates"),
    ("units/colour", "red", "units", "unknown key 'colour'.", "'length', 'angle'"),
    ("gravity", [0], "gravity", "[0] has 1 entry, two are wanted.", "[x, y]"),
    ("title", 5, "title", "5 where a text is wanted.", "quotes"),
    ("title", "a\x1b[2Jb", "title", "a text with the character '\\x1b', which drawings", "Leave it out."),
    ("title", "a\uffff", "title", "a text with the character '\\uffff', which drawings", "Leave it out."),
    ("loads/P/on", "roker", "loads.P.on", "there is no link 'roker'.", "Did you mean 'rocker'?"),
    ("loads/P/on", "frame", "loads.P.on", "'frame' is the fixed link", "moving link"),
    ("loads/P/on", REMOVED, "loads.P", "'on' is missing.", "Add on"),
    ("loads/P/at", "Q", "loads.P.at", "link 'rocker' has no point 'Q'.", "'D', 'C'"),
    ("loads/P/at", REMOVED, "loads.P", "'at' is missing", "Points of 'rocker': 'D', 'C'."),
    ("loads/P/axes", "global", "loads.P.axes", "'global' is not one of 'world', 'link'.", "one of these"),
    ("loads/P/torque", 5, "loads.P", "the load has force and torque at once.", "Keep one"),
    ("loads/P/force", REMOVED, "loads.P", "the load has none of force, torque, actuator, spring,", "Give one"),
    ("loads/P/force", [1, "5 N m"], "loads.P.force[1]", "'5 N m' is a torque, a force is wanted.", "'150 N'"),
    ("loads/M/at", "B", "loads.M.at", "at does not go with a torque", "Leave out at."),
    ("loads/M/torque", "5 Nm", "loads.M.torque", "unknown unit 'Nm'", "'N m'"),
    (TABLE, {"position": [0, 1], "factor": [1]}, "loads.M.table.factor", "has 1 entry.", "at least 2"),
    (TABLE, {"position": [0, 1], "factor": [1, 2, 3]}, "loads.M.table", "2 positions and 3 factors.", "one factor"),
    (TABLE, {"position": [0, 0], "factor": [1, 2]}, "loads.M.table.position[1]", "does not grow", "increasing order"),
    (
        TABLE,
        {"position": [0, 90], "factor": [1, 2], "period": 60},
        "loads.M.table.period",
        "shorter than the range",
        "longer",
    ),
    (
        TABLE,
        {"position": [0, 90, 360], "factor": [1, 2, 3], "period": 360},
        "loads.M.table.factor[2]",
        "differs from the first factor, 1",
        "same factor",
    ),
    (TABLE, {"position": [0, 1], "factor": [1, 2], "drive": "B"}, "loads.M.table.drive", "joint 'B' has no drive.", "'A'"),
    (TABLE, {"position": [0, 1], "factor": [1, 2], "drive": "Z"}, "loads.M.table.drive", "there is no joint 'Z'.", "'A'"),
    ("sketch", {"Z": [0, 0]}, "sketch.Z", "no link has a point 'Z'.", "Points"),
    ("sketch", {"crank": [0, 0]}, "sketch.crank", "no link has a point 'crank'.", "{ at = [x, y], angle = ... }"),
    ("sketch", {"crnk": {"at": [0, 0]}}, "sketch.crnk", "there is no link 'crnk'.", "Did you mean 'crank'?"),
    ("sketch", {"frame": {"at": [0, 0]}}, "sketch.frame", "the fixed link has its place already", "Leave it out."),
    ("sketch", {"A": [5, 0]}, "sketch.A", "is not where links.frame has this point.", "Leave it out"),
    ("sketch", {"B": [5]}, "sketch.B", "[5] has 1 entry, two are wanted.", "[x, y]"),
]


@pytest.mark.parametrize(
    ("where", "value", "path", "message", "remedy"),
    CASES,
    ids=lambda value: value if isinstance(value, str) and len(value) < 40 else "",
)
def test_a_fault_has_path_message_and_remedy(where, value, path, message, remedy):
    faults = faults_of(changed((where, value)))
    first = next((fault for fault in faults if fault.path == path), None)
    assert first is not None, faults
    assert message in first.message
    assert remedy in first.remedy
    assert first.message[-1] in ".?"


# --- faults that need more than one change to show --------------------------------------------------------------------

COMBINED = [
    ([("effects", ["inertia"])], "links.crank", "has a mass but no centre, which 'inertia' needs.", 'shape = "bar"'),
    ([("effects", ["inertia"])], "links.crank", "no moment of inertia, which 'inertia' needs.", '"bar" or "point"'),
    ([("effects", ["gravity"])], "links.crank", "has a mass but no centre, which 'gravity' needs.", "the name of a point"),
    ([("effects", ["inertia", "gravity"])], "links.crank", "no centre, which 'inertia' and 'gravity' need.", "centre = [x, y]"),
    (
        [("effects", ["gravity"]), ("links/crank/mass", REMOVED)],
        "effects",
        "gravity: no link has a mass that could act.",
        "leave out the effects",
    ),
    (
        [("effects", ["gravity", "gravity"]), ("links/crank/centre", [0, 0])],
        "effects[1]",
        "'gravity' is listed twice.",
        "once",
    ),
    (
        [("links/crank/shape", "bar"), ("links/crank/centre", [0, 0])],
        "links.crank.centre",
        "stands beside shape = 'bar', which decides the centre.",
        "Leave out shape or centre.",
    ),
    (
        [("links/crank/points", {"P": [0, 0]}), ("links/crank/shape", "bar")],
        "links.crank.shape",
        "a bar needs two points, this link has one.",
        "'point'",
    ),
    (
        [("run", {"cycles": 2}), (DRIVE, {"table": {"time": [0, 1], "position": [0, 1]}})],
        "run.cycles",
        "2 cycles of a table that does not repeat.",
        "periodic = true",
    ),
    (
        [("run", {"cycles": 2}), (DRIVE, {"segments": [{"duration": 1, "to": [9, 5]}]})],
        "run.cycles",
        "2 cycles would make the speed jump",
        "cycles = 1",
    ),
    (
        [("run", {"cycles": 2}), (DRIVE, {"speed": 1, "zones": {"run_up": 9}})],
        "run.cycles",
        "2 cycles would make the speed jump",
        "run_up and braking",
    ),
    (
        [("run", {"cycles": 2}), (DRIVE, {"speed": 1, "range": [0, 1]})],
        "run.cycles",
        "2 cycles of a motion that ends",
        "cycles = 1",
    ),
    (
        [("links/rocker/points/E", [0, 0])],
        "trace[0]",
        "'E' is on several links that no pin joins there.",
        "'coupler.E', 'rocker.E'",
    ),
    (
        [("links/coupler/points", ["B", "C"]), ("sketch", {"B": [1, 2]}), ("trace", [])],
        "links.coupler.points",
        "the sketch does not say where point 'C' is.",
        "Add C = [x, y] to [sketch]",
    ),
    (
        [("links/coupler/points", ["B", "C"]), ("sketch", {"B": [1, 2], "C": [1, 2]}), ("trace", [])],
        "links.coupler.points",
        "'B' and 'C' are drawn at the same place.",
        "Move one",
    ),
    ([("joints", {}), ("loads", {})], "joints", "the scene has no joints.", "[joints]"),
    ([("links", {}), ("joints", {})], "links", "the scene has no links.", "[links]"),
    (
        [("joints/B", {"prismatic": ["crank", "coupler"], "side": "left"})],
        "joints.B.side",
        "does not go with a prismatic",
        "branch",
    ),
    ([("joints/B", {"prismatic": ["crank", "coupler"], "along": [0, 0]})], "joints.B.along", "length zero", "[1, 0]"),
    ([("joints/B", {"prismatic": ["crank", "coupler"], "along": 5})], "joints.B.along", "5 where a direction is wanted", "[1, 0]"),
    (
        [("joints/B", {"prismatic": ["crank", "coupler"], "along": ["A", "F"]})],
        "joints.B.along[1]",
        "link 'crank' has no point 'F'.",
        "'A', 'B'",
    ),
    (
        [("joints/B", {"prismatic": ["crank", "coupler"], "along": ["A", "A"]})],
        "joints.B.along",
        "'A' and 'A' are at the same place.",
        "two different points",
    ),
    (
        [("joints/B", {"prismatic": ["crank", "coupler"], "guide": "rocker"})],
        "joints.B.guide",
        "'rocker' is not one of the two links.",
        "'crank', 'coupler'",
    ),
    (
        [("joints/A", {"prismatic": ["frame", "crank"], "drive": {"speed": 5}})],
        "joints.A.drive",
        "constant speed along a guide without saying how far.",
        "travel",
    ),
    (
        [("joints/A", {"prismatic": ["frame", "crank"], "drive": {"speed": "5 rpm", "travel": 9}})],
        "joints.A.drive.speed",
        "'5 rpm' is an angular speed, a linear speed is wanted.",
        "'20 mm/s'",
    ),
]


@pytest.mark.parametrize(("changes", "path", "message", "remedy"), COMBINED)
def test_a_fault_of_parts_that_do_not_go_together(changes, path, message, remedy):
    result = [fault for fault in faults_of(changed(*changes)) if fault.path == path and message in fault.message]
    assert len(result) == 1
    assert remedy in result[0].remedy


# --- all at once, and nothing twice -----------------------------------------------------------------------------------


def test_all_faults_of_a_file_come_at_once_in_the_order_of_the_file():
    data = changed(
        ("trace", ["F"]),
        ("links/crank/points/B", ["60 kg", 0]),
        ("links/crank/mass", -1),
        ("links/coupler/mas", 1),
        ("joints/A/revolute", ["frame", "crnk"]),
        (f"{DRIVE}/speed", "0 Hz"),
        ("joints/B/at", "Q"),
        ("joints/C/side", "lefft"),
        ("joints/C/revolute", ["coupler", "roker"]),
        ("loads/P/at", "Z"),
        ("loads/M/torque", "5 N"),
        (TABLE, {"position": [1, 0], "factor": [1, 2], "drive": "D"}),
    )
    assert [fault.path for fault in faults_of(data)] == [
        "trace[0]",
        "links.crank.points.B[0]",
        "links.crank.mass",
        "links.coupler",
        "joints.A.revolute[1]",
        "joints.A.drive.speed",
        "joints.B.at",
        "joints.B.at",
        "joints.C.revolute[1]",
        "joints.C.side",
        "loads.P.at",
        "loads.M.torque",
        "loads.M.table.position[1]",
        "loads.M.table.drive",
    ]


@pytest.mark.parametrize(
    "change",
    [
        ("links/rocker/mas", 1),
        ("links/crank/points/B", [60]),
        ("links/coupler/points", 5),
        ("joints/A/drve", 1),
        ("joints/B/revolut", ["crank", "coupler"]),
        ("constraints", BASE["joints"]),
        (f"{DRIVE}/sped", 5),
        (f"{DRIVE}/speed", "60 rmp"),
        ("joints/C/side", "lefft"),
        ("loads/P/force", ["1 m", 0]),
        ("units/length", "kg"),
        ("joints/A/revolute", ["frame", "crnk"]),
        ("links/coupler/points", {"B": [0, 0], "C": [180, 0], "F": [90, 70]}),
        ("frame", "base"),
    ],
)
def test_one_slip_is_one_fault(change):
    """What follows from a slip is not reported beside it."""
    data = changed(change)
    if change[0] == "joints/B/revolut":
        del data["joints"]["B"]["revolute"]
    if change[0] == "constraints":
        del data["joints"]
    assert len(faults_of(data)) == 1


@pytest.mark.parametrize(
    ("change", "meant"),
    [
        (("loads/S", {"spring": ["frame.A", "coupler.C"], "stiffness": "2 N/mm", "free": "80 mm"}), "free_length"),
        (("loads/S", {"torsion_spring": ["frame", "coupler"], "stiffness": "2 N m/rad", "free": "80 deg"}), "free_angle"),
        (("loads/S", {"torque": 1, "on": "coupler", "agenst": "frame"}), "against"),
        (("links/crank/centr", True), "centre"),
        ((f"{DRIVE}/strt", [1, 2]), "start"),
        (("joints/B", {"slider": ["crank", "coupler"]}), "prismatic"),  # a key of racks, but with what a slide has
    ],
)
def test_a_guess_fits_the_value_and_makes_no_second_fault(change, meant):
    """What an unknown key may have been meant for is a proposal; nothing is wrong but the key."""
    (fault,) = faults_of(changed(change))
    assert fault.message.startswith("unknown key") and fault.remedy == f"Did you mean '{meant}'?"


def test_a_guess_goes_with_the_kind_of_its_table():
    """A torque has no stiffness, a cam no angle of pressure: the key that is meant may be one of a table within."""
    (fault,) = faults_of(changed(("loads/S", {"torque": 1, "on": "coupler", "stiff": "1 N/mm"})))
    assert fault.remedy.startswith("Known: 'torque'") and "stiffness" not in fault.remedy
    (fault,) = faults_of(changed(("joints/A/start", 30)))
    assert (fault.path, fault.remedy) == ("joints.A", "Write it in drive.")
    (fault,) = faults_of(changed(("frames", 100)))
    assert fault.remedy == "Write it in run."
    load = {"force": [1, 0], "on": "coupler", "point": "B", "table": {"position": [0, 1], "factor": [0, 1]}}
    (fault,) = faults_of(changed(("loads/S", load)))
    assert fault.remedy == "Did you mean 'at'?", "not the point of the table's argument"


def test_without_joints_no_moment_of_inertia_is_missed():
    """Whether a link can turn shows once the joints are there."""
    data = changed(("effects", ["inertia"]), ("links/crank/centre", [30, 0]))
    del data["joints"]
    assert [f.path for f in faults_of(data)] == ["joints"]


def test_without_a_drive_no_drive_decides():
    data = changed(("run", {"tolerance": 1e-6}))
    del data["joints"]["A"]["drive"]
    words = " ".join(map(str, faults_of(data)))
    assert "nothing moves" in words and "drive decides" not in words and "instead of its drive" not in words


def test_a_misspelt_key_of_masses_does_not_make_the_rest_look_incomplete():
    data = changed(("effects", ["inertia"]), ("links/crank/center", [30, 0]), ("links/crank/inertia", 0.1))
    assert [(f.path, f.remedy) for f in faults_of(data)] == [("links.crank", "Did you mean 'centre'?")]


def test_no_message_is_pydantic_s():
    """Values of every wrong type at every place give messages of our own."""
    places = ["title", "units", "run", "run/frames", "effects", "trace", "gravity", "links", "links/crank", "links/crank/points",
              "links/crank/centre", "joints", "joints/B", "joints/B/at", DRIVE, f"{DRIVE}/start", f"{DRIVE}/table", "sketch",
              "loads", "loads/P", "loads/P/force", "loads/P/at", TABLE, "links/crank/points/B", f"{DRIVE}/segments"]  # fmt: skip
    for place in places:
        for value in (5, True, "text", [], {}, [[]], [{}], {"a": 1}, {"a": {"b": []}}, [1, 2], ["a", "b"], 1e300):
            try:
                Scene.build(**changed((place, value)))
            except SceneError as error:
                text = str(error)
                for word in (
                    "Input should",
                    "validation error",
                    "pydantic",
                    "Extra inputs",
                    "type=",
                    "Traceback",
                    "something else",
                ):
                    assert word not in text, (place, value, text)


# --- how a report reads -----------------------------------------------------------------------------------------------


def test_a_report_reads_like_the_one_of_the_examples():
    with pytest.raises(SceneError) as error:
        Scene.build(name="crank_rocker.toml", **changed(("links/rocker/mas", 1), ("joints/C/side", "lefft")))
    assert str(error.value).splitlines() == [
        "crank_rocker.toml: 2 problems",
        "  links.rocker   unknown key 'mas'. Did you mean 'mass'?",
        "  joints.C.side  'lefft' is not one of 'left', 'right'. Did you mean 'left'?",
    ]
    assert isinstance(error.value, MechanismError)


def test_a_long_report_is_wrapped_and_aligned():
    with pytest.raises(SceneError) as error:
        Scene.build(**changed(("joints/B/at", "Q"), (DRIVE, {"segments": [{"duration": -1, "to": 5}]})))
    lines = str(error.value).splitlines()
    assert max(map(len, lines)) <= 120
    assert lines[1] == "  joints.A.drive.segments[0].duration"
    assert lines[2] == " " * 36 + "-1 is negative. Give a positive value."


# --- files and texts --------------------------------------------------------------------------------------------------


def fault_of_text(text: str) -> Fault:
    with pytest.raises(SceneError) as error:
        loads(text, "x.toml")
    (fault,) = error.value.faults
    return fault


@pytest.mark.parametrize(
    ("text", "path", "message", "remedy"),
    [
        ("[links]\ncrank = 1\ncrank = 2\nb = 1", "line 3, column 10", "in: crank = 2", "stands twice"),
        ("[links]\n[links]", "line 2, column 7", "in: [links]", "opened twice"),
        ("a = 60 rpm", "line 1, column 8", "in: a = 60 rpm", "One key = value on a line"),
        ("a = rpm", "line 1, column 5", "invalid value, in: a = rpm", "need quotes"),
        ("a = { b = 1,\n c = 2 }", "line 1, column 13", "in: a = { b = 1,", "stays on one line"),
        ("a = [1, 2", "line 1, end of file", "unclosed array", "Close the bracket"),
        ('a = "x\n', "line 1, column 7", "in: a = ", "stays on one line"),
        ("links\n\n", "line 1, column 6", "expected '='", "in brackets: [links]"),
        ("p = { B = [1, 0], B = [2, 0] }", "line 1, column 29", "the key 'B' stands twice", "Keep one."),
        ("a = { b = 1 }\na.c = 2", "line 2, end of file", "immutable namespace", "inside the braces"),
        ("a = " + "[" * 60 + "]" * 60, "file", "nested too deep", "levels"),
        ("a = " + "[" * 9000 + "]" * 9000, "file", "nested too deep", "levels"),
        ("a = " + "1" * 5000, "file", "cannot be read", "1e6"),
    ],
)
def test_syntax_errors_give_line_column_and_remedy(text, path, message, remedy):
    fault = fault_of_text(text)
    assert fault.path == path
    assert message in fault.message
    assert remedy in fault.remedy


def fault_of_file(source: Any) -> Fault:
    with pytest.raises(SceneError) as error:
        load(source)
    (fault,) = error.value.faults
    return fault


def test_files_that_hold_no_scene(tmp_path: Path):
    contents = {
        "empty.toml": (b" \n", "is empty."),
        "binary.toml": (b"\x00\x01\x02", "is a binary file."),
        "latin.toml": (b"title = 'ok'\nlearning_goal = 'M\xfcller'", "line 2 holds the byte 0xfc"),
        "recording.toml": (b"RRF2....", "this is a recording, not a scene."),
        "huge.toml": (b"#" * (LARGEST_FILE + 1), "at most 8 MB are read"),
    }
    for name, (data, message) in contents.items():
        (tmp_path / name).write_bytes(data)
        fault = fault_of_file(tmp_path / name)
        assert fault.path == "file"
        assert message in fault.message
        assert fault.remedy
    assert fault_of_file(tmp_path).message == "this is a folder."
    assert fault_of_file(str(tmp_path / "emty.toml")).remedy == f"Did you mean '{tmp_path / 'empty.toml'}'?"
    assert "no folder" in fault_of_file(tmp_path / "nowhere" / "x.toml").message
    assert fault_of_file("crank-rocker.tml").remedy == "Did you mean the gallery scene 'crank-rocker'?"
    assert "called 'a\\x00b'" in fault_of_file("a\0b").message


def test_a_byte_order_mark_is_no_fault(tmp_path: Path):
    source = tmp_path / "x.toml"
    source.write_bytes(b"\xef\xbb\xbf" + load("triad").text.encode())
    assert load(source) == load("triad")


def test_no_two_points_have_one_name():
    """A recording would hold one of the two."""
    links = {"crank.B": {"points": {"C": [0.0, 0.0]}}, "crank": {"points": {"A": [0.0, 0.0], "B": [0.1, 0.0], "B.C": [0.1, 0.1]}}}
    (fault,) = (f for f in faults_of(changed(*((f"links/{name}", link) for name, link in links.items()))) if "called" in f.message)
    assert (fault.path, fault.remedy) == ("links.crank.B", "Rename one of the links, best without dots.")
    assert "'crank.B.C'" in fault.message


def test_an_unknown_gallery_scene_is_answered_with_the_list():
    fault = fault_of_file("crank-roker")
    assert fault.path == "scene"
    assert "Did you mean 'crank-rocker'" in fault.remedy
    assert "mechviz scenes" in fault.remedy


def test_a_file_named_like_a_gallery_scene_needs_its_ending(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    Path("crank-rocker.toml").write_text(load("triad").text)
    assert load("crank-rocker").title != load("triad").title
    assert load("crank-rocker.toml") == load("triad")


def test_all_branches_of_the_document_are_left_out_of_places():
    """Tags of unions are no part of a place, names that look like them are."""
    text = "".join(path.read_text(encoding="utf-8") for path in Path(lenient.__file__).parents[1].rglob("*.py"))
    assert set(re.findall(r'Tag\("([^"]*)"\)', text)) == lenient._BRANCHES


def chain(links: int, kind: str) -> str:
    """A chain of driven links of which all names of a kind are wrong, or right where there are many."""
    wrong = "x" if kind == "links" else ""
    names = [f"l{k}" for k in range(links)]
    lines = ["[links]", "frame = { points = { j0 = [0, 0] } }"]
    lines += [f"{name} = {{ points = {{ j{k} = [0, 0], j{k + 1} = [0.1, 0] }} }}" for k, name in enumerate(names)]
    lines += ["[joints]"]
    for k, (first, second) in enumerate(itertools.pairwise(("frame", *names))):
        lines += [f'j{k} = {{ revolute = ["{first}{wrong}", "{second}{wrong}"], drive = {{ speed = 1.0 }} }}']
    more = {
        "loads": [
            "[loads]",
            *(f's{k} = {{ spring = ["frame.q{k}", "l{k}.q"], stiffness = 1, free_length = 1 }}' for k in range(links)),
        ],
        "sketch": ["[sketch]", *(f"X{k} = [0, 0]" for k in range(links))],
        "traces": [],
    }
    traces = [f"trace = {[f'j{k}' for k in range(links)]}"] if kind == "traces" else []
    return "\n".join([*traces, *lines, *more.get(kind, ()), "[run]", "frames = 8"])


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["links", "loads", "sketch", "traces"])
def test_the_work_of_checking_names_grows_with_the_scene_not_with_its_square(kind):
    """Counted in calls of functions: twice the links may take 2.5 times as many."""

    def work(links: int) -> int:
        calls = 0

        def count(_frame: object, event: str, _argument: object) -> None:
            nonlocal calls
            calls += event in ("call", "c_call")

        text, before = chain(links, kind), sys.getprofile()
        sys.setprofile(count)
        try:
            with contextlib.nullcontext() if kind == "traces" else pytest.raises(SceneError, match="more: put these right first"):
                loads(text)
        finally:
            sys.setprofile(before)
        return calls

    loads(chain(2, "traces"))  # what is read and compiled once only
    assert work(240) < 2.5 * work(120)


def test_results_of_expressions_are_shown_short():
    with pytest.raises(MechanismError, match=r"thickness': -0.2355 is negative"):
        load("parametric-press").with_parameters({"stroke": "-80 mm"})
