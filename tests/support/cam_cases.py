"""What the tests of cams share: the reference, programs of its cases, and profiles by a second, independent route."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from mechcore.cams.followers import Oscillating, Translating
from mechcore.cams.synthesis import Cam
from mechcore.laws.curve import MotionCurve
from mechcore.laws.program import Segment, program

REFERENCE = Path(__file__).resolve().parents[2] / "tests" / "reference"
CASES = {c["id"]: c for c in json.loads((REFERENCE / "cams.json").read_text())["cases"]}
CONTACT_FORCE = next(c for c in json.loads((REFERENCE / "misc.json").read_text())["cases"] if c["id"] == "cam-contact-force")
NAMES = {"harmonic": "harmonic", "cycloidal": "cycloidal", "poly345": "3-4-5", "parabolic": "parabolic", "dwell": "cycloidal"}


def segments_program(inputs: dict) -> MotionCurve:
    """The program of a reference case given by segments [law, degrees, change]."""
    h, out = inputs["h_base"], []
    for name, degrees, change in inputs["segments"]:
        h += change
        out.append(Segment(np.radians(degrees), None if name == "dwell" else h, NAMES[name]))
    return program(out, inputs["h_base"])


def by_inversion(cam: Cam, angle: np.ndarray) -> dict[str, np.ndarray]:
    """Pitch point, normal, profile point, pressure angle and pitch radius of a round follower by the pole of relative motion.

    Kinematic inversion: the follower turns about the instantaneous centre Q against the cam, so that the contact normal
    passes through
    Q; the path's curvature follows from the motion of Q (no envelope, no derivative of the pitch curve's formula).
    """
    q = cam.law(angle, 2)
    guide, turn = cam.follower.guide, cam.turn
    if isinstance(guide, Translating):
        t = guide.offset + 1j * q[0]
        spin, spin1 = np.zeros_like(angle), np.zeros_like(angle)
        pole, pole1 = turn * q[1] + 0j, turn * q[2] + 0j
        away = np.full(angle.shape, 1j)
    else:
        assert isinstance(guide, Oscillating)
        t = guide.pivot + guide.arm * guide.home * np.exp(-1j * guide.side * q[0])
        spin, spin1 = -guide.side * q[1], -guide.side * q[2]
        pole = spin * guide.pivot / (spin - turn)
        pole1 = spin1 * guide.pivot * (-turn) / (spin - turn) ** 2
        away = -1j * guide.side * (t - guide.pivot) / guide.arm
    frame = np.exp(-1j * turn * angle)
    relative, relative1 = spin - turn, spin1
    # in the cam's axes
    p, pole_c, pole_c1 = frame * t, frame * pole, frame * (pole1 - 1j * turn * pole)
    p1 = 1j * relative * (p - pole_c)
    p2 = 1j * relative1 * (p - pole_c) + 1j * relative * (p1 - pole_c1)
    normal = (t - pole) / np.abs(t - pole)
    normal = normal * np.where(np.real(np.conj(normal) * t) < 0.0, -1.0, 1.0)  # outwards
    return {
        "pitch": p,
        "working": p - cam.follower.radius * frame * normal,
        "pressure_angle": np.angle(normal * np.conj(away)),
        "pitch_radius": np.abs(p1) ** 3 / np.abs(np.imag(np.conj(p1) * p2)) * np.sign(-turn * np.imag(np.conj(p1) * p2)),
    }
