"""Columns of reference values compared with results, and the linkage of class three that several tests share."""

from __future__ import annotations

import numpy as np
from mechanisms import case, pin

from mechcore.laws.timed import ConstantSpeed
from mechcore.spec.mechanism import Drive, Link, Mechanism

RTOL = 1e-10


def close(got, expected, rtol=RTOL):
    """Relative to the largest entry of a column, so that components that pass through zero are compared with their neighbours."""
    got, expected = np.asarray(got, float), np.asarray(expected, float)
    scale = np.maximum(np.abs(expected).max(axis=0), 1e-12)
    np.testing.assert_array_less(np.abs(got - expected) / scale, rtol)


def column(rows, key):
    return np.array([r[key] for r in rows], float)


def class_three() -> Mechanism:
    """The six-link mechanism with a class-III group of `misc.json`."""
    i = case("misc", "assur-class-III")["inputs"]
    x, y, phi = i["start_guess_at_theta_0"]
    p = x + 1j * y
    at = {k: p + complex(*i[k]) * np.exp(1j * phi) for k in "PQR"}
    b, n1, n2 = i["r"] + 0j, complex(*i["N1"]), complex(*i["N2"])
    rough = {
        "a": (b.real, b.imag, np.angle(at["P"] - b)),
        "ternary": (x, y, phi),
        "b": (*i["N1"], np.angle(at["Q"] - n1)),
        "c": (*i["N2"], np.angle(at["R"] - n2)),
    }
    return Mechanism(
        name="triad",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0), "N1": tuple(i["N1"]), "N2": tuple(i["N2"])}),
            Link(name="crank", points={"O": (0.0, 0.0), "B": (i["r"], 0.0)}),
            Link(name="a", points={"B": (0.0, 0.0), "P": (i["la"], 0.0)}),
            Link(name="ternary", points={k: tuple(i[k]) for k in "PQR"}),
            Link(name="b", points={"N1": (0.0, 0.0), "Q": (i["lb"], 0.0)}),
            Link(name="c", points={"N2": (0.0, 0.0), "R": (i["lc"], 0.0)}),
        ),
        joints=(
            pin("O", "frame", "crank"),
            pin("B", "crank", "a"),
            pin("P", "a", "ternary"),
            pin("Q", "b", "ternary"),
            pin("R", "c", "ternary"),
            pin("N1", "frame", "b"),
            pin("N2", "frame", "c"),
        ),
        drives=(Drive(joint="O", law=ConstantSpeed(0.0, i["omega_1"])),),
        sketch=rough,
    )
