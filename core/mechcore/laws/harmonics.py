"""Families of rise laws made of sines: zones of sine, constant and cosine acceleration, and sums of harmonics.

All are normalised: 0 -> 1 over 0 -> 1. Zones as in R. L. Norton, *Cam Design and Manufacturing Handbook*, ch. 3 (SCCA) and
C. N. Neklutin, *Mechanisms and Cams for Automatic Machines* (modified constant velocity, trapezoid, sine).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..errors import Fault, MechanismError
from .curve import MotionCurve, Piece

__all__ = ["acceleration_zones", "harmonic_sum", "scca"]

_NO_WAVES = np.zeros((0, 3))


def acceleration_zones(zones: Sequence[float]) -> MotionCurve:
    """Rise with seven zones of acceleration, given by their shares of the range (sum 1; a share of 0 leaves a zone out).

    1 quarter sine up from zero, 2 constant, 3 quarter cosine down to zero, 4 constant velocity, 5 quarter sine down, 6 constant
    deceleration, 7 quarter cosine back to zero. The two amplitudes follow from rest at both ends, the stroke is one.
    """
    share = np.asarray(zones, float)
    if share.shape != (7,) or not np.all(np.isfinite(share)) or np.any(share < 0.0) or abs(share.sum() - 1.0) > 1e-9:
        raise MechanismError(
            Fault("law.zones", f"shares {list(zones)} of the zones.", "Give seven shares, none negative, that add up to 1.")
        )
    share = share / share.sum()
    quarter = 2.0 / np.pi
    gain = np.array([quarter, 1.0, quarter])
    up, down = float(gain @ share[:3]), float(gain @ share[4:])
    if up <= 0.0 or down <= 0.0:
        raise MechanismError(
            Fault(
                "law.zones",
                f"shares {list(zones)}: no acceleration" if up <= 0.0 else f"shares {list(zones)}: no deceleration",
                "Give zones 1-3 and zones 5-7 some of the range.",
            )
        )
    sizes = (1.0 / up, 1.0 / up, 1.0 / up, 0.0, -1.0 / down, -1.0 / down, -1.0 / down)
    pieces = []
    for k, (length, a) in enumerate(zip(share, sizes, strict=True)):
        if length <= 0.0:
            continue
        w = 0.5 * np.pi / length
        if k in (0, 4):
            pieces.append(Piece(float(length), np.zeros(1), np.array([[w, a, 0.0]])))
        elif k in (2, 6):
            pieces.append(Piece(float(length), np.zeros(1), np.array([[w, 0.0, a]])))
        else:
            pieces.append(Piece(float(length), np.array([a]), _NO_WAVES))
    raw = MotionCurve(tuple(pieces)).integrated().integrated()
    return _at_rest_at_the_end(raw.scaled(0.0, 1.0, 0.0, 1.0 / raw.advance))


def _at_rest_at_the_end(curve: MotionCurve) -> MotionCurve:
    """The integration's last rounding error (some 1e-17) in velocity is left as it is; the value at the end is made exact."""
    last = curve.pieces[-1]
    error = 1.0 - float(last.at(last.length, 0)[0])
    return MotionCurve((*curve.pieces[:-1], last.raised(error)), curve.start)


def scca(sine: float, constant: float, cosine: float) -> MotionCurve:
    """Sine-constant-cosine acceleration with Norton's shares b, c, d (b + c + d = 1) of the whole range.

    b is shared by the two sine ends, c by the two constant zones, d is the cosine middle. Members: (0, 1, 0) parabolic,
    (1/4, 1/2, 1/4) modified trapezoid, (1/4, 0, 3/4) modified sine, (0, 0, 1) simple harmonic, (1/2, 0, 1/2) cycloidal.
    """
    b, c, d = 0.5 * sine, 0.5 * constant, 0.5 * cosine
    return acceleration_zones((b, c, d, 0.0, d, c, b))


def harmonic_sum(linear: float, sines: Mapping[float, float], cosines: Mapping[float, float]) -> MotionCurve:
    """``linear x + sum a_k sin(pi k x) + sum b_k (1 - cos(pi k x))`` on 0 ... 1, by k."""
    keys = sorted({*sines, *cosines})
    waves = np.array([[np.pi * k, sines.get(k, 0.0), -cosines.get(k, 0.0)] for k in keys]).reshape(-1, 3)
    poly = np.array([sum(cosines.values()), linear])
    return MotionCurve((Piece(1.0, poly, waves),))
