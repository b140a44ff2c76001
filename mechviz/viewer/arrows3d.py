"""Vectors as arrows and moments as arcs with a head, by family, each family with a switch and all with a common size."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import viser
from numpy.typing import NDArray

from ..heights import arc_height, arrow_height
from ..meshes import Heights
from ..run import Run
from ..vectors import FAMILIES, Moment, Scales, Vector

__all__ = ["ArrowNodes", "arc_vertices", "arrow_points"]

Real = NDArray[np.float64]

# In parts of the mechanism's size
SHAFT = 0.0042
HEAD_RADIUS = 0.0115
HEAD_LENGTH = 0.03
ARC_RADIUS = 0.085
ARC_WIDTH = 0.0085

ARC_STEPS = 40
ARC_HEAD = 0.42  # [rad]
LARGEST_TURN = 1.8 * np.pi
ARC_FACES = np.array(
    [f for k in range(ARC_STEPS) for f in ([2 * k, 2 * k + 1, 2 * k + 2], [2 * k + 1, 2 * k + 3, 2 * k + 2])]
    + [[2 * ARC_STEPS + 2, 2 * ARC_STEPS + 3, 2 * ARC_STEPS + 4]],
    np.uint32,
)


def arrow_points(origins: Real, arrows: Real, z: Real | float, least: float) -> NDArray[np.float32]:
    """Ends (n, 2, 3) of those of the arrows (N, 2) [m] from ``origins`` (N, 2) [m] at heights ``z`` (N,) [m] that can be seen.

    viser draws an arrow that is shorter than its head, even one of no length, as a whole head: such arrows are left out.
    """
    with np.errstate(invalid="ignore"):
        visible = np.hypot(arrows[:, 0], arrows[:, 1]) >= least
    visible &= np.isfinite(origins).all(axis=1) & np.isfinite(arrows).all(axis=1)
    start, end = origins[visible], origins[visible] + arrows[visible]
    points = np.empty((len(start), 2, 3), np.float32)
    points[:, 0, :2], points[:, 1, :2] = start, end
    points[:, :, 2] = np.broadcast_to(z, len(visible))[visible, None]
    return points


def arc_vertices(centre: Real, turn: float, radius: float, width: float, z: float) -> NDArray[np.float32]:
    """Corners of a flat arc with a head, for `ARC_FACES`: through ``turn`` [rad] about ``centre`` (2,) [m] from the right on."""
    sign = np.sign(turn)
    head = min(ARC_HEAD, abs(turn))
    along = np.linspace(0.0, sign * (abs(turn) - head), ARC_STEPS + 1)
    rim = np.array([radius + 0.5 * width, radius - 0.5 * width])
    body = (rim * np.exp(1j * along)[:, None]).ravel()
    base = np.array([radius + 1.7 * width, radius - 1.7 * width]) * np.exp(1j * along[-1])
    flat = np.concatenate([body, base, [radius * np.exp(1j * sign * abs(turn))]]) + complex(*centre)
    return np.column_stack([flat.real, flat.imag, np.full(len(flat), z)]).astype(np.float32)


class ArrowNodes:
    """The arrows of all families: ``show`` draws those of a frame, ``switch`` and ``enlarge`` change what and how large."""

    def __init__(
        self,
        server: viser.ViserServer,
        run: Run,
        vectors: Mapping[str, Mapping[str, Vector]],
        moments: Mapping[str, Mapping[str, Moment]],
        scales: Scales,
        heights: Heights,
    ):
        self._server = server
        self._size = size = heights.size
        self._on = {family: False for family in FAMILIES if family in vectors or family in moments}
        self._factor = 1.0
        self._arrows: dict[str, tuple[viser.ArrowsHandle, Real, Real, Real]] = {}
        self._arcs: list[tuple[str, viser.MeshHandle, Real, Real, float]] = []
        for family, items in vectors.items():
            origins = np.stack([v.origin for v in items.values()], axis=1)
            lengths = np.stack([v.value for v in items.values()], axis=1) / scales.per_metre(family)
            z = np.array([arrow_height(run, heights, v, scales.per_metre(family)) for v in items.values()])
            self._arrows[family] = self._add_arrows(family), origins, lengths, z
        for family, found in moments.items():
            for moment in found.values():
                turn = moment.value / scales.newton_metres_per_metre / (ARC_RADIUS * size)
                z_arc = arc_height(run, heights, moment, ARC_RADIUS * size)
                self._arcs.append((family, self._add_arc(family, moment.item), moment.origin, turn, z_arc))

    @property
    def families(self) -> tuple[str, ...]:
        return tuple(self._on)

    def reach(self) -> Real | None:
        """The box (2, 2) [m] around the arrows that are on, over all frames, if there are any."""
        ends = [origins + lengths for family, (_, origins, lengths, _) in self._arrows.items() if self._on[family]]
        flat = np.concatenate([e.reshape(-1, 2) for e in ends]) if ends else np.zeros((0, 2))
        flat = flat[np.isfinite(flat).all(axis=1)]
        return np.array([flat.min(axis=0), flat.max(axis=0)]) if len(flat) else None

    @property
    def factor(self) -> float:
        return self._factor

    def is_on(self, family: str) -> bool:
        return self._on[family]

    def switch(self, family: str, on: bool) -> None:
        """Draw a family from the next ``show`` on, or no more."""
        self._on[family] = on

    def enlarge(self, factor: float) -> None:
        """Draw all arrows longer by a factor from the next ``show`` on."""
        self._factor = factor

    def show(self, frame: int) -> None:
        for family, (node, origins, lengths, z) in self._arrows.items():
            if not self._on[family]:
                node.visible = False
                continue
            least = 1.3 * HEAD_LENGTH * self._size
            points = arrow_points(origins[frame], lengths[frame] * self._factor, z, least)
            node.visible = len(points) > 0
            if len(points):
                node.points = points
        for family, arc, origin, turns, z_arc in self._arcs:
            turn = float(np.clip(turns[frame] * self._factor, -LARGEST_TURN, LARGEST_TURN))
            arc.visible = self._on[family] and abs(turn) >= ARC_HEAD
            if arc.visible:
                arc.vertices = arc_vertices(origin[frame], turn, ARC_RADIUS * self._size, ARC_WIDTH * self._size, z_arc)

    def _add_arrows(self, family: str) -> viser.ArrowsHandle:
        return self._server.scene.add_arrows(
            f"/vectors/{family}",
            np.zeros((1, 2, 3)),
            _linear(FAMILIES[family].color),
            shaft_radius=SHAFT * self._size,
            head_radius=HEAD_RADIUS * self._size,
            head_length=HEAD_LENGTH * self._size,
            visible=False,
        )

    def _add_arc(self, family: str, item: str) -> viser.MeshHandle:
        return self._server.scene.add_mesh_simple(
            f"/moments/{family}/{item.replace('/', '_')}",
            arc_vertices(np.zeros(2), 1.0, ARC_RADIUS * self._size, ARC_WIDTH * self._size, 0.0),
            ARC_FACES,
            color=FAMILIES[family].color,
            side="double",
            visible=False,
            cast_shadow=False,
            receive_shadow=False,
        )


def _linear(color: tuple[int, int, int]) -> tuple[int, int, int]:
    """A colour for viser's arrows: their shader takes it as light, where that of meshes takes it as a screen colour (gamma 2.2)."""
    red, green, blue = (round(255.0 * (c / 255.0) ** 2.2) for c in color)
    return red, green, blue
