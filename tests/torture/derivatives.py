"""Exact derivatives of random mechanisms with forces, beside differences of eighth order.

    python tests/torture/derivatives.py --count 1000

takes mechanisms of every kind, every other one with dry friction, all points, masses and coefficients moved together, until so many
have been compared. A fault is one off by more than 1e-9 of a result's largest derivative (and the rounding of the differences).
What cannot be run, is next to a dead point or jams is left out; refusals are counted, and so is what differences do not decide, as
a kink lies within their shortest step.
"""

from __future__ import annotations

import os
import sys
from collections import Counter
from itertools import count
from pathlib import Path

if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is loaded: threads would only wait for each other
    sys.path[:0] = [str(Path(__file__).resolve().parents[1] / folder) for folder in ("support", "mechcore/derivatives")]

import numpy as np
from budget import Tally, options
from random_mechanisms import KINDS, draw
from test_exact import FEW, asked, difference, moved_together, solved

from mechcore.derivatives.exact import Derivatives
from mechcore.derivatives.model_numbers import Parameter
from mechcore.errors import MechanismError

STEPS = (2e-3, 3e-4, 1e-4, 3e-5, 1e-5)  # of differences: long ones may reach a place where friction or a damper turns round
ROUNDING = 100.0 * np.finfo(float).eps


def off(kind: str, seed: int) -> float | None:
    """The largest error of a mechanism's derivatives, in what is allowed; NaN where differences do not decide, None where there is
    nothing to compare. Raises
    `MechanismError` where derivatives are refused."""
    drawing = draw(kind, seed, forces=False, friction=seed % 2 == 1)
    if drawing.free or not drawing.mechanism.effects:
        return None
    time = drawing.time[:: max(len(drawing.time) // FEW, 1)]
    try:
        motion, forces = solved(drawing.mechanism, time)
    except MechanismError:
        return None
    jams = forces.friction is not None and forces.friction.jammed.any()
    if motion.singular_points or np.max(motion.condition) >= 30.0 or jams:
        return None
    at = moved_together(drawing.mechanism, np.random.default_rng(5 + seed))
    exact = Derivatives(motion, [Parameter("x", 0.0, 0.01, at)])
    slopes = exact.of(*asked(exact.motion, exact.forces))
    close = []
    for h in STEPS:
        try:
            close.append((h, difference(lambda x: asked(*solved(at(x), motion.time)), h)))
        except MechanismError:  # beside it there is no such mechanism
            continue
    plain = asked(motion, forces)
    largest = max(np.max(np.abs(value)) for value in plain)
    worst = 0.0
    for k, (value, ours) in enumerate(zip(plain, slopes, strict=True)):
        apart = []
        for h, theirs in close:
            size = max(np.max(np.abs(theirs[k])), 1e-3 * np.max(np.abs(value)), 1e-4 * largest)
            allowed = 1e-9 * size + ROUNDING * largest / h
            apart.append(np.max(np.abs(ours[0] - theirs[k])) / allowed)
        least = min(apart, default=0.0)
        if least > 1.0 and np.max(np.abs(close[-1][1][k] - close[-2][1][k])) > allowed:
            return float("nan")  # those with the two shortest steps do not agree either
        worst = max(worst, least)
    return float(worst) if len(close) > 1 else None


def main() -> int:
    given = options(__doc__, 1000).parse_args()
    tally, undecided, refused = Tally(given.count, given.seconds), 0, Counter[str]()
    for seed, kind in ((seed, kind) for seed in count(given.first) for kind in KINDS):
        tally.tell()
        if tally.over() or tally.tried >= given.count:
            break
        try:
            error = off(kind, seed)
        except MechanismError as reason:
            refused[reason.faults[0].message] += 1
            continue
        if error is None or np.isnan(error):
            undecided += error is not None
            continue
        tally.tried += 1
        if error > 1.0:
            tally.fault(f"{kind} {seed}: {error:.3g} times what is allowed")
    return tally.end(f"to seed {seed}; {undecided} undecided; refused: {dict(refused)}")


if __name__ == "__main__":
    raise SystemExit(main())
