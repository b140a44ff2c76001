"""A motion found anew from one that is nearly right: the same solution, however it was started, in few evaluations."""

from dataclasses import replace

import numpy as np
import pytest
from dynamic_mechanisms import pendulum

from mechcore.dynamics import simulation as simulation_module
from mechcore.dynamics.integration.collocation import Window
from mechcore.dynamics.integration.refinement import KnownMotion, refine
from mechcore.dynamics.integration.windows import Integrator, Solution
from mechcore.dynamics.simulate import simulate
from mechviz.accuracy.estimate import integration_error
from mechviz.runs import run_scene
from mechviz.scene.scene import load


def falsified(simulation, part):
    """The same motion with accelerations that are wrong by a part of their size."""
    segments = []
    for segment in simulation.segments:
        windows = [w._replace(a=w.a * (1.0 + part * np.sin(3.0 + i))) for i, w in enumerate(segment.solution.windows)]
        segments.append(replace(segment, solution=Solution(windows)))
    return replace(simulation, segments=tuple(segments))


class Counted:
    """x'' = -x - (x^2 - 1) x' (van der Pol), which counts its calls and nodes."""

    def __init__(self):
        self.calls = 0

    def __call__(self, q, v, t):
        self.calls += 1
        return -q - (q * q - 1.0) * v

    def slopes(self, q, v, t, a):
        return (-1.0 - 2.0 * q * v)[:, :, None], (1.0 - q * q)[:, :, None]


@pytest.mark.parametrize("stiff", [False, True])
@pytest.mark.parametrize("wrong", [0.0, 1e-4, 1e-2])
def test_same_solution_from_any_start_that_is_near(stiff, wrong):
    """Against a march to 1e-13; what it starts from may be wrong by much more than what comes out."""
    start = np.array([2.0]), np.array([0.0])
    first = Integrator(Counted(), tolerance=1e-7, stiff=stiff).run(*start, 0.0, 12.0)
    exact = Integrator(Counted(), tolerance=1e-13).run(*start, 0.0, 12.0)
    boundaries = np.array([*(w.start for w in first.windows), 12.0])
    known = KnownMotion(boundaries, np.zeros(len(boundaries) - 1, bool), lambda t: first(t)[2] * (1.0 + wrong * np.cos(t))[:, None])
    system = Counted()
    refined = refine(Integrator(system, tolerance=1e-10, stiff=stiff), *start, 0.0, 12.0, known)
    t = np.linspace(0.0, 12.0, 301)
    miss, before = (np.abs(np.array(x(t)[:2]) - np.array(exact(t)[:2])).max() for x in (refined, first))
    assert miss < 2e-10 and before > 3.0 * miss
    if wrong < 1e-3:
        assert system.calls <= 8, "all windows in one call"
    assert sum(w.length for w in refined.windows) == pytest.approx(12.0, abs=1e-12)


def test_windows_are_halved_until_the_series_ends():
    """Windows far too long for the equations become short ones, and only where that is needed."""
    start = np.array([2.0]), np.array([0.0])
    exact = Integrator(Counted(), tolerance=1e-13).run(*start, 0.0, 12.0)
    known = KnownMotion(np.linspace(0.0, 12.0, 7), np.zeros(6, bool), lambda t: exact(t)[2])
    refined = refine(Integrator(Counted(), tolerance=1e-10), *start, 0.0, 12.0, known)
    lengths = [w.length for w in refined.windows]
    assert max(lengths) >= 2.0 * min(lengths)
    assert np.abs(refined(np.array([12.0]))[0] - exact(np.array([12.0]))[0]).max() < 2e-10


def test_what_is_known_may_be_nonsense():
    """Then it is integrated from the beginning, or from where it leads astray."""
    start = np.array([2.0]), np.array([0.0])
    exact = Integrator(Counted(), tolerance=1e-13).run(*start, 0.0, 5.0)
    for acceleration in (lambda t: np.full((len(t), 1), np.nan), lambda t: 40.0 * np.sin(20.0 * t)[:, None]):
        known = KnownMotion(np.linspace(0.0, 5.0, 9), np.zeros(8, bool), acceleration)
        refined = refine(Integrator(Counted(), tolerance=1e-11), *start, 0.0, 5.0, known)
        assert np.abs(refined(np.array([5.0]))[0] - exact(np.array([5.0]))[0]).max() < 1e-9


class Bent:
    """Free fall onto an elastic floor: the force changes its law where x passes zero, with a jump of the slope."""

    def __call__(self, q, v, t):
        return -1.0 - 100.0 * np.minimum(q, 0.0) - 0.5 * v * (q < 0.0)

    def slopes(self, q, v, t, a):
        return -100.0 * (q < 0.0)[:, :, None].astype(float), -0.5 * (q < 0.0)[:, :, None].astype(float)


class Passing:
    """Breakpoints where x passes zero."""

    def __call__(self, window: Window, after: float) -> float | None:
        """First time at which x passes zero, by halving."""
        t = np.linspace(max(after, window.start), window.start + window.length, 65)
        for _ in range(10):
            below = window(t)[0][:, 0] < 0.0
            changed = np.flatnonzero(below[1:] != below[:-1])
            if not len(changed):
                return None
            t = np.linspace(t[changed[0]], t[changed[0] + 1], 65)
        return float(t[-1])

    def stated(self, after: float) -> float:
        return np.inf


