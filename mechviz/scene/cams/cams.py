"""Cam joints of a scene: the document of profile and follower, its references, and the joint of the core."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, model_validator

from mechcore.cams.followers import Arc, Flat, Knife, Roller
from mechcore.spec.mechanism import CamJoint, Friction, Joint, SpatialBlank
from mechcore.texts import as_angle
from mechviz.scene.cams.profiles import SHAPES, given_contour
from mechviz.scene.cams.ratings import graphical_of, rating_of
from mechviz.scene.fields import (
    Angle,
    Coordinate,
    Direction,
    Extent,
    Flag,
    Number,
    Point,
    Quantity,
    Size,
    Table,
    Text,
    describe,
    one_of,
    refuse,
)
from mechviz.scene.kinds.segment_curves import Axes, lift_curve
from mechviz.scene.kinds.segments import LawDocument, LiftSegment, RadiusSegment
from mechviz.scene.units import magnitude

if TYPE_CHECKING:
    from mechviz.scene.convert import Converter
    from mechviz.scene.kinds.joints.document import JointDocument


SOLIDS: tuple[Literal["barrel", "rib", "end", "globoid"], ...] = ("barrel", "rib", "end", "globoid")
FACES = ("knife", "roller", "mushroom", "flat", "groove")
LEAST = "least"
_STEEPEST = math.radians(89.0)


class SecondDocument(Table):
    """The second roller of a conjugate pair."""

    roller: Size
    """Its radius."""
    point: Text
    """Its centre, a point of the follower on the other side of the cam's axis."""


class FollowerDocument(Table):
    """What touches the cam, and what guides it."""

    groove: Size | None = None
    """Inverse cam: the groove is on the follower, for a roller of this radius on the cam's link, a crank or, with bed, a slide
    (closure = "form")."""
    knife: Flag | None = None
    """A knife edge, true."""
    roller: Size | None = None
    """Radius of a roller."""
    mushroom: Size | None = None
    """Radius of an arc face."""
    flat: Flag | None = None
    """A flat face, true."""
    guide: Text
    """The prismatic or revolute joint that guides the follower; the guide points away from the cam."""
    point: Text
    """The follower's point: knife's tip, centre of the roller or of the mushroom's arc, a point of the flat face.
    Of a groove the roller's centre, a point of the cam's link."""
    tilt: Angle = 0.0
    """Flat: turned by this angle from straight across the guide, or from the line of the arm."""
    face: Annotated[list[Size], Field(min_length=2, max_length=2)] | None = None
    """Flat: how far the face reaches [left, right] from the point; an event tells where that is too short."""
    second: SecondDocument | None = None
    """Closure = "form": a second roller on a second cam of the same shaft, which pulls (a conjugate pair)."""
    side: Literal["left", "right"] | None = None
    """Oscillating: the point lies on this side of the line from the pivot to the cam's axis. Default left."""

    @model_validator(mode="after")
    def _one_face(self) -> FollowerDocument:
        found = one_of(self, FACES, "the follower")
        for key in ("knife", "flat"):
            if getattr(self, key) is False:
                found.append((key, "false says nothing.", f"Write {key} = true, or leave it out."))
        if self.second is not None and self.roller is None and self.sound("roller"):
            found.append(("second", "a second roller beside a face that is none.", "Give roller = ... too, or leave it out."))
        if not found and self.flat is None:
            for key in ("tilt", "face"):
                if key in self.model_fields_set:
                    found.append((key, f"{key} goes with a flat face.", "Leave it out."))
        refuse(found)
        return self


class EccentricDocument(Table):
    """A circular disc."""

    radius: Size
    """Its radius."""
    centre: Point
    """Its centre, in the axes of the cam's link."""


class BlankDocument(Table):
    """What a barrel or end cam is cut from."""

    radius: Size
    """Outer radius."""
    depth: Size
    """Depth of the groove, height of the rib, width of the end face."""
    thickness: Size | None = None
    """Rib: its thickness between the two rollers."""
    rollers: Annotated[int, Field(strict=True, ge=6, le=100)] | None = None
    """Barrel: an indexing cam for a turret of so many rollers, which goes on by one of them every turn. base is left out."""


class GloboidDocument(Table):
    """What a globoidal cam is cut from."""

    depth: Size
    """Depth of the groove: the roller's length along the arm, half of it on either side of the follower's point."""
    rollers: Annotated[int, Field(strict=True, ge=6, le=100)] | None = None
    """An indexing cam for a turret of so many rollers, which goes on by one of them every turn. base is left out."""


