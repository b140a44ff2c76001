"""Hard cases of linkages that compare engines: kinematics of a four-bar (P1), reactions of a slider-crank (P2)."""

from __future__ import annotations

import numpy as np

from mechcore.spec.loads import Force
from mechviz.hard_cases.case import Case, Outcome, compare, moved
from mechviz.hard_cases.mechanisms import TURN, at, four_bar, load_at, slider_crank


def _p1() -> Outcome:
    """The four-bar 4, 1, 3.5, 3 of the comparison: coupler point and its rates by complex numbers on the closing triangle."""
    a, b, c, d = 4.0, 1.0, 3.5, 3.0
    theta = np.linspace(0.0, TURN, 3601)
    motion = at(four_bar(a, b, c, d, P=(1.5, 1.0)), theta)
    crank = b * np.exp(1j * theta)
    gap = a - crank  # from B to E
    length = np.abs(gap)
    up = np.sqrt((length + c + d) * (-length + c + d) * (length - c + d) * (length + c - d)) / 2.0  # twice the triangle's area
    k = gap * ((length**2 + c**2 - d**2) / 2.0 + 1j * up) / length**2 / c  # direction of the coupler, D left of B -> E
    e, f = 1j * crank, c * k  # speeds: e + i w2 f = i w3 g
    g = f + crank - a
    w2 = -np.real(e * np.conj(g)) / np.real(1j * f * np.conj(g))
    w3 = np.real((e + 1j * w2 * f) / (1j * g))
    e2 = -crank
    rest = e2 - w2**2 * f + w3**2 * g
    eps2 = -np.real(rest * np.conj(g)) / np.real(1j * f * np.conj(g))
    arm = (1.5 + 1.0j) * k
    want = [crank + arm, e + 1j * w2 * arm, e2 + (1j * eps2 - w2**2) * arm]
    checks = []
    for order, (name, w) in enumerate(zip(("position", "velocity", "acceleration"), want, strict=True)):
        got = motion.point("coupler", "P", order) @ [1.0, 1j]
        checks.append(compare(f"{name} of the coupler point", np.abs(got - w) / np.abs(w).max(), 0.0, 1e-13))
    return moved(motion, f"largest relative error {max(x.error for x in checks):.1e}", checks)


def _p2() -> Outcome:
    """All reactions of a slider-crank under gravity and a working force, by Newton and Euler: 8 equations a frame."""
    r, l, f, g = 0.05, 0.2, -900.0, 9.81  # noqa: E741 - the letter of the textbooks
    m1, m2, m3, j1, j2, speed = 1.6, 0.9, 0.7, 4e-3, 3e-3, 60.0
    bodies = {"crank": (m1, (0.01, 0.0), j1), "rod": (m2, (0.07, 0.0), j2), "piston": (m3, (0.0, 0.0), 0.0)}
    loads = (Force(name="F", link="piston", point="C", vector=(f, 0.0)),)
    m = slider_crank(r, l, bodies=bodies, loads=loads, effects=("inertia", "gravity"))
    theta = np.linspace(0.0, TURN, 361)
    forces = load_at(m, theta, speed)
    b = r * np.exp(1j * theta)
    phi = np.arcsin(-b.imag / l)
    w = -speed * b.real / (l * np.cos(phi))
    eps = (speed**2 * b.imag + w**2 * l * np.sin(phi)) / (l * np.cos(phi))
    rod = np.exp(1j * phi)
    a1 = -(speed**2) * 0.2 * b
    a2 = -(speed**2) * b + (1j * eps - w**2) * 0.07 * rod
    a3 = -(speed**2) * b + (1j * eps - w**2) * l * rod
    n = len(theta)
    a, rhs = np.zeros((n, 8, 8)), np.zeros((n, 8))  # Ox Oy Bx By Cx Cy N M; each on the second link of its joint
    s1, s2, s2c = 0.2 * b - b, -0.07 * rod, (l - 0.07) * rod  # from centres: crank to B (minus), rod to B, rod to C
    a[:, 0, 0] = a[:, 1, 1] = 1.0
    a[:, 0, 2] = a[:, 1, 3] = -1.0
    rhs[:, 0], rhs[:, 1] = m1 * a1.real, m1 * (a1.imag + g)
    o = -0.2 * b
    a[:, 2, 0], a[:, 2, 1], a[:, 2, 2], a[:, 2, 3], a[:, 2, 7] = -o.imag, o.real, -s1.imag, s1.real, 1.0
    a[:, 3, 2] = a[:, 4, 3] = 1.0
    a[:, 3, 4] = a[:, 4, 5] = -1.0
    rhs[:, 3], rhs[:, 4] = m2 * a2.real, m2 * (a2.imag + g)
    a[:, 5, 2], a[:, 5, 3], a[:, 5, 4], a[:, 5, 5] = -s2.imag, s2.real, s2c.imag, -s2c.real
    rhs[:, 5] = j2 * eps
    a[:, 6, 4] = a[:, 7, 5] = a[:, 7, 6] = 1.0
    rhs[:, 6], rhs[:, 7] = m3 * a3.real - f, m3 * (a3.imag + g)
    want = np.linalg.solve(a, rhs[..., None])[..., 0]
    got = np.column_stack(
        [
            forces.reaction("O")[:, :2],
            forces.reaction("B")[:, :2],
            forces.reaction("C")[:, :2],
            forces.reaction("S")[:, 1],
            forces.effort("O"),
        ]
    )
    checks = [compare("reactions", got[:, :7], want[:, :7], 1e-13), compare("driving torque", got[:, 7], want[:, 7], 1e-12)]
    return moved(forces.motion, f"largest relative error {max(x.error for x in checks):.1e}", checks, forces)


CASES = (
    Case(
        "P1 four-bar",
        "linkages",
        "position, velocity, acceleration at 3601 places",
        "complex numbers on the closing triangle, to 1e-13",
        _p1,
        "exudyn 2e-4 in acceleration, Drake 3e-6, mechanism 5e-11",
    ),
    Case(
        "P2 slider-crank",
        "linkages",
        "all seven reactions and the torque",
        "Newton-Euler, 8 equations a frame",
        _p2,
        "OpenSim lacks a reaction; exudyn 5e-5",
    ),
)
