"""The two executors side by side: numpy, and the compiled program of the same mechanism.

    python benchmarks/compiled.py

Motions of a four-bar and of ten links over more and more frames, of the first against C by hand; Andrews' squeezer with a damped
crank, a double pendulum and a five-bar under forces, to two tolerances, and twenty times as long; a million four-bars, in as many
threads as OMP_NUM_THREADS says.
Processor times; what compiling and loading cost is shown apart.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import resource
import sys
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "core"), str(ROOT / "tests" / "support"), str(Path(__file__).resolve().parent)]

from timing import interleaved, machine  # isort: skip # before numpy is imported: one thread

import os

import numpy as np
from dynamic_mechanisms import damped_squeezer, double_pendulum, swinging_five_bar
from mechanisms import four_bar

from mechcore.compiled.toolchain import library
from mechcore.dynamics.equations.program import compiled_program
from mechcore.dynamics.simulate import simulate
from mechcore.motion.compiled import Compiled
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.mechanism import Mechanism
from mechviz.scene.scene import load, loads
from mechviz.studies.designs.evaluate import study_of
from mechviz.studies.designs.measures import parse_measure
from mechviz.studies.designs.sampling import parse_sample, parse_variation, sampled
from mechviz.studies.designs.sweep import run_study


def case(file: str, name: str) -> dict[str, float]:
    result = json.loads((ROOT / "tests" / "reference" / f"{file}.json").read_text())["cases"]
    return next(c for c in result if c["id"] == name)["inputs"]


def all_of(compiled: Compiled, times: np.ndarray) -> None:
    """Positions, velocities and accelerations of the origins of all links."""
    motion = solve_motion(compiled, times)
    _ = motion.origins, motion.origin_velocities, motion.origin_accelerations


def end_of(compiled: Compiled, duration: float, tolerance: float) -> np.ndarray:
    return simulate(compiled, duration, tolerance=tolerance)([duration])[0][0]


def motions() -> None:
    print("| motion | frames | numpy [ms] | C [ms] | ratio |\n|---|---|---|---|---|")
    for name in ("crank-rocker", "ten-link"):
        compiled = compile_mechanism(load(name).mechanism)
        for frames in (360, 3600, 36_000):
            times = default_times(compiled.mechanism, frames)
            jobs = {e: partial(all_of, replace(compiled, executor=e), times) for e in ("numpy", "c")}
            t = interleaved(jobs, seconds=0.1, pick=min, clock=time.process_time)
            print(f"| {name} | {frames} | {1e3 * t['numpy']:.3f} | {1e3 * t['c']:.3f} | {t['numpy'] / t['c']:.1f} |", flush=True)


BY_HAND = """\
#include <math.h>
void four_bar(long n, const double *angle, const double *lengths, double w, double *restrict out) {
    const double a = lengths[0], b = lengths[1], c = lengths[2], d = lengths[3];
    for (long i = 0; i < n; i++) { /* pins B and C: positions, velocities, accelerations */
        const double bx = a * cos(angle[i]), by = a * sin(angle[i]), tx = d - bx, ty = -by, squared = tx * tx + ty * ty;
        const double k = (b * b - c * c) * (0.5 / squared) + 0.5, h = sqrt(b * b / squared - k * k);
        const double ux = (k * tx - h * ty) / b, uy = (k * ty + h * tx) / b, cx = bx + b * ux, cy = by + b * uy;
        const double vx = (cx - d) / c, vy = cy / c, over = 1.0 / (ux * vy - uy * vx);
        const double w3 = w * (by * vx - bx * vy) * over / b, w4 = w * (by * ux - bx * uy) * over / c;
        const double rx = -w * w * bx - w3 * w3 * b * ux + w4 * w4 * c * vx, ry = -w * w * by - w3 * w3 * b * uy + w4 * w4 * c * vy;
        const double a4 = -(rx * ux + ry * uy) * over / c;
        double *o = out + 2 * i;
        o[0] = bx, o[1] = by, o += 2 * n;
        o[0] = -w * by, o[1] = w * bx, o += 2 * n;
        o[0] = -w * w * bx, o[1] = -w * w * by, o += 2 * n;
        o[0] = cx, o[1] = cy, o += 2 * n;
        o[0] = -w4 * c * vy, o[1] = w4 * c * vx, o += 2 * n;
        o[0] = -a4 * c * vy - w4 * w4 * c * vx, o[1] = a4 * c * vx - w4 * w4 * c * vy;
    }
}
"""


def by_hand() -> None:
    """The pins of a four-bar, by the compiled program of the general code and by C for this one mechanism."""
    lengths, speed = np.array([1.0, 3.5, 3.0, 4.0]), 2.0
    own = compile_mechanism(four_bar(E=(4.0, 0.0), AB=1.0, BD=3.5, DE=3.0, speed=speed), executor="c")
    function = library(BY_HAND).four_bar
    print("\n| pins of a four-bar | by hand [ms] | by the program [ms] | ratio | difference |\n|---|---|---|---|---|")
    for frames in (360, 3600, 36_000):
        times = default_times(own.mechanism, frames)

        def hand(times: np.ndarray = times) -> np.ndarray:
            out, angles = np.empty((6, len(times)), complex), speed * times
            rows = [ctypes.c_void_p(x.__array_interface__["data"][0]) for x in (angles, lengths)]
            function(ctypes.c_long(len(times)), *rows, ctypes.c_double(speed), ctypes.c_void_p(out.__array_interface__["data"][0]))
            return out

        def program(times: np.ndarray = times) -> list[np.ndarray]:
            motion = solve_motion(own, times)
            return [motion.point(link, point, k) for link, point in (("crank", "B"), ("rocker", "D")) for k in (0, 1, 2)]

        away = max(float(np.abs(a - b[:, 0] - 1j * b[:, 1]).max()) for a, b in zip(hand(), program(), strict=True))
        t = interleaved({"hand": hand, "program": program}, seconds=0.1, pick=min, clock=time.process_time)
        row = f"{1e3 * t['hand']:.3f} | {1e3 * t['program']:.3f} | {t['program'] / t['hand']:.2f} | {away:.0e}"
        print(f"| {frames} positions | {row} |", flush=True)


CASES: tuple[tuple[str, Mechanism, float], ...] = (
    ("Andrews' squeezer, damped, 0.03 s", damped_squeezer(case("andrews", "andrews-squeezer")), 0.03),
    ("double pendulum, 5 s", double_pendulum(case("dynamics", "double-pendulum-physical")), 5.0),
    ("five-bar on torsion springs, 2 s", swinging_five_bar(), 2.0),
)


def simulations() -> None:
    print("\n| motion under forces | tolerance | numpy [ms] | C [ms] | ratio | difference | compiled in [s] | loaded in [ms] |")
    print("|---|---|---|---|---|---|---|---|")
    for title, mechanism, duration in CASES:
        compiled = compile_mechanism(mechanism)
        spent = [prepared(compile_mechanism(mechanism)) for _ in range(2)]
        for tolerance in (1e-6, 1e-9):
            jobs = {e: partial(end_of, replace(compiled, executor=e), duration, tolerance) for e in ("numpy", "c")}
            away = float(np.abs(jobs["numpy"]() - jobs["c"]()).max())
            t = interleaved(jobs, runs=5, seconds=0.1, pick=min, clock=time.process_time)
            times = f"{1e3 * t['numpy']:.1f} | {1e3 * t['c']:.2f} | {t['numpy'] / t['c']:.1f}"
            made = f"{spent[0]:.2f} | {1e3 * spent[1]:.1f}"
            print(f"| {title} | {tolerance:.0e} | {times} | {away:.1e} | {made} |", flush=True)


def long_ones() -> None:
    """Twenty times as long, once: what is paid once no longer counts; "auto" has to notice by itself."""
    print("\n| motion under forces, long | windows | numpy [s] | C [s] | auto [s] | C faster by |\n|---|---|---|---|---|---|")
    for title, mechanism, duration in CASES:
        spent, windows = {}, 0
        for executor in ("numpy", "c", "auto"):
            compiled = replace(compile_mechanism(mechanism), executor=executor)  # type: ignore[arg-type]
            compiled_program(compiled)
            start = time.process_time()
            simulation = simulate(compiled, 20.0 * duration)
            spent[executor] = time.process_time() - start
            windows = sum(len(s.solution.windows) for s in simulation.segments)
        row = " | ".join(f"{spent[e]:.3f}" for e in ("numpy", "c", "auto"))
        print(f"| {title} x 20 | {windows} | {row} | {spent['numpy'] / spent['c']:.0f} |", flush=True)


FOUR_BARS = """\
title = "Four-bars"
units = { length = "mm" }
effects = ["inertia", "gravity"]
[parameters]
a = { value = "60 mm", range = ["50 mm", "70 mm"] }
b = { value = "180 mm", range = ["170 mm", "190 mm"] }
c = { value = "150 mm", range = ["145 mm", "160 mm"] }
[links]
frame = { points = { A = [0, 0], D = [200, 0] } }
crank = { points = { A = [0, 0], B = ["a", 0] }, mass = 1, centre = ["a/2", 0], inertia = 0.001 }
coupler = { points = { B = [0, 0], C = ["b", 0] }, mass = 2, centre = ["b/2", 0], inertia = 0.01 }
rocker = { points = { D = [0, 0], C = ["c", 0] }, mass = 2, centre = ["c/2", 0], inertia = 0.01 }
[joints]
A = { revolute = ["frame", "crank"], drive = { speed = "60 rpm" } }
B = { revolute = ["crank", "coupler"] }
C = { revolute = ["coupler", "rocker"], side = "left" }
D = { revolute = ["rocker", "frame"] }
"""


def designs() -> None:
    """Four-bars with their greatest crank torque over 72 positions: wall time, and memory that does not grow but by the results."""
    scene = loads(FOUR_BARS)
    variations = [parse_variation(scene, name) for name in "abc"]
    print("\n| four-bars x 72 positions, crank torque | designs | wall [s] | processor [s] | memory grown by [MB] |")
    print("|---|---|---|---|---|")
    for executor, powers in (("numpy", (14, 17)), ("c", (14, 17, 20))):
        for power in powers:
            chosen = sampled(variations, parse_sample(f"sobol:{2**power}", 0))
            measures = [parse_measure(scene, "drive.A.torque:peak")]
            study = study_of(scene, variations, measures, frames=72, executor=executor, count=len(chosen))  # type: ignore[arg-type]
            words = study.computed_by
            before, wall, spent = peak(), time.perf_counter(), time.process_time()
            run_study(study, chosen)
            wall, spent = time.perf_counter() - wall, time.process_time() - spent
            print(f"| {words} | {len(chosen):,} | {wall:.2f} | {spent:.2f} | {(peak() - before) / 1024:.0f} |", flush=True)


def peak() -> int:
    """The most memory that the process has had [kB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def prepared(compiled: Compiled) -> float:
    """Wall time until a mechanism's program is ready [s]."""
    library.cache_clear()
    start = time.perf_counter()
    if compiled_program(replace(compiled, executor="c")) is None:
        raise SystemExit("there is no C compiler that works")
    return time.perf_counter() - start


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    print(f"{machine('numpy', 'scipy')}; least processor time of turns taken in alternation\n")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder  # nothing is compiled yet
        motions()
        by_hand()
        simulations()
        long_ones()
        designs()


if __name__ == "__main__":
    main()
