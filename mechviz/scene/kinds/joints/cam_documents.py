"""Documents of cams: profile, follower and blank, the rating of a contact, and the graphical method beside the exact lift."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator

from mechcore.spec.mechanism import CamDrawn, CamRating
from mechcore.texts import as_angle, as_length
from mechviz.scene.faults import did_you_mean
from mechviz.scene.fields import (
    Angle,
    Coordinate,
    Direction,
    DocumentTable,
    Effort,
    Extent,
    Flag,
    Number,
    Point,
    Pressure,
    QuantityMark,
    Range,
    Size,
    Text,
    UnknownName,
    one_of,
    raise_faults,
)
from mechviz.scene.kinds.segments import LawDocument, LiftSegment, RadiusSegment
from mechviz.scene.names import FileName

if TYPE_CHECKING:
    from mechviz.scene.convert import Converter


SOLIDS: tuple[Literal["barrel", "rib", "end", "globoid"], ...] = ("barrel", "rib", "end", "globoid")
SHAPES = ("lift", "eccentric", "outline", "points", "file", "radius")
FACES = ("knife", "roller", "mushroom", "flat", "groove")
LEAST = "least"


class SecondDocument(DocumentTable):
    """The second roller of a conjugate pair."""

    roller: Size
    """Its radius."""
    point: Text
    """Its centre, a point of the follower on the other side of the cam's axis."""


class FollowerDocument(DocumentTable):
    """The follower: the face that touches the cam, and its guide."""

    groove: Size | None = None
    """Inverse cam: the groove is on the follower, for a roller of this radius on the cam's link, a crank or, with bed, a slide
    (closure = "form")."""
    knife: Flag | None = None
    """A knife edge, true."""
    roller: Annotated[float | str, QuantityMark(("length",), "above zero", word=LEAST)] | None = None
    """Radius of a roller; "least": the least that keeps to the limit of the rating's Hertz pressure on a disc with a lift."""
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
    """Flat: how far the face reaches [left, right] from the point; where that is too short is an event."""
    second: SecondDocument | None = None
    """Closure = "form": a second roller on a second cam of the same shaft, which pulls (a conjugate pair)."""
    offset: Literal["least"] | None = None
    """Offset of the guide: "least", beside base = "least", places the guide where the base circle is least."""
    side: Literal["left", "right"] | None = None
    """Oscillating: the point lies on this side of the line from the pivot to the cam's axis. Default left."""

    @model_validator(mode="after")
    def _one_face(self) -> FollowerDocument:
        wrong = one_of(self, FACES, "the follower")
        for key in ("knife", "flat"):
            if getattr(self, key) is False:
                wrong.append((key, "false says nothing.", f"Write {key} = true, or leave it out."))
        if self.second is not None and self.roller is None and self.has_valid("roller"):
            wrong.append(("second", "a second roller beside a face that is none.", "Give roller = ... too, or leave it out."))
        if not wrong and self.flat is None:
            for key in ("tilt", "face"):
                if key in self.model_fields_set:
                    wrong.append((key, f"{key} goes with a flat face.", "Leave it out."))
        raise_faults(wrong)
        return self


class EccentricDocument(DocumentTable):
    """A circular disc."""

    radius: Size
    """Its radius."""
    centre: Point
    """Its centre, in the axes of the cam's link."""


class BlankDocument(DocumentTable):
    """The blank of a barrel or end cam."""

    radius: Size
    """Outer radius."""
    depth: Size
    """Depth of the groove, height of the rib, width of the end face."""
    thickness: Size | None = None
    """Rib: its thickness between the two rollers."""
    rollers: Annotated[int, Field(strict=True, ge=6, le=100)] | None = None
    """Barrel: an indexing cam for a turret of so many rollers, which advances by one of them every turn. base is left out."""


class GloboidDocument(DocumentTable):
    """The blank of a globoidal cam."""

    depth: Size
    """Depth of the groove: the roller's length along the arm, half of it on either side of the follower's point."""
    rollers: Annotated[int, Field(strict=True, ge=6, le=100)] | None = None
    """An indexing cam for a turret of so many rollers, which advances by one of them every turn. base is left out."""


