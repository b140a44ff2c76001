"""Solid parts from flat pieces: plates with bosses and holes, pins with heads, columns and pedestals of the ground.

Lengths are in units of the size; every part is given in the frame of its link, with its height along z in the vertices.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from shapely.geometry import Point, Polygon, box
from shapely.ops import unary_union

from mechcore.arrays import Vec2
from mechcore.records import dataclass
from mechviz.meshes.draft import Neck, PlacedPart, SolidsDraft
from mechviz.meshes.extrude import Groove, Part, Prism, Profile, RoundFeature, Shell, plate_mesh, revolve
from mechviz.meshes.kinds.spatial_cams import turrets_reach
from mechviz.meshes.layers import Levels
from mechviz.meshes.model import Axle, ScaledMechanism
from mechviz.meshes.outline import (
    clean,
    disc,
    key_outline,
    keyed_bore,
    keyway_corner,
    keyway_reach,
    largest,
    pedestal,
    polygons,
)
from mechviz.meshes.shading import BELT_COLOR, PIN_COLOR

_PIN_HEAD_HEIGHT = 0.3  # height of pin heads above all other parts, in plate thicknesses
_GROOVE_EXTENT = (0.2, 0.8)  # lower and upper edge of a groove, from the bottom (0) to the top (1) of a plate
_OUTER_BOSS = 0.33  # height of a boss that faces no other link, in heights of one that does


def make_parts(model: ScaledMechanism, draft: SolidsDraft, levels: Levels) -> list[Part]:
    """All parts of a mechanism."""
    parts: list[Part] = []
    for piece in draft.pieces:
        if piece.profile:
            parts.append(_round_part(levels, piece, model))
        elif piece.bore:
            parts.append(_nut(levels, piece, model))
        else:
            parts += _flat_parts(model, draft, levels, piece)
    parts += _necks(model, draft, levels)
    for k in range(len(model.axles)):
        parts += _pins(model, draft, levels, k)
    parts += _pedestals(model, draft, levels)
    if not any(part.link == model.frame for part in parts):  # no part is on the ground: show its origin
        low, high = levels.plate(-1)
        foot = pedestal((0.0, 0.0), model.proportions.half_width, model.segments)
        shell = plate_mesh(foot, (low, high), model.proportions.bevel)
        parts.append(Part(model.frame, "pedestal", shell, None, (Prism(foot, low, high),)))
    return parts


def _flat_parts(model: ScaledMechanism, draft: SolidsDraft, levels: Levels, piece: PlacedPart) -> list[Part]:
    """A plate, block or rail with its holes and bosses, and the keys in its holes."""
    size = model.proportions
    layer = levels.layer[piece.group]
    low, high = levels.plate(layer)
    if piece.kind in ("block", "rail"):
        low, high = _block_heights(levels, layer)
    low, high = (low + part * (high - low) for part in piece.height)
    turned: list[RoundFeature] = []
    holes: list[Polygon] = []
    bosses: list[Prism] = []
    keys: list[Part] = []
    shape = clean(piece.outline)
    for k, axle in enumerate(model.axles):
        if piece.link not in axle.centres or piece.link == model.frame:
            continue
        centre, radius = axle.centres[piece.link], axle.hole_in(piece.link)
        # The boss may fill the material around the axis, less the bevel and a margin.
        room = shape.exterior.distance(Point(centre)) if shape.contains(Point(centre)) else 0.0
        room = min([room, *(ring.distance(Point(centre)) for ring in shape.interiors)]) - 1.3 * size.bevel
        if room <= 1.02 * radius:
            continue
        hole = disc(centre, radius, model.segments)
        boss = min(axle.boss, room)
        bore = None
        if axle.key is not None and axle.owner == piece.link and boss > keyway_reach(axle.pin):
            bore = hole = keyed_bore(centre, axle.pin, axle.hole, axle.key, model.segments)
        holes.append(hole)
        if piece.kind not in ("plate", "wheel") or boss < 1.1 * radius:
            turned.append(RoundFeature(centre, ((radius, high),), ((radius, low),), bore))
            keys += [_key(axle, (low, high), model)] if bore else []
            continue
        above, below = _boss_heights(model, levels, k, layer)
        hubs = _hubs(draft, levels, piece, Point(centre))  # a hub replaces the boss on its side
        above, below = 0.0 if 1 in hubs else above, 0.0 if -1 in hubs else below
        chamfer = size.bevel
        if bore is not None:  # also the midpoints of the sides of a boss's end face must be clear of the corners of its keyway
            chamfer = min(chamfer, 0.4 * (boss * float(np.cos(np.pi / model.segments)) - keyway_corner(axle.pin)))
        upper = _boss(boss, radius, high, above, chamfer)
        lower = _boss(boss, radius, low, -below, chamfer)
        turned.append(RoundFeature(centre, upper, lower, bore))
        bosses.append(Prism(disc(centre, boss, model.segments).difference(hole), low - below, high + above))
        keys += [_key(axle, (low - below, high + above), model)] if bore else []
    marks = _drilled_marks(model, piece, shape, turned, low, high)
    turned += marks
    flat = shape.difference(unary_union([*holes, *(disc(mark.centre, mark.rim, model.segments) for mark in marks)]))
    space = (Prism(flat, low, high), *bosses)
    groove = None
    if piece.groove:
        bottom, top = (low + part * (high - low) for part in _GROOVE_EXTENT)
        groove = Groove(piece.groove, bottom, top)
        core = flat.intersection(shape.buffer(-piece.groove))
        space = (Prism(flat, low, bottom), Prism(largest(core), bottom, top), Prism(flat, top, high), *bosses)
    bevel = 0.0 if piece.kind == "belt" else size.bevel  # the corners of crossing spans are too sharp for one
    shell = plate_mesh(shape, (low, high), bevel, turned, model.segments, groove)
    color = BELT_COLOR if piece.kind == "belt" else None
    return [Part(piece.link, piece.kind, shell, color, space, piece.mates), *keys]


def _key(axle: Axle, z: tuple[float, float], model: ScaledMechanism) -> Part:
    """The key of a shaft between two heights."""
    assert axle.key is not None
    shape = key_outline(axle.centres[axle.owner], axle.pin, axle.key, model.segments)
    return Part(axle.owner, "key", plate_mesh(shape, z, 0.0), PIN_COLOR, (Prism(shape, *z),))


def _block_heights(levels: Levels, layer: int) -> tuple[float, float]:
    """Heights of blocks and rails of a layer: they protrude slightly beyond the plate on both sides."""
    (low, high), over = levels.plate(layer), 0.3 * levels.proportions.boss
    return low - over, high + over


def _round_part(levels: Levels, piece: PlacedPart, model: ScaledMechanism) -> Part:
    """A barrel or rod along its line, at the mid-height of its layer."""
    low, high = levels.plate(levels.layer[piece.group])
    middle, radius = 0.5 * (low + high), max(radius for radius, _ in piece.profile)
    shell = _laid(revolve(piece.profile, segments=model.segments), piece, middle)
    space = (Prism(piece.outline, middle - radius, middle + radius),)
    return Part(piece.link, piece.kind, shell, PIN_COLOR if piece.kind == "rod" else None, space, piece.mates)


def _nut(levels: Levels, piece: PlacedPart, model: ScaledMechanism) -> Part:
    """The nut of a screw, with the bore for its spindle."""
    low, high = _block_heights(levels, levels.layer[piece.group])
    (x, y), (c, s) = piece.line
    corners = np.asarray(piece.outline.exterior.coords) - (x, y)
    along, across = corners @ (c, s), corners @ (-s, c)
    half = 0.5 * (high - low)
    section = box(across.min(), -half, across.max(), half)
    bore = disc((0.0, 0.0), piece.bore, model.segments)
    shell = plate_mesh(section.difference(bore), (float(along.min()), float(along.max())), 0.0)
    space = (Prism(piece.outline, low, high),)
    return Part(piece.link, piece.kind, _laid(shell, piece, 0.5 * (low + high)), None, space, piece.mates)


def _laid(upright: Shell, piece: PlacedPart, middle: float) -> Shell:
    """A solid along the z axis, placed along the line of a piece at height ``middle``."""
    (x, y), (c, s) = piece.line
    # z is mapped to the direction of the line, x across it, y to z: a rotation, so that faces keep their orientation
    vertices = upright.vertices @ np.array([[-s, c, 0.0], [0.0, 0.0, 1.0], [c, s, 0.0]]) + (x, y, middle)
    return Shell(vertices, upright.faces)


def _hubs(draft: SolidsDraft, levels: Levels, piece: PlacedPart, centre: Point) -> set[int]:
    """The sides (1: above, -1: below) on which a hub about an axis joins a piece to another one of its link."""
    sides = set()
    for neck in draft.necks:
        if neck.link == piece.link and piece.group in neck.groups and neck.outline.contains(centre):
            other = neck.groups[0] if neck.groups[1] == piece.group else neck.groups[1]
            sides.add(1 if levels.layer[other] > levels.layer[piece.group] else -1)
    return sides


def _boss_heights(model: ScaledMechanism, levels: Levels, axle_number: int, layer: int) -> tuple[float, float]:
    """Heights of the bosses above and below a plate: full towards another link of the axle, low under a pin head."""
    axle, boss = model.axles[axle_number], model.proportions.boss
    reached = levels.axle_layers[axle_number]
    ground = model.frame in axle.centres
    front = levels.axle_front[axle_number]
    on_above = max(reached) > layer or (ground and front)
    on_below = min(reached) < layer or (ground and not front)
    if axle.key is not None:  # the shaft ends in the hub, without a head
        on_above, on_below = on_above or max(reached) == layer, on_below or min(reached) == layer
    return boss * (1.0 if on_above else _OUTER_BOSS), boss * (1.0 if on_below else _OUTER_BOSS)


def _boss(radius: float, hole: float, face: float, height: float, bevel: float) -> Profile:
    """Profile of a boss from the face of a plate to the edge of its hole; ``height`` < 0 on the underside."""
    if height == 0.0:
        return ((hole, face),)
    chamfer = min(bevel, 0.4 * (radius - hole), 0.5 * abs(height))
    sign = 1.0 if height > 0.0 else -1.0
    end = face + height
    return ((radius, face), (radius, end - sign * chamfer), (radius - chamfer, end), (hole, end))


def _drilled_marks(
    model: ScaledMechanism, piece: PlacedPart, shape: Polygon, turned: Sequence[RoundFeature], low: float, high: float
) -> list[RoundFeature]:
    """Small holes that mark named points without a pin."""
    if piece.kind != "plate" or piece.link == model.frame:
        return []
    radius = 0.2 * model.proportions.half_width
    marks: list[RoundFeature] = []
    for xy in model.marks[piece.link]:
        point = Point(xy)
        free = shape.contains(point) and shape.boundary.distance(point) > radius + 2.0 * model.proportions.bevel
        if free and all(point.distance(Point(other.centre)) > other.rim + 1.5 * radius for other in [*turned, *marks]):
            marks.append(RoundFeature(xy, ((radius, high),), ((radius, low),)))
    return marks


def _necks(model: ScaledMechanism, draft: SolidsDraft, levels: Levels) -> list[Part]:
    """Necks that join plates to blocks on other layers, from face to face; of equal necks within one another only the longest."""
    parts = []
    size = model.proportions
    spans: list[tuple[Neck, float, float]] = []
    for neck in draft.necks:
        lower, upper = sorted(levels.layer[group] for group in neck.groups)
        if lower == upper:
            continue
        plate_is_lower = levels.layer[neck.groups[0]] == lower
        low = levels.plate(lower)[1] + (0.0 if plate_is_lower else 0.3 * size.boss)
        high = levels.plate(upper)[0] - (0.3 * size.boss if plate_is_lower else 0.0)
        spans.append((neck, low, high))
    kept: list[tuple[Neck, float, float]] = []
    for neck, low, high in sorted(spans, key=lambda span: span[1] - span[2]):
        if not any(n.link == neck.link and a <= low and high <= b and n.outline.equals(neck.outline) for n, a, b in kept):
            kept.append((neck, low, high))
    for number, (neck, low, high) in enumerate(kept):
        wide = 1.03 + 0.002 * sum(other.link == neck.link for other, _, _ in kept[:number])
        holes = [  # slightly wider than those of the plates and of other necks: no two parts may share a vertex
            disc(axle.centres[neck.link], wide * axle.hole_in(neck.link), model.segments)
            for axle in model.axles
            if neck.link in axle.centres and neck.outline.distance(Point(axle.centres[neck.link])) < axle.hole_in(neck.link)
        ]
        for shape in polygons(neck.outline.difference(unary_union(holes))):
            parts.append(Part(neck.link, "neck", plate_mesh(shape, (low, high), 0.0), None, (Prism(shape, low, high),)))
    return parts


def _pins(model: ScaledMechanism, draft: SolidsDraft, levels: Levels, axle_number: int) -> list[Part]:
    """The pin of an axle; on a nut, one pin on each side with other links, which does not extend into the bore."""
    axle, reached = model.axles[axle_number], levels.axle_layers[axle_number] or (0,)
    nut = next((levels.layer_of(link) for link in axle.centres if model.spindles(link)), None)
    if nut is None:
        return [_pin(model, draft, levels, axle_number, reached)]
    sides = [tuple(k for k in reached if k <= nut), tuple(k for k in reached if k >= nut)]
    return [_pin(model, draft, levels, axle_number, side, nut) for side in sides if len(side) > 1]


def _pin(
    model: ScaledMechanism, draft: SolidsDraft, levels: Levels, axle_number: int, reached: tuple[int, ...], nut: int | None = None
) -> Part:
    """The pin of an axle through all its links, with spacers over the layers between them and heads at its free ends; if the first
    or last layer is that of the ``nut``, the pin ends at its face."""
    axle, size = model.axles[axle_number], model.proportions
    ground, front = model.frame in axle.centres, levels.axle_front[axle_number]
    steps: list[tuple[float, float, float]] = []  # radius, lower and upper height
    bottom, top = levels.slab(reached[0])[0], levels.slab(reached[-1])[1]
    head = 0.65 * size.boss
    if reached[0] == nut:
        steps.append((axle.pin, _block_heights(levels, nut)[1], levels.slab(nut)[1]))
    elif ground and not front:
        steps.append((axle.pin, bottom - size.clearance, bottom + size.boss))
    else:
        steps.append((axle.pin if axle.key else axle.sleeve, bottom, bottom + head))
    for a, b in pairwise(reached):
        if b > a + 1 and not _bushed(draft, levels, axle, a, b):
            gap = 0.5 * size.clearance
            steps.append((axle.sleeve, levels.slab(a)[1] + gap, levels.slab(b)[0] - gap))
    free = reached[-1] == levels.top and not any(levels.axle_front) and not any(levels.block_front)
    tall = _PIN_HEAD_HEIGHT * size.thickness if free else 0.0
    if reached[-1] == nut:
        steps.append((axle.pin, levels.slab(nut)[0], _block_heights(levels, nut)[0]))
    elif ground and front:
        steps.append((axle.pin, top - size.boss, top + size.clearance))
    elif axle.key is not None:  # the end of a shaft without a head, so that bore and key are visible
        steps.append((axle.pin, top - size.boss, top + 0.5 * tall))
    else:
        steps.append((axle.sleeve, top - head, top + tall))
    centre = axle.centres[axle.owner]
    shell = revolve(_stepped(axle, steps, size.bevel), centre, model.segments)
    space = tuple(Prism(disc(centre, radius, model.segments), low, high) for radius, low, high in steps)
    space += (Prism(disc(centre, axle.pin, model.segments), steps[0][1], steps[-1][2]),)
    return Part(axle.owner, "pin", shell, PIN_COLOR, space)


def _bushed(draft: SolidsDraft, levels: Levels, axle: Axle, low: int, high: int) -> bool:
    """Whether a hub of a link on the axle surrounds its pin from layer ``low`` to ``high``: no space for a spacer."""
    for neck in draft.necks:
        at = axle.centres.get(neck.link)
        if at is not None and neck.outline.contains(Point(at)):
            ends = sorted(levels.layer[group] for group in neck.groups)
            if ends[0] <= low and high <= ends[1]:
                return True
    return False


def _stepped(axle: Axle, steps: Sequence[tuple[float, float, float]], bevel: float) -> Profile:
    """Profile of a stepped shaft, with the pin's radius between wider steps, and chamfered ends."""
    first, last = steps[0], steps[-1]
    chamfer = min(bevel, 0.3 * axle.pin, 0.45 * (first[2] - first[1]), 0.45 * (last[2] - last[1]))
    profile = [(0.0, first[1]), (first[0] - chamfer, first[1]), (first[0], first[1] + chamfer)]
    for k, (radius, low, high) in enumerate(steps):
        if radius > axle.pin:
            profile += [] if k == 0 else [(axle.pin, low), (radius, low)]
            profile += [] if k == len(steps) - 1 else [(radius, high), (axle.pin, high)]
    profile += [(last[0], last[2] - chamfer), (last[0] - chamfer, last[2]), (0.0, last[2])]
    return tuple(profile)


