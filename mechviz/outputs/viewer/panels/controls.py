"""The editor's controls: a slider for every number of the scene, a list for every choice, undo and redo, and error messages."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Collection
from functools import partial
from typing import Any

import viser

from mechviz.editor.parameters import GROUPS, Choice, Parameter, find_choices, find_parameters
from mechviz.editor.rows import NumberRow, find_rows
from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.server import Callback, finite
from mechviz.outputs.viewer.session import EditSession, Status
from mechviz.outputs.viewer.viser_adapter import uuid_of
from mechviz.scene.scene import Scene

OPEN_FIRST = ("Parameters", "Lengths", "Drive", "Cam")
MOST_OPEN = 12  # folders are opened at the start until they contain so many controls
STATUS_INTERVAL = 0.25  # [s] between messages about successful changes
UNDO_LABEL, REDO_LABEL, RESET_LABEL = "↶ Undo", "Redo ↷", "Reset"


class EditedControls:
    """Controls of values of a scene. A value changed by a browser stays until it is solved: no update resets it meanwhile."""

    def __init__(self, session: EditSession, callback: Callback):
        self._session, self._callback = session, callback
        self._last: dict[str, object] = {}  # by control: the value that was last read or written
        self._lock = threading.RLock()  # held while a change of a browser is passed on

    def listen(self, key: str, control: Any, label: str, changed: Callable[[Any], None]) -> None:
        """Call ``changed(value)`` whenever a browser changes the control; ``key`` names the value in changes of the session."""
        self._last[uuid_of(control)] = control.value

        def updated(_: object) -> None:
            with self._lock:
                value = self._last[uuid_of(control)] = control.value
                changed(value)

        control.on_update(self._callback(f"Changing {label}", updated))

    def is_pending(self, key: str, control: Any) -> bool:
        """Whether a browser has changed a control and the change is not solved yet: no earlier result may overwrite it."""
        with self._lock:
            return control.value != self._last[uuid_of(control)] or self._session.is_pending(key)

    def write(self, control: Any, value: float | str | bool) -> None:
        """Set a control to a value."""
        with self._lock:
            control.value = value
            self._last[uuid_of(control)] = control.value

    def follow(self, key: str, control: Any, value: str | bool) -> None:
        """Set a control to the value of the scene, unless a change is pending."""
        with self._lock:
            if control.value != value and not self.is_pending(key, control):
                self.write(control, value)


class Controls:
    """The tab in which a scene is edited. ``update(scene)`` takes its values, ``show_status(status)`` reports a change."""

    def __init__(self, server: viser.ViserServer, tab: viser.GuiTabHandle, session: EditSession, callback: Callback):
        self._gui, self._tab, self._session, self._callback = server.gui, tab, session, callback
        self.sliders: dict[str, viser.GuiSliderHandle[float]] = {}
        self.lists: dict[str, viser.GuiDropdownHandle[str]] = {}
        self._parameters: dict[str, Parameter] = {}
        self.texts: dict[str, viser.GuiInputHandle[str]] = {}
        self._choices: dict[str, Choice] = {}
        self._rows: dict[str, NumberRow] = {}
        self._folders: list[viser.GuiFolderHandle] = []
        self._homes: dict[str, viser.GuiFolderHandle] = {}
        self._note: viser.GuiHtmlHandle | None = None
        self._faulty, self._said = False, 0.0  # whether a fault is shown, and the time of the last message
        self._praised: Status | None = None
        with tab:
            self.steps = self._gui.add_button_group("Changes", (UNDO_LABEL, REDO_LABEL, RESET_LABEL))
            self.message = self._gui.add_html("")
        self.steps.on_click(callback("Undoing", lambda _: self._step(self.steps.value)))
        self._build(session.run.scene)
        self.show_status(session.status)

    def update(self, scene: Scene, *, rebuild: bool = True) -> None:
        """Take the values of a scene; if it has a different set of values, build the controls anew. With ``rebuild`` False,
        controls of values that it no longer has stay as they are."""
        parameters = find_parameters(scene, self._session.source.document)
        choices, rows = find_choices(scene), find_rows(scene)
        idle = self._session.history.present.disabled_loads
        known: list[tuple[object, ...]] = [(p.key, p.unit) for p in self._parameters.values() if not _belongs(p.key, idle)]
        known += [(c.key, c.options) for c in self._choices.values() if not _belongs(c.key, idle)]
        known += [r.kind for r in self._rows.values() if not _belongs(r.key, idle)]
        current = [
            *((p.key, p.unit) for p in parameters),
            *((c.key, c.options) for c in choices),
            *(r.kind for r in rows),
        ]
        if current != known and rebuild:
            self._build(scene)
            return
        for p in parameters:
            slider = self.sliders.get(p.key)
            if slider is None or (p.label, p.unit) != (self._parameters[p.key].label, self._parameters[p.key].unit):
                continue
            self._parameters[p.key] = p
            if abs(slider.value - p.value) > 1e-9 * max(abs(p.value), 1e-9) and not self._edited.is_pending(p.key, slider):
                self._widen(slider, p.value)
                self._edited.write(slider, p.value)
        for c in choices:
            if c.key in self.lists:
                self._edited.follow(c.key, self.lists[c.key], c.value)
        for r in rows:
            shown, text = self._rows.get(r.key), self.texts.get(r.key)
            if shown is None or text is None or shown.kind != r.kind:
                continue
            self._rows[r.key] = r
            if shown.values != r.values and not _says(text.value, r) and not self._edited.is_pending(r.key, text):
                self._edited.write(text, r.text)

    def show_status(self, status: Status) -> None:
        """Show the result of a change: at the top, and below the slider that was refused. After a successful change other than by a
        slider, such as undo, all controls are updated."""
        if not status.fault and status.key not in self.sliders:
            self.update(self._session.run.scene)
        if self._note is not None:
            with contextlib.suppress(RuntimeError):
                self._note.remove()
            self._note = None
        p = self._parameters.get(status.key)
        if not status.fault:
            turned = self._praised is not None and status.oscillating_drives != self._praised.oscillating_drives
            # not for every move of a slider
            if self._faulty or turned or time.perf_counter() - self._said > STATUS_INTERVAL:
                self._confirm(status)
            return
        self._faulty = True
        text = words.refusal_words(status.fault, p, status.value, status.feasible_range)
        placed = p is not None and status.key in self._homes
        self.message.content = words.refusal_words("", p, status.value, status.feasible_range) if placed else text
        if placed:
            with self._homes[status.key]:
                self._note = self._gui.add_html(text, order=self.sliders[status.key].order + 1e-6)

    def settle(self) -> None:
        """Update after a while without changes: a value that could not be built returns to the one that is shown, also where a
        later change was successful, and sliders follow what was dragged in the picture."""
        self.update(self._session.run.scene, rebuild=bool(self._session.status.fault))
        if not self._session.status.fault and self._praised is not self._session.status:
            self._confirm(self._session.status)

    # -- inside -------------------------------------------------------------------------------------------------------
    def _confirm(self, status: Status) -> None:
        """Show that a change was successful."""
        self._faulty, self._praised, self._said = False, status, time.perf_counter()
        history = self._session.history
        self.message.content = words.edit_status(status.seconds, history.can_undo, history.can_redo, status.oscillating_drives)

    def _build(self, scene: Scene) -> None:
        for folder in self._folders:
            folder.remove()
        self._folders, self._note, self._edited = [], None, EditedControls(self._session, self._callback)
        self.sliders, self.lists, self.texts, self._homes = {}, {}, {}, {}
        self._parameters = {p.key: p for p in find_parameters(scene, self._session.source.document)}
        self._choices = {c.key: c for c in find_choices(scene)}
        self._rows = {r.key: r for r in find_rows(scene)}
        opened = 0
        for group in GROUPS:
            members = [p for p in self._parameters.values() if p.group == group]
            choices = [c for c in self._choices.values() if c.group == group]
            texts = [r for r in self._rows.values() if r.group == group]
            if not members and not choices and not texts:
                continue
            expand = group in OPEN_FIRST and opened < MOST_OPEN
            opened += len(members) if expand else 0
            with self._tab, self._gui.add_folder(group, expand_by_default=expand) as folder:
                self._folders.append(folder)
                for p in members:
                    self._add_slider(p, folder)
                for c in choices:
                    self._add_list(c)
                for r in texts:
                    self._add_text(r)

    def _add_slider(self, p: Parameter, folder: viser.GuiFolderHandle) -> None:
        slider: Any = self._gui.add_slider(p.title, p.low, p.high, p.step, p.value, hint=f"{p.key} of the scene file")
        self._edited.listen(p.key, slider, p.label, partial(self._moved, p.key))
        self.sliders[p.key] = slider
        self._homes[p.key] = folder

    def _add_list(self, c: Choice) -> None:
        options = c.options if c.value in c.options else (c.value, *c.options)
        chosen: Any = self._gui.add_dropdown(c.label, options, initial_value=c.value, hint=f"{c.key} of the scene file")
        self._edited.listen(c.key, chosen, c.label, partial(self._chosen, c.key))
        self.lists[c.key] = chosen

    def _add_text(self, r: NumberRow) -> None:
        text: Any = self._gui.add_text(r.title, r.text, multiline=True, hint=f"{r.key} of the scene file, {r.hint}")
        self._edited.listen(r.key, text, r.title, partial(self._typed, r.key))
        self.texts[r.key] = text

    def _typed(self, key: str, typed: str) -> None:
        r = self._rows.get(key)
        if r is not None and not _says(typed, r):
            self._session.change(key, lambda draft: draft.changed(_current_row(r, draft.scene()).changes(typed)))

    def _moved(self, key: str, moved: float) -> None:
        p, slider = self._parameters.get(key), self.sliders.get(key)
        if p is None or slider is None:
            return  # the scene no longer has this value
        value = finite(moved, -math.inf, math.inf, p.value)
        if p.whole:
            value = float(round(value))
        self._widen(slider, finite(value, p.hard_low, p.hard_high, p.value))
        if value != moved:
            self._edited.write(slider, value)
        self._session.set_value(p, value)

    def _widen(self, slider: viser.GuiSliderHandle[float], value: float) -> None:
        """Extend the range of a slider to a value, which may have been typed beyond it."""
        if value > slider.max:
            slider.max = value
        if value < slider.min:
            slider.min = value

    def _chosen(self, key: str, option: str) -> None:
        c = self._choices.get(key)
        if c is not None and option in c.options:
            self._session.change(c.key, lambda draft: draft.changed(c.changes(draft.scene(), option)))

    def _step(self, name: str) -> None:
        actions: dict[str, Callable[[], None]] = {
            UNDO_LABEL: self._session.undo,
            REDO_LABEL: self._session.redo,
            RESET_LABEL: self._session.reset,
        }
        if name in actions:
            actions[name]()


def _says(text: str, row: NumberRow) -> bool:
    """Whether a text states the same numbers as a row, in whatever notation."""
    with contextlib.suppress(ValueError):
        return not row.changes(text)
    return False


def _current_row(row: NumberRow, scene: Scene) -> NumberRow:
    """The row with the present numbers of a scene; unchanged if the scene does not contain it (a load that is switched off)."""
    return next((r for r in find_rows(scene) if r.key == row.key), row)


def _belongs(key: str, names: Collection[str]) -> bool:
    """Whether the second part of a key is one of some names of loads or joints."""
    return key.split(".")[1:2] != [] and key.split(".")[1] in names
