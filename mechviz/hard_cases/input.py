"""Hard cases of input: what users really write. Either it is read correctly to the last digit, or every fault is named."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechviz.hard_cases.case import Case, Check, Outcome, check_that, compare, motion_outcome, refusal_outcome
from mechviz.scene.faults import SceneError
from mechviz.scene.scene import Scene, loads

BASE: dict[str, Any] = {
    "units": {"length": "mm", "angle": "deg"},
    "links": {
        "frame": {"points": {"A": [0, 0], "D": [200, 0]}},
        "crank": {"points": {"A": [0, 0], "B": [60, 0]}},
        "coupler": {"points": {"B": [0, 0], "C": [180, 0], "E": [90, 70]}},
        "rocker": {"points": {"D": [0, 0], "C": [150, 0]}},
    },
    "joints": {
        "A": {"revolute": ["frame", "crank"], "drive": {"speed": "60 rpm"}},
        "B": {"revolute": ["crank", "coupler"]},
        "C": {"revolute": ["coupler", "rocker"], "side": "left"},
        "D": {"revolute": ["rocker", "frame"]},
    },
}
"""A valid crank-rocker, which the cases change."""


def _changed(**changes: object) -> dict[str, Any]:
    """The crank-rocker with values changed, each at a path such as ``links__crank__mass``; None removes a key."""
    data: dict[str, Any] = json.loads(json.dumps(BASE))
    for path, value in changes.items():
        *parents, key = path.split("__")
        table = data
        for part in parents:
            table = table.setdefault(part, {})
        if value is None:
            del table[key]
        else:
            table[key] = value
    return data


def _faulty(attempt: Callable[[], object], *expected: tuple[str, str, str]) -> Outcome:
    """The outcome of an attempt that has to give exactly the expected faults: (path, part of the message, part of the remedy)."""
    try:
        attempt()
    except SceneError as e:
        faults = e.faults
        cases = [
            check_that(f"{path}: {what}", any(f.path == path and what in f.message and remedy in f.remedy for f in faults))
            for path, what, remedy in expected
        ]
        number = Check("number of faults", float(abs(len(faults) - len(expected))), 0.5)
        return Outcome(
            "; ".join(f"{f.path}: {f.message}" for f in faults),
            (*cases, number),
            events=(f"{len(faults)} fault{'s' if len(faults) > 1 else ''}",),
        )
    return Outcome("accepted without a word", (check_that("refused", False),))


def _spoiled(*expected: tuple[str, str, str], **changes: object) -> Callable[[], Outcome]:
    return lambda: _faulty(lambda: _solved(Scene.build(**_changed(**changes))), *expected)


def _solved(scene: Scene) -> Any:
    return solve_motion(compile_mechanism(scene.mechanism), default_times(scene.mechanism, 36))


def _same(first: Any, second: Any, links: Sequence[str], bound: float) -> list[Check]:
    return [compare(k, second.pose(k), first.pose(k), bound) for k in links]


def _units() -> Outcome:
    """The same crank-rocker in millimetres, in inches, and with values in units of their own."""
    base = _solved(Scene.build(**BASE))
    inches = json.loads(json.dumps(BASE))
    inches["units"] = {"length": "in", "angle": "turn"}
    for link in inches["links"].values():
        link["points"] = {p: [x / 25.4, y / 25.4] for p, (x, y) in link["points"].items()}
    mixed = _changed(
        links__crank__points={"A": [0, 0], "B": ["0.06 m", "0 km"]},
        links__frame__points={"A": ["0 um", 0], "D": ["20 cm", 0]},
        joints__A__drive={"speed": "360 deg/s"},
    )
    checks = []
    for other in (inches, mixed):
        checks += _same(base, _solved(Scene.build(**other)), ("coupler", "rocker"), 1e-14)
    return motion_outcome(base, "the same to the last digit", checks)


def seven_slips() -> dict[str, Any]:
    """The crank-rocker with seven slips, two of them in the same joint."""
    return _changed(
        links__rocker__mas=1,
        links__crank__points={"A": [0, 0], "B": ["60 kg", 0]},
        joints__A__drive={"speed": "60 Hz"},
        joints__C={"revolute": ["coupler", "roker"], "side": "lefft"},
        joints__D={"revolut": ["rocker", "frame"]},
        trace=["X"],
    )


def _many_slips() -> Outcome:
    """Seven slips at once: each is reported, but nothing that is only a consequence of them."""
    data = seven_slips()
    return _faulty(
        lambda: Scene.build(**data),
        ("links.rocker", "unknown key 'mas'", "'mass'"),
        ("links.crank.points.B[0]", "is a mass", "'80 mm'"),
        ("joints.A.drive.speed", "is a frequency", "rpm"),
        ("joints.C.revolute[1]", "'roker'", "'rocker'"),
        ("joints.C.side", "'lefft'", "'left'"),
        ("joints.D", "'revolut'", "'revolute'"),
        ("trace[0]", "'X'", ""),
    )


def _read_write_read() -> Outcome:
    """Numbers of all magnitudes are written as text and read back bit for bit."""
    rng = np.random.default_rng(5)
    values = [*(rng.uniform(1.0, 10.0, 40) * 10.0 ** rng.integers(-12, 12, 40)).tolist(), 0.1, 1 / 3, 2.2250738585072015e-08]
    points = {f"P{k}": [v, -v] for k, v in enumerate(values)}
    data = _changed(links__coupler__points={**BASE["links"]["coupler"]["points"], **points})
    scene = Scene.build(**data)
    again = loads(scene.to_toml())
    one, two = (next(k for k in s.mechanism.links if k.name == "coupler").points for s in (scene, again))
    checks = [check_that("points bit for bit", one == two), check_that("scenes are equal", scene == again)]
    return Outcome(f"{len(points)} points with 24 decades between them", tuple(checks))


def _strange_names() -> Outcome:
    """Names with spaces, fractions, apostrophes, Greek, Cyrillic and Chinese letters: nothing depends on the alphabet."""
    names = {"crank": "Kurbel ½", "coupler": "κοινωνός b'", "rocker": "коромысло 摇杆"}
    text = json.dumps(BASE)
    for old, new in names.items():
        text = text.replace(f'"{old}"', json.dumps(new))
    base, other = _solved(Scene.build(**BASE)), _solved(loads(Scene.build(**json.loads(text)).to_toml()))
    checks = [compare(new, other.pose(new), base.pose(old), 1e-15) for old, new in names.items()]
    return motion_outcome(other, ", ".join(names.values()), checks)


def _order() -> Outcome:
    """Links and joints in any order, joints with their links exchanged: the same motion."""
    base = _solved(Scene.build(**BASE))
    data: dict[str, Any] = json.loads(json.dumps(BASE))
    data["links"] = dict(reversed(data["links"].items()))
    data["joints"] = dict(reversed(data["joints"].items()))
    data["joints"]["B"]["revolute"].reverse()
    data["joints"]["D"]["revolute"].reverse()
    return motion_outcome(base, "the same motion", _same(base, _solved(Scene.build(**data)), ("crank", "coupler", "rocker"), 1e-14))


def _not_toml() -> Outcome:
    try:
        loads("[links]\nframe = { points = { A = [0, 0 } }\n", "mine")
    except SceneError as e:
        text = str(e)
        return Outcome(
            text.replace("\n", " "),
            (check_that("one fault", len(e.faults) == 1), check_that("line and column", "line 2" in text)),
            events=("1 fault",),
        )
    return Outcome("accepted without a word", (check_that("refused", False),))


def _tiny_and_huge() -> Outcome:
    """The crank-rocker a billion times as large, and a million times as small: the same angles."""
    base = _solved(Scene.build(**BASE))
    checks = []
    for unit in ("nm", "Mm"):
        data: dict[str, Any] = json.loads(json.dumps(BASE))
        data["units"]["length"] = unit
        checks.append(compare(unit, _solved(Scene.build(**data)).pose("rocker")[:, 2], base.pose("rocker")[:, 2], 1e-14))
    return motion_outcome(base, "the same angles in nanometres and in megametres", checks)


def _too_short() -> Outcome:
    data = _changed(links__frame__points={"A": [0, 0], "D": [500, 0]}, links__coupler__points={"B": [0, 0], "C": [10, 0]})
    return refusal_outcome(lambda: _solved(Scene.build(**data)), r"joints\.C", r"280(\.0*)? mm")


CASES = (
    Case(
        "seven slips at once",
        "input",
        "misspelt keys, names and words, wrong units, in one file",
        "every one with place and remedy, nothing else",
        _many_slips,
    ),
    Case("three systems of units", "input", "millimetres, inches, a unit on every value", "one motion", _units),
    Case("nanometres and megametres", "input", "lengths of 6e-8 m and 6e7 m", "the same angles", _tiny_and_huge),
    Case("written and read again", "input", "numbers over 24 decades through a text", "bit for bit", _read_write_read),
    Case("names of any script", "input", "fractions, Greek, Cyrillic, Chinese, apostrophes", "the same motion", _strange_names),
    Case("any order", "input", "links and joints listed backwards, links of joints exchanged", "the same motion", _order),
    Case("not TOML", "input", "a bracket is missing", "one fault with its line", _not_toml),
    Case(
        "not a number",
        "input",
        "NaN as a mass",
        "refused at its place",
        _spoiled(("links.crank.mass", "not a finite number", "finite"), links__crank__mass=float("nan")),
    ),
    Case(
        "beyond any machine",
        "input",
        "a length of 1e40 mm",
        "refused at its place",
        _spoiled(("links.crank.points.B[0]", "beyond 1e+30", "unit"), links__crank__points={"A": [0, 0], "B": [1e40, 0]}),
    ),
    Case(
        "nothing drives it",
        "input",
        "a freedom without a drive",
        "refused, says where to add one",
        lambda: refusal_outcome(
            lambda: _solved(Scene.build(**_changed(joints__A__drive=None))), "without a drive.*at A, B, C, D. Add"
        ),
    ),
    Case(
        "links that cannot meet",
        "input",
        "a gap of at least 440 mm for 160 mm of links",
        "refused with the gap at the start: 280 mm",
        _too_short,
    ),
    Case(
        "a link that hangs on nothing",
        "input",
        "a joint was forgotten",
        "refused by name",
        _spoiled(("links.idle", "", ""), links__idle={"points": {"Q": [0, 0]}}),
    ),
)