@dataclass(frozen=True)
class _Stand:
    """Support of a ground pivot or a fixed block: a column from a pedestal to the nearest layer of its links."""

    centre: Vec2
    radius: float
    layers: tuple[int, ...]
    front: bool

    def column(self, levels: Levels, low: float, high: float) -> RoundFeature:
        """The column on a pedestal that extends between the heights ``low`` and ``high``."""
        chamfer, radius = levels.proportions.bevel, self.radius
        if self.front:
            end = levels.slab(max(self.layers))[1] + levels.proportions.clearance
            return RoundFeature(self.centre, bottom=((radius, low), (radius, end + chamfer), (radius - chamfer, end), (0.0, end)))
        end = levels.slab(min(self.layers))[0] - levels.proportions.clearance
        return RoundFeature(self.centre, top=((radius, high), (radius, end - chamfer), (radius - chamfer, end), (0.0, end)))


def _stands(model: ScaledMechanism, draft: SolidsDraft, levels: Levels) -> list[_Stand]:
    stands = []
    for axle, layers, front in zip(model.axles, levels.axle_layers, levels.axle_front, strict=True):
        if model.frame in axle.centres:
            layers = layers or (0,)
            stands.append(_Stand(axle.centres[model.frame], axle.sleeve, layers, front))
    for (centre, group), front in zip(draft.fixed_blocks, levels.block_front, strict=True):
        stands.append(_Stand(centre, 0.6 * model.proportions.half_width, (levels.layer[group],), front))
    return stands


