"""Vectors as arrows and moments as arcs with a head, by family; each family has a switch and a scale factor."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
import viser

from mechcore.arrays import Flags, Real, Single
from mechviz.outputs.viewer.playback import PointTrack, ragged
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.picture.nodes import Arrow, MomentArc
from mechviz.picture.proportions import (
    ARC_RADIUS,
    ARC_TIP,
    ARC_WIDTH,
    ARROW_HEAD_LENGTH,
    ARROW_HEAD_RADIUS,
    ARROW_SHAFT_RADIUS,
    LEAST_ARROW,
    arc_corners,
    arc_faces,
)
from mechviz.quantities.vectors import VECTOR_FAMILIES

ARC_STEPS = 40
LARGEST_TURN = 1.8 * np.pi
ARC_FACES = arc_faces(ARC_STEPS)


def arrow_points(origins: Real, arrows: Real, z: Real | float, least: float) -> Single:
    """Ends (n, 2, 3) [m] of the visible ones among ``arrows`` (N, 2) [m] from ``origins`` (N, 2) [m].

    ``z``: heights (N,) or one height [m]. viser draws an arrow that is shorter than its head, even one of zero length, as a whole
    head: arrows shorter than ``least`` [m] are left out.
    """
    with np.errstate(invalid="ignore"):
        visible = np.hypot(arrows[:, 0], arrows[:, 1]) >= least
    visible &= np.isfinite(origins).all(axis=1) & np.isfinite(arrows).all(axis=1)
    start, end = origins[visible], origins[visible] + arrows[visible]
    points = np.empty((len(start), 2, 3), np.float32)
    points[:, 0, :2], points[:, 1, :2] = start, end
    points[:, :, 2] = np.broadcast_to(z, len(visible))[visible, None]
    return points


def arc_vertices(centre: Real, turn: float, radius: float, width: float, z: float) -> Single:
    """Vertices (V, 3) [m] of a flat arc with a head, for `ARC_FACES`: about ``centre`` (2,), from the x axis through ``turn``
    [rad]."""
    flat = arc_corners(turn, radius, width, ARC_STEPS) + complex(*centre)
    return np.column_stack([flat.real, flat.imag, np.full(len(flat), z)]).astype(np.float32)


class ArrowValues(NamedTuple):
    """The values that a node draws over the run: magnitudes ``values`` (F, n) in the SI unit ``si``, of moments with their sign,
    and the ends of the arrows, ``starts`` (of an arc: its centre) and ``tips`` (F, n, 3) [m], NaN where an arrow is not drawn."""

    node: str
    family: str
    si: str
    values: Real
    starts: Real
    tips: Real


def _ends(starts: Real, tips: Real, z: Real, seen: Flags) -> tuple[Real, Real]:
    """Starts and tips (F, n, 2) with heights ``z`` (n,) as points (F, n, 3), NaN where not ``seen`` (F, n)."""
    heights = np.broadcast_to(z[None, :, None], (*seen.shape, 1))
    first, last = (np.where(seen[..., None], np.concatenate([at, heights], axis=2), np.nan) for at in (starts, tips))
    return first, last


class ArrowNodes:
    """The arrows of all families: ``show`` draws those of a frame, ``switch`` and ``enlarge`` change which and how long."""

    def __init__(self, server: viser.ViserServer, view_model: ViewModel):
        self._server = server
        self._size = view_model.size  # shafts and heads keep the size of the mechanism as it was opened
        self._on, self._dark = dict.fromkeys(VECTOR_FAMILIES, False), False
        self._factors = dict.fromkeys(VECTOR_FAMILIES, 1.0)
        self._nodes: dict[str, viser.ArrowsHandle] = {}
        self._arcs: dict[tuple[str, str], viser.MeshHandle] = {}
        self.update(view_model)

    def update(self, view_model: ViewModel) -> None:
        """Take the vectors and moments of ``view_model`` from the next ``show(frame)`` on."""
        self._present = tuple(family for family in VECTOR_FAMILIES if family in view_model.families)
        self._scales = view_model.scales
        self._tracks: dict[str, tuple[Real, Real, Real]] = {}
        for family, arrows in arrows_by_family(view_model).items():
            if family not in self._nodes:
                self._nodes[family] = self._add_arrows(family)
            origins, values = (np.stack(part, axis=1) for part in zip(*((a.origin, a.vector.value) for a in arrows), strict=True))
            self._tracks[family] = origins, values / view_model.scales.per_metre(family), np.array([a.height for a in arrows])
        for family, node in self._nodes.items():
            if family not in self._tracks:
                node.visible = False
        self._turns: dict[tuple[str, str], tuple[MomentArc, Real, Real]] = {}
        for arc in view_model.picture.nodes_of(MomentArc):
            moment, key = arc.moment, (arc.moment.family, arc.moment.item)
            if key not in self._arcs:
                self._arcs[key] = self._add_arc(*key)
            self._turns[key] = arc, moment.origin, moment.value / view_model.scales.newton_metres_per_metre / arc.radius
        for key, node in self._arcs.items():
            if key not in self._turns:
                node.visible = False

    @property
    def families(self) -> tuple[str, ...]:
        """Families with anything to draw."""
        return self._present

    def bounds(self, frame: int | None = None) -> Real | None:
        """The box (2, 2) [m] around the arrows that are on, over all frames or at one; None if there are none."""
        some = slice(None) if frame is None else slice(frame, frame + 1)
        ends = [(origins + lengths)[some] for family, (origins, lengths, _) in self._tracks.items() if self._on[family]]
        flat = np.concatenate([e.reshape(-1, 2) for e in ends]) if ends else np.zeros((0, 2))
        flat = flat[np.isfinite(flat).all(axis=1)]
        return np.array([flat.min(axis=0), flat.max(axis=0)]) if len(flat) else None

    def factor(self, family: str) -> float:
        """The scale factor of a family."""
        return self._factors[family]

    def is_on(self, family: str) -> bool:
        return self._on[family]

    def switch(self, family: str, on: bool) -> None:
        """Show or hide a family from the next ``show`` on."""
        self._on[family] = on

    def darken(self, dark: bool) -> None:
        """Use the colours for a dark or a light page."""
        self._dark = dark
        for family, node in self._nodes.items():
            node.colors = np.array(_linear(self._color(family)), np.uint8)
        for (family, _), arc in self._arcs.items():
            arc.color = self._color(family)

    def enlarge(self, factor: float, families: Iterable[str] = tuple(VECTOR_FAMILIES)) -> None:
        """Scale the arrows of some families by a factor from the next ``show`` on."""
        for family in families:
            self._factors[family] = factor

    def points(self, family: str, frame: int) -> Single:
        """Ends (n, 2, 3) [m] of a family's arrows that are long enough to be seen at a frame."""
        origins, lengths, z = self._tracks[family]
        return arrow_points(origins[frame], lengths[frame] * self._factors[family], z, LEAST_ARROW * self._size)

    def corners(self, key: tuple[str, str], frame: int) -> Single | None:
        """Vertices of an arc at a frame; None if it is too short to be seen."""
        arc, origins, turns = self._turns[key]
        turn = float(np.clip(turns[frame] * self._factors[key[0]], -LARGEST_TURN, LARGEST_TURN))
        if not abs(turn) >= ARC_TIP:
            return None
        return arc_vertices(origins[frame], turn, arc.radius, ARC_WIDTH * self._size, arc.height)

    def show(self, frame: int) -> None:
        for family in self._tracks:
            node = self._nodes[family]
            if not self._on[family]:
                node.visible = False
                continue
            points = self.points(family, frame)
            node.visible = len(points) > 0
            if len(points):
                node.points = points
        for key in self._turns:
            arc = self._arcs[key]
            corners = self.corners(key, frame) if self._on[key[0]] else None
            arc.visible = corners is not None
            if corners is not None:
                arc.vertices = corners

    def tracks(self) -> Iterator[PointTrack]:
        """Tracks of all arrows and arcs that are on: what ``show`` draws, for all frames at once."""
        for family, (origins, lengths, z) in self._tracks.items():
            if self._on[family]:
                drawn = lengths * self._factors[family]
                with np.errstate(invalid="ignore"):
                    seen = np.hypot(drawn[..., 0], drawn[..., 1]) >= LEAST_ARROW * self._size
                seen &= np.isfinite(origins).all(axis=2) & np.isfinite(drawn).all(axis=2)
                flat = np.stack([origins, origins + drawn], axis=2)
                heights = np.broadcast_to(z[None, :, None, None], (*flat.shape[:3], 1))
                steady = np.append((seen[1:] == seen[:-1]).all(axis=1), False)
                yield PointTrack(f"/vectors/{family}", "points", *ragged(np.concatenate([flat, heights], axis=3), seen), steady)
        for key in self._turns:
            if self._on[key[0]]:
                corners = [self.corners(key, frame) for frame in range(len(self._turns[key][2]))]
                empty = np.zeros((2 * ARC_STEPS + 5, 3), np.float32)
                values = np.stack([empty if c is None else c for c in corners]).reshape(len(corners), -1)
                counts = np.array([0 if c is None else values.shape[1] for c in corners])
                yield PointTrack(arc_path(*key), "vertices", values, counts)

    def values(self) -> Iterator[ArrowValues]:
        """The values that each node draws, over the run."""
        for family, (origins, lengths, z) in self._tracks.items():
            drawn = lengths * self._factors[family]
            with np.errstate(invalid="ignore"):
                seen = np.hypot(drawn[..., 0], drawn[..., 1]) >= LEAST_ARROW * self._size
            sizes = np.hypot(lengths[..., 0], lengths[..., 1]) * self._scales.per_metre(family)
            yield ArrowValues(
                f"/vectors/{family}", family, VECTOR_FAMILIES[family].unit, sizes, *_ends(origins, origins + drawn, z, seen)
            )
        for key, (arc, origins, turns) in self._turns.items():
            turn = np.clip(turns * self._factors[key[0]], -LARGEST_TURN, LARGEST_TURN)
            tips = origins + arc.radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
            seen, z = np.abs(turn) >= ARC_TIP, np.array([arc.height])
            ends = _ends(origins[:, None], tips[:, None], z, seen[:, None])
            yield ArrowValues(arc_path(*key), key[0], "N m", np.asarray(arc.moment.value)[:, None], *ends)

    def _color(self, family: str) -> tuple[int, int, int]:
        return VECTOR_FAMILIES[family].on_dark if self._dark else VECTOR_FAMILIES[family].color

    def _add_arrows(self, family: str) -> viser.ArrowsHandle:
        return self._server.scene.add_arrows(
            f"/vectors/{family}",
            np.zeros((1, 2, 3)),
            _linear(self._color(family)),
            shaft_radius=ARROW_SHAFT_RADIUS * self._size,
            head_radius=ARROW_HEAD_RADIUS * self._size,
            head_length=ARROW_HEAD_LENGTH * self._size,
            visible=False,
        )

    def _add_arc(self, family: str, item: str) -> viser.MeshHandle:
        return self._server.scene.add_mesh_simple(
            arc_path(family, item),
            arc_vertices(np.zeros(2), 1.0, ARC_RADIUS * self._size, ARC_WIDTH * self._size, 0.0),
            ARC_FACES,
            color=self._color(family),
            side="double",
            visible=False,
            cast_shadow=False,
            receive_shadow=False,
        )


def arrows_by_family(view_model: ViewModel) -> dict[str, list[Arrow]]:
    """The arrows that share a node, in the order in which they are drawn."""
    families: dict[str, list[Arrow]] = {}
    for arrow in view_model.picture.nodes_of(Arrow):
        families.setdefault(arrow.group, []).append(arrow)
    return families


def arc_path(family: str, item: str) -> str:
    """Name of the node of a moment."""
    return f"/moments/{family}/{item.replace('/', '_')}"


def _linear(color: tuple[int, int, int]) -> tuple[int, int, int]:
    """A colour for viser's arrows: their shader takes it as linear light, that of meshes as a screen colour (gamma 2.2)."""
    red, green, blue = (round(255.0 * (c / 255.0) ** 2.2) for c in color)
    return red, green, blue
