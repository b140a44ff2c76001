"""The tab of accuracy: what the run says of its errors, what other settings would cost, and picking one applies it."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import viser

from ..accuracy.apply import with_setting
from ..accuracy.ladder import Point, ladder, pareto
from ..record.describe import accuracy_words
from . import words
from .callbacks import Callback
from .studio import Studio

__all__ = ["AccuracyTab"]

NOW = "as it is"
DIALS = (  # that change what is shown
    "frames", "differentiation", "integrator", "position tolerance", "friction tolerance", "tessellation", "cam profile"
)  # fmt: skip


class AccuracyTab:
    """A button measures the scene's ladder beside everything else; a list of its points, the quickest first, applies one."""

    def __init__(self, server: viser.ViserServer, tab: viser.GuiTabHandle, studio: Studio, callback: Callback):
        self._studio = studio
        self._points: dict[str, Point] = {}
        self._measuring: threading.Thread | None = None
        gui = server.gui
        with tab:
            self.errors = gui.add_html(self._said())
            button = gui.add_button("Measure what accuracy costs", hint="error against time for every dial; takes a while")
            self.diagram = gui.add_html(words.hint("Error against time appears here; picking a setting applies it."))
            self.choice = gui.add_dropdown("Setting", (NOW,), hint="* nothing is quicker and more exact")
        button.on_click(callback("Measuring", lambda _: self.measure()))
        self.choice.on_update(callback("Applying a setting", self._pick))

    def update(self) -> None:
        """What the present run says of itself; of a motion under forces that takes another one, so that it waits for measuring."""
        if self._studio.run.simulation is None:
            self.errors.content = self._said()

    def measure(self) -> None:
        """Start measuring, unless that is going on."""
        if self._measuring is None or not self._measuring.is_alive():
            self._measuring = threading.Thread(target=self._measure, name="mechviz-accuracy", daemon=True)
            self._measuring.start()

    def wait(self, timeout: float = 60.0) -> None:
        """Until what is measured is shown."""
        if self._measuring is not None:
            self._measuring.join(timeout)

    def _measure(self) -> None:
        from ..accuracy.diagram import diagram

        scene = self._studio.run.scene
        points = ladder(scene, None, budget=0.02, only=DIALS)
        named = {}
        for dial in dict.fromkeys(p.dial for p in points):
            own = [p for p in points if p.dial == dial and p.options]
            front = {id(p) for p in pareto(own)}
            for p in sorted(own, key=lambda p: p.seconds):
                mark = " *" if id(p) in front else ""
                named[f"{dial}: {p.method}, {p.value}: {p.error:.0e} in {1e3 * p.seconds:.3g} ms{mark}"] = p
        self._points = named
        sheet = diagram(points, scene.title, "black ring: the present setting", columns=1)
        image = sheet.svg().replace(
            "<svg ", f'<svg viewBox="0 0 {sheet.width:.0f} {sheet.height:.0f}" style="max-width:100%;height:auto" ', 1
        )
        self.diagram.content = image
        self.errors.content = self._said()
        self.choice.options = (NOW, *named)

    def _pick(self, _: Any) -> None:
        point = self._points.get(str(self.choice.value))
        if point is not None:
            self._studio.heed_scene()
            self._studio.change("accuracy", lambda draft: replace(draft, data=with_setting(draft.data, point.options)))

    def _said(self) -> str:
        return "".join(words.hint(line) for line in accuracy_words(self._studio.run))
