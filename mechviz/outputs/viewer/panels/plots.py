"""Plots of chosen quantities over the drive coordinate or time, each with a cursor that moves with the mechanism."""

from __future__ import annotations

import html
import re
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import field
from itertools import cycle
from typing import Any

import numpy as np
import viser
from viser import uplot

from mechcore.arrays import Real
from mechcore.records import dataclass
from mechviz.editor.worker import release_garbage
from mechviz.outputs.exports.tables import PLOT_FORMATS, plot_file
from mechviz.outputs.viewer.playback import Curves, NumberTrack, PlotTrack, interpolated
from mechviz.outputs.viewer.server import Callback, report
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.outputs.viewer.viser_adapter import uuid_of
from mechviz.outputs.viewer.words import format_number, hint, unit_suffix
from mechviz.quantities.catalogue import Axis, Quantity, QuantityGroup
from mechviz.quantities.numbers import usual_size
from mechviz.runs import Run
from mechviz.studies.designs.sensitivity import Bands, bands_of, with_tolerances

MOST_PLOTS = 24  # each is sent again with every frame
MOST_WAITING = 4  # plots that wait to be saved; further requests are ignored
PLOT_HEIGHT = 164  # [px]
NOTHING_ELSE, REMOVE_LABEL = "nothing else", "Remove"
LAST_ORDER = 1e9  # order of the controls below all plots
LONGEST_NAME = 60  # letters of a file name
LONGEST_TITLE = 17  # letters along the vertical axis
DIGIT_WIDTH = 6.8  # [px] width of a digit beside the vertical axis
AXIS_WIDTHS = (52.0, 96.0)  # [px] least and largest width of the vertical axis
CURVE_COLORS = ("#2563c9", "#d97706", "#0f8a5f", "#7c3aed", "#64748b", "#0e7490", "#a16207", "#c026d3", "#4d7c0f")  # and again
# Colours of their names and values on a dark page
ON_DARK = ("#7fb0ff", "#f0a545", "#4fc79a", "#b79bff", "#a8b3c4", "#5cc8de", "#d8b04a", "#e879f9", "#a3d05a")
OPENED_DESIGN = "as opened"
DESIGN_DASHES = ([6, 4], [2, 3], [10, 3, 2, 3])  # of the compared designs, repeated cyclically
BAND_FACTORS = {"none": 0.0, "as it is": 1.0, "10 times": 10.0, "100 times": 100.0}  # factors of the width of tolerance bands
BAND_OPACITY = "38"  # opacity of a band
ROUND_OFF = 1e-9  # of a quantity's usual size: smaller values are shown as zero
PEAK_DIFFERENCE = 0.01  # relative difference up to which a positive and a negative peak count as equally large
CURSOR_COLOR = "#c2255c"
CURSOR_RATE = 12.0  # moves a second while playing: each sends the whole plot
ANGLE_STEPS = (1, 2, 5, 10, 15, 30, 45, 90, 180, 360, 720, 1440, 3600)


def peak_of(values: Real, like: float = 0.0) -> float:
    """The value of the largest magnitude among ``values`` (n,), with its sign; if the positive and the negative peak are nearly
    equal, the one with the sign of ``like``. NaN if no value is finite."""
    known = values[np.isfinite(values)]
    if not len(known):
        return float("nan")
    ends = sorted((float(known.min()), float(known.max())), key=abs)
    nearly = abs(ends[0]) > (1.0 - PEAK_DIFFERENCE) * abs(ends[1])
    return ends[0] if nearly and ends[0] * like > 0.0 > ends[1] * like else ends[1]


@dataclass(frozen=True, eq=False)
class ExtraSeries:
    """Series of a plot in addition to its curves (F, k): ``others``, those of other designs by name; and ``half``, half the width
    (F, k) of the pale band around each curve, NaN while not known, drawn ``enlarged`` times as wide."""

    others: Mapping[str, Real] = field(default_factory=dict)
    half: Real | None = None
    enlarged: float = 1.0

    @property
    def kind(self) -> tuple[object, ...]:
        """Key of the additional series that the plot must have."""
        return *self.others, self.half is None


