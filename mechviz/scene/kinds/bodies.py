"""Masses of links that follow from a shape: a standard solid, a plate with bosses and holes, an outline, a mesh file, point
masses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from pathlib import PurePath
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from mechcore.arrays import Vec2
from mechcore.errors import MechanismError
from mechcore.reduction.bodies import SOLIDS, Area, RigidBody, area_of, circle, plate, rounded_hull, solid
from mechviz.scene.faults import did_you_mean
from mechviz.scene.fields import (
    Angle,
    Density,
    DocumentTable,
    Mass,
    Number,
    Point,
    Size,
    Text,
    UnknownName,
    is_complete,
    name_or_list,
    raise_faults,
    table_or_value,
)
from mechviz.scene.names import FileName

if TYPE_CHECKING:
    import shapely

    from mechviz.scene.convert import Converter


SolidName = Literal[
    "point", "rod", "rod end", "rod inclined", "cylinder", "cylinder across", "hollow cylinder", "ring", "sphere", "shell", "disc",
    "ellipsoid", "cone", "box", "cube", "torus",
]  # fmt: skip
if set(get_args(SolidName)) != set(SOLIDS):
    raise ImportError("mechviz.scene.kinds.bodies.SolidName and mechcore.reduction.bodies.SOLIDS name different solids")
ARC_CHORDS = 64  # chords of an arc
HOLE_CLEARANCE = 2e-3  # of a hole's radius: arcs are chords here, and a hole may touch the outline
_KINDS = ("solid", "plate", "polygon", "mesh", "drawn")
_SIZES = ("length", "angle", "radius", "bore", "section", "height", "a", "b", "c")


PointOrName = Annotated[Annotated[Point, Tag("<list>")] | Annotated[Text, Tag("<name>")], Discriminator(name_or_list)]


class HoleDocument(DocumentTable):
    """A round hole through a plate."""

    at: PointOrName
    """Its centre: a point of the link, or coordinates in its frame."""
    radius: Size
    """Its radius."""


class BossDocument(DocumentTable):
    """A round boss on a plate, of the plate's material."""

    at: PointOrName
    """Its centre: a point of the link, or coordinates in its frame."""
    radius: Size
    """Its radius."""
    height: Size
    """How far it stands out, both sides together."""


class MassDocument(DocumentTable):
    """A mass from a shape: one of solid, plate, polygon, mesh or drawn, with a density or the whole mass."""

    solid: SolidName | None = None
    """A standard solid, with its sizes; its centre is the link's `centre` (of a rod: the middle of the first two points)."""
    plate: Annotated[list[Text], Field(min_length=1)] | None = None
    """A plate with round ends (or corners) about these points of the link; `width` and `thickness` say how large."""
    polygon: list[Point] | None = None
    """A plate with this outline, in the link's frame; `bulges` make sides round."""
    bulges: list[Number] | None = None
    """For each side of the polygon the tangent of a quarter of the angle that it spans as an arc; 0 is straight."""
    mesh: FileName | None = None
    """A mesh file (STL, OBJ, PLY, OFF, GLB), closed, in the link's frame, its z axis normal to the plane of motion."""
    drawn: bool = False
    """A plate with the outline with which the link is drawn, holes for its pins and cut-outs included."""
    mesh_unit: Size = "1 mm"
    """Length of one unit of the mesh file."""
    density: Density | None = None
    """Density of the material."""
    mass: Mass | None = None
    """Mass of the whole, instead of a density."""
    thickness: Size | None = None
    """Thickness of a plate, polygon, disc or box."""
    width: Size | None = None
    """Width of a plate: twice the radius of its ends."""
    holes: list[HoleDocument] = Field(default=[])
    """Round holes through a plate or polygon."""
    bosses: list[BossDocument] = Field(default=[])
    """Round bosses on a plate or polygon."""
    length: Size | None = None
    """Length of a rod (default: the distance of the link's first two points) or cylinder."""
    angle: Angle | None = None
    """Angle of an inclined rod to the axis of rotation."""
    radius: Size | None = None
    """Radius."""
    bore: Size | None = None
    """Inner radius of a hollow cylinder."""
    section: Size | None = None
    """Radius of a torus' section."""
    height: Size | None = None
    """Height of a cone."""
    a: Size | None = None
    """Side of a box or cube; semi-axis of an ellipsoid along the axis of rotation."""
    b: Size | None = None
    """Other side of a box; semi-axis of an ellipsoid."""
    c: Size | None = None
    """Semi-axis of an ellipsoid."""

    @model_validator(mode="after")
    def _fits(self) -> MassDocument:
        raise_faults(self.problems())
        return self

    def problems(self) -> list[tuple[str, str, str]]:
        """Faults of keys that do not go together."""
        wrong = []
        kinds = [k for k in _KINDS if getattr(self, k) not in (None, False)]
        if len(kinds) != 1:
            what = " and ".join(kinds) + " at once." if kinds else "none of solid, plate, polygon, mesh and drawn."
            wrong.append(("", f"the mass has {what}", "Give exactly one of them."))
        if (self.density is None) == (self.mass is None):
            wrong.append(("", "the mass needs either a density or a mass.", "Give exactly one of them."))
        if kinds == ["plate"]:
            wrong += [(k, f"a plate needs its {k}.", f"Add {k} = ...") for k in ("width",) if getattr(self, k) is None]
        if self.density is not None and kinds in (["plate"], ["polygon"], ["drawn"]) and self.thickness is None:
            wrong.append(("thickness", "a density needs the thickness of the plate.", "Add thickness = ..., or give the mass."))
        if self.bosses and self.thickness is None:
            wrong.append(("thickness", "bosses need the thickness of the plate.", "Add thickness = ..."))
        if self.polygon is not None and len(self.polygon) < 2 + (not self.bulges):
            wrong.append(("polygon", "an outline needs three corners, or two and arcs between them.", "Add corners."))
        if self.bulges is not None and self.polygon is not None and len(self.bulges) != len(self.polygon):
            wrong.append(("bulges", f"{len(self.bulges)} bulges for {len(self.polygon)} sides.", "Give one for each side."))
        if kinds == ["solid"]:
            wanted = SOLIDS[str(self.solid)].sizes if str(self.solid) in SOLIDS else (*_SIZES, "thickness")
            for k in (*_SIZES, "thickness"):
                if getattr(self, k) is not None and k not in wanted:
                    wrong.append((k, f"a {self.solid} has no {k}.", f"Its sizes: {', '.join(wanted)}."))
        return wrong


