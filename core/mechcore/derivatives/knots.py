"""Laws by pieces whose knots move with a parameter, seen from where the knots are now.

A value near a knot belongs to another piece as soon as the knot passes it, so that it does not follow from the parameter by one
smooth function. Its piece does: each one is taken beyond its ends, as far as the present knots ask for.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mechcore.derivatives.model_numbers import Parameter
from mechcore.derivatives.time_pieces import law_on_pieces_of
from mechcore.laws.curve import MotionCurve
from mechcore.laws.program import CurveOverMaster
from mechcore.laws.timed import Piecewise
from mechcore.spec.mechanism import CamJoint, Mechanism

NEAR_KNOT = 1e-12  # relative: lengths that differ by no more are the same


def with_nominal_knots(parameter: Parameter, nominal: Mechanism, *, same_times: bool) -> Parameter:
    """The parameter with mechanisms whose laws have the knots of the nominal ones; ``same_times``: at which they are asked for,
    however long cycles are."""
    return replace(parameter, mechanism=lambda x: with_aligned_knots(parameter.mechanism(x), nominal, same_times=same_times))


def with_aligned_knots(mechanism: Mechanism, nominal: Mechanism, *, same_times: bool = False) -> Mechanism:
    """A mechanism with the laws of its cams and drives on the knots of another one's, stretched to the length of its own; not so
    stretched, as far as they are polynomials of the time, where they are asked for at the ``same_times``."""
    joints, drives = list(mechanism.joints), list(mechanism.drives)
    if len(joints) == len(nominal.joints) and len(drives) == len(nominal.drives):
        for j, (own, there) in enumerate(zip(joints, nominal.joints, strict=True)):
            if isinstance(own, CamJoint) and isinstance(there, CamJoint) and own.lift is not None and there.lift is not None:
                joints[j] = replace(own, lift=_on_knots(own.lift, there.lift))
        for d, (drive, other) in enumerate(zip(drives, nominal.drives, strict=True)):
            drives[d] = replace(drive, law=_law(drive.law, other.law, same_times))
    return replace(mechanism, joints=tuple(joints), drives=tuple(drives))


def _law(own: object, nominal: object, same_times: bool) -> Any:
    if isinstance(own, CurveOverMaster) and isinstance(nominal, CurveOverMaster):
        return replace(own, curve=_on_knots(own.curve, nominal.curve), master=_law(own.master, nominal.master, same_times))
    if isinstance(own, Piecewise) and isinstance(nominal, Piecewise) and own.knots != nominal.knots and not same_times:
        curve = _on_knots(_curve_of(own), _curve_of(nominal))
        polynomials = tuple(tuple(map(float, piece.poly)) for piece in curve.pieces)
        return Piecewise(tuple(map(float, curve.knots)), polynomials, own.advance)
    return law_on_pieces_of(nominal, own, same_times=same_times)


def _curve_of(law: Piecewise) -> MotionCurve:
    return replace(MotionCurve.of(law.knots, law.coefficients), start=law.knots[0])


def _on_knots(own: MotionCurve, nominal: MotionCurve) -> MotionCurve:
    """A curve whose pieces begin and end at the knots of another one of as many pieces, stretched to its own length."""
    if len(own.pieces) != len(nominal.pieces) or np.array_equal(own.lengths, nominal.lengths):
        return own
    ratio = own.length / nominal.length
    ratio = 1.0 if abs(ratio - 1.0) < NEAR_KNOT else ratio
    starts = own.start + ratio * (nominal.knots - nominal.start)
    pieces = [
        piece.beginning(float(new - old), ratio * there.length)
        for piece, old, new, there in zip(own.pieces, own.knots, starts, nominal.pieces, strict=False)
    ]
    return replace(own, pieces=tuple(pieces), extended=True)
