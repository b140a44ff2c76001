"""Constructions that are drawn on the mechanism: funicular polygons, centrodes, substitute masses, section forces, cams by
inversion."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mechcore.arrays import Complex, Real, Single
from mechcore.constructions.inversion import CamInversion
from mechcore.forces.section_forces import SectionForces
from mechcore.forces.section_lines import Cuts
from mechcore.reduction.reduced import REDUCED_KINDS
from mechviz.picture.constructions import VECTOR_COLORS
from mechviz.picture.nodes import ArrowSet, Color, Lines, Node, Points
from mechviz.picture.proportions import in_space, occlusion_frames
from mechviz.picture.springs import strut_ends

if TYPE_CHECKING:
    from mechviz.meshes.solids import Solids
    from mechviz.runs import Run

FIXED_CENTRODE_COLOR, MOVING_CENTRODE_COLOR = (255, 206, 92), (92, 214, 255)
EQUIVALENT_COLOR = (120, 255, 190)  # equivalent linkages
EQUIVALENT_RANGE = 4.0  # largest distance at which equivalent linkages are drawn, in sizes of the mechanism
EQUIVALENT_BLOCK = (0.05, 0.025)  # half length and half width of a block of an equivalent linkage, in sizes of the mechanism
CENTRODE_RANGE = 1.5  # distance beyond the bounds where centrodes are cut off, in sizes of the mechanism
# Resultants, substitute masses
RESULTANT_COLOR, NEGATIVE_MASS_COLOR, POSITIVE_MASS_COLOR = (255, 255, 255), (255, 96, 150), (236, 238, 244)
SUBSTITUTE_FORCE_COLOR = (244, 178, 255)


def overlay_nodes(run: Run, solids: Solids) -> Iterator[Node]:
    """Nodes of the scene's constructions on the mechanism, in colours for a dark background."""
    size, top = solids.size, solids.z_top
    yield from _funicular(run, size, top + 0.01 * size)
    yield from _centrodes(run, solids, top + 0.006 * size)
    yield from _equivalents(run, size, top + 0.01 * size)
    yield from _substitutes(run, size, top + 0.01 * size)


def _funicular(run: Run, size: float, height: float) -> Iterator[Node]:
    systems = run.studies.systems
    if not systems:
        return
    colors, labels, radii = [], [], []
    for s in systems.values():
        n = s.drawing.forces.shape[1]
        colors += [VECTOR_COLORS["string"]] * (n + 1) + [VECTOR_COLORS["line"]] * n
        labels += [*(str(i) for i in range(n + 1)), *s.drawing.names]
        radii += [0.0028 * size] * (n + 1) + [0.0014 * size] * n
    path = ("polygons", "funicular")
    common: dict[str, Any] = {"owner": ("construction", "funicular"), "group": "funicular", "height": height}
    strips = tuple(space(strip, height) for strip in strings(run, size))
    look: dict[str, Any] = {"colors": tuple(colors), "radii": tuple(radii), "labels": tuple(labels)}
    yield Lines(key="funicular.strings", entity=path, strips=strips, **look, **common)
    starts, vectors = (np.stack(part, axis=1) for part in zip(*resultants(run, size), strict=True))
    single = {name: bool(np.any(s.drawing.kind == REDUCED_KINDS[2])) for name, s in systems.items()}
    words = tuple("" if not there else "R" if len(systems) == 1 else f"R {name}" for name, there in single.items())
    common |= {"origins": space(starts, height), "vectors": space(vectors, 0.0), "radius": 0.007 * size, "labels": words}
    yield ArrowSet(key="funicular.resultants", entity=(*path, "resultant"), colors=(RESULTANT_COLOR,), **common)


def _centrodes(run: Run, solids: Solids, height: float) -> Iterator[Node]:
    for name, both in run.studies.centrodes.items():
        common: dict[str, Any] = {"owner": ("link", name), "height": height, "radii": (0.0032 * solids.size,)}
        fixed, moving = (
            tuple(piece[None] for piece in centrode_strips(path, both.fixed, solids, z=height))
            for path in (both.fixed, both.moving)
        )
        if fixed:
            yield Lines(
                key=f"polode.{name}.fixed",
                entity=("polygons", "polodes", name),
                group="polodes",
                strips=fixed,
                colors=(FIXED_CENTRODE_COLOR,),
                **common,
            )
        if moving:  # moves with its link, and rolls on the fixed centrode
            common |= {"group": "polode", "colors": (MOVING_CENTRODE_COLOR,), "parent": name}
            yield Lines(key=f"polode.{name}.moving", entity=("mechanism", "links", name, "polode"), strips=moving, **common)


