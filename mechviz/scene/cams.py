"""Cam pairs of a scene: the document of profile and follower, its references, and the pair of the core."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, model_validator

from mechcore.errors import Fault, MechanismError
from mechcore.laws import Segment, program
from mechcore.spec import CamPair, Pair

from .faults import did_you_mean
from .fields import Angle, Coordinate, Distance, Extent, Flag, Size, Text
from .programs import ProgramSegment
from .tables import Table, Unknown, one_of, refuse

if TYPE_CHECKING:
    from .convert import Converter
    from .pairs import PairDocument
    from .validate import Reading

__all__ = ["FollowerDocument", "LiftSegment", "ProfileDocument", "cam_pair", "check_cam"]

FACES = ("knife", "roller", "mushroom", "flat")
_STEEPEST = math.radians(89.0)


class LiftSegment(ProgramSegment):
    """A rise, return or dwell of the follower over a range of the cam."""

    over: Distance
    """Range of the cam's angle, of a wedge: length of it."""
    to: Coordinate | None = None
    """Lift at its end above the base circle: a length, of an oscillating follower an angle. Without it a dwell."""


class FollowerDocument(Table):
    """What touches the cam, and what guides it."""

    knife: Flag | None = None
    """A knife edge, true."""
    roller: Size | None = None
    """Radius of a roller."""
    mushroom: Size | None = None
    """Radius of an arc face."""
    flat: Flag | None = None
    """A flat face, true."""
    guide: Text
    """The prismatic or revolute pair that guides the follower; the guide points away from the cam."""
    point: Text
    """The follower's point: knife's tip, centre of the roller or of the mushroom's arc, a point of the flat face."""
    tilt: Angle = 0.0
    """Flat: turned by this angle from straight across the guide, or from the line of the arm."""
    face: Annotated[list[Size], Field(min_length=2, max_length=2)] | None = None
    """Flat: how far the face reaches [left, right] from the point; an event tells where that is too short."""
    side: Literal["left", "right"] | None = None
    """Oscillating: the point lies on this side of the line from the pivot to the cam's axis. Default left."""

    @model_validator(mode="after")
    def _one_face(self) -> FollowerDocument:
        found = one_of(self, FACES, "the follower")
        for key in ("knife", "flat"):
            if getattr(self, key) is False:
                found.append((key, "false says nothing.", f"Write {key} = true, or leave it out."))
        if not found and self.flat is None:
            for key in ("tilt", "face"):
                if key in self.model_fields_set:
                    found.append((key, f"{key} goes with a flat face.", "Leave it out."))
        refuse(found)
        return self


class ProfileDocument(Table):
    """How the cam is made: base circle and lift."""

    base: Extent
    """Radius of the base circle. Of a wedge: height of the profile at zero lift above the line of its own point."""
    lift: Annotated[list[LiftSegment], Field(min_length=1)]
    """Segments one after the other, over 360 deg of a disc; the follower starts on the base circle."""
    sense: Literal["ccw", "cw"] = "ccw"
    """The law is read as the cam turns counter-clockwise or clockwise; of a wedge: ccw along its bed, cw against it."""
    phase: Coordinate = 0.0
    """Added to the cam's coordinate: the law is ahead by this much."""
    bed: Text | None = None
    """Wedge: the prismatic pair that guides the cam, instead of a pin."""
    pressure_limit: Angle | None = None
    """A larger pressure angle is an event."""

    @model_validator(mode="after")
    def _moves(self) -> ProfileDocument:
        if self.sound("lift") and all(segment.to is None and segment.sound("to") for segment in self.lift):
            refuse([("lift", "all segments are dwells: nothing moves.", "Give one of them an end, to = ...")])
        return self


