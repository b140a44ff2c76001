"""Given profiles of cams: from circles, outlines, points, files and radii over the polar angle to contours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from mechcore.cams import contour as shapes
from mechcore.cams.contour import Contour, self_crossing
from mechcore.errors import MechanismError
from mechcore.texts import as_length
from mechviz.scene.cams.files import read_dxf, read_points
from mechviz.scene.kinds.segment_curves import Axes, lift_curve

if TYPE_CHECKING:
    from mechviz.scene.cams.cams import ProfileDocument
    from mechviz.scene.convert import Converter


SHAPES = ("lift", "eccentric", "outline", "points", "file", "radius")
_FINEST_UNIT = 1e-9  # of a drawing [m]


def given_contour(profile: ProfileDocument, base: float, path: str, convert: Converter) -> Contour | None:
    """A given profile in the axes of the cam's link [m]; faults of it are noted."""
    found = _shape(profile, base, path, convert)
    # circles and radii over the polar angle never cross themselves
    place = self_crossing(found) if found is not None and profile.eccentric is None and profile.radius is None else None
    if place is None:
        return found
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
