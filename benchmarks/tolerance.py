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
sys.path[:0] = [str(ROOT / "core"), str(ROOT / "tests")]

import numpy as np
from dynamic_mechanisms import double_pendulum, slider_crank, squeezer, swinging_five_bar

from mechcore.dynamics.simulate import simulate
from mechcore.motion.solve import compile_mechanism
from mechviz.hard_cases.mechanisms import bars

TOLERANCES = 10.0 ** -np.arange(3.0, 10.0)
WIDTH, HEIGHT, EDGE = 560, 420, 60
COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e")


def reference(name: str, case: str) -> dict:
    found = json.loads((ROOT / "tests" / "reference" / name).read_text())["cases"]
    return next(c for c in found if c["id"] == case)["inputs"]


def errors_of(mechanism, duration: float) -> np.ndarray:
    """Largest error of the free coordinates at the end, by tolerance, against a run at 1e-13."""
    compiled = compile_mechanism(mechanism)
    exact = simulate(compiled, duration, tolerance=1e-13, method="gauss")([duration])[0][0]
    runs = [simulate(compiled, duration, tolerance=t, method="gauss")([duration])[0][0] for t in TOLERANCES]
    return np.array([np.abs(q - exact).max() for q in runs])


def svg(found: dict[str, np.ndarray]) -> str:
    def x(t: float) -> float:
        return EDGE + (WIDTH - 2 * EDGE) * (-3.0 - np.log10(t)) / 6.0

    def y(e: float) -> float:
        return EDGE + (HEIGHT - 2 * EDGE) * (-2.0 - np.log10(max(e, 1e-14))) / 12.0

    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" font-size="12">']
    out.append('<rect width="100%" height="100%" fill="white"/>')
    for d in range(3, 10):
        out.append(f'<text x="{x(10.0**-d) - 12:.0f}" y="{HEIGHT - EDGE + 18}">1e-{d}</text>')
    for d in range(2, 15, 2):
        out.append(f'<text x="14" y="{y(10.0**-d) + 4:.0f}">1e-{d}</text>')
        out.append(f'<path d="M {EDGE} {y(10.0**-d):.1f} H {WIDTH - EDGE}" stroke="#ddd"/>')
    out.append(f'<path d="M {x(1e-3):.1f} {y(1e-3):.1f} L {x(1e-9):.1f} {y(1e-9):.1f}" stroke="#888" stroke-dasharray="5 4"/>')
    for k, (name, errors) in enumerate(found.items()):
        points = " L ".join(f"{x(t):.1f} {y(e):.1f}" for t, e in zip(TOLERANCES, errors, strict=True))
        out.append(f'<path d="M {points}" fill="none" stroke="{COLOURS[k]}" stroke-width="2"/>')
        out.append(f'<text x="{WIDTH - 190}" y="{EDGE + 16 * k}" fill="{COLOURS[k]}">{name}</text>')
    out.append(
        f'<text x="{WIDTH / 2 - 60}" y="{HEIGHT - 16}">requested tolerance</text><text x="14" y="30">error [rad, m]</text></svg>'
    )
    return "\n".join(out)


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
    found = {name: errors_of(mechanism, duration) for name, (mechanism, duration) in cases.items()}
    print("| tolerance | " + " | ".join(found) + " |\n|" + "---|" * (len(found) + 1))
    for k, t in enumerate(TOLERANCES):
        print(f"| {t:.0e} | " + " | ".join(f"{e[k]:.1e}" for e in found.values()) + " |")
    slopes = [np.polyfit(np.log10(TOLERANCES[:6]), np.log10(e[:6] + 1e-15), 1)[0] for e in found.values()]
    print("| slope over five decades | " + " | ".join(f"{s:.2f}" for s in slopes) + " |")
    if out is not None:
        out.write_text(svg(found), encoding="utf-8")


if __name__ == "__main__":
    main()
