"""The tab of what is drawn: arrows by family with their sizes, marks, the camera, a light or dark page."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import viser

from mechviz.outputs.viewer.player import Player
from mechviz.outputs.viewer.server import Callback, finite
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.outputs.viewer.viser_adapter import uuid_of
from mechviz.outputs.viewer.world.camera import VIEW_PRESETS, reset_to
from mechviz.outputs.viewer.world.scene import Scene3D
from mechviz.quantities.vectors import FORCE_FAMILIES, VECTOR_FAMILIES

SIZE_FAMILIES = {"Size of forces": FORCE_FAMILIES, "Size of velocities": ("velocity",), "Size of accelerations": ("acceleration",)}
CAMERA_HINT = "2D is straight on and hardly has a perspective: there dragging moves the picture; elsewhere it turns the view"
SIZE_HINT = "times the size at which the largest one is a third of the mechanism"


class Switches:
    """Switches for arrows and marks, sizes of arrows, opacity, section, camera and colours of the page.

    ``changed()`` is called after a change of what is drawn; ``darken(dark)`` makes the page dark or light.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        tab: viser.GuiTabHandle,
        scene: Scene3D,
        player: Player,
        callback: Callback,
        changed: Callable[[], None],
        darken: Callable[[bool], None],
    ):
        gui = server.gui
        self._scene, self._player, self._changed = scene, player, changed
        self.families: dict[str, viser.GuiCheckboxHandle] = {}
        self.marks: dict[str, viser.GuiCheckboxHandle] = {}
        self.sizes: dict[str, Any] = {}
        with tab:
            self.cameras = gui.add_button_group("Look from", tuple(p.label for p in VIEW_PRESETS.values()), hint=CAMERA_HINT)
            self.cameras.on_click(callback("Moving the camera", lambda event: self._look(event)))
            reset_to(server, uuid_of(self.cameras), VIEW_PRESETS[scene.cameras.first].label)
            self.arrows = gui.add_folder("Arrows")
            with self.arrows:
                for name in VECTOR_FAMILIES:
                    label, hint = VECTOR_FAMILIES[name].label, VECTOR_FAMILIES[name].meaning
                    box = gui.add_checkbox(label, scene.arrows.is_on(name), hint=hint)
                    box.on_update(callback(f"Switching {label}", partial(self._switch, name)))
                    self.families[name] = box
                for label, families in SIZE_FAMILIES.items():
                    size = gui.add_slider(label, 0.1, 5.0, 0.1, 1.0, hint=SIZE_HINT)
                    size.on_update(callback("Changing the size of arrows", partial(self._enlarge, label, families)))
                    self.sizes[label] = size
            with gui.add_folder("Marks"):
                for name in scene.marks:
                    self.marks[name] = gui.add_checkbox(name, scene.is_marked(name))
                    self.marks[name].on_update(callback(f"Switching {name}", partial(self._mark, name)))
            with gui.add_folder("Looks"):
                self.opacity = gui.add_slider("Opacity of links", 0.1, 1.0, 0.05, 1.0)
                self.opacity.on_update(callback("Changing the opacity", lambda _: self._fade()))
                self.section = gui.add_slider(
                    "Section [%]", 0, 100, 1, 0, hint="cuts the front away, as far as this into the depth"
                )
                self.section.on_update(callback("Cutting", lambda _: self._cut()))
                self.dark = gui.add_checkbox("Dark page", False)
                self.dark.on_update(callback("Changing the colours", lambda _: darken(bool(self.dark.value))))
        self.update(scene.current)

    @property
    def size(self) -> Any:
        """The first slider of a size, that of the forces."""
        return next(iter(self.sizes.values()))

    def update(self, view_model: ViewModel) -> None:
        """Show the switches for what another run contains."""
        for name, box in self.families.items():
            if box.visible != (name in view_model.families):
                box.visible = name in view_model.families
        for label, families in SIZE_FAMILIES.items():
            self.sizes[label].visible = bool(view_model.families & set(families))
        self.arrows.visible = bool(view_model.families)
        self._scene.cut(self._height)  # the solids may be thicker now
        paths = self.marks["Paths"]
        paths.visible = bool(view_model.paths)

    def _look(self, event: Any) -> None:
        chosen = next((key for key, preset in VIEW_PRESETS.items() if preset.label == self.cameras.value), None)
        if chosen is not None:
            self._scene.set_preset(event.client, chosen)

    def _mark(self, name: str, _: object) -> None:
        self._scene.switch_mark(name, bool(self.marks[name].value))
        self._changed()

    def _switch(self, family: str, _: object) -> None:
        self._scene.switch_family(family, bool(self.families[family].value))
        self._changed()

    def _enlarge(self, label: str, families: tuple[str, ...], _: object) -> None:
        slider = self.sizes[label]
        value = finite(slider.value, 0.1, 5.0, 1.0)
        if value != slider.value:
            slider.value = value
        self._scene.arrows.enlarge(value, families)
        self._changed()

    def _cut(self) -> None:
        self._scene.cut(self._height)
        self._changed()

    @property
    def _height(self) -> float | None:
        """Height z [m] of the section through the present solids; None without one."""
        part = finite(self.section.value, 0.0, 100.0, 0.0) / 100.0
        low, high = self._scene.current.bounds[:, 2]
        return None if part == 0.0 else float(high - part * (high - low))

    def _fade(self) -> None:
        self._scene.links.fade(finite(self.opacity.value, 0.1, 1.0, 1.0))
        self._changed()
