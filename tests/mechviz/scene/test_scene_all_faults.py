"""Independent faults of a scene are all reported in one run, each with its path, and nothing else is.

A sound and rich scene gets several faults of a catalogue at once. The catalogue says of each what it changes, which
report must come of it, and which parts it spoils: two faults are independent if neither spoils what the other is about.
"""

from __future__ import annotations

import copy
import random
import tomllib
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest

from mechcore.errors import Fault
from mechviz.scene import scene
from mechviz.scene.faults import SceneError
from mechviz.scene.folder import gallery_names
from mechviz.scene.scene import Scene, load

REMOVED = object()

RICH: dict[str, Any] = {
    "title": "All kinds of things",
    "units": {"length": "mm", "angle": "deg", "time": "s", "torque": "N m"},
    "effects": ["inertia", "gravity"],
    "trace": ["E", "rod.C"],
    "metrics": ["velocity_ratio"],
    "gravity": [0, "-9.81 m/s^2"],
    "run": {"frames": 90, "cycles": 1},
    "links": {
        "frame": {"points": {"A": [0, 0], "D": [200, 0], "G": [0, -135], "H": [400, 0]}},
        "crank": {"points": {"A": [0, 0], "B": [60, 0]}, "mass": "0.4 kg", "shape": "bar"},
        "coupler": {
            "points": {"B": [0, 0], "C": [180, 0], "E": [90, 70]},
            "mass": 1.0,
            "centre": [90, 20],
            "inertia": "0.01 kg m^2",
        },
        "rocker": {"points": {"D": [0, 0], "C": [150, 0], "R": [150, 30]}, "mass": 2, "centre": "C", "inertia": 0.02},
        "wheel": {"points": {"G": [0, 0], "K": [50, 0]}},
        "rod": {"points": {"R": [0, 0], "S": [300, 0], "C": [10, 0]}},
        "piston": {"points": {"S": [0, 0]}, "mass": 3},
    },
    "joints": {
        "A": {"revolute": ["frame", "crank"], "drive": {"speed": "60 rpm", "start": 30, "zones": {"run_up": 90, "steady": 360}}},
        "B": {"revolute": ["crank", "coupler"]},
        "C": {"revolute": ["coupler", "rocker"], "side": "left"},
        "D": {"revolute": ["rocker", "frame"]},
        "W": {"revolute": ["frame", "wheel"], "at": "G"},
        "X": {"gear": ["crank", "wheel"], "radii": [45, 90], "carrier": "frame", "pressure_angle": 20},
        "R": {"revolute": ["rocker", "rod"]},
        "S": {"revolute": ["rod", "piston"], "branch": "ahead"},
        "T": {"prismatic": ["frame", "piston"], "at": ["H", "S"], "along": [1, 0], "guide": "frame"},
    },
    "sketch": {"wheel": {"at": [0, -135], "angle": "90 deg"}, "E": [80, 120]},
    "loads": {
        "gas": {
            "force": [-100, 0],
            "on": "piston",
            "at": "S",
            "axes": "world",
            "table": {"position": [0, 90, 180], "factor": [1, 2, 1], "period": 360, "drive": "A"},
        },
        "pull": {"force": ["5 N", 2], "on": "rocker", "at": "C"},
        "brake": {"torque": "2 N m", "on": "wheel", "table": {"position": [0, 90, 180, 200], "factor": [1, 2, 1, 0]}},
    },
}


@dataclass(frozen=True)
class Slip:
    """One fault: value at a place, the report's path and a part of its words, and other places that it spoils."""

    where: str
    value: Any
    path: str
    words: str
    spoils: tuple[str, ...] = ()

    @property
    def places(self) -> tuple[str, ...]:
        return (self.where, *self.spoils)