MassEntry = Annotated[Annotated[Mass, Tag("<value>")] | Annotated[MassDocument, Tag("<table>")], Discriminator(table_or_value)]


class PointMassDocument(DocumentTable):
    """A point mass fixed to a link: a counterweight, or a part of a lumped model."""

    mass: Mass
    """Its mass."""
    at: PointOrName
    """A point of the link, or coordinates in its frame."""


def point_masses_of(masses: list[PointMassDocument], points: Mapping[str, Vec2], convert: Converter, path: str) -> list[RigidBody]:
    """Point masses in SI."""
    out = []
    for k, mass in enumerate(masses):
        at = _place(mass.at, points, convert, f"{path}[{k}].at")
        out.append(RigidBody(convert.si(mass.mass, "mass", f"{path}[{k}].mass"), at))
    return out


def _place(at: Any, points: Mapping[str, Vec2], convert: Converter, path: str) -> Vec2:
    if not isinstance(at, str):
        return convert.vector(at, "length", path)
    if at not in points and not isinstance(at, UnknownName):
        convert.note(path, f"the link has no point '{at}'.", did_you_mean(at, points, what="Points"))
    return points.get(at, (0.0, 0.0))


def body_of(
    m: MassDocument, points: Mapping[str, Vec2], centre: Vec2 | None, convert: Converter, path: str, drawn: RigidBody | None = None
) -> RigidBody:
    """Mass, centre and moment of inertia of a shape.

    ``centre``: of a solid, where the scene states it. ``drawn``: the link's drawn outline as a plate of unit surface density; a
    unit mass until that is known.
    """
    if m.problems() or m.plate == []:  # reported already
        return RigidBody(1.0)
    density = None if m.density is None else convert.si(m.density, "density", f"{path}.density")
    mass = None if m.mass is None else convert.si(m.mass, "mass", f"{path}.mass")
    before = len(convert.faults)
    try:
        if m.solid is not None:
            body = _solid(m, points, centre, density, mass, convert, path)
        elif m.mesh is not None:
            body = _mesh(m, density, mass, convert, path)
        else:
            body = _flat(m, points, density, mass, convert, path, drawn)
    except MechanismError as error:
        if len(convert.faults) == before and is_complete(m):
            for f in error.faults:
                convert.note(path, f.message, f.remedy)
        return RigidBody(1.0)
    if (
        len(convert.faults) == before
        and is_complete(m)
        and not (math.isfinite(body.inertia) and body.mass >= 0.0 and body.inertia >= 0.0)
    ):
        convert.note(path, "the shape has no positive mass.", "Check sizes, holes and density.")
    return body