class ProfileDocument(Table):
    """How the cam is made: base circle and lift, or a given profile."""

    base: Annotated[float | str, Quantity(("length",), word=LEAST)] | None = None
    """Radius of the base circle; "least": the least that keeps to pressure_limit, curvature_limit and hub.
    Barrel, end, globoid: place of the roller along the axis at zero lift, from the cam's pin.
    Of a wedge: height of the profile at zero lift above the line of its own point.
    Groove: the follower's coordinate there, a bare number.
    With radius: the radius at the start."""
    lift: Annotated[list[LiftSegment], Field(min_length=1)] | None = None
    """Segments one after the other, over 360 deg of a disc; the follower starts on the base circle."""
    eccentric: EccentricDocument | None = None
    """Given profile: a circular disc."""
    outline: Annotated[list[Point], Field(min_length=2)] | None = None
    """Given profile of lines and arcs: its corners in the axes of the cam's link."""
    bulges: list[Number] | None = None
    """Outline: makes the side after each corner an arc: tangent of a quarter of its angle, positive counter-clockwise."""
    points: Annotated[list[Point], Field(min_length=7)] | None = None
    """Given profile: a spline through measured points in the axes of the cam's link."""
    file: Text | None = None
    """Given profile: a DXF drawing with one closed outline, or a CSV table of points. Path from the folder of the scene file."""
    file_unit: Size | None = None
    """Length of the unit of a file that does not state one, such as "1 mm"."""
    tolerance: Extent | None = None
    """Points, CSV: how far (root mean square) the spline may pass from them. Default 0."""
    radius: Annotated[list[RadiusSegment], Field(min_length=1)] | None = None
    """Given profile: radius over the polar angle in the cam's link, segments over 360 deg that start at base."""
    undercut: Literal["refuse", "cut"] = "refuse"
    """Lift: what to do where the follower is too large for the law: refuse, or make what the cutter really leaves."""
    barrel: BlankDocument | None = None
    """The cam's axis lies in the plane: a cylinder with a groove (closure = "form"). base: the roller's place along it."""
    rib: BlankDocument | None = None
    """The cam's axis lies in the plane: a cylinder with a rib between two rollers (closure = "form")."""
    end: BlankDocument | None = None
    """The cam's axis lies in the plane: the end face of a tube lifts the roller along it."""
    globoid: GloboidDocument | None = None
    """The cam's axis lies in the plane, across the line to the arm's pivot: a groove in a hollow that the arm sweeps out."""
    axis: Direction | None = None
    """Barrel, end cam with an arm: direction of the cam's axis in the frame of the link that carries it, its pivot to the right."""
    sense: Literal["ccw", "cw"] = "ccw"
    """The law is read as the cam turns counter-clockwise or clockwise; of a wedge: ccw along its bed, cw against it."""
    phase: Coordinate = 0.0
    """Added to the cam's coordinate: the law is ahead by this much."""
    bed: Text | None = None
    """Wedge: the prismatic joint that guides the cam, instead of a pin. Groove: that guides the link with the roller."""
    pressure_limit: Angle | None = None
    """A larger pressure angle is an event."""
    curvature_limit: Size | None = None
    """Lift of a disc: least radius of curvature of the convex profile; `mechviz cams` and `check` tell where it is smaller."""
    hub: Size | None = None
    """Beside base = "least": the base circle is not smaller than this."""

    @model_validator(mode="after")
    def _moves(self) -> ProfileDocument:
        found = one_of(self, SHAPES, "the profile")
        given = [key for key in SHAPES if getattr(self, key) is not None]
        kind = given[0] if len(given) == 1 else ""
        wants_base = kind in ("lift", "radius", "")
        turret = [key for key in ("barrel", "globoid") if getattr(getattr(self, key), "rollers", None) is not None]
        for key in ("rib", "end"):
            if getattr(getattr(self, key), "rollers", None) is not None:
                found.append((key, f"rollers do not go with {key}.", "Give barrel or globoid, or leave them out."))
        if turret and self.base is not None:
            found.append(
                ("base", "base does not go with a turret: a roller is as far before the middle as it goes.", "Leave it out.")
            )
        if kind and wants_base and not turret and self.base is None and self.sound("base"):
            found.append(("base", "'base' is missing.", "Give the radius of the base circle."))
        lone = {
            "base": ("lift", "radius"), "sense": ("lift",), "phase": ("lift",), "bed": ("lift",), "undercut": ("lift",),
            "curvature_limit": ("lift",), "hub": ("lift",),
            "bulges": ("outline",), "tolerance": ("points", "file"), "file_unit": ("file",),
        }  # fmt: skip
        for key, kinds in lone.items():
            if kind and kind not in kinds and key in self.model_fields_set:
                found.append((key, f"{key} does not go with {kind}.", f"It goes with {' and '.join(kinds)}: leave it out."))
        solids = [key for key in SOLIDS if getattr(self, key) is not None]
        if len(solids) > 1:
            found.append(("", f"the profile has {' and '.join(solids)} at once.", "Keep one of them."))
        for key in (*solids, *(["axis"] if self.axis is not None else [])):
            if kind and kind != "lift":
                found.append((key, f"{key} does not go with {kind}.", "It goes with lift: leave it out."))
            elif self.bed is not None:
                found.append((key, f"{key} does not go with a wedge.", "Leave bed out, and pin the cam to its axis."))
        if self.axis is not None and not solids:
            found.append(("axis", "a plane cam turns about an axis across the plane.", "Leave it out, or give barrel = ..."))
        if self.undercut == "cut" and solids:
            found.append(("undercut", "spatial cams are refused where they are undercut.", "Leave it out."))
        if self.base == LEAST:
            disc = kind in ("lift", "") and self.bed is None and not solids
            if not disc:
                found.append(("base", 'the value "least" is for discs with a lift.', "Give a length."))
            elif self.pressure_limit is None and self.curvature_limit is None and self.hub is None:
                why = "the least base circle for which limit?"
                found.append(("base", why, "Add pressure_limit, curvature_limit or hub."))
        elif self.hub is not None:
            found.append(("hub", 'hub goes with base = "least".', "Leave it out."))
        elif self.base is not None and self.sound("base") and not solids:
            size = magnitude(self.base) if isinstance(self.base, str) else self.base
            if size < 0.0:
                words = describe(self.base) if isinstance(self.base, str) else f"{self.base:g}"
                found.append(("base", f"{words} is negative.", "Give a positive value."))
        if self.rib is not None and self.rib.thickness is None and self.rib.sound("thickness"):
            found.append(("rib", "'thickness' is missing.", "Give the thickness of the rib."))
        segments = self.lift if kind == "lift" else self.radius if kind == "radius" else None
        if (
            segments
            and self.sound(kind)
            and all(s.to is None and s.sound("to") and not isinstance(s.law, LawDocument) for s in segments)
        ):
            found.append((kind, "all segments are dwells: nothing moves.", "Give one of them an end, to = ..."))
        if kind == "outline" and self.bulges is not None and self.outline is not None and len(self.bulges) != len(self.outline):
            found.append(("bulges", f"{len(self.bulges)} bulges for {len(self.outline)} corners.", "Give one for every corner."))
        refuse(found)
        return self


