"""How cost grows: loops (chain of N four-bars), frames, designs side by side.

python benchmarks/scaling.py [--short]

Processor time, the least of a few runs: how it grows with the size then does not depend on what else the machine does.
"""

from __future__ import annotations

from timing import interleaved, machine  # first: it sets one thread

import argparse  # isort: skip
import time
import tracemalloc

import numpy as np

from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.motion.sweep import sweep
from mechcore.spec.mechanism import Drive, Link, Mechanism, Revolute


def chain(n: int) -> Mechanism:
    """N four-bars in a row: n + 1 upright links and n couplers of 1 m, the first upright driven."""
    links = [Link(name="frame", points={f"A{i}": (float(i), 0.0) for i in range(n + 1)})]
    joints = []
    for i in range(n + 1):
        links.append(Link(name=f"v{i}", points={"A": (0.0, 0.0), "B": (0.0, 1.0)}))
        joints.append(Revolute(name=f"A{i}", links=("frame", f"v{i}"), points=(f"A{i}", "A")))
    for i in range(n):
        links.append(Link(name=f"h{i}", points={"L": (0.0, 0.0), "R": (1.0, 0.0)}))
        joints.append(Revolute(name=f"L{i}", links=(f"v{i}", f"h{i}"), points=("B", "L")))
        joints.append(Revolute(name=f"R{i}", links=(f"h{i}", f"v{i + 1}"), points=("R", "B")))
    sketch = {f"v{i}": (float(i), 0.0, 0.0) for i in range(n + 1)} | {f"h{i}": (float(i), 1.0, 0.0) for i in range(n)}
    drive = Drive(joint="A0", law=ConstantSpeed(0.0, 1.0))
    return Mechanism(name="chain", frame="frame", links=tuple(links), joints=tuple(joints), drives=(drive,), sketch=sketch)


def loops(sizes: tuple[int, ...]) -> None:
    """A whole turn, twice through the singular flat position, positions to accelerations."""
    t = np.linspace(0.0, 2.0 * np.pi, 73)
    print("| loops | compile, ms | motion, ms | us a frame and loop | memory, MB | worst closure |\n|---|---|---|---|---|---|")
    rows = []
    for n in sizes:
        mechanism = chain(n)
        start = time.process_time()
        compiled = compile_mechanism(mechanism)
        compile_time = time.process_time() - start

        def run(compiled=compiled):
            motion = solve_motion(compiled, t)
            return motion, motion.origins, motion.speeds, motion.accelerations

        seconds = interleaved({"run": run}, runs=5, seconds=0.0, pick=min, clock=time.process_time)["run"]
        tracemalloc.start()
        motion, *_ = run()
        memory = tracemalloc.get_traced_memory()[1] / 1e6
        tracemalloc.stop()
        rows.append((n, compile_time, seconds, memory))
        each, closure = 1e6 * seconds / len(t) / n, motion.closure.max()
        print(f"| {n} | {1e3 * compile_time:.1f} | {1e3 * seconds:.2f} | {each:.3f} | {memory:.1f} | {closure:.1e} |")
    big = [r for r in rows if r[0] >= 100]
    for k, what in ((1, "compile"), (2, "motion"), (3, "memory")):
        slope = np.polyfit(np.log([r[0] for r in big]), np.log([r[k] for r in big]), 1)[0]
        print(f"slope of log {what} against log N from N = 100 on: {slope:.3f}")


def designs(count: int) -> None:
    """Four-bars with different lengths, 360 frames each: positions, velocities and accelerations of a coupler point."""
    points = {
        "frame": {"A": (0.0, 0.0), "D": (4.0, 0.0)},
        "crank": {"A": (0.0, 0.0), "B": (1.0, 0.0)},
        "coupler": {"B": (0.0, 0.0), "C": (3.5, 0.0), "P": (1.5, 1.0)},
        "rocker": {"D": (0.0, 0.0), "C": (3.0, 0.0)},
    }
    ends = {"A": ("frame", "crank"), "B": ("crank", "coupler"), "C": ("coupler", "rocker"), "D": ("frame", "rocker")}
    mechanism = Mechanism(
        name="four-bar",
        frame="frame",
        links=tuple(Link(name=k, points=p) for k, p in points.items()),
        joints=tuple(Revolute(name=k, links=e, points=(k, k)) for k, e in ends.items()),
        drives=(Drive(joint="A", law=ConstantSpeed(0.0, 1.0)),),
        modes={"C": "left"},
    )
    compiled = compile_mechanism(mechanism)
    rng = np.random.default_rng(0)
    zero = np.zeros(count)
    vary = {
        ("crank", "B"): np.column_stack([rng.uniform(0.5, 2.5, count), zero]),
        ("coupler", "C"): np.column_stack([rng.uniform(3.0, 4.0, count), zero]),
    }
    t = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)

    def run():
        return sweep(compiled, vary, t, lambda m: {f"derivative {d}": m.point("coupler", "P", d) for d in range(3)})

    seconds = interleaved({"run": run}, runs=3, seconds=0.0, pick=min, clock=time.process_time)["run"]
    share = 100.0 * run().assembled.mean()
    each = 1e6 * seconds / count / len(t)
    print(f"{count} designs x {len(t)} frames: {seconds:.2f} s, {each:.3f} us a position; {share:.1f} % assemble")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="up to 300 loops and 1,000 designs; else 2,000 and 10,000")
    short = parser.parse_args().short
    print(machine("numpy", "scipy"), "\n")
    loops((10, 100, 300) if short else (10, 100, 200, 500, 1000, 2000))
    print()
    designs(1000 if short else 10_000)


if __name__ == "__main__":
    main()
