"""Normal loads under Coulomb friction: ``g = |a + K g|`` for all frames at once.

Reactions are linear in the friction, and friction is proportional to the magnitude of reactions. With ``g`` (n,) the normal loads
of the n braked motions, each is the norm of two numbers ``a_i + K_i g``. A norm is convex and homogeneous, hence:

- where the matrix of the norms of ``K`` has a spectral radius below one the map contracts: there is one solution, and it is
  found by Newton's method, with fixed-point steps where that does not reduce the residual;
- elsewhere the solution is continued from the frictionless one by raising all coefficients in the same proportion. Where the
  branch runs to infinity or turns back before the full coefficients, no drive effort moves the mechanism: it jams.
  ``det(I - D K)`` (D: the norms' gradients) is one without friction and positive all along the branch.
"""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.records import dataclass

# Residual, relative to the terms of its equation: a joint that carries a billionth of another's load counts as much
RESIDUAL_TOLERANCE = 1e-13
SETTLED_RESIDUAL = 1e-11  # the same: the limit of Newton's method by rounding
SHORTEST_STEP = 1e-13  # step of the coefficients' proportion at which a branch ends
START_COUNT = 24  # starts from which other solutions are searched for
AT_ONCE = 60_000  # frames times couplings that are solved together, small enough for the processor's cache
BOUND_VECTORS = 8  # vectors that are tried for the simple bound
OFF_BRANCH = 0.05  # part of the equation's terms or the largest load: a prediction with a larger error may have left the branch
BEYOND_BRANCH = 1e-6  # part of the coefficients: gradients are taken so far past the end of a branch, where a norm may have a kink
MOST_STEPS = 2000  # along a branch: some fifty suffice
CONTRACTION_PART = 0.9  # part used of the proportion up to which the map contracts


@dataclass(frozen=True, eq=False)
class NormalLoads:
    """``loads`` (F, n), NaN where ``jammed`` (F,); ``reached`` (F,): proportion of the coefficients with which the mechanism can
    still be moved.

    ``share`` (F, n): share of each braked motion in the jam, the largest 1; zero elsewhere. ``residual`` (F,): residual of the
    equations, each relative to its own terms. ``iterations``: most of any frame.
    """

    loads: Real
    jammed: Flags
    movable_share: Real
    share: Real
    residual: Real
    iterations: int


