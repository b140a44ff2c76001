"""Solutions for strokes, swings, straight lines, dwells (six-bars), and springs that balance lids."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mechcore.design.dwells import DwellLinkage
from mechcore.design.four_bars import FourBar
from mechcore.design.freudenstein import FunctionTask, SliderGenerator
from mechcore.design.springs import LidSpring, LidTask
from mechcore.design.strokes import STRAIGHT_LINES, SliderCrank, SlottedLever, StraightLine, Whitworth, hoecken, straightness
from mechcore.errors import Fault, MechanismError
from mechviz.scene.faults import did_you_mean
from mechviz.scene.scene import Scene
from mechviz.studies.synthesis.four_bars import four_bar_lengths
from mechviz.studies.synthesis.linkages import (
    MM,
    SPEED,
    LinkageSolution,
    four_bar_parts,
    four_bar_scene,
    once,
    place_mm,
    slider_crank_scene,
    slotted_lever_scene,
    to_and_fro,
    whitworth_scene,
)

PATH_SAMPLES = 361  # places at which the structural error is sampled
QUICK = "At constant speed of the crank the way back takes less time than the way out, by the angle between the dead lines."


def slider_crank_solution(made: SliderCrank, stroke: float, ratio: float) -> LinkageSolution:
    """Solution: a slider-crank with a stroke [m] and a time ratio."""
    scene = slider_crank_scene(
        made.crank, made.rod, made.offset, {"speed": SPEED}, name="stroke", learning_goal=QUICK,
        title=f"Slider-crank with a stroke of {stroke * MM:g} mm and a time ratio of {ratio:g}",
    )  # fmt: skip
    numbers = {
        "crank [mm]": f"{made.crank * MM:.6g}",
        "rod [mm]": f"{made.rod * MM:.6g}",
        "offset [mm]": f"{made.offset * MM:.6g}",
        "pressure angle [deg]": f"{np.degrees(made.pressure_angle):.2f}",
    }
    return LinkageSolution(scene, numbers, "" if made.turns else "the crank does not turn fully")


def slider_function_solution(task: FunctionTask, made: SliderGenerator, words: str) -> LinkageSolution:
    """Solution: a slider-crank whose slider displacement follows a function of the crank angle; ``words`` describe the function."""
    x = np.linspace(task.start, task.end, PATH_SAMPLES)
    turned, wanted = task.turned(x)
    errors = made.displacements(made.input_start + turned) - made.output_start - wanted
    runs = bool(np.isfinite(errors).all())
    first = made.input_start
    drive = (
        once(first, first + task.input_range) if runs else {"speed": SPEED, "range": "reachable", "start": float(np.degrees(first))}
    )
    scene = slider_crank_scene(
        made.crank, made.rod, made.offset, drive, name="slider", ahead=made.side > 0, title=f"Slider-crank that follows {words}",
        learning_goal=f"The slider's displacement follows {words} of the crank's angle, exactly "
        "at its precision points and nearly between them.",
    )  # fmt: skip
    numbers = {
        "crank [mm]": f"{made.crank * MM:.6g}",
        "rod [mm]": f"{made.rod * MM:.6g}",
        "offset [mm]": f"{made.offset * MM:.6g}",
        "largest error [mm]": f"{errors[np.abs(errors).argmax()] * MM:.4g}" if runs else "-",
    }
    return LinkageSolution(scene, numbers, "branch" if made.branch else "" if runs else "does not run through")


def slotted_lever_solution(made: SlottedLever, stroke: float, ratio: float) -> LinkageSolution:
    """Solution: a slotted lever whose end has a stroke [m] and a time ratio."""
    title = f"Slotted lever with a stroke of {stroke * MM:g} mm and a time ratio of {ratio:g}"
    numbers = {
        "crank [mm]": f"{made.crank * MM:.6g}",
        "pivots apart [mm]": f"{made.frame * MM:.6g}",
        "lever [mm]": f"{made.lever * MM:.6g}",
        "swing [deg]": f"{np.degrees(made.swing):.4g}",
    }
    return LinkageSolution(slotted_lever_scene(made, name="stroke", title=title, learning_goal=QUICK), numbers)


def whitworth_solution(made: Whitworth, stroke: float, ratio: float) -> LinkageSolution:
    """Solution: a Whitworth quick-return mechanism with a stroke [m] and a time ratio."""
    title = f"Whitworth's quick return with a stroke of {stroke * MM:g} mm and a time ratio of {ratio:g}"
    learning_goal = "The lever turns fully, faster on the side of the crank's pivot: the slider returns quickly."
    numbers = {
        "crank [mm]": f"{made.crank * MM:.6g}",
        "pivots apart [mm]": f"{made.frame * MM:.6g}",
        "arm [mm]": f"{made.arm * MM:.6g}",
        "rod [mm]": f"{made.rod * MM:.6g}",
    }
    return LinkageSolution(whitworth_scene(made, name="stroke", title=title, learning_goal=learning_goal), numbers)


def crank_rocker_solution(made: FourBar, swing: float, ratio: float) -> LinkageSolution:
    """Solution: a crank-rocker with a swing angle [rad] and a time ratio."""
    scene = four_bar_scene(
        made, {"speed": SPEED}, name="swing", learning_goal=QUICK, traced=False,
        title=f"Crank-rocker with a swing of {np.degrees(swing):g} deg and a time ratio of {ratio:g}",
    )  # fmt: skip
    return LinkageSolution(scene, four_bar_lengths(made) | {"transmission [deg]": f"{np.degrees(made.least_transmission()):.2f}"})


def straight_line_solutions(names: list[str], travel: float, straight: float | None) -> list[LinkageSolution]:
    """Solutions: straight-line linkages by name (all without names), scaled to a travel [m]; ``straight``: crank range [rad] for
    which Hoecken's linkage is designed. Raises `MechanismError`."""
    for name in names:
        if name not in STRAIGHT_LINES:
            raise MechanismError(Fault("name", f"there is no straight line of '{name}'.", did_you_mean(name, STRAIGHT_LINES)))
    if straight is not None and not 0.0 < straight <= np.radians(240.0):
        raise MechanismError(
            Fault("range", f"{np.degrees(straight):g} deg of the crank.", "Give more than 0 and at most 240 degrees.")
        )
    lines = {name: STRAIGHT_LINES[name] for name in (names or STRAIGHT_LINES)}
    if straight is not None:
        lines = {name: hoecken(straight) if name == "hoecken" else line for name, line in lines.items()}
    return [_straight_line(name, line, travel) for name, line in lines.items()]