def _equivalents(run: Run, size: float, height: float) -> Iterator[Node]:
    pins = dict(chain_pins(run, size))
    for name, chain in chain_strips(run, size):
        path = ("polygons", "equivalent", name)
        common: dict[str, Any] = {"owner": ("joint", name), "group": "equivalent", "height": height, "colors": (EQUIVALENT_COLOR,)}
        strips = tuple(space(strip, height) for strip in chain)
        yield Lines(key=f"equivalent.{name}", entity=path, strips=strips, radii=(0.0028 * size,), **common)
        if pins[name]:
            places = np.stack([z for _, z in pins[name]], axis=1)
            dots = space(places, height)
            dots[~np.isfinite(places).all(axis=1)] = np.nan
            look: dict[str, Any] = {"radii": (0.011 * size,) * len(pins[name]), "labels": tuple(label for label, _ in pins[name])}
            yield Points(key=f"equivalent.{name}.pins", entity=(*path, "pins"), parent="", places=dots, **look, **common)


def _substitutes(run: Run, size: float, height: float) -> Iterator[Node]:
    for name, body in run.studies.substitutes.items():
        path = ("polygons", "substitutes", name)
        common: dict[str, Any] = {"owner": ("link", name), "group": "substitutes", "height": height}
        places, forces = (v @ np.array([1.0, 1.0j]) for v in (body.places, body.forces))  # (F, n)
        share = np.sqrt(np.abs(body.masses) / np.abs(body.masses).max())
        look: dict[str, Any] = {
            "colors": tuple(NEGATIVE_MASS_COLOR if m < 0.0 else POSITIVE_MASS_COLOR for m in body.masses),
            "radii": tuple(float(r) for r in (0.012 + 0.028 * share) * size),
            "labels": tuple(run.scene.units.text(m, "kg", 4) for m in body.masses),
        }
        origins, vectors = space(places, height), space(forces / substitute_scale(run, size), 0.0)
        yield Points(key=f"substitutes.{name}", entity=path, parent="", places=origins, **look, **common)
        look = {"colors": (SUBSTITUTE_FORCE_COLOR,), "radius": 0.005 * size}
        yield ArrowSet(
            key=f"substitutes.{name}.forces", entity=(*path, "forces"), origins=origins, vectors=vectors, **look, **common
        )


def space(z: Complex, height: float) -> Single:
    """Complex places (...) of the plane at a height, as (..., 3); a place that is not finite becomes the origin."""
    out = np.full((*z.shape, 3), height, np.float32)
    known = np.where(np.isfinite(z), z, 0.0)
    out[..., 0], out[..., 1] = known.real, known.imag
    return out


def overlay_box(run: Run, solids: Solids) -> Real:
    """Box (2, 3) [m] around the mechanism and the items drawn on it: springs, equivalent linkages, strings, resultants, centrodes,
    substitute masses."""
    low, high = (np.array(b, float) for b in solids.bounds)
    size = solids.size
    points: list[Real] = [*strut_ends(run)]
    for body in run.studies.substitutes.values():
        points.append(body.places.reshape(-1, 2))
        points.append((body.places + body.forces / substitute_scale(run, size)).reshape(-1, 2))
    for _, chain in chain_strips(run, size):
        points += [np.column_stack([strip.real.reshape(-1), strip.imag.reshape(-1)]) for strip in chain]
    if run.studies.systems:
        z = np.concatenate([strip.reshape(-1) for strip in strings(run, size)])
        points.append(np.column_stack([z.real, z.imag]))
        points += [np.column_stack([w.real, w.imag]) for a, v in resultants(run, size) for w in (a, a + v)]
    for centrodes in run.studies.centrodes.values():
        points += [p[:, :2].astype(float) for p in centrode_strips(centrodes.fixed, centrodes.fixed, solids, z=0.0)]
    for xy in points:
        xy = xy[np.isfinite(xy).all(axis=1)]
        if len(xy):
            near, far = np.quantile(xy, [0.03, 0.97], axis=0)  # a point that moves far out at a few frames may leave the picture
            low[:2] = np.minimum(low[:2], np.maximum(near, low[:2] - 0.5 * size))
            high[:2] = np.maximum(high[:2], np.minimum(far, high[:2] + 0.5 * size))
    return np.array([low, high])


