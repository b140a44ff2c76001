"""Studies of a scene beside motion, forces and outputs: polygons, centrodes, centres, force systems, reduction, shaking,
substitute masses, section forces."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import Field, model_validator

from mechcore.errors import Fault, MechanismError
from mechcore.forces.section_lines import axis_of
from mechcore.spec.mechanism import Mechanism
from mechcore.spec.studies import (
    POLYGONS,
    CrossSection,
    PenStudy,
    SectionStudy,
    ShakingStudy,
    Studies,
    SubstituteStudy,
    SystemStudy,
)
from mechviz.scene.faults import did_you_mean, listing
from mechviz.scene.fields import (
    DocumentTable,
    Flag,
    ForceVector,
    Length,
    Number,
    Point,
    SignedMass,
    Size,
    Text,
    is_complete,
    raise_faults,
)
from mechviz.scene.kinds.bodies import point_masses_of
from mechviz.scene.kinds.drives import Level
from mechviz.scene.names import LinkName, PointName, Reference

if TYPE_CHECKING:
    from mechviz.scene.assembly.links import Placement
    from mechviz.scene.convert import Converter
    from mechviz.scene.document import SceneDocument


PolygonName = Literal["velocity", "acceleration", "force", "graph"]
if set(get_args(PolygonName)) != set(POLYGONS):
    raise ImportError("mechviz.scene.kinds.studies.PolygonName and mechcore.spec.studies.POLYGONS name different polygons")


class SystemDocument(DocumentTable):
    """The loads on one link as a force system: reduced to a point, to its resultant, and drawn with its funicular polygon."""

    on: LinkName
    """The link."""
    loads: list[Text] = Field(default=[])
    """Which loads. None named: all that act on the link, weight and inertia force too where effects names them."""
    at: Text | None = None
    """The point of the link to which they are reduced. Default: the origin of its frame."""
    pole: ForceVector | None = None
    """Pole of the funicular polygon, from the start of the force polygon. Default: chosen automatically."""


class CounterweightsDocument(DocumentTable):
    """Counterweights against the shaking force: of a four-bar on crank and rocker, of a slider-crank on the crank."""

    radius: Size
    """Their distance from the fixed pivot (of the crank, where the rocker's is given too)."""
    rocker_radius: Size | None = None
    """Distance of the rocker's counterweight from its pivot. Default: as `radius`."""
    fraction: Number = 1.0
    """Four-bar: fraction of the shaking force that is balanced. Slider-crank: fraction of the reciprocating masses."""

    @model_validator(mode="after")
    def _a_fraction(self) -> CounterweightsDocument:
        if not 0.0 <= self.fraction <= 1.0:
            raise_faults([("fraction", f"{self.fraction:g} is not between 0 and 1.", "Write 0.5 for half.")])
        return self


class ShakingDocument(DocumentTable):
    """Shaking force and shaking moment of all inertia forces on the frame."""

    about: Point = (0.0, 0.0)
    """The point of the world about which the moment is taken."""
    counterweights: CounterweightsDocument | None = None
    """Also compute counterweights, and the shaking that remains with them."""


class SubstituteMassDocument(DocumentTable):
    """One substitute mass. Values that are not given are computed."""

    mass: SignedMass | None = None
    """Its mass; it may be negative."""
    at: Text | None = None
    """The point of the link, or "centre" for the centre of mass, where it is placed."""
    x: Length | None = None
    """Its coordinate along x of the link's frame."""
    y: Length | None = None
    """Its coordinate along y of the link's frame."""

    @model_validator(mode="after")
    def _one_place(self) -> SubstituteMassDocument:
        both = [k for k in ("x", "y") if self.at is not None and getattr(self, k) is not None]
        raise_faults([(k, f"{k} stands beside at, which decides both coordinates.", f"Leave out {k} or at.") for k in both])
        return self


class SubstituteDocument(DocumentTable):
    """Point masses with the same inertia forces as a link: n of them, of whose 3n parameters all but four are given."""

    masses: Annotated[list[SubstituteMassDocument], Field(min_length=1, max_length=20)]
    """The masses."""
    solution: Annotated[int, Field(strict=True, ge=1, le=4)] = 1
    """Which solution is shown, where there are several."""
    static: Flag = False
    """Two masses at two given places: the link's mass and centre, and a correction couple for its inertia."""


class CrossSectionDocument(DocumentTable):
    """The cross-section of a link, from which its stresses follow: round or rectangular, solid or hollow."""

    diameter: Size | None = None
    """Round: its outer diameter."""
    height: Size | None = None
    """Rectangular: its side across the link's axis, in the plane of the motion."""
    width: Size | None = None
    """Rectangular: its side across the plane of the motion."""
    wall: Size | None = None
    """Thickness of the wall of a hollow one. Default: it is solid."""

    @model_validator(mode="after")
    def _one_form(self) -> CrossSectionDocument:
        sides = [key for key in ("height", "width") if getattr(self, key) is not None]
        if not self.has_valid("diameter", "height", "width"):
            return self
        if self.diameter is not None:
            raise_faults([(k, f"{k} stands beside diameter.", f"Leave out {k}, or diameter.") for k in sides])
        elif len(sides) < 2:
            missing = "'width' is missing." if "height" in sides else "'height' is missing."
            none = ("", "a cross-section without diameter, height and width.", "Give a diameter, or height and width.")
            raise_faults([(sides[0], missing, "Give both, or a diameter.") if sides else none])
        return self


class PenDocument(DocumentTable):
    """A point that draws: its line appears as it moves."""

    point: PointName
    """The point, "link.point"."""
    joint: Annotated[Text, Reference("joint")] | None = None
    """The joint that lifts it: with at_most or at_least the pen is down where its coordinate is within that limit. Default: it
    always is."""
    at_most: Level | None = None
    """The pen is down where the joint's coordinate is at most this."""
    at_least: Level | None = None
    """The pen is down where the joint's coordinate is at least this."""

    @model_validator(mode="after")
    def _one_limit(self) -> PenDocument:
        limits = [key for key in ("at_most", "at_least") if getattr(self, key) is not None]
        if not self.has_valid("joint", "at_most", "at_least"):
            return self
        if self.joint is None:
            raise_faults([(key, f"{key} without a joint.", 'Add joint = "C", or leave it out.') for key in limits])
        elif len(limits) != 1:
            both = [(limits[-1], "at_least stands beside at_most.", "Leave out one of them.")] if limits else []
            raise_faults(both or [("joint", "a joint that lifts the pen, and not where.", "Add at_most = ... or at_least = ...")])
        return self


class SectionsDocument(DocumentTable):
    """Section forces along a link: normal force, shear force and bending moment."""

    along: Annotated[list[Text], Field(min_length=2, max_length=100)] | None = None
    """Points of the link through which its axis runs. Default: the line through the points at which joints and loads act."""
    section: CrossSectionDocument | None = None
    """Its cross-section. Default: no stresses."""


def needs_inertia(document: SceneDocument, link: str) -> bool:
    """Whether a study needs mass, centre and inertia of a link even though no effect names inertia."""
    turning = any(text.partition(".")[0] == link for text in document.percussion)
    return bool(document.reduced) or document.shaking is not None or link in document.substitutes or turning


def check_studies(document: SceneDocument, links: Mapping[str, list[str] | None], complete: bool) -> Iterator[Fault]:
    """Faults of references in studies. ``links``: names of the points of every link, None where they could not be read;
    ``complete``: all links are known."""
    for key in (
        "polygons",
        "centrodes",
        "equivalent",
        "reduced",
        "instant_centres",
        "evolutes",
        "inflection",
        "percussion",
        "inversion",
    ):
        names = getattr(document, key)
        for k, name in enumerate(names):
            if name in names[:k] and is_complete(name):
                yield Fault(f"{key}[{k}]", f"'{name}' is listed twice.", "Leave it out once.")
    if "force" in document.polygons and not document.effects and not document.loads:
        remedy = 'Name effects such as "inertia", or loads.'
        yield Fault(f"polygons[{document.polygons.index('force')}]", "a force polygon of a scene without any force.", remedy)
    for key in ("centrodes", "inflection"):
        for k, name in enumerate(getattr(document, key)):
            yield from _link(f"{key}[{k}]", name, links, complete, document.frame)
    for k, name in enumerate(document.instant_centres):
        if name != document.frame:
            yield from _link(f"instant_centres[{k}]", name, links, complete, document.frame)
    if len(document.instant_centres) == 1:
        yield Fault("instant_centres", "one link alone has no instant centre.", "Name two links or more.")
    for key in ("evolutes", "percussion"):
        for k, text in enumerate(getattr(document, key)):
            link, _, point = text.partition(".")
            if not point and is_complete(text):
                yield Fault(f"{key}[{k}]", f"'{text}' names no point of a link.", 'Write link and point, such as "coupler.E".')
                continue
            yield from _link(f"{key}[{k}]", link, links, complete, document.frame)
            yield from _point(f"{key}[{k}]", link, point, links)
    cams = [name for name, joint in document.joints.items() if joint.kinds == ["cam"]]
    for k, name in enumerate(document.inversion):
        if complete and is_complete(name) and name not in cams:
            what = "is no cam" if name in document.joints else "is no joint"
            yield Fault(f"inversion[{k}]", f"'{name}' {what}.", did_you_mean(name, cams, what="Cams") or "Leave it out.")
    fitting = [name for name, joint in document.joints.items() if joint.kinds and joint.traits.higher]
    for k, name in enumerate(document.equivalent):
        if not complete or not is_complete(name) or name in fitting:
            continue
        if name in document.joints:
            remedy = f"Name {listing(fitting)}." if fitting else "Leave it out: the scene has no such joint."
            yield Fault(f"equivalent[{k}]", f"'{name}' is no cam, gear, rack or pin in a slot.", remedy)
        else:
            yield Fault(f"equivalent[{k}]", f"there is no joint '{name}'.", did_you_mean(name, fitting, what="Higher pairs"))
    for k, text in enumerate(document.reduced):
        link, _, point = text.partition(".")
        if text in links or not point:
            yield from _link(f"reduced[{k}]", text, links, complete, document.frame)
        else:
            yield from _link(f"reduced[{k}]", link, links, complete, document.frame)
            yield from _point(f"reduced[{k}]", link, point, links)
    has_mass = any(link.mass is not None or link.point_masses for link in document.links.values())
    for key in ("reduced", "shaking"):
        if getattr(document, key) and complete and not has_mass:
            yield Fault(key, "no link has a mass.", "Give the moving links a mass.")
    for name, system in document.systems.items():
        path = f"systems.{name}"
        yield from _link(f"{path}.on", system.on, links, complete, document.frame)
        if system.at is not None:
            yield from _point(f"{path}.at", system.on, system.at, links)
        if not document.effects and not document.loads:
            yield Fault(path, "a force system of a scene without any force.", 'Name loads, or effects such as "gravity".')
        own = [key for key, load in document.loads.items() if system.on in (load.on if isinstance(load.on, list) else [load.on])]
        known = [*own, *(f"{effect}/{system.on}" for effect in document.effects)]
        for k, load in enumerate(system.loads):
            if load not in known and is_complete(load) and system.on in links and is_complete(document.effects):
                remedy = did_you_mean(load, known, what=f"Loads on '{system.on}'")
                yield Fault(f"{path}.loads[{k}]", f"no load '{load}' acts on '{system.on}'.", remedy)
    for name, entry in document.substitutes.items():
        path = f"substitutes.{name}"
        yield from _link(path, name, links, complete, document.frame)
        own_link = document.links.get(name)
        if own_link is not None and own_link.mass is None and not own_link.point_masses:
            yield Fault(path, f"link '{name}' has no mass to be replaced.", f"Give links.{name} a mass.")
        for k, m in enumerate(entry.masses):
            if m.at is not None and m.at != "centre":
                yield from _point(f"{path}.masses[{k}].at", name, m.at, links)

    for name, sections in document.sections.items():
        path = f"sections.{name}"
        yield from _link(path, name, links, complete, document.frame)
        for k, point in enumerate(sections.along or ()):
            yield from _point(f"{path}.along[{k}]", name, point, links)
        if not document.effects and not document.loads:
            yield Fault(path, "section forces of a scene without any force.", 'Name loads, or effects such as "inertia".')


def axis_faults(mechanism: Mechanism) -> Iterator[Fault]:
    """Faults of links with section forces whose axis is not clear."""
    for study in mechanism.studies.sections:
        try:
            axis_of(mechanism, study.link, study.points)
        except MechanismError as error:
            yield from error.faults


def _link(path: str, name: str, links: Mapping[str, Any], complete: bool, frame: str) -> Iterator[Fault]:
    if name == frame:
        yield Fault(path, f"'{name}' is the fixed link.", "Name a moving link.")
    elif complete and name not in links and is_complete(name):
        yield Fault(path, f"there is no link '{name}'.", did_you_mean(name, links, what="Links"))


def _point(path: str, link: str, point: str, links: Mapping[str, list[str] | None]) -> Iterator[Fault]:
    points = links.get(link)
    if points is not None and point not in points and is_complete(point):
        hint = did_you_mean(point, points, what=f"Points of '{link}'") or f"Points: {listing(points)}."
        yield Fault(path, f"link '{link}' has no point '{point}'.", hint)


def studies_of(
    document: SceneDocument, placement: Placement, centres: Mapping[str, tuple[float, float]], convert: Converter
) -> Studies:
    """The studies in SI units. ``centres``: centres of mass in the links' frames [m]."""
    systems = []
    for name, s in document.systems.items():
        pole = None if s.pole is None else convert.vector(s.pole, "force", f"systems.{name}.pole")
        systems.append(SystemStudy(name=name, link=s.on, loads=tuple(s.loads), point=s.at, pole=pole))
    substitutes = []
    for name, entry in document.substitutes.items():
        points = []
        for k, m in enumerate(entry.masses):
            path = f"substitutes.{name}.masses[{k}]"
            mass = None if m.mass is None else convert.si(m.mass, "mass", f"{path}.mass")
            x = None if m.x is None else convert.si(m.x, "length", f"{path}.x")
            y = None if m.y is None else convert.si(m.y, "length", f"{path}.y")
            own = placement.points.get(name, {})
            if m.at is not None:
                x, y = centres.get(name, (0.0, 0.0)) if m.at == "centre" else own.get(m.at, (0.0, 0.0))
            points.append((mass, x, y))
        substitutes.append(SubstituteStudy(link=name, points=tuple(points), solution=entry.solution, static=entry.static))
    reduced = []
    for text in document.reduced:
        link, _, point = text.partition(".")
        reduced.append((text, None) if text in document.links or not point else (link, point))
    return Studies(
        polygons=tuple(document.polygons),
        centrodes=tuple(document.centrodes),
        equivalent=tuple(document.equivalent),
        systems=tuple(systems),
        reduced=tuple(reduced),
        shaking=None if document.shaking is None else _shaking(document.shaking, convert),
        substitutes=tuple(substitutes),
        instant_centres=tuple(document.instant_centres),
        evolutes=tuple(_place(text) for text in document.evolutes),
        inflection=tuple(document.inflection),
        inversion=tuple(document.inversion),
        percussion=tuple(_place(text) for text in document.percussion),
        sections=tuple(_sections(name, entry, document, placement, convert) for name, entry in document.sections.items()),
        pens=tuple(_pen(name, entry, document, placement, convert) for name, entry in document.pens.items()),
    )


def _place(text: str) -> tuple[str, str]:
    link, _, point = text.partition(".")
    return link, point


def _pen(name: str, entry: PenDocument, document: SceneDocument, placement: Placement, convert: Converter) -> PenStudy:
    owned = ((link, entry.point[len(link) + 1 :]) for link in document.links if entry.point.startswith(f"{link}."))
    link, point = next(((link, point) for link, point in owned if point in placement.points.get(link, {})), ("", ""))
    lift_joint = document.joints.get(entry.joint) if entry.joint is not None else None
    key = "at_most" if entry.at_most is not None else "at_least"
    limit, level = getattr(entry, key), 0.0
    if lift_joint is not None and limit is not None:
        level = convert.si(limit, lift_joint.coordinate, f"pens.{name}.{key}")
    return PenStudy(name=name, link=link, point=point, joint=entry.joint, level=level, below=key == "at_most")


def _sections(
    name: str, entry: SectionsDocument, document: SceneDocument, placement: Placement, convert: Converter
) -> SectionStudy:
    section = None if entry.section is None else _cross_section(entry.section, convert, f"sections.{name}.section")
    link = document.links.get(name)
    point_masses = (
        []
        if link is None
        else point_masses_of(link.point_masses, placement.points.get(name, {}), convert, f"links.{name}.point_masses")
    )
    masses = tuple((b.mass, *b.centre, b.inertia) for b in point_masses)
    return SectionStudy(link=name, points=tuple(entry.along or ()), section=section, masses=masses)


def _cross_section(s: CrossSectionDocument, convert: Converter, path: str) -> CrossSection | None:
    """Area and section modulus, of a hollow section those of the outer without the inner; None where a fault was noted or a size is
    missing."""
    known = [key for key in ("diameter", "height", "width") if getattr(s, key) is not None]
    sides = {key: convert.si(getattr(s, key), "length", f"{path}.{key}") for key in known}
    inner = dict.fromkeys(sides, 0.0)
    if s.wall is not None:
        wall = convert.si(s.wall, "length", f"{path}.wall")
        inner = {key: side - 2.0 * wall for key, side in sides.items()}
        if min(inner.values(), default=1.0) <= 0.0:
            convert.note(
                f"{path}.wall", "twice the wall fills the section.", "Give a thinner wall, or leave it out for a solid section."
            )
            return None
    if "diameter" in sides:
        d, i = sides["diameter"], inner["diameter"]
        return CrossSection(area=math.pi / 4.0 * (d**2 - i**2), modulus=math.pi / 32.0 * (d**4 - i**4) / d)
    if len(sides) < 2:
        return None
    h, b, hi, bi = sides["height"], sides["width"], inner["height"], inner["width"]
    return CrossSection(area=b * h - bi * hi, modulus=(b * h**3 - bi * hi**3) / (6.0 * h))


def _shaking(s: ShakingDocument, convert: Converter) -> ShakingStudy:
    about = convert.vector(s.about, "length", "shaking.about")
    c = s.counterweights
    if c is None:
        return ShakingStudy(about=about)
    first = convert.si(c.radius, "length", "shaking.counterweights.radius")
    second = first if c.rocker_radius is None else convert.si(c.rocker_radius, "length", "shaking.counterweights.rocker_radius")
    return ShakingStudy(about=about, radii=(first, second), fraction=c.fraction)
