"""A sketch says how the mechanism is put together where it is drawn; from there it is followed to the start of its drives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import mechviz
from mechcore.errors import MechanismError
from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.mechanism import Cylinder, Drive, Link, Mechanism, Revolute


def four_bar(lengths, start, sketch):
    r, coupler, rocker, d = lengths
    return Mechanism(
        name="four-bar",
        frame="frame",
        links=(
            Link(name="frame", points={"A": (0.0, 0.0), "D": (d, 0.0)}),
            Link(name="crank", points={"A": (0.0, 0.0), "B": (r, 0.0)}),
            Link(name="coupler", points={"B": (0.0, 0.0), "C": (coupler, 0.0)}),
            Link(name="rocker", points={"D": (0.0, 0.0), "C": (rocker, 0.0)}),
        ),
        joints=tuple(
            Revolute(name=n, links=links, points=(n, n))
            for n, links in (("A", ("frame", "crank")), ("B", ("crank", "coupler")), ("C", ("coupler", "rocker")),
                             ("D", ("frame", "rocker")))
        ),
        drives=(Drive(joint="A", law=ConstantSpeed(start, 1.0)),),
        sketch=sketch,
    )  # fmt: skip


def angles(lengths, crank, side):
    """Angles of coupler and rocker, by the law of cosines; None where the links do not reach each other."""
    r, coupler, rocker, d = lengths
    pin = r * np.exp(1j * crank)
    gap = abs(d - pin)
    cosine = (coupler**2 + gap**2 - rocker**2) / (2.0 * coupler * gap)
    if abs(cosine) >= 0.999:
        return None
    angle = np.angle(d - pin) + side * np.arccos(cosine)
    return float(angle), float(np.angle(pin + coupler * np.exp(1j * angle) - d))


def test_four_bars_are_followed_from_where_they_are_drawn():
    """Random lengths, drawn roughly at one crank angle and started at another: the side of the coupler stays."""
    rng = np.random.default_rng(1)
    count = 0
    while count < 120:
        lengths = rng.uniform(0.5, 3.0, 4)
        drawn, start, side = (*rng.uniform(-np.pi, np.pi, 2), rng.choice([1.0, -1.0]))
        way = drawn + np.linspace(0.0, np.remainder(start - drawn + np.pi, 2.0 * np.pi) - np.pi, 300)
        if any(angles(lengths, q, side) is None for q in way):
            continue
        count += 1
        coupler, rocker = np.array(angles(lengths, drawn, side)) + rng.uniform(-0.1, 0.1, 2)
        tip = lengths[0] * np.exp(1j * drawn)
        sketch = {"crank": (0.0, 0.0, drawn), "coupler": (tip.real, tip.imag, coupler), "rocker": (lengths[3], 0.0, rocker)}
        motion = solve_motion(compile_mechanism(four_bar(lengths, start, sketch)), [0.0])
        computed = [motion.pose(name)[0, 2] for name in ("coupler", "rocker")]
        np.testing.assert_allclose(np.exp(1j * np.array(computed)), np.exp(1j * np.array(angles(lengths, start, side))), atol=1e-7)


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    "name", ["crank-rocker", "triad", "eight-bar", "stephenson-six-bar", "jansen-leg", "excavator-arm", "shaper-quick-return"]
)
def test_a_sketch_of_any_frame_gives_the_motion_that_it_is_taken_from(name):
    mechanism = mechviz.load(name).mechanism
    compiled = compile_mechanism(mechanism)
    motion = solve_motion(compiled, default_times(mechanism, 12))
    moving = [link.name for link in mechanism.links if link.name != mechanism.frame]
    for k in (2, 5, 9):
        sketch = {link: tuple(map(float, motion.pose(link)[k])) for link in moving}
        again = solve_motion(compile_mechanism(replace(mechanism, sketch=sketch, modes={})), motion.time)
        for link in moving:
            a, b = again.pose(link), motion.pose(link)
            np.testing.assert_allclose(a[:, :2], b[:, :2], atol=1e-8 * compiled.model.length_scale)
            np.testing.assert_allclose(np.exp(1j * a[:, 2]), np.exp(1j * b[:, 2]), atol=1e-8)


def test_a_sketch_from_which_nothing_leads_to_the_start_is_refused():
    """Coupler and rocker reach each other at crank angles of 15 to 77 degrees on either side: in between they miss."""
    lengths, drawn = (2.0, 1.5, 1.0, 2.0), np.radians(40.0)
    coupler, rocker = angles(lengths, drawn, 1.0)
    tip = lengths[0] * np.exp(1j * drawn)
    sketch = {"crank": (0.0, 0.0, drawn), "coupler": (tip.real, tip.imag, coupler), "rocker": (2.0, 0.0, rocker)}
    assert solve_motion(compile_mechanism(four_bar(lengths, np.radians(60.0), sketch)), [0.0]).frames == 1
    with pytest.raises(MechanismError) as refused:
        compile_mechanism(four_bar(lengths, -drawn, sketch))
    (fault,) = refused.value.faults
    assert fault.path == "joints.C" and "the sketch is drawn at A = 40°" in fault.message and "cannot be led" in fault.message
    assert fault.remedy.startswith("Sketch the mechanism where its drives start, or state the assembly mode of the start instead: ")
    for mode in ("left", "right"):
        assert f'side = "{mode}" at C' in fault.remedy
        compile_mechanism(replace(four_bar(lengths, -drawn, {}), modes={"C": mode}))


def test_a_rough_sketch_of_the_start_need_not_be_one_that_can_be_assembled():
    """A crank drawn a degree beyond its limit, which starts within it."""
    lengths = (2.0, 1.5, 1.0, 2.0)
    limit = 2.0 * np.arcsin(2.5 / 4.0)
    coupler, rocker = angles(lengths, limit - 0.02, 1.0)
    sketch = {"crank": (0.0, 0.0, limit + 0.005), "coupler": (0.0, 0.0, coupler), "rocker": (0.0, 0.0, rocker)}
    motion = solve_motion(compile_mechanism(four_bar(lengths, limit - 0.01, sketch)), [0.0])
    assert motion.pose("rocker")[0, 2] == pytest.approx(angles(lengths, limit - 0.01, 1.0)[1], abs=1e-9)


def test_a_cylinder_is_drawn_by_its_two_points():
    """A boom that a cylinder lifts, drawn up and started down: it stays on its side of the line between the cylinder's pins."""

    def boom(angle):
        return 2.0 * np.exp(1j * angle)

    def length(angle):
        return abs(boom(angle) - 1.0)

    mechanism = Mechanism(
        name="boom",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0), "P": (1.0, 0.0)}),
            Link(name="boom", points={"O": (0.0, 0.0), "Q": (2.0, 0.0)}),
        ),
        joints=(
            Revolute(name="O", links=("frame", "boom"), points=("O", "O")),
            Cylinder(name="Z", links=("frame", "boom"), points=("P", "Q")),
        ),
        drives=(Drive(joint="Z", law=ConstantSpeed(length(-0.3), 0.01, 0.1)),),
        sketch={"boom": (0.0, 0.0, -2.9)},
    )
    motion = solve_motion(compile_mechanism(mechanism), [0.0])
    assert motion.pose("boom")[0, 2] == pytest.approx(-0.3, abs=1e-9)
