"""Revolute joints with clearance: a mechanism in which their journals move freely in their bearings.

Each such joint is replaced by several: a massless journal slides in two directions on the bearing's link, which gives it two free
coordinates, and the joint itself joins the shaft to the journal. Two loads between bearing and journal model the contact and its
losses. The joint then transmits the contact force. A mechanism without clearance is not changed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from mechcore.errors import Fault, MechanismError
from mechcore.laws.timed import Free
from mechcore.records import dataclass
from mechcore.spec.loads import JournalContact, JournalLoss
from mechcore.spec.mechanism import Drive, Joint, Link, Mechanism, Planar, Prismatic, Revolute


@dataclass(frozen=True, kw_only=True)
class Clearance:
    """The clearance of a revolute joint. ``radial``: radius of the bearing less that of the journal [m].

    In contact F = stiffness d (d / radial)^(exponent - 1) (1 + loss d'), d the indentation [m]. ``stiffness`` [N/m]: secant
    stiffness at the indentation ``radial``; ``loss`` [s/m]: see `mechcore.effects.resistance.loss_factor`. ``radius``: of the
    journal [m]; ``friction``: coefficient between the surfaces. ``start``: journal's centre in the bearing at the start [m].
    """

    radial: float
    stiffness: float
    exponent: float = 1.0
    loss: float = 0.0
    radius: float = 0.0
    friction: float = 0.0
    start: tuple[float, float] = (0.0, 0.0)


def replacement_names(joint: str) -> tuple[str, str]:
    """Names of the two links, and of the two sliding joints, that replace a joint with clearance."""
    return f"{joint}.across", f"{joint}.journal"


def with_clearances(mechanism: Mechanism, clearances: Mapping[str, Clearance]) -> Mechanism:
    """The mechanism with ``clearances`` in some of its revolute joints, by name; unchanged if there are none.

    The journals start at the centres of their bearings, or at ``start``, at rest relative to them. Raises `MechanismError`.
    """
    if not clearances:
        return mechanism
    joints = {p.name: p for p in mechanism.joints}
    faults = []
    for name, c in clearances.items():
        joint = joints.get(name)
        if not isinstance(joint, Revolute):
            faults.append(Fault(f"joints.{name}", "clearance is for revolute joints.", "Name a revolute joint."))
        for key in ("radial", "stiffness"):
            if not getattr(c, key) > 0.0:
                faults.append(
                    Fault(f"joints.{name}.clearance", f"its {key} of {getattr(c, key):g} is not positive.", "Give a positive one.")
                )
    if faults:
        raise MechanismError(faults)
    links, drives, loads = list(mechanism.links), list(mechanism.drives), list(mechanism.loads)
    made: list[Joint] = []
    for joint in mechanism.joints:
        if joint.name not in clearances:
            made.append(joint)
            continue
        assert isinstance(joint, Revolute)
        c, (across, journal) = clearances[joint.name], replacement_names(joint.name)
        bearing, shaft = joint.links
        links += [Link(name=across, points={"O": (0.0, 0.0)}), Link(name=journal, points={"O": (0.0, 0.0)})]
        made += [
            Prismatic(name=across, links=(bearing, across), points=(joint.points[0], "O"), along=(1.0, 0.0)),
            Prismatic(name=journal, links=(across, journal), points=("O", "O"), along=(0.0, 1.0)),
            replace(joint, links=(journal, shaft), points=("O", joint.points[1]), friction=None),
        ]
        drives += [Drive(joint=across, law=Free(c.start[0])), Drive(joint=journal, law=Free(c.start[1]))]
        common: dict[str, Any] = {
            "joint": joint.name,
            "links": (bearing, journal, shaft),
            "slides": (across, journal),
            "point": joint.points[0],
            "radial": c.radial,
            "stiffness": c.stiffness,
            "exponent": c.exponent,
        }
        loads.append(JournalContact(name=f"{joint.name} contact", **common))
        if c.loss or c.friction:
            loads.append(JournalLoss(name=f"{joint.name} losses", **common, loss=c.loss, friction=c.friction, radius=c.radius))
    return replace(mechanism, links=tuple(links), joints=tuple(made), drives=tuple(drives), loads=tuple(loads))


def journals_of(mechanism: Mechanism) -> dict[str, JournalContact]:
    """The contact loads of the joints with clearance, by name of the joint."""
    return {load.joint: load for load in mechanism.loads if type(load) is JournalContact}


def auxiliary_names(mechanism: Mechanism) -> frozenset[str]:
    """Names of the links and joints that model clearance or planar joints; they are neither drawn nor recorded."""
    journals = [name for joint in journals_of(mechanism) for name in replacement_names(joint)]
    return frozenset(journals).union(*(p.coordinates for p in mechanism.joints if isinstance(p, Planar)))


def with_ideal_joints(mechanism: Mechanism) -> Mechanism:
    """The mechanism with ideal revolute joints instead of clearance, and without planar joints, which transmit nothing."""
    if any(isinstance(p, Planar) for p in mechanism.joints):
        mechanism = replace(mechanism, joints=tuple(p for p in mechanism.joints if not isinstance(p, Planar)))
    journals = journals_of(mechanism)
    if not journals:
        return mechanism
    made = auxiliary_names(mechanism)
    joints: list[Joint] = []
    for joint in mechanism.joints:
        if joint.name in journals:
            assert isinstance(joint, Revolute)
            j = journals[joint.name]
            joints.append(replace(joint, links=(j.links[0], joint.links[1]), points=(j.point, joint.points[1])))
        elif joint.name not in made:
            joints.append(joint)
    return replace(
        mechanism,
        links=tuple(k for k in mechanism.links if k.name not in made),
        joints=tuple(joints),
        drives=tuple(d for d in mechanism.drives if d.joint not in made),
        loads=tuple(load for load in mechanism.loads if not isinstance(load, JournalContact)),
    )
