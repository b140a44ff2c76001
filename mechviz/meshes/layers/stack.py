"""From pieces to heights: which pieces and pins would meet, the order of the layers, and where everything lies in z."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry import Polygon

from mechcore.arrays import Real
from mechviz.meshes.draft import Draft, Neck, Piece
from mechviz.meshes.kinds.wheels_drawn import webs
from mechviz.meshes.layers.order import Post, order_layers
from mechviz.meshes.layers.sweep import Sweeps
from mechviz.meshes.model import Model, Proportions
from mechviz.meshes.outline import disc

_RAIL = 1.0  # what it costs to have rails one layer further from the back
_CARRIER = 9.0  # and the arm of a planetary gear or the web of a ring, which would hide the wheels


@dataclass(frozen=True)
class Levels:
    """Layers of a mechanism, counted from the back, and their heights in units of the size."""

    size: Proportions
    layer: Mapping[str, int]  # group -> layer
    group: Mapping[str, str]  # moving link -> group of its plate
    axle_layers: tuple[tuple[int, ...], ...]  # for every axle the layers that its pin passes
    axle_front: tuple[bool, ...]  # for every axle: whether its pedestal stands in front
    block_front: tuple[bool, ...]  # for every block that is fixed to the ground
    top: int  # the layer nearest to the viewer
    clashes: int = 0  # pieces and pins that meet all the same

    def of(self, link: str) -> int:
        """Layer of a moving link's plate."""
        return self.layer[self.group[link]]

    def plate(self, layer: int) -> tuple[float, float]:
        """Heights of the plates of a layer."""
        return layer * self.size.pitch, layer * self.size.pitch + self.size.t

    def slab(self, layer: int) -> tuple[float, float]:
        """Heights between which everything of a layer lies, bosses included."""
        low, high = self.plate(layer)
        return low - self.size.boss, high + self.size.boss


@dataclass(frozen=True, eq=False)
class _Reach:
    """A pin or neck that reaches through layers: its outline, the groups that it joins and the links that own it."""

    outline: Polygon
    link: str
    groups: tuple[str, ...]
    members: frozenset[str]
    ground: bool


def stack_pieces(model: Model, draft: Draft) -> Levels:
    """Find the order of layers in which the fewest pieces and pins meet during the motion."""
    names = draft.group_names
    number = {name: k for k, name in enumerate(names)}
    reaches = [_axle_reach(model, draft, k) for k in range(len(model.axles))]
    reaches += [_neck_reach(neck) for neck in draft.necks]
    reaches += [
        _Reach(disc(centre, 0.6 * model.proportions.r, 16), model.frame, (group,), frozenset({model.frame}), True)
        for centre, group in draft.fixed_blocks
    ]
    conflicts, hits, near = _meetings(model, draft, reaches, number)
    posts = [
        Post(tuple(sorted({number[g] for g in reach.groups})), reach.ground, hits[k], near[k]) for k, reach in enumerate(reaches)
    ]
    behind = {number[piece.group]: _RAIL for piece in draft.pieces if piece.kind == "rail"}
    behind |= {number[draft.groups[name]]: _CARRIER for name in model.wheels.carriers - {model.frame}}
    behind |= {number[group]: _CARRIER for group in webs(model, draft)}
    order = order_layers(conflicts, posts, behind)
    layer = _in_planes(model, draft, {name: order.layers[number[name]] for name in names})
    axles, necks = len(model.axles), len(draft.necks)
    top = max(layer.values(), default=0)
    passed = tuple(tuple(sorted({layer[g] for g in draft.reached(model, k)})) for k in range(axles))
    return Levels(
        model.proportions, layer, draft.groups, passed, order.front[:axles], order.front[axles + necks :], top, order.clashes
    )


def _in_planes(model: Model, draft: Draft, layer: dict[str, int]) -> dict[str, int]:
    """Layers of groups so that links of a plane lie together, as far in front of the first plane as is stated at least."""
    plane = dict.fromkeys(layer, 0.0)
    for piece in draft.pieces:
        plane[piece.group] = max(plane[piece.group], model.planes.get(piece.link, 0.0), key=abs)
    found: dict[str, int] = {}
    last = -1
    for at in sorted(set(plane.values())):
        own = [group for group in layer if plane[group] == at]
        used = sorted({layer[group] for group in own})
        first = max(last + 1, math.ceil((at - min(plane.values())) / model.proportions.pitch - 1e-9))
        found |= {group: first + used.index(layer[group]) for group in own}
        last = first + len(used) - 1
    return found


