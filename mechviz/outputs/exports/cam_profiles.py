"""Profiles of cams for the workshop: DXF and SVG with arcs, CSV with normals and curvature; millimetres, axes of the cam's link."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.cams.contour import CamPiece
from mechcore.cams.placed import PlacedCam
from mechcore.cams.placed_spatial import PlacedSpatial
from mechcore.forces.cam_events import lost_ranges
from mechcore.forces.cam_rating import placed_cams
from mechcore.texts import Text, as_angle, as_coordinate
from mechviz.files import OutputError, replacing
from mechviz.outputs.exports.cam_developments import Outline, developed
from mechviz.scene.kinds.cam_files import biarcs

if TYPE_CHECKING:
    from mechviz.runs import Run


STEP = 1.0  # degrees of the cam between the points that the arcs pass through
ON_CENTRE = 1e-6  # mm


def cam_outlines(run: Run) -> list[Outline]:
    """Profiles of all cams of a run, of a groove both flanks, of barrel, rib and end cams their developments.

    Raises `OutputError` where a profile crosses itself.
    """
    found: list[Outline] = []
    for cam in placed_cams(run.motion):
        if isinstance(cam, PlacedSpatial):
            found += developed(cam)
        if not isinstance(cam, PlacedCam):
            continue
        found.append(_profile(cam))
        if cam.groove and cam.bed is None and cam.cam.follower.radius > 0.0:
            found.append(_far_flank(cam))
        if cam.mate is not None:
            found.append(replace(_profile(cam.mate), name=f"{cam.name} second cam"))
    for outline in found:
        _check(outline)
    return found


def _into_link(cam: PlacedCam, z: Complex) -> Complex:
    return 1e3 * (cam.own + cam.mount * z)


def _profile(cam: PlacedCam) -> Outline:
    contour = cam.contour
    runs = []
    for piece in contour.pieces:
        if isinstance(piece, CamPiece):
            law = (cam.intended or cam.cam).law
            length = law.pieces[piece.piece].length
            if cam.bed is not None and piece.piece in (0, len(law.pieces) - 1):
                continue  # the level before and after the law
            n = max(int(np.ceil(np.degrees(length) / STEP)) if cam.bed is None else 120, 8)
        else:
            n, length = 32, 0.0
        u = np.linspace(0.0, 1.0, n + 1)
        d = piece(u, 2)
        angle = np.full(n + 1, np.nan)
        if isinstance(piece, CamPiece):
            share = piece.first + (piece.last - piece.first) * (1.0 - u if piece.backwards else u)
            angle = law.knots[piece.piece] + length * share
        size = np.abs(d[1])
        with np.errstate(divide="ignore", invalid="ignore"):
            radius = 1e3 * size**3 / np.imag(np.conj(d[1]) * d[2])
        runs.append((_into_link(cam, d[0]), cam.mount * d[1] / size, radius, angle))
    return Outline(cam.name, contour.closed, tuple(runs), 1e3 * complex(cam.own), 1)


def _far_flank(cam: PlacedCam) -> Outline:
    other = replace(cam.cam, outer=True)
    law = other.law
    runs = []
    for piece, start in zip(law.pieces, law.knots, strict=False):
        n = max(int(np.ceil(np.degrees(piece.length) / STEP)), 8)
        theta = start + piece.length * np.linspace(0.0, 1.0, n + 1)
        inside = np.clip(theta, start + 1e-12, start + piece.length - 1e-12)  # one-sided at the knots
        w = other.working_curve(inside, 1)
        size = np.abs(w[1])
        runs.append((_into_link(cam, w[0]), cam.mount * w[1] / size, 1e3 * other.at(inside).radius, theta))
    return Outline(f"{cam.name} outer flank", True, tuple(runs), 1e3 * complex(cam.own), -1)


def _check(outline: Outline) -> None:
    from shapely.geometry import LineString, Polygon

    z = outline.points
    xy = np.column_stack([z.real, z.imag])
    sound = Polygon(xy).is_valid if outline.closed else LineString(xy).is_simple
    if not sound:
        raise OutputError(
            f"The profile of '{outline.name}' crosses itself: a cutter would leave something else.",
            "Enlarge the base circle or take a smaller roller.",
        )


def _chain(outline: Outline) -> tuple[Complex, Real]:
    """Vertices and bulges of the whole curve; a closed one ends where it starts, which is left out."""
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

    What is unrolled from a cylinder has the cylinder's radius among the properties of the drawing.
    """
    import ezdxf

    ezdxf.options.write_fixed_meta_data_for_testing = True  # no date and no random number: the same cam gives the same file
    drawing = ezdxf.new("R2004", units=4)
    drawing.layers.add("PROFILE", color=7)
    drawing.layers.add("CENTRE", color=1)
    sheet = drawing.modelspace()
    centres: list[complex] = []
    for outline in outlines:
        z, bulges = _chain(outline)
        rows = np.column_stack([z.real, z.imag, bulges]).tolist()
        layer = {"layer": "CENTRE" if outline.centre_line else "PROFILE"}
        sheet.add_lwpolyline(rows, format="xyb", close=outline.closed, dxfattribs=layer)
        if outline.cylinder is not None:
            words = f"unrolled from a cylinder of radius {_text(outline.cylinder)} mm"
            drawing.header.custom_vars.append(outline.name, words)
        elif all(abs(outline.centre - c) > ON_CENTRE for c in centres):
            centres.append(outline.centre)
            sheet.add_point((outline.centre.real, outline.centre.imag), dxfattribs={"layer": "CENTRE"})
    text = StringIO()
    drawing.write(text)
    return text.getvalue()