def check_cam(reading: Reading, path: str, pair: PairDocument) -> Iterator[Fault]:
    """Faults of the pairs and the point that a cam names."""
    document = reading.document
    cam, follower = pair.links
    wanted: list[tuple[str, str, str, tuple[str, ...]]] = []
    if pair.follower is not None:
        wanted.append((f"{path}.follower.guide", pair.follower.guide, follower, ("prismatic", "revolute")))
    if pair.profile is not None and pair.profile.bed is not None:
        wanted.append((f"{path}.profile.bed", pair.profile.bed, cam, ("prismatic",)))
    for where, name, link, kinds in wanted:
        if isinstance(name, Unknown) or link not in document.links or reading.shapeless:
            continue
        guides = [key for key, other in document.pairs.items() if other.kind in kinds and link in other.links]
        if name not in guides and "*" not in reading.broken["pairs"]:
            words = " or ".join(kinds)
            known = name in document.pairs
            message = f"'{name}' is no {words} pair of '{link}'." if known else f"there is no pair '{name}'."
            near = did_you_mean(name, guides, what=f"Pairs that guide '{link}'")
            yield Fault(where, message, near or f"Add a {words} pair that guides '{link}'.")
    if pair.follower is not None and not isinstance(pair.follower.point, Unknown):
        from .references import known_point

        yield from known_point(reading, f"{path}.follower.point", follower, pair.follower.point)


def cam_pair(name: str, pair: PairDocument, oscillates: bool, convert: Converter) -> Pair | None:
    """The core's pair, None where a fault was noted."""
    path = f"pairs.{name}"
    profile, follower = pair.profile, pair.follower
    if profile is None or follower is None:
        return None
    before = len(convert.faults)
    along, across = ("length" if profile.bed else "angle"), ("angle" if oscillates else "length")
    base = convert.si(profile.base, "length", f"{path}.profile.base")
    phase = convert.si(profile.phase, along, f"{path}.profile.phase")
    overs = [convert.si(s.over, along, f"{path}.profile.lift[{k}].over") for k, s in enumerate(profile.lift)]
    ends = [None if s.to is None else convert.si(s.to, across, f"{path}.profile.lift[{k}].to") for k, s in enumerate(profile.lift)]
    limit = None
    if profile.pressure_limit is not None:
        limit = convert.si(profile.pressure_limit, "angle", f"{path}.profile.pressure_limit")
        if not 0.0 < limit < 0.5 * math.pi and not math.isnan(limit):
            convert.note(f"{path}.profile.pressure_limit", f"{math.degrees(limit):g} deg.", "Usual are 30 to 45 deg.")
    face = _face(follower, path, convert)
    whole = not any(map(math.isnan, (base, phase, *overs, *(end or 0.0 for end in ends))))
    if len(convert.faults) > before or not whole or face is None or any(s.unread for s in profile.lift):
        return None
    try:
        rows = zip(profile.lift, overs, ends, strict=True)
        lift = program(
            [Segment(over=over, to=end, law=s.shape(), mirrored=s.mirrored) for s, over, end in rows], repeats=not profile.bed
        )
    except MechanismError:  # an unknown law, noted where the segment was read
        return None
    return CamPair(
        name=name,
        links=pair.links,
        guide=follower.guide,
        point=follower.point,
        lift=lift,
        face=face,
        base=base,
        bed=profile.bed,
        sense=-1 if profile.sense == "cw" else 1,
        phase=phase,
        side=follower.side or "left",
        closure=pair.closure or "force",
        pressure_limit=limit,
    )


def _face(follower: FollowerDocument, path: str, convert: Converter) -> Any:
    from mechcore.cams.followers import Arc, Flat, Knife, Roller

    if follower.roller is not None:
        radius = convert.si(follower.roller, "length", f"{path}.follower.roller")
        return None if math.isnan(radius) else Roller(radius)
    if follower.mushroom is not None:
        radius = convert.si(follower.mushroom, "length", f"{path}.follower.mushroom")
        return None if math.isnan(radius) else Arc(radius)
    if follower.flat:
        tilt = convert.si(follower.tilt, "angle", f"{path}.follower.tilt")
        if abs(tilt) > _STEEPEST:
            convert.note(f"{path}.follower.tilt", f"{math.degrees(tilt):g} deg.", "Give less than 89 deg.")
            return None
        reach = (math.inf, math.inf) if follower.face is None else convert.row(follower.face, "length", f"{path}.follower.face")
        return None if any(map(math.isnan, (tilt, *reach))) else Flat(tilt=tilt, left=reach[0], right=reach[1])
    return Knife()
