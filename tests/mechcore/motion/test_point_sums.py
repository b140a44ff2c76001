"""Points as sums that are looked up once per model, against the way from link to link along the tree."""

import numpy as np
import pytest
from mechanisms import case, lever, watt_six_bar

from mechcore.laws.timed import ConstantSpeed, Oscillation
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.mechanism import Drive, Link, Mechanism, Prismatic, Revolute

TIME = np.linspace(0.0, 1.0, 17)


def telescope(guide: int) -> Mechanism:
    """An arm that turns while a block slides out; the guide belongs to the arm (0) or to the block (1)."""
    return Mechanism(
        name="telescope",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.2, 0.1)}),
            Link(name="arm", points={"O": (0.1, 0.0), "S": (1.0, 0.2)}),
            Link(name="block", points={"S": (0.3, 0.1), "Q": (0.3, 0.4)}),
        ),
        joints=(
            Revolute(name="O", links=("frame", "arm"), points=("O", "O")),
            Prismatic(name="S", links=("arm", "block"), points=("S", "S"), along=(1.0, 0.5), guide=guide, angle=0.3),
        ),
        drives=(Drive(joint="O", law=Oscillation(0.4, 0.8, 1.1)), Drive(joint="S", law=Oscillation(0.5, 0.2, 0.7))),
    )


def agree(motion):
    """Every named point and its derivatives, both ways; returns the signs with which slides entered."""
    m, signs = motion.model, set()
    size = [max(float(np.abs(motion.origin(k, d)).max()) for k in range(len(m.links))) + m.length_scale for d in range(3)]
    for k, link in enumerate(m.links):
        for name, local in m.points[k].items():
            signs |= {float((d / m.guides[j][1]).real) for j, _, d in m.named_points[link, name].slides}
            for d in range(3):
                z = np.broadcast_to(motion.origin(k, d) + motion.offset(k, local, d), motion.frames)
                np.testing.assert_allclose(motion.point(link, name, d) @ (1.0, 1j), z, rtol=0.0, atol=1e-13 * size[d])
    return signs


@pytest.mark.parametrize(("guide", "sign"), [(0, 1.0), (1, -1.0)])
def test_slide_on_a_guide_of_either_link(guide, sign):
    assert agree(solve_motion(compile_mechanism(telescope(guide)), TIME)) == {sign}


def test_closed_mechanisms():
    shaper = case("lever_contour", "lever-quick-return-shaper")["inputs"]["geometry"]
    for mechanism in (
        lever(shaper, law=Oscillation(0.5, 0.3, 1.0)),
        watt_six_bar(case("linkages", "sixbar-watt")["inputs"], speed=1.0),
    ):
        agree(solve_motion(compile_mechanism(mechanism), TIME))


def test_long_chains_go_from_link_to_link():
    """Beyond a few terms the sum would cost more than the way along the tree, which shares what is common."""
    n = 9
    links = [Link(name="frame", points={"P0": (0.0, 0.0)})]
    links += [Link(name=f"k{i}", points={f"P{i}": (0.0, 0.0), f"P{i + 1}": (1.0, 0.1)}) for i in range(n)]
    names = ["frame", *(f"k{i}" for i in range(n))]
    arm = Mechanism(
        name="arm",
        frame="frame",
        links=tuple(links),
        joints=tuple(Revolute(name=f"J{i}", links=(names[i], names[i + 1]), points=(f"P{i}", f"P{i}")) for i in range(n)),
        drives=tuple(Drive(joint=f"J{i}", law=ConstantSpeed(0.1 * i, 0.3)) for i in range(n)),
    )
    motion = solve_motion(compile_mechanism(arm), TIME)
    assert ("k8", "P9") not in motion.model.named_points
    angle = np.cumsum([0.1 * i + 0.3 * TIME for i in range(n)], axis=0)
    speed = 0.3 * np.arange(1, n + 1)[:, None]
    z = (1.0 + 0.1j) * np.exp(1j * angle)
    for d in range(3):
        np.testing.assert_allclose(motion.point("k8", "P9", d) @ (1.0, 1j), ((1j * speed) ** d * z).sum(axis=0), rtol=1e-12)
