"""The nonsmooth system of normal loads: closed forms, branches that end, uniqueness, and what is left where it jams."""

from __future__ import annotations

import numpy as np
import pytest

from mechcore.forces.friction import normal_loads as fixedpoint
from mechcore.forces.friction.normal_loads import has_several_solutions, solve_normal_loads, spectral_radius, stability


def one(a, b, euclidean=True):
    """Single loads g = |a + b g| with complex a, b (F,)."""
    a, b = np.atleast_1d(np.asarray(a, complex)), np.atleast_1d(np.asarray(b, complex))
    a, b = np.broadcast_arrays(a, b)
    parts = np.stack([a.real, a.imag], -1)[:, None, :], np.stack([b.real, b.imag], -1)[:, None, :, None]
    return solve_normal_loads(*parts, np.array([euclidean]))


def one_stability(a, b, result):
    a, b = np.broadcast_arrays(np.atleast_1d(np.asarray(a, complex)), np.atleast_1d(np.asarray(b, complex)))
    parts = np.stack([a.real, a.imag], -1)[:, None, :], np.stack([b.real, b.imag], -1)[:, None, :, None]
    return stability(*parts, np.array([True]), result.loads)


def test_one_scalar_load_is_a_over_one_minus_b_and_jams_at_one():
    b = np.array([-50.0, -3.0, -1.0, -0.5, 0.0, 0.5, 0.99, 1.0 - 1e-9, 1.0 + 1e-9, 1.5, 30.0])
    computed = one(2.0, b)
    good = b < 1.0
    np.testing.assert_allclose(computed.loads[good, 0], 2.0 / (1.0 - b[good]), rtol=1e-7)
    np.testing.assert_allclose(computed.loads[:7, 0], 2.0 / (1.0 - b[:7]), rtol=1e-13)
    assert (computed.jammed == ~good).all() and np.isnan(computed.loads[~good]).all()
    np.testing.assert_allclose(computed.movable_share[~good], 1.0 / b[~good], rtol=1e-9)
    np.testing.assert_allclose(one_stability(2.0, b, computed)[good], 1.0 - b[good], rtol=1e-12)
    assert (computed.share[~good] == 1.0).all()


def test_a_branch_that_would_need_infinite_loads_at_the_very_coefficients():
    """At b = 1 the equations are singular; just below it they are not."""
    computed = one(2.0, np.array([1.0 - 1e-12, 1.0]))
    np.testing.assert_array_equal(computed.jammed, [False, True])
    assert computed.loads[0, 0] == pytest.approx(2e12, rel=1e-3)
    assert 1.0 - 1e-9 < computed.movable_share[1] < 1.0 and computed.share[1, 0] == 1.0


def random_system(seed, frames=100):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    a, k = rng.normal(size=(frames, n, 2)), rng.normal(size=(frames, n, 2, n)) * 10 ** rng.uniform(-1, 1)
    if seed % 3 == 0:
        k[..., rng.random(n) < 0.3] = 0.0
    if seed % 5 == 0:
        k[:, :, 1], a[:, :, 1] = 0.0, 0.0
    return a, k, rng.random(n) < 0.5


def crept(a, k, kinds, steps=600):
    """Loads of one frame by a great many small steps of the proportion, and how far they lead: no step control.

    The branch ends where Newton's method does not arrive near by or the determinant of its matrix has changed its sign.
    """
    n = len(a)

    def at(p, g):
        y = a + p * np.einsum("iaj,j->ia", k, g)
        length, larger = np.maximum(np.hypot(*y.T), 1e-300), np.abs(y[:, 0]) >= np.abs(y[:, 1])
        one_of = np.stack([np.where(larger, np.sign(y[:, 0]), 0.0), np.where(larger, 0.0, np.sign(y[:, 1]))], 1)
        d = np.where(kinds[:, None], y / length[:, None], one_of)
        return g - np.where(kinds, np.hypot(*y.T), np.abs(y).max(axis=1)), np.eye(n) - p * np.einsum("ia,iaj->ij", d, k)

    g = at(0.0, np.zeros(n))[0] * -1.0
    for i in range(1, steps + 1):
        old = g
        for _ in range(12):
            f, matrix = at(i / steps, g)
            g = g - np.linalg.solve(matrix, f)
        f, matrix = at(i / steps, g)
        if np.abs(f).max() > 1e-10 * np.abs(g).max() or np.linalg.det(matrix) <= 0.0 or np.abs(g - old).max() > 0.3 * old.max():
            return None, i / steps
    return g, 1.0


