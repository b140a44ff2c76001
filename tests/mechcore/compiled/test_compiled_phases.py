"""Motions with dry friction, impacts and stops that a compiled program follows over events: the same as by numpy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mechcore import spec as sp
from mechcore.compiled.toolchain import compiler
from mechcore.dynamics.event_integrator import EventIntegrator
from mechcore.dynamics.events import EndStop, EventKind
from mechcore.dynamics.simulate import simulate
from mechcore.dynamics.simulation import Simulation
from mechcore.laws.signals import Sine
from mechcore.laws.timed import ConstantSpeed, Free, Law, Oscillation, Table, zones
from mechcore.motion.solve import compile_mechanism
from mechcore.spec.mechanism import Drive, Friction, Mechanism
from mechviz.scene.scene import load

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")

POINTS = {"O": (0.0, 0.0), "P": (0.3, 0.0)}
BELTS: dict[str, Law] = {
    "constant": ConstantSpeed(0.0, 0.1, travel=1.0),
    "swinging": Oscillation(0.0, 0.05, 1.3, 0.4),
    "zones": zones(start=0.0, speed=0.2, run_up=0.05, steady=0.1, braking=0.08),
}


def blocks(count: int, *, friction: Friction | None, belt: Law | None, stiffness: float = 60.0) -> Mechanism:
    """Blocks in a row, each on a guide along x of the one before; the first one rests on the frame, or on a belt."""
    links = [sp.Link(name="frame", points=POINTS)]
    joints: list[sp.Joint] = []
    drives, before = [], "frame"
    if belt is not None:
        links.append(sp.Link(name="belt", points=POINTS, mass=1.0))
        joints.append(sp.Prismatic(name="B", links=("frame", "belt"), points=("O", "O")))
        drives, before = [Drive(joint="B", law=belt)], "belt"
    loads: list[sp.Load] = []
    for k in range(count):
        links.append(sp.Link(name=f"block{k}", points=POINTS, mass=1.0 + 0.3 * k))
        joints.append(sp.Prismatic(name=f"S{k}", links=(before, f"block{k}"), points=("O", "O"), friction=friction))
        drives.append(Drive(joint=f"S{k}", law=Free(0.01 * k, 0.2)))
        ends = {"links": ("frame", f"block{k}"), "points": ("P", "O")}
        loads.append(sp.Spring(name=f"spring{k}", **ends, stiffness=stiffness, free_length=0.3))  # type: ignore[arg-type]
        before = f"block{k}"
    effects = ("inertia", "gravity", *(["friction"] if friction is not None else []))
    return Mechanism(
        name="blocks",
        frame="frame",
        links=tuple(links),
        joints=tuple(joints),
        drives=tuple(drives),
        effects=effects,
        loads=tuple(loads),
    )


def both(m: Mechanism, duration: float, *stops: EndStop, tolerance: float = 1e-10) -> tuple[Simulation, Simulation]:
    """The motion by numpy and by C, which have to be the same."""
    by_numpy, by_c = (
        simulate(compile_mechanism(m, executor=executor), duration, tolerance=tolerance, stops=stops) for executor in ("numpy", "c")
    )
    same(by_numpy, by_c, duration)
    return by_numpy, by_c


def same(by_numpy: Simulation, by_c: Simulation, duration: float) -> None:
    """The same events, energy that impacts take, and places; accelerations jump at events."""
    assert [(e.kind, e.item, e.direction) for e in by_c.events] == [(e.kind, e.item, e.direction) for e in by_numpy.events]
    times = [[e.time for e in s.events] for s in (by_numpy, by_c)]
    np.testing.assert_allclose(times[1], times[0], atol=1e-8 * duration)
    losses = [np.array([x for _, x in s.impact_losses]) for s in (by_numpy, by_c)]
    np.testing.assert_allclose(losses[1], losses[0], atol=1e-8 * losses[0].max(initial=0.0))
    t = np.linspace(0.0, duration, 301)
    for a, b in zip(by_numpy(t)[:2], by_c(t)[:2], strict=True):
        assert np.abs(a - b).max() < 2e-7 * max(np.abs(a).max(), 1e-3)


@pytest.fixture
def decided(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many segments a program has made in each of its runs."""
    counts: list[int] = []
    whole = EventIntegrator._phases

    def counted(self: EventIntegrator, *state: object) -> object:
        before = len(self.segments)
        result = whole(self, *state)  # type: ignore[arg-type]
        counts.append(len(self.segments) - before)
        return result

    monkeypatch.setattr(EventIntegrator, "_phases", counted)
    return counts