def _straight_line(name: str, line: StraightLine, travel: float) -> LinkageSolution:
    measured = straightness(line)
    bar = line.four_bar.scaled(travel / measured.travel)
    drive = {"speed": SPEED} if bar.crank_turns else to_and_fro(line.start, line.end)
    scene = four_bar_scene(
        bar, drive, name=name, title=f"Straight line of {name.capitalize()}",
        learning_goal=f"Point E runs {travel * MM:g} mm on a nearly straight line, within "
        f"{measured.ratio * travel * MM:.3g} mm: {line.about}.",
    )  # fmt: skip
    numbers = {"name": name} | four_bar_lengths(bar) | {
        "crank from [deg]": f"{np.degrees(line.start):.4g}",
        "to [deg]": f"{np.degrees(line.end):.4g}",
        "width [mm]": f"{measured.ratio * travel * MM:.4g}",
        "width/travel": f"{measured.ratio:.3g}",
    }  # fmt: skip
    return LinkageSolution(scene, numbers)


def dwell_solutions(linkages: Sequence[DwellLinkage], crank: float, dwell: float) -> list[LinkageSolution]:
    """Solutions: dwell linkages, scaled to a ``crank`` length [m]; ``dwell``: crank angle of the dwell [rad], for the title."""
    out = []
    for k, made in enumerate(linkages):
        bar = made.four_bar.scaled(crank)
        links, joints = four_bar_parts(bar, {"speed": SPEED, "start": math.degrees(made.start)}, traced=True)
        links["frame"]["points"]["G"] = place_mm(made.pivot * crank)
        links["link"] = {"points": {"E": [0, 0], "F": [made.link * crank * MM, 0]}}
        links["lever"] = {"points": {"G": [0, 0], "F": [made.lever * crank * MM, 0]}}
        joints["E"] = {"revolute": ["coupler", "link"]}
        joints["F"] = {"revolute": ["link", "lever"], "side": "left" if made.side > 0 else "right"}
        joints["G"] = {"revolute": ["lever", "frame"]}
        drift, swing = np.degrees(made.drift), np.degrees(made.swing)
        scene = Scene.build(
            name=f"dwell-{k + 1}", title=f"Six-bar with a dwell over {np.degrees(dwell):g} deg of its crank", trace=["coupler.E"],
            learning_goal=f"While the coupler point E runs nearly on a circle about F, the lever rests: it drifts by {drift:.2g} "
            f"deg of its swing of {swing:.3g} deg.",
            units={"length": "mm", "angle": "deg"}, links=links, joints=joints,
        )  # fmt: skip
        lengths = {
            "frame": bar.frame,
            "coupler": bar.coupler,
            "rocker": bar.rocker,
            "link": made.link * crank,
            "lever": made.lever * crank,
        }
        numbers = {f"{name} [mm]": f"{value * MM:.5g}" for name, value in lengths.items()}
        numbers |= {
            "rests from [deg]": f"{math.degrees(made.start):.4g}",
            "swing [deg]": f"{swing:.4g}",
            "drift [deg]": f"{drift:.3g}",
        }
        out.append(LinkageSolution(scene, numbers))
    return out