def cam_joint(name: str, joint: JointDocument, oscillates: bool, friction: Friction | None, convert: Converter) -> Joint | None:
    """The core's joint, None where a fault was noted."""
    path = f"joints.{name}"
    profile, follower = joint.profile, joint.follower
    if profile is None or follower is None:
        return None
    before = len(convert.faults)
    along, across = ("length" if profile.bed else "angle"), ("angle" if oscillates else "length")
    measure = across if follower.groove is not None else "length"  # an inverse cam's groove starts at a coordinate
    least = profile.base == LEAST
    if least and follower.groove is not None:
        convert.note(f"{path}.profile.base", 'the value "least" is for discs with a lift.', "Give a length.")
    base = 0.0 if profile.base is None or least else convert.si(profile.base, measure, f"{path}.profile.base")
    hub, sharpest = (
        None if value is None else convert.si(value, "length", f"{path}.profile.{key}")
        for key, value in (("hub", profile.hub), ("curvature_limit", profile.curvature_limit))
    )
    phase = convert.si(profile.phase, along, f"{path}.profile.phase")
    limit = None
    if profile.pressure_limit is not None:
        limit = convert.si(profile.pressure_limit, "angle", f"{path}.profile.pressure_limit")
        if not 0.0 < limit < 0.5 * math.pi and not math.isnan(limit):
            usual = f"Usual are {as_angle(math.radians(30.0), 3)} to {as_angle(math.radians(45.0), 3)}."
            convert.note(f"{path}.profile.pressure_limit", f"{as_angle(limit)}.", usual)
    face = _face(follower, path, convert)
    second = None
    if follower.second is not None:
        second = (follower.second.point, convert.si(follower.second.roller, "length", f"{path}.follower.second.roller"))
    if friction is not None and friction.coefficient:
        roller = follower.roller if follower.groove is None else follower.groove
        if roller is not None and not friction.radius:
            convert.note(f"{path}.friction", "'radius' is missing: a roller rolls, and rubs on its pin.", 'Add radius = "4 mm".')
        elif roller is not None and not friction.radius < convert.si(roller, "length", f"{path}.follower"):
            convert.note(f"{path}.friction.radius", "the pin is not thinner than its roller.", "Give a smaller radius.")
        elif roller is None and friction.radius:
            convert.note(f"{path}.friction", "a radius of a pin where there is no roller.", "Leave it out.")
    lift, contour = None, None
    if profile.lift is not None:
        round_again = not profile.bed and follower.groove is None
        lift = lift_curve(profile.lift, Axes(convert, across, along), f"{path}.profile.lift", 0.0, round_again)
    elif len(convert.faults) == before:
        contour = given_contour(profile, base, f"{path}.profile", convert)
    rating = None if joint.rating is None else rating_of(joint.rating, f"{path}.rating", convert)
    if joint.rating is not None and joint.rating.margin is not None and joint.closure == "form":
        convert.note(f"{path}.rating.margin", "a groove or yoke holds the follower whatever the force.", "Leave it out.")
    drawn = None if joint.graphical is None else graphical_of(joint.graphical, across, f"{path}.graphical", convert)
    other = profile.bed is not None or follower.groove is not None or any(getattr(profile, key) is not None for key in SOLIDS)
    if joint.graphical is not None and other:
        convert.note(f"{path}.graphical", "the method turns a plane disc cam step by step.", "Leave it out for other cams.")
    if len(convert.faults) > before or math.isnan(base) or math.isnan(phase) or face is None or (lift is None) == (contour is None):
        return None
    return CamJoint(
        name=name,
        links=joint.links,
        guide=follower.guide,
        point=follower.point,
        lift=lift,
        face=face,
        base=base,
        contour=contour,
        undercut=profile.undercut,
        bed=profile.bed,
        sense=-1 if profile.sense == "cw" else 1,
        phase=phase,
        side=follower.side or "left",
        closure=joint.closure or "force",
        second=second,
        friction=friction,
        inverse=follower.groove is not None,
        spatial=_blank(profile, f"{path}.profile", convert),
        pressure_limit=limit,
        curvature_limit=sharpest,
        least=least,
        hub=hub or 0.0,
        rating=rating,
        drawn=drawn,
    )


