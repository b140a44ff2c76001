"""The motion of a pen as a bare program for three motors: tables over time of two crossed slides and of the pen's lift."""

from __future__ import annotations

import math

import numpy as np

from mechcore.arrays import Real
from mechviz.automata.pen_motion import DOWN, PenMotion
from mechviz.automata.texts import csv_table, place, quoted
from mechviz.scene.folder import SceneFolder
from mechviz.scene.scene import Scene, loads

_LIFT = 0.04  # of the pen, over the size of the drawing
_GUIDE = 0.3  # how far below the drawing the guide is, over its size


def plotter_scene(motion: PenMotion, period: float, *, title: str, name: str) -> Scene:
    """Two slides that draw, driven over time by the tables ``name-x.csv`` and ``name-y.csv`` of its folder, and a third that lifts.

    ``period`` [s]: of one turn of the motion.
    """
    low, high = motion.places.real.min() + 1j * motion.places.imag.min(), motion.places.real.max() + 1j * motion.places.imag.max()
    size = max((high - low).real, (high - low).imag)
    lift, below = _LIFT * size, low.imag - _GUIDE * size
    axes = {"x": motion.places.real, "y": motion.places.imag}
    files = {f"{name}-{axis}.csv": _table(values, period) for axis, values in axes.items()}
    last = f"{{ duration = {period:.12g}, law = {{ position = {{ file = %s, periodic = true }} }} }}"
    lines = [
        f"title = {quoted(title)}",
        'teaches = "A program of three axes in step: two slides lead the pen, a third one lifts it between strokes."',
        'units = { length = "mm", angle = "deg" }',
        "",
        "[run]",
        f"frames = {2 * len(motion.places)}",
        "",
        "[links]",
        f"frame = {{ points = {{ O = {place(1j * below)}, L = {place(high.real + 0.3 * size + 1j * low.imag)} }} }}",
        f"carriage = {{ points = {{ X = [0, 0], Q = {place(-1j * below)} }} }}",
        "pen = { points = { P = [0, 0] } }",
        "lifter = { points = { L = [0, 0] } }",
        "",
        "[pens.P]",
        'point = "pen.P"',
        'joint = "Z"',
        f"at_most = {1e3 * DOWN * lift:.6g}",
    ]
    guides = {"X": ("frame", "carriage", "O", "X", "[1, 0]"), "Y": ("carriage", "pen", "Q", "P", "[0, 1]")}
    for joint, (first, second, at, point, along) in guides.items():
        lines += [
            "",
            f"[joints.{joint}]",
            f'prismatic = ["{first}", "{second}"]',
            f'at = ["{at}", "{point}"]',
            f"along = {along}",
            f"drive.start = {1e3 * axes[joint.lower()][0]:.9g}",
            f"drive.segments = [{last % quoted(f'{name}-{joint.lower()}.csv')}]",
        ]
    steps = []
    for over, to in motion.lifts:
        goal = "" if to is None else f', to = {1e3 * lift * to:.6g}, law = "cycloidal"'
        steps.append(f"    {{ duration = {over * period / (2.0 * math.pi):.12g}{goal} }},")
    lines += [
        "",
        "[joints.Z]",
        'prismatic = ["frame", "lifter"]',
        'at = ["L", "L"]',
        "along = [0, 1]",
        "drive.start = 0",
        "drive.segments = [",
        *steps,
        "]",
    ]
    return loads("\n".join(lines) + "\n", name, SceneFolder(contents=files))


def _table(values: Real, period: float) -> bytes:
    return csv_table("time [s],position [mm]", period, 1e3 * np.asarray(values))
