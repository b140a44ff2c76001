"""Dry friction and end stops in motions under forces, by a compiled program: the same as by numpy, to rounding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_mechanisms import draw

from mechcore import spec as sp
from mechcore.compiled.toolchain import compiler
from mechcore.dynamics.contact.dry_friction import DrySystem
from mechcore.dynamics.contact.friction_state import braking_elements
from mechcore.dynamics.simulate import simulate
from mechcore.errors import MechanismError
from mechcore.laws.timed import Free
from mechcore.motion.solve import compile_mechanism
from mechcore.spec.mechanism import Drive, Friction, Mechanism, Prismatic, Revolute
from mechviz.scene.scene import load

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")

RANDOM = (("inverted slider-crank", 0), ("pin in slot", 1), ("planetary gear", 0), ("several drives", 1))


def rubbing(m: Mechanism) -> Mechanism:
    """Friction in all pins and guides, some of it of the Stribeck kind, and a brake."""
    joints = list(m.joints)
    for k, joint in enumerate(joints):
        if isinstance(joint, Revolute):
            joints[k] = replace(
                joint, friction=Friction(coefficient=0.03, static=0.05, radius=0.02, brake=0.01 * (k == 0), stribeck=0.1 * (k % 2))
            )
        elif isinstance(joint, Prismatic):
            joints[k] = replace(joint, friction=Friction(coefficient=0.03, static=0.04, length=0.3, height=0.02))
    return replace(m, joints=tuple(joints), effects=(*m.effects, "friction"))


@pytest.mark.sample(2)
@pytest.mark.parametrize(("kind", "seed"), RANDOM)
def test_friction_at_any_instant_is_the_same(kind: str, seed: int) -> None:
    """Whatever slides or sticks, with the coefficients of sticking, and while a joint rests on a stop."""
    compiled = compile_mechanism(rubbing(draw(kind, seed, forces=True).mechanism))
    m, rng = compiled.mechanism, np.random.default_rng(seed)
    start, steps = np.array([[float(d.law(0.0)[k]) for d in m.drives] for k in (0, 1)]), np.linspace(0.0, 1.0, 5)[:, None]
    q, v, t = start[0] + 0.02 * steps, start[1] * (1.0 + steps), 0.01 * steps[:, 0]
    last = next(j.name for j in m.joints[::-1] if isinstance(j, Revolute | Prismatic))
    for rests, breaking in (((), False), ((), True), ((last,), False)):
        signs = rng.choice([-1.0, 1.0], len(braking_elements(compiled, q[0], v[0])))
        signs[-1] = 0.0
        by_numpy, by_c = (DrySystem(replace(compiled, executor=e), signs, rests=rests, breaking=breaking) for e in ("numpy", "c"))
        program = by_c.program()
        assert program is not None
        expected, state = by_numpy.solve(q, v, t), program.friction_state(q, v, t)
        assert state.solved and len(signs) > 2
        for name in ("acceleration", "value", "limit", "rate", "second"):
            whole, own = getattr(expected, name), getattr(state, name)
            assert np.abs(own - whole).max() <= 1e-11 * max(np.abs(whole).max(), 1e-3), name
        if rests:
            np.testing.assert_allclose(state.holding, by_numpy.holding(q, v, t), rtol=1e-10)


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", ["stick-slip-feed", "compressor-run-down", "lifted-boom"])
def test_motions_with_contacts_are_the_same(name: str) -> None:
    """Segments end at the same events, by which the energy balance holds; what C does not have would be left to numpy."""
    scene = load(name)
    assert scene.simulation is not None
    ask = {"tolerance": scene.simulation.tolerance, "stops": scene.simulation.stops}
    by_numpy, by_c = (
        simulate(compile_mechanism(scene.mechanism, executor=e), scene.simulation.duration, **ask) for e in ("numpy", "c")
    )
    t = np.linspace(0.0, scene.simulation.duration, 41)
    for a, b in zip(by_numpy(t), by_c(t), strict=True):
        assert np.abs(a - b).max() < 1e-11 * np.abs(a).max()
    assert [e.text for e in by_numpy.events] == [e.text for e in by_c.events] and len(by_c.events) > 3
    np.testing.assert_allclose([e.time for e in by_c.events], [e.time for e in by_numpy.events], atol=1e-12 * t[-1])
    contacts = [s.system.program() for s in by_c.segments if isinstance(s.system, DrySystem) or s.resting]
    assert contacts and all(contacts)


def test_a_jam_is_told_as_by_numpy() -> None:
    """A tall sleeve in a short bearing, pushed: C finds no friction, and leaves it to numpy to say why."""
    links = (
        sp.Link(name="frame", points={"G": (0.0, 0.0)}),
        sp.Link(name="sleeve", points={"P": (0.0, 0.0)}, mass=1.0, centre=(0.0, 0.4), inertia=0.05),
    )
    m = Mechanism(
        name="sleeve",
        frame="frame",
        links=links,
        joints=(
            Prismatic(name="S", links=("frame", "sleeve"), points=("G", "P"), friction=Friction(coefficient=3.0, length=0.01)),
        ),
        drives=(Drive(joint="S", law=Free(0.0, 1.0)),),
        effects=("inertia", "gravity", "friction"),
        loads=(sp.Force(name="push", link="sleeve", point="P", vector=(1.0, 0.0)),),
    )
    compiled, one = compile_mechanism(m, executor="c"), np.ones((1, 1))
    program = DrySystem(compiled, one[0]).program()
    assert program is not None and not program.friction_state(one, one, one[0]).solved
    with pytest.raises(MechanismError, match=r"joints\.S\.friction: .*jams in motion"):
        simulate(compiled, 1.0)
