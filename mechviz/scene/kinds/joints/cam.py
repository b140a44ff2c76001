"""Cams: the names that they refer to, the joint of the core, and its contour where the profile is given."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal

from mechcore.cams import contour as shapes
from mechcore.cams.contour import Contour, self_crossing
from mechcore.cams.followers import Arc, Flat, Knife, Roller
from mechcore.errors import Fault, MechanismError
from mechcore.spec.mechanism import CamJoint, Joint, SpatialBlank
from mechcore.texts import as_angle, as_length
from mechviz.scene.faults import did_you_mean
from mechviz.scene.fields import DocumentTable, UnknownName
from mechviz.scene.kinds.cam_files import read_dxf, read_points
from mechviz.scene.kinds.drives import LiftoffDocument
from mechviz.scene.kinds.friction import ROLLER
from mechviz.scene.kinds.joints.cam_documents import (
    LEAST,
    SHAPES,
    SOLIDS,
    FollowerDocument,
    GraphicalDocument,
    ProfileDocument,
    RatingDocument,
    graphical_of,
    rating_of,
)
from mechviz.scene.kinds.kind import JointKind, JointMaker
from mechviz.scene.kinds.segment_curves import Axes, lift_curve, note_corners
from mechviz.scene.names import TwoLinks, known_point

if TYPE_CHECKING:
    from mechviz.scene.convert import Converter
    from mechviz.scene.document import SceneDocument
    from mechviz.scene.kinds.joints.document import JointDocument
    from mechviz.scene.reading.recovery import Reading

_STEEPEST = math.radians(89.0)
_FINEST_UNIT = 1e-9  # of a drawing [m]
_SMALL = 1e-6  # radius from which the least roller is sought [m]


class CamKeys(DocumentTable):
    """The keyword of cams, and the keys that only they have."""

    cam: TwoLinks | None = None
    """[cam, follower], both guided on one link."""
    profile: ProfileDocument | None = None
    """Cam: base circle and lift."""
    follower: FollowerDocument | None = None
    """Cam: the follower's face and its guide."""
    closure: Literal["force", "form"] | None = None
    """Cam: "force", the follower is only pressed on it (by a spring, its weight); "form", a groove or a yoke holds it too.
    Default force."""
    rating: RatingDocument | None = None
    """Cam: criteria of its contact: Hertz pressure, a margin of the contact force."""
    graphical: GraphicalDocument | None = None
    """Cam: also its lift by the graphical method, with the error of that."""
    liftoff: LiftoffDocument | None = None
    """Cam: the follower may leave it, flies under the forces and lands with an impact; the run then has a duration."""


def _cam(m: JointMaker) -> Joint | None:
    """The core's joint, None where a fault was noted."""
    joint, path, convert, friction = m.joint, m.path, m.convert, m.friction
    profile, follower = joint.profile, joint.follower
    if profile is None or follower is None:
        return None
    guide = m.document.joints.get(follower.guide)
    oscillates = guide is not None and guide.kind == "revolute"
    before = len(convert.faults)
    along, across = ("length" if profile.bed else "angle"), ("angle" if oscillates else "length")
    measure = across if follower.groove is not None else "length"  # an inverse cam's groove starts at a coordinate
    least = profile.base == LEAST
    if least and follower.groove is not None:
        convert.note(f"{path}.profile.base", 'the value "least" is for discs with a lift.', "Give a length.")
    base = 0.0 if profile.base is None or least else convert.si(profile.base, measure, f"{path}.profile.base")
    solid = any(getattr(profile, key) is not None for key in SOLIDS)
    if base < 0.0 and not (profile.bed or solid or follower.groove is not None):  # else base is a position
        convert.note(f"{path}.profile.base", f"{as_length(base)} is negative.", "Give a positive value.")
    if follower.side is not None and guide is not None and not oscillates:
        convert.note(f"{path}.follower.side", "a follower in a straight guide has no arm with sides.", "Leave it out.")
    _note_unused(profile, f"{path}.profile", convert, inverse=follower.groove is not None, solid=solid)
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
    face = _face(follower, path, convert, 0.0 if friction is None else friction.radius)
    second = None
    if follower.second is not None:
        second = (follower.second.point, convert.si(follower.second.roller, "length", f"{path}.follower.second.roller"))
    if friction is not None and friction.coefficient:
        roller = follower.roller if follower.groove is None else follower.groove
        if roller is not None and not friction.radius:
            convert.note(f"{path}.friction", "'radius' is missing: a roller rolls, and rubs on its pin.", 'Add radius = "4 mm".')
        elif roller is not None and roller != LEAST and not friction.radius < convert.si(roller, "length", f"{path}.follower"):
            convert.note(f"{path}.friction.radius", "the pin is not thinner than its roller.", "Give a smaller radius.")
        elif roller is None and friction.radius:
            convert.note(f"{path}.friction", "a radius of a pin where there is no roller.", "Leave it out.")
    lift, contour = None, None
    if profile.lift is not None:
        round_again = not profile.bed and follower.groove is None
        axes, place = Axes(convert, across, along), f"{path}.profile.lift"
        lift = lift_curve(profile.lift, axes, place, 0.0, round_again)
        plane = follower.groove is None and not solid
        if lift is not None and plane and not follower.knife and profile.undercut != "cut":
            note_corners(profile.lift, lift, axes, place, rotary=oscillates)
    elif len(convert.faults) == before:
        contour = _given_contour(profile, base, f"{path}.profile", convert)
    rating = None if joint.rating is None else rating_of(joint.rating, f"{path}.rating", convert)
    if joint.rating is not None and joint.rating.margin is not None and joint.closure == "form":
        convert.note(f"{path}.rating.margin", "a groove or yoke holds the follower whatever the force.", "Leave it out.")
    drawn = None if joint.graphical is None else graphical_of(joint.graphical, across, f"{path}.graphical", convert)
    other = profile.bed is not None or follower.groove is not None or solid
    if joint.graphical is not None and other:
        convert.note(f"{path}.graphical", "the method turns a plane disc cam step by step.", "Leave it out for other cams.")
    asked = _least_sizes(joint, path, convert, other=other, oscillates=oscillates)
    if len(convert.faults) > before or math.isnan(base) or math.isnan(phase) or face is None or (lift is None) == (contour is None):
        return None
    return CamJoint(
        name=m.name,
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
        least=asked,
        hub=hub or 0.0,
        rating=rating,
        drawn=drawn,
    )