NO_EXTRA_SERIES = ExtraSeries()


class Plots:
    """A column of plots in a tab, which the user adds and removes; ``show`` moves their cursors, ``update`` takes the curves of
    another run, ``settle`` its tolerance bands."""

    def __init__(self, server: viser.ViserServer, tab: viser.GuiTabHandle, view_model: ViewModel, callback: Callback):
        self._server, self._tab, self._callback = server, tab, callback
        self._lock = threading.RLock()
        self._waiting = threading.BoundedSemaphore(MOST_WAITING)
        self._saver = ThreadPoolExecutor(1, "mechviz-saver")
        self._frame, self._moved, self._made = 0, 0.0, 0
        self._quantities = {q.title: q for q in view_model.quantities}
        self._axes = {a.title: a for a in view_model.axes}
        self._name = view_model.title
        titles = tuple(self._axes)
        with tab:
            self._against = server.gui.add_dropdown("Plot against", titles, initial_value=titles[0])
            self._toleranced = view_model.run is not None and bool(with_tolerances(view_model.run.scene))
            self.band: viser.GuiDropdownHandle[str] | None = None
            if self._toleranced:
                said = "how far the curves may be off by the tolerances of the scene's parameters, all of them added up"
                self.band = server.gui.add_dropdown("Tolerance band", tuple(BAND_FACTORS), initial_value="as it is", hint=said)
                self.band.on_update(callback("Drawing bands", lambda event: self.enlarge(event.target.value)))
                self._refused = server.gui.add_html("")
            self.more = server.gui.add_button("Add a plot", icon=viser.Icon.PLUS, order=LAST_ORDER)
        self._against.on_update(callback("Changing the plots", lambda _: self.choose_axis(self._against.value)))
        self.more.on_click(callback("Adding a plot", lambda _: self.add()))
        self._axis: Axis = self._axes[titles[0]]
        self.changed: Callable[[], None] = lambda: None
        self._others: Mapping[str, ViewModel] = {}
        self._bands, self._banded = Bands(), view_model.run
        self.slots: list[SharedSlot] = []
        self._find_bands(view_model.run)
        for quantity in view_model.first:
            self.add(quantity)
        self.show(0, playing=False)

    def update(self, view_model: ViewModel, frame: int) -> None:
        """Draw the same quantities of another run, as far as it has them; otherwise other quantities in their place."""
        with self._lock:
            self._frame = frame
            titles = tuple(self._quantities)
            self._quantities = {q.title: q for q in view_model.quantities}
            self._axes = {a.title: a for a in view_model.axes}
            self._axis = self._axes.get(self._axis.title, view_model.axes[0])
            if tuple(self._against.options) != tuple(self._axes):  # a drive goes to and fro now, or no longer
                self._against.options = tuple(self._axes)
                self._against.value = self._axis.title
            changed = titles != tuple(self._quantities)
            drawn = {q.title for slot in self.slots for q in slot.quantity.parts}
            spare = [q for q in view_model.first if q.title not in drawn]
            for slot in self.slots:
                parts = tuple(self._quantities[q.title] for q in slot.quantity.parts if q.title in self._quantities)
                quantity = QuantityGroup(parts or (spare.pop(0) if spare else view_model.quantities[0],))
                slot.take(quantity, self._axis, frame, self._extra(quantity, view_model.run is self._banded))
                if changed:
                    slot.offer(tuple(self._quantities.values()))

    def choose_axis(self, title: str) -> None:
        """Plot over the axis with a title (drive coordinate or time); an unknown title changes nothing."""
        with self._lock:
            self._axis = self._axes.get(title, self._axis)
            self._against.value = self._axis.title
            self._redraw()

    def enlarge(self, band: str) -> None:
        """Scale the tolerance bands by one of ``BAND_FACTORS``; no effect without bands."""
        with self._lock:
            if self.band is not None:
                self.band.value = band
                self._redraw()

    def compare(self, others: Mapping[str, ViewModel]) -> None:
        """Draw the curves of other designs as well, with the differences of the peaks; an empty mapping removes them."""
        with self._lock:
            self._others = others
            self._redraw()

    def settle(self, view_model: ViewModel) -> None:
        """Compute the tolerance bands of a run after a while without changes."""
        if self._toleranced and view_model.run is not self._banded:
            self._find_bands(view_model.run)
            with self._lock:
                for slot in self.slots:
                    slot.take(slot.quantity, self._axis, self._frame, self._extra(slot.quantity))
            self.changed()

    def _find_bands(self, run: Run | None) -> None:
        if self._toleranced and run is not None:
            self._bands, self._banded = bands_of(run), run
            why = self._bands.missing_reason
            self._refused.content = hint(f"Some curves have no tolerance band: {why}") if why else ""

    def _redraw(self) -> None:
        with self._lock:
            for slot in self.slots:
                self._plot(slot, slot.quantity)
        self.changed()

    def _plot(self, slot: SharedSlot, quantity: Quantity | QuantityGroup) -> None:
        slot.plot(quantity, self._axis, self._frame, self._extra(quantity))

    def _extra(self, quantity: Quantity | QuantityGroup, known: bool = True) -> ExtraSeries:
        """Additional series of a plot; bands that are not ``known`` yet are NaN."""
        others = {
            name: values
            for name, view_model in self._others.items()
            if (values := self._compared(quantity, view_model)) is not None
        }
        enlarged = BAND_FACTORS[self.band.value] if self.band is not None else 0.0
        halves = [self._bands.halves.get(q.key) for q in quantity.parts]
        if not enlarged or all(half is None for half in halves):
            return ExtraSeries(others)
        frames = len(self._axis.values)
        parts = [half if known and half is not None else np.full((frames, len(q.curves)), np.nan)
                 for q, half in zip(quantity.parts, halves, strict=True)]  # fmt: skip
        return ExtraSeries(others, np.column_stack(parts), enlarged)

    def _compared(self, quantity: Quantity | QuantityGroup, other: ViewModel) -> Real | None:
        """The same curves (F, k) of another design, at the values of the present axis; None if it does not have them."""
        known = {q.title: q for q in other.quantities}
        axis = next((a for a in other.axes if a.title == self._axis.title), None)
        parts = tuple(known[q.title] for q in quantity.parts if q.title in known and known[q.title].curves == q.curves)
        if axis is None or len(parts) < len(quantity.parts):
            return None
        return interpolated(QuantityGroup(parts).values(), axis.values, self._axis.values)

    def add(self, quantity: Quantity | None = None) -> None:
        """Add a plot, unless there are `MOST_PLOTS`: of a quantity, by default the next one that is not plotted."""
        with self._lock:
            if len(self.slots) >= MOST_PLOTS:
                return
            drawn = {q.title for slot in self.slots for q in slot.quantity.parts}
            spare = (q for title, q in self._quantities.items() if title not in drawn)
            chosen = quantity or next(spare, next(iter(self._quantities.values())))
            self._made += 1
            slot = SharedSlot(self._server, self._tab, f"Plot {self._made}", tuple(self._quantities.values()), chosen, self._axis)
            self.slots.append(slot)
            self._plot(slot, slot.quantity)
            self.more.disabled = len(self.slots) >= MOST_PLOTS
        slot.choice.on_update(self._callback("Changing a plot", lambda _: self.choose(slot, slot.choice.value)))
        slot.additions.on_update(self._callback("Changing a plot", lambda _: self.join(slot, slot.additions.value)))
        slot.buttons.on_click(self._callback("Saving a plot", lambda event: self._press(slot, slot.buttons.value, event.client)))
        self.changed()

    def remove(self, slot: SharedSlot) -> None:
        """Remove a plot."""
        with self._lock:
            if slot in self.slots:
                self.slots.remove(slot)
                slot.remove()
                self.more.disabled = False
        self.changed()

    def choose(self, slot: SharedSlot, title: str) -> None:
        """Plot another quantity; an unknown title changes nothing."""
        with self._lock:
            if title in self._quantities:
                self._plot(slot, QuantityGroup((self._quantities[title],)))
            slot.offer(tuple(self._quantities.values()))
        self.changed()

    def join(self, slot: SharedSlot, title: str) -> None:
        """Add the curves of another quantity of the same unit to a plot, or remove them if they are there."""
        with self._lock:
            known, parts = self._quantities.get(title), slot.quantity.parts
            if known is not None and known.unit == slot.quantity.unit:
                rest = tuple(q for q in parts if q.title != title)
                self._plot(slot, QuantityGroup(rest if len(rest) < len(parts) and rest else (*rest, known)))
            slot.offer(tuple(self._quantities.values()))
        self.changed()

    def tracks(self) -> Iterator[PlotTrack | NumberTrack]:
        """Tracks of the cursors and of the numbers above the plots."""
        with self._lock:
            for slot in self.slots:
                yield from slot.tracks()

    def open(self, title: str) -> None:
        """Plot a quantity in the first plot."""
        if not self.slots:
            self.add()
        self.choose(self.slots[0], title)

    def show(self, frame: int, playing: bool) -> None:
        with self._lock:
            now = time.perf_counter()
            if playing and now - self._moved < 1.0 / CURSOR_RATE:
                return
            self._frame, self._moved = frame, now
            for slot in self.slots:
                slot.show(frame)

    def _press(self, slot: SharedSlot, button: str, client: viser.ClientHandle) -> None:
        if button == REMOVE_LABEL:
            self.remove(slot)
        elif button in PLOT_FORMATS and self._waiting.acquire(blocking=False):
            self._saver.submit(self._save, slot, button, client)

    def _save(self, slot: SharedSlot, kind: str, client: viser.ClientHandle) -> None:
        """Send a plot as a file, in a thread of its own: drawing takes long, and all browsers wait for viser's thread."""
        try:
            words = re.sub(r"[^\w.-]+", "-", slot.quantity.label).strip("-")[:LONGEST_NAME]
            data = self.file(slot, kind)
            if client.client_id in self._server.get_clients():  # otherwise the browser has disconnected
                client.send_file_download(f"{words}.{kind.lower()}", data, save_immediately=True)
        except Exception as error:
            report(self._server, "Saving a plot", error, client)
        finally:
            self._waiting.release()
            release_garbage()

    def file(self, slot: SharedSlot, kind: str) -> bytes:
        """A plot as a file, with the curves of the compared designs and its bands, not enlarged; ``kind``: one of
        ``PLOT_FORMATS``."""
        with self._lock:
            quantity, axis, extra = slot.quantity, self._axis, self._extra(slot.quantity)
        return plot_file(kind, self._name, quantity, axis, extra.others, extra.half)


