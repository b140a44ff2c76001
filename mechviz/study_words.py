"""The results of a run's studies in sentences, for the notes of a recording and for people."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .run import Run

__all__ = ["study_lines"]


def study_lines(run: Run) -> list[str]:
    """One line for each result; none where nothing was asked for."""
    return list(_lines(run))


def _lines(run: Run) -> Iterator[str]:
    studies = run.studies
    for name, plans in studies.plans.items():
        worst = max(float(np.nanmax(plan.closing, initial=0.0)) for plan in plans)
        if not any(plan.edges for plan in plans):
            yield f"{name} plan: empty, no pin and no traced point moves"
            continue
        yield f"{name} plan: closes to {worst:.1e} of its longest side"
    for name, chain in studies.equivalents.items():
        bars = ", ".join("".join(ends) for ends in chain.bars) or "no bar"
        sliding = f" and {len(chain.blocks)} sliding block{'s' if len(chain.blocks) > 1 else ''}" if chain.blocks else ""
        yield f"equivalent linkage of {name}: {bars}{sliding}; it moves like the pair, up to accelerations"
    for name, system in studies.systems.items():
        kinds = sorted(set(map(str, system.drawing.kind)))
        worst = float(np.nanmax(system.drawing.closing, initial=0.0))
        yield f"force system {name}: {' or '.join(kinds)}; the drawing agrees with the algebra to {worst:.1e}"
    for name, r in studies.reduced.items():
        good = r.mass[np.isfinite(r.mass)]
        unit = "kg m²" if r.point is None else "kg"
        if len(good):
            yield f"reduced to {name}: {good.min():.5g} to {good.max():.5g} {unit}"
    for what, s in (("shaking force", studies.shaking), ("with counterweights", studies.balanced)):
        if s is not None:
            yield f"{what}: peak {s.peak:.5g} N, rms {s.rms:.5g} N; moment peak {s.peak_moment:.5g} N m, rms {s.rms_moment:.5g} N m"
    for w in studies.weights:
        yield f"counterweight on {w.link}: {w.mass:.5g} kg at ({w.at[0]:.5g}, {w.at[1]:.5g}) m of its frame"
    for name, body in studies.substitutes.items():
        masses = ", ".join(f"{m:.5g} kg" for m in body.masses)
        if body.correction is not None:
            most = float(np.abs(body.correction).max(initial=0.0))
            yield f"static replacement of {name}: {masses}, with a correction couple of up to {most:.5g} N m"
            continue
        yield f"substitute masses of {name}: {body.found.message}; shown is solution {body.chosen + 1}: {masses}"
