"""Impacts at an instant on all contacts that are touched then: Newton's law of restitution as a complementarity problem.

Gaps that open at the rates c before the impact open at c+ = c + W p after it, W = G M^-1 G' (G: rates of the gaps per unit rate of
each coordinate). Impulses p >= 0 and c+ >= e max(-c, 0) hold, and an impulse acts only where c+ has that least value (J. J. Moreau,
Unilateral contact and dry friction in finite freedom dynamics, 1988; F. Pfeiffer and C. Glocker, Multibody dynamics with unilateral
contacts, 1996). The order in which contacts are listed has no say.
"""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.dynamics.equations.reduced import free_of, motion_at
from mechcore.dynamics.events import Log
from mechcore.effects.masses import kinetic_energy
from mechcore.motion.compiled import Compiled

ROUNDING = 1e-12  # of the largest rate, of the work of an impact: what is left by rounding
DEPENDENT = 1e-11  # smallest eigenvalue of W with a unit diagonal, below which contacts depend on each other
PIVOTS = 20  # for each contact, at most


def impact(mobility: Real, rates: Real, restitution: Real, flat: Flags) -> tuple[Real, float] | None:
    """Impulses (c,) of an impact and the energy that is lost [J]; ``mobility`` W (c, c), ``rates`` (c,) at which the gaps open
    before it, a coefficient of ``restitution`` for each contact (c,).

    Contacts that are ``flat`` (c,) are closed after it, whatever impulse that takes. Where contacts are coupled, coefficients that
    differ may add energy (C. Glocker, Energetic consistency conditions for standard impacts, 2013), and more contacts than freedoms
    may not all leave with theirs: then the smallest of those that are struck holds for all, or else 0. None where no impulses turn
    all contacts back.
    """
    struck = (rates < 0.0) & ~flat
    smallest = np.minimum(restitution, restitution[struck].min(initial=1.0))
    for e in (restitution, smallest, np.zeros(len(rates))):
        found = _impulses(mobility, rates, e * np.maximum(-rates, 0.0), flat)
        if found is not None:
            lost = -0.5 * float(found @ (2.0 * rates + mobility @ found))
            if lost >= -ROUNDING * float(np.abs(found) @ np.abs(rates)) or not e.any():
                return found, lost
    return None


def _impulses(mobility: Real, rates: Real, least: Real, flat: Flags) -> Real | None:
    """Impulses (c,) after which gaps open at the rates ``least`` (c,) or more, and those that are flat not at all."""
    loose = ~flat
    closing = -np.linalg.pinv(mobility[np.ix_(flat, flat)], rcond=DEPENDENT, hermitian=True)
    reduced = mobility[np.ix_(loose, loose)] + mobility[np.ix_(loose, flat)] @ closing @ mobility[np.ix_(flat, loose)]
    free = rates[loose] + mobility[np.ix_(loose, flat)] @ closing @ rates[flat] - least[loose]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(reduced), 1e-300))
    found = complementary(scale[:, None] * reduced * scale, scale * free)
    if found is None:
        return None
    out = np.zeros(len(rates))
    out[loose] = scale * found
    out[flat] = closing @ (rates[flat] + mobility[np.ix_(flat, loose)] @ out[loose])
    return out


def complementary(matrix: Real, free: Real) -> Real | None:
    """Solution p (n,) of the linear complementarity problem p >= 0, w = matrix p + free >= 0, p'w = 0; None where there is none.

    ``matrix`` (n, n) symmetric, positive semidefinite, with a unit diagonal. An active set grows by what is violated most and
    loses what would have to pull (C. L. Lawson and R. J. Hanson, Solving least squares problems, 1974, chapter 23).
    """
    p, active = np.zeros(len(free)), np.zeros(len(free), bool)
    least = ROUNDING * float(np.abs(free).max(initial=0.0))
    for _ in range(PIVOTS * len(free) + 1):
        missing = np.where(active, np.inf, matrix @ p + free)
        if not missing.min(initial=np.inf) < -least:
            return p
        active[np.argmin(missing)] = True
        while active.any():
            values, vectors = np.linalg.eigh(matrix[np.ix_(active, active)])
            if values[0] > DEPENDENT:
                step = vectors @ ((vectors.T @ -free[active]) / values) - p[active]
                most = 1.0
            else:  # along a null vector pushes only change places: until one of them is nothing
                step = vectors[:, 0] * (-1.0 if float(free[active] @ vectors[:, 0]) > 0.0 else 1.0)
                most = np.inf
            falls = step < 0.0
            share = np.where(falls, p[active] / np.where(falls, -step, 1.0), np.inf)
            reach = min(most, float(share.min()))
            if not np.isfinite(reach):
                return None
            p[active] += reach * step
            if reach == 1.0 and most == 1.0 and not (share <= 1.0).any():
                break
            p[np.flatnonzero(active)[share <= reach]] = 0.0
            active[np.flatnonzero(active)[share <= reach]] = False
    return None


def account_for_impact(log: Log, compiled: Compiled, t: float, q: Real, before: Real, after: Real, lost: float) -> None:
    """Account for the energy that an impact takes [J], and for the work of prescribed drives, which it does not slow."""
    log.lose(t, lost)
    if len(free_of(compiled)) < len(compiled.mechanism.drives):
        motion = motion_at(compiled, np.array([q, q]), np.array([before, after]), np.array([t, t]))
        log.push(t, float(np.diff(kinetic_energy(motion))[0]) + lost)
