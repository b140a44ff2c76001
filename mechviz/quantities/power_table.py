"""The power table as text for a terminal, as Markdown and as CSV; flywheels and steady runs as text."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mechcore.forces.kinetostatics import Forces
from mechcore.forces.powers import Flywheel, PowerTable, drive_shares, power_table, thinning_change
from mechviz.files import replacing

if TYPE_CHECKING:
    from mechcore.dynamics.rest.steady import SizedFlywheel, SteadyRun
    from mechviz.scene.units import Units


ROUND_OFF = 1e-9  # of a run's duration
MOST_CHANGE = 0.05  # change of the works where every second frame is left out: their error is then about two per cent
LEAST_MEAN = 1e-9  # relative to the mean supplied power: a smaller mean power is rounding
CLOSED = 1e-6  # relative closure of the works above which powers are rounding or unknown
_HEADS = ("force", "cause", "place", "power is", "use", "mean [W]", "peak [W]", "supplies [J]", "absorbs [J]")


def _rows(table: PowerTable) -> list[tuple[str, ...]]:
    nothing = 1e-12 * max(table.supplied, table.absorbed, 1e-300)

    def number(value: float, least: float = 0.0) -> str:
        return "-" if np.isnan(value) else "0" if abs(value) <= least else f"{value:.5g}"

    span = float(np.ptp(table.time)) or 1.0
    rows = [
        (
            i.label,
            i.cause,
            i.place,
            i.role,
            i.use or "-",
            number(i.mean, LEAST_MEAN * table.supplied / span),
            number(i.peak, 0.0 if i.role != "idle" else np.inf),
            *(number(work if i.role != "unknown" else np.nan, nothing) for work in (i.supplied, i.absorbed)),
        )
        for i in table.items
    ]
    mean = (table.supplied - table.absorbed) / span
    return [
        *rows,
        (
            "sum",
            "",
            "",
            "",
            "",
            number(mean, LEAST_MEAN * table.supplied / span),
            "",
            number(table.supplied),
            number(table.absorbed),
        ),
    ]


def _closing(table: PowerTable) -> str:
    if any(np.isnan(i.power).any() for i in table.items):
        return "Where a power is unknown (the mechanism jams or is singular there) no work is counted: the works need not close."
    return f"What is supplied is absorbed: the works close to {table.closure:.1e} of what is supplied."


def _resolution(table: PowerTable) -> Iterator[str]:
    """A warning where the frames are too few for works and peaks. There is none where the works do not close, as the powers are
    then rounding or unknown."""
    change = thinning_change(table)
    if np.isinf(change):
        yield f"{len(table.frames) - 1} frames are too few for works and peaks: give more with --frames."
    elif change > MOST_CHANGE and table.closure < CLOSED:
        words = f"without every second one works change by {100.0 * change:.2g} % of what is supplied"
        yield f"The frames are too few for works and peaks: {words}. Give more with --frames."


def force_lines(forces: Forces) -> list[str]:
    """The power table as lines of text: each force with its classes and its work over the run, then the intervals in which each
    drive delivers power."""
    table = power_table(forces)
    rows = [_HEADS, *_rows(table)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(_HEADS))]
    lines = [
        "  ".join(cell.ljust(w) if k < 5 else cell.rjust(w) for k, (cell, w) in enumerate(zip(row, widths, strict=True))).rstrip()
        for row in rows
    ]
    lines.insert(len(lines) - 1, "-" * len(lines[0]))
    lines += ["", _closing(table), *_resolution(table), ""]
    least = ROUND_OFF * float(np.ptp(forces.motion.time))
    for share in drive_shares(table):
        if np.isnan(share.power).all():
            lines.append(f"drive {share.joint}: its power is unknown throughout")
            continue
        when = ", ".join(f"from {a if abs(a) > least else 0.0:.4g} to {b:.4g} s" for a, b in share.delivers[:6]) or "never"
        more = f" and {len(share.delivers) - 6} times more" if len(share.delivers) > 6 else ""
        lines.append(
            f"drive {share.joint} delivers power {when}{more}: {share.supplied:.5g} J in all, and takes back {share.absorbed:.5g} J"
        )
    return lines


def flywheel_lines(wheel: Flywheel, units: Units) -> list[str]:
    """A sized flywheel as lines of text."""
    return [
        f"flywheel: {units.text(wheel.inertia, 'kg m^2')} for a coefficient of fluctuation of {wheel.fluctuation:g}",
        f"  mean torque {units.text(wheel.mean, 'N m')}; excess work {wheel.excess:.5g} J between the slowest place, "
        f"{units.text(wheel.slowest, 'rad')}, and the fastest, {units.text(wheel.fastest, 'rad')}",
    ]


def steady_lines(run: SteadyRun) -> list[str]:
    """A steady-state run as lines of text."""
    turns = f"{run.turns} turn{'s' * (run.turns > 1)}"
    multiplier = abs(run.multiplier)
    change = (
        "does not change from cycle to cycle"
        if abs(multiplier - 1.0) < 1e-9
        else f"is multiplied by {multiplier:.3g} in every cycle"
    )
    mean, least, greatest = (x * 30.0 / np.pi for x in (run.sense * run.mean, run.least, run.greatest))
    return [
        f"steady run over {turns}: mean speed {mean:.6g} rpm, from {least:.6g} to {greatest:.6g} rpm, coefficient of fluctuation "
        f"{run.fluctuation:.4g}",
        f"a cycle takes {run.period:.6g} s; a small change of the kinetic energy {change}",
    ]


def sized_lines(wheel: SizedFlywheel, units: Units) -> list[str]:
    """The flywheel that a steady-state run needs, as lines of text."""
    if wheel.inertia == 0.0:
        return [f"flywheel: none needed, {wheel.link} has a coefficient of fluctuation of {wheel.run.fluctuation:.4g} without one"]
    more = units.text(wheel.inertia, "kg m^2")
    return [f"flywheel: {more} more on {wheel.link}; with it: {steady_lines(wheel.run)[0]}"]


def power_markdown(table: PowerTable) -> list[str]:
    """The power table as lines of Markdown."""
    lines = ["## Powers", "", f"| {' | '.join(_HEADS)} |", f"|{'---|' * len(_HEADS)}"]
    lines += [f"| {' | '.join(row)} |" for row in _rows(table)]
    return [*lines, "", _closing(table)]


def power_csv(forces: Forces, path: Path) -> Path:
    """Write the power table to a CSV file, numbers in full precision; returns the path."""
    with replacing(path) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        out = csv.writer(file)
        out.writerow(["force", "kind", "cause", "place", "role", "use", "mean [W]", "peak [W]", "supplied [J]", "absorbed [J]"])
        for i in power_table(forces).items:
            out.writerow([i.name, i.kind, i.cause, i.place, i.role, i.use, *map(repr, (i.mean, i.peak, i.supplied, i.absorbed))])
    return path
