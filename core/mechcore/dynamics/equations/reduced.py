"""Reduction of a mechanism's masses and forces to its free coordinates, for many positions at once.

With the free coordinates q as if they were drives, every velocity is linear in q': v = sum_i v_i q_i'. Hence the reduced inertia
M_ij = sum m v_i v_j + J w_i w_j, the reduced force Q_i = sum F v_i + M w_i of all loads (virtual power), and the inertia forces at
q'' = 0, h_i = sum m v_i a_S + J w_i alpha; the equations of motion are M q'' + h = Q (theory of the reduced mass, Lagrange's
equations of the second kind). Positions are solved on the configuration manifold itself: there is no drift, and redundant
constraints do no harm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mechcore.arrays import Flags, Real, Values
from mechcore.effects.base import Effect, power_of, rate
from mechcore.effects.registry import applied_effects, effects_of
from mechcore.kinematics.state import Interpolant
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.motion.solve import solve_motion
from mechcore.records import dataclass
from mechcore.spec.mechanism import Planar, Prismatic, Revolute, coordinates_of

DIFFERENCE_STEP = 1e-7  # of a finite difference, relative; slopes only steer Newton's method


@dataclass(frozen=True, eq=False)
class ReducedEquations:
    """``inertia`` (n, f, f), ``bias`` h (n, f) and ``force`` Q (n, f): M q'' + h = Q."""

    inertia: Real
    bias: Real
    force: Real

    def acceleration(self) -> Real:
        """q'' (n, f)."""
        rhs = self.force - self.bias
        if rhs.shape[1] == 1:
            return np.asarray(rhs / self.inertia[:, :, 0])
        return solve_frames(self.inertia, rhs)


def solve_frames(matrix: Real, rhs: Real) -> Real:
    """x (n, f) of matrix x = rhs, (n, f, f) and (n, f); not a number at frames where the matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, rhs[..., None])[..., 0], float)
    except np.linalg.LinAlgError:
        fine: Flags = np.asarray(np.isfinite(matrix).all(axis=(1, 2)))
        fine[fine] = np.linalg.det(matrix[fine]) != 0.0
        out = np.full(rhs.shape, np.nan)
        out[fine] = np.linalg.solve(matrix[fine], rhs[fine, :, None])[..., 0]
        return out


def constrained(inertia: Real, force: Real, jacobian: Real, second: Real | None = None) -> tuple[Real, Real]:
    """Accelerations a (n, ..., f) under generalised forces Q (n, ..., f), and the constraint forces p (n, ..., c).

    M a = Q + G' p and G a + b = 0, ``jacobian`` G (n, c, f), ``second`` b (n, c) or none; not a number where that is singular.
    """
    c, f = jacobian.shape[1:]
    if c:
        g = jacobian.reshape(len(jacobian), *[1] * (force.ndim - 2), c, f)
        full = np.zeros((*np.broadcast_shapes(inertia.shape[:-2], g.shape[:-2]), f + c, f + c))
        full[..., :f, :f], full[..., :f, f:], full[..., f:, :f] = inertia, -g.swapaxes(-1, -2), g
        right = np.zeros((*force.shape[:-1], c)) if second is None else -second
        inertia, force = full, np.concatenate([force, right], axis=-1)
    try:
        unknowns = np.asarray(np.linalg.solve(inertia, force[..., None])[..., 0], float)
    except np.linalg.LinAlgError:  # some frames are singular: solve frame by frame
        each = np.broadcast_to(inertia, (*force.shape, force.shape[-1]))
        unknowns = solve_frames(each.reshape(-1, *each.shape[-2:]), force.reshape(-1, force.shape[-1])).reshape(force.shape)
    if c == f:  # everything is held where nothing moves: rounding would have a direction
        unknowns[..., :f] *= (
            0.0 if second is None else second.reshape(len(second), *[1] * (force.ndim - 2), c).any(axis=-1, keepdims=True)
        )
    return unknowns[..., :f], unknowns[..., f:]


def free_of(compiled: Compiled | Motion) -> list[int]:
    """The drives that are free coordinates; the others follow their laws in time."""
    return [i for i, d in enumerate(compiled.mechanism.drives) if isinstance(d.law, Free)]


def coordinate_scales(compiled: Compiled) -> Real:
    """Scale of a large displacement of each free coordinate (f,): 1 rad, or the length scale of the mechanism [m]."""
    drives = compiled.mechanism.drives
    return np.array([compiled.model.coordinate_scale(drives[i].joint) for i in free_of(compiled)])


