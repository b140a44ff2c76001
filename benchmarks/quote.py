"""The figures of docs/performance.md, quoted from a report: python benchmarks/quote.py [--report FILE] [--print]

Only ratios are quoted. What stands between `<!-- block: performance -->` and `<!-- end -->` on that page is replaced; a part that
is missing in the report, or has failed, gets no row.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from report import number, tables

Tables = list[tuple[str, list[list[str]]]]
Quote = Callable[[Tables, str], str]


def table(tables: Tables, heading: str) -> list[list[str]]:
    """The first table whose heading, or first cell, starts with some words; raises LookupError where there is none."""
    for title, rows in tables:
        if title.startswith(heading) or rows[0][0].startswith(heading):
            return rows
    raise LookupError(heading)


def least(values: list[float]) -> float:
    """The smallest of some numbers; raises LookupError where there is none."""
    known = [v for v in values if v == v]
    if not known:
        raise LookupError("no number")
    return min(known)


def times(value: float) -> str:
    """A ratio in words, rounded downwards to two digits."""
    step = 10.0 ** (len(str(int(value))) - 2)
    return f"{int(value / step) * step:.{1 if step < 1 else 0}f}"


def line(text: str, pattern: str) -> str:
    """The first group of a pattern in a text; raises LookupError where it does not occur."""
    match = re.search(pattern, text)
    if match is None:
        raise LookupError(pattern)
    return match[1]


def fsolve(tables: Tables, _: str) -> str:
    return f"{times(number(table(tables, 'four-bar, positions to torque')[2][2]))} times faster"


def frame_cost(tables: Tables, _: str) -> str:
    rows = next(rows for _, rows in tables if rows[0][:2] == ["frames", "us a frame"])
    return " and ".join(row[2] for row in rows[2:4])


def four_bar(column: int) -> Quote:
    def quote(tables: Tables, _: str) -> str:
        rows = [r for r in table(tables, "P1 Four-bar")[1:] if not r[0].startswith(("mechviz", "by hand"))]
        numba = [r for r in rows if "with numba" in r[0]]
        others = [r for r in rows if r not in numba]
        one, many = (least([number(r[column]) for r in some]) for some in (numba, others))
        return f"{times(one)} times / at least {times(many)} times faster"

    return quote


def compiled(tables: Tables, _: str) -> str:
    rows = {r[0]: r for r in table(tables, "P1 Four-bar")[1:]}
    ours, numba = rows["mechviz, compiled"], rows["pylinkage with numba"]
    return " / ".join(times(number(numba[c]) / number(ours[c])) for c in (2, 4)) + " times faster"


def by_hand(heading: str) -> Quote:
    """The fastest row that is no package's service but equations worked out for the one mechanism, at few and many positions."""

    def quote(tables: Tables, _: str) -> str:
        rows = [r for r in table(tables, heading)[1:] if r[0].startswith("by hand")]
        return " / ".join(compared(least([number(r[c]) for r in rows])) for c in (2, 4))

    return quote


def compared(ratio: float) -> str:
    """How much faster, or slower, in words; rounded against us."""
    return f"{times(ratio)} times faster" if ratio >= 1.0 else f"{math.ceil(10.0 / ratio) / 10.0:.1f} times slower"


def beside(heading: str, peer: str, setting: str) -> Quote:
    """A row of a peer beside the fastest of ours with that error or less, by numpy and by a compiled program."""

    def quote(tables: Tables, _: str) -> str:
        rows = table(tables, heading)[1:]
        spent, error = next((number(r[2]), number(r[3])) for r in rows if r[:2] == [peer, setting])
        said = []
        for who, how in (("mechviz", "by numpy"), ("mechviz, C", "by a compiled program")):
            ours = [number(r[2]) for r in rows if r[0] == who and number(r[3]) <= error]
            said.append(f"{how} {compared(spent / least(ours))}")
        return ", ".join(said)

    return quote