@pytest.mark.parametrize(("seed", "frame"), [(20, 82), (53, 82), (55, 31), (51, 32)])
def test_the_branch_is_followed_without_jumping_to_another_one(seed, frame):
    """Systems in which a longer step, or one whose end is not looked at, arrives on another branch."""
    a, k, kinds = random_system(seed)
    solution = solve_normal_loads(a[[frame]], k[[frame]], kinds)
    wanted, reached = crept(a[frame], k[frame], kinds)
    assert solution.jammed[0] == (wanted is None)
    assert solution.movable_share[0] == pytest.approx(reached, abs=2e-3)
    if wanted is not None:
        np.testing.assert_allclose(solution.loads[0], wanted, rtol=1e-9, atol=1e-11 * wanted.max())


@pytest.mark.parametrize("most", [1, 2000])
def test_every_jam_names_what_makes_it_and_no_branch_is_followed_in_vain(most, monkeypatch):
    """One share of every jam is 1, also where a branch is given up; steps too short to count end it."""
    calls = []
    monkeypatch.setattr(fixedpoint, "MOST_STEPS", most)
    monkeypatch.setattr(fixedpoint, "_correct", lambda *x, f=fixedpoint._correct: (calls.append(0), f(*x))[1])
    jams = 0
    for seed in (7, 10, 11, 16, 18, 46):
        calls.clear()
        solution = solve_normal_loads(*random_system(seed))
        jams += int(solution.jammed.sum())
        assert (solution.share[solution.jammed].max(axis=1) == 1.0).all() and not solution.share[~solution.jammed].any()
        assert (solution.movable_share[solution.jammed] < 1.0).all() and np.isnan(solution.loads[solution.jammed]).all()
        assert np.isfinite(solution.loads[~solution.jammed]).all()
        assert len(calls) < 1000
    assert jams > 100


def test_a_second_state_is_found_where_there_is_one():
    """2 + b g = -g has a solution g = -2 / (1 + b) beside 2 / (1 - b) where b < -1, as the contact is then reversed."""
    b = np.array([-50.0, -3.0, -1.01, -0.99, -0.5, 0.5, 0.9, 1.5])
    computed = one(2.0, b)
    parts = np.zeros((len(b), 1, 2)), np.zeros((len(b), 1, 2, 1))
    parts[0][:, 0, 0], parts[1][:, 0, 0, 0] = 2.0, b
    np.testing.assert_array_equal(has_several_solutions(*parts, np.array([True]), computed.loads), b < -1.0)


@pytest.mark.parametrize("angle", [0.0, 0.7, 1.5, 2.2, 3.0])
def test_one_pin_is_a_quadratic(angle):
    """|a + b g| = g with |b| > 1: the branch runs to infinity where Re(a b*) > 0 and turns back where it is negative."""
    a = 3.0 * np.exp(0.4j)
    for size in (0.3, 0.95, 1.4, 5.0):
        b = size * np.exp(1j * (angle + 0.4))
        computed = one(a, b)
        c = (np.conj(a) * b).real
        # (1 - |b|^2) g^2 - 2 c g - |a|^2 = 0; of the two roots the one that |a| becomes as b grows from zero
        disc = c**2 + (1.0 - size**2) * abs(a) ** 2
        ends = (1.0 if c >= 0 else 1.0 / abs(np.sin(angle))) if c != 0 else 1.0
        if size < 1.0 or (c < 0 and size < ends):
            wanted = abs(a) ** 2 / (np.sqrt(disc) - c)
            assert computed.loads[0, 0] == pytest.approx(wanted, rel=1e-12)
            assert not computed.jammed[0] and one_stability(a, b, computed)[0] > 0.0
        else:
            assert computed.jammed[0]
            # at a proportion p it ends: p size = 1 where it runs to infinity, p size sin = 1 where it turns back
            assert computed.movable_share[0] * size == pytest.approx(ends, rel=1e-6)


def test_random_systems_have_the_one_solution_of_the_fixed_point():
    rng = np.random.default_rng(4)
    frames, n = 400, 6
    a = rng.normal(size=(frames, n, 2))
    k = rng.normal(size=(frames, n, 2, n))
    kinds = np.array([True, True, False, True, False, False])
    size = np.where(kinds[:, None], np.hypot(k[:, :, 0], k[:, :, 1]), np.abs(k).max(axis=2))
    k *= (0.97 / np.abs(np.linalg.eigvals(size)).max(axis=1))[:, None, None, None]
    solution = solve_normal_loads(a, k, kinds)
    assert not solution.jammed.any() and solution.residual.max() < 1e-12 and (solution.loads >= 0).all()
    assert solution.iterations < 25
    g = np.zeros((frames, n))
    for _ in range(3000):
        y = a + np.einsum("fiaj,fj->fia", k, g)
        g = np.where(kinds, np.hypot(y[..., 0], y[..., 1]), np.abs(y).max(axis=2))
    np.testing.assert_allclose(solution.loads, g, rtol=0, atol=1e-12 * g.max())