def _solid(
    m: MassDocument,
    points: Mapping[str, Vec2],
    centre: Vec2 | None,
    density: float | None,
    mass: float | None,
    convert: Converter,
    path: str,
) -> RigidBody:
    sizes = {}
    for key in SOLIDS[str(m.solid)].sizes:
        value = getattr(m, key, None)
        if value is not None:
            sizes[key] = convert.si(value, "angle" if key == "angle" else "length", f"{path}.{key}")
    places = list(points.values())
    if m.solid in ("rod end", "rod inclined"):
        return _rod_from_end(str(m.solid), places, sizes, mass, density, convert, path)
    if m.solid == "point":
        sizes.setdefault("radius", 0.0)
    if m.solid == "rod" and len(places) > 1:
        sizes.setdefault("length", math.dist(places[0], places[1]))
        centre = centre or (0.5 * (places[0][0] + places[1][0]), 0.5 * (places[0][1] + places[1][1]))
    if centre is None:
        if len(places) > 1:
            convert.note(path, f"where on the link is the {m.solid}?", "Add centre = [x, y] or the name of a point to the link.")
        centre = places[0]
    return solid(str(m.solid), mass=mass, density=density, centre=centre, **sizes)


def _rod_from_end(
    kind: str,
    places: list[Vec2],
    sizes: dict[str, float],
    mass: float | None,
    density: float | None,
    convert: Converter,
    path: str,
) -> RigidBody:
    """A thin rod that starts at the first point of its link, towards the second; inclined: it leaves the plane of motion."""
    if len(places) < 2:
        convert.note(path, f"a {kind} lies from the link's first point towards the second: the link has one point.", "Add a point.")
        return RigidBody(1.0)
    start, to = complex(*places[0]), complex(*places[1])
    if kind == "rod end":
        sizes.setdefault("length", abs(to - start))
    missing = [k for k in SOLIDS[kind].sizes if k not in sizes]
    if missing:
        convert.note(path, f"a {kind} needs its {' and '.join(missing)}.", f"Its sizes: {', '.join(SOLIDS[kind].sizes)}.")
        return RigidBody(1.0)
    reach = sizes["length"] * abs(math.sin(sizes.get("angle", 0.5 * math.pi)))  # seen along the axis of rotation
    along = 0.5 * reach * (to - start) / abs(to - start) if to != start else 0j
    return solid("rod", mass=mass, density=density, centre=((start + along).real, (start + along).imag), length=reach)


def _flat(
    m: MassDocument,
    points: Mapping[str, Vec2],
    density: float | None,
    mass: float | None,
    convert: Converter,
    path: str,
    drawn: RigidBody | None,
) -> RigidBody:
    def size(key: str) -> float:
        value = getattr(m, key)
        return 1.0 if value is None else convert.si(value, "length", f"{path}.{key}")

    material = None  # from which holes are cut, where it is known
    if m.polygon is not None:
        corners = [convert.vector(p, "length", f"{path}.polygon[{k}]") for k, p in enumerate(m.polygon)]
        if not any(map(math.isnan, (v for c in corners for v in c))):
            material = polygon_of(corners, m.bulges)
            if material is None:
                convert.note(
                    f"{path}.polygon", "the outline crosses itself or has no area.", "Give the corners in order around it."
                )
                return RigidBody(1.0)
        outer = area_of(corners, m.bulges)
    elif m.drawn:
        outer = Area(1.0, (0.0, 0.0), 0.0)
        if drawn is not None and not drawn.mass > 0.0:
            convert.note(path, "the link is drawn without a flat part.", "State its outline: plate, polygon or mesh.")
        elif drawn is not None:
            outer = Area(drawn.mass, drawn.centre, drawn.inertia)
    else:
        around = [_place(p, points, convert, f"{path}.plate[{k}]") for k, p in enumerate(m.plate or [])]
        outer = rounded_hull(around, 0.5 * size("width"))
        material = plate_of(around, 0.5 * size("width"))
    holes = [_circle(h, points, convert, f"{path}.holes[{k}]") for k, h in enumerate(m.holes)]
    if material is not None:
        for k, words in misplaced(material, [(h.centre, math.sqrt(h.area / math.pi)) for h in holes]):
            convert.note(f"{path}.holes[{k}]", words, "Check its place and radius: it has to be cut from the material.")
    bosses: list[tuple[Area, float]] = []
    thickness = size("thickness")
    for k, boss in enumerate(m.bosses):
        height = convert.si(boss.height, "length", f"{path}.bosses[{k}].height")
        bosses.append((_circle(boss, points, convert, f"{path}.bosses[{k}]"), height))
    body = plate(outer, thickness, holes=holes, bosses=bosses)  # a volume, of density 1
    factor = density if density is not None else (mass or 0.0) / body.mass
    return RigidBody(body.mass * factor, body.centre, body.inertia * factor)