class ProfileDocument(DocumentTable):
    """How the cam is made: base circle and lift, or a given profile."""

    base: Annotated[float | str, QuantityMark(("length",), word=LEAST)] | None = None
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
    file: FileName | None = None
    """Given profile: a DXF drawing with one closed outline, or a CSV table of points. Path from the folder of the scene file."""
    file_unit: Size | None = None
    """Length of the unit of a file that does not state one, such as "1 mm"."""
    tolerance: Extent | None = None
    """Points, CSV: root mean square distance at which the spline may pass them. Default 0."""
    radius: Annotated[list[RadiusSegment], Field(min_length=1)] | None = None
    """Given profile: radius over the polar angle in the cam's link, segments over 360 deg that start at base."""
    undercut: Literal["refuse", "cut"] = "refuse"
    """Lift, where the follower is too large for the law: "refuse", or "cut", the profile that the cutter really leaves."""
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
    """Lift of a disc: least radius of curvature of the convex profile; `mechviz cams` and `check` report where it is smaller."""
    hub: Size | None = None
    """Beside base = "least": the base circle is not smaller than this."""

    @model_validator(mode="after")
    def _moves(self) -> ProfileDocument:
        wrong = one_of(self, SHAPES, "the profile")
        given = [key for key in SHAPES if getattr(self, key) is not None]
        kind = given[0] if len(given) == 1 else ""
        wants_base = kind in ("lift", "radius", "")
        turret = [key for key in ("barrel", "globoid") if getattr(getattr(self, key), "rollers", None) is not None]
        for key in ("rib", "end"):
            if getattr(getattr(self, key), "rollers", None) is not None:
                wrong.append((key, f"rollers do not go with {key}.", "Give barrel or globoid, or leave them out."))
        if turret and self.base is not None:
            wrong.append(
                ("base", "base does not go with a turret: a roller is as far before the middle as it goes.", "Leave it out.")
            )
        if kind and wants_base and not turret and self.base is None and self.has_valid("base"):
            wrong.append(("base", "'base' is missing.", "Give the radius of the base circle."))
        lone = {
            "base": ("lift", "radius"), "sense": ("lift",), "phase": ("lift",), "bed": ("lift",), "undercut": ("lift",),
            "curvature_limit": ("lift",), "hub": ("lift",),
            "bulges": ("outline",), "tolerance": ("points", "file"), "file_unit": ("file",),
        }  # fmt: skip
        for key, kinds in lone.items():
            if kind and kind not in kinds and key in self.model_fields_set:
                wrong.append((key, f"{key} does not go with {kind}.", f"It goes with {' and '.join(kinds)}: leave it out."))
        solids = [key for key in SOLIDS if getattr(self, key) is not None]
        if len(solids) > 1:
            wrong.append(("", f"the profile has {' and '.join(solids)} at once.", "Keep one of them."))
        for key in (*solids, *(["axis"] if self.axis is not None else [])):
            if kind and kind != "lift":
                wrong.append((key, f"{key} does not go with {kind}.", "It goes with lift: leave it out."))
            elif self.bed is not None:
                wrong.append((key, f"{key} does not go with a wedge.", "Leave bed out, and pin the cam to its axis."))
        if self.axis is not None and not solids:
            wrong.append(("axis", "a plane cam turns about an axis across the plane.", "Leave it out, or give barrel = ..."))
        if self.undercut == "cut" and solids:
            wrong.append(("undercut", "spatial cams are refused where they are undercut.", "Leave it out."))
        if self.base == LEAST:
            disc = kind in ("lift", "") and self.bed is None and not solids
            if not disc:
                wrong.append(("base", 'the value "least" is for discs with a lift.', "Give a length."))
            elif self.pressure_limit is None and self.curvature_limit is None and self.hub is None:
                why = "the least base circle for which limit?"
                wrong.append(("base", why, "Add pressure_limit, curvature_limit or hub."))
        elif self.hub is not None:
            wrong.append(("hub", 'hub goes with base = "least".', "Leave it out."))
        if self.rib is not None and self.rib.thickness is None and self.rib.has_valid("thickness"):
            wrong.append(("rib", "'thickness' is missing.", "Give the thickness of the rib."))
        segments = self.lift if kind == "lift" else self.radius if kind == "radius" else None
        if (
            segments
            and self.has_valid(kind)
            and all(s.to is None and s.has_valid("to") and not isinstance(s.law, LawDocument) for s in segments)
        ):
            wrong.append((kind, "all segments are dwells: nothing moves.", "Give one of them an end, to = ..."))
        if kind == "outline" and self.bulges is not None and self.outline is not None and len(self.bulges) != len(self.outline):
            wrong.append(("bulges", f"{len(self.bulges)} bulges for {len(self.outline)} corners.", "Give one for every corner."))
        raise_faults(wrong)
        return self


MATERIALS: Mapping[str, tuple[float, float]] = {
    "steel": (2.1e11, 0.30),
    "cast iron": (1.1e11, 0.26),
    "bronze": (1.1e11, 0.34),
    "aluminium": (7.0e10, 0.33),
    "polyamide": (2.8e9, 0.39),
    "acetal": (3.0e9, 0.37),
}
"""Young's modulus [Pa] and Poisson's ratio: usual values of handbooks; grades differ by a tenth, plastics by more."""

_FEWEST, _MOST = 4, 100_000  # steps of a turn
_THINNEST = 1e-9  # width of a contact [m]