def lid_solutions(task: LidTask, springs: Sequence[LidSpring]) -> list[LinkageSolution]:
    """Solutions: springs that balance a lid. The driving torque of the hinge is the force of the hand times its distance from
    it."""
    out = []
    for k, made in enumerate(springs):
        scene = Scene.build(
            name=f"lid-{k + 1}",
            title="Lid that a spring balances",
            learning_goal=f"The spring carries the lid: the hand needs {task.effort:g} N, "
            f"within {made.error:.3g} N, instead of up to "
            f"{task.mass * task.gravity * task.arm / task.hand:.3g} N.",
            units={"length": "mm", "angle": "deg"},
            effects=["gravity"],
            gravity=[0, -task.gravity],
            links={
                "frame": {"points": {"O": [0, 0], "P": place_mm(made.frame_point)}},
                "lid": {
                    "points": {"O": [0, 0], "Q": place_mm(made.lid_point), "H": [task.hand * MM, 0]},
                    "mass": f"{task.mass!r} kg",
                    "centre": [task.arm * MM, 0],
                },
            },
            joints={"O": {"revolute": ["frame", "lid"], "drive": to_and_fro(task.start, task.end)}},
            loads={
                "spring": {
                    "spring": ["frame.P", "lid.Q"],
                    "stiffness": f"{made.stiffness / MM!r} N/mm",
                    "free_length": made.free_length * MM,
                }
            },
        )
        lengths = made.lengths(np.linspace(task.start, task.end, 181))
        p, q = made.frame_point * MM, made.lid_point * MM
        numbers = {
            "P [mm]": f"({p.real:.4g}, {p.imag:.4g})",
            "Q on the lid [mm]": f"({q.real:.4g}, {q.imag:.4g})",
            "stiffness [N/mm]": f"{made.stiffness / MM:.4g}",
            "free [mm]": f"{made.free_length * MM:.4g}",
            "length from [mm]": f"{lengths.min() * MM:.4g}",
            "to [mm]": f"{lengths.max() * MM:.4g}",
            "hand off by [N]": f"{made.error:.3g}",
        }
        out.append(LinkageSolution(scene, numbers))
    return out