class PlotSlot:
    """One plot with a choice of its quantity and the values at the present frame; curves of compared designs are dashed, tolerance
    bands lie around the curves."""

    def __init__(
        self,
        server: viser.ViserServer,
        tab: viser.GuiTabHandle,
        label: str,
        titles: tuple[str, ...],
        quantity: Quantity | QuantityGroup,
        axis: Axis,
    ):
        self._gui, self._tab, self._label = server.gui, tab, label
        with tab:
            self.choice = self._gui.add_dropdown(label, titles, initial_value=quantity.title)
            self._readout = self._gui.add_html("")
        self.chart: viser.GuiUplotHandle | None = None
        self.plot(quantity, axis, 0)

    def remove(self) -> None:
        """Remove the plot from the page."""
        for handle in (self.choice, self._readout, self.chart):
            if handle is not None:
                handle.remove()

    def plot(self, quantity: Quantity | QuantityGroup, axis: Axis, frame: int, extra: ExtraSeries = NO_EXTRA_SERIES) -> None:
        """Draw a quantity with its additional series in a new plot in place of the old one: data, curves and axes of a plot cannot
        be exchanged in one step."""
        self._read(quantity, axis, extra)
        series: list[Any] = [uplot.Series(label=axis.title)]
        for name, color in zip(quantity.curves, cycle(CURVE_COLORS), strict=False):
            series.append(uplot.Series(label=name, stroke=color, width=2, points={"show": False}))
        for other, dash in zip(extra.others, cycle(DESIGN_DASHES), strict=False):
            for name, color in zip(quantity.curves, cycle(CURVE_COLORS), strict=False):
                series.append(uplot.Series(label=f"{name} {other}", stroke=color, width=1.2, dash=dash, points={"show": False}))
        bands: list[uplot.Band] = []
        for name, color in zip(quantity.curves if extra.half is not None else (), cycle(CURVE_COLORS), strict=False):
            bands.append(uplot.Band(series=(len(series), len(series) + 1), fill=f"{color}{BAND_OPACITY}"))
            series += [uplot.Series(label=f"{name} {end}", width=0, points={"show": False}) for end in ("at most", "at least")]
        series.append(uplot.Series(label="now", stroke=CURSOR_COLOR, width=1.5, points={"show": False}))
        data = self._curves.at(frame)
        fonts: Any = {"font": "11px sans-serif", "labelFont": "12px sans-serif", "labelSize": 18}
        horizontal: Any = uplot.Axis(label=axis.title, size=34, labelGap=-2, **fonts)
        if axis.unit == "°":
            horizontal["incrs"] = ANGLE_STEPS
        names = {part.name for part in quantity.parts}
        title = f"{names.pop()} [{quantity.unit}]" if len(names) == 1 else ""
        vertical: Any = uplot.Axis(
            label=title if 0 < len(title) <= LONGEST_TITLE else f"[{quantity.unit}]", size=self._room(), space=24, **fonts
        )
        before = self.chart
        with self._tab:
            self.chart = self._gui.add_uplot(
                data,
                tuple(series),
                bands=tuple(bands) or None,
                scales=self._scales(),
                axes=(horizontal, vertical),
                legend=uplot.Legend(show=False),
                height=PLOT_HEIGHT,
                padding=(8, 14, 0, 0),
                order=None if before is None else before.order,
            )
        if before is not None:
            before.remove()
        self._ends = (axis.values[0], axis.values[-1])
        self.show(frame)

    def take(self, quantity: Quantity | QuantityGroup, axis: Axis, frame: int, extra: ExtraSeries = NO_EXTRA_SERIES) -> None:
        """Draw a quantity of another run. If the same quantity is drawn already, the plot stays and only its data change."""
        drawn = self.quantity.title, self.quantity.curves, self._axis.title, self._extra.kind
        if (quantity.title, quantity.curves, axis.title, extra.kind) != drawn:
            self.plot(quantity, axis, frame, extra)
            return
        before = self._curves
        self._read(quantity, axis, extra)
        self._curves.keep_range(before.range)
        if self._curves.range != before.range or (axis.values[0], axis.values[-1]) != self._ends:
            assert self.chart is not None
            self.chart.scales = self._scales()
        self._ends = (axis.values[0], axis.values[-1])
        self.show(frame)

    def _read(self, quantity: Quantity | QuantityGroup, axis: Axis, extra: ExtraSeries) -> None:
        self.quantity, self._axis, self._extra = quantity, axis, extra
        self._values = quantity.values()
        ends = []
        if extra.half is not None:
            half = extra.enlarged * extra.half
            ends = [self._values[:, k : k + 1] + half[:, k : k + 1] * [1.0, -1.0] for k in range(half.shape[1])]
        self._curves = Curves(axis.values, np.column_stack([self._values, *extra.others.values(), *ends]))
        self._least = ROUND_OFF * usual_size(self._values)

    def _room(self) -> float:
        """Width of the vertical axis [px]: its ticks, and the longest numbers in its range."""
        low, high = self._curves.range
        decimals = int(np.clip(-np.floor(np.log10(high - low) - 0.5), 0, 3))
        letters = max(len(f"{end:,.{decimals}f}") for end in (low, high))
        return float(np.clip(17.0 + DIGIT_WIDTH * letters, *AXIS_WIDTHS))

    def _scales(self) -> dict[str, Any]:
        ends = sorted((float(self._axis.values[0]), float(self._axis.values[-1])))
        return {"x": uplot.Scale(time=False, range=(ends[0], ends[1])), "y": uplot.Scale(range=self._curves.range)}

    def show(self, frame: int) -> None:
        """Move the cursor to a frame and show the values there."""
        assert self.chart is not None
        self.chart.data = self._curves.at(frame)
        unit = html.escape(unit_suffix(self.quantity.unit))
        values = [format_number(self._rounded(value)) for value in self._values[frame]]
        parts = [
            f'<span style="color:light-dark({color},{dark});white-space:nowrap"><b>{html.escape(name)}</b> '
            f'<span data-mv="{html.escape(self._label)}:{k}">{value}{unit}</span></span>'
            for k, (name, color, dark, value) in enumerate(
                zip(self.quantity.curves, cycle(CURVE_COLORS), cycle(ON_DARK), values, strict=False)
            )
        ]
        self._readout.content = (
            '<div style="display:flex;flex-wrap:wrap;gap:0 1em;padding:0 0.9em 0.2em;font-size:0.8em;'
            'font-variant-numeric:tabular-nums">' + "".join([*parts, *self._peaks()]) + "</div>"
        )

    def _peaks(self) -> Iterator[str]:
        """HTML of the peaks of the curves compared with those of other designs, and of the widths of their bands."""
        unit, several = html.escape(unit_suffix(self.quantity.unit)), len(self.quantity.curves) > 1
        for k, name in enumerate(self.quantity.curves):
            whose = f"{html.escape(name)}: " if several else ""
            now = self._rounded(peak_of(self._values[:, k]))
            present = f"{whose}peak {format_number(now)}{unit}"
            for other, values in self._extra.others.items():
                was = self._rounded(peak_of(values[:, k], now))
                part = f", {'+' if abs(now) >= abs(was) else '−'}{abs(abs(now) / abs(was) - 1.0):.1%}" if was else ""
                said = f"{present}, {html.escape(other)} {format_number(was)}{unit}{part.replace('%', ' %')}"
                yield f'<span style="opacity:0.8">{said}</span>'
            half = np.zeros(0) if self._extra.half is None else self._extra.half[:, k]
            if np.isfinite(half).any():
                most = float(f"{np.nanmax(half):.3g}")
                yield f'<span style="opacity:0.8">{whose}tolerances: ± {format_number(most)}{unit} at most</span>'

    def tracks(self) -> Iterator[PlotTrack | NumberTrack]:
        """Tracks of the cursor and of the numbers."""
        assert self.chart is not None
        yield self._curves.track(uuid_of(self.chart))
        for k in range(len(self.quantity.curves)):
            values = np.where(np.abs(self._values[:, k]) <= self._least, 0.0, self._values[:, k])
            yield NumberTrack(f"{self._label}:{k}", values, None, unit_suffix(self.quantity.unit))

    def _rounded(self, value: float) -> float:
        """The value, or zero if it is only round-off of the quantity."""
        return 0.0 if abs(value) <= self._least else float(value)


