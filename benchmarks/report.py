"""All benchmarks in one run, one report: benchmarks/REPORT.md with its plots in benchmarks/report/.

    python benchmarks/report.py [--short] [--alone] [--only WORD ...]

P1 and P2 (kinematics, kinetostatics), P3 and P4 (forward dynamics) side by side with the peers, P5 (cams), scaling with loops and
designs, recording throughput against the SDK's own limit, cost of effects, what accuracy costs, and how true the errors are that
the program reports. Each part is a script of its own that anyone can run; this one runs them one after the other, keeps what they
print and draws their tables. ``--short``: fewer turns, smaller sizes; ``--alone``: no peers; ``--only``: parts whose names contain
a word. A part that fails says so in its place; the report is written anew after every part.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
PLOTS = HERE / "report"
PATIENCE = 3600.0  # longest time of a part [s]
sys.path[:0] = [str(ROOT / "core"), str(ROOT), str(HERE)]

from curves import draw_curves, precision_curves, slug

Table = list[list[str]]


@dataclass(frozen=True)
class Part:
    """A chapter of the report: the script that makes it, and how its tables are drawn."""

    name: str
    title: str
    about: str
    command: Callable[[argparse.Namespace], list[str]]
    peers: bool = False
    draw: Callable[[str, Path], list[Path]] = lambda *_: []


def tables(text: str) -> list[tuple[str, Table]]:
    """Markdown tables in a text, each with the last heading before it."""
    result: list[tuple[str, Table]] = []
    heading, inside = "", False
    for line in text.splitlines():
        if line.startswith("#"):
            heading = line.lstrip("# ")
        row = line.startswith("|")
        if row and set(line) <= set("|-: "):
            continue
        if row:
            cells = [c.strip() for c in line.strip().strip("|").split("|")]
            if not inside:
                result.append((heading, []))
            result[-1][1].append(cells)
        inside = row
    return result


def number(text: str) -> float:
    """The first number in a cell; NaN where there is none."""
    words = text.replace(",", "").split()
    try:
        return float(words[0])
    except (IndexError, ValueError):
        return float("nan")


def draw_precision(text: str, folder: Path) -> list[Path]:
    """Work-precision diagrams of the tables that have a time and an error for every who and setting."""
    drawn = []
    for heading, table in tables(text):
        if table[0][:2] == ["who", "setting"] and (curves := precision_curves(table[1:])):
            title = heading.removeprefix("Work and precision, ")
            drawn.append(draw_curves(title, table[0][3], curves, folder / f"curve-{slug(title)}.svg"))
    return drawn


NUMBERS = re.compile(r"\d\.?\d*e-\d+")


def draw_peers(text: str, folder: Path) -> list[Path]:
    """Error against time of the tables that have a row for every peer: a panel for each problem and number of positions."""
    panels = []
    for heading, table in tables(text):
        head = table[0]
        if head[0] != "who" or not head[-1].startswith("error"):
            continue
        for c in (c for c, name in enumerate(head) if name.endswith(("positions", "points"))):
            result = [(row[0], 1e-3 * number(row[c]), [float(e) for e in NUMBERS.findall(row[-1])]) for row in table[1:]]
            points = [(who, seconds, max(errors)) for who, seconds, errors in result if seconds > 0.0 and errors]
            if points:
                panels.append((f"{heading.split(':')[0]}, {head[c]}", points))
    return [_numbered(panel, points, folder / f"peers-{slug(panel)}.svg") for panel, points in panels]


def _numbered(title: str, points: list[tuple[str, float, float]], path: Path) -> Path:
    """Numbered points on logarithmic axes, and who they are."""
    from mechviz.figures import chart, save_chart
    from mechviz.studies.precision_diagram import precision_axes

    with chart(9.4, max(3.3, 0.6 + 0.19 * len(points))) as figure:
        axes = figure.subplots()
        precision_axes(axes, [seconds for _, seconds, _ in points])
        axes.set(title=title, xlabel="time", ylabel="error")
        for k, (who, seconds, error) in enumerate(points, 1):
            color, place = ("#c8553d" if who.startswith(("mechviz", "mechcore")) else "#1b6ca8"), (seconds, max(error, 1e-16))
            axes.plot(*place, "o", color=color, markersize=5.0, label=f"{k}  {who}", gid=f"who-{k}")
            axes.annotate(str(k), place, xytext=(4, 4), textcoords="offset points", color=color)
        figure.legend(loc="outside right upper")
    save_chart(figure, path)
    return path


def draw_growth(text: str, folder: Path) -> list[Path]:
    """Time against size, both logarithmic, of the tables whose first column counts something."""
    from mechviz.figures import chart, save_chart

    drawn = []
    for k, (_, table) in enumerate(tables(text)):
        head, rows = table[0], [[number(c) for c in row] for row in table[1:]]
        if head[0] not in ("loops", "N", "frames") or len(rows) < 2:
            continue
        sizes = [row[0] for row in rows]
        with chart(5.6, 3.4) as figure:
            axes = figure.subplots()
            for c, name in enumerate(head):
                if name.startswith(("compile", "motion", "energy", "memory")):
                    axes.plot(sizes, [row[c] for row in rows], "o-", markersize=4.0, label=name)
            axes.set(xscale="log", yscale="log", xlabel=head[0])
            axes.set_xticks(sizes, [f"{size:g}" for size in sizes], minor=False)
            axes.set_xticks([], minor=True)
            figure.legend(loc="outside upper left", ncols=4)
        path = folder / f"growth-{k + 1}.svg"
        save_chart(figure, path)
        drawn.append(path)
    return drawn


def keep_diagrams(_: str, folder: Path) -> list[Path]:
    """The diagrams that the commands themselves have written."""
    return sorted(folder.glob("accuracy-*.svg"))


def script(name: str, *more: str) -> list[str]:
    """A benchmark script in this Python."""
    return [sys.executable, str(HERE / name), *more]


def _short(given: argparse.Namespace, *more: str) -> list[str]:
    return [*more, *(["--short"] if given.short else [])]


SAMPLE = ("crank-rocker", "triad", "slider-crank-compressor", "ten-link-forces", "cam-roller", "stick-slip-feed")

PARTS: tuple[Part, ...] = (
    Part(
        "peers",
        "P1, P2: kinematics and kinetostatics beside the peers",
        "Positions, velocities, accelerations of a four-bar; all reactions of a slider-crank.",
        lambda g: script("peers/run.py", *_short(g)),
        peers=True,
        draw=draw_peers,
    ),
    Part(
        "precision",
        "P1, P2: work and precision",
        "The settings of all varied: stop of Newton's method, steps of engines, rates by differences, positions computed.",
        lambda g: script("peers/precision.py", *_short(g)),
        peers=True,
        draw=draw_precision,
    ),
    Part(
        "four-bar",
        "A loop with fsolve, and the cost of a frame",
        "A four-bar from positions to the driving torque.",
        lambda g: script("four_bar.py"),
    ),
    Part(
        "dynamics",
        "P3, P4: forward dynamics",
        "Andrews' squeezer, chains of four-bars through their singular position, several freedoms.",
        lambda g: script("dynamics.py", *_short(g), *(["--alone"] if g.alone else [])),
        draw=draw_precision,
    ),
    Part(
        "cams",
        "P5: cams",
        "Profile, pressure angle, curvature and limits of an offset roller follower.",
        lambda g: script("cams.py"),
    ),
    Part(
        "cam peers",
        "P5: beside a peer",
        "The package `mechanism` ignores the roller and the offset, and finds another base circle.",
        lambda g: script("cam_peers.py"),
        peers=True,
        draw=draw_peers,
    ),
    Part(
        "cam precision",
        "P5: work and precision",
        "A cam from more or fewer points of a turn, beside the packages: with an offset roller, which they ignore, and without.",
        lambda g: script("cam_precision.py", *_short(g)),
        peers=True,
        draw=draw_precision,
    ),
    Part(
        "scaling",
        "Scaling with loops and designs",
        "Chains of N four-bars over a turn; sweeps.",
        lambda g: script("scaling.py", *_short(g)),
        draw=draw_growth,
    ),
    Part(
        "recording",
        "Recording against the SDK's own limit",
        "The limit: the same columns, kept ready, sent to a file and nothing else.",
        lambda g: script("recording.py", *_short(g)),
    ),
    Part(
        "effects",
        "Price of effects",
        "Each effect by itself over kinematics alone.",
        lambda g: script("effects.py", "360"),
    ),
    Part(
        "accuracy",
        "What accuracy costs",
        "`mechviz accuracy` for two gallery scenes: error against time of every setting.",
        lambda g: [sys.executable, "-c", LADDERS, str(PLOTS), "quick" if g.short else "whole"],
        draw=keep_diagrams,
    ),
    Part(
        "estimates",
        "Are the reported errors true?",
        "Estimates over true errors, against references of other methods.",
        lambda g: script("error_estimates.py", *(SAMPLE if g.short else ())),
    ),
)

LADDERS = """
import sys
from mechviz.commands.main import app
for name in ("crank-rocker", "slider-crank-compressor"):
    more = ["--quick"] if sys.argv[2] == "quick" else []
    app(["accuracy", name, "--target", "1e-6", "--again", "--all", "-o", f"{sys.argv[1]}/accuracy-{name}.svg", *more],
        standalone_mode=False)
    print()