D, GAS, BRAKE = "joints/A/drive", "loads/gas", "loads/brake"
LAW = (f"{D}/law", D)
SLIPS = [
    Slip("title", 5, "title", "where a text"),
    Slip("colour", "red", "colour", "unknown key 'colour'"),
    Slip("units/tiem", "s", "units", "unknown key 'tiem'"),
    Slip("units/mass", "mm", "units.mass", "is the unit of a length"),
    Slip("effects/1", "gravty", "effects[1]", "'gravty' is not one of"),
    Slip("trace/0", "Q", "trace[0]", "no link has a point 'Q'"),
    Slip("trace/1", "rod.Z", "trace[1]", "link 'rod' has no point 'Z'"),
    Slip("metrics/0", "velocity", "metrics[0]", "'velocity' is not one of"),
    Slip("gravity/1", "-9.81 m/s", "gravity[1]", "is a linear speed"),
    Slip("run/frames", 1, "run.frames", "1 is too small"),
    Slip("run/cycle", 2, "run", "unknown key 'cycle'"),
    Slip("frame", "frmae", "frame", "no link 'frmae'"),
    Slip("links/lonely", {"points": {"Z": [0, 0]}}, "links.lonely", "no chain of joints"),
    Slip("links/crank/mass", "0.4 Kg", "links.crank.mass", "unknown unit 'Kg'"),
    Slip("links/crank/points/B", [60, 0, 1], "links.crank.points.B", "has 3 entries"),
    Slip("links/crank/shape", "barr", "links.crank.shape", "'barr' is not one of"),
    Slip("links/coupler/mass", -1, "links.coupler.mass", "negative"),
    Slip("links/coupler/centre", REMOVED, "links.coupler", "has a mass but no centre"),
    Slip("links/coupler/inertia", REMOVED, "links.coupler", "no moment of inertia"),
    Slip("links/coupler/color", 1, "links.coupler", "unknown key 'color'"),
    Slip("links/coupler/points/E/1", "x", "links.coupler.points.E[1]", "not a number with a unit"),
    Slip("links/rocker/centre", "CC", "links.rocker.centre", "no point 'CC'"),
    Slip("links/rocker/inertia", "2 kg m", "links.rocker.inertia", "a moment of inertia is wanted"),
    Slip("links/rocker/mas", 2, "links.rocker", "unknown key 'mas'"),
    Slip("links/piston/mass", [3], "links.piston.mass", "where a mass is wanted"),
    Slip("links/wheel/shape", "point", "links.wheel.shape", "without a mass"),
    Slip("joints/A/revolute/1", "crnak", "joints.A.revolute[1]", "no link 'crnak'"),
    Slip("joints/A/drvie", 1, "joints.A", "unknown key 'drvie'"),
    Slip(f"{D}/speed", "60 Hz", "joints.A.drive.speed", "is a frequency"),
    Slip(f"{D}/start", "3 mm", "joints.A.drive.start", "is a length"),
    Slip(f"{D}/zones/runup", 3, "joints.A.drive.zones", "unknown key 'runup'"),
    Slip(f"{D}/zones/steady", -1, "joints.A.drive.zones.steady", "negative"),
    Slip(f"{D}/travel", 5, "joints.A.drive.travel", "travel does not go with", (f"{D}/oscillation",)),
    Slip(
        f"{D}/oscillation",
        {"amplitude": "1 kg"},
        "joints.A.drive.oscillation.amplitude",
        "'1 kg' is a mass",
        (f"{D}/travel",),
    ),
    Slip("joints/B/revolute/0", 7, "joints.B.revolute[0]", "7 where a text is wanted"),
    Slip("joints/B/along", [1, 0], "joints.B.along", "does not go with a revolute joint"),
    Slip("joints/C/side", "lefft", "joints.C.side", "'lefft' is not one of"),
    Slip("joints/C/branch", "ahead", "joints.C.branch", "both choose the assembly mode"),
    Slip("joints/C/revolute/1", "roker", "joints.C.revolute[1]", "no link 'roker'"),
    Slip("joints/D/at", ["D", "DD"], "joints.D.at[1]", "link 'frame' has no point 'DD'"),
    Slip("joints/D/drive", {"oscillation": {"amplitude": 1}}, "joints.D.drive.oscillation", "none of frequency or period"),
    Slip("joints/W/revolut", ["frame", "wheel"], "joints.W", "unknown key 'revolut'", ("joints/W/revolute",)),
    Slip("joints/X/radii", [45, 45], "joints.X.radii", "sum is 90 mm", ("joints/X/teeth", "links/frame/points/G", "joints/W/at")),
    Slip("joints/X/teeth", [1, 2], "joints.X", "teeth and radii at once", ("joints/X/radii",)),
    Slip("joints/X/carrier", "frme", "joints.X.carrier", "no link 'frme'"),
    Slip("joints/X/pressure_angle", 60, "joints.X.pressure_angle", "no pressure angle of teeth"),
    Slip("joints/X/internal", "no", "joints.X.internal", "where true or false"),
    Slip("joints/W/at", "GG", "joints.W.at", "has no point 'GG'"),
    Slip("joints/R/revolute", ["rocker"], "joints.R.revolute", "names 1 link"),
    Slip("joints/S/branch", 5, "joints.S.branch", "5 is not one of"),
    Slip("joints/T/guide", "piton", "joints.T.guide", "not one of the two links"),
    Slip("joints/T/along", [0, 0], "joints.T.along", "length zero"),
    Slip("joints/T/at/0", "J", "joints.T.at[0]", "link 'frame' has no point 'J'"),
    Slip("sketch/EE", [1, 2], "sketch.EE", "no link has a point 'EE'", ("sketch/E",)),
    Slip("sketch/whel", {"at": [0, 0]}, "sketch.whel", "no link 'whel'", ("sketch/wheel",)),
    Slip("sketch/wheel/at/0", "1 kg", "sketch.wheel.at[0]", "is a mass"),
    Slip("sketch/A", [1, 0], "sketch.A", "is not where links.frame has this point"),
    Slip(f"{GAS}/on", "pistn", "loads.gas.on", "no link 'pistn'"),
    Slip(f"{GAS}/at", "ZZ", "loads.gas.at", "link 'piston' has no point 'ZZ'"),
    Slip(f"{GAS}/force/1", "5 kg", "loads.gas.force[1]", "a force is wanted"),
    Slip(f"{GAS}/axes", "wrld", "loads.gas.axes", "'wrld' is not one of"),
    Slip(f"{GAS}/table/perod", 360, "loads.gas.table", "unknown key 'perod'"),
    Slip(f"{GAS}/table/drive", "Y", "loads.gas.table.drive", "there is no joint 'Y'"),
    Slip(f"{GAS}/table/position/2", 45, "loads.gas.table.position[2]", "does not grow"),
    Slip(f"{GAS}/table/factor", [1, 2], "loads.gas.table", "3 positions and 2 factors"),
    Slip(f"{GAS}/table/smooth", "maybe", "loads.gas.table.smooth", "does not say how the points are joined"),
    Slip("loads/pull/at", REMOVED, "loads.pull", "'at' is missing", ("loads/pull/torque",)),
    Slip("loads/pull/torque", 3, "loads.pull", "force and torque at once", ("loads/pull/at",)),
    Slip("loads/pull/force/0", "5 Nm", "loads.pull.force[0]", "unknown unit 'Nm'"),
    Slip(f"{BRAKE}/on", "frame", "loads.brake.on", "is the fixed link"),
    Slip(f"{BRAKE}/torque", "2 N", "loads.brake.torque", "a torque is wanted"),
    Slip(f"{BRAKE}/table/period", "90 deg", "loads.brake.table.period", "shorter than the range"),
    Slip(f"{BRAKE}/table/factor/3", "half", "loads.brake.table.factor[3]", "where a plain number is wanted"),
]
CONFLICTS = {  # follow from a pair of slips only, or hide each other by their meaning
    frozenset({"joints/X/radii", "frame"}),
}
COMPANIONS = {  # slips that are two faults by themselves
    f"{D}/oscillation": [("joints.A.drive", "at once"), ("joints.A.drive.oscillation", "none of frequency or period")],
}