def forces(tables: Tables, _: str) -> str:
    rows = [r for r in table(tables, "P2 Slider-crank")[1:] if not r[0].startswith(("mechviz", "by hand"))]
    return " / ".join(times(least([number(r[c]) for r in rows])) for c in (2, 4)) + " times faster"


def chains(who: str) -> Quote:
    """How many times faster than the fastest peer the fastest of some rows is."""

    def quote(tables: Tables, _: str) -> str:
        said = []
        for n in (1, 2, 10, 40):
            try:
                rows = table(tables, f"Chain of {n} four-bar")[1:]
            except LookupError:
                continue
            ours = least([number(r[2]) for r in rows if r[0] == who])
            peers = least([number(r[2]) for r in rows if not r[0].startswith("mechviz") and number(r[3]) < 1e-3])
            said.append(f"N = {n}: {times(peers / ours)}")
        if not said:
            raise LookupError("chains")
        return ", ".join(said) + " times faster"

    return quote


def squeezer(tables: Tables, _: str) -> str:
    rows = table(tables, "Andrews' squeezing")[1:]
    said = []
    for who in ("Pinocchio", "MuJoCo", "exudyn"):
        said.append(f"{who} {times(least([number(r[4]) for r in rows if r[0].startswith(who) and number(r[3]) < 5e-6]))}")
    return ", ".join(said) + " times faster"


def freedoms(tables: Tables, _: str) -> str:
    ratios = []
    for heading in ("Double pendulum", "Five-bar"):
        rows = [r for r in table(tables, heading)[1:] if r[0] == "same equations + DOP853" and r[1] == "rtol 1e-09"]
        ratios.append(times(least([number(r[4]) for r in rows])))
    return " / ".join(ratios) + " times faster"


def cams(tables: Tables, _: str) -> str:
    rows = table(tables, "P5 Offset roller")[1:]
    own, other = (next(r for r in rows if r[0].startswith(who)) for who in ("mechcore: profile", "mechanism: laws and profile"))
    return f"{times(number(other[2]))} times faster; errors of {own[3]} and {other[3]} of the lift"


def slopes(_: Tables, text: str) -> str:
    motion, memory = (line(text, rf"slope of log {what} against log N from N = 100 on: ([0-9.]+)") for what in ("motion", "memory"))
    return f"{motion}, memory {memory}"


def recorded(tables: Tables, _: str) -> str:
    rows = table(tables, "scene")
    return "; ".join(f"`{r[0]}` {r[6]}, {number(r[7]) / 1e3:.1f} kB a frame" for r in rows[1:])


def effects(_: Tables, text: str) -> str:
    part = line(text, r"(?s)(slider-crank, \d+ frames.*?)belt drive")
    names = ("a scene without effects, by its plan", "force", "inertia", "the whole engine")
    return " / ".join(line(part, rf"(?m)^{re.escape(name)}\s+([0-9.]+)") for name in names)


def estimates(_: Tables, text: str) -> str:
    share = line(text, r"(?m)^all .*within a factor of ten in ([0-9.]+ %)")
    return f"{share} of {line(text, r'(?m)^all +([0-9]+) results')} results"


