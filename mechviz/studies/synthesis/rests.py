"""Linkages that rest and lids that stay: dwell six-bars and balancing springs as solutions."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mechcore.design.dwells import DwellLinkage
from mechcore.design.springs import LidSpring, LidTask
from mechviz.scene.scene import Scene
from mechviz.studies.synthesis.linkages import MM, SPEED, four_bar_parts, place, to_and_fro
from mechviz.studies.synthesis.solutions import Solution


def dwell_solutions(linkages: Sequence[DwellLinkage], crank: float, dwell: float) -> list[Solution]:
    """Dwell linkages as solutions, with a crank of some length [m]."""
    out = []
    for k, made in enumerate(linkages):
        bar = made.four_bar.scaled(crank)
        links, joints = four_bar_parts(bar, {"speed": SPEED, "start": math.degrees(made.start)}, traced=True)
        links["frame"]["points"]["G"] = place(made.pivot * crank)
        links["link"] = {"points": {"E": [0, 0], "F": [made.link * crank * MM, 0]}}
        links["lever"] = {"points": {"G": [0, 0], "F": [made.lever * crank * MM, 0]}}
        joints["E"] = {"revolute": ["coupler", "link"]}
        joints["F"] = {"revolute": ["link", "lever"], "side": "left" if made.side > 0 else "right"}
        joints["G"] = {"revolute": ["lever", "frame"]}
        drift, swing = np.degrees(made.drift), np.degrees(made.swing)
        scene = Scene.build(
            name=f"dwell-{k + 1}", title=f"Six-bar with a dwell over {np.degrees(dwell):g} deg of its crank", trace=["coupler.E"],
            teaches=f"While the coupler point E runs nearly on a circle about F, the lever rests: it drifts by {drift:.2g} "
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
        out.append(Solution(scene, numbers))
    return out


def lid_solutions(task: LidTask, springs: Sequence[LidSpring]) -> list[Solution]:
    """Balancing springs as solutions: the drive of the hinge is what the hand has to do, times its distance."""
    out = []
    for k, made in enumerate(springs):
        scene = Scene.build(
            name=f"lid-{k + 1}",
            title="Lid that a spring balances",
            teaches=f"The spring carries the lid: the hand needs {task.effort:g} N, within {made.error:.3g} N, instead of up to "
            f"{task.mass * task.gravity * task.arm / task.hand:.3g} N.",
            units={"length": "mm", "angle": "deg"},
            effects=["gravity"],
            gravity=[0, -task.gravity],
            links={
                "frame": {"points": {"O": [0, 0], "P": place(made.frame_point)}},
                "lid": {
                    "points": {"O": [0, 0], "Q": place(made.lid_point), "H": [task.hand * MM, 0]},
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
        out.append(Solution(scene, numbers))
    return out