def _note_unused(profile: ProfileDocument, path: str, convert: Converter, *, inverse: bool, solid: bool) -> None:
    """Note keys that the kind of cam does not use, so that no limit is stated that is never checked."""
    if profile.curvature_limit is not None and (inverse or solid):
        what = "an inverse cam" if inverse else "a cam with its axis in the plane"
        convert.note(
            f"{path}.curvature_limit", f"of {what} the curvature is not judged.", "Leave it out; it goes with discs and wedges."
        )
    if profile.undercut == "cut" and (inverse or profile.bed):
        what = "inverse cams" if inverse else "wedges"
        convert.note(f"{path}.undercut", f"{what} are refused where they are undercut.", "Leave it out; it goes with discs.")


def _least_sizes(
    joint: JointDocument, path: str, convert: Converter, *, other: bool, oscillates: bool
) -> tuple[Literal["base", "offset", "roller"], ...]:
    """The sizes to be minimised; ``other``: the cam is no disc. Faults are noted."""
    profile, follower, rating = joint.profile, joint.follower, joint.rating
    assert profile is not None and follower is not None
    asked: list[Literal["base", "offset", "roller"]] = ["base"] if profile.base == LEAST else []
    if follower.offset is not None:
        asked.append("offset")
        if profile.base != LEAST:
            convert.note(
                f"{path}.follower.offset", 'the offset of which base circle is least? base is not "least".', 'Add base = "least".'
            )
        elif oscillates or follower.flat is not None:
            why = "of a flat face it changes nothing but the stem's load." if follower.flat else "an arm has none."
            convert.note(f"{path}.follower.offset", why, "Leave it out.")
    if follower.roller == LEAST:
        asked.append("roller")
        where = f"{path}.follower.roller"
        if other or profile.lift is None or follower.second is not None or joint.closure == "form":
            convert.note(
                where, 'the value "least" is for discs with a lift and a follower that is pressed on them.', "Give a length."
            )
        elif rating is None or rating.width is None or rating.limit is None:
            remedy = 'Add rating = { width = "8 mm", limit = "600 MPa" }, or give a length.'
            convert.note(where, "the least roller for which Hertz pressure?", remedy)
    return tuple(asked)


def _blank(profile: ProfileDocument, path: str, convert: Converter) -> SpatialBlank | None:
    """Blank of a spatial cam; None of a plane one."""
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


def _face(follower: FollowerDocument, path: str, convert: Converter, pin: float) -> Any:
    """The core's face of the follower, None where a fault was noted. A roller to be minimised is first a small one, larger than its
    ``pin`` (radius [m])."""
    if follower.groove is not None:
        radius = convert.si(follower.groove, "length", f"{path}.follower.groove")
        return None if math.isnan(radius) else Roller(radius)
    if follower.roller == LEAST:
        return Roller(max(_SMALL, 2.0 * pin))
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