class SharedSlot(PlotSlot):
    """A plot that can show several quantities of one unit, be saved as a file, and be removed."""

    def __init__(
        self,
        server: viser.ViserServer,
        tab: viser.GuiTabHandle,
        label: str,
        quantities: tuple[Quantity, ...],
        quantity: Quantity,
        axis: Axis,
    ):
        super().__init__(server, tab, label, tuple(q.title for q in quantities), quantity, axis)
        with tab:
            self.additions = self._gui.add_dropdown(
                "with", (NOTHING_ELSE,), hint="another curve of the same unit, or one to be taken away"
            )
            self.buttons = self._gui.add_button_group("Save", (*PLOT_FORMATS, REMOVE_LABEL))
        self.offer(quantities)

    def offer(self, quantities: tuple[Quantity, ...]) -> None:
        """Offer the quantities of a run, and those of the same unit to be added."""
        first, *others = (q.title for q in self.quantity.parts)
        titles = tuple(q.title for q in quantities)
        if tuple(self.choice.options) != titles:
            self.choice.options = titles
        if self.choice.value != first:
            self.choice.value = first
        same = (q.title for q in quantities if q.unit == self.quantity.unit and q.title != first)
        choices = (f"{len(others)} more" if others else NOTHING_ELSE, *same)
        if tuple(self.additions.options) != choices:
            self.additions.options = choices
        if self.additions.value != choices[0]:
            self.additions.value = choices[0]

    def remove(self) -> None:
        super().remove()
        self.additions.remove()
        self.buttons.remove()
