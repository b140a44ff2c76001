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
from matplotlib.ticker import MultipleLocator

from mechcore.constants import TURN
from mechviz.figures import chart, save_chart
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import run_scene
from mechviz.scene.scene import load
from mechviz.studies.cost import machine, processor_share
from mechviz.studies.influences import influence_lines, influences
from mechviz.studies.precision import PrecisionPoint, cheapest, ladder, load_study, store_study
from mechviz.studies.precision_diagram import diagram

HERE = Path(__file__).resolve().parent
IMAGES = HERE / "images"
sys.path[:0] = [str(HERE.parent / "benchmarks"), str(HERE.parent / "tests" / "support")]
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


def plot(path: Path, title: str, across: str, up: str, curves: list[Curve], *, equal: bool = False) -> None:
    """Curves over each other; gaps where a value is not finite."""
    with chart(*((4.8, 4.8) if equal else (6.4, 3.6))) as figure:
        axes = figure.subplots()
        for x, y, color, label in curves:
            axes.plot(x, y, color=color, label=label)
        axes.set(title=title, xlabel=across, ylabel=up)
        if "deg" in across:
            axes.xaxis.set_major_locator(MultipleLocator(90.0))
        if equal:
            axes.set_aspect("equal", adjustable="datalim")
        if any(label for *_, label in curves):
            figure.legend(loc="outside lower center", ncols=len(curves))
    save_chart(figure, path)


# -- accuracy.md ----------------------------------------------------------------------------------------------------------------


def targets() -> str:
    """Wanted and reached errors of some scenes."""
    from true_errors import between_error

    lines = [
        "| scene | wanted | frames | reached, at random times between frames | estimated by the run |",
        "|---|---|---|---|---|",
    ]
    for name in ("crank-rocker", "ten-link-forces", "triad"):
        for target in (1e-3, 1e-6, 1e-9):
            run = run_scene(load(name), accuracy=target)
            said = float(np.nanmax(run.errors.interpolation))
            lines.append(f"| `{name}` | {target:.0e} | {run.motion.frames - 1} | {between_error(run):.1e} | {said:.1e} |")
    return "\n".join(lines)


def ladders(quick: bool) -> dict[str, tuple[PrecisionPoint, ...]]:
    """The ladders that are drawn, measured or kept."""
    result = {}
    for name in ("crank-rocker", "andrews-squeezer"):
        scene = load(name)
        measured = load_study(scene, TARGET, rough=quick)
        if measured is None:
            with processor_share() as share:
                points = ladder(scene, TARGET, budget=0.02 if quick else 0.25, record=write_recording)
            measured = store_study(scene, TARGET, points, quick, share())
        title = f"{scene.title}: what accuracy costs"
        figure, words = diagram(measured.points, title, measured.foot, TARGET)
        save_chart(figure, IMAGES / f"accuracy-{name}.svg", words)
        result[name] = measured.points
    return result


def cheapest_table(result: dict[str, tuple[PrecisionPoint, ...]]) -> str:
    """The cheapest value of every setting that reaches the target."""
    lines = ["| scene | setting | cheapest value | error | time |", "|---|---|---|---|---|"]
    for name, points in result.items():
        for setting in dict.fromkeys(p.setting for p in points):
            best = cheapest([p for p in points if p.setting == setting], TARGET)
            words = (
                "none of the ladder | |"
                if best is None
                else f"{best.method}, {best.value} | {best.error:.1e} | {1e3 * best.seconds:.3g} ms"
            )
            lines.append(f"| `{name}` | {setting} | {words} |")
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
    base, result = influences(load("slider-crank-friction"))
    return code(["$ mechviz effects slider-crank-friction", *influence_lines(base, result, 0.01), "", f"measured on {machine()}"])


# -- hard-cases.md ----------------------------------------------------------------------------------------------------------------


def hard_tables() -> dict[str, str]:
    """The suite as tables."""
    from mechviz.hard_cases import all_cases
    from mechviz.hard_cases.case import CASE_FAMILIES

    blocks = {}
    for family in CASE_FAMILIES:
        lines = ["| case | what happens there | expected | error | allowed |", "|---|---|---|---|---|"]
        for case in all_cases(family):
            outcome = case.run()
            if not outcome.passed:
                raise SystemExit(f"{case.name} fails: {outcome.summary}")
            happens = case.difficulty + (f" (peers: {case.peers})" if case.peers else "")
            cells = [case.name, happens, case.expected, f"{outcome.worst.error:.1e}", f"{outcome.worst.bound:.0e}"]
            lines.append(f"| {' | '.join(c.replace('|', chr(92) + '|') for c in cells)} |")
        blocks[family] = "\n".join(lines)
    return blocks


def hard_pictures() -> None:
    """One picture a family, from what the program computes."""
    from mechcore.cams.followers import Follower, Roller, Translating
    from mechcore.cams.real_profiles import cut_profile
    from mechcore.cams.synthesis import cam_on_base
    from mechcore.dynamics.events import EndStop
    from mechcore.dynamics.simulate import simulate
    from mechcore.laws.program import Segment, program
    from mechcore.motion.solve import compile_mechanism, solve_motion
    from mechviz.hard_cases.mechanisms import forces_at, four_bar, pendulum, sleeve

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
    effort = np.array([float(forces_at(sleeve(float(e), 0.08, 0.2), [0.0], 0.1).effort("H")[0]) for e in x])
    shown = np.where(effort < 600.0, effort, np.nan)
    plot(
        IMAGES / "hard-friction.svg",
        "Effort for a weight of 30 N; it jams from 200 mm on",
        "arm [mm]",
        "effort [N]",
        [(1e3 * x, shown, BLUE, "")],
    )

    stop = EndStop(name="wall", joint="O", at=-np.pi / 2 + 0.5, side="lower", restitution=0.5)
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
    with chart(9.0, height := 0.3 + 0.19 * len(lines)) as figure:
        for k, line in enumerate(lines):
            top, words = height - 0.3 - 0.19 * k, line.rstrip().replace(" ", "\N{NO-BREAK SPACE}")
            figure.text(0.015, top / height, words, color="#222222" if k else RED, family="monospace", parse_math=False)
    save_chart(figure, IMAGES / "hard-input.svg")


def main() -> None:
    """Make all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="measure the ladders shortly: to try, not for numbers to keep")
    quick = parser.parse_args().quick
    IMAGES.mkdir(exist_ok=True)
    hard_pictures()
    fill("hard-cases.md", hard_tables())
    points = ladders(quick)
    blocks = {"targets": targets(), "cheapest": cheapest_table(points), "estimates": estimates(), "effects": effects_block()}
    fill("accuracy.md", blocks)


if __name__ == "__main__":
    main()
