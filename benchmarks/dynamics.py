"""Forward dynamics side by side: work and precision of mechviz and of peers on Andrews' squeezer and the chain of four-bars.

    python benchmarks/dynamics.py [--short] [--alone] [--only squeezer|chains|freedoms|scaling]

All rows of a problem take turns in one process; the least processor time counts. The peers are installed into the environment of
`peers/run.py` on first use, in which the script then runs; with ``--alone`` it runs where it is, and what is not installed gets no
row. Every run of mechviz starts from the compiled mechanism: nothing is kept from the run before, but where a row says so, and in C
the program, which has been loaded.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "core"), str(ROOT / "tests" / "support"), str(Path(__file__).resolve().parent)]

from timing import interleaved, machine  # isort: skip # before numpy is imported: one thread

import numpy as np
from dynamic_mechanisms import chain, double_pendulum, squeezer, swinging_five_bar
from dynamics_peers import (
    PACKAGES,
    by_cvode,
    by_ida,
    by_scipy,
    exudyn_chain,
    exudyn_squeezer,
    mujoco_chain,
    mujoco_squeezer,
    pinocchio_chain,
    pinocchio_squeezer,
)
from freedom_peers import pinocchio_five_bar, pinocchio_pendulum
from scipy.integrate import solve_ivp

from mechcore.compiled.toolchain import compiler
from mechcore.dynamics.equations.charts import Chart
from mechcore.dynamics.simulate import simulate
from mechcore.motion.solve import compile_mechanism
from mechcore.spec.loads import TorsionDamper

Row = tuple[str, str, Callable[[], float]]  # who, setting, computes the final angle


def case() -> dict[str, Any]:
    result = json.loads((ROOT / "tests" / "reference" / "andrews.json").read_text())["cases"]
    return next(c for c in result if c["id"] == "andrews-squeezer")


# --- P3: Andrews' squeezing mechanism ---------------------------------------------------------------------------------


def andrews_parts(i: dict[str, Any]) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """The equations of the IVP test set in seven angles: (q, q') -> the matrix (13, 13) of accelerations and Lagrange multipliers,
    its right side with the constraints differentiated twice, and the constraints themselves."""
    k = type("Data", (), i)
    ee, ff = k.e - k.ea, k.zf - k.fa

    def parts(y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        q, v = y[:7], y[7:14]
        b, th, ga, ph, de, om, ep = q
        vb, vt, vg, vp, vd, vo, ve = v
        sb, cb, st, ct, sg, cg = np.sin(b), np.cos(b), np.sin(th), np.cos(th), np.sin(ga), np.cos(ga)
        sbt, cbt, sp, cp = np.sin(b + th), np.cos(b + th), np.sin(ph), np.cos(ph)
        sd, cd, spd, cpd, so, co = np.sin(de), np.cos(de), np.sin(ph + de), np.cos(ph + de), np.sin(om), np.cos(om)
        se, ce, soe, coe = np.sin(ep), np.cos(ep), np.sin(om + ep), np.cos(om + ep)
        a = np.zeros((13, 13))
        a[0, 0] = k.m1 * k.ra**2 + k.m2 * (k.rr**2 - 2 * k.da * k.rr * ct + k.da**2) + k.I1 + k.I2
        a[0, 1] = a[1, 0] = k.m2 * (k.da**2 - k.da * k.rr * ct) + k.I2
        a[1, 1] = k.m2 * k.da**2 + k.I2
        a[2, 2] = k.m3 * (k.sa**2 + k.sb**2) + k.I3
        a[3, 3] = k.m4 * ee**2 + k.I4
        a[3, 4] = a[4, 3] = k.m4 * (ee**2 + k.zt * ee * sp) + k.I4
        a[4, 4] = k.m4 * (k.zt**2 + 2 * k.zt * ee * sp + ee**2) + k.m5 * (k.ta**2 + k.tb**2) + k.I4 + k.I5
        a[5, 5] = k.m6 * ff**2 + k.I6
        a[5, 6] = a[6, 5] = k.m6 * (ff**2 - k.u * ff * so) + k.I6
        a[6, 6] = k.m6 * (ff**2 - 2 * k.u * ff * so + k.u**2) + k.m7 * (k.ua**2 + k.ub**2) + k.I6 + k.I7
        xd, yd = k.sd * cg + k.sc * sg + k.xb, k.sd * sg - k.sc * cg + k.yb
        length = np.hypot(xd - k.xc, yd - k.yc)
        pull = -k.c0 * (length - k.lo) / length
        fx, fy = pull * (xd - k.xc), pull * (yd - k.yc)
        f = np.zeros(13)
        f[0] = k.mom - k.m2 * k.da * k.rr * vt * (vt + 2 * vb) * st
        f[1] = k.m2 * k.da * k.rr * vb**2 * st
        f[2] = fx * (k.sc * cg - k.sd * sg) + fy * (k.sd * cg + k.sc * sg)
        f[3] = k.m4 * k.zt * ee * vd**2 * cp
        f[4] = -k.m4 * k.zt * ee * vp * (vp + 2 * vd) * cp
        f[5] = -k.m6 * k.u * ff * ve**2 * co
        f[6] = k.m6 * k.u * ff * vo * (vo + 2 * ve) * co
        g = np.zeros((6, 7))
        x, y_ = -k.rr * sb + k.d * sbt, k.rr * cb - k.d * cbt
        g[0::2, 0], g[1::2, 0] = x, y_
        g[0::2, 1], g[1::2, 1] = k.d * sbt, -k.d * cbt
        g[0, 2], g[1, 2] = -k.ss * cg, -k.ss * sg
        g[2, 3], g[3, 3] = -k.e * cpd, -k.e * spd
        g[2, 4], g[3, 4] = -k.e * cpd + k.zt * sd, -k.e * spd - k.zt * cd
        g[4, 5], g[5, 5] = k.zf * soe, -k.zf * coe
        g[4, 6], g[5, 6] = k.zf * soe - k.u * ce, -k.zf * coe - k.u * se
        a[7:, :7], a[:7, 7:] = g, g.T
        turn, fold, swing = (vb + vt) ** 2, (vp + vd) ** 2, (vo + ve) ** 2
        cx, cy = -k.rr * cb * vb**2 + k.d * cbt * turn, -k.rr * sb * vb**2 + k.d * sbt * turn
        f[7] = -(cx + k.ss * sg * vg**2)
        f[8] = -(cy - k.ss * cg * vg**2)
        f[9] = -(cx + k.e * spd * fold + k.zt * cd * vd**2)
        f[10] = -(cy - k.e * cpd * fold + k.zt * sd * vd**2)
        f[11] = -(cx + k.zf * coe * swing + k.u * se * ve**2)
        f[12] = -(cy + k.zf * soe * swing - k.u * ce * ve**2)
        px, py = k.rr * cb - k.d * cbt, k.rr * sb - k.d * sbt
        closed = np.array(
            [
                px - k.ss * sg - k.xb,
                py + k.ss * cg - k.yb,
                px - k.e * spd - k.zt * cd - k.xa,
                py + k.e * cpd - k.zt * sd - k.ya,
                px - k.zf * coe - k.u * se - k.xa,
                py - k.zf * soe + k.u * ce - k.ya,
            ]
        )
        return a, f, closed

    return parts


def andrews_by_hand(i: dict[str, Any]) -> Callable[[float, np.ndarray], np.ndarray]:
    """The same as ordinary equations, constraints differentiated twice: y = (q, q') -> y'."""
    parts = andrews_parts(i)

    def rhs(_: float, y: np.ndarray) -> np.ndarray:
        a, f, _closed = parts(y)
        return np.concatenate([y[7:], np.linalg.solve(a, f)[:7]])

    return rhs


def andrews_rows(reference: dict[str, Any]) -> list[Row]:
    i = reference["inputs"]
    compiled = compile_mechanism(squeezer(i))
    start = np.array([i["initial_q"][n] for n in ("beta", "Theta", "gamma", "Phi", "delta", "Omega", "epsilon")] + [0.0] * 7)
    rhs = andrews_by_hand(i)
    known = reference["expected"]["initial_qdd"]
    if abs(rhs(0.0, start)[7] - known["beta"]) > 1e-6 * known["beta"]:
        raise SystemExit("the equations by hand are wrong")
    rows: list[Row] = []
    for tolerance in (1e-4, 1e-6, 1e-9, 1e-11):
        for method in ("energy", "gauss"):
            rows.append(("mechviz", f"{method} {tolerance:.0e}", partial(mechviz_end, compiled, 0.03, tolerance, method)))
        for method in ("DOP853", "LSODA"):
            if method == "LSODA" and tolerance < 1e-10:
                continue
            job = partial(by_scipy, rhs, start, 0.03, tolerance, method)
            rows.append((f"by hand + {method}", f"rtol {tolerance:.0e}", job))
    if compiler():
        by_c = compile_mechanism(squeezer(i), executor="c")
        rows += [("mechviz", f"c {t:.0e}", partial(mechviz_end, by_c, 0.03, t, "gauss")) for t in (1e-4, 1e-6, 1e-7, 1e-9, 1e-11)]
    if find_spec("sksundae"):
        rows += [("by hand + CVODE", f"rtol {r:.0e}", partial(by_cvode, rhs, start, 0.03, r)) for r in (1e-5, 1e-7, 1e-9)]
        some = (1e-4, 1e-8) if "--short" in sys.argv else (1e-4, 1e-6, 1e-8, 1e-9)
        rows += [("by hand + IDA", f"rtol {r:.0e}", partial(by_ida, andrews_parts(i), start, 0.03, r)) for r in some]
    if find_spec("pinocchio"):
        rows += [
            ("Pinocchio + DOP853", f"rtol {r:.0e}", pinocchio_squeezer(i, r)) for r in (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-11)
        ]
    if find_spec("mujoco"):
        rows += [("MuJoCo RK4", f"{steps} steps", mujoco_squeezer(i, steps)) for steps in (125, 1000, 1500, 4000)]
    if find_spec("exudyn"):
        rows += [
            ("exudyn gen.-alpha", f"{steps} steps", exudyn_squeezer(i, steps)) for steps in (100, 300, 1000, 3000, 10_000, 40_000)
        ]
    return rows


def mechviz_end(compiled: Any, duration: float, tolerance: float, method: str) -> float:
    """The end of the first motion of a mechanism: tables that a compiled mechanism keeps for further ones are made anew."""
    return mechviz_again(replace(compiled), duration, tolerance, method)


def mechviz_again(compiled: Any, duration: float, tolerance: float, method: str) -> float:
    simulation = simulate(compiled, duration, tolerance=tolerance, method=method)  # type: ignore[arg-type]
    return float(simulation([duration])[0][0, 0])


EXECUTORS = (("mechviz", "numpy", mechviz_end), ("mechviz, C", "c", mechviz_again))
DAMPING = 1e-5  # of the crank [N m s]


def damped_rows(reference: dict[str, Any]) -> tuple[list[Row], float]:
    """The same with a damped crank, by both executors; the reference is mechviz at 1e-13, which Pinocchio confirms."""
    i = reference["inputs"]
    plain = squeezer(i)
    damper = TorsionDamper(name="damper", links=("K1", "frame"), coefficient=DAMPING)
    mechanism = replace(plain, loads=(*plain.loads, damper))
    rows: list[Row] = []
    for who, executor, run in EXECUTORS[: 2 if compiler() else 1]:
        compiled = compile_mechanism(mechanism, executor=executor)  # type: ignore[arg-type]
        rows += [(who, f"{executor} {r:.0e}", partial(run, compiled, 0.03, r, "gauss")) for r in (1e-4, 1e-6, 1e-7, 1e-9)]
    if find_spec("pinocchio"):
        for r in (1e-6, 1e-7, 1e-8, 1e-9, 1e-10):
            rows.append(("Pinocchio + DOP853", f"rtol {r:.0e}", pinocchio_squeezer(i, r, damping=DAMPING)))
    return rows, mechviz_end(compile_mechanism(mechanism), 0.03, 1e-13, "gauss")


# --- P4: N four-bars in a row -----------------------------------------------------------------------------------------


def chain_end(n: int, duration: float = 10.0, g: float = 9.81) -> float:
    """The angle of the first upright, exactly: uprights turn together, bars are carried round, so that it is one pendulum."""
    inertia, weight = (n + 1) / 3.0 + n, g * ((n + 1) / 2.0 + n)
    solution = solve_ivp(
        lambda _, y: [y[1], -weight * np.cos(y[0]) / inertia], (0.0, duration), [np.pi / 2, -1.0],
        method="DOP853", rtol=3e-14, atol=1e-15,
    )  # fmt: skip
    return float(solution.y[0, -1])


def chain_rows(n: int) -> list[Row]:
    compiled = compile_mechanism(chain(n))
    rows: list[Row] = []
    for tolerance in (1e-4, 1e-6, 1e-9, 1e-11):
        for method in ("energy", "gauss"):
            rows.append(("mechviz", f"{method} {tolerance:.0e}", partial(mechviz_end, compiled, 10.0, tolerance, method)))
    if compiler():
        in_c = replace(compiled, executor="c")
        rows += [("mechviz, C", f"energy {r:.0e}", partial(mechviz_end, in_c, 10.0, r, "energy")) for r in (1e-4, 1e-9)]
    rows.append(("mechviz, further motions", "energy 1e-09", partial(mechviz_again, compiled, 10.0, 1e-9, "energy")))
    if find_spec("mujoco"):
        rows += [("MuJoCo RK4", f"{steps} steps", mujoco_chain(n, steps)) for steps in (1000, 4000)]
    if find_spec("pinocchio"):
        # with h = .04 its error is just below the bar of 1e-3 for N = 1: steps chosen for the accuracy, not for round numbers
        sizes = (250, 400, 1000, 4000)
        rows += [("Pinocchio, own RK4", f"h = {10.0 / steps:g}", pinocchio_chain(n, steps)) for steps in sizes]
        if n <= 10:  # the singular position throws it off: beyond, it takes minutes and is wrong
            rows.append(("Pinocchio + DOP853", "rtol 1e-07", pinocchio_chain(n, 0, 1e-7)))
    if find_spec("exudyn"):
        some = (250, 500, 1000, 2000, 4000) if n < 40 else (500, 1000)
        rows += [("exudyn gen.-alpha", f"{steps} steps", exudyn_chain(n, steps)) for steps in some]
    return rows


# --- several freedoms ----------------------------------------------------------------------------------------------------


def freedom_rows(mechanism: Any, duration: float, by_pinocchio: Callable[..., Callable[[], float]]) -> tuple[list[Row], float]:
    """mechviz by both executors; scipy's integrators on numpy's right-hand side, and DOP853 on Pinocchio's. The reference is
    mechviz at 1e-13, which DOP853 confirms to its own accuracy."""
    compiled = compile_mechanism(mechanism)
    drives = mechanism.drives
    start = np.array([float(d.law(0.0)[k]) for k in (0, 1) for d in drives])
    system, f = Chart(compiled), len(drives)

    def rhs(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[f:], system(y[None, :f], y[None, f:], np.array([t]))[0]])

    rows: list[Row] = []
    for who, executor, run in EXECUTORS[: 2 if compiler() else 1]:
        own = compile_mechanism(mechanism, executor=executor)  # type: ignore[arg-type]
        for tolerance in (1e-4, 1e-6, 1e-7, 1e-9, 1e-11):
            rows.append((who, f"{executor} {tolerance:.0e}", partial(run, own, duration, tolerance, "gauss")))
    if find_spec("pinocchio"):
        for r in (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11):
            rows.append(("Pinocchio + DOP853", f"rtol {r:.0e}", by_pinocchio(mechanism, r, duration)))
    for method, tolerances in (("DOP853", (1e-5, 1e-7, 1e-9, 3e-10)), ("LSODA", (1e-5, 1e-8)), ("Radau", (1e-4,))):
        for tolerance in tolerances:
            job = partial(by_scipy, rhs, start, duration, tolerance, method)
            rows.append((f"same equations + {method}", f"rtol {tolerance:.0e}", job))
    return rows, mechviz_end(compiled, duration, 1e-13, "gauss")


# --- reports ----------------------------------------------------------------------------------------------------------


def report(title: str, rows: list[Row], exact: float, *, runs: int) -> None:
    """Time and error of every row; the best peer at the same or a smaller error, and how many times faster mechviz is."""
    errors = {}
    for who, setting, job in rows:
        try:
            errors[who, setting] = abs(job() - exact)
        except Exception as error:  # a peer that fails does not disturb the others
            print(f"{who} {setting}: {type(error).__name__}: {error}"[:120])
    jobs = {key: next(j for w, s, j in rows if (w, s) == key) for key in errors}
    times = interleaved({f"{w}|{s}": j for (w, s), j in jobs.items()}, runs=runs, seconds=0.05, pick=min, clock=time.process_time)
    ours = [(times[f"{w}|{s}"], e) for (w, s), e in errors.items() if w == "mechviz"]
    print(f"\n### {title}\n\n| who | setting | time [ms] | error [rad] | mechviz at this error or less is faster by |")
    print("|---|---|---|---|---|")
    for (who, setting), error in errors.items():
        spent = times[f"{who}|{setting}"]
        better = [t for t, e in ours if e <= max(error, 1e-12)]
        faster = spent / min(better) if better else np.nan
        ratio = "" if who.startswith("mechviz") else f"{faster:.{1 if faster >= 1.0 else 2}f}" if better else "not reached"
        print(f"| {who} | {setting} | {1e3 * spent:.2f} | {error:.1e} | {ratio} |", flush=True)


def scaling(counts: tuple[int, ...]) -> None:
    print("\n### Chain of N four-bars, 10 s, cost by N\n")
    print("| N | compile [ms] | energy 1e-9 [ms] | us a loop | error [rad] |\n|---|---|---|---|---|")
    for n in counts:
        spent, best, error = [], np.inf, np.nan
        for _ in range(3 if n > 100 else 10):
            start = time.process_time()
            compiled = compile_mechanism(chain(n))
            spent.append(time.process_time() - start)
            start = time.process_time()
            end = mechviz_end(compiled, 10.0, 1e-9, "energy")
            best = min(best, time.process_time() - start)
            error = abs(end - chain_end(n))
        print(f"| {n} | {1e3 * min(spent):.1f} | {1e3 * best:.1f} | {1e6 * best / n:.0f} | {error:.1e} |", flush=True)


def with_peers() -> None:
    """Go on in the peers' environment, made and filled as far as needed."""
    sys.path.append(str(ROOT / "benchmarks" / "peers"))
    from run import HOME, environment

    if Path(sys.prefix) != HOME:
        python, failed = environment({"dynamics_peers": PACKAGES})
        for fault in failed.values():
            print(fault, file=sys.stderr)
        sys.exit(subprocess.run([python, __file__, *sys.argv[1:]]).returncode)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="fewer settings, sizes and turns")
    parser.add_argument("--alone", action="store_true", help="where it is: what is not installed gets no row")
    parser.add_argument("--only", choices=["squeezer", "chains", "freedoms", "scaling"], default="", help="one part")
    given = parser.parse_args()
    if not given.alone:
        with_peers()
    short, only = given.short, given.only
    runs = 3 if short else 7
    known = (
        ("numpy", "numpy"),
        ("scipy", "scipy"),
        ("mujoco", "mujoco"),
        ("pin", "pinocchio"),
        ("exudyn", "exudyn"),
        ("scikit-sundae", "sksundae"),
    )
    packages = [p for p, name in known if find_spec(name)]
    print(f"{machine(*packages)}; least processor time of {runs} turns, taken in alternation")
    if only in ("", "squeezer"):
        reference = case()
        last = reference["expected"]["rows"][-1]
        beta = last["q"]["beta"] if "q" in last else last["beta"]
        report("Andrews' squeezing mechanism, 0.03 s, error of the crank angle", andrews_rows(reference), beta, runs=runs)
        report("Andrews' squeezing mechanism, crank damped, 0.03 s, error of the crank angle", *damped_rows(reference), runs=runs)
    if only in ("", "chains"):
        chains(short, runs)
    if only in ("", "freedoms"):
        freedoms(short)
    if only in ("", "scaling"):
        scaling((10, 40, 100) if short else (10, 40, 100, 200, 400, 1000))


def chains(short: bool, runs: int) -> None:
    for n in (1, 2) if short else (1, 2, 10, 40):
        title = f"Chain of {n} four-bar{'s' if n > 1 else ''}, 10 s through its singular position"
        report(title, chain_rows(n), chain_end(n), runs=runs if n < 10 else 2)


def freedoms(short: bool) -> None:
    pendulum = json.loads((ROOT / "tests" / "reference" / "dynamics.json").read_text())["cases"]
    inputs = next(c for c in pendulum if c["id"] == "double-pendulum-physical")["inputs"]
    for title, mechanism, duration, peer in (
        ("Double pendulum, 5 s, error of the upper angle", double_pendulum(inputs), 5.0, pinocchio_pendulum),
        ("Five-bar on torsion springs, 2 s, error of the left angle", swinging_five_bar(), 2.0, pinocchio_five_bar),
    ):
        rows, exact = freedom_rows(mechanism, duration, peer)
        if short:
            rows = [row for row in rows if row[1].split()[1] in ("1e-06", "1e-07", "1e-08", "1e-09")]
        report(title, rows, exact, runs=2 if short else 3)


if __name__ == "__main__":
    main()