@pytest.mark.parametrize("belt", list(BELTS))
def test_a_block_on_a_belt_sticks_and_slips(belt: str, decided: list[int]) -> None:
    rub = Friction(coefficient=0.15, static=0.25, length=0.1)
    numpy, _ = both(blocks(1, friction=rub, belt=BELTS[belt]), 4.0)
    assert sum(e.kind in (EventKind.STICK, EventKind.SLIP) for e in numpy.events) > 1
    assert max(decided) > 1


def test_friction_of_stribeck_and_a_brake(decided: list[int]) -> None:
    both(
        blocks(1, friction=Friction(coefficient=0.1, static=0.2, length=0.1, brake=0.3, stribeck=0.05), belt=BELTS["constant"]), 4.0
    )
    assert max(decided) > 2


@pytest.mark.parametrize("friction", [None, Friction(coefficient=0.05, static=0.1, length=0.1)])
@pytest.mark.parametrize("restitution", [1.0, 0.7])
def test_a_block_between_two_stops(friction: Friction | None, restitution: float, decided: list[int]) -> None:
    m = blocks(1, friction=friction, belt=None)
    m = replace(m, drives=(Drive(joint="S0", law=Free(0.03, 1.5)),))
    stops = [
        EndStop(name=side, joint="S0", at=at, side=side, restitution=restitution) for side, at in (("upper", 0.1), ("lower", -0.02))
    ]  # type: ignore[arg-type]
    numpy, _ = both(m, 2.0, *stops)
    assert len(numpy.impact_losses) >= 4 and max(decided) > 4


def test_what_comes_to_rest_on_a_stop_is_left_to_numpy(decided: list[int]) -> None:
    """A hammer bounces ever lower, rests, and is lifted again by a torque of the time."""
    scene = load("trip-hammer")
    assert scene.simulation is not None
    numpy, _ = both(scene.mechanism, 3.0, *scene.simulation.stops)
    kinds = {e.kind for e in numpy.events}
    assert {EventKind.IMPACT, EventKind.CONTACT, EventKind.RELEASE} <= kinds and max(decided) > 3


def test_a_stop_of_a_slide_that_is_not_free(decided: list[int]) -> None:
    scene = load("toggle-press-stop")
    assert scene.simulation is not None
    numpy, _ = both(scene.mechanism, 0.8, *scene.simulation.stops)
    assert len(numpy.impact_losses) >= 2 and max(decided) > 1


@pytest.mark.thorough
def test_a_machine_that_runs_down_by_friction_in_all_its_joints(decided: list[int]) -> None:
    scene = load("compressor-run-down")
    numpy, _ = both(scene.mechanism, 3.0, tolerance=1e-9)
    assert numpy.events[-1].kind is EventKind.STICK and max(decided) > 1


def test_of_several_freedoms_events_are_found_and_numpy_decides(decided: list[int]) -> None:
    rub = Friction(coefficient=0.1, static=0.2, length=0.1)
    numpy, _ = both(blocks(2, friction=rub, belt=None, stiffness=200.0), 1.5)
    assert len(numpy.events) > 4 and max(decided) == 1


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(8))
def test_random_blocks(seed: int) -> None:
    """Belts, friction, springs, swinging loads and stops as they come."""
    rng = np.random.default_rng(seed)
    low = rng.uniform(0.02, 0.2)
    rub = Friction(coefficient=low, static=low * rng.uniform(1.0, 2.0), length=0.1, stribeck=rng.choice([0.0, 0.1]))
    belt = BELTS[rng.choice(list(BELTS))] if seed % 2 else None
    m = blocks(1, friction=rub, belt=belt, stiffness=rng.uniform(20.0, 400.0))
    signal = [
        Sine(frequency=rng.uniform(0.5, 3.0)),
        Table(x=(0.0, 0.3, 0.5, 1.0), y=(0.0, 2.0, -1.0, 0.0), period=1.2, smooth=False),
    ][seed % 4 // 2]
    push = sp.Force(
        name="push", link="block0", point="O", vector=(rng.uniform(2.0, 8.0), 0.0), factor=sp.Factor(of="time", function=signal)
    )
    m = replace(m, loads=(*m.loads, push))
    stop = EndStop(name="end", joint="S0", at=0.04, restitution=rng.uniform(0.3, 1.0))
    both(m, 3.0, *([] if belt is not None else [stop]))