break_time = Passing()


def test_windows_end_where_the_law_changes_in_the_new_motion():
    """The breakpoints of the motion that it started from are at other times; against a march to 1e-13."""
    start = np.array([0.3]), np.array([0.0])
    first = Integrator(Bent(), tolerance=1e-3, nodes=3, breakpoints=break_time).run(*start, 0.0, 6.0)
    exact = Integrator(Bent(), tolerance=1e-13, breakpoints=break_time).run(*start, 0.0, 6.0)
    known = KnownMotion(
        np.array([*(w.start for w in first.windows), 6.0]), np.array([w.cut for w in first.windows]), lambda t: first(t)[2]
    )
    assert known.cut.sum() > 5
    refined = refine(Integrator(Bent(), tolerance=1e-9, breakpoints=break_time), *start, 0.0, 6.0, known)
    t = np.linspace(0.0, 6.0, 301)
    miss, before = (np.abs(x(t)[0] - exact(t)[0]).max() for x in (refined, first))
    assert miss < 2e-9 and before > 100.0 * miss


def test_a_falsified_motion_is_found_out():
    """The estimate tells how wrong a motion is, also where it does not come from the tolerance: its companion does not follow."""
    run = run_scene(load("swinging-double-pendulum"), outputs=())
    t = np.linspace(0.0, 1.0, 33)
    for part in (1e-7, 1e-5):
        false = falsified(run.simulation, part)  # its windows no longer fit together
        truth = np.abs(false(t)[0] - run.simulation(t)[0]).max()
        assert truth > 1e-5 * part
        assert 0.1 < integration_error(false, t, run.resimulate)[-1] / truth < 10.0


def test_companion_is_not_marched(monkeypatch):
    """Nothing is integrated window by window for an estimate, not even with stops and events."""
    runs = [run_scene(load(name), outputs=()) for name in ("toggle-press-stop", "falling-four-bars", "coupled-carts")]
    calls, plain = [], Integrator.run
    monkeypatch.setattr(Integrator, "run", lambda *a: calls.append(a) or plain(*a))
    for run in runs:
        assert np.isfinite(integration_error(run.simulation, run.motion.time, run.resimulate)).all()
    assert not calls


def test_same_events_and_pieces():
    """Against the same tolerance without the motion that it is like: events, times, impacts."""
    run = run_scene(load("toggle-press-stop"), outputs=())
    one, other = run.resimulate(1e-11), run.resimulate(1e-11, None, run.simulation)
    assert [(h.kind, h.item) for h in one.events] == [(h.kind, h.item) for h in other.events]
    times = np.array([[h.time for h in x.events] for x in (one, other)])
    assert np.abs(times[0] - times[1]).max() < 1e-10
    assert other.evaluations < 0.3 * one.evaluations


def test_another_motion_helps_nothing_but_harms_nothing():
    """A start that is not near: the solution is that of the equations."""
    here, there = (pendulum(inertia=0.02, mass=1.0, distance=0.1, angle=angle) for angle in (0.5, 2.0))
    like = simulate(there, 2.0, tolerance=1e-9, method="gauss")
    exact = simulate(here, 2.0, tolerance=1e-12, method="gauss")
    simulation = simulate(here, 2.0, tolerance=1e-10, method="gauss", initial_guess=like)
    assert np.abs(simulation([2.0])[0] - exact([2.0])[0]).max() < 1e-9


def test_works_of_a_periodic_motion_are_found_for_one_period_only(monkeypatch):
    """A thousand turns in gravity: powers of one period are evaluated; works at any time are those of a ledger of all of them."""
    mechanism = pendulum(inertia=0.02, mass=1.0, distance=0.1, angle=0.5, speed=30.0)
    seen = []
    plain = simulation_module.powers_of
    monkeypatch.setattr(simulation_module, "powers_of", lambda m, f: seen.append(m.frames) or plain(m, f))
    period = simulate(mechanism, 1.0).segments[0].solution.period
    for turns, most in ((40, 2000), (10_000, 2000)):
        seen.clear()
        whole = simulate(mechanism, turns * period)
        t = np.array([0.3, 7.7, 20.25, 39.9, turns - 0.4, turns]) * period
        works = whole.energies(t)
        assert 0 < sum(seen) < most
        assert np.abs(whole.drift(t)).max() < 1e-9
        place = whole(t)[0][:, 0]
        assert np.abs(works[:, 1] - 9.81 * 0.1 * np.sin(place)).max() < 1e-9
    whole = simulate(mechanism, 40 * period)
    short = simulate(mechanism, 1.5 * period)  # not a whole number: no fold within it, or another one
    t = np.array([0.2, 0.9, 1.3]) * period
    assert np.abs(whole.work(t) - short.work(t)).max() < 1e-12
    assert np.abs(whole.work(t + 20 * period) - short.work(t)).max() < 1e-9
