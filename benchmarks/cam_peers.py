"""Cams: mechcore against the package `mechanism` 1.1.10, side by side in one process of an environment of its own.

    python benchmarks/cam_peers.py

Offset roller follower, dwell-rise-dwell-fall, cycloidal, 3,600 angles. The environment is that of `peers/run.py`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
LIFT, BASE, OFFSET, ROLLER, STEEP = 0.02, 0.04, 0.01, 0.01, 30.0  # m, degrees
SEGMENTS = (("Dwell", 60), ("Rise", LIFT, 120), ("Dwell", 60), ("Fall", LIFT, 120))


def main() -> None:
    """Make the environment, and measure in it."""
    sys.path.insert(0, str(HERE / "peers"))
    import run

    python, failed = run.environment({"peer_mechanism": ("mechanism==1.1.10",)})
    if failed:
        sys.exit(f"mechanism cannot be installed: {failed['peer_mechanism']}")
    paths = os.pathsep.join([str(HERE.parent / "core"), str(HERE)])
    sys.exit(subprocess.run([python, __file__, "measure"], env={**os.environ, "PYTHONPATH": paths}, check=False).returncode)


def lift_by_hand(x):
    """Lift of a cycloidal rise over its angle, and the derivative by x from 0 to 1, [m]."""
    import numpy as np

    return LIFT * (x - np.sin(2.0 * np.pi * x) / (2.0 * np.pi)), LIFT * (1.0 - np.cos(2.0 * np.pi * x))


def profile_error(profile):
    """Largest distance from the profile by hand at the same angles: pitch curve e + i (h0 + s), the roller's radius inwards."""
    import numpy as np

    theta = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)
    h0 = np.sqrt((BASE + ROLLER) ** 2 - OFFSET**2)
    s, s1 = np.zeros_like(theta), np.zeros_like(theta)
    turn = np.radians(SEGMENTS[1][-1])
    s[(theta > np.radians(179.99)) & (theta < np.radians(240.01))] = LIFT
    for low, falls in ((np.radians(60.0), False), (np.radians(240.0), True)):
        x = (theta - low) / turn
        on = (x >= 0.0) & (x <= 1.0)
        value, slope = lift_by_hand(x[on])
        s[on], s1[on] = (LIFT - value, -slope / turn) if falls else (value, slope / turn)
    z = OFFSET + 1j * (h0 + s)
    tangent = 1j * s1 - 1j * z  # of the pitch curve, in the follower's axes; the cam turns counter-clockwise
    inwards = 1j * tangent / np.abs(tangent)
    inwards = np.where((inwards * np.conj(z)).real > 0.0, -inwards, inwards)
    by_hand = (z + ROLLER * inwards) * np.exp(-1j * theta)
    return float(np.abs(profile - by_hand).max()) / LIFT


def base_height(rise):
    """The least base circle for the pressure angle by a fine scan, rise and fall alike [m]."""
    import numpy as np

    theta = np.linspace(0.0, 2.0 * np.pi, 2_000_001)
    value = rise(theta)
    height = np.max(np.abs(value[1] - OFFSET) / np.tan(np.radians(STEEP)) - value[0])
    return float(np.hypot(OFFSET, height)) - ROLLER


