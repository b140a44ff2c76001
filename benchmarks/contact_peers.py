"""A carriage that sticks and slips, and a mass that is thrown against a stop, side by side with exudyn.

    python benchmarks/contact_peers.py [--short]

The carriage is that of the scene `stick-slip-feed`, whose exact motion follows from scipy's DOP853 with events between slipping and
sticking. exudyn has its friction as bristles, or with a zone of speeds in which it grows, and its stop as a stiff spring, without
Newton's law of restitution: of ladders of steps and stiffnesses the error and the processor time are told.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "core"), str(ROOT), str(Path(__file__).resolve().parent)]

from timing import machine  # isort: skip # before numpy is imported: one thread

import numpy as np
from scipy.integrate import solve_ivp

from mechcore import spec as sp
from mechcore.compiled.toolchain import compiler
from mechcore.dynamics.events import EndStop
from mechcore.dynamics.simulate import simulate
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled
from mechcore.motion.solve import compile_mechanism
from mechcore.spec.mechanism import Drive

Row = tuple[str, str, Callable[[], float]]  # who, setting, computes where it ends
MASS, STIFFNESS, DAMPING, SPEED = 12.0, 4000.0, 20.0, 0.01
RUBS, HOLDS = 0.08 * MASS * 9.81, 0.2 * MASS * 9.81  # friction of motion and of rest [N]
DURATION = 6.0
FALL, BOUNCES = 1.0, 3.0  # height [m] above a stop without loss, time [s]


def carriage() -> sp.Mechanism:
    from mechviz.scene.scene import load

    return load("stick-slip-feed").mechanism


def exact_carriage() -> float:
    """Where the carriage is at the end [m]: from slip to slip, of a spring whose far end goes on at one speed."""
    t, x = 0.0, 0.0
    while True:
        t = (HOLDS - DAMPING * SPEED + STIFFNESS * x) / (STIFFNESS * SPEED)  # it sticks until then
        if t >= DURATION:
            return x

        def stops(_: float, y: np.ndarray) -> float:
            return y[1]

        stops.terminal, stops.direction = True, -1  # type: ignore[attr-defined]

        def rhs(t: float, y: np.ndarray) -> list[float]:
            return [y[1], (STIFFNESS * (SPEED * t - y[0]) + DAMPING * (SPEED - y[1]) - RUBS) / MASS]

        slip = solve_ivp(rhs, (t, DURATION), [x, 0.0], method="DOP853", rtol=1e-13, atol=1e-16, events=stops, first_step=1e-5)
        x = float(slip.y[0, -1])
        if slip.status == 0:
            return x


def ball() -> sp.Mechanism:
    """A mass that falls on a guide."""
    return sp.Mechanism(
        name="ball",
        frame="frame",
        links=(
            sp.Link(name="frame", points={"O": (0.0, 0.0)}),
            sp.Link(name="ball", points={"O": (0.0, 0.0)}, mass=1.0),
        ),
        joints=(sp.Prismatic(name="O", links=("frame", "ball"), points=("O", "O"), along=(0.0, 1.0)),),
        drives=(Drive(joint="O", law=Free(FALL, 0.0)),),
        effects=("inertia", "gravity"),
    )


def exact_ball() -> float:
    """Its height at the end [m]: it comes back to where it was let go."""
    fall = np.sqrt(2.0 * FALL / 9.81)
    since = (BOUNCES + fall) % (2.0 * fall) - fall  # from the top of an arc on
    return float(FALL - 0.5 * 9.81 * since**2)


def mechviz_end(compiled: Compiled, duration: float, tolerance: float, stops: tuple[EndStop, ...]) -> float:
    simulation = simulate(replace(compiled), duration, tolerance=tolerance, stops=stops)
    return float(simulation([duration])[0][0, -1])


def exudyn_end(
    steps: int, duration: float, mass: float, start: float, force: float, far: dict[str, float] | None = None, **connector: float
) -> Callable[[], float]:
    """One coordinate from rest under a force, with friction or a stop, by generalised alpha in so many steps, by DOPRI5 to a
    tolerance of 10 to the power of what is negative. ``far``: a spring and a damper, whose other end goes on at `SPEED`: a mass
    that nothing slows, as a load that changes would be a function of Python."""
    import exudyn as exu
    from exudyn import itemInterface as items

    mbs = exu.SystemContainer().AddSystem()
    node = mbs.AddNode(items.Node1D(referenceCoordinates=[0.0], initialCoordinates=[start]))
    mbs.AddObject(items.Mass1D(mass=mass, nodeNumber=node))
    fixed = mbs.AddNode(items.NodePointGround())
    ends = [mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=n, coordinate=0)) for n in (fixed, node)]
    data = mbs.AddNode(items.NodeGenericData(numberOfDataCoordinates=3, initialCoordinates=[0.0, 0.0, 0.0]))
    mbs.AddObject(items.CoordinateSpringDamperExt(markerNumbers=ends, nodeNumber=data, **connector))
    if far is not None:
        other = mbs.AddNode(items.Node1D(referenceCoordinates=[0.0], initialVelocities=[SPEED]))
        mbs.AddObject(items.Mass1D(mass=1e12, nodeNumber=other))
        moving = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=other, coordinate=0))
        mbs.AddObject(items.CoordinateSpringDamper(markerNumbers=[moving, ends[1]], **far))
    if force:
        mbs.AddLoad(items.LoadCoordinate(markerNumber=ends[1], load=force))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    integration, solver = settings.timeIntegration, exu.DynamicSolverType.GeneralizedAlpha
    integration.numberOfSteps, integration.endTime = max(steps, 30), duration
    if steps < 0:
        solver, integration.automaticStepSize, integration.minimumStepSize = exu.DynamicSolverType.DOPRI5, True, 1e-14
        integration.relativeTolerance = integration.absoluteTolerance = 10.0**steps
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
    settings.timeIntegration.newton.useModifiedNewton = False
    settings.solution.file.write = False
    settings.show.computationTime = settings.show.statistics = False

    def run() -> float:
        mbs.SolveDynamic(settings, solverType=solver)
        return float(mbs.GetNodeOutput(node, exu.OutputVariableType.Coordinates))

    return run


def exudyn_carriage(steps: int, **friction: float) -> Callable[[], float]:
    friction |= {"dynamicFrictionForce": RUBS, "staticFrictionOffsetForce": HOLDS - RUBS, "exponentialDecayStatic": 1e-6}
    far = {"stiffness": STIFFNESS, "damping": DAMPING}
    return exudyn_end(steps, DURATION, MASS, 0.0, 0.0, far, **friction)


def report(title: str, rows: list[Row], exact: float, runs: int) -> None:
    print(f"\n### {title}\n\n| who | setting | time [ms] | error [m] |\n|---|---|---|---|")
    for who, setting, job in rows:
        try:
            spent, end = [], job()
            for _ in range(runs):
                start = time.process_time()
                job()
                spent.append(time.process_time() - start)
            print(f"| {who} | {setting} | {1e3 * min(spent):.2f} | {abs(end - exact):.1e} |", flush=True)
        except Exception as error:
            print(f"| {who} | {setting} | {type(error).__name__} | |", flush=True)


def rows_of(mechanism: sp.Mechanism, duration: float, stops: tuple[EndStop, ...]) -> list[Row]:
    """mechviz by both executors."""
    rows: list[Row] = []
    for executor in ("numpy", "c") if compiler() else ("numpy",):
        compiled = compile_mechanism(mechanism, executor=executor)  # type: ignore[arg-type]
        rows += [("mechviz", f"{executor} {r:.0e}", partial(mechviz_end, compiled, duration, r, stops)) for r in (1e-4, 1e-6, 1e-9)]
    return rows


def setting(steps: int) -> str:
    """What exudyn is told, in words."""
    return f"{steps} steps" if steps > 0 else f"DOPRI5 {10.0**steps:.0e}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="fewer settings and turns")
    short = parser.parse_args().short
    print(f"{machine('numpy', 'scipy', 'exudyn')}; least processor time of the turns")
    steps, runs = ((6_000, 60_000), 9) if short else ((2_000, 4_000, 6_000, 8_000, 20_000, 60_000), 5)
    rows = rows_of(carriage(), DURATION, ())
    for n, k in product((*steps, -9, -12), (1e6, 1e8, 2e8)):
        job = exudyn_carriage(n, stickingStiffness=k, stickingDamping=5e-4 * k)
        rows.append(("exudyn", f"{setting(n)}, bristles of {k:.0e} N/m", job))
    for n, zone in product(steps, (1e-4, 1e-6)):
        rows.append(("exudyn", f"{setting(n)}, zone of {zone:.0e} m/s", exudyn_carriage(n, frictionProportionalZone=zone)))
    report("Carriage that sticks and slips, 6 s", rows, exact_carriage(), runs)
    rows = rows_of(ball(), BOUNCES, (EndStop(name="ground", joint="O", at=0.0, side="lower", restitution=1.0),))
    for n, k in product((*steps, -10, -12), (1e6, 1e8, 1e10)):
        stop = {"useLimitStops": True, "limitStopsLower": 0.0, "limitStopsUpper": 10.0, "limitStopsStiffness": k}
        rows.append(("exudyn", f"{setting(n)}, stop of {k:.0e} N/m", exudyn_end(n, BOUNCES, 1.0, FALL, -9.81, None, **stop)))
    report("Ball on a stop without loss, 3 s", rows, exact_ball(), runs)


if __name__ == "__main__":
    main()
