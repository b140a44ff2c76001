"""Windows between the corners of tables of straight lines over time: solved together, as exact as alone, and in few calls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dynamic_mechanisms import double_pendulum, pendulum
from mechanisms import case
from scipy.integrate import solve_ivp

from mechcore.dynamics.events import EndStop
from mechcore.dynamics.integration import windows
from mechcore.dynamics.simulate import simulate
from mechcore.laws.timed import Table
from mechcore.spec.loads import Factor, Torque
from mechcore.spec.mechanism import Friction
from mechviz.runs import run_scene
from mechviz.scene.scene import load


def lines(rows: int, start: float = 0.1, end: float = 2.5) -> Table:
    """A table of straight lines that goes up and down."""
    x = np.linspace(start, end, rows)
    return Table(tuple(x), tuple(np.sin(7.0 * x) * np.cos(31.0 * x)), smooth=False)


@pytest.mark.parametrize("rows", [60, 240, 960])
def test_a_table_of_lines_in_time_costs_as_few_calls_as_a_smooth_one(rows):
    """Corners are known before a window is tried: many windows are solved in a call. Speeds are sums of trapezes."""
    table = lines(rows)
    load = Torque(name="pull", link="body", moment=3.0, factor=Factor(function=table, of="time"))
    wheel = pendulum(inertia=0.5, mass=1.0, distance=0.0, angle=0.0, loads=(load,))
    simulation = simulate(wheel, 2.5, tolerance=1e-10)
    x, y = np.array(table.x), np.array(table.y)
    area = np.concatenate([[0.1 * y[0]], 0.1 * y[0] + np.cumsum(0.5 * np.diff(x) * (y[1:] + y[:-1]))])
    assert simulation(x)[1][:, 0] == pytest.approx(6.0 * area, abs=1e-11)
    assert simulation.evaluations < 120 and sum(len(p.solution.windows) for p in simulation.segments) < rows + 30


def test_windows_between_corners_are_solved_together_as_alone():
    """A pendulum against quadrature row by row (scipy)."""
    table = lines(120, 0.4, 1.6)
    load = Torque(name="pull", link="body", moment=2.0, factor=Factor(function=table, of="time"))
    simulation = simulate(pendulum(inertia=0.3, mass=1.0, distance=0.4, angle=0.5, loads=(load,)), 2.0, tolerance=1e-11)

    def rates(t, y):
        return [y[1], (2.0 * np.interp(t, table.x, table.y) - 0.4 * 9.81 * np.sin(y[0])) / 0.3]

    y, t = np.array([0.5, 0.0]), 0.0
    for end in (*table.x, 2.0):
        y, t = solve_ivp(rates, (t, end), y, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1], end
    assert [x[0, 0] for x in simulation([2.0])[:2]] == pytest.approx([y[0] - np.pi / 2, y[1]], abs=1e-9)
    assert simulation.evaluations < 150


@pytest.mark.sample(3)
@pytest.mark.parametrize("beside", ["friction", "a stop", "two freedoms", "a table of position", "radau"])
def test_what_else_happens_between_corners_is_met_as_before(monkeypatch, beside):
    """Events, contacts and breakpoints that have to be looked for end a row of windows where they come."""
    pull = Torque(name="pull", link="body", moment=2.0, factor=Factor(function=lines(100, 0.0, 0.9), of="time"))
    loads, method, stops = (pull,), "auto", ()
    if beside == "a table of position":
        bent = Table((-3.0, -1.2, -1.0, 3.0), (1.0, 0.2, -0.5, -1.0), smooth=False)
        loads += (Torque(name="bent", link="body", moment=1.0, factor=Factor(function=bent, of="position", joint="O")),)
    body = pendulum(inertia=0.3, mass=1.0, distance=0.4, angle=0.5, loads=loads)
    if beside == "friction":
        pin = replace(body.joints[0], friction=Friction(coefficient=0.3, radius=0.05))
        body = replace(body, joints=(pin,), effects=(*body.effects, "friction"))
    elif beside == "a stop":
        stops = (EndStop(name="end", joint="O", at=-1.3, side="lower", restitution=0.5),)
    elif beside == "two freedoms":
        base = double_pendulum(case("dynamics", "double-pendulum-rods")["inputs"])
        body = replace(base, loads=(replace(pull, link="lower"),))
    elif beside == "radau":
        method = "radau"
    simulation = simulate(body, 1.0, tolerance=1e-10, stops=stops, method=method)
    monkeypatch.setattr(windows, "FEW_WINDOWS", 10**9)
    alone = simulate(body, 1.0, tolerance=1e-10, stops=stops, method=method)
    t = np.linspace(0.0, 1.0, 41)
    assert np.abs(np.array(simulation(t)[:2]) - np.array(alone(t)[:2])).max() < 1e-8
    assert [(e.kind, round(e.time, 8)) for e in simulation.events] == [(e.kind, round(e.time, 8)) for e in alone.events]
    assert simulation.evaluations < 0.7 * alone.evaluations


@pytest.mark.parametrize("executor", ["numpy", "auto"])
def test_a_window_ends_at_every_corner_also_where_it_begins_at_one(executor):
    """A corner that a window passes by a thousandth of its length leaves no trace in its error estimate. The press goes over four
    of them a turn; at one, the window that begins there does so by a rounding error before it."""
    simulation = run_scene(load("crushing-press"), frames=12, executor=executor).simulation
    spans = np.array([[w.q[0], w.end()[0][0]] for segment in simulation.segments for w in segment.solution.windows])
    met = 0
    for corner in np.radians([200.0, 206.0, 262.0, 268.0]):
        ahead = np.mod(corner - spans[:, 0], 2.0 * np.pi)
        inside = (ahead > 1e-7) & (ahead < spans[:, 1] - spans[:, 0] - 1e-7)
        assert not inside.any(), f"{np.degrees(corner)}: {spans[inside]}"
        met += int((np.abs(ahead - (spans[:, 1] - spans[:, 0])) <= 1e-7).sum())
    assert met >= 28