def solve_normal_loads(a: Real, k: Real, euclidean: Flags, tolerance: float = RESIDUAL_TOLERANCE) -> NormalLoads:
    """Solve ``g = |a + K g|``: ``a`` (F, n, 2), ``k`` (F, n, 2, n); ``euclidean`` (n,): length of two numbers, else the larger one.

    Frames with numbers that are not finite stay NaN and do not count as jammed. ``tolerance``: of a residual relative to the terms
    of its equation.
    """
    frames, n = a.shape[:2]
    at_once = max(64, AT_ONCE // (n * n))
    if frames > at_once:
        cuts = range(0, frames, at_once)
        parts = [solve_normal_loads(a[c : c + at_once], k[c : c + at_once], euclidean, tolerance) for c in cuts]
        whole = {
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in NormalLoads.__annotations__
            if name != "iterations"
        }
        return NormalLoads(**whole, iterations=max(part.iterations for part in parts))
    size = _sizes(k, euclidean)
    bound = _simple_bound(size)  # suffices for most mechanisms
    if (bound < 1.0).all() and np.isfinite(a).all():  # NaN is not below one
        loads, residual, steps = _contract(a, k, euclidean, bound, dominant=True, tolerance=tolerance)
        return NormalLoads(loads, np.zeros(frames, bool), np.ones(frames), np.zeros((frames, n)), residual, steps)
    loads = np.full((frames, n), np.nan)
    reached, residual = np.ones(frames), np.full(frames, np.nan)
    share = np.zeros((frames, n))
    jammed = np.zeros(frames, bool)
    finite = np.isfinite(a).all(axis=(1, 2)) & np.isfinite(bound)
    easy = np.flatnonzero(finite & (bound < 1.0))
    hard = np.flatnonzero(finite & (bound >= 1.0))
    radius = spectral_radius(size[hard])
    calm, rest = hard[radius < 1.0], hard[radius >= 1.0]
    steps = 0
    for some, below, dominant in ((easy, bound[easy], True), (calm, radius[radius < 1.0], False)):
        if len(some):
            contracted = _contract(a[some], k[some], euclidean, below, dominant=dominant, tolerance=tolerance)
            loads[some], residual[some] = contracted[:2]
            steps = max(steps, contracted[2])
    if len(rest):
        loads[rest], reached[rest], share[rest], residual[rest] = _follow(a[rest], k[rest], euclidean, radius[radius >= 1.0])
        jammed[rest] = reached[rest] < 1.0
    return NormalLoads(loads, jammed, reached, share, residual, steps)


def _contract(a: Real, k: Real, euclidean: Flags, radius: Real, *, dominant: bool, tolerance: float) -> tuple[Real, Real, int]:
    """Loads (F, n), residuals (F,) and the number of steps where the map contracts, at most by ``radius`` (F,) below one.

    Just below a jam the loads are many times the frictionless ones: Newton's method started from these fails, and fixed-point steps
    converge slowly. Such frames are continued from smaller coefficients, as in `_follow`.
    """
    loads, residual, steps = _newton(a, k, euclidean, None, dominant=dominant, tolerance=tolerance)
    slow = np.flatnonzero(residual > max(SETTLED_RESIDUAL, tolerance))
    if len(slow):
        new, _, _, left = _follow(a[slow], k[slow], euclidean, radius[slow])
        nearer = left < residual[slow]
        loads[slow[nearer]], residual[slow[nearer]] = new[nearer], left[nearer]
    return loads, residual, steps


def stability(a: Real, k: Real, euclidean: Flags, loads: Real) -> Real:
    """det(I - D K) (F,) at solved loads: 1 without friction, 0 at a jam, NaN where there are no loads."""
    out = np.full(len(a), np.nan)
    good = np.flatnonzero(np.isfinite(loads).all(axis=1))
    out[good] = np.linalg.det(jacobian(a[good], k[good], euclidean, loads[good])[1])
    return out


def has_several_solutions(a: Real, k: Real, euclidean: Flags, loads: Real) -> Flags:
    """Frames (F,) in which other loads than the given ones are in equilibrium too, searched for from many starts.

    Where the map contracts there are none; elsewhere two states can be possible, as they are for a rod that is pushed over a rough
    floor (Painleve).
    """
    many = np.zeros(len(a), bool)
    rows = np.flatnonzero(np.isfinite(loads).all(axis=1) & (loads.max(axis=1, initial=0.0) > 0.0))
    rows = rows[spectral_radius(_sizes(k[rows], euclidean)) >= 1.0]
    if not len(rows):
        return many
    aa, kk, own = a[rows], k[rows], loads[rows]
    largest = own.max(axis=1, keepdims=True)
    rng = np.random.default_rng(5)
    for _ in range(START_COUNT):
        start = largest * np.exp(rng.uniform(-2.0, 4.0)) * rng.uniform(0.0, 1.0, own.shape)
        new, ok, _ = _arrive(aa, kk, euclidean, start)
        many[rows] |= ok & (np.abs(new - own).max(axis=1) > 1e-6 * np.maximum(largest[:, 0], np.abs(new).max(axis=1)))
    return many


def _simple_bound(m: Real) -> Real:
    """Bounds (F,) of the spectral radii of nonnegative matrices (F, n, n): the largest of (M x) / x for any x > 0 (Collatz).

    With columns scaled by such an x for which it is below one, I - M is dominated by its diagonal.
    """
    x = np.ones(m.shape[:2])
    bound = np.full(len(m), np.inf)
    for _ in range(BOUND_VECTORS):
        y = np.einsum("fij,fj->fi", m, x)
        bound = np.minimum(bound, (y / x).max(axis=1))
        if (bound < 1.0).all() or not np.isfinite(bound).any():
            break
        x = y / np.maximum(y.max(axis=1, keepdims=True), 1e-300) + 1e-2
    return bound


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
    """Norms (F, n, n) of the two numbers that each load contributes to each other one."""
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


def jacobian(a: Real, k: Real, euclidean: Flags, g: Real) -> tuple[Real, Real]:
    """Residual g - |a + K g| (F, n) and its derivative I - D K (F, n, n)."""
    y = a + np.einsum("fiaj,fj->fia", k, g)
    size, d = _norm(y, euclidean)
    return np.asarray(g - size), np.asarray(np.eye(g.shape[1]) - np.einsum("fia,fiaj->fij", d, k), float)


def _solve(matrix: Real, rhs: Real) -> Real:
    try:
        return np.asarray(np.linalg.solve(matrix, rhs[..., None])[..., 0])
    except np.linalg.LinAlgError:
        return np.asarray((np.linalg.pinv(matrix) @ rhs[..., None])[..., 0])


def _newton(
    a: Real,
    k: Real,
    euclidean: Flags,
    start: Real | None,
    *,
    most: int = 200,
    dominant: bool = False,
    tolerance: float = RESIDUAL_TOLERANCE,
) -> tuple[Real, Real, int]:
    """Loads (F, n), relative residuals (F,) and the number of steps, from ``start`` or from the frictionless loads.

    A step that does not reduce the residual is replaced by a fixed-point step. Converged frames stay as they are; once they are the
    larger part, only the others are iterated. ``dominant``: with some scaling of the columns the rows of ``|K|`` add up to less
    than one.
    """
    # frames last: numpy is fast along the last axis, and all others are short
    aw, kw = np.ascontiguousarray(np.moveaxis(a, 0, -1)), np.ascontiguousarray(np.moveaxis(k, 0, -1))
    kinds = euclidean[:, None]
    loads = _norm_last(aw, kinds)[0] if start is None else np.ascontiguousarray(start.T)
    residual = np.full(loads.shape[1], np.inf)
    here, index = loads, np.arange(loads.shape[1])
    f, slope = _jacobian_last(aw, kw, kinds, here)
    own, norms = np.abs(aw).sum(axis=1), np.abs(kw).sum(axis=1)
    largest = _largest_residual_last(f, own, norms, here)
    steps = 0
    while steps < most:
        going = largest > tolerance
        if not going.any():
            break
        steps += 1
        step = here - (_eliminate(slope, f) if dominant else _solve(np.moveaxis(slope, -1, 0), f.T).T)
        f_new, slope_new = _jacobian_last(aw, kw, kinds, step)
        largest_new = _largest_residual_last(f_new, own, norms, step)
        worse = ~(largest_new < 0.7 * largest)
        stay = ~going | (worse & (largest <= SETTLED_RESIDUAL))  # converged, or limited by rounding
        if (worse & ~stay).any():
            step = np.where(worse & ~stay, here - f, step)
            f_new, slope_new = _jacobian_last(aw, kw, kinds, step)
            largest_new = _largest_residual_last(f_new, own, norms, step)
        if stay.any():
            step, largest_new = np.where(stay, here, step), np.where(stay, largest, largest_new)
            f_new, slope_new = np.where(stay, f, f_new), np.where(stay, slope, slope_new)
        here, f, slope, largest = step, f_new, slope_new, largest_new
        loads[:, index], residual[index] = here, largest
        if 2 * stay.sum() >= len(index):
            index, here, f, slope, largest = index[~stay], here[:, ~stay], f[:, ~stay], slope[..., ~stay], largest[~stay]
            aw, kw, own, norms = aw[..., ~stay], kw[..., ~stay], own[..., ~stay], norms[..., ~stay]
            if not len(index):
                break
    residual[index] = largest
    return np.ascontiguousarray(loads.T), residual, steps


def _largest_residual_last(f: Real, own: Real, norms: Real, g: Real) -> Real:
    """Largest residual (F,) of equations f (n, F), each relative to its own terms: ``own`` (n, F), ``norms`` (n, n, F) times
    ``g``."""
    return np.asarray((np.abs(f) / np.maximum(own + np.einsum("ijf,jf->if", norms, np.abs(g)), 1e-300)).max(axis=0))


def _norm_last(y: Real, kinds: Flags) -> tuple[Real, Real]:
    """As `_norm`, for y (n, 2, F) and kinds (n, 1)."""
    p, q = y[:, 0], y[:, 1]
    length = np.hypot(p, q)
    first = np.abs(p) >= np.abs(q)
    g = np.where(kinds, length, np.where(first, np.abs(p), np.abs(q)))
    safe = np.where(length > 0.0, length, 1.0)
    d = np.empty_like(y)
    d[:, 0] = np.where(kinds, p / safe, np.where(first, np.sign(p), 0.0))
    d[:, 1] = np.where(kinds, q / safe, np.where(first, 0.0, np.sign(q)))
    return g, d


def _jacobian_last(a: Real, k: Real, kinds: Flags, g: Real) -> tuple[Real, Real]:
    """As `jacobian`, for a (n, 2, F), k (n, 2, n, F), g (n, F)."""
    y = a + np.einsum("iajf,jf->iaf", k, g)
    size, d = _norm_last(y, kinds)
    slope = -(d[:, 0, None] * k[:, 0] + d[:, 1, None] * k[:, 1])
    n = len(g)
    slope[range(n), range(n)] += 1.0
    return g - size, slope


def _eliminate(matrix: Real, rhs: Real) -> Real:
    """Solve matrices (n, n, F) with dominant diagonals for (n, F): elimination without pivots, all frames at once."""
    m, x = matrix.copy(), rhs.copy()
    n = len(x)
    for i in range(n - 1):
        factor = m[i + 1 :, i] / m[i, i]
        m[i + 1 :, i + 1 :] -= factor[:, None] * m[i, i + 1 :]
        x[i + 1 :] -= factor * x[i]
    for i in range(n - 1, -1, -1):
        x[i] = (x[i] - (m[i, i + 1 :] * x[i + 1 :]).sum(axis=0)) / m[i, i]
    return x


def _follow(a: Real, k: Real, euclidean: Flags, radius: Real) -> tuple[Real, Real, Real, Real]:
    """Loads (F, n), proportion reached (F,), share in the jam (F, n), residuals (F,), by continuation from the frictionless loads.

    The proportion p of the coefficients goes from 0 to 1; up to ``CONTRACTION_PART / radius`` the map surely contracts.
    """
    p = np.minimum(CONTRACTION_PART / radius, 1.0)
    g, residual, _ = _newton(a, k * p[:, None, None, None], euclidean, None)
    step = 0.1 * p
    jammed = np.zeros(len(a), bool)
    active = np.flatnonzero((p < 1.0) & (np.abs(a).max(axis=(1, 2)) > 0.0))
    p[np.abs(a).max(axis=(1, 2)) == 0.0] = 1.0  # no load acts on it
    for _ in range(MOST_STEPS):
        if not len(active):
            break
        aa, ka, here, at = a[active], k[active], g[active], p[active]
        _, matrix = jacobian(aa, ka * at[:, None, None, None], euclidean, here)
        y = aa + at[:, None, None] * np.einsum("fiaj,fj->fia", ka, here)
        slope = _solve(matrix, np.einsum("fia,fiaj,fj->fi", _norm(y, euclidean)[1], ka, here))
        size = np.minimum(_terms(aa, ka * at[:, None, None, None], here), np.abs(here).max(axis=1, keepdims=True))
        # no load grows by more than half of its own terms, or of the largest load, in one step; the largest step is one
        half = 0.5 * size
        most = (half / np.maximum(np.maximum(np.abs(slope), half), 1e-300)).min(axis=1)
        h = np.minimum(np.minimum(step[active], most), 1.0 - at)
        to = np.where(h >= 1.0 - at, 1.0, at + h)
        guess = here + (to - at)[:, None] * slope
        new, ok = _correct(aa, ka * to[:, None, None, None], euclidean, guess)
        away = (np.abs(new - guess) > OFF_BRANCH * size).any(axis=1)
        ok &= ~away
        done = active[ok]
        g[done], p[done] = new[ok], to[ok]
        step[done] = 2.0 * h[ok]
        step[active[~ok]] = 0.25 * h[~ok]
        ended = (to <= at) | (h < SHORTEST_STEP) & ~ok  # the branch runs to infinity, or turns back
        jammed[active[ended]] = True
        active = active[~ended & (p[active] < 1.0)]
    jammed[active] = True  # it has not converged
    share = np.zeros_like(g)
    past = p[jammed] * (1.0 + BEYOND_BRANCH)
    share[jammed] = _share(a[jammed], k[jammed] * past[:, None, None, None], euclidean, g[jammed])
    if not jammed.all():
        g[~jammed], residual[~jammed], _ = _newton(a[~jammed], k[~jammed], euclidean, g[~jammed], most=8)
    g[jammed] = np.nan
    residual[jammed] = np.nan
    return g, p, share, residual


def _correct(a: Real, k: Real, euclidean: Flags, g: Real) -> tuple[Real, Flags]:
    """Loads by plain Newton from a prediction, and where it converges to loads on the same branch."""
    g, ok, matrix = _arrive(a, k, euclidean, g)
    with np.errstate(all="ignore"):
        return g, ok & (np.linalg.det(matrix) > 0.0)


def _arrive(a: Real, k: Real, euclidean: Flags, g: Real) -> tuple[Real, Flags, Real]:
    """Loads by plain Newton, where it converges, and I - D K there. Loads are norms: where the equations hold, none is negative."""
    with np.errstate(all="ignore"):
        for _ in range(8):
            f, matrix = jacobian(a, k, euclidean, g)
            if np.all(np.abs(f) <= 1e-12 * _terms(a, k, g)):
                break
            g = g - _solve(matrix, f)
        f, matrix = jacobian(a, k, euclidean, g)
        return g, np.all(np.abs(f) <= 1e-10 * _terms(a, k, g), axis=1), matrix


def _terms(a: Real, k: Real, g: Real) -> Real:
    """Size (F, n) of the terms of each equation, by which its residual is judged."""
    return np.asarray(np.abs(a).sum(axis=2) + np.einsum("fiaj,fj->fi", np.abs(k), np.abs(g)))


def _share(a: Real, k: Real, euclidean: Flags, g: Real) -> Real:
    """Sensitivity (F, n) of the smallest singular value of I - D K to each column of K, the largest 1: the joints whose friction
    causes the jam."""
    _, matrix = jacobian(a, k, euclidean, g)
    u, _, vt = np.linalg.svd(matrix)
    left, right = u[:, :, -1], vt[:, -1]
    effect = np.abs(np.einsum("fi,fij->fj", left, np.eye(g.shape[1]) - matrix) * right)
    return np.asarray(effect / np.maximum(effect.max(axis=1, keepdims=True), 1e-300))
