"""Cams: synthesis with all limits against a closed form by hand, errors, the search for base circle and offset, analysis.

    python benchmarks/cams.py

Dwell-rise-dwell-fall, cycloidal and 3-4-5, offset roller follower, 3,600 angles: the case of the reference data.
"""

from __future__ import annotations

from timing import interleaved, machine  # first: it sets one thread

import argparse  # isort: skip
import json
from pathlib import Path

import numpy as np

from mechcore.cams.analysis import analyse
from mechcore.cams.contour import cam_contour
from mechcore.cams.followers import Flat, Follower, Oscillating, Roller, Translating
from mechcore.cams.limits import Requirement, find_limits
from mechcore.cams.sizing import best_offset, least_base
from mechcore.cams.synthesis import Cam
from mechcore.laws.program import Segment, program

DATA = Path(__file__).parent.parent / "tests" / "reference" / "cams.json"
CASE = next(c for c in json.loads(DATA.read_text())["cases"] if c["id"] == "cam-rdrd-roller-flat")
BASE, LIFT, E, R = (CASE["inputs"][k] for k in ("h_base", "lift", "e", "roller_radius"))
EDGES = np.radians([0, 120, 180, 280, 360])
OVER = np.diff(EDGES)
LAW = program([Segment(OVER[0], BASE + LIFT), Segment(OVER[1]), Segment(OVER[2], BASE, "3-4-5"), Segment(OVER[3])], BASE)
CAM = Cam(LAW, Follower(Translating(E), Roller(R)))
ANGLES = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)
RISE = program([Segment(2.0, LIFT), Segment(1.0), Segment(1.6, 0.0, "3-4-5"), Segment(2 * np.pi - 4.6)])
SWING = program([Segment(2.0, 0.25), Segment(1.0), Segment(1.6, 0.0, "3-4-5"), Segment(2 * np.pi - 4.6)])
WANT = Requirement(radius=0.005, pressure_rise=np.radians(30), pressure_fall=np.radians(40))


def synthesis():
    s = CAM.at(ANGLES)
    return s, s.pitch, s.working, s.pressure_angle, s.radius


def synthesis_and_limits():
    s, *rest = synthesis()
    return find_limits(CAM, s), rest


def by_hand(theta: np.ndarray = ANGLES):
    """The closed form as one writes it by hand for this one program."""
    h, v, a = np.full_like(theta, BASE), np.zeros_like(theta), np.zeros_like(theta)
    k = theta < EDGES[1]
    x = theta[k] / EDGES[1]
    h[k] = BASE + LIFT * (x - np.sin(2 * np.pi * x) / (2 * np.pi))
    v[k] = LIFT / EDGES[1] * (1 - np.cos(2 * np.pi * x))
    a[k] = LIFT / EDGES[1] ** 2 * 2 * np.pi * np.sin(2 * np.pi * x)
    h[(theta >= EDGES[1]) & (theta < EDGES[2])] = BASE + LIFT
    k = (theta >= EDGES[2]) & (theta < EDGES[3])
    b = EDGES[3] - EDGES[2]
    x = (theta[k] - EDGES[2]) / b
    h[k] = BASE + LIFT * (1 - x**3 * (10 - 15 * x + 6 * x**2))
    v[k] = -LIFT / b * 30 * x**2 * (1 - x) ** 2
    a[k] = -LIFT / b**2 * 60 * x * (1 - 3 * x + 2 * x**2)
    c, s = np.cos(theta), np.sin(theta)
    px, py = c * E + s * h, -s * E + c * h
    u = v - E
    size2 = h * h + u * u
    size = np.sqrt(size2)
    alpha = np.arctan2(u, h)
    nx, ny = -u / size, h / size
    rho = size2 * size / (h * h - h * a + u * (2 * v - E))
    return px, py, px - R * (c * nx + s * ny), py - R * (c * ny - s * nx), alpha, rho - R


def errors() -> dict[str, float]:
    """Largest relative errors at the angles of the reference."""
    rows = CASE["expected"]
    s = CAM.at([row["theta"] for row in rows])
    want = {k: [row["roller"][k] for row in rows] for k in rows[0]["roller"]}
    joints = {
        "profile": (s.working, np.array([complex(*p) for p in want["profile_point"]])),
        "pressure angle": (s.pressure_angle, np.array(want["pressure_angle"])),
        "radius of curvature": (s.radius, np.array(want["profile_curvature_radius"])),
    }
    return {k: float(np.abs(got - w).max() / np.abs(w).max()) for k, (got, w) in joints.items()}


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    print(machine("numpy", "scipy"))
    Follower(Translating(), Flat())
    oscillating = Follower(Oscillating(0.16, 0.14), Roller(0.01))
    times = interleaved(
        {
            "closed form by hand: profile, pressure angle, curvature": by_hand,
            "mechcore: profile, pressure angle, curvature": synthesis,
            "mechcore: the same with all limits": synthesis_and_limits,
            "least base circle, offset given": lambda: least_base(RISE, Follower(Translating(E), Roller(R)), WANT),
            "least base circle and best offset": lambda: best_offset(RISE, Roller(R), WANT),
            "least base circle, flat follower": lambda: least_base(
                RISE, Follower(Translating(), Flat()), Requirement(radius=0.005)
            ),
            "least base circle, oscillating roller": lambda: least_base(SWING, oscillating, WANT),
            "analysis of the profile, roller, 360 angles": lambda: analyse(
                cam_contour(CAM), CAM.follower, ANGLES[::10], bridges=False
            ),
        }
    )
    for name, seconds in times.items():
        print(f"{name:<58} {1e3 * seconds:8.3f} ms")
    for name, error in errors().items():
        print(f"largest relative error, {name:<34} {error:8.1e}")
    hand = by_hand(ANGLES)
    s = CAM.at(ANGLES)
    print(f"largest difference from the closed form [m]                {np.abs(s.working - (hand[2] + 1j * hand[3])).max():8.1e}")


if __name__ == "__main__":
    main()
