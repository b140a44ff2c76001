"""What is told of the laws of a scene: how smooth they are at their knots."""

from __future__ import annotations

from collections.abc import Iterator

from mechcore.laws.curve import MotionCurve
from mechcore.laws.factors import ORDER_NAMES, jumps
from mechcore.laws.program import CLOCK, Follow
from mechcore.laws.timed import Law, Piecewise
from mechcore.spec.mechanism import CamJoint, Mechanism
from mechviz.scene.units import Units

_MOST_PLACES = 8  # in one line


def continuity_words(mechanism: Mechanism, units: Units) -> Iterator[str]:
    """For each law of several pieces, of a drive or of a cam: up to which derivative it is continuous, where the next one jumps."""
    for drive in mechanism.drives:
        curve, kind = _curve(drive.law)
        if curve is not None and len(curve.pieces) > 1:
            yield f"{drive.joint}: {_words(curve, kind, units)}"
    for joint in mechanism.joints:
        if isinstance(joint, CamJoint) and joint.lift is not None:
            yield f"{joint.name}: {_words(joint.lift, 'length' if joint.bed else 'angle', units)}"


def _curve(law: Law) -> tuple[MotionCurve | None, str]:
    """The curve of a drive's law, and what it goes over."""
    if isinstance(law, Follow):
        return law.curve, "time" if law.master is CLOCK else "angle"
    if isinstance(law, Piecewise):
        return MotionCurve.of(law.knots, law.coefficients), "time"
    return None, "time"


def _words(curve: MotionCurve, kind: str, units: Units) -> str:
    found = jumps(curve, ends=False)
    pieces = f"{len(curve.pieces)} pieces, continuous"
    if not found:
        return f"{pieces} up to the jerk"
    order = min(j.order for j in found)
    places = [units.show(j.angle, kind, 5) for j in found if j.order == order]
    more = f" and {len(places) - _MOST_PLACES} more" if len(places) > _MOST_PLACES else ""
    smooth = f"{pieces} up to the {ORDER_NAMES[order - 1]}" if order else f"{len(curve.pieces)} pieces"
    shock = ", infinite jerk" if order == 2 else ", a knock" if order < 2 else ""
    return f"{smooth}; the {ORDER_NAMES[order]} jumps at {', '.join(places[:_MOST_PLACES])}{more}{shock}"
