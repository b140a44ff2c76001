"""Mechanisms with three drives that cannot be assembled: by how much their links miss each other, and where they run."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from mechcore.errors import MechanismError
from mechcore.laws.timed import ConstantSpeed, Oscillation
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.mechanism import Drive, Link, Mechanism
from mechviz.hard_cases.mechanisms import pin

TIME = np.linspace(0.0, 1.0, 181)


def six_bar(rng: np.random.Generator) -> Mechanism:
    """A loop of six links, pins A, B and D driven, closed by the dyad P-Q-R."""
    one, two, three = rng.uniform(0.05, 0.2, 3)
    rods = rng.uniform(0.1, 0.25, 2)
    at = {"A": (0.0, 0.0), "D": (rng.uniform(0.15, 0.4), 0.0)}
    bars: tuple = (("one", "A", "B", one), ("two", "B", "P", two), ("rod", "P", "Q", rods[0]), ("other", "Q", "R", rods[1]))
    bars = (*bars, ("three", "D", "R", three))
    links = [Link(name=n, points={p: (0.0, 0.0), q: (float(length), 0.0)}) for n, p, q, length in bars]
    ends = (("A", "frame", "one"), ("B", "one", "two"), ("P", "two", "rod"), ("Q", "rod", "other"), ("R", "other", "three"))
    starts, swings = rng.uniform(-np.pi, np.pi, 3), rng.uniform(-1.0, 1.0, 2)
    others = [Oscillation(q, float(a), float(rng.uniform(0.5, 2.0))) for q, a in zip(starts[1:], swings, strict=True)]
    laws = (ConstantSpeed(float(starts[0]), 2.0 * np.pi), *others)
    return Mechanism(
        name="six-bar",
        frame="frame",
        links=(Link(name="frame", points=at), *links),
        joints=(*(pin(*e) for e in ends), pin("D", "frame", "three")),
        drives=tuple(Drive(joint=p, law=law) for p, law in zip("ABD", laws, strict=True)),
        modes={"Q": "left"},
    )


def miss_of_dyad(mechanism: Mechanism, a: np.ndarray, t: np.ndarray) -> np.ndarray:
    """By the triangle of the two rods and the distance of their outer pins, drive A at ``a``, the others at times ``t``."""
    at = {(k.name, p): complex(*where) for k in mechanism.links for p, where in k.points.items()}
    b, d = (drive.law(t)[0] for drive in mechanism.drives[1:])
    first = at["one", "B"] * np.exp(1j * a) + at["two", "P"] * np.exp(1j * (a + b))
    apart = abs(first - at["frame", "D"] - at["three", "R"] * np.exp(1j * d))
    rods = abs(at["rod", "Q"]), abs(at["other", "R"])
    return np.maximum(np.maximum(apart - sum(rods), abs(rods[0] - rods[1]) - apart), 0.0)


def refused(mechanism: Mechanism) -> str:
    try:
        solve_motion(compile_mechanism(mechanism), TIME)
    except MechanismError as error:
        return str(error)
    return ""


def number(pattern: str, text: str) -> tuple[float, ...]:
    match = re.search(pattern, text)
    return tuple(map(float, match.groups())) if match else ()


def test_three_drives_of_a_six_bar():
    """The miss is that of the triangle; in the proposed range the first drive runs wherever the others are, beyond it does not."""
    ranges = ended = 0
    fine = np.linspace(0.0, 1.0, 20001)
    for seed in range(40):
        rng = np.random.default_rng([1, seed])
        mechanism = six_bar(rng)
        a = mechanism.drives[0].law
        if miss_of_dyad(mechanism, np.array([a.start]), np.zeros(1)) > 0.0 or not (text := refused(mechanism)):
            continue
        (miss,) = number(r"miss each other by up to ([\d.]+) mm", text)
        assert 1e-3 * miss == pytest.approx(miss_of_dyad(mechanism, a(fine)[0], fine).max(), rel=1e-4)
        if within := number(r"keep drive A within \[(-?[\d.]+)°, (-?[\d.]+)°\]", text):
            ranges += 1
            low, high = np.radians(within)
            assert low < a.start < high
            for q in (low, high, *rng.uniform(low, high, 5)):
                assert miss_of_dyad(mechanism, np.array(q), fine).max() == 0.0
            for beyond in (low - 1e-4, high + 1e-4):
                if abs(beyond - a.start) < np.pi - 1e-3:  # farther than half a turn from the start nothing is looked at
                    assert miss_of_dyad(mechanism, np.array(beyond), fine).max() > 0.0
            run = Oscillation(0.5 * (low + high), 0.5 * (high - low), 3.0, float(rng.uniform(0.0, 6.0)))
            others = mechanism.drives[1:]
            assert not refused(replace(mechanism, drives=(Drive(joint="A", law=run), *others)))
        elif end := number(r"end the motion at ([\d.e-]+) s", text):
            ended += 1
            until = np.linspace(0.0, end[0], 2001)
            assert miss_of_dyad(mechanism, a(until)[0], until).max() == 0.0
    assert ranges >= 5 and ended >= 3


def platform(rng: np.random.Generator) -> tuple[Mechanism, tuple[np.ndarray, ...]]:
    """A plate on three rods, each on a driven crank; what tells its shape: pivots, the plate's pins, cranks, rods."""
    pivots, plate = 0.5 * np.array([0.0, 1.0, 0.5 + 0.87j]), np.array([0.0, 0.15, 0.075 + 0.13j])
    cranks, starts = rng.uniform(0.08, 0.15, 3), rng.uniform(-np.pi, np.pi, 3)
    pose, turned = pivots.mean() - plate.mean() + 0.03 * complex(*rng.normal(size=2)), float(rng.uniform(-0.3, 0.3))
    outer = pivots + cranks * np.exp(1j * starts)
    reach = pose + plate * np.exp(1j * turned) - outer
    links = [
        Link(name="frame", points={f"A{i}": (z.real, z.imag) for i, z in enumerate(pivots)}),
        Link(name="plate", points={f"C{i}": (z.real, z.imag) for i, z in enumerate(plate)}),
    ]
    joints, drives, sketch = [], [], {"plate": (pose.real, pose.imag, turned)}
    for i in range(3):
        links.append(Link(name=f"crank{i}", points={f"A{i}": (0.0, 0.0), f"B{i}": (float(cranks[i]), 0.0)}))
        links.append(Link(name=f"rod{i}", points={f"B{i}": (0.0, 0.0), f"C{i}": (float(abs(reach[i])), 0.0)}))
        ends = ((f"A{i}", "frame", f"crank{i}"), (f"B{i}", f"crank{i}", f"rod{i}"), (f"C{i}", f"rod{i}", "plate"))
        joints += [pin(*e) for e in ends]
        law = Oscillation(float(starts[i]), float(rng.uniform(0.2, 1.2)), float(rng.integers(1, 3)))
        drives.append(Drive(joint=f"A{i}", law=law if i else ConstantSpeed(float(starts[0]), 2.0 * np.pi)))
        sketch[f"rod{i}"] = outer[i].real, outer[i].imag, float(np.angle(reach[i]))
    mechanism = Mechanism(
        name="platform", frame="frame", links=tuple(links), joints=tuple(joints), drives=tuple(drives), sketch=sketch
    )
    return mechanism, (pivots, plate, cranks, abs(reach))


