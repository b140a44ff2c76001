"""Parts common to all cams in a mechanism: guides on the carrier, the relation, faults by the names of the scene. And barrel, end
and globoidal cams: their position in the plane mechanism, and the roller's path in space."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator

import numpy as np

from mechcore.arrays import Real, Values
from mechcore.cams.followers import Roller
from mechcore.cams.placement.inverse import PlacedInverse
from mechcore.cams.placement.plane import PlacedCam
from mechcore.cams.placement.spatial import PlacedSpatial, room_of_rollers
from mechcore.cams.spatial import Barrel, BarrelArm, Globoid, SpatialCam
from mechcore.errors import Fault, MechanismError
from mechcore.joints.base import Bearing, Builder, CoordinateFunction, Relation, point_of
from mechcore.laws.curve import MotionCurve, Piece
from mechcore.spec.loads import Force
from mechcore.spec.mechanism import CamJoint, Link, Prismatic, Revolute, SpatialBlank
from mechcore.texts import as_angle, as_length

_KEYS = {"base": "base", "lift": "lift", "radius": "face.radius", "second": "second"}
"""Last part of a path in a fault of the geometry -> key of the scene."""

Terms = tuple[tuple[str, float], ...]


def relate(
    joint: CamJoint,
    builder: Builder,
    placed: PlacedCam | PlacedSpatial | PlacedInverse,
    follower: tuple[Terms, Terms, float],
    cam: tuple[Terms, Terms],
    bearing: Bearing | None = None,
) -> None:
    """Add the relation of a placed cam. ``follower``: its angles, displacements and constant; ``cam``: angles and displacements in
    the argument of the law."""

    def lift(argument: Values) -> Real:
        values: Real = placed.law(argument)
        if placed.mean_slope:
            values[0] -= placed.mean_slope * argument
            values[1] -= placed.mean_slope
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
    """A fault of the geometry with the path of the joint and its key."""
    if fault.path.startswith("joints."):
        return fault
    key = _KEYS.get(fault.path.partition(".")[2], "")
    return Fault(f"joints.{joint.name}" + (f".{key}" if key else ""), fault.message, fault.remedy)


def guide_in(carrier: str, guide: Prismatic) -> tuple[complex, float]:
    """Direction of the guide in the carrier's axes, and the sign of the slider's motion along it as the coordinate grows."""
    along = complex(*guide.along) / abs(complex(*guide.along))
    if guide.links[guide.guide] == carrier:
        return along, 1.0
    # the guide line belongs to the slider: it moves against the coordinate
    turn = cmath.exp(1j * (guide.angle if guide.links[1] != carrier else -guide.angle))
    return along * turn, -1.0


def place_on(builder: Builder, carrier: str, guide: Prismatic, at: complex) -> complex:
    """Position in the carrier's axes of a point ``at`` of the sliding link, at coordinate zero."""
    side = guide.links.index(carrier)
    own = point_of(builder.links[carrier], guide.points[side])
    other = point_of(builder.links[guide.links[1 - side]], guide.points[1 - side])
    turn = cmath.exp(1j * (guide.angle if side == 0 else -guide.angle))
    return own + turn * (at - other)


def bed_of(joint: CamJoint, builder: Builder, carrier: str, what: str) -> Prismatic:
    """The prismatic joint on which the driving link slides. Raises `MechanismError` if there is none on the carrier."""
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
    """A law extended by constant pieces before its start and after its end."""
    begin, end = float(law.pieces[0].at(0.0, 0)[0]), float(law.pieces[-1].at(law.pieces[-1].length, 0)[0])
    nothing = np.zeros((0, 3))
    before, after = (Piece(law.length, np.array([value]), nothing) for value in (begin, end))
    return MotionCurve((before, *law.pieces, after), law.start - law.length)


LEAST_ROLLERS = 6  # of a turret: those between ribs are up to one and a half steps from the middle, a quarter of a turn at most
_SQUARE = 1e-9  # tolerance for perpendicular directions and points on a line


