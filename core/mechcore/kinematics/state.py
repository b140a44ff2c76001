"""Positions of a mechanism: rotations and displacements, filled in step by step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import Any

import numpy as np

from mechcore.accuracy import DEFAULT
from mechcore.arrays import Index, Plane, Real, Values
from mechcore.kinematics.model import Model
from mechcore.kinematics.program import Block, NonlinearTerm, VectorSum
from mechcore.numerics.frames import added, product, rotation_of, summed
from mechcore.records import dataclass


@dataclass
class State:
    """Rotations of all rotation classes and displacements of all sliding joints, filled in block by block.

    ``delta``: rotation of each rotation class relative to its group (from drives); ``rot``: rotation of each rotation class, None
    while unknown; ``newton``: by name of the general blocks, the result of Newton's method.
    """

    drives: Sequence[Values]
    delta: list[Plane]
    rot: list[Any]
    slide: dict[int, Values]
    newton: dict[str, Newton] = field(default_factory=dict)
    constants: Sequence[float] = ()  # of the relations
    angle: dict[int, Values] = field(default_factory=dict)  # angles beyond one turn, of groups that relations need
    near: Mapping[str, Values] = field(default_factory=dict)  # approximate angles "angle <group>" that select the turn
    tolerance: float = DEFAULT.position  # residual at which Newton's method stops, in units of the mechanism's size
    curve_values: dict[int, Real] = field(default_factory=dict)  # relation -> value and two derivatives of its curve (3, ...)

    def copy(self) -> State:
        """A state that can be filled in further without changing this one."""
        return replace(
            self,
            rot=list(self.rot),
            slide=dict(self.slide),
            newton=dict(self.newton),
            angle=dict(self.angle),
            curve_values=dict(self.curve_values),
        )


@dataclass(frozen=True)
class Newton:
    """Result of Newton's method for a general block.

    ``x``: unknowns (..., n) (angles [rad], then slides [m]); ``residual`` of the loops [m]; ``first``: size of the first correction
    (relative), a measure of the quality of the start.
    """

    x: Real
    residual: Real
    first: Real


@dataclass(frozen=True, eq=False)
class Interpolant:
    """A block's unknowns at some frames, by interpolation along the branch, in place of an ill-conditioned solve.

    ``frames`` (k,); ``values``, ``first``, ``second`` (k, unknowns): angles [rad] and slides [m], and their rates.
    """

    frames: Index
    values: Real
    first: Real
    second: Real

    def into(self, rates: list[Any], derivative: int) -> None:
        """Replace a block's solved first or second rates by the interpolated ones at ``frames``."""
        given = self.first if derivative == 1 else self.second
        for u in range(len(rates)):
            rates[u] = np.array(rates[u])
            rates[u][self.frames] = given[:, u]


def initial_state(
    model: Model,
    drives: Sequence[Values],
    constants: Sequence[float] = (),
    near: Mapping[str, Values] | None = None,
    tolerance: float = DEFAULT.position,
) -> State:
    """State with all that the drives' positions alone determine: rotation classes of the frame's group, driven slides.

    ``constants`` of the relations; ``near``: approximate angles "angle <group>" that select the turn where relations need it;
    ``tolerance``: residual at which Newton's method stops, in units of the mechanism's size.
    """
    program = model.program
    turned: dict[tuple[int, int], Plane] = {}
    delta: list[Plane] = [1 + 0j] * len(model.angles.class_group)
    for s, terms in program.driven_rotations:
        shorter = program.shorter[s]
        factors = [] if shorter < 0 else [delta[shorter]]
        for term in terms if shorter < 0 else terms[-1:]:
            if term not in turned:
                drive, sign = term
                turned[term] = rotation_of(drives[drive] if sign == 1 else sign * drives[drive])
            factors.append(turned[term])
        delta[s] = product(factors)
    rot: list[Any] = [None] * len(delta)
    for s in program.classes_of[0]:
        rot[s] = delta[s]
    slide = {j: drives[d] for j, d in program.driven_slides}
    return State(drives=drives, delta=delta, rot=rot, slide=slide, constants=constants, near=near or {}, tolerance=tolerance)


def value(total: VectorSum, rot: Sequence[Plane], slide: Mapping[int, Values]) -> Plane:
    """The value of a sum of vectors for rotations ``rot`` of the rotation classes and displacements ``slide`` along the guides."""
    constant, arms, slides = total
    terms = [a * rot[s] for s, a in arms]
    if slides:
        terms += [(d * rot[s]) * slide[j] for j, s, d in slides]
    return added(summed(terms), constant) if terms else constant


def relation_sum(
    model: Model, relation: int, state: State, block: Block | None = None
) -> tuple[Values, dict[tuple[str, int], float]]:
    """A relation's known terms [m], its constant subtracted, and the coefficients of the unknowns of ``block``."""
    t = model.constraints[relation]
    known: Values = -state.constants[relation] if state.constants else 0.0
    unknown: dict[tuple[str, int], float] = {}
    for d, c in t.drives:
        known = known + c * state.drives[d]
    for g, c in t.groups:
        if block is not None and g in block.angles:
            unknown["angle", g] = c
        else:
            known = known + c * real_angle(model, state, g)
    for j, c in t.slides:
        if block is not None and j in block.slides:
            unknown["slide", j] = c
        else:
            known = known + c * state.slide[j]
    if t.curve is not None:
        state.curve_values[relation] = values = t.curve.function(curve_argument(model, t.curve, state))
        known = known + values[0]
    return known, unknown


def curve_argument(model: Model, curve: NonlinearTerm, state: State) -> Values:
    """The argument of a relation's curve, which is known before the relation is solved."""

    def angle(group: int) -> Values:
        return state.angle[group] if group in state.angle else wrapped_angle(model, state, group)

    argument: Values = curve.argument(state.drives, angle, state.slide, curve.shift)
    return argument


def group_rotation(model: Model, state: State, group: int, at: Index | None = None) -> Plane:
    """A group's rotation, at the frames ``at`` or at all."""
    rotation_class = model.angles.classes_of[group][0]
    rot, delta = state.rot[rotation_class], state.delta[rotation_class]
    if at is not None:
        rot, delta = (x[at] if isinstance(x, np.ndarray) else x for x in (rot, delta))
    rotation: Plane = rot if isinstance(delta, complex) and delta == 1 else rot * delta.conjugate()
    return rotation


def wrapped_angle(model: Model, state: State, group: int) -> Values:
    """A group's angle within one turn."""
    e = group_rotation(model, state, group)
    angle: Values = np.arctan2(e.imag, e.real)
    return angle


def real_angle(model: Model, state: State, group: int) -> Values:
    """A group's angle beyond one turn [rad]; for a closed form, the approximate angle in ``state.near`` selects the turn."""
    if group not in state.angle:
        angle = wrapped_angle(model, state, group)
        near = state.near.get(f"angle {group}")
        if near is not None:
            angle = angle + 2.0 * np.pi * np.round((near - angle) / (2.0 * np.pi))
        state.angle[group] = angle
    return state.angle[group]
