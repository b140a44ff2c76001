"""Path generation: the best values known for published points, exact derivatives, bounds, order, cognates."""

from __future__ import annotations

import numpy as np
import pytest
from design_cases import design_case, plane

from mechcore.design import paths
from mechcore.design.four_bars import FourBar, Grashof, from_pins
from mechcore.design.paths import PathProblem, PathTask, path_designs
from mechcore.errors import MechanismError
from mechcore.numerics.newton import fit_all


def task_of(name, **given):
    return PathTask(plane(design_case(name)[0]["points"]), **given)


def best(name):
    return design_case(name)[1]["best_found"]["error"]


RISING = {"lengths": (0, 50), "farthest": 50, "senses": (1,)}
CASES = {
    "path-18-points-prescribed-timing": {"steps": np.radians(20.0 * np.arange(18)), **RISING},
    "path-5-points-prescribed-timing": {
        "steps": np.radians(15.0 * np.arange(5)), "start": np.radians(30), "pivot": 0j, "frame_angle": 0.0, **RISING,
    },
    "path-semicircle-6-points-prescribed-timing": {
        "steps": np.radians(30.0 * np.arange(6)), "start": np.radians(30), **RISING, "lengths": (5, 50),
    },
    "path-10-points-ellipse": {"lengths": (5, 80), "farthest": 80},
    "path-figure-eight": {"steps": np.radians(22.5 * np.arange(16))},
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_the_best_values_known_are_reached(name):
    designs = path_designs(task_of(name, **CASES[name]), seed=3, screened=8000)
    assert designs[0].error == pytest.approx(best(name), rel=1e-6)
    bar = designs[0].four_bar
    assert bar.grashof is Grashof.CRANK_ROCKER
    miss = bar.positions(designs[0].theta)[2] - plane(design_case(name)[0]["points"])
    assert (np.abs(miss) ** 2).sum() == pytest.approx(designs[0].error, rel=1e-9)
    low, high = CASES[name].get("lengths", (0, np.inf))
    assert all(low - 1e-12 <= length <= high + 1e-12 for length in (bar.frame, bar.crank, bar.coupler, bar.rocker))


def test_published_linkages_have_the_errors_that_are_recomputed():
    inputs, expected = design_case("path-18-points-prescribed-timing")
    for row in expected.values():
        r = row["linkage"]
        o2 = complex(r["x0"], r["y0"])
        bar = FourBar(o2, o2 + r["r1"] * np.exp(1j * r["th0"]), r["r2"], r["r3"], r["r4"], r["branch"], complex(r["rcx"], r["rcy"]))
        p = bar.positions(r["th0"] + r["start"] + np.radians(20.0 * np.arange(18)))[2]
        assert (np.abs(p - plane(inputs["points"])) ** 2).sum() == pytest.approx(row["error"], rel=1e-8)


def test_points_on_a_line_are_met_exactly_and_in_order():
    designs = path_designs(task_of("path-6-points-straight-line", lengths=(5, 60), farthest=60), seed=1, screened=4000)
    assert len(designs) > 5 and designs[0].error < 1e-20
    for one in designs[:5]:
        steps = np.diff(one.theta)
        assert (steps > 0).all() or (steps < 0).all()
        assert abs(steps.sum()) < 2 * np.pi


@pytest.mark.parametrize("timed", [True, False])
def test_derivatives_are_those_of_the_residuals(timed):
    rng = np.random.default_rng(0)
    points = rng.normal(size=4) + 1j * rng.normal(size=4)
    task = PathTask(points, np.arange(4.0) if timed else None)
    problem = PathProblem(task, np.array([1, -1]), np.array([1, -1]))
    x = np.array([[0.1, 0.2, 0.7, 4.0, 1.0, 3.0, 3.5, 0.8, 1.1, 0.4], [0.3, -0.2, 0.9, 2.0, 1.0, 1.2, 1.5, 0.8, 1.1, 2.0]])
    if not timed:
        x = np.concatenate([x[:, :9], rng.uniform(0, 6, (2, 4))], axis=1)
    numbers = np.arange(2)
    _, slopes = problem.evaluate(x, numbers)
    for k in range(x.shape[1]):
        h = 1e-3 * (np.arange(x.shape[1]) == k)
        difference = sum(weight * problem.evaluate(x + n * h, numbers)[0] for n, weight in ((-2, 1), (-1, -8), (1, 8), (2, -1))) / (
            12e-3
        )
        assert slopes[:, :, k] == pytest.approx(difference, abs=2e-8)


def test_the_same_seed_gives_the_same_designs():
    task = task_of("path-18-points-prescribed-timing", **CASES["path-18-points-prescribed-timing"])
    first, second = (path_designs(task, seed=5, screened=500, refined=4) for _ in range(2))
    assert [one.four_bar for one in first] == [one.four_bar for one in second]


def test_cognates_draw_the_same_curve():
    inputs, expected = design_case("roberts-cognates")
    bar = FourBar(0j, complex(inputs["d"]), inputs["a"], inputs["b"], inputs["c"], inputs["side"], complex(*inputs["u"]))
    for row in expected["rows"]:
        theta = np.radians(row["theta_deg"])
        (p,) = bar.positions(np.array([theta]))[2]
        assert p == pytest.approx(complex(*row["P"]), rel=1e-12)
        for cognate, name in zip(bar.cognates(theta), ("cognate1", "cognate2"), strict=True):
            wanted = expected[name]
            lengths = cognate.crank, cognate.coupler, cognate.rocker
            assert lengths == pytest.approx([wanted[k] for k in ("crank", "coupler", "rocker")], rel=1e-12)
            assert cognate.tracer / cognate.coupler == pytest.approx(complex(*wanted["coupler_ratio"]), rel=1e-12)
            pins = [complex(*row[name][k]) for k in ("crank_pin", "rocker_pin")]
            a, b, drawn = cognate.positions(np.angle(np.array([pins[0] - cognate.crank_pivot])))
            assert (a[0], b[0], drawn[0]) == pytest.approx((*pins, p), rel=1e-12)


def test_a_linkage_through_its_own_pins_is_itself():
    bar = FourBar(1 + 2j, 5 + 1j, 1.0, 4.0, 3.0, -1, 2 + 1j)
    a, b, p = (complex(z[0]) for z in bar.positions(np.array([0.7])))
    again = from_pins(bar.crank_pivot, bar.rocker_pivot, a, b, p)
    theta = np.linspace(0, 6, 9)
    assert again.positions(theta)[2] == pytest.approx(bar.positions(theta)[2], abs=1e-12)


def test_least_squares_of_many_problems_with_bounds():
    """Rosenbrock's valley from many starts; a line whose slope is held at its bound."""

    def valley(x, numbers):
        r = np.stack([10 * (x[:, 1] - x[:, 0] ** 2), 1 - x[:, 0]], axis=1)
        j = np.stack([np.stack([-20 * x[:, 0], np.full(len(x), 10.0)], 1), np.stack([-np.ones(len(x)), np.zeros(len(x))], 1)], 1)
        return r, j

    starts = np.random.default_rng(0).uniform(-2, 2, (20, 2))
    fits = fit_all(valley, starts, np.array([-np.inf] * 2), np.array([np.inf] * 2))
    assert fits.settled.all()
    assert fits.x == pytest.approx(np.ones((20, 2)), abs=1e-9)
    held = fit_all(valley, starts, np.array([-5.0, -5.0]), np.array([0.5, 5.0]))
    best_there = held.x[held.cost < 0.3]
    assert len(best_there) and best_there == pytest.approx(np.broadcast_to([0.5, 0.25], best_there.shape), abs=1e-8)


def test_what_is_no_path_is_refused():
    with pytest.raises(MechanismError, match="points"):
        PathTask(np.array([0j, 1.0]))
    with pytest.raises(MechanismError, match="steps"):
        PathTask(np.array([0j, 1.0, 1j]), np.zeros(2))
    with pytest.raises(MechanismError, match="lengths"):
        PathTask(np.array([0j, 1.0, 1j]), lengths=(3.0, 2.0))


def test_many_points_without_timing_are_met_by_way_of_fewer(monkeypatch):
    monkeypatch.setattr(paths, "DENSE_REFINED", 12)  # enough here, and quicker
    monkeypatch.setattr(paths, "DENSE_ITERATIONS", 100)
    bar = FourBar(0j, 3 + 0.5j, 1.0, 3.2, 2.6, 1, 1.5 + 1.2j)
    points = bar.positions(np.linspace(0.4, 0.4 + 2 * np.pi, 25))[2]
    designs = path_designs(PathTask(points), seed=2, screened=400)
    size = abs(points - points.mean()).max()
    assert designs[0].largest < 1e-9 * size
    assert designs[0].four_bar.positions(designs[0].theta)[2] == pytest.approx(points, abs=1e-9 * size)
