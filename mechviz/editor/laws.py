"""Change of the law of a segment. The data of the new law are computed from the present motion, so that it changes as little as
possible."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from mechcore.arrays import Real
from mechcore.laws.boundary_conditions import BoundaryCondition, measured_table, polynomial_law
from mechcore.laws.catalogue import RISES
from mechcore.laws.curve import MotionCurve, Side
from mechcore.laws.segment_laws import joined_table
from mechcore.records import dataclass
from mechviz.scene.annotations import Place
from mechviz.scene.convert import JoinedSegments
from mechviz.scene.document import value_at
from mechviz.scene.faults import path_text
from mechviz.scene.kinds.segments import FREE, LawDocument, RadiusSegment, SegmentTable
from mechviz.scene.scene import Scene
from mechviz.scene.units import Units, derivative_kind

STATED_ENDS, POLYNOMIAL, SPLINE = "polynomial with stated ends", "polynomial through points", "spline through points"
ACCELERATION, VELOCITY, TABLE = "given acceleration", "given velocity", "table of positions"
_LEAST = {f"least {order}": {"least": order} for order in ("acceleration", "jerk", "snap")}
LAW_OPTIONS = (*RISES, "polynomial", STATED_ENDS, POLYNOMIAL, SPLINE, ACCELERATION, VELOCITY, TABLE, *_LEAST)

_POINTS = {POLYNOMIAL: 3, SPLINE: 4}  # between the ends: few enough to be moved one by one
_ROWS = 16  # steps of given accelerations and velocities, beside the bends
_TABLE_ROWS = 24
_DIGITS = 10
_SMOOTH = 1e-6  # of a derivative's largest magnitude: smaller jumps do not count


@dataclass(frozen=True)
class _Segment:
    """A segment before the change: its curve over 0 ... ``over`` [SI], and the joined segments that contain it (``kinds``)."""

    curve: MotionCurve
    over: float
    units: Units
    kinds: JoinedSegments

    def place(self, value: float) -> float:
        return _rounded(value / float(self.units.factor(self.kinds.master)))

    def derivative(self, value: float, order: int) -> float:
        return _rounded(value / float(self.units.factor(derivative_kind(self.kinds.coordinate, self.kinds.master, order))))

    @property
    def rests(self) -> bool:
        """Whether it goes from rest to rest."""
        return not any([*self.state(0.0, 1)[1:], *self.state(self.over, 1, "left")[1:]])

    def jerk(self) -> float:
        """The jerk at its end of the polynomial of the fifth degree with its end conditions, as a bare number of the scene."""
        ends = ((0.0, self.curve(np.zeros(1), 2)), (self.over, self.curve(np.array([self.over]), 2, "left")))
        conditions = [BoundaryCondition(at, float(v), k) for at, state in ends for k, v in enumerate(state[:, 0])]
        return self.derivative(float(polynomial_law(conditions).limits(3)[0][-1, 3]), 3)

    def state(self, at: float, orders: int, side: Side = "right") -> list[float]:
        """The position and its derivatives at a place, as bare numbers of the scene; small derivatives are zero."""
        values = self.curve(np.array([at]), orders, side)[:, 0]
        largest = np.abs(self.curve(np.linspace(0.0, self.over, 65), orders)).max(axis=1)
        return [0.0 if k and abs(v) <= _SMOOTH * largest[k] else self.derivative(float(v), k) for k, v in enumerate(values)]


def law_changes(scene: Scene, place: Place, option: str) -> dict[Place, Any]:
    """The changes of a scene for another law, one of `LAW_OPTIONS`, at a place ``(..., k, "law")``.

    Laws defined by data take these from the present motion. Where such a law satisfies derivatives at its ends and the present
    motion has some there, they are stated, or left free at neighbours of a fixed shape.
    """
    home, k = place[:-2], int(place[-2])
    segments: list[SegmentTable] = value_at(scene.document, home)
    table, joined = segments[k], scene.curves[path_text(home)]
    present = _present(joined, k, scene.units)
    changes: dict[Place, Any] = {(*home, k, key): None for key in ("parameters", "mirrored") if key in table.model_fields_set}
    meets = option in (STATED_ENDS, POLYNOMIAL, SPLINE, "polynomial", *_LEAST)
    end = present.state(present.over, 2, "left")
    stated = scene.document.formulas.get((*home, k, "to"), table.to)
    position = end[0] if stated is None else stated[0] if isinstance(stated, list) else stated
    if isinstance(table.to, list):
        position = scene.document.formulas.get((*home, k, "to", 0), position)
    following = segments[k + 1] if k + 1 < len(segments) else segments[0] if joined.curve.repeats else None
    bound = following is not None and _meets(following)  # it starts with the state at the end of this one, derivatives included
    whole = not isinstance(table, RadiusSegment)  # else its ends have no derivatives
    if option == STATED_ENDS and whole:
        changes[(*home, k, "to")] = [position, *end[1:], *([] if bound else [present.jerk()])]
    elif meets:
        moving = any(end[1:]) and not _meets(table) and not bound and whole and option not in ("polynomial", *_LEAST)
        if moving or table.to is None:
            changes[(*home, k, "to")] = [position, *end[1:]] if moving else position
    elif bound and whole and any(end[1:]):
        changes[(*home, k, "to")] = [position, FREE, FREE]
    elif option == TABLE:
        changes[(*home, k, "to")] = None
    elif table.to is None or (isinstance(table.to, list) and any(v != FREE for v in table.to[1:])):
        changes[(*home, k, "to")] = position
    if option in _POINTS and k and whole and any(present.state(0.0, 2)[1:]) and not _meets(table):
        before = segments[k - 1]
        if before.to is not None and not isinstance(before.to, list) and not _meets(before):
            changes[(*home, k - 1, "to")] = [scene.document.formulas.get((*home, k - 1, "to"), before.to), FREE, FREE]
    return {**changes, place: _written(option, present)}


def _meets(segment: SegmentTable) -> bool:
    """Whether a segment can satisfy velocities and accelerations at its ends."""
    return (
        segment.law.meets if isinstance(segment.law, LawDocument) else segment.to is not None and segment.law_name == "polynomial"
    )


def _present(joined: JoinedSegments, k: int, units: Units) -> _Segment:
    knots = joined.curve.knots - joined.curve.start
    first, last = (int(np.argmin(np.abs(knots - sum(joined.overs[:n])))) for n in (k, k + 1))
    return _Segment(MotionCurve(joined.curve.pieces[first:last]), float(knots[last] - knots[first]), units, joined)


def _written(option: str, present: _Segment) -> Any:
    """The new law as plain data of the scene."""
    if option in _POINTS:
        count = _POINTS[option]
        places = present.over * np.arange(1, count + 1) / (count + 1)
        points = [{"at": _rounded(present.place(x), 6), "to": _rounded(present.state(x, 0)[0], 6)} for x in places.tolist()]
        return {"polynomial" if option == POLYNOMIAL else "spline": points}
    if option in (ACCELERATION, VELOCITY):
        order = 2 if option == ACCELERATION else 1
        at, values = _rows(present.curve, order)
        rows = {"at": [present.place(x) for x in at.tolist()], "values": [present.derivative(v, order) for v in values.tolist()]}
        law: dict[str, Any] = {option.removeprefix("given "): rows}
        return {**law, "balanced": True} if order == 2 and present.rests and values.min() < 0.0 < values.max() else law
    if option == TABLE:
        at, values = _positions(present.curve, present.over, present.rests)
        table = {"at": [present.place(x) for x in at.tolist()], "values": [present.derivative(v, 0) for v in values]}
        return {"position": {**table, "rest": True} if present.rests else table}
    return "polynomial" if option == STATED_ENDS else _LEAST.get(option, option)


def _rows(curve: MotionCurve, order: int) -> tuple[Real, Real]:
    """Places and values of a derivative for a table that is joined by straight lines, with two rows at a jump. Its integrals over
    the segment are those of the curve."""
    left, right = curve.limits(order + 1)
    inner = curve(np.linspace(0.0, curve.length, 65), order + 1)
    size = np.abs(np.vstack([left, right, inner.T])).max(axis=0)
    step = np.abs(right[1:] - left[:-1]) > _SMOOTH * np.maximum(size, 1e-300)
    bends = np.flatnonzero(step[:, order] | step[:, order + 1])
    if len(bends) > _ROWS:  # a table: its jumps only
        bends = np.flatnonzero(step[:, order])
    ends = [0.0, *curve.knots[1:-1][bends].tolist(), curve.length]
    at: list[float] = []
    values: list[float] = []
    for a, b in pairwise(ends):
        inner = np.linspace(a, b, max(2, round(_ROWS * (b - a) / curve.length) + 1))
        row = curve(inner, order)[order]
        row[-1] = curve(inner[-1:], order, "left")[order, 0]
        if np.allclose(row, np.interp(inner, inner[[0, -1]], row[[0, -1]]), rtol=0.0, atol=_SMOOTH * size[order]):
            inner, row = inner[[0, -1]], row[[0, -1]]
        again = bool(at) and abs(values[-1] - row[0]) <= _SMOOTH * size[order]
        at += inner[int(again) :].tolist()
        values += row[int(again) :].tolist()
    x, y = np.array(at), np.array(values)
    start, end = right[0], left[-1]

    def gains(v: Real) -> Real:
        line = joined_table(x, v).integrated(0.0)
        return np.array([line.advance, line.integrated(0.0).advance][:order])

    change = end[order - 1] - start[order - 1]
    wanted = [change, curve.advance - start[1] * curve.length][:order]
    out = _corrected(y, gains, np.array(wanted))
    return x, np.where(np.abs(out) > 1e-12 * size[order], out, 0.0)


def _positions(curve: MotionCurve, over: float, rest: bool) -> tuple[Real, Real]:
    """Places and positions of a table. Its spline has the velocities of the curve at both ends, which are zero at ``rest``."""
    at = np.linspace(0.0, over, _TABLE_ROWS + 1)
    values = curve(at, 0, "left")[0]
    wanted = curve(at[[0, -1]], 1, "right")[1]
    wanted[1] = curve(at[-1:], 1, "left")[1, 0]

    def slopes(v: Real) -> Real:
        left, right = measured_table(at, v)[0].limits(1)
        return np.array([right[0, 1], left[-1, 1]])

    return at, values if rest else _corrected(values, slopes, wanted)


def _corrected(values: Real, linear: Callable[[Real], Real], wanted: Real) -> Real:
    """Values whose inner ones are changed as little as possible (least squares) such that ``linear(values)`` is ``wanted``."""
    out = values.copy()
    if len(values) > 2:
        columns = np.array([linear(unit) for unit in np.eye(len(values))[1:-1]]).T
        out[1:-1] += np.linalg.lstsq(columns, wanted - linear(values), rcond=None)[0]
    return out


def _rounded(value: float, digits: int = _DIGITS) -> float:
    return float(f"{value:.{digits}g}")
