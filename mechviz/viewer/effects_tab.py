"""The tab of effects: each on or off, what it changes in the peak of the driving effort, what it costs; and the plan."""

from __future__ import annotations

from functools import partial
from typing import Any

import viser

from mechcore.spec import EFFECTS

from . import words
from .callbacks import Callback
from .plan_diagram import plan_svg
from .show import Show
from .studio import Contribution, Studio

__all__ = ["EffectsTab"]


class EffectsTab:
    """A checkbox for every effect and load; ``weighed`` shows what they contribute, ``update`` takes another run."""

    def __init__(self, server: viser.ViserServer, tab: viser.GuiTabHandle, studio: Studio, callback: Callback):
        gui = server.gui
        self._studio = studio
        self.effects: dict[str, viser.GuiCheckboxHandle] = {}
        self.loads: dict[str, viser.GuiCheckboxHandle] = {}
        with tab:
            with gui.add_folder("Effects"):
                for name, meaning in EFFECTS.items():
                    box = gui.add_checkbox(name, name in studio.run.scene.effects, hint=meaning)
                    box.on_update(callback(f"Switching {name}", partial(self._switch_effect, name)))
                    self.effects[name] = box
            loads = list(studio.history.present.document.loads)
            if loads:
                with gui.add_folder("Loads"):
                    for name in loads:
                        box = gui.add_checkbox(name, name not in studio.history.present.idle)
                        box.on_update(callback(f"Switching {name}", partial(self._switch_load, name)))
                        self.loads[name] = box
            self.table = gui.add_html(words.hint("What each effect contributes is found when the mechanism rests."))
            weigh = gui.add_button("Weigh the effects", hint="find out what each contributes and costs")
            weigh.on_click(callback("Weighing the effects", lambda _: studio.weigh(asked=True)))
            with gui.add_folder("What was computed"):
                self.diagram = gui.add_html(self._diagram(studio.show))
                self.plan = gui.add_html(studio.show.notes)

    def update(self, show: Show) -> None:
        """Take the switches and the plan of another run."""
        assert show.run is not None
        for name, box in self.effects.items():
            if box.value != (name in show.run.scene.effects):
                box.value = name in show.run.scene.effects
        for name, box in self.loads.items():
            if box.value != (name in show.run.scene.document.loads):
                box.value = name in show.run.scene.document.loads
        diagram = self._diagram(show)
        if self.diagram.content != diagram:
            self.diagram.content = diagram
        if self.plan.content != show.notes:
            self.plan.content = show.notes

    @staticmethod
    def _diagram(show: Show) -> str:
        assert show.run is not None
        return plan_svg(show.run.motion.mechanism, show.run.plan)

    def weighed(self, found: tuple[Contribution, ...]) -> None:
        """Show what each effect contributes."""
        drives = self._studio.show.drives
        effort = "reaction" if not drives else "drive force" if drives[0].sliding else "drive torque"
        self.table.content = words.contributions(found, effort)

    def _switch_effect(self, name: str, _: Any) -> None:
        on = bool(self.effects[name].value)
        self._studio.change(f"effect {name}", lambda draft: draft.with_effect(name, on))

    def _switch_load(self, name: str, _: Any) -> None:
        on = bool(self.loads[name].value)
        self._studio.change(f"load {name}", lambda draft: draft.with_load(name, on))
