"""mechviz side by side with the packages that solve the same problems, in one run.

    python benchmarks/peers/run.py [--short] [--all] [--report FILE] [--only WORD]

P1: a four-bar over a turn, positions, velocities and accelerations of two pins and a coupler point. P2: a slider-crank over a turn
under gravity, inertia and a working force, all reactions and the driving torque. 360 and 3,600 positions each.

The packages are installed at fixed versions into an environment of their own beside this file (`.venv`, made on first use). Each
row runs in a process of its own, so that no package disturbs another, with one thread. The rows take turns; a turn repeats the
computation until it lasts a while; the table shows the median of processor time over the turns. Errors are taken against a closed
form in 30 digits.
``--all`` adds the large packages (Drake, OpenSim). A peer that cannot be installed or run is a row that says why.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import datetime
import importlib
import json
import math
import multiprocessing
import os
import statistics
import subprocess
import sys
import time
import traceback
import venv
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

HERE = Path(__file__).resolve().parent
HOME = HERE / ".venv"
CHECKOUT = HERE.parent.parent
SIZES = (360, 3600)
PROBLEMS = {
    "four-bar": "P1 Four-bar over a turn: positions, velocities, accelerations of pins B, C and coupler point P",
    "slider-crank": "P2 Slider-crank over a turn: all reactions and the driving torque",
}
KINDS = {"torque": "torque"}  # what is not named here is a force
PATIENCE = 300.0  # longest wait for an answer [s]


# -- environment ------------------------------------------------------------------------------------------------------
def peers(*, large: bool) -> dict[str, tuple[str, ...]]:
    """Peer modules beside this file and the packages that they need, read without importing them; mechviz first."""
    result = {}
    for path in sorted(HERE.glob("peer_*.py"), key=lambda p: (p.stem != "peer_mechviz", p.stem)):
        values = {}
        for node in ast.parse(path.read_text()).body:
            name = getattr(node.targets[0], "id", "") if isinstance(node, ast.Assign) else ""
            if name in ("PACKAGES", "LARGE"):
                values[name] = ast.literal_eval(node.value)
        if large or not values.get("LARGE"):
            result[path.stem] = values["PACKAGES"]
    return result


def environment(wanted: dict[str, tuple[str, ...]]) -> tuple[Path, dict[str, str]]:
    """The environment's Python, made and filled as far as needed; peers that cannot be installed, each with pip's first words."""
    python = HOME / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if not python.exists():
        print(f"making {HOME.relative_to(CHECKOUT)} ...", file=sys.stderr)
        venv.create(HOME, with_pip=True)
    record = HOME / "installed.json"
    done = json.loads(record.read_text()) if record.exists() else {}
    failed = {}

    def install(*what: str) -> str:
        print(f"installing {' '.join(what)} ...", file=sys.stderr)
        command = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *what]
        ran = subprocess.run(command, capture_output=True, text=True)
        lines = [line.removeprefix("ERROR: ") for line in ran.stderr.splitlines() if line.startswith("ERROR")]
        lines = [line for line in lines if not line.startswith("Ignored the following")]  # other versions, pages of them
        return (lines or [f"pip ended with exit code {ran.returncode}"])[0] if ran.returncode else ""

    for name, packages in wanted.items():
        if done.get(name) == list(packages):
            continue
        error = install(*packages)
        if not error and name == "peer_mechviz":
            error = install("--no-deps", "--editable", str(CHECKOUT))
        if error:
            failed[name] = error
        else:
            done[name] = list(packages)
            record.write_text(json.dumps(done, indent=1))
    return python, failed


def in_environment(wanted: dict[str, tuple[str, ...]], script: Path) -> dict[str, str]:
    """Go on in the peers' environment, with one thread: the script is run again there. The peers that cannot be installed."""
    if Path(sys.prefix).resolve() != HOME.resolve():  # it may be a link to that of another checkout
        python, failed = environment(wanted)
        again = {**os.environ, "PEERS_FAILED": json.dumps(failed)}
        sys.exit(subprocess.run([python, str(script.resolve()), *sys.argv[1:]], env=again).returncode)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"
    return json.loads(os.environ.get("PEERS_FAILED", "{}"))


# -- one row, in a process of its own ---------------------------------------------------------------------------------
def serve(pipe, module: str, problem: str, label: str) -> None:
    """Build the row, then answer: ("values", n) -> arrays, ("time", n, repeats) -> seconds for one computation."""
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)  # what packages print does not belong into the table
    from problem import angles

    try:
        start = time.perf_counter()
        solve = importlib.import_module(module).ROWS[problem][label]()
        turns = {n: angles(n) for n in SIZES}
        solve(turns[SIZES[0]])
        pipe.send(("ok", time.perf_counter() - start))
        while True:
            what, n, *rest = pipe.recv()
            turn = turns[n]
            if what == "values":
                pipe.send(("ok", solve(turn)))
            else:
                begin = time.process_time()
                for _ in range(rest[0]):
                    solve(turn)
                pipe.send(("ok", (time.process_time() - begin) / rest[0]))
    except EOFError:
        pass
    except Exception as error:
        print(traceback.format_exc(), file=sys.stderr)
        pipe.send(("error", f"{type(error).__name__}: {str(error).strip().splitlines()[0] if str(error).strip() else ''}"))


