"""The tab of synthesis: four-bars for positions of a body that are placed with the mouse, or for a curve that is drawn with it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import viser

from mechcore.arrays import Complex
from mechcore.design.burmester import BodyPositions
from mechcore.design.paths import PathDesign
from mechcore.errors import Fault, MechanismError
from mechcore.spec.mechanism import Mechanism, Revolute
from mechviz.editor.history import Draft
from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.server import Callback
from mechviz.outputs.viewer.session import EditSession
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.scene.units import Units
from mechviz.studies.synthesis.four_bars import MotionDesign, motion_choices, motion_solutions, poses_in
from mechviz.studies.synthesis.paths import MOST_OFFERED, drawn_points, path_choices, path_in, path_solutions

DRAWN_COLOR = (217, 119, 6)  # colour of the curve that was drawn
SHEET_SIZE = 3.0  # of the mechanism's size: side of the sheet on which the curve is drawn
SHEET_OPACITY = 0.12  # its opacity
Release = Callable[[viser.ClientHandle], None]


def is_four_bar(mechanism: Mechanism) -> bool:
    """Whether a mechanism is a single four-bar with revolute joints, which synthesis can replace by another one."""
    joints = mechanism.joints
    return len(mechanism.links) == 4 and len(joints) == 4 and all(isinstance(joint, Revolute) for joint in joints)


class SynthesisTab:
    """Positions and a path in one tab; a solution replaces the four-bar, as an edit that can be undone."""

    def __init__(
        self, server: viser.ViserServer, tab: viser.GuiTabHandle, session: EditSession, callback: Callback, release: Release
    ):
        with tab:
            server.gui.add_html(words.hint("What is found takes the place of this four-bar. Undo brings it back."))
            self.positions = Positions(server, server.gui.add_folder("Positions"), session, callback)
            self.drawing = CurveSketch(server, server.gui.add_folder("Path"), session, callback, release)

    def update(self, view_model: ViewModel) -> None:
        """Take the positions and the path of another run."""
        self.positions.update(view_model)
        self.drawing.update(view_model)


def solution_rows(choices: Iterable[str]) -> str:
    """Solutions by their numbers, in one line."""
    return "; ".join(f"{k}: {one}" for k, one in enumerate(choices, 1))


def set_content(node: viser.GuiHtmlHandle, content: str) -> None:
    """Set the content of a text, unless it is the same."""
    if node.content != content:
        node.content = content


# -- positions --------------------------------------------------------------------------------------------------------
FEWEST_POSITIONS, MOST_POSITIONS = 2, 5


def with_moved_pose(poses: BodyPositions, k: int, place: complex, angle: float) -> BodyPositions:
    """Poses with number ``k`` replaced."""
    places, angles = poses.places.copy(), poses.angles.copy()
    places[k], angles[k] = place, angle
    return BodyPositions(places, angles)


def lengthened(poses: BodyPositions) -> BodyPositions:
    """Poses with one more, about as far beyond the last as that is from the one before. Raises `MechanismError` if there are
    `MOST_POSITIONS` already."""
    if len(poses.places) >= MOST_POSITIONS:
        raise MechanismError(
            Fault("positions", f"{MOST_POSITIONS} positions leave no four-bar to choose.", "Take one away, or move one.")
        )
    step = poses.places[-1] - poses.places[-2]
    turn = float(np.angle(poses.turns[-1] / poses.turns[-2]))
    place = poses.places[-1] + 0.8 * step * np.exp(0.5j * turn)  # off the line of the others, which has few solutions
    return BodyPositions(np.append(poses.places, place), np.append(poses.angles, poses.angles[-1] + 0.8 * turn))


def shortened(poses: BodyPositions) -> BodyPositions:
    """Poses without the last one. Raises `MechanismError` if there are only two."""
    if len(poses.places) <= FEWEST_POSITIONS:
        raise MechanismError(Fault("positions", "two positions are the fewest.", "Move them instead."))
    return BodyPositions(poses.places[:-1], poses.angles[:-1])


def same_poses(one: BodyPositions, other: BodyPositions) -> bool:
    """Whether poses agree, up to the rounding of a scene's unit."""
    if len(one.places) != len(other.places):
        return False
    away = np.abs(one.places - other.places) / one.reach, np.abs(one.turns - other.turns)
    return bool(max(part.max() for part in away) < 1e-9)


