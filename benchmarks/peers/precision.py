"""Work and precision of P1 and P2: the settings of mechviz and of the packages beside it varied, error against time.

    python benchmarks/peers/precision.py [--short] [--all] [--only WORD]

At given crank angles: the stop of Newton's method, the steps of an engine, rates exactly or by differences of positions. At any
angle: how many positions of a turn are computed; what is between them is interpolated. Packages with a closed form have nothing
to turn and are one point. Environment, problems and references are those of `run.py`; every package runs in a process of its own,
the settings take turns, the least processor time counts.
"""

from __future__ import annotations

import argparse
import importlib
import math
import os
import sys
import time
import traceback
from dataclasses import dataclass
from pathlib import Path

from run import Remote, in_environment, peers

EXACT = 1e-12  # what is better than that is as good as exact
SLOW = 0.2  # [s]: what takes longer is timed twice, and no more


@dataclass(frozen=True)
class Panel:
    """A diagram: the problem, what is asked of it, the angles at which it is wanted."""

    problem: str
    name: str
    title: str
    positions: int
    away: float = 0.0  # of the way from one angle to the next: not where anything is computed

    def wanted(self):
        from problem import angles

        return angles(self.positions) + self.away * 2.0 * math.pi / self.positions


PANELS = (
    Panel("four-bar", "positions", "P1: four-bar, positions at 360 crank angles", 360),
    Panel("four-bar", "rates", "P1: four-bar, positions, velocities and accelerations at 360 crank angles", 360),
    Panel("four-bar", "any angle", "P1: four-bar, the same at any 3,600 crank angles, from fewer positions", 3600, 0.37),
    Panel("triad", "positions", "Plate on three legs, without a closed form: positions at 360 crank angles", 360),
    Panel("slider-crank", "forces", "P2: slider-crank, all reactions and the torque at 360 crank angles", 360),
    Panel("slider-crank", "any angle", "P2: slider-crank, the same at any 3,600 crank angles, from fewer positions", 3600, 0.37),
)


def settings(module, problem: str, panel: str, who: str) -> dict:
    """Setting -> a function of the wanted angles."""
    if who in getattr(module, "SETTINGS", {}).get((problem, panel), {}):
        return module.SETTINGS[problem, panel][who]()
    from problem import FOUR_BAR, SLIDER_CRANK
    from spread import from_fewer

    return from_fewer(module.ROWS[problem][who](), {"four-bar": FOUR_BAR, "slider-crank": SLIDER_CRANK}[problem].speed)


def rows(module, problem: str, panel: str) -> list[str]:
    """Who takes part: where other angles are wanted than are computed, the first row of every package that names none."""
    result = list(getattr(module, "SETTINGS", {}).get((problem, panel), {}))
    return result or ([*module.ROWS.get(problem, {})][:1] if panel == "any angle" else [])


def serve(pipe, module: str) -> None:
    """Answer: ("settings", problem, panel, who) -> their names, which are those that ("values", who, setting) -> arrays and
    ("time", who, setting, repeats) -> seconds for one computation speak of."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what packages print does not belong into the table
    jobs: dict = {}
    try:
        loaded = importlib.import_module(module)
        while True:
            what, *rest = pipe.recv()
            if what == "settings":
                problem, panel, who = rest
                jobs[who] = settings(loaded, problem, panel, who)
                wanted = next(p for p in PANELS if (p.problem, p.name) == (problem, panel)).wanted()
                pipe.send(("ok", list(jobs[who])))
                continue
            who, setting, *rest = rest
            job = jobs[who][setting]
            if what == "values":
                pipe.send(("ok", job(wanted)))
                continue
            begin = time.process_time()
            for _ in range(rest[0]):
                job(wanted)
            pipe.send(("ok", (time.process_time() - begin) / rest[0]))
    except EOFError:
        pass
    except Exception as error:
        print(traceback.format_exc(), file=sys.stderr)
        pipe.send(("error", f"{type(error).__name__}: {str(error).strip().splitlines()[0] if str(error).strip() else ''}"))


def error_of(computed: dict, reference: dict, panel: Panel) -> float:
    """The largest error of all that is wanted, relative to the largest value of each; infinite where something is not given."""
    worst = 0.0
    for key, right in reference.items():
        if panel.name == "positions" and key[1]:
            continue
        if key not in computed:
            return math.inf
        error = float(abs(computed[key] - right).max() / abs(right).max())
        worst = max(worst, error if error == error else math.inf)
    return worst


def curve(panel: Panel, remotes: dict[str, Remote], reference: dict, *, runs: int, seconds: float) -> list[str]:
    """The table of a panel: every setting of everybody with its time and its error."""
    jobs: dict[tuple[str, str], Remote] = {}
    for name, remote in remotes.items():
        for who in rows(importlib.import_module(name), panel.problem, panel.name):
            result = remote.ask("settings", panel.problem, panel.name, who)
            jobs |= {(who, setting): remote for setting in (() if remote.fault else result)}
    errors, repeats, times = {}, {}, {}
    for (who, setting), remote in jobs.items():
        result = remote.ask("values", who, setting)
        once = remote.ask("time", who, setting, 1)
        if not remote.fault:
            key = who, setting
            errors[key] = error_of(result, reference, panel)
            repeats[key], times[key] = max(1, round(seconds / max(once, 1e-7))), once
    for turn in range(runs):
        for who, setting in errors:
            if turn and times[who, setting] > SLOW:
                continue
            spent = jobs[who, setting].ask("time", who, setting, repeats[who, setting])
            if spent == spent and (spent < times[who, setting] or not turn):
                times[who, setting] = spent
    ours = [(times[key], errors[key]) for key in errors if key[0].startswith("mechviz")]
    lines = ["| who | setting | time [ms] | relative error | mechviz at this error or less is faster by |", "|---|---|---|---|---|"]
    for (who, setting), error in errors.items():
        better = [t for t, e in ours if e <= max(error, EXACT)]
        spent = times[who, setting]
        ratio = "" if who.startswith("mechviz") else f"{spent / min(better):.1f}" if better else "not reached"
        lines.append(f"| {who} | {setting} | {1e3 * spent:.3f} | {error:.1e} | {ratio} |")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="fewer and shorter turns")
    parser.add_argument("--all", action="store_true", help="with the large packages")
    parser.add_argument("--only", metavar="WORD", default="", help="only peers whose file name contains the word, and mechviz")
    options = parser.parse_args()
    wanted = {k: v for k, v in peers(large=options.all).items() if options.only in k or k == "peer_mechviz"}
    failed = in_environment(wanted, Path(__file__))
    from problem import REFERENCES

    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
    from timing import machine

    turns = {"runs": 3, "seconds": 0.02} if options.short else {"runs": 7, "seconds": 0.1}
    print(f"{machine('numpy', 'scipy')}; least processor time of {turns['runs']} turns, each package in a process of its own")
    for name, why in failed.items():
        print(f"{name.removeprefix('peer_')} could not be installed: {why}")
    remotes = {name: Remote(serve, name) for name in wanted if name not in failed}
    for panel in PANELS:
        print(f"{panel.title} ...", file=sys.stderr)
        lines = curve(panel, remotes, REFERENCES[panel.problem](panel.wanted()), **turns)
        print("\n".join(["", f"### Work and precision, {panel.title}", "", *lines]), flush=True)
    for name, remote in remotes.items():
        if remote.fault:
            print(f"\n{name.removeprefix('peer_')} came to an end: {remote.fault}")
        else:
            remote.stop()


if __name__ == "__main__":
    main()
