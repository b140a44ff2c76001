"""Diagrams of one quantity against another, and lines at events: what is drawn is what was computed."""

from __future__ import annotations

import numpy as np
import pytest
from cases import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from mechviz.outputs.drawings import DRAWING_HEIGHT, DRAWING_WIDTH, Curve, Diagram, find_diagrams, round_ticks
from mechviz.outputs.rerun.blueprint import spans_of_plots
from mechviz.outputs.rerun.plots import MOST_MARKS, mark_path, mark_times
from recordings import made


def back(d: Diagram, spots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values at places of a drawing, which counts downwards."""
    x0, x1, y0, y1 = d.ranges
    return x0 + (x1 - x0) * spots[:, 0] / DRAWING_WIDTH, y0 - (y1 - y0) * spots[:, 1] / DRAWING_HEIGHT


@settings(max_examples=examples(80))
@given(st.floats(-1e3, 1e3), st.floats(1e-3, 1e6), st.integers(2, 8))
def test_ticks_are_round_and_few(low, span, count):
    high = low + span
    ticks = round_ticks(low, high, count)
    assert len(ticks) <= count + 1
    if len(ticks) > 1:
        steps = np.diff(ticks)
        mantissa = np.mean(steps) / 10.0 ** np.floor(np.log10(np.mean(steps)) + 1e-6)
        assert min(abs(mantissa - m) for m in (1.0, 2.0, 5.0)) < 1e-3
        assert np.all(ticks >= low - 1e-6 * span - 1e-9 * abs(low)) and np.all(ticks <= high + 1e-6 * span + 1e-9 * abs(high))


def test_diagrams_of_an_engine():
    run = made("slider-crank-engine").run
    phase, polar, overlaid = find_diagrams(run)
    slide = run.motion.coordinate("S")
    x, y = back(phase, phase.place(phase.curves[0].x, phase.curves[0].y))
    assert x == pytest.approx(1e3 * slide[:, 0], abs=1e-3) and y == pytest.approx(slide[:, 1], abs=1e-4)
    assert "[m/s]" in phase.title and "[mm]" in phase.title
    # from the top of the phase diagram to its right: a positive velocity makes the displacement grow, so it runs clockwise
    z = (x - x.mean()) / np.ptp(x) + 1j * y / np.ptp(y)
    assert np.angle(z[1:] / z[:-1]).sum() == pytest.approx(-4.0 * np.pi, abs=0.3)
    # bearing forces: what the frame exerts, drawn to one scale in both directions
    (force,) = polar.curves
    sign = 1.0 if next(p for p in run.motion.mechanism.joints if p.name == "A").links[0] == "frame" else -1.0
    assert np.column_stack([force.x, force.y]) == pytest.approx(sign * run.forces.reaction("A")[:, :2])
    x0, x1, y0, y1 = polar.ranges
    assert (x1 - x0) / DRAWING_WIDTH == pytest.approx((y1 - y0) / DRAWING_HEIGHT)
    assert x0 < 0.0 < x1 and y0 < 0.0 < y1
    # both turns of the torque: two strips, at the same angles
    assert overlaid.turn == 360.0 and overlaid.ranges[:2] == (0.0, 360.0)
    strips = overlaid.pieces(overlaid.curves[0])
    assert len(strips) >= 2 and all(np.all(np.diff(s[:, 0]) > 0.0) for s in strips)
    assert sum(map(len, strips)) >= run.motion.frames - 2


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("crank-rocker", ["phase"]),
        ("gear-train", ["bearing forces", "torque over angle"]),
        ("parallelogram", []),
        ("swinging-double-pendulum", ["phase", "bearing forces"]),
    ],
)
def test_only_what_a_run_calls_for(name, expected):
    run = made(name, 40).run
    diagrams = find_diagrams(run)
    assert [d.name for d in diagrams] == expected
    if run.simulation is not None:
        assert [c.name for c in diagrams[0].curves] == [d.joint for d in run.scene.mechanism.drives]


def test_curves_are_cut_where_nothing_is_known():
    x = np.arange(10.0)
    y = np.where((x == 4.0) | (x == 9.0), np.nan, x)
    d = Diagram("d", "d", "x", "y", (Curve("c", x, y),))
    assert [len(p) for p in d.pieces(d.curves[0])] == [4, 4]
    assert np.isfinite(d.ranges).all()
    long = Curve("c", np.linspace(0.0, 1.0, 10_001), np.linspace(0.0, 1.0, 10_001))
    d = Diagram("d", "d", "x", "y", (long,))
    (strip,) = d.pieces(long)
    assert len(strip) < 1600 and strip[-1] == pytest.approx(d.place(long.x[-1:], long.y[-1:])[0])


def test_the_recording_holds_axes_curves_and_a_point_that_moves_along():
    m = made("slider-crank-compressor")
    phase = find_diagrams(m.run)[0]
    strips = m.recording.static("diagrams", "phase", "curves", "S", component="LineStrips2D:strips")
    x, y = back(phase, np.concatenate(list(strips)).astype(float))
    motion = m.data("joints", "S", "motion")
    assert x == pytest.approx(1e3 * motion[:, 0], abs=1e-2) and y == pytest.approx(motion[:, 1], abs=1e-3)
    dots = m.recording.rows("diagrams", "phase", "now", component="Points2D:positions")
    assert np.all(dots.lengths == 1)
    x, _ = back(phase, dots.values.astype(float))
    assert x == pytest.approx(1e3 * motion[:: len(motion) // len(x) or 1, 0], abs=1e-2)
    labels = m.recording.static("diagrams", "phase", "ticks", component="Points2D:labels")
    assert "displacement [mm]" in labels and "0" in labels


def test_plots_have_lines_at_events_as_high_as_their_axes():
    m = made("slider-crank-compressor")
    times = np.unique([e.time for e in m.recording.events])
    assert 0 < len(times) <= MOST_MARKS
    spans = spans_of_plots(m.run)
    assert "Driving torque [N m]" in spans and len(spans) >= 3
    for view, (low, high) in spans.items():
        ns, values = m.recording.scalars(mark_path(view))
        assert 1e-9 * ns == pytest.approx(np.repeat(times, 3), abs=2e-9)
        assert np.array_equal(values[:, 0], np.tile([low, high, np.nan], len(times)), equal_nan=True)
    low, high = spans["Driving torque [N m]"]
    torque = m.data("drive", "A")[:, 3]
    assert low < torque.min() and torque.max() < high


def test_where_much_happens_there_are_no_lines():
    from mechcore.motion.events import Event

    events = [Event(0.1 * k, "INFO", "A", "something") for k in range(MOST_MARKS + 1)]
    assert len(mark_times(events)) == 0
    assert len(mark_times(events[:-1])) == MOST_MARKS
    assert len(mark_times([*events[:2], *events[:2]])) == 2


def test_a_constant_has_axes_too():
    still = Diagram("d", "d", "x", "y", (Curve("c", np.zeros(3), np.zeros(3)),))
    assert np.isfinite(still.place(np.zeros(1), np.zeros(1))).all()


@pytest.mark.parametrize("name", ["compressor-cycle", "four-stroke-cycle"])
def test_the_area_of_an_indicator_diagram_is_the_work_of_the_gas(name):
    run = made(name).run
    diagram = next(d for d in find_diagrams(run) if d.name == "indicator")
    (curve,) = diagram.curves
    load = next(load for load in run.motion.mechanism.loads if load.name == curve.name)
    area = np.trapezoid(1e6 * curve.y, 1e-3 * curve.x)  # the back pressure gives back what it takes
    gas = next(power for w, power in run.forces.powers() if w.name == curve.name)
    assert load.area * area == pytest.approx(np.trapezoid(gas, run.motion.time), rel=2e-2)
    assert curve.x.min() == pytest.approx(0.0, abs=1e-6) and curve.x.max() == pytest.approx(1e3 * load.cycle.stroke, rel=1e-3)
    assert (area < 0.0) == (name == "compressor-cycle")
