"""Cam profiles for manufacturing: DXF and SVG with arcs, CSV with normals and curvature; millimetres, frame of the cam's link."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import chebyshev

from mechcore.arrays import Complex, Real
from mechcore.cams.pieces import CamPiece, SmoothPiece
from mechcore.cams.placement.plane import PlacedCam
from mechcore.cams.placement.spatial import PlacedSpatial
from mechcore.forces.cam_events import lost_ranges
from mechcore.forces.cam_rating import placed_cams
from mechcore.records import dataclass
from mechcore.texts import Text, as_angle, as_coordinate
from mechviz.files import OutputError, replacing
from mechviz.outputs.exports.dxf import dxf_of, layer_names, new_drawing
from mechviz.scene.kinds.cam_files import biarcs

if TYPE_CHECKING:
    from mechcore.cams.spatial import SpatialCam
    from mechviz.runs import Run

POINT_SPACING = 1.0  # degrees of cam rotation between the points through which arcs pass
FEWEST_STEPS, MOST_STEPS = 8, 2048  # of a piece of a profile
WEDGE_STEPS = 120  # of a piece of a wedge's law
ON_CENTRE = 1e-6  # [mm] distance up to which two centres coincide


def cam_outlines(run: Run) -> list[Outline]:
    """Profiles of all cams of a run: of groove cams both flanks, of barrel, rib and end cams their developments.

    Raises `OutputError` if a profile intersects itself.
    """
    outlines: list[Outline] = []
    for cam in placed_cams(run.motion):
        own: list[Outline] = []
        if isinstance(cam, PlacedSpatial):
            own += developed(cam)
        elif isinstance(cam, PlacedCam):
            own.append(_profile(cam))
            if cam.groove and cam.cam.follower.radius > 0.0:
                own.append(_far_flank(cam))
            if cam.mate is not None:
                own.append(replace(_profile(cam.mate), name=f"{cam.name} second cam"))
        outlines += [replace(outline, cam=cam.name) for outline in own]
    for outline in outlines:
        _check(outline)
    return outlines


def _into_link(cam: PlacedCam, z: Complex) -> Complex:
    return 1e3 * (cam.mount_origin + cam.mount * z)


def _profile(cam: PlacedCam) -> Outline:
    contour = cam.contour
    runs = []
    for piece in contour.pieces:
        if isinstance(piece, CamPiece):
            law = (cam.intended or cam.cam).law
            length = law.pieces[piece.piece].length
            if cam.bed is not None and piece.piece in (0, len(law.pieces) - 1):
                continue  # the dwells before and after the law
            n = _law_steps(cam, length)
        else:
            n, length = _steps(piece), 0.0
        u = np.linspace(0.0, 1.0, n + 1)
        d = piece(u, 2)
        angle = np.full(n + 1, np.nan)
        if isinstance(piece, CamPiece):
            share = piece.first + (piece.last - piece.first) * (1.0 - u if piece.backwards else u)
            angle = cam.law_scale * (law.knots[piece.piece] + length * share)
        size = np.abs(d[1])
        with np.errstate(divide="ignore", invalid="ignore"):
            radius = 1e3 * size**3 / np.imag(np.conj(d[1]) * d[2])
        runs.append((_into_link(cam, d[0]), cam.mount * d[1] / size, radius, angle))
    return Outline(cam.name, contour.closed, tuple(runs), 1e3 * complex(cam.mount_origin), 1)


def _law_steps(cam: PlacedCam, length: float) -> int:
    """Number of equal steps of a piece of the law of this length."""
    return max(int(np.ceil(np.degrees(length) / POINT_SPACING)), FEWEST_STEPS) if cam.bed is None else WEDGE_STEPS


def _steps(piece: SmoothPiece) -> int:
    """Number of equal steps of a piece of a given profile, such that neither the tangent nor the polar angle about the cam's axis
    changes by more than `POINT_SPACING` per step."""
    n = FEWEST_STEPS
    while n < MOST_STEPS:
        z, tangent = piece(np.linspace(0.0, 1.0, n + 1), 1)
        turned = np.angle([np.conj(v[:-1]) * v[1:] for v in (tangent, z)])
        if np.degrees(np.abs(turned).max()) <= POINT_SPACING:
            break
        n *= 2
    return n


def _far_flank(cam: PlacedCam) -> Outline:
    other = replace(cam.cam, outer=True)
    law = other.law
    runs = []
    between = slice(None) if cam.bed is None else slice(1, -1)  # without the dwells before and after the law
    for piece, start in zip(law.pieces[between], law.knots[between], strict=False):
        theta = start + piece.length * np.linspace(0.0, 1.0, _law_steps(cam, piece.length) + 1)
        inside = np.clip(theta, start + 1e-12, start + piece.length - 1e-12)  # one-sided at the knots
        w = other.working_curve(inside, 1)
        size = np.abs(w[1])
        runs.append((_into_link(cam, w[0]), cam.mount * w[1] / size, 1e3 * other.at(inside).radius, cam.law_scale * theta))
    # a disc is passed against its rotation, a wedge along x
    return Outline(f"{cam.name} outer flank", cam.bed is None, tuple(runs), 1e3 * complex(cam.mount_origin), other.turn)


def _check(outline: Outline) -> None:
    from shapely.geometry import LineString, Polygon

    z = outline.points
    xy = np.column_stack([z.real, z.imag])
    simple = Polygon(xy).is_valid if outline.closed else LineString(xy).is_simple
    if not simple:
        raise OutputError(
            f"The profile of '{outline.name}' crosses itself: a cutter would leave something else.",
            "Enlarge the base circle or take a smaller roller.",
        )


def _chain(outline: Outline) -> tuple[Complex, Real]:
    """Vertices and bulges of the whole curve; the last vertex of a closed curve, which equals the first, is left out."""
    vertices, bulges = [], []
    for points, tangents, _, _ in outline.runs:
        z, b = biarcs(points, tangents)
        vertices.append(z[:-1])
        bulges.append(b)
    if not outline.closed:
        vertices.append(outline.runs[-1][0][-1:])
        bulges.append(np.zeros(1))
    return np.concatenate(vertices), np.concatenate(bulges)


def dxf_text(outlines: Iterable[Outline]) -> str:
    """A drawing (DXF, release 2004) in millimetres: polylines of arcs on the layer PROFILE, the axis as a point on CENTRE.

    Several cams, which may overlap, have layers of their own: PROFILE with the cam's name. The radius of a cylinder from which a
    profile is developed is among the properties of the drawing.
    """
    drawing = new_drawing()
    outlines = list(outlines)
    cams = list(dict.fromkeys(outline.cam for outline in outlines))
    profile = {cams[0]: "PROFILE"} if len(cams) == 1 else layer_names(cams, "PROFILE ")
    for name in profile.values():
        drawing.layers.add(name, color=7)
    drawing.layers.add("CENTRE", color=1)
    sheet = drawing.modelspace()
    centres: list[complex] = []
    for outline in outlines:
        z, bulges = _chain(outline)
        rows = np.column_stack([z.real, z.imag, bulges]).tolist()
        layer = {"layer": "CENTRE" if outline.centre_line else profile[outline.cam]}
        sheet.add_lwpolyline(rows, format="xyb", close=outline.closed, dxfattribs=layer)
        if outline.cylinder is not None:
            words = f"unrolled from a cylinder of radius {_text(outline.cylinder)} mm"
            drawing.header.custom_vars.append(outline.name, words)
        elif all(abs(outline.centre - c) > ON_CENTRE for c in centres):
            centres.append(outline.centre)
            sheet.add_point((outline.centre.real, outline.centre.imag), dxfattribs={"layer": "CENTRE"})
    return dxf_of(drawing)


def _text(value: float) -> str:
    return f"{value:.12g}" if value != 0.0 else "0.0"


def svg_text(outlines: Iterable[Outline]) -> str:
    """A drawing (SVG) of arcs, to scale in millimetres, y upwards."""
    outlines = list(outlines)
    z = np.concatenate([o.points for o in outlines] + [np.array([o.centre for o in outlines if o.cylinder is None])])
    x0, x1, y0, y1 = z.real.min() - 5.0, z.real.max() + 5.0, z.imag.min() - 5.0, z.imag.max() + 5.0
    parts = []
    for o in outlines:
        w, bulges = _chain(o)
        ends = np.append(w[1:], w[0]) if o.closed else w[1:]
        path = [f"M {_text(w[0].real)} {_text(-w[0].imag)}"]
        for a, b, bulge in zip(w, ends, bulges, strict=False):
            if abs(bulge) < 1e-9:
                path.append(f"L {_text(b.real)} {_text(-b.imag)}")
            else:
                r = abs(b - a) * (1.0 + bulge * bulge) / (4.0 * abs(bulge))
                sweep = 0 if bulge > 0.0 else 1  # the picture's y points down
                path.append(f"A {_text(r)} {_text(r)} 0 {int(abs(bulge) > 1.0)} {sweep} {_text(b.real)} {_text(-b.imag)}")
        dashes = ' stroke-dasharray="4 1 1 1"' if o.centre_line else ""
        parts.append(f'<path d="{" ".join(path)}{" Z" if o.closed else ""}"{dashes}/>')
        if o.cylinder is not None:
            continue
        c = o.centre
        parts.append(f'<path d="M {_text(c.real - 2.0)} {_text(-c.imag)} h 4 m -2 -2 v 4"/>')
    wide, tall = _text(x1 - x0), _text(y1 - y0)
    size = f'width="{wide}mm" height="{tall}mm" viewBox="{_text(x0)} {_text(-y1)} {wide} {tall}"'
    style = 'fill="none" stroke="black" stroke-width="0.2"'
    body = "\n  ".join(parts)
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n<g {style}>\n  {body}\n</g>\n</svg>\n'


def profile_csv(outlines: Iterable[Outline]) -> str:
    """A table: curve, coordinate of the cam, position, outward unit normal, radius of curvature (inf: straight, positive:
    convex)."""
    lines = ["curve,cam [rad or m],x [mm],y [mm],nx,ny,radius of curvature [mm]"]
    for o in outlines:
        name = '"' + o.name.replace('"', '""') + '"' if re.search(r'[",\r\n]', o.name) else o.name
        for points, tangents, radius, angle in o.runs:
            normal = -1j * o.outside * tangents
            columns = (angle, points.real, points.imag, normal.real, normal.imag, radius)
            for row in zip(*(c.tolist() for c in columns), strict=True):
                lines.append(",".join([name, *("" if v != v else repr(v) for v in row)]))
    return "\r\n".join(lines) + "\r\n"


PROFILE_FORMATS: dict[str, Callable[[Iterable[Outline]], str]] = {"dxf": dxf_text, "svg": svg_text, "csv": profile_csv}


def export_profiles(run: Run, path: Path | str, kind: str, report: Callable[[str], None] = lambda _: None) -> Path:
    """Write the profiles of all cams of a run as "dxf", "svg" or "csv". Raises `OutputError` if there are none.

    ``report`` is called with a line of text for each undercut range, where the profile differs from that of the law.
    """
    outlines = cam_outlines(run)
    if not outlines and any(r.geometry is not None for r in run.motion.model.relations):
        raise OutputError(
            f"The cams of '{run.scene.name}' have no plane profile: globoids and indexing cams are not developed, slots are in "
            "their links.",
            "Write their solids: --3mf FILE or --stl FOLDER.",
        )
    if not outlines:
        raise OutputError(
            f"The scene '{run.scene.name}' has no cam, so there is no profile to write.", "Choose a scene with a cam."
        )
    text = PROFILE_FORMATS[kind](outlines)
    with replacing(Path(path)) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")
    for line in _differences(run):
        report(line)
    return Path(path)


def _differences(run: Run) -> list[str]:
    """Lines of text on the undercut ranges in which profiles differ from those of their laws."""
    lines: list[str] = []
    for cam in placed_cams(run.motion):
        for first, last, at, deviation in lost_ranges(cam):
            size = as_coordinate(abs(deviation), rotary=cam.arm != 0.0, digits=4)
            a, b, c = (as_angle(x % (2.0 * np.pi), 4) for x in (first, last, at))
            words = (
                f"'{cam.name}' is undercut: written is what the cutter leaves. From {a} to {b} of the cam the follower misses its "
                f"law, by up to {size} at {c}."
            )
            lines.append(Text(words, run.scene.units))
    return lines


FLANK_DEPTHS = 14  # nodes along the roller of the interpolation of a flank
LINE_NODES = 48  # nodes (cam angles) in each piece of the law of the interpolation of a line, for its derivatives
NEWTON_STEPS = 8  # iterations of Newton's method


# -- outlines and developments ----------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Outline:
    """A curve of a cam. ``runs``: smooth parts end to end, each with points (n) [mm], unit tangents (n), radius of curvature (n)
    [mm], positive where the cam is convex, and cam angle or length (n) [rad or m], NaN where the follower rests on a corner."""

    name: str
    closed: bool
    runs: tuple[tuple[Complex, Complex, Real, Real], ...]
    centre: complex  # the cam's axis [mm]
    outside: int  # 1: the material lies to the left of the direction of the curve, -1: to its right (outer flank of a groove)
    cylinder: float | None = None  # radius [mm] of the cylinder of a development, which has no centre
    centre_line: bool = False  # the path of the roller's axis, not an edge
    cam: str = ""  # name of the cam joint

    @property
    def points(self) -> Complex:
        """All points (n,) [mm], the common ends of runs once."""
        parts = [run[0][:-1] for run in self.runs]
        return np.concatenate(parts if self.closed else [*parts, self.runs[-1][0][-1:]])


def developed(cam: PlacedSpatial) -> Iterator[Outline]:
    """The developed curves of a spatial cam: x is the arc [mm] on the cylinder of the stated radius from the cam's zero azimuth,
    counter-clockwise about the axis, y the height [mm] along the axis from the cam's pin; seen from outside. Material lies to the
    left. Nothing for a globoid cam, whose surface cannot be developed, and for an indexing cam, whose ribs are shared by several
    rollers.
    """
    blank = cam.blank
    hollow = blank.radius - blank.depth
    wanted: list[tuple[str, SpatialCam, int, float]] = []
    if blank.rollers:
        return
    if blank.kind == "barrel":
        wanted = [("roller path", cam.cam, 0, blank.radius), ("lower flank", cam.cam, 1, blank.radius)]
        wanted.append(("upper flank", cam.cam, -1, blank.radius))
    elif blank.kind == "rib":
        for name, side in (("lower flank", -1), ("upper flank", 1)):
            reach = side * (0.5 * blank.thickness + cam.cam.radius)
            wanted.append((name, replace(cam.cam, law=cam.cam.law.raised(reach)), side, blank.radius))
    elif blank.kind == "end":
        wanted = [("outer edge", cam.cam, 1, blank.radius), ("inner edge", cam.cam, 1, hollow)]
    for name, own, side, radius in wanted:
        runs = _runs(own, side, radius)
        centre_line = side == 0
        yield Outline(f"{cam.name} {name}", False, runs, 0j, 1, 1e3 * radius, centre_line)


def _runs(cam: SpatialCam, side: int, radius: float) -> tuple[tuple[Complex, Complex, Real, Real], ...]:
    """Smooth runs of a curve end to end: points [mm], unit tangents, radii of curvature [mm], cam angles [rad]."""
    law, runs, start = cam.law, [], None
    for piece, knot in zip(law.pieces, law.knots, strict=False):
        count = max(int(np.ceil(np.degrees(piece.length) / POINT_SPACING)), 8)
        t = np.linspace(-1.0, 1.0, count + 1)
        nodes = chebyshev.chebpts1(LINE_NODES)
        theta = knot + 0.5 * piece.length * (1.0 + np.concatenate([t, nodes]))
        inside = np.clip(theta, knot + 1e-12, knot + piece.length - 1e-12)  # one-sided at the knots
        w = 1e3 * _line(cam, side, radius, inside, start)
        start = float(w[count].real) / 1e3 / radius  # the next run starts at this azimuth
        points, fit = (
            w[: count + 1],
            chebyshev.chebfit(nodes, np.column_stack([w[count + 1 :].real, w[count + 1 :].imag]), LINE_NODES - 1),
        )
        d1, d2 = (chebyshev.chebval(t, chebyshev.chebder(fit, order)) for order in (1, 2))
        first, second = d1[0] + 1j * d1[1], d2[0] + 1j * d2[1]
        with np.errstate(divide="ignore", invalid="ignore"):
            bend = np.abs(first) ** 3 / np.imag(np.conj(first) * second)
        runs.append((points, first / np.abs(first), bend, theta[: count + 1]))
    leftwards = runs[-1][0][-1].real < runs[0][0][0].real
    if leftwards == (side >= 0):  # material below a curve that runs to the left lies to its left
        return tuple(runs)
    return tuple((p[::-1], -t[::-1], -bend[::-1], a[::-1]) for p, t, bend, a in reversed(runs))


def _line(cam: SpatialCam, side: int, radius: float, theta: Real, start: float | None) -> Complex:
    """Arc on a cylinder and height (n,) [m], as a complex number, of a flank (``side`` 0: of the roller's axis) at cam angles (n,).

    For each angle the flank intersects the cylinder at one position along the roller, found by Newton's method on a polynomial.
    """
    wide = cam.radius + float(np.abs(_across(cam, theta)).max())
    low = np.sqrt(max(radius**2 - (1.05 * wide) ** 2, (0.2 * radius) ** 2))
    middle, half = 0.5 * (low + radius * 1.001), 0.5 * (radius * 1.001 - low)
    nodes = chebyshev.chebpts1(FLANK_DEPTHS)
    flank = cam.flank(theta, middle + half * nodes, side or 1)
    p = flank.axis_point if side == 0 else flank.point
    fits = [chebyshev.chebfit(nodes, p[..., k].T, FLANK_DEPTHS - 1) for k in range(3)]
    u = np.full(len(theta), 0.5)
    for _ in range(NEWTON_STEPS):
        x, y = (chebyshev.chebval(u, fits[k], tensor=False) for k in (0, 1))
        dx, dy = (chebyshev.chebval(u, chebyshev.chebder(fits[k]), tensor=False) for k in (0, 1))
        rho = np.hypot(x, y)
        u = np.clip(u - (rho - radius) * rho / (x * dx + y * dy), -1.5, 1.5)
    x, y, z = (chebyshev.chebval(u, fit, tensor=False) for fit in fits)
    azimuth = np.arctan2(y, x)
    order = np.argsort(theta, kind="stable")
    azimuth[order] = np.unwrap(azimuth[order])
    if start is not None:
        azimuth += 2.0 * np.pi * np.round((start - azimuth[order[0]]) / (2.0 * np.pi))
    return np.asarray(radius * azimuth + 1j * z)


def _across(cam: SpatialCam, theta: Real) -> Real:
    """Offset [m] of the roller's axis from the cam's, at cam angles (n,)."""
    return np.asarray(cam.mount.axis(cam.law(theta, 2))[0][0][:, 1])
