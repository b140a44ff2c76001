"""Lines that deform with the motion: dampers, gas springs and torsion springs, friction circles with lines of action."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import viser

from mechcore.arrays import Single
from mechviz.outputs.viewer.playback import PointTrack
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.picture.nodes import Lines
from mechviz.picture.proportions import LINKER
from mechviz.quantities.vectors import FAMILIES

INKS = {"springs": (LINKER, (176, 188, 204)), "friction": (FAMILIES["friction"].color, (255, 214, 92))}
"""Colours of groups on a light and on a dark page."""
WIDTHS = {"springs": 3.0, "friction": 1.8}  # [px]


def segments(node: Lines, frame: int) -> Single:
    """Lines (n, 2, 3) [m] between the places of all strips at a frame."""
    strips = (strip[min(frame, len(strip) - 1)] for strip in node.strips)
    return np.concatenate([np.stack([strip[:-1], strip[1:]], axis=1) for strip in strips])


class LineNodes:
    """The lines of some groups; ``show`` bends them to a frame, ``update`` takes those of another run."""

    def __init__(self, server: viser.ViserServer, show: ViewModel):
        self._server = server
        self._on, self._dark = dict.fromkeys(INKS, True), False
        self._nodes: dict[str, viser.LineSegmentsHandle] = {}
        self._lines: dict[str, Lines] = {}
        self.update(show)

    @property
    def groups(self) -> frozenset[str]:
        """Groups of which there is anything to draw."""
        return frozenset(lines.group for lines in self._lines.values())

    def update(self, show: ViewModel) -> None:
        self._lines = {_path(lines.key): lines for lines in show.picture.of(Lines, *INKS)}
        for path, lines in self._lines.items():
            if path not in self._nodes:
                color, width = INKS[lines.group][self._dark], WIDTHS[lines.group]
                first = np.nan_to_num(segments(lines, 0))
                self._nodes[path] = self._server.scene.add_line_segments(
                    path, first, color, thickness=width, thickness_units="screen", visible=self._on[lines.group]
                )
        for path, node in self._nodes.items():
            node.visible = path in self._lines and self._on[self._lines[path].group]

    def switch(self, group: str, on: bool) -> None:
        """Draw a group, or no more."""
        self._on[group] = on
        for path, lines in self._lines.items():
            if lines.group == group:
                self._nodes[path].visible = on

    def darken(self, dark: bool) -> None:
        """Take the colours for a dark page or for a light one."""
        self._dark = dark
        for path, lines in self._lines.items():
            self._nodes[path].colors = np.array(INKS[lines.group][dark], np.uint8)

    def show(self, frame: int) -> None:
        for path, lines in self._lines.items():
            if self._on[lines.group]:
                node, there = self._nodes[path], lines.shown is None or bool(lines.shown[min(frame, len(lines.shown) - 1)])
                node.visible = there
                if there:
                    node.points = segments(lines, frame)

    def tracks(self, frames: int) -> Iterator[PointTrack]:
        """How all lines move over the run, if they are on."""
        for path, lines in self._lines.items():
            if self._on[lines.group] and lines.moves:
                flat = [np.stack([s[:, :-1], s[:, 1:]], axis=2).reshape(frames, -1) for s in lines.strips]
                values = np.concatenate(flat, axis=1)
                counts = np.full(frames, values.shape[1])
                there = np.ones(frames, bool) if lines.shown is None else lines.shown
                yield PointTrack(path, "points", np.nan_to_num(values), np.where(there, counts, 0))


def _path(key: str) -> str:
    return f"/lines/{key.replace('/', '_')}"
