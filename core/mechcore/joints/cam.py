"""Cam and follower: the follower's coordinate is a function of the cam's; the force acts along their common normal."""

from __future__ import annotations

import cmath
import math
from functools import lru_cache
from typing import Any

import numpy as np

from mechcore.cams.closures import conjugate
from mechcore.cams.contour import Contour, moved
from mechcore.cams.cutting import CutProfile, cut_profile
from mechcore.cams.followers import Flat, Follower, Oscillating, Translating
from mechcore.cams.given import GivenLift, lift_of
from mechcore.cams.limits import Requirement, find_limits, least_base
from mechcore.cams.placed import PlacedCam
from mechcore.cams.synthesis import Cam, cam_on_base
from mechcore.errors import MechanismError
from mechcore.joints.base import Bearing, Builder, point_of
from mechcore.joints.cam_guides import bed_of, fault_of, guide_in, levelled, place_on, relate, renamed
from mechcore.joints.inverse_cam import build_inverse
from mechcore.joints.spatial_cam import place_spatial
from mechcore.laws.curve import MotionCurve
from mechcore.spec.mechanism import CamPair, Prismatic, Revolute
from mechcore.texts import as_angle, as_coordinate, as_length


def build(pair: CamPair, builder: Builder) -> None:
    guide = next((p for p in builder.mechanism.pairs if p.name == pair.guide), None)
    if not isinstance(guide, Prismatic | Revolute) or pair.links[1] not in guide.links:
        raise fault_of(
            pair, "guide", f"'{pair.guide}' is no revolute or prismatic pair of '{pair.links[1]}'.", "Name the pair that guides it."
        )
    carrier = guide.links[0] if guide.links[1] == pair.links[1] else guide.links[1]
    if carrier == pair.links[0]:
        raise fault_of(pair, "guide", "it guides the follower on the cam itself.", "Guide both on one link.")
    follower = builder.links[pair.links[1]]
    if pair.inverse:
        build_inverse(pair, builder, carrier, guide)
        return
    if pair.point not in follower.points:
        known = ", ".join(follower.points)
        raise fault_of(pair, "point", f"link '{follower.name}' has no point '{pair.point}'.", f"Its points: {known}.")
    try:
        placed: Any
        if pair.spatial is not None:
            placed = place_spatial(pair, builder, carrier, guide)
        else:
            made = _wedge(pair, builder, carrier, guide) if pair.bed else _disc(pair, builder, carrier, guide)
            placed = PlacedCam(**made)
            placed.check()
    except MechanismError as error:
        raise MechanismError([renamed(pair, f) for f in error.faults]) from None
    if isinstance(guide, Prismatic):
        sign, zero = _along_guide(pair, builder, carrier, guide, placed)
        angles: tuple[tuple[str, float], ...] = ()
        slides: tuple[tuple[str, float], ...] = ((guide.name, -sign),)
        constant = zero
    else:
        pivot, own = builder.axis_between(pair, pair.links[1], carrier)
        c = placed.scale * placed.side
        angles = ((pair.links[1], c), (carrier, -c))
        slides = ()
        towards = placed.centre - pivot if pair.spatial is None else -placed.axes  # where the arm points at coordinate zero
        home = cmath.phase(towards / (point_of(follower, pair.point) - own))
        constant = c * home
        if pair.spatial is not None and placed.pace:  # a turret goes on and on: the curve is what it leaves its mean pace by
            step = placed.scale * placed.sense * placed.pace
            angles += ((pair.links[0], step), (carrier, -step))
            constant -= placed.scale * placed.pace * placed.phase
    cam_angles: tuple[tuple[str, float], ...] = ()
    cam_slides: tuple[tuple[str, float], ...] = ()
    if pair.bed:
        cam_slides = ((pair.bed, float(placed.sense)),)
    else:
        cam_angles = ((pair.links[0], float(placed.sense)), (carrier, -float(placed.sense)))
    relate(pair, builder, placed, (angles, slides, constant), (cam_angles, cam_slides), _bearing(pair, builder, carrier, placed))


def _bearing(pair: CamPair, builder: Builder, carrier: str, placed: Any) -> Bearing | None:
    """What carries the shaft of a cam whose axis lies in the plane."""
    if pair.spatial is None:
        return None
    return Bearing(carrier=carrier, couple=placed.couple, joints=builder.bearings_between(pair, pair.links[0], carrier))


def _along_guide(pair: CamPair, builder: Builder, carrier: str, guide: Prismatic, placed: Any) -> tuple[float, float]:
    """How the follower's height follows from the guide's coordinate s: sign * s + zero."""
    at = place_on(builder, carrier, guide, point_of(builder.links[pair.links[1]], pair.point))
    _, sign = guide_in(carrier, guide)
    # lift is along the guide's direction as the carrier sees it
    return sign, float(((at - placed.centre) / placed.axes).imag)