def strings(run: Run, size: float) -> list[Complex]:
    """Strips (F, 2) of the funicular polygons: strings between the knots, outer strings extended to their intersection, and the
    lines of action of the forces."""
    out: list[Complex] = []
    for s in run.studies.systems.values():
        d = s.drawing
        n = d.forces.shape[1]
        rays = d.rays / np.maximum(np.abs(d.rays), 1e-300)
        first, last = (_outer(d.knots[:, i], rays[:, j], d.meeting, size) for i, j in ((0, 0), (n - 1, n)))
        out.append(first)
        out += [np.stack([d.knots[:, i], d.knots[:, i + 1]], axis=1) for i in range(n - 1)]
        out.append(last)
        with np.errstate(invalid="ignore", divide="ignore"):
            along = np.nan_to_num(d.forces / np.abs(d.forces))
        for i in range(n):
            reach = np.real((d.knots[:, i] - d.points[:, i]) * np.conj(along[:, i]))
            low, high = np.minimum(reach, 0.0) - 0.08 * size, np.maximum(reach, 0.0) + 0.08 * size
            out.append(np.stack([d.points[:, i] + low * along[:, i], d.points[:, i] + high * along[:, i]], axis=1))
    return out


def _outer(knot: Complex, ray: Complex, meeting: Complex, size: float) -> Complex:
    """An outer string (F, 2): through its knot, extended to the intersection of the outer strings as far as it is drawn."""
    away = np.where(np.isfinite(meeting), np.real((meeting - knot) * np.conj(ray)), 0.0)
    away = np.clip(np.nan_to_num(away), -2.0 * size, 2.0 * size)
    low, high = np.minimum(away, 0.0) - 0.15 * size, np.maximum(away, 0.0) + 0.15 * size
    return np.stack([knot + low * ray, knot + high * ray], axis=1)


def resultants(run: Run, size: float) -> list[tuple[Complex, Complex]]:
    """Starts and vectors (F,) of the arrows of the resultants, at the intersections of the outer strings; the largest is 0.4 of
    ``size`` long. An arrow is zero where there is no single resultant force, or far outside the picture."""
    drawings = [s.drawing for s in run.studies.systems.values()]
    largest = max(float(np.abs(d.resultant).max(initial=0.0)) for d in drawings) or 1.0
    out = []
    for d in drawings:
        near = np.isfinite(d.meeting) & (np.abs(d.meeting - d.points[:, 0]) < 4.0 * size)
        out.append((np.where(near, d.meeting, np.nan), np.where(near, d.resultant * (0.4 * size / largest), 0.0)))
    return out


def chain_strips(run: Run, size: float) -> list[tuple[str, list[Complex]]]:
    """Equivalent linkages by joint: bars and outlines of blocks as strips (F, points), shrunk to a point where they extend to
    infinity."""
    out = []
    half, width = EQUIVALENT_BLOCK[0] * size, EQUIVALENT_BLOCK[1] * size
    corners = np.array([half + 1j * width, -half + 1j * width, -half - 1j * width, half - 1j * width, half + 1j * width])
    for name, chain in run.studies.equivalents.items():
        strips = [within(np.stack([chain.pins[a], chain.pins[b]], axis=1), size) for a, b in chain.bars]
        strips += [within(block.place[:, None] + np.nan_to_num(block.along)[:, None] * corners, size) for block in chain.blocks]
        out.append((name, strips))
    return out


def chain_pins(run: Run, size: float) -> list[tuple[str, list[tuple[str, Complex]]]]:
    """Pins of equivalent linkages by joint: label and places (F,), NaN far outside the picture. Only pins that are not joints of
    the mechanism."""
    shown = ("K", "N1", "N2")
    named = []
    for name, chain in run.studies.equivalents.items():
        last = list(chain.pins.values())[-1]
        with np.errstate(invalid="ignore"):
            pins = [
                (label, np.where(np.abs(z - last) < EQUIVALENT_RANGE * size, z, np.nan))
                for label, z in chain.pins.items()
                if label in shown
            ]
        named.append((name, pins))
    return named


def within(z: Complex, size: float) -> Complex:
    """Strips (F, points), shrunk to one of their finite points at frames where they extend far outside the picture."""
    finite = np.isfinite(z)
    inner = np.where(finite, z, 0.0)
    home = np.take_along_axis(inner, np.argmax(finite, axis=1)[:, None], axis=1)
    far = ~finite.all(axis=1) | (np.abs(inner - home).max(axis=1) > EQUIVALENT_RANGE * size)
    return np.where(far[:, None], home, inner)


def substitute_scale(run: Run, size: float) -> float:
    """Newtons per metre of the arrows at substitute masses: the largest is a third of ``size`` [m] long."""
    largest = max(float(np.abs(f.forces @ np.array([1.0, 1.0j])).max(initial=0.0)) for f in run.studies.substitutes.values())
    return largest / (size / 3.0) if largest > 0.0 else 1.0