def _circle(h: Any, points: Mapping[str, Vec2], convert: Converter, path: str) -> Area:
    return circle(_place(h.at, points, convert, f"{path}.at"), convert.si(h.radius, "length", f"{path}.radius"))


def _mesh(m: MassDocument, density: float | None, mass: float | None, convert: Converter, path: str) -> RigidBody:
    """Volume integrals over a closed mesh."""
    import trimesh

    data = convert.file(str(m.mesh), f"{path}.mesh")
    if data is None:
        return RigidBody(1.0)
    try:
        mesh: Any = trimesh.load(BytesIO(data), file_type=PurePath(str(m.mesh)).suffix[1:], force="mesh")
    except Exception as error:  # readers of half a dozen formats raise errors of their own
        words = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        convert.note(f"{path}.mesh", f"'{m.mesh}' cannot be read: {words}.", "Give the path of an STL, OBJ, PLY, OFF or GLB file.")
        return RigidBody(1.0)
    if not len(getattr(mesh, "faces", ())) or not mesh.is_watertight or not abs(mesh.volume) > 0.0:
        convert.note(f"{path}.mesh", f"'{m.mesh}' is not closed: it has no volume.", "Repair the mesh.")
        return RigidBody(1.0)
    if mesh.volume < 0.0:
        mesh.invert()
    if not (mesh.is_winding_consistent and _hollows_lie_inside(mesh)):
        convert.note(f"{path}.mesh", f"some faces of '{m.mesh}' look inwards.", "Repair the mesh: all its normals point outwards.")
        return RigidBody(1.0)
    unit = convert.si(m.mesh_unit, "length", f"{path}.mesh_unit")
    mesh.density = 1.0
    volume = float(mesh.volume) * unit**3
    factor = density if density is not None else (mass or 0.0) / volume
    x, y, _ = (float(v) * unit for v in mesh.center_mass)
    return RigidBody(volume * factor, (x, y), float(mesh.moment_inertia[2, 2]) * unit**5 * factor)


def _hollows_lie_inside(mesh: Any) -> bool:
    """Whether all closed surfaces of a mesh that are inside out lie, by their extent, in one that is not."""
    bodies = mesh.split(only_watertight=False)
    bounds = [body.bounds for body in bodies if body.volume > 0.0]
    hollows = [body.bounds for body in bodies if body.volume < 0.0]
    return all(any((low <= inner[0]).all() and (inner[1] <= high).all() for low, high in bounds) for inner in hollows)


def polygon_of(corners: Sequence[Vec2], bulges: Sequence[float] | None) -> shapely.Polygon | None:
    """An outline with its arcs as chords, or None where it crosses itself or has no area."""
    import shapely

    z = np.array([complex(*c) for c in corners])
    ring: list[complex] = []
    for a, b, bulge in zip(z, np.roll(z, -1), bulges or [0.0] * len(z), strict=False):
        ring.append(a)
        if bulge and a != b:
            angle = 4.0 * math.atan(bulge)
            centre = 0.5 * (a + b) + 0.5j * (b - a) / math.tan(0.5 * angle)
            ring += list(centre + (a - centre) * np.exp(1j * angle * np.arange(1, ARC_CHORDS) / ARC_CHORDS))
    shape = shapely.Polygon([(p.real, p.imag) for p in ring]) if len(ring) > 2 else shapely.Polygon()
    return shape if shape.is_valid and shape.area > 0.0 else None


def plate_of(points: Sequence[Vec2], radius: float) -> shapely.Polygon | None:
    """A plate with round ends about points."""
    import shapely

    known = [p for p in points if all(map(math.isfinite, p))]
    return shapely.MultiPoint(known).convex_hull.buffer(radius, quad_segs=ARC_CHORDS) if known and radius > 0.0 else None


def misplaced(material: shapely.Polygon, holes: Sequence[tuple[Vec2, float]]) -> Iterator[tuple[int, str]]:
    """Indices of holes (centre, radius) that cannot be cut, each with the reason."""
    import shapely

    for k, (centre, radius) in enumerate(holes):
        if not all(map(math.isfinite, (*centre, radius))):
            continue
        if not material.covers(shapely.Point(centre).buffer((1.0 - HOLE_CLEARANCE) * radius, quad_segs=ARC_CHORDS)):
            yield k, "the hole reaches out of the plate."
        for i, (other, size) in enumerate(holes[:k]):
            if math.dist(centre, other) < (1.0 - HOLE_CLEARANCE) * (radius + size):
                yield k, f"the hole overlaps hole {i + 1}: material would be taken away twice."