def _blank(profile: ProfileDocument, path: str, convert: Converter) -> SpatialBlank | None:
    """What a spatial cam is cut from; None of a plane one."""
    kind = next((key for key in SOLIDS if getattr(profile, key) is not None), None)
    if kind is None:
        return None
    table = getattr(profile, kind)
    axis = None
    if profile.axis is not None:
        if any(isinstance(v, str) for v in profile.axis):
            convert.note(f"{path}.axis", "names of points where a direction is wanted.", "Write it like [1, 0].")
            return None
        axis = (float(profile.axis[0]), float(profile.axis[1]))
    sizes = [
        convert.si(getattr(table, key, None) or 0.0, "length", f"{path}.{kind}.{key}") for key in ("radius", "depth", "thickness")
    ]
    rollers = getattr(table, "rollers", None) or 0
    return SpatialBlank(kind, sizes[0], sizes[1], axis, sizes[2], 0 if math.isnan(rollers) else rollers)


def _face(follower: FollowerDocument, path: str, convert: Converter) -> Any:
    if follower.groove is not None:
        radius = convert.si(follower.groove, "length", f"{path}.follower.groove")
        return None if math.isnan(radius) else Roller(radius)
    if follower.roller is not None:
        radius = convert.si(follower.roller, "length", f"{path}.follower.roller")
        return None if math.isnan(radius) else Roller(radius)
    if follower.mushroom is not None:
        radius = convert.si(follower.mushroom, "length", f"{path}.follower.mushroom")
        return None if math.isnan(radius) else Arc(radius)
    if follower.flat:
        tilt = convert.si(follower.tilt, "angle", f"{path}.follower.tilt")
        if abs(tilt) > _STEEPEST:
            convert.note(f"{path}.follower.tilt", f"{as_angle(tilt)}.", f"Give less than {as_angle(_STEEPEST)}.")
            return None
        reach = (math.inf, math.inf) if follower.face is None else convert.row(follower.face, "length", f"{path}.follower.face")
        return None if any(map(math.isnan, (tilt, *reach))) else Flat(tilt=tilt, left=reach[0], right=reach[1])
    return Knife()