class RatingDocument(DocumentTable):
    """Criteria of the contact of a cam."""

    width: Size | None = None
    """Length of the line on which cam and follower touch, across the plane: with it the Hertz pressure is computed."""
    materials: Annotated[list[Text], Field(min_length=2, max_length=2)] | None = None
    """[cam, follower]: steel, cast iron, bronze, aluminium, polyamide, acetal. Default steel on steel."""
    modulus: Annotated[list[Pressure], Field(min_length=2, max_length=2)] | None = None
    """Young's moduli [cam, follower], instead of materials."""
    poisson: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = None
    """Poisson's ratios [cam, follower], beside modulus. Default 0.3."""
    limit: Pressure | None = None
    """Largest allowed Hertz pressure; more is an event."""
    margin: Effort | None = None
    """Closure = "force": least contact force that must remain; less is an event, and `mechviz cams` gives the least spring for
    it."""

    @model_validator(mode="after")
    def _agrees(self) -> RatingDocument:
        wrong = []
        if self.modulus is not None and self.materials is not None:
            wrong.append(("modulus", "materials and modulus at once.", "Keep one of them."))
        if self.poisson is not None and self.modulus is None:
            wrong.append(("poisson", "poisson goes with modulus.", "Give modulus too, or leave it out."))
        for key in ("materials", "modulus", "limit"):
            if getattr(self, key) is not None and self.width is None and self.has_valid("width"):
                wrong.append((key, f"{key} without a width of the contact.", 'Add width = "12 mm".'))
        for k, name in enumerate(self.materials or []):
            if not isinstance(name, UnknownName) and isinstance(name, str) and name not in MATERIALS:
                near = did_you_mean(name, MATERIALS, what="Materials")
                wrong.append((f"materials[{k}]", f"'{name}' is no material.", near or "Give modulus = [...] instead."))
        for k, ratio in enumerate(self.poisson or []):
            if isinstance(ratio, float) and not -1.0 < ratio <= 0.5:
                wrong.append((f"poisson[{k}]", f"{ratio:g} is no Poisson's ratio.", "Metals have 0.25 to 0.35, none is above 0.5."))
        raise_faults(wrong)
        return self


class GraphicalDocument(DocumentTable):
    """The lift by the graphical method of the lecture, beside the exact one."""

    step: Angle
    """Step of the cam's angle from point to point; a turn has a whole number of steps, at least four."""
    lines: Literal["chord", "tangent"] = "chord"
    """Differentiation of the curves: slopes of their chords, or of tangents laid by eye."""
    resolution: Range = 0.0
    """Resolution of readings from the drawing: a length, of an oscillating follower an angle. Default 0."""


def rating_of(rating: RatingDocument, path: str, convert: Converter) -> CamRating:
    """The core's rating; faults are noted."""

    def number(value: float | str | None, kind: str, key: str) -> float | None:
        return None if value is None else convert.si(value, kind, f"{path}.{key}")

    first, second = (MATERIALS.get(name, MATERIALS["steel"]) for name in rating.materials or ("steel", "steel"))
    modulus, poisson = (first[0], second[0]), (first[1], second[1])
    if rating.modulus is not None:
        a, b = convert.row(rating.modulus, "pressure", f"{path}.modulus")
        modulus = (a, b)
        poisson = (0.3, 0.3) if rating.poisson is None else (float(rating.poisson[0]), float(rating.poisson[1]))
    width = number(rating.width, "length", "width")
    if width is not None and width < _THINNEST:
        convert.note(f"{path}.width", f"{as_length(width)} is below {as_length(_THINNEST)}.", "Check the number and its unit.")
    return CamRating(
        width=width,
        modulus=modulus,
        poisson=poisson,
        limit=number(rating.limit, "pressure", "limit"),
        margin=number(rating.margin, "force", "margin"),
    )


def graphical_of(graphical: GraphicalDocument, across: str, path: str, convert: Converter) -> CamDrawn | None:
    """The core's specification of the drawing; ``across``: the kind of the follower's coordinate. Faults are noted."""
    step = convert.si(graphical.step, "angle", f"{path}.step")
    resolution = convert.si(graphical.resolution, across, f"{path}.resolution")
    if math.isnan(step) or math.isnan(resolution):
        return None
    whole = whole_step(step)
    if whole is None:
        convert.note(f"{path}.step", *step_fault(step))
        return None
    return CamDrawn(step=whole, lines=graphical.lines, resolution=resolution)


def whole_step(step: float) -> float | None:
    """The exact step [rad] that divides a turn into 4 to 100,000 steps, where ``step`` is that up to rounding; else None."""
    turns = 2.0 * math.pi / step if step > 0.0 else 0.0
    if not _FEWEST - 1e-6 <= turns <= _MOST + 1e-6 or abs(turns - round(turns)) > 1e-6:
        return None
    return 2.0 * math.pi / round(turns)


def step_fault(step: float) -> tuple[str, str]:
    """Message and remedy for a step [rad] that ``whole_step`` does not accept."""
    turns = 2.0 * math.pi / step if step > 0.0 else math.inf
    size = as_angle(step)
    if step > 0.0 and turns > _MOST:
        return f"{size} are {turns:.6g} steps of a turn, more than {_MOST}.", f"Give at least {as_angle(2.0 * math.pi / _MOST)}."
    if turns < _FEWEST:
        return f"{size} are {turns:.4g} steps of a turn, less than {_FEWEST}.", f"Give at most {as_angle(2.0 * math.pi / _FEWEST)}."
    usual = [as_angle(math.radians(degrees), 3) for degrees in (30, 15, 10, 5)]
    return f"{size} do not make a turn.", f"Usual are {', '.join(usual[:3])} or {usual[3]}."
