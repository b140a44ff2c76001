"""The solids of a mechanism, with fixtures, as files for 3D printing: one STL per link, or one 3MF; and a kit: plates for laser
cutting (DXF, SVG), all bodies laid flat for printing (3MF), and the list of parts."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from mechviz.files import OutputError, replacing, replacing_in
from mechviz.meshes.kit import FlatPart, kit_of, laid_out
from mechviz.meshes.solids import Solid, Solids, stl_bytes
from mechviz.outputs.exports.dxf import dxf_of, new_drawing
from mechviz.picture.build import collision_poses, solids_of
from mechviz.picture.fixtures import find_fixtures
from mechviz.picture.springs import find_coils

if TYPE_CHECKING:
    import trimesh

    from mechviz.runs import Run

_CONTENT_TYPES = """<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
"""
_PACKAGE_RELATIONS = """<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Target="/3D/3dmodel.model" Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"""
_ENTRY_DATE = (1980, 1, 1, 0, 0, 0)  # of the entries of the archive: equal runs give equal files


def model_xml(run: Run, solids: Solids) -> str:
    """The model part of the 3MF file, with all links in their poses at the start. Raises `OutputError` if a pose is not finite."""
    title = quoteattr(run.scene.title or run.scene.name)[1:-1]
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<model unit="millimeter" xml:lang="en" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">',
        f'<metadata name="Title">{title}</metadata>',
        "<resources>",
        '<basematerials id="1">',
    ]
    drawn = list(_printed(run, solids))
    lines += [f"<base name={quoteattr(name)} displaycolor={quoteattr(_hex(solid.color))}/>" for name, solid, _ in drawn]
    lines.append("</basematerials>")
    items = []
    for k, (name, solid, mesh) in enumerate(drawn):
        lines.append(f'<object id="{k + 2}" name={quoteattr(name)} type="model" pid="1" pindex="{k}"><mesh><vertices>')
        points = 1e3 * np.asarray(mesh.vertices)
        lines += [f'<vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>' for x, y, z in points.tolist()]
        lines.append("</vertices><triangles>")
        lines += [f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in np.asarray(mesh.faces).tolist()]
        lines.append("</triangles></mesh></object>")
        x, y, angle = (float(v) for v in run.motion.pose(name)[0])
        c, s = np.cos(angle), np.sin(angle)
        if not np.isfinite([x, y, angle]).all():
            raise OutputError(f"'{name}' has no place at the start of the run.", "Let the run start where the mechanism can stand.")
        if solid.spin is not None:  # drawn at angle zero about its own axis
            c, s = 1.0, 0.0
        numbers = (c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0, 1e3 * x, 1e3 * y, 0.0)
        items.append(f'<item objectid="{k + 2}" transform="{" ".join(f"{v:.9g}" for v in numbers)}"/>')
    return "\n".join([*lines, "</resources>", "<build>", *items, "</build>", "</model>", ""])


def _printed(run: Run, solids: Solids) -> Iterator[tuple[str, Solid, trimesh.Trimesh]]:
    """Every link that is drawn, with its solid and the watertight mesh [m] of the solid and its fixtures: bars and posts of the
    ground, seats, anvils, wheels."""
    import trimesh

    fixtures = find_fixtures(run, solids, find_coils(run, solids))
    for name, solid in solids.links.items():
        if len(solid.faces):
            fixed = [trimesh.Trimesh(mesh.vertices, mesh.faces) for mesh in fixtures.get(name, ())]
            yield name, solid, trimesh.util.concatenate([solid.mesh, *fixed]) if fixed else solid.mesh


def _hex(color: tuple[int, int, int, int]) -> str:
    return "#" + "".join(f"{v:02X}" for v in color[:3])


def export_3mf(run: Run, path: Path | str) -> Path:
    """Write the solids of all links as 3MF."""
    text = model_xml(run, solids_of(run))
    with replacing(Path(path)) as temporary:
        write_3mf(temporary, text)
    return Path(path)


def write_3mf(path: Path, text: str) -> None:
    """Write a 3MF file around its model part."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in (
            ("[Content_Types].xml", _CONTENT_TYPES),
            ("_rels/.rels", _PACKAGE_RELATIONS),
            ("3D/3dmodel.model", text),
        ):
            entry = zipfile.ZipInfo(name, _ENTRY_DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, content)


def export_stl(run: Run, folder: Path | str, *, solids: Solids | None = None) -> list[Path]:
    """Write one binary STL per link, in millimetres and in the link's own frame, into a folder, which is created if necessary."""
    written: list[Path] = []
    with replacing_in(Path(folder), run.scene.file_paths) as temporary:
        for name, _, mesh in _printed(run, solids or solids_of(run)):
            written.append(_free_name(Path(folder), name, written))
            (temporary / written[-1].name).write_bytes(stl_bytes(mesh))
    return written


