"""The solids of a mechanism as one 3MF file (3D Manufacturing Format, core specification 1.3): millimetres, one object a link.

Every link is a component of its own with its name and colour, placed as it stands at the start of the run.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np

from mechviz.files import OutputError, replacing
from mechviz.picture.build import solids_of

if TYPE_CHECKING:
    from mechviz.meshes.solids import Solids
    from mechviz.runs import Run


_TYPES = """<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
"""
_RELATIONS = """<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Target="/3D/3dmodel.model" Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"""
_STAMP = (1980, 1, 1, 0, 0, 0)  # of the entries of the archive: the same run gives the same file


def model_xml(run: Run, solids: Solids) -> str:
    """The model part of the file."""
    title = quoteattr(run.scene.title or run.scene.name)[1:-1]
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<model unit="millimeter" xml:lang="en" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">',
        f'<metadata name="Title">{title}</metadata>',
        "<resources>",
        '<basematerials id="1">',
    ]
    drawn = [(name, solid) for name, solid in solids.links.items() if len(solid.mesh.faces)]
    lines += [f"<base name={quoteattr(name)} displaycolor={quoteattr(_hex(solid.color))}/>" for name, solid in drawn]
    lines.append("</basematerials>")
    items = []
    for k, (name, solid) in enumerate(drawn):
        lines.append(f'<object id="{k + 2}" name={quoteattr(name)} type="model" pid="1" pindex="{k}"><mesh><vertices>')
        points = 1e3 * np.asarray(solid.mesh.vertices)
        lines += [f'<vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>' for x, y, z in points.tolist()]
        lines.append("</vertices><triangles>")
        lines += [f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in np.asarray(solid.mesh.faces).tolist()]
        lines.append("</triangles></mesh></object>")
        x, y, angle = (float(v) for v in run.motion.pose(name)[0])
        c, s = np.cos(angle), np.sin(angle)
        if not np.isfinite([x, y, angle]).all():
            raise OutputError(f"'{name}' has no place at the start of the run.", "Let the run start where the mechanism can stand.")
        if solid.spin is not None:  # it stands at angle zero of its own axis
            c, s = 1.0, 0.0
        numbers = (c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0, 1e3 * x, 1e3 * y, 0.0)
        items.append(f'<item objectid="{k + 2}" transform="{" ".join(f"{v:.9g}" for v in numbers)}"/>')
    return "\n".join([*lines, "</resources>", "<build>", *items, "</build>", "</model>", ""])


def _hex(color: tuple[int, int, int, int]) -> str:
    return "#" + "".join(f"{v:02X}" for v in color[:3])


def export_3mf(run: Run, path: Path | str, *, solids: Solids | None = None) -> Path:
    """Write the solids of all links as 3MF."""
    text = model_xml(run, solids or solids_of(run))
    with replacing(Path(path)) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in (("[Content_Types].xml", _TYPES), ("_rels/.rels", _RELATIONS), ("3D/3dmodel.model", text)):
            entry = zipfile.ZipInfo(name, _STAMP)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, content)
    return Path(path)