def centrode_strips(path: Real, place: Real, solids: Solids, *, z: float) -> list[Single]:
    """A centrode ``path`` (F, 2) as strips (n, 3), cut where it leaves the surroundings of the mechanism or jumps through infinity.

    ``place`` (F, 2): the fixed centrode, which decides where both centrodes are cut, so that they are cut at the same frames.
    """
    low, high = np.asarray(solids.bounds)[:, :2]
    room = CENTRODE_RANGE * solids.size
    inside = np.isfinite(place).all(axis=1) & (place > low - room).all(axis=1) & (place < high + room).all(axis=1)
    step = np.hypot(*np.diff(np.where(inside[:, None], place, 0.0), axis=0).T)
    joined = inside[1:] & inside[:-1] & (step < 0.5 * solids.size)
    pieces: list[Single] = []
    start = 0
    for k in range(len(path)):
        if k + 1 == len(path) or not joined[k]:
            if k > start:
                pieces.append(np.column_stack([path[start : k + 1], np.full(k + 1 - start, z)]).astype(np.float32))
            start = k + 1
    return pieces


class SectionDiagram(NamedTuple):
    """A kind of diagram: title, letter, unit and colour, and a function for the ordinates (F, n), positive to the left of the
    axis."""

    title: str
    letter: str
    unit: str
    color: Color
    ordinates: Callable[[SectionForces], Real]


SECTION_DIAGRAMS = {
    "bending_moment": SectionDiagram("Bending moments", "M", "N m", (255, 186, 66), lambda s: -s.moment),  # on the tension side
    "shear_force": SectionDiagram("Shear forces", "V", "N", (126, 226, 140), lambda s: s.shear),
    "normal_force": SectionDiagram("Normal forces", "N", "N", (120, 184, 255), lambda s: s.normal),
}
"""Diagrams by group of the picture."""
HIDDEN_DIAGRAMS = ("shear_force", "normal_force")
"""Diagrams that are hidden at first, because three superposed diagrams are hard to read."""
TALLEST_ORDINATE = 0.16  # largest ordinate of a kind over the run, in sizes of the mechanism
ORDINATE_COUNT = 17  # evenly spaced ordinates
ORDINATE_RADIUS = 0.0026  # radius of lines, in sizes of the mechanism


def section_nodes(run: Run, solids: Solids) -> Iterator[Lines | Points]:
    """Nodes of the diagrams of section forces of each link: outline and ordinates, and a dot at the largest ordinate whose label is
    the peak over the run.

    All diagrams of a kind have the same scale.
    """
    sections = run.studies.sections
    for group, diagram in SECTION_DIAGRAMS.items():
        peaks = {link: float(np.nanmax(np.abs(diagram.ordinates(s)), initial=0.0)) for link, s in sections.items()}
        largest = max(peaks.values(), default=0.0)
        for link, section in sections.items():
            shares = np.nan_to_num(diagram.ordinates(section)) / (largest or 1.0)  # first, as the largest may be tiny
            strips = [_in_world(run, link, strip) for strip in _strips(section, TALLEST_ORDINATE * solids.size * shares)]
            height = _height(run, solids, link, strips[0])
            outline, ordinates, tip = (in_space(np.stack([z.real, z.imag], axis=-1), height) for z in strips)
            common: dict[str, Any] = {"owner": ("link", link), "group": group, "height": height, "colors": (diagram.color,)}
            key, path, radius = f"section.{link}.{group}", ("sections", group, link), ORDINATE_RADIUS * solids.size
            yield Lines(key=key, entity=path, strips=(outline, ordinates), radii=(radius, 0.5 * radius), **common)
            unit, factor = run.scene.units.display_unit(diagram.unit)
            words = f"|{diagram.letter}| ≤ {float(f'{factor * peaks[link]:.4g}'):.7g} {unit}"
            look: dict[str, Any] = {"radii": (3.0 * radius,), "labels": (words,)}
            yield Points(key=f"{key}.largest", entity=(*path, "largest"), parent="", places=tip, **look, **common)