QUOTES: tuple[tuple[str, Quote, str], ...] = (
    ("four-bar, positions to driving torque, 360 frames, against a loop over `scipy.optimize.fsolve`", fsolve, "four_bar.py"),
    ("the same, cost of a frame at 3,600 and at 36,000 frames against 360", frame_cost, "four_bar.py"),
    ("four-bar kinematics at 3,600 positions (P1), against pylinkage with numba / every other peer", four_bar(4), "peers/run.py"),
    ("the same at 360 positions, where numpy's price per call counts", four_bar(2), "peers/run.py"),
    ("the same by a compiled program, 360 / 3,600 positions, against pylinkage with numba", compiled, "peers/run.py"),
    (
        "the same, 360 / 3,600 positions, against the fastest solution by hand for this one mechanism",
        by_hand("P1 Four-bar"),
        "peers/run.py",
    ),
    ("slider-crank forces (P2), 360 / 3,600 positions, against the fastest peer", forces, "peers/run.py"),
    (
        "the same against the fastest by hand for this one mechanism: formulas by sympy, on all frames at once",
        by_hand("P2 Slider-crank"),
        "peers/run.py",
    ),
    ("Andrews' squeezer (P3), errors below 5e-6, ours smaller, against the fastest row of each", squeezer, "dynamics.py"),
    (
        "the same with a damped crank, against Pinocchio with DOP853 at rtol 1e-9, our error smaller",
        beside("Andrews' squeezing mechanism, crank damped", "Pinocchio + DOP853", "rtol 1e-09"),
        "dynamics.py",
    ),
    (
        "chain of N falling four-bars (P4), 10 s, against the fastest peer with an error below 1e-3",
        chains("mechviz"),
        "dynamics.py",
    ),
    ("the same by a compiled program, which has been loaded", chains("mechviz, C"), "dynamics.py"),
    ("the same, further motions of a mechanism that has kept its table", chains("mechviz, further motions"), "dynamics.py"),
    (
        "double pendulum, 5 s, against Pinocchio's `aba` with DOP853 at rtol 1e-9, our error smaller",
        beside("Double pendulum", "Pinocchio + DOP853", "rtol 1e-09"),
        "dynamics.py",
    ),
    (
        "five-bar on springs, 2 s, against Pinocchio's `constraintDynamics` with DOP853 at rtol 1e-9, our error smaller",
        beside("Five-bar", "Pinocchio + DOP853", "rtol 1e-09"),
        "dynamics.py",
    ),
    ("double pendulum / five-bar, against scipy's DOP853 on the same equations at 1e-9", freedoms, "dynamics.py"),
    ("cam with an offset roller (P5), profile, pressure angle and curvature, against `mechanism`", cams, "cam_peers.py"),
    ("chain of N four-bars, a turn: slope of log processor time against log N from N = 100", slopes, "scaling.py"),
    ("ten links recorded: time of writing over that of the SDK with the same columns", recorded, "recording.py"),
    (
        "slider-crank over kinematics alone: no effects named / a constant force / inertia / a whole engine",
        effects,
        "effects.py",
    ),
    ("reported errors within a factor of ten of the true ones", estimates, "error_estimates.py"),
)


def block(text: str) -> str:
    """The table of quotes from the text of a report, with the report's own words on its day, mode and machine."""
    columns = tables(text)
    head = next(row for row in text.splitlines() if re.match(r"\d{4}-\d\d-\d\d, ", row))
    lines = [
        f"`benchmarks/REPORT.md`, {head.split(';')[0]}:",
        "",
        "| what | figure | script |",
        "|---|---|---|",
    ]
    for what, quote, script in QUOTES:
        try:
            lines.append(f"| {what} | {quote(columns, text)} | `benchmarks/{script}` |")
        except (LookupError, StopIteration) as missing:
            print(f"left out: {what} ({missing} is not in the report)", file=sys.stderr)
    return "\n".join(lines)


def main() -> None:
    """Print the block, or put it into the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--report", type=Path, default=HERE / "REPORT.md")
    parser.add_argument("--print", action="store_true", help="print, and change nothing")
    given = parser.parse_args()
    body = block(given.report.read_text(encoding="utf-8"))
    if given.print:
        print(body)
        return
    page = HERE.parent / "docs" / "performance.md"
    text, count = re.subn(
        r"(<!-- block: performance -->\n).*?(<!-- end -->)",
        lambda m: f"{m[1]}\n{body}\n\n{m[2]}",
        page.read_text(encoding="utf-8"),
        flags=re.DOTALL,
    )
    if count != 1:
        raise SystemExit(f"{page.name}: the block is there {count} times")
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