def place_spatial(joint: CamJoint, builder: Builder, carrier: str, guide: Prismatic | Revolute) -> PlacedSpatial:
    """The placed cam. Raises `MechanismError` if its parts are not arranged as its kind requires."""
    blank = joint.spatial
    assert blank is not None and joint.lift is not None
    if not isinstance(joint.face, Roller):
        raise fault_of(joint, "follower", "spatial cams are followed by rollers here.", "Give roller = ...")
    law = joint.lift
    if blank.rollers:
        _check_turret(joint, blank, guide, law)
    elif abs(law.length - 2.0 * math.pi) > 1e-9 or abs(law.advance) > 1e-12 * float(abs(law.limits(0)[0]).max()):
        raise fault_of(joint, "profile.lift", "it does not close after a whole turn.", "Let it return to its start.")
    law = law if law.repeats else law.repeating()
    centre, own = builder.axis_between(joint, joint.links[0], carrier)
    at = point_of(builder.links[joint.links[1]], joint.point)
    pivot, arm, r = None, 0.0, joint.face.radius
    stated = None if blank.axis is None else complex(*blank.axis) / abs(complex(*blank.axis))
    if isinstance(guide, Prismatic):
        if blank.kind == "globoid":
            raise fault_of(joint, "follower.guide", "a globoidal cam moves an arm.", "Guide the follower by a revolute joint.")
        up = guide_in(carrier, guide)[0]
        if stated is not None and abs((stated * up.conjugate()).imag) > _SQUARE:
            raise fault_of(joint, "profile.axis", "the follower does not slide along it.", "Leave it out.")
        axes, place = up / 1j, place_on(builder, carrier, guide, at)
        off = ((place - centre) / axes).real
        if abs(off) > _SQUARE * max(abs(place), abs(centre)):
            raise fault_of(
                joint,
                "follower.point",
                f"the roller's axis passes the cam's axis at {as_length(abs(off))}.",
                "Guide it over the axis.",
            )
        mount: Barrel | BarrelArm | Globoid = Barrel()
        start = joint.base
    else:
        pivot, hinge = builder.axis_between(joint, joint.links[1], carrier)
        arm = abs(at - hinge)
        if arm == 0.0:
            raise fault_of(joint, "follower.point", "it is the follower's own pivot.", "Name the middle of the roller.")
        if blank.kind == "globoid":
            if pivot == centre:
                raise fault_of(joint, "follower.guide", "the arm's pivot lies on the cam's pin.", "Move it away from the axis.")
            axes = (pivot - centre) / abs(pivot - centre)
            if stated is not None and abs((stated * (1j * axes).conjugate()).imag) > _SQUARE:
                raise fault_of(joint, "profile.axis", "it is not perpendicular to the line to the arm's pivot.", "Leave it out.")
            mount, height = Globoid(abs(pivot - centre)), 0.0
        else:
            if blank.kind == "rib":
                raise fault_of(
                    joint,
                    "profile.rib",
                    "two rollers on an arm do not keep to a rib.",
                    "Give barrel = ..., or a guide that slides.",
                )
            if stated is None:
                raise fault_of(
                    joint, "profile.axis", "missing: an arm does not say where the cam's axis points.", "Give axis = [1, 0]."
                )
            axes = stated / 1j
            w = (pivot - centre) / axes
            if w.real <= 0.0:
                raise fault_of(joint, "profile.axis", "the arm's pivot lies to the left of it.", "Turn the axis round.")
            mount, height = BarrelArm((w.real, w.imag), arm), w.imag
        sine = 0.0 if blank.rollers else (joint.base - height) / arm
        if not -1.0 < sine < 1.0:
            raise fault_of(
                joint, "profile.base", f"the arm does not reach {as_length(joint.base)} along the axis.",
                f"Give between {as_length(height - arm)} and {as_length(height + arm)}.",
            )  # fmt: skip
        start = math.asin(sine) if not blank.rollers else -0.5 * law.advance
    inner, outer = _reach(joint, blank, arm)
    if blank.rollers:
        _check_room(joint, blank, mount, r, arm, inner)
    placed = PlacedSpatial(
        name=joint.name, links=joint.links, carrier=carrier, guide=joint.guide,
        cam=SpatialCam(law.raised(start), mount, r, inner, outer, joint.sense), blank=blank, centre=centre, axes=axes,
        mount_origin=own, pivot=pivot, arm=arm, base=joint.base, form_closed=joint.closure == "form", sense=joint.sense,
        phase=joint.phase, pressure_limit=joint.pressure_limit,
    )  # fmt: skip
    placed.check()
    return placed