def _pedestals(model: ScaledMechanism, draft: SolidsDraft, levels: Levels) -> list[Part]:
    """Feet of the ground pivots with their columns: behind all layers, or in front if a column from behind would be hit."""
    size = model.proportions
    stands = _stands(model, draft, levels)
    parts = []
    for front in (False, True):
        side = [stand for stand in stands if stand.front == front]
        low, high = levels.plate(levels.top + 1 if front else -1)
        if not front:  # lower than the rollers that pass over the foot of their turret
            sunk = max(0.0, high + levels.proportions.clearance - turrets_reach(model, levels))
            low, high = low - sunk, high - sunk
        feet = unary_union([pedestal(stand.centre, size.half_width, model.segments) for stand in side])
        for foot in polygons(feet):
            columns: list[RoundFeature] = []
            for stand in side:
                column, point = stand.column(levels, low, high), Point(stand.centre)
                # Stands that nearly coincide share one column.
                if foot.contains(point) and all(point.distance(Point(c.centre)) > column.rim + c.rim for c in columns):
                    columns.append(column)
            space = [Prism(foot, low, high)]
            for column in columns:
                ends = [z for _, z in (column.top or column.bottom)]
                space.append(Prism(disc(column.centre, column.rim, model.segments), min(ends), max(ends)))
            shell = plate_mesh(foot, (low, high), size.bevel, columns, model.segments)
            parts.append(Part(model.frame, "pedestal", shell, None, tuple(space)))
    return parts
