"""Losses by dry friction over a run: mean power of each joint, and the efficiency."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from mechcore.arrays import Real
from mechcore.effects.base import LOSSES
from mechcore.forces.instants import instants
from mechcore.forces.kinetostatics import Forces
from mechcore.records import dataclass

LEAST_USE = 1e-4  # part of the work that loads exchange in a run: less useful work counts as zero


@dataclass(frozen=True)
class RunLosses:
    """``mean`` power [W] that friction takes in each joint over a run.

    ``efficiency``: useful over supplied energy of the run: the useful energy is that of the loads where the drives drive, that of
    the drives where the loads do. Energy that harmful loads absorb is not useful: those of viscous friction, of a medium, and those
    stated as harmful. Zero where all supplied energy is lost, NaN where the mechanism jams.
    """

    mean: Mapping[str, float]
    efficiency: float


def losses_of_run(forces: Forces) -> RunLosses:
    """The losses of a run with friction, by straight lines from frame to frame and up to either side of jumps of the powers."""
    at = instants(forces)
    span = float(np.ptp(at.time))

    def work(power: Callable[[Forces], Real]) -> float:
        """Energy [J] of a power; of a single instant the power [W]."""
        values = at.together(*(power(part) for part in at.parts))
        return float(np.trapezoid(values, at.time)) if span > 0.0 else float(values[0])

    assert forces.friction is not None
    lost = {joint: work(partial(_friction, joint)) for joint in forces.friction.joints}
    uses = {load.name: load.use for load in forces.motion.mechanism.loads}

    def absorbed(f: Forces, *, harmful: bool = False) -> Real:
        """Power (F,) [W] that the loads, or the harmful ones of them, absorb."""
        chosen = (p for w, p in f.powers() if not harmful or (uses.get(w.name) or _use(w.cause)) == "harmful")
        return -sum(chosen, np.zeros(f.motion.frames))

    w0, loss, wasted = work(absorbed), sum(lost.values()), work(lambda f: absorbed(f, harmful=True))
    supplied, useful = (w0 + loss, w0 - wasted) if w0 >= 0.0 else (wasted - w0, -w0 - loss)
    # over whole turns the works of inertia and gravity vanish but for the discretisation by frames
    useful = useful if useful > LEAST_USE * work(lambda f: np.abs(absorbed(f))) else 0.0
    efficiency = useful / supplied if supplied > 0.0 else (1.0 if supplied == 0.0 else np.nan)
    return RunLosses({joint: energy / (span or 1.0) for joint, energy in lost.items()}, efficiency)


def _friction(joint: str, forces: Forces) -> Real:
    assert forces.friction is not None
    return forces.friction.losses(joint)


def _use(cause: str) -> str:
    return "harmful" if cause in LOSSES else ""
