"""Constructions of centres, drawn on the mechanism: instant centres with Kennedy's lines, evolutes, inflection circles, centres of
percussion with the line of the inertia resultant. Keys of nodes consist of group, item and part, like their entities."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.constructions.centres import InflectionCircle, InstantCentre, PathCurvature, Percussion
from mechcore.records import dataclass
from mechviz.picture.nodes import ArrowSet, Color, Lines, Node, Points
from mechviz.picture.overlays import centrode_strips, space, within

if TYPE_CHECKING:
    from mechviz.meshes.solids import Solids
    from mechviz.runs import Run

CENTRE_GROUPS: Mapping[str, tuple[str, str]] = {
    "instant_centres": ("Instant centres", "construction"),
    "evolutes": ("Evolutes", "point"),
    "inflection": ("Inflection circles", "link"),
    "percussion": ("Centres of percussion", "point"),
}
"""By group: its title, and the kind of its items."""

PIN_COLOR, CENTRE_COLOR, LINE_COLOR = (255, 206, 92), (92, 214, 255), (150, 166, 190)
CIRCLE_COLOR, CURVE_COLOR, RAY_COLOR, TANGENT_COLOR, AXIS_COLOR = (
    (120, 255, 190),
    (255, 150, 210),
    (150, 166, 190),
    (255, 206, 92),
    (190, 150, 255),
)
FORCE_COLOR, COMPONENT_COLOR = (208, 112, 246), (244, 178, 255)
VISIBLE_RANGE = 2.5  # largest distance from the middle at which anything is drawn, in sizes of the mechanism
LINE_OVERHANG = 0.06  # overhang of a line beyond the centres on it, in sizes of the mechanism
OPEN_OVERHANG = 0.35  # the same where one of the centres is outside the picture
LONGEST_ARC = 1.6  # longest arc of a circle that is drawn, in sizes of the mechanism
ARC_POINTS = 73
THIN_RADIUS, THICK_RADIUS, DOT_RADIUS = 0.0016, 0.0028, 0.009  # radii in sizes of the mechanism


def centre_nodes(run: Run, solids: Solids) -> Iterator[Node]:
    """Nodes of the constructions of centres on the mechanism, in colours for a dark background."""
    studies, height = run.studies, solids.z_top + 0.008 * solids.size
    for name, centre in studies.instant_centres.items():
        yield from _instant_centre(_Pen(run, solids, "instant_centres", name, height), centre, studies.instant_centres)
    for name, path in studies.evolutes.items():
        yield from _evolute(_Pen(run, solids, "evolutes", name, height), path, solids)
    for name, circle in studies.inflection.items():
        yield from _inflection(_Pen(run, solids, "inflection", name, height), circle)
    scale = _force_scale(studies.percussion, solids.size)
    for name, percussion in studies.percussion.items():
        yield from _percussion(_Pen(run, solids, "percussion", name, height), percussion, scale)


@dataclass(frozen=True, eq=False)
class _Pen:
    """Makes the nodes of one item of a group."""

    run: Run
    solids: Solids
    group: str
    name: str
    height: float

    @property
    def size(self) -> float:
        return self.solids.size

    @property
    def middle(self) -> complex:
        low, high = np.asarray(self.solids.bounds)[:, :2] @ np.array([1.0, 1.0j])
        return complex(0.5 * (low + high))

    def common(self, part: str) -> dict[str, Any]:
        path = (self.group, self.name, part)
        owner = (CENTRE_GROUPS[self.group][1], self.name)
        return {"key": ".".join(path), "owner": owner, "group": self.group, "entity": ("polygons", *path), "height": self.height}

    def near(self, z: Complex) -> Complex:
        """Places (F,), NaN where they are too far away to be drawn."""
        with np.errstate(invalid="ignore"):
            return np.where(np.abs(z - self.middle) < VISIBLE_RANGE * self.size, z, np.nan)

    def lines(self, part: str, strips: Mapping[str, tuple[Complex, Color, float]]) -> Iterator[Lines]:
        """A node of strips (F, n) by label, each with its colour and radius. A label that begins with a blank is not shown."""
        if strips:
            drawn, colors, radii = zip(*strips.values(), strict=True)
            words = tuple("" if text.startswith(" ") else text for text in strips)
            labels = words if any(words) else ()
            look: dict[str, Any] = {"colors": colors, "radii": tuple(r * self.size for r in radii), "labels": labels}
            yield Lines(strips=tuple(space(self._held(z), self.height) for z in drawn), **look, **self.common(part))

    def _held(self, z: Complex) -> Complex:
        """Strips (F, n), shrunk to a point at frames where they extend beyond the picture."""
        z = within(z, self.size)
        return np.where(np.abs(z[:, :1] - self.middle) < 2.0 * VISIBLE_RANGE * self.size, z, self.middle)

    def dot(self, part: str, place: Complex, color: Color, label: str) -> Iterator[Points]:
        dots = space(self.near(place)[:, None], self.height)
        dots[np.isnan(self.near(place))] = np.nan
        if np.isfinite(dots).any():
            look: dict[str, Any] = {"colors": (color,), "radii": (DOT_RADIUS * self.size,), "labels": (label,)}
            yield Points(parent="", places=dots, **look, **self.common(part))


def _instant_centre(pen: _Pen, centre: InstantCentre, known: Mapping[str, InstantCentre]) -> Iterator[Node]:
    strips = {}
    own = pen.near(centre.place)
    for k, line in enumerate(centre.lines):
        others = [pen.near(known[name].place) for name in line.through if name in known]
        along = np.array([np.real(np.conj(line.along) * (z - line.base)) for z in (own, *others)])
        room = np.where(np.isfinite(along).all(axis=0) & (len(others) == 2), LINE_OVERHANG, OPEN_OVERHANG) * pen.size
        with np.errstate(invalid="ignore"):
            low, high = np.fmin.reduce(along), np.fmax.reduce(along)
        ends = np.stack([line.base + (low - room) * line.along, line.base + (high + room) * line.along], axis=1)
        strips[f" {k}"] = (ends, LINE_COLOR, THIN_RADIUS)
    yield from pen.lines("lines", strips)
    yield from pen.dot("centre", centre.place, PIN_COLOR if centre.determined_by == "joint" else CENTRE_COLOR, pen.name)


def _evolute(pen: _Pen, path: PathCurvature, solids: Solids) -> Iterator[Node]:
    centre = pen.near(path.centre)
    strips = {" circle": (_arc(path.place, path.tangent, path.curvature, LONGEST_ARC * pen.size), CIRCLE_COLOR, THIN_RADIUS)}
    strips[" radius"] = (np.stack([path.place, centre], axis=1), RAY_COLOR, THIN_RADIUS)
    yield from pen.lines("circle", strips)
    evolute = np.column_stack([path.centre.real, path.centre.imag])
    pieces = tuple(piece[None] for piece in centrode_strips(evolute, evolute, solids, z=pen.height))
    if pieces:
        yield Lines(strips=pieces, colors=(CURVE_COLOR,), radii=(THICK_RADIUS * pen.size,), **pen.common("evolute"))
    yield from pen.dot("centre", path.centre, CURVE_COLOR, f"K of {pen.name}")


def _inflection(pen: _Pen, circle: InflectionCircle) -> Iterator[Node]:
    size, pole, across = pen.size, pen.near(circle.pole), circle.end - circle.pole
    with np.errstate(invalid="ignore", divide="ignore"):
        tangent = -1j * across / np.abs(across)
        bend = 2.0 / np.abs(across)
    strips = {
        "inflection circle": (_arc(pole, tangent, bend, 2.0 * LONGEST_ARC * size), CIRCLE_COLOR, THICK_RADIUS),
        " diameter": (np.stack([pole, pen.near(circle.end)], axis=1), RAY_COLOR, THIN_RADIUS),
        "pole tangent": (pole[:, None] + 0.35 * size * tangent[:, None] * np.array([-1.0, 1.0]), TANGENT_COLOR, THICK_RADIUS),
    }
    yield from pen.lines("circle", strips)
    yield from pen.dot("P", circle.pole, PIN_COLOR, "P")
    yield from pen.dot("J", circle.end, CIRCLE_COLOR, "J")
    bobillier = circle.bobillier
    if bobillier is None:
        return
    meeting, rays = pen.near(bobillier.meeting), {}
    for name, place, centre in zip(bobillier.points, bobillier.places, bobillier.centres, strict=True):
        rays[f" ray {name}"] = (_through(pole, place, pen.near(centre)), RAY_COLOR, THIN_RADIUS)
    rays[" points"] = (_through(bobillier.places[0], bobillier.places[1], meeting), RAY_COLOR, THIN_RADIUS)
    rays[" centres"] = (_through(pen.near(bobillier.centres[0]), pen.near(bobillier.centres[1]), meeting), RAY_COLOR, THIN_RADIUS)
    rays["collineation axis"] = (np.stack([pole, meeting], axis=1), AXIS_COLOR, THICK_RADIUS)
    yield from pen.lines("bobillier", rays)
    yield from pen.dot("Q", bobillier.meeting, AXIS_COLOR, "Q")


def _percussion(pen: _Pen, strike: Percussion, per_metre: float) -> Iterator[Node]:
    size, through = pen.size, pen.near(strike.through)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = strike.force / np.abs(strike.force)
    meeting = pen.near(strike.meeting)
    reach = np.real(np.conj(along) * (np.where(np.isfinite(meeting), meeting, through) - through))
    low, high = np.minimum(reach, 0.0) - OPEN_OVERHANG * size, np.maximum(reach, 0.0) + OPEN_OVERHANG * size
    strips = {
        " arm": (np.stack([strike.pivot, strike.mass_centre, strike.centre], axis=1), RAY_COLOR, THIN_RADIUS),
        "inertia resultant": (np.stack([through + low * along, through + high * along], axis=1), FORCE_COLOR, THIN_RADIUS),
        " carried": (np.stack([strike.mass_centre, meeting], axis=1), COMPONENT_COLOR, THIN_RADIUS),
        " turned": (np.stack([strike.centre, meeting], axis=1), COMPONENT_COLOR, THIN_RADIUS),
    }
    yield from pen.lines("line", strips)
    carried = np.abs(strike.direct).max(initial=0.0) > 1e-9 * np.abs(strike.turned).max(initial=0.0)
    for part, place, color in (
        ("S", strike.mass_centre, PIN_COLOR),
        ("W", strike.centre, CENTRE_COLOR),
        ("T", strike.meeting, FORCE_COLOR),
    ):
        if part != "T" or carried:  # T coincides with W for a pivot at rest
            yield from pen.dot(part, place, color, part)
    arrows = [(np.where(np.isfinite(meeting), meeting, through), strike.force)]
    arrows += [(strike.mass_centre, strike.direct), (strike.centre, strike.turned)] if carried else []
    starts, forces = (np.stack(part, axis=1) for part in zip(*arrows, strict=True))
    there = np.isfinite(starts) & np.isfinite(forces)
    look: dict[str, Any] = {
        "origins": space(starts, pen.height),
        "vectors": space(np.asarray(np.where(there, forces, 0.0) / per_metre, complex), 0.0),
        "colors": (FORCE_COLOR, COMPONENT_COLOR, COMPONENT_COLOR)[: len(arrows)],
        "labels": ("-m a_S", "-m a_B", "-m a_SB")[: len(arrows)],
    }
    yield ArrowSet(radius=2.0 * THICK_RADIUS * size, **look, **pen.common("forces"))


def _force_scale(studied: Mapping[str, Percussion], size: float) -> float:
    """Newtons per metre of the arrows: the largest is a third of ``size`` [m] long."""
    parts = [np.abs(part) for p in studied.values() for part in (p.force, p.direct, p.turned)]
    largest = float(np.nanmax(parts, initial=0.0)) if parts else 0.0
    return 3.0 * largest / size if largest > 0.0 else 1.0


def _arc(place: Complex, tangent: Complex, bend: Real, longest: float) -> Complex:
    """Circles (F, n) through places (F,) [m] with unit tangents (F,) and signed curvatures (F,) [1/m]. Of a circle longer than
    ``longest`` [m] it is the arc next to the place; zero curvature gives a straight line."""
    with np.errstate(invalid="ignore", divide="ignore"):
        length = np.fmin(longest, 2.0 * np.pi / np.abs(bend))
        turn = (bend * length)[:, None] * np.linspace(-0.5, 0.5, ARC_POINTS)
        chord = length[:, None] * np.linspace(-0.5, 0.5, ARC_POINTS) * np.sinc(turn / (2.0 * np.pi))
        return np.asarray(place[:, None] + tangent[:, None] * chord * np.exp(0.5j * turn))


def _through(*places: Complex) -> Complex:
    """Ends (F, 2) of the line segment through collinear points (F,), from the outermost point to the other; points that are not
    finite are left out."""
    z = np.stack(places, axis=1)
    first = np.take_along_axis(z, np.argmax(np.isfinite(z), axis=1)[:, None], axis=1)
    away = np.where(np.isfinite(z), z - first, 0.0)
    far = np.take_along_axis(away, np.argmax(np.abs(away), axis=1)[:, None], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = np.where(np.abs(far) > 0.0, far / np.abs(far), 0.0)
    along = np.real(np.conj(unit) * away)
    return np.concatenate(
        [first + unit * along.min(axis=1, keepdims=True), first + unit * along.max(axis=1, keepdims=True)], axis=1
    )
