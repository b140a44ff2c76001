"""Marks on the mechanism: paths of traced points, joints with their names, point masses; and names at the pointer."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import viser

from mechcore.arrays import Real, Single
from mechviz.outputs.viewer.playback import base64_of
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.outputs.viewer.viser_adapter import NodePose, run_script
from mechviz.outputs.viewer.world.arrows import ArrowNodes, arc_path, arrows_by_family
from mechviz.outputs.viewer.world.labels import LABEL_ANCHORS, corners, half_sizes
from mechviz.outputs.viewer.world.solids import link_path
from mechviz.picture.nodes import MomentArc, Points
from mechviz.quantities.numbers import usual_size
from mechviz.quantities.vectors import VECTOR_FAMILIES

PATH_COLORS = {False: (32, 78, 138), True: (122, 178, 242)}  # light, dark: colour of paths
PICKED_COLOR = (194, 37, 92)  # colour of the selected joint
DOT_RADIUS = 0.0085  # radius of a joint's dot, in sizes of the mechanism: small, but large enough to click on

NAME_DISTANCE = 0.018  # from a joint to its name, in sizes of the mechanism
MECHANISM_PIXELS = 600.0  # assumed size of the mechanism on the screen [px], which determines the size of names beside it


def path_segments(places: Real) -> Single:
    """The line segments (F - 1, 2, 3) [m] between successive points (F, 3) [m]."""
    return np.stack([places[:-1], places[1:]], axis=1).astype(np.float32)


class Paths:
    """Paths of the traced points over the run, each on the front of its link."""

    def __init__(self, server: viser.ViserServer, view_model: ViewModel):
        self._server = server
        self._on, self._dark = True, False
        self._lines: dict[str, viser.LineSegmentsHandle] = {}
        self._dots: dict[str, viser.IcosphereHandle] = {}
        self._places: Mapping[str, Real] = {}
        self.update(view_model)

    def __len__(self) -> int:
        return len(self._places)

    def update(self, view_model: ViewModel) -> None:
        for name, xyz in view_model.paths.items():
            lines = path_segments(xyz)
            if not len(lines):
                continue
            if name not in self._lines:
                self._lines[name] = self._server.scene.add_line_segments(
                    _path(name), lines, PATH_COLORS[self._dark], thickness=2.5, thickness_units="screen", visible=self._on
                )
                self._dots[name] = self._server.scene.add_icosphere(
                    dot_path(name), 0.009 * view_model.size, color=PATH_COLORS[self._dark], cast_shadow=False, receive_shadow=False
                )
            elif name not in self._places or not np.array_equal(self._places[name], xyz):
                self._lines[name].points = lines
        self._places = {name: xyz for name, xyz in view_model.paths.items() if name in self._lines}
        self.switch(self._on)

    def darken(self, dark: bool) -> None:
        """Use the colours for a dark or a light page."""
        self._dark = dark
        for line in self._lines.values():
            line.colors = np.array(PATH_COLORS[dark], np.uint8)
        for dot in self._dots.values():
            dot.color = PATH_COLORS[dark]

    def switch(self, on: bool) -> None:
        self._on = on
        for nodes in (self._lines, self._dots):
            for name, node in nodes.items():
                node.visible = on and name in self._places

    def poses(self, frame: int) -> Iterator[NodePose]:
        """Positions of the dots at a frame."""
        for name, xyz in self._places.items():
            yield self._dots[name], xyz[frame], None

    def tracks(self) -> dict[str, tuple[Real, None]]:
        """By name of the node: positions (F, 3) over the frames."""
        return {dot_path(name): (xyz, None) for name, xyz in self._places.items()}


class JointMarks:
    """A clickable dot at every joint, with its name, driven joints marked.

    Joints that coincide in all frames share a dot and a label. ``clicked(names, event)`` is called on a click on a dot.
    """

    def __init__(
        self, server: viser.ViserServer, view_model: ViewModel, clicked: Callable[[tuple[str, ...], Any], None] | None = None
    ):
        self._server, self._clicked = server, clicked
        self._on = True
        self._groups: list[tuple[tuple[str, ...], Real]] = []
        self._labels: dict[tuple[str, ...], viser.LabelHandle] = {}
        self._dots: dict[tuple[str, ...], viser.IcosphereHandle] = {}
        self._names: dict[tuple[str, ...], str] = {}
        self._picked: frozenset[str] = frozenset()
        self._corners: dict[tuple[str, ...], tuple[int, int]] = {}
        self.update(view_model)

    def update(self, view_model: ViewModel) -> None:
        self._size = view_model.size
        driven = {drive.name for drive in view_model.drives}
        self._groups = [(tuple(names), places) for names, places in joint_groups(view_model.joints, 1e-6 * view_model.size)]
        texts = {key: ", ".join(f"{name} (drive)" if name in driven else name for name in key) for key, _ in self._groups}
        if texts.keys() != self._corners.keys():  # otherwise names keep their corners: none jumps while a slider is dragged
            places = np.array([xyz[:, 0] + 1j * xyz[:, 1] for _, xyz in self._groups])
            sides = (
                corners(
                    places, half_sizes(list(texts.values()), view_model.size / MECHANISM_PIXELS), NAME_DISTANCE * view_model.size
                )
                if texts
                else []
            )
            self._corners = dict(zip(texts, sides, strict=True))
            for key in [key for key in self._labels if key not in texts]:
                self._labels.pop(key).remove()
                self._dots.pop(key).remove()
        for key, text in texts.items():
            anchor: Any = LABEL_ANCHORS[self._corners[key]]
            if key not in self._labels:
                path = self._names[key] = joint_path(key)
                self._labels[key] = self._server.scene.add_label(
                    f"{path}/name", text, anchor=anchor, font_screen_scale=1.0, visible=self._on
                )
                self._dots[key] = self._add_dot(key)
            elif self._labels[key].anchor != anchor:
                self._labels[key].anchor = anchor

    def switch(self, on: bool) -> None:
        """Show or hide the names beside the joints."""
        self._on = on
        for label in self._labels.values():
            label.visible = on

    def pick(self, names: Iterable[str]) -> None:
        """Mark joints as selected, by their colour."""
        self._picked = frozenset(names)
        for key in self._dots:
            color = PICKED_COLOR if self._picked & set(key) else (236, 239, 243)
            if tuple(self._dots[key].color) != color:
                self._dots[key].color = color

    def poses(self, frame: int) -> Iterator[NodePose]:
        """Positions of the dots at a frame, and of the names if they are shown."""
        for key, xyz in self._groups:
            yield self._dots[key], xyz[frame], None
            if self._on:
                yield self._labels[key], xyz[frame] + self._beside(key), None

    def tracks(self) -> dict[str, tuple[Real, None]]:
        """By name of the node: positions (F, 3) over the frames."""
        places: dict[str, tuple[Real, None]] = {}
        for key, xyz in self._groups:
            places[f"{self._names[key]}/dot"] = (xyz, None)
            places[f"{self._names[key]}/name"] = (xyz + self._beside(key), None)
        return places

    def _beside(self, key: tuple[str, ...]) -> Real:
        """Offset (3,) [m] from a joint to its name, without a difference in height."""
        return NAME_DISTANCE * self._size * np.array([*self._corners[key], 0.0])

    def _add_dot(self, key: tuple[str, ...]) -> viser.IcosphereHandle:
        color = PICKED_COLOR if self._picked & set(key) else (236, 239, 243)
        dot = self._server.scene.add_icosphere(
            f"{self._names[key]}/dot", DOT_RADIUS * self._size, color=color, cast_shadow=False, receive_shadow=False
        )
        clicked = self._clicked
        if clicked is not None:

            async def hit(event: viser.SceneNodePointerEvent[viser.IcosphereHandle]) -> None:
                clicked(key, event)

            dot.on_click(hit)
        return dot


def joint_groups(joints: Mapping[str, Real], near: float) -> list[tuple[list[str], Real]]:
    """Groups of joints whose x and y differ by at most ``near`` [m] from those of the group in all frames: their names, and
    positions (F, 3) [m], the maximum of each coordinate."""
    groups: list[tuple[list[str], Real]] = []
    for name, places in joints.items():
        for k, (names, other) in enumerate(groups):
            if np.abs(places[:, :2] - other[:, :2]).max(initial=0.0) <= near:
                names.append(name)
                groups[k] = names, np.maximum(places, other)
                break
        else:
            groups.append(([name], places))
    return groups


class Masses:
    """Balls for point masses, as children of the nodes of their links, labelled with their masses."""

    def __init__(self, server: viser.ViserServer, view_model: ViewModel):
        self._server = server
        self._on = True
        self._nodes: list[Any] = []
        self._drawn: list[Points] = []
        self.update(view_model)

    def __len__(self) -> int:
        return len(self._nodes)

    def update(self, view_model: ViewModel) -> None:
        wanted = list(view_model.picture.nodes_of(Points, "masses"))
        if [_weights(node) for node in wanted] == [_weights(node) for node in self._drawn]:
            return
        for old in reversed(self._nodes):  # labels before their balls, with which they would go
            old.remove()
        self._drawn, self._nodes, scene = wanted, [], self._server.scene
        for node in wanted:
            for k, (place, radius, label) in enumerate(zip(node.places[0], node.radii, node.labels, strict=True)):
                path = f"{link_path(node.parent)}/mass_{k}"
                at = (float(place[0]), float(place[1]), float(place[2]))
                ball = scene.add_icosphere(
                    path, radius, color=node.colors[0], position=at, visible=self._on, cast_shadow=False, receive_shadow=False
                )
                self._nodes += [ball, scene.add_label(f"{path}/weight", label, visible=self._on)]

    def switch(self, on: bool) -> None:
        """Show or hide the masses."""
        self._on = on
        for node in self._nodes:
            node.visible = on


def _weights(node: Points) -> Any:
    return node.key, node.places.tolist(), node.radii, node.labels


def joint_path(names: Iterable[str]) -> str:
    """Name of the node of joints that share a dot."""
    return f"/joints/{'+'.join(names).replace('/', '_')}"


def dot_path(name: str) -> str:
    """Name of the node of a traced point's dot."""
    return f"{_path(name)}/now"


