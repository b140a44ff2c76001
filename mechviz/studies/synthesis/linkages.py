"""Scenes of synthesised linkages (four-bars, slider-cranks, slotted levers; lengths in mm, angles in degrees), and solutions of a
synthesis with their numbers and defects, as a table and as scene files."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mechcore.arrays import Real
from mechcore.design.four_bars import FourBar, used_range
from mechcore.design.strokes import SlottedLever, Whitworth
from mechcore.records import dataclass
from mechviz.files import OutputError, check_target
from mechviz.scene.scene import Scene, dump

MM = 1e3
SPEED = "60 rpm"
DriveEntry = Mapping[str, Any]


def four_bar_scene(
    bar: FourBar,
    drive: DriveEntry,
    *,
    name: str,
    title: str,
    learning_goal: str,
    marks: Mapping[str, complex] | None = None,
    traced: bool = True,
    driven: str = "A",
    side: int = 0,
) -> Scene:
    """Scene of a four-bar: crank A-B, coupler B-C with the traced point E, rocker D-C, frame A-D.

    ``marks``: additional points of the frame [m]; ``driven``: joint of the drive; ``side``: side of C, +1 left or -1 right, in the
    assembly mode; 0: that of ``bar``, which is the side of B -> D."""
    links, joints = four_bar_parts(bar, drive, traced=traced)
    if driven != "A":
        joints[driven]["drive"] = joints["A"].pop("drive")
    if side:
        joints["C"]["side"] = "left" if side > 0 else "right"
    links["frame"]["points"] |= {name: place_mm(z) for name, z in (marks or {}).items()}
    return Scene.build(
        name=name,
        title=title,
        learning_goal=learning_goal,
        units={"length": "mm", "angle": "deg"},
        trace=["E"] if traced else [],
        metrics=["transmission_angle"],
        links=links,
        joints=joints,
    )


def four_bar_parts(bar: FourBar, drive: DriveEntry, *, traced: bool) -> tuple[dict[str, Any], dict[str, Any]]:
    """Links and joints of a four-bar as tables of a scene [mm]."""
    coupler = {"B": [0, 0], "C": [bar.coupler * MM, 0]} | ({"E": place_mm(bar.tracer)} if traced else {})
    links = {
        "frame": {"points": {"A": place_mm(bar.crank_pivot), "D": place_mm(bar.rocker_pivot)}},
        "crank": {"points": {"A": [0, 0], "B": [bar.crank * MM, 0]}},
        "coupler": {"points": coupler},
        "rocker": {"points": {"D": [0, 0], "C": [bar.rocker * MM, 0]}},
    }
    joints: dict[str, dict[str, Any]] = {
        "A": {"revolute": ["frame", "crank"], "drive": drive},
        "B": {"revolute": ["crank", "coupler"]},
        "C": {"revolute": ["coupler", "rocker"], "side": "left" if bar.side > 0 else "right"},
        "D": {"revolute": ["rocker", "frame"]},
    }
    return links, joints


def slider_crank_scene(
    crank: float, rod: float, offset: float, drive: DriveEntry, *, name: str, title: str, learning_goal: str, ahead: bool = True
) -> Scene:
    """Scene of a slider-crank: crank A-B, rod B-C, slide along x through G. Lengths and offset [m]."""
    return Scene.build(
        name=name,
        title=title,
        learning_goal=learning_goal,
        units={"length": "mm", "angle": "deg"},
        metrics=["transmission_angle"],
        links={
            "frame": {"points": {"A": [0, 0], "G": [0, offset * MM]}},
            "crank": {"points": {"A": [0, 0], "B": [crank * MM, 0]}},
            "rod": {"points": {"B": [0, 0], "C": [rod * MM, 0]}},
            "slider": {"points": {"C": [0, 0]}},
        },
        joints={
            "A": {"revolute": ["frame", "crank"], "drive": drive},
            "B": {"revolute": ["crank", "rod"]},
            "C": {"revolute": ["rod", "slider"]},
            "S": {"prismatic": ["frame", "slider"], "at": ["G", "C"], "along": [1, 0], "branch": "ahead" if ahead else "behind"},
        },
    )


def slotted_lever_scene(made: SlottedLever, *, name: str, title: str, learning_goal: str) -> Scene:
    """Scene of a slotted lever: a crank O-A whose block slides on the lever B-C."""
    return Scene.build(
        name=name,
        title=title,
        learning_goal=learning_goal,
        units={"length": "mm", "angle": "deg"},
        trace=["C"],
        links={
            "frame": {"points": {"O": [0, 0], "B": [0, -made.frame * MM]}},
            "crank": {"points": {"O": [0, 0], "A": [made.crank * MM, 0]}},
            "block": {"points": {"A": [0, 0]}},
            "lever": {"points": {"B": [0, 0], "C": [made.lever * MM, 0]}},
        },
        joints={
            "O": {"revolute": ["frame", "crank"], "drive": {"speed": SPEED}},
            "A": {"revolute": ["crank", "block"]},
            "S": {"prismatic": ["lever", "block"], "at": ["B", "A"], "along": [1, 0], "branch": "ahead"},
            "B": {"revolute": ["frame", "lever"]},
        },
    )


def whitworth_scene(made: Whitworth, *, name: str, title: str, learning_goal: str) -> Scene:
    """Scene of a Whitworth quick-return mechanism: the block of a crank O-A turns a lever about B, whose arm B-C moves a slider
    along x by a rod C-D."""
    return Scene.build(
        name=name,
        title=title,
        learning_goal=learning_goal,
        units={"length": "mm", "angle": "deg"},
        links={
            "frame": {"points": {"O": [0, 0], "B": [0, -made.frame * MM]}},
            "crank": {"points": {"O": [0, 0], "A": [made.crank * MM, 0]}},
            "block": {"points": {"A": [0, 0]}},
            "lever": {"points": {"B": [0, 0], "C": [-made.arm * MM, 0]}},
            "rod": {"points": {"C": [0, 0], "D": [made.rod * MM, 0]}},
            "slider": {"points": {"D": [0, 0]}},
        },
        joints={
            "O": {"revolute": ["frame", "crank"], "drive": {"speed": SPEED}},
            "A": {"revolute": ["crank", "block"]},
            "P": {"prismatic": ["lever", "block"], "at": ["B", "A"], "along": [1, 0], "branch": "ahead"},
            "B": {"revolute": ["frame", "lever"]},
            "C": {"revolute": ["lever", "rod"]},
            "D": {"revolute": ["rod", "slider"]},
            "S": {"prismatic": ["frame", "slider"], "at": ["B", "D"], "along": [1, 0], "branch": "ahead"},
        },
    )


def slider_guide_scene(
    pivot: complex,
    pins: tuple[complex, complex],
    traced: complex,
    along: complex,
    drive: DriveEntry,
    *,
    marks: Mapping[str, complex],
    **words: str,
) -> Scene:
    """Scene of a body that is guided by a crank A-B and a slide through C. ``pivot``, ``pins`` and the traced point E: positions at
    the start [m]; ``along``: unit direction of the slide."""  # fmt: skip
    b, c = pins
    turned = (c - b) / abs(c - b)
    return Scene.build(
        **words,
        units={"length": "mm", "angle": "deg"},
        trace=["E"],
        links={
            "frame": {"points": {"A": place_mm(pivot), "G": place_mm(c)} | {name: place_mm(z) for name, z in marks.items()}},
            "crank": {"points": {"A": [0, 0], "B": [abs(b - pivot) * MM, 0]}},
            "coupler": {"points": {"B": [0, 0], "C": [abs(c - b) * MM, 0], "E": place_mm((traced - b) / turned)}},
            "slider": {"points": {"C": [0, 0]}},
        },
        joints={
            "A": {"revolute": ["frame", "crank"], "drive": drive},
            "B": {"revolute": ["crank", "coupler"]},
            "C": {"revolute": ["coupler", "slider"]},
            "S": {
                "prismatic": ["frame", "slider"],
                "at": ["G", "C"],
                "along": [along.real, along.imag],
                "branch": "ahead" if ((c - b) * along.conjugate()).real > 0.0 else "behind",
            },
        },
    )


def through(bar: FourBar, theta: Real, *, usable: bool) -> DriveEntry:
    """Document of a drive that moves the crank through angles (K,) [rad]: by full turns if the crank can rotate fully, else by an
    oscillation between the first and the last angle.

    A linkage that is not ``usable``, and whose crank does not rotate fully, runs over its reachable range.
    """
    if not usable and not bar.crank_turns:
        return {"speed": SPEED, "range": "reachable", "start": math.degrees(theta[0])}
    first, last = used_range(theta, bar.crank_turns) if usable else (float(theta[0]), float(theta[0]) + 1.0)
    if bar.crank_turns:
        return {"speed": SPEED if last >= first else f"-{SPEED}", "start": math.degrees(first)}
    return to_and_fro(first, last)


def to_and_fro(first: float, last: float) -> DriveEntry:
    """Document of a drive that oscillates harmonically between two angles [rad], starting at the first."""
    half = math.degrees(abs(last - first)) / 2.0
    phase = -90 if last >= first else 90
    return {"oscillation": {"centre": math.degrees(first + last) / 2.0, "amplitude": half, "period": "2 s", "phase": phase}}


def once(first: float, last: float) -> DriveEntry:
    """Document of a drive at constant speed from one angle to another [rad] in two seconds."""
    speed = math.degrees(last - first) / 2.0
    return {"speed": f"{speed!r} deg/s", "range": sorted(math.degrees(angle) for angle in (first, last))}


def place_mm(z: complex) -> list[float]:
    """Coordinates [mm] of a complex position [m]."""
    return [float(np.real(z)) * MM, float(np.imag(z)) * MM]


@dataclass(frozen=True, eq=False)
class LinkageSolution:
    """A solution of a synthesis: the linkage as a scene, its characteristic numbers by title, and its defects in words, "" for
    none."""

    scene: Scene
    numbers: Mapping[str, str]
    defects: str = ""


def solution_table(solutions: Sequence[LinkageSolution]) -> Iterator[str]:
    """Table of solutions as lines of text: index, characteristic numbers, defects."""
    rows = [["", *solutions[0].numbers, "defects"]] if solutions else []
    rows += [[str(k + 1), *one.numbers.values(), one.defects or "none"] for k, one in enumerate(solutions)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))] if rows else []
    for row in rows:
        cells = [word.rjust(width) for word, width in zip(row[:-1], widths[:-1], strict=True)]
        yield "  ".join([*cells, row[-1]])


def check_folder(target: Path) -> None:
    """Raise `OutputError` where scenes cannot be written to a target; called before anything is computed."""
    if target.suffix == ".toml":
        check_target(target)
    elif target.exists() and not target.is_dir():
        raise OutputError(
            f"'{target}' is a file.", "Give a folder for all solutions, or a name that ends in .toml for the first one."
        )


def write(solutions: Sequence[LinkageSolution], target: Path) -> list[Path]:
    """Write the first solution to a file that ends in ``.toml``, or all solutions to a folder; returns the files."""
    if target.suffix == ".toml":
        dump(solutions[0].scene, target)
        return [target]
    target.mkdir(parents=True, exist_ok=True)
    paths = [target / f"{one.scene.name}.toml" for one in solutions]
    for one, path in zip(solutions, paths, strict=True):
        dump(one.scene, path)
    return paths
