"""A kit of a mechanism as files: plates for a laser (DXF, SVG), all bodies laid flat to print (3MF), and the list of parts."""

from __future__ import annotations

from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from mechviz.files import OutputError, replacing
from mechviz.meshes.kit import FlatPart, kit_of, laid_out
from mechviz.outputs.exports.solids import write_3mf
from mechviz.picture.build import looked_at

if TYPE_CHECKING:
    from mechviz.runs import Run

WIDTH = 220.0  # of a sheet or a print bed [mm]
_SAME = 1e-3  # [mm]

Placed = Sequence[tuple[FlatPart, float, float]]


def export_kit(run: Run, folder: Path | str, thickness: float, clearance: float, washer: float) -> list[Path]:
    """Write ``plates.dxf``, ``plates.svg``, ``kit.3mf`` and ``parts.csv`` into a folder that is made if need be.

    Lengths in mm, see `kit_of`.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        words = (error.strerror or str(error)).lower()
        raise OutputError(f"The folder '{folder}' cannot be made: {words}.", "Choose another place.") from None
    parts = kit_of(run.motion.mechanism, looked_at(run), thickness, clearance, washer)
    placed = laid_out(parts, WIDTH)
    plates = [entry for entry in placed if entry[0].kind == "plate"]
    plates = laid_out([part for part, _, _ in plates], WIDTH)
    written = []
    for name, text in (("plates.dxf", dxf_text(plates)), ("plates.svg", svg_text(plates)), ("parts.csv", list_text(parts))):
        with replacing(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="")
        written.append(folder / name)
    write_3mf(folder / "kit.3mf", model_text(run.scene.title, placed))
    return [*written, folder / "kit.3mf"]


def list_text(parts: Sequence[FlatPart]) -> str:
    """The list of parts as a table: name, kind, number, thickness or length [mm], size [mm]."""
    rows = ["name,kind,count,thickness [mm],width [mm],height [mm]"]
    for part in parts:
        x0, y0, x1, y1 = part.outline.bounds
        name = '"' + part.name.replace('"', '""') + '"'
        rows.append(f"{name},{part.kind},{part.count},{part.thickness:.6g},{x1 - x0:.6g},{y1 - y0:.6g}")
    return "\r\n".join(rows) + "\r\n"


def dxf_text(placed: Placed) -> str:
    """Outlines and holes of parts (DXF, millimetres) on the layer CUT, round holes as circles; names on the layer NAME."""
    import ezdxf

    ezdxf.options.write_fixed_meta_data_for_testing = True  # the same kit gives the same file
    drawing = ezdxf.new("R2004", units=4)
    drawing.layers.add("CUT", color=1)
    drawing.layers.add("NAME", color=5)
    sheet = drawing.modelspace()
    for part, dx, dy in placed:
        for ring in _rings(part):
            sheet.add_lwpolyline((ring + np.array([dx, dy])).tolist(), close=True, dxfattribs={"layer": "CUT"})
        for x, y, radius in part.circles:
            sheet.add_circle((x + dx, y + dy), radius, dxfattribs={"layer": "CUT"})
        at = part.outline.representative_point()
        sheet.add_text(part.name, height=3.0, dxfattribs={"layer": "NAME", "insert": (at.x + dx, at.y + dy)})
    text = StringIO()
    drawing.write(text)
    return text.getvalue()


def svg_text(placed: Placed) -> str:
    """The same as a drawing true to scale (SVG, millimetres): cuts in red, names in blue."""
    bounds = np.array([[v + (dx, dy)[k % 2] for k, v in enumerate(part.outline.bounds)] for part, dx, dy in placed])
    wide, tall = float(bounds[:, 2].max()), float(bounds[:, 3].max())
    lines = []
    for part, dx, dy in placed:
        for ring in _rings(part):
            path = " L ".join(f"{x + dx:.6g} {tall - y - dy:.6g}" for x, y in ring)
            lines.append(f'<path d="M {path} Z"/>')
        lines += [f'<circle cx="{x + dx:.6g}" cy="{tall - y - dy:.6g}" r="{r:.6g}"/>' for x, y, r in part.circles]
        at = part.outline.representative_point()
        place = f'x="{at.x + dx:.6g}" y="{tall - at.y - dy:.6g}"'
        lines.append(f'<text {place} font-size="3" stroke="none" fill="blue">{escape(part.name)}</text>')
    size = f'width="{wide:.6g}mm" height="{tall:.6g}mm" viewBox="0 0 {wide:.6g} {tall:.6g}"'
    body = "\n".join(lines)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n<g fill="none" stroke="red" stroke-width="0.1">\n{body}\n</g>\n</svg>\n'
    )


def model_text(title: str, placed: Placed) -> str:
    """All parts as bodies of their own that lie flat, pins upright: the model part of a 3MF file."""
    import trimesh

    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<model unit="millimeter" xml:lang="en" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">',
        f'<metadata name="Title">{quoteattr(title)[1:-1]}</metadata>',
        "<resources>",
    ]
    numbers: dict[int, int] = {}
    items = []
    for part, dx, dy in placed:
        if id(part) not in numbers:
            number = numbers[id(part)] = len(numbers) + 1
            mesh: Any = trimesh.creation.extrude_polygon(part.outline, part.thickness)
            lines.append(f'<object id="{number}" name={quoteattr(part.name)} type="model"><mesh><vertices>')
            lines += [f'<vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>' for x, y, z in np.asarray(mesh.vertices).tolist()]
            lines.append("</vertices><triangles>")
            lines += [f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in np.asarray(mesh.faces).tolist()]
            lines.append("</triangles></mesh></object>")
        items.append(f'<item objectid="{numbers[id(part)]}" transform="1 0 0 0 1 0 0 0 1 {dx:.9g} {dy:.9g} 0"/>')
    return "\n".join([*lines, "</resources>", "<build>", *items, "</build>", "</model>", ""])


def _rings(part: FlatPart) -> list[Any]:
    """The outline and the holes (n, 2) [mm] that are no circles."""
    rings = [part.outline.exterior]
    for ring in part.outline.interiors:
        centre = ring.centroid
        if not any(np.hypot(centre.x - x, centre.y - y) < _SAME for x, y, _ in part.circles):
            rings.append(ring)
    return [np.asarray(ring.coords)[:-1, :2] for ring in rings]