def miss_of_platform(shape: tuple[np.ndarray, ...], q: list[float]) -> float:
    """One rod's pin is open: the plate moves as the coupler of a four-bar, of whose curve the rod misses the nearest point."""
    pivots, plate, cranks, rods = shape
    outer, best = pivots + cranks * np.exp(1j * np.array(q)), np.inf
    for k, i, j in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        first = outer[i] + rods[i] * np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 2001))
        side, to = plate[j] - plate[i], outer[j] - first
        cosine = (abs(to) ** 2 + abs(side) ** 2 - rods[j] ** 2) / (2.0 * abs(to) * abs(side))
        for sign in (1.0, -1.0):
            with np.errstate(invalid="ignore"):
                turn = np.exp(1j * (np.angle(to / side) + sign * np.arccos(cosine)))
            far = abs(abs(first + (plate[k] - plate[i]) * turn - outer[k]) - rods[k])
            best = min(best, float(np.fmin.reduce(far, initial=np.inf)))
    return best


def test_three_drives_of_a_platform():
    """The miss of a group without a closed form: the least way that one joint stays open while the others are closed."""
    told = 0
    for seed in range(4):
        mechanism, shape = platform(np.random.default_rng(seed))
        if not (text := refused(mechanism)):
            continue
        misses = [miss_of_platform(shape, [float(d.law(t)[0]) for d in mechanism.drives]) for t in TIME]
        if np.isinf(misses).any():
            assert "not at one joint alone. Change the lengths of several" in text
        else:
            told += 1
            (miss,) = number(r"miss each other by up to ([\d.]+) mm", text)
            assert 1e-3 * miss == pytest.approx(max(misses), rel=2e-3)
        if end := number(r"end the motion at ([\d.e-]+) s", text):
            solve_motion(compile_mechanism(mechanism), np.linspace(0.0, end[0], 50))
    assert told >= 3
