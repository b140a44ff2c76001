"""Piecewise laws whose knots move with a parameter, evaluated between the nominal knots.

A value near a knot belongs to another piece as soon as the knot passes it, so that it is no smooth function of the parameter. On
one piece it is: pieces are continued beyond their ends to the nominal knots.
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

NEAR_KNOT = 1e-12  # relative difference of lengths that count as equal


def with_nominal_knots(parameter: Parameter, nominal: Mechanism, *, same_times: bool) -> Parameter:
    """The parameter with mechanisms whose laws have the nominal knots; ``same_times``: the laws are evaluated at the nominal times,
    whatever the length of their cycles."""
    return replace(parameter, mechanism=lambda x: with_aligned_knots(parameter.mechanism(x), nominal, same_times=same_times))


def with_aligned_knots(mechanism: Mechanism, nominal: Mechanism, *, same_times: bool = False) -> Mechanism:
    """A mechanism whose cams and drives have laws with the knots of the ``nominal`` one, scaled to the length of their own. With
    ``same_times`` polynomials of time are not scaled but evaluated on the nominal pieces (see `law_on_pieces_of`)."""
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
    """The curve with pieces between the knots of the ``nominal`` one, scaled to its own length; unchanged where the numbers of
    pieces differ or the lengths agree."""
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
