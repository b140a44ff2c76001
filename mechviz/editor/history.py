"""History of an edited scene: undo, redo, reset. The changes of one drag are one step."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from mechcore.accuracy import Accuracy
from mechcore.records import dataclass
from mechviz.scene.annotations import Place
from mechviz.scene.document import SceneDocument
from mechviz.scene.faults import SceneError
from mechviz.scene.folder import SceneFolder
from mechviz.scene.reading.formulas import parameter_changes
from mechviz.scene.scene import Scene, assembled, changed_document

ONE_DRAG = 0.8  # [s] between changes of the same value that count as one
MOST_STEPS = 500


@dataclass(frozen=True)
class Draft:
    """A scene being edited: its document, and the names of ``disabled_loads``, which are switched off and keep their values.

    ``accuracy``: settings with which the scene was opened, in place of its own.
    """

    name: str
    document: SceneDocument
    folder: SceneFolder
    disabled_loads: tuple[str, ...] = ()
    accuracy: Accuracy | None = None

    @classmethod
    def of(cls, scene: Scene) -> Draft:
        return cls(scene.name, scene.document, scene.folder)

    def scene(self) -> Scene:
        """The scene of the draft, without the loads that are switched off. Raises `SceneError` where it is not valid."""
        changes: dict[Place, Any] = {("loads", name): None for name in self.disabled_loads}
        document = changed_document(self.document, changes, self.name, self.folder) if changes else self.document
        return assembled(document, self.name, self.folder)

    def changed(self, changes: Mapping[Place, Any]) -> Draft:
        """The draft with the values at some places replaced. Raises `SceneError`."""
        return replace(self, document=changed_document(self.document, changes, self.name, self.folder))

    def with_value(self, place: Place, value: object) -> Draft:
        """The draft with another value at a place. Raises `SceneError`."""
        return self.changed({place: value})

    def with_parameters(self, values: Mapping[str, float | str]) -> Draft:
        """The draft with other values of some parameters. Raises `SceneError`."""
        changes, faults = parameter_changes(self.document, values)
        if faults:
            raise SceneError(self.name, faults)
        return self.changed(changes)

    def with_effect(self, effect: str, on: bool) -> Draft:
        """The draft with an effect switched on or off; the other effects keep their order."""
        return self.with_named("effects", effect, on)

    def with_named(self, key: str, name: str, on: bool) -> Draft:
        """The draft with a name added to one of its lists or tables, such as ``polygons``, ``centrodes`` or ``sections``, or
        removed from it."""
        if isinstance(getattr(self.document, key), Mapping):
            return self.changed({(key, name): {} if on else None})
        named = [n for n in getattr(self.document, key) if n != name] + ([name] if on else [])
        return self.changed({(key,): named or None})

    def with_accuracy(self, changes: Mapping[Place, Any]) -> Draft:
        """The draft with other settings of accuracy, which are those of the scene. Raises `SceneError`."""
        return replace(self.changed(changes), accuracy=None)

    def with_load(self, load: str, on: bool) -> Draft:
        """The draft with a load switched on or off."""
        others = tuple(name for name in self.disabled_loads if name != load)
        return replace(self, disabled_loads=others if on else (*others, load))


class History:
    """A sequence of drafts. ``change`` adds a new one after the present one and discards those that were undone."""

    def __init__(self, opened: Draft, clock: Callable[[], float] = time.monotonic):
        self._drafts = [opened]
        self._at = 0
        self._clock = clock
        self._last: tuple[str, float] = "", -1e9

    def copied(self) -> History:
        """A copy of the history that changes independently."""
        other = copy.copy(self)
        other._drafts = list(self._drafts)
        return other

    @property
    def opened(self) -> Draft:
        return self._drafts[0]

    @property
    def present(self) -> Draft:
        return self._drafts[self._at]

    @property
    def can_undo(self) -> bool:
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        return self._at + 1 < len(self._drafts)

    def change(self, draft: Draft, what: str) -> None:
        """Add a draft; ``what`` names the value that was changed, so that a drag becomes one step."""
        now = self._clock()
        same = what == self._last[0] and now - self._last[1] < ONE_DRAG and self._at > 0
        self._last = what, now
        del self._drafts[self._at + (0 if same else 1) :]
        self._drafts.append(draft)
        if len(self._drafts) > MOST_STEPS:
            del self._drafts[1]
        self._at = len(self._drafts) - 1

    def undo(self) -> Draft:
        self._last = "", -1e9
        self._at = max(self._at - 1, 0)
        return self.present

    def redo(self) -> Draft:
        self._last = "", -1e9
        self._at = min(self._at + 1, len(self._drafts) - 1)
        return self.present

    def reset(self) -> Draft:
        """The scene as opened, as a step that can be undone."""
        if self.present != self.opened:
            self.change(self.opened, "")
        return self.present
