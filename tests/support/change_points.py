"""Four-bars and chains at change points, or beside them by a margin."""

from __future__ import annotations

import numpy as np
from mechanisms import four_bar

from mechcore.laws.timed import ConstantSpeed
from mechcore.spec.mechanism import Drive


def coupled(modes: tuple[str, ...], turns: tuple[float, ...], frame: float):
    """Four-bars with two pairs of equal links in a row; each crank stands ``turns`` ahead of the output before it."""
    from mechcore.spec.mechanism import Link, Mechanism, Revolute

    n = len(modes)
    links = [Link(name="frame", points={f"A{i}": (frame * i, 0.0) for i in range(n + 1)})]
    joints = []
    for i in range(n + 1):
        ahead = turns[i]
        links.append(Link(name=f"c{i}", points={"A": (0.0, 0.0), "in": (1.0, 0.0), "out": (np.cos(ahead), np.sin(ahead))}))
        joints.append(Revolute(name=f"A{i}", links=("frame", f"c{i}"), points=(f"A{i}", "A")))
    for i in range(n):
        links.append(Link(name=f"k{i}", points={"L": (0.0, 0.0), "R": (frame, 0.0)}))
        joints.append(Revolute(name=f"L{i}", links=(f"c{i}", f"k{i}"), points=("out", "L")))
        joints.append(Revolute(name=f"R{i}", links=(f"k{i}", f"c{i + 1}"), points=("R", "in")))
    drive = Drive(joint="A0", law=ConstantSpeed(0.5, 1.0))
    modes_at = {f"R{i}": m for i, m in enumerate(modes)}
    return Mechanism(name="coupled", frame="frame", links=tuple(links), joints=tuple(joints), drives=(drive,), modes=modes_at)


def misses_by(margin: float):
    """Frame and crank in line are longer than coupler and rocker by ``margin``: only there the links do not reach."""
    return four_bar(E=(3.0, 0.0), AB=1.0, BD=2.5, DE=1.5 - margin, start=0.3)
