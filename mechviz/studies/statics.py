"""The reactions of a mechanism that stands still, in words for a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mechcore.forces.kinetostatics import Forces
from mechviz.quantities.items import joints_of

if TYPE_CHECKING:
    from mechviz.scene.units import Units


def statics_lines(forces: Forces, units: Units) -> list[str]:
    """Reaction of every joint on its second link and effort of every drive; over time those of the frame where it is largest."""
    motion = forces.motion
    driven = [drive.pair for drive in motion.mechanism.drives]
    rows: list[tuple[str, ...]] = [("joint", "on", "Fx", "Fy", "force", "couple", "drive")]
    for joint in joints_of(motion):
        reaction = forces.reaction(joint.name)
        effort = forces.effort(joint.name) if joint.name in driven else None
        size = np.hypot(reaction[:, 0], reaction[:, 1])
        largest = int(np.argmax(size if size.any() or effort is None else np.abs(effort)))
        x, y, couple = reaction[largest]
        small = 1e-13 * float(size.max(initial=0.0))
        shown = [units.show(v if abs(v) > small else 0.0, "force") for v in (x, y, size[largest])]
        turn = units.show(couple, "torque")
        drive = "" if effort is None else units.show(effort[largest], "force" if joint.unit == "m" else "torque")
        rows.append((joint.name, joint.links[1], *shown, turn, drive))
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    when = "reactions" if motion.frames == 1 else "reactions, of each joint at the frame where it is largest"
    return [when, *("  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows)]
