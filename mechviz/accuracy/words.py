"""What a run says of a wanted error: whether it is reached, what is in the way, and the dials of what is drawn and kept."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mechviz.accuracy.estimate import integration_error
from mechviz.accuracy.fit import MOST, MOST_FRAMES, Fit
from mechviz.accuracy.kept import FINEST

if TYPE_CHECKING:
    from mechviz.runs import Run


ORDERS = {0: "held values", 1: "straight lines", 3: "cubics", 5: "quintics"}
"""How frames are joined, by the order of the interpolation."""


def target_words(run: Run) -> list[str]:
    """Lines of a run that has a target."""
    target = run.accuracy.target
    assert target is not None
    motion = [] if run.simulation is None else [_motion(run, target)]
    return [_frames(run, target), *motion, _kept(run, target)]


def _frames(run: Run, target: float) -> str:
    order, fit = ORDERS[run.accuracy.interpolation], run.fit
    if fit is None:
        stated, worst = run.motion.frames - 1, float(np.nanmax(run.errors.between, initial=0.0))
        start = f"accuracy {target:g} with the {stated} frames that are stated, joined by {order}: "
        if worst <= target:
            return start + "reached between the frames"
        return f"warning: {start}not reached: about {worst:.1e} is left between frames. Leave the number of frames to the accuracy."
    start = f"accuracy {target:g} with {fit.frames} frames joined by {order}: "
    jumps = ""
    if fit.jumps and fit.there > target:
        holds = f"{fit.jumps} intervals that hold" if fit.jumps > 1 else "one interval that holds"
        jumps = f", but in {holds} a jump or a bend: up to {fit.there:.1e} of the peak is left there, and more frames hardly help"
    if fit.error <= target:
        return f"{start}reached{jumps}"
    missed = f"warning: {start}not reached: {fit.error:.1e} is left between frames"
    if fit.needed is None:
        return f"{missed}, and more frames do not help: it is rounding{_besides(fit)}. Ask for a larger error."
    remedy = "Ask for a larger error."
    if run.accuracy.interpolation < 5:
        remedy = 'Choose interpolation = "quintic", or ask for a larger error.'
    most = f"{MOST} a cycle, {MOST_FRAMES} in all"
    return f"{missed}; about {fit.needed} frames would be needed, and no more than {most} are computed{_besides(fit)}. {remedy}"


def _besides(fit: Fit) -> str:
    """Where interpolation is not exact in any case."""
    return f"; {fit.jumps} intervals besides hold a jump or a bend, with up to {fit.there:.1e} of the peak" if fit.jumps else ""


def _motion(run: Run, target: float) -> str:
    """What the integration leaves, by its companion."""
    assert run.simulation is not None
    left = float("nan")
    if run.again is not None:
        left = float(integration_error(run.simulation, np.array([run.simulation.duration]), run.again)[0])
    if left <= target:
        return f"motion under forces: within {left:.1e}, by a run with another tolerance"
    if np.isnan(left):
        return "warning: motion under forces: no second run comes through that would tell its error"
    words = f"warning: motion under forces: about {left:.1e} is left, and smaller tolerances do not help: its positions part from"
    return f"{words} their neighbours, rounding with them. Ask for a larger error, or a shorter duration."


def _kept(run: Run, target: float) -> str:
    kept = run.kept
    assert kept.chord is not None
    relative = kept.chord / run.motion.model.length_scale
    finer = "" if relative <= target * (1 + 1e-9) else f", no finer than {FINEST:g} of the size unless chord says so"
    forces = " (links are to be in balance to 1e-8)" if run.forces is not None and kept.numbers == "float64" else ""
    every = "every recorded frame" if kept.pictures == 1 else f"every {kept.pictures}th recorded frame"
    chord = run.scene.units.show(kept.chord, "length", 3)
    return f"drawn and kept: facets within {chord}{finer}; numbers in {kept.numbers}{forces}; arrows at {every}"