def _given_contour(profile: ProfileDocument, base: float, path: str, convert: Converter) -> Contour | None:
    """A given profile in the axes of the cam's link [m]; faults of it are noted."""
    contour = _shape(profile, base, path, convert)
    # circles and radii over the polar angle never cross themselves
    place = self_crossing(contour) if contour is not None and profile.eccentric is None and profile.radius is None else None
    if place is None:
        return contour
    key = next(k for k in SHAPES if getattr(profile, k) is not None)
    near = f"x = {as_length(place.real, 4)}, y = {as_length(place.imag, 4)}"
    why = f"it crosses itself near {near}: profiles that cross themselves are no cam."
    convert.note(f"{path}.{key}", why, "Give the points once round the cam, in order.")
    return None


def _shape(profile: ProfileDocument, base: float, path: str, convert: Converter) -> Contour | None:
    try:
        if profile.eccentric is not None:
            radius = convert.si(profile.eccentric.radius, "length", f"{path}.eccentric.radius")
            x, y = convert.row(profile.eccentric.centre, "length", f"{path}.eccentric.centre")
            return None if math.isnan(radius + x + y) else shapes.circle(radius, complex(x, y))
        if profile.outline is not None:
            return shapes.bulged(_places(profile.outline, f"{path}.outline", convert), profile.bulges)
        if profile.points is not None:
            tolerance = 0.0 if profile.tolerance is None else convert.si(profile.tolerance, "length", f"{path}.tolerance")
            return shapes.spline_contour(_places(profile.points, f"{path}.points", convert), tolerance)[0]
        if profile.file is not None:
            return _from_file(profile, path, convert)
        if profile.radius is not None:
            curve = lift_curve(profile.radius, Axes(convert, "length", "angle"), f"{path}.radius", base, True)
            if curve is None:
                return None
            if abs(curve.advance) > 1e-12 * max(base, 1e-3):
                convert.note(f"{path}.radius", "it does not end where it starts.", f"Let it return to {as_length(base)}.")
                return None
            return shapes.polar_contour(curve)
    except MechanismError as error:
        for f in error.faults:
            key = "tolerance" if f.path == "contour.tolerance" else next(k for k in SHAPES if getattr(profile, k) is not None)
            convert.note(f"{path}.{key}", f.message, f.remedy)
    return None


def _places(points: Sequence[Sequence[float | str]], path: str, convert: Converter) -> list[complex]:
    return [complex(*convert.row(p, "length", f"{path}[{k}]")) for k, p in enumerate(points)]


def _from_file(profile: ProfileDocument, path: str, convert: Converter) -> Contour | None:
    name = str(profile.file)
    data = convert.file(name, f"{path}.file")
    if data is None:
        return None
    stated = None if profile.file_unit is None else convert.si(profile.file_unit, "length", f"{path}.file_unit")
    if stated is not None and not stated >= _FINEST_UNIT:  # NaN is noted already
        if not math.isnan(stated):
            convert.note(f"{path}.file_unit", f"{as_length(stated)} is no unit of a drawing.", 'Give one such as "1 mm".')
        return None
    tolerance = 0.0 if profile.tolerance is None else convert.si(profile.tolerance, "length", f"{path}.tolerance")
    if name.lower().endswith(".dxf"):
        if profile.tolerance is not None:
            convert.note(f"{path}.tolerance", "a drawing is taken as it is.", "Leave it out.")
        z, bulges, unit = read_dxf(data)
    else:
        z, unit = read_points(data)
        bulges = None
    scale = stated or unit
    if scale is None:
        convert.note(f"{path}.file_unit", f"'{name}' does not say its unit.", 'Add file_unit = "1 mm".')
        return None
    if unit is not None and abs(scale - unit) > 1e-9 * unit:
        why = f"{as_length(scale)}, but '{name}' says that its unit is {as_length(unit)}."
        convert.note(f"{path}.file_unit", why, "Leave it out, or correct the file.")
        return None
    if math.isnan(tolerance):
        return None
    return shapes.spline_contour(scale * z, tolerance)[0] if bulges is None else shapes.bulged(scale * z, bulges)


def _swapped(document: SceneDocument, joint: JointDocument) -> bool:
    """Whether guide and point of the follower are those of the first link, and not of the second."""
    assert joint.follower is not None
    guide, point = document.joints.get(joint.follower.guide), joint.follower.point
    if guide is None or any(link not in document.links for link in joint.links):
        return False
    own = [link in guide.links and point in document.links[link].points for link in joint.links]
    return own[0] and joint.links[1] not in guide.links and point not in document.links[joint.links[1]].points