def _text(value: float) -> str:
    return f"{value:.12g}" if value != 0.0 else "0.0"


def svg_text(outlines: Iterable[Outline]) -> str:
    """A drawing (SVG) true to scale in millimetres, y upwards, of arcs."""
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
    """A table: curve, coordinate of the cam, place, outward unit normal, radius of curvature (positive convex, inf straight)."""
    lines = ["curve,cam [rad or m],x [mm],y [mm],nx,ny,radius of curvature [mm]"]
    for o in outlines:
        name = '"' + o.name.replace('"', '""') + '"' if re.search(r'[",\r\n]', o.name) else o.name
        for points, tangents, radius, angle in o.runs:
            normal = -1j * tangents
            if o.outside < 0:  # a flank that faces the axis
                normal = np.where(np.real(np.conj(normal) * (points - o.centre)) > 0.0, -normal, normal)
            columns = (angle, points.real, points.imag, normal.real, normal.imag, radius)
            for row in zip(*(c.tolist() for c in columns), strict=True):
                lines.append(",".join([name, *("" if v != v else repr(v) for v in row)]))
    return "\r\n".join(lines) + "\r\n"


FORMATS: dict[str, Callable[[Iterable[Outline]], str]] = {"dxf": dxf_text, "svg": svg_text, "csv": profile_csv}


def export_profiles(run: Run, path: Path | str, kind: str, tell: Callable[[str], None] = lambda _: None) -> Path:
    """Write the profiles of all cams of a run as "dxf", "svg" or "csv". Raises `OutputError` where there is none.

    ``tell`` hears where a profile is not the one that was asked for, but what the cutter leaves of it.
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
    text = FORMATS[kind](outlines)
    with replacing(Path(path)) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")
    for line in _differences(run):
        tell(line)
    return Path(path)


def _differences(run: Run) -> list[str]:
    """In words, where profiles differ from what their laws ask for."""
    lines: list[str] = []
    for cam in placed_cams(run.motion):
        for first, last, at, miss in lost_ranges(cam):
            size = as_coordinate(abs(miss), rotary=cam.arm != 0.0, digits=4)
            a, b, c = (as_angle(x % (2.0 * np.pi), 4) for x in (first, last, at))
            words = (
                f"'{cam.name}' is undercut: written is what the cutter leaves. From {a} to {b} of the cam the follower misses its "
                f"law, by up to {size} at {c}."
            )
            lines.append(Text(words, run.scene.units))
    return lines