def steps_of_differences(compiled: Compiled, q: Real, v: Real, a: Real) -> tuple[Real, Real]:
    """Steps (f,) of coordinates and of rates for finite differences at nodes (n, f), with accelerations (n, f).

    They are relative to the scale of each coordinate and, for rates, to the time in which the motion covers it, so that units do
    not matter. States of effects that integrate have no known scale and count as coordinates of scale 1.
    """
    scales = compiled.cached(coordinate_scales)
    f, (position, speed, change) = len(scales), (np.maximum.reduce(np.abs(x)) for x in (q, v, a))
    pace = max(float((speed[:f] / scales).max()), float(np.sqrt((change[:f] / scales).max()))) or 1.0
    if q.shape[1] > f:
        scales = np.append(scales, np.ones(q.shape[1] - f))
    return DIFFERENCE_STEP * np.maximum(scales, position), DIFFERENCE_STEP * np.maximum(pace * scales, speed)


def forms_of(motion: Motion) -> list[Values]:
    """Whole numbers (n,) for the forms of the laws that effects and cams follow, see `Effect.phase`: where one changes, some
    derivative of a force may jump."""
    cams = [r.geometry for r in motion.model.relations if r.kind == "cam"]
    return [*(e.phase(motion) for e in effects_of(motion.mechanism) if e.piecewise), *(c.segment(motion) for c in cams)]


def motion_at(compiled: Compiled, q: Real, v: Real, t: Real, a: Real | None = None) -> Motion:
    """The mechanism at free coordinates (n, f) with rates (n, f), second rates (n, f) or none, at times (n,).

    Drives that are prescribed follow their laws. Rates that come after those of the coordinates are the states of effects that
    integrate, zero where there are none.
    """
    none = np.zeros(len(t))
    drives, k = {}, 0
    for d in compiled.mechanism.drives:
        if isinstance(d.law, Free):
            drives[d.joint] = (q[:, k], v[:, k], none if a is None else a[:, k])
            k += 1
        else:
            drives[d.joint] = d.law(t)
    motion = solve_motion(compiled, t, drives=drives, strict=False)
    for i, effect in enumerate(integrating(compiled), start=k):
        motion.states[effect.name] = v[:, i] if i < v.shape[1] else none
    return motion


def integrating(compiled: Compiled) -> list[Effect]:
    """The effects that integrate over time, in the order of their states, see `with_states`."""
    return [e for e in compiled.model.cached(applied_effects) if e.integrates]


def with_states(acceleration: Real, motion: Motion) -> Real:
    """Accelerations (n, f), and after them the rates of the states of effects that integrate (n, f + s).

    Among coordinates, rates and accelerations a state is a rate: its integrand is the acceleration, and its coordinate is the
    integral of the state, on which nothing depends.
    """
    rates = [e.state_rate(motion) * np.ones(motion.frames) for e in motion.model.cached(applied_effects) if e.integrates]
    return np.column_stack([acceleration, *rates]) if rates else acceleration


def shifted(v: Real, change: Real) -> Real:
    """Rates (f + s,) with a ``change`` of the coordinates' rates (f,); states stay."""
    return v + np.append(change, np.zeros(len(v) - len(change)))


def with_rates(motion: Motion, rates: Sequence[Real], second: Sequence[Real] | None = None) -> Motion:
    """The same positions with other rates (n,) of all drives, and second rates or none; only velocities are solved anew."""
    none = np.zeros(motion.frames)
    second = [none] * len(rates) if second is None else second
    drives = [(d[0], r, a) for d, r, a in zip(motion.drives, rates, second, strict=True)]
    interpolants = motion.interpolants and _scaled(motion, rates)
    m = Motion(motion.model, motion.time, drives, motion.state, motion.angles, interpolants, accuracy=motion.accuracy)
    m.loop_vectors, m.columns, m.origins, m.states = motion.loop_vectors, motion.columns, motion.origins, motion.states
    return m


def _scaled(motion: Motion, rates: Sequence[Real]) -> dict[int, list[Interpolant]]:
    """Patches at change points, made for a unit rate, at another rate (one freedom only: with more there are none)."""
    return {
        block: [
            replace(p, first=p.first * rates[0][p.frames, None], second=p.second * rates[0][p.frames, None] ** 2)
            for p in interpolants
        ]
        for block, interpolants in (motion.interpolants or {}).items()
    }