def _path(name: str) -> str:
    return f"/paths/{name.replace('/', '_')}"


HOVER_SCRIPT = Path(__file__).with_name("hover.js").read_text(encoding="utf-8")

JointName = tuple[str, str, tuple[str, ...]]
KIND_WORDS = {"pin_slot": "pin in a slot"}


def hover_names(view_model: ViewModel) -> dict[str, JointName]:
    """By name of the node: title, further text, and the names of the items if the node draws several."""
    hovered: dict[str, JointName] = {}
    for link in view_model.poses:
        hovered[link_path(link)] = (f"link {link}", "the fixed link" if link == view_model.frame else "click to look closer", ())
    driven = {drive.name for drive in view_model.drives}
    for names, _ in joint_groups(view_model.joints, 1e-6 * view_model.size):
        words = [_joint(view_model, name) + (", driven" if name in driven else "") for name in names]
        if len(names) > 1:
            words = [f"{name}: {text}" for name, text in zip(names, words, strict=True)]
        hovered[f"{joint_path(names)}/dot"] = (f"joint {', '.join(names)}", "; ".join(words), ())
    for name in view_model.paths:
        hovered[dot_path(name)] = (f"point {name}", "a traced point, on its path", ())
    for family, arrows in arrows_by_family(view_model).items():
        kind = VECTOR_FAMILIES[family]
        items = tuple(f"{kind.label}: {arrow.vector.item}" for arrow in arrows)
        hovered[f"/vectors/{family}"] = (kind.label, f"{kind.meaning} [{view_model.units.display_unit(kind.unit)[0]}]", items)
    moment = f"a moment [{view_model.units.display_unit('N m')[0]}]"
    for arc in view_model.picture.nodes_of(MomentArc):
        family, item = arc.group, arc.moment.item
        hovered[arc_path(family, item)] = (f"{VECTOR_FAMILIES[family].label}: {item}", moment, ())
    return hovered


