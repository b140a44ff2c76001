"""The tab of accuracy: estimated errors of the run, errors and times of other settings, and a choice that applies one of them."""

from __future__ import annotations

import json
import threading
from dataclasses import replace
from html import escape

import viser

from mechviz.figures import chart_svg
from mechviz.outputs.rerun.content import accuracy_words
from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.panels.controls import EditedControls
from mechviz.outputs.viewer.server import Callback
from mechviz.outputs.viewer.session import EditSession
from mechviz.outputs.viewer.viser_adapter import uuid_of
from mechviz.studies.precision import PrecisionPoint, ladder, pareto
from mechviz.studies.precision_diagram import diagram, in_use, setting_changes, setting_words, target_changes

AS_IT_IS = "as it is"
TARGET_CHOICES = {"as the settings are": None, "1e-2": 1e-2, "1e-3": 1e-3, "1e-4": 1e-4, "1e-6": 1e-6, "1e-8": 1e-8, "1e-10": 1e-10}
SHOWN_SETTINGS = (  # settings that affect what is shown
    "frames", "differentiation", "integrator", "position tolerance", "friction tolerance", "tessellation", "cam profile"
)  # fmt: skip
DIAGRAM_SIZE = (3.4, 2.8)  # of a diagram [in], as wide as the tab

# A click on a setting in the diagram is sent as a choice from the list, like that of viser's own control
PICK_SCRIPT = """const title = event.target.closest('g[id^=setting]')?.querySelector('title'), viser = window.__viserMutable;
if (title && viser) {
  const message = { type: 'GuiUpdateMessage', uuid: %s, updates: { value: title.textContent } };
  viser.messageQueue.push(message);
  viser.sendMessage(message);
}"""


class AccuracyTab:
    """A list of target errors, from which all settings follow; and a button that measures error and time of other settings in a
    thread. A point of the resulting diagrams, or an entry of the list (the quickest first), can be applied."""

    def __init__(self, server: viser.ViserServer, tab: viser.GuiTabHandle, session: EditSession, callback: Callback):
        self._session = session
        self._points: tuple[PrecisionPoint, ...] = ()
        self._named: dict[str, PrecisionPoint] = {}
        self._measuring: threading.Thread | None = None
        gui = server.gui
        with tab:
            self.errors = gui.add_html(self._estimate_text())
            hint = (
                "relative to the mechanism's size and the peak of each quantity: frames, tolerances and all other settings follow"
            )
            self.wanted = gui.add_dropdown("Wanted error", self._errors(), initial_value=self._target_label(), hint=hint)
            button = gui.add_button("Measure what accuracy costs", hint="error against time for every setting; takes a while")
            self.choice = gui.add_dropdown("Setting", (AS_IT_IS,), hint="* nothing is quicker and more exact")
            self.diagram = gui.add_html(words.hint("Error against time appears here; a click on a setting applies it."))
        self._edited = EditedControls(session, callback)
        self._edited.listen("accuracy", self.wanted, "the wanted error", self._set_target)
        button.on_click(callback("Measuring", lambda _: self.measure()))
        self.choice.on_update(callback("Applying a setting", self._pick))

    def update(self) -> None:
        """Show the present run. The error estimate of a motion under forces needs another run: it waits for `measure`."""
        if self._session.run.simulation is None:
            self.errors.content = self._estimate_text()
        if self.wanted.value != self._target_label() and not self._edited.is_pending("accuracy", self.wanted):
            self.wanted.options = self._errors()
            self._edited.write(self.wanted, self._target_label())
        if self._points:
            points = self._marked(self._points)
            if points != self._points:
                self._points = points
                self._draw()

    def measure(self) -> None:
        """Start measuring in a thread, unless a measurement is running."""
        if self._measuring is None or not self._measuring.is_alive():
            self._measuring = threading.Thread(target=self._measure, name="mechviz-accuracy", daemon=True)
            self._measuring.start()

    def wait(self, timeout: float = 60.0) -> None:
        """Wait until the measurement is shown, at most ``timeout`` [s]."""
        if self._measuring is not None:
            self._measuring.join(timeout)

    def _measure(self) -> None:
        run = self._session.run
        points = ladder(run.scene, run.accuracy.target, budget=0.02, only=SHOWN_SETTINGS)
        named: dict[str, PrecisionPoint] = {}
        for setting in dict.fromkeys(p.setting for p in points):
            own = [p for p in points if p.setting == setting]
            front = {id(p) for p in pareto(own)}
            named |= {setting_words(p, id(p) in front): p for p in sorted(own, key=lambda p: p.seconds) if p.options}
        self._points, self._named = self._marked(points), named
        self._draw()
        self.errors.content = self._estimate_text()
        self.choice.options = (AS_IT_IS, *named)

    def _marked(self, points: list[PrecisionPoint] | tuple[PrecisionPoint, ...]) -> tuple[PrecisionPoint, ...]:
        """The measured points, with those of the present settings marked."""
        run = self._session.run
        return tuple(replace(p, current=in_use(run, p.setting, p.options)) for p in points)

    def _draw(self) -> None:
        target = self._session.run.accuracy.target
        figure, words = diagram(
            self._points, "A click on a setting applies it", "times on this machine", target, columns=1, size=DIAGRAM_SIZE
        )
        code = escape(PICK_SCRIPT % json.dumps(uuid_of(self.choice)), quote=True)
        svg = chart_svg(figure, words).partition("<svg ")[2]  # without the prolog of a file
        self.diagram.content = f'<div onclick="{code}"><svg style="width:100%;height:auto;cursor:pointer" {svg}</div>'

    def _pick(self, _: object) -> None:
        point = self._named.get(str(self.choice.value))
        if point is not None:
            self._session.change("accuracy", lambda draft: draft.with_accuracy(setting_changes(draft.document, point.options)))

    def _target_label(self) -> str:
        """The entry of the list for the target error of the present run."""
        target = self._session.run.accuracy.target
        return next((name for name, value in TARGET_CHOICES.items() if value == target), str(target))

    def _errors(self) -> tuple[str, ...]:
        """All entries of the list, including that of the present run."""
        return tuple(dict.fromkeys((*TARGET_CHOICES, self._target_label())))

    def _set_target(self, wanted: object) -> None:
        target = TARGET_CHOICES.get(str(wanted), self._session.run.accuracy.target)
        if target != self._session.run.accuracy.target:
            self._session.change("accuracy", lambda draft: draft.with_accuracy(target_changes(target)))

    def _estimate_text(self) -> str:
        return "".join(words.hint(line) for line in accuracy_words(self._session.run))
