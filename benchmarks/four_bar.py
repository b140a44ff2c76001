"""A four-bar: mechviz against a plain loop over frames with scipy.optimize.fsolve, in the same run.

    python benchmarks/four_bar.py

Both find positions, velocities, accelerations, all joint reactions and the driving torque.
"""

from __future__ import annotations

from timing import interleaved, machine  # first: it sets one thread

import argparse  # isort: skip
import time

import numpy as np  # isort: skip
from scipy.optimize import fsolve

import mechviz
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.solve import compile_mechanism, solve_motion

SCENE = mechviz.load("kinetostatic-four-bar")
COMPILED = compile_mechanism(SCENE.mechanism)
LAW = SCENE.mechanism.drives[0].law
BY_NAME = {link.name: link for link in SCENE.mechanism.links}
LOAD = SCENE.mechanism.loads[0]


def mechviz_run(frames: int):
    time = np.linspace(0.0, LAW.duration, frames, endpoint=False)
    forces = solve_forces(solve_motion(COMPILED, time))
    reactions = [forces.reaction(p.name) for p in SCENE.mechanism.joints]
    return forces.effort(SCENE.mechanism.drives[0].joint), reactions


def plain_run(frames: int):
    """What one writes by hand: per frame fsolve for positions, two linear solves, one 9 x 9 system of Newton-Euler."""
    links = [BY_NAME[n] for n in ("crank", "coupler", "rocker")]
    frame = BY_NAME["frame"].points
    ground_a, ground_e = (np.array(frame[k]) for k in sorted(frame))
    r1, r2, r3 = (max(np.hypot(*p) for p in link.points.values() if p != LOAD_POINT) for link in links)
    torque = np.empty(frames)
    guess = START
    for k, t in enumerate(np.linspace(0.0, LAW.duration, frames, endpoint=False)):
        q, w, a = (float(x) for x in LAW(t))

        def loop(x, q=q):
            return (
                ground_a[0] + r1 * np.cos(q) + r2 * np.cos(x[0]) - ground_e[0] - r3 * np.cos(x[1]),
                ground_a[1] + r1 * np.sin(q) + r2 * np.sin(x[0]) - ground_e[1] - r3 * np.sin(x[1]),
            )

        guess = fsolve(loop, guess)
        angle = np.array([q, *guess])
        c, s = np.cos(angle), np.sin(angle)
        jac = np.array([[-r2 * s[1], r3 * s[2]], [r2 * c[1], -r3 * c[2]]])
        omega = np.array([w, *np.linalg.solve(jac, [r1 * s[0] * w, -r1 * c[0] * w])])
        rhs = [
            r1 * (s[0] * a + c[0] * w**2) + r2 * c[1] * omega[1] ** 2 - r3 * c[2] * omega[2] ** 2,
            r1 * (-c[0] * a + s[0] * w**2) + r2 * s[1] * omega[1] ** 2 - r3 * s[2] * omega[2] ** 2,
        ]
        eps = np.array([a, *np.linalg.solve(jac, rhs)])
        # Newton-Euler: unknown reactions at A, B, D, E and the torque
        matrix, right = np.zeros((9, 9)), np.zeros(9)
        arms = ((0.0, r1), (0.0, r2), (r3, 0.0))  # local x of the pins: A, B on the crank; B, D; D, E on the rocker
        base_acc = np.zeros(2)
        for i, link in enumerate(links):
            rot = np.array([[c[i], -s[i]], [s[i], c[i]]])
            centre = rot @ link.centre
            origin = base_acc if i < 2 else np.zeros(2)
            acc = origin + eps[i] * np.array([-centre[1], centre[0]]) - omega[i] ** 2 * centre
            if i == 0:
                tip = rot @ (r1, 0.0)
                base_acc = eps[0] * np.array([-tip[1], tip[0]]) - w**2 * tip
            force, moment = link.mass * acc, link.inertia * eps[i]
            if LOAD.link == link.name:
                f = np.array(LOAD.vector)
                arm = rot @ np.array(link.points[LOAD.point]) - centre
                force, moment = force - f, moment - (arm[0] * f[1] - arm[1] * f[0])
            for pin, local, sign in ((i, arms[i][0], 1.0), (i + 1, arms[i][1], -1.0)):
                arm = rot @ (local, 0.0) - centre
                matrix[3 * i, 2 * pin] += sign
                matrix[3 * i + 1, 2 * pin + 1] += sign
                matrix[3 * i + 2, 2 * pin : 2 * pin + 2] += sign * np.array([-arm[1], arm[0]])
            right[3 * i : 3 * i + 3] = [*force, moment]
        matrix[2, 8] = 1.0
        torque[k] = np.linalg.solve(matrix, right)[8]
    return torque


LOAD_POINT = BY_NAME[LOAD.link].points[LOAD.point]
_start = solve_motion(COMPILED, [0.0])
START = np.array([_start.pose("coupler")[0, 2], _start.pose("rocker")[0, 2]])


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    print(machine("numpy", "scipy"))
    difference = np.abs(mechviz_run(360)[0] - plain_run(360)).max() / np.abs(plain_run(360)).max()
    print(f"largest difference of the driving torque, relative: {difference:.1e}\n")
    times = interleaved({"mechviz": lambda: mechviz_run(360), "fsolve loop": lambda: plain_run(360)})
    print("| four-bar, positions to torque | 360 frames | ratio |\n|---|---|---|")
    for name, t in times.items():
        print(f"| {name} | {1e3 * t:.3f} ms | {t / times['mechviz']:.0f} |")
    print("\n| frames | us a frame | against 360 |\n|---|---|---|")
    sizes = (360, 3600, 36000)
    jobs = {str(n): lambda n=n: mechviz_run(n) for n in sizes}
    many = interleaved(jobs, runs=40, pick=min, clock=time.process_time)  # what else the machine does does not count
    for n in sizes:
        print(f"| {n} | {1e6 * many[str(n)] / n:.3f} | {many[str(n)] / n / (many['360'] / 360):.2f} |")


if __name__ == "__main__":
    main()