def _joint(view_model: ViewModel, name: str) -> str:
    """Description of a joint: ``revolute, crank and coupler``."""
    joint = view_model.numbers.joints[name]
    return f"{KIND_WORDS.get(joint.kind, joint.kind)}, {' and '.join(joint.links)}"


MOST_HOVER_VALUES = 60_000  # largest number of arrows times frames whose values are sent to pages, about 2 MB
ROUNDING_SHARE = 1e-9  # of the usual size of a node's values: smaller values are shown as zero


def hover_values(view_model: ViewModel, arrows: ArrowNodes) -> dict[str, dict[str, Any]]:
    """By name of the node that draws arrows: unit, colour, values over the frames, and the ends of the arrows.

    Empty for a motion with more than `MOST_HOVER_VALUES` values.
    """
    arrow_values = list(arrows.values())
    if sum(each.values.size for each in arrow_values) > MOST_HOVER_VALUES:
        return {}
    values = {}
    for each in arrow_values:
        unit, factor = view_model.units.display_unit(each.si)
        largest = usual_size(each.values)
        values[each.node] = {
            "unit": unit,
            "color": "rgb({},{},{})".format(*VECTOR_FAMILIES[each.family].on_dark),
            "count": each.values.shape[1],
            "nothing": ROUNDING_SHARE * factor * largest,
            "values": base64_of(factor * each.values),
            "starts": base64_of(each.starts),
            "tips": base64_of(each.tips),
        }
    return values


class HoverNames:
    """Sends the names of nodes and the values of arrows to all browsers, present and future; ``update`` takes another run."""

    def __init__(self, server: viser.ViserServer, view_model: ViewModel, arrows: ArrowNodes):
        self._server, self._arrows = server, arrows
        self._said = ""
        self._values_shown = False
        self.update(view_model)

    def update(self, view_model: ViewModel) -> None:
        """Take the names and values of another run, or of arrows that have changed."""
        self._names, self._values = json.dumps(hover_names(view_model)), json.dumps(hover_values(view_model, self._arrows))
        self._say()

    def show_values(self, on: bool) -> None:
        """Show or hide the values beside all arrows that are drawn."""
        self._values_shown = on
        self._say()

    def _say(self) -> None:  # in one message, as a browser that connects later receives only the last one
        script = f"hover.names = {self._names}; hover.tell({self._values}); hover.beside({json.dumps(self._values_shown)});"
        said = f"{{ const hover = window.mechvizHover; {script} }}"
        if said != self._said:
            self._said = said
            run_script(self._server, HOVER_SCRIPT + said, "hover")
