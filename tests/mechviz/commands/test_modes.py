"""All assembly modes of groups that no closed form solves, against other ways of counting them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import pin

from mechcore.branches.assembly import group_modes
from mechcore.kinematics.build import build_model
from mechcore.kinematics.state import initial_state
from mechcore.laws.timed import ConstantSpeed
from mechcore.spec.mechanism import Drive, Link, Mechanism

BASE = (0.0, 1.0, 0.3 + 1.2j)
PLATE = (0.0, 1.1, 0.25 - 1.15j)  # the other way round than the base: up to six modes


def platform(legs, base=BASE, plate=PLATE, sketch=None) -> Mechanism:
    """A plate on three legs between two pins each (3-RR, class III). The first base pin is on a driven crank of length 0.5."""
    links = (
        Link(name="frame", points={"O": (base[0].real - 0.5, 0.0), "B1": (base[1].real, 0.0), "B2": (base[2].real, base[2].imag)}),
        Link(name="crank", points={"O": (0.0, 0.0), "B0": (0.5, 0.0)}),
        *(Link(name=f"leg{i}", points={f"B{i}": (0.0, 0.0), f"P{i}": (float(r), 0.0)}) for i, r in enumerate(legs)),
        Link(name="plate", points={f"P{i}": (complex(z).real, complex(z).imag) for i, z in enumerate(plate)}),
    )
    joints = (
        pin("O", "frame", "crank"),
        pin("B0", "crank", "leg0"),
        pin("B1", "frame", "leg1"),
        pin("B2", "frame", "leg2"),
        *(pin(f"P{i}", f"leg{i}", "plate") for i in range(3)),
    )
    drives = (Drive(joint="O", law=ConstantSpeed(0.0, 1.0)),)
    return Mechanism(name="platform", frame="frame", links=links, joints=joints, drives=drives, sketch=sketch or {})


def plate_angles(legs, base=BASE, plate=PLATE) -> np.ndarray:
    """All real angles of the plate: roots of a polynomial of degree six in exp(i angle).

    Two of the three leg equations minus the first are linear in the plate's place; put into the first they leave a trigonometric
    polynomial of degree three (C. Gosselin, J. Sefrioui, M. Richard 1992: at most six assembly modes of the planar 3-RPR).
    """
    n = 16
    z = np.exp(2j * np.pi * np.arange(n) / n)
    q = [complex(p) * z - complex(b) for p, b in zip(plate, base, strict=True)]  # pin i minus base i, without the plate's place
    rows, rhs = [], []
    for i in (1, 2):
        d = q[i] - q[0]
        rows.append((2 * d.real, 2 * d.imag))
        rhs.append(legs[i] ** 2 - legs[0] ** 2 - abs(q[i]) ** 2 + abs(q[0]) ** 2)
    det = rows[0][0] * rows[1][1] - rows[0][1] * rows[1][0]
    x = rhs[0] * rows[1][1] - rows[0][1] * rhs[1]  # times det
    y = rows[0][0] * rhs[1] - rhs[0] * rows[1][0]
    values = (x + q[0].real * det) ** 2 + (y + q[0].imag * det) ** 2 - (legs[0] * det) ** 2
    c = np.fft.fft(values) / n  # coefficients of z^k
    assert np.abs(c[4:-3]).max() < 1e-9 * np.abs(c).max(), "degree three"
    roots = np.roots([c[3], c[2], c[1], c[0], c[-1], c[-2], c[-3]])
    return np.sort(np.angle(roots[np.abs(np.abs(roots) - 1.0) < 1e-7]))


def found_angles(mechanism: Mechanism, link: str) -> np.ndarray:
    """The link's angles in all modes that the core finds."""
    model = build_model(mechanism)
    (block,) = model.blocks
    modes = group_modes(model, block, initial_state(model, [np.float64(0.0)]))
    return np.sort(modes[:, block.angles.index(model.angles.group[model.index[link]])])


def test_every_mode_of_three_legged_platforms_is_found():
    """Random legs: the modes that the core finds are the real roots of the polynomial, from none to six."""
    rng = np.random.default_rng(5)
    counts = []
    for _ in range(80):
        legs = rng.uniform(0.5, 2.5, 3)
        expected = plate_angles(legs)
        angles = found_angles(platform(legs), "plate")
        assert len(angles) == len(expected), legs
        np.testing.assert_allclose(np.exp(1j * angles), np.exp(1j * expected), atol=1e-6)
        counts.append(len(angles))
    assert {0, 2, 6} <= set(counts)


