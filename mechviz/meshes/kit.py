"""A mechanism as a kit of flat parts: plates, pins and spacers, as separate bodies, from the same pieces as its solids."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np
from shapely import affinity
from shapely.geometry import MultiPoint, Point, Polygon, box
from shapely.ops import unary_union

from mechcore.arrays import Real, Vec2
from mechcore.cams import Roller
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechcore.spec.mechanism import Mechanism
from mechviz.meshes.draft import SolidsDraft
from mechviz.meshes.layers import Levels, stack_pieces
from mechviz.meshes.model import Axle, ScaledMechanism, scale_mechanism
from mechviz.meshes.outline import disc, largest, polygons
from mechviz.meshes.shapes import draft_pieces
from mechviz.meshes.solids import shaped

PART_SIDES = 128  # sides of a full circle
_BASE_EDGE = 1.8  # distance of a base's edge from the axes on it, in boss radii
_SHAFT_FLAT = 0.3  # depth of the flat on a shaft that drives its cams, of its radius
_SAME_PLACE = 1e-6  # in sizes of the mechanism
_PART_SPACING = 4.0  # between parts that are laid out [mm]


@dataclass(frozen=True, eq=False)
class FlatPart:
    """A part of a kit: its ``outline`` [mm] with all holes, its round holes as ``circles`` (x, y, radius) [mm], and its
    ``thickness`` [mm], of a pin its length. ``kind``: "plate", "pin" or "spacer"; ``count``: number of equal parts."""

    name: str
    kind: str
    outline: Polygon
    thickness: float
    circles: tuple[tuple[float, float, float], ...] = ()
    count: int = 1


def kit_of(
    mechanism: Mechanism, poses: Mapping[str, Real] | None, thickness: float, clearance: float, washer: float
) -> list[FlatPart]:
    """The parts of a kit, plates first. Plates are ``thickness`` [mm] thick and ``washer`` [mm] apart. A pin rotates in holes whose
    diameters are larger by ``clearance`` [mm], and fits tightly in the part that owns it. A shaft that drives its cams has a flat.

    ``poses`` as in `build_solids`. Belts, barrels and spatial cams are not flat and left out. Raises `MechanismError` if links
    differ too much in size, or if holes break out of their plates.
    """
    with shaped(mechanism):
        model = scale_mechanism(mechanism, poses, PART_SIDES)
        draft = draft_pieces(model)
        levels = stack_pieces(model, draft)
        return _Kit(mechanism, model, draft, levels, thickness, clearance, washer).parts()


@dataclass(frozen=True, eq=False)
class _Plate:
    """A plate of a link before drilling [mm]: ``outline``, round holes ``circles`` (x, y, radius), holes with a flat ``flats``."""

    name: str
    link: str
    outline: Polygon
    thickness: float
    circles: tuple[tuple[float, float, float], ...]
    flats: Sequence[Polygon] = ()

    def drilled(self) -> FlatPart:
        holes = [Point(x, y).buffer(r, quad_segs=PART_SIDES // 4) for x, y, r in self.circles]
        cut = largest(self.outline.difference(unary_union([*holes, *self.flats])))
        return FlatPart(self.name, "plate", cut, self.thickness, self.circles)


@dataclass(frozen=True)
class _Roller:
    """A roller of a follower in the frame of its ``link``: centre, radius, and radius of its pin, in sizes of the mechanism."""

    link: str
    centre: Vec2
    radius: float
    pin: float

    def held_by(self, shape: Polygon) -> bool:
        """Whether a piece of the link has enough material around the pin."""
        return bool(shape.contains(Point(self.centre).buffer(1.2 * self.pin)))


@dataclass(frozen=True, eq=False)
class _Kit:
    mechanism: Mechanism
    model: ScaledMechanism
    draft: SolidsDraft
    levels: Levels
    thickness: float
    clearance: float
    washer: float

    @property
    def scale(self) -> float:
        """Size of the mechanism [mm]."""
        return 1e3 * self.model.size

    def parts(self) -> list[FlatPart]:
        undrilled = [*self._bases(), *self._plates()]
        self._check_holes(undrilled)
        plates = [plate.drilled() for plate in undrilled]
        return [*plates, *_counted([*self._pins()]), *_counted([*self._spacers()])]

    # -- plates ---------------------------------------------------------------------------------------------------------
    def _check_holes(self, plates: Sequence[_Plate]) -> None:
        """Raise `MechanismError` if the clearance makes a hole break out of its plate."""
        narrow = []
        for plate in plates:
            for x, y, radius in plate.circles:
                room = plate.outline.exterior.distance(Point(x, y))
                most = self.clearance - 2.0 * (radius - room)
                if radius >= room and most > 0.0:
                    narrow.append((most, plate, x, y))
        if narrow:
            most, plate, x, y = min(narrow, key=lambda hole: hole[0])
            points = [at for link in self.mechanism.links if link.name == plate.link for at in link.points.items()]
            point = next((n for n, at in points if math.dist((1e3 * at[0], 1e3 * at[1]), (x, y)) < _SAME_PLACE * self.scale), None)
            hole = f"at ({x:.4g}, {y:.4g}) mm" if point is None else f"'{point}'"
            why = f"{self.clearance:g} mm is too much: hole {hole} of '{plate.link}' breaks out of its plate."
            step = 10.0 ** (math.floor(math.log10(most)) - 2)
            raise MechanismError(Fault("clearance", why, f"Give less than {step * math.floor(most / step):.3g} mm."))

    def _plates(self) -> Iterator[_Plate]:
        shapes: dict[tuple[str, str, tuple[float, float]], list[Polygon]] = {}
        for piece in self.draft.pieces:
            if not piece.profile and piece.kind != "belt":
                shapes.setdefault((piece.link, piece.group, piece.height), []).append(piece.outline)
        names: dict[str, int] = {}
        for (link, group, height), outlines in shapes.items():
            for shape in polygons(unary_union(outlines)):
                number = names[link] = names.get(link, 0) + 1
                circles, flats = self._holes(link, shape)
                outline = affinity.scale(shape, self.scale, self.scale, origin=(0.0, 0.0))
                deep = (height[1] - height[0]) * self.thickness
                label = link if number == 1 else f"{link} {number} ({group})"
                yield _Plate(label, link, outline, deep, circles, flats)

    def _holes(self, link: str, shape: Polygon) -> tuple[tuple[tuple[float, float, float], ...], list[Polygon]]:
        """Round holes (x, y, radius) [mm] for the pins in a piece of a link, and holes with a flat [mm]."""
        circles, flats = [], []
        for axle in self.model.axles:
            fast = self._fixed_on_pin(axle)
            x0, y0 = fast[link][:2] if link in fast else axle.centres.get(link, (np.nan, np.nan))
            if not shape.contains(Point(x0, y0)):
                continue
            x, y, radius = self.scale * x0, self.scale * y0, self.scale * axle.pin
            if link not in fast:
                circles.append((x, y, radius + 0.5 * self.clearance + self.scale * axle.play.get(link, 0.0)))
            elif axle.key is None:
                circles.append((x, y, radius))
            else:
                flats.append(affinity.translate(_shaft(radius, axle.key, fast[link][2]), x, y))
        for roller in self._rollers:
            if link == roller.link and roller.held_by(shape):
                x, y = (self.scale * v for v in roller.centre)
                turns = shape.area < 1.01 * math.pi * roller.radius**2
                circles.append((x, y, self.scale * roller.pin + (0.5 * self.clearance if turns else 0.0)))
        return tuple(circles), flats

    @cached_property
    def _rollers(self) -> list[_Roller]:
        faces = [(cam, cam.placed.cam.follower.face) for cam in self.model.cams]
        widest = 0.4 * self.model.proportions.half_width
        rollers = [(cam.follower, cam.tip, face.radius / self.model.size) for cam, face in faces if isinstance(face, Roller)]
        return [_Roller(link, tip, radius, min(widest, 0.3 * radius)) for link, tip, radius in rollers]

    def _fixed_on_pin(self, axle: Axle) -> dict[str, tuple[float, float, float]]:
        """Links in which a pin fits tightly, its owner and the links welded to it there, with x and y of the axis in their frames,
        and the angle [rad] from the owner's frame to theirs, reversed."""
        at = axle.centres[axle.owner]
        places = {axle.owner: (*at, 0.0)}
        for weld in self.model.welds:
            for k, sign in ((0, -1.0), (1, 1.0)):
                if weld.links[k] == axle.owner and np.hypot(*np.subtract(weld.points[k], at)) < _SAME_PLACE:
                    places[weld.links[1 - k]] = (*weld.points[1 - k], sign * weld.angle)
        return places

    def _bases(self) -> Iterator[_Plate]:
        """A base plate behind all layers, and one in front of them if pins stand on it, around the axes fixed to the ground."""
        frame, model = self.model.frame, self.model
        rails = [p.outline for p in self.draft.pieces if p.link == frame and not p.profile]
        for front in (False, True):
            own = [a for a, f in zip(model.axles, self.levels.axle_front, strict=True) if frame in a.centres and f == front]
            if not own:
                continue
            reach = _BASE_EDGE * max(axle.boss for axle in own)
            bosses = MultiPoint([axle.centres[frame] for axle in own]).buffer(reach, quad_segs=PART_SIDES // 4)
            shape = unary_union([bosses, *([] if front else rails)]).convex_hull
            circles = []
            for axle in own:
                turns = 0.0 if axle.owner == frame else 0.5 * self.clearance
                x, y = (self.scale * v for v in axle.centres[frame])
                circles.append((x, y, self.scale * axle.pin + turns))
            outline = affinity.scale(shape, self.scale, self.scale, origin=(0.0, 0.0))
            yield _Plate("front" if front else "base", frame, outline, self.thickness, tuple(circles))

    # -- pins and spacers -----------------------------------------------------------------------------------------------
    def _reach(self, number: int) -> list[int]:
        """Layers on which the pin of an axle has plates, including the bases."""
        axle = self.model.axles[number]
        layers = [
            *self.levels.axle_layers[number],
            *(self.levels.layer_of(link) for link in self._fixed_on_pin(axle) if link in self.draft.groups),
        ]
        if self.model.frame in axle.centres:
            layers.append(self.levels.top + 1 if self.levels.axle_front[number] else -1)
        return sorted(set(layers))

    def _pins_of_rollers(self) -> Iterator[tuple[_Roller, list[tuple[int, float, float]]]]:
        """Every roller with the pieces through which its pin passes: their layers, and the fractions of the layer's height that
        they occupy (from, to)."""
        for roller in self._rollers:
            held = [p for p in self.draft.pieces if p.link == roller.link and not p.profile and roller.held_by(p.outline)]
            yield roller, sorted((self.levels.layer[piece.group], *piece.height) for piece in held)

    def _pins(self) -> Iterator[FlatPart]:
        pitch = self.thickness + self.washer
        for roller, through in self._pins_of_rollers():
            ends = [layer * pitch + part * self.thickness for layer, *height in through for part in height]
            radius = self.scale * roller.pin
            if len(through) > 1:
                yield FlatPart(
                    f"roller pin {2.0 * radius:.3g} mm", "pin", disc((0.0, 0.0), radius, PART_SIDES), max(ends) - min(ends)
                )
        for number, axle in enumerate(self.model.axles):
            layers = self._reach(number)
            if len(layers) < 2:
                continue
            radius = self.scale * axle.pin
            span = layers[-1] - layers[0]
            shape = disc((0.0, 0.0), radius, PART_SIDES) if axle.key is None else _shaft(radius, axle.key, 0.0)
            name = f"{'shaft' if axle.key is not None else 'pin'} {2.0 * radius:.3g} mm"
            yield FlatPart(name, "pin", shape, span * (self.thickness + self.washer) + self.thickness)

    def _spacers(self) -> Iterator[FlatPart]:
        between = [(axle.pin, axle.sleeve, self._reach(number)) for number, axle in enumerate(self.model.axles)]
        between += [(r.pin, 1.5 * r.pin, sorted({layer for layer, *_ in through})) for r, through in self._pins_of_rollers()]
        for pin, sleeve, layers in between:
            inner = self.scale * pin + 0.5 * self.clearance
            outer = max(self.scale * sleeve, inner + 1.0)
            ring = disc((0.0, 0.0), outer, PART_SIDES).difference(disc((0.0, 0.0), inner, PART_SIDES))
            for a, b in pairwise(layers):
                height = (b - a) * (self.thickness + self.washer) - self.thickness
                yield FlatPart(f"spacer {2.0 * inner:.3g} mm", "spacer", largest(ring), height, ((0.0, 0.0, inner),))


def _shaft(radius: float, key: tuple[float, float], turned: float) -> Polygon:
    """A round shaft about the origin with a flat in the direction of its ``key``, rotated by ``turned`` [rad]."""
    turn = math.degrees(math.atan2(key[1], key[0]) + turned)
    cut = box((1.0 - _SHAFT_FLAT) * radius, -2.0 * radius, 2.0 * radius, 2.0 * radius)
    whole = disc((0.0, 0.0), radius, PART_SIDES).difference(affinity.rotate(cut, turn, origin=(0.0, 0.0)))
    return largest(whole)


def _counted(parts: Sequence[FlatPart]) -> list[FlatPart]:
    """Equal parts merged into one, with their count."""
    alike: dict[tuple[str, float, float], list[FlatPart]] = {}
    for part in parts:
        alike.setdefault((part.name, round(part.thickness, 6), round(part.outline.area, 6)), []).append(part)
    return [FlatPart(p[0].name, p[0].kind, p[0].outline, p[0].thickness, p[0].circles, len(p)) for p in alike.values()]


def laid_out(parts: Sequence[FlatPart], width: float) -> list[tuple[FlatPart, float, float]]:
    """Every single part with its displacement x and y [mm], arranged without overlap in rows up to a width [mm]."""
    every = [part for part in parts for _ in range(part.count)]
    every.sort(key=lambda part: -np.ptp(part.outline.bounds[1::2]))
    placed, x, y, tall = [], 0.0, 0.0, 0.0
    for part in every:
        x0, y0, x1, y1 = part.outline.bounds
        if x > 0.0 and x + (x1 - x0) > width:
            x, y, tall = 0.0, y + tall + _PART_SPACING, 0.0
        placed.append((part, x - x0, y - y0))
        x, tall = x + (x1 - x0) + _PART_SPACING, max(tall, y1 - y0)
    return placed
