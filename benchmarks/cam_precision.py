"""Work and precision of P5: a cam from more or fewer points of a turn, beside `mechanism`, `pylinkage` and formulas by hand.

    python benchmarks/cam_precision.py [--short]

Dwell-rise-dwell-fall, cycloidal. Wanted are 3,600 angles at none of which anything is computed before: points of the profile, or
pressure angles. Whoever computes at any angle does; and everybody computes some points of a turn, between which straight lines or
splines give the rest. The offset roller follower, which the packages do not have, and the follower in line with a knife edge,
which they have. Errors against the closed form in extended precision. The environment is that of `peers/run.py`.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
LIFT, BASE, OFFSET, ROLLER = 0.02, 0.04, 0.01, 0.01  # [m]
TURNS = (60.0, 120.0, 60.0, 120.0)  # dwell, rise, dwell, fall [deg]
COUNTS = (45, 90, 180, 360, 720, 1440, 3600)  # points of a turn; in short mode every second of these
SHORT = "--short" in sys.argv or os.environ.get("MECHVIZ_BENCHMARKS") == "short"
RUNS = 3 if SHORT else 7
PACKAGES = {"peer_mechanism": ("mechanism==1.1.10",), "peer_pylinkage": ("pylinkage==1.3.0", "numba==0.68.1")}


def main() -> None:
    """Make the environment, and measure in it."""
    sys.path.insert(0, str(HERE / "peers"))
    import run

    python, failed = run.environment(PACKAGES)
    for name, why in failed.items():
        print(f"{name.removeprefix('peer_')} could not be installed: {why}")
    paths = os.pathsep.join(str(p) for p in (HERE.parent / "core", HERE, HERE / "peers"))
    command = [python, __file__, "measure", *sys.argv[1:]]
    sys.exit(subprocess.run(command, env={**os.environ, "PYTHONPATH": paths}, check=False).returncode)


def closed_form(theta, offset, roller):
    """Profile [m] in the cam's axes and pressure angle [rad], written for this one program, in the precision of the angles."""
    import numpy as np

    pi = 4.0 * np.arctan(theta.dtype.type(1.0))
    edges = np.cumsum(np.asarray((0.0, *TURNS), theta.dtype)) * pi / 180.0
    s, slope = np.zeros_like(theta), np.zeros_like(theta)
    s[(theta >= edges[2]) & (theta < edges[3])] = LIFT
    for k, falls in ((1, False), (3, True)):
        on = (theta >= edges[k]) & (theta < edges[k + 1])
        turn = edges[k + 1] - edges[k]
        x = (theta[on] - edges[k]) / turn
        value, rate = LIFT * (x - np.sin(2.0 * pi * x) / (2.0 * pi)), LIFT * (1.0 - np.cos(2.0 * pi * x)) / turn
        s[on], slope[on] = (LIFT - value, -rate) if falls else (value, rate)
    height = np.sqrt(theta.dtype.type(BASE + roller) ** 2 - theta.dtype.type(offset) ** 2) + s
    across = slope - offset
    away = np.hypot(height, across)
    x, y = offset - roller * -across / away, height - roller * height / away  # contact in the follower's axes
    c, sn = np.cos(theta), np.sin(theta)
    return c * x + sn * y + 1j * (c * y - sn * x), np.arctan2(across, height)


def measure() -> None:
    """Times and errors of everybody."""
    from timing import interleaved, machine  # isort: skip  # first: it sets one thread

    import matplotlib

    matplotlib.use("Agg")  # the packages draw as well; nothing is drawn here
    import numpy as np

    wanted = (np.arange(3600) + 0.37) * (2.0 * np.pi / 3600)
    print(f"{machine('numpy', 'scipy')}; least processor time of {RUNS} turns")
    for title, error, offset, roller, which in (
        ("offset roller follower, profile at any 3,600 angles", "error, of the lift", OFFSET, ROLLER, 0),
        ("offset roller follower, pressure angle at any 3,600 angles", "error [rad]", OFFSET, ROLLER, 1),
        ("knife edge in line, profile at any 3,600 angles", "error, of the lift", 0.0, 0.0, 0),
    ):
        exact = closed_form(wanted.astype(np.longdouble), offset, roller)[which]
        jobs, errors = {}, {}
        for who, job in {**ours(wanted, offset, roller, which), **packages(wanted, which)}.items():
            try:
                errors[who] = apart(job(), exact) / (1.0 if which else LIFT)
                jobs[who] = job
            except Exception as fault:  # a package that fails does not disturb the others
                print(f"{' '.join(who)}: {type(fault).__name__}: {fault}"[:120])
        times = interleaved(jobs, runs=RUNS, seconds=0.05, pick=min, clock=time.process_time)
        best = [(times[w], e) for w, e in errors.items() if w[0].startswith("mechcore")]
        print(f"\n### Work and precision, P5: {title}\n")
        print(f"| who | setting | time [ms] | {error} | mechcore at this error or less is faster by |\n|---|---|---|---|---|")
        for (who, setting), e in errors.items():
            better = [t for t, mine in best if mine <= max(e, 1e-12)]
            spent = times[who, setting]
            ratio = "" if who.startswith("mechcore") else f"{spent / min(better):.1f}" if better else "not reached"
            print(f"| {who} | {setting} | {1e3 * spent:.3f} | {e:.1e} | {ratio} |")


