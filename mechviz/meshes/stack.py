"""From pieces to heights: which pieces and pins would meet, the order of the layers, and where everything lies in z."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from shapely.geometry import Polygon

from .draft import Draft, Neck, Piece
from .layers import Post, order_layers
from .model import Model, Proportions
from .outline import disc
from .rounds import webs
from .sweep import Swept, meet

__all__ = ["Levels", "stack_pieces"]

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
    conflicts = _conflicts(model, draft, number)
    reaches = [_axle_reach(model, draft, k) for k in range(len(model.axles))]
    reaches += [_neck_reach(neck) for neck in draft.necks]
    reaches += [
        _Reach(disc(centre, 0.6 * model.proportions.r, 16), model.frame, (group,), frozenset({model.frame}), True)
        for centre, group in draft.fixed_blocks
    ]
    hits = _hits(model, draft, reaches, number)
    near = _near(model, reaches)
    posts = [
        Post(tuple(sorted({number[g] for g in reach.groups})), reach.ground, hits[k], near[k]) for k, reach in enumerate(reaches)
    ]
    behind = {number[piece.group]: _RAIL for piece in draft.pieces if piece.kind == "rail"}
    behind |= {number[draft.groups[name]]: _CARRIER for name in model.wheels.carriers - {model.frame}}
    behind |= {number[group]: _CARRIER for group in webs(model, draft)}
    order = order_layers(conflicts, posts, behind)
    layer = {name: order.layers[number[name]] for name in names}
    axles, necks = len(model.axles), len(draft.necks)
    top = max(order.layers, default=0)
    passed = tuple(tuple(sorted({layer[g] for g in draft.reached(model, k)})) for k in range(axles))
    return Levels(model.proportions, layer, draft.groups, passed, order.front[:axles], order.front[axles + necks :], top)


def _axle_reach(model: Model, draft: Draft, number: int) -> _Reach:
    axle = model.axles[number]
    ground = model.frame in axle.centres
    link = model.frame if ground else axle.owner
    outline = disc(axle.centres[link], axle.sleeve, 16)
    return _Reach(outline, link, draft.reached(model, number), frozenset(axle.centres), ground)


def _neck_reach(neck: Neck) -> _Reach:
    return _Reach(neck.outline, neck.link, neck.groups, frozenset({neck.link}), False)


def _conflicts(model: Model, draft: Draft, number: Mapping[str, int]) -> list[int]:
    """For every group the bit mask of the groups that it meets at some frame (or is joined to by a pair)."""
    masks = [0] * len(number)

    def forbid(a: int, b: int) -> None:
        if a != b:
            masks[a] |= 1 << b
            masks[b] |= 1 << a

    for k in range(len(model.axles)):
        groups = [number[group] for group in draft.reached(model, k)]
        for a in groups:
            for b in groups:
                forbid(a, b)
    for neck in draft.necks:
        forbid(number[neck.groups[0]], number[neck.groups[1]])
    if not model.frames:
        return masks
    swept = [(piece, _swept(model, piece)) for piece in draft.pieces]
    for i, (p, sp) in enumerate(swept):
        for q, sq in swept[:i]:
            a, b = number[p.group], number[q.group]
            if a != b and p.link != q.link and not masks[a] >> b & 1 and meet(sp, sq):
                forbid(a, b)
    return masks


def _swept(model: Model, piece: Piece) -> Swept:
    """A piece without its holes, a little larger than it is: what crosses a hole would be in the way of its edge."""
    outline = Polygon(piece.outline.exterior).buffer(0.08 * model.proportions.r, quad_segs=2)
    return Swept(outline.simplify(0.01 * model.proportions.r), model.poses[piece.link])


def _hits(model: Model, draft: Draft, reaches: list[_Reach], number: Mapping[str, int]) -> list[int]:
    """For every pin or neck the bit mask of the groups that would run into it."""
    masks = [0] * len(reaches)
    if not model.frames:
        return masks
    swept = [(piece, _swept(model, piece)) for piece in draft.pieces]
    for k, reach in enumerate(reaches):
        path = Swept(reach.outline, model.poses[reach.link])
        for piece, outline in swept:
            bit = 1 << number[piece.group]
            if piece.group in reach.groups or piece.link in reach.members - {model.frame} or masks[k] & bit:
                continue
            if meet(path, outline):
                masks[k] |= bit
    return masks


def _near(model: Model, reaches: list[_Reach]) -> list[tuple[int, ...]]:
    """For every pin or neck the others that it meets at some frame; necks and pins of one link never move apart."""
    near: list[list[int]] = [[] for _ in reaches]
    if model.frames:
        swept = [Swept(reach.outline, model.poses[reach.link]) for reach in reaches]
        for i, a in enumerate(swept):
            for j, b in enumerate(swept[:i]):
                if reaches[i].members & reaches[j].members - {model.frame}:
                    continue
                if meet(a, b):
                    near[i].append(j)
                    near[j].append(i)
    return [tuple(sorted(n)) for n in near]


def poses_of(model: Model, link: str) -> np.ndarray:
    """Poses (F, 3) of a link; at rest at the origin if the motion is not known."""
    return model.poses[link] if model.frames else np.zeros((1, 3))
