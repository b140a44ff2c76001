"""Path generation: solutions with four-bars through points or along a drawn curve, and the two cognates of a scene's four-bar,
which generate the same coupler curve (Roberts and Chebyshev)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mechcore.arrays import Complex
from mechcore.design.four_bars import FourBar, from_pins
from mechcore.design.paths import PathDesign, PathTask, path_designs, relative_difference
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.dyads import cross
from mechcore.motion.metrics import grashof
from mechcore.spec.mechanism import Revolute
from mechviz.runs import Run
from mechviz.scene.scene import Scene
from mechviz.studies.synthesis.four_bars import four_bar_lengths, four_bar_marks
from mechviz.studies.synthesis.linkages import MM, SPEED, LinkageSolution, four_bar_scene, through

EXACT_MISS = 1e-9  # relative to the size of a path: with a smaller error a coupler curve passes exactly through its points
DRAWN_POINTS = 20  # points that represent a drawn curve, at equal distances along it
CLOSED_GAP = 0.1  # gap between the ends of a drawn curve, relative to its length, below which it counts as closed
MOST_OFFERED = 6  # largest number of four-bars offered for a drawn curve
LONGEST_LINK = 6.0  # relative to a drawn curve's size: longest link, and farthest pivots and coupler point
SHORTEST_LINK = 0.1  # relative to a drawn curve's size: shortest link
AT_PIN = 1e-9  # relative to a coupler's length: distance of a traced point from a pin up to which it is there
DIFFERENT_LENGTHS = 0.02  # least relative difference of the lengths of two four-bars that are both offered


def ranked_paths(designs: Sequence[PathDesign], points: Complex) -> list[PathDesign]:
    """Designs, the best first: those that pass exactly through the points, by transmission angle, then the others, by error."""
    size = float(np.abs(points - points.mean()).max())

    def rank(made: PathDesign) -> tuple[float, float]:
        return (0.0, -made.four_bar.least_transmission()) if made.largest < EXACT_MISS * size else (made.error, 0.0)

    return sorted(designs, key=rank)


def path_solutions(designs: Sequence[PathDesign], points: Complex) -> list[LinkageSolution]:
    """Solutions: four-bars whose coupler points pass through points (K,) [m]."""
    out = []
    for k, made in enumerate(designs):
        drive = through(made.four_bar, made.theta, usable=True)
        scene = four_bar_scene(
            made.four_bar, drive, name=f"path-{k + 1}", title=f"Four-bar through {len(points)} points",
            marks={f"P{i + 1}": complex(z) for i, z in enumerate(points)},
            learning_goal=f"The coupler point E passes {len(points)} points of the frame, P1 and so on, at most "
            f"{made.largest * MM:.3g} mm away.",
        )  # fmt: skip
        rms = np.sqrt(made.error / len(points)) * MM
        out.append(
            LinkageSolution(
                scene,
                four_bar_lengths(made.four_bar)
                | {
                    "rms [mm]": f"{rms:.4g}",
                    "largest [mm]": f"{made.largest * MM:.4g}",
                    "transmission [deg]": f"{np.degrees(made.four_bar.least_transmission()):.1f}",
                },
            )
        )
    return out


def drawn_points(stroke: Complex) -> Complex:
    """Points (20,) [m] at equal distances along a curve that was drawn through places (N,) [m], rounded to about 1e-4 of its
    length. The last point equals the first where the curve ends near its start. Raises `MechanismError` where nothing was drawn."""
    line = stroke[np.isfinite(stroke)]
    length = float(np.abs(np.diff(line)).sum())
    if len(line) < 3 or length == 0.0:
        raise MechanismError(Fault("curve", "the curve has no length.", "Draw it with the mouse button held down."))
    if abs(line[-1] - line[0]) < CLOSED_GAP * length:
        line = np.append(line, line[0])
    along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(line)))])
    grid = 10.0 ** np.floor(np.log10(1e-4 * length))
    even = np.interp(np.linspace(0.0, along[-1], DRAWN_POINTS), along, line) / grid
    points: Complex = (even.real.round() + 1j * even.imag.round()) * grid
    return points


def path_in(scene: Scene) -> Complex | None:
    """The task points (K,) [m] of a scene from `path_solutions`, in order; None for any other scene."""
    points = four_bar_marks(scene)
    if "Q1" in points:
        return None
    count = next(k for k in range(len(points) + 1) if f"P{k + 1}" not in points)
    return np.array([points[f"P{k + 1}"] for k in range(count)]) if count >= 3 else None


def path_choices(points: Complex, most: int = MOST_OFFERED) -> list[PathDesign]:
    """Up to ``most`` four-bars of limited size whose coupler points pass through points (K,) [m] without prescribed timing, the
    best first. They differ from each other in their lengths. Raises `MechanismError` where there is none."""
    kept: list[PathDesign] = []
    size = PathTask(points).size
    task = PathTask(
        points, lengths=(SHORTEST_LINK * size, LONGEST_LINK * size), farthest=float(np.abs(points).max()) + LONGEST_LINK * size
    )
    for one in ranked_paths(path_designs(task), points):
        if len(kept) < most and all(relative_difference(one, other) > DIFFERENT_LENGTHS for other in kept):
            kept.append(one)
    if not kept:
        why = "no four-bar whose crank turns fully draws this curve in its order."
        raise MechanismError(Fault("curve", why, "Draw a rounder one, or one with fewer turns."))
    return kept


def traced_four_bar(run: Run) -> tuple[FourBar, float]:
    """The four-bar of a run with its traced coupler point, and its crank angle at the start [rad]. Raises `MechanismError` where
    the run has no such four-bar, or several."""
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
    traced = complex(*motion.point(coupler, points[0])[0])
    for pin, z in zip(pins, (a, b), strict=True):
        if abs(traced - z) <= AT_PIN * abs(b - a):
            why = f"{coupler}.{points[0]} is at the pin {pin} and draws a circle: its cognates would have links of no length."
            raise MechanismError(Fault("trace", why, f"Trace another point of {coupler}."))
    return from_pins(o2, o4, a, b, traced), float(np.angle(a - o2))


def cognate_solutions(bar: FourBar, theta: float) -> list[LinkageSolution]:
    """Solutions: the two cognates of a four-bar in its assembly mode at a crank angle ``theta`` [rad].

    In the second cognate the crank rotates like the crank of the four-bar. In the first its crank rotates like the coupler of the
    four-bar, and its coupler like the crank: where its own crank does not turn fully, the drive acts between both (joint B)."""
    out = []
    for k, (made, pin) in enumerate(zip(bar.cognates(theta), bar.cognate_pins(theta), strict=True), 1):
        begin = float(np.angle(pin[0] - made.crank_pivot))
        joint = "B" if k == 1 and not made.crank_turns else "A"
        start = float(np.angle((pin[1] - pin[0]) / (pin[0] - made.crank_pivot))) if joint == "B" else begin
        turns = made.crank_turns or bar.crank_turns
        drive = {"speed": SPEED, "start": float(np.degrees(start))} | ({} if turns else {"range": "reachable"})
        scene = four_bar_scene(
            made, drive, name=f"cognate-{k}", title=f"Cognate {k} of a four-bar", driven=joint,
            side=int(np.sign(cross(made.rocker_pivot - made.crank_pivot, pin[1] - made.crank_pivot))) if joint == "B" else 0,
            learning_goal="Three four-bars draw every coupler curve (Roberts and "
            "Chebyshev). This one draws that of the four-bar from "
            "which it was made.",
        )  # fmt: skip
        pivots = (("A", made.crank_pivot), ("D", made.rocker_pivot))
        numbers = {f"{name} [mm]": f"({z.real * MM:.5g}, {z.imag * MM:.5g})" for name, z in pivots} | four_bar_lengths(made)
        out.append(LinkageSolution(scene, numbers | {"driven at": joint, "type": made.grashof.value}))
    return out
