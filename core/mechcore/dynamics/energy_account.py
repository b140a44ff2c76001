"""Where the energy goes: work of all forces along a simulated motion, by quadrature of their powers between its boundaries."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from mechcore.arrays import Real
from mechcore.dynamics.integration.collocation import integrals
from mechcore.effects.base import power_of
from mechcore.forces.kinetostatics import LOSSES, Forces
from mechcore.laws.timed import Free
from mechcore.motion.motion import Motion

NODES = 16
MOST = 20_000  # instants that are evaluated at once
_X, _W = legendre.leggauss(NODES)
_FIT = np.linalg.inv(legendre.legvander(_X, NODES - 1))


@dataclass(frozen=True, eq=False)
class WorkIntegrals:
    """Works (c,) since the start [J]: on panels between ``edges`` (p + 1,) [s] the powers are polynomials, ``coefficients``
    (p, NODES, c) in Legendre polynomials; ``before`` (p, c): works up to each panel. Where a ``period`` [s] is given, the powers
    of the last one repeat beyond the last edge."""

    edges: Real
    coefficients: Real
    before: Real
    period: float | None = None

    def __call__(self, t: Real) -> Real:
        """Works (n, c) until times (n,) [s]."""
        end = self.edges[-1]
        if self.period is None or not (t > end).any():
            return self._within(t)
        turns = np.maximum(np.ceil((t - end) / self.period), 0.0)
        gained = np.diff(self._within(np.array([end - self.period, end])), axis=0)
        return np.asarray(self._within(t - turns * self.period) + turns[:, None] * gained)

    def _within(self, t: Real) -> Real:
        k = np.clip(np.searchsorted(self.edges, t, side="left") - 1, 0, len(self.before) - 1)
        width = self.edges[k + 1] - self.edges[k]
        first, _ = integrals(NODES, np.clip((t - self.edges[k]) / width, 0.0, 1.0))
        return np.asarray(self.before[k] + width[:, None] * np.einsum("ns,nsc->nc", first, self.coefficients[k]))

    def followed_by(self, others: Sequence[WorkIntegrals]) -> WorkIntegrals:
        """These and those that go on where they end, in order."""
        if not others:
            return self
        parts = (self, *others)
        before, total = [], np.zeros(self.before.shape[1])
        for part in parts:
            before.append(total + part.before)
            total = total + part(part.edges[-1:])[0]
        edges = [self.edges, *(part.edges[1:] for part in others)]
        return WorkIntegrals(np.concatenate(edges), np.concatenate([p.coefficients for p in parts]), np.concatenate(before))


def work_integrals(powers: Callable[[Real], Real], edges: Real) -> WorkIntegrals:
    """Works of powers, ``powers(t)`` (n, c) [W] at times (n,); smooth between ``edges`` (p + 1,) [s]."""
    widths = np.diff(edges)
    x = (edges[:-1, None] + 0.5 * widths[:, None] * (_X + 1.0)).ravel()
    values = np.concatenate([powers(x[k : k + MOST]) for k in range(0, len(x), MOST)])
    values = values.reshape(len(widths), NODES, -1)
    gained = 0.5 * widths[:, None] * np.einsum("s,psc->pc", _W, values)
    before = np.concatenate([np.zeros((1, values.shape[2])), np.cumsum(gained, axis=0)[:-1]])
    return WorkIntegrals(edges, np.einsum("ij,pjc->pic", _FIT, values), before)


def powers_of(motion: Motion, forces: Forces) -> Real:
    """Power of all forces but inertia (n, 3) [W]: of those with a potential, of drives and process, of losses."""
    out = np.zeros((motion.frames, 3))
    for w in forces.applied:
        if w.kind != "inertia":
            column = 2 if w.cause in LOSSES else 0 if w.cause in ("gravity", "elastic") else 1
            out[:, column] += power_of(motion, w)
    for d in motion.mechanism.drives:
        if not isinstance(d.law, Free):
            out[:, 1] += forces.power(d.joint)
    if forces.friction is not None:
        out[:, 2] += forces.friction.power
    return out
