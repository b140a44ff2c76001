"""What studies cost: four-bars with forces swept beside the core's own array call, and tolerances by samples of a slider-crank.

python benchmarks/studies.py [--short]

Processor time of both ways in alternation, so that the ratio does not depend on what else the machine does; of the samples the wall
time, which does, beside it.
"""

from __future__ import annotations

from timing import interleaved, machine  # first: it sets one thread

import argparse  # isort: skip
import time

import numpy as np

from mechcore.compiled.motion import Executor
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.solve import compile_mechanism, default_times
from mechcore.motion.sweep import sweep
from mechviz.runs import run_scene
from mechviz.scene.scene import load, loads
from mechviz.studies.designs.evaluate import study_of
from mechviz.studies.designs.measures import parse_measure
from mechviz.studies.designs.sampling import parse_sample, parse_variation, sampled
from mechviz.studies.designs.sweep import run_study
from mechviz.studies.designs.tolerance import toleranced, tolerances

FOUR_BARS = """
units = { length = "mm", angle = "deg" }
effects = ["inertia", "gravity"]
[parameters]
a = { value = "60 mm", range = ["55 mm", "65 mm"] }
b = { value = "150 mm", range = ["145 mm", "155 mm"] }
c = { value = "130 mm", range = ["125 mm", "135 mm"] }
[links]
frame = { points = { A = [0, 0], D = [200, 0] } }
crank = { points = { A = [0, 0], B = ["a", 0] }, mass = 1, centre = [30, 0], inertia = 0.001 }
coupler = { points = { B = [0, 0], C = ["b", 0] }, mass = 2, centre = [75, 0], inertia = 0.01 }
rocker = { points = { D = [0, 0], C = ["c", 0] }, mass = 2, centre = [65, 0], inertia = 0.01 }
[joints]
A = { revolute = ["frame", "crank"], drive = { speed = "60 rpm" } }
B = { revolute = ["crank", "coupler"] }
C = { revolute = ["coupler", "rocker"], side = "left" }
D = { revolute = ["rocker", "frame"] }
"""
FRAMES = 360


def four_bars(count: int) -> None:
    """Greatest crank torque: a study of the scene, with parameters, reducers and reasons; and one call of the core for all."""
    scene = loads(FOUR_BARS)
    variations = [parse_variation(scene, name) for name in "abc"]
    chosen = sampled(variations, parse_sample(f"lhs:{count}", 0))
    measures = [parse_measure(scene, "drive.A.torque:peak")]
    ends = {("crank", "B"): 0, ("coupler", "C"): 1, ("rocker", "C"): 2}
    points = {place: np.column_stack([1e-3 * chosen[:, k], np.zeros(count)]) for place, k in ends.items()}
    peaks: dict[str, np.ndarray] = {}
    print(f"\n| {count:,} four-bars x {FRAMES} frames, peak torque | study [s] | core [s] | ratio | computed by |")
    print("|---|---|---|---|---|")
    executors: tuple[Executor, ...] = ("numpy", "c")
    for executor in executors:
        study = study_of(scene, variations, measures, frames=FRAMES, executor=executor, count=count)
        compiled = compile_mechanism(scene.mechanism, executor=executor)
        at = default_times(scene.mechanism, FRAMES)

        def of_study(study=study) -> None:  # type: ignore[no-untyped-def]
            peaks["study"] = run_study(study, chosen).results.values[0]

        def of_core(compiled=compiled, at=at) -> None:  # type: ignore[no-untyped-def]
            swept = sweep(compiled, points, at, lambda m: {"torque": solve_forces(m).effort("A")}, total=count)
            peaks["core"] = np.abs(swept.results["torque"]).max(axis=-1)

        found = interleaved({"study": of_study, "core": of_core}, runs=3, seconds=0.0, pick=min, clock=time.process_time)
        np.testing.assert_allclose(peaks["study"], peaks["core"], rtol=1e-9)
        ratio = found["study"] / found["core"]
        print(f"| | {found['study']:.2f} | {found['core']:.2f} | {ratio:.2f} | {study.computed_by} |", flush=True)


def samples(power: int) -> None:
    """Monte Carlo of the press of the gallery, a slider-crank whose stroke and rod are off."""
    scene = load("parametric-press")
    run = run_scene(scene, frames=FRAMES)
    measure, variables = parse_measure(scene, "drive.A.torque:peak"), toleranced(scene, ["ratio=0.05"])
    print(f"\n| {2**power:,} samples of a slider-crank x {FRAMES} frames, peak torque | wall [s] | processor [s] | computed by |")
    print("|---|---|---|---|")
    executors: tuple[Executor, ...] = ("numpy", "auto")
    for executor in executors:
        wall, spent = time.perf_counter(), time.process_time()
        (found,) = tolerances(run, [measure], variables, samples=2**power, program=executor)
        wall, spent = time.perf_counter() - wall, time.process_time() - spent
        print(f"| | {wall:.1f} | {spent:.1f} | {found.computed_by} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="1,000 four-bars and 4,096 samples, not 10,000 and 131,072")
    short = parser.parse_args().short
    print(machine("numpy", "scipy"))
    four_bars(1000 if short else 10_000)
    samples(12 if short else 17)


if __name__ == "__main__":
    main()