class Remote:
    """A process that answers questions; after a fault all answers are nan."""

    def __init__(self, target: Callable, *args: str):
        self.fault = ""
        context = multiprocessing.get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=target, args=(other, *args), daemon=True)
        self.process.start()
        other.close()

    def answer(self):
        """What the process says next; nan after a fault, which is kept."""
        try:
            if not self.pipe.poll(PATIENCE):
                raise TimeoutError(f"no answer in {PATIENCE:.0f} s")
            state, value = self.pipe.recv()
        except (EOFError, ConnectionError, TimeoutError) as error:
            self.process.join(1.0)
            state, value = "error", str(error) or f"the process ended with exit code {self.process.exitcode}"
        if state == "error":
            self.fault = value
            self.stop()
            return math.nan
        return value

    def ask(self, *question):
        if self.fault:
            return math.nan
        with contextlib.suppress(ConnectionError):  # a process that has ended: the answer says so
            self.pipe.send(question)
        return self.answer()

    def stop(self) -> None:
        self.pipe.close()
        self.process.join(2.0)
        if self.process.is_alive():
            self.process.terminate()


class Row(Remote):
    """A row of the table and the process behind it."""

    def __init__(self, module: str, problem: str, label: str):
        super().__init__(serve, module, problem, label)
        self.problem, self.label = problem, label
        self.times: dict[int, list[float]] = {n: [] for n in SIZES}
        self.ratios: dict[int, list[float]] = {n: [] for n in SIZES}
        self.errors: dict[str, float] = {}
        self.setup = self.answer()

    def check(self, n: int, reference: dict) -> None:
        """Largest error of each kind of value, relative to its largest value; infinite for kinds that the peer does not give."""
        computed = self.ask("values", n)
        if self.fault:
            return
        for key, right in reference.items():
            kind = ("position", "velocity", "acceleration")[key[1]] if isinstance(key, tuple) else KINDS.get(key, "force")
            error = float(abs(computed[key] - right).max() / abs(right).max()) if key in computed else math.inf
            self.errors[kind] = max(error if error == error else math.inf, self.errors.get(kind, 0.0))

    def time(self, n: int) -> float:
        return statistics.median(self.times[n]) if self.times[n] and not self.fault else math.nan

    def ratio(self, n: int) -> float:
        return statistics.median(self.ratios[n]) if self.ratios[n] and not self.fault else math.nan

    @property
    def error(self) -> float:
        return max(self.errors.values(), default=math.nan)

    @property
    def by_hand(self) -> bool:
        return self.label.startswith("by hand")


def measure(rows: list[Row], n: int, *, runs: int, seconds: float) -> None:
    """The rows take turns, as in `timing.interleaved`, timed inside their processes.

    Before each comes a turn of the first row, to which its ratio is taken: a machine that slows down on the way changes no ratios.
    """
    repeats = {}
    for row in rows:
        row.ask("time", n, 1)  # warm-up
        once = row.ask("time", n, 1)
        repeats[row.label] = 1 if math.isnan(once) else max(1, round(seconds / max(once, 1e-7)))
    own, *others = rows
    for _ in range(runs):
        for row in others or [own]:
            own.times[n].append(own.ask("time", n, repeats[own.label]))
            row.times[n].append(row.ask("time", n, repeats[row.label]))
            row.ratios[n].append(row.times[n][-1] / own.times[n][-1])
    own.ratios[n] = [1.0]


# -- report -----------------------------------------------------------------------------------------------------------
def number(value: float, digits: int = 3) -> str:
    """A value with some significant digits, without exponent."""
    if not math.isfinite(value):
        return "-"
    return f"{value:,.{max(0, digits - 1 - math.floor(math.log10(abs(value))))}f}" if value else "0"


def table(rows: list[Row], failed: dict[str, str]) -> list[str]:
    """The rows in order of their time; mechviz first."""
    own = rows[0]
    lines = ["| who | " + " | ".join(f"{n:,} positions | ratio" for n in SIZES) + " | set-up, once | error |", "|---|" + "---|" * 6]
    for row in sorted(rows, key=lambda r: (r is not own, r.by_hand, r.time(SIZES[0]) if not r.fault else math.inf)):
        if row.fault:
            lines.append(f"| {row.label} | could not be run: {row.fault} | | | | | |")
            continue
        cells = [f"{number(1e3 * row.time(n))} ms | {number(row.ratio(n))}" for n in SIZES]
        errors = ", ".join(f"{kind} {'not given' if math.isinf(e) else f'{e:.0e}'}" for kind, e in row.errors.items())
        lines.append(f"| {row.label} | {' | '.join(cells)} | {number(row.setup, 2)} s | {errors} |")
    lines += [f"| {name.removeprefix('peer_')} | could not be installed: {error} | | | | | |" for name, error in failed.items()]
    return lines