def independent(a: Slip, b: Slip) -> bool:
    """Neither lies inside, or spoils, what the other changes."""
    if frozenset({a.where, b.where}) in CONFLICTS:
        return False
    return not any(p == q or p.startswith(f"{q}/") or q.startswith(f"{p}/") for p in a.places for q in b.places)


def slipped(slips: list[Slip]) -> dict[str, Any]:
    data = copy.deepcopy(RICH)
    for slip in slips:
        *parents, last = slip.where.split("/")
        table: Any = data
        for part in parents:
            table = table[int(part)] if isinstance(table, list) else table[part]
        key: Any = int(last) if isinstance(table, list) else last
        if slip.value is REMOVED:
            del table[key]
        else:
            table[key] = copy.deepcopy(slip.value)
        if slip.where == "joints/W/revolut":
            del data["joints"]["W"]["revolute"]
        if slip.where == "sketch/EE":
            del data["sketch"]["E"]
        if slip.where == "sketch/whel":
            del data["sketch"]["wheel"]
    return data


def faults_of(data: dict[str, Any]) -> list[Fault]:
    with pytest.raises(SceneError) as error:
        Scene.build(name="x", **data)
    return list(error.value.faults)


def check(slips: list[Slip]) -> None:
    """Every slip is reported, and every report comes of a slip."""
    faults = faults_of(slipped(slips))
    wanted = [(slip.path, slip.words) for slip in slips]
    wanted += [joint for slip in slips for joint in COMPANIONS.get(slip.where, [])]
    for path, words in wanted:
        assert any(f.path == path and words in f.message for f in faults), (path, words, [s.where for s in slips], faults)
    for fault in faults:
        known = any(fault.path == path and words in fault.message for path, words in wanted)
        assert known, (fault, [s.where for s in slips])
        assert fault.message