"""


def run(part: Part, given: argparse.Namespace) -> tuple[str, float, str]:
    """What a part prints, how long it took [s], and what went wrong."""
    path = os.pathsep.join([str(ROOT / "core"), str(ROOT)])
    env = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "160"}
    if given.short:
        env["MECHVIZ_BENCHMARKS"] = "short"
    start = time.perf_counter()
    try:
        done = subprocess.run(part.command(given), capture_output=True, text=True, env=env, cwd=ROOT, timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        return "", time.perf_counter() - start, f"it was stopped after {PATIENCE:.0f} s"
    words = done.stderr.strip().splitlines()
    fault = "" if done.returncode == 0 else f"it ended with exit code {done.returncode}: {words[-1] if words else ''}"
    return done.stdout.replace(f"{ROOT}/", ""), time.perf_counter() - start, fault  # no path of this machine


def as_markdown(text: str) -> str:
    """What a script printed: its tables as they are, everything else as it stands."""
    lines, out, plain = text.strip("\n").splitlines(), [], False
    for line in lines:
        table = line.startswith(("|", "#", "-")) or not line.strip()
        if not table and not plain:
            out.append("```text")
        if table and plain and line.strip():
            while out and not out[-1].strip():
                out.pop()
            out += ["```", ""]
        plain = (not table) if line.strip() else plain
        out.append(f"##{line}" if line.startswith("#") else line)
    if plain:
        out.append("```")
    return "\n".join(out)


def versions() -> str:
    """Versions of what the figures depend on."""
    result = []
    for package in ("mechviz", "numpy", "scipy", "rerun-sdk", "trimesh", "shapely"):
        try:
            result.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            result.append(f"{package} (not installed)")
    return ", ".join(result)


def main() -> None:
    """Run the parts, write the report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="fewer turns, smaller sizes")
    parser.add_argument("--alone", action="store_true", help="without the peers, which have to be installed once")
    parser.add_argument("--only", nargs="*", default=[], metavar="WORD", help="only parts whose name contains a word")
    parser.add_argument("--output", type=Path, default=HERE / "REPORT.md", help="the report [default: benchmarks/REPORT.md]")
    given = parser.parse_args()
    from mechviz.studies.cost import machine

    PLOTS.mkdir(exist_ok=True)
    for old in () if given.only else PLOTS.glob("*.svg"):  # of parts that draw other pictures now
        old.unlink()
    mode = "short mode" if given.short else "whole"
    command = f"python benchmarks/report.py{' --short' if given.short else ''}{' --alone' if given.alone else ''}"
    lines = [
        "# Benchmarks",
        "",
        f"{date.today().isoformat()}, {mode}. {machine()}; {versions()}; {platform.platform()}; one thread.",
        "",
        f"Read ratios, not times: on a shared machine ratios keep, times drift. Made by `{command}`.",
        "",
    ]
    began, spent = time.perf_counter(), _processor_time()
    for part in PARTS:
        if given.only and not any(word in part.name for word in given.only):
            continue
        lines += [f"## {part.title}", "", part.about, ""]
        if part.peers and given.alone:
            lines += ["Left out: this run is without peers.", ""]
            continue
        print(f"{part.name} ...", file=sys.stderr, flush=True)
        text, seconds, fault = run(part, given)
        lines += chapter(part, text, fault, given.output.resolve().parent)
        write(given.output, lines)
        used, spent = spent, _processor_time()
        print(
            f"{part.name}: {seconds:.0f} s, {spent - used:.0f} s of a processor{', failed' if fault else ''}",
            file=sys.stderr,
            flush=True,
        )
    lines += [f"All parts took {time.perf_counter() - began:.0f} s.", ""]
    write(given.output, lines)
    print(given.output)


def _processor_time() -> float:
    """What all parts so far have used [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def chapter(part: Part, text: str, fault: str, folder: Path) -> list[str]:
    """What a part has printed, and its plots with paths from ``folder``."""
    lines = [f"**This part failed**: {fault}", ""] if fault else []
    lines += [as_markdown(text), ""]
    try:
        drawn = part.draw(text, PLOTS)
    except (ValueError, ZeroDivisionError) as error:  # a table with holes has no picture
        return [*lines, f"(no plot: {error})", ""]
    for path in drawn:
        lines += [f"![{part.title}]({os.path.relpath(path, folder).replace(os.sep, '/')})", ""]
    return lines


def write(path: Path, lines: list[str]) -> None:
    """Replace the report as a whole."""
    temporary = path.with_suffix(".part")
    temporary.write_text("\n".join(lines), encoding="utf-8")
    temporary.replace(path)


if __name__ == "__main__":
    main()
