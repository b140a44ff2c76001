"""The pictures and numbers of accuracy.md and hard-cases.md: python docs/make_accuracy.py [--quick]

Diagrams go to docs/images; what stands between `<!-- block: NAME -->` and `<!-- end -->` is replaced.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import re
import sys
from pathlib import Path

import numpy as np

from mechviz.accuracy.cache import keep, kept
from mechviz.accuracy.diagram import Canvas, diagram, write_diagram
from mechviz.accuracy.effects import influence_lines, influences
from mechviz.accuracy.ladder import Point, cheapest, ladder
from mechviz.accuracy.timing import machine, used
from mechviz.runs import run_scene
from mechviz.scene.scene import load

HERE = Path(__file__).resolve().parent
IMAGES = HERE / "images"
sys.path.insert(0, str(HERE.parent / "benchmarks"))
BLUE, RED, GREEN, GREY = "#1b6ca8", "#c8553d", "#3a7d44", "#9aa3ad"
TARGET = 1e-6
Curve = tuple[np.ndarray, np.ndarray, str, str]


def fill(page: str, blocks: dict[str, str]) -> None:
    """Replace the blocks of a page."""
    path = HERE / page
    text = path.read_text(encoding="utf-8")
    for name, body in blocks.items():
        pattern = rf"(<!-- block: {name} -->\n).*?(<!-- end -->)"
        text, count = re.subn(pattern, lambda m, b=body: f"{m[1]}\n{b}\n\n{m[2]}", text, flags=re.DOTALL)
        if count != 1:
            raise SystemExit(f"{page}: block '{name}' is there {count} times")
    path.write_text(text, encoding="utf-8")


def code(lines: list[str]) -> str:
    """Lines as a block of code."""
    return "\n".join(["```text", *lines, "```"])


def round_values(low: float, high: float, unit: str) -> np.ndarray:
    """At most eight round values between two, of an angle multiples of 5 degrees."""
    steps = [5.0, 15.0, 30.0, 45.0, 90.0, 180.0] if "deg" in unit else []
    steps += [k * 10.0**d for d in range(-6, 7) for k in (1, 2, 5)]
    step = next(s for s in steps if (high - low) / s <= 8.0)
    return np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step + 0.0  # no -0


def plot(path: Path, title: str, across: str, up: str, curves: list[Curve], *, equal: bool = False) -> None:
    """Curves over each other; gaps where a value is not finite."""
    width, height = (620.0, 340.0) if not equal else (460.0, 460.0)
    sheet = Canvas(width, height)
    xs, ys = (np.concatenate([c[k][np.isfinite(c[1])] for c in curves]) for k in (0, 1))
    (x0, x1), (y0, y1) = ((float(v.min()), float(v.max())) for v in (xs, ys))
    if equal:
        half = 0.53 * max(x1 - x0, y1 - y0)
        x0, x1, y0, y1 = (0.5 * (x0 + x1) - half, 0.5 * (x0 + x1) + half, 0.5 * (y0 + y1) - half, 0.5 * (y0 + y1) + half)
    else:
        y0, y1 = y0 - 0.05 * (y1 - y0), y1 + 0.05 * (y1 - y0)
    left, top, right, bottom = 64.0, 44.0, 16.0, 46.0

    def place(x: float, y: float) -> tuple[float, float]:
        u, v = (x - x0) / (x1 - x0), (y - y0) / (y1 - y0)
        return left + u * (width - left - right), height - bottom - v * (height - top - bottom)

    sheet.text(left, 20, title, size=13)
    for x in round_values(x0, x1, across):
        sheet.line([place(x, y0), place(x, y1)], "#e3e6ea")
        sheet.text(place(x, y0)[0], height - bottom + 15, f"{x:.4g}", size=10, anchor="middle")
    for y in round_values(y0, y1, up):
        sheet.line([place(x0, y), place(x1, y)], "#e3e6ea")
        sheet.text(left - 6, place(x0, y)[1] + 4, f"{y:.4g}", size=10, anchor="end")
    sheet.text(left + 0.5 * (width - left - right), height - 10, across, size=11, anchor="middle")
    sheet.text(6, top - 8, up, size=11)
    at = left + 110.0
    for x, y, color, label in curves:
        good = np.isfinite(y)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
        for a, b in zip(edges[::2], edges[1::2], strict=True):
            sheet.line([place(float(p), float(q)) for p, q in zip(x[a:b], y[a:b], strict=True)], color, 1.8)
        if label:
            sheet.text(at, top - 8, label, size=11, color=color)
            at += 30.0 + 6.2 * len(label)
    write_diagram(sheet, path)


# -- accuracy.md ----------------------------------------------------------------------------------------------------------------


def targets() -> str:
    """Wanted and reached errors of some scenes."""
    from mechviz.accuracy.reference import between_error

    lines = [
        "| scene | wanted | frames | reached, at random times between frames | estimated by the run |",
        "|---|---|---|---|---|",
    ]
    for name in ("crank-rocker", "ten-link-forces", "triad"):
        for target in (1e-3, 1e-6, 1e-9):
            run = run_scene(load(name), accuracy=target)
            said = float(np.nanmax(run.errors.between))
            lines.append(f"| `{name}` | {target:.0e} | {run.motion.frames - 1} | {between_error(run):.1e} | {said:.1e} |")
    return "\n".join(lines)


def ladders(quick: bool) -> dict[str, tuple[Point, ...]]:
    """The ladders that are drawn, measured or kept."""
    found = {}
    for name in ("crank-rocker", "andrews-squeezer"):
        scene = load(name)
        measured = kept(scene, TARGET, rough=quick)
        if measured is None:
            with used() as share:
                points = ladder(scene, TARGET, budget=0.02 if quick else 0.25)
            measured = keep(scene, TARGET, points, quick, share())
        title = f"{scene.title}: what accuracy costs"
        write_diagram(diagram(measured.points, title, measured.foot, TARGET), IMAGES / f"accuracy-{name}.svg")
        found[name] = measured.points
    return found


def cheapest_table(found: dict[str, tuple[Point, ...]]) -> str:
    """The cheapest setting of every dial that reaches the target."""
    lines = ["| scene | dial | cheapest setting | error | time |", "|---|---|---|---|---|"]
    for name, points in found.items():
        for dial in dict.fromkeys(p.dial for p in points):
            best = cheapest([p for p in points if p.dial == dial], TARGET)
            words = (
                "none of the ladder | |"
                if best is None
                else f"{best.method}, {best.value} | {best.error:.1e} | {1e3 * best.seconds:.3g} ms"
            )
            lines.append(f"| `{name}` | {dial} | {words} |")
    return "\n".join([*lines, "", f"Measured on {machine()}."])


def estimates() -> str:
    """Reported against true errors on a sample."""
    from error_estimates import compare

    some = [c for name in ("crank-rocker", "slider-crank-compressor", "ten-link-forces", "triad") for c in compare(name)]
    lines = ["| scene | result | reported | true |", "|---|---|---|---|"]
    lines += [f"| `{c.scene}` | {c.what} | {c.estimate:.1e} | {c.truth:.1e} |" for c in some]
    within = 100.0 * float(np.mean([c.within for c in some]))
    return "\n".join(
        [*lines, "", f"Within a factor of ten (errors below 1e-13 count as that): {within:.0f} % of these {len(some)}."]
    )


def effects_block() -> str:
    """What the effects of a scene do."""
    base, found = influences(load("slider-crank-friction"))
    return code(["$ mechviz effects slider-crank-friction", *influence_lines(base, found, 0.01), "", f"measured on {machine()}"])


# -- hard-cases.md ----------------------------------------------------------------------------------------------------------------


def hard_tables() -> dict[str, str]:
    """The suite as tables."""
    from mechviz.hard_cases.case import FAMILIES
    from mechviz.hard_cases.suite import all_cases

    blocks = {}
    for family in FAMILIES:
        lines = ["| case | what happens there | expected | error | allowed |", "|---|---|---|---|---|"]
        for case in all_cases(family):
            outcome = case.run()
            if not outcome.passed:
                raise SystemExit(f"{case.name} fails: {outcome.found}")
            happens = case.happens + (f" (peers: {case.peers})" if case.peers else "")
            cells = [case.name, happens, case.expected, f"{outcome.worst.error:.1e}", f"{outcome.worst.bound:.0e}"]
            lines.append(f"| {' | '.join(c.replace('|', chr(92) + '|') for c in cells)} |")
        blocks[family] = "\n".join(lines)
    return blocks


def hard_pictures() -> None:
    """One picture a family, from what the program computes."""
    from mechcore.cams.cutting import cut_profile
    from mechcore.cams.followers import Follower, Roller, Translating
    from mechcore.cams.synthesis import cam_on_base
    from mechcore.dynamics.events import Stop
    from mechcore.dynamics.simulate import simulate
    from mechcore.laws.program import Segment, program
    from mechcore.motion.solve import compile_mechanism, solve_motion
    from mechviz.hard_cases.mechanisms import TURN, four_bar, load_at, pendulum
    from mechviz.hard_cases.rubbing import sleeve

    t = np.linspace(0.0, 2.0 * TURN, 721)
    curves: list[Curve] = []
    for mode, color, words in (("left", BLUE, "parallelogram"), ("right", RED, "antiparallelogram")):
        motion = solve_motion(compile_mechanism(four_bar(0.3, 0.1, 0.3, 0.1, start=0.5, mode=mode)), t)
        curves.append((np.degrees(t + 0.5), motion.velocity("rocker")[:, 2], color, words))
    plot(
        IMAGES / "hard-linkages.svg",
        "Speed of the rocker over that of the crank, two turns",
        "crank [deg]",
        "ratio of speeds",
        curves,
    )

    law = program([Segment(0.8, 0.03), Segment(0.4, 0.03), Segment(0.8, 0.0), Segment(TURN - 2.0)])
    cam = cam_on_base(law, Follower(Translating(), Roller(0.02)), 0.02)
    drawn = cam.at(np.linspace(0.0, TURN, 2001)).working * 1e3
    contour = cut_profile(cam).contour
    left = contour(np.linspace(0.0, contour.count, 4001))[0] * 1e3
    shapes: list[Curve] = [(drawn.real, drawn.imag, RED, "drawn"), (left.real, left.imag, BLUE, "what the cutter leaves")]
    plot(IMAGES / "hard-cams.svg", "An undercut cam", "x [mm]", "y [mm]", shapes, equal=True)

    x = np.linspace(0.0, 0.3, 301)
    effort = np.array([float(load_at(sleeve(float(e), 0.08, 0.2), [0.0], 0.1).effort("H")[0]) for e in x])
    shown = np.where(effort < 600.0, effort, np.nan)
    plot(
        IMAGES / "hard-friction.svg",
        "Effort for a weight of 30 N; it jams from 200 mm on",
        "arm [mm]",
        "effort [N]",
        [(1e3 * x, shown, BLUE, "")],
    )

    stop = Stop(name="wall", pair="O", at=-np.pi / 2 + 0.5, side="lower", restitution=0.5)
    simulation = simulate(pendulum(0.4, 1.5, 0.35, 1.0), 1.6, stops=[stop], tolerance=1e-9)
    t = np.linspace(0.0, 1.6, 1201)
    angle = np.degrees(simulation(t)[0][:, 0] + np.pi / 2)
    hits = len([h for h in simulation.events if h.kind == "impact"])
    plot(
        IMAGES / "hard-dynamics.svg",
        f"{hits} impacts, then contact",
        "time [s]",
        "angle from the vertical [deg]",
        [(t, angle, BLUE, "")],
    )
    input_picture()


def input_picture() -> None:
    """The report of a scene with seven slips."""
    from mechviz.hard_cases.input import seven_slips
    from mechviz.scene.faults import SceneError
    from mechviz.scene.scene import Scene

    try:
        Scene.build(name="mine", **seven_slips())
    except SceneError as error:
        lines = [part for line in str(error).splitlines() for part in re.findall(r".{1,112}(?:\s|$)", line) or [""]]
    sheet = Canvas(900, 30 + 17 * len(lines))
    for k, line in enumerate(lines):
        sheet.text(14 + 7 * (len(line) - len(line.lstrip())), 26 + 17 * k, line.strip(), size=12, color="#222222" if k else RED)
    write_diagram(sheet, IMAGES / "hard-input.svg")


def main() -> None:
    """Make all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="measure the ladders shortly: to try, not for numbers to keep")
    quick = parser.parse_args().quick
    IMAGES.mkdir(exist_ok=True)
    hard_pictures()
    fill("hard-cases.md", hard_tables())
    found = ladders(quick)
    blocks = {"targets": targets(), "cheapest": cheapest_table(found), "estimates": estimates(), "effects": effects_block()}
    fill("accuracy.md", blocks)


if __name__ == "__main__":
    main()
