"""What the program says of its errors against what they are, over the gallery: how often is the estimate within a factor of ten?

Usage: python benchmarks/error_estimates.py [SCENE ...] [--frames N]. Prints one line a result, then the shares. Errors below 1e-13
count as 1e-13: the references are not better, and nobody reads more digits; of motions under forces what the reference is off.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mechcore.accuracy import Accuracy
from mechviz.accuracy.estimate import estimate_errors, integration_error
from mechviz.runs import run_scene
from mechviz.scene.folder import gallery_names
from mechviz.scene.scene import load

sys.path.append(str(Path(__file__).resolve().parent.parent / "tests" / "support"))
from true_errors import between_error, integration_truth, position_errors, reaction_error

FLOOR = 1e-13
"""Of the references."""


@dataclass(frozen=True)
class Compared:
    """The largest estimate and the largest true error of a result of a scene."""

    scene: str
    what: str
    estimate: float
    truth: float
    floor: float = FLOOR  # of the reference

    @property
    def ratio(self) -> float:
        """Estimate over truth, both at least the floor."""
        return max(self.estimate, self.floor) / max(self.truth, self.floor)

    @property
    def bounded(self) -> bool:
        """The true error is at most ten times the estimate."""
        return self.ratio >= 0.1

    @property
    def within(self) -> bool:
        """Estimate and truth differ by at most a factor of ten."""
        return 0.1 <= self.ratio <= 10.0


def compare(name: str, frames: int | None = None) -> Iterator[Compared]:
    """All results of a gallery scene that a reference is known for."""
    scene = load(name)
    for order in (1, 3, 5):
        run = run_scene(scene, frames=frames, accuracy=Accuracy(interpolation=order))  # type: ignore[arg-type]  # of its literals
        yield Compared(name, f"between frames, order {order}", float(np.nanmax(run.errors.interpolation)), between_error(run))
    errors = estimate_errors(run)
    if run.simulation is None:
        for what, truth in position_errors(run.motion).items():
            yield Compared(name, what, float(np.nanmax(getattr(errors, what))), float(np.max(truth)))
        reactions = reaction_error(scene, run.scene.frames)
        if reactions is not None:
            yield Compared(name, "reaction", float(np.nanmax(errors.reaction)), float(np.nanmax(reactions)))
    elif run.resimulate is not None:
        t = np.linspace(0.0, run.simulation.duration, 65)
        truth = integration_truth(run.simulation, run.resimulate, t)
        if truth is not None:
            estimate = float(np.nanmax(integration_error(run.simulation, t, run.resimulate)))
            yield Compared(name, "motion under forces", estimate, float(np.max(truth[0])), max(FLOOR, truth[1]))


def main() -> None:
    """Compare and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--frames", type=int)
    given = parser.parse_args()
    result: list[Compared] = []
    for name in given.scenes or gallery_names():
        for one in compare(name, given.frames):
            result.append(one)
            mark = " " if one.within else "!" if one.bounded else "X"
            print(
                f"{mark} {one.scene:<40} {one.what:<26} estimate {one.estimate:9.1e}  true {one.truth:9.1e}  ratio {one.ratio:9.2g}"
            )
    for what in (None, *dict.fromkeys(c.what for c in result)):
        some = [c for c in result if what in (None, c.what)]
        bounded, within = (100.0 * float(np.mean([getattr(c, k) for c in some])) for k in ("bounded", "within"))
        words = f"truth at most ten times the estimate in {bounded:.1f} %, within a factor of ten in {within:.1f} %"
        print(f"{what or 'all':<26} {len(some):4d} results: {words}")


if __name__ == "__main__":
    main()