def measure() -> None:
    """Times and errors of both."""
    from timing import interleaved, machine  # isort: skip  # first: it sets one thread

    import matplotlib

    matplotlib.use("Agg")  # the package draws as well; nothing is drawn here
    import numpy as np
    from mechanism import Cam as Peer
    from scipy.spatial import cKDTree

    from mechcore.cams.followers import Follower, Roller, Translating
    from mechcore.cams.limits import Requirement, find_limits
    from mechcore.cams.sizing import least_base
    from mechcore.cams.synthesis import Cam
    from mechcore.laws.program import Segment, program

    angles = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)
    turns = [np.radians(s[-1]) for s in SEGMENTS]
    rise = program([Segment(turns[0]), Segment(turns[1], LIFT), Segment(turns[2]), Segment(turns[3], 0.0)])
    follower = Follower(Translating(OFFSET), Roller(ROLLER))
    start = follower.base_coordinate(BASE)
    cam = Cam(rise.raised(start), follower)
    want = Requirement(pressure_rise=np.radians(STEEP), pressure_fall=np.radians(STEEP))

    def synthesis():
        s = cam.at(angles)
        return s, s.pitch, s.working, s.pressure_angle, s.radius

    def limits():
        return find_limits(cam, synthesis()[0])

    def laws():
        return Peer(motion=list(SEGMENTS), degrees=True, omega=1.0, h=2.0 * np.pi / 3600)

    peer = laws()

    def profile():
        return peer.cycloidal.get_profile(BASE, peer.thetas_r)

    def circle():
        return peer.get_base_circle(
            kind="cycloidal", follower="roller", roller_radius=ROLLER, eccentricity=OFFSET, max_pressure_angle=STEEP
        )

    times = interleaved(
        {
            "mechcore: profile, pressure angle, curvature": synthesis,
            "mechcore: the same with all limits": limits,
            "mechcore: least base circle": lambda: least_base(rise, follower, want),
            "mechanism: laws alone": laws,
            "mechanism: profile (without roller and offset)": profile,
            "mechanism: base circle": circle,
        }
    )
    print(machine("numpy", "scipy", "mechanism"))
    for name, seconds in times.items():
        print(f"{name:<52} {1e3 * seconds:8.3f} ms")
    theirs_own = profile()[0] + 1j * profile()[1]
    exact = cam.at(np.linspace(0.0, 2.0 * np.pi, 72001)).working
    tree = cKDTree(np.column_stack([exact.real, exact.imag]))

    def away(z, turned):
        w = z * np.exp(1j * turned)
        return tree.query(np.column_stack([w.real, w.imag]))[0].max()

    best = min(np.linspace(-np.pi, np.pi, 721), key=lambda turned: away(theirs_own[::20], turned))
    off = away(theirs_own, best)
    ours, theirs = least_base(rise, follower, want).base, float(circle()["Rb"])
    heights = base_height(rise)
    print("\n### P5 Offset roller follower: dwell-rise-dwell-fall\n")
    print("| who | 3,600 points | ratio | error, of the lift |\n|---|---|---|---|")
    own = times["mechcore: profile, pressure angle, curvature"]
    spent = times["mechanism: profile (without roller and offset)"] + times["mechanism: laws alone"]
    rows = (
        ("mechcore: profile, pressure angle, curvature", own, profile_error(synthesis()[2])),
        ("mechanism: laws and profile", spent, off / LIFT),
        ("mechcore: least base circle", times["mechcore: least base circle"], abs(ours - heights) / LIFT),
        (
            "mechanism: base circle",
            times["mechanism: laws alone"] + times["mechanism: base circle"],
            abs(abs(theirs) - heights) / LIFT,
        ),
    )
    for who, seconds, error in rows:
        print(f"| {who} | {1e3 * seconds:.3f} ms | {seconds / own:.2f} | {error:.1e} |")
    print(f"\nmechanism's profile, turned as well as it can be, is off by {100.0 * off / LIFT:.2g} % of the lift")
    print(f"base circle for {STEEP:g} deg: mechanism {1e3 * theirs:.5g} mm, mechcore {1e3 * ours:.5g} mm")
    for radius, whose in ((abs(theirs), "mechanism"), (ours, "mechcore")):
        computed = find_limits(Cam(rise.raised(follower.base_coordinate(radius)), follower))
        steep = np.degrees(max(computed.rise.value, computed.fall.value))
        print(f"largest pressure angle on the circle of {whose}: {steep:.6g} deg")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("step", nargs="?", choices=["measure"], help="only measure, in the environment that has the peer already")
    measure() if parser.parse_args().step else main()