def _guide_of(pair: CamPair, builder: Builder, carrier: str, guide: Prismatic | Revolute) -> tuple[complex, complex, float]:
    """Place of the follower's point (translating: at coordinate zero) or pivot on the carrier, direction of lift, length of arm."""
    follower = builder.links[pair.links[1]]
    at = point_of(follower, pair.point)
    if isinstance(guide, Prismatic):
        return place_on(builder, carrier, guide, at), guide_in(carrier, guide)[0], 0.0
    pivot, own = builder.axis_between(pair, pair.links[1], carrier)
    arm = abs(at - own)
    if arm == 0.0:
        raise fault_of(pair, "point", "it is the follower's own pivot.", "Name the point that touches the cam.")
    return pivot, 0j, arm


def _disc(pair: CamPair, builder: Builder, carrier: str, guide: Prismatic | Revolute) -> dict[str, Any]:
    centre, own = builder.axis_between(pair, pair.links[0], carrier)
    place, up, arm = _guide_of(pair, builder, carrier, guide)
    if isinstance(guide, Prismatic):
        axes = up / 1j
        face_guide: Any = Translating(float(((place - centre) / axes).real))
    else:
        axes = 1 + 0j
        if place == centre:
            raise fault_of(pair, "guide", "the follower's pivot lies on the cam's axis.", "Move it away from there.")
        face_guide = Oscillating(place - centre, arm, -1 if pair.side == "left" else 1)
    follower = Follower(face_guide, pair.face)
    if pair.contour is not None:
        if pair.closure == "form" and not isinstance(pair.face, Flat):
            raise fault_of(pair, "closure", "a given profile has no groove.", "Give closure = 'force', or a yoke with flat faces.")
        profile, given = _given(pair.contour, own, axes, follower)
        made = _common(pair, carrier, Cam(given.law, follower), centre, axes)
        return made | {
            "own": own, "mount": axes, "arm": arm, "given": profile, "bridges": given.bridges, "bends": given.ends, "sense": 1,
            "phase": 0.0,
        }  # fmt: skip
    law = pair.lift
    assert law is not None
    if abs(law.length - 2.0 * math.pi) > 1e-9:
        short = 2.0 * math.pi - law.length
        remedy = f"Add a dwell of {as_angle(short)}." if short > 0 else f"Take {as_angle(-short)} off."
        raise fault_of(pair, "lift", f"the segments cover {as_angle(law.length)}, a whole turn is wanted.", remedy)
    if abs(law.advance) > 1e-12 * float(np.abs(law.limits(0)[0]).max()):
        higher = as_coordinate(law.advance, rotary=isinstance(guide, Revolute))
        raise fault_of(pair, "lift", f"after a turn the lift is {higher} higher than before.", "Let it return to its start.")
    law = law if law.repeats else law.repeating()
    base, decides = pair.base, None
    if pair.least:
        want = Requirement(radius=pair.curvature_limit, pressure_rise=pair.pressure_limit, pressure_fall=pair.pressure_limit)
        base, decides = _least_base(law, follower, want, pair.sense, pair.hub)
    cam = cam_on_base(law, follower, base, turn=pair.sense)
    mount = axes * cmath.exp(1j * pair.sense * pair.phase)
    made = _common(pair, carrier, cam, centre, axes) | {"own": own, "mount": mount, "arm": arm, "base": base, "decides": decides}
    if pair.second is not None:
        made["mate"] = _mate(pair, builder, carrier, guide, cam, made)
    if pair.undercut == "cut" and find_limits(cam, count=720).undercut:
        if pair.closure == "form":
            raise fault_of(pair, "undercut", "a groove or yoke is not followed where it is undercut.", "Leave it out.")
        left, given = _as_cut(law, follower, base, pair.sense)
        made |= {
            "cam": Cam(given.law, follower, pair.sense), "given": left.contour, "bridges": given.bridges, "bends": given.ends,
            "intended": cam, "lost": left.lost,
        }  # fmt: skip
    return made


def _mate(pair: CamPair, builder: Builder, carrier: str, guide: Prismatic | Revolute, cam: Cam, made: dict[str, Any]) -> PlacedCam:
    """The second cam of a conjugate pair: its roller stands on the follower, fixed against the first."""
    assert pair.second is not None
    name, radius = pair.second
    follower = builder.links[pair.links[1]]
    if name not in follower.points:
        raise fault_of(
            pair, "second", f"link '{follower.name}' has no point '{name}'.", f"Its points: {', '.join(follower.points)}."
        )
    first, second = point_of(follower, pair.point), point_of(follower, name)
    theory = cam.follower.guide
    if isinstance(theory, Oscillating):
        _, own = builder.axis_between(pair, pair.links[1], carrier)
        apart = -theory.side * cmath.phase((second - own) / (first - own))  # as the coordinate grows
        arm = abs(second - own)
        total = -apart
        if not 0.0 < total < math.pi:
            raise fault_of(pair, "second", f"the second arm lies {as_angle(apart)} from the first, on its far side.", "Swap them.")
        other, flip = conjugate(cam, radius, arm=arm, angle=total)[0], 1.0 + 0j
    else:
        at = place_on(builder, carrier, guide, second) - place_on(builder, carrier, guide, first)  # type: ignore[arg-type]  # prismatic
        away = at / made["axes"]
        if not away.imag < 0.0:
            raise fault_of(
                pair, "second", "the second roller does not lie below the first, on the far side of the cam's axis.", "Move it."
            )
        other, flip = conjugate(cam, radius, span=-away.imag, offset=theory.offset + away.real)[0], -1.0 + 0j
    plain = {k: v for k, v in made.items() if k != "mate"}
    turned = {"cam": other, "axes": made["axes"] * flip, "mount": made["mount"] * flip, "form": False}
    if isinstance(theory, Oscillating):
        turned["arm"] = abs(second - own)
    return PlacedCam(**(plain | turned))


