"""Equations of motion as straight lines of numpy: the same as the code that wrote them, and used in its place."""

from __future__ import annotations

import numpy as np
import pytest
from dynamic_mechanisms import double_pendulum, swinging_five_bar
from mechanisms import case

from mechcore.compiled.symbols import Untraceable
from mechcore.dynamics.equations import charts
from mechcore.dynamics.equations.charts import Chart
from mechcore.dynamics.equations.lines import python_of, solved_by_lines, straight_lines
from mechcore.dynamics.equations.reduced import free_of, reduce
from mechcore.dynamics.simulate import simulate
from mechcore.motion.solve import compile_mechanism
from mechviz.scene.scene import load

RANDOM = np.random.default_rng(7)
MECHANISMS = {
    "double pendulum": lambda: double_pendulum(case("dynamics", "double-pendulum-physical")["inputs"]),
    "five-bar, a loop": swinging_five_bar,
    **{name: lambda name=name: load(name).mechanism for name in ("engine-mounts", "servo-arm", "thrown-wrench")},
}


@pytest.mark.parametrize("name", MECHANISMS)
def test_they_give_the_accelerations_of_the_code_that_wrote_them(name):
    compiled = compile_mechanism(MECHANISMS[name]())
    lines = straight_lines(compiled)
    assert lines is not None
    f, s = lines.freedoms, lines.states
    start = [d.law.start for d in (compiled.mechanism.drives[i] for i in free_of(compiled))]
    q = np.hstack([np.array(start) + 0.05 * RANDOM.standard_normal((9, f)), np.zeros((9, s))])
    v, t = RANDOM.standard_normal((9, f + s)), np.linspace(0.0, 0.02, 9)
    r = reduce(compiled, q, v, t)
    wanted = np.linalg.solve(r.inertia, (r.force - r.bias)[..., None])[..., 0]
    assert lines(q, v, t)[:, :f] == pytest.approx(wanted, rel=1e-11, abs=1e-11 * np.abs(wanted).max())


def test_a_motion_goes_over_to_them_and_stays_the_same(monkeypatch):
    mechanism, calls = MECHANISMS["double pendulum"](), []
    solve = Chart._solve
    monkeypatch.setattr(Chart, "_solve", lambda *state: calls.append(len(state[3])) or solve(*state))
    by_lines = simulate(compile_mechanism(mechanism), 0.6, tolerance=1e-10)
    few = len(calls)
    monkeypatch.setattr(charts, "WORTH_LINES", 10**9)
    by_arrays = simulate(compile_mechanism(mechanism), 0.6, tolerance=1e-10)
    assert few <= 12 < 30 < len(calls) - few
    assert by_lines([0.5])[0] == pytest.approx(by_arrays([0.5])[0], abs=1e-11)


def test_systems_are_solved_term_by_term():
    half = RANDOM.standard_normal((6, 4, 4))
    matrix, rhs = half @ half.swapaxes(1, 2) + np.eye(4), RANDOM.standard_normal((6, 4))
    triangle = [matrix[:, i, j] for i in range(4) for j in range(i + 1)]
    assert np.stack(solved_by_lines(triangle, list(rhs.T)), axis=1) == pytest.approx(
        np.linalg.solve(matrix, rhs[..., None])[..., 0]
    )


def test_lines_of_c_in_python():
    assert python_of("const double t7 = t5 != 0.0 ? t3 : (-1.0);") == "t7 = chosen(t5 != 0.0, t3, (-1.0))"
    assert python_of("const double t8 = (double)(t5 < p[2]);") == "t8 = 1.0 * (t5 < p[2])"
    with pytest.raises(Untraceable, match="piecewise"):
        python_of("const double t9 = piecewise((p + 4), 3, t2);")