def _strips(section: SectionForces, ordinates: Real) -> tuple[Complex, Complex, Complex]:
    """Outline, ordinates and tip of the largest ordinate, as complex strips (F, points) in the link's axes. ``ordinates`` (F, n)
    [m]: lengths to the left of the axis at the stations."""
    tips = section.places + 1j * section.directions * ordinates
    outline = np.concatenate([section.places[:, :1], tips, section.places[:, -1:]], axis=1)
    even = np.linspace(0.0, section.axis.length, ORDINATE_COUNT)
    cuts = Cuts(even, np.ones(ORDINATE_COUNT))
    feet = np.broadcast_to(section.axis.place(cuts), (len(tips), ORDINATE_COUNT))
    lengths = np.stack([np.interp(even, s, v) for s, v in zip(section.stations, ordinates, strict=True)])
    heads = feet + 1j * section.axis.directions[section.axis.segment(cuts)] * lengths
    comb = np.stack([feet, heads, feet], axis=2).reshape(len(tips), -1)
    k = np.argmax(np.abs(ordinates), axis=1)[:, None]
    return outline, comb, np.take_along_axis(tips, k, axis=1)


def _in_world(run: Run, link: str, strip: Complex) -> Complex:
    x, y, angle = run.motion.pose(link).T
    return np.asarray((x + 1j * y)[:, None] + np.exp(1j * angle)[:, None] * strip)


def _height(run: Run, solids: Solids, link: str, outline: Complex) -> float:
    """Height [m] of a diagram: the front of the link, or as far in front of it as the outline needs to be visible."""
    frames, known = occlusion_frames(run, solids.heights)
    z = outline[frames]
    spec = {k.name: k for k in run.motion.mechanism.links}[link]
    lines = np.stack([z.real, z.imag], axis=-1)
    return solids.heights.clear_height(max(solids.heights.of_point(link, xy) for xy in spec.points.values()), lines, known)


INVERSION_GROUP = "inversion"
"""The group of the picture."""
INVERSION_TITLE = "Cams by inversion"
CIRCLE_COLOR, RAY_COLOR, FOLLOWER_COLOR, PROFILE_COLOR = (255, 206, 92), (150, 166, 190), (92, 214, 255), (255, 110, 96)
THIN_RADIUS, THICK_RADIUS = 0.0012, 0.0032  # radii of lines, in sizes of the mechanism
UNIT_CIRCLE = np.exp(2j * np.pi * np.linspace(0.0, 1.0, 49))
KNIFE_EDGE_LENGTH = 0.02  # length of the two lines of a knife's edge, in sizes of the mechanism
PROFILE_POINTS = 361


def inversion_nodes(run: Run, solids: Solids) -> Iterator[Lines]:
    """Nodes of the construction by inversion of each cam that the scene names: lines at rest on the cam's link."""
    height = solids.z_top + 0.004 * solids.size
    for name, inversion in run.studies.inversion.items():
        for part, (strips, color, width) in _parts(inversion, solids.size).items():
            common: dict[str, Any] = {
                "owner": ("joint", inversion.joint),
                "group": INVERSION_GROUP,
                "height": height,
                "parent": inversion.link,
            }
            yield Lines(
                key=f"{INVERSION_GROUP}.{name}.{part}",
                entity=("mechanism", "links", inversion.link, f"{INVERSION_GROUP} {name} {part}"),
                strips=tuple(space(z[None], height) for z in strips),
                colors=(color,),
                radii=(width * solids.size,),
                **common,
            )


def _parts(drawn: CamInversion, size: float) -> dict[str, tuple[Sequence[Complex], Color, float]]:
    """Strips (points,) in the axes of the cam's link, with colour and radius, by the part of the construction."""
    ends = zip(drawn.origins, drawn.references, strict=True)
    rays = [np.array([origin, reference]) for origin, reference in ends]
    if drawn.faces is not None:
        followers = list(drawn.faces)
    elif drawn.radius > 0.0:
        followers = [z + drawn.radius * UNIT_CIRCLE for z in drawn.references]
    else:
        followers = [
            z + KNIFE_EDGE_LENGTH * size * _edge(z - origin) for z, origin in zip(drawn.references, drawn.origins, strict=True)
        ]
    last = len(drawn.profile) - drawn.wedge
    some = np.linspace(0, last, PROFILE_POINTS).astype(int) % len(drawn.profile)
    return {
        "circles": (drawn.bases, CIRCLE_COLOR, THICK_RADIUS),
        "rays": (rays, RAY_COLOR, THIN_RADIUS),
        "followers": (followers, FOLLOWER_COLOR, THIN_RADIUS),
        "profile": ([drawn.profile[some]], PROFILE_COLOR, THICK_RADIUS),
    }


def _edge(along: complex) -> Complex:
    """A knife edge: two lines of unit length whose common point is the origin and which open in the direction ``along``."""
    unit = along / abs(along) if abs(along) > 0.0 else 1j
    return unit * np.array([np.exp(0.35j), 0.0, np.exp(-0.35j)])