@lru_cache(maxsize=16)
def _given(contour: Contour, own: complex, axes: complex, follower: Follower) -> tuple[Contour, GivenLift]:
    """A profile of the link's axes in the theory's, and the lift that it gives; a mechanism is built several times in a run."""
    profile = moved(contour, -own / axes, 1.0 / axes)
    return profile, lift_of(profile, follower)


@lru_cache(maxsize=16)
def _least_base(law: MotionCurve, follower: Follower, want: Requirement, sense: int, hub: float) -> tuple[float, str]:
    found = least_base(law, follower, want, sense, hub)
    return found.base, found.decides


@lru_cache(maxsize=16)
def _as_cut(law: MotionCurve, follower: Follower, base: float, sense: int) -> tuple[CutProfile, GivenLift]:
    left = cut_profile(cam_on_base(law, follower, base, turn=sense))
    return left, lift_of(left.contour, follower, sense)


def _wedge(pair: CamPair, builder: Builder, carrier: str, guide: Prismatic | Revolute) -> dict[str, Any]:
    bed = bed_of(pair, builder, carrier, "the follower")
    if isinstance(pair.face, Flat):
        raise fault_of(pair, "", "a flat face slides on a wedge's highest points only.", "Give a roller or a knife.")
    place, up, arm = _guide_of(pair, builder, carrier, guide)
    way, sign = guide_in(carrier, bed)
    way *= sign  # in which the cam moves as the bed's coordinate grows
    cam_link = builder.links[pair.links[0]]
    start = place_on(builder, carrier, bed, point_of(cam_link, bed.points[bed.links.index(pair.links[0])]))
    radius = pair.face.radius
    if isinstance(guide, Prismatic):
        axes = up / 1j
        across = abs((way / axes).imag)
        if across > 1e-9:
            apart = 0.5 * math.pi - math.asin(min(across, 1.0))
            raise fault_of(
                pair, "bed", f"the cam's and the follower's guides are {as_angle(apart)} apart.", "Make them perpendicular."
            )
        face_guide: Any = Translating(0.0)
    else:
        axes = way if ((place - start) / way).imag > 0 else -way
    centre = start + axes * ((place - start) / axes).real
    if isinstance(guide, Revolute):
        height = ((place - centre) / axes).imag
        face_guide = Oscillating(1j * height, arm, -1 if pair.side == "left" else 1)
        c = (height - pair.base - radius) / arm
        if not -1.0 < c < 1.0:
            least, most = max(height - radius - arm, 0.0), height - radius + arm
            raise fault_of(
                pair, "base", f"the arm does not reach a height of {as_length(pair.base)}.",
                f"Give between {as_length(least)} and {as_length(most)}.",
            )  # fmt: skip
        zero = math.acos(c)
    else:
        zero = pair.base + radius
    assert pair.lift is not None
    # the wedge of the theory moves by -x: where the cam goes the other way as the law is read, the law is mirrored
    ahead = -float((way / axes).real) * pair.sense
    law = levelled(pair.lift) if ahead > 0 else levelled(_mirror(pair.lift))
    cam = Cam(law.raised(zero), Follower(face_guide, pair.face), wedge=True)
    own = point_of(cam_link, bed.points[bed.links.index(pair.links[0])])
    first = bed.links.index(carrier) == 0
    turn = cmath.exp(1j * (-bed.angle if first else bed.angle))  # from the carrier's axes to the cam's
    # the cam's point is at start + s way, a point z of the profile at centre + axes (z - x) with x = ahead (s sense + phase)
    own += turn * (centre - start - axes * ahead * pair.phase)
    return _common(pair, carrier, cam, centre, axes) | {"own": own, "mount": turn * axes, "arm": arm, "ahead": ahead}


def _common(pair: CamPair, carrier: str, cam: Cam, centre: complex, axes: complex) -> dict[str, Any]:
    return {
        "name": pair.name,
        "links": pair.links,
        "carrier": carrier,
        "guide": pair.guide,
        "cam": cam,
        "base": pair.base,
        "centre": centre,
        "axes": axes,
        "form": pair.closure == "form",
        "bed": pair.bed,
        "sense": pair.sense,
        "phase": pair.phase,
        "pressure_limit": pair.pressure_limit,
        "curvature_limit": pair.curvature_limit,
    }


def _mirror(law: MotionCurve) -> MotionCurve:
    """x -> law(-x)."""
    return MotionCurve(law.reversed().pieces, -law.end)
