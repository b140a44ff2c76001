"""Segments of a scene -> curves of the core, over a cam's angle, a master angle or time."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from itertools import pairwise, product
from typing import TYPE_CHECKING

import numpy as np

from mechcore.errors import MechanismError
from mechcore.laws.boundary_conditions import BoundaryCondition, measured_table
from mechcore.laws.catalogue import rise
from mechcore.laws.curve import MotionCurve
from mechcore.laws.factors import VELOCITY_JUMP, jumps
from mechcore.laws.program import Segment, program
from mechcore.laws.segment_laws import (
    BoundaryPolynomial,
    BoundaryState,
    Dwell,
    GivenAcceleration,
    GivenPosition,
    GivenVelocity,
    LeastPeak,
    NormalisedLaw,
    SegmentLaw,
    Spline,
    fourier_curve,
    joined_table,
)
from mechcore.records import dataclass
from mechcore.texts import as_coordinate
from mechviz.scene.convert import JoinedSegments
from mechviz.scene.fields import is_complete
from mechviz.scene.kinds.cam_files import read_columns
from mechviz.scene.kinds.segments import (
    FREE,
    ORDERS,
    CurveDocument,
    LawDocument,
    LiftSegment,
    PointDocument,
    PositionTable,
    RadiusSegment,
    SegmentTable,
)
from mechviz.scene.units import QuantityError, derivative_kind, parse

if TYPE_CHECKING:
    from mechviz.scene.convert import Converter

_SAME_RANGE = 1e-6  # relative difference between the ranges of a table and of its segment that is allowed
_MOST_WAVES = 1000  # of a harmonic in a segment


@dataclass(frozen=True)
class Axes:
    """A coordinate ("angle", "length") over a master ("time", "angle", "length"): converts the values of a motion to SI units."""

    convert: Converter
    coordinate: str
    master: str

    def state(self, value: float | str | Sequence[float | str], path: str) -> tuple[float | None, ...]:
        """A position and its derivatives, as far as they are given; None where free, NaN where not readable."""
        if isinstance(value, float | int | str):
            return (self.convert.si(value, self.coordinate, path),)
        return tuple(None if v == FREE else self.derivative(v, k, f"{path}[{k}]") for k, v in enumerate(value[:4]))

    def derivative(self, value: float | str, order: int, path: str) -> float:
        return self.convert.si(value, derivative_kind(self.coordinate, self.master, order), path)

    def place(self, value: float | str, path: str) -> float:
        return self.convert.si(value, self.master, path)


def segments_curve(
    segments: Sequence[SegmentTable], overs: Sequence[float], axes: Axes, path: str, start: BoundaryState, repeats: bool
) -> MotionCurve | None:
    """Segments over ranges [SI] as one curve that starts in a state; None where a fault was noted or something could not be
    read."""
    before = len(axes.convert.faults)
    made = [_segment(s, over, axes, f"{path}[{k}]") for k, (s, over) in enumerate(zip(segments, overs, strict=True))]
    complete = bool(made and start) and None not in made and not any(v is not None and math.isnan(v) for v in start)
    if len(axes.convert.faults) > before or not complete:
        return None
    try:
        curve = program([s for s in made if s is not None], start, repeats=repeats)
        axes.convert.curves[path] = JoinedSegments(curve, tuple(overs), axes.coordinate, axes.master)
        return curve
    except MechanismError as error:
        for f in error.faults:
            match = re.fullmatch(r"program\[(\d+)\]\.(\w+).*", f.path)
            if match is None or match[2] not in ("to", "law"):
                raise
            k = int(match[1])
            place = match[2] if getattr(segments[k], match[2]) is not None else ("law" if segments[k].law is not None else "to")
            axes.convert.note(f"{path}[{k}].{place}", f.message, f.remedy)
        return None


def lift_curve(
    segments: Sequence[LiftSegment | RadiusSegment], axes: Axes, path: str, start: float, repeats: bool
) -> MotionCurve | None:
    """Segments of a cam as one curve that starts at a position; None where a fault was noted or something could not be read.

    On a cam that comes round, whose last segment ends with a state, velocity and acceleration at the start are those of its end.
    """
    overs = [axes.place(s.over, f"{path}[{k}].over") for k, s in enumerate(segments)]
    state: BoundaryState = (start, None, None) if repeats and segments and isinstance(segments[-1].to, list) else (start,)
    return segments_curve(segments, overs, axes, path, state, repeats)


def note_corners(
    segments: Sequence[LiftSegment | RadiusSegment], curve: MotionCurve, axes: Axes, path: str, *, rotary: bool
) -> None:
    """Note where the velocity falls at the first or last row of a table: a corner on any cam, which only a knife follows.

    ``rotary``: the follower swings.
    """
    falls = [j for j in jumps(curve, (1,), VELOCITY_JUMP) if j.size < 0.0]
    ends = np.concatenate([[0.0], np.cumsum([axes.place(s.over, path) for s in segments])])
    near = _SAME_RANGE * float(ends[-1])
    for (k, segment), row, jump in product(enumerate(segments), ("first", "last"), falls):
        apart = abs(jump.angle - curve.start - float(ends[k + (row == "last")]))
        table = isinstance(segment.law, LawDocument) and segment.law.kind == "position"
        if table and min(apart, abs(apart - curve.length)) < near:
            before, after = (as_coordinate(v, rotary=rotary, digits=4) for v in (jump.left, jump.right))
            turn = " per radian" if axes.master == "angle" else ""
            why = f"at its {row} row the velocity falls from {before} to {after}{turn}: a corner on a cam of any size."
            remedy = "Write rest = true beside its rows; or let a knife follow it."
            axes.convert.note(f"{path}[{k}].law.position", why, remedy)


def is_at_rest(segments: Sequence[SegmentTable], curve: MotionCurve) -> bool:
    """Whether nothing moves: every segment ends at the position of the start, and all derivatives vanish. Never with laws that are
    tables."""
    if any(isinstance(s.law, LawDocument) for s in segments):
        return False
    first = float(curve.pieces[0].at(0.0, 0)[0])
    left, right = curve.limits(3)
    size = max(abs(first), 1e-300)
    return bool(np.all(np.abs(left[:, 0] - first) <= 1e-12 * size) and not np.any(left[:, 1:]) and not np.any(right[:, 1:]))


def _segment(given: SegmentTable, over: float, axes: Axes, path: str) -> Segment | None:
    to = None if given.to is None else axes.state(given.to, f"{path}.to")
    if (
        (to is not None and any(v is not None and math.isnan(v) for v in to))
        or given.invalid_keys
        or given.asks_too_much
        or math.isnan(over)
    ):
        return None
    if isinstance(given.law, LawDocument):
        law = _law(given.law, over, axes, f"{path}.law")
        return None if law is None else Segment(over, to, law)
    if to is None:
        return Segment(over, None, Dwell())
    if given.law_name == "polynomial":
        return Segment(over, to, BoundaryPolynomial())
    try:
        return Segment(over, to, NormalisedLaw(rise(str(given.law_name), **given.parameters), given.mirrored))
    except MechanismError:  # noted where the segment was read
        return None


def _law(given: LawDocument, over: float, axes: Axes, path: str) -> SegmentLaw | None:
    """The law of a table; None where a fault was noted or the table could not be read."""
    kind = given.kind if not given.invalid_keys else ""
    if kind in ("acceleration", "velocity"):
        curve = _curve(getattr(given, kind), over, axes, 2 if kind == "acceleration" else 1, f"{path}.{kind}")
        if curve is None:
            return None
        return GivenVelocity(curve) if kind == "velocity" else GivenAcceleration(curve, given.scaled, given.balanced)
    if kind == "position" and given.position is not None:
        return _positions(given.position, over, axes, f"{path}.position")
    if kind in ("polynomial", "spline"):
        points = _conditions(getattr(given, kind), over, axes, f"{path}.{kind}")
        if points is None or not is_complete(given):
            return None
        powers = None if given.powers is None else tuple(given.powers)
        return Spline(points, given.degree) if kind == "spline" else BoundaryPolynomial(points, powers)
    if kind == "least" and given.least is not None and is_complete(given):
        if any(key not in ORDERS or value <= 0.0 for key, value in given.limits.items()):  # noted where the table was read
            return None
        limits = {ORDERS[key]: value for key, value in given.limits.items()}
        return LeastPeak(given.least, limits, None if given.smooth is None else ORDERS[given.smooth], given.steps)
    return None


def _curve(given: CurveDocument, over: float, axes: Axes, order: int, path: str) -> MotionCurve | None:
    convert = axes.convert
    before = len(convert.faults)
    curve = None
    if given.at is not None:
        at = [axes.place(v, f"{path}.at[{k}]") for k, v in enumerate(given.at)]
        values = [axes.derivative(v, order, f"{path}.values[{k}]") for k, v in enumerate(given.values or ())]
        known = len(at) == len(values) and is_complete(given)  # else noted where the table was read
        if len(convert.faults) == before and known and not any(map(math.isnan, (*at, *values))):
            if at[0] != 0.0 or abs(at[-1] - over) > _SAME_RANGE * over:
                convert.note(f"{path}.at", "the places do not go from 0 to the end of the segment.", "Let them cover its range.")
            elif any(b < a for a, b in pairwise(at)):
                convert.note(f"{path}.at", "the places do not grow.", "Put the rows in increasing order.")
            else:
                curve = joined_table(at, values, given.steps)
    else:
        mean = 0.0 if given.mean is None else axes.derivative(given.mean, order, f"{path}.mean")
        rows = []
        for k, h in enumerate(given.harmonics or ()):
            place = f"{path}.harmonics[{k}]"
            sine, cosine = (axes.derivative(getattr(h, key), order, f"{place}.{key}") for key in ("sine", "cosine"))
            rows.append((h.order, sine, cosine))
            if not 0.0 < h.order <= _MOST_WAVES:
                convert.note(f"{place}.order", f"{h.order:g} waves in the range.", f"Give a positive number, up to {_MOST_WAVES}.")
        known = is_complete(given) and not any(map(math.isnan, (mean, *(v for row in rows for v in row))))
        if len(convert.faults) == before and known:
            curve = fourier_curve(over, mean, rows)
    return curve


def _positions(given: PositionTable, over: float, axes: Axes, path: str) -> SegmentLaw | None:
    convert = axes.convert
    before = len(convert.faults)
    if given.file is not None:
        at, values = _file(given.file, axes, f"{path}.file")
    else:
        at = [axes.place(v, f"{path}.at[{k}]") for k, v in enumerate(given.at or ())]
        values = [axes.derivative(v, 0, f"{path}.values[{k}]") for k, v in enumerate(given.values or ())]
    tolerance = axes.derivative(given.tolerance, 0, f"{path}.tolerance")
    known = len(at) == len(values) > 0 and is_complete(given)  # else noted where the table was read
    if len(convert.faults) > before or not known or any(map(math.isnan, (tolerance, *at, *values))):
        return None
    key = "at" if given.file is None else "file"
    if abs(at[-1] - at[0] - over) > _SAME_RANGE * over:
        why = "the table's range is another one than the segment's."
        convert.note(f"{path}.{key}", why, "Make the segment as long as its table.")
        return None
    try:
        return GivenPosition(measured_table(np.array(at) - at[0], values, tolerance, given.periodic, rest=given.rest)[0])
    except MechanismError as error:
        for f in error.faults:
            convert.note(f"{path}.{'tolerance' if f.path == 'law.tolerance' else key}", f.message, f.remedy)
        return None


def _file(name: str, axes: Axes, path: str) -> tuple[list[float], list[float]]:
    """Places and positions of a CSV table in SI units; empty where a fault was noted."""
    convert = axes.convert
    data = convert.file(name, path)
    if data is None:
        return [], []
    try:
        (at, values), units = read_columns(data, ())
    except MechanismError as error:
        for f in error.faults:
            convert.note(path, f.message, f.remedy)
        return [], []
    factors = []
    for unit, kind in zip(units, (axes.master, axes.coordinate), strict=True):
        try:
            factors.append(convert.si(1.0, kind, path) if unit is None else parse(f"1 {unit}", kind))
        except QuantityError as error:
            convert.note(path, f"its header: {error}", error.remedy)
            return [], []
    return [factors[0] * v for v in at], [factors[1] * v for v in values]


def _conditions(points: Sequence[PointDocument], over: float, axes: Axes, path: str) -> tuple[BoundaryCondition, ...] | None:
    convert = axes.convert
    before = len(convert.faults)
    conditions = []
    for k, point in enumerate(points):
        at = axes.place(point.at, f"{path}[{k}].at")
        state = axes.state(point.to, f"{path}[{k}].to")
        if point.invalid_keys or any(v is not None and math.isnan(v) for v in (at, *state)):
            return None
        if not 0.0 < at < over:
            convert.note(f"{path}[{k}].at", "it is not inside the segment.", "Give a place between its two ends.")
        conditions += [BoundaryCondition(at, v, order) for order, v in enumerate(state) if v is not None]
    return tuple(conditions) if len(convert.faults) == before else None
