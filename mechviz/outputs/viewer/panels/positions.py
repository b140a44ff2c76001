"""Positions: a body's positions are placed with the mouse, and the four-bars that lead it through them found."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import viser

from mechcore.design.burmester import Poses
from mechcore.errors import Fault, MechanismError
from mechviz.editor.history import Draft
from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.server import Callback
from mechviz.outputs.viewer.session import EditSession
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.studies.synthesis.four_bars import MotionDesign, motion_choices, motion_solutions, poses_in

FEWEST, MOST = 2, 5


def moved(poses: Poses, k: int, place: complex, angle: float) -> Poses:
    """Poses of which one is elsewhere."""
    places, angles = poses.places.copy(), poses.angles.copy()
    places[k], angles[k] = place, angle
    return Poses(places, angles)


def lengthened(poses: Poses) -> Poses:
    """Poses with one more, about as far behind the last as that is behind the one before. Raises `MechanismError` at the most."""
    if len(poses.places) >= MOST:
        raise MechanismError(Fault("positions", f"{MOST} positions leave no four-bar to choose.", "Take one away, or move one."))
    step = poses.places[-1] - poses.places[-2]
    turn = float(np.angle(poses.turns[-1] / poses.turns[-2]))
    place = poses.places[-1] + 0.8 * step * np.exp(0.5j * turn)  # not in line with the others: that leaves little to choose from
    return Poses(np.append(poses.places, place), np.append(poses.angles, poses.angles[-1] + 0.8 * turn))


def shortened(poses: Poses) -> Poses:
    """Poses without the last. Raises `MechanismError` where two are left."""
    if len(poses.places) <= FEWEST:
        raise MechanismError(Fault("positions", "two positions are the fewest.", "Move them instead."))
    return Poses(poses.places[:-1], poses.angles[:-1])


class Positions:
    """Handles on the positions, shown while the box is ticked; a number that chooses among the four-bars."""

    def __init__(self, server: viser.ViserServer, folder: viser.GuiFolderHandle, session: EditSession, callback: Callback):
        self._server, self._session, self._callback = server, session, callback
        self._nodes: list[Any] = []
        self._held = -1
        self._found: list[MotionDesign] = []
        poses = poses_in(session.run.scene)
        assert poses is not None
        self.poses = poses
        gui = server.gui
        with folder:
            gui.add_html(
                words.hint("Drag and turn the positions of the body. The four-bars that lead it through them are found anew.")
            )
            self.on = gui.add_checkbox("Show the positions", False)
            self.choice = gui.add_slider(
                "Solution", 1, 12, 1, 1, hint="1 transmits best; defects of branch, circuit or order come last"
            )
            more = gui.add_button("Add a position", icon=viser.Icon.PLUS)
            fewer = gui.add_button("Remove the last position", icon=viser.Icon.MINUS)
            self.told = gui.add_html("")
        self.on.on_update(callback("Showing positions", lambda _: self._place(self._session.show)))
        self.choice.on_update(callback("Choosing a four-bar", lambda _: self.ask("solution", self.poses)))
        more.on_click(callback("Adding a position", lambda _: self.ask("one more", lengthened(self.poses))))
        fewer.on_click(callback("Removing a position", lambda _: self.ask("one fewer", shortened(self.poses))))

    def update(self, show: ViewModel) -> None:
        """Take the positions of another run."""
        poses = poses_in(self._session.run.scene)
        if poses is not None:
            self.poses = poses
        self._place(show)
        self._explain()

    def drafted(self, draft: Draft, poses: Poses, choice: int) -> Draft:
        """A draft of the four-bar of a number (1: the best) for poses. Raises `MechanismError` where there is none."""
        found = motion_choices(poses)
        self._found = found
        made = found[min(max(choice, 1), len(found)) - 1]
        return replace(draft, document=motion_solutions(poses, [made])[0].scene.document)

    def ask(self, what: str, poses: Poses) -> None:
        """Have the four-bar of other positions shown; ``what`` is changed, so that a drag becomes one step to undo."""
        self._session.change(f"positions: {what}", partial(self.drafted, poses=poses, choice=int(self.choice.value)))

    def _explain(self) -> None:
        """Say which four-bars there are."""
        rows = [f"{k}: {one.defects or f'{np.degrees(one.transmission):.0f}°'}" for k, one in enumerate(self._found, 1)]
        content = words.hint("Least transmission angle, or defects, of each solution. " + "; ".join(rows)) if rows else ""
        if self.told.content != content:
            self.told.content = content

    def _place(self, show: ViewModel) -> None:
        """Put a handle on each position, except for the one that is held."""
        wanted = len(self.poses.places) if self.on.value else 0
        while len(self._nodes) > wanted:
            self._nodes.pop().remove()
        for k in range(wanted):
            place, angle = self.poses.places[k], float(self.poses.angles[k])
            position = (float(place.real), float(place.imag), show.z_top)
            turned = (float(np.cos(angle / 2.0)), 0.0, 0.0, float(np.sin(angle / 2.0)))
            if k == len(self._nodes):
                node = self._server.scene.add_transform_controls(
                    f"/positions/{k + 1}", scale=0.14 * show.size, active_axes=(True, True, False), depth_test=False,
                    position=position, wxyz=turned,
                )  # fmt: skip
                self._server.scene.add_label(f"/positions/{k + 1}/number", str(k + 1))
                node.on_update(self._callback(f"Moving position {k + 1}", partial(self._dragged, k)))
                self._nodes.append(node)
            elif k != self._held:
                self._nodes[k].position, self._nodes[k].wxyz = position, turned

    def _dragged(self, k: int, event: Any) -> None:
        """The four-bar follows when the handle is let go: until then the picture under the mouse stays as it is."""
        self._held = k if event.phase != "end" else -1
        x, y, _ = (float(v) for v in event.target.position)
        w, _, _, z = (float(v) for v in event.target.wxyz)
        if self._held < 0 and np.isfinite([x, y, w, z]).all() and k < len(self.poses.places):
            self.ask(f"number {k + 1}", moved(self.poses, k, complex(x, y), 2.0 * float(np.arctan2(z, w))))
