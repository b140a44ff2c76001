"""The detail panel of one link, joint, cam or drive: its values at the present frame, and a plot of one of its quantities."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import viser

from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.panels.plots import CURSOR_RATE, ROUND_OFF, PlotSlot
from mechviz.outputs.viewer.playback import NumberTrack, PlotTrack
from mechviz.outputs.viewer.server import Callback
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.quantities.catalogue import Axis, Quantity
from mechviz.quantities.numbers import usual_size

FIRST_QUANTITIES = ("reaction", "contact force", "torque", "force", "pressure angle", "angular velocity", "velocity", "angle")


def items_of(view_model: ViewModel) -> tuple[str, ...]:
    """Items that can be chosen: ``link crank``, ``joint A``, ``cam K``, ``drive A``."""
    return tuple(dict.fromkeys(q.item for q in view_model.quantities if q.item and q.item != "health"))


def members(view_model: ViewModel, item: str) -> tuple[Quantity, ...]:
    """The quantities of an item."""
    return tuple(q for q in view_model.quantities if q.item == item)


class DetailPanel:
    """A tab with the values of one item, chosen by ``look_at`` or by a click on a solid or a joint.

    ``picked(item)`` is called with the chosen item.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        tab: viser.GuiTabHandle,
        view_model: ViewModel,
        callback: Callback,
        picked: Callable[[str], None],
    ):
        self._picked, self.tab = picked, tab
        self._view_model = view_model
        self._frame, self._moved = 0, 0.0
        self._tables: dict[str, Any] = {}
        items = items_of(view_model)
        with tab:
            server.gui.add_html(words.hint("Click on a link or a joint in the picture, or choose one here."))
            self.choice = server.gui.add_dropdown("Look at", items, initial_value=items[0])
            self._values = server.gui.add_html("")
        self.choice.on_update(callback("Looking closer", lambda _: self.look_at(self.choice.value)))
        self.item = items[0]
        self.slot = PlotSlot(server, tab, "Its plot", self._titles(), self._first(), self._axis())
        self.slot.choice.on_update(callback("Changing the plot", lambda _: self._plot(self.slot.choice.value)))
        self._read()
        self.show(0, False)

    def look_at(self, item: str) -> None:
        """Show the values of an item. An unknown item changes nothing; if showing fails, the one before stays and the error is
        raised."""
        before = self.item
        try:
            if item in items_of(self._view_model):
                self._take(item)
            self.choice.value = self.item
            self.show(self._frame, False)
        except Exception:
            self._take(before)
            self.choice.value = before
            raise

    def _take(self, item: str) -> None:
        self.item = item
        self.slot.choice.options = self._titles()
        self._plot(self._first().title)
        self._read()
        self._picked(item)

    def update(self, view_model: ViewModel, frame: int) -> None:
        """Take another run."""
        before, self._view_model, self._frame = items_of(self._view_model), view_model, frame
        if items_of(view_model) != before:
            self.choice.options = items_of(view_model)
            self.item = self.item if self.item in items_of(view_model) else items_of(view_model)[0]
            self.choice.value = self.item
        titles = self._titles()
        kept = self.slot.quantity.title if self.slot.quantity.title in titles else self._first().title
        self.slot.take(next(q for q in members(view_model, self.item) if q.title == kept), self._axis(), frame)
        if tuple(self.slot.choice.options) != titles:
            self.slot.choice.options = titles
            self.slot.choice.value = kept
        self._read()

    def show(self, frame: int, playing: bool) -> None:
        now = time.perf_counter()
        if playing and now - self._moved < 1.0 / CURSOR_RATE:
            return
        self._frame, self._moved = frame, now
        rows = []
        for q, values, least in self._tables.values():
            at = [0.0 if abs(v) <= least else float(v) for v in values[frame]]
            rows.append((q.name, q.curves, at, q.unit))
        self._values.content = words.value_table(self.item, rows)
        self.slot.show(frame)

    def tracks(self) -> Iterator[PlotTrack | NumberTrack]:
        """Tracks of the numbers and of the cursor of the plot."""
        k = 0
        for _, values, least in self._tables.values():
            for column in values.T:
                yield NumberTrack(f"closer:{k}", np.where(np.abs(column) <= least, 0.0, column))
                k += 1
        yield from self.slot.tracks()

    def _read(self) -> None:
        self._tables = {}
        for q in members(self._view_model, self.item):
            values = q.values()
            least = ROUND_OFF * usual_size(values)
            self._tables[q.title] = q, values, least

    def _titles(self) -> tuple[str, ...]:
        return tuple(q.title for q in members(self._view_model, self.item))

    def _axis(self) -> Axis:
        return self._view_model.axes[0]

    def _first(self) -> Quantity:
        own = members(self._view_model, self.item)
        return next((q for word in FIRST_QUANTITIES for q in own if q.label.endswith(f": {word}")), own[0])

    def _plot(self, title: str) -> None:
        chosen = next((q for q in members(self._view_model, self.item) if q.title == title), None)
        if chosen is not None:
            self.slot.plot(chosen, self._axis(), self._frame)
        self.slot.choice.value = self.slot.quantity.title
