"""Chains of four-bars with lengths that agree, almost agree or do not: a motion, or a refusal in words; never a warning."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from cases import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from mechcore.errors import MechanismError
from mechcore.laws.timed import ConstantSpeed, Oscillation
from mechcore.motion.reach import reachable_ranges
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.mechanism import Drive, Link, Mechanism, Revolute

Loop = tuple[float, float, float, float]  # frame, crank, coupler, rocker


def chain(loops: list[Loop], modes: list[str], law) -> Mechanism:
    """Four-bars in a row: the rocker of each is the crank of the next, of that one's length."""
    feet = np.concatenate([[0.0], np.cumsum([ground for ground, *_ in loops])])
    arms = [loops[0][1], *(rocker for *_, rocker in loops)]
    links = [Link(name="frame", points={f"A{i}": (float(x), 0.0) for i, x in enumerate(feet)})]
    links += [Link(name=f"v{i}", points={"A": (0.0, 0.0), "B": (arm, 0.0)}) for i, arm in enumerate(arms)]
    links += [Link(name=f"h{i}", points={"L": (0.0, 0.0), "R": (loop[2], 0.0)}) for i, loop in enumerate(loops)]
    joints = [Revolute(name=f"A{i}", links=("frame", f"v{i}"), points=(f"A{i}", "A")) for i in range(len(arms))]
    for i in range(len(loops)):
        joints.append(Revolute(name=f"L{i}", links=(f"v{i}", f"h{i}"), points=("B", "L")))
        joints.append(Revolute(name=f"R{i}", links=(f"h{i}", f"v{i + 1}"), points=("R", "B")))
    drives = (Drive(joint="A0", law=law),)
    stated = {f"R{i}": mode for i, mode in enumerate(modes)}
    return Mechanism(name="chain", frame="frame", links=tuple(links), joints=tuple(joints), drives=drives, modes=stated)


lengths = st.sampled_from([1.0, 2.0, 3.0, 4.0])
almost = st.one_of(st.just(0.0), st.builds(lambda s, e: s * 10.0**e, st.sampled_from([-1.0, 1.0]), st.floats(-14.0, -1.0)))
loops_of = st.lists(st.tuples(lengths, lengths, lengths, lengths, almost), min_size=1, max_size=4)
laws = st.one_of(
    st.builds(ConstantSpeed, st.sampled_from([0.5, 1.0, -0.7]), st.just(1.0)),
    st.builds(Oscillation, st.sampled_from([0.5, 1.0]), st.sampled_from([0.5, 1.0, np.pi - 0.5]), st.just(1.0)),
)


@settings(max_examples=examples(200))
@given(loops_of, st.lists(st.sampled_from(["left", "right"]), min_size=4, max_size=4), laws, st.sampled_from([24, 90]))
def test_a_chain_moves_or_is_refused(loops, modes, law, frames):
    rows = [(a, b, c + off, d) for a, b, c, d, off in loops]
    m = chain(rows, modes[: len(rows)], law)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            motion = solve_motion(compile_mechanism(m), default_times(m, frames))
        except MechanismError as e:
            assert "cannot be assembled" in str(e) or "at the same point" in str(e)
            return
        assert motion.closure.max() < 1e-11 * motion.model.length_scale
        for link in motion.model.links[1:]:
            assert np.isfinite(motion.pose(link)).all()
            motion.velocity(link), motion.acceleration(link)


def test_a_mechanism_that_fits_together_in_one_position_only():
    """Coupler and rocker just span the way from the crank's pin at its nearest: no range to keep the drive within."""
    for short in (0.0, 3e-16):
        m = chain([(3.0, 1.0, 1.2, 0.8 - short)], ["left"], ConstantSpeed(0.0, 1.0))
        compiled = compile_mechanism(m)
        assert all(high - low < 1e-6 for low, high in reachable_ranges(compiled))
        with pytest.raises(MechanismError, match="cannot be assembled for positions of drive A0"):
            solve_motion(compiled, [0.0, 0.1, 0.2])


def test_a_refusal_without_any_range_that_can_be_reached(monkeypatch):
    monkeypatch.setattr("mechcore.motion.solve.reachable_ranges", lambda compiled: [])
    m = chain([(3.0, 1.0, 1.2, 0.8)], ["left"], ConstantSpeed(0.0, 1.0))
    with pytest.raises(MechanismError, match=r"Change the length of one of its links by more than that\.$") as e:
        solve_motion(compile_mechanism(m), [0.0, 0.1, 0.2])
    assert "keep the drive within" not in str(e.value)