def _axle_reach(model: Model, draft: Draft, number: int) -> _Reach:
    axle = model.axles[number]
    ground = model.frame in axle.centres
    link = model.frame if ground else axle.owner
    outline = disc(axle.centres[link], axle.sleeve, 16)
    return _Reach(outline, link, draft.reached(model, number), frozenset(axle.centres), ground)


def _neck_reach(neck: Neck) -> _Reach:
    return _Reach(neck.outline, neck.link, neck.groups, frozenset({neck.link}), False)


def _meetings(
    model: Model, draft: Draft, reaches: list[_Reach], number: Mapping[str, int]
) -> tuple[list[int], list[int], list[tuple[int, ...]]]:
    """Bit masks: for every group those that it meets at some frame (or is joined to by a joint), for every pin or neck those that
    would run into it; and for every pin or neck the others that it meets: those of one link never move apart."""
    conflicts, hits = [0] * len(number), [0] * len(reaches)
    near: list[list[int]] = [[] for _ in reaches]

    def forbid(a: int, b: int) -> None:
        if a != b:
            conflicts[a] |= 1 << b
            conflicts[b] |= 1 << a

    for k in range(len(model.axles)):
        groups = [number[group] for group in draft.reached(model, k)]
        for a in groups:
            for b in groups:
                forbid(a, b)
    for neck in draft.necks:
        forbid(number[neck.groups[0]], number[neck.groups[1]])
    if not model.frames:
        return conflicts, hits, [() for _ in reaches]
    pieces, count = draft.pieces, len(draft.pieces)
    owners = [number[piece.group] for piece in pieces]
    asked: dict[tuple[str, int, int], list[tuple[int, int]]] = {}  # what is to be known -> pairs of outlines that tell it
    for i, p in enumerate(pieces):
        for j, q in enumerate(pieces[:i]):
            a, b = sorted((owners[i], owners[j]))
            if a != b and p.link != q.link and not conflicts[a] >> b & 1:
                asked.setdefault(("conflict", a, b), []).append((i, j))
    for k, reach in enumerate(reaches):
        for i, piece in enumerate(pieces):
            if piece.group not in reach.groups and piece.link not in reach.members - {model.frame}:
                asked.setdefault(("hit", k, owners[i]), []).append((count + k, i))
        for j, other in enumerate(reaches[:k]):
            if not reach.members & other.members - {model.frame}:
                asked["near", k, j] = [(count + k, count + j)]
    sweeps = Sweeps(
        [*_grown(model, pieces), *(reach.outline for reach in reaches)],
        [*(piece.link for piece in pieces), *(reach.link for reach in reaches)],
        model.poses,
    )
    pairs = np.array([pair for some in asked.values() for pair in some], np.int64)
    met = sweeps.meet(pairs, np.repeat(np.arange(len(asked)), [len(some) for some in asked.values()]))
    for (what, a, b), yes in zip(asked, met.tolist(), strict=True):
        if yes and what == "conflict":
            forbid(a, b)
        elif yes and what == "hit":
            hits[a] |= 1 << b
        elif yes:
            near[a].append(b)
            near[b].append(a)
    return conflicts, hits, [tuple(sorted(n)) for n in near]


def _grown(model: Model, pieces: Sequence[Piece]) -> list[Polygon]:
    """Pieces without their holes, a little larger than they are: what crosses a hole would be in the way of its edge."""
    r = model.proportions.r
    whole = shapely.polygons(shapely.get_exterior_ring([piece.outline for piece in pieces]))
    return list(shapely.simplify(shapely.buffer(whole, 0.08 * r, quad_segs=2), 0.01 * r))


def poses_of(model: Model, link: str) -> Real:
    """Poses (F, 3) of a link; at rest at the origin if the motion is not known."""
    return model.poses[link] if model.frames else np.zeros((1, 3))