def test_just_below_a_jam_loads_are_found_to_the_last_digit():
    """Two bearings joined by a belt (a crank with a fan), coefficients 1 and 1.5: loads twenty times the frictionless ones."""
    a = np.array([[[-53.01244450613285, 26.15609542717606], [-3.168062232412855, 0.7308160632149625]]])
    k = np.zeros((1, 2, 2, 2))
    k[0, 0, :, 1] = k[0, 1, :, 1] = 0.5275201702512721, 0.8350566555731247
    k[0, 1] *= -1.0
    solution = solve_normal_loads(a, k, np.array([True, True]))
    # g = |a + b g| with |b| < 1 is a quadratic; the first load follows from the second
    p, b = a[0] @ [1.0, 1.0j], k[0, 1, :, 1] @ [1.0, 1.0j]
    c = (np.conj(p[1]) * b).real
    g = (c + np.sqrt(c**2 + (1.0 - abs(b) ** 2) * abs(p[1]) ** 2)) / (1.0 - abs(b) ** 2)
    np.testing.assert_allclose(solution.loads[0], [abs(p[0] - b * g), g], rtol=1e-11)
    assert solution.residual[0] < 1e-13 and not solution.jammed[0]


@pytest.mark.parametrize("n", [1, 2, 4])
@pytest.mark.parametrize("radius", [0.99, 0.9999, 0.999999])
def test_where_the_map_hardly_contracts_the_equations_hold(n, radius):
    rng = np.random.default_rng(3)
    a, k = rng.normal(size=(300, n, 2)), rng.normal(size=(300, n, 2, n))
    size = np.hypot(k[:, :, 0], k[:, :, 1])
    k *= (radius / np.abs(np.linalg.eigvals(size)).max(axis=1))[:, None, None, None]
    solution = solve_normal_loads(a, k, np.ones(n, bool))
    assert not solution.jammed.any() and solution.residual.max() < 1e-11


def test_beyond_the_contraction_the_branch_is_followed():
    """Strong coupling: what is found solves the equations, has a positive determinant, and is continuous in the coefficients."""
    rng = np.random.default_rng(9)
    frames, n = 300, 4
    a, k = rng.normal(size=(frames, n, 2)), 0.35 * rng.normal(size=(frames, n, 2, n))
    kinds = np.array([True, False, True, False])
    solution = solve_normal_loads(a, k, kinds)
    good = ~solution.jammed
    assert 20 < good.sum() < 280
    assert (
        solution.residual[good].max() < 1e-11
        and (stability(a, k, kinds, solution.loads)[good] > 0).all()
        and (solution.loads[good] >= -1e-12).all()
    )
    assert (solution.share[solution.jammed].max(axis=1) == 1.0).all()
    # just short of where a branch ends it is still there, just beyond it is not
    bad = solution.jammed
    for part, there in ((1.0 - 1e-4, True), (1.0 + 1e-4, False)):
        again = solve_normal_loads(a[bad], k[bad] * (part * solution.movable_share[bad])[:, None, None, None], kinds)
        assert (again.jammed != there).mean() > 0.97
    # a frame's answer does not depend on its neighbours
    alone = solve_normal_loads(a[7:8], k[7:8], kinds)
    np.testing.assert_array_equal(alone.jammed, solution.jammed[7:8])
    np.testing.assert_allclose(alone.loads, solution.loads[7:8], rtol=1e-10)


def test_nothing_loaded_and_nothing_finite():
    k = np.full((3, 2, 2, 2), 5.0)
    a = np.zeros((3, 2, 2))
    a[2, 0, 0] = np.nan
    solution = solve_normal_loads(a, k, np.array([True, False]))
    np.testing.assert_array_equal(solution.loads[:2], 0.0)
    assert not solution.jammed.any() and np.isnan(solution.loads[2]).all()


def test_spectral_radius_is_a_bound_from_above():
    rng = np.random.default_rng(2)
    m = rng.uniform(0, 1, (200, 5, 5)) * (rng.uniform(size=(200, 5, 5)) < 0.5)
    true = np.abs(np.linalg.eigvals(m)).max(axis=1)
    radius = spectral_radius(m)
    assert (radius >= true * (1 - 1e-12)).all()
    assert (radius[true > 0.1] <= 1.1 * true[true > 0.1]).all()