def test_the_rich_scene_and_the_gallery_have_no_faults():
    assert len(Scene.build(**RICH).mechanism.loads) == 3
    for name in gallery_names():
        assert load(name).mechanism.links


def test_the_catalogue_is_large_and_mostly_independent():
    assert len(SLIPS) >= 40
    joints = list(combinations(SLIPS, 2))
    assert sum(independent(a, b) for a, b in joints) > 0.95 * len(joints)


@pytest.mark.parametrize("slip", SLIPS, ids=lambda slip: slip.where)
def test_a_slip_alone_is_reported_and_nothing_else(slip):
    check([slip])


def test_two_independent_slips_are_reported_together():
    joints = [joint for joint in combinations(SLIPS, 2) if independent(*joint)]
    for joint in random.Random(2).sample(joints, k=150):
        check(list(joint))


@pytest.mark.parametrize("seed", range(60))
def test_many_independent_slips_are_reported_together(seed):
    rng = random.Random(seed)
    chosen: list[Slip] = []
    for slip in rng.sample(SLIPS, k=rng.randint(3, len(SLIPS))):
        if all(independent(slip, other) for other in chosen):
            chosen.append(slip)
    check(chosen)


def test_a_misspelt_point_of_the_sketch_does_not_make_a_drawn_link_incomplete():
    data = copy.deepcopy(RICH)
    data["links"]["rod"]["points"] = ["R", "S", "C"]
    data["sketch"] |= {"R": [210, 150], "S": [470, 0], "C": [220, 150]}
    Scene.build(**data)
    data["sketch"]["Ss"] = data["sketch"].pop("S")
    assert [(fault.path, fault.remedy) for fault in faults_of(data)] == [("sketch.Ss", "Did you mean 'S'?")]


def test_what_stands_for_a_wrong_number_is_computed_with_in_silence():
    """The rest of the scene is looked at, too: an arc of a cam with a bulge that is no number made a warning of numpy's."""
    data = tomllib.loads((Path(scene.__file__).parents[1] / "gallery" / "cam-tangent.toml").read_text(encoding="utf-8"))
    data["joints"]["K"]["profile"]["bulges"][2] = float("nan")
    told = faults_of(data)
    assert [fault.path for fault in told] == ["joints.K.profile.bulges[2]"] and "finite" in told[0].message