def _free_name(folder: Path, link: str, taken: list[Path]) -> Path:
    """A file name for a link: without characters that file systems reject, and not used for another link."""
    stem = re.sub(r"[^\w.\-]+", "_", link).strip(".") or "link"
    path, n = folder / f"{stem}.stl", 2
    while any(path.name.lower() == t.name.lower() for t in taken):
        path, n = folder / f"{stem}-{n}.stl", n + 1
    return path


SHEET_WIDTH = 220.0  # of a sheet or a print bed [mm]
_SAME_LENGTH = 1e-3  # [mm] distance up to which two points coincide

PlacedParts = Sequence[tuple[FlatPart, float, float]]


def export_kit(run: Run, folder: Path | str, thickness: float, clearance: float, washer: float) -> list[Path]:
    """Write ``plates.dxf``, ``plates.svg``, ``kit.3mf`` and ``parts.csv`` into a folder, which is created if necessary.

    Lengths in mm, see `kit_of`.
    """
    parts = kit_of(run.motion.mechanism, collision_poses(run), thickness, clearance, washer)
    placed = laid_out(parts, SHEET_WIDTH)
    plates = [entry for entry in placed if entry[0].kind == "plate"]
    plates = laid_out([part for part, _, _ in plates], SHEET_WIDTH)
    texts = {"plates.dxf": parts_dxf(plates), "plates.svg": parts_svg(plates), "parts.csv": list_text(parts)}
    with replacing_in(Path(folder), run.scene.file_paths) as temporary:
        for name, text in texts.items():
            (temporary / name).write_text(text, encoding="utf-8", newline="")
        write_3mf(temporary / "kit.3mf", model_text(run.scene.title, placed))
    return [Path(folder) / name for name in (*texts, "kit.3mf")]


def list_text(parts: Sequence[FlatPart]) -> str:
    """The list of parts as a table: name, kind, count, thickness or length [mm], width and height [mm]."""
    rows = ["name,kind,count,thickness [mm],width [mm],height [mm]"]
    for part in parts:
        x0, y0, x1, y1 = part.outline.bounds
        name = '"' + part.name.replace('"', '""') + '"'
        rows.append(f"{name},{part.kind},{part.count},{part.thickness:.6g},{x1 - x0:.6g},{y1 - y0:.6g}")
    return "\r\n".join(rows) + "\r\n"


def parts_dxf(placed: PlacedParts) -> str:
    """Outlines and holes of parts (DXF, millimetres) on the layer CUT, round holes as circles; names with thicknesses on the layer
    NAME."""
    drawing = new_drawing()
    drawing.layers.add("CUT", color=1)
    drawing.layers.add("NAME", color=5)
    sheet = drawing.modelspace()
    for part, dx, dy in placed:
        for ring in _rings(part):
            sheet.add_lwpolyline((ring + np.array([dx, dy])).tolist(), close=True, dxfattribs={"layer": "CUT"})
        for x, y, radius in part.circles:
            sheet.add_circle((x + dx, y + dy), radius, dxfattribs={"layer": "CUT"})
        at = part.outline.representative_point()
        sheet.add_text(_label(part), height=3.0, dxfattribs={"layer": "NAME", "insert": (at.x + dx, at.y + dy)})
    return dxf_of(drawing)


def parts_svg(placed: PlacedParts) -> str:
    """Outlines and holes of parts as a drawing to scale (SVG, millimetres): cuts in red, names with thicknesses in blue."""
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
        lines.append(f'<text {place} font-size="3" stroke="none" fill="blue">{escape(_label(part))}</text>')
    size = f'width="{wide:.6g}mm" height="{tall:.6g}mm" viewBox="0 0 {wide:.6g} {tall:.6g}"'
    body = "\n".join(lines)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n<g fill="none" stroke="red" stroke-width="0.1">\n{body}\n</g>\n</svg>\n'
    )


def _label(part: FlatPart) -> str:
    return f"{part.name}, {part.thickness:.6g} mm"


def model_text(title: str, placed: PlacedParts) -> str:
    """The model part of a 3MF file with all parts as separate bodies, lying flat, pins upright."""
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
    """The outline and the holes other than circles, as rings (n, 2) [mm]."""
    rings = [part.outline.exterior]
    for ring in part.outline.interiors:
        centre = ring.centroid
        if not any(np.hypot(centre.x - x, centre.y - y) < _SAME_LENGTH for x, y, _ in part.circles):
            rings.append(ring)
    return [np.asarray(ring.coords)[:-1, :2] for ring in rings]