ON_PIN = 1e-9  # of the size of a link: points closer to the pin are at it
MASS_REMEDY = "Give the centre of mass at the pin; of the masses around it only the moment of inertia about the shaft counts."
_TURNS = "turns about a shaft in the plane"


def off_shaft(path: str, link: str, what: str, off: float, remedy: str) -> Fault:
    """The fault of an item ``what`` of a cam's link that lies ``off`` its pin [m]."""
    return Fault(path, f"'{link}' {_TURNS}, and {what} lies {as_length(off)} off its pin.", remedy)


def check_shaft(joint: CamJoint, builder: Builder, own: complex) -> None:
    """Raise `MechanismError` if a point, mass or force on the link of a spatial cam (its pin at ``own``), or on a link welded to
    it, leaves the plane as the shaft turns, or if a study of plane motion names such a link."""
    on_shaft = builder.rigid_with(joint.links[0])
    faults = [fault for k, origin, turn in on_shaft for fault in _off_pin(builder.links[k], own, origin, turn)]
    links = {k for k, _, _ in on_shaft}
    for load in builder.mechanism.loads:
        if isinstance(load, Force) and load.against in links:
            why = f"'{load.against}' {_TURNS}: what acts at a point of '{load.link}' cannot act against it."
            faults.append(Fault(f"loads.{load.name}", why, "Let it act against the link that carries the shaft."))
        elif isinstance(load, Force) and load.link in links and load.axes == "link":
            why = f"'{load.link}' {_TURNS}: a force that turns with it leaves the plane."
            faults.append(Fault(f"loads.{load.name}", why, "Fix its direction in the world."))
    asked = builder.mechanism.studies
    studies = [(f"centrodes[{i}]", k, "centrodes") for i, k in enumerate(asked.centrodes)]
    studies += [(f"instant_centres[{i}]", k, "instant centres") for i, k in enumerate(asked.instant_centres)]
    studies += [(f"inflection[{i}]", k, "inflection circles") for i, k in enumerate(asked.inflection)]
    studies += [(f"systems.{s.name}", s.link, "force systems of the plane") for s in asked.systems]
    studies += [(f"substitutes.{s.link}", s.link, "substitute masses") for s in asked.substitutes]
    studies += [(f"sections.{s.link}", s.link, "section forces") for s in asked.sections]
    for i, name in enumerate(asked.equivalent):
        if name == joint.name:
            why = f"'{name}' is a cam about a shaft in the plane: no linkage of the plane is its equivalent."
            faults.append(Fault(f"equivalent[{i}]", why, "Leave it out."))
    for path, k, what in studies:
        if k in links:
            faults.append(Fault(path, f"'{k}' {_TURNS}, to which {what} do not apply.", "Name a link that moves in the plane."))
    if faults:
        raise MechanismError(faults)


def _off_pin(link: Link, own: complex, origin: complex, turn: complex) -> Iterator[Fault]:
    """Faults of points and centre of mass off the pin at ``own``, for a link whose frame has this origin and rotation in the cam's
    frame."""
    pin = (own - origin) / turn
    near = ON_PIN * max(abs(own), abs(origin), *(abs(complex(*at)) for at in link.points.values()))
    for point, at in link.points.items():
        if (off := abs(complex(*at) - pin)) > near:
            remedy = "Move it to the pin, or to a link that moves in the plane."
            yield off_shaft(f"links.{link.name}.points.{point}", link.name, f"its point '{point}'", off, remedy)
    if link.mass and (off := abs(complex(*link.centre) - pin)) > near:
        yield off_shaft(f"links.{link.name}.centre", link.name, "its centre of mass", off, MASS_REMEDY)


