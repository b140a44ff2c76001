"""What has been made of a scene: undo, redo, reset. Steps of one drag are one step."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from ..scene import Scene
from .parameters import Path, written

__all__ = ["Draft", "History"]

ONE_DRAG = 0.8  # [s] between changes of the same value that count as one
MOST_STEPS = 500


@dataclass(frozen=True)
class Draft:
    """A scene being edited: its plain data, and the loads that are switched off, which wait with their values."""

    name: str
    data: Mapping[str, Any]
    idle: tuple[str, ...] = ()

    @classmethod
    def of(cls, scene: Scene) -> Draft:
        return cls(scene.name, scene.document.model_dump(exclude_unset=True))

    def scene(self) -> Scene:
        """The scene that the draft says. Raises `SceneError` where it says none."""
        return Scene.build(name=self.name, **self.document())

    def document(self) -> dict[str, Any]:
        """The data without what is switched off."""
        data = dict(self.data)
        if self.idle:
            data["loads"] = {name: load for name, load in data.get("loads", {}).items() if name not in self.idle}
            if not data["loads"]:
                del data["loads"]
        return data

    def with_value(self, path: Path, value: Any) -> Draft:
        """The draft with another value at a place."""
        return replace(self, data=written(self.data, path, value))

    def with_effect(self, effect: str, on: bool) -> Draft:
        """The draft with an effect named or not; the order of those that are there stays."""
        named = [e for e in self.data.get("effects", ()) if e != effect] + ([effect] if on else [])
        return replace(self, data={**self.data, "effects": named})

    def with_named(self, key: str, name: str, on: bool) -> Draft:
        """The draft with a name in one of its lists, such as ``plans`` or ``polodes``, or not."""
        named = [n for n in self.data.get(key, ()) if n != name] + ([name] if on else [])
        data = {k: v for k, v in self.data.items() if k != key}
        return replace(self, data={**data, key: named} if named else data)

    def with_load(self, load: str, on: bool) -> Draft:
        """The draft with a load switched on or off."""
        idle = tuple(name for name in self.idle if name != load)
        return replace(self, idle=idle if on else (*idle, load))


class History:
    """Drafts one after the other. ``change`` puts a new one behind the present one, which forgets what was undone."""

    def __init__(self, opened: Draft, clock: Callable[[], float] = time.monotonic):
        self._drafts = [opened]
        self._at = 0
        self._clock = clock
        self._last: tuple[str, float] = "", -1e9

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
        """A new draft; ``what`` names the value that was changed, so that a drag becomes one step."""
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
