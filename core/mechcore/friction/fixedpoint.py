"""Normal loads under Coulomb friction: ``g = |a + K g|`` for all frames at once.

Reactions are linear in the friction, friction is proportional to the size of reactions. With ``g`` (n,) the normal loads of the n
braked motions, each is the norm of two numbers ``a_i + K_i g``. A norm is convex and grows in proportion, hence:

- where the matrix of the norms of ``K`` has a spectral radius below one the map contracts: there is one solution, and it is
  found by Newton's method, fixed-point steps where that does not come closer;
- elsewhere the solution is followed from the frictionless one by raising all coefficients in the same proportion. Where the
  branch runs to infinity or turns back before the full coefficients, no drive effort moves the mechanism: it jams.
  ``det(I - D K)`` (D: the norms' gradients) is one without friction and positive all along the branch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Solution", "solve_normal_loads"]

Array = Any
Real = NDArray[np.float64]
Flags = NDArray[np.bool_]

TOLERANCE = 1e-13  # of the largest normal load of the frame
LARGEST = 1e13  # times the frictionless loads: beyond any machine, the branch runs to infinity
SHORTEST = 1e-13  # step of the coefficients' proportion at which a branch ends
CLOSE = 0.9  # part of the proportion up to which the map contracts


@dataclass(frozen=True, eq=False)
class Solution:
    """``loads`` (F, n), NaN where ``jammed`` (F,); ``reached`` (F,): proportion of the coefficients that can still be moved.

    ``stability`` (F,): det(I - D K), 1 without friction, 0 at a jam. ``share`` (F, n): how far each braked motion takes part in the
    jam, the largest 1; zero elsewhere. ``residual`` (F,): error of the equations, relative. ``iterations``: most of any frame.
    """

    loads: Real
    jammed: Flags
    reached: Real
    stability: Real
    share: Real
    residual: Real
    iterations: int


def solve_normal_loads(a: Real, k: Real, euclidean: Flags) -> Solution:
    """Solve ``g = |a + K g|``: ``a`` (F, n, 2), ``k`` (F, n, 2, n); ``euclidean`` (n,): length of two numbers, else the larger one.

    Frames with numbers that are not finite stay NaN and do not count as jammed.
    """
    frames, n = a.shape[:2]
    loads = np.full((frames, n), np.nan)
    reached, stability, residual = np.ones(frames), np.full(frames, np.nan), np.full(frames, np.nan)
    share = np.zeros((frames, n))
    jammed = np.zeros(frames, bool)
    sound = np.isfinite(a).all(axis=(1, 2)) & np.isfinite(k).all(axis=(1, 2, 3))
    rows = np.flatnonzero(sound)
    radius = spectral_radius(_sizes(k[rows], euclidean))
    calm, rest = rows[radius < 1.0], rows[radius >= 1.0]
    steps = 0
    if len(calm):
        loads[calm], residual[calm], steps = _newton(a[calm], k[calm], euclidean, None)
    if len(rest):
        found = _follow(a[rest], k[rest], euclidean, radius[radius >= 1.0])
        loads[rest], reached[rest], share[rest], residual[rest] = found
        jammed[rest] = reached[rest] < 1.0
    good = np.flatnonzero(np.isfinite(loads).all(axis=1))
    stability[good] = np.linalg.det(_jacobian(a[good], k[good], euclidean, loads[good])[1])
    return Solution(loads, jammed, reached, stability, share, residual, steps)


def spectral_radius(m: Real) -> Real:
    """Upper bounds (F,) of the spectral radii of nonnegative matrices (F, n, n), good to a few per cent."""
    scale = m.sum(axis=-1).max(axis=-1, initial=0.0)
    power = m / np.where(scale > 0.0, scale, 1.0)[:, None, None]
    logarithm = np.zeros(len(m))
    exponent = 1.0
    for _ in range(6):  # the 64th power
        power = power @ power
        size = power.sum(axis=-1).max(axis=-1, initial=0.0)
        safe = np.where(size > 0.0, size, 1.0)
        power = power / safe[:, None, None]
        exponent *= 2.0
        logarithm = logarithm + np.where(size > 0.0, np.log(safe), -np.inf) / exponent
    return np.asarray(scale * np.exp(logarithm))


def _sizes(k: Real, euclidean: Flags) -> Real:
    """Norms (F, n, n) of the two numbers that each load adds to each other one."""
    larger = np.maximum(np.abs(k[:, :, 0]), np.abs(k[:, :, 1]))
    return np.asarray(np.where(euclidean[:, None], np.hypot(k[:, :, 0], k[:, :, 1]), larger), float)


def _norm(y: Real, euclidean: Flags) -> tuple[Real, Real]:
    """Norms (F, n) of y (F, n, 2) and their gradients; where y is zero the gradient is taken as zero."""
    p, q = y[..., 0], y[..., 1]
    length = np.hypot(p, q)
    first = np.abs(p) >= np.abs(q)
    g = np.where(euclidean, length, np.where(first, np.abs(p), np.abs(q)))
    safe = np.where(length > 0.0, length, 1.0)
    d = np.empty_like(y)
    d[..., 0] = np.where(euclidean, p / safe, np.where(first, np.sign(p), 0.0))
    d[..., 1] = np.where(euclidean, q / safe, np.where(first, 0.0, np.sign(q)))
    return g, d


def _jacobian(a: Real, k: Real, euclidean: Flags, g: Real) -> tuple[Real, Real]:
    """Residual g - |a + K g| (F, n) and its derivative I - D K (F, n, n)."""
    y = a + np.einsum("fiaj,fj->fia", k, g)
    size, d = _norm(y, euclidean)
    return np.asarray(g - size), np.asarray(np.eye(g.shape[1]) - np.einsum("fia,fiaj->fij", d, k), float)


def _solve(matrix: Real, rhs: Real) -> Real:
    try:
        return np.asarray(np.linalg.solve(matrix, rhs[..., None])[..., 0])
    except np.linalg.LinAlgError:
        return np.asarray((np.linalg.pinv(matrix) @ rhs[..., None])[..., 0])


def _newton(a: Real, k: Real, euclidean: Flags, start: Real | None, most: int = 200) -> tuple[Real, Real, int]:
    """Loads (F, n), relative residuals (F,) and the number of steps, from ``start`` or from the frictionless loads.

    A step that does not come closer is replaced by a fixed-point step. Only frames that are not there yet go on.
    """
    g = _norm(a, euclidean)[0] if start is None else start.copy()
    residual = np.full(len(g), np.inf)
    active = np.arange(len(g))
    steps = 0
    f, matrix = _jacobian(a, k, euclidean, g)
    miss = np.abs(f).max(axis=1)
    while steps < most:
        steps += 1
        size = np.maximum(np.abs(g[active]).max(axis=1), 1e-300)
        residual[active] = miss / size
        going = residual[active] > TOLERANCE
        if not going.any():
            break
        active, f, matrix, miss = active[going], f[going], matrix[going], miss[going]
        here, ka, aa = g[active], k[active], a[active]
        step = here - _solve(matrix, f)
        f_new, matrix_new = _jacobian(aa, ka, euclidean, step)
        miss_new = np.abs(f_new).max(axis=1)
        worse = ~(miss_new < 0.7 * miss)
        stuck = worse & (miss <= 1e-11 * np.abs(here).max(axis=1))  # rounding: this is as close as it gets
        if worse.any():
            again = worse & ~stuck
            step[again] = (here - f)[again]
            step[stuck] = here[stuck]
            f_new[worse], matrix_new[worse] = _jacobian(aa[worse], ka[worse], euclidean, step[worse])
            miss_new[worse] = np.abs(f_new[worse]).max(axis=1)
        g[active] = step
        keep = ~stuck
        active, f, matrix, miss = active[keep], f_new[keep], matrix_new[keep], miss_new[keep]
        if not len(active):
            break
    return g, residual, steps


def _follow(a: Real, k: Real, euclidean: Flags, radius: Real) -> tuple[Real, Real, Real, Real]:
    """Loads (F, n), proportion reached (F,), share in the jam (F, n), residuals (F,): the branch from the frictionless loads.

    The proportion p of the coefficients goes from 0 to 1; up to ``CLOSE / radius`` the map contracts.
    """
    n = a.shape[1]
    p = np.minimum(CLOSE / radius, 1.0)
    g, residual, _ = _newton(a, k * p[:, None, None, None], euclidean, None)
    first = np.maximum(_norm(a, euclidean)[0].max(axis=1), 1e-300)
    step = 0.1 * p
    share = np.zeros_like(g)
    active = np.flatnonzero((p < 1.0) & (np.abs(a).max(axis=(1, 2)) > 0.0))
    p[np.abs(a).max(axis=(1, 2)) == 0.0] = 1.0  # nothing loads it
    for _ in range(2000):
        if not len(active):
            break
        aa, ka, here, at = a[active], k[active], g[active], p[active]
        _, matrix = _jacobian(aa, ka * at[:, None, None, None], euclidean, here)
        y = aa + at[:, None, None] * np.einsum("fiaj,fj->fia", ka, here)
        slope = _solve(matrix, np.einsum("fia,fiaj,fj->fi", _norm(y, euclidean)[1], ka, here))
        # no load grows by more than half of the largest one in one step
        most = 0.5 * np.abs(here).max(axis=1) / np.maximum(np.abs(slope).max(axis=1), 1e-300)
        h = np.minimum(np.minimum(step[active], most), 1.0 - at)
        to = np.where(h >= 1.0 - at, 1.0, at + h)
        guess = here + (to - at)[:, None] * slope
        new, ok = _correct(aa, ka * to[:, None, None, None], euclidean, guess)
        away = np.abs(new - guess).max(axis=1) > 0.25 * np.abs(here).max(axis=1)
        ok &= ~away
        done = active[ok]
        g[done], p[done] = new[ok], to[ok]
        step[done] = 2.0 * h[ok]
        step[active[~ok]] = 0.25 * h[~ok]
        ended = (h < SHORTEST) & ~ok | (np.abs(g[active]).max(axis=1) > LARGEST * first[active])
        for_good = active[ended]
        if len(for_good):
            share[for_good] = _share(a[for_good], k[for_good] * p[for_good][:, None, None, None], euclidean, g[for_good])
        active = active[~ended & (p[active] < 1.0)]
    p[active] = np.minimum(p[active], 1.0 - SHORTEST)  # never settled: it counts as the end of the branch
    p[share.any(axis=1)] = np.minimum(p[share.any(axis=1)], 1.0 - SHORTEST)
    jammed = p < 1.0
    if not jammed.all():
        g[~jammed], residual[~jammed], _ = _newton(a[~jammed], k[~jammed], euclidean, g[~jammed], most=8)
    g[jammed] = np.nan
    residual[jammed] = np.nan
    return g, p, share.reshape(-1, n), residual


def _correct(a: Real, k: Real, euclidean: Flags, g: Real) -> tuple[Real, Flags]:
    """Plain Newton from a prediction, and where it arrives at loads on the same branch."""
    with np.errstate(all="ignore"):
        for _ in range(8):
            f, matrix = _jacobian(a, k, euclidean, g)
            bad = ~np.isfinite(matrix).all(axis=(1, 2))
            matrix[bad], f[bad] = np.eye(g.shape[1]), np.nan
            g = g - _solve(matrix, f)
        f, matrix = _jacobian(a, k, euclidean, g)
        ok = np.abs(f).max(axis=1) <= 1e-10 * np.abs(g).max(axis=1)
        ok &= (g >= -1e-9 * np.abs(g).max(axis=1, keepdims=True)).all(axis=1)
        matrix[~np.isfinite(matrix).all(axis=(1, 2))] = 0.0
        return g, ok & (np.linalg.det(matrix) > 0.0)


def _share(a: Real, k: Real, euclidean: Flags, g: Real) -> Real:
    """How strongly each column of K moves the smallest eigenvalue of I - D K: the pairs whose friction makes the jam (F, n)."""
    _, matrix = _jacobian(a, k, euclidean, g)
    u, _, vt = np.linalg.svd(matrix)
    left, right = u[:, :, -1], vt[:, -1]
    effect = np.abs(np.einsum("fi,fij->fj", left, np.eye(g.shape[1]) - matrix) * right)
    return np.asarray(effect / np.maximum(effect.max(axis=1, keepdims=True), 1e-300))
