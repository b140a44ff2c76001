"""Mechanisms with friction that several tests use, and the friction law checked from published results only."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from mechanisms import case, four_bar, slider_crank

from mechcore.forces.kinetostatics import Forces
from mechcore.laws.timed import ConstantSpeed
from mechcore.spec.loads import Force
from mechcore.spec.mechanism import Drive, Friction, Link, Mechanism, PinSlot, Prismatic, Revolute


def rub(mechanism: Mechanism, **frictions: Friction) -> Mechanism:
    """The mechanism with friction in some joints, and the effect named."""
    joints: Any = tuple(replace(p, friction=frictions[p.name]) if p.name in frictions else p for p in mechanism.joints)
    effects = mechanism.effects if "friction" in mechanism.effects else (*mechanism.effects, "friction")
    return replace(mechanism, joints=joints, effects=effects)


def reference_slider_crank(scale: float = 1.0) -> tuple[Mechanism, dict[str, Any]]:
    """The reference case, its coefficients times ``scale``."""
    c = case("friction", "friction-slider-crank")
    i = c["inputs"]
    m = slider_crank(
        r=i["r"],
        l=i["l"],
        e=i["e"],
        bodies={"crank": (i["m1"], i["C1"], i["J1"]), "rod": (i["m2"], i["C2"], i["J2"]), "piston": (i["m3"], (0.0, 0.0), 0.0)},
        loads=(Force(name="F", link="piston", point="C", vector=(i["F_piston"], 0.0)),),
        effects=("inertia", "gravity"),
        speed=i["omega_1"],
    )
    journal = Friction(coefficient=scale * i["mu_pin"], radius=i["r_pin"])
    return rub(m, O=journal, B=journal, C=journal, S=Friction(coefficient=scale * i["mu_guide"])), c


def reference_four_bar() -> tuple[Mechanism, dict[str, Any]]:
    from mechcore.spec.loads import Torque

    c = case("friction", "friction-fourbar")
    i = c["inputs"]
    m = four_bar(
        E=i["E"],
        AB=i["AB"],
        BD=i["BD"],
        DE=i["DE"],
        bodies={n: (i[f"m{k}"], i[f"C{k}"], i[f"J{k}"]) for k, n in enumerate(("crank", "coupler", "rocker"), 1)},
        loads=(Torque(name="M", link="rocker", moment=i["M_rocker"]),),
        effects=("inertia", "gravity"),
        speed=i["omega_1"],
    )
    journal = Friction(coefficient=i["mu_pin"], radius=i["r_pin"])
    return rub(m, A=journal, B=journal, D=journal, E=journal), c


def follower(alpha: float, a: float, b: float, mu: float, load: float) -> Mechanism:
    """A follower that a face at the pressure angle alpha lifts at the overhang a below its guide of length b (drive H)."""
    tip = -(a + b / 2)
    return Mechanism(
        name="follower",
        frame="frame",
        links=(
            Link(name="frame", points={"G": (0.0, 0.0), "O": (0.0, tip)}),
            Link(name="follower", points={"T": (0.0, 0.0)}),
            Link(name="wedge", points={"O": (0.0, 0.0)}),
        ),
        joints=(
            Prismatic(
                name="S",
                links=("frame", "follower"),
                points=("G", "T"),
                along=(0.0, 1.0),
                friction=Friction(coefficient=mu, length=b, bearing="guide"),
            ),
            Prismatic(name="H", links=("frame", "wedge"), points=("O", "O")),
            PinSlot(name="K", links=("wedge", "follower"), points=("O", "T"), along=(np.cos(alpha), -np.sin(alpha))),
        ),
        drives=(Drive(joint="H", law=ConstantSpeed(0.0, 0.1)),),
        loads=(Force(name="P", link="follower", point="T", vector=(0.0, -load)),),
        effects=("friction",),
    )


def law_of_friction(forces: Forces) -> float:
    """Largest relative error of Coulomb's law over all joints and frames, from reactions and motions alone; jams left out."""
    worst = 0.0
    m = forces.motion
    still = 1e-9
    for joint in m.mechanism.joints:
        f = getattr(joint, "friction", None)
        if f is None:
            continue
        rate = m.coordinate(joint.name)[:, 1]
        direction = np.where(np.abs(rate) > still * np.nanmax(np.abs(rate)), np.sign(rate), 0.0)
        reaction, friction = forces.reaction(joint.name), forces.friction.wrench(joint.name)
        if isinstance(joint, Revolute):
            wanted = -direction * f.coefficient * f.radius * np.hypot(reaction[:, 0], reaction[:, 1])
            got, scale = friction[:, 2], f.coefficient * f.radius * np.hypot(reaction[:, 0], reaction[:, 1])
            own = np.abs(reaction[:, 2] - friction[:, 2])
        else:
            j = m.model.joint_index[joint.name]
            u = np.broadcast_to(m.guide(j), (m.frames,)) * (1.0 if joint.guide == 0 else -1.0)
            force = reaction[:, 0] + 1j * reaction[:, 1]
            n, along = np.real(np.conj(1j * u) * force), np.real(np.conj(u) * force)
            c = reaction[:, 2]
            size = np.maximum(np.abs(n), 2 * np.abs(c) / f.length) if f.length else np.abs(n)
            wanted, got, scale = -direction * f.coefficient * size, along, f.coefficient * size
            own = np.abs(friction[:, 0] + 1j * friction[:, 1] - along * u)
        largest = float(np.nanmax(scale))
        if largest == 0.0:  # nothing presses: nothing rubs either
            assert not np.nanmax(np.abs(got)) and not np.nanmax(own)
            continue
        worst = max(worst, float(np.nanmax(np.maximum(own, np.abs(got - wanted)))) / largest)
    return worst
