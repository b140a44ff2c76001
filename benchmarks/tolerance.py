"""Error against requested tolerance over five decades and more, for several mechanisms, as a table and a plot (SVG).

    python benchmarks/tolerance.py [OUT.svg]

A method that keeps what it promises gives lines of slope one next to the diagonal (tolerance proportionality).
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "core"), str(ROOT / "tests" / "support")]

import numpy as np
from dynamic_mechanisms import double_pendulum, slider_crank, squeezer, swinging_five_bar

from mechcore.dynamics.simulate import simulate
from mechcore.motion.solve import compile_mechanism
from mechviz.figures import chart, save_chart
from mechviz.hard_cases.mechanisms import bars

TOLERANCES = 10.0 ** -np.arange(3.0, 10.0)


def reference(name: str, case: str) -> dict:
    result = json.loads((ROOT / "tests" / "reference" / name).read_text())["cases"]
    return next(c for c in result if c["id"] == case)["inputs"]


def errors_of(mechanism, duration: float) -> np.ndarray:
    """Largest error of the free coordinates at the end, by tolerance, against a run at 1e-13."""
    compiled = compile_mechanism(mechanism)
    exact = simulate(compiled, duration, tolerance=1e-13, method="gauss")([duration])[0][0]
    runs = [simulate(compiled, duration, tolerance=t, method="gauss")([duration])[0][0] for t in TOLERANCES]
    return np.array([np.abs(q - exact).max() for q in runs])


def draw(result: dict[str, np.ndarray], path: Path) -> None:
    with chart(6.4, 4.4) as figure:
        axes = figure.subplots()
        for name, errors in result.items():
            axes.plot(TOLERANCES, np.maximum(errors, 1e-14), "o-", markersize=4.0, label=name)
        axes.plot(TOLERANCES, TOLERANCES, "--", color="#888888", label="error = tolerance")
        axes.set(xscale="log", yscale="log", xlabel="requested tolerance", ylabel="error [rad, m]")
        axes.invert_xaxis()
        figure.legend(loc="outside upper left", ncols=3)
    save_chart(figure, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", metavar="OUT.svg", nargs="?", type=Path, help="where to draw the plot too")
    out = parser.parse_args().out
    i = reference("dynamics.json", "forward-slider-crank")
    cases = {
        "double pendulum, 1 s": (double_pendulum(reference("dynamics.json", "double-pendulum-physical")), 1.0),
        "five-bar, 1 s": (swinging_five_bar(), 1.0),
        "four-bar, 2 s": (bars(frame=1.0, crank=0.3, coupler=0.9, rocker=0.7, angle=0.5, speed=2.0), 2.0),
        "slider-crank, 0.2 s": (slider_crank(i), 0.2),
        "squeezer, 0.03 s": (squeezer(reference("andrews.json", "andrews-squeezer")), 0.03),
    }
    result = {name: errors_of(mechanism, duration) for name, (mechanism, duration) in cases.items()}
    print("| tolerance | " + " | ".join(result) + " |\n|" + "---|" * (len(result) + 1))
    for k, t in enumerate(TOLERANCES):
        print(f"| {t:.0e} | " + " | ".join(f"{e[k]:.1e}" for e in result.values()) + " |")
    slopes = [np.polyfit(np.log10(TOLERANCES[:6]), np.log10(e[:6] + 1e-15), 1)[0] for e in result.values()]
    print("| slope over five decades | " + " | ".join(f"{s:.2f}" for s in slopes) + " |")
    if out is not None:
        draw(result, out)


if __name__ == "__main__":
    main()