def _check_turret(joint: CamJoint, blank: SpatialBlank, guide: Prismatic | Revolute, law: MotionCurve) -> None:
    """Raise `MechanismError` unless the cam is an indexing cam that advances its turret by one roller per turn."""
    if blank.kind not in ("barrel", "globoid") or not isinstance(guide, Revolute):
        raise fault_of(
            joint, "profile", "a turret of rollers turns about a pivot.", "Give barrel or globoid, and guide = a revolute joint."
        )
    if joint.closure != "form":
        raise fault_of(joint, "closure", "the rollers of a turret run between ribs.", "Give closure = 'form'.")
    if blank.rollers < LEAST_ROLLERS:
        why = f"a turret of {blank.rollers}: the ribs would have to follow its rollers around to its other side."
        raise fault_of(joint, f"profile.{blank.kind}.rollers", why, f"Give {LEAST_ROLLERS} or more.")
    step = 2.0 * math.pi / blank.rollers
    if abs(law.length - 2.0 * math.pi) > 1e-9 or abs(abs(law.advance) - step) > 1e-9:
        raise fault_of(
            joint, "profile.lift",
            f"in {as_angle(law.length)} it ends at {as_angle(law.advance)}: a turret of {blank.rollers} "
            "rollers goes on by one of them every turn.",
            f"Let it end at {as_angle(step)} after a whole turn.",
        )  # fmt: skip


def _check_room(
    joint: CamJoint, blank: SpatialBlank, mount: Barrel | BarrelArm | Globoid, r: float, arm: float, inner: float
) -> None:
    """Raise `MechanismError` unless there is room for a rib between two rollers, and rollers of a barrel stay over it while they
    engage."""
    step = 2.0 * math.pi / blank.rollers
    room = room_of_rollers(blank, arm, inner)
    if not r < room:
        apart = 2.0 * (inner if blank.kind == "globoid" else arm) * math.sin(0.5 * step)
        raise fault_of(
            joint, "follower.roller",
            f"{blank.rollers} rollers of {as_length(r)} stand {as_length(apart)} apart: no rib between them.",
            f"Give less than {as_length(room, 4)}, or fewer rollers.",
        )  # fmt: skip
    if isinstance(mount, BarrelArm):
        far = max(abs(mount.pivot[0] - arm * math.cos(k * step)) for k in (0.0, 1.5))
        if not far < 0.9 * inner:
            raise fault_of(
                joint, "profile.barrel",
                f"the rollers pass its axis at up to {as_length(far)}, its core has {as_length(inner)}.",
                "Give more rollers or a larger barrel, or a pivot as far from the axis as the rollers.",
            )  # fmt: skip


def _reach(joint: CamJoint, blank: SpatialBlank, arm: float) -> tuple[float, float]:
    """The range of contact along the roller's axis [m], measured from the cam's axis, or for a globoid from the arm's pivot."""
    if blank.kind == "globoid":
        if not 0.0 < blank.depth < 2.0 * arm:
            why = f"a depth of {as_length(blank.depth)} about the end of an arm of {as_length(arm)}."
            raise fault_of(joint, "profile.globoid.depth", why, "Give a smaller one.")
        return arm - 0.5 * blank.depth, arm + 0.5 * blank.depth
    if not 0.0 < blank.depth < blank.radius:
        raise fault_of(
            joint,
            f"profile.{blank.kind}.depth",
            f"a depth of {as_length(blank.depth)} in a radius of {as_length(blank.radius)}.",
            "Give a smaller one.",
        )
    return blank.radius - blank.depth, blank.radius