def bars(problem: str, rows: list[Row]) -> list[str]:
    """The factors that were set before anything was measured, met or not. Rows by hand and rows at fault do not count."""
    own, short, long = rows[0], *SIZES
    others = [r for r in rows if not r.fault and not r.by_hand and not r.label.startswith("mechviz")]
    compiled = next((r for r in rows[1:] if r.label.startswith("mechviz") and not r.fault), None)
    lines = []

    def bar(text: str, value: str, met: bool) -> None:
        lines.append(f"- {text}: {value}, **{'met' if met else 'not met'}**")

    if problem == "four-bar":
        numba = next((r for r in others if r.label == "pylinkage with numba"), None)
        if numba:
            for ours, by in ((own, "numpy"), (compiled, "a compiled program")):
                for n, factor in ((short, 2.0), (long, 6.0)) if ours else ():
                    ratio = numba.ratio(n) / ours.ratio(n)
                    text = f"{n:,} positions by {by} at least {factor:.0f}x faster than pylinkage with numba"
                    bar(text, f"{ratio:.2f}x", ratio >= factor)
        rest = [r for r in others if r is not numba]
        for n in SIZES if rest else ():
            best = min(rest, key=lambda r: r.ratio(n))
            text = f"{n:,} positions at least 40x faster than every other peer"
            bar(text, f"{best.ratio(n):.1f}x ({best.label})", best.ratio(n) >= 40.0)
    else:
        bar(f"{short} positions in at most 0.4 ms", f"{1e3 * own.time(short):.3f} ms", own.time(short) <= 0.4e-3)
        engines = [r for r in others if "sympy" not in r.label]
        for factor, kind, group in ((8.0, "peer", others), (25.0, "engine", engines)):
            if group:
                best = min(group, key=lambda r: r.ratio(short))
                text = f"{short} positions at least {factor:.0f}x faster than the best {kind}"
                bar(text, f"{best.ratio(short):.1f}x ({best.label})", best.ratio(short) >= factor)
        each = 1e6 * own.time(long) / long
        bar(f"at most 0.8 us a position at {long:,}", f"{each:.3f} us", each <= 0.8)
    bar("error at most 1e-13", f"{own.error:.1e}", own.error <= 1e-13)
    equal = [r for r in others if r.error <= 1e-12]
    hand = [r for r in rows if r.by_hand and not r.fault]
    for kind, group in (("peer that gives everything to 1e-12", equal), ("row by hand", hand)):
        if group:
            best = min(group, key=lambda r: r.ratio(short))
            times = " and ".join(f"{number(best.ratio(n))}x" for n in SIZES)
            lines.append(f"- not a bar: the fastest {kind} takes {times} mechviz's time ({best.label.removeprefix('by hand: ')})")
    return lines


def head(versions: list[str], settings: SimpleNamespace) -> list[str]:
    sys.path.insert(0, str(HERE.parent))
    from timing import machine

    return [
        "# mechviz and its peers",
        "",
        f"{datetime.date.today().isoformat()}; {machine('numpy', 'scipy')}",
        "",
        f"Packages: {', '.join(versions)}.",
        "",
        f"Medians of processor time over {settings.runs} turns of about {settings.seconds} s or one computation each; the rows "
        "take turns, each in a process of its own. On a shared machine read ratios, not times. Times are for a model in hand: "
        "building it, importing the package and compiling (numba) are left out and stand under set-up, together with the first "
        "computation of 360 positions. "
        "Ratio: median of time over mechviz's time just before. "
        "Error: largest error of both sizes relative to the largest value, against a closed form in 30 digits. "
        "Rows by hand are no package's service but equations worked out for this one mechanism; bars do not count them.",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="fewer and shorter turns")
    parser.add_argument("--all", action="store_true", help="with the large packages")
    parser.add_argument("--report", type=Path, metavar="FILE", help="write the tables to a file as well")
    parser.add_argument("--only", metavar="WORD", default="", help="only peers whose file name contains the word, and mechviz")
    options = parser.parse_args()
    wanted = {k: v for k, v in peers(large=options.all).items() if options.only in k or k == "peer_mechviz"}
    failed = in_environment(wanted, Path(__file__))
    from problem import REFERENCES, angles

    settings = SimpleNamespace(runs=5, seconds=0.1) if options.short else SimpleNamespace(runs=9, seconds=0.25)
    modules = [importlib.import_module(name) for name in wanted if name not in failed]
    lines = head(sorted({p for name in wanted if name not in failed for p in wanted[name]}), settings)
    for problem, title in PROBLEMS.items():
        rows = []
        for module in modules:
            for label in module.ROWS.get(problem, ()):
                print(f"{problem}: {label} ...", file=sys.stderr)
                rows.append(Row(module.__name__, problem, label))
        for n in SIZES:
            reference = REFERENCES[problem](angles(n))
            for row in rows:
                row.check(n, reference)
            print(f"{problem}: timing {n} positions ...", file=sys.stderr)
            measure(rows, n, **vars(settings))
        lines += ["", f"## {title}", "", *table(rows, failed), "", "Bars:", "", *bars(problem, rows)]
        for row in rows:
            row.stop()
    text = "\n".join(lines) + "\n"
    print(text, end="")
    if options.report:
        options.report.write_text(text)


if __name__ == "__main__":
    main()