def apart(computed, exact) -> float:
    """The largest difference. Of a profile that is another one, the largest distance of its points from the right curve: a package
    may count angles from other axes, so that it may be turned as a whole as well as it can be."""
    import numpy as np
    from scipy.spatial import cKDTree

    error = float(np.abs(computed - exact).max())
    if not np.iscomplexobj(exact) or error < 1e-2 * LIFT:
        return error
    right = exact.astype(complex)
    dense = np.concatenate([right + share * (np.roll(right, -1) - right) for share in np.arange(20) / 20])
    tree = cKDTree(np.column_stack([dense.real, dense.imag]))

    def away(turned: float, every: int = 20) -> float:
        z = computed[::every] * np.exp(1j * turned)
        return float(tree.query(np.column_stack([z.real, z.imag]))[0].max())

    best = min(np.linspace(-0.5, 0.5, 101), key=away)
    best = min(np.linspace(best - 0.01, best + 0.01, 41), key=away)
    return min(error, away(best, 1))


def joined(compute, wanted, count: int, splines: bool):
    """Values at the wanted angles from those at so many angles of a turn."""
    import numpy as np
    from scipy.interpolate import CubicSpline

    turn = np.arange(count) * (2.0 * np.pi / count)
    values = compute(turn)
    around, values = np.append(turn, 2.0 * np.pi), np.append(values, values[:1])
    return CubicSpline(around, values, bc_type="periodic")(wanted) if splines else np.interp(wanted, around, values)


def ladder(who: str, compute, wanted, *, lines: bool = False) -> dict:
    """The settings of one way: splines, and where it is asked for straight lines, between more and more points."""
    from functools import partial

    ways = {f"{who}, splines between points": True} | ({f"{who}, straight lines between points": False} if lines else {})
    return {
        (name, f"{n} points"): partial(joined, compute, wanted, n, splines)
        for name, splines in ways.items()
        for n in COUNTS[:: 2 if SHORT else 1]
    }


def ours(wanted, offset: float, roller: float, which: int) -> dict:
    """mechcore and the closed form."""
    import numpy as np

    from mechcore.cams.followers import Follower, Knife, Roller, Translating
    from mechcore.cams.synthesis import Cam
    from mechcore.laws.program import Segment, program

    turns = np.radians(TURNS)
    rise = program([Segment(turns[0]), Segment(turns[1], LIFT), Segment(turns[2]), Segment(turns[3], 0.0)])
    follower = Follower(Translating(offset), Roller(roller) if roller else Knife())
    cam = Cam(rise.raised(follower.base_coordinate(BASE)), follower)

    def compute(theta):
        cam_at = cam.at(theta)
        return cam_at.pressure_angle if which else cam_at.working

    def by_hand(theta):
        return closed_form(theta, offset, roller)[which]

    return {
        ("mechcore", "computed there"): lambda: compute(wanted),
        **ladder("mechcore", compute, wanted, lines=True),
        ("by hand: closed form", "computed there"): lambda: by_hand(wanted),
    }


def packages(wanted, which: int) -> dict:
    """Profile and pressure angle as the packages have them: of a knife edge in line, whatever the follower is."""
    from importlib.util import find_spec

    import numpy as np

    result = {}
    if find_spec("mechanism") and not which:
        from mechanism import Cam

        motion = [("Dwell", TURNS[0]), ("Rise", LIFT, TURNS[1]), ("Dwell", TURNS[2]), ("Fall", LIFT, TURNS[3])]

        def profile(theta):
            cam = Cam(motion=motion, degrees=True, omega=1.0, h=theta[1])
            x, y = cam.cycloidal.get_profile(BASE, cam.thetas_r)
            return 1j * (x + 1j * y)[: len(theta)]

        result |= ladder("mechanism", profile, wanted)
    if find_spec("pylinkage"):
        from pylinkage.cam import CycloidalMotionLaw, FunctionProfile

        edges = np.radians(np.cumsum(TURNS))
        cam = FunctionProfile(CycloidalMotionLaw(), BASE, LIFT, *(float(e) for e in edges))

        def compute(theta):
            if which:
                return np.array([cam.pressure_angle(t) for t in theta.tolist()])
            return 1j * np.array([cam.evaluate(t) for t in theta.tolist()]) * np.exp(-1j * theta)

        result[("pylinkage", "computed there")] = lambda: compute(wanted)
        result |= ladder("pylinkage", compute, wanted)
    return result


if __name__ == "__main__":
    measure() if sys.argv[1:2] == ["measure"] else main()