@pytest.mark.parametrize("scale", [1e-6, 1e3])
def test_the_number_of_modes_does_not_depend_on_the_scale(scale):
    rng = np.random.default_rng(5)
    six = next(legs for legs in (rng.uniform(0.5, 2.5, 3) for _ in range(200)) if len(plate_angles(legs)) == 6)
    m = platform(six)
    large = tuple(Link(name=k.name, points={n: (scale * x, scale * y) for n, (x, y) in k.points.items()}) for k in m.links)
    np.testing.assert_allclose(found_angles(replace(m, links=large), "plate"), found_angles(m, "plate"), atol=1e-9)


def modes_of_eight_bar(at: dict[str, complex], samples: int = 40_001) -> np.ndarray:
    """Angles of the leg at B in all modes: both plates by circles, the last length by its changes of sign over a turn."""
    alpha = np.linspace(0.0, 2 * np.pi, samples)

    def closing(angle, first: float, second: float):
        """Length of the leg at L minus what it should be, with the crank's leg at this angle and both dyads in these modes."""
        p = at["B"] + abs(at["P"] - at["B"]) * np.exp(1j * angle)
        q = meet(p, abs(at["Q"] - at["P"]), at["J"], abs(at["Q"] - at["J"]), first)
        c = p + (q - p) * (at["C"] - at["P"]) / (at["Q"] - at["P"])
        r = meet(c, abs(at["R"] - at["C"]), at["K"], abs(at["R"] - at["K"]), second)
        s = c + (r - c) * (at["S"] - at["C"]) / (at["R"] - at["C"])
        return abs(s - at["L"]) - abs(at["S"] - at["L"])

    roots = []
    with np.errstate(invalid="ignore"):
        for first in (1.0, -1.0):
            for second in (1.0, -1.0):
                g = closing(alpha, first, second)
                k = np.flatnonzero(g[:-1] * g[1:] < 0)
                low, high = alpha[k], alpha[k + 1]
                for _ in range(60):
                    middle = 0.5 * (low + high)
                    same = closing(middle, first, second) * g[k] > 0
                    low, high = np.where(same, middle, low), np.where(same, high, middle)
                roots.append(0.5 * (low + high))
    return np.concatenate(roots)


def meet(a, ra, b, rb, side):
    """Where circles about a and b meet, on a side of the line from a to b."""
    d = abs(b - a)
    x = (ra**2 - rb**2 + d**2) / (2 * d)
    return a + (x + 1j * side * np.sqrt(ra**2 - x**2)) * (b - a) / d


def eight_bar(at: dict[str, complex]) -> Mechanism:
    """The eight-bar of the gallery, two ternary plates on four legs, with its pins at other places."""

    def link(name: str, points: str) -> Link:
        return Link(name=name, points={k: ((at[k] - at[points[0]]).real, (at[k] - at[points[0]]).imag) for k in points})

    at = {**at, "O": at["B"] - 0.5}
    moving = {"crank": "OB", "leg_B": "BP", "plate": "PQC", "plate2": "CRS", "leg_J": "JQ", "leg_K": "KR", "leg_L": "LS"}
    frame = Link(name="frame", points={k: (at[k].real, at[k].imag) for k in "OJKL"})
    joins = {"O": ("frame", "crank"), "B": ("crank", "leg_B"), "P": ("leg_B", "plate"), "Q": ("plate", "leg_J")}
    joins |= {"C": ("plate", "plate2"), "R": ("plate2", "leg_K"), "S": ("plate2", "leg_L")}
    joins |= {k: ("frame", f"leg_{k}") for k in "JKL"}
    return Mechanism(
        name="eight-bar",
        frame="frame",
        links=(frame, *(link(name, points) for name, points in moving.items())),
        joints=tuple(pin(k, *joint) for k, joint in joins.items()),
        drives=(Drive(joint="O", law=ConstantSpeed(0.0, 1.0)),),
    )


def test_every_mode_of_eight_bars_is_found():
    """One block of six links and three loops, at random places of the pins."""
    rng = np.random.default_rng(3)
    counts = []
    for k in range(13):
        at = {name: complex(*rng.uniform(0.0, 2.0, 2)) for name in "JKLBPCQRS"}
        if k not in (0, 2, 11, 12):
            continue
        model = build_model(eight_bar(at))
        (block,) = model.blocks
        assert (block.kind, len(block.angles), len(block.loops)) == ("general", 6, 3)
        modes = group_modes(model, block, initial_state(model, [np.float64(0.0)]))
        leg = block.angles.index(model.angles.group[model.index["leg_B"]])
        computed = np.exp(1j * (modes[:, leg] + np.angle(at["P"] - at["B"])))
        expected = np.exp(1j * modes_of_eight_bar(at))
        assert len(computed) == len(expected)
        assert np.abs(computed[:, None] - expected).min(axis=1).max() < 1e-8
        assert np.abs(computed[:, None] - expected).min(axis=0).max() < 1e-8
        counts.append(len(computed))
    assert max(counts) == 12
