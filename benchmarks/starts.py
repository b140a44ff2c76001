"""Start of commands: processor time of `mechviz check` and `record` of a four-bar over that of `import numpy`.

python benchmarks/starts.py [TURNS]

Two columns, as numpy takes twice as long to load where it starts a thread for each core, which mechviz tells it not to: with the
number of threads left alone, as on a command line, and set to one for all. Processes take turns, the lower quartile counts.
Bytecode is kept, as where packages are installed.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from timing import interleaved, machine

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
LOADED = ("numpy", "typer", "pydantic.main", "mechcore", "rerun")
"""Loaded by themselves, to compare with."""


def spent() -> float:
    """Processor time of all processes that have been started and have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def least_quarter(times: list[float]) -> float:
    """Lower quartile."""
    return statistics.quantiles(times, n=4)[0]


def starts(environment: dict[str, str], turns: int, folder: str) -> dict[str, float]:
    """Processor time of each command [s]."""
    commands = {f"import {name}": ["-c", f"import {name}"] for name in LOADED}
    commands["mechviz check"] = ["-m", "mechviz", "check", "crank-rocker"]
    commands["mechviz record"] = ["-m", "mechviz", "record", "crank-rocker", "-o", str(Path(folder) / "run.rrd")]

    def job(arguments: list[str]) -> None:
        subprocess.run([sys.executable, *arguments], env=environment, check=True, capture_output=True)

    jobs = {name: lambda a=arguments: job(a) for name, arguments in commands.items()}
    return interleaved(jobs, runs=turns, seconds=0.0, pick=least_quarter, clock=spent)


def main() -> None:
    """The table."""
    turns = int(sys.argv[1]) if len(sys.argv) > 1 else 15
    one = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    with tempfile.TemporaryDirectory() as folder:
        columns = [starts(e, turns, folder) for e in ({n: v for n, v in one.items() if n not in THREADS}, one)]
    print(machine("numpy", "pydantic", "typer", "rerun-sdk"))
    print("\n| processor time over that of `import numpy` | threads left alone | one thread |")
    print("|---|---|---|")
    for name in columns[0]:
        print(f"| `{name}` | " + " | ".join(f"{c[name] / c['import numpy']:.2f} ({c[name] * 1e3:.0f} ms)" for c in columns) + " |")


if __name__ == "__main__":
    main()
