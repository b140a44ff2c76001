"""Parts of all cams in a mechanism: guides on the carrier, the relation, faults by their scene's names."""

from __future__ import annotations

import cmath

import numpy as np

from mechcore.arrays import Real, Values
from mechcore.cams.placement.inverse import PlacedInverse
from mechcore.cams.placement.plane import PlacedCam
from mechcore.cams.placement.spatial import PlacedSpatial
from mechcore.errors import Fault, MechanismError
from mechcore.joints.base import Bearing, Builder, CoordinateFunction, Relation, point_of
from mechcore.laws.curve import MotionCurve, Piece
from mechcore.spec.mechanism import CamJoint, Prismatic

_KEYS = {"base": "base", "lift": "lift", "radius": "face.radius"}
"""Names of a cam's geometry for the fields of a `CamJoint`."""

Terms = tuple[tuple[str, float], ...]


def relate(
    joint: CamJoint,
    builder: Builder,
    placed: PlacedCam | PlacedSpatial | PlacedInverse,
    follower: tuple[Terms, Terms, float],
    cam: tuple[Terms, Terms],
    bearing: Bearing | None = None,
) -> None:
    """The relation of a placed cam: angles, displacements and constant of the follower, angles and displacements of the law."""

    def lift(argument: Values) -> Real:
        values: Real = placed.law(argument)
        if placed.pace:
            values[0] -= placed.pace * argument
            values[1] -= placed.pace
        return placed.scale * values

    angles, slides, constant = follower
    builder.relations.append(
        Relation(
            name=joint.name,
            kind="cam",
            links=joint.links,
            angles=angles,
            slides=slides,
            contact=placed.contact,
            curve=CoordinateFunction(function=lift, angles=cam[0], slides=cam[1], shift=placed.phase),
            constant=constant,
            geometry=placed,
            bearing=bearing,
        )
    )


def fault_of(joint: CamJoint, key: str, message: str, remedy: str) -> MechanismError:
    return MechanismError(Fault(f"joints.{joint.name}" + (f".{key}" if key else ""), message, remedy))


def renamed(joint: CamJoint, fault: Fault) -> Fault:
    """A fault of the geometry, said of the joint and what it states."""
    if fault.path.startswith("joints."):
        return fault
    key = _KEYS.get(fault.path.partition(".")[2], "")
    return Fault(f"joints.{joint.name}" + (f".{key}" if key else ""), fault.message, fault.remedy)


def guide_in(carrier: str, guide: Prismatic) -> tuple[complex, float]:
    """Direction in which the slider moves on the carrier as the coordinate grows (carrier's axes), and the sign of along."""
    along = complex(*guide.along) / abs(complex(*guide.along))
    if guide.links[guide.guide] == carrier:
        return along, 1.0
    # the guide line belongs to the slider: it moves against the coordinate
    turn = cmath.exp(1j * (guide.angle if guide.links[1] != carrier else -guide.angle))
    return along * turn, -1.0


def place_on(builder: Builder, carrier: str, guide: Prismatic, at: complex) -> complex:
    """Where a place ``at`` of the sliding link lies in the carrier's axes at coordinate zero."""
    side = guide.links.index(carrier)
    own = point_of(builder.links[carrier], guide.points[side])
    other = point_of(builder.links[guide.links[1 - side]], guide.points[1 - side])
    turn = cmath.exp(1j * (guide.angle if side == 0 else -guide.angle))
    return own + turn * (at - other)


def bed_of(joint: CamJoint, builder: Builder, carrier: str, what: str) -> Prismatic:
    """The joint on which the driving link slides."""
    bed = next((p for p in builder.mechanism.joints if p.name == joint.bed), None)
    if not isinstance(bed, Prismatic) or set(bed.links) != {joint.links[0], carrier}:
        raise fault_of(
            joint,
            "bed",
            f"'{joint.bed}' is not a prismatic joint of '{joint.links[0]}' on '{carrier}', which carries {what}.",
            f"Guide '{joint.links[0]}' on '{carrier}'.",
        )
    return bed


def levelled(law: MotionCurve) -> MotionCurve:
    """A law that goes on level before its start and after its end."""
    begin, end = float(law.pieces[0].at(0.0, 0)[0]), float(law.pieces[-1].at(law.pieces[-1].length, 0)[0])
    nothing = np.zeros((0, 3))
    before, after = (Piece(law.length, np.array([value]), nothing) for value in (begin, end))
    return MotionCurve((before, *law.pieces, after), law.start - law.length)
