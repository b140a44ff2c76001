"""What callbacks of controls share: numbers from browsers brought into range, and the way back from changes that fail."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser

Callback = Callable[[str, Callable[[Any], None]], Callable[[Any], Any]]
"""``callback(what, action)``: an action for viser of which failures are told to the user under the name ``what``."""


def finite(value: Any, low: float, high: float, otherwise: float) -> float:
    """A number from a browser brought into its range; what is not a finite number becomes ``otherwise``."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        return otherwise
    return float(np.clip(number, low, high)) if np.isfinite(number) else otherwise


WITH_STATE = (viser.GuiCheckboxHandle, viser.GuiSliderHandle, viser.GuiDropdownHandle, viser.GuiTextHandle)
log = logging.getLogger("mechviz.outputs.viewer")


@dataclass(eq=False)
class Change:
    """A control that a browser has set, its value before, and what its callback did, None until then."""

    control: Any
    before: Any
    action: Callable[[], None] | None = None

    def undo(self) -> None:
        """Bring back the value, and what follows from it; nothing of a control that is no more."""
        with contextlib.suppress(RuntimeError):
            self.control.value = self.before
        if self.action is not None:
            self.action()


class Changes:
    """What browsers have changed since the last picture that was drawn whole. A change of which the callback or the picture fails
    is undone, so that what is drawn next does not fail as well."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._open: dict[int, Change] = {}  # by control

    def remember(self, control: Any) -> None:
        """A browser is about to set a control. Of several changes the value before the first one counts."""
        if isinstance(control, WITH_STATE):
            with self._lock:
                change = self._open.get(id(control))
                if change is None or change.action is None:
                    self._open[id(control)] = Change(control, control.value)

    def run(self, action: Callable[[Any], None], event: Any) -> None:
        """Do what a callback does; undo the change where that fails, and raise why."""
        with self._lock:
            change = self._open.get(id(getattr(event, "target", None)))
            if change is not None:
                change.action = lambda: action(event)
        try:
            action(event)
        except Exception:
            if change is not None:
                self._undo([change])
            raise

    def open(self) -> Sequence[Change]:
        """The changes that the next picture shows."""
        with self._lock:
            return [change for change in self._open.values() if change.action is not None]

    def accept(self, changes: Sequence[Change]) -> None:
        """They have been drawn."""
        with self._lock:
            for change in changes:
                self._open.pop(id(change.control), None)

    def undo(self) -> bool:
        """Undo what has not been drawn; whether there was anything."""
        changes = self.open()
        self._undo(changes)
        return bool(changes)

    def _undo(self, changes: Sequence[Change]) -> None:
        self.accept(changes)
        for change in reversed(changes):
            try:
                change.undo()
            except Exception as error:
                log.error("undoing a change failed", exc_info=error)
