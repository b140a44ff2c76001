"""Whether the results of a run can be trusted: loads that are finite, a balance, a closure and estimated errors that are small."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechcore.errors import Fault, MechanismError

if TYPE_CHECKING:
    from mechviz.runs import Run

SUMS = ("closure", "power balance", "energy drift")  # a large condition number alone is an event, no fault
LARGEST_ERROR = 0.1  # estimated, relative; of all but what is read between frames
MEANINGS = {
    "closure": "the loops do not close",
    "power balance": "the powers supplied and absorbed do not balance",
    "energy drift": "the energy is not conserved",
}


def check_finite(run: Run) -> None:
    """Refuses a run whose loads are not finite where nothing jams. Raises `MechanismError` with each of them."""
    if run.forces is None:
        return
    moves, time, faults = _moves(run), run.motion.time, []
    stated = {f"links.{x.links[0]}" if x.kind == "gravity" else f"loads.{name}": x.values for name, x in run.forces.loads.items()}
    inertia = {f"links.{link}": run.forces.inertia(link) for link in run.motion.model.links}
    for what, known in (("force", stated), ("inertia force", inertia)):
        for path, values in known.items():
            lost = np.flatnonzero(moves & ~np.isfinite(values[:, :3]).all(axis=1))
            if len(lost):
                words = f"its {what} is no finite number at {len(lost)} of {len(time)} frames, first at {time[lost[0]]:.6g} s."
                faults.append(Fault(path, words, "Check its values: one of them is beyond what can be computed with."))
    if faults:
        raise MechanismError(faults)


def doubts(run: Run, *, errors: bool = False) -> list[str]:
    """Why the results of a run cannot be trusted, a sentence each; none where they can. ``errors``: also where its estimated errors
    are large, which of a motion under forces takes a second run."""
    return [*_bad_sums(run), *(_large_errors(run) if errors else ())]


def _bad_sums(run: Run) -> Iterator[str]:
    moves = _moves(run)
    for health in run.catalogue.health:
        if health.name in SUMS:
            size = np.abs(health.values[moves])
            worst = float(np.max(size, initial=0.0)) if np.isfinite(size).all() else np.nan
            if not worst < health.bad:
                unit = "" if health.unit == "1" else f" {health.unit}"
                said = f"it reaches {worst:.3g}{unit}" if np.isfinite(worst) else "it is no finite number"
                yield f"{MEANINGS[health.name]}: {health.name}, {said}, of at most {health.bad:.3g}{unit}."


def _large_errors(run: Run) -> Iterator[str]:
    for name, error in run.errors.worst().items():
        if name != "between_frames" and not error < LARGEST_ERROR and not np.isnan(error):
            yield f"the estimated error of the {name} is {error:.2g} of its largest value."


def _moves(run: Run) -> NDArray[np.bool_]:
    """Frames (F,) at which nothing jams."""
    friction = None if run.forces is None else run.forces.friction
    jammed = np.zeros(len(run.motion.time), bool) if friction is None else np.asarray(friction.jammed)
    return ~jammed
