"""Marks on the mechanism: paths of traced points with a dot at the present place, and the names of joints."""

from __future__ import annotations

import numpy as np
import viser
from numpy.typing import NDArray

from mechcore import Motion

from ..heights import path_height
from ..meshes import Heights
from ..run import Run

__all__ = ["PATH", "JointNames", "Paths", "joint_groups"]

Real = NDArray[np.float64]

PATH = (32, 78, 138)  # colour of paths


class Paths:
    """Paths of the traced points over the run, each on the front of its link."""

    def __init__(self, server: viser.ViserServer, run: Run, heights: Heights):
        motion, size = run.motion, heights.size
        self._lines: list[viser.LineSegmentsHandle] = []
        self._dots: list[tuple[viser.IcosphereHandle, Real]] = []
        for link, point in motion.mechanism.traced:
            name = f"/paths/{link.replace('/', '_')}.{point.replace('/', '_')}"
            xyz = np.column_stack([motion.point(link, point), np.full(motion.frames, path_height(run, heights, link, point))])
            segments = np.stack([xyz[:-1], xyz[1:]], axis=1)
            if len(segments):
                line = server.scene.add_line_segments(name, segments, PATH, thickness=2.5, thickness_units="screen")
                self._lines.append(line)
            dot = server.scene.add_icosphere(f"{name}/now", 0.009 * size, color=PATH, cast_shadow=False, receive_shadow=False)
            self._dots.append((dot, xyz))

    def __len__(self) -> int:
        return len(self._dots)

    def switch(self, on: bool) -> None:
        for node in [*self._lines, *(dot for dot, _ in self._dots)]:
            node.visible = on

    def show(self, frame: int) -> None:
        for dot, xyz in self._dots:
            dot.position = xyz[frame]


class JointNames:
    """The names of the joints beside them, driven ones marked; joints that stay at one place share a label."""

    def __init__(self, server: viser.ViserServer, motion: Motion, size: float, z: float):
        offset = 0.022 * size
        self._labels: list[tuple[viser.LabelHandle, Real]] = []
        driven = {drive.pair for drive in motion.mechanism.drives}
        for k, (names, xy) in enumerate(joint_groups(motion, 1e-6 * size)):
            text = ", ".join(f"{name} (drive)" if name in driven else name for name in names)
            xyz = np.column_stack([xy + offset, np.full(motion.frames, z)])
            label = server.scene.add_label(f"/names/{k}", text, anchor="bottom-left", font_screen_scale=1.0)
            self._labels.append((label, xyz))

    def switch(self, on: bool) -> None:
        for label, _ in self._labels:
            label.visible = on

    def show(self, frame: int) -> None:
        for label, xyz in self._labels:
            label.position = xyz[frame]


def joint_groups(motion: Motion, near: float) -> list[tuple[list[str], Real]]:
    """Names of pairs that lie within ``near`` [m] of each other in all frames, with their places (F, 2) [m]."""
    groups: list[tuple[list[str], Real]] = []
    for pair in motion.mechanism.pairs:
        xy = motion.pair_position(pair.name)
        for names, other in groups:
            if np.abs(xy - other).max(initial=0.0) <= near:
                names.append(pair.name)
                break
        else:
            groups.append(([pair.name], xy))
    return groups