def tangents(motion: Motion, free: Sequence[int]) -> list[Motion]:
    """For each free coordinate, a motion at the same positions with its unit rate; all other coordinates stand still."""
    one, none = np.ones(motion.frames), np.zeros(motion.frames)
    return [with_rates(motion, [one if k == i else none for k in range(len(motion.drives))]) for i in free]


def moving(compiled: Compiled, q: Real, v: Real, t: Real) -> tuple[Motion, list[Motion]]:
    """The motion with q'' = 0, and its `tangents`."""
    free = free_of(compiled)
    if len(free) == len(compiled.mechanism.drives) == 1:  # at change points: interpolated at a unit rate, then scaled
        unit = motion_at(compiled, q, np.column_stack([np.ones(len(v)), v[:, 1:]]), t)
        return with_rates(unit, [v[:, 0]]), [unit]
    motion = motion_at(compiled, q, v, t)
    return motion, tangents(motion, free)


def reduce(compiled: Compiled, q: Real, v: Real, t: Real) -> ReducedEquations:
    """Reduced equations of motion at free coordinates (n, f), rates (n, f), times (n,)."""
    motion, units = moving(compiled, q, v, t)
    return reduced_equations(motion, units)


def reduced_equations(motion: Motion, units: Sequence[Motion]) -> ReducedEquations:
    """Reduced equations of motion from the motion with q'' = 0 and its tangents."""
    f, n = len(units), motion.frames
    terms = reduced_terms(motion, units)
    inertia, bias, force = np.empty((n, f, f)), np.empty((n, f)), np.empty((n, f))
    for i in range(f):
        bias[:, i], force[:, i] = terms[1][i], terms[2][i]
        for j in range(i + 1):
            inertia[:, i, j] = inertia[:, j, i] = terms[0][i][j]
    return ReducedEquations(inertia, bias, force)


def rates_of_joints(compiled: Compiled, units: Sequence[Motion]) -> tuple[list[str], list[list[Values]]]:
    """Joints whose coordinates could be free ones, and their rates per unit rate of each free coordinate, relative to the scales of
    both; ``units``: the tangents."""
    mechanism, model = compiled.mechanism, compiled.model
    prescribed = {d.joint for d in mechanism.drives if not isinstance(d.law, Free)}
    movable = [p for p in mechanism.joints if isinstance(p, Revolute | Prismatic | Planar)]
    names = [name for p in movable for name in coordinates_of(p) if name not in prescribed]
    names = [name for name in names if model.joints[model.joint_index[name]].freedoms]
    leading = [mechanism.drives[i].joint for i in free_of(compiled)]  # screws and cylinders lead only where they are stated to
    names += [name for name in leading if name not in names]
    scales = [model.coordinate_scale(name) for name in leading]
    rows = [[rate(u, k) * (f / model.coordinate_scale(k)) for u, f in zip(units, scales, strict=True)] for k in names]
    return names, rows


def reduced_terms(motion: Motion, units: Sequence[Motion]) -> tuple[list[list[Values]], list[Values], list[Values]]:
    """Rows of the lower triangle of M, and h and Q, term by term over the frames, as in `ReducedEquations`."""
    model, f = motion.model, len(units)
    inertia: list[list[Values]] = [[0.0] * (i + 1) for i in range(f)]
    bias: list[Values] = [0.0] * f
    for k in range(1, len(model.links)):
        mass, centre, moment = model.masses[k]
        if not (mass or moment):
            continue
        rotation_class = model.angles.rotation_class[k]
        speeds = [u.of_point(k, centre, 1) for u in units]
        turning = [u.speeds.angular[rotation_class] for u in units]
        a, alpha = motion.of_point(k, centre, 2), motion.accelerations.angular[rotation_class]
        for i in range(f):
            bias[i] = bias[i] + mass * np.real(np.conj(speeds[i]) * a) + moment * turning[i] * alpha
            for j in range(i + 1):
                work = mass * np.real(np.conj(speeds[i]) * speeds[j]) + moment * turning[i] * turning[j]
                inertia[i][j] = inertia[i][j] + work
    force: list[Values] = [0.0] * f
    for effect in effects_of(model.mechanism):
        if "accelerations" not in effect.needs and "reactions" not in effect.needs:
            for w in effect.wrenches(motion):
                for i, unit in enumerate(units):
                    force[i] = force[i] + power_of(unit, w)
    return inertia, bias, force