def _check_cam(reading: Reading, path: str, joint: JointDocument) -> Iterator[Fault]:
    """Faults of the joints and the point that a cam names."""
    document = reading.document
    cam, follower = joint.links
    if joint.follower is not None and joint.follower.groove is None and _swapped(document, joint):
        why = f"guide '{joint.follower.guide}' and point '{joint.follower.point}' of the follower are on '{cam}', named as the cam."
        yield Fault(f"{path}.cam", why, f'Name the cam first, then its follower: cam = ["{follower}", "{cam}"].')
        return
    wanted: list[tuple[str, str, str, tuple[str, ...]]] = []
    if joint.follower is not None:
        wanted.append((f"{path}.follower.guide", joint.follower.guide, follower, ("prismatic", "revolute")))
    if joint.profile is not None and joint.profile.bed is not None:
        wanted.append((f"{path}.profile.bed", joint.profile.bed, cam, ("prismatic",)))
    for where, name, link, kinds in wanted:
        if isinstance(name, UnknownName) or link not in document.links or reading.kindless_joints:
            continue
        if name in document.joints and any(isinstance(own, UnknownName) for own in document.joints[name].links):
            continue
        guides = [key for key, other in document.joints.items() if other.kind in kinds and link in other.links]
        if name not in guides and "*" not in reading.unreadable["joints"]:
            words = " or ".join(kinds)
            known = name in document.joints
            message = f"'{name}' is no {words} joint of '{link}'." if known else f"there is no joint '{name}'."
            near = did_you_mean(name, guides, what=f"Joints that guide '{link}'")
            yield Fault(where, message, near or f"Add a {words} joint that guides '{link}'.")
    if joint.follower is not None and not isinstance(joint.follower.point, UnknownName):
        owner = follower if joint.follower.groove is None else cam
        yield from known_point(reading, f"{path}.follower.point", owner, joint.follower.point)
        if joint.follower.groove is not None and joint.closure != "form" and not joint.invalid_keys:
            yield Fault(f"{path}.follower.groove", "a groove where closure is 'force'.", "Add closure = 'form'.")
        second = joint.follower.second
        if second is not None and not isinstance(second.point, UnknownName):
            yield from known_point(reading, f"{path}.follower.second.point", follower, second.point)
        if second is not None and joint.closure != "form" and not joint.invalid_keys:
            yield Fault(f"{path}.follower.second", "a second roller where closure is 'force'.", "Add closure = 'form'.")
        lone = [key for key in (*SOLIDS, "bed") if getattr(joint.profile, key, None) is not None]
        if second is not None and lone:
            yield Fault(f"{path}.follower.second", f"a second roller does not go with {lone[0]}.", "Leave it out.")


_OF_THE_CORE = {
    "lift": "profile.lift", "base": "profile.base", "bed": "profile.bed", "sense": "profile.sense", "phase": "profile.phase",
    "undercut": "profile.undercut", "guide": "follower.guide", "point": "follower.point", "second": "follower.second",
    "left": "follower.face", "offset": "follower.offset",
}  # fmt: skip
"""Keys of the core's cam joint -> keys of the scene's; the core's face is one of `_FACES`."""

_FACES = ("roller", "mushroom", "groove", "flat")


def _core_path(joint: JointDocument, path: str) -> str:
    """The path in the scene's cam joint of a path in the core's."""
    key, _, rest = path.partition(".")
    if key == "face" and joint.follower is not None:
        return f"follower.{next((face for face in _FACES if getattr(joint.follower, face)), '')}"
    return ".".join(filter(None, (_OF_THE_CORE.get(key, key), rest)))


_PROFILE = '{ base = "40 mm", lift = [{ over = "120 deg", to = "20 mm" }, { over = "240 deg", to = 0 }] }'

CAMS = {
    "cam": JointKind(
        words="a cam",
        example=f'{{ cam = ["cam", "rod"], profile = {_PROFILE}, follower = {{ roller = "10 mm", guide = "S", point = "T" }} }}',
        make=_cam,
        keys=("profile", "follower", "closure", "friction", "liftoff", "rating", "graphical"),
        needs={
            "profile": _PROFILE,
            "follower": '{ roller = "10 mm", guide = "the joint that guides it", point = "the roller\'s centre" }',
        },
        synonyms=("cams",),
        remedies={
            "at": "Leave it out: follower = { point = ... } names the follower's point.",
            "radius": "Write follower = { roller = ... } and profile = { base = ... }.",
            "side": "Write follower = { side = ... }.",
            "guide": "Write follower = { guide = ... }.",
            "slider": "Write follower = { guide = ... }.",
        },
        undriven="Drive the cam's revolute joint, or its bed, instead.",
        viscous="damping",
        friction=ROLLER,
        joins_points=False,
        places_link=False,
        higher=True,
        check=_check_cam,
        core_path=_core_path,
    ),
}
"""The kind of joint of cams."""
