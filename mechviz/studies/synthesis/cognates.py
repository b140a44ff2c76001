"""Cognates: the two other four-bars that draw the curve of a scene's coupler point (Roberts and Chebyshev)."""

from __future__ import annotations

import numpy as np

from mechcore.design.four_bars import FourBar, cross, from_pins
from mechcore.errors import Fault, MechanismError
from mechcore.motion.metrics import grashof
from mechcore.spec.mechanism import Revolute
from mechviz.runs import Run
from mechviz.studies.synthesis.four_bars import four_bar_lengths
from mechviz.studies.synthesis.linkages import MM, SPEED, four_bar_scene
from mechviz.studies.synthesis.solutions import Solution


def traced_four_bar(run: Run) -> tuple[FourBar, float]:
    """The four-bar of a run with its traced coupler point, and its crank angle at the start [rad]. Raises `MechanismError` where
    there is none, or several."""
    motion, mechanism = run.motion, run.motion.mechanism
    loops = [loop.joints for loop in grashof(motion.model)]
    if len(loops) != 1:
        why = f"the scene has {len(loops) or 'no'} four-bar loop{'s' if loops else ''}."
        raise MechanismError(Fault("joints", why, "Give a four-bar with revolute joints."))
    joints = {j.name: j for j in mechanism.joints if j.name in loops[0] and isinstance(j, Revolute)}
    driven = [d.joint for d in mechanism.drives]
    fixed = sorted((n for n, j in joints.items() if mechanism.frame in j.links), key=lambda n: n not in driven)
    if len(fixed) != 2:
        raise MechanismError(Fault("joints", "no link of the four-bar loop is fixed.", "Give a four-bar on the fixed link."))
    arms = [next(link for link in joints[n].links if link != mechanism.frame) for n in fixed]
    pins = [next(n for n, j in joints.items() if arm in j.links and n not in fixed) for arm in arms]
    coupler = next(link for link in joints[pins[0]].links if link not in arms)
    points = [point for link, point in mechanism.traced if link == coupler]
    if not points:
        raise MechanismError(Fault("trace", f"no point of {coupler} is traced.", f'Trace one: trace = ["{coupler}.E"].'))

    def place(joint: str) -> complex:
        return complex(*motion.point(joints[joint].links[0], joints[joint].points[0])[0])

    o2, o4, a, b = (place(n) for n in (*fixed, *pins))
    return from_pins(o2, o4, a, b, complex(*motion.point(coupler, points[0])[0])), float(np.angle(a - o2))


def cognate_solutions(bar: FourBar, theta: float) -> list[Solution]:
    """The cognates of a four-bar in the assembly mode that it has at a crank angle [rad]. The second one's crank turns as that of
    the four-bar does; in the first it is the coupler that does, so that a drive turns that against its crank."""
    out = []
    for k, (made, pin) in enumerate(zip(bar.cognates(theta), bar.cognate_pins(theta), strict=True), 1):
        begin = float(np.angle(pin[0] - made.crank_pivot))
        joint = "B" if k == 1 else "A"
        start = float(np.angle((pin[1] - pin[0]) / (pin[0] - made.crank_pivot))) if k == 1 else begin
        drive = {"speed": SPEED, "start": float(np.degrees(start))} | ({} if bar.crank_turns else {"range": "reachable"})
        scene = four_bar_scene(
            made, drive, name=f"cognate-{k}", title=f"Cognate {k} of a four-bar", driven=joint,
            side=int(np.sign(cross(made.rocker_pivot - made.crank_pivot, pin[1] - made.crank_pivot))) if k == 1 else 0,
            teaches="Three four-bars draw every coupler curve (Roberts and Chebyshev). This one draws that of the four-bar from "
            "which it was made.",
        )  # fmt: skip
        pivots = (("A", made.crank_pivot), ("D", made.rocker_pivot))
        numbers = {f"{name} [mm]": f"({z.real * MM:.5g}, {z.imag * MM:.5g})" for name, z in pivots} | four_bar_lengths(made)
        out.append(Solution(scene, numbers | {"driven at": joint, "type": made.grashof.value}))
    return out