def _poses(session: EditSession) -> BodyPositions:
    """The poses for which a scene was synthesized; otherwise three poses of the coupler in the first quarter of the run."""
    scene, mechanism = session.run.scene, session.run.scene.mechanism
    given = poses_in(scene)
    if given is not None:
        return given
    beside = {link for joint in mechanism.joints if mechanism.frame in joint.links for link in joint.links}
    coupler = next(link for link in mechanism.links if link.name not in beside)
    frames = np.linspace(0, (len(session.run.motion.time) - 1) // 4, 3).astype(int)
    x, y, angle = session.run.motion.pose(coupler.name)[frames].T
    traced = next((complex(*coupler.points[point]) for link, point in mechanism.traced if link == coupler.name), 0j)
    return BodyPositions(x + 1j * y + traced * np.exp(1j * angle), angle)


class Positions:
    """Handles on the positions, shown while the checkbox is on; a slider that chooses among the four-bars."""

    def __init__(self, server: viser.ViserServer, folder: viser.GuiFolderHandle, session: EditSession, callback: Callback):
        self._server, self._session, self._callback = server, session, callback
        self._nodes: list[Any] = []
        self._placing = threading.Lock()  # handles are placed by the session and by the checkbox
        self._held = -1
        self._found: tuple[BodyPositions | None, list[MotionDesign]] = None, []
        self.poses = _poses(session)
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
            self.report = gui.add_html("")
        self.on.on_update(callback("Showing positions", lambda _: self._place(self._session.view_model)))
        self.choice.on_update(callback("Choosing a four-bar", lambda _: self.ask("solution", self.poses)))
        more.on_click(callback("Adding a position", lambda _: self.ask("one more", lengthened(self.poses))))
        fewer.on_click(callback("Removing a position", lambda _: self.ask("one fewer", shortened(self.poses))))

    def update(self, view_model: ViewModel) -> None:
        """Take the positions of another run."""
        self.poses = _poses(self._session)
        self._place(view_model)
        self._explain()

    def drafted(self, draft: Draft, poses: BodyPositions, choice: int) -> Draft:
        """A draft of four-bar number ``choice`` (1: the best) for poses. Raises `MechanismError` if there is none."""
        choices = motion_choices(poses)
        self._found = poses, choices
        made = choices[min(max(choice, 1), len(choices)) - 1]
        return replace(draft, document=motion_solutions(poses, [made])[0].scene.document)

    def ask(self, what: str, poses: BodyPositions) -> None:
        """Request the four-bar for other positions; ``what`` names the change, so that a drag is one step of undo."""
        self._session.change(f"positions: {what}", partial(self.drafted, poses=poses, choice=int(self.choice.value)))

    def _explain(self) -> None:
        """List the four-bars that were found for the positions of the scene: none for others, as after an undo."""
        poses, choices = self._found
        known = poses is not None and same_poses(poses, self.poses)
        units = self._session.view_model.units
        listed = solution_rows(one.defects or units.text(one.transmission, "rad", 2) for one in choices if known)
        set_content(self.report, words.hint(f"Least transmission angle, or defects, of each solution. {listed}") if listed else "")

    def _place(self, view_model: ViewModel) -> None:
        """Move a handle to each position, except for the one being dragged."""
        with self._placing:
            self._placed(view_model)

    def _placed(self, view_model: ViewModel) -> None:
        wanted = len(self.poses.places) if self.on.value else 0
        while len(self._nodes) > wanted:
            self._nodes.pop().remove()
        for k in range(wanted):
            place, angle = self.poses.places[k], float(self.poses.angles[k])
            position = (float(place.real), float(place.imag), view_model.z_top)
            turned = (float(np.cos(angle / 2.0)), 0.0, 0.0, float(np.sin(angle / 2.0)))
            if k == len(self._nodes):
                node = self._server.scene.add_transform_controls(
                    f"/positions/{k + 1}", scale=0.14 * view_model.size, active_axes=(True, True, False), depth_test=False,
                    position=position, wxyz=turned,
                )  # fmt: skip
                self._server.scene.add_label(f"/positions/{k + 1}/number", str(k + 1))
                node.on_update(self._callback(f"Moving position {k + 1}", partial(self._dragged, k)))
                self._nodes.append(node)
            elif k != self._held:
                self._nodes[k].position, self._nodes[k].wxyz = position, turned

    def _dragged(self, k: int, event: viser.TransformControlsEvent) -> None:
        """Request a four-bar when the handle is released: until then the picture stays unchanged under the mouse."""
        self._held = k if event.phase != "end" else -1
        x, y, _ = (float(v) for v in event.target.position)
        w, _, _, z = (float(v) for v in event.target.wxyz)
        if self._held < 0 and np.isfinite([x, y, w, z]).all() and k < len(self.poses.places):
            self.ask(f"number {k + 1}", with_moved_pose(self.poses, k, complex(x, y), 2.0 * float(np.arctan2(z, w))))


# -- paths ------------------------------------------------------------------------------------------------------------
class CurveSketch:
    """A curve that is drawn with the mouse on a sheet in front of the mechanism, and a slider that chooses among the four-bars that
    follow it. ``release(client)`` is called for the browser in which a curve was drawn: its view is then fitted to the four-bar."""

    def __init__(
        self, server: viser.ViserServer, folder: viser.GuiFolderHandle, session: EditSession, callback: Callback, release: Release
    ):
        self._server, self._session, self._callback, self._release = server, session, callback, release
        self._sheet: Any = None
        self._line: Any = None
        self._under = (0.0, 0.0)  # size and height of the mechanism for which the sheet was made
        self._stroke: list[complex] = []
        self._designs: tuple[Complex, list[PathDesign]] = (np.zeros(0, complex), [])
        gui = server.gui
        with folder:
            gui.add_html(
                words.hint(
                    "Tick the box and draw a curve on the sheet, the mouse button held down. One that ends near its beginning is "
                    "closed. The four-bars whose coupler point E draws it are found anew; that takes some seconds."
                )
            )
            self.on = gui.add_checkbox("Draw a curve", False)
            self.choice = gui.add_slider("Four-bar", 1, MOST_OFFERED, 1, 1, hint="1 is nearest to the curve")
            self.report = gui.add_html("")
        self.on.on_update(callback("Drawing", lambda _: self._place(self._session.view_model)))
        self.choice.on_update(callback("Choosing a four-bar", lambda _: self._choose()))

    @property
    def wanted(self) -> Complex:
        """The curve (K,) [m] for which the scene was synthesized, empty if there is none."""
        points = path_in(self._session.run.scene)
        return np.zeros(0, complex) if points is None else points

    def update(self, view_model: ViewModel) -> None:
        """Take the curve of another run."""
        self._stroke = []
        self._place(view_model)
        listed = self._designs[1] if self._known(self.wanted) else []
        lines = solution_rows(_quality(one, view_model.units) for one in listed)
        set_content(
            self.report, words.hint(f"Distance (root mean square) and least transmission angle of each. {lines}") if lines else ""
        )

    def drafted(self, draft: Draft, points: Complex, choice: int) -> Draft:
        """A draft of four-bar number ``choice`` (1: the best) for points (K,) [m]. Raises `MechanismError` if there is none."""
        if not self._known(points):
            self._designs = (points, path_choices(points))
        made = self._designs[1][min(max(choice, 1), len(self._designs[1])) - 1]
        return replace(draft, document=path_solutions([made], points)[0].scene.document)

    def ask(self, points: Complex) -> None:
        """Request a four-bar whose coupler point passes through points (K,) [m]."""
        self._session.change("path", partial(self.drafted, points=points, choice=int(self.choice.value)))

    def _known(self, points: Complex) -> bool:
        """Whether four-bars have been found for points (K,) [m], up to the rounding of the scene's unit."""
        return len(points) == len(self._designs[0]) and np.allclose(points, self._designs[0], rtol=1e-9, atol=0.0)

    def _choose(self) -> None:
        if len(self.wanted):
            self.ask(self.wanted)

    def _place(self, view_model: ViewModel) -> None:
        """Show or remove the sheet and the curve of the scene."""
        if self._sheet is not None and not (self.on.value and self._under == (view_model.size, view_model.z_top)):
            self._sheet.remove()
            self._sheet = None
        if self.on.value and self._sheet is None:
            self._under = view_model.size, view_model.z_top
            half = 0.5 * SHEET_SIZE * view_model.size
            (x, y), z = view_model.bounds[:, :2].mean(axis=0), view_model.z_top
            corners = np.array([[x - half, y - half, z], [x + half, y - half, z], [x + half, y + half, z], [x - half, y + half, z]])
            self._sheet = self._server.scene.add_mesh_simple(
                "/path/sheet", corners, np.array([[0, 1, 2], [0, 2, 3]]), color=DRAWN_COLOR, opacity=SHEET_OPACITY, side="double",
                cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
            self._sheet.on_drag("left")(self._callback("Drawing", self._drawn))
        self._trace(self.wanted if self.on.value else np.zeros(0, complex))

    def _trace(self, points: Complex) -> None:
        """Draw the curve through points, or none."""
        if len(points) < 2:
            if self._line is not None:
                self._line.remove()
                self._line = None
            return
        xyz = np.stack([points.real, points.imag, np.full(len(points), self._session.view_model.z_top)], axis=1)
        segments = np.stack([xyz[:-1], xyz[1:]], axis=1)
        if self._line is None:
            self._line = self._server.scene.add_line_segments(
                "/path/wanted", segments, DRAWN_COLOR, thickness=2.5, thickness_units="screen"
            )
        else:
            self._line.points = segments

    def _drawn(self, event: viser.ScenePointerEvent) -> None:
        """Extend the curve to the mouse; when the button is released, search for four-bars."""
        if event.phase == "start":
            self._stroke = [complex(*event.start_position[:2])]
        end = sheet_place(event.client.camera.position, event.end_position, float(event.start_position[2]))
        if end is not None and (not self._stroke or end != self._stroke[-1]):
            self._stroke.append(end)
        self._trace(np.array(self._stroke))
        if event.phase == "end":
            points = drawn_points(np.array(self._stroke))
            set_content(self.report, words.hint("Looking for four-bars ..."))
            self._release(event.client)
            self.ask(points)


def _quality(made: PathDesign, units: Units) -> str:
    """Text of the root mean square distance and the least transmission angle of a four-bar."""
    distance, angle = np.sqrt(made.error / len(made.theta)), made.four_bar.least_transmission()
    return f"{units.text(distance, 'm', 3)}, {units.text(angle, 'rad', 2)}"


def sheet_place(eye: object, seen: object, height: float) -> complex | None:
    """The point x + iy [m] where the line from ``eye`` through ``seen`` [m] meets the plane z = ``height`` [m]; None if it does
    not."""
    start, along = np.asarray(eye, float), np.asarray(seen, float) - np.asarray(eye, float)
    with np.errstate(all="ignore"):
        x, y, _ = start + along * (height - start[2]) / along[2]
    return complex(x, y) if np.isfinite([x, y]).all() else None
